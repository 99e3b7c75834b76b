//! The one result of every identification.

use crate::log_report::{LogReport, PoolReport};
use crate::meaning::Severity;
use crate::method_report::MethodReport;
use crate::refinement_report::{MissingTerm, RefinementReport};
use crate::warning::Warning;
use serde::ser::SerializeSeq as _;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use tpm_campaign::{Advice, Outcome, RunReport};
use tpm_codegen::identified::{Identified, IdentifiedCombination, IdentifiedParameter, Weights};
use tpm_controller::harmonics::Hold;
use tpm_estimate::named::EstimateReport;
use tpm_estimate::{CombinationReport, Estimate, LARGE_RESIDUAL, Method, ParameterReport, ResidualOf, Status};
use tpm_plant::actuator::LimitUse;
use tpm_plant::stability::LoopStability;

pub use tpm_codegen::identified::{READABLE_SCHEMAS, SCHEMA};

/// Where the data of an identification come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// One log of a machine.
    Log,
    /// Runs that were played on a simulated machine.
    SimulatedPlant,
    /// Runs that were played on whatever stands behind a [`Bench`](tpm_motion::Bench).
    Machine,
    /// Runs that are kept in a campaign's folder.
    Folder,
}

/// What has to be the same for a result to come out the same again.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Provenance {
    /// Name and version of the program.
    pub tool: String,
    /// Fingerprint of the model's text; nothing for a model without one.
    pub model: Option<String>,
    /// Fingerprint of the experiment with all changes; nothing for a log.
    pub experiment: Option<String>,
    /// Every log, or every kept run, with its fingerprint.
    pub logs: Vec<LogFingerprint>,
    /// Seed of the simulated noise; nothing for data of a machine.
    pub seed: Option<u64>,
    /// What was asked for, by name.
    pub options: BTreeMap<String, serde_json::Value>,
}

/// A file, and what tells it from others.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LogFingerprint {
    /// The file.
    pub path: String,
    /// Fingerprint of its bytes.
    pub hash: String,
}

/// Identified parameters, and everything that is known about them; serialises as `tpm.identification/2`.
///
/// Invariant: an unobservable parameter has neither value nor deviation, and rows and columns of the covariance that belong to it
/// are empty; where stated priors tell it they stand apart, in [`with_prior`](ParameterReport::with_prior). Values are in the units of
/// the model.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Identification {
    /// Where the data come from.
    pub source: Source,
    /// Name of the model.
    pub model: String,
    /// The estimator.
    pub estimator: Method,
    /// Name of the frequency in the model's pattern; empty for a log. Not serialised.
    pub frequency_name: String,
    /// Why the campaign ended; nothing for a log, and while a campaign goes on.
    pub outcome: Option<Outcome>,
    /// The limit that ended the campaign, when one did.
    pub stop: Option<LimitUse>,
    /// Which limit to raise for the parameter that is known least, where a campaign chose its motions.
    pub advice: Option<Advice>,
    /// Seed of the experiment; nothing for a log.
    pub seed: Option<u64>,
    /// What the inputs do between samples.
    pub hold: Hold,
    /// Highest harmonic used (of the last run, in a campaign).
    pub harmonics: usize,
    /// Parameters in which the model is linear.
    pub parameters: Vec<ParameterReport>,
    /// Physical parameters, where parameters were lumped.
    pub physical: Vec<ParameterReport>,
    /// Directions that the data do not show: parameter to weight.
    pub unobservable: Vec<BTreeMap<String, String>>,
    /// What the data do show of the unobservable parameters.
    pub combinations: Vec<CombinationReport>,
    /// Covariance of the parameters; nothing where unobservable.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// Covariance of every combination with all parameters, nothing where unobservable, and then with all combinations.
    pub combination_covariance: Vec<Vec<Option<f64>>>,
    /// Covariance of the physical parameters; nothing where unobservable or held at a bound.
    pub physical_covariance: Vec<Vec<Option<f64>>>,
    /// Independent combinations of the parameters that the data show.
    pub rank: usize,
    /// Directions in parameter space that no motion shows, known beforehand: no rank can be larger than what they leave.
    pub invisible: usize,
    /// Condition number of the scaled equations; nothing when nothing is observable.
    pub condition: Option<f64>,
    /// Root mean square of what is not explained, as a share: of the force; where it was refined by a simulation, of the motion or of the
    /// inputs, whichever is larger.
    pub residual: f64,
    /// What the residual is a share of.
    pub residual_of: ResidualOf,
    /// The runs of a campaign; none for a log.
    pub runs: Vec<RunReport>,
    /// Poles of the closed loop, and what was found over the stated ranges, before the first run.
    pub stability: Option<LoopStability>,
    /// What a simulation along the runs of a campaign did to the estimates; nothing for a log, whose own report has it, and where nothing
    /// was simulated.
    pub refinement: Option<RefinementReport>,
    /// How a campaign came to its parameters, where that was asked for.
    pub method: Option<MethodReport>,
    /// What was found about the log; nothing for a campaign, or where there are several logs.
    pub log: Option<LogReport>,
    /// What was found about several logs that were used together; nothing for one.
    pub pool: Option<PoolReport>,
    /// The text of the model with the forces that it lacks on the logs, where these make it better on parts of a log from which its values were
    /// not taken.
    pub completed_model: Option<String>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// What has to be the same for the result to come out the same again.
    pub provenance: Provenance,
    /// What the next feed-forward would use: the estimate, and along directions that the data do not show the prior, or zero where
    /// none was stated. Not serialised, since it is no result along these directions.
    pub current: Vec<f64>,
    /// The estimate itself, for further computation; nothing when no run was accepted. Not serialised.
    pub estimate: Option<Estimate>,
    /// Why this is not all that was asked for, as the result was judged; nothing when it is.
    pub(super) shortfall: Option<String>,
}

