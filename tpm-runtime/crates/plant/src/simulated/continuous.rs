//! A machine under a loop in continuous time, without sampling and noise.
//!
//! Invariant: reference, feed-forward and feedback are evaluated at every instant at which the integration evaluates
//! the forces, at the motion of that instant. The only error of the record is then that of the fourth-order
//! integration. A loop that is sampled and held has images beyond the sampling frequency, which alias into the
//! harmonics of the rates with the square of the time between samples.

use tpm_controller::control::Feedback;
use tpm_controller::model::Model;
use tpm_motion::forward::{Instant, Plant, PlantError};
use tpm_motion::{Ending, Record, Trial, TrialError, demand};

/// Plays a trial on a machine that obeys the model with the given parameters, with exact sensors and drives, one step of
/// integration per sample. In place of the trial's sampled feed-forward the demand of the reference is used.
///
/// # Errors
/// [`TrialError`] when model and trial do not fit together, or the rows do not determine the motion.
pub fn simulate_continuous(model: &dyn Model<f64>, parameters: &[f64], trial: &Trial) -> Result<Record, TrialError> {
    let dims = model.dims();
    let (n, width) = (dims.coordinates, dims.motion_len());
    // The table has two points per sample, so that start, middle and end of a step lie on it.
    let points = 2 * trial.samples_per_period;
    let mut reference = vec![0.0; points * width];
    for (at, motion) in reference.chunks_exact_mut(width).enumerate() {
        trial.trajectory.motion_at(at, points, 0.0, motion);
    }
    let feed_forward = demand(model, &reference, &trial.parameters, &trial.constants)?;
    let mut plant = Plant::new(model, parameters, &trial.constants)?;
    let mut start = vec![0.0; width];
    start[..n].copy_from_slice(&reference[..n]);
    plant.reset(&start)?;
    let (mut errors, mut rates) = (vec![0.0; n], vec![0.0; n]);
    let mut command = |at: usize, motion: &[f64], inputs: &mut [f64]| {
        let at = at % points;
        for (c, (error, rate)) in errors.iter_mut().zip(&mut rates).enumerate() {
            *error = motion[c] - reference[at * width + c];
            *rate = if dims.order > 0 { motion[n + c] - reference[at * width + n + c] } else { 0.0 };
        }
        inputs.copy_from_slice(&feed_forward[at * dims.inputs..(at + 1) * dims.inputs]);
        Feedback::new(&trial.control.gains, &mut []).add(&errors, Some(&rates), inputs)
    };
    let reserve = |count: usize| -> Vec<Vec<f64>> { (0..count).map(|_| Vec::with_capacity(trial.samples())).collect() };
    let mut record = Record {
        sample_time: trial.control.sample_time,
        coordinates: reserve(n),
        inputs: reserve(dims.inputs),
        rates: Vec::new(),
        ending: Ending::Complete,
        saturated: 0,
    };
    let mut inputs = vec![0.0; dims.inputs];
    for sample in 0..trial.samples() {
        command(2 * sample, plant.motion(), &mut inputs)?;
        let values = plant.motion()[..n].iter().chain(&inputs);
        for (column, value) in record.coordinates.iter_mut().chain(&mut record.inputs).zip(values) {
            column.push(*value);
        }
        let mut law = |instant: Instant, motion: &[f64], inputs: &mut [f64]| {
            command(2 * sample + instant as usize, motion, inputs)
        };
        let mut step = |plant: &mut Plant<'_>, h: f64| plant.step_under(&mut inputs, h, &mut law);
        match plant.advance_by(trial.control.sample_time, 1, &mut step) {
            Ok(()) => {}
            Err(PlantError::Diverged { .. }) => {
                record.ending = Ending::Diverged { sample };
                break;
            }
            Err(PlantError::Evaluation(fault)) => return Err(fault.into()),
        }
    }
    Ok(record)
}
