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
//! Invariants: nothing allocates, and indices are below the lengths of the arrays that they index, so that no input can make it panic.

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

/// A run-in is of one kind where no block has this share of what all show: with noise alone, one of twenty blocks has it once in a thousand
/// run-ins, which then takes as long again.
const ONE_KIND: f64 = 0.5;

/// The share of an alarm that one block gives at most.
const MOST_STEP: f64 = 0.3;

/// The quantile of a normal deviate for an upper limit of 99 %.
const QUANTILE: f64 = 2.326_348;

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
        for i in 0..C {
            if !self.values[i].is_finite() {
                return Err(MonitorFault::Values);
            }
            for j in 0..C {
                if !self.spread[i][j].is_finite() {
                    return Err(MonitorFault::Values);
                }
            }
            if !is_positive(self.changes[i]) {
                return Err(MonitorFault::Changes);
            }
            if self.drifts[i] < T::ZERO || !self.drifts[i].is_finite() {
                return Err(MonitorFault::Drifts);
            }
        }
        for row in 0..R {
            if !is_positive(self.deviations[row]) {
                return Err(MonitorFault::Deviations);
            }
        }
        if !is_positive(self.sample_time) || !is_positive(self.false_alarms) {
            return Err(MonitorFault::Times);
        }
        let fewest = 2 * C;
        if T::from_f64(f64::from(self.block)) * T::from_f64(R as f64) <= T::from_f64(fewest as f64)
            || self.run_in < FEWEST
        {
            return Err(MonitorFault::Blocks);
        }
        Ok(())
    }

    /// The threshold of every sum: all tests together give the allowed false alarms. At least one.
    fn threshold(&self) -> T {
        let blocks = T::from_f64(3600.0) / (self.sample_time * T::from_f64(f64::from(self.block)));
        let sums = 2 * C + 1;
        let tests = T::from_f64(sums as f64);
        (tests * blocks / self.false_alarms).ln().max(T::ONE)
    }
}

/// Whether a number is finite and larger than zero.
fn is_positive<T: Real>(value: T) -> bool {
    value > T::ZERO && value.is_finite()
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

/// What a monitor says, without numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MonitorPhase {
    /// Some parameter, or the power of what is left, still waits for blocks of its run-in; the others are watched.
    RunIn,
    /// The machine is watched; `testable` says of how many parameters the last block could show the change, 0 when it stood still.
    Watching,
    /// This sample is left out: it is missing, an input was at its limit, or a number is not finite.
    LeftOut,
    /// The parameter `moved` has moved by `change`, whose deviation from noise is `deviation`; so until the monitor begins again.
    Moved,
    /// The power that no parameters explain is `growth` times that of the run-in; so until the monitor begins again.
    Unexplained,
}

/// The evidence for a change in one direction since it was last zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Evidence<T> {
    ratio: T,
    score: T,
    information: T,
}

impl<T: Real> Evidence<T> {
    fn clear(&mut self) {
        self.ratio = T::ZERO;
        self.score = T::ZERO;
        self.information = T::ZERO;
    }

    /// Adds a log-likelihood ratio, of which one block never gives more than a share of an alarm; whether anything is left.
    fn add_ratio(&mut self, step: T, threshold: T) -> bool {
        if !step.is_finite() {
            return false;
        }
        self.ratio += step.min(threshold * T::from_f64(MOST_STEP));
        if self.ratio > T::ZERO {
            return true;
        }
        self.clear();
        false
    }
}

/// What the run-in showed of a parameter, and the evidence that it has grown or shrunk.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Watched<T> {
    blocks: u32,
    score: T,
    information: T,
    squares: T,
    /// The largest square so far.
    largest: T,
    sides: [Evidence<T>; 2],
}

impl<T: Real> Watched<T> {
    fn clear(&mut self) {
        self.blocks = 0;
        self.score = T::ZERO;
        self.information = T::ZERO;
        self.squares = T::ZERO;
        self.largest = T::ZERO;
        self.sides[0].clear();
        self.sides[1].clear();
    }

