//! Base parameters: the combinations of parameters that any motion can identify, computed exactly.
//!
//! The rows of the regressor at many motions, stacked, have a rank r; the combinations that can be estimated are the
//! row space. The rows are evaluated at points whose coordinates are elements of a field ([`crate::expr::point`]), with
//! velocities and accelerations drawn at random.
//!
//! - The rank modulo a prime of 61 bits is a certain lower bound of r. It is smaller only with a probability of about d / 2^60 for
//!   entries of degree d (Schwartz and Zippel).
//! - The null space modulo a few primes is lifted to rationals. That every null vector is one is checked exactly at fresh rational
//!   points, and modulo another prime, where chance fails as rarely: an upper bound of r.
//!
//! Signs of the motion are drawn as 1 or -1, so that every motion is taken to turn both ways. Square roots, inverse functions and the
//! angle of a point are taken as independent of everything else that moves. Constants without a value, pi, and their functions have
//! values drawn once for all points: a combination that depends on them has no exact factors, and is left out while the rank stands.
//!
//! Invariant of [`BaseParameters`]: with the directions of its certificate, base parameters are complementary: the leading columns and
//! the free columns of the directions are all columns, each once.

use crate::algebra::field::{Field, Rationals, Residues, reconstruct};
use crate::expr::graph::{Coordinate, ExprId, Node, Symbol};
use crate::expr::point::{Drawn, Draws, Points};
use crate::mechanics::model::{ExactModel, Kind};
use crate::number::rational::Rational;
use crate::regressor::entries::RegressorForm;
use crate::regressor::homogeneous::{common_factors, homogeneous};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, Signed, Zero};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use thiserror::Error;

/// Number of successive points without a new independent row after which the rank counts as reached. There must be so
/// many, since a sign that is drawn alike at all of them would hide the terms that depend on it.
const NOTHING_NEW: usize = 24;

/// Number of points at which null vectors are checked over the rationals, and modulo a prime.
const CHECKS: usize = 2;

/// Number of the first point of a check; the points that determine a rank have smaller numbers.
const FRESH: u64 = 1 << 32;

/// Most primes from which factors are lifted. Angles that are no right ones have tangents of eight digits above and below; factors of
/// base parameters multiply a dozen of them on a long arm.
const MOST_PRIMES: usize = 64;

/// Most draws that may fail because a denominator vanishes.
const FAILURES: u64 = 20;

/// Position of a coordinate at rest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rest {
    /// An angle, given by the tangent of its half. Where it occurs as a number it is taken as generic, unless it is
    /// zero.
    HalfTangent(Rational),
    /// A length; its sine and cosine are taken as generic, unless it is zero.
    Value(Rational),
}

/// The motions in question: the moving coordinates, all independent of each other, and the values of constants.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Motions {
    /// Coordinates at rest. All others move.
    pub resting: BTreeMap<Coordinate, Rest>,
    /// Values of run-time constants.
    pub values: BTreeMap<Symbol, Rational>,
}

/// A combination of parameters that can be estimated: the parameter of a column plus multiples of others.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BaseParameter {
    /// Index of the leading column.
    pub column: usize,
    /// The parameters that are lumped into it: column and factor.
    pub others: Vec<(usize, Rational)>,
}

/// The data from which [`verify`] can check the result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Certificate {
    /// The rank.
    pub rank: usize,
    /// The prime modulo which the rows have this rank.
    pub prime: u64,
    /// The numbers of the points whose rows, stacked, have this rank.
    pub points: Vec<u64>,
    /// A basis of the null space, each vector as columns with nonzero factors, and with a factor of one at its own
    /// column, named first. `None` where the vectors depend on constants without a value.
    pub directions: Option<Vec<Vec<(usize, Rational)>>>,
}

