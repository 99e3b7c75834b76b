//! Numerical linear algebra and transforms. Only this folder names the linear-algebra crate, nalgebra.
//!
//! Invariant: decompositions that nalgebra gets wrong are done here in another way (`singular`, `eigenvalues`); what leaves the
//! runtime is a [`Matrix`], never a type of that crate.
//!
//! faer 0.24.4 (MIT, features `std` and `linalg`) was tried beside the present way for these decompositions, one thread, the
//! development profile. Worst cases of 40,000 matrices of each kind, up to 11 by 9, made as in the tests of `singular`:
//!
//! ```text
//! singular values                          nalgebra SVD         present way         faer
//! dependent to rounding and noise
//!   |U S V' - A|                           8.1 (1522 wrong)     9.0e-15             1.9e-14
//!   U'U - 1, values above 1e-10            5.6e-15              4.2e-7              6.0e-15
//! exactly dependent
//!   |U S V' - A|                           11 (5646 wrong)      1.0e-14             1.0e-14
//!   U'U - 1, values above 1e-10            5.1e-15              5.0e-15             5.4e-15
//! columns graded from 1 to 1e-12
//!   |U S V' - A|                           7.4e-14              3.6e-15             3.2e-15
//! time per matrix                          4 to 5 us            11 to 13 us         8 to 10 us
//!
//! eigenvalues                              nalgebra, plain      present way         faer
//! the matrix on which QR does not end      no end               1.5e-11             1.5e-11
//! 100,000 matrices within 1e-12 of it      200 without end      5.9e-11             5.8e-11
//! 200,000 random matrices up to 9 by 9     2.5e-13              2.5e-13             7.4e-14
//! time per random matrix                   7.7 us               6.5 us              25 us
//! ```
//!
//! Errors of eigenvalues are those of the sums of their powers, relative to the largest eigenvalue. Both faer and the present way
//! are right to rounding. faer adds 48 crates and two minutes of compilation on two cores (118 s, against 15 s for nalgebra). The
//! present way stays: it is less exact only in the vectors of singular values near the tolerance, along which an estimate is
//! 1e10 times less certain than along the best direction anyway. faer is the next choice where matrices become large.

pub mod chance;
mod continuous_riccati;
pub mod differences;
pub mod eigenvalues;
pub mod fourier;
pub mod independent;
mod matrix;
mod riccati;
pub mod singular;
pub mod tail;

pub use continuous_riccati::continuous_riccati;
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
