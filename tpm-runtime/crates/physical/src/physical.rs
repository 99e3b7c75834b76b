//! Physical parameters computed from the lumped parameters in which a model is linear.
//!
//! The lumped parameters are c(p). With an estimate of c and its covariance S the physical parameters minimise `(c(p) -
//! c)' S^-1 (c(p) - c)` within their bounds (Gauss-Newton with the exact Jacobian, by Levenberg and Marquardt). There
//! are usually more c than p. The residual at the minimum then tests whether the c belong to a machine of this
//! structure at all (two carts: c4 = c3^2/(3 c7), c5 = c3^3/(27 c7^2); after Feng, Eqns 4.35-4.41).
//!
//! Standard deviations come from perturbed solutions: the estimate is moved by one standard deviation along each of its
//! combinations, up and down, and the shifts of p are added in squares. For a linear map the result equals that of the
//! Jacobian. Where p is a quotient of two estimates, one of which may vanish, or where a bound is near, the result is
//! larger. It is never smaller than the Jacobian's. It is also bounded below by the points from which the search
//! starts: where such a point lies at the distance `d` from the minimum, and its sum of squares is larger by `D`, the
//! variance is at least `d^2 / D`. Equality holds for a linear map along the worst direction.
//!
//! Where the data show the c up to powers of a common factor, the c(p) are brought to the factor of the estimate before they are compared:
//! products of powers are then what they are however far p goes along the factor, which a tangent does not give.
//!
//! Invariant: rows of `Weighted` are combinations of the c that the data determine, each of variance one and
//! uncorrelated with the others. Directions that the data do not determine have no row.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use std::collections::BTreeMap;
use tpm_controller::model::Model;
use tpm_estimate::{
    Estimate, Evidence, Information, POOR_PHYSICAL_DEVIATION, ParameterReport, PhysicalRemark, Scale, Status,
};
use tpm_experiment::Experiment;
use tpm_numerics::chance::deviation;
use tpm_numerics::singular::{Singular, complement, largest_one, unit_columns};
use tpm_numerics::{DMatrix, DVector, Dyn, Matrix, Owned, alarm, tolerance};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::mechanics::unit::Unit;
use tpm_symbolic::regressor::inverse::Inverse;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::Prepared;

/// Smallest relative standard deviation that is assumed of a lumped parameter; frozen ones have it.
const LEAST_RELATIVE_DEVIATION: f64 = 1e-12;

/// Prior knowledge about the physical parameters, by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhysicalSettings {
    /// A starting point of the search in addition to the closed inverse; unobservable parameters keep these values.
    pub prior: BTreeMap<String, f64>,
    /// Values of the parameters that are held constant.
    pub frozen: BTreeMap<String, f64>,
    /// Lower and upper bounds, infinite for none. A mass or a moment of inertia has the lower bound zero unless its
    /// bounds are stated.
    pub bounds: BTreeMap<String, (f64, f64)>,
    /// Values of the constants that are known at run time.
    pub constants: BTreeMap<String, f64>,
}

impl PhysicalSettings {
    /// What an experiment knows beforehand, with bounds of physical parameters.
    #[must_use]
    pub fn of(experiment: &Experiment, bounds: &BTreeMap<String, (f64, f64)>) -> Self {
        PhysicalSettings {
            prior: experiment.prior.clone(),
            frozen: experiment.frozen.clone(),
            bounds: bounds.clone(),
            constants: experiment.constants.clone(),
        }
    }
}

/// Physical parameters, and a test of whether the lumped ones are consistent with them.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Physical {
    /// Every physical parameter with its standard deviation.
    pub parameters: Vec<ParameterReport>,
    /// Status of every physical parameter.
    pub status: Vec<Status>,
    /// Values of the physical parameters; the prior where the lumped ones do not determine them.
    pub values: Vec<f64>,
    /// The lumped parameters computed from the physical ones.
    pub lumped: Vec<f64>,
    /// Their covariance.
    pub lumped_covariance: Matrix,
    /// Covariance, in the order of `parameters`; zero for parameters that are frozen or at a bound.
    pub covariance: Matrix,
    /// Directions that the lumped parameters do not determine, each scaled so that its largest component is one.
    pub unobservable: Vec<Vec<f64>>,
    /// Ratio of the largest to the smallest nonzero singular value of the weighted Jacobian after column scaling.
    pub condition: f64,
    /// Number of independent combinations of the physical parameters that the lumped ones determine.
    pub rank: usize,
    /// Weighted sum of squares of the residuals at the best physical parameters.
    pub misfit: f64,
    /// Number of relations among the lumped parameters that the misfit tests, which are its degrees of freedom.
    pub freedom: usize,
    /// What the user should know.
    pub remarks: Vec<PhysicalRemark>,
}