/// The result of [`base_parameters`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BaseParameters {
    /// Names of the columns.
    pub parameters: Vec<String>,
    /// The rank.
    pub rank: usize,
    /// A maximal set of combinations that can be estimated; `None` where they depend on constants without a value.
    pub base: Option<Vec<BaseParameter>>,
    /// Sets of leading columns that motions show only up to a common factor, since rows without anything known in them alone
    /// show them. Each takes one from the rank of what a record of a motion that obeys the equations can show.
    pub common_factors: Vec<Vec<usize>>,
    /// The certificate of the result.
    pub certificate: Certificate,
}

impl BaseParameters {
    /// Directions along which no equation changes at any motion while the columns `held` keep their values, as columns
    /// with factors. In each direction the factor is one at a column that no other direction has. Empty where the
    /// directions depend on constants without a value.
    #[must_use]
    pub fn hidden(&self, held: &[usize]) -> Vec<Vec<(usize, Rational)>> {
        let certified = self.certificate.directions.iter().flatten();
        let mut directions: Vec<BTreeMap<usize, Rational>> =
            certified.map(|direction| direction.iter().cloned().collect()).collect();
        for column in held {
            let moving = (0..directions.len()).filter(|&index| directions[index].contains_key(column));
            // The shortest direction leaves the fewest terms in the others.
            let Some(shortest) = moving.min_by_key(|&index| directions[index].len()) else { continue };
            let pivot = directions.remove(shortest);
            for direction in &mut directions {
                let Some(share) = direction.get(column).map(|factor| factor / &pivot[column]) else { continue };
                for (other, factor) in &pivot {
                    let left = direction.get(other).cloned().unwrap_or_else(Rational::zero) - &share * factor;
                    if left.is_zero() {
                        direction.remove(other)
                    } else {
                        direction.insert(*other, left)
                    };
                }
            }
        }
        directions.into_iter().map(|direction| direction.into_iter().collect()).collect()
    }
}

/// Why the rank cannot be determined, or why a certificate does not hold.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BaseParameterError {
    /// The rows have no value at any point that was drawn.
    #[error("the equations divide by something that is zero at every motion that is asked about")]
    NoValue,
    /// The rows at the points of the certificate have a smaller rank.
    #[error("the rows at the certificate's points have rank {found} modulo its prime, not {claimed}")]
    Rank {
        /// The rank that was found.
        found: usize,
        /// The rank of the certificate.
        claimed: usize,
    },
    /// The null vectors are not independent, or their number is not that of the columns minus the rank.
    #[error("{found} independent null vectors are given, where {wanted} belong to the rank")]
    Count {
        /// How many independent ones there are.
        found: usize,
        /// How many there must be.
        wanted: usize,
    },
    /// A vector is no null vector.
    #[error("vector {direction} changes the rows of some motion")]
    NoNullVector {
        /// Its index.
        direction: usize,
    },
}

/// Dependence of a drawn value on the point.
enum Policy {
    /// An exact value.
    Exact(Rational),
    /// A constant: one value for all points.
    Constant(u64),
    /// Another value at every point.
    Moving(u64),
    /// 1 or -1 at every point.
    Sign(u64),
}

/// The rows of a regressor, to be evaluated at many points.
struct Rows<'a> {
    points: Points<'a>,
    policies: FxHashMap<Drawn, Policy>,
    rows: usize,
    columns: usize,
    /// Row, column, and factor of every term.
    terms: Vec<(usize, usize, Product)>,
}

/// A coefficient, and powers of the roots of the points.
type Product = (Rational, Vec<(usize, i32)>);

impl<'a> Rows<'a> {
    fn new(model: &'a ExactModel, form: &RegressorForm, motions: &Motions) -> Self {
        let all = form.rows.iter().enumerate().flat_map(|(r, row)| row.terms.iter().map(move |term| (r, term)));
        let mut atoms: Vec<ExprId> = Vec::new();
        let mut index: FxHashMap<ExprId, usize> = FxHashMap::default();
        let mut terms = Vec::new();
        for (row, term) in all {
            let Some(column) = term.column else { continue };
            let powers = term.atoms.factors().map(|(&atom, exponent)| {
                let root = *index.entry(atom).or_insert_with(|| {
                    atoms.push(atom);
                    atoms.len() - 1
                });
                (root, exponent)
            });
            terms.push((row, column, (term.coefficient.clone(), powers.collect())));
        }
        let points = Points::new(&model.graph, &atoms);
        let policies = points.drawn().map(|drawn| (drawn, policy(model, motions, &points, drawn))).collect();
        Self { points, policies, rows: form.rows.len(), columns: form.columns.len(), terms }
    }

