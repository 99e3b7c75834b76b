//! Python with the dynamics as functions of CasADi over the symbols SX.
//!
//! Invariant: the steps of every function are those of the code in Rust and C.

use std::fmt::Write as _;

use tpm_symbolic::expr::graph::Function as Called;
use tpm_symbolic::plan::leaf::Leaf;

use super::code::{Expression, Statement};
use super::estimator::EstimatorSource;
use super::function::{self, Body, Function};
use super::infix::{Given, Words, expression};
use super::number::digits;
use super::requested;
use super::text::{filled, in_unit};

/// Width of a line of prose, in characters.
const WIDTH: usize = 110;

/// What is said of forward dynamics: symbols take no other way where a pivot is not positive.
const FORWARD: &str = "The highest derivatives that the inputs give, from M a = B u - h with the forces h at zero accelerations; not finite where the \
                       mass matrix M is singular.";

/// The text of the file.
pub(crate) fn file(estimator: &EstimatorSource, given: &Given<'_>) -> String {
    let mut out = format!("{}\n\nimport casadi as ca\n", doc("", given.about));
    lists(&mut out, estimator, given);
    let highest = estimator.plan.evaluation.coordinates.iter().map(|(_, order)| *order).max().unwrap_or(0);
    let motion: Vec<String> = (0..=highest).map(of_order).collect();
    let rates = &motion[..motion.len() - 1];
    let inputs = ["u".to_owned()];
    let dynamics = function::inverse_dynamics(estimator);
    write(&mut out, estimator, given, ("inverse_dynamics", "forces"), &dynamics, &motion, None);
    if let Some(own) = function::feed_forward(estimator) {
        write(&mut out, estimator, given, ("feed_forward", "inputs"), &own, &motion, None);
    }
    if let Some(mut own) = requested::forward_dynamics(estimator) {
        FORWARD.clone_into(&mut own.about);
        let count = estimator.plan.evaluation.coordinates.len();
        let arguments: Vec<String> = rates.iter().chain(&inputs).cloned().collect();
        write(&mut out, estimator, given, ("forward_dynamics", "accelerations"), &own, &arguments, Some(count));
    }
    out
}

/// The vector of the derivatives of an order.
fn of_order(order: u32) -> String {
    match order {
        0..=2 => format!("{}q", "d".repeat(order as usize)),
        _ => format!("d{order}q"),
    }
}

/// Text between three quotes.
fn doc(indent: &str, text: &str) -> String {
    // Links of the documentation lead to functions that are named alike here.
    let text = text.replace("[`", "`").replace("`]", "`").replace('\\', "\\\\").replace("\"\"\"", "'''");
    let lines: Vec<String> = filled(&text, WIDTH).iter().map(|line| format!("{indent}{line}")).collect();
    let text = lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n");
    format!("{indent}\"\"\"{}\n{indent}\"\"\"", text.trim_start())
}

/// Names with their units, values beside them.
fn lists(out: &mut String, estimator: &EstimatorSource, given: &Given<'_>) {
    let model = &estimator.model;
    let evaluation = &estimator.plan.evaluation;
    let quantities = |symbols: &[tpm_symbolic::expr::graph::Symbol]| -> Vec<(String, String)> {
        let of =
            |symbol: &_| (model.quantity(*symbol).name.to_string(), in_unit(model.quantity(*symbol).unit.as_ref()));
        symbols.iter().map(of).collect()
    };
    let coordinates = evaluation.coordinates.iter().map(|(coordinate, _)| {
        let own = &model.coordinates[coordinate.0 as usize];
        (own.name.clone(), in_unit(own.unit.as_ref()))
    });
    let columns = estimator.form.columns.iter().map(|own| (own.name.to_string(), in_unit(own.unit.as_ref())));
    let rows = estimator.form.rows.iter().map(|row| (row.name.to_string(), String::new()));
    let lists = [
        ("COORDINATES", "Coordinates, in the order of q", coordinates.collect::<Vec<_>>()),
        ("EQUATIONS", "Equations, in the order of the forces", rows.collect()),
        ("INPUTS", "Inputs, in the order of u", quantities(&evaluation.inputs)),
        ("PARAMETERS", "Parameters, in the order of theta", columns.collect()),
        ("CONSTANTS", "Constants known at run time", quantities(&evaluation.constants)),
    ];
    for (name, about, list) in lists {
        let entries: String = list.iter().map(|(own, unit)| format!("    \"{own}\",{}\n", comment(unit))).collect();
        let _ = write!(out, "\n#: {about}.\n{name} = [\n{entries}]\n");
    }
    let number = |value: &Option<f64>| value.map_or_else(|| "None".to_owned(), digits);
    let values: Vec<String> = given.values.iter().copied().map(digits).collect();
    let _ = write!(out, "\n#: The identified values of the parameters.\nIDENTIFIED = [{}]\n", values.join(", "));
    if !given.constants.is_empty() {
        let known: Vec<String> = given.constants.iter().map(number).collect();
        let _ = write!(
            out,
            "\n#: Values of the constants, None where the result has none.\nKNOWN = [{}]\n",
            known.join(", ")
        );
    }
}

