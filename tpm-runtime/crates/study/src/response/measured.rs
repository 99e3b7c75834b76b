//! The frequency response of a log in a band.

use std::fmt;
use thiserror::Error;
use tpm_controller::harmonics::Hold;
use tpm_frequency::{BodeSettings, FrequencyResponse, NamedModel, ResponseError, Welch, bode};
use tpm_log::{Assumption, Log};
use tpm_motion::Window;
use tpm_plot::Figure;

/// Number of half-overlapping segments in a record when no segment length is given.
const SEGMENTS: f64 = 8.0;

/// Shortest segment length, in samples, that is chosen automatically.
const SHORTEST: usize = 64;

/// How a log is averaged, and in which band its response is used.
#[derive(Clone, Copy, Debug)]
pub struct SegmentSettings {
    /// Samples in a segment; the largest power of two of which eight fit when not given.
    pub segment: Option<usize>,
    /// Share of a segment that the next one repeats.
    pub overlap: f64,
    /// Whether segments are whole periods of an excitation that repeats: no window, no overlap.
    pub periodic: bool,
    /// What the input does between samples.
    pub hold: Hold,
    /// Lowest frequency, Hz; where the longest usable run of lines begins when not given.
    pub low: Option<f64>,
    /// Highest frequency, Hz; where that run ends when not given.
    pub high: Option<f64>,
}

/// Why a log has no response in a band.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ResponseFault {
    /// The samples cannot be averaged.
    #[error(transparent)]
    Response(#[from] ResponseError),
    /// The output does not follow the input.
    #[error(
        "`{output}` does not follow `{input}` at any frequency: the coherence is chance throughout; are these the right columns?"
    )]
    Incoherent {
        /// The input.
        input: String,
        /// The measured output.
        output: String,
    },
    /// The band does not rise.
    #[error("the band {low} to {high} Hz must rise")]
    Band {
        /// Lowest frequency, Hz.
        low: f64,
        /// Highest frequency, Hz.
        high: f64,
    },
}

/// A log of one output (its first signal) and one input with their frequency response in a band.
#[derive(Debug)]
pub struct MeasuredResponse {
    /// The input.
    pub input: String,
    /// The measured output.
    pub output: String,
    /// The log.
    pub log: Log,
    /// What was assumed when it was read.
    pub assumptions: Vec<Assumption>,
    /// The averaged response.
    pub response: FrequencyResponse,
    /// Lowest frequency of the band, Hz.
    pub low: f64,
    /// Highest frequency of the band, Hz.
    pub high: f64,
}

impl MeasuredResponse {
    /// Averages a log whose signals are the output and the input, in this order.
    ///
    /// # Errors
    /// [`ResponseFault`] when the log is too short for its segments, the output follows the input at no frequency and no band is given,
    /// or the band does not rise.
    pub fn new(
        (output, input): (&str, &str),
        log: Log,
        assumptions: Vec<Assumption>,
        settings: &SegmentSettings,
    ) -> Result<Self, ResponseFault> {
        let segment = settings.segment.unwrap_or_else(|| chosen_segment(log.len()));
        let welch = if settings.periodic {
            Welch::periodic(segment, settings.hold)
        } else {
            Welch { overlap: settings.overlap, ..Welch::new(segment, settings.hold) }
        };
        let response = FrequencyResponse::estimate(&log.channels[1], &log.channels[0], log.sample_time, &welch)?;
        let (low, high) = match (settings.low, settings.high, response.usable_band()) {
            (Some(low), Some(high), _) => (low, high),
            (low, high, Some(found)) => (low.unwrap_or(found.0), high.unwrap_or(found.1)),
            (_, _, None) => {
                return Err(ResponseFault::Incoherent { input: input.to_owned(), output: output.to_owned() });
            }
        };
        if !(low >= 0.0 && low < high) {
            return Err(ResponseFault::Band { low, high });
        }
        Ok(Self { input: input.to_owned(), output: output.to_owned(), log, assumptions, response, low, high })
    }

    /// Samples of the input and of the output.
    #[must_use]
    pub fn signals(&self) -> (&[f64], &[f64]) {
        (&self.log.channels[1], &self.log.channels[0])
    }

    /// The Bode plot with models; `unit` is that of output over input, where it is known.
    #[must_use]
    pub fn bode(&self, models: &[NamedModel<'_>], unit: Option<String>) -> Figure {
        let settings = BodeSettings {
            title: format!("{} over {}", self.output, self.input),
            unit: unit.unwrap_or_else(|| format!("{} per {}", self.output, self.input)),
            low: self.low,
            high: self.high,
        };
        bode(&self.response, models, &settings)
    }
}

/// The measurement in words.
impl fmt::Display for MeasuredResponse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { input, output, log, assumptions, response, low, high } = self;
        let welch = &response.welch;
        let usable = response.band(*low, *high).filter(|line| line.usable).count();
        let all = response.band(*low, *high).count();
        let window = match welch.window {
            Window::Hann => "Hann window",
            Window::Rectangular => "no window",
        };
        writeln!(
            f,
            "{output} over {input} from {}\n{} samples every {} s; {} segments of {} samples ({:.3} s), overlap {:.0} %, {window}, as good as {:.1} independent ones",
            log.path,
            log.len(),
            log.sample_time,
            response.segments,
            welch.segment,
            welch.segment as f64 * log.sample_time,
            100.0 * welch.overlap,
            response.averages,
        )?;
        match welch.hold {
            Hold::None => f.write_str("hold none: the input is taken as it was recorded\n")?,
            Hold::Zoh => {
                let effect = response.hold_effect(*low, *high);
                writeln!(
                    f,
                    "hold zoh: its lag of half a sample is corrected, which changes the response by {:.2} % (median), {:.2} % at most",
                    100.0 * effect.median,
                    100.0 * effect.largest
                )?;
            }
        }
        for assumption in assumptions {
            writeln!(f, "remark: {assumption}")?;
        }
        writeln!(f, "band {low:.4} to {high:.4} Hz: {all} lines, {usable} usable")
    }
}

fn chosen_segment(samples: usize) -> usize {
    // n half-overlapping segments take (n + 1)/2 times the length of one.
    let most = (2.0 * samples as f64 / (SEGMENTS + 1.0)) as usize;
    let power = if most > 0 { 1 << most.ilog2() } else { 0 };
    power.max(SHORTEST)
}

#[cfg(test)]
mod tests {
    use super::chosen_segment;

    #[test]
    fn eight_segments_fit() {
        assert_eq!(chosen_segment(180_000), 32_768);
        assert_eq!(chosen_segment(147_456), 32_768);
        assert_eq!(chosen_segment(147_455), 16_384);
        assert_eq!(chosen_segment(3), 64);
    }
}