    /// Whether constants without a value stand in the rows: null vectors that depend on them cannot be lifted.
    fn has_unknown_constants(&self) -> bool {
        self.policies.values().any(|policy| matches!(policy, Policy::Constant(_)))
    }

    /// The rows at a point; `None` where a divisor vanishes.
    fn at<F: Field>(&self, field: &F, number: u64) -> Option<Vec<Vec<F::Element>>> {
        // A draw depends only on its number and key, not on other draws.
        let word = |number: u64, key: u64| {
            let mut draws = Draws::new(number.wrapping_mul(0x1_0000_0001).wrapping_add(key));
            draws.word();
            draws.word()
        };
        let values = self.points.evaluate(field, |drawn| match self.policies.get(&drawn)? {
            Policy::Exact(value) => field.number(value),
            Policy::Constant(key) => Some(field.element(word(u64::MAX, *key))),
            Policy::Moving(key) => Some(field.element(word(number, *key))),
            Policy::Sign(key) if word(number, *key) >> 63 == 1 => Some(field.sub(&field.zero(), &field.one())),
            Policy::Sign(_) => Some(field.one()),
        })?;
        let mut matrix = vec![vec![field.zero(); self.columns]; self.rows];
        for (row, column, (coefficient, powers)) in &self.terms {
            let mut product = field.number(coefficient)?;
            for (root, exponent) in powers {
                product = field.mul(&product, &field.power(&values[*root], *exponent)?);
            }
            matrix[*row][*column] = field.add(&matrix[*row][*column], &product);
        }
        Some(matrix)
    }
}

/// Dependence of a drawn value on the point, with the key of its draws, which follows from the model alone.
fn policy(model: &ExactModel, motions: &Motions, points: &Points<'_>, drawn: Drawn) -> Policy {
    let graph = &model.graph;
    let key = match drawn {
        Drawn::Value(id) => 4 * id.index() as u64,
        Drawn::HalfTangent(unit) => 4 * unit as u64 + 1,
        Drawn::Sign(id) => 4 * id.index() as u64 + 2,
    };
    let rests = |leaf: ExprId| match *graph.node(leaf) {
        Node::Derivative(coordinate, order) => motions.resting.get(&coordinate).map(|rest| (rest, order)),
        _ => None,
    };
    let moves = |leaf: &ExprId| matches!(graph.node(*leaf), Node::Derivative(..)) && rests(*leaf).is_none();
    let moving = points.leaves(drawn).iter().any(moves);
    match drawn {
        Drawn::Sign(_) if moving => Policy::Sign(key),
        // For an argument of unknown value both signs are possible.
        Drawn::Sign(argument) => {
            let leaf = |leaf: &Node| match *leaf {
                Node::Symbol(symbol) => known(model, motions, symbol),
                Node::Derivative(coordinate, order) => match (motions.resting.get(&coordinate)?, order) {
                    (_, 1..) => Some(Rational::zero()),
                    (Rest::Value(value), 0) => Some(value.clone()),
                    (Rest::HalfTangent(value), 0) => value.is_zero().then(Rational::zero),
                },
                _ => None,
            };
            let value = graph.evaluate_exact(argument, leaf);
            Policy::Exact(value.filter(|value| !value.is_zero()).map_or_else(Rational::one, |value| value.signum()))
        }
        _ if moving => Policy::Moving(key),
        Drawn::Value(id) => {
            let exact = match *graph.node(id) {
                Node::Symbol(symbol) => known(model, motions, symbol),
                _ => match rests(id) {
                    Some((_, 1..)) => Some(Rational::zero()),
                    Some((Rest::Value(value), 0)) => Some(value.clone()),
                    Some((Rest::HalfTangent(value), 0)) if value.is_zero() => Some(Rational::zero()),
                    _ => None,
                },
            };
            exact.map_or(Policy::Constant(key), Policy::Exact)
        }
        Drawn::HalfTangent(unit) => {
            let unit = &points.units()[unit];
            let zero = Some(Rational::zero());
            let exact = match unit.factors.as_slice() {
                &[single] => match (graph.node(single), rests(single)) {
                    (_, Some((_, 1..))) => zero,
                    (_, Some((Rest::Value(value), 0))) if value.is_zero() => zero,
                    (_, Some((Rest::HalfTangent(value), 0))) if value.is_zero() || unit.divisor == 1 => {
                        Some(value.clone())
                    }
                    (Node::Symbol(symbol), _) => known(model, motions, *symbol).filter(Zero::is_zero),
                    _ => None,
                },
                _ => None,
            };
            exact.map_or(Policy::Constant(key), Policy::Exact)
        }
    }
}

