//! Harmonics of the channels of a run, kept for reports that show how the method works.

use num_complex::Complex;
use tpm_estimate::error_lines;
use tpm_motion::{Spectra, Trial};

/// Harmonics of the coordinates and inputs of one run, with the trial that was played and the parameters estimated
/// after it.
#[derive(Clone, Debug)]
pub struct RunHarmonics {
    /// Index of the run among the reports.
    pub run: usize,
    /// The trial: reference, feed-forward and feedback.
    pub trial: Trial,
    /// Estimates of the model's parameters after the run, in the model's order.
    pub after: Vec<f64>,
    /// Harmonics of the tracking error of every coordinate.
    pub error: Vec<Lines>,
    /// Harmonics of every input as it was applied.
    pub inputs: Vec<Lines>,
}

/// Phasors of one signal at the multiples of the fundamental frequency, beginning with the mean.
#[derive(Clone, Debug)]
pub struct Lines {
    /// One-sided phasors a_c - j a_s, unit of the signal.
    pub values: Vec<Complex<f64>>,
    /// Root mean square of the noise in every phasor, unit of the signal.
    pub noise: Vec<f64>,
}

impl RunHarmonics {
    /// The harmonics of a run up to `highest`. The channels of `spectra` are the coordinates, then the inputs.
    pub(super) fn of(
        run: usize,
        trial: &Trial,
        spectra: &Spectra,
        (coordinates, inputs): (usize, usize),
        highest: usize,
        after: Vec<f64>,
    ) -> Self {
        let highest = highest.min(spectra.highest());
        let noise = |channel: usize| (0..=highest).map(|k| spectra.variance(channel, k).max(0.0).sqrt()).collect();
        let error = error_lines(trial, spectra, coordinates, highest);
        let error = error.into_iter().enumerate().map(|(c, values)| Lines { values, noise: noise(c) }).collect();
        let input = |i: usize| Lines {
            values: spectra.lines[coordinates + i].iter().take(highest + 1).copied().collect(),
            noise: noise(coordinates + i),
        };
        RunHarmonics { run, trial: trial.clone(), after, error, inputs: (0..inputs).map(input).collect() }
    }
}
