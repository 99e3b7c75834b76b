//! An estimate as it is reported: with names and units, and without a number where the data show none.

use crate::combination::Product;
use crate::result::Estimate;
use crate::verdict::Status;
use serde::Serialize;
use std::collections::BTreeMap;
use tpm_controller::model::Model;
use tpm_numerics::DVector;
use tpm_numerics::tolerance;

/// One parameter of a result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterReport {
    /// Name of the parameter in the model.
    pub name: String,
    /// Unit of the parameter in the model.
    pub unit: Option<String>,
    /// Interval in which a nonlinear parameter was looked for, in that unit; nothing for a parameter in which the model is linear.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interval: Option<[f64; 2]>,
    /// Value that was stated before the identification, in that unit; nothing where none was stated.
    pub prior: Option<f64>,
    /// Identified value; nothing when unobservable.
    pub value: Option<f64>,
    /// Standard deviation; nothing when unobservable.
    pub std: Option<f64>,
    /// What may be said of it.
    pub status: Status,
    /// Value in the simulated machine that the data come from; nothing for data of a real one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
    /// Value of an unobservable parameter that follows from stated priors and from the combinations that the data show; nothing
    /// where they do not determine it, and for every other parameter.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with_prior: Option<f64>,
}

/// A combination of parameters that do not show one by one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CombinationReport {
    /// Weight by parameter, nine digits each; the combination has the unit of the parameter of weight one.
    pub terms: BTreeMap<String, String>,
    /// Unit of the combination.
    pub unit: Option<String>,
    /// Value before the identification; nothing where not all priors in it were stated.
    pub prior: Option<f64>,
    /// Identified value.
    pub value: f64,
    /// Standard deviation.
    pub std: f64,
    /// What the data show of the parameter of weight one where another one has a common scale with it, `J/Kt`; the deviation is that of the
    /// product.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub product: Option<ProductReport>,
    /// Value in the simulated machine that the data come from; nothing for data of a real one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
}

/// A parameter divided by a power of another one, of which the data show no more.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProductReport {
    /// The product as it is written: `J/Kt`, `l*b`, `k/c^2`.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Its value.
    pub value: f64,
}

/// A combination as a table has it.
pub struct WrittenCombination<'a> {
    /// The sum, or the product.
    pub name: String,
    /// Its unit.
    pub unit: Option<&'a str>,
    /// Its value before the identification, of a sum.
    pub prior: Option<f64>,
    /// Its identified value.
    pub value: f64,
    /// Its value in the simulated machine, of a sum.
    pub truth: Option<f64>,
}

impl CombinationReport {
    /// The combination as a table has it; a sum is `spelled`.
    pub fn written(&self, spelled: impl FnOnce(&BTreeMap<String, String>) -> String) -> WrittenCombination<'_> {
        match &self.product {
            Some(ProductReport { name, unit, value }) => WrittenCombination {
                name: name.clone(),
                unit: unit.as_deref(),
                prior: None,
                value: *value,
                truth: None,
            },
            None => WrittenCombination {
                name: spelled(&self.terms),
                unit: self.unit.as_deref(),
                prior: self.prior,
                value: self.value,
                truth: self.truth,
            },
        }
    }
}

/// The part of a result that is the same for a log and for a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimateReport {
    /// Every parameter of the model, in its order.
    pub parameters: Vec<ParameterReport>,
    /// Directions that the data do not show: parameter to weight.
    pub unobservable: Vec<BTreeMap<String, String>>,
    /// What the data show of the unobservable parameters.
    pub combinations: Vec<CombinationReport>,
    /// Covariance by row and column, with nothing for unobservable parameters.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// Covariance of every combination with all parameters, nothing for unobservable ones, and then with all combinations.
    pub combination_covariance: Vec<Vec<Option<f64>>>,
}

