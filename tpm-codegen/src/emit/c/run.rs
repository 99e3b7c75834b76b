//! The estimator of a run: its structures, its rows, and the code that all models share.

use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::Place;
use super::super::name::Language;
use super::super::name::Namer;
use super::super::names::{Names, Style};
use super::super::run::{ESTIMATOR, PARAMETERS, RunPlan, SAMPLE};
use super::super::text;
use super::campaign;
use super::context::{Context, Parameter};
use super::dynamics::{size_macro, stored};
use super::expression::{Scalar, Writer};
use super::layout::{doc, statement, string};
use super::requested::SQUARE_ROOT;
use super::run_along::ALONG;
use super::run_equations::EQUATIONS;
use super::run_estimate::estimate;
use super::run_linearised;
use super::run_means::{MEANS, PASSED};
use super::run_noise::NOISE;
use super::run_numerical;
use super::run_physical;
use super::run_source::{HEADER, LINES};
use super::solve::filled;

/// Writes the estimator, where it was requested.
pub(super) fn write(context: &mut Context<'_>) {
    let Some(plan) = RunPlan::of(context.estimator) else { return };
    let names = names(&plan);
    sizes(context, &plan);
    records(context, &plan, &names);
    let words = words(context);
    let linearised = context.estimator.parts.linearised;
    let arguments = |text: &str| {
        let text = run_linearised::with_additions(text, linearised);
        let constants = match context.has_constants() {
            true => format!(", const {} *constants", context.global("constants")),
            false => String::new(),
        };
        filled(&text.replace("CONSTANTS", &constants).replace("ARGUMENT", context.constants_argument()), &words)
    };
    let mut header = arguments(HEADER);
    let takes_reference = plan.takes_reference(context.estimator);
    let (mut reference, mut about_reference) = (String::new(), String::new());
    if takes_reference {
        header.push_str(&arguments(run_linearised::REFERENCE_HEADER));
        reference = arguments(run_linearised::REFERENCE_SOURCE);
    }
    if linearised {
        header.push_str(&arguments(run_linearised::HEADER));
        about_reference = arguments(run_linearised::SOURCE);
    }
    let with_passed = LINES.replace("PASSED_SOURCE\n", PASSED.trim_start());
    let [lines, along, noise, means, equations] = [with_passed.as_str(), ALONG, NOISE, MEANS, EQUATIONS].map(arguments);
    // The solver of base parameters is the same; its last function ends where parameters are given their names.
    let solver = SQUARE_ROOT.replace("\nSTATUS SOLVE", "\nstatic void SOLVE").replace("WORKSPACE", "SOLUTION");
    let solver = format!("{}}}\n", filled(&solver, &words));
    context.header.push_str(&header);
    context.source.push_str(&lines);
    rows(context, &plan);
    for text in [along, noise, means, reference, about_reference, solver, equations] {
        context.source.push_str(&text);
    }
    functions(context, &plan, &names);
    run_numerical::write(context, &names, &words);
    run_physical::write(context, &plan, &names, &words);
    campaign::write(context, &plan, &names, &words);
}

/// The names of the declared equations.
fn names(plan: &RunPlan<'_>) -> Names<String> {
    let mut types = Namer::new(Language::C, &[]);
    let mut style = Style {
        language: Language::C,
        type_name: &mut |wanted, suffix| types.name(&format!("{wanted}_{suffix}")),
        reserved: &[],
    };
    Names::new(&mut style, &plan.source.model, &plan.source.form, &plan.source.plan)
}

