//! The design of a regulator from a linear model and weights, with its poles, margins and unreached modes.
//!
//! Invariant: a design that is returned stabilises the linear model with the rates that the controller has. A loop that
//! filtered differences make unstable is refused.

use crate::regulator::controllability::{Mode, unreached_modes};
use crate::regulator::margins::{Margins, margins};
use crate::regulator::optimal::{ContinuousRegulator, Regulator, RegulatorWeights, held};
use num_complex::Complex;
use tpm_controller::control::Differentiator;
use tpm_numerics::eigenvalues::eigenvalues;
use tpm_numerics::{DMatrix, Matrix, RiccatiError};

/// The source of the rates of the coordinates in the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rates {
    /// They are measured.
    Measured,
    /// Filtered differences of the positions, with this time constant in seconds; zero for plain differences.
    Differences(f64),
}

/// The quantity that a weight belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighted {
    /// A state, by index: coordinates before their rates.
    State(usize),
    /// An input, by index.
    Input(usize),
}

/// Why there is no regulator.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DesignError {
    /// A weight is out of range.
    #[error("a weight of {value}: an input's must be a positive number, a state's a number that is not negative")]
    Weight {
        /// The quantity that it weighs.
        of: Weighted,
        /// The weight.
        value: f64,
    },
    /// The time constant of the differences is out of range.
    #[error("a time constant of {value} s; it must be a number that is not negative")]
    TimeConstant {
        /// The time constant, s.
        value: f64,
    },
    /// The inputs do not reach modes that do not die down by themselves.
    #[error("the inputs do not reach {} that no feedback can hold", if modes.len() == 1 { "a mode" } else { "modes" })]
    Unreached {
        /// The modes.
        modes: Vec<Mode>,
    },
    /// The Riccati equation has no stabilising solution.
    #[error(transparent)]
    Riccati(#[from] RiccatiError),
    /// The loop is not stable with the rates that the controller has.
    #[error(
        "with rates from filtered differences the loop is not stable: its largest pole has the magnitude {largest}; choose a smaller time constant, or weights of less feedback"
    )]
    Unstable {
        /// Largest magnitude of a pole in sampled time.
        largest: f64,
    },
}

/// A regulator with its poles and margins.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Design {
    /// Poles of the model without feedback, rad/s.
    pub open_poles: Vec<Complex<f64>>,
    /// Modes that the inputs do not reach, all of which die down by themselves.
    pub unreached: Vec<Mode>,
    /// The regulator in continuous time.
    pub continuous: ContinuousRegulator,
    /// The regulator at the controller's sample time.
    pub sampled: Regulator,
    /// Poles of the sampled loop with the rates that the controller has, inside the unit circle.
    pub poles: Vec<Complex<f64>>,
    /// Margins of this loop, one per input.
    pub margins: Vec<Margins>,
}

/// The regulator of least cost for `x' = A x + B u`: A states times states, B states times inputs, states being coordinates before
/// their rates.
///
/// # Errors
/// [`DesignError`] when a weight, the sample time or the time constant is out of range, the inputs do not reach a mode
/// that does not decay, the weights do not observe such a mode, or the loop with the rates that the controller has is
/// not stable.
pub fn design(
    a: &Matrix,
    b: &Matrix,
    sample_time: f64,
    rates: Rates,
    weights: &RegulatorWeights,
) -> Result<Design, DesignError> {
    let fault = |at: Option<(usize, f64)>, of: fn(usize) -> Weighted| {
        at.map_or(Ok(()), |(index, value)| Err(DesignError::Weight { of: of(index), value }))
    };
    let entries = |values: &[f64]| values.iter().copied().enumerate().collect::<Vec<_>>();
    let allowed = |value: f64, least: bool| value.is_finite() && (value > 0.0 || (least && value == 0.0));
    fault(entries(&weights.state).into_iter().find(|(_, value)| !allowed(*value, true)), Weighted::State)?;
    fault(entries(&weights.input).into_iter().find(|(_, value)| !allowed(*value, false)), Weighted::Input)?;
    if let Rates::Differences(value) = rates
        && !(value.is_finite() && value >= 0.0)
    {
        return Err(DesignError::TimeConstant { value });
    }
    let (ad, bd) = held(a.dense(), b.dense(), sample_time)?;
    let unreached = unreached_modes(a, b);
    if unreached.iter().any(|mode| !mode.decays) {
        let modes = unreached.into_iter().filter(|mode| !mode.decays).collect();
        return Err(DesignError::Unreached { modes });
    }
    let continuous = ContinuousRegulator::optimal(a, b, weights)?;
    let sampled = Regulator::optimal(a, b, sample_time, weights)?;
    let (a_loop, b_loop, c_loop) = played(&ad, &bd, sampled.gain().dense(), sample_time, rates);
    let poles = eigenvalues(&(&a_loop - &b_loop * &c_loop));
    if !poles.iter().all(|z| z.norm() < 1.0) {
        let largest = poles.iter().map(|z| z.norm()).fold(0.0, f64::max);
        return Err(DesignError::Unstable { largest });
    }
    let margins = margins(&Matrix::of(a_loop), &Matrix::of(b_loop), &Matrix::of(c_loop), sample_time);
    Ok(Design { open_poles: eigenvalues(a.dense()), unreached, continuous, sampled, poles, margins })
}

