//! A record with gaps: stretches of even samples, and a report on reading them.
//!
//! Invariant: nothing is filled in. Where readings are missing or time jumps, the record is split; every segment is an evenly sampled
//! [`Log`], and all have the same sample time.

use crate::answers::without_answers;
use crate::assumption::Assumption;
use crate::columns::Columns;
use crate::error::LogError;
use crate::format::open_columns;
use crate::joins::joins;
use crate::names::Signal;
use crate::options::{LEAST_SAMPLES, ReadingSettings};
use crate::read::{Log, all_measured, jitter, rate_signals, signals, tidy};
use crate::repeated::{repeated_readings, without_repeats};
use crate::report::{Cut, Jitter, LeftOut, ReadingReport, Repeated, SegmentReport, Unevenness, Why, Wrapped};
use crate::resample::{
    InterpolationError, held_on_grid, interpolation_error, is_held, on_grid, readings_before, rougher_at_stamps,
};
use crate::source::LogSource;
use crate::stamps::{MOST_DRIFT, Stamps, Uneven};
use crate::table::{Channel, Hole, Table};
use crate::wraps::followed;
use std::io::Read;
use std::ops::Range;
use tpm_controller::model::Model;
use tpm_numerics::root_mean_square;

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
        input: impl Read,
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
        Self::of_columns(columns, name, (&signals[..model.dims().coordinates], &signals), &rates, options)
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
        if usual <= 0.0 && table.time.len() >= LEAST_SAMPLES {
            let sample = (1..table.time.len()).find(|&i| table.time[i] <= table.time[i - 1]).unwrap_or(1);
            let step = table.time[sample] - table.time[sample - 1];
            return Err(jitter(&table, Uneven::Step { sample, step, expected: usual }));
        }
        // 1. The cuts, and the stretches between them that are long enough.
        let cuts = cuts(&table, coordinates, usual);
        let pieces = pieces(&cuts, table.time.len());
        let good: Vec<&(Range<usize>, Option<Cut>)> =
            pieces.iter().filter(|(piece, _)| piece.len() >= LEAST_SAMPLES).collect();
        if good.is_empty() {
            return Err(no_segment(&table, rows, &pieces));
        }
        check(&table)?;
        let mut report =
            ReadingReport { rows, assumptions: std::mem::take(&mut table.assumptions), ..Default::default() };
        report.left_out = left_out(&table, &pieces);
        // 2. The even grid, and the segments on it.
        let ranges: Vec<Range<usize>> = good.iter().map(|(piece, _)| piece.clone()).collect();
        let first = table.time[0];
        let starts: Vec<f64> = ranges.iter().map(|range| (table.time[range.start] - first) * table.factor).collect();
        let grid = Grid::of(&table, &ranges);
        let sample_time = grid.step * table.factor;
        report.uneven = grid.uneven;
        report.jitter = jitter_of(&table.time, &ranges, grid.step);
        let logs = if grid.resampled { resampled(&table, &ranges, grid.step) } else { stretches(&mut table, &ranges) };
        let segments: Vec<Log> =
            logs.into_iter().map(|log| Log { sample_time, steps: table.steps.clone(), ..log }).collect();
        // 3. The report on segments and on rates that are left out.
        for ((log, start), (_, cut)) in segments.iter().zip(starts).zip(&good) {
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

/// Samples before which the record is split, with the reasons.
fn cuts(table: &Table, coordinates: &[Signal], usual: f64) -> Vec<(usize, Cut)> {
    let mut cuts: Vec<(usize, Cut)> = table
        .holes
        .iter()
        .map(|hole| (hole.before, Cut::Missing { rows: hole.rows, from_line: hole.from_line }))
        .collect();
    let stamps = table.stamps();
    if !(cuts.is_empty() && stamps.is_coarse_grid()) {
        let jump = |sample: usize| {
            let seconds = (table.time[sample] - table.time[sample - 1]) * table.factor;
            (sample, if seconds > 0.0 { Cut::Gap { seconds } } else { Cut::Back { seconds: -seconds } })
        };
        cuts.extend(stamps.jumps(usual).map(jump));
    }
    for ((signal, channel), steps) in coordinates.iter().zip(&table.channels).zip(&table.steps) {
        let joined = |(sample, by)| (sample, Cut::Joined { signal: signal.name.clone(), by });
        let jumps = joins(&without_repeats(&channel.values, steps));
        cuts.extend(without_answers(jumps, &table.channels[coordinates.len()..]).into_iter().map(joined));
    }
    // Of several cuts at one sample the cause is kept: missing readings cause a gap, and a gap causes a jump of the
    // motion.
    let rank = |cut: &Cut| match cut {
        Cut::Missing { .. } => 0,
        Cut::Gap { .. } | Cut::Back { .. } => 1,
        Cut::Joined { .. } => 2,
    };
    cuts.sort_by_key(|(sample, cut)| (*sample, rank(cut)));
    cuts.dedup_by_key(|(sample, _)| *sample);
    cuts
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

/// The rows of a record that are in no segment, with the reasons.
fn left_out(table: &Table, pieces: &[(Range<usize>, Option<Cut>)]) -> Vec<LeftOut> {
    let missing = |hole: &Hole| LeftOut {
        from_line: hole.from_line,
        to_line: hole.to_line,
        rows: hole.rows,
        why: Why::Missing { column: hole.column.clone() },
    };
    let short =
        pieces.iter().filter(|(piece, _)| !piece.is_empty() && piece.len() < LEAST_SAMPLES).map(|(piece, _)| LeftOut {
            from_line: table.lines[piece.start],
            to_line: table.lines[piece.end - 1],
            rows: piece.len(),
            why: Why::Short,
        });
    let mut left_out: Vec<LeftOut> = table.holes.iter().map(missing).chain(short).collect();
    left_out.sort_by_key(|part| part.from_line);
    left_out
}

fn no_segment(table: &Table, rows: usize, pieces: &[(Range<usize>, Option<Cut>)]) -> LogError {
    let hole = table.holes.first();
    let cut = pieces.get(1).map(|(piece, cut)| (table.lines[piece.start], cut.as_ref()));
    let (line, why) = match (hole, cut) {
        (Some(hole), cut) if cut.is_none_or(|(line, _)| hole.from_line <= line) => {
            let missing: usize = table.holes.iter().map(|hole| hole.rows).sum();
            let column = &hole.column;
            let why = format!(
                "column `{column}` has no number there, and {missing} rows lack one; columns with times of their own need {LEAST_SAMPLES} readings of each coordinate, and stamps that do not go back"
            );
            (hole.from_line, why)
        }
        (_, Some((line, Some(cut @ Cut::Joined { .. })))) => (line, format!("{cut}; identify longer recordings")),
        (_, Some((line, Some(cut)))) => (line, format!("{cut}; resample the log evenly with its true time stamps")),
        _ => (table.header_line, "no row is whole".into()),
    };
    LogError::NoSegment {
        path: table.path.clone(),
        from: table.lines.first().copied().or(hole.map(|hole| hole.from_line)).unwrap_or(table.header_line),
        to: table.lines.last().copied().max(table.holes.last().map(|hole| hole.to_line)).unwrap_or(table.header_line),
        rows,
        needed: LEAST_SAMPLES,
        longest: pieces.iter().map(|(piece, _)| piece.len()).max().unwrap_or(0),
        cut: line,
        why,
    }
}

/// The even grid on which all segments are read.
struct Grid {
    /// Its step, in the unit of the stamps.
    step: f64,
    uneven: Option<Unevenness>,
    /// Whether readings are interpolated to the grid; otherwise they are taken as the samples of the grid.
    resampled: bool,
}

impl Grid {
    fn of(table: &Table, segments: &[Range<usize>]) -> Self {
        let stamps = table.stamps();
        let span = |range: &Range<usize>| table.time[range.end - 1] - table.time[range.start];
        let intervals: usize = segments.iter().map(|range| range.len() - 1).sum();
        let step = segments.iter().map(span).sum::<f64>() / intervals as f64;
        let even = |range: &Range<usize>| {
            let apart = |own: f64| (own - step).abs() * (range.len() - 1) as f64;
            let digit = stamps.resolution.at(table.time[range.end - 1]);
            stamps
                .part(range.start, range.end)
                .even_step()
                .is_ok_and(|own| apart(own) <= MOST_DRIFT * step || apart(own) <= digit)
        };
        if segments.iter().all(even) {
            return Grid { step, uneven: None, resampled: false };
        }
        let fitted = fitted_step(stamps, segments);
        let near = segments.iter().all(|range| {
            let t = &table.time[range.clone()];
            let middle = (t.len() - 1) as f64 / 2.0;
            let mean = t.iter().map(|x| x - t[0]).sum::<f64>() / t.len() as f64;
            t.iter()
                .enumerate()
                .all(|(i, x)| (x - t[0] - mean - (i as f64 - middle) * fitted).abs() <= MOST_DRIFT * fitted)
        });
        let rougher: f64 = segments
            .iter()
            .map(|range| {
                let stamps = &table.time[range.clone()];
                let own = |channel: &Channel| rougher_at_stamps(stamps, &channel.values[range.clone()]);
                range.len() as f64 * table.channels.iter().map(own).sum::<f64>()
            })
            .sum();
        let resampled = !(near && rougher >= 0.0);
        let step = if resampled { step } else { fitted };
        let Jitter { rms, largest } = jitter_of(&table.time, segments, step);
        let errors = if resampled { errors(table, segments) } else { Vec::new() };
        let uneven = Unevenness { rms, largest, resampled, sample_time: step * table.factor, interpolation: errors };
        Grid { step, uneven: Some(uneven), resampled }
    }
}

/// Deviation of the steps in the segments from an even step, as a share of it.
fn jitter_of(time: &[f64], segments: &[Range<usize>], step: f64) -> Jitter {
    let off = || segments.iter().flat_map(|range| time[range.clone()].windows(2).map(|w| (w[1] - w[0]) / step - 1.0));
    Jitter { rms: root_mean_square(off()), largest: off().map(f64::abs).fold(0.0, f64::max) }
}

/// The step of the grids through the stamps of all segments, by least squares.
fn fitted_step(stamps: Stamps<'_>, segments: &[Range<usize>]) -> f64 {
    let (mut above, mut below) = (0.0, 0.0);
    for range in segments {
        let t = &stamps.time[range.clone()];
        let middle = (t.len() - 1) as f64 / 2.0;
        for (i, x) in t.iter().enumerate() {
            above += (i as f64 - middle) * (x - t[0]);
            below += (i as f64 - middle).powi(2);
        }
    }
    above / below
}

/// The errors of interpolation, channel by channel.
fn errors(table: &Table, segments: &[Range<usize>]) -> Vec<InterpolationError> {
    let of = |Channel { column, values: channel, .. }: &Channel| {
        let samples: usize = segments.iter().map(Range::len).sum();
        let square = |range: &Range<usize>| {
            let error = interpolation_error(&table.time[range.clone()], &channel[range.clone()]);
            range.len() as f64 * error.powi(2)
        };
        let rms = (segments.iter().map(square).sum::<f64>() / samples as f64).sqrt();
        let mean = channel.iter().sum::<f64>() / channel.len() as f64;
        let deviation = (channel.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / channel.len() as f64).sqrt();
        InterpolationError { column: column.clone(), rms, share: if deviation > 0.0 { rms / deviation } else { 0.0 } }
    };
    let all = table.channels.iter().zip(held(table));
    all.filter(|(_, held)| !held).map(|(channel, _)| of(channel)).collect()
}

/// Whether a channel is an input that is held between its stamps.
fn held(table: &Table) -> impl Iterator<Item = bool> + '_ {
    table.channels.iter().enumerate().map(|(c, channel)| c >= table.rates.len() && is_held(&channel.values))
}

/// The segments on an even grid: held inputs by their means, everything else by interpolation.
fn resampled(table: &Table, segments: &[Range<usize>], step: f64) -> Vec<Log> {
    let of = |range: &Range<usize>| {
        let stamps = &table.time[range.clone()];
        let samples = ((stamps[stamps.len() - 1] - stamps[0]) / step + 1e-6).floor() as usize + 1;
        let grid = |channel: &Channel| on_grid(stamps, &channel.values[range.clone()], step, samples);
        let lines = readings_before(stamps, step, samples).into_iter().map(|i| table.lines[range.start + i]).collect();
        let rates = table.rates.iter().map(|rate| finite(rate.as_ref().map(grid))).collect();
        let own = |(channel, held): (&Channel, bool)| {
            if held { held_on_grid(stamps, &channel.values[range.clone()], step, samples) } else { grid(channel) }
        };
        Log::unchecked(&table.path, table.channels.iter().zip(held(table)).map(own).collect(), tidy(rates), lines)
    };
    segments.iter().map(of).collect()
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