impl EstimateReport {
    /// `prior` has the stated values, one per parameter or fewer; without an estimate every parameter is unobservable.
    pub fn new(model: &dyn Model<f64>, prior: &[Option<f64>], estimate: Option<&Estimate>) -> Self {
        let p = model.dims().parameters;
        let status = |j: usize| estimate.map_or(Status::Unobservable, |e| e.status[j]);
        let seen = |j: usize| estimate.filter(|_| status(j) != Status::Unobservable);
        let stated = |j: usize| prior.get(j).copied().flatten();
        let with_prior = estimate.map_or_else(Vec::new, |e| e.with_prior(prior));
        let parameters = (0..p)
            .map(|j| ParameterReport {
                name: model.parameter(j).name.into(),
                unit: model.parameter(j).unit.map(String::from),
                interval: model.parameter_interval(j),
                prior: stated(j),
                value: seen(j).map(|e| e.values[j]),
                std: seen(j).map(|e| e.std[j]),
                status: status(j),
                truth: None,
                with_prior: with_prior.get(j).copied().flatten(),
            })
            .collect();
        let named = |direction: &[f64]| -> BTreeMap<String, String> {
            let parts = direction.iter().enumerate().filter(|(_, part)| part.abs() > tolerance::COMPONENT);
            parts.map(|(j, part)| (model.parameter(j).name.to_string(), nine_digits(*part))).collect()
        };
        let unobservable = estimate.map_or_else(Vec::new, |e| e.unobservable.iter().map(|d| named(d)).collect());
        let shown = estimate.map_or_else(Vec::new, Estimate::combinations);
        let combinations = shown.iter().map(|shown| CombinationReport {
            terms: named(&shown.weights),
            unit: model.parameter(shown.lead).unit.map(String::from),
            prior: (shown.weights.iter().enumerate().filter(|(_, weight)| weight.abs() > tolerance::COMPONENT))
                .map(|(j, weight)| Some(weight * stated(j)?))
                .sum(),
            value: shown.value,
            std: shown.std,
            product: shown.product.map(|product| product_report(model, shown.lead, product)),
            truth: None,
        });
        let combinations = combinations.collect();
        let entry = |r: usize, c: usize| seen(r).and(seen(c)).map(|e| e.covariance[(r, c)]);
        let covariance = (0..p).map(|r| (0..p).map(|c| entry(r, c)).collect()).collect();
        let combination_covariance = estimate.map_or_else(Vec::new, |e| {
            let row = |weights: &[f64]| {
                let with = e.covariance.dense() * DVector::from_column_slice(weights);
                let parameters = (0..p).map(|c| seen(c).map(|_| with[c]));
                let others = shown.iter().map(|other| Some(with.iter().zip(&other.weights).map(|(v, w)| v * w).sum()));
                parameters.chain(others).collect()
            };
            shown.iter().map(|own| row(&own.weights)).collect()
        });
        Self { parameters, unobservable, combinations, covariance, combination_covariance }
    }
}

/// A product in the words of a model.
fn product_report(model: &dyn Model<f64>, lead: usize, product: Product) -> ProductReport {
    let (of, by) = (model.parameter(lead), model.parameter(product.by));
    let written = |of: &str, by: &str| {
        let sign = if product.power < 0.0 { '*' } else { '/' };
        let by = if by.contains(['*', '/']) { format!("({by})") } else { by.to_string() };
        match product.power.abs() {
            1.0 => format!("{of}{sign}{by}"),
            power => format!("{of}{sign}{by}^{power}"),
        }
    };
    let unit = of.unit.zip(by.unit).map(|(of, by)| match by {
        "1" => of.to_string(),
        by if by == of && product.power == 1.0 => "1".to_string(),
        by => written(of, by),
    });
    ProductReport { name: written(of.name, by.name), unit, value: product.value }
}

/// A weight to nine digits, so that rounding of the factorisation does not show.
fn nine_digits(value: f64) -> String {
    let text = format!("{value:.9e}");
    text.parse::<f64>().map_or(text, |v| v.to_string())
}
