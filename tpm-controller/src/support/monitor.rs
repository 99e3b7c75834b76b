//! Whether a machine is still the one whose parameters were identified, block by block of any motion.
//!
//! The rows of a block of samples, less what the identified parameters explain, are a triangular factor R with a right-hand side y: the
//! residual forces are R times the change of the parameters, and noise. For every parameter, w is its column of R without its part along the
//! columns of those that may drift by themselves, so that s = w'y is blind to drifts, and s / w'w is what the block says of the change.
//! The variance of s is measured, not assumed: noise is coloured, and sums over blocks longer than its memory are independent. A run-in
//! gives s^2 / w'w over blocks, without its mean (a change that is there from the beginning is no noise), at its upper limit of 99 %.
//!
//! Sums of log-likelihood ratios with restart at zero (Page, 1954) decide. Where the ratios are right, or too small, the mean time to a false
//! alarm of one sum with threshold h is at least e^h blocks (Lorden, 1971), so that h follows from the false alarms that are allowed.
//! A row is not counted where an entry of it jumps within the noise of what it is a sign of: the dry friction of a joint at rest, or at a
//! reversal, is anything between its limits, and the sign of a measured velocity there is that of noise. Elsewhere the sign is exact.
//! No change is what is within the identified values' own uncertainty and the noise of the motion as it was measured at rest; a change is what
//! was asked for. For a drifting parameter both begin beyond its allowance.
//!
//! Invariant: nothing allocates and nothing indexes, so that no input can make it panic.

use super::{Real, SquareRoot};
use core::fmt;

/// The residual power that counts as unexplained, in that of the run-in.
const GROWTH: f64 = 2.0;

/// The share of all identifications whose errors are larger than is allowed for.
const BEYOND: f64 = 1e-3;

/// Deviations of noise within which the argument of a sign says nothing: normal noise at rest leaves them once in 1.7 million samples.
const STILL: f64 = 5.0;

/// The fewest blocks of a run-in: fewer do not tell a variance.
const FEWEST: u32 = 20;

/// What is watched, and how. `R` equations, `C` base parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonitorRules<T, const R: usize, const C: usize> {
    /// The base parameters of the machine as it was identified.
    pub values: [T; C],
    /// A matrix S with S S^T the covariance of these values, such as the Cholesky factor.
    pub spread: [[T; C]; C],
    /// The change of every base parameter that is to be found, larger than zero, and beyond its drift where it drifts. A block whose
    /// uncertainty looks larger than this says nothing of the parameter.
    pub changes: [T; C],
    /// How far every base parameter may be off by itself, with temperature or wear; zero for one that does not drift.
    pub drifts: [T; C],
    /// Standard deviations of the equations' errors. Only their ratios count, since the run-in measures the noise.
    pub deviations: [T; R],
    /// The time between samples, s.
    pub sample_time: T,
    /// The samples of a block: a few times longer than noise remembers, and than the slowest motion takes.
    pub block: u32,
    /// The blocks of the run-in, at least 20, of the work that will be watched.
    pub run_in: u32,
    /// The false alarms that are allowed per hour.
    pub false_alarms: T,
}

impl<T: Real, const R: usize, const C: usize> MonitorRules<T, R, C> {
    /// Whether a monitor can follow these rules.
    ///
    /// # Errors
    /// [`MonitorFault`], the first of its kind.
    pub fn check(&self) -> Result<(), MonitorFault> {
        let positive = |value: &T| *value > T::ZERO && value.is_finite();
        let allowed = |value: &T| *value >= T::ZERO && value.is_finite();
        let finite = self.values.iter().chain(self.spread.as_flattened()).all(|value| value.is_finite());
        match () {
            () if !finite => Err(MonitorFault::Values),
            () if !self.changes.iter().all(positive) => Err(MonitorFault::Changes),
            () if !self.drifts.iter().all(allowed) => Err(MonitorFault::Drifts),
            () if !self.deviations.iter().all(positive) => Err(MonitorFault::Deviations),
            () if !positive(&self.sample_time) || !positive(&self.false_alarms) => Err(MonitorFault::Times),
            () if (self.block as usize).saturating_mul(R) <= 2 * C || self.run_in < FEWEST => Err(MonitorFault::Blocks),
            () => Ok(()),
        }
    }

    /// The threshold of every sum: all tests together give the allowed false alarms. At least one.
    fn threshold(&self) -> T {
        let blocks = T::from_f64(3600.0) / (self.sample_time * T::from_f64(f64::from(self.block)));
        (T::from_f64((2 * C + 1) as f64) * blocks / self.false_alarms).ln().max(T::ONE)
    }
}

