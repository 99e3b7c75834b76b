//! `numerical`: the matrix of the tracking error's harmonics from runs with one parameter changed at a time (Feng, Eqn 3.28).
//!
//! To first order `E = M (theta' - theta)`, theta' being the parameters of the feed-forward. A base run and one run per parameter, or per
//! combination of them, give M by differences; parameters whose columns follow from the others, because no reference shows a combination, need no run. On request M
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

mod base;
mod perturbations;

use self::base::{Base, MeanShift, squares, unknowns, variances};
use self::perturbations::{Column, Lines, Response};
use crate::applies::{check_reference, check_runs};
use crate::damping::Damping;
use crate::designs::Designs;
use crate::equations::Equations;
use crate::error::EstimateError;
use crate::estimator::Estimator;
use crate::result::Estimate;
use crate::run::{Run, error_lines};
use crate::settings::{NumericalSettings, Settings};
use crate::stack::solve_reweighted;
use crate::table::LineTable;
use num_complex::Complex;
use std::sync::Arc;
use tpm_controller::model::Model;
use tpm_motion::Trial;
use tpm_numerics::{Cholesky, DMatrix, DVector, alarm};

/// A secant is worth a run if it divides the power of the error by this much; otherwise the matrix is measured anew.
const LEAST_POWER_DIVISOR: f64 = 4.0;
/// Most change of what is known of the response's bend by one update.
const MOST_RESIZED: f64 = 100.0;
/// An earlier update counts while its linearisation misses this share of the power of noise.
const MOST_MISSED: f64 = 0.1;
/// A matrix that secants have carried is believed while the square of an update's length is at most this share of that before.
const LEAST_CONTRACTION: f64 = 1.0 / 16.0;

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
    /// The last estimate.
    values: Vec<f64>,
    base: Option<Base>,
    /// The base of the matrix before, on the same reference.
    before: Option<Earlier>,
    /// What the last whole matrix said of the response.
    response: Option<Response>,
    /// How much more the response bends than a perturbation allows for at first.
    bend: f64,
    /// Per perturbed run so far.
    columns: Vec<Column>,
    /// Whether M is whole, so that every further run corrects it.
    known: bool,
    damping: Damping,
    harmonics: usize,
}

/// A run that was the base of a matrix before.
struct Earlier {
    parameters: Vec<f64>,
    error: Lines,
}

