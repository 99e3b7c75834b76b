//! The rows of a log in the order of the file, with the places where readings are missing.

use crate::assumption::Assumption;
use crate::columns::{Columns, NotedText};
use crate::computed::Computed;
use crate::error::LogError;
use crate::names::{Names, Place, Plan, Signal, Time};
use crate::options::{LEAST_SAMPLES, ReadingSettings};
use crate::shared_rows::SharedRows;
use crate::stamps::{Resolution, Stamps};
use crate::steps::{Numbers, Steps};
use serde::Serialize;
use std::mem::take;

/// Least stamps that count nanoseconds, microseconds or milliseconds from 1970 on, with the unit and its length in s.
/// As seconds such stamps would lie thousands of years ahead.
const EPOCHS: [(f64, &str, f64); 3] = [(1e17, "ns", 1e-9), (1e14, "us", 1e-6), (1e11, "ms", 1e-3)];

/// Range of plausible sample times of machines, s. Stamps that count small units are taken to be in the unit that puts their steps into this
/// range, if there is only one such unit.
const SAMPLE_TIMES: (f64, f64) = (5e-5, 0.5);
/// Step from which on a time without a unit is not taken for seconds.
const LONGEST_STEP: f64 = 100.0;
/// Stamps count small units where one step in so many differs from the others, and so many at least.
const LEAST_JITTER_SHARE: usize = 100;
const LEAST_JITTERS: usize = 3;

/// Ranges beyond which whole numbers without a unit are no angle and no length: four turns, and a kilometre.
const LEAST_COUNTS: [(&str, f64); 2] = [("rad", 25.0), ("m", 1000.0)];
/// Fewest different numbers among them.
const LEAST_DISTINCT: usize = 32;
/// Rows before and behind one between which counts are compared with its rate, and least square of the correlation of both.
const WIDTH: usize = 4;
const LEAST_LIKENESS: f64 = 0.9;

/// Largest magnitude of a reading, in the model's unit. Products of squares of larger readings would overflow.
const LARGEST_READING: f64 = 1e100;

/// Most characters of a text that is shown where a number belongs.
const MOST_SHOWN_TEXT: usize = 40;

/// A column that is not read as a channel.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Unread {
    /// The column.
    pub column: String,
    /// Why it is not read.
    pub why: String,
}

/// Takes the columns that were recorded apart from the time out of a plan, with their signals.
fn leave_out_apart(columns: &dyn Columns, plan: &mut Plan, signals: &mut Vec<Signal>) -> Vec<Unread> {
    let of = |column: Option<usize>| columns.readings(column?);
    let mut unread = Vec::new();
    // Where rows are counted the longest columns are the record.
    let longest = || plan.places.iter().flatten().filter_map(|place| columns.readings(place.index)).max();
    let (stamps, what) = match plan.time_column() {
        Some(time) => (of(Some(time)), "the time"),
        None => (longest(), "others"),
    };
    let Some(stamps) = stamps else { return unread };
    let (mut places, mut kept) = (Vec::new(), Vec::new());
    for (place, signal) in plan.places.drain(..).zip(signals.drain(..)) {
        match of(place.as_ref().map(|place| place.index)).filter(|readings| *readings != stamps) {
            None => {
                places.push(place);
                kept.push(signal);
            }
            Some(readings) => {
                let why = format!(
                    "it has {readings} readings and {what} {stamps}; it is read with its own time (--map t_s=COLUMN)"
                );
                unread.push(Unread { column: signal.name, why });
            }
        }
    }
    (plan.places, *signals) = (places, kept);
    unread
}

/// Whether a value in the model's unit can be the reading of a machine.
fn is_reading(value: f64) -> bool {
    value.abs() <= LARGEST_READING
}

/// Rows in which a needed reading is missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Hole {
    /// The sample before which the rows are missing.
    pub(super) before: usize,
    /// First line.
    pub(super) from_line: u64,
    /// Last line.
    pub(super) to_line: u64,
    /// Rows.
    pub(super) rows: usize,
    /// The column of the first missing field of the first row.
    pub(super) column: String,
}

