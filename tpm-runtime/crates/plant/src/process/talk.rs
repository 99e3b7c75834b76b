//! The exchange of messages with the program of a machine.

use crate::process::child::{Heard, Process};
use crate::process::error::MachineFault;
use crate::process::protocol::{FromMachine, LONGEST_OTHER, ToMachine, quoted};
use std::time::Duration;

/// Most bytes that a number takes in a message: a sign, seventeen digits, an exponent, what stands between two numbers, with room for
/// blanks.
const BYTES_OF_A_NUMBER: usize = 32;
/// Most bytes of a line, however long the run is: longer records come in several messages.
const MOST_BYTES: usize = 1 << 25;

/// A program that was started, with the number of lines received from it. Where this value is dropped while a run is played, by whatever
/// way, the machine is told to stop first.
pub(super) struct Talk<'a> {
    process: Process,
    lines: usize,
    /// Whether the machine was asked for a run that has not ended.
    playing: bool,
    /// Longest wait for a line.
    timeout: Duration,
    /// Whether to go on waiting.
    go_on: &'a dyn Fn() -> bool,
}

impl<'a> Talk<'a> {
    /// A talk with a program that has just been started.
    pub(super) const fn new(process: Process, timeout: Duration, go_on: &'a dyn Fn() -> bool) -> Self {
        Talk { process, lines: 0, playing: false, timeout, go_on }
    }

    /// Sends a message.
    pub(super) fn say(&self, message: &ToMachine) {
        self.process.say(message.line());
    }

    /// Asks for a run with so many numbers in its record, which bound the lines that may come.
    pub(super) fn ask(&mut self, run: &ToMachine, numbers: usize) {
        let record = numbers.saturating_mul(BYTES_OF_A_NUMBER).saturating_add(LONGEST_OTHER);
        self.process.allow(record.min(MOST_BYTES));
        self.playing = true;
        self.say(run);
    }

    /// Tells the machine to stop.
    pub(super) fn stop(&self, reason: &str) {
        self.say(&ToMachine::Stop { reason: reason.into() });
    }

    /// Waits for the next message, for the usual time of a line and `longer`. `awaited` describes the expected message
    /// in faults.
    pub(super) fn hear(&mut self, awaited: &'static str, longer: Duration) -> Result<FromMachine, MachineFault> {
        let timeout = self.timeout.saturating_add(longer);
        let heard = self.process.hear(timeout, self.go_on);
        let lines = self.lines;
        match heard {
            Heard::Line(line) => {
                self.lines += 1;
                match FromMachine::parse(&line) {
                    Ok(FromMachine::Error { message }) => Err(MachineFault::Said { message }),
                    Ok(message) => {
                        self.playing &= !matches!(message, FromMachine::End { .. });
                        Ok(message)
                    }
                    Err(reason) => Err(MachineFault::Garbage { line: self.lines, reason, quoted: quoted(&line) }),
                }
            }
            Heard::NoText(reason) => {
                // A line without an end is left by a program that died while it wrote.
                let ending = self.process.ending();
                Err(MachineFault::Ended { ending: format!("{ending}; {reason}"), awaited, lines })
            }
            Heard::Closed => Err(MachineFault::Ended { ending: self.process.ending(), awaited, lines }),
            Heard::Silence => {
                let (seconds, last_words) = (timeout.as_secs_f64(), self.process.last_words());
                Err(MachineFault::Silent { seconds, awaited, lines, last_words })
            }
            Heard::TooLong(most) => Err(MachineFault::LongLine { line: lines + 1, most, awaited }),
            Heard::Deaf(waiting) => Err(MachineFault::Deaf { waiting, awaited, lines }),
            Heard::Interrupted => Err(MachineFault::Interrupted),
        }
    }

    /// The fault of the last message, which is of the wrong kind.
    pub(super) const fn unexpected(&self, message: &FromMachine, awaited: &'static str) -> MachineFault {
        MachineFault::Unexpected { line: self.lines, kind: message.kind(), awaited }
    }

    /// The fault of the last message, which does not fit.
    pub(super) const fn wrong(&self, reason: String) -> MachineFault {
        MachineFault::Content { line: self.lines, reason }
    }
}

impl Drop for Talk<'_> {
    fn drop(&mut self) {
        if self.playing {
            self.stop("the campaign has ended");
        }
    }
}
