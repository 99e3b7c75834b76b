//! The part of the code that needs no pattern: sizes, labels, parameters, motions, regressor, forces.

use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::unit::Unit;

use super::super::code::{Place, Statement};
use super::super::function::{self, Body, Function};
use super::super::names::derivative_name;
use super::super::text;
use super::context::{Context, Parameter, push_constants};
use super::expression::Writer;
use super::layout::{doc, statement, string};

/// The sizes of the model, as macros.
pub(super) fn sizes(context: &Context<'_>) -> String {
    let names = &context.names;
    let list = [
        ("COORDINATES", names.coordinates.len(), "Coordinates."),
        ("INPUTS", names.inputs.len(), "Inputs."),
        ("EQUATIONS", names.rows.len(), "Equations."),
        ("PARAMETERS", names.columns.len(), "Parameters that are estimated."),
        ("CONSTANTS", names.constants.len(), "Constants known at run time."),
    ];
    let sizes: String = list.into_iter().map(|(name, size, about)| size_macro(context, name, size, about)).collect();
    let hash = text::fingerprint(context.estimator);
    let about = "A number that changes with the model, for logs and results to say what they belong to.";
    format!("{sizes}{}#define {} UINT64_C(0x{hash:016x})\n", doc(0, about), context.constant("MODEL_HASH"))
}

/// One size, as a macro.
pub(super) fn size_macro(context: &Context<'_>, name: &str, size: usize, about: &str) -> String {
    format!("{}#define {} {size}\n", doc(0, about), context.constant(name))
}

/// Writes all declarations and functions that need no pattern.
pub(super) fn write(context: &mut Context<'_>) {
    records(context);
    labels(context);
    identified(context);
    lump(context);
    unlump(context);
    let estimator = context.estimator;
    let matrices = [
        ("regressor", function::regressor(estimator), true, context.names.columns.len(), "PARAMETERS"),
        ("input_map", function::input_map(estimator), false, context.names.inputs.len(), "INPUTS"),
    ];
    for (name, function, motion, columns, size) in matrices {
        matrix(context, name, &function, [motion, false], (columns, size));
    }
    forces(context, "known", &function::known(estimator), false);
    forces(context, "inverse_dynamics", &function::inverse_dynamics(estimator), true);
    if let Some(function) = function::feed_forward(estimator) {
        inputs(context, "feed_forward", &function);
    }
    if let Some(function) = function::feed_forward_with_regressor(estimator) {
        both(context, &function);
    }
    if let Some([independent, dependent]) = function::feed_forward_parts(estimator) {
        inputs(context, "feed_forward_independent", &independent);
        inputs(context, "feed_forward_dependent", &dependent);
    }
}

fn quantities(context: &Context<'_>, symbols: &[(Symbol, String)]) -> Vec<(String, String)> {
    symbols.iter().map(|(symbol, name)| (name.clone(), text::quantity(context.estimator, *symbol))).collect()
}

fn records(context: &mut Context<'_>) {
    let columns = context.names.columns.iter().enumerate();
    let columns: Vec<_> = columns.map(|(i, name)| (name.clone(), text::column(context.estimator, i))).collect();
    context.record("parameters", "The parameters that are estimated; every equation is linear in them.", &columns);
    if context.has_constants() {
        let fields = quantities(context, &context.names.constants);
        context.record("constants", "Quantities that are known, but only at run time.", &fields);
    }
    if !context.names.physical.is_empty() {
        let fields = quantities(context, &context.names.physical);
        let about = "The parameters as the model declares them. What is estimated are products and sums of them.";
        context.record("physical", about, &fields);
    }
    let mut fields = String::new();
    for i in 0..context.names.coordinates.len() {
        let names = &context.names.coordinates[i];
        let (name, field) = (names.motion_type.clone(), names.field.clone());
        let info = &context.estimator.model.coordinates[names.coordinate.0 as usize];
        let derivative = |n: u32| (derivative_name(n), text::derivative(context.estimator, names.coordinate, n));
        let derivatives: Vec<(String, String)> = (0..=names.order).map(derivative).collect();
        fields.push_str(&doc(1, &format!("`{}` and its derivatives.", info.name)));
        fields.push_str(&format!("    {} {field};\n", context.global(&name)));
        let about = text::coordinate(context.estimator, info);
        context.record(&name, &about, &derivatives);
    }
    context.structure("motion", "One instant of the motion.", &fields);
    let rows = context.names.rows.iter().enumerate();
    let rows: Vec<_> = rows.map(|(r, names)| (names.field.clone(), text::equation(context.estimator, r))).collect();
    let about = "One number per equation: the generalised force that its left-hand side amounts to.";
    context.record("forces", about, &rows);
    if context.estimator.plan.feed_forward.is_some() {
        inputs_record(context);
    }
}

