//! The parameters from runs with one parameter of the feed-forward changed (estimator `numerical`; Feng, Eqn 3.28), in memory of fixed size.
//!
//! The harmonics of the tracking error depend on the parameters theta' of the feed-forward, and vanish where these are the machine's:
//! `E(theta') = M (theta' - theta)`. Differences of runs give M column by column, so that neither the model's rows nor the loop are needed:
//!
//! ```text
//! M_p = (E(theta' + step_p) - E(theta')) / step_p .
//! ```
//!
//! Every line has the noise that stands halfway between the harmonics of all runs. With the ratios r of the update to the steps, what is
//! solved has `(1 - sum r)^2 + sum r^2` times the variance of one run, since all runs are compared with the same one.
//!
//! Invariant: nothing allocates, and every loop has a length that is fixed.

use super::{Phasor, Real, RunEstimate, RunFault, RunLines, RunReference, SquareRoot};

/// A harmonic is used where it stands so many times out of the noise.
const LEAST_VISIBLE: f64 = 4.0;
/// Roundings of the largest line that every line may have gathered.
const ROUNDINGS: f64 = 16.0;

/// The tracking errors of a run and of those with one parameter changed: Q coordinates, P parameters, L lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunNumerical<T, const Q: usize, const P: usize, const L: usize> {
    base: [[Phasor<T>; L]; Q],
    changed: [[[Phasor<T>; L]; Q]; P],
    /// The change of each parameter; zero where its run has not been played.
    steps: [T; P],
    /// Sums of squares of the lines halfway between the harmonics, and of how many runs.
    noise: [T; Q],
    runs: T,
    /// Samples of a run, and of a period; zero before there is one.
    samples: [u32; 2],
    /// The variance of noise in the samples over that of a line.
    behind: T,
    /// Square of the largest line that was measured.
    peak: [T; Q],
}

