//! What was recorded, each channel at its own times, and the instants at which the motion is estimated.

use crate::local;
use crate::output_error::beside_counts;
use crate::recorded::Channel;
use tpm_controller::harmonics::Hold;
use tpm_motion::equal_rounding_runs;
use tpm_numerics::{root_mean_square, tolerance};

/// Stamps through which an input that is not held is interpolated: the polynomial of the fifth degree.
const INTERPOLATED: usize = 6;

/// What a sensor reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Coordinate that is read.
    pub coordinate: usize,
    /// Which derivative of it: 0 for the coordinate itself, 1 for its rate.
    pub derivative: usize,
    /// The readings.
    pub channel: Channel,
    /// Variance of every reading as the sensor states it: its white noise, and the rounding to counts where there is any.
    pub variance: Vec<f64>,
    /// Whether the variance is that of counts, which the readings of a motion that repeats do not show: it is never taken smaller.
    pub counted: bool,
}

/// A record whose channels have times of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// The inputs of the model.
    pub inputs: Vec<Channel>,
    /// The sensors that there are.
    pub sensors: Vec<Reading>,
    /// What inputs do between their stamps.
    pub hold: Hold,
    /// Times from which on the motion does not follow from what was before, s, ascending.
    pub breaks: Vec<f64>,
}

/// What is known of a sensor that reads at even stamps.
#[derive(Clone, Copy, Debug)]
pub struct Evenly {
    /// White noise of its readings by their differences: a standard deviation.
    pub white: f64,
    /// Step of its readings; zero where they lie on no grid.
    pub step: f64,
    /// Samples on either side of a sample over which a polynomial follows its motion.
    pub reach: usize,
    /// Times that one and the same motion is recorded; one where nothing repeats.
    pub copies: f64,
}

impl Reading {
    /// A sensor with the noise that is seen in its readings. Readings whose rounding errors are alike are one reading, and readings that repeat
    /// are those of one repetition. `joins` are the samples at which another stretch begins.
    #[must_use]
    pub fn evenly((coordinate, derivative): (usize, usize), channel: Channel, joins: &[usize], known: Evenly) -> Self {
        let values = &channel.value;
        let least = (tolerance::READING * root_mean_square(values.iter().copied())).powi(2).max(f64::MIN_POSITIVE);
        let own = beside_counts(known.white, known.step).filter(|_| derivative == 0);
        let Some(own) = own else {
            let variance = vec![known.white.powi(2).max(least); values.len()];
            return Reading { coordinate, derivative, channel, variance, counted: false };
        };
        let rounded = known.step * known.step / 12.0;
        let mut motion = Vec::with_capacity(values.len());
        let ends = joins.iter().copied().chain([values.len()]);
        let mut from = 0;
        for to in ends {
            let half = known.reach.max(3).min((to - from).saturating_sub(1) / 2);
            let smooth = local::derivatives(&values[from..to], 1.0, half, 0, 1);
            motion.extend(smooth.unwrap_or_else(|| values[from..to].to_vec()));
            from = to;
        }
        let mut variance = Vec::with_capacity(values.len());
        for length in equal_rounding_runs(&motion, known.step) {
            let own = (rounded * length as f64 + own) * known.copies.max(1.0);
            variance.extend(std::iter::repeat_n(own.max(least), length));
        }
        Reading { coordinate, derivative, channel, variance, counted: true }
    }
}

/// One reading at an instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct At {
    pub(super) sensor: usize,
    pub(super) value: f64,
    /// Variance that the sensor states.
    pub(super) variance: f64,
}

/// The instants at which there are readings, and which part of every input belongs to which of them.
#[derive(Clone, Debug)]
pub(super) struct Instants {
    pub(super) time: Vec<f64>,
    /// Whether the motion at an instant does not follow from that at the one before.
    pub(super) begins: Vec<bool>,
    /// The readings of every instant.
    pub(super) readings: Vec<Vec<At>>,
    /// Per input and block: first and last stamp that say something of the block.
    spans: Vec<Vec<(usize, usize)>>,
    /// Block of every instant.
    block: Vec<usize>,
    /// The usual time between two instants, s.
    pub(super) usual_step: f64,
}

impl Record {
    /// Readings in all.
    #[must_use]
    pub fn readings(&self) -> usize {
        self.sensors.iter().map(|sensor| sensor.channel.time.len()).sum()
    }

