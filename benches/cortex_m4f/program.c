/* A model's estimator on the controller: it finds the parameters of a machine whose forces stand in a table. */
#include <math.h>
#include <stdint.h>

#include "estimator.h"
#include "machine.h"
#include "samples.h"

#define PARAMETERS ESTIMATOR_PARAMETERS
#define HARMONICS ESTIMATOR_HARMONICS

static estimator_accumulator sums;
static estimator_workspace workspace;
static estimator_estimate estimate;
static estimator_harmonics harmonics[RUNS];
static estimator_motion motion;
static estimator_inputs inputs;
static estimator_status status;

static float phase_of(int i)
{
    return 6.28318531f * (float)i / (float)SAMPLES;
}

__attribute__((noinline)) static void take_in(void)
{
    int i;

    estimator_accumulator_clear(&sums);
    for (i = 0; i < SAMPLES; ++i) {
        estimator_accumulate(&sums, phase_of(i), &samples[0][i]);
    }
}

__attribute__((noinline)) static void references(void)
{
    int i;

    for (i = 0; i < SAMPLES; ++i) {
        estimator_reference_at(&patterns[0] CONSTANTS, phase_of(i), &motion);
    }
}

__attribute__((noinline)) static void feed_forwards(void)
{
    int i;

    for (i = 0; i < SAMPLES; ++i) {
        estimator_feed_forward(&motion, &guess CONSTANTS, &inputs);
    }
}

__attribute__((noinline)) static void take_in_at(void)
{
    int i;

    for (i = 0; i < SAMPLES; ++i) {
        estimator_accumulate_at(&sums, 0.6f, 0.8f, &samples[0][i]);
    }
}

#ifdef DIRECT
__attribute__((noinline)) static void identify_directly(void)
{
    int i;

    for (i = 0; i < SAMPLES; ++i) {
        estimator_identify_direct(&patterns[0] CONSTANTS, &harmonics[0], &estimate.parameters);
    }
}
#endif

/* One run by itself; several by their normal equations, whose solution is that of least squares over all of them. */
__attribute__((noinline)) static void identify(void)
{
#if RUNS == 1
    status = estimator_identify(&patterns[0] CONSTANTS, &harmonics[0], 0, &workspace, &estimate);
#else
    static float normal[PARAMETERS][PARAMETERS], right[PARAMETERS];
    int run, row, i, j;

    for (run = 0; run < RUNS; ++run) {
        const float *const effort = (const float *)&harmonics[run];
        estimator_estimator_matrix(&patterns[run] CONSTANTS, workspace.matrix);
        for (row = 0; row < HARMONICS; ++row) {
            for (i = 0; i < PARAMETERS; ++i) {
                right[i] += workspace.matrix[row][i] * effort[row];
                for (j = 0; j < PARAMETERS; ++j) {
                    normal[i][j] += workspace.matrix[row][i] * workspace.matrix[row][j];
                }
            }
        }
    }
    for (row = 0; row < HARMONICS; ++row) {
        workspace.right[row] = row < PARAMETERS ? right[row] : 0.0f;
        for (j = 0; j < PARAMETERS; ++j) {
            workspace.matrix[row][j] = row < PARAMETERS ? normal[row][j] : 0.0f;
        }
    }
    status = estimator_solve(&workspace, &estimate);
#endif
}

static int check(const char *name, float found, float expected)
{
    print(name);
    print(" = ");
    print_float(found);
    print(", off by ");
    print_float(fabsf(found - expected) / fabsf(expected));
    print("\n");
    return !(fabsf(found - expected) <= TOLERANCE * fabsf(expected));
}

static int check_all(void)
{
    const float *const found = (const float *)&estimate.parameters;
    int i, wrong = 0;

    for (i = 0; i < PARAMETERS; ++i) {
        wrong |= check(estimator_parameter_labels[i].name, found[i], truth[i]);
    }
    return wrong;
}

int main(void)
{
    int wrong = 0, run, i;

    measure("reference_at", references, SAMPLES);
    measure("feed_forward", feed_forwards, SAMPLES);
    measure("accumulate_at", take_in_at, SAMPLES);
    measure("accumulate", take_in, SAMPLES);
    for (run = 0; run < RUNS; ++run) {
        estimator_accumulator_clear(&sums);
        for (i = 0; i < SAMPLES; ++i) {
            estimator_accumulate(&sums, phase_of(i), &samples[run][i]);
        }
        if (estimator_accumulated(&sums, &harmonics[run]) != ESTIMATOR_OK) {
            return 1;
        }
    }
#ifdef DIRECT
    measure("identify_direct", identify_directly, SAMPLES);
    wrong |= check_all();
#endif
    measure("identify", identify, 1);
    wrong |= status != ESTIMATOR_OK || estimate.rank != PARAMETERS;
    wrong |= check_all();
#ifdef LUMPED
    {
        estimator_physical physical;

        estimator_unlump(&estimate.parameters, &physical);
        for (i = 0; i < (int)(sizeof physical / sizeof(float)); ++i) {
            wrong |= check(physical_names[i], ((const float *)&physical)[i], physical_truth[i]);
        }
    }
#endif
    return wrong;
}
