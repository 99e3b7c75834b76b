//! The Python module `tpm`: sessions of `tpm-runtime` over arrays.
//!
//! Nothing is decided here. Arrays become columns of a log, keyword arguments the settings of a request, results arrays, and faults
//! exceptions whose remedies are spelled as keyword arguments.

mod arrays;
mod campaign;
mod log;
mod model;
mod result;
mod table;
mod verdicts;
mod words;
mod work;

use pyo3::prelude::*;
// The same numbers on every platform.
use tpm_elementary as _;

/// Identifies the parameters of non-linear machines by the Trajectory Pattern Method.
#[pymodule]
mod tpm {
    #[pymodule_export]
    use crate::campaign::{Campaign, Run, Submission};
    #[pymodule_export]
    use crate::model::{Model, identify};
    #[pymodule_export]
    use crate::result::Identification;
    #[pymodule_export]
    use crate::table::{Entry, Table};
    #[pymodule_export]
    use crate::verdicts::{compare, inspect_log, validate, validate_log};
    #[pymodule_export]
    use crate::words::Error;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
