//! `numerical`: the matrix of the tracking error's harmonics from runs with one parameter changed at a time (Feng, Eqn 3.28).
//!
//! To first order `E = M (theta' - theta)`, theta' being the parameters of the feed-forward. A base run and one run per parameter give M
//! by differences; parameters whose columns follow from the others, because no reference shows a combination, need no run. On request M
//! is used as in Feng's chapters 3 and 5: entries that are zero in the exact table are cleared, only as many equations as unknowns are
//! kept (Eqn 3.29), and once M is known every run is an update, and M is corrected by the change of the error since the run before
//! (secant). Invariant: M belongs to one reference; another reference begins anew.
//!
//! M is measured, and its noise enters every equation: that of a column times the ratio of the update to the step behind the column. All
//! columns are differences from the base run, whose noise is in the right-hand side too, which would bias least squares. Regression
//! calibration replaces the columns by the expectation of the exact ones, given the measured ones (`Measured::calibrated`).
//!
//! What a run shows beyond the prediction of M is the error of the linearisation. It grows with the square of the update and, as M is a
//! quotient of differences, with the product of update and step. Terms that are even in a velocity have a mean that the noise of the
//! sensors makes round the loop; it is in the error of the base run and in none of the differences, and is taken out.

use crate::along::Along;
use crate::applies::{check_reference, check_runs};
use crate::damping::Damping;
use crate::designs::Designs;
use crate::equations::Equations;
use crate::error::EstimateError;
use crate::estimator::Estimator;
use crate::first_order::fed_back;
use crate::information::reduced;
use crate::noise::{noise_along, rounding_shares};
use crate::response::answer;
use crate::result::Estimate;
use crate::run::{Run, error_lines};
use crate::settings::{NumericalSettings, Settings};
use crate::stack::solve_reweighted;
use crate::table::LineTable;
use num_complex::Complex;
use std::sync::Arc;
use tpm_core::model::Model;
use tpm_motion::Trial;
use tpm_motion::trajectory::Trajectory;
use tpm_numerics::{Cholesky, DMatrix, DVector, alarm, tolerance};

/// Largest change of a parameter in a perturbed run, as a share of its value, or of the value at which it makes the whole force.
const MOST_PERTURBATION: f64 = 0.5;
/// A perturbed run is to change the error by this many times its noise, if the largest change allows.
const PERTURBATION_OVER_NOISE: f64 = 30.0;
/// A perturbed run is to change the error by this share of it, so that the difference is a derivative.
const PERTURBATION_OF_ERROR: f64 = 0.1;
/// A matrix holds about a run when secants have carried that run no farther than this, in steps.
const MOST_SECANT_STEPS: f64 = 2.0;
/// A secant is worth a run if it divides the power of the error by this much; otherwise the matrix is measured anew.
const LEAST_POWER_DIVISOR: f64 = 4.0;

/// Phasors per coordinate and harmonic.
type Lines = Vec<Vec<Complex<f64>>>;

/// The estimator `numerical`.
pub(super) struct Numerical {
    /// Nothing moves along the directions that are hidden here, those that no reference shows so far.
    settings: Settings,
    designs: Designs,
    table: Option<Arc<dyn LineTable>>,
    /// What every update so far knew.
    updates: Vec<Measured>,
    /// Whether the last run made an update.
    ready: bool,
    base: Option<Base>,
    /// Per perturbed parameter so far.
    columns: Vec<Column>,
    /// Whether M is whole, so that every further run corrects it.
    known: bool,
    damping: Damping,
    harmonics: usize,
}

/// A measured column of M.
#[derive(Clone)]
struct Column {
    /// Change of every coordinate's error lines per change of the parameter.
    lines: Lines,
    /// How much of the noise of every run since the matrix was begun is in the column for one step.
    noise: Vec<f64>,
}

