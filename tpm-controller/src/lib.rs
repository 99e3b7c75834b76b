//! The numerical core of a controller that follows a reference and measures its machine, without an operating system.
//!
//! A controller plays a reference q_r(t), a finite Fourier series, with the input
//!
//! ```text
//! u = Phi(q_r, q_r', q_r'', ...) theta + known - Kp e - Kd e' ,      e = q - q_r ,
//! ```
//!
//! and sums up the harmonics of what it measures, `a_k - j b_k = (2/N) sum_n x_n e^{-j 2 pi k n / N}`. Equating the harmonics of
//! both sides of the equations of motion gives linear equations for the parameters theta (the Trajectory Pattern Method).
//!
//! | task | item |
//! |---|---|
//! | add feedback to a feed-forward | [`control::Feedback`] |
//! | form the rate of a measured position | [`control::Differentiator`] |
//! | pass a feed-forward through a low pass | [`filter::SecondOrder`] |
//! | take in samples and obtain harmonics | [`harmonics::Accumulator`] |
//! | correct harmonics of an input that is held between samples | [`harmonics::hold_factor`] |
//! | solve for parameters, with their covariance | [`least_squares`], [`weighted_least_squares`] |
//! | evaluate a model: regressor, inverse and forward dynamics | [`trait@Model`] |
//!
//! All of it takes a fixed time in memory that the caller owns. Nothing allocates, and nothing panics but
//! [`linear::solve_in_place`] on a matrix that is too short.
//!
//! # One sample, and the harmonics of a period
//!
//! ```
//! use tpm_controller::control::{Differentiator, Feedback, Gain};
//! use tpm_controller::harmonics::Accumulator;
//!
//! # fn main() -> Result<(), Box<dyn core::error::Error>> {
//! // Proportional and derivative feedback of one coordinate, sampled every millisecond.
//! let gains = [Gain { input: 0, coordinate: 0, proportional: 400.0_f32, derivative: 20.0 }];
//! let mut differentiators = [Differentiator::new(1e-3, 2e-3)];
//! let mut feedback = Feedback::new(&gains, &mut differentiators);
//! // Harmonics 0 to 3 of two signals over periods of 1000 samples.
//! let mut memory = [0.0; Accumulator::<f32>::memory_len(2, 3)];
//! let mut sums = Accumulator::new(1000, 2, 3, &mut memory)?;
//!
//! for _sample in 0..1000 {
//!     let (reference, feed_forward, measured) = (0.1, 3.0, 0.0995);
//!     let mut input = [feed_forward];
//!     feedback.add(&[measured - reference], None, &mut input)?;
//!     sums.push(&[measured, input[0]])?;
//! }
//! let (_cosine, _sine) = sums.coefficients(1, 3)?;
//! # Ok(())
//! # }
//! ```
//!
//! The example `controller_loop` closes the loop around a cart and finds its mass and friction.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod control;
pub mod derivatives;
pub mod filter;
pub mod harmonics;
pub mod linear;
pub mod model;
#[cfg(feature = "source")]
pub mod source;
pub mod support;

pub use model::{Buffer, Dims, EvalError, Model, Presliding};
pub use support::{
    AccumulatorError, Hyperbolic, Label, LeastSquares, Real, SolveError, least_squares, weighted_least_squares,
};
