//! What was found about a record, what it means for identification, and what to do.

use crate::inspect::plateau::End;
use crate::inspect::relation::RelationKind;
use crate::warning::Warning;
use serde::{Serialize, Serializer};
use std::fmt;
use tpm_controller::harmonics::Hold;
use tpm_estimate::{Domain, InputShift};
use tpm_log::Role;
use tpm_report::{Remedy, number};

/// Counts over which a coordinate moves, below which its rounding hides much of the motion.
const LEAST_COUNTS: f64 = 200.0;
/// Share of noise in a channel's deviation above which it is much.
const MUCH_NOISE: f64 = 0.05;
/// Largest distance of a shift from half a sample, in samples, at which it is what a held input makes.
const MOST_OFF_HALF_SAMPLE: f64 = 0.2;

/// A finding. Its text says what was measured, [`meaning`](Self::meaning) what follows for identification, and
/// [`remedies`](Self::remedies) which settings would help.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Finding {
    /// The record has no channel beside its time.
    NoChannel,
    /// A column is not read.
    Unread {
        /// The column.
        column: String,
        /// Why.
        why: String,
    },
    /// Gaps split the record.
    Gaps {
        /// Stretches without a gap.
        segments: usize,
        /// Samples of the longest stretch.
        longest: usize,
        /// Rows that are in no stretch.
        left_out: usize,
        /// How identification would use the record where it was told to; nothing where it chooses.
        #[serde(skip)]
        domain: Option<Domain>,
    },
    /// A coordinate is elsewhere from one sample to the next.
    Joined {
        /// The coordinate.
        channel: String,
        /// How much farther it is than its motion goes in a sample, unit of the coordinate.
        by: f64,
        /// Line of the first sample behind the jump.
        line: u64,
    },
    /// Time stamps are uneven.
    Uneven {
        /// Root mean square of the deviation of a step, as a share of the sample time.
        rms: f64,
        /// Largest such deviation.
        largest: f64,
        /// Whether the readings are interpolated; otherwise the stamps are late.
        resampled: bool,
        /// Largest error of the interpolation, as a share of a channel's deviation.
        error: f64,
    },
    /// A channel never changes.
    Constant {
        /// The channel.
        channel: String,
        /// What it is to the model.
        role: Role,
        /// Its value.
        value: f64,
    },
    /// A channel is rounded to counts.
    Counts {
        /// The channel.
        channel: String,
        /// One count, unit of the channel.
        step: f64,
        /// Its unit.
        unit: Option<String>,
        /// Counts from the least to the largest reading.
        counts: f64,
        /// Root mean square error of the rate by differences of successive readings, unit of the channel per second.
        rate_error: f64,
        /// The same of the acceleration, unit of the channel per second squared.
        acceleration_error: f64,
    },
    /// A channel is noisy.
    Noise {
        /// The channel.
        channel: String,
        /// Deviation of the noise, unit of the channel.
        deviation: f64,
        /// Its unit.
        unit: Option<String>,
        /// The noise as a share of the channel's deviation.
        share: f64,
        /// What the channel is to the model.
        role: Role,
    },
    /// A channel moves nearly as fast as it is sampled.
    SampledSlowly {
        /// The channel.
        channel: String,
        /// Time in which the channel goes to and fro once, on the average, s.
        period: f64,
        /// Samples in that time.
        samples: f64,
    },
    /// A channel is cut off at a level.
    Clipped {
        /// The channel.
        channel: String,
        /// What it is to the model.
        role: Role,
        /// Which end of the range.
        end: End,
        /// The level, unit of the channel.
        level: f64,
        /// Its unit.
        unit: Option<String>,
        /// Share of the samples there.
        share: f64,
        /// Longest stay there, samples.
        longest: usize,
        /// Line of the first sample there.
        from_line: u64,
    },
    /// A channel stands still for a part of the record.
    Rest {
        /// The channel.
        channel: String,
        /// What it is to the model.
        role: Role,
        /// Share of the record.
        share: f64,
        /// Longest rest, s.
        longest: f64,
        /// Its first line.
        from_line: u64,
        /// Its last line.
        to_line: u64,
    },
    /// Readings repeat the ones before although the channel moves.
    Repeated {
        /// The channel.
        channel: String,
        /// Share of the readings.
        share: f64,
        /// What the channel is to the model.
        role: Role,
    },
    /// Single readings stand far from their neighbours.
    Lone {
        /// The channel.
        channel: String,
        /// How many.
        count: usize,
        /// Line of the first.
        line: u64,
        /// Largest distance from the neighbours, unit of the channel.
        farthest: f64,
    },
    /// Channels repeat.
    Repeats {
        /// Period, s.
        period: f64,
        /// Whole periods.
        periods: usize,
        /// Line from which on they repeat.
        from_line: u64,
        /// Difference of the last two periods, as a share of the motion.
        mismatch: f64,
        /// The channels.
        channels: Vec<String>,
        /// How identification uses the record.
        domain: Domain,
        /// Whether the record has gaps.
        gaps: bool,
    },
    /// Nothing repeats for long enough.
    NotPeriodic,
    /// So many columns that they are not all compared with each other.
    ComparedInPart {
        /// How many are compared, the first of the file.
        compared: usize,
        /// How many there are.
        channels: usize,
    },
    /// A channel changes slowly over a record that repeats.
    Drift {
        /// The channel.
        channel: String,
        /// Root mean square change from the first period to the last one, as a share of the channel's deviation.
        share: f64,
    },
    /// A channel follows from another one.
    Follows {
        /// The channel.
        channel: String,
        /// The other one.
        of: String,
        /// How it follows.
        #[serde(rename = "follows_as")]
        relation: RelationKind,
        /// Gain.
        gain: f64,
        /// Time by which it is later, s.
        delay: f64,
        /// Standard deviation of that time, s.
        deviation: f64,
        /// Sample time, s.
        sample_time: f64,
    },
    /// When inputs act, against when they were recorded.
    Inputs {
        /// The inputs.
        inputs: Vec<String>,
        /// Whether they clearly act at another time.
        shifted: bool,
        /// How much of the forces is left, and with which shift least is.
        #[serde(flatten)]
        shift: InputShift,
        /// Sample time, s.
        sample_time: f64,
        /// What the inputs are taken to do between samples.
        #[serde(serialize_with = "tpm_report::displayed")]
        hold: Hold,
    },
    /// The delay between inputs and motion is not told.
    DelayUnknown {
        /// Whether a model was given.
        model: bool,
    },
    /// Something that identification warns of.
    Identification {
        /// The warning.
        warning: Box<Warning>,
    },
    /// Identification would refuse the record.
    Refused {
        /// Why.
        message: String,
        /// What would help.
        remedies: Vec<Remedy>,
    },
}

