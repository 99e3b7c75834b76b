//! What given parameters miss of the forces of a record, in the time domain.

use crate::error::EstimateError;
use crate::time_domain::band::{cut_off, reach};
use crate::time_domain::equations::{Equations, Machine, RowEquations};
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::motion::{Motion, Stretch, TimeRecord};
use std::f64::consts::PI;
use tpm_controller::derivatives::RowDerivatives;
use tpm_controller::model::Model;

/// The force on one row behind the low pass, over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ForceCourse {
    /// Time of the first value from the beginning of the record, s.
    pub from: f64,
    /// Mean time between successive values, s.
    pub apart: f64,
    /// Applied force, unit of the row; not a number where the equation does not count.
    pub applied: Vec<f64>,
    /// Predicted force, unit of the row; not a number where the equation does not count.
    pub predicted: Vec<f64>,
    /// Sums of the row's terms under the weights that were asked for; not a number where the equation does not count.
    pub parts: Vec<Vec<f64>>,
}

/// What given parameters miss of one row.
#[derive(Clone, Debug, PartialEq)]
pub struct Missed {
    /// Root mean square of the applied force behind the low pass; of the row's own terms where no force is applied.
    pub force: f64,
    /// Root mean square of the prediction error.
    pub missed: f64,
    /// Root mean square of what each of the given directions changes, as a share of its terms one by one.
    pub changes: Vec<f64>,
    /// Both sides of the row over time; empty where harmonics are compared.
    pub course: ForceCourse,
}

/// What given parameters miss of a record.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Cut-off of the low pass on both sides of the rows, Hz.
    pub cut_off: f64,
    /// The rows.
    pub rows: Vec<Missed>,
}

/// How fast the motion of a record is, from which its simulation begins.
#[derive(Clone, Debug, PartialEq)]
pub struct Pace {
    /// Samples in which the motion goes to and fro once, on the average.
    pub typical_period: f64,
    /// Samples on either side of a sample over which a polynomial follows the motion.
    pub reach: usize,
    /// Highest frequency of every coordinate that stands out of its noise, Hz.
    pub highest: Vec<f64>,
    /// Step of every sensor; zero where its values lie on no grid.
    pub steps: Vec<f64>,
    /// Measured rate over the rate of the measured position, by coordinate; nothing where the rate was not measured.
    pub rate_gains: Vec<Option<f64>>,
}

impl Pace {
    /// The pace of a record.
    ///
    /// # Errors
    /// [`EstimateError::NoSignal`] when there are no samples.
    pub fn of(record: &TimeRecord<'_>) -> Result<Self, EstimateError> {
        let motion = Motion::new(record, false)?;
        let cut_off = cut_off(&motion, record.sample_time).unwrap_or_else(|| motion.fastest()) / (2.0 * PI);
        Ok(Pace {
            typical_period: motion.typical_period / record.sample_time,
            reach: reach(cut_off.max(f64::MIN_POSITIVE), record.sample_time),
            highest: motion.highest.iter().map(|frequency| frequency / (2.0 * PI)).collect(),
            steps: motion.steps,
            rate_gains: motion.rate_gains,
        })
    }
}

/// Predicts the forces of a record from its motion, with one value per parameter of the model; `directions` are those along which each
/// row's change is told, `parts` weights of parameters for every row whose sums of terms are told over time.
///
/// # Errors
/// [`EstimateError::NoSignal`] when the stretches are too short for any band, [`EstimateError::Model`] and
/// [`EstimateError::NotFinite`] when the rows cannot be evaluated on the motion.
pub fn predict_in_band(
    model: &dyn Model<f64>,
    derivatives: Option<&dyn RowDerivatives<f64>>,
    constants: &[f64],
    record: &TimeRecord<'_>,
    parameters: &[f64],
    directions: &[Vec<f64>],
    parts: &[Vec<Vec<f64>>],
) -> Result<Prediction, EstimateError> {
    let dims = model.dims();
    let motion = Motion::new(record, false)?;
    let cut_off = cut_off(&motion, record.sample_time).ok_or(EstimateError::NoSignal)?;
    let machine = Machine { model, derivatives, constants };
    let lost = Equations::lost(LowPass { cut_off });
    let equations = Equations::of(machine, record, &motion, LowPass { cut_off })?;
    if equations.instants() == 0 {
        return Err(EstimateError::NoSignal);
    }
    let width = dims.parameters + 1;
    let lengths = record.stretches.iter().map(Stretch::samples);
    let kept: f64 = lengths.map(|samples| (samples as f64 * record.sample_time - 2.0 * lost).max(0.0)).sum();
    let apart = kept / equations.instants() as f64;
    let missed = |(index, row): (usize, &RowEquations)| {
        let counted = || row.entries.chunks_exact(width).zip(&row.counts).filter(|(_, counts)| **counts);
        let count = counted().count().max(1) as f64;
        let mean = |of: &dyn Fn(&[f64]) -> f64| (counted().map(|(entries, _)| of(entries)).sum::<f64>() / count).sqrt();
        let along = |entries: &[f64], weights: &[f64]| entries.iter().zip(weights).map(|(a, b)| a * b).sum::<f64>();
        let alone = |weights: &[f64]| {
            mean(&|entries| entries.iter().zip(weights).map(|(entry, weight)| (entry * weight).powi(2)).sum())
        };
        let force = if row.driven { mean(&|entries| entries[width - 1].powi(2)) } else { alone(parameters) };
        let change = |direction: &Vec<f64>| {
            let terms = alone(direction);
            if terms > 0.0 { mean(&|entries| along(entries, direction).powi(2)) / terms } else { 0.0 }
        };
        let course = |of: &dyn Fn(&[f64]) -> f64| -> Vec<f64> {
            let all = row.entries.chunks_exact(width).zip(&row.counts);
            all.map(|(entries, counts)| if *counts { of(entries) } else { f64::NAN }).collect()
        };
        Missed {
            course: ForceCourse {
                from: lost,
                apart,
                applied: course(&|entries| entries[width - 1]),
                predicted: course(&|entries| along(entries, parameters)),
                parts: (parts.get(index).into_iter().flatten())
                    .map(|weights| course(&|entries| along(entries, weights)))
                    .collect(),
            },
            force,
            missed: mean(&|entries| (entries[width - 1] - along(entries, parameters)).powi(2)),
            changes: directions.iter().map(change).collect(),
        }
    };
    Ok(Prediction { cut_off: cut_off / (2.0 * PI), rows: equations.rows.iter().enumerate().map(missed).collect() })
}
