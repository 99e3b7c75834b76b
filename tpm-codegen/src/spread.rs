//! How far off the base parameters of an identified machine may be: a square root of their covariance, from the result's.
//!
//! A result states covariances of the parameters that the data show, and of the combinations that they show of the others. A base parameter
//! that is a sum of multiples of these has a covariance; where one is not, there is none at all.

use crate::identified::{Identified, IdentifiedParameter, Weights};

/// The share of a base parameter that may be left beside the combinations: their weights are rounded to text.
const LEFT: f64 = 1e-6;

impl Identified {
    /// A lower triangular S with S S^T the covariance of weighted sums of parameters; nothing where the result does not tell one of them.
    pub(crate) fn spread(&self, sums: &[Weights]) -> Option<Vec<Vec<f64>>> {
        let count = self.parameters.len();
        let known = count + self.combinations.len();
        let hidden = Hidden::of_result(self);
        let factors: Vec<Vec<f64>> = sums.iter().map(|sum| self.factors(sum, &hidden)).collect::<Option<_>>()?;
        let entry = |i: usize, j: usize| -> Option<f64> {
            let (i, j) = (i.max(j), i.min(j));
            match i.checked_sub(count) {
                Some(row) => *self.combination_covariance.get(row)?.get(j)?,
                None => *self.covariance.get(i)?.get(j)?,
            }
        };
        let between = |a: &[f64], b: &[f64]| -> Option<f64> {
            let mut sum = 0.0;
            for i in (0..known).filter(|&i| a[i] != 0.0) {
                for j in (0..known).filter(|&j| b[j] != 0.0) {
                    sum += a[i] * b[j] * entry(i, j)?;
                }
            }
            Some(sum)
        };
        let mut root: Vec<Vec<f64>> = Vec::with_capacity(sums.len());
        for (i, own) in factors.iter().enumerate() {
            let mut row = vec![0.0; sums.len()];
            for j in 0..=i {
                let covariance = between(own, &factors[j])?;
                let done: f64 = (0..j).map(|k| row[k] * if j == i { row[k] } else { root[j][k] }).sum();
                row[j] = match j == i {
                    // A factor that is a combination of earlier ones has no variance left, and rounding may make it negative.
                    true => (covariance - done).max(0.0).sqrt(),
                    false if root[j][j] > 1e-7 * between(&factors[j], &factors[j])?.sqrt() => {
                        (covariance - done) / root[j][j]
                    }
                    false => 0.0,
                };
            }
            root.push(row);
        }
        root.iter().flatten().all(|entry| entry.is_finite()).then_some(root)
    }

    /// The factors of parameters and then of combinations whose sum is a weighted sum of parameters: the parameters that have a value by
    /// themselves, the others by combinations.
    fn factors(&self, sum: &Weights, hidden: &Hidden<'_>) -> Option<Vec<f64>> {
        let mut lacking = hidden.of(sum, vec![0.0; self.combinations.len()]);
        if lacking.clear(&hidden.basis) {
            return None;
        }
        let shares = |name: &str| -> f64 {
            let combinations = self.combinations.iter().zip(&lacking.factors);
            combinations.map(|(own, lacking)| lacking * weight(&own.terms, name)).sum()
        };
        let of = |one: &IdentifiedParameter| match one.value {
            Some(_) => weight(sum, &one.name) + shares(&one.name),
            None => 0.0,
        };
        let parameters = self.parameters.iter().map(of);
        Some(parameters.chain(lacking.factors.iter().map(|lacking| -lacking)).collect())
    }
}

/// The parameters that have no value by themselves, and what the combinations say of them.
struct Hidden<'a> {
    names: Vec<&'a str>,
    /// Orthonormal hidden parts of combinations.
    basis: Vec<Part>,
}

/// The hidden part of a sum, with the combinations that make it up.
struct Part {
    values: Vec<f64>,
    factors: Vec<f64>,
}

impl<'a> Hidden<'a> {
    fn of_result(result: &'a Identified) -> Self {
        let unknown = result.parameters.iter().filter(|one| one.value.is_none());
        let names = unknown.map(|one| one.name.as_str()).collect();
        let mut hidden = Hidden { names, basis: Vec::new() };
        for (index, combination) in result.combinations.iter().enumerate() {
            let mut factors = vec![0.0; result.combinations.len()];
            factors[index] = 1.0;
            let mut part = hidden.of(&combination.terms, factors);
            if part.clear(&hidden.basis) {
                let length = size(&part.values);
                part.values.iter_mut().chain(&mut part.factors).for_each(|value| *value /= length);
                hidden.basis.push(part);
            }
        }
        hidden
    }

    fn of(&self, sum: &Weights, factors: Vec<f64>) -> Part {
        Part { values: self.names.iter().map(|name| weight(sum, name)).collect(), factors }
    }
}

impl Part {
    /// Takes out what lies along a basis (modified Gram-Schmidt), and says whether more than rounding is left.
    fn clear(&mut self, basis: &[Part]) -> bool {
        let before = size(&self.values);
        for other in basis {
            let along: f64 = other.values.iter().zip(&self.values).map(|(a, b)| a * b).sum();
            self.values.iter_mut().zip(&other.values).for_each(|(value, other)| *value -= along * other);
            self.factors.iter_mut().zip(&other.factors).for_each(|(factor, other)| *factor -= along * other);
        }
        size(&self.values) > LEFT * before
    }
}

fn weight(weights: &Weights, name: &str) -> f64 {
    weights.get(name).copied().unwrap_or(0.0)
}

fn size(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use crate::identified::{Identified, IdentifiedCombination, IdentifiedParameter, Weights};

    #[test]
    fn sums_of_shown_parameters_and_of_combinations_have_a_covariance() {
        let weights = |terms: &[(&str, f64)]| -> Weights { terms.iter().map(|(n, w)| ((*n).to_owned(), *w)).collect() };
        let one = |name: &str, value: Option<f64>| IdentifiedParameter {
            name: name.to_owned(),
            value,
            ..IdentifiedParameter::default()
        };
        let result = Identified {
            parameters: vec![one("a", Some(1.0)), one("b", None), one("c", None)],
            combinations: vec![IdentifiedCombination {
                terms: weights(&[("a", 1.0), ("b", 1.0), ("c", 2.0)]),
                value: 3.0,
                std: 0.2,
            }],
            covariance: vec![vec![Some(0.01), None, None], vec![None; 3], vec![None; 3]],
            combination_covariance: vec![vec![Some(0.006), None, None, Some(0.04)]],
            ..Identified::default()
        };
        // b + 2 c is the combination less a, and 2 b + 4 c + a its double less a.
        let sums = [weights(&[("b", 1.0), ("c", 2.0)]), weights(&[("a", 1.0), ("b", 2.0), ("c", 4.0)])];
        let root = result.spread(&sums).expect("told");
        let covariance = |i: usize, j: usize| root[i].iter().zip(&root[j]).map(|(a, b)| a * b).sum::<f64>();
        let wanted = [[0.04 - 0.012 + 0.01, 0.08 - 0.018 + 0.01], [0.0, 0.16 - 0.024 + 0.01]];
        for (i, j) in [(0, 0), (0, 1), (1, 1)] {
            assert!((covariance(i, j) - wanted[i][j]).abs() < 1e-15, "{i} {j}: {} {root:?}", covariance(i, j));
        }
        assert!(result.spread(&[weights(&[("b", 1.0)])]).is_none(), "the data do not show b alone");
    }
}
