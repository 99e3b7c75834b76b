//! Starts of the size that a record and the rows of a model suggest.
//!
//! A coordinate is as large as its readings (or those of one in the same unit), its derivatives as the frequency with which these cross
//! their mean; a parameter then is so large that its column makes a share of the row's force. Sizes are drawn about these, the same in
//! every run of the program.

use crate::recorded::flow::Flow;
use crate::recorded::signals::{Block, Channel, Sensed, SignalsAsRecorded};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tpm_controller::model::{EvalError, Model};
use tpm_numerics::{DMatrix, DVector, root_mean_square};

/// Motions at which columns are evaluated for their size.
const MOTIONS: usize = 32;
/// Passes in which sizes of shared parameters come from one row to another.
const PASSES: usize = 4;
/// Powers of ten within which a parameter is drawn about its size, and the frequency and the size of a coordinate of unknown size.
const OF_PARAMETER: [f64; 2] = [-1.0, 1.2];
const OF_FREQUENCY: [f64; 2] = [-0.5, 1.0];
const OF_UNKNOWN_SIZE: [f64; 2] = [-1.0, 1.0];
/// The same for a deflection, such as that of a bristle: a small part of the travel of what it joins.
const OF_DEFLECTION: [f64; 2] = [-3.0, -0.5];
/// Every second start has parameters of either sign; so often they are negative there.
const NEGATIVE: f64 = 0.25;
/// Fewest readings through which a parabola is laid for position and rate at the beginning of a block.
const LEAST_FITTED: usize = 5;

/// Mean and size of a coordinate.
#[derive(Clone, Copy, Debug)]
struct Extent {
    mean: f64,
    size: f64,
    /// Powers of ten within which the size is drawn; nothing where readings tell it.
    drawn: Option<[f64; 2]>,
}

/// What tells the typical frequency of a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pace {
    /// How often readings cross their mean.
    Crossings,
    /// How often they turn back: a limit cycle on top of strokes is faster than these.
    Turns,
}

/// What a coordinate that nobody measured is taken for when starts are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unmeasured {
    /// It moves as another coordinate in its unit does: the far side of a spring.
    Alike,
    /// It is a small part of that: the deflection of a spring or a bristle.
    Deflection,
}

/// What a record says of the size of a model's motion.
pub(super) struct Scales {
    extents: Vec<Extent>,
    /// Coordinate of which each has the readings: itself, or for one that is not measured another in its unit.
    like: Vec<Option<usize>>,
    /// Typical angular frequency, rad/s.
    pub(super) frequency: f64,
}

impl Scales {
    pub(super) fn of(
        model: &dyn Model<f64>,
        signals: &SignalsAsRecorded,
        (pace, unmeasured): (Pace, Unmeasured),
    ) -> Self {
        let n = model.dims().coordinates;
        let frequency = |channel: &Channel| match pace {
            Pace::Crossings => channel.frequency(),
            Pace::Turns => channel.turning_frequency(),
        };
        // An acceleration may be mostly noise, and its steps are those of the inputs.
        let is_state = |sensor: &&Sensed| sensor.derivative < model.coordinate_order(sensor.coordinate);
        let mut frequencies: Vec<f64> =
            signals.sensors.iter().filter(is_state).filter_map(|sensor| frequency(&sensor.channel)).collect();
        frequencies.sort_by(f64::total_cmp);
        let frequency = frequencies.get(frequencies.len() / 2).copied().unwrap_or(1.0);
        let extent = |channel: &Channel, factor: f64| {
            let (mean, size) = channel.spread();
            Extent { mean, size: if size > 0.0 { size * factor } else { 1.0 }, drawn: None }
        };
        let own = |c: usize| {
            let derivative = || signals.sensors.iter().find(|sensor| sensor.coordinate == c);
            let factor = |of: &Sensed| frequency.powi(-(of.derivative as i32));
            match signals.reads(c) {
                Some(channel) => Some(extent(channel, 1.0)),
                None => derivative().map(|of| Extent { mean: 0.0, ..extent(&of.channel, factor(of)) }),
            }
        };
        let unit = |c: usize| model.coordinate(c).unit;
        let like = |c: usize| match signals.reads(c) {
            Some(_) => Some(c),
            None => (0..n).find(|&other| unit(c).is_some() && unit(other) == unit(c) && signals.reads(other).is_some()),
        };
        let of_input = |c: usize| {
            let i = (0..model.dims().inputs).find(|&i| unit(c).is_some() && model.input(i).unit == unit(c))?;
            Some(Extent { mean: 0.0, ..extent(&signals.inputs[i], 1.0) })
        };
        let unknown = Extent { mean: 0.0, size: 1.0, drawn: Some(OF_UNKNOWN_SIZE) };
        let as_like = |c: usize| match unmeasured {
            Unmeasured::Alike => own(like(c)?),
            Unmeasured::Deflection => Some(Extent { mean: 0.0, drawn: Some(OF_DEFLECTION), ..own(like(c)?)? }),
        };
        let of = |c: usize| own(c).or_else(|| as_like(c)).or_else(|| of_input(c)).unwrap_or(unknown);
        let begins_like = |c: usize| like(c).filter(|&other| other == c || unmeasured == Unmeasured::Alike);
        Self { extents: (0..n).map(of).collect(), like: (0..n).map(begins_like).collect(), frequency }
    }

