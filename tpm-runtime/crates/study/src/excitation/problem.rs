//! Criterion and limits of a motion as functions of its numbers, with gradients.
//!
//! Everything is judged at equal steps of one period. Limits of positions and their derivatives are drawn in by the factor by which a
//! series can exceed its samples, so that they hold between the samples too. Gradients come from one backward pass of the rows' plan at
//! every sample.

use super::criterion::Criterion;
use super::series::{Series, excess};
use tpm_interpret::{BaseRows, RowsAt};
use tpm_numerics::DMatrix;

/// Limits of one coordinate; infinite where there is none.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotionLimits {
    pub(super) position: (f64, f64),
    pub(super) velocity: f64,
    pub(super) acceleration: f64,
}

/// A search for a good motion.
pub(super) struct Problem<'a> {
    pub(super) rows: &'a BaseRows,
    pub(super) constants: &'a [f64],
    /// The base parameters' values, for the torques.
    pub(super) base: Vec<f64>,
    /// The inputs as `factors times rows`, row-major.
    pub(super) factors: Vec<f64>,
    /// Largest permitted magnitude of every input.
    pub(super) efforts: Vec<f64>,
    pub(super) limits: Vec<MotionLimits>,
    /// Square root of the weight of every row.
    pub(super) weights: Vec<f64>,
    pub(super) criterion: Criterion,
    /// Share of every limit that may be used.
    pub(super) room: f64,
}

/// What is minimised.
#[derive(Clone, Copy, Debug)]
pub(super) enum Aim {
    /// How far limits are passed: half the squares of what exceeds this share of a limit.
    Feasible(f64),
    /// The criterion, and this factor on the barrier of the limits; infinite where one is passed.
    Best(f64),
}

impl Aim {
    /// The function of a quantity's share of its limit, and its slope.
    fn of(self, share: f64) -> (f64, f64) {
        match self {
            Self::Feasible(most) => {
                let beyond = (share.abs() - most).max(0.0);
                (0.5 * beyond * beyond, beyond * share.signum())
            }
            Self::Best(factor) => {
                let room = 1.0 - share * share;
                if room > 0.0 { (-factor * room.ln(), 2.0 * factor * share / room) } else { (f64::INFINITY, 0.0) }
            }
        }
    }
}

/// Memory of an evaluation.
pub(super) struct Memory {
    at: Vec<RowsAt>,
    motions: Vec<f64>,
    stacked: DMatrix<f64>,
    of_known: Vec<f64>,
    of_motion: Vec<f64>,
    of_rows: Vec<f64>,
}