impl Finding {
    /// Whether the finding keeps a result from being trusted as long as nothing is done about it; other findings are worth knowing.
    #[must_use]
    pub fn is_doubt(&self) -> bool {
        match self {
            Finding::NoChannel
            | Finding::Clipped { .. }
            | Finding::Joined { .. }
            | Finding::Repeated { .. }
            | Finding::Lone { .. }
            | Finding::Drift { .. }
            | Finding::Inputs { shifted: true, .. }
            | Finding::Identification { .. }
            | Finding::Refused { .. } => true,
            Finding::Constant { role, .. } => *role != Role::Column,
            Finding::Counts { counts, .. } => *counts < LEAST_COUNTS,
            Finding::Noise { share, role, .. } => *share > MUCH_NOISE && matches!(role, Role::Coordinate | Role::Rate),
            Finding::Uneven { error, .. } => *error > MUCH_NOISE,
            Finding::Follows { relation, delay, deviation, sample_time, .. } => {
                *relation == RelationKind::Rate && late(*delay, *deviation, *sample_time)
            }
            _ => false,
        }
    }

    /// What the finding means for identification.
    #[must_use]
    pub fn meaning(&self) -> String {
        match self {
            Finding::NoChannel => "there is nothing to identify from".into(),
            Finding::Unread { .. } => "no model can use it as a signal".into(),
            Finding::Gaps { domain: Some(Domain::Harmonics), .. } => {
                "harmonics are those of the longest stretch that repeats; the others are not used".into()
            }
            Finding::Gaps { .. } => {
                "nothing is filled in: all stretches are used together, in the time domain, and each loses a little at its ends".into()
            }
            Finding::Joined { .. } => {
                "recordings that were written one behind the other are used as stretches of their own. A reading that wraps around must be unwrapped where more than its sine and cosine counts, as with a stiffness".into()
            }
            Finding::Uneven { resampled: false, .. } => {
                "the readings are smoother as even ones: they were taken evenly and stamped late, and are used as even".into()
            }
            Finding::Uneven { error, .. } if *error > MUCH_NOISE => {
                "interpolation to even times adds this error as noise, which makes deviations larger and highest frequencies unusable; record at even times".into()
            }
            Finding::Uneven { .. } => "the readings are interpolated to even times, with little error".into(),
            Finding::Constant { role: Role::Column, .. } => "no model can use it as a signal".into(),
            Finding::Constant { .. } => {
                "identification refuses it: is it the right column, or was the sensor disconnected?".into()
            }
            Finding::Counts { counts, .. } if *counts < LEAST_COUNTS => {
                "rounding hides much of the motion, and repeats with it, so that more periods do not average it away: move further, or measure more finely; acceleration by differences is useless, identification takes it from harmonics or behind a low pass".into()
            }
            Finding::Counts { .. } => {
                "identification counts the rounding as noise; do not form rates or accelerations by differences".into()
            }
            Finding::Noise { role: Role::Input, .. } => {
"what a loop passes on of its sensors' noise was applied and is no error; noise of a measured input makes deviations larger, and does not bend parameters".into()
            }
            Finding::Noise { .. } => {
                "noise of a coordinate makes parameters of a plain regression too small: identification takes off what it adds, and deviations are larger; move further, or record longer".into()
            }
            Finding::SampledSlowly { .. } => {
                "what the inputs do between samples matters, so that it should be stated, and the noise is no more than stated".into()
            }
            Finding::Clipped { role: Role::Input, .. } => {
                "harmless where this is what was applied; where the limit comes behind the place of recording, identification finds it. A limited loop may vibrate: move less".into()
            }
            Finding::Clipped { role: Role::Column, .. } => {
                "an input that was applied so is no fault; a sensor at the end of its range shows no motion there: move less, or leave these lines out".into()
            }
            Finding::Clipped { .. } => {
                "the sensor is at the end of its range, or the machine at a stop, where no motion is seen: move less, or leave these lines out".into()
            }
            Finding::Rest { role: Role::Input, .. } => "an input that does not change excites nothing".into(),
            Finding::Rest { .. } => {
                "rest tells of stiffness, gravity and offsets alone: dry friction takes any value there, and equations in which the sign of a velocity is not known are left out".into()
            }
            Finding::Repeated { share, .. } if *share > 0.4 => {
                "the channel is updated less often than it is recorded, and late by half of that time on the average: record every update once, or at the rate of the sensor".into()
            }
            Finding::Repeated { .. } => {
                "the sensor had not been read again when these rows were written: identification uses what the fresh readings of a coordinate around them say; other channels are late there, which counts as noise that grows with the speed".into()
            }
            Finding::Lone { .. } => {
                "faults of the sensor or of its recording: identification uses what the neighbours of a coordinate's reading say".into()
            }
            Finding::Repeats { domain: Domain::Time, gaps: true, .. } => {
                "harmonics would average noise over the periods, but a record with gaps is used in the time domain".into()
            }
            Finding::Repeats { domain: Domain::Time, .. } => {
                "not all that counts repeats with it, and every sample is used in the time domain".into()
            }
            Finding::Repeats { periods: 1, .. } => {
                "one period only: whether the motion has settled cannot be told; record at least four".into()
            }
            Finding::Repeats { .. } => {
                "harmonics of this period are used: noise averages over the periods, and is read between the lines".into()
            }
            Finding::NotPeriodic => {
                "every sample is used in the time domain; a motion that repeats would show noise and settling by itself".into()
            }
            Finding::ComparedInPart { .. } => {
                "whether another column is the rate of one, or says the same, is not known; with a model its channels alone are looked at".into()
            }
            Finding::Drift { .. } => {
                "the machine or its load changes over the record, or it has not settled or warmed up: parameters are means over the record; record when it is steady, or identify parts of the record and compare them".into()
            }
            Finding::Follows { relation: RelationKind::Rate, delay, deviation, sample_time, .. } => {
                if late(*delay, *deviation, *sample_time) {
                    "position and rate contradict each other by this time; differences of readings are half a sample late, filtered ones more: record the unfiltered rate, or none".into()
                } else {
                    "map it to dot(...) of the coordinate, and the rate is used together with the position".into()
                }
            }
            Finding::Follows { .. } => {
                "the same quantity twice, parts that move together, or a reference and what follows it; map what was measured: a reference is no measurement".into()
            }
            Finding::Inputs { shifted: false, .. } => "nothing is to be corrected".into(),
            Finding::Inputs { shift, sample_time, hold, .. } => {
                if *hold == Hold::None && (shift.delay / sample_time - 0.5).abs() < MOST_OFF_HALF_SAMPLE {
                    "half a sample is what an input makes that is held until the next sample".into()
                } else if shift.delay < 0.0 {
                    "the inputs were recorded late, or the motion early; an input cannot be corrected to act before it was recorded: shift the columns against each other".into()
                } else {
                    "a delay of the inputs or of the sensors, or a lag of an amplifier or a filter: it turns inertia, damping and stiffness into each other until it is stated".into()
                }
            }
            Finding::DelayUnknown { model: true } => {
                "all shifts of some samples explain the record alike; more frequencies in one record tell them apart".into()
            }
            Finding::DelayUnknown { model: false } => {
                "dynamics delay the motion too, so that only a model tells a delay from them: give one".into()
            }
            Finding::Identification { .. } => "identification warns of this".into(),
            Finding::Refused { .. } => "identification stops here until it is mended".into(),
        }
    }

