//! Readings at even times, also where some are missing: a motion has a band, and what its readings do not say is refilled from those around.
//!
//! Readings y_i lie at times t_i. With L the straight line through values at these times, read at even times, and B the low pass to the
//! band of the motion,
//!
//! ```text
//! x <- x + B L (y - x(t)) ,      some 30 times from x = 0;      result = x + L (y - x(t)) .
//! ```
//!
//! It converges where no two readings are farther apart than half of the shortest period in the band (Gröchenig 1992). What lies beyond the
//! band, such as the noise of a sensor, stays in the readings that are there; a reading at one of the even times keeps its value.

use serde::Serialize;
use std::f64::consts::PI;
use std::ops::Range;
use tpm_numerics::fourier::{forward, inverse};
use tpm_numerics::{counted, grid, root_mean_square, through};

/// Rounds of refilling.
const ROUNDS: usize = 30;
/// A round that changes a signal by less than this share of the largest change is the last.
const NEGLIGIBLE: f64 = 1e-9;
/// Periods of the shortest oscillation in the band that are taken in on either side of what is refilled.
const PERIODS_AROUND: f64 = 8.0;
/// Width in which the low pass goes over into its stop band, in bands.
const TRANSITION: f64 = 0.5;
/// Longest time between two readings over which a motion is refilled, in shortest periods of its band: there the acceleration errs by 2 %, at
/// .7 of a period by 7 %, at a whole one by half.
pub(super) const LONGEST: f64 = 0.5;
/// An even time this near to a reading, in samples, is its time.
const SAME_TIME: f64 = 1e-6;
/// One reading in so many is hidden where stamps are uneven, to see how it is refilled.
const HIDDEN: usize = 16;

/// The error that refilling makes in a signal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InterpolationError {
    /// The column.
    pub column: String,
    /// Root mean square of the error, in the unit of the signal: of readings that are there and were hidden, with their noise.
    pub rms: f64,
    /// That error as a share of the signal's standard deviation.
    pub share: f64,
}

/// The even times over one stretch of readings.
pub(super) struct Refill<'a> {
    /// Times of the readings in samples, ascending from zero.
    pub(super) at: &'a [f64],
    /// Highest frequency of the motion, in periods a sample.
    pub(super) band: f64,
}

impl Refill<'_> {
    /// The number of even times.
    pub(super) fn samples(&self) -> usize {
        (self.at.last().copied().unwrap_or(0.0) + SAME_TIME).floor() as usize + 1
    }

    /// A signal at even times, from its readings.
    pub(super) fn of(&self, readings: &[f64]) -> Vec<f64> {
        let mut even = line(self.at, readings, 0..self.samples());
        if self.band >= 0.5 {
            return even;
        }
        // Readings of a counter that were lost were counts too. Between uneven stamps the position itself is wanted, not its counts.
        let lost = self.samples().saturating_sub(self.at.len());
        let step = if 2 * lost < self.samples() { counted(readings, grid(readings)) } else { 0.0 };
        for open in self.open() {
            let reach = (PERIODS_AROUND / self.band).ceil();
            let first = self.at.partition_point(|at| *at < open.start as f64 - reach);
            let end = self.at.partition_point(|at| *at <= open.end as f64 + reach);
            // The window begins and ends at readings, so that nothing is refilled beyond them.
            let own = (self.at[first].ceil() as usize)..(self.at[end - 1] + SAME_TIME).floor() as usize + 1;
            let filled = refilled(&self.at[first..end], &readings[first..end], own.clone(), self.band);
            let counts = |value: &f64| if step > 0.0 { (value / step).round() * step } else { *value };
            let filled = filled[open.start - own.start..open.end - own.start].iter().map(counts);
            even[open].iter_mut().zip(filled).for_each(|(even, filled)| *even = filled);
        }
        even
    }

    /// The even times at which no reading lies, joined where they share their surroundings.
    fn open(&self) -> Vec<Range<usize>> {
        let around = (PERIODS_AROUND / self.band) as usize;
        let mut all: Vec<Range<usize>> = Vec::new();
        for pair in self.at.windows(2) {
            let from = (pair[0] + SAME_TIME).floor() as usize + 1;
            let to = (pair[1] - SAME_TIME).ceil() as usize;
            match all.last_mut().filter(|last| last.end + around >= from) {
                _ if from >= to => {}
                Some(last) => last.end = to,
                None => all.push(from..to),
            }
        }
        all
    }

    /// Readings that are hidden to see how well such readings are refilled: as many in a row as are missing somewhere, half way to the next
    /// gap, and single ones where stamps are uneven.
    fn hidden(&self) -> Vec<usize> {
        let apart = |i: usize| (self.at[i] - self.at[i - 1]).round() as usize;
        let mut hidden = Vec::new();
        let uneven = self.at.iter().any(|at| (at - at.round()).abs() > SAME_TIME);
        let gaps: Vec<usize> = (1..self.at.len()).filter(|&i| apart(i) > 1).chain([self.at.len()]).collect();
        for pair in gaps.windows(2) {
            let (missing, middle) = (apart(pair[0]) - 1, (pair[0] + pair[1]) / 2);
            if pair[1] - pair[0] >= 3 * missing + 2 {
                hidden.extend(middle - missing / 2..middle - missing / 2 + missing);
            }
        }
        if uneven {
            hidden.extend((HIDDEN..self.at.len().saturating_sub(HIDDEN)).step_by(HIDDEN));
            hidden.sort_unstable();
            hidden.dedup();
        }
        hidden
    }

    /// Sum of the squares of the errors in readings that were hidden, and their number.
    pub(super) fn errors(&self, readings: &[f64]) -> (f64, usize) {
        let hidden = self.hidden();
        if hidden.is_empty() {
            return (0.0, 0);
        }
        let is_left = |i: &usize| hidden.binary_search(i).is_err();
        let left: Vec<usize> = (0..self.at.len()).filter(is_left).collect();
        let at: Vec<f64> = left.iter().map(|&i| self.at[i]).collect();
        let values: Vec<f64> = left.iter().map(|&i| readings[i]).collect();
        let even = Refill { at: &at, band: self.band }.of(&values);
        let square = |&i: &usize| (at_time(&even, self.at[i]) - readings[i]).powi(2);
        (hidden.iter().map(square).sum(), hidden.len())
    }
}