/// The run with which perturbed runs are compared.
#[derive(Clone)]
struct Base {
    reference: Trajectory,
    parameters: Vec<f64>,
    error: Lines,
    /// How much of the noise of every run since the matrix was begun is in the error: all of one run.
    noise: Vec<f64>,
    variance: Vec<Vec<f64>>,
    /// Change of every parameter in a perturbed run.
    steps: Vec<f64>,
    /// The parameters that are perturbed.
    perturbed: Vec<usize>,
    /// How far secants have carried the base from where M was measured, in steps of the perturbed parameters.
    moved: Vec<f64>,
    /// The other parameters that are free: each with a direction that no reference shows, in which its own component is one.
    dependent: Vec<(usize, Vec<f64>)>,
    /// Entries that are zero in the exact table, per parameter and harmonic.
    zero: Vec<Vec<bool>>,
    /// What noise makes of the mean of the error; nothing where it is not known.
    shift: Option<MeanShift>,
    /// Rounding to counts that other runs on the reference repeat, per coordinate, as a share of the variance; and as much of it as the
    /// variance does not have already.
    repeated: Vec<(f64, f64)>,
}

/// What the motion that noise causes makes of the means of the tracking error.
#[derive(Clone)]
struct MeanShift {
    /// Per coordinate: for every parameter of value one and, last, for the known term.
    coordinates: Vec<Vec<f64>>,
    /// Standard deviation of the whole, as a share of it.
    uncertainty: f64,
}

impl MeanShift {
    fn new(
        model: &dyn Model<f64>,
        run: &Run<'_>,
        along: &Along,
        highest: usize,
    ) -> Result<Option<Self>, EstimateError> {
        let theta = &run.trial.parameters;
        let found = noise_along(model, run, along, theta, highest)?;
        let Some((rows, uncertainty)) = found.and_then(|noise| noise.shifts) else { return Ok(None) };
        let width = theta.len() + 1;
        let forces = DMatrix::from_fn(rows.len(), width, |row, j| Complex::new(rows[row][j], 0.0));
        let moved = answer(along, run.trial, theta, run.hold, 0, &forces);
        let of = |moved: DMatrix<Complex<f64>>| {
            let coordinates = moved.row_iter().map(|row| row.iter().map(|shift| shift.re).collect()).collect();
            MeanShift { coordinates, uncertainty }
        };
        Ok(moved.map(of))
    }
}

/// A matrix with the run that it was applied to.
struct Measured {
    /// Whether the matrix was measured about the run, and not carried there by secants.
    fresh: bool,
    /// Error of the linearisation in a line, as a variance for an update of length one in steps; nothing before another run on the
    /// reference has shown it.
    curvature: Option<f64>,
    /// Per perturbed parameter.
    columns: Vec<Column>,
    base: Base,
}

impl Base {
    fn new(
        model: &dyn Model<f64>,
        run: &Run<'_>,
        error: Lines,
        highest: usize,
        table: Option<&dyn LineTable>,
        settings: &Settings,
    ) -> Result<Self, EstimateError> {
        let dims = model.dims();
        let along = Along::of_trial(model, run.trial, highest, table)?;
        let power = |lines: &[Complex<f64>]| lines.iter().map(|z| z.norm_sqr()).sum::<f64>();
        let force =
            run.spectra.lines.iter().skip(dims.coordinates).map(|lines| power(lines)).fold(0.0, f64::max).sqrt();
        let rounding = rounding_shares(run.spectra, run.hold, dims);
        let variance = with_rounding(run, &rounding, highest);
        let noise = variance.iter().flatten().sum::<f64>().sqrt();
        let size = error.iter().map(|lines| power(lines)).sum::<f64>().sqrt();
        let target = (PERTURBATION_OF_ERROR * size).max(PERTURBATION_OVER_NOISE * noise);
        // Square of the size of H^-1, row by row and harmonic by harmonic.
        let stiffness = |r: usize, k: usize| {
            let felt = along.response(r, &run.trial.parameters, k);
            let gain = fed_back(run.trial, &along, run.hold, r, k);
            felt.iter().zip(gain).map(|(j, gain)| (j + gain).norm_sqr()).sum::<f64>()
        };
        // What changes the error as much as wanted, and no more than half of the value, or than what makes half of the applied force
        // when the value is nearly nothing.
        let step = |j: usize| {
            let felt = (0..dims.rows).map(|r| power(along.regressor(r, j))).fold(0.0, f64::max).sqrt();
            let whole = if felt > 0.0 { force / felt } else { 1.0 };
            let value = run.trial.parameters[j].abs();
            let most = MOST_PERTURBATION * if value > 0.1 * whole { value } else { whole };
            let lines =
                (0..dims.rows).flat_map(|r| along.regressor(r, j).iter().enumerate().map(move |line| (r, line)));
            let moved = |(r, (k, line)): (usize, (usize, &Complex<f64>))| match stiffness(r, k) {
                stiffness if stiffness > 0.0 => line.norm_sqr() / stiffness,
                _ => 0.0,
            };
            let moved = lines.map(moved).sum::<f64>().sqrt();
            if moved > 0.0 { most.min(target / moved) } else { most }
        };
        let zero = |j: usize| {
            let largest = (0..dims.rows).flat_map(|r| along.regressor(r, j)).map(|z| z.norm()).fold(0.0, f64::max);
            let line = |k: usize| {
                (0..dims.rows).all(|r| along.regressor(r, j)[k].norm() <= tolerance::REGRESSOR_LINE * largest)
            };
            (0..=highest).map(line).collect()
        };
        let (perturbed, dependent) = unknowns(settings, dims.parameters)?;
        Ok(Base {
            reference: run.trial.trajectory.clone(),
            parameters: run.trial.parameters.clone(),
            variance,
            steps: (0..dims.parameters).map(step).collect(),
            moved: vec![0.0; perturbed.len()],
            perturbed,
            dependent,
            zero: (0..dims.parameters).map(zero).collect(),
            shift: MeanShift::new(model, run, &along, highest)?,
            repeated: rounding.iter().map(|(in_one, repeated)| (*repeated, f64::max(repeated - in_one, 0.0))).collect(),
            error,
            noise: vec![1.0],
        })
    }

