//! Faults in the words of the page: which of its fields caused one, and which would help.

use tpm_codegen::diagnostic::with_short_numbers;
use tpm_runtime::report::{Remedy, number};
use tpm_runtime::session::{Given, ModelFault, SessionError, Setting, Spelling};

/// Why a question has no answer, as a sentence.
#[derive(Debug)]
pub(crate) struct Refusal(pub(crate) String);

impl From<String> for Refusal {
    fn from(fault: String) -> Self {
        Refusal(fault)
    }
}

impl From<ModelFault> for Refusal {
    fn from(fault: ModelFault) -> Self {
        Refusal(fault.to_string().trim_end().to_owned())
    }
}

impl From<SessionError> for Refusal {
    fn from(error: SessionError) -> Self {
        Refusal(with_short_numbers(&Fields.session_error(&error)))
    }
}

/// The words of the page.
struct Fields;

impl Spelling for Fields {
    fn remedy(&self, found: &Remedy) -> Option<String> {
        remedy(found)
    }

    fn given(&self, given: Given, name: Option<&str>) -> String {
        let field = match given {
            Given::Column => "Column",
            Given::Scale => "Factor",
            Given::Offset => "Offset",
            Given::Bound => "Bounds",
            Given::Setting(Setting::Prior) => "Known before",
            Given::Setting(Setting::Frozen) => "Held",
            Given::Setting(Setting::Constant) => "Constants",
            Given::Setting(Setting::Actuator) => "Delay",
            _ => "",
        };
        name.map_or_else(|| field.to_owned(), |name| format!("{field} of {name}"))
    }
}

/// What to do where columns of signals are not found.
fn columns_of<'a>(signals: impl Iterator<Item = &'a str>) -> String {
    let signals: Vec<&str> = signals.collect();
    let columns = if signals.len() == 1 { "column" } else { "columns" };
    format!("choose the {columns} of {} under Signals", signals.join(", "))
}

/// The field of the page that follows a remedy; nothing where it has none.
pub(crate) fn remedy(found: &Remedy) -> Option<String> {
    Some(match found {
        Remedy::MapColumn { signal } => format!("choose the column of {signal} under Signals"),
        Remedy::MapColumns { signals } => columns_of(signals.iter().map(String::as_str)),
        Remedy::Columns { timeless: true, .. } => {
            "choose the column of the time under Signals, or give the time from row to row".to_owned()
        }
        Remedy::Columns { columns, .. } => columns_of(columns.iter().map(|(signal, _)| signal.as_str())),
        Remedy::Scale { signal } => format!("give the factor of {signal} under Signals"),
        Remedy::Scales { signals } => format!("give the factors of {} under Signals", signals.join(", ")),
        Remedy::PeriodAndStart => "give the period and the first sample under More settings".to_owned(),
        Remedy::Period => "give the period under More settings".to_owned(),
        Remedy::FromSample => "give the first sample under More settings".to_owned(),
        Remedy::Hold { hold } => format!("choose {hold} for what inputs do between samples"),
        Remedy::InputDelay { input, nanoseconds } => {
            format!("give {input} a delay of {} s under Signals", number(*nanoseconds as f64 * 1e-9))
        }
        Remedy::TimeDomain => "choose every sample under More settings, How the log is used".to_owned(),
        Remedy::HarmonicsOfOneStretch => "choose harmonics under More settings, How the log is used".to_owned(),
        Remedy::Harmonics { highest } => format!("give {highest} as the highest harmonic under More settings"),
        Remedy::Simulation => "choose always for the refinement under More settings".to_owned(),
        Remedy::HoldParameter { parameter } => format!("write {parameter} = VALUE under Held"),
        Remedy::Constants { names } => {
            let lines: Vec<String> = names.iter().map(|name| format!("{name} = VALUE")).collect();
            format!("write {} under Constants", lines.join(", "))
        }
        _ => return None,
    })
}
