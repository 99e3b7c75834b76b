//! Stretches in which a channel stands still.
//!
//! The slope at a sample is that of a straight line through the samples around it. A channel is at rest where its slope is no more than
//! noise makes, or a small share of its mean. A passage through rest at the end of a stroke is no rest: a stay counts from a tenth of
//! the mean period between zero crossings on.

use crate::inspect::signal::Part;
use serde::Serialize;
use std::ops::Range;
use tpm_numerics::{alarm, root_mean_square};

/// Share of the root mean square slope below which a channel is at rest.
const LEAST_SLOPE: f64 = 0.02;
/// Deviation of the noise of a slope, as a share of the slopes' root mean square, down to which lines are made longer.
const CLEAR_SLOPE_NOISE: f64 = 0.01;
/// Deviation of the noise of a slope, as a share of the slopes' root mean square, up to which rest can be told.
const MOST_SLOPE_NOISE: f64 = 0.1;
/// Most lines in the mean period between zero crossings.
const MOST_LINES: f64 = 100.0;
/// Fewest lines in that period.
const LEAST_LINES: f64 = 20.0;
/// Fewest samples of a line.
const LEAST_LINE_SAMPLES: f64 = 5.0;
/// Least time of a rest, as a share of the mean period between zero crossings.
const LEAST_REST: f64 = 0.1;

/// How long a channel stands still.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Rest {
    /// Share of the record.
    pub share: f64,
    /// Longest rest, s.
    pub longest: f64,
    /// First line of the longest rest.
    pub from_line: u64,
    /// Its last line.
    pub to_line: u64,
}

/// Samples of every stretch at which a channel stands still; nothing where noise hides it.
pub(super) fn at_rest(parts: &[Part<'_>], noise: f64, typical_period: f64) -> Option<Vec<Vec<Range<usize>>>> {
    let mut length = (typical_period / MOST_LINES).max(LEAST_LINE_SAMPLES);
    let longest = (typical_period / LEAST_LINES).max(LEAST_LINE_SAMPLES);
    loop {
        let half = (0.5 * length) as usize;
        let slopes: Vec<Vec<f64>> = parts.iter().map(|part| slopes(part.values, half)).collect();
        let usual = root_mean_square(slopes.iter().flatten().copied());
        let of_noise = noise / squares(half).sqrt();
        let motion = (usual * usual - of_noise * of_noise).max(0.0).sqrt();
        if of_noise > CLEAR_SLOPE_NOISE * motion && length < longest {
            length = (1.5 * length).min(longest);
            continue;
        }
        if motion <= 0.0 || of_noise > MOST_SLOPE_NOISE * motion {
            return None;
        }
        let bound = (alarm::SLOPE_MOVES * of_noise).max(LEAST_SLOPE * motion);
        let least = (LEAST_REST * typical_period).max(2.0 * length);
        return Some(slopes.iter().map(|slopes| still(slopes, bound, least)).collect());
    }
}

/// The stretches of successive samples with slopes within a bound that last long enough.
fn still(slopes: &[f64], bound: f64, least: f64) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut from = None;
    for (sample, slope) in slopes.iter().map(Some).chain([None]).enumerate() {
        match (slope.is_some_and(|slope| slope.abs() <= bound), from) {
            (true, None) => from = Some(sample),
            (false, Some(first)) => {
                found.extend(((sample - first) as f64 >= least).then_some(first..sample));
                from = None;
            }
            _ => {}
        }
    }
    found
}

/// Sum of the squares of the numbers from `-half` to `half`.
fn squares(half: usize) -> f64 {
    let m = half as f64;
    m * (m + 1.0) * (2.0 * m + 1.0) / 3.0
}

/// Slope per sample of the straight line through so many samples on either side of every sample; at the ends that of the nearest line.
fn slopes(values: &[f64], half: usize) -> Vec<f64> {
    let n = values.len();
    let length = 2 * half + 1;
    if n < length || half == 0 {
        return vec![0.0; n];
    }
    let below = squares(half);
    let origin = values[0];
    let of = |first: usize| -> (f64, f64) {
        values[first..first + length].iter().enumerate().fold((0.0, 0.0), |(sum, moment), (i, x)| {
            (sum + x - origin, moment + (i as f64 - half as f64) * (x - origin))
        })
    };
    let (mut sum, mut moment) = of(0);
    let mut slopes = vec![0.0; n];
    for first in 0..=n - length {
        // Sums are formed anew now and then, so that rounding does not add up.
        if first % 1024 == 0 {
            (sum, moment) = of(first);
        }
        slopes[first + half] = moment / below;
        if let Some(next) = values.get(first + length) {
            let (old, new, m) = (values[first] - origin, next - origin, half as f64);
            // Every sample moves to the left by one.
            moment += m * old - (sum - old) + m * new;
            sum += new - old;
        }
    }
    let (begin, end) = (slopes[half], slopes[n - 1 - half]);
    slopes[..half].fill(begin);
    slopes[n - half..].fill(end);
    slopes
}

impl Rest {
    /// The rests of a channel, given the samples at which it stands still.
    pub(super) fn of(parts: &[Part<'_>], still: &[Vec<Range<usize>>], sample_time: f64) -> Option<Self> {
        let all: usize = parts.iter().map(|part| part.values.len()).sum();
        let at_rest: usize = still.iter().flatten().map(Range::len).sum();
        let ranges = parts.iter().zip(still).flat_map(|(part, still)| still.iter().map(move |range| (part, range)));
        let (part, range) = ranges.max_by_key(|(_, range)| range.len())?;
        Some(Rest {
            share: at_rest as f64 / all.max(1) as f64,
            longest: range.len() as f64 * sample_time,
            from_line: part.lines.get(range.start).copied().unwrap_or(0),
            to_line: part.lines.get(range.end - 1).copied().unwrap_or(0),
        })
    }
}
