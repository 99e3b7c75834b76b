//! What any motion can show of a model's parameters, exactly, with a certificate that is checked before it is printed.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::assignment;
use crate::input::load::Loaded;
use crate::output::file;
use crate::render::combination::{not_counted, sum};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use tpm_symbolic::expr::graph::Coordinate;
use tpm_symbolic::number::rational;
use tpm_symbolic::regressor::base_parameters::{BaseParameters, Certificate, Motions, Rest, base_parameters, verify};

/// Random points of the check have other numbers for every seed; any will do.
const SEED: u64 = 1;

/// One base parameter: a parameter and what is lumped into it.
#[derive(serde::Serialize)]
struct Base {
    parameter: String,
    plus: BTreeMap<String, String>,
}

/// What `--json` prints.
#[derive(serde::Serialize)]
struct Report<'a> {
    schema: &'static str,
    model: &'a str,
    parameters: &'a [String],
    rank: usize,
    base: Option<&'a [Base]>,
    unobservable: Vec<String>,
    /// Nonlinear parameters, which are constants here.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    nonlinear: Vec<String>,
    certificate: &'a Certificate,
}

/// Prints the base parameters of a model under all motions, but for the coordinates that rest.
pub(super) fn run(loaded: &Loaded, rests: &[String], json: bool, output: Option<&Path>) -> Outcome {
    let prepared = loaded.prepared()?;
    let model = &prepared.model;
    let mut motions = Motions::default();
    for text in rests {
        let (name, value) = assignment(text).map_err(|reason| Failure::Input(format!("--rest {text}: {reason}")))?;
        let at = model.coordinates.iter().position(|coordinate| coordinate.name == name.as_str());
        let at = at.ok_or_else(|| Failure::Input(format!("--rest {text}: the model has no coordinate `{name}`")))?;
        let value = rational::parse(value.trim()).ok_or_else(|| {
            Failure::Input(format!("--rest {text}: the value is not a number such as 0, 1/3 or 0.25"))
        })?;
        motions.resting.insert(Coordinate(at as u32), Rest::Value(value));
    }
    let fault = |error: &dyn std::fmt::Display| loaded.at_whole(&error.to_string());
    let found = base_parameters(model, &prepared.form, &motions).map_err(|error| fault(&error))?;
    verify(model, &prepared.form, &motions, &found.certificate, SEED).map_err(|error| fault(&error))?;
    let base = named(&found);
    let left = unobservable(&found);
    let text = if json {
        file::json(&Report {
            schema: "tpm.base/1",
            model: &model.name,
            parameters: &found.parameters,
            rank: found.rank,
            base: base.as_deref(),
            unobservable: left.clone(),
            nonlinear: loaded.nonlinear(),
            certificate: &found.certificate,
        })?
    } else {
        describe(&found, base.as_deref(), &left) + &not_counted(&loaded.nonlinear())
    };
    file::emit(output, &text)?;
    if found.rank < found.parameters.len() {
        return Err(Failure::Incomplete(format!(
            "motions show {} combinations of {} parameters",
            found.rank,
            found.parameters.len()
        )));
    }
    Ok(())
}

/// The base parameters by name; nothing where their factors depend on constants without a value.
fn named(found: &BaseParameters) -> Option<Vec<Base>> {
    let name = |column: usize| found.parameters[column].clone();
    let base = found.base.as_ref()?.iter().map(|one| Base {
        parameter: name(one.column),
        plus: one.others.iter().map(|(column, factor)| (name(*column), rational::display(factor))).collect(),
    });
    Some(base.collect())
}

/// Parameters that no motion shows, in no combination.
fn unobservable(found: &BaseParameters) -> Vec<String> {
    let alone = |direction: &Vec<(usize, rational::Rational)>| match direction.as_slice() {
        [(column, _)] => Some(found.parameters[*column].clone()),
        _ => None,
    };
    found.certificate.directions.iter().flatten().filter_map(alone).collect()
}

fn describe(found: &BaseParameters, base: Option<&[Base]>, left: &[String]) -> String {
    let points = found.certificate.points.len();
    let mut text = format!(
        "rank {} of {} parameters under any motion (exact: a lower bound by {points} points modulo a prime, null vectors checked at fresh rational points)\n",
        found.rank,
        found.parameters.len()
    );
    if !left.is_empty() {
        let _ = writeln!(text, "no motion shows {}", left.join(", "));
    }
    match base {
        Some(base) => {
            text.push_str("\nbase parameters\n");
            for one in base {
                let rest = if one.plus.is_empty() { String::new() } else { format!(" + {}", sum(&one.plus)) };
                let _ = writeln!(text, "  {}{rest}", one.parameter);
            }
        }
        None => text.push_str("their factors depend on constants without a value\n"),
    }
    text
}