    /// Whether a coordinate that nobody measured has its size from another one.
    pub(super) fn has_alike(&self) -> bool {
        self.like.iter().enumerate().any(|(c, like)| like.is_some_and(|other| other != c))
    }

    /// Size of a derivative of a coordinate.
    pub(super) fn size(&self, (coordinate, derivative): (usize, usize)) -> f64 {
        self.extents[coordinate].size * self.frequency.powi(derivative as i32)
    }
}

/// Sizes of all parameters, and a start about them; `number` tells starts apart.
pub(super) fn start(flow: &Flow<'_>, scales: &Scales, number: u64) -> Result<(Vec<f64>, Vec<f64>), EvalError> {
    let model = flow.model;
    let dims = model.dims();
    let mut random = ChaCha8Rng::seed_from_u64(number);
    let mut ten = |[from, to]: [f64; 2]| 10f64.powf(random.random_range(from..to));
    let frequency = scales.frequency * ten(OF_FREQUENCY);
    let extents: Vec<Extent> = (scales.extents.iter())
        .map(|own| Extent { size: own.size * own.drawn.map_or(1.0, &mut ten), ..*own })
        .collect();
    let columns = columns(flow, &extents, frequency, number)?;
    let mut sizes = vec![0.0_f64; dims.parameters];
    let mut forces = columns.force.clone();
    for _ in 0..PASSES {
        for (row, force) in forces.iter_mut().enumerate() {
            let column = |j: usize| columns.of[row * dims.parameters + j];
            if *force <= 0.0 {
                *force = (0..dims.parameters).map(|j| sizes[j] * column(j)).fold(0.0, f64::max);
            }
            for (j, size) in sizes.iter_mut().enumerate() {
                if *size <= 0.0 && *force > 0.0 && column(j) > 0.0 {
                    *size = *force / column(j);
                }
            }
        }
        // Rows that nothing drives, and that share nothing with a driven one, have a force of one.
        if sizes.iter().all(|size| *size <= 0.0) {
            forces.iter_mut().for_each(|force| *force = 1.0);
        }
    }
    let mut theta = Vec::with_capacity(sizes.len());
    for (j, size) in sizes.iter_mut().enumerate() {
        if let Some([from, to]) = model.parameter_interval(j) {
            *size = from.abs().max(to.abs());
            theta.push(random.random_range(from..=to));
            continue;
        }
        *size = if *size > 0.0 { *size } else { 1.0 };
        let negative = number % 2 == 1 && random.random_bool(NEGATIVE);
        let [from, to] = OF_PARAMETER;
        let value = *size * 10f64.powf(random.random_range(from..to));
        theta.push(if negative { -value } else { value });
    }
    Ok((sizes, theta))
}

