//! What was recorded, each channel at its own times, and its division into blocks.

use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_numerics::through;

/// A silence of all channels is a break of the record when it is longer than so many usual steps.
const LEAST_BREAK: f64 = 20.0;
/// Channels have one clock where they share this share of the stamps of the one with fewer: stamps of whole milliseconds coincide by chance
/// in one of ten.
const SHARED_STAMPS: f64 = 0.25;
/// Smallest swing, as a share of a channel's deviation, whose turning back counts.
const LEAST_SWING: f64 = 0.02;

/// The readings or settings of one channel, at its own times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Channel {
    /// Stamps, s, ascending.
    pub time: Vec<f64>,
    /// One value per stamp, unit of the signal.
    pub value: Vec<f64>,
}

/// What a sensor reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensed {
    /// Coordinate that is read.
    pub coordinate: usize,
    /// Which derivative of it: 0 for the coordinate itself, 1 for its rate; the highest one of the model is told by the rows.
    pub derivative: usize,
    /// The readings.
    pub channel: Channel,
}

/// A record whose channels have times of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalsAsRecorded {
    /// The inputs of the model.
    pub inputs: Vec<Channel>,
    /// The sensors that there are.
    pub sensors: Vec<Sensed>,
    /// What inputs do between their stamps.
    pub hold: Hold,
}

/// A reading that a simulation is compared with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reading {
    pub(super) time: f64,
    pub(super) sensor: usize,
    pub(super) value: f64,
}

/// Part of a stretch that is simulated from a state of its own.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Block {
    /// When it begins, s.
    pub(super) start: f64,
    /// Its readings in the order of time.
    pub(super) readings: Vec<Reading>,
    /// Instants at which the integration has to stop: readings and, where inputs are held, their stamps.
    pub(super) instants: Vec<f64>,
}

/// Sensors whose stamps are their own: those of one clock, with its usual step.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Clock {
    /// Indices of the sensors.
    pub(super) sensors: Vec<usize>,
    /// Usual step between its stamps, s.
    pub(super) step: f64,
}

impl Channel {
    /// Whether two channels are stamped by one clock.
    fn shares_clock(&self, other: &Channel) -> bool {
        let (fewer, more) = if self.time.len() < other.time.len() { (self, other) } else { (other, self) };
        let shared = fewer
            .time
            .iter()
            .filter(|&&stamp| more.time[more.time.partition_point(|own| *own < stamp)..].first() == Some(&stamp));
        shared.count() as f64 >= SHARED_STAMPS * fewer.time.len() as f64
    }

    /// The usual step between its stamps.
    fn usual_step(&self) -> f64 {
        let mut steps: Vec<f64> = self.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let middle = steps.len() / 2;
        if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 }
    }

    /// Index of the last stamp that is not after a time; nothing before the first stamp.
    fn before(&self, time: f64) -> Option<usize> {
        self.time.partition_point(|stamp| *stamp <= time).checked_sub(1)
    }

    /// The value at a time: that of the last stamp, or the polynomial of third degree through the four stamps around.
    pub(super) fn at(&self, time: f64, hold: Hold) -> f64 {
        const NODES: usize = 4;
        let Some(k) = self.before(time) else { return self.value.first().copied().unwrap_or(0.0) };
        if hold == Hold::Zoh || k + 1 >= self.time.len() || self.time[k] >= time {
            return self.value[k];
        }
        if self.time.len() < NODES {
            let share = (time - self.time[k]) / (self.time[k + 1] - self.time[k]);
            return self.value[k] + share * (self.value[k + 1] - self.value[k]);
        }
        let first = k.saturating_sub(1).min(self.time.len() - NODES);
        let four = |of: &[f64]| -> [f64; NODES] { std::array::from_fn(|i| of[first + i]) };
        through(four(&self.time), four(&self.value), time)
    }

    /// The mean of what is held from one time to another.
    fn mean_between(&self, from: f64, to: f64) -> f64 {
        let Some(first) = self.before(from) else { return self.value.first().copied().unwrap_or(0.0) };
        let (mut sum, mut at, mut held) = (0.0, from, self.value[first]);
        for (&stamp, &value) in self.time.iter().zip(&self.value).skip(first + 1).take_while(|(stamp, _)| **stamp < to)
        {
            sum += held * (stamp - at);
            (at, held) = (stamp, value);
        }
        let end = if to.is_finite() { to } else { at };
        sum += held * (end - at);
        if end > from { sum / (end - from) } else { held }
    }

    fn mean(&self) -> f64 {
        self.value.iter().sum::<f64>() / self.value.len().max(1) as f64
    }

    /// Mean and standard deviation.
    pub(super) fn spread(&self) -> (f64, f64) {
        let mean = self.mean();
        let variance = self.value.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / self.value.len().max(1) as f64;
        (mean, variance.sqrt())
    }

    /// Angular frequency with which it crosses its mean, with a band of half its deviation about it so that noise is not counted; nothing
    /// where it does not.
    pub(super) fn frequency(&self) -> Option<f64> {
        let (mean, deviation) = self.spread();
        let duration = self.time.last()? - self.time.first()?;
        let (mut side, mut crossings) = (0, 0);
        for value in &self.value {
            let now = i32::from(value - mean > 0.5 * deviation) - i32::from(mean - value > 0.5 * deviation);
            if now != 0 && now != side {
                crossings += usize::from(side != 0);
                side = now;
            }
        }
        let found = std::f64::consts::PI * crossings.max(1) as f64 / duration;
        found.is_finite().then_some(found)
    }

    /// Angular frequency with which it turns back after a swing of some size: that of the fastest motion in it, which may be small beside the
    /// slow one.
    pub(super) fn turning_frequency(&self) -> Option<f64> {
        let least = LEAST_SWING * self.spread().1;
        let duration = self.time.last()? - self.time.first()?;
        // The farthest value in the direction of the motion, and that direction.
        let (mut farthest, mut side, mut turns) = (*self.value.first()?, 0.0_f64, 0_u32);
        for &value in &self.value {
            if side * (value - farthest) > 0.0 {
                farthest = value;
            } else if (value - farthest).abs() > least {
                turns += u32::from(side.abs() > 0.0);
                side = (value - farthest).signum();
                farthest = value;
            }
        }
        let found = std::f64::consts::PI * f64::from(turns.max(1)) / duration;
        found.is_finite().then_some(found)
    }
}