    /// Takes in a block of the run-in, which begins again where its blocks were not of one kind.
    fn run_in(&mut self, score: T, information: T, blocks: u32) {
        let square = score * score / information;
        self.blocks += 1;
        self.score += score;
        self.information += information;
        self.squares += square;
        self.largest = self.largest.max(square);
        if self.blocks >= blocks && self.largest > T::from_f64(ONE_KIND) * self.squares {
            self.clear();
        }
    }
}

/// The watch over a machine, in memory that does not grow with the samples: R rows, C base parameters, S signs in a row at most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitoring<T, const R: usize, const C: usize, const S: usize> {
    /// What is watched, and how.
    pub rules: MonitorRules<T, R, C>,
    /// What there is to say after the samples so far.
    pub(super) state: MonitorPhase,
    /// The base parameter that has moved, by how much as if it alone had, and the deviation of that.
    moved: usize,
    change: T,
    deviation: T,
    /// The unexplained power of the last block, in that of the run-in.
    growth: T,
    /// The parameters of which the last block could show the change that is to be found.
    testable: usize,
    /// The block so far: its rows, its samples, how many of them were taken in, and with how many equations.
    pub block: SquareRoot<T, C>,
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
    /// Run-in and evidence of what is left: blocks, sum, squares, the largest one, and ratio.
    blocks: u32,
    left: T,
    squares: T,
    largest: T,
    unexplained: Evidence<T>,
    /// Memory of a judgement: the right-hand side less what the values explain, the noise of every column times that of the forces that the
    /// values explain, an orthonormal basis of the drifting columns with the weights of the columns in it, and a direction beside it.
    right: [T; C],
    noise: [T; C],
    basis: [[T; C]; C],
    basis_weights: [[T; C]; C],
    own: [T; C],
    weights: [T; C],
    /// What a block shows of the change of a parameter: how large a change the noise of the motion looks like, and how large a one that and
    /// the uncertainty of the identified values.
    score: T,
    information: T,
    noisy: T,
    blind: T,
}

impl<T: Real, const R: usize, const C: usize, const S: usize> Monitoring<T, R, C, S> {
    /// A watch by these rules, before its run-in.
    #[must_use]
    pub fn new(rules: &MonitorRules<T, R, C>) -> Self {
        let (vector, matrix) = ([T::ZERO; C], [[T::ZERO; C]; C]);
        Self {
            rules: *rules,
            state: MonitorPhase::RunIn,
            moved: 0,
            change: T::ZERO,
            deviation: T::ZERO,
            growth: T::ZERO,
            testable: 0,
            block: SquareRoot::default(),
            samples: 0,
            taken: 0,
            equations: 0,
            level: [[T::ZERO; S]; R],
            wander: [[T::ZERO; S]; R],
            mean: [[T::ZERO; C]; R],
            products: matrix,
            rests: T::ZERO,
            parameters: [Watched::default(); C],
            blocks: 0,
            left: T::ZERO,
            squares: T::ZERO,
            largest: T::ZERO,
            unexplained: Evidence::default(),
            right: vector,
            noise: vector,
            basis: matrix,
            basis_weights: matrix,
            own: vector,
            weights: vector,
            score: T::ZERO,
            information: T::ZERO,
            noisy: T::ZERO,
            blind: T::ZERO,
        }
    }

    /// Begins a watch by these rules.
    ///
    /// # Errors
    /// [`MonitorFault`] when they cannot be followed; the watch must not be used then.
    pub fn begin(&mut self, rules: &MonitorRules<T, R, C>) -> Result<(), MonitorFault> {
        rules.check()?;
        self.rules = *rules;
        self.block.clear();
        self.samples = 0;
        self.taken = 0;
        self.equations = 0;
        self.level = [[T::ZERO; S]; R];
        self.wander = [[T::ZERO; S]; R];
        self.mean = [[T::ZERO; C]; R];
        self.products = [[T::ZERO; C]; C];
        self.rests = T::ZERO;
        for j in 0..C {
            self.parameters[j].clear();
        }
        self.blocks = 0;
        self.left = T::ZERO;
        self.squares = T::ZERO;
        self.largest = T::ZERO;
        self.moved = 0;
        self.change = T::ZERO;
        self.deviation = T::ZERO;
        self.growth = T::ZERO;
        self.testable = 0;
        self.again();
        Ok(())
    }

