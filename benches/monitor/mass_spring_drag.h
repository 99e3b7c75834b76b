/* Eqn 3.24; the drag drifts. */
#define AMPLITUDE 0.3
#define NOISE_VELOCITY 1e-3
#define NOISE_ACCELERATION 2e-2
#define SMALL 0.0
static const double deviation[1] = {0.1};

static void machine(double *parameters)
{
    parameters[0] = 2.0;
    parameters[1] = 30.0;
    parameters[2] = 8.0;
}

static int is_friction(size_t parameter)
{
    return parameter == 2;
}

static void change(double *parameters)
{
    parameters[0] *= uniform() < 0.5 ? 1.1 : 0.9;
}
