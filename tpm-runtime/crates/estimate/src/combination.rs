//! What data show of parameters that they do not show one by one.

use crate::information::set_apart;
use crate::result::Estimate;
use crate::scale::Scale;
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
    /// What the data show of the lead where another parameter has a common scale with it. Value and deviation then are those in the gauge in
    /// which the other one is one, where the deviation is that of the product.
    pub product: Option<Product>,
}

/// A parameter divided by a power of another one: of parameters with a common scale the data show such products alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Product {
    /// The other parameter.
    pub by: usize,
    /// Its power, one for a ratio.
    pub power: f64,
    /// The value of the product.
    pub value: f64,
}

impl Estimate {
    /// The base parameters among what the data do not show one by one: the fewest combinations from which all others that the
    /// data show follow. The parameter that an unobservable direction has for itself leads none of them; it enters those of the others.
    #[must_use]
    pub fn combinations(&self) -> Vec<Combination> {
        let p = self.values.len();
        let directions = set_apart(self.unobservable.clone());
        let lead = |j: &usize| self.status[*j] == Status::Unobservable && directions.iter().all(|(own, _)| own != j);
        let of = |lead: usize| {
            let mut weights = DVector::zeros(p);
            weights[lead] = 1.0;
            for (own, direction) in &directions {
                weights[*own] = -direction[lead];
            }
            let value: f64 = weights.iter().zip(&self.values).map(|(weight, value)| weight * value).sum();
            let std = weights.dot(&(self.covariance.dense() * &weights)).max(0.0).sqrt();
            let scaled = |scale: &&Scale| scale.powers[lead] != 0.0;
            let product = self.scales.iter().find(scaled).and_then(|scale| {
                let by = directions.iter().map(|(own, _)| *own).find(|own| scale.powers[*own] != 0.0)?;
                let power = scale.powers[lead] / scale.powers[by];
                let value = self.values[lead] * self.values[by].powf(-power);
                // A negative number has no root.
                value.is_finite().then_some(Product { by, power, value })
            });
            let gauge = product.map_or(1.0, |own| self.values[own.by].abs().powf(-own.power));
            let weights = weights.as_slice().to_vec();
            Combination { lead, weights, value: gauge * value, std: gauge * std, product }
        };
        (0..p).filter(lead).map(of).collect()
    }
}
