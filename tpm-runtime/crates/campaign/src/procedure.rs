//! The campaign: a state machine that plans the next trial and updates the estimates from its record.
//!
//! Invariant: [`Campaign::next`] depends on the settings and on the records submitted so far, in their order, and on nothing
//! else; whoever submits the same records gets the same trials and the same estimates, whether they come from a simulation or
//! from a machine. Estimates only change by a record that was accepted.
//!
//! A stage is one amplitude and frequency (Feng, chapter 3, steps 1-5): play, let it settle, measure whole periods, update,
//! repeat until the update no longer changes anything (or the tracking error's harmonics are small enough), then grow.

use crate::cut::cut_by_noise;
use crate::harmonics::RunHarmonics;
use crate::information::LEAST_NOISE;
use crate::modes::{NearMode, near_mode};
use crate::plan::{Advice, Choice, Scene, Seen, extent, larger, noise_fed_back};
use crate::refinement::{OneRun, Refinement};
use crate::settling::settled_from;
use crate::setup::{LEAST_PERIODS, Setup, Stage};
use crate::steady::SteadyRun;
use num_complex::Complex;
use serde::Serialize;
use tpm_controller::control::Gain;
use tpm_controller::model::{Dims, Model};
use tpm_estimate::{Alone, Combination, Estimate, EstimateError, Estimator, Run, Status};
use tpm_motion::{
    Ending, Record, RecordError, RunEnding, Spectra, SpectrumError, Trial, TrialError, TrialSettings,
    correct_actuators, held,
};
use tpm_numerics::fourier::analyse;
use tpm_numerics::{alarm, root_mean_square};
use tpm_plant::actuator::{Demand, LimitUse, Limited, requirements, strongest};

/// Fewest samples per period on which the demand on the motors is computed.
const LEAST_PLANNED_SAMPLES: usize = 256;
/// Highest harmonic of force and motion that is compared with the limits of motors and actuators, as a multiple of the
/// reference's highest harmonic.
const MOTOR_REACH: usize = 4;
/// Factors on the frequency of a stage, tried in this order where a harmonic of the stage lies near a natural mode. All
/// are below one, since a slower run keeps every limit that the stage keeps.
const DETOUR_FACTORS: [f64; 5] = [0.95, 0.9, 0.85, 0.8, 0.75];
/// Factor on the gains after a failed run before anything is known of the machine.
const SOFTER: f64 = 0.25;
/// Largest tracking error, in root mean squares of it.
const PEAK: f64 = 4.0;
/// Tracking error, as a share of the motion, above which a machine hardly moved.
const HELD: f64 = 0.5;
/// Most times that the settling time of a trial is doubled.
const MOST_EXTENSIONS: usize = 3;

/// Why a campaign ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The last stage converged.
    Converged,
    /// An input reached the stated share of its limit, so that no larger motion is allowed.
    EffortShare,
    /// All runs were used before the last stage converged.
    RunsUsed,
    /// An input was cut at its limit.
    InputLimit,
    /// The last of the permitted successive runs passed a bound, was stopped, or diverged.
    Aborted,
    /// The motion did not settle.
    NotSettled,
    /// A sensor gave no value.
    SensorLost,
    /// All runs were used, and the estimates followed parameters that drift.
    Followed,
    /// Every parameter of which a deviation is wanted is known as well as that.
    GoalReached,
    /// The time for which the machine may move is used.
    TimeUsed,
    /// That time was used before every parameter was known as well as is wanted.
    TimeShort,
    /// No motion within the limits shows more of what is wanted.
    NothingMore,
}

impl Outcome {
    /// Whether the campaign ended as planned.
    #[must_use]
    pub const fn is_normal(self) -> bool {
        matches!(
            self,
            Outcome::Converged | Outcome::EffortShare | Outcome::Followed | Outcome::GoalReached | Outcome::TimeUsed
        )
    }

    /// The ending in words, for a report.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Outcome::Converged => "converged",
            Outcome::EffortShare => "an input reached the stated share of its limit",
            Outcome::RunsUsed => "all runs were used before the estimates converged",
            Outcome::InputLimit => "an input was cut at its limit",
            Outcome::Aborted => "run after run passed a bound, or was stopped",
            Outcome::NotSettled => "the motion did not settle",
            Outcome::SensorLost => {
                "a sensor gave no value in the middle of a run; mend it, and go on from the runs that are finished"
            }
            Outcome::Followed => "all runs were used to follow the parameters",
            Outcome::GoalReached => "every parameter is known as well as was asked for",
            Outcome::TimeUsed => "the time for which the machine may move is used",
            Outcome::TimeShort => "the time was used before every parameter was known as well as was asked for",
            Outcome::NothingMore => "no motion within the limits shows more of what was asked for",
        }
    }
}

/// How a run contradicts the runs that are pooled.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Contradiction {
    /// The parameter that differs most.
    pub parameter: String,
    /// Its difference, in standard deviations of the difference.
    pub deviations: f64,
}

/// One parameter's value in a run's report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunParameter {
    /// Name of the parameter.
    pub name: String,
    /// Estimate after the run; nothing when the parameter is unobservable.
    pub value: Option<f64>,
    /// Standard deviation of the estimate; nothing when the parameter is unobservable.
    pub std: Option<f64>,
}

