/* One of the functions, many times: `main hand|generated parts|split CALLS`; prints nanoseconds a call and a checksum. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cart_pendulum.h"
#include "hand.h"

static double motion[6] = {0.1, 0.3, -0.4, 0.6, 1.2, -0.8};
static double theta[3] = {11.0, 0.4, 0.16};
static hand_filters by_hand;
static cart_pendulum_split_filters generated;

#define KEEP __asm__ volatile("" ::: "memory")

int main(int count, char **words)
{
    const int is_hand = count > 1 && strcmp(words[1], "hand") == 0;
    const int is_split = count > 2 && strcmp(words[2], "split") == 0;
    const long calls = count > 3 ? atol(words[3]) : 0;
    const cart_pendulum_parameters parameters = {theta[0], theta[1], theta[2]};
    cart_pendulum_motion at;
    cart_pendulum_inputs inputs = {0.0, 0.0}, reaction = {0.0, 0.0}, moving = {0.0, 0.0};
    double independent[2] = {0.0, 0.0}, dependent[2] = {0.0, 0.0}, forces[2] = {0.0, 0.0};
    double sum;
    struct timespec from, to;
    long i;

    at.x.value = motion[0];
    at.theta.value = motion[1];
    at.x.dot = motion[2];
    at.theta.dot = motion[3];
    at.x.ddot = motion[4];
    at.theta.ddot = motion[5];
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &from);
    if (is_hand && is_split) {
        for (i = 0; i < calls; ++i) {
            hand_split(&by_hand, motion, theta, forces);
            KEEP;
        }
    } else if (is_hand) {
        for (i = 0; i < calls; ++i) {
            hand_parts(motion, theta, independent, dependent);
            KEEP;
        }
    } else if (is_split) {
        for (i = 0; i < calls; ++i) {
            cart_pendulum_split_feed_forward(&generated, &at, &parameters, &inputs);
            KEEP;
        }
    } else {
        for (i = 0; i < calls; ++i) {
            cart_pendulum_feed_forward_independent(&at, &parameters, &reaction);
            cart_pendulum_feed_forward_dependent(&at, &parameters, &moving);
            KEEP;
        }
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &to);
    sum = independent[0] + 2.0 * independent[1] + 3.0 * dependent[0] + 4.0 * dependent[1] + forces[0] + 2.0 * forces[1];
    sum += reaction.F + 2.0 * reaction.tau + 3.0 * moving.F + 4.0 * moving.tau + inputs.F + 2.0 * inputs.tau;
    printf("%.3f %.10g\n", ((double)(to.tv_sec - from.tv_sec) * 1e9 + (double)(to.tv_nsec - from.tv_nsec)) / (double)calls,
           sum);
    return 0;
}
