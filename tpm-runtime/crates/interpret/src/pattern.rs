//! Patterns of a model file in which the constants have numerical values.
//!
//! Invariant: each exact coefficient is rounded once. In a [`ReferencePattern`] the amplitudes and the frequency remain
//! free.

use tpm_motion::trajectory::{HarmonicSeries, Line, Part, PatternError, ReferencePattern};
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::number::rational::to_f64;
use tpm_symbolic::plan::evaluation::Evaluation;
use tpm_symbolic::regressor::form::RegressorForm;

/// The pattern of a model with numerical values of its constants; each exact coefficient is rounded once.
///
/// `constant` gives the value of a run-time constant by name.
///
/// # Errors
/// [`PatternError::NoMotion`] when the pattern leaves a coordinate open, [`PatternError::NoValue`] when `constant` does not
/// know a constant of the pattern.
pub fn of_model(
    pattern: &Pattern,
    model: &ExactModel,
    constant: impl Fn(&str) -> Option<f64>,
) -> Result<ReferencePattern, PatternError> {
    let all: Vec<usize> = (0..model.coordinates.len()).collect();
    let this = of_coordinates(pattern, model, &all, constant)?;
    match this.open().first() {
        Some(&c) => Err(PatternError::NoMotion { coordinate: model.coordinates[c].name.clone() }),
        None => Ok(this),
    }
}

/// The pattern of the coordinates that the rows of a regressor form use, in the order of a model made of that form. A
/// coordinate without a prescribed motion is left open.
///
/// # Errors
/// [`PatternError::NoValue`] when `constant` does not know a constant of the pattern.
pub fn of_rows(
    pattern: &Pattern,
    model: &ExactModel,
    form: &RegressorForm,
    constant: impl Fn(&str) -> Option<f64>,
) -> Result<ReferencePattern, PatternError> {
    let evaluation = Evaluation::new(model, form);
    let used: Vec<usize> = evaluation.coordinates.iter().map(|(coordinate, _)| coordinate.0 as usize).collect();
    of_coordinates(pattern, model, &used, constant)
}

fn of_coordinates(
    pattern: &Pattern,
    model: &ExactModel,
    coordinates: &[usize],
    constant: impl Fn(&str) -> Option<f64>,
) -> Result<ReferencePattern, PatternError> {
    let mut motions = Vec::with_capacity(coordinates.len());
    for &c in coordinates {
        let mut parts = Vec::new();
        let Some(motion) = pattern.motions.get(c).and_then(Option::as_ref) else {
            motions.push(parts);
            continue;
        };
        for (monomial, fourier) in motion.terms() {
            let (mut powers, mut frequency_power) = (Vec::new(), 0);
            let mut factor = 1.0;
            for (&symbol, power) in monomial.factors() {
                if let Some(which) = pattern.amplitudes.iter().position(|a| *a == symbol) {
                    powers.push((which, power));
                    continue;
                }
                if symbol == pattern.frequency {
                    frequency_power = power;
                    continue;
                }
                let quantity = model.quantity(symbol);
                let value = match &quantity.kind {
                    Kind::Constant { value: Some(value) } => Some(to_f64(value)),
                    _ => constant(&quantity.name),
                };
                factor *=
                    value.ok_or_else(|| PatternError::NoValue { name: quantity.name.as_str().into() })?.powi(power);
            }
            let mut series = HarmonicSeries::default();
            for (harmonic, function, coefficient) in fourier.terms() {
                let value = factor * to_f64(coefficient);
                if harmonic == 0 {
                    series.mean += value;
                    continue;
                }
                let harmonic = u32::try_from(harmonic).unwrap_or(u32::MAX);
                let (cos, sin) = if function == Trig::Cos { (value, 0.0) } else { (0.0, value) };
                series.lines.push(Line { harmonic, cos, sin });
            }
            parts.push(Part { powers, frequency_power, series });
        }
        if parts.is_empty() {
            // The coordinate is prescribed to stay at zero, which differs from an open coordinate.
            parts.push(Part { powers: Vec::new(), frequency_power: 0, series: HarmonicSeries::default() });
        }
        motions.push(parts);
    }
    Ok(ReferencePattern {
        name: pattern.name.as_deref().map(Into::into),
        amplitudes: pattern.amplitudes.iter().map(|&a| model.quantity(a).name.as_str().into()).collect(),
        frequency: model.quantity(pattern.frequency).name.as_str().into(),
        coordinates: motions,
        others: Vec::new(),
    })
}
