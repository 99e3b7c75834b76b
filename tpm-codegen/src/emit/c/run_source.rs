//! C code of the estimator of a run, before its names and sizes are filled in.
//!
//! Invariant: the method is that of `tpm_core::support` (`run_lines`, `run_workspace`, `run_noise`, `run_estimate`), in the caller's memory.

/// Declarations behind the structures of samples and parameters.
pub(super) const HEADER: &str = "
/* How a function of a run ended. */
typedef enum STATUS {
    /* As asked for. */
    OK,
    /* A period has too few samples for the harmonics, or the run too many. */
    SAMPLES,
    /* A run needs an even number of periods, at least four. */
    PERIODS,
    /* A sample was left out or came twice. */
    MISSED,
    /* A reading or an input is not finite. */
    NOT_FINITE,
    /* An input was at its limit, so that the machine did not get what was asked for. */
    SATURATED,
    /* The run was not played to its end. */
    UNFINISHED,
    /* The equations are not finite along the measured motion, or a prior is not. */
    NOT_EVALUATED,
    /* Nothing stands out of the noise. */
    STILL
} STATUS;

/* How samples are taken. */
typedef struct SAMPLING {
    /* Time between samples, s. */
    REAL sample_time;
    /* 1 when every input is held until the next sample, otherwise 0. */
    int held;
    /* Time from a recorded input to its force beyond the hold, s. */
    REAL delay;
} SAMPLING;

/* The line re cos - im sin of a signal. */
typedef struct PHASOR {
    REAL re;
    REAL im;
} PHASOR;

/*
 * The samples of a run, as the lines of every channel. Line i has the angular frequency i w / 2:
 * those of even i are harmonics, those of odd i are noise under a Hann window.
 */
typedef struct RUN {
    SAMPLING sampling;
    APPLIED limits;
    int limited;
    STATUS status;
    uint32_t samples_per_period;
    uint32_t samples;
    uint32_t count;
    PHASOR period[CHANNELS][LINES];
    PHASOR total[CHANNELS][LINES];
} RUN;

/* The triangular factor of weighted equations. */
typedef struct FACTOR {
    REAL factor[COLUMNS][COLUMNS];
    REAL right[COLUMNS];
    REAL residual;
    REAL rows;
} FACTOR;

/* The memory of its solution. */
typedef struct SOLUTION {
    REAL matrix[COLUMNS][COLUMNS];
    REAL triangle[COLUMNS][COLUMNS];
    REAL right[COLUMNS];
    REAL scale[COLUMNS];
    REAL solution[COLUMNS];
    REAL column[COLUMNS];
    size_t order[COLUMNS];
} SOLUTION;

/* What the factor shows. */
typedef struct SHOWN {
    int shown[COLUMNS];
    int rank;
    REAL residual;
    REAL condition;
} SHOWN;

/* The memory of an update: the caller's, so that nothing here is static. */
typedef struct WORKSPACE {
    PHASOR motion[COORDINATES][LINES];
    PHASOR inputs[INPUTS][LINES];
    PHASOR regressor[ROWS][COLUMNS][LINES];
    PHASOR known[ROWS][LINES];
    PHASOR drive[ROWS][LINES];
    PHASOR gains[ROWS][ENTRIES][LINES];
    REAL felt[ROWS][LINES][COORDINATES];
    REAL left[ROWS][LINES];
    REAL sensors[COORDINATES];
    REAL forces[ROWS];
    int reach;
    REAL prior[COLUMNS];
    REAL theta[COLUMNS];
    FACTOR factor;
    SOLUTION solution;
    SHOWN shown;
} WORKSPACE;
";

/// Lines, sample by sample.
pub(super) const LINES: &str = "
static PHASOR run_phasor(REAL re, REAL im)
{
    PHASOR z;

    z.re = re;
    z.im = im;
    return z;
}

