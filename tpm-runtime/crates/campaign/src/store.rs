//! A campaign on disk: its model and experiment, and every finished run.
//!
//! A folder holds `campaign.json`, and per run `run-001.csv` (time, coordinates, inputs) with its manifest `run-001.json`.
//! Invariant: a run counts when its manifest exists and holds the hash of its samples. The manifest is written last.
//! Samples and manifest are written to a temporary file, which is renamed when complete. Numbers are written with
//! enough digits to be read back exactly, so that a campaign that is resumed from a folder equals the unbroken one.

use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use tpm_controller::model::Model;
use tpm_log::{fingerprint, rate_column};
use tpm_motion::smoothing::Smoothing;
use tpm_motion::{Ending, GainManifest, Record, RunEnding, Trial};
use tpm_report::{is_special, read_input, read_text, write_whole};

/// Schema of the manifest of a campaign.
const CAMPAIGN_SCHEMA: &str = "tpm.campaign/1";
/// Schema of the manifest of a run.
const RUN_SCHEMA: &str = "tpm.run/1";

/// Most bytes of the file with a run's samples: several channels of the largest number of samples that a run may have.
const MOST_SAMPLES_BYTES: u64 = 4 << 30;

/// The model and the experiment that a campaign belongs to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// `tpm.campaign/1`.
    pub schema: String,
    /// Name of the model.
    pub model: String,
    /// Hash of the model file.
    pub model_hash: String,
    /// Hash of the experiment with all its overrides.
    pub experiment_hash: String,
    /// Version of the program that began the campaign.
    pub version: String,
}

impl Manifest {
    /// The manifest of a campaign that begins now.
    #[must_use]
    pub fn new(model: &str, model_text: &[u8], experiment_text: &[u8]) -> Self {
        Manifest {
            schema: CAMPAIGN_SCHEMA.to_string(),
            model: model.to_string(),
            model_hash: fingerprint(model_text),
            experiment_hash: fingerprint(experiment_text),
            version: env!("CARGO_PKG_VERSION").to_string(),
        }
    }
}

impl Manifest {
    /// Reads the manifest of the campaign in a folder.
    ///
    /// # Errors
    /// [`StoreError`] when there is no manifest, or the file is not one.
    pub fn read(folder: &Path) -> Result<Self, StoreError> {
        read_json(&folder.join("campaign.json"), CAMPAIGN_SCHEMA)
    }
}

/// Largest difference of a parameter, as a share of it, that no record shows.
const SAME_PARAMETER: f64 = 1e-6;

/// Everything about a run except its samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunManifest {
    /// `tpm.run/1`.
    pub schema: String,
    /// Number of the run, from 1.
    pub run: usize,
    /// Name of the model.
    pub model: String,
    /// Hash of the model file.
    pub model_hash: String,
    /// Hash of the experiment.
    pub experiment_hash: String,
    /// Version of the program.
    pub version: String,
    /// Seed of the simulated noise; nothing for a real machine.
    pub seed: Option<u64>,
    /// Name of the stage's pattern, where the stage has its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern: Option<String>,
    /// Amplitudes of the pattern.
    pub amplitudes: Vec<f64>,
    /// Fundamental frequency, rad/s.
    pub frequency: f64,
    /// The feedback.
    pub feedback: Vec<GainManifest>,
    /// Time constant of the filtered difference that forms the rates, s; nothing when no such filter is used.
    pub derivative_filter: Option<f64>,
    /// Time constant of the low pass of positions before the feedback, s; nothing when there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_filter: Option<f64>,
    /// Least-squares smoothing of errors and rates, where there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<Smoothing>,
    /// Parameters with which the feed-forward was computed, in the machine's order.
    pub parameters: Vec<f64>,
    /// Time between samples, s.
    pub sample_time: f64,
    /// Samples in a period.
    pub samples_per_period: usize,
    /// Samples in the record.
    pub samples: usize,
    /// How the run ended.
    pub ending: RunEnding,
    /// Where a run passed a bound: the coordinate, and its tracking error, position or velocity there.
    pub passed: Option<(usize, f64)>,
    /// Samples in which an input was cut at its limit.
    pub saturated: usize,
    /// Hash of the samples' file.
    pub samples_hash: String,
    /// Fingerprints of the log that the run was read from; nothing for a run that was not submitted as a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log: Option<LogFingerprints>,
}

