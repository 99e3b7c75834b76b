//! A program for Arduino that calls the generated C.

use std::fmt::Write as _;

use super::super::estimator::{EmitError, EstimatorSource};
use super::super::names::derivative_name;
use super::super::text;
use super::{Context, Options};

/// The program: along a sine of every coordinate it prints what the motion needs; `constants` are the values of those known at run time,
/// where they are known.
pub(crate) fn sketch(
    estimator: &EstimatorSource,
    options: &Options<'_>,
    constants: &[Option<f64>],
) -> Result<String, EmitError> {
    let context = Context::new(estimator, options)?;
    let of = |name: &str| context.global(name);
    let forward = estimator.plan.feed_forward.is_some();
    let (function, result) = if forward { ("feed_forward", "inputs") } else { ("inverse_dynamics", "forces") };
    let scalar = context.scalar.name();
    let mut out = format!(
        "// What a sine of every coordinate needs, on the serial port.\n#include <{}.h>\n\nvoid setup() {{\n    Serial.begin(115200);\n}}\n\n\
         void loop() {{\n    const {scalar} t = 1e-3 * millis();\n    {} motion = {{}};\n",
        context.prefix,
        of("motion")
    );
    for names in &context.names.coordinates {
        for order in 0..=names.order {
            // Derivatives of sin t, one after the other.
            let value = ["sin(t)", "cos(t)", "-sin(t)", "-cos(t)"][order as usize % 4];
            let _ = writeln!(out, "    motion.{}.{} = {value};", names.field, derivative_name(order));
        }
    }
    if context.has_constants() {
        let _ = writeln!(out, "    {} constants = {{}};", of("constants"));
        for ((symbol, name), value) in context.names.constants.iter().zip(constants) {
            let told = text::quantity(estimator, *symbol);
            let _ = match value {
                Some(value) => writeln!(out, "    constants.{name} = {}; // {told}", context.scalar.literal(*value)),
                None => writeln!(out, "    constants.{name} = 1.0; // {told} To be set: the result does not have it."),
            };
        }
    }
    let _ = write!(
        out,
        "    {} {result};\n    {}(&motion, &{}{}, &{result});\n",
        of(result),
        of(function),
        of("identified"),
        if context.has_constants() { ", &constants" } else { "" }
    );
    let fields: Vec<&String> = match forward {
        true => context.names.inputs.iter().map(|(_, name)| name).collect(),
        false => context.names.rows.iter().map(|names| &names.field).collect(),
    };
    for field in fields {
        let _ = write!(out, "    Serial.print(\"{field} \");\n    Serial.println({result}.{field}, 6);\n");
    }
    Ok(out + "    delay(10);\n}\n")
}
