//! A model with everything that its source code is made of.
//!
//! Invariant of [`EstimatorSource`]: the form belongs to the model, the plans to both, and every number of the plans has a finite,
//! non-vanishing double.

use thiserror::Error;
use tpm_symbolic::harmonic::expand::{ExpandOptions, expand_with};
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::estimator::EstimatorPlan;
use tpm_symbolic::plan::operation::Op;
use tpm_symbolic::plan::pattern::{PatternGap, PatternPlan};
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::plan::table::TablePlan;
use tpm_symbolic::regressor::form::{Column, RegressorForm, canonical};
use tpm_symbolic::regressor::prepare::{PrepareError, Prepared, prepare};

use super::filter::FilterError;
use super::number::{Rounded, resembles_constant};
use crate::diagnostic::Diagnostic;
use crate::language::Parsed;

/// A model, its regressor form and its plans.
#[derive(Clone, Debug)]
pub struct EstimatorSource {
    /// The model.
    pub model: ExactModel,
    /// Its regressor form.
    pub form: RegressorForm,
    /// The plans of what its code computes.
    pub plan: EstimatorPlan,
    /// What the tables, and only they, replace by Taylor polynomials, in whole sentences.
    pub replaced: Vec<String>,
}

/// Why no source code can be made of a model.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum EmitError {
    /// A coordinate cannot be eliminated, or the model is not linear in its parameters.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// A number of the model is beyond double precision.
    #[error("the number {0} is beyond double precision (about 1e-308 to 1e308); choose other units")]
    OutOfRange(String),
    /// A number of the model is beyond the scalar of the code.
    #[error("{0} is beyond single precision (about 1e-38 to 1e38); generate double precision, or choose other units")]
    OutOfScalar(String),
    /// The prefix cannot begin names of C.
    #[error(
        "`{0}` cannot begin names of C: a prefix is a letter followed by letters, digits and underscores, all ASCII, without an underscore at its end"
    )]
    Prefix(String),
    /// A structure would have no member, which C does not know.
    #[error("the model has {0}, and C has no structure without members")]
    Empty(&'static str),
    /// Identified values are of another model, or incomplete.
    #[error("{0}")]
    Identified(#[from] IdentifiedError),
    /// The low passes of the feed-forward do not exist.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// The text could not be laid out.
    #[error("the emitted code is not Rust as the formatter knows it: {0}")]
    Layout(String),
}

impl EstimatorSource {
    /// Everything that follows from a model.
    ///
    /// # Errors
    /// When a coordinate cannot be eliminated, the model is not linear in its parameters, or it holds a number beyond double precision.
    pub fn new(model: ExactModel) -> Result<Self, EmitError> {
        let prepared = prepare(model)?;
        Self::from_form(prepared.model, prepared.form)
    }

    /// Everything that follows from a model in the language, its declared Taylor orders and numbers of harmonics included:
    /// they hold for the tables, whereas the dynamics stay exact.
    ///
    /// # Errors
    /// When a coordinate cannot be eliminated, the model is not linear in its parameters, a number is beyond double
    /// precision, or a declared Taylor polynomial does not exist; the place in the text is named.
    pub fn of(parsed: &Parsed) -> Result<Self, Diagnostic> {
        let at = |error: &PrepareError| parsed.locate(error);
        let Prepared { model, form, .. } = prepare(parsed.model.clone()).map_err(|error| at(&error))?;
        let (truncated, truncations) = parsed.for_tables().map_err(|error| parsed.locate(&error))?;
        let replaced = Parsed::replacements(&truncated, &truncations);
        let table = |model: &ExactModel, form: &RegressorForm, index: usize| {
            let mut options = ExpandOptions { harmonics: parsed.harmonics_of(index), ..ExpandOptions::default() };
            expand_with(model, form, &model.patterns[index], &mut options).map_err(PatternGap::from)
        };
        let patterns = 0..model.patterns.len();
        let tables: Vec<Result<HarmonicTable, PatternGap>> = if truncations.is_empty() {
            patterns.map(|index| table(&model, &form, index)).collect()
        } else {
            let tabled = prepare(truncated.into_owned()).map_err(|error| at(&error))?;
            let (exact, approximate) = (columns(&model, &form), columns(&tabled.model, &tabled.form));
            if exact == approximate {
                patterns.map(|index| table(&tabled.model, &tabled.form, index)).collect()
            } else {
                let gap = PatternGap::Columns { exact: exact.join(", "), table: approximate.join(", ") };
                patterns.map(|_| Err(gap.clone())).collect()
            }
        };
        let plan = EstimatorPlan::with_tables(&model, &form, tables);
        Self { model, form, plan, replaced }
            .in_range()
            .map_err(|error| Diagnostic::error(parsed.ast.name.span, error.to_string()))
    }

    /// Everything that follows from a model and its regressor form, where the form was made elsewhere.
    ///
    /// # Errors
    /// When a number is beyond double precision.
    pub fn from_form(model: ExactModel, form: RegressorForm) -> Result<Self, EmitError> {
        let plan = EstimatorPlan::new(&model, &form);
        Self { model, form, plan, replaced: Vec::new() }.in_range()
    }

    fn in_range(self) -> Result<Self, EmitError> {
        let lost = self.numbers().find(|value| Rounded::new(value).is_lost(value)).map(rational::display);
        match lost {
            Some(lost) => Err(EmitError::OutOfRange(shortened(&lost))),
            None => Ok(self),
        }
    }

    /// The parts of the patterns that this code lacks, and why, in whole sentences.
    #[must_use]
    pub fn gaps(&self) -> Vec<String> {
        let of = |pattern: &PatternPlan| {
            let name = pattern.name.as_ref().map_or_else(String::new, |name| format!("Pattern `{name}`: "));
            gaps(pattern).into_iter().map(|gap| format!("{name}{gap}")).collect::<Vec<String>>()
        };
        self.plan.patterns.iter().flat_map(of).collect()
    }

    fn tables(&self) -> impl Iterator<Item = &TablePlan> {
        self.plan.patterns.iter().filter_map(|pattern| pattern.table.as_ref().ok())
    }

    /// All plans.
    fn plans(&self) -> impl Iterator<Item = &Plan> {
        let plan = &self.plan;
        let fixed = [&plan.evaluation.regressor, &plan.evaluation.known, &plan.evaluation.input_map];
        let references = plan.patterns.iter().filter_map(|pattern| pattern.reference.as_ref().ok());
        let tables = self.tables().flat_map(|table| [&table.matrix, &table.bank]);
        fixed
            .into_iter()
            .chain([&plan.inverse_dynamics])
            .chain(plan.feed_forward_parts.iter().flatten())
            .chain(&plan.lumping)
            .chain(plan.unlumping.iter().flatten().map(|unlumping| &unlumping.plan))
            .chain(references)
            .chain(tables)
    }

    pub(super) fn numbers(&self) -> impl Iterator<Item = &Rational> {
        self.plans().flat_map(|plan| &plan.ops).filter_map(|op| match op {
            Op::Constant(value) => Some(value),
            _ => None,
        })
    }

    /// Whether a literal of the code would look like a mistyped irrational constant.
    pub(super) fn resembles_constant(&self) -> bool {
        self.numbers().any(|value| resembles_constant(rational::to_f64(value)))
    }
}

/// Names and definitions of the columns.
fn columns(model: &ExactModel, form: &RegressorForm) -> Vec<String> {
    let definition = |column: &Column| match column.parameter {
        Some(_) => column.name.to_string(),
        None => format!("{} = {}", column.name, canonical(model, &column.definition)),
    };
    form.columns.iter().map(definition).collect()
}

/// What is left out for a pattern, and why.
pub(super) fn gaps(pattern: &PatternPlan) -> Vec<String> {
    let mut gaps = Vec::new();
    if let Err(gap) = &pattern.reference {
        gaps.push(format!("There is no reference motion: {}.", reason(gap)));
    }
    if let Err(gap) = &pattern.table {
        gaps.push(format!("There is no estimator matrix and no harmonic: {}.", reason(gap)));
    }
    gaps
}

/// A fault in one line, without the markup of a message.
fn reason(error: &impl std::fmt::Display) -> String {
    error.to_string().lines().collect::<Vec<_>>().join(" ")
}

/// The first and last digits of a number too long to be read.
fn shortened(digits: &str) -> String {
    match (digits.get(..20), digits.get(digits.len().saturating_sub(10)..)) {
        (Some(first), Some(last)) if digits.len() > 40 => format!("{first}...{last}"),
        _ => digits.to_owned(),
    }
}

/// One identified parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct IdentifiedParameter {
    /// Its name, as the columns of the model are named.
    pub name: String,
    /// The identified value, or the prior where the data say nothing about it.
    pub value: f64,
    /// Its standard deviation, when the data determine it.
    pub std: Option<f64>,
    /// The status that the identification reports.
    pub status: String,
}