/// A fault of the settings.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PhysicalError {
    /// A parameter does not exist.
    #[error("there is no physical parameter `{name}`; there are {known}")]
    Unknown {
        /// The name that was given.
        name: String,
        /// Names of the model's physical parameters.
        known: String,
    },
    /// The bounds of a parameter exclude every value.
    #[error("the bounds of `{name}` hold no value: {low} to {high}")]
    EmptyBounds {
        /// The parameter.
        name: String,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// A constant in the map has no value.
    #[error("the map to the physical parameters needs a value of the constant `{name}`")]
    NoConstant {
        /// The constant.
        name: String,
    },
}

/// Whether a model's parameters were lumped, so that physical parameters are to be computed from them.
#[must_use]
pub fn is_lumped(prepared: &Prepared) -> bool {
    prepared.form.columns.iter().any(|column| column.parameter.is_none())
}

/// The physical parameters that fit an estimate of the lumped ones best.
///
/// # Errors
/// [`PhysicalError`] when the settings name an unknown parameter, have empty bounds, or lack the value of a constant.
pub fn physical(
    prepared: &Prepared,
    estimate: &Estimate,
    settings: &PhysicalSettings,
) -> Result<Physical, PhysicalError> {
    Ok(PhysicalFit::new(prepared, settings)?.of_estimate(estimate))
}

/// The map from physical to lumped parameters, derived once for many estimates.
#[derive(Clone, Debug)]
pub struct PhysicalFit {
    map: ParameterMap,
    inverse: Inverse,
    units: Vec<Option<String>>,
    fixed: Fixed,
}

impl PhysicalFit {
    /// Derives the map and checks the settings against it.
    ///
    /// # Errors
    /// [`PhysicalError`] when the settings name an unknown parameter, have empty bounds, or lack the value of a constant.
    pub fn new(prepared: &Prepared, settings: &PhysicalSettings) -> Result<Self, PhysicalError> {
        let map = ParameterMap::new(prepared);
        let fixed = Fixed::new(prepared, &map, settings)?;
        let unit = |&symbol: &Symbol| prepared.model.quantity(symbol).unit.as_ref().map(Unit::to_string);
        Ok(PhysicalFit { inverse: map.inverse(), units: map.parameters().iter().map(unit).collect(), fixed, map })
    }

    /// Names of the physical parameters, in the order of every result.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.map.parameters().iter().map(|&symbol| self.map.name(symbol))
    }

    /// The lumped parameters that belong to given physical ones.
    #[must_use]
    pub fn lumped(&self, values: &[f64]) -> Vec<f64> {
        self.map.evaluate(self.fixed.lookup(&self.map, values))
    }

    /// The physical parameters that fit an estimate of the lumped ones best.
    #[must_use]
    pub fn of_estimate(&self, estimate: &Estimate) -> Physical {
        let weighted = Weighted::new(estimate);
        let closed = self.closed(&estimate.values);
        let solution = self.best(&weighted, std::slice::from_ref(&closed));
        let spread = self.fixed.spread(&self.map, &weighted, &solution, &self.fixed.starts(&[closed]));
        self.fixed.report(&self.units, &self.map, &weighted, &solution, &spread)
    }

    /// The closed inverse, where it exists, of lumped parameters that need not be consistent.
    fn closed(&self, lumped: &[f64]) -> Vec<f64> {
        let mut closed = vec![f64::NAN; self.map.parameters().len()];
        for (symbol, value) in
            self.inverse.evaluate(lumped, |constant| self.fixed.constants.get(&constant).copied().unwrap_or(f64::NAN))
        {
            if let Some(i) = self.map.parameters().iter().position(|parameter| *parameter == symbol) {
                closed[i] = value;
            }
        }
        closed
    }

    /// The physical parameters that satisfy equations in the lumped ones best. Unlike a covariance, the equations also
    /// hold combinations of very small information. `gradient` is added to the right-hand side of their normal
    /// equations; `start` is an additional starting point of the search.
    pub(super) fn of_information(
        &self,
        information: &Information,
        gradient: Option<&[f64]>,
        start: &[f64],
    ) -> Physical {
        let lumped = information.solve(&self.lumped(start), gradient).values;
        let weighted = Weighted::of_information(information, gradient);
        let solution = self.best(&weighted, &[self.closed(&lumped), start.to_vec()]);
        self.fixed.report(&self.units, &self.map, &weighted, &solution, &vec![0.0; solution.values.len()])
    }

    /// The solution of smallest misfit over several starts; start values that are not finite are replaced by the prior
    /// or one.
    fn best(&self, weighted: &Weighted, starts: &[Vec<f64>]) -> Solution {
        let best = self.fixed.starts(starts).into_iter().map(|start| self.fixed.minimise(&self.map, weighted, start));
        let best = best.fold(None, |best: Option<Solution>, next| match best {
            Some(best) if best.misfit <= next.misfit || !next.misfit.is_finite() => Some(best),
            _ => Some(next),
        });
        let ones = || self.fixed.minimise(&self.map, weighted, vec![1.0; self.map.parameters().len()]);
        best.unwrap_or_else(ones)
    }
}