/// Report of one run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunReport {
    /// Number of the run, from 1.
    pub run: usize,
    /// Stage of the schedule, from 1.
    pub stage: usize,
    /// Name of the stage's pattern, where the stage has its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pattern: Option<String>,
    /// Names and values of the amplitudes.
    pub amplitudes: Vec<(String, f64)>,
    /// Fundamental angular frequency that was played, rad/s.
    pub frequency: f64,
    /// Samples in a period.
    pub samples_per_period: usize,
    /// Index of the first period at which the motion had settled.
    pub settled_after: Option<usize>,
    /// Whole periods that were measured.
    pub periods: usize,
    /// Parameters with which the feed-forward was computed, in the model's order.
    #[serde(skip)]
    pub played: Vec<f64>,
    /// Root-mean-square tracking error per coordinate, over the measured periods or over the whole of an aborted run.
    pub tracking_rms: Vec<f64>,
    /// Largest share of its limit that an input or its motor reached; nothing without limits.
    pub effort_share: Option<f64>,
    /// The limit of which the largest share was used, with the sample of the period at which it was reached.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit: Option<LimitUse>,
    /// How the run ended.
    pub ending: RunEnding,
    /// A harmonic of the reference or of the feed-forward that lies near a natural mode. The modes are computed with
    /// the parameters of the feed-forward.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near_mode: Option<NearMode>,
    /// Whether the estimates were updated from the run when it was submitted. A perturbed run of the estimator
    /// `numerical` contributes to an update only together with later runs.
    pub updated: bool,
    /// How the run contradicts the other runs, which is why it is not pooled; nothing for a pooled run. Later runs may
    /// change this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contradicts: Option<Contradiction>,
    /// Estimates after the run.
    pub parameters: Vec<RunParameter>,
    /// Rank of the equations of all pooled runs so far.
    pub rank: Option<usize>,
    /// Condition number of the equations of all pooled runs so far.
    pub condition: Option<f64>,
    /// Root mean square of the residual as a share of the force.
    pub residual: Option<f64>,
    /// Highest harmonic used by the estimator.
    pub harmonics: Option<usize>,
}

impl RunReport {
    /// Whether the estimates use the run: it was played completely, had settled, and agrees with the other runs.
    #[must_use]
    pub const fn is_pooled(&self) -> bool {
        self.settled_after.is_some() && self.contradicts.is_none()
    }
}

/// Why a campaign cannot go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CampaignError {
    /// The schedule is empty.
    #[error("the schedule has no stage")]
    NoStage,
    /// A record came although the campaign had ended.
    #[error("the campaign has ended; no record is expected")]
    Ended,
    /// The record does not have the dimensions of the trial.
    #[error("the record has {given} {what}, the trial has {needed}")]
    Mismatch {
        /// The dimension that differs.
        what: &'static str,
        /// Its value in the trial.
        needed: usize,
        /// Its value in the record.
        given: usize,
    },
    /// The samples that came back do not form a record of the trial.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The record holds a value that is not finite.
    #[error("sample {sample} of the record is not finite; was a sensor disconnected?")]
    NotFinite {
        /// Index of the sample.
        sample: usize,
    },
    /// The next trial cannot be computed.
    #[error("run {run}: {source}")]
    Trial {
        /// Number of the run, from 1.
        run: usize,
        /// The fault of the trial.
        source: TrialError,
    },
    /// The actuator cannot follow the reference, whatever the values of the parameters.
    #[error("run {run} cannot work: {limit}")]
    Unreachable {
        /// Number of the run, from 1.
        run: usize,
        /// The limit that the run would pass.
        limit: Box<LimitUse>,
    },
    /// The harmonics of the record cannot be computed.
    #[error("run {run}: {source}")]
    Spectrum {
        /// Number of the run, from 1.
        run: usize,
        /// The fault of the harmonics.
        source: SpectrumError,
    },
    /// The estimator refused the run.
    #[error("run {run}: {source}")]
    Estimate {
        /// Number of the run, from 1.
        run: usize,
        /// The fault of the estimate.
        source: EstimateError,
    },
}

/// A campaign of runs on one machine.
pub struct Campaign<'m> {
    model: &'m dyn Model<f64>,
    setup: Setup,
    estimator: Box<dyn Estimator>,
    current: Vec<f64>,
    estimate: Option<Estimate>,
    /// Refines the estimates before they are used to compare runs and to test convergence; nothing when the estimates
    /// of the harmonics are used as they are.
    refinement: Option<Box<dyn Refinement + 'm>>,
    /// The last estimate after refinement; nothing when it was not refined.
    refined: Option<Estimate>,
    reports: Vec<RunReport>,
    /// Index in `reports` of every run that the estimator has processed.
    taken: Vec<usize>,
    /// The settled part of every run that the estimator has processed.
    steady: Vec<SteadyRun>,
    /// The harmonics of every run that the estimator has processed.
    harmonics: Vec<RunHarmonics>,
    stage: usize,
    updates_in_stage: usize,
    /// Factor on the amplitudes of the present stage.
    scale: f64,
    aborts: usize,
    extensions: usize,
    pending: Option<Trial>,
    outcome: Option<Outcome>,
    stop: Option<LimitUse>,
    /// What was seen of the machine that the choice of the next stage needs.
    seen: Seen,
    /// Whether the present stage is done with, where stages are chosen.
    is_done: bool,
}

impl std::fmt::Debug for Campaign<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Campaign")
            .field("model", &self.model.name())
            .field("estimator", &self.estimator.name())
            .field("runs", &self.reports.len())
            .field("current", &self.current)
            .field("outcome", &self.outcome)
            .finish_non_exhaustive()
    }
}

impl<'m> Campaign<'m> {
    /// A campaign before its first run.
    ///
    /// # Errors
    /// [`CampaignError::NoStage`] when the schedule is empty, [`CampaignError::Trial`] when the first trial cannot be
    /// computed, [`CampaignError::Estimate`] when the estimator has no meaning for the model.
    pub fn new(model: &'m dyn Model<f64>, setup: Setup) -> Result<Self, CampaignError> {
        let estimator = setup.method.estimator(&setup.estimation);
        Self::with_estimator(model, setup, estimator)
    }

    /// A campaign before its first run that uses the caller's estimator of the model's parameters.
    ///
    /// # Errors
    /// [`CampaignError::NoStage`] when the schedule is empty, [`CampaignError::Trial`] when the first trial cannot be
    /// computed, [`CampaignError::Estimate`] when the estimator has no meaning for the model.
    pub fn with_estimator(
        model: &'m dyn Model<f64>,
        setup: Setup,
        estimator: Box<dyn Estimator>,
    ) -> Result<Self, CampaignError> {
        if setup.procedure.stages.is_empty() {
            return Err(CampaignError::NoStage);
        }
        let mut current = setup.prior.clone();
        current.resize(model.dims().parameters, 0.0);
        for frozen in &setup.estimation.frozen {
            if let Some(value) = current.get_mut(frozen.parameter) {
                *value = frozen.value;
            }
        }
        let mut campaign = Campaign {
            model,
            setup,
            estimator,
            current,
            estimate: None,
            refinement: None,
            refined: None,
            reports: Vec::new(),
            taken: Vec::new(),
            steady: Vec::new(),
            harmonics: Vec::new(),
            stage: 0,
            updates_in_stage: 0,
            scale: 1.0,
            aborts: 0,
            extensions: 0,
            pending: None,
            outcome: None,
            stop: None,
            seen: Seen::default(),
            is_done: false,
        };
        campaign.prepare()?;
        if let Some(first) = &campaign.pending {
            let runs = campaign.setup.procedure.max_runs;
            let checked = campaign.estimator.check(model, first, runs);
            checked.map_err(|source| CampaignError::Estimate { run: 1, source })?;
        }
        Ok(campaign)
    }

