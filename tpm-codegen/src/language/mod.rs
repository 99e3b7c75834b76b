//! The model language: a text is split into tokens, parsed into declarations, checked, and lowered to the exact model.

pub mod ast;
mod check;
pub mod complete;
mod format;
pub mod function;
pub mod keywords;
mod lex;
mod lower;
pub mod outline;
mod parse;
mod print;
pub mod reference;
pub mod stream;
mod suggest;
mod token;
mod typeset;

pub use format::format;
pub use lower::{HIGHEST_ORDER, Taylor, Terms};
pub use parse::DEEPEST_NESTING;
pub use typeset::typeset;

use std::borrow::Cow;

use tpm_symbolic::expr::graph::ExprId;
use tpm_symbolic::harmonic::expand::ExpandError;
use tpm_symbolic::linear::taylor::{self, Expansion, SeriesError, Truncation};
use tpm_symbolic::mechanics::derived::{Derived, derive_constants};
use tpm_symbolic::mechanics::lagrange::LagrangeError;
use tpm_symbolic::mechanics::model::{ExactModel, TermId};
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::mechanics::tree::mechanism::Mechanism;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::split::SplitError;
use tpm_symbolic::regressor::form::RegressorError;
use tpm_symbolic::regressor::prepare::PrepareError;
use tpm_symbolic::regressor::solved::Unsolved;

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::stream::TokenSource;
use crate::source::{Source, Span};

/// Parses a source without checking its names, structure and units.
///
/// # Errors
/// Every fault of the text, in the order of their places.
pub fn parse(source: &Source) -> Result<ast::ModelDeclaration, Diagnostics> {
    let mut diagnostics = Diagnostics::new();
    let syntax = parse::parse(source, &mut diagnostics);
    diagnostics.sort();
    match syntax.model {
        Some(model) if !diagnostics.has_errors() => Ok(model),
        _ => Err(diagnostics),
    }
}

/// Where the last statement of a model ends: before the brace that closes it, whatever comments follow; at the end of the text where it has no
/// such brace.
#[must_use]
pub fn end_of_statements(source: &Source) -> usize {
    let tokens = lex::lex(source, &mut Diagnostics::new());
    let closing = tokens.iter().rfind(|token| token.kind == token::TokenKind::CloseBrace);
    closing.map_or(source.text().len(), |token| token.span.range().start)
}

/// A parsed and lowered model, with the places of its terms in the text.
#[derive(Clone, Debug)]
pub struct Parsed {
    /// The exact model.
    pub model: ExactModel,
    /// The model as it was written.
    pub ast: ast::ModelDeclaration,
    /// The mechanism from which the equations of motion were derived, with expressions in the model's graph; none for a
    /// model of equations or energies.
    pub mechanism: Option<Mechanism>,
    /// Declared Taylor orders, for tables.
    pub taylor: Vec<Taylor>,
    /// Warnings, in spite of which the model can be used.
    pub warnings: Diagnostics,
    /// Highest harmonic that each pattern of the model keeps of terms with infinitely many.
    harmonics: Vec<Option<u32>>,
    terms: Terms,
}

/// An error of a later stage that names the term of the text at fault.
pub trait AtTerm: std::error::Error {
    /// The term, when there is one.
    fn at_term(&self) -> Option<TermId>;
}

impl AtTerm for RegressorError {
    fn at_term(&self) -> Option<TermId> {
        self.term()
    }
}

impl AtTerm for Unsolved {
    fn at_term(&self) -> Option<TermId> {
        Some(self.term)
    }
}

impl AtTerm for PrepareError {
    fn at_term(&self) -> Option<TermId> {
        self.term()
    }
}

impl AtTerm for ExpandError {
    fn at_term(&self) -> Option<TermId> {
        Some(self.term())
    }
}

impl AtTerm for SeriesError {
    fn at_term(&self) -> Option<TermId> {
        match self {
            Self::Singular { term, .. } => *term,
            _ => None,
        }
    }
}

