//! What `tpm frf` and `tpm fit` share: reading a log, averaging it to a frequency response, and the Bode plot.

use crate::failure::Failure;
use crate::input::assignments::{assignment, factor_assignment, once};
use crate::input::log::HoldChoice;
use crate::output::picture::{self, Picture};
use crate::render::flags;
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use tpm_runtime::frequency::{BodeSettings, FrequencyResponse, NamedModel, ResponseEstimator, Welch, bode};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::log::ReadingSettings;
use tpm_runtime::log::{Assumption, Log, LogError};
use tpm_runtime::motion::Window;

/// Number of half-overlapping segments in a record when no segment length is given.
const SEGMENTS: f64 = 8.0;
/// Shortest segment length, in samples, that is chosen automatically.
const SHORTEST: usize = 64;

/// Which estimate of the response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum EstimatorChoice {
    /// Noise on the output is averaged away.
    H1,
    /// Noise on the input is averaged away.
    H2,
}

impl From<EstimatorChoice> for ResponseEstimator {
    fn from(choice: EstimatorChoice) -> Self {
        match choice {
            EstimatorChoice::H1 => ResponseEstimator::H1,
            EstimatorChoice::H2 => ResponseEstimator::H2,
        }
    }
}

/// Options about the log and its averaging.
#[derive(clap::Args)]
pub(crate) struct MeasuredArgs {
    /// The log: columns with a header, time and signals by name.
    pub(crate) log: PathBuf,
    /// The input, a column of the log.
    #[arg(long, value_name = "NAME")]
    pub(crate) input: String,
    /// The measured output, a column of the log.
    #[arg(long, value_name = "NAME")]
    pub(crate) measured: String,
    /// Column of a signal (or of t_s) that is named otherwise in the log.
    #[arg(long, value_name = "NAME=COLUMN", value_parser = assignment)]
    map: Vec<(String, String)>,
    /// Factor on a column (or on t_s, to seconds), such as pi/180 or 2*pi/4096.
    #[arg(long, value_name = "NAME=FACTOR", value_parser = factor_assignment)]
    scale: Vec<(String, f64)>,
    /// Time from row to row, of a log without a column of time.
    #[arg(long, value_name = "SECONDS")]
    sample_time: Option<f64>,
    /// Samples in a segment; the largest power of two of which eight fit when not given.
    #[arg(long, value_name = "N")]
    segment: Option<usize>,
    /// Share of a segment that the next one repeats.
    #[arg(long, value_name = "SHARE", default_value_t = 0.5)]
    overlap: f64,
    /// Segments are whole periods of an excitation that repeats: no window, no overlap.
    #[arg(long, requires = "segment", conflicts_with = "overlap")]
    periodic: bool,
    /// What the input does between samples.
    #[arg(long, value_enum)]
    hold: Option<HoldChoice>,
    /// Lowest frequency in Hz; where the longest usable run of lines begins when not given.
    #[arg(long, value_name = "HZ")]
    low: Option<f64>,
    /// Highest frequency in Hz; where that run ends when not given.
    #[arg(long, value_name = "HZ")]
    high: Option<f64>,
    /// Which estimate of the response.
    #[arg(long, value_enum, default_value = "h1")]
    pub(crate) estimator: EstimatorChoice,
    /// Draw a Bode plot into this file, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

/// A log with its frequency response in a band.
pub(crate) struct Measured {
    pub(crate) log: Log,
    assumptions: Vec<Assumption>,
    pub(crate) response: FrequencyResponse,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

impl Measured {
    /// Input and output samples.
    pub(crate) fn signals(&self) -> (&[f64], &[f64]) {
        (&self.log.channels[1], &self.log.channels[0])
    }

