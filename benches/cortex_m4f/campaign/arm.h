/*
 * Feng, Eqns 5.1 to 5.7, rig 1, the first joint on 3 w and the second on 2 w, with the noise, the gains and the limits of the shipped
 * experiment.
 */
#define COORDINATES 2
#define INPUTS 2
#define PARAMETERS 9
#define NOISE 2e-4
#define FILTER 5e-3
#define PERIODS 6
#define CONSTANTS , &constants

static const estimator_constants constants = {0.0f, 5.42161682f};
static const double truth[PARAMETERS] = {2375.0, 891.0, 149.0, 209.0, 171.0, -225.0, -965.0, -807.0, 337.0};
static const estimator_run_parameters prior = {2281.0f, 1003.0f, 0.0f, 229.0f, 109.0f, 0.0f, -1067.0f, -474.0f, 0.0f};
static const estimator_run_stage stages[] = {
    {{-0.245393293f, 0.199491133f, 0}, 5712}, {{-0.245393293f, 0.199491133f, 0}, 4488}};
static const estimator_run_limits limits = {{1e9f, 1e9f}, {0.2f, 0.2f}};
static const double proportional[INPUTS][COORDINATES] = {{373511.0, 0.0}, {0.0, 242762.0}};
static const double derivative[INPUTS][COORDINATES] = {{42000.0, 0.0}, {0.0, 10000.0}};
static const double rest[COORDINATES] = {0.0, 5.42161682};

/* A coefficient of the torques, or its slope. */
static double value(const double a[], double s)
{
    return a[0] + (a[1] + a[2] * s) * s;
}

static double slope(const double a[], double s)
{
    return a[1] + 2.0 * a[2] * s;
}

static void accelerations(const double x[], const double v[], const double torque[], double a[])
{
    const double *const a1 = truth, *const a2 = truth + 3, *const a3 = truth + 6;
    const double s = x[1] - rest[1];
    const double m11 = 2.0 * value(a1, s), m12 = value(a3, s), m22 = 2.0 * value(a2, s);
    const double first = torque[0] - 2.0 * slope(a1, s) * v[0] * v[1] - slope(a3, s) * v[1] * v[1];
    const double second = torque[1] + slope(a1, s) * v[0] * v[0] - slope(a2, s) * v[1] * v[1];
    const double determinant = m11 * m22 - m12 * m12;

    a[0] = (m22 * first - m12 * second) / determinant;
    a[1] = (m11 * second - m12 * first) / determinant;
}
