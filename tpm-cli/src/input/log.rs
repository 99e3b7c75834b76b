//! Options about a log of a machine: its columns, the part to use, and what its inputs do between samples.

use crate::failure::Failure;
use crate::input::assignments::{assignment, by_name, factor_assignment, number_assignment, once};
use crate::input::choice::one_of;
use clap::builder::TypedValueParser;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::log::ReadingSettings;
use tpm_runtime::model::Model;
use tpm_runtime::motion::{Dynamics, LowPass};
use tpm_runtime::plant::actuator::MotorFile;
use tpm_runtime::session::{EstimationSettings, LogRequest, RecordSettings};

/// What an input does between samples.
pub(crate) fn hold() -> impl TypedValueParser<Value = Hold> {
    one_of([
        (
            Hold::None,
            "none",
            "The recorded value is a sample of a signal that goes on between samples, or the timing is unknown",
        ),
        (Hold::Zoh, "zoh", "The recorded value is applied until the next sample"),
    ])
}

/// Options about the columns of a log, of verbs which all have an argument `log`.
#[derive(clap::Args)]
pub(crate) struct ColumnArgs {
    /// Column of a coordinate or input (or of t_s) that is named otherwise in the log, or an expression over columns.
    #[arg(long, value_name = "NAME=COLUMN", value_parser = assignment)]
    map: Vec<(String, String)>,
    /// Factor from a column's numbers (or those of t_s) to the model's unit, such as pi/180 or 2*pi/4096; a unit in the header is then
    /// not converted.
    #[arg(long, value_name = "NAME=FACTOR", value_parser = factor_assignment)]
    scale: Vec<(String, f64)>,
    /// Added to a column after its factor; a number or an expression such as -pi.
    #[arg(long, value_name = "NAME=VALUE", value_parser = factor_assignment)]
    offset: Vec<(String, f64)>,
    /// Time from row to row, of a log without a column of time.
    #[arg(long, value_name = "SECONDS")]
    sample_time: Option<f64>,
}

impl ColumnArgs {
    /// The log at a path with the settings for its columns.
    pub(crate) fn request(&self, path: &Path) -> Result<LogRequest, Failure> {
        let mut request = LogRequest::new(path);
        request.reading.columns = self.settings()?;
        Ok(request)
    }

    /// The options as they are typed.
    pub(crate) fn typed(&self) -> Vec<String> {
        let factor = |flag: &str, of: &(String, f64)| [flag.to_owned(), format!("{}={}", of.0, of.1)];
        let map = self.map.iter().flat_map(|(name, column)| ["--map".to_owned(), format!("{name}={column}")]);
        let scale = self.scale.iter().flat_map(|of| factor("--scale", of));
        let offset = self.offset.iter().flat_map(|of| factor("--offset", of));
        let time = self.sample_time.iter().flat_map(|time| ["--sample-time".to_owned(), time.to_string()]);
        map.chain(scale).chain(offset).chain(time).collect()
    }

    /// Refuses these options where no log is read.
    pub(crate) fn needs_log(&self) -> Result<(), Failure> {
        self.typed().first().map_or(Ok(()), |flag| {
            Err(Failure::Input(format!("{flag} is about the columns of a log; name the log (`--log LOG`)")))
        })
    }

    /// How its columns become signals.
    fn settings(&self) -> Result<ReadingSettings, Failure> {
        Ok(ReadingSettings {
            map: once("--map", &self.map)?,
            scale: once("--scale", &self.scale)?,
            offset: once("--offset", &self.offset)?,
            sample_time: self.sample_time,
            ..ReadingSettings::default()
        })
    }
}

/// Options of the verbs that read a log, which all have an argument `log`.
#[derive(clap::Args)]
pub(crate) struct LogArgs {
    #[command(flatten)]
    pub(crate) columns: ColumnArgs,
    /// First sample to use, from 0; found when not given.
    #[arg(long, value_name = "N", requires = "log")]
    from_sample: Option<usize>,
    /// Period of the motion in seconds; found when not given.
    #[arg(long, value_name = "SECONDS", requires = "log")]
    period: Option<f64>,
    /// What the inputs do between samples.
    #[arg(long, value_parser = hold(), requires = "log")]
    hold: Option<Hold>,
    /// Known time by which an input's force lags behind its recorded value, s; corrected. `fit` finds it with the parameters.
    #[arg(long, value_name = "INPUT=SECONDS", requires = "log", value_parser = delay)]
    delay: Vec<(String, Delay)>,
    /// Known second-order low pass behind an input's recorded value, natural frequency in rad/s and quality (1/sqrt(2) when not
    /// given); corrected.
    #[arg(long, value_name = "INPUT=W[:Q]", requires = "log", value_parser = low_pass)]
    low_pass: Vec<(String, LowPass)>,
    /// Motor file: what it states of the amplifiers is known, and corrected.
    #[arg(long, value_name = "FILE", requires = "log")]
    motor: Option<PathBuf>,
    /// Highest harmonic to use; chosen from the spectrum when not given.
    #[arg(long, value_name = "N", requires = "log")]
    harmonics: Option<usize>,
    /// Value of a constant that is known at run time only.
    #[arg(long = "constant", value_name = "NAME=VALUE", requires = "log", value_parser = number_assignment)]
    constants: Vec<(String, f64)>,
}