/// A signal of a table.
#[derive(Debug)]
pub(super) struct Channel {
    /// Name of its column.
    pub(super) column: String,
    /// Its readings by row, in its unit; no number where it has none.
    pub(super) values: Vec<f64>,
    numbers: Numbers,
    /// Whether nothing states its unit.
    is_silent: bool,
}

impl Channel {
    /// The step of every one of these values of the signal, at these lines.
    pub(super) fn steps(&self, values: &[f64], lines: &[u64]) -> Vec<f64> {
        self.numbers.steps(values, lines)
    }
}

impl AsRef<[f64]> for Channel {
    fn as_ref(&self) -> &[f64] {
        &self.values
    }
}

/// The rows of a log in the order of the file.
///
/// Invariant: channels are as long as the stamps. Those of a table that was read whole are finite; a rate may hold NaN.
#[derive(Debug)]
pub(super) struct Table {
    pub(super) path: String,
    /// Line of the header.
    pub(super) header_line: u64,
    /// Stamps in the unit of the file.
    pub(super) time: Vec<f64>,
    /// Length of that unit, s.
    pub(super) factor: f64,
    pub(super) resolution: Resolution,
    pub(super) channels: Vec<Channel>,
    /// Rates that have a column.
    pub(super) rates: Vec<Option<Channel>>,
    pub(super) lines: Vec<u64>,
    pub(super) holes: Vec<Hole>,
    /// Text of the first missing field.
    pub(super) first_hole: String,
    /// The steps of the readings of the first channels, or of all of them and of the rates behind them, as they were asked for.
    pub(super) steps: Vec<Steps>,
    pub(super) assumptions: Vec<Assumption>,
}

impl Table {
    /// Reads the signals and, behind them, those rates that have a column.
    ///
    /// # Errors
    /// [`LogError`] when a column is missing, a unit is not converted, or a row cannot be read.
    pub(super) fn read(
        columns: &mut dyn Columns,
        path: &str,
        signals: &[Signal],
        rates: &[Signal],
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        let mut table = Self::named(columns, path, signals, rates, options)?;
        table.check_shared_time(table.channels.iter())?;
        let present: Vec<&Channel> = table.rates.iter().flatten().collect();
        match SharedRows::of(&table.time, &table.channels, rates.len(), &present) {
            Some(shared) => table.share_rows(shared),
            None => {
                table.leave_out_missing();
                table.spread_stale_stamps();
            }
        }
        Ok(table)
    }

    /// Tells the steps of the first channels from the numbers of the file, before `follow` may change readings, and keeps them by the size
    /// of the readings afterwards.
    pub(super) fn with_steps<T, E>(
        &mut self,
        channels: usize,
        follow: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        let own = |channel: &Channel| channel.steps(&channel.values, &self.lines);
        let steps: Vec<Vec<f64>> = self.channels[..channels].iter().map(own).collect();
        let followed = follow(self)?;
        let of = |(channel, own): (&Channel, &Vec<f64>)| Steps::of_values(&channel.values, own);
        self.steps = self.channels.iter().zip(&steps).map(of).collect();
        Ok(followed)
    }

    /// Tells the steps of all channels and rates; those of a rate that is not there are none.
    pub(super) fn tell_all_steps(&mut self) {
        let of = |channel: &Channel| Steps::of_values(&channel.values, &channel.steps(&channel.values, &self.lines));
        self.steps = self.each().map(|channel| channel.map(of).unwrap_or_default()).collect();
    }

    /// Takes rows that channels with times of their own share.
    fn share_rows(&mut self, shared: SharedRows) {
        let name = |c: &usize| self.channels[*c].column.clone();
        let held: Vec<String> = shared.held.iter().map(name).collect();
        self.assumptions.push(Assumption::OwnTimes { reference: name(&shared.reference), held });
        self.take_rows(&shared.rows);
        self.all_mut().zip(shared.values).for_each(|(channel, values)| channel.values = values);
        // Lines without a stamp split the record as they do elsewhere.
        self.holes.iter_mut().for_each(|hole| hole.before = shared.rows.partition_point(|row| *row < hole.before));
    }

