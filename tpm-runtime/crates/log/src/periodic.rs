//! Finding the periodic, settled part of a log.
//!
//! Invariant: the part `[from, from + periods * samples_per_period)` repeats: every block of it differs from the last
//! period by no more than the last two periods differ from each other. Period and start are found from the signals alone.

use rayon::prelude::*;
use std::f64::consts::PI;
use tpm_numerics::alarm;
use tpm_numerics::differences::{WHITE_NOISE_SPREAD, white_noise};

/// Most samples on which the period is searched; longer logs are averaged in blocks first.
const MOST_SEARCHED: usize = 8192;
/// Most samples of a period that are compared to find its length to a sample; of a longer one equally spaced samples are.
const MOST_COMPARED: usize = 32_768;
/// Divisor of a record's length: a period is searched in the last part of this length when the blocks of the whole
/// record are too long to show one.
const TAIL_DIVISOR: usize = 16;
/// Largest root-mean-square difference between successive periods of a periodic log, as a share of the motion.
const MOST_MISMATCH: f64 = 0.1;
/// Least variance of the two compared periods, as a share of the variance of the record, since a machine at rest
/// repeats trivially.
const LEAST_MOVING_VARIANCE: f64 = 0.25;
/// Number of blocks in a period, in each of which settling is judged.
const BLOCKS_PER_PERIOD: usize = 32;
/// Smallest transient that is detected, as a share of the signal's standard deviation.
const LEAST_TRANSIENT: f64 = 1e-8;
/// Largest error that is expected of a refined period, samples.
const MOST_PERIOD_ERROR: f64 = 1e-3;
/// Largest difference of a settled block from the last period, as a multiple of the difference between the last two
/// periods.
const MOST_OVER_LAST: f64 = 3.0;
/// Most harmonics with which the period is refined.
const MOST_HARMONICS: usize = 64;
/// A period is rounded to a whole number of samples when its deviation from that, summed over all periods of the
/// record, is at most this many samples.
const MOST_OFF_WHOLE_SAMPLES: f64 = 0.02;

/// The periodic part of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Periodic {
    /// First sample of the part that repeats.
    pub steady_from: usize,
    /// First sample used. Samples beyond the whole periods are shared between the start, where they give more time to
    /// settle, and the end.
    pub from: usize,
    /// Samples in a period; whole unless the signals show otherwise.
    pub samples_per_period: f64,
    /// Whole periods used.
    pub periods: usize,
    /// Root-mean-square difference of the coordinates between the last two periods, as a share of their motion.
    pub mismatch: f64,
}

/// The difference between two successive periods.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mismatch {
    /// Root mean square as a share of the motion; one for two stretches that are uncorrelated.
    pub share: f64,
    /// Standard deviation of the samples' white noise as a share of what was recorded, where this noise explains the difference in
    /// every coordinate; nothing where the periods differ by more, or hardly differ.
    pub noise: Option<f64>,
}

impl Mismatch {
    /// Compares the last period, of any length, with the one before.
    fn at(motion: &[&[f64]], end: usize, length: f64) -> Self {
        let moving: Vec<Difference<'_>> =
            motion.iter().filter_map(|signal| Difference::at(&signal[..end], length)).collect();
        let share = moving.iter().map(|own| own.square.sqrt()).fold(0.0, f64::max);
        let mut noise = (share > MOST_MISMATCH).then_some(0.0_f64);
        for own in &moving {
            let Some(most) = noise else { break };
            let white = own.explained_above(MOST_MISMATCH);
            noise = white.map(|white| most.max((white / variance(own.signal)).sqrt().min(1.0)));
        }
        Mismatch { share, noise }
    }
}

/// The difference between the last period of a signal and the one before.
struct Difference<'a> {
    signal: &'a [f64],
    /// Samples of a period.
    last: usize,
    /// Variance of both periods.
    scale: f64,
    /// Half the mean square difference, in units of that variance.
    square: f64,
}

impl<'a> Difference<'a> {
    /// Compares the last period, of any length, with the one before; nothing for a signal that is at rest.
    fn at(signal: &'a [f64], length: f64) -> Option<Self> {
        let (end, last) = (signal.len(), length.round() as usize);
        // A fractional period needs one sample more at its start than a rounded period.
        let reach = (length.ceil() as usize + last).min(end);
        let scale = variance(&signal[end - reach..]);
        let difference = |i: usize| signal[i] - value_at(signal, i as f64 - length);
        let square = (end - last..end).map(|i| difference(i).powi(2)).sum::<f64>() / last as f64;
        (scale > 0.0).then_some(Self { signal, last, scale, square: square / (2.0 * scale) })
    }