    /// Adds a refinement of the estimates. The refined estimates decide whether runs agree and whether an update has
    /// converged; the feed-forward of the next run still uses the estimates from the harmonics.
    pub fn refining(mut self, refinement: impl Refinement + 'm) -> Self {
        self.refinement = Some(Box::new(refinement));
        self
    }

    /// The trial to play next; nothing when the campaign has ended.
    #[must_use]
    pub const fn next(&self) -> Option<&Trial> {
        self.pending.as_ref()
    }

    /// Why the campaign ended; nothing while it goes on.
    #[must_use]
    pub const fn outcome(&self) -> Option<Outcome> {
        self.outcome
    }

    /// The limit that ended the campaign; nothing when the campaign ended for another reason.
    #[must_use]
    pub const fn stop(&self) -> Option<&LimitUse> {
        self.stop.as_ref()
    }

    /// The parameters with which the next run's feed-forward is computed.
    #[must_use]
    pub fn current(&self) -> &[f64] {
        &self.current
    }

    /// The harmonic of the next run that lies near a natural mode of the estimated model, known before the run is
    /// played; nothing where there is none, or when the campaign has ended.
    #[must_use]
    pub fn next_near_mode(&self) -> Option<NearMode> {
        near_mode(self.model, self.pending.as_ref()?)
    }

    /// The last estimate with its uncertainty; nothing before the first update.
    #[must_use]
    pub const fn estimate(&self) -> Option<&Estimate> {
        self.estimate.as_ref()
    }

    /// Distance of each parameter between the last estimate and the point of its linearisation, for a campaign that
    /// ended before it had converged; nothing for estimators whose standard deviations already contain the error of
    /// linearisation.
    pub fn unsettled(&self) -> Option<Vec<f64>> {
        let ended = self.outcome.is_some_and(|outcome| outcome != Outcome::Converged);
        let about = self.estimator.linear_about().filter(|_| ended)?;
        Some(self.estimate.as_ref()?.values.iter().zip(about).map(|(now, before)| now - before).collect())
    }

    /// The estimator, which reports more than the estimate alone.
    #[must_use]
    pub fn estimator(&self) -> &dyn Estimator {
        self.estimator.as_ref()
    }

    /// The model of the machine.
    #[must_use]
    pub fn model(&self) -> &dyn Model<f64> {
        self.model
    }

    /// Reports of the runs so far.
    #[must_use]
    pub fn runs(&self) -> &[RunReport] {
        &self.reports
    }

    /// The settled parts of the runs that are pooled, in their order.
    pub fn steady(&self) -> impl Iterator<Item = &SteadyRun> {
        self.steady.iter().filter(|steady| self.reports[steady.run].is_pooled())
    }

    /// The harmonics of the runs that the estimator has processed, in their order.
    pub fn harmonics(&self) -> &[RunHarmonics] {
        &self.harmonics
    }

