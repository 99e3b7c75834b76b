//! A record with gaps: stretches of even samples, and a report on reading them.
//!
//! Invariant: where readings are missing or time jumps, the record is split, unless its motion is slow enough to be refilled there, which is
//! said; every segment is an evenly sampled [`Log`], and all have the same sample time.

use crate::answers::without_answers;
use crate::assumption::Assumption;
use crate::columns::Columns;
use crate::error::LogError;
use crate::format::open_columns;
use crate::joins::joins;
use crate::names::Signal;
use crate::options::{LEAST_SAMPLES, ReadingSettings};
use crate::read::{Log, all_measured, jitter, rate_signals, signals, tidy};
use crate::refill::{InterpolationError, LONGEST, Refill};
use crate::repeated::repeated_readings;
use crate::report::{Bridged, Cut, Jitter, LeftOut, ReadingReport, Repeated, SegmentReport, Unevenness, Why, Wrapped};
use crate::resample::{held_on_grid, is_held, readings_before};
use crate::source::LogSource;
use crate::stamps::{LEAST_GAP, Uneven};
use crate::table::{Channel, Hole, Table};
use crate::times::{Read, Times};
use crate::wraps::followed;
use std::io;
use std::ops::Range;
use tpm_controller::model::{Model, moving};
use tpm_numerics::root_mean_square;
use tpm_numerics::spectrum::Spectrum;

/// Rounds in which the band of a motion and the gaps that it bridges are found from each other.
const ROUNDS: usize = 4;
/// Where no more than one row in so many has the stamp of the row before, it was written twice; clocks that tick seldom repeat more.
const ROWS_PER_REPEAT: usize = 100;

/// Everything that a file holds of a model's signals.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Name of the record's source, for messages.
    pub path: String,
    /// Stretches without a gap, in the order of the file; there is one at least.
    pub segments: Vec<Log>,
    /// What was assumed, found and left out.
    pub report: ReadingReport,
    /// Fingerprint of the file's bytes, or of the samples in memory; empty for a record that was not opened.
    pub fingerprint: String,
}

/// A record of one segment, such as one in memory.
impl From<Log> for Recording {
    fn from(log: Log) -> Self {
        let segment = SegmentReport::of(&log, 0.0, None);
        let report = ReadingReport { rows: log.len(), segments: vec![segment], ..ReadingReport::default() };
        Recording { path: log.path.clone(), segments: vec![log], report, fingerprint: String::new() }
    }
}

