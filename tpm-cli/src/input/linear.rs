//! Linear models of a model at rest in a point: the point from `--at`, and state space in numbers.

use crate::failure::Failure;
use crate::input::assignments::once;
use crate::input::values::Values;
use crate::output::file;
use tpm_codegen::parse_value;
use tpm_codegen::source::Source;
use tpm_symbolic::expr::graph::Coordinate;
use tpm_symbolic::linear::linearize::{Linearization, OperatingPoint, StateSpace};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational::{self, Rational};

/// The operating point from the coordinates and inputs that were given.
pub(crate) fn operating_point(
    at: &[(String, String)],
    model: &mut ExactModel,
    coordinates: &[String],
    inputs: &[String],
) -> Result<OperatingPoint, Failure> {
    let mut point = OperatingPoint::default();
    once("--at", at)?;
    for (name, text) in at {
        let source = Source::new(format!("--at {name}"), text.as_str());
        let value = parse_value(&source, model).map_err(|diagnostics| Failure::Model(diagnostics.render(&source)))?;
        if let Some(c) = coordinates.iter().position(|other| other == name) {
            point.coordinates.push((Coordinate(c as u32), value));
        } else if let Some(symbol) = inputs.iter().position(|other| other == name).and_then(|i| model.inputs().nth(i)) {
            point.inputs.push((symbol, value));
        } else {
            return Err(Failure::Input(format!(
                "--at {name}: the model has no such coordinate or input; it has {}",
                [coordinates, inputs].concat().join(", ")
            )));
        }
    }
    Ok(point)
}

/// Says which dry friction a linear model leaves out; nothing where there is none.
pub(crate) fn tell_friction(model: &ExactModel, linear: &Linearization) {
    let said: Vec<String> = (linear.friction.iter())
        .map(|(equation, sign)| format!("{} in equation {equation}", model.display_brief(*sign)))
        .collect();
    if !said.is_empty() {
        file::remark(&format!(
            "remark: dry friction is left out ({}): this is the linear model of a machine that moves one way, on which friction is a constant \
             force; from rest it moves only where more than that acts",
            said.join(", ")
        ));
    }
}

/// A and B in rational numbers, and whether they are exact; `None` when no values were given. Parameters that a result leaves open
/// may stay so where no entry depends on them.
pub(crate) fn state_space(
    model: &ExactModel,
    linear: &Linearization,
    values: &Values,
) -> Result<Option<(StateSpace<Rational>, bool)>, Failure> {
    let missing = values.missing(model, None);
    if !missing.is_empty() {
        if values.is_empty() {
            return Ok(None);
        }
        let flags: Vec<String> = missing.iter().map(|name| format!("--value {name}=VALUE")).collect();
        return Err(Failure::Input(format!("for numbers, values are missing; give {}", flags.join(" "))));
    }
    let values = values.settled(|values| {
        let (space, _) = evaluated(model, linear, values)?;
        let names: Vec<&str> = model.coordinates.iter().map(|coordinate| coordinate.name.as_str()).collect();
        let rates = names.iter().map(|name| format!("dot({name})"));
        let inputs = model.inputs().map(|input| model.quantity(input).name.to_string());
        let columns: Vec<String> =
            names.iter().map(|name| (*name).to_owned()).chain(rates.clone()).chain(inputs).collect();
        // The upper half says that rates are rates.
        let rows = space.a.iter().zip(&space.b).skip(names.len()).zip(rates);
        let entries = rows.flat_map(|((a, b), rate)| {
            let named = |(entry, column): (&Rational, &String)| {
                (format!("the entry of {column} in d/dt {rate}"), rational::to_f64(entry))
            };
            a.iter().chain(b).zip(&columns).map(named).collect::<Vec<_>>()
        });
        Ok(entries.collect())
    })?;
    evaluated(model, linear, &values).map(Some)
}

/// A and B with a value for every parameter, and whether they are exact.
fn evaluated(
    model: &ExactModel,
    linear: &Linearization,
    values: &Values,
) -> Result<(StateSpace<Rational>, bool), Failure> {
    if let Some(exact) = linear.evaluate_exact(model, |symbol| values.get(symbol).cloned()) {
        return Ok((exact, true));
    }
    let rounded = linear.evaluate(model, |symbol| values.get(symbol).map_or(f64::NAN, rational::to_f64));
    let exactly = |matrix: &[Vec<f64>]| -> Option<Vec<Vec<Rational>>> {
        matrix.iter().map(|row| row.iter().map(|&value| rational::from_f64(value)).collect()).collect()
    };
    match (exactly(&rounded.a), exactly(&rounded.b)) {
        (Some(a), Some(b)) => Ok((StateSpace { a, b }, false)),
        _ => Err(Failure::Input(
            "with these values the mass matrix is singular or an entry is not finite; check them".to_owned(),
        )),
    }
}