    /// Variance of the white noise of the samples, where this noise explains the part of the difference that exceeds a
    /// share `share` of the signal.
    fn explained_above(&self, share: f64) -> Option<f64> {
        let white = white_noise(self.signal).powi(2);
        let chance = 1.0
            + alarm::PERIODS_DIFFER * (2.0 / self.last as f64 + WHITE_NOISE_SPREAD / self.signal.len() as f64).sqrt();
        (self.square <= share.powi(2) + chance * white / self.scale).then_some(white)
    }
}

/// Whether the last two periods of a signal differ by more than a share `share` of it and the white noise of its
/// samples explain together. `length` is the period in samples.
pub fn differs(signal: &[f64], length: f64, share: f64) -> bool {
    Difference::at(signal, length).is_some_and(|own| own.square > share.powi(2) && own.explained_above(share).is_none())
}

/// Why no periodic part was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PeriodicFault {
    /// No stretch of the motion occurs twice.
    None,
    /// The best lag leaves too large a difference between successive periods.
    Mismatch {
        /// The best period, samples; it means nothing where noise explains the mismatch.
        period: f64,
        /// Its mismatch.
        mismatch: Mismatch,
    },
    /// The part from the stated sample on does not hold one whole period.
    Range,
}

/// Finds the periodic part of signals of which the first `coordinates` channels are motion.
///
/// `period` (samples) and `from` are taken as given when stated. Periods of a stated length may differ by as much as the white noise
/// of their samples explains.
///
/// # Errors
/// [`PeriodicFault`] when no lag repeats well enough, or the part from `from` on holds no whole period.
pub fn find_periodic(
    channels: &[Vec<f64>],
    coordinates: usize,
    period: Option<f64>,
    from: Option<usize>,
) -> Result<Periodic, PeriodicFault> {
    let samples = channels.iter().map(Vec::len).min().unwrap_or(0);
    let start = from.unwrap_or(0);
    if start >= samples {
        return Err(PeriodicFault::Range);
    }
    // 1. The period: stated, or searched in the motion.
    let motion: Vec<&[f64]> = channels[..coordinates.min(channels.len())].iter().map(|c| &c[start..samples]).collect();
    let available = samples - start;
    let (length, end) = match period {
        Some(length) => {
            if !(length >= 3.0 && length <= available as f64) {
                return Err(PeriodicFault::Range);
            }
            if 2.0 * length > available as f64 {
                // One period has no other to be compared with. The caller stated it, so it is accepted.
                return Ok(Periodic {
                    steady_from: start,
                    from: start,
                    samples_per_period: length,
                    periods: 1,
                    mismatch: 0.0,
                });
            }
            (length, available)
        }
        None => search(&motion)?,
    };
    // 2. Successive periods must agree.
    let mismatch = Mismatch::at(&motion, end, length);
    if mismatch.share > MOST_MISMATCH && (period.is_none() || mismatch.noise.is_none()) {
        return Err(PeriodicFault::Mismatch { period: length, mismatch });
    }
    // 3. The end of settling, in all channels.
    let tails: Vec<&[f64]> = channels.iter().map(|c| &c[start..start + end]).collect();
    let settle = |length: f64| {
        if from.is_some() { 0 } else { tails.par_iter().map(|c| settled(c, length)).max().unwrap_or(0) }
    };
    let mut length = length;
    let mut first = settle(length);
    if period.is_none() {
        // The whole steady part determines the period better than two periods do.
        let refined = refine(&motion, first, end, length);
        let whole_samples =
            (refined - refined.round()).abs() * ((end - first) as f64 / refined) <= MOST_OFF_WHOLE_SAMPLES;
        length = if whole_samples { refined.round() } else { refined };
        first = settle(length);
    }
    // 4. The whole periods that the steady part holds.
    let periods = ((end - first) as f64 / length + 1e-9).floor() as usize;
    if periods == 0 {
        return Err(PeriodicFault::Range);
    }
    let spare = (end - first).saturating_sub((periods as f64 * length).ceil() as usize);
    let steady_from = start + first;
    let from = if from.is_some() { steady_from } else { steady_from + spare / 2 };
    Ok(Periodic { steady_from, from, samples_per_period: length, periods, mismatch: mismatch.share })
}

