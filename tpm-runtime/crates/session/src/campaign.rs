//! Campaigns: on a simulated machine, on a machine behind a [`Bench`], and from the runs that a folder keeps.

use crate::error::{MachineError, SessionError};
use crate::identification::{Identification, LogFingerprint, Source};
use crate::machine::Machine;
use crate::method_report;
use crate::model::{DeclaredModel, Identifiable, ModelFault, NonlinearParameter, with_all_coordinates};
use crate::options::LogOptions;
use crate::play::{Watch, play_campaign, play_on_simulated, play_simulated};
use crate::reading::RecordSettings;
use crate::refine_campaign::RunSimulation;
use crate::run_lines;
use crate::summary::{self, Lumped};
use crate::truth::Truth;
use crate::validate::{Validation, validate_run};
use crate::warning::Warning;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tpm_campaign::{Campaign, RunReport, Store};
use tpm_codegen::identified::Identified;
use tpm_controller::derivatives::RowDerivatives;
use tpm_estimate::{Domain, ParameterReport, Refine, Settings, Status};
use tpm_experiment::{ByLimits, Experiment, ExperimentError, Named, PlantModelSection, Value};
use tpm_interpret::Interpreted;
use tpm_log::{Log, fingerprint};
use tpm_motion::{Bench, BenchError, Record, Trial};
use tpm_physical::PhysicalSettings;
use tpm_plant::actuator::{FileFault, MotorFile};
use tpm_plant::stability::LoopStability;
use tpm_report::read_text;

/// Which experiment is meant, and what is changed in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExperimentRequest {
    /// The file; the one beside the model, of its name and ending in `.toml`, when not given.
    pub file: Option<PathBuf>,
    /// Keys of the experiment with their new values, such as `plant.parameters.m` and 3, in the units of the file.
    pub changes: Vec<(String, Value)>,
    /// Values at which parameters are held, beside those of the file.
    pub frozen: BTreeMap<String, f64>,
    /// Prior values, beside those of the file.
    pub prior: BTreeMap<String, f64>,
    /// Whether estimates are refined; what the file says when not given.
    pub refine: Option<Refine>,
    /// Name of the pattern to play; the experiment's, or the model's first, when not given.
    pub pattern: Option<String>,
    /// Least and largest value of a physical parameter behind lumped ones; infinite for none.
    pub bounds: BTreeMap<String, (f64, f64)>,
    /// Limits within which the campaign chooses its motions by itself; an experiment file is then not needed for a real machine.
    pub by_limits: Option<ByLimits>,
}

/// Identifies a model on the simulated machine of an experiment: the whole five-step procedure (Feng, chapter 3).
///
/// # Errors
/// [`SessionError`].
pub fn on_simulated_plant(model: &impl Identifiable, experiment: Experiment) -> Result<Identification, SessionError> {
    Session::new(declared(model)?, experiment, None, BTreeMap::new())?.identify(None, &mut |_, _, _| true)
}

/// Identifies a model on a machine that plays what it is given.
///
/// # Errors
/// [`SessionError`]; [`SessionError::Bench`] when the machine fails.
pub fn on_machine(
    model: &impl Identifiable,
    experiment: Experiment,
    bench: &mut dyn Bench,
) -> Result<Identification, SessionError> {
    Session::new(declared(model)?, experiment, None, BTreeMap::new())?.identify_on(bench, None, &mut |_, _, _| true)
}

fn declared(model: &impl Identifiable) -> Result<DeclaredModel, SessionError> {
    match model.declaration()? {
        Some(declared) => Ok(declared.into_owned()),
        None => Err(ModelFault::NoText { name: model.evaluated().name().to_string() }.into()),
    }
}

/// A model with an experiment that can be played on it.
#[derive(Clone, Debug)]
pub struct Session {
    declared: DeclaredModel,
    machine: Machine,
    /// As it was written: in physical parameters, if these are given.
    written: Experiment,
    /// In the parameters that the model is linear in.
    experiment: Experiment,
    bounds: BTreeMap<String, (f64, f64)>,
    /// Where the experiment stands, if it stands in a file.
    place: Option<String>,
    shows_method: bool,
}

