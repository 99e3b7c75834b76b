//! Rust of a regulator: a module that depends on `core` alone.

use super::super::c::Scalar;
use super::super::estimator::EmitError;
use super::super::name::{Language, snake};
use super::super::number::{digits, digits_single};
use super::super::regulator::{RegulatorSource, Signal, term};
use super::super::text::filled;

/// Widest line of the documentation.
const WIDTH: usize = 100;

/// The module's name and its source text.
///
/// # Errors
/// [`EmitError::OutOfScalar`] when a number is beyond the scalar.
pub fn file(regulator: &RegulatorSource, command: &str, scalar: Scalar) -> Result<(String, String), EmitError> {
    regulator.check(scalar)?;
    let real = match scalar {
        Scalar::Float => "f32",
        Scalar::Double => "f64",
    };
    // The cast performs the rounding.
    #[allow(clippy::cast_possible_truncation)]
    let literal = |value: f64| match scalar {
        Scalar::Float => digits_single(value as f32),
        Scalar::Double => digits(value),
    };
    let (coordinates, inputs) = regulator.names(Language::Rust);
    let structure = |name: &str, about: &str, signals: &[Signal], names: &[String], rate: bool| {
        let fields: String = signals
            .iter()
            .zip(names)
            .map(|(signal, name)| {
                format!("    /// {}\n    pub {name}: {real},\n", RegulatorSource::field(signal, rate))
            })
            .collect();
        format!("/// {about}\n#[derive(Clone, Copy, Debug, Default, PartialEq)]\npub struct {name} {{\n{fields}}}\n\n")
    };
    let mut text = String::new();
    for line in filled(&regulator.about(command), WIDTH) {
        text.push_str(if line.is_empty() { "//!" } else { "//! " });
        text.push_str(&line);
        text.push('\n');
    }
    text.push_str("\n#![cfg_attr(rustfmt, rustfmt_skip)]\n#![allow(non_snake_case, clippy::excessive_precision, clippy::suboptimal_flops)]\n\n");
    text.push_str(&structure("Positions", "Measured coordinates.", &regulator.coordinates, &coordinates, false));
    text.push_str(&structure("Rates", "Their rates.", &regulator.coordinates, &coordinates, true));
    text.push_str(&structure("Inputs", "Inputs, to be held until the next sample.", &regulator.inputs, &inputs, false));
    text.push_str("/// The inputs from coordinates and rates.\n#[must_use]\npub fn feedback(positions: &Positions, rates: &Rates) -> Inputs {\n    Inputs {\n");
    for ((row, signal), name) in regulator.gain.iter().zip(&regulator.inputs).zip(&inputs) {
        text.push_str(&format!("        {name}: {}", literal(signal.at)));
        for (at, factor) in row.iter().enumerate() {
            let coordinate = at % coordinates.len();
            let point = regulator.coordinates[coordinate].at;
            let value = match (at < coordinates.len(), point == 0.0) {
                (true, true) => format!("positions.{}", coordinates[coordinate]),
                (true, false) => format!("(positions.{} - {})", coordinates[coordinate], literal(point)),
                (false, _) => format!("rates.{}", coordinates[coordinate]),
            };
            text.push_str(&format!("\n            {} * {value}", term(*factor, &literal)));
        }
        text.push_str(",\n");
    }
    text.push_str("    }\n}\n");
    if let Some(pole) = regulator.differences {
        text.push_str(
            "\n/// The last sample and the rates there: memory of the caller.\n#[derive(Clone, Copy, Debug, Default, PartialEq)]\npub struct Past {\n    last: Option<Positions>,\n    rates: Rates,\n}\n\nimpl Past {\n    /// Takes in the coordinates of a sample, forms their rates, and gives the inputs.\n    pub fn regulate(&mut self, positions: &Positions) -> Inputs {\n        let last = self.last.replace(*positions).unwrap_or(*positions);\n",
        );
        let (pole, slope) = (literal(pole), literal(regulator.slope(pole)));
        for name in &coordinates {
            text.push_str(&format!(
                "        self.rates.{name} = {pole} * self.rates.{name} + {slope} * (positions.{name} - last.{name});\n"
            ));
        }
        text.push_str("        feedback(positions, &self.rates)\n    }\n}\n");
    }
    let name = format!("{}_regulator", snake(&regulator.model));
    Ok((name, text))
}
