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
    Shown, SquareRoot,
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
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> RunWorkspace<T, Q, R, P, S, L, E, K>
{
    /// What a run says of the parameters. Its channels are the Q coordinates and then the U inputs; `prior` has the present estimates,
    /// which weights begin from and parameters that the run does not show keep. With a reference the rows are linearised about it, at the
    /// prior, which then must be the parameters of the run's feed-forward.
    ///
    /// # Errors
    /// The fault of the run or of the reference; [`RunFault::Equations`] when a row or a prior is not finite; [`RunFault::Still`] when
    /// nothing stands out of the noise.
    pub fn estimate<M: RunModel<T, U, R, P, S>, const U: usize, const C: usize>(
        &mut self,
        model: &M,
        (run, passed): (&RunLines<T, C, L>, &RunPassed<T, U>),
        sampling: RunSampling<T>,
        prior: &[T; P],
        about: Option<(RunLinearisation, &RunReference<T, Q, L>)>,
    ) -> Result<RunEstimate<T, Q, P>, RunFault> {
        let lines = run.lines()?;
        let period = T::from_f64(f64::from(run.samples_per_period())) * sampling.sample_time;
        let w = T::from_f64(2.0) * T::PI / period;
        if !(prior.iter().all(|value| value.is_finite()) && w > T::ZERO && w.is_finite()) {
            return Err(RunFault::Equations);
        }
        for (own, line) in self.motion.iter_mut().zip(&lines) {
            *own = *line;
        }
        self.path = match about {
            Some((_, reference)) => *reference.lines(run.samples_per_period())?,
            None => self.motion,
        };
        let inputs = Self::applied::<U, C>(&lines, w, sampling);
        let map = self.evaluate(model, &inputs, w)?;
        let mut theta = *prior;
        self.forget_shift();
        self.sensors = [T::ZERO; Q];
        self.differentiate(model, &inputs, &theta, w);
        if let Some((which, _)) = about {
            self.respond(&M::MOTION, which, w);
            self.linearise(model, &inputs, &theta, w, false);
        }
        self.find_shown(&M::MOTION, w);
        let mut shown = self.solve(&M::MOTION, &theta, w, false)?;
        for pass in 0..PASSES {
            theta = moved(&theta, prior, &shown.0.solution);
            self.differentiate(model, &inputs, &theta, w);
            self.find_noise(&M::MOTION, w);
            if pass + 1 == PASSES {
                // Of second order in the noise, at parameters that were found without it.
                self.find_shift(model, run, (passed, &map), &inputs, (sampling, &theta, w));
            }
            if about.is_some() {
                self.linearise(model, &inputs, &theta, w, true);
            }
            self.find_shown(&M::MOTION, w);
            shown = self.solve(&M::MOTION, &theta, w, true)?;
        }
        let (found, equations) = shown;
        let freedom = equations.rows() - T::from_f64(found.rank as f64);
        let chi_squared = if freedom > T::ZERO { found.residual * found.residual / freedom } else { T::ZERO };
        let factor = chi_squared.max(T::ONE).sqrt();
        let mut values = [None; P];
        for ((value, step), theta) in values.iter_mut().zip(found.solution).zip(theta) {
            *value = step.map(|step| theta + step);
        }
        let samples = run.samples_behind_line();
        Ok(RunEstimate {
            values,
            deviations: found.deviations.map(|deviation| deviation.map(|deviation| deviation * factor)),
            covariance: found.covariance.map(|row| row.map(|entry| entry * factor * factor)),
            equations,
            about: theta,
            rank: found.rank,
            condition: found.condition,
            chi_squared,
            noise: self.sensors.map(|variance| (variance * samples).sqrt()),
        })
    }

    /// Solves the equations for the step from these parameters; `weighed` by the noise, otherwise rows by the size of their forces. The
    /// equations are returned too.
    fn solve(
        &mut self,
        slots: &[(usize, u32); S],
        theta: &[T; P],
        w: T,
        weighed: bool,
    ) -> Result<Found<T, P>, RunFault> {
        // Noise shifts the mean of a term that is even in a velocity: means count where it is known by how much, and where nothing else
        // shows a parameter.
        let means = if self.shifts { RunMeans::OfTerms } else { RunMeans::None };
        let mut factor = self.equations(slots, theta, w, (weighed, means))?;
        let mut found = factor.solution();
        if found.rank < P {
            factor = self.equations(slots, theta, w, (weighed, RunMeans::All))?;
            found = factor.solution();
        }
        if found.rank == 0 {
            return Err(RunFault::Still);
        }
        Ok((found, factor))
    }
}

/// A solution, and the equations behind it.
type Found<T, const P: usize> = (Shown<T, P>, SquareRoot<T, P>);

/// The parameters a step on; the prior where the run does not show one.
fn moved<T: Real, const P: usize>(theta: &[T; P], prior: &[T; P], steps: &[Option<T>; P]) -> [T; P] {
    let mut moved = *prior;
    for ((moved, theta), step) in moved.iter_mut().zip(theta).zip(steps) {
        *moved = step.map_or(*moved, |step| *theta + step);
    }
    moved
}
