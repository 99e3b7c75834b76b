//! One experiment as it is played: reference and feed-forward sample by sample, feedback, limits.
//!
//! Invariant: a period is a whole number of samples, so that everything periodic is one table of that length; the frequency
//! is the one that this number gives, `w = 2 pi / (N T)`, not the one that was asked for. The feed-forward is
//! `u = Phi(q_r) theta + known` solved for the inputs, with the estimates theta at the start of the run.

use super::hold::held;
use crate::numerics::fourier;
use crate::run::actuator::Dynamics;
use crate::run::completion::{CompletionError, OpenReason, complete};
use crate::run::smoothing::Smoothing;
use crate::run::spectra::Spectra;
use crate::run::trajectory::Trajectory;
use num_complex::Complex;
use serde::{Deserialize, Serialize};
use std::string::String;
use std::vec;
use std::vec::Vec;
use tpm_core::control::{Differentiator, Gain};
use tpm_core::harmonics::Hold;
use tpm_core::linear;
use tpm_core::model::{EvalError, Model};

/// What is done about the zero-order hold in the feed-forward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HoldCompensation {
    /// Nothing: each sample is the demand at its start, so that the held force lags by half a sample.
    None,
    /// Each sample is the demand half a sample later; a loss of `(W T)^2 / 24` remains at the frequency W.
    Advance,
    /// Every harmonic is divided by what the hold and the known dynamics of the actuator do to it (where these pass less than
    /// a tenth, amplified tenfold); only the images beyond the sampling frequency remain.
    #[default]
    Exact,
}

/// Where the rate of the tracking error comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Velocity {
    /// It is measured, without noise where no sensor of its own is stated.
    Measured,
    /// It is formed from the measured error by a filtered difference with this time constant, s.
    Filtered(f64),
    /// It is the slope of a polynomial through the last measured errors, whose value is fed back for the error itself.
    Fitted(Smoothing),
}

impl Velocity {
    /// Time constant of the filter, s; nothing where there is none.
    #[must_use]
    pub const fn time_constant(self) -> Option<f64> {
        match self {
            Velocity::Measured | Velocity::Fitted(_) => None,
            Velocity::Filtered(time_constant) => Some(time_constant),
        }
    }

    /// The least-squares smoothing; nothing where there is none.
    #[must_use]
    pub const fn smoothing(self) -> Option<Smoothing> {
        match self {
            Velocity::Measured | Velocity::Filtered(_) => None,
            Velocity::Fitted(smoothing) => Some(smoothing),
        }
    }
}

/// A harmonic that the actuator passes weakly is amplified so much at most.
const MOST_AMPLIFIED: f64 = 10.0;

/// Feedback in sampled time.
#[derive(Clone, Debug, PartialEq)]
pub struct Loop {
    /// Time between samples, s.
    pub sample_time: f64,
    /// The paths.
    pub gains: Vec<Gain<f64>>,
    /// Source of the rates.
    pub velocity: Velocity,
    /// What the feed-forward does about the hold.
    pub compensation: HoldCompensation,
    /// Known dynamics between command and force, by input; inputs beyond the last one have none.
    pub actuators: Vec<Dynamics>,
}

impl Loop {
    /// Response of the feedback from the phasor of a coordinate's measured error to an input's phasor, `-C(jW)`, with the
    /// differentiator, or the smoothing of both, but without the hold: `Kp + Kd D(W)`.
    #[must_use]
    pub fn response(&self, input: usize, coordinate: usize, frequency: f64) -> Complex<f64> {
        let one = Complex::new(1.0, 0.0);
        let (value, rate) = match self.velocity {
            Velocity::Measured => (one, Complex::new(0.0, frequency)),
            Velocity::Filtered(time_constant) => {
                let (re, im) =
                    Differentiator::new(self.sample_time, time_constant).response(frequency * self.sample_time);
                (one, Complex::new(re, im))
            }
            Velocity::Fitted(smoothing) => smoothing.responses(frequency, self.sample_time),
        };
        self.gains
            .iter()
            .filter(|gain| gain.input == input && gain.coordinate == coordinate)
            .map(|gain| rate * gain.derivative + value * gain.proportional)
            .sum()
    }

