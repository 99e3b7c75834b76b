//! Inputs that were clipped at a limit behind the place where they were recorded.
//!
//! A command that is recorded before a limiter shows no plateau. Along the measured motion the rows are linear in the parameters for any
//! limit, so that one regression tries one limit, with the same low pass on both sides. Limits that leave less than no limit does are
//! promising; the likelihood of every sample chooses among them, and decides whether there is a limit at all. Where the motion is too fast
//! for derivatives, all limits are promising that are not hopeless (`DESIGN.md`, "How is a clipped input found?").

use crate::local;
use crate::output_error::error::OutputErrorFault;
use crate::output_error::problem::{Column, Place, Problem};
use crate::output_error::signals::Signals;
use crate::time_domain::typical_period;
use std::ops::Range;
use tpm_controller::harmonics::Hold;
use tpm_numerics::{DMatrix, DVector, tolerance};

/// Smaller limits are not tried where one leaves so many times the squares that are left without one.
const MOST_SQUARES_RATIO: f64 = 4.0;
/// Limits that are tried between the smallest share of the peak and the peak.
const LIMITS_TRIED: usize = 104;
/// Smallest limit that is tried, as a share of the peak: a loop that cannot follow commands many times what acts.
const LEAST_LIMIT: f64 = 0.004;
/// A low pass that reaches fewer samples than this to either side leaves derivatives too far off for the regression.
const LEAST_REACH_SAMPLES: usize = 5;
/// Reach of the low pass on either side of a sample, as a share of the time in which the fastest coordinate goes to and fro.
const WINDOW_OF_PERIOD: f64 = 0.05;

/// A limit of an input.
#[derive(Clone, Debug)]
pub(super) struct Limit {
    pub(super) input: usize,
    /// The limit, unit of the input.
    pub(super) size: f64,
    /// Factor of the input in its row, sample by sample.
    pub(super) factor: Vec<f64>,
    /// The row in which the input acts.
    pub(super) row: usize,
}

/// Limits of inputs that are worth weighing by the likelihood.
#[derive(Default)]
pub(super) struct Promising {
    /// Each with the parameters, all of the model's, that explain the record with it.
    pub(super) limits: Vec<(Limit, Vec<f64>)>,
    /// Whether the motion is too fast for a regression, so that all limits are among them that are not hopeless, and the
    /// parameters are far off.
    pub(super) fast: bool,
}

