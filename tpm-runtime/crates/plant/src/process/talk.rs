//! The exchange of messages with the program of a machine.

use crate::process::error::MachineFault;
use crate::process::protocol::{FromMachine, LONGEST_OTHER, ToMachine, quoted};
use std::time::Duration;

/// Most bytes that a number takes in a message: a sign, seventeen digits, an exponent, what stands between two numbers, with room for
/// blanks.
const BYTES_OF_A_NUMBER: usize = 32;
/// Most bytes of a line, however long the run is: longer records come in several messages.
const MOST_BYTES: usize = 1 << 25;

/// The result of waiting for a line.
#[derive(Debug)]
pub(super) enum Heard {
    /// A line, without its end.
    Line(String),
    /// A line that is no text, described in words.
    NoText(String),
    /// A line that is longer than this number of bytes.
    TooLong(usize),
    /// The process closed its output.
    Closed,
    /// No line came within the time.
    Silence,
    /// The wait was interrupted.
    Interrupted,
    /// The process does not read its input, of which so many bytes wait.
    Deaf(usize),
}

/// Who says the lines: a running process, or the transcript of one.
pub(super) trait Partner {
    /// Lets lines have so many bytes from now on.
    fn allow(&self, longest: usize);

    /// Sends a line, unless too much waits already, which the next wait for an answer tells.
    fn say(&self, line: String);

    /// Waits at most `timeout` for the next line; the wait is interrupted when `go_on` returns false.
    fn hear(&self, timeout: Duration, go_on: &dyn Fn() -> bool) -> Heard;

    /// Describes the end of whoever spoke in words, with the last lines of the standard error.
    fn ending(&mut self) -> String;

    /// The last lines of the standard error, as the end of a sentence; empty where there are none.
    fn last_words(&self) -> String;
}

/// A partner, with the number of lines received from it. Where this value is dropped while a run is played, by whatever
/// way, the machine is told to stop first.
pub(super) struct Talk<'a> {
    partner: Box<dyn Partner>,
    lines: usize,
    /// Whether the machine was asked for a run that has not ended.
    playing: bool,
    /// Longest wait for a line.
    timeout: Duration,
    /// Whether to go on waiting.
    go_on: &'a dyn Fn() -> bool,
}

impl<'a> Talk<'a> {
    /// A talk with a partner that has said nothing yet.
    pub(super) const fn new(partner: Box<dyn Partner>, timeout: Duration, go_on: &'a dyn Fn() -> bool) -> Self {
        Talk { partner, lines: 0, playing: false, timeout, go_on }
    }

    /// Sends a message.
    pub(super) fn say(&self, message: &ToMachine) {
        self.partner.say(message.line());
    }

    /// Asks for a run with so many numbers in its record, which bound the lines that may come.
    pub(super) fn ask(&mut self, run: &ToMachine, numbers: usize) {
        let record = numbers.saturating_mul(BYTES_OF_A_NUMBER).saturating_add(LONGEST_OTHER);
        self.partner.allow(record.min(MOST_BYTES));
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
        let heard = self.partner.hear(timeout, self.go_on);
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
                let ending = self.partner.ending();
                Err(MachineFault::Ended { ending: format!("{ending}; {reason}"), awaited, lines })
            }
            Heard::Closed => Err(MachineFault::Ended { ending: self.partner.ending(), awaited, lines }),
            Heard::Silence => {
                let (seconds, last_words) = (timeout.as_secs_f64(), self.partner.last_words());
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