    /// The same loop with all gains times a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        for gain in &mut scaled.gains {
            gain.proportional *= factor;
            gain.derivative *= factor;
        }
        scaled
    }

    /// Known dynamics of an input's actuator.
    #[must_use]
    pub fn actuator(&self, input: usize) -> Dynamics {
        self.actuators.get(input).copied().unwrap_or_default()
    }

    /// What the hold and the actuator do to an input's phasor at the frequency W (rad/s).
    #[must_use]
    pub fn drive(&self, input: usize, frequency: f64, hold: Hold) -> Complex<f64> {
        held(hold, frequency * self.sample_time) * self.actuator(input).response(frequency)
    }
}

/// Why an experiment cannot be played.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrialError {
    /// The model could not be evaluated along the reference.
    #[error("the model cannot be evaluated along the reference: {0}")]
    Evaluation(#[from] EvalError),
    /// A period has too few samples.
    #[error(
        "a period of {frequency} rad/s has {samples} samples of {sample_time} s; harmonic {harmonic} needs more: sample faster or move slower"
    )]
    TooCoarse {
        /// Frequency asked for, rad/s.
        frequency: f64,
        /// Samples in its period.
        samples: f64,
        /// Time between samples, s.
        sample_time: f64,
        /// Highest harmonic of the reference.
        harmonic: u32,
    },
    /// The inputs cannot be solved for.
    #[error("the feed-forward is not determined: input `{input}` acts on no row, or on the same rows as another one")]
    Inputs {
        /// The input.
        input: String,
    },
    /// The pattern leaves a coordinate open, and the rows do not determine its motion.
    #[error("the pattern gives {} no motion: {reason}", .coordinates.join(" and "))]
    Open {
        /// The coordinates.
        coordinates: Vec<String>,
        /// Why their motion does not follow.
        reason: OpenReason,
    },
    /// The feed-forward is not a number.
    #[error("the feed-forward of `{input}` is not finite at sample {sample} of the period")]
    NotFinite {
        /// The input.
        input: String,
        /// Sample of the period.
        sample: usize,
    },
}

/// An experiment, ready to be played on a plant.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Number of the run in its campaign, from 0.
    pub run: usize,
    /// The reference motion, with the frequency that the sampling allows.
    pub trajectory: Trajectory,
    /// Coordinates whose reference follows from the rows without an input, with the estimates for the feed-forward.
    pub open: Vec<usize>,
    /// Name of the pattern, where the stage has its own.
    pub pattern: Option<String>,
    /// Amplitudes behind the reference, in the order of the pattern.
    pub amplitudes: Vec<f64>,
    /// Samples in a period.
    pub samples_per_period: usize,
    /// Whole periods that are played.
    pub periods: usize,
    /// The feedback.
    pub control: Loop,
    /// Estimates behind the feed-forward, in the order of the model's parameters.
    pub parameters: Vec<f64>,
    /// Constants of the model.
    pub constants: Vec<f64>,
    /// Reference motion of one period: per sample, coordinates and derivatives as models read them.
    pub reference: Vec<f64>,
    /// Feed-forward of one period: per sample, one value per input.
    pub feed_forward: Vec<f64>,
    /// Largest tracking error that is tolerated, per coordinate.
    pub tracking_bounds: Vec<f64>,
    /// Largest magnitude of each input; infinite where there is none.
    pub input_limits: Vec<f64>,
}

/// What goes into a [`Trial`].
#[derive(Clone, Debug)]
pub struct TrialSettings<'a> {
    /// Number of the run.
    pub run: usize,
    /// The reference at the frequency asked for.
    pub trajectory: Trajectory,
    /// Coordinates whose motion follows from the rows without an input, with the estimates for the feed-forward.
    pub open: &'a [usize],
    /// Name of its pattern, where the stage has its own.
    pub pattern: Option<String>,
    /// Amplitudes behind it.
    pub amplitudes: Vec<f64>,
    /// Whole periods to play.
    pub periods: usize,
    /// The feedback.
    pub control: &'a Loop,
    /// Estimates for the feed-forward.
    pub parameters: &'a [f64],
    /// Constants of the model.
    pub constants: &'a [f64],
    /// Largest tracking error per coordinate.
    pub tracking_bounds: &'a [f64],
    /// Largest magnitude per input.
    pub input_limits: &'a [f64],
}

