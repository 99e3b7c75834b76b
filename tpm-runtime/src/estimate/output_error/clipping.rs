//! Inputs that were cut off at a limit behind the place where they were recorded.
//!
//! A command that is recorded before a limiter shows no plateau. Along the measured motion the rows are linear in the parameters
//! whatever the limit is, so that a limit can be tried by one regression; the one that leaves least is compared with none.

use crate::estimate::output_error::fit::{OutputErrorFault, Signals};
use crate::estimate::output_error::problem::{Column, Place, Problem};
use crate::numerics::{DMatrix, DVector};
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;

/// A limit is believed when it leaves less than this share of the squares that are left without one.
const BELIEVED: f64 = 0.25;
/// Limits that are tried between the smallest share of the peak and the peak.
const TRIED: usize = 120;
/// Smallest limit that is tried, as a share of the peak.
const LEAST: f64 = 0.04;

/// A limit of an input, found from the record.
#[derive(Clone, Debug)]
pub(super) struct Clipping {
    pub(super) input: usize,
    pub(super) limit: f64,
    /// The input as it was applied.
    pub(super) applied: Vec<f64>,
    /// Parameters that explain the record with this limit, all of the model's.
    pub(super) theta: Vec<f64>,
    /// How the force changes with the limit, per row on which the input acts.
    pub(super) edge: Column,
}

/// The input whose limit explains most of what is left without limits; nothing where none does.
pub(super) fn find(
    problem: &Problem<'_>,
    signals: &Signals<'_>,
    start: &[f64],
) -> Result<Option<Clipping>, OutputErrorFault> {
    let model = problem.machine.model;
    let dims = model.dims();
    let samples = problem.samples();
    if dims.inputs != 1 {
        return Ok(None);
    }
    let slots: Vec<(usize, usize)> =
        (0..dims.coordinates).flat_map(|c| (0..=model.coordinate_order(c)).map(move |d| (c, d))).collect();
    let motion = signals.motion(&slots);
    let mut scratch = vec![0.0; model.workspace_len()];
    let (mut phi, mut known) = (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]);
    let mut map = vec![0.0; dims.input_map_len()];
    let mut instant = vec![0.0; dims.motion_len()];
    let p = problem.free.len();
    let mut left = DMatrix::zeros(samples * dims.rows, p);
    let mut fixed = DVector::zeros(samples * dims.rows);
    let mut maps = vec![0.0; samples * dims.rows];
    for k in 0..samples {
        for (&(c, d), value) in slots.iter().zip(&motion[k * slots.len()..]) {
            instant[d * dims.coordinates + c] = *value;
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
            maps[at] = map[row];
        }
    }
    let scales: Vec<f64> = left.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    for (mut column, scale) in left.column_iter_mut().zip(&scales) {
        column /= *scale;
    }
    let Some(normal) = left.tr_mul(&left).cholesky() else { return Ok(None) };
    let u = signals.inputs[0];
    // What is held until the next sample acts half a sample later than it was recorded.
    let held = |applied: &[f64], k: usize| match problem.hold {
        Hold::Zoh => 0.5 * (applied[k] + applied[k.saturating_sub(1)]),
        Hold::None => applied[k],
    };
    let fit = |limit: f64| -> (f64, DVector<f64>) {
        let applied: Vec<f64> = u.iter().map(|u| u.clamp(-limit, limit)).collect();
        let right =
            DVector::from_fn(samples * dims.rows, |at, _| fixed[at] + maps[at] * held(&applied, at / dims.rows));
        let solved = normal.solve(&left.tr_mul(&right));
        let squares = (&right - &left * &solved).norm_squared() / right.norm_squared().max(f64::MIN_POSITIVE);
        (squares, solved)
    };
    let peak = u.iter().map(|u| u.abs()).fold(0.0, f64::max);
    if !(peak > 0.0) {
        return Ok(None);
    }
    let (none, _) = fit(2.0 * peak);
    let ratio = LEAST.powf(1.0 / TRIED as f64);
    let tried = (1..=TRIED).map(|i| peak * ratio.powi(i as i32)).map(|limit| (limit, fit(limit).0));
    let (limit, least) = tried.fold((peak, f64::INFINITY), |best, now| if now.1 < best.1 { now } else { best });
    if !(least < BELIEVED * none) {
        return Ok(None);
    }
    let (_, solved) = fit(limit);
    let mut theta = start.to_vec();
    for ((&j, value), scale) in problem.free.iter().zip(solved.iter()).zip(&scales) {
        theta[j] = value / scale;
    }
    let row =
        (0..dims.rows).find(|row| (0..samples).any(|k| maps[k * dims.rows + row].abs() > 0.0)).unwrap_or_default();
    let edge = |k: usize| if u[k].abs() > limit { -maps[k * dims.rows + row] * u[k].signum() } else { 0.0 };
    Ok(Some(Clipping {
        input: 0,
        limit,
        applied: u.iter().map(|u| u.clamp(-limit, limit)).collect(),
        theta,
        edge: Column {
            place: Place::Row(row),
            values: (0..samples).map(edge).collect(),
            held: problem.hold == Hold::Zoh,
        },
    }))
}
