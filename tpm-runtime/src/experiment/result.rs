//! From an experiment on a simulated machine to the reported result.

use super::{Experiment, ExperimentError};
use crate::estimate::{Estimate, Status};
use crate::harmonics::Hold;
use crate::model::Model;
use crate::procedure::{Campaign, Outcome, RunReport};
use crate::report::{EstimateReport, ParameterReport};
use crate::simulate::simulate;
use crate::trajectory::Pattern;
use serde::Serialize;
use std::collections::BTreeMap;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

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
    /// What the user should know.
    pub warnings: Vec<String>,
    /// The estimate itself, for further computation; nothing when no run was accepted.
    #[serde(skip)]
    pub estimate: Option<Estimate>,
}

impl CampaignIdentification {
    /// Everything that was asked for was identified and the campaign ended as planned.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        let identified =
            self.parameters.iter().all(|p| p.status == Status::Identified.name() || p.status == Status::Frozen.name());
        identified && self.estimate.is_some() && self.outcome.is_some_and(Outcome::is_normal)
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
    let bench = experiment.bench(model)?;
    let mut campaign = Campaign::new(model, experiment.setup(model, pattern, Hold::Zoh)?)?;
    while let Some(trial) = campaign.next() {
        let record = simulate(model, &bench, trial)?;
        if !progress(campaign.submit(&record)?) {
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
    let EstimateReport { parameters, unobservable, covariance } = EstimateReport::new(model, &setup.prior, estimate);
    CampaignIdentification {
        schema: "tpm.identification/1",
        model: model.name().into(),
        estimator: setup.method.name(),
        outcome: campaign.outcome(),
        seed,
        hold: setup.procedure.hold.to_string(),
        harmonics: campaign.runs().iter().rev().find_map(|run| run.harmonics).unwrap_or(0),
        parameters,
        physical: Vec::new(),
        unobservable,
        covariance,
        rank: estimate.map_or(0, |e| e.rank),
        condition: estimate.map(|e| e.condition).filter(|c| c.is_finite()),
        residual: estimate.map_or(0.0, |e| e.residual),
        runs: campaign.runs().to_vec(),
        warnings: warnings(model, campaign),
        estimate: estimate.cloned(),
    }
}

fn warnings(model: &dyn Model<f64>, campaign: &Campaign<'_>) -> Vec<String> {
    let mut warnings = Vec::new();
    for run in campaign.runs() {
        match run.ending {
            "complete" => {}
            "unsettled" => {
                warnings.push(format!("run {}: the motion had not settled; it was played again for longer", run.run))
            }
            _ => warnings.push(format!("run {}: aborted ({}), amplitudes reduced", run.run, run.ending)),
        }
    }
    if let Some(outcome) = campaign.outcome().filter(|outcome| !outcome.is_normal()) {
        warnings.push(format!("the campaign ended early: {}", outcome.describe()));
    }
    match campaign.estimate() {
        None => warnings.push("no run was accepted; nothing is identified".to_string()),
        Some(estimate) => {
            for (j, status) in estimate.status.iter().enumerate() {
                let name = model.parameter(j).name;
                match status {
                    Status::Unobservable => warnings.push(format!("{name} is not visible in these runs")),
                    Status::PoorlyDetermined => warnings.push(format!("{name} is poorly determined")),
                    Status::Identified | Status::Frozen => {}
                }
            }
        }
    }
    warnings
}
