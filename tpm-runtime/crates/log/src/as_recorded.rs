//! A record whose channels keep times of their own: nothing is resampled, filled in, or split.
//!
//! A blank field is no reading, and no gap: topics that are written at their own rates, or when they change, share the rows of a table.
//! Invariant: every channel is finite, in the unit of its signal, and in the order of time.

use crate::columns::Columns;
use crate::error::LogError;
use crate::lone::lone_readings;
use crate::names::Signal;
use crate::options::ReadingSettings;
use crate::read::{acceleration_signals, jitter, rate_signals, signals};
use crate::repeated::repeated_readings;
use crate::report::{ReadingReport, Repeated, SegmentReport};
use crate::source::LogSource;
use crate::stamps::Uneven;
use crate::steps::Steps;
use crate::table::Table;
use crate::wraps::followed;
use std::collections::BTreeSet;
use tpm_controller::model::{Model, moving};

/// Time that goes back by more usual steps than this begins another recording.
const MOST_BACK: f64 = 20.0;

/// The readings or settings of one signal, at times of its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelReadings {
    /// Stamps, s, from the first stamp of the file.
    pub time: Vec<f64>,
    /// Values, in the unit of the signal.
    pub value: Vec<f64>,
    /// Lines of the file.
    pub lines: Vec<u64>,
}

/// A reading far from its neighbours, which was left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lone {
    /// The coordinate.
    pub coordinate: usize,
    /// Line of the reading.
    pub line: u64,
    /// How far it is from what its neighbours say.
    pub by: f64,
}

/// A record whose channels keep their times.
#[derive(Clone, Debug, PartialEq)]
pub struct AsRecorded {
    /// Name of the record's source, for messages.
    pub path: String,
    /// Readings of the coordinates; nothing for one that no sensor measures.
    pub coordinates: Vec<Option<ChannelReadings>>,
    /// Readings of rates that have a column, by coordinate.
    pub rates: Vec<Option<ChannelReadings>>,
    /// Readings of accelerations that a column was mapped to, by coordinate.
    pub accelerations: Vec<Option<ChannelReadings>>,
    /// The inputs.
    pub inputs: Vec<ChannelReadings>,
    /// Readings that were left out.
    pub lone: Vec<Lone>,
    /// What was assumed and found.
    pub report: ReadingReport,
    /// Usual time between two stamps of the file, s.
    pub usual_step: f64,
    /// Fingerprint of the file's bytes, or of the samples in memory.
    pub fingerprint: String,
}

impl AsRecorded {
    /// Reads the signals of a model from a file of any format, or from memory: coordinates that sensors measure, inputs and, where there are
    /// such columns, measured rates, and accelerations that a column is mapped to.
    ///
    /// # Errors
    /// [`LogError`] with the line when the file cannot be read, a column is missing or ambiguous, has no reading, a unit is not converted, or
    /// time goes back for good.
    pub fn open<'a>(
        source: impl Into<LogSource<'a>>,
        model: &dyn Model<f64>,
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        let source: LogSource<'_> = source.into();
        let (read, fingerprint) = source.read(|columns, name| Self::of(columns, name, model, options))?;
        Ok(AsRecorded { fingerprint, ..read })
    }

    fn of(
        columns: &mut dyn Columns,
        path: &str,
        model: &dyn Model<f64>,
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        let n = moving(model);
        if n < model.dims().coordinates {
            return Err(LogError::BuildsUp { path: path.into(), coordinate: model.coordinate(n).name.into() });
        }
        let measured: Vec<bool> = (0..n).map(|c| model.is_measured(c)).collect();
        let mut needed = signals(model);
        let inputs = needed.split_off(n);
        let sensors: Vec<Signal> =
            needed.into_iter().zip(&measured).filter(|(_, measured)| **measured).map(|(signal, _)| signal).collect();
        let wanted: Vec<Signal> = sensors.iter().chain(&inputs).cloned().collect();
        let (of_accelerations, also): (Vec<usize>, Vec<Signal>) =
            acceleration_signals(model, options).into_iter().unzip();
        let also: Vec<Signal> = rate_signals(model).into_iter().chain(also).collect();
        let mut table = Table::read_apart(columns, path, &wanted, &also, options)?;
        let order = in_order(&table)?;
        let first = order.first().map_or(0.0, |&row| table.time[row]);
        let column = |values: &[f64]| {
            let mut own = ChannelReadings::default();
            for &row in order.iter().filter(|&&row| values[row].is_finite()) {
                own.time.push((table.time[row] - first) * table.factor);
                own.value.push(values[row]);
                own.lines.push(table.lines[row]);
            }
            own
        };
        let all: Vec<Option<ChannelReadings>> =
            table.each().map(|channel| channel.map(|channel| column(&channel.values))).collect();
        let mut all = all.into_iter();
        let mut report = ReadingReport { rows: table.time.len(), ..ReadingReport::default() };
        let mut lone = Vec::new();
        let mut coordinates: Vec<Option<ChannelReadings>> = Vec::with_capacity(n);
        let mut named = sensors.iter();
        for (coordinate, measured) in measured.iter().enumerate() {
            let (true, Some(signal)) = (*measured, named.as_slice().first()) else {
                coordinates.push(None);
                continue;
            };
            let place = sensors.len() - named.len();
            named.next();
            let own = all.next().flatten().unwrap_or_default();
            let mut own = with_readings(own, path, table.header_line, signal)?;
            let written = table.channels[place].steps(&own.value, &own.lines);
            let steps = follow(&mut own, &written, path, signal, &mut report)?;
            // What a row says of the motion jumps with a held input, as an accelerometer does.
            let smooth = model.coordinate_order(coordinate) > 0;
            let outliers = if smooth { lone_readings(&own.value, &steps) } else { Vec::new() };
            lone.extend(outliers.iter().map(|&(k, value)| Lone {
                coordinate,
                line: own.lines[k],
                by: own.value[k] - value,
            }));
            own.leave_out(outliers.into_iter().map(|(k, _)| k));
            coordinates.push(Some(own));
        }
        let inputs: Vec<ChannelReadings> = inputs
            .iter()
            .map(|signal| with_readings(all.next().flatten().unwrap_or_default(), path, table.header_line, signal))
            .collect::<Result<_, _>>()?;
        let inputs = inputs.into_iter().map(ChannelReadings::last_of_each).collect();
        let mut all = all.map(|own| own.filter(|own| !own.time.is_empty()));
        let rates = all.by_ref().take(n).collect();
        let mut accelerations = vec![None; n];
        of_accelerations.into_iter().zip(all).for_each(|(c, own)| accelerations[c] = own);
        let usual_step = table.stamps().usual_step() * table.factor;
        let line = |at: Option<&usize>| at.map_or(table.header_line, |&row| table.lines[row]);
        report.segments.push(SegmentReport {
            from_line: line(order.first()),
            to_line: line(order.last()),
            samples: order.len(),
            start: 0.0,
            cut: None,
        });
        report.assumptions = std::mem::take(&mut table.assumptions);
        let path = path.to_owned();
        Ok(AsRecorded {
            path,
            coordinates,
            rates,
            accelerations,
            inputs,
            lone,
            report,
            usual_step,
            fingerprint: String::new(),
        })
    }
}

