//! The parameters from runs with one parameter of the feed-forward changed (estimator `numerical`; Feng, Eqn 3.28), in memory of fixed size.
//!
//! The harmonics of the tracking error depend on the parameters theta' of the feed-forward, and vanish where these are the machine's:
//! `E(theta') = M (theta' - theta)`. Differences of runs give M column by column, so that neither the model's rows nor the loop are needed:
//!
//! ```text
//! M_p = (E(theta' + step_p) - E(theta')) / step_p .
//! ```
//!
//! Over a long step E bends, and the quotient errs by the bend. A second run with the opposite step makes the column the slope, at theta',
//! of the parabola through all three errors.
//!
//! Every line has the noise that stands halfway between the harmonics of all runs. A column is a sum of errors with weights w, so that an
//! update u leaves `(1 + sum u w_base)^2 + sum u^2 w^2` times the variance of one run, since all runs are compared with the same one.
//!
//! Invariant: nothing allocates, and every loop has a length that is fixed.

use super::{Phasor, Real, RunEstimate, RunFault, RunLines, RunReference, Solution, SquareRoot};

/// A harmonic is used where it stands so many times out of the noise.
const LEAST_VISIBLE: f64 = 4.0;
/// Roundings of the largest line that every line may have gathered.
const ROUNDINGS: f64 = 16.0;

/// The tracking errors of a run and of those with one parameter changed: Q coordinates, P parameters, L lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunNumerical<T, const Q: usize, const P: usize, const L: usize> {
    base: [[Phasor<T>; L]; Q],
    /// How the tracking error changes with each parameter.
    slopes: [[[Phasor<T>; L]; Q]; P],
    /// By how much each was changed in the first and in the second of its runs; zero where the run has not been played.
    steps: [[T; 2]; P],
    /// Sums of squares of the lines halfway between the harmonics, and of how many runs.
    noise: [T; Q],
    runs: T,
    /// Square of the largest line that was measured.
    peak: [T; Q],
    /// Samples of a run, and of a period; zero before there is one.
    samples: u32,
    samples_per_period: u32,
    /// The variance of noise in the samples over that of a line.
    behind: T,
}

impl<T: Real, const Q: usize, const P: usize, const L: usize> Default for RunNumerical<T, Q, P, L> {
    fn default() -> Self {
        Self {
            base: [[Phasor::zero(); L]; Q],
            slopes: [[[Phasor::zero(); L]; Q]; P],
            steps: [[T::ZERO; 2]; P],
            noise: [T::ZERO; Q],
            runs: T::ZERO,
            peak: [T::ZERO; Q],
            samples: 0,
            samples_per_period: 0,
            behind: T::ONE,
        }
    }
}

/// The weights of the base run and of the two others in the slope at the base: of the line through two errors, or of the parabola through
/// three. Their sum is zero.
fn slope_weights<T: Real>(first: T, second: T, weights: &mut [T; 3]) {
    weights[1] = if first.abs() > T::ZERO { T::ONE / first } else { T::ZERO };
    weights[2] = T::ZERO;
    if second.abs() > T::ZERO {
        weights[1] = second / (first * (second - first));
        weights[2] = first / (second * (first - second));
    }
    weights[0] = -(weights[1] + weights[2]);
}

impl<T: Real, const Q: usize, const P: usize, const L: usize> RunNumerical<T, Q, P, L> {
    /// Begins with a run; the coordinates are the first channels.
    ///
    /// # Errors
    /// The fault of the run or of its reference; what was there before has stayed.
    pub fn begin<const C: usize>(
        &mut self,
        run: &RunLines<T, C, L>,
        reference: &RunReference<T, Q, L>,
    ) -> Result<(), RunFault> {
        run.finished()?;
        reference.fits(run.samples_per_period)?;
        self.steps = [[T::ZERO; 2]; P];
        self.noise = [T::ZERO; Q];
        self.peak = [T::ZERO; Q];
        self.runs = T::ZERO;
        self.samples = run.samples;
        self.samples_per_period = run.samples_per_period;
        self.behind = run.samples_behind_line();
        self.take_noise(run);
        for coordinate in 0..Q {
            for line in (0..L).step_by(2) {
                self.base[coordinate][line] = run.line(coordinate, line) - reference.lines[coordinate][line];
            }
        }
        Ok(())
    }

    /// Takes in a run in whose feed-forward one parameter is larger by a step, all else as in the first run. A second run with the
    /// opposite step takes the bend of the response out of the first one's difference; any other takes the place of what was there.
    ///
    /// # Errors
    /// [`RunFault::Perturbation`] when there is no such parameter, the step is zero or not finite, or there is no first run;
    /// [`RunFault::Samples`] when the run has other samples than the first one; and the fault of the run or of its reference.
    pub fn change<const C: usize>(
        &mut self,
        parameter: usize,
        step: T,
        run: &RunLines<T, C, L>,
        reference: &RunReference<T, Q, L>,
    ) -> Result<(), RunFault> {
        run.finished()?;
        reference.fits(run.samples_per_period)?;
        if parameter >= P || self.samples == 0 || !step.is_finite() || step.abs() <= T::ZERO {
            return Err(RunFault::Perturbation);
        }
        if self.samples != run.samples || self.samples_per_period != run.samples_per_period {
            return Err(RunFault::Samples);
        }
        self.take_noise(run);
        let first = self.steps[parameter][0];
        let is_any = first.abs() > T::ZERO;
        let is_both = self.steps[parameter][1].abs() > T::ZERO;
        let opposite = is_any && !is_both && (first < T::ZERO) != (step < T::ZERO);
        if opposite {
            self.steps[parameter][1] = step;
        } else {
            self.steps[parameter][0] = step;
            self.steps[parameter][1] = T::ZERO;
        }
        let mut weights = [T::ZERO; 3];
        slope_weights(self.steps[parameter][0], self.steps[parameter][1], &mut weights);
        for coordinate in 0..Q {
            for line in (0..L).step_by(2) {
                let error = run.line(coordinate, line) - reference.lines[coordinate][line];
                let changed = error - self.base[coordinate][line];
                let before = self.slopes[parameter][coordinate][line];
                // The slope of the first run alone is that of a line through it.
                let kept = before.times(weights[1] * first) + changed.times(weights[2]);
                self.slopes[parameter][coordinate][line] = if opposite { kept } else { changed.times(weights[1]) };
            }
        }
        Ok(())
    }

