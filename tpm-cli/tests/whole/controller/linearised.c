/*
 * Reads "skip samples periods sample_time", the parameters of the feed-forward, then samples with their reference; prints what
 * the estimator that the second argument names (error or hill) finds.
 */
#include <stdio.h>
#include <string.h>
#include "t.h"
#include "shared.h"

static t_run run;
static t_run_reference reference;
static t_run_workspace workspace;
static t_run_estimate estimate;

int main(int count, char **words)
{
    unsigned skip, samples, periods, number = 0;
    double sample_time, prior[5], row[6];
    t_run_sampling sampling = {0, 1, 0};
    t_run_parameters begin;
    t_run_sample sample;
    t_run_measured at;
    t_run_linearisation which = count > 2 && strcmp(words[2], "error") == 0 ? T_RUN_ERROR : T_RUN_HILL;
    int status;

    if (scanf("%u %u %u %lf", &skip, &samples, &periods, &sample_time) != 4) {
        return 10;
    }
    if (!read_numbers(prior, 5)) {
        return 11;
    }
    sampling.sample_time = (REAL)sample_time;
    status = (int)t_run_begin(&run, samples, periods, &sampling, NULL);
    (void)t_run_reference_begin(&reference, samples);
    while (scanf("%lf,%lf,%lf,%lf,%lf,%lf", &row[0], &row[1], &row[2], &row[3], &row[4], &row[5]) == 6) {
        if (number++ < skip || t_run_is_whole(&run)) {
            continue;
        }
        at.x1 = (REAL)row[4];
        at.x2 = (REAL)row[5];
        (void)t_run_reference_push(&reference, number - 1 - skip, &at);
        sample.measured.x1 = (REAL)row[1];
        sample.measured.x2 = (REAL)row[2];
        sample.applied.F = (REAL)row[3];
        status = (int)t_run_push(&run, number - 1 - skip, &sample);
    }
    set_numbers(&begin, prior, 5);
    status = (int)t_run_identify_about(&run, &workspace, &reference, which, &begin, &estimate);
    print_found(status, &estimate.parameters, &estimate.deviations, 5);
    print_number(status, estimate.chi_squared);
    print_number(status, estimate.noise.x1);
    return 0;
}
