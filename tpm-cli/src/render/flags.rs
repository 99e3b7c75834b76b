//! Remedies and settings of the libraries as flags of this command line.

use crate::render::quoted::command;
use tpm_runtime::log::LogError;
use tpm_runtime::plant::actuator::FileFault;
use tpm_runtime::report::{Remedy, number};
use tpm_runtime::session::{Given, SessionError, Setting, Spelling};

/// The words of this command line.
struct Flags;

impl Spelling for Flags {
    fn remedy(&self, found: &Remedy) -> Option<String> {
        remedy(found)
    }

    /// Where columns have to be named, the whole command with those that may be meant, to be pasted.
    fn with(&self, message: &str, found: Option<&Remedy>) -> String {
        match found {
            Some(Remedy::Columns { columns, timeless }) => {
                let named = |flag: &str| columns.iter().any(|(signal, _)| flag.starts_with(&format!("{signal}=")));
                let mut words = vec!["tpm".to_owned()];
                let typed = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
                let mut typed = typed.peekable();
                while let Some(word) = typed.next() {
                    // What was typed for one of these signals gives way.
                    if word == "--map" && typed.peek().is_some_and(|flag| named(flag)) {
                        typed.next();
                    } else if !word.strip_prefix("--map=").is_some_and(named) {
                        words.push(word);
                    }
                }
                words.extend(column_flags(columns, *timeless));
                format!("{message}; if these are meant, paste\n  {}", command(&words))
            }
            _ => match found.and_then(remedy) {
                Some(words) => format!("{message} ({words})"),
                None => message.to_owned(),
            },
        }
    }

    fn given(&self, given: Given, name: Option<&str>) -> String {
        let flag = match given {
            Given::Column => "--map",
            Given::Scale => "--scale",
            Given::Offset => "--offset",
            Given::Change => "--set",
            Given::Bound => "--bound",
            Given::Setting(Setting::Prior) => "--prior",
            Given::Setting(Setting::Frozen) => "--freeze",
            Given::Setting(Setting::Constant) => "--constant",
            Given::Setting(Setting::Actuator) => "--delay or --low-pass",
            Given::Setting(Setting::Calibration) => "--calibration",
            _ => "",
        };
        name.map_or_else(|| flag.to_owned(), |name| format!("{flag} {name}=..."))
    }
}

/// The flags that name columns.
fn column_flags(columns: &[(String, String)], timeless: bool) -> Vec<String> {
    let of = |(signal, column): &(String, String)| {
        ["--map".to_owned(), format!("{signal}={}", if column.is_empty() { "COLUMN" } else { column })]
    };
    let time = if timeless { &["--sample-time", "SECONDS"][..] } else { &[] };
    columns.iter().flat_map(of).chain(time.iter().map(|word| (*word).to_owned())).collect()
}

/// The flag for a remedy, as text that stands in brackets behind a message.
pub(crate) fn remedy(remedy: &Remedy) -> Option<String> {
    Some(match remedy {
        Remedy::MapColumn { signal } => format!("--map {signal}=COLUMN"),
        Remedy::Columns { columns, timeless } => command(&column_flags(columns, *timeless)),
        Remedy::MapColumns { signals } => {
            signals.iter().map(|signal| format!("--map {signal}=COLUMN")).collect::<Vec<_>>().join(" ")
        }
        Remedy::Scale { signal } => format!("--scale {signal}=FACTOR"),
        Remedy::Scales { signals } => {
            signals.iter().map(|signal| format!("--scale {signal}=FACTOR")).collect::<Vec<_>>().join(" ")
        }
        Remedy::PeriodAndStart => "--period SECONDS, --from-sample N".to_owned(),
        Remedy::Period => "--period SECONDS".to_owned(),
        Remedy::FromSample => "--from-sample N".to_owned(),
        Remedy::Hold { hold } => format!("--hold {hold}"),
        Remedy::InputDelay { input, nanoseconds } => format!("--delay {input}={}", number(*nanoseconds as f64 * 1e-9)),
        Remedy::TimeDomain => "--domain time uses every sample instead".to_owned(),
        Remedy::HarmonicsOfOneStretch => "--domain harmonics uses the longest stretch that repeats instead".to_owned(),
        Remedy::Harmonics { highest } => format!("--harmonics {highest} takes them in"),
        Remedy::Simulation => "--refine output-error does it all the same".to_owned(),
        Remedy::DrivenCoordinate { input } => format!("--motion {input}=COORDINATE"),
        Remedy::Stopped => "--stopped".to_owned(),
        Remedy::HoldParameter { parameter } => format!("--freeze {parameter}=VALUE"),
        Remedy::Calibration { signals } => {
            let flags: Vec<String> = signals.iter().map(|signal| format!("--calibration {signal}=DEVIATION")).collect();
            format!("{} carries what is known of it into the deviations", flags.join(" "))
        }
        Remedy::Constants { names } => {
            names.iter().map(|name| format!("--constant {name}=VALUE")).collect::<Vec<_>>().join(" ")
        }
        Remedy::Experiment => "--experiment FILE".to_owned(),
        Remedy::SampleTime => "--sample-time 1ms".to_owned(),
        Remedy::BeginCampaign { folder } => format!("`tpm campaign start MODEL {folder}` begins one"),
        _ => return None,
    })
}

/// The message of a log's fault, with the flag that caused it or would help.
pub(crate) fn log_error(error: &LogError) -> String {
    Flags.log_error(error)
}

/// The message of a fault in a motor file, with the flag that would help.
pub(crate) fn file_fault(fault: &FileFault) -> String {
    Flags.with(&fault.to_string(), fault.remedy.as_ref())
}

/// The message of a session's fault, with the flag that caused it or would help.
pub(crate) fn error(error: &SessionError) -> String {
    Flags.session_error(error)
}
