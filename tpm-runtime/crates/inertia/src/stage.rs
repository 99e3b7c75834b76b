//! From a result and a description to the problem of the nearest possible parameters.

use crate::error::InertiaError;
use crate::evidence::{Alone, Shown};
use crate::nearest::Problem;
use crate::reference::possible;
use crate::request::InertiasRequest;
use std::collections::{BTreeMap, BTreeSet};
use tpm_codegen::import::DescribedBody;
use tpm_numerics::DVector;
use tpm_session::DeclaredModel;
use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::number::rational::to_f64;

/// The names of a body's ten parameters.
pub(crate) fn names_of(body: &str) -> [String; 10] {
    NAMES.map(|name| parameter_name(name, body))
}

/// The parameters that the model declares.
pub(crate) fn own_parameters(model: &DeclaredModel) -> BTreeSet<String> {
    let model = &model.prepared().model;
    model.parameters().map(|symbol| model.quantity(symbol).name.to_string()).collect()
}

/// The problem, and the way from its unknowns to all parameters.
pub(crate) struct Stage {
    pub(crate) problem: Problem,
    /// Unknowns of the problem, by their index among all parameters.
    pub(crate) unknown: Vec<usize>,
    /// Values of all parameters that are no unknowns.
    fixed: DVector<f64>,
    /// What the description or the request says.
    pub(crate) described: Vec<Option<f64>>,
    pub(crate) held: Vec<bool>,
    /// Losses of which only sums with other parameters are known: bounded by zero, and free otherwise.
    pub(crate) loose: Vec<bool>,
    /// The parameters in the order of the report: those of bodies first.
    pub(crate) order: Vec<usize>,
    pub(crate) coordinates: Vec<String>,
}

impl Stage {
    pub(crate) fn new(
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
        let (mut unknown, mut positive, mut held, mut loose) = (Vec::new(), Vec::new(), vec![false; n], vec![false; n]);
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
            } else if let Some(size) = shown.most(j).filter(|_| !signed[j]) {
                reference[j] = size;
                unknown.push(j);
                loose[j] = true;
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
            loose: (0..n).filter(|j| loose[*j]).map(place).collect(),
            reference: DVector::from_iterator(unknown.len(), unknown.iter().map(|j| reference[*j])),
            weight: request.weight,
        };
        let of_body = of_bodies.iter().flatten().copied();
        let order = of_body.chain((0..n).filter(|j| !in_body[*j])).collect();
        let coordinates = bodies.iter().map(|body| body.coordinate.to_owned()).collect();
        Ok(Self { problem, unknown, fixed, described, held, loose, order, coordinates })
    }

    /// All parameters.
    pub(crate) fn whole(&self, unknowns: &DVector<f64>) -> DVector<f64> {
        let mut all = self.fixed.clone();
        self.unknown.iter().zip(unknowns).for_each(|(j, value)| all[*j] = *value);
        all
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
