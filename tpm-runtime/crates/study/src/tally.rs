//! Running sums over the campaigns of a study. Their size does not depend on the number of campaigns.

use serde::{Deserialize, Serialize};
use tpm_controller::model::Model;
use tpm_estimate::{ParameterReport, Status};
use tpm_experiment::Experiment;
use tpm_numerics::tail::NORMAL_95;
use tpm_session::Identification;

/// Statistics of one parameter over the campaigns that identified it. An estimate that its campaign reports as poorly
/// determined does not count.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterStudy {
    /// Name in the model.
    pub name: String,
    /// Unit in the model.
    pub unit: Option<String>,
    /// Value of the parameter in the simulated machine.
    pub truth: f64,
    /// Number of campaigns that identified the parameter.
    pub values: usize,
    /// Mean of the estimates; nothing when there are none.
    pub mean: Option<f64>,
    /// Mean minus truth.
    pub bias: Option<f64>,
    /// Standard deviation of the mean estimate: a bias below twice as much may be chance.
    pub bias_std: Option<f64>,
    /// Standard deviation of the estimates.
    pub spread: Option<f64>,
    /// Root mean square of the standard deviations that the campaigns state.
    pub stated: Option<f64>,
    /// Cramer-Rao bound of the standard deviation after the runs of the first campaign, along their motion without
    /// noise; nothing when the bound cannot be predicted.
    pub bound: Option<f64>,
    /// Share of the stated 95 % intervals that hold the truth.
    pub coverage: Option<f64>,
}

/// The values of one campaign that a study uses.
pub(super) struct Outcome {
    seed: Option<u64>,
    complete: bool,
    /// Value and standard deviation of every parameter of the plant that the campaign identified.
    estimates: Box<[Option<(f64, f64)>]>,
    /// The Cramer-Rao bounds, which only the first campaign has.
    bounds: Option<Vec<Option<f64>>>,
}

impl Outcome {
    /// Estimates of the plant's parameters in a result.
    pub(super) fn of(result: &Identification, parameters: &[&str], bounds: Option<Vec<Option<f64>>>) -> Self {
        let identified = |name: &&str| {
            let parameter = named(result, name).filter(|parameter| parameter.status == Status::Identified)?;
            Some((parameter.value?, parameter.std?))
        };
        let estimates = parameters.iter().map(identified).collect();
        Self { seed: result.seed, complete: result.is_complete(), estimates, bounds }
    }
}

/// Report of a parameter of the plant in a result: an estimated parameter, or a physical one behind lumped ones.
fn named<'r>(result: &'r Identification, name: &str) -> Option<&'r ParameterReport> {
    result.parameters.iter().chain(&result.physical).find(|parameter| parameter.name == name)
}

/// Sums over the campaigns of successive seeds, added in order: equal campaigns give equal sums, to the last bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Tally {
    campaigns: usize,
    pub(super) incomplete_seeds: Vec<u64>,
    parameters: Vec<Moments>,
}

/// The sums of one parameter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Moments {
    /// Value in the simulated machine; a machine cannot be simulated without it.
    truth: Option<f64>,
    bound: Option<f64>,
    values: usize,
    mean: f64,
    /// Sum of the squared deviations from the mean.
    squares: f64,
    /// Sum of the squares of the stated standard deviations.
    stated: f64,
    /// Number of stated intervals that contain the truth.
    held: usize,
}

impl Moments {
    /// Adds a value and its standard deviation. Deviations are taken from the current mean, so that no digits cancel
    /// (B. P. Welford, 1962).
    fn add(&mut self, value: f64, std: f64) {
        self.values += 1;
        let deviation = value - self.mean;
        self.mean += deviation / self.values as f64;
        self.squares += deviation * (value - self.mean);
        self.stated += std * std;
        self.held += usize::from(self.truth.is_some_and(|truth| (value - truth).abs() <= NORMAL_95 * std));
    }
}

