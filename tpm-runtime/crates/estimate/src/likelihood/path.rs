//! The smoothed motion of a stretch, the inputs that act on it, and the rows of the model along both, on an even grid.

use crate::error::EstimateError;
use crate::rows::{Rows, Scratch};
use crate::sensor::Sensor;
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::motion::{Motion, Moving, TimeRecord};
use crate::time_domain::transform::quick;
use num_complex::Complex;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::Arc;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{EvalError, Model};
use tpm_motion::{Dynamics, held};
use tpm_numerics::spectrum::{Spectrum, rate_deviation};
use tpm_numerics::{root_mean_square, through_even, whole};

/// Points of the grid in one oscillation at the highest frequency at which a motion stands out of its noise: products of a few coordinates
/// alias nothing into the lines, and a sign jumps to a thirtieth of an oscillation.
const POINTS_PER_OSCILLATION: f64 = 32.0;
/// Fewest points in one oscillation at the highest frequency that is taken: the low pass on the motion ends at four times this frequency.
const LEAST_POINTS: f64 = 8.0;
/// Cut-off of the low pass on motion and inputs, in units of the highest frequency that is followed: a linear term is treated exactly as the
/// inputs are.
const MOTION_CUT_OFF: f64 = 2.0;
/// Cut-off of the low pass on a row, in units of the highest frequency that is followed in it.
const ROW_CUT_OFF: f64 = 1.25;
/// A coordinate takes part in a row when its motion makes more than this share of the row's force.
const FELT: f64 = 1e-3;
/// Points in one oscillation at the highest frequency at which a motion stands out of its noise, at which derivatives by a position are taken.
const SLOPES_PER_OSCILLATION: f64 = 8.0;
/// Points of a stretch at which the rows' derivatives are taken.
const DERIVATIVE_POINTS: usize = 256;
/// Steps of the differences by which they are taken, as shares of the root mean square: a velocity's step smooths a sign.
const POSITION_STEP: f64 = 0.02;
const VELOCITY_STEP: f64 = 0.3;
/// Times within the cell of a point at which rows are evaluated where a velocity changes its sign in it: what jumps is averaged over the
/// cell, so that the grid adds no noise.
const TIMES_AT_A_REVERSAL: usize = 16;
/// Most coordinates whose relative velocities are looked at for changes of sign.
const MOST_RELATIVE: usize = 3;
/// Points that one task evaluates.
const POINTS_PER_TASK: usize = 512;
/// Points at which it is asked which entries of the regressor are zero by structure.
const PROBES: usize = 64;

/// What an input does beyond what is known of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Acting {
    /// How much later it acts, s.
    pub(super) delay: f64,
    /// The multiple of what is recorded that acts.
    pub(super) gain: f64,
}

/// Columns of something that acts: the rows in which it does, and what it makes there.
pub(crate) type Columns = Vec<(usize, Vec<f64>)>;

/// A coordinate as its sensor shows it.
#[derive(Clone, Debug)]
pub(super) struct Measured {
    pub(super) spectrum: Spectrum,
    /// Highest frequency at which the motion stands out of its noise, Hz; more may be taken where the forces' noise is larger.
    pub(super) narrow: f64,
    /// Deviation of the noise of the measured rate; nothing where it is not measured.
    rate_noise: Option<f64>,
    /// Deviation of the smoothed rate, unit of the coordinate per s.
    pub(super) rate_deviation: f64,
}

impl Measured {
    /// Density of the noise of the position at an angular frequency, to both sides.
    fn noise(&self, w: f64, h: f64) -> f64 {
        let own = self.spectrum.noise_at(w / (2.0 * PI));
        let together = match self.rate_noise {
            Some(rate) if own > 0.0 && w > 0.0 => own * rate * rate / (rate * rate + own * w * w),
            _ => own,
        };
        together * h
    }

    /// What smoothing leaves of the position at an angular frequency, when motions up to `fastest`, Hz, are followed.
    fn smoothing(&self, w: f64, (fastest, circular): (f64, bool)) -> f64 {
        let share = if self.rate_noise.is_some() { 1.0 } else { self.spectrum.share(w / (2.0 * PI)) };
        passes(w, fastest, circular) * share
    }
}

/// A value at successive times within a cell.
#[derive(Clone, Default)]
struct Swept {
    sum: f64,
    last: Option<f64>,
    least: f64,
    most: f64,
    /// Largest change from one time to the next.
    step: f64,
}

impl Swept {
    fn take(&mut self, value: f64) {
        let last = *self.last.get_or_insert_with(|| {
            (self.least, self.most) = (value, value);
            value
        });
        self.sum += value;
        self.step = self.step.max((value - last).abs());
        (self.least, self.most) = (self.least.min(value), self.most.max(value));
        self.last = Some(value);
    }

    /// Whether one of the steps makes most of the change: what is smooth takes many, and is exact where it is evaluated.
    fn jumps(&self) -> bool {
        self.step > 0.5 * (self.most - self.least)
    }
}

