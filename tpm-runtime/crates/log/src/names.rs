//! The assignment of columns to signals, with their units.
//!
//! Names, units and factors are settled here alone, whatever the format of the file is. A signal is looked for under
//! its name first, then under its name with a unit: `q [deg]`, `q (deg)`, `q_deg`. The time is `t_s`, else one of `t`, `time`,
//! `timestamp`, `stamp`, or the like, with a unit or without, else a stamp in two columns of seconds and fractions, as ROS writes it; a
//! signal of a joint also at the end of a path (`paths`). Where several columns may be meant, none is chosen.

use crate::assumption::Assumption;
use crate::columns::{ColumnName, Columns, Holds};
use crate::error::{Adjustment, LogError, LookedIn, UnitMismatch};
use crate::options::{ReadingSettings, TIME, rate_of};
use crate::paths;
use crate::steps::Numbers;
use crate::unit::{UnitFault, conversion, unit_of};

/// Names of columns of time, in small letters, as English and other European programs write them.
const TIMES: [&str; 13] = [
    "t",
    "time",
    "timestamp",
    "stamp",
    "datetime",
    "zeit",
    "zeitstempel",
    "uhrzeit",
    "temps",
    "tiempo",
    "tempo",
    "tijd",
    "x_value",
];
/// Names of columns of dates, which may have a time of day: the time where no column has a name of it.
const DATES: [&str; 3] = ["date", "datum", "fecha"];
/// Names of a column with the time from row to row, in small letters.
const STEPS: [&str; 8] = ["ts", "dt", "h", "sampletime", "sample_time", "sample time", "delta_t", "t_sample"];
/// Ends of the names of the two columns of a stamp, in small letters: seconds, and fractions with their size in seconds.
const SECONDS: [&str; 4] = ["sec", "secs", "seconds", "tv_sec"];
const FRACTIONS: [(&str, f64); 8] = [
    ("nsec", 1e-9),
    ("nsecs", 1e-9),
    ("nanosec", 1e-9),
    ("nanosecs", 1e-9),
    ("nanoseconds", 1e-9),
    ("usec", 1e-6),
    ("usecs", 1e-6),
    ("tv_usec", 1e-6),
];

/// A signal that is looked for in a file.
#[derive(Clone, Debug)]
pub(super) struct Signal {
    /// Its name.
    pub(super) name: String,
    /// Its unit, where it has one.
    pub(super) unit: Option<String>,
}

/// A signal's column, and how its numbers become the signal: `factor * number + offset`.
#[derive(Clone, Debug)]
pub(super) struct Place {
    /// Index of the column.
    pub(super) index: usize,
    pub(super) factor: f64,
    pub(super) offset: f64,
    /// Whether nothing states the unit of the column.
    pub(super) is_silent: bool,
}

impl Place {
    /// What the numbers of the column are to the signal, as long as nothing is known of a computation.
    pub(super) fn numbers(&self) -> Numbers {
        Numbers { factor: self.factor, offset: self.offset, computed: None }
    }
}

/// The column or the columns of the time.
#[derive(Clone, Debug)]
pub(super) enum Time {
    /// One column; its factor to seconds is known, or is inferred from the stamps.
    One {
        /// Index of the column.
        index: usize,
        /// Its name.
        column: String,
        factor: Option<f64>,
        /// Whether that factor was stated.
        scaled: bool,
    },
    /// No column: rows are evenly spaced.
    Rows {
        /// Time from row to row, s.
        seconds: f64,
    },
    /// Two columns, whole seconds and fractions.
    Two {
        /// Index of the column of whole seconds.
        seconds: usize,
        /// Index of the column of fractions.
        fractions: usize,
        /// Names of both.
        column: String,
        /// One fraction, s.
        unit: f64,
        /// Factor that was stated for the time, else 1.
        factor: f64,
    },
}

/// The columns of the time and of all signals in a file.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) time: Time,
    /// Places of the signals that must be there, then of those that may be there.
    pub(super) places: Vec<Option<Place>>,
    /// Assumptions about names and units.
    pub(super) assumptions: Vec<Assumption>,
    /// Whether a signal is a motion by its unit.
    pub(super) moves: bool,
}

