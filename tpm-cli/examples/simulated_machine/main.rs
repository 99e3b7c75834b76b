//! The simulated machine of an experiment behind the protocol `tpm.machine/1`, with faults on request: what a campaign on a live machine
//! is tested with.
//!
//! ```text
//! simulated_machine MODEL.tpm [--set KEY=VALUE]... [--samples] [--chunk N] [--fault KIND --after LINES [--marker FILE]]
//! ```
//!
//! A machine that plays samples (`--samples`) compares every input that it is sent with the one that the library's simulation applies,
//! to the last bit. A fault comes in place of the line after the first LINES ones: `die`, `hang`, `torn`, `garbage`, `nan`, `lost`
//! (the line is left out), `error`, `stop`. `hang` makes the file MARKER, and waits for the end of the input.

use std::collections::BTreeMap;
use std::io::{BufRead as _, Write as _};
use std::path::Path;
use std::process::ExitCode;
// The machine moves to the last bit as one that the command line simulates.
use tpm_elementary as _;
use tpm_runtime::experiment::{Value, written_value};
use tpm_runtime::model::Model as _;
use tpm_runtime::motion::{Ending, Record, Trial};
use tpm_runtime::plant::process::{FromMachine, PROTOCOL, Plays, ToMachine};
use tpm_runtime::session::{DeclaredModel, ExperimentRequest, Session};

type Fault = Box<dyn std::error::Error>;

#[derive(Default)]
struct Options {
    model: String,
    set: Vec<(String, Value)>,
    samples: bool,
    chunk: Option<usize>,
    fault: Option<String>,
    after: usize,
    marker: Option<String>,
}

impl Options {
    fn read() -> Result<Self, Fault> {
        let mut options = Options::default();
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
            match word.as_str() {
                "--set" => {
                    let text = value()?;
                    let (key, value) = text.split_once('=').ok_or("--set KEY=VALUE")?;
                    options.set.push((key.to_owned(), written_value(value)));
                }
                "--samples" => options.samples = true,
                "--chunk" => options.chunk = Some(value()?.parse()?),
                "--fault" => options.fault = Some(value()?),
                "--after" => options.after = value()?.parse()?,
                "--marker" => options.marker = Some(value()?),
                _ => options.model = word,
            }
        }
        Ok(options)
    }
}

/// The machine's side of the talk.
struct Machine {
    session: Session,
    options: Options,
    lines: usize,
}

