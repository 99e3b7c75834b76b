//! Channels that are cut off at their largest or smallest value.
//!
//! A signal that turns approaches its extreme slowly. One that is clipped arrives there at speed and stays for several samples. A rest, and
//! the counts at the turn of a slow motion, stay as well but do not arrive at speed; a signal that switches between few levels is not
//! clipped, and one that is held over several samples stays as long everywhere.
//!
//! Under noise the samples of a stay scatter about a level by the noise alone. A motion that comes to rest there decelerates until it
//! arrives. One that is clipped would have gone on: the parabola through the samples before its arrival crosses the level.

use crate::inspect::signal::Part;
use serde::Serialize;
use tpm_numerics::{DMatrix, DVector, alarm};

/// Largest distance of a sample from the extreme, as a share of the range, at which it is at the extreme.
const MOST_OFF_EXTREME: f64 = 1e-9;
/// Fewest samples of a stay at the extreme.
const LEAST_STAY: usize = 3;
/// Least length of the longest stay, as a multiple of the usual number of equal samples in a row.
const LEAST_STAY_RATIO: f64 = 3.0;
/// Least speed of arrival or departure, as a share of the root mean square speed.
const LEAST_SPEED: f64 = 0.15;
/// Least speed of arrival or departure in steps of the sensor, over the samples that are looked at.
const LEAST_SPEED_STEPS: f64 = 3.0;
/// Samples before and behind a stay over which the speed is taken.
const SAMPLES_AROUND: usize = 4;
/// Fewest samples at the extreme.
const LEAST_AT_EXTREME: usize = 8;
/// Most different values of a signal that switches between levels.
const MOST_LEVELS: usize = 16;
/// Share of samples at both extremes beyond which a signal switches between them.
const LEAST_SWITCHING_SHARE: f64 = 0.98;

/// Under noise, a sample is at a level within so many standard deviations of it.
const LEVEL_DEVIATIONS: f64 = 5.0;
/// Depth of the samples before an arrival through which a parabola is laid, in standard deviations of the noise, with fewest and most
/// samples.
const APPROACH: (f64, usize, usize) = (25.0, 5, 40);
/// Fewest samples of a stay under noise.
const LEAST_NOISY_STAY: usize = 12;
/// Factor by which the noise of a channel may be known wrongly.
const NOISE_FACTOR: f64 = 1.15;
/// Fewest arrivals and departures at a level under noise.
const LEAST_ARRIVALS: usize = 2;

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