impl SignalsAsRecorded {
    /// Whether a sensor reads a coordinate itself.
    pub(super) fn reads(&self, coordinate: usize) -> Option<&Channel> {
        let own = self.sensors.iter().find(|sensor| sensor.coordinate == coordinate && sensor.derivative == 0);
        own.map(|sensor| &sensor.channel)
    }

    /// Clocks of sensors that are not the inputs': by how much one is late, a record of it alone tells. Without an input the first sensor's
    /// clock is that of the motion.
    pub(super) fn own_clocks(&self) -> Vec<Clock> {
        let references: Vec<&Channel> = if self.inputs.is_empty() {
            self.sensors.iter().take(1).map(|own| &own.channel).collect()
        } else {
            self.inputs.iter().collect()
        };
        let mut clocks: Vec<Clock> = Vec::new();
        for (s, own) in self.sensors.iter().enumerate() {
            if references.iter().any(|reference| reference.shares_clock(&own.channel)) {
                continue;
            }
            let step = own.channel.usual_step();
            if step <= 0.0 {
                continue;
            }
            let same = |clock: &&mut Clock| self.sensors[clock.sensors[0]].channel.shares_clock(&own.channel);
            match clocks.iter_mut().find(same) {
                Some(clock) => clock.sensors.push(s),
                None => clocks.push(Clock { sensors: vec![s], step }),
            }
        }
        clocks
    }

    /// Readings in all.
    pub(super) fn readings(&self) -> usize {
        self.sensors.iter().map(|sensor| sensor.channel.time.len()).sum()
    }

    /// The same record with instants that are not closer than `apart`: held inputs as their means between these instants, and of every sensor
    /// the first reading from each of them on. What changes within so short a time is lost.
    pub(super) fn coarser(&self, apart: f64) -> Self {
        let mut stamps: Vec<f64> = self.sensors.iter().flat_map(|own| own.channel.time.iter().copied()).collect();
        stamps.sort_by(f64::total_cmp);
        let mut grid: Vec<f64> = Vec::new();
        for stamp in stamps {
            if grid.last().is_none_or(|last| stamp - last >= apart * (1.0 - 1e-9)) {
                grid.push(stamp);
            }
        }
        let input = |own: &Channel| {
            if own.usual_step() >= apart {
                return own.clone();
            }
            let ends = grid.iter().skip(1).copied().chain([f64::INFINITY]);
            let value = |(&from, to): (&f64, f64)| match self.hold {
                Hold::Zoh => own.mean_between(from, to),
                Hold::None => own.at(from, self.hold),
            };
            let known = |from: &&f64| own.time.first().is_some_and(|first| first <= *from);
            let (time, value) =
                grid.iter().zip(ends).filter(|(from, _)| known(from)).map(|own| (*own.0, value(own))).unzip();
            Channel { time, value }
        };
        let thinned = |own: &Channel| {
            let (mut time, mut value, mut next) = (Vec::new(), Vec::new(), 0);
            for (&stamp, &reading) in own.time.iter().zip(&own.value) {
                if next < grid.len() && stamp >= grid[next] {
                    time.push(stamp);
                    value.push(reading);
                    next = grid.partition_point(|begin| *begin <= stamp);
                }
            }
            Channel { time, value }
        };
        let sensor = |own: &Sensed| Sensed { channel: thinned(&own.channel), ..own.clone() };
        Self {
            inputs: self.inputs.iter().map(input).collect(),
            sensors: self.sensors.iter().map(sensor).collect(),
            hold: self.hold,
        }
    }