/// Why a monitor cannot follow its rules.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MonitorFault {
    /// An identified value or its spread is not finite.
    Values,
    /// A change that is to be found is not larger than zero.
    Changes,
    /// An allowed drift is negative or not finite.
    Drifts,
    /// The deviation of an equation is not larger than zero.
    Deviations,
    /// The sample time or the false alarms per hour are not larger than zero.
    Times,
    /// A block has no more equations than two per base parameter, or the run-in fewer than 20 blocks.
    Blocks,
}

impl fmt::Display for MonitorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Values => "an identified value or its spread is not finite",
            Self::Changes => "every change that is to be found must be larger than zero",
            Self::Drifts => "an allowed drift must be zero or larger",
            Self::Deviations => "the deviation of every equation must be larger than zero",
            Self::Times => "the sample time and the false alarms per hour must be larger than zero",
            Self::Blocks => {
                "a block needs more equations than two per base parameter, and the run-in at least 20 blocks"
            }
        })
    }
}

impl core::error::Error for MonitorFault {}

/// What a monitor says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MonitorState<T> {
    /// Some parameter, or the power of what is left, still waits for blocks of its run-in; the others are watched.
    RunIn,
    /// The machine is watched: the number of parameters of which the last block could show the change that is to be found; 0 when it stood still.
    Watching(usize),
    /// This sample is left out: an input was at its limit, or a number is not finite.
    LeftOut,
    /// A parameter has moved; the monitor says so until it is begun again.
    Moved(Moved<T>),
    /// The power of what no parameters explain, in that of the run-in; the monitor says so until it is begun again.
    Unexplained(T),
}

/// A parameter that has moved beyond chance and drift. Where others have moved too, this one shows it best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved<T> {
    /// Which base parameter.
    pub parameter: usize,
    /// By how much, as if it alone had moved: the mean over the blocks since the sum was zero.
    pub change: T,
    /// The standard deviation of that, of noise alone.
    pub deviation: T,
}

/// The evidence for a change in one direction since it was last zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Evidence<T> {
    ratio: T,
    score: T,
    information: T,
}

/// What the run-in showed of a parameter, and the evidence that it has grown or shrunk.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Watched<T> {
    blocks: u32,
    score: T,
    information: T,
    squares: T,
    sides: [Evidence<T>; 2],
}

/// The arguments of the signs in the rows of a regressor, `S` per row and 1 where a row has fewer, and which entries depend on one.
#[derive(Clone, Copy, Debug)]
pub struct MonitorJumps<'a, T, const R: usize, const C: usize, const S: usize> {
    /// The arguments along the motion of one instant.
    pub arguments: [[T; S]; R],
    /// Whether an entry of the regressor depends on a sign.
    pub entries: &'a [[bool; C]; R],
}

/// What blocks of samples say of a machine, in memory that does not grow with them. `S` signs in a row at most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitoring<T, const R: usize, const C: usize, const S: usize> {
    /// Samples of the block so far, how many of them were taken in, and with how many equations.
    samples: u32,
    taken: u32,
    equations: u32,
    /// Means of the arguments of signs at rest, and sums of the squares of what is left of them.
    level: [[T; S]; R],
    wander: [[T; S]; R],
    /// Means of the entries of the regressor at rest, and sums of the products of what is left of two columns.
    mean: [[T; C]; R],
    products: [[T; C]; C],
    rests: T,
    parameters: [Watched<T>; C],
    /// Run-in and evidence of what is left: blocks, sum, squares and ratio.
    blocks: u32,
    left: T,
    squares: T,
    ratio: T,
    state: MonitorState<T>,
}

impl<T: Real, const R: usize, const C: usize, const S: usize> Default for Monitoring<T, R, C, S> {
    fn default() -> Self {
        Self {
            samples: 0,
            taken: 0,
            equations: 0,
            level: [[T::ZERO; S]; R],
            wander: [[T::ZERO; S]; R],
            mean: [[T::ZERO; C]; R],
            products: [[T::ZERO; C]; C],
            rests: T::ZERO,
            parameters: [Watched::default(); C],
            blocks: 0,
            left: T::ZERO,
            squares: T::ZERO,
            ratio: T::ZERO,
            state: MonitorState::RunIn,
        }
    }
}

