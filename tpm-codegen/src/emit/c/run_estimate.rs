//! The estimate of a run in C: its structure, and the function that gives it by the model's own names.

use super::super::names::Names;
use super::super::run::ABOUT;
use super::context::{Context, Parameter};
use super::layout::{doc, statement};
use super::requested;
use super::support;

/// The functions of the controller's code that the estimate calls.
struct Calls {
    update: String,
    chi_squared: String,
    behind: String,
}

/// The structure of an estimate, and the function that gives it.
pub(super) fn estimate(context: &mut Context<'_>, names: &Names<String>) {
    let (real, size) = (context.scalar.name(), context.constant("RUN_PARAMETERS"));
    let (parameters, measured) = (context.global("run_parameters"), context.global("run_measured"));
    let field = |about: &str, declaration: String| format!("{}    {declaration};\n", doc(1, about));
    let fields = [
        field("The parameters; not a number where the run does not show them.", format!("{parameters} parameters")),
        field("Their standard deviations.", format!("{parameters} deviations")),
        field(
            "Their covariance in the order of the fields; zero for those that the run does not show.",
            format!("{real} covariance[{size}][{size}]"),
        ),
        field("For each parameter whether the run shows it.", format!("bool shown[{size}]")),
        field(
            "A row for every parameter that leads a combination which the run shows: the weights of all parameters in it, one at its own. \
             A shown parameter is a combination of itself alone; the others lead none.",
            format!("{real} combinations[{size}][{size}]"),
        ),
        field(
            "The values of the combinations and their standard deviations; not a number where there is none.",
            format!("{real} combined[{size}][2]"),
        ),
        field("The number of directions that the run shows.", "int rank".to_owned()),
        field("At least the condition number of what is shown, and at most the rank times that.", format!("{real} condition")),
        field(
            "Weighted sum of squares of what the equations leave, over its degrees of freedom: about one where the machine obeys them. \
             Where it is larger, the deviations are those of the noise times its root.",
            format!("{real} chi_squared"),
        ),
        field("Standard deviation of the noise in the samples of every coordinate.", format!("{measured} noise")),
    ]
    .concat();
    context.structure("run_estimate", "What a run says of the parameters.", &fields);
    fill(context, names);
    let (workspace, lines) = (support::workspace(context), support::sizes(context, &["RUN_CHANNELS", "RUN_LINES"]));
    let calls = support::write(context, &support::RUN, |translator| {
        Ok(Calls {
            update: translator.method("RunWorkspace", &workspace, "update")?,
            chi_squared: translator.method("RunWorkspace", &workspace, "chi_squared")?,
            behind: translator.method("RunLines", &lines, "samples_behind_line")?,
        })
    });
    let about = "What the run says of the parameters; `prior` has the present estimates, at which weights begin. Only with the first status is\n\
                 anything written to `estimate`.";
    let (name, status) = (context.global("run_identify"), context.global("run_status"));
    let body = solution(context, names, &calls, [&calls.update, ""]);
    context.function(&name, about, &status, &parameter_list(context, false), &body);
    if context.estimator.parts.linearised {
        let update = support::write(context, &support::RUN, |translator| {
            translator.method("RunWorkspace", &workspace, "update_about")
        });
        let about = format!("{ABOUT} Only with the first status is anything written to `estimate`.");
        let body = solution(context, names, &calls, [&update, ", reference, which"]);
        let name = context.global("run_identify_about");
        context.function(&name, &about, &status, &parameter_list(context, true), &body);
    }
}

/// The parameters of the function that gives the estimate, about a reference or along the measured motion.
fn parameter_list(context: &Context<'_>, about: bool) -> Vec<Parameter> {
    let mut list = vec![
        Parameter::new(format!("const {} *run", context.global("run"))),
        Parameter::new(format!("{} *workspace", context.global("run_workspace"))),
    ];
    list.extend(context.constants_parameter(true));
    if about {
        list.push(Parameter::new(format!("const {} *reference", context.global("run_reference"))));
        list.push(Parameter::new(format!("{} which", context.global("run_linearisation"))));
    }
    list.push(Parameter::new(format!("const {} *prior", context.global("run_parameters"))));
    list.push(Parameter::new(format!("{} *estimate", context.global("run_estimate"))));
    list
}