    /// The setup from which the campaign started.
    #[must_use]
    pub const fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Updates the estimates from the record of the trial that [`next`](Self::next) gave, and computes the next trial.
    ///
    /// # Errors
    /// [`CampaignError`] when the campaign has ended, when the record does not fit the trial, or when harmonics,
    /// estimates or the next trial cannot be computed. The state of the campaign is then unchanged, and it expects
    /// another record of the same trial.
    pub fn submit(&mut self, record: &Record) -> Result<&RunReport, CampaignError> {
        let Some(trial) = self.pending.clone() else { return Err(CampaignError::Ended) };
        // The record must have the dimensions of the model.
        let dims = self.model.dims();
        for (what, needed, given) in
            [("coordinates", dims.coordinates, record.coordinates.len()), ("inputs", dims.inputs, record.inputs.len())]
        {
            if needed != given {
                return Err(CampaignError::Mismatch { what, needed, given });
            }
        }
        let mut report = self.report(&trial, record);
        let moved = record.len() as f64 * trial.control.sample_time;
        // A run that was not completed leads to smaller amplitudes, and after too many of them to the end of the
        // campaign.
        if matches!(record.ending, Ending::SensorLost { .. }) {
            self.outcome = Some(Outcome::SensorLost);
            return self.finish(report, moved);
        }
        if record.ending != Ending::Complete {
            self.aborts += 1;
            if self.setup.procedure.plan.is_some() {
                self.seen.played(extent(&trial, dims.coordinates), false);
                self.retreat();
            } else {
                self.scale *= self.setup.procedure.back_off;
            }
            self.estimator.take_back();
            if self.aborts > self.setup.procedure.max_aborts {
                self.outcome = Some(Outcome::Aborted);
            }
            return self.finish(report, moved);
        }
        if record.len() < trial.samples() {
            // A complete record must hold every sample of the trial, and finite values only.
            return Err(CampaignError::Mismatch { what: "samples", needed: trial.samples(), given: record.len() });
        }
        let not_finite = |channel: &Vec<f64>| channel.iter().position(|x| !x.is_finite());
        let rates = || record.rates.iter().flatten();
        if let Some(sample) = record.coordinates.iter().chain(&record.inputs).chain(rates()).find_map(not_finite) {
            return Err(CampaignError::NotFinite { sample });
        }
        if let Some(short) = rates().map(Vec::len).find(|length| *length < trial.samples()) {
            return Err(CampaignError::Mismatch { what: "samples of a rate", needed: trial.samples(), given: short });
        }
        let samples = trial.samples_per_period;
        if self.setup.procedure.plan.is_some() && !self.followed(&trial, record) && self.enlarge() {
            report.ending = RunEnding::Unfollowed;
            return self.finish(report, moved);
        }
        // The measurement begins at the period at which the motion has settled.
        let settled = settled_from(record, samples, self.setup.procedure.settle_periods)
            .filter(|from| from + LEAST_PERIODS <= trial.periods);
        let Some(from) = settled else {
            report.ending = RunEnding::Unsettled;
            self.extensions += 1;
            if self.extensions > MOST_EXTENSIONS {
                self.outcome = Some(Outcome::NotSettled);
            }
            return self.finish(report, moved);
        };
        let run = self.reports.len() + 1;
        // Harmonics of all channels over the settled periods, corrected for the known dynamics of the actuators.
        let channels: Vec<&[f64]> = record
            .coordinates
            .iter()
            .chain(&record.inputs)
            .chain(rates())
            .map(|c| &c[from * samples..trial.samples()])
            .collect();
        let periods = trial.periods - from;
        let mut spectra = Spectra::analyse(&channels, trial.control.sample_time, samples as f64, periods)
            .map_err(|source| CampaignError::Spectrum { run, source })?;
        correct_actuators(&mut spectra, dims.coordinates, &trial.control.actuators);
        if self.setup.procedure.stages[self.stage].rests() {
            spectra.rests[..dims.coordinates].fill(true);
        }
        let rates = integrated_rates(&spectra, &record.rates, dims);
        if rates.is_some() {
            let own: Vec<usize> = (0..dims.coordinates + dims.inputs).collect();
            spectra = spectra.select(&own);
        }
        if self.setup.procedure.plan.is_some() {
            self.read_noise(&spectra);
        }
        let hold = self.setup.procedure.hold;
        let own = &channels[..dims.coordinates + dims.inputs];
        let steady = SteadyRun::of(self.reports.len(), own, dims.coordinates, samples, &spectra);
        let alone = self.refinement.as_deref().map(|refinement| OneRun { refinement, run: &steady });
        let alone = alone.as_ref().map(|run| run as &dyn Alone);
        // The estimator processes the run.
        let seen = Run { trial: &trial, spectra: &spectra, rates: rates.as_ref(), hold, alone };
        let update =
            self.estimator.take(self.model, &seen).map_err(|source| CampaignError::Estimate { run, source })?;
        self.aborts = 0;
        self.taken.push(self.reports.len());
        self.steady.push(steady);
        report.settled_after = Some(from);
        report.periods = periods;
        report.tracking_rms = tracking_rms(&trial, record, from * samples);
        // The report states what was measured.
        report.harmonics = Some(self.estimator.harmonics());
        let used = self.motor_use(&trial, &spectra).into_iter().chain(self.limited_use(&trial, &spectra));
        if let Some(used) = used.fold(None, most_used) {
            report.limit = most_used(report.limit.take(), used);
            report.effort_share = report.limit.as_ref().map(|limit| limit.share);
        }
        if record.saturated > 0 && report.effort_share.is_some_and(|share| share < 1.0) {
            report.limit = cut_by_noise(self.limited(), record, report.limit.take(), |i, limited| {
                self.limit_used((i, limited), &trial, &spectra)
            });
        }
        report.contradicts = self.contradictions();
        if let Some(estimate) = update {
            // A run that is not pooled leaves the estimates unchanged. This is no convergence, so its stage is played
            // again.
            let pooled = report.contradicts.is_none();
            let refined = if self.wants_refined(&estimate) { self.refine(&estimate, pooled) } else { None };
            let judged = refined.as_ref().unwrap_or(&estimate);
            let converged = pooled && (self.converged(judged) || self.tracks_well(&trial, &spectra));
            self.current.clone_from(&estimate.values);
            self.refined = refined;
            report.updated = pooled;
            self.estimate = Some(estimate);
            self.updates_in_stage += usize::from(pooled);
            self.decide(&trial, record, &report, converged);
        }
        self.see(&trial, record, &report);
        let highest = self.estimator.harmonics();
        let after = self.current.clone();
        let of = (dims.coordinates, dims.inputs);
        self.harmonics.push(RunHarmonics::of(self.reports.len(), &trial, &spectra, of, highest, after));
        self.finish(report, moved)
    }

    /// Marks in the report of every run whether it contradicts the pooled runs. Returns the mark of the last run, whose
    /// report is not filed yet.
    fn contradictions(&mut self) -> Option<Contradiction> {
        let mut last = None;
        for (run, &at) in self.taken.iter().enumerate() {
            let left_out = self.estimator.left_out().iter().find(|left_out| left_out.run == run);
            let said = left_out.map(|left_out| Contradiction {
                parameter: self.model.parameter(left_out.parameter).name.into(),
                deviations: left_out.deviations,
            });
            match self.reports.get_mut(at) {
                Some(report) => report.contradicts = said,
                None => last = said,
            }
        }
        last
    }

    /// After an update, repeats the stage, advances to the next one, or ends the campaign.
    fn decide(&mut self, trial: &Trial, record: &Record, report: &RunReport, converged: bool) {
        let procedure = &self.setup.procedure;
        if procedure.plan.is_some() {
            self.is_done = true;
            return;
        }
        let share = report.effort_share.unwrap_or(0.0);
        let is_limited = trial.input_limits.iter().any(|limit| limit.is_finite()) || self.limited().next().is_some();
        if record.saturated > 0 && is_limited || share > 1.0 {
            self.outcome = Some(Outcome::InputLimit);
            self.stop.clone_from(&report.limit);
        } else if report.effort_share.is_some() && share >= procedure.effort_share {
            self.outcome = Some(Outcome::EffortShare);
            self.stop.clone_from(&report.limit);
        } else if converged || self.updates_in_stage >= procedure.updates_per_stage {
            let last = self.stage + 1 == procedure.stages.len();
            if last && self.setup.estimation.forgets() {
                self.updates_in_stage = 0;
            } else if last && converged {
                self.outcome = Some(Outcome::Converged);
            } else if last {
                self.outcome = Some(Outcome::RunsUsed);
            } else {
                self.stage += 1;
                self.updates_in_stage = 0;
                self.scale = 1.0;
                self.extensions = 0;
            }
        }
    }

