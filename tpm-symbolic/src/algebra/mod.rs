//! Polynomials, Fourier polynomials, quotients and small matrices over the rationals.
//!
//! This folder does not know the meaning of symbols: the variables of a polynomial may be of any type.

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