    /// Takes in the regressor of a sample, which is destroyed, and the arguments of the signs in its rows, 1 where a row has fewer, while
    /// the machine stands still: what varies then is noise of the motion. `jumping` says which entries depend on a sign; a row is counted
    /// where its signs are exact, so that what else there is in such an entry is its noise then.
    pub fn rest(&mut self, regressor: &mut [[T; C]; R], arguments: &[[T; S]; R], jumping: &[[bool; C]; R]) {
        for row in 0..R {
            for j in 0..C {
                if !regressor[row][j].is_finite() {
                    return;
                }
            }
            for i in 0..S {
                if !arguments[row][i].is_finite() {
                    return;
                }
            }
        }
        self.rests += T::ONE;
        for row in 0..R {
            for i in 0..S {
                let off = arguments[row][i] - self.level[row][i];
                self.level[row][i] += off / self.rests;
                self.wander[row][i] += off * (arguments[row][i] - self.level[row][i]);
            }
            let mut before = [T::ZERO; C];
            let mut after = [T::ZERO; C];
            for j in 0..C {
                let size = if jumping[row][j] { regressor[row][j].abs() } else { regressor[row][j] };
                let entry = size / self.rules.deviations[row];
                before[j] = entry - self.mean[row][j];
                self.mean[row][j] += before[j] / self.rests;
                after[j] = entry - self.mean[row][j];
            }
            for j in 0..C {
                for k in 0..C {
                    self.products[j][k] += before[j] * after[k];
                }
            }
        }
    }

    /// Whether a sign of an equation is that of noise: dry friction at rest, or at a reversal, is anything between its limits. Such an
    /// equation is left out.
    #[must_use]
    pub fn is_still(&self, row: usize, arguments: &[[T; S]; R]) -> bool {
        let share = T::from_f64(STILL * STILL) / (self.rests - T::ONE).max(T::ONE);
        for i in 0..S {
            if arguments[row][i] * arguments[row][i] <= self.wander[row][i] * share {
                return true;
            }
        }
        false
    }

    /// Counts a sample, which was taken into the block with so many equations or not at all, and judges the block where it is over.
    pub fn count(&mut self, taken: bool, equations: u32) -> MonitorPhase {
        let alarmed = self.state == MonitorPhase::Moved || self.state == MonitorPhase::Unexplained;
        self.samples += 1;
        if taken {
            self.taken += 1;
            self.equations += equations;
        }
        if self.samples >= self.rules.block {
            if !alarmed && self.equations as usize > 2 * C {
                self.judge();
            }
            self.block.clear();
            self.samples = 0;
            self.taken = 0;
            self.equations = 0;
        }
        let quiet = self.state == MonitorPhase::RunIn || self.state == MonitorPhase::Watching;
        if !taken && quiet { MonitorPhase::LeftOut } else { self.state }
    }

    /// What there is to say after the samples so far.
    #[must_use]
    pub fn state(&self) -> MonitorState<T> {
        match self.state {
            MonitorPhase::RunIn => MonitorState::RunIn,
            MonitorPhase::Watching => MonitorState::Watching(self.testable),
            MonitorPhase::LeftOut => MonitorState::LeftOut,
            MonitorPhase::Moved => {
                MonitorState::Moved(Moved { parameter: self.moved, change: self.change, deviation: self.deviation })
            }
            MonitorPhase::Unexplained => MonitorState::Unexplained(self.growth),
        }
    }

