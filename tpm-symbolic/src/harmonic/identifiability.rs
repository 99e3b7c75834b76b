//! Exact identifiability from harmonic tables: rank, unobservable directions, base parameters.
//!
//! The harmonics of all inputs are M theta, where M has one row for every experiment, equation, harmonic and function
//! (cosine or sine) and its entries are Laurent polynomials in amplitudes, frequency, run-time constants and pi. The
//! combinations of theta that can be estimated are the row space of M. Everything is decided exactly:
//!
//! - values given for symbols are exact rationals; a symbol without one is an indeterminate;
//! - the rank at a point is a lower bound of the generic rank ([`generic_point`]), and every unobservable direction is checked
//!   to satisfy M v = 0 identically, an upper bound. Where both agree ([`Identifiability::proven`]) the rank is certain;
//! - pi is transcendental, so that over the rationals it is an indeterminate as well.
//!
//! A row that is needed for the rank has no redundancy (Baarda 1968): M theta fits it exactly, whatever its value, so
//! that an unmodelled force in it biases the parameters without leaving a residual. Rows without redundancy are those
//! that are zero in every linear relation between rows.
//!
//! Amplitudes without a value are taken as positive where a term depends on their sign.
//!
//! Invariants of [`Identifiability`]: directions are primitive polynomial vectors (no common monomial factor, whole
//! coefficients without a common divisor), each with its own column that is zero in all others; base parameters and
//! these free columns are complementary.

use crate::algebra::field::{Field, Rationals};
use crate::algebra::fraction::Fraction;
use crate::algebra::generic_point;
use crate::algebra::linear;
use crate::algebra::null_space::{null_space_of_fractions, primitive_vector};
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::harmonic::stacked::Matrix;
use crate::number::rational::Rational;
use crate::regressor::homogeneous::common_factors;
use crate::regressor::parameter_map::ParameterMap;
use num_traits::{One, Zero};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

pub use crate::harmonic::stacked::{Experiment, IdentifiabilityError, RowLabel, evaluated_matrix};

/// A combination of parameters that can be estimated: the parameter itself plus multiples of unobservable ones.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BaseParameter {
    /// Index of the leading column.
    pub column: usize,
    /// The parameters that are lumped into it: column and factor, over the variables of [`Identifiability::variables`].
    pub others: Vec<(usize, Fraction<usize>)>,
}

/// Observability of one parameter.
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
    /// The rows without redundancy that determine the base parameter which the column leads. A force in such a row that
    /// the model lacks biases the base parameter and leaves no residual. Empty for a column that leads none.
    pub unchecked: Vec<usize>,
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
    /// Whether the rank is proven, rather than right with a probability close to one.
    pub proven: bool,
    /// Unobservable directions, polynomials over the variables; `None` when they become too large (the rank is still
    /// valid).
    pub unobservable: Option<Vec<Vec<Polynomial<usize>>>>,
    /// A maximal observable set; `None` together with the directions.
    pub base: Option<Vec<BaseParameter>>,
    /// Observability of the parameter of every column.
    pub observability: Vec<Observability>,
    point: Vec<Vec<Rational>>,
}

/// Analyses which parameters one or several experiments can identify.
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
    let observability = observability(&matrix, &point, &pivots);
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

/// The directions that `entries` maps to zero, one for every column that is no pivot; `None` when they become too
/// large.
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
    // Rows that are independent at the point are independent, and the others are combinations of them.
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

fn observability(matrix: &Matrix, point: &[Vec<Rational>], pivots: &[usize]) -> Vec<Observability> {
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
    let unchecked = unchecked(point, pivots, columns);
    let each = unchecked.into_iter().enumerate().map(|(column, unchecked)| Observability {
        observable: all[column],
        visible: (0..matrix.rows.len()).filter(|&r| !matrix.entries[r][column].is_zero()).collect(),
        band: band[column],
        experiments: (0..count).filter(|&number| alone[number][column]).collect(),
        unchecked,
    });
    each.collect()
}

/// The rows without redundancy that determine each base parameter, by its leading column; `pivots` are the leading
/// columns.
fn unchecked(point: &[Vec<Rational>], pivots: &[usize], columns: usize) -> Vec<Vec<usize>> {
    let mut found = vec![Vec::new(); columns];
    let (independent, needed) = if pivots.len() == point.len() {
        let all: Vec<usize> = (0..point.len()).collect();
        (all.clone(), all)
    } else {
        independent_rows(point, columns)
    };
    if needed.is_empty() {
        return found;
    }
    // The independent rows are T b with the base parameters b; T consists of their entries at the leading columns. The
    // inverse of T gives the rows on which a base parameter depends.
    let mut system: Vec<Vec<Rational>> = independent
        .iter()
        .map(|row| {
            let entries = pivots.iter().map(|&lead| point[*row][lead].clone());
            let unit = needed.iter().map(|own| if own == row { Rational::one() } else { Rational::zero() });
            entries.chain(unit).collect()
        })
        .collect();
    linear::reduce(&mut system);
    for (&lead, parts) in pivots.iter().zip(&system) {
        let dependent = needed.iter().zip(&parts[pivots.len()..]).filter(|(_, part)| !part.is_zero());
        found[lead].extend(dependent.map(|(&row, _)| row));
    }
    found
}

/// A maximal set of independent rows, and those of them without redundancy.
fn independent_rows(point: &[Vec<Rational>], columns: usize) -> (Vec<usize>, Vec<usize>) {
    // The echelon form of the transpose writes all rows as combinations of the independent ones. An independent row
    // that occurs in no combination but its own has no redundancy.
    let mut transposed: Vec<Vec<Rational>> =
        (0..columns).map(|column| point.iter().map(|row| row[column].clone()).collect()).collect();
    let independent = linear::reduce(&mut transposed);
    let alone = |(parts, own): &(&Vec<Rational>, &usize)| {
        parts.iter().enumerate().all(|(row, part)| row == **own || part.is_zero())
    };
    let needed = transposed.iter().zip(&independent).filter(alone).map(|(_, &own)| own).collect();
    (independent, needed)
}

/// Identifiability of the physical parameters behind the columns, for parameters in general position.
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
    /// Sets of columns that the experiments show only up to a common factor, since rows of `homogeneous` equations alone show them. Each
    /// takes one from the rank: patterns are prescribed, but motions obey these equations.
    #[must_use]
    pub fn common_factors(&self, homogeneous: &[usize]) -> Vec<Vec<usize>> {
        if homogeneous.is_empty() {
            return Vec::new();
        }
        let of = |keep: &dyn Fn(usize) -> bool| -> Vec<Vec<Rational>> {
            let rows = self.point.iter().zip(&self.rows).filter(|(_, label)| keep(label.equation));
            rows.map(|(row, _)| row.clone()).collect()
        };
        let columns = self.parameters.len();
        let order: Vec<usize> = (0..columns).collect();
        let leading = Rationals.reduce(&mut self.point.clone(), &order);
        // Numbers beyond those of symbols, so that parameters are independent of them.
        let theta: Vec<Rational> =
            (0..columns).map(|column| generic_point::value(generic_point::POINTS, column)).collect();
        let driven = of(&|equation| !homogeneous.contains(&equation));
        let free = homogeneous.iter().map(|&own| of(&|equation| equation == own)).collect();
        common_factors(&Rationals, driven, free, &theta, &leading)
    }

    /// Identifiability of the physical parameters from the experiments; `None` when a function of parameters has no
    /// exact value at rational points.
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
}