/// The structure of the inputs.
pub(super) fn inputs_record(context: &mut Context<'_>) {
    let fields = quantities(context, &context.names.inputs);
    context.record("inputs", "The inputs.", &fields);
}

fn labels(context: &mut Context<'_>) {
    let estimator = context.estimator;
    let label = context.global("label");
    context.header.push_str(&format!(
        "\n/* Name and unit of a quantity. */\ntypedef struct {label} {{\n    const char *name;\n    /* Empty when the model declares none. */\n    const char *unit;\n}} {label};\n"
    ));
    let model = &estimator.model;
    let of_symbol = |(symbol, _): &(Symbol, String)| {
        let quantity = model.quantity(*symbol);
        (quantity.name.to_string(), quantity.unit.clone())
    };
    let coordinates = context.names.coordinates.iter().map(|names| {
        let info = &model.coordinates[names.coordinate.0 as usize];
        (info.name.clone(), info.unit.clone())
    });
    let rows = estimator.form.rows.iter().enumerate();
    let rows = rows.map(|(r, row)| (row.name.to_string(), text::row_unit(estimator, r).cloned()));
    let columns = estimator.form.columns.iter().map(|column| (column.name.to_string(), column.unit.clone()));
    type List = Vec<(String, Option<Unit>)>;
    let lists: [(&str, &str, &str, List); 5] = [
        ("coordinate_labels", "COORDINATES", "Names and units of the coordinates.", coordinates.collect()),
        (
            "input_labels",
            "INPUTS",
            "Names and units of the inputs.",
            context.names.inputs.iter().map(of_symbol).collect(),
        ),
        ("parameter_labels", "PARAMETERS", "Names and units of the parameters that are estimated.", columns.collect()),
        (
            "constant_labels",
            "CONSTANTS",
            "Names and units of the constants known at run time.",
            context.names.constants.iter().map(of_symbol).collect(),
        ),
        (
            "equation_labels",
            "EQUATIONS",
            "Names and units of the equations: the input's, where there is exactly one.",
            rows.collect(),
        ),
    ];
    for (name, size, about, list) in lists {
        if list.is_empty() {
            continue;
        }
        let declaration = format!("const {label} {}[{}]", context.global(name), context.constant(size));
        context.header.push_str(&format!("\n{}extern {declaration};\n", doc(0, about)));
        context.source.push_str(&format!("\n{declaration} = {{\n"));
        for (name, unit) in list {
            let unit = unit.map_or_else(String::new, |unit| unit.to_string());
            context.source.push_str(&format!("    {{{}, {}}},\n", string(&name), string(&unit)));
        }
        context.source.push_str("};\n");
    }
}

fn identified(context: &mut Context<'_>) {
    let Some(identified) = context.identified else { return };
    // `files` has refused values that do not fit the model.
    let Ok(values) = identified.in_order(&context.estimator.model, &context.estimator.form) else { return };
    let about = identified.about(&values);
    let declaration = format!("const {} {}", context.global("parameters"), context.global("identified"));
    context.header.push_str(&format!("\n{}extern {declaration};\n", doc(0, &about)));
    let entries = values
        .iter()
        .zip(&context.names.columns)
        .map(|(settled, name)| format!("    {}, /* {name} */\n", context.scalar.literal(settled.value)));
    let entries: String = entries.collect();
    context.source.push_str(&format!("\n{declaration} = {{\n{entries}}};\n"));
}

