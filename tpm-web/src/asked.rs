//! Questions of a page, and who answers them.

use crate::file::{Bytes, Named};
use crate::identified::{Identify, identified};
use crate::words::Refusal;
use crate::{findings, identified, log};
use serde::Deserialize;
use serde_json::{Value, json};
use tpm_symbolic::budget::{self, Budget};

/// What a page asks.
#[derive(Debug, Deserialize)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
enum Question {
    /// What is to be said of a model's text, and which signals it has.
    Check { model: Named },
    /// What a log holds, and the models to begin with that fit it.
    Log { log: String },
    /// A model and a log to try.
    Sample,
    /// The model of a robot description.
    Import { description: Named },
    /// Parameters from logs.
    Identify(Box<Identify>),
    /// Source code of a model's estimator with identified values.
    Generate { model: Named, language: String, result: Option<String> },
}

/// The answer to a question in JSON; `logs` are the files that it names, in their order.
#[must_use]
pub fn answer(question: &str, logs: &[Bytes]) -> String {
    let asked: Question = match serde_json::from_str(question) {
        Ok(asked) => asked,
        Err(fault) => return refused(&format!("the page asks what is not known here: {fault}")),
    };
    let answered = budget::run(Budget::default(), || answered(asked, logs));
    match answered {
        Ok(Ok(answer)) => answer.to_string(),
        Ok(Err(Refusal(fault))) => refused(&fault),
        Err(halted) => refused(&halted.to_string()),
    }
}

/// The answer that is a fault.
fn refused(fault: &str) -> String {
    json!({ "error": fault }).to_string()
}

fn answered(asked: Question, logs: &[Bytes]) -> Result<Value, Refusal> {
    match asked {
        Question::Check { model } => Ok(findings::checked(&model)),
        Question::Log { log } => log::seen(&log, logs),
        Question::Sample => log::sample(),
        Question::Import { description } => findings::imported(description),
        Question::Identify(asked) => identified(*asked, logs),
        Question::Generate { model, language, result } => identified::generated(&model, &language, result.as_deref()),
    }
}