    /// Files the report of a run in which the machine moved for so long, s, and computes the next trial.
    fn finish(&mut self, mut report: RunReport, moved: f64) -> Result<&RunReport, CampaignError> {
        self.seen.time += moved;
        report.parameters = self.run_parameters();
        report.rank = self.estimate.as_ref().map(|e| e.rank);
        report.condition = self.estimate.as_ref().map(|e| e.condition).filter(|c| c.is_finite());
        report.residual = self.estimate.as_ref().map(|e| e.residual);
        self.reports.push(report);
        self.pending = None;
        if self.outcome.is_none() && self.reports.len() >= self.setup.procedure.max_runs {
            let there = self.stage + 1 == self.setup.procedure.stages.len() && self.estimate.is_some();
            let followed = there && self.setup.estimation.forgets();
            self.outcome = Some(if followed { Outcome::Followed } else { Outcome::RunsUsed });
        }
        if self.outcome.is_none() && self.is_done {
            self.choose();
        }
        if self.outcome.is_none() {
            self.prepare()?;
        }
        Ok(self.reports.last().expect("invariant: a report was just filed"))
    }

    /// Reads the noise of the sensors between the harmonics of a run.
    fn read_noise(&mut self, spectra: &Spectra) {
        // One-sided phasors of N samples have 4/N of the variance of a sample.
        let samples = spectra.periods as f64 * spectra.samples_per_period;
        let white = |c: usize| {
            let lines = spectra.noise.iter().skip(1).map(|noise| noise[(c, c)].re);
            let (sum, count) = lines.fold((0.0, 0), |(sum, count), variance| (sum + variance, count + 1));
            let read = (sum / f64::from(count.max(1)) * samples / 4.0).sqrt();
            let least = LEAST_NOISE * spectra.lines[c].iter().skip(1).map(|line| line.norm()).fold(0.0, f64::max);
            read.max(spectra.steps[c] / 12.0_f64.sqrt()).max(least)
        };
        self.seen.noise = (0..self.model.dims().coordinates).map(white).collect();
    }

    /// Takes in what the choice of the next stage needs of a run that was played to its end.
    fn see(&mut self, trial: &Trial, record: &Record, report: &RunReport) {
        if self.setup.procedure.plan.is_none() {
            return;
        }
        let Dims { coordinates, inputs, .. } = self.model.dims();
        // What the feedback adds is read against the feed-forward of what is known now.
        let stage = self.setup.procedure.stages[self.stage].clone();
        let again = self.trial_of(&stage, self.scale).unwrap_or_else(|_| trial.clone());
        let planned = |i: usize| {
            again.feed_forward.iter().skip(i).step_by(inputs.max(1)).fold(0.0, |most: f64, u| most.max(u.abs()))
        };
        let used = |i: usize| record.inputs[i].iter().fold(0.0, |most: f64, u| most.max(u.abs()));
        let noise = |i: usize| stage.gain * noise_fed_back(&self.setup, &self.seen.noise, i);
        self.seen.added = (0..inputs).map(|i| (used(i) - planned(i) - noise(i)).max(0.0)).collect();
        // The next run has the feed-forward of what is known now: the feedback must make up for what it added beside that.
        let paths = &trial.control.gains;
        let error = |c: usize| {
            let of = |path: &Gain<f64>| self.seen.added[path.input] / path.proportional.abs();
            let own = paths.iter().filter(|path| path.coordinate == c && path.proportional != 0.0);
            own.map(of).fold(PEAK * report.tracking_rms[c], f64::min)
        };
        self.seen.tracking = (0..coordinates).map(error).collect();
        // An input that was cut by the noise in its feedback is none that the motion needs.
        let needs = self.planned(&again).ok().flatten().map_or(0.0, |used| used.share);
        let complete = record.saturated == 0 || needs < self.setup.procedure.effort_share;
        self.seen.played(extent(trial, coordinates), complete);
    }

    /// Whether an estimate is to be refined before it is judged. Where stages are chosen that is done when the samples of the runs may show
    /// what is wanted: refining all runs after every one would take longer than playing them.
    fn wants_refined(&self, estimate: &Estimate) -> bool {
        let procedure = &self.setup.procedure;
        let pooled = self.reports.iter().filter(|report| report.is_pooled()).map(|report| report.stage - 1);
        let stages: Vec<&Stage> = pooled.chain([self.stage]).map(|at| &procedure.stages[at]).collect();
        self.refinement.is_some() && self.scene(estimate, |scene| scene.may_be_enough(&stages)).unwrap_or(true)
    }