fn comment(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!("  #{unit}") }
}

/// A function of CasADi, and one of Python whose parameters have the identified values where none are given. `solved` accelerations follow
/// from values that are a mass matrix and a right-hand side.
fn write(
    out: &mut String,
    estimator: &EstimatorSource,
    given: &Given<'_>,
    (name, result): (&str, &str),
    function: &Function,
    arguments: &[String],
    solved: Option<usize>,
) {
    let evaluation = &estimator.plan.evaluation;
    let Body::Values(statements, values) = &function.body else {
        unreachable!("invariant: forces and inputs are given all at once")
    };
    let leaf = |leaf: &Leaf| match *leaf {
        Leaf::Motion(coordinate, order) => {
            let place = evaluation.coordinates.iter().position(|(own, _)| *own == coordinate);
            format!("{}[{}]", of_order(order), place.expect("invariant: the evaluation lists its coordinates"))
        }
        Leaf::Column(column) => format!("theta[{column}]"),
        Leaf::Symbol(symbol) => match evaluation.constants.iter().position(|own| *own == symbol) {
            Some(place) => format!("constants[{place}]"),
            None => {
                let place = evaluation.inputs.iter().position(|own| *own == symbol);
                format!("u[{}]", place.expect("invariant: the dynamics read constants and inputs alone"))
            }
        },
        _ => unreachable!("invariant: the dynamics read no phase and no harmonics"),
    };
    let words = Words { leaf: &leaf, digits, name: &name_of };
    let mut sizes: Vec<(&str, usize)> = (arguments.iter())
        .map(|own| (own.as_str(), if own == "u" { evaluation.inputs.len() } else { evaluation.coordinates.len() }))
        .collect();
    if !given.constants.is_empty() {
        sizes.push(("constants", given.constants.len()));
    }
    sizes.push(("theta", given.values.len()));
    let _ = write!(out, "\n\ndef _{name}():\n");
    for (own, size) in &sizes {
        let _ = writeln!(out, "    {own} = ca.SX.sym(\"{own}\", {size})");
    }
    for statement in statements {
        if let Statement::Let(index, value) = statement {
            let _ = writeln!(out, "    t{index} = {}", expression(&words, value));
        }
    }
    let texts = |list: &[Expression]| list.iter().map(|one| expression(&words, one)).collect::<Vec<_>>();
    let stacked = |list: &[Expression]| format!("ca.vertcat({})", texts(list).join(", "));
    let value = match solved {
        None => stacked(values),
        // Behind M and the right-hand side stand pivots and accelerations, where M is symmetric as it is written.
        Some(n) if values.len() > n * n + n => stacked(&values[values.len() - n..]),
        Some(n) => {
            let rows: Vec<String> =
                values[..n * n].chunks(n).map(|row| format!("ca.horzcat({})", texts(row).join(", "))).collect();
            format!("ca.solve(ca.vertcat({}), {})", rows.join(", "), stacked(&values[n * n..]))
        }
    };
    let names: Vec<&str> = sizes.iter().map(|(own, _)| *own).collect();
    let quoted: Vec<String> = names.iter().map(|own| format!("\"{own}\"")).collect();
    let list = names.join(", ");
    let quoted = quoted.join(", ");
    let _ = write!(
        out,
        "    return ca.Function(\"{name}\", [{list}], [{value}], [{quoted}], [\"{result}\"])\n\n\n{} = _{name}()\n",
        name.to_uppercase()
    );
    let complete = given.constants.iter().all(Option::is_some);
    let defaults = names.iter().map(|own| match *own {
        "theta" => "theta=IDENTIFIED".to_owned(),
        "constants" if complete => "constants=KNOWN".to_owned(),
        own => own.to_owned(),
    });
    let _ = write!(
        out,
        "\n\ndef {name}({}):\n{}\n    return {}({list})\n",
        defaults.collect::<Vec<_>>().join(", "),
        doc("    ", &function.about),
        name.to_uppercase()
    );
}

/// The name of a function in CasADi.
fn name_of(function: Option<Called>) -> String {
    match function {
        None => "ca.atan2".to_owned(),
        Some(Called::Abs) => "ca.fabs".to_owned(),
        Some(function) => format!("ca.{}", function.name()),
    }
}