    /// The channels, then the rates; nothing for one that has no column.
    pub(super) fn each(&self) -> impl Iterator<Item = Option<&Channel>> + Clone {
        self.channels.iter().map(Some).chain(self.rates.iter().map(Option::as_ref))
    }

    /// The channels, then the rates that have a column.
    fn all(&self) -> impl Iterator<Item = &Channel> + Clone {
        self.each().flatten()
    }

    fn all_mut(&mut self) -> impl Iterator<Item = &mut Channel> {
        self.channels.iter_mut().chain(self.rates.iter_mut().flatten())
    }

    /// Keeps these rows alone.
    fn take_rows(&mut self, rows: &[usize]) {
        self.lines = rows.iter().map(|row| self.lines[*row]).collect();
        let of = |values: &Vec<f64>| rows.iter().map(|row| values[*row]).collect();
        self.time = of(&self.time);
        self.all_mut().for_each(|channel| channel.values = of(&channel.values));
    }

    /// Leaves out rows, which ascend.
    pub(super) fn leave_out(&mut self, rows: &[usize]) {
        self.holes.iter_mut().for_each(|hole| hole.before -= rows.partition_point(|row| *row < hole.before));
        let kept: Vec<usize> = (0..self.time.len()).filter(|row| rows.binary_search(row).is_err()).collect();
        self.take_rows(&kept);
    }

