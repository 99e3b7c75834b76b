//! C code of the weighted equations of a run, before names and sizes are filled in.
//!
//! Invariant: the method is that of `tpm_core::support` (`run_estimate`), in the caller's memory.

/// The equations, and their solution.
pub(super) const EQUATIONS: &str = "
/* Covariance of the noise of all rows at a harmonic. */
static void run_covariance(const WORKSPACE *workspace, size_t harmonic, REAL w, PHASOR covariance[ROWS][ROWS])
{
    size_t row, other, coordinate;
    int shift;

    for (row = 0; row < ROWS; ++row) {
        for (other = 0; other < ROWS; ++other) {
            covariance[row][other] = run_phasor(ZERO, ZERO);
        }
    }
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        for (shift = -workspace->reach; shift <= workspace->reach; ++shift) {
            PHASOR through[ROWS];
            for (row = 0; row < ROWS; ++row) {
                through[row] = run_through(workspace, row, coordinate, 2 * (int)harmonic, shift, w);
            }
            for (row = 0; row < ROWS; ++row) {
                for (other = 0; other < ROWS; ++other) {
                    const PHASOR product = run_times(through[row], run_conjugate(through[other]));
                    run_add(&covariance[row][other], run_scaled(product, workspace->sensors[coordinate]));
                }
            }
        }
    }
    for (row = 0; row < ROWS; ++row) {
        covariance[row][row].re += workspace->forces[row];
    }
}

/* Whether a force on any row stands out of the noise: the applied one, or a term at the present parameters. */
static int run_is_visible(const WORKSPACE *workspace, size_t harmonic, PHASOR covariance[ROWS][ROWS])
{
    const size_t line = 2 * harmonic;
    size_t row, column;

    for (row = 0; row < ROWS; ++row) {
        const REAL drive = run_square(workspace->drive[row][line]);
        const REAL known = run_square(workspace->known[row][line]);
        REAL largest = drive > known ? drive : known;
        for (column = 0; column < COLUMNS; ++column) {
            const PHASOR term = run_scaled(workspace->regressor[row][column][line], workspace->theta[column]);
            const REAL square = run_square(term);
            largest = square > largest ? square : largest;
        }
        if (largest > VISIBLE * covariance[row][row].re) {
            return 1;
        }
    }
    return 0;
}

/* The square of the force on a row: of the applied one, or, where nothing is applied, of its terms by parameters of one. */
static REAL run_size(const WORKSPACE *workspace, size_t row)
{
    REAL applied = ZERO;
    REAL terms = ZERO;
    size_t column, line;

    for (line = 0; line < LINES; line += 2) {
        applied += run_square(workspace->drive[row][line]);
        terms += run_square(workspace->known[row][line]);
    }
    if (applied > ZERO) {
        return applied;
    }
    for (column = 0; column < COLUMNS; ++column) {
        REAL power = ZERO;
        for (line = 0; line < LINES; line += 2) {
            power += run_square(workspace->regressor[row][column][line]);
        }
        terms += power;
    }
    return terms > ZERO ? terms : ONE;
}

/* Divides equations by the Cholesky factor of their covariance; 0 when there is none. */
static int run_whiten(PHASOR covariance[ROWS][ROWS], PHASOR phi[ROWS][COLUMNS], PHASOR right[ROWS])
{
    size_t row, column, before;

    for (row = 0; row < ROWS; ++row) {
        const REAL whole = covariance[row][row].re;
        REAL pivot = whole;
        REAL least, length;
        for (column = 0; column < row; ++column) {
            PHASOR sum = covariance[row][column];
            for (before = 0; before < column; ++before) {
                run_subtract(&sum, run_times(covariance[row][before], run_conjugate(covariance[column][before])));
            }
            covariance[row][column] = run_scaled(sum, ONE / covariance[column][column].re);
        }
        for (before = 0; before < row; ++before) {
            pivot -= run_square(covariance[row][before]);
        }
        /* Rows that have all their noise in common still differ by rounding. */
        least = whole * SQRT(EPSILON);
        pivot = pivot > least ? pivot : least;
        if (!(pivot > ZERO && pivot <= MAX)) {
            return 0;
        }
        length = SQRT(pivot);
        covariance[row][row] = run_phasor(length, ZERO);
        for (before = 0; before < row; ++before) {
            for (column = 0; column < COLUMNS; ++column) {
                run_subtract(&phi[row][column], run_times(covariance[row][before], phi[before][column]));
            }
            run_subtract(&right[row], run_times(covariance[row][before], right[before]));
        }
        for (column = 0; column < COLUMNS; ++column) {
            phi[row][column] = run_scaled(phi[row][column], ONE / length);
        }
        right[row] = run_scaled(right[row], ONE / length);
    }
    return 1;
}

/* Rotates a row in, unless a number of it is not finite. */
static int run_push_row(FACTOR *factor, REAL row[COLUMNS], REAL right)
{
    size_t column;

    if (!(FABS(right) <= MAX)) {
        return 0;
    }
    for (column = 0; column < COLUMNS; ++column) {
        if (!(FABS(row[column]) <= MAX)) {
            return 0;
        }
    }
    rotate_in(factor, row, right);
    return 1;
}

