//! `tpm generate` as a function: a model's source files in a target language.
//!
//! Invariant: equal models and options give equal bytes; nothing is written to disk here.

use crate::emit::estimator::{EmitError, Estimator, Identified};
use crate::emit::rust;

/// A target language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    /// A `no_std` Rust module over the crate `tpm-runtime`.
    Rust,
}

impl Language {
    /// The language of a name as the command line takes it.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "rust" => Some(Self::Rust),
            _ => None,
        }
    }
}

/// How source is generated.
#[derive(Clone, Debug)]
pub struct Options<'a> {
    /// The target language.
    pub language: Language,
    /// The command that gives this output again, for the header.
    pub command: &'a str,
    /// Identified values to be baked in.
    pub identified: Option<&'a Identified>,
}

/// A generated file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// Its name, without a folder.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// The source files of an estimator.
///
/// # Errors
/// When the identified values do not belong to the model.
pub fn generate(estimator: &Estimator, options: &Options<'_>) -> Result<Vec<File>, EmitError> {
    if let Some(identified) = options.identified {
        identified.in_order(estimator)?;
    }
    match options.language {
        Language::Rust => {
            let rust_options =
                rust::Options { command: options.command, identified: options.identified, ..rust::Options::default() };
            let text = rust::file(estimator, &rust_options).map_err(|error| EmitError::Layout(error.to_string()))?;
            Ok(vec![File { name: format!("{}.rs", rust::module_name(estimator).trim_start_matches("r#")), text }])
        }
    }
}
