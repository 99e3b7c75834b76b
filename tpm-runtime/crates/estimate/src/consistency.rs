//! Which runs of a campaign agree with each other.
//!
//! Every run gives an estimate of its own, with its own covariance, which contains the model's error. Runs are independent, so that the
//! difference between a run and the pool of the others has the sum of both covariances. Its square in the metric of that sum, over the
//! combinations of parameters that both show, follows F: the model's error is estimated from the residuals that a run has beyond its
//! parameters, often a dozen.
//!
//! Invariant: all runs are judged anew whenever one comes in, by one rule. A set of runs is consistent when each of its runs agrees
//! with the pool of the others. A set begins with one run and takes in, in their order, all runs with which it stays consistent. The
//! largest set is the pool of the campaign; among sets of equal size the one that begins with the earliest run. A run that came first
//! is therefore left out once more runs agree without it (`DESIGN.md`, "Why may a run be left out of a campaign?").

use crate::result::Estimate;
use tpm_numerics::chance::deviation_by_residuals;
use tpm_numerics::singular::complement;
use tpm_numerics::{Cholesky, DMatrix, DVector, alarm};

/// Smallest standard deviation of a run's estimate, as a share of the value. Integration steps of a simulation and the transient
/// that is left in a spectrum bound what noise does not.
const LEAST_RELATIVE_DEVIATION: f64 = 1e-6;

/// A run that an estimate leaves out, since it contradicts the runs that are pooled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Index of the run among those that the estimator has reduced, from 0.
    pub run: usize,
    /// Index of the parameter that differs most from the pool.
    pub parameter: usize,
    /// Its difference, in standard deviations of the difference.
    pub deviations: f64,
}

/// The runs of a campaign, judged.
#[derive(Clone, Debug, Default)]
pub(super) struct Consistency {
    /// What every run says alone, and the residuals that it has beyond its parameters.
    own: Vec<(Estimate, usize)>,
    members: Vec<bool>,
    left_out: Vec<LeftOut>,
}

impl Consistency {
    /// For every run, whether it is pooled.
    pub(super) fn members(&self) -> &[bool] {
        &self.members
    }

    /// The runs that are not pooled.
    pub(super) fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// Adds the estimate that a further run gives alone and judges all runs anew. `residuals` is the number of residuals that this run
    /// has beyond its parameters.
    pub(super) fn push(&mut self, own: Estimate, residuals: usize) {
        self.own.push((own, residuals));
        self.judge();
    }

    /// Forgets all runs behind the first `runs`.
    pub(super) fn truncate(&mut self, runs: usize) {
        if runs < self.own.len() {
            self.own.truncate(runs);
            self.judge();
        }
    }

    fn judge(&mut self) {
        let runs = statements(&self.own);
        let mut best: Vec<usize> = (0..runs.len()).collect();
        if !is_consistent(&runs, &best) {
            best = Vec::new();
            for first in 0..runs.len() {
                let set = grown(&runs, first);
                if set.len() > best.len() {
                    best = set;
                }
            }
        }
        self.members = (0..runs.len()).map(|run| best.contains(&run)).collect();
        let pool = pooled(&runs, &best);
        let outside = (0..runs.len()).filter(|run| !best.contains(run));
        self.left_out = outside
            .map(|run| {
                let (parameter, deviations) = pool.difference(&runs[run]).map_or((0, 0.0), |found| found.largest());
                LeftOut { run, parameter, deviations }
            })
            .collect();
    }
}

/// Whether each run of a set agrees with the pool of the others.
fn is_consistent(runs: &[Statement], set: &[usize]) -> bool {
    set.len() < 2
        || set.iter().all(|run| {
            let others: Vec<usize> = set.iter().copied().filter(|other| other != run).collect();
            let difference = pooled(runs, &others).difference(&runs[*run]);
            difference.is_none_or(|difference| difference.is_chance())
        })
}

/// The set of runs that begins with one of them and takes in, in their order, all with which it stays consistent.
fn grown(runs: &[Statement], first: usize) -> Vec<usize> {
    let mut set = vec![first];
    for run in (0..runs.len()).filter(|&run| run != first) {
        set.push(run);
        if !is_consistent(runs, &set) {
            set.pop();
        }
    }
    set
}

/// What one run, or the pool of several, says about the parameters, each divided by a scale that all runs have in common.
#[derive(Clone, Debug)]
struct Statement {
    values: DVector<f64>,
    /// Covariance of the values along what is shown.
    covariance: DMatrix<f64>,
    /// An orthonormal basis, by columns, of the combinations that are shown.
    shown: DMatrix<f64>,
    /// Residuals from which the covariance was read.
    residuals: usize,
}