impl Recording {
    /// Reads the signals of a model from a file of any format, or from memory: coordinates, inputs and, where there are such columns,
    /// measured rates.
    ///
    /// # Errors
    /// [`LogError`] with the line when the file cannot be read, a column is missing or ambiguous, a unit is not converted, a field is
    /// neither a number nor missing, or no stretch is long enough.
    pub fn open<'a>(
        source: impl Into<LogSource<'a>>,
        model: &dyn Model<f64>,
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        let source: LogSource<'_> = source.into();
        let (read, fingerprint) = source.read(|columns, name| Self::of_model(columns, name, model, options))?;
        Ok(Recording { fingerprint, ..read })
    }

    /// Reads the signals of a model from bytes of any format; messages call them `name`.
    ///
    /// # Errors
    /// Those of [`open`](Self::open).
    pub fn read(
        input: impl io::Read,
        name: &str,
        model: &dyn Model<f64>,
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        Self::of_model(&mut *open_columns(input, name)?, name, model, options)
    }

    /// Takes the signals of a model from columns.
    fn of_model(
        columns: &mut dyn Columns,
        name: &str,
        model: &dyn Model<f64>,
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        all_measured(model, name)?;
        let (signals, rates) = (signals(model), rate_signals(model));
        let mut read = Self::of_columns(columns, name, (&signals[..moving(model)], &signals), &rates, options)?;
        read.segments.iter_mut().for_each(|log| log.follow(model));
        Ok(read)
    }

    /// Takes signals, of which the first are coordinates, and, where they have a column, rates from columns.
    pub(super) fn of_columns(
        columns: &mut dyn Columns,
        name: &str,
        (coordinates, signals): (&[Signal], &[Signal]),
        rates: &[Signal],
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        let mut table = Table::read(columns, name, signals, rates, options)?;
        // Where rows stand for themselves, nothing is said of one by those about it: wraps, readings that repeat, recordings that begin.
        let coordinates = if options.timeless { &[] } else { coordinates };
        let wrapped = table.with_steps(coordinates.len(), |table| follow_wraps(table, coordinates))?;
        let repeated = replace_repeated(&mut table, coordinates);
        let mut read = Self::of(table, (coordinates, rates), |table| table.constant(signals).map_or(Ok(()), Err))?;
        read.report.repeated = repeated;
        read.report.wrapped = wrapped;
        Ok(read)
    }

    /// Number of samples in all segments.
    #[must_use]
    pub fn len(&self) -> usize {
        self.segments.iter().map(Log::len).sum()
    }

    /// Whether there are no samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Splits a table where readings are missing, and where the time or a coordinate jumps; the coordinates are the
    /// first channels. `check` may refuse the table.
    pub(super) fn of(
        mut table: Table,
        (coordinates, rates): (&[Signal], &[Signal]),
        check: impl FnOnce(&Table) -> Result<(), LogError>,
    ) -> Result<Self, LogError> {
        let rows = table.time.len() + table.holes.iter().map(|hole| hole.rows).sum::<usize>();
        if table.holes.is_empty() && table.time.len() < LEAST_SAMPLES {
            return Err(LogError::TooShort {
                path: table.path,
                line: table.lines.last().copied().unwrap_or(table.header_line),
                samples: table.time.len(),
                needed: LEAST_SAMPLES,
            });
        }
        let usual = table.stamps().usual_step();
        if table.time.len() >= LEAST_SAMPLES
            && (usual < 0.0 || usual == 0.0 && table.time.iter().all(|t| *t <= table.time[0]))
        {
            let sample = (1..table.time.len()).find(|&i| table.time[i] <= table.time[i - 1]).unwrap_or(1);
            let step = table.time[sample] - table.time[sample - 1];
            return Err(jitter(&table, Uneven::Step { sample, step, expected: usual }));
        }
        let mut left_out = left_out(&table);
        left_out.extend(leave_out_stray(&mut table));
        left_out.sort_by_key(|part| part.from_line);
        if table.time.len() < LEAST_SAMPLES {
            return Err(no_segment(&table, rows));
        }
        check(&table)?;
        // 1. The runs in which time goes on, when their readings were taken, and the gaps that their motion does not bridge.
        let samples = table.time.len();
        let ends = ends(&table);
        let runs: Vec<Range<usize>> = pieces(&ends, samples).into_iter().map(|(run, _)| run).collect();
        let times = Times::of(&table, &runs);
        let mut cuts = ends;
        cuts.extend(joined(&table, coordinates, &times));
        let bridge = Bridge::of(&table, &times, &cuts, coordinates.len());
        let pieces = bridge.pieces(&table, &times, &cuts);
        let mut report =
            ReadingReport { rows, left_out, assumptions: std::mem::take(&mut table.assumptions), ..Default::default() };
        // 2. The segments at even times.
        let ranges: Vec<Range<usize>> = pieces.iter().map(|(piece, _)| piece.clone()).collect();
        let first = table.time[0];
        let starts: Vec<f64> = ranges.iter().map(|range| (table.time[range.start] - first) * table.factor).collect();
        let sample_time = times.step * table.factor;
        report.jitter = jitter_of(&table.time, &times, &ranges);
        bridge.report(&table, &times, &ranges, &mut report);
        let is_whole =
            |range: &Range<usize>| times.at[range.end - 1] - times.at[range.start] == (range.len() - 1) as f64;
        let logs = if times.read != Read::Uneven && ranges.iter().all(is_whole) {
            stretches(&mut table, &ranges)
        } else {
            bridge.refilled(&table, &times, &ranges)
        };
        let segments: Vec<Log> =
            logs.into_iter().map(|log| Log { sample_time, steps: table.steps.clone(), ..log }).collect();
        // 3. The report on segments and on rates that are left out.
        for ((log, start), (_, cut)) in segments.iter().zip(starts).zip(&pieces) {
            report.segments.push(SegmentReport::of(log, start, cut.clone()));
        }
        for log in &segments {
            let (from_line, to_line) = (log.lines[0], log.lines[log.len() - 1]);
            let lost = |c: &usize| table.rates[*c].is_some() && log.rates.get(*c).is_none_or(Option::is_none);
            report.assumptions.extend((0..rates.len()).filter(lost).map(|c| Assumption::RateLeftOut {
                signal: rates[c].name.clone(),
                from_line,
                to_line,
            }));
        }
        Ok(Recording { path: table.path, segments, report, fingerprint: String::new() })
    }
}

