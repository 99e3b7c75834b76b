//! C code of the weighted equations of a run, before names and sizes are filled in.
//!
//! Invariant: the method is that of `tpm_controller::support` (`run_estimate`), in the caller's memory.

/// The equations, and their solution.
pub(super) const EQUATIONS: &str = "
/* Whether a force on any row stands out of the noise: the applied one, or a term at the present parameters. */
static int run_is_visible(const WORKSPACE *workspace, size_t harmonic)
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
        if (largest > VISIBLE * run_variance(workspace, row, line)) {
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

/* Rotates a row in, unless a number of it is not finite; the row itself stays. */
static int run_push_row(FACTOR *factor, const REAL row[COLUMNS], REAL right)
{
    REAL rotated[COLUMNS];
    size_t column;

    if (!(FABS(right) <= MAX)) {
        return 0;
    }
    for (column = 0; column < COLUMNS; ++column) {
        if (!(FABS(row[column]) <= MAX)) {
            return 0;
        }
        rotated[column] = row[column];
    }
    rotate_in(factor, rotated, right);
    return 1;
}

/* The place of an entry of a triangle. */
static size_t run_at(size_t row, size_t column)
{
    return row * (row + 1) / 2 + column;
}

/* Which means are among the equations: none, those of rows of which a term has a mean, or all. */
enum { NO_MEANS, MEANS_OF_TERMS, ALL_MEANS };

/* Harmonic, row and part (real, imaginary) of all equations that count, and their coefficients. */
static void run_collect(WORKSPACE *workspace, int weighed, int means)
{
    size_t harmonic, row, column;
    uint16_t part;

    workspace->count = 0;
    for (harmonic = means == NO_MEANS ? 1 : 0; harmonic < LINES / 2; ++harmonic) {
        if (weighed && !run_is_visible(workspace, harmonic)) {
            continue;
        }
        for (row = 0; row < ROWS; ++row) {
            const PHASOR right = workspace->rest[row][2 * harmonic];
            if (harmonic == 0 && means == MEANS_OF_TERMS && !run_has_mean(workspace, row)) {
                continue;
            }
            for (part = 0; part < (harmonic > 0 ? 2 : 1); ++part) {
                const size_t index = workspace->count++;
                workspace->places[index][0] = (uint16_t)harmonic;
                workspace->places[index][1] = (uint16_t)row;
                workspace->places[index][2] = part;
                for (column = 0; column < COLUMNS; ++column) {
                    const PHASOR entry = workspace->regressor[row][column][2 * harmonic];
                    const REAL shift = harmonic == 0 ? workspace->shift[row][column] : ZERO;
                    const REAL own = (part == 0 ? entry.re : entry.im) + shift;
                    workspace->rows[index][column] = workspace->stands[column] ? own : ZERO;
                }
                workspace->right[index] = part == 0 ? right.re : right.im;
                workspace->right[index] -= harmonic == 0 ? workspace->shifted[row] : ZERO;
            }
        }
    }
}

/* Adds what the noise of a coordinate that reaches an equation by a shift is multiplied by there. */
static void run_reach(WORKSPACE *workspace, size_t index, size_t coordinate, int shift, REAL sign, REAL w)
{
    const size_t harmonic = workspace->places[index][0];
    PHASOR through;

    if (shift > workspace->reach || -shift > workspace->reach) {
        return;
    }
    through = run_through(workspace, workspace->places[index][1], coordinate, 2 * (int)harmonic, shift, w);
    if (workspace->places[index][2] == 0) {
        workspace->by[index][0] += through.re;
        workspace->by[index][1] -= through.im * sign;
    } else {
        workspace->by[index][0] += through.im;
        workspace->by[index][1] += through.re * sign;
    }
}

/* Adds the covariance that the noise of a coordinate at one harmonic, below or beyond those that are used, gives all equations. */
static void run_add_noise(WORKSPACE *workspace, size_t coordinate, int line, REAL w)
{
    const REAL half = workspace->sensors[coordinate] / TWO;
    const REAL variance = line > 0 ? half : half + half;
    size_t index, other, part;

    for (index = 0; index < workspace->count; ++index) {
        const int harmonic = (int)workspace->places[index][0];
        workspace->by[index][0] = workspace->by[index][1] = ZERO;
        run_reach(workspace, index, coordinate, harmonic - line, ONE, w);
        if (line > 0) {
            run_reach(workspace, index, coordinate, harmonic + line, -ONE, w);
        } else {
            workspace->by[index][1] = ZERO;
        }
        if (harmonic == 0) {
            workspace->by[index][0] /= TWO;
            workspace->by[index][1] /= TWO;
        }
    }
    for (index = 0; index < workspace->count; ++index) {
        for (part = 0; part < 2; ++part) {
            const REAL own = workspace->by[index][part] * variance;
            if (!(FABS(own) > ZERO)) {
                continue;
            }
            for (other = 0; other <= index; ++other) {
                workspace->noise[run_at(index, other)] += own * workspace->by[other][part];
            }
        }
    }
}

/* The next row of the Cholesky factor in the place of the covariance, and the equation divided by it; 0 when there is none. */
static int run_whiten(WORKSPACE *workspace, size_t index)
{
    REAL *const noise = workspace->noise;
    REAL *const row = workspace->rows[index];
    const REAL whole = noise[run_at(index, index)];
    REAL pivot = whole;
    REAL least, length;
    size_t before, other, column;

    for (before = 0; before < index; ++before) {
        REAL share = noise[run_at(index, before)];
        for (other = 0; other < before; ++other) {
            share -= noise[run_at(index, other)] * noise[run_at(before, other)];
        }
        share /= noise[run_at(before, before)];
        noise[run_at(index, before)] = share;
        pivot -= share * share;
        for (column = 0; column < COLUMNS; ++column) {
            row[column] -= share * workspace->rows[before][column];
        }
        workspace->right[index] -= share * workspace->right[before];
    }
    /* Equations that have all their noise in common still differ by rounding. */
    least = whole * ROUNDINGS * EPSILON;
    pivot = pivot > least ? pivot : least;
    if (!(pivot > ZERO && pivot <= MAX)) {
        return 0;
    }
    length = SQRT(pivot);
    noise[run_at(index, index)] = length;
    for (column = 0; column < COLUMNS; ++column) {
        row[column] /= length;
    }
    workspace->right[index] /= length;
    return 1;
}

/* The equations of the visible harmonics for the step from the present parameters, independent and of variance one. */
static STATUS run_equations(WORKSPACE *workspace, REAL w, int weighed, int means)
{
    FACTOR *const factor = &workspace->factor;
    size_t index, i, j;
    int line;

    for (i = 0; i < COLUMNS; ++i) {
        for (j = 0; j < COLUMNS; ++j) {
            factor->factor[i][j] = ZERO;
        }
        factor->right[i] = ZERO;
    }
    factor->residual = ZERO;
    factor->rows = ZERO;
    run_collect(workspace, weighed, means);
    for (index = 0; index < COVARIANCES; ++index) {
        workspace->noise[index] = ZERO;
    }
    for (index = 0; index < workspace->count; ++index) {
        const size_t row = workspace->places[index][1];
        const REAL force = weighed ? workspace->forces[row] : run_size(workspace, row);
        const REAL doubt = workspace->places[index][0] > 0 ? ZERO : workspace->doubt * workspace->shifted[row];
        workspace->noise[run_at(index, index)] = force / (workspace->places[index][0] > 0 ? TWO : FOUR) + doubt * doubt;
    }
    for (line = 0; weighed && line < (int)LINES / 2 + workspace->reach; ++line) {
        for (i = 0; i < COORDINATES; ++i) {
            run_add_noise(workspace, i, line, w);
        }
    }
    for (index = 0; index < workspace->count; ++index) {
        if (!run_whiten(workspace, index) || !run_push_row(factor, workspace->rows[index], workspace->right[index])) {
            return NOT_EVALUATED;
        }
    }
    return OK;
}

/* Solves the equations for the step from the parameters of the pass before; the prior stays where the run does not show one. */
static STATUS run_solve_step(WORKSPACE *workspace, REAL w, int weighed)
{
    /* Noise shifts the mean of a term even in a velocity: means count where it is known by how much, and where nothing else shows a parameter. */
    STATUS status = run_equations(workspace, w, weighed, workspace->shifts ? MEANS_OF_TERMS : NO_MEANS);
    size_t i;

    if (status == OK) {
        run_solution_of(&workspace->factor, &workspace->solution, &workspace->shown);
        if (workspace->shown.rank < (int)COLUMNS) {
            status = run_equations(workspace, w, weighed, ALL_MEANS);
            run_solution_of(&workspace->factor, &workspace->solution, &workspace->shown);
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
static STATUS run_update(const RUN *run, WORKSPACE *workspaceABOUT_PARAMETERSCONSTANTS)
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
    run_forget_shift(workspace);
    BEGIN_PATH
    status = run_evaluate(workspace, wARGUMENT);
    if (status == OK) {
        for (column = 0; column < COORDINATES; ++column) {
            workspace->sensors[column] = ZERO;
        }
        run_differentiate(workspace, wARGUMENT);
        RESPOND
        run_find_shown(workspace, w);
        status = run_solve_step(workspace, w, 0);
    }
    for (pass = 0; pass < PASSES && status == OK; ++pass) {
        run_differentiate(workspace, wARGUMENT);
        run_find_noise(workspace, w);
        if (pass + 1 == PASSES) {
            /* Of second order in the noise, at parameters that were found without it. */
            run_find_shift(run, workspace, wARGUMENT);
        }
        LINEARISE
        run_find_shown(workspace, w);
        status = run_solve_step(workspace, w, 1);
    }
    return status;
}
";
