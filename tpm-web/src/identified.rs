//! Identification, and what is taken away from it.

use crate::file::{Bytes, Named};
use crate::settings::Settings;
use crate::words::{Refusal, remedy};
use serde::Deserialize;
use serde_json::{Value, json};
use tpm_codegen::diagnostic;
use tpm_codegen::emit::estimator::{EstimatorSource, Identified};
use tpm_codegen::generate::{Language, Options, generate};
use tpm_codegen::{Diagnostic, Source, parse_model};
use tpm_runtime::document::{Document, Issue};
use tpm_runtime::session::{DeclaredModel, LogRequest, evidence, from_logs};

/// What the page hands over for an identification.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Identify {
    model: Named,
    /// Names of the logs.
    logs: Vec<String>,
    #[serde(default)]
    settings: Settings,
    /// What the report says it is about, who wrote it, and on which day.
    #[serde(default)]
    title: String,
    #[serde(default)]
    author: String,
    #[serde(default)]
    date: Option<String>,
}

/// Parameters from logs: the result's JSON as the command line writes it, its text, the report.
pub(crate) fn identified(asked: Identify, logs: &[Bytes]) -> Result<Value, Refusal> {
    if asked.logs.len() != logs.len() {
        return Err(Refusal("the page names other logs than it hands over".to_owned()));
    }
    let model = DeclaredModel::parse(&asked.model.name, &asked.model.text)?;
    let requests = asked.logs.iter().zip(logs).map(|(name, bytes)| asked.settings.request(name, bytes));
    let requests: Vec<LogRequest> = requests.collect::<Result<_, Refusal>>()?;
    let result = from_logs(&model, requests.clone())?;
    let mut remarks: Vec<String> = Some(model.remarks()).filter(|remarks| !remarks.is_empty()).into_iter().collect();
    let shown = evidence(&model, requests, &result).unwrap_or_else(|error| {
        remarks.push(format!("the report is without measured against model: {}", Refusal::from(error).0));
        Vec::new()
    });
    let issue = |text: String| Some(text).filter(|text| !text.trim().is_empty());
    let issue = Issue { title: issue(asked.title), author: issue(asked.author), date: asked.date };
    let document =
        Document::of_identification(&result, &shown, &remedy).of_machine(&model, &result, &|_| None).issued(issue);
    let report = document.html().map_err(|error| error.to_string())?;
    let mut json = serde_json::to_string_pretty(&result).map_err(|error| error.to_string())?;
    json.push('\n');
    Ok(json!({
        "result": json,
        "text": result.text(&remedy),
        "report": report,
        "shortfall": result.shortfall(),
        "remarks": remarks,
    }))
}

/// The source files of a model's estimator; with a result the identified values are a constant in them.
pub(crate) fn generated(model: &Named, language: &str, result: Option<&str>) -> Result<Value, Refusal> {
    let source = Source::new(&*model.name, &*model.text);
    let target = Language::from_name(language)
        .ok_or_else(|| format!("there is no code in `{language}`, but in c and in rust"))?;
    let parsed = parse_model(&source).map_err(|faults| faults.render(&source))?;
    let at = |fault: &Diagnostic| Refusal(diagnostic::render(&source, fault).trim_end().to_owned());
    let whole = |message: String| at(&Diagnostic::error(parsed.ast.name.span, message));
    let estimator = EstimatorSource::of(&parsed).map_err(|fault| at(&fault))?;
    let identified = result.map(Identified::from_json).transpose().map_err(|error| error.to_string())?;
    // The command that makes the same files stands in their first lines.
    let values = if identified.is_some() { " --params result.json" } else { "" };
    let command = format!("tpm generate {} --lang {language}{values}", model.name);
    let options = Options { identified: identified.as_ref(), ..Options::new(target, &command) };
    let files = generate(&estimator, &options).map_err(|error| whole(error.to_string()))?;
    let files: Vec<Value> = files.into_iter().map(|file| json!({ "name": file.name, "text": file.text })).collect();
    Ok(json!({ "files": files, "remarks": estimator.gaps() }))
}