/// The shortest lag at which the motion repeats best, and the sample at which the periodic part ends.
///
/// Blocks of a long record may be too long to tell a period from its multiples, or to show it at all. Periods are therefore looked for
/// again in the last two that were found, or near the end of the record if none was, as long as blocks become shorter.
fn search(motion: &[&[f64]]) -> Result<(f64, usize), PeriodicFault> {
    let samples = motion.first().map_or(0, |c| c.len());
    let part = |from: usize, end: usize| -> Vec<&[f64]> { motion.iter().map(|c| &c[from..end]).collect() };
    match search_blocks(motion) {
        Ok((mut length, end)) => {
            let mut seen = end;
            loop {
                let last = ((2.0 * length).ceil() as usize + 1).min(end);
                if block_length(last) == block_length(seen) {
                    return Ok((length, end));
                }
                seen = last;
                match search_blocks(&part(end - last, end)) {
                    Ok((shorter, shorter_end)) if shorter_end == last => length = shorter.min(length),
                    _ => return Ok((length, end)),
                }
            }
        }
        Err(fault) => {
            let last = samples / TAIL_DIVISOR;
            if block_length(samples) == 1 || last < MOST_SEARCHED {
                return Err(fault);
            }
            match search(&part(samples - last, samples)) {
                Ok((length, end)) => Ok((length, samples - last + end)),
                Err(_) => Err(fault),
            }
        }
    }
}

/// Samples of a block, so that so many samples make no more than [`MOST_SEARCHED`] blocks.
fn block_length(samples: usize) -> usize {
    samples.div_ceil(MOST_SEARCHED).max(1)
}

/// The shortest lag at which the motion, averaged in blocks of samples, repeats best, and the sample at which the
/// periodic part ends.
///
/// The last two periods are compared, because they are the most settled ones; when they do not repeat (the machine was
/// stopped before the recording was), the end is moved forward.
fn search_blocks(motion: &[&[f64]]) -> Result<(f64, usize), PeriodicFault> {
    let samples = motion.first().map_or(0, |c| c.len());
    let block = block_length(samples);
    let coarse: Vec<Vec<f64>> =
        motion.iter().map(|c| c.chunks_exact(block).map(|b| b.iter().sum::<f64>() / block as f64).collect()).collect();
    let coarse: Vec<&[f64]> = coarse.iter().map(Vec::as_slice).collect();
    let length = samples / block;
    let mut fault = PeriodicFault::None;
    for part in (10..=20).rev() {
        let end = length * part / 20;
        let Some((lag, least)) = best_lags(&coarse, end) else {
            continue;
        };
        let fine_end = (end * block).min(samples);
        let (near, _) = (((lag - 1) * block).max(2)..=(lag + 1) * block)
            .filter(|lag| 2 * lag <= fine_end)
            .map(|lag| (lag, difference(motion, fine_end, lag)))
            .fold((lag * block, f64::INFINITY), |best, now| if now.1 < best.1 { now } else { best });
        // The end was rounded to blocks; the last samples belong to the periodic part too.
        let full = if part == 20 { samples } else { fine_end };
        if 2 * near > full {
            continue;
        }
        let refined = refine(motion, full - 2 * near, full, near as f64);
        let mismatch = Mismatch::at(motion, full, refined);
        if mismatch.share <= MOST_MISMATCH {
            return Ok((refined, full));
        }
        if fault == PeriodicFault::None {
            // Noise may hide the period among the lags. The noise is judged at the lag of the smallest difference.
            let hidden = Mismatch::at(motion, full, (least * block) as f64);
            if hidden.noise.is_some() {
                fault = PeriodicFault::Mismatch { period: refined, mismatch: hidden };
            } else if repeats(motion, full, near) {
                fault = PeriodicFault::Mismatch { period: refined, mismatch };
            }
        }
    }
    Err(fault)
}

