//! State feedback that keeps a machine at rest in a point: the linear-quadratic regulator in sampled and in continuous time.
//!
//! A machine near the point moves as `x' = A x + B u` with x = (q, q'), from its linearisation there. Under inputs that are held
//! for a sample time T it is `x[n+1] = Ad x[n] + Bd u[n]`; the feedback `u = -K x` minimises
//!
//! ```text
//! J = sum_n T (x[n]' Q x[n] + u[n]' R u[n]),    K = (R + Bd' P Bd)^-1 Bd' P Ad,
//! P = Q + Ad' P Ad - Ad' P Bd (R + Bd' P Bd)^-1 Bd' P Ad
//! ```
//!
//! with the stabilising solution P of this discrete Riccati equation; `x0' P x0 T` is the least cost from x0. In continuous time
//! the same weights give `K = R^-1 B' P` with `A' P + P A - P B R^-1 B' P + Q = 0`, which the sampled gains approach as T goes to zero.
//! Invariant: a regulator that is returned stabilises the model that it was designed on; this is checked, not assumed.

use num_complex::Complex;
use tpm_numerics::{DMatrix, DVector, Matrix, Riccati, RiccatiError, continuous_riccati, exponential, riccati};

/// Weights of the cost: the diagonals of Q and R.
#[derive(Clone, Debug, PartialEq)]
pub struct RegulatorWeights {
    /// One per state, coordinates before their rates; not negative.
    pub state: Vec<f64>,
    /// One per input; positive.
    pub input: Vec<f64>,
}

impl RegulatorWeights {
    /// `x' Q x + u' R u`.
    #[must_use]
    pub fn cost(&self, state: &[f64], input: &[f64]) -> f64 {
        let sum = |weights: &[f64], values: &[f64]| weights.iter().zip(values).map(|(w, x)| w * x * x).sum::<f64>();
        sum(&self.state, state) + sum(&self.input, input)
    }
}

/// State feedback `u = -K x`, to be computed every `sample_time` seconds and held.
#[derive(Clone, Debug, PartialEq)]
pub struct Regulator {
    gain: Matrix,
    cost: Matrix,
    sample_time: f64,
    poles: Vec<Complex<f64>>,
    residual: f64,
}

impl Regulator {
    /// The regulator of least cost for `x' = A x + B u`: A states times states, B states times inputs.
    ///
    /// # Errors
    /// [`RiccatiError`] when sizes do not fit, a number is not finite, the sample time or a weight is out of range, or no
    /// feedback stabilises.
    pub fn optimal(a: &Matrix, b: &Matrix, sample_time: f64, weights: &RegulatorWeights) -> Result<Self, RiccatiError> {
        let (ad, bd) = held(a.dense(), b.dense(), sample_time)?;
        let diagonal = |values: &[f64]| DMatrix::from_diagonal(&DVector::from_column_slice(values));
        let (q, r) = (diagonal(&weights.state), diagonal(&weights.input));
        let Riccati { solution, gain, poles, residual } = riccati(&ad, &bd, &q, &r)?;
        let (gain, cost) = (Matrix::of(gain), Matrix::of(solution * sample_time));
        Ok(Regulator { gain, cost, sample_time, poles, residual })
    }

    /// K, inputs times states.
    #[must_use]
    pub const fn gain(&self) -> &Matrix {
        &self.gain
    }

    /// P T, states times states: `x' P x T` is the least cost of coming to rest from x, on the model of the design.
    #[must_use]
    pub const fn cost(&self) -> &Matrix {
        &self.cost
    }

    /// T, s.
    #[must_use]
    pub const fn sample_time(&self) -> f64 {
        self.sample_time
    }

    /// Poles of the closed loop in sampled time, inside the unit circle.
    #[must_use]
    pub fn poles(&self) -> &[Complex<f64>] {
        &self.poles
    }

    /// Largest entry of the Riccati equation's residual, as a share of its largest term.
    #[must_use]
    pub const fn residual(&self) -> f64 {
        self.residual
    }

    /// Least cost of coming to rest from a state, on the model of the design.
    #[must_use]
    pub fn cost_from(&self, state: &[f64]) -> f64 {
        let state = DVector::from_column_slice(state);
        (state.transpose() * self.cost.dense() * &state)[(0, 0)]
    }
}

