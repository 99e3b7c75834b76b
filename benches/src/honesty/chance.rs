//! What chance allows of a count.

/// The counts of successes among `trials` of probability `p` that a binomial variable does not leave by more than the probability
/// `outside` in all, half of it on either side: the least and the greatest.
#[must_use]
pub fn binomial_band(trials: u32, p: f64, outside: f64) -> (u32, u32) {
    let probabilities = probabilities(trials, p);
    // How many outcomes from an end on hold less than half of what may lie outside.
    let beyond = |from_the_end: &mut dyn Iterator<Item = &f64>| {
        let mut sum = 0.0;
        let mut count = 0;
        for probability in from_the_end {
            sum += probability;
            if sum >= 0.5 * outside {
                break;
            }
            count += 1;
        }
        count
    };
    (beyond(&mut probabilities.iter()), trials - beyond(&mut probabilities.iter().rev()))
}

/// Probabilities of 0, 1, ... successes, each from the one before it; logarithms, since the first is tiny.
fn probabilities(trials: u32, p: f64) -> Vec<f64> {
    let n = f64::from(trials);
    let odds = (p / (1.0 - p)).ln();
    let mut logarithm = n * (1.0 - p).ln();
    let next = |k: u32| {
        let now = logarithm.exp();
        logarithm += ((n - f64::from(k)) / f64::from(k + 1)).ln() + odds;
        now
    };
    (0..=trials).map(next).collect()
}

#[cfg(test)]
mod tests {
    use super::{binomial_band, probabilities};

    #[test]
    fn bands_are_those_of_the_exact_sums() {
        let sum: f64 = probabilities(200, 0.95).iter().sum();
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        // 89.5 to 99 % of two hundred, at least 82 % of fifty.
        assert_eq!(binomial_band(200, 0.95, 1e-3), (179, 198));
        assert_eq!(binomial_band(50, 0.95, 1e-3).0, 41);
        // One in four of ten coin tosses or fewer has the probability 0.0107, two or fewer 0.0547.
        assert_eq!(binomial_band(10, 0.5, 0.1), (2, 8));
        assert_eq!(binomial_band(1, 0.95, 1e-3), (0, 1));
    }
}
