//! What a log holds, and models to begin with.

use crate::file::Bytes;
use crate::words::{Refusal, remedy};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use tpm_runtime::campaign::samples_text;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::session::{
    DeclaredModel, LogRequest, Proposal, Quantity, SAMPLE_EXPERIMENT, SAMPLE_MODEL, Session, SessionError, inspect,
    proposals,
};

/// The columns of a log, what is said of it, and the models to begin with that fit it.
pub(crate) fn seen(name: &str, logs: &[Bytes]) -> Result<Value, Refusal> {
    let [bytes] = logs else {
        return Err(Refusal("the page asks about one log, and hands over another number".into()));
    };
    let found = inspect(LogRequest::of_bytes(name, bytes.clone()))?;
    let columns: Vec<Value> = found
        .channels
        .iter()
        .map(|channel| {
            let quantity = Quantity::of(&channel.name, channel.unit.as_deref()).to_string();
            json!({ "name": channel.name, "unit": channel.unit, "quantity": quantity, "constant": channel.constant })
        })
        .collect();
    let fitting = proposals(&found);
    Ok(json!({
        "samples": found.sampling.samples,
        "seconds": found.sampling.duration,
        "columns": columns,
        "arm": found.may_be_of_an_arm(),
        "templates": fitting.iter().map(proposed).collect::<Vec<Value>>(),
        "text": found.text(&remedy),
    }))
}

/// A model to begin with, with the columns of its signals.
fn proposed(proposal: &Proposal) -> Value {
    let template = proposal.template;
    json!({
        "name": template.name,
        "machine": template.machine,
        "model": proposal.model(&camel(template.name)),
        "signals": proposal.signals,
    })
}

/// The name of a model from that of its template: `two_masses` is TwoMasses.
fn camel(name: &str) -> String {
    let word = |word: &str| {
        let mut letters = word.chars();
        letters.next().map(|first| first.to_ascii_uppercase().to_string() + letters.as_str()).unwrap_or_default()
    };
    name.split('_').map(word).collect()
}

/// The sample: a model, and the log of a run of its simulated machine.
pub(crate) fn sample() -> Result<Value, Refusal> {
    let model = DeclaredModel::parse(SAMPLE_MODEL.0, SAMPLE_MODEL.1)?;
    let experiment = Experiment::parse(SAMPLE_EXPERIMENT.1).map_err(SessionError::from)?;
    let session = Session::new(model, experiment, None, BTreeMap::new())?;
    let (campaign, _) = session.campaign()?;
    let trial = campaign.next().ok_or(SessionError::NothingToPlay)?;
    let record = session.simulate(trial)?;
    let log = samples_text(session.machine().plant(), &record);
    Ok(
        json!({ "model": { "name": SAMPLE_MODEL.0, "text": SAMPLE_MODEL.1 }, "log": { "name": "run.csv", "text": log } }),
    )
}