/// The result of an identification, as it is baked into emitted code.
#[derive(Clone, Debug, PartialEq)]
pub struct Identified {
    /// Name of the model.
    pub model: String,
    /// One entry per column.
    pub parameters: Vec<IdentifiedParameter>,
}

/// Why the result of an identification cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum IdentifiedError {
    /// The file does not have the schema of an identification result.
    #[error("the identified values are of none of the schemas that can be read, {known}: {0}", known = READABLE_SCHEMAS.join(", "))]
    Schema(String),
    /// The result belongs to another model.
    #[error("the identified values are of the model `{found}`, not of `{expected}`")]
    Model {
        /// The model in the file.
        found: String,
        /// The model that is emitted.
        expected: String,
    },
    /// A parameter has no value.
    #[error("the parameter `{0}` has no identified value and no prior one; identify it, or give it a prior")]
    Missing(String),
}

/// The schema of identification results.
pub const SCHEMA: &str = "tpm.identification/2";

/// The schemas of identification results that can be read: every field of the first one is in the second.
pub const READABLE_SCHEMAS: [&str; 2] = ["tpm.identification/1", SCHEMA];

impl Identified {
    /// One value per column of `estimator`, in its order.
    pub(crate) fn in_order(&self, estimator: &EstimatorSource) -> Result<Vec<&IdentifiedParameter>, IdentifiedError> {
        if self.model != estimator.model.name {
            let expected = estimator.model.name.clone();
            return Err(IdentifiedError::Model { found: self.model.clone(), expected });
        }
        let find = |name: &str| {
            let found = self.parameters.iter().find(|parameter| parameter.name == *name);
            found.ok_or_else(|| IdentifiedError::Missing(name.to_owned()))
        };
        estimator.form.columns.iter().map(|column| find(&column.name)).collect()
    }