impl<T: Real, const R: usize, const C: usize, const S: usize> Monitoring<T, R, C, S> {
    /// Takes in the regressor of a sample while the machine stands still: what varies then is noise of the motion.
    pub fn rest(
        &mut self,
        rules: &MonitorRules<T, R, C>,
        mut regressor: [[T; C]; R],
        jumps: &MonitorJumps<'_, T, R, C, S>,
    ) {
        let arguments = jumps.arguments.as_flattened();
        if !regressor.as_flattened().iter().chain(arguments).all(|entry| entry.is_finite()) {
            return;
        }
        self.rests += T::ONE;
        let levels = self.level.as_flattened_mut().iter_mut().zip(self.wander.as_flattened_mut());
        for ((level, wander), &argument) in levels.zip(arguments) {
            let before = argument - *level;
            *level += before / self.rests;
            *wander += before * (argument - *level);
        }
        // A row is counted where its signs are exact: what else there is in the entry is its noise then.
        let entries = regressor.as_flattened_mut().iter_mut().zip(jumps.entries.as_flattened());
        entries.filter(|(_, jumps)| **jumps).for_each(|(entry, _)| *entry = entry.abs());
        for ((means, row), &deviation) in self.mean.iter_mut().zip(&regressor).zip(&rules.deviations) {
            let (mut before, mut after) = (*row, *row);
            for ((mean, before), after) in means.iter_mut().zip(&mut before).zip(&mut after) {
                let entry = *before / deviation;
                *before = entry - *mean;
                *mean += *before / self.rests;
                *after = entry - *mean;
            }
            for (products, &before) in self.products.iter_mut().zip(&before) {
                products.iter_mut().zip(&after).for_each(|(product, &after)| *product += before * after);
            }
        }
    }

    /// The deviations of the equations of a sample: infinite where a sign in the equation is that of noise.
    #[must_use]
    pub fn deviations(&self, rules: &MonitorRules<T, R, C>, jumps: &MonitorJumps<'_, T, R, C, S>) -> [T; R] {
        let mut deviations = rules.deviations;
        let share = T::from_f64(STILL * STILL) / (self.rests - T::ONE).max(T::ONE);
        for ((deviation, arguments), wander) in deviations.iter_mut().zip(&jumps.arguments).zip(&self.wander) {
            if arguments.iter().zip(wander).any(|(&argument, &wander)| argument * argument <= wander * share) {
                *deviation = T::from_f64(f64::INFINITY);
            }
        }
        deviations
    }

    /// Counts a sample, which was taken in with the equations of finite deviations or not at all, and says whether its block is over.
    pub fn counts(&mut self, rules: &MonitorRules<T, R, C>, deviations: Option<&[T; R]>) -> bool {
        self.samples += 1;
        for &deviation in deviations.into_iter().flatten() {
            self.equations += u32::from(deviation.is_finite());
        }
        self.taken += u32::from(deviations.is_some());
        self.samples >= rules.block
    }

    /// What there is to say after the samples so far.
    #[must_use]
    pub fn state(&self) -> MonitorState<T> {
        self.state
    }

    /// Forgets evidence and alarm, and keeps what was measured at rest and in the run-in.
    pub fn again(&mut self) {
        self.parameters.iter_mut().for_each(|one| one.sides = [Evidence::default(); 2]);
        self.ratio = T::ZERO;
        self.state = MonitorState::RunIn;
    }

