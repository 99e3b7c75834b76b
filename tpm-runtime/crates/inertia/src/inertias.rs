//! Possible inertias of the links of an arm.

use crate::error::InertiaError;
use crate::evidence::{Alone, Shown};
use crate::nearest::{Nearest, Problem};
use crate::reference::possible;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use tpm_codegen::import::{Described, DescribedBody, JointLosses, Parted};
use tpm_numerics::tail::chi_squared_upper;
use tpm_numerics::{DMatrix, DVector};
use tpm_report::number;
use tpm_session::{DeclaredModel, StoredResult};
use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::number::rational::to_f64;

/// Share of what is known about a parameter above which the data said it.
const MOSTLY: f64 = 0.99;
/// Probability of the distance between estimate and possible inertias, were the deviations right, below which the estimate is doubted.
const DOUBTFUL: f64 = 1e-3;

/// What is asked for.
#[derive(Clone, Copy)]
pub struct InertiasRequest<'a> {
    /// The model of the arm, as its description was imported.
    pub model: &'a DeclaredModel,
    /// The result of its identification.
    pub result: &'a StoredResult,
    /// The description, read with the options of the import.
    pub described: &'a Described,
    /// Values of parameters that go before those of the description, by name.
    pub values: &'a BTreeMap<String, f64>,
    /// Weight of the description. One takes it for known within 100 %, so that it decides only what the data hardly show.
    pub weight: f64,
}

/// Where a value comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// The data show the parameter by itself.
    Data,
    /// The data narrow it down, and the description decides the rest.
    Both,
    /// The data say nothing of it.
    Description,
    /// It was held in the identification.
    Held,
    /// Neither data nor description say anything; it counts as zero.
    Nothing,
}

impl Origin {
    /// The word in a table.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Both => "data and description",
            Self::Description => "description",
            Self::Held => "held",
            Self::Nothing => "nothing",
        }
    }
}

/// A physical parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Its name in the model.
    pub name: String,
    /// A possible value, in SI units. Those of inertias follow exactly from the decimals of the written description.
    pub value: f64,
    /// Standard deviation, where the value comes from the data.
    pub std: Option<f64>,
    /// The value of the description, or the one that was stated; nothing where there is none.
    pub description: Option<f64>,
    /// Where the value comes from.
    pub origin: Origin,
    /// The share of what is known about it that comes from the data.
    pub from_data: f64,
}

/// A parameter or a combination that the data show.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Combination {
    /// Weights by the columns of the model.
    pub terms: BTreeMap<String, f64>,
    /// The identified value.
    pub estimate: f64,
    /// Its standard deviation.
    pub std: f64,
    /// The value with the possible parameters.
    pub possible: f64,
}

/// Possible inertias; serialises as `tpm.inertias/1`.
#[derive(Clone, Debug, Serialize)]
pub struct Inertias {
    schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// The weight of the description.
    pub weight: f64,
    /// The parameters: ten of every body, then losses and others.
    pub parameters: Vec<Parameter>,
    /// What the data show, beside what the possible parameters make of it.
    pub combinations: Vec<Combination>,
    /// Distance of the possible parameters from the estimate, in the estimate's covariance.
    pub distance: f64,
    /// Probability of a larger distance, were the estimate's deviations right and the possible parameters true.
    pub chance: f64,
    /// What a reader should know.
    pub remarks: Vec<String>,
    /// The inertias as a description writes them, proven possible.
    #[serde(skip)]
    pub parted: Parted,
    /// Losses by the coordinate of the model.
    #[serde(skip)]
    pub losses: BTreeMap<String, JointLosses>,
}

/// Gives every body of an arm an inertia that is possible.
///
/// # Errors
/// [`InertiaError`] where model, result and description do not go together, or the covariance is not one.
pub fn inertias(request: &InertiasRequest<'_>) -> Result<Inertias, InertiaError> {
    if !(request.weight > 0.0 && request.weight.is_finite()) {
        return Err(InertiaError::NotPositive {
            name: "the weight of the description".to_owned(),
            value: request.weight,
        });
    }
    let known = own_parameters(request.model);
    let bodies: Vec<DescribedBody<'_>> = request.described.bodies().collect();
    for body in &bodies {
        if !names_of(body.name).iter().any(|name| known.contains(name)) {
            return Err(InertiaError::Body { link: body.link.to_owned(), body: body.name.to_owned() });
        }
    }
    let shown = Shown::new(request.model, request.result, bodies.iter().flat_map(|body| names_of(body.name)))?;
    if let Some(name) = request.values.keys().find(|name| shown.index(name).is_none()) {
        return Err(InertiaError::Unknown(name.clone()));
    }
    let mut remarks = Vec::new();
    let stage = Stage::new(request, &bodies, &shown, &mut remarks)?;
    let found = stage.problem.solve().ok_or(InertiaError::NoMinimum)?;
    let parameters = stage.whole(&found.parameters);
    let of =
        |body: &DescribedBody<'_>| names_of(body.name).map(|name| shown.index(&name).map_or(0.0, |j| parameters[j]));
    let values = bodies.iter().map(|body| (body.name.to_owned(), of(body))).collect();
    let parted = request.described.split(&values)?;
    Ok(stage.report(request, &shown, &found, parameters, parted, remarks))
}

