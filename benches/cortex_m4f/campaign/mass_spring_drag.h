/* Feng, Eqn 3.24, with the noise, the gains and the limits of its shipped experiment. */
#define COORDINATES 1
#define INPUTS 1
#define PARAMETERS 3
#define NOISE 1e-3
#define FILTER 2e-3
#define PERIODS 10
#define CONSTANTS

static const double truth[PARAMETERS] = {2.0, 40.0, 1.5};
static const estimator_run_parameters prior = {3.0f, 20.0f, 0.75f};
static const estimator_run_stage stages[] = {{{0.3f, 0}, 1600}, {{0.45f, 0}, 1250}};
static const estimator_run_limits limits = {{800.0f}, {0.2f}};
static const double proportional[INPUTS][COORDINATES] = {{2000.0}};
static const double derivative[INPUTS][COORDINATES] = {{120.0}};
static const double rest[COORDINATES] = {0.0};

static void accelerations(const double x[], const double v[], const double force[], double a[])
{
    a[0] = (force[0] - truth[1] * x[0] - truth[2] * v[0] * v[0]) / truth[0];
}
