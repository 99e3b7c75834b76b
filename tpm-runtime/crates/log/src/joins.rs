//! Joins: samples at which the readings jump because another recording begins there.
//!
//! The change of a motion over one sample interval is close to the changes over the neighbouring intervals. Where
//! it is much larger,
//!
//! ```text
//! e_k = |d_k - m| - max |d_i - m| over i in {k-2, k-1, k+1, k+2} ,
//! d_k = y_{k+1} - y_k ,      m the median of these four d_i ,
//! ```
//!
//! (behind readings that repeat the one before, the change makes up for theirs, and is compared with as many of the others' changes)
//! the readings on the two sides belong to different motions: recordings were written one behind the other, or the
//! reading wrapped around. A single wrong reading jumps there and back, so that its e_k is not large.

use crate::repeated::MOST_IN_A_ROW;
use tpm_numerics::differences::deviation_of;

/// Detection threshold of e_k, in standard deviations of the second differences: far beyond noise.
const NOISE_THRESHOLD: f64 = 12.0;
/// Detection threshold of e_k, in least steps of the readings: the rounding errors of five readings together are
/// smaller.
const STEP_THRESHOLD: f64 = 4.0;
/// Detection threshold of e_k, in multiples of the value that one sample in [`SAMPLES_PER_JOIN`] exceeds: a motion in steps jumps
/// now and then.
const RARE_THRESHOLD: f64 = 5.0;
/// Number of samples per join at least; where more samples jump, the jumps belong to the motion.
const SAMPLES_PER_JOIN: usize = 200;
/// Most samples from which the thresholds are computed; of a longer signal equally spaced samples are used.
const MOST_THRESHOLD_SAMPLES: usize = 1 << 18;

/// Samples at which another recording begins, each with its jump beyond the motion's own change, signed, in the
/// signal's unit.
pub(super) fn joins(signal: &[f64]) -> Vec<(usize, f64)> {
    if signal.len() < 9 {
        return Vec::new();
    }
    let moved = |k: usize| signal[k + 1] - signal[k];
    // The change over one interval beyond the median of its neighbours, and e_k.
    let beyond = |k: usize| {
        let held = (1..=MOST_IN_A_ROW).take_while(|at| k > at + 1 && moved(k - at) == 0.0).count();
        let whole = (held + 1) as f64;
        let near = [k - held - 2, k - held - 1, k + 1, k + 2].map(|at| whole * moved(at));
        let (low, high) =
            near.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), d| (low.min(*d), high.max(*d)));
        let median = 0.5 * (near.iter().sum::<f64>() - low - high);
        let far = moved(k) - median;
        (far, far.abs() - (high - median).max(median - low))
    };
    let inner = 2..signal.len() - 3;
    let stride = (inner.len() / MOST_THRESHOLD_SAMPLES).max(1);
    let usual = deviation_of(inner.clone().step_by(stride).map(|k| (moved(k) - moved(k - 1)).abs()));
    let mut sizes: Vec<f64> = inner.clone().step_by(stride).map(|k| beyond(k).1.max(0.0)).collect();
    let rare = sizes.len() - 1 - sizes.len() / SAMPLES_PER_JOIN;
    let rare = *sizes.select_nth_unstable_by(rare, f64::total_cmp).1;
    let least_step = signal.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let least_step = if least_step.is_finite() { least_step } else { 0.0 };
    let far = (NOISE_THRESHOLD * usual).max(STEP_THRESHOLD * least_step).max(RARE_THRESHOLD * rare);
    let found: Vec<(usize, f64)> =
        inner.map(|k| (k, beyond(k))).filter(|(_, (_, more))| *more > far).map(|(k, (by, _))| (k + 1, by)).collect();
    if found.len() * SAMPLES_PER_JOIN > signal.len() { Vec::new() } else { found }
}

#[cfg(test)]
mod tests {
    use super::joins;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn motion(samples: u32, noise: f64, step: f64, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let reading = |i: u32| {
            let random: f64 = StandardNormal.sample(&mut rng);
            let th = 0.01 * f64::from(i);
            let x = th.cos() - (3.0 * th).cos() / 9.0 + noise * random;
            if step > 0.0 { (x / step).round() * step } else { x }
        };
        (0..samples).map(reading).collect()
    }

    const SENSORS: [(f64, f64); 6] = [(0.0, 0.0), (1e-4, 0.0), (3e-3, 0.0), (0.0, 1e-3), (1e-4, 1e-3), (0.0, 0.02)];

    #[test]
    fn recordings_one_behind_the_other_are_told_apart() {
        for (noise, step) in SENSORS {
            let mut signal = motion(6_170, noise, step, 1);
            let second: Vec<f64> = motion(4_000, noise, step, 2).iter().map(|x| 0.1 - 0.5 * x).collect();
            let jump = second[0] - signal[6_169];
            assert!(jump.abs() > 0.2, "{jump}");
            signal.extend(second);
            let found = joins(&signal);
            assert!(
                matches!(found[..], [(6_170, by)] if (by - jump).abs() < 0.02 + 4.0 * noise.max(step)),
                "{noise} {step}: {found:?}"
            );
        }
    }

    #[test]
    fn motions_steps_impacts_and_lone_readings_are_no_joins() {
        for (noise, step) in SENSORS {
            for seed in 0..20 {
                assert_eq!(joins(&motion(10_000, noise, step, seed)), [], "{noise} {step} {seed}");
            }
            let mut signal = motion(10_000, noise, step, 3);
            [40, 777, 5_000, 5_011].into_iter().for_each(|k| signal[k] += 1.0);
            assert_eq!(joins(&signal), [], "lone {noise} {step}");
        }
        // Readings that repeat the one before now and then, up to three in a row: what follows makes up for them.
        for seed in 0..20 {
            let mut signal = motion(10_000, 0.0, 1e-4, seed);
            (5..9_990)
                .step_by(17)
                .for_each(|k| (0..(k + seed as usize) % 4).for_each(|of| signal[k + of] = signal[k - 1]));
            assert_eq!(joins(&signal), [], "repeated {seed}");
        }
        // A staircase of few large steps, a bouncing ball, steps of a motor, noise alone.
        let stair: Vec<f64> = (0..10_000).map(|k| f64::from(k / 100)).collect();
        let ball: Vec<f64> = (0..10_000).map(|k| (0.003 * f64::from(k)).sin().abs()).collect();
        let noise: Vec<f64> = motion(10_000, 1.0, 0.0, 7);
        let rough: Vec<f64> = noise.windows(2).map(|w| w[1] - w[0]).collect();
        for signal in [stair, ball, noise, rough] {
            assert_eq!(joins(&signal), []);
        }
    }
}