/// A stretch on its grid.
#[derive(Clone)]
pub(super) struct Path {
    /// Coordinates of the model.
    coordinates: usize,
    /// Slots of a motion: the coordinates and their derivatives, order by order.
    slots: usize,
    /// Points of the grid.
    pub(super) points: usize,
    /// Time from one to the next, s.
    pub(super) apart: f64,
    /// Whether the end goes over into the beginning: whole periods of a motion that repeats.
    pub(super) circular: bool,
    /// Time over which samples were measured, s.
    pub(super) duration: f64,
    /// The slots of a motion, point by point.
    pub(super) motion: Vec<f64>,
    /// Forces of the inputs, input by input.
    pub(super) inputs: Vec<Vec<f64>>,
    /// Their rates.
    pub(super) input_rates: Vec<Vec<f64>>,
    /// Whether a velocity changes its sign in the cell of a point.
    reverses: Vec<bool>,
}

/// A record on its grids.
pub(super) struct Paths<'a> {
    pub(super) rows: Rows<'a>,
    pub(super) sample_time: f64,
    pub(super) measured: Vec<Measured>,
    pub(super) paths: Vec<Path>,
}

impl<'a> Paths<'a> {
    /// Smooths the motion of a record; inputs act as is said, and every coordinate is taken up to a frequency, Hz, or where this is zero as far
    /// as it stands out of its noise.
    pub(super) fn new(
        rows: Rows<'a>,
        record: &TimeRecord<'_>,
        motion: &Motion,
        circular: bool,
        (acting, taken): (&[Acting], &[f64]),
    ) -> Self {
        let dims = rows.model.dims();
        let h = record.sample_time;
        let of = |c: usize| -> Vec<&[f64]> { record.stretches.iter().map(|stretch| stretch.coordinates[c]).collect() };
        let rates = |c: usize| -> Option<Vec<&[f64]>> {
            record.stretches.iter().map(|stretch| stretch.rates.get(c).copied().flatten()).collect()
        };
        let measured: Vec<Measured> = (0..dims.coordinates)
            .map(|c| {
                let mut spectrum = Spectrum::of(&of(c), h);
                let rate = rates(c);
                if let Some(rates) = &rate {
                    let own = Spectrum::of(rates, h);
                    spectrum.followed = spectrum.followed.max(own.followed);
                    spectrum.used = spectrum.used.max(own.used);
                }
                let narrow = spectrum.followed;
                if taken[c] > 0.0 {
                    spectrum.followed = spectrum.followed.max(taken[c]);
                    spectrum.used = taken[c];
                }
                // What follows from a coordinate counts as exact.
                let rate_noise = match record.follows(c) {
                    Some(_) => Some(0.0),
                    None => rate.map(|rates| Sensor::of(&rates).noise),
                };
                let by_position = rate_deviation(spectrum.noise_at(spectrum.followed).sqrt(), spectrum.followed, h);
                let rate_deviation = rate_noise.map_or(by_position, |noise| noise.min(by_position));
                Measured { spectrum, narrow, rate_noise, rate_deviation }
            })
            .collect();
        let stretch = |moving: &Moving| on_grid(rows.model, record, &measured, moving, circular, acting);
        Paths { rows, sample_time: h, paths: motion.stretches.iter().map(stretch).collect(), measured }
    }

    /// The same motion with inputs that do something else between samples.
    pub(super) fn held_otherwise(
        &self,
        record: &TimeRecord<'_>,
        motion: &Motion,
        hold: Hold,
        acting: &[Acting],
    ) -> Vec<Vec<Vec<f64>>> {
        let fastest = self.fastest();
        let of = |(moving, path): (&Moving, &Path)| {
            let input =
                |i: usize| force(record, moving, (i, hold, acting[i]), path.points, (fastest, path.circular), 0);
            (0..moving.inputs.len()).map(input).collect()
        };
        motion.stretches.iter().zip(&self.paths).map(of).collect()
    }

    /// The same record with noise of the size that the smoothed coordinates have added to them.
    pub(super) fn with_noise(&self, motion: &Motion) -> Self {
        let fastest = self.fastest();
        let of = |(moving, path): (&Moving, &Path)| {
            let mut noisy = path.clone();
            for (c, own) in self.measured.iter().enumerate() {
                for d in 0..=self.rows.model.coordinate_order(c) {
                    let noise =
                        moving.noise[c].derivative(path.points, d, |w| own.smoothing(w, (fastest, path.circular)));
                    noisy
                        .motion
                        .iter_mut()
                        .skip(d * path.coordinates + c)
                        .step_by(path.slots)
                        .zip(&noise)
                        .for_each(|(x, n)| *x += n);
                }
            }
            noisy
        };
        Paths {
            rows: self.rows,
            sample_time: self.sample_time,
            measured: self.measured.clone(),
            paths: motion.stretches.iter().zip(&self.paths).map(of).collect(),
        }
    }

    /// The same record with other coordinates, derivative by derivative, and other inputs.
    pub(super) fn with(&self, of: impl Fn(&Path) -> (Vec<Vec<Vec<f64>>>, Vec<Vec<f64>>)) -> Self {
        let own = |path: &Path| {
            let (coordinates, inputs) = of(path);
            path.replaced(&coordinates, inputs)
        };
        Paths {
            rows: self.rows,
            sample_time: self.sample_time,
            measured: self.measured.clone(),
            paths: self.paths.iter().map(own).collect(),
        }
    }

    /// How far apart the points of a path are at which derivatives by a position are taken, in points. They are four at least, or all.
    pub(super) fn stride(&self, path: &Path) -> usize {
        let narrow = self.measured.iter().map(|own| own.narrow).fold(0.0, f64::max);
        let most = POINTS_PER_OSCILLATION / SLOPES_PER_OSCILLATION;
        let wanted = whole::below((1.0 / (SLOPES_PER_OSCILLATION * narrow * path.apart)).clamp(1.0, most));
        wanted.min(path.points / 4).max(1)
    }