impl Trial {
    /// Works out the samples to play.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn new(model: &dyn Model<f64>, settings: TrialSettings<'_>) -> Result<Self, TrialError> {
        let TrialSettings {
            run,
            mut trajectory,
            open,
            pattern,
            amplitudes,
            periods,
            control,
            parameters,
            constants,
            tracking_bounds,
            input_limits,
        } = settings;
        let dims = model.dims();
        let sample_time = control.sample_time;
        let asked = 2.0 * std::f64::consts::PI / (trajectory.frequency * sample_time);
        let harmonic = trajectory.highest_harmonic();
        // Below four samples per period of the highest harmonic a held force no longer resembles the demand.
        if !asked.is_finite() || asked < 4.0 * f64::from(harmonic.max(1)) || asked > 1e9 {
            return Err(TrialError::TooCoarse {
                frequency: trajectory.frequency,
                samples: asked,
                sample_time,
                harmonic,
            });
        }
        let samples = asked.round() as usize;
        trajectory.frequency = 2.0 * std::f64::consts::PI / (samples as f64 * sample_time);
        complete(model, &mut trajectory, open, parameters, constants).map_err(|fault| match fault {
            CompletionError::Evaluation(source) => TrialError::Evaluation(source),
            CompletionError::Open(reason) => TrialError::Open {
                coordinates: open.iter().map(|&c| model.coordinate(c).name.into()).collect(),
                reason,
            },
        })?;
        let mut reference = vec![0.0; samples * dims.motion_len()];
        for (n, motion) in reference.chunks_exact_mut(dims.motion_len()).enumerate() {
            trajectory.motion_at(n, samples, 0.0, motion);
        }
        let advanced;
        let demanded = if control.compensation == HoldCompensation::Advance {
            let mut shifted = vec![0.0; reference.len()];
            for (n, motion) in shifted.chunks_exact_mut(dims.motion_len()).enumerate() {
                trajectory.motion_at(n, samples, 0.5, motion);
            }
            advanced = shifted;
            &advanced
        } else {
            &reference
        };
        let mut feed_forward = demand(model, demanded, parameters, constants)?;
        if control.compensation == HoldCompensation::Exact {
            undo_drive(&mut feed_forward, dims.inputs, control);
        }
        Ok(Trial {
            run,
            trajectory,
            open: open.to_vec(),
            pattern,
            amplitudes,
            samples_per_period: samples,
            periods,
            control: control.clone(),
            parameters: parameters.to_vec(),
            constants: constants.to_vec(),
            reference,
            feed_forward,
            tracking_bounds: tracking_bounds.to_vec(),
            input_limits: input_limits.to_vec(),
        })
    }

    /// Samples in the whole run.
    #[must_use]
    pub const fn samples(&self) -> usize {
        self.samples_per_period * self.periods
    }

    /// Largest share of its limit that the feed-forward of any input takes, with the input and the sample of the period.
    #[must_use]
    pub fn feed_forward_share(&self) -> (f64, usize, usize) {
        let inputs = self.input_limits.len().max(1);
        self.feed_forward.iter().enumerate().fold((0.0, 0, 0), |most, (at, value)| {
            let share = self.input_limits.get(at % inputs).map_or(0.0, |limit| value.abs() / limit);
            if share > most.0 { (share, at % inputs, at / inputs) } else { most }
        })
    }
}

