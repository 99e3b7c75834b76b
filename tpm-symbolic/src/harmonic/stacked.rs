//! The harmonics of several experiments, stacked into one matrix.
//!
//! M theta has one row for every experiment, equation, harmonic and function (cosine or sine); its entries are Laurent
//! polynomials in amplitudes, frequency, run-time constants and pi.

use crate::algebra::fourier::Trig;
use crate::algebra::generic_point;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::harmonic::table::HarmonicTable;
use crate::mechanics::model::ExactModel;
use crate::number::rational::{self, Rational};
use ecow::EcoString;
use num_traits::{Signed, Zero};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// One experiment: a table with the values of its symbols.
#[derive(Clone, Debug)]
pub struct Experiment<'a> {
    /// A name for reports.
    pub name: String,
    /// The table of the pattern that is played.
    pub table: &'a HarmonicTable,
    /// Exact values of amplitudes, frequency and run-time constants; the others stay indeterminate.
    pub values: BTreeMap<String, Rational>,
    /// Symbols without a value that are the same in every experiment, such as run-time constants.
    pub shared: BTreeSet<String>,
    /// The highest harmonic that is used; all when not given.
    pub harmonics: Option<usize>,
}

impl<'a> Experiment<'a> {
    /// An experiment with all symbols indeterminate.
    #[must_use]
    pub fn new(name: &str, table: &'a HarmonicTable) -> Self {
        Self { name: name.to_owned(), table, values: BTreeMap::new(), shared: BTreeSet::new(), harmonics: None }
    }

    /// An experiment in which the model's run-time constants are shared with the other experiments.
    #[must_use]
    pub fn of(name: &str, model: &ExactModel, table: &'a HarmonicTable) -> Self {
        let mut experiment = Self::new(name, table);
        experiment.shared = model.run_time_constants().map(|symbol| model.quantity(symbol).name.to_string()).collect();
        experiment
    }

    /// This experiment with an exact value for a symbol.
    #[must_use]
    pub fn with(mut self, symbol: &str, value: Rational) -> Self {
        self.values.insert(symbol.to_owned(), value);
        self
    }

    /// This experiment with no harmonic above the given one.
    #[must_use]
    pub fn up_to(mut self, harmonics: Option<usize>) -> Self {
        self.harmonics = harmonics;
        self
    }
}

/// Why identifiability cannot be decided.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum IdentifiabilityError {
    /// There is nothing to analyse.
    #[error("no experiment is given")]
    NoExperiment,
    /// The experiments estimate different parameters.
    #[error("experiment `{experiment}` estimates other parameters than the first one")]
    Parameters {
        /// The experiment that differs.
        experiment: String,
    },
    /// A value is given for something that is not in the table.
    #[error(
        "experiment `{experiment}` gives a value for `{symbol}`, which is not an amplitude, a frequency or a constant of the model"
    )]
    UnknownSymbol {
        /// The experiment.
        experiment: String,
        /// The symbol.
        symbol: String,
    },
    /// A value is zero where the table divides by it.
    #[error("experiment `{experiment}` sets `{symbol}` to 0, by which the table divides")]
    DividesByZero {
        /// The experiment.
        experiment: String,
        /// The symbol.
        symbol: String,
    },
}

/// A row of the stacked matrix.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RowLabel {
    /// Index of the experiment.
    pub experiment: usize,
    /// Index of the equation.
    pub equation: usize,
    /// The harmonic.
    pub harmonic: usize,
    /// Cosine or sine.
    pub function: Trig,
}

/// The terms of an entry while they are collected.
type Terms = Vec<(Monomial<usize>, Rational)>;

/// The harmonics of all experiments as one matrix over the parameters, with entries that are Laurent polynomials.
pub(super) struct Matrix {
    pub(super) parameters: Vec<String>,
    pub(super) equations: Vec<String>,
    pub(super) variables: Vec<String>,
    pub(super) rows: Vec<RowLabel>,
    pub(super) entries: Vec<Vec<Polynomial<usize>>>,
}

