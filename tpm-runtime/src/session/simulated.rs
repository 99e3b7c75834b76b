//! From an experiment on a simulated machine to the reported result.

use crate::campaign::Store;
use crate::campaign::{Campaign, Outcome, RunReport};
use crate::estimate::named::{CombinationReport, EstimateReport, ParameterReport, doubts};
use crate::estimate::{Estimate, LARGE_RESIDUAL, Status, no_result};
use crate::experiment::{Experiment, ExperimentError};
use crate::machine::actuator::LimitUse;
use crate::machine::simulated::simulate;
use crate::machine::stability::LoopStability;
use crate::run::trajectory::Pattern;
use crate::run::{Record, RunEnding, Trial};
use serde::Serialize;
use std::collections::BTreeMap;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;
use tpm_core::model::Model;

/// The result of a campaign; serialises as `tpm.identification/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CampaignIdentification {
    /// `tpm.identification/1`.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// The estimator.
    pub estimator: &'static str,
    /// Why the campaign ended.
    pub outcome: Option<Outcome>,
    /// The limit that ended it, when one did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<LimitUse>,
    /// Seed of the simulated noise.
    pub seed: u64,
    /// Hold of the inputs: none or zoh.
    pub hold: String,
    /// Highest harmonic used in the last run.
    pub harmonics: usize,
    /// Parameters in which the model is linear.
    pub parameters: Vec<ParameterReport>,
    /// Physical parameters, where parameters were lumped.
    pub physical: Vec<ParameterReport>,
    /// Directions that the runs do not show: parameter to weight.
    pub unobservable: Vec<BTreeMap<String, String>>,
    /// What the runs do show of the unobservable parameters.
    pub combinations: Vec<CombinationReport>,
    /// Covariance of the parameters; nothing where unobservable.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// Independent combinations that the runs show.
    pub rank: usize,
    /// Condition number of the scaled equations; nothing when nothing is observable.
    pub condition: Option<f64>,
    /// Residual as a share of the force.
    pub residual: f64,
    /// The runs.
    pub runs: Vec<RunReport>,
    /// Poles of the closed loop, and what was found over the stated box, before the first run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stability: Option<LoopStability>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// What the next feed-forward would use: the estimate, and the prior along directions that the runs do not show.
    #[serde(skip)]
    pub current: Vec<f64>,
    /// The estimate itself, for further computation; nothing when no run was accepted.
    #[serde(skip)]
    pub estimate: Option<Estimate>,
}

impl CampaignIdentification {
    /// Everything that was asked for was identified, the model explains what was measured, and the campaign ended as planned.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        // Where there are physical parameters the lumped ones are means to an end.
        let wanted = if self.physical.is_empty() { &self.parameters } else { &self.physical };
        let identified =
            wanted.iter().all(|p| p.status == Status::Identified.name() || p.status == Status::Frozen.name());
        identified && self.is_explained() && self.estimate.is_some() && self.outcome.is_some_and(Outcome::is_normal)
    }

    /// Whether the model explains what was measured: the residual is not above [`LARGE_RESIDUAL`].
    #[must_use]
    pub fn is_explained(&self) -> bool {
        self.residual <= LARGE_RESIDUAL
    }

    /// Why it is not [complete](Self::is_complete).
    #[must_use]
    pub fn shortfall(&self) -> String {
        match self.outcome {
            None => "not everything was identified: the campaign is not finished".to_string(),
            Some(_) if !self.is_explained() => no_result(self.residual),
            Some(outcome) => format!("not everything was identified: {}", outcome.describe()),
        }
    }
}

/// Runs an experiment's campaign on its simulated machine. `progress` sees every run as it ends and says whether to go on.
///
/// # Errors
/// [`ExperimentError`].
pub fn identify_simulated(
    model: &dyn Model<f64>,
    pattern: &Pattern,
    experiment: &Experiment,
    progress: &mut dyn FnMut(&RunReport) -> bool,
) -> Result<CampaignIdentification, ExperimentError> {
    let (setup, stability) = experiment.stable_setup(model, pattern)?;
    let mut result =
        play_campaign(model, Campaign::new(model, setup)?, experiment, None, &mut |_, _, run| progress(run))?;
    result.stability = Some(stability);
    Ok(result)
}

/// Sees every run as it ends, with what was played and recorded, and says whether to go on.
pub type Watch<'a> = dyn FnMut(&Trial, &Record, &RunReport) -> bool + 'a;

