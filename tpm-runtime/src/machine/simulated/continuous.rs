//! A machine under a loop in continuous time: the motion that sampling and noise disturb.
//!
//! Invariant: reference, feed-forward and feedback are evaluated wherever the integration reads the forces, on the motion
//! as it is there, so that nothing but the integration, of the fourth order, stands between the record and the equations. A
//! loop that is sampled and held leaves images beyond the sampling frequency, which fold back into the harmonics of the
//! rates with the square of the time between samples.

use crate::machine::simulated::plant::{Instant, Plant, PlantError};
use crate::run::{Ending, Record, Trial, TrialError, demand};
use std::vec;
use std::vec::Vec;
use tpm_core::control::Feedback;
use tpm_core::model::Model;

/// Plays a trial on a machine that obeys the model with the given parameters, with exact sensors and drives, one step of
/// integration per sample. The trial's own feed-forward is not used, but what it was made of: the demand of the reference.
///
/// # Errors
/// [`TrialError`] when model and trial do not fit together, or the rows do not determine the motion.
pub fn simulate_continuous(model: &dyn Model<f64>, parameters: &[f64], trial: &Trial) -> Result<Record, TrialError> {
    let dims = model.dims();
    let (n, width) = (dims.coordinates, dims.motion_len());
    // Twice as densely: a step begins, has its middle, and ends on this table.
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

#[cfg(test)]
mod tests {
    use super::simulate_continuous;
    use crate::campaign::Campaign;
    use crate::experiment::Experiment;
    use crate::run::Ending;
    use crate::run::trajectory::tests::rest_to_rest_3;
    use crate::test_models::MassSpringDrag;
    use tpm_core::harmonics::Hold;

    #[test]
    fn with_the_right_parameters_the_error_is_that_of_the_integration() {
        let file = include_str!("../../../../models/mass_spring_drag.toml");
        let error = |steps: f64| {
            let mut experiment = Experiment::parse(file).expect("the shipped file is right");
            experiment.prior = experiment.plant.parameters.clone();
            let stage = &experiment.schedule.stages[0].values;
            experiment.control.sample_time = 2.0 * std::f64::consts::PI / stage["w"] / steps;
            experiment.control.derivative_filter = None;
            let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::None).expect("fits");
            let campaign = Campaign::new(&MassSpringDrag, setup).expect("playable");
            let trial = campaign.next().expect("first");
            let record = simulate_continuous(&MassSpringDrag, &trial.parameters, trial).expect("regular");
            assert_eq!((record.ending, record.len()), (Ending::Complete, trial.samples()));
            let period = trial.samples_per_period;
            let off = |n: usize| (record.coordinates[0][n] - trial.reference[n % period * 3]).abs();
            (0..record.len()).map(off).fold(0.0, f64::max)
        };
        let (coarse, fine) = (error(256.0), error(512.0));
        assert!(coarse > 10.0 * fine && coarse < 40.0 * fine && fine < 1e-6, "{coarse:e} {fine:e}");
    }
}