    /// Whether every coordinate that is fed back moved as it was to, by more than half.
    fn followed(&self, trial: &Trial, record: &Record) -> bool {
        let (samples, width) = (trial.samples_per_period, self.model.dims().motion_len());
        let last = trial.samples() - samples;
        // A load that pulls to one side is a constant error, which does not keep the machine from moving.
        let varying = |values: Vec<f64>| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            root_mean_square(values.into_iter().map(|value| value - mean))
        };
        trial.control.gains.iter().map(|path| path.coordinate).filter(|c| !trial.open.contains(c)).all(|c| {
            let asked: Vec<f64> = trial.reference.iter().skip(c).step_by(width).copied().collect();
            let errors = record.coordinates[c][last..].iter().zip(&asked).map(|(q, asked)| q - asked).collect();
            varying(errors) <= HELD * varying(asked)
        })
    }

    /// Goes on with a larger run, and within the largest one with a stiffer loop; says no where neither is left.
    fn enlarge(&mut self) -> bool {
        let stage = larger(&self.setup, &self.setup.procedure.stages[self.stage], self.model.dims().coordinates);
        let Some(stage) = stage else { return false };
        self.setup.procedure.stages.push(stage);
        self.stage += 1;
        true
    }

    /// After a run that failed, goes on with a smaller one; before the first estimate with a softer loop too, which may be what failed.
    fn retreat(&mut self) {
        let procedure = &mut self.setup.procedure;
        let mut stage = procedure.stages[self.stage].clone();
        stage.amplitudes.iter_mut().for_each(|size| *size *= procedure.back_off);
        if self.estimate.is_none() {
            stage.gain *= SOFTER;
        }
        procedure.stages.push(stage);
        self.stage += 1;
    }

    /// Chooses the next stage, or ends the campaign.
    fn choose(&mut self) {
        self.is_done = false;
        let Some(estimate) = self.refined.as_ref().or(self.estimate.as_ref()) else { return };
        let Some(choice) = self.scene(estimate, |scene| scene.choose()) else { return };
        match choice {
            Choice::Play(stage) => {
                self.setup.procedure.stages.push(*stage);
                self.stage += 1;
                self.updates_in_stage = 0;
                self.scale = 1.0;
                self.extensions = 0;
            }
            Choice::Reached => self.outcome = Some(Outcome::GoalReached),
            Choice::NoTime => {
                let wanted =
                    self.setup.procedure.plan.as_ref().is_some_and(|plan| plan.goals.iter().any(Option::is_some));
                self.outcome = Some(if wanted { Outcome::TimeShort } else { Outcome::TimeUsed });
            }
            Choice::NothingMore => self.outcome = Some(Outcome::NothingMore),
        }
    }

    /// Which limit to raise for the parameter that is known least by an estimate of this campaign; nothing where stages are not chosen, and
    /// where everything is known as well as is wanted.
    #[must_use]
    pub fn advice(&self, estimate: &Estimate) -> Option<Advice> {
        self.scene(estimate, |scene| scene.advice()).flatten()
    }

    /// Asks the campaign between two runs; nothing where stages are not chosen.
    fn scene<T>(&self, estimate: &Estimate, ask: impl FnOnce(&Scene<'_>) -> T) -> Option<T> {
        let procedure = &self.setup.procedure;
        let plan = procedure.plan.as_ref()?;
        let theta = self.estimator.play(&self.current);
        let trial = |stage: &Stage| self.trial_of(stage, 1.0).ok();
        let share = |trial: &Trial| self.planned(trial).ok().flatten().map_or(0.0, |used| used.share);
        let scene = Scene {
            model: self.model,
            setup: &self.setup,
            plan,
            estimate,
            theta: &theta,
            seen: &self.seen,
            last: &procedure.stages[self.stage],
            trial: &trial,
            share: &share,
        };
        Some(ask(&scene))
    }

    /// The next trial of the present stage at its frequency times `factor`.
    fn trial(&self, factor: f64) -> Result<Trial, CampaignError> {
        let asked = &self.setup.procedure.stages[self.stage];
        self.trial_of(&Stage { frequency: factor * asked.frequency, ..asked.clone() }, self.scale)
    }

    /// The trial of a stage with its amplitudes times `scale`.
    fn trial_of(&self, stage: &Stage, scale: f64) -> Result<Trial, CampaignError> {
        let procedure = &self.setup.procedure;
        let amplitudes: Vec<f64> = stage.amplitudes.iter().map(|a| a * scale).collect();
        let trajectory = stage.trajectory(&self.setup.pattern, scale);
        let period = 2.0 * std::f64::consts::PI / trajectory.frequency;
        // The margin keeps rounding from adding a period when whole periods fill the measured time exactly.
        let measured = ((procedure.measure_time / period - 1e-6).ceil().max(0.0) as usize).max(LEAST_PERIODS);
        let settle = procedure.settle_periods << self.extensions.min(MOST_EXTENSIONS);
        let settings = TrialSettings {
            run: self.reports.len(),
            trajectory,
            open: &stage.pattern(&self.setup.pattern).open(),
            pattern: stage.pattern.as_ref().and_then(|pattern| pattern.name.clone()),
            amplitudes,
            periods: settle + measured,
            control: &self.setup.control.scaled(stage.gain),
            parameters: &self.estimator.play(&self.current),
            constants: &self.setup.constants,
            tracking_bounds: &procedure.tracking_bounds,
            input_limits: &procedure.input_limits,
            position_bounds: &procedure.position_bounds,
            velocity_bounds: &procedure.velocity_bounds,
        };
        let run = self.reports.len() + 1;
        Trial::new(self.model, settings).map_err(|source| CampaignError::Trial { run, source })
    }

    fn prepare(&mut self) -> Result<(), CampaignError> {
        let mut trial = loop {
            match self.trial(1.0) {
                // After too large an update the open coordinates may have no periodic motion; the update is then taken
                // back.
                Err(CampaignError::Trial { source: TrialError::Open { .. }, .. }) if self.estimator.take_back() => {}
                trial => break trial?,
            }
        };
        if self.setup.procedure.avoid_modes && near_mode(self.model, &trial).is_some() {
            let moved = DETOUR_FACTORS.iter().filter_map(|factor| self.trial(*factor).ok());
            trial = moved.into_iter().find(|moved| near_mode(self.model, moved).is_none()).unwrap_or(trial);
        }
        let procedure = &self.setup.procedure;
        let run = self.reports.len() + 1;
        let share = procedure.effort_share;
        let limited = self.limited_plan(&trial);
        // The use of speed and bandwidth follows from the reference alone. Force and power depend on the parameters,
        // and are not tested before the first estimate.
        if let Some(limit) = &limited
            && limit.share > 1.0
            && matches!(limit.limit, "speed" | "bandwidth")
            && self.estimate.is_none()
        {
            return Err(CampaignError::Unreachable { run, limit: Box::new(limit.clone()) });
        }
        let planned = if self.estimate.is_some() {
            self.planned(&trial).map_err(|source| CampaignError::Trial { run, source })?
        } else {
            None
        };
        if planned.as_ref().is_some_and(|planned| planned.share >= share) {
            // The feed-forward alone would exceed the permitted share of the limit, so the trial is not played. An estimate of a
            // linearisation may be wrong about the force, and is gone to less far.
            if !self.estimator.is_final() && self.estimator.take_back() {
                return self.prepare();
            }
            self.outcome = Some(Outcome::EffortShare);
            self.stop = planned;
        } else {
            self.pending = Some(trial);
        }
        Ok(())
    }

    /// The limit of an input, a motor or an actuator of which the feed-forward of a trial uses the largest share.
    fn planned(&self, trial: &Trial) -> Result<Option<LimitUse>, TrialError> {
        let inputs = trial.input_limits.len();
        let column = |i: usize| trial.feed_forward.iter().skip(i).step_by(inputs).copied().collect();
        let command = self.command_use(trial, &(0..inputs).map(column).collect::<Vec<Vec<f64>>>());
        Ok(self.motor_plan(trial)?.into_iter().chain(self.limited_plan(trial)).fold(command, most_used))
    }

    /// The input that uses the largest share of its limit. `columns` holds the samples of each input, from the start of
    /// a period.
    fn command_use(&self, trial: &Trial, columns: &[Vec<f64>]) -> Option<LimitUse> {
        let samples = trial.samples_per_period;
        let mut most = None;
        for (i, (column, &limit)) in columns.iter().zip(&trial.input_limits).enumerate() {
            if !limit.is_finite() {
                continue;
            }
            let sizes = column.iter().map(|value| value.abs()).enumerate();
            let (at, value) = sizes.fold((0, 0.0), |most, now| if now.1 > most.1 { now } else { most });
            let label = self.model.input(i);
            // Where the motor's largest current limits the input, the current is reported instead of the command.
            let motor = self.setup.procedure.motors.get(i).copied().flatten().map(|mounted| mounted.motor);
            let by_current = motor.filter(|motor| motor.force(motor.limits.current) <= limit);
            let per_unit = by_current.map_or(1.0, |motor| 1.0 / motor.force(1.0));
            let (name, unit) = match by_current {
                Some(_) => ("current", Some("A".into())),
                None => ("command", label.unit.map(Into::into)),
            };
            let reach = MOTOR_REACH * trial.trajectory.highest_harmonic().max(1) as usize;
            let harmonic = strongest(last_period(column, samples, reach).into_iter().enumerate());
            let used = LimitUse {
                input: label.name.into(),
                limit: name,
                unit,
                value: value * per_unit,
                available: limit * per_unit,
                share: value / limit,
                sample: at % samples,
                time: (at % samples) as f64 * trial.control.sample_time,
                harmonic: harmonic.map(|(k, size)| (k, size * per_unit)),
                remedy: None,
                cut: None,
            };
            most = most_used(most, used);
        }
        most
    }

    /// The largest share of a motor's limit that the feed-forward of a trial would use.
    fn motor_plan(&self, trial: &Trial) -> Result<Option<LimitUse>, TrialError> {
        let mounted = &self.setup.procedure.motors;
        if mounted.iter().all(Option::is_none) {
            return Ok(None);
        }
        let driven: Vec<Vec<usize>> =
            mounted.iter().map(|mounted| mounted.iter().map(|mounted| mounted.coordinate).collect()).collect();
        let motors: Vec<_> = mounted.iter().map(|mounted| mounted.map(|mounted| mounted.bare())).collect();
        let demand = Demand::new(self.model, &trial.parameters, &trial.constants, &driven);
        let least = 8 * trial.trajectory.highest_harmonic() as usize;
        let samples = least.next_power_of_two().max(LEAST_PLANNED_SAMPLES);
        let found = requirements(&demand, &motors, &trial.trajectory, samples)?;
        let uses = found.iter().filter_map(|requirement| {
            let mounted = mounted.get(requirement.input).copied().flatten()?;
            Some(mounted.planned(self.model, requirement, trial.samples_per_period))
        });
        Ok(uses.fold(None, most_used))
    }

    /// The largest share of an actuator's limit that the feed-forward of a trial would use.
    fn limited_plan(&self, trial: &Trial) -> Option<LimitUse> {
        let Dims { inputs, .. } = self.model.dims();
        let width = self.model.dims().motion_len();
        let reach = MOTOR_REACH * trial.trajectory.highest_harmonic().max(1) as usize;
        let reach = reach.min(trial.samples_per_period / 2);
        let of = |(i, limited): (usize, &Limited)| {
            let force = analyse(&trial.feed_forward, i, inputs, reach);
            let motion = analyse(&trial.reference, limited.coordinate, width, reach);
            let fundamental = trial.trajectory.frequency;
            limited.used(self.model, i, (&force, &motion), fundamental, trial.samples_per_period)
        };
        self.limited().map(of).fold(None, most_used)
    }

    /// The largest share of an actuator's limit that a measured run used.
    fn limited_use(&self, trial: &Trial, spectra: &Spectra) -> Option<LimitUse> {
        self.limited().map(|of| self.limit_used(of, trial, spectra)).fold(None, most_used)
    }

    /// The limit of an input's actuator of which a measured run used the largest share.
    fn limit_used(&self, (i, limited): (usize, &Limited), trial: &Trial, spectra: &Spectra) -> LimitUse {
        let coordinates = self.model.dims().coordinates;
        let reach = MOTOR_REACH * trial.trajectory.highest_harmonic().max(1) as usize;
        let reach = reach.min(spectra.highest());
        let force = &spectra.lines[coordinates + i][..=reach];
        let motion = &spectra.lines[limited.coordinate][..=reach];
        limited.used(self.model, i, (force, motion), spectra.fundamental, trial.samples_per_period)
    }

    /// The inputs whose actuators are limited.
    fn limited(&self) -> impl Iterator<Item = (usize, &Limited)> {
        let all = self.setup.procedure.limited.iter().enumerate();
        all.filter_map(|(i, limited)| Some((i, limited.as_ref()?)))
    }

    /// The largest share of a motor's limit that a measured run used.
    fn motor_use(&self, trial: &Trial, spectra: &Spectra) -> Option<LimitUse> {
        let coordinates = self.model.dims().coordinates;
        let reach = MOTOR_REACH * trial.trajectory.highest_harmonic().max(1) as usize;
        let reach = reach.min(spectra.highest());
        let mut most = None;
        for (i, mounted) in self.setup.procedure.motors.iter().enumerate() {
            let Some(mounted) = mounted else { continue };
            let hold = |k: usize| held(self.setup.procedure.hold, k as f64 * spectra.fundamental * spectra.sample_time);
            let force: Vec<_> = (0..=reach).map(|k| spectra.lines[coordinates + i][k] * hold(k)).collect();
            let motion = &spectra.lines[mounted.coordinate][..=reach];
            let name = self.model.input(i).name;
            let used = mounted.measured(name, &force, motion, spectra.fundamental, trial.samples_per_period);
            most = most_used(most, used);
        }
        most
    }

    /// The estimate refined by the samples of the pooled runs. `last` states whether the last run, whose report is not
    /// filed yet, is pooled.
    fn refine(&self, estimate: &Estimate, last: bool) -> Option<Estimate> {
        let is_pooled = |steady: &&SteadyRun| self.reports.get(steady.run).map_or(last, RunReport::is_pooled);
        let pooled: Vec<&SteadyRun> = self.steady.iter().filter(is_pooled).collect();
        self.refinement.as_ref()?.refined(&pooled, estimate)
    }

    /// Whether the estimate has come to rest; one that shows no direction at all says nothing about that.
    fn converged(&self, estimate: &Estimate) -> bool {
        if self.estimate.is_none() || estimate.rank == 0 {
            return false;
        }
        let known = self.refined.as_ref().map_or(&self.current, |refined| &refined.values);
        // Standard deviations of an estimate that is not final contain more than noise, so a change within them does
        // not show convergence.
        let last = self.estimator.is_final();
        let insignificant = if last { alarm::ESTIMATE_CHANGED } else { 0.0 };
        let shown = |shown: &Combination| {
            let before: f64 = shown.weights.iter().zip(known).map(|(weight, value)| weight * value).sum();
            (shown.value - before).abs() <= self.setup.procedure.tolerance * shown.value.abs()
        };
        if !last && !estimate.combinations().iter().all(shown) {
            return false;
        }
        estimate.values.iter().zip(known).zip(estimate.std.iter().zip(&estimate.status)).all(
            |((now, before), (std, status))| {
                let change = (now - before).abs();
                *status == Status::Unobservable
                    || change <= self.setup.procedure.tolerance * now.abs()
                    || change <= insignificant * std
            },
        )
    }

    /// Whether error limits are set and every harmonic of the tracking error keeps within the limit of its coordinate.
    fn tracks_well(&self, trial: &Trial, spectra: &Spectra) -> bool {
        let limits = &self.setup.procedure.error_limits;
        if self.estimate.is_none() || !limits.iter().any(|limit| *limit > 0.0) {
            return false;
        }
        let highest = self.estimator.harmonics().max(1);
        let lines = tpm_estimate::error_lines(trial, spectra, limits.len(), highest);
        lines.iter().zip(limits).all(|(lines, limit)| *limit <= 0.0 || lines.iter().all(|line| line.norm() <= *limit))
    }

    fn report(&self, trial: &Trial, record: &Record) -> RunReport {
        let limit = self.command_use(trial, &record.inputs);
        let pattern = self.setup.procedure.stages[self.stage].pattern(&self.setup.pattern);
        RunReport {
            run: self.reports.len() + 1,
            stage: self.stage + 1,
            pattern: trial.pattern.clone(),
            amplitudes: pattern.amplitudes.iter().cloned().zip(trial.amplitudes.iter().copied()).collect(),
            frequency: trial.trajectory.frequency,
            samples_per_period: trial.samples_per_period,
            settled_after: None,
            periods: 0,
            played: trial.parameters.clone(),
            tracking_rms: tracking_rms(trial, record, 0),
            effort_share: limit.as_ref().map(|limit| limit.share),
            limit,
            ending: record.ending.kind(),
            near_mode: near_mode(self.model, trial),
            updated: false,
            contradicts: None,
            parameters: Vec::new(),
            rank: None,
            condition: None,
            residual: None,
            harmonics: None,
        }
    }

    fn run_parameters(&self) -> Vec<RunParameter> {
        self.current
            .iter()
            .enumerate()
            .map(|(j, &value)| {
                let estimate = self.estimate.as_ref();
                let hidden = estimate.is_none_or(|e| e.status[j] == Status::Unobservable);
                RunParameter {
                    name: self.model.parameter(j).name.into(),
                    value: (!hidden).then_some(value),
                    std: estimate.filter(|_| !hidden).map(|e| e.std[j]),
                }
            })
            .collect()
    }
}