/// Fingerprints by which the log of a run is recognised.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogFingerprints {
    /// Hash of the file's bytes.
    pub bytes: String,
    /// Hash of the samples in the form of [`samples_text`], which does not depend on the format of the file.
    pub samples: String,
}

impl RunManifest {
    /// Whether the run played what a trial plays: the same reference and feed-forward, by the same experiment.
    fn played(&self, trial: &Trial) -> bool {
        self.pattern == trial.pattern
            && self.amplitudes == trial.amplitudes
            && self.frequency == trial.trajectory.frequency
            && self.parameters.len() == trial.parameters.len()
            && self
                .parameters
                .iter()
                .zip(&trial.parameters)
                .all(|(own, other)| (own - other).abs() <= SAME_PARAMETER * own.abs().max(other.abs()))
            && self.samples_per_period == trial.samples_per_period
    }

    /// Whether the run was read from this log: the bytes or the samples are equal.
    fn holds(&self, log: &LogFingerprints) -> bool {
        let own = self.log.as_ref().map_or([&self.samples_hash; 2], |own| [&own.bytes, &own.samples]);
        own.into_iter().chain([&self.samples_hash]).any(|hash| *hash == log.bytes || *hash == log.samples)
    }
}

/// Why a campaign's folder cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    /// Reading or writing failed; earlier files are unchanged.
    #[error("{path}: {reason}; finished runs are kept, and the campaign goes on from them")]
    Io {
        /// The file.
        path: String,
        /// The system's reason.
        reason: String,
    },
    /// A file does not have the content that it must have.
    #[error("{path}: {reason}")]
    Broken {
        /// The file.
        path: String,
        /// What is wrong with the file.
        reason: String,
    },
    /// Another process works in the folder.
    #[error("{path} is in use by {by}; wait until it has ended, or use another folder")]
    Held {
        /// The folder.
        path: String,
        /// Who works there.
        by: String,
    },
    /// The folder belongs to a campaign with another model or experiment.
    #[error(
        "{path} belongs to another {what} ({found}, not {given}); use another folder, or the files that it began with"
    )]
    Other {
        /// The manifest of the folder.
        path: String,
        /// `model` or `experiment`.
        what: &'static str,
        /// What the manifest states.
        found: String,
        /// What was given.
        given: String,
    },
}

/// A campaign's folder.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
    manifest: Manifest,
}

impl Store {
    /// Opens the folder of a campaign, or begins a campaign in a folder that holds none; the folder is created when it
    /// does not exist.
    ///
    /// # Errors
    /// [`StoreError::Other`] when the folder's campaign has another model or experiment; another [`StoreError`] when
    /// the folder or its manifest cannot be read or written.
    pub fn open(folder: &Path, manifest: &Manifest) -> Result<Self, StoreError> {
        let path = folder.join("campaign.json");
        if path.exists() {
            let found = Manifest::read(folder)?;
            let different = [
                ("model", &found.model_hash, &manifest.model_hash),
                ("experiment", &found.experiment_hash, &manifest.experiment_hash),
            ];
            for (what, found, given) in different {
                if found != given {
                    let path = path.display().to_string();
                    return Err(StoreError::Other { path, what, found: found.clone(), given: given.clone() });
                }
            }
            return Ok(Store { folder: folder.to_path_buf(), manifest: found });
        }
        fs::create_dir_all(folder).map_err(|error| io(folder, &error))?;
        write_json(&path, manifest)?;
        Ok(Store { folder: folder.to_path_buf(), manifest: manifest.clone() })
    }

