//! C code of what motion that noise makes adds to the means of the rows, before names and sizes are filled in.
//!
//! Invariant: the method is that of `tpm_controller::support` (`run_means`), in the caller's memory.

/// What the inputs hold above the lines, sample by sample.
pub(super) const PASSED: &str = "
/* tan(w T / 2) at so many harmonics. */
static REAL run_tangent(REAL harmonic, uint32_t samples_per_period)
{
    const PHASOR turn = run_turn(TURN_REAL / TWO * harmonic / (REAL)samples_per_period);

    return turn.im / turn.re;
}

/*
 * Passes the inputs through s^3 / B(s), the high pass of Butterworth's fourth order over s, and adds up the products of what has passed
 * behind the first period: above the lines, where masses alone answer to forces, the velocity of the motion that noise makes.
 */
static void run_pass(RUN *run, const REAL channels[CHANNELS])
{
    static const REAL damping[2] = {FLAT, SHARP};
    REAL passed[INPUTS];
    REAL fast[INPUTS];
    size_t input, other, section;

    for (input = 0; input < INPUTS; ++input) {
        REAL value = channels[COORDINATES + input];
        for (section = 0; section < 2; ++section) {
            REAL *const state = run->states[input] + 2 * section;
            const REAL share = ONE / (ONE + run->bend * (run->bend + damping[section]));
            const REAL rate = share * (state[0] + run->bend * (value - state[1]));
            const REAL slow = state[1] + run->bend * rate;
            const REAL high = value - damping[section] * rate - slow;
            state[0] = TWO * rate - state[0];
            state[1] = TWO * slow - state[1];
            if (section == 0) {
                fast[input] = high;
                value = rate;
            } else {
                value = high;
            }
        }
        passed[input] = value;
    }
    if (run->count >= run->samples_per_period) {
        /* Between samples a mass under a held force goes on: its velocity has that of the middle, and a twelfth of the square of the step. */
        const REAL between = run->bend * run->bend / THREE;
        for (input = 0; input < INPUTS; ++input) {
            for (other = 0; other <= input; ++other) {
                run->products[input][other] += passed[input] * passed[other] + between * fast[input] * fast[other];
            }
        }
    }
}

/* Before the first sample of a run. */
static void run_begin_passed(RUN *run)
{
    size_t input, place;

    for (input = 0; input < INPUTS; ++input) {
        for (place = 0; place < 4; ++place) {
            run->states[input][place] = ZERO;
        }
        for (place = 0; place < INPUTS; ++place) {
            run->products[input][place] = ZERO;
        }
    }
    run->bend = run->samples > 0 ? run_tangent(BEGINNING * (REAL)LINES / TWO, run->samples_per_period) : ZERO;
}
";

/// The means.
pub(super) const MEANS: &str = "
/* Solves a complex system in its place, the largest pivot first; 0 when there is none. */
static int run_eliminate(PHASOR matrix[COORDINATES][COORDINATES], PHASOR right[COORDINATES])
{
    size_t step, row, column, best;

    for (step = 0; step < COORDINATES; ++step) {
        PHASOR pivot;
        REAL size;
        best = step;
        for (row = step + 1; row < COORDINATES; ++row) {
            best = run_square(matrix[row][step]) > run_square(matrix[best][step]) ? row : best;
        }
        for (column = 0; column < COORDINATES; ++column) {
            const PHASOR own = matrix[step][column];
            matrix[step][column] = matrix[best][column];
            matrix[best][column] = own;
        }
        pivot = right[step];
        right[step] = right[best];
        right[best] = pivot;
        size = run_square(matrix[step][step]);
        if (!(size > ZERO && size <= MAX)) {
            return 0;
        }
        pivot = run_scaled(run_conjugate(matrix[step][step]), ONE / size);
        for (column = 0; column < COORDINATES; ++column) {
            matrix[step][column] = run_times(matrix[step][column], pivot);
        }
        right[step] = run_times(right[step], pivot);
        for (row = 0; row < COORDINATES; ++row) {
            const PHASOR factor = matrix[row][step];
            if (row == step) {
                continue;
            }
            for (column = 0; column < COORDINATES; ++column) {
                run_subtract(&matrix[row][column], run_times(factor, matrix[step][column]));
            }
            run_subtract(&right[row], run_times(factor, right[step]));
        }
    }
    return 1;
}

/* The mean response of the rows to the coordinates at an angular frequency; of second derivatives alone where it is not above zero. */
static void run_mean_response(const WORKSPACE *workspace, REAL w, PHASOR matrix[COORDINATES][COORDINATES])
{
    size_t row, column, entry;

    for (row = 0; row < COORDINATES; ++row) {
        for (column = 0; column < COORDINATES; ++column) {
            matrix[row][column] = run_phasor(ZERO, ZERO);
        }
        for (entry = 0; entry < ENTRIES; ++entry) {
            const REAL gain = workspace->gains[row][entry][0].re;
            if (w > ZERO) {
                run_add(&matrix[row][run_coordinate[entry]], run_scaled(run_derivative(w, run_order[entry]), gain));
            } else if (run_order[entry] == 2) {
                matrix[row][run_coordinate[entry]].re += gain;
            }
        }
    }
}

