//! Readings that are rounded to counts.

use std::vec::Vec;

/// Lengths of the stretches of successive samples in which the rounding errors of a motion are alike, in the order of the samples.
///
/// Rounding errors stay alike while the motion advances by nearly whole counts from sample to sample, none among them. Those that are
/// alike are one reading.
pub(crate) fn alike(motion: &[f64], step: f64) -> Vec<usize> {
    let mut lengths = Vec::new();
    let mut k = 0;
    while k < motion.len() {
        let first = k;
        let mut phase = 0.0_f64;
        while k < motion.len() && phase.abs() < 0.5 {
            let counts = motion.get(k + 1).map_or(0.5, |next| (next - motion[k]) / step);
            phase += counts - counts.round();
            k += 1;
        }
        lengths.push(k - first);
    }
    lengths
}

#[cfg(test)]
mod tests {
    use super::alike;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn errors_are_alike_at_rest_and_at_whole_counts() {
        assert_eq!(alike(&[0.3; 8], 0.1), [8]);
        let at_whole_counts: Vec<f64> = (0..8).map(|k| 0.03 + 0.2 * f64::from(k)).collect();
        assert_eq!(alike(&at_whole_counts, 0.1), [8]);
        // A third of a count from sample to sample: two samples within half of one.
        let slow: Vec<f64> = (0..8).map(|k| f64::from(k) / 30.0).collect();
        assert_eq!(alike(&slow, 0.1), [2, 2, 2, 2]);
        let half: Vec<f64> = (0..4).map(|k| 0.05 * f64::from(k)).collect();
        assert_eq!(alike(&half, 0.1), [1, 1, 1, 1]);
        assert_eq!(alike(&[], 0.1), vec![0_usize; 0]);
    }
}
