//! State feedback on a simulated machine: sensors, rates from differences, drive with its limit.
//!
//! Invariant: the feedback uses the readings of the sensors alone; the cost is that of the true state, which only a
//! simulation knows.

use crate::regulator::{Regulator, RegulatorWeights};
use crate::simulated::rig::Rig;
use crate::simulated::sensor::{Measurement, apply};
use crate::simulated::transmission::Transmission;
use tpm_controller::control::Differentiator;
use tpm_controller::model::{Buffer, EvalError, Model, require_len};
use tpm_motion::{Ending, Plant, Record};

/// A regulator with the run that it plays.
#[derive(Clone, Debug, PartialEq)]
pub struct Regulation<'a> {
    /// The feedback; it holds the coordinates at zero.
    pub regulator: &'a Regulator,
    /// Time constant of the filtered difference that forms the rates, s; zero for the plain difference.
    pub derivative_filter: f64,
    /// Where the machine starts, at rest: one value per coordinate.
    pub start: Vec<f64>,
    /// Samples to play.
    pub samples: usize,
    /// Largest magnitude per coordinate; beyond it the run has failed.
    pub bounds: Vec<f64>,
    /// Weights of the cost that is summed over the run.
    pub weights: &'a RegulatorWeights,
}

/// The run of a regulator that keeps a machine at rest, with its cost.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Regulated {
    /// Samples that were measured and applied.
    pub record: Record,
    /// `sum T (x' Q x + u' R u)` of the true state.
    pub cost: f64,
    /// Coordinates at the end.
    pub last: Vec<f64>,
    /// Largest true magnitude per coordinate over the last fifth.
    pub late: Vec<f64>,
}

