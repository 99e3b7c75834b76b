//! Numerical linear algebra and transforms. Only this folder names the linear-algebra crate, nalgebra.
//!
//! Invariant: decompositions that nalgebra gets wrong are done here in another way (`singular`, `eigenvalues`); what leaves the
//! runtime is a [`Matrix`], never a type of that crate.
//!
//! `DESIGN.md` (Why nalgebra and what does it get wrong? Why no second linear algebra crate?) has what was measured.

pub mod alarm;
pub mod chance;
mod continuous_riccati;
mod counts;
pub mod differences;
pub mod eigenvalues;
mod exponential;
pub mod fourier;
mod gram;
pub mod independent;
mod interpolation;
mod iteration;
mod matrix;
pub mod patience;
mod riccati;
pub mod singular;
pub mod spectrum;
pub mod tail;
pub mod tolerance;
pub mod whole;

pub use continuous_riccati::continuous_riccati;
pub use counts::{counted, grid, step};
pub use exponential::exponential;
pub use gram::gram;
pub use interpolation::{through, through_even};
pub use iteration::{Doubling, Iteration};
pub use matrix::Matrix;
pub use nalgebra::storage::Owned;
pub use nalgebra::{Cholesky, Const, DMatrix, DMatrixView, DVector, DVectorView, Dyn, RowDVector};
pub use nalgebra::{SMatrix, SVector};
pub use riccati::RiccatiError;
pub use riccati::{Riccati, riccati};

/// Root mean square of values; zero without any.
pub fn root_mean_square(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(sum, count), x| (sum + x * x, count + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}