    /// Whether a run has the reference of the base run. Open coordinates are not compared: their reference follows from the
    /// parameters.
    fn is_of(&self, run: &Run<'_>) -> bool {
        self.reference.prescribes_as(&run.trial.trajectory, &run.trial.open)
    }

    /// A change of the parameters as one of the perturbed parameters alone, in steps: the others follow from directions that change no
    /// row.
    fn in_steps(&self, change: &[f64]) -> Vec<f64> {
        let of = |&j: &usize| {
            let beside: f64 = self.dependent.iter().map(|(own, direction)| direction[j] * change[*own]).sum();
            (change[j] - beside) / self.steps[j]
        };
        self.perturbed.iter().map(of).collect()
    }

    /// Whether M was measured about the base.
    fn is_fresh(&self) -> bool {
        squares(&self.moved) <= MOST_SECANT_STEPS * MOST_SECANT_STEPS
    }

    /// The columns of all parameters.
    fn matrix(&self, columns: Vec<Lines>) -> Vec<Lines> {
        let none: Lines = self.error.iter().map(|lines| vec![Complex::new(0.0, 0.0); lines.len()]).collect();
        let mut matrix = vec![none; self.parameters.len()];
        for (&j, column) in self.perturbed.iter().zip(columns) {
            for (own, direction) in &self.dependent {
                for (sum, line) in matrix[*own].iter_mut().flatten().zip(column.iter().flatten()) {
                    *sum -= line * direction[j];
                }
            }
            matrix[j] = column;
        }
        matrix
    }
}

/// The parameters whose columns need a run, and those whose columns follow from hidden directions.
#[expect(clippy::type_complexity, reason = "a list of indices, and one of directions by their index")]
fn unknowns(settings: &Settings, parameters: usize) -> Result<(Vec<usize>, Vec<(usize, Vec<f64>)>), EstimateError> {
    let free = settings.free(parameters)?;
    let dependent = reduced(settings.hidden.clone());
    let follows = |j: &usize| dependent.iter().any(|(own, _)| own == j);
    Ok((free.indices.into_iter().filter(|j| !follows(j)).collect(), dependent))
}

fn squares(step: &[f64]) -> f64 {
    step.iter().map(|step| step * step).sum()
}

/// How much of the noise of every run remains in the error of a base run without what columns say of a change, given in steps.
fn remaining(base: &[f64], columns: &[Column], steps: &[f64]) -> Vec<f64> {
    let mut noise = base.to_vec();
    for (column, step) in columns.iter().zip(steps) {
        noise.iter_mut().zip(&column.noise).for_each(|(sum, own)| *sum -= own * step);
    }
    noise
}

fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `1 - N^-1 D` and `N^-1 d`; nothing where N is singular. A combination whose noise would be more than all of it is noise alone.
fn reliability(
    products: DMatrix<f64>,
    noise: &DMatrix<f64>,
    shared: &DVector<f64>,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let factor = Cholesky::new(products)?;
    let inverse = factor.l().solve_lower_triangular(&DMatrix::identity(noise.nrows(), noise.nrows()))?;
    // With N = L L', the share of noise along a combination is an eigenvalue of L^-1 D L'^-1.
    let shares = (&inverse * noise * inverse.transpose()).symmetric_eigen();
    let left = shares.eigenvalues.map(|share| 1.0 - share.min(1.0));
    let kept = &shares.eigenvectors * DMatrix::from_diagonal(&left) * shares.eigenvectors.transpose();
    Some((inverse.tr_mul(&(kept * factor.l().transpose())), inverse.tr_mul(&(&inverse * shared))))
}

/// Variances of the error's lines: noise, and rounding to counts as far as it repeats with the motion.
fn variances(model: &dyn Model<f64>, run: &Run<'_>, highest: usize) -> Vec<Vec<f64>> {
    with_rounding(run, &rounding_shares(run.spectra, run.hold, model.dims()), highest)
}

/// The same, given what rounding adds to every coordinate as a share of its noise.
fn with_rounding(run: &Run<'_>, shares: &[(f64, f64)], highest: usize) -> Vec<Vec<f64>> {
    let of = |(c, (rounding, _)): (usize, &(f64, f64))| {
        let peak = run.spectra.lines[c].iter().map(|line| line.norm()).fold(0.0, f64::max);
        let least = (tolerance::READING * peak).powi(2) + f64::MIN_POSITIVE;
        (0..=highest).map(|k| run.spectra.variance(c, k) * (1.0 + rounding) + least).collect()
    };
    shares.iter().enumerate().map(of).collect()
}

/// The power of an error of the linearisation, in that of an update of the length one: the update with these squares was foreseen by
/// quotients of differences over steps of the length one.
fn bent(squares: f64) -> f64 {
    (squares + squares.sqrt()).powi(2)
}

impl Numerical {
    /// The estimator before any run.
    pub(super) fn new(settings: &Settings, table: Option<Arc<dyn LineTable>>) -> Self {
        Numerical {
            settings: settings.clone(),
            designs: Designs::default(),
            table,
            updates: Vec::new(),
            ready: false,
            base: None,
            columns: Vec::new(),
            known: false,
            damping: Damping::default(),
            harmonics: 0,
        }
    }

    /// What a run shows beyond the prediction of M from the base, and the way to it from there in steps.
    fn missed(&self, base: &Base, run: &Run<'_>, error: &Lines) -> (Lines, Vec<f64>) {
        let change: Vec<f64> =
            run.trial.parameters.iter().zip(&base.parameters).map(|(now, before)| now - before).collect();
        let step = base.in_steps(&change);
        let mut missed = error.clone();
        for (c, lines) in missed.iter_mut().enumerate() {
            for (k, line) in lines.iter_mut().enumerate() {
                let columns = self.columns.iter().zip(&step).zip(&base.perturbed);
                let foreseen: Complex<f64> = columns.map(|((m, s), &j)| m.lines[c][k] * (*s * base.steps[j])).sum();
                *line -= base.error[c][k] + foreseen;
            }
        }
        (missed, step)
    }

    /// Compares a run on the reference of the base with the prediction of M: what it missed is the error of the linearisation in the last
    /// update.
    fn check_prediction(&mut self, model: &dyn Model<f64>, run: &Run<'_>, error: &Lines) {
        let Some(base) = &self.base else { return };
        let (missed, step) = self.missed(base, run, error);
        let length = squares(&step);
        let variance = variances(model, run, self.harmonics);
        let noise = |c: usize, k: usize| variance[c][k] + base.variance[c][k];
        let lines =
            missed.iter().enumerate().flat_map(|(c, lines)| lines.iter().enumerate().map(move |(k, z)| (c, k, z)));
        let certain = lines.filter(|(c, k, line)| line.norm_sqr() > alarm::PREDICTION_MISSES * noise(*c, *k));
        let worst = certain.map(|(.., line)| line.norm_sqr()).fold(0.0, f64::max);
        if let Some(last) = self.updates.last_mut().filter(|_| length > 0.0) {
            last.curvature = Some(last.curvature.unwrap_or(0.0).max(worst / bent(length)));
        }
    }

