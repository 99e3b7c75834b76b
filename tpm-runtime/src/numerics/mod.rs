//! Numerical linear algebra and transforms. Only this folder names the linear-algebra crate.
//!
//! Invariant: decompositions that the library gets wrong are done here in another way ([`singular`]); what leaves the runtime is
//! never a type of that crate.

pub(crate) mod differences;
pub(crate) mod eigenvalues;
pub(crate) mod fourier;
mod matrix;
mod riccati;
pub(crate) mod singular;

pub use matrix::Matrix;
pub(crate) use nalgebra::storage::Owned;
pub(crate) use nalgebra::{Cholesky, Const, DMatrix, DMatrixView, DVector, DVectorView, Dyn, RowDVector};
#[cfg(test)]
pub(crate) use nalgebra::{SMatrix, SVector};
pub use riccati::RiccatiError;
pub(crate) use riccati::{Riccati, riccati};