/// The names of a body's ten parameters.
pub(crate) fn names_of(body: &str) -> [String; 10] {
    NAMES.map(|name| parameter_name(name, body))
}

/// The parameters that the model declares.
fn own_parameters(model: &DeclaredModel) -> BTreeSet<String> {
    let model = &model.prepared().model;
    model.parameters().map(|symbol| model.quantity(symbol).name.to_string()).collect()
}

/// The problem, and the way from its unknowns to all parameters.
struct Stage {
    problem: Problem,
    /// Unknowns of the problem, by their index among all parameters.
    unknown: Vec<usize>,
    /// Values of all parameters that are no unknowns.
    fixed: DVector<f64>,
    /// What the description or the request says.
    described: Vec<Option<f64>>,
    held: Vec<bool>,
    /// The parameters in the order of the report: those of bodies first.
    order: Vec<usize>,
    coordinates: Vec<String>,
}

impl Stage {
    fn new(
        request: &InertiasRequest<'_>,
        bodies: &[DescribedBody<'_>],
        shown: &Shown,
        remarks: &mut Vec<String>,
    ) -> Result<Self, InertiaError> {
        let n = shown.names.len();
        let described = described(request, bodies, shown);
        let alone = shown.alone();
        let mut reference = DVector::from_fn(n, |j, _| described[j].unwrap_or(0.0));
        let mut in_body = vec![false; n];
        let masses = bodies.iter().map(|body| to_f64(&body.inertia[0])).filter(|mass| *mass > 0.0);
        let least = masses.fold(f64::INFINITY, f64::min);
        let least = if least.is_finite() { least } else { 1.0 };
        let mut of_bodies = Vec::new();
        for body in bodies {
            let index = names_of(body.name).map(|name| shown.index(&name).unwrap_or(0));
            let (mended, changed) = possible(&index.map(|j| reference[j]), least);
            if changed {
                remarks.push(format!(
                    "the description's inertia of `{}` is not possible; the nearest possible one stands for it",
                    body.link
                ));
            }
            for (j, value) in index.into_iter().zip(mended) {
                reference[j] = value;
                in_body[j] = true;
            }
            of_bodies.push(index);
        }
        let signed = may_have_either_sign(bodies, shown);
        let (mut unknown, mut positive, mut held) = (Vec::new(), Vec::new(), vec![false; n]);
        for j in 0..n {
            let value = shown.held(j).filter(|_| !in_body[j]);
            held[j] = value.is_some();
            if let Some(value) = value {
                reference[j] = value;
            } else if in_body[j] {
                unknown.push(j);
            } else if let Some(size) = size(described[j], alone[j], signed[j]) {
                reference[j] = size;
                unknown.push(j);
                if !signed[j] {
                    positive.push(j);
                }
            } else {
                remarks.push(format!(
                    "neither data nor description say anything of {}; it counts as zero unless a value is stated",
                    shown.names[j]
                ));
            }
        }
        let place = |j: usize| unknown.iter().position(|own| *own == j).unwrap_or(0);
        // What is fixed goes over to the side of the values.
        let mut evidence = shown.evidence(&reference)?;
        let fixed = DVector::from_fn(n, |j, _| if unknown.contains(&j) { 0.0 } else { reference[j] });
        evidence.values -= &evidence.rows * &fixed;
        evidence.rows = evidence.rows.select_columns(&unknown);
        let problem = Problem {
            evidence,
            bodies: of_bodies.iter().map(|index| index.map(place)).collect(),
            positive: positive.into_iter().map(place).collect(),
            reference: DVector::from_iterator(unknown.len(), unknown.iter().map(|j| reference[*j])),
            weight: request.weight,
        };
        let of_body = of_bodies.iter().flatten().copied();
        let order = of_body.chain((0..n).filter(|j| !in_body[*j])).collect();
        let coordinates = bodies.iter().map(|body| body.coordinate.to_owned()).collect();
        Ok(Self { problem, unknown, fixed, described, held, order, coordinates })
    }

    /// All parameters.
    fn whole(&self, unknowns: &DVector<f64>) -> DVector<f64> {
        let mut all = self.fixed.clone();
        self.unknown.iter().zip(unknowns).for_each(|(j, value)| all[*j] = *value);
        all
    }

    fn report(
        &self,
        request: &InertiasRequest<'_>,
        shown: &Shown,
        found: &Nearest,
        mut parameters: DVector<f64>,
        parted: Parted,
        mut remarks: Vec<String>,
    ) -> Inertias {
        for (body, written) in &parted.bodies {
            for (name, value) in names_of(body).iter().zip(written) {
                if let Some(j) = shown.index(name) {
                    parameters[j] = to_f64(value);
                }
            }
        }
        let unknowns = DVector::from_iterator(self.unknown.len(), self.unknown.iter().map(|j| parameters[*j]));
        let distance = self.problem.evidence.residual(&unknowns).norm();
        let chance = chi_squared_upper(distance * distance, shown.values.len());
        if chance < DOUBTFUL {
            remarks.push(format!(
                "the identified values are {} deviations from any arm like this one, which {} combinations explain with a probability of {}: \
                 their deviations are too small, or the model lacks something",
                number(distance),
                shown.values.len(),
                number(chance)
            ));
        }
        if !parted.emptied.is_empty() {
            remarks.push(format!(
                "no body has what is left of the identified inertia without {}: their inertias are now in the links that carry them",
                parted.emptied.join(", ")
            ));
        }
        let list = self.order.iter().map(|&j| self.parameter(shown, found, j, parameters[j]));
        Inertias {
            schema: "tpm.inertias/1",
            model: request.result.model().to_owned(),
            weight: request.weight,
            parameters: list.collect(),
            combinations: combinations(shown, &parameters),
            distance,
            chance,
            remarks,
            losses: losses(&self.coordinates, shown, &parameters),
            parted,
        }
    }

    fn parameter(&self, shown: &Shown, found: &Nearest, j: usize, value: f64) -> Parameter {
        let place = self.unknown.iter().position(|own| *own == j);
        let share = place.map_or(0.0, |at| found.from_data[at]);
        let origin = match (place, self.described[j]) {
            (Some(_), _) if share >= MOSTLY => Origin::Data,
            (Some(_), _) if share > 1.0 - MOSTLY => Origin::Both,
            (Some(_), _) => Origin::Description,
            (None, _) if self.held[j] => Origin::Held,
            (None, Some(_)) => Origin::Description,
            (None, None) => Origin::Nothing,
        };
        let std = place.filter(|_| origin == Origin::Data).map(|at| found.covariance[(at, at)].max(0.0).sqrt());
        Parameter { name: shown.names[j].clone(), value, std, description: self.described[j], origin, from_data: share }
    }
}

/// What description and request say of every parameter.
fn described(request: &InertiasRequest<'_>, bodies: &[DescribedBody<'_>], shown: &Shown) -> Vec<Option<f64>> {
    let mut found: BTreeMap<String, f64> = BTreeMap::new();
    for body in bodies {
        found.extend(names_of(body.name).into_iter().zip(body.inertia.iter().map(to_f64)));
        for (loss, value) in [(Loss::Viscous, body.damping), (Loss::Coulomb, body.friction)] {
            // A friction of zero usually means that nobody measured it.
            if to_f64(value) > 0.0 {
                found.insert(parameter_name(loss.symbol(), body.coordinate), to_f64(value));
            }
        }
    }
    found.extend(request.values.iter().map(|(name, value)| (name.clone(), *value)));
    shown.names.iter().map(|name| found.get(name).copied()).collect()
}