static PHASOR run_times(PHASOR a, PHASOR b)
{
    return run_phasor(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
}

static PHASOR run_scaled(PHASOR a, REAL factor)
{
    return run_phasor(a.re * factor, a.im * factor);
}

static PHASOR run_conjugate(PHASOR a)
{
    return run_phasor(a.re, -a.im);
}

static REAL run_square(PHASOR a)
{
    return a.re * a.re + a.im * a.im;
}

static void run_add(PHASOR *sum, PHASOR a)
{
    sum->re += a.re;
    sum->im += a.im;
}

static void run_subtract(PHASOR *sum, PHASOR a)
{
    sum->re -= a.re;
    sum->im -= a.im;
}

/* e^{j angle} */
static PHASOR run_turn(REAL angle)
{
    return run_phasor(COS(angle), SIN(angle));
}

/* (j w)^order: what a derivative makes of a line of angular frequency w. */
static PHASOR run_derivative(REAL w, int order)
{
    REAL size = ONE;
    int i;

    for (i = 0; i < order; ++i) {
        size *= w;
    }
    switch (order % 4) {
    case 0:
        return run_phasor(size, ZERO);
    case 1:
        return run_phasor(ZERO, size);
    case 2:
        return run_phasor(-size, ZERO);
    default:
        return run_phasor(ZERO, -size);
    }
}

STATUS BEGIN(RUN *run, uint32_t samples_per_period, uint32_t periods, const SAMPLING *sampling,
        const APPLIED *limits)
{
    size_t channel, line;

    run->sampling = *sampling;
    run->limited = limits != NULL;
    if (limits != NULL) {
        run->limits = *limits;
    }
    run->status = OK;
    run->samples_per_period = samples_per_period;
    run->samples = 0;
    run->count = 0;
    for (channel = 0; channel < CHANNELS; ++channel) {
        for (line = 0; line < LINES; ++line) {
            run->period[channel][line] = run->total[channel][line] = run_phasor(ZERO, ZERO);
        }
    }
    if (periods < 4 || periods % 2 != 0) {
        run->status = PERIODS;
    } else if (samples_per_period <= LINES || samples_per_period > UINT32_MAX / periods) {
        run->status = SAMPLES;
    } else {
        run->samples = samples_per_period * periods;
    }
    return run->status;
}

/* The angle of a part of a turn. */
static REAL run_angle(uint32_t number, uint32_t of)
{
    return (REAL)(TURN * (double)number / (double)of);
}

/* Takes in the channels of a sample. */
static STATUS run_take(RUN *run, uint32_t number, const REAL channels[CHANNELS])
{
    REAL weight;
    PHASOR step;
    uint32_t two_periods;
    size_t channel, line;

    if (run->status == OK && number != run->count) {
        run->status = MISSED;
    }
    for (channel = 0; channel < CHANNELS; ++channel) {
        if (run->status == OK && !(FABS(channels[channel]) <= MAX)) {
            run->status = NOT_FINITE;
        }
    }
    if (run->status != OK || run->count >= run->samples) {
        return run->status;
    }
    two_periods = run->samples_per_period > UINT32_MAX / 2 ? UINT32_MAX : 2 * run->samples_per_period;
    weight = ONE - COS(run_angle(number, run->samples));
    step = run_conjugate(run_turn(run_angle(number % two_periods, two_periods)));
    for (channel = 0; channel < CHANNELS; ++channel) {
        PHASOR turned = run_phasor(channels[channel] * weight, ZERO);
        for (line = 0; line < LINES; ++line) {
            run_add(&run->period[channel][line], turned);
            turned = run_times(turned, step);
        }
    }
    ++run->count;
    if (run->count % run->samples_per_period == 0) {
        for (channel = 0; channel < CHANNELS; ++channel) {
            for (line = 0; line < LINES; ++line) {
                run_add(&run->total[channel][line], run->period[channel][line]);
                run->period[channel][line] = run_phasor(ZERO, ZERO);
            }
        }
    }
    return OK;
}

int WHOLE(const RUN *run)
{
    return run->status == OK && run->count >= run->samples;
}

void STOP(RUN *run)
{
    if (run->status == OK) {
        run->status = UNFINISHED;
    }
}
";

/// The rows along the motion.
pub(super) const ALONG: &str = "
/* A signal of harmonics, or a derivative of it, at a point of the period. */
static REAL run_value(const PHASOR lines[LINES], int order, PHASOR turn, REAL w)
{
    PHASOR turned = run_phasor(ONE, ZERO);
    REAL sum = ZERO;
    size_t harmonic;

    for (harmonic = 0; harmonic < LINES / 2; ++harmonic) {
        if (harmonic > 0 || order == 0) {
            const PHASOR derivative = run_derivative(w * (REAL)harmonic, order);
            sum += run_times(run_times(lines[2 * harmonic], turned), derivative).re;
        }
        turned = run_times(turned, turn);
    }
    return sum;
}

/* Adds a share of a mean to the harmonics of a signal. */
static void run_add_harmonics(PHASOR lines[LINES], REAL value, PHASOR turn)
{
    PHASOR turned = run_phasor(value, ZERO);
    size_t harmonic;

    for (harmonic = 0; harmonic < LINES / 2; ++harmonic) {
        run_add(&lines[2 * harmonic], harmonic == 0 ? turned : run_scaled(turned, TWO));
        turned = run_times(turned, run_conjugate(turn));
    }
}

static PHASOR run_point(size_t point)
{
    return run_turn((REAL)(TURN * (double)point / (double)POINTS));
}

static void run_motion_at(const WORKSPACE *workspace, PHASOR turn, REAL w, REAL motion[ENTRIES])
{
    size_t entry;

    for (entry = 0; entry < ENTRIES; ++entry) {
        motion[entry] = run_value(workspace->motion[run_coordinate[entry]], run_order[entry], turn, w);
    }
}

/* Lines of the channels: the coordinates' as they are, the inputs' as they are applied. */
static void run_lines(const RUN *run, WORKSPACE *workspace, REAL w)
{
    const REAL mean = ONE / (REAL)run->samples;
    size_t channel, line;

    for (channel = 0; channel < CHANNELS; ++channel) {
        for (line = 0; line < LINES; ++line) {
            const REAL scale = line == 0 ? mean : mean + mean;
            const PHASOR found = run_scaled(run->total[channel][line], scale);
            if (channel < COORDINATES) {
                workspace->motion[channel][line] = found;
            } else {
                const REAL frequency = w * ((REAL)line / TWO);
                const REAL half = frequency * run->sampling.sample_time / TWO;
                const int held = run->sampling.held && half > ZERO;
                const REAL size = held ? SIN(half) / half : ONE;
                const REAL angle = frequency * run->sampling.delay + (held ? half : ZERO);
                workspace->inputs[channel - COORDINATES][line] =
                        run_times(found, run_scaled(run_turn(-angle), size));
            }
        }
    }
}

/* Harmonics of regressor, known terms and B u along the motion, and halfway lines of B u by the mean of B. */
static STATUS run_evaluate(WORKSPACE *workspace, REAL wCONSTANTS)
{
    const REAL mean = ONE / (REAL)POINTS;
    REAL mean_map[ROWS][INPUTS];
    size_t point, row, column, input, line;

    for (row = 0; row < ROWS; ++row) {
        for (line = 0; line < LINES; ++line) {
            workspace->known[row][line] = workspace->drive[row][line] = run_phasor(ZERO, ZERO);
            for (column = 0; column < COLUMNS; ++column) {
                workspace->regressor[row][column][line] = run_phasor(ZERO, ZERO);
            }
        }
        for (input = 0; input < INPUTS; ++input) {
            mean_map[row][input] = ZERO;
        }
    }
    for (point = 0; point < POINTS; ++point) {
        const PHASOR turn = run_point(point);
        REAL motion[ENTRIES];
        REAL regressor[ROWS][COLUMNS];
        REAL known[ROWS];
        REAL map[ROWS][INPUTS];
        REAL forces[INPUTS];

        run_motion_at(workspace, turn, w, motion);
        run_rows(motion, regressor, known, mapARGUMENT);
        for (input = 0; input < INPUTS; ++input) {
            forces[input] = run_value(workspace->inputs[input], 0, turn, w);
        }
        for (row = 0; row < ROWS; ++row) {
            REAL drive = ZERO;
            for (input = 0; input < INPUTS; ++input) {
                drive += map[row][input] * forces[input];
                mean_map[row][input] += map[row][input] * mean;
            }
            if (!(FABS(drive) <= MAX) || !(FABS(known[row]) <= MAX)) {
                return NOT_EVALUATED;
            }
            for (column = 0; column < COLUMNS; ++column) {
                if (!(FABS(regressor[row][column]) <= MAX)) {
                    return NOT_EVALUATED;
                }
                run_add_harmonics(workspace->regressor[row][column], regressor[row][column] * mean, turn);
            }
            run_add_harmonics(workspace->known[row], known[row] * mean, turn);
            run_add_harmonics(workspace->drive[row], drive * mean, turn);
        }
    }
    for (row = 0; row < ROWS; ++row) {
        for (input = 0; input < INPUTS; ++input) {
            for (line = 1; line < LINES; line += 2) {
                run_add(&workspace->drive[row][line],
                        run_scaled(workspace->inputs[input][line], mean_map[row][input]));
            }
        }
    }
    return OK;
}

/* Lines of the rows' derivatives along the motion at the present parameters. */
static void run_differentiate(WORKSPACE *workspace, REAL wCONSTANTS)
{
    const REAL mean = ONE / (REAL)POINTS;
    REAL steps[ENTRIES];
    size_t point, entry, row, column, line, side;

    for (entry = 0; entry < ENTRIES; ++entry) {
        REAL square = ZERO;
        for (line = 0; line < LINES; line += 2) {
            const PHASOR derivative = run_derivative(w * (REAL)(line / 2), run_order[entry]);
            square += run_square(run_times(workspace->motion[run_coordinate[entry]][line], derivative));
        }
        steps[entry] = square > ZERO ? SQRT(square) * STEP : STEP;
        for (row = 0; row < ROWS; ++row) {
            for (line = 0; line < LINES; ++line) {
                workspace->gains[row][entry][line] = run_phasor(ZERO, ZERO);
            }
        }
    }
    for (point = 0; point < POINTS; ++point) {
        const PHASOR turn = run_point(point);
        REAL motion[ENTRIES];
        run_motion_at(workspace, turn, w, motion);
        for (entry = 0; entry < ENTRIES; ++entry) {
            REAL sides[2][ROWS];
            for (side = 0; side < 2; ++side) {
                REAL regressor[ROWS][COLUMNS];
                REAL known[ROWS];
                REAL map[ROWS][INPUTS];
                const REAL centre = motion[entry];
                motion[entry] += side == 0 ? steps[entry] : -steps[entry];
                run_rows(motion, regressor, known, mapARGUMENT);
                motion[entry] = centre;
                for (row = 0; row < ROWS; ++row) {
                    sides[side][row] = known[row];
                    for (column = 0; column < COLUMNS; ++column) {
                        sides[side][row] += regressor[row][column] * workspace->theta[column];
                    }
                }
            }
            for (row = 0; row < ROWS; ++row) {
                const REAL slope = (sides[0][row] - sides[1][row]) / (steps[entry] + steps[entry]);
                PHASOR turned = run_phasor(slope * mean, ZERO);
                for (line = 0; line < LINES; ++line) {
                    run_add(&workspace->gains[row][entry][line], turned);
                    turned = run_times(turned, run_conjugate(turn));
                }
            }
        }
    }
    workspace->reach = 0;
    for (row = 0; row < ROWS; ++row) {
        for (entry = 0; entry < ENTRIES; ++entry) {
            REAL peak = ZERO;
            for (line = 0; line < LINES; ++line) {
                const REAL square = run_square(workspace->gains[row][entry][line]);
                peak = square > peak ? square : peak;
            }
            for (line = 1; line < LINES; ++line) {
                if (run_square(workspace->gains[row][entry][line]) > MIXING * peak
                        && (int)line > workspace->reach) {
                    workspace->reach = (int)line;
                }
            }
        }
    }
}
";
