//! C code of the estimators that are linearised about the reference of a run, before names and sizes are filled in, and what it adds to
//! the code of every run.
//!
//! Invariant: the method is that of `tpm_controller::support` (`run_linearised`), in the caller's memory.

use super::super::run::{ABOUT, REFERENCE};
use super::context::{Context, Parameter};
use super::layout::{doc, statement};

/// What stands in the code of every run where these estimators were requested, and what stands there otherwise.
const ADDITIONS: [(&str, [&str; 2]); 6] = [
    (
        "    PATH_FIELDS\n",
        [
            "    /* Harmonics of the motion along which the equations are evaluated: the measured one, or the reference. */
    PHASOR path[COORDINATES][LINES];
    /* Harmonics of what the tracking error makes of the equations, and of what is left of them along the measured motion. */
    PHASOR response[ROWS][LINES];
    PHASOR whole[ROWS][LINES];
",
            "",
        ],
    ),
    ("ABOUT_PARAMETERS", [", const REFERENCE *reference, LINEARISATION which", ""]),
    (
        "    BEGIN_PATH\n",
        [
            "    status = run_begin_path(run, workspace, reference);
    if (status != OK) {
        return status;
    }
",
            "",
        ],
    ),
    (
        "        RESPOND\n",
        [
            "        if (reference != NULL) {
            run_respond(workspace, which, w);
            run_linearise(workspace, w, 0ARGUMENT);
        }
",
            "",
        ],
    ),
    (
        "        LINEARISE\n",
        [
            "        if (reference != NULL) {
            run_linearise(workspace, w, 1ARGUMENT);
        }
",
            "",
        ],
    ),
    // Behind the marks that contain it.
    ("PATH", ["path", "motion"]),
];

/// The code of a run with what these estimators add to it, or without.
pub(super) fn with_additions(text: &str, linearised: bool) -> String {
    let fill = |text: String, (mark, [with, without]): &(&str, [&str; 2])| {
        text.replace(mark, if linearised { with } else { without })
    };
    ADDITIONS.iter().fold(text.to_owned(), fill)
}

/// Declarations behind those of every run.
pub(super) const HEADER: &str = "
/* How much of the derivatives along the reference is taken into account. */
typedef enum LINEARISATION {
    /* Their means (estimator `error`). */
    LINEARISED_ERROR,
    /* The whole of them, which couples harmonics (estimator `hill`). */
    LINEARISED_HILL
} LINEARISATION;
";

/// The declaration of a reference.
pub(super) const REFERENCE_HEADER: &str = "
/* ABOUT_REFERENCE */
typedef struct REFERENCE {
    STATUS status;
    uint32_t samples_per_period;
    uint32_t count;
    PHASOR lines[COORDINATES][LINES];
} REFERENCE;
";

/// The code of a reference.
pub(super) const REFERENCE_SOURCE: &str = "
STATUS REFERENCE_BEGIN(REFERENCE *reference, uint32_t samples_per_period)
{
    size_t coordinate, line;

    reference->status = samples_per_period > LINES ? OK : SAMPLES;
    reference->samples_per_period = samples_per_period;
    reference->count = 0;
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        for (line = 0; line < LINES; ++line) {
            reference->lines[coordinate][line] = run_phasor(ZERO, ZERO);
        }
    }
    return reference->status;
}

/* Takes in the coordinates of a sample of the reference. */
static STATUS run_take_reference(REFERENCE *reference, uint32_t number, const REAL values[COORDINATES])
{
    size_t coordinate, harmonic;
    PHASOR step;

    if (reference->status != OK || reference->count >= reference->samples_per_period) {
        return reference->status;
    }
    if (number != reference->count) {
        reference->status = MISSED;
    }
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        if (reference->status == OK && !(FABS(values[coordinate]) <= MAX)) {
            reference->status = NOT_FINITE;
        }
    }
    if (reference->status != OK) {
        return reference->status;
    }
    step = run_conjugate(run_turn(run_angle(number, reference->samples_per_period)));
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        PHASOR turned = run_phasor(values[coordinate] / (REAL)reference->samples_per_period, ZERO);
        for (harmonic = 0; harmonic < LINES / 2; ++harmonic) {
            run_add(&reference->lines[coordinate][2 * harmonic], harmonic == 0 ? turned : run_scaled(turned, TWO));
            turned = run_times(turned, step);
        }
    }
    ++reference->count;
    return OK;
}

/* Whether a reference is whole, and has the period of a run. */
static STATUS run_check_reference(const RUN *run, const REFERENCE *reference)
{
    if (reference->status != OK) {
        return reference->status;
    }
    if (reference->samples_per_period != run->samples_per_period) {
        return SAMPLES;
    }
    return reference->count < reference->samples_per_period ? UNFINISHED : OK;
}
";

/// The code behind that of the noise.
pub(super) const SOURCE: &str = "
/* The motion along which the equations are evaluated. */
static STATUS run_begin_path(const RUN *run, WORKSPACE *workspace, const REFERENCE *reference)
{
    const STATUS status = reference != NULL ? run_check_reference(run, reference) : OK;
    size_t coordinate, line;

    if (status != OK) {
        return status;
    }
    for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
        for (line = 0; line < LINES; ++line) {
            workspace->path[coordinate][line] =
                    reference != NULL ? reference->lines[coordinate][line] : workspace->motion[coordinate][line];
        }
    }
    return OK;
}

