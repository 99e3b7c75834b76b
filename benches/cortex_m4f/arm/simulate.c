/*
 * Samples of a simulated arm of three joints, in single precision, and the base parameters that the estimator in double precision
 * finds from them: a header for the program on the target. Runs on the machine that compiles it. With an argument the header is Rust.
 */
#include <math.h>
#include <stdio.h>

#include "estimator.h"

enum { SAMPLES = 600 };

/* Amplitudes of the first harmonics of one revolution of 12 s, rad. */
static const double amplitudes[3][5] = {
    {0.5, -0.3, 0.25, 0.1, -0.12},
    {0.35, 0.3, -0.2, 0.15, 0.1},
    {-0.4, 0.35, 0.3, -0.2, 0.12},
};

/* A link of a small arm about the frame of its joint, and the friction of the joint. */
static const estimator_physical machine = {
    .Izz_column = 0.06,
    .m_upper = 3.2, .mx_upper = 0.55, .my_upper = -0.11, .mz_upper = 0.09,
    .Ixx_upper = 0.021, .Ixy_upper = 0.014, .Ixz_upper = -0.012, .Iyy_upper = 0.14, .Iyz_upper = 0.009, .Izz_upper = 0.15,
    .m_fore = 1.7, .mx_fore = 0.24, .my_fore = 0.03, .mz_fore = -0.05,
    .Ixx_fore = 0.012, .Ixy_fore = -0.006, .Ixz_fore = 0.008, .Iyy_fore = 0.052, .Iyz_fore = 0.005, .Izz_fore = 0.049,
    .fv_q1 = 0.35, .fc_q1 = 0.8, .fv_q2 = 0.4, .fc_q2 = 0.9, .fv_q3 = 0.15, .fc_q3 = 0.4,
};

/* Uniform noise of deviation 0.01 N m, the same at every run. */
static double noise(void)
{
    static unsigned long state = 1;

    state = (state * 1103515245UL + 12345UL) & 0x7fffffffUL;
    return ((double)state / 1073741824.0 - 1.0) * 0.01 * sqrt(3.0);
}

/* Numbers in exponential form, as C and Rust both read them. */
static void row(const float *values, int count, int rust)
{
    int i;

    printf(rust ? "    [" : "    {");
    for (i = 0; i < count; ++i) {
        printf("%.8e%s%s", (double)values[i], rust ? "" : "f", i + 1 < count ? ", " : "");
    }
    printf(rust ? "],\n" : "},\n");
}

static void numbers(const double *values, int rust)
{
    int i;

    for (i = 0; i < ESTIMATOR_BASE_PARAMETERS; ++i) {
        printf("%.8e%s, ", values[i], rust ? "" : "f");
    }
}

int main(int count, char **arguments)
{
    static float motions[SAMPLES][9], forces[SAMPLES][3];
    static estimator_base_estimator estimator;
    static estimator_base_workspace workspace;
    static estimator_base_estimate estimate;
    const int rust = count > 1 && arguments[1] != NULL;
    estimator_parameters parameters;
    estimator_base_parameters truth;
    int i, j, k;

    estimator_lump(&machine, &parameters);
    estimator_base(&parameters, &truth);
    estimator_base_estimator_clear(&estimator);
    for (i = 0; i < SAMPLES; ++i) {
        const double w = 6.283185307179586 / 12.0;
        const double t = 12.0 * i / SAMPLES;
        estimator_motion motion;
        estimator_forces force;

        for (j = 0; j < 3; ++j) {
            double value[3] = {0.0, 0.0, 0.0};
            for (k = 1; k <= 5; ++k) {
                const double a = amplitudes[j][k - 1], angle = k * w * t + 0.9 * k * j;
                value[0] += a * sin(angle);
                value[1] += a * k * w * cos(angle);
                value[2] -= a * k * w * k * w * sin(angle);
            }
            for (k = 0; k < 3; ++k) {
                motions[i][3 * j + k] = (float)value[k];
                ((double *)&motion)[3 * j + k] = value[k];
            }
        }
        estimator_inverse_dynamics(&motion, &parameters, &force);
        for (j = 0; j < 3; ++j) {
            forces[i][j] = (float)(((const double *)&force)[j] + noise());
            ((double *)&force)[j] = (double)forces[i][j];
        }
        /* What is estimated from are the samples as they are written down. */
        for (j = 0; j < 9; ++j) {
            ((double *)&motion)[j] = (double)motions[i][j];
        }
        if (estimator_base_accumulate(&estimator, &motion, &force, NULL) != ESTIMATOR_OK) {
            return 1;
        }
    }
    if (estimator_base_solve(&estimator, &workspace, &estimate) != ESTIMATOR_OK) {
        fprintf(stderr, "the motion shows %d of %d directions\n", estimate.rank, ESTIMATOR_BASE_PARAMETERS);
        return 1;
    }
    fprintf(stderr, "double precision: condition %.0f\n", estimate.condition);
    printf(rust ? "pub const SAMPLES: usize = %d;\n" : "#define SAMPLES %d\n", SAMPLES);
    printf(rust ? "pub static MOTIONS: [[f32; 9]; SAMPLES] = [\n" : "static const float motions[SAMPLES][9] = {\n");
    for (i = 0; i < SAMPLES; ++i) {
        row(motions[i], 9, rust);
    }
    printf(rust ? "];\npub static FORCES: [[f32; 3]; SAMPLES] = [\n" : "};\nstatic const float forces[SAMPLES][3] = {\n");
    for (i = 0; i < SAMPLES; ++i) {
        row(forces[i], 3, rust);
    }
    printf(rust ? "];\npub const EXPECTED: [f32; %d] = [" : "};\nstatic const float expected[%d] = {", ESTIMATOR_BASE_PARAMETERS);
    numbers((const double *)&estimate.parameters, rust);
    printf(rust ? "];\npub const TRUTH: [f32; %d] = [" : "};\nstatic const float truth[%d] = {", ESTIMATOR_BASE_PARAMETERS);
    numbers((const double *)&truth, rust);
    printf(rust ? "];\n" : "};\n");
    return 0;
}