/// A matrix with the run that it was applied to.
struct Measured {
    /// Whether the matrix was measured about the run, and not carried there by secants.
    fresh: bool,
    /// Error of the linearisation in a line, as a variance for an update of length one in steps; nothing before another run on the
    /// reference has shown it.
    curvature: Option<f64>,
    /// Per perturbed run.
    columns: Vec<Column>,
    base: Base,
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
            values: Vec::new(),
            base: None,
            before: None,
            response: None,
            bend: 1.0,
            columns: Vec::new(),
            known: false,
            damping: Damping::default(),
            harmonics: 0,
        }
    }

    /// What a run with such parameters shows beyond the prediction of M from the base, and the way to it from there in steps.
    fn missed(&self, base: &Base, parameters: &[f64], error: &Lines) -> (Lines, Vec<f64>) {
        let change: Vec<f64> = parameters.iter().zip(&base.parameters).map(|(now, before)| now - before).collect();
        let step = base.in_steps(&change);
        let mut missed = error.clone();
        for (c, lines) in missed.iter_mut().enumerate() {
            for (k, line) in lines.iter_mut().enumerate() {
                let foreseen: Complex<f64> = self.columns.iter().zip(&step).map(|(m, step)| m.lines[c][k] * step).sum();
                *line -= base.error[c][k] + foreseen;
            }
        }
        (missed, step)
    }

    /// Error of the linearisation that a run shows on the reference of the base, as a variance of a line for an update of length one in
    /// steps; nothing for the base itself.
    fn curvature(&self, base: &Base, parameters: &[f64], error: &Lines) -> Option<f64> {
        let (missed, step) = self.missed(base, parameters, error);
        let length = squares(&step);
        let noise = |c: usize, k: usize| 2.0 * base.variance[c][k];
        let lines =
            missed.iter().enumerate().flat_map(|(c, lines)| lines.iter().enumerate().map(move |(k, z)| (c, k, z)));
        let certain = lines.filter(|(c, k, line)| line.norm_sqr() > alarm::PREDICTION_MISSES * noise(*c, *k));
        // What does not stand out may be as large as noise.
        let lines = base.variance.iter().flatten();
        let unseen = lines.clone().sum::<f64>() / lines.count().max(1) as f64;
        let worst = certain.map(|(.., line)| line.norm_sqr()).fold(unseen, f64::max);
        // Within a step noise says more than curvature.
        (length > 0.0).then(|| worst / bent(length.max(1.0)))
    }

    /// Compares a run on the reference of the base with the prediction of M: what it missed is the error of the linearisation in the last
    /// update.
    fn check_prediction(&mut self, run: &Run<'_>, error: &Lines) {
        let shown = self.base.as_ref().and_then(|base| self.curvature(base, &run.trial.parameters, error));
        if let (Some(last), Some(shown)) = (self.updates.last_mut(), shown) {
            last.curvature = Some(last.curvature.unwrap_or(0.0).max(shown));
        }
    }

    /// Corrects M by what a run shows beyond its prediction (Broyden's update, every parameter scaled by its step), and makes the run the
    /// base.
    fn correct(&mut self, model: &dyn Model<f64>, run: &Run<'_>, error: Lines) {
        let Some(base) = &self.base else { return };
        let (missed, step) = self.missed(base, &run.trial.parameters, &error);
        let length = squares(&step);
        let variance = variances(model, run, self.harmonics);
        // Noise is no change of M: the share of what was missed that stands out of it corrects M.
        let all: f64 = missed.iter().flatten().map(|line| line.norm_sqr()).sum();
        let of_noise: f64 = variance.iter().chain(&base.variance).flatten().sum();
        let share = if all > of_noise && length > 0.0 { (1.0 - of_noise / all) / length } else { 0.0 };
        let noise = remaining(&base.noise, &self.columns, &step);
        for (column, step) in self.columns.iter_mut().zip(&step) {
            for (line, missed) in column.lines.iter_mut().flatten().zip(missed.iter().flatten()) {
                *line += missed * (share * step);
            }
            // What was missed has the noise of the new run, without that of the base and of the columns.
            column.noise.iter_mut().zip(&noise).for_each(|(own, noise)| *own -= noise * share * step);
            column.noise.push(share * step);
        }
        self.leave(&run.trial.parameters);
        if let Some(base) = self.base.as_mut() {
            base.moved.iter_mut().zip(&step).for_each(|(moved, step)| *moved += step);
            base.variance = variance;
            base.parameters.clone_from(&run.trial.parameters);
            base.error = error;
            base.noise.fill(0.0);
            base.noise.push(1.0);
        }
    }

    /// By how much the last update bent more than perturbations were sized for: a step of these then errs by as much as noise.
    fn bent_more(&self) -> f64 {
        let of = |last: &Measured| {
            let noise: f64 = last.base.variance.iter().flatten().sum();
            Some((last.curvature? / noise).sqrt().clamp(MOST_RESIZED.recip(), MOST_RESIZED))
        };
        self.updates.last().and_then(of).unwrap_or(1.0)
    }

    /// Keeps the base as that of the matrix before, unless the next one has its parameters.
    fn leave(&mut self, next: &[f64]) {
        let Some(base) = self.base.as_ref().filter(|base| base.parameters != next) else { return };
        self.before = Some(Earlier { parameters: base.parameters.clone(), error: base.error.clone() });
    }

    /// Begins a matrix with a run as its base.
    fn begin(&mut self, model: &dyn Model<f64>, run: &Run<'_>, error: Lines) -> Result<(), EstimateError> {
        self.bend *= self.bent_more();
        if let Some(base) = &self.base {
            self.response = base.perturbations.response(&self.columns).or(self.response.take());
        }
        match &self.base {
            Some(base) if base.error[0].len() == error[0].len() && base.is_of(run) => self.leave(&run.trial.parameters),
            _ => self.before = None,
        }
        self.columns.clear();
        self.known = false;
        if self.before.is_none() {
            self.settings = self.designs.take(model, run.trial, &self.settings)?;
        }
        let table = self.table.as_deref();
        self.base = Some(Base::new(
            model,
            run,
            error,
            self.harmonics,
            (self.response.as_ref(), self.bend),
            table,
            &self.settings,
        )?);
        Ok(())
    }

    /// The estimate from the last update and from the earlier ones that are linear to within noise there. The errors of linearisations
    /// are no noise: matrices of two places contradict each other most along combinations that hardly show.
    fn solve(&self) -> Result<Estimate, EstimateError> {
        let Some((last, earlier)) = self.updates.split_last() else { return Err(EstimateError::NoSignal) };
        let current = last.base.parameters.as_slice();
        let rank = unknowns(&self.settings, current.len())?.0.len();
        solve_reweighted(&self.settings, current, |theta| {
            let pooled: Vec<&Measured> =
                earlier.iter().filter(|update| update.is_linear(theta)).chain(std::iter::once(last)).collect();
            let of = |update: &&Measured| {
                let same = |other: &&&Measured| other.base.reference == update.base.reference;
                let others = pooled.iter().filter(same).count() - 1;
                update.equations(theta, &self.settings, rank, others)
            };
            pooled.iter().map(of).collect()
        })
    }

    /// Takes in a run with one parameter changed. M is known with the last of them.
    fn perturbed(&mut self, error: &Lines) {
        let Some(base) = self.base.as_mut() else { return };
        let changed = |(now, before): (&Vec<Complex<f64>>, &Vec<Complex<f64>>)| {
            now.iter().zip(before).map(|(now, before)| now - before).collect()
        };
        let lines = error.iter().zip(&base.error).map(changed).collect();
        let runs = base.perturbations.count() + 1;
        let mut noise = vec![0.0; runs];
        (noise[0], noise[self.columns.len() + 1]) = (-1.0, 1.0);
        self.columns.push(Column { lines, noise });
        self.known = self.columns.len() == base.perturbations.count();
        if self.known {
            base.noise.resize(runs, 0.0);
        }
    }

    /// Adds what the base and M know to the updates.
    fn remember(&mut self) {
        let Some(base) = &self.base else { return };
        let kept = self.settings.kept(self.updates.len());
        self.updates.drain(..self.updates.len() - kept);
        let curvature = if base.is_carried() {
            self.updates.last().and_then(|last| last.curvature)
        } else {
            self.before.as_ref().and_then(|before| self.curvature(base, &before.parameters, &before.error))
        };
        // A matrix that secants have carried is good for the next step, not for the result.
        self.updates.retain(|update| update.fresh);
        let (columns, base) = (self.columns.clone(), base.clone());
        self.updates.push(Measured { fresh: base.is_fresh(), curvature, columns, base });
    }

    /// Whether the update from the base is shorter than the one that led there.
    fn contracts(&self, from: &[f64]) -> Result<bool, EstimateError> {
        let Some(base) = &self.base else { return Ok(false) };
        let length = |to: &[f64]| {
            let change: Vec<f64> = to.iter().zip(&base.parameters).map(|(to, base)| to - base).collect();
            squares(&base.in_steps(&change))
        };
        Ok(length(&self.solve()?.values) <= LEAST_CONTRACTION * length(from))
    }
}

