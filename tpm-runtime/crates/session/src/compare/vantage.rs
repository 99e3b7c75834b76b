//! What a result shows: linear combinations of parameters, with their values and joint covariance.
//!
//! Invariant: the entries are the parameters that have a value and a deviation, each by itself, and the combinations of those
//! that do not show one by one. Every other combination that the result shows is a linear combination of entries.

use crate::compare::stored::{Covariance, StoredCombination, StoredParameter, StoredResult};
use std::collections::BTreeMap;
use tpm_numerics::{DMatrix, DVector, Matrix, tolerance};

/// Weights of a combination, by parameter.
pub(crate) type Weights = BTreeMap<String, f64>;

/// What a result shows of its parameters.
pub(super) struct Vantage<'a> {
    parameters: &'a [StoredParameter],
    /// Index of the parameters that are entries by themselves.
    alone: Vec<usize>,
    /// Weights of the combinations that are entries, and the parameter by which each is recognised: it stands in no other one.
    together: Vec<(Weights, String)>,
    values: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl<'a> Vantage<'a> {
    /// What a result shows of the parameters in which its model is linear.
    pub(super) fn linear(result: &'a StoredResult) -> Self {
        let with = &result.combination_covariance;
        // Files of the first schema do not say how combinations go together, so that these cannot be tested jointly.
        let combinations = if with.is_empty() { &[][..] } else { &result.combinations };
        Self::new(&result.parameters, &result.covariance, combinations, with)
    }

    /// What a result shows of the physical parameters behind lumped ones.
    pub(super) fn physical(result: &'a StoredResult) -> Self {
        Self::new(&result.physical, &result.physical_covariance, &[], &Vec::new())
    }

    fn new(
        parameters: &'a [StoredParameter],
        covariance: &Covariance,
        combinations: &[StoredCombination],
        with: &Covariance,
    ) -> Self {
        let shown = |parameter: &StoredParameter| parameter.value.is_some() && parameter.std.is_some();
        let alone: Vec<usize> = (0..parameters.len()).filter(|&j| shown(&parameters[j])).collect();
        let weights = |shown: &StoredCombination| -> Option<Weights> {
            shown.terms.iter().map(|(name, weight)| Some((name.clone(), weight.parse().ok()?))).collect()
        };
        let all: Vec<Option<Weights>> = combinations.iter().map(weights).collect();
        let lead = |own: usize, weights: &Weights| {
            let elsewhere = |name: &String| {
                all.iter()
                    .enumerate()
                    .any(|(k, other)| k != own && other.as_ref().is_some_and(|w| w.contains_key(name)))
            };
            weights.iter().find(|(name, weight)| **weight != 0.0 && !elsewhere(name)).map(|(name, _)| name.clone())
        };
        let (mut together, mut kept) = (Vec::new(), Vec::new());
        for (k, weights) in all.iter().enumerate() {
            if let Some((weights, lead)) = weights.as_ref().and_then(|weights| Some((weights, lead(k, weights)?))) {
                together.push((weights.clone(), lead));
                kept.push(k);
            }
        }
        let values = alone.iter().filter_map(|&j| parameters[j].value);
        let values: Vec<f64> = values.chain(kept.iter().map(|&k| combinations[k].value)).collect();
        let (n, p) = (alone.len(), parameters.len());
        let entry = |covariance: &Covariance, r: usize, c: usize| covariance.get(r)?.get(c).copied().flatten();
        let covariance = DMatrix::from_fn(values.len(), values.len(), |r, c| match (r < n, c < n) {
            // Without a covariance deviations are all that is known.
            (true, true) if covariance.is_empty() => {
                let std = parameters[alone[r]].std.unwrap_or(0.0);
                if r == c { std * std } else { 0.0 }
            }
            (true, true) => entry(covariance, alone[r], alone[c]).unwrap_or(0.0),
            (true, false) => entry(with, kept[c - n], alone[r]).unwrap_or(0.0),
            (false, true) => entry(with, kept[r - n], alone[c]).unwrap_or(0.0),
            (false, false) => entry(with, kept[r - n], p + kept[c - n]).unwrap_or(0.0),
        });
        Vantage { parameters, alone, together, values: DVector::from_vec(values), covariance }
    }

    /// The parameters of the result.
    pub(super) const fn parameters(&self) -> &'a [StoredParameter] {
        self.parameters
    }

    /// The parameter of a name.
    pub(super) fn parameter(&self, name: &str) -> Option<&'a StoredParameter> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// A combination in terms of the entries; nothing when the result does not show it.
    pub(super) fn coefficients(&self, wanted: &Weights) -> Option<DVector<f64>> {
        let mut rest = wanted.clone();
        let mut sizes: BTreeMap<&str, f64> = BTreeMap::new();
        for (name, weight) in wanted {
            self.parameter(name)?;
            sizes.insert(name, weight.abs());
        }
        let mut found = vec![0.0; self.values.len()];
        for (k, (weights, lead)) in self.together.iter().enumerate() {
            let factor = rest.get(lead).copied().unwrap_or(0.0) / weights[lead];
            if factor == 0.0 {
                continue;
            }
            found[self.alone.len() + k] = factor;
            for (name, weight) in weights {
                *rest.entry(name.clone()).or_default() -= factor * weight;
                *sizes.entry(name).or_default() += (factor * weight).abs();
            }
        }
        for (at, &j) in self.alone.iter().enumerate() {
            found[at] = rest.remove(&self.parameters[j].name).unwrap_or(0.0);
        }
        let nothing_left = rest.iter().all(|(name, left)| left.abs() <= tolerance::STORED * sizes[name.as_str()]);
        nothing_left.then(|| DVector::from_vec(found))
    }

    /// The value of a combination that is given in terms of the entries.
    pub(super) fn value(&self, coefficients: &DVector<f64>) -> f64 {
        coefficients.dot(&self.values)
    }

    /// The covariance of two combinations that are given in terms of the entries.
    pub(super) fn covariance(&self, one: &DVector<f64>, other: &DVector<f64>) -> f64 {
        one.dot(&(&self.covariance * other))
    }

    /// The weights of the combinations that are entries.
    pub(super) fn combinations(&self) -> impl Iterator<Item = &Weights> {
        self.together.iter().map(|(weights, _)| weights)
    }
}

impl StoredResult {
    /// What the result shows: parameters and combinations, as weights by parameter, their values, and their covariance.
    pub fn entries(&self) -> (Vec<Weights>, Vec<f64>, Matrix) {
        let Vantage { parameters, alone, together, values, covariance } = Vantage::linear(self);
        let alone = alone.iter().map(|&j| Weights::from([(parameters[j].name.clone(), 1.0)]));
        let weights = alone.chain(together.into_iter().map(|(weights, _)| weights)).collect();
        (weights, values.as_slice().to_vec(), Matrix::of(covariance))
    }
}