fn sizes(context: &mut Context<'_>, plan: &RunPlan<'_>) {
    let evaluation = &plan.source.plan.evaluation;
    let (coordinates, inputs) = (evaluation.coordinates.len(), evaluation.inputs.len());
    let list = [
        ("RUN_COORDINATES", coordinates, "Measured coordinates of a run."),
        ("RUN_INPUTS", inputs, "Inputs of a run."),
        ("RUN_CHANNELS", coordinates + inputs, "Both together."),
        ("RUN_EQUATIONS", plan.source.form.rows.len(), "Equations as they were declared."),
        ("RUN_PARAMETERS", plan.source.form.columns.len(), "Parameters in them."),
        ("RUN_ENTRIES", plan.motion.len(), "Coordinates and derivatives in them."),
        (
            "RUN_LINES",
            plan.lines(),
            "Lines of a channel: harmonics from the mean on, and the lines halfway behind each.",
        ),
        ("RUN_ALL_EQUATIONS", plan.equations(), "Equations at all harmonics."),
        ("RUN_COVARIANCES", plan.covariances(), "Covariances of them."),
        ("RUN_POINTS", plan.points, "Points of a period at which the equations are evaluated."),
    ];
    let sizes: String = list.into_iter().map(|(name, size, about)| size_macro(context, name, size, about)).collect();
    context.header.push_str(&format!("\n{sizes}"));
}

fn records(context: &mut Context<'_>, plan: &RunPlan<'_>, names: &Names<String>) {
    let source = plan.source;
    let measured = names.coordinates.iter();
    let measured: Vec<(String, String)> =
        measured.map(|names| (names.field.clone(), text::derivative(source, names.coordinate, 0))).collect();
    context.record("run_measured", "The measured coordinates, or the noise of each.", &measured);
    let applied = names.inputs.iter().map(|(symbol, name)| (name.clone(), text::quantity(source, *symbol)));
    let applied: Vec<(String, String)> = applied.collect();
    context.record("run_applied", "The inputs as they are applied.", &applied);
    let fields =
        format!("    {} measured;\n    {} applied;\n", context.global("run_measured"), context.global("run_applied"));
    context.structure("run_sample", SAMPLE, &fields);
    let columns = names.columns.iter().enumerate();
    let columns: Vec<(String, String)> =
        columns.map(|(index, name)| (name.clone(), text::column(source, index))).collect();
    context.record("run_parameters", PARAMETERS, &columns);
    let declaration =
        format!("const char *const {}[{}]", context.global("run_parameter_names"), context.constant("RUN_PARAMETERS"));
    let about = doc(0, "Names of the parameters in the order of the fields.");
    context.header.push_str(&format!("\n{about}extern {declaration};\n"));
    let list: Vec<String> = source.form.columns.iter().map(|column| string(&column.name)).collect();
    context.source.push_str(&format!("\n{declaration} = {{{}}};\n", list.join(", ")));
}