/// Plays a campaign on the experiment's simulated machine, which obeys `model`, or is named in the experiment. Runs that a store holds are
/// taken from it, and new ones are kept there as they end.
///
/// # Errors
/// [`ExperimentError`].
pub fn play_campaign(
    model: &dyn Model<f64>,
    mut campaign: Campaign<'_>,
    experiment: &Experiment,
    store: Option<&Store>,
    watch: &mut Watch<'_>,
) -> Result<CampaignIdentification, ExperimentError> {
    let other = experiment.other_plant(model)?;
    let plant = other.as_ref().map_or(model, |arm| arm as &dyn Model<f64>);
    let finished = store.map_or_else(|| Ok(Vec::new()), |store| store.records(model))?;
    let mut finished = finished.into_iter();
    while let Some(trial) = campaign.next().cloned() {
        let (record, is_new) = match finished.next() {
            Some(record) => (record, false),
            None => (simulate(plant, &experiment.bench_in_run(model, trial.run)?, &trial)?, true),
        };
        let report = campaign.submit(&record)?;
        // A run in which a sensor dropped out is no finished run: it is played again when the campaign goes on.
        let whole = report.ending != RunEnding::SensorLost;
        let go_on = watch(&trial, &record, report);
        if let Some(store) = store.filter(|_| is_new && whole) {
            store.append(model, &trial, &record, Some(experiment.seed))?;
        }
        if !go_on {
            break;
        }
    }
    Ok(summary(model, &campaign, experiment.seed))
}

/// The result of a campaign so far.
#[must_use]
pub fn summary(model: &dyn Model<f64>, campaign: &Campaign<'_>, seed: u64) -> CampaignIdentification {
    let estimate = campaign.estimate();
    let setup = campaign.setup();
    let own = EstimateReport::new(model, &setup.prior, estimate);
    // With coordinates eliminated the machine's parameters are the physical ones behind lumped ones.
    let (linear, found, report, physical) = match campaign.estimator().lumped() {
        Some((lumped, found)) => (lumped, Some(found), EstimateReport::new(lumped, &[], Some(found)), own.parameters),
        None => (model, estimate, own, Vec::new()),
    };
    let EstimateReport { parameters, unobservable, combinations, covariance } = report;
    CampaignIdentification {
        schema: "tpm.identification/1",
        model: model.name().into(),
        estimator: setup.method.name(),
        outcome: campaign.outcome(),
        stop: campaign.stop().cloned(),
        seed,
        hold: setup.procedure.hold.to_string(),
        harmonics: campaign.runs().iter().rev().find_map(|run| run.harmonics).unwrap_or(0),
        parameters,
        physical,
        unobservable,
        combinations,
        covariance,
        rank: found.map_or(0, |e| e.rank),
        condition: found.map(|e| e.condition).filter(|c| c.is_finite()),
        residual: found.map_or(0.0, |e| e.residual),
        runs: campaign.runs().to_vec(),
        stability: None,
        warnings: warnings(linear, found, campaign),
        current: campaign.current().to_vec(),
        estimate: estimate.cloned(),
    }
}

fn warnings(model: &dyn Model<f64>, estimate: Option<&Estimate>, campaign: &Campaign<'_>) -> Vec<String> {
    let mut warnings = Vec::new();
    for run in campaign.runs() {
        match run.ending {
            RunEnding::Complete => {}
            RunEnding::Unsettled => {
                warnings.push(format!("run {}: the motion had not settled; it was played again for longer", run.run))
            }
            RunEnding::SensorLost => {
                warnings.push(format!("run {}: a sensor gave no value; the run is not used", run.run));
            }
            RunEnding::TrackingBound | RunEnding::Diverged => {
                warnings.push(format!("run {}: aborted ({}), amplitudes reduced", run.run, run.ending))
            }
        }
    }
    for run in campaign.runs() {
        if let Some(mode) = &run.near_mode {
            warnings.push(format!(
                "run {}: harmonic {} of {} ({:.4} rad/s) lies near a natural mode of the machine ({:.4} rad/s): choose another frequency, or its vibration is measured",
                run.run,
                mode.harmonic,
                mode.signal,
                f64::from(mode.harmonic) * run.frequency,
                mode.frequency
            ));
        }
    }
    if let Some(outcome) = campaign.outcome().filter(|outcome| !outcome.is_normal()) {
        let stop = campaign.stop().map(|stop| format!(": {stop}")).unwrap_or_default();
        warnings.push(format!("the campaign ended early: {}{stop}", outcome.describe()));
    }
    let plant = campaign.model();
    for (i, mounted) in campaign.setup().procedure.motors.iter().enumerate() {
        if let Some(mounted) = mounted.filter(|mounted| mounted.motor.rotor_inertia > 0.0) {
            let (input, moved) = (plant.input(i).name, plant.coordinate(mounted.coordinate).name);
            warnings.push(format!(
                "what is identified of {moved}'s inertia contains the rotor on {input}, {:.4e} in its unit: leave rotor_inertia out where these values meet this motor",
                mounted.motor.rotor_inertia * mounted.motor.ratio.powi(2)
            ));
        }
    }
    match estimate {
        None => warnings.push("no run was accepted; nothing is identified".to_string()),
        Some(estimate) => {
            warnings.extend(estimate.unexplained());
            warnings.extend(doubts(model, estimate, "these runs"));
        }
    }
    warnings.extend_from_slice(campaign.estimator().warnings());
    warnings
}