/// A delay as it is stated.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Delay {
    /// Known, s.
    Known(f64),
    /// To be found with the parameters.
    Fitted,
}

fn delay(text: &str) -> Result<(String, Delay), String> {
    let (name, value) = assignment(text)?;
    match value.parse::<f64>() {
        _ if value == "fit" => Ok((name, Delay::Fitted)),
        Ok(seconds) if seconds.is_finite() && seconds >= 0.0 => Ok((name, Delay::Known(seconds))),
        _ => Err(format!("`{value}` is neither a time in seconds, which must not be negative, nor `fit`")),
    }
}

fn low_pass(text: &str) -> Result<(String, LowPass), String> {
    let (name, value) = assignment(text)?;
    let (frequency, quality) = value.split_once(':').unwrap_or((&value, ""));
    let positive = |what: &str, text: &str| match text.trim().parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err(format!("the {what} `{text}` is not a positive number")),
    };
    let quality = if quality.is_empty() { std::f64::consts::FRAC_1_SQRT_2 } else { positive("quality", quality)? };
    Ok((name, LowPass { natural_frequency: positive("natural frequency (rad/s)", frequency)?, quality }))
}

impl LogArgs {
    /// Known dynamics between the recorded inputs and the forces, by input; the model gives the names of its inputs.
    fn actuators(&self, model: &dyn Model<f64>) -> Result<BTreeMap<String, Dynamics>, Failure> {
        let inputs: Vec<String> = (0..model.dims().inputs).map(|i| model.input(i).name.to_owned()).collect();
        let mut known: BTreeMap<String, Dynamics> = BTreeMap::new();
        if let Some(path) = &self.motor {
            let text = tpm_runtime::report::read_text(path).map_err(|error| Failure::read(path, error))?;
            let stated = MotorFile::parse(&text)
                .and_then(|file| file.dynamics(model))
                .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))?;
            known
                .extend(stated.into_iter().enumerate().map(|(i, dynamics)| (model.input(i).name.to_owned(), dynamics)));
        }
        for (name, delay) in by_name("--delay", &self.delay, &inputs)? {
            // A delay that is found begins at what a motor file says of the others.
            if let Delay::Known(seconds) = delay {
                known.entry(name).or_default().delay = seconds;
            }
        }
        for (name, filter) in by_name("--low-pass", &self.low_pass, &inputs)? {
            known.entry(name).or_default().filter = Some(filter);
        }
        Ok(known)
    }

    /// Inputs whose delays are to be found.
    fn fitted_delays(&self) -> impl Iterator<Item = &str> {
        self.delay.iter().filter(|(_, delay)| *delay == Delay::Fitted).map(|(name, _)| name.as_str())
    }

    /// Refuses what is found with parameters where none are.
    pub(crate) fn without_fitted_delays(&self) -> Result<(), Failure> {
        let refuse = |name| {
            let remedy = "`tpm identify` finds a delay; state it in seconds here";
            Err(Failure::Input(format!("--delay {name}=fit: nothing is fitted here; {remedy}")))
        };
        self.fitted_delays().next().map_or(Ok(()), refuse)
    }

    /// The log at a path with those settings of the command line that need no model.
    pub(crate) fn request_without_model(&self, path: &Path) -> Result<LogRequest, Failure> {
        let needing = [
            ("--delay", !self.delay.is_empty()),
            ("--low-pass", !self.low_pass.is_empty()),
            ("--motor", self.motor.is_some()),
            ("--constant", !self.constants.is_empty()),
            ("--harmonics", self.harmonics.is_some()),
        ];
        if let Some((flag, _)) = needing.iter().find(|(_, given)| *given) {
            return Err(Failure::Input(format!("{flag} needs a model; give its file behind the log")));
        }
        let mut request = LogRequest::new(path);
        request.reading = self.reading()?;
        Ok(request)
    }

    /// How the log is read.
    fn reading(&self) -> Result<RecordSettings, Failure> {
        Ok(RecordSettings {
            columns: self.columns.settings()?,
            from_sample: self.from_sample,
            period: self.period,
            hold: self.hold.unwrap_or_default(),
        })
    }

    /// The log at a path with all settings of the command line.
    pub(crate) fn request(&self, path: &Path, model: &dyn Model<f64>) -> Result<LogRequest, Failure> {
        let mut request = LogRequest::new(path);
        request.reading = self.reading()?;
        request.estimation = EstimationSettings {
            actuators: self.actuators(model)?,
            fitted_delays: self.fitted_delays().map(ToOwned::to_owned).collect(),
            harmonics: self.harmonics,
            constants: once("--constant", &self.constants)?,
            ..EstimationSettings::default()
        };
        Ok(request)
    }
}