/// Follows the readings of the coordinates (the first channels) over their wraps.
fn follow_wraps(table: &mut Table, coordinates: &[Signal]) -> Result<Vec<Wrapped>, LogError> {
    let channels = coordinates.iter().zip(&mut table.channels);
    let of =
        |(signal, channel): (&Signal, &mut Channel)| followed(&table.path, signal, &mut channel.values, &table.lines);
    channels.filter_map(|pair| of(pair).transpose()).collect()
}

/// Replaces readings of the coordinates (the first channels) that repeat the reading before by values interpolated from
/// fresh readings.
fn replace_repeated(table: &mut Table, coordinates: &[Signal]) -> Vec<Repeated> {
    let mut all = Vec::new();
    for ((signal, channel), steps) in coordinates.iter().zip(&mut table.channels).zip(&table.steps) {
        let repeated = repeated_readings(&channel.values, steps);
        let Some(&(first, _)) = repeated.first() else { continue };
        all.push(Repeated { signal: signal.name.clone(), count: repeated.len(), line: table.lines[first] });
        repeated.into_iter().for_each(|(k, value)| channel.values[k] = value);
    }
    all
}

/// Leaves out rows whose stamps alone go back or ahead, or repeat the one before because a row was written twice.
fn leave_out_stray(table: &mut Table) -> Vec<LeftOut> {
    let time = &table.time;
    let still = time.windows(2).filter(|pair| pair[0] == pair[1]).count();
    let back = |k: &usize| time[*k] < time[k - 1] || time[*k] == time[k - 1] && still * ROWS_PER_REPEAT <= time.len();
    let stray = |k: usize| {
        let goes_on = time.get(k + 1).is_some_and(|next| *next > time[k - 1]);
        let ahead = k > 1 && time[k] > time[k - 2];
        if goes_on { Some(k) } else { ahead.then(|| k - 1) }
    };
    let mut rows: Vec<usize> = (1..time.len()).filter(back).filter_map(stray).collect();
    rows.dedup();
    let of = |&row: &usize| {
        let line = table.lines[row];
        LeftOut { from_line: line, to_line: line, rows: 1, why: Why::Stray }
    };
    let left_out = rows.iter().map(of).collect();
    if !rows.is_empty() {
        table.leave_out(&rows);
    }
    left_out
}

/// Samples before which time goes back.
fn ends(table: &Table) -> Vec<(usize, Cut)> {
    let step = |sample: usize| (table.time[sample] - table.time[sample - 1]) * table.factor;
    let ends = (1..table.time.len()).filter(|&sample| step(sample) < 0.0);
    ends.map(|sample| (sample, Cut::Back { seconds: -step(sample) })).collect()
}

/// Samples before which a coordinate jumps although no reading is missing there.
fn joined(table: &Table, coordinates: &[Signal], times: &Times) -> Vec<(usize, Cut)> {
    let mut all = Vec::new();
    for (signal, channel) in coordinates.iter().zip(&table.channels) {
        let jumps = joins(&channel.values).into_iter().filter(|(sample, _)| times.apart(*sample) < LEAST_GAP);
        let joined = |(sample, by)| (sample, Cut::Joined { signal: signal.name.clone(), by });
        all.extend(without_answers(jumps.collect(), &table.channels[coordinates.len()..]).into_iter().map(joined));
    }
    all
}

/// The stretches between cuts, each with the cut before it.
fn pieces(cuts: &[(usize, Cut)], samples: usize) -> Vec<(Range<usize>, Option<Cut>)> {
    let inner = cuts.iter().filter(|(sample, _)| *sample > 0 && *sample < samples);
    let mut pieces = vec![(0..samples, None)];
    for (sample, cut) in inner {
        if let Some((last, _)) = pieces.last_mut() {
            last.end = *sample;
        }
        pieces.push((*sample..samples, Some(cut.clone())));
    }
    pieces
}

/// The rows that lack a reading.
fn left_out(table: &Table) -> Vec<LeftOut> {
    let missing = |hole: &Hole| LeftOut {
        from_line: hole.from_line,
        to_line: hole.to_line,
        rows: hole.rows,
        why: Why::Missing { column: hole.column.clone() },
    };
    table.holes.iter().map(missing).collect()
}

fn no_segment(table: &Table, rows: usize) -> LogError {
    let hole = table.holes.first();
    let missing: usize = table.holes.iter().map(|hole| hole.rows).sum();
    let why = hole.map_or("no row is whole".into(), |Hole { column, .. }| {
        format!(
            "column `{column}` has no number there, and {missing} rows lack one; columns with times of their own need {LEAST_SAMPLES} readings of each coordinate, and stamps that do not go back"
        )
    });
    LogError::NoSegment {
        path: table.path.clone(),
        from: table.lines.first().copied().or(hole.map(|hole| hole.from_line)).unwrap_or(table.header_line),
        to: table.lines.last().copied().max(table.holes.last().map(|hole| hole.to_line)).unwrap_or(table.header_line),
        rows,
        needed: LEAST_SAMPLES,
        longest: table.time.len(),
        cut: hole.map_or(table.header_line, |hole| hole.from_line),
        why,
    }
}

