//! C code of the rows of a run along its measured motion, before names and sizes are filled in.
//!
//! Invariant: the method is that of `tpm_controller::support` (`run_workspace`), in the caller's memory.

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

/* The entries of the motion that these lines give at a point of the period. */
static void run_motion_at(PHASOR lines[COORDINATES][LINES], PHASOR turn, REAL w, REAL motion[ENTRIES])
{
    size_t entry;

    for (entry = 0; entry < ENTRIES; ++entry) {
        motion[entry] = run_value(lines[run_coordinate[entry]], run_order[entry], turn, w);
    }
}

/* Lines of the channels: the coordinates' as they are, the inputs' as they are applied. */
static void run_lines(const RUN *run, WORKSPACE *workspace, REAL w)
{
    const REAL mean = ONE / (REAL)(run->samples - 2 * run->samples_per_period);
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
    size_t point, row, column, input, line;

    for (row = 0; row < ROWS; ++row) {
        for (line = 0; line < LINES; ++line) {
            workspace->known[row][line] = workspace->drive[row][line] = run_phasor(ZERO, ZERO);
            for (column = 0; column < COLUMNS; ++column) {
                workspace->regressor[row][column][line] = run_phasor(ZERO, ZERO);
            }
        }
        for (input = 0; input < INPUTS; ++input) {
            workspace->map[row][input] = ZERO;
        }
    }
    for (point = 0; point < POINTS; ++point) {
        const PHASOR turn = run_point(point);
        REAL motion[ENTRIES];
        REAL regressor[ROWS][COLUMNS];
        REAL known[ROWS];
        REAL map[ROWS][INPUTS];
        REAL forces[INPUTS];

        run_motion_at(workspace->PATH, turn, w, motion);
        run_rows(motion, regressor, known, mapARGUMENT);
        for (input = 0; input < INPUTS; ++input) {
            forces[input] = run_value(workspace->inputs[input], 0, turn, w);
        }
        for (row = 0; row < ROWS; ++row) {
            REAL drive = ZERO;
            for (input = 0; input < INPUTS; ++input) {
                drive += map[row][input] * forces[input];
                workspace->map[row][input] += map[row][input] * mean;
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
                        run_scaled(workspace->inputs[input][line], workspace->map[row][input]));
            }
        }
    }
    return OK;
}

/* Adds what the rows leave at a point: taken before the harmonics, it is small, and rounding with it. */
static void run_add_rest(WORKSPACE *workspace, const REAL motion[ENTRIES], PHASOR turn, REAL w,
        PHASOR rest[ROWS][LINES]CONSTANTS)
{
    REAL regressor[ROWS][COLUMNS];
    REAL known[ROWS];
    REAL map[ROWS][INPUTS];
    REAL forces[INPUTS];
    size_t row, column, input;

    run_rows(motion, regressor, known, mapARGUMENT);
    for (input = 0; input < INPUTS; ++input) {
        forces[input] = run_value(workspace->inputs[input], 0, turn, w);
    }
    for (row = 0; row < ROWS; ++row) {
        REAL left = -known[row];
        for (input = 0; input < INPUTS; ++input) {
            left += map[row][input] * forces[input];
        }
        for (column = 0; column < COLUMNS; ++column) {
            left -= regressor[row][column] * workspace->theta[column];
        }
        run_add_harmonics(rest[row], left / (REAL)POINTS, turn);
    }
}

/* By how much the slots of a motion are moved for differences. */
static void run_steps(const WORKSPACE *workspace, REAL w, REAL steps[ENTRIES])
{
    size_t entry, line;

    for (entry = 0; entry < ENTRIES; ++entry) {
        REAL square = ZERO;
        for (line = 0; line < LINES; line += 2) {
            const PHASOR derivative = run_derivative(w * (REAL)(line / 2), run_order[entry]);
            square += run_square(run_times(workspace->PATH[run_coordinate[entry]][line], derivative));
        }
        steps[entry] = square > ZERO ? SQRT(square) * STEP : STEP;
    }
}

/* Lines of the rows' derivatives along the motion at the present parameters, and harmonics of what the rows leave there. */
static void run_differentiate(WORKSPACE *workspace, REAL wCONSTANTS)
{
    const REAL mean = ONE / (REAL)POINTS;
    REAL steps[ENTRIES];
    size_t point, entry, row, column, line, side;

    run_steps(workspace, w, steps);
    for (entry = 0; entry < ENTRIES; ++entry) {
        for (row = 0; row < ROWS; ++row) {
            for (line = 0; line < LINES; ++line) {
                workspace->gains[row][entry][line] = run_phasor(ZERO, ZERO);
            }
            for (column = 0; column < COLUMNS; ++column) {
                workspace->slopes[row][column][entry] = ZERO;
            }
        }
    }
    for (row = 0; row < ROWS; ++row) {
        for (line = 0; line < LINES; ++line) {
            workspace->rest[row][line] = run_phasor(ZERO, ZERO);
        }
    }
    for (point = 0; point < POINTS; ++point) {
        const PHASOR turn = run_point(point);
        REAL motion[ENTRIES];
        run_motion_at(workspace->PATH, turn, w, motion);
        run_add_rest(workspace, motion, turn, w, workspace->restARGUMENT);
        for (entry = 0; entry < ENTRIES; ++entry) {
            const REAL both = steps[entry] + steps[entry];
            const REAL centre = motion[entry];
            REAL regressor[2][ROWS][COLUMNS];
            REAL known[2][ROWS];
            REAL map[ROWS][INPUTS];
            for (side = 0; side < 2; ++side) {
                motion[entry] = centre + (side == 0 ? steps[entry] : -steps[entry]);
                run_rows(motion, regressor[side], known[side], mapARGUMENT);
            }
            motion[entry] = centre;
            for (row = 0; row < ROWS; ++row) {
                REAL slope = (known[0][row] - known[1][row]) / both;
                PHASOR turned;
                for (column = 0; column < COLUMNS; ++column) {
                    const REAL own = (regressor[0][row][column] - regressor[1][row][column]) / both;
                    slope += own * workspace->theta[column];
                    workspace->slopes[row][column][entry] += own * own * mean;
                }
                turned = run_phasor(slope * mean, ZERO);
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