    /// Highest frequency of any coordinate that is followed, Hz.
    pub(super) fn fastest(&self) -> f64 {
        self.measured.iter().map(|own| own.spectrum.followed).fold(0.0, f64::max)
    }
}

impl Path {
    /// The points that a filtered row does not owe to the ends of the stretch.
    pub(super) fn valid(&self, lost: f64) -> Range<usize> {
        if self.circular {
            return 0..self.points;
        }
        let first = whole::above(lost / self.apart);
        let last = whole::below((self.duration - lost) / self.apart).min(self.points);
        first.min(last)..last
    }

    /// The point after this one, or before it.
    fn beside(&self, k: usize, ahead: f64) -> usize {
        match (ahead < 0.0, self.circular) {
            (true, true) => (k + self.points - 1) % self.points,
            (true, false) => k.saturating_sub(1),
            (false, true) => (k + 1) % self.points,
            (false, false) => (k + 1).min(self.points - 1),
        }
    }

    /// Marks the points in whose cells a velocity, or one relative to another, changes its sign.
    fn find_reversals(&mut self) {
        let coordinates = self.coordinates;
        let mut reverses = vec![false; self.points];
        if self.slots >= 2 * coordinates {
            let pairs = if coordinates <= MOST_RELATIVE { coordinates } else { 0 };
            let relative = (0..pairs).flat_map(|a| (0..a).map(move |b| (a, Some(b))));
            for (a, b) in (0..coordinates).map(|a| (a, None)).chain(relative) {
                let at = |k: usize, c: usize| self.instant(k)[coordinates + c];
                let velocity = |k: usize| at(k, a) - b.map_or(0.0, |b| at(k, b));
                let edge = |k: usize, ahead: f64| velocity(k) + velocity(self.beside(k, ahead));
                for (k, mark) in reverses.iter_mut().enumerate() {
                    *mark |= edge(k, -1.0) * edge(k, 1.0) <= 0.0;
                }
            }
        }
        self.reverses = reverses;
    }

    /// Derivative `d` of coordinate `c` at all points.
    pub(super) fn series(&self, c: usize, d: usize) -> Vec<f64> {
        let at = d * self.coordinates + c;
        if at >= self.slots {
            return vec![0.0; self.points];
        }
        self.motion.iter().skip(at).step_by(self.slots).copied().collect()
    }

    /// The stretch with other coordinates, derivative by derivative, and other inputs.
    fn replaced(&self, coordinates: &[Vec<Vec<f64>>], inputs: Vec<Vec<f64>>) -> Self {
        let mut motion = vec![0.0; self.motion.len()];
        for (c, derivatives) in coordinates.iter().enumerate() {
            for (d, values) in derivatives.iter().enumerate().filter(|(d, _)| d * self.coordinates + c < self.slots) {
                for (k, value) in values.iter().enumerate() {
                    motion[k * self.slots + d * self.coordinates + c] = *value;
                }
            }
        }
        let input_rates = inputs.iter().map(|values| vec![0.0; values.len()]).collect();
        Path { motion, inputs, input_rates, reverses: self.reverses.clone(), ..*self }
    }

    /// Every so many points of a range at which no velocity changes its sign.
    pub(super) fn excerpt(&self, range: Range<usize>, step: usize) -> Self {
        let places: Vec<usize> = range.step_by(step).filter(|&k| !self.reverses[k]).collect();
        let pick = |values: &Vec<f64>| places.iter().map(|&k| values[k]).collect();
        Path {
            points: places.len(),
            motion: places.iter().flat_map(|&k| self.instant(k).iter().copied()).collect(),
            inputs: self.inputs.iter().map(pick).collect(),
            input_rates: self.input_rates.iter().map(pick).collect(),
            reverses: vec![false; places.len()],
            ..*self
        }
    }

    /// The motion at a point.
    fn instant(&self, k: usize) -> &[f64] {
        &self.motion[k * self.slots..(k + 1) * self.slots]
    }
}

/// The force of an input on a grid, or a derivative of it.
fn force(
    record: &TimeRecord<'_>,
    moving: &Moving,
    (input, hold, acting): (usize, Hold, Acting),
    points: usize,
    (fastest, circular): (f64, bool),
    derivative: u32,
) -> Vec<f64> {
    let mut actuator: Dynamics = record.actuators.get(input).copied().unwrap_or_default();
    actuator.delay += acting.delay;
    moving.inputs[input].filtered(points, |w| {
        let own =
            held(hold, w * record.sample_time) * actuator.response(w) * passes(w, fastest, circular) * acting.gain;
        own * Complex::new(0.0, w).powu(derivative)
    })
}

fn wide(fastest: f64) -> LowPass {
    LowPass { cut_off: 2.0 * PI * MOTION_CUT_OFF * fastest }
}

/// What passes of motion and inputs at an angular frequency, when motions up to `fastest`, Hz, are followed. Whole periods have no ends into
/// which a sharp edge could ring, and then nothing is lost below it.
fn passes(w: f64, fastest: f64, circular: bool) -> f64 {
    let wide = wide(fastest);
    if circular { f64::from(w <= wide.cut_off) } else { wide.response(w) }
}