/// The value of a constant.
fn known(model: &ExactModel, motions: &Motions, symbol: Symbol) -> Option<Rational> {
    match &model.quantity(symbol).kind {
        Kind::Constant { value: Some(value) } => Some(value.clone()),
        _ => motions.values.get(&symbol).cloned(),
    }
}

/// Rows in echelon form, one pivot each, in the order in which they were found.
struct Echelon<'f> {
    field: &'f Residues,
    rows: Vec<(usize, Vec<u64>)>,
}

impl Echelon<'_> {
    /// Adds a row; returns whether it was independent of the earlier ones.
    fn add(&mut self, mut row: Vec<u64>) -> bool {
        for (pivot, known) in &self.rows {
            let factor = row[*pivot];
            if factor != 0 {
                for (value, of_known) in row.iter_mut().zip(known).filter(|(_, of_known)| **of_known != 0) {
                    *value = self.field.sub(value, &self.field.mul(&factor, of_known));
                }
            }
        }
        let Some(pivot) = row.iter().position(|value| *value != 0) else { return false };
        let inverse = self.field.inverse(&row[pivot]).expect("invariant: a pivot is not zero");
        row.iter_mut().for_each(|value| *value = self.field.mul(value, &inverse));
        self.rows.push((pivot, row));
        true
    }
}

/// A basis of the space of some equations' rows modulo a prime, and the numbers of the points that gave it.
fn basis(
    rows: &Rows<'_>,
    field: &Residues,
    equations: &[usize],
) -> Result<(Vec<Vec<u64>>, Vec<u64>), BaseParameterError> {
    let mut echelon = Echelon { field, rows: Vec::new() };
    let (mut points, mut failures, mut nothing_new, mut number) = (Vec::new(), 0, 0, 0);
    while nothing_new < NOTHING_NEW && echelon.rows.len() < rows.columns {
        let matrix = rows.at(field, number);
        number += 1;
        let Some(mut matrix) = matrix else {
            failures += 1;
            if failures > FAILURES {
                return Err(BaseParameterError::NoValue);
            }
            continue;
        };
        let before = echelon.rows.len();
        for &equation in equations {
            echelon.add(std::mem::take(&mut matrix[equation]));
        }
        if echelon.rows.len() > before {
            points.push(number - 1);
            nothing_new = 0;
        } else {
            nothing_new += 1;
        }
    }
    Ok((echelon.rows.into_iter().map(|(_, row)| row).collect(), points))
}

/// The null vectors of rows in reduced echelon form: for every free column, named first, the factors of the pivots' columns.
fn null_vectors<T: Clone>(
    reduced: &[Vec<T>],
    pivots: &[usize],
    columns: usize,
    is_zero: impl Fn(&T) -> bool,
) -> Vec<(usize, Vec<(usize, T)>)> {
    let free = (0..columns).filter(|column| !pivots.contains(column));
    free.map(|free| {
        let factors = reduced.iter().zip(pivots).filter(|(row, _)| !is_zero(&row[free]));
        (free, factors.map(|(row, &pivot)| (pivot, row[free].clone())).collect())
    })
    .collect()
}

