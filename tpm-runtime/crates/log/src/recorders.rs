//! Texts of recorders whose columns have times of their own and stand below lines about them: TwinCAT Scope, the trace of CODESYS, LabVIEW
//! and ArduPilot.
//!
//! Every recorder writes its own unit of time, so that none is inferred here.

use crate::assumption::Assumption;
use crate::columns::{ColumnName, Holds};
use crate::dates::Date;
use crate::dialect::number;
use crate::error::LogError;
use crate::own_times::{OwnTimes, Timed};
use crate::stamps::{Resolution, last_digit};
use std::collections::HashMap;
use std::io::Read;

/// A recorder that writes text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Recorder {
    TwinCat,
    Codesys,
    LabView,
    ArduPilot,
}

/// The sign behind the first word of a line, where it separates fields.
fn separator(line: &str, first: &str) -> Option<char> {
    line.strip_prefix(first)?.chars().next().filter(|sign| ['\t', ';', ','].contains(sign))
}

/// Keys of the second line of TwinCAT Scope, where its header has more than names.
const SCOPE: [&str; 6] = ["File", "SymbolComment", "SymbolName", "Data-Type", "SampleTime[ms]", "Unit"];

/// Whether lines that are not blank begin a text of TwinCAT Scope.
pub(super) fn is_scope(lines: &[&str]) -> bool {
    let ([first, second, ..], Some(sign)) = (lines, lines.first().and_then(|first| separator(first, "Name"))) else {
        return false;
    };
    let row = fields(second, sign);
    // A header may have the names alone, above rows whose first field is the time.
    let is_row = || row.len() > 1 && row.len() == fields(first, sign).len();
    SCOPE.contains(&row[0]) || is_row() && scope_number(row[0], sign).is_some_and(f64::is_finite)
}

/// Whether lines that are not blank begin a trace of CODESYS.
pub(super) fn is_trace(lines: &[&str]) -> bool {
    let of_variable = |line: &&str| line.starts_with("0.Variable");
    lines.first().is_some_and(|first| separator(first, "[key]").is_some()) || lines.iter().any(of_variable)
}

/// Whether lines that are not blank begin a measurement file of LabVIEW.
pub(super) fn is_measurement(lines: &[&str]) -> bool {
    lines.first().is_some_and(|first| first.starts_with("LabVIEW Measurement"))
}

/// Whether lines that are not blank begin a log of ArduPilot as text.
pub(super) fn is_messages(lines: &[&str]) -> bool {
    lines.iter().any(|line| matches!(fields(line, ',')[..], ["FMT", _, _, _, _, _, ..]))
}

/// A number whose fraction begins with a comma where commas do not separate.
fn scope_number(text: &str, sign: char) -> Option<f64> {
    number(text.as_bytes(), if sign != ',' && text.contains(',') { b',' } else { b'.' })
}

fn fields(line: &str, sign: char) -> Vec<&str> {
    line.split(sign).map(|field| field.trim().trim_matches('"')).collect()
}

/// Columns as they are gathered.
struct Gathered {
    columns: Vec<Timed>,
    resolution: Resolution,
    sign: char,
    /// How many lines were not understood, and the first of them.
    unread: (u64, u64),
}

impl Gathered {
    fn new(sign: char) -> Self {
        Gathered { columns: Vec::new(), resolution: Resolution::default(), sign, unread: (0, 0) }
    }

    fn column(&mut self, name: &str, unit: Option<&str>) -> usize {
        let name = ColumnName { unit: unit.map(str::to_owned), ..ColumnName::new(name) };
        self.columns.push(Timed { name, readings: Vec::new() });
        self.columns.len() - 1
    }

    /// The stamp in a field, with its digits.
    fn stamp(&mut self, field: &str) -> Option<f64> {
        let stamp = scope_number(field, self.sign).filter(|stamp| stamp.is_finite())?;
        let decimal = if self.sign != ',' && field.contains(',') { b',' } else { b'.' };
        self.resolution.take(stamp, last_digit(field.as_bytes(), decimal));
        Some(stamp)
    }

