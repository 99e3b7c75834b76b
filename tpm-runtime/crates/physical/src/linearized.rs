//! The frequency response of a linearised model, as a function of the physical parameters that a fit seeks.
//!
//! Invariant: `(M s^2 + D s + K) q = F u` with the exact matrices of [`tpm_symbolic::linear::linearize`], each entry evaluated
//! once per set of parameters; every symbol in them is either a parameter of the fit or has a value.

use num_complex::Complex;
use tpm_frequency::ResponseModel;
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Node, Symbol};
use tpm_symbolic::linear::linearize::Linearization;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::number::rational;

/// Why a linearised model has no response.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinearizedError {
    /// A symbol has no value.
    #[error("`{name}` has neither a start value nor a value that is known; give one")]
    NoValue {
        /// The symbol.
        name: String,
    },
    /// The input is not one of the linearisation's.
    #[error("`{name}` is no input of the linearised model")]
    Input {
        /// The symbol.
        name: String,
    },
    /// The coordinate is not one of the model's.
    #[error("the model has {coordinates} coordinates; there is no number {index}")]
    Coordinate {
        /// Coordinates of the model.
        coordinates: usize,
        /// Index asked for.
        index: usize,
    },
}

/// The frequency response from one input to one coordinate of a linearised model.
#[derive(Clone, Debug)]
pub struct LinearizedResponse<'a> {
    model: &'a ExactModel,
    linearization: &'a Linearization,
    coordinate: usize,
    input: usize,
    parameters: Vec<Symbol>,
    values: Vec<(Symbol, f64)>,
}

impl<'a> LinearizedResponse<'a> {
    /// The frequency response from `input` to `coordinate` as a function of `parameters`, in this order. `values` holds
    /// the values of the other parameters and of the run-time constants.
    ///
    /// # Errors
    /// [`LinearizedError`] that names what is missing.
    pub fn new(
        model: &'a ExactModel,
        linearization: &'a Linearization,
        coordinate: Coordinate,
        input: Symbol,
        parameters: &[Symbol],
        values: &[(Symbol, f64)],
    ) -> Result<Self, LinearizedError> {
        let name = |symbol: Symbol| model.quantity(symbol).name.to_string();
        let missing = model
            .parameters()
            .chain(model.run_time_constants())
            .find(|symbol| !parameters.contains(symbol) && !values.iter().any(|(known, _)| known == symbol));
        if let Some(symbol) = missing {
            return Err(LinearizedError::NoValue { name: name(symbol) });
        }
        let column = linearization.inputs.iter().position(|present| *present == input);
        let input = column.ok_or_else(|| LinearizedError::Input { name: name(input) })?;
        let (coordinates, index) = (linearization.mass.len(), coordinate.0 as usize);
        if index >= coordinates {
            return Err(LinearizedError::Coordinate { coordinates, index });
        }
        Ok(LinearizedResponse {
            model,
            linearization,
            coordinate: index,
            input,
            parameters: parameters.to_vec(),
            values: values.to_vec(),
        })
    }

    fn value(&self, expr: ExprId, parameters: &[f64]) -> f64 {
        self.model.graph.evaluate(expr, |node| match node {
            Node::Symbol(symbol) => match &self.model.quantity(*symbol).kind {
                Kind::Constant { value: Some(value) } => rational::to_f64(value),
                _ => {
                    let fitted =
                        self.parameters.iter().zip(parameters).find(|(own, _)| *own == symbol).map(|(_, v)| *v);
                    let known = || self.values.iter().find(|(own, _)| own == symbol).map(|(_, v)| *v);
                    fitted.or_else(known).unwrap_or(f64::NAN)
                }
            },
            _ => 0.0,
        })
    }
}

