//! Keyword arguments as settings of the request of a log.

use crate::arrays::of_arrays;
use crate::words::Error;
use numpy::{AllowTypeChange, PyArrayLike1};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::collections::BTreeMap;
use std::path::PathBuf;
use tpm_runtime::estimate::Weights;
use tpm_runtime::estimate::{Domain, Refine};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::motion::LowPass;
use tpm_runtime::session::LogRequest;

/// Name of the time among the columns of a log.
pub(crate) const TIME: &str = "t_s";

/// Anything that numpy makes a vector of numbers of.
pub(crate) type Vector<'py> = PyArrayLike1<'py, f64, AllowTypeChange>;
/// Keyword arguments.
pub(crate) type Keywords<'a, 'py> = Option<&'a Bound<'py, PyDict>>;

/// A request with what keyword arguments say of the log's columns alone.
pub(crate) fn with_columns(mut request: LogRequest, settings: Keywords<'_, '_>) -> PyResult<LogRequest> {
    for (name, value) in given(settings)? {
        if !take_column(&mut request, &name, &value)? {
            return Err(unexpected(&name));
        }
    }
    Ok(request)
}

/// A log as it is given: a path, or stamps and signals.
pub(crate) fn log_of(log: &Bound<'_, PyAny>) -> PyResult<LogRequest> {
    match log.cast::<PyTuple>() {
        Ok(both) => of_arrays(&both.get_item(0)?, &both.get_item(1)?),
        Err(_) => Ok(LogRequest::new(log.extract::<PathBuf>()?)),
    }
}

/// A request with everything that keyword arguments say of a log, and of the machine that it is of;
/// and how much of the processor it may take, s.
pub(crate) fn with_settings(
    mut request: LogRequest,
    settings: Keywords<'_, '_>,
) -> PyResult<(LogRequest, Option<f64>)> {
    let mut time = None;
    for (name, value) in given(settings)? {
        let chosen = |known: &[&str]| -> PyResult<usize> {
            let word: String = value.extract()?;
            let found = known.iter().position(|one| *one == word);
            found.ok_or_else(|| Error::new_err(format!("{name}=\"{word}\": give one of {}", known.join(", "))))
        };
        match name.as_str() {
            "from_sample" => request.reading.from_sample = Some(value.extract()?),
            "period" => request.reading.period = Some(value.extract()?),
            "hold" => request.reading.hold = [Hold::None, Hold::Zoh][chosen(&["none", "zoh"])?],
            "delay" => {
                for (input, delay) in value.extract::<BTreeMap<String, Bound<'_, PyAny>>>()? {
                    if delay.extract::<String>().is_ok_and(|word| word == "fit") {
                        request.estimation.fitted_delays.insert(input);
                        continue;
                    }
                    let delay: f64 = delay.extract()?;
                    if !(delay.is_finite() && delay >= 0.0) {
                        let message = format!("delay={{\"{input}\": {delay}}}: the time must not be negative");
                        return Err(Error::new_err(message));
                    }
                    request.estimation.actuators.entry(input).or_default().delay = delay;
                }
            }
            "low_pass" => {
                for (input, (natural_frequency, quality)) in value.extract::<BTreeMap<String, (f64, f64)>>()? {
                    if ![natural_frequency, quality].iter().all(|number| number.is_finite() && *number > 0.0) {
                        return Err(Error::new_err(format!(
                            "low_pass={{\"{input}\": ...}}: natural frequency (rad/s) and quality are positive numbers"
                        )));
                    }
                    request.estimation.actuators.entry(input).or_default().filter =
                        Some(LowPass { natural_frequency, quality });
                }
            }
            "domain" => {
                request.estimation.domain = Some([Domain::Harmonics, Domain::Time][chosen(&["harmonics", "time"])?])
            }
            "harmonics" => request.estimation.harmonics = Some(value.extract()?),
            "weights" => request.estimation.weights = [Weights::Noise, Weights::Equal][chosen(&["noise", "equal"])?],
            "refine" => {
                request.estimation.refine =
                    [Refine::Auto, Refine::OutputError, Refine::None][chosen(&["auto", "output-error", "none"])?];
            }
            "constants" => request.estimation.constants = value.extract()?,
            "prior" => request.estimation.prior = value.extract()?,
            "freeze" => request.estimation.frozen = value.extract()?,
            "bounds" => request.estimation.bounds = value.extract()?,
            "calibration" => request.estimation.calibration = value.extract()?,
            "time" => time = Some(value.extract()?),
            _ if take_column(&mut request, &name, &value)? => {}
            _ => return Err(unexpected(&name)),
        }
    }
    Ok((request, time))
}

/// Takes in what is said of columns; whether the argument is about them.
fn take_column(request: &mut LogRequest, name: &str, value: &Bound<'_, PyAny>) -> PyResult<bool> {
    match name {
        "map" => request.reading.columns.map = value.extract()?,
        "scale" => request.reading.columns.scale = value.extract()?,
        "sample_time" => request.reading.columns.sample_time = Some(value.extract()?),
        "offset" => request.reading.columns.offset = value.extract()?,
        _ => return Ok(false),
    }
    Ok(true)
}

/// The arguments that were given, by name; `None` is as good as nothing.
fn given<'py>(settings: Keywords<'_, 'py>) -> PyResult<Vec<(String, Bound<'py, PyAny>)>> {
    let all = settings.into_iter().flat_map(|settings| settings.iter());
    all.filter(|(_, value)| !value.is_none()).map(|(name, value)| Ok((name.extract()?, value))).collect()
}

fn unexpected(name: &str) -> PyErr {
    PyTypeError::new_err(format!("unexpected keyword argument '{name}'"))
}
