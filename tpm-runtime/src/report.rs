//! An estimate as it is reported: names, units, and nothing where nothing can be known.

use crate::estimate::{Estimate, Status};
use crate::model::Model;
use serde::Serialize;
use std::collections::BTreeMap;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

/// Parts of a unit direction below this one are rounding.
const NOTHING: f64 = 1e-9;

/// One parameter of a result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterReport {
    /// Name in the model.
    pub name: String,
    /// Unit in the model.
    pub unit: Option<String>,
    /// Value before.
    pub prior: Option<f64>,
    /// Identified value; nothing when unobservable.
    pub value: Option<f64>,
    /// Standard deviation; nothing when unobservable.
    pub std: Option<f64>,
    /// identified, unobservable, poorly_determined or frozen.
    pub status: &'static str,
}

/// The part of a result that is the same for a log and for a campaign.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EstimateReport {
    pub(crate) parameters: Vec<ParameterReport>,
    /// Directions that the data do not show: parameter to weight.
    pub(crate) unobservable: Vec<BTreeMap<String, String>>,
    /// Nothing in the rows and columns of unobservable parameters.
    pub(crate) covariance: Vec<Vec<Option<f64>>>,
}

impl EstimateReport {
    /// `prior` has one value per parameter or fewer; without an estimate every parameter is unobservable.
    pub(crate) fn new(model: &dyn Model<f64>, prior: &[f64], estimate: Option<&Estimate>) -> Self {
        let p = model.dims().parameters;
        let status = |j: usize| estimate.map_or(Status::Unobservable, |e| e.status[j]);
        let seen = |j: usize| estimate.filter(|_| status(j) != Status::Unobservable);
        let parameters = (0..p)
            .map(|j| ParameterReport {
                name: model.parameter(j).name.into(),
                unit: model.parameter(j).unit.map(String::from),
                prior: prior.get(j).copied(),
                value: seen(j).map(|e| e.values[j]),
                std: seen(j).map(|e| e.std[j]),
                status: status(j).name(),
            })
            .collect();
        let named = |direction: &Vec<f64>| {
            let parts = direction.iter().enumerate().filter(|(_, part)| part.abs() > NOTHING);
            parts.map(|(j, part)| (model.parameter(j).name.to_string(), nine_digits(*part))).collect()
        };
        let unobservable = estimate.map_or_else(Vec::new, |e| e.unobservable.iter().map(named).collect());
        let entry = |r: usize, c: usize| seen(r).and(seen(c)).map(|e| e.covariance[(r, c)]);
        let covariance = (0..p).map(|r| (0..p).map(|c| entry(r, c)).collect()).collect();
        Self { parameters, unobservable, covariance }
    }
}

/// A weight to nine digits, so that rounding of the factorisation does not show.
fn nine_digits(value: f64) -> String {
    let text = format!("{value:.9e}");
    text.parse::<f64>().map_or(text, |v| v.to_string())
}
