/*
 * A machine that identifies itself: the generated campaign in single precision, and the machine, its sensors and its feedback beside it,
 * simulated in double precision. Prints for every seed how the campaign ended and every parameter with its deviation and its error in
 * deviations; at last the instructions of a sample and of an update.
 *
 * On a computer (RECORD) it writes the samples of every measured run instead, for another estimator.
 */
#include <math.h>
#include <stdint.h>
#ifdef RECORD
#include <stdio.h>
#endif

#include "estimator.h"
#include "machine.h"
#include MACHINE

#define STEP 1e-3
#define STAGES (sizeof stages / sizeof stages[0])
/* Samples that an update takes, and samples at rest behind the end. */
#define UPDATE 333
#define REST 2000

static const estimator_run_rules rules = {{1e-3f, 1, 0.0f}, 3, PERIODS, 2, 10, 0.9f};
static estimator_run_campaign campaign;
static double position[COORDINATES], speed[COORDINATES];
static uint64_t state;

static double uniform(void)
{
    state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return ((double)(state >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(void)
{
    const double radius = sqrt(-2.0 * log(uniform()));
    return radius * cos(6.283185307179586 * uniform());
}

/* A sample later, the inputs held: a step of Runge and Kutta of fourth order. */
static void later(const double force[INPUTS])
{
    static const double at[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    double x[COORDINATES], v[COORDINATES], a[COORDINATES];
    double dx[COORDINATES], dv[COORDINATES], moved[COORDINATES], gained[COORDINATES];
    int stage, i;

    for (i = 0; i < COORDINATES; ++i) {
        v[i] = a[i] = moved[i] = gained[i] = 0.0;
    }
    for (stage = 0; stage < 4; ++stage) {
        for (i = 0; i < COORDINATES; ++i) {
            dx[i] = v[i];
            dv[i] = a[i];
        }
        for (i = 0; i < COORDINATES; ++i) {
            x[i] = position[i] + at[stage] * STEP * dx[i];
            v[i] = speed[i] + at[stage] * STEP * dv[i];
        }
        accelerations(x, v, force, a);
        for (i = 0; i < COORDINATES; ++i) {
            moved[i] += weight[stage] * v[i];
            gained[i] += weight[stage] * a[i];
        }
    }
    for (i = 0; i < COORDINATES; ++i) {
        position[i] += STEP / 6.0 * moved[i];
        speed[i] += STEP / 6.0 * gained[i];
    }
}

static void update(void)
{
    estimator_run_campaign_update(&campaign CONSTANTS);
}

static void report(int seed)
{
    const float *const found = (const float *)&campaign.estimate.parameters;
    const float *const deviations = (const float *)&campaign.estimate.deviations;
    int i;

    print("seed ");
    print_number(seed);
    print(" end ");
    print_number((long)campaign.end);
    print(" runs ");
    print_number((long)campaign.runs);
    print("\n");
    for (i = 0; i < PARAMETERS && campaign.estimated; ++i) {
        print(estimator_run_parameter_names[i]);
        print(" ");
        print_float(found[i]);
        print(" ");
        print_float(deviations[i]);
        print(" ");
        print_float((float)(((double)found[i] - truth[i]) / (double)deviations[i]));
        print("\n");
    }
}

#ifdef RECORD
static void record(int seed, const estimator_run_sample *sample)
{
    static FILE *file;
    static uint32_t open;
    const uint32_t run = campaign.phase == ESTIMATOR_RUN_MEASURING ? campaign.runs + 1 : 0;
    char name[64];
    int i;

    if (run != open && file != NULL) {
        fclose(file);
        file = NULL;
    }
    if (run != open && run != 0) {
        sprintf(name, "seed%d_run%u.csv", seed, (unsigned)run);
        file = fopen(name, "w");
        fprintf(file, "t_s%s\n", CHANNELS);
    }
    open = run;
    if (file != NULL) {
        fprintf(file, "%.9g", STEP * (double)campaign.run.lines.count);
        for (i = 0; i < COORDINATES; ++i) {
            fprintf(file, ",%.9g", (double)((const float *)&sample->measured)[i]);
        }
        for (i = 0; i < INPUTS; ++i) {
            fprintf(file, ",%.9g", (double)((const float *)&sample->applied)[i]);
        }
        fprintf(file, "\n");
    }
}
#endif

/* Instructions of all samples so far, and their number. */
static double instructions;
static long samples, longest;

static void play(int seed)
{
    const double pass = 1.0 - exp(-STEP / FILTER);
    double before[COORDINATES], rate[COORDINATES];
    long number, due = 0, rested = 0;
    int i, j;

    state = (uint64_t)seed;
    for (i = 0; i < COORDINATES; ++i) {
        position[i] = rest[i];
        speed[i] = rate[i] = before[i] = 0.0;
    }
    estimator_run_campaign_begin(&campaign, stages, STAGES, &rules, &limits, &prior CONSTANTS);
    for (number = 0; number < 2000000 && rested < REST; ++number) {
        const float *const reference = (const float *)&campaign.command.reference;
        const float *const feed_forward = (const float *)&campaign.command.feed_forward;
        estimator_run_sample sample;
        float *const measured = (float *)&sample.measured;
        float *const applied = (float *)&sample.applied;
        double force[INPUTS];
        long took;

        for (i = 0; i < INPUTS; ++i) {
            force[i] = (double)feed_forward[i];
        }
        for (j = 0; j < COORDINATES; ++j) {
            double error;
            measured[j] = (float)(position[j] + NOISE * normal());
            error = (double)measured[j] - (double)reference[j];
            rate[j] += pass * ((error - (number == 0 ? error : before[j])) / STEP - rate[j]);
            before[j] = error;
            for (i = 0; i < INPUTS; ++i) {
                force[i] -= proportional[i][j] * error + derivative[i][j] * rate[j];
            }
        }
        for (i = 0; i < INPUTS; ++i) {
            applied[i] = (float)force[i];
            force[i] = (double)applied[i];
        }
#ifdef RECORD
        record(seed, &sample);
#endif
        clock_start();
        estimator_run_campaign_push(&campaign, &sample CONSTANTS);
        took = clock_instructions();
        instructions += (double)took;
        ++samples;
        longest = took > longest ? took : longest;
        later(force);
        due = campaign.phase == ESTIMATOR_RUN_DUE ? due + 1 : 0;
        if (due == UPDATE && campaign.runs == 1 && seed == FIRST) {
            measure("update", update, 1);
        } else if (due == UPDATE) {
            update();
        }
        rested += campaign.phase == ESTIMATOR_RUN_ENDED;
    }
    report(seed);
}

int main(void)
{
    int seed;

    for (seed = FIRST; seed < FIRST + SEEDS; ++seed) {
        play(seed);
    }
    print("sample: ");
    print_number((long)(instructions / (double)samples));
    print(" instructions, at most ");
    print_number(longest);
    print("\ncampaign: ");
    print_number((long)sizeof campaign);
    print(" bytes of memory\n");
    return 0;
}
