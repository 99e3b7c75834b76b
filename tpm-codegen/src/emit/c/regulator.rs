//! C99 of a regulator: a header and a source without includes of the C library.

use super::super::estimator::EmitError;
use super::super::name::{Language, Namer, snake};
use super::super::regulator::{RegulatorSource, Signal, term};
use super::Files;
use super::context::is_prefix;
use super::expression::Scalar;
use super::layout::{doc, signature, statement};

/// The header and source of a regulator.
///
/// # Errors
/// [`EmitError::Prefix`] when the prefix cannot begin names of C, [`EmitError::OutOfScalar`] when a number is beyond the scalar.
pub fn files(
    regulator: &RegulatorSource,
    command: &str,
    prefix: Option<&str>,
    scalar: Scalar,
) -> Result<Files, EmitError> {
    regulator.check(scalar)?;
    // The prefix of all names.
    let prefix = match prefix {
        Some(prefix) if is_prefix(prefix) => prefix.to_owned(),
        Some(prefix) => return Err(EmitError::Prefix(prefix.to_owned())),
        None => {
            let name = Namer::new(Language::C, &[]).name(&snake(&regulator.model));
            format!("{}_regulator", name.trim_end_matches('_'))
        }
    };
    let real = scalar.name();
    let literal = |value: f64| scalar.literal(rounded(scalar, value));
    let (coordinates, inputs) = regulator.names(Language::C);
    // Types of coordinates, rates and inputs.
    let structure = |name: &str, about: &str, signals: &[Signal], names: &[String], rate: bool| {
        let fields: String = signals
            .iter()
            .zip(names)
            .map(|(signal, name)| format!("{}    {real} {name};\n", doc(1, &RegulatorSource::field(signal, rate))))
            .collect();
        format!("{}typedef struct {{\n{fields}}} {prefix}_{name};\n\n", doc(0, about))
    };
    let mut types = structure("positions", "Measured coordinates.", &regulator.coordinates, &coordinates, false);
    types.push_str(&structure("rates", "Their rates.", &regulator.coordinates, &coordinates, true));
    types.push_str(&structure(
        "inputs",
        "Inputs, to be held until the next sample.",
        &regulator.inputs,
        &inputs,
        false,
    ));
    // The feedback from coordinates and rates.
    let mut functions = String::new();
    let mut source = String::new();
    let (positions, rates) = (format!("const {prefix}_positions *positions"), format!("const {prefix}_rates *rates"));
    let result = format!("{prefix}_inputs");
    let feedback = signature(&result, &format!("{prefix}_feedback"), &[&positions, &rates]);
    functions.push_str(&format!("{}{feedback};\n", doc(0, "The inputs from coordinates and rates.")));
    source.push_str(&format!("\n{feedback}\n{{\n    {prefix}_inputs inputs;\n"));
    for ((row, signal), name) in regulator.gain.iter().zip(&regulator.inputs).zip(&inputs) {
        let mut text = format!("inputs.{name} = {}", literal(signal.at));
        for (at, factor) in row.iter().enumerate() {
            let coordinate = at % coordinates.len();
            let point = regulator.coordinates[coordinate].at;
            let value = match (at < coordinates.len(), point == 0.0) {
                (true, true) => format!("positions->{}", coordinates[coordinate]),
                (true, false) => format!("(positions->{} - {})", coordinates[coordinate], literal(point)),
                (false, _) => format!("rates->{}", coordinates[coordinate]),
            };
            text.push_str(&format!(" {} * {value}", term(*factor, &literal)));
        }
        source.push_str(&statement(1, &format!("{text};")));
    }
    source.push_str("    return inputs;\n}\n");
    // Where rates are not measured, a filtered difference forms them.
    if let Some(pole) = regulator.differences {
        types.push_str(&format!(
            "{}typedef struct {{\n    {prefix}_positions last;\n    {prefix}_rates rates;\n{}    int started;\n}} {prefix}_past;\n\n",
            doc(0, "The last sample and the rates there: memory of the caller, cleared before the first sample."),
            doc(1, "0 before the first sample.")
        ));
        let past = format!("{prefix}_past *past");
        let clear = signature("void", &format!("{prefix}_clear"), &[&past]);
        let regulate = signature(&result, &format!("{prefix}_regulate"), &[&past, &positions]);
        functions.push_str(&format!("\n{}{clear};\n", doc(0, "Forgets all samples.")));
        functions.push_str(&format!(
            "\n{}{regulate};\n",
            doc(0, "Takes in the coordinates of a sample, forms their rates, and gives the inputs.")
        ));
        source.push_str(&format!("\n{clear}\n{{\n"));
        for name in &coordinates {
            let zero = scalar.literal(0.0);
            source.push_str(&format!("    past->last.{name} = {zero};\n    past->rates.{name} = {zero};\n"));
        }
        source.push_str("    past->started = 0;\n}\n");
        source.push_str(&format!("\n{regulate}\n{{\n    if (past->started == 0) {{\n        past->last = *positions;\n        past->started = 1;\n    }}\n"));
        let (pole, slope) = (literal(pole), literal(regulator.slope(pole)));
        for name in &coordinates {
            source.push_str(&statement(
                1,
                &format!(
                    "past->rates.{name} = {pole} * past->rates.{name} + {slope} * (positions->{name} - past->last.{name});"
                ),
            ));
        }
        source.push_str(&format!(
            "    past->last = *positions;\n    return {prefix}_feedback(positions, &past->rates);\n}}\n"
        ));
    }
    // The header and the source.
    let guard = format!("{}_H_INCLUDED", prefix.to_uppercase());
    let header = format!(
        "{}#ifndef {guard}\n#define {guard}\n\n#ifdef __cplusplus\nextern \"C\" {{\n#endif\n\n{types}{functions}\n#ifdef __cplusplus\n}}\n#endif\n\n#endif\n",
        doc(0, &regulator.about(command))
    );
    let about = format!(
        "`{}`: what `{prefix}.h` declares. Generated by\n`{command}`; to change it, change the model or the weights.",
        regulator.model
    );
    let source = format!("{}#include \"{prefix}.h\"\n{source}", doc(0, &about));
    Ok(Files { name: prefix, header, source })
}

/// A number rounded to the scalar.
fn rounded(scalar: Scalar, value: f64) -> f64 {
    // The cast performs the rounding.
    #[allow(clippy::cast_possible_truncation)]
    match scalar {
        Scalar::Float => f64::from(value as f32),
        Scalar::Double => value,
    }
}