    /// Forgets evidence and alarm, and keeps what was measured at rest and in the run-in.
    pub fn again(&mut self) {
        for j in 0..C {
            self.parameters[j].sides[0].clear();
            self.parameters[j].sides[1].clear();
        }
        self.unexplained.clear();
        self.state = MonitorPhase::RunIn;
    }

    /// Judges a block that is over.
    fn judge(&mut self) {
        let tiny = T::EPSILON * T::from_f64(4.0) * (T::from_f64(C as f64) + self.block.rows.sqrt());
        let rest = T::from_f64(f64::from(self.taken)) / self.rests.max(T::ONE);
        let threshold = self.rules.threshold();
        let mut rounding = T::ZERO;
        for i in 0..C {
            let mut left = self.block.right[i];
            rounding += left * left;
            self.noise[i] = T::ZERO;
            for j in 0..C {
                left -= self.block.factor[i][j] * self.rules.values[j];
                self.noise[i] += rest * (self.products[i][j] * self.rules.values[j]).abs();
            }
            self.right[i] = left;
        }
        rounding = rounding.sqrt() * tiny;
        self.testable = 0;
        let mut waits = false;
        let mut moved = false;
        let mut most = T::ZERO;
        for j in 0..C {
            let ready = self.parameters[j].blocks >= self.rules.run_in;
            let change = self.rules.changes[j];
            waits |= !ready;
            if !self.show(j, tiny) || self.noisy >= change * T::from_f64(0.5) {
                continue;
            }
            self.testable += 1;
            if !ready {
                self.parameters[j].run_in(self.score, self.information, self.rules.run_in);
                continue;
            }
            let variance = self.variance(j).max(rounding * rounding);
            let score = self.score / variance;
            let information = self.information / variance;
            // From what is no change to the one that is to be found.
            let gap = change - self.blind;
            if gap <= T::ZERO {
                continue;
            }
            let middle = self.rules.drifts[j] + (self.blind + change) * T::from_f64(0.5);
            for side in 0..2 {
                let towards = if side == 0 { score } else { -score };
                if !self.parameters[j].sides[side].add_ratio(gap * (towards - information * middle), threshold) {
                    continue;
                }
                self.parameters[j].sides[side].score += score;
                self.parameters[j].sides[side].information += information;
                let all = self.parameters[j].sides[side].information;
                let found = self.parameters[j].sides[side].score / all;
                if self.parameters[j].sides[side].ratio > threshold && found * found * all > most {
                    most = found * found * all;
                    moved = true;
                    self.moved = j;
                    self.change = found;
                    self.deviation = T::ONE / all.sqrt();
                }
            }
        }
        let unexplained = self.is_unexplained(rounding, threshold);
        waits |= self.blocks < self.rules.run_in;
        self.state = if waits { MonitorPhase::RunIn } else { MonitorPhase::Watching };
        if unexplained {
            self.state = MonitorPhase::Unexplained;
        }
        if moved {
            self.state = MonitorPhase::Moved;
        }
    }

    /// The variance of the score of a parameter over its information, at the upper limit of the run-in's, without the run-in's mean.
    fn variance(&self, j: usize) -> T {
        let others = self.parameters[j].blocks - 1;
        let freedom = T::from_f64(f64::from(others));
        let mean = self.parameters[j].score * self.parameters[j].score / self.parameters[j].information;
        (self.parameters[j].squares - mean) / freedom * upper(freedom)
    }

