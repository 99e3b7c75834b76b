//! Values of a model's own parameters that agree with what an identification knows.
//!
//! Unknowns are the parameters without an identified or given value. They solve c(p) = what the result states of the parameters in
//! which the model is linear: their values, and combinations of those that do not show one by one (Gauss-Newton, each step the
//! shortest one in relative terms, so that nothing moves along what the equations leave open).
//!
//! Invariant: every set of values of an [`Agreeing`] solves these equations alike. Whatever differs between the sets is not known.

use std::collections::{BTreeMap, BTreeSet};
use tpm_codegen::identified::{Identified, IdentifiedParameter, Weights, display, open};
use tpm_estimate::reduced;
use tpm_numerics::singular::Singular;
use tpm_numerics::{DMatrix, DVector, Iteration, tolerance};
use tpm_physical::is_lumped;
use tpm_symbolic::expr::graph::{Node, Symbol};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::{PrepareError, prepare_any};

/// The search for the nearest solution, until a step is a small share of every parameter.
const SEARCH: Iteration = Iteration { most: 60, settled: 1e-13 };
/// Most halvings of one step of the search.
const MOST_HALVINGS: usize = 60;
/// How far other sets of values lie away, as the largest relative change of a parameter.
const CHANGE_OF_OTHER_SETS: f64 = 0.25;

/// Values of a model's own parameters that agree with an identification.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Agreeing {
    /// One set of values of the parameters that are neither identified nor given.
    pub values: BTreeMap<String, f64>,
    /// Those of them that follow from stated priors and from what the data show.
    pub from_prior: Vec<String>,
    /// Directions along which the values may move, and the result still holds.
    pub open: Vec<OpenDirection>,
}

/// A direction along which parameters may move.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct OpenDirection {
    /// The direction as text, such as `0.5 m2 + J3`.
    pub direction: String,
    /// The parameters that take part in it.
    pub parameters: Vec<String>,
    /// Other sets of values, on both sides of [`Agreeing::values`].
    pub others: Vec<BTreeMap<String, f64>>,
}

/// Why there are no values that agree with an identification.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AgreeingError {
    /// The model has no regressor form.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// No values were found for parameters that were not identified.
    #[error("no values of {} were found that agree with the result", .names.join(", "))]
    NotFound {
        /// The parameters.
        names: Vec<String>,
    },
}

/// Finds values of the parameters that are neither identified nor `given`; `given` also has the values of constants that are known at
/// run time. Priors of the result are kept along what it leaves open.
///
/// # Errors
/// [`AgreeingError::Prepare`] when the model has no regressor form; [`AgreeingError::NotFound`] when the search does not end.
pub fn agreeing(
    model: &ExactModel,
    identified: &Identified,
    given: &BTreeMap<String, f64>,
) -> Result<Agreeing, AgreeingError> {
    let prepared = prepare_any(model.clone())?;
    let map = ParameterMap::new(&prepared);
    let search = Search::new(&map, identified, given, is_lumped(&prepared));
    let nothing = AgreeingError::NotFound { names: search.free.iter().map(|&i| search.names[i].clone()).collect() };
    let values = search.solve(search.start.clone()).ok_or_else(|| nothing.clone())?;
    let name = |k: usize| search.names[search.free[k]].clone();
    let directions: Vec<Weights> = search
        .directions(&values)
        .into_iter()
        .map(|direction| direction.into_iter().enumerate().map(|(k, weight)| (name(k), weight)).collect())
        .collect();
    let is_stated = |name: &str| search.stated.contains(name);
    let named = |values: &DVector<f64>| -> BTreeMap<String, f64> {
        values.iter().enumerate().map(|(k, value)| (name(k), *value)).collect()
    };
    let mut left = Vec::new();
    for direction in open(&directions, is_stated) {
        let step = DVector::from_fn(values.len(), |k, _| direction.get(&name(k)).copied().unwrap_or(0.0));
        let relative = step.iter().zip(&values).filter(|(_, value)| **value != 0.0).map(|(d, value)| (d / value).abs());
        let largest = relative.fold(0.0, f64::max);
        let length = if largest > 0.0 { CHANGE_OF_OTHER_SETS / largest } else { 1.0 };
        let others: Option<Vec<_>> =
            [length, -length].iter().map(|length| Some(named(&search.solve(&values + &step * *length)?))).collect();
        left.push(OpenDirection {
            direction: display(&direction),
            parameters: direction.into_keys().collect(),
            others: others.ok_or_else(|| nothing.clone())?,
        });
    }
    let is_open = |name: &String| left.iter().any(|open| open.parameters.contains(name));
    let moves = |name: &String| directions.iter().any(|direction| direction.contains_key(name));
    let values = named(&values);
    let from_prior = values.keys().filter(|name| moves(name) && !is_open(name)).cloned().collect();
    Ok(Agreeing { from_prior, values, open: left })
}

