//! The outcome of a comparison.

use serde::Serialize;
use tpm_numerics::alarm;

/// What one result says of a parameter or combination.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Side {
    /// Value; nothing when the result does not show it.
    pub value: Option<f64>,
    /// Standard deviation; nothing when the result does not show it or holds it at a bound.
    pub std: Option<f64>,
    /// What the result says of the parameter; nothing for a combination, and for a parameter that the result does not have.
    pub status: Option<String>,
}

/// A parameter, or a combination of parameters, in both results.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Name of the parameter, or the combination as a sum.
    pub name: String,
    /// Unit.
    pub unit: Option<String>,
    /// What the first result says.
    pub a: Side,
    /// What the second result says.
    pub b: Side,
    /// Second value less first; nothing where one result does not show it.
    pub difference: Option<f64>,
    /// Standard deviation of the difference of two independent results; nothing where one does not show it.
    pub std: Option<f64>,
    /// The difference in its deviations; nothing where it is not tested.
    pub z: Option<f64>,
    /// Two-sided p-value: how often chance alone makes a difference at least as large.
    pub p: Option<f64>,
    /// The p-value corrected by Holm's method for all tests of the comparison.
    pub p_adjusted: Option<f64>,
    /// Whether the corrected p-value is below [`Comparison::LEVEL`].
    pub changed: bool,
    /// Why it is not tested; nothing when it is.
    pub untested: Option<String>,
}

/// The test of all differences together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Joint {
    /// `d' V^-1 d` of the differences d with their covariance V.
    pub chi_squared: f64,
    /// Number of differences that do not follow from others.
    pub degrees_of_freedom: usize,
    /// How often chance alone makes differences at least as large.
    pub p: f64,
    /// The p-value corrected by Holm's method for all tests of the comparison; nothing where a single difference is tested, which
    /// this test would only repeat.
    pub p_adjusted: Option<f64>,
}

/// The combination of parameters that changed by the most deviations. Small shares are left out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Direction {
    /// The combination as a sum, in the unit of its parameter of weight one.
    pub combination: String,
    /// Unit.
    pub unit: Option<String>,
    /// Second value less first.
    pub difference: f64,
    /// Standard deviation of the difference.
    pub std: f64,
    /// The difference in its deviations.
    pub z: f64,
    /// Largest correlation between two of the tested differences.
    pub correlation: f64,
}

/// Parameters that are compared together: those in which the models are linear, or the physical ones behind them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Family {
    /// Every parameter that both results have, then combinations that both show.
    pub differences: Vec<Difference>,
    /// All of them together; nothing where none can be tested.
    pub joint: Option<Joint>,
    /// Where the change lies; nothing where parameters are not strongly correlated or nothing changed.
    pub direction: Option<Direction>,
    /// Parameters of the first result that the second does not have.
    pub only_in_a: Vec<String>,
    /// Parameters of the second result that the first does not have.
    pub only_in_b: Vec<String>,
}

/// What a comparison comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Verdict {
    /// The data show no difference.
    NoDifference,
    /// Parameters or combinations changed, each beyond chance.
    Changed,
    /// The results differ, but no parameter alone does.
    ChangedTogether,
}

/// A comparison of two results; serialises as `tpm.comparison/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Comparison {
    /// `tpm.comparison/1`.
    pub schema: &'static str,
    /// Model of the first result.
    pub model_a: String,
    /// Model of the second result.
    pub model_b: String,
    /// [`Comparison::LEVEL`].
    pub level: f64,
    /// Number of tests that the p-values are corrected for.
    pub tests: usize,
    /// Parameters in which the models are linear.
    pub linear: Family,
    /// Physical parameters behind lumped ones, where both results have them.
    pub physical: Option<Family>,
    /// What it comes to.
    pub verdict: Verdict,
    /// Names of what changed.
    pub changed: Vec<String>,
    /// What makes the comparison less certain than its numbers say.
    pub warnings: Vec<String>,
}

impl Comparison {
    /// Share of comparisons of results without a difference in which one may be claimed; the level of all tests together.
    pub const LEVEL: f64 = alarm::COMPARISON_RATE;

    /// The families of parameters that are compared.
    pub fn families(&self) -> impl Iterator<Item = &Family> {
        std::iter::once(&self.linear).chain(&self.physical)
    }
}
