//! What is tried: each target writes the text of a seed and reads it all the way. The tests of the workspace try a few seeds of every
//! target and the whole corpus; the program of this folder tries millions.

mod bench;
mod campaigns;
pub(crate) mod compiled;
mod editor;
#[allow(dead_code, reason = "forces alone are compared here")]
#[path = "../../../tpm-codegen/tests/whole/support/exact.rs"]
mod exact;
mod files;
mod logs;
mod machines;
mod models;
#[path = "../../../tests/support/mutated.rs"]
mod mutated;
mod paths;
#[path = "../../../tests/support/random.rs"]
mod random;
#[path = "../../../tests/support/random_log.rs"]
mod random_log;
#[path = "../../../tests/support/random_model.rs"]
mod random_model;
mod results;
mod stored;
mod values;

use random::Random;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What became of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It was refused, with an error that says why.
    Refused,
    /// It was refused because it would take too much work.
    TooLarge,
    /// It was read, and what is asked of it answered.
    Answered,
}

/// Something that reads texts.
pub(crate) struct Target {
    /// What it is called.
    pub(crate) name: &'static str,
    /// Folders of the kept texts.
    corpus: &'static [&'static str],
    /// How the names of their files end.
    ending: &'static str,
    text: fn(&mut Random) -> String,
    /// The longest time of an execution.
    #[allow(dead_code, reason = "builds of tests are not held to it")]
    pub(crate) longest: Duration,
    /// Reads a text all the way.
    pub(crate) read: fn(&str) -> Verdict,
}

/// Folders of models.
const MODELS: &[&str] = &[
    "fuzz/corpus/models",
    "models",
    "models/linkages",
    "models/robots",
    "tests/fixtures/emit",
    "tests/fixtures/language/fail",
    "tests/fixtures/language/pass",
];

/// Folders of logs.
const LOGS: &[&str] = &["fuzz/corpus/logs"];

/// The longest time of what reads a file.
const LONGEST: Duration = Duration::from_secs(2);

/// The longest time of an identification from a log, whose fits by simulation have a limit of their own.
const LONGEST_FIT: Duration = Duration::from_secs(10);

