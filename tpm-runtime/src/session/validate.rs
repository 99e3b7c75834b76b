//! Prediction of another log by identified parameters.
//!
//! Invariant: nothing is fitted. The rows are evaluated on the log's own measured motion with the given parameters. The
//! inputs that they predict are compared with the recorded inputs, harmonic by harmonic, over the harmonics that stand
//! out of the noise.

use crate::estimate::{MeasuredMotion, Settings};
use crate::log::{Log, LogError, LogOptions};
use crate::session::error::SessionError;
use crate::session::log::{LogRequest, periodic_spectra};
use crate::session::model::Identifiable;
use serde::Serialize;
use std::collections::BTreeMap;
use std::string::{String, ToString};
use std::vec::Vec;
use tpm_core::model::{Buffer, Model, require_len};

/// Prediction error of one row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RowPrediction {
    /// Name of the row.
    pub name: String,
    /// Unit of the row.
    pub unit: Option<String>,
    /// Root mean square of the applied force at the used harmonics; of the row's own terms where no force is applied.
    pub force: f64,
    /// Root mean square of the prediction error at the used harmonics.
    pub missed: f64,
    /// The prediction error as a share of `force`.
    pub share: f64,
}

/// How well parameters predict a log; serialises as `tpm.validation/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validation {
    /// `tpm.validation/1`.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// Name of the log.
    pub log: String,
    /// First sample that was used.
    pub from_sample: usize,
    /// Period, s.
    pub period: f64,
    /// Whole periods.
    pub periods: usize,
    /// Hold of the inputs: `none` or `zoh`.
    pub hold: String,
    /// Highest harmonic that was compared.
    pub harmonics: usize,
    /// Prediction errors of the rows.
    pub rows: Vec<RowPrediction>,
    /// Largest share of any row.
    pub prediction_error: f64,
}

/// Predicts the inputs of a log from its motion with given values of the parameters in which the model is linear, by name.
///
/// # Errors
/// [`SessionError::NotIdentified`] where a parameter has no value; another [`SessionError`] when the log cannot be read
/// or analysed.
pub fn validate(
    model: &impl Identifiable,
    log: impl Into<LogRequest>,
    values: &BTreeMap<String, f64>,
) -> Result<Validation, SessionError> {
    let request = log.into();
    let evaluated = model.evaluated();
    let value = |j: usize| {
        let name = evaluated.parameter(j).name;
        values.get(name).copied().ok_or_else(|| SessionError::NotIdentified { name: name.to_string() })
    };
    let parameters: Vec<f64> = (0..evaluated.dims().parameters).map(value).collect::<Result<_, _>>()?;
    let options = request.options(evaluated, &[])?;
    let log = Log::open(&request.path, evaluated, &options)?;
    Ok(validate_log(evaluated, &log, &options, &parameters)?)
}

/// Predicts the inputs of a log from its motion with given parameters, one value per parameter of the model.
///
/// # Errors
/// [`LogError`] when the log has no periodic part, or its harmonics cannot be computed.
pub fn validate_log(
    model: &dyn Model<f64>,
    log: &Log,
    options: &LogOptions,
    parameters: &[f64],
) -> Result<Validation, LogError> {
    let dims = model.dims();
    let fault = |source| LogError::Estimate { path: log.path.clone(), source };
    require_len(Buffer::Parameters, parameters.len(), dims.parameters).map_err(|error| fault(error.into()))?;
    let (periodic, spectra) = periodic_spectra(log, dims.coordinates, options)?;
    let settings = Settings { harmonics: options.harmonics, ..Settings::default() };
    let record = MeasuredMotion::new(model, &options.constants, &spectra, options.hold, &settings).map_err(fault)?;
    let row = |r: usize| {
        let (missed, force) = record.row_power(r, parameters);
        let label = model.row(r);
        let share = if force > 0.0 { missed / force } else { 0.0 };
        RowPrediction { name: label.name.into(), unit: label.unit.map(String::from), force, missed, share }
    };
    let rows: Vec<RowPrediction> = (0..dims.rows).map(row).collect();
    Ok(Validation {
        schema: "tpm.validation/1",
        model: model.name().into(),
        log: log.path.clone(),
        from_sample: periodic.from,
        period: periodic.samples_per_period * log.sample_time,
        periods: periodic.periods,
        hold: options.hold.to_string(),
        harmonics: record.harmonics(),
        prediction_error: rows.iter().map(|row| row.share).fold(0.0, f64::max),
        rows,
    })
}
