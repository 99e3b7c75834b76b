/* An arm of three joints; viscous and dry friction of all of them drift. The fore arm changes its density, as with a load along it. */
#define AMPLITUDE 1.2
#define NOISE_VELOCITY 1e-3
#define NOISE_ACCELERATION 2e-2
/* What is small beside the largest of its kind is asked for no more exactly than this. */
#define SMALL 0.05
static const double deviation[3] = {0.3, 0.3, 0.15};

static double value_of(const char *name)
{
    static const struct { const char *name; double value; } known[] = {
        {"Izz_column", 0.15}, {"mx_upper", 0.7}, {"mz_upper", 0.08}, {"Ixx_upper", 0.02}, {"Ixz_upper", -0.01},
        {"Iyy_upper", 0.18}, {"Izz_upper", 0.18}, {"m_fore", 2.5}, {"mx_fore", 0.45}, {"my_fore", 0.01},
        {"mz_fore", 0.03}, {"Ixx_fore", 0.012}, {"Ixy_fore", -0.002}, {"Ixz_fore", -0.005}, {"Iyy_fore", 0.11},
        {"Iyz_fore", 0.001}, {"Izz_fore", 0.11}, {"fv_q1", 1.0}, {"fc_q1", 1.2}, {"fv_q2", 1.2}, {"fc_q2", 1.5},
        {"fv_q3", 0.5}, {"fc_q3", 0.6}};
    size_t i;

    for (i = 0; i < sizeof known / sizeof known[0]; ++i) {
        if (strcmp(known[i].name, name) == 0) return known[i].value;
    }
    return strncmp(name, "m_upper", 7) == 0 ? 4.0 : 0.0;
}

static void machine(double *parameters)
{
    size_t i;

    for (i = 0; i < ESTIMATOR_PARAMETERS; ++i) parameters[i] = value_of(estimator_parameter_labels[i].name);
}

static int is_friction(size_t parameter)
{
    const char *const name = estimator_parameter_labels[parameter].name;
    return name[0] == 'f' && (name[1] == 'v' || name[1] == 'c');
}

static void change(double *parameters)
{
    const double factor = uniform() < 0.5 ? 1.1 : 0.9;
    size_t i;

    for (i = 0; i < ESTIMATOR_PARAMETERS; ++i) {
        if (strstr(estimator_parameter_labels[i].name, "_fore") != NULL) parameters[i] *= factor;
    }
}