    /// Takes a reading in; a blank is none.
    fn take(&mut self, column: usize, stamp: f64, field: &str) {
        self.take_times(1.0, column, stamp, field);
    }

    fn take_times(&mut self, factor: f64, column: usize, stamp: f64, field: &str) {
        let reading = match field {
            "TRUE" | "True" | "true" => Some(1.0),
            "FALSE" | "False" | "false" => Some(0.0),
            field => scope_number(field, self.sign),
        };
        if let Some(reading) = reading.filter(|reading| !reading.is_nan()) {
            self.columns[column].readings.push((stamp, factor * reading));
        }
    }

    fn not_read(&mut self, line: usize) {
        self.unread = (self.unread.0 + 1, if self.unread.0 == 0 { line as u64 + 1 } else { self.unread.1 });
    }
}

impl Recorder {
    /// What a file of it is.
    fn kind(self) -> &'static str {
        match self {
            Recorder::TwinCat => "an export of TwinCAT Scope",
            Recorder::Codesys => "a trace of CODESYS",
            Recorder::LabView => "a measurement file of LabVIEW",
            Recorder::ArduPilot => "a log of ArduPilot as text",
        }
    }

    /// The columns of a text; messages call it `path`.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be read, or holds no reading.
    pub(super) fn read(self, mut input: impl Read, path: &str) -> Result<OwnTimes, LogError> {
        let mut bytes = Vec::new();
        input.read_to_end(&mut bytes).map_err(|source| LogError::Io { path: path.into(), source })?;
        // Older programs write umlauts and degrees as Latin-1.
        let text = match String::from_utf8(bytes) {
            Ok(text) => text,
            Err(other) => other.into_bytes().iter().map(|byte| char::from(*byte)).collect(),
        };
        let text = text.trim_start_matches('\u{feff}');
        let (mut gathered, name, unit) = match self {
            Recorder::TwinCat => (scope(text), "Name", "ms"),
            Recorder::Codesys => {
                let (gathered, unit) = trace(text);
                (gathered, "time", unit)
            }
            Recorder::LabView => (measurement(text), "X_Value", "s"),
            Recorder::ArduPilot => (messages(text), "TimeUS", "us"),
        };
        // Texts, such as messages, are no columns.
        gathered.columns.retain(|column| !column.readings.is_empty());
        if gathered.columns.is_empty() {
            return Err(LogError::Format {
                path: path.into(),
                what: format!("the file is {}, and holds no reading that could be read", self.kind()),
                remedy: "export it once more, with its header and its rows".into(),
            });
        }
        let assumptions = match gathered.unread {
            (0, _) => Vec::new(),
            (count, first) => vec![Assumption::NotRead { recorder: self.kind(), count, first }],
        };
        let time = ColumnName { unit: Some(unit.into()), holds: Holds::Time, ..ColumnName::new(name) };
        Ok(OwnTimes::new(gathered.columns, time).of_text(gathered.resolution, assumptions).of_kind(self.kind()))
    }
}