impl Session {
    /// Reads an experiment and brings it together with a model that stands in a file.
    ///
    /// # Errors
    /// [`SessionError`], with the file at fault.
    pub fn open(model: DeclaredModel, file: &Path, request: &ExperimentRequest) -> Result<Self, SessionError> {
        let path = request.file.clone().unwrap_or_else(|| file.with_extension("toml"));
        let (experiment, motors) = read_experiment(&path, request)?;
        let as_read = request.changes.is_empty() && request.bounds.is_empty();
        let changed = if as_read { "" } else { " with the changes that were asked for" };
        // Where limits stand for a file there is none to name.
        let is_read = request.file.is_some() || path.exists();
        let place = is_read.then(|| format!("{}{changed}", path.display()));
        let limits = request.by_limits.as_ref();
        let session =
            Self::with_motors(model, experiment, request.pattern.as_deref(), request.bounds.clone(), (motors, limits))
                .map_err(|fault| fault.in_experiment(place.as_deref()))?;
        Ok(Session { place, ..session })
    }

    /// Brings a model and an experiment together; `pattern` names the pattern to play where the experiment's is not meant.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn new(
        model: DeclaredModel,
        experiment: Experiment,
        pattern: Option<&str>,
        bounds: BTreeMap<String, (f64, f64)>,
    ) -> Result<Self, SessionError> {
        Self::with_motors(model, experiment, pattern, bounds, (None, None))
    }

    /// Brings a model and limits together, within which the campaign chooses its motions by itself. The experiment states what else is
    /// known, such as the sample time ([`Experiment::bare`]), the feedback or a simulated machine.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn by_limits(model: DeclaredModel, experiment: Experiment, limits: &ByLimits) -> Result<Self, SessionError> {
        Self::with_motors(model, experiment, None, BTreeMap::new(), (None, Some(limits)))
    }

    fn with_motors(
        mut declared: DeclaredModel,
        mut written: Experiment,
        pattern: Option<&str>,
        bounds: BTreeMap<String, (f64, f64)>,
        (motors, limits): (Option<(PathBuf, MotorFile)>, Option<&ByLimits>),
    ) -> Result<Self, SessionError> {
        if let Some(pattern) = pattern {
            written.pattern = Some(pattern.to_string());
        }
        if let Some(limits) = limits {
            let middle = |name: &str| limits.limits.get(name).map_or(0.0, |(low, high)| (low + high) / 2.0);
            declared = declared.with_pattern(middle)?;
        }
        for NonlinearParameter { name, interval, .. } in declared.nonlinear() {
            if let Some(&value) = written.constants.get(&name)
                && !(interval[0]..=interval[1]).contains(&value)
            {
                let key = format!("constants.{name}");
                return Err(ExperimentError::OutsideInterval { key, value, interval }.into());
            }
        }
        let mut experiment = tpm_physical::lumped(&written, declared.prepared());
        if let Some(text) = written.plant_text()? {
            let (machine, values) = simulated_machine(text, &written)?;
            experiment.set_machine(Arc::new(machine), values);
        }
        let pattern = declared.pattern(experiment.pattern.as_deref())?;
        let machine = Machine::new(declared.prepared(), pattern, &experiment, &bounds)?;
        if let Some(limits) = limits {
            for own in [&mut experiment, &mut written] {
                own.by_limits(machine.plant(), machine.pattern(), limits)?;
            }
        }
        if let Some((path, motors)) = motors {
            experiment.check_motors(machine.plant(), &motors).map_err(|fault| at(&path, &fault))?;
        }
        Ok(Session { declared, machine, written, experiment, bounds, place: None, shows_method: false })
    }

    /// The session whose results say how the method came to the parameters: harmonics beside their prediction, matrices, updates.
    #[must_use]
    pub const fn showing_method(mut self) -> Self {
        self.shows_method = true;
        self
    }

    /// The model.
    #[must_use]
    pub const fn model(&self) -> &DeclaredModel {
        &self.declared
    }

    /// The model as a machine that moves along the pattern.
    #[must_use]
    pub const fn machine(&self) -> &Machine {
        &self.machine
    }

    /// The experiment in the parameters that the model is linear in.
    #[must_use]
    pub const fn experiment(&self) -> &Experiment {
        &self.experiment
    }

    /// The experiment as it was written.
    #[must_use]
    pub const fn written(&self) -> &Experiment {
        &self.written
    }

    /// Least and largest value of physical parameters behind lumped ones.
    pub const fn bounds(&self) -> &BTreeMap<String, (f64, f64)> {
        &self.bounds
    }

    /// The campaign before its first run, and what its loop was found to be; nothing moves where it is not stable.
    ///
    /// # Errors
    /// [`SessionError::Experiment`], within [`SessionError::InExperiment`] where the experiment stands in a file.
    pub fn campaign(&self) -> Result<(Campaign<'_>, LoopStability), SessionError> {
        self.begun(&self.experiment)
    }

    /// Plays a trial on the simulated machine of the experiment.
    ///
    /// # Errors
    /// [`SessionError::Experiment`], within [`SessionError::InExperiment`] where the experiment stands in a file.
    pub fn simulate(&self, trial: &Trial) -> Result<Record, SessionError> {
        play_simulated(self.machine.plant(), &self.experiment, trial).map_err(|fault| self.placed(fault.into()))
    }

    /// Plays the campaign on the simulated machine. Runs that a store holds are taken from it, and new ones are kept there as they
    /// end, so that a campaign that was stopped goes on where it was.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn identify(&self, store: Option<&Store>, watch: &mut Watch<'_>) -> Result<Identification, SessionError> {
        self.play_simulated(self.campaign()?, store, watch)
    }

    /// Plays a campaign of this session as [`identify`](Self::identify) does; the campaign comes with what its loop was found to be.
    pub(super) fn play_simulated(
        &self,
        (campaign, stability): (Campaign<'_>, LoopStability),
        store: Option<&Store>,
        watch: &mut Watch<'_>,
    ) -> Result<Identification, SessionError> {
        let played = play_on_simulated(self.machine.plant(), &self.experiment, campaign, store, watch)?;
        self.result(&played, stability, Source::SimulatedPlant, store)
    }

    /// Plays the campaign on the simulated machine with another seed of its noise.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn identify_seeded(&self, seed: u64, watch: &mut Watch<'_>) -> Result<Identification, SessionError> {
        let [experiment, written] = [&self.experiment, &self.written].map(|own| Experiment { seed, ..own.clone() });
        let (campaign, stability) = self.begun(&experiment)?;
        let played = play_on_simulated(self.machine.plant(), &experiment, campaign, None, watch)?;
        let result = self.refined(&played, stability, Source::SimulatedPlant, seed);
        self.complete(result, &written, None)
    }

    /// Plays the campaign on a machine, with a store as [`identify`](Self::identify) has it.
    ///
    /// # Errors
    /// [`SessionError`]; [`SessionError::Bench`] when the machine fails.
    pub fn identify_on(
        &self,
        bench: &mut dyn Bench,
        store: Option<&Store>,
        watch: &mut Watch<'_>,
    ) -> Result<Identification, SessionError> {
        let mut play = |trial: &Trial| bench.play(trial).map_err(SessionError::Bench);
        let (campaign, stability) = self.campaign()?;
        let played = play_campaign(campaign, None, store, &mut play, watch)?;
        self.result(&played, stability, Source::Machine, store)
    }

    /// What the runs of a folder say, without playing any.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn result_of(&self, store: &Store) -> Result<Identification, SessionError> {
        let (campaign, stability) = self.restored(store)?;
        self.result(&campaign, stability, Source::Folder, Some(store))
    }

    /// What the runs of a folder say, with the samples of every run handed out, without playing any.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn result_watched(&self, store: &Store, watch: &mut Watch<'_>) -> Result<Identification, SessionError> {
        let (mut campaign, stability) = self.campaign()?;
        for record in store.records(self.machine.plant())? {
            let trial = campaign.next().cloned();
            let run = campaign.submit(&record)?;
            if let Some(trial) = trial {
                watch(&trial, &record, run);
            }
        }
        self.result(&campaign, stability, Source::Folder, Some(store))
    }

    /// How well a result of this session predicts and simulates the measured part of one of its runs; nothing where the run did not
    /// settle, or nothing is identified.
    ///
    /// # Errors
    /// [`SessionError::Log`] when the rows cannot be evaluated along the run.
    pub fn explained(
        &self,
        result: &Identification,
        record: &Record,
        run: &RunReport,
    ) -> Result<Option<Validation>, SessionError> {
        let (Some(settled), Some(_)) = (run.settled_after, &result.estimate) else { return Ok(None) };
        let plant = self.machine.plant();
        let (setup, _) = self.experiment.stable_setup(plant, self.machine.pattern())?;
        let channels = record.coordinates.iter().chain(&record.inputs).cloned().collect();
        let log = Log::from_samples(&format!("run {}", run.run), record.sample_time, channels)?;
        let reading = RecordSettings {
            from_sample: Some(settled * run.samples_per_period),
            period: Some(run.samples_per_period as f64 * record.sample_time),
            hold: setup.procedure.hold,
            ..RecordSettings::default()
        };
        let domain = Some(Domain::Harmonics);
        let options = LogOptions { reading, domain, ..run_lines::options(&setup, Settings::default()) };
        let own = self.machine.eliminated().is_none();
        let derivatives = own.then(|| self.declared.derivatives());
        let derivatives = derivatives.as_ref().map(|derivatives| derivatives as &dyn RowDerivatives<f64>);
        let known = Identified::from(result);
        let open = if own { known.settled().map(|settled| settled.open).unwrap_or_default() } else { Vec::new() };
        Ok(Some(validate_run((plant, derivatives), &log, &options, &result.current, &open)?))
    }

    /// The campaign with all runs that a folder keeps, and what its loop was found to be.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn restored(&self, store: &Store) -> Result<(Campaign<'_>, LoopStability), SessionError> {
        let (mut campaign, stability) = self.campaign()?;
        for record in store.records(self.machine.plant())? {
            campaign.submit(&record)?;
        }
        Ok((campaign, stability))
    }

    /// The result of a campaign so far: parameters, physical parameters, warnings, provenance.
    ///
    /// # Errors
    /// [`SessionError::Physical`], within [`SessionError::InExperiment`] where the experiment stands in a file.
    pub fn result(
        &self,
        campaign: &Campaign<'_>,
        stability: LoopStability,
        source: Source,
        store: Option<&Store>,
    ) -> Result<Identification, SessionError> {
        let mut result = self.refined(campaign, stability, source, self.experiment.seed);
        if self.shows_method {
            result.method = Some(method_report::of_campaign(campaign)?);
        }
        self.complete(result, &self.written, store)
    }

    /// The campaign of an experiment before its first run, and what its loop was found to be.
    fn begun(&self, experiment: &Experiment) -> Result<(Campaign<'_>, LoopStability), SessionError> {
        let (campaign, stability) = self.machine.campaign(experiment).map_err(|fault| self.placed(fault.into()))?;
        // Runs of a smooth force are judged by their harmonics, which are right as far as they go.
        let jumps = self.declared.prepared().model.has_jumps();
        let campaign = match self.simulation(&campaign).filter(|_| jumps) {
            Some(simulation) => campaign.refining(simulation),
            None => campaign,
        };
        Ok((campaign, stability))
    }

    /// A fault with the file of the experiment, where it is the experiment's.
    fn placed(&self, fault: SessionError) -> SessionError {
        fault.in_experiment(self.place.as_deref())
    }

    /// The simulation that refines the estimates of a campaign, where that is asked for and can be done. With coordinates eliminated these
    /// are the physical parameters, and the sensors of all coordinates are read; the lumped ones stay as their equations gave them.
    fn simulation(&self, campaign: &Campaign<'_>) -> Option<RunSimulation<'_>> {
        let wanted = self.experiment.refine != Refine::None;
        let jumps = self.declared.prepared().model.has_jumps();
        wanted.then(|| RunSimulation::new(&self.machine, jumps, campaign.setup()))?
    }

    /// What the estimator gives, refined by the simulation where there is one.
    fn refined(&self, campaign: &Campaign<'_>, stability: LoopStability, source: Source, seed: u64) -> Identification {
        let refined = self.simulation(campaign).and_then(|simulation| simulation.of_campaign(campaign));
        match run_lines::asked(&self.declared, self.machine.plant(), campaign, refined) {
            Some(refined) => summary::of_refined(campaign, refined, stability, source, seed),
            None => summary::of_estimated(campaign, stability, source, seed),
        }
    }

    /// Adds what the estimator does not give: physical parameters behind lumped ones, and provenance. `written` is the experiment
    /// whose campaign gave the result.
    fn complete(
        &self,
        mut result: Identification,
        written: &Experiment,
        store: Option<&Store>,
    ) -> Result<Identification, SessionError> {
        if self.machine.eliminated().is_none() {
            match Lumped::of(self.declared.prepared()) {
                Some(lumped) => lumped
                    .complete(
                        &mut result,
                        (self.declared.evaluated(), &[]),
                        PhysicalSettings::of(&self.written, &self.bounds),
                    )
                    .map_err(|fault| self.placed(fault.into()))?,
                None => {
                    if let Some(name) = self.bounds.keys().next() {
                        return Err(SessionError::NothingLumped { name: name.clone() });
                    }
                }
            }
        }
        let order = self.declared.evaluated().dims().order;
        summary::warn_of_negative_gains(&mut result, &self.declared.prepared().model, order);
        let simulated = match (result.source, store) {
            (Source::SimulatedPlant, _) => true,
            (Source::Folder, Some(store)) => store.is_simulated()?,
            _ => false,
        };
        if simulated {
            Truth::of_model(&self.written, self.declared.prepared()).complete(&mut result);
        }
        for NonlinearParameter { name, unit, interval } in self.declared.nonlinear() {
            let Some(&value) = self.written.constants.get(&name) else { continue };
            result.warnings.push(Warning::TakenAsKnown { parameter: name.clone(), value });
            result.add_known(ParameterReport {
                name,
                unit,
                interval: Some(interval),
                prior: None,
                value: Some(value),
                std: Some(0.0),
                status: Status::Frozen,
                truth: simulated.then_some(value),
                with_prior: None,
            });
        }
        result.provenance.model = Some(self.declared.hash());
        result.provenance.experiment = Some(fingerprint(written.text()?.as_bytes()));
        if let Some(store) = store {
            let kept = store.fingerprints()?;
            result.provenance.logs = kept.into_iter().map(|(path, hash)| LogFingerprint { path, hash }).collect();
        }
        if !self.bounds.is_empty() {
            let bounds = summary::options(&self.bounds);
            result
                .provenance
                .options
                .insert("bounds".to_string(), serde_json::Value::Object(bounds.into_iter().collect()));
        }
        Ok(result.judged())
    }
}

