//! The report on reading a log: assumptions, cuts, rows left out, and uneven time stamps.

use crate::assumption::Assumption;
use crate::read::Log;
use crate::refill::InterpolationError;
use serde::{Serialize, Serializer};
use std::fmt;
use tpm_report::number;

/// Most parts of one kind that are listed one by one.
const MOST_LISTED: usize = 4;

/// Why a record is split.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Cut {
    /// Readings are missing.
    Missing {
        /// Rows that lack one.
        rows: usize,
        /// Line of the first.
        from_line: u64,
    },
    /// Time advances by more than a sample.
    Gap {
        /// Time between the two samples, s.
        seconds: f64,
    },
    /// Time stands still or goes back.
    Back {
        /// By how much, s.
        seconds: f64,
    },
    /// A coordinate jumps from one sample to the next: another recording begins.
    Joined {
        /// The coordinate.
        signal: String,
        /// The jump beyond the motion's own change over the sample, unit of the coordinate.
        by: f64,
    },
}

impl fmt::Display for Cut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cut::Missing { rows: 1, from_line } => write!(f, "a reading is missing in line {from_line}"),
            Cut::Missing { rows, from_line } => {
                write!(f, "readings are missing in {rows} rows from line {from_line} on")
            }
            Cut::Gap { seconds } => write!(f, "time jumps ahead by {} s", number(*seconds)),
            Cut::Back { seconds } if *seconds == 0.0 => f.write_str("time stands still"),
            Cut::Joined { signal, by } => write!(
                f,
                "`{signal}` jumps by {} from one sample to the next: another recording begins there, or the reading wraps around",
                number(*by)
            ),
            Cut::Back { seconds } => write!(f, "time goes back by {} s", number(*seconds)),
        }
    }
}

/// A stretch of a record without a gap.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SegmentReport {
    /// First line.
    pub from_line: u64,
    /// Last line.
    pub to_line: u64,
    /// Samples.
    pub samples: usize,
    /// Time of the first sample, counted from the first sample of the record, s.
    pub start: f64,
    /// Why the record is split before this stretch; nothing for the first one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut: Option<Cut>,
}

impl SegmentReport {
    pub(super) fn of(log: &Log, start: f64, cut: Option<Cut>) -> Self {
        let line = |line: Option<&u64>| line.copied().unwrap_or(0);
        let (from_line, to_line) = (line(log.lines.first()), line(log.lines.last()));
        SegmentReport { from_line, to_line, samples: log.len(), start, cut }
    }
}

/// Why rows are in no segment.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Why {
    /// A field is empty, or not a finite number.
    Missing {
        /// Column of the first such field.
        column: String,
    },
    /// The stamp alone goes back, ahead, or repeats the one before.
    Stray,
}

/// Rows that are in no segment.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// First line.
    pub from_line: u64,
    /// Last line.
    pub to_line: u64,
    /// Rows.
    pub rows: usize,
    /// The reason.
    #[serde(flatten)]
    pub why: Why,
}

/// Time stamps that are not even, and how they were treated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unevenness {
    /// Root mean square of the deviation of a step from the sample time, as a share of the sample time.
    pub rms: f64,
    /// Largest such deviation.
    pub largest: f64,
    /// Whether the signals were interpolated at even times. Otherwise the readings are smoother on an even grid than at their stamps:
    /// they were taken evenly and stamped late.
    pub resampled: bool,
    /// The sample time of the even grid, s.
    pub sample_time: f64,
    /// Time by which the clock of the stamps goes on, s, where many rows have the stamp of the row before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tick: Option<f64>,
    /// The error of the interpolation, column by column.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub interpolation: Vec<InterpolationError>,
}

