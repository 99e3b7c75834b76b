//! Harmonic tables, with rational numbers as Python has them.

use crate::result::dictionary;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use tpm_codegen::emit::table;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::number::rational;

/// The exact harmonic coefficient table of a model under a pattern.
#[pyclass(frozen, module = "tpm")]
pub(crate) struct Table {
    pub(crate) table: HarmonicTable,
}

/// One coefficient of a table.
#[pyclass(frozen, get_all, module = "tpm")]
pub(crate) struct Entry {
    /// The equation in which it stands.
    equation: String,
    /// The harmonic.
    harmonic: usize,
    /// Cosine or sine of it.
    function: &'static str,
    /// The parameter that it belongs to; nothing for known terms.
    parameter: Option<String>,
    /// The exact coefficient, without powers.
    coefficient: Py<PyAny>,
    /// The power of pi.
    pi: i32,
    /// Powers of amplitudes, frequency and constants.
    powers: BTreeMap<String, i32>,
    /// What its sign depends on.
    sign: BTreeMap<String, i32>,
}

#[pymethods]
impl Entry {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let Entry { equation, harmonic, function, parameter, coefficient, powers, .. } = self;
        let parameter = parameter.as_deref().unwrap_or("known");
        let powers: Vec<String> = powers.iter().map(|(name, power)| format!("{name}^{power}")).collect();
        let coefficient = coefficient.bind(py).str()?;
        Ok(format!("<{equation}, harmonic {harmonic}, {function}, {parameter}: {coefficient} {}>", powers.join(" ")))
    }
}

#[pymethods]
impl Table {
    /// Name of the model.
    #[getter]
    fn model(&self) -> &str {
        &self.table.model
    }

    /// Names of its parameters.
    #[getter]
    fn parameters(&self) -> Vec<String> {
        self.table.parameters.iter().map(ToString::to_string).collect()
    }

    /// All entries, in the table's order, with exact coefficients.
    #[getter]
    fn entries(&self, py: Python<'_>) -> PyResult<Vec<Entry>> {
        let fraction = py.import("fractions")?.getattr("Fraction")?;
        let table = &self.table;
        let named = |factors: Vec<(usize, i32)>| {
            factors.into_iter().map(|(symbol, power)| (table.symbols[symbol].to_string(), power)).collect()
        };
        let entry = |entry: tpm_symbolic::harmonic::table::Entry| {
            Ok(Entry {
                equation: table.equations[entry.equation].to_string(),
                harmonic: entry.harmonic,
                function: entry.function.name(),
                parameter: entry.column.map(|column| table.parameters[column].to_string()),
                coefficient: fraction.call1((rational::display(&entry.coefficient),))?.unbind(),
                pi: entry.pi,
                powers: named(entry.powers.factors().map(|(&symbol, power)| (symbol, power)).collect()),
                sign: named(entry.sign.factors().map(|(&symbol, power)| (symbol, power)).collect()),
            })
        };
        table.entries().map(entry).collect()
    }

    /// What `tpm expand --format json` prints, as a dictionary.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dictionary(py, &self.table)
    }

    /// What `tpm expand --format json` prints.
    fn json(&self) -> PyResult<String> {
        crate::result::json(&self.table)
    }

    /// The table as CSV.
    fn csv(&self) -> String {
        table::csv(&self.table)
    }

    /// The table as Markdown; notebooks show it.
    fn markdown(&self) -> String {
        table::markdown(&self.table)
    }

    /// The table for LaTeX.
    fn latex(&self) -> String {
        table::latex(&self.table)
    }

    fn _repr_markdown_(&self) -> String {
        self.markdown()
    }

    fn __len__(&self) -> usize {
        self.table.entries().count()
    }

    fn __repr__(&self) -> String {
        format!("<tpm.Table of {}: {} entries>", self.table.model, self.__len__())
    }
}