/// TwinCAT Scope: a column `Name` of milliseconds before every group of columns of one rate; lines about the columns have their key in the
/// place of the times. A slower group fills its rows with blanks at the end, or with readings that it repeats.
fn scope(text: &str) -> Gathered {
    let mut all = Gathered::new(text.lines().find_map(|line| separator(line, "Name")).unwrap_or('\t'));
    let mut header: Vec<&str> = Vec::new();
    let mut units: Vec<&str> = Vec::new();
    // The column of its time and the column of every column of readings.
    let mut places: Vec<(usize, usize)> = Vec::new();
    let mut last: Vec<f64> = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let row = fields(line, all.sign);
        let is_row = !header.is_empty()
            && (0..row.len())
                .any(|k| header.get(k) == Some(&"Name") && scope_number(row[k], all.sign).is_some_and(f64::is_finite));
        if is_row && places.is_empty() {
            let mut time = 0;
            for (k, name) in header.iter().enumerate() {
                match *name {
                    "Name" => time = k,
                    "" => {}
                    name => {
                        // A unit stands before its quantity: `mm (Length)`.
                        let unit = units.get(k).map(|unit| unit.split(" (").next().unwrap_or("").trim());
                        all.column(name, unit.filter(|unit| !unit.is_empty() && !unit.starts_with('(')));
                        places.push((time, k));
                    }
                }
            }
            last = vec![f64::NEG_INFINITY; places.len()];
        }
        if is_row {
            for (column, (time, own)) in places.iter().enumerate() {
                let Some(stamp) = row.get(*time).and_then(|field| all.stamp(field)) else { continue };
                if stamp > last[column] {
                    last[column] = stamp;
                    all.take(column, stamp, row.get(*own).unwrap_or(&""));
                }
            }
            continue;
        }
        match row[0] {
            "Name" if places.is_empty() => header = row,
            "Unit" if places.is_empty() => units = row,
            "" | "EOF" => {}
            _ if places.is_empty() => {}
            _ => all.not_read(at),
        }
    }
    all
}

/// The flag of a trace whose stamps are microseconds; others are in milliseconds.
const MICROSECONDS: u32 = 0x20;

/// CODESYS: lines of `key; value`, for every variable `0.Variable; NAME`, and below `0.Data;` its rows `; time; value`.
fn trace(text: &str) -> (Gathered, &'static str) {
    let sign = text.lines().find_map(|line| separator(line, "[key]").or_else(|| separator(line, "0.Variable")));
    let mut all = Gathered::new(sign.unwrap_or(';'));
    let (mut current, mut unit) = (None, "ms");
    for (at, line) in text.lines().enumerate() {
        let row = fields(line, all.sign);
        match row[..] {
            ["", stamp, value, ..] => match current.zip(all.stamp(stamp)) {
                Some((column, stamp)) => all.take(column, stamp, value),
                None => all.not_read(at),
            },
            ["Flags", flags, ..] => {
                let digits = flags.trim_start_matches("0x");
                let flags = u32::from_str_radix(digits, if digits == flags { 10 } else { 16 });
                if flags.is_ok_and(|flags| flags & MICROSECONDS != 0) {
                    unit = "us";
                }
            }
            [key, name, ..] if key.ends_with(".Variable") => current = Some(all.column(name, None)),
            _ => {}
        }
    }
    (all, unit)
}

/// A channel of LabVIEW.
struct LabChannel {
    /// Its field in a row, and that of its time where it has one.
    field: usize,
    time: Option<usize>,
    /// Its column among those that were gathered.
    column: usize,
    /// First time and step, for rows without a time.
    grid: Option<(f64, f64)>,
}