impl Identification {
    /// The result with what another estimate tells of the parameters.
    pub(super) fn telling(mut self, told: EstimateReport) -> Self {
        self.tell(told);
        self
    }

    /// Takes what another estimate tells of the parameters.
    pub(super) fn tell(&mut self, told: EstimateReport) {
        let EstimateReport { parameters, unobservable, combinations, covariance, combination_covariance } = told;
        (self.parameters, self.unobservable, self.combinations) = (parameters, unobservable, combinations);
        (self.covariance, self.combination_covariance) = (covariance, combination_covariance);
    }

    /// Whether everything that was asked for was identified by a model that explains the data, and a campaign ended as planned.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.shortfall.is_none()
    }

    /// How many independent combinations of the parameters were to be identified: all that some motion shows, but those that were held.
    #[must_use]
    pub fn wanted(&self) -> usize {
        let free = self.parameters.iter().filter(|parameter| parameter.status != Status::Frozen).count();
        free.saturating_sub(self.invisible)
    }

    /// Whether the model explains what was measured: the residual is not above [`LARGE_RESIDUAL`].
    #[must_use]
    pub fn is_explained(&self) -> bool {
        self.residual <= LARGE_RESIDUAL
    }

    /// Terms that the runs of a campaign show the model to lack: those that a simulation names, and otherwise those of the findings.
    #[must_use]
    pub fn missing_of_runs(&self) -> Vec<&MissingTerm> {
        match &self.refinement {
            Some(simulated) if !simulated.missing.is_empty() => simulated.missing.iter().collect(),
            _ => (self.warnings.iter())
                .filter_map(|warning| if let Warning::MissingTerm { term } = warning { Some(term) } else { None })
                .collect(),
        }
    }

    /// Adds a parameter whose value was known, behind the others.
    pub(super) fn add_known(&mut self, parameter: ParameterReport) {
        let count = self.parameters.len();
        self.parameters.push(parameter);
        for row in &mut self.covariance {
            row.push(Some(0.0));
        }
        self.covariance.push(vec![Some(0.0); count + 1]);
        for row in &mut self.combination_covariance {
            row.insert(count, Some(0.0));
        }
    }

    /// Why this is not all that was asked for; nothing when it is.
    #[must_use]
    pub fn shortfall(&self) -> Option<String> {
        self.shortfall.clone()
    }
}