    /// Path of the folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The finished runs, in their order.
    ///
    /// # Errors
    /// [`StoreError`] when a run with a manifest is not complete, or belongs to another model or experiment.
    pub fn records(&self, model: &dyn Model<f64>) -> Result<Vec<Record>, StoreError> {
        let mut records = Vec::new();
        loop {
            let (samples, manifest) = self.paths(records.len() + 1);
            if !manifest.exists() {
                return Ok(records);
            }
            let run: RunManifest = read_json(&manifest, RUN_SCHEMA)?;
            for (what, found, given) in [
                ("model", &run.model_hash, &self.manifest.model_hash),
                ("experiment", &run.experiment_hash, &self.manifest.experiment_hash),
            ] {
                if found != given {
                    let path = manifest.display().to_string();
                    return Err(StoreError::Other { path, what, found: found.clone(), given: given.clone() });
                }
            }
            refuse_special(&samples)?;
            let text = read_input(&samples, MOST_SAMPLES_BYTES).map_err(|error| io(&samples, &error))?;
            if fingerprint(&text) != run.samples_hash {
                return Err(broken(&samples, "the samples are not those of the manifest beside them"));
            }
            records.push(read_samples(&samples, &text, model, &run)?);
        }
    }

    /// File name and fingerprint of the samples of every finished run, in the order of the runs.
    ///
    /// # Errors
    /// [`StoreError`] when a manifest cannot be read.
    pub fn fingerprints(&self) -> Result<Vec<(String, String)>, StoreError> {
        let named = |run: RunManifest| (file_name(&self.paths(run.run).0), run.samples_hash);
        Ok(self.manifests()?.into_iter().map(named).collect())
    }

    /// Number of the finished run that already holds the samples of a log, and whether it played what `trial` plays again; nothing when
    /// there is none.
    ///
    /// # Errors
    /// [`StoreError`] when a manifest cannot be read.
    pub fn run_with(&self, log: &LogFingerprints, trial: &Trial) -> Result<Option<(usize, bool)>, StoreError> {
        Ok(self.manifests()?.iter().find(|run| run.holds(log)).map(|run| (run.run, run.played(trial))))
    }

    fn manifests(&self) -> Result<Vec<RunManifest>, StoreError> {
        let mut found = Vec::new();
        loop {
            let (_, manifest) = self.paths(found.len() + 1);
            if !manifest.exists() {
                return Ok(found);
            }
            found.push(read_json(&manifest, RUN_SCHEMA)?);
        }
    }

    /// Whether every finished run was played on a simulated machine; false where there is no run.
    ///
    /// # Errors
    /// [`StoreError`] when a manifest cannot be read.
    pub fn is_simulated(&self) -> Result<bool, StoreError> {
        for run in 1.. {
            let (_, manifest) = self.paths(run);
            if !manifest.exists() {
                return Ok(run > 1);
            }
            if read_json::<RunManifest>(&manifest, RUN_SCHEMA)?.seed.is_none() {
                break;
            }
        }
        Ok(false)
    }