    /// Judges a block that is over, and begins the next.
    pub fn judge(&mut self, rules: &MonitorRules<T, R, C>, rows: &SquareRoot<T, C>) {
        let samples = T::from_f64(f64::from(self.taken));
        let equations = T::from_f64(f64::from(self.equations));
        let enough = self.equations as usize > 2 * C;
        (self.samples, self.taken, self.equations) = (0, 0, 0);
        if !enough || matches!(self.state, MonitorState::Moved(_) | MonitorState::Unexplained(_)) {
            return;
        }
        let threshold = rules.threshold();
        let mut block = Block::new(*rows, rules);
        let rest = samples / self.rests.max(T::ONE);
        for (noise, products) in block.noise.iter_mut().zip(&self.products) {
            let sizes = products.iter().zip(&rules.values).map(|(&product, &value)| (product * value).abs());
            *noise = rest * sizes.fold(T::ZERO, |sum, size| sum + size);
        }
        let (mut testable, mut waits, mut best) = (0, false, None);
        let mut most = T::ZERO;
        let watched = self.parameters.iter_mut().zip(&rules.changes).zip(&rules.drifts);
        for (index, ((one, &change), &drift)) in watched.enumerate() {
            let ready = one.blocks >= rules.run_in;
            waits |= !ready;
            let Some(shown) = block.shown(rules, index) else { continue };
            if shown.noise >= change * T::from_f64(0.5) {
                continue;
            }
            testable += 1;
            if !ready {
                one.blocks += 1;
                one.score += shown.score;
                one.information += shown.information;
                one.squares += shown.score * shown.score / shown.information;
                continue;
            }
            let blocks = f64::from(one.blocks - 1);
            let mean = one.score * one.score / one.information;
            let variance = (one.squares - mean) / T::from_f64(blocks) * T::from_f64(upper(blocks));
            let variance = variance.max(block.rounding * block.rounding);
            let (score, information) = (shown.score / variance, shown.information / variance);
            // From what is no change to the one that is to be found.
            let gap = change - shown.blind;
            if gap <= T::ZERO {
                continue;
            }
            let middle = drift + (shown.blind + change) * T::from_f64(0.5);
            for (side, sign) in one.sides.iter_mut().zip([T::ONE, -T::ONE]) {
                let step = gap * (sign * score - information * middle);
                if side.step(step, threshold) {
                    side.score += score;
                    side.information += information;
                    let found = side.score * side.score / side.information;
                    if side.ratio > threshold && found > most {
                        most = found;
                        let (change, deviation) = (side.score / side.information, T::ONE / side.information.sqrt());
                        best = Some(Moved { parameter: index, change, deviation });
                    }
                }
            }
        }
        let unexplained = self.unexplained(rules, &block, equations, threshold);
        waits |= self.blocks < rules.run_in;
        self.state = match (best, unexplained) {
            (Some(moved), _) => MonitorState::Moved(moved),
            (None, Some(power)) => MonitorState::Unexplained(power),
            (None, None) if waits => MonitorState::RunIn,
            (None, None) => MonitorState::Watching(testable),
        };
    }

    /// The power that no parameters explain, in that of the run-in, once it has grown: a sum of ratios of gamma densities, whose shape and
    /// mean the run-in measured.
    fn unexplained(
        &mut self,
        rules: &MonitorRules<T, R, C>,
        block: &Block<T, C>,
        equations: T,
        threshold: T,
    ) -> Option<T> {
        let free = equations - T::from_f64(C as f64);
        let power = block.residual * block.residual / free;
        if self.blocks < rules.run_in {
            self.blocks += 1;
            self.left += power;
            self.squares += power * power;
            return None;
        }
        let blocks = T::from_f64(f64::from(self.blocks));
        let mean = self.left / blocks;
        let variance =
            (self.squares / blocks - mean * mean).max(T::ZERO) * T::from_f64(upper(f64::from(self.blocks - 1)));
        // White noise has the largest shape there is.
        let shape = (mean * mean / variance.max(T::EPSILON * mean * mean)).min(free * T::from_f64(0.5));
        let usual =
            mean * (T::ONE + T::from_f64(3.0) / (shape * blocks).sqrt()) + block.rounding * block.rounding / free;
        let growth = T::from_f64(GROWTH);
        let step = shape * (power / usual * (T::ONE - T::ONE / growth) - growth.ln());
        let mut side = Evidence { ratio: self.ratio, ..Evidence::default() };
        side.step(step, threshold);
        self.ratio = side.ratio;
        (self.ratio > threshold).then(|| power / usual)
    }
}

impl<T: Real> Evidence<T> {
    /// Adds a log-likelihood ratio, of which one block never gives more than three tenths of an alarm; whether anything is left.
    fn step(&mut self, step: T, threshold: T) -> bool {
        if !step.is_finite() {
            return false;
        }
        self.ratio += step.min(threshold * T::from_f64(0.3));
        if self.ratio > T::ZERO {
            return true;
        }
        *self = Self::default();
        false
    }
}

/// The factor from a variance of so many degrees of freedom to its upper limit of 99 % (Wilson and Hilferty, 1931).
fn upper(freedom: f64) -> f64 {
    let part = 2.0 / (9.0 * freedom);
    let root = 1.0 - part - 2.326_348 * Real::sqrt(part);
    1.0 / (root * root * root)
}

/// A block of samples: the columns of its factor, and what is left of the right-hand side.
struct Block<T, const C: usize> {
    columns: [[T; C]; C],
    right: [T; C],
    residual: T,
    /// Euclidean length of what rounding leaves of the right-hand side.
    rounding: T,
    /// The smallest share of a column that is more than rounding.
    tiny: T,
    /// Sums of the products of every column's noise with that of the forces that the values explain.
    noise: [T; C],
}

