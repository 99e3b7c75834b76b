//! What the program of a machine says, in both modes of the protocol: a whole run, as a text, and some of them through pipes.

use super::mutated::mutated;
use super::random::Random;
use super::{Verdict, files, refused};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;
use tpm_runtime::motion::{Bench as _, Ending, Record, Trial};
use tpm_runtime::plant::process::{MachineRunError, PROTOCOL, ProcessMachine, ProcessSettings, read_transcript};
use tpm_runtime::session::Session;

/// How long a program may be silent. Those of this target never are: they have said all and have ended.
const TIMEOUT: Duration = Duration::from_secs(20);

/// A run of few samples, and what the simulated machine recorded.
struct Played {
    session: Session,
    trial: Trial,
    record: Record,
}

fn played() -> &'static Played {
    static FOUND: OnceLock<Played> = OnceLock::new();
    FOUND.get_or_init(|| {
        let session = files::short_session();
        let trial = session.campaign().expect("a campaign").0.next().expect("a run").clone();
        let record = session.simulate(&trial).expect("a record");
        Played { session, trial, record }
    })
}

/// Numbers by the name of the only coordinate or input.
fn named<T: Into<Value>>(name: &str, values: T) -> Value {
    json!({ name: values.into() })
}

/// What a machine says that plays runs, changed in one of two texts.
pub(super) fn runs_text(random: &mut Random) -> String {
    script(random, "runs", |random, lines, record, stop| {
        let mut from = 0;
        while from < stop {
            let until = (from + 1 + usize::try_from(random.below(200)).expect("small")).min(stop);
            let part = |values: &[f64]| json!(values[from..until]);
            let mut message = json!({
                "type": "samples",
                "from": from,
                "coordinates": named("x", part(&record.coordinates[0])),
                "inputs": named("u", part(&record.inputs[0])),
            });
            if random.below(40) == 0 {
                message["coordinates"]["x"][0] = Value::Null;
            }
            lines.push(message.to_string());
            from = until;
        }
    })
}

/// What a machine says that plays samples, changed in one of two texts.
pub(super) fn samples_text(random: &mut Random) -> String {
    script(random, "samples", |random, lines, record, stop| {
        for (sample, value) in record.coordinates[0][..stop].iter().enumerate() {
            let mut message = json!({ "type": "measured", "sample": sample, "coordinates": named("x", *value) });
            if sample > 0 && random.below(5) == 0 {
                message["applied"] = named("u", record.inputs[0][sample - 1]);
            }
            if random.below(5000) == 0 {
                message["coordinates"]["x"] = Value::Null;
            }
            lines.push(message.to_string());
        }
    })
}

/// The greeting, the samples, and the end of a run, which the machine may have stopped.
fn script(
    random: &mut Random,
    plays: &str,
    samples: impl FnOnce(&mut Random, &mut Vec<String>, &Record, usize),
) -> String {
    let record = &played().record;
    let whole = record.len();
    let stops = random.below(4) == 0;
    let stop = if stops { usize::try_from(random.below(whole as u64)).expect("small") } else { whole };
    let mut lines = vec![json!({ "type": "hello", "protocol": PROTOCOL, "plays": plays }).to_string()];
    samples(random, &mut lines, record, stop);
    let mut end = json!({ "type": "end", "samples": stop });
    if stops {
        end["stopped"] = json!("limit switch");
    }
    lines.push(end.to_string());
    // Changes are of a few lines, since most lines are alike.
    if random.below(2) == 0 {
        for _ in 0..=random.below(3) {
            let at = usize::try_from(random.below(lines.len() as u64)).expect("an index");
            match random.below(5) {
                0 => drop(lines.remove(at)),
                1 => lines.insert(at, lines[at].clone()),
                _ => lines[at] = mutated(&lines[at], random.next()),
            }
            if lines.is_empty() {
                break;
            }
        }
    }
    lines.iter().map(|line| format!("{line}\n")).collect()
}

thread_local! {
    /// A file of this thread, which goes when the thread ends.
    static FILE: (tempfile::TempDir, PathBuf) = {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("said");
        (folder, path)
    };
}

/// One text in so many is also said by a program through the pipes of a process, which must come to the same.
const PROCESSES: usize = 64;

/// A run that a program plays which says this text, whatever it is asked.
fn played_by_program(text: &str) -> Result<Record, String> {
    let Played { session, trial, .. } = played();
    FILE.with(|(_, path)| {
        std::fs::write(path, text).expect("writable");
        let settings = ProcessSettings {
            command: format!("cat '{}'", path.display()),
            timeout: TIMEOUT,
            settle_periods: session.experiment().schedule.settle_periods,
        };
        let played = ProcessMachine::new(session.machine().plant(), settings, &|| true).play(trial);
        // A transcript has no exit status.
        played.map_err(|error| match error.downcast_ref::<MachineRunError>() {
            Some(error) => error.fault.to_string().replace("ended with exit status: 0", "ended"),
            None => error.to_string(),
        })
    })
}

/// A run of which a machine's program says this text.
pub(super) fn run(text: &str) -> Verdict {
    let Played { session, trial, .. } = played();
    let settle_periods = session.experiment().schedule.settle_periods;
    let said = read_transcript(session.machine().plant(), trial, settle_periods, text.as_bytes().to_vec());
    let said = said.map_err(|fault| fault.to_string());
    if text.len().is_multiple_of(PROCESSES) {
        // Readings that failed are no numbers, and equal in words alone.
        let [alone, through_pipes] = [&said, &played_by_program(text)].map(|played| format!("{played:?}"));
        assert!(alone == through_pipes, "a text and a program that says it differ:\n{alone}\n{through_pipes}");
    }
    match said {
        Ok(record) => {
            assert!(record.len() <= trial.samples(), "{} samples of {}", record.len(), trial.samples());
            assert!(record.coordinates.iter().chain(&record.inputs).all(|values| values.len() == record.len()));
            let whole = matches!(record.ending, Ending::Complete);
            assert!(!whole || record.len() == trial.samples(), "a run that is complete without its samples");
            Verdict::Answered
        }
        Err(fault) => refused(&fault),
    }
}
