//! Campaigns by files on simulated machines whose encoders are coarse.

use crate::honesty::identify::{Outcome, write_csv};
use crate::honesty::machines::{PENDULUM, SYSTEM_A, SYSTEM_B, Shipped};
use crate::honesty::table::{Table, met, most_frequent, percent};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::error::Error;
use std::path::Path;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::model::Model as _;
use tpm_runtime::motion::Record;
use tpm_runtime::session::{CampaignFolder, Identification, NextStep, Session, SessionError};

/// Steps of the encoders as shares of the amplitude of the last stage.
const STEPS: [f64; 2] = [1e-4, 1e-3];
/// Noise before the encoder as a share of its step: too little to dither it.
const DITHER: f64 = 0.1;
/// Share of its amplitude by which a stage differs at most from seed to seed: only another motion has other encoder errors.
const VARIATION: f64 = 0.03;
/// Stated deviations within which a value is right.
const RIGHT: f64 = 3.0;
/// Campaigns where none are asked for.
const SEEDS: u32 = 20;

/// The experiment of a machine with encoders of this share of the amplitude.
fn coarse(machine: &Shipped, share: f64, seed: u64) -> Experiment {
    let mut experiment = machine.experiment();
    let amplitude = experiment.schedule.stages.last().map_or(1.0, |stage| stage.values["lambda"]);
    for sensor in experiment.plant.sensors.values_mut() {
        sensor.counts = 0.0;
        sensor.step = share * amplitude;
        sensor.noise = DITHER * sensor.step;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for stage in &mut experiment.schedule.stages {
        if let Some(amplitude) = stage.values.get_mut("lambda") {
            *amplitude *= 1.0 + VARIATION * rng.random_range(-1.0..=1.0);
        }
    }
    experiment.seed = seed;
    // Every step through the files looks at the loop's stability again.
    experiment.stability.points = experiment.stability.points.min(10);
    experiment
}

/// Plays a campaign as `tpm campaign start`, `next` and `submit` do, through files in a folder.
///
/// # Errors
/// [`SessionError`].
fn campaign(session: &Session, folder: &Path) -> Result<Identification, SessionError> {
    let kept = CampaignFolder::begin(&folder.join("campaign"), session.clone())?;
    while let NextStep::Play(next) = kept.next()? {
        let record = session.simulate(&next.trial)?;
        let path = folder.join(format!("run{}.csv", next.terms.run));
        write_record(session, &record, &path)
            .map_err(|source| SessionError::Read { path: path.display().to_string(), source })?;
        if kept.submit(path.as_path(), false)?.outcome.is_some() {
            break;
        }
    }
    kept.result()
}

fn write_record(session: &Session, record: &Record, path: &Path) -> std::io::Result<()> {
    let plant = session.machine().plant();
    let coordinates = (0..plant.dims().coordinates).map(|c| plant.coordinate(c).name);
    let inputs = (0..plant.dims().inputs).map(|i| plant.input(i).name);
    let names: Vec<&str> = ["t_s"].into_iter().chain(coordinates).chain(inputs).collect();
    let time: Vec<f64> = (0..record.len()).map(|i| i as f64 * record.sample_time).collect();
    let measured = record.coordinates.iter().chain(&record.inputs).map(Vec::as_slice);
    let columns: Vec<&[f64]> = [time.as_slice()].into_iter().chain(measured).collect();
    write_csv(path, &names, &columns)
}

/// The end of one campaign, with every parameter's true value.
struct Ended {
    outcome: Outcome,
    truth: Vec<(String, f64)>,
}

fn play(machine: &Shipped, share: f64, seed: u64) -> Result<Ended, String> {
    let own = || -> Result<Ended, Box<dyn Error>> {
        let folder = tempfile::tempdir()?;
        let session = machine.session(coarse(machine, share, seed))?;
        match campaign(&session, folder.path()) {
            Ok(result) => {
                let known = if result.physical.is_empty() { &result.parameters } else { &result.physical };
                let truth = &session.written().plant.parameters;
                let truth = known.iter().filter_map(|own| Some((own.name.clone(), *truth.get(&own.name)?)));
                Ok(Ended { outcome: Outcome::of(&result), truth: truth.collect() })
            }
            Err(error) => Ok(Ended { outcome: Outcome::failed(&error.to_string()), truth: Vec::new() }),
        }
    };
    own().map_err(|error| error.to_string())
}

/// Campaigns on machines with encoders: is every parameter right, or is it said not to be?
///
/// # Errors
/// Any error of the file system, and whatever keeps a machine from being played.
pub fn report(words: &str, seeds: Option<u32>, progress: &dyn Fn(&str)) -> Result<String, Box<dyn Error>> {
    let mut table = Table::new(&[
        "machine",
        "step / amplitude",
        "campaigns",
        "parameters within 3 deviations",
        "campaigns with all of them",
        "right, warned or refused",
        "exit code 1 or 2",
        "typical largest error",
        "met",
        "said most often",
    ]);
    for machine in [SYSTEM_A, SYSTEM_B, PENDULUM].iter().filter(|machine| machine.name.contains(words)) {
        for share in STEPS {
            progress(&format!("{}, {share:e}", machine.name));
            let seeds = 1..=u64::from(seeds.unwrap_or(SEEDS));
            let all =
                seeds.into_par_iter().map(|seed| play(machine, share, seed)).collect::<Result<Vec<Ended>, _>>()?;
            let errors = |ended: &Ended| -> Vec<Option<(f64, f64)>> {
                let error = |(name, truth): &(String, f64)| {
                    // Values that were stated beforehand have no deviation, and are no result.
                    ended.outcome.value(name).map(|(value, std)| (value / truth - 1.0, (value - truth) / std))
                };
                ended.truth.iter().map(error).collect()
            };
            let is_right = |error: &Option<(f64, f64)>| error.is_some_and(|(_, z)| z.is_nan() || z.abs() <= RIGHT);
            let by_campaign: Vec<Vec<Option<(f64, f64)>>> = all.iter().map(errors).collect();
            let stated: Vec<&Option<(f64, f64)>> = by_campaign.iter().flatten().collect();
            let whole = |own: &[Option<(f64, f64)>]| !own.is_empty() && own.iter().all(is_right);
            let right = by_campaign.iter().filter(|own| whole(own)).count();
            let flagged = |ended: &Ended| ended.outcome.exit != 0 || ended.outcome.is_warned();
            let honest = all.iter().zip(&by_campaign).filter(|(ended, own)| whole(own) || flagged(ended)).count();
            let mut largest: Vec<f64> = by_campaign
                .iter()
                .filter_map(|own| own.iter().flatten().map(|(relative, _)| relative.abs()).max_by(f64::total_cmp))
                .collect();
            largest.sort_by(f64::total_cmp);
            table.push(vec![
                machine.name.into(),
                format!("{share:e}"),
                all.len().to_string(),
                percent(stated.iter().filter(|error| is_right(error)).count(), stated.len()),
                percent(right, all.len()),
                percent(honest, all.len()),
                percent(all.iter().filter(|ended| ended.outcome.exit != 0).count(), all.len()),
                largest.get(largest.len() / 2).map_or_else(String::new, |error| format!("{error:.1e}")),
                met(honest == all.len()),
                most_frequent(all.iter().flat_map(|ended| &ended.outcome.said).map(|said| said.label.as_str()), 3),
            ]);
        }
    }
    Ok(table.to_string())
}
