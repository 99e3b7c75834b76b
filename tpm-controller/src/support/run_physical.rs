//! Physical parameters p from the equations of a run for the parameters c(p) that stand in its rows: products and sums of them.
//!
//! The equations of a run say `R (c - about) = z` with independent errors of variance one. Gauss-Newton minimises `|R (c(p) - about) - z|`:
//! the equations for a step of p have the rows `R dc/dp`. A step that makes the sum of squares larger is halved. Directions of p on which c
//! does not depend, or which the run does not show, get no number.
//!
//! Invariants: nothing allocates, and every loop has a length that is fixed.

use super::{Real, RunFault, SquareRoot};

/// Steps of the iteration, each of which is halved so often at most.
const STEPS: usize = 30;
const HALVINGS: usize = 8;
/// A step ends the iteration when it is below this share of its own deviations in square, or changes the sum of squares by rounding alone.
const SMALL: f64 = 1e-12;

/// The parameters of rows as functions of N physical ones.
pub trait RunLumping<T: Real, const P: usize, const N: usize> {
    /// The parameters of the rows, and their derivatives. All entries are zero before the call.
    fn lump(&self, physical: &[T; N], parameters: &mut [T; P], slopes: &mut [[T; N]; P]);
}

/// What a run says of physical parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunPhysical<T, const N: usize> {
    /// The parameters; nothing for those that the run does not show.
    pub values: [Option<T>; N],
    /// Their standard deviations.
    pub deviations: [Option<T>; N],
    /// Their covariance; zero for those that the run does not show.
    pub covariance: [[T; N]; N],
    /// The number of directions that the run shows.
    pub rank: usize,
    /// At least the condition number of what is shown, and at most the rank times that.
    pub condition: T,
    /// Weighted sum of squares of what all equations leave at these parameters, over its degrees of freedom.
    pub chi_squared: T,
}

/// The equations for a step from physical parameters, and the sum of squares there; nothing where a number is not finite.
fn equations<T: Real, M: RunLumping<T, P, N>, const P: usize, const N: usize>(
    lumping: &M,
    run: &SquareRoot<T, P>,
    about: &[T; P],
    physical: &[T; N],
) -> Option<(SquareRoot<T, N>, T)> {
    let (mut parameters, mut slopes) = ([T::ZERO; P], [[T::ZERO; N]; P]);
    lumping.lump(physical, &mut parameters, &mut slopes);
    let (mut step, mut squares) = (SquareRoot::default(), T::ZERO);
    for (row, right) in run.equations() {
        let (mut own, mut rest) = ([T::ZERO; N], right);
        for (((entry, value), about), slopes) in row.iter().zip(parameters).zip(about).zip(&slopes) {
            rest -= *entry * (value - *about);
            own.iter_mut().zip(slopes).for_each(|(sum, slope)| *sum += *entry * *slope);
        }
        step.push(own, rest).ok()?;
        squares += rest * rest;
    }
    squares.is_finite().then_some((step, squares))
}

impl<T: Real, const N: usize> RunPhysical<T, N> {
    /// The physical parameters that a run's equations for the step of c from `about` show, from these to begin with, which parameters that
    /// the run does not show keep.
    ///
    /// # Errors
    /// [`RunFault::Equations`] when a prior or a number on the way is not finite, [`RunFault::Still`] when nothing is shown,
    /// [`RunFault::Apart`] when the iteration does not come to rest.
    pub fn of<M: RunLumping<T, P, N>, const P: usize>(
        lumping: &M,
        run: &SquareRoot<T, P>,
        about: &[T; P],
        prior: &[T; N],
    ) -> Result<Self, RunFault> {
        let mut physical = *prior;
        let (mut step, mut squares) = equations(lumping, run, about, &physical).ok_or(RunFault::Equations)?;
        let small = T::from_f64(SMALL).max(T::EPSILON);
        for _ in 0..STEPS {
            let found = step.solution();
            if found.rank == 0 {
                return Err(RunFault::Still);
            }
            // What the step is in its own deviations.
            let mut size = T::ZERO;
            for (step, deviation) in found.solution.iter().zip(&found.deviations) {
                if let (Some(step), Some(deviation)) = (step, deviation) {
                    size = size.max(*step * *step / (*deviation * *deviation));
                }
            }
            let mut share = T::ONE;
            let mut next = None;
            for _ in 0..HALVINGS {
                let mut moved = physical;
                for (value, step) in moved.iter_mut().zip(found.solution) {
                    *value += step.map_or(T::ZERO, |step| share * step);
                }
                next = equations(lumping, run, about, &moved).filter(|(_, after)| *after < squares);
                if next.is_some() {
                    physical = moved;
                    break;
                }
                share /= T::from_f64(2.0);
            }
            let at_rest = size <= small.sqrt();
            match next {
                Some(found) => (step, squares) = found,
                // No smaller sum of squares in the direction of the step: at rest, or nowhere near.
                None if at_rest || size <= T::from_f64(1e-2) => return Self::at(&step, squares, run, &physical),
                None => return Err(RunFault::Apart),
            }
            if at_rest {
                return Self::at(&step, squares, run, &physical);
            }
        }
        Err(RunFault::Apart)
    }

    /// The result where the iteration has come to rest.
    fn at<const P: usize>(
        step: &SquareRoot<T, N>,
        squares: T,
        run: &SquareRoot<T, P>,
        physical: &[T; N],
    ) -> Result<Self, RunFault> {
        let found = step.solution();
        let freedom = run.rows() - T::from_f64(found.rank as f64);
        let all = squares + run.residual() * run.residual();
        let chi_squared = if freedom > T::ZERO { all / freedom } else { T::ZERO };
        let factor = chi_squared.max(T::ONE);
        let mut values = [None; N];
        for ((value, step), own) in values.iter_mut().zip(found.solution).zip(physical) {
            *value = step.map(|_| *own);
        }
        Ok(Self {
            values,
            deviations: found.deviations.map(|deviation| deviation.map(|deviation| deviation * factor.sqrt())),
            covariance: found.covariance.map(|row| row.map(|entry| entry * factor)),
            rank: found.rank,
            condition: found.condition,
            chi_squared,
        })
    }
}