/// Whether the matrix of accelerations with given parameters, at rest at a position, is that of some machine: symmetric
/// and positive definite. Off-diagonal inertias may be negative.
#[must_use]
pub fn has_inertia(model: &dyn Model<f64>, parameters: &[f64], constants: &[f64], position: &[f64]) -> bool {
    let dims = model.dims();
    let n = dims.coordinates;
    if dims.rows != n || position.len() < n || (0..n).any(|c| model.coordinate_order(c) != 2) {
        return false;
    }
    let mut motion = vec![0.0; dims.motion_len()];
    motion[..n].copy_from_slice(&position[..n]);
    let mut scratch = vec![0.0; model.inverse_workspace_len()];
    let mut force = |motion: &[f64]| {
        let mut force = vec![0.0; n];
        let done = model.inverse_dynamics(motion, parameters, constants, &mut scratch, &mut force);
        done.is_ok().then_some(force)
    };
    let Some(rest) = force(&motion) else { return false };
    let mut matrix = DMatrix::zeros(n, n);
    for c in 0..n {
        motion[2 * n + c] = 1.0;
        let Some(moved) = force(&motion) else { return false };
        motion[2 * n + c] = 0.0;
        for r in 0..n {
            matrix[(r, c)] = moved[r] - rest[r];
        }
    }
    let symmetric = (&matrix - matrix.transpose()).amax() <= 1e-9 * matrix.amax();
    symmetric && matrix.iter().all(|x| x.is_finite()) && matrix.symmetric_eigenvalues().iter().all(|m| *m > 0.0)
}

/// The powers of ten over which speeds and positions are tried by [`takes_energy`].
const DECADES: i32 = 3;
/// A sum of powers that cancel is zero below this share of them.
const CANCELLED: f64 = 1e-12;

/// Which parameters stand in terms that take energy out of the machine whatever it does, as damping and dry friction do: with the rows
/// `Y theta`, the power `dot(q)' Y_j` of parameter j is never negative, and does not depend on accelerations. Tried at speeds of all signs
/// and many sizes, about a position; nothing of rows that are no balance of forces, for which [`has_inertia`] has to be asked before.
#[must_use]
pub fn takes_energy(model: &dyn Model<f64>, constants: &[f64], position: &[f64]) -> Vec<bool> {
    let dims = model.dims();
    let (n, p) = (dims.coordinates, dims.parameters);
    let mut scratch = vec![0.0; model.workspace_len()];
    let mut regressor = |motion: &[f64]| {
        let mut rows = vec![0.0; dims.regressor_len()];
        model.regressor(motion, constants, &mut scratch, &mut rows).is_ok().then_some(rows)
    };
    let (mut never, mut some) = (vec![true; p], vec![false; p]);
    // Squares times an irrational number fill an interval evenly, and so do pairs of neighbours a square.
    let mut number = 0.0;
    let mut even = || {
        number += 1.0;
        2.0 * (number * number * std::f64::consts::SQRT_2).fract() - 1.0
    };
    for size in -DECADES..=DECADES {
        for _ in 0..4 * n.max(2) {
            let mut motion = vec![0.0; dims.motion_len()];
            for c in 0..n {
                motion[c] = position[c] + even() * 10_f64.powi(size.min(0));
                motion[n + c] = even() * 10_f64.powi(size);
            }
            let Some(slow) = regressor(&motion) else { return vec![false; p] };
            motion[2 * n..].iter_mut().for_each(|entry| *entry = even());
            let Some(accelerated) = regressor(&motion) else { return vec![false; p] };
            for j in 0..p {
                let powers = || (0..n).map(|row| motion[n + row] * slow[row * p + j]);
                let (power, whole) = (powers().sum::<f64>(), powers().map(f64::abs).sum::<f64>());
                let moved = (0..n).any(|row| slow[row * p + j] != accelerated[row * p + j]);
                never[j] &= !moved && power >= -CANCELLED * whole;
                some[j] |= power > CANCELLED * whole;
            }
        }
    }
    never.into_iter().zip(some).map(|(never, some)| never && some).collect()
}