impl Problem<'_> {
    /// The same search with another share of the limits.
    pub(super) fn with_room(&self, room: f64) -> Self {
        Self {
            base: self.base.clone(),
            factors: self.factors.clone(),
            efforts: self.efforts.clone(),
            limits: self.limits.clone(),
            weights: self.weights.clone(),
            room,
            ..*self
        }
    }

    pub(super) fn memory(&self, series: &Series) -> Memory {
        let (dims, samples) = (self.rows.dims(), series.samples);
        Memory {
            at: vec![self.rows.memory(); samples],
            motions: vec![0.0; samples * dims.motion_len()],
            stacked: DMatrix::zeros(self.base.len(), samples * dims.rows),
            of_known: vec![0.0; dims.rows],
            of_motion: vec![0.0; dims.motion_len()],
            of_rows: vec![0.0; dims.rows * self.base.len()],
        }
    }

    /// The value at a point and its gradient; infinite where the rows have no finite value there.
    pub(super) fn value(
        &self,
        series: &Series,
        point: &[f64],
        aim: Aim,
        memory: &mut Memory,
        gradient: &mut [f64],
    ) -> f64 {
        let dims = self.rows.dims();
        let (samples, size, width) = (series.samples, self.base.len(), dims.motion_len());
        gradient.fill(0.0);
        // 1. The rows along the motion.
        for n in 0..samples {
            let motion = &mut memory.motions[n * width..(n + 1) * width];
            series.motion(point, n, motion);
            if self.rows.evaluate(motion, self.constants, &mut memory.at[n]).is_err() {
                return f64::INFINITY;
            }
        }
        // 2. The criterion, and its gradient in the regressor.
        let best = matches!(aim, Aim::Best(_));
        let mut total = 0.0;
        if best {
            for (n, at) in memory.at.iter().enumerate() {
                for (row, (entries, weight)) in at.regressor.chunks_exact(size).zip(&self.weights).enumerate() {
                    let column = &mut memory.stacked.column_mut(n * dims.rows + row);
                    column.iter_mut().zip(entries).for_each(|(slot, entry)| *slot = weight * entry);
                }
            }
            let information = &memory.stacked * memory.stacked.transpose();
            let Some((value, slopes)) = self.criterion.of(information) else { return f64::INFINITY };
            // d tr(G M) = 2 tr(G W^T dW).
            memory.stacked = slopes * &memory.stacked * 2.0;
            total = value;
        }
        // 3. The limits, and the way back to the motion's numbers.
        let tight = excess(series.harmonics, samples) / self.room;
        let share_of_samples = 1.0 / samples as f64;
        for n in 0..samples {
            let motion = &memory.motions[n * width..(n + 1) * width];
            memory.of_rows.fill(0.0);
            memory.of_known.fill(0.0);
            if best {
                for row in 0..dims.rows {
                    let column = memory.stacked.column(n * dims.rows + row);
                    let slots = &mut memory.of_rows[row * size..(row + 1) * size];
                    let weight = self.weights[row];
                    slots.iter_mut().zip(column.iter()).for_each(|(slot, slope)| *slot = weight * slope);
                }
            }
            total += share_of_samples
                * self.of_efforts(&memory.at[n], aim, share_of_samples, &mut memory.of_rows, &mut memory.of_known);
            if !total.is_finite() {
                return f64::INFINITY;
            }
            let slots = &mut memory.of_motion;
            if self.rows.gradient(&memory.of_rows, &memory.of_known, &mut memory.at[n], slots).is_err() {
                return f64::INFINITY;
            }
            let count = dims.coordinates;
            for (c, limits) in self.limits.iter().enumerate() {
                for (order, (centre, reach)) in limits.of_orders().into_iter().enumerate() {
                    let slot = order * count + c;
                    if reach.is_finite() && slot < width {
                        let (value, slope) = aim.of((motion[slot] - centre) * tight / reach);
                        total += share_of_samples * value;
                        slots[slot] += share_of_samples * slope * tight / reach;
                    }
                }
            }
            series.pull_back(slots, n, gradient);
        }
        if total.is_finite() { total } else { f64::INFINITY }
    }

    /// The value of the inputs' limits at a sample; adds its slopes in the regressor and the known terms.
    fn of_efforts(&self, at: &RowsAt, aim: Aim, share: f64, of_rows: &mut [f64], of_known: &mut [f64]) -> f64 {
        let (size, rows) = (self.base.len(), of_known.len());
        let force = |row: usize| {
            let entries = &at.regressor[row * size..(row + 1) * size];
            at.known[row] + entries.iter().zip(&self.base).map(|(entry, value)| entry * value).sum::<f64>()
        };
        let forces: Vec<f64> = (0..rows).map(force).collect();
        let mut total = 0.0;
        for (factors, limit) in
            self.factors.chunks_exact(rows).zip(&self.efforts).filter(|(_, limit)| limit.is_finite())
        {
            let input: f64 = factors.iter().zip(&forces).map(|(factor, force)| factor * force).sum();
            let limit = self.room * limit;
            let (value, slope) = aim.of(input / limit);
            total += value;
            if slope == 0.0 {
                continue;
            }
            for (row, factor) in factors.iter().enumerate().filter(|(_, factor)| **factor != 0.0) {
                let slope = share * slope * factor / limit;
                of_known[row] += slope;
                let slots = &mut of_rows[row * size..(row + 1) * size];
                slots.iter_mut().zip(&self.base).for_each(|(slot, value)| *slot += slope * value);
            }
        }
        total
    }
}

impl MotionLimits {
    /// Centre and reach of the position and its two derivatives.
    pub(super) fn of_orders(&self) -> [(f64, f64); 3] {
        let (low, high) = self.position;
        let position = if low.is_finite() && high.is_finite() {
            (f64::midpoint(low, high), 0.5 * (high - low))
        } else {
            (0.0, f64::INFINITY)
        };
        [position, (0.0, self.velocity), (0.0, self.acceleration)]
    }
}
