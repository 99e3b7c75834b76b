//! The controller's part of the Trajectory Pattern Method.
//!
//! # The problem
//!
//! A controller follows a reference q_r(t), a finite Fourier series, with the input
//!
//! ```text
//! u = Phi(q_r, q_r', q_r'', ...) theta + known - Kp e - Kd e' ,      e = q - q_r ,
//! ```
//!
//! and sums up the harmonics of what it measures, `a_k - j b_k = (2/N) sum_n x_n e^{-j 2 pi k n / N}`, from which the parameters
//! theta follow by least squares. It does so in a fixed time, in memory that it owns. This crate holds what that needs: the
//! trait of evaluated models ([`mod@model`]), feedback ([`control`]), filters ([`filter`]), harmonics of sampled signals
//! ([`harmonics`]), and scalars and least squares ([`support`]).
//!
//! Nothing here allocates, panics, or asks an operating system for anything.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod control;
pub mod filter;
pub mod harmonics;
pub mod linear;
pub mod model;
#[cfg(feature = "source")]
pub mod source;
pub mod support;

pub use model::{Buffer, Dims, EvalError, Model};
pub use support::{AccumulatorError, Label, LeastSquares, Real, SolveError, least_squares, weighted_least_squares};