fn lump(context: &mut Context<'_>) {
    let Some(Function { about, reads, body: Body::Stores(statements) }) = function::lump(context.estimator) else {
        return;
    };
    let mut parameters =
        vec![Parameter::read(format!("const {} *physical", context.global("physical")), "physical", reads.own)];
    push_constants(&mut parameters, context, reads);
    parameters.push(Parameter::new(format!("{} *parameters", context.global("parameters"))));
    let writer =
        Writer::new(context.scalar, |leaf| context.leaf(leaf, "physical->", &context.names.physical, "motion->"));
    let body = context.statements(&statements, &writer, |place| match place {
        Place::Value(index) => format!("parameters->{}", context.names.columns[index]),
        Place::Entry(..) => unreachable!("invariant: the parameters are no matrix"),
    });
    context.function(&context.global("lump"), &context.linked(&about, None), "void", &parameters, &body);
}

fn unlump(context: &mut Context<'_>) {
    let Some(Function { about, reads, body: Body::Stores(statements) }) = function::unlump(context.estimator) else {
        return;
    };
    let declaration = format!("const {} *parameters", context.global("parameters"));
    let mut parameters = vec![Parameter::read(declaration, "parameters", reads.parameters)];
    push_constants(&mut parameters, context, reads);
    parameters.push(Parameter::new(format!("{} *physical", context.global("physical"))));
    let writer = Writer::new(context.scalar, |leaf| context.leaf(leaf, "", &[], ""));
    let body = context.statements(&statements, &writer, |place| match place {
        Place::Value(index) => format!("physical->{}", context.names.physical[index].1),
        Place::Entry(..) => unreachable!("invariant: the parameters are no matrix"),
    });
    context.function(&context.global("unlump"), &context.linked(&about, None), "void", &parameters, &body);
}

/// The targets into which steps store.
pub(super) fn stored(statements: &[Statement]) -> Vec<Place> {
    let place = |statement: &Statement| match statement {
        Statement::Store(place, _) => Some(*place),
        _ => None,
    };
    statements.iter().filter_map(place).collect()
}

/// The spelling of an entry of a matrix.
pub(super) fn entry(place: Place) -> String {
    match place {
        Place::Entry(row, column) => format!("matrix[{row}][{column}]"),
        Place::Value(_) => unreachable!("invariant: a matrix has rows and columns"),
    }
}

/// A function that returns one matrix row per equation; its arguments are the motion and parameters that it reads.
pub(super) fn matrix(
    context: &mut Context<'_>,
    name: &str,
    function: &Function,
    [with_motion, with_parameters]: [bool; 2],
    (columns, size): (usize, &str),
) {
    if columns == 0 {
        return;
    }
    let Body::Stores(statements) = &function.body else {
        unreachable!("invariant: matrices of the dynamics are written entry by entry")
    };
    let mut parameters = Vec::new();
    if with_motion {
        let declaration = format!("const {} *motion", context.global("motion"));
        parameters.push(Parameter::read(declaration, "motion", function.reads.motion));
    }
    if with_parameters {
        let declaration = format!("const {} *parameters", context.global("parameters"));
        parameters.push(Parameter::read(declaration, "parameters", function.reads.parameters));
    }
    push_constants(&mut parameters, context, function.reads);
    let dims = format!("[{}][{}]", context.constant("EQUATIONS"), context.constant(size));
    parameters.push(Parameter::new(format!("{} matrix{dims}", context.scalar.name())));
    let mut body = String::new();
    if with_motion && function.reads.motion {
        // The local copy tells the compiler that no store into the matrix changes the motion.
        body.push_str(&statement(1, &format!("const {} at = *motion;", context.global("motion"))));
    }
    let writer = Writer::new(context.scalar, |leaf| context.leaf(leaf, "", &[], "at."));
    let rows = context.names.rows.len();
    body.push_str(&context.zeros(rows, Some(columns), &stored(statements), entry));
    body.push_str(&context.statements(statements, &writer, entry));
    context.function(&context.global(name), &context.linked(&function.about, None), "void", &parameters, &body);
}