/// The loop `x[n+1] = A x[n] + B u[n]`, `u = -C x` with the rates that the controller has. With filtered differences
/// the state is extended by the last positions and the last rates, from which
/// `v[n] = a v[n-1] + (1 - a) (q[n] - q[n-1])/T` is formed.
fn played(
    ad: &DMatrix<f64>,
    bd: &DMatrix<f64>,
    gain: &DMatrix<f64>,
    sample_time: f64,
    rates: Rates,
) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
    let Rates::Differences(time_constant) = rates else { return (ad.clone(), bd.clone(), gain.clone()) };
    let (states, inputs) = (ad.nrows(), bd.ncols());
    let n = states / 2;
    let pole = Differentiator::new(sample_time, time_constant).pole();
    let slope = (1.0 - pole) / sample_time;
    let identity = DMatrix::<f64>::identity(n, n);
    let mut a = DMatrix::zeros(2 * states, 2 * states);
    a.view_mut((0, 0), (states, states)).copy_from(ad);
    a.view_mut((states, 0), (n, n)).copy_from(&identity);
    a.view_mut((states + n, 0), (n, n)).copy_from(&(slope * &identity));
    a.view_mut((states + n, states), (n, n)).copy_from(&(-slope * &identity));
    a.view_mut((states + n, states + n), (n, n)).copy_from(&(pole * &identity));
    let mut b = DMatrix::zeros(2 * states, inputs);
    b.view_mut((0, 0), (states, inputs)).copy_from(bd);
    let (proportional, derivative) = (gain.columns(0, n), gain.columns(n, n));
    let mut c = DMatrix::zeros(inputs, 2 * states);
    c.view_mut((0, 0), (inputs, n)).copy_from(&(proportional + slope * derivative));
    c.view_mut((0, states), (inputs, n)).copy_from(&(-slope * derivative));
    c.view_mut((0, states + n), (inputs, n)).copy_from(&(pole * derivative));
    (a, b, c)
}

#[cfg(test)]
mod tests {
    use super::{DesignError, Rates, Weighted, design, played};
    use crate::regulator::optimal::{RegulatorWeights, held};
    use tpm_controller::control::Differentiator;
    use tpm_numerics::{DMatrix, DVector, Matrix};

    fn unstable_mass() -> (Matrix, Matrix) {
        let a = Matrix::of(DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 4.0, 0.0]));
        (a, Matrix::of(DMatrix::from_row_slice(2, 1, &[0.0, 0.5])))
    }

    #[test]
    fn the_loop_with_differences_is_the_one_that_is_played() {
        let (a, b) = unstable_mass();
        let weights = RegulatorWeights { state: vec![10.0, 0.0], input: vec![0.1] };
        let found = design(&a, &b, 1e-2, Rates::Differences(0.02), &weights).expect("stable");
        let (ad, bd) = held(a.dense(), b.dense(), 1e-2).expect("finite");
        let gain = found.sampled.gain();
        let (al, bl, cl) = played(&ad, &bd, gain.dense(), 1e-2, Rates::Differences(0.02));
        let mut filter = Differentiator::new(1e-2, 0.02);
        filter.push(0.3);
        let mut x = DVector::from_column_slice(&[0.3, 0.0]);
        let mut augmented = DVector::from_column_slice(&[0.3, 0.0, 0.3, 0.0]);
        for _ in 0..50 {
            let rate = filter.push(x[0]);
            let u = -(gain[(0, 0)] * x[0] + gain[(0, 1)] * rate);
            assert!(((-&cl * &augmented)[(0, 0)] - u).abs() < 1e-12);
            augmented = &al * &augmented - &bl * (&cl * &augmented);
            x = &ad * x + &bd * u;
            assert!((augmented[0] - x[0]).abs() < 1e-12);
        }
        assert_eq!((found.poles.len(), found.margins.len(), found.open_poles.len()), (4, 1, 2));
    }

    #[test]
    fn faults_are_named() {
        let (a, b) = unstable_mass();
        let weights = |state: [f64; 2], input: f64| RegulatorWeights { state: state.to_vec(), input: vec![input] };
        let refused = |rates, weights: &RegulatorWeights| design(&a, &b, 1e-2, rates, weights).expect_err("refused");
        let of_state = refused(Rates::Measured, &weights([1.0, -1.0], 1.0));
        assert_eq!(of_state, DesignError::Weight { of: Weighted::State(1), value: -1.0 });
        let of_input = refused(Rates::Measured, &weights([1.0, 1.0], 0.0));
        assert_eq!(of_input, DesignError::Weight { of: Weighted::Input(0), value: 0.0 });
        assert!(matches!(refused(Rates::Differences(-1.0), &weights([1.0; 2], 1.0)), DesignError::TimeConstant { .. }));
        assert!(matches!(refused(Rates::Differences(3.0), &weights([1.0; 2], 1e-4)), DesignError::Unstable { .. }));
        // A second mass that nothing drives.
        let rows = |rows: &[[f64; 4]]| {
            Matrix::from_rows(&rows.iter().map(|row| row.to_vec()).collect::<Vec<_>>()).expect("rows of one length")
        };
        let a = rows(&[[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 4.0, 0.0, 0.0]]);
        let b = Matrix::from_rows(&[vec![0.0], vec![0.0], vec![1.0], vec![0.0]]).expect("rows of one length");
        let weights = RegulatorWeights { state: vec![1.0; 4], input: vec![1.0] };
        let Err(DesignError::Unreached { modes }) = design(&a, &b, 1e-2, Rates::Measured, &weights) else {
            panic!("the second mass cannot be held")
        };
        // Its mode at -2 rad/s dies down.
        assert!(modes.len() == 1 && (modes[0].pole.re - 2.0).abs() < 1e-9, "{modes:?}");
        assert!((modes[0].combination[1] - 1.0).abs() < 1e-9 && modes[0].combination[0].abs() < 1e-9);
    }
}