    /// The settings that would help.
    #[must_use]
    pub fn remedies(&self) -> Vec<Remedy> {
        match self {
            Finding::Gaps { domain: None, segments, .. } if *segments > 1 => {
                vec![Remedy::HarmonicsOfOneStretch]
            }
            Finding::Constant { role, channel, .. } if *role != Role::Column => {
                vec![Remedy::MapColumn { signal: channel.clone() }]
            }
            Finding::NotPeriodic => vec![Remedy::PeriodAndStart],
            Finding::Repeats { domain: Domain::Harmonics, .. } => vec![Remedy::TimeDomain],
            Finding::Inputs { shifted: false, .. } => Vec::new(),
            Finding::Inputs { inputs, shift, sample_time, hold, .. } => {
                if *hold == Hold::None && (shift.delay / sample_time - 0.5).abs() < MOST_OFF_HALF_SAMPLE {
                    vec![Remedy::Hold { hold: Hold::Zoh }]
                } else if shift.delay > 0.0 {
                    let nanoseconds = (1e9 * shift.delay).round() as u64;
                    inputs.iter().map(|input| Remedy::InputDelay { input: input.clone(), nanoseconds }).collect()
                } else {
                    Vec::new()
                }
            }
            Finding::SampledSlowly { .. } => vec![Remedy::Hold { hold: Hold::Zoh }],
            Finding::Identification { warning } => warning.remedy().into_iter().collect(),
            Finding::Refused { remedies, .. } => remedies.clone(),
            _ => Vec::new(),
        }
    }
}