impl<T: Real, const Q: usize, const P: usize, const L: usize> Default for RunNumerical<T, Q, P, L> {
    fn default() -> Self {
        Self {
            base: [[Phasor::ZERO; L]; Q],
            changed: [[[Phasor::ZERO; L]; Q]; P],
            steps: [T::ZERO; P],
            noise: [T::ZERO; Q],
            runs: T::ZERO,
            samples: [0; 2],
            behind: T::ONE,
            peak: [T::ZERO; Q],
        }
    }
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
        let (lines, reference) = (run.lines()?, reference.lines(run.samples_per_period())?);
        *self = Self::default();
        self.samples = [run.samples(), run.samples_per_period()];
        self.behind = run.samples_behind_line();
        self.base = self.take(&lines, reference);
        Ok(())
    }

    /// Takes in a run in whose feed-forward one parameter is larger by a step, all else as in the first run.
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
        let (lines, reference) = (run.lines()?, reference.lines(run.samples_per_period())?);
        if parameter >= P || self.samples[0] == 0 || !step.is_finite() || step.abs() <= T::ZERO {
            return Err(RunFault::Perturbation);
        }
        if self.samples != [run.samples(), run.samples_per_period()] {
            return Err(RunFault::Samples);
        }
        let changed = self.take(&lines, reference);
        for ((slot, own), number) in self.changed.iter_mut().zip(&mut self.steps).zip(0..) {
            if parameter == number {
                (*slot, *own) = (changed, step);
            }
        }
        Ok(())
    }

    /// The tracking error of a run, whose noise counts with that of the others.
    fn take(&mut self, lines: &[[Phasor<T>; L]], reference: &[[Phasor<T>; L]; Q]) -> [[Phasor<T>; L]; Q] {
        let mut error = [[Phasor::ZERO; L]; Q];
        self.runs += T::ONE;
        let sums = self.noise.iter_mut().zip(&mut self.peak);
        for (((error, lines), reference), (noise, peak)) in error.iter_mut().zip(lines).zip(reference).zip(sums) {
            for (index, (error, (line, own))) in error.iter_mut().zip(lines.iter().zip(reference)).enumerate() {
                *peak = peak.max(line.square());
                if index % 2 == 0 {
                    *error = *line - *own;
                } else {
                    *noise += line.square() / T::from_f64(L as f64 / 2.0);
                }
            }
        }
        error
    }

    /// What the runs say of the parameters; `played` were those of the first run's feed-forward. A parameter without a run of its own
    /// stays as it was played, and gets no number.
    ///
    /// # Errors
    /// [`RunFault::Unfinished`] before any parameter was changed, [`RunFault::Still`] when nothing stands out of the noise,
    /// [`RunFault::Equations`] when a number is not finite.
    pub fn estimate(&self, played: &[T; P]) -> Result<RunEstimate<T, Q, P>, RunFault> {
        if self.steps.iter().all(|step| step.abs() <= T::ZERO) {
            return Err(RunFault::Unfinished { samples: self.samples[0] });
        }
        if !played.iter().all(|value| value.is_finite()) {
            return Err(RunFault::Equations);
        }
        let first = self.equations(T::ONE)?.solution();
        let (mut sum, mut squares) = (T::ZERO, T::ZERO);
        for (update, step) in first.solution.iter().zip(self.steps) {
            let ratio = update.map_or(T::ZERO, |update| update / step);
            sum += ratio;
            squares += ratio * ratio;
        }
        // An update by the whole step needs the changed run alone.
        let factor = (T::ONE - sum) * (T::ONE - sum) + squares;
        let equations = self.equations(factor)?;
        let found = equations.solution();
        if found.rank == 0 {
            return Err(RunFault::Still);
        }
        let freedom = equations.rows() - T::from_f64(found.rank as f64);
        let chi_squared = if freedom > T::ZERO { found.residual * found.residual / freedom } else { T::ZERO };
        let scale = chi_squared.max(T::ONE);
        let mut values = [None; P];
        for ((value, update), played) in values.iter_mut().zip(found.solution).zip(played) {
            *value = update.map(|update| *played + update);
        }
        let mut noise = [T::ZERO; Q];
        for (slot, coordinate) in noise.iter_mut().zip(0..) {
            *slot = (self.variance(coordinate) * self.behind).sqrt();
        }
        Ok(RunEstimate {
            values,
            deviations: found.deviations.map(|deviation| deviation.map(|deviation| deviation * scale.sqrt())),
            covariance: found.covariance.map(|row| row.map(|entry| entry * scale)),
            equations,
            about: *played,
            rank: found.rank,
            condition: found.condition,
            chi_squared,
            noise,
        })
    }

    /// Variance of a line of a coordinate.
    fn variance(&self, coordinate: usize) -> T {
        let of = |values: &[T; Q]| values.get(coordinate).copied().unwrap_or(T::ZERO);
        let rounding = T::from_f64(ROUNDINGS) * T::EPSILON;
        let least = of(&self.peak) * rounding * rounding;
        (of(&self.noise) / self.runs.max(T::ONE)).max(least)
    }

    /// `-M update = E`, every part divided by its deviation, for noise of `factor` times the variance of one run.
    fn equations(&self, factor: T) -> Result<SquareRoot<T, P>, RunFault> {
        let mut equations = SquareRoot::default();
        let visible = T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE);
        for (coordinate, base) in self.base.iter().enumerate() {
            let variance = self.variance(coordinate);
            let deviation = (variance * factor / T::from_f64(2.0)).sqrt();
            if deviation <= T::ZERO {
                continue;
            }
            for (line, own) in base.iter().enumerate().skip(2).step_by(2) {
                let mut columns = [Phasor::ZERO; P];
                let mut shown = own.square() > visible * variance;
                for ((column, changed), step) in columns.iter_mut().zip(&self.changed).zip(self.steps) {
                    if step.abs() > T::ZERO {
                        let there = changed.get(coordinate).and_then(|lines| lines.get(line)).copied();
                        let apart = there.unwrap_or(*own) - *own;
                        shown |= apart.square() > visible * (variance + variance);
                        *column = apart.times(-(T::ONE / (step * deviation)));
                    }
                }
                if shown {
                    equations
                        .push(columns.map(|column| column.re), own.re / deviation)
                        .map_err(|_| RunFault::Equations)?;
                    equations
                        .push(columns.map(|column| column.im), own.im / deviation)
                        .map_err(|_| RunFault::Equations)?;
                }
            }
        }
        Ok(equations)
    }
}