impl Plan {
    /// The column of the time, or of its seconds; nothing where rows are counted.
    pub(super) fn time_column(&self) -> Option<usize> {
        match self.time {
            Time::One { index, .. } => Some(index),
            Time::Two { seconds, .. } => Some(seconds),
            Time::Rows { .. } => None,
        }
    }

    /// Number of the columns of the time.
    pub(super) fn stamps(&self) -> usize {
        match self.time {
            Time::One { .. } => 1,
            Time::Two { .. } => 2,
            Time::Rows { .. } => 0,
        }
    }
}

/// A column of which the name fits, and the unit that is part of the name.
pub(super) struct Fitting<'a> {
    pub(super) index: usize,
    pub(super) unit: Option<&'a str>,
    /// Whether the unit is in brackets, so that it is certainly a unit.
    pub(super) bracketed: bool,
}

/// Finds the columns of signals by their names.
pub(super) struct Names<'a> {
    pub(super) path: &'a str,
    pub(super) header: &'a [ColumnName],
    /// What the file is, for messages.
    kind: String,
    /// Line of the header.
    pub(super) line: u64,
    /// Line of the units of the columns where they have a row of their own, otherwise that of the header.
    pub(super) units_line: u64,
    pub(super) options: &'a ReadingSettings,
}

impl<'a> Names<'a> {
    /// The columns of the file at `path`.
    pub(super) fn of(columns: &'a dyn Columns, path: &'a str, options: &'a ReadingSettings) -> Self {
        Names {
            path,
            header: columns.header(),
            kind: columns.kind(),
            line: columns.header_line(),
            units_line: columns.units_line(),
            options,
        }
    }
}

