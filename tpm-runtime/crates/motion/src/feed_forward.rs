//! The feed-forward of a run: the inputs that the model's rows require along the reference.
//!
//! Invariant: the demand solves `B u = Phi(q_r) theta + known` for the inputs u, sample by sample. The responses of the
//! zero-order hold and of the actuators' known dynamics are divided out harmonic by harmonic over a whole period.

use crate::actuator::Dynamics;
use crate::error::TrialError;
use crate::hold::held;
use serde::{Deserialize, Serialize};
use tpm_controller::harmonics::Hold;
use tpm_controller::linear;
use tpm_controller::model::Model;
use tpm_numerics::{DMatrix, fourier};

/// Largest factor by which a harmonic is amplified to make up for an actuator that attenuates it.
const MOST_AMPLIFICATION: f64 = 10.0;

/// What is done about the zero-order hold in the feed-forward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum HoldCompensation {
    /// No compensation: each sample is the demand at its start, so that the held force lags by half a sample.
    None,
    /// Each sample is the demand half a sample later; a loss of `(W T)^2 / 24` remains at the frequency W.
    Advance,
    /// Every harmonic is divided by what the hold and the known dynamics of the actuator do to it (where these pass less than
    /// a tenth, amplified tenfold); only the images beyond the sampling frequency remain.
    #[default]
    Exact,
}

/// Inputs that the rows require along a table of motions, interleaved per sample: the least-squares solution of
/// `B u = Phi theta + known`.
///
/// # Errors
/// [`TrialError::Evaluation`] when the model cannot be evaluated, [`TrialError::NotFinite`] for a demand that is not
/// finite, [`TrialError::Inputs`] when the rows do not determine the inputs.
pub fn demand(
    model: &dyn Model<f64>,
    motions: &[f64],
    parameters: &[f64],
    constants: &[f64],
) -> Result<Vec<f64>, TrialError> {
    let dims = model.dims();
    let mut force = vec![0.0; dims.rows];
    let mut map = vec![0.0; dims.input_map_len()];
    let mut scratch = vec![0.0; model.inverse_workspace_len().max(model.workspace_len())];
    let mut out = Vec::with_capacity(motions.len() / dims.motion_len().max(1) * dims.inputs);
    let mut inputs = Inputs::new(dims.rows, dims.inputs);
    for (sample, motion) in motions.chunks_exact(dims.motion_len()).enumerate() {
        model.inverse_dynamics(motion, parameters, constants, &mut scratch, &mut force)?;
        model.input_map(motion, constants, &mut scratch, &mut map)?;
        match inputs.solved(&map, &force) {
            Ok(found) => out.extend_from_slice(found),
            Err(Unsolved::NotFinite(input)) => {
                return Err(TrialError::NotFinite { input: model.input(input).name.into(), sample });
            }
            Err(Unsolved::Singular(input)) => {
                return Err(TrialError::Inputs { input: model.input(input).name.into() });
            }
        }
    }
    Ok(out)
}

/// Why inputs are not found, with the input at fault.
enum Unsolved {
    NotFinite(usize),
    Singular(usize),
}

/// The least-squares solution of `B u = f` at one sample after another. Where B stays as it is, which it does for most machines, its
/// pseudo-inverse is formed once, and a sample takes the products with its entries that are not zero.
struct Inputs {
    rows: usize,
    inputs: usize,
    /// B at the last sample, rows times inputs; empty before the first.
    last: Vec<f64>,
    square: Vec<f64>,
    right: Vec<f64>,
    /// Input, row and entry of the pseudo-inverse of `last`, once it has stayed for a sample.
    inverse: Option<Vec<(usize, usize, f64)>>,
}

impl Inputs {
    fn new(rows: usize, inputs: usize) -> Self {
        let (square, right) = (vec![0.0; inputs * inputs], vec![0.0; inputs]);
        Inputs { rows, inputs, last: Vec::new(), square, right, inverse: None }
    }

    /// The inputs that give `force` through `map`, rows times inputs.
    fn solved(&mut self, map: &[f64], force: &[f64]) -> Result<&[f64], Unsolved> {
        if self.last == map {
            if self.inverse.is_none() {
                self.inverse = self.inverted();
            }
            if let Some(inverse) = &self.inverse {
                self.right.fill(0.0);
                for &(input, row, entry) in inverse {
                    self.right[input] += entry * force[row];
                }
                return match self.right.iter().position(|value| !value.is_finite()) {
                    Some(input) => Err(Unsolved::NotFinite(input)),
                    None => Ok(&self.right),
                };
            }
        } else {
            self.inverse = None;
            self.last.clear();
            self.last.extend_from_slice(map);
        }
        self.normal(map);
        for (i, right) in self.right.iter_mut().enumerate() {
            *right = (0..self.rows).map(|r| map[r * self.inputs + i] * force[r]).sum();
        }
        if self.right.iter().chain(&self.square).any(|value| !value.is_finite()) {
            return Err(Unsolved::NotFinite(self.right.iter().position(|value| !value.is_finite()).unwrap_or(0)));
        }
        linear::solve_in_place(&mut self.square, &mut self.right).map_err(Unsolved::Singular)?;
        Ok(&self.right)
    }

