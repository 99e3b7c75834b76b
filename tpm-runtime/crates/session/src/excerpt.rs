//! What is simulated of a log or a campaign.

use std::borrow::Cow;
use std::sync::OnceLock;
use tpm_campaign::SteadyRun;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_estimate::{Channel, Course, Evenly, Rate, Reading, Record, Signals, Stretch};
use tpm_log::Periodic;
use tpm_motion::Dynamics;
use tpm_numerics::differences::white_noise;

/// Most samples that are simulated one by one; of a longer record it is means of stretches, its last periods, or blocks of it.
pub(super) const MOST_WHOLE_SAMPLES: usize = 50_000;
/// Samples of the means of stretches together, unless two periods have more.
const SAMPLES_OF_MEANS: usize = 12_000;
/// Most means of stretches, which tell whether the machine changes over the record.
const MOST_MEANS: usize = 4;
/// Samples of the last periods: two periods at least.
const SAMPLES_OF_LAST_PERIODS: usize = 24_000;
/// Samples of all blocks of a long record that does not repeat.
const SAMPLES_OF_BLOCKS: usize = 32_000;
/// Samples between two stretches that are simulated one behind the other.
const APART: usize = 100;
/// Blocks of such a record, evenly spread over it.
const BLOCKS: usize = 8;

/// A record, or what stands for it where it is too long to be simulated sample by sample.
pub(super) struct Excerpt<'a> {
    /// Coordinates, then inputs, then measured rates.
    channels: Vec<Cow<'a, [f64]>>,
    /// Coordinates whose rates were measured.
    rates: Vec<usize>,
    /// Stretches of the record of which each simulated one is the mean.
    pub(super) averaged: usize,
    /// Blocks of a record of which the rest is not simulated; none where all of it is, or a mean or its last periods.
    pub(super) blocks: usize,
    /// Samples at which another stretch begins.
    joins: Vec<usize>,
    /// Middle of the part of the record that it stands for, and half its length, samples of the record.
    pub(super) middle: f64,
    pub(super) half: f64,
    /// Samples of that part.
    pub(super) of: usize,
}

