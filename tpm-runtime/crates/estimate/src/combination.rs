//! What data show of parameters that they do not show one by one.

use crate::information::set_apart;
use crate::result::Estimate;
use crate::verdict::Status;
use tpm_numerics::DVector;

/// A combination of parameters that the data show: one that they do not show alone, and others times constants.
#[derive(Clone, Debug, PartialEq)]
pub struct Combination {
    /// The parameter with weight one.
    pub lead: usize,
    /// The weight of every parameter.
    pub weights: Vec<f64>,
    /// Weights times parameters, in the unit of the lead.
    pub value: f64,
    /// Standard deviation of the value.
    pub std: f64,
    /// What the lead is to another parameter, where the data show that ratio alone: the other one, and the ratio. The value then is zero, and
    /// the deviation is that of the ratio.
    pub ratio: Option<(usize, f64)>,
}

impl Estimate {
    /// The base parameters among what the data do not show one by one: the fewest combinations from which all others that the
    /// data show follow. The parameter that an unobservable direction has for itself leads none of them; it enters those of the others.
    #[must_use]
    pub fn combinations(&self) -> Vec<Combination> {
        let p = self.values.len();
        let scales = self.sets();
        let directions = set_apart(self.unobservable.clone());
        let lead = |j: &usize| self.status[*j] == Status::Unobservable && directions.iter().all(|(own, _)| own != j);
        let of = |lead: usize| {
            let mut weights = DVector::zeros(p);
            weights[lead] = 1.0;
            for (own, direction) in &directions {
                weights[*own] = -direction[lead];
            }
            let value = weights.iter().zip(&self.values).map(|(weight, value)| weight * value).sum();
            let std = weights.dot(&(self.covariance.dense() * &weights)).max(0.0).sqrt();
            let ratio = (scales.iter().find(|scale| scale.members.contains(&lead)))
                .map(|scale| (scale.own, self.values[lead] / self.values[scale.own]));
            let weights = weights.as_slice().to_vec();
            match ratio {
                Some((own, _)) => Combination { lead, weights, value: 0.0, std: std / self.values[own].abs(), ratio },
                None => Combination { lead, weights, value, std, ratio },
            }
        };
        (0..p).filter(lead).map(of).collect()
    }
}
