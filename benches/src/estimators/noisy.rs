//! Campaigns with the noise of the shipped experiments.

use crate::estimators::cell::Cell;
use crate::honesty::machines::Shipped;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::error::Error;
use tpm_runtime::estimate::{LARGE_RESIDUAL, Method};
use tpm_runtime::experiment::Experiment;
use tpm_runtime::session::{Identification, Warning};

/// Deviations within which 95 % of normal errors are.
pub const COVERED: f64 = 1.96;

/// Campaigns of one estimator on one machine, for successive seeds.
#[derive(Clone, Debug, Default)]
pub struct Campaigns {
    /// Largest error of a campaign's numbers in their deviations, and the name of the number; campaigns without any are left out.
    pub worst: Vec<(f64, String)>,
    /// Numbers within [`COVERED`] of their deviations, and all of them.
    pub covered: (usize, usize),
    /// Median deviation of every number, by its name.
    pub deviations: Vec<(String, f64)>,
    /// Errors of every number, value less truth, by its name.
    pub errors: BTreeMap<String, Vec<f64>>,
    /// Ranks that the campaigns found.
    pub ranks: Vec<usize>,
    /// Why campaigns gave no number, and how many.
    pub refused: BTreeMap<String, usize>,
    /// How campaigns ended that did not converge, and how many.
    pub unfinished: BTreeMap<String, usize>,
    /// Numbers along directions that the campaign's own runs do not show.
    pub hidden_numbers: usize,
}

/// Runs the campaigns of a machine's own experiment with an estimator.
///
/// # Errors
/// The faults of the experiment.
pub fn campaigns(machine: &Shipped, method: Method, seeds: usize) -> Result<Campaigns, Box<dyn Error>> {
    let mut experiment = machine.experiment();
    experiment.estimator = method;
    played(machine, experiment, seeds)
}

/// The same for an experiment on a machine.
///
/// # Errors
/// Whatever keeps the machine from being simulated.
pub fn played(machine: &Shipped, mut experiment: Experiment, seeds: usize) -> Result<Campaigns, Box<dyn Error>> {
    experiment.stability.points = experiment.stability.points.min(10);
    let session = machine.session(experiment)?;
    let one = |seed: u64| session.identify_seeded(seed, &mut |_, _, _| true).map_err(|error| error.to_string());
    let results: Vec<Result<Identification, String>> = (1..=seeds as u64).into_par_iter().map(one).collect();
    let mut found = Campaigns::default();
    let mut stds: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for result in results {
        match result {
            Ok(result) => found.take(&result, &mut stds),
            Err(reason) => *found.refused.entry(reason).or_default() += 1,
        }
    }
    for (name, mut own) in stds {
        own.sort_by(f64::total_cmp);
        found.deviations.push((name, own[own.len() / 2]));
    }
    Ok(found)
}

/// Name, value, deviation and truth of every number in a result.
fn numbers(result: &Identification) -> impl Iterator<Item = (String, f64, f64, f64)> + '_ {
    let own = if result.physical.is_empty() { &result.parameters } else { &result.physical };
    let own = own.iter().filter_map(|p| Some((p.name.clone(), p.value?, p.std?, p.truth?)));
    let shown = result.combinations.iter().filter_map(|shown| {
        let name: Vec<&str> = shown.terms.keys().map(String::as_str).collect();
        Some((name.join(","), shown.value, shown.std, shown.truth?))
    });
    own.chain(shown).filter(|(.., std, _)| *std > 0.0)
}

impl Campaigns {
    fn take(&mut self, result: &Identification, stds: &mut BTreeMap<String, Vec<f64>>) {
        self.ranks.push(result.rank);
        if !result.outcome.is_some_and(|outcome| outcome.is_normal()) {
            let how = result.outcome.map_or("stopped", |outcome| outcome.describe());
            *self.unfinished.entry(how.into()).or_default() += 1;
        }
        let touched = |name: &String| result.unobservable.iter().any(|direction| direction.contains_key(name));
        self.hidden_numbers += result.parameters.iter().filter(|p| p.value.is_some() && touched(&p.name)).count();
        let is_far = |warning: &&Warning| matches!(warning, Warning::FarFromLinear { .. });
        if let Some(warning) = result.warnings.iter().find(is_far) {
            *self.refused.entry(warning.to_string()).or_default() += 1;
            return;
        }
        if !result.is_explained() {
            *self
                .refused
                .entry(format!(
                    "more than {:.0} % of the force is not explained, and the result says that it is none",
                    100.0 * LARGE_RESIDUAL
                ))
                .or_default() += 1;
            return;
        }
        let mut worst = None;
        for (name, value, std, truth) in numbers(result) {
            stds.entry(name.clone()).or_default().push(std);
            self.errors.entry(name.clone()).or_default().push(value - truth);
            let error = (value - truth).abs() / std;
            self.covered.0 += usize::from(error < COVERED);
            self.covered.1 += 1;
            if worst.as_ref().is_none_or(|(most, _)| error > *most) {
                worst = Some((error, name));
            }
        }
        match worst {
            Some(worst) => self.worst.push(worst),
            None => *self.refused.entry("no number is shown".into()).or_default() += 1,
        }
    }

