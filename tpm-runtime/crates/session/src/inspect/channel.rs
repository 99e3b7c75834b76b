//! What a channel's readings say of the channel.

use crate::inspect::outline::Outline;
use crate::inspect::plateau::{Plateau, plateaus};
use crate::inspect::rest::{Rest, at_rest};
use crate::inspect::signal::Signal;
use serde::Serialize;
use std::ops::Range;
use tpm_estimate::{Sensor, Swiftness};
use tpm_log::{Role, lone_readings};
use tpm_numerics::tolerance;

/// Blocks of a long record from which its frequencies are read.
const FREQUENCY_BLOCKS: usize = 8;
/// Samples of each of these blocks.
const SAMPLES_PER_BLOCK: usize = 1 << 16;
/// Share of readings that repeat the one before, at which that is a finding.
const LEAST_REPEATED_SHARE: f64 = 0.005;
/// Samples in the time in which a channel goes to and fro once, above which its noise is told from its motion.
const DENSE_SAMPLES_PER_PERIOD: f64 = 16.0;
/// Share of the deviation that a channel must go beyond its mean on either side to have gone to and fro.
const LEAST_SWING: f64 = 0.3;
/// Change over equal readings, in steps of the channel's numbers per reading, from which on equal readings are no rounding.
const LEAST_CHANGE: f64 = 4.0;

/// Single readings that stand far from their neighbours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Lone {
    /// How many.
    pub count: usize,
    /// Line of the first.
    pub line: u64,
    /// Largest distance from what the neighbours say, unit of the channel.
    pub farthest: f64,
}

/// What was found about one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ChannelReport {
    /// Its name: the model's, or that of its column.
    pub name: String,
    /// Its unit, where one is known.
    pub unit: Option<String>,
    /// What it is to the model.
    pub role: Role,
    /// Least reading, unit of the channel.
    pub least: f64,
    /// Largest reading.
    pub largest: f64,
    /// Mean.
    pub mean: f64,
    /// Standard deviation of the readings, motion and noise together.
    pub deviation: f64,
    /// Whether all readings are equal.
    pub constant: bool,
    /// Standard deviation of the white noise from sample to sample, rounding to counts included; nothing where none is seen.
    pub noise: Option<f64>,
    /// Whether the motion is too fast for its samples to be told from noise, so that there is less noise than stated.
    pub noise_at_most: bool,
    /// Step of the readings, where they lie on a grid: a count of an encoder, or the last digit of the file.
    pub step: Option<f64>,
    /// Highest frequency that stands out of the noise, Hz.
    pub highest: Option<f64>,
    /// Time in which the channel goes to and fro once, on the average, s.
    pub typical_period: Option<f64>,
    /// Period of the channel by itself, s; nothing where it does not repeat.
    pub period: Option<f64>,
    /// How much the channel changes from the first period of the record to the last one beyond noise, as a share of its deviation;
    /// nothing where the record does not repeat, or no change is seen.
    pub drift: Option<f64>,
    /// How long it stands still; nothing where it does not, where noise hides it, and for inputs.
    pub rest: Option<Rest>,
    /// Share of readings, without those at rest, that repeat the one before; nothing where they are few, for counts, and for inputs.
    pub repeated: Option<f64>,
    /// Levels at which it is cut off.
    pub plateaus: Vec<Plateau>,
    /// Single readings far from their neighbours; not looked for in inputs, which may jump.
    pub lone: Option<Lone>,
    /// What is drawn of it.
    #[serde(skip)]
    pub(super) outline: Outline,
}