/// The levels at which a channel is cut off, given its step, and its noise where there is any.
pub(super) fn plateaus(parts: &[Part<'_>], step: f64, noise: Option<f64>) -> Vec<Plateau> {
    let mut found = exact_plateaus(parts, step);
    if let Some(noise) = noise.filter(|noise| *noise > 0.0) {
        for end in [End::Least, End::Largest] {
            if found.iter().all(|plateau| plateau.end != end) {
                found.extend(noisy_plateau(parts, end, noise));
            }
        }
    }
    found
}

/// The levels that readings at them have exactly.
fn exact_plateaus(parts: &[Part<'_>], step: f64) -> Vec<Plateau> {
    let samples: usize = parts.iter().map(|part| part.values.len()).sum();
    let steps = || parts.iter().flat_map(|part| part.values.windows(2).map(|w| w[1] - w[0]));
    let changes = steps().filter(|change| change.abs() > 0.0).count();
    if changes == 0 || few_levels(parts) {
        return Vec::new();
    }
    let moving = steps().map(|change| change * change).sum::<f64>() / changes as f64;
    let speed = LEAST_SPEED * moving.sqrt();
    let both: Vec<(Plateau, usize)> =
        [End::Least, End::Largest].into_iter().filter_map(|end| plateau(parts, end, speed, step)).collect();
    let at_ends: usize = both.iter().map(|(_, count)| count).sum();
    if at_ends as f64 > LEAST_SWITCHING_SHARE * samples as f64 {
        return Vec::new();
    }
    // Samples that stay elsewhere are held, and not cut off.
    let elsewhere = samples.saturating_sub(at_ends) as f64 / changes as f64;
    let stays = |plateau: &Plateau| plateau.longest as f64 >= LEAST_STAY_RATIO * elsewhere;
    both.into_iter().map(|(plateau, _)| plateau).filter(stays).collect()
}

fn few_levels(parts: &[Part<'_>]) -> bool {
    let mut levels: Vec<u64> = Vec::new();
    for value in parts.iter().flat_map(|part| part.values) {
        if !levels.contains(&value.to_bits()) {
            if levels.len() == MOST_LEVELS {
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
            if height(k) > MOST_OFF_EXTREME * range {
                k += 1;
                continue;
            }
            let from = k;
            while k < n && height(k) <= MOST_OFF_EXTREME * range {
                k += 1;
            }
            let length = k - from;
            let around = SAMPLES_AROUND.min(length.div_ceil(2));
            let steep = |height: f64| height >= around as f64 * speed && height > LEAST_SPEED_STEPS * step;
            let arrives = from >= around && steep(height(from - around));
            let departs = k + around <= n && steep(height(k - 1 + around));
            if length >= LEAST_STAY && (arrives || from < around) && (departs || k + around > n) && (arrives || departs)
            {
                count += length;
                longest = longest.max(length);
                first = first.or(part.lines.get(from).copied());
            }
        }
    }
    let samples: usize = parts.iter().map(|part| part.values.len()).sum();
    let share = count as f64 / samples.max(1) as f64;
    let found = Plateau { end, level: sign * level, share, longest, from_line: first? };
    (count >= LEAST_AT_EXTREME).then_some((found, count))
}

/// The plateau at one end of a noisy channel; nothing where it is not cut off.
fn noisy_plateau(parts: &[Part<'_>], end: End, noise: f64) -> Option<Plateau> {
    let sign = if end == End::Largest { 1.0 } else { -1.0 };
    let level = level(parts, sign, noise)?;
    let (mut count, mut longest, mut first) = (0, 0, None);
    let mut crossings: Vec<f64> = Vec::new();
    for part in parts {
        let depth = |k: usize| (level - sign * part.values[k]) / noise;
        let n = part.values.len();
        let mut k = 0;
        while k < n {
            let from = k;
            while k < n && depth(k).abs() <= LEVEL_DEVIATIONS {
                k += 1;
            }
            let length = k - from;
            k = k.max(from + 1);
            let squares: f64 = (from..from + length).map(|i| depth(i).powi(2)).sum();
            let most = length as f64 * NOISE_FACTOR.powi(2) + alarm::PLATEAU_STAYS * (2.0 * length as f64).sqrt();
            if length < LEAST_NOISY_STAY || squares > most {
                continue;
            }
            count += length;
            longest = longest.max(length);
            first = first.or(part.lines.get(from).copied());
            let (arrival, departure) = (from, from + length);
            crossings.extend(crossing(&|back| arrival.checked_sub(back + 1).map(depth)));
            crossings.extend(crossing(&|ahead| Some(departure + ahead).filter(|at| *at < n).map(depth)));
        }
    }
    let samples: usize = parts.iter().map(|part| part.values.len()).sum();
    let share = count as f64 / samples.max(1) as f64;
    let found = Plateau { end, level: sign * level, share, longest, from_line: first? };
    // Each has a deviation of one by chance.
    let surely = crossings.iter().sum::<f64>() > alarm::PLATEAU_STAYS * (crossings.len() as f64).sqrt();
    (crossings.len() >= LEAST_ARRIVALS && surely).then_some(found)
}

/// The level about which the samples at one end scatter; nothing without a sample.
fn level(parts: &[Part<'_>], sign: f64, noise: f64) -> Option<f64> {
    let all = || parts.iter().flat_map(|part| part.values.iter().map(|value| sign * value));
    let most = all().fold(f64::NEG_INFINITY, f64::max);
    let mut high: Vec<f64> = all().filter(|value| most - value <= 2.0 * LEVEL_DEVIATIONS * noise).collect();
    let middle = high.len() / 2;
    let mut level = if high.is_empty() { return None } else { *high.select_nth_unstable_by(middle, f64::total_cmp).1 };
    // What passes by on its way to the level lies on one side.
    for _ in 0..3 {
        let near = high.iter().filter(|value| (*value - level).abs() <= 3.0 * noise);
        let (sum, count) = near.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
        level = if count > 0 { sum / f64::from(count) } else { level };
    }
    Some(level)
}

/// How surely the parabola `c0 + c1 i + c2 i^2` through the depths of the samples before an arrival, or behind a departure, crosses the
/// level: its discriminant `c1^2 - 4 c0 c2`, which is zero for a motion that comes to rest there, in standard deviations. Zero for a
/// channel that does not come nearer; nothing where there are too few samples.
fn crossing(depth: &dyn Fn(usize) -> Option<f64>) -> Option<f64> {
    let (deepest, fewest, most) = APPROACH;
    let depths: Vec<f64> = (0..most).map_while(|i| depth(i).filter(|depth| i < fewest || *depth <= deepest)).collect();
    if depths.len() < fewest {
        return None;
    }
    let powers = DMatrix::from_fn(depths.len(), 3, |i, power| (i as f64).powi(power as i32));
    let normal = powers.tr_mul(&powers).cholesky()?;
    let fitted = normal.solve(&powers.tr_mul(&DVector::from_row_slice(&depths)));
    let discriminant = fitted[1].powi(2) - 4.0 * fitted[0] * fitted[2];
    let gradient = DVector::from_row_slice(&[-4.0 * fitted[2], 2.0 * fitted[1], -4.0 * fitted[0]]);
    let deviation = gradient.dot(&normal.solve(&gradient)).sqrt();
    Some(if fitted[1] > 0.0 { discriminant / deviation.max(f64::MIN_POSITIVE) } else { 0.0 })
}