impl<'a> Excerpt<'a> {
    /// A few means of stretches of whole periods, in the order of the record, or its last periods where these are no whole numbers of
    /// samples; a short record as it is.
    ///
    /// The motion at the end of a mean is not that at the beginning of the next, because a loop passes the noise of its sensors on.
    ///
    /// Behind coordinates and inputs the channels are the measured rates of the coordinates in `rates`.
    pub(super) fn of_periods(channels: &[&'a [f64]], rates: Vec<usize>, periodic: &Periodic) -> Self {
        let samples = channels.first().map_or(0, |channel| channel.len());
        let exact = periodic.samples_per_period;
        let period = exact.round() as usize;
        let part = |from: usize| Excerpt {
            channels: channels.iter().map(|channel| Cow::Borrowed(&channel[from..])).collect(),
            rates: rates.clone(),
            averaged: 1,
            blocks: 0,
            joins: Vec::new(),
            middle: periodic.from as f64 + 0.5 * (from + samples) as f64,
            half: 0.5 * (samples - from) as f64,
            of: samples,
        };
        if samples <= MOST_WHOLE_SAMPLES || period == 0 {
            return part(0);
        }
        if (exact - period as f64).abs() >= 1e-9 {
            let shown = ((SAMPLES_OF_LAST_PERIODS as f64 / exact) as usize).max(2).min(periodic.periods);
            return part(samples.saturating_sub((shown as f64 * exact).round() as usize));
        }
        let means = (SAMPLES_OF_MEANS / period).clamp(2, MOST_MEANS).min(periodic.periods);
        let length = (SAMPLES_OF_MEANS / (means * period)).clamp(1, periodic.periods / means) * period;
        let averaged = samples / (means * length);
        let mean = |channel: &&[f64]| {
            let mut out = Vec::with_capacity(means * length);
            for part in channel.chunks_exact(averaged * length).take(means) {
                for i in 0..length {
                    out.push(part[i..].iter().step_by(length).sum::<f64>() / averaged as f64);
                }
            }
            Cow::Owned(out)
        };
        let half = 0.5 * (means * averaged * length) as f64;
        let joins = (1..means).map(|mean| mean * length).collect();
        let channels = channels.iter().map(mean).collect();
        let middle = periodic.from as f64 + half;
        Excerpt { channels, rates, averaged, blocks: 0, joins, middle, half, of: samples }
    }

    /// The stretches of a record one behind the other; of a long one, blocks that are evenly spread over them.
    pub(super) fn of_stretches(stretches: &[Stretch<'a>]) -> Self {
        let whole: usize = stretches.iter().map(Stretch::samples).sum();
        if whole <= MOST_WHOLE_SAMPLES {
            return Self::joined(stretches);
        }
        let half = 0.5 * whole as f64;
        let parts = blocks(stretches, BLOCKS, SAMPLES_OF_BLOCKS / BLOCKS);
        Excerpt { blocks: BLOCKS, middle: half, half, of: whole, ..Self::joined(&parts) }
    }

    /// Stretches one behind the other, however long they are together.
    pub(super) fn joined(parts: &[Stretch<'a>]) -> Self {
        let whole: usize = parts.iter().map(Stretch::samples).sum();
        let channel = |of: &dyn Fn(&Stretch<'a>) -> &'a [f64]| match parts {
            [part] => Cow::Borrowed(of(part)),
            parts => Cow::Owned(parts.iter().flat_map(|part| of(part).iter()).copied().collect()),
        };
        let (coordinates, inputs) = parts.first().map_or((0, 0), |first| (first.coordinates.len(), first.inputs.len()));
        // A rate that is missing in one of the stretches is not used.
        let measured = |c: &usize| parts.iter().all(|part| part.rates.get(*c).is_some_and(Option::is_some));
        let rates: Vec<usize> = (0..coordinates).filter(measured).collect();
        let coordinates = (0..coordinates).map(|c| channel(&|stretch| stretch.coordinates[c]));
        let inputs = (0..inputs).map(|i| channel(&|stretch| stretch.inputs[i]));
        let of_rates = rates.iter().map(|&c| channel(&|stretch| stretch.rates[c].unwrap_or_default()));
        let channels = coordinates.chain(inputs).chain(of_rates).collect();
        let mut joins = Vec::new();
        let mut end = 0;
        for part in parts {
            joins.extend((end > 0).then_some(end));
            end += part.samples();
        }
        let half = 0.5 * whole as f64;
        Excerpt { channels, rates, averaged: 1, blocks: 0, joins, middle: half, half, of: whole }
    }

    /// The ends of the settled parts of runs, one behind the other: at most so many samples together, and as many of every run.
    pub(super) fn of_runs(runs: &[&'a SteadyRun], most: usize) -> Self {
        let each = most / runs.len().max(1);
        let channels = runs.first().map_or(0, |run| run.channels.len());
        let channel = |c: usize| runs.iter().flat_map(|run| run.last(c, each)).copied().collect();
        let mut ends: Vec<usize> = runs.iter().map(|run| run.samples().min(each)).collect();
        (1..ends.len()).for_each(|run| ends[run] += ends[run - 1]);
        let half = 0.5 * ends.pop().unwrap_or(0) as f64;
        Excerpt {
            channels: (0..channels).map(|c| Cow::Owned(channel(c))).collect(),
            rates: Vec::new(),
            averaged: 1,
            blocks: 0,
            joins: ends,
            middle: half,
            half,
            of: runs.iter().map(|run| run.of).sum(),
        }
    }

    /// The same behind the known dynamics of the inputs, in place of what was recorded of them. What acts at the beginning of a stretch
    /// was commanded before it: where the motion repeats with a period, in samples, that is what is commanded at its end, and otherwise
    /// the beginning is left out.
    pub(super) fn behind(
        self,
        actuators: &[Dynamics],
        coordinates: usize,
        (sample_time, hold, accelerated): (f64, Hold, bool),
        period: Option<f64>,
    ) -> Self {
        if actuators.iter().all(Dynamics::is_ideal) {
            return self;
        }
        let memory = actuators.iter().map(|own| own.memory(sample_time)).max().unwrap_or(0);
        let ends: Vec<usize> = self.joins.iter().copied().chain([self.samples()]).collect();
        let mut parts = Vec::with_capacity(ends.len());
        let mut begin = 0;
        for end in ends {
            parts.push(begin..end);
            begin = end;
        }
        let left_out = if period.is_some() { 0 } else { memory };
        parts.retain(|part| part.len() > left_out);
        let inputs = coordinates..coordinates + actuators.len();
        let acting = |input: usize, channel: &[f64]| -> Vec<f64> {
            let of = |part: &std::ops::Range<usize>| {
                let own = &channel[part.clone()];
                let before = period.map_or_else(Vec::new, |period| before(own, period, memory));
                let command: Vec<f64> = before.iter().chain(own).copied().collect();
                let force = actuators[input].acting(&command, sample_time, hold, accelerated);
                force[before.len() + left_out..].to_vec()
            };
            parts.iter().flat_map(of).collect()
        };
        let measured = |channel: &[f64]| -> Vec<f64> {
            parts.iter().flat_map(|part| channel[part.start + left_out..part.end].iter().copied()).collect()
        };
        let channels = self.channels.iter().enumerate().map(|(c, channel)| {
            let input = inputs.contains(&c).then(|| c - coordinates);
            Cow::Owned(input.map_or_else(|| measured(channel), |input| acting(input, channel)))
        });
        let mut joins = Vec::with_capacity(parts.len());
        let mut end = 0;
        for part in &parts {
            joins.extend((end > 0).then_some(end));
            end += part.len() - left_out;
        }
        Excerpt { channels: channels.collect(), joins, ..self }
    }

    /// Samples that are simulated.
    pub(super) fn samples(&self) -> usize {
        self.channels.first().map_or(0, |channel| channel.len())
    }

    /// The record to be simulated, the first so many of the channels being coordinates; `steps` has the step of every sensor, `reach` samples
    /// on either side of one over which a polynomial follows the motion.
    pub(super) fn record(
        &self,
        coordinates: usize,
        (sample_time, hold): (f64, Hold),
        (steps, reach): (&[f64], usize),
    ) -> Record {
        let channels: Vec<&[f64]> = self.channels.iter().map(AsRef::as_ref).collect();
        let (channels, rates) = channels.split_at(channels.len() - self.rates.len());
        let (positions, inputs) = channels.split_at(coordinates);
        // Between stretches lies more than an interpolation of the inputs reaches.
        let stamp = |k: usize| (k + APART * self.joins.partition_point(|join| *join <= k)) as f64 * sample_time;
        let time: Vec<f64> = (0..self.samples()).map(stamp).collect();
        let channel = |values: &[f64]| Channel { time: time.clone(), value: values.to_vec() };
        let reading = |of: (usize, usize), values: &[f64]| {
            // A mean of several roundings is on no grid.
            let step = if self.averaged > 1 || of.1 > 0 { 0.0 } else { steps[of.0] };
            let known = Evenly { white: white_noise(values), step, reach, copies: 1.0 };
            Reading::evenly(of, channel(values), &self.joins, known)
        };
        let positions = positions.iter().enumerate().map(|(c, values)| reading((c, 0), values));
        let rates = self.rates.iter().zip(rates).map(|(&c, values)| reading((c, 1), values));
        Record {
            inputs: inputs.iter().map(|values| channel(values)).collect(),
            sensors: positions.chain(rates).collect(),
            hold,
            breaks: self.joins.iter().map(|&join| stamp(join)).collect(),
        }
    }

    /// The signals to be simulated, the first so many of the channels being coordinates; `steps` has the step of every sensor.
    pub(super) fn signals(
        &self,
        coordinates: usize,
        sample_time: f64,
        hold: Hold,
        (course, steps): (Course, &[f64]),
    ) -> Signals<'_> {
        let channels: Vec<&[f64]> = self.channels.iter().map(AsRef::as_ref).collect();
        let (channels, rates) = channels.split_at(channels.len() - self.rates.len());
        let (coordinates, inputs) = channels.split_at(coordinates);
        let rates = self.rates.iter().zip(rates);
        let rates = rates.map(|(&coordinate, &readings)| Rate { coordinate, readings, noise: white_noise(readings) });
        Signals {
            sample_time,
            hold,
            coordinates: coordinates.to_vec(),
            rates: rates.collect(),
            inputs: inputs.to_vec(),
            course,
            white: coordinates.iter().map(|signal| white_noise(signal)).collect(),
            joins: self.joins.clone(),
            // A mean of several roundings is on no grid.
            steps: steps.iter().map(|step| if self.averaged > 1 { 0.0 } else { *step }).collect(),
            denoised_inputs: OnceLock::new(),
        }
    }
}

/// Whether forces act on accelerations, and on nothing of lower order.
pub(super) fn accelerated(model: &dyn Model<f64>) -> bool {
    (0..model.dims().coordinates).all(|c| model.coordinate_order(c) > 1)
}

/// So many samples before the first one of a signal that repeats with a period in samples; between samples the signal runs straight.
fn before(signal: &[f64], period: f64, count: usize) -> Vec<f64> {
    let last = signal.len().saturating_sub(1);
    let value = |back: usize| {
        let periods = (back as f64 / period).ceil();
        let at = (periods * period - back as f64).clamp(0.0, last as f64);
        let (whole, rest) = (at.floor() as usize, at.fract());
        (1.0 - rest) * signal[whole] + rest * signal[(whole + 1).min(last)]
    };
    (1..=count).rev().map(value).collect()
}

/// Stretches; of those that are longer than so many samples together, so many blocks.
pub(super) fn at_most(stretches: Vec<Stretch<'_>>, most: usize, count: usize) -> Vec<Stretch<'_>> {
    let whole: usize = stretches.iter().map(Stretch::samples).sum();
    if whole > most { blocks(&stretches, count, most / count) } else { stretches }
}

/// So many blocks of a length that are evenly spread over stretches, which together are longer; a block across a gap is two.
pub(super) fn blocks<'a>(stretches: &[Stretch<'a>], count: usize, length: usize) -> Vec<Stretch<'a>> {
    let whole: usize = stretches.iter().map(Stretch::samples).sum();
    let starts = (0..count).map(|block| block * whole.saturating_sub(length) / (count - 1).max(1));
    let parts = starts.flat_map(|start| within(stretches.iter().map(Stretch::samples), start..start + length));
    let part = |(s, range): (usize, std::ops::Range<usize>)| {
        let Stretch { coordinates, rates, inputs } = &stretches[s];
        let cut = |signal: &&'a [f64]| &signal[range.clone()];
        Stretch {
            coordinates: coordinates.iter().map(cut).collect(),
            rates: rates.iter().map(|rate| rate.as_ref().map(cut)).collect(),
            inputs: inputs.iter().map(cut).collect(),
        }
    };
    parts.map(part).collect()
}

/// The parts of stretches of these lengths, one behind the other, that lie within a range of all their samples.
fn within(lengths: impl Iterator<Item = usize>, range: std::ops::Range<usize>) -> Vec<(usize, std::ops::Range<usize>)> {
    let mut parts = Vec::new();
    let mut begin = 0;
    for (s, length) in lengths.enumerate() {
        let (from, to) = (range.start.max(begin), range.end.min(begin + length));
        if from < to {
            parts.push((s, from - begin..to - begin));
        }
        begin += length;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::{Excerpt, SAMPLES_OF_BLOCKS, within};
    use tpm_controller::harmonics::Hold;
    use tpm_estimate::Stretch;
    use tpm_motion::Dynamics;

    #[test]
    fn a_range_of_all_samples_is_found_in_its_stretches() {
        assert_eq!(within([10, 5, 20].into_iter(), 8..17), [(0, 8..10), (1, 0..5), (2, 0..2)]);
        assert_eq!(within([10, 5].into_iter(), 10..12), [(1, 0..2)]);
    }

    #[test]
    fn inputs_behind_a_delay_come_from_the_end_of_a_period_or_not_at_all() {
        let command: Vec<f64> = (0..40).map(|k| f64::from(k % 10)).collect();
        let motion: Vec<f64> = (0..40).map(f64::from).collect();
        let stretch = Stretch { coordinates: vec![&motion], rates: vec![None], inputs: vec![&command] };
        let late = [Dynamics { delay: 0.3, ..Dynamics::default() }];
        let behind = |period| {
            Excerpt::joined(&[stretch.clone(), stretch.clone()]).behind(&late, 1, (0.1, Hold::Zoh, true), period)
        };
        let repeated = behind(Some(10.0));
        assert_eq!((repeated.samples(), &repeated.joins), (80, &vec![40]));
        for (k, force) in repeated.channels[1].iter().enumerate() {
            assert_eq!(*force, ((k + 7) % 10) as f64, "{k}");
        }
        let memory = late[0].memory(0.1);
        let once = behind(None);
        assert_eq!((once.samples(), &once.joins), (80 - 2 * memory, &vec![40 - memory]));
        for (motion, force) in once.channels[0].iter().zip(once.channels[1].iter()) {
            assert_eq!(*force, (motion + 7.0) % 10.0);
        }
    }

    #[test]
    fn blocks_of_a_long_record_join_where_something_is_left_out() {
        let signal: Vec<f64> = (0..200_000).map(f64::from).collect();
        let stretch = Stretch { coordinates: vec![&signal], rates: vec![None], inputs: vec![&signal] };
        let excerpt = Excerpt::of_stretches(&[stretch]);
        assert_eq!(excerpt.channels[0].len(), SAMPLES_OF_BLOCKS);
        let apart: Vec<usize> =
            (1..SAMPLES_OF_BLOCKS).filter(|&k| excerpt.channels[0][k] != excerpt.channels[0][k - 1] + 1.0).collect();
        assert_eq!(apart, excerpt.joins);
        assert_eq!(excerpt.channels[0][SAMPLES_OF_BLOCKS - 1], 199_999.0);
    }
}
