//! Files beside models and logs: experiments, motors and loops, parameters, manifests of campaigns, runs that are played.

use super::mutated::{mutated, varied};
use super::random::Random;
use super::{Verdict, refused, texts};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::OnceLock;
use tpm_codegen::identified::Identified;
use tpm_runtime::campaign::{Manifest, RunFile, Store, read_trial, trial_samples};
use tpm_runtime::experiment::Experiment;
use tpm_runtime::log::fingerprint;
use tpm_runtime::motion::{Ending, Record, Trial};
use tpm_runtime::plant::actuator::{LoopFile, MotorFile};
use tpm_runtime::session::{DeclaredModel, Identifiable as _, Session};
use tpm_symbolic::regressor::prepare::{Prepared, prepare};

/// What stands between the files of one text.
const NEXT_FILE: &str = "\n-----\n";

/// The models whose experiments are changed.
const MODELS: [&str; 4] = ["mass_spring_drag", "rotary_pendulum_down", "two_carts", "cart_pendulum"];

/// A file of the folder `models`.
fn shipped(name: &str) -> String {
    let found = texts("models", name).into_iter().find(|(path, _)| path.ends_with(name));
    found.expect("a shipped file").1
}

fn model(index: usize) -> &'static DeclaredModel {
    static FOUND: [OnceLock<DeclaredModel>; MODELS.len()] = [const { OnceLock::new() }; MODELS.len()];
    FOUND[index].get_or_init(|| {
        DeclaredModel::parse(MODELS[index], &shipped(&format!("{}.tpm", MODELS[index]))).expect("a shipped model")
    })
}

/// The last of the models, which has motors.
const WITH_MOTORS: usize = MODELS.len() - 1;

/// A text with other values, one in three changed.
fn bent(text: &str, random: &mut Random) -> String {
    let seed = random.next();
    if random.below(3) == 0 { mutated(text, seed) } else { varied(text, seed) }
}

/// Texts that are right, and texts that were kept.
type Bases = OnceLock<[Vec<String>; 2]>;

/// One of the texts that are right, or one in four times of those that were kept, most of which are wrong.
fn base<'a>(random: &mut Random, [right, kept]: &'a [Vec<String>; 2]) -> &'a str {
    let list = if kept.is_empty() || random.below(4) > 0 { right } else { kept };
    random.of::<String>(list)
}

/// The kept texts of a folder.
fn kept(folder: &str, end: &str) -> Vec<String> {
    texts(folder, end).into_iter().map(|(_, text)| text).collect()
}

/// A shipped or kept experiment, bent. Its first line says which model it is for.
pub(super) fn experiment_text(random: &mut Random) -> String {
    static BASES: Bases = OnceLock::new();
    let bases = BASES.get_or_init(|| {
        let mut right = Vec::new();
        for name in MODELS {
            for folder in ["models", "models/experiments"] {
                let found = texts(folder, &format!("{name}.toml"));
                right.extend(found.into_iter().map(|(_, text)| format!("# {name}\n{text}")));
            }
        }
        [right, kept("fuzz/corpus/experiments", ".toml")]
    });
    let base = base(random, bases);
    let (first, rest) = base.split_once('\n').unwrap_or((base, ""));
    format!("{first}\n{}", bent(rest, random))
}

/// The name of one of the models, and its shipped experiment.
pub(super) fn shipped_experiment(random: &mut Random) -> (&'static str, Experiment) {
    static FOUND: OnceLock<Vec<(&str, Experiment)>> = OnceLock::new();
    let found = FOUND.get_or_init(|| {
        let folders = ["models", "models/experiments"];
        let texts = |name: &'static str| {
            let found = folders.iter().flat_map(move |folder| texts(folder, &format!("{name}.toml")));
            found.map(move |(_, text)| (name, Experiment::parse(&text).expect("a shipped experiment")))
        };
        MODELS.into_iter().flat_map(texts).collect()
    });
    random.of(found).clone()
}

/// An experiment whose first line says which model it is for, with this model.
pub(super) fn session(text: &str) -> Result<Session, Verdict> {
    let experiment = Experiment::parse(text).map_err(|fault| refused(&fault))?;
    let first = text.lines().next().unwrap_or_default();
    let index = MODELS.iter().position(|name| first.strip_prefix("# ") == Some(name)).unwrap_or(0);
    Session::new(model(index).clone(), experiment, None, BTreeMap::new()).map_err(|fault| refused(&fault))
}