/// The runs' own estimates as statements.
fn statements(own: &[(Estimate, usize)]) -> Vec<Statement> {
    let p = own.first().map_or(0, |(estimate, _)| estimate.values.len());
    // An estimate that is not finite says nothing; a parameter without a deviation is held, or at a bound.
    let variance =
        |estimate: &Estimate, j: usize| Some(estimate.covariance[(j, j)]).filter(|v| v.is_finite() && *v > 0.0);
    let scale: Vec<f64> = (0..p)
        .map(|j| own.iter().filter_map(|(estimate, _)| variance(estimate, j)).fold(0.0, f64::max).sqrt())
        .map(|scale| if scale > 0.0 { scale } else { 1.0 })
        .collect();
    let of = |(estimate, residuals): &(Estimate, usize)| {
        let told: Vec<bool> = (0..p).map(|j| variance(estimate, j).is_some()).collect();
        let untold = (0..p).filter(|&j| !told[j]).map(|j| DVector::from_fn(p, |i, _| if i == j { 1.0 } else { 0.0 }));
        let directions = estimate.unobservable.iter().map(|d| DVector::from_fn(p, |j, _| d[j] / scale[j]));
        let hidden: Vec<DVector<f64>> = untold.chain(directions).filter(|direction| direction.norm() > 0.0).collect();
        let shown = orthogonal_to(&hidden, p);
        let covariance = DMatrix::from_fn(p, p, |r, c| {
            let floor = if r == c { (LEAST_RELATIVE_DEVIATION * estimate.values[r]).powi(2) } else { 0.0 };
            let shown = if told[r] && told[c] { estimate.covariance[(r, c)] } else { 0.0 };
            (shown + floor) / (scale[r] * scale[c])
        });
        let values = DVector::from_fn(p, |j, _| estimate.values[j] / scale[j]);
        Statement { values, covariance, shown, residuals: *residuals }
    };
    own.iter().map(of).collect()
}

/// What some of the runs say together: their mean, weighted by information.
fn pooled(runs: &[Statement], set: &[usize]) -> Statement {
    let p = runs.first().map_or(0, |run| run.values.len());
    let mut information = DMatrix::zeros(p, p);
    let mut right = DVector::zeros(p);
    let mut columns = Vec::new();
    for &run in set {
        let Statement { values, covariance, shown, .. } = &runs[run];
        let Some(own) = inverse(shown.tr_mul(&(covariance * shown))) else { continue };
        let own = shown * own * shown.transpose();
        right += &own * values;
        information += own;
        columns.extend(columns_of(shown));
    }
    // What no run shows is orthogonal to what any of them shows.
    let hidden = orthogonal_to(&columns, p);
    let shown = orthogonal_to(&columns_of(&hidden).collect::<Vec<_>>(), p);
    let covariance = inverse(shown.tr_mul(&(&information * &shown)));
    let covariance = covariance.map_or_else(|| DMatrix::zeros(p, p), |own| &shown * own * shown.transpose());
    let residuals = set.iter().map(|&run| runs[run].residuals).sum();
    Statement { values: &covariance * right, covariance, shown, residuals }
}

/// An orthonormal basis, by columns, of the vectors of `p` components that are orthogonal to all of `columns`, of which there may be
/// none.
fn orthogonal_to(columns: &[DVector<f64>], p: usize) -> DMatrix<f64> {
    if columns.is_empty() { DMatrix::identity(p, p) } else { complement(&DMatrix::from_columns(columns)) }
}

fn columns_of(matrix: &DMatrix<f64>) -> impl Iterator<Item = DVector<f64>> + '_ {
    matrix.column_iter().map(|column| column.into_owned())
}

fn inverse(matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    Cholesky::new(matrix).map(|factor| factor.inverse())
}

/// The difference of two independent statements, along what both show.
struct Difference {
    values: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Square of the difference in the metric of its covariance.
    square: f64,
    freedom: usize,
    residuals: usize,
}

impl Statement {
    /// The difference of this statement and another; nothing when there is no combination that both show.
    fn difference(&self, other: &Statement) -> Option<Difference> {
        let p = self.values.len();
        let hidden = [&self.shown, &other.shown].map(complement);
        let both = orthogonal_to(&hidden.iter().flat_map(columns_of).collect::<Vec<_>>(), p);
        let values = both.tr_mul(&(&other.values - &self.values));
        let covariance = both.tr_mul(&((&self.covariance + &other.covariance) * &both));
        let weights = inverse(covariance.clone()).filter(|_| both.ncols() > 0)?;
        let square = values.dot(&(weights * &values));
        let whole = |part: DMatrix<f64>| &both * part * both.transpose();
        Some(Difference {
            values: &both * values,
            covariance: whole(covariance),
            square,
            freedom: both.ncols(),
            residuals: self.residuals.min(other.residuals),
        })
    }
}

impl Difference {
    /// Whether chance makes a difference of this size.
    fn is_chance(&self) -> bool {
        deviation_by_residuals(self.square, self.freedom, self.residuals)
            .is_none_or(|deviation| deviation <= alarm::RUNS_CONTRADICT)
    }

    /// The parameter that differs most, and its difference in standard deviations.
    fn largest(&self) -> (usize, f64) {
        let of = |j: usize| {
            let variance = self.covariance[(j, j)];
            if variance > 0.0 { self.values[j].abs() / variance.sqrt() } else { 0.0 }
        };
        (0..self.values.len()).map(|j| (j, of(j))).fold((0, 0.0), |most, now| if now.1 > most.1 { now } else { most })
    }
}