/// The base parameters of a model in regressor form under some motions.
///
/// Leading columns are taken from the first to the last, or from the last to the first, whichever gives fewer terms: where the links of
/// an arm are declared from its base outward, the first order regroups the parameters of outer links into those of inner ones (Gautier
/// and Khalil 1990).
///
/// # Errors
/// When the equations have no value at the motions in question.
pub fn base_parameters(
    model: &ExactModel,
    form: &RegressorForm,
    motions: &Motions,
) -> Result<BaseParameters, BaseParameterError> {
    let rows = Rows::new(model, form, motions);
    let columns = rows.columns;
    let [field, .., checking] = Residues::PRIMES.map(Residues::new);
    let all: Vec<usize> = (0..rows.rows).collect();
    let (first, points) = basis(&rows, &field, &all)?;
    let rank = first.len();
    let (mut fields, mut bases) = (Vec::new(), Vec::new());
    let most = if rows.has_unknown_constants() { Residues::PRIMES.len() } else { MOST_PRIMES };
    let forward = declared(model, form);
    let backward: Vec<usize> = forward.iter().rev().copied().collect();
    let (mut base, mut fresh) = (None, None);
    for (index, field) in Residues::all().take(most).enumerate() {
        let next = if index == 0 { first.clone() } else { basis(&rows, &field, &all)?.0 };
        // A different rank would mean that the prime divides a determinant or denominator.
        if next.len() != rank {
            continue;
        }
        fields.push(field);
        bases.push(next);
        let lifted = [&forward, &backward].map(|order| lift(&fields, &bases, order, columns));
        let sound = lifted.into_iter().flatten().filter(|vectors| {
            let directions: Vec<Vec<(usize, Rational)>> = vectors.iter().map(direction).collect();
            let (residues, rationals) =
                fresh.get_or_insert_with(|| (at_fresh(&rows, &checking, FRESH), at_fresh(&rows, &Rationals, FRESH)));
            annihilate(residues, &directions, &checking).is_ok()
                && annihilate(rationals, &directions, &Rationals).is_ok()
        });
        base = sound.reduce(|best, next| if terms(&next) < terms(&best) { next } else { best });
        if base.is_some() {
            break;
        }
    }
    let directions = base.as_ref().map(|vectors| vectors.iter().map(direction).collect());
    let leading: Vec<usize> = match &base {
        Some(vectors) => (0..columns).filter(|column| vectors.iter().all(|(free, _)| free != column)).collect(),
        None => field.reduce(&mut first.clone(), &forward),
    };
    let common_factors = up_to_factors(&rows, &field, &homogeneous(form), &leading)?;
    let base = base.map(|vectors| {
        let lumped = |column: usize| {
            let others = vectors.iter().filter_map(|(free, factors)| {
                factors.iter().find(|(pivot, _)| *pivot == column).map(|(_, factor)| (*free, factor.clone()))
            });
            BaseParameter { column, others: others.collect() }
        };
        leading.iter().copied().map(lumped).collect()
    });
    let certificate = Certificate { rank, prime: field.prime(), points, directions };
    let parameters = form.columns.iter().map(|column| column.name.to_string()).collect();
    Ok(BaseParameters { parameters, rank, base, common_factors, certificate })
}

/// Sets of leading columns that rows without anything known in them show only up to a common factor.
fn up_to_factors(
    rows: &Rows<'_>,
    field: &Residues,
    homogeneous: &[usize],
    leading: &[usize],
) -> Result<Vec<Vec<usize>>, BaseParameterError> {
    if homogeneous.is_empty() {
        return Ok(Vec::new());
    }
    let driven: Vec<usize> = (0..rows.rows).filter(|row| !homogeneous.contains(row)).collect();
    let driven = basis(rows, field, &driven)?.0;
    let free = homogeneous.iter().map(|&row| Ok(basis(rows, field, &[row])?.0)).collect::<Result<_, _>>()?;
    let mut draws = Draws::new(u64::MAX);
    let theta: Vec<u64> = (0..rows.columns).map(|_| field.element(draws.word())).collect();
    Ok(common_factors(field, driven, free, &theta, leading))
}