/// The straight line through values at ascending times, at even times.
fn line(at: &[f64], values: &[f64], even: Range<usize>) -> Vec<f64> {
    let mut i = 0;
    even.map(|k| {
        let time = k as f64;
        while i + 2 < at.len() && at[i + 1] <= time + SAME_TIME {
            i += 1;
        }
        let Some(next) = at.get(i + 1) else { return values[i] };
        let share = ((time - at[i]) / (next - at[i])).clamp(0.0, 1.0);
        match share {
            _ if (time - at[i]).abs() <= SAME_TIME => values[i],
            _ if (time - next).abs() <= SAME_TIME => values[i + 1],
            _ => values[i] + share * (values[i + 1] - values[i]),
        }
    })
    .collect()
}

/// A smooth signal of even samples at a time between them.
fn at_time(even: &[f64], time: f64) -> f64 {
    let nearest = time.round();
    if (time - nearest).abs() <= SAME_TIME || even.len() < 4 {
        return even[(nearest as usize).min(even.len() - 1)];
    }
    let first = (time.floor() as usize).saturating_sub(1).min(even.len() - 4);
    through([0, 1, 2, 3].map(|k| (first + k) as f64 - time), [0, 1, 2, 3].map(|k| even[first + k]), 0.0)
}

/// Readings at these even times, refilled to a band.
fn refilled(at: &[f64], readings: &[f64], even: Range<usize>, band: f64) -> Vec<f64> {
    let at: Vec<f64> = at.iter().map(|at| at - even.start as f64).collect();
    let (samples, last) = (even.len(), even.len() - 1);
    let first = line(&at, readings, 0..samples);
    if last < 2 {
        return first;
    }
    // A transform goes round. Beyond its end the stretch goes back to its beginning, turned about both, so that there is no step and no
    // corner; no reading lies there, so that it is refilled as every gap is.
    let points = 2 * last;
    let straight = |at: f64| first[0] + (first[last] - first[0]) * at / last as f64;
    let turned = |k: usize| {
        if k <= last { first[k] - straight(k as f64) } else { straight((points - k) as f64) - first[points - k] }
    };
    let mut more: Vec<f64> = (0..points).map(turned).collect();
    let own: Vec<f64> = readings.iter().zip(&at).map(|(y, at)| y - straight(*at)).collect();
    let (mut smooth, mut rest, mut largest) = (vec![0.0; points], Vec::new(), 0.0);
    for _ in 0..ROUNDS {
        let size = low_pass(&mut more, band);
        largest = size.max(largest);
        smooth.iter_mut().zip(&more).for_each(|(sum, more)| *sum += more);
        let left: Vec<f64> = own.iter().zip(&at).map(|(y, at)| y - at_time(&smooth[..samples], *at)).collect();
        rest = line(&at, &left, 0..samples);
        if size <= NEGLIGIBLE * largest {
            break;
        }
        let back = |k: usize| rest[last] + (rest[0] - rest[last]) * (k - last) as f64 / last as f64;
        more = rest.iter().copied().chain((last + 1..points).map(back)).collect();
    }
    (0..samples).map(|k| rest[k] + smooth[k] + straight(k as f64)).collect()
}