#[cfg(test)]
mod tests {
    use super::Consistency;
    use crate::result::Estimate;
    use crate::verdict::Status;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use tpm_numerics::{DMatrix, Matrix};

    fn estimate(values: &[f64], std: &[f64], unobservable: Vec<Vec<f64>>) -> Estimate {
        let p = values.len();
        Estimate {
            values: values.to_vec(),
            std: std.to_vec(),
            covariance: Matrix::of(DMatrix::from_fn(p, p, |r, c| if r == c { std[r] * std[r] } else { 0.0 })),
            status: vec![Status::Identified; p],
            rank: p - unobservable.len(),
            unobservable,
            scales: Vec::new(),
            condition: 1.0,
            residual: 0.0,
            residual_of: crate::ResidualOf::Force,
            chi_squared: 1.0,
            model_error: vec![],
        }
    }

    /// Runs of two parameters, the first of which has these values.
    fn judged(values: &[f64]) -> Vec<bool> {
        let mut runs = Consistency::default();
        values.iter().for_each(|&value| runs.push(estimate(&[value, 3.0], &[0.01, 1e-4], vec![]), 1000));
        runs.members().to_vec()
    }

    #[test]
    fn the_largest_set_of_runs_that_agree_is_pooled() {
        assert_eq!(judged(&[2.0]), [true]);
        assert_eq!(judged(&[2.0, 2.01]), [true, true]);
        // Of two that contradict each other the later one is left out, until a third one agrees with it.
        assert_eq!(judged(&[2.0, 2.2]), [true, false]);
        assert_eq!(judged(&[2.0, 2.2, 2.21]), [false, true, true]);
        assert_eq!(judged(&[2.0, 2.2, 1.99]), [true, false, true]);
        assert_eq!(judged(&[2.0, 2.2, 2.01, 2.21]), [true, false, true, false]);
        assert_eq!(judged(&[2.0, 2.2, 2.4]), [true, false, false]);
    }

    #[test]
    fn a_run_that_says_little_agrees_with_whatever_the_others_say() {
        let mut runs = Consistency::default();
        runs.push(estimate(&[1.0, 3.0], &[1.0, 1e-4], vec![]), 1000);
        for value in [2.0, 2.2, 2.201] {
            runs.push(estimate(&[value, 3.0], &[0.01, 1e-4], vec![]), 1000);
        }
        assert_eq!(runs.members(), [true, false, true, true]);
        let left_out = runs.left_out()[0];
        assert_eq!((left_out.run, left_out.parameter), (1, 0));
        assert!((15.0..18.0).contains(&left_out.deviations), "{left_out:?}");
        runs.truncate(3);
        assert_eq!(runs.members(), [true, true, false]);
    }

    #[test]
    fn runs_are_compared_along_what_both_show() {
        // The first run shows the sum of the parameters alone, and the second one the first parameter alone.
        let sum = |value: f64| estimate(&[value, 0.0], &[0.01, 0.01], vec![vec![1.0, -1.0]]);
        let one = |value: f64| estimate(&[value, 0.0], &[0.01, 0.0], vec![vec![0.0, 1.0]]);
        let judged = |estimates: Vec<Estimate>| {
            let mut runs = Consistency::default();
            estimates.into_iter().for_each(|estimate| runs.push(estimate, 1000));
            runs.members().to_vec()
        };
        assert_eq!(judged(vec![sum(5.0), one(2.0)]), [true, true]);
        assert_eq!(judged(vec![sum(5.0), one(2.0), one(2.5)]), [true, true, false]);
        let both = |a: f64, b: f64| estimate(&[a, b], &[0.01, 0.01], vec![]);
        assert_eq!(judged(vec![sum(5.0), one(2.0), both(2.0, 3.0)]), [true, true, true]);
        assert_eq!(judged(vec![sum(5.0), one(2.0), both(2.0, 3.2)]), [true, true, false]);
        // A parameter that is held differs in nothing.
        let held = |value: f64| estimate(&[value, 1.0], &[0.01, 0.0], vec![]);
        assert_eq!(judged(vec![held(2.0), held(2.01)]), [true, true]);
    }

    #[test]
    fn one_right_run_in_a_thousand_is_left_out() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let (mut left_out, campaigns, length) = (0, 3000, 6);
        for _ in 0..campaigns {
            let mut runs = Consistency::default();
            for run in 0..length {
                let std = [0.3 / (1.0 + f64::from(run)), 2.0, 0.1];
                let values: Vec<f64> = std.iter().map(|std| 5.0 + std * normal()).collect();
                runs.push(estimate(&values, &std, vec![]), 1000);
            }
            left_out += runs.left_out().len();
        }
        let rate = left_out as f64 / f64::from(campaigns * length);
        assert!((3e-4..1.5e-3).contains(&rate), "{rate}");
    }
}
