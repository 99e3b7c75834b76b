//! From a recording to what a user would be told of it.

use crate::honesty::rig::Recording;
use std::fmt::Write as _;
use std::path::Path;
use tpm_runtime::estimate::ParameterReport;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::session::{DeclaredModel, Identification, LogRequest, SessionError, Warning, from_log};

/// A parameter as it was stated.
#[derive(Clone, Debug)]
pub struct Stated {
    /// Its name.
    pub name: String,
    /// Value and standard deviation; nothing where the data do not show it.
    pub value: Option<(f64, f64)>,
}

impl Stated {
    fn of(parameter: &ParameterReport) -> Self {
        Stated { name: parameter.name.clone(), value: parameter.value.zip(parameter.std) }
    }
}

/// Something that the user is told beside the numbers.
#[derive(Clone, Debug)]
pub struct Said {
    /// What kind of statement it is: a finding's kind, `untested` for the remark on what the log does not test, `shortfall` for what ends
    /// with exit code 1, or `error`.
    pub kind: String,
    /// The words.
    pub text: String,
    /// Kind and the term that is meant, where one is: equal for statements that differ in their numbers only.
    pub label: String,
}

impl Said {
    fn of(warning: &Warning) -> Self {
        let finding = serde_json::to_value(warning).unwrap_or_default();
        let field = |name: &str| finding[name].as_str().map(str::to_owned);
        let kind = field("kind").unwrap_or_default();
        let text = warning.to_string();
        // The numbers of a limit or of a message differ from log to log; those of an exponent do not.
        let term = field("term").map(|term| if term.contains('.') { digitless(&term) } else { term });
        let detail = term.or_else(|| field("parameter")).or_else(|| field("message").map(|own| digitless(&own)));
        let label = detail.map_or_else(|| kind.clone(), |detail| format!("{kind}: {detail}"));
        Said { kind, text, label }
    }
}

/// A text with every number replaced by `#`.
fn digitless(text: &str) -> String {
    let mut out = String::new();
    let mut inside = false;
    for (at, c) in text.char_indices() {
        let after_letter = text[..at].chars().next_back().is_some_and(|c| c.is_alphabetic() || c == '^');
        let number = c.is_ascii_digit() && (inside || !after_letter) || inside && c == '.';
        if number && !inside {
            out.push('#');
        }
        if !number {
            out.push(c);
        }
        inside = number;
    }
    out
}

/// What a user is told of a log.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The parameters; none where identification failed.
    pub parameters: Vec<Stated>,
    /// Everything that is said beside the numbers: warnings, why a result is incomplete where no warning says it, and what the log does
    /// not test; or the error.
    pub said: Vec<Said>,
    /// Exit code of the command line: 0, 1 where numbers are not to be trusted or not all that were asked for, 2 for an error.
    pub exit: u8,
}

impl Outcome {
    /// What a result says.
    #[must_use]
    pub fn of(result: &Identification) -> Self {
        let reported = if result.physical.is_empty() { &result.parameters } else { &result.physical };
        let mut said: Vec<Said> = result.warnings.iter().map(Said::of).collect();
        let shortfall = result.shortfall();
        let exit = u8::from(shortfall.is_some());
        // What leaves a result incomplete may be one of its warnings.
        let new = shortfall.filter(|text| said.iter().all(|said| said.text != *text));
        said.extend(new.map(|text| Said { kind: "shortfall".into(), label: digitless(&text), text }));
        let periodic = result.log.as_ref().and_then(|log| log.periodic());
        said.extend(periodic.and_then(|found| {
            let text = found.untested_remark()?;
            let names: Vec<&str> = found.untested.iter().map(|own| own.parameter.as_str()).collect();
            Some(Said { kind: "untested".into(), label: format!("untested: {}", names.join(", ")), text })
        }));
        Outcome { parameters: reported.iter().map(Stated::of).collect(), said, exit }
    }

    /// A failure.
    #[must_use]
    pub fn failed(error: &str) -> Self {
        let said = vec![Said { kind: "error".into(), label: digitless(error), text: error.to_owned() }];
        Outcome { parameters: Vec::new(), said, exit: 2 }
    }

    /// Whether a warning was given.
    #[must_use]
    pub fn is_warned(&self) -> bool {
        self.said.iter().any(|said| !matches!(said.kind.as_str(), "shortfall" | "untested"))
    }

    /// Value and standard deviation of a parameter; nothing where there are none.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<(f64, f64)> {
        self.parameters.iter().find(|parameter| parameter.name == name)?.value
    }
}

/// Identifies a model from a file.
#[must_use]
pub fn identify_file(model: &DeclaredModel, path: &Path, hold: Hold) -> Outcome {
    match from_log(model, LogRequest::new(path).hold(hold)) {
        Ok(result) => Outcome::of(&result),
        // The temporary file's name differs from log to log.
        Err(error) => Outcome::failed(&error.to_string().replace(&path.display().to_string(), "log")),
    }
}

/// Writes columns under their names as CSV, with nine digits.
///
/// # Errors
/// Any error of the file system.
pub fn write_csv(path: &Path, names: &[&str], columns: &[&[f64]]) -> std::io::Result<()> {
    let mut text = names.join(",");
    text.push('\n');
    for row in 0..columns.first().map_or(0, |column| column.len()) {
        for (at, column) in columns.iter().enumerate() {
            let end = if at + 1 == columns.len() { '\n' } else { ',' };
            let _ = write!(text, "{:.8e}{end}", column[row]);
        }
    }
    std::fs::write(path, text)
}

/// Writes a recording as CSV.
///
/// # Errors
/// Any error of the file system.
pub fn write(path: &Path, recording: &Recording) -> std::io::Result<()> {
    write_csv(path, &["t_s", "x", "u"], &[&recording.time, &recording.position, &recording.input])
}

/// Identifies a model from a recording, by way of a file.
///
/// # Errors
/// Any error of the file system.
pub fn identify(model: &DeclaredModel, recording: &Recording, hold: Hold) -> std::io::Result<Outcome> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("log.csv");
    write(&path, recording)?;
    Ok(identify_file(model, &path, hold))
}

/// A model from its text.
///
/// # Errors
/// The faults of the text.
pub fn parse(text: &str) -> Result<DeclaredModel, SessionError> {
    Ok(DeclaredModel::parse("model", text)?)
}

#[cfg(test)]
mod tests {
    use super::digitless;

    #[test]
    fn numbers_go_and_names_stay() {
        assert_eq!(digitless("u beyond 30.0127"), "u beyond #");
        assert_eq!(digitless("dot(x)^3 in row row1"), "dot(x)^3 in row row1");
        assert_eq!(digitless("log:1001: 0.002 s here"), "log:#: # s here");
    }
}
