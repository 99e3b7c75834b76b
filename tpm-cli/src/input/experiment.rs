//! Options and reading of models and experiments, for the verbs that play an experiment.

use crate::failure::Failure;
use crate::input::assignments::{assignment, once};
use crate::output::file;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_runtime::experiment::{Value, written_value};
use tpm_runtime::session::{DeclaredModel, ExperimentRequest, Session};

/// Options that choose and change an experiment.
#[derive(Clone, clap::Args)]
pub(crate) struct SimulatedArgs {
    /// Experiment on the simulated plant; the file of the model's name ending in .toml when not given.
    #[arg(long, value_name = "FILE")]
    pub(crate) experiment: Option<PathBuf>,
    /// Change a value of the experiment, such as seed=7 or plant.parameters.m=3.
    #[arg(long, value_name = "KEY=VALUE", value_parser = change)]
    pub(crate) set: Vec<(String, Value)>,
    /// The pattern to play on the simulated plant; the model's first when not given.
    #[arg(long, value_name = "NAME")]
    pub(crate) pattern: Option<String>,
}

impl SimulatedArgs {
    /// Reads the model and the experiment.
    pub(crate) fn session(&self, file: &Path) -> Result<Session, Failure> {
        Ok(Session::open(model(file)?, file, &self.request())?)
    }

    /// What is asked of the experiment.
    pub(crate) fn request(&self) -> ExperimentRequest {
        let mut request = ExperimentRequest::default();
        request.file.clone_from(&self.experiment);
        request.changes.clone_from(&self.set);
        request.pattern.clone_from(&self.pattern);
        request
    }
}

/// Parses KEY=VALUE, where the value is written as in an experiment file.
fn change(text: &str) -> Result<(String, Value), String> {
    assignment(text).map(|(key, value)| (key, written_value(&value)))
}

/// Reads a model file. Remarks about it go to standard error.
pub(crate) fn model(file: &Path) -> Result<DeclaredModel, Failure> {
    let model = DeclaredModel::open(file)?;
    let remarks = model.remarks();
    if !remarks.is_empty() {
        file::remark(&remarks);
    }
    Ok(model)
}

/// Options about physical parameters behind lumped ones.
#[derive(clap::Args)]
pub(crate) struct BoundArgs {
    /// Bounds of a physical parameter behind lumped ones, either side may be left out; kg and kg*m^2 are not negative unless said.
    #[arg(long, value_name = "NAME=LOW:HIGH", value_parser = bounds_assignment)]
    bound: Vec<(String, (f64, f64))>,
}

impl BoundArgs {
    /// Least and largest value by name.
    pub(crate) fn by_name(&self) -> Result<BTreeMap<String, (f64, f64)>, Failure> {
        once("--bound", &self.bound)
    }
}

fn bounds_assignment(text: &str) -> Result<(String, (f64, f64)), String> {
    let (name, interval) = assignment(text)?;
    let (low, high) = interval.split_once(':').ok_or_else(|| format!("`{interval}` is not of the form LOW:HIGH"))?;
    let side = |text: &str, open: f64| match text.trim() {
        "" => Ok(open),
        text => text.parse::<f64>().map_err(|_| format!("`{text}` is not a number")),
    };
    Ok((name, (side(low, f64::NEG_INFINITY)?, side(high, f64::INFINITY)?)))
}