/// A campaign on a mass of few samples in a run.
pub(super) fn short_session() -> Session {
    let mut experiment = Experiment::parse(&shipped("mass_spring_drag.toml")).expect("a shipped experiment");
    experiment.schedule.measure_time = 2.0;
    experiment.schedule.settle_periods = 1;
    experiment.control.sample_time = 0.01;
    experiment.control.derivative_filter = Some(0.02);
    for feedback in &mut experiment.control.feedback {
        (feedback.kp, feedback.kd) = (200.0, 30.0);
    }
    Session::new(model(0).clone(), experiment, None, BTreeMap::new()).expect("a session")
}

/// The result of a campaign on the simulated machine.
pub(super) fn result() -> &'static str {
    &written().parameters
}

/// An experiment up to the campaign before its first run.
pub(super) fn experiment(text: &str) -> Verdict {
    let session = match session(text) {
        Ok(session) => session,
        Err(verdict) => return verdict,
    };
    match session.campaign() {
        Ok(_) => Verdict::Answered,
        Err(fault) => refused(&fault),
    }
}

/// A motor file or a loop file, bent.
pub(super) fn motors_text(random: &mut Random) -> String {
    static BASES: Bases = OnceLock::new();
    let bases = BASES.get_or_init(|| {
        let right = ["cart_pendulum_motors.toml", "cart_pendulum_loop.toml"].map(shipped);
        [right.to_vec(), kept("fuzz/corpus/motors", ".toml")]
    });
    bent(base(random, bases), random)
}

/// A text as a motor file, with other tables beside it, and as a loop file.
pub(super) fn motors(text: &str) -> Verdict {
    let model = model(WITH_MOTORS).evaluated();
    let driven: Vec<Vec<usize>> = (0..model.dims().inputs).map(|input| vec![input]).collect();
    let alone = MotorFile::parse(text).and_then(|file| file.motors(model, &driven));
    let within = MotorFile::within(text).and_then(|file| file.dynamics(model));
    let of_loop = LoopFile::parse(text).and_then(|file| {
        file.settle_periods()?;
        file.plant()?;
        file.scheme(model, true)?;
        file.scheme(model, false)
    });
    let faults = [alone.err(), within.err(), of_loop.err()];
    for fault in faults.iter().flatten() {
        refused(fault);
    }
    if faults.iter().all(Option::is_some) { Verdict::Refused } else { Verdict::Answered }
}

/// The campaign from which files are written that others change.
struct Written {
    session: Session,
    prepared: Prepared,
    manifest: Manifest,
    trial: Trial,
    /// `campaign.json`, manifest and samples of a run.
    manifests: String,
    play: String,
    parameters: String,
}

/// Samples in the runs that are changed.
const SAMPLES: usize = 12;

fn written() -> &'static Written {
    static FOUND: OnceLock<Written> = OnceLock::new();
    FOUND.get_or_init(|| {
        let declared = model(0).clone();
        let mut experiment = Experiment::parse(&shipped("mass_spring_drag.toml")).expect("a shipped experiment");
        experiment.schedule.max_runs = 2;
        experiment.schedule.measure_time = 4.0;
        let source = tpm_codegen::Source::new("model.tpm", shipped("mass_spring_drag.tpm"));
        let parsed = tpm_codegen::parse_model(&source).expect("a shipped model");
        let prepared = prepare(parsed.model).expect("a regressor form");
        let session = Session::new(declared, experiment, None, BTreeMap::new()).expect("a session");
        let plant = session.machine().plant();
        let trial = session.campaign().expect("a campaign").0.next().expect("a run").clone();
        let found = session.identify(None, &mut |_, _, _| true).expect("a result");
        let manifest = Manifest::new("MassSpringDrag", b"model", b"experiment");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let store = Store::open(folder.path(), &manifest).expect("a store");
        let waves = |factor: f64| vec![(0..SAMPLES).map(|n| factor * (n as f64).sin()).collect::<Vec<f64>>()];
        let ending = Ending::Stopped { sample: SAMPLES - 1 };
        let record = Record::new(trial.control.sample_time, waves(0.1), waves(3.0), ending);
        store.append(plant, &trial, &record, None, None).expect("kept");
        let file = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("written");
        // A checksum refuses every change; earlier versions wrote none, so that the readers behind it are reached without.
        let open = |text: String| match text.rsplit_once(",\n  \"checksum\"") {
            Some((before, _)) => format!("{before}\n}}\n"),
            None => text,
        };
        let manifests = [open(file("campaign.json")), open(file("run-001.json")), file("run-001.csv")].join(NEXT_FILE);
        let samples: Vec<String> = trial_samples(plant, &trial).lines().take(SAMPLES + 1).map(str::to_owned).collect();
        let terms = serde_json::to_string_pretty(&RunFile::new(plant, &trial, 3)).expect("plain values");
        let play = [terms, samples.join("\n")].join(NEXT_FILE);
        let parameters = serde_json::to_string_pretty(&found).expect("plain values");
        Written { session, prepared, manifest, trial, manifests, play, parameters }
    })
}