fn on_grid(
    model: &dyn Model<f64>,
    record: &TimeRecord<'_>,
    measured: &[Measured],
    moving: &Moving,
    circular: bool,
    acting: &[Acting],
) -> Path {
    let dims = model.dims();
    let fastest = measured.iter().map(|own| own.spectrum.followed).fold(0.0, f64::max);
    let duration = moving.points as f64 * record.sample_time;
    let narrow = measured.iter().map(|own| own.narrow).fold(0.0, f64::max);
    let wanted = duration * f64::max(POINTS_PER_OSCILLATION * narrow, LEAST_POINTS * fastest);
    let points = quick(whole::above(wanted)).min(moving.points);
    let slots = dims.motion_len();
    let mut motion = vec![0.0; points * slots];
    for (c, signal) in moving.coordinates.iter().enumerate() {
        let own = &measured[c];
        for d in 0..=model.coordinate_order(c) {
            let values = signal.derivative(points, d, |w| own.smoothing(w, (fastest, circular)));
            for (k, value) in values.iter().enumerate() {
                motion[k * slots + d * dims.coordinates + c] = *value;
            }
        }
    }
    let of = |i: usize, derivative: u32| {
        force(record, moving, (i, record.hold, acting[i]), points, (fastest, circular), derivative)
    };
    let mut path = Path {
        coordinates: dims.coordinates,
        slots,
        points,
        apart: duration / points as f64,
        circular,
        duration: moving.samples as f64 * record.sample_time,
        motion,
        inputs: (0..dims.inputs).map(|i| of(i, 0)).collect(),
        input_rates: (0..dims.inputs).map(|i| of(i, 1)).collect(),
        reverses: Vec::new(),
    };
    path.find_reversals();
    path
}

/// One entry of the equations of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Entry {
    /// Of the regressor.
    Parameter(usize),
    /// What the row does not owe to parameters, on the other side: forces of inputs less known terms.
    Right,
    /// Force of an input.
    Force(usize),
    /// Force that the rate of an input would make, were it the input.
    Rate(usize),
}

/// Entries of all rows along a path that are not zero by structure.
pub(super) struct Along {
    pub(super) entries: Vec<(usize, Entry)>,
    /// The values of every entry.
    columns: Vec<Arc<Vec<f64>>>,
    /// Known terms of all rows and factors of all inputs, point by point.
    sides: Arc<Vec<f64>>,
}

impl Along {
    /// The values of one entry.
    pub(super) fn column(&self, at: usize) -> Vec<f64> {
        self.columns[at].to_vec()
    }

    /// The rows along the same motion under the inputs of a path.
    pub(super) fn under_inputs_of(&self, rows: Rows<'_>, path: &Path) -> Self {
        let sides = rows.model.dims().rows + rows.model.dims().input_map_len();
        let of = |((row, entry), own): (&(usize, Entry), &Arc<Vec<f64>>)| match entry {
            Entry::Parameter(_) => Arc::clone(own),
            _ => {
                let points = self.sides.chunks_exact(sides).enumerate();
                Arc::new(points.map(|(k, sides)| rows.acting(sides, (*row, *entry), path, k)).collect())
            }
        };
        let columns = self.entries.iter().zip(&self.columns).map(of).collect();
        Along { entries: self.entries.clone(), columns, sides: Arc::clone(&self.sides) }
    }

    /// The columns of the parameters of a row.
    pub(super) fn parameters(&self, row: usize) -> Vec<(usize, Vec<f64>)> {
        let of = |(at, (own, entry)): (usize, &(usize, Entry))| match entry {
            Entry::Parameter(j) if *own == row => Some((*j, self.column(at))),
            _ => None,
        };
        self.entries.iter().enumerate().filter_map(of).collect()
    }

    /// What an input makes in the rows in which it acts, as these have it at given parameters: what the other inputs leave of them. Noise of
    /// the input's own record is not in it.
    pub(super) fn of_input(&self, input: usize, theta: &[f64]) -> Columns {
        let of = |(at, (row, entry)): (usize, &(usize, Entry))| {
            let mut sum = (*entry == Entry::Force(input)).then(|| self.column(at))?;
            for (j, column) in self.parameters(*row) {
                sum.iter_mut().zip(&column).for_each(|(sum, x)| *sum += theta[j] * x);
            }
            let right = self.column(self.place(*row, Entry::Right)?);
            sum.iter_mut().zip(&right).for_each(|(sum, x)| *sum -= x);
            Some((*row, sum))
        };
        self.entries.iter().enumerate().filter_map(of).collect()
    }

