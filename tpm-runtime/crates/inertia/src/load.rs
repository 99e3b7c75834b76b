//! The inertia of a load from two results, without and with it.
//!
//! A load that is fixed to a link adds its ten parameters to those of the link and changes nothing else of the arm, so that
//!
//! ```text
//! y0 = W0 theta,    y1 = W1 (theta + E pi),    pi = the parameters of the load about the frame of its link.
//! ```
//!
//! The rows of both results, weighted by their covariances, are projected onto the complement of what theta can explain; what is left
//! shows pi alone. Friction and offsets of joints may differ between the two results, since loads and temperature change them.

use crate::error::InertiaError;
use crate::evidence::Shown;
use crate::nearest::{Evidence, Problem};
use crate::pseudo_inertia::{ball, parameters};
use crate::stage::names_of;
use serde::Serialize;
use std::collections::BTreeMap;
use tpm_codegen::import::{STRIBECK, decimal};
use tpm_numerics::singular::{Singular, complement, largest_one, unit_columns};
use tpm_numerics::tail::chi_squared_upper;
use tpm_numerics::{Cholesky, DMatrix, DVector, tolerance};
use tpm_report::{number, probability};
use tpm_session::{DeclaredModel, StoredResult};
use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::number::rational::to_f64;

/// Probability of the misfit, were the deviations right, below which the results are said to contradict each other.
const DOUBTFUL: f64 = 1e-3;
/// Deviations from zero from which a mass has a centre.
const CLEAR: f64 = 2.0;
/// Units of the load's parameters.
const UNITS: [&str; 10] = ["kg", "kg*m", "kg*m", "kg*m", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2"];

/// What is asked for.
#[derive(Clone, Copy)]
pub struct LoadRequest<'a> {
    /// The model of the arm.
    pub model: &'a DeclaredModel,
    /// The result without the load.
    pub without: &'a StoredResult,
    /// The result with the load.
    pub with: &'a StoredResult,
    /// The body that carries the load; the last one when not given.
    pub body: Option<&'a str>,
    /// Density of the ball that stands for the load where the results do not show it, kg/m^3.
    pub density: f64,
}

/// A parameter of the load.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LoadParameter {
    /// `m`; `cx`, `cy`, `cz` of the centre of mass; and the moments about it, all along the axes of the link that carries the load.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// The estimate; nothing where the results do not show it.
    pub value: Option<f64>,
    /// Its standard deviation.
    pub std: Option<f64>,
    /// The value of the nearest load that is possible.
    pub possible: f64,
}

/// A combination of a load's parameters about the frame of its link that the results do not show.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LoadDirection {
    /// Weight of every parameter.
    pub terms: BTreeMap<&'static str, f64>,
}

/// A load; serialises as `tpm.load/1`.
#[derive(Clone, Debug, Serialize)]
pub struct Load {
    schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// The body that carries the load.
    pub body: String,
    /// Mass, centre of mass, and moments about it.
    pub parameters: Vec<LoadParameter>,
    /// What the results do not show of the load.
    pub unobservable: Vec<LoadDirection>,
    /// Probability of a larger difference between the results than the load leaves, were their deviations right; nothing where
    /// nothing is left.
    pub chance: Option<f64>,
    /// What a reader should know.
    pub remarks: Vec<String>,
}

/// Finds the mass, the centre of mass and the inertia of a load.
///
/// # Errors
/// [`InertiaError`] where the results are not of the model, there is no such body, or the results show nothing of the load.
pub fn payload(request: &LoadRequest<'_>) -> Result<Load, InertiaError> {
    if !(request.density > 0.0 && request.density.is_finite()) {
        return Err(InertiaError::NotPositive { name: "the density".to_owned(), value: request.density });
    }
    let body = body(request)?;
    let own = names_of(&body);
    let [without, with] =
        [request.without, request.with].map(|result| Shown::new(request.model, result, own.iter().cloned()));
    let (without, with) = (without?, with?);
    let evidence = Alone::new(&without, &with, &own)?;
    let estimate = Estimate::new(&evidence);
    if estimate.shown.rank() == 0 {
        return Err(InertiaError::Nothing);
    }
    let start = estimate.ball(request.density);
    let problem = Problem {
        evidence: Evidence {
            covariance: Cholesky::new(DMatrix::identity(evidence.values.len(), evidence.values.len()))
                .ok_or(InertiaError::NoMinimum)?,
            rows: evidence.rows.clone(),
            values: evidence.values.clone(),
        },
        bodies: vec![std::array::from_fn(|k| k)],
        positive: Vec::new(),
        loose: Vec::new(),
        reference: DVector::from_column_slice(&start),
        weight: 1.0,
    };
    let found = problem.solve().ok_or(InertiaError::NoMinimum)?;
    let nearest: [f64; 10] = std::array::from_fn(|k| found.parameters[k]);
    let possible = decimal(&nearest).ok_or(InertiaError::NoMinimum)?;
    let mut remarks = Vec::new();
    let degrees = evidence.values.len() - estimate.shown.rank();
    let misfit = (&evidence.rows * &estimate.values - &evidence.values).norm_squared();
    let chance = (degrees > 0).then(|| chi_squared_upper(misfit, degrees));
    if let Some(chance) = chance.filter(|chance| *chance < DOUBTFUL) {
        remarks.push(format!(
            "the load explains the difference of the results with a probability of {}: something else changed, or their deviations are too \
             small",
            probability(chance, number)
        ));
    }
    let possible: Vec<f64> =
        std::iter::once(&possible.mass).chain(&possible.centre).chain(&possible.moments).map(to_f64).collect();
    let parameters = estimate.parameters(&possible);
    let of = |own: &LoadParameter| [own.value, own.std, Some(own.possible)];
    if !parameters.iter().flat_map(of).flatten().chain(chance).all(f64::is_finite) {
        return Err(InertiaError::NoMinimum);
    }
    Ok(Load {
        schema: "tpm.load/1",
        model: request.with.model().to_owned(),
        parameters,
        unobservable: estimate.directions(),
        body,
        chance,
        remarks,
    })
}

