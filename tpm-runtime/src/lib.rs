//! Runs trajectory pattern identification against simulated plants, logs and real machines.
//!
//! A machine obeys `Phi(q, q', q'', ...) theta + known = B u` with unknown theta ([`mod@model`]). Along a periodic motion both
//! sides are Fourier series, and equating harmonics gives linear equations for theta, however non-linear the motion is.
//! The core (without the feature `std`) needs neither an operating system nor memory allocation.
#![no_std]

#[cfg(any(feature = "std", test))]
extern crate std;

#[cfg(feature = "std")]
pub mod campaign;
#[cfg(feature = "std")]
pub mod estimate;
#[cfg(feature = "std")]
pub mod experiment;
#[cfg(feature = "std")]
pub mod frequency;
#[cfg(feature = "interpret")]
pub mod interpret;
#[cfg(feature = "std")]
pub mod log;
#[cfg(feature = "std")]
pub mod machine;
#[cfg(feature = "std")]
pub mod numerics;
#[cfg(feature = "plot")]
pub mod plot;
#[cfg(feature = "std")]
pub mod report;
#[cfg(feature = "std")]
pub mod run;
#[cfg(feature = "interpret")]
pub mod session;
#[cfg(feature = "interpret")]
pub mod study;

pub use tpm_core::{
    Buffer, Dims, EvalError, Label, LeastSquares, Model, Real, SolveError, control, filter, harmonics, least_squares,
    linear, model, weighted_least_squares,
};
#[cfg(feature = "macros")]
pub use tpm_macros::{model, model_file};

#[cfg(test)]
mod test_models;
