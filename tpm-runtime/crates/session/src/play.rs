//! The loop that every campaign goes through: what is asked for is played, recorded, and taken in.

use crate::error::SessionError;
use crate::identification::{Identification, Source};
use crate::summary;
use crate::truth::Truth;
use tpm_campaign::{Campaign, RunReport, Store};
use tpm_controller::model::Model;
use tpm_experiment::{Experiment, ExperimentError};
use tpm_motion::trajectory::ReferencePattern;
use tpm_motion::{Record, RunEnding, Trial};
use tpm_plant::simulated::simulate;

/// Sees every run as it ends, with what was played and recorded, and says whether to go on.
pub type Watch<'a> = dyn FnMut(&Trial, &Record, &RunReport) -> bool + 'a;

/// Plays one trial on the simulated machine of an experiment, which obeys `model` or is named in the experiment.
///
/// # Errors
/// [`ExperimentError`].
pub fn play_simulated(
    model: &dyn Model<f64>,
    experiment: &Experiment,
    trial: &Trial,
) -> Result<Record, ExperimentError> {
    let other = experiment.other_plant(model)?;
    let plant = other.as_deref().unwrap_or(model);
    Ok(simulate(plant, &experiment.bench_in_run(model, trial.run)?, trial)?)
}

/// Plays what a campaign asks for until it ends or the watcher stops it, and gives the campaign back. Runs that a store holds are taken
/// from it; new ones are kept there as they end, those of a simulated machine with `noise`, the seed of their noise.
///
/// # Errors
/// What `play` gives, and [`SessionError::Experiment`].
pub fn play_campaign<'m>(
    mut campaign: Campaign<'m>,
    noise: Option<u64>,
    store: Option<&Store>,
    play: &mut dyn FnMut(&Trial) -> Result<Record, SessionError>,
    watch: &mut Watch<'_>,
) -> Result<Campaign<'m>, SessionError> {
    let finished = store.map_or_else(|| Ok(Vec::new()), |store| store.records(campaign.model()))?;
    let mut finished = finished.into_iter();
    while let Some(trial) = campaign.next().cloned() {
        let (record, is_new) = match finished.next() {
            Some(record) => (record, false),
            None => (play(&trial)?, true),
        };
        let report = campaign.submit(&record)?;
        // A run in which a sensor dropped out is no finished run: it is played again when the campaign goes on.
        let whole = report.ending != RunEnding::SensorLost;
        let go_on = watch(&trial, &record, report);
        if let Some(store) = store.filter(|_| is_new && whole) {
            store.append(campaign.model(), &trial, &record, noise, None)?;
        }
        if !go_on {
            break;
        }
    }
    Ok(campaign)
}

/// Plays a campaign as [`play_campaign`] does, on the simulated machine of its experiment.
pub(super) fn play_on_simulated<'m>(
    model: &dyn Model<f64>,
    experiment: &Experiment,
    campaign: Campaign<'m>,
    store: Option<&Store>,
    watch: &mut Watch<'_>,
) -> Result<Campaign<'m>, SessionError> {
    let mut play = |trial: &Trial| Ok(play_simulated(model, experiment, trial)?);
    play_campaign(campaign, Some(experiment.seed), store, &mut play, watch)
}

/// Runs an experiment's campaign on the simulated machine of a model that was written by hand. `progress` sees every run as it ends
/// and says whether to go on.
///
/// # Errors
/// [`SessionError`].
pub fn identify_simulated(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    experiment: &Experiment,
    progress: &mut dyn FnMut(&RunReport) -> bool,
) -> Result<Identification, SessionError> {
    let (setup, stability) = experiment.stable_setup(model, pattern)?;
    let campaign = Campaign::new(model, setup)?;
    let played = play_on_simulated(model, experiment, campaign, None, &mut |_, _, run| progress(run))?;
    let mut result = summary::of_campaign(&played, stability, Source::SimulatedPlant, experiment.seed);
    Truth::stated(experiment).complete(&mut result);
    Ok(result)
}
