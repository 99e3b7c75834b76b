//! What a channel's readings say of the channel.

use crate::estimate::{Sensor, Swiftness};
use crate::log::{Role, lone_readings};
use crate::session::inspect::outline::Outline;
use crate::session::inspect::plateau::{Plateau, plateaus};
use crate::session::inspect::rest::{Rest, at_rest};
use crate::session::inspect::signal::Signal;
use serde::Serialize;
use std::ops::Range;
use std::string::{String, ToString as _};
use std::vec::Vec;

/// Blocks of a long record, and their samples, from which its frequencies are read.
const BLOCKS: (usize, usize) = (8, 1 << 16);
/// Share of readings that repeat the one before, at which that is a finding.
const REPEATED: f64 = 0.005;
/// Highest frequency, as a share of the sampling frequency, up to which the noise is told from the motion.
const DENSE: f64 = 0.1;

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
    /// Period of the channel by itself, s; nothing where it does not repeat.
    pub period: Option<f64>,
    /// How much the channel changes from the first period of the record to the last one beyond noise, as a share of its deviation;
    /// nothing where the record does not repeat, or no change is seen.
    pub drift: Option<f64>,
    /// How long it stands still; nothing where it does not, or where noise hides it.
    pub rest: Option<Rest>,
    /// Share of readings, without those at rest, that repeat the one before; nothing where they are few, or the readings are counts.
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
    let (least, largest) =
        signal.samples().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
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
    let swiftness = Swiftness::of(&signal.blocks(BLOCKS.0, BLOCKS.1), sample_time, sensor.noise);
    report.highest = Some(swiftness.highest);
    report.noise_at_most = swiftness.highest * sample_time > DENSE;
    report.plateaus = plateaus(&signal.parts, sensor.step);
    let still = at_rest(&signal.parts, sensor.noise, swiftness.typical_period / sample_time);
    if let Some(still) = &still {
        report.rest = Rest::of(&signal.parts, still, sample_time);
        report.outline.rest(signal, still, sample_time);
    }
    report.outline.spectrum = swiftness.spectrum;
    report.repeated = repeated(signal, &still.unwrap_or_default(), &report);
    report.lone = (signal.role != Role::Input).then(|| lone(signal)).flatten();
    report
}

/// Share of the readings that repeat the one before although the channel moves.
fn repeated(signal: &Signal<'_>, still: &[Vec<Range<usize>>], report: &ChannelReport) -> Option<f64> {
    if report.step.is_some() {
        return None;
    }
    let at_ends: f64 = report.plateaus.iter().map(|plateau| plateau.share).sum();
    let (mut equal, mut all) = (0.0, 0.0);
    for (p, part) in signal.parts.iter().enumerate() {
        let mut moving = std::vec![true; part.values.len()];
        for range in still.get(p).into_iter().flatten() {
            moving[range.clone()].fill(false);
        }
        for (pair, _) in part.values.windows(2).zip(&moving[1..]).filter(|(_, moves)| **moves) {
            all += 1.0;
            equal += f64::from(u8::from(pair[0].to_bits() == pair[1].to_bits()));
        }
    }
    let share = equal / f64::max(all, 1.0) - at_ends;
    (share > REPEATED).then_some(share)
}

/// Single readings far from their neighbours.
fn lone(signal: &Signal<'_>) -> Option<Lone> {
    let mut found: Option<Lone> = None;
    for part in &signal.parts {
        for (k, value) in lone_readings(part.values) {
            let line = part.lines.get(k).copied().unwrap_or(0);
            let lone = found.get_or_insert(Lone { count: 0, line, farthest: 0.0 });
            lone.count += 1;
            lone.farthest = lone.farthest.max((part.values[k] - value).abs());
        }
    }
    found
}