    /// The instants at which anything was read.
    pub(super) fn instants(&self) -> Instants {
        let mut all: Vec<(f64, At)> = Vec::with_capacity(self.readings());
        for (sensor, own) in self.sensors.iter().enumerate() {
            let pairs = own.channel.time.iter().zip(&own.channel.value).zip(&own.variance);
            all.extend(pairs.map(|((&time, &value), &variance)| (time, At { sensor, value, variance })));
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut instants = Instants {
            time: Vec::new(),
            begins: Vec::new(),
            readings: Vec::new(),
            spans: Vec::new(),
            block: Vec::new(),
            usual_step: 0.0,
        };
        let mut begun = 0;
        for (time, at) in all {
            if instants.time.last() == Some(&time) {
                instants.readings.last_mut().into_iter().for_each(|own| own.push(at));
                continue;
            }
            let passed = self.breaks.partition_point(|own| *own <= time);
            let begins = instants.time.is_empty() || passed > begun;
            begun = passed;
            let block = instants.block.last().map_or(0, |last| last + usize::from(begins));
            instants.time.push(time);
            instants.begins.push(begins);
            instants.readings.push(vec![at]);
            instants.block.push(block);
        }
        let blocks = instants.block.last().map_or(0, |last| last + 1);
        let ends: Vec<(f64, f64)> = (0..blocks)
            .map(|block| {
                let from = instants.block.partition_point(|own| *own < block);
                let to = instants.block.partition_point(|own| *own <= block);
                (instants.time[from], instants.time[to - 1])
            })
            .collect();
        let span = |input: &Channel, (from, to): (f64, f64)| {
            let last = input.time.len().saturating_sub(1);
            let first = input.time.partition_point(|stamp| *stamp <= from).saturating_sub(1);
            (first.min(last), input.time.partition_point(|stamp| *stamp < to).min(last))
        };
        let mut steps: Vec<f64> =
            (0..instants.len()).filter(|&k| instants.goes_on(k)).map(|k| instants.after(k)).collect();
        let middle = steps.len() / 2;
        instants.usual_step =
            if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 };
        instants.spans = self.inputs.iter().map(|input| ends.iter().map(|ends| span(input, *ends)).collect()).collect();
        instants
    }
}

impl Instants {
    pub(super) fn len(&self) -> usize {
        self.time.len()
    }

    /// Time from an instant to the next one, s.
    pub(super) fn after(&self, k: usize) -> f64 {
        self.time[k + 1] - self.time[k]
    }

    /// Whether the motion after an instant leads to the next one.
    pub(super) fn goes_on(&self, k: usize) -> bool {
        k + 1 < self.len() && !self.begins[k + 1]
    }

    /// An input, and how fast it changes, at a time of the block of instant k. `piece` is where it was asked for last.
    pub(super) fn input(
        &self,
        (input, channel): (usize, &Channel),
        hold: Hold,
        (k, time): (usize, f64),
        piece: &mut Piece,
    ) -> (f64, f64) {
        let block = self.block[k];
        if piece.block != block || time < piece.since || time >= piece.until {
            let (first, last) = self.spans[input][block];
            *piece = Piece::new(&channel.time[first..=last], &channel.value[first..=last], hold, time);
            piece.block = block;
        }
        piece.at(time)
    }

    /// Stamps of a held input strictly between two times of the block of instant k, each with the values before and after.
    pub(super) fn switches(
        &self,
        (input, channel): (usize, &Channel),
        k: usize,
        (from, to): (f64, f64),
    ) -> impl Iterator<Item = (f64, f64, f64)> {
        let (first, last) = self.spans[input][self.block[k]];
        let (stamps, values) = (&channel.time[first..=last], &channel.value[first..=last]);
        let begin = stamps.partition_point(|stamp| *stamp <= from).max(1);
        let end = stamps.partition_point(|stamp| *stamp < to).max(begin);
        (begin..end).map(|at| (stamps[at], values[at - 1], values[at])).collect::<Vec<_>>().into_iter()
    }
}

/// An input between two of its stamps: the polynomial through those about it, in Newton's form.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    block: usize,
    /// It holds from here on, and up to here.
    since: f64,
    until: f64,
    stamps: [f64; INTERPOLATED],
    coefficients: [f64; INTERPOLATED],
    nodes: usize,
}

