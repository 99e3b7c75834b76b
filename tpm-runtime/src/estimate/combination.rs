//! What data show of parameters that they do not show one by one.

use super::information::reduced;
use super::{Estimate, Status};
use std::vec;
use std::vec::Vec;

/// A combination of parameters that the data show: one that they do not show alone, and others times constants.
#[derive(Clone, Debug, PartialEq)]
pub struct Combination {
    /// The parameter with weight one.
    pub lead: usize,
    /// The weight of every parameter.
    pub weights: Vec<f64>,
    /// Weights times parameters, in the unit of the lead.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

impl Estimate {
    /// The fewest combinations from which all others that the data show follow, of the parameters that they do not show alone
    /// (base parameters): of every direction that they do not show the largest component's parameter goes into the others.
    #[must_use]
    pub fn combinations(&self) -> Vec<Combination> {
        let p = self.values.len();
        let directions = reduced(self.unobservable.clone());
        let pivot = |i: usize| {
            let alone = |j: &usize| directions.iter().enumerate().all(|(o, d)| d[*j] == f64::from(u8::from(o == i)));
            (0..p).find(alone)
        };
        let pivots: Vec<(usize, &Vec<f64>)> =
            directions.iter().enumerate().filter_map(|(i, direction)| Some((pivot(i)?, direction))).collect();
        let lead = |j: &usize| self.status[*j] == Status::Unobservable && pivots.iter().all(|(pivot, _)| pivot != j);
        let of = |lead: usize| {
            let mut weights = vec![0.0; p];
            weights[lead] = 1.0;
            for &(pivot, direction) in &pivots {
                weights[pivot] = -direction[lead];
            }
            let value = weights.iter().zip(&self.values).map(|(weight, value)| weight * value).sum();
            let along = |i: usize| (0..p).map(|j| self.covariance[(i, j)] * weights[j]).sum::<f64>();
            let variance: f64 = weights.iter().enumerate().map(|(i, weight)| weight * along(i)).sum();
            Combination { lead, weights, value, std: variance.max(0.0).sqrt() }
        };
        (0..p).filter(lead).map(of).collect()
    }
}