/* Harmonics of what the tracking error makes of the rows, from their derivatives as they are now. */
static void run_respond(WORKSPACE *workspace, LINEARISATION which, REAL w)
{
    const int harmonics = (int)LINES / 2;
    size_t row, coordinate;
    int harmonic, source;

    for (row = 0; row < ROWS; ++row) {
        for (harmonic = 0; harmonic < harmonics; ++harmonic) {
            PHASOR sum = run_phasor(ZERO, ZERO);
            for (coordinate = 0; coordinate < COORDINATES; ++coordinate) {
                for (source = 1 - harmonics; source < harmonics; ++source) {
                    const size_t line = (size_t)(2 * (source < 0 ? -source : source));
                    PHASOR error = workspace->motion[coordinate][line];
                    PHASOR through;
                    if (which == LINEARISED_ERROR && source != harmonic) {
                        continue;
                    }
                    through = run_through(workspace, row, coordinate, 2 * harmonic, harmonic - source, w);
                    run_subtract(&error, workspace->path[coordinate][line]);
                    /* A mean stands for itself, any other phasor for itself and its conjugate. */
                    error = source == 0 ? run_scaled(error, TWO) : error;
                    run_add(&sum, run_times(through, source < 0 ? run_conjugate(error) : error));
                }
            }
            workspace->response[row][2 * harmonic] = run_scaled(sum, harmonic == 0 ? ONE / TWO : ONE);
        }
    }
}

/*
 * Takes the response to the tracking error off what the rows leave along the reference. What it leaves out of the rows along
 * the measured motion joins the noise of the forces.
 */
static void run_linearise(WORKSPACE *workspace, REAL w, int weighedCONSTANTS)
{
    size_t row, line, point;

    for (row = 0; row < ROWS; ++row) {
        for (line = 0; line < LINES; line += 2) {
            run_subtract(&workspace->rest[row][line], workspace->response[row][line]);
            workspace->whole[row][line] = run_phasor(ZERO, ZERO);
        }
    }
    if (!weighed) {
        return;
    }
    for (point = 0; point < POINTS; ++point) {
        const PHASOR turn = run_point(point);
        REAL motion[ENTRIES];
        run_motion_at(workspace->motion, turn, w, motion);
        run_add_rest(workspace, motion, turn, w, workspace->wholeARGUMENT);
    }
    for (row = 0; row < ROWS; ++row) {
        REAL missed = ZERO;
        for (line = 0; line < LINES; line += 2) {
            PHASOR apart = workspace->rest[row][line];
            REAL square;
            run_subtract(&apart, workspace->whole[row][line]);
            square = run_square(apart);
            missed = square > missed ? square : missed;
        }
        workspace->forces[row] += missed;
    }
}
";

/// Declares and writes the functions of the reference that the caller names by the model's own names; `fields` are the coordinates of a
/// sample.
pub(super) fn functions(context: &mut Context<'_>, fields: &[String]) {
    let (status, reference) = (context.global("run_status"), context.global("run_reference"));
    let begin = format!(
        "{status} {}({reference} *reference, uint32_t samples_per_period)",
        context.global("run_reference_begin")
    );
    let about = doc(0, "Before the first sample of the reference of a run with so many samples in a period.");
    context.header.push_str(&format!("\n{about}{begin};\n"));
    let list: Vec<String> = fields.iter().map(|field| format!("sample->{field}")).collect();
    let real = context.scalar.name();
    let mut body = statement(
        1,
        &format!("const {real} values[{}] = {{{}}};", context.constant("RUN_COORDINATES"), list.join(", ")),
    );
    body.push_str("\n    return run_take_reference(reference, number, values);\n");
    let parameters = [
        Parameter::new(format!("{reference} *reference")),
        Parameter::new("uint32_t number"),
        Parameter::new(format!("const {} *sample", context.global("run_measured"))),
    ];
    let about = "Takes in the reference of sample `number`, counted as the samples of the run are; samples behind the first period are not\n\
                 used. A status other than the first stays until the reference is begun again.";
    let name = context.global("run_reference_push");
    context.function(&name, about, &status, &parameters, &body);
}

/// The words of this code.
pub(super) fn words(context: &Context<'_>) -> Vec<(&'static str, String)> {
    let types = [
        ("REFERENCE", "run_reference"),
        ("REFERENCE_BEGIN", "run_reference_begin"),
        ("LINEARISATION", "run_linearisation"),
    ];
    let mut words: Vec<(&'static str, String)> = types.map(|(name, own)| (name, context.global(own))).into();
    let values = [("LINEARISED_ERROR", "RUN_ERROR"), ("LINEARISED_HILL", "RUN_HILL")];
    words.extend(values.map(|(name, own)| (name, context.constant(own))));
    words.push(("ABOUT_REFERENCE", REFERENCE.to_owned()));
    words
}

/// The documentation of the function that gives the estimate.
pub(super) fn about() -> String {
    format!("{ABOUT} Only with the first status is anything written to `estimate`.")
}
