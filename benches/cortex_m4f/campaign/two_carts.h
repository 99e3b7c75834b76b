/* Feng, Eqns 4.30 to 4.34, with the noise, the gains and the limits of its shipped experiment. */
#define COORDINATES 2
#define INPUTS 1
#define PARAMETERS 5
#define NOISE 1e-4
#define FILTER 2e-3
#define PERIODS 10
#define CONSTANTS

static const double truth[PARAMETERS] = {2.0, 1.0, 40.0, 300.0, 200.0};
static const estimator_run_parameters prior = {3.0f, 0.5f, 60.0f, 150.0f, 300.0f};
static const estimator_run_stage stages[] = {{{0.2f, 0}, 2094}, {{0.4f, 0}, 1571}};
static const estimator_run_limits limits = {{400.0f}, {0.5f, 0.5f}};
static const double proportional[INPUTS][COORDINATES] = {{400.0, 0.0}};
static const double derivative[INPUTS][COORDINATES] = {{40.0, 0.0}};
static const double rest[COORDINATES] = {0.0, 0.0};

static void accelerations(const double x[], const double v[], const double force[], double a[])
{
    const double spring = truth[4] * (x[0] - x[1]);

    (void)v;
    a[0] = (force[0] - truth[2] * x[0] - truth[3] * x[0] * x[0] * x[0] - spring) / truth[0];
    a[1] = spring / truth[1];
}