/// Plays a regulator on a simulated machine of second order.
///
/// # Errors
/// [`EvalError`] when model, rig and regulation do not fit together, or the plant's rows do not determine its motion.
pub fn regulate(model: &dyn Model<f64>, rig: &Rig, regulation: &Regulation<'_>) -> Result<Regulated, EvalError> {
    let dims = model.dims();
    let n = dims.coordinates;
    require_len(Buffer::Motion, rig.sensors.len(), n)?;
    require_len(Buffer::Motion, regulation.start.len(), n)?;
    require_len(Buffer::Motion, regulation.bounds.len(), n)?;
    require_len(Buffer::Motion, regulation.regulator.gain().columns(), 2 * n)?;
    require_len(Buffer::Inputs, rig.actuators.len(), dims.inputs)?;
    require_len(Buffer::Inputs, regulation.regulator.gain().rows(), dims.inputs)?;
    let sample_time = regulation.regulator.sample_time();
    let mut plant = Plant::new(model, &rig.parameters, &rig.constants)?;
    let mut start = vec![0.0; dims.motion_len()];
    start[..n].copy_from_slice(&regulation.start);
    plant.reset(&start)?;
    let mut measurement = Measurement::new(&rig.sensors, rig.seed, 0);
    let mut transmission = Transmission::new(&rig.actuators, sample_time, rig.sub_steps);
    let mut filters = vec![Differentiator::new(sample_time, regulation.derivative_filter); n];
    let (mut state, mut inputs) = (vec![0.0; 2 * n], vec![0.0; dims.inputs]);
    let mut found = Regulated {
        record: Record {
            sample_time,
            coordinates: vec![Vec::with_capacity(regulation.samples); n],
            inputs: vec![Vec::with_capacity(regulation.samples); dims.inputs],
            rates: Vec::new(),
            ending: Ending::Complete,
            saturated: 0,
        },
        cost: 0.0,
        last: regulation.start.clone(),
        late: vec![0.0; n],
    };
    let settled = regulation.samples - regulation.samples / 5;
    for sample in 0..regulation.samples {
        let (measured, rates) = state.split_at_mut(n);
        measurement.sample(plant.motion(), measured);
        for ((rate, filter), value) in rates.iter_mut().zip(&mut filters).zip(measured.iter()) {
            *rate = filter.push(*value);
        }
        for (i, input) in inputs.iter_mut().enumerate() {
            *input = -regulation.regulator.gain().dense().row(i).iter().zip(&state).map(|(k, x)| k * x).sum::<f64>();
        }
        found.record.saturated +=
            usize::from(apply(&rig.actuators, (plant.motion(), n), &mut inputs, &mut found.record.inputs));
        for (column, value) in found.record.coordinates.iter_mut().zip(&state) {
            column.push(*value);
        }
        found.cost += sample_time * regulation.weights.cost(&plant.motion()[..2 * n], &inputs);
        if transmission.advance(&mut plant, &inputs)? {
            found.record.ending = Ending::Diverged { sample };
            break;
        }
        found.last.copy_from_slice(&plant.motion()[..n]);
        let passed = |c: usize| Ending::of_error(c, sample, found.last[c], regulation.bounds[c]);
        if let Some(ending) = (0..n).find_map(passed) {
            found.record.ending = ending;
            break;
        }
        if sample >= settled {
            for (late, value) in found.late.iter_mut().zip(&found.last) {
                *late = late.max(value.abs());
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::{Regulation, regulate};
    use crate::regulator::{Regulator, RegulatorWeights};
    use crate::simulated::rig::Rig;
    use crate::simulated::sensor::{Actuator, Sensor};
    use tpm_motion::Ending;
    use tpm_numerics::Matrix;
    use tpm_test_support::models::MassSpringDrag;

    /// m = 2, k1 = -8: a mass on a spring of negative stiffness, x'' = 4 x + u/2.
    fn rig(step: f64) -> Rig {
        Rig {
            parameters: vec![2.0, -8.0, 0.0],
            constants: vec![],
            sensors: vec![Sensor { step, ..Sensor::default() }],
            actuators: vec![Actuator { limit: 40.0, ..Actuator::default() }],
            sub_steps: 4,
            seed: 1,
        }
    }

    fn regulator(weights: &RegulatorWeights) -> Regulator {
        let a = Matrix::from_rows(&[vec![0.0, 1.0], vec![4.0, 0.0]]).expect("rows of one length");
        let b = Matrix::from_rows(&[vec![0.0], vec![0.5]]).expect("rows of one length");
        Regulator::optimal(&a, &b, 1e-3, weights).expect("can be stabilised")
    }

    /// Ten seconds from rest at `start`, plain differences as rates.
    fn regulation<'a>(
        regulator: &'a Regulator,
        weights: &'a RegulatorWeights,
        start: f64,
        bound: f64,
    ) -> Regulation<'a> {
        let (start, bounds) = (vec![start], vec![bound]);
        Regulation { regulator, derivative_filter: 0.0, start, samples: 10_000, bounds, weights }
    }

    #[test]
    fn an_unstable_mass_comes_to_rest_at_the_stated_cost() {
        let weights = RegulatorWeights { state: vec![10.0, 0.0], input: vec![0.1] };
        let regulator = regulator(&weights);
        let regulation = regulation(&regulator, &weights, 0.1, 1.0);
        let found = regulate(&MassSpringDrag, &rig(0.0), &regulation).expect("fits");
        assert_eq!((found.record.ending, found.record.len()), (Ending::Complete, 10_000));
        assert!(found.late[0] < 1e-6, "{found:?}", found = found.late);
        // The rate is a difference and lags by half a sample, so that the cost is nearly the least one.
        let least = regulator.cost_from(&[0.1, 0.0]);
        assert!((found.cost / least - 1.0).abs() < 1e-2, "{} {least}", found.cost);
        // The steps of an encoder keep it moving, within a few steps.
        let stepped = regulate(&MassSpringDrag, &rig(1e-3), &regulation).expect("fits");
        assert!(stepped.late[0] > 1e-5 && stepped.late[0] < 1e-2, "{:?}", stepped.late);
    }

    #[test]
    fn a_drive_that_is_too_weak_is_seen() {
        let weights = RegulatorWeights { state: vec![10.0, 0.0], input: vec![0.1] };
        let regulator = regulator(&weights);
        // The spring pushes with 48 N there, the drive with 40.
        let regulation = regulation(&regulator, &weights, 6.0, 10.0);
        let found = regulate(&MassSpringDrag, &rig(0.0), &regulation).expect("fits");
        assert!(
            matches!(found.record.ending, Ending::TrackingBound { coordinate: 0, .. }),
            "{:?}",
            found.record.ending
        );
        assert!(found.record.saturated == found.record.len() && found.record.len() < 10_000);
        let wrong = Regulation { start: vec![0.0, 0.0], ..regulation };
        assert!(regulate(&MassSpringDrag, &rig(0.0), &wrong).is_err());
    }
}
