//! Where B Lambda is known exactly: what estimators that work along a reference ask of a harmonic table.

use num_complex::Complex;
use std::fmt::Debug;
use tpm_motion::trajectory::Trajectory;

/// Harmonics of a model's rows along a reference: one-sided phasors a_c - j a_s, from the mean on.
#[derive(Clone, Debug, PartialEq)]
pub struct RowLines {
    /// Of the regressors, per row and parameter (row-major), in the model's units.
    pub regressors: Vec<Vec<Complex<f64>>>,
    /// Of the terms without an unknown parameter, per row.
    pub known: Vec<Vec<Complex<f64>>>,
}

/// The exact harmonics of a model's rows under its patterns (Feng, Eqns 3.26, 4.44).
pub trait LineTable: Debug + Send + Sync {
    /// Harmonics 0 to `harmonics` of the rows along a reference with these amplitudes (in the order of its pattern) and
    /// constants (in the order of the model); nothing along a motion for which no exact table exists.
    fn lines(
        &self,
        reference: &Trajectory,
        amplitudes: &[f64],
        constants: &[f64],
        harmonics: usize,
    ) -> Option<RowLines>;
}
