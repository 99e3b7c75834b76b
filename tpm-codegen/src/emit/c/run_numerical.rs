//! C code of the estimator by differences of runs.
//!
//! Invariant: the method is that of `tpm_controller::support` (`run_numerical`), in the caller's memory.

use super::super::names::Names;
use super::super::run::NUMERICAL;
use super::context::{Context, Parameter};
use super::layout::{doc, statement};
use super::solve::filled;

/// Declarations.
const HEADER: &str = "
/* The tracking errors of a run, and of those with one parameter changed; begin it before it is read. */
typedef struct NUMERICAL {
    PHASOR base[COORDINATES][LINES];
    /* How the tracking error changes with each parameter. */
    PHASOR slopes[COLUMNS][COORDINATES][LINES];
    /* By how much each was changed in the first and in the second of its runs; zero where the run has not been played. */
    REAL steps[COLUMNS][2];
    /* Sums of squares of the lines halfway between the harmonics, of how many runs, and the square of the largest line. */
    REAL noise[COORDINATES];
    REAL runs;
    REAL peak[COORDINATES];
    /* Samples of a run, and of a period. */
    uint32_t samples;
    uint32_t samples_per_period;
    /* The variance of noise in the samples over that of a line. */
    REAL behind;
} NUMERICAL;
";

/// The runs, and the solution.
const SOURCE: &str = "
/* Whether a run and its reference are whole. */
static STATUS numerical_check(const RUN *run, const REFERENCE *reference)
{
    if (run->status != OK) {
        return run->status;
    }
    if (run->samples == 0 || run->count < run->samples) {
        return UNFINISHED;
    }
    return run_check_reference(run, reference);
}

/* A line of a run, or between two. */
static PHASOR numerical_line(const RUN *run, size_t coordinate, size_t line)
{
    const REAL mean = ONE / (REAL)(run->samples - 2 * run->samples_per_period);

    return run_scaled(run->total[coordinate][line], line == 0 ? mean : mean + mean);
}

/* A line of a run's tracking error, which has none between the harmonics. */
static PHASOR numerical_error(const RUN *run, const REFERENCE *reference, size_t coordinate, size_t line)
{
    PHASOR error = run_phasor(ZERO, ZERO);

    if (line % 2 == 0) {
        error = numerical_line(run, coordinate, line);
        run_subtract(&error, reference->lines[coordinate][line]);
    }
    return error;
}

/* Takes in the noise of a run, which counts with that of the others. */
static void numerical_noise(NUMERICAL *numerical, const RUN *run)
{
    size_t coordinate, line;

    numerical->runs += ONE;
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        for (line = 0; line < LINES; ++line) {
            const REAL square = run_square(numerical_line(run, coordinate, line));
            numerical->peak[coordinate] = square > numerical->peak[coordinate] ? square : numerical->peak[coordinate];
            if (line % 2 != 0) {
                numerical->noise[coordinate] += square / (REAL)(LINES / 2);
            }
        }
    }
}

/* The weights of the base run and of the two others in the slope at the base: of the line through two errors, or of the parabola through
   three. Their sum is zero. */
static void numerical_weights(const REAL steps[2], REAL weights[3])
{
    const REAL first = steps[0];
    const REAL second = steps[1];

    weights[1] = FABS(first) > ZERO ? ONE / first : ZERO;
    weights[2] = ZERO;
    if (FABS(second) > ZERO) {
        weights[1] = second / (first * (second - first));
        weights[2] = first / (second * (first - second));
    }
    weights[0] = -(weights[1] + weights[2]);
}

STATUS NUMERICAL_BEGIN(NUMERICAL *numerical, const RUN *run, const REFERENCE *reference)
{
    const STATUS status = numerical_check(run, reference);
    size_t coordinate, column, line;

    if (status != OK) {
        return status;
    }
    for (column = 0; column < COLUMNS; ++column) {
        numerical->steps[column][0] = numerical->steps[column][1] = ZERO;
    }
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        numerical->noise[coordinate] = numerical->peak[coordinate] = ZERO;
    }
    numerical->runs = ZERO;
    numerical->samples = run->samples;
    numerical->samples_per_period = run->samples_per_period;
    numerical->behind = run_samples_behind_line(run);
    numerical_noise(numerical, run);
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        for (line = 0; line < LINES; ++line) {
            numerical->base[coordinate][line] = numerical_error(run, reference, coordinate, line);
        }
    }
    return OK;
}