/// State feedback `u = -K x` in continuous time.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ContinuousRegulator {
    /// K, inputs times states.
    pub gain: Matrix,
    /// Poles of the closed loop, rad/s, left of the imaginary axis.
    pub poles: Vec<Complex<f64>>,
    /// Largest entry of the Riccati equation's residual, as a share of its largest term.
    pub residual: f64,
}

impl ContinuousRegulator {
    /// The regulator of least cost for `x' = A x + B u`: A states times states, B states times inputs.
    ///
    /// # Errors
    /// [`RiccatiError`] when sizes do not fit, a number is not finite, a weight is out of range, or no feedback stabilises.
    pub fn optimal(a: &Matrix, b: &Matrix, weights: &RegulatorWeights) -> Result<Self, RiccatiError> {
        let diagonal = |values: &[f64]| DMatrix::from_diagonal(&DVector::from_column_slice(values));
        let (q, r) = (diagonal(&weights.state), diagonal(&weights.input));
        let Riccati { gain, poles, residual, .. } = continuous_riccati(a.dense(), b.dense(), &q, &r)?;
        Ok(ContinuousRegulator { gain: Matrix::of(gain), poles, residual })
    }
}

/// Largest entry of a matrix whose exponential is taken.
const MOST_EXPONENT: f64 = 1e25;

/// Ad and Bd of `x' = A x + B u` under inputs that are held for `sample_time`: the exponential of `[A, B; 0, 0] T`.
///
/// # Errors
/// [`RiccatiError::Shape`] when A is not square or B has other rows, [`RiccatiError::SampleTime`], [`RiccatiError::NotFinite`].
pub(crate) fn held(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    sample_time: f64,
) -> Result<(DMatrix<f64>, DMatrix<f64>), RiccatiError> {
    let (n, m) = (a.nrows(), b.ncols());
    if a.ncols() != n || b.nrows() != n {
        return Err(RiccatiError::Shape);
    }
    if !(sample_time.is_finite() && sample_time > 0.0) {
        return Err(RiccatiError::SampleTime { sample_time });
    }
    if a.iter().chain(b.iter()).any(|x| !x.is_finite()) {
        return Err(RiccatiError::NotFinite);
    }
    let mut whole = DMatrix::zeros(n + m, n + m);
    whole.view_mut((0, 0), (n, n)).copy_from(&(a * sample_time));
    whole.view_mut((0, n), (n, m)).copy_from(&(b * sample_time));
    // The tenth power of the matrix, which its exponential takes, must be a number.
    if whole.amax() > MOST_EXPONENT {
        return Err(RiccatiError::NotFinite);
    }
    let exponential = exponential(&whole);
    if exponential.iter().any(|x| !x.is_finite()) {
        return Err(RiccatiError::NotFinite);
    }
    Ok((exponential.view((0, 0), (n, n)).into_owned(), exponential.view((0, n), (n, m)).into_owned()))
}

#[cfg(test)]
mod tests {
    use super::{ContinuousRegulator, Regulator, RegulatorWeights, RiccatiError, held};
    use tpm_numerics::{DMatrix, DVector, Matrix};

    #[test]
    fn a_held_double_integrator_has_the_textbook_matrices() {
        let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
        let b = DMatrix::from_row_slice(2, 1, &[0.0, 1.0]);
        let (ad, bd) = held(&a, &b, 0.1).expect("finite");
        assert!((ad - DMatrix::from_row_slice(2, 2, &[1.0, 0.1, 0.0, 1.0])).amax() < 1e-15);
        assert!((bd - DMatrix::from_row_slice(2, 1, &[0.005, 0.1])).amax() < 1e-16);
        // A pole at -3: e^{-3 T} and (1 - e^{-3 T})/3.
        let (ad, bd) =
            held(&DMatrix::from_element(1, 1, -3.0), &DMatrix::from_element(1, 1, 1.0), 0.2).expect("finite");
        assert!(
            (ad[(0, 0)] - (-0.6_f64).exp()).abs() < 1e-15 && (bd[(0, 0)] + (-0.6_f64).exp_m1() / 3.0).abs() < 1e-15
        );
    }