impl Machine {
    /// Sends a message, or commits the fault that was asked for in its place.
    fn say(&mut self, message: &FromMachine) -> Result<(), Fault> {
        let line = serde_json::to_string(message)?;
        let due = self.lines == self.options.after;
        self.lines += 1;
        let mut out = std::io::stdout().lock();
        match self.options.fault.as_deref().filter(|_| due) {
            None => writeln!(out, "{line}")?,
            Some("die") => return Err("the belt is broken".into()),
            Some("hang") => {
                if let Some(marker) = &self.options.marker {
                    std::fs::write(marker, "")?;
                }
                std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink())?;
                return Err("the campaign is gone".into());
            }
            Some("torn") => {
                write!(out, "{}", &line[..line.len() / 2])?;
                out.flush()?;
                std::process::exit(4);
            }
            Some("garbage") => writeln!(out, "Traceback (most recent call last): {}", "x".repeat(200))?,
            Some("nan") => writeln!(out, "{}", line.replacen("[0.", "[NaN,0.", 1).replacen(":0.", ":NaN,\"y\":0.", 1))?,
            Some("lost") => {}
            Some("error") => {
                writeln!(out, "{}", serde_json::to_string(&FromMachine::Error { message: "drive fault 17".into() })?)?
            }
            Some("stop") => {
                let end = FromMachine::End { samples: 0, stopped: Some("limit switch".into()), applied: None };
                writeln!(out, "{}", serde_json::to_string(&end)?)?;
            }
            Some(other) => return Err(format!("no fault is called {other}").into()),
        }
        Ok(out.flush()?)
    }

    /// The run that was asked for, on what the session knows beside it.
    fn trial(&self, message: &ToMachine) -> Result<Trial, Fault> {
        let ToMachine::Run { terms, reference, feed_forward } = message else { return Err("a run was awaited".into()) };
        let plant = self.session.machine().plant();
        let dims = plant.dims();
        let (campaign, _) = self.session.campaign()?;
        let mut trial = campaign.next().ok_or("there is nothing to play")?.clone();
        trial.run = terms.run - 1;
        (trial.samples_per_period, trial.periods) = (terms.samples_per_period, terms.periods);
        for (own, sent) in trial.control.gains.iter_mut().zip(&terms.feedback) {
            (own.proportional, own.derivative) = (sent.kp, sent.kd);
        }
        let samples = 0..trial.samples_per_period;
        let coordinates = || (0..dims.coordinates).map(|c| &reference[plant.coordinate(c).name]);
        let motion =
            |n: usize| (0..=dims.order).flat_map(move |order| coordinates().map(move |series| series[order][n]));
        trial.reference = samples.clone().flat_map(motion).collect();
        let inputs = |n: usize| (0..dims.inputs).map(move |i| feed_forward[plant.input(i).name][n]);
        trial.feed_forward = samples.flat_map(inputs).collect();
        Ok(trial)
    }

    /// The record in messages.
    fn send(&mut self, record: &Record) -> Result<(), Fault> {
        let chunk = self.options.chunk.unwrap_or(record.len()).max(1);
        for from in (0..record.len()).step_by(chunk) {
            let range = from..(from + chunk).min(record.len());
            let readings =
                |column: &Vec<f64>| column[range.clone()].iter().map(|x| Some(*x).filter(|x| !x.is_nan())).collect();
            let (coordinates, inputs) = self.names();
            let rates = coordinates.iter().cloned().zip(&record.rates);
            let message = FromMachine::Samples {
                from,
                rates: rates.filter_map(|(name, rates)| Some((name, readings(rates.as_ref()?)))).collect(),
                coordinates: coordinates.iter().cloned().zip(record.coordinates.iter().map(readings)).collect(),
                inputs: inputs
                    .into_iter()
                    .zip(record.inputs.iter().map(|column| column[range.clone()].to_vec()))
                    .collect(),
            };
            self.say(&message)?;
        }
        Ok(())
    }

    /// Plays the record sample by sample, and compares what is asked for with what the simulation applied.
    fn exchange(&mut self, record: &Record) -> Result<(), Fault> {
        let (coordinates, inputs) = self.names();
        for sample in 0..record.len() {
            let reading = |column: &Vec<f64>| Some(column[sample]).filter(|x| !x.is_nan());
            let rates = coordinates.iter().cloned().zip(&record.rates);
            let message = FromMachine::Measured {
                sample,
                rates: rates.filter_map(|(name, rates)| Some((name, reading(rates.as_ref()?)))).collect(),
                coordinates: coordinates.iter().cloned().zip(record.coordinates.iter().map(reading)).collect(),
                applied: None,
            };
            self.say(&message)?;
            let applied: BTreeMap<String, f64> =
                inputs.iter().cloned().zip(record.inputs.iter().map(|column| column[sample])).collect();
            match heard()?.ok_or("the campaign is gone")? {
                ToMachine::Apply { inputs, .. } if inputs == applied => {}
                ToMachine::Stop { .. } if sample + 1 == record.len() && record.ending != Ending::Complete => {}
                other => {
                    return Err(format!("sample {sample}: {other:?} came, and {applied:?} was to be applied").into());
                }
            }
        }
        Ok(())
    }

    fn names(&self) -> (Vec<String>, Vec<String>) {
        let plant = self.session.machine().plant();
        let dims = plant.dims();
        let coordinates = (0..dims.coordinates).map(|c| plant.coordinate(c).name.to_owned()).collect();
        (coordinates, (0..dims.inputs).map(|i| plant.input(i).name.to_owned()).collect())
    }

    fn run(&mut self) -> Result<(), Fault> {
        let Some(ToMachine::Hello { .. }) = heard()? else { return Err("a greeting was awaited".into()) };
        let plays = if self.options.samples { Plays::Samples } else { Plays::Runs };
        self.say(&FromMachine::Hello { protocol: PROTOCOL.into(), machine: None, plays })?;
        while let Some(message) = heard()? {
            if matches!(message, ToMachine::Stop { .. }) {
                continue;
            }
            let trial = self.trial(&message)?;
            let record = self.session.simulate(&trial)?;
            match plays {
                Plays::Runs => self.send(&record)?,
                Plays::Samples => self.exchange(&record)?,
            }
            let stopped = (record.ending != Ending::Complete).then(|| record.ending.kind().to_string());
            self.say(&FromMachine::End { samples: record.len(), stopped, applied: None })?;
        }
        Ok(())
    }
}

/// The next message; nothing at the end of the input.
fn heard() -> Result<Option<ToMachine>, Fault> {
    let mut line = String::new();
    let length = std::io::stdin().lock().read_line(&mut line)?;
    Ok(if length == 0 { None } else { Some(serde_json::from_str(&line)?) })
}

fn serve() -> Result<(), Fault> {
    let options = Options::read()?;
    let file = Path::new(&options.model);
    let mut request = ExperimentRequest::default();
    request.changes.clone_from(&options.set);
    let session = Session::open(DeclaredModel::open(file)?, file, &request)?;
    Machine { session, options, lines: 0 }.run()
}

fn main() -> ExitCode {
    match serve() {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            let _ = writeln!(std::io::stderr(), "{fault}");
            ExitCode::from(3)
        }
    }
}