impl Tally {
    /// A tally without campaigns.
    pub(super) fn new(model: &dyn Model<f64>, experiment: &Experiment) -> Self {
        let truth = |j: usize| experiment.plant.parameters.get(model.parameter(j).name).copied();
        let parameters =
            (0..model.dims().parameters).map(|j| Moments { truth: truth(j), ..Moments::default() }).collect();
        Self { campaigns: 0, incomplete_seeds: Vec::new(), parameters }
    }

    /// Number of campaigns that were added.
    pub(super) const fn campaigns(&self) -> usize {
        self.campaigns
    }

    /// Whether this tally has the same parameters as another one.
    pub(super) fn fits(&self, other: &Self) -> bool {
        let truths = |tally: &Self| tally.parameters.iter().map(|own| own.truth).collect::<Vec<_>>();
        truths(self) == truths(other)
    }

    /// Adds the campaign of the next seed.
    pub(super) fn add(&mut self, outcome: Outcome) {
        self.campaigns += 1;
        if !outcome.complete {
            self.incomplete_seeds.extend(outcome.seed);
        }
        for (own, bound) in self.parameters.iter_mut().zip(outcome.bounds.into_iter().flatten()) {
            own.bound = bound;
        }
        for (own, estimate) in self.parameters.iter_mut().zip(outcome.estimates) {
            if let Some((value, std)) = estimate {
                own.add(value, std);
            }
        }
    }

    /// Statistics of the parameters over all campaigns.
    pub(super) fn parameters(&self, model: &dyn Model<f64>, experiment: &Experiment) -> Vec<ParameterStudy> {
        let one = |(j, own): (usize, &Moments)| {
            let label = model.parameter(j);
            // A machine without a true value cannot be simulated, so no parameter is left out here.
            let truth = *experiment.plant.parameters.get(label.name)?;
            let count = own.values as f64;
            let some = |value: f64| (own.values > 0).then_some(value);
            let spread = (own.values > 1).then(|| (own.squares / (count - 1.0)).sqrt());
            Some(ParameterStudy {
                name: label.name.to_string(),
                unit: label.unit.map(ToString::to_string),
                truth,
                values: own.values,
                mean: some(own.mean),
                bias: some(own.mean - truth),
                bias_std: spread.map(|spread| spread / count.sqrt()),
                spread,
                stated: some((own.stated / count).sqrt()),
                bound: own.bound,
                coverage: some(own.held as f64 / count),
            })
        };
        self.parameters.iter().enumerate().filter_map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Outcome, Tally};
    use tpm_experiment::Experiment;
    use tpm_test_support::models::MassSpringDrag;

    #[test]
    fn statistics_are_those_of_the_definition() {
        let mut experiment =
            Experiment::parse(include_str!("../../../../models/mass_spring_drag.toml")).expect("right");
        experiment.plant.parameters.insert("m".into(), 2.0);
        let mut tally = Tally::new(&MassSpringDrag, &experiment);
        for value in [1.0, 2.0, 6.0] {
            let estimates = Box::new([Some((value, 0.6)), None, None]);
            tally.add(Outcome { seed: Some(1), complete: false, estimates, bounds: None });
        }
        assert_eq!((tally.campaigns(), tally.incomplete_seeds.len()), (3, 3));
        let parameters = tally.parameters(&MassSpringDrag, &experiment);
        let [found, none, _] = &parameters[..] else { panic!("{parameters:?}") };
        assert_eq!((found.values, found.mean, found.bias), (3, Some(3.0), Some(1.0)));
        assert!((found.spread.expect("three") - 7.0_f64.sqrt()).abs() < 1e-15);
        assert!((found.stated.expect("three") - 0.6).abs() < 1e-15);
        assert!((found.coverage.expect("three") - 2.0 / 3.0).abs() < 1e-15);
        assert_eq!((none.values, none.mean, none.coverage), (0, None, None));
    }
}
