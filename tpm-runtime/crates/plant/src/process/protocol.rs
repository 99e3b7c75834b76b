//! The protocol `tpm.machine/1`: the messages between a campaign and the program of a machine, one JSON object per
//! line.
//!
//! `docs/machine.md` explains it with an example. Invariant: numbers are written with enough digits to be read back
//! exactly, so that a run played by another program equals one that stays in memory.

use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use tpm_motion::RunFile;

/// Name and version of the protocol.
pub const PROTOCOL: &str = "tpm.machine/1";
/// Most characters of a line that an error quotes.
const MOST_QUOTED_CHARACTERS: usize = 80;

/// Longest line of a message without samples, in bytes.
pub(super) const LONGEST_OTHER: usize = 1 << 20;

/// A message from the campaign to the machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum ToMachine {
    /// The first line: the protocol, and the model whose signals are exchanged.
    Hello {
        /// [`PROTOCOL`].
        protocol: String,
        /// Name of the model.
        model: String,
        /// The coordinates that the machine measures.
        coordinates: Vec<Signal>,
        /// The inputs that the machine applies.
        inputs: Vec<Signal>,
    },
    /// A run to be played: the machine goes to the start of the reference and rests there, then the run begins.
    Run {
        /// Feedback, limits, timing.
        terms: Box<RunFile>,
        /// One period of the reference: by coordinate, the samples of its value and of every derivative that the model has.
        reference: BTreeMap<String, Vec<Vec<f64>>>,
        /// One period of the feed-forward: the samples by input.
        feed_forward: BTreeMap<String, Vec<f64>>,
    },
    /// The values to apply from a sample until the next one, cut at the limits of the inputs; only to machines that play samples.
    Apply {
        /// The sample, from 0.
        sample: usize,
        /// The value by input.
        inputs: BTreeMap<String, f64>,
    },
    /// The machine is to stop the run at once, and to report its end.
    Stop {
        /// Why.
        reason: String,
    },
}

/// A message from the machine to the campaign.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum FromMachine {
    /// The answer to the campaign's first line.
    Hello {
        /// [`PROTOCOL`].
        protocol: String,
        /// Name of the machine, for messages.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        machine: Option<String>,
        /// What the machine plays, and thereby which side closes the loop.
        plays: Plays,
    },
    /// A part of the record of a run; only from machines that play runs.
    Samples {
        /// First sample of the part, from 0.
        from: usize,
        /// Measured values by coordinate; nothing where a sensor gave no number.
        coordinates: BTreeMap<String, Vec<Option<f64>>>,
        /// Applied values by input.
        inputs: BTreeMap<String, Vec<f64>>,
        /// Measured rates by coordinate, where a sensor measures them.
        #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
        rates: BTreeMap<String, Vec<Option<f64>>>,
    },
    /// One measured sample; only from machines that play samples.
    Measured {
        /// The sample, from 0.
        sample: usize,
        /// Measured value by coordinate; nothing where a sensor gave no number.
        coordinates: BTreeMap<String, Option<f64>>,
        /// Measured rate by coordinate, where a sensor measures it.
        #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
        rates: BTreeMap<String, Option<f64>>,
        /// The inputs applied since the sample before, where they differ from the commanded ones.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        applied: Option<BTreeMap<String, f64>>,
    },
    /// The run has ended, and the machine waits for the next one.
    End {
        /// Samples that were played, all of them recorded.
        samples: usize,
        /// Why the machine stopped the run before its end; nothing when it did not.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stopped: Option<String>,
        /// The inputs applied since the last measured sample, where they differ from the commanded ones; only from
        /// machines that play samples.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        applied: Option<BTreeMap<String, f64>>,
    },
    /// The machine cannot go on; the campaign ends.
    Error {
        /// Why.
        message: String,
    },
}

/// A coordinate or an input of the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Signal {
    /// Its name.
    pub name: String,
    /// Its unit, where the model states one.
    pub unit: Option<String>,
}

/// What a machine plays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Plays {
    /// Whole runs: the machine closes the loop by the terms of the run.
    Runs,
    /// Samples: the machine measures and applies, and the campaign closes the loop.
    Samples,
}

impl FromMachine {
    /// Reads a line.
    ///
    /// # Errors
    /// What is wrong with the line, in words.
    pub fn parse(line: &str) -> Result<Self, String> {
        Self::read(line).map_err(|error| {
            let bare = ["NaN", "Infinity"].into_iter().find(|word| error.is_syntax() && line.contains(word));
            match bare {
                Some(word) => format!("JSON has no {word}: a reading that failed is null"),
                None => error.to_string(),
            }
        })
    }

