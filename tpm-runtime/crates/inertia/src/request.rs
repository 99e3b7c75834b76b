//! What is asked of possible inertias.

use std::collections::BTreeMap;
use tpm_codegen::import::Described;
use tpm_session::{DeclaredModel, StoredResult};

/// What is asked for.
#[derive(Clone, Copy)]
pub struct InertiasRequest<'a> {
    /// The model of the arm, as its description was imported.
    pub model: &'a DeclaredModel,
    /// The result of its identification.
    pub result: &'a StoredResult,
    /// The description, read with the options of the import.
    pub described: &'a Described,
    /// Values of parameters that go before those of the description, by name.
    pub values: &'a BTreeMap<String, f64>,
    /// Weight of the description. One takes it for known within 100 %, so that it decides only what the data hardly show.
    pub weight: f64,
}