    /// `B' B` into `square`.
    fn normal(&mut self, map: &[f64]) {
        self.square.fill(0.0);
        for row in map.chunks_exact(self.inputs.max(1)) {
            for (i, left) in row.iter().enumerate().filter(|(_, left)| **left != 0.0) {
                let slots = self.square[i * self.inputs..].iter_mut();
                slots.zip(row).for_each(|(slot, right)| *slot += left * right);
            }
        }
    }

    /// The entries of `(B' B)^-1 B'` for the last B, if rounding lets it be formed.
    fn inverted(&self) -> Option<Vec<(usize, usize, f64)>> {
        let map = DMatrix::from_row_slice(self.rows, self.inputs, &self.last);
        let found = (map.transpose() * &map).lu().solve(&map.transpose())?;
        let entry = |input: usize, row: usize| (input, row, found[(input, row)]);
        let all = (0..self.inputs).flat_map(|input| (0..self.rows).map(move |row| (input, row)));
        let entries: Vec<_> = all.map(|(input, row)| entry(input, row)).filter(|(_, _, entry)| *entry != 0.0).collect();
        entries.iter().all(|(_, _, entry)| entry.is_finite()).then_some(entries)
    }
}

/// Divides every harmonic of one period (all inputs interleaved) by the responses of hold and actuator.
pub(super) fn undo_drive(samples: &mut [f64], inputs: usize, sample_time: f64, actuators: &[Dynamics]) {
    let count = samples.len() / inputs.max(1);
    let (forward, inverse) = (fourier::forward(count), fourier::inverse(count));
    let mut spectrum = forward.make_output_vec();
    let mut wave = forward.make_input_vec();
    for i in 0..inputs {
        for (value, sample) in wave.iter_mut().zip(samples.iter().skip(i).step_by(inputs)) {
            *value = *sample;
        }
        forward.process(&mut wave, &mut spectrum).expect("invariant: buffers were made for this transform");
        for (k, line) in spectrum.iter_mut().enumerate() {
            // The mean passes unchanged, and a line at half the sampling frequency has no phase that could be advanced.
            if k > 0 && 2 * k < count {
                let angle = 2.0 * std::f64::consts::PI * k as f64 / count as f64;
                *line /= held(Hold::Zoh, angle);
                let actuator = actuators.get(i).copied().unwrap_or_default();
                if !actuator.is_ideal() {
                    let response = actuator.response(angle / sample_time);
                    *line *= response.conj() / response.norm_sqr().max(MOST_AMPLIFICATION.powi(-2));
                }
            }
            *line /= count as f64;
        }
        inverse
            .process(&mut spectrum, &mut wave)
            .expect("invariant: mean and last line are real and the buffers were made for this transform");
        for (value, sample) in wave.iter().zip(samples.iter_mut().skip(i).step_by(inputs)) {
            *sample = *value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Inputs, Unsolved};

    /// Entries without any order in them.
    fn entry(seed: usize) -> f64 {
        ((seed as f64 * 12.9898).sin() * 43758.5453).fract()
    }

    #[test]
    fn a_map_that_stays_and_one_that_changes_give_the_same_inputs() {
        for (rows, count) in [(1, 1), (4, 4), (7, 3)] {
            let map = |n: usize| -> Vec<f64> { (0..rows * count).map(|i| entry(31 * n + i + 1)).collect() };
            let mut kept = Inputs::new(rows, count);
            // The second of two samples with one map takes the pseudo-inverse.
            for n in 0..6 {
                let map = map(n / 2);
                let wanted: Vec<f64> = (0..count).map(|i| entry(7 * n + i)).collect();
                let force: Vec<f64> =
                    map.chunks_exact(count).map(|row| row.iter().zip(&wanted).map(|(b, u)| b * u).sum()).collect();
                let Ok(found) = kept.solved(&map, &force) else { panic!("{rows} {count} {n}") };
                for (found, wanted) in found.iter().zip(&wanted) {
                    assert!((found - wanted).abs() < 1e-9, "{rows} {count} {n}: {found} {wanted}");
                }
            }
        }
    }

    #[test]
    fn an_input_that_no_row_determines_is_named_at_every_sample() {
        let mut inputs = Inputs::new(2, 2);
        for _ in 0..3 {
            assert!(matches!(inputs.solved(&[1.0, 0.0, 2.0, 0.0], &[1.0, 1.0]), Err(Unsolved::Singular(1))));
        }
        let mut inputs = Inputs::new(1, 1);
        for force in [1.0, f64::NAN, 1.0] {
            assert_eq!(inputs.solved(&[2.0], &[force]).is_ok(), force.is_finite());
        }
    }
}
