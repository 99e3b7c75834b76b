//! A campaign that lives in a folder, and goes on by files: what to play next goes out, logs come in.

use crate::campaign::{ExperimentRequest, Session};
use crate::error::SessionError;
use crate::identification::{Identification, Source};
use crate::log::LogRequest;
use crate::model::DeclaredModel;
use crate::play::Watch;
use std::collections::BTreeMap;
use std::path::Path;
use tpm_campaign::{
    Lock, LogFingerprints, Manifest, NearMode, Outcome, RunFile, RunReport, Store, StoreError, samples_text,
    trial_samples,
};
use tpm_controller::model::Model as _;
use tpm_estimate::Sensor;
use tpm_experiment::Experiment;
use tpm_log::{Log, fingerprint};
use tpm_motion::{Ending, Record, RunEnding, Trial};
use tpm_report::write_whole;

/// The model, as it was when the campaign began.
const MODEL: &str = "model.tpm";
/// The experiment with all changes.
const EXPERIMENT: &str = "experiment.toml";

/// A campaign in a folder: model, experiment, and every finished run.
#[derive(Clone, Debug)]
pub struct CampaignFolder {
    session: Session,
    store: Store,
}

/// How a campaign goes on.
#[derive(Clone, Debug, PartialEq)]
pub enum NextStep {
    /// The machine plays this run.
    Play(Box<NextRun>),
    /// Nothing is left to play, for this reason.
    Ended(Outcome),
}

/// What the machine plays next.
#[derive(Clone, Debug, PartialEq)]
pub struct NextRun {
    /// The run itself.
    pub trial: Trial,
    /// Its samples, as CSV: time, reference with its derivatives, feed-forward.
    pub samples: String,
    /// Its terms: feedback, limits, timing.
    pub terms: RunFile,
    /// A harmonic of the run near a natural mode of the estimates; nothing where no harmonic is.
    pub near_mode: Option<NearMode>,
}

/// What became of a submitted run.
#[derive(Debug)]
pub struct Submission {
    /// The run.
    pub run: RunReport,
    /// Whether the run is kept; one in which a sensor gave no value is not, and is played again.
    pub kept: bool,
    /// Why the campaign has ended; nothing while it goes on.
    pub outcome: Option<Outcome>,
    /// What all runs say so far. A fault here takes nothing back: a run that is kept stays.
    pub result: Result<Identification, SessionError>,
}

impl CampaignFolder {
    /// Begins the campaign of a session in a folder, which is made when it is not there; goes on with it when the folder holds it
    /// already. The loop must be stable.
    ///
    /// # Errors
    /// [`SessionError`]; [`StoreError::Other`] when the folder holds another campaign.
    pub fn begin(folder: &Path, session: Session) -> Result<Self, SessionError> {
        session.campaign()?;
        let _lock = Lock::hold(folder)?;
        let store = store(folder, &session)?;
        Ok(CampaignFolder { session, store })
    }

    /// Begins the campaign of a session in a folder or goes on with it, as [`begin`](Self::begin) does, and plays it on the simulated
    /// machine.
    ///
    /// # Errors
    /// [`SessionError`]; [`StoreError::Other`] when the folder holds another campaign.
    pub fn identify(folder: &Path, session: &Session, watch: &mut Watch<'_>) -> Result<Identification, SessionError> {
        // A loop that is not stable leaves no folder behind.
        let stable = session.campaign()?;
        let _lock = Lock::hold(folder)?;
        let store = store(folder, session)?;
        session.play_simulated(stable, Some(&store), watch)
    }

    /// Opens the campaign in a folder. `bounds` are those of physical parameters behind lumped ones.
    ///
    /// # Errors
    /// [`SessionError::NoCampaign`] when there is none.
    pub fn open(folder: &Path, bounds: BTreeMap<String, (f64, f64)>) -> Result<Self, SessionError> {
        if !folder.join("campaign.json").exists() {
            return Err(SessionError::NoCampaign { path: folder.display().to_string() });
        }
        let file = folder.join(MODEL);
        let request = ExperimentRequest { file: Some(folder.join(EXPERIMENT)), bounds, ..ExperimentRequest::default() };
        let session = Session::open(DeclaredModel::open(&file)?, &file, &request)?;
        let store = store(folder, &session)?;
        Ok(CampaignFolder { session, store })
    }

    /// The model with its experiment.
    #[must_use]
    pub const fn session(&self) -> &Session {
        &self.session
    }

    /// The finished runs.
    #[must_use]
    pub const fn store(&self) -> &Store {
        &self.store
    }

