//! The settled part of a run as samples.

use tpm_estimate::beside_counts;
use tpm_motion::Spectra;
use tpm_numerics::alarm;
use tpm_numerics::differences::white_noise;
use tpm_numerics::grid;

/// Smallest amplitude of a harmonic that counts as part of the motion, as a share of the largest amplitude.
const LEAST_AMPLITUDE: f64 = 1e-3;

/// The last samples of the settled part of a run, [`SteadyRun::MOST_SAMPLES`] at most.
#[derive(Clone, Debug, PartialEq)]
pub struct SteadyRun {
    /// Index of the run among the reports.
    pub run: usize,
    /// Samples of every coordinate, then of every input; unit of the coordinate or input.
    pub channels: Vec<Vec<f64>>,
    /// Number of samples in a period.
    pub period: usize,
    /// Number of samples in the whole settled part.
    pub of: usize,
    /// Highest frequency of the motion of every coordinate that is above the noise, Hz.
    pub highest: Vec<f64>,
    /// Quantisation step of the sensor of every coordinate; zero for a sensor without steps, and where the mean
    /// quantisation error was subtracted.
    pub steps: Vec<f64>,
    /// Whether quantisation error, which repeats with the motion, makes up the noise of at least one sensor.
    pub counted: bool,
}

impl SteadyRun {
    /// Most samples of all runs together that the refinement simulates. No more samples of a single run are kept.
    pub const MOST_SAMPLES: usize = 160_000;

    /// The last samples of a settled part. `channels` holds whole periods of every channel, the coordinates before the
    /// inputs.
    pub(super) fn of(run: usize, channels: &[&[f64]], coordinates: usize, period: usize, spectra: &Spectra) -> Self {
        let readings = channels.iter().take(coordinates).enumerate();
        let rounding: Vec<Option<Vec<f64>>> =
            readings.map(|(c, own)| spectra.mean_rounding(c, *own.first()?)).collect();
        // Readings from which the mean quantisation error is subtracted are no longer multiples of a step. An encoder whose counts are finer
        // than the readings are dense rounds a motion that repeats alike in every period all the same.
        let step = |(c, rounding): (usize, &Option<_>)| if rounding.is_some() { 0.0 } else { grid(channels[c]) };
        let steps: Vec<f64> = rounding.iter().enumerate().map(step).collect();
        let by_counts = |(channel, step): (&&[f64], &f64)| beside_counts(white_noise(channel), *step).is_some();
        let kept = |(c, channel): (usize, &&[f64])| {
            let mut readings = end(channel, Self::MOST_SAMPLES).to_vec();
            if let Some(Some(errors)) = rounding.get(c) {
                let left_out = channel.len() - readings.len();
                let errors = errors.iter().cycle().skip(left_out % period);
                readings.iter_mut().zip(errors).for_each(|(reading, error)| *reading -= error);
            }
            readings
        };
        SteadyRun {
            run,
            channels: channels.iter().enumerate().map(kept).collect(),
            period,
            of: channels.first().map_or(0, |channel| channel.len()),
            highest: (0..coordinates).map(|c| highest(spectra, c)).collect(),
            counted: channels.iter().zip(&steps).any(by_counts),
            steps,
        }
    }

    /// Number of samples that are kept.
    pub fn samples(&self) -> usize {
        self.channels.first().map_or(0, Vec::len)
    }

    /// The last samples of a channel, as many as there are up to `count`.
    pub fn last(&self, channel: usize, count: usize) -> &[f64] {
        end(&self.channels[channel], count)
    }
}

/// Frequency in Hz of the highest harmonic of a coordinate that is above the noise and no smaller than [`LEAST_AMPLITUDE`] times
/// the largest.
fn highest(spectra: &Spectra, coordinate: usize) -> f64 {
    let lines = &spectra.lines[coordinate];
    let peak = lines.iter().skip(1).map(|line| line.norm()).fold(0.0, f64::max);
    let belongs = |k: usize| {
        let least = (LEAST_AMPLITUDE * peak).powi(2).max(alarm::LINE_OF_MOTION * spectra.variance(coordinate, k));
        lines[k].norm_sqr() >= least
    };
    let harmonic = (1..lines.len()).rev().find(|&k| belongs(k)).unwrap_or(1);
    harmonic as f64 * spectra.fundamental / (2.0 * std::f64::consts::PI)
}

fn end(samples: &[f64], count: usize) -> &[f64] {
    &samples[samples.len().saturating_sub(count)..]
}
