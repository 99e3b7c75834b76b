/* Feng, Eqn 3.24 on the controller: the estimator finds m, k1 and k2 of a machine whose forces stand in a table. */
#include <math.h>
#include <stdint.h>

#include "estimator.h"
#include "machine.h"
#include "samples.h"

#define PAINT 0xa5a5a5a5U

extern uint32_t stack_top, end;

static const estimator_pattern pattern = {0.3f, 3.0f};
static const estimator_parameters guess = {1.5f, 30.0f, 1.0f};
static estimator_accumulator sums;
static estimator_workspace workspace;
static estimator_estimate estimate;
static estimator_harmonics harmonics;
static estimator_motion motion;
static estimator_inputs inputs;

static float phase_of(int i)
{
    return 6.28318531f * (float)i / (float)SAMPLES;
}

static void paint(void)
{
    uint32_t *word = &end;
    uint32_t *const here = __builtin_frame_address(0);

    while (word < here - 8) {
        *word++ = PAINT;
    }
}

/* Bytes of the stack that were in use since the last painting. */
static long used(void)
{
    const uint32_t *word = &end;

    while (*word == PAINT) {
        ++word;
    }
    return 4 * (long)((uint32_t *)__builtin_frame_address(0) - word);
}

__attribute__((noinline)) static void take_in(void)
{
    int i;

    estimator_accumulator_clear(&sums);
    for (i = 0; i < SAMPLES; ++i) {
        estimator_accumulate(&sums, phase_of(i), &samples[i]);
    }
}

__attribute__((noinline)) static void references(void)
{
    int i;

    for (i = 0; i < SAMPLES; ++i) {
        estimator_reference_at(&pattern, phase_of(i), &motion);
    }
}

__attribute__((noinline)) static void feed_forwards(void)
{
    int i;

    for (i = 0; i < SAMPLES; ++i) {
        estimator_feed_forward(&motion, &guess, &inputs);
    }
}

__attribute__((noinline)) static void take_in_at(void)
{
    int i;

    for (i = 0; i < SAMPLES; ++i) {
        estimator_accumulate_at(&sums, 0.6f, 0.8f, &samples[i]);
    }
}

static void measure(const char *name, void (*what)(void), long calls)
{
    long instructions, stack;

    paint();
    clock_start();
    what();
    instructions = clock_instructions();
    stack = used();
    print(name);
    print(": ");
    print_number((instructions + calls / 2) / calls);
    print(" instructions, ");
    print_number(stack);
    print(" bytes of stack\n");
}

static estimator_status status;

__attribute__((noinline)) static void identify(void)
{
    status = estimator_identify(&pattern, &harmonics, 0, &workspace, &estimate);
}

__attribute__((noinline)) static void identify_directly(void)
{
    int i;

    for (i = 0; i < SAMPLES; ++i) {
        estimator_identify_direct(&pattern, &harmonics, &estimate.parameters);
    }
}

static int check(const char *name, float found, float truth)
{
    print(name);
    print(" = ");
    print_number((long)(found * 1e6f));
    print("e-6\n");
    return !(fabsf(found - truth) <= 1e-4f * truth);
}

int main(void)
{
    int wrong;

    measure("reference_at", references, SAMPLES);
    measure("feed_forward", feed_forwards, SAMPLES);
    measure("accumulate_at", take_in_at, SAMPLES);
    measure("accumulate", take_in, SAMPLES);
    if (estimator_accumulated(&sums, &harmonics) != ESTIMATOR_OK) {
        return 1;
    }
    measure("identify_direct", identify_directly, SAMPLES);
    wrong = check("m", estimate.parameters.m, 2.0f);
    wrong |= check("k1", estimate.parameters.k1, 40.0f);
    wrong |= check("k2", estimate.parameters.k2, 1.5f);
    measure("identify", identify, 1);
    wrong |= status != ESTIMATOR_OK || estimate.rank != 3;
    wrong |= check("m", estimate.parameters.m, 2.0f);
    wrong |= check("k1", estimate.parameters.k1, 40.0f);
    wrong |= check("k2", estimate.parameters.k2, 1.5f);
    return wrong;
}