/// A function of the motion with one value per field of a structure.
fn values(
    context: &mut Context<'_>,
    name: &str,
    function: &Function,
    with_parameters: bool,
    (result, fields): (&str, &[String]),
) {
    let Body::Values(statements, values) = &function.body else {
        unreachable!("invariant: forces and inputs are given all at once")
    };
    let declaration = format!("const {} *motion", context.global("motion"));
    let mut parameters = vec![Parameter::read(declaration, "motion", function.reads.motion)];
    if with_parameters {
        let declaration = format!("const {} *parameters", context.global("parameters"));
        parameters.push(Parameter::read(declaration, "parameters", function.reads.parameters));
    }
    push_constants(&mut parameters, context, function.reads);
    parameters.push(Parameter::new(format!("{} *{result}", context.global(result))));
    let writer = Writer::new(context.scalar, |leaf| context.leaf(leaf, "", &[], "motion->"));
    let mut body = context.statements(statements, &writer, |_| String::new());
    for (field, value) in fields.iter().zip(values) {
        body.push_str(&statement(1, &format!("{result}->{field} = {};", writer.expression(value))));
    }
    context.function(&context.global(name), &context.linked(&function.about, None), "void", &parameters, &body);
}

/// Inputs and regressor.
fn both(context: &mut Context<'_>, function: &Function) {
    let Body::Stores(statements) = &function.body else {
        unreachable!("invariant: matrices of the dynamics are written entry by entry")
    };
    let of = |name: &str| context.global(name);
    let (rows, columns) = (context.names.rows.len(), context.names.columns.len());
    let mut parameters = vec![
        Parameter::read(format!("const {} *motion", of("motion")), "motion", function.reads.motion),
        Parameter::read(format!("const {} *parameters", of("parameters")), "parameters", function.reads.parameters),
    ];
    push_constants(&mut parameters, context, function.reads);
    let dims = format!("[{}][{}]", context.constant("EQUATIONS"), context.constant("PARAMETERS"));
    parameters.push(Parameter::new(format!("{} *inputs", of("inputs"))));
    parameters.push(Parameter::new(format!("{} matrix{dims}", context.scalar.name())));
    let mut body = String::new();
    if function.reads.motion {
        body.push_str(&statement(1, &format!("const {} at = *motion;", of("motion"))));
    }
    let store = |place: Place| match place {
        Place::Entry(..) => entry(place),
        Place::Value(input) => format!("inputs->{}", context.names.inputs[input].1),
    };
    let writer = Writer::new(context.scalar, |leaf| context.leaf(leaf, "", &[], "at."));
    body.push_str(&context.zeros(rows, Some(columns), &stored(statements), entry));
    body.push_str(&context.statements(statements, &writer, store));
    let (name, about) = (of("feed_forward_with_regressor"), context.linked(&function.about, None));
    context.function(&name, &about, "void", &parameters, &body);
}

pub(super) fn forces(context: &mut Context<'_>, name: &str, function: &Function, with_parameters: bool) {
    let fields: Vec<String> = context.names.rows.iter().map(|names| names.field.clone()).collect();
    values(context, name, function, with_parameters, ("forces", &fields));
}

fn inputs(context: &mut Context<'_>, name: &str, function: &Function) {
    let fields: Vec<String> = context.names.inputs.iter().map(|(_, name)| name.clone()).collect();
    values(context, name, function, true, ("inputs", &fields));
}
