//! Levenberg and Marquardt's steps over parameters and the initial states of all blocks.

use crate::recorded::flow::{Flow, Linear};
use crate::recorded::signals::Block;
use rayon::prelude::*;
use tpm_motion::PlantError;
use tpm_numerics::{DMatrix, DVector, patience};

/// Damping at the beginning, and the factors by which it changes.
const FIRST_DAMPING: f64 = 1e-2;
const LESS: f64 = 0.2;
const MORE: f64 = 8.0;
const MOST_DAMPING: f64 = 1e8;
/// Settled when a step gains less than this share of the sum of squares.
const SETTLED: f64 = 1e-8;
/// Most that a parameter moves in one step, in units of its size.
const MOST_MOVE: f64 = 2.0;
/// A state's prior deviation in units of its size: so wide that it holds nothing but states that no reading feels.
const STATE_PRIOR: f64 = 1e4;

/// Parameters, and the state at the beginning of every block.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) theta: Vec<f64>,
    pub(super) states: Vec<Vec<f64>>,
}

/// What is settled: blocks, free parameters, and sizes of what moves.
pub(super) struct Course<'a, 'f> {
    pub(super) flow: &'a Flow<'f>,
    pub(super) blocks: &'a [Block],
    pub(super) free: &'a [usize],
    /// Size of every parameter.
    pub(super) typical: &'a [f64],
    /// Least and largest value of every parameter.
    pub(super) bounds: &'a [[f64; 2]],
    /// Whether differences to one side will do, as on the way from a start.
    pub(super) quick: bool,
}

/// Where steps ended.
#[derive(Clone, Debug)]
pub(super) struct Settled {
    pub(super) point: Point,
    /// Sum of squares in units of the noise.
    pub(super) cost: f64,
    pub(super) steps: usize,
    /// Whether they became small.
    pub(super) done: bool,
}

impl Course<'_, '_> {
    /// Sum of the squares of what is left.
    fn cost(&self, point: &Point, noise: &[f64]) -> Option<f64> {
        let of = |(block, state): (&Block, &Vec<f64>)| {
            let left = self.flow.left(block, &point.theta, state, noise)?;
            Ok(left.iter().map(|e| e * e).sum())
        };
        let blocks: Vec<(&Block, &Vec<f64>)> = self.blocks.iter().zip(&point.states).collect();
        let costs: Result<Vec<f64>, PlantError> = blocks.into_par_iter().map(of).collect();
        costs.ok().map(|costs| costs.iter().sum()).filter(|cost: &f64| cost.is_finite())
    }

    /// All blocks linearised.
    pub(super) fn linearised(&self, point: &Point, noise: &[f64]) -> Result<Vec<Linear>, PlantError> {
        let of = |(block, state): (&Block, &Vec<f64>)| {
            self.flow.linearised(block, (&point.theta, self.free, self.typical), (state, self.quick), noise)
        };
        let blocks: Vec<(&Block, &Vec<f64>)> = self.blocks.iter().zip(&point.states).collect();
        blocks.into_par_iter().map(of).collect()
    }

    /// Makes steps until they are small, at most so many.
    pub(super) fn settle(&self, from: Point, noise: &[f64], most: usize) -> Option<Settled> {
        let mut cost = self.cost(&from, noise)?;
        let (mut point, mut damping, mut small) = (from, FIRST_DAMPING, 0);
        let p = self.free.len();
        let mut scales = vec![0.0_f64; p];
        for steps in 0..most {
            if patience::is_over() {
                return Some(Settled { point, cost, steps, done: false });
            }
            // Beside a point from which the motion leaves all bounds there is no way on.
            let Ok(linear) = self.linearised(&point, noise) else {
                return Some(Settled { point, cost, steps, done: false });
            };
            for (j, scale) in scales.iter_mut().enumerate() {
                let norm: f64 = linear.iter().map(|own| own.by_parameter.column(j).norm_squared()).sum();
                *scale = scale.max(norm.sqrt());
            }
            loop {
                let next = self.moved(&point, &linear, &scales, damping);
                match next.and_then(|next| Some((self.cost(&next, noise)?, next))) {
                    Some((found, next)) if found < cost => {
                        small = if cost - found <= SETTLED * cost { small + 1 } else { 0 };
                        (point, cost) = (next, found);
                        damping *= LESS;
                        break;
                    }
                    _ if damping > MOST_DAMPING => {
                        return Some(Settled { point, cost, steps: steps + 1, done: true });
                    }
                    _ => damping *= MORE,
                }
            }
            if small > 1 || cost <= 0.0 {
                return Some(Settled { point, cost, steps: steps + 1, done: true });
            }
        }
        Some(Settled { point, cost, steps: most, done: false })
    }

