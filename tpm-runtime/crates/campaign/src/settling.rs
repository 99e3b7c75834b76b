//! Test of whether a motion has settled.
//!
//! Invariant: settling is tested on the record, never assumed. Every period is compared with the last one. A transient
//! appears as a difference that decreases from period to period, noise as a difference that stays constant.

use tpm_motion::Record;
use tpm_numerics::tolerance;

/// Largest mean square difference between a settled period and the last one, as a multiple of the mean of the latest
/// three such differences.
const MOST_RATIO_TO_LATEST: f64 = 2.0;

/// Index of the first period, at least `least`, from which the coordinates repeat; nothing when fewer than two periods
/// remain after it.
#[must_use]
pub fn settled_from(record: &Record, samples_per_period: usize, least: usize) -> Option<usize> {
    let periods = record.len().checked_div(samples_per_period)?;
    if periods < least + 2 {
        return None;
    }
    let last = periods - 1;
    let mut first = least;
    for channel in &record.coordinates {
        let block = |k: usize| &channel[k * samples_per_period..(k + 1) * samples_per_period];
        let mean = channel[..periods * samples_per_period].iter().sum::<f64>() / (periods * samples_per_period) as f64;
        let power = block(last).iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
        let differences: Vec<f64> =
            (0..last).map(|k| block(k).iter().zip(block(last)).map(|(a, b)| (a - b) * (a - b)).sum()).collect();
        // The level of the noise is the mean over the latest three periods alone, so that a slow transient that is
        // still falling does not raise it.
        let latest = &differences[last.saturating_sub(3)..];
        let level = latest.iter().sum::<f64>() / latest.len() as f64;
        let bound = MOST_RATIO_TO_LATEST * level + tolerance::READING * tolerance::READING * power;
        let moving = differences.iter().rposition(|d| d.is_nan() || *d > bound).map_or(0, |k| k + 1);
        first = first.max(moving);
    }
    (first + 2 <= periods).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::settled_from;
    use tpm_motion::{Ending, Record};

    fn record(transient: f64, decay: f64, noise: f64) -> Record {
        let mut state = 1u32;
        let x: Vec<f64> = (0..1000)
            .map(|n| {
                // A linear congruential generator is good enough for this noise.
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let random = f64::from(state >> 8) / f64::from(1u32 << 24) - 0.5;
                let phase = 2.0 * std::f64::consts::PI * f64::from(n % 100) / 100.0;
                phase.cos() + transient * (-f64::from(n) / (100.0 * decay)).exp() + noise * random
            })
            .collect();
        Record {
            sample_time: 0.01,
            coordinates: vec![x],
            inputs: vec![],
            rates: vec![],
            ending: Ending::Complete,
            saturated: 0,
        }
    }

    #[test]
    fn transients_are_seen_above_noise_and_rounding() {
        assert_eq!(settled_from(&record(0.0, 1.0, 0.0), 100, 2), Some(2));
        assert_eq!(settled_from(&record(0.0, 1.0, 0.1), 100, 1), Some(1));
        assert_eq!(settled_from(&record(1.0, 0.2, 0.0), 100, 1), Some(4));
        let noisy = settled_from(&record(1.0, 0.5, 0.02), 100, 1).expect("settles");
        assert!((2..=4).contains(&noisy), "{noisy}");
        assert_eq!(settled_from(&record(0.0, 1.0, 0.0), 600, 0), None);
    }

    #[test]
    fn a_motion_that_goes_on_settling_is_refused() {
        // After ten periods, a third of the decay that this motion needs, too few periods are left to measure anything.
        assert_eq!(settled_from(&record(1.0, 30.0, 0.0), 100, 1), Some(6));
        let mut broken = record(0.0, 1.0, 0.0);
        broken.coordinates[0][950] = f64::NAN;
        assert_eq!(settled_from(&broken, 100, 1), None);
    }
}