/// Measures a channel.
pub(super) fn measured(signal: &Signal<'_>, sample_time: f64) -> ChannelReport {
    let count = signal.len().max(1) as f64;
    let mean = signal.samples().sum::<f64>() / count;
    let deviation = (signal.samples().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt();
    let [least, largest] = signal.extremes;
    let constant = least >= largest;
    let sensor = Sensor::of(&signal.values());
    let step = Some(sensor.step).filter(|step| *step > 0.0);
    let mut report = ChannelReport {
        name: signal.name.to_string(),
        unit: signal.unit.map(str::to_string),
        role: signal.role,
        least,
        largest,
        mean,
        deviation,
        constant,
        noise: None,
        noise_at_most: false,
        step,
        highest: None,
        typical_period: None,
        period: None,
        drift: None,
        rest: None,
        repeated: None,
        plateaus: Vec::new(),
        lone: None,
        outline: Outline::of(signal, sample_time),
    };
    if constant {
        return report;
    }
    report.noise = sensor.noisy.then_some(sensor.noise);
    let swiftness = Swiftness::of(&signal.blocks(FREQUENCY_BLOCKS, SAMPLES_PER_BLOCK), sample_time, sensor.noise);
    report.highest = Some(swiftness.highest);
    report.noise_at_most = swiftness.typical_period < DENSE_SAMPLES_PER_PERIOD * sample_time;
    // A motion that is slower than the record is long is no motion to and fro.
    let seen = |period: &f64| *period < 2.0 * count * sample_time;
    report.typical_period = Some(swiftness.typical_period).filter(seen);
    let noise = report.noise.filter(|_| !report.noise_at_most);
    report.plateaus = plateaus(&signal.parts, sensor.step, noise);
    let may_rest = signal.role != Role::Input;
    let period = to_and_fro(signal, mean, deviation);
    let still = may_rest.then(|| at_rest(&signal.parts, sensor.noise, period)).flatten();
    if let Some(still) = &still {
        report.rest = Rest::of(&signal.parts, still, sample_time);
        report.outline.rest(signal, still, sample_time);
    }
    report.outline.spectrum = swiftness.spectrum;
    report.repeated = repeated(signal, &still.unwrap_or_default(), &report);
    report.lone = (signal.role != Role::Input).then(|| lone(signal, tolerance::FILE_DIGITS * deviation)).flatten();
    report
}

/// Samples in which a channel goes from one side of its mean to the other and back, on the average; all of them where it does not.
fn to_and_fro(signal: &Signal<'_>, mean: f64, deviation: f64) -> f64 {
    let (mut turns, mut side) = (0_usize, 0.0);
    for value in signal.samples() {
        let away = value - mean;
        if away.abs() > LEAST_SWING * deviation && away.signum() != side {
            turns += usize::from(side != 0.0);
            side = away.signum();
        }
    }
    2.0 * signal.len() as f64 / turns.max(2) as f64
}

/// Share of the readings that repeat the one before although the channel moves: it has changed behind them by more than a rounded channel
/// does.
fn repeated(signal: &Signal<'_>, still: &[Vec<Range<usize>>], report: &ChannelReport) -> Option<f64> {
    // An input may be held.
    if report.step.is_some() || report.role == Role::Input {
        return None;
    }
    let steps = signal.steps?;
    let at_end = |value: f64| report.plateaus.iter().any(|plateau| plateau.level == value);
    let (mut equal, mut all) = (0, 0);
    for (p, part) in signal.parts.iter().enumerate() {
        let mut moving = vec![true; part.values.len()];
        for range in still.get(p).into_iter().flatten() {
            moving[range.clone()].fill(false);
        }
        all += moving.iter().filter(|moving| **moving).count();
        let mut from = 0;
        while from < part.values.len() {
            let length = part.values[from..].iter().take_while(|value| **value == part.values[from]).count().max(1);
            let to = from + length;
            if length > 1 && from > 0 && to < part.values.len() && moving[from] && !at_end(part.values[from]) {
                let (before, after) = (part.values[from - 1], part.values[to]);
                let step = steps.at(before.abs().max(after.abs()));
                let fresh = (after - before).abs() > LEAST_CHANGE * step * (length + 1) as f64;
                equal += if fresh { moving[from + 1..to].iter().filter(|moving| **moving).count() } else { 0 };
            }
            from = to;
        }
    }
    let share = equal as f64 / all.max(1) as f64;
    (share > LEAST_REPEATED_SHARE).then_some(share)
}

/// Single readings that are farther than this from their neighbours.
fn lone(signal: &Signal<'_>, far: f64) -> Option<Lone> {
    let mut found: Option<Lone> = None;
    let steps = signal.steps?;
    for part in &signal.parts {
        for (k, value) in lone_readings(part.values, steps) {
            let (line, distance) = (part.lines.get(k).copied().unwrap_or(0), (part.values[k] - value).abs());
            if distance > far {
                let lone = found.get_or_insert(Lone { count: 0, line, farthest: 0.0 });
                lone.count += 1;
                lone.farthest = lone.farthest.max(distance);
            }
        }
    }
    found
}