    /// What to play next, or why nothing is left to play.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn next(&self) -> Result<NextStep, SessionError> {
        let (campaign, _) = self.session.restored(&self.store)?;
        let Some(trial) = campaign.next() else {
            let outcome = campaign.outcome().expect("invariant: a campaign without a next run has an outcome");
            return Ok(NextStep::Ended(outcome));
        };
        let plant = self.session.machine().plant();
        Ok(NextStep::Play(Box::new(NextRun {
            samples: trial_samples(plant, trial),
            terms: RunFile::new(plant, trial, campaign.setup().procedure.settle_periods),
            near_mode: campaign.next_near_mode(),
            trial: trial.clone(),
        })))
    }

    /// Takes in the log of the run that [`next`](Self::next) gave: columns `t_s`, coordinates and applied inputs by name, measured
    /// rates, if any, in columns like `dot(x)`. Of the request only what concerns columns is used. A log that ends early because a
    /// bound was passed, or because the machine `stopped` the run for a reason that the log does not show, makes the campaign back
    /// off. A run that contradicts the earlier ones is kept, and the submission says so.
    ///
    /// # Errors
    /// [`SessionError`]; [`SessionError::SameLog`] for a log whose bytes, or whose samples, are those of a run that is kept, unless
    /// that run played the same and the record has no noise. The campaign is then as it was before.
    pub fn submit(&self, log: impl Into<LogRequest>, stopped: bool) -> Result<Submission, SessionError> {
        let request = log.into();
        let _lock = Lock::hold(self.store.folder())?;
        let (mut campaign, stability) = self.session.restored(&self.store)?;
        let plant = self.session.machine().plant();
        let Some(trial) = campaign.next().cloned() else { return Err(SessionError::Ended) };
        let path = request.path.display().to_string();
        let (measured, rates) = Log::open_rated(request.source(), plant, &request.reading.columns)?;
        let mut coordinates = measured.channels;
        let inputs = coordinates.split_off(plant.dims().coordinates);
        let fault =
            |error: &dyn std::fmt::Display| SessionError::File { path: path.clone(), message: error.to_string() };
        let whole = Record {
            rates: rates.clone(),
            ..Record::new(trial.control.sample_time, coordinates.clone(), inputs.clone(), Ending::Complete)
        };
        let own = LogFingerprints {
            bytes: request.source().fingerprint()?,
            samples: fingerprint(samples_text(plant, &whole).as_bytes()),
        };
        // A machine without noise records the same samples whenever it is asked for the same.
        let noisy = || whole.coordinates.iter().any(|channel| Sensor::of(&[channel]).noisy);
        if let Some((run, same)) = self.store.run_with(&own, &trial)?
            && (!same || noisy())
        {
            return Err(SessionError::SameLog { path, run, next: campaign.runs().len() + 1 });
        }
        let record = Record::of_samples(&trial, measured.sample_time, coordinates, inputs, rates, stopped)
            .map_err(|source| SessionError::Record { path: path.clone(), source })?;
        let run = campaign.submit(&record).map_err(|error| fault(&error))?.clone();
        let kept = run.ending != RunEnding::SensorLost;
        if kept {
            self.store.append(plant, &trial, &record, None, Some(own))?;
        }
        let result = self.session.result(&campaign, stability, Source::Folder, Some(&self.store));
        Ok(Submission { run, kept, outcome: campaign.outcome(), result })
    }

    /// The folder whose results say how the method came to the parameters.
    #[must_use]
    pub fn showing_method(self) -> Self {
        CampaignFolder { session: self.session.showing_method(), ..self }
    }

    /// What all runs of the folder say.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn result(&self) -> Result<Identification, SessionError> {
        self.session.result_of(&self.store)
    }

    /// What all runs of the folder say, with the samples of every run handed out.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn result_watched(&self, watch: &mut Watch<'_>) -> Result<Identification, SessionError> {
        self.session.result_watched(&self.store, watch)
    }
}

/// The store of a session's campaign in a folder, with model and experiment beside it, which are written where they are not there.
fn store(folder: &Path, session: &Session) -> Result<Store, SessionError> {
    let (model, name) = (session.model().text().text(), session.machine().plant().name());
    let manifest = |experiment: &Experiment| -> Result<(Manifest, String), SessionError> {
        let text = experiment.text()?;
        Ok((Manifest::new(name, model.as_bytes(), text.as_bytes()), text))
    };
    let (own, text) = manifest(session.written())?;
    // Folders of earlier versions hold the experiment in the parameters that the model is linear in.
    let (translated, translated_text) = manifest(session.experiment())?;
    let found = if folder.join("campaign.json").exists() { Some(Manifest::read(folder)?) } else { None };
    let earlier = found.is_some_and(|found| {
        found.experiment_hash == translated.experiment_hash && found.experiment_hash != own.experiment_hash
    });
    let (manifest, text) = if earlier { (translated, translated_text) } else { (own, text) };
    let store = Store::open(folder, &manifest)?;
    for (file, text) in [(MODEL, model), (EXPERIMENT, text.as_str())] {
        let path = folder.join(file);
        if !path.exists() {
            write_whole(&path, text.as_bytes())
                .map_err(|error| StoreError::Io { path: path.display().to_string(), reason: error.to_string() })?;
        }
    }
    Ok(store)
}
