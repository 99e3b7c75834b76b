//! The loop that every campaign goes through: what is asked for is played, recorded, and taken in.

use crate::campaign::{Campaign, RunReport, Store};
use crate::experiment::{Experiment, ExperimentError};
use crate::machine::simulated::simulate;
use crate::machine::stability::LoopStability;
use crate::run::trajectory::ReferencePattern;
use crate::run::{Record, RunEnding, Trial};
use crate::session::error::SessionError;
use crate::session::identification::{Identification, Source};
use crate::session::summary;
use crate::session::truth::Truth;
use std::vec::Vec;
use tpm_core::model::Model;

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
    let plant = other.as_ref().map_or(model, |arm| arm as &dyn Model<f64>);
    Ok(simulate(plant, &experiment.bench_in_run(model, trial.run)?, trial)?)
}

/// Plays what a campaign asks for until it ends or the watcher stops it, and gives the parameters that its estimator estimates. The
/// campaign comes with what its loop was found to be. Runs that a store holds are taken from it; new ones are kept there as they
/// end, those of a simulated machine with `seed`, the seed of their noise.
///
/// # Errors
/// What `play` gives, and [`SessionError::Experiment`].
pub fn play_campaign(
    (mut campaign, stability): (Campaign<'_>, LoopStability),
    source: Source,
    seed: u64,
    store: Option<&Store>,
    play: &mut dyn FnMut(&Trial) -> Result<Record, SessionError>,
    watch: &mut Watch<'_>,
) -> Result<Identification, SessionError> {
    let noise = (source == Source::SimulatedPlant).then_some(seed);
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
    Ok(summary::of_campaign(&campaign, stability, source, seed))
}

/// Plays a campaign as [`play_campaign`] does, on the simulated machine of its experiment.
pub(super) fn play_on_simulated(
    model: &dyn Model<f64>,
    experiment: &Experiment,
    stable: (Campaign<'_>, LoopStability),
    store: Option<&Store>,
    watch: &mut Watch<'_>,
) -> Result<Identification, SessionError> {
    let mut play = |trial: &Trial| Ok(play_simulated(model, experiment, trial)?);
    play_campaign(stable, Source::SimulatedPlant, experiment.seed, store, &mut play, watch)
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
    let stable = (Campaign::new(model, setup)?, stability);
    let mut result = play_on_simulated(model, experiment, stable, None, &mut |_, _, run| progress(run))?;
    Truth::stated(experiment).complete(&mut result);
    Ok(result)
}
