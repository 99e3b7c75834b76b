//! Exact identifiability from harmonic tables: rank, unobservable directions, base parameters.
//!
//! The harmonics of all inputs are M theta, where M has one row for every experiment, equation, harmonic and function
//! (cosine or sine) and its entries are Laurent polynomials in amplitudes, frequency, run-time constants and pi. What of
//! theta can be estimated is the row space of M. Everything is decided exactly:
//!
//! - values given for symbols are exact rationals; a symbol without one is an indeterminate;
//! - the rank at a point is a lower bound of the generic rank ([`generic`]), and every unobservable direction is checked
//!   to satisfy M v = 0 identically, an upper bound. Where both agree ([`Identifiability::proven`]) the rank is certain;
//! - pi is transcendental, so that over the rationals it is an indeterminate as well.
//!
//! Amplitudes without a value are taken as positive where a term depends on their sign.
//!
//! Invariants of [`Identifiability`]: directions are primitive polynomial vectors (no common monomial factor, whole
//! coefficients without a common divisor), each with its own column that is zero in all others; base parameters and
//! these free columns are complementary.

use crate::algebra::fourier::Trig;
use crate::algebra::fraction::{Fraction, display_polynomial};
use crate::algebra::generic_point;
use crate::algebra::linear;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::harmonic::table::HarmonicTable;
use crate::mechanics::model::Model;
use crate::number::rational::{self, Rational};
use crate::regressor::parameter_map::ParameterMap;
use ecow::EcoString;
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, Signed, Zero};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// One experiment: a table with the settings it is run at.
#[derive(Clone, Debug)]
pub struct Experiment<'a> {
    /// A name for reports.
    pub name: String,
    /// The table of the pattern that is run.
    pub table: &'a HarmonicTable,
    /// Exact values of amplitudes, frequency and run-time constants; the others stay indeterminate.
    pub values: BTreeMap<String, Rational>,
    /// Symbols without a value that are the same in every experiment, such as run-time constants.
    pub shared: BTreeSet<String>,
}

impl<'a> Experiment<'a> {
    /// An experiment with all symbols indeterminate.
    #[must_use]
    pub fn new(name: &str, table: &'a HarmonicTable) -> Self {
        Self { name: name.to_owned(), table, values: BTreeMap::new(), shared: BTreeSet::new() }
    }

    /// An experiment in which the model's run-time constants are shared with the other experiments.
    #[must_use]
    pub fn of(name: &str, model: &Model, table: &'a HarmonicTable) -> Self {
        let mut experiment = Self::new(name, table);
        experiment.shared = model.run_time_constants().map(|symbol| model.quantity(symbol).name.to_string()).collect();
        experiment
    }

    /// The same with a value for a symbol.
    #[must_use]
    pub fn with(mut self, symbol: &str, value: Rational) -> Self {
        self.values.insert(symbol.to_owned(), value);
        self
    }
}

/// Why identifiability cannot be decided.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
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

/// A combination of parameters that can be estimated: the parameter itself plus multiples of unobservable ones.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BaseParameter {
    /// Index of the leading column.
    pub column: usize,
    /// What is lumped into it: column and factor, over the variables of [`Identifiability::variables`].
    pub others: Vec<(usize, Fraction<usize>)>,
}

/// What makes one parameter observable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Observability {
    /// Whether the experiments determine the parameter by itself.
    pub observable: bool,
    /// The rows in which it occurs, as indices into [`Identifiability::rows`].
    pub visible: Vec<usize>,
    /// The least harmonic up to which the rows determine it.
    pub band: Option<usize>,
    /// The experiments each of which determines it alone.
    pub experiments: Vec<usize>,
}