/// An equation: a weighted sum of columns has a value, in units of its deviation.
struct Equation {
    weights: Vec<(usize, f64)>,
    value: f64,
    deviation: f64,
}

struct Search<'a> {
    map: &'a ParameterMap,
    /// Names of the parameters of the map.
    names: Vec<String>,
    /// Indices of the unknowns among them.
    free: Vec<usize>,
    start: DVector<f64>,
    /// Unknowns that were stated before the identification.
    stated: BTreeSet<String>,
    /// Values of identified and given parameters, and of constants, by name.
    known: BTreeMap<String, f64>,
    /// Values of the quantities in the map that are no parameters of it.
    constants: BTreeMap<Symbol, f64>,
    equations: Vec<Equation>,
}

impl<'a> Search<'a> {
    fn new(map: &'a ParameterMap, identified: &Identified, given: &BTreeMap<String, f64>, lumped: bool) -> Self {
        let names: Vec<String> = map.parameters().iter().map(|&symbol| map.name(symbol).to_string()).collect();
        let of = |name: &str| -> Option<&IdentifiedParameter> {
            identified.physical.iter().chain(&identified.parameters).find(|entry| entry.name == name)
        };
        let mut known: BTreeMap<String, f64> =
            names.iter().filter_map(|name| Some((name.clone(), of(name)?.value?))).collect();
        known.extend(given.iter().map(|(name, value)| (name.clone(), *value)));
        let free: Vec<usize> = (0..names.len()).filter(|&i| !known.contains_key(&names[i])).collect();
        let prior = |name: &str| of(name)?.stated();
        // A product has no derivative where both factors are zero.
        let plain = if lumped { 1.0 } else { 0.0 };
        let start = free.iter().map(|&i| prior(&names[i]).unwrap_or(plain));
        let start = DVector::from_iterator(free.len(), start);
        let stated = free.iter().map(|&i| &names[i]).filter(|name| prior(name).is_some()).cloned().collect();
        let column = |name: &String| map.columns().iter().position(|column| column == name);
        let sharp = |value: f64, std: Option<f64>| match std {
            Some(std) if std > tolerance::EXACT_DEVIATION * value.abs() => std,
            _ if value != 0.0 => tolerance::EXACT_DEVIATION * value.abs(),
            _ => 1.0,
        };
        let shown = identified.parameters.iter().filter_map(|entry| {
            let value = entry.value?;
            let weights = vec![(column(&entry.name)?, 1.0)];
            Some(Equation { weights, value, deviation: sharp(value, entry.std) })
        });
        let combined = identified.combinations.iter().filter_map(|shown| {
            let weights = shown.terms.iter().map(|(name, weight)| Some((column(name)?, *weight)));
            let deviation = sharp(shown.value, Some(shown.std));
            Some(Equation { weights: weights.collect::<Option<_>>()?, value: shown.value, deviation })
        });
        let equations = shown.chain(combined).collect();
        let mut search = Search { map, names, free, start, stated, known, constants: BTreeMap::new(), equations };
        search.constants = search.constants_of_map();
        search
    }

