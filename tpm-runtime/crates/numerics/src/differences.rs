//! Difference quotients, and differences of samples.

/// Five-point stencil of the first derivative: shifts in steps h, and the weights of the values there. The weighted sum
/// divided by `12 h` is the derivative, exact for polynomials up to the fourth degree.
pub const FIVE_POINT: [(f64, f64); 4] = [(-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0)];

/// Relative variance of the noise variance that [`white_noise`] estimates (its square), times the number of samples.
pub const WHITE_NOISE_SPREAD: f64 = 12.5;

/// Median of the magnitude of a normal variable of unit variance.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_082;

/// Standard deviation of the white noise on a signal, in the signal's unit. It is estimated by the median magnitude of
/// the sixth differences, in which a densely sampled motion is negligible. Zero for fewer than seven samples.
pub fn white_noise(signal: &[f64]) -> f64 {
    const BINOMIAL: [f64; 7] = [1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0];
    let power: f64 = BINOMIAL.iter().map(|b| b * b).sum();
    let difference = |w: &[f64]| w.iter().zip(&BINOMIAL).map(|(x, b)| x * b).sum::<f64>().abs();
    deviation_of(signal.windows(BINOMIAL.len()).map(difference)) / power.sqrt()
}

/// Standard deviation of a normal variable, estimated by the median of its magnitudes `sizes`, which a few outliers do
/// not move; zero without any.
pub fn deviation_of(sizes: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = sizes.collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    *median / MEDIAN_OF_NORMAL
}

#[cfg(test)]
mod tests {
    use super::{WHITE_NOISE_SPREAD, white_noise};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn white_noise_on_a_slow_motion_is_read_with_the_stated_spread() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (records, samples, deviation) = (400, 1000, 0.01);
        let squares: Vec<f64> = (0..records)
            .map(|_| {
                let signal: Vec<f64> = (0..samples)
                    .map(|i| {
                        let random: f64 = StandardNormal.sample(&mut rng);
                        (0.05 * f64::from(i)).sin() + deviation * random
                    })
                    .collect();
                (white_noise(&signal) / deviation).powi(2)
            })
            .collect();
        let count = f64::from(records);
        let mean = squares.iter().sum::<f64>() / count;
        let variance = squares.iter().map(|square| (square - mean).powi(2)).sum::<f64>() / (count - 1.0);
        assert!((mean - 1.0).abs() < 0.03, "{mean}");
        // The variance of 400 values is itself uncertain by 7 %.
        assert!((variance * f64::from(samples) / WHITE_NOISE_SPREAD - 1.0).abs() < 0.25, "{variance}");
        assert_eq!(white_noise(&[1.0, 2.0]), 0.0);
    }
}