impl fmt::Display for Unevenness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| number(100.0 * share);
        let sample_time = number(self.sample_time);
        write!(
            f,
            "time stamps are uneven: steps are off by {} % (rms), {} % at most; ",
            percent(self.rms),
            percent(self.largest)
        )?;
        if !self.resampled {
            write!(
                f,
                "the readings are smoother when they are taken as even, every {sample_time} s, and so the stamps are taken as late, not the readings"
            )?;
            return match self.tick {
                Some(tick) => write!(
                    f,
                    "; many rows have the stamp of the row before, of a clock that ticks every {} s: the sample time is known to a tick in the whole record, and is better stated (--sample-time SECONDS)",
                    number(tick)
                ),
                None => Ok(()),
            };
        }
        write!(f, "resampled every {sample_time} s within the band of the motion{}", Errors(&self.interpolation))
    }
}

/// Errors of refilling, said behind what was refilled.
struct Errors<'a>(&'a [InterpolationError]);

impl fmt::Display for Errors<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let one = |InterpolationError { column, rms, share }: &InterpolationError| {
            format!("{} in `{column}` ({} % of its deviation)", number(*rms), number(100.0 * share))
        };
        let errors: Vec<String> = self.0.iter().map(one).collect();
        if errors.is_empty() { Ok(()) } else { write!(f, ", with errors of about {}", errors.join(", ")) }
    }
}

/// Gaps over which the motion was refilled from the readings around them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bridged {
    /// How many gaps.
    pub count: usize,
    /// Readings that are missing in them.
    pub samples: usize,
    /// Time from reading to reading over the longest, s.
    pub longest: f64,
    /// Highest frequency of the motion, Hz.
    pub band: f64,
    /// The error, column by column: of readings that are there and were hidden in the same way.
    pub errors: Vec<InterpolationError>,
}

impl fmt::Display for Bridged {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Bridged { count, samples, longest, band, errors } = self;
        let gaps = if *count == 1 { "gap" } else { "gaps" };
        let readings = if *samples == 1 { "reading is" } else { "readings are" };
        write!(
            f,
            "{samples} {readings} missing in {count} {gaps} of at most {} s, which are bridged by the motion around them, of up to {} Hz{}",
            number(*longest),
            number(*band),
            Errors(errors)
        )
    }
}

/// Deviation of the steps of time stamps from the sample time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Jitter {
    /// Root mean square, as a share of the sample time.
    pub rms: f64,
    /// Largest, as a share of the sample time.
    pub largest: f64,
}

/// Readings of a coordinate that repeat the one before although it moves: they were recorded before the sensor was read again.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Repeated {
    /// The coordinate.
    pub signal: String,
    /// How many readings.
    pub count: usize,
    /// Line of the first.
    pub line: u64,
}

impl fmt::Display for Repeated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Repeated { signal, count, line } = self;
        write!(
            f,
            "{count} readings of `{signal}`, the first in line {line}, repeat the one before although it moves: stale values, not updated when the row was written; what the fresh readings around them say was used instead"
        )
    }
}

/// A coordinate whose readings wrap around, and are followed over their wraps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Wrapped {
    /// The coordinate.
    pub signal: String,
    /// The range after which its readings begin again, in the unit of the coordinate.
    pub range: f64,
    /// How often they do.
    pub count: usize,
    /// Line of the first reading behind a wrap.
    pub line: u64,
}

impl fmt::Display for Wrapped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Wrapped { signal, range, count, line } = self;
        let times = if *count == 1 { "time" } else { "times" };
        write!(
            f,
            "`{signal}` jumps by its whole range, {}, {count} {times}, first in line {line}: the reading wraps around, and is unwrapped",
            number(*range)
        )
    }
}

/// What was assumed in reading a record, how it was split, and what was left out.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ReadingReport {
    /// Rows of numbers in the file.
    pub rows: usize,
    /// What was assumed of the file.
    pub assumptions: Vec<Assumption>,
    /// The stretches without a gap.
    pub segments: Vec<SegmentReport>,
    /// Rows that are in no segment.
    pub left_out: Vec<LeftOut>,
    /// Stamps that are not even.
    pub uneven: Option<Unevenness>,
    /// Gaps that were bridged.
    pub bridged: Option<Bridged>,
    /// Coordinates whose readings wrap around.
    pub wrapped: Vec<Wrapped>,
    /// Readings of coordinates that repeat the reading before, and were replaced. They are no part of the remarks,
    /// since they are reported by the estimator that uses the record.
    pub repeated: Vec<Repeated>,
    /// The only segment that was used, from 0; nothing where all were.
    pub used: Option<usize>,
    /// Deviation of the steps of all segments from the sample time. It is not serialised.
    pub jitter: Jitter,
}

