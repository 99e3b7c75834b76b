//! The native part of the Python module `tpm`: sessions of `tpm-runtime` over arrays.
//!
//! Nothing is decided here. Arrays become columns of a log, keyword arguments the settings of a request, results JSON and arrays, and faults
//! exceptions whose remedies are spelled as keyword arguments. What users see, with its signatures and its documentation, is the package in
//! `python/tpm`.

mod arrays;
mod campaign;
mod log;
mod model;
mod result;
mod table;
mod tools;
mod verdicts;
mod words;
mod work;

use pyo3::prelude::*;
// The same numbers on every platform.
use tpm_elementary as _;

/// The native part of `tpm`.
#[pymodule]
mod _tpm {
    #[pymodule_export]
    use crate::campaign::{Campaign, Run, Submission};
    #[pymodule_export]
    use crate::model::Model;
    #[pymodule_export]
    use crate::result::Found;
    #[pymodule_export]
    use crate::table::{Entry, Table};
    #[pymodule_export]
    use crate::tools::{import_description_of, inertias, payload, proposals};
    #[pymodule_export]
    use crate::verdicts::{compare, described, inspect, validate};
    #[pymodule_export]
    use crate::words::Error;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
