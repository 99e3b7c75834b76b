/* One of the functions, many times: `main hand|sympy|casadi|tpm|tpm-two-calls CALLS`; prints nanoseconds a call and a checksum. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "closed_loop_arm.h"
#include "peers.h"

int casadi_arm(const double **arg, double **res, long long *iw, double *w, int mem);

static double motion[6] = {0.1, 5.3, -0.4, 0.6, 1.2, -0.8};
static double theta[9] = {2375.0, 891.0, 149.0, 209.0, 171.0, -225.0, -965.0, -807.0, 337.0};
static double constants[2] = {0.0, 5.42161682};
static double tau[2], phi[18];

#define KEEP __asm__ volatile("" ::: "memory")

int main(int count, char **words)
{
    const char *const kind = count > 1 ? words[1] : "";
    const long calls = count > 2 ? atol(words[2]) : 0;
    const double *arg[3] = {motion, theta, constants};
    double *res[2] = {tau, phi};
    closed_loop_arm_motion at;
    closed_loop_arm_parameters parameters;
    closed_loop_arm_constants fixed;
    closed_loop_arm_inputs inputs;
    double matrix[2][9];
    double sum = 0.0;
    struct timespec from, to;
    long i;

    at.th1.value = motion[0];
    at.th2.value = motion[1];
    at.th1.dot = motion[2];
    at.th2.dot = motion[3];
    at.th1.ddot = motion[4];
    at.th2.ddot = motion[5];
    memcpy(&parameters, theta, sizeof parameters);
    memcpy(&fixed, constants, sizeof fixed);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &from);
    if (strcmp(kind, "hand") == 0) {
        for (i = 0; i < calls; ++i) {
            hand_arm(motion, theta, constants, tau, phi);
            KEEP;
        }
    } else if (strcmp(kind, "sympy") == 0) {
        for (i = 0; i < calls; ++i) {
            sympy_arm(motion, theta, constants, tau, phi);
            KEEP;
        }
    } else if (strcmp(kind, "casadi") == 0) {
        for (i = 0; i < calls; ++i) {
            casadi_arm(arg, res, NULL, NULL, 0);
            KEEP;
        }
    } else if (strcmp(kind, "tpm") == 0) {
        for (i = 0; i < calls; ++i) {
            closed_loop_arm_feed_forward_with_regressor(&at, &parameters, &fixed, &inputs, matrix);
            KEEP;
        }
    } else if (strcmp(kind, "tpm-two-calls") == 0) {
        for (i = 0; i < calls; ++i) {
            closed_loop_arm_feed_forward(&at, &parameters, &fixed, &inputs);
            closed_loop_arm_regressor(&at, &fixed, matrix);
            KEEP;
        }
    } else {
        return 2;
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &to);
    if (strncmp(kind, "tpm", 3) == 0) {
        tau[0] = inputs.tau1;
        tau[1] = inputs.tau2;
        memcpy(phi, matrix, sizeof phi);
    }
    for (i = 0; i < 20; ++i) {
        sum += (double)(i + 1) * (i < 2 ? tau[i] : phi[i - 2]);
    }
    printf("%.3f %.10g\n", ((double)(to.tv_sec - from.tv_sec) * 1e9 + (double)(to.tv_nsec - from.tv_nsec)) / (double)calls,
           sum);
    return 0;
}
