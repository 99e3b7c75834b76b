//! The parameters of a model from the lines of one run, in memory of fixed size (estimator `measured-motion`).
//!
//! The rows `Phi theta + known = B u` are evaluated along the measured motion, which its harmonics give with all derivatives, and their
//! harmonics, sines as well as cosines, are equated with those of the applied inputs:
//!
//! ```text
//! (B u)_k - known_k = sum_p (Phi_p)_k theta_p - (J n)_k ,      k = 0, ..., H
//! ```
//!
//! with the sensors' noise n and the derivatives J of the rows along the motion, which mix the lines. The inputs are those that were
//! applied: a hold multiplies their lines by `(1 - e^{-jWT})/(jWT)`, a delay by `e^{-jW delay}`.
//!
//! Halfway between the harmonics the same equations hold without the periodic motion, so that `B u - J q` there is noise alone. The
//! variance of every sensor, and of a force on every row, follows from it by maximum likelihood, and with them the covariance of all
//! equations, by which they are weighed. Weights need the parameters: a first pass weighs the rows by the size of
//! their forces, and [`PASSES`] more at the estimate of the pass before.
//!
//! Invariants: nothing allocates; every loop has a length that the model fixes, so that an update takes a fixed time; indices run up to
//! lengths of the arrays that they index. Equations are solved for the step from the pass before in square-root form, so that single
//! precision keeps the digits of the step, and nothing is estimated along what the run does not show.

use super::{
    Real, RunFault, RunLinearisation, RunLines, RunMeans, RunModel, RunPassed, RunReference, RunSampling, RunWorkspace,
    Solution, SquareRoot,
};

/// Passes that weigh equations by their noise.
const PASSES: usize = 3;

/// What a run says of the parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunEstimate<T, const Q: usize, const P: usize> {
    /// The parameters; nothing for those that the run does not show.
    pub values: [Option<T>; P],
    /// Their standard deviations.
    pub deviations: [Option<T>; P],
    /// Their covariance; zero for those that the run does not show.
    pub covariance: [[T; P]; P],
    /// A row for every parameter that leads a combination which the run shows: the weights of all parameters in it, one at its own. A shown
    /// parameter is a combination of itself alone; the others lead none.
    pub combinations: [[T; P]; P],
    /// The values of the combinations and their standard deviations; nothing where there is none.
    pub combined: [Option<[T; 2]>; P],
    /// The weighted equations for the step from `about`, by which runs are pooled.
    pub equations: SquareRoot<T, P>,
    /// The parameters from which the steps of the equations count: those of the pass before the last.
    pub about: [T; P],
    /// The number of directions that the run shows.
    pub rank: usize,
    /// At least the condition number of what is shown, and at most the rank times that.
    pub condition: T,
    /// Weighted sum of squares of what is left, over its degrees of freedom: about one where the model obeys the machine. Where it is
    /// larger, the deviations are those of the noise times its root.
    pub chi_squared: T,
    /// Standard deviation of the noise in the samples of every coordinate.
    pub noise: [T; Q],
}

