//! Runs trajectory pattern identification against simulated plants, logs and real machines.
//!
//! A machine obeys `Phi(q, q', q'', ...) theta + known = B u` with unknown theta ([`mod@model`]). Along a periodic motion both
//! sides are Fourier series, and equating harmonics gives linear equations for theta, however non-linear the motion is.
//! The core (without the feature `std`) needs neither an operating system nor memory allocation.
#![no_std]

#[cfg(any(feature = "std", test))]
extern crate std;

#[cfg(feature = "std")]
pub mod actuator;
pub mod control;
#[cfg(feature = "std")]
mod differences;
#[cfg(feature = "std")]
mod eigenvalues;
#[cfg(feature = "std")]
pub mod estimate;
#[cfg(feature = "std")]
pub mod experiment;
pub mod filter;
#[cfg(feature = "std")]
mod fourier;
#[cfg(feature = "std")]
pub mod frequency;
pub mod harmonics;
#[cfg(feature = "interpret")]
pub mod interpret;
mod label;
pub mod least_squares;
pub mod linear;
#[cfg(feature = "std")]
pub mod log;
pub mod model;
#[cfg(feature = "interpret")]
pub mod physical;
#[cfg(feature = "plot")]
pub mod plot;
#[cfg(feature = "std")]
pub mod procedure;
pub mod real;
#[cfg(feature = "std")]
pub mod regulator;
#[cfg(feature = "std")]
pub mod report;
#[cfg(feature = "std")]
pub mod simulate;
#[cfg(feature = "std")]
mod singular;
#[cfg(feature = "std")]
pub mod smoothing;
#[cfg(feature = "std")]
pub mod stability;
#[cfg(feature = "std")]
pub mod trajectory;

pub use least_squares::{LeastSquares, SolveError, least_squares, weighted_least_squares};
pub use model::{Buffer, Dims, EvalError, Label, Model};
pub use real::Real;
#[cfg(feature = "macros")]
pub use tpm_macros::{model, model_file};

#[cfg(test)]
mod test_models;