    #[test]
    fn a_matrix_without_an_exponential_in_range_is_refused() {
        let b = DMatrix::from_row_slice(2, 1, &[0.0, 1.0]);
        for entry in [1e300, 1e30, 1e24, 1e6] {
            let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, entry, 0.0]);
            assert_eq!(held(&a, &b, 1.0), Err(RiccatiError::NotFinite), "{entry}");
        }
    }

    #[test]
    fn the_cost_is_that_of_the_motion_and_no_other_gain_has_less() {
        // The pendulum upright (Fong, Eqn 24).
        let a = DMatrix::from_row_slice(
            4,
            4,
            &[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.9797, -8.1420, -0.1098, 0.0, 57.626, -6.9789, -1.0584],
        );
        let b = DMatrix::from_row_slice(4, 1, &[0.0, 0.0, 28.845, 24.725]);
        let weights = RegulatorWeights { state: vec![1.0, 1.0, 0.01, 0.01], input: vec![1.0] };
        let regulator = Regulator::optimal(&Matrix::of(a.clone()), &Matrix::of(b.clone()), 1e-3, &weights)
            .expect("can be stabilised");
        assert!(regulator.residual < 1e-10, "{:e}", regulator.residual);
        assert!(regulator.poles.iter().all(|z| z.norm() < 1.0));
        let (ad, bd) = held(&a, &b, 1e-3).expect("finite");
        let start = [0.1, 0.2, 0.0, -0.3];
        let played = |gain: &DMatrix<f64>| {
            let (mut x, mut sum) = (DVector::from_column_slice(&start), 0.0);
            for _ in 0..60_000 {
                let u = -gain * &x;
                sum += 1e-3 * weights.cost(x.as_slice(), u.as_slice());
                x = &ad * x + &bd * u;
            }
            sum
        };
        let (least, stated) = (played(regulator.gain.dense()), regulator.cost_from(&start));
        assert!((least / stated - 1.0).abs() < 1e-9, "{least} {stated}");
        for i in 0..4 {
            for change in [0.98, 1.02] {
                let mut gain = regulator.gain.dense().clone();
                gain[i] *= change;
                assert!(played(&gain) > least, "{i} {change}");
            }
        }
    }

    #[test]
    fn sampled_gains_approach_those_of_continuous_time() {
        let a = Matrix::of(DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 4.0, -0.3]));
        let b = Matrix::of(DMatrix::from_row_slice(2, 1, &[0.0, 0.5]));
        let weights = RegulatorWeights { state: vec![3.0, 0.1], input: vec![0.2] };
        let continuous = ContinuousRegulator::optimal(&a, &b, &weights).expect("can be stabilised");
        let off = |sample_time: f64| {
            let sampled = Regulator::optimal(&a, &b, sample_time, &weights).expect("can be stabilised");
            (sampled.gain.dense() - continuous.gain.dense()).amax()
        };
        let (coarse, fine) = (off(1e-3), off(5e-4));
        assert!(fine < 1e-2 && (coarse / fine - 2.0).abs() < 0.02, "{coarse} {fine}");
    }

    #[test]
    fn faults_are_named() {
        let one = || Matrix::of(DMatrix::from_element(1, 1, 1.0));
        let (a, b) = (one(), one());
        let weights = |state, input| RegulatorWeights { state: vec![state], input: vec![input] };
        let fault = |t, w| Regulator::optimal(&a, &b, t, &w).expect_err("faulty");
        assert_eq!(fault(0.0, weights(1.0, 1.0)), RiccatiError::SampleTime { sample_time: 0.0 });
        assert_eq!(fault(0.1, weights(1.0, 0.0)), RiccatiError::InputWeight);
        assert_eq!(fault(0.1, weights(-1.0, 1.0)), RiccatiError::StateWeight);
        assert_eq!(fault(0.1, RegulatorWeights { state: vec![1.0, 1.0], input: vec![1.0] }), RiccatiError::Shape);
        // An unstable mode that the input does not reach.
        let a = Matrix::of(DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, -1.0]));
        let b = Matrix::of(DMatrix::from_row_slice(2, 1, &[0.0, 1.0]));
        let weights = RegulatorWeights { state: vec![1.0, 1.0], input: vec![1.0] };
        assert_eq!(Regulator::optimal(&a, &b, 0.1, &weights), Err(RiccatiError::NotStabilisable));
    }
}