/// The negative ones among the parameters of damping and friction (those that [take energy](takes_energy)), where all such terms together drive
/// the machine, about a position, at some speed up to those that are given. One may be negative while the others make up for it, as drag is
/// where friction grows less than linearly with the speed.
#[must_use]
pub fn gives_energy(
    model: &dyn Model<f64>,
    constants: &[f64],
    (position, speed): (&[f64], &[f64]),
    (values, takes): (&[f64], &[bool]),
) -> Vec<bool> {
    let dims = model.dims();
    let (n, p) = (dims.coordinates, dims.parameters);
    let mut scratch = vec![0.0; model.workspace_len()];
    let mut rows = vec![0.0; dims.regressor_len()];
    let mut gives = vec![false; p];
    for size in -DECADES..=0 {
        for moving in 0..2 * n {
            let mut motion = vec![0.0; dims.motion_len()];
            motion[..n].copy_from_slice(position);
            let (c, sign) = (moving / 2, if moving % 2 == 0 { 1.0 } else { -1.0 });
            motion[n + c] = sign * speed[c] * 10_f64.powi(size);
            if model.regressor(&motion, constants, &mut scratch, &mut rows).is_err() {
                continue;
            }
            let power = |j: usize| values[j] * motion[n + c] * rows[c * p + j];
            let braking = || (0..p).filter(|&j| takes[j]);
            if braking().map(power).sum::<f64>() < 0.0 {
                braking().filter(|&j| power(j) < 0.0).for_each(|j| gives[j] = true);
            }
        }
    }
    gives
}

/// Masses and moments of inertia that are certainly negative, which no machine has, by name with their values.
#[must_use]
pub fn negative_inertias(parameters: &[ParameterReport]) -> Vec<(String, f64)> {
    let inertias = parameters.iter().filter(|p| p.unit.as_deref().is_some_and(is_mass) && !has_product(&p.name));
    let known = inertias.filter_map(|p| Some((p, p.value?, p.std?)));
    known
        .filter(|(_, value, std)| *value < -alarm::SURELY_NEGATIVE * std)
        .map(|(p, value, _)| (p.name.clone(), value))
        .collect()
}

/// Whether the unit is that of a mass or a moment of inertia.
fn is_mass(unit: &str) -> bool {
    matches!(unit, "kg" | "kg*m^2" | "g" | "t")
}

/// Whether a parameter, or a part of a lumped one, is a product of inertia of a body by the names of mechanisms, which may have either
/// sign.
fn has_product(name: &str) -> bool {
    let parts = name.split("_plus_").flat_map(|part| part.split("_minus_"));
    let mut own = parts.map(|part| part.trim_start_matches(|c: char| c.is_ascii_digit() || c == '_'));
    own.any(|part| PRODUCTS.iter().any(|product| part.strip_prefix(product).is_some_and(|rest| rest.starts_with('_'))))
}

/// Symbols of the products of inertia in [`NAMES`](tpm_symbolic::mechanics::tree::NAMES).
const PRODUCTS: [&str; 3] = ["Ixy", "Ixz", "Iyz"];

/// Combinations of the lumped parameters that the data determine: `rows c - right` has the identity matrix as its
/// covariance.
struct Weighted {
    rows: DMatrix<f64>,
    right: DVector<f64>,
    /// Common factors of parameters, with the parameter of power one that tells them and its value in the estimate.
    scales: Vec<(Scale, usize, f64)>,
}

impl Weighted {
    fn new(estimate: &Estimate) -> Self {
        let n = estimate.values.len();
        let scale: Vec<f64> = (0..n)
            .map(|j| {
                let floor = (LEAST_RELATIVE_DEVIATION * estimate.values[j].abs()).max(f64::MIN_POSITIVE.sqrt());
                let std = estimate.covariance[(j, j)].max(0.0).sqrt();
                std.max(floor)
            })
            .collect();
        // Directions in scaled parameters that the data do not determine; the rows vanish along them.
        let hidden = DMatrix::from_fn(n, estimate.unobservable.len(), |r, c| estimate.unobservable[c][r] / scale[r]);
        let shown = complement(&hidden);
        let covariance = DMatrix::from_fn(n, n, |r, c| {
            let entry = estimate.covariance[(r, c)] / (scale[r] * scale[c]);
            // A frozen value has no variance. It gets the variance of the smallest permitted standard deviation.
            if r == c && estimate.std[r] == 0.0 { 1.0 } else { entry }
        });
        let reduced = shown.transpose() * covariance * &shown;
        let eigen = reduced.symmetric_eigen();
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let turned = &shown * &eigen.eigenvectors;
        let rows = DMatrix::from_fn(turned.ncols(), n, |i, j| {
            let variance = eigen.eigenvalues[i].max(tolerance::VARIANCE * largest);
            turned[(j, i)] / (scale[j] * variance.sqrt())
        });
        let right = &rows * DVector::from_column_slice(&estimate.values);
        let of = |scale: &Scale| {
            let own = scale.own(&estimate.values)?;
            Some((scale.clone(), own, estimate.values[own]))
        };
        Self { rows, right, scales: estimate.scales.iter().filter_map(of).collect() }
    }

