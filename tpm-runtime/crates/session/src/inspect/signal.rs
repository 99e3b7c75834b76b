//! A channel of a record in its stretches.

use tpm_log::{Recording, Role, Steps, Survey};

/// One channel, stretch by stretch.
#[derive(Clone, Debug)]
pub(super) struct Signal<'a> {
    pub(super) name: &'a str,
    pub(super) unit: Option<&'a str>,
    pub(super) role: Role,
    /// Least and largest reading in the file.
    pub(super) extremes: [f64; 2],
    /// The steps in which its numbers are written; nothing where they were not told.
    pub(super) steps: Option<&'a Steps>,
    pub(super) parts: Vec<Part<'a>>,
}

/// A stretch of a channel without a gap.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part<'a> {
    pub(super) values: &'a [f64],
    /// Line of every sample.
    pub(super) lines: &'a [u64],
    /// Time of the first sample, counted from the first one of the record, s.
    pub(super) start: f64,
    /// Which segment of the record it is.
    pub(super) segment: usize,
}

impl<'a> Signal<'a> {
    /// The values of every stretch.
    pub(super) fn values(&self) -> Vec<&'a [f64]> {
        self.parts.iter().map(|part| part.values).collect()
    }

    /// Number of samples.
    pub(super) fn len(&self) -> usize {
        self.parts.iter().map(|part| part.values.len()).sum()
    }

    /// All samples.
    pub(super) fn samples(&self) -> impl Iterator<Item = f64> + '_ {
        self.parts.iter().flat_map(|part| part.values.iter().copied())
    }

    /// The stretch of a segment of the record.
    pub(super) fn part(&self, segment: usize) -> Option<&Part<'a>> {
        self.parts.iter().find(|part| part.segment == segment)
    }

    /// At most so many blocks of so many samples, evenly spread over a longer signal; a shorter one whole.
    pub(super) fn blocks(&self, count: usize, length: usize) -> Vec<&'a [f64]> {
        let all = self.len();
        if all <= count * length {
            return self.values();
        }
        let mut blocks = Vec::new();
        for part in &self.parts {
            let own = (count * part.values.len()).div_ceil(all);
            let length = length.min(part.values.len());
            let last = part.values.len() - length;
            let from = (0..own).map(|k| last * k / own.saturating_sub(1).max(1));
            blocks.extend(from.map(|from| &part.values[from..from + length]));
        }
        blocks
    }
}

/// The channels of a record that has readings in them; a rate that is not measured is none.
pub(super) fn signals(survey: &Survey) -> Vec<Signal<'_>> {
    let Recording { segments, report, .. } = &survey.recording;
    let channels = segments.first().map_or(0, |log| log.channels.len());
    let mut signals = Vec::new();
    for (at, channel) in survey.channels.iter().enumerate() {
        let mut parts = Vec::new();
        for (segment, log) in segments.iter().enumerate() {
            let values = match at.checked_sub(channels) {
                None => log.channels.get(at),
                Some(rate) => log.rates.get(rate).and_then(Option::as_ref),
            };
            let start = report.segments.get(segment).map_or(0.0, |segment| segment.start);
            parts.extend(values.map(|values| Part { values, lines: &log.lines, start, segment }));
        }
        if !parts.is_empty() {
            let extremes = survey.extremes[at];
            signals.push(Signal {
                name: &channel.name,
                unit: channel.unit.as_deref(),
                role: channel.role,
                extremes,
                steps: segments.first().and_then(|log| log.steps.get(at)),
                parts,
            });
        }
    }
    signals
}