    /// Reads the JSON that `tpm identify --json` prints.
    ///
    /// # Errors
    /// When the text is not of a readable schema, or a parameter has neither an identified nor a prior value.
    #[cfg(feature = "generate")]
    pub fn from_json(text: &str) -> Result<Self, IdentifiedError> {
        #[derive(serde::Deserialize)]
        struct File {
            schema: String,
            model: String,
            parameters: Vec<Parameter>,
        }
        #[derive(serde::Deserialize)]
        struct Parameter {
            name: String,
            #[serde(default)]
            prior: Option<f64>,
            value: Option<f64>,
            #[serde(default)]
            std: Option<f64>,
            #[serde(default)]
            status: String,
        }
        let file: File = serde_json::from_str(text).map_err(|error| IdentifiedError::Schema(error.to_string()))?;
        if !READABLE_SCHEMAS.contains(&file.schema.as_str()) {
            return Err(IdentifiedError::Schema(format!("it says `{}`", file.schema)));
        }
        let parameters = file.parameters.into_iter().map(|parameter| {
            let value = parameter.value.or(parameter.prior);
            let value = value.ok_or_else(|| IdentifiedError::Missing(parameter.name.clone()))?;
            Ok(IdentifiedParameter { name: parameter.name, value, std: parameter.std, status: parameter.status })
        });
        Ok(Self { model: file.model, parameters: parameters.collect::<Result<_, IdentifiedError>>()? })
    }
}