/// The gaps that a motion bridges.
struct Bridge {
    /// Highest frequency of the motion, in periods a sample.
    band: f64,
    /// Longest time between two readings that is bridged, in samples.
    longest: f64,
}

impl Bridge {
    /// The band of the motion is that of its record with the gaps bridged, which are bridged by the band. At first it is as if bridged by
    /// straight lines, whose corners make it too high, so that more gaps are bridged from round to round.
    fn of(table: &Table, times: &Times, cuts: &[(usize, Cut)], coordinates: usize) -> Self {
        // No motion is seen that is slower than the record is long.
        let mut bridge = Bridge { band: 0.5, longest: LONGEST * table.time.len() as f64 };
        if times.read != Read::Uneven && (1..table.time.len()).all(|sample| times.apart(sample) < LEAST_GAP) {
            return bridge;
        }
        let step = times.step * table.factor;
        let of = |channel: &Channel, bridge: &Bridge| {
            let pieces = bridge.pieces(table, times, cuts).into_iter();
            let even: Vec<Vec<f64>> =
                pieces.map(|(piece, _)| bridge.over(&times.at_from(&piece)).of(&channel.values[piece])).collect();
            let moves = even.iter().any(|own| own.iter().any(|value| *value != own[0]));
            let all: Vec<&[f64]> = even.iter().map(Vec::as_slice).collect();
            if moves { Spectrum::of(&all, step).followed * step } else { 0.0 }
        };
        for _ in 0..ROUNDS {
            let moving = table.channels.iter().zip(held(table)).enumerate();
            let moving = moving.filter(|(c, (_, held))| *c < coordinates || coordinates == 0 && !held);
            let band = moving.map(|(_, (channel, _))| of(channel, &bridge)).fold(0.0, f64::max);
            let longest = (LONGEST / band).min(LONGEST * table.time.len() as f64);
            if band <= 0.0 || longest == bridge.longest {
                break;
            }
            bridge = Bridge { band, longest };
        }
        bridge
    }