/// Inputs that the rows ask for along a table of motions: the least-squares solution of `B u = Phi theta + known`.
pub(crate) fn demand(
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

/// Puts the known dynamics of the actuators between the recorded inputs (the channels behind the coordinates) and the model,
/// so that the spectra are those of forces, up to the hold.
pub(crate) fn correct_actuators(spectra: &mut Spectra, coordinates: usize, actuators: &[Dynamics]) {
    for (i, dynamics) in actuators.iter().enumerate().filter(|(_, dynamics)| !dynamics.is_ideal()) {
        spectra.pass(coordinates + i, |frequency| dynamics.response(frequency));
    }
}

/// Divides every harmonic of one period (all inputs interleaved) by what hold and actuator do to it.
fn undo_drive(samples: &mut [f64], inputs: usize, control: &Loop) {
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
                let actuator = control.actuator(i);
                if !actuator.is_ideal() {
                    let response = actuator.response(angle / control.sample_time);
                    *line *= response.conj() / response.norm_sqr().max(MOST_AMPLIFIED.powi(-2));
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
    use super::{HoldCompensation, Loop, Trial, TrialError, TrialSettings, Velocity};
    use crate::run::trajectory::tests::rest_to_rest_3;
    use crate::test_models::MassSpringDrag;
    use std::f64::consts::PI;
    use std::vec;
    use std::vec::Vec;
    use tpm_core::control::Gain;
    use tpm_core::harmonics::hold_factor;

    fn trial(w: f64, compensation: HoldCompensation) -> Result<Trial, TrialError> {
        let control = Loop {
            sample_time: 0.01,
            gains: vec![Gain { input: 0, coordinate: 0, proportional: 2000.0, derivative: 120.0 }],
            velocity: Velocity::Measured,
            compensation,
            actuators: vec![],
        };
        let settings = TrialSettings {
            run: 0,
            trajectory: rest_to_rest_3().trajectory(&[0.3], w),
            open: &[],
            pattern: None,
            amplitudes: vec![0.3],
            periods: 3,
            control: &control,
            parameters: &[2.0, 40.0, 1.5],
            constants: &[],
            tracking_bounds: &[1.0],
            input_limits: &[100.0],
        };
        Trial::new(&MassSpringDrag, settings)
    }

    /// Phasor of harmonic k of what a hold makes of the samples.
    fn held(samples: &[f64], k: usize) -> (f64, f64) {
        let n = samples.len() as f64;
        let angle = 2.0 * PI * k as f64 / n;
        let (mut re, mut im) = (0.0, 0.0);
        for (i, u) in samples.iter().enumerate() {
            re += 2.0 / n * u * (angle * i as f64).cos();
            im -= 2.0 / n * u * (angle * i as f64).sin();
        }
        let (c, s) = hold_factor(angle);
        (re * c - im * s, re * s + im * c)
    }

    #[test]
    fn compensated_samples_hold_to_the_demand() {
        let plain = trial(PI, HoldCompensation::None).expect("playable");
        assert_eq!(plain.samples_per_period, 200);
        assert_eq!(plain.samples(), 600);
        let exact = trial(PI, HoldCompensation::Exact).expect("playable");
        let advance = trial(PI, HoldCompensation::Advance).expect("playable");
        // The demand's own phasors: Feng 3.26 has cosines only.
        let n = plain.feed_forward.len() as f64;
        let demand: Vec<f64> = (0..8)
            .map(|k| {
                let sum = plain.feed_forward.iter().enumerate().map(|(i, u)| u * (2.0 * PI * (k * i) as f64 / n).cos());
                sum.sum::<f64>() * 2.0 / n
            })
            .collect();
        for (k, &demand) in demand.iter().enumerate().skip(1) {
            let (re, im) = held(&exact.feed_forward, k);
            assert!((re - demand).abs() < 1e-11 && im.abs() < 1e-11, "harmonic {k}");
            let angle = 2.0 * PI * k as f64 / n;
            let (re, im) = held(&advance.feed_forward, k);
            let lost = demand * (1.0 - angle * angle / 24.0);
            assert!((re - lost).abs() < 1e-3 * angle.powi(2) * demand.abs() + 1e-11 && im.abs() < 1e-11);
            let (_, im) = held(&plain.feed_forward, k);
            assert!((im + demand * (angle / 2.0).sin()).abs() < 1e-3 * demand.abs() + 1e-11);
        }
    }

    #[test]
    fn frequencies_are_rounded_to_whole_samples_and_coarse_ones_refused() {
        let odd = trial(2.8, HoldCompensation::None).expect("playable");
        assert_eq!(odd.samples_per_period, 224);
        assert!((odd.trajectory.frequency - 2.0 * PI / 2.24).abs() < 1e-14);
        assert!(matches!(trial(300.0, HoldCompensation::None), Err(TrialError::TooCoarse { .. })));
        assert!(matches!(trial(0.0, HoldCompensation::None), Err(TrialError::TooCoarse { .. })));
        let (share, input, _) = odd.feed_forward_share();
        assert!(share > 0.1 && share < 1.0 && input == 0);
    }
}
