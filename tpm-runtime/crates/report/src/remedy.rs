//! What a user can do about a warning or an error.

use crate::displayed::displayed;
use serde::Serialize;
use tpm_controller::harmonics::Hold;

/// A setting that would remove a warning or an error. The library states it as data; a front end spells it in its own words, such
/// as the name of a flag.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "setting", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Remedy {
    /// Name the column of the file in which a signal of the model stands.
    MapColumn {
        /// The signal, as the model names it.
        signal: String,
    },
    /// Name the columns of signals: those of the file that fit best, by their names and units.
    Columns {
        /// Every signal that has none yet, as the model names it (`t_s` for the time), and the column that may be meant; an empty
        /// name where none is left.
        columns: Vec<(String, String)>,
        /// Whether the time from row to row has to be stated, since no column may be the time.
        timeless: bool,
    },
    /// Name the columns of the file in which these signals of the model stand.
    MapColumns {
        /// The signals, as the model names them.
        signals: Vec<String>,
    },
    /// State the factor from the column of a signal to the signal's unit.
    Scale {
        /// The signal, as the model names it; `t_s` for the time.
        signal: String,
    },
    /// State the factors from the columns of these signals to the signals' units.
    Scales {
        /// The signals, as the model names them.
        signals: Vec<String>,
    },
    /// State from which sample on the motion repeats, and its period.
    PeriodAndStart,
    /// State the period in seconds.
    Period,
    /// State the first sample to use.
    FromSample,
    /// State how the inputs behave between samples.
    Hold {
        /// The hold to state.
        #[serde(serialize_with = "displayed")]
        hold: Hold,
    },
    /// State that an input's force lags behind its recorded value by this time.
    InputDelay {
        /// The input, as the model names it.
        input: String,
        /// The time, ns.
        nanoseconds: u64,
    },
    /// Use every sample in the time domain, even of a record that repeats.
    TimeDomain,
    /// Use the harmonics of the longest stretch that repeats, even of a record with gaps.
    HarmonicsOfOneStretch,
    /// Use the harmonics up to this one.
    Harmonics {
        /// The highest harmonic.
        highest: usize,
    },
    /// Refine by a simulation, however long it takes.
    Simulation,
    /// State which coordinate an input drives.
    DrivenCoordinate {
        /// The input, as the model names it.
        input: String,
    },
    /// Say that the machine stopped the run.
    Stopped,
    /// State how well sensors are calibrated.
    Calibration {
        /// The coordinates and inputs, as the model names them.
        signals: Vec<String>,
    },
    /// Hold a parameter at a value.
    HoldParameter {
        /// The parameter, as the model names it.
        parameter: String,
    },
    /// Name the file of an experiment.
    Experiment,
    /// Begin a campaign in a folder.
    BeginCampaign {
        /// The folder.
        folder: String,
    },
    /// State how often the machine is sampled.
    SampleTime,
    /// Give a value to a constant of the model that is known at run time only.
    Constants {
        /// The constants without a value.
        names: Vec<String>,
    },
}