/// What the names in capitals of the shared code stand for.
fn words(context: &Context<'_>) -> Vec<(&'static str, String)> {
    let scalar = context.scalar;
    let (max, turn) = match scalar {
        Scalar::Float => ("FLT_MAX", "6.2831855f"),
        Scalar::Double => ("DBL_MAX", "6.283185307179586"),
    };
    let mut words = vec![
        ("REAL", scalar.name().to_owned()),
        ("MAX", max.to_owned()),
        ("EPSILON", scalar.epsilon().to_owned()),
        ("TURN", "6.283185307179586".to_owned()),
        ("TURN_REAL", turn.to_owned()),
        ("NOISE_STEPS", "30".to_owned()),
        ("NO_MEANS", "RUN_NO_MEANS".to_owned()),
        ("MEANS_OF_TERMS", "RUN_MEANS_OF_TERMS".to_owned()),
        ("ALL_MEANS", "RUN_ALL_MEANS".to_owned()),
        ("PASSES", "3".to_owned()),
        ("ESTIMATOR", context.global("run_factor")),
        ("ESTIMATE", context.global("run_shown")),
        ("SOLVE", "run_solution_of".to_owned()),
    ];
    let numbers = [
        ("ZERO", 0.0),
        ("ONE", 1.0),
        ("TWO", 2.0),
        ("FOUR", 4.0),
        ("THREE", 3.0),
        ("NINE", 9.0),
        ("LEAST", 1e-8),
        ("BEGINNING", 0.6),
        ("FLAT", 1.847_759_065_022_573_5),
        ("SHARP", 0.765_366_864_730_179_6),
        ("KNOWN", 4e-4),
        ("FORCE", 1e-7),
        ("STEP", 1e-2),
        ("MIXING", 1e-6),
        ("VISIBLE", 16.0),
        ("ROUNDINGS", 256.0),
    ];
    words.extend(numbers.map(|(name, value)| (name, scalar.literal(value))));
    let functions = [("FABS", "fabs"), ("SQRT", "sqrt"), ("SIN", "sin"), ("COS", "cos"), ("LOG", "log")];
    words.extend(functions.map(|(name, function)| (name, scalar.function(function))));
    let sizes = [
        ("COORDINATES", "RUN_COORDINATES"),
        ("INPUTS", "RUN_INPUTS"),
        ("CHANNELS", "RUN_CHANNELS"),
        ("ROWS", "RUN_EQUATIONS"),
        ("COLUMNS", "RUN_PARAMETERS"),
        ("ENTRIES", "RUN_ENTRIES"),
        ("LINES", "RUN_LINES"),
        ("ALL", "RUN_ALL_EQUATIONS"),
        ("COVARIANCES", "RUN_COVARIANCES"),
        ("POINTS", "RUN_POINTS"),
        ("OK", "RUN_OK"),
        ("SAMPLES", "RUN_SAMPLES"),
        ("PERIODS", "RUN_PERIODS"),
        ("MISSED", "RUN_MISSED"),
        ("NOT_FINITE", "RUN_NOT_FINITE"),
        ("SATURATED", "RUN_SATURATED"),
        ("UNFINISHED", "RUN_UNFINISHED"),
        ("NOT_EVALUATED", "RUN_NOT_EVALUATED"),
        ("STILL", "RUN_STILL"),
        ("APART", "RUN_APART"),
        ("PERTURBATION", "RUN_PERTURBATION"),
    ];
    words.extend(sizes.map(|(name, size)| (name, context.constant(size))));
    let types = [
        ("STATUS", "run_status"),
        ("SAMPLING", "run_sampling"),
        ("PHASOR", "run_phasor"),
        ("RUN", "run"),
        ("APPLIED", "run_applied"),
        ("FACTOR", "run_factor"),
        ("SOLUTION", "run_solution"),
        ("SHOWN", "run_shown"),
        ("WORKSPACE", "run_workspace"),
        ("BEGIN", "run_begin"),
        ("WHOLE", "run_is_whole"),
        ("STOP", "run_stop"),
    ];
    words.extend(types.map(|(name, own)| (name, context.global(own))));
    let own = ["hypotenuse", "rotate_in", "column_length", "remove_part", "back_substitute"];
    words.extend(own.map(|name| (name, format!("run_{name}"))));
    words.extend(run_linearised::words(context));
    words
}

/// The rows along a motion, and what its entries are.
fn rows(context: &mut Context<'_>, plan: &RunPlan<'_>) {
    let real = context.scalar.name();
    let entries = context.constant("RUN_ENTRIES");
    let list = |of: &dyn Fn(&(usize, u32)) -> String| plan.motion.iter().map(of).collect::<Vec<_>>().join(", ");
    let (coordinates, orders) = (list(&|(place, _)| place.to_string()), list(&|(_, order)| order.to_string()));
    let mut text = format!(
        "\n/* Coordinate and derivative of every entry of a motion. */\nstatic const size_t run_coordinate[{entries}] = {{{coordinates}}};\n\
         static const int run_order[{entries}] = {{{orders}}};\n"
    );
    let (steps, reads) = plan.rows();
    let writer = Writer::new(context.scalar, |leaf: &Leaf| match plan.place(leaf) {
        Some(place) => format!("motion[{place}]"),
        None => context.leaf(leaf, "", &[], ""),
    });
    let (rows, columns, inputs) =
        (context.constant("RUN_EQUATIONS"), context.constant("RUN_PARAMETERS"), context.constant("RUN_INPUTS"));
    let constants = match context.has_constants() {
        true => format!(", const {} *constants", context.global("constants")),
        false => String::new(),
    };
    text.push_str(&format!(
        "\n/* The equations along a motion. */\nstatic void run_rows(const {real} motion[{entries}], {real} regressor[{rows}][{columns}],\n        {real} known[{rows}], {real} map[{rows}][{inputs}]{constants})\n{{\n"
    ));
    if !reads.motion {
        text.push_str("    (void)motion;\n");
    }
    if context.has_constants() && !reads.constants {
        text.push_str("    (void)constants;\n");
    }
    let evaluation = &plan.source.plan.evaluation;
    let widths = [Some(plan.source.form.columns.len()), None, Some(evaluation.inputs.len())];
    for ((name, steps), width) in steps.iter().zip(widths) {
        let place = |place: Place| match place {
            Place::Entry(row, column) => format!("{name}[{row}][{column}]"),
            Place::Value(row) => format!("{name}[{row}]"),
        };
        // Each matrix has intermediate results of its own.
        text.push_str("    {\n");
        let zeros = context.zeros(plan.source.form.rows.len(), width, &stored(steps), place);
        let own = format!("{zeros}{}", context.statements(steps, &writer, place));
        own.lines().for_each(|line| text.push_str(&format!("    {line}\n")));
        text.push_str("    }\n");
    }
    text.push_str("}\n");
    context.source.push_str(&text);
}

