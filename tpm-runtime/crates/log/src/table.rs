//! The rows of a log in the order of the file, with the places where readings are missing.

use crate::assumption::Assumption;
use crate::columns::{Columns, NotedText};
use crate::computed::Computed;
use crate::error::LogError;
use crate::names::{Names, Place, Plan, Signal, Time};
use crate::options::ReadingSettings;
use crate::shared_rows::SharedRows;
use crate::stamps::{Resolution, Stamps};
use crate::steps::{Numbers, Steps};
use serde::Serialize;

/// Fewest samples of a log.
pub(super) const LEAST_SAMPLES: usize = 16;

/// Least stamps that count nanoseconds, microseconds or milliseconds from 1970 on, with the unit and its length in s.
/// As seconds such stamps would lie thousands of years ahead.
const EPOCHS: [(f64, &str, f64); 3] = [(1e17, "ns", 1e-9), (1e14, "us", 1e-6), (1e11, "ms", 1e-3)];

/// Range of plausible sample times of machines, s. A column of time without a unit is taken to be in the unit that puts
/// its steps into this range, if there is only one such unit. Steps below one are seconds.
const SAMPLE_TIMES: (f64, f64) = (5e-5, 0.5);

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
    let (time, mut unread) = (plan.time_column(), Vec::new());
    let Some(stamps) = of(time) else { return unread };
    let (mut places, mut kept) = (Vec::new(), Vec::new());
    for (place, signal) in plan.optional.drain(..).zip(signals.drain(..)) {
        match of(place.as_ref().map(|place| place.index)).filter(|readings| *readings != stamps) {
            None => {
                places.push(place);
                kept.push(signal);
            }
            Some(readings) => {
                let why = format!(
                    "it has {readings} readings and the time {stamps}; it is read with its own time (--map t_s=COLUMN)"
                );
                unread.push(Unread { column: signal.name, why });
            }
        }
    }
    (plan.optional, *signals) = (places, kept);
    unread
}

/// Whether a value in the model's unit can be the reading of a machine.
fn is_reading(value: f64) -> bool {
    value.abs() <= LARGEST_READING
}

/// Rows in which a needed reading is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Hole {
    /// The sample before which the rows are missing.
    pub(super) before: usize,
    /// First line.
    pub(super) from_line: u64,
    /// Last line.
    pub(super) to_line: u64,
    /// Rows.
    pub(super) rows: usize,
    /// The first missing field of the first row, as an index into [`Table::columns`].
    pub(super) column: usize,
}