    /// Brings lumped parameters to the factors of the estimate, and their derivatives, if these are given: rows are parameters.
    fn at_its_scales(&self, lumped: &mut [f64], mut derivatives: Option<&mut DMatrix<f64>>) {
        for (scale, own, size) in &self.scales {
            let map = scale.bring(lumped, *own, *size);
            if let Some(derivatives) = &mut derivatives {
                **derivatives = map * &**derivatives;
            }
        }
    }

    fn of_information(information: &Information, gradient: Option<&[f64]>) -> Self {
        let rows = information.factor().into_owned();
        let mut right = information.right().into_owned();
        // R' R c = R' z + g means R c = z + R'^-1 g, where R has an inverse.
        if let Some(shift) = gradient.and_then(|g| rows.transpose().lu().solve(&DVector::from_column_slice(g)))
            && shift.iter().all(|x| x.is_finite())
        {
            right += shift;
        }
        Self { rows, right, scales: Vec::new() }
    }
}

/// Values that the settings prescribe to the search.
#[derive(Clone, Debug)]
struct Fixed {
    constants: BTreeMap<Symbol, f64>,
    frozen: Vec<Option<f64>>,
    bounds: Vec<(f64, f64)>,
    prior: Vec<Option<f64>>,
}

/// The end point of a minimisation.
struct Solution {
    values: Vec<f64>,
    /// Parameters held at a bound.
    held: Vec<bool>,
    misfit: f64,
    converged: bool,
}

impl Fixed {
    fn new(prepared: &Prepared, map: &ParameterMap, settings: &PhysicalSettings) -> Result<Self, PhysicalError> {
        let names: Vec<&str> = map.parameters().iter().map(|&symbol| map.name(symbol)).collect();
        let given = settings.prior.keys().chain(settings.frozen.keys()).chain(settings.bounds.keys());
        for name in given {
            if !names.contains(&name.as_str()) {
                return Err(PhysicalError::Unknown { name: name.clone(), known: names.join(", ") });
            }
        }
        let mut constants = BTreeMap::new();
        for (index, quantity) in prepared.model.symbols.iter().enumerate() {
            if matches!(quantity.kind, Kind::Constant { value: None })
                && let Some(value) = settings.constants.get(quantity.name.as_str())
            {
                constants.insert(Symbol(index as u32), *value);
            }
        }
        let graph = map.graph();
        let atoms =
            map.definitions().iter().flat_map(|d| d.terms().flat_map(|(m, _)| m.factors().map(|(&atom, _)| atom)));
        for leaf in atoms.flat_map(|atom| graph.leaves(atom)) {
            if let tpm_symbolic::expr::graph::Node::Symbol(symbol) = graph.node(leaf) {
                let quantity = prepared.model.quantity(*symbol);
                if matches!(quantity.kind, Kind::Constant { value: None }) && !constants.contains_key(symbol) {
                    return Err(PhysicalError::NoConstant { name: quantity.name.to_string() });
                }
            }
        }
        // Linear maps need no search. With them a bound that is reached along an undetermined direction would be
        // mistaken for a value.
        let sums = map.is_linear();
        let mut bounds = Vec::with_capacity(names.len());
        for &symbol in map.parameters() {
            let unit = prepared.model.quantity(symbol).unit.as_ref().map(Unit::to_string);
            let positive = !sums && unit.as_deref().is_some_and(is_mass) && !has_product(map.name(symbol));
            let natural = if positive { 0.0 } else { f64::NEG_INFINITY };
            let (low, high) = settings.bounds.get(map.name(symbol)).copied().unwrap_or((natural, f64::INFINITY));
            if !matches!(low.partial_cmp(&high), Some(std::cmp::Ordering::Less)) {
                return Err(PhysicalError::EmptyBounds { name: map.name(symbol).to_string(), low, high });
            }
            bounds.push((low, high));
        }
        let by_name = |values: &BTreeMap<String, f64>| names.iter().map(|name| values.get(*name).copied()).collect();
        Ok(Self { constants, frozen: by_name(&settings.frozen), bounds, prior: by_name(&settings.prior) })
    }

