//! What a user may say of a log.

use crate::estimate::{Frozen, Weights};
use crate::run::Dynamics;
use std::collections::BTreeMap;
use std::string::String;
use std::vec::Vec;
use tpm_core::harmonics::Hold;

/// Settings that a user may give for a log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogOptions {
    /// Column of a coordinate or input (or of `t_s`) whose column has another name.
    pub map: BTreeMap<String, String>,
    /// Factor from the numbers of a column (or of the stamps, `t_s`) to the model's unit. It stands in place of a unit that the
    /// header states.
    pub scale: BTreeMap<String, f64>,
    /// Offset that is added after the factor, in the model's unit: `signal = scale * column + offset`.
    pub offset: BTreeMap<String, f64>,
    /// First sample to use (from 0); found when not given.
    pub from_sample: Option<usize>,
    /// Period in seconds; found when not given.
    pub period: Option<f64>,
    /// What happens to the inputs between samples.
    pub hold: Hold,
    /// Known dynamics between the recorded inputs and the forces, by input; inputs past the end of the list have none.
    pub actuators: Vec<Dynamics>,
    /// Whether harmonics or the time domain; harmonics of a log that repeats, when not given.
    pub domain: Option<Domain>,
    /// Highest harmonic; chosen from the spectrum when not given.
    pub harmonics: Option<usize>,
    /// Weights of the equations.
    pub weights: Weights,
    /// Whether the estimates are refined by simulating the model.
    pub refine: Refine,
    /// Values of the model's run-time constants, in its order.
    pub constants: Vec<f64>,
    /// Prior values of the parameters, in the model's order, nothing where none is stated; may be empty.
    pub prior: Vec<Option<f64>>,
    /// Parameters that are held at a value.
    pub frozen: Vec<Frozen>,
    /// Directions in parameter space that no motion shows, known beforehand; noise seems to show them.
    pub hidden: Vec<Vec<f64>>,
}

/// In which form the samples of a log become equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Domain {
    /// By the harmonics of the part that repeats.
    Harmonics,
    /// Sample by sample behind a low pass.
    Time,
}

/// Whether estimates are refined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Refine {
    /// By output error, where the model can be simulated and that takes no long time.
    #[default]
    Auto,
    /// By output error, where the model can be simulated, however long it takes.
    OutputError,
    /// Not at all.
    None,
}

impl Refine {
    // What serde calls takes a reference.
    #[allow(clippy::trivially_copy_pass_by_ref)]
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}