/// The rows of a log in the order of the file.
///
/// Invariant: channels are finite, in the units of their signals and as long as the stamps; a rate may hold NaN.
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
    pub(super) channels: Vec<Vec<f64>>,
    /// Rates that have a column.
    pub(super) rates: Vec<Option<Vec<f64>>>,
    pub(super) lines: Vec<u64>,
    pub(super) holes: Vec<Hole>,
    /// Text of the first missing field.
    pub(super) first_hole: String,
    /// Names of the columns: time, then those of the channels, then those of the rates.
    pub(super) columns: Vec<String>,
    /// What the numbers of the columns behind the time are, in the same order.
    numbers: Vec<Numbers>,
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
        let mut columns = Computed::of(columns, path, options)?;
        let plan = Names::of(&columns, path, options).settle(signals, rates)?;
        let (time, coordinates) = (plan.stamps(), rates.len());
        let mut table = Self::of(&mut columns, path, plan)?;
        table.take_computed(time, &mut columns);
        table.check_shared_time(&table.columns[time..], &table.channels)?;
        match SharedRows::of(&table.time, &table.channels, coordinates, &table.rates) {
            Some(shared) => table.share_rows(shared, time),
            None => {
                table.leave_out_missing(time);
                table.spread_stale_stamps();
            }
        }
        Ok(table)
    }

    /// Takes in the steps of columns that are computed; `stamps` columns are those of the time.
    fn take_computed(&mut self, stamps: usize, columns: &mut Computed<'_>) {
        let behind = columns.steps().into_iter().skip(stamps);
        self.numbers.iter_mut().zip(behind).for_each(|(numbers, steps)| numbers.computed = steps);
    }

    /// The step of every reading of a column behind the time, of which the signal has these values at these lines.
    pub(super) fn steps_of(&self, column: usize, values: &[f64], lines: &[u64]) -> Vec<f64> {
        self.numbers.get(column).map(|numbers| numbers.steps(values, lines)).unwrap_or_default()
    }

    /// Tells the steps of the first channels from the numbers of the file, before `follow` may change readings, and keeps them by the size
    /// of the readings afterwards.
    pub(super) fn with_steps<T, E>(
        &mut self,
        channels: usize,
        follow: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        let own = self.channels[..channels].iter().enumerate();
        let steps: Vec<Vec<f64>> = own.map(|(c, values)| self.steps_of(c, values, &self.lines)).collect();
        let followed = follow(self)?;
        self.steps = self.channels.iter().zip(&steps).map(|(values, own)| Steps::of_values(values, own)).collect();
        Ok(followed)
    }

    /// Tells the steps of all channels and rates; those of a rate that is not there are none.
    pub(super) fn tell_all_steps(&mut self) {
        let mut columns = 0..;
        let all = self.channels.iter().map(Some).chain(self.rates.iter().map(Option::as_ref));
        let of = |values: Option<&Vec<f64>>| {
            let (values, column) = (values?, columns.next()?);
            Some(Steps::of_values(values, &self.steps_of(column, values, &self.lines)))
        };
        self.steps = all.map(of).map(Option::unwrap_or_default).collect();
    }

    /// Takes rows that channels with times of their own share; `stamps` columns are those of the time.
    fn share_rows(&mut self, shared: SharedRows, stamps: usize) {
        let name = |c: &usize| self.columns[stamps + c].clone();
        let held: Vec<String> = shared.held.iter().map(name).collect();
        self.assumptions.push(Assumption::OwnTimes { reference: name(&shared.reference), held });
        self.time = shared.rows.iter().map(|row| self.time[*row]).collect();
        self.lines = shared.rows.iter().map(|row| self.lines[*row]).collect();
        (self.channels, self.rates) = (shared.channels, shared.rates);
        // Lines without a stamp split the record as they do elsewhere.
        self.holes.iter_mut().for_each(|hole| hole.before = shared.rows.partition_point(|row| *row < hole.before));
    }

    /// Reads the signals, and those rates that have a column, so that a row keeps what it has: all of them, in this order, are the rates of
    /// the table, not a number where a field is blank.
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
        let mut columns = Computed::of(columns, path, options)?;
        let plan = Names::of(&columns, path, options).settle(signals, rates)?;
        let time = plan.stamps();
        let optional = plan.places.into_iter().map(Some).chain(plan.optional).collect();
        let mut table = Self::of(&mut columns, path, Plan { places: Vec::new(), optional, ..plan })?;
        table.take_computed(time, &mut columns);
        table.check_shared_time(&table.columns[time..], table.rates.iter().flatten())?;
        // Where rows have blanks, several of them may belong to one instant.
        if table.rates.iter().flatten().flatten().all(|value| value.is_finite()) {
            table.spread_stale_stamps();
        }
        Ok(table)
    }

    /// Refuses columns of which one ends before another begins. What was written a few times before is a setting, which holds from then on.
    fn check_shared_time<'t>(
        &self,
        names: &[String],
        columns: impl IntoIterator<Item = &'t Vec<f64>> + Clone,
    ) -> Result<(), LogError> {
        let is_there = |value: Option<&f64>| value.is_some_and(|value| value.is_finite());
        if columns.clone().into_iter().all(|column| is_there(column.first()) && is_there(column.last())) {
            return Ok(());
        }
        let mut spans: Vec<(f64, f64, usize, &String)> = Vec::new();
        for (column, name) in columns.into_iter().zip(names) {
            let mut own = (f64::INFINITY, f64::NEG_INFINITY, 0, name);
            for (&stamp, _) in self.time.iter().zip(column).filter(|(_, value)| value.is_finite()) {
                own = (own.0.min(stamp), own.1.max(stamp), own.2 + 1, name);
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
        let rates = self.rates.iter().map(|rate| of(rate.as_deref().unwrap_or_default()));
        self.channels.iter().map(|channel| of(channel)).chain(rates).collect()
    }

    /// Reads the columns of a plan.
    fn of(columns: &mut dyn Columns, path: &str, plan: Plan) -> Result<Self, LogError> {
        let mut table = Table {
            path: path.into(),
            header_line: columns.header_line(),
            time: Vec::new(),
            factor: 1.0,
            resolution: Resolution::default(),
            channels: vec![Vec::new(); plan.places.len()],
            rates: plan.optional.iter().map(|place| place.as_ref().map(|_| Vec::new())).collect(),
            lines: Vec::new(),
            holes: Vec::new(),
            first_hole: String::new(),
            columns: Vec::new(),
            numbers: plan.places.iter().chain(plan.optional.iter().flatten()).map(Place::numbers).collect(),
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
        table.settle_time(&plan.time, columns.dated())?;
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
        let mut table = Self::of(columns, path, plan)?;
        table.channels = std::mem::take(&mut table.rates).into_iter().map(Option::unwrap_or_default).collect();
        let mut is_text = vec![false; table.columns.len()];
        for NotedText { field, line, text } in columns.noted_texts() {
            let shown: String = text.chars().take(MOST_SHOWN_TEXT).collect();
            unread.push(Unread {
                column: table.columns[field].clone(),
                why: format!("`{shown}` in line {line} is no number"),
            });
            is_text[field] = true;
        }
        table.keep(&mut signals, stamps, |channel| !is_text[stamps + channel]);
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
        let stamps = table.columns.len() - table.channels.len();
        let full: Vec<bool> = table
            .channels
            .iter()
            .map(|values| 2 * values.iter().filter(|value| value.is_finite()).count() > rows)
            .collect();
        let empty = signals.iter().zip(&full).filter(|(_, full)| !**full);
        unread.extend(
            empty
                .map(|(signal, _)| Unread { column: signal.name.clone(), why: "it has no number in most rows".into() }),
        );
        table.keep(&mut signals, stamps, |channel| full[channel]);
        table.leave_out_missing(stamps);
        Ok((table, signals, unread))
    }

    /// Keeps some of the channels, with their signals and the names of their columns, which stand behind `stamps` of the time.
    fn keep(&mut self, signals: &mut Vec<Signal>, stamps: usize, keeps: impl Fn(usize) -> bool) {
        fn retain<T>(of: &mut Vec<T>, from: usize, keeps: &impl Fn(usize) -> bool) {
            let mut at = 0..;
            of.retain(|_| at.next().is_none_or(|at: usize| at.checked_sub(from).is_none_or(keeps)));
        }
        retain(&mut self.channels, 0, &keeps);
        retain(&mut self.columns, stamps, &keeps);
        retain(&mut self.numbers, 0, &keeps);
        retain(signals, 0, &keeps);
    }

    /// Takes the rows in which a channel has no number out of the table; `stamps` columns are those of the time.
    fn leave_out_missing(&mut self, stamps: usize) {
        if self.channels.iter().all(|channel| channel.iter().all(|value| value.is_finite())) {
            return;
        }
        let (time, lines) = (std::mem::take(&mut self.time), std::mem::take(&mut self.lines));
        let channels: Vec<Vec<f64>> = self.channels.iter_mut().map(std::mem::take).collect();
        let rates: Vec<Option<Vec<f64>>> =
            self.rates.iter_mut().map(|rate| rate.as_mut().map(std::mem::take)).collect();
        let mut holes = std::mem::take(&mut self.holes).into_iter().peekable();
        for (row, (t, line)) in time.iter().zip(&lines).enumerate() {
            while let Some(hole) = holes.next_if(|hole| hole.before <= row) {
                self.holes.push(Hole { before: self.time.len(), ..hole });
            }
            if let Some(missing) = channels.iter().position(|channel| !channel[row].is_finite()) {
                self.miss(*line, stamps + missing);
                continue;
            }
            self.time.push(*t);
            self.lines.push(*line);
            self.channels.iter_mut().zip(&channels).for_each(|(to, from)| to.push(from[row]));
            self.rates.iter_mut().flatten().zip(rates.iter().flatten()).for_each(|(to, from)| to.push(from[row]));
        }
        self.holes.extend(holes.map(|hole| Hole { before: self.time.len(), ..hole }));
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
        let needed = plan.places.iter();
        let present = plan.optional.iter().flatten();
        wanted.extend(needed.chain(present).map(|place| place.index));
        self.columns = wanted.iter().map(|&index| columns.header()[index].text.clone()).collect();
        columns.select(&wanted);
        let mut values = vec![0.0; wanted.len()];
        let mut readings = Vec::with_capacity(plan.places.len());
        let required = stamps + plan.places.len();
        let (mut first_second, unit) = (None, if let Time::Two { unit, .. } = plan.time { unit } else { 1.0 });
        let (mut row, mut hole) = (0_u64, false);
        while let Some(line) = columns.next_row(&mut values)? {
            row += 1;
            let scaled = values[stamps..required].iter().zip(&plan.places);
            readings.clear();
            readings.extend(scaled.map(|(value, place)| place.factor * value + place.offset));
            let missing = values[..stamps].iter().chain(&readings).position(|&value| !is_reading(value));
            if let Some(column) = missing.filter(|_| !hole) {
                self.first_hole = columns.text(column);
                hole = true;
            }
            if let Some(column) = missing.filter(|column| *column < stamps) {
                self.miss(line, column);
                continue;
            }
            self.time.push(match stamps {
                0 => row as f64,
                1 => values[0],
                // Whole seconds are subtracted before fractions are added, so that no digit is lost.
                _ => (values[0] - *first_second.get_or_insert(values[0])) / unit + values[1],
            });
            let readings = readings.iter().map(|&reading| if is_reading(reading) { reading } else { f64::NAN });
            self.channels.iter_mut().zip(readings).for_each(|(channel, reading)| channel.push(reading));
            let present = plan.optional.iter().flatten().zip(&values[required..]);
            for (rate, (place, value)) in self.rates.iter_mut().flatten().zip(present) {
                let reading = place.factor * value + place.offset;
                rate.push(if is_reading(reading) { reading } else { f64::NAN });
            }
            self.lines.push(line);
        }
        Ok(())
    }

    /// Notes a row in which a reading is missing.
    fn miss(&mut self, line: u64, column: usize) {
        let before = self.time.len();
        match self.holes.last_mut() {
            Some(hole) if hole.before == before => {
                hole.to_line = line;
                hole.rows += 1;
            }
            _ => self.holes.push(Hole { before, from_line: line, to_line: line, rows: 1, column }),
        }
    }

    /// Finds the unit of the stamps, which may be dates.
    fn settle_time(&mut self, time: &Time, dated: bool) -> Result<(), LogError> {
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
        let (unit, factor) = match (epoch, candidates.next(), candidates.next()) {
            (Some((_, unit, factor)), ..) => (*unit, *factor),
            _ if step < 1.0 => ("s", 1.0),
            (None, Some((_, unit, factor)), None) => (*unit, *factor),
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

    /// Dates are seconds, whatever the name of their column says.
    fn settle_dates(&mut self, time: &Time) -> Result<(), LogError> {
        let fault = |column: &String, why: &'static str| {
            Err(LogError::Dates { path: self.path.clone(), line: self.header_line, column: column.clone(), why })
        };
        match time {
            Time::Rows { .. } => fault(&self.columns[0], "are no readings; name another column"),
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
        let (path, line, column) = (self.path.clone(), hole.from_line, self.columns[hole.column].clone());
        Some(if self.first_hole.is_empty() {
            LogError::Empty { path, line, column }
        } else {
            LogError::NotANumber { path, line, column, text: self.first_hole.clone() }
        })
    }

    /// The fault of the first missing reading of a rate, for those who need a whole record.
    pub(super) fn missing_rate(&self) -> Option<LogError> {
        let names = &self.columns[self.columns.len() - self.rates.iter().flatten().count()..];
        self.rates.iter().flatten().zip(names).find_map(|(rate, column)| {
            let at = rate.iter().position(|value| !value.is_finite())?;
            Some(LogError::NotANumber {
                path: self.path.clone(),
                line: self.lines[at],
                column: column.clone(),
                text: rate[at].to_string(),
            })
        })
    }

    /// The fault of a channel that never changes.
    pub(super) fn constant(&self, signals: &[Signal]) -> Option<LogError> {
        let names = &self.columns[self.columns.len() - self.rates.iter().flatten().count() - self.channels.len()..];
        self.channels.iter().zip(names).zip(signals).find_map(|((channel, column), signal)| {
            let value = *channel.first()?;
            channel.iter().all(|other| *other == value).then(|| LogError::Constant {
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
