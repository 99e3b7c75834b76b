//! Settings of a user for the columns of a log.

use std::collections::BTreeMap;

/// Fewest samples of a log.
pub(super) const LEAST_SAMPLES: usize = 16;
/// Name of the time in settings, and of the column of time in the plainest files.
pub(super) const TIME: &str = "t_s";

/// Name of a signal's rate, written as in models.
pub(super) fn rate_of(signal: &str) -> String {
    format!("dot({signal})")
}

/// How the columns of a log become the signals of a model.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct ReadingSettings {
    /// Column of a coordinate or input (or of `t_s`) whose column has another name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub map: BTreeMap<String, String>,
    /// Factor from the numbers of a column (or of the stamps, `t_s`) to the model's unit. It replaces a unit that the
    /// header states.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub scale: BTreeMap<String, f64>,
    /// Offset that is added after the factor, in the model's unit: `signal = scale * column + offset`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub offset: BTreeMap<String, f64>,
    /// Time from row to row, s, of a log that has no column of time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample_time: Option<f64>,
    /// Whether rows stand for themselves, as for a model without derivatives: a log without a column of time is read all the same, and no
    /// reading is judged by those of the rows about it.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub timeless: bool,
}
