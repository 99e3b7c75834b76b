//! A machine behind a process, as a bench.

use crate::process::child::Process;
use crate::process::command::words;
use crate::process::error::{MachineFault, MachineRunError};
use crate::process::play::{Played, Signals, play_run, play_samples};
use crate::process::protocol::{FromMachine, PROTOCOL, Plays, ToMachine};
use crate::process::talk::Talk;
use crate::process::transcript::Transcript;
use std::time::Duration;
use tpm_controller::model::Model;
use tpm_motion::{Bench, BenchError, Record, Trial};

/// Longest wait for a program to end of itself once its input is closed.
const LONGEST_GRACE: Duration = Duration::from_secs(2);

/// How a program is started, and how long it is waited for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessSettings {
    /// The program with its arguments: words between blanks, or in quotes. No shell is used.
    pub command: String,
    /// Longest wait for a line. A machine that plays runs may be silent for the duration of the run beside it.
    pub timeout: Duration,
    /// Fewest periods of a run that pass before anything is measured, as the terms of the run state.
    pub settle_periods: usize,
}

/// A run that the machine stopped before its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MachineStop {
    /// Number of the run, from 1.
    pub run: usize,
    /// The machine's reason.
    pub reason: String,
}

/// A machine behind a process, which is started when the first run is played. Dropping this value ends the process: its input is
/// closed, and it is told to end, and then killed with whatever it started, where it does not end soon after.
pub struct ProcessMachine<'a> {
    model: &'a dyn Model<f64>,
    settings: ProcessSettings,
    go_on: &'a dyn Fn() -> bool,
    open: Option<(Talk<'a>, Plays)>,
    stops: Vec<MachineStop>,
}

impl<'a> ProcessMachine<'a> {
    /// The machine of a model behind a program. `go_on` is called while the program is waited for; once it returns
    /// false, the machine is told to stop, and the run ends with [`MachineFault::Interrupted`].
    #[must_use]
    pub const fn new(model: &'a dyn Model<f64>, settings: ProcessSettings, go_on: &'a dyn Fn() -> bool) -> Self {
        ProcessMachine { model, settings, go_on, open: None, stops: Vec::new() }
    }

    /// The runs that the machine stopped before their end, in their order.
    #[must_use]
    pub fn stops(&self) -> &[MachineStop] {
        &self.stops
    }

    /// Starts the program.
    fn start(&self) -> Result<Talk<'a>, MachineFault> {
        let ProcessSettings { command, timeout, .. } = &self.settings;
        let words = words(command).map_err(|reason| MachineFault::Command { command: command.clone(), reason })?;
        let process = Process::start(&words, LONGEST_GRACE.min(*timeout))
            .map_err(|source| MachineFault::Start { program: words[0].clone(), source })?;
        Ok(Talk::new(Box::new(process), *timeout, self.go_on))
    }

    fn played(&mut self, trial: &Trial) -> Result<Record, MachineFault> {
        let signals = Signals::of(self.model);
        // After a fault the state of the exchange is unknown, so that the process is ended with it.
        let (mut talk, plays) = match self.open.take() {
            Some(open) => open,
            None => greet(self.start()?, self.model, &signals)?,
        };
        match ask(&mut talk, plays, self.model, &signals, trial, self.settings.settle_periods) {
            Ok((record, stopped)) => {
                self.stops.extend(stopped.map(|reason| MachineStop { run: trial.run + 1, reason }));
                self.open = Some((talk, plays));
                Ok(record)
            }
            Err(fault) => {
                talk.stop(&fault.to_string());
                Err(fault)
            }
        }
    }
}

/// Exchanges greetings.
fn greet<'a>(mut talk: Talk<'a>, model: &dyn Model<f64>, signals: &Signals) -> Result<(Talk<'a>, Plays), MachineFault> {
    talk.say(&ToMachine::Hello {
        protocol: PROTOCOL.to_string(),
        model: model.name().to_string(),
        coordinates: signals.coordinates.clone(),
        inputs: signals.inputs.clone(),
    });
    let awaited = "its greeting";
    match talk.hear(awaited, Duration::ZERO)? {
        FromMachine::Hello { protocol, plays, .. } if protocol == PROTOCOL => Ok((talk, plays)),
        FromMachine::Hello { protocol, .. } => {
            Err(talk.wrong(format!("it speaks `{protocol}`, this program {PROTOCOL}")))
        }
        other => Err(talk.unexpected(&other, awaited)),
    }
}

/// Asks for a run, and gathers its record.
fn ask(
    talk: &mut Talk<'_>,
    plays: Plays,
    model: &dyn Model<f64>,
    signals: &Signals,
    trial: &Trial,
    settle_periods: usize,
) -> Result<Played, MachineFault> {
    // Every coordinate may come with its rate.
    let columns = 2 * signals.coordinates.len() + signals.inputs.len();
    talk.ask(&signals.run(model, trial, settle_periods), trial.samples().saturating_mul(columns));
    match plays {
        Plays::Runs => play_run(talk, signals, trial),
        Plays::Samples => play_samples(talk, signals, model.dims(), trial),
    }
}

/// The record of a run from all that the program of a machine says, its greeting first, without starting one: for a program's author, who
/// has kept its output, and for tests.
///
/// # Errors
/// What [`ProcessMachine`] says of a program that writes this and ends.
pub fn read_transcript(
    model: &dyn Model<f64>,
    trial: &Trial,
    settle_periods: usize,
    said: Vec<u8>,
) -> Result<Record, MachineFault> {
    let signals = Signals::of(model);
    let talk = Talk::new(Box::new(Transcript::new(said)), Duration::ZERO, &|| true);
    let (mut talk, plays) = greet(talk, model, &signals)?;
    ask(&mut talk, plays, model, &signals, trial, settle_periods).map(|(record, _)| record)
}

impl Bench for ProcessMachine<'_> {
    fn play(&mut self, trial: &Trial) -> Result<Record, BenchError> {
        self.played(trial).map_err(|fault| Box::new(MachineRunError { run: trial.run + 1, fault }) as BenchError)
    }
}