    /// The largest error in deviations, or why there is none.
    #[must_use]
    pub fn cell(&self) -> Cell {
        let worst = self.worst.iter().max_by(|a, b| a.0.total_cmp(&b.0));
        let said = |counts: &BTreeMap<String, usize>| -> Vec<String> {
            counts.iter().map(|(reason, count)| format!("{count} of {}: {reason}", self.seeds())).collect()
        };
        let all = self.refused.iter().find(|(_, count)| **count == self.seeds());
        let notes: Vec<String> = said(&self.refused).into_iter().chain(said(&self.unfinished)).collect();
        let note = match all {
            Some((reason, _)) => Some(reason.clone()),
            None => (!notes.is_empty()).then(|| notes.join("; ")),
        };
        Cell { text: worst.map_or_else(|| "-".into(), |(error, name)| format!("{error:.1} {name}")), note }
    }

    fn seeds(&self) -> usize {
        self.worst.len() + self.refused.values().sum::<usize>()
    }

    /// The share of numbers within [`COVERED`] deviations as a cell.
    #[must_use]
    pub fn coverage(&self) -> Cell {
        let text = match self.covered {
            (_, 0) => "-".into(),
            (within, all) => format!("{:.1} %", 100.0 * within as f64 / all as f64),
        };
        Cell { text, note: None }
    }

    /// The largest bias of a number, its mean error over the spread of its errors, with how uncertain so few campaigns leave it and its
    /// name; nothing where no number is in two campaigns.
    #[must_use]
    pub fn bias(&self) -> Option<(f64, f64, &str)> {
        let of = |errors: &[f64]| {
            let count = errors.len() as f64;
            let mean = errors.iter().sum::<f64>() / count;
            let spread = (errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
            (errors.len() > 1 && spread > 0.0).then(|| (mean / spread, count.sqrt().recip()))
        };
        let known =
            self.errors.iter().filter_map(|(name, errors)| of(errors).map(|(bias, by)| (bias, by, name.as_str())));
        known.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
    }

    /// That bias as a cell.
    #[must_use]
    pub fn bias_cell(&self) -> Cell {
        let text = self.bias().map(|(bias, by, name)| format!("{bias:+.2} ({by:.2}) {name}"));
        Cell { text: text.unwrap_or_else(|| "-".into()), note: None }
    }

    /// Largest ratio of the deviations to other ones; nothing where no number is in both.
    #[must_use]
    pub fn ratio(&self, other: &[(String, f64)]) -> Option<f64> {
        let ratio =
            |(name, own): &(String, f64)| other.iter().find(|(known, _)| known == name).map(|(_, other)| own / other);
        self.deviations.iter().filter_map(ratio).max_by(f64::total_cmp)
    }

    /// That ratio as a cell.
    #[must_use]
    pub fn beside(&self, other: &[(String, f64)]) -> Cell {
        Cell { text: self.ratio(other).map_or_else(|| "-".into(), |ratio| format!("{ratio:.2}")), note: None }
    }
}

#[cfg(test)]
mod tests {
    use super::Campaigns;

    #[test]
    fn bias_is_in_spreads_of_the_campaigns() {
        let mut found = Campaigns::default();
        assert!(found.bias().is_none() && found.bias_cell().text == "-");
        found.errors.insert("m".into(), vec![1.0, 3.0, 2.0, 2.0]);
        found.errors.insert("k".into(), vec![-0.1, 0.1, 0.0, 0.0]);
        found.errors.insert("once".into(), vec![9.0]);
        let (bias, by, name) = found.bias().expect("numbers");
        assert!((bias - 6.0_f64.sqrt()).abs() < 1e-12 && (by - 0.5).abs() < 1e-12 && name == "m", "{bias} {by} {name}");
    }
}
