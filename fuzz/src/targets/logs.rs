//! Logs: the reader, and what identifies from what it read.

use super::mutated::mutated;
use super::random::Random;
use super::{Verdict, random_log, refused, texts};
use std::path::PathBuf;
use std::sync::OnceLock;
use tpm_runtime::log::{Log, ReadingSettings, Recording};
use tpm_runtime::session::{DeclaredModel, Identifiable as _, LogRequest, from_log, inspect_for};

/// The models whose logs these could be.
const MODELS: [&str; 3] = [
    "model A { coordinate x [m]; input u [N]; parameter m [kg], k1 [N/m], k2 [N*s^2/m^2];
     m*ddot(x) + k1*x + k2*dot(x)^2 = u; }",
    "model A { coordinate x; input u; parameter m, d, c; m*ddot(x) + d*dot(x) + c*sign(dot(x)) = u; }",
    "model A { coordinate x; input u; parameter m, k, g; m*ddot(x) + k*sin(x) + g = u; }",
];

fn models() -> &'static [DeclaredModel] {
    static FOUND: OnceLock<Vec<DeclaredModel>> = OnceLock::new();
    FOUND.get_or_init(|| MODELS.iter().map(|text| DeclaredModel::parse("A", text).expect("a model")).collect())
}

/// The model that a text is read for: no text names one, so that its length chooses.
fn model_for(text: &str) -> &'static DeclaredModel {
    &models()[text.len() % MODELS.len()]
}

/// A log by the grammar, or a changed one.
pub(super) fn text(random: &mut Random) -> String {
    static KEPT: OnceLock<Vec<String>> = OnceLock::new();
    let kept = KEPT.get_or_init(|| texts("fuzz/corpus/logs", "").into_iter().map(|(_, text)| text).collect());
    let seed = random.next();
    match random.below(5) {
        0 if !kept.is_empty() => mutated(random.of::<String>(kept), seed),
        0 | 1 => mutated(&random_log::text(random), seed),
        _ => random_log::text(random),
    }
}

/// The reader, of a whole log and of its segments.
pub(super) fn log(text: &str) -> Verdict {
    let (model, options) = (model_for(text).evaluated(), ReadingSettings::default());
    let segments = Recording::read(text.as_bytes(), "log.csv", model, &options).map(|_| ());
    let whole = Log::read(text.as_bytes(), "log.csv", model, &options).map(|_| ());
    let faults = [segments.err(), whole.err()];
    for fault in faults.iter().flatten() {
        refused(fault);
    }
    if faults.iter().all(Option::is_some) { Verdict::Refused } else { Verdict::Answered }
}

thread_local! {
    /// A file of this thread, which goes when the thread ends.
    static FILE: (tempfile::TempDir, PathBuf) = {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("log.csv");
        (folder, path)
    };
}

/// What the log holds, and what a model is from it.
pub(super) fn identification(text: &str) -> Verdict {
    FILE.with(|(_, path)| {
        std::fs::write(path, text).expect("writable");
        let model = model_for(text);
        if let Err(fault) = inspect_for(model, LogRequest::new(path)) {
            refused(&fault);
        }
        match from_log(model, LogRequest::new(path)) {
            Ok(found) => {
                assert!(!found.parameters.is_empty(), "a result without a parameter");
                assert!(serde_json::to_string(&found).is_ok(), "a result that cannot be written");
                Verdict::Answered
            }
            Err(fault) => refused(&fault),
        }
    })
}
