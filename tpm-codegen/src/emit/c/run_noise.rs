//! C code of the noise of a run, before names and sizes are filled in.
//!
//! Invariant: the method is that of `tpm_controller::support` (`run_noise`), in the caller's memory.

/// The noise, read halfway between the harmonics.
pub(super) const NOISE: &str = "
/* What line - 2 shift of a coordinate makes of a line of a row, through one harmonic of the row's derivatives. */
static PHASOR run_through(const WORKSPACE *workspace, size_t row, size_t coordinate, int line, int shift, REAL w)
{
    const REAL source = (REAL)(line - 2 * shift) / TWO * w;
    const int harmonic = shift < 0 ? -shift : shift;
    PHASOR sum = run_phasor(ZERO, ZERO);
    size_t entry;

    for (entry = 0; entry < ENTRIES; ++entry) {
        if (run_coordinate[entry] == coordinate && harmonic < (int)LINES) {
            PHASOR gain = workspace->gains[row][entry][harmonic];
            if (shift < 0) {
                gain = run_conjugate(gain);
            }
            run_add(&sum, run_times(gain, run_derivative(source, run_order[entry])));
        }
    }
    return sum;
}

/* Variance of a line of a row. */
static REAL run_variance(const WORKSPACE *workspace, size_t row, size_t line)
{
    REAL sum = workspace->forces[row];
    size_t coordinate;

    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        sum += workspace->felt[row][line][coordinate] * workspace->sensors[coordinate];
    }
    return sum;
}

/* One step of the sensors' variances, and of the forces' too or as they are, towards the largest likelihood; none becomes negative. */
static void run_improve_noise(WORKSPACE *workspace, int with_forces)
{
    REAL sensors[COORDINATES][2];
    REAL forces[ROWS][2];
    size_t row, line, coordinate;

    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        sensors[coordinate][0] = sensors[coordinate][1] = ZERO;
    }
    for (row = 0; row < ROWS; ++row) {
        forces[row][0] = forces[row][1] = ZERO;
        for (line = 1; line < LINES; line += 2) {
            const REAL variance = run_variance(workspace, row, line);
            REAL given, expected;
            if (!(variance > ZERO)) {
                continue;
            }
            given = workspace->left[row][line] / variance / variance;
            expected = ONE / variance;
            for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
                sensors[coordinate][0] += workspace->felt[row][line][coordinate] * given;
                sensors[coordinate][1] += workspace->felt[row][line][coordinate] * expected;
            }
            forces[row][0] += given;
            forces[row][1] += expected;
        }
    }
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        if (sensors[coordinate][1] > ZERO) {
            workspace->sensors[coordinate] *= SQRT(sensors[coordinate][0] / sensors[coordinate][1]);
        }
    }
    for (row = 0; row < ROWS && with_forces; ++row) {
        if (forces[row][1] > ZERO) {
            workspace->forces[row] *= SQRT(forces[row][0] / forces[row][1]);
        }
    }
}

/* Takes the variances to those of largest likelihood; gives its logarithm. */
static REAL run_fit_noise(WORKSPACE *workspace, int with_forces)
{
    REAL sum = ZERO;
    size_t row, line, step;

    for (step = 0; step < NOISE_STEPS; ++step) {
        run_improve_noise(workspace, with_forces);
    }
    for (row = 0; row < ROWS; ++row) {
        for (line = 1; line < LINES; line += 2) {
            const REAL variance = run_variance(workspace, row, line);
            if (variance > ZERO && variance <= MAX) {
                sum -= workspace->left[row][line] / variance + LOG(variance);
            }
        }
    }
    return sum;
}

