//! Polynomials, Fourier polynomials, quotients and small matrices over the rationals.
//!
//! Nothing here knows what a symbol stands for: a variable of a polynomial is whatever its user puts in.

pub mod characteristic;
pub mod field;
pub mod fourier;
mod fourier_product;
pub mod fraction;
pub mod generic_point;
pub mod linear;
pub(crate) mod monomial;
pub mod null_space;
pub(crate) mod packed;
pub mod polynomial;
pub(crate) mod product;
pub(crate) mod spectrum;