/// All targets.
pub(crate) const TARGETS: [Target; 26] = [
    Target {
        name: "language",
        corpus: MODELS,
        ending: ".tpm",
        text: models::text,
        longest: LONGEST,
        read: models::language,
    },
    Target {
        name: "expansion",
        corpus: MODELS,
        ending: ".tpm",
        text: models::text,
        longest: LONGEST,
        read: models::expansion,
    },
    Target {
        name: "generation",
        corpus: MODELS,
        ending: ".tpm",
        text: models::text,
        longest: LONGEST,
        read: models::generation,
    },
    Target { name: "log", corpus: LOGS, ending: ".csv", text: logs::text, longest: LONGEST, read: logs::log },
    Target {
        name: "identification",
        corpus: LOGS,
        ending: ".csv",
        text: logs::text,
        longest: LONGEST_FIT,
        read: logs::identification,
    },
    Target {
        name: "experiment",
        corpus: &["fuzz/corpus/experiments"],
        ending: ".toml",
        text: files::experiment_text,
        longest: LONGEST,
        read: files::experiment,
    },
    Target {
        name: "motors",
        corpus: &["fuzz/corpus/motors"],
        ending: ".toml",
        text: files::motors_text,
        longest: LONGEST,
        read: files::motors,
    },
    Target {
        name: "parameters",
        corpus: &["fuzz/corpus/parameters"],
        ending: ".txt",
        text: files::parameters_text,
        longest: LONGEST,
        read: files::parameters,
    },
    Target {
        name: "manifests",
        corpus: &["fuzz/corpus/manifests"],
        ending: ".txt",
        text: files::manifests_text,
        longest: LONGEST,
        read: files::manifests,
    },
    Target {
        name: "play",
        corpus: &["fuzz/corpus/plays"],
        ending: ".txt",
        text: files::play_text,
        longest: LONGEST,
        read: files::play,
    },
    Target {
        name: "linear",
        corpus: &["fuzz/corpus/machines"],
        ending: ".tpm",
        text: machines::machine_text,
        longest: LONGEST,
        read: machines::linear,
    },
    Target {
        name: "regulator",
        corpus: &["fuzz/corpus/machines"],
        ending: ".tpm",
        text: machines::machine_text,
        longest: LONGEST,
        read: machines::regulator,
    },
    Target {
        name: "strokes",
        corpus: &["fuzz/corpus/machines"],
        ending: ".tpm",
        text: machines::small_text,
        longest: LONGEST,
        read: machines::strokes,
    },
    Target {
        name: "description",
        corpus: &["fuzz/corpus/descriptions"],
        ending: ".urdf",
        text: machines::description_text,
        longest: LONGEST,
        read: machines::description,
    },
    Target {
        name: "editor",
        corpus: &["fuzz/corpus/editor"],
        ending: ".txt",
        text: editor::text,
        longest: LONGEST_FIT,
        read: editor::conversation,
    },
    Target {
        name: "machine_runs",
        corpus: &["fuzz/corpus/bench"],
        ending: ".txt",
        text: bench::runs_text,
        longest: LONGEST,
        read: bench::run,
    },
    Target {
        name: "machine_samples",
        corpus: &["fuzz/corpus/bench"],
        ending: ".txt",
        text: bench::samples_text,
        longest: LONGEST,
        read: bench::run,
    },
    Target {
        name: "results",
        corpus: &["fuzz/corpus/results"],
        ending: ".json",
        text: results::text,
        longest: LONGEST,
        read: results::comparison,
    },
    Target {
        name: "valid_experiment",
        corpus: &["fuzz/corpus/experiments"],
        ending: ".toml",
        text: campaigns::text,
        longest: LONGEST,
        read: files::experiment,
    },
    Target {
        name: "proposals",
        corpus: &["fuzz/corpus/experiments"],
        ending: ".toml",
        text: campaigns::short_text,
        longest: LONGEST_FIT,
        read: campaigns::proposals,
    },
    Target {
        name: "projection",
        corpus: &["fuzz/corpus/pairs"],
        ending: ".txt",
        text: results::models_text,
        longest: LONGEST,
        read: results::projected,
    },
    Target {
        name: "path",
        corpus: &["fuzz/corpus/paths"],
        ending: ".txt",
        text: paths::text,
        longest: LONGEST,
        read: paths::fitted,
    },
    Target {
        name: "stored",
        corpus: &["fuzz/corpus/stored"],
        ending: ".txt",
        text: stored::text,
        longest: LONGEST,
        read: stored::recording,
    },
    Target {
        name: "forces",
        corpus: &["fuzz/corpus/forces"],
        ending: ".tpm",
        text: values::text,
        longest: LONGEST,
        read: values::forces,
    },
    Target {
        name: "nonlinear",
        corpus: &["fuzz/corpus/forces"],
        ending: ".tpm",
        text: values::nonlinear_text,
        longest: LONGEST,
        read: values::forces,
    },
    Target {
        name: "compiled",
        corpus: &["fuzz/corpus/forces"],
        ending: ".tpm",
        text: compiled::text,
        longest: LONGEST,
        read: compiled::beside_exact,
    },
];

impl Target {
    /// The text of a seed.
    pub(crate) fn text(&self, seed: u64) -> String {
        (self.text)(&mut Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// The kept texts, with the names of their files.
    pub(crate) fn kept(&self) -> Vec<(PathBuf, String)> {
        self.corpus.iter().flat_map(|folder| texts(folder, self.ending)).collect()
    }
}

/// The texts of a folder of the repository whose names end so, in the order of their names.
fn texts(folder: &str, end: &str) -> Vec<(PathBuf, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.retain(|path| path.is_file() && path.to_string_lossy().ends_with(end));
    paths.sort();
    paths.into_iter().filter_map(|path| Some((path.clone(), std::fs::read_to_string(path).ok()?))).collect()
}

/// A refusal, which says why in a few lines.
fn refused(reason: &impl ToString) -> Verdict {
    let reason = reason.to_string();
    assert!(!reason.trim().is_empty(), "a refusal without a reason");
    assert!(reason.chars().count() < 4000, "a refusal of {} letters", reason.chars().count());
    Verdict::Refused
}
