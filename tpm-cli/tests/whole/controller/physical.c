/*
 * Reads "skip samples periods sample_time", the priors of M, m and L, then samples; prints the physical parameters that follow
 * from a run of the cart-pendulum with their deviations.
 */
#include <stdio.h>
#include "t.h"
#include "shared.h"

static t_run run;
static t_run_workspace workspace;
static t_run_physical_workspace own;
static t_run_estimate estimate;
static t_run_physical_estimate found;

int main(void)
{
    unsigned skip, samples, periods, number = 0;
    double sample_time, prior[3], row[5];
    t_run_sampling sampling = {0, 1, 0};
    t_run_parameters begin;
    t_run_physical physical;
    t_run_sample sample;
    int status;

    if (scanf("%u %u %u %lf", &skip, &samples, &periods, &sample_time) != 4) {
        return 10;
    }
    if (!read_numbers(prior, 3)) {
        return 11;
    }
    sampling.sample_time = (REAL)sample_time;
    status = (int)t_run_begin(&run, samples, periods, &sampling, NULL);
    while (scanf("%lf,%lf,%lf,%lf,%lf", &row[0], &row[1], &row[2], &row[3], &row[4]) == 5) {
        if (number++ < skip || t_run_is_whole(&run)) {
            continue;
        }
        sample.measured.x = (REAL)row[1];
        sample.measured.theta = (REAL)row[2];
        sample.applied.F = (REAL)row[3];
        sample.applied.tau = (REAL)row[4];
        status = (int)t_run_push(&run, number - 1 - skip, &sample);
    }
    set_numbers(&physical, prior, 3);
    ((REAL *)&begin)[0] = physical.M + physical.m;
    ((REAL *)&begin)[1] = physical.m * physical.L;
    ((REAL *)&begin)[2] = physical.m * physical.L * physical.L;
    status = (int)t_run_identify(&run, &workspace, &begin, &estimate);
    if (status == 0) {
        status = (int)t_run_identify_physical(&workspace, &own, &physical, &found);
    }
    print_found(status, &found.parameters, &found.deviations, 3);
    print_number(status, found.chi_squared);
    return 0;
}
