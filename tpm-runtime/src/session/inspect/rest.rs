//! Stretches in which a channel stands still.
//!
//! Straight lines are fitted to short blocks of samples. A block is at rest when its slope is no more than noise makes, or a small share
//! of what the channel does on the average. A passage through rest at the end of a stroke is no rest: blocks at rest count where they
//! last for a tenth of the time in which the motion goes to and fro once.

use crate::numerics::root_mean_square;
use crate::session::inspect::signal::Part;
use serde::Serialize;
use std::ops::Range;
use std::vec::Vec;

/// Share of the root mean square slope below which a block is at rest.
const AT_REST: f64 = 0.02;
/// Deviations of the noise of a slope that count as rest.
const NOISE: f64 = 3.0;
/// Largest deviation of the noise of a slope, as a share of the slopes' root mean square, at which rest can be told.
const CLEAR: f64 = 0.1;
/// Blocks in the time in which the motion goes to and fro once: most of them, and fewest.
const BLOCKS: (f64, f64) = (100.0, 8.0);
/// Least time of a rest, as a share of the time in which the motion goes to and fro once.
const LEAST: f64 = 0.1;

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
    let mut size = (typical_period / BLOCKS.0).max(4.0);
    let largest = (typical_period / BLOCKS.1).max(4.0);
    loop {
        let length = size.round() as usize;
        let slopes: Vec<Vec<f64>> =
            parts.iter().map(|part| part.values.chunks_exact(length).map(slope).collect()).collect();
        let usual = root_mean_square(slopes.iter().flatten().copied());
        let n = length as f64;
        let of_noise = noise * (12.0 / (n * (n * n - 1.0))).sqrt();
        let motion = (usual * usual - of_noise * of_noise).max(0.0).sqrt();
        if of_noise > CLEAR * motion && size < largest {
            size = (1.5 * size).min(largest);
            continue;
        }
        if motion <= 0.0 || of_noise > CLEAR * motion {
            return None;
        }
        let bound = (NOISE * of_noise).max(AT_REST * motion);
        let least = (LEAST * typical_period).max(2.0 * n);
        return Some(slopes.iter().map(|slopes| still(slopes, bound, length, least)).collect());
    }
}

/// The stretches of blocks with slopes within a bound that last long enough, in samples.
fn still(slopes: &[f64], bound: f64, length: usize, least: f64) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut from = None;
    for (block, slope) in slopes.iter().map(Some).chain([None]).enumerate() {
        match (slope.is_some_and(|slope| slope.abs() <= bound), from) {
            (true, None) => from = Some(block),
            (false, Some(first)) => {
                let range = first * length..block * length;
                found.extend((range.len() as f64 >= least).then_some(range));
                from = None;
            }
            _ => {}
        }
    }
    found
}

/// Slope of the straight line through a block, per sample.
fn slope(block: &[f64]) -> f64 {
    let middle = 0.5 * (block.len() as f64 - 1.0);
    let origin = block.first().copied().unwrap_or(0.0);
    let (above, below) = block.iter().enumerate().fold((0.0, 0.0), |(above, below), (i, x)| {
        let t = i as f64 - middle;
        (above + t * (x - origin), below + t * t)
    });
    above / below
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
