//! C code of the samples of a run, before its names and sizes are filled in.
//!
//! Invariant: the method is that of `tpm_controller::support` (`run_lines`), in the caller's memory.

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
    STILL,
    /* No physical parameters near the given ones agree with what the run shows. */
    APART,
    /* A changed parameter does not exist, its step is zero or not finite, or there is no run to compare it with. */
    PERTURBATION
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
 * those of even i are harmonics, those of odd i are noise, under a window that rises over two periods
 * and falls over two.
 */
typedef struct RUN {
    SAMPLING sampling;
    APPLIED limits;
    int limited;
    STATUS status;
    uint32_t samples_per_period;
    uint32_t samples;
    uint32_t count;
    /* Samples of a part of the run: the root of all, with which rounding grows then. */
    uint32_t part_samples;
    /* States of the filter that passes what the inputs hold above the lines, its first frequency, and sums of products of what has passed. */
    REAL states[INPUTS][4];
    REAL bend;
    REAL products[INPUTS][INPUTS];
    PHASOR part[CHANNELS][LINES];
    PHASOR total[CHANNELS][LINES];
    /* What rounding has added to the total so far. */
    PHASOR excess[CHANNELS][LINES];
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
    PATH_FIELDS
    PHASOR inputs[INPUTS][LINES];
    /* The mean input map. */
    REAL map[ROWS][INPUTS];
    PHASOR regressor[ROWS][COLUMNS][LINES];
    PHASOR known[ROWS][LINES];
    PHASOR drive[ROWS][LINES];
    PHASOR rest[ROWS][LINES];
    PHASOR gains[ROWS][ENTRIES][LINES];
    REAL felt[ROWS][LINES][COORDINATES];
    REAL left[ROWS][LINES];
    REAL slopes[ROWS][COLUMNS][ENTRIES];
    int stands[COLUMNS];
    REAL sensors[COORDINATES];
    REAL forces[ROWS];
    /* 1 when a force disturbs the rows beside what the noise of the sensors makes of them. */
    int disturbed;
    /*
     * 1 when it is known what motion that noise makes adds to the means of the regressor and takes of what the rows leave; the covariance of
     * that motion, and how far it is uncertain, as a share of it.
     */
    int shifts;
    REAL doubt;
    REAL covariance[ENTRIES][ENTRIES];
    REAL shift[ROWS][COLUMNS];
    REAL shifted[ROWS];
    int reach;
    REAL prior[COLUMNS];
    REAL theta[COLUMNS];
    /* The parameters from which the steps of the equations count. */
    REAL about[COLUMNS];
    FACTOR factor;
    SOLUTION solution;
    SHOWN shown;
    /* Harmonic, row and part of the equations that count, their coefficients and right sides. */
    uint16_t places[ALL][3];
    REAL rows[ALL][COLUMNS];
    REAL right[ALL];
    size_t count;
    /* What noise is multiplied by in every equation. */
    REAL by[ALL][2];
    /* Covariance of the equations, then its Cholesky factor: the lower triangle, row by row. */
    REAL noise[COVARIANCES];
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

PASSED_SOURCE
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
    run->part_samples = 1;
    run->count = 0;
    for (channel = 0; channel < CHANNELS; ++channel) {
        for (line = 0; line < LINES; ++line) {
            run->part[channel][line] = run->total[channel][line] = run->excess[channel][line] = run_phasor(ZERO, ZERO);
        }
    }
    if (periods < 4 || periods % 2 != 0) {
        run->status = PERIODS;
    } else if (samples_per_period <= LINES || samples_per_period > UINT32_MAX / periods) {
        run->status = SAMPLES;
    } else {
        run->samples = samples_per_period * periods;
        run->part_samples = (uint32_t)SQRT((REAL)run->samples);
    }
    run_begin_passed(run);
    return run->status;
}

/* The angle of a part of a turn. */
static REAL run_angle(uint32_t number, uint32_t of)
{
    return (REAL)(TURN * (double)number / (double)of);
}

/* The variance of white noise in the samples of a channel over that of its lines. */
static REAL run_samples_behind_line(const RUN *run)
{
    const REAL flat = (REAL)(run->samples / run->samples_per_period - 2);

    return (REAL)run->samples_per_period * flat * flat / (FOUR * (flat - ONE / TWO));
}

/* Takes in the channels of a sample. */
static STATUS run_take(RUN *run, uint32_t number, const REAL channels[CHANNELS])
{
    REAL weight = ONE;
    PHASOR step;
    uint32_t two_periods, edge;
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
    run_pass(run, channels);
    two_periods = run->samples_per_period > UINT32_MAX / 2 ? UINT32_MAX : 2 * run->samples_per_period;
    edge = number < run->samples - number ? number : run->samples - number;
    if (edge < two_periods) {
        weight = (ONE - COS(run_angle(edge, 2 * two_periods))) / TWO;
    }
    step = run_conjugate(run_turn(run_angle(number % two_periods, two_periods)));
    for (channel = 0; channel < CHANNELS; ++channel) {
        PHASOR turned = run_phasor(channels[channel] * weight, ZERO);
        for (line = 0; line < LINES; ++line) {
            run_add(&run->part[channel][line], turned);
            turned = run_times(turned, step);
        }
    }
    ++run->count;
    if (run->count % run->part_samples == 0 || run->count == run->samples) {
        for (channel = 0; channel < CHANNELS; ++channel) {
            for (line = 0; line < LINES; ++line) {
                /* Kahan: single precision keeps the noise of a line, which is far below the line itself. */
                const PHASOR before = run->total[channel][line];
                PHASOR added = run->part[channel][line];
                run_subtract(&added, run->excess[channel][line]);
                run_add(&run->total[channel][line], added);
                run->excess[channel][line] = run->total[channel][line];
                run_subtract(&run->excess[channel][line], before);
                run_subtract(&run->excess[channel][line], added);
                run->part[channel][line] = run_phasor(ZERO, ZERO);
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
