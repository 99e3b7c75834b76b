//! A record beside its simulation: what settles over blocks of it, and what it then says of the parameters.

use crate::error::EstimateError;
use crate::information::Information;
use crate::recorded::colour::Colour;
use crate::recorded::flow::Flow;
use crate::recorded::signals::{Block, Reading, SignalsAsRecorded};
use crate::recorded::starts::{Pace, Scales, Unmeasured, first_state, start};
use crate::recorded::steps::{Course, Point, Settled, beside_others, beside_states};
use crate::result::{Estimate, LeastSquares};
use crate::scale::Scale;
use crate::sensor::Sensor;
use crate::settings::Settings;
use crate::verdict::{LARGE_RESIDUAL, ResidualOf};
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_motion::Plant;
use tpm_numerics::{DMatrix, patience, root_mean_square};

/// Starts that are tried, the steps that each makes before the best are chosen, how many are kept, the steps of
/// these before one is chosen, and steps until that one settles.
const STARTS: u64 = 24;
pub(super) const STEPS_TRIED: usize = 6;
const KEPT: usize = 4;
const STEPS_COMPARED: usize = 20;
const MOST_STEPS: usize = 60;
/// Blocks over which starts are tried, their length in cycles of the motion, and bounds of their readings: fewest per state of the model.
const BLOCKS_TRIED: usize = 6;
const CYCLES_TRIED: f64 = 0.75;
/// Starts are tried where the readings move by this share of what they do where they move most.
const MOVES: f64 = 0.3;
const LEAST_PER_STATE: usize = 6;
const MOST_TRIED: usize = 100;
/// Readings over which blocks grow, and those over which they settle at last; a longer record is simulated in blocks spread over it.
pub(super) const READINGS_GROWN: usize = 2_000;
pub(super) const READINGS_SETTLED: usize = 20_000;
/// How much longer blocks become from one stage to the next.
const GROWTH: usize = 4;
/// Blocks stay as long as they are where longer ones leave more than so many times the mean square: noise that acts on the machine, or
/// what the model lacks, then parts simulation and record.
const MOST_WORSE: f64 = 2.0;
/// Times that the sensors' noise is told from what is left.
const NOISE_PASSES: usize = 3;
/// Noise of a sensor before anything is known, and least noise, as shares of its deviation.
const FIRST_NOISE: f64 = 0.05;
const LEAST_NOISE: f64 = 1e-10;
/// Steps of the integration are halved until readings move by less than this share of their noise, so often at most.
const STEP_SETTLED: f64 = 0.02;
const MOST_HALVINGS: usize = 6;
/// Longest step of the integration at first, as a share of a cycle of the motion.
const FIRST_STEP: f64 = 0.02;
/// What is left of a sensor is explained where it is no more than so many times the noise that its readings show by themselves.
const MOST_OVER_NOISE: f64 = 3.0;
/// Factor by which a scale is moved to see whether it is one, and the largest change of the sum of squares, as a share of it, that says so.
const SCALED: f64 = 2.0;
const UNMOVED: f64 = 1e-4;
/// A direction of the parameters is not shown where it moves the readings by less than this share of what the others do.
const UNSHOWN: f64 = 1e-5;

/// What a record with its own times says.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RecordedFit {
    /// The estimate.
    pub estimate: Estimate,
    /// Readings that were compared with the simulation, and readings in the record.
    pub readings: usize,
    /// Readings in the record.
    pub of: usize,
    /// Blocks that were simulated, each from a state of its own.
    pub blocks: usize,
    /// Duration of the longest one, s.
    pub duration: f64,
    /// Standard deviation of what is left of every sensor, unit of what it reads.
    pub noise: Vec<f64>,
    /// What is left of every sensor, as a share of its deviation.
    pub shares: Vec<f64>,
    /// By how much the stamps of every sensor are late against those of the inputs, s, with the deviation; nothing where it has their stamps.
    pub late: Vec<Option<[f64; 2]>>,
    /// Noise that the readings of every sensor show by themselves, unit of what it reads.
    pub own_noise: Vec<f64>,
    /// Steps at the end.
    pub steps: usize,
    /// Longer blocks were followed much worse, so that these stayed as they are.
    pub(super) parted: bool,
    /// Residual with the inputs taken otherwise between their stamps; nothing where the simulation does not settle so.
    pub other_hold: Option<f64>,
}