/// The functions that the caller names by the model's own names, and their declarations.
fn functions(context: &mut Context<'_>, plan: &RunPlan<'_>, names: &Names<String>) {
    let (run, status) = (context.global("run"), context.global("run_status"));
    let declare = |context: &mut Context<'_>, about: &str, signature: &str| {
        context.header.push_str(&format!("\n{}{signature};\n", doc(0, about)));
    };
    let begin = format!(
        "{status} {}({run} *run, uint32_t samples_per_period, uint32_t periods,\n        const {} *sampling, const {} *limits)",
        context.global("run_begin"),
        context.global("run_sampling"),
        context.global("run_applied")
    );
    let about = format!(
        "Before the first sample of a run of so many periods. {ESTIMATOR}\n\nSamples of a period divide it evenly. Inputs whose size reaches \
         their limit end the run; `limits` may be null."
    );
    declare(context, &about, &begin);
    let whole = format!("int {}(const {run} *run)", context.global("run_is_whole"));
    declare(context, "1 when all samples of the run were taken in, otherwise 0.", &whole);
    let stop = format!("void {}({run} *run)", context.global("run_stop"));
    declare(context, "Ends the run, which then gives no parameter: the machine stopped, or did something else.", &stop);
    push(context, names);
    if plan.takes_reference(context.estimator) {
        let fields: Vec<String> = names.coordinates.iter().map(|names| names.field.clone()).collect();
        run_linearised::functions(context, &fields);
    }
    estimate(context, names);
}

/// The function that processes a sample.
fn push(context: &mut Context<'_>, names: &Names<String>) {
    let (real, scalar) = (context.scalar.name(), context.scalar);
    let measured = names.coordinates.iter().map(|names| format!("sample->measured.{}", names.field));
    let channels = measured.chain(names.inputs.iter().map(|(_, name)| format!("sample->applied.{name}")));
    let channels: Vec<String> = channels.collect();
    let mut body = statement(
        1,
        &format!("const {real} channels[{}] = {{{}}};", context.constant("RUN_CHANNELS"), channels.join(", ")),
    );
    let limits = names
        .inputs
        .iter()
        .map(|(_, name)| format!("{}(sample->applied.{name}) >= run->limits.{name}", scalar.function("fabs")));
    let limits: Vec<String> = limits.collect();
    let (ok, saturated) = (context.constant("RUN_OK"), context.constant("RUN_SATURATED"));
    body.push('\n');
    body.push_str(&statement(1, &format!("if (run->limited && run->status == {ok} && ({})) {{", limits.join(" || "))));
    body.push_str(&format!(
        "        run->status = {saturated};\n    }}\n    return run_take(run, number, channels);\n"
    ));
    let parameters = [
        Parameter::new(format!("{} *run", context.global("run"))),
        Parameter::new("uint32_t number"),
        Parameter::new(format!("const {} *sample", context.global("run_sample"))),
    ];
    let about = "Takes in sample `number`, counted from 0 at the beginning of a period of a motion that has settled. A sample that cannot be\n\
                 used ends the run: its status stays until the next run begins, and no parameter is given. Samples behind the end of the run\n\
                 are not used.";
    let (name, status) = (context.global("run_push"), context.global("run_status"));
    context.function(&name, about, &status, &parameters, &body);
}