/// The result of [`identifiability`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identifiability {
    /// Names of the columns.
    pub parameters: Vec<String>,
    /// Names of the experiments.
    pub experiments: Vec<String>,
    /// Names of the equations.
    pub equations: Vec<String>,
    /// The rows of the stacked matrix.
    pub rows: Vec<RowLabel>,
    /// Names of the indeterminates: symbols without a value; with several experiments `lambda[2]` is the second's.
    pub variables: Vec<String>,
    /// The rank.
    pub rank: usize,
    /// Whether the rank is proven, not only right with a probability next to one.
    pub proven: bool,
    /// Unobservable directions, polynomials over the variables; `None` when they grow beyond use (the rank stands).
    pub unobservable: Option<Vec<Vec<Polynomial<usize>>>>,
    /// A maximal observable set; `None` together with the directions.
    pub base: Option<Vec<BaseParameter>>,
    /// For every column, what makes it observable.
    pub observability: Vec<Observability>,
    point: Vec<Vec<Rational>>,
}

/// Analyses what one or several experiments can identify.
///
/// # Errors
/// When the experiments do not belong together or a value does not belong to the table.
pub fn identifiability(experiments: &[Experiment<'_>]) -> Result<Identifiability, IdentifiabilityError> {
    let matrix = Matrix::new(experiments)?;
    let columns = matrix.parameters.len();
    let mut best: Option<(Vec<Vec<Rational>>, Vec<usize>)> = None;
    for number in 0..generic_point::POINTS {
        let point = matrix.at_point(number);
        let pivots = linear::reduce(&mut point.clone());
        if best.as_ref().is_none_or(|(_, best)| pivots.len() > best.len()) {
            best = Some((point, pivots));
        }
    }
    let (point, pivots) = best.expect("invariant: at least one point is tried");
    let unobservable = null_space(&matrix.entries, &point, &pivots);
    let proven = match &unobservable {
        Some(directions) => {
            directions.len() + pivots.len() == columns
                && directions.iter().all(|direction| annihilates(&matrix.entries, direction))
        }
        None => pivots.len() == columns,
    };
    let base = unobservable.as_ref().map(|directions| base_parameters(&pivots, columns, directions));
    let observability = observability(&matrix, &point);
    Ok(Identifiability {
        parameters: matrix.parameters,
        experiments: experiments.iter().map(|experiment| experiment.name.clone()).collect(),
        equations: matrix.equations,
        rows: matrix.rows,
        variables: matrix.variables,
        rank: pivots.len(),
        proven,
        unobservable,
        base,
        observability,
        point,
    })
}

struct Matrix {
    parameters: Vec<String>,
    equations: Vec<String>,
    variables: Vec<String>,
    rows: Vec<RowLabel>,
    entries: Vec<Vec<Polynomial<usize>>>,
}

impl Matrix {
    fn new(experiments: &[Experiment<'_>]) -> Result<Self, IdentifiabilityError> {
        let first = experiments.first().ok_or(IdentifiabilityError::NoExperiment)?;
        let parameters = &first.table.parameters;
        let mut variables: Vec<String> = Vec::new();
        let mut cells: BTreeMap<RowLabel, Vec<Polynomial<usize>>> = BTreeMap::new();
        for (number, experiment) in experiments.iter().enumerate() {
            let table = experiment.table;
            let name = || experiment.name.clone();
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
                let row = cells.entry(label).or_insert_with(|| vec![Polynomial::zero(); parameters.len()]);
                row[column].add_term(monomial, coefficient);
            }
        }
        let (rows, entries) = cells.into_iter().unzip();
        let names = |list: &[EcoString]| list.iter().map(EcoString::to_string).collect();
        Ok(Self { parameters: names(parameters), equations: names(&first.table.equations), variables, rows, entries })
    }

    fn at_point(&self, number: u64) -> Vec<Vec<Rational>> {
        let value = |entry: &Polynomial<usize>| {
            entry
                .evaluate(|&variable| generic_point::value(number, variable))
                .expect("invariant: generic values are positive")
        };
        self.entries.iter().map(|row| row.iter().map(value).collect()).collect()
    }
}

/// The directions that `entries` maps to zero, one for every column that is no pivot; `None` when they grow too large.
fn null_space(
    entries: &[Vec<Polynomial<usize>>],
    point: &[Vec<Rational>],
    pivots: &[usize],
) -> Option<Vec<Vec<Polynomial<usize>>>> {
    let columns = entries.first().map_or(0, Vec::len);
    if pivots.len() == columns {
        return Some(Vec::new());
    }
    if let Some((rows, scales)) = balance(entries, columns) {
        // M = D_rows B D_columns with monomial diagonals: null vectors of B, scaled back.
        let vectors = linear::null_space(rows, columns).into_iter().map(|vector| {
            let scaled = vector.into_iter().zip(&scales).map(|(value, scale)| Polynomial::term(scale.pow(-1), value));
            primitive_vector(scaled.map(Fraction::polynomial).collect())
        });
        return Some(vectors.collect());
    }
    // Rows that are independent at the point are independent, and the others follow from them.
    let mut transposed: Vec<Vec<Rational>> =
        (0..columns).map(|column| point.iter().map(|row| row[column].clone()).collect()).collect();
    let independent = linear::reduce(&mut transposed);
    let rows = independent.iter().map(|&r| entries[r].iter().cloned().map(Fraction::polynomial).collect()).collect();
    Some(null_space_of_fractions(rows, columns)?.into_iter().map(primitive_vector).collect())
}

/// Rational entries and the scales of the columns.
type Balanced = (Vec<Vec<Rational>>, Vec<Monomial<usize>>);

/// Writes every entry as (row monomial) * (rational) * (column monomial), when the matrix has that form: it does when
/// every column scales with one power product per row kind (Feng's M = T B Lambda).
fn balance(entries: &[Vec<Polynomial<usize>>], columns: usize) -> Option<Balanced> {
    let mut row_scale: Vec<Option<Monomial<usize>>> = vec![None; entries.len()];
    let mut column_scale: Vec<Option<Monomial<usize>>> = vec![None; columns];
    let mut terms: Vec<(usize, usize, &Monomial<usize>)> = Vec::new();
    for (r, row) in entries.iter().enumerate() {
        for (c, entry) in row.iter().enumerate().filter(|(_, entry)| !entry.is_zero()) {
            terms.push((r, c, entry.as_term()?.0));
        }
    }
    for start in 0..columns {
        if column_scale[start].is_some() {
            continue;
        }
        column_scale[start] = Some(Monomial::one());
        loop {
            let mut changed = false;
            for &(r, c, monomial) in &terms {
                match (&row_scale[r], &column_scale[c]) {
                    (None, Some(column)) => row_scale[r] = Some(monomial.mul(&column.pow(-1))),
                    (Some(row), None) => column_scale[c] = Some(monomial.mul(&row.pow(-1))),
                    (Some(row), Some(column)) if row.mul(column) != *monomial => return None,
                    _ => continue,
                }
                changed = true;
            }
            if !changed {
                break;
            }
        }
    }
    let value = |entry: &Polynomial<usize>| entry.as_term().map_or_else(Rational::zero, |(_, c)| c.clone());
    let rows = entries.iter().map(|row| row.iter().map(value).collect()).collect();
    let scales = column_scale.into_iter().map(|scale| scale.unwrap_or_default()).collect();
    Some((rows, scales))
}

/// Beyond this many terms in a coefficient a direction is of no use to a reader.
const MAX_TERMS: usize = 2000;

/// A basis of the null space over a field of rational functions, each vector with a 1 at its own free column; `None`
/// when coefficients grow beyond 2000 terms.
#[must_use]
pub fn null_space_of_fractions<V: Ord + Clone>(
    mut rows: Vec<Vec<Fraction<V>>>,
    columns: usize,
) -> Option<Vec<Vec<Fraction<V>>>> {
    let size = |value: &Fraction<V>| (value.denominator().len(), value.numerator().len());
    let mut pivots = Vec::new();
    for column in 0..columns {
        let top = pivots.len();
        // The shortest pivot keeps the others short.
        let found = (top..rows.len()).filter(|&r| !rows[r][column].is_zero()).min_by_key(|&r| size(&rows[r][column]));
        let Some(found) = found else { continue };
        rows.swap(top, found);
        let inverse = rows[top][column].inverse().expect("invariant: a pivot is not zero");
        for value in &mut rows[top][column..] {
            *value = value.mul(&inverse);
        }
        let pivot_row = rows[top].clone();
        for (r, row) in rows.iter_mut().enumerate() {
            if r == top || row[column].is_zero() {
                continue;
            }
            let factor = row[column].clone();
            for (value, pivot) in row[column..].iter_mut().zip(&pivot_row[column..]) {
                if !pivot.is_zero() {
                    *value = value.sub(&factor.mul(pivot));
                    if value.numerator().len() > MAX_TERMS {
                        return None;
                    }
                }
            }
        }
        pivots.push(column);
    }
    let free = (0..columns).filter(|column| !pivots.contains(column));
    let vectors = free.map(|free| {
        let mut vector = vec![Fraction::zero(); columns];
        vector[free] = Fraction::one();
        for (row, &pivot) in rows.iter().zip(&pivots) {
            vector[pivot] = row[free].scale(&-Rational::one());
        }
        vector
    });
    Some(vectors.collect())
}

/// The vector times whatever makes its components polynomials with whole coefficients and no common factor that is a
/// number or a monomial, the first one leading with a positive coefficient.
#[must_use]
pub fn primitive_vector<V: Ord + Clone>(vector: Vec<Fraction<V>>) -> Vec<Polynomial<V>> {
    let mut common = Fraction::one();
    for value in &vector {
        // Multiply by the denominators that remain after what was multiplied so far.
        for (factor, exponent) in value.mul(&common).denominator() {
            common = common.mul(&Fraction::polynomial(factor.pow(exponent)));
        }
    }
    let polynomials: Vec<Polynomial<V>> = vector.iter().map(|value| value.mul(&common).numerator().clone()).collect();
    let mut least: Option<BTreeMap<V, i32>> = None;
    let (mut numerator, mut denominator) = (BigInt::zero(), BigInt::one());
    for (monomial, coefficient) in polynomials.iter().flat_map(Polynomial::terms) {
        numerator = numerator.gcd(&coefficient.numer());
        denominator = denominator.lcm(&coefficient.denom());
        let own: BTreeMap<V, i32> = monomial.factors().map(|(v, e)| (v.clone(), e)).collect();
        least = Some(match least {
            None => own,
            Some(least) => {
                let variables: BTreeSet<V> = least.keys().chain(own.keys()).cloned().collect();
                let exponent = |map: &BTreeMap<V, i32>, v: &V| map.get(v).copied().unwrap_or(0);
                variables.into_iter().map(|v| (v.clone(), exponent(&least, &v).min(exponent(&own, &v)))).collect()
            }
        });
    }
    if numerator.is_zero() {
        return polynomials;
    }
    let shift: Monomial<V> = least.unwrap_or_default().into_iter().map(|(v, e)| (v, -e)).collect();
    let lead = polynomials.iter().find_map(|p| p.terms().next_back().map(|(_, c)| c.is_negative())).unwrap_or(false);
    let scale = Rational::new(denominator, if lead { -numerator } else { numerator });
    polynomials.iter().map(|polynomial| polynomial.mul_monomial(&shift).scale(&scale)).collect()
}

fn annihilates(entries: &[Vec<Polynomial<usize>>], direction: &[Polynomial<usize>]) -> bool {
    entries.iter().all(|row| {
        let mut sum = Polynomial::zero();
        for (entry, value) in row.iter().zip(direction).filter(|(entry, value)| !entry.is_zero() && !value.is_zero()) {
            sum.add_assign(&entry.mul(value));
        }
        sum.is_zero()
    })
}

/// M theta depends on theta only through theta_p + sum_f r_pf theta_f, where a direction with free column f has -r_pf
/// times its own component at p.
fn base_parameters(pivots: &[usize], columns: usize, directions: &[Vec<Polynomial<usize>>]) -> Vec<BaseParameter> {
    let free: Vec<usize> = (0..columns).filter(|column| !pivots.contains(column)).collect();
    let base = pivots.iter().map(|&column| {
        let others = free.iter().zip(directions).filter(|(_, direction)| !direction[column].is_zero());
        let others = others.filter_map(|(&other, direction)| {
            let ratio =
                Fraction::polynomial(direction[column].clone()).div(&Fraction::polynomial(direction[other].clone()))?;
            Some((other, ratio.scale(&-Rational::one())))
        });
        BaseParameter { column, others: others.collect() }
    });
    base.collect()
}

/// Which columns the given rows determine: those in which no null vector has a component.
fn determined(rows: Vec<Vec<Rational>>, columns: usize) -> Vec<bool> {
    let null = linear::null_space(rows, columns);
    (0..columns).map(|column| null.iter().all(|vector| vector[column].is_zero())).collect()
}

fn observability(matrix: &Matrix, point: &[Vec<Rational>]) -> Vec<Observability> {
    let columns = matrix.parameters.len();
    let chosen = |keep: &dyn Fn(&RowLabel) -> bool| -> Vec<bool> {
        let rows = point.iter().zip(&matrix.rows).filter(|(_, label)| keep(label)).map(|(row, _)| row.clone());
        determined(rows.collect(), columns)
    };
    let all = chosen(&|_| true);
    let mut band: Vec<Option<usize>> = vec![None; columns];
    let harmonics: BTreeSet<usize> = matrix.rows.iter().map(|label| label.harmonic).collect();
    for harmonic in harmonics {
        for (slot, known) in band.iter_mut().zip(chosen(&|label| label.harmonic <= harmonic)) {
            if known && slot.is_none() {
                *slot = Some(harmonic);
            }
        }
        if band.iter().zip(&all).all(|(band, observable)| band.is_some() || !observable) {
            break;
        }
    }
    let count = matrix.rows.iter().map(|label| label.experiment + 1).max().unwrap_or(0);
    let alone: Vec<Vec<bool>> = (0..count).map(|number| chosen(&|label| label.experiment == number)).collect();
    let each = (0..columns).map(|column| Observability {
        observable: all[column],
        visible: (0..matrix.rows.len()).filter(|&r| !matrix.entries[r][column].is_zero()).collect(),
        band: band[column],
        experiments: (0..count).filter(|&number| alone[number][column]).collect(),
    });
    each.collect()
}

/// What the experiments tell about the physical parameters behind the columns, for parameters in general position.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PhysicalIdentifiability {
    /// Names of the physical parameters.
    pub parameters: Vec<String>,
    /// Rank of the table times the Jacobian of the lumping map.
    pub rank: usize,
    /// For every physical parameter, whether it is determined locally.
    pub determined: Vec<bool>,
}

