//! A model with all plans from which its source code is generated.
//!
//! Invariant of [`EstimatorSource`]: the form belongs to the model, the plans to both, and every number of the plans has a finite,
//! non-vanishing double.

use std::collections::BTreeMap;
use thiserror::Error;
use tpm_symbolic::expr::graph::{Coordinate, Function};
use tpm_symbolic::harmonic::expand::{ExpandOptions, expand_with};
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::tree::mechanism::Mechanism;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::estimator::EstimatorPlan;
use tpm_symbolic::plan::lumping::lumping_slopes;
use tpm_symbolic::plan::operation::Op;
use tpm_symbolic::plan::pattern::{PatternGap, PatternPlan};
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::plan::table::TablePlan;
use tpm_symbolic::regressor::form::{Column, RegressorForm, canonical, structured_form_with};
use tpm_symbolic::regressor::prepare::{PrepareError, Prepared, Reconstruction, prepare, prepare_any};
use tpm_symbolic::regressor::solved::solved;

use super::filter::{FilterError, Filters};
use super::formulas::Formulas;
use super::number::{Rounded, resembles_constant};
use super::part::{Parts, RUN_HARMONICS};
use super::specialise::{SpecialiseError, specialised};
use crate::diagnostic::Diagnostic;
use crate::language::Parsed;
use crate::language::ast::{Ident, Item, ModelDeclaration};

pub use super::part::{Part, PartError};
pub use crate::identified::{Identified, IdentifiedError, IdentifiedParameter, READABLE_SCHEMAS, SCHEMA};

/// A model, its regressor form and its plans.
#[derive(Clone, Debug)]
pub struct EstimatorSource {
    /// The model.
    pub model: ExactModel,
    /// Its regressor form.
    pub form: RegressorForm,
    /// The plans of all functions in the code.
    pub plan: EstimatorPlan,
    /// The most harmonics that a pattern states.
    pub(super) stated: Option<usize>,
    /// Sentences on what only the tables replace by Taylor polynomials.
    pub replaced: Vec<String>,
    /// The mechanism from which the equations were derived.
    pub(super) mechanism: Option<Mechanism>,
    /// Additional parts that were requested.
    pub(super) parts: Parts,
    /// The equations as they were declared, without patterns, where the estimator of a run was requested.
    pub(super) run: Option<Box<EstimatorSource>>,
    /// The columns and their derivatives by the physical parameters, in declared equations whose columns are products and sums of these.
    pub(super) slopes: Option<Plan>,
    /// The coordinates that are eliminated, from the motion of the others, where a campaign was requested.
    pub(super) campaign: Option<Vec<(Coordinate, Plan)>>,
    /// Whether the functions of the dynamics have the values of the parameters in them.
    pub(super) specialised: bool,
    /// The entries of the equations as text.
    pub(super) formulas: Formulas,
    /// What is said of rounding, by the names of functions; that of the file has an empty one. Nothing where no ranges are stated.
    pub(super) rounding: BTreeMap<&'static str, String>,
}