    /// Adds the power that no parameters explain to its evidence, a sum of ratios of gamma densities whose shape and mean the run-in measured;
    /// says whether it has grown.
    fn is_unexplained(&mut self, rounding: T, threshold: T) -> bool {
        let free = T::from_f64(f64::from(self.equations)) - T::from_f64(C as f64);
        let power = self.block.residual * self.block.residual / free;
        if self.blocks < self.rules.run_in {
            self.blocks += 1;
            self.left += power;
            self.squares += power * power;
            self.largest = self.largest.max(power);
            if self.blocks >= self.rules.run_in && self.largest > T::from_f64(ONE_KIND) * self.left {
                self.blocks = 0;
                self.left = T::ZERO;
                self.squares = T::ZERO;
                self.largest = T::ZERO;
            }
            return false;
        }
        let blocks = T::from_f64(f64::from(self.blocks));
        let mean = self.left / blocks;
        let variance = (self.squares / blocks - mean * mean).max(T::ZERO) * upper(blocks - T::ONE);
        // White noise has the largest shape there is.
        let shape = (mean * mean / variance.max(T::EPSILON * mean * mean)).min(free * T::from_f64(0.5));
        let beyond = T::ONE + T::from_f64(3.0) / (shape * blocks).sqrt();
        let usual = mean * beyond + rounding * rounding / free;
        let growth = T::from_f64(GROWTH);
        let step = shape * (power / usual * (T::ONE - T::ONE / growth) - growth.ln());
        let _ = self.unexplained.add_ratio(step, threshold);
        self.growth = power / usual;
        self.unexplained.ratio > threshold
    }

    /// Finds what the block shows of a parameter; false where its column is zero or a combination of those that drift.
    fn show(&mut self, index: usize, tiny: T) -> bool {
        let mut count = 0;
        for j in 0..C {
            if self.rules.drifts[j] > T::ZERO && j != index && self.beside(j, count, tiny) {
                let length = dot(&self.own, &self.own).sqrt();
                for i in 0..C {
                    self.basis[count][i] = self.own[i] / length;
                    self.basis_weights[count][i] = self.weights[i] / length;
                }
                count += 1;
            }
        }
        if !self.beside(index, count, tiny) {
            return false;
        }
        self.score = dot(&self.own, &self.right);
        self.information = dot(&self.own, &self.own);
        // How an error of every identified value looks like a change of this one.
        let mut shares = [T::ZERO; C];
        for j in 0..C {
            for i in 0..C {
                shares[j] += self.own[i] * self.block.factor[i][j];
            }
            shares[j] /= self.information;
        }
        // Noise of the motion that stands in the direction and in what the values explain gives products that no mean takes away.
        let mut variance = T::ZERO;
        let mut lost = T::ZERO;
        for j in 0..C {
            let mut sum = T::ZERO;
            for i in 0..C {
                sum += shares[i] * self.rules.spread[i][j];
            }
            variance += sum * sum;
            lost += self.noise[j] * self.weights[j].abs();
        }
        self.noisy = lost / self.information;
        // The tail of a normal deviate beyond d is at most exp(-d^2/2), for all parameters together.
        let sides = 2 * C;
        let bound = T::from_f64(2.0) * (T::from_f64(sides as f64) / T::from_f64(BEYOND)).ln();
        self.blind = (bound * variance).sqrt() + self.noisy;
        true
    }

    /// A column without its part along the first directions of the basis; false where no more than rounding is left.
    fn beside(&mut self, index: usize, count: usize, tiny: T) -> bool {
        for i in 0..C {
            self.own[i] = self.block.factor[i][index];
            self.weights[i] = if i == index { T::ONE } else { T::ZERO };
        }
        let before = dot(&self.own, &self.own);
        for k in 0..count {
            let along = dot(&self.own, &self.basis[k]);
            for i in 0..C {
                self.own[i] -= along * self.basis[k][i];
                self.weights[i] -= along * self.basis_weights[k][i];
            }
        }
        dot(&self.own, &self.own) > before * tiny * tiny * T::from_f64(16.0)
    }
}

/// The factor from a variance of so many degrees of freedom to its upper limit of 99 % (Wilson and Hilferty, 1931).
fn upper<T: Real>(freedom: T) -> T {
    let part = T::from_f64(2.0) / (T::from_f64(9.0) * freedom);
    let root = T::ONE - part - T::from_f64(QUANTILE) * part.sqrt();
    T::ONE / (root * root * root)
}

fn dot<T: Real, const C: usize>(a: &[T; C], b: &[T; C]) -> T {
    let mut sum = T::ZERO;
    for i in 0..C {
        sum += a[i] * b[i];
    }
    sum
}
