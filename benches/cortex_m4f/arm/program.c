/* An arm's estimator on the controller: base parameters sample by sample, beside what double precision finds from these samples. */
#include <math.h>
#include <string.h>

#include "estimator.h"
#include "machine.h"
#include "samples.h"

#define PARAMETERS ESTIMATOR_BASE_PARAMETERS

static estimator_base_estimator estimator;
static estimator_base_workspace workspace;
static estimator_base_estimate estimate;
static estimator_status status;

static void take_in(int from, int to)
{
    int i;

    for (i = from; i < to; ++i) {
        estimator_motion motion;
        estimator_forces applied;

        memcpy(&motion, motions[i], sizeof motion);
        memcpy(&applied, forces[i], sizeof applied);
        (void)estimator_base_accumulate(&estimator, &motion, &applied, NULL);
    }
}

__attribute__((noinline)) static void take_in_all(void)
{
    take_in(0, SAMPLES);
}

__attribute__((noinline)) static void solve(void)
{
    status = estimator_base_solve(&estimator, &workspace, &estimate);
}

static void say_rank(int samples)
{
    print("rank after ");
    print_number(samples);
    print(samples == 1 ? " sample: " : " samples: ");
    print_number(estimate.rank);
    print(" of ");
    print_number(PARAMETERS);
    print("\n");
}

int main(void)
{
    const float *const found = (const float *)&estimate.parameters;
    float worst = 0.0f;
    int wrong = 0, i;

    estimator_base_estimator_clear(&estimator);
    take_in(0, 1);
    solve();
    say_rank(1);
    wrong |= status != ESTIMATOR_UNDETERMINED;
    estimator_base_estimator_clear(&estimator);
    measure("base_accumulate", take_in_all, SAMPLES);
    measure("base_solve", solve, 1);
    say_rank(SAMPLES);
    wrong |= status != ESTIMATOR_OK;
    for (i = 0; i < PARAMETERS; ++i) {
        const float off = fabsf(found[i] - expected[i]) / fabsf(expected[i]);

        print(estimator_base_parameter_labels[i].name);
        print(" = ");
        print_float(found[i]);
        print(", true ");
        print_float(truth[i]);
        print(", off double precision by ");
        print_float(off);
        print("\n");
        wrong |= !(off <= 1e-2f);
        worst = off > worst ? off : worst;
    }
    print("largest difference from double precision ");
    print_float(worst);
    print("\n");
    return wrong;
}
