//! Polynomial expressions of coordinates and constants under a pattern.
//!
//! Invariant: the frequency enters as w^n with n the number of time derivatives. A constant of known value is replaced
//! by it; a run-time constant remains a symbol.

use crate::algebra::fourier::Fourier;
use crate::algebra::polynomial::Monomial;
use crate::expr::graph::{ExprId, Node};
use crate::mechanics::model::{ExactModel, Kind};
use crate::mechanics::pattern::{Motion, Pattern};
use crate::number::rational::{self, Rational};
use num_traits::{One, Zero};
use thiserror::Error;

/// Why an expression is no finite Fourier series with symbolic amplitudes.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MotionError {
    /// The expression is no polynomial.
    #[error("`{found}` is no polynomial of the motion and of constants")]
    NotPolynomial {
        /// The rejected expression.
        found: String,
    },
    /// A coordinate has no motion.
    #[error("the coordinate `{coordinate}` has no motion in the pattern; give it one, or eliminate it")]
    NoMotion {
        /// The coordinate.
        coordinate: String,
    },
}

/// The motion of a polynomial of derivatives of coordinates and constants, under the pattern.
///
/// # Errors
/// When the expression is no such polynomial or a coordinate has no motion.
pub fn motion_of(model: &ExactModel, pattern: &Pattern, expr: ExprId) -> Result<Motion, MotionError> {
    let mut sum = Motion::zero();
    for (monomial, coefficient) in model.graph.polynomial(expr).terms() {
        let mut product = Motion::term(Monomial::one(), Fourier::constant(coefficient.clone()));
        for (&atom, exponent) in monomial.factors() {
            product = product.mul(&power_of(model, pattern, atom, exponent)?);
        }
        sum = sum.add(&product);
    }
    Ok(sum)
}

/// The motion of a power of one atom, under the pattern.
///
/// # Errors
/// When the power is no polynomial of the motion or a coordinate has no motion.
pub fn power_of(model: &ExactModel, pattern: &Pattern, atom: ExprId, exponent: i32) -> Result<Motion, MotionError> {
    let not_polynomial = || MotionError::NotPolynomial { found: model.display_brief(atom) };
    let one = || Fourier::constant(Rational::one());
    match *model.graph.node(atom) {
        Node::Symbol(symbol) => match &model.quantity(symbol).kind {
            Kind::Constant { value: Some(value) } if !value.is_zero() || exponent > 0 => {
                Ok(Motion::term(Monomial::one(), Fourier::constant(rational::power(value, exponent))))
            }
            Kind::Constant { value: None } => Ok(Motion::term(Monomial::power_of(symbol, exponent), one())),
            _ => Err(not_polynomial()),
        },
        Node::Derivative(coordinate, order) if exponent > 0 => {
            let motion = pattern.motions.get(coordinate.0 as usize).and_then(Option::as_ref).ok_or_else(|| {
                MotionError::NoMotion { coordinate: model.coordinates[coordinate.0 as usize].name.clone() }
            })?;
            let power = i32::try_from(order).expect("invariant: derivative orders are small");
            let base = motion.derivative(order).mul(&Motion::term(Monomial::power_of(pattern.frequency, power), one()));
            Ok((1..exponent).fold(base.clone(), |product, _| product.mul(&base)))
        }
        _ => Err(not_polynomial()),
    }
}