impl ChannelReadings {
    /// Leaves out readings.
    fn leave_out(&mut self, places: impl IntoIterator<Item = usize>) {
        let places: BTreeSet<usize> = places.into_iter().collect();
        let keep: Vec<bool> = (0..self.time.len()).map(|k| !places.contains(&k)).collect();
        let of = |k: &mut std::slice::Iter<'_, bool>| k.next().copied().unwrap_or(true);
        let (mut a, mut b, mut c) = (keep.iter(), keep.iter(), keep.iter());
        self.time.retain(|_| of(&mut a));
        self.value.retain(|_| of(&mut b));
        self.lines.retain(|_| of(&mut c));
    }

    /// The last of those with one stamp, which is what a setting is from then on.
    fn last_of_each(mut self) -> Self {
        let earlier: Vec<usize> =
            (1..self.time.len()).filter(|&k| self.time[k] <= self.time[k - 1]).map(|k| k - 1).collect();
        self.leave_out(earlier);
        self
    }
}

/// A channel that has readings.
fn with_readings(own: ChannelReadings, path: &str, line: u64, signal: &Signal) -> Result<ChannelReadings, LogError> {
    if own.time.is_empty() {
        return Err(LogError::NoReading { path: path.into(), line, signal: signal.name.clone() });
    }
    Ok(own)
}

/// Follows the readings of a coordinate over their wraps, and leaves out those that repeat the reading before while it moves. `written` is
/// the step of every reading; returns the steps by the size of the readings.
fn follow(
    own: &mut ChannelReadings,
    written: &[f64],
    path: &str,
    signal: &Signal,
    report: &mut ReadingReport,
) -> Result<Steps, LogError> {
    report.wrapped.extend(followed(path, signal, &mut own.value, &own.lines)?);
    let steps = Steps::of_values(&own.value, written);
    let repeated: Vec<usize> = repeated_readings(&own.value, &steps).into_iter().map(|(k, _)| k).collect();
    if let Some(&first) = repeated.first() {
        let (count, line) = (repeated.len(), own.lines[first]);
        report.repeated.push(Repeated { signal: signal.name.clone(), count, line });
        own.leave_out(repeated);
    }
    Ok(steps)
}

/// The rows in the order of time.
fn in_order(table: &Table) -> Result<Vec<usize>, LogError> {
    // Rows of several topics may share a stamp: the step from one stamp to the next is that of those that differ.
    let mut steps: Vec<f64> = table.time.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step != 0.0).collect();
    let usual = match steps.len() / 2 {
        _ if steps.is_empty() => 0.0,
        middle => *steps.select_nth_unstable_by(middle, f64::total_cmp).1,
    };
    if usual < 0.0 {
        let sample = (1..table.time.len()).find(|&i| table.time[i] < table.time[i - 1]).unwrap_or(1);
        let step = table.time[sample] - table.time[sample - 1];
        return Err(jitter(table, Uneven::Step { sample, step, expected: usual }));
    }
    let mut latest = f64::NEG_INFINITY;
    for (row, &time) in table.time.iter().enumerate() {
        if latest - time > MOST_BACK * usual {
            let (path, line) = (table.path.clone(), table.lines[row]);
            return Err(LogError::BackForGood { path, line, seconds: (latest - time) * table.factor });
        }
        latest = latest.max(time);
    }
    let mut order: Vec<usize> = (0..table.time.len()).collect();
    order.sort_by(|&a, &b| table.time[a].total_cmp(&table.time[b]));
    Ok(order)
}