impl AtTerm for SplitError {
    fn at_term(&self) -> Option<TermId> {
        self.term()
    }
}

impl AtTerm for LagrangeError {
    fn at_term(&self) -> Option<TermId> {
        self.term()
    }
}

impl Parsed {
    /// The place of a source term.
    #[must_use]
    pub fn span(&self, term: TermId) -> Span {
        self.terms.span(term)
    }

    /// The model from which tables are made, and the terms that were replaced in it: a function that does not expand
    /// finitely in a coordinate with a declared Taylor order becomes its Taylor polynomial. Without a declared order
    /// this is the unchanged model.
    ///
    /// # Errors
    /// [`SeriesError`] when a function is singular at the declared point.
    pub fn for_tables(&self) -> Result<(Cow<'_, ExactModel>, Vec<Truncation>), SeriesError> {
        if self.taylor.is_empty() {
            return Ok((Cow::Borrowed(&self.model), Vec::new()));
        }
        let expansions: Vec<Expansion> = self
            .taylor
            .iter()
            .map(|taylor| Expansion { coordinate: taylor.coordinate, point: taylor.point, order: taylor.order })
            .collect();
        let mut model = self.model.clone();
        let truncations = taylor::truncate(&mut model, &expansions)?;
        Ok((Cow::Owned(model), truncations))
    }

    /// [`Self::for_tables`] with a new constant wherever an equation has a function of constants, or divides by a sum of
    /// them: the table then holds these constants, of which the definitions are told. It is for tables that are read;
    /// whoever gives its symbols values needs the values of these constants too.
    ///
    /// # Errors
    /// See [`Self::for_tables`].
    pub fn for_read_tables(&self) -> Result<(ExactModel, Vec<Truncation>, Vec<Derived>), SeriesError> {
        let (model, truncations) = self.for_tables()?;
        let mut model = model.into_owned();
        let constants = derive_constants(&mut model);
        Ok((model, truncations, constants))
    }

    /// Sentences on the replacements by [`Self::for_tables`], one for each function.
    #[must_use]
    pub fn replacements(model: &ExactModel, truncations: &[Truncation]) -> Vec<String> {
        let mut said: Vec<ExprId> = Vec::new();
        let mut sentences = Vec::new();
        for Truncation { series, .. } in truncations {
            if said.contains(&series.function) {
                continue;
            }
            said.push(series.function);
            let points = series.expansions.iter().map(|expansion| {
                let coordinate = &model.coordinates[expansion.coordinate.0 as usize].name;
                format!("of order {} in {coordinate} about {}", expansion.order, model.display(expansion.point))
            });
            let points = points.collect::<Vec<String>>().join(", ");
            let function = model.display_brief(series.function);
            sentences.push(format!("`{function}` is replaced by its Taylor polynomial {points}"));
        }
        sentences
    }

    /// Highest harmonic that the pattern of this index keeps of terms with infinitely many; `None` when it declares no
    /// number.
    #[must_use]
    pub fn harmonics_of(&self, pattern: usize) -> Option<usize> {
        self.harmonics.get(pattern).copied().flatten().and_then(|count| usize::try_from(count).ok())
    }

    /// Highest harmonic that a pattern of this model keeps of terms with infinitely many; `None` when it declares no
    /// number, and for a pattern of another model.
    #[must_use]
    pub fn declared_harmonics(&self, pattern: &Pattern) -> Option<usize> {
        self.harmonics_of(self.model.patterns.iter().position(|own| own == pattern)?)
    }

    /// The pattern of this name, or the model's first one when no name is given. `unnamed` is the help for a user who
    /// asks for the pattern of a model whose patterns have no names.
    ///
    /// # Errors
    /// A diagnostic at the model's name when there is no such pattern.
    pub fn pattern(&self, name: Option<&str>, unnamed: &str) -> Result<&Pattern, Diagnostic> {
        let model = &self.model;
        model.pattern(name).ok_or_else(|| {
            let (message, help) = match name {
                None => (
                    format!("model {} has no pattern", model.name),
                    "add `pattern { ... }` to it to expand it (logs need none)".to_owned(),
                ),
                Some(name) => {
                    let known: Vec<&str> =
                        model.patterns.iter().filter_map(|pattern| pattern.name.as_deref()).collect();
                    let help = match known.as_slice() {
                        [] => format!("its patterns have no names; {unnamed}"),
                        known => format!("it has {}", known.join(", ")),
                    };
                    (format!("model {} has no pattern named `{name}`", model.name), help)
                }
            };
            Diagnostic::error(self.ast.name.span, message).help(help)
        })
    }