    /// Reads a message. That of samples, which alone is long, is read without a copy of everything in it, which serde makes of tagged
    /// values.
    fn read(line: &str) -> serde_json::Result<Self> {
        #[derive(Deserialize)]
        struct Kind<'a> {
            #[serde(rename = "type", borrow)]
            kind: Cow<'a, str>,
        }
        match serde_json::from_str::<Kind<'_>>(line) {
            Ok(found) if found.kind == "samples" => serde_json::from_str(line).map(SamplesMessage::message),
            _ if line.len() > LONGEST_OTHER => {
                Err(serde::de::Error::custom(format!("no message but `samples` is longer than {LONGEST_OTHER} bytes")))
            }
            _ => serde_json::from_str(line),
        }
    }

    /// The kind of the message, the value of its field `type`.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            FromMachine::Hello { .. } => "hello",
            FromMachine::Samples { .. } => "samples",
            FromMachine::Measured { .. } => "measured",
            FromMachine::End { .. } => "end",
            FromMachine::Error { .. } => "error",
        }
    }
}

/// The fields of [`FromMachine::Samples`], with that of the kind.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SamplesMessage {
    #[serde(rename = "type")]
    _kind: serde::de::IgnoredAny,
    from: usize,
    coordinates: BTreeMap<String, Vec<Option<f64>>>,
    inputs: BTreeMap<String, Vec<f64>>,
    #[serde(default)]
    rates: BTreeMap<String, Vec<Option<f64>>>,
}

impl SamplesMessage {
    fn message(self) -> FromMachine {
        let SamplesMessage { from, coordinates, inputs, rates, .. } = self;
        FromMachine::Samples { from, coordinates, inputs, rates }
    }
}

impl ToMachine {
    /// The message as a line, without its end.
    #[must_use]
    pub fn line(&self) -> String {
        serde_json::to_string(self).expect("invariant: messages hold plain values")
    }
}

/// The beginning of a line, for an error.
pub(super) fn quoted(line: &str) -> String {
    let line = line.trim_end();
    match line.char_indices().nth(MOST_QUOTED_CHARACTERS) {
        Some((cut, _)) => format!("{} ... ({} characters)", &line[..cut], line.chars().count()),
        None => line.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::{FromMachine, PROTOCOL, ToMachine, quoted};

    /// The lines of the conversations in the documentation that begin with a speaker.
    fn said(speaker: &str) -> impl Iterator<Item = &'static str> {
        let document = include_str!("../../../../../docs/machine.md");
        let prefix = format!("{speaker}: ");
        document.lines().filter_map(move |line| line.strip_prefix(&*prefix).filter(|line| line.starts_with('{')))
    }

    #[test]
    fn every_message_in_the_documentation_is_one_of_the_protocol() {
        let mut kinds = std::collections::BTreeSet::new();
        for line in said("tpm") {
            let message: ToMachine = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
            let written: serde_json::Value = serde_json::from_str(&message.line()).expect("JSON");
            assert_eq!(written, serde_json::from_str::<serde_json::Value>(line).expect("JSON"));
            if let ToMachine::Hello { protocol, .. } = &message {
                assert_eq!(protocol, PROTOCOL);
            }
            kinds.insert(format!("tpm: {}", written["type"]));
        }
        for line in said("machine") {
            let message = FromMachine::parse(line).unwrap_or_else(|error| panic!("{error}: {line}"));
            let written = serde_json::to_value(&message).expect("JSON");
            assert_eq!(written, serde_json::from_str::<serde_json::Value>(line).expect("JSON"));
            assert_eq!(written["type"], message.kind());
            kinds.insert(format!("machine: {}", written["type"]));
        }
        // Every kind of message is shown.
        assert_eq!(kinds.len(), 9, "{kinds:?}");
    }

    #[test]
    fn numbers_come_back_exactly() {
        let mut state = 1_u64;
        for _ in 0..20_000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let value = f64::from_bits(state);
            if value.is_finite() {
                let sent = ToMachine::Apply { sample: 0, inputs: [("u".into(), value)].into() };
                assert_eq!(serde_json::from_str::<ToMachine>(&sent.line()).expect("JSON"), sent, "{value}");
            }
        }
    }

    #[test]
    fn faults_of_a_line_are_named() {
        let fault = |line: &str| FromMachine::parse(line).expect_err("wrong");
        assert!(fault("{\"type\":\"measured\",\"sample\":0,\"coordinates\":{\"x\":NaN}}").contains("is null"));
        assert!(fault("starting up").contains("line 1 column 1"));
        assert!(fault("{\"type\":\"end\"}").contains("missing field `samples`"));
        assert!(fault("{\"type\":\"end\",\"samples\":3,\"why\":1}").contains("unknown field `why`"));
        assert!(fault("{\"type\":\"stopped\"}").contains("unknown variant `stopped`"));
        assert_eq!(quoted("short\n"), "short");
        assert_eq!(quoted(&"é".repeat(100)), format!("{} ... (100 characters)", "é".repeat(80)));
    }
}