/// What a block shows of the change of a parameter.
struct Shown<T> {
    score: T,
    information: T,
    /// How large a change the noise of the motion looks like.
    noise: T,
    /// How large a change that and the uncertainty of the identified values look like.
    blind: T,
}

/// A combination of columns, with the weights of the columns in it.
#[derive(Clone, Copy)]
struct Direction<T, const C: usize> {
    values: [T; C],
    weights: [T; C],
}

impl<T: Real, const C: usize> Block<T, C> {
    fn new<const R: usize>(mut rows: SquareRoot<T, C>, rules: &MonitorRules<T, R, C>) -> Self {
        let tiny = T::EPSILON * T::from_f64(4.0) * (T::from_f64(C as f64) + rows.rows().sqrt());
        let mut right = rows.right_side();
        let rounding = dot(&right, &right).sqrt() * tiny;
        rows.move_by(&rules.values);
        right = rows.right_side();
        let mut columns = [[T::ZERO; C]; C];
        for (place, (row, _)) in rows.equations().enumerate() {
            for (column, &entry) in columns.iter_mut().zip(row) {
                column.iter_mut().skip(place).take(1).for_each(|slot| *slot = entry);
            }
        }
        Self { columns, right, residual: rows.residual(), rounding, tiny, noise: [T::ZERO; C] }
    }

    /// What the block shows of a parameter; nothing where its column is zero or a combination of those that drift.
    fn shown<const R: usize>(&self, rules: &MonitorRules<T, R, C>, index: usize) -> Option<Shown<T>> {
        let nothing = Direction { values: [T::ZERO; C], weights: [T::ZERO; C] };
        let mut basis = [nothing; C];
        let mut count = 0;
        for (other, &drift) in rules.drifts.iter().enumerate() {
            if drift <= T::ZERO || other == index {
                continue;
            }
            let Some(own) = self.beside(other, &basis, count) else { continue };
            let length = dot(&own.values, &own.values).sqrt();
            basis.iter_mut().skip(count).take(1).for_each(|slot| {
                *slot = Direction {
                    values: own.values.map(|value| value / length),
                    weights: own.weights.map(|weight| weight / length),
                };
            });
            count += 1;
        }
        let own = self.beside(index, &basis, count)?;
        let information = dot(&own.values, &own.values);
        // How an error of every identified value looks like a change of this one.
        let share = self.columns.map(|column| dot(&own.values, &column) / information);
        let mut variance = T::ZERO;
        for place in 0..C {
            let mut sum = T::ZERO;
            for (row, &share) in rules.spread.iter().zip(&share) {
                row.iter().skip(place).take(1).for_each(|&entry| sum += share * entry);
            }
            variance += sum * sum;
        }
        // Noise of the motion that stands in the direction and in what the values explain gives products that no mean takes away.
        let lost = self.noise.iter().zip(&own.weights).map(|(&noise, &weight)| noise * weight.abs());
        let noise = lost.fold(T::ZERO, |sum, lost| sum + lost) / information;
        // The tail of a normal deviate beyond d is at most exp(-d^2/2), for all parameters together.
        let bound = T::from_f64(2.0 * C as f64 / BEYOND).ln() * T::from_f64(2.0);
        Some(Shown {
            score: dot(&own.values, &self.right),
            information,
            noise,
            blind: (bound * variance).sqrt() + noise,
        })
    }

    /// A column without its part along the first directions of an orthonormal basis; nothing where no more than rounding is left.
    fn beside(&self, index: usize, basis: &[Direction<T, C>; C], count: usize) -> Option<Direction<T, C>> {
        let mut own = Direction { values: *self.columns.get(index)?, weights: [T::ZERO; C] };
        own.weights.iter_mut().skip(index).take(1).for_each(|weight| *weight = T::ONE);
        let before = dot(&own.values, &own.values);
        for other in basis.iter().take(count) {
            let along = dot(&own.values, &other.values);
            own.values.iter_mut().zip(&other.values).for_each(|(value, &other)| *value -= along * other);
            own.weights.iter_mut().zip(&other.weights).for_each(|(weight, &other)| *weight -= along * other);
        }
        (dot(&own.values, &own.values) > before * self.tiny * self.tiny * T::from_f64(16.0)).then_some(own)
    }
}

fn dot<T: Real, const C: usize>(a: &[T; C], b: &[T; C]) -> T {
    a.iter().zip(b).fold(T::ZERO, |sum, (&a, &b)| sum + a * b)
}
