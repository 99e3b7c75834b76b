//! What errors with a colour do to deviations.
//!
//! With residuals e of one sensor an autoregression `e_k = sum phi_i e_{k-i} + w_k`, the covariance of its readings is `R = s^2 F^-1 F^-T`
//! with F the filter `1 - sum phi_i z^-i`, so that `J' R J = s^2 |F^-T J|^2`: the columns of J are filtered backwards in time.

use tpm_numerics::DMatrix;

/// Highest order of the autoregression, and readings that each of its coefficients asks for.
const HIGHEST: usize = 12;
const READINGS_PER_ORDER: usize = 10;

/// An autoregression through residuals.
#[derive(Clone, Debug)]
pub(super) struct Colour {
    pub(super) coefficients: Vec<f64>,
    /// Variance of its noise.
    pub(super) variance: f64,
}

impl Colour {
    /// The autoregression through several series of residuals, of the order that Akaike's criterion chooses (Levinson and Durbin).
    pub(super) fn of(series: &[Vec<f64>]) -> Self {
        let count: usize = series.iter().map(Vec::len).sum();
        let highest = HIGHEST.min(count / READINGS_PER_ORDER);
        let covariance = |lag: usize| -> f64 {
            let of = |own: &Vec<f64>| own.iter().skip(lag).zip(own).map(|(a, b)| a * b).sum::<f64>();
            series.iter().map(of).sum::<f64>() / count.max(1) as f64
        };
        let covariances: Vec<f64> = (0..=highest).map(covariance).collect();
        let mut variance = covariances[0];
        let mut own: Vec<f64> = Vec::new();
        let criterion = |variance: f64, order: usize| count as f64 * variance.ln() + 2.0 * order as f64;
        let mut best = (criterion(variance, 0), Colour { coefficients: Vec::new(), variance });
        for order in 1..=highest {
            if variance <= 0.0 {
                break;
            }
            let known: f64 = own.iter().enumerate().map(|(i, phi)| phi * covariances[order - 1 - i]).sum();
            let reflection = (covariances[order] - known) / variance;
            let before = own.clone();
            for (i, phi) in own.iter_mut().enumerate() {
                *phi -= reflection * before[order - 2 - i];
            }
            own.push(reflection);
            variance *= 1.0 - reflection * reflection;
            if criterion(variance, order) < best.0 {
                best = (criterion(variance, order), Colour { coefficients: own.clone(), variance });
            }
        }
        best.1
    }

    /// `J' R J` of the rows of one sensor in the order of time.
    pub(super) fn square(&self, mut rows: DMatrix<f64>) -> DMatrix<f64> {
        let count = rows.nrows();
        for k in (0..count).rev() {
            for (i, phi) in self.coefficients.iter().enumerate().take(count - k - 1) {
                let later = rows.row(k + i + 1) * *phi;
                let sum = rows.row(k) + later;
                rows.set_row(k, &sum);
            }
        }
        rows.tr_mul(&rows) * self.variance
    }
}

#[cfg(test)]
mod tests {
    use super::Colour;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;
    use tpm_numerics::DMatrix;

    #[test]
    fn the_square_is_that_of_the_covariance_between_all_readings() {
        // The covariance of an autoregression of the first order is known: s^2 phi^|k - l| / (1 - phi^2), but for readings before the first.
        let (phi, variance) = (0.8_f64, 0.3);
        let colour = Colour { coefficients: vec![phi], variance };
        let count = 60;
        let rows = DMatrix::from_fn(count, 2, |k, j| if j == 0 { (k as f64 * 0.3).sin() } else { 1.0 });
        let covariance = DMatrix::from_fn(count, count, |k, l| {
            let (first, apart) = (k.min(l) as i32, k.abs_diff(l) as i32);
            let before = 1.0 - phi.powi(2 * (first + 1));
            variance * phi.powi(apart) * before / (1.0 - phi * phi)
        });
        let expected = rows.tr_mul(&(covariance * &rows));
        let found = colour.square(rows);
        assert!((found - &expected).norm() < 1e-12 * expected.norm());
    }

    #[test]
    fn an_autoregression_is_found_and_white_noise_has_none() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let (mut a, mut b) = (0.0, 0.0);
        let mut next = || {
            let now = 1.2 * a - 0.5 * b + random.sample::<f64, _>(StandardNormal);
            (a, b) = (now, a);
            now
        };
        let series: Vec<Vec<f64>> = (0..3).map(|_| (0..2000).map(|_| next()).collect()).collect();
        let found = Colour::of(&series);
        assert!((found.variance - 1.0).abs() < 0.06, "{found:?}");
        assert!((found.coefficients[0] - 1.2).abs() < 0.05 && (found.coefficients[1] + 0.5).abs() < 0.05, "{found:?}");
        let white: Vec<f64> = (0..4000).map(|_| random.sample(StandardNormal)).collect();
        let gain: f64 = Colour::of(&[white]).coefficients.iter().map(|phi| phi.abs()).sum();
        assert!(gain < 0.1, "{gain}");
    }
}