impl Identifiability {
    /// What the experiments tell about the physical parameters; `None` when a function of parameters has no exact value
    /// at rational points.
    #[must_use]
    pub fn physical(&self, map: &ParameterMap) -> Option<PhysicalIdentifiability> {
        let mut best: Option<PhysicalIdentifiability> = None;
        for number in 0..generic_point::POINTS {
            let Some(jacobian) = map.jacobian_exact(|symbol| generic_point::value(number, symbol.0 as usize)) else {
                continue;
            };
            let count = map.parameters().len();
            let product = self.point.iter().map(|row| {
                let mut values = vec![Rational::zero(); count];
                for (entry, rates) in row.iter().zip(&jacobian).filter(|(entry, _)| !entry.is_zero()) {
                    for (value, rate) in values.iter_mut().zip(rates) {
                        *value += entry * rate;
                    }
                }
                values
            });
            let null = linear::null_space(product.collect(), count);
            let rank = count - null.len();
            if best.as_ref().is_none_or(|best| rank > best.rank) {
                best = Some(PhysicalIdentifiability {
                    parameters: map.parameters().iter().map(|p| map.name(*p).to_owned()).collect(),
                    rank,
                    determined: (0..count).map(|i| null.iter().all(|vector| vector[i].is_zero())).collect(),
                });
            }
        }
        best
    }