/// The columns in the order in which their first parameters were declared; a lumped one has the place of its first
/// parameter.
fn declared(model: &ExactModel, form: &RegressorForm) -> Vec<usize> {
    let first = |column: usize| {
        let definition = &form.columns[column].definition;
        let atoms = definition.terms().flat_map(|(monomial, _)| monomial.factors().map(|(&atom, _)| atom));
        let symbols = model.graph.leaves_of(atoms).into_iter().filter_map(|leaf| match model.graph.node(leaf) {
            Node::Symbol(symbol) => Some(*symbol),
            _ => None,
        });
        symbols.min()
    };
    let mut order: Vec<usize> = (0..form.columns.len()).collect();
    order.sort_by_cached_key(|&column| (first(column), column));
    order
}

/// A null vector by its free column, with the factors by which the free column is added to the leading columns.
type Lifted = (usize, Vec<(usize, Rational)>);

fn terms(vectors: &[Lifted]) -> usize {
    vectors.iter().map(|(_, factors)| factors.len()).sum()
}

/// A null vector with all its components: one at its free column, and the negative factors.
fn direction((free, factors): &Lifted) -> Vec<(usize, Rational)> {
    std::iter::once((*free, Rational::one())).chain(factors.iter().map(|(pivot, factor)| (*pivot, -factor))).collect()
}

/// The null vectors over the rationals, from those modulo several primes (Chinese remainders, then rational reconstruction).
fn lift(fields: &[Residues], bases: &[Vec<Vec<u64>>], order: &[usize], columns: usize) -> Option<Vec<Lifted>> {
    let mut modulus = BigInt::one();
    let mut residues: Vec<(usize, BTreeMap<usize, BigInt>)> = Vec::new();
    let mut leading: Option<Vec<usize>> = None;
    for (field, basis) in fields.iter().zip(bases) {
        let mut reduced = basis.clone();
        let pivots = field.reduce(&mut reduced, order);
        if leading.get_or_insert_with(|| pivots.clone()) != &pivots {
            return None;
        }
        let vectors = null_vectors(&reduced, &pivots, columns, |value| *value == 0);
        if residues.is_empty() {
            residues = vectors.iter().map(|(free, _)| (*free, BTreeMap::new())).collect();
        }
        let prime = BigInt::from(field.prime());
        let inverse = field.inverse(&field.element(residue(&modulus, field)))?;
        for ((_, known), (_, factors)) in residues.iter_mut().zip(vectors) {
            let found: BTreeMap<usize, u64> = factors.into_iter().collect();
            let pivots: Vec<usize> = known.keys().chain(found.keys()).copied().collect();
            for pivot in pivots {
                let slot = known.entry(pivot).or_default();
                let wanted = found.get(&pivot).copied().unwrap_or(0);
                let step = field.mul(&field.sub(&wanted, &residue(slot, field)), &inverse);
                *slot += &modulus * BigInt::from(step);
            }
        }
        modulus *= prime;
    }
    let vectors = residues.into_iter().map(|(free, factors)| {
        let factors = factors.into_iter().map(|(pivot, value)| Some((pivot, reconstruct(&value, &modulus)?)));
        let factors: Option<Vec<(usize, Rational)>> = factors.collect();
        Some((free, factors?.into_iter().filter(|(_, factor)| !factor.is_zero()).collect()))
    });
    vectors.collect()
}

fn residue(value: &BigInt, field: &Residues) -> u64 {
    let rest = value.mod_floor(&BigInt::from(field.prime()));
    debug_assert!(!rest.is_negative());
    rest.iter_u64_digits().next().unwrap_or(0)
}

