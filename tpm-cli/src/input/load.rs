//! Reading of model files, with every fault rendered at its place in the text.

use crate::failure::Failure;
use crate::output::file;
use std::path::Path;
use tpm_codegen::diagnostic::{self, Diagnostic};
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::language::AtTerm;
use tpm_codegen::source::Source;
use tpm_codegen::{Parsed, parse_model};
use tpm_runtime::report::{MOST_TEXT, read_input};
use tpm_runtime::session::other_kind;
use tpm_runtime::study::ShownError;
use tpm_symbolic::linear::taylor::Truncation;
use tpm_symbolic::mechanics::derived::Derived;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::plan::split::SplitError;
use tpm_symbolic::regressor::prepare::{Prepared, prepare, prepare_any};

/// A parsed model with the text it came from, so that later stages can still point at places.
pub(crate) struct Loaded {
    source: Source,
    parsed: Parsed,
}

impl Loaded {
    /// Reads and parses a model file. Warnings go to standard error.
    pub(crate) fn from_file(path: &Path) -> Result<Self, Failure> {
        let bytes = read_input(path, MOST_TEXT).map_err(|error| Failure::read(path, error))?;
        let source = Source::from_bytes(path.display().to_string(), bytes);
        match parse_model(&source) {
            Ok(parsed) => {
                if !parsed.warnings.is_empty() {
                    file::remark(parsed.warnings.render(&source).trim_end());
                }
                Ok(Self { source, parsed })
            }
            Err(diagnostics) => Err(Failure::Model(other_kind(&source).unwrap_or_else(|| diagnostics.render(&source)))),
        }
    }

    /// The model.
    pub(crate) fn model(&self) -> &ExactModel {
        &self.parsed.model
    }

    /// The model with its coordinates eliminated, in the form that is linear in its parameters; its inputs may stand anywhere.
    pub(crate) fn prepared(&self) -> Result<Prepared, Failure> {
        prepare_any(self.model().clone()).map_err(|error| self.at(&error))
    }

    /// The model prepared for tables that are read: with the declared Taylor polynomials in place, and constants in
    /// place of functions of constants. Remarks on standard error name the replaced terms.
    pub(crate) fn for_tables(&self) -> Result<(Prepared, Vec<Derived>), Failure> {
        let (model, truncations, constants) = self.parsed.for_read_tables().map_err(|error| self.at(&error))?;
        Self::remark_replaced(&model, &truncations);
        Ok((prepare(model).map_err(|error| self.at(&error))?, constants))
    }

    /// The model with the declared Taylor polynomials in place. Remarks on standard error name the replaced terms.
    pub(crate) fn model_for_tables(&self) -> Result<ExactModel, Failure> {
        let (model, truncations) = self.parsed.for_tables().map_err(|error| self.at(&error))?;
        Self::remark_replaced(&model, &truncations);
        Ok(model.into_owned())
    }

    fn remark_replaced(model: &ExactModel, truncations: &[Truncation]) {
        for replaced in Parsed::replacements(model, truncations) {
            file::remark(&format!("remark: {replaced}"));
        }
    }

    /// The declared number of harmonics of terms with infinitely many harmonics, under a pattern.
    pub(crate) fn harmonics(&self, pattern: &Pattern) -> Option<usize> {
        self.parsed.declared_harmonics(pattern)
    }

    /// The estimator from which source code is generated.
    pub(crate) fn estimator(&self) -> Result<EstimatorSource, Failure> {
        let in_functions = self.prepared().is_ok_and(|own| own.form.driven(&own.model).is_some());
        let source = if in_functions {
            EstimatorSource::of_inputs_in_functions(&self.parsed)
        } else {
            EstimatorSource::of(&self.parsed)
        };
        source.map_err(|diagnostic| Failure::Model(self.rendered(&diagnostic)))
    }

    /// What the parser found.
    pub(crate) fn parsed(&self) -> &Parsed {
        &self.parsed
    }

    /// Why nothing can be said of what the model shows.
    pub(crate) fn at_shown(&self, error: ShownError) -> Failure {
        match error {
            ShownError::Model(diagnostic) => Failure::Model(self.rendered(&diagnostic)),
            other => Failure::Input(other.to_string()),
        }
    }

    /// A fault of the model as a whole, placed at the model's name.
    pub(crate) fn at_whole(&self, message: &str) -> Failure {
        Failure::Model(self.rendered(&Diagnostic::error(self.parsed.ast.name.span, message)))
    }

    /// An error of a later stage, placed at its term in the text.
    pub(crate) fn at(&self, error: &impl AtTerm) -> Failure {
        Failure::Model(self.rendered(&self.parsed.locate(error)))
    }

    /// An error of a later stage, placed at its term in the text, with what to do about it.
    pub(crate) fn at_with_help(&self, error: &impl AtTerm, help: &str) -> Failure {
        Failure::Model(self.rendered(&self.parsed.locate(error).help(help)))
    }

    /// A fault of splitting the inputs, at its place in the text, with the flag that would help.
    pub(crate) fn at_split(&self, error: &SplitError) -> Failure {
        match error {
            SplitError::Motion { input } => self.at_with_help(error, &format!("--motion {input}=COORDINATE")),
            _ => self.at(error),
        }
    }

    /// A remark on an error that prevents one use of the model but is no fault of it, placed at its term in the text.
    pub(crate) fn remark(&self, error: &impl AtTerm) -> String {
        let mut diagnostic = self.parsed.locate(error);
        diagnostic.severity = diagnostic::Severity::Warning;
        self.rendered(&diagnostic)
    }

    fn rendered(&self, diagnostic: &Diagnostic) -> String {
        diagnostic::render(&self.source, diagnostic)
    }

    /// The chosen pattern, the first when no name is given.
    pub(crate) fn pattern(&self, name: Option<&str>) -> Result<&Pattern, Failure> {
        self.parsed.pattern(name, "leave out --pattern").map_err(|fault| Failure::Model(self.rendered(&fault)))
    }
}