/// Whether the motion differs less from itself at a lag than at half of this lag, over the whole record. A periodic
/// motion does so at its period. A motion that was recorded for a single period has no such lag, even if two short
/// stretches of it look alike.
fn repeats(motion: &[&[f64]], end: usize, lag: usize) -> bool {
    let apart = |lag: usize| -> f64 {
        let of = |c: &&[f64]| {
            let scale = variance(&c[..end]);
            let pairs = c[..end - lag].iter().zip(&c[lag..end]);
            let mean = pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>() / (end - lag) as f64;
            if scale > 0.0 { mean / scale } else { 0.0 }
        };
        motion.iter().map(of).sum()
    };
    apart(lag) < apart(lag / 2)
}

/// The shortest lag whose mean square difference is nearly the smallest of all, and the lag of the smallest; nothing
/// where the motion never repeats.
fn best_lags(motion: &[&[f64]], end: usize) -> Option<(usize, usize)> {
    let whole: Vec<f64> = motion.iter().map(|c| variance(c)).collect();
    let sums: Vec<TailSums> = motion.iter().map(|c| TailSums::of(&c[..end])).collect();
    let differences: Vec<f64> = (0..=end / 2)
        .map(|lag| {
            if lag < 2 {
                return f64::INFINITY;
            }
            if !sums.iter().zip(&whole).any(|(s, whole)| s.variance(2 * lag) > LEAST_MOVING_VARIANCE * whole) {
                return f64::INFINITY;
            }
            motion
                .iter()
                .zip(&sums)
                .map(|(c, s)| {
                    let scale = s.variance(2 * lag);
                    if scale > 0.0 { gap(c, end, lag) / (2.0 * scale) } else { 0.0 }
                })
                .fold(0.0, f64::max)
        })
        .collect();
    // When the period lies between two lags, the signals at either lag differ by their slope times up to half a sample.
    // The minimum of the parabola through three lags estimates the difference at the fractional lag.
    let last = differences.len() - 1;
    let minimum = |lag: usize| {
        let here = differences[lag];
        if lag == last {
            return here;
        }
        let (before, after) = (differences[lag - 1], differences[lag + 1]);
        let bend = before + after - 2.0 * here;
        if bend.is_finite() && bend > 0.0 { (here - (after - before).powi(2) / (8.0 * bend)).max(0.0) } else { here }
    };
    let minima: Vec<(usize, f64)> = (3..=last)
        .filter(|&lag| {
            let here = differences[lag];
            here.is_finite() && here <= differences[lag - 1] && (lag == last || here <= differences[lag + 1])
        })
        .map(|lag| (lag, minimum(lag)))
        .collect();
    let &(at_least, least) = minima.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    // Resolution of the parabola: a small share of the change from one sample to the next.
    let step = motion
        .iter()
        .zip(&whole)
        .filter(|(_, whole)| **whole > 0.0)
        .map(|(c, whole)| {
            let sum: f64 = c.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum();
            sum / c.len() as f64 / (2.0 * whole)
        })
        .fold(0.0, f64::max);
    minima.into_iter().find(|(_, left)| *left <= 4.0 * least + 0.02 * step + 1e-9).map(|(lag, _)| (lag, at_least))
}

/// Mean square difference between the last period and the one before, over twice the variance of the two; the largest of
/// all channels.
fn difference(motion: &[&[f64]], end: usize, lag: usize) -> f64 {
    if lag == 0 || 2 * lag > end {
        return f64::INFINITY;
    }
    motion
        .iter()
        .map(|c| {
            let scale = sampled_variance(&c[end - 2 * lag..end], compared_every(lag));
            if scale > 0.0 { gap(c, end, lag) / (2.0 * scale) } else { 0.0 }
        })
        .fold(0.0, f64::max)
}

/// Mean square difference between the last period and the one before.
fn gap(signal: &[f64], end: usize, lag: usize) -> f64 {
    let (before, last) = signal[end - 2 * lag..end].split_at(lag);
    let every = compared_every(lag);
    let pairs = before.iter().zip(last).step_by(every);
    let compared = lag.div_ceil(every).max(1);
    pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>() / compared as f64
}

/// Distance, in samples, of those samples of a period that are compared with the next period.
fn compared_every(lag: usize) -> usize {
    lag.div_ceil(MOST_COMPARED).max(1)
}

/// Sums over the last samples of a signal, from which the variance of a tail of any length follows in one step.
struct TailSums {
    first: Vec<f64>,
    second: Vec<f64>,
}

