//! The controller of a run, sample by sample: feed-forward, feedback, and the bounds beyond which a run ends.
//!
//! Invariant: the inputs depend on the trial and on the measured samples alone, whatever machine or simulation measures
//! them. After the start nothing allocates.

use crate::feedback::Velocity;
use crate::record::Ending;
use crate::smoothing::Smoother;
use crate::trial::Trial;
use tpm_controller::control::{Differentiator, Feedback};
use tpm_controller::model::{Dims, EvalError};

/// The controller of one run. It sees every sample once, from the first on.
#[derive(Debug)]
pub struct Controller<'a> {
    trial: &'a Trial,
    filters: Vec<Differentiator<f64>>,
    smoothers: Vec<Smoother>,
    /// Measured tracking errors.
    errors: Vec<f64>,
    /// Tracking errors as they are fed back: measured, or smoothed.
    seen: Vec<f64>,
    /// Pole of the low pass of positions.
    pole: f64,
    /// Tracking errors behind the low pass of positions.
    passed: Vec<f64>,
    /// Rates of the tracking errors.
    rates: Vec<f64>,
    /// Number of values per sample of the reference.
    width: usize,
    /// Sample that comes next.
    sample: usize,
}

impl<'a> Controller<'a> {
    /// The controller before the first sample of a trial on a machine of these dimensions.
    pub fn new(dims: Dims, trial: &'a Trial) -> Self {
        let (n, control) = (dims.coordinates, &trial.control);
        let time_constant = control.velocity.time_constant().unwrap_or(0.0);
        let smoother = |smoothing| vec![Smoother::new(smoothing, control.sample_time); n];
        Controller {
            trial,
            filters: vec![Differentiator::new(control.sample_time, time_constant); n],
            smoothers: control.velocity.smoothing().map_or_else(Vec::new, smoother),
            errors: vec![0.0; n],
            seen: vec![0.0; n],
            pole: control.position_pole(),
            passed: vec![0.0; n],
            rates: vec![0.0; n],
            width: dims.motion_len(),
            sample: 0,
        }
    }

    /// Takes in the next sample of the coordinates, and writes the sum of feed-forward and feedback to `inputs`, not
    /// yet cut at any limit. `rate` gives a coordinate's measured rate; it is called only for feedback of measured
    /// rates.
    ///
    /// # Errors
    /// [`EvalError`] when the feedback names a coordinate or an input that is not there.
    pub fn step(
        &mut self,
        measured: &[f64],
        rate: impl Fn(usize) -> Option<f64>,
        inputs: &mut [f64],
    ) -> Result<(), EvalError> {
        let (trial, n) = (self.trial, self.errors.len());
        let at = self.sample % trial.samples_per_period;
        self.sample += 1;
        let reference = &trial.reference[at * self.width..(at + 1) * self.width];
        for ((error, measured), wanted) in self.errors.iter_mut().zip(measured).zip(reference) {
            *error = measured - wanted;
        }
        // The low pass starts in its steady state at the first errors.
        if self.sample == 1 {
            self.passed.copy_from_slice(&self.errors);
        }
        for ((passed, seen), error) in self.passed.iter_mut().zip(&mut self.seen).zip(&self.errors) {
            *passed = self.pole * *passed + (1.0 - self.pole) * error;
            *seen = *passed;
        }
        let count = inputs.len();
        inputs.copy_from_slice(&trial.feed_forward[at * count..(at + 1) * count]);
        let rates = match trial.control.velocity {
            Velocity::Measured => {
                for (c, own) in self.rates.iter_mut().enumerate() {
                    *own = match (rate(c), reference.get(n + c)) {
                        (Some(actual), Some(wanted)) => actual - wanted,
                        _ => 0.0,
                    };
                }
                Some(self.rates.as_slice())
            }
            Velocity::Filtered(_) => None,
            Velocity::Fitted(_) => {
                for ((smoother, seen), rate) in self.smoothers.iter_mut().zip(&mut self.seen).zip(&mut self.rates) {
                    (*seen, *rate) = smoother.push(*seen);
                }
                Some(self.rates.as_slice())
            }
        };
        Feedback::new(&trial.control.gains, &mut self.filters).add(&self.seen, rates, inputs)
    }

    /// The ending of the run, where the last sample passed a bound or a sensor gave no number. `velocity` gives a coordinate's
    /// velocity where it is known.
    pub fn ending(&self, measured: &[f64], velocity: impl Fn(usize) -> Option<f64>) -> Option<Ending> {
        let sample = self.sample.checked_sub(1)?;
        let bounds = self.errors.iter().zip(&self.trial.tracking_bounds).enumerate();
        bounds.into_iter().find_map(|(c, (&error, bound))| {
            Ending::of_error(c, sample, error, *bound)
                .or_else(|| Ending::of_motion(self.trial, c, sample, measured[c], velocity(c)))
        })
    }
}
