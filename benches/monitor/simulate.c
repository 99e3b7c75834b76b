/* The emitted monitor, fed with simulated motion: false alarms over many hours, and how soon a mass changed by 10 % is found.
 * Rows are those of the emitted regressor along the true motion; the monitor gets the motion and the forces with noise. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "estimator.h"

#define B ESTIMATOR_BASE_PARAMETERS
#define E ESTIMATOR_EQUATIONS
#define P ESTIMATOR_PARAMETERS
#define JOINTS (sizeof(estimator_motion) / sizeof(REAL) / 3)
#define DT 0.05
#define TONES 3
#define RUN_IN 200
/* Work in which a run-in of 200 blocks of 5 s must be over, h: many times as long as it takes. */
#define RUN_IN_HOURS 24.0
/* Standard deviation of the identified values, as a share of them. */
#define SPREAD 0.001

static unsigned long long state;

static double uniform(void)
{
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return ((double)(state >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(void)
{
    return sqrt(-2.0 * log(uniform())) * cos(6.283185307179586 * uniform());
}

/* What MACHINE says: true parameters, those of friction, and those of the mass that changes. */
#include MACHINE

/* A motion of sums of sines, faded in and out, drawn anew for every job of 20 to 60 s; one job in ten is a rest, and one joint in five
 * of several rests by itself. What its dry friction holds then is anything within its limits. */
struct job {
    double begins, lasts, size;
    double amplitude[8][TONES], frequency[8][TONES], phase[8][TONES], held[8];
    int moves[8];
};

static void draw(struct job *job, double begins, double lasts, int rests)
{
    size_t j, k;

    job->begins = begins;
    job->lasts = lasts;
    job->size = rests ? 0.0 : 0.5 + uniform();
    for (j = 0; j < JOINTS; ++j) {
        job->moves[j] = !rests && (JOINTS == 1 || uniform() < 0.8);
        job->held[j] = 2.0 * uniform() - 1.0;
        for (k = 0; k < TONES; ++k) {
            job->frequency[j][k] = 6.283185307179586 * (0.15 + 0.85 * uniform());
            job->amplitude[j][k] = AMPLITUDE * (0.3 + 0.7 * uniform()) / TONES;
            job->phase[j][k] = 6.283185307179586 * uniform();
        }
    }
}

static void move(const struct job *job, double time, double *q)
{
    const double t = time - job->begins, w = 3.141592653589793 / job->lasts;
    /* The envelope sin(w t)^2 with its derivatives. */
    const double f = sin(w * t) * sin(w * t), f1 = w * sin(2.0 * w * t), f2 = 2.0 * w * w * cos(2.0 * w * t);
    size_t j, k;

    for (j = 0; j < JOINTS; ++j) {
        double s = 0.0, s1 = 0.0, s2 = 0.0;
        for (k = 0; k < TONES; ++k) {
            const double v = job->frequency[j][k], a = job->moves[j] ? job->size * job->amplitude[j][k] : 0.0, p = v * t + job->phase[j][k];
            s += a * sin(p);
            s1 += a * v * cos(p);
            s2 -= a * v * v * sin(p);
        }
        q[3 * j] = f * s;
        q[3 * j + 1] = f1 * s + f * s1;
        q[3 * j + 2] = f2 * s + 2.0 * f1 * s1 + f * s2;
    }
}

struct world {
    struct job job;
    double time, colour[8], parameters[P], temperature;
    long still;
};

static estimator_monitor_rules rules;
static estimator_monitor monitor;
/* Squares of all forces without noise, and how many. */
static double squares[E], instants;

static void base_of(const double *parameters, double *base)
{
    REAL of[P], found[B];
    size_t i;

    for (i = 0; i < P; ++i) of[i] = (REAL)parameters[i];
    estimator_base((const estimator_parameters *)of, (estimator_base_parameters *)found);
    for (i = 0; i < B; ++i) base[i] = (double)found[i];
}

static void noisy(const double *q, REAL *given)
{
    size_t j;

    for (j = 0; j < JOINTS; ++j) {
        given[3 * j] = (REAL)(q[3 * j] + 1e-5 * normal());
        given[3 * j + 1] = (REAL)(q[3 * j + 1] + NOISE_VELOCITY * normal());
        given[3 * j + 2] = (REAL)(q[3 * j + 2] + NOISE_ACCELERATION * normal());
    }
}

/* One sample of the machine, given to the monitor. */
static estimator_monitor_state sample(struct world *world)
{
    double q[3 * 8], base[B], parameters[P];
    REAL exact[3 * 8], given[3 * 8], matrix[E][B], creeping[E][B], applied[E];
    const double drift = 0.3 * sin(6.283185307179586 * world->time / 7200.0 + world->temperature);
    size_t i, j;
    int whole = uniform() > 1e-3;

    if (world->time >= world->job.begins + world->job.lasts) {
        const int rests = uniform() < 0.1;
        /* Every few days it stands still for hours. */
        const double lasts = rests && uniform() < 0.01 ? 4.0 * 3600.0 : 20.0 + 40.0 * uniform();
        draw(&world->job, world->time, lasts, rests);
    }
    move(&world->job, world->time, q);
    memcpy(parameters, world->parameters, sizeof parameters);
    for (i = 0; i < P; ++i) parameters[i] *= is_friction(i) ? 1.0 + drift : 1.0;
    base_of(parameters, base);
    for (i = 0; i < 3 * JOINTS; ++i) exact[i] = (REAL)q[i];
    estimator_base_regressor((const estimator_motion *)exact, matrix);
    /* With the signs that joints at rest would have if they crept. */
    for (j = 0; j < JOINTS; ++j) exact[3 * j + 1] += (REAL)(world->job.moves[j] ? 0.0 : 1e-9);
    estimator_base_regressor((const estimator_motion *)exact, creeping);
    for (i = 0; i < E; ++i) {
        double force = 0.0;
        for (j = 0; j < B; ++j) {
            const double held = i < JOINTS ? world->job.held[i] : 0.0;
            force += ((double)matrix[i][j] + held * (double)(creeping[i][j] - matrix[i][j])) * base[j];
        }
        squares[i] += force * force;
        /* Coloured: correlated over half a second. */
        world->colour[i] = 0.9 * world->colour[i] + sqrt(1.0 - 0.81) * normal();
        applied[i] = (REAL)(force + deviation[i] * (0.7 * world->colour[i] + 0.7 * normal()));
    }
    instants += 1.0;
    noisy(q, given);
    if (uniform() < 1e-4) given[1] = (REAL)NAN;
    if (uniform() < 1e-3) applied[0] = 1e6f, whole = 0;
    world->time += DT;
    return estimator_monitor_push(&monitor, (const estimator_motion *)given, (const estimator_forces *)applied, whole);
}

/* Whether the run-in has lasted so long that it will not end; says what it waits for. */
static int waits_forever(const struct world *world)
{
    size_t i;

    if (world->time < 3600.0 * RUN_IN_HOURS) return 0;
    printf("the run-in has not ended after %.0f h of work:", RUN_IN_HOURS);
    for (i = 0; i < B; ++i) {
        if (monitor.parameters[i].blocks < RUN_IN) {
            printf(" %s has %u blocks of %u;", estimator_base_parameter_labels[i].name, (unsigned)monitor.parameters[i].blocks,
                   (unsigned)RUN_IN);
        }
    }
    printf("\n");
    return 1;
}

/* An identification with its errors, then rest and run-in. */
static int begin(struct world *world, double false_alarms)
{
    double base[B], friction[P], drifting[B], still[3 * 8] = {0};
    size_t i;

    memset(world, 0, sizeof *world);
    machine(world->parameters);
    world->temperature = 6.283185307179586 * uniform();
    base_of(world->parameters, base);
    for (i = 0; i < P; ++i) friction[i] = is_friction(i) ? world->parameters[i] : 0.0;
    base_of(friction, drifting);
    memset(&rules, 0, sizeof rules);
    for (i = 0; i < B; ++i) {
        const double spread = SPREAD * fmax(fabs(base[i]), SMALL);
        rules.values[i] = (REAL)(base[i] + spread * normal());
        rules.spread[i][i] = (REAL)spread;
        rules.changes[i] = (REAL)(0.1 * fmax(fabs(base[i]), SMALL));
        rules.drifts[i] = (REAL)(0.3 * fabs(drifting[i]) * 1.02);
    }
    for (i = 0; i < E; ++i) ((REAL *)&rules.deviations)[i] = (REAL)deviation[i];
    rules.sample_time = (REAL)DT;
    rules.block = 100;
    rules.run_in = RUN_IN;
    rules.false_alarms = (REAL)false_alarms;
    if (estimator_monitor_begin(&monitor, &rules) != ESTIMATOR_OK) return 1;
    for (i = 0; i < 2000; ++i) {
        REAL given[3 * 8];
        noisy(still, given);
        estimator_monitor_rest(&monitor, (const estimator_motion *)given);
    }
    /* A rest of hours may fall into the run-in. */
    while (monitor.state == ESTIMATOR_MONITOR_RUN_IN) {
        (void)sample(world);
        if (waits_forever(world)) return 1;
    }
    return 0;
}

static void say(const char *what, const struct world *world)
{
    if (monitor.state == ESTIMATOR_MONITOR_MOVED) {
        printf("%s after %.1f h: %s by %.4g, deviation %.2g\n", what, world->time / 3600.0,
               estimator_base_parameter_labels[monitor.moved].name, (double)monitor.change, (double)monitor.deviation);
    } else {
        printf("%s after %.1f h: unexplained power %.3g\n", what, world->time / 3600.0, (double)monitor.growth);
    }
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(int count, char **words)
{
    const double hours = count > 1 ? atof(words[1]) : 1000.0;
    const int trials = count > 2 && atoi(words[2]) <= 1000 ? atoi(words[2]) : 100;
    const double rate = 1e-3;
    static struct world world;
    int alarms = 0, found = 0, other = 0, early = 0, k;
    double within[1000];
    size_t i;

    state = 1;
    if (begin(&world, rate)) return 1;
    printf("%u base parameters, %u equations, monitor of %u bytes\n", (unsigned)B, (unsigned)E, (unsigned)sizeof monitor);
    while (world.time < 3600.0 * hours) {
        const estimator_monitor_state now = sample(&world);
        if (now == ESTIMATOR_MONITOR_MOVED || now == ESTIMATOR_MONITOR_UNEXPLAINED) {
            ++alarms;
            say("false alarm", &world);
            estimator_monitor_again(&monitor);
        }
    }
    for (i = 0; i < E; ++i) {
        printf("equation %u: forces of %.3g (rms), noise of %.3g\n", (unsigned)i, sqrt(squares[i] / instants), deviation[i]);
    }
    printf("%d false alarms in %.0f h; %g were allowed\n", alarms, hours, rate * hours);
    for (k = 0; k < trials; ++k) {
        double began;
        state = 1000ULL + (unsigned long long)k;
        if (begin(&world, rate)) return 1;
        /* The monitor works for a while before the mass changes, in the middle of a job. */
        draw(&world.job, world.time, 1e9, 1);
        world.job.lasts = 0.0;
        for (i = 0; i < 2000; ++i) {
            const estimator_monitor_state now = sample(&world);
            early += now == ESTIMATOR_MONITOR_MOVED || now == ESTIMATOR_MONITOR_UNEXPLAINED;
        }
        draw(&world.job, world.time, 60.0, 0);
        change(world.parameters);
        for (began = world.time; world.time < began + 600.0;) {
            const estimator_monitor_state now = sample(&world);
            if (now == ESTIMATOR_MONITOR_MOVED) break;
            if (now == ESTIMATOR_MONITOR_UNEXPLAINED) {
                ++other;
                break;
            }
        }
        within[k] = world.time - began;
        found += within[k] <= 60.0;
        if (k < 3) say("mass changed: found", &world);
    }
    qsort(within, (size_t)trials, sizeof within[0], by_size);
    printf("found after %.0f s in half of them, %.0f s in nine of ten, %.0f s at most\n", within[trials / 2], within[trials * 9 / 10],
           within[trials - 1]);
    printf("a mass changed by 10 %%: found within 60 s in %d of %d, %d of them by the power alone, %d early\n", found, trials, other,
           early);
    return 0;
}
