//! Identifiability of a model's parameters under its patterns, or under any motion: exact where there is a harmonic
//! table, and in floating point along the pattern where there is none.

use crate::identifiability::{PlayedPattern, numerical_identifiability};
use crate::report::Report;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Display;
use tpm_codegen::Parsed;
use tpm_codegen::diagnostic::Diagnostic;
use tpm_codegen::language::AtTerm;
use tpm_symbolic::expr::graph::Coordinate;
use tpm_symbolic::harmonic::expand::{ExpandError, ExpandOptions, expand_with};
use tpm_symbolic::harmonic::identifiability::{Experiment, PhysicalIdentifiability, identifiability};
use tpm_symbolic::harmonic::nonsmooth::DEFAULT_HARMONICS;
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::number::rational::{self, Rational, to_f64};
use tpm_symbolic::regressor::base_parameters::{BaseParameters, Certificate, Motions, Rest, base_parameters, verify};
use tpm_symbolic::regressor::homogeneous::homogeneous;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::{Prepared, prepare};

/// Seed of the random points of the check; the result does not depend on it.
const SEED: u64 = 1;

/// A pattern whose identifiability is asked for.
#[derive(Clone, Debug)]
pub struct AskedPattern<'a> {
    /// A name for reports.
    pub name: String,
    /// The pattern.
    pub pattern: &'a Pattern,
    /// The highest harmonic that is used; when not given, the pattern's own limit, else all harmonics of the table.
    pub harmonics: Option<usize>,
    /// Values of amplitudes, frequency, constants and, where a coordinate is open, parameters; other symbols stay
    /// symbolic or are drawn.
    pub values: Vec<(String, Rational)>,
}

/// Identifiability under several patterns together. It serialises as `tpm.identifiability/1`.
#[derive(Clone, Debug, Serialize)]
pub struct Shown {
    /// The parameters that the model is linear in.
    #[serde(flatten)]
    pub report: Report,
    /// The physical parameters behind lumped ones.
    pub physical: Option<PhysicalIdentifiability>,
    /// Nonlinear parameters, which count as constants here.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub nonlinear: Vec<String>,
    /// Remarks on terms that were replaced by their declared Taylor polynomials.
    #[serde(skip)]
    pub replaced: Vec<String>,
    /// Why there is no harmonic table, where the answer was computed in floating point.
    #[serde(skip)]
    pub refused: Option<ExpandError>,
}

/// Why nothing can be said of what a model shows.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShownError {
    /// A fault of the model, at its place in the text.
    #[error("{}", .0.message)]
    Model(Box<Diagnostic>),
    /// A fault of the request.
    #[error("{0}")]
    Asked(String),
}