    /// Takes in the noise of a run, which counts with that of the others.
    fn take_noise<const C: usize>(&mut self, run: &RunLines<T, C, L>) {
        self.runs += T::ONE;
        for coordinate in 0..Q {
            for line in 0..L {
                let square = run.line(coordinate, line).square();
                self.peak[coordinate] = self.peak[coordinate].max(square);
                if line % 2 != 0 {
                    let between = L / 2;
                    self.noise[coordinate] += square / T::from_f64(between as f64);
                }
            }
        }
    }

    /// What the runs say of the parameters; `played` were those of the first run's feed-forward. A parameter without a run of its own
    /// stays as it was played, and gets no number.
    ///
    /// # Errors
    /// [`RunFault::Unfinished`] before any parameter was changed, [`RunFault::Still`] when nothing stands out of the noise,
    /// [`RunFault::Equations`] when a number is not finite.
    pub fn estimate(&self, played: &[T; P]) -> Result<RunEstimate<T, Q, P>, RunFault> {
        let mut equations = SquareRoot::default();
        let mut found = Solution::default();
        self.update(played, &mut equations, &mut found)?;
        let mut noise = [T::ZERO; Q];
        for coordinate in 0..Q {
            noise[coordinate] = (self.variance(coordinate) * self.behind).sqrt();
        }
        Ok(RunEstimate::of(&equations, played, equations.chi_squared(&found), noise))
    }

    /// The equations for the step from the parameters that were played, and their solution.
    ///
    /// # Errors
    /// Those of an estimate.
    pub fn update(
        &self,
        played: &[T; P],
        equations: &mut SquareRoot<T, P>,
        found: &mut Solution<T, P>,
    ) -> Result<(), RunFault> {
        let mut any = false;
        for parameter in 0..P {
            any |= self.steps[parameter][0].abs() > T::ZERO;
        }
        if !any {
            return Err(RunFault::Unfinished { samples: self.samples });
        }
        for parameter in 0..P {
            if !played[parameter].is_finite() {
                return Err(RunFault::Equations);
            }
        }
        self.equations(T::ONE, equations)?;
        equations.solve(found);
        let mut base = T::ONE;
        let mut squares = T::ZERO;
        for parameter in 0..P {
            let update = if found.shown[parameter] { found.values[parameter] } else { T::ZERO };
            let mut weights = [T::ZERO; 3];
            slope_weights(self.steps[parameter][0], self.steps[parameter][1], &mut weights);
            base += update * weights[0];
            squares += update * weights[1] * (update * weights[1]) + update * weights[2] * (update * weights[2]);
        }
        // An update by the whole step needs the changed run alone.
        self.equations(base * base + squares, equations)?;
        equations.solve(found);
        if found.rank == 0 {
            return Err(RunFault::Still);
        }
        Ok(())
    }

    /// Variance of a line of a coordinate.
    pub fn variance(&self, coordinate: usize) -> T {
        let rounding = T::from_f64(ROUNDINGS) * T::EPSILON;
        let noise = self.noise[coordinate] / self.runs.max(T::ONE);
        noise.max(self.peak[coordinate] * rounding * rounding)
    }

    /// `-M update = E`, every part divided by its deviation, for noise of `factor` times the variance of one run.
    fn equations(&self, factor: T, equations: &mut SquareRoot<T, P>) -> Result<(), RunFault> {
        equations.clear();
        for coordinate in 0..Q {
            let variance = self.variance(coordinate);
            let deviation = (variance * factor / T::from_f64(2.0)).sqrt();
            if deviation <= T::ZERO {
                continue;
            }
            for line in (2..L).step_by(2) {
                let own = self.base[coordinate][line];
                let mut real = [T::ZERO; P];
                let mut imaginary = [T::ZERO; P];
                let mut shown = own.square() > T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE) * variance;
                for parameter in 0..P {
                    if self.steps[parameter][0].abs() <= T::ZERO {
                        continue;
                    }
                    let mut weights = [T::ZERO; 3];
                    slope_weights(self.steps[parameter][0], self.steps[parameter][1], &mut weights);
                    let sum = weights[0] * weights[0] + weights[1] * weights[1] + weights[2] * weights[2];
                    let slope = self.slopes[parameter][coordinate][line];
                    shown |= slope.square() > T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE) * variance * sum;
                    real[parameter] = -slope.re / deviation;
                    imaginary[parameter] = -slope.im / deviation;
                }
                if shown
                    && (!equations.take(&mut real, own.re / deviation)
                        || !equations.take(&mut imaginary, own.im / deviation))
                {
                    return Err(RunFault::Equations);
                }
            }
        }
        Ok(())
    }
}
