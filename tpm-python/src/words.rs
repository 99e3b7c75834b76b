//! Faults as exceptions: the sentences of the command line, with remedies spelled as keyword arguments.

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;
use tpm_codegen::diagnostic::with_short_numbers;
use tpm_runtime::log::LogError;
use tpm_runtime::report::{Remedy, number};
use tpm_runtime::session::{Given, ModelFault, SessionError, Setting, Spelling};
use tpm_symbolic::budget::Halted;

create_exception!(tpm, Error, PyException, "What is wrong with the input, and what to give instead.");

/// Why a call has no result.
pub(crate) enum Fault {
    /// What is wrong, and what helps.
    Input(String),
    /// Ctrl-C.
    Interrupted,
}

impl From<Fault> for PyErr {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Input(message) => Error::new_err(with_short_numbers(message.trim_end())),
            Fault::Interrupted => PyKeyboardInterrupt::new_err(()),
        }
    }
}

impl From<String> for Fault {
    fn from(message: String) -> Self {
        Fault::Input(message)
    }
}

impl From<SessionError> for Fault {
    fn from(error: SessionError) -> Self {
        Fault::Input(Keywords.session_error(&error))
    }
}

impl From<ModelFault> for Fault {
    fn from(fault: ModelFault) -> Self {
        Fault::Input(fault.to_string())
    }
}

impl From<LogError> for Fault {
    fn from(error: LogError) -> Self {
        Fault::Input(Keywords.log_error(&error))
    }
}

impl From<Halted> for Fault {
    fn from(halted: Halted) -> Self {
        match halted {
            Halted::Stopped => Fault::Interrupted,
            other => Fault::Input(format!("{other}: allow_large=True")),
        }
    }
}

/// The words of this module.
pub(crate) struct Keywords;

impl Spelling for Keywords {
    fn remedy(&self, found: &Remedy) -> Option<String> {
        remedy(found)
    }

    fn given(&self, given: Given, name: Option<&str>) -> String {
        let keyword = match given {
            Given::Column => "map",
            Given::Scale => "scale",
            Given::Offset => "offset",
            Given::Change => "changes",
            Given::Bound => "bounds",
            Given::Setting(Setting::Prior) => "prior",
            Given::Setting(Setting::Frozen) => "freeze",
            Given::Setting(Setting::Constant) => "constants",
            Given::Setting(Setting::Actuator) => "delay or low_pass",
            _ => "",
        };
        name.map_or_else(|| keyword.to_owned(), |name| format!("{keyword}={{\"{name}\": ...}}"))
    }
}

/// The keyword argument for a remedy; nothing where this module has none.
pub(crate) fn remedy(found: &Remedy) -> Option<String> {
    Some(match found {
        Remedy::MapColumn { signal } => format!("map={{\"{signal}\": COLUMN}}"),
        Remedy::Columns { columns, timeless } => {
            let column = |(signal, column): &(String, String)| format!("{signal:?}: {column:?}");
            let map = (!columns.is_empty())
                .then(|| format!("map={{{}}}", columns.iter().map(column).collect::<Vec<_>>().join(", ")));
            let time = timeless.then(|| "sample_time=SECONDS".to_owned());
            map.into_iter().chain(time).collect::<Vec<_>>().join(", ")
        }
        Remedy::MapColumns { signals } => {
            let columns: Vec<String> = signals.iter().map(|signal| format!("\"{signal}\": COLUMN")).collect();
            format!("map={{{}}}", columns.join(", "))
        }
        Remedy::Scale { signal } => format!("scale={{\"{signal}\": FACTOR}}"),
        Remedy::Scales { signals } => {
            let factors: Vec<String> = signals.iter().map(|signal| format!("\"{signal}\": FACTOR")).collect();
            format!("scale={{{}}}", factors.join(", "))
        }
        Remedy::PeriodAndStart => "period=SECONDS, from_sample=N".to_owned(),
        Remedy::Period => "period=SECONDS".to_owned(),
        Remedy::FromSample => "from_sample=N".to_owned(),
        Remedy::Hold { hold } => format!("hold=\"{hold}\""),
        Remedy::InputDelay { input, nanoseconds } => {
            format!("delay={{\"{input}\": {}}}", number(*nanoseconds as f64 * 1e-9))
        }
        Remedy::TimeDomain => "domain=\"time\" uses every sample instead".to_owned(),
        Remedy::HarmonicsOfOneStretch => {
            "domain=\"harmonics\" uses the longest stretch that repeats instead".to_owned()
        }
        Remedy::Harmonics { highest } => format!("harmonics={highest} takes them in"),
        Remedy::Simulation => "refine=\"output-error\" does it all the same".to_owned(),
        Remedy::Stopped => "stopped=True".to_owned(),
        Remedy::HoldParameter { parameter } => format!("freeze={{\"{parameter}\": VALUE}}"),
        Remedy::Experiment => "experiment=FILE".to_owned(),
        Remedy::BeginCampaign { folder } => format!("Campaign.begin(\"{folder}\", MODEL) begins one"),
        Remedy::Constants { names } => {
            let given: Vec<String> = names.iter().map(|name| format!("\"{name}\": VALUE")).collect();
            format!("constants={{{}}}", given.join(", "))
        }
        _ => return None,
    })
}