impl Names<'_> {
    /// Finds the columns of the time and of the signals, and the factors and offsets of these.
    ///
    /// # Errors
    /// [`LogError`] for a column that is missing or ambiguous, a unit that is not converted, a setting of an unknown name.
    pub(super) fn settle(&self, signals: &[Signal], optional: &[Signal]) -> Result<Plan, LogError> {
        self.settled(signals, optional).map_err(|fault| self.guessed(fault, signals))
    }

    fn settled(&self, signals: &[Signal], optional: &[Signal]) -> Result<Plan, LogError> {
        let names: Vec<String> = signals.iter().chain(optional).map(|signal| signal.name.clone()).collect();
        check_names(&names, self.options)?;
        let mut assumptions = Vec::new();
        let time = self.time(&mut assumptions)?;
        let mut place = |signal: &Signal| -> Result<Option<Place>, LogError> {
            self.column(signal)?.map(|found| self.place(signal, &found, &mut assumptions)).transpose()
        };
        let mut places = Vec::new();
        for signal in signals {
            let rate = optional.iter().find(|other| other.name == rate_of(&signal.name));
            places.push(Some(place(signal)?.ok_or_else(|| self.missing(&signal.name, rate))?));
        }
        for signal in optional {
            let found = place(signal)?;
            if found.is_none() && self.options.map.contains_key(&signal.name) {
                return Err(self.missing(&signal.name, None));
            }
            places.push(found);
        }
        Ok(Plan { time, places, assumptions, moves: any_moves(signals) })
    }

    /// Finds the column of the time, and takes every other column for a signal of the column's own name and unit. Factors and offsets are
    /// given by these names; only the time may be mapped to a column of another name.
    ///
    /// # Errors
    /// [`LogError`] for a time that is missing or ambiguous, or a setting of an unknown name.
    pub(super) fn settle_all(&self) -> Result<(Plan, Vec<Signal>), LogError> {
        self.settled_all().map_err(|fault| self.guessed(fault, &[]))
    }

    fn settled_all(&self) -> Result<(Plan, Vec<Signal>), LogError> {
        let names: Vec<String> = self.header.iter().map(|column| column.text.clone()).collect();
        let unknown = |adjustment: Adjustment, name: &String| LogError::UnknownColumn {
            adjustment,
            name: name.clone(),
            available: names.clone(),
        };
        if let Some(name) = self.options.map.keys().find(|name| *name != TIME) {
            return Err(unknown(Adjustment::Column, name));
        }
        for (adjustment, values) in
            [(Adjustment::Scale, &self.options.scale), (Adjustment::Offset, &self.options.offset)]
        {
            for (name, &value) in values {
                if !(names.contains(name) || name == TIME && adjustment == Adjustment::Scale) {
                    return Err(unknown(adjustment, name));
                }
                check_value(adjustment, name, value)?;
            }
        }
        let mut assumptions = Vec::new();
        let time = self.time(&mut assumptions)?;
        let of_time = |index: usize| match &time {
            Time::One { index: one, .. } => *one == index,
            Time::Two { seconds, fractions, .. } => [*seconds, *fractions].contains(&index),
            Time::Rows { .. } => false,
        };
        let (mut signals, mut places) = (Vec::new(), Vec::new());
        for index in (0..names.len()).filter(|index| !of_time(*index)) {
            let name = &names[index];
            let (_, in_name, bracketed) = split_unit(name);
            let beside = self.header[index].unit.as_deref().filter(|unit| !unit.is_empty());
            let scaled = self.options.scale.contains_key(name);
            let unit = beside.or(in_name.filter(|unit| bracketed || unit_of(unit).is_some())).filter(|_| !scaled);
            signals.push(Signal { name: name.clone(), unit: unit.map(str::to_owned) });
            let factor = self.options.scale.get(name).copied().unwrap_or(1.0);
            let offset = self.options.offset.get(name).copied().unwrap_or(0.0);
            places.push(Some(Place { index, factor, offset, is_silent: false }));
        }
        Ok((Plan { time, places, assumptions, moves: any_moves(&signals) }, signals))
    }

    /// The column that is looked for as a signal.
    pub(super) fn wanted<'a>(&'a self, signal: &'a str) -> &'a str {
        self.options.map.get(signal).map_or(signal, String::as_str)
    }

    /// The column of a signal: the one that it is mapped to, else the one that is called like it, or ends so.
    pub(super) fn column(&self, signal: &Signal) -> Result<Option<Fitting<'_>>, LogError> {
        match self.find(self.wanted(&signal.name), &signal.name, signal.unit.as_deref())? {
            None if !self.options.map.contains_key(&signal.name) => self.at_end_of_path(&signal.name),
            found => Ok(found),
        }
    }

    /// Whether there is a column of a coordinate's rate, and none of the coordinate.
    ///
    /// # Errors
    /// [`LogError::AmbiguousColumn`].
    pub(super) fn has_rate_alone(&self, coordinate: &Signal, rate: &Signal) -> Result<bool, LogError> {
        let stated = self.options.map.contains_key(&coordinate.name);
        Ok(!stated && self.column(coordinate)?.is_none() && self.column(rate)?.is_some())
    }

    /// The fault of a signal for which a column is missing; those in the unit of its rate may be meant as that.
    fn missing(&self, name: &str, rate: Option<&Signal>) -> LogError {
        let unit = rate.and_then(|rate| rate.unit.as_deref());
        let is_rate = |(index, column): (usize, &ColumnName)| {
            let (_, in_name, bracketed) = split_unit(&column.text);
            let (own, _) = self.stated(&Fitting { index, unit: in_name, bracketed })?;
            conversion(own, unit?).is_ok().then(|| column.text.clone())
        };
        self.missing_in(name, self.wanted(name), self.of_file().filter_map(is_rate).collect())
    }

    /// The fault of a signal for which a column is missing, and columns that may be its rate.
    pub(super) fn missing_in(&self, signal: &str, column: &str, rates: Vec<String>) -> LogError {
        let of_file = self.header.iter().filter(|column| !column.computed);
        LogError::MissingColumn {
            path: self.path.into(),
            line: self.line,
            name: signal.into(),
            column: column.into(),
            file: Box::new(LookedIn {
                kind: self.kind.clone(),
                available: of_file.map(|column| column.text.clone()).collect(),
                rates,
                guess: LookedIn::no_guess(signal),
            }),
        }
    }

    /// The column of a name: the only one that is called so, else the only one that is called so with a unit.
    pub(super) fn find(&self, wanted: &str, signal: &str, unit: Option<&str>) -> Result<Option<Fitting<'_>>, LogError> {
        let exact: Vec<usize> = self.indices(|column| column.text == wanted).collect();
        match exact[..] {
            [index] if self.header[index].repeated && !self.options.map.contains_key(signal) => {
                let numbered = |column: &&ColumnName| {
                    let number = column.text.strip_prefix(wanted).and_then(|rest| rest.strip_prefix('.'));
                    column.text == wanted || number.is_some_and(|number| number.parse::<usize>().is_ok())
                };
                Err(self
                    .ambiguous(signal, self.header.iter().filter(numbered).map(|column| column.text.clone()).collect()))
            }
            [index, ..] => {
                // The signal's own name holds no unit; the name of a column that was stated may.
                let unitless = wanted == signal || self.header[index].computed;
                let text = &self.header[index].text;
                let (_, own, bracketed) = if unitless { (wanted, None, false) } else { split_unit(text) };
                // A column that is called `rpm` is in revolutions per minute; single letters are names of many things.
                let is_unit = |unit: &str| !unitless && text.len() > 1 && conversion(text, unit).is_ok();
                let unit = own.or(unit.filter(|unit| is_unit(unit)).map(|_| text.as_str()));
                Ok(Some(Fitting { index, unit, bracketed }))
            }
            [] => self.with_unit(wanted, signal, unit),
        }
    }

    /// The only column that is called so with a unit.
    fn with_unit(&self, wanted: &str, signal: &str, unit: Option<&str>) -> Result<Option<Fitting<'_>>, LogError> {
        let fitting = self.of_file().filter_map(|(index, column)| {
            let (base, unit, bracketed) = split_unit(&column.text);
            let fits = base == wanted && (bracketed || unit.is_some());
            fits.then_some(Fitting { index, unit, bracketed })
        });
        let mut fitting: Vec<Fitting<'_>> = fitting.collect();
        if fitting.len() > 1 {
            // What looks like a unit behind an underscore is a part of the name if it does not convert to the signal's
            // unit.
            let converts =
                |of: &Fitting<'_>| unit.zip(of.unit).is_some_and(|(own, unit)| conversion(unit, own).is_ok());
            fitting.retain(|of| of.bracketed || converts(of));
        }
        self.only(fitting, signal)
    }

    /// The only column whose name is a path that ends in a signal.
    fn at_end_of_path(&self, signal: &str) -> Result<Option<Fitting<'_>>, LogError> {
        let fitting = self.of_file().filter_map(|(index, column)| {
            let (base, unit, bracketed) = split_unit(&column.text);
            let whole = paths::fits(&column.text, signal);
            let unit = unit.filter(|_| !whole);
            (whole || paths::fits(base, signal)).then_some(Fitting { index, unit, bracketed: bracketed && !whole })
        });
        self.only(fitting.collect(), signal)
    }

    /// The columns that are not computed.
    pub(super) fn of_file(&self) -> impl Iterator<Item = (usize, &ColumnName)> {
        self.header.iter().enumerate().filter(|(_, column)| !column.computed)
    }

    fn only<'a>(&self, mut fitting: Vec<Fitting<'a>>, signal: &str) -> Result<Option<Fitting<'a>>, LogError> {
        if fitting.len() > 1 {
            let columns = fitting.iter().map(|of| self.header[of.index].text.clone()).collect();
            return Err(self.ambiguous(signal, columns));
        }
        Ok(fitting.pop())
    }

    /// The fault of a signal for which several columns may be meant.
    fn ambiguous(&self, signal: &str, columns: Vec<String>) -> LogError {
        let guess = Box::new(LookedIn::no_guess(signal));
        LogError::AmbiguousColumn { path: self.path.into(), line: self.line, name: signal.into(), columns, guess }
    }

    fn indices<'a>(&'a self, fits: impl Fn(&ColumnName) -> bool + 'a) -> impl Iterator<Item = usize> + 'a {
        self.header.iter().enumerate().filter(move |(_, column)| fits(column)).map(|(index, _)| index)
    }

    /// The unit that a column states: beside its name, else in it.
    pub(super) fn stated<'a>(&'a self, found: &Fitting<'a>) -> Option<(&'a str, bool)> {
        let beside = self.header[found.index].unit.as_deref().filter(|unit| !unit.is_empty());
        beside.map(|unit| (unit, true)).or(found.unit.map(|unit| (unit, found.bracketed)))
    }

    /// How the numbers of a column become a signal.
    fn place(&self, signal: &Signal, found: &Fitting<'_>, said: &mut Vec<Assumption>) -> Result<Place, LogError> {
        let column = self.header[found.index].text.clone();
        let stated = self.stated(found);
        let scale = self.options.scale.get(&signal.name).copied();
        let offset = self.options.offset.get(&signal.name).copied().unwrap_or(0.0);
        let mapped = self.wanted(&signal.name) == column;
        let (factor, unit) = match (scale, stated, &signal.unit) {
            (Some(scale), stated, _) => {
                let unit = stated.filter(|(unit, sure)| {
                    let converted = signal.unit.as_deref().map(|own| conversion(unit, own));
                    *sure && converted != Some(Ok(scale))
                        || matches!(converted, Some(Ok(factor)) if factor != scale && factor != 1.0)
                });
                if let Some((unit, _)) = unit {
                    said.push(Assumption::FactorForUnit {
                        signal: signal.name.clone(),
                        column: column.clone(),
                        unit: unit.into(),
                        factor: scale,
                    });
                    return Ok(Place { index: found.index, factor: scale, offset, is_silent: false });
                }
                (scale, None)
            }
            (None, None, _) => (1.0, None),
            (None, Some((unit, _)), None) => (1.0, Some(unit)),
            (None, Some((unit, sure)), Some(own)) => match conversion(unit, own) {
                Ok(factor) => (factor, Some(unit)),
                // The end of a column's name behind an underscore need not be a unit where the whole name was looked
                // for.
                Err(_) if mapped && !sure => (1.0, None),
                Err(fault) => return Err(self.unit_fault(&column, unit, &signal.name, own, fault)),
            },
        };
        let converted = factor != 1.0 && scale.is_none() || unit.is_some() && signal.unit.is_none();
        // A column that was named, and says nothing of its unit.
        let silent = column != signal.name && unit.is_none() && scale.is_none() && signal.unit.is_some();
        if !mapped || converted || silent {
            said.push(Assumption::Column {
                signal: signal.name.clone(),
                column: column.clone(),
                unit: unit.map(str::to_owned),
                // A stated factor leads to the model's unit, whatever that of the column is.
                model_unit: signal.unit.clone().filter(|_| scale.is_none()),
                factor,
            });
        }
        let is_silent = unit.is_none() && !self.header[found.index].computed;
        Ok(Place { index: found.index, factor, offset, is_silent })
    }

    fn unit_fault(&self, column: &str, unit: &str, name: &str, expected: &str, fault: UnitFault) -> LogError {
        let mismatch = UnitMismatch {
            column: column.into(),
            unit: unit.into(),
            name: name.into(),
            expected: expected.into(),
            reason: match fault {
                UnitFault::Unknown => "this unit is not known here",
                UnitFault::Different => "these are different quantities",
                UnitFault::Cycles => "turns or radians may be counted",
            },
        };
        let in_row = |of: &ColumnName| of.text == column && of.unit.as_deref() == Some(unit);
        let line = if self.header.iter().any(in_row) { self.units_line } else { self.line };
        LogError::Unit { path: self.path.into(), line, mismatch: Box::new(mismatch) }
    }

    pub(super) fn time(&self, said: &mut Vec<Assumption>) -> Result<Time, LogError> {
        if let Some(seconds) = self.options.sample_time {
            if !(seconds.is_finite() && seconds > 0.0) {
                return Err(LogError::SampleTime { seconds });
            }
            if self.options.map.contains_key(TIME) || self.options.scale.contains_key(TIME) {
                return Err(LogError::TwoTimes);
            }
            said.push(Assumption::SampleTime { seconds });
            return Ok(Time::Rows { seconds });
        }
        let wanted = self.wanted(TIME);
        let scale = self.options.scale.get(TIME).copied();
        let found = match self.find(wanted, TIME, Some("s"))? {
            Some(found) => Some(found),
            None if wanted != TIME => match self.two(Some(wanted))? {
                Some(two) => return Ok(self.said_two(two, scale, said)),
                None => None,
            },
            None => {
                let two = self.two(None)?;
                let in_two = |index: usize| matches!(two, Some(Time::Two { seconds, fractions, .. }) if [seconds, fractions].contains(&index));
                let found = self.named_time(&in_two)?;
                match (found, two) {
                    (Some(one), Some(two)) => {
                        let columns = vec![self.header[one.index].text.clone(), pair_name(&two)];
                        return Err(self.ambiguous(TIME, columns));
                    }
                    (None, Some(two)) => return Ok(self.said_two(two, scale, said)),
                    (found, None) => found,
                }
            }
        };
        let Some(found) = found else {
            // The time from row to row beside the columns.
            let step = self.of_file().find_map(|(_, column)| match column.holds {
                Holds::One(step)
                    if step > 0.0 && STEPS.contains(&split_unit(&column.text).0.to_lowercase().as_str()) =>
                {
                    let factor = split_unit(&column.text).1.and_then(|unit| conversion(unit, "s").ok());
                    Some((column.text.clone(), step * factor.unwrap_or(1.0)))
                }
                _ => None,
            });
            if let Some((column, seconds)) = step.filter(|_| wanted == TIME) {
                said.push(Assumption::Step { column, seconds });
                return Ok(Time::Rows { seconds });
            }
            if !self.options.timeless || wanted != TIME {
                return Err(self.missing(TIME, None));
            }
            said.push(Assumption::Timeless);
            return Ok(Time::Rows { seconds: 1.0 });
        };
        let column = self.header[found.index].text.clone();
        // The name `t_s` states seconds; a row of units may state another unit.
        let stated = self.stated(&found).or((column == TIME).then_some(("s", true)));
        let factor = match (scale, stated) {
            (Some(scale), _) => Some(scale),
            (None, Some((unit, sure))) => match conversion(unit, "s") {
                Ok(factor) => {
                    if column != TIME || factor != 1.0 {
                        said.push(Assumption::Time { column: column.clone(), unit: unit.into(), stated: true });
                    }
                    Some(factor)
                }
                Err(_) if !sure => None,
                Err(fault) => return Err(self.unit_fault(&column, unit, TIME, "s", fault)),
            },
            (None, None) => None,
        };
        if scale.is_some() && column != TIME && self.wanted(TIME) != column {
            said.push(Assumption::Column {
                signal: TIME.into(),
                column: column.clone(),
                unit: None,
                model_unit: None,
                factor: 1.0,
            });
        }
        Ok(Time::One { index: found.index, column, factor, scaled: scale.is_some() })
    }

    /// The column of the time by its name or, failing that, by its first reading: a name of the time, one of a date, one of the time at the
    /// end of a path, one that begins with the time and has its unit in it, a column of dates, at last the first column, where it may be the time.
    fn named_time(&self, is_taken: &dyn Fn(usize) -> bool) -> Result<Option<Fitting<'_>>, LogError> {
        let last = |text: &str| text.rfind(['.', '/', ':']).map_or(0, |at| at + 1);
        let is_date = |text: &str| DATES.iter().any(|date| date.eq_ignore_ascii_case(text));
        // A file without a header begins with its time, where the first numbers are stamps.
        let is_first =
            |column: &ColumnName| column.text == "1" || column.text == self.header[0].text && may_be_time(&column.text);
        let ways: [&dyn Fn(&ColumnName) -> bool; 6] = [
            &|column| is_time_name(&column.text),
            &|column| is_date(&column.text),
            &|column| is_time_name(&column.text[last(&column.text)..]),
            &|column| unit_within(&column.text).is_some(),
            &|column| column.holds == Holds::Time,
            &|column| column.holds == Holds::Rising && is_first(column),
        ];
        for (way, fits) in ways.iter().enumerate() {
            let mut found: Vec<usize> = self.indices(fits).filter(|index| !is_taken(*index)).collect();
            if way >= 4 {
                found.truncate(1);
            }
            // Of the times of several records the one counts that the columns which were named belong to.
            let own = |index: &usize| {
                let text = &self.header[*index].text;
                let record = &text[..last(text)];
                self.options.map.values().all(|column| column.starts_with(record)) && !self.options.map.is_empty()
            };
            if found.len() > 1 && found.iter().filter(|index| own(index)).count() == 1 {
                found.retain(own);
            }
            let fitting = found.into_iter().map(|index| {
                let text = &self.header[index].text;
                let (_, unit, bracketed) = split_unit(&text[last(text)..]);
                Fitting { index, unit: unit.filter(|unit| is_time(unit)).or_else(|| unit_within(text)), bracketed }
            });
            if let Some(found) = self.only(fitting.collect(), TIME)? {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    fn said_two(&self, two: Time, scale: Option<f64>, said: &mut Vec<Assumption>) -> Time {
        let mut two = two;
        if let Time::Two { column, unit, factor, .. } = &mut two {
            let fractions = if *unit == 1e-9 { "nanoseconds" } else { "microseconds" };
            said.push(Assumption::Time {
                column: column.clone(),
                unit: format!("seconds and {fractions}"),
                stated: true,
            });
            *factor = scale.unwrap_or(1.0);
        }
        two
    }

    /// A stamp in two columns, seconds and fractions; with a name, the stamp whose columns begin with it.
    fn two(&self, name: Option<&str>) -> Result<Option<Time>, LogError> {
        let parts = |index: usize| -> Option<(&str, &str)> {
            let text = self.header[index].text.as_str();
            let at = text.rfind(['.', '/']).map_or(0, |at| at + 1);
            // The last word of a path, or of a name with underscores; `tv_sec` is one word.
            let word = match text[at..].rfind('_') {
                Some(below) if !text[at..].to_ascii_lowercase().starts_with("tv_") => at + below + 1,
                _ => at,
            };
            Some((&text[..word], &text[word..]))
        };
        let mut found = Vec::new();
        for seconds in 0..self.header.len() {
            let Some((stem, word)) = parts(seconds) else { continue };
            let stamp = match name {
                Some(name) => stem.trim_end_matches(['.', '/', '_']) == name,
                None => {
                    let last = stem.trim_end_matches(['.', '/', '_']).to_ascii_lowercase();
                    last.is_empty() || last.ends_with("stamp") || TIMES.contains(&last.as_str())
                }
            };
            if !stamp || !SECONDS.contains(&word.to_ascii_lowercase().as_str()) {
                continue;
            }
            for fractions in 0..self.header.len() {
                let Some((other, word)) = parts(fractions) else { continue };
                let size = FRACTIONS.iter().find(|(name, _)| *name == word.to_ascii_lowercase());
                if let Some((_, unit)) = size.filter(|_| other == stem) {
                    let column = format!("{} and {}", self.header[seconds].text, self.header[fractions].text);
                    found.push(Time::Two { seconds, fractions, column, unit: *unit, factor: 1.0 });
                }
            }
        }
        if found.len() > 1 {
            return Err(self.ambiguous(TIME, found.iter().map(pair_name).collect()));
        }
        Ok(found.pop())
    }
}

/// Whether one of the signals is a length, an angle or their rate by its unit.
fn any_moves(signals: &[Signal]) -> bool {
    let moves = |unit: &str| ["m", "rad", "m/s", "rad/s"].iter().any(|own| conversion(unit, own).is_ok());
    signals.iter().filter_map(|signal| signal.unit.as_deref()).any(moves)
}

/// Whether a column of this name may be the time, for a guess that the user is asked about.
pub(super) fn may_be_time(text: &str) -> bool {
    let small = text.to_lowercase();
    is_time_name(text)
        || ["time", "stamp", "zeit", "clock", "millis", "micros", "tick", "date", "uhr"]
            .iter()
            .any(|word| small.contains(word))
        || ["ts", "ms", "us", "sec", "secs", "seconds", "s"].contains(&small.as_str())
}

/// Whether a column of this name is the time: one of the words for it, with a unit or without.
pub(super) fn is_time_name(text: &str) -> bool {
    let (base, unit, _) = split_unit(text);
    let is = |name: &str| TIMES.iter().any(|time| time.eq_ignore_ascii_case(name.trim_start_matches('_')));
    let path = text.to_ascii_lowercase().replace(['/', '.'], "_");
    is(text) || is(base) && unit.is_some_and(is_time) || path.ends_with("header_stamp")
}

/// The unit of time among the words of a name that begins with the time: `time_ms_since_boot`.
fn unit_within(text: &str) -> Option<&str> {
    let mut words = text.split(['_', ' ', '-']);
    let begins = words.next().is_some_and(|word| word.len() > 1 && is_time_name(word));
    words.find(|word| begins && is_time(word))
}

fn pair_name(time: &Time) -> String {
    match time {
        Time::One { column, .. } | Time::Two { column, .. } => column.clone(),
        Time::Rows { .. } => String::new(),
    }
}

/// Whether a text is a unit of time.
fn is_time(unit: &str) -> bool {
    conversion(unit, "s").is_ok()
}

/// Splits a unit off a name: `name [unit]`, `name (unit)`, `name_unit`; whether it stands in brackets. What stands in round brackets
/// or behind an underscore is a unit only if it is one that is known.
pub(super) fn split_unit(text: &str) -> (&str, Option<&str>, bool) {
    // A number in brackets is an index.
    let bracketed = text.strip_suffix(']').and_then(|text| text.rsplit_once('['));
    if let Some((base, unit)) = bracketed.filter(|(_, unit)| unit.trim().parse::<usize>().is_err()) {
        return (base.trim(), Some(unit.trim()), true);
    }
    if let Some((base, unit)) = text.strip_suffix(')').and_then(|text| text.rsplit_once('('))
        && unit_of(unit).is_some()
        && unit.trim().parse::<usize>().is_err()
    {
        return (base.trim(), Some(unit.trim()), true);
    }
    // The longest unit behind an underscore, since a unit may have underscores too (`rad_per_s`).
    for (at, _) in text.match_indices('_') {
        let unit = &text[at + 1..];
        // `x_1` is one of several.
        let numbered = unit.starts_with(|c: char| c.is_ascii_digit() || c == '-');
        if at > 0 && !numbered && unit_of(unit).is_some() {
            return (&text[..at], Some(unit), false);
        }
    }
    (text, None, false)
}

fn check_names(signals: &[String], options: &ReadingSettings) -> Result<(), LogError> {
    let unknown = |adjustment: Adjustment, name: &String| LogError::UnknownName {
        adjustment,
        name: name.clone(),
        available: signals.to_vec(),
    };
    for name in options.map.keys() {
        if name != TIME && !signals.contains(name) {
            return Err(unknown(Adjustment::Column, name));
        }
    }
    for (adjustment, values) in [(Adjustment::Scale, &options.scale), (Adjustment::Offset, &options.offset)] {
        for (name, &value) in values {
            if !(signals.contains(name) || name == TIME && adjustment == Adjustment::Scale) {
                return Err(unknown(adjustment, name));
            }
            check_value(adjustment, name, value)?;
        }
    }
    Ok(())
}

fn check_value(adjustment: Adjustment, name: &str, value: f64) -> Result<(), LogError> {
    let backwards = name == TIME && value < 0.0;
    if !value.is_finite() || (adjustment == Adjustment::Scale && value == 0.0) || backwards {
        return Err(LogError::Unusable { adjustment, name: name.into(), value });
    }
    Ok(())
}
