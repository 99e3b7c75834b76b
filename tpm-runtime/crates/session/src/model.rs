//! A model that is read at run time, from its file or from the text that a compiled model carries.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::Path;
use tpm_codegen::language::{AtTerm, end_of_statements};
use tpm_codegen::source::Source;
use tpm_codegen::{Parsed, diagnostic, parse_model};
use tpm_controller::model::Model;
use tpm_interpret::{Interpreted, InterpretedDerivatives, Separable};
use tpm_log::fingerprint;
use tpm_report::{MOST_TEXT, read_input};
use tpm_symbolic::expr::graph::Coordinate;
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::number::rational::to_f64;
use tpm_symbolic::plan::observability::{Shown, shown};
use tpm_symbolic::regressor::prepare::{PrepareError, Prepared, prepare_any};

/// Why a model cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFault {
    /// The file cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The text is not a model; every fault is given at its place.
    #[error("{diagnostics}")]
    Text {
        /// The faults with their places, for printing.
        diagnostics: String,
    },
    /// A compiled model does not carry the text that it was declared with, as those written by hand do not.
    #[error(
        "model {name} was written by hand: its physical parameters and patterns are not known; declare it in a model file or with the macro"
    )]
    NoText {
        /// The model.
        name: String,
    },
}

/// A parameter in which the equations of a model are not linear.
pub(super) struct NonlinearParameter {
    pub(super) name: String,
    pub(super) unit: Option<String>,
    /// Least and largest value.
    pub(super) interval: [f64; 2],
}

/// A declared model: its text, its exact form sorted into parameters, and its evaluation.
///
/// Invariant: evaluated, it has the rows and the parameters that remain after eliminations and lumping.
#[derive(Clone, Debug)]
pub struct DeclaredModel {
    source: Source,
    parsed: Parsed,
    prepared: Prepared,
    evaluated: Interpreted,
}

/// A model's own equations, before coordinates are eliminated.
pub(super) fn with_all_coordinates(prepared: &Prepared) -> Result<Cow<'_, Prepared>, PrepareError> {
    if prepared.model.eliminations.is_empty() {
        return Ok(Cow::Borrowed(prepared));
    }
    let mut model = prepared.model.clone();
    model.eliminations.clear();
    prepare_any(model).map(Cow::Owned)
}