impl<
    T: Real,
    const U: usize,
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> RunWorkspace<T, U, Q, R, P, S, L, E, K>
{
    /// What a run says of the parameters. Its channels are the Q coordinates and then the U inputs; `prior` has the present estimates,
    /// which weights begin from and parameters that the run does not show keep. With a reference the rows are linearised about it, at the
    /// prior, which then must be the parameters of the run's feed-forward.
    ///
    /// # Errors
    /// The fault of the run or of the reference; [`RunFault::Equations`] when a row or a prior is not finite; [`RunFault::Still`] when
    /// nothing stands out of the noise.
    pub fn estimate<M: RunModel<T, U, R, P, S>, const C: usize>(
        &mut self,
        model: &M,
        (run, passed): (&RunLines<T, C, L>, &RunPassed<T, U>),
        sampling: RunSampling<T>,
        prior: &[T; P],
        about: Option<(RunLinearisation, &RunReference<T, Q, L>)>,
    ) -> Result<RunEstimate<T, Q, P>, RunFault> {
        self.prior = *prior;
        match about {
            Some((which, reference)) => self.update_about(model, run, passed, &sampling, reference, which)?,
            None => self.update(model, run, passed, &sampling)?,
        }
        let samples = run.samples_behind_line();
        let noise = self.sensors.map(|variance| (variance * samples).sqrt());
        Ok(RunEstimate::of(&self.factor, &self.about, self.chi_squared(), noise))
    }

    /// Finds what a run says of the parameters, from those of `prior`, along the measured motion.
    ///
    /// # Errors
    /// Those of an estimate.
    pub fn update<M: RunModel<T, U, R, P, S>, const C: usize>(
        &mut self,
        model: &M,
        run: &RunLines<T, C, L>,
        passed: &RunPassed<T, U>,
        sampling: &RunSampling<T>,
    ) -> Result<(), RunFault> {
        self.take(run, sampling)?;
        self.path = self.motion;
        self.evaluate(model)?;
        self.differentiate(model);
        self.find_shown(model);
        self.solve(model, false)?;
        for pass in 0..PASSES {
            self.differentiate(model);
            self.find_noise(model);
            if pass + 1 == PASSES {
                // Of second order in the noise, at parameters that were found without it.
                self.find_shift(model, run, passed, sampling);
            }
            self.find_shown(model);
            self.solve(model, true)?;
        }
        Ok(())
    }

    /// Finds what a run says of the parameters, its rows linearised about a reference.
    ///
    /// # Errors
    /// Those of an estimate.
    pub fn update_about<M: RunModel<T, U, R, P, S>, const C: usize>(
        &mut self,
        model: &M,
        run: &RunLines<T, C, L>,
        passed: &RunPassed<T, U>,
        sampling: &RunSampling<T>,
        reference: &RunReference<T, Q, L>,
        which: RunLinearisation,
    ) -> Result<(), RunFault> {
        self.take(run, sampling)?;
        reference.fits(run.samples_per_period)?;
        self.path = reference.lines;
        self.evaluate(model)?;
        self.differentiate(model);
        self.respond(model, which);
        self.linearise(model, false);
        self.find_shown(model);
        self.solve(model, false)?;
        for pass in 0..PASSES {
            self.differentiate(model);
            self.find_noise(model);
            if pass + 1 == PASSES {
                self.find_shift(model, run, passed, sampling);
            }
            self.linearise(model, true);
            self.find_shown(model);
            self.solve(model, true)?;
        }
        Ok(())
    }

    /// Solves the equations for the step from the present parameters and makes it; `weighed` by the noise, otherwise rows by the size of
    /// their forces. What the run shows in combinations alone moves the parameters in them as little as it can; the prior stays where nothing is
    /// shown.
    ///
    /// Noise shifts the mean of a term that is even in a velocity: means count where it is known by how much, and where nothing else
    /// shows a parameter.
    fn solve<M: RunModel<T, U, R, P, S>>(&mut self, model: &M, weighed: bool) -> Result<(), RunFault> {
        let means = if self.shifts { RunMeans::OfTerms } else { RunMeans::None };
        self.equations(model, weighed, means)?;
        self.factor.solve(&mut self.found);
        if self.found.rank < P {
            self.equations(model, weighed, RunMeans::All)?;
            self.factor.solve(&mut self.found);
        }
        if self.found.rank == 0 {
            return Err(RunFault::Still);
        }
        self.about = self.theta;
        for column in 0..P {
            self.theta[column] += self.found.steps[column];
        }
        Ok(())
    }

    /// Weighted sum of squares of what the equations leave, over its degrees of freedom.
    pub fn chi_squared(&self) -> T {
        self.factor.chi_squared(&self.found)
    }
}

impl<T: Real, const Q: usize, const P: usize> RunEstimate<T, Q, P> {
    /// What equations for the step from some parameters show.
    pub(super) fn of(equations: &SquareRoot<T, P>, about: &[T; P], chi_squared: T, noise: [T; Q]) -> Self {
        let mut found = Solution::default();
        equations.solve(&mut found);
        let factor = chi_squared.max(T::ONE);
        let (mut values, mut deviations, mut combined) = ([None; P], [None; P], [None; P]);
        for place in 0..P {
            if found.shown[place] {
                values[place] = Some(about[place] + found.values[place]);
                deviations[place] = Some(found.deviations[place] * factor.sqrt());
            }
            if found.combinations[place][place] > T::ZERO {
                combined[place] = Some([found.combined(about, place), found.deviations[place] * factor.sqrt()]);
            }
        }
        Self {
            values,
            deviations,
            covariance: found.covariance.map(|row| row.map(|entry| entry * factor)),
            combinations: found.combinations,
            combined,
            equations: *equations,
            about: *about,
            rank: found.rank,
            condition: found.condition,
            chi_squared,
            noise,
        }
    }
}