/// Why a record with its own times gives no estimate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordedFault {
    /// The rows do not determine the motion, or a sensor reads none of its states.
    #[error(
        "the motion does not follow from the inputs: the model has not as many rows with derivatives as coordinates"
    )]
    NotSimulable,
    /// Fewer readings than unknowns.
    #[error(
        "the {readings} readings after the first value of every input are too few for {unknowns} unknowns: parameters, and the state at the beginning"
    )]
    TooFew {
        /// Readings.
        readings: usize,
        /// Unknowns.
        unknowns: usize,
    },
    /// No start leads to a motion that stays near the record.
    #[error(
        "from none of {starts} starts does the simulated motion follow the record; state a prior near the values, or hold parameters that are known"
    )]
    NotFollowed {
        /// Starts that were tried.
        starts: u64,
    },
    /// The simulation did not settle.
    #[error("the simulation did not settle on parameters in {steps} steps")]
    NotSettled {
        /// Steps that were made.
        steps: usize,
    },
    /// Whoever waits for the result did not wait so long.
    #[error("the time that it was given was over before the simulation had settled on parameters")]
    Ended,
    /// Settings that do not fit the model.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
}

/// Everything that does not change from stage to stage.
pub(super) struct Work<'a, 'f> {
    pub(super) flow: Flow<'f>,
    pub(super) scales: Scales,
    pub(super) stretches: Vec<Vec<Reading>>,
    free: Vec<usize>,
    /// What steps move: the free parameters, and behind them by how much every clock is late.
    unknowns: Vec<usize>,
    bounds: Vec<[f64; 2]>,
    /// How much shorter the first blocks are than the motion suggests.
    pub(super) shorter: usize,
    settings: &'a Settings,
}

impl RecordedFit {
    /// [`explains`](Self::explains) of all sensors.
    pub(super) fn explains_all(&self) -> bool {
        (0..self.noise.len()).all(|sensor| self.explains(sensor))
    }

    /// Whether what is left of a sensor may be the noise that its readings show by themselves.
    #[must_use]
    pub fn explains(&self, sensor: usize) -> bool {
        is_noise(self.noise[sensor], self.own_noise[sensor])
    }

    /// Whether it leaves less than another fit. Blocks that stay short are followed by more models than the right one, since each begins from
    /// a state of its own: that they leave less says nothing against a fit that explains most of the record over longer ones.
    pub(super) fn explains_more_than(&self, other: &Self) -> bool {
        let (own, left) = (self.estimate.residual, other.estimate.residual);
        let shorter = self.parted && self.duration < other.duration;
        own < left && (!shorter || left > LARGE_RESIDUAL)
    }

    /// Whether what settled over whole stretches is handed out rather than what settled over blocks. Where something is lacking even over short
    /// blocks, these say least of slow motions: what leaves least of whole stretches follows another record better.
    pub(super) fn is_preferred_to(&self, blocks: &Self) -> bool {
        let leaves_less = self.estimate.residual < blocks.estimate.residual;
        match (blocks.explains_all(), self.explains_all()) {
            (true, whole) => whole && leaves_less,
            (false, _) => blocks.parted || leaves_less,
        }
    }
}

/// Blocks that have grown as far as the simulation follows them, with what settled over them.
pub(super) struct Grown {
    blocks: Vec<Block>,
    pub(super) settled: Settled,
    pub(super) noise: Vec<f64>,
    /// Longer ones were followed much worse.
    pub(super) parted: bool,
}