    /// Corrects M by what a run shows beyond its prediction (Broyden's update, every parameter scaled by its step), and makes the run the
    /// base.
    fn correct(&mut self, model: &dyn Model<f64>, run: &Run<'_>, error: Lines) {
        let Some(base) = &self.base else { return };
        let (missed, step) = self.missed(base, run, &error);
        let length = squares(&step);
        let variance = variances(model, run, self.harmonics);
        // Noise is no change of M: the share of what was missed that stands out of it corrects M.
        let all: f64 = missed.iter().flatten().map(|line| line.norm_sqr()).sum();
        let of_noise: f64 = variance.iter().chain(&base.variance).flatten().sum();
        let share = if all > of_noise && length > 0.0 { (1.0 - of_noise / all) / length } else { 0.0 };
        let noise = remaining(&base.noise, &self.columns, &step);
        for ((column, step), &j) in self.columns.iter_mut().zip(&step).zip(&base.perturbed) {
            for (line, missed) in column.lines.iter_mut().flatten().zip(missed.iter().flatten()) {
                *line += missed * (share * step / base.steps[j]);
            }
            // What was missed has the noise of the new run, without that of the base and of the columns.
            column.noise.iter_mut().zip(&noise).for_each(|(own, noise)| *own -= noise * share * step);
            column.noise.push(share * step);
        }
        if let Some(base) = self.base.as_mut() {
            base.moved.iter_mut().zip(&step).for_each(|(moved, step)| *moved += step);
            base.variance = variance;
            base.parameters.clone_from(&run.trial.parameters);
            base.error = error;
            base.noise.fill(0.0);
            base.noise.push(1.0);
        }
    }

    /// Begins a matrix with a run as its base.
    fn begin(&mut self, model: &dyn Model<f64>, run: &Run<'_>, error: Lines) -> Result<(), EstimateError> {
        self.columns.clear();
        self.known = false;
        if self.base.as_ref().is_none_or(|base| !base.is_of(run)) {
            self.settings = self.designs.take(model, run.trial, &self.settings)?;
        }
        self.base = Some(Base::new(model, run, error, self.harmonics, self.table.as_deref(), &self.settings)?);
        Ok(())
    }

    /// The estimate from all updates, each weighted where the parameters are about their own estimate.
    fn solve(&self) -> Result<Estimate, EstimateError> {
        let current = self.updates.last().map_or(&[][..], |update| update.base.parameters.as_slice());
        let rank = unknowns(&self.settings, current.len())?.0.len();
        solve_reweighted(&self.settings, current, |theta| {
            let of = |update: &Measured| {
                let same = |other: &&Measured| other.base.reference == update.base.reference;
                let others = self.updates.iter().filter(same).count() - 1;
                update.equations(theta, &self.settings, rank, others)
            };
            self.updates.iter().map(of).collect()
        })
    }
}

impl Measured {
    /// The curvature with other steps: the largest that it may be there.
    fn curvature_in(&self, steps: &[f64]) -> Option<f64> {
        let ratio = steps.iter().zip(&self.base.steps).map(|(new, old)| new / old).fold(0.0, f64::max);
        self.curvature.map(|curvature| curvature * ratio.powi(4))
    }

