//! What the verbs that play an experiment on a simulated plant have in common.

use crate::failure::Failure;
use crate::input::assignments::assignment;
use crate::input::load::Loaded;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_runtime::experiment::{Experiment, ExperimentError};
use tpm_runtime::machine::actuator::MotorFile;
use tpm_runtime::session::Machine;
use tpm_symbolic::regressor::prepare::Prepared;

/// Options that choose and change an experiment.
#[derive(clap::Args)]
pub(crate) struct SimulatedArgs {
    /// Experiment on the simulated plant; the file of the model's name ending in .toml when not given.
    #[arg(long, value_name = "FILE")]
    pub(crate) experiment: Option<PathBuf>,
    /// Change a value of the experiment, such as seed=7 or plant.parameters.m=3.
    #[arg(long, value_name = "KEY=VALUE", value_parser = assignment)]
    pub(crate) set: Vec<(String, String)>,
    /// The pattern to play on the simulated plant; the model's first when not given.
    #[arg(long, value_name = "NAME")]
    pub(crate) pattern: Option<String>,
}

/// A model with an experiment that can be played on it.
pub(crate) struct Simulation {
    /// The model, and its parameters.
    pub(crate) symbolic: Prepared,
    /// The same as a machine that moves along the pattern.
    pub(crate) machine: Machine,
    /// The experiment with the changes, as it is written: in physical parameters, if these are given.
    pub(crate) written: Experiment,
    /// The same in the parameters that the model is linear in.
    pub(crate) experiment: Experiment,
}

impl SimulatedArgs {
    /// Reads the model and the experiment.
    pub(crate) fn prepare(&self, file: &Path) -> Result<Simulation, Failure> {
        self.within(file, &BTreeMap::new())
    }

    /// The same with bounds of physical parameters behind lumped ones.
    pub(crate) fn within(&self, file: &Path, bounds: &BTreeMap<String, (f64, f64)>) -> Result<Simulation, Failure> {
        let loaded = Loaded::from_file(file)?;
        let symbolic = loaded.prepared()?;
        let (written, motors) = self.experiment(file)?;
        let experiment = written.lumped(&symbolic);
        let name = self.pattern.as_deref().or(experiment.pattern.as_deref());
        let machine = Machine::new(&symbolic, loaded.pattern(name)?, &experiment, bounds)
            .map_err(|error| Failure::Input(error.to_string()))?;
        if let Some((path, motors)) = motors {
            experiment
                .check_motors(machine.plant(), &motors)
                .map_err(|fault| Failure::Input(format!("{}: {fault}", path.display())))?;
        }
        Ok(Simulation { symbolic, machine, written, experiment })
    }

    /// The experiment file that was named, or the one beside the model, and the file in which its motors stand.
    fn experiment(&self, file: &Path) -> Result<(Experiment, Option<(PathBuf, MotorFile)>), Failure> {
        let path = self.experiment.clone().unwrap_or_else(|| file.with_extension("toml"));
        if self.experiment.is_none() && !path.exists() {
            return Err(Failure::Input(format!(
                "there is no experiment {} beside the model; write one, or name another with --experiment FILE",
                path.display()
            )));
        }
        let text = std::fs::read_to_string(&path).map_err(|error| Failure::read(&path, error))?;
        let at = |error: ExperimentError| Failure::Input(format!("{}: {error}", path.display()));
        let mut experiment = Experiment::parse(&text).map_err(at)?;
        for (key, value) in &self.set {
            experiment.apply_override(key, value).map_err(|error| Failure::Input(error.to_string()))?;
        }
        let faulty = |path: &Path| {
            let path = path.to_owned();
            move |fault: tpm_runtime::machine::actuator::FileFault| {
                Failure::Input(format!("{}: {fault}", path.display()))
            }
        };
        let motors = match (&experiment.motors, experiment.motor_file().map(|beside| path.with_file_name(beside))) {
            (_, Some(beside)) => {
                let text = std::fs::read_to_string(&beside).map_err(|error| Failure::read(&beside, error))?;
                experiment.set_motors(&text).map_err(faulty(&beside))?;
                Some((beside.clone(), MotorFile::parse(&text).map_err(faulty(&beside))?))
            }
            (Some(_), None) => Some((path.clone(), MotorFile::within(&text).map_err(faulty(&path))?)),
            (None, None) => None,
        };
        Ok((experiment, motors))
    }
}
