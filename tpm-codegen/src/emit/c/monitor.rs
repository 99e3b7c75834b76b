//! The watch over a machine's base parameters, as C.

use super::super::requested;
use super::context::{Context, Parameter};
use super::dynamics::{matrix, size_macro};
use super::layout::{doc, statement};
use super::support;

/// Writes types and functions, where the monitor was asked for.
pub(super) fn write(context: &mut Context<'_>) {
    if !context.estimator.parts.monitor {
        return;
    }
    let scalar = context.scalar;
    let (real, size, rows) = (scalar.name(), context.constant("BASE_PARAMETERS"), context.constant("EQUATIONS"));
    if let Some(spread) = requested::spread(context.estimator, context.identified) {
        let declaration = format!("const {real} {}[{size}][{size}]", context.global("identified_spread"));
        context.header.push_str(&format!("\n{}extern {declaration};\n", doc(0, requested::SPREAD)));
        let lines: String = (spread.iter())
            .map(|row| {
                let entries: Vec<String> = row.iter().map(|entry| scalar.literal(*entry)).collect();
                format!("    {{{}}},\n", entries.join(", "))
            })
            .collect();
        context.source.push_str(&format!("\n{declaration} = {{\n{lines}}};\n"));
    }
    let field = |about: &str, declaration: String| format!("{}    {declaration};\n", doc(1, about));
    let rules = [
        field("The base parameters of the machine as it was identified.", format!("{real} values[{size}]")),
        field(
            "A matrix S with S S^T the covariance of these values, such as the Cholesky factor.",
            format!("{real} spread[{size}][{size}]"),
        ),
        field(
            "The change of every base parameter that is to be found, larger than zero, and beyond its drift where it drifts. A block whose \
             uncertainty looks larger than this says nothing of the parameter.",
            format!("{real} changes[{size}]"),
        ),
        field(
            "How far every base parameter may be off by itself, with temperature or wear; zero for one that does not drift.",
            format!("{real} drifts[{size}]"),
        ),
        field(
            "Standard deviations of the equations' errors. Only their ratios count, since the run-in measures the noise.",
            format!("{} deviations", context.global("forces")),
        ),
        field("The time between samples, s.", format!("{real} sample_time")),
        field("The false alarms that are allowed per hour.", format!("{real} false_alarms")),
        field(
            "The samples of a block: a few times longer than noise remembers, and than the slowest motion takes.",
            "uint32_t block".to_owned(),
        ),
        field("The blocks of the run-in, at least 20, of the work that will be watched.", "uint32_t run_in".to_owned()),
    ]
    .concat();
    context.structure(
        "monitor_rules",
        "What is watched, and how; arrays in the order of the base parameters' labels.",
        &rules,
    );
    let jumps = requested::jumps(context.estimator);
    let signs = size_macro(
        context,
        "BASE_JUMPS",
        jumps.as_ref().map_or(1, |jumps| jumps.count),
        "The most signs, and functions that saturate, in an equation.",
    );
    context.header.push_str(&format!("\n{signs}"));
    let mut flags = vec![false; context.names.rows.len() * base_parameters(context)];
    if let Some(jumps) = &jumps {
        let function = requested::jumping(context.estimator, jumps);
        matrix(context, "base_jumps", &function, [true, false], (jumps.count, "BASE_JUMPS"));
        flags.clone_from(&jumps.entries);
    }
    let sizes = support::sizes(context, &["EQUATIONS", "BASE_PARAMETERS", "BASE_JUMPS"]);
    let all: Vec<(&str, &str)> = support::BASE.into_iter().chain([("S", "BASE_JUMPS")]).collect();
    let [begin, rest, still, count, again] = support::write(context, &all, |translator| {
        let mut of = |name| translator.method("Monitoring", &sizes, name);
        Ok([of("begin")?, of("rest")?, of("is_still")?, of("count")?, of("again")?])
    });
    let pointer = Parameter::new(format!("{} *monitor", context.global("monitor")));
    let (state, status) = (context.global("monitor_state"), context.global("status"));
    let (ok, undetermined) = (context.constant("OK"), context.constant("UNDETERMINED"));
    // Begin.
    let about = format!(
        "{} Begins with the run-in. `{undetermined}` when a rule is not finite or not in its range, or a block has no more equations than two per \
         base parameter, or the run-in fewer than 20 blocks; the monitor must not be used then.",
        requested::MONITOR
    );
    let mut body = format!("    {} order;\n\n", context.global("monitor_order"));
    body.push_str(&format!(
        "    for (size_t i = 0; i < (size_t){size}; ++i) {{
        order.values[i] = rules->values[i];
        order.changes[i] = rules->changes[i];
        order.drifts[i] = rules->drifts[i];
        for (size_t j = 0; j < (size_t){size}; ++j) {{
            order.spread[i][j] = rules->spread[i][j];
        }}
    }}
"
    ));
    for (row, names) in context.names.rows.iter().enumerate() {
        body.push_str(&statement(1, &format!("order.deviations[{row}] = rules->deviations.{};", names.field)));
    }
    for name in ["sample_time", "block", "run_in", "false_alarms"] {
        body.push_str(&statement(1, &format!("order.{name} = rules->{name};")));
    }
    let good = context.constant("MONITOR_FAULT_OK");
    body.push_str(&statement(1, &format!("return {begin}(monitor, &order) == {good} ? {ok} : {undetermined};")));
    let rules = Parameter::new(format!("const {} *rules", context.global("monitor_rules")));
    context.function(&context.global("monitor_begin"), &about, &status, &[pointer.clone(), rules], &body);
    // At rest.
    let argument = context.constants_argument();
    let signs = context.constant("BASE_JUMPS");
    let ones = vec![format!("{{{}}}", scalar.literal(1.0)); context.names.rows.len()].join(", ");
    let (arguments, evaluate) = match &jumps {
        Some(_) => (
            format!("    {real} arguments[{rows}][{signs}];\n"),
            format!("    {}(motion{argument}, arguments);\n", context.global("base_jumps")),
        ),
        None => (format!("    {real} arguments[{rows}][{signs}] = {{{ones}}};\n"), String::new()),
    };
    let entries: Vec<String> = (flags.chunks(base_parameters(context).max(1)))
        .map(|row| {
            let flags: Vec<&str> = row.iter().map(|jumps| if *jumps { "true" } else { "false" }).collect();
            format!("{{{}}}", flags.join(", "))
        })
        .collect();
    let jumping = statement(1, &format!("bool jumping[{rows}][{size}] = {{{}}};", entries.join(", ")));
    let regressor = format!("{}(motion{argument}, matrix);", context.global("base_regressor"));
    let body = format!(
        "{jumping}    {real} matrix[{rows}][{size}];\n{arguments}\n    {regressor}\n{evaluate}    {rest}(monitor, matrix, arguments, jumping);\n"
    );
    let motion = Parameter::new(format!("const {} *motion", context.global("motion")));
    let mut parameters = vec![pointer.clone(), motion];
    parameters.extend(context.constants_parameter(true));
    let about = "Takes in the motion, as it is measured, of one instant while the machine stands still, before the run-in: what varies then\n\
                 is noise, which looks like a change of parameters where the machine moves little. Without any, the motion counts as exact.";
    context.function(&context.global("monitor_rest"), about, "void", &parameters, &body);
    // A sample.
    let forces = context.global("forces");
    let mut body =
        format!("{arguments}    {forces} deviations;\n    uint32_t equations = {rows};\n    bool taken;\n\n{evaluate}");
    for (row, names) in context.names.rows.iter().enumerate() {
        body.push_str(&format!(
            "    deviations.{field} = monitor->rules.deviations[{row}];
    if ({still}(monitor, {row}, arguments)) {{
        deviations.{field} = ({real})INFINITY;
        --equations;
    }}
",
            field = names.field
        ));
    }
    let accumulate =
        format!("{}(&monitor->block, motion{argument}, applied, &deviations)", context.global("base_accumulate"));
    body.push_str(&statement(1, &format!("taken = whole && {accumulate} == {ok};")));
    body.push_str(&statement(1, &format!("return {count}(monitor, taken, equations);")));
    parameters.push(Parameter::new(format!("const {forces} *applied")));
    parameters.push(Parameter::new("bool whole".to_owned()));
    let about = "Takes in the motion and the applied forces B u of one instant, and tells what is known now. `whole` is false where the sample is\n\
                 missing, or where an input was at its limit, so that the applied force is not known.";
    context.function(&context.global("monitor_push"), about, &state, &parameters, &body);
    // Again.
    let about = "Forgets evidence and alarm, and keeps what was measured at rest and in the run-in: after an alarm that was seen to.";
    let body = format!("    {again}(monitor);\n");
    context.function(&context.global("monitor_again"), about, "void", &[pointer], &body);
}

fn base_parameters(context: &Context<'_>) -> usize {
    context.estimator.parts.base.as_ref().map_or(0, |base| base.parameters.len())
}
