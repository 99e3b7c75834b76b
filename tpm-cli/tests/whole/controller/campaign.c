/*
 * A campaign of the generated code with a simulated machine in the same program: two carts, integrated between samples, with noise in both
 * sensors and a proportional-derivative feedback of the driven cart. Arguments: seed, and what goes wrong. Prints the phase, the end, the status
 * and the number of runs, then every parameter with its deviation.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "t.h"

#define STEP 1e-3
#define NOISE 1e-4

static t_run_campaign campaign;
static uint64_t seed;

static double uniform(void)
{
    seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return ((double)(seed >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(void)
{
    const double radius = sqrt(-2.0 * log(uniform()));
    return radius * cos(6.283185307179586 * uniform());
}

/* m1 = 2, m2 = 1, k1 = 40, k2 = 300, k3 = 200 */
static void slope(const double x[4], double force, double d[4])
{
    const double spring = 200.0 * (x[0] - x[1]);

    d[0] = x[2];
    d[1] = x[3];
    d[2] = (force - 40.0 * x[0] - 300.0 * x[0] * x[0] * x[0] - spring) / 2.0;
    d[3] = spring;
}

/* A sample later, the force held (Runge-Kutta of fourth order, four steps). */
static void later(double x[4], double force)
{
    const double h = STEP / 4.0;
    const double at[4] = {0.0, 0.5, 0.5, 1.0};
    const double weight[4] = {1.0, 2.0, 2.0, 1.0};
    int step, stage, i;

    for (step = 0; step < 4; ++step) {
        double d[4] = {0.0, 0.0, 0.0, 0.0};
        double sum[4] = {0.0, 0.0, 0.0, 0.0};
        double moved[4];
        for (stage = 0; stage < 4; ++stage) {
            for (i = 0; i < 4; ++i) {
                moved[i] = x[i] + at[stage] * h * d[i];
            }
            slope(moved, force, d);
            for (i = 0; i < 4; ++i) {
                sum[i] += weight[stage] * d[i];
            }
        }
        for (i = 0; i < 4; ++i) {
            x[i] += h / 6.0 * sum[i];
        }
    }
}

int main(int count, char **arguments)
{
    const t_run_stage stages[2] = {{{(REAL)0.2, 0}, 2094}, {{(REAL)0.4, 0}, 1571}};
    const t_run_parameters prior = {3, (REAL)0.5, 60, 150, 300};
    const char *const wrong = count > 2 ? arguments[2] : "";
    t_run_rules rules = {{(REAL)STEP, 1, 0}, 3, 10, 2, 10, (REAL)0.9};
    t_run_limits limits = {{400}, {(REAL)0.5, (REAL)0.5}};
    double state[4] = {0.0, 0.0, 0.0, 0.0};
    double before = 0.0, rate = 0.0;
    unsigned long number;
    int due = 0, rested = 0, i;

    seed = strtoull(arguments[1], NULL, 10);
    if (strcmp(wrong, "weak") == 0) {
        limits.inputs.F = 20;
    }
    if (strcmp(wrong, "odd") == 0) {
        rules.periods = 5;
    }
    t_run_campaign_begin(&campaign, stages, 2, &rules, &limits, &prior);
    for (number = 0; number < 2000000 && rested < 8000; ++number) {
        double read1 = state[0] + NOISE * normal();
        double read2 = state[1] + NOISE * normal();
        const double error = read1 - (double)campaign.command.reference.x1;
        double force;
        t_run_sample sample;
        t_run_phase phase;

        if (strcmp(wrong, "nan") == 0 && number == 60000) {
            read2 = NAN;
        }
        rate += (1.0 - exp(-STEP / 2e-3)) * ((error - (number == 0 ? error : before)) / STEP - rate);
        before = error;
        force = (double)campaign.command.feed_forward.F - 400.0 * error - 40.0 * rate;
        sample.measured.x1 = (REAL)read1;
        sample.measured.x2 = (REAL)read2;
        sample.applied.F = (REAL)force;
        if (campaign.status != T_RUN_OK && campaign.runs == 0) {
            break;
        }
        phase = t_run_campaign_push(&campaign, &sample);
        later(state, force);
        /* An update takes a while, here a third of a second. */
        due = phase == T_RUN_DUE ? due + 1 : 0;
        if (due == 333) {
            t_run_campaign_update(&campaign);
        }
        rested += phase == T_RUN_ENDED;
    }
    printf("%d %d %d %u\n", (int)campaign.phase, (int)campaign.end, (int)campaign.status, (unsigned)campaign.runs);
    printf("%g %g\n", fabs(state[0]) > fabs(state[1]) ? fabs(state[0]) : fabs(state[1]), (double)campaign.command.reference.x1);
    for (i = 0; i < 5 && campaign.estimated; ++i) {
        printf("%.17g %.17g\n", (double)((REAL *)&campaign.estimate.parameters)[i],
                (double)((REAL *)&campaign.estimate.deviations)[i]);
    }
    return 0;
}