/// Root mean squares at random motions.
struct Columns {
    /// Of every entry of the regressor.
    of: Vec<f64>,
    /// Of the known force and the inputs, by row.
    force: Vec<f64>,
}

fn columns(flow: &Flow<'_>, extents: &[Extent], frequency: f64, number: u64) -> Result<Columns, EvalError> {
    let model = flow.model;
    let dims = model.dims();
    let mut random = ChaCha8Rng::seed_from_u64(number ^ 0x5eed);
    let mut scratch = vec![0.0; model.workspace_len()];
    let (mut phi, mut known, mut map) =
        (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows], vec![0.0; dims.input_map_len()]);
    let mut sums = Columns { of: vec![0.0; dims.regressor_len()], force: vec![0.0; dims.rows] };
    let inputs: Vec<f64> =
        flow.signals.inputs.iter().map(|input| root_mean_square(input.value.iter().copied())).collect();
    for _ in 0..MOTIONS {
        let mut motion = vec![0.0; dims.motion_len()];
        for (c, own) in extents.iter().enumerate() {
            for d in 0..=model.coordinate_order(c) {
                let by = random.random_range(-1.7..1.7) * own.size * frequency.powi(d as i32);
                motion[d * dims.coordinates + c] = by + if d == 0 { own.mean } else { 0.0 };
            }
        }
        model.rows_under(&motion, &inputs, flow.constants, &mut scratch, (&mut phi, &mut known))?;
        model.input_map(&motion, flow.constants, &mut scratch, &mut map)?;
        sums.of.iter_mut().zip(&phi).for_each(|(sum, x)| *sum += x * x / MOTIONS as f64);
        for (row, sum) in sums.force.iter_mut().enumerate() {
            let applied: f64 = inputs.iter().enumerate().map(|(i, u)| (map[row * dims.inputs + i] * u).powi(2)).sum();
            *sum += (applied + known[row].powi(2)) / MOTIONS as f64;
        }
    }
    sums.of.iter_mut().chain(&mut sums.force).for_each(|sum| *sum = sum.sqrt());
    Ok(sums)
}

/// A state at the beginning of a block, from the first readings of every sensor.
pub(super) fn first_state(flow: &Flow<'_>, scales: &Scales, block: &Block) -> Vec<f64> {
    let sensor = |coordinate: usize, derivative: usize| {
        let of = |own: &Sensed| (own.coordinate, own.derivative) == (coordinate, derivative);
        flow.signals.sensors.iter().position(of)
    };
    let value = |&(c, d): &(usize, usize)| {
        if let Some(own) = sensor(c, d).filter(|_| d > 0) {
            return parabola(block, own).map_or(0.0, |[value, _]| value);
        }
        let own = scales.like[c].and_then(|like| sensor(like, 0)).and_then(|own| parabola(block, own));
        match own {
            Some(found) => found.get(d).copied().unwrap_or(0.0),
            None if d == 0 => scales.extents[c].mean,
            None => 0.0,
        }
    };
    flow.states.iter().map(value).collect()
}

/// Value and rate at the beginning of a block by a parabola through the first quarter of a sensor's readings.
fn parabola(block: &Block, sensor: usize) -> Option<[f64; 2]> {
    let own: Vec<_> = block.readings.iter().filter(|reading| reading.sensor == sensor).collect();
    let first = own.first()?;
    let count = own.len().min((own.len() / 4).max(LEAST_FITTED));
    let own = &own[..count];
    let span = own.last().map_or(0.0, |last| last.time - first.time);
    if count < LEAST_FITTED || span <= 0.0 {
        return Some([first.value, 0.0]);
    }
    let rows = DMatrix::from_fn(count, 3, |i, power| ((own[i].time - block.start) / span).powi(power as i32));
    let values = DVector::from_iterator(count, own.iter().map(|reading| reading.value));
    let found = rows.tr_mul(&rows).cholesky()?.solve(&rows.tr_mul(&values));
    Some([found[0], found[1] / span])
}
