//! The band of frequencies in which a record is used.
//!
//! A low band leaves out what the machine does at high frequencies, a high one takes noise in. Several are tried. The band of highest rank
//! with the smallest deviations is used; how far the others move the parameters is reported, and is part of the deviations where it is
//! more than chance.

use crate::error::EstimateError;
use crate::result::Estimate;
use crate::settings::Settings;
use crate::time_domain::equations::{Equations, Machine};
use crate::time_domain::fit::{Fitted, fit};
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::motion::{Motion, TimeRecord};
use crate::verdict::Status;
use serde::Serialize;
use std::f64::consts::PI;
use tpm_core::derivatives::RowDerivatives;
use tpm_core::model::Model;
use tpm_numerics::Matrix;

/// Cut-offs that are tried, in units of the highest frequency that stands out of the noise.
const CUT_OFFS_TRIED: [f64; 6] = [0.7, 1.0, 1.5, 2.2, 3.3, 5.0];
/// Largest cut-off, as a share of the sampling frequency.
const LARGEST_CUT_OFF: f64 = 0.125;
/// Largest share of a stretch that a low pass may take from its ends.
const MOST_LOST: f64 = 0.5;
/// A band whose deviations are not more than this many times the smallest ones tells whether the parameters move with the band.
const MOST_DEVIATION_RATIO: f64 = 2.0;
/// Samples in one oscillation at the cut-off, times this, are those over which polynomials follow the motion on either side.
const POLYNOMIAL_REACH: f64 = 0.45;

/// The bands that were tried, and what they said.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct BandReport {
    /// Cut-off of the low pass, Hz.
    pub cut_off: f64,
    /// All cut-offs that were tried, Hz.
    pub tried: Vec<f64>,
    /// Highest frequency of every coordinate that stands out of its noise, Hz.
    pub highest: Vec<f64>,
    /// Samples that were used: all, or blocks of a long record.
    pub samples: usize,
    /// Instants at which the rows were used.
    pub instants: usize,
    /// Share of the equations left out because the sign of a velocity near rest is not known.
    pub at_rest: f64,
    /// How far the parameters move, at most, from this band to others that tell them nearly as well; by parameter, in its unit.
    pub moved: Vec<f64>,
    /// What is left of every row, as a share of its force.
    #[serde(skip)]
    pub row_residuals: Vec<f64>,
    /// Deviation of every sensor's noise from sample to sample, unit of the coordinate.
    pub noise: Vec<f64>,
    /// Measured rate over the rate of the measured position, by coordinate; nothing where the rate was not measured.
    pub rate_gains: Vec<Option<f64>>,
}

/// An estimate from any motion.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TimeDomain {
    /// The estimate.
    pub estimate: Estimate,
    /// The bands.
    pub report: BandReport,
    /// Samples in which the motion goes to and fro once, on the average.
    pub typical_period: f64,
    /// Samples on either side of a sample over which a polynomial follows the motion.
    pub reach: usize,
    /// Step of every sensor; zero where its values lie on no grid.
    pub steps: Vec<f64>,
    /// What the rows leave of the forces in the same band, as a share, when the inputs do the other thing between samples.
    pub other_hold: Option<f64>,
    /// Largest share of a row's force that one unit of a parameter makes, by parameter.
    felt: Vec<f64>,
}

impl TimeDomain {
    /// The estimate with other values and covariance, both of all parameters; `settings` say which are held.
    #[must_use]
    pub fn restated(&self, values: Vec<f64>, covariance: Matrix, settings: &Settings) -> Estimate {
        self.estimate.with_values(values, covariance, settings, |j, std| self.felt[j] * std)
    }
}

/// What is tried of a band.
struct Tried {
    low_pass: LowPass,
    fitted: Fitted,
    instants: usize,
    at_rest: f64,
}

impl Tried {
    /// Sum of the logarithms of all deviations.
    fn spread(&self) -> f64 {
        let known = self.fitted.estimate.std.iter().filter(|std| std.is_finite() && **std > 0.0);
        known.map(|std| std.ln()).sum()
    }
}

/// Samples on either side of a sample over which a polynomial follows a motion below a cut-off, Hz.
pub(crate) fn reach(cut_off: f64, sample_time: f64) -> usize {
    (POLYNOMIAL_REACH / (cut_off * sample_time)) as usize
}

/// The cut-offs that are tried for a motion, rad/s, ascending; none where all stretches are too short.
pub(super) fn cut_offs(motion: &Motion, sample_time: f64) -> Vec<f64> {
    let fastest = motion.fastest();
    let sampling = 2.0 * PI / sample_time;
    let longest = motion.stretches.iter().map(|stretch| stretch.samples).max().unwrap_or(0) as f64 * sample_time;
    // A low pass reaches the farther the lower it is, so that a short stretch needs a high one.
    let lowest = 2.0 * Equations::lost(LowPass { cut_off: 1.0 }) / (MOST_LOST * longest);
    let largest = LARGEST_CUT_OFF * sampling;
    let mut cut_offs: Vec<f64> = CUT_OFFS_TRIED
        .iter()
        .map(|times| (times * fastest).min(largest))
        .filter(|cut_off| *cut_off >= lowest)
        .collect();
    if cut_offs.is_empty() && lowest <= largest {
        cut_offs = vec![lowest, largest];
    }
    cut_offs.dedup();
    cut_offs
}