    fn over<'a>(&self, at: &'a [f64]) -> Refill<'a> {
        Refill { at, band: self.band }
    }

    /// The stretches between cuts and gaps that are not bridged, each with the reason for it.
    fn pieces(&self, table: &Table, times: &Times, cuts: &[(usize, Cut)]) -> Vec<(Range<usize>, Option<Cut>)> {
        let wide = |sample: &usize| times.apart(*sample) > LEAST_GAP.max(self.longest + 1e-6);
        let gap = |sample: usize| {
            let seconds = (table.time[sample] - table.time[sample - 1]) * table.factor;
            let missing = table.holes.iter().find(|hole| hole.before == sample);
            let missing = missing.map(|hole| Cut::Missing { rows: hole.rows, from_line: hole.from_line });
            (sample, missing.unwrap_or(Cut::Gap { seconds }))
        };
        let mut all: Vec<(usize, Cut)> = cuts.to_vec();
        all.extend((1..table.time.len()).filter(wide).map(gap));
        all.sort_by_key(|(sample, _)| *sample);
        all.dedup_by_key(|(sample, _)| *sample);
        pieces(&all, table.time.len())
    }

    /// Says how stamps were read, what is bridged, and how far the motion may err there.
    fn report(&self, table: &Table, times: &Times, pieces: &[Range<usize>], report: &mut ReadingReport) {
        let apart = pieces.iter().flat_map(|piece| (piece.start + 1..piece.end).map(|sample| times.apart(sample)));
        let resampled = times.read == Read::Uneven;
        // A step of uneven readings lost none where it is not twice as long as the others.
        let least = if resampled { 2.0 } else { LEAST_GAP };
        let gaps: Vec<f64> = apart.filter(|apart| *apart >= least).collect();
        let errors = if resampled || !gaps.is_empty() { self.errors(table, times, pieces) } else { Vec::new() };
        let sample_time = times.step * table.factor;
        if !gaps.is_empty() {
            report.bridged = Some(Bridged {
                count: gaps.len(),
                samples: gaps.iter().map(|apart| apart.round() as usize - 1).sum(),
                longest: gaps.iter().copied().fold(0.0, f64::max) * sample_time,
                band: self.band / sample_time,
                errors: errors.clone(),
            });
        }
        if times.read != Read::Even {
            let Jitter { rms, largest } = report.jitter;
            let still = table.time.windows(2).filter(|pair| pair[0] == pair[1]).count();
            let tick = (still * ROWS_PER_REPEAT > table.time.len()).then(|| table.stamps().usual_tick() * table.factor);
            let interpolation = if resampled { errors } else { Vec::new() };
            report.uneven = Some(Unevenness { rms, largest, resampled, sample_time, tick, interpolation });
        }
    }

    /// The errors of refilling, channel by channel.
    fn errors(&self, table: &Table, times: &Times, pieces: &[Range<usize>]) -> Vec<InterpolationError> {
        let of = |Channel { column, values: channel, .. }: &Channel| {
            let errors = pieces.iter().map(|piece| self.over(&times.at_from(piece)).errors(&channel[piece.clone()]));
            let (square, count) = errors.fold((0.0, 0), |(a, b), (square, count)| (a + square, b + count));
            let rms = (square / count.max(1) as f64).sqrt();
            let mean = channel.iter().sum::<f64>() / channel.len() as f64;
            let deviation = root_mean_square(channel.iter().map(|x| x - mean));
            let share = if deviation > 0.0 { rms / deviation } else { 0.0 };
            (count > 0).then(|| InterpolationError { column: column.clone(), rms, share })
        };
        let all = table.channels.iter().zip(held(table));
        all.filter(|(_, held)| !held).filter_map(|(channel, _)| of(channel)).collect()
    }

    /// The segments at even times: held inputs by their means, everything else refilled.
    fn refilled(&self, table: &Table, times: &Times, pieces: &[Range<usize>]) -> Vec<Log> {
        let of = |piece: &Range<usize>| {
            let at = times.at_from(piece);
            let refill = self.over(&at);
            let samples = refill.samples();
            let even = |channel: &Channel| refill.of(&channel.values[piece.clone()]);
            let lines = readings_before(&at, samples).into_iter().map(|i| table.lines[piece.start + i]).collect();
            let is_there = |rate: &&Channel| rate.values[piece.clone()].iter().all(|value| value.is_finite());
            let rates = table.rates.iter().map(|rate| rate.as_ref().filter(is_there).map(even)).collect();
            let own = |(channel, held): (&Channel, bool)| {
                if held { held_on_grid(&at, &channel.values[piece.clone()], samples) } else { even(channel) }
            };
            Log::unchecked(&table.path, table.channels.iter().zip(held(table)).map(own).collect(), tidy(rates), lines)
        };
        pieces.iter().map(of).collect()
    }
}

/// Deviation of the steps in the segments from the sample time, as a share of it.
fn jitter_of(time: &[f64], times: &Times, pieces: &[Range<usize>]) -> Jitter {
    let inner = || pieces.iter().flat_map(|piece| piece.start + 1..piece.end);
    let counted = |i: usize| (times.count[i] - times.count[i - 1]) as f64;
    let off = || inner().map(|i| (time[i] - time[i - 1]) / times.step - counted(i));
    Jitter { rms: root_mean_square(off()), largest: off().map(f64::abs).fold(0.0, f64::max) }
}

/// Whether a channel is an input that is held between its stamps.
fn held(table: &Table) -> impl Iterator<Item = bool> + '_ {
    table.channels.iter().enumerate().map(|(c, channel)| c >= table.rates.len() && is_held(&channel.values))
}

/// The segments, moved out of the table without interpolation.
fn stretches(table: &mut Table, segments: &[Range<usize>]) -> Vec<Log> {
    let taken = |Channel { values, .. }: &mut Channel, range: &Range<usize>| {
        if *range == (0..values.len()) { std::mem::take(values) } else { values[range.clone()].to_vec() }
    };
    let of = |range: &Range<usize>| {
        let lines = if *range == (0..table.lines.len()) {
            std::mem::take(&mut table.lines)
        } else {
            table.lines[range.clone()].to_vec()
        };
        let channels = table.channels.iter_mut().map(|channel| taken(channel, range)).collect();
        let rates = table.rates.iter_mut().map(|rate| finite(rate.as_mut().map(|rate| taken(rate, range)))).collect();
        Log::unchecked(&table.path, channels, tidy(rates), lines)
    };
    segments.iter().map(of).collect()
}

/// The rate, provided that all its readings are finite.
fn finite(rate: Option<Vec<f64>>) -> Option<Vec<f64>> {
    rate.filter(|rate| rate.iter().all(|value| value.is_finite()))
}
