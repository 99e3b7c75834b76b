//! Source files for a build script: the result of [`generate`], written into the folder that cargo sets aside.
//!
//! ```no_run
//! // build.rs, with `tpm-codegen` under [build-dependencies]
//! use tpm_codegen::build::{self, BuildError};
//! use tpm_codegen::generate::Language;
//!
//! fn main() -> Result<(), BuildError> {
//!     build::model("models/slider.tpm", Language::Rust).map(drop)
//! }
//! ```
//!
//! The crate then has the module of the model, over `core` and the crate `libm` alone:
//!
//! ```text
//! include!(concat!(env!("OUT_DIR"), "/slider.rs"));
//! ```
//!
//! With [`Language::C`] a header and a source go to the same folder, for the crate `cc` to compile.

use crate::diagnostic::Diagnostics;
use crate::emit::estimator::{EmitError, EstimatorSource};
use crate::emit::rust;
use crate::generate::{File, Language, Options, generate};
use crate::language::parse_model;
use crate::source::Source;
use std::fmt;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a build script got no source.
#[derive(Error)]
#[non_exhaustive]
pub enum BuildError {
    /// There is no folder to write to.
    #[error("OUT_DIR is not set: call this from a build script that cargo runs, or `write` with a folder of your own")]
    NoFolder,
    /// The model could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Faults of the model, rendered with their places.
    #[error("{0}")]
    Model(String),
    /// The target language cannot express the model.
    #[error(transparent)]
    Emit(#[from] EmitError),
    /// A file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
}

/// The message itself: cargo shows the debug form of an error that a build script returns from `main`.
impl fmt::Debug for BuildError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Writes the source of a model file into `OUT_DIR`, tells cargo to run the build script again when the model changes,
/// and returns the paths of the written files.
///
/// # Errors
/// [`BuildError`] when the model cannot be read or has faults, or a file cannot be written.
#[expect(clippy::print_stdout, reason = "build scripts speak to cargo through their output")]
pub fn model(path: impl AsRef<Path>, language: Language) -> Result<Vec<PathBuf>, BuildError> {
    let folder = std::env::var_os("OUT_DIR").ok_or(BuildError::NoFolder)?;
    println!("cargo::rerun-if-changed={}", path.as_ref().display());
    write(path.as_ref(), &Options::new(language, "tpm_codegen::build"), Path::new(&folder))
}

/// Writes the source of a model file, generated with these options, into an existing folder, and returns the paths of
/// the written files. A Rust file holds one module, so that `include!` accepts it.
///
/// # Errors
/// [`BuildError`] when the model cannot be read or has faults, or a file cannot be written.
pub fn write(path: &Path, options: &Options<'_>, folder: &Path) -> Result<Vec<PathBuf>, BuildError> {
    let bytes = std::fs::read(path).map_err(|source| BuildError::Read { path: path.to_owned(), source })?;
    let source = Source::from_bytes(path.display().to_string(), bytes);
    let faults = |diagnostics: &Diagnostics| BuildError::Model(diagnostics.render(&source));
    let parsed = parse_model(&source).map_err(|diagnostics| faults(&diagnostics))?;
    let estimator = EstimatorSource::of(&parsed).map_err(|diagnostic| faults(&Diagnostics::from_iter([diagnostic])))?;
    let mut files = generate(&estimator, options)?;
    if options.language == Language::Rust {
        // Inner attributes are allowed at the beginning of a module, but not at that of an included file.
        let module = rust::module_name(&estimator);
        files.iter_mut().for_each(|file| file.text = format!("pub mod {module} {{\n{}}}\n", file.text));
    }
    files.iter().map(|file| place(file, folder)).collect()
}

/// Writes a file under another name and renames it, so that no build reads an incomplete file.
fn place(file: &File, folder: &Path) -> Result<PathBuf, BuildError> {
    let (path, beside) = (folder.join(&file.name), folder.join(format!(".{}.new", file.name)));
    std::fs::write(&beside, &file.text)
        .and_then(|()| std::fs::rename(&beside, &path))
        .map_err(|source| BuildError::Write { path: path.clone(), source })?;
    Ok(path)
}