    fn lookup<'a>(&'a self, map: &'a ParameterMap, values: &'a [f64]) -> impl Fn(Symbol) -> f64 + 'a {
        move |symbol| {
            let own = map.parameters().iter().position(|parameter| *parameter == symbol);
            own.map_or_else(|| self.constants.get(&symbol).copied().unwrap_or(f64::NAN), |i| values[i])
        }
    }

    /// The starts given, with the prior (or one) for values that are not finite, then the prior itself. All lie within the
    /// bounds, and frozen parameters have their values.
    fn starts(&self, given: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let count = self.prior.len();
        let plain: Vec<f64> = (0..count).map(|i| self.prior[i].filter(|value| *value != 0.0).unwrap_or(1.0)).collect();
        let finite = |start: &Vec<f64>| -> Vec<f64> {
            start.iter().zip(&plain).map(|(&value, &plain)| if value.is_finite() { value } else { plain }).collect()
        };
        let mut starts: Vec<Vec<f64>> = given.iter().map(finite).collect();
        starts.push(plain.clone());
        for start in &mut starts {
            for (i, value) in start.iter_mut().enumerate() {
                let (low, high) = self.bounds[i];
                // A start lies strictly within the bounds, so that no expression is divided by a mass of zero.
                if *value <= low {
                    *value = if high.is_finite() { f64::midpoint(low, high) } else { low + value.abs().max(1.0) };
                } else if *value >= high {
                    *value = if low.is_finite() { f64::midpoint(low, high) } else { high - value.abs().max(1.0) };
                }
                *value = self.frozen[i].unwrap_or(*value);
            }
        }
        starts.dedup();
        starts
    }

    /// Minimises within the bounds. A parameter that leaves its bounds is held at the bound, and released when the
    /// misfit falls inwards.
    fn minimise(&self, map: &ParameterMap, weighted: &Weighted, start: Vec<f64>) -> Solution {
        let count = start.len();
        let mut values = start;
        let mut held = vec![false; count];
        let mut converged = false;
        // Every pass holds or releases one parameter; more passes would repeat earlier choices.
        for _ in 0..2 * count + 2 {
            let free: Vec<usize> = (0..count).filter(|&i| self.frozen[i].is_none() && !held[i]).collect();
            let before = values.clone();
            if !free.is_empty() && weighted.rows.nrows() > 0 {
                let problem = Problem::new(self, map, weighted, values.clone(), free);
                let (problem, report) = LevenbergMarquardt::new()
                    .with_ftol(1e-14)
                    .with_xtol(1e-14)
                    .with_gtol(1e-14)
                    .with_patience(200)
                    .minimize(problem);
                converged = report.termination.was_successful()
                    || matches!(report.termination, levenberg_marquardt::TerminationReason::NoImprovementPossible(_));
                values = problem.values;
            } else {
                converged = true;
            }
            // The first parameter that leaves its bounds on the way from the previous values.
            let beyond = (0..count).filter(|&i| !held[i] && self.frozen[i].is_none()).filter_map(|i| {
                let (low, high) = self.bounds[i];
                let bound = if values[i] < low {
                    low
                } else if values[i] > high {
                    high
                } else {
                    return None;
                };
                let share = (bound - before[i]) / (values[i] - before[i]);
                Some((share, i, bound))
            });
            if let Some((share, i, bound)) = beyond.min_by(|a, b| a.0.total_cmp(&b.0)) {
                for (value, old) in values.iter_mut().zip(&before) {
                    *value = old + share.clamp(0.0, 1.0) * (*value - old);
                }
                values[i] = bound;
                held[i] = true;
                continue;
            }
            // A held parameter is released when the misfit falls from its bound inwards.
            let Some(gradient) = self.gradient(map, weighted, &values) else { break };
            let inward = (0..count).find(|&i| {
                held[i] && if values[i] <= self.bounds[i].0 { gradient[i] < 0.0 } else { gradient[i] > 0.0 }
            });
            match inward {
                Some(i) if converged => held[i] = false,
                _ => break,
            }
        }
        let misfit = self.residuals(map, weighted, &values).map_or(f64::INFINITY, |r| r.norm_squared());
        Solution { values, held, misfit, converged }
    }

    /// Standard deviations of the parameters from perturbed solutions: root of the summed squares by which every
    /// parameter moves when the estimate moves by one standard deviation along one combination, the mean of up and
    /// down. Where no parameters follow from a perturbed estimate, the shift is the parameter itself. The result is no
    /// smaller than the bound from other `points`, which may fit the estimate nearly as well. Zero for a linear map,
    /// where the Jacobian gives the same.
    fn spread(&self, map: &ParameterMap, weighted: &Weighted, solution: &Solution, points: &[Vec<f64>]) -> Vec<f64> {
        let mut squares = vec![0.0; solution.values.len()];
        if map.is_linear() {
            return squares;
        }
        for (row, sign) in (0..weighted.right.len()).flat_map(|row| [(row, 1.0), (row, -1.0)]) {
            let mut right = weighted.right.clone();
            right[row] += sign;
            let moved = Weighted { rows: weighted.rows.clone(), right, scales: weighted.scales.clone() };
            let there = self.minimise(map, &moved, solution.values.clone());
            let follows = there.misfit.is_finite();
            for ((square, there), here) in squares.iter_mut().zip(&there.values).zip(&solution.values) {
                let by = if follows { there - here } else { *here };
                *square += 0.5 * by * by;
            }
        }
        for point in points {
            let Some(residuals) = self.residuals(map, weighted, point) else { continue };
            let more = (residuals.norm_squared() - solution.misfit).max(1.0);
            for ((square, there), here) in squares.iter_mut().zip(point).zip(&solution.values) {
                *square = square.max((there - here).powi(2) / more);
            }
        }
        squares.into_iter().map(f64::sqrt).collect()
    }

    fn residuals(&self, map: &ParameterMap, weighted: &Weighted, values: &[f64]) -> Option<DVector<f64>> {
        let mut lumped = map.evaluate(self.lookup(map, values));
        weighted.at_its_scales(&mut lumped, None);
        let residuals = &weighted.rows * DVector::from_vec(lumped) - &weighted.right;
        residuals.iter().all(|value| value.is_finite()).then_some(residuals)
    }

    fn jacobian(&self, map: &ParameterMap, weighted: &Weighted, values: &[f64]) -> Option<DMatrix<f64>> {
        let mut derivatives = self.derivatives(map, values);
        let mut lumped = map.evaluate(self.lookup(map, values));
        weighted.at_its_scales(&mut lumped, Some(&mut derivatives));
        let jacobian = &weighted.rows * derivatives;
        jacobian.iter().all(|value| value.is_finite()).then_some(jacobian)
    }

    /// Derivatives of the lumped parameters by the physical ones.
    fn derivatives(&self, map: &ParameterMap, values: &[f64]) -> DMatrix<f64> {
        let rows = map.jacobian_at(self.lookup(map, values));
        DMatrix::from_fn(rows.len(), values.len(), |r, c| rows[r][c])
    }

    fn gradient(&self, map: &ParameterMap, weighted: &Weighted, values: &[f64]) -> Option<DVector<f64>> {
        Some(self.jacobian(map, weighted, values)?.transpose() * self.residuals(map, weighted, values)?)
    }

    fn report(
        &self,
        units: &[Option<String>],
        map: &ParameterMap,
        weighted: &Weighted,
        solution: &Solution,
        spread: &[f64],
    ) -> Physical {
        let count = solution.values.len();
        // Covariance, rank and unobservable directions from the singular values of the weighted Jacobian.
        let free: Vec<usize> = (0..count).filter(|&i| self.frozen[i].is_none() && !solution.held[i]).collect();
        let mut covariance: DMatrix<f64> = DMatrix::zeros(count, count);
        let mut hidden = vec![false; count];
        let mut rank = 0;
        let mut condition = f64::INFINITY;
        let mut unobservable = Vec::new();
        let mut remarks = Vec::new();
        match self.jacobian(map, weighted, &solution.values) {
            Some(jacobian) if !free.is_empty() && jacobian.nrows() > 0 => {
                let (scaled, scale) = unit_columns(jacobian.select_columns(&free));
                let singular = Singular::new(&scaled, tolerance::JACOBIAN_RANK);
                rank = singular.rank();
                condition = singular.condition();
                for (value, direction) in singular.values.iter().zip(singular.right.column_iter()) {
                    for (r, &i) in free.iter().enumerate() {
                        for (c, &j) in free.iter().enumerate() {
                            covariance[(i, j)] += direction[r] * direction[c] / (value * value * scale[r] * scale[c]);
                        }
                    }
                }
                for direction in singular.null().column_iter() {
                    let mut raw = vec![0.0; count];
                    for (r, &i) in free.iter().enumerate() {
                        hidden[i] |= direction[r].abs() > tolerance::HIDDEN_COMPONENT;
                        raw[i] = direction[r] / scale[r];
                    }
                    unobservable.push(largest_one(&raw));
                }
            }
            Some(_) => hidden.iter_mut().enumerate().for_each(|(i, hidden)| *hidden = free.contains(&i)),
            None => {
                remarks.push(PhysicalRemark::Nowhere);
                hidden = vec![true; count];
            }
        }
        // A parameter that is undetermined or held has no standard deviation to widen.
        let widened = |i: usize| {
            let std = covariance[(i, i)].max(0.0).sqrt();
            if std > 0.0 && !hidden[i] { (spread[i] / std).max(1.0) } else { 1.0 }
        };
        let widened: Vec<f64> = (0..count).map(widened).collect();
        let std: Vec<f64> = (0..count).map(|i| covariance[(i, i)].max(0.0).sqrt() * widened[i]).collect();
        let covariance = DMatrix::from_fn(count, count, |i, j| match covariance[(i, j)] {
            0.0 => 0.0,
            entry => entry * widened[i] * widened[j],
        });
        // The status of every parameter.
        let status: Vec<Status> = (0..count)
            .map(|i| {
                let evidence = if self.frozen[i].is_some() {
                    Evidence::Frozen
                } else if hidden[i] {
                    Evidence::Hidden
                } else if solution.held[i] {
                    Evidence::AtBound
                } else {
                    Evidence::Shown { value: solution.values[i], std: std[i], felt: f64::INFINITY }
                };
                Status::of(evidence, POOR_PHYSICAL_DEVIATION)
            })
            .collect();
        // The search starts from the prior, and leaves it only along directions that the lumped parameters determine.
        let stated = |i: usize| {
            let with: Vec<&Vec<f64>> =
                unobservable.iter().filter(|d: &&Vec<f64>| d[i].abs() > tolerance::HIDDEN_COMPONENT).collect();
            let all = |d: &&Vec<f64>| {
                (0..count).all(|j| d[j].abs() <= tolerance::HIDDEN_COMPONENT || self.prior[j].is_some())
            };
            !with.is_empty() && with.iter().all(all)
        };
        let (mut hidden, mut poor) = (Vec::new(), Vec::new());
        let parameters: Vec<ParameterReport> = (0..count)
            .map(|i| {
                let (name, value) = (map.name(map.parameters()[i]), solution.values[i]);
                match status[i] {
                    Status::Identified | Status::Frozen | Status::Untrusted => {}
                    Status::Unobservable => hidden.push(name.to_string()),
                    Status::PoorlyDetermined if solution.held[i] => {
                        remarks.push(PhysicalRemark::AtBound { parameter: name.to_string(), value });
                    }
                    Status::PoorlyDetermined => poor.push(name.to_string()),
                }
                let seen = status[i] != Status::Unobservable;
                ParameterReport {
                    name: name.to_string(),
                    unit: units[i].clone(),
                    interval: None,
                    prior: self.prior[i].or(self.frozen[i]),
                    value: seen.then_some(value),
                    std: (seen && !solution.held[i]).then_some(std[i]),
                    status: status[i],
                    truth: None,
                    with_prior: (!seen && stated(i)).then_some(value),
                }
            })
            .collect();
        if !hidden.is_empty() {
            remarks.push(PhysicalRemark::NotDetermined { parameters: hidden });
        }
        if !poor.is_empty() {
            remarks.push(PhysicalRemark::PoorlyDetermined { parameters: poor });
        }
        // The consistency test.
        let freedom = weighted.rows.nrows().saturating_sub(rank);
        if !solution.converged {
            remarks.push(PhysicalRemark::NotConverged);
        }
        let deviation = deviation(solution.misfit, freedom);
        if deviation > alarm::LUMPED_CONTRADICT {
            remarks.push(PhysicalRemark::Inconsistent { deviation, relations: freedom });
        }
        let derivatives = self.derivatives(map, &solution.values);
        Physical {
            parameters,
            status,
            values: solution.values.clone(),
            lumped: map.evaluate(self.lookup(map, &solution.values)),
            lumped_covariance: Matrix::of(&derivatives * &covariance * derivatives.transpose()),
            covariance: Matrix::of(covariance),
            unobservable,
            condition,
            rank,
            misfit: solution.misfit,
            freedom,
            remarks,
        }
    }
}

