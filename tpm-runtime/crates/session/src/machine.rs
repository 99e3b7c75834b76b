//! A model as a machine: the machine's own equations for plant, reference and feed-forward, and the form that is
//! identified.
//!
//! Invariant: the plant's parameters are those of the model's own equations. With coordinates eliminated, these are the
//! physical parameters behind the lumped ones, and the estimator estimates them.

use crate::error::{MachineError, SessionError};
use crate::identification::{Identification, Source};
use crate::model::with_all_coordinates;
use crate::play::{Watch, play_on_simulated};
use crate::summary;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};
use tpm_campaign::{Campaign, RunReport, Store};
use tpm_estimate::{Method, Weights};
use tpm_experiment::{Equations, Experiment, ExperimentError, StageSection};
use tpm_interpret::{Interpreted, InterpretedDerivatives};
use tpm_motion::trajectory::ReferencePattern;
use tpm_physical::{Eliminated, PatternTables, PhysicalSettings};
use tpm_plant::stability::LoopStability;
use tpm_symbolic::regressor::prepare::Prepared;

/// A model as a machine.
#[derive(Clone, Debug)]
pub struct Machine {
    plant: Interpreted,
    pattern: ReferencePattern,
    eliminated: Option<Arc<Eliminated>>,
    /// The plant's equations in exact form.
    source: Prepared,
    /// Exact tables of the plant under its patterns, made when an estimator first needs them.
    tables: OnceLock<Arc<PatternTables>>,
}

impl Machine {
    /// The machine of a model that moves along one of its patterns, with the experiment's constants and prior. `bounds`
    /// are bounds on the physical parameters behind lumped ones.
    ///
    /// # Errors
    /// [`MachineError`] when the model, its pattern or the experiment's values do not give a machine.
    pub fn new(
        prepared: &Prepared,
        pattern: &tpm_symbolic::mechanics::pattern::Pattern,
        experiment: &Experiment,
        bounds: &BTreeMap<String, (f64, f64)>,
    ) -> Result<Self, MachineError> {
        let whole = &*with_all_coordinates(prepared)?;
        if let Some(own) = whole.model.coordinates.iter().find(|coordinate| coordinate.unmeasured) {
            return Err(MachineError::Unmeasured { coordinate: own.name.clone() });
        }
        if let Some(own) = whole.model.coordinates.iter().find(|coordinate| coordinate.presliding.is_some()) {
            return Err(MachineError::BuildsUp { coordinate: own.name.clone() });
        }
        whole.require_inputs_alone().map_err(MachineError::Inputs)?;
        let plant = Interpreted::new(&whole.model, &whole.form);
        let constant = |name: &str| experiment.constants.get(name).copied();
        let of_rows = |pattern| tpm_interpret::pattern::of_rows(pattern, &whole.model, &whole.form, constant);
        let mut others = Vec::new();
        for other in prepared.model.patterns.iter().filter(|other| other.name.is_some() && other.name != pattern.name) {
            let named = |stage: &StageSection| {
                let strokes = stage.strokes.iter().map(|stroke| &stroke.pattern);
                strokes.chain([&stage.pattern]).any(|pattern| pattern.as_deref() == other.name.as_deref())
            };
            match of_rows(other) {
                Ok(other) => others.push(other),
                Err(fault) if experiment.schedule.stages.iter().any(named) => return Err(fault.into()),
                // The pattern needs a value that this experiment does not state, and no stage plays it.
                Err(_) => {}
            }
        }
        let pattern = ReferencePattern { others, ..of_rows(pattern)? };
        let eliminated = if prepared.model.eliminations.is_empty() {
            None
        } else {
            let settings = PhysicalSettings::of(experiment, bounds);
            Some(Arc::new(Eliminated::new(prepared, &plant, &settings)?))
        };
        Ok(Machine { plant, pattern, eliminated, source: whole.clone(), tables: OnceLock::new() })
    }

    /// Exact derivatives of the plant's rows.
    pub(super) fn derivatives(&self) -> InterpretedDerivatives {
        InterpretedDerivatives::new(&self.source.model, &self.source.form)
    }

    /// The plant: the machine's own equations.
    #[must_use]
    pub const fn plant(&self) -> &Interpreted {
        &self.plant
    }

    /// The pattern of the motion. Coordinates that the model's pattern leaves open are open here too.
    #[must_use]
    pub const fn pattern(&self) -> &ReferencePattern {
        &self.pattern
    }

    /// The form with coordinates eliminated, when there is one.
    #[must_use]
    pub fn eliminated(&self) -> Option<&Eliminated> {
        self.eliminated.as_deref()
    }

    /// The campaign of an experiment on this machine before its first run, and what its loop was found to be.
    ///
    /// # Errors
    /// [`ExperimentError`] when the loop is not stable, or the campaign cannot begin.
    pub fn campaign(&self, experiment: &Experiment) -> Result<(Campaign<'_>, LoopStability), ExperimentError> {
        // The drive of a real machine holds its input between samples as the simulated one does.
        let (setup, stability) = experiment.stable_setup(&self.plant, &self.pattern)?;
        let campaign = match &self.eliminated {
            Some(form) if setup.method == Method::MeasuredMotion && experiment.equations == Equations::Eliminated => {
                if setup.estimation.weights == Weights::Equal {
                    return Err(ExperimentError::Weights);
                }
                let estimator = form.estimator(&setup.estimation);
                Campaign::with_estimator(&self.plant, setup, estimator)
            }
            // The rows are those of the measured motion, which need no table.
            _ if setup.method == Method::MeasuredMotion => Campaign::new(&self.plant, setup),
            _ => {
                let made = || Arc::new(PatternTables::new(&self.source, &self.plant, &self.pattern));
                let table = Arc::clone(self.tables.get_or_init(made));
                let estimator = setup.method.estimator_with(&setup.estimation, Some(table));
                Campaign::with_estimator(&self.plant, setup, estimator)
            }
        };
        Ok((campaign?, stability))
    }

    /// Plays an experiment's campaign on its simulated machine, when the loop is stable, and gives the parameters that
    /// the estimator estimates; a [`Session`](crate::Session) adds the physical ones behind lumped ones.
    /// `progress` sees every run as it ends and says whether to go on.
    ///
    /// # Errors
    /// [`SessionError`] when the loop is not stable, or the experiment, a run or the estimation fails.
    pub fn identify(
        &self,
        experiment: &Experiment,
        progress: &mut dyn FnMut(&RunReport) -> bool,
    ) -> Result<Identification, SessionError> {
        self.identify_watched(experiment, None, &mut |_, _, run| progress(run))
    }

    /// Plays an experiment's campaign as [`identify`](Self::identify) does, and also hands out the samples of every
    /// run. Runs that a store holds are taken from it, and new runs are added to it as they end.
    ///
    /// # Errors
    /// [`SessionError`] when the loop is not stable, or the experiment, a run, the estimation or the store fails.
    pub fn identify_watched(
        &self,
        experiment: &Experiment,
        store: Option<&Store>,
        watch: &mut Watch<'_>,
    ) -> Result<Identification, SessionError> {
        let (campaign, stability) = self.campaign(experiment)?;
        let played = play_on_simulated(&self.plant, experiment, campaign, store, watch)?;
        Ok(summary::of_campaign(&played, stability, Source::SimulatedPlant, experiment.seed))
    }
}
