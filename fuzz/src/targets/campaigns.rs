//! Experiments that mostly can be played, and what is proposed for them.

use super::mutated::mutated;
use super::random::Random;
use super::{Verdict, files, refused};
use tpm_runtime::experiment::Experiment;
use tpm_runtime::session::Session;
use tpm_runtime::study::design;

/// How much longer than the shipped ones the sample times are, so that a run has fewer samples.
const COARSE: f64 = 3.0;

/// A factor near one.
fn factor(random: &mut Random) -> f64 {
    0.5 + random.below(1000) as f64 / 800.0
}

/// A shipped experiment with other values everywhere, one in three of them bent by a few tokens. Its first line says which model it is for.
pub(super) fn text(random: &mut Random) -> String {
    let (name, mut experiment) = files::shipped_experiment(random);
    experiment.control.sample_time *= COARSE;
    bent(random, (name, experiment))
}

/// The same for machines on one drive, with one stage of few samples: a design simulates hundreds of candidates.
pub(super) fn short_text(random: &mut Random) -> String {
    let (name, mut experiment) = loop {
        let shipped = files::shipped_experiment(random);
        if matches!(shipped.0, "mass_spring_drag" | "two_carts") {
            break shipped;
        }
    };
    experiment.control.sample_time *= COARSE;
    experiment.schedule.stages.truncate(1);
    bent(random, (name, experiment))
}

/// An experiment with other values, as a text, one in three of them bent.
fn bent(random: &mut Random, (name, mut experiment): (&str, Experiment)) -> String {
    vary(&mut experiment, random);
    let text = experiment.text().expect("an experiment can be written");
    let text = if random.below(3) == 0 { mutated(&text, random.next()) } else { text };
    format!("# {name}\n{text}")
}

/// Other values of everything that has a value.
fn vary(experiment: &mut Experiment, random: &mut Random) {
    experiment.seed = random.below(1000);
    let scaled = |value: &mut f64, random: &mut Random| *value *= factor(random);
    let named = experiment.plant.parameters.values_mut().chain(experiment.limits.inputs.values_mut());
    named.chain(experiment.limits.tracking.values_mut()).for_each(|value| scaled(value, random));
    let truths: Vec<(String, f64)> =
        experiment.plant.parameters.iter().map(|(name, value)| (name.clone(), *value)).collect();
    for prior in experiment.prior.values_mut() {
        if random.below(2) == 0 {
            scaled(prior, random);
        }
    }
    for (name, value) in truths {
        match random.below(4) {
            0 => drop(experiment.prior.insert(name, value * factor(random))),
            1 => drop(experiment.plant.drift.insert(name, 0.01 * factor(random))),
            _ => {}
        }
    }
    for sensor in experiment.plant.sensors.values_mut() {
        scaled(&mut sensor.noise, random);
        (sensor.counts, sensor.step) = (0.0, *random.of(&[0.0, 1e-2, 3e-3, 7e-4]));
        sensor.delay = usize::try_from(random.below(3)).expect("small");
        sensor.jitter = if random.below(4) == 0 { 1e-5 } else { 0.0 };
        if random.below(4) == 0 {
            sensor.rate_noise = Some(1e-3);
        }
    }
    experiment.plant.sub_steps = usize::try_from(1 + random.below(3)).expect("small");
    for feedback in &mut experiment.control.feedback {
        scaled(&mut feedback.kp, random);
        scaled(&mut feedback.kd, random);
    }
    scaled(&mut experiment.control.sample_time, random);
    if let Some(filter) = &mut experiment.control.derivative_filter {
        scaled(filter, random);
    }
    let schedule = &mut experiment.schedule;
    schedule.settle_periods = usize::try_from(1 + random.below(5)).expect("small");
    schedule.measure_time = 1.0 + random.below(20) as f64 / 2.0;
    schedule.updates_per_stage = usize::try_from(1 + random.below(3)).expect("small");
    schedule.max_runs = usize::try_from(1 + random.below(9)).expect("small");
    schedule.avoid_modes = random.below(2) == 0;
    if random.below(3) == 0 {
        schedule.stages.truncate(usize::try_from(1 + random.below(2)).expect("small"));
    }
    for stage in &mut schedule.stages {
        stage.values.values_mut().for_each(|value| scaled(value, random));
    }
    experiment.limits.effort_share = 0.3 + random.below(7) as f64 / 10.0;
    experiment.limits.back_off = 0.2 + random.below(7) as f64 / 10.0;
}

/// The candidates that a design proposes, best first.
pub(super) fn proposals(text: &str) -> Verdict {
    let session = match files::session(text) {
        Ok(session) => session,
        Err(verdict) => return verdict,
    };
    proposed(&session)
}

fn proposed(session: &Session) -> Verdict {
    let machine = session.machine();
    match design(machine.plant(), machine.pattern(), session.experiment()) {
        Ok(found) => {
            assert!(!found.candidates.is_empty(), "a design without a candidate");
            let passed: Vec<bool> = found.candidates.iter().map(|candidate| candidate.passed.is_some()).collect();
            assert!(passed.is_sorted(), "a candidate that passes a limit before one that keeps it");
            let deviations = found.candidates.iter().flat_map(|candidate| &candidate.parameters);
            assert!(deviations.filter_map(|p| p.std).all(|std| std >= 0.0), "a deviation below zero, or none");
            Verdict::Answered
        }
        Err(fault) => refused(&fault),
    }
}
