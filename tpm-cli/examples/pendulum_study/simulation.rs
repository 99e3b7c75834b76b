//! The experiment on the pendulum hanging down, ready to be played on the simulated machine.

use super::failure::Failure;
use super::input::Input;
use super::machine::Machine;
use std::collections::BTreeMap;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::session::{DeclaredModel, Session};

/// A simulated machine with its experiment.
pub(super) struct Simulation {
    /// The experiment in the physical parameters of the model.
    pub(super) written: Experiment,
    /// Campaigns of the experiment, as the command line plays them.
    pub(super) session: Session,
}

impl Simulation {
    /// The experiment of a file on a machine; the machine's values replace those that the file gives the plant.
    ///
    /// # Errors
    ///
    /// The file is no experiment, it asks for motors, or it does not fit the model.
    pub(super) fn new(file: &Input, machine: &Machine, model_file: &Input) -> Result<Self, Failure> {
        let model = &machine.prepared.model;
        let mut written = Experiment::parse(file.text()?).map_err(|error| file.fault(error))?;
        if written.motors.is_some() {
            return Err(file.fault("the study is of a machine without motors"));
        }
        written.plant.parameters = machine.values(&model.parameters().collect::<Vec<_>>());
        written.constants = machine.values(&model.run_time_constants().collect::<Vec<_>>());
        let pattern = written.pattern.as_deref();
        machine.pattern(pattern).ok_or_else(|| match pattern {
            Some(name) => file.fault(format!("model {} has no pattern named `{name}`", model.name)),
            None => file.fault(format!("model {} has no pattern", model.name)),
        })?;
        let declared = DeclaredModel::parse("down", model_file.text()?).map_err(|error| model_file.fault(error))?;
        let session = Session::new(declared, written.clone(), None, BTreeMap::new())
            .map_err(|error| Failure::Input(error.to_string()))?;
        Ok(Self { written, session })
    }
}
