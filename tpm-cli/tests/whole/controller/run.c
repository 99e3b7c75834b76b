/* Reads "skip samples periods sample_time", priors, then samples; prints what the estimator of a run finds. */
#include <stdio.h>
#include "t.h"
#include "shared.h"

static t_run run;
static t_run_workspace workspace;
static t_run_estimate estimate;

int main(void)
{
    unsigned skip, samples, periods, number = 0;
    double sample_time, prior[5], row[4];
    t_run_sampling sampling = {0, 1, 0};
    const t_run_applied limits = {400};
    t_run_parameters begin;
    t_run_sample sample;
    int status;

    if (scanf("%u %u %u %lf", &skip, &samples, &periods, &sample_time) != 4) {
        return 10;
    }
    if (!read_numbers(prior, 5)) {
        return 11;
    }
    sampling.sample_time = (REAL)sample_time;
    status = (int)t_run_begin(&run, samples, periods, &sampling, &limits);
    while (scanf("%lf,%lf,%lf,%lf", &row[0], &row[1], &row[2], &row[3]) == 4) {
        if (number++ < skip || t_run_is_whole(&run)) {
            continue;
        }
        sample.measured.x1 = (REAL)row[1];
        sample.measured.x2 = (REAL)row[2];
        sample.applied.F = (REAL)row[3];
        /* A sample that was left out shows in the time. */
        status = (int)t_run_push(&run, (unsigned)(row[0] / sample_time + 0.5) - skip, &sample);
    }
    set_numbers(&begin, prior, 5);
    status = (int)t_run_identify(&run, &workspace, &begin, &estimate);
    print_found(status, &estimate.parameters, &estimate.deviations, 5);
    print_number(status, estimate.chi_squared);
    print_number(status, estimate.noise.x1);
    return 0;
}