/// LabVIEW: a header of the file, then for every segment a header of its channels, their names and rows; `X_Columns` says whether a column
/// of times stands before all channels, before each, or before none, where `X0` and `Delta_X` say the times.
fn measurement(text: &str) -> Gathered {
    let of_commas = text.lines().take(30).any(|line| fields(line, ',')[..].starts_with(&["Separator", "Comma"]));
    let mut all = Gathered::new(if of_commas { ',' } else { '\t' });
    let sign = all.sign;
    let mut keys: HashMap<&str, Vec<&str>> = HashMap::new();
    let mut channels: Vec<LabChannel> = Vec::new();
    let mut columns: HashMap<(usize, &str), usize> = HashMap::new();
    let (mut in_header, mut names_next, mut special) = (true, false, false);
    let (mut start, mut shift, mut rows) = (None, 0.0, 0.0);
    for (at, line) in text.lines().enumerate() {
        let row = fields(line, sign);
        match row[0] {
            "***Start_Special***" => special = true,
            "***End_Special***" => special = false,
            _ if special || row.iter().all(|field| field.is_empty()) => {}
            "***End_of_Header***" => (in_header, names_next) = (false, true),
            _ if names_next && row.iter().any(|field| field.starts_with("X_Value")) => {
                let is_time = |field: &str| field.starts_with("X_Value");
                let named = |field: &str| !is_time(field) && !field.is_empty() && field != "Comment";
                let count = row.iter().filter(|field| named(field)).count();
                // Lines of the header have a field for every column behind the first, or one for every channel.
                let stated = |key: &str, field: usize, channel: usize| {
                    let row = keys.get(key)?;
                    let length = row.iter().rposition(|field| !field.is_empty()).map_or(0, |last| last + 1);
                    row.get(if length > count { field - 1 } else { channel }).copied().filter(|field| !field.is_empty())
                };
                channels.clear();
                let mut time = None;
                for (field, name) in row.iter().enumerate() {
                    if is_time(name) {
                        time = Some(field);
                    } else if named(name) {
                        let channel = channels.len();
                        let number_of =
                            |key| scope_number(stated(key, field, channel)?, sign).filter(|x| x.is_finite());
                        let grid = number_of("Delta_X").map(|step| (number_of("X0").unwrap_or(0.0), step));
                        let unit = stated("Y_Unit_Label", field, channel);
                        let column = *columns.entry((channel, name)).or_insert_with(|| all.column(name, unit));
                        channels.push(LabChannel { field, time, column, grid });
                    }
                }
                // Times are counted from the time of day at which their segment began.
                let first = |key: &str| keys.get(key).and_then(|row| row.first()).copied().unwrap_or("");
                let date = Date::of(format!("{} {}", first("Date"), first("Time")).as_bytes());
                start = start.or(date);
                let both = start.zip(date).filter(|_| first("Time_Pref") != "Absolute");
                shift = both
                    .map_or(0.0, |(first, own)| (own.seconds - first.seconds) as f64 + (own.fraction - first.fraction));
                (names_next, rows) = (false, 0.0);
            }
            // A segment with a header of its own begins so.
            key if in_header || key == "Channels" => {
                in_header = true;
                keys.insert(key, row[1..].to_vec());
            }
            _ => {
                let mut is_read = false;
                for channel in &channels {
                    let told = channel.time.and_then(|time| row.get(time)).filter(|field| !field.is_empty());
                    let on_grid = || channel.grid.map(|(first, step)| first + step * rows);
                    let stamp = told.map_or_else(on_grid, |field| all.stamp(field));
                    if let Some(stamp) = stamp {
                        is_read = true;
                        all.take(channel.column, shift + stamp, row.get(channel.field).unwrap_or(&""));
                    }
                }
                rows += 1.0;
                if !is_read {
                    all.not_read(at);
                }
            }
        }
    }
    // Stamps that were moved have not the digits of the text.
    if shift != 0.0 {
        all.resolution = Resolution::default();
    }
    all
}

/// A message of ArduPilot.
struct Message<'a> {
    name: &'a str,
    format: &'a str,
    columns: Vec<&'a str>,
    /// The letters of the units of its columns, and those of their factors.
    units: &'a str,
    factors: &'a str,
}