/// Passes what is below a frequency, in periods a sample, and less and less up to half above it, since a stretch that ends has no sharp
/// lines. Returns the root mean square of what passes.
fn low_pass(signal: &mut [f64], band: f64) -> f64 {
    let points = signal.len();
    let (plan, back) = (forward(points), inverse(points));
    let mut bins = plan.make_output_vec();
    plan.process(signal, &mut bins).expect("invariant: buffers were made for this transform");
    for (k, bin) in bins.iter_mut().enumerate() {
        let above = (k as f64 / (points as f64 * band) - 1.0) / TRANSITION;
        *bin *= (0.5 + 0.5 * (PI * above.clamp(0.0, 1.0)).cos()) / points as f64;
    }
    back.process(&mut bins, signal).expect("invariant: the spectrum of real samples is real at both ends");
    root_mean_square(signal.iter().copied())
}

#[cfg(test)]
mod tests {
    use super::Refill;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::TAU;

    /// A motion of sines up to this frequency, in periods a sample, and its acceleration.
    fn motion(band: f64, t: f64) -> [f64; 2] {
        let sine = |(share, phase): (f64, f64)| {
            let w = TAU * share * band;
            let x = (w * t + phase).sin() / share;
            [x, -w * w * x]
        };
        let all = [(0.11, 0.3), (0.27, 1.1), (0.46, 2.0), (0.71, 4.0), (0.97, 5.1)].map(sine);
        [0, 1].map(|of| all.iter().map(|own| own[of]).sum())
    }

    /// Second differences over a step that is small beside the band, as a share of the rms of the acceleration, within a gap.
    fn error_of_acceleration(band: f64, gap: usize, noise: f64) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let size = (0..4000).map(|k| motion(band, f64::from(k))[1].powi(2)).sum::<f64>() / 4000.0;
        let (mut square, mut count) = (0.0, 0.0);
        for from in (600..3400).step_by(97) {
            let at: Vec<f64> = (0..4000).filter(|k| *k <= from || *k >= from + gap).map(|k| k as f64).collect();
            let mut reading = |at: &f64| {
                let random: f64 = StandardNormal.sample(&mut rng);
                motion(band, *at)[0] + noise * random
            };
            let readings: Vec<f64> = at.iter().map(&mut reading).collect();
            let refill = Refill { at: &at, band }.of(&readings);
            let wide = ((0.1 / band) as usize).min(gap / 2 - 1);
            for k in from + wide..=from + gap - wide {
                let of = |k: usize| refill[k] - motion(band, k as f64)[0];
                square += ((of(k + wide) - 2.0 * of(k) + of(k - wide)) / (wide * wide) as f64).powi(2) / size;
                count += 1.0;
            }
        }
        f64::sqrt(square / count)
    }

    #[test]
    fn gaps_of_half_a_period_are_refilled() {
        for (share, most) in [(0.1, 5e-3), (0.25, 0.01), (0.5, 0.02)] {
            let error = error_of_acceleration(0.008, (share / 0.008) as usize, 0.0);
            assert!(error < most, "{share}: {error}");
        }
        // Noise makes no more of it: a cubic through the readings beside the gap would err by nearly all.
        let noisy = error_of_acceleration(0.008, 62, 1e-4);
        assert!(noisy < 0.03, "{noisy}");
    }

    #[test]
    fn readings_at_uneven_times_are_refilled_and_the_error_is_stated() {
        let at: Vec<f64> =
            (0..3000).map(|k| f64::from(k) + 0.4 * (0.7 * f64::from(k)).sin() * f64::from(k.min(1))).collect();
        let readings: Vec<f64> = at.iter().map(|at| motion(0.05, *at)[0]).collect();
        let refill = Refill { at: &at, band: 0.06 };
        let even = refill.of(&readings);
        let wrong = |k: usize| (even[k] - motion(0.05, k as f64)[0]).powi(2);
        let error = ((100..2900).map(wrong).sum::<f64>() / 2800.0).sqrt();
        let (square, count) = refill.errors(&readings);
        let stated = (square / count as f64).sqrt();
        assert!(error < 2e-3 && error < 2.0 * stated && stated < 20.0 * error, "{error} {stated}");
        // A reading at an even time keeps its value.
        assert_eq!(even[0].to_bits(), readings[0].to_bits());
    }
}
