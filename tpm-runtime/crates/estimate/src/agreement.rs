//! Which of several records of one machine agree, and by what the others differ.
//!
//! Records that contradict each other are of different machines, loads or settings, and nothing in one of them says which is meant. Where
//! more than half of them agree with each other, and no other half would, the rest is odd. An odd record often differs in one thing
//! alone: a gain, a unit or a scale of its input, by which everything that it tells is a common multiple of what the others tell.

use crate::error::EstimateError;
use crate::pooled::{Pooled, pool};
use crate::result::Estimate;
use crate::settings::Settings;
use serde::Serialize;
use tpm_numerics::tail::chi_squared_upper;
use tpm_numerics::{Cholesky, DMatrix, DVector, Iteration, alarm};

/// The factor is found to this share of itself.
const FACTOR: Iteration = Iteration { most: 50, settled: 1e-12 };

/// One factor between what a record tells and what others tell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CommonFactor {
    /// Every value of the record, as a multiple of that of the others.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

/// Whether no record differs from the others together by more than chance.
fn agree(found: &Pooled) -> bool {
    let all = found.contributions.iter().flat_map(|own| own.deviations.iter().flatten());
    all.fold(0.0_f64, |worst, own| worst.max(own.abs())) <= alarm::LOGS_CONTRADICT
}

/// The records that agree together, and the indices of those that contradict this majority; all records together where they agree, or
/// where no majority of them does, or not one alone.
///
/// # Errors
/// As [`pool`].
pub fn pool_majority(estimates: &[&Estimate], settings: &Settings) -> Result<(Pooled, Vec<usize>), EstimateError> {
    let of = |kept: &[usize]| pool(&kept.iter().map(|&i| estimates[i]).collect::<Vec<_>>(), settings);
    let mut kept: Vec<usize> = (0..estimates.len()).collect();
    let all = of(&kept)?;
    let (mut found, mut odd) = (all.clone(), Vec::new());
    while !agree(&found) {
        // What is kept must be more than half of all.
        if 2 * (kept.len() - 1) <= estimates.len() {
            return Ok((all, Vec::new()));
        }
        let without: Vec<(usize, Pooled)> = kept
            .iter()
            .map(|&left_out| {
                let rest: Vec<usize> = kept.iter().copied().filter(|&i| i != left_out).collect();
                Ok((left_out, of(&rest)?))
            })
            .collect::<Result<_, EstimateError>>()?;
        // Two ways to agree say that nobody knows which record is odd.
        if without.iter().filter(|(_, rest)| agree(rest)).count() > 1 {
            return Ok((all, Vec::new()));
        }
        let least = without.into_iter().min_by(|a, b| a.1.chi_squared.total_cmp(&b.1.chi_squared));
        let Some((worst, rest)) = least else { break };
        kept.retain(|i| *i != worst);
        odd.push(worst);
        found = rest;
    }
    odd.sort_unstable();
    Ok((found, odd))
}

/// The factor by which everything that a record tells is a multiple of what others tell, where one factor explains the whole difference
/// and is not one; at least two parameters must be told by both.
#[must_use]
pub fn common_factor(odd: &Estimate, others: &Estimate) -> Option<CommonFactor> {
    let told = |estimate: &Estimate, j: usize| estimate.std[j].is_finite() && estimate.std[j] > 0.0;
    let both: Vec<usize> = (0..odd.values.len()).filter(|&j| told(odd, j) && told(others, j)).collect();
    let n = both.len();
    if n < 2 {
        return None;
    }
    // In deviations, so that no unit matters.
    let scale = |r: usize| odd.std[both[r]].max(others.std[both[r]]);
    let values = |of: &Estimate| DVector::from_fn(n, |r, _| of.values[both[r]] / scale(r));
    let covariance =
        |of: &Estimate| DMatrix::from_fn(n, n, |r, c| of.covariance[(both[r], both[c])] / (scale(r) * scale(c)));
    let (own, rest) = (values(odd), values(others));
    let (own_covariance, rest_covariance) = (covariance(odd), covariance(others));
    let (mut factor, mut std, mut left) = (1.0_f64, f64::INFINITY, f64::INFINITY);
    for _ in 0..FACTOR.most {
        let weights = Cholesky::new(&own_covariance + &rest_covariance * (factor * factor))?.inverse();
        let power = rest.dot(&(&weights * &rest));
        let next = rest.dot(&(&weights * &own)) / power;
        let moved = (next - factor).abs();
        (factor, std) = (next, power.sqrt().recip());
        let missing = &own - &rest * factor;
        left = missing.dot(&(&weights * &missing));
        if moved <= FACTOR.settled * factor.abs() {
            break;
        }
    }
    let explains = chi_squared_upper(left, n - 1) >= alarm::LOGS_SCATTER_RATE;
    let differs = (factor - 1.0).abs() > alarm::LOGS_CONTRADICT * std;
    (explains && differs).then_some(CommonFactor { value: factor, std })
}

#[cfg(test)]
mod tests {
    use super::{common_factor, pool_majority};
    use crate::pooled::tests::estimate;
    use crate::result::Estimate;
    use crate::settings::Settings;

    fn told(values: &[f64], std: f64) -> Estimate {
        let variance = std * std;
        estimate(values, &[vec![variance, 0.3 * variance], vec![0.3 * variance, variance]], vec![])
    }

    #[test]
    fn the_record_that_two_others_contradict_is_odd_and_its_factor_is_named() {
        let records = [told(&[1.0, 5.0], 0.01), told(&[1.201, 5.995], 0.01), told(&[1.01, 4.99], 0.01)];
        let all: Vec<&Estimate> = records.iter().collect();
        assert_eq!(pool_majority(&all, &Settings::default()).expect("pools").1, [1]);
        let factor = common_factor(&records[1], &records[0]).expect("one factor");
        assert!((factor.value - 1.2).abs() < 3.0 * factor.std && factor.std < 0.01, "{factor:?}");
        // Only one of the parameters differs: no factor explains it.
        assert_eq!(common_factor(&told(&[1.2, 5.0], 0.01), &records[0]), None);
        assert_eq!(common_factor(&records[2], &records[0]), None, "nothing differs");
    }

    #[test]
    fn without_a_majority_none_is_odd() {
        let (a, b) = (told(&[1.0, 5.0], 0.01), told(&[1.2, 5.0], 0.01));
        let odd = |records: &[&Estimate]| pool_majority(records, &Settings::default()).expect("pools").1;
        assert_eq!(odd(&[&a, &b]), [0; 0], "one against one");
        assert_eq!(odd(&[&a, &a, &b, &b]), [0; 0], "two against two");
        assert_eq!(odd(&[&a, &a, &a]), [0; 0], "all agree");
        // The third agrees with either of the others.
        let vague = told(&[1.1, 5.0], 1.0);
        assert_eq!(odd(&[&a, &b, &vague]), [0; 0]);
        assert_eq!(odd(&[&a, &b, &a, &a, &b]), [1, 4], "three against two");
    }
}
