//! Fourier coefficients of sampled signals.
//!
//! Invariant: a signal is `x(t) = a_0 + sum_k [a_ck cos(k w t) + a_sk sin(k w t)]`; the phasor of harmonic k is
//! `a_ck - j a_sk`, which is `(2/N) sum_n x_n e^{-j 2 pi k n / N}` over a period of N samples, and that of harmonic 0 is the
//! mean a_0. Time starts at the first sample that is used.

mod accumulate;
mod hold;

pub use crate::support::AccumulatorError;
pub use accumulate::Accumulator;
pub use hold::{Hold, hold_factor};