/// Parameters beside inertias and the losses that no machine has below zero.
fn may_have_either_sign(bodies: &[DescribedBody<'_>], shown: &Shown) -> Vec<bool> {
    let losses = [Loss::Viscous, Loss::Coulomb, Loss::Rotor];
    let of = |body: &DescribedBody<'_>| losses.map(|loss| parameter_name(loss.symbol(), body.coordinate));
    let bounded: BTreeSet<String> = bodies.iter().flat_map(of).collect();
    shown.names.iter().map(|name| !bounded.contains(name)).collect()
}

/// Where a parameter of no body begins; `None` for one of which nothing is known.
fn size(described: Option<f64>, alone: Option<Alone>, signed: bool) -> Option<f64> {
    let size = alone.map(|shown| shown.value.abs().max(shown.std));
    match (described, alone) {
        (None, None) => None,
        // Along a direction that the data do not show it could go anywhere.
        (Some(_), None) if signed => None,
        (_, Some(shown)) if signed => Some(shown.value),
        (Some(value), _) if value > 0.0 => Some(value),
        _ => size.filter(|size| *size > 0.0),
    }
}

fn combinations(shown: &Shown, parameters: &DVector<f64>) -> Vec<Combination> {
    let possible = &shown.rows * parameters;
    let of = |(row, terms): (usize, &BTreeMap<String, f64>)| Combination {
        terms: terms.clone(),
        estimate: shown.values[row],
        std: deviation(&shown.covariance, row),
        possible: possible[row],
    };
    shown.weights.iter().enumerate().map(of).collect()
}

fn deviation(covariance: &DMatrix<f64>, row: usize) -> f64 {
    covariance[(row, row)].max(0.0).sqrt()
}

fn losses(coordinates: &[String], shown: &Shown, parameters: &DVector<f64>) -> BTreeMap<String, JointLosses> {
    let of = |coordinate: &String| {
        let value = |loss: Loss| shown.index(&parameter_name(loss.symbol(), coordinate)).map(|j| parameters[j]);
        let losses =
            JointLosses { damping: value(Loss::Viscous), friction: value(Loss::Coulomb), rotor: value(Loss::Rotor) };
        (coordinate.clone(), losses)
    };
    coordinates.iter().map(of).collect()
}