impl TailSums {
    fn of(signal: &[f64]) -> Self {
        // The sums are taken about the last value, so that an offset far larger than the motion costs no digits.
        let origin = signal.last().copied().unwrap_or(0.0);
        let (mut first, mut second) = (vec![0.0], vec![0.0]);
        let (mut sum, mut squares) = (0.0, 0.0);
        for x in signal.iter().rev() {
            sum += x - origin;
            squares += (x - origin).powi(2);
            first.push(sum);
            second.push(squares);
        }
        TailSums { first, second }
    }

    fn variance(&self, length: usize) -> f64 {
        let n = length.max(1) as f64;
        (self.second[length] / n - (self.first[length] / n).powi(2)).max(0.0)
    }
}

/// Cubic interpolation between samples; a whole position is the sample itself.
fn value_at(signal: &[f64], position: f64) -> f64 {
    let last = signal.len() - 1;
    let base = position.floor().clamp(0.0, last as f64);
    let t = position - base;
    let at = base as usize;
    if t.abs() < 1e-9 || last < 3 {
        return signal[at];
    }
    let first = at.saturating_sub(1).min(last - 3);
    let u = position - first as f64;
    let [a, b, c, d] = [signal[first], signal[first + 1], signal[first + 2], signal[first + 3]];
    // Lagrange through the nodes 0, 1, 2, 3.
    -a * (u - 1.0) * (u - 2.0) * (u - 3.0) / 6.0 + b * u * (u - 2.0) * (u - 3.0) / 2.0
        - c * u * (u - 1.0) * (u - 3.0) / 2.0
        + d * u * (u - 1.0) * (u - 2.0) / 6.0
}

fn variance(signal: &[f64]) -> f64 {
    sampled_variance(signal, 1)
}

/// Variance of equally spaced samples of a signal, `every` samples apart.
fn sampled_variance(signal: &[f64], every: usize) -> f64 {
    let samples = || signal.iter().step_by(every);
    let n = samples().len().max(1) as f64;
    let mean = samples().sum::<f64>() / n;
    samples().map(|x| (x - mean).powi(2)).sum::<f64>() / n
}

/// First sample from which a signal differs from its last period no more than the last two periods do.
fn settled(signal: &[f64], length: f64) -> usize {
    let end = signal.len();
    let last = (length.round() as usize).min(end);
    let judged = (2.0 * length).round().min(end as f64) as usize;
    // Difference from the value of the last period at the same phase.
    let error: Vec<f64> = (0..end)
        .map(|i| {
            let periods = ((end - 1 - i) as f64 / length + 1e-9).floor();
            signal[i] - value_at(signal, (i as f64 + periods * length).min((end - 1) as f64))
        })
        .collect();
    let size = (last / BLOCKS_PER_PERIOD).max(4);
    let power = |block: &[f64]| block.iter().map(|e| e * e).sum::<f64>() / block.len().max(1) as f64;
    let previous = &error[end - judged..end - last];
    let typical = previous.chunks(size).map(power).fold(0.0, f64::max).sqrt();
    let peak = previous.iter().map(|e| e.abs()).fold(0.0, f64::max);
    // An encoder repeats a periodic motion to within one count; a difference of one count is no transient.
    let count = signal.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let count = if count.is_finite() { count } else { 0.0 };
    let steepest = signal.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    let rounding = LEAST_TRANSIENT * variance(signal).sqrt();
    let limit = MOST_OVER_LAST * typical + rounding + count;
    let sample_limit = MOST_OVER_LAST * peak + 4.0 * rounding + 1.5 * count;
    let mut first = end - judged;
    while first > 0 {
        let from = first.saturating_sub(size);
        let block = &error[from..first];
        // The remaining error of a fractional period adds up from period to period.
        let slip =
            if length.fract() == 0.0 { 0.0 } else { MOST_PERIOD_ERROR * steepest * (end - from) as f64 / length };
        let (limit, sample_limit) = (limit + slip, sample_limit + slip);
        if power(block).sqrt() > limit || block.iter().any(|e| e.abs() > sample_limit) {
            // Within the block, settling ends at the last sample that exceeds the limit.
            let inside = block.iter().rposition(|e| e.abs() > sample_limit).map_or(block.len(), |at| at + 1);
            return from + inside;
        }
        first = from;
    }
    0
}