/// Limits that are promising. The inputs are doubtful where a fit without a limit needs noise on them.
pub(super) fn promising(
    problem: &Problem<'_>,
    signals: &Signals<'_>,
    start: &[f64],
    doubtful: bool,
) -> Result<Promising, OutputErrorFault> {
    let model = problem.machine.model;
    let dims = model.dims();
    let whole = problem.samples();
    let high = (0..dims.coordinates).any(|c| model.coordinate_order(c) > 2);
    if high {
        return Ok(Promising::default());
    }
    // A loop may swing faster than the motion that repeats.
    let periods = signals.coordinates.iter().zip(&signals.white);
    let periods = periods.map(|(signal, white)| typical_period(signal, problem.sample_time, *white));
    let period = periods.fold(f64::INFINITY, f64::min);
    // What hardly moves within these samples shows no limit, and has no window that is short enough.
    let half = (period / problem.sample_time * WINDOW_OF_PERIOD).min(whole as f64) as usize;
    let fast = half < LEAST_REACH_SAMPLES && doubtful;
    // The low pass leaves nothing that needs every sample.
    let stride = (half / 6).max(1);
    let samples = whole.div_ceil(stride);
    let mut motions = Vec::with_capacity(dims.coordinates);
    for (c, signal) in signals.coordinates.iter().enumerate() {
        let order = model.coordinate_order(c);
        let Some(motion) = local::derivatives(signal, problem.sample_time, half.max(order).max(1), order, stride)
        else {
            return Ok(Promising::default());
        };
        motions.push((order, motion));
    }
    let mut scratch = vec![0.0; model.workspace_len()];
    let (mut phi, mut known) = (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]);
    let mut map = vec![0.0; dims.input_map_len()];
    let mut instant = vec![0.0; dims.motion_len()];
    let p = problem.free.len();
    let mut left = DMatrix::zeros(samples * dims.rows, p);
    let mut fixed = DVector::zeros(samples * dims.rows);
    let mut maps = vec![0.0; samples * dims.input_map_len()];
    for k in 0..samples {
        for (c, (order, motion)) in motions.iter().enumerate() {
            for d in 0..=*order {
                instant[d * dims.coordinates + c] = motion[k * (order + 1) + d];
            }
        }
        model.regressor(&instant, problem.constants, &mut scratch, &mut phi)?;
        model.known(&instant, problem.constants, &mut scratch, &mut known)?;
        model.input_map(&instant, problem.constants, &mut scratch, &mut map)?;
        for row in 0..dims.rows {
            let at = k * dims.rows + row;
            for (j, &free) in problem.free.iter().enumerate() {
                left[(at, j)] = phi[row * dims.parameters + free];
            }
            fixed[at] = -known[row];
            for (j, value) in start.iter().enumerate().filter(|(j, _)| !problem.free.contains(j)) {
                fixed[at] -= phi[row * dims.parameters + j] * value;
            }
        }
        maps[k * map.len()..(k + 1) * map.len()].copy_from_slice(&map);
    }
    let factor = |k: usize, row: usize, input: usize| maps[k * map.len() + row * dims.inputs + input];
    let smooth = |values: &mut dyn FnMut(usize) -> f64| -> Vec<f64> {
        let raw: Vec<f64> = (0..samples).map(values).collect();
        mean_over(&raw, half / stride)
    };
    for row in 0..dims.rows {
        for column in 0..p {
            let smoothed = smooth(&mut |k| left[(k * dims.rows + row, column)]);
            smoothed.iter().enumerate().for_each(|(k, value)| left[(k * dims.rows + row, column)] = *value);
        }
        let smoothed = smooth(&mut |k| fixed[k * dims.rows + row]);
        smoothed.iter().enumerate().for_each(|(k, value)| fixed[k * dims.rows + row] = *value);
    }
    let scales: Vec<f64> = left.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    for (mut column, scale) in left.column_iter_mut().zip(&scales) {
        column /= *scale;
    }
    // A machine that swings at one frequency does not tell its mass from its stiffness here; a start needs none of both alone.
    let Ok(inverse) = left.tr_mul(&left).pseudo_inverse(tolerance::GRAM) else { return Ok(Promising::default()) };
    // What is held until the next sample acts half a sample later than it was recorded.
    let held = |applied: &[f64], k: usize| match problem.hold {
        Hold::Zoh => 0.5 * (applied[k] + applied[k.saturating_sub(1)]),
        Hold::None => applied[k],
    };
    // The forces of an input that was cut off at a limit.
    let forces = |input: usize, limit: f64| -> DVector<f64> {
        let applied: Vec<f64> = signals.inputs[input].iter().map(|u| u.clamp(-limit, limit)).collect();
        let held: Vec<f64> = (0..whole).map(|k| held(&applied, k)).collect();
        let mut forces = DVector::zeros(samples * dims.rows);
        // The polynomials of the motion and the mean are the low pass of the other side.
        let Some(held) = local::derivatives(&held, problem.sample_time, half.max(2), 2, stride) else { return forces };
        for row in 0..dims.rows {
            let own: Vec<f64> = held.iter().step_by(3).enumerate().map(|(k, u)| factor(k, row, input) * u).collect();
            let smoothed = mean_over(&own, half / stride);
            smoothed.iter().enumerate().for_each(|(k, value)| forces[k * dims.rows + row] = *value);
        }
        forces
    };
    let unlimited: Vec<DVector<f64>> = (0..dims.inputs).map(|input| forces(input, f64::INFINITY)).collect();
    let mut limits = Vec::new();
    for input in 0..dims.inputs {
        let peak = signals.inputs[input].iter().map(|u| u.abs()).fold(0.0, f64::max);
        let acts = |row: &usize| (0..samples).any(|k| factor(k, *row, input).abs() > 0.0);
        let Some(row) = (0..dims.rows).find(acts).filter(|_| peak > 0.0) else { continue };
        let others = unlimited.iter().enumerate().filter(|(other, _)| *other != input);
        let others = others.fold(fixed.clone(), |sum, (_, force)| sum + force);
        // What a limit leaves of the row in which the input acts, as a share, and the parameters with it.
        let fit = |limit: f64| -> (f64, DVector<f64>) {
            let right = &others + forces(input, limit);
            let solved = &inverse * left.tr_mul(&right);
            let residual = &right - &left * &solved;
            let squares =
                |values: &DVector<f64>| values.iter().skip(row).step_by(dims.rows).map(|x| x * x).sum::<f64>();
            (squares(&residual) / squares(&right).max(f64::MIN_POSITIVE), solved)
        };
        let (none, _) = fit(f64::INFINITY);
        let factors: Vec<f64> = (0..whole).map(|k| factor(k / stride, row, input)).collect();
        let tried = (1..=LIMITS_TRIED).map(|i| peak * ratio().powi(i as i32)).map(|limit| (limit, fit(limit)));
        // Of a sound record a limit just below its peak leaves more than none does, and every smaller one more still.
        let tried = tried.take_while(|(_, (squares, _))| *squares < MOST_SQUARES_RATIO * none);
        let promising = tried.filter(|(_, (squares, _))| fast || *squares < none);
        limits.extend(promising.map(|(size, (_, solved))| {
            let mut theta = start.to_vec();
            for ((&j, value), scale) in problem.free.iter().zip(solved.iter()).zip(&scales) {
                theta[j] = value / scale;
            }
            (Limit { input, size, factor: factors.clone(), row }, theta)
        }));
    }
    Ok(Promising { limits, fast })
}