    /// Root mean square of what is known of the rows, over that of their right-hand sides.
    pub(super) fn known_share(&self) -> f64 {
        let (mut known, mut whole) = (0.0, 0.0);
        for ((row, _), right) in self.entries.iter().zip(&self.columns).filter(|((_, own), _)| *own == Entry::Right) {
            let forces = self.entries.iter().zip(&self.columns);
            let forces = forces.filter(|((of, own), _)| of == row && matches!(own, Entry::Force(_)));
            let forces: Vec<&Arc<Vec<f64>>> = forces.map(|(_, force)| force).collect();
            for (k, right) in right.iter().enumerate() {
                known += (forces.iter().map(|force| force[k]).sum::<f64>() - right).powi(2);
                whole += right * right;
            }
        }
        (known / whole.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Whether an entry stands in any row.
    pub(super) fn has(&self, entry: Entry) -> bool {
        self.entries.iter().any(|(_, own)| *own == entry)
    }

    /// Where an entry stands.
    pub(super) fn place(&self, row: usize, entry: Entry) -> Option<usize> {
        self.entries.iter().position(|own| *own == (row, entry))
    }
}

impl<'a> Rows<'a> {
    /// The rows at a point of a path with a slot moved by something; means over the point's cell of what jumps in it, where a velocity changes
    /// its sign.
    fn evaluate_at(
        self,
        path: &Path,
        k: usize,
        moved: Option<(usize, f64)>,
        instant: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<(), EvalError> {
        let shift = |instant: &mut [f64]| {
            if let Some((slot, by)) = moved {
                instant[slot] += by;
            }
        };
        instant.copy_from_slice(path.instant(k));
        shift(instant);
        self.evaluate(instant, scratch)?;
        if !path.reverses[k] {
            return Ok(());
        }
        let here = (scratch.regressor.clone(), scratch.known.clone(), scratch.map.clone());
        let mut swept = [&here.0, &here.1, &here.2].map(|values| vec![Swept::default(); values.len()]);
        let share = 1.0 / TIMES_AT_A_REVERSAL as f64;
        for time in 0..TIMES_AT_A_REVERSAL {
            let ahead = (time as f64 + 0.5) * share - 0.5;
            let other = path.beside(k, ahead);
            for (slot, value) in instant.iter_mut().enumerate() {
                let (own, beside) = (path.instant(k)[slot], path.instant(other)[slot]);
                *value = own + ahead.abs() * (beside - own);
            }
            shift(instant);
            self.evaluate(instant, scratch)?;
            for (swept, values) in swept.iter_mut().zip([&scratch.regressor, &scratch.known, &scratch.map]) {
                swept.iter_mut().zip(values).for_each(|(swept, value)| swept.take(*value));
            }
        }
        (scratch.regressor, scratch.known, scratch.map) = here;
        for (values, swept) in [&mut scratch.regressor, &mut scratch.known, &mut scratch.map].into_iter().zip(&swept) {
            let jumps = values.iter_mut().zip(swept).filter(|(_, swept)| swept.jumps());
            jumps.for_each(|(value, swept)| *value = share * swept.sum);
        }
        Ok(())
    }

    /// What inputs make in a row at a point, given the known terms of all rows and the factors of all inputs behind them.
    fn acting(self, sides: &[f64], (row, entry): (usize, Entry), path: &Path, k: usize) -> f64 {
        let dims = self.model.dims();
        let (known, map) = sides.split_at(dims.rows);
        let factor = |i: usize| map[row * dims.inputs + i];
        match entry {
            Entry::Force(i) => factor(i) * path.inputs[i][k],
            Entry::Rate(i) => factor(i) * path.input_rates[i][k],
            Entry::Parameter(_) | Entry::Right => self.right_of((known, map), row, &|i| path.inputs[i][k]),
        }
    }

    /// Derivatives of all rows with respect to a coordinate along a path, at given parameters: those that change along it. They are as smooth as
    /// the motion, and are taken at every `stride`-th point and interpolated.
    ///
    /// # Errors
    /// [`EstimateError::Model`].
    pub(super) fn by_position(
        self,
        path: &Path,
        (theta, stride): (&[f64], usize),
        c: usize,
    ) -> Result<Vec<(usize, Vec<f64>)>, EstimateError> {
        let rows = self.model.dims().rows;
        let step = POSITION_STEP * root_mean_square(path.motion.iter().skip(c).step_by(path.slots).copied());
        if step <= 0.0 {
            return Ok(Vec::new());
        }
        let places: Vec<usize> = (0..path.points).step_by(stride).collect();
        let mut slopes = vec![0.0; places.len() * rows];
        let tasks = slopes.par_chunks_mut(rows * POINTS_PER_TASK).enumerate();
        tasks.try_for_each(|(task, slopes)| -> Result<(), EvalError> {
            let places = &places[task * POINTS_PER_TASK..][..slopes.len() / rows];
            let inputs = |at: usize, i: usize| path.inputs[i][places[at]];
            for to in [step, -step] {
                let mut motions: Vec<f64> = places.iter().flat_map(|&k| path.instant(k)).copied().collect();
                motions.iter_mut().skip(c).step_by(path.slots).for_each(|own| *own += to);
                let left = self.left_along(&motions, theta, &inputs)?;
                slopes.iter_mut().zip(left).for_each(|(slope, left)| *slope += left / (2.0 * to));
            }
            Ok(())
        })?;
        let column = |row: usize| {
            let own: Vec<f64> = slopes.iter().skip(row).step_by(rows).copied().collect();
            between(&own, stride, path.points)
        };
        let columns: Vec<Vec<f64>> = (0..rows).map(column).collect();
        // A derivative that does not change along the path is that of a constant force.
        let changes = |column: &Vec<f64>| {
            let mean = column.iter().sum::<f64>() / column.len().max(1) as f64;
            let spread = root_mean_square(column.iter().map(|x| x - mean));
            spread > FELT * root_mean_square(column.iter().copied())
        };
        let any = columns.iter().any(changes);
        Ok(if any { columns.into_iter().enumerate().collect() } else { Vec::new() })
    }

    /// All rows along a path.
    ///
    /// # Errors
    /// [`EstimateError::Model`] and [`EstimateError::NotFinite`].
    pub(super) fn along(self, path: &Path) -> Result<Along, EstimateError> {
        let dims = self.model.dims();
        let slots = dims.motion_len();
        let all: Vec<(usize, Entry)> = (0..dims.rows)
            .flat_map(|row| {
                let parameters = (0..dims.parameters).map(Entry::Parameter);
                let inputs = (0..dims.inputs).flat_map(|i| [Entry::Force(i), Entry::Rate(i)]);
                parameters.chain(inputs).chain([Entry::Right]).map(move |entry| (row, entry))
            })
            .collect();
        // Known terms and factors of inputs stand behind each other.
        let sides_of = |scratch: &Scratch, sides: &mut [f64]| {
            sides[..dims.rows].copy_from_slice(&scratch.known);
            sides[dims.rows..].copy_from_slice(&scratch.map);
        };
        let value = |scratch: &Scratch, sides: &[f64], (row, entry): (usize, Entry), k: usize| match entry {
            Entry::Parameter(j) => scratch.regressor[row * dims.parameters + j],
            _ => self.acting(sides, (row, entry), path, k),
        };
        let deep = dims.rows + dims.input_map_len();
        let mut present = vec![false; all.len()];
        let (mut scratch, mut sides) = (self.scratch(), vec![0.0; deep]);
        let step = (path.points / PROBES).max(1);
        for k in (0..path.points).step_by(step) {
            self.evaluate(path.instant(k), &mut scratch)?;
            sides_of(&scratch, &mut sides);
            for (at, entry) in all.iter().enumerate() {
                present[at] |= entry.1 == Entry::Right || value(&scratch, &sides, *entry, k) != 0.0;
            }
        }
        let mut sides = vec![0.0; path.points * deep];
        loop {
            let entries: Vec<(usize, Entry)> =
                all.iter().zip(&present).filter(|(_, present)| **present).map(|(entry, _)| *entry).collect();
            let absent: Vec<usize> = (0..all.len()).filter(|&at| !present[at]).collect();
            let width = entries.len();
            let mut values = vec![0.0; path.points * width];
            let tasks =
                values.par_chunks_mut(width * POINTS_PER_TASK).zip(sides.par_chunks_mut(deep * POINTS_PER_TASK));
            let seen: Vec<Vec<usize>> = tasks
                .enumerate()
                .map(|(task, (values, sides))| -> Result<Vec<usize>, EvalError> {
                    let mut scratch = self.scratch();
                    let (mut instant, mut seen) = (vec![0.0; slots], Vec::new());
                    let first = task * POINTS_PER_TASK;
                    let own = first * slots..(first + sides.len() / deep) * slots;
                    let mut take = |k: usize, scratch: &Scratch| {
                        let sides = &mut sides[(k - first) * deep..][..deep];
                        sides_of(scratch, sides);
                        for (own, entry) in values[(k - first) * width..][..width].iter_mut().zip(&entries) {
                            *own = value(scratch, sides, *entry, k);
                        }
                        seen.extend(absent.iter().filter(|&&at| value(scratch, sides, all[at], k) != 0.0));
                    };
                    self.each(&path.motion[own], |i, scratch| take(first + i, scratch))?;
                    for k in (first..first + POINTS_PER_TASK).take_while(|k| *k < path.points) {
                        if path.reverses[k] {
                            self.evaluate_at(path, k, None, &mut instant, &mut scratch)?;
                            take(k, &scratch);
                        }
                    }
                    Ok(seen)
                })
                .collect::<Result<_, _>>()?;
            let mut again = false;
            for at in seen.into_iter().flatten() {
                again |= !present[at];
                present[at] = true;
            }
            if again {
                continue;
            }
            if let Some(at) = values.iter().position(|value| !value.is_finite()) {
                let (row, entry) = entries[at % width];
                let what = match entry {
                    Entry::Parameter(j) => self.model.parameter(j).name,
                    Entry::Right | Entry::Force(_) | Entry::Rate(_) => "known terms and inputs",
                };
                return Err(EstimateError::NotFinite {
                    row: self.model.row(row).name.to_string(),
                    what: what.to_string(),
                });
            }
            let column = |at: usize| Arc::new(values.iter().skip(at).step_by(width).copied().collect());
            return Ok(Along { columns: (0..width).map(column).collect(), entries, sides: Arc::new(sides) });
        }
    }

    /// The right-hand sides of all rows along a path with other inputs.
    ///
    /// # Errors
    /// [`EstimateError::Model`].
    pub(super) fn right(self, path: &Path, inputs: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, EstimateError> {
        let mut scratch = self.scratch();
        let mut right = vec![Vec::with_capacity(path.points); self.model.dims().rows];
        for (k, instant) in path.motion.chunks_exact(path.slots).enumerate() {
            self.sides(instant, &mut scratch)?;
            for (row, right) in right.iter_mut().enumerate() {
                right.push(self.right_of((&scratch.known, &scratch.map), row, &|i| inputs[i][k]));
            }
        }
        Ok(right)
    }

    /// What the rows leave of the forces at motions that stand one behind the other, given the parameters and every input at every motion:
    /// the rows of the first motion, then those of the next.
    fn left_along(
        self,
        motions: &[f64],
        theta: &[f64],
        inputs: &dyn Fn(usize, usize) -> f64,
    ) -> Result<Vec<f64>, EvalError> {
        let dims = self.model.dims();
        let mut left = Vec::with_capacity(motions.len() / dims.motion_len().max(1) * dims.rows);
        self.each(motions, |at, scratch| {
            let of = |row: usize| {
                let right = self.right_of((&scratch.known, &scratch.map), row, &|i| inputs(at, i));
                self.made(scratch, row, theta) - right
            };
            left.extend((0..dims.rows).map(of));
        })?;
        Ok(left)
    }
}

/// Values between those of every `stride`-th point, by the cubic through the four nearest.
fn between(values: &[f64], stride: usize, points: usize) -> Vec<f64> {
    let of = |k: usize| {
        let first = (k / stride).saturating_sub(1).min(values.len() - 4);
        through_even([0, 1, 2, 3].map(|i| values[first + i]), k as f64 / stride as f64 - first as f64)
    };
    if stride == 1 { values.to_vec() } else { (0..points).map(of).collect() }
}

/// How the rows feel the motion: mean square derivatives of every row with respect to every slot, at given parameters.
pub(super) struct Felt {
    slots: usize,
    coordinates: usize,
    squares: Vec<f64>,
    /// Mean square of every slot.
    motion: Vec<f64>,
}

impl Felt {
    /// # Errors
    /// [`EstimateError::Model`].
    pub(super) fn of(paths: &Paths<'_>, theta: &[f64]) -> Result<Self, EstimateError> {
        let dims = paths.rows.model.dims();
        let slots = dims.motion_len();
        let mut squares = vec![0.0; dims.rows * slots];
        let total: usize = paths.paths.iter().map(|path| path.points).sum();
        let square = |slot: usize| {
            let all = paths.paths.iter().flat_map(|path| path.motion.iter().skip(slot).step_by(slots));
            root_mean_square(all.copied()).powi(2)
        };
        let motion: Vec<f64> = (0..slots).map(square).collect();
        let moving = (0..slots).filter(|&slot| motion[slot] > 0.0);
        let steps: Vec<(usize, f64)> = moving
            .flat_map(|slot| {
                let share = if slot / dims.coordinates == 1 { VELOCITY_STEP } else { POSITION_STEP };
                let step = share * motion[slot].sqrt();
                [(slot, step), (slot, -step)]
            })
            .collect();
        let mut count = 0.0;
        for path in &paths.paths {
            let step = (total / DERIVATIVE_POINTS).max(1);
            for k in (0..path.points).step_by(step) {
                count += 1.0;
                let mut motions = path.instant(k).repeat(steps.len());
                let instants = motions.chunks_exact_mut(slots).zip(&steps);
                instants.for_each(|(instant, (slot, step))| instant[*slot] += step);
                let inputs = |_: usize, i: usize| path.inputs[i][k];
                let left = paths.rows.left_along(&motions, theta, &inputs)?;
                for (both, [(slot, step), _]) in left.chunks_exact(2 * dims.rows).zip(steps.as_chunks().0) {
                    for (row, (above, below)) in both[..dims.rows].iter().zip(&both[dims.rows..]).enumerate() {
                        squares[row * slots + slot] += ((above - below) / (2.0 * step)).powi(2);
                    }
                }
            }
        }
        squares.iter_mut().for_each(|sum| *sum /= f64::max(count, 1.0));
        Ok(Felt { slots, coordinates: dims.coordinates, squares, motion })
    }

    fn own(&self, row: usize) -> &[f64] {
        &self.squares[row * self.slots..(row + 1) * self.slots]
    }

    /// The coordinates whose motion a row feels.
    pub(super) fn coordinates(&self, row: usize) -> Vec<usize> {
        let of = |c: usize| -> f64 {
            let slots = (c..self.slots).step_by(self.coordinates);
            slots.map(|slot| self.own(row)[slot] * self.motion[slot]).sum()
        };
        let powers: Vec<f64> = (0..self.coordinates).map(of).collect();
        let whole: f64 = powers.iter().sum();
        (0..self.coordinates).filter(|&c| powers[c] > FELT * FELT * whole).collect()
    }

    /// Whether a row feels a coordinate.
    pub(super) fn feels(&self, row: usize, c: usize) -> bool {
        self.coordinates(row).contains(&c)
    }

    /// Variance of one part of a line of a row from the noise of one sensor, given its angular frequency.
    pub(super) fn noise_of(&self, row: usize, c: usize, measured: &[Measured], w: f64, h: f64) -> f64 {
        let slots = (c..self.slots).step_by(self.coordinates).enumerate();
        0.5 * measured[c].noise(w, h) * slots.map(|(d, slot)| self.own(row)[slot] * w.powi(2 * d as i32)).sum::<f64>()
    }

    /// Variance of one part of a line of a row from the sensors' noise, given its angular frequency.
    pub(super) fn noise(&self, row: usize, measured: &[Measured], w: f64, h: f64) -> f64 {
        (0..self.coordinates).map(|c| self.noise_of(row, c, measured, w, h)).sum()
    }
}

/// The low pass of a row, and the frequency up to which its lines are used, Hz.
pub(super) fn band(coordinates: &[usize], measured: &[Measured]) -> (LowPass, f64) {
    let least = |of: &dyn Fn(&Spectrum) -> f64| {
        let own = coordinates.iter().map(|&c| of(&measured[c].spectrum));
        let all = || measured.iter().map(|own| of(&own.spectrum));
        if coordinates.is_empty() { all().fold(f64::INFINITY, f64::min) } else { own.fold(f64::INFINITY, f64::min) }
    };
    let followed = least(&|spectrum| spectrum.followed);
    (LowPass { cut_off: 2.0 * PI * ROW_CUT_OFF * followed }, least(&|spectrum| spectrum.used))
}

/// Time that the low passes on the motion and on a row take from either end of a stretch, s.
pub(super) fn lost(low_pass: LowPass, fastest: f64) -> f64 {
    low_pass.reach() + wide(fastest).reach()
}

/// The leading acceleration of a row without an input: its coefficient and the motion that the row predicts.
pub(super) struct Predicted {
    /// Entries of the regressor with the leading acceleration that the row predicts, over its coefficient, parameter by parameter.
    pub(super) columns: Vec<Vec<f64>>,
    /// The right-hand side: predicted less measured acceleration and known terms, over the coefficient.
    pub(super) right: Vec<f64>,
    /// Factor of any other force of the row.
    pub(super) factor: Vec<f64>,
    /// The force of the leading acceleration.
    pub(super) leading: Vec<f64>,
}

/// Least coefficient of the leading acceleration, as a share of its root mean square, at which a row is divided by it.
const LEAST_COEFFICIENT: f64 = 0.05;

impl<'a> Rows<'a> {
    /// A row without an input, linearised about parameters: its leading acceleration, that of coordinate `c`, is predicted, so that the
    /// scale of its parameters is exactly what the row does not show. `others` is a force that the model lacks. Nothing where the
    /// coefficient of the acceleration vanishes somewhere.
    ///
    /// # Errors
    /// [`EstimateError::Model`].
    pub(super) fn predicted(
        self,
        path: &Path,
        (row, c): (usize, usize),
        theta: &[f64],
        others: &[f64],
    ) -> Result<Option<Predicted>, EstimateError> {
        let dims = self.model.dims();
        let (slots, p) = (dims.motion_len(), dims.parameters);
        let slot = self.model.coordinate_order(c) * dims.coordinates + c;
        let mut scratch = self.scratch();
        let mut coefficients = Vec::with_capacity(path.points);
        let mut measured = Vec::with_capacity(path.points);
        let dot = |scratch: &Scratch| self.made(scratch, row, theta) + scratch.known[row];
        let mut instant = vec![0.0; slots];
        for k in 0..path.points {
            self.evaluate_at(path, k, None, &mut instant, &mut scratch)?;
            let left = dot(&scratch);
            self.evaluate_at(path, k, Some((slot, 1.0)), &mut instant, &mut scratch)?;
            coefficients.push(dot(&scratch) - left);
            measured.push(left + others.get(k).copied().unwrap_or(0.0));
        }
        let size = root_mean_square(coefficients.iter().copied());
        if !coefficients.iter().all(|a| a.abs() > LEAST_COEFFICIENT * size && a.is_finite()) {
            return Ok(None);
        }
        let mut columns = vec![Vec::with_capacity(path.points); p];
        let mut found = Predicted { columns: Vec::new(), right: Vec::new(), factor: Vec::new(), leading: Vec::new() };
        for k in 0..path.points {
            let over = size / coefficients[k];
            found.leading.push(coefficients[k].abs() * path.instant(k)[slot]);
            let moved = Some((slot, -measured[k] / coefficients[k]));
            self.evaluate_at(path, k, moved, &mut instant, &mut scratch)?;
            for (j, column) in columns.iter_mut().enumerate() {
                column.push(scratch.regressor[row * p + j] * over);
            }
            found.right.push(-(measured[k] + scratch.known[row]) * over);
            found.factor.push(over);
        }
        found.columns = columns;
        Ok(Some(found))
    }

    /// Mean coefficients of the highest derivatives in the rows: row by row and coordinate by coordinate, one for every parameter.
    ///
    /// # Errors
    /// [`EstimateError::Model`].
    pub(super) fn leading_coefficients(self, paths: &Paths<'_>) -> Result<Vec<Vec<Vec<f64>>>, EstimateError> {
        let dims = self.model.dims();
        let p = dims.parameters;
        let mut scratch = self.scratch();
        let mut means = vec![vec![vec![0.0; p]; dims.coordinates]; dims.rows];
        let mut count: f64 = 0.0;
        for path in &paths.paths {
            for k in (0..path.points).step_by((path.points / DERIVATIVE_POINTS).max(1)) {
                self.evaluate(path.instant(k), &mut scratch)?;
                let below = scratch.regressor.clone();
                count += 1.0;
                for c in 0..dims.coordinates {
                    let mut instant = path.instant(k).to_vec();
                    instant[self.model.coordinate_order(c) * dims.coordinates + c] += 1.0;
                    self.evaluate(&instant, &mut scratch)?;
                    for (row, means) in means.iter_mut().enumerate() {
                        let own = row * p..(row + 1) * p;
                        let change = scratch.regressor[own.clone()].iter().zip(&below[own]);
                        means[c].iter_mut().zip(change).for_each(|(sum, (above, below))| *sum += above - below);
                    }
                }
            }
        }
        means.iter_mut().flatten().flatten().for_each(|sum| *sum /= count.max(1.0));
        Ok(means)
    }
}
