//! The response of a linearised model, for a fit of its physical parameters.
//!
//! Invariant: `(M s^2 + D s + K) q = F u` with the exact matrices of [`tpm_symbolic::linearize`], each entry evaluated once
//! per set of parameters; every symbol in them is either a parameter of the fit or has a value.

use super::structured::ResponseModel;
use nalgebra::{Complex, DMatrix, DVector};
use std::string::{String, ToString};
use std::vec::Vec;
use tpm_symbolic::expr::{Coordinate, ExprId, Node, Symbol};
use tpm_symbolic::linearize::Linearization;
use tpm_symbolic::model::{Kind, Model};
use tpm_symbolic::rational;

/// Why a linearised model has no response.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
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

/// One coordinate of a linearised model over one input.
#[derive(Clone, Debug)]
pub struct LinearizedResponse<'a> {
    model: &'a Model,
    linearization: &'a Linearization,
    coordinate: usize,
    input: usize,
    parameters: Vec<Symbol>,
    values: Vec<(Symbol, f64)>,
}

impl<'a> LinearizedResponse<'a> {
    /// The response of `coordinate` to `input` as a function of `parameters`, in this order; `values` are of the other
    /// parameters and run-time constants.
    ///
    /// # Errors
    /// [`LinearizedError`] that names what is missing.
    pub fn new(
        model: &'a Model,
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
        let drive = DVector::from_iterator(n, drive.into_iter().map(Complex::from));
        for (value, &w) in out.iter_mut().zip(frequencies) {
            let entry = |i: usize| Complex::new(stiffness[i] - w * w * mass[i], w * damping[i]);
            let matrix = DMatrix::from_fn(n, n, |r, c| entry(r * n + c));
            let solution = matrix.lu().solve(&drive);
            // A singular matrix has no response; numbers that are not finite reject the parameters.
            *value = solution.map_or(Complex::from(f64::NAN), |q| q[self.coordinate]);
        }
    }
}