    /// Writes a finished run to the folder. A run of a simulated machine has the seed of its noise; a run that was
    /// submitted as a file has the fingerprints of its log.
    ///
    /// # Errors
    /// [`StoreError::Io`] when a file cannot be written. The run is then not in the folder; all earlier runs are.
    pub fn append(
        &self,
        model: &dyn Model<f64>,
        trial: &Trial,
        record: &Record,
        seed: Option<u64>,
        log: Option<LogFingerprints>,
    ) -> Result<(), StoreError> {
        let text = samples_text(model, record);
        let passed = match record.ending {
            Ending::TrackingBound { coordinate, error: beyond, .. }
            | Ending::PositionBound { coordinate, position: beyond, .. }
            | Ending::VelocityBound { coordinate, velocity: beyond, .. } => Some((coordinate, beyond)),
            Ending::Stopped { .. } | Ending::Complete | Ending::SensorLost { .. } | Ending::Diverged { .. } => None,
        };
        let manifest = RunManifest {
            schema: RUN_SCHEMA.to_string(),
            run: trial.run + 1,
            model: self.manifest.model.clone(),
            model_hash: self.manifest.model_hash.clone(),
            experiment_hash: self.manifest.experiment_hash.clone(),
            version: env!("CARGO_PKG_VERSION").to_string(),
            seed,
            pattern: trial.pattern.clone(),
            amplitudes: trial.amplitudes.clone(),
            frequency: trial.trajectory.frequency,
            feedback: GainManifest::all(model, &trial.control.gains),
            derivative_filter: trial.control.velocity.time_constant(),
            position_filter: trial.control.low_pass_time(),
            smoothing: trial.control.velocity.smoothing(),
            parameters: trial.parameters.clone(),
            sample_time: record.sample_time,
            samples_per_period: trial.samples_per_period,
            samples: record.len(),
            ending: record.ending.kind(),
            passed,
            saturated: record.saturated,
            samples_hash: fingerprint(text.as_bytes()),
            log,
        };
        let (samples, path) = self.paths(trial.run + 1);
        keep(&samples, text.as_bytes())?;
        write_json(&path, &manifest)
    }

    fn paths(&self, run: usize) -> (PathBuf, PathBuf) {
        (self.folder.join(format!("run-{run:03}.csv")), self.folder.join(format!("run-{run:03}.json")))
    }
}

/// Time, coordinates and inputs as CSV, with enough digits to be read back exactly.
#[must_use]
pub fn samples_text(model: &dyn Model<f64>, record: &Record) -> String {
    let mut text = String::from("t_s");
    for c in 0..record.coordinates.len() {
        let _ = write!(text, ",{}", model.coordinate(c).name);
    }
    for i in 0..record.inputs.len() {
        let _ = write!(text, ",{}", model.input(i).name);
    }
    let rates = || record.rates.iter().enumerate().filter_map(|(c, rates)| Some((c, rates.as_ref()?)));
    for (c, _) in rates() {
        let _ = write!(text, ",{}", rate_column(model, c));
    }
    text.push('\n');
    for n in 0..record.len() {
        // Writing to a string cannot fail.
        let _ = write!(text, "{}", n as f64 * record.sample_time);
        for channel in record.coordinates.iter().chain(&record.inputs).chain(rates().map(|(_, rates)| rates)) {
            let _ = write!(text, ",{}", channel[n]);
        }
        text.push('\n');
    }
    text
}

fn read_samples(path: &Path, text: &[u8], model: &dyn Model<f64>, run: &RunManifest) -> Result<Record, StoreError> {
    let dims = model.dims();
    // The number of samples in the manifest is not trusted: a row of the text has at least two bytes, which bounds the
    // allocation.
    let rows = run.samples.min(text.len() / 2);
    let mut channels = vec![Vec::with_capacity(rows); dims.coordinates + dims.inputs];
    let mut reader = csv::ReaderBuilder::new().from_reader(text);
    let head = reader.headers().map_err(|error| broken(path, &error.to_string()))?.clone();
    let measured = |c: usize| head.iter().any(|name| name == rate_column(model, c));
    let rated: Vec<bool> = (0..dims.coordinates).map(measured).collect();
    channels.resize(channels.len() + rated.iter().filter(|rated| **rated).count(), Vec::with_capacity(rows));
    for row in reader.records() {
        let row = row.map_err(|error| broken(path, &error.to_string()))?;
        if row.len() != channels.len() + 1 {
            return Err(broken(path, "the columns are not those of the model"));
        }
        for (channel, field) in channels.iter_mut().zip(row.iter().skip(1)) {
            channel.push(field.parse().map_err(|_| broken(path, &format!("`{field}` is not a number")))?);
        }
    }
    let found = channels.first().map_or(0, Vec::len);
    if found != run.samples {
        let reason = format!("the file has {found} samples, the manifest beside it says {}", run.samples);
        return Err(broken(path, &reason));
    }
    let mut rates = channels.split_off(dims.coordinates + dims.inputs).into_iter();
    let inputs = channels.split_off(dims.coordinates);
    let rates = if rates.len() > 0 {
        rated.iter().map(|rated| if *rated { rates.next() } else { None }).collect()
    } else {
        Vec::new()
    };
    let last = run.samples.saturating_sub(1);
    let lost = || channels.iter().position(|channel| channel.last().is_some_and(|value: &f64| value.is_nan()));
    let ending = match (run.ending, run.passed) {
        (RunEnding::Complete | RunEnding::Unsettled | RunEnding::Unfollowed, _) => Ending::Complete,
        (RunEnding::TrackingBound, Some((coordinate, error))) => {
            Ending::TrackingBound { coordinate, sample: last, error }
        }
        (RunEnding::PositionBound, Some((coordinate, position))) => {
            Ending::PositionBound { coordinate, sample: last, position }
        }
        (RunEnding::VelocityBound, Some((coordinate, velocity))) => {
            Ending::VelocityBound { coordinate, sample: last, velocity }
        }
        (RunEnding::Stopped, _) => Ending::Stopped { sample: last },
        (RunEnding::TrackingBound | RunEnding::PositionBound | RunEnding::VelocityBound, None) => {
            return Err(broken(path, "the manifest beside it does not say what passed its bound"));
        }
        (RunEnding::SensorLost, _) => Ending::SensorLost { coordinate: lost().unwrap_or(0), sample: last },
        (RunEnding::Diverged, _) => Ending::Diverged { sample: last },
    };
    Ok(Record { sample_time: run.sample_time, coordinates: channels, inputs, rates, ending, saturated: run.saturated })
}

