//! Errors of a machine behind a process.

use crate::process::protocol::PROTOCOL;
use tpm_controller::model::EvalError;
use tpm_motion::RecordError;

/// Why a run was not played.
#[derive(Debug, thiserror::Error)]
#[error("run {run}: {fault}")]
pub struct MachineRunError {
    /// Number of the run, from 1.
    pub run: usize,
    /// What went wrong.
    #[source]
    pub fault: MachineFault,
}

/// A fault of the program of a machine. In messages, `it` is the program.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MachineFault {
    /// The command cannot be split into words.
    #[error("the command `{command}`: {reason}")]
    Command {
        /// The command.
        command: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The program cannot be started.
    #[error("`{program}` cannot be started: {source}")]
    Start {
        /// The program.
        program: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The program ended, or closed its output.
    #[error("it {ending}; {awaited} was awaited, after {lines} lines")]
    Ended {
        /// How it ended, and the last lines of its standard error.
        ending: String,
        /// What was awaited.
        awaited: &'static str,
        /// Number of lines received before.
        lines: usize,
    },
    /// No line came in time.
    #[error("it said nothing for {seconds} s; {awaited} was awaited, after {lines} lines{last_words}")]
    Silent {
        /// The longest wait, s.
        seconds: f64,
        /// What was awaited.
        awaited: &'static str,
        /// Number of lines received before.
        lines: usize,
        /// The last lines of its standard error.
        last_words: String,
    },
    /// A line is longer than its message can be.
    #[error(
        "line {line} of its output is longer than {most} bytes, which nothing that belongs there takes; {awaited} was awaited; send a long record in several messages `samples`"
    )]
    LongLine {
        /// Number of the line, from 1.
        line: usize,
        /// The most bytes of a line there.
        most: usize,
        /// What was awaited.
        awaited: &'static str,
    },
    /// The program does not read what it is told.
    #[error("it does not read its input, of which {waiting} bytes wait; {awaited} was awaited, after {lines} lines")]
    Deaf {
        /// Bytes that were not read.
        waiting: usize,
        /// What was awaited.
        awaited: &'static str,
        /// Number of lines received before.
        lines: usize,
    },
    /// A line is no message of the protocol.
    #[error("line {line} of its output is no message of {PROTOCOL}: {reason}: `{quoted}`")]
    Garbage {
        /// Number of the line, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
        /// Its beginning.
        quoted: String,
    },
    /// A message came that does not belong there.
    #[error("line {line} of its output is a message `{kind}`; {awaited} was awaited")]
    Unexpected {
        /// Number of the line, from 1.
        line: usize,
        /// The kind of the message.
        kind: &'static str,
        /// What was awaited.
        awaited: &'static str,
    },
    /// A message does not fit the model or the run.
    #[error("line {line} of its output: {reason}")]
    Content {
        /// Number of the line, from 1.
        line: usize,
        /// What does not fit.
        reason: String,
    },
    /// The program reported that it cannot go on.
    #[error("it says: {message}")]
    Said {
        /// Its reason.
        message: String,
    },
    /// The samples are no record of the run.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The feedback does not fit the model.
    #[error(transparent)]
    Feedback(#[from] EvalError),
    /// The run was interrupted by the user.
    #[error("interrupted; the machine was told to stop")]
    Interrupted,
}
