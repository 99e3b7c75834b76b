//! What `tpm frf` and `tpm fit` share: the log that is averaged to a frequency response, and the file of its Bode plot.

use crate::failure::Failure;
use crate::input::assignments::{assignment, factor_assignment, once};
use crate::input::choice::one_of;
use crate::input::log::hold;
use crate::output::picture::{self, Picture};
use crate::render::flags;
use clap::builder::TypedValueParser;
use std::path::{Path, PathBuf};
use tpm_runtime::frequency::ResponseEstimator;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::log::{Log, LogError, ReadingSettings};
use tpm_runtime::plot::Figure;
use tpm_runtime::study::{MeasuredResponse, ResponseFault, SegmentSettings};

/// Which estimate of the response.
fn estimator() -> impl TypedValueParser<Value = ResponseEstimator> {
    one_of([
        (ResponseEstimator::H1, "h1", "Noise on the output is averaged away"),
        (ResponseEstimator::H2, "h2", "Noise on the input is averaged away"),
    ])
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
    #[arg(long, value_parser = hold())]
    hold: Option<Hold>,
    /// Lowest frequency in Hz; where the longest usable run of lines begins when not given.
    #[arg(long, value_name = "HZ")]
    low: Option<f64>,
    /// Highest frequency in Hz; where that run ends when not given.
    #[arg(long, value_name = "HZ")]
    high: Option<f64>,
    /// Which estimate of the response.
    #[arg(long, value_parser = estimator(), default_value = "h1")]
    pub(crate) estimator: ResponseEstimator,
    /// Draw a Bode plot into this file, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

impl MeasuredArgs {
    /// Reads the log and averages it.
    pub(crate) fn read(&self) -> Result<MeasuredResponse, Failure> {
        if let Some(path) = &self.plot {
            Picture::of(path)?;
        }
        let signals = [self.measured.clone(), self.input.clone()];
        if signals[0] == signals[1] {
            return Err(Failure::Input(format!(
                "`{}` is both input and measured output; name two signals",
                self.input
            )));
        }
        let options = ReadingSettings {
            map: once("--map", &self.map)?,
            scale: once("--scale", &self.scale)?,
            sample_time: self.sample_time,
            ..ReadingSettings::default()
        };
        let (log, assumptions) = Log::open_signals(&self.log, &signals, &options).map_err(|error| match error {
            LogError::Io { path, source } => Failure::read(Path::new(&path), source),
            other => Failure::Input(flags::log_error(&other)),
        })?;
        let settings = SegmentSettings {
            segment: self.segment,
            overlap: self.overlap,
            periodic: self.periodic,
            hold: self.hold.unwrap_or_default(),
            low: self.low,
            high: self.high,
        };
        MeasuredResponse::new((&self.measured, &self.input), log, assumptions, &settings).map_err(|error| {
            Failure::Input(match error {
                ResponseFault::Band { .. } => format!("{error}; change --low or --high"),
                _ => format!("{}: {error}", self.log.display()),
            })
        })
    }

    /// Draws a figure into the file of `--plot`, when one is given.
    pub(crate) fn draw(&self, figure: &Figure) -> Result<(), Failure> {
        self.plot.as_ref().map_or(Ok(()), |path| picture::draw(path, figure))
    }
}
