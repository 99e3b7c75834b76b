//! Progress of a study, kept in a folder: a study that was stopped or killed continues from there, and has the result
//! of an uninterrupted one.
//!
//! Invariant: the folder's `study.json` holds the campaigns of the first seeds, whose number it states, and no later
//! ones. The file is written completely or not at all, and identifies the model, experiment and program to which it
//! belongs.

use crate::campaigns::{Study, study_from};
use crate::tally::Tally;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::{Duration, Instant};
use tpm_campaign::{Lock, StoreError, read_json, write_json};
use tpm_controller::model::Model as _;
use tpm_log::fingerprint;
use tpm_session::{Session, SessionError};

const KEPT: &str = "tpm.kept-study/1";

/// Most computing time that is lost when a study is killed.
const BETWEEN_WRITES: Duration = Duration::from_secs(1);

/// Contents of the file of a study, from which the study can be continued.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptStudy {
    schema: String,
    /// Name of the model.
    model: String,
    model_hash: String,
    experiment_hash: String,
    version: String,
    tally: Tally,
}

impl KeptStudy {
    fn new(session: &Session) -> Result<Self, SessionError> {
        let (plant, bounds) = (session.machine().plant(), session.bounds());
        let mut experiment = session.written().text()?;
        if !bounds.is_empty() {
            experiment.push_str(&format!("{bounds:?}"));
        }
        Ok(Self {
            schema: KEPT.to_string(),
            model: plant.name().to_string(),
            model_hash: fingerprint(session.model().text().text().as_bytes()),
            experiment_hash: fingerprint(experiment.as_bytes()),
            version: env!("CARGO_PKG_VERSION").to_string(),
            tally: Tally::new(plant, session.experiment()),
        })
    }

    /// The kept study if it belongs to this one.
    ///
    /// # Errors
    /// [`StoreError`] when the file belongs to another study, or to one of more campaigns.
    fn restored(self, path: &Path, campaigns: usize) -> Result<Self, StoreError> {
        let found: Self = read_json(path, KEPT)?;
        let broken = |reason: String| StoreError::Broken { path: path.display().to_string(), reason };
        for (what, found, given) in [
            ("model", &found.model_hash, &self.model_hash),
            ("experiment", &found.experiment_hash, &self.experiment_hash),
            ("version of the program", &found.version, &self.version),
        ] {
            if found != given {
                let path = path.display().to_string();
                return Err(StoreError::Other { path, what, found: found.clone(), given: given.clone() });
            }
        }
        if !found.tally.fits(&self.tally) {
            return Err(broken("the parameters are not those of the model; begin in another folder".to_string()));
        }
        let held = found.tally.campaigns();
        if held > campaigns {
            return Err(broken(format!(
                "this study has {held} campaigns already, and {campaigns} were asked for; ask for {held} or more, or begin in another folder"
            )));
        }
        Ok(found)
    }
}

/// Repeats the experiment of a session as [`study_session`](crate::study_session) does, and keeps its progress in a
/// folder, which is created when it does not exist. A study that was stopped continues from there, as does one whose
/// number of campaigns was raised.
///
/// # Errors
/// [`SessionError`] of the first seed whose campaign fails; a [`StoreError`] within it when the folder holds another
/// study, or one of more campaigns, is in use, or cannot be read or written.
pub fn study_kept(
    session: &Session,
    folder: &Path,
    campaigns: usize,
    progress: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Study, SessionError> {
    // A loop that is not stable fails here, before the folder is created.
    session.campaign()?;
    let _lock = Lock::hold(folder)?;
    let path = folder.join("study.json");
    let mut kept = KeptStudy::new(session)?;
    if path.exists() {
        kept = kept.restored(&path, campaigns)?;
    }
    let mut written: Option<Instant> = None;
    let begun = kept.tally.clone();
    let mut keep = |tally: &Tally, ended: bool| {
        if ended || written.is_none_or(|at| at.elapsed() > BETWEEN_WRITES) {
            kept.tally.clone_from(tally);
            write_json(&path, &kept)?;
            written = Some(Instant::now());
        }
        Ok(())
    };
    study_from(session, Some(begun), campaigns, progress, &mut keep)
}

#[cfg(test)]
mod tests {
    use super::study_kept;
    use crate::study_session;
    use std::collections::BTreeMap;
    use tpm_experiment::Experiment;
    use tpm_session::{DeclaredModel, Session};

    fn session(seed: u64) -> Session {
        let mut experiment =
            Experiment::parse(include_str!("../../../../models/mass_spring_drag.toml")).expect("right");
        experiment.schedule.max_runs = 2;
        experiment.schedule.measure_time = 8.0;
        experiment.seed = seed;
        let model = include_str!("../../../../models/mass_spring_drag.tpm");
        let declared = DeclaredModel::parse("mass_spring_drag", model).expect("right");
        Session::new(declared, experiment, None, BTreeMap::new()).expect("a session")
    }

    #[test]
    fn a_study_goes_on_where_it_was_and_ends_as_the_unbroken_one() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let session = session(11);
        let unbroken = study_session(&session, 8, &|_| true).expect("runs");
        let stopped = study_kept(&session, folder.path(), 8, &|ended| ended < 3).expect("runs");
        assert!(stopped.campaigns < 8 && !stopped.warnings.is_empty(), "{stopped:?}");
        let first = std::sync::atomic::AtomicUsize::new(usize::MAX);
        let progress = |ended: usize| {
            first.fetch_min(ended, std::sync::atomic::Ordering::Relaxed);
            true
        };
        assert_eq!(study_kept(&session, folder.path(), 8, &progress).expect("runs"), unbroken);
        // The campaigns that were kept were not repeated.
        assert_eq!(first.into_inner(), stopped.campaigns + 1);
        assert_eq!(study_kept(&session, folder.path(), 8, &|_| panic!("nothing is left")).expect("kept"), unbroken);
        let more = study_kept(&session, folder.path(), 10, &|_| true).expect("runs");
        assert_eq!(more, study_session(&session, 10, &|_| true).expect("runs"));
        let fewer = study_kept(&session, folder.path(), 8, &|_| true).expect_err("two would have to be taken back");
        assert!(fewer.to_string().contains("has 10 campaigns already, and 8 were asked for"), "{fewer}");
    }

    #[test]
    fn another_study_is_refused_by_name() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        study_kept(&session(11), folder.path(), 2, &|_| true).expect("runs");
        let other = study_kept(&session(12), folder.path(), 2, &|_| true).expect_err("another seed");
        assert!(other.to_string().contains("belongs to another experiment"), "{other}");
        let path = folder.path().join("study.json");
        let text = std::fs::read_to_string(&path).expect("readable");
        for (changed, said) in [
            (text.replacen("\"campaigns\": 2", "\"campaigns\": 1", 1), "was changed after it was written"),
            (text.replacen("tpm.kept-study/1", "tpm.run/1", 1), "no manifest of the form tpm.kept-study/1"),
            (text[..text.len() / 2].to_string(), "EOF"),
        ] {
            assert_ne!(changed, text);
            std::fs::write(&path, changed).expect("writable");
            let refused = study_kept(&session(11), folder.path(), 2, &|_| true).expect_err("changed").to_string();
            assert!(refused.contains(said), "{refused}");
        }
    }
}
