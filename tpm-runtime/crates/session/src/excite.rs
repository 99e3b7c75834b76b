//! An excitation as a run: the files that a controller and the simulated machine play, and whose log shows a frequency response.

use tpm_campaign::{RunFile, trial_samples};
use tpm_controller::model::Model;
use tpm_frequency::{Excitation, ExcitationError, crest_factor};
use tpm_motion::trajectory::{HarmonicSeries, Trajectory};
use tpm_motion::{HoldCompensation, Loop, Trial, Velocity};
use tpm_numerics::root_mean_square;

/// An excitation of one input of a machine that starts at rest in zero, without feedback.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExcitationRequest {
    /// The signal.
    pub excitation: Excitation,
    /// Index of the input that it is played on; the others stay zero.
    pub input: usize,
    /// Time between samples, s.
    pub sample_time: f64,
    /// Length of the run, s.
    pub duration: f64,
    /// Largest magnitude of the input; infinite for none.
    pub limit: f64,
}

/// An excitation as a run to be played.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ExcitedRun {
    /// The samples (CSV).
    pub samples: String,
    /// The terms that belong to them.
    pub terms: RunFile,
    /// Root mean square of the signal, unit of the input.
    pub rms: f64,
    /// Largest magnitude of the signal, unit of the input.
    pub peak: f64,
    /// Largest magnitude over root mean square.
    pub crest: f64,
}

/// Why an excitation is no run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExciteError {
    /// The signal cannot be made.
    #[error(transparent)]
    Excitation(#[from] ExcitationError),
    /// The run holds no samples.
    #[error("a run of {duration} s has no sample every {sample_time} s; lengthen it")]
    Empty {
        /// Length of the run, s.
        duration: f64,
        /// Time between samples, s.
        sample_time: f64,
    },
    /// The signal reaches beyond the limit of the input.
    #[error("the signal reaches {peak}, beyond the limit {limit} of the input, which would cut it; make it smaller")]
    Limit {
        /// Largest magnitude of the signal.
        peak: f64,
        /// The limit.
        limit: f64,
    },
}

impl ExcitationRequest {
    /// The run on a machine of this model.
    ///
    /// # Errors
    /// [`ExciteError`] when the signal cannot be made, has no sample, or passes the limit.
    pub fn run(&self, model: &dyn Model<f64>) -> Result<ExcitedRun, ExciteError> {
        let dims = model.dims();
        let Self { sample_time, duration, limit, .. } = *self;
        let samples = (duration / sample_time).round();
        // The signal itself names a sample time that is out of range.
        let count = if samples.is_finite() && samples >= 1.0 { samples as usize } else { 0 };
        let signal = self.excitation.samples(count, sample_time)?;
        if signal.is_empty() {
            return Err(ExciteError::Empty { duration, sample_time });
        }
        let peak = signal.iter().fold(0.0_f64, |peak, value| peak.max(value.abs()));
        if peak > limit {
            return Err(ExciteError::Limit { peak, limit });
        }
        let mut feed_forward = vec![0.0; count * dims.inputs];
        for (row, value) in feed_forward.chunks_exact_mut(dims.inputs.max(1)).zip(&signal) {
            if let Some(own) = row.get_mut(self.input) {
                *own = *value;
            }
        }
        let mut input_limits = vec![f64::INFINITY; dims.inputs];
        if let Some(own) = input_limits.get_mut(self.input) {
            *own = limit;
        }
        let trial = Trial {
            run: 0,
            trajectory: Trajectory {
                frequency: 2.0 * std::f64::consts::PI / (samples * sample_time),
                coordinates: vec![HarmonicSeries::default(); dims.coordinates],
            },
            open: Vec::new(),
            pattern: None,
            amplitudes: Vec::new(),
            samples_per_period: count,
            periods: 1,
            control: Loop {
                sample_time,
                gains: Vec::new(),
                velocity: Velocity::Filtered(0.0),
                position_filter: 0.0,
                compensation: HoldCompensation::None,
                actuators: Vec::new(),
            },
            parameters: vec![0.0; dims.parameters],
            constants: vec![0.0; dims.constants],
            reference: vec![0.0; count * dims.motion_len()],
            feed_forward,
            tracking_bounds: vec![f64::INFINITY; dims.coordinates],
            input_limits,
            position_bounds: Vec::new(),
            velocity_bounds: Vec::new(),
        };
        Ok(ExcitedRun {
            samples: trial_samples(model, &trial),
            terms: RunFile::new(model, &trial, 0),
            rms: root_mean_square(signal.iter().copied()),
            peak,
            crest: crest_factor(&signal),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{ExcitationRequest, ExciteError};
    use tpm_frequency::Excitation;
    use tpm_test_support::models::TwoCarts;

    #[test]
    fn a_chirp_is_a_run_of_the_model() {
        let excitation = Excitation::Chirp { low: 1.0, high: 20.0, amplitude: 3.0 };
        let request =
            ExcitationRequest { excitation, input: 0, sample_time: 1e-3, duration: 2.0, limit: f64::INFINITY };
        let run = request.run(&TwoCarts).expect("a run");
        let mut lines = run.samples.lines();
        assert_eq!(lines.next(), Some("t_s,x1_ref,x2_ref,x1_ref_d1,x2_ref_d1,x1_ref_d2,x2_ref_d2,F_ff"));
        assert_eq!((lines.count(), run.terms.periods, run.terms.feedback.len()), (2000, 1, 0));
        assert!(run.peak <= 3.0 && run.peak > 2.99 && (run.crest - 2.0_f64.sqrt()).abs() < 0.02);
        let limited = ExcitationRequest { limit: 2.0, ..request };
        assert!(matches!(limited.run(&TwoCarts), Err(ExciteError::Limit { .. })));
        let short = ExcitationRequest { duration: 1e-5, ..request };
        assert!(matches!(short.run(&TwoCarts), Err(ExciteError::Empty { .. })));
        let still = ExcitationRequest { sample_time: 0.0, ..request };
        assert!(matches!(still.run(&TwoCarts), Err(ExciteError::Excitation(_))));
    }
}