    /// The columns, and the error of the base, as they are expected without the noise that the columns share with the equations.
    ///
    /// With the weighted products N of the measured columns, the products D of their noise among these and the products d of their noise
    /// and that of the error, `E[exact columns | measured]` is `M (1 - N^-1 D)`, and `M N^-1 d` of the error is noise of the columns
    /// (regression calibration). The normal equations are then `(N - D) x = M' E - d`, without bias, and the covariance is theirs. What
    /// cannot be told from noise along a combination leaves nothing of it. Noise is in what the update leaves of the error too, and is not
    /// taken for larger than this shows: variances are upper limits where a machine has no noise to speak of.
    fn calibrated(&self, steps: &[f64], cleared: bool, variance: impl Fn(usize, usize) -> f64) -> (Vec<Lines>, Lines) {
        let base = &self.base;
        let count = self.columns.len();
        let (mut products, mut noise) = (DMatrix::<f64>::zeros(count, count), DMatrix::<f64>::zeros(count, count));
        let mut shared = DVector::<f64>::zeros(count);
        let is_used = |j: usize, k: usize| !(cleared && base.zero[base.perturbed[j]][k]);
        // Per step, so that columns are of the same size.
        let mut columns: Vec<Lines> = self.columns.iter().map(|column| column.lines.clone()).collect();
        for (j, lines) in columns.iter_mut().enumerate() {
            for line in lines.iter_mut().flat_map(|lines| lines.iter_mut().enumerate()) {
                *line.1 *= if is_used(j, line.0) { base.steps[base.perturbed[j]] } else { 0.0 };
            }
        }
        let weight = |c: usize, k: usize| if k == 0 { 1.0 } else { 2.0 } / variance(c, k);
        // What is left of the error at the update, which noise explains up to what is expected of it.
        let (mut left, mut expected) = (0.0, 0.0);
        let remaining = squares(&remaining(&base.noise, &self.columns, steps));
        for (c, error) in base.error.iter().enumerate() {
            for (k, (line, known)) in error.iter().zip(&base.variance[c]).enumerate().skip(1) {
                let foreseen =
                    columns.iter().zip(steps).map(|(column, step)| column[c][k] * step).sum::<Complex<f64>>();
                left += weight(c, k) * (line - foreseen).norm_sqr();
                expected += weight(c, k) * known * remaining;
            }
        }
        let shown = if left < expected { left / expected } else { 1.0 };
        for (c, error) in base.error.iter().enumerate() {
            for (k, known) in base.variance[c].iter().enumerate().take(error.len()) {
                let weight = weight(c, k);
                let own = weight * known * shown;
                for i in (0..count).filter(|&i| is_used(i, k)) {
                    shared[i] += own * product(&self.columns[i].noise, &base.noise);
                    for j in (0..count).filter(|&j| is_used(j, k)) {
                        products[(i, j)] += weight * (columns[i][c][k].conj() * columns[j][c][k]).re;
                        noise[(i, j)] += own * product(&self.columns[i].noise, &self.columns[j].noise);
                    }
                }
            }
        }
        let mut error = base.error.clone();
        if let Some((mixed, part)) = reliability(products, &noise, &shared) {
            let measured = columns.clone();
            for (c, lines) in error.iter_mut().enumerate() {
                for (k, line) in lines.iter_mut().enumerate() {
                    *line -= (0..count).map(|i| measured[i][c][k] * part[i]).sum::<Complex<f64>>();
                    for (j, column) in columns.iter_mut().enumerate() {
                        column[c][k] = (0..count).map(|i| measured[i][c][k] * mixed[(i, j)]).sum();
                    }
                }
            }
        }
        for (column, &j) in columns.iter_mut().zip(&base.perturbed) {
            column.iter_mut().flatten().for_each(|line| *line /= base.steps[j]);
        }
        (columns, error)
    }

    /// `E = M (theta' - theta)`, with the variances where the parameters are about `theta`, beside so many other updates on the same
    /// reference.
    fn equations(&self, theta: &[f64], settings: &Settings, rank: usize, others: usize) -> Equations {
        let NumericalSettings { cleared, reduced, .. } = settings.numerical;
        let base = &self.base;
        let update: Vec<f64> = base.parameters.iter().zip(theta).map(|(now, to)| now - to).collect();
        let steps = base.in_steps(&update);
        let length = squares(&steps);
        // The noise of the perturbed runs, and that of the base, with which all of them were compared.
        let noise = squares(&remaining(&base.noise, &self.columns, &steps));
        let missed = match self.curvature {
            Some(curvature) => curvature * bent(length),
            // Nothing is known of the linearisation: it may miss as much as there is.
            None => base.error.iter().flatten().map(|line| line.norm_sqr()).fold(0.0, f64::max),
        };
        // What all updates repeat counts in each as often as there are updates, this one among them.
        let variance = |c: usize, k: usize| {
            let (repeated, own) = base.repeated[c];
            base.variance[c][k] * (noise + own + others as f64 * repeated) + missed
        };
        let (columns, error) = self.calibrated(&steps, cleared, variance);
        let matrix = base.matrix(columns);
        let mut equations = Equations::new(matrix.len());
        for (c, error) in error.iter().enumerate() {
            for (k, line) in error.iter().enumerate() {
                let mut phi: Vec<Complex<f64>> = matrix.iter().map(|column| column[c][k]).collect();
                if cleared && base.zero.iter().all(|zero| zero[k]) {
                    continue;
                }
                let mut right: Complex<f64> = phi.iter().zip(&base.parameters).map(|(m, value)| m * *value).sum();
                right -= line;
                let mut variance = variance(c, k);
                if let Some(MeanShift { coordinates, uncertainty }) = base.shift.as_ref().filter(|_| k == 0) {
                    let (own, known) = coordinates[c].split_at(phi.len());
                    let known: f64 = known.iter().sum();
                    phi.iter_mut().zip(own).for_each(|(phi, shift)| *phi += shift);
                    right -= known;
                    let whole = known + own.iter().zip(theta).map(|(shift, value)| shift * value).sum::<f64>();
                    variance += (uncertainty * whole).powi(2);
                }
                equations.push(c, k, &phi, right, variance);
            }
        }
        if reduced { equations.reduced(rank) } else { equations }
    }
}

