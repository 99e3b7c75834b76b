//! Stamps and signals as they come: arrays of numpy, series and frames of pandas and polars, mappings of these, times of every kind.
//!
//! Invariant: what becomes a number here is one in the unit that it is taken in. Times become seconds; anything else that is no number is
//! a TypeError, not a guess.

use crate::log::{TIME, Vector};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use tpm_runtime::log::Samples;
use tpm_runtime::session::LogRequest;

/// What messages call a log that came as arrays.
const ARRAYS: &str = "arrays";

/// The log of stamps and signals. They are copied once, since Python may change them while they are used.
pub(crate) fn of_arrays(t: &Bound<'_, PyAny>, signals: &Bound<'_, PyAny>) -> PyResult<LogRequest> {
    let mut columns = vec![(TIME.to_owned(), seconds(t)?)];
    let is_frame = signals.hasattr("columns")?;
    let names = if is_frame {
        signals.getattr("columns")?
    } else if signals.hasattr("keys")? {
        signals.call_method0("keys")?
    } else {
        let given = signals.get_type().name()?;
        return Err(PyTypeError::new_err(format!(
            "signals: give a mapping of names to vectors, or a frame, not {given}"
        )));
    };
    for key in names.try_iter()? {
        let key = key?;
        let name = if is_frame { key.str()?.to_string() } else { key.extract::<String>()? };
        // The stamps are `t`, also where a frame has them among its columns.
        if name == TIME {
            continue;
        }
        match numbers(&format!("signals[\"{name}\"]"), &signals.get_item(&key)?) {
            Ok(values) => columns.push((name, values)),
            // A frame may have columns of text that no model needs; one that is needed is missed by its name.
            Err(error) if is_frame && error.is_instance_of::<PyTypeError>(t.py()) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(LogRequest::of_samples(ARRAYS, Samples::new(columns)))
}

/// The kind of numpy's type: `f`, `i`, `u`, `b` are numbers, `M` and `m` instants and durations, `O` anything.
fn kind(array: &Bound<'_, PyAny>) -> PyResult<String> {
    array.getattr("dtype")?.getattr("kind")?.extract()
}

/// A vector of numbers.
fn numbers(what: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let array = given.py().import("numpy")?.call_method1("asarray", (given,))?;
    let kind = kind(&array)?;
    let said = match kind.as_str() {
        "f" | "i" | "u" | "b" | "O" => None,
        "M" | "m" => Some("times"),
        "c" => Some("complex numbers"),
        "U" | "S" | "T" => Some("texts"),
        _ => Some("no numbers"),
    };
    let dimensions: usize = array.getattr("ndim")?.extract()?;
    match said {
        Some(said) => Err(PyTypeError::new_err(format!("{what}: its values are {said}; give a vector of numbers"))),
        None if dimensions != 1 => {
            Err(PyTypeError::new_err(format!("{what}: it has {dimensions} dimensions; give a vector of numbers")))
        }
        None => {
            let found: PyResult<Vector<'_>> = array.extract();
            let found =
                found.map_err(|error| PyTypeError::new_err(format!("{what}: {error}; give a vector of numbers")))?;
            Ok(found.as_array().to_vec())
        }
    }
}

/// Stamps in seconds: numbers as they are, durations as they are long, instants from the first one on, since a double does not hold the
/// nanoseconds of an instant.
fn seconds(given: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let numpy = given.py().import("numpy")?;
    let mut array = numpy.call_method1("asarray", (given,))?;
    if kind(&array)? == "O" && numbers("t", &array).is_err() {
        // Instants with a zone are objects to numpy, and so are those of Python itself.
        let as_times = |unit: &str| numpy.call_method1("asarray", (given, unit));
        array = as_times("datetime64[ns]").or_else(|_| as_times("timedelta64[ns]")).map_err(|_| {
            PyTypeError::new_err("t: its values are neither numbers of seconds nor times (datetime64, timedelta64)")
        })?;
    }
    let second = || numpy.call_method1("timedelta64", (1, "s"));
    match kind(&array)?.as_str() {
        "M" => {
            let known = array.get_item(numpy.call_method1("isnat", (&array,))?.call_method0("__invert__")?)?;
            if known.len()? == 0 {
                return Err(PyTypeError::new_err("t: none of its values is a time"));
            }
            let elapsed = array.call_method1("__sub__", (known.get_item(0)?,))?;
            numbers("t", &elapsed.call_method1("__truediv__", (second()?,))?)
        }
        "m" => numbers("t", &array.call_method1("__truediv__", (second()?,))?),
        _ => numbers("t", &array),
    }
}
