//! The feed-forward of a run: the inputs that the model's rows require along the reference.
//!
//! Invariant: the demand solves `B u = Phi(q_r) theta + known` for the inputs u, sample by sample. The responses of the
//! zero-order hold and of the actuators' known dynamics are divided out harmonic by harmonic over a whole period.

use crate::actuator::Dynamics;
use crate::error::TrialError;
use crate::hold::held;
use serde::{Deserialize, Serialize};
use tpm_core::harmonics::Hold;
use tpm_core::linear;
use tpm_core::model::Model;
use tpm_numerics::fourier;

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
    let mut square = vec![0.0; dims.inputs * dims.inputs];
    let mut out = Vec::with_capacity(motions.len() / dims.motion_len().max(1) * dims.inputs);
    let mut right = vec![0.0; dims.inputs];
    for (sample, motion) in motions.chunks_exact(dims.motion_len()).enumerate() {
        model.inverse_dynamics(motion, parameters, constants, &mut scratch, &mut force)?;
        model.input_map(motion, constants, &mut scratch, &mut map)?;
        for i in 0..dims.inputs {
            right[i] = (0..dims.rows).map(|r| map[r * dims.inputs + i] * force[r]).sum();
            for j in 0..dims.inputs {
                square[i * dims.inputs + j] =
                    (0..dims.rows).map(|r| map[r * dims.inputs + i] * map[r * dims.inputs + j]).sum();
            }
        }
        if right.iter().chain(&square).any(|value| !value.is_finite()) {
            let input = right.iter().position(|value| !value.is_finite()).unwrap_or(0);
            return Err(TrialError::NotFinite { input: model.input(input).name.into(), sample });
        }
        linear::solve_in_place(&mut square, &mut right)
            .map_err(|input| TrialError::Inputs { input: model.input(input).name.into() })?;
        out.extend_from_slice(&right);
    }
    Ok(out)
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