impl Measured {
    /// The way from the base to an estimate, in steps.
    fn way(&self, theta: &[f64]) -> Vec<f64> {
        let update: Vec<f64> = self.base.parameters.iter().zip(theta).map(|(now, to)| now - to).collect();
        self.base.in_steps(&update)
    }

    /// Error of the linearisation at an estimate, as a variance of a line: as much as there is at most, and where nothing is known of it.
    fn missed(&self, theta: &[f64]) -> f64 {
        let worst = self.base.error.iter().flatten().map(|line| line.norm_sqr()).fold(0.0, f64::max);
        self.curvature.map_or(worst, |curvature| worst.min(curvature * bent(squares(&self.way(theta)))))
    }

    /// Whether the error of the linearisation at an estimate is small beside noise.
    fn is_linear(&self, theta: &[f64]) -> bool {
        let noise: f64 = self.base.variance.iter().flatten().sum();
        let lines = self.base.variance.iter().flatten().count();
        self.missed(theta) * lines as f64 <= MOST_MISSED * noise
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
        let is_used = |j: usize, k: usize| !(cleared && base.is_zero(j, k));
        let mut columns: Vec<Lines> = self.columns.iter().map(|column| column.lines.clone()).collect();
        for (j, lines) in columns.iter_mut().enumerate() {
            for line in lines.iter_mut().flat_map(|lines| lines.iter_mut().enumerate()) {
                if !is_used(j, line.0) {
                    *line.1 = Complex::new(0.0, 0.0);
                }
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
        (columns, error)
    }

    /// `E = M (theta' - theta)`, with the variances where the parameters are about `theta`, beside so many other updates on the same
    /// reference.
    fn equations(&self, theta: &[f64], settings: &Settings, rank: usize, others: usize) -> Equations {
        let NumericalSettings { cleared, reduced, .. } = settings.numerical;
        let base = &self.base;
        // The noise of the perturbed runs, and that of the base, with which all of them were compared.
        let steps = self.way(theta);
        let noise = squares(&remaining(&base.noise, &self.columns, &steps));
        let missed = self.missed(theta);
        // What all updates repeat counts in each as often as there are updates, this one among them.
        let variance = |c: usize, k: usize| {
            let (repeated, own) = base.repeated[c];
            base.variance[c][k] * (noise + own + others as f64 * repeated) + missed
        };
        let (columns, error) = self.calibrated(&steps, cleared, variance);
        let matrix = base.matrix(&columns);
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
        let Some(base) = &self.base else { return current.to_vec() };
        if self.known {
            let update: Vec<f64> = current.iter().zip(&base.parameters).map(|(to, from)| to - from).collect();
            let mut bounded = current.to_vec();
            let excess = base.perturbations.excess(&base.in_steps(&update), &self.columns);
            for (&j, excess) in base.perturbations.parameters.iter().zip(excess) {
                bounded[j] -= excess;
            }
            return self.damping.towards(&bounded);
        }
        let mut changed = base.parameters.clone();
        if self.columns.len() < base.perturbations.count() {
            for (j, change) in base.perturbations.change(self.columns.len()) {
                changed[j] += change;
            }
        }
        changed
    }

    fn take_back(&mut self) -> bool {
        match self.base.as_mut().filter(|_| !self.known) {
            Some(base) => {
                // Half the steps that are still to come.
                base.perturbations.scale(self.columns.len(), 0.5);
                true
            }
            None => self.damping.take_back(),
        }
    }

    fn is_final(&self) -> bool {
        !self.damping.is_damped()
            && self.updates.last().is_some_and(|update| update.fresh && update.is_linear(&self.values))
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
        // Harmonics of open coordinates differ from run to run; those of the base are compared.
        let of_base = self.base.as_ref().filter(|base| base.is_of(run)).map(Base::harmonics);
        let highest = of_base.unwrap_or_else(|| run.highest_harmonic(&self.settings)).min(run.spectra.highest());
        let error = error_lines(run.trial, run.spectra, dims.coordinates, highest);
        self.harmonics = highest;
        let same = |base: &&Base| base.harmonics() == highest && base.is_of(run);
        let perturbs = self.base.as_ref().filter(same).is_some() && !self.known;
        let power = |lines: &Lines| lines.iter().flatten().map(|line| line.norm_sqr()).sum::<f64>();
        let (size, noise) = (power(&error), variances(model, run, highest).iter().flatten().sum::<f64>());
        let better = perturbs || self.damping.judge(run.trial, size, noise);
        let Some(base) = self.base.as_ref().filter(same) else { return self.begin(model, run, error) };
        let (before, carried, fresh) = (power(&base.error), base.is_carried(), base.is_fresh());
        let from = base.parameters.clone();
        if !self.known {
            self.perturbed(&error);
            if !self.known {
                return Ok(());
            }
            self.remember();
        } else if !better {
            self.check_prediction(run, &error);
            // The next run goes less far. Where that helps no more, or the matrix is of another place, it is measured anew.
            if carried || self.damping.is_exhausted() {
                let more = self.bent_more();
                self.bend *= more;
                if let Some(base) = self.base.as_mut() {
                    base.perturbations.scale(0, more.sqrt().recip());
                }
                self.columns.clear();
                self.known = false;
            }
            return Ok(());
        } else {
            self.check_prediction(run, &error);
            let floor = size < LEAST_POWER_DIVISOR * noise;
            let holds = if floor { fresh } else { LEAST_POWER_DIVISOR * size <= before };
            if !self.settings.numerical.secant || !holds {
                return self.begin(model, run, error);
            }
            self.correct(model, run, error.clone());
            self.remember();
            if !floor && !self.contracts(&from)? {
                self.updates.pop();
                return self.begin(model, run, error);
            }
        }
        self.ready = true;
        Ok(())
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        if !self.ready {
            return Ok(None);
        }
        let estimate = self.solve()?;
        self.values.clone_from(&estimate.values);
        Ok(Some(estimate))
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
