//! Possible inertias of the links of an arm.

use crate::error::InertiaError;
use crate::evidence::Shown;
use crate::nearest::Nearest;
use crate::request::InertiasRequest;
use crate::stage::{Stage, names_of, own_parameters};
use serde::Serialize;
use std::collections::BTreeMap;
use tpm_codegen::import::{DescribedBody, JointLosses, Parted};
use tpm_numerics::tail::chi_squared_upper;
use tpm_numerics::{DMatrix, DVector};
use tpm_report::{number, probability};
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::number::rational::to_f64;

/// Share of what is known about a parameter above which the data said it.
const MOSTLY: f64 = 0.99;
/// Probability of the distance between estimate and possible inertias, were the deviations right, below which the estimate is doubted.
const DOUBTFUL: f64 = 1e-3;

/// Where a value comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// The data show the parameter by itself.
    Data,
    /// The data narrow it down, and the description decides the rest.
    Both,
    /// The data do not depend on the parameter: the description's value stays.
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
    let report = stage.report(request, &shown, &found, parameters, parted, remarks);
    let of = |own: &Parameter| [Some(own.value), own.std, own.description, Some(own.from_data)];
    let numbers = report.parameters.iter().flat_map(of).flatten().chain([report.distance, report.chance]);
    let of = |own: &Combination| [own.estimate, own.std, own.possible];
    if !numbers.chain(report.combinations.iter().flat_map(of)).all(f64::is_finite) {
        return Err(InertiaError::NoMinimum);
    }
    Ok(report)
}

impl Stage {
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
                probability(chance, number)
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
            (Some(_), _) if self.loose[j] => Origin::Both,
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
