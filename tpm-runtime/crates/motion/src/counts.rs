//! Quantisation: readings of a sensor that are rounded to counts.

use std::f64::consts::PI;

/// Number of harmonics of the saw tooth of the rounding error that are summed.
const SAW_TOOTH_HARMONICS: u32 = 100;
/// Bisections of the interval in which a noise variance is sought.
const NOISE_BISECTIONS: u32 = 40;
/// Attenuation of a harmonic of the saw tooth by noise below which this and all higher harmonics are negligible.
const LEAST_ATTENUATION: f64 = 1e-12;

/// Lengths, in the order of the samples, of the stretches of successive samples whose rounding errors are nearly equal.
///
/// Rounding errors stay nearly equal while the motion advances by a nearly whole number of counts of size `step` from
/// sample to sample, or rests. Readings with nearly equal rounding errors count as one independent reading.
pub fn equal_rounding_runs(motion: &[f64], step: f64) -> Vec<usize> {
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

/// Variance, in counts squared, of the part of a rounding error that is a function of the motion alone, beside sensor
/// noise of variance `noise`, in counts squared.
///
/// The mean of the rounding error over the noise is a saw tooth over the count, whose m-th harmonic noise of s counts makes smaller by
/// exp(-2 pi^2 s^2 m^2) (Widrow and Kollar, Quantization Noise, 2008). Without noise it is the whole error, of variance 1/12.
pub fn repeating_variance(noise: f64) -> f64 {
    let harmonic = |m: u32| {
        let order = 2.0 * PI * PI * f64::from(m * m);
        (-2.0 * order * noise).exp() / order
    };
    (1..=SAW_TOOTH_HARMONICS).map(harmonic).sum()
}

/// Variance of a sensor's noise, in counts squared, from the variance `between` of its readings between periods, in
/// counts squared.
///
/// The error of a reading has the noise variance plus 1/12. Of this, [`repeating_variance`] is the same in every period and does
/// not show in `between`.
pub fn noise_variance(between: f64) -> f64 {
    let (mut low, mut high) = ((between - 1.0 / 12.0).max(0.0), between.max(0.0));
    for _ in 0..NOISE_BISECTIONS {
        let middle = f64::midpoint(low, high);
        if middle + 1.0 / 12.0 - repeating_variance(middle) < between { low = middle } else { high = middle }
    }
    f64::midpoint(low, high)
}

/// Mean rounding error, in counts, of a value in counts under normal noise of variance `noise`, in counts squared.
///
/// It is the saw tooth described at [`repeating_variance`], which the noise smooths.
pub fn mean_error(value: f64, noise: f64) -> f64 {
    let turn = 2.0 * PI * (value - value.round());
    let mut error = 0.0;
    for m in 1..=SAW_TOOTH_HARMONICS {
        let order = f64::from(m);
        let left = (-2.0 * (PI * order).powi(2) * noise).exp();
        if left < LEAST_ATTENUATION {
            break;
        }
        let sign = if m % 2 == 0 { 1.0 } else { -1.0 };
        error += sign * left * (order * turn).sin() / (PI * order);
    }
    error
}

#[cfg(test)]
mod tests {
    use super::{equal_rounding_runs, mean_error, noise_variance, repeating_variance};

    #[test]
    fn errors_are_alike_at_rest_and_at_whole_counts() {
        assert_eq!(equal_rounding_runs(&[0.3; 8], 0.1), [8]);
        let at_whole_counts: Vec<f64> = (0..8).map(|k| 0.03 + 0.2 * f64::from(k)).collect();
        assert_eq!(equal_rounding_runs(&at_whole_counts, 0.1), [8]);
        // A third of a count from sample to sample: two samples within half of one.
        let slow: Vec<f64> = (0..8).map(|k| f64::from(k) / 30.0).collect();
        assert_eq!(equal_rounding_runs(&slow, 0.1), [2, 2, 2, 2]);
        assert_eq!(equal_rounding_runs(&[], 0.1), vec![0_usize; 0]);
    }

    #[test]
    fn noise_makes_rounding_errors_independent_of_the_motion() {
        assert!((repeating_variance(0.0) * 12.0 - 1.0).abs() < 0.01);
        for sigma in [0.1, 0.2, 0.3, 0.5_f64] {
            // The mean rounding error of x + n by quadrature over normal n, squared and averaged over a count.
            let normal = |z: f64| (-0.5 * z * z).exp();
            let points: Vec<f64> = (-8000..=8000).map(|i| f64::from(i) * 0.001).collect();
            let total: f64 = points.iter().map(|z| normal(*z)).sum();
            let mean = |x: f64| -> f64 {
                let error = |z: &f64| ((x + sigma * z).round() - (x + sigma * z)) * normal(*z);
                points.iter().map(error).sum::<f64>() / total
            };
            let squares = (0..400).map(|i| mean((f64::from(i) + 0.5) / 400.0).powi(2)).sum::<f64>() / 400.0;
            let found = repeating_variance(sigma * sigma);
            assert!((found - squares).abs() < 1e-2 * squares + 1e-7, "{sigma}: {found:e} {squares:e}");
            for x in [0.1, 0.25, 0.45, 3.7, -1.2] {
                let found = mean_error(x, sigma * sigma);
                // The quadrature is wrong by up to a point where the rounding jumps.
                assert!((found - mean(x)).abs() < 5e-4, "{sigma}, {x}: {found} {}", mean(x));
            }
            // The variance between periods: that of the reading's error about its mean at this value.
            let whole = |x: f64| -> f64 {
                let error = |z: &f64| ((x + sigma * z).round() - x).powi(2) * normal(*z);
                points.iter().map(error).sum::<f64>() / total
            };
            let between = (0..400).map(|i| whole((f64::from(i) + 0.5) / 400.0)).sum::<f64>() / 400.0 - squares;
            let noise = noise_variance(between);
            assert!((noise / (sigma * sigma) - 1.0).abs() < 1e-2, "{sigma}: {noise}");
        }
    }
}