/*
 * Covariance of the motion that noise makes on its way round the loop: what the inputs halfway between the harmonics explain, and above the
 * lines what the filter passed, to which masses alone answer. 0 where it is not known.
 */
static int run_true_motion(const RUN *run, WORKSPACE *workspace, REAL w)
{
    const REAL periods = (REAL)(run->samples / run->samples_per_period);
    const REAL flat = periods - TWO;
    /* The variance of the band of a harmonic over the square of a line. */
    const REAL band = flat * flat / (TWO * (flat - ONE / TWO));
    const REAL corner = TWO / run->sampling.sample_time * run->bend;
    const REAL top = w * (REAL)LINES / TWO;
    REAL above[INPUTS][INPUTS];
    REAL answer[COORDINATES][INPUTS];
    REAL squares[ENTRIES];
    REAL apart = ZERO;
    REAL whole = ZERO;
    REAL doubt;
    PHASOR matrix[COORDINATES][COORDINATES];
    PHASOR right[COORDINATES];
    size_t input, other, coordinate, row, line, entry, second;

    if (!(corner > ZERO && corner <= MAX)) {
        return 0;
    }
    for (input = 0; input < INPUTS; ++input) {
        run_mean_response(workspace, ZERO, matrix);
        for (row = 0; row < COORDINATES; ++row) {
            right[row] = run_phasor(workspace->map[row][input], ZERO);
        }
        if (!run_eliminate(matrix, right)) {
            return 0;
        }
        for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
            answer[coordinate][input] = right[coordinate].re;
        }
        for (other = 0; other <= input; ++other) {
            above[input][other] = run->products[input][other] / (REAL)(run->samples - run->samples_per_period);
        }
    }
    run_mean_response(workspace, top, matrix);
    {
        PHASOR masses[COORDINATES][COORDINATES];
        run_mean_response(workspace, ZERO, masses);
        for (row = 0; row < COORDINATES; ++row) {
            for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
                const PHASOR mass = run_scaled(masses[row][coordinate], top * top);
                run_add(&matrix[row][coordinate], mass);
                apart += run_square(matrix[row][coordinate]);
                whole += run_square(mass);
            }
        }
    }
    for (entry = 0; entry < ENTRIES; ++entry) {
        squares[entry] = ZERO;
        for (second = 0; second < ENTRIES; ++second) {
            workspace->covariance[entry][second] = ZERO;
        }
    }
    for (line = 1; line < LINES; ++line) {
        const REAL ratio = run_tangent((REAL)line / TWO, run->samples_per_period) / run->bend;
        const REAL cube = ratio * ratio * ratio;
        const REAL passed = cube * cube / (ONE + cube * cube * ratio * ratio);
        const REAL frequency = w * (REAL)line / TWO;
        PHASOR parts[ENTRIES];
        PHASOR modelled[COORDINATES];
        if (line % 2 == 0) {
            /* The periodic part of what was passed, without the noise of the line. */
            for (input = 0; input < INPUTS; ++input) {
                for (other = 0; other <= input; ++other) {
                    const PHASOR own = workspace->inputs[input][line];
                    const PHASOR by = workspace->inputs[other][line];
                    const PHASOR noise = workspace->inputs[input][line + 1];
                    const PHASOR beside = workspace->inputs[other][line + 1];
                    const REAL periodic = own.re * by.re + own.im * by.im;
                    above[input][other] -= passed * (periodic - noise.re * beside.re - noise.im * beside.im) / TWO;
                }
            }
            continue;
        }
        run_mean_response(workspace, frequency, matrix);
        for (row = 0; row < COORDINATES; ++row) {
            right[row] = workspace->drive[row][line];
            modelled[row] = run_phasor(ZERO, ZERO);
            for (input = 0; input < INPUTS; ++input) {
                run_add(&modelled[row], run_scaled(workspace->inputs[input][line], answer[row][input]));
            }
        }
        if (!run_eliminate(matrix, right)) {
            return 0;
        }
        for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
            /* Near a resonance inputs say little. What was measured is this motion and the noise of the sensor. */
            const PHASOR measured = workspace->motion[coordinate][line];
            if (run_square(right[coordinate]) > TWO * (run_square(measured) + NINE * workspace->sensors[coordinate])) {
                right[coordinate] = measured;
            }
        }
        for (entry = 0; entry < ENTRIES; ++entry) {
            parts[entry] = run_times(right[run_coordinate[entry]], run_derivative(frequency, run_order[entry]));
        }
        for (entry = 0; entry < ENTRIES; ++entry) {
            for (second = 0; second < ENTRIES; ++second) {
                const PHASOR a = parts[entry];
                const PHASOR b = parts[second];
                REAL own = a.re * b.re + a.im * b.im;
                if (run_order[entry] + run_order[second] == 2) {
                    const PHASOR x = modelled[run_coordinate[entry]];
                    const PHASOR y = modelled[run_coordinate[second]];
                    const REAL filtered = passed * (x.re * y.re + x.im * y.im) / (corner * corner);
                    own -= run_order[entry] == 1 ? filtered : -filtered;
                }
                workspace->covariance[entry][second] += band * own;
                if (entry == second) {
                    squares[entry] += band * own * band * own / TWO;
                }
            }
        }
    }
    /* The band above the lines is at least as wide as that below. */
    doubt = ONE / (periods * (REAL)LINES / TWO) + KNOWN + apart / whole;
    workspace->doubt = ZERO;
    for (entry = 0; entry < ENTRIES; ++entry) {
        for (second = 0; second < ENTRIES; ++second) {
            REAL tail = ZERO;
            for (input = 0; input < INPUTS; ++input) {
                for (other = 0; other < INPUTS; ++other) {
                    tail += answer[run_coordinate[entry]][input] * answer[run_coordinate[second]][other]
                            * (input >= other ? above[input][other] : above[other][input]);
                }
            }
            tail /= corner * corner;
            if (run_order[entry] + run_order[second] == 2) {
                workspace->covariance[entry][second] += run_order[entry] == 1 ? tail : -tail;
            }
            if (entry == second && run_order[entry] == 1) {
                squares[entry] += tail * tail * doubt;
                if (workspace->covariance[entry][entry] > ZERO) {
                    const REAL all = workspace->covariance[entry][entry] * workspace->covariance[entry][entry];
                    const REAL share = SQRT(squares[entry] / all);
                    workspace->doubt = share > workspace->doubt ? share : workspace->doubt;
                } else {
                    return 0;
                }
            }
        }
    }
    return 1;
}