/// What is left of every sensor at a point, as a sum of squares in the unit of what it reads, and the number of its readings. A block whose
/// motion leaves all bounds does not count; of a point at which steps have settled there is none.
fn squares(flow: &Flow<'_>, blocks: &[Block], point: &Point, noise: &[f64]) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0.0); noise.len()];
    for (block, state) in blocks.iter().zip(&point.states) {
        let Ok(left) = flow.left(block, &point.theta, state, noise) else { continue };
        for (reading, e) in block.readings.iter().zip(left) {
            sums[reading.sensor].0 += (e * noise[reading.sensor]).powi(2);
            sums[reading.sensor].1 += 1.0;
        }
    }
    sums
}

/// Whether what is left of a sensor may be the noise that its readings show by themselves.
fn is_noise(left: f64, own: f64) -> bool {
    left <= MOST_OVER_NOISE * own
}

/// Noise of every sensor before anything is known, unit of what it reads.
pub(super) fn first_noise(signals: &SignalsAsRecorded) -> Vec<f64> {
    signals.sensors.iter().map(|own| FIRST_NOISE * spread(own.channel.spread().1)).collect()
}

/// A deviation that is not zero.
pub(super) fn spread(deviation: f64) -> f64 {
    if deviation > 0.0 { deviation } else { 1.0 }
}

/// Directions of the parameters that the rows do not show, as many as are known or those that move them by next to nothing.
fn hidden(rows: &DMatrix<f64>, unshown: Option<usize>) -> Vec<Vec<f64>> {
    let p = rows.ncols();
    let norms: Vec<f64> = (0..p).map(|j| spread(rows.column(j).norm())).collect();
    let normal = rows.tr_mul(rows);
    let scaled = DMatrix::from_fn(p, p, |i, j| normal[(i, j)] / (norms[i] * norms[j]));
    let found = scaled.symmetric_eigen();
    let mut order: Vec<usize> = (0..p).collect();
    order.sort_by(|&a, &b| found.eigenvalues[a].total_cmp(&found.eigenvalues[b]));
    let least = UNSHOWN * UNSHOWN * order.last().map_or(0.0, |&last| found.eigenvalues[last]);
    let count = unshown.unwrap_or(0).max(order.iter().filter(|&&i| found.eigenvalues[i] < least).count()).min(p);
    let direction = |&i: &usize| (0..p).map(|j| found.eigenvectors[(j, i)] / norms[j]).collect();
    order[..count].iter().map(direction).collect()
}

impl<'a, 'f> Work<'a, 'f> {
    /// A model with the record that it is compared with; `free` are the parameters to be found.
    pub(super) fn new(
        (model, constants): (&'f dyn Model<f64>, &'f [f64]),
        signals: &'f SignalsAsRecorded,
        begins: (Pace, Unmeasured),
        free: Vec<usize>,
        settings: &'a Settings,
    ) -> Result<Self, RecordedFault> {
        let dims = model.dims();
        let orders: Vec<usize> = (0..dims.coordinates).map(|c| model.coordinate_order(c)).collect();
        if dims.rows != dims.coordinates || orders.iter().all(|order| *order == 0) || !signals.fit(model) {
            return Err(RecordedFault::NotSimulable);
        }
        let states: Vec<(usize, usize)> =
            orders.iter().enumerate().flat_map(|(c, &order)| (0..order).map(move |d| (c, d))).collect();
        let scales = Scales::of(model, signals, begins);
        let sizes = states.iter().map(|&state| scales.size(state)).collect();
        let longest_step = FIRST_STEP * std::f64::consts::TAU / scales.frequency;
        let jumps = Plant::new(model, &vec![1.0; dims.parameters], constants).map_err(EstimateError::Model)?.rubs();
        let told = signals.sensors.iter().map(|own| own.derivative == orders[own.coordinate]).collect();
        let clocks = signals.own_clocks();
        let flow = Flow { model, constants, signals, states, sizes, longest_step, jumps, told, clocks };
        let unbounded = [f64::NEG_INFINITY, f64::INFINITY];
        let mut bounds: Vec<[f64; 2]> =
            (0..dims.parameters).map(|j| model.parameter_interval(j).unwrap_or(unbounded)).collect();
        // A channel that is late by more than a step of its own would have been given the next stamp.
        bounds.extend(flow.clocks.iter().map(|clock| [-clock.step, clock.step]));
        let unknowns =
            free.iter().copied().chain((0..flow.clocks.len()).map(|clock| dims.parameters + clock)).collect();
        Ok(Self { flow, scales, stretches: signals.stretches(), free, unknowns, bounds, shorter: 1, settings })
    }