impl DeclaredModel {
    /// Reads a model file.
    ///
    /// # Errors
    /// [`ModelFault::Read`], [`ModelFault::Text`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ModelFault> {
        let path = path.as_ref();
        let name = path.display().to_string();
        let bytes = read_input(path, MOST_TEXT).map_err(|source| ModelFault::Read { path: name.clone(), source })?;
        let source = Source::from_bytes(name, bytes);
        let other = other_kind(&source);
        Self::of_source(source).map_err(|fault| match (fault, other) {
            (ModelFault::Text { .. }, Some(diagnostics)) => ModelFault::Text { diagnostics },
            (fault, _) => fault,
        })
    }

    /// Reads a model from its text; `name` stands in messages.
    ///
    /// # Errors
    /// [`ModelFault::Text`].
    pub fn parse(name: &str, text: &str) -> Result<Self, ModelFault> {
        Self::of_source(Source::new(name, text))
    }

    /// Reads a model from a source.
    ///
    /// # Errors
    /// [`ModelFault::Text`].
    pub fn of_source(source: Source) -> Result<Self, ModelFault> {
        let parsed = parse_model(&source).map_err(|faults| ModelFault::Text { diagnostics: faults.render(&source) })?;
        let prepared = prepare_any(parsed.model.clone())
            .map_err(|fault| ModelFault::Text { diagnostics: located(&source, &parsed, &fault) })?;
        let evaluated = Interpreted::new(&prepared.model, &prepared.form);
        Ok(Self { source, parsed, prepared, evaluated })
    }

    /// The model with further statements behind its own; `name` stands in messages.
    ///
    /// # Errors
    /// [`ModelFault::Text`].
    pub fn with_statements(&self, name: &str, statements: &str) -> Result<Self, ModelFault> {
        let (before, after) = self.source.text().split_at(end_of_statements(&self.source));
        Self::parse(name, &format!("{before}{statements}{after}"))
    }

    /// The model with a pattern where it declares none: every coordinate at rest at both ends of a way about the middle that is stated of
    /// it, or about zero (Feng, Eqn 2.21), with an amplitude of its own and one frequency.
    ///
    /// # Errors
    /// [`ModelFault::Text`] where the text cannot be read with it.
    pub(super) fn with_pattern(self, middle: impl Fn(&str) -> f64) -> Result<Self, ModelFault> {
        let model = &self.prepared.model;
        if !model.patterns.is_empty() {
            return Ok(self);
        }
        let mut names = FreeNames::of(&self);
        let frequency = names.free("w_pattern");
        let (mut amplitudes, mut motions, mut middles) = (Vec::new(), String::new(), String::new());
        for coordinate in model.coordinates.iter().filter(|own| !own.unmeasured) {
            let (name, amplitude) = (&coordinate.name, names.free(&format!("way_{}", coordinate.name)));
            let unit = coordinate.unit.as_ref().map(|unit| format!(" [{unit}]")).unwrap_or_default();
            let value = middle(name);
            let about = if value == 0.0 {
                String::new()
            } else {
                let own = names.free(&format!("middle_{name}"));
                middles.push_str(&format!("    constant {own} = {value}{unit};\n"));
                format!("{own} + ")
            };
            motions.push_str(&format!("        {name} = {about}rest_to_rest({amplitude}, {frequency}, 3);\n"));
            amplitudes.push(format!("{amplitude}{unit}"));
        }
        let pattern = format!(
            "\n{middles}    pattern {{\n        amplitude {};\n        frequency {frequency} [rad/s];\n{motions}    }}\n",
            amplitudes.join(", ")
        );
        self.with_statements(self.source.name(), &pattern)
    }

    /// Names of its eliminated coordinates.
    pub(super) fn eliminated(&self) -> Vec<String> {
        let model = &self.prepared.model;
        let targets = model.eliminations.iter().flat_map(|elimination| &elimination.coordinates);
        targets.map(|coordinate| model.coordinates[coordinate.0 as usize].name.to_string()).collect()
    }

    /// The model with nothing eliminated.
    ///
    /// # Errors
    /// [`PrepareError`] when its own equations have no form that is linear in parameters.
    pub(super) fn with_all_coordinates(&self) -> Result<Self, PrepareError> {
        let prepared = with_all_coordinates(&self.prepared)?.into_owned();
        let evaluated = Interpreted::new(&prepared.model, &prepared.form);
        Ok(Self { source: self.source.clone(), parsed: self.parsed.clone(), prepared, evaluated })
    }

    /// The model for sensors that read the rates of the coordinates of these names, and not their positions.
    ///
    /// # Errors
    /// [`PrepareError`] when its equations then have no form that is linear in parameters.
    pub(super) fn with_rates_measured(&self, names: &[String]) -> Result<Self, PrepareError> {
        let own = (0..).map(Coordinate).zip(&self.prepared.model.coordinates);
        let coordinates: Vec<Coordinate> =
            own.filter(|(_, info)| names.contains(&info.name)).map(|(coordinate, _)| coordinate).collect();
        let prepared = prepare_any(self.prepared.model.clone().with_rates_measured(&coordinates))?;
        let evaluated = Interpreted::new(&prepared.model, &prepared.form);
        Ok(Self { source: self.source.clone(), parsed: self.parsed.clone(), prepared, evaluated })
    }

    /// Whether only a simulation tells its parameters from a log: a coordinate is not measured, an input does not stand alone, or there is
    /// none.
    pub(super) fn is_only_simulated(&self) -> bool {
        let model = &self.prepared.model;
        model.coordinates.iter().any(|coordinate| coordinate.unmeasured) || self.prepared.form.is_only_simulated(model)
    }

    /// What the sensors of its measured coordinates, and of those derivatives (1 for a rate, 2 for an acceleration) of coordinates that are
    /// named, show of its columns at all while the columns `held` are known; nothing where that is not found exactly.
    #[must_use]
    pub fn shown(&self, derivatives: &[(String, u32)], held: &[usize]) -> Option<Shown> {
        let model = &self.prepared.model;
        let own = (0..).map(Coordinate).zip(&model.coordinates);
        let sensors: Vec<(Coordinate, u32)> = own
            .flat_map(|(coordinate, info)| {
                let position = (!info.unmeasured).then_some((coordinate, 0));
                let own = derivatives.iter().filter(|(name, _)| *name == info.name);
                position.into_iter().chain(own.map(move |&(_, order)| (coordinate, order)))
            })
            .collect();
        let mut found = shown(model, &self.prepared.form, &sensors, held)?;
        // What is no state of its own, such as the reading of an accelerometer, has nothing that a sensor could feel.
        let moves = |coordinate: &Coordinate| {
            let name = &model.coordinates[coordinate.0 as usize].name;
            let own = (0..self.evaluated.dims().coordinates).find(|&c| self.evaluated.coordinate(c).name == *name);
            own.is_some_and(|c| self.evaluated.coordinate_order(c) > 0)
        };
        found.unfelt.retain(moves);
        Some(found)
    }

    /// The derivatives of its rows.
    pub(super) fn derivatives(&self) -> InterpretedDerivatives {
        let prepared = self.prepared();
        InterpretedDerivatives::new(&prepared.model, &prepared.form)
    }

    /// The model with its nonlinear parameters behind the others; nothing for a model without any.
    pub(super) fn separable(&self) -> Option<Separable> {
        Separable::new(&self.prepared.model, &self.prepared.form)
    }

    /// Its nonlinear parameters.
    pub(super) fn nonlinear(&self) -> impl Iterator<Item = NonlinearParameter> + '_ {
        let model = &self.prepared.model;
        model.nonlinear.iter().map(move |own| {
            let quantity = model.quantity(own.symbol);
            NonlinearParameter {
                name: quantity.name.to_string(),
                unit: quantity.unit.as_ref().map(ToString::to_string),
                interval: [to_f64(&own.from), to_f64(&own.to)],
            }
        })
    }

    /// The derivatives of its rows, with its nonlinear parameters behind the others.
    pub(super) fn separable_derivatives(&self) -> InterpretedDerivatives {
        InterpretedDerivatives::separable(&self.prepared.model, &self.prepared.form)
    }

    /// The exact form, sorted into the parameters that the model is linear in.
    #[must_use]
    pub const fn prepared(&self) -> &Prepared {
        &self.prepared
    }

    /// What the parser found, with the way back to the text.
    #[must_use]
    pub const fn parsed(&self) -> &Parsed {
        &self.parsed
    }

    /// The text.
    #[must_use]
    pub const fn text(&self) -> &Source {
        &self.source
    }

    /// What tells the model's text from others.
    #[must_use]
    pub fn hash(&self) -> String {
        fingerprint(self.source.text().as_bytes())
    }

    /// Remarks about the text that do not keep it from being used; empty when there are none.
    #[must_use]
    pub fn remarks(&self) -> String {
        let remarks = &self.parsed.warnings;
        if remarks.is_empty() { String::new() } else { remarks.render(&self.source).trim_end().to_string() }
    }

    /// The pattern of this name, the first one when no name is given.
    ///
    /// # Errors
    /// [`ModelFault::Text`], at the model's name, when there is no such pattern.
    pub fn pattern(&self, name: Option<&str>) -> Result<&Pattern, ModelFault> {
        self.parsed
            .pattern(name, "leave the name out")
            .map_err(|fault| ModelFault::Text { diagnostics: diagnostic::render(&self.source, &fault) })
    }
}