/// The simulated machine of an experiment, as a bench.
#[derive(Clone, Copy, Debug)]
pub struct SimulatedMachine<'a> {
    session: &'a Session,
}

impl<'a> SimulatedMachine<'a> {
    /// The simulated machine of a session's experiment.
    #[must_use]
    pub const fn new(session: &'a Session) -> Self {
        Self { session }
    }
}

impl Bench for SimulatedMachine<'_> {
    fn play(&mut self, trial: &Trial) -> Result<Record, BenchError> {
        self.session.simulate(trial).map_err(|error| Box::new(error) as BenchError)
    }
}

/// The experiment that was asked for, and the file in which its motors stand.
fn read_experiment(
    path: &Path,
    request: &ExperimentRequest,
) -> Result<(Experiment, Option<(PathBuf, MotorFile)>), SessionError> {
    let alone = request.file.is_none() && !path.exists();
    let sample_time = request.by_limits.as_ref().and_then(|limits| limits.sample_time);
    let (text, mut experiment) = match sample_time.filter(|_| alone) {
        // Everything else follows from the limits.
        Some(sample_time) => (String::new(), Experiment::bare(sample_time)),
        None if alone && request.by_limits.is_some() => return Err(SessionError::NoSampleTime),
        None if alone => return Err(SessionError::NoExperiment { path: path.display().to_string() }),
        None => {
            let text = read(path)?;
            let read = Experiment::parse(&text);
            let fault = |error: ExperimentError| SessionError::File {
                path: path.display().to_string(),
                message: error.to_string(),
            };
            (text, read.map_err(fault)?)
        }
    };
    for (key, value) in &request.changes {
        experiment.set_value(key, value.clone())?;
    }
    experiment.frozen.extend(request.frozen.clone());
    experiment.prior.extend(request.prior.clone());
    experiment.refine = request.refine.unwrap_or(experiment.refine);
    if let Some(beside) = experiment.plant_file().map(|beside| path.with_file_name(beside)) {
        let text = DeclaredModel::open(&beside)?.text().text().to_string();
        experiment.plant.model = Some(PlantModelSection::Text { text });
    }
    let motors = match (&experiment.motors, experiment.motor_file().map(|beside| path.with_file_name(beside))) {
        (_, Some(beside)) => {
            let text = read(&beside)?;
            experiment.set_motors(&text).map_err(|fault| at(&beside, &fault))?;
            let motors = MotorFile::parse(&text).map_err(|fault| at(&beside, &fault))?;
            Some((beside, motors))
        }
        (Some(_), None) => {
            let motors = MotorFile::within(&text).map_err(|fault| at(path, &fault))?;
            Some((path.to_path_buf(), motors))
        }
        (None, None) => None,
    };
    Ok((experiment, motors))
}

