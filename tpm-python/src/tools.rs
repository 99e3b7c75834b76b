//! What comes before and after an identification: models that fit a log, models of robots, and what arms carry.

use crate::log::{Keywords, log_of, with_settings};
use crate::model::Model;
use crate::result::dictionary;
use crate::verdicts::stored;
use crate::words::{Error, Fault};
use crate::work::{Limit, detached};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_codegen::diagnostic::render;
use tpm_codegen::import::{Described, Imported, Options, import_description, with_included, with_inertials};
use tpm_codegen::source::Source;
use tpm_runtime::inertia::{InertiasRequest, LoadRequest};
use tpm_runtime::report::{MOST_TEXT, read_input};
use tpm_runtime::session;
use tpm_symbolic::mechanics::tree::mechanism::Loss;

/// A model that fits a log: the template's name, the machine, the text of the model, and the column of every signal.
type Proposal = (String, String, String, BTreeMap<String, String>);

/// Models to begin with that fit the columns of a log.
#[pyfunction]
pub(crate) fn proposals(py: Python<'_>, log: &Bound<'_, PyAny>, settings: Keywords<'_, '_>) -> PyResult<Vec<Proposal>> {
    let (request, time) = with_settings(log_of(log)?, settings)?;
    let found = detached(py, Limit::of(time), || Ok(session::inspect(request)?))?;
    let of = |own: &session::Proposal| {
        let name: String = own.template.name.split('_').map(capitalised).collect();
        let columns = own.signals.iter().map(|placed| (placed.signal.clone(), placed.column.clone()));
        (own.template.name.to_owned(), own.template.machine.to_owned(), own.model(&name), columns.collect())
    };
    Ok(session::proposals(&found).iter().map(of).collect())
}

fn capitalised(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// The text of a description, with the files that it includes.
fn description(path: &Path) -> Result<Source, Fault> {
    let read = |path: &Path| -> Result<Source, String> {
        let bytes = read_input(path, MOST_TEXT).map_err(|error| format!("cannot read {}: {error}", path.display()))?;
        Ok(Source::from_bytes(path.display().to_string(), bytes))
    };
    let folder = |path: &Path| path.parent().unwrap_or(Path::new("")).to_owned();
    let whole = with_included(read(path)?, |from, name| {
        let places = [folder(path).join(name), folder(Path::new(from)).join(name)];
        read(places.iter().find(|place| place.exists()).unwrap_or(&places[0]))
    });
    Ok(whole?)
}

/// The part of a description that is read.
fn part(base: Option<String>, tip: Option<String>, lock: Option<BTreeMap<String, f64>>) -> Options {
    let locked = lock.unwrap_or_default().into_iter().map(|(joint, value)| (joint, value.to_string())).collect();
    Options { base, tip, locked, ..Options::default() }
}

/// A robot's description as a model: the texts of model, prior and experiment, and what there is to say about them.
#[pyfunction]
pub(crate) fn import_description_of(
    py: Python<'_>,
    path: PathBuf,
    base: Option<String>,
    tip: Option<String>,
    lock: Option<BTreeMap<String, f64>>,
    losses: Option<Vec<String>>,
) -> PyResult<(String, String, String, Vec<String>)> {
    let mut options = part(base, tip, lock);
    if let Some(names) = losses {
        let mut chosen = Vec::with_capacity(names.len());
        for name in &names {
            match name.as_str() {
                "stribeck" => options.stribeck = true,
                "viscous" => chosen.push(Loss::Viscous),
                "coulomb" => chosen.push(Loss::Coulomb),
                "offset" => chosen.push(Loss::Offset),
                "rotor" => chosen.push(Loss::Rotor),
                _ => {
                    let known = "viscous, coulomb, offset, rotor, stribeck";
                    return Err(Error::new_err(format!(
                        "losses=[\"{name}\"]: give some of {known}, or none of them, []"
                    )));
                }
            }
        }
        options.losses = Some(chosen);
    }
    let read = || {
        let source = description(&path)?;
        let found = import_description(&source, &options);
        let Imported { model, prior, experiment, readings, warnings } =
            found.map_err(|faults| Fault::Input(faults.render(&source)))?;
        let said = warnings.iter().map(|warning| render(&source, warning).trim_end().to_owned()).chain(readings);
        Ok((model, prior, experiment, said.collect()))
    };
    detached(py, Limit::None, read)
}

/// The load of an arm from two results, without and with it, whose JSON is given.
#[pyfunction]
pub(crate) fn payload<'py>(
    py: Python<'py>,
    model: &Model,
    without: &str,
    with: &str,
    body: Option<&str>,
    density: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let (without, with) = (stored(without)?, stored(with)?);
    let request = LoadRequest { model: &model.declared, without: &without, with: &with, body, density };
    let found = detached(py, Limit::None, || {
        tpm_runtime::inertia::payload(&request).map_err(|fault| Fault::Input(fault.to_string()))
    })?;
    dictionary(py, &found)
}

/// Inertias that bodies can have, from the result of an arm, and its description with them: URDF alone holds them.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(crate) fn inertias<'py>(
    py: Python<'py>,
    model: &Model,
    result: &str,
    path: PathBuf,
    values: BTreeMap<String, f64>,
    weight: f64,
    base: Option<String>,
    tip: Option<String>,
    lock: Option<BTreeMap<String, f64>>,
) -> PyResult<(Bound<'py, PyDict>, Option<String>)> {
    let (result, options) = (stored(result)?, part(base, tip, lock));
    let found = || {
        let source = description(&path)?;
        let described = Described::read(&source, &options).map_err(|faults| Fault::Input(faults.render(&source)))?;
        let request =
            InertiasRequest { model: &model.declared, result: &result, described: &described, values: &values, weight };
        let found = tpm_runtime::inertia::inertias(&request).map_err(|fault| Fault::Input(fault.to_string()))?;
        let frictions = described.frictions_of_joints(&found.losses);
        let text = with_inertials(&source, &found.parted.links, &frictions).ok();
        Ok((found, text))
    };
    let (found, text) = detached(py, Limit::None, found)?;
    Ok((dictionary(py, &found)?, text))
}
