//! One run as it is played: reference and feed-forward sample by sample, feedback, limits.
//!
//! Invariant: a period is a whole number of samples, so that everything periodic is one table of that length; the frequency
//! is the one that this number gives, `w = 2 pi / (N T)`, not the one that was asked for. The feed-forward uses the estimates
//! theta at the start of the run.

use crate::completion::{CompletionError, complete};
use crate::error::TrialError;
use crate::feed_forward::{HoldCompensation, demand, undo_drive};
use crate::feedback::Loop;
use crate::trajectory::Trajectory;
use tpm_controller::model::Model;

/// A run, ready to be played on a plant.
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
    /// Least and largest position per coordinate; none where the list ends.
    pub position_bounds: Vec<(f64, f64)>,
    /// Largest magnitude of the velocity per coordinate; none where the list ends.
    pub velocity_bounds: Vec<f64>,
}

/// The settings from which a [`Trial`] is computed.
#[derive(Clone, Debug)]
pub struct TrialSettings<'a> {
    /// Number of the run.
    pub run: usize,
    /// The reference at the frequency asked for.
    pub trajectory: Trajectory,
    /// Coordinates whose motion follows from the rows without an input, with the estimates for the feed-forward.
    pub open: &'a [usize],
    /// Name of the pattern, where the stage has its own.
    pub pattern: Option<String>,
    /// Amplitudes behind the reference.
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
    /// Least and largest position per coordinate; none where the list ends.
    pub position_bounds: &'a [(f64, f64)],
    /// Largest magnitude of the velocity per coordinate; none where the list ends.
    pub velocity_bounds: &'a [f64],
}

impl Trial {
    /// Computes reference and feed-forward, sample by sample.
    ///
    /// # Errors
    /// [`TrialError`] when a period has too few samples, the rows do not determine open coordinates or inputs, or the model
    /// cannot be evaluated along the reference.
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
            position_bounds,
            velocity_bounds,
        } = settings;
        // 1. A whole number of samples per period, and the frequency that it gives.
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
        // 2. The motion of the open coordinates, and the reference.
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
        // 3. The feed-forward, half a sample ahead or with hold and actuators divided out, as the loop asks for.
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
            undo_drive(&mut feed_forward, dims.inputs, sample_time, &control.actuators);
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
            position_bounds: position_bounds.to_vec(),
            velocity_bounds: velocity_bounds.to_vec(),
        })
    }

    /// Samples in the whole run.
    #[must_use]
    pub const fn samples(&self) -> usize {
        self.samples_per_period * self.periods
    }

    /// The largest magnitude of any input's feed-forward as a share of that input's limit, with the input and the
    /// sample of the period.
    #[must_use]
    pub fn feed_forward_share(&self) -> (f64, usize, usize) {
        let inputs = self.input_limits.len().max(1);
        self.feed_forward.iter().enumerate().fold((0.0, 0, 0), |most, (at, value)| {
            let share = self.input_limits.get(at % inputs).map_or(0.0, |limit| value.abs() / limit);
            if share > most.0 { (share, at % inputs, at / inputs) } else { most }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Trial, TrialSettings};
    use crate::trajectory::tests::rest_to_rest_3;
    use crate::{HoldCompensation, Loop, TrialError, Velocity};
    use std::f64::consts::PI;
    use tpm_controller::control::Gain;
    use tpm_controller::harmonics::hold_factor;
    use tpm_test_support::models::MassSpringDrag;

    fn trial(w: f64, compensation: HoldCompensation) -> Result<Trial, TrialError> {
        let control = Loop {
            sample_time: 0.01,
            gains: vec![Gain { input: 0, coordinate: 0, proportional: 2000.0, derivative: 120.0 }],
            velocity: Velocity::Measured,
            position_filter: 0.0,
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
            position_bounds: &[],
            velocity_bounds: &[],
        };
        Trial::new(&MassSpringDrag, settings)
    }

    /// Phasor of harmonic k of the held samples.
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
        // Phasors of the demand: Feng 3.26 has cosines only.
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