/// The steps from a run to an estimate, by an update with further arguments.
fn solution(context: &Context<'_>, names: &Names<String>, calls: &Calls, [update, arguments]: [&str; 2]) -> String {
    let (ok, sqrt) = (context.constant("RUN_OK"), context.scalar.function("sqrt"));
    let mut body = format!("    {} status;\n\n", context.global("run_status"));
    for (index, name) in names.columns.iter().enumerate() {
        body.push_str(&statement(1, &format!("workspace->prior[{index}] = prior->{name};")));
    }
    let constants = context.constants_argument();
    let call = format!("{update}(workspace{constants}, &run->lines, &run->passed, &run->sampling{arguments});");
    body.push_str(&statement(1, &format!("status = {call}")));
    body.push_str(&format!(
        "    if (status != {ok}) {{
        return status;
    }}
    run_fill(&workspace->found, workspace->about, {chi_squared}(workspace), estimate);
",
        chi_squared = calls.chi_squared
    ));
    for (index, names) in names.coordinates.iter().enumerate() {
        let level = format!("workspace->sensors[{index}] * {}(&run->lines)", calls.behind);
        body.push_str(&statement(1, &format!("estimate->noise.{} = {sqrt}({level});", names.field)));
    }
    body.push_str(&format!("    return {ok};\n"));
    body
}

/// The function that gives what a solution shows, for the step from some parameters, their names.
fn fill(context: &mut Context<'_>, names: &Names<String>) {
    let parts = ["run_solution", "run_estimate", "RUN_PARAMETERS"];
    let of_size = support::sizes(context, &["RUN_PARAMETERS"]);
    let combined =
        support::write(context, &support::RUN, |translator| translator.method("Solution", &of_size, "combined"));
    let value = |index: usize| format!("about[{index}] + found->values[{index}]");
    let text = filling(context, "run_fill", parts, &names.columns, value, Some(&combined));
    context.source.push_str(&text);
}

/// A function that gives what a solution shows, for the step from some parameters, to an estimate of so many. Deviations are those of the
/// noise times the root of chi^2 where that is above one.
pub(super) fn filling(
    context: &Context<'_>,
    function: &str,
    [found, estimate, size]: [&str; 3],
    names: &[String],
    value: impl Fn(usize) -> String,
    combined: Option<&str>,
) -> String {
    let (real, size, one) = (context.scalar.name(), context.constant(size), context.scalar.literal(1.0));
    let mut text = format!(
        "\n/* What a solution shows, for the step from some parameters. */\nstatic void {function}(const {found} *found, const {real} about[{size}], {real} chi_squared, {estimate} *estimate)
{{
    const {real} factor = chi_squared > {one} ? chi_squared : {one};

    estimate->rank = (int)found->rank;
    estimate->condition = found->condition;
    estimate->chi_squared = chi_squared;
    for (size_t i = 0; i < (size_t){size}; ++i) {{
        for (size_t j = 0; j < (size_t){size}; ++j) {{
            estimate->covariance[i][j] = found->covariance[i][j] * factor;
        }}
    }}
",
        found = context.global(found),
        estimate = context.global(estimate),
    );
    let sqrt = context.scalar.function("sqrt");
    if let Some(combined) = combined {
        let zero = context.zero();
        text.push_str(&format!(
            "    for (size_t i = 0; i < (size_t){size}; ++i) {{
        const bool is = found->combinations[i][i] > {zero};
        for (size_t j = 0; j < (size_t){size}; ++j) {{
            estimate->combinations[i][j] = found->combinations[i][j];
        }}
        estimate->combined[i][0] = is ? {combined}(found, about, i) : ({real})NAN;
        estimate->combined[i][1] = is ? found->deviations[i] * {sqrt}(factor) : ({real})NAN;
    }}
"
        ));
    }
    text.push_str(&requested::shown(context, names, &value, &format!(" * {sqrt}(factor)")));
    text.push_str("}\n");
    text
}
