/*
 * Reads "skip samples periods sample_time rows" and the parameters of the first run's feed-forward, then for every run by how much
 * its own are larger and so many samples with their reference; prints what follows from the differences of the runs.
 */
#include <stdio.h>
#include "t.h"
#include "shared.h"

static t_run run;
static t_run_reference reference;
static t_run_numerical numerical;
static t_run_workspace workspace;
static t_run_estimate estimate;

int main(void)
{
    unsigned skip, samples, periods, rows, number;
    double sample_time, prior[5], steps[5], row[6];
    t_run_sampling sampling = {0, 1, 0};
    t_run_parameters begin;
    t_run_sample sample;
    t_run_measured at;
    int status, i, place;

    if (scanf("%u %u %u %lf %u", &skip, &samples, &periods, &sample_time, &rows) != 5) {
        return 10;
    }
    if (!read_numbers(prior, 5)) {
        return 11;
    }
    sampling.sample_time = (REAL)sample_time;
    while (scanf("%lf %lf %lf %lf %lf", &steps[0], &steps[1], &steps[2], &steps[3], &steps[4]) == 5) {
        (void)t_run_begin(&run, samples, periods, &sampling, NULL);
        (void)t_run_reference_begin(&reference, samples);
        for (number = 0; number < rows; ++number) {
            if (scanf("%lf,%lf,%lf,%lf,%lf,%lf", &row[0], &row[1], &row[2], &row[3], &row[4], &row[5]) != 6) {
                return 12;
            }
            if (number < skip) {
                continue;
            }
            at.x1 = (REAL)row[4];
            at.x2 = (REAL)row[5];
            (void)t_run_reference_push(&reference, number - skip, &at);
            sample.measured.x1 = (REAL)row[1];
            sample.measured.x2 = (REAL)row[2];
            sample.applied.F = (REAL)row[3];
            (void)t_run_push(&run, number - skip, &sample);
        }
        place = -1;
        for (i = 0; i < 5; ++i) {
            place = steps[i] < 0 || steps[i] > 0 ? i : place;
        }
        status = place < 0 ? (int)t_run_numerical_begin(&numerical, &run, &reference)
                           : (int)t_run_numerical_change(&numerical, (size_t)place, (REAL)steps[place], &run, &reference);
        if (status != 0) {
            return 13;
        }
        if (t_run_numerical_change(&numerical, 5, 1, &run, &reference) != T_RUN_PERTURBATION) {
            return 14;
        }
    }
    set_numbers(&begin, prior, 5);
    status = (int)t_run_numerical_identify(&numerical, &workspace, &begin, &estimate);
    print_found(status, &estimate.parameters, &estimate.deviations, 5);
    print_number(status, estimate.chi_squared);
    print_number(status, estimate.noise.x1);
    return 0;
}