STATUS NUMERICAL_CHANGE(NUMERICAL *numerical, size_t parameter, REAL step, const RUN *run, const REFERENCE *reference)
{
    const STATUS status = numerical_check(run, reference);
    REAL weights[3];
    REAL *steps;
    size_t coordinate, line;

    if (status != OK) {
        return status;
    }
    if (parameter >= COLUMNS || !(FABS(step) > ZERO && FABS(step) <= MAX) || !(numerical->runs > ZERO)) {
        return PERTURBATION;
    }
    if (numerical->samples != run->samples || numerical->samples_per_period != run->samples_per_period) {
        return SAMPLES;
    }
    numerical_noise(numerical, run);
    steps = numerical->steps[parameter];
    if (FABS(steps[0]) > ZERO && !(FABS(steps[1]) > ZERO) && (steps[0] < ZERO) != (step < ZERO)) {
        steps[1] = step;
    } else {
        steps[0] = step;
        steps[1] = ZERO;
    }
    numerical_weights(steps, weights);
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        for (line = 0; line < LINES; ++line) {
            PHASOR *const slope = &numerical->slopes[parameter][coordinate][line];
            PHASOR changed = numerical_error(run, reference, coordinate, line);
            run_subtract(&changed, numerical->base[coordinate][line]);
            if (FABS(steps[1]) > ZERO) {
                /* The slope of the first run alone is that of a line through it. */
                *slope = run_scaled(*slope, weights[1] * steps[0]);
                run_add(slope, run_scaled(changed, weights[2]));
            } else {
                *slope = run_scaled(changed, weights[1]);
            }
        }
    }
    return OK;
}

/* Variance of a line of a coordinate. */
static REAL numerical_variance(const NUMERICAL *numerical, size_t coordinate)
{
    const REAL rounding = SIXTEEN * EPSILON;
    const REAL least = numerical->peak[coordinate] * rounding * rounding;
    const REAL noise = numerical->noise[coordinate] / (numerical->runs > ONE ? numerical->runs : ONE);

    return noise > least ? noise : least;
}

/* -M update = E, every part divided by its deviation, for noise of so many times the variance of one run. */
static STATUS numerical_equations(const NUMERICAL *numerical, WORKSPACE *workspace, REAL factor)
{
    FACTOR *const equations = &workspace->factor;
    size_t coordinate, line, column, part;

    for (column = 0; column < COLUMNS; ++column) {
        for (part = 0; part < COLUMNS; ++part) {
            equations->factor[column][part] = ZERO;
        }
        equations->right[column] = ZERO;
    }
    equations->residual = equations->rows = ZERO;
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        const REAL variance = numerical_variance(numerical, coordinate);
        const REAL deviation = SQRT(variance * factor / TWO);
        for (line = 2; line < LINES && deviation > ZERO; line += 2) {
            const PHASOR own = numerical->base[coordinate][line];
            REAL rows[2][COLUMNS];
            int shown = run_square(own) > VISIBLE * variance;
            for (column = 0; column < COLUMNS; ++column) {
                PHASOR slope = run_phasor(ZERO, ZERO);
                if (FABS(numerical->steps[column][0]) > ZERO) {
                    REAL weights[3];
                    numerical_weights(numerical->steps[column], weights);
                    slope = numerical->slopes[column][coordinate][line];
                    shown = shown || run_square(slope) > VISIBLE * variance
                            * (weights[0] * weights[0] + weights[1] * weights[1] + weights[2] * weights[2]);
                    slope = run_scaled(slope, -(ONE / deviation));
                }
                rows[0][column] = slope.re;
                rows[1][column] = slope.im;
            }
            for (part = 0; part < 2 && shown; ++part) {
                if (!run_push_row(equations, rows[part], (part == 0 ? own.re : own.im) / deviation)) {
                    return NOT_EVALUATED;
                }
            }
        }
    }
    run_solution_of(equations, &workspace->solution, &workspace->shown);
    return OK;
}

/* The equations and their solution in the workspace, whose prior was played. */
static STATUS numerical_update(const NUMERICAL *numerical, WORKSPACE *workspace)
{
    REAL base = ONE;
    REAL squares = ZERO;
    REAL weights[3];
    STATUS status;
    size_t column;
    int changed = 0;

    for (column = 0; column < COLUMNS; ++column) {
        changed = changed || FABS(numerical->steps[column][0]) > ZERO;
        if (!(FABS(workspace->prior[column]) <= MAX)) {
            return NOT_EVALUATED;
        }
        workspace->about[column] = workspace->prior[column];
    }
    if (!changed) {
        return UNFINISHED;
    }
    status = numerical_equations(numerical, workspace, ONE);
    for (column = 0; column < COLUMNS && status == OK; ++column) {
        if (workspace->shown.shown[column]) {
            const REAL update = workspace->solution.column[column];
            numerical_weights(numerical->steps[column], weights);
            base += update * weights[0];
            squares += update * weights[1] * (update * weights[1]) + update * weights[2] * (update * weights[2]);
        }
    }
    /* An update by the whole step needs the changed run alone. */
    if (status == OK) {
        status = numerical_equations(numerical, workspace, base * base + squares);
    }
    return status == OK && workspace->shown.rank == 0 ? STILL : status;
}
";

