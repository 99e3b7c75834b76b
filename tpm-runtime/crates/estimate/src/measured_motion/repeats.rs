//! Rounding to counts that records of one motion repeat.
//!
//! The quantisation error of a reading follows from the motion at that moment. Records of the same motion therefore share a part of it,
//! which does not average out: over n records its variance counts n times in each, so that it remains whole in their mean. Invariant: how
//! much two records share follows from how far their motions are apart in counts, and from nothing else (`DESIGN.md`, "What does an
//! encoder do to an estimate?").

use crate::noise::{Bins, row_rounding};
use num_complex::Complex;
use tpm_motion::{Spectra, repeating_variance};

/// The motion of a record, and what rounding it to counts does to the rows.
#[derive(Clone, Debug)]
pub(super) struct Repeats {
    samples_per_period: f64,
    sample_time: f64,
    coordinates: Vec<Rounded>,
}

/// A coordinate whose readings are counts.
#[derive(Clone, Debug)]
struct Rounded {
    /// Its channel.
    channel: usize,
    step: f64,
    lines: Vec<Complex<f64>>,
    /// Variance of every row's phasors by harmonic that its rounding makes in all records of this motion.
    variance: Vec<Vec<f64>>,
}

impl Repeats {
    /// Of a record whose rows use harmonics up to `used`, and to every line of whose coordinates rounding gives these powers; nothing where
    /// no coordinate is read in counts.
    pub(super) fn of(
        spectra: &Spectra,
        bins: &Bins<'_>,
        powers: &[f64],
        used: &[usize],
        slots: &[(usize, usize)],
        gains: &[Vec<Vec<Complex<f64>>>],
    ) -> Option<Self> {
        let highest = used.iter().copied().max().unwrap_or(0);
        let of = |(channel, &power): (usize, &f64)| {
            (power > 0.0).then(|| {
                let mut alone = vec![0.0; powers.len()];
                alone[channel] = power;
                let rows = used.iter().zip(gains);
                let variance = rows.map(|(&used, gain)| row_rounding(bins, used, slots, gain, &alone)).collect();
                let lines = spectra.lines[channel].iter().take(highest + 1).copied().collect();
                Rounded { channel, step: spectra.step(channel), lines, variance }
            })
        };
        let coordinates: Vec<Rounded> = powers.iter().enumerate().filter_map(of).collect();
        let (samples_per_period, sample_time) = (spectra.samples_per_period, spectra.sample_time);
        (!coordinates.is_empty()).then_some(Repeats { samples_per_period, sample_time, coordinates })
    }

    /// The share of a coordinate's repeated rounding that another record has too.
    fn shared(&self, own: &Rounded, other: &Self) -> f64 {
        let sampled = |repeats: &Self| (repeats.samples_per_period.to_bits(), repeats.sample_time.to_bits());
        let Some(theirs) = other.coordinates.iter().find(|theirs| theirs.channel == own.channel) else { return 0.0 };
        if sampled(self) != sampled(other) {
            return 0.0;
        }
        let zero = Complex::new(0.0, 0.0);
        let apart = |k: usize| own.lines.get(k).unwrap_or(&zero) - theirs.lines.get(k).unwrap_or(&zero);
        let lines = own.lines.len().max(theirs.lines.len());
        let apart: f64 = (0..lines).map(|k| apart(k).norm_sqr() * if k == 0 { 1.0 } else { 0.5 }).sum();
        // Motions that are apart by a part of a count share what noise of half this power would leave of a rounding error in each.
        repeating_variance(0.5 * apart / (own.step * own.step)) / repeating_variance(0.0)
    }
}

/// For every record, by row and harmonic, the variance of what other records repeat of its rounding, times how many they are.
pub(super) fn repeated(all: &[Option<&Repeats>], rows: usize) -> Vec<Vec<Vec<f64>>> {
    let of = |(i, own): (usize, &Option<&Repeats>)| -> Vec<Vec<f64>> {
        let mut sums = vec![Vec::new(); rows];
        let Some(own) = own else { return sums };
        for rounded in &own.coordinates {
            let others = all.iter().enumerate().filter(|(j, _)| *j != i);
            let shares: f64 = others.filter_map(|(_, other)| Some(own.shared(rounded, (*other)?))).sum();
            for (sum, variance) in sums.iter_mut().zip(&rounded.variance) {
                sum.resize(variance.len(), 0.0);
                sum.iter_mut().zip(variance).for_each(|(sum, variance)| *sum += shares * variance);
            }
        }
        sums
    };
    all.iter().enumerate().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::{Repeats, Rounded, repeated};
    use num_complex::Complex;

    /// A record of a motion of this amplitude, in counts.
    fn record(amplitude: f64, sample_time: f64) -> Repeats {
        let lines = vec![Complex::new(0.0, 0.0), Complex::new(amplitude, 0.0)];
        let coordinate = Rounded { channel: 0, step: 1.0, lines, variance: vec![vec![2.0, 3.0]] };
        Repeats { samples_per_period: 100.0, sample_time, coordinates: vec![coordinate] }
    }

    #[test]
    fn records_share_what_their_motions_round_alike() {
        let (first, same, near) = (record(10.0, 0.01), record(10.0, 0.01), record(10.2, 0.01));
        let (apart, sampled_otherwise) = (record(12.0, 0.01), record(10.0, 0.02));
        assert_eq!(repeated(&[Some(&first)], 1), [vec![vec![0.0, 0.0]]], "nothing without another record");
        let two = repeated(&[Some(&first), Some(&same), None], 1);
        assert_eq!(two[0], [vec![2.0, 3.0]]);
        assert_eq!(two[1], two[0]);
        assert!(two[2][0].is_empty(), "no counts, nothing to share");
        let share = |other| repeated(&[Some(&first), Some(other)], 1)[0][0][1] / 3.0;
        // A mean square of 0.02 apart leaves exp(-0.04 pi^2 m^2) / m^2 of the m-th term of the sum of 1 / m^2.
        assert!((0.44..0.45).contains(&share(&near)), "{}", share(&near));
        assert!(share(&apart) < 1e-6, "{}", share(&apart));
        assert!(share(&sampled_otherwise).abs() < f64::EPSILON);
    }
}