    /// The result as plain data, for `tpm identifiability --json` and for printing.
    #[must_use]
    pub fn report(&self) -> Report {
        let name = |variable: &usize| self.variables[*variable].clone();
        let unobservable = self.unobservable.as_ref().map(|directions| {
            let entries = |direction: &Vec<Polynomial<usize>>| {
                let values = self.parameters.iter().zip(direction).filter(|(_, value)| !value.is_zero());
                values.map(|(parameter, value)| (parameter.clone(), display_polynomial(value, name))).collect()
            };
            directions.iter().map(entries).collect()
        });
        let base = self.base.as_ref().map(|base| {
            let one = |base: &BaseParameter| ReportedBase {
                parameter: self.parameters[base.column].clone(),
                plus: base
                    .others
                    .iter()
                    .map(|(column, factor)| (self.parameters[*column].clone(), factor.display(name)))
                    .collect(),
            };
            base.iter().map(one).collect()
        });
        let label = |row: &usize| {
            let RowLabel { experiment, equation, harmonic, function } = self.rows[*row];
            ReportedRow {
                experiment: self.experiments[experiment].clone(),
                equation: self.equations[equation].clone(),
                harmonic,
                function,
            }
        };
        let parameters = self.parameters.iter().zip(&self.observability).map(|(name, found)| ReportedParameter {
            name: name.clone(),
            observable: found.observable,
            harmonics_up_to: found.band,
            by_itself_in: found.experiments.iter().map(|number| self.experiments[*number].clone()).collect(),
            visible_in: found.visible.iter().map(label).collect(),
        });
        Report {
            schema: SCHEMA.to_owned(),
            rank: self.rank,
            columns: self.parameters.len(),
            rows: self.rows.len(),
            proven: self.proven,
            indeterminates: self.variables.clone(),
            unobservable,
            base,
            parameters: parameters.collect(),
        }
    }
}