    /// The point one damped step further.
    fn moved(&self, point: &Point, linear: &[Linear], scales: &[f64], damping: f64) -> Option<Point> {
        let p = self.free.len();
        let root = damping.sqrt();
        let eliminated: Vec<DMatrix<f64>> = linear.par_iter().map(|own| self.eliminated(own, damping)).collect();
        let mut rows = DMatrix::zeros(eliminated.len() * (p + 1) + p, p + 1);
        let n = self.flow.states.len();
        for (i, own) in eliminated.iter().enumerate() {
            rows.view_mut((i * (p + 1), 0), (p + 1, p + 1)).copy_from(&own.view((n, n), (p + 1, p + 1)));
        }
        for (j, scale) in scales.iter().enumerate() {
            let size = if *scale > 0.0 { *scale } else { 1.0 };
            rows[(eliminated.len() * (p + 1) + j, j)] = root * size;
        }
        let r = rows.qr().r();
        let step = r.view((0, 0), (p, p)).solve_upper_triangular(&r.view((0, p), (p, 1)))?;
        let mut next = point.clone();
        // A parameter moves by so much of its size in one step that its order of magnitude may change, and no more.
        let largest = |(&j, by): (&usize, &f64)| by.abs() / (MOST_MOVE * point.theta[j].abs().max(self.typical[j]));
        let share = self.free.iter().zip(step.iter()).map(largest).fold(1.0, f64::max).recip();
        for (&j, by) in self.free.iter().zip(step.iter()) {
            let [least, largest] = self.bounds[j];
            next.theta[j] = (next.theta[j] + share * by).clamp(least, largest);
        }
        let made = DVector::from_iterator(p, self.free.iter().map(|&j| next.theta[j] - point.theta[j]));
        for (state, own) in next.states.iter_mut().zip(&eliminated) {
            let right = own.view((0, n + p), (n, 1)) * share - own.view((0, n), (n, p)) * &made;
            let by = own.view((0, 0), (n, n)).solve_upper_triangular(&right)?;
            state.iter_mut().zip(by.iter()).for_each(|(value, by)| *value += by);
        }
        next.theta.iter().all(|value| value.is_finite()).then_some(next)
    }

    /// The triangle of a block, initial state first, then parameters, then what is left.
    fn eliminated(&self, own: &Linear, damping: f64) -> DMatrix<f64> {
        let (m, n, p) = (own.left.len(), self.flow.states.len(), self.free.len());
        let mut rows = DMatrix::zeros((m + n).max(n + p + 1), n + p + 1);
        rows.view_mut((0, 0), (m, n)).copy_from(&own.by_state);
        rows.view_mut((0, n), (m, p)).copy_from(&own.by_parameter);
        rows.view_mut((0, n + p), (m, 1)).copy_from_slice(&own.left);
        for s in 0..n {
            let norm = own.by_state.column(s).norm();
            rows[(m + s, s)] = (damping.sqrt() * norm).hypot(1.0 / (STATE_PRIOR * self.flow.sizes[s]));
        }
        rows.qr().r()
    }
}

/// The derivatives by the first `kept` parameters with what the others take of them out of them; `sizes` are deviations that the others are known
/// to have beforehand.
pub(super) fn beside_others(rows: Vec<DMatrix<f64>>, kept: usize, sizes: &[f64]) -> Vec<DMatrix<f64>> {
    let others = sizes.len();
    if others == 0 {
        return rows;
    }
    let mut normal = DMatrix::from_diagonal(&DVector::from_iterator(others, sizes.iter().map(|size| size.powi(-2))));
    let mut beside = DMatrix::zeros(others, kept);
    for own in &rows {
        let of_others = own.columns(kept, others);
        normal += of_others.tr_mul(&of_others);
        beside += of_others.tr_mul(&own.columns(0, kept));
    }
    let taken = normal.cholesky().map_or_else(|| DMatrix::zeros(others, kept), |root| root.solve(&beside));
    rows.iter().map(|own| own.columns(0, kept) - own.columns(kept, others) * &taken).collect()
}

/// The derivatives by the parameters with what the initial state takes of them out of them, block by block.
pub(super) fn beside_states(linear: &[Linear], sizes: &[f64]) -> Vec<DMatrix<f64>> {
    let of = |own: &Linear| {
        let n = own.by_state.ncols();
        let mut normal = own.by_state.tr_mul(&own.by_state);
        for s in 0..n {
            normal[(s, s)] += (STATE_PRIOR * sizes[s]).powi(-2);
        }
        let taken = normal.cholesky().map(|root| root.solve(&own.by_state.tr_mul(&own.by_parameter)));
        match taken {
            Some(taken) => &own.by_parameter - &own.by_state * taken,
            None => own.by_parameter.clone(),
        }
    };
    linear.iter().map(of).collect()
}