    /// Reads the signals, and those rates that have a column, so that a row keeps what it has.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub(super) fn read_apart(
        columns: &mut dyn Columns,
        path: &str,
        signals: &[Signal],
        rates: &[Signal],
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        let mut table = Self::named(columns, path, signals, rates, options)?;
        table.check_shared_time(table.all())?;
        // Where rows have blanks, several of them may belong to one instant.
        if table.all().flat_map(|channel| &channel.values).all(|value| value.is_finite()) {
            table.spread_stale_stamps();
        }
        Ok(table)
    }

    fn named(
        columns: &mut dyn Columns,
        path: &str,
        signals: &[Signal],
        rates: &[Signal],
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        let mut columns = Computed::of(columns, path, options)?;
        let plan = Names::of(&columns, path, options).settle(signals, rates)?;
        let stamps = plan.stamps();
        let mut table = Self::of(&mut columns, path, plan, signals.len())?;
        let steps = columns.steps().into_iter().skip(stamps);
        table.all_mut().zip(steps).for_each(|(channel, steps)| channel.numbers.computed = steps);
        table.settle_counts(signals, options)?;
        Ok(table)
    }

    /// Takes whole numbers without a unit, too many and too large for a length or an angle, for counts by the rate beside them.
    ///
    /// # Errors
    /// [`LogError::Counts`] where no rate says what a count is.
    fn settle_counts(&mut self, signals: &[Signal], options: &ReadingSettings) -> Result<(), LogError> {
        for (c, signal) in signals.iter().enumerate() {
            let channel = &self.channels[c];
            let unit =
                signal.unit.as_deref().filter(|_| channel.is_silent && !options.scale.contains_key(&signal.name));
            let least = LEAST_COUNTS.iter().find(|(own, _)| Some(*own) == unit).map(|(_, range)| *range);
            let (Some(unit), Some(least)) = (unit, least) else { continue };
            let there = || channel.values.iter().copied().filter(|value| value.is_finite());
            let (low, high) = (there().fold(f64::INFINITY, f64::min), there().fold(f64::NEG_INFINITY, f64::max));
            if high - low <= least || low > high || there().any(|value| value.fract() != 0.0) {
                continue;
            }
            let mut distinct: Vec<f64> = there().collect();
            distinct.sort_by(f64::total_cmp);
            distinct.dedup();
            if distinct.len() < LEAST_DISTINCT {
                continue;
            }
            let rate = self.rates.get(c).and_then(Option::as_ref).filter(|rate| !rate.is_silent);
            let Some(factor) = rate.and_then(|rate| self.count_by(&channel.values, &rate.values)) else {
                return Err(LogError::Counts {
                    path: self.path.clone(),
                    line: self.header_line,
                    column: channel.column.clone(),
                    signal: signal.name.clone(),
                    unit: unit.to_owned(),
                    range: [low, high],
                });
            };
            let channel = &mut self.channels[c];
            channel.values.iter_mut().for_each(|value| *value *= factor);
            channel.numbers.factor *= factor;
            let (signal, column) = (signal.name.clone(), channel.column.clone());
            self.assumptions.push(Assumption::Counts { signal, column, factor });
        }
        Ok(())
    }

    /// The size of a count by which a motion in counts has a rate, where it has.
    fn count_by(&self, counts: &[f64], rates: &[f64]) -> Option<f64> {
        let (mut own, mut both, mut other) = (0.0, 0.0, 0.0);
        for k in WIDTH..counts.len().saturating_sub(WIDTH) {
            let time = (self.time[k + WIDTH] - self.time[k - WIDTH]) * self.factor;
            let (moved, rate) = ((counts[k + WIDTH] - counts[k - WIDTH]) / time, rates[k]);
            if moved.is_finite() && rate.is_finite() {
                (own, both, other) = (own + moved * moved, both + moved * rate, other + rate * rate);
            }
        }
        (both * both > LEAST_LIKENESS * own * other).then(|| both / own)
    }

    /// Refuses columns of which one ends before another begins. What was written a few times before is a setting, which holds from then on.
    fn check_shared_time<'t>(&self, channels: impl Iterator<Item = &'t Channel> + Clone) -> Result<(), LogError> {
        let is_there = |value: Option<&f64>| value.is_some_and(|value| value.is_finite());
        if channels.clone().all(|channel| is_there(channel.values.first()) && is_there(channel.values.last())) {
            return Ok(());
        }
        let mut spans: Vec<(f64, f64, usize, &String)> = Vec::new();
        for Channel { column, values, .. } in channels {
            let mut own = (f64::INFINITY, f64::NEG_INFINITY, 0, column);
            for (&stamp, _) in self.time.iter().zip(values).filter(|(_, value)| value.is_finite()) {
                own = (own.0.min(stamp), own.1.max(stamp), own.2 + 1, column);
            }
            spans.push(own);
        }
        let later = spans.iter().filter(|own| own.2 > 0).max_by(|a, b| a.0.total_cmp(&b.0));
        let earlier = spans.iter().filter(|own| own.2 >= LEAST_SAMPLES).min_by(|a, b| a.1.total_cmp(&b.1));
        match (earlier, later) {
            (Some(&(_, until, _, earlier)), Some(&(from, _, _, later))) if until < from => {
                let first = self.time.iter().copied().fold(f64::INFINITY, f64::min);
                Err(LogError::NoSharedTime {
                    path: self.path.clone(),
                    line: self.header_line,
                    earlier: earlier.clone(),
                    later: later.clone(),
                    until: (until - first) * self.factor,
                    from: (from - first) * self.factor,
                })
            }
            _ => Ok(()),
        }
    }

    /// Gives rows whose stamp repeats the one before the time at which they were written, where the next stamp tells it.
    fn spread_stale_stamps(&mut self) {
        let stale = self.stamps().stale();
        let Some(&(first, _)) = stale.first() else { return };
        self.assumptions.push(Assumption::StaleStamps { count: stale.len(), first: self.lines[first] });
        stale.into_iter().for_each(|(row, time)| self.time[row] = time);
    }

    /// Least and largest reading of every channel, then of every rate; those of a rate that is not there are no numbers.
    pub(super) fn extremes(&self) -> Vec<[f64; 2]> {
        let of = |values: &[f64]| values.iter().fold([f64::NAN; 2], |[low, high], &x| [low.min(x), high.max(x)]);
        self.each().map(|channel| of(channel.map_or(&[], |channel| &channel.values))).collect()
    }

    /// Reads the columns of a plan, of which the first are `needed`.
    fn of(columns: &mut dyn Columns, path: &str, plan: Plan, needed: usize) -> Result<Self, LogError> {
        let channel = |place: &Place| Channel {
            column: columns.header()[place.index].text.clone(),
            values: Vec::new(),
            numbers: place.numbers(),
            is_silent: place.is_silent,
        };
        let mut all = plan.places.iter().map(|place| place.as_ref().map(channel));
        let mut table = Table {
            path: path.into(),
            header_line: columns.header_line(),
            time: Vec::new(),
            factor: 1.0,
            resolution: Resolution::default(),
            channels: all.by_ref().take(needed).flatten().collect(),
            rates: all.collect(),
            lines: Vec::new(),
            holes: Vec::new(),
            first_hole: String::new(),
            steps: Vec::new(),
            assumptions: Vec::new(),
        };
        table.fill(columns, &plan)?;
        table.resolution = match plan.time {
            Time::One { .. } => columns.resolution(),
            Time::Two { .. } | Time::Rows { .. } => Resolution::default(),
        };
        table.assumptions = columns.assumptions();
        table.assumptions.extend(plan.assumptions);
        table.settle_time(&plan.time, columns.dated(), plan.moves)?;
        Ok(table)
    }

    /// Reads every column but those of text and those that were recorded apart from the time, which are named apart, and says which signal
    /// each channel holds. A row keeps what it has: a channel is not a number where a field is blank.
    ///
    /// # Errors
    /// [`LogError`] when there is no time, or a row cannot be read.
    pub(super) fn read_every(
        columns: &mut dyn Columns,
        path: &str,
        options: &ReadingSettings,
    ) -> Result<(Self, Vec<Signal>, Vec<Unread>), LogError> {
        let (mut plan, mut signals) = Names::of(columns, path, options).settle_all()?;
        let mut unread = leave_out_apart(columns, &mut plan, &mut signals);
        let stamps = plan.stamps();
        columns.note_texts(stamps);
        let mut table = Self::of(columns, path, plan, 0)?;
        table.channels = take(&mut table.rates).into_iter().flatten().collect();
        let mut is_text = vec![false; table.channels.len()];
        for NotedText { field, line, text } in columns.noted_texts() {
            let shown: String = text.chars().take(MOST_SHOWN_TEXT).collect();
            let channel = field - stamps;
            unread.push(Unread {
                column: table.channels[channel].column.clone(),
                why: format!("`{shown}` in line {line} is no number"),
            });
            is_text[channel] = true;
        }
        table.keep(&mut signals, |channel| !is_text[channel]);
        Ok((table, signals, unread))
    }

    /// Reads every column of numbers, and says which signal each channel holds. Columns of text, and columns that are empty in most rows, are
    /// named apart; rows in which any other has no number are left out.
    ///
    /// # Errors
    /// Those of [`read_every`](Self::read_every).
    pub(super) fn read_all(
        columns: &mut dyn Columns,
        path: &str,
        options: &ReadingSettings,
    ) -> Result<(Self, Vec<Signal>, Vec<Unread>), LogError> {
        let (mut table, mut signals, mut unread) = Self::read_every(columns, path, options)?;
        let rows = table.time.len();
        let is_full = |channel: &Channel| 2 * channel.values.iter().filter(|value| value.is_finite()).count() > rows;
        let full: Vec<bool> = table.channels.iter().map(is_full).collect();
        let empty = signals.iter().zip(&full).filter(|(_, full)| !**full);
        unread.extend(
            empty
                .map(|(signal, _)| Unread { column: signal.name.clone(), why: "it has no number in most rows".into() }),
        );
        table.keep(&mut signals, |channel| full[channel]);
        table.leave_out_missing();
        Ok((table, signals, unread))
    }

    /// Keeps some of the channels, with their signals.
    fn keep(&mut self, signals: &mut Vec<Signal>, keeps: impl Fn(usize) -> bool) {
        let mut at = (0.., 0..);
        self.channels.retain(|_| at.0.next().is_none_or(&keeps));
        signals.retain(|_| at.1.next().is_none_or(&keeps));
    }

    /// Takes the rows in which a channel has no number out of the table.
    fn leave_out_missing(&mut self) {
        let missing = |row: usize| self.channels.iter().find(|channel| !channel.values[row].is_finite());
        let mut stampless = self.holes.iter().cloned().peekable();
        let (mut holes, mut kept) = (Vec::new(), Vec::with_capacity(self.time.len()));
        for row in 0..self.time.len() {
            while let Some(hole) = stampless.next_if(|hole| hole.before <= row) {
                holes.push(Hole { before: kept.len(), ..hole });
            }
            match missing(row) {
                Some(channel) => miss(&mut holes, kept.len(), self.lines[row], &channel.column),
                None => kept.push(row),
            }
        }
        if kept.len() < self.time.len() {
            holes.extend(stampless.map(|hole| Hole { before: kept.len(), ..hole }));
            self.holes = holes;
            self.take_rows(&kept);
        }
    }

    /// Reads all rows that have a stamp; where a reading is missing a channel has NaN.
    fn fill(&mut self, columns: &mut dyn Columns, plan: &Plan) -> Result<(), LogError> {
        let mut wanted = Vec::new();
        match plan.time {
            Time::One { index, .. } => wanted.push(index),
            Time::Two { seconds, fractions, .. } => wanted.extend([seconds, fractions]),
            Time::Rows { .. } => {}
        }
        let stamps = plan.stamps();
        wanted.extend(plan.places.iter().flatten().map(|place| place.index));
        columns.select(&wanted);
        let names: Vec<String> = wanted[..stamps].iter().map(|&index| columns.header()[index].text.clone()).collect();
        let mut values = vec![0.0; wanted.len()];
        let required = stamps + self.channels.len();
        let (mut first_second, unit) = (None, if let Time::Two { unit, .. } = plan.time { unit } else { 1.0 });
        let (mut row, mut hole) = (0_u64, false);
        while let Some(line) = columns.next_row(&mut values)? {
            row += 1;
            for (value, place) in values[stamps..].iter_mut().zip(plan.places.iter().flatten()) {
                *value = place.factor * *value + place.offset;
            }
            let missing = values[..required].iter().position(|&value| !is_reading(value));
            if let Some(column) = missing.filter(|_| !hole) {
                self.first_hole = columns.text(column);
                hole = true;
            }
            if let Some(column) = missing.filter(|column| *column < stamps) {
                miss(&mut self.holes, self.time.len(), line, &names[column]);
                continue;
            }
            self.time.push(match stamps {
                0 => row as f64,
                1 => values[0],
                // Whole seconds are subtracted before fractions are added, so that no digit is lost.
                _ => (values[0] - *first_second.get_or_insert(values[0])) / unit + values[1],
            });
            for (channel, &reading) in self.all_mut().zip(&values[stamps..]) {
                channel.values.push(if is_reading(reading) { reading } else { f64::NAN });
            }
            self.lines.push(line);
        }
        Ok(())
    }

    /// Finds the unit of the stamps, which may be dates.
    fn settle_time(&mut self, time: &Time, dated: bool, moves: bool) -> Result<(), LogError> {
        if dated {
            return self.settle_dates(time);
        }
        let (index_name, known) = match time {
            Time::Two { unit, factor, .. } => {
                self.factor = unit * factor;
                return Ok(());
            }
            Time::Rows { seconds } => {
                self.factor = *seconds;
                return Ok(());
            }
            Time::One { column, factor, .. } => (column, *factor),
        };
        if let Some(factor) = known {
            self.factor = factor;
            return Ok(());
        }
        let Some(first) = self.time.first() else { return Ok(()) };
        let epoch = EPOCHS.iter().find(|(least, ..)| first.abs() >= *least);
        let step = Stamps { time: &self.time, resolution: &self.resolution }.usual_step();
        let plausible =
            |(_, _, factor): &&(f64, &str, f64)| step * factor >= SAMPLE_TIMES.0 && step * factor <= SAMPLE_TIMES.1;
        let mut candidates = EPOCHS.iter().filter(plausible);
        // Seconds, unless the steps say otherwise: nobody follows a motion by readings a second apart, and a clock that counts small units is
        // read when a row is written, so that its steps differ by a few counts.
        let is_small = step >= 1.0 && (moves || self.is_counted(step));
        let (unit, factor) = match (epoch, candidates.next(), candidates.next()) {
            (Some((_, unit, factor)), ..) => (*unit, *factor),
            (None, Some((_, unit, factor)), None) if is_small => (*unit, *factor),
            _ if step < LONGEST_STEP && !is_small => ("s", 1.0),
            _ => {
                return Err(LogError::TimeUnit {
                    path: self.path.clone(),
                    line: self.header_line,
                    column: index_name.clone(),
                    step,
                });
            }
        };
        self.factor = factor;
        self.assumptions.push(Assumption::Time { column: index_name.clone(), unit: unit.to_owned(), stated: false });
        Ok(())
    }

    /// Whether stamps are whole numbers whose steps differ by less than one of them: those of a clock that counts small units. Of steps of a
    /// few seconds none would.
    fn is_counted(&self, step: f64) -> bool {
        let differs = |pair: &&[f64]| (0.5..0.5 * step).contains(&((pair[1] - pair[0]) - step).abs());
        let many = (1 + self.time.len() / LEAST_JITTER_SHARE).max(LEAST_JITTERS);
        self.time.iter().all(|stamp| stamp.fract() == 0.0)
            && self.time.windows(2).filter(differs).take(many).count() == many
    }

    /// Dates are seconds, whatever the name of their column says.
    fn settle_dates(&mut self, time: &Time) -> Result<(), LogError> {
        let fault = |column: &String, why: &'static str| {
            Err(LogError::Dates { path: self.path.clone(), line: self.header_line, column: column.clone(), why })
        };
        match time {
            Time::Rows { .. } => fault(
                self.all().next().map_or(&String::new(), |channel| &channel.column),
                "are no readings; name another column",
            ),
            Time::Two { column, .. } => fault(column, "are a whole stamp by themselves; name that column as the time"),
            Time::One { column, scaled: true, .. } => {
                fault(column, "are read in seconds; state no factor for the time")
            }
            Time::One { column, .. } => {
                self.factor = 1.0;
                self.assumptions.retain(|of| !matches!(of, Assumption::Time { .. }));
                self.assumptions.push(Assumption::Dates { column: column.clone() });
                Ok(())
            }
        }
    }

    /// The stamps.
    pub(super) fn stamps(&self) -> Stamps<'_> {
        Stamps { time: &self.time, resolution: &self.resolution }
    }

    /// The fault of the first row in which a reading is missing, for those who need a whole record.
    pub(super) fn missing(&self) -> Option<LogError> {
        let hole = self.holes.first()?;
        let (path, line, column) = (self.path.clone(), hole.from_line, hole.column.clone());
        Some(if self.first_hole.is_empty() {
            LogError::Empty { path, line, column }
        } else {
            LogError::NotANumber { path, line, column, text: self.first_hole.clone() }
        })
    }

    /// The fault of the first missing reading of a rate, for those who need a whole record.
    pub(super) fn missing_rate(&self) -> Option<LogError> {
        self.rates.iter().flatten().find_map(|rate| {
            let at = rate.values.iter().position(|value| !value.is_finite())?;
            Some(LogError::NotANumber {
                path: self.path.clone(),
                line: self.lines[at],
                column: rate.column.clone(),
                text: rate.values[at].to_string(),
            })
        })
    }

    /// The fault of a channel that never changes.
    pub(super) fn constant(&self, signals: &[Signal]) -> Option<LogError> {
        self.channels.iter().zip(signals).find_map(|(Channel { column, values, .. }, signal)| {
            let value = *values.first()?;
            values.iter().all(|other| *other == value).then(|| LogError::Constant {
                path: self.path.clone(),
                from: self.lines[0],
                to: self.lines[self.lines.len() - 1],
                signal: signal.name.clone(),
                column: column.clone(),
                value,
            })
        })
    }
}

/// Notes a row before a sample in which a reading of a column is missing.
fn miss(holes: &mut Vec<Hole>, before: usize, line: u64, column: &str) {
    match holes.last_mut() {
        Some(hole) if hole.before == before => {
            hole.to_line = line;
            hole.rows += 1;
        }
        _ => holes.push(Hole { before, from_line: line, to_line: line, rows: 1, column: column.to_owned() }),
    }
}