/// The period to a fraction of a sample, from the phase that the harmonics advance between the first and the last period.
fn refine(motion: &[&[f64]], first: usize, end: usize, length: f64) -> f64 {
    let mut refined = length;
    let highest = (((length - 1.0) / 2.0).floor() as usize).clamp(1, MOST_HARMONICS);
    // Windows one period apart come first, so that no phase is off by a turn; then windows as far apart as the record
    // allows.
    let whole = (((end - first) as f64 / length).floor()).max(2.0) - 1.0;
    let far = (whole - 1.0).max(1.0);
    for apart in [1.0, 1.0, far, far] {
        // With three periods or more, a window of two periods is Hann weighted: the leakage of a fractional period then
        // falls far faster.
        let smooth = (end - first) as f64 >= (2.0 + apart) * refined;
        let window = (if smooth { 2.0 * refined } else { refined }).round() as usize;
        let shift = (apart * refined).round() as usize;
        if window + shift > end - first {
            continue;
        }
        let (mut slope, mut weight) = (0.0, 0.0);
        for channel in motion {
            let scale = variance(channel);
            if scale <= 0.0 {
                continue;
            }
            let early = lines(&channel[end - window - shift..end - shift], refined, highest, smooth);
            let late = lines(&channel[end - window..end], refined, highest, smooth);
            for (k, (a, b)) in early.iter().zip(&late).enumerate() {
                let k = (k + 1) as f64;
                // Im(b conj a) and |a|^2.
                slope += k * (b.1 * a.0 - b.0 * a.1) / scale;
                weight += k * k * (a.0 * a.0 + a.1 * a.1) / scale;
            }
        }
        if weight > 0.0 {
            // Late phases lead by 2 pi k (shift / T - apart).
            let turns = slope / weight / (2.0 * PI);
            let next = shift as f64 / (apart + turns);
            if (next - refined).abs() < 1.0 {
                refined = next;
            }
        }
    }
    refined
}

