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
use super::dynamics::size_macro;
use super::expression::Writer;
use super::layout::{doc, statement, string};
use super::run_estimate::estimate;
use super::{run_numerical, run_physical, run_reference, support};

/// The functions of the controller's code that take in samples.
struct Calls {
    begin: String,
    passed_begin: String,
    push: String,
    passed_push: String,
    fail: String,
    whole: String,
    finished: String,
}

/// Writes the estimator, where it was requested.
pub(super) fn write(context: &mut Context<'_>) {
    let Some(plan) = RunPlan::of(context.estimator) else { return };
    let names = names(&plan);
    sizes(context, &plan);
    records(context, &plan, &names);
    rows(context, &plan);
    let (channels, inputs) =
        (support::sizes(context, &["RUN_CHANNELS", "RUN_LINES"]), support::sizes(context, &["RUN_INPUTS"]));
    let workspace = support::workspace(context);
    let calls = support::write(context, &support::RUN, |translator| {
        translator.structure("RunWorkspace", &workspace)?;
        translator.structure("RunSampling", &[])?;
        let mut of_lines = |name| translator.method("RunLines", &channels, name);
        let (begin, push, fail) = (of_lines("begin")?, of_lines("push")?, of_lines("fail")?);
        let (whole, finished) = (of_lines("is_whole")?, of_lines("finished")?);
        Ok(Calls {
            begin,
            push,
            fail,
            whole,
            finished,
            passed_begin: translator.method("RunPassed", &inputs, "begin")?,
            passed_push: translator.method("RunPassed", &inputs, "push")?,
        })
    });
    functions(context, &names, &calls);
    if plan.takes_reference(context.estimator) {
        run_reference::write(context, &names);
    }
    estimate(context, &names);
    run_numerical::write(context, &names);
    run_physical::write(context, &plan, &names);
    campaign::write(context, &plan, &names);
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

/// The rows along a motion, and what its entries are.
fn rows(context: &mut Context<'_>, plan: &RunPlan<'_>) {
    let real = context.scalar.name();
    let entries = context.constant("RUN_ENTRIES");
    let list = |of: &dyn Fn(&(usize, u32)) -> String| plan.motion.iter().map(of).collect::<Vec<_>>().join(", ");
    let (coordinates, orders) = (list(&|(place, _)| place.to_string()), list(&|(_, order)| order.to_string()));
    let mut text = format!(
        "\n/* Coordinate and derivative of every entry of a motion. */\nstatic const size_t run_coordinate[{entries}] = {{{coordinates}}};\n\
         static const uint32_t run_order[{entries}] = {{{orders}}};\n"
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
    // What is zero at every motion is zero before the call.
    for (name, steps) in &steps {
        if steps.is_empty() {
            text.push_str(&format!("    (void){name};\n"));
            continue;
        }
        let place = |place: Place| match place {
            Place::Entry(row, column) => format!("{name}[{row}][{column}]"),
            Place::Value(row) => format!("{name}[{row}]"),
        };
        // Each matrix has intermediate results of its own.
        text.push_str("    {\n");
        context.statements(steps, &writer, place).lines().for_each(|line| text.push_str(&format!("    {line}\n")));
        text.push_str("    }\n");
    }
    text.push_str("}\n");
    context.source.push_str(&text);
}

/// The functions that the caller names by the model's own names.
fn functions(context: &mut Context<'_>, names: &Names<String>, calls: &Calls) {
    let (run, status) = (context.global("run"), context.global("run_status"));
    let types = ["run_sampling", "run_applied", "run_lines", "run_passed"].map(|name| context.global(name));
    let [sampling, applied, lines, passed] = &types;
    let fields = format!(
        "    {sampling} sampling;\n    {applied} limits;\n    bool limited;\n    {lines} lines;\n    {passed} passed;\n"
    );
    let about = "The samples of a run: how they are taken, the limits of the inputs where they are known, the lines of every channel, and what \
                 the inputs hold above them.";
    context.structure("run", about, &fields);
    let pointer = Parameter::new(format!("{run} *run"));
    let about = format!(
        "Before the first sample of a run of so many periods. {ESTIMATOR}\n\nSamples of a period divide it evenly. Inputs whose size reaches \
         their limit end the run; `limits` may be null."
    );
    let list = [
        pointer.clone(),
        Parameter::new("uint32_t samples_per_period"),
        Parameter::new("uint32_t periods"),
        Parameter::new(format!("const {sampling} *sampling")),
        Parameter::new(format!("const {applied} *limits")),
    ];
    let body = format!(
        "    run->sampling = *sampling;
    run->limited = limits != NULL;
    if (limits != NULL) {{
        run->limits = *limits;
    }}
    {passed}(&run->passed, samples_per_period, {lines});
    return {begin}(&run->lines, samples_per_period, periods);
",
        passed = calls.passed_begin,
        lines = context.constant("RUN_LINES"),
        begin = calls.begin,
    );
    context.function(&context.global("run_begin"), &about, &status, &list, &body);
    let whole = format!("    return {}(&run->lines) == {};\n", calls.finished, context.constant("RUN_OK"));
    let about = "Whether all samples of the run were taken in.";
    let read = [Parameter::new(format!("const {run} *run"))];
    context.function(&context.global("run_is_whole"), about, "bool", &read, &whole);
    let stop = format!("    {}(&run->lines, {});\n", calls.fail, context.constant("RUN_UNFINISHED"));
    let about = "Ends the run, which then gives no parameter: the machine stopped, or did something else.";
    context.function(&context.global("run_stop"), about, "void", &[pointer], &stop);
    push(context, names, calls);
}

/// The function that processes a sample.
fn push(context: &mut Context<'_>, names: &Names<String>, calls: &Calls) {
    let (real, scalar) = (context.scalar.name(), context.scalar);
    let measured = names.coordinates.iter().map(|names| format!("sample->measured.{}", names.field));
    let channels = measured.chain(names.inputs.iter().map(|(_, name)| format!("sample->applied.{name}")));
    let channels: Vec<String> = channels.collect();
    let mut body = statement(
        1,
        &format!("const {real} channels[{}] = {{{}}};", context.constant("RUN_CHANNELS"), channels.join(", ")),
    );
    let fabs = scalar.function("fabs");
    let limits = names.inputs.iter().map(|(_, name)| format!("{fabs}(sample->applied.{name}) >= run->limits.{name}"));
    let limits: Vec<String> = limits.collect();
    let (whole, status, ok) = (&calls.whole, context.global("run_status"), context.constant("RUN_OK"));
    body.push_str(&statement(1, &format!("const bool belongs = !{whole}(&run->lines);")));
    body.push_str(&statement(1, &format!("{status} status;")));
    body.push('\n');
    body.push_str(&statement(1, &format!("if (run->limited && ({})) {{", limits.join(" || "))));
    body.push_str(&format!(
        "        {fail}(&run->lines, {saturated});
    }}
    status = {push}(&run->lines, number, channels);
    if (status == {ok} && belongs) {{
        {passed}(&run->passed, &channels[{coordinates}]);
    }}
    return status;
",
        fail = calls.fail,
        saturated = context.constant("RUN_SATURATED"),
        push = calls.push,
        passed = calls.passed_push,
        coordinates = context.constant("RUN_COORDINATES"),
    ));
    let parameters = [
        Parameter::new(format!("{} *run", context.global("run"))),
        Parameter::new("uint32_t number"),
        Parameter::new(format!("const {} *sample", context.global("run_sample"))),
    ];
    let about = "Takes in sample `number`, counted from 0 at the beginning of a period of a motion that has settled. A sample that cannot be\n\
                 used ends the run: its status stays until the next run begins, and no parameter is given. Samples behind the end of the run\n\
                 are not used.";
    context.function(&context.global("run_push"), about, &status, &parameters, &body);
}
