//! A channel as it is drawn: few points, whatever the length of the record.

use crate::inspect::signal::Signal;
use std::ops::Range;

/// Columns into which a record is drawn, each with the least and the largest reading in it.
const DRAWN_COLUMNS: usize = 900;

/// What is drawn of a channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Outline {
    /// Time (s) and reading; what is not finite breaks the line.
    pub(super) line: Vec<(f64, f64)>,
    /// Times (s) at which rests begin and end.
    pub(super) rests: Vec<(f64, f64)>,
    /// Frequency (Hz) and deviation that white noise of the power there would have.
    pub(super) spectrum: Vec<(f64, f64)>,
}

impl Outline {
    /// The line of a channel.
    pub(super) fn of(signal: &Signal<'_>, sample_time: f64) -> Self {
        let size = signal.len().div_ceil(DRAWN_COLUMNS).max(1);
        let mut line = Vec::new();
        for part in &signal.parts {
            for (column, values) in part.values.chunks(size).enumerate() {
                let t = part.start + (column * size) as f64 * sample_time;
                let (low, high) = values
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
                if size < 3 {
                    line.extend(values.iter().enumerate().map(|(i, x)| (t + i as f64 * sample_time, *x)));
                } else {
                    line.extend([(t, low), (t + 0.5 * size as f64 * sample_time, high)]);
                }
            }
            line.push((f64::NAN, f64::NAN));
        }
        Outline { line, ..Outline::default() }
    }

    /// Takes in the samples at which the channel stands still.
    pub(super) fn rest(&mut self, signal: &Signal<'_>, still: &[Vec<Range<usize>>], sample_time: f64) {
        for (part, still) in signal.parts.iter().zip(still) {
            let time = |sample: usize| part.start + sample as f64 * sample_time;
            self.rests.extend(still.iter().map(|range| (time(range.start), time(range.end))));
        }
    }
}