/// Estimates the parameters in which a model is linear from any motion; `derivatives` tell where signs jump.
///
/// # Errors
/// [`EstimateError::NoSignal`] when the stretches are too short for any band, or show no more than noise; [`EstimateError::Model`] and
/// [`EstimateError::NotFinite`] when the rows cannot be evaluated on the motion; [`EstimateError::Frozen`] and
/// [`EstimateError::AllFrozen`] when parameters are held that do not exist, or all.
pub fn estimate_time_domain(
    model: &dyn Model<f64>,
    derivatives: Option<&dyn RowDerivatives<f64>>,
    constants: &[f64],
    record: &TimeRecord<'_>,
    settings: &Settings,
) -> Result<TimeDomain, EstimateError> {
    let dims = model.dims();
    let free = settings.free(dims.parameters)?;
    let motion = Motion::new(record)?;
    let machine = Machine { model, derivatives, constants };
    let mut tried: Vec<Tried> = Vec::new();
    for cut_off in cut_offs(&motion, record.sample_time) {
        let low_pass = LowPass { cut_off };
        let equations = Equations::of(machine, record, &motion, low_pass)?;
        if let Some(fitted) = fit(&equations, dims, &free, settings) {
            let (instants, at_rest) = (equations.instants(), equations.at_rest());
            tried.push(Tried { low_pass, fitted, instants, at_rest });
        }
    }
    // The band that shows most, and of those that show as much the one that tells it best.
    let most = tried.iter().map(|tried| tried.fitted.estimate.rank).max().filter(|rank| *rank > 0);
    let most = most.ok_or(EstimateError::NoSignal)?;
    let best = tried
        .iter()
        .filter(|tried| tried.fitted.estimate.rank == most)
        .min_by(|a, b| a.spread().total_cmp(&b.spread()));
    let best = best.ok_or(EstimateError::NoSignal)?;
    let moved = |j: usize| -> f64 {
        let own = &best.fitted.estimate;
        let others = tried.iter().map(|tried| &tried.fitted.estimate).filter(|other| {
            other.rank == most && own.std[j].is_finite() && other.std[j] <= MOST_DEVIATION_RATIO * own.std[j]
        });
        // Noise alone moves a value by what the variances of two bands differ.
        let beyond_noise = |other: &Estimate| {
            let noise = (other.std[j].powi(2) - own.std[j].powi(2)).abs();
            ((other.values[j] - own.values[j]).powi(2) - noise).max(0.0).sqrt()
        };
        others.map(beyond_noise).fold(0.0, f64::max)
    };
    let hertz = |frequency: f64| frequency / (2.0 * PI);
    let report = BandReport {
        cut_off: hertz(best.low_pass.cut_off),
        tried: tried.iter().map(|tried| hertz(tried.low_pass.cut_off)).collect(),
        highest: motion.highest.iter().map(|frequency| hertz(*frequency)).collect(),
        samples: motion.stretches.iter().map(|stretch| stretch.samples).sum(),
        instants: best.instants,
        at_rest: best.at_rest,
        moved: (0..dims.parameters).map(moved).collect(),
        row_residuals: best.fitted.row_residuals.clone(),
        noise: motion.white.clone(),
        rate_gains: motion.rate_gains.clone(),
    };
    // The other hold is judged in the same band, since bands differ in what they leave.
    let other = TimeRecord { hold: record.hold.other(), ..record.clone() };
    let other = Equations::of(machine, &other, &motion, best.low_pass).ok();
    let other = other.and_then(|equations| fit(&equations, dims, &free, settings));
    let reach = reach(report.cut_off, record.sample_time);
    Ok(TimeDomain {
        estimate: widened(best.fitted.estimate.clone(), &report.moved),
        other_hold: other.map(|other| other.estimate.residual),
        felt: best.fitted.felt.clone(),
        typical_period: motion.typical_period / record.sample_time,
        reach,
        steps: motion.steps,
        report,
    })
}

/// The estimate with deviations that hold how far the parameters move with the band.
fn widened(mut estimate: Estimate, moved: &[f64]) -> Estimate {
    let mut covariance = estimate.covariance.to_rows();
    for (j, moved) in moved.iter().enumerate() {
        if matches!(estimate.status[j], Status::Unobservable | Status::Frozen) {
            continue;
        }
        covariance[j][j] += moved * moved;
        estimate.std[j] = covariance[j][j].max(0.0).sqrt();
    }
    if let Some(covariance) = Matrix::from_rows(&covariance) {
        estimate.covariance = covariance;
    }
    estimate
}