    /// An error of a later stage at its place in the text: at its term, or at the model's name when it concerns the whole model.
    #[must_use]
    pub fn locate(&self, error: &impl AtTerm) -> Diagnostic {
        let span = error.at_term().map_or(self.ast.name.span, |term| self.span(term));
        Diagnostic::error(span, error.to_string())
    }
}

/// Reads a model: parses, checks and lowers it.
///
/// # Errors
/// Every fault of the text, of its names, its structure and its units, in the order of their places.
pub fn parse_model(source: &Source) -> Result<Parsed, Diagnostics> {
    let mut diagnostics = Diagnostics::new();
    let mut syntax = parse::parse(source, &mut diagnostics);
    let Some(ast) = syntax.model.take() else { return Err(sorted(diagnostics)) };
    let checked = check::check(&ast, &syntax, source, &mut diagnostics);
    if diagnostics.has_errors() {
        return Err(sorted(diagnostics));
    }
    let lowered = lower::lower(&ast, &checked, &mut diagnostics);
    if diagnostics.has_errors() {
        return Err(sorted(diagnostics));
    }
    let lower::Lowered { model, terms, taylor, harmonics, mechanism } = lowered;
    Ok(Parsed { model, ast, mechanism, taylor, harmonics, warnings: sorted(diagnostics), terms })
}

/// A number, or an expression of numbers and pi such as `2*pi/4096`, which is evaluated exactly as far as it is rational; nothing where the
/// text is neither, or its value is not finite.
#[must_use]
pub fn parse_factor(text: &str) -> Option<f64> {
    let number = text.trim().parse::<f64>().ok().or_else(|| {
        let mut numbers = ExactModel::default();
        let expression = parse_value(&Source::new("factor", text), &mut numbers).ok()?;
        let exact = numbers.graph.evaluate_exact(expression, |_| None);
        Some(exact.map_or_else(|| numbers.graph.evaluate(expression, |_| f64::NAN), |exact| rational::to_f64(&exact)))
    });
    number.filter(|number| number.is_finite())
}

/// Reads an expression of a model's parameters and constants, such as a value on a command line, into the model's graph.
///
/// # Errors
/// Every fault of the text, and every name that is neither a parameter nor a constant of the model.
pub fn parse_value(source: &Source, model: &mut ExactModel) -> Result<ExprId, Diagnostics> {
    let mut diagnostics = Diagnostics::new();
    let expr = parse::parse_expression(source, &mut diagnostics);
    let value = match expr {
        Some(expr) if !diagnostics.has_errors() => lower::lower_value(&expr, model, &mut diagnostics),
        _ => None,
    };
    match value {
        Some(value) if !diagnostics.has_errors() => Ok(value),
        _ => Err(sorted(diagnostics)),
    }
}

/// Reads a model from the tokens of a macro call, and keeps the relation between its text and the user's tokens.
///
/// # Errors
/// Every fault as a `compile_error!` on the tokens that caused it.
pub fn parse_tokens(
    name: &str,
    tokens: proc_macro2::TokenStream,
) -> Result<(Parsed, TokenSource), proc_macro2::TokenStream> {
    let tokens = TokenSource::new(name, tokens);
    match parse_model(tokens.source()) {
        Ok(parsed) => Ok((parsed, tokens)),
        Err(diagnostics) => Err(tokens.compile_errors(&diagnostics)),
    }
}

fn sorted(mut diagnostics: Diagnostics) -> Diagnostics {
    diagnostics.sort();
    diagnostics
}
