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

use super::{Phasor, Real, RunEstimate, RunFault, RunLines, RunReference, SquareRoot};

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
    /// The runs behind each of them.
    differences: [RunDifference<T>; P],
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

/// By how much a parameter was changed in the first and in the second of its runs; zero where the run has not been played.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RunDifference<T> {
    first: T,
    second: T,
}

impl<T: Real> RunDifference<T> {
    /// Before any run.
    const NONE: Self = Self { first: T::ZERO, second: T::ZERO };

    /// With another run: with the opposite direction it completes the first one, otherwise it takes its place.
    fn with(self, step: T) -> Self {
        let opposite = self.is_any() && (self.first < T::ZERO) != (step < T::ZERO);
        if opposite && !self.is_both() { Self { second: step, ..self } } else { Self { first: step, second: T::ZERO } }
    }

    /// Whether any run has been played.
    fn is_any(self) -> bool {
        self.first.abs() > T::ZERO
    }

    /// Whether runs in both directions have been played.
    fn is_both(self) -> bool {
        self.second.abs() > T::ZERO
    }

    /// The weights of the base run and of the two others in the slope at the base: of the line through two errors, or of the parabola
    /// through three. Their sum is zero.
    fn weights(self) -> [T; 3] {
        let Self { first, second } = self;
        if !self.is_any() {
            return [T::ZERO; 3];
        }
        if !self.is_both() {
            let weight = T::ONE / first;
            return [-weight, weight, T::ZERO];
        }
        let of = |own: T, other: T| other / (own * (other - own));
        let (first, second) = (of(first, second), of(second, first));
        [-(first + second), first, second]
    }
}

impl<T: Real, const Q: usize, const P: usize, const L: usize> Default for RunNumerical<T, Q, P, L> {
    fn default() -> Self {
        Self {
            base: [[Phasor::ZERO; L]; Q],
            slopes: [[[Phasor::ZERO; L]; Q]; P],
            differences: [RunDifference::NONE; P],
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
        let (lines, reference) = (run.lines()?, reference.lines(run.samples_per_period())?);
        if parameter >= P || self.samples[0] == 0 || !step.is_finite() || step.abs() <= T::ZERO {
            return Err(RunFault::Perturbation);
        }
        if self.samples != [run.samples(), run.samples_per_period()] {
            return Err(RunFault::Samples);
        }
        let changed = self.take(&lines, reference);
        for ((slope, runs), number) in self.slopes.iter_mut().zip(&mut self.differences).zip(0..) {
            if parameter != number {
                continue;
            }
            *runs = runs.with(step);
            // The slope of the first run alone is that of a line through it.
            let [_, first, second] = runs.weights();
            let (kept, own) = if runs.is_both() { (first * runs.first, second) } else { (T::ZERO, first) };
            for (slope, (changed, base)) in
                slope.iter_mut().flatten().zip(changed.iter().zip(&self.base).flat_map(pairs))
            {
                *slope = slope.times(kept) + (*changed - *base).times(own);
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
        if !self.differences.iter().any(|runs| runs.is_any()) {
            return Err(RunFault::Unfinished { samples: self.samples[0] });
        }
        if !played.iter().all(|value| value.is_finite()) {
            return Err(RunFault::Equations);
        }
        let first = self.equations(T::ONE)?.solution();
        let (mut base, mut squares) = (T::ONE, T::ZERO);
        for (update, runs) in first.solution.iter().zip(self.differences) {
            let update = update.unwrap_or(T::ZERO);
            let [own, first, second] = runs.weights().map(|weight| update * weight);
            base += own;
            squares += first * first + second * second;
        }
        // An update by the whole step needs the changed run alone.
        let factor = base * base + squares;
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
                for ((column, slopes), runs) in columns.iter_mut().zip(&self.slopes).zip(self.differences) {
                    if runs.is_any() {
                        let slope = slopes.get(coordinate).and_then(|lines| lines.get(line)).copied();
                        let slope = slope.unwrap_or(Phasor::ZERO);
                        let [base, first, second] = runs.weights();
                        let noise = variance * (base * base + first * first + second * second);
                        shown |= slope.square() > visible * noise;
                        *column = slope.times(-(T::ONE / deviation));
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

/// The lines of one coordinate in two runs, side by side.
fn pairs<'l, T, const L: usize>(
    (a, b): (&'l [Phasor<T>; L], &'l [Phasor<T>; L]),
) -> impl Iterator<Item = (&'l Phasor<T>, &'l Phasor<T>)> {
    a.iter().zip(b)
}