/* Whether a term of a row has a mean that stands out of its noise. */
static int run_has_mean(const WORKSPACE *workspace, size_t row)
{
    const REAL variance = run_variance(workspace, row, 0);
    REAL largest = run_square(workspace->known[row][0]);
    size_t column;

    for (column = 0; column < COLUMNS; ++column) {
        const REAL square = run_square(run_scaled(workspace->regressor[row][column][0], workspace->theta[column]));
        largest = square > largest ? square : largest;
    }
    return largest > VISIBLE * variance;
}

/* No shift is known. */
static void run_forget_shift(WORKSPACE *workspace)
{
    size_t row, column;

    workspace->shifts = 0;
    workspace->doubt = ZERO;
    for (row = 0; row < ROWS; ++row) {
        workspace->shifted[row] = ZERO;
        for (column = 0; column < COLUMNS; ++column) {
            workspace->shift[row][column] = ZERO;
        }
    }
}

/*
 * What the motion that noise makes adds to the means of the regressor, half the mean second derivative times its covariance, and takes of
 * what the rows leave, where a row has a mean. It is not known where noise is not that of the sensors alone, or masses do not answer above
 * the lines.
 */
static void run_find_shift(const RUN *run, WORKSPACE *workspace, REAL wCONSTANTS)
{
    REAL steps[ENTRIES];
    size_t point, entry, second, row, column, side;

    run_forget_shift(workspace);
    for (row = 0; row < ROWS && !run_has_mean(workspace, row); ++row) {
    }
    if (row == ROWS || workspace->disturbed) {
        return;
    }
    if (workspace->reach == 0) {
        /* Where derivatives do not vary along the motion, nothing is added. */
        workspace->shifts = 1;
        return;
    }
    if (!run_true_motion(run, workspace, w)) {
        workspace->doubt = ZERO;
        return;
    }
    workspace->shifts = 1;
    run_steps(workspace, w, steps);
    for (point = 0; point < POINTS; ++point) {
        REAL motion[ENTRIES];
        run_motion_at(workspace->PATH, run_point(point), w, motion);
        for (entry = 0; entry < ENTRIES; ++entry) {
            for (second = 0; second <= entry; ++second) {
                const REAL centres[2] = {motion[entry], motion[second]};
                const REAL share = (entry == second ? ONE / TWO : ONE) * workspace->covariance[entry][second]
                        / (FOUR * steps[entry] * steps[second] * (REAL)POINTS);
                /* Accelerations are in the rows as they are. */
                if (!(FABS(share) > ZERO) || run_order[entry] + run_order[second] == 4) {
                    continue;
                }
                for (side = 0; side < 4; ++side) {
                    REAL regressor[ROWS][COLUMNS];
                    REAL known[ROWS];
                    REAL map[ROWS][INPUTS];
                    const REAL sign = side == 1 || side == 2 ? -share : share;
                    motion[entry] += side < 2 ? steps[entry] : -steps[entry];
                    motion[second] += side % 2 == 0 ? steps[second] : -steps[second];
                    run_rows(motion, regressor, known, mapARGUMENT);
                    motion[entry] = centres[0];
                    motion[second] = centres[1];
                    for (row = 0; row < ROWS; ++row) {
                        workspace->shifted[row] += sign * known[row];
                        for (column = 0; column < COLUMNS; ++column) {
                            workspace->shift[row][column] += sign * regressor[row][column];
                            workspace->shifted[row] += sign * regressor[row][column] * workspace->theta[column];
                        }
                    }
                }
            }
        }
    }
}
";
