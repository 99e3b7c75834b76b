//! The time between inputs and motion.
//!
//! An input that is recorded early, or a sensor that is read late, turns the phases of the inputs against those of the motion. Along
//! the measured motion the rows are linear in the parameters whatever the shift is, so that the shift that leaves least of the forces
//! is found by a few regressions in one band.

use crate::error::EstimateError;
use crate::settings::Settings;
use crate::time_domain::band::cut_off;
use crate::time_domain::equations::{Equations, Machine};
use crate::time_domain::fit::fit;
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::motion::{Motion, TimeRecord};
use serde::Serialize;
use tpm_controller::derivatives::RowDerivatives;
use tpm_controller::model::Model;
use tpm_motion::Dynamics;

/// The search for the shift that leaves least.
struct Search {
    /// Most steps, each twice as long as the one before, by which the least residual is bracketed.
    doublings: i32,
    /// Times that the bracket is narrowed by a parabola.
    narrowings: usize,
    /// Least spacing of the shifts that are tried, samples.
    least_spacing: f64,
}

const SEARCH: Search = Search { doublings: 6, narrowings: 3, least_spacing: 0.125 };

/// The time by which the inputs act later than they were recorded, all of them alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct InputShift {
    /// The shift that leaves least, s; negative where the inputs were recorded late, or the motion early.
    pub delay: f64,
    /// Its standard deviation, s, as far as noise and the model let tell; infinite where all shifts explain the record alike.
    pub deviation: f64,
    /// Share of the forces that is left without a shift.
    pub left: f64,
    /// Share of the forces that this shift leaves.
    pub left_shifted: f64,
}

/// The regressions in one band, one per shift.
struct Shifted<'a> {
    machine: Machine<'a>,
    record: &'a TimeRecord<'a>,
    motion: Motion,
    low_pass: LowPass,
    settings: &'a Settings,
    /// Equations that are independent of each other.
    independent: f64,
}

impl Shifted<'_> {
    /// Mean square of what a shift leaves of the forces in the rows with an input, as a share; nothing where nothing is estimated.
    fn left(&mut self, shift: f64) -> Result<Option<f64>, EstimateError> {
        let dims = self.machine.model.dims();
        let known = |i: usize| self.record.actuators.get(i).copied().unwrap_or_default();
        let actuators: Vec<Dynamics> =
            (0..dims.inputs).map(known).map(|known| Dynamics { delay: known.delay + shift, ..known }).collect();
        let record = TimeRecord { actuators: &actuators, ..self.record.clone() };
        let equations = Equations::of(self.machine, &record, &self.motion, self.low_pass)?;
        self.independent = equations.instants() as f64 / equations.correlated.max(1) as f64;
        let free = self.settings.free(dims.parameters)?;
        let Some(fitted) = fit(&equations, dims, &free, self.settings) else { return Ok(None) };
        let driven = equations.rows.iter().zip(&fitted.row_residuals).filter(|(row, _)| row.driven);
        let (sum, count) = driven.fold((0.0, 0.0), |(sum, count), (_, left)| (sum + left * left, count + 1.0));
        Ok((count > 0.0).then_some(sum / count))
    }
}

/// The shift of the inputs against the motion that leaves least of the forces; nothing where no input acts, the record shows no
/// parameter, or less and less is left towards shifts of many samples.
///
/// # Errors
/// [`EstimateError`] when the rows cannot be evaluated on the motion, or there is no signal.
pub fn input_shift(
    model: &dyn Model<f64>,
    derivatives: Option<&dyn RowDerivatives<f64>>,
    constants: &[f64],
    record: &TimeRecord<'_>,
    settings: &Settings,
) -> Result<Option<InputShift>, EstimateError> {
    let motion = Motion::new(record, false)?;
    let cut_off = cut_off(&motion, record.sample_time).ok_or(EstimateError::NoSignal)?;
    let machine = Machine { model, derivatives, constants };
    let low_pass = LowPass { cut_off };
    let mut shifted = Shifted { machine, record, motion, low_pass, settings, independent: 1.0 };
    let h = record.sample_time;
    let mut at = |samples: f64| shifted.left(samples * h);
    let Some(left) = at(0.0)? else { return Ok(None) };
    let (Some(before), Some(after)) = (at(-1.0)?, at(1.0)?) else { return Ok(None) };
    // Three shifts of which the middle one leaves least.
    let mut points = [(-1.0, before), (0.0, left), (1.0, after)];
    if before.min(after) < left {
        let sign = if after < before { 1.0 } else { -1.0 };
        points = [(0.0, left), (0.0, left), (sign, before.min(after))];
        let mut bracketed = false;
        for doubling in 1..=SEARCH.doublings {
            let next = sign * 2.0_f64.powi(doubling);
            let Some(value) = at(next)? else { return Ok(None) };
            points = [points[1], points[2], (next, value)];
            if value >= points[1].1 {
                bracketed = true;
                break;
            }
        }
        if !bracketed {
            return Ok(None);
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    for _ in 0..SEARCH.narrowings {
        let (best, _) = lowest(&points);
        let spacing = (0.25 * (points[2].0 - points[0].0)).max(SEARCH.least_spacing);
        let mut around = [(best - spacing, 0.0), (best, 0.0), (best + spacing, 0.0)];
        for point in &mut around {
            let Some(value) = at(point.0)? else { return Ok(None) };
            point.1 = value;
        }
        points = around;
    }
    let (best, bend) = lowest(&points);
    let least = at(best)?.unwrap_or(points[1].1).min(points[1].1);
    let deviation = if bend > 0.0 { (least / (bend * shifted.independent)).sqrt() } else { f64::INFINITY };
    Ok(Some(InputShift {
        delay: best * h,
        deviation: deviation * h,
        left: left.sqrt(),
        left_shifted: least.min(left).sqrt(),
    }))
}

/// The lowest point of the parabola through three points, within them, and its bend; the lowest of the points where there is none.
fn lowest(points: &[(f64, f64); 3]) -> (f64, f64) {
    let [(a, fa), (b, fb), (c, fc)] = *points;
    let (left, right) = ((fb - fa) / (b - a), (fc - fb) / (c - b));
    let bend = (right - left) / (c - a);
    let at = 0.5 * (a + b) - left / (2.0 * bend);
    if bend.is_finite() && bend > 0.0 && at.is_finite() {
        (at.clamp(a, c), bend)
    } else {
        let least = points.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(b, |point| point.0);
        (least, 0.0)
    }
}
