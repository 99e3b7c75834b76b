//! The motion-independent and the motion-dependent part of every input along a motion, computed numerically.
//!
//! Invariant: the motion-independent part of an input is the value that the rows require of it at the same instant with
//! all derivatives of the coordinates that it drives set to zero; the motion-dependent part is the rest (Feng, section
//! 6.2). The split needs only the model's rows, so that hand-written, compiled and interpreted models are split alike;
//! the symbolic parts are those of `tpm_symbolic::plan::split`.

use tpm_controller::model::Model;
use tpm_motion::trajectory::Trajectory;
use tpm_motion::{TrialError, demand};

/// A model with its parameters and constants, from which the inputs that a motion requires are computed.
#[derive(Clone)]
pub struct Demand<'m> {
    model: &'m dyn Model<f64>,
    parameters: Vec<f64>,
    constants: Vec<f64>,
    driven: Vec<Vec<usize>>,
}

impl std::fmt::Debug for Demand<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Demand")
            .field("model", &self.model.name())
            .field("driven", &self.driven)
            .finish_non_exhaustive()
    }
}

/// The parts of all inputs along a motion.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Parts {
    /// Number of samples.
    pub samples: usize,
    /// Per sample the motion, as models read it.
    pub motions: Vec<f64>,
    /// Per sample, one motion-independent part per input.
    pub independent: Vec<f64>,
    /// Per sample, one motion-dependent part per input.
    pub dependent: Vec<f64>,
}

impl<'m> Demand<'m> {
    /// `driven` lists the coordinates that every input drives.
    #[must_use]
    pub fn new(model: &'m dyn Model<f64>, parameters: &[f64], constants: &[f64], driven: &[Vec<usize>]) -> Self {
        Demand { model, parameters: parameters.to_vec(), constants: constants.to_vec(), driven: driven.to_vec() }
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &'m dyn Model<f64> {
        self.model
    }

    /// Values of the parameters.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Values of the constants.
    #[must_use]
    pub fn constants(&self) -> &[f64] {
        &self.constants
    }

    /// The coordinates that an input drives; none for an index beyond the inputs.
    #[must_use]
    pub fn driven(&self, input: usize) -> &[usize] {
        self.driven.get(input).map_or(&[], Vec::as_slice)
    }

    /// The parts at `samples` instants of one period, from its start.
    ///
    /// # Errors
    /// [`TrialError`] when the model cannot be evaluated along the motion or its inputs are not determined.
    pub fn along(&self, trajectory: &Trajectory, samples: usize) -> Result<Parts, TrialError> {
        let dims = self.model.dims();
        let mut motions = vec![0.0; samples * dims.motion_len()];
        for (n, motion) in motions.chunks_exact_mut(dims.motion_len()).enumerate() {
            trajectory.motion_at(n, samples, 0.0, motion);
        }
        self.at(motions)
    }

    /// The inputs at given motions, interleaved per sample.
    ///
    /// # Errors
    /// [`TrialError`] when the model cannot be evaluated at a motion or its inputs are not determined.
    pub fn whole(&self, motions: &[f64]) -> Result<Vec<f64>, TrialError> {
        demand(self.model, motions, &self.parameters, &self.constants)
    }

    /// The parts at given motions.
    ///
    /// # Errors
    /// [`TrialError`] when the model cannot be evaluated at a motion or its inputs are not determined.
    pub fn at(&self, motions: Vec<f64>) -> Result<Parts, TrialError> {
        let dims = self.model.dims();
        let whole = self.whole(&motions)?;
        let mut independent = vec![0.0; whole.len()];
        let mut still = motions.clone();
        for input in 0..dims.inputs {
            still.copy_from_slice(&motions);
            for motion in still.chunks_exact_mut(dims.motion_len()) {
                for order in 1..=dims.order {
                    for &c in self.driven(input) {
                        motion[order * dims.coordinates + c] = 0.0;
                    }
                }
            }
            let resting = self.whole(&still)?;
            for (slot, value) in independent.iter_mut().zip(resting).skip(input).step_by(dims.inputs) {
                *slot = value;
            }
        }
        let dependent = whole.iter().zip(&independent).map(|(whole, part)| whole - part).collect();
        Ok(Parts { samples: motions.len() / dims.motion_len().max(1), motions, independent, dependent })
    }

    /// Inertia at the coordinate that an input drives, at a motion, while the other coordinates do not accelerate: the
    /// change of the input per unit of acceleration. `None` when the input does not drive exactly one coordinate, or
    /// the model has no accelerations.
    ///
    /// # Errors
    /// [`TrialError`] when the model cannot be evaluated at a motion or its inputs are not determined.
    pub fn inertia(&self, input: usize, motion: &[f64]) -> Result<Option<f64>, TrialError> {
        let dims = self.model.dims();
        let [coordinate] = self.driven(input) else { return Ok(None) };
        if dims.order < 2 {
            return Ok(None);
        }
        let mut pair = motion[..dims.motion_len()].to_vec();
        pair.extend_from_within(..);
        let slot = 2 * dims.coordinates + coordinate;
        pair[slot] = 0.0;
        pair[dims.motion_len() + slot] = 1.0;
        let found = self.whole(&pair)?;
        Ok(Some(found[dims.inputs + input] - found[input]))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::Demand;
    use crate::actuator::tests::{CartPendulum, FENG};
    use tpm_motion::trajectory::{HarmonicSeries, Trajectory};
    use tpm_test_support::rest_to_rest_3;

    /// Feng, Eqns 6.8 (with the cosine that it lacks) and 6.9: the pendulum at four times the cart's frequency.
    pub(crate) fn feng_6_8() -> Trajectory {
        let shape = |amplitude: f64, multiple: u32| -> HarmonicSeries {
            let mut series = rest_to_rest_3().trajectory(&[amplitude], 1.0).coordinates.remove(0);
            series.lines.iter_mut().for_each(|line| line.harmonic *= multiple);
            series
        };
        Trajectory { frequency: 3.0, coordinates: vec![shape(0.1, 1), shape(0.6, 4)] }
    }

    #[test]
    fn the_parts_are_those_of_feng_6_6_and_6_7() {
        let demand = Demand::new(&CartPendulum, &FENG, &[], &[vec![0], vec![1]]);
        let parts = demand.along(&feng_6_8(), 64).expect("square");
        let [big, m, l] = [10.0, 1.0, 0.4];
        for (n, motion) in parts.motions.chunks_exact(6).enumerate() {
            let [_, theta, _, speed, xdd, thdd]: [f64; 6] = motion.try_into().expect("six");
            let expected = [
                m * l * (thdd * theta.cos() - speed * speed * theta.sin()),
                m * l * xdd * theta.cos(),
                (big + m) * xdd,
                m * l * l * thdd,
            ];
            let found: Vec<f64> =
                parts.independent[2 * n..2 * n + 2].iter().chain(&parts.dependent[2 * n..2 * n + 2]).copied().collect();
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            }
        }
        let start = &parts.motions[..6];
        assert!((demand.inertia(0, start).expect("square").expect("one") - 11.0).abs() < 1e-12);
        assert!((demand.inertia(1, start).expect("square").expect("one") - 0.16).abs() < 1e-12);
    }
}