/// Names that a model does not use yet.
#[derive(Clone, Debug)]
pub struct FreeNames(BTreeSet<String>);

impl FreeNames {
    /// Those of a model.
    #[must_use]
    pub fn of(declared: &DeclaredModel) -> Self {
        let model = &declared.prepared.model;
        let quantities = model.symbols_where(|_| true).map(|symbol| model.quantity(symbol).name.to_string());
        let coordinates = model.coordinates.iter().map(|coordinate| coordinate.name.to_string());
        let patterns = model.patterns.iter().filter_map(|pattern| pattern.name.as_ref().map(ToString::to_string));
        Self(quantities.chain(coordinates).chain(patterns).collect())
    }

    /// This name, with a number where it is taken; it is taken from then on.
    pub fn free(&mut self, wanted: &str) -> String {
        let numbered = (2..).map(|number| format!("{wanted}{number}"));
        let free = std::iter::once(wanted.to_string()).chain(numbered).find(|name| !self.0.contains(name));
        let free = free.unwrap_or_default();
        self.0.insert(free.clone());
        free
    }
}

/// What to say in place of the faults of a text that is no model, and does not stand in a model file; nothing for others.
#[must_use]
pub fn other_kind(source: &Source) -> Option<String> {
    let name = source.name();
    let kind = Path::new(name).extension().and_then(|extension| extension.to_str())?;
    let begins = |line: &str| line.trim_start().starts_with("model ");
    (["toml", "csv", "json", "urdf", "xml"].contains(&kind) && !source.text().lines().any(begins)).then(|| {
        format!("error: {name}:1:1: no line begins a model, and a .{kind} file is none; give one ending in .tpm\n")
    })
}

fn located(source: &Source, parsed: &Parsed, fault: &impl AtTerm) -> String {
    diagnostic::render(source, &parsed.locate(fault))
}

/// What can be identified: a declared model, or any model that evaluates its rows.
///
/// A model that was compiled by the macro carries its declaration; one that was written by hand has none, and is identified in the
/// parameters that it states.
pub trait Identifiable {
    /// The rows, evaluated.
    fn evaluated(&self) -> &dyn Model<f64>;

    /// The declaration; nothing for a model that was written by hand.
    ///
    /// # Errors
    /// [`ModelFault::Text`] when the text that the model carries is not a model.
    fn declaration(&self) -> Result<Option<Cow<'_, DeclaredModel>>, ModelFault>;
}

impl Identifiable for DeclaredModel {
    fn evaluated(&self) -> &dyn Model<f64> {
        &self.evaluated
    }

    fn declaration(&self) -> Result<Option<Cow<'_, DeclaredModel>>, ModelFault> {
        Ok(Some(Cow::Borrowed(self)))
    }
}

impl<M: Model<f64>> Identifiable for M {
    fn evaluated(&self) -> &dyn Model<f64> {
        self
    }

    fn declaration(&self) -> Result<Option<Cow<'_, DeclaredModel>>, ModelFault> {
        let Some(text) = self.source() else { return Ok(None) };
        DeclaredModel::parse(self.name(), text).map(|declared| Some(Cow::Owned(declared)))
    }
}