/* Variances of the sensors and of a force on every row, from the lines halfway between the harmonics. */
static void run_find_noise(WORKSPACE *workspace, REAL w)
{
    const int reach = workspace->reach;
    REAL roundings[ROWS], forces[ROWS], sensors[COORDINATES], begin[COORDINATES], alone;
    size_t row, line, coordinate;
    int shift;

    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        workspace->sensors[coordinate] = ZERO;
    }
    for (row = 0; row < ROWS; ++row) {
        REAL sum = ZERO;
        REAL peak = ZERO;
        REAL rounding;
        for (line = 0; line < LINES; ++line) {
            PHASOR residual = workspace->drive[row][line];
            for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
                REAL felt = ZERO;
                for (shift = -reach; shift <= reach; ++shift) {
                    const PHASOR through = run_through(workspace, row, coordinate, (int)line, shift, w);
                    const int source = (int)line - 2 * shift;
                    const int place = source < 0 ? -source : source;
                    felt += run_square(through);
                    if (place < (int)LINES) {
                        PHASOR measured = workspace->motion[coordinate][place];
                        if (source < 0) {
                            measured = run_conjugate(measured);
                        }
                        run_subtract(&residual, run_times(through, measured));
                    }
                }
                workspace->felt[row][line][coordinate] = felt;
            }
            workspace->left[row][line] = run_square(residual);
            sum += line % 2 != 0 ? workspace->left[row][line] : ZERO;
        }
        for (line = 0; line < LINES; ++line) {
            const REAL drive = run_square(workspace->drive[row][line]);
            const REAL known = run_square(workspace->known[row][line]);
            peak = drive > peak ? drive : peak;
            peak = known > peak ? known : peak;
        }
        /* A force is known to this share of the largest one of its row at best. */
        rounding = EPSILON > FORCE ? EPSILON * EPSILON * peak : FORCE * FORCE * peak;
        roundings[row] = rounding;
        workspace->forces[row] = sum / ((REAL)LINES / TWO);
        if (!(workspace->forces[row] > rounding)) {
            workspace->forces[row] = rounding;
        }
        for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
            REAL felt = ZERO;
            for (line = 1; line < LINES; line += 2) {
                felt += workspace->felt[row][line][coordinate];
            }
            if (felt > ZERO && sum / felt > workspace->sensors[coordinate]) {
                workspace->sensors[coordinate] = sum / felt;
            }
        }
    }
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        begin[coordinate] = workspace->sensors[coordinate];
    }
    for (row = 0; row < ROWS; ++row) {
        forces[row] = workspace->forces[row];
        workspace->forces[row] = roundings[row];
    }
    /* A force is there only where it explains more than chance does. */
    alone = run_fit_noise(workspace, 0);
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        sensors[coordinate] = workspace->sensors[coordinate];
        workspace->sensors[coordinate] = begin[coordinate];
    }
    for (row = 0; row < ROWS; ++row) {
        workspace->forces[row] = forces[row];
    }
    workspace->disturbed = run_fit_noise(workspace, 1) - alone > TWO * (REAL)ROWS;
    if (workspace->disturbed) {
        return;
    }
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        workspace->sensors[coordinate] = sensors[coordinate];
    }
    for (row = 0; row < ROWS; ++row) {
        workspace->forces[row] = roundings[row];
    }
}

/* Says which columns of the regressor stand out of what noise, or rounding, makes of them at any harmonic. */
static void run_find_shown(WORKSPACE *workspace, REAL w)
{
    REAL noise[COORDINATES];
    size_t coordinate, line, row, column, entry;

    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        REAL peak = ZERO;
        for (line = 0; line < LINES; ++line) {
            const REAL square = run_square(workspace->motion[coordinate][line]);
            peak = square > peak ? square : peak;
        }
        peak *= ROUNDINGS * EPSILON * EPSILON;
        noise[coordinate] = workspace->sensors[coordinate] > peak ? workspace->sensors[coordinate] : peak;
    }
    for (column = 0; column < COLUMNS; ++column) {
        workspace->stands[column] = 0;
        for (row = 0; row < ROWS; ++row) {
            for (line = 0; line < LINES; line += 2) {
                REAL variance = ZERO;
                for (entry = 0; entry < ENTRIES; ++entry) {
                    const PHASOR felt = run_derivative(w * (REAL)(line / 2), run_order[entry]);
                    variance += workspace->slopes[row][column][entry] * run_square(felt)
                            * noise[run_coordinate[entry]];
                }
                if (run_square(workspace->regressor[row][column][line]) > VISIBLE * variance) {
                    workspace->stands[column] = 1;
                }
            }
        }
    }
}
";