impl Default for Piece {
    /// One that holds nowhere.
    fn default() -> Self {
        let (stamps, coefficients) = ([0.0; INTERPOLATED], [0.0; INTERPOLATED]);
        Piece { block: 0, since: f64::INFINITY, until: f64::NEG_INFINITY, stamps, coefficients, nodes: 1 }
    }
}

impl Piece {
    /// The piece of an input in which a time lies: before the first stamp and behind the last one it stays as it is there.
    fn new(stamps: &[f64], values: &[f64], hold: Hold, time: f64) -> Self {
        let after = stamps.partition_point(|stamp| *stamp <= time);
        let at = after.checked_sub(1);
        let nodes = if hold == Hold::Zoh || at.is_none() || after >= stamps.len() { 1 } else { INTERPOLATED };
        let nodes = nodes.min(stamps.len());
        let at = at.unwrap_or(0);
        let from = if nodes > 1 { at.saturating_sub(nodes / 2 - 1).min(stamps.len() - nodes) } else { at };
        let mut piece = Piece {
            since: if after > 0 { stamps[at] } else { f64::NEG_INFINITY },
            until: stamps.get(after).copied().unwrap_or(f64::INFINITY),
            nodes,
            ..Piece::default()
        };
        piece.stamps[..nodes].copy_from_slice(&stamps[from..from + nodes]);
        piece.coefficients[..nodes].copy_from_slice(&values[from..from + nodes]);
        for level in 1..nodes {
            for i in (level..nodes).rev() {
                let wide = piece.stamps[i] - piece.stamps[i - level];
                piece.coefficients[i] = (piece.coefficients[i] - piece.coefficients[i - 1]) / wide;
            }
        }
        piece
    }

    /// Value and rate at a time.
    fn at(&self, time: f64) -> (f64, f64) {
        let last = self.nodes - 1;
        let (mut value, mut rate) = (self.coefficients[last], 0.0);
        for i in (0..last).rev() {
            let past = time - self.stamps[i];
            rate = rate * past + value;
            value = value * past + self.coefficients[i];
        }
        (value, rate)
    }
}

#[cfg(test)]
mod tests {
    use super::{Piece, Reading, Record};
    use crate::recorded::Channel;
    use tpm_controller::harmonics::Hold;

    fn channel(stamps: impl Iterator<Item = f64>, of: impl Fn(f64) -> f64) -> Channel {
        let time: Vec<f64> = stamps.collect();
        Channel { value: time.iter().map(|t| of(*t)).collect(), time }
    }

    #[test]
    fn an_input_at_stamps_of_its_own_is_the_polynomial_through_them_and_stays_within_its_block() {
        let of = |t: f64| 1.0 + t * (2.0 - t * (0.5 + t));
        let input =
            channel((0..40).map(|k| f64::from(k) * 0.1 + 0.02 * f64::from(k % 3)).filter(|t| *t < 1.9 || *t > 2.5), of);
        let readings = channel((0..30).map(|k| 0.05 + f64::from(k) * 0.12).filter(|t| *t < 1.8 || *t > 2.6), |t| t);
        let variance = vec![1.0; readings.time.len()];
        let sensor = Reading { coordinate: 0, derivative: 0, channel: readings, variance, counted: false };
        let record = Record { inputs: vec![input.clone()], sensors: vec![sensor], hold: Hold::None, breaks: vec![2.0] };
        let instants = record.instants();
        assert_eq!(instants.begins.iter().filter(|begins| **begins).count(), 2);
        let mut piece = Piece::default();
        for k in (0..instants.len()).filter(|&k| instants.goes_on(k)) {
            let time = instants.time[k] + 0.3 * instants.after(k);
            let (value, rate) = instants.input((0, &input), Hold::None, (k, time), &mut piece);
            assert!((value - of(time)).abs() < 1e-9, "{time}: {value}");
            assert!((rate - (2.0 - time - 3.0 * time * time)).abs() < 1e-8, "{time}: {rate}");
        }
        let switched: Vec<f64> = instants.switches((0, &input), 0, (0.05, 0.17)).map(|(at, ..)| at).collect();
        assert_eq!(switched, [input.time[1]]);
    }
}