/// Why no source code can be made of a model.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum EmitError {
    /// A coordinate cannot be eliminated, or the model is not linear in its parameters.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// No sensor measures a coordinate, and what is generated takes the motion of all of them.
    #[error(
        "`{0}` is unmeasured, and generated code takes the motion of every coordinate; identify the parameters from a log, or declare it as `coordinate`"
    )]
    Unmeasured(String),
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
    /// A structure would have no member, which C does not allow.
    #[error("the model has {0}, and C has no structure without members")]
    Empty(&'static str),
    /// Identified values are of another model, or incomplete.
    #[error("{0}")]
    Identified(#[from] IdentifiedError),
    /// The low passes of the feed-forward do not exist.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// A part that was asked for does not follow from the equations.
    #[error(transparent)]
    Part(#[from] PartError),
    /// Code cannot be made for one machine.
    #[error(transparent)]
    Specialise(#[from] SpecialiseError),
    /// Ranges from which no bounds of rounding follow.
    #[cfg(feature = "generate")]
    #[error(transparent)]
    Range(#[from] super::rounding::ranges::RangeError),
    /// The text could not be laid out.
    #[error("the emitted code is not Rust as the formatter knows it: {0}")]
    Layout(String),
}

/// A coordinate that no sensor measures, where it is declared.
fn unmeasured(model: &ModelDeclaration) -> Option<&Ident> {
    let declarations = model.items.iter().filter_map(|item| match item {
        Item::Declaration(own) if own.unmeasured => own.quantities.first(),
        _ => None,
    });
    declarations.map(|quantity| &quantity.name).next()
}

impl EstimatorSource {
    /// Checks that low passes exist, and that there is a feed-forward for them to pass.
    ///
    /// # Errors
    /// [`FilterError`].
    pub fn check_filters(&self, filters: &Filters) -> Result<(), FilterError> {
        filters.check()?;
        match self.plan.feed_forward_parts {
            Some(_) => Ok(()),
            None => Err(FilterError::NoParts),
        }
    }

    /// Checks that a pattern has strokes.
    ///
    /// # Errors
    /// [`PartError::NoStrokes`].
    pub fn check_strokes(&self) -> Result<(), PartError> {
        let moves = self.plan.patterns.iter().any(|pattern| pattern.reference.is_ok());
        if moves { Ok(()) } else { Err(PartError::NoStrokes) }
    }

    /// Checks that there is something to forget: accumulators of harmonics, or the estimator of base parameters.
    ///
    /// # Errors
    /// [`PartError::NothingForgets`].
    pub fn check_forgetting(&self) -> Result<(), PartError> {
        let forgets = self.parts.estimator || self.tables().next().is_some();
        if forgets { Ok(()) } else { Err(PartError::NothingForgets) }
    }

    /// All plans of a model.
    ///
    /// # Errors
    /// When a coordinate cannot be eliminated, the model is not linear in its parameters, or it holds a number beyond double precision.
    pub fn new(model: ExactModel) -> Result<Self, EmitError> {
        let prepared = prepare(model)?;
        Self::from_form(prepared.model, prepared.form)
    }

    /// All plans of a model in the language, with its declared Taylor orders and numbers of harmonics. These apply to
    /// the tables; the dynamics stay exact.
    ///
    /// # Errors
    /// When a coordinate is not measured or cannot be eliminated, the model is not linear in its parameters, an input does not stand alone, a
    /// number is beyond double precision, or a declared Taylor polynomial does not exist; the place in the text is named.
    pub fn of(parsed: &Parsed) -> Result<Self, Diagnostic> {
        if let Some(name) = unmeasured(&parsed.ast) {
            return Err(Diagnostic::error(name.span, EmitError::Unmeasured(name.name.to_string()).to_string()));
        }
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
        let (model, form) = match &parsed.mechanism {
            Some(_) => as_written(model, form),
            None => (model, form),
        };
        let plan = EstimatorPlan::with_tables(&model, &form, tables);
        let stated = (0..model.patterns.len()).filter_map(|index| parsed.harmonics_of(index)).max();
        let assembled = Self::assembled(model, form, plan, replaced, parsed.mechanism.clone());
        Self { stated, ..assembled }
            .in_range()
            .map_err(|error| Diagnostic::error(parsed.ast.name.span, error.to_string()))
    }

    /// Plans of a model whose inputs stand in functions: its rows without them, and a feed-forward that solves for them.
    ///
    /// # Errors
    /// As of [`Self::of`], and where an input cannot be solved for; the place in the text is named.
    pub fn of_inputs_in_functions(parsed: &Parsed) -> Result<Self, Diagnostic> {
        let Prepared { model, form, .. } = prepare_any(parsed.model.clone()).map_err(|error| parsed.locate(&error))?;
        let (form, solved) = solved(&model, &form).map_err(|error| parsed.locate(&error))?;
        let plan = EstimatorPlan::with_solved(&model, &form, solved);
        Self::assembled(model, form, plan, Vec::new(), None)
            .in_range()
            .map_err(|error| Diagnostic::error(parsed.ast.name.span, error.to_string()))
    }

    /// All plans of a model whose regressor form was computed elsewhere.
    ///
    /// # Errors
    /// When a number is beyond double precision.
    pub fn from_form(model: ExactModel, form: RegressorForm) -> Result<Self, EmitError> {
        let plan = EstimatorPlan::new(&model, &form);
        Self::assembled(model, form, plan, Vec::new(), None).in_range()
    }

    fn assembled(
        model: ExactModel,
        form: RegressorForm,
        mut plan: EstimatorPlan,
        replaced: Vec<String>,
        mechanism: Option<Mechanism>,
    ) -> Self {
        if let Some(mechanism) = &mechanism {
            plan = plan.with_recursion(&model, &form, mechanism);
        }
        let formulas = Formulas::new(&model, &form, &plan.evaluation.inputs, mechanism.as_ref());
        Self {
            model,
            form,
            plan,
            stated: None,
            replaced,
            mechanism,
            parts: Parts::default(),
            run: None,
            slopes: None,
            campaign: None,
            specialised: false,
            formulas,
            rounding: BTreeMap::new(),
        }
    }

    /// This source with the values of the parameters in inverse dynamics, feed-forward, gravity, mass matrix and forward dynamics, which then
    /// do not read theirs. Regressors and estimators stay as they are.
    ///
    /// # Errors
    /// [`SpecialiseError`], values of another model or incomplete ones, and numbers beyond double precision.
    pub fn specialised(&self, identified: Option<&Identified>) -> Result<Self, EmitError> {
        let identified = identified.ok_or(SpecialiseError::NoValues)?;
        if self.campaign.is_some() {
            return Err(SpecialiseError::Campaign.into());
        }
        let mut values = Vec::with_capacity(self.form.columns.len());
        for settled in identified.in_order(&self.model, &self.form)? {
            let beyond = || EmitError::OutOfRange(format!("{} of `{}`", settled.value, settled.parameter.name));
            // The decimal digits that are printed for the value elsewhere.
            values.push(rational::parse(&settled.value.to_string()).ok_or_else(beyond)?);
        }
        let mut own = self.clone();
        let (plan, parts) = (&mut own.plan, &mut own.parts);
        let accelerations = parts.forward_dynamics.iter_mut().map(|dynamics| &mut dynamics.plan);
        for plan in [&mut plan.inverse_dynamics]
            .into_iter()
            .chain(&mut plan.feed_forward)
            .chain(plan.feed_forward_parts.iter_mut().flatten())
            .chain(&mut parts.gravity)
            .chain(&mut parts.mass_matrix)
            .chain(accelerations)
        {
            *plan = specialised(plan, &values);
        }
        own.specialised = true;
        own.in_range()
    }

    fn in_range(self) -> Result<Self, EmitError> {
        let lost = self.numbers().find(|value| Rounded::new(value).is_lost(value)).map(rational::display);
        match lost {
            Some(lost) => Err(EmitError::OutOfRange(shortened(&lost))),
            None => Ok(self),
        }
    }

    /// This source with additional parts.
    ///
    /// # Errors
    /// [`EmitError::Part`] when the equations would have too many terms, the accelerations do not follow from them, or they have no base
    /// parameters.
    pub fn with(mut self, parts: &[Part]) -> Result<Self, EmitError> {
        if let (Some(part), Some(own)) = (parts.first(), self.plan.solved.first()) {
            let input = self.model.quantity(own.input).name.to_string();
            return Err(PartError::InputInFunction { part: part.name(), input }.into());
        }
        for part in parts {
            match part {
                Part::Run => self.run = Some(Box::new(self.declared()?)),
                Part::Linearised | Part::Numerical => {
                    self.run = Some(Box::new(self.declared()?));
                    self.parts.linearised |= *part == Part::Linearised;
                    self.parts.numerical |= *part == Part::Numerical;
                }
                Part::Campaign => {
                    let declared = self.declared()?;
                    self.campaign = Some(self.reconstructions(&declared)?);
                    self.run = Some(Box::new(declared));
                }
                Part::Split => self.plan.part_feed_forward(&self.model, &self.form).map_err(PartError::from)?,
                part => self.parts.add(*part, &self.model, &self.form, &self.plan, self.mechanism.as_ref())?,
            }
        }
        self.in_range()
    }

    /// The equations as they were declared, no coordinate eliminated, without patterns: they are linear in the declared parameters.
    fn declared(&self) -> Result<Self, EmitError> {
        let mut model = self.model.clone();
        model.patterns.clear();
        if let Some(stated) = self.stated.filter(|stated| *stated > RUN_HARMONICS[1]) {
            return Err(PartError::Harmonics { stated, most: RUN_HARMONICS[1] }.into());
        }
        let mut declared = match model.eliminations.is_empty() {
            true => Self::from_form(model, self.form.clone())?,
            false => {
                model.eliminations.clear();
                Self::new(model)?
            }
        };
        if declared.form.columns.is_empty() {
            return Err(PartError::NoRun(
                "the equations have no parameter to be estimated; declare with `parameter` what is to be identified"
                    .to_owned(),
            )
            .into());
        }
        declared.slopes = lumping_slopes(&declared.model, &declared.form);
        declared.in_range()
    }

    /// The coordinates that are eliminated, from the motion of the others, for a campaign over the declared equations.
    fn reconstructions(&self, declared: &Self) -> Result<Vec<(Coordinate, Plan)>, EmitError> {
        let none = |why: String| Err(EmitError::from(PartError::NoCampaign(why)));
        if self.plan.feed_forward.is_none() {
            return none(
                "an input does not follow from one equation, so that there is no feed-forward; write equations that each have one input, or \
                 ask for the part `run`, and plan motion and feed-forward yourself"
                    .to_owned(),
            );
        }
        match self.plan.patterns.first() {
            None => return none("the model has no pattern; declare one".to_owned()),
            Some(pattern) => {
                if let Err(gap) = &pattern.reference {
                    return none(format!(
                        "there is no reference motion: {}; state it in the pattern, or ask for the part `run`, and plan the motion yourself",
                        reason(gap)
                    ));
                }
            }
        }
        if self.model.eliminations.is_empty() {
            return Ok(Vec::new());
        }
        if declared.plan.lumping.is_some() {
            let columns = declared.form.columns.iter().filter(|column| column.parameter.is_none());
            let products = columns.map(|column| format!("`{}`", canonical(&declared.model, &column.definition)));
            return none(format!(
                "{} is estimated as one number, from which the eliminated coordinates do not follow; declare it as one parameter, or ask for \
                 the part `run`, and plan the motion yourself",
                products.collect::<Vec<String>>().join(", ")
            ));
        }
        let prepared = prepare(self.model.clone())?;
        let plan = |one: &Reconstruction| (one.coordinate, Plan::new(&prepared.model.graph, &[one.expr]));
        Ok(prepared.reconstructions.iter().map(plan).collect())
    }

    /// Sentences on the parts of the patterns that this code lacks, and the reasons.
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
            .chain(&plan.feed_forward)
            .chain(plan.feed_forward_parts.iter().flatten())
            .chain(&plan.lumping)
            .chain(&self.slopes)
            .chain(plan.unlumping.iter().flatten().map(|unlumping| &unlumping.plan))
            .chain(references)
            .chain(tables)
            .chain(self.parts.plans())
    }

    pub(super) fn numbers(&self) -> impl Iterator<Item = &Rational> {
        self.plans().flat_map(|plan| &plan.ops).filter_map(|op| match op {
            Op::Constant(value) => Some(value),
            _ => None,
        })
    }

    /// Whether the code calls a function.
    pub(super) fn calls(&self, wanted: Function) -> bool {
        let mut ops = self.plans().flat_map(|plan| &plan.ops);
        ops.any(|op| matches!(op, Op::Function(function, _) if *function == wanted))
            || self.run.as_ref().is_some_and(|run| run.calls(wanted))
    }

    /// Whether a literal of the code would look like a mistyped irrational constant.
    pub(super) fn resembles_constant(&self) -> bool {
        self.numbers().any(|value| resembles_constant(rational::to_f64(value)))
            || self.run.as_ref().is_some_and(|run| run.resembles_constant())
    }
}

/// A model and its form with the equations as they were written, where this leaves the columns unchanged. The rows of a
/// mechanism are shorter in recursive form than multiplied out, whatever the number of joints.
fn as_written(model: ExactModel, form: RegressorForm) -> (ExactModel, RegressorForm) {
    if !form.is_expanded(&model.graph) || !model.eliminations.is_empty() {
        return (model, form);
    }
    let mut written = model.clone();
    match structured_form_with(&mut written, &form.columns) {
        Ok(structured) if structured.columns == form.columns && structured.is_whole() => (written, structured),
        _ => (model, form),
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

/// Sentences on what is left out for a pattern, and the reasons.
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

/// The first and last digits of a very long number.
fn shortened(digits: &str) -> String {
    match (digits.get(..20), digits.get(digits.len().saturating_sub(10)..)) {
        (Some(first), Some(last)) if digits.len() > 40 => format!("{first}...{last}"),
        _ => digits.to_owned(),
    }
}