impl Estimator for Numerical {
    fn name(&self) -> &'static str {
        "numerical"
    }

    fn check(&self, model: &dyn Model<f64>, first: &Trial, runs: usize) -> Result<(), EstimateError> {
        check_reference(model, first, self.name())?;
        let settings = Designs::default().take(model, first, &self.settings)?;
        check_runs(unknowns(&settings, model.dims().parameters)?.0.len() + 1, runs)
    }

    fn play(&self, current: &[f64]) -> Vec<f64> {
        let Some(base) = self.base.as_ref().filter(|_| !self.known) else { return self.damping.towards(current) };
        let mut changed = base.parameters.clone();
        if let Some(&j) = base.perturbed.get(self.columns.len()) {
            changed[j] += base.steps[j];
        }
        changed
    }

    fn take_back(&mut self) -> bool {
        match self.base.as_mut().filter(|_| !self.known) {
            Some(base) => {
                // Half the steps that are still to come.
                let next = base.perturbed.iter().skip(self.columns.len());
                next.for_each(|&j| base.steps[j] *= 0.5);
                true
            }
            None => self.damping.take_back(),
        }
    }

    fn is_final(&self) -> bool {
        !self.damping.is_damped() && self.updates.last().is_some_and(|update| update.fresh)
    }

    fn linear_about(&self) -> Option<&[f64]> {
        self.updates.last().map(|update| update.base.parameters.as_slice())
    }

    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        self.ready = false;
        let dims = model.dims();
        if run.spectra.lines.len() < dims.coordinates {
            return Err(EstimateError::Channels {
                needed: dims.coordinates + dims.inputs,
                given: run.spectra.lines.len(),
            });
        }
        let highest = run.highest_harmonic(&self.settings);
        let error = error_lines(run.trial, run.spectra, dims.coordinates, highest);
        self.harmonics = highest;
        let same = |base: &&Base| base.error[0].len() == highest + 1 && base.is_of(run);
        let perturbs = self.base.as_ref().filter(same).is_some() && !self.known;
        let power = |lines: &Lines| lines.iter().flatten().map(|line| line.norm_sqr()).sum::<f64>();
        let (size, noise) = (power(&error), variances(model, run, highest).iter().flatten().sum::<f64>());
        let better = perturbs || self.damping.judge(run.trial, size, noise);
        let Some(before) = self.base.as_ref().filter(same).map(|base| power(&base.error)) else {
            return self.begin(model, run, error);
        };
        if self.known {
            self.check_prediction(model, run, &error);
            if !better {
                // The next run goes less far; where that helps no more, the matrix is measured anew.
                if self.damping.is_exhausted() {
                    self.columns.clear();
                    self.known = false;
                }
                return Ok(());
            }
            let fresh = self.base.as_ref().is_some_and(Base::is_fresh);
            let floor = size < LEAST_POWER_DIVISOR * noise;
            if !self.settings.numerical.secant || (floor && !fresh) || (!floor && LEAST_POWER_DIVISOR * size > before) {
                return self.begin(model, run, error);
            }
            self.correct(model, run, error);
        } else if let Some(base) = &self.base {
            let step = base.steps[base.perturbed[self.columns.len()]];
            let lines = error
                .iter()
                .zip(&base.error)
                .map(|(changed, before)| changed.iter().zip(before).map(|(a, b)| (a - b) / step).collect())
                .collect();
            let runs = base.perturbed.len() + 1;
            let mut noise = vec![0.0; runs];
            (noise[0], noise[self.columns.len() + 1]) = (-1.0, 1.0);
            self.columns.push(Column { lines, noise });
            if self.columns.len() < base.perturbed.len() {
                return Ok(());
            }
            self.known = true;
            if let Some(base) = self.base.as_mut() {
                base.noise.resize(runs, 0.0);
            }
        }
        if let Some(base) = &self.base {
            let kept = self.settings.kept(self.updates.len());
            self.updates.drain(..self.updates.len() - kept);
            // A matrix that secants have carried is good for the next step, not for the result.
            self.updates.retain(|update| update.fresh);
            self.updates.push(Measured {
                fresh: base.is_fresh(),
                curvature: self.updates.last().and_then(|last| last.curvature_in(&base.steps)),
                columns: self.columns.clone(),
                base: base.clone(),
            });
        }
        self.ready = true;
        Ok(())
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        if self.ready { self.solve().map(Some) } else { Ok(None) }
    }

    fn harmonics(&self) -> usize {
        self.harmonics
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use tpm_numerics::{DMatrix, DVector};

    /// Two columns, measured as differences from a base run whose noise is in the right-hand side as well.
    #[test]
    fn noise_that_columns_share_with_the_base_moves_no_estimate() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let (count, draws, truth) = (40, 4000, [-0.3, 0.5]);
        let exact = DMatrix::from_fn(count, 2, |e, j| {
            let phase = (e as f64) * 0.7;
            4.0 * phase.sin() + if j == 0 { 0.0 } else { 5.0 * phase.cos() }
        });
        let target = &exact * DVector::from_column_slice(&truth);
        // The base is in both columns with -1, and every column has a run of its own.
        let noise = DMatrix::from_row_slice(2, 2, &[2.0, 1.0, 1.0, 2.0]);
        let shared = DVector::from_element(2, -1.0);
        let (mut plain, mut calibrated, mut squares) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        let mut stated = [0.0; 2];
        for _ in 0..draws {
            let base = DVector::from_fn(count, |_, _| normal());
            let columns = DMatrix::from_fn(count, 2, |e, j| exact[(e, j)] + normal() - base[e]);
            let right = &target + &base;
            // Noise of an equation: the base, without what the columns say of the update.
            let scale = (1.0_f64 + truth.iter().sum::<f64>()).powi(2) + truth.iter().map(|x| x * x).sum::<f64>();
            let weighted = |m: &DMatrix<f64>| m.tr_mul(m) / scale;
            let solved = |m: &DMatrix<f64>, right: &DVector<f64>| {
                m.tr_mul(m).cholesky().expect("regular").solve(&m.tr_mul(right))
            };
            let factors = (count as f64 / scale, weighted(&columns));
            let (mixed, part) =
                super::reliability(factors.1, &(&noise * factors.0), &(&shared * factors.0)).expect("regular");
            let (expected, rest) = (&columns * mixed, &right - &columns * part);
            let own = solved(&expected, &rest);
            let covariance = weighted(&expected).try_inverse().expect("regular");
            let naive = solved(&columns, &right);
            for j in 0..2 {
                plain[j] += (naive[j] - truth[j]) / draws as f64;
                calibrated[j] += (own[j] - truth[j]) / draws as f64;
                squares[j] += (own[j] - truth[j]).powi(2) / draws as f64;
                stated[j] += covariance[(j, j)] / draws as f64;
            }
        }
        for j in 0..2 {
            let std = squares[j].sqrt();
            assert!(calibrated[j].abs() < 0.2 * plain[j].abs(), "{calibrated:?} {plain:?}");
            assert!(plain[j].abs() > 0.2 * std, "the test tells nothing: {plain:?} {std}");
            assert!((0.9..1.1).contains(&(stated[j].sqrt() / std)), "{stated:?} {squares:?}");
        }
    }
}
