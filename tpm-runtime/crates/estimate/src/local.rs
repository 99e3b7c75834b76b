//! A motion and its derivatives from samples alone, by polynomials over a few samples each (Savitzky and Golay).

use tpm_numerics::DMatrix;

/// Derivatives 0 to `order` of a signal at every `stride`-th sample, sample by sample: those of the polynomial of degree `order + 1` that fits
/// `2 half + 1` samples best, at the ends of the signal the nearest ones. Nothing where the signal is shorter.
pub(crate) fn derivatives(
    signal: &[f64],
    sample_time: f64,
    half: usize,
    order: usize,
    stride: usize,
) -> Option<Vec<f64>> {
    let width = 2 * half + 1;
    let degree = order + 1;
    if signal.len() < width || width <= degree {
        return None;
    }
    let at = |i: usize| (i as f64 - half as f64) / half as f64;
    let powers = DMatrix::from_fn(width, degree + 1, |i, d| at(i).powi(d as i32));
    let weights = powers.tr_mul(&powers).cholesky()?.solve(&powers.transpose());
    let last = signal.len() - width;
    let mut fitted = vec![0.0; degree + 1];
    let mut out = vec![0.0; signal.len().div_ceil(stride) * (order + 1)];
    for (i, values) in out.chunks_exact_mut(order + 1).enumerate() {
        let k = i * stride;
        let from = k.saturating_sub(half).min(last);
        fitted.fill(0.0);
        for (column, value) in weights.column_iter().zip(&signal[from..from + width]) {
            fitted.iter_mut().zip(column.iter()).for_each(|(sum, weight)| *sum += weight * value);
        }
        let x = at(k - from);
        for (derivative, value) in values.iter_mut().enumerate() {
            let term = |power: usize| {
                let falling: f64 = (power - derivative + 1..=power).map(|p| p as f64).product();
                fitted[power] * falling * x.powi((power - derivative) as i32)
            };
            let scale = (half as f64 * sample_time).powi(derivative as i32);
            *value = (derivative..=degree).map(term).sum::<f64>() / scale;
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::derivatives;

    #[test]
    fn a_cubic_has_its_own_derivatives_everywhere() {
        let h = 0.01;
        let signal: Vec<f64> = (0..80).map(|i| (i as f64 * h).powi(3) - 2.0 * i as f64 * h).collect();
        let found = derivatives(&signal, h, 6, 2, 1).expect("long enough");
        for (i, values) in found.chunks_exact(3).enumerate() {
            let t = i as f64 * h;
            let expected = [t.powi(3) - 2.0 * t, 3.0 * t * t - 2.0, 6.0 * t];
            assert!(values.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{i}: {values:?} {expected:?}");
        }
    }
}