/// ArduPilot: `FMT` lines name the columns of every message, of which each has a time; `FMTU`, `UNIT` and `MULT` state units.
/// A message of several sensors has a column with the number of the sensor: `IMU[0].GyrX`.
fn messages(text: &str) -> Gathered {
    let mut all = Gathered::new(',');
    let mut known: HashMap<&str, Message<'_>> = HashMap::new();
    let mut types: HashMap<&str, &str> = HashMap::new();
    let (mut units, mut factors): (HashMap<char, &str>, HashMap<char, f64>) = Default::default();
    let mut columns: HashMap<(&str, &str, &str), (usize, f64)> = HashMap::new();
    let letter =
        |code: &str| code.parse::<u8>().ok().filter(|_| code.len() > 1).map(char::from).or(code.chars().next());
    for (at, line) in text.lines().enumerate() {
        let row = fields(line, ',');
        match row[..] {
            ["FMT", kind, _, name, format, ..] if row.len() > 5 => {
                types.insert(kind, name);
                let columns = row[5..].to_vec();
                known.insert(name, Message { name, format, columns, units: "", factors: "" });
                continue;
            }
            ["FMTU", _, kind, units, factors, ..] => {
                if let Some(message) = types.get(kind).and_then(|name| known.get_mut(name)) {
                    (message.units, message.factors) = (units, factors);
                }
                continue;
            }
            ["UNIT", _, code, label, ..] => {
                letter(code).map(|code| units.insert(code, label));
                continue;
            }
            ["MULT", _, code, factor, ..] => {
                letter(code).zip(factor.parse().ok()).map(|(code, factor)| factors.insert(code, factor));
                continue;
            }
            [""] => continue,
            _ => {}
        }
        let Some(message) = known.get(row[0]) else {
            all.not_read(at);
            continue;
        };
        let own = &row[1..];
        let is_time = |name: &str| ["TimeUS", "TimeMS"].contains(&name);
        let Some(time) = message.columns.iter().position(|name| is_time(name)) else { continue };
        // A text at the end may hold commas; numbers that are missing were cut off.
        let Some(stamp) =
            own.get(time).and_then(|field| all.stamp(field)).filter(|_| own.len() >= message.columns.len())
        else {
            all.not_read(at);
            continue;
        };
        let stamp = if message.columns[time] == "TimeMS" { stamp * 1e3 } else { stamp };
        let named = || message.columns.iter().position(|name| ["I", "Instance"].contains(name));
        let number = message.units.find('#').or_else(named);
        let sensor = number.and_then(|place| own.get(place)).copied().unwrap_or("");
        for (k, name) in message.columns.iter().enumerate().filter(|(k, name)| !is_time(name) && Some(*k) != number) {
            let (column, factor) = *columns.entry((message.name, name, sensor)).or_insert_with(|| {
                let at = |letters: &str| letters.chars().nth(k).unwrap_or('-');
                // Formats of hundredths and of degrees are written in their unit, others as the integers that they are.
                let whole = !"cCeEL".contains(at(message.format));
                let factor = factors.get(&at(message.factors)).copied().filter(|factor| whole && *factor > 0.0);
                let unit = units.get(&at(message.units)).copied().filter(|unit| crate::unit::unit_of(unit).is_some());
                let sensor = if sensor.is_empty() { String::new() } else { format!("[{sensor}]") };
                let name = format!("{}{sensor}.{name}", message.name);
                (all.column(&name, unit), unit.and(factor).unwrap_or(1.0))
            });
            all.take_times(factor, column, stamp, own[k]);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use crate::assumption::Assumption;
    use crate::columns::Columns;
    use crate::format::open_columns;
    use crate::names::Signal;
    use crate::{ReadingSettings, Recording};

    /// What is moved and what moves it, at a time in seconds.
    fn x(t: f64) -> f64 {
        (3.0 * t).sin()
    }

    fn u(t: f64) -> f64 {
        (2.0 * t).floor() - 1.0
    }

    fn read(text: &str, map: &[(&str, &str)]) -> Result<Recording, String> {
        let map = map.iter().map(|(signal, column)| ((*signal).into(), (*column).into())).collect();
        let options = ReadingSettings { map, ..ReadingSettings::default() };
        let signal = |name: &str, unit: &str| Signal { name: name.into(), unit: Some(unit.into()) };
        let signals = [signal("x", "m"), signal("u", "N")];
        let read = |mut columns: Box<dyn Columns + '_>| {
            Recording::of_columns(&mut *columns, "run", (&signals[..1], &signals), &[], &options)
        };
        open_columns(text.as_bytes(), "run").and_then(read).map_err(|error| error.to_string())
    }

    /// The text is one record of these samples at these steps.
    fn holds(text: &str, map: &[(&str, &str)], samples: usize, step: f64) -> Recording {
        let start = &text[..text.len().min(80)];
        let recording = read(text, map).unwrap_or_else(|error| panic!("{start}: {error}"));
        let [log] = &recording.segments[..] else { panic!("{start}: {:?}", recording.report) };
        assert!(
            (log.sample_time - step).abs() < 1e-9 && log.len() == samples,
            "{start}: {} {}",
            log.sample_time,
            log.len()
        );
        for k in 0..log.len() {
            let t = step * k as f64;
            let [own, force] = [log.channels[0][k], log.channels[1][k]];
            assert!((own - x(t)).abs() < 1e-5 && (force - u(t + 1e-9)).abs() < 1e-9, "{start}, {k}: {own} {}", x(t));
        }
        recording
    }

    /// A text of TwinCAT Scope with a group of 10 ms and one of 50 ms.
    fn scope(sign: char, decimal: &str, slow_first: bool, is_full: bool) -> String {
        let groups = |fast: &str, slow: &str| {
            let (fast, slow) = (fast.replace('|', &sign.to_string()), slow.replace('|', &sign.to_string()));
            if slow_first { format!("{slow}{sign}{fast}\n") } else { format!("{fast}{sign}{slow}\n") }
        };
        let names = groups("Name|Axis.x|Axis.u", "Name|Temperature");
        let mut text = names.clone();
        if is_full {
            let line =
                |key: &str, fast: &str, slow: &str| groups(&format!("{key}|{fast}|{fast}"), &format!("{key}|{slow}"));
            text =
                format!("Name{sign}Project\nFile{sign}a.csv\nStarttime of export{sign}132959733843760000\n\n{names}");
            text += &line("SampleTime[ms]", "10", "50");
            text += &line("ScaleFactor", "1", "1");
            text += &groups("Unit|mm (Length)|N (Force)", "Unit|(None)");
            text += "\n";
        }
        for k in 0..200 {
            let t = 0.01 * f64::from(k);
            let factor = if is_full { 1e3 } else { 1.0 };
            let fast = format!("{}|{:.6}|{:.1}", 10 * k, factor * x(t), u(t + 1e-9));
            let slow = if k < 40 { format!("{}|20.5", 50 * k) } else { "|".to_owned() };
            // Commas would separate where they are decimal signs too.
            text += &groups(&fast.replace('.', decimal), &slow.replace('.', decimal));
        }
        text
    }

    #[test]
    fn scopes_have_a_time_before_every_group() {
        for (sign, decimal) in [('\t', ","), ('\t', "."), (';', ","), (',', ".")] {
            for (slow_first, is_full) in [(false, true), (true, true), (false, false)] {
                let text = scope(sign, decimal, slow_first, is_full);
                holds(&text, &[], 200, 0.01);
                holds(&format!("\u{feff}{text}EOF\n"), &[], 200, 0.01);
            }
        }
        let error = read(&scope('\t', ",", false, true), &[("x", "Axis.y")]).expect_err("no such channel");
        assert!(
            error.contains("an export of TwinCAT Scope, and the columns are Name, Axis.x, Axis.u, Temperature"),
            "{error}"
        );
        let error = read("Name\tp\nFile\tp.csv\nName\tx\nUnit\t(None)\n", &[]).expect_err("no rows");
        assert!(error.contains("holds no reading"), "{error}");
    }

    #[test]
    fn traces_have_their_variables_one_below_the_other() {
        for (flags, unit, sign) in [("16", 1, ';'), ("0x20", 1000, ';'), ("16", 1, '\t')] {
            let mut text = format!("[key]; [value]\nName; A.Trace\nFlags; {flags}\n");
            for (k, (name, of)) in [("PLC.x", x as fn(f64) -> f64), ("PLC.u", u)].into_iter().enumerate() {
                text += &format!("{k}.Variable; {name}\n{k}.Class; 8\n{k}.Data; \n");
                text += &(0..150)
                    .map(|i| format!("; {}; {:.7}\n", 20 * unit * i, of(0.02 * f64::from(i) + 1e-9)))
                    .collect::<String>();
            }
            holds(&text.replace(';', &sign.to_string()), &[], 150, 0.02);
        }
    }

    #[test]
    fn measurements_have_times_in_no_one_or_every_second_column() {
        let head = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nTime_Pref\tRelative\n***End_of_Header***\t\n\t\n";
        let segment = |time: &str, units: &str, names: &str| {
            format!(
                "Channels\t2\nSamples\t100\t100\nDate\t2024/05/06\t2024/05/06\nTime\t10:00:{time}\t10:00:{time}\nY_Unit_Label\t{units}\nX_Dimension\tTime\tTime\nX0\t0.0E+0\t0.0E+0\nDelta_X\t0.005000\t0.005000\n***End_of_Header***\t\t\n{names}\n"
            )
        };
        for (names, units) in [
            ("X_Value\tx\tu\tComment", "mm\tN"),
            ("X_Value\tx\tX_Value\tu\tComment", "mm\t\tN"),
            ("\tX_Value\tx\tu", "mm\tN"),
        ] {
            let rows = |from: i32| -> String {
                let row = |k: i32| {
                    let t = 0.005 * f64::from(k);
                    let (own, x, u) = (t - 0.005 * f64::from(from), 1e3 * x(t), u(t + 1e-9));
                    match names.matches("X_Value").count() {
                        2 => format!("{own:.6}\t{x:.6}\t{own:.6}\t{u:.6}\n"),
                        _ if names.starts_with('\t') => format!("\t{x:.6}\t{u:.6}\n"),
                        _ => format!("{own:.6}\t{x:.6}\t{u:.6}\tnote\n"),
                    }
                };
                (from..from + 100).map(row).collect()
            };
            let names = names.trim_start_matches('\t');
            let text = format!(
                "{head}{}{}\n{}{}",
                segment("00.0000000", units, names),
                rows(0),
                segment("00.5000000", units, names),
                rows(100)
            );
            holds(&text, &[], 200, 0.005);
            holds(&text.replace("Separator\t.", "Separator\t,").replace('.', ","), &[], 200, 0.005);
        }
    }

    #[test]
    fn messages_have_columns_by_their_format() {
        let mut text = String::from(
            "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 40, 40, CTL, Qfc, TimeUS,Pos,u\nFMT, 41, 20, BAT, QBf, TimeUS,Instance,V\n\
             FMT, 42, 20, MSG, QZ, TimeUS,Message\nUNIT, 1, 109, m\nMULT, 1, 67, 0.01\nFMTU, 1, 40, smm, FCC\nPARM, 5, A_B, 1.0\n",
        );
        for k in 0..200 {
            let t = 0.01 * f64::from(k);
            text += &format!("CTL, {}, {:.6}, {:.2}\n", 7_000_000 + 10_000 * k, 100.0 * x(t), u(t + 1e-9));
            if k % 10 == 0 {
                text += &format!("BAT, {}, {}, 12.1\n", 7_000_005 + 10_000 * k, k / 10 % 2);
                text += &format!("MSG, {}, a, text\n", 7_000_006 + 10_000 * k);
            }
        }
        let map = [("x", "CTL.Pos"), ("u", "CTL.u")];
        let mut force = text.replace("FMTU, 1, 40, smm, FCC", "FMTU, 1, 40, sm-, FCC");
        let recording = holds(&force, &map, 200, 0.01);
        let said = Assumption::NotRead { recorder: "a log of ArduPilot as text", count: 1, first: 8 };
        assert!(recording.report.assumptions.contains(&said), "{:?}", recording.report.assumptions);
        force.push_str("CTL, 9000000, 1.0");
        let recording = read(&force, &map).expect("a line that was cut off");
        assert!(recording.report.remarks().join("; ").contains("2 lines are not read"), "{:?}", recording.report);
        let error = read(&text, &[("x", "BAT.V")]).expect_err("two sensors");
        assert!(error.contains("TimeUS, CTL.Pos, CTL.u, BAT[0].V, BAT[1].V; name"), "{error}");
    }
}