/// Identifiability of a model's parameters under several of its patterns together.
///
/// # Errors
/// [`ShownError`].
pub fn shown(parsed: &Parsed, asked: &[AskedPattern<'_>]) -> Result<Shown, ShownError> {
    let (model, truncations) = parsed.for_tables().map_err(|error| located(parsed, &error))?;
    let replaced = Parsed::replacements(&model, &truncations);
    let prepared = prepare(model.into_owned()).map_err(|error| located(parsed, &error))?;
    let (report, physical, refused) = match exact(parsed, &prepared, asked)? {
        Ok((report, physical)) => (report, physical, None),
        Err(refused) => {
            let (report, physical) = along(parsed, asked).map_err(|error| match (&refused, error) {
                (ExpandError::NoMotion { .. }, ShownError::Asked(reason)) => {
                    ShownError::Model(Box::new(parsed.locate(&refused).help(reason)))
                }
                (_, error) => error,
            })?;
            (report, physical, Some(refused))
        }
    };
    Ok(Shown { report, physical, nonlinear: nonlinear(parsed), replaced, refused })
}

/// Identifiability of the linear parameters, and of the physical ones behind them.
type Exact = (Report, Option<PhysicalIdentifiability>);

/// The exact answer from harmonic tables, or the reason why there is no table.
fn exact(
    parsed: &Parsed,
    prepared: &Prepared,
    asked: &[AskedPattern<'_>],
) -> Result<Result<Exact, ExpandError>, ShownError> {
    let mut tables = Vec::with_capacity(asked.len());
    for asked in asked {
        let mut options = ExpandOptions { harmonics: highest(parsed, asked), ..ExpandOptions::default() };
        match expand_with(&prepared.model, &prepared.form, asked.pattern, &mut options) {
            Ok(table) => tables.push(table),
            Err(error) => return Ok(Err(error)),
        }
    }
    let mut experiments: Vec<Experiment<'_>> = Vec::with_capacity(asked.len());
    for (asked, table) in asked.iter().zip(&tables) {
        let mut experiment = Experiment::of(&asked.name, &prepared.model, table).up_to(highest(parsed, asked));
        for (name, value) in &asked.values {
            experiment = experiment.with(name, value.clone());
        }
        experiments.push(experiment);
    }
    let found = identifiability(&experiments).map_err(|error| ShownError::Asked(error.to_string()))?;
    let common = found.common_factors(&homogeneous(&prepared.form));
    // What is known of physical parameters beyond a common factor is not said where there is one.
    let physical = if common.is_empty() { found.physical(&ParameterMap::new(prepared)) } else { None };
    Ok(Ok((Report::of(&found).with_common_factors(sets(&found.parameters, &common)), physical)))
}

/// The answer in floating point, from the rows along the patterns.
fn along(parsed: &Parsed, asked: &[AskedPattern<'_>]) -> Result<Exact, ShownError> {
    let prepared = prepare(parsed.model.clone()).map_err(|error| located(parsed, &error))?;
    let mut played: Vec<PlayedPattern<'_>> = Vec::with_capacity(asked.len());
    for asked in asked {
        played.push(PlayedPattern {
            name: asked.name.clone(),
            pattern: asked.pattern,
            values: asked.values.iter().map(|(name, value)| (name.clone(), to_f64(value))).collect(),
            harmonics: highest(parsed, asked).unwrap_or(DEFAULT_HARMONICS),
        });
    }
    let found = numerical_identifiability(&prepared, &played);
    let (report, physical) = found.map_err(|error| ShownError::Asked(error.to_string()))?;
    let form = &prepared.form;
    if homogeneous(form).is_empty() {
        return Ok((report, Some(physical)));
    }
    // A motion that was completed obeys the rows, and its rank lacks the factor already; a prescribed one seems to show every member.
    let whole = base_parameters(&prepared.model, form, &Motions::default())
        .map_err(|error| ShownError::Asked(error.to_string()))?;
    let observable = |name: &String| report.parameters.iter().any(|own| own.name == *name && own.observable);
    let mut common = sets(&whole.parameters, &whole.common_factors);
    common.retain(|set| set.iter().all(observable));
    let physical = common.is_empty().then_some(physical);
    Ok((report.with_common_factors(common), physical))
}

/// Sets of columns by their names.
fn sets(names: &[String], columns: &[Vec<usize>]) -> Vec<Vec<String>> {
    columns.iter().map(|set| set.iter().map(|&column| names[column].clone()).collect()).collect()
}

/// The highest harmonic that is used, where one is stated.
fn highest(parsed: &Parsed, asked: &AskedPattern<'_>) -> Option<usize> {
    asked.harmonics.or_else(|| parsed.declared_harmonics(asked.pattern))
}

/// Names of the nonlinear parameters.
pub(super) fn nonlinear(parsed: &Parsed) -> Vec<String> {
    let model = &parsed.model;
    model.nonlinear.iter().map(|own| model.quantity(own.symbol).name.to_string()).collect()
}

pub(super) fn located(parsed: &Parsed, fault: &impl AtTerm) -> ShownError {
    ShownError::Model(Box::new(parsed.locate(fault)))
}

/// A base parameter, whose members any motion shows only together: `parameter + sum plus[other] * other`, with exact
/// factors.
#[derive(Clone, Debug, Serialize)]
pub struct Base {
    /// The leading parameter.
    pub parameter: String,
    /// Factors of the parameters that are lumped into it.
    pub plus: BTreeMap<String, String>,
}

/// Identifiability of a model under any motion, with a certificate that was checked. It serialises as `tpm.base/1`.
#[derive(Clone, Debug, Serialize)]
pub struct AnyMotion {
    /// Name and version of the file format.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// The parameters that the model is linear in.
    pub parameters: Vec<String>,
    /// Number of independent combinations that motions show.
    pub rank: usize,
    /// The base parameters; nothing where their factors depend on constants without a value.
    pub base: Option<Vec<Base>>,
    /// Sets of leading parameters that any motion shows only up to a common factor: equations without an input or a known term alone show
    /// them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub common_factors: Vec<Vec<String>>,
    /// Parameters that no motion shows, in any combination.
    pub unobservable: Vec<String>,
    /// Nonlinear parameters, which count as constants here.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub nonlinear: Vec<String>,
    /// The proof of the rank of the equations, which is larger by one for every common factor.
    pub certificate: Certificate,
}

/// Identifiability of a model under any motion in which some coordinates rest, each at a value.
///
/// # Errors
/// [`ShownError`].
pub fn any_motion(parsed: &Parsed, rests: &[(String, Rational)]) -> Result<AnyMotion, ShownError> {
    let prepared = prepare(parsed.model.clone()).map_err(|error| located(parsed, &error))?;
    let model = &prepared.model;
    let mut motions = Motions::default();
    for (name, value) in rests {
        let at = model.coordinates.iter().position(|coordinate| coordinate.name == name.as_str());
        let at = at.ok_or_else(|| ShownError::Asked(format!("the model has no coordinate `{name}`")))?;
        motions.resting.insert(Coordinate(at as u32), Rest::Value(value.clone()));
    }
    let whole =
        |error: &dyn Display| ShownError::Model(Box::new(Diagnostic::error(parsed.ast.name.span, error.to_string())));
    let found = base_parameters(model, &prepared.form, &motions).map_err(|error| whole(&error))?;
    verify(model, &prepared.form, &motions, &found.certificate, SEED).map_err(|error| whole(&error))?;
    Ok(AnyMotion {
        schema: "tpm.base/1",
        model: model.name.to_string(),
        rank: found.rank - found.common_factors.len(),
        base: named(&found),
        common_factors: sets(&found.parameters, &found.common_factors),
        unobservable: unobservable(&found),
        nonlinear: nonlinear(parsed),
        parameters: found.parameters,
        certificate: found.certificate,
    })
}

/// The base parameters by name; nothing where their factors depend on constants without a value.
fn named(found: &BaseParameters) -> Option<Vec<Base>> {
    let name = |column: usize| found.parameters[column].clone();
    let base = found.base.as_ref()?.iter().map(|one| Base {
        parameter: name(one.column),
        plus: one.others.iter().map(|(column, factor)| (name(*column), rational::display(factor))).collect(),
    });
    Some(base.collect())
}

/// Parameters that no motion shows, in any combination.
fn unobservable(found: &BaseParameters) -> Vec<String> {
    let alone = |direction: &Vec<(usize, Rational)>| match direction.as_slice() {
        [(column, _)] => Some(found.parameters[*column].clone()),
        _ => None,
    };
    found.certificate.directions.iter().flatten().filter_map(alone).collect()
}