    /// Whether every sensor reads something of the model's motion.
    pub(super) fn fit(&self, model: &dyn Model<f64>) -> bool {
        self.inputs.len() == model.dims().inputs
            && self.sensors.iter().all(|sensor| sensor.derivative <= model.coordinate_order(sensor.coordinate))
    }

    /// The readings in the order of time, from when all inputs are known, stretch by stretch: where all channels are silent for long, what
    /// happened is not known.
    pub(super) fn stretches(&self) -> Vec<Vec<Reading>> {
        let begins =
            self.inputs.iter().filter_map(|input| input.time.first()).fold(f64::NEG_INFINITY, |a, &b| a.max(b));
        let mut readings: Vec<Reading> = Vec::with_capacity(self.readings());
        for (sensor, own) in self.sensors.iter().enumerate() {
            let pairs = own.channel.time.iter().zip(&own.channel.value);
            readings.extend(pairs.map(|(&time, &value)| Reading { time, sensor, value }));
        }
        readings.retain(|reading| reading.time >= begins);
        readings.sort_by(|a, b| a.time.total_cmp(&b.time));
        let mut instants: Vec<f64> = readings.iter().map(|reading| reading.time).collect();
        instants.dedup();
        let mut steps: Vec<f64> = instants.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if steps.is_empty() {
            return Vec::new();
        }
        let middle = steps.len() / 2;
        let usual = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
        let silent = |from: f64, to: f64| {
            let said = |input: &Channel| input.before(to) != input.before(from);
            to - from > LEAST_BREAK * usual && !self.inputs.iter().any(said)
        };
        let mut stretches: Vec<Vec<Reading>> = Vec::new();
        for reading in readings {
            match stretches.last_mut() {
                Some(own) if own.last().is_none_or(|last| !silent(last.time, reading.time)) => own.push(reading),
                _ => stretches.push(vec![reading]),
            }
        }
        stretches
    }

    /// A stretch divided into blocks of about so many readings.
    pub(super) fn blocks(&self, stretch: &[Reading], readings: usize) -> Vec<Block> {
        let count = (stretch.len() / readings.max(1)).max(1);
        let bound = |i: usize| i * stretch.len() / count;
        (0..count).map(|i| self.block(&stretch[bound(i)..bound(i + 1)])).collect()
    }

    pub(super) fn block(&self, readings: &[Reading]) -> Block {
        let times = || readings.iter().map(|reading| reading.time);
        let (start, end) = match readings {
            [] => (0.0, 0.0),
            _ => (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max)),
        };
        let mut instants: Vec<f64> = readings.iter().map(|reading| reading.time).collect();
        if self.hold == Hold::Zoh {
            for input in &self.inputs {
                let from = input.time.partition_point(|stamp| *stamp <= start);
                let to = input.time.partition_point(|stamp| *stamp < end);
                instants.extend(&input.time[from..to.max(from)]);
            }
        }
        instants.sort_by(f64::total_cmp);
        instants.dedup();
        Block { start, readings: readings.to_vec(), instants }
    }
}

#[cfg(test)]
mod tests {
    use super::{Channel, Sensed, SignalsAsRecorded};
    use tpm_controller::harmonics::Hold;

    #[test]
    fn a_coarser_record_has_the_means_of_what_was_held() {
        let time: Vec<f64> = (0..12).map(f64::from).collect();
        let input =
            Channel { time: time.clone(), value: vec![1.0, 3.0, 5.0, 7.0, 0.0, 0.0, 8.0, 0.0, 2.0, 2.0, 2.0, 6.0] };
        let slow = Channel { time: vec![-1.0, 5.5], value: vec![4.0, 9.0] };
        let channel = Channel { time: time.clone(), value: time };
        let signals = SignalsAsRecorded {
            inputs: vec![input, slow.clone()],
            sensors: vec![Sensed { coordinate: 0, derivative: 0, channel }],
            hold: Hold::Zoh,
        };
        let coarse = signals.coarser(4.0);
        assert_eq!(coarse.sensors[0].channel.time, [0.0, 4.0, 8.0]);
        assert_eq!(coarse.sensors[0].channel.value, [0.0, 4.0, 8.0]);
        assert_eq!(coarse.inputs[0].value, [4.0, 2.0, 2.0], "means of four seconds each, the last one of three");
        assert_eq!(coarse.inputs[1], slow, "what changes more slowly stays as it is");
        assert_eq!(signals.coarser(0.5), signals);
    }
}
