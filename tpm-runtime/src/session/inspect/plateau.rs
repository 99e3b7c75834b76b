//! Channels that are cut off at their largest or smallest value.
//!
//! A signal that turns comes to its extreme slowly. One that is cut off arrives there at speed, and stays for several samples. A rest, or
//! the counts at the turn of a slow motion, stay as well, but do not arrive at speed; a signal that switches between few levels is not cut
//! off, and one that is held over several samples stays as long everywhere.

use crate::session::inspect::signal::Part;
use serde::Serialize;
use std::vec::Vec;

/// Largest distance of a sample from the extreme, as a share of the range, at which it is at the extreme.
const SAME: f64 = 1e-9;
/// Fewest samples of a stay at the extreme, and the least multiple of the usual number of equal samples in a row.
const STAY: (usize, f64) = (3, 3.0);
/// Least speed of arrival or departure, as a share of the root mean square speed.
const SPEED: f64 = 0.15;
/// The same in steps of the sensor, over the samples that are looked at.
const STEPS: f64 = 3.0;
/// Samples before and behind a stay over which the speed is taken.
const AROUND: usize = 4;
/// Fewest samples at the extreme.
const FEWEST: usize = 8;
/// Most different values of a signal that switches between levels.
const LEVELS: usize = 16;
/// Share of samples at both extremes beyond which a signal switches between them.
const SWITCHES: f64 = 0.98;

/// An end of a channel's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// The least value.
    Least,
    /// The largest value.
    Largest,
}

/// A level at which a channel is cut off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Plateau {
    /// Which end of the range it is.
    pub end: End,
    /// The level, unit of the channel.
    pub level: f64,
    /// Share of the samples at this level.
    pub share: f64,
    /// Longest stay there, samples.
    pub longest: usize,
    /// Line of the first sample there.
    pub from_line: u64,
}

/// The levels at which a channel is cut off, given its step.
pub(super) fn plateaus(parts: &[Part<'_>], step: f64) -> Vec<Plateau> {
    let samples: usize = parts.iter().map(|part| part.values.len()).sum();
    let steps = || parts.iter().flat_map(|part| part.values.windows(2).map(|w| w[1] - w[0]));
    let changes = steps().filter(|change| change.abs() > 0.0).count();
    if changes == 0 || few_levels(parts) {
        return Vec::new();
    }
    let moving = steps().map(|change| change * change).sum::<f64>() / changes as f64;
    let speed = SPEED * moving.sqrt();
    let both: Vec<(Plateau, usize)> =
        [End::Least, End::Largest].into_iter().filter_map(|end| plateau(parts, end, speed, step)).collect();
    let at_ends: usize = both.iter().map(|(_, count)| count).sum();
    if at_ends as f64 > SWITCHES * samples as f64 {
        return Vec::new();
    }
    // Samples that stay elsewhere are held, and not cut off.
    let elsewhere = samples.saturating_sub(at_ends) as f64 / changes as f64;
    let stays = |plateau: &Plateau| plateau.longest as f64 >= STAY.1 * elsewhere;
    both.into_iter().map(|(plateau, _)| plateau).filter(stays).collect()
}

fn few_levels(parts: &[Part<'_>]) -> bool {
    let mut levels: Vec<u64> = Vec::new();
    for value in parts.iter().flat_map(|part| part.values) {
        if !levels.contains(&value.to_bits()) {
            if levels.len() == LEVELS {
                return false;
            }
            levels.push(value.to_bits());
        }
    }
    true
}

/// The plateau at one end, and the number of samples there; nothing where the signal is not cut off.
fn plateau(parts: &[Part<'_>], end: End, speed: f64, step: f64) -> Option<(Plateau, usize)> {
    let sign = if end == End::Largest { 1.0 } else { -1.0 };
    let all = || parts.iter().flat_map(|part| part.values.iter().map(|value| sign * value));
    let level = all().fold(f64::NEG_INFINITY, f64::max);
    let range = level - all().fold(f64::INFINITY, f64::min);
    let (mut count, mut longest, mut first) = (0, 0, None);
    for part in parts {
        let height = |k: usize| level - sign * part.values[k];
        let n = part.values.len();
        let mut k = 0;
        while k < n {
            if height(k) > SAME * range {
                k += 1;
                continue;
            }
            let from = k;
            while k < n && height(k) <= SAME * range {
                k += 1;
            }
            let length = k - from;
            let around = AROUND.min(length.div_ceil(2));
            let steep = |height: f64| height >= around as f64 * speed && height > STEPS * step;
            let arrives = from >= around && steep(height(from - around));
            let departs = k + around <= n && steep(height(k - 1 + around));
            if length >= STAY.0 && (arrives || from < around) && (departs || k + around > n) && (arrives || departs) {
                count += length;
                longest = longest.max(length);
                first = first.or(part.lines.get(from).copied());
            }
        }
    }
    let samples: usize = parts.iter().map(|part| part.values.len()).sum();
    let share = count as f64 / samples.max(1) as f64;
    let found = Plateau { end, level: sign * level, share, longest, from_line: first? };
    (count >= FEWEST).then_some((found, count))
}