impl Matrix {
    pub(super) fn new(experiments: &[Experiment<'_>]) -> Result<Self, IdentifiabilityError> {
        let first = experiments.first().ok_or(IdentifiabilityError::NoExperiment)?;
        let parameters = &first.table.parameters;
        let mut variables: Vec<String> = Vec::new();
        let mut cells: BTreeMap<RowLabel, Vec<Terms>> = BTreeMap::new();
        for (number, experiment) in experiments.iter().enumerate() {
            let table = experiment.table;
            let name = || experiment.name.clone();
            // The experiments must fit together.
            if table.parameters != *parameters || table.equations != first.table.equations {
                return Err(IdentifiabilityError::Parameters { experiment: name() });
            }
            if let Some(symbol) =
                experiment.values.keys().find(|name| !table.symbols.iter().any(|symbol| symbol == *name))
            {
                return Err(IdentifiabilityError::UnknownSymbol { experiment: name(), symbol: symbol.clone() });
            }
            let mut variable = |name: String| {
                variables.iter().position(|known| *known == name).unwrap_or_else(|| {
                    variables.push(name);
                    variables.len() - 1
                })
            };
            for entry in table.entries() {
                let Some(column) = entry.column else { continue };
                if experiment.harmonics.is_some_and(|highest| entry.harmonic > highest) {
                    continue;
                }
                let mut coefficient = entry.coefficient.clone();
                let mut monomial = Monomial::one();
                for (&symbol, power) in entry.powers.factors() {
                    let symbol = table.symbols[symbol].as_str();
                    match experiment.values.get(symbol) {
                        Some(value) if value.is_zero() && power < 0 => {
                            return Err(IdentifiabilityError::DividesByZero {
                                experiment: name(),
                                symbol: symbol.to_owned(),
                            });
                        }
                        Some(value) => coefficient *= rational::power(value, power),
                        None => {
                            let own = if number == 0 || experiment.shared.contains(symbol) {
                                symbol.to_owned()
                            } else {
                                format!("{symbol}[{}]", number + 1)
                            };
                            monomial = monomial.mul(&Monomial::power_of(variable(own), power));
                        }
                    }
                }
                for (&symbol, power) in entry.sign.factors() {
                    if let Some(value) = experiment.values.get(table.symbols[symbol].as_str())
                        && power % 2 != 0
                    {
                        coefficient *= value.signum();
                    }
                }
                if entry.pi != 0 {
                    monomial = monomial.mul(&Monomial::power_of(variable("pi".to_owned()), entry.pi));
                }
                let label = RowLabel {
                    experiment: number,
                    equation: entry.equation,
                    harmonic: entry.harmonic,
                    function: entry.function,
                };
                let row = cells.entry(label).or_insert_with(|| vec![Vec::new(); parameters.len()]);
                row[column].push((monomial, coefficient));
            }
        }
        let sums = |row: Vec<Vec<_>>| row.into_iter().map(Polynomial::from_iter).collect();
        let (rows, entries) = cells.into_iter().map(|(label, row)| (label, sums(row))).unzip();
        let names = |list: &[EcoString]| list.iter().map(EcoString::to_string).collect();
        Ok(Self { parameters: names(parameters), equations: names(&first.table.equations), variables, rows, entries })
    }

    /// The entries at a generic point.
    pub(super) fn at_point(&self, number: u64) -> Vec<Vec<Rational>> {
        let value = |entry: &Polynomial<usize>| {
            entry
                .evaluate(|&variable| generic_point::value(number, variable))
                .expect("invariant: generic values are positive")
        };
        self.entries.iter().map(|row| row.iter().map(value).collect()).collect()
    }
}

/// The stacked matrix in double precision, rows in the order of their labels, for condition numbers.
///
/// `value` gives the symbols of experiment number i, in the units of the model.
#[must_use]
pub fn evaluated_matrix(
    tables: &[&HarmonicTable],
    value: impl Fn(usize, &str) -> f64,
) -> (Vec<RowLabel>, Vec<Vec<f64>>) {
    let mut cells: BTreeMap<RowLabel, Vec<f64>> = BTreeMap::new();
    for (experiment, table) in tables.iter().enumerate() {
        let symbols: Vec<f64> = table.symbols.iter().map(|symbol| value(experiment, symbol)).collect();
        for entry in table.entries() {
            let Some(column) = entry.column else { continue };
            let label =
                RowLabel { experiment, equation: entry.equation, harmonic: entry.harmonic, function: entry.function };
            let row = cells.entry(label).or_insert_with(|| vec![0.0; table.parameters.len()]);
            row[column] += table.evaluate(&entry, &symbols);
        }
    }
    cells.into_iter().unzip()
}