impl ReadingReport {
    /// Whether there is nothing to report: an even record in one stretch, in the plainest format.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.repeated.is_empty() && self.remarks().is_empty()
    }

    /// Everything that a reader should know, in sentences.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        let mut remarks: Vec<String> = self.assumptions.iter().map(|assumption| assumption.to_string()).collect();
        remarks.extend(self.wrapped.iter().map(|wrapped| wrapped.to_string()));
        remarks.extend(self.uneven.iter().map(|uneven| uneven.to_string()));
        remarks.extend(self.bridged.iter().map(|bridged| bridged.to_string()));
        for part in self.left_out.iter().take(MOST_LISTED) {
            remarks.push(match &part.why {
                Why::Missing { column } => {
                    let fields = if part.rows == 1 { "is no number" } else { "are no numbers" };
                    format!("column `{column}`: in {} {fields}, which is left out", lines(part))
                }
                Why::Stray => format!("{}: the time stamp alone is out of order; the row is left out", lines(part)),
            });
        }
        if let Some(more) = self.left_out.len().checked_sub(MOST_LISTED).filter(|more| *more > 0) {
            let rows: usize = self.left_out[MOST_LISTED..].iter().map(|part| part.rows).sum();
            remarks
                .push(format!("{more} more stretches of missing readings or stray stamps are left out, {rows} rows"));
        }
        if self.segments.len() > 1 {
            let part = |segment: &SegmentReport| {
                let place = format!("lines {} to {}", segment.from_line, segment.to_line);
                match &segment.cut {
                    Some(cut) => format!("{place} ({cut})"),
                    None => place,
                }
            };
            let mut parts: Vec<String> = self.segments.iter().take(2 * MOST_LISTED).map(part).collect();
            if self.segments.len() > parts.len() {
                parts.push(format!("{} more", self.segments.len() - parts.len()));
            }
            remarks.push(format!("the record is split into {} segments: {}", self.segments.len(), parts.join(", ")));
        }
        if let Some(used) = self.used.and_then(|used| self.segments.get(used)) {
            let samples: usize = self.segments.iter().map(|segment| segment.samples).sum();
            remarks.push(format!(
                "lines {} to {} are used, the longest segment that repeats; the other {} samples are not",
                used.from_line,
                used.to_line,
                samples - used.samples
            ));
        }
        remarks
    }
}

fn lines(part: &LeftOut) -> String {
    if part.from_line == part.to_line {
        format!("line {}", part.from_line)
    } else {
        format!("lines {} to {}", part.from_line, part.to_line)
    }
}

/// Serialised: the fields, and `remarks` as people read them.
impl Serialize for ReadingReport {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Form<'a> {
            rows: usize,
            assumptions: &'a [Assumption],
            segments: &'a [SegmentReport],
            left_out: &'a [LeftOut],
            #[serde(skip_serializing_if = "Option::is_none")]
            uneven: Option<&'a Unevenness>,
            #[serde(skip_serializing_if = "Option::is_none")]
            bridged: Option<&'a Bridged>,
            #[serde(skip_serializing_if = "<[Wrapped]>::is_empty")]
            wrapped: &'a [Wrapped],
            #[serde(skip_serializing_if = "<[Repeated]>::is_empty")]
            repeated: &'a [Repeated],
            #[serde(skip_serializing_if = "Option::is_none")]
            used: Option<usize>,
            remarks: Vec<String>,
        }
        Form {
            rows: self.rows,
            assumptions: &self.assumptions,
            segments: &self.segments,
            left_out: &self.left_out,
            uneven: self.uneven.as_ref(),
            bridged: self.bridged.as_ref(),
            wrapped: &self.wrapped,
            repeated: &self.repeated,
            used: self.used,
            remarks: self.remarks(),
        }
        .serialize(serializer)
    }
}
