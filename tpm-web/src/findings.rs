//! What is to be said of a model while it is written, and models of robot descriptions.

use crate::file::Named;
use crate::words::Refusal;
use serde_json::{Value, json};
use tpm_codegen::diagnostic::{Diagnostic, Severity, render};
use tpm_codegen::import::{Options, import_description};
use tpm_codegen::{Source, findings, parse_model};
use tpm_symbolic::budget::Budget;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::regressor::prepare::prepare_any;

/// Faults and remarks with their places, and the signals and parameters of a model that can be read.
pub(crate) fn checked(model: &Named) -> Value {
    let source = Source::new(&*model.name, &*model.text);
    let larger = "the command line takes it: tpm check --allow-large";
    let found = findings(&source, Budget::of_outer(), larger);
    let list: Vec<Value> = found.iter().map(|own| placed(&source, own)).collect();
    json!({ "findings": list, "omitted": found.omitted(), "faulty": found.has_errors(), "model": described(&source) })
}

/// A finding with its place: as people count it, and in the units of UTF-16 in which a browser counts.
fn placed(source: &Source, found: &Diagnostic) -> Value {
    let range = source.visible(found.span);
    let position = source.position(found.span.start);
    let units = |end: usize| source.text().get(..end).map_or(0, |before| before.encode_utf16().count());
    let others: Vec<Value> = found
        .labels
        .iter()
        .map(|label| json!({ "line": source.position(label.span.start).line, "message": label.text }))
        .collect();
    json!({
        "error": found.severity == Severity::Error,
        "from": units(range.start),
        "to": units(range.end),
        "line": position.line,
        "column": position.column,
        "message": found.headline(),
        "others": others,
    })
}

/// The names of a model that the page has fields for; null where it cannot be read.
fn described(source: &Source) -> Value {
    let Ok(parsed) = parse_model(source) else { return Value::Null };
    let Ok(prepared) = prepare_any(parsed.model.clone()) else { return Value::Null };
    let own = &parsed.model;
    let known = |symbols: Vec<(String, Option<String>)>| -> Vec<Value> {
        symbols.into_iter().map(|(name, unit)| json!({ "name": name, "unit": unit })).collect()
    };
    let of = |model: &ExactModel, symbols: &mut dyn Iterator<Item = tpm_symbolic::expr::graph::Symbol>| {
        let quantity = |symbol| {
            let quantity = model.quantity(symbol);
            (quantity.name.to_string(), quantity.unit.as_ref().map(ToString::to_string))
        };
        known(symbols.map(quantity).collect())
    };
    let coordinates = prepared.model.coordinates.iter().filter(|coordinate| !coordinate.unmeasured);
    let coordinates = coordinates.map(|own| (own.name.clone(), own.unit.as_ref().map(ToString::to_string)));
    json!({
        "name": own.name,
        "coordinates": known(coordinates.collect()),
        "inputs": of(own, &mut own.inputs()),
        "constants": of(&prepared.model, &mut prepared.model.run_time_constants()),
        "parameters": of(own, &mut own.parameters()),
    })
}

/// A robot description as a model, with the values that it states.
pub(crate) fn imported(description: Named) -> Result<Value, Refusal> {
    let source = Source::new(description.name, description.text);
    let imported = import_description(&source, &Options::default())
        .map_err(|faults| Refusal(faults.render(&source).trim_end().to_owned()))?;
    let warnings = imported.warnings.iter().map(|warning| render(&source, warning).trim_end().to_owned());
    let remarks: Vec<String> = warnings.chain(imported.readings).collect();
    Ok(json!({ "model": imported.model, "known": imported.prior, "remarks": remarks }))
}
