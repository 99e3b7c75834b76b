//! Options about a log of a machine: its columns, the part to use, and what its inputs do between samples.

use crate::assignments::{assignment, by_name, number_assignment};
use crate::failure::Failure;
use clap::ValueEnum;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::log::LogOptions;
use tpm_runtime::model::Model as _;

/// What an input does between samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum HoldChoice {
    /// The recorded value is a sample of a signal that goes on between samples, or the timing is unknown.
    None,
    /// The recorded value is applied until the next sample.
    Zoh,
}

impl From<HoldChoice> for Hold {
    fn from(choice: HoldChoice) -> Self {
        match choice {
            HoldChoice::None => Hold::None,
            HoldChoice::Zoh => Hold::Zoh,
        }
    }
}

/// Options of the verbs that read a log, which all have an argument `log`.
#[derive(clap::Args)]
pub(crate) struct LogArgs {
    /// Column of a coordinate or input (or of t_s) that is named otherwise in the log.
    #[arg(long, value_name = "NAME=COLUMN", requires = "log", value_parser = assignment)]
    map: Vec<(String, String)>,
    /// Factor on a column: counts to radians, a gear ratio.
    #[arg(long, value_name = "NAME=FACTOR", requires = "log", value_parser = number_assignment)]
    scale: Vec<(String, f64)>,
    /// Added to a column after its factor.
    #[arg(long, value_name = "NAME=VALUE", requires = "log", value_parser = number_assignment)]
    offset: Vec<(String, f64)>,
    /// First sample to use, from 0; found when not given.
    #[arg(long, value_name = "N", requires = "log")]
    from_sample: Option<usize>,
    /// Period of the motion in seconds; found when not given.
    #[arg(long, value_name = "SECONDS", requires = "log")]
    period: Option<f64>,
    /// What the inputs do between samples.
    #[arg(long, value_enum, requires = "log")]
    hold: Option<HoldChoice>,
    /// Highest harmonic to use; chosen from the spectrum when not given.
    #[arg(long, value_name = "N", requires = "log")]
    harmonics: Option<usize>,
    /// Value of a constant that is known at run time only.
    #[arg(long = "constant", value_name = "NAME=VALUE", requires = "log", value_parser = number_assignment)]
    pub(crate) constants: Vec<(String, f64)>,
}

impl LogArgs {
    /// The same for the library, with names checked against the model.
    pub(crate) fn options(&self, model: &Interpreted) -> Result<LogOptions, Failure> {
        let dims = model.dims();
        let coordinates = (0..dims.coordinates).map(|i| model.coordinate(i).name.to_owned());
        let inputs = (0..dims.inputs).map(|i| model.input(i).name.to_owned());
        let mut signals: Vec<String> = coordinates.chain(inputs).collect();
        signals.push("t_s".to_owned());
        let constants: Vec<String> = (0..dims.constants).map(|i| model.constant(i).name.to_owned()).collect();
        let given = by_name("--constant", &self.constants, &constants)?;
        let missing: Vec<String> = constants
            .iter()
            .filter(|name| !given.contains_key(*name))
            .map(|name| format!("--constant {name}=VALUE"))
            .collect();
        if !missing.is_empty() {
            return Err(Failure::Input(format!(
                "the model has constants that are known at run time only; give {}",
                missing.join(" ")
            )));
        }
        Ok(LogOptions {
            map: by_name("--map", &self.map, &signals)?,
            scale: by_name("--scale", &self.scale, &signals)?,
            offset: by_name("--offset", &self.offset, &signals)?,
            from_sample: self.from_sample,
            period: self.period,
            hold: self.hold.map_or(Hold::None, Hold::from),
            harmonics: self.harmonics,
            constants: constants.iter().map(|name| given[name]).collect(),
            ..LogOptions::default()
        })
    }
}
