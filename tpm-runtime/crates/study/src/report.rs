//! Identifiability under experiments, as plain data for files and for printing.

use serde::Serialize;
use std::collections::BTreeMap;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::algebra::fraction::display_polynomial;
use tpm_symbolic::algebra::polynomial::Polynomial;
use tpm_symbolic::harmonic::identifiability::{BaseParameter, Identifiability, RowLabel};

/// The name of the JSON schema of a [`Report`].
pub(super) const SCHEMA: &str = "tpm.identifiability/1";

/// Method by which a [`Report`] was computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Means {
    /// From the harmonic table, over the rationals.
    Exact,
    /// From the rows along the pattern, in floating point.
    Numerical,
}

/// Identifiability under experiments, as plain data. The coefficients of an [`Identifiability`] are exact, in the model
/// language.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// `tpm.identifiability/1`.
    pub schema: String,
    /// The method of computation.
    pub method: Means,
    /// The rank.
    pub rank: usize,
    /// Number of parameters.
    pub columns: usize,
    /// Number of rows, one for every harmonic.
    pub rows: usize,
    /// Whether the rank is proven, rather than right with a probability close to one.
    pub proven: bool,
    /// The symbols that were left indeterminate.
    pub indeterminates: Vec<String>,
    /// The values drawn for these symbols, for which coefficients that are no exact numbers hold; empty for exact
    /// results.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub at: BTreeMap<String, String>,
    /// Directions along which nothing is observed; absent when they are too long to print.
    pub unobservable: Option<Vec<BTreeMap<String, String>>>,
    /// A maximal observable set.
    pub base: Option<Vec<ReportedBase>>,
    /// Sets of parameters that are shown only up to a common factor: equations without an input or a known term alone show them. Each takes
    /// one from the rank.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub common_factors: Vec<Vec<String>>,
    /// Every parameter.
    pub parameters: Vec<ReportedParameter>,
}

/// `parameter + sum plus[other] * other` is observable.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReportedBase {
    /// The leading parameter.
    pub parameter: String,
    /// The parameters that are lumped into it, with their factors.
    pub plus: BTreeMap<String, String>,
    /// Lowest harmonic up to which the harmonics determine the combination; of numerical answers only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub harmonics_up_to: Option<usize>,
    /// The harmonics of its regressor that are certainly not zero, by Jacobi-Anger series. They exist for numerical
    /// answers only, and are empty where the regressor contains functions of the motion other than sines and cosines.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shown_by: Vec<ShowingHarmonic>,
    /// Rows without redundancy: a force in such a row that the model lacks biases the combination and leaves no
    /// residual.
    pub unchecked_in: Vec<ReportedRow>,
}

/// A harmonic that shows a base parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShowingHarmonic {
    /// The experiment.
    pub experiment: String,
    /// The equation.
    pub equation: String,
    /// The harmonic.
    pub harmonic: usize,
    /// Its amplitude in the equation per unit of the base parameter.
    pub amplitude: f64,
    /// A bound of the amplitude's error, from truncated series and rounding.
    pub error: f64,
}

/// Observability of a parameter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ReportedParameter {
    /// Its name.
    pub name: String,
    /// Whether the experiments determine the parameter alone, not only in a combination.
    pub observable: bool,
    /// Lowest harmonic up to which the harmonics determine it.
    pub harmonics_up_to: Option<usize>,
    /// The experiments each of which determines it alone.
    pub by_itself_in: Vec<String>,
    /// Rows in which it has a coefficient.
    pub visible_in: Vec<ReportedRow>,
    /// Rows without redundancy: a force in such a row that the model lacks biases the parameter and leaves no residual.
    /// Empty for a parameter that is not observable.
    pub unchecked_in: Vec<ReportedRow>,
}

/// A row of the table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ReportedRow {
    /// The experiment.
    pub experiment: String,
    /// The equation.
    pub equation: String,
    /// The harmonic.
    pub harmonic: usize,
    /// Cosine or sine.
    pub function: Trig,
}

impl Report {
    /// An exact result as plain data, for files and for printing.
    #[must_use]
    pub fn of(found: &Identifiability) -> Self {
        let name = |variable: &usize| found.variables[*variable].clone();
        let unobservable = found.unobservable.as_ref().map(|directions| {
            let entries = |direction: &Vec<Polynomial<usize>>| {
                let values = found.parameters.iter().zip(direction).filter(|(_, value)| !value.is_zero());
                values.map(|(parameter, value)| (parameter.clone(), display_polynomial(value, name))).collect()
            };
            directions.iter().map(entries).collect()
        });
        let label = |row: &usize| {
            let RowLabel { experiment, equation, harmonic, function } = found.rows[*row];
            ReportedRow {
                experiment: found.experiments[experiment].clone(),
                equation: found.equations[equation].clone(),
                harmonic,
                function,
            }
        };
        let base = found.base.as_ref().map(|base| {
            let one = |base: &BaseParameter| ReportedBase {
                parameter: found.parameters[base.column].clone(),
                plus: base
                    .others
                    .iter()
                    .map(|(column, factor)| (found.parameters[*column].clone(), factor.display(name)))
                    .collect(),
                harmonics_up_to: None,
                shown_by: Vec::new(),
                unchecked_in: found.observability[base.column].unchecked.iter().map(label).collect(),
            };
            base.iter().map(one).collect()
        });
        let parameters = found.parameters.iter().zip(&found.observability).map(|(name, own)| ReportedParameter {
            name: name.clone(),
            observable: own.observable,
            harmonics_up_to: own.band,
            by_itself_in: own.experiments.iter().map(|number| found.experiments[*number].clone()).collect(),
            visible_in: own.visible.iter().map(label).collect(),
            unchecked_in: own.unchecked.iter().filter(|_| own.observable).map(label).collect(),
        });
        Self {
            schema: SCHEMA.to_owned(),
            method: Means::Exact,
            rank: found.rank,
            columns: found.parameters.len(),
            rows: found.rows.len(),
            proven: found.proven,
            indeterminates: found.variables.clone(),
            at: BTreeMap::new(),
            unobservable,
            base,
            common_factors: Vec::new(),
            parameters: parameters.collect(),
        }
    }

    /// The report where these sets of parameters are shown only up to a common factor each.
    #[must_use]
    pub fn with_common_factors(mut self, sets: Vec<Vec<String>>) -> Self {
        self.rank -= sets.len().min(self.rank);
        for parameter in self.parameters.iter_mut().filter(|own| sets.iter().flatten().any(|name| *name == own.name)) {
            parameter.observable = false;
            parameter.harmonics_up_to = None;
            parameter.by_itself_in.clear();
            parameter.unchecked_in.clear();
        }
        self.common_factors = sets;
        self
    }
}