/// Writes the estimator, where it was requested; `run` has the words of the code of every run.
pub(super) fn write(context: &mut Context<'_>, names: &Names<String>, run: &[(&'static str, String)]) {
    if !context.estimator.parts.numerical {
        return;
    }
    let own = [
        ("NUMERICAL", context.global("run_numerical")),
        ("NUMERICAL_BEGIN", context.global("run_numerical_begin")),
        ("NUMERICAL_CHANGE", context.global("run_numerical_change")),
        ("SIXTEEN", context.scalar.literal(16.0)),
    ];
    let words: Vec<(&'static str, String)> = own.into_iter().chain(run.iter().cloned()).collect();
    let header = filled(HEADER, &words);
    context.header.push_str(&header);
    let source = filled(SOURCE, &words);
    context.source.push_str(&source);
    let (status, numerical, real) =
        (context.global("run_status"), context.global("run_numerical"), context.scalar.name());
    let runs = format!("const {} *run, const {} *reference", context.global("run"), context.global("run_reference"));
    let begin = format!("{status} {}({numerical} *numerical, {runs})", context.global("run_numerical_begin"));
    let about =
        doc(0, &format!("Begins with a run. {NUMERICAL} With another status than the first nothing has changed."));
    context.header.push_str(&format!("\n{about}{begin};\n"));
    let name = context.global("run_numerical_change");
    let change = format!("{status} {name}({numerical} *numerical, size_t parameter, {real} step,\n        {runs})");
    let about = doc(
        0,
        "Takes in a run in whose feed-forward one parameter, by its place among the names of the parameters, is larger by a step; all else \
         is as in the first run. A second run with the opposite step takes the bend of the response out of the first one's difference; any \
         other takes the place of what was there. The tracking error must differ from that of the first run by far more than noise, and yet \
         in proportion to the step, or by a parabola where both directions are played.",
    );
    context.header.push_str(&format!("\n{about}{change};\n"));
    identify(context, names);
}

/// The function that gives the estimate.
fn identify(context: &mut Context<'_>, names: &Names<String>) {
    let scalar = context.scalar;
    let (real, zero, one, ok) = (scalar.name(), context.zero(), scalar.literal(1.0), context.constant("RUN_OK"));
    let (status, sqrt) = (context.global("run_status"), scalar.function("sqrt"));
    let list = [
        Parameter::new(format!("const {} *numerical", context.global("run_numerical"))),
        Parameter::new(format!("{} *workspace", context.global("run_workspace"))),
        Parameter::new(format!("const {} *played", context.global("run_parameters"))),
        Parameter::new(format!("{} *estimate", context.global("run_estimate"))),
    ];
    let mut body = format!("    {status} status;\n    {real} freedom, factor;\n\n");
    for (index, name) in names.columns.iter().enumerate() {
        body.push_str(&statement(1, &format!("workspace->prior[{index}] = played->{name};")));
    }
    body.push_str(&format!(
        "    status = numerical_update(numerical, workspace);
    if (status != {ok}) {{
        return status;
    }}
    freedom = workspace->factor.rows - ({real})workspace->shown.rank;
    estimate->rank = workspace->shown.rank;
    estimate->condition = workspace->shown.condition;
    estimate->chi_squared = freedom > {zero} ? workspace->shown.residual * workspace->shown.residual / freedom : {zero};
    factor = estimate->chi_squared > {one} ? estimate->chi_squared : {one};
    run_fill(workspace, factor, estimate);
"
    ));
    for (index, names) in names.coordinates.iter().enumerate() {
        let level = format!("numerical_variance(numerical, {index}) * numerical->behind");
        body.push_str(&statement(1, &format!("estimate->noise.{} = {sqrt}({level});", names.field)));
    }
    body.push_str(&format!("    return {ok};\n"));
    let about = "What the runs say of the parameters; `played` were those of the first run's feed-forward. A parameter that was not changed \
                 stays as it was played, and gets no number. Only with the first status is anything written to `estimate`.";
    let name = context.global("run_numerical_identify");
    context.function(&name, about, &status, &list, &body);
}