/// A kept text of a folder, or the one that was written, bent.
fn changed(random: &mut Random, bases: &Bases, folder: &str, own: &str) -> String {
    let bases = bases.get_or_init(|| [vec![own.to_owned()], kept(folder, "")]);
    bent(base(random, bases), random)
}

/// The result of an identification, bent.
pub(super) fn parameters_text(random: &mut Random) -> String {
    static BASES: Bases = OnceLock::new();
    changed(random, &BASES, "fuzz/corpus/parameters", &written().parameters)
}

/// Parameters as generators and predictions read them.
pub(super) fn parameters(text: &str) -> Verdict {
    let found = match Identified::from_json(text) {
        Ok(found) => found,
        Err(fault) => return refused(&fault),
    };
    if let Err(fault) = found.settled() {
        refused(&fault);
    }
    let prepared = &written().prepared;
    match found.in_order(&prepared.model, &prepared.form) {
        Ok(_) => Verdict::Answered,
        Err(fault) => refused(&fault),
    }
}

thread_local! {
    /// A folder of this thread, which goes when the thread ends.
    static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a temporary folder");
}

/// The parts of a text as files of this thread's folder.
fn laid_out(text: &str, names: &[&str]) -> PathBuf {
    let mut parts = text.split(NEXT_FILE);
    FOLDER.with(|folder| {
        for name in names {
            std::fs::write(folder.path().join(name), parts.next().unwrap_or_default()).expect("writable");
        }
        folder.path().to_owned()
    })
}

/// A campaign's manifests with the samples of a run, bent. In nine texts of ten the samples are those that the manifest names.
pub(super) fn manifests_text(random: &mut Random) -> String {
    static BASES: Bases = OnceLock::new();
    let own = &written().manifests;
    let text = changed(random, &BASES, "fuzz/corpus/manifests", own);
    let hash = own.rsplit_once("samples_hash\": \"").map_or("", |(_, rest)| rest.split('"').next().unwrap_or_default());
    match text.rsplit_once(NEXT_FILE) {
        Some((before, samples)) if !hash.is_empty() && random.below(10) > 0 => {
            let before = before.replace(hash, &fingerprint(samples.as_bytes()));
            [&before, samples].join(NEXT_FILE)
        }
        _ => text,
    }
}

/// The folder of a campaign.
pub(super) fn manifests(text: &str) -> Verdict {
    let folder = laid_out(text, &["campaign.json", "run-001.json", "run-001.csv"]);
    let Written { session, manifest, .. } = written();
    let store = match Store::open(&folder, manifest) {
        Ok(store) => store,
        Err(fault) => return refused(&fault),
    };
    let answers = [
        store.records(session.machine().plant()).map(|_| ()),
        store.fingerprints().map(|_| ()),
        store.is_simulated().map(|_| ()),
    ];
    match answers.into_iter().collect::<Result<Vec<_>, _>>() {
        Ok(_) => Verdict::Answered,
        Err(fault) => refused(&fault),
    }
}

/// The terms and samples of a run to play, bent.
pub(super) fn play_text(random: &mut Random) -> String {
    static BASES: Bases = OnceLock::new();
    changed(random, &BASES, "fuzz/corpus/plays", &written().play)
}

/// A run that the simulated machine plays from files.
pub(super) fn play(text: &str) -> Verdict {
    let folder = laid_out(text, &["play.json", "play.csv"]);
    let Written { session, trial, .. } = written();
    let played = match read_trial(&folder.join("play.csv"), session.machine().plant(), trial) {
        Ok(played) => played,
        Err(fault) => return refused(&fault),
    };
    match session.simulate(&played) {
        Ok(_) => Verdict::Answered,
        Err(fault) => refused(&fault),
    }
}