/// The body that carries the load: the one asked for, or the last one of the model.
fn body(request: &LoadRequest<'_>) -> Result<String, InertiaError> {
    let model = &request.model.prepared().model;
    let names = model.parameters().map(|symbol| model.quantity(symbol).name.to_string());
    let mut known: Vec<String> = Vec::new();
    for name in names {
        let owner = NAMES.iter().find_map(|symbol| name.strip_prefix(symbol)?.strip_prefix('_'));
        if let Some(owner) = owner.filter(|owner| !known.iter().any(|own| own == owner)) {
            known.push(owner.to_owned());
        }
    }
    if known.is_empty() {
        return Err(InertiaError::NoMechanism);
    }
    let asked =
        request.body.map_or_else(|| known.last().cloned(), |body| known.iter().find(|own| *own == body).cloned());
    asked.ok_or_else(|| InertiaError::NoBody { name: request.body.unwrap_or("").to_owned(), known })
}

/// What two results show of a load alone: rows with independent errors of deviation one.
struct Alone {
    rows: DMatrix<f64>,
    values: DVector<f64>,
}

impl Alone {
    fn new(without: &Shown, with: &Shown, own: &[String; 10]) -> Result<Self, InertiaError> {
        let (first, second) = (whitened(without)?, whitened(with)?);
        let n = without.names.len();
        let changing: Vec<usize> = (0..n).filter(|&j| may_change(&without.names[j])).collect();
        let (upper, lower) = (first.0.nrows(), second.0.nrows());
        let mut arm = DMatrix::zeros(upper + lower, n + changing.len());
        arm.view_mut((0, 0), (upper, n)).copy_from(&first.0);
        arm.view_mut((upper, 0), (lower, n)).copy_from(&second.0);
        for (at, &j) in changing.iter().enumerate() {
            let column = second.0.column(j).into_owned();
            arm.view_mut((upper, n + at), (lower, 1)).copy_from(&column);
        }
        let mut load = DMatrix::zeros(upper + lower, own.len());
        for (k, name) in own.iter().enumerate() {
            if let Some(j) = with.index(name) {
                load.view_mut((upper, k), (lower, 1)).copy_from(&second.0.column(j));
            }
        }
        let values = DVector::from_iterator(upper + lower, first.1.iter().chain(second.1.iter()).copied());
        let explained = Singular::new(&unit_columns(arm).0, tolerance::RANK);
        let left = complement(&explained.left);
        Ok(Self { rows: left.tr_mul(&load), values: left.tr_mul(&values) })
    }
}

/// Rows and values of a result, divided by the root of their covariance.
fn whitened(shown: &Shown) -> Result<(DMatrix<f64>, DVector<f64>), InertiaError> {
    let sizes = DVector::from_element(shown.names.len(), 0.0);
    let Evidence { rows, values, covariance } = shown.evidence(&sizes)?;
    let root = covariance.l();
    let rows = root.solve_lower_triangular(&rows).ok_or(InertiaError::Covariance)?;
    Ok((rows, root.solve_lower_triangular(&values).ok_or(InertiaError::Covariance)?))
}

/// Whether a parameter is a friction or an offset.
fn may_change(name: &str) -> bool {
    let mut symbols = [Loss::Viscous, Loss::Coulomb, Loss::Offset].map(Loss::symbol).into_iter().chain(STRIBECK);
    symbols.any(|symbol| name.starts_with(&parameter_name(symbol, "")))
}