/// The rows at a few points of a field, beginning with the point `first`, each cleared of denominators; fewer points
/// where a denominator vanishes repeatedly.
fn at_fresh<F: Field>(rows: &Rows<'_>, field: &F, first: u64) -> Vec<Vec<Vec<F::Element>>> {
    let matrices = (first..first + CHECKS as u64 + FAILURES).filter_map(|number| rows.at(field, number));
    let cleared = |matrix: Vec<Vec<F::Element>>| matrix.into_iter().map(|row| field.cleared(row)).collect();
    matrices.take(CHECKS).map(cleared).collect()
}

/// Checks that vectors are null vectors of the rows at all fresh points.
fn annihilate<F: Field>(
    matrices: &[Vec<Vec<F::Element>>],
    directions: &[Vec<(usize, Rational)>],
    field: &F,
) -> Result<(), BaseParameterError> {
    if matrices.len() < CHECKS {
        return Err(BaseParameterError::NoValue);
    }
    for (index, direction) in directions.iter().enumerate() {
        let no_null_vector = BaseParameterError::NoNullVector { direction: index };
        let factors: Option<Vec<F::Element>> = direction.iter().map(|(_, factor)| field.number(factor)).collect();
        let Some(factors) = factors.map(|factors| field.cleared(factors)) else { return Err(no_null_vector) };
        for row in matrices.iter().flatten() {
            let mut sum = field.zero();
            for ((column, _), factor) in direction.iter().zip(&factors) {
                let Some(entry) = row.get(*column) else { return Err(no_null_vector) };
                if !field.is_zero(entry) {
                    sum = field.add(&sum, &field.mul(entry, factor));
                }
            }
            if !field.is_zero(&sum) {
                return Err(no_null_vector);
            }
        }
    }
    Ok(())
}

/// Checks a certificate for a model in regressor form under some motions: the rows at its points must have its rank,
/// and its vectors must be independent null vectors, at points that `seed` chooses. The check uses no intermediate
/// result of the computation of the certificate.
///
/// # Errors
/// When the certificate does not hold; the fault is named.
pub fn verify(
    model: &ExactModel,
    form: &RegressorForm,
    motions: &Motions,
    certificate: &Certificate,
    seed: u64,
) -> Result<(), BaseParameterError> {
    let rows = Rows::new(model, form, motions);
    let field = Residues::PRIMES.map(Residues::new).into_iter().find(|field| field.prime() == certificate.prime);
    let wrong_rank = |found| BaseParameterError::Rank { found, claimed: certificate.rank };
    let field = field.ok_or(wrong_rank(0))?;
    let mut stacked = Vec::new();
    for &point in &certificate.points {
        stacked.extend(rows.at(&field, point).ok_or(BaseParameterError::NoValue)?);
    }
    let order: Vec<usize> = (0..rows.columns).collect();
    let found = field.reduce(&mut stacked, &order).len();
    if found != certificate.rank {
        return Err(wrong_rank(found));
    }
    let Some(directions) = &certificate.directions else { return Ok(()) };
    let wanted = rows.columns - certificate.rank;
    let mut matrix: Vec<Vec<Rational>> = Vec::with_capacity(directions.len());
    for (index, direction) in directions.iter().enumerate() {
        let mut row = vec![Rational::zero(); rows.columns];
        for (column, factor) in direction {
            let slot = row.get_mut(*column).ok_or(BaseParameterError::NoNullVector { direction: index })?;
            slot.clone_from(factor);
        }
        matrix.push(row);
    }
    let independent = Rationals.reduce(&mut matrix, &order).len();
    if independent != wanted || directions.len() != wanted {
        return Err(BaseParameterError::Count { found: independent, wanted });
    }
    let first = FRESH.wrapping_add(seed % FRESH).wrapping_mul(2);
    for field in Residues::PRIMES.map(Residues::new) {
        annihilate(&at_fresh(&rows, &field, first), directions, &field)?;
    }
    annihilate(&at_fresh(&rows, &Rationals, first), directions, &Rationals)
}