    /// Reads the log and averages it.
    pub(crate) fn new(args: &MeasuredArgs) -> Result<Self, Failure> {
        if let Some(path) = &args.plot {
            Picture::of(path)?;
        }
        let signals = [args.measured.clone(), args.input.clone()];
        if signals[0] == signals[1] {
            return Err(Failure::Input(format!(
                "`{}` is both input and measured output; name two signals",
                args.input
            )));
        }
        let options = ReadingSettings {
            map: once("--map", &args.map)?,
            scale: once("--scale", &args.scale)?,
            sample_time: args.sample_time,
            ..ReadingSettings::default()
        };
        let (log, assumptions) =
            Log::open_signals_with(&args.log, &signals, &options).map_err(|error| match error {
                LogError::Io { path, source } => Failure::read(Path::new(&path), source),
                other => Failure::Input(flags::log_error(&other)),
            })?;
        let segment = args.segment.unwrap_or_else(|| chosen_segment(log.len()));
        let hold = args.hold.map_or(Hold::None, Hold::from);
        let welch = if args.periodic {
            Welch::periodic(segment, hold)
        } else {
            Welch { overlap: args.overlap, ..Welch::new(segment, hold) }
        };
        let response = FrequencyResponse::estimate(&log.channels[1], &log.channels[0], log.sample_time, &welch)
            .map_err(|error| Failure::Input(format!("{}: {error}", args.log.display())))?;
        let (low, high) = match (args.low, args.high, response.usable_band()) {
            (Some(low), Some(high), _) => (low, high),
            (low, high, Some(found)) => (low.unwrap_or(found.0), high.unwrap_or(found.1)),
            (_, _, None) => {
                return Err(Failure::Input(format!(
                    "{}: `{}` does not follow `{}` at any frequency: the coherence is chance throughout; are these the right columns?",
                    args.log.display(),
                    args.measured,
                    args.input
                )));
            }
        };
        if !(low >= 0.0 && low < high) {
            return Err(Failure::Input(format!("the band {low} to {high} Hz must rise; change --low or --high")));
        }
        Ok(Measured { log, assumptions, response, low, high })
    }

    /// The measurement in words.
    pub(crate) fn describe(&self, args: &MeasuredArgs) -> String {
        let Measured { log, assumptions, response, low, high } = self;
        let welch = &response.welch;
        let usable = response.band(*low, *high).filter(|line| line.usable).count();
        let all = response.band(*low, *high).count();
        let window = match welch.window {
            Window::Hann => "Hann window",
            Window::Rectangular => "no window",
        };
        let mut text = format!(
            "{} over {} from {}\n{} samples every {} s; {} segments of {} samples ({:.3} s), overlap {:.0} %, {window}, as good as {:.1} independent ones\n",
            args.measured,
            args.input,
            log.path,
            log.len(),
            log.sample_time,
            response.segments,
            welch.segment,
            welch.segment as f64 * log.sample_time,
            100.0 * welch.overlap,
            response.averages,
        );
        match welch.hold {
            Hold::None => text.push_str("hold none: the input is taken as it was recorded\n"),
            Hold::Zoh => {
                let effect = response.hold_effect(*low, *high);
                text.push_str(&format!(
                    "hold zoh: its lag of half a sample is corrected, which changes the response by {:.2} % (median), {:.2} % at most\n",
                    100.0 * effect.median,
                    100.0 * effect.largest
                ));
            }
        }
        for assumption in assumptions {
            text.push_str(&format!("remark: {assumption}\n"));
        }
        text.push_str(&format!("band {low:.4} to {high:.4} Hz: {all} lines, {usable} usable\n"));
        text
    }

    /// Draws the Bode plot into the file of `--plot`, when one is given; `unit` is that of output over input, where it is known.
    pub(crate) fn plot(
        &self,
        args: &MeasuredArgs,
        models: &[NamedModel<'_>],
        unit: Option<String>,
    ) -> Result<(), Failure> {
        let Some(path) = &args.plot else { return Ok(()) };
        let settings = BodeSettings {
            title: format!("{} over {}", args.measured, args.input),
            unit: unit.unwrap_or_else(|| format!("{} per {}", args.measured, args.input)),
            low: self.low,
            high: self.high,
        };
        let figure = bode(&self.response, models, &settings);
        picture::draw(path, &figure)
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