/// Whether a delay is more than chance, and more than a small share of a sample.
fn late(delay: f64, deviation: f64, sample_time: f64) -> bool {
    delay.abs() > 3.0 * deviation && delay.abs() > 0.2 * sample_time
}

/// A value to three digits.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let digit = 10.0_f64.powi(value.abs().log10().floor() as i32 - 2);
    (value / digit).round() * digit
}

fn percent(share: f64) -> String {
    number(rounded(100.0 * share))
}

fn with_unit(value: f64, unit: Option<&str>) -> String {
    match unit {
        Some(unit) => format!("{} {unit}", number(rounded(value))),
        None => number(rounded(value)),
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Finding::NoChannel => f.write_str("there is no column of numbers beside the time"),
            Finding::Unread { column, why } => write!(f, "column `{column}` is not read: {why}"),
            Finding::Gaps { segments: 1, left_out, .. } => write!(f, "{left_out} rows are left out"),
            Finding::Gaps { segments, longest, left_out, .. } => write!(
                f,
                "gaps split the record into {segments} stretches, the longest of {longest} samples; {left_out} rows are in none"
            ),
            Finding::Joined { channel, by, line } => {
                write!(f, "{channel} jumps by {} from one sample to the next in line {line}", number(rounded(*by)))
            }
            Finding::Uneven { rms, largest, resampled, error } => {
                write!(
                    f,
                    "time stamps are uneven: steps are off by {} % (rms), {} % at most",
                    percent(*rms),
                    percent(*largest)
                )?;
                if *resampled {
                    write!(f, "; interpolation errs by up to {} % of a channel", percent(*error))?;
                }
                Ok(())
            }
            Finding::Constant { channel, value, .. } => write!(f, "{channel} is {} throughout", number(*value)),
            Finding::Counts { channel, step, unit, counts, rate_error, acceleration_error } => {
                let unit = unit.as_deref();
                let per = |power: &str| unit.map(|unit| format!(" {unit}/s{power}")).unwrap_or_default();
                write!(
                    f,
                    "{channel} is rounded to counts of {} and moves over {} of them; by differences its rate errs by {}{} and its acceleration by {}{} (rms)",
                    with_unit(*step, unit),
                    counts.round(),
                    number(rounded(*rate_error)),
                    per(""),
                    number(rounded(*acceleration_error)),
                    per("^2")
                )
            }
            Finding::Noise { channel, deviation, unit, share, .. } => write!(
                f,
                "{channel} has noise of {} from sample to sample, {} % of its deviation",
                with_unit(*deviation, unit.as_deref()),
                percent(*share)
            ),
            Finding::SampledSlowly { channel, period, samples } => write!(
                f,
                "{channel} goes to and fro within {} s on the average, which has {} samples",
                number(rounded(*period)),
                number(rounded(*samples))
            ),
            Finding::Clipped { channel, end, level, unit, share, longest, from_line, .. } => write!(
                f,
                "{channel} is cut off at its {} value, {}: {} % of the samples, up to {longest} in a row, from line {from_line} on",
                match end {
                    End::Least => "least",
                    End::Largest => "largest",
                },
                with_unit(*level, unit.as_deref()),
                percent(*share)
            ),
            Finding::Rest { channel, share, longest, from_line, to_line, .. } => write!(
                f,
                "{channel} stands still for {} % of the record, longest for {} s in lines {from_line} to {to_line}",
                percent(*share),
                number(rounded(*longest))
            ),
            Finding::Repeated { channel, share, .. } => {
                write!(f, "{} % of the readings of {channel} repeat the one before while it moves", percent(*share))
            }
            Finding::Lone { channel, count, line, farthest } => write!(
                f,
                "{count} single readings of {channel}, the first in line {line}, stand up to {} away from their neighbours",
                number(rounded(*farthest))
            ),
            Finding::Repeats { period, periods, from_line, mismatch, channels, .. } => write!(
                f,
                "{} with a period of {} s from line {from_line} on: {periods} whole periods, the last two differ by {} % of the motion",
                match channels.as_slice() {
                    [] => "the motion repeats".to_string(),
                    [one] => format!("{one} repeats"),
                    many => format!("{} repeat", many.join(", ")),
                },
                number(*period),
                percent(*mismatch)
            ),
            Finding::NotPeriodic => f.write_str("nothing repeats through at least half of the record"),
            Finding::ComparedInPart { compared, channels } => {
                write!(f, "the first {compared} of {channels} columns are compared with each other")
            }
            Finding::Drift { channel, share } => write!(
                f,
                "{channel} drifts: from the first to the last period it changes by {} % of its deviation, beyond noise",
                percent(*share)
            ),
            Finding::Follows { channel, of, relation, gain, delay, deviation, sample_time } => {
                let what = match relation {
                    RelationKind::Rate => format!("the rate of {of}"),
                    RelationKind::Same => of.clone(),
                };
                write!(f, "{channel} is {} times {what}", number(*gain))?;
                if late(*delay, *deviation, *sample_time) {
                    let (size, way) = (delay.abs(), if *delay > 0.0 { "later" } else { "earlier" });
                    write!(
                        f,
                        ", {} s {way} (+- {}): {} samples",
                        number(rounded(size)),
                        number(rounded(*deviation)),
                        number(rounded(size / sample_time))
                    )
                } else {
                    f.write_str(" at the same time")
                }
            }
            Finding::Inputs { inputs, shifted: false, shift, sample_time, .. } => write!(
                f,
                "no delay is seen between {} and the motion: a shift of {} +- {} samples leaves least, and hardly less than none",
                inputs.join(", "),
                number(rounded(shift.delay / sample_time)),
                number(rounded(shift.deviation / sample_time))
            ),
            Finding::Inputs { inputs, shift, sample_time, .. } => write!(
                f,
                "{} {} later than recorded by {} s (+- {}), {} samples: that leaves {} % of the forces, no shift leaves {} %",
                inputs.join(", "),
                if inputs.len() == 1 { "acts" } else { "act" },
                number(rounded(shift.delay)),
                number(rounded(shift.deviation)),
                number(rounded(shift.delay / sample_time)),
                percent(shift.left_shifted),
                percent(shift.left)
            ),
            Finding::DelayUnknown { .. } => f.write_str("a delay between inputs and motion cannot be told"),
            Finding::Identification { warning } => warning.fmt(f),
            Finding::Refused { message, .. } => f.write_str(message),
        }
    }
}

/// Serialises findings with their texts.
pub(super) fn with_texts<S: Serializer>(findings: &[Finding], serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Form<'a> {
        finding: String,
        meaning: String,
        doubt: bool,
        remedies: Vec<Remedy>,
        measured: &'a Finding,
    }
    serializer.collect_seq(findings.iter().map(|finding| Form {
        finding: finding.to_string(),
        meaning: finding.meaning(),
        doubt: finding.is_doubt(),
        remedies: finding.remedies(),
        measured: finding,
    }))
}

#[cfg(test)]
mod tests {
    use super::{percent, rounded};

    #[test]
    fn findings_are_printed_to_three_digits() {
        assert_eq!(rounded(0.012_349), 0.0123);
        assert_eq!(rounded(0.0), 0.0);
        assert_eq!(percent(0.123_456), "12.3");
    }
}
