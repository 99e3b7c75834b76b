//! Physical parameters p from the equations of a run for the parameters c(p) that stand in its rows: products and sums of them.
//!
//! The equations of a run say `R (c - about) = z` with independent errors of variance one. Gauss-Newton minimises `|R (c(p) - about) - z|`:
//! the equations for a step of p have the rows `R dc/dp`. A step that makes the sum of squares larger is halved. Directions of p on which c
//! does not depend, or which the run does not show, get no number.
//!
//! Invariants: nothing allocates, and every loop has a length that is fixed.

use super::{Real, RunFault, Solution, SquareRoot};

/// Steps of the iteration, each of which is halved so often at most.
const STEPS: usize = 30;
const HALVINGS: usize = 8;
/// A step ends the iteration when it is below this share of its own deviations in square, or changes the sum of squares by rounding alone.
const SMALL: f64 = 1e-12;
/// Below this share it ends where no step makes the sum of squares smaller.
const NEAR: f64 = 1e-2;

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

/// The memory of the iteration: P parameters of the rows, N physical ones.
#[derive(Clone, Copy, Debug)]
pub struct RunIteration<T, const P: usize, const N: usize> {
    /// The physical parameters.
    pub values: [T; N],
    moved: [T; N],
    lumped: [T; P],
    slopes: [[T; N]; P],
    /// The equations for a step from them, those for one from where a step has led, and their solution.
    step: SquareRoot<T, N>,
    trial: SquareRoot<T, N>,
    pub(super) found: Solution<T, N>,
    /// The sum of squares of what all equations leave at the physical parameters.
    squares: T,
}

impl<T: Real, const P: usize, const N: usize> RunIteration<T, P, N> {
    /// Before an iteration from these parameters.
    fn new(values: [T; N]) -> Self {
        Self {
            values,
            moved: values,
            lumped: [T::ZERO; P],
            slopes: [[T::ZERO; N]; P],
            step: SquareRoot::default(),
            trial: SquareRoot::default(),
            found: Solution::default(),
            squares: T::ZERO,
        }
    }

    /// The equations for a step from where the last one has led, and the sum of squares there, which is not finite where a number is not.
    fn equations<M: RunLumping<T, P, N>>(&mut self, lumping: &M, run: &SquareRoot<T, P>, about: &[T; P]) -> T {
        self.trial.clear();
        self.lumped = [T::ZERO; P];
        self.slopes = [[T::ZERO; N]; P];
        lumping.lump(&self.moved, &mut self.lumped, &mut self.slopes);
        let mut squares = T::ZERO;
        for i in 0..P {
            let mut row = [T::ZERO; N];
            let mut rest = run.right[i];
            for j in 0..P {
                rest -= run.factor[i][j] * (self.lumped[j] - about[j]);
                for k in 0..N {
                    row[k] += run.factor[i][j] * self.slopes[j][k];
                }
            }
            squares += rest * rest;
            if !self.trial.take(&mut row, rest) {
                return T::ONE / T::ZERO;
            }
        }
        squares
    }

    /// The physical parameters that a run's equations for the step of c from `about` show, from `values` to begin with.
    ///
    /// # Errors
    /// [`RunFault::Equations`] when a prior or a number on the way is not finite, [`RunFault::Still`] when nothing is shown,
    /// [`RunFault::Apart`] when the iteration does not come to rest.
    pub fn update<M: RunLumping<T, P, N>>(
        &mut self,
        lumping: &M,
        run: &SquareRoot<T, P>,
        about: &[T; P],
    ) -> Result<(), RunFault> {
        self.moved = self.values;
        self.squares = self.equations(lumping, run, about);
        if !self.squares.is_finite() {
            return Err(RunFault::Equations);
        }
        self.step = self.trial;
        let small = T::from_f64(SMALL).max(T::EPSILON).sqrt();
        for _ in 0..STEPS {
            self.step.solve(&mut self.found);
            if self.found.rank == 0 {
                return Err(RunFault::Still);
            }
            // What the step is in its own deviations.
            let mut size = T::ZERO;
            for k in 0..N {
                if self.found.shown[k] {
                    size = size.max(self.found.values[k] * self.found.values[k] / self.found.covariance[k][k]);
                }
            }
            let better = self.halved(lumping, run, about);
            // No smaller sum of squares in the direction of the step: at rest, or nowhere near.
            if size <= small || (!better && size <= T::from_f64(NEAR)) {
                self.step.solve(&mut self.found);
                return Ok(());
            }
            if !better {
                return Err(RunFault::Apart);
            }
        }
        Err(RunFault::Apart)
    }

    /// Makes the step, or as much of it as makes the sum of squares smaller; says whether any does.
    fn halved<M: RunLumping<T, P, N>>(&mut self, lumping: &M, run: &SquareRoot<T, P>, about: &[T; P]) -> bool {
        let mut share = T::ONE;
        for _ in 0..HALVINGS {
            for k in 0..N {
                let step = if self.found.shown[k] { share * self.found.values[k] } else { T::ZERO };
                self.moved[k] = self.values[k] + step;
            }
            let after = self.equations(lumping, run, about);
            if after < self.squares {
                self.squares = after;
                self.step = self.trial;
                self.values = self.moved;
                return true;
            }
            share /= T::from_f64(2.0);
        }
        false
    }

    /// Weighted sum of squares of what all equations leave, over its degrees of freedom.
    pub fn chi_squared(&self, run: &SquareRoot<T, P>) -> T {
        let freedom = run.rows - T::from_f64(self.found.rank as f64);
        let all = self.squares + run.residual * run.residual;
        if freedom > T::ZERO { all / freedom } else { T::ZERO }
    }
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
        let mut own = RunIteration::new(*prior);
        own.update(lumping, run, about)?;
        let found = own.step.solution();
        let chi_squared = own.chi_squared(run);
        let factor = chi_squared.max(T::ONE);
        let mut values = [None; N];
        for k in 0..N {
            values[k] = found.solution[k].map(|_| own.values[k]);
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