    /// Values of the quantities in the map that are no parameters of it, as far as they are known.
    fn constants_of_map(&self) -> BTreeMap<Symbol, f64> {
        let graph = self.map.graph();
        let atoms =
            self.map.definitions().iter().flat_map(|d| d.terms().flat_map(|(m, _)| m.factors().map(|(&a, _)| a)));
        let leaves = atoms.flat_map(|atom| graph.leaves(atom)).filter_map(|leaf| match graph.node(leaf) {
            Node::Symbol(symbol) => Some(*symbol),
            _ => None,
        });
        leaves.filter_map(|symbol| Some((symbol, *self.known.get(self.map.name(symbol))?))).collect()
    }

    fn value(&self, values: &DVector<f64>) -> impl Fn(Symbol) -> f64 {
        let mut all = self.constants.clone();
        for (i, &symbol) in self.map.parameters().iter().enumerate() {
            let own = self.free.iter().position(|&free| free == i).map(|k| values[k]);
            all.extend(own.or_else(|| self.known.get(&self.names[i]).copied()).map(|value| (symbol, value)));
        }
        move |symbol| all.get(&symbol).copied().unwrap_or(f64::NAN)
    }

    fn residuals(&self, values: &DVector<f64>) -> Option<DVector<f64>> {
        let columns = self.map.evaluate(self.value(values));
        let missing = |equation: &Equation| {
            let sum: f64 = equation.weights.iter().map(|(column, weight)| weight * columns[*column]).sum();
            (sum - equation.value) / equation.deviation
        };
        let residuals = DVector::from_iterator(self.equations.len(), self.equations.iter().map(missing));
        residuals.iter().all(|value| value.is_finite()).then_some(residuals)
    }

    /// The derivatives by the unknowns, each times its scale.
    fn jacobian(&self, values: &DVector<f64>, scale: &DVector<f64>) -> DMatrix<f64> {
        let rates = self.map.jacobian_at(self.value(values));
        DMatrix::from_fn(self.equations.len(), self.free.len(), |r, c| {
            let Equation { weights, deviation, .. } = &self.equations[r];
            let rate: f64 = weights.iter().map(|(column, weight)| weight * rates[*column][self.free[c]]).sum();
            rate * scale[c] / deviation
        })
    }

    fn scale(values: &DVector<f64>) -> DVector<f64> {
        values.map(|value| if value == 0.0 { 1.0 } else { value.abs() })
    }

    /// The values nearest to a start that solve the equations best; nothing when they do not exist, or the search does not end.
    fn solve(&self, start: DVector<f64>) -> Option<DVector<f64>> {
        let mut values = start;
        let mut residuals = self.residuals(&values)?;
        for _ in 0..SEARCH.most {
            let scale = Self::scale(&values);
            let singular = Singular::new(&self.jacobian(&values, &scale), tolerance::JACOBIAN_RANK);
            let along = singular.left.tr_mul(&residuals).component_div(&singular.values);
            let relative = &singular.right * along;
            if relative.amax() <= SEARCH.settled || relative.is_empty() {
                return Some(values);
            }
            let step = relative.component_mul(&scale);
            let shorter = (0..MOST_HALVINGS).find_map(|halvings| {
                let next = &values - &step * 0.5_f64.powi(halvings as i32);
                let left = self.residuals(&next)?;
                (left.norm() < residuals.norm()).then_some((next, left))
            });
            match shorter {
                Some(found) => (values, residuals) = found,
                // Rounding is all that is left.
                None => return Some(values),
            }
        }
        None
    }

    /// Directions of the unknowns along which no equation changes, with few components each.
    fn directions(&self, values: &DVector<f64>) -> Vec<Vec<f64>> {
        let scale = Self::scale(values);
        let jacobian = self.jacobian(values, &scale);
        if self.equations.is_empty() {
            let unit = |k: usize| (0..self.free.len()).map(|c| f64::from(u8::from(c == k))).collect();
            return (0..self.free.len()).map(unit).collect();
        }
        let null = Singular::new(&jacobian, tolerance::JACOBIAN_RANK).null();
        let directions = null.column_iter().map(|column| column.iter().copied().collect()).collect();
        let raw = |(_, direction): (usize, Vec<f64>)| direction.iter().zip(&scale).map(|(d, s)| d * s).collect();
        reduced(directions).into_iter().map(raw).collect()
    }
}