impl ResponseModel for LinearizedResponse<'_> {
    fn responses(&self, parameters: &[f64], frequencies: &[f64], out: &mut [Complex<f64>]) {
        let n = self.linearization.mass.len();
        let entries = |matrix: &[Vec<ExprId>]| -> Vec<f64> {
            matrix.iter().flatten().map(|&expr| self.value(expr, parameters)).collect()
        };
        let mass = entries(&self.linearization.mass);
        let damping = entries(&self.linearization.damping);
        let stiffness = entries(&self.linearization.stiffness);
        let drive: Vec<f64> =
            self.linearization.input.iter().map(|row| self.value(row[self.input], parameters)).collect();
        let mut matrix = vec![Complex::from(0.0); n * n];
        let mut right = vec![Complex::from(0.0); n];
        for (value, &w) in out.iter_mut().zip(frequencies) {
            for (i, entry) in matrix.iter_mut().enumerate() {
                *entry = Complex::new(stiffness[i] - w * w * mass[i], w * damping[i]);
            }
            for (right, drive) in right.iter_mut().zip(&drive) {
                *right = Complex::from(*drive);
            }
            // A singular matrix has no solution; non-finite numbers make the fit reject the parameters.
            let solved = solve(&mut matrix, &mut right);
            *value = if solved { right[self.coordinate] } else { Complex::from(f64::NAN) };
        }
    }
}

/// Solves `matrix q = right` by Gaussian elimination with pivots, which overwrites both. False when the matrix is
/// singular. A fit calls this many thousand times, for which the allocations of a library decomposition are too slow.
fn solve(matrix: &mut [Complex<f64>], right: &mut [Complex<f64>]) -> bool {
    let n = right.len();
    for k in 0..n {
        let mut pivot = k;
        for r in k + 1..n {
            if matrix[r * n + k].l1_norm() > matrix[pivot * n + k].l1_norm() {
                pivot = r;
            }
        }
        if pivot != k {
            right.swap(pivot, k);
            for c in k..n {
                matrix.swap(pivot * n + c, k * n + c);
            }
        }
        let inverse = matrix[k * n + k].inv();
        if !(inverse.re.is_finite() && inverse.im.is_finite()) {
            return false;
        }
        for r in k + 1..n {
            let factor = matrix[r * n + k] * inverse;
            for c in k + 1..n {
                let part = factor * matrix[k * n + c];
                matrix[r * n + c] -= part;
            }
            let part = factor * right[k];
            right[r] -= part;
        }
        // The inverse of the pivot is stored in the pivot's place for the back substitution.
        matrix[k * n + k] = inverse;
    }
    for k in (0..n).rev() {
        let mut sum = right[k];
        for c in k + 1..n {
            sum -= matrix[k * n + c] * right[c];
        }
        right[k] = sum * matrix[k * n + k];
    }
    true
}

#[cfg(test)]
mod tests {
    use super::solve;
    use num_complex::Complex;

    #[test]
    fn elimination_solves_and_says_when_it_cannot() {
        // A matrix that needs a row exchange, and a known solution.
        let entries = [
            (0.0, 0.0),
            (2.0, -1.0),
            (1.0, 0.5),
            (3.0, 1.0),
            (0.0, 4.0),
            (1.0, 0.0),
            (-1.0, 2.0),
            (0.5, 0.5),
            (7.0, 0.0),
        ];
        let matrix: Vec<Complex<f64>> = entries.iter().map(|&(re, im)| Complex::new(re, im)).collect();
        let truth = [Complex::new(1.0, -2.0), Complex::new(0.0, 3.0), Complex::new(-0.5, 0.25)];
        let mut right: Vec<_> =
            (0..3).map(|r| (0..3).map(|c| matrix[3 * r + c] * truth[c]).sum::<Complex<f64>>()).collect();
        assert!(solve(&mut matrix.clone(), &mut right));
        for (found, truth) in right.iter().zip(truth) {
            assert!((found - truth).norm() < 1e-14, "{found} {truth}");
        }
        let mut singular = [1.0, 2.0, 2.0, 4.0].map(Complex::from);
        assert!(!solve(&mut singular, &mut [1.0, 1.0].map(Complex::from)));
    }
}
