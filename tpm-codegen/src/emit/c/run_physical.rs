//! The physical parameters from a run in C, where those of its equations are products and sums of them.

use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::Reader;
use super::super::names::Names;
use super::super::run::{PHYSICAL, RunPlan, is_zero};
use super::super::text;
use super::context::{Context, Parameter};
use super::dynamics::size_macro;
use super::expression::Writer;
use super::layout::{doc, statement};
use super::run_estimate::filling;
use super::support;

/// Writes the physical parameters' estimate, where the parameters of the run's equations are products and sums of them.
pub(super) fn write(context: &mut Context<'_>, plan: &RunPlan<'_>, names: &Names<String>) {
    if plan.source.slopes.is_none() {
        return;
    }
    let size = size_macro(
        context,
        "RUN_PHYSICAL",
        names.physical.len(),
        "Physical parameters behind the parameters of the run.",
    );
    context.header.push_str(&format!("\n{size}"));
    let fields = names.physical.iter().map(|(symbol, name)| (name.clone(), text::quantity(plan.source, *symbol)));
    let fields: Vec<(String, String)> = fields.collect();
    context.record("run_physical", "The parameters as the model declares them.", &fields);
    let constants = match context.has_constants() {
        true => format!(", const {} *constants", context.global("constants")),
        false => String::new(),
    };
    lump(context, plan, names, &constants);
    let sizes = support::sizes(context, &["RUN_PARAMETERS", "RUN_PHYSICAL"]);
    let calls = support::write(context, &support::RUN, |translator| {
        Ok([
            translator.method("RunIteration", &sizes, "update")?,
            translator.method("RunIteration", &sizes, "chi_squared")?,
        ])
    });
    estimate(context, names, &calls);
}

/// The parameters of the equations from the physical ones, with their derivatives.
fn lump(context: &mut Context<'_>, plan: &RunPlan<'_>, names: &Names<String>, constants: &str) {
    let Some(slopes) = &plan.source.slopes else { return };
    let (columns, width) = (plan.source.form.columns.len(), names.physical.len());
    let writer = Writer::new(context.scalar, |leaf: &Leaf| {
        let place = match *leaf {
            Leaf::Symbol(symbol) => names.physical.iter().position(|(own, _)| *own == symbol),
            _ => None,
        };
        place.map_or_else(|| context.leaf(leaf, "", &[], ""), |place| format!("physical[{place}]"))
    });
    let (statements, values) = Reader::new(slopes).outputs();
    let reads = |own: bool| {
        let is = |leaf: &Leaf| match *leaf {
            Leaf::Symbol(symbol) => names.physical.iter().any(|(name, _)| *name == symbol) == own,
            _ => false,
        };
        slopes.inputs.iter().any(is)
    };
    let real = context.scalar.name();
    let (lumped, physical) = (context.constant("RUN_PARAMETERS"), context.constant("RUN_PHYSICAL"));
    let mut text = format!(
        "\n/* The parameters of the equations from the physical ones, and their derivatives. */\nstatic void run_lump(const {real} physical[{physical}], {real} lumped[{lumped}],\n        {real} slopes[{lumped}][{physical}]{constants})\n{{\n"
    );
    text.push_str(&context.statements(&statements, &writer, |_| String::new()));
    if !reads(true) {
        text.push_str("    (void)physical;\n");
    }
    if context.has_constants() && !reads(false) {
        text.push_str("    (void)constants;\n");
    }
    // What is zero is zero before the call.
    for (index, value) in values.iter().enumerate().filter(|(_, value)| !is_zero(value)) {
        let target = match index.checked_sub(columns) {
            None => format!("lumped[{index}]"),
            Some(place) => format!("slopes[{}][{}]", place / width, place % width),
        };
        text.push_str(&statement(1, &format!("{target} = {};", writer.expression(value))));
    }
    text.push_str("}\n");
    context.source.push_str(&text);
}

/// The structure of the estimate, and the function that gives it.
fn estimate(context: &mut Context<'_>, names: &Names<String>, [update, chi_squared]: &[String; 2]) {
    let (real, size) = (context.scalar.name(), context.constant("RUN_PHYSICAL"));
    let record = context.global("run_physical");
    let field = |about: &str, declaration: String| format!("{}    {declaration};\n", doc(1, about));
    let fields = [
        field("The parameters; not a number where the run does not show them.", format!("{record} parameters")),
        field("Their standard deviations.", format!("{record} deviations")),
        field(
            "Their covariance in the order of the fields; zero for those that the run does not show.",
            format!("{real} covariance[{size}][{size}]"),
        ),
        field("For each parameter whether the run shows it.", format!("bool shown[{size}]")),
        field("The number of directions that the run shows.", "int rank".to_owned()),
        field(
            "At least the condition number of what is shown, and at most the rank times that.",
            format!("{real} condition"),
        ),
        field(
            "Weighted sum of squares of what the equations leave at these parameters, over its degrees of freedom.",
            format!("{real} chi_squared"),
        ),
    ]
    .concat();
    context.structure("run_physical_estimate", "What a run says of the physical parameters.", &fields);
    let mut list = vec![
        Parameter::new(format!("const {} *workspace", context.global("run_workspace"))),
        Parameter::new(format!("{} *own", context.global("run_physical_workspace"))),
    ];
    list.extend(context.constants_parameter(true));
    list.push(Parameter::new(format!("const {record} *prior")));
    list.push(Parameter::new(format!("{} *estimate", context.global("run_physical_estimate"))));
    let columns: Vec<String> = names.physical.iter().map(|(_, name)| name.clone()).collect();
    let parts = ["run_physical_solution", "run_physical_estimate", "RUN_PHYSICAL"];
    // The values of the iteration are the parameters themselves.
    let text = filling(context, "run_fill_physical", parts, &columns, |index| format!("about[{index}]"), None);
    context.source.push_str(&text);
    let ok = context.constant("RUN_OK");
    let mut body = format!("    {} status;\n\n", context.global("run_status"));
    for (index, name) in columns.iter().enumerate() {
        body.push_str(&statement(1, &format!("own->values[{index}] = prior->{name};")));
    }
    body.push_str(&format!(
        "    status = {update}(own{constants}, &workspace->factor, workspace->about);
    if (status != {ok}) {{
        return status;
    }}
    run_fill_physical(&own->found, own->values, {chi_squared}(own, &workspace->factor), estimate);
    return {ok};
",
        constants = context.constants_argument()
    ));
    let about = format!(
        "{PHYSICAL} `workspace` is that of the run's last update. Only with the first status is anything written to `estimate`."
    );
    let (name, status) = (context.global("run_identify_physical"), context.global("run_status"));
    context.function(&name, &about, &status, &list, &body);
}