/// Serialised: what the fields say, `warnings` as the texts that people read, and `findings` as the same warnings with their numbers
/// and remedies.
#[derive(Serialize)]
struct Form<'a> {
    schema: &'static str,
    source: Source,
    model: &'a str,
    estimator: &'static str,
    outcome: Option<Outcome>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stop: Option<&'a LimitUse>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<&'a Advice>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
    hold: String,
    harmonics: usize,
    parameters: &'a [ParameterReport],
    physical: &'a [ParameterReport],
    unobservable: &'a [BTreeMap<String, String>],
    combinations: &'a [CombinationReport],
    covariance: &'a [Vec<Option<f64>>],
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    combination_covariance: &'a [Vec<Option<f64>>],
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    physical_covariance: &'a [Vec<Option<f64>>],
    rank: usize,
    condition: Option<f64>,
    residual: f64,
    #[serde(skip_serializing_if = "ResidualOf::is_force")]
    residual_of: ResidualOf,
    #[serde(skip_serializing_if = "Option::is_none")]
    shortfall: Option<&'a str>,
    runs: &'a [RunReport],
    #[serde(skip_serializing_if = "Option::is_none")]
    stability: Option<&'a LoopStability>,
    #[serde(skip_serializing_if = "Option::is_none")]
    refinement: Option<&'a RefinementReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    method: Option<&'a MethodReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    log: Option<&'a LogReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pool: Option<&'a PoolReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    completed_model: Option<&'a str>,
    warnings: Vec<String>,
    findings: Findings<'a>,
    provenance: &'a Provenance,
}

struct Findings<'a>(&'a [Warning]);

impl Serialize for Findings<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Finding<'a> {
            #[serde(flatten)]
            warning: &'a Warning,
            severity: Severity,
            #[serde(skip_serializing_if = "Option::is_none")]
            remedy: Option<tpm_report::Remedy>,
        }
        let mut list = serializer.serialize_seq(Some(self.0.len()))?;
        for warning in self.0 {
            list.serialize_element(&Finding {
                warning,
                severity: warning.meaning().severity,
                remedy: warning.remedy(),
            })?;
        }
        list.end()
    }
}

impl Serialize for Identification {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Form {
            schema: SCHEMA,
            source: self.source,
            model: &self.model,
            estimator: self.estimator.name(),
            outcome: self.outcome,
            stop: self.stop.as_ref(),
            advice: self.advice.as_ref(),
            seed: self.seed,
            hold: self.hold.to_string(),
            harmonics: self.harmonics,
            parameters: &self.parameters,
            physical: &self.physical,
            unobservable: &self.unobservable,
            combinations: &self.combinations,
            covariance: &self.covariance,
            combination_covariance: &self.combination_covariance,
            physical_covariance: &self.physical_covariance,
            rank: self.rank,
            condition: self.condition,
            residual: self.residual,
            residual_of: self.residual_of,
            shortfall: self.shortfall.as_deref(),
            runs: &self.runs,
            stability: self.stability.as_ref(),
            refinement: self.refinement.as_ref(),
            method: self.method.as_ref(),
            log: self.log.as_ref(),
            pool: self.pool.as_ref(),
            completed_model: self.completed_model.as_deref(),
            warnings: self.warnings.iter().map(ToString::to_string).collect(),
            findings: Findings(&self.warnings),
            provenance: &self.provenance,
        }
        .serialize(serializer)
    }
}

/// What the result knows of the parameters, as the verbs that compute with it read it.
impl From<&Identification> for Identified {
    fn from(result: &Identification) -> Self {
        let parameter = |report: &ParameterReport| IdentifiedParameter {
            name: report.name.clone(),
            value: report.value,
            std: report.std,
            prior: report.prior,
            with_prior: report.with_prior,
            status: report.status.name().to_string(),
        };
        // Weights are printed numbers.
        let weights = |terms: &BTreeMap<String, String>| -> Weights {
            terms.iter().filter_map(|(name, weight)| Some((name.clone(), weight.parse().ok()?))).collect()
        };
        let combination = |shown: &CombinationReport| IdentifiedCombination {
            terms: weights(&shown.terms),
            value: shown.value,
            std: shown.std,
        };
        let prediction = result.log.as_ref().and_then(|log| log.prediction());
        Identified {
            model: result.model.clone(),
            parameters: result.parameters.iter().map(parameter).collect(),
            physical: result.physical.iter().map(parameter).collect(),
            directions: result.unobservable.iter().map(weights).collect(),
            combinations: result.combinations.iter().map(combination).collect(),
            covariance: result.covariance.clone(),
            combination_covariance: result.combination_covariance.clone(),
            nearest: prediction.map_or_else(Vec::new, |prediction| prediction.stated.values.clone()),
            delays: prediction.map_or_else(BTreeMap::new, |prediction| prediction.delays.clone()),
        }
    }
}