/// Spectra in which the integral of a measured rate replaces the coordinate, for every coordinate with a measured rate;
/// nothing when no rate is measured. In `spectra` the measured rates follow the coordinates and inputs.
fn integrated_rates(spectra: &Spectra, rates: &[Option<Vec<f64>>], dims: Dims) -> Option<Spectra> {
    let own = dims.coordinates + dims.inputs;
    let measured: Vec<usize> = (0..rates.len()).filter(|&c| rates[c].is_some()).collect();
    let mut channels: Vec<usize> = (0..own).collect();
    for (behind, &c) in measured.iter().enumerate() {
        channels[c] = own + behind;
    }
    if measured.is_empty() {
        return None;
    }
    let mut integrated = spectra.select(&channels);
    for c in measured {
        let zero = Complex::new(0.0, 0.0);
        integrated.pass(c, |frequency| if frequency > 0.0 { Complex::new(0.0, -1.0 / frequency) } else { zero });
    }
    Some(integrated)
}

/// The larger of two uses of limits, by share of the limit; an infinite limit does not count.
fn most_used(most: Option<LimitUse>, used: LimitUse) -> Option<LimitUse> {
    if !used.available.is_finite() || most.as_ref().is_some_and(|most| most.share >= used.share) {
        return most;
    }
    Some(used)
}

/// Amplitudes of the mean and the harmonics up to `reach` of a signal in its last whole period; empty when there is no
/// whole period.
fn last_period(column: &[f64], samples: usize, reach: usize) -> Vec<f64> {
    let Some(from) = (column.len() / samples.max(1)).checked_sub(1).map(|period| period * samples) else {
        return Vec::new();
    };
    let lines = analyse(&column[from..from + samples], 0, 1, reach.min(samples / 2));
    lines.iter().map(|line| line.norm()).collect()
}

/// Root mean square of the measured tracking error of every coordinate from sample `from` on, unit of the coordinate.
fn tracking_rms(trial: &Trial, record: &Record, from: usize) -> Vec<f64> {
    let width = trial.reference.len() / trial.samples_per_period.max(1);
    record
        .coordinates
        .iter()
        .enumerate()
        .map(|(c, channel)| {
            let used = channel.get(from..).unwrap_or_default();
            let power: f64 = used
                .iter()
                .enumerate()
                .map(|(n, q)| {
                    let e = q - trial.reference[(from + n) % trial.samples_per_period * width + c];
                    e * e
                })
                .sum();
            (power / used.len().max(1) as f64).sqrt()
        })
        .collect()
}
