//! What a caller may decide about an estimate.

use serde::{Deserialize, Serialize};

/// A parameter that is held at a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frozen {
    /// Index of the parameter.
    pub parameter: usize,
    /// Its value, in the model's unit.
    pub value: f64,
}

/// How much every equation counts in a measured-motion estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Weights {
    /// By its noise and the model's own error: the smallest deviations.
    #[default]
    Noise,
    /// Alike, rows by the size of their force: the model whose force is nearest to the machine's over the period, whatever the
    /// noise. For models that leave something out, such as a series cut off: their parameters move with the weights.
    Equal,
}

/// In which form the samples of a log become equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
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
    /// Whether it is left to the estimation.
    // What serde calls takes a reference.
    #[allow(clippy::trivially_copy_pass_by_ref)]
    #[must_use]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// How `numerical` uses its matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct NumericalSettings {
    /// Entries that are zero in the exact table are cleared.
    pub cleared: bool,
    /// As many equations as parameters are used, those that determine them best (Feng, Eqn 3.29).
    pub reduced: bool,
    /// After the first matrix every run is an update, and the matrix is corrected by what the last update did.
    pub secant: bool,
}

/// What the caller may decide about an estimate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// Highest harmonic that may be used; chosen from the record when not given.
    pub harmonics: Option<usize>,
    /// Points of a period at which the rows are evaluated; doubled until converged when not given.
    pub grid: Option<usize>,
    /// Values that unobservable directions keep, one per parameter; zeros when empty.
    pub prior: Vec<f64>,
    /// Parameters that are held.
    pub frozen: Vec<Frozen>,
    /// Harmonics up to this one are those of the experiment: an input that is known to be small there says as much as a
    /// large one. Beyond, and by default, what is not excited counts as distortion.
    pub reach: usize,
    /// Directions that the experiments cannot show, known beforehand: the estimate keeps its prior along them although
    /// noise and errors of the tracking seem to show them.
    pub hidden: Vec<Vec<f64>>,
    /// Inputs whose delays are found with the parameters, by estimators of a log.
    pub fitted_delays: Vec<usize>,
    /// Parameters whose forces are the load of the drives, as inertias are: friction in proportion to the load can be told as a part of the model
    /// when they are known.
    pub load: Vec<usize>,
    /// How much every equation counts in `measured-motion`.
    pub weights: Weights,
    /// How `numerical` uses its matrix.
    pub numerical: NumericalSettings,
    /// Factor on the weight of all earlier runs when a run is taken in, for parameters that drift; one, or zero, forgets nothing.
    pub forgetting: f64,
}

impl Settings {
    /// Whether earlier runs lose weight, so that parameters that drift are followed.
    pub fn forgets(&self) -> bool {
        self.forgetting > 0.0 && self.forgetting < 1.0
    }

    /// How many of so many earlier runs still count: those whose weight is above rounding.
    pub(super) fn kept(&self, runs: usize) -> usize {
        (0..runs).take_while(|age| self.memory(age + 1) > f64::EPSILON).count()
    }

    /// Share of its weight that a run has after `age` later ones.
    pub(super) fn memory(&self, age: usize) -> f64 {
        if self.forgets() { self.forgetting.powi(age as i32) } else { 1.0 }
    }
}