/// A limit that is tried as a share of the one before.
pub(super) fn ratio() -> f64 {
    LEAST_LIMIT.powf(1.0 / LIMITS_TRIED as f64)
}

impl Limit {
    /// The limit for some of the samples.
    pub(super) fn part(&self, samples: Range<usize>) -> Self {
        Limit { factor: self.factor[samples].to_vec(), ..self.clone() }
    }

    /// The input and how it acts, given all inputs as they were recorded.
    pub(super) fn applied(&self, recorded: &[&[f64]]) -> (usize, Vec<f64>) {
        (self.input, recorded[self.input].iter().map(|u| u.clamp(-self.size, self.size)).collect())
    }

    /// How the rows change with the limit, given all inputs as they were recorded.
    pub(super) fn edge(&self, recorded: &[&[f64]], hold: Hold) -> Column {
        let force = |(u, factor): (&f64, &f64)| if u.abs() > self.size { -factor * u.signum() } else { 0.0 };
        let values = recorded[self.input].iter().zip(&self.factor).map(force).collect();
        Column { place: Place::Row(self.row), values, held: hold == Hold::Zoh }
    }
}

/// Means over `2 half + 1` samples; at the ends over those that there are.
fn mean_over(values: &[f64], half: usize) -> Vec<f64> {
    let mut sums = Vec::with_capacity(values.len() + 1);
    let mut sum = 0.0;
    sums.push(sum);
    for value in values {
        sum += value;
        sums.push(sum);
    }
    let mean = |k: usize| {
        let (from, to) = (k.saturating_sub(half), (k + half + 1).min(values.len()));
        (sums[to] - sums[from]) / (to - from) as f64
    };
    (0..values.len()).map(mean).collect()
}
