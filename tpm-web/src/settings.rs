//! The fields of the page as settings of a request.

use crate::file::Bytes;
use crate::words::Refusal;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::str::FromStr;
use tpm_codegen::parse_factor;
use tpm_runtime::estimate::{Domain, Refine, Weights};
use tpm_runtime::experiment::prior_values;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::session::LogRequest;

/// The fields of one signal, as they are typed. What is empty is not given.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Signal {
    column: String,
    factor: String,
    offset: String,
    delay: String,
}

/// The fields of the page, as they are typed. What is empty is not given.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Settings {
    /// By the name of the signal; `t_s` is the time.
    signals: BTreeMap<String, Signal>,
    hold: String,
    sample_time: String,
    from_sample: String,
    period: String,
    harmonics: String,
    domain: String,
    weights: String,
    refine: String,
    known: String,
    held: String,
    constants: String,
}

impl Settings {
    /// The request for one log.
    pub(crate) fn request(&self, name: &str, bytes: &Bytes) -> Result<LogRequest, Refusal> {
        let mut request = LogRequest::of_bytes(name, bytes.clone());
        for (signal, own) in &self.signals {
            let columns = &mut request.reading.columns;
            if let Some(column) = given(&own.column) {
                columns.map.insert(signal.clone(), column.to_owned());
            }
            for (field, text, target) in
                [("Factor", &own.factor, &mut columns.scale), ("Offset", &own.offset, &mut columns.offset)]
            {
                if let Some(text) = given(text) {
                    let value = parse_factor(text).ok_or_else(|| {
                        let example = "such as 0.1, pi/180 or 2*pi/4096";
                        format!("{field} of {signal}: `{text}` is no finite number or expression of numbers and pi, {example}")
                    })?;
                    target.insert(signal.clone(), value);
                }
            }
            match given(&own.delay) {
                None => {}
                Some("fit") => drop(request.estimation.fitted_delays.insert(signal.clone())),
                Some(text) => {
                    let seconds = parsed::<f64>(text).filter(|seconds| seconds.is_finite() && *seconds >= 0.0);
                    request.estimation.actuators.entry(signal.clone()).or_default().delay = seconds.ok_or_else(|| {
                        format!("Delay of {signal}: `{text}` is neither a time in seconds, which must not be negative, nor `fit`")
                    })?;
                }
            }
        }
        request.reading.hold = chosen("Between samples", &self.hold, &[("none", Hold::None), ("zoh", Hold::Zoh)])?;
        request.reading.columns.sample_time = number("Time from row to row", &self.sample_time)?;
        request.reading.from_sample = number("First sample", &self.from_sample)?;
        request.reading.period = number("Period", &self.period)?;
        let estimation = &mut request.estimation;
        estimation.harmonics = number("Highest harmonic", &self.harmonics)?;
        let domains = [("", None), ("harmonics", Some(Domain::Harmonics)), ("time", Some(Domain::Time))];
        estimation.domain = chosen("How the log is used", &self.domain, &domains)?;
        estimation.weights = chosen("Weights", &self.weights, &[("noise", Weights::Noise), ("equal", Weights::Equal)])?;
        let refinements = [("auto", Refine::Auto), ("output-error", Refine::OutputError), ("none", Refine::None)];
        estimation.refine = chosen("Refinement", &self.refine, &refinements)?;
        estimation.prior = values("Known before", &self.known)?;
        estimation.frozen = values("Held", &self.held)?;
        estimation.constants = values("Constants", &self.constants)?;
        Ok(request)
    }
}

/// A field that is not empty.
fn given(text: &str) -> Option<&str> {
    Some(text.trim()).filter(|text| !text.is_empty())
}

fn parsed<N: FromStr>(text: &str) -> Option<N> {
    text.parse().ok()
}

/// The number of a field.
fn number<N: FromStr>(field: &str, text: &str) -> Result<Option<N>, Refusal> {
    let read = |text: &str| parsed(text).ok_or_else(|| Refusal(format!("{field}: `{text}` is not such a number")));
    given(text).map(read).transpose()
}

/// What a word of a field stands for; the first of the choices where nothing was chosen.
fn chosen<V: Copy>(field: &str, word: &str, choices: &[(&str, V)]) -> Result<V, Refusal> {
    let found = choices.iter().find(|(known, _)| *known == word);
    match (found, given(word)) {
        (Some((_, value)), _) => Ok(*value),
        (None, None) => Ok(choices[0].1),
        (None, Some(word)) => Err(Refusal(format!("{field}: there is no `{word}`"))),
    }
}

/// Values by name, a line each; remarks behind `#`.
fn values(field: &str, text: &str) -> Result<BTreeMap<String, f64>, Refusal> {
    let written = text.lines().any(|line| !line.trim_start().is_empty() && !line.trim_start().starts_with('#'));
    if !written {
        return Ok(BTreeMap::new());
    }
    prior_values(text).map_err(|fault| Refusal(format!("{field}: {fault}")))
}
