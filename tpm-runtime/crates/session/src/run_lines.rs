//! What a campaign's model lacks, asked of the lines of the rows of its runs.
//!
//! Harmonics give parameters, and no more than a residual of what the model lacks; a simulation that follows the runs says what that is. Where
//! none does, the lines say it, as they do of a log. Every run is whole periods of a motion that repeats, so that nothing is lost at its ends.
//!
//! The values stay those of the runs, whose deviations contain how far the terms that are named would move them.

use crate::lines_log::{late_by_hold, unexplained};
use crate::log::state_mechanism;
use crate::model::DeclaredModel;
use crate::options::LogOptions;
use crate::reading::RecordSettings;
use crate::record;
use crate::refine::Refined;
use crate::refinement_report::{MissingTerm, RefinementReport};
use crate::term_words::lacking;
use std::collections::BTreeMap;
use tpm_campaign::{Campaign, Setup, SteadyRun};
use tpm_controller::model::Model;
use tpm_estimate::{Estimate, Settings, Status, Stretch, estimate_any_motion};
use tpm_numerics::tolerance;

/// What is known of the runs of a campaign as of logs.
pub(super) fn options(setup: &Setup, estimation: Settings) -> LogOptions {
    LogOptions {
        reading: RecordSettings { hold: setup.procedure.hold, ..RecordSettings::default() },
        actuators: setup.control.actuators.clone(),
        constants: setup.constants.clone(),
        estimation,
        ..LogOptions::default()
    }
}

/// The estimate of a campaign with what the lines of its runs say that the model lacks; `refined` as it is where a simulation has said it,
/// and where nothing is lacking.
pub(super) fn asked(
    declared: &DeclaredModel,
    plant: &dyn Model<f64>,
    campaign: &Campaign<'_>,
    refined: Option<Refined>,
) -> Option<Refined> {
    let says = |report: &RefinementReport| report.used || !report.missing.is_empty();
    if refined.as_ref().and_then(|refined| refined.report.as_ref()).is_some_and(says) {
        return refined;
    }
    let Some(estimate) = campaign.estimate() else { return refined };
    let Some((values, warnings)) = named(declared, plant, campaign, estimate) else { return refined };
    let mut refined = refined.unwrap_or_else(|| Refined::none(estimate.clone()));
    refined.estimate = refined.estimate.moving(&values, &campaign.setup().estimation);
    refined.warnings.extend(warnings);
    Some(refined)
}

/// How far every parameter is from its value beside the terms that the model lacks, and what is to be said of them; nothing where it lacks
/// nothing.
fn named(
    declared: &DeclaredModel,
    plant: &dyn Model<f64>,
    campaign: &Campaign<'_>,
    estimate: &Estimate,
) -> Option<(Vec<f64>, Vec<crate::warning::Warning>)> {
    let setup = campaign.setup();
    // Parameters that drift are a misfit of any one model, and a motion that is explained but for rounding lacks nothing.
    if setup.estimation.forgets() || estimate.residual <= tolerance::EXPLAINED_FORCE {
        return None;
    }
    let mut settings = Settings { prior: setup.estimation.prior.clone(), frozen: setup.estimation.frozen.clone(), ..Settings::default() };
    let constants = (0..plant.dims().constants).map(|i| (plant.constant(i).name.to_string(), setup.constants[i]));
    state_mechanism(&mut settings, declared, plant, &constants.collect::<BTreeMap<String, f64>>());
    let options = options(setup, settings);
    let stretches = campaign.steady().map(|run| whole_periods(run, plant.dims().coordinates)).collect();
    let record = record::record(setup.control.sample_time, &options, stretches);
    let clock = std::time::Instant::now();
    let found = estimate_any_motion(plant, &options.constants, &record, true, &options.estimation);
    if std::env::var("TPM_LINES").is_ok() { eprintln!("lines {:?}", clock.elapsed()); match &found { Ok(f) => eprintln!("{:?} {:?} {:?}", f.lacking, f.estimate.values, f.report), Err(e) => eprintln!("{e}") } }
    let found = found.ok()?;
    let missing: Vec<MissingTerm> = found.lacking.iter().map(|own| lacking(plant, own)).collect();
    let mut warnings: Vec<_> = unexplained(plant, &found, &missing).collect();
    warnings.extend(late_by_hold(plant, &record, &found, true, &options));
    let shown = |j: usize| [estimate, &found.estimate].iter().all(|own| own.status[j] != Status::Unobservable);
    let moved = |j: usize| if shown(j) { found.estimate.values[j] - estimate.values[j] } else { 0.0 };
    (!warnings.is_empty()).then(|| ((0..plant.dims().parameters).map(moved).collect(), warnings))
}

/// The whole periods at the end of a run.
fn whole_periods(run: &SteadyRun, coordinates: usize) -> Stretch<'_> {
    let samples = run.samples() / run.period.max(1) * run.period;
    let channels: Vec<&[f64]> = (0..run.channels.len()).map(|channel| run.last(channel, samples)).collect();
    let (own, inputs) = channels.split_at(coordinates);
    Stretch { coordinates: own.to_vec(), rates: vec![None; coordinates], inputs: inputs.to_vec() }
}