/// The name of the JSON schema of a [`Report`].
pub const SCHEMA: &str = "tpm.identifiability/1";

/// [`Identifiability`] as plain data; coefficients are exact, in the model language.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// [`SCHEMA`].
    pub schema: String,
    /// The rank.
    pub rank: usize,
    /// Number of parameters.
    pub columns: usize,
    /// Number of harmonics rows.
    pub rows: usize,
    /// Whether the rank is proven, not only right with a probability next to one.
    pub proven: bool,
    /// The symbols that were left indeterminate.
    pub indeterminates: Vec<String>,
    /// Directions along which nothing is observed; absent when they are too long to print.
    pub unobservable: Option<Vec<BTreeMap<String, String>>>,
    /// A maximal observable set.
    pub base: Option<Vec<ReportedBase>>,
    /// Every parameter.
    pub parameters: Vec<ReportedParameter>,
}

/// `parameter + sum plus[other] * other` is observable.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReportedBase {
    /// The leading parameter.
    pub parameter: String,
    /// What is lumped into it.
    pub plus: BTreeMap<String, String>,
}

/// What makes a parameter observable.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReportedParameter {
    /// Its name.
    pub name: String,
    /// Whether it is determined by itself.
    pub observable: bool,
    /// The least harmonic up to which it is determined.
    pub harmonics_up_to: Option<usize>,
    /// The experiments each of which determines it alone.
    pub by_itself_in: Vec<String>,
    /// Where it has a coefficient.
    pub visible_in: Vec<ReportedRow>,
}

/// A row of the table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
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

/// The stacked matrix in double precision, rows as in [`Identifiability::rows`], for condition numbers.
///
/// `value` gives the symbols of experiment number i, in natural units.
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