/// Cosine and sine sums of harmonics 1 to `highest` with the phase e^{-j k w t}.
fn lines(signal: &[f64], period: f64, highest: usize, smooth: bool) -> Vec<(f64, f64)> {
    let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
    let mut sums = vec![(0.0, 0.0); highest];
    for (i, x) in signal.iter().enumerate() {
        let (sin, cos) = (2.0 * PI * i as f64 / period).sin_cos();
        let weight = if smooth { 1.0 - (2.0 * PI * i as f64 / signal.len() as f64).cos() } else { 1.0 };
        let x = weight * (x - mean);
        let (mut c, mut s) = (cos, sin);
        for sum in &mut sums {
            sum.0 += x * c;
            sum.1 -= x * s;
            (c, s) = (c * cos - s * sin, s * cos + c * sin);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::{PeriodicFault, find_periodic};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::PI;

    /// A motion with a strong third harmonic, a decaying start, and noise.
    fn motion(period: f64, n: usize, transient: f64, noise: f64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        (0..n)
            .map(|i| {
                let th = 2.0 * PI * i as f64 / period;
                let random: f64 = StandardNormal.sample(&mut rng);
                0.3 * th.cos()
                    + (3.0 * th).cos()
                    + 0.2 * (5.0 * th).sin()
                    + transient * (-(i as f64) / 50.0).exp()
                    + noise * random
            })
            .collect()
    }

    #[test]
    fn finds_whole_and_broken_periods_and_the_settled_part() {
        for period in [500.0, 413.0, 413.37, 97.5] {
            for noise in [0.0, 1e-3] {
                let x = motion(period, 3000, 0.5, noise);
                let found = find_periodic(&[x], 1, None, None).expect("periodic");
                let error = (found.samples_per_period - period).abs();
                assert!(error < 0.02, "period {period} noise {noise}: {found:?}");
                if period.fract() == 0.0 {
                    assert_eq!(found.samples_per_period, period);
                }
                // The transient falls by a factor e in 50 samples: to 1e-3 after 300 or so, to 1e-8 after 900.
                assert!(found.from < 1000 && found.from > 150, "period {period} noise {noise}: {found:?}");
                assert_eq!(found.periods, ((3000 - found.from) as f64 / period).floor() as usize);
            }
        }
    }

    #[test]
    fn a_period_of_few_blocks_or_of_less_than_one_is_found() {
        // 600,000 samples are searched in blocks of 74.
        for (period, noise) in [(785.0, 1e-3), (413.37, 0.0), (233.0, 1e-2), (97.0, 1e-3), (61.5, 1e-3), (40.0, 0.0)] {
            let x = motion(period, 600_000, 0.5, noise);
            let found = find_periodic(&[x], 1, None, None).expect("periodic");
            assert!((found.samples_per_period - period).abs() < 1e-3, "period {period} noise {noise}: {found:?}");
            assert!(found.steady_from < 2000, "period {period} noise {noise}: {found:?}");
        }
        // Two motions that alternate have the period of both together.
        let mut x = motion(300.0, 600_000, 0.0, 1e-3);
        x.iter_mut().enumerate().for_each(|(i, x)| *x += 0.5 * (2.0 * PI * i as f64 / 3_000.0).cos());
        let found = find_periodic(&[x], 1, None, None).expect("periodic");
        assert_eq!(found.samples_per_period, 3000.0);
    }

    #[test]
    fn the_end_may_be_at_rest() {
        let mut x = motion(300.0, 2400, 0.0, 1e-4);
        x.extend(vec![x[2399]; 700]);
        let found = find_periodic(&[x], 1, None, None).expect("periodic");
        assert_eq!(found.samples_per_period, 300.0);
        assert!(found.from + found.periods * 300 <= 2420, "{found:?}");
        assert!(found.periods >= 4, "{found:?}");
    }

    #[test]
    fn what_does_not_repeat_is_refused() {
        let chirp: Vec<f64> = (0..4000).map(|i| (1e-6 * f64::from(i) * f64::from(i)).sin()).collect();
        assert!(matches!(find_periodic(&[chirp], 1, None, None), Err(PeriodicFault::Mismatch { .. })));
        let ramp: Vec<f64> = (0..4000).map(f64::from).collect();
        assert!(find_periodic(&[ramp], 1, None, None).is_err());
        let x = motion(300.0, 1500, 0.0, 0.0);
        assert!(matches!(
            find_periodic(std::slice::from_ref(&x), 1, Some(251.0), None),
            Err(PeriodicFault::Mismatch { .. })
        ));
        assert_eq!(find_periodic(std::slice::from_ref(&x), 1, Some(5000.0), None), Err(PeriodicFault::Range));
        assert_eq!(find_periodic(&[x], 1, None, Some(5000)), Err(PeriodicFault::Range));
    }

    #[test]
    fn a_single_period_names_no_period() {
        // Shapes and phases at which two short stretches differ less than their neighbours.
        for shape in 0..3 {
            for start in 0..9 {
                let x: Vec<f64> = (0..1000)
                    .map(|i| {
                        let th = 2.0 * PI * f64::from(i) / 1000.0 + 0.7 * f64::from(start);
                        match shape {
                            0 => th.cos(),
                            1 => th.cos() - (3.0 * th).cos() / 9.0,
                            _ => th.cos() + 0.5 * (3.0 * th).sin() + 0.3 * (5.0 * th + 1.0).cos(),
                        }
                    })
                    .collect();
                assert_eq!(find_periodic(&[x], 1, None, None), Err(PeriodicFault::None), "{shape} {start}");
            }
        }
    }

    #[test]
    fn noise_is_told_from_motion_that_does_not_repeat() {
        for (noise, share) in [(0.2, 0.26), (7.3, 0.995)] {
            let x = motion(300.0, 3000, 0.0, noise);
            let fault = find_periodic(std::slice::from_ref(&x), 1, None, None).expect_err("too much noise");
            let PeriodicFault::Mismatch { mismatch, .. } = fault else { panic!("{fault:?}") };
            let found = mismatch.noise.expect("all is noise");
            assert!((found - share).abs() < 0.05, "{noise}: {found}");
            // A stated period is accepted although the record does not hold it twice.
            let stated = find_periodic(&[x], 1, Some(300.0), None).expect("stated");
            assert!(stated.samples_per_period == 300.0 && stated.periods == 10, "{stated:?}");
        }
        let x = motion(300.0, 3000, 0.0, 0.01);
        let fault = find_periodic(&[x], 1, Some(251.0), None);
        let Err(PeriodicFault::Mismatch { period: 251.0, mismatch }) = fault else { panic!("{fault:?}") };
        assert_eq!(mismatch.noise, None);
    }
}