    pub(super) fn course<'w>(&'w self, blocks: &'w [Block], typical: &'w [f64]) -> Course<'w, 'f> {
        Course { flow: &self.flow, blocks, free: &self.unknowns, typical, bounds: &self.bounds, quick: false }
    }

    /// What the record says where blocks have settled.
    pub(super) fn fit(
        &self,
        grown: Grown,
        typical: &[f64],
        unshown: Option<usize>,
    ) -> Result<RecordedFit, RecordedFault> {
        let Grown { blocks, settled, noise, parted } = grown;
        let (model, signals) = (self.flow.model, self.flow.signals);
        let (dims, free) = (model.dims(), self.settings.free(model.dims().parameters)?);
        let course = self.course(&blocks, typical);
        let linear = course
            .linearised(&settled.point, &noise)
            .map_err(|_| RecordedFault::NotSettled { steps: settled.steps })?;
        let (theta, late) = settled.point.theta.split_at(dims.parameters);
        let steps: Vec<f64> = self.flow.clocks.iter().map(|clock| clock.step).collect();
        let beside = beside_states(&linear, &self.flow.sizes);
        let late = self.late(late, &beside, &steps);
        let beside = beside_others(beside, self.free.len(), &steps);
        let left: Vec<&Vec<f64>> = linear.iter().map(|own| &own.left).collect();
        let readings: usize = left.iter().map(|own| own.len()).sum();
        // 1. What is shown, and values that are least squares.
        let p = self.free.len();
        let values: Vec<f64> = free.of(theta);
        let mut rows = DMatrix::zeros(readings, p + 1);
        let mut at = 0;
        for (own, left) in beside.iter().zip(&left) {
            rows.view_mut((at, 0), (own.nrows(), p)).copy_from(own);
            for (k, left) in left.iter().enumerate() {
                let fitted: f64 = (0..p).map(|j| own[(k, j)] * values[j]).sum();
                rows[(at + k, p)] = fitted + left;
            }
            at += own.nrows();
        }
        let hidden = hidden(&rows.columns(0, p).into_owned(), unshown);
        let known: Vec<Vec<f64>> =
            self.settings.hidden.iter().map(|direction| free.of(direction)).chain(hidden).collect();
        let information = Information::of(rows);
        let scaled = information.scaled();
        let solved = scaled.solve(&values, None, &known);
        // 2. Deviations with the colour of what is left.
        let freedom = readings as f64 / (readings as f64 - (p + blocks.len() * self.flow.states.len()) as f64).max(1.0);
        let mut square = DMatrix::zeros(p, p);
        for sensor in 0..signals.sensors.len() {
            let of_sensor = |block: &Block| -> Vec<usize> {
                (0..block.readings.len()).filter(|&k| block.readings[k].sensor == sensor).collect()
            };
            let places: Vec<Vec<usize>> = blocks.iter().map(of_sensor).collect();
            let series: Vec<Vec<f64>> =
                places.iter().zip(&left).map(|(places, left)| places.iter().map(|&k| left[k]).collect()).collect();
            let colour = Colour::of(&series);
            for (places, own) in places.iter().zip(&beside) {
                square += colour.square(own.select_rows(places)) * freedom;
            }
        }
        let covariance = &solved.covariance * square * &solved.covariance;
        // 3. The result.
        let sensors = signals.sensors.len();
        let shares: Vec<f64> = (0..sensors)
            .map(|s| {
                let own = blocks.iter().zip(&left).flat_map(|(block, left)| {
                    block.readings.iter().zip(left.iter()).filter(|(r, _)| r.sensor == s).map(|(_, e)| *e)
                });
                root_mean_square(own) * noise[s] / spread(signals.sensors[s].channel.spread().1)
            })
            .collect();
        let felt = |j: usize| {
            let Some(at) = self.free.iter().position(|&own| own == j) else { return 0.0 };
            let sum: f64 = beside.iter().map(|own| own.column(at).norm_squared()).sum();
            let sizes = (0..sensors).map(|s| spread(signals.sensors[s].channel.spread().1) / noise[s]);
            (sum / readings as f64).sqrt() / sizes.fold(f64::INFINITY, f64::min)
        };
        let felt: Vec<f64> = (0..dims.parameters).map(felt).collect();
        let found = LeastSquares {
            values: theta.to_vec(),
            covariance: free.spread_square(&covariance),
            hidden: &solved.unobservable,
            touched: &scaled.touched(&solved.unobservable),
            rank: solved.rank,
            condition: scaled.condition(&known),
            row_residuals: &shares,
            felt: &felt,
        };
        let mut estimate = Estimate { residual_of: ResidualOf::Motion, ..Estimate::of_rows(&free, found) };
        // Along a scale the motion stays as it is where the states of what is not measured go with it.
        let is_scale = |scale: &Scale| {
            let mut point = settled.point.clone();
            scale.multiply(&mut point.theta, SCALED);
            let moved = self.held(&blocks, typical).settle(point, &noise, MOST_STEPS);
            moved.is_some_and(|moved| (moved.cost - settled.cost).abs() <= UNMOVED * settled.cost)
        };
        let scales = (0..estimate.unobservable.len()).filter_map(|direction| estimate.scale_of(direction));
        estimate.scales = scales.filter(is_scale).collect();
        let duration = |block: &Block| block.instants.last().map_or(0.0, |last| last - block.start);
        Ok(RecordedFit {
            other_hold: self.with_other_hold(&blocks, typical, &settled.point, &noise),
            estimate,
            readings,
            of: self.readings(),
            blocks: blocks.len(),
            duration: blocks.iter().map(duration).fold(0.0, f64::max),
            noise,
            shares,
            late,
            own_noise: self.own_noise(),
            steps: settled.steps,
            parted,
        })
    }

    /// A course on which the states alone move.
    pub(super) fn held<'w>(&'w self, blocks: &'w [Block], typical: &'w [f64]) -> Course<'w, 'f> {
        Course { free: &[], ..self.course(blocks, typical) }
    }

    /// By how much the stamps of every sensor are late, with the deviation, by the derivatives `beside` what initial states take.
    fn late(&self, late: &[f64], beside: &[DMatrix<f64>], steps: &[f64]) -> Vec<Option<[f64; 2]>> {
        let p = self.unknowns.len();
        let mut normal = DMatrix::zeros(p, p);
        beside.iter().for_each(|own| normal += own.tr_mul(own));
        steps
            .iter()
            .enumerate()
            .for_each(|(clock, step)| normal[(self.free.len() + clock, self.free.len() + clock)] += step.powi(-2));
        let covariance = normal.try_inverse();
        let deviation = |clock: usize| {
            let at = self.free.len() + clock;
            covariance.as_ref().map_or(steps[clock], |own| own[(at, at)].max(0.0).sqrt())
        };
        let of = |sensor: usize| {
            let clock = self.flow.clocks.iter().position(|clock| clock.sensors.contains(&sensor))?;
            Some([late[clock], deviation(clock)])
        };
        (0..self.flow.signals.sensors.len()).map(of).collect()
    }

    /// Blocks of about so many readings, of which as many as have `most` readings in all, spread over the record; only those in which the
    /// readings of a sensor move by a share of what they do where they move most. A machine at rest says little of what moves it, and a rest
    /// that begins from a state of its own draws its friction anywhere.
    pub(super) fn blocks(&self, length: usize, most: usize) -> Vec<Block> {
        let sensors = self.flow.signals.sensors.len();
        let range = |block: &Block, sensor: usize| {
            let own = block.readings.iter().filter(|reading| reading.sensor == sensor).map(|reading| reading.value);
            let (least, largest) =
                own.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), value| (a.min(value), b.max(value)));
            (largest - least).max(0.0)
        };
        let blocks = self.stretches.iter().flat_map(|stretch| self.flow.signals.blocks(stretch, length.min(most)));
        let mut all: Vec<Block> = blocks.filter(|block| block.readings.len() > self.flow.states.len()).collect();
        let farthest: Vec<f64> =
            (0..sensors).map(|s| all.iter().map(|block| range(block, s)).fold(0.0, f64::max)).collect();
        all.retain(|block| (0..sensors).any(|s| range(block, s) >= MOVES * farthest[s]));
        let typical = all.iter().map(|block| block.readings.len()).max().unwrap_or(1);
        let wanted = (most / typical).clamp(1, all.len().max(1));
        let stride = all.len() as f64 / wanted as f64;
        let mut kept = 0;
        all.into_iter()
            .enumerate()
            .filter(|(i, _)| {
                let keep = kept < wanted && *i >= (kept as f64 * stride) as usize;
                kept += usize::from(keep);
                keep
            })
            .map(|(_, block)| block)
            .collect()
    }

    /// Readings of the blocks over which starts are tried.
    pub(super) fn first_length(&self) -> usize {
        let readings = self.readings();
        let span = |stretch: &Vec<Reading>| stretch[stretch.len() - 1].time - stretch[0].time;
        let whole: f64 = self.stretches.iter().map(span).sum();
        let cycle = std::f64::consts::TAU / self.scales.frequency;
        let own = (CYCLES_TRIED * cycle / whole * readings as f64).ceil() as usize;
        (own / self.shorter).min(readings / BLOCKS_TRIED).max(LEAST_PER_STATE * self.flow.states.len())
    }

    /// The best of many starts over short blocks, with the size of every parameter and the noise that is left.
    pub(super) fn begun(&self, noise: &[f64]) -> Result<(Vec<f64>, Settled, Vec<f64>), RecordedFault> {
        let length = self.first_length();
        let mut blocks = self.blocks(length, length * BLOCKS_TRIED);
        for block in &mut blocks {
            let mut times: Vec<f64> = block.readings.iter().map(|reading| reading.time).collect();
            times.dedup();
            let stride = times.len().div_ceil(MOST_TRIED);
            let kept: Vec<f64> = times.into_iter().step_by(stride).collect();
            block.readings.retain(|reading| kept.binary_search_by(|time| time.total_cmp(&reading.time)).is_ok());
            *block = self.flow.signals.block(&block.readings);
        }
        let states: Vec<Vec<f64>> = blocks.iter().map(|block| first_state(&self.flow, &self.scales, block)).collect();
        let mut tried: Vec<(Vec<f64>, Settled)> = Vec::new();
        for number in 0..STARTS {
            let (typical, theta) = self.start(number)?;
            let course = self.course(&blocks, &typical);
            if let Some(settled) = course.settle(Point { theta, states: states.clone() }, noise, STEPS_TRIED) {
                tried.push((typical, settled));
            }
        }
        tried.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        tried.truncate(KEPT);
        let settle = |(typical, settled): (Vec<f64>, Settled)| {
            let course = Course { quick: true, ..self.course(&blocks, &typical) };
            let found = course.settle(settled.point, noise, STEPS_COMPARED)?;
            Some((typical, found))
        };
        let best = tried.into_iter().filter_map(settle).min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        let best = best.and_then(|(typical, found)| {
            let settled = self.course(&blocks, &typical).settle(found.point, noise, MOST_STEPS)?;
            Some((typical, settled))
        });
        let (typical, settled) = best.ok_or(RecordedFault::NotFollowed { starts: STARTS })?;
        let noise = self.noise(&blocks, &settled.point, noise);
        Ok((typical, settled, noise))
    }

    /// Lets blocks grow to whole stretches, as far as longer ones are followed as well.
    pub(super) fn grown(&mut self, typical: &[f64], first: Settled, noise: Vec<f64>) -> Result<Grown, RecordedFault> {
        let longest = self.longest();
        let mut length = self.first_length();
        let mut theta = first.point.theta;
        let mut best: Option<(usize, Vec<f64>, Vec<f64>, f64)> = None;
        let mut noise = noise;
        let parted = loop {
            let blocks = self.blocks(length, READINGS_GROWN.max(length.min(READINGS_SETTLED)));
            self.refine_step(&blocks, &theta, &noise);
            let found = self.settled(&blocks, typical, &theta, &noise);
            let left = |settled: &Settled, noise: &[f64]| -> f64 {
                let now = self.noise(&blocks, &settled.point, noise);
                let shares = now.iter().zip(&self.flow.signals.sensors);
                root_mean_square(shares.map(|(now, own)| now / spread(own.channel.spread().1))).powi(2)
            };
            let Some(settled) = found else { break true };
            let mean_square = left(&settled, &noise);
            if best.as_ref().is_some_and(|(.., other)| mean_square > MOST_WORSE * other) {
                break true;
            }
            noise = self.noise(&blocks, &settled.point, &noise);
            theta.clone_from(&settled.point.theta);
            best = Some((length, theta.clone(), noise.clone(), mean_square));
            if length >= longest.min(READINGS_SETTLED) || patience::is_over() {
                break false;
            }
            length = (length * GROWTH).min(longest);
        };
        let (length, theta, noise, _) = best.ok_or(RecordedFault::NotFollowed { starts: STARTS })?;
        let found = self.over(length, typical, &theta, &noise)?;
        if patience::is_over() { Err(RecordedFault::Ended) } else { Ok(Grown { parted, ..found }) }
    }

    /// Readings of all stretches.
    pub(super) fn readings(&self) -> usize {
        self.stretches.iter().map(Vec::len).sum()
    }

    /// Readings of the longest stretch.
    pub(super) fn longest(&self) -> usize {
        self.stretches.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// The unknowns that the record has to tell at least: free parameters, and one state.
    pub(super) fn least_unknowns(&self) -> usize {
        self.free.len() + self.flow.states.len()
    }

    /// Noise that the readings of every sensor show by themselves, unit of what it reads.
    fn own_noise(&self) -> Vec<f64> {
        self.flow.signals.sensors.iter().map(|own| Sensor::of(&[&own.channel.value]).noise).collect()
    }

    /// Whether the noise of every sensor is no more than what its readings show by themselves.
    pub(super) fn explained(&self, noise: &[f64]) -> bool {
        noise.iter().zip(self.own_noise()).all(|(noise, own)| is_noise(*noise, own))
    }

    /// What settles over blocks of one length, with the noise that is left.
    pub(super) fn over(
        &mut self,
        length: usize,
        typical: &[f64],
        theta: &[f64],
        noise: &[f64],
    ) -> Result<Grown, RecordedFault> {
        let blocks = self.blocks(length, READINGS_SETTLED);
        let mut noise = noise.to_vec();
        let mut settled =
            self.settled(&blocks, typical, theta, &noise).ok_or(RecordedFault::NotFollowed { starts: STARTS })?;
        for _ in 0..NOISE_PASSES {
            noise = self.noise(&blocks, &settled.point, &noise);
            self.refine_step(&blocks, &settled.point.theta, &noise);
            let course = self.course(&blocks, typical);
            let steps = settled.steps;
            settled = course.settle(settled.point, &noise, MOST_STEPS).ok_or(RecordedFault::NotSettled { steps })?;
        }
        match settled.done {
            true => Ok(Grown { blocks, settled, noise, parted: false }),
            false if patience::is_over() => Err(RecordedFault::Ended),
            false => Err(RecordedFault::NotSettled { steps: settled.steps }),
        }
    }

    /// Sizes of all that steps move, and a start about them; the first one is the prior where one is stated.
    pub(super) fn start(&self, number: u64) -> Result<(Vec<f64>, Vec<f64>), EstimateError> {
        let (mut typical, mut theta) = start(&self.flow, &self.scales, number).map_err(EstimateError::Model)?;
        if number == 0 && self.settings.prior.iter().any(|value| value.abs() > 0.0) {
            let stated = self.settings.prior.iter().enumerate().filter(|(_, value)| value.abs() > 0.0);
            stated.for_each(|(j, value)| theta[j] = *value);
        }
        self.settings.hold(&mut theta);
        typical.extend(self.flow.clocks.iter().map(|clock| clock.step));
        theta.extend(self.flow.clocks.iter().map(|_| 0.0));
        Ok((typical, theta))
    }

    /// The states of blocks with given parameters, and then all together.
    fn settled(&self, blocks: &[Block], typical: &[f64], theta: &[f64], noise: &[f64]) -> Option<Settled> {
        let states = blocks.iter().map(|block| first_state(&self.flow, &self.scales, block)).collect();
        let from = self.held(blocks, typical).settle(Point { theta: theta.to_vec(), states }, noise, STEPS_TRIED)?;
        self.course(blocks, typical).settle(from.point, noise, MOST_STEPS)
    }

    /// The noise of every sensor as it is left.
    pub(super) fn noise(&self, blocks: &[Block], point: &Point, noise: &[f64]) -> Vec<f64> {
        let sums = squares(&self.flow, blocks, point, noise);
        let readings: f64 = sums.iter().map(|(_, count)| count).sum();
        let unknowns = (self.unknowns.len() + blocks.len() * self.flow.states.len()) as f64;
        let freedom = readings / (readings - unknowns).max(1.0);
        let of = |(s, &(sum, count)): (usize, &(f64, f64))| {
            let least = LEAST_NOISE * spread(self.flow.signals.sensors[s].channel.spread().1);
            (sum / f64::max(count, 1.0) * freedom).sqrt().max(least)
        };
        sums.iter().enumerate().map(of).collect()
    }

    /// Halves the steps of the integration until that moves no reading.
    pub(super) fn refine_step(&mut self, blocks: &[Block], theta: &[f64], noise: &[f64]) {
        let Some(block) = blocks.iter().max_by_key(|block| block.readings.len()) else { return };
        let state = first_state(&self.flow, &self.scales, block);
        for _ in 0..MOST_HALVINGS {
            let coarse = self.flow.left(block, theta, &state, noise);
            let before = self.flow.longest_step;
            self.flow.longest_step = 0.5 * before;
            match (coarse, self.flow.left(block, theta, &state, noise)) {
                (Ok(coarse), Ok(fine)) => {
                    let moved = root_mean_square(coarse.iter().zip(&fine).map(|(a, b)| a - b));
                    if moved <= STEP_SETTLED {
                        self.flow.longest_step = before;
                        return;
                    }
                }
                (Ok(_), Err(_)) => {
                    self.flow.longest_step = before;
                    return;
                }
                (Err(_), _) => {}
            }
        }
    }

    /// What is left, as a share of the motion, with the inputs taken otherwise between their stamps.
    fn with_other_hold(&self, blocks: &[Block], typical: &[f64], point: &Point, noise: &[f64]) -> Option<f64> {
        let held = &self.flow.signals;
        if held.inputs.is_empty() {
            return None;
        }
        let other = if held.hold == Hold::Zoh { Hold::None } else { Hold::Zoh };
        let signals = SignalsAsRecorded { hold: other, ..(*held).clone() };
        let (states, sizes, told) = (self.flow.states.clone(), self.flow.sizes.clone(), self.flow.told.clone());
        let clocks = self.flow.clocks.clone();
        let flow = Flow { signals: &signals, states, sizes, told, clocks, ..self.flow };
        let blocks: Vec<Block> = blocks.iter().map(|block| signals.block(&block.readings)).collect();
        let course =
            Course { flow: &flow, blocks: &blocks, free: &self.unknowns, typical, bounds: &self.bounds, quick: false };
        let settled = course.settle(point.clone(), noise, STEPS_TRIED)?;
        let sums = squares(&flow, &blocks, &settled.point, noise);
        let share = |(s, &(sum, count)): (usize, &(f64, f64))| {
            (sum / f64::max(count, 1.0)).sqrt() / spread(signals.sensors[s].channel.spread().1)
        };
        Some(root_mean_square(sums.iter().enumerate().map(share)))
    }
}