/// The load about the frame of its link, without regard to what is possible.
struct Estimate {
    shown: Singular,
    /// Factors of the columns.
    lengths: Vec<f64>,
    values: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Estimate {
    fn new(evidence: &Alone) -> Self {
        let (rows, lengths) = unit_columns(evidence.rows.clone());
        let shown = Singular::new(&rows, tolerance::JACOBIAN_RANK);
        let scale = DMatrix::from_diagonal(&DVector::from_iterator(10, lengths.iter().map(|length| 1.0 / length)));
        let inverse = DMatrix::from_diagonal(&shown.values.map(|value| 1.0 / value));
        let root = scale * &shown.right * inverse;
        let values = &root * shown.left.tr_mul(&evidence.values);
        Self { covariance: &root * root.transpose(), shown, lengths, values }
    }

    /// Whether the results show a parameter by itself.
    fn shows(&self, k: usize) -> bool {
        (self.shown.right.row(k).norm_squared() - 1.0).abs() <= tolerance::STORED
    }

    /// The uniform ball of this density that stands for the load where nothing is shown.
    fn ball(&self, density: f64) -> [f64; 10] {
        let std = self.covariance[(0, 0)].sqrt();
        let mass = if self.shows(0) { self.values[0].max(std) } else { 1.0 };
        let clear = self.shows(0) && self.values[0] > CLEAR * std;
        let centre = |k: usize| if clear && self.shows(k) { self.values[k] / self.values[0] } else { 0.0 };
        let radius = (0.75 * mass / (std::f64::consts::PI * density)).cbrt();
        parameters(&ball(mass, [centre(1), centre(2), centre(3)], radius))
    }

    /// Mass, centre and moments about it, with deviations by their derivatives.
    fn parameters(&self, possible: &[f64]) -> Vec<LoadParameter> {
        const CENTRE: [&str; 4] = ["m", "cx", "cy", "cz"];
        let own = about_centre(&std::array::from_fn(|k| self.values[k]));
        let all = (0..10).map(|k| {
            let (value, derivatives) = own[k];
            let derivatives = DVector::from_column_slice(&derivatives);
            let needed = derivatives.iter().enumerate().filter(|(_, derivative)| **derivative != 0.0);
            let shown = value.is_finite() && needed.map(|(j, _)| j).all(|j| self.shows(j));
            let std = derivatives.dot(&(&self.covariance * &derivatives)).max(0.0).sqrt();
            LoadParameter {
                name: if k < 4 { CENTRE[k] } else { NAMES[k] },
                unit: if (1..4).contains(&k) { "m" } else { UNITS[k] },
                value: shown.then_some(value),
                std: shown.then_some(std),
                possible: possible[k],
            }
        });
        all.collect()
    }

    fn directions(&self) -> Vec<LoadDirection> {
        let null = self.shown.null();
        let of = |column: usize| {
            let direction: Vec<f64> = (0..10).map(|k| null[(k, column)] / self.lengths[k]).collect();
            let terms = largest_one(&direction).into_iter().zip(NAMES);
            let seen = terms.filter(|(weight, _)| weight.abs() > tolerance::HIDDEN_COMPONENT);
            LoadDirection { terms: seen.map(|(weight, name)| (name, weight)).collect() }
        };
        (0..null.ncols()).map(of).collect()
    }
}

/// Mass, centre and moments about it, of the ten parameters about a frame, each with its derivatives.
fn about_centre(own: &[f64; 10]) -> [(f64, [f64; 10]); 10] {
    const MOMENTS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    let (m, h) = (own[0], &own[1..4]);
    std::array::from_fn(|k| {
        let mut derivatives = [0.0; 10];
        match k {
            0 => {
                derivatives[0] = 1.0;
                (m, derivatives)
            }
            1..4 => {
                derivatives[0] = -h[k - 1] / (m * m);
                derivatives[k] = 1.0 / m;
                (h[k - 1] / m, derivatives)
            }
            _ => {
                // I - (h.h 1 - h h^T) / m.
                let (i, j) = MOMENTS[k - 4];
                let all = if i == j { h.iter().map(|x| x * x).sum::<f64>() } else { 0.0 };
                let away = (all - h[i] * h[j]) / m;
                derivatives[k] = 1.0;
                derivatives[0] = away / m;
                for axis in 0..3 {
                    let mut change = if i == j { 2.0 * h[axis] } else { 0.0 };
                    change -= if axis == i { h[j] } else { 0.0 } + if axis == j { h[i] } else { 0.0 };
                    derivatives[1 + axis] = -change / m;
                }
                (own[k] - away, derivatives)
            }
        }
    })
}