/* Takes in the equations of all rows at a harmonic, made independent of each other. */
static STATUS run_push_harmonic(WORKSPACE *workspace, size_t harmonic, REAL w, int weighed)
{
    const REAL scale = harmonic > 0 ? SQRT(TWO) : TWO;
    PHASOR covariance[ROWS][ROWS];
    PHASOR phi[ROWS][COLUMNS];
    PHASOR right[ROWS];
    REAL part[COLUMNS];
    size_t row, other, column;

    if (weighed) {
        run_covariance(workspace, harmonic, w, covariance);
        if (!run_is_visible(workspace, harmonic, covariance)) {
            return OK;
        }
    } else {
        for (row = 0; row < ROWS; ++row) {
            for (other = 0; other < ROWS; ++other) {
                covariance[row][other] = run_phasor(row == other ? run_size(workspace, row) : ZERO, ZERO);
            }
        }
    }
    for (row = 0; row < ROWS; ++row) {
        right[row] = workspace->drive[row][2 * harmonic];
        run_subtract(&right[row], workspace->known[row][2 * harmonic]);
        for (column = 0; column < COLUMNS; ++column) {
            phi[row][column] = workspace->regressor[row][column][2 * harmonic];
            run_subtract(&right[row], run_scaled(phi[row][column], workspace->theta[column]));
            if (!workspace->stands[column]) {
                phi[row][column] = run_phasor(ZERO, ZERO);
            }
        }
    }
    if (!run_whiten(covariance, phi, right)) {
        return NOT_EVALUATED;
    }
    for (row = 0; row < ROWS; ++row) {
        for (column = 0; column < COLUMNS; ++column) {
            part[column] = phi[row][column].re * scale;
        }
        if (!run_push_row(&workspace->factor, part, right[row].re * scale)) {
            return NOT_EVALUATED;
        }
        if (harmonic > 0) {
            for (column = 0; column < COLUMNS; ++column) {
                part[column] = phi[row][column].im * scale;
            }
            if (!run_push_row(&workspace->factor, part, right[row].im * scale)) {
                return NOT_EVALUATED;
            }
        }
    }
    return OK;
}

/* Solves the equations for the step from the parameters of the pass before; the prior stays where the run does not show one. */
static STATUS run_solve_step(WORKSPACE *workspace, REAL w, int weighed)
{
    FACTOR *const factor = &workspace->factor;
    STATUS status = OK;
    size_t i, j;

    for (i = 0; i < COLUMNS; ++i) {
        for (j = 0; j < COLUMNS; ++j) {
            factor->factor[i][j] = ZERO;
        }
        factor->right[i] = ZERO;
    }
    factor->residual = ZERO;
    factor->rows = ZERO;
    for (i = 1; i < LINES / 2 && status == OK; ++i) {
        status = run_push_harmonic(workspace, i, w, weighed);
    }
    if (status == OK) {
        run_solution_of(factor, &workspace->solution, &workspace->shown);
        if (workspace->shown.rank < COLUMNS) {
            /* Means count only where nothing else shows a parameter: noise shifts that of a term even in a velocity. */
            status = run_push_harmonic(workspace, 0, w, weighed);
            run_solution_of(factor, &workspace->solution, &workspace->shown);
        }
    }
    if (status == OK && workspace->shown.rank == 0) {
        status = STILL;
    }
    for (i = 0; i < COLUMNS; ++i) {
        const REAL theta = workspace->theta[i] + workspace->solution.column[i];
        workspace->about[i] = workspace->theta[i];
        workspace->theta[i] = workspace->shown.shown[i] ? theta : workspace->prior[i];
    }
    return status;
}

/* What a run says of the parameters: step, deviations and covariance in the workspace. */
static STATUS run_update(const RUN *run, WORKSPACE *workspaceCONSTANTS)
{
    const REAL w = TURN_REAL / ((REAL)run->samples_per_period * run->sampling.sample_time);
    STATUS status = run->status;
    size_t pass, column;

    if (status == OK && (run->samples == 0 || run->count < run->samples)) {
        status = UNFINISHED;
    }
    if (status != OK) {
        return status;
    }
    for (column = 0; column < COLUMNS; ++column) {
        if (!(FABS(workspace->prior[column]) <= MAX)) {
            return NOT_EVALUATED;
        }
        workspace->theta[column] = workspace->prior[column];
    }
    if (!(w > ZERO && w <= MAX)) {
        return NOT_EVALUATED;
    }
    run_lines(run, workspace, w);
    status = run_evaluate(workspace, wARGUMENT);
    if (status == OK) {
        for (column = 0; column < COORDINATES; ++column) {
            workspace->sensors[column] = ZERO;
        }
        run_differentiate(workspace, wARGUMENT);
        run_find_shown(workspace, w);
        status = run_solve_step(workspace, w, 0);
    }
    for (pass = 0; pass < PASSES && status == OK; ++pass) {
        run_differentiate(workspace, wARGUMENT);
        run_find_noise(workspace, w);
        run_find_shown(workspace, w);
        status = run_solve_step(workspace, w, 1);
    }
    return status;
}
";
