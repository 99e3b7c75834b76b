//! The estimate of a run in C: its structure, and the function that gives it by the model's own names.

use super::super::names::Names;
use super::context::{Context, Parameter};
use super::layout::{doc, statement};
use super::run_linearised;

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
        field("For each parameter 1 when the run shows it, otherwise 0.", format!("int shown[{size}]")),
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
    let about = "What the run says of the parameters; `prior` has the present estimates, at which weights begin. Only with the first status is\n\
                 anything written to `estimate`.";
    let (name, status) = (context.global("run_identify"), context.global("run_status"));
    let body = match context.estimator.parts.linearised {
        true => {
            let own = context.global("run_identify_about");
            let list = parameter_list(context, true);
            context.function(
                &own,
                &run_linearised::about(),
                &status,
                &list,
                &solution(context, names, ", reference, which"),
            );
            let constants = context.constants_argument();
            let which = context.constant("RUN_ERROR");
            statement(1, &format!("return {own}(run, workspace{constants}, NULL, {which}, prior, estimate);"))
        }
        false => solution(context, names, ""),
    };
    context.function(&name, about, &status, &parameter_list(context, false), &body);
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

/// The steps from a solved run to an estimate; `about` has the further arguments of the update.
fn solution(context: &Context<'_>, names: &Names<String>, about: &str) -> String {
    let scalar = context.scalar;
    let (real, zero, one, ok) = (scalar.name(), context.zero(), scalar.literal(1.0), context.constant("RUN_OK"));
    let mut body =
        format!("    {} status;\n    {real} freedom, factor;\n    size_t rank;\n\n", context.global("run_status"));
    for (index, name) in names.columns.iter().enumerate() {
        body.push_str(&statement(1, &format!("workspace->prior[{index}] = prior->{name};")));
    }
    body.push_str(&format!(
        "    status = run_update(run, workspace{about}{});
    if (status != {ok}) {{
        return status;
    }}
    rank = (size_t)workspace->shown.rank;
    freedom = workspace->factor.rows - ({real})rank;
    estimate->rank = workspace->shown.rank;
    estimate->condition = workspace->shown.condition;
    estimate->chi_squared = freedom > {zero} ? workspace->shown.residual * workspace->shown.residual / freedom : {zero};
    factor = estimate->chi_squared > {one} ? estimate->chi_squared : {one};
    run_fill(workspace, factor, estimate);
",
        context.constants_argument()
    ));
    let sqrt = scalar.function("sqrt");
    for (index, names) in names.coordinates.iter().enumerate() {
        let level = format!("workspace->sensors[{index}] * run_samples_behind_line(run)");
        body.push_str(&statement(1, &format!("estimate->noise.{} = {sqrt}({level});", names.field)));
    }
    body.push_str(&format!("    return {ok};\n"));
    body
}

/// The function that gives parameters, deviations and covariance of a solution their names; `factor` is that of the covariance.
fn fill(context: &mut Context<'_>, names: &Names<String>) {
    let scalar = context.scalar;
    let (real, size, zero, one) =
        (scalar.name(), context.constant("RUN_PARAMETERS"), context.zero(), scalar.literal(1.0));
    let sqrt = scalar.function("sqrt");
    let mut text = format!(
        "\n/* Parameters, deviations and covariance of the solution in the workspace. */\nstatic void run_fill({workspace} *workspace, {real} factor, {estimate} *estimate)
{{
    {solved} *const solution = &workspace->solution;
    const size_t rank = (size_t)workspace->shown.rank;
    size_t i, j, k;

    for (i = 0; i < {size}; ++i) {{
        estimate->shown[i] = workspace->shown.shown[i];
        solution->solution[i] = solution->column[i];
        for (j = 0; j < {size}; ++j) {{
            estimate->covariance[i][j] = {zero};
        }}
    }}
",
        workspace = context.global("run_workspace"),
        estimate = context.global("run_estimate"),
        solved = context.global("run_solution"),
    );
    for (index, name) in names.columns.iter().enumerate() {
        let value = format!("workspace->about[{index}] + solution->solution[{index}]");
        text.push_str(&statement(1, &format!("estimate->parameters.{name} = {value};")));
    }
    text.push_str(&format!(
        "    /* The columns of the inverse of the triangle. */
    for (k = 0; k < rank; ++k) {{
        for (i = 0; i < rank; ++i) {{
            solution->column[i] = i == k ? {one} : {zero};
        }}
        run_back_substitute(solution, rank, solution->column);
        for (i = 0; i < rank; ++i) {{
            for (j = 0; j < rank; ++j) {{
                const size_t row = solution->order[i];
                const size_t column = solution->order[j];
                if (estimate->shown[row] && estimate->shown[column]) {{
                    estimate->covariance[row][column] += factor * solution->column[i] * solution->column[j]
                            / solution->scale[row] / solution->scale[column];
                }}
            }}
        }}
    }}
    for (i = 0; i < {size}; ++i) {{
        solution->column[i] = estimate->shown[i] ? {sqrt}(estimate->covariance[i][i]) : ({real})NAN;
    }}
"
    ));
    for (index, name) in names.columns.iter().enumerate() {
        text.push_str(&statement(1, &format!("estimate->deviations.{name} = solution->column[{index}];")));
    }
    text.push_str("}\n");
    context.source.push_str(&text);
}
