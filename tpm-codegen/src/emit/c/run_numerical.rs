//! The estimator by differences of runs in C.

use super::super::names::Names;
use super::super::run::NUMERICAL;
use super::context::{Context, Parameter};
use super::layout::statement;
use super::support;

/// Writes the estimator, where it was requested.
pub(super) fn write(context: &mut Context<'_>, names: &Names<String>) {
    if !context.estimator.parts.numerical {
        return;
    }
    let sizes = support::sizes(context, &["RUN_COORDINATES", "RUN_PARAMETERS", "RUN_LINES"]);
    let factor = support::sizes(context, &["RUN_PARAMETERS"]);
    let calls = support::write(context, &support::RUN, |translator| {
        let mut of = |name| translator.method("RunNumerical", &sizes, name);
        let (begin, change, update, variance) = (of("begin")?, of("change")?, of("update")?, of("variance")?);
        Ok([begin, change, update, variance, translator.method("SquareRoot", &factor, "chi_squared")?])
    });
    let [begin, change, update, variance, chi_squared] = &calls;
    let (status, numerical, real) =
        (context.global("run_status"), context.global("run_numerical"), context.scalar.name());
    let pointer = Parameter::new(format!("{numerical} *numerical"));
    let runs = [
        Parameter::new(format!("const {} *run", context.global("run"))),
        Parameter::new(format!("const {} *reference", context.global("run_reference"))),
    ];
    let about = format!("Begins with a run. {NUMERICAL} With another status than the first nothing has changed.");
    let list: Vec<Parameter> = std::iter::once(pointer.clone()).chain(runs.clone()).collect();
    let body = format!("    return {begin}(numerical, &run->lines, reference);\n");
    context.function(&context.global("run_numerical_begin"), &about, &status, &list, &body);
    let about = "Takes in a run in whose feed-forward one parameter, by its place among the names of the parameters, is larger by a step; all else \
                 is as in the first run. A second run with the opposite step takes the bend of the response out of the first one's difference; any \
                 other takes the place of what was there. The tracking error must differ from that of the first run by far more than noise, and yet \
                 in proportion to the step, or by a parabola where both directions are played.";
    let changed = [Parameter::new("size_t parameter"), Parameter::new(format!("{real} step"))];
    let list: Vec<Parameter> = std::iter::once(pointer).chain(changed).chain(runs).collect();
    let body = format!("    return {change}(numerical, parameter, step, &run->lines, reference);\n");
    context.function(&context.global("run_numerical_change"), about, &status, &list, &body);
    let list = [
        Parameter::new(format!("const {numerical} *numerical")),
        Parameter::new(format!("{} *workspace", context.global("run_workspace"))),
        Parameter::new(format!("const {} *played", context.global("run_parameters"))),
        Parameter::new(format!("{} *estimate", context.global("run_estimate"))),
    ];
    let (ok, sqrt) = (context.constant("RUN_OK"), context.scalar.function("sqrt"));
    let mut body = format!("    {status} status;\n\n");
    for (index, name) in names.columns.iter().enumerate() {
        body.push_str(&statement(1, &format!("workspace->about[{index}] = played->{name};")));
    }
    body.push_str(&format!(
        "    status = {update}(numerical, workspace->about, &workspace->factor, &workspace->found);
    if (status != {ok}) {{
        return status;
    }}
    run_fill(&workspace->found, workspace->about, {chi_squared}(&workspace->factor, &workspace->found), estimate);
"
    ));
    for (index, names) in names.coordinates.iter().enumerate() {
        let level = format!("{variance}(numerical, {index}) * numerical->behind");
        body.push_str(&statement(1, &format!("estimate->noise.{} = {sqrt}({level});", names.field)));
    }
    body.push_str(&format!("    return {ok};\n"));
    let about = "What the runs say of the parameters; `played` were those of the first run's feed-forward. A parameter that was not changed \
                 stays as it was played, and gets no number. Only with the first status is anything written to `estimate`.";
    context.function(&context.global("run_numerical_identify"), about, &status, &list, &body);
}