/// The least-squares problem in the form of the Levenberg-Marquardt library: the free parameters, each divided by its
/// scale.
struct Problem<'a> {
    fixed: &'a Fixed,
    map: &'a ParameterMap,
    weighted: &'a Weighted,
    values: Vec<f64>,
    free: Vec<usize>,
    scale: Vec<f64>,
}

impl<'a> Problem<'a> {
    fn new(
        fixed: &'a Fixed,
        map: &'a ParameterMap,
        weighted: &'a Weighted,
        values: Vec<f64>,
        free: Vec<usize>,
    ) -> Self {
        let scale = free.iter().map(|&i| if values[i] == 0.0 { 1.0 } else { values[i].abs() }).collect();
        Self { fixed, map, weighted, values, free, scale }
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, params: &DVector<f64>) {
        for ((&i, share), scale) in self.free.iter().zip(params.iter()).zip(&self.scale) {
            self.values[i] = share * scale;
        }
    }

    fn params(&self) -> DVector<f64> {
        DVector::from_iterator(self.free.len(), self.free.iter().zip(&self.scale).map(|(&i, s)| self.values[i] / s))
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        self.fixed.residuals(self.map, self.weighted, &self.values)
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let whole = self.fixed.jacobian(self.map, self.weighted, &self.values)?;
        Some(DMatrix::from_fn(whole.nrows(), self.free.len(), |r, c| whole[(r, self.free[c])] * self.scale[c]))
    }
}

#[cfg(test)]
mod tests {
    use super::has_product;

    #[test]
    fn products_of_inertia_are_told_from_moments() {
        for name in ["Ixy_upper", "Iyz_a_plus_Ia_q", "Izz_a_plus_3_Ixz_b_per_10", "Izz_a_minus_Ixy_b"] {
            assert!(has_product(name), "{name}");
        }
        for name in ["Ixx_upper", "m_Ixy", "Ixyz_a", "Izz_a_plus_3691_m_b_per_200000_plus_Ia_q", "J", "Ixy"] {
            assert!(!has_product(name), "{name}");
        }
    }
}
