//! What parameters that are off do to the tracking error, harmonic by harmonic (Feng, Eqns 3.22 and 4.29).
//!
//! A machine with the parameters theta that is driven with the feed-forward of theta' answers, linearised about its reference, with
//!
//! ```text
//! E_k = T_k (B Lambda)_k P ,   P = theta' - theta ,   T_k = (J_k + hold C_k)^-1 ,
//! ```
//!
//! J_k being the mean of the rows' derivatives along the reference with the parameters theta, and C_k the feedback.

use crate::along::Along;
use crate::error::EstimateError;
use crate::first_order::fed_back;
use num_complex::Complex;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{Dims, Model};
use tpm_motion::Trial;
use tpm_numerics::{DMatrix, DVector};

/// The closed loop's response to parameters that are off, for one trial.
pub struct ErrorResponse {
    /// Per harmonic from the mean on: `T B Lambda`, coordinates x parameters; nothing where the loop is singular.
    matrices: Vec<Option<DMatrix<Complex<f64>>>>,
    /// Per harmonic and input: what the feedback answers to an error of one in every coordinate, with its sign turned.
    feedback: Vec<Vec<Vec<Complex<f64>>>>,
}

impl ErrorResponse {
    /// The response of a machine with the parameters `theta` up to a harmonic.
    ///
    /// # Errors
    /// [`EstimateError::Model`] when the model refuses an evaluation along the reference, [`EstimateError::NotFinite`] when a term is
    /// not finite there.
    pub fn new(
        model: &dyn Model<f64>,
        trial: &Trial,
        theta: &[f64],
        hold: Hold,
        harmonics: usize,
    ) -> Result<Self, EstimateError> {
        let along = Along::of_trial(model, trial, harmonics, None)?;
        let matrices = (0..=harmonics).map(|k| matrix(&along, trial, theta, hold, k)).collect();
        let Dims { coordinates, inputs, .. } = model.dims();
        let feedback = |k: usize| {
            let frequency = k as f64 * trial.trajectory.frequency;
            let of = |i: usize| (0..coordinates).map(|c| trial.control.response(i, c, frequency)).collect();
            (0..inputs).map(of).collect()
        };
        Ok(ErrorResponse { matrices, feedback: (0..=harmonics).map(feedback).collect() })
    }

    /// `T B Lambda` at a harmonic, coordinates x parameters; nothing where the loop is singular.
    pub fn matrix(&self, harmonic: usize) -> Option<&DMatrix<Complex<f64>>> {
        self.matrices.get(harmonic)?.as_ref()
    }

    /// Phasor of the error of every coordinate that parameters cause which are off by `off`.
    pub fn error(&self, harmonic: usize, off: &[f64]) -> Option<Vec<Complex<f64>>> {
        let off = DVector::from_iterator(off.len(), off.iter().map(|value| Complex::new(*value, 0.0)));
        Some((self.matrix(harmonic)? * off).iter().copied().collect())
    }

    /// What an input adds to its feed-forward when the coordinates have these errors.
    pub fn effort(&self, harmonic: usize, input: usize, error: &[Complex<f64>]) -> Complex<f64> {
        -self.feedback[harmonic][input].iter().zip(error).map(|(gain, error)| gain * error).sum::<Complex<f64>>()
    }
}

fn matrix(along: &Along, trial: &Trial, theta: &[f64], hold: Hold, harmonic: usize) -> Option<DMatrix<Complex<f64>>> {
    let Dims { rows, parameters, .. } = along.dims;
    let regressors = DMatrix::from_fn(rows, parameters, |row, j| along.regressor(row, j)[harmonic]);
    answer(along, trial, theta, hold, harmonic, &regressors)
}

/// T times columns that act on the rows at a harmonic; nothing where the loop is singular, or there are not as many rows as
/// coordinates.
pub(super) fn answer(
    along: &Along,
    trial: &Trial,
    theta: &[f64],
    hold: Hold,
    harmonic: usize,
    columns: &DMatrix<Complex<f64>>,
) -> Option<DMatrix<Complex<f64>>> {
    let Dims { rows, coordinates, .. } = along.dims;
    if rows != coordinates {
        return None;
    }
    let mut stiffness = DMatrix::zeros(rows, coordinates);
    for row in 0..rows {
        let own = along.response(row, theta, harmonic);
        let fed_back = fed_back(trial, along, hold, row, harmonic);
        for (c, (own, fed_back)) in own.iter().zip(&fed_back).enumerate() {
            stiffness[(row, c)] = own + fed_back;
        }
    }
    let answer = stiffness.lu().solve(columns)?;
    answer.iter().all(|entry| entry.re.is_finite() && entry.im.is_finite()).then_some(answer)
}
