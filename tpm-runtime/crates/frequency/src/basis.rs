//! Polynomials in s that are orthonormal on the frequencies of a fit.
//!
//! Invariant: `p_i` has degree i, real coefficients and a positive leading one, and `sum_k Re(p_i conj p_j)(j W_k) = d_ij`
//! over the frequencies. They are alternately even and odd, so that the recursion has two terms (G. E. Forsythe, 1957, on
//! the imaginary axis): `c_{i+1} p_{i+1} = s p_i + c_i p_{i-1}`. What powers of s lose: `DESIGN.md`, "Why are transfer
//! functions fitted in orthogonal polynomials, and to whole records?".

use num_complex::Complex;
use tpm_numerics::DMatrix;

#[derive(Clone, Debug)]
pub(super) struct Basis {
    /// Frequencies are divided by this one, rad/s.
    pub(super) scale: f64,
    /// Values: `values[i][k] = p_i(j W_k / scale)`.
    pub(super) values: Vec<Vec<Complex<f64>>>,
    /// Row i: coefficients of p_i in powers of s/scale.
    pub(super) coefficients: DMatrix<f64>,
}

impl Basis {
    /// Polynomials up to a degree; `None` when there are no frequencies or fewer than the degree needs.
    pub(super) fn new(frequencies: &[f64], degree: usize) -> Option<Self> {
        let scale = frequencies.iter().copied().fold(0.0, f64::max);
        if scale <= 0.0 || 2 * frequencies.len() <= degree {
            return None;
        }
        let nodes: Vec<Complex<f64>> = frequencies.iter().map(|w| Complex::new(0.0, w / scale)).collect();
        let first = 1.0 / (nodes.len() as f64).sqrt();
        let mut values = vec![vec![Complex::from(first); nodes.len()]];
        let mut coefficients = DMatrix::zeros(degree + 1, degree + 1);
        coefficients[(0, 0)] = first;
        let mut last = 0.0;
        for i in 0..degree {
            let mut next: Vec<Complex<f64>> = nodes.iter().zip(&values[i]).map(|(s, p)| s * p).collect();
            for j in 0..=i {
                coefficients[(i + 1, j + 1)] += coefficients[(i, j)];
            }
            if i > 0 {
                for (value, before) in next.iter_mut().zip(&values[i - 1]) {
                    *value += before * last;
                }
                for j in 0..=i {
                    let before: f64 = coefficients[(i - 1, j)];
                    coefficients[(i + 1, j)] += before * last;
                }
            }
            last = next.iter().map(Complex::norm_sqr).sum::<f64>().sqrt();
            if last <= 1e-14 {
                return None;
            }
            for value in &mut next {
                *value /= last;
            }
            coefficients.row_mut(i + 1).scale_mut(1.0 / last);
            values.push(next);
        }
        Some(Basis { scale, values, coefficients })
    }

    /// Value at frequency `k` of the polynomial with these coordinates in the basis.
    pub(super) fn value(&self, coordinates: &[f64], k: usize) -> Complex<f64> {
        coordinates.iter().zip(&self.values).map(|(c, p)| p[k] * *c).sum()
    }

    /// The map from the coordinates of a polynomial of this degree to its coefficients in powers of s.
    pub(super) fn to_powers(&self, degree: usize) -> DMatrix<f64> {
        DMatrix::from_fn(degree + 1, degree + 1, |j, i| self.coefficients[(i, j)] / self.scale.powi(j as i32))
    }
}

#[cfg(test)]
mod tests {
    use super::Basis;
    use crate::transfer::polynomial;
    use num_complex::Complex;

    #[test]
    fn orthonormal_and_equal_to_its_powers() {
        let frequencies: Vec<f64> = (1..=200).map(|k| f64::from(k) * 0.7).collect();
        let basis = Basis::new(&frequencies, 12).expect("enough frequencies");
        for i in 0..=12 {
            for j in 0..=12 {
                let product: f64 = basis.values[i].iter().zip(&basis.values[j]).map(|(a, b)| (a * b.conj()).re).sum();
                let expected = f64::from(u8::from(i == j));
                assert!((product - expected).abs() < 1e-12, "{i} {j}: {product}");
            }
        }
        let coordinates = [0.3, -1.0, 0.2, 0.7, 1.1];
        let powers = basis.to_powers(4) * tpm_numerics::DVector::from_row_slice(&coordinates);
        for k in [0, 57, 199] {
            let direct = polynomial(powers.as_slice(), Complex::new(0.0, frequencies[k]));
            assert!((direct - basis.value(&coordinates, k)).norm() < 1e-13);
        }
        assert!(Basis::new(&[1.0], 2).is_none() && Basis::new(&[], 0).is_none() && Basis::new(&[0.0], 1).is_none());
    }
}