/// The model that a simulated machine obeys, and the true values of its parameters: physical ones, if these are given.
fn simulated_machine(text: &str, written: &Experiment) -> Result<(Interpreted, Named), SessionError> {
    let declared = DeclaredModel::parse("plant.model", text)?;
    let whole = with_all_coordinates(declared.prepared()).map_err(MachineError::from)?;
    let values = tpm_physical::lumped(written, &whole).plant.parameters;
    Ok((Interpreted::new(&whole.model, &whole.form), values))
}

fn read(path: &Path) -> Result<String, SessionError> {
    read_text(path).map_err(|source| SessionError::Read { path: path.display().to_string(), source })
}

fn at(path: &Path, fault: &FileFault) -> SessionError {
    SessionError::File { path: path.display().to_string(), message: fault.to_string() }
}

#[cfg(test)]
mod tests {
    use super::{Session, SimulatedMachine};
    use crate::model::DeclaredModel;
    use std::collections::BTreeMap;
    use tpm_experiment::Experiment;
    use tpm_motion::Bench;
    use tpm_plant::simulated::{Rig, simulate};

    #[test]
    fn a_bench_plays_what_the_simulation_gives() {
        let model = include_str!("../../../../models/mass_spring_drag.tpm");
        let model = DeclaredModel::parse("mass_spring_drag", model).expect("the shipped model is right");
        let file = include_str!("../../../../models/mass_spring_drag.toml");
        let mut experiment = Experiment::parse(file).expect("the shipped file is right");
        let session = Session::new(model.clone(), experiment.clone(), None, BTreeMap::new()).expect("a session");
        let plant = session.machine().plant();
        let (campaign, _) = session.campaign().expect("playable");
        let trial = campaign.next().expect("first");
        let rig = experiment.bench(plant).expect("fits");
        let expected = simulate(plant, &rig, trial).expect("regular");
        let mut simulated = SimulatedMachine::new(&session);
        let bench: &mut dyn Bench = &mut simulated;
        assert_eq!(bench.play(trial).expect("regular"), expected);
        assert!(simulate(plant, &Rig { sensors: Vec::new(), ..rig }, trial).is_err());
        experiment.plant.parameters.clear();
        let unknown = Session::new(model, experiment, None, BTreeMap::new()).expect("a session");
        assert!(SimulatedMachine::new(&unknown).play(trial).is_err());
    }
}