/// Text before the checksum of a manifest. The checksum is the hash of everything before this text.
const CHECKSUM_PREFIX: &str = ",\n  \"checksum\": \"";

/// The text of a manifest with its checksum.
fn signed(value: &impl Serialize) -> String {
    let text = serde_json::to_string_pretty(value).expect("invariant: manifests hold plain values");
    let text = text.trim_end_matches("\n}");
    format!("{text}{CHECKSUM_PREFIX}{}\"\n}}\n", fingerprint(text.as_bytes()))
}

/// Writes a manifest with its checksum, completely or not at all.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), StoreError> {
    keep(path, signed(value).as_bytes())
}

/// Reads a manifest with the given schema. The checksum must fit where there is one; earlier versions wrote none.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path, schema: &str) -> Result<T, StoreError> {
    refuse_special(path)?;
    let text = read_text(path).map_err(|error| io(path, &error))?;
    let mut value: serde_json::Value = serde_json::from_str(&text).map_err(|error| broken(path, &error.to_string()))?;
    if value["schema"] != schema {
        return Err(broken(path, &format!("this is no manifest of the form {schema}")));
    }
    let stated = value.as_object_mut().and_then(|fields| fields.remove("checksum"));
    let own = text.rsplit_once(CHECKSUM_PREFIX).map(|(before, _)| fingerprint(before.as_bytes()));
    if stated.is_some_and(|stated| own.is_none_or(|own| stated != own)) {
        return Err(broken(
            path,
            "the manifest was changed after it was written; restore it, or begin in another folder",
        ));
    }
    serde_json::from_value(value).map_err(|error| broken(path, &error.to_string()))
}

/// A store consists of regular files: reading a pipe could wait for ever, and a device must not be replaced.
fn refuse_special(path: &Path) -> Result<(), StoreError> {
    if is_special(path) {
        Err(broken(path, "this is a device or a pipe, not a file of a campaign; remove it"))
    } else {
        Ok(())
    }
}

/// The name of a file without its folder.
fn file_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

fn keep(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    refuse_special(path)?;
    write_whole(path, bytes).map_err(|error| io(path, &error))
}

fn io(path: &Path, error: &std::io::Error) -> StoreError {
    StoreError::Io { path: path.display().to_string(), reason: error.to_string() }
}

fn broken(path: &Path, reason: &str) -> StoreError {
    StoreError::Broken { path: path.display().to_string(), reason: reason.to_string() }
}
