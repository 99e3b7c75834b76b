//! Reading a logged run.
//!
//! Invariant: a [`Log`] holds evenly sampled, finite signals of equal lengths, in the model's units and order, and the
//! line in the file of each sample.

use crate::assumption::Assumption;
use crate::columns::Columns;
use crate::computed::Computed;
use crate::error::LogError;
use crate::format::{open_columns, open_file};
use crate::lone::lone_readings;
use crate::names::{Names, Signal};
use crate::options::{LEAST_SAMPLES, ReadingSettings, rate_of};
use crate::repeated::repeated_readings;
use crate::source::LogSource;
use crate::stamps::Uneven;
use crate::steps::Steps;
use crate::table::Table;
use std::io::Read;
use std::path::Path;
use tpm_controller::model::{Label, Model, moving};

/// Measured rates by coordinate, nothing for a coordinate whose rate is not measured; an empty list where none is.
pub type Rates = Vec<Option<Vec<f64>>>;

/// Name of the column of a coordinate's measured rate, written as in models: `dot(x)`.
pub fn rate_column(model: &dyn Model<f64>, coordinate: usize) -> String {
    rate_of(model.coordinate(coordinate).name)
}

/// Name of the column of a coordinate's measured acceleration, written as in models: `ddot(x)`. It is read where it is mapped, since columns
/// of this name are mostly computed from the position.
pub fn acceleration_column(model: &dyn Model<f64>, coordinate: usize) -> String {
    format!("d{}", rate_column(model, coordinate))
}

/// A run, read and checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// Name of the log's source, for messages.
    pub path: String,
    /// Time between samples, s.
    pub sample_time: f64,
    /// Coordinates of the model, then its inputs; each as long as the log.
    pub channels: Vec<Vec<f64>>,
    /// Measured rates, in the unit of the coordinate per second.
    pub rates: Rates,
    /// Line in the file of every sample (from 1); the number of the row where a format has no lines.
    pub lines: Vec<u64>,
    /// The steps in which the readings of the first channels are written, as far as they were told from the numbers of a file: of the
    /// coordinates in a recording, of all channels and then rates in a survey.
    pub steps: Vec<Steps>,
}

impl Log {
    /// A log from samples in memory (coordinates, then inputs), such as those of a simulated plant.
    ///
    /// # Errors
    /// [`LogError::TooShort`] for too few samples, [`LogError::FieldCount`] for unequal lengths,
    /// [`LogError::NotANumber`] for a value that is not finite.
    pub fn from_samples(name: &str, sample_time: f64, channels: Vec<Vec<f64>>) -> Result<Self, LogError> {
        let samples = channels.first().map_or(0, Vec::len);
        for channel in &channels {
            if channel.len() != samples {
                return Err(LogError::FieldCount {
                    quote: false,
                    path: name.into(),
                    line: channel.len().min(samples) as u64 + 1,
                    found: channel.len() as u64,
                    expected: samples as u64,
                });
            }
            if let Some(at) = channel.iter().position(|x| !x.is_finite()) {
                return Err(LogError::NotANumber {
                    path: name.into(),
                    line: at as u64 + 1,
                    column: String::new(),
                    text: channel[at].to_string(),
                });
            }
        }
        if samples < LEAST_SAMPLES {
            return Err(LogError::TooShort { path: name.into(), line: samples as u64, samples, needed: LEAST_SAMPLES });
        }
        let lines = (1..=samples as u64).collect();
        let steps = channels.iter().map(|channel| Steps::of(channel)).collect();
        Ok(Log { sample_time, steps, ..Log::unchecked(name, channels, Rates::new(), lines) })
    }

    /// A log of signals that were checked; its sample time is not set.
    pub(super) fn unchecked(path: &str, channels: Vec<Vec<f64>>, rates: Rates, lines: Vec<u64>) -> Self {
        Log { path: path.into(), sample_time: 0.0, channels, rates, lines, steps: Vec::new() }
    }

    /// Reads a whole record of a model's signals from bytes, one without a gap, with even stamps; messages call them `name`.
    /// [`Recording`](crate::Recording) reads others.
    ///
    /// # Errors
    /// [`LogError`] with the line when the text cannot be read, a column is missing, a value is not finite or time is
    /// not even.
    pub fn read(
        input: impl Read,
        name: &str,
        model: &dyn Model<f64>,
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        all_measured(model, name)?;
        let (mut log, _) = whole(&mut *open_columns(input, name)?, name, &signals(model), &[], options)?;
        log.follow(model);
        Ok(log)
    }

    /// Reads a whole record, of a file or in memory, together with the measured rates of coordinates: columns called `dot(x)`, or
    /// mapped to that name. A coordinate without such a column has no rate; the list is empty when no coordinate has one.
    ///
    /// # Errors
    /// [`LogError`] with the line when the file cannot be read, a column is missing, a value is not finite or time is
    /// not even.
    pub fn open_rated<'a>(
        source: impl Into<LogSource<'a>>,
        model: &dyn Model<f64>,
        options: &ReadingSettings,
    ) -> Result<(Self, Rates), LogError> {
        let source: LogSource<'_> = source.into();
        let (name, signals, rates) = (source.name(), signals(model), rate_signals(model));
        all_measured(model, &name)?;
        let (mut log, _) = whole(&mut *source.columns()?, &name, &signals, &rates, options)?;
        let rates = std::mem::take(&mut log.rates);
        log.follow(model);
        Ok((log, rates))
    }

    /// Reads a whole record of the named signals, in this order, without a model, with the assumptions made about the file.
    ///
    /// # Errors
    /// [`LogError`] with the line when the file cannot be read, a column is missing, a value is not finite or time is
    /// not even.
    pub fn open_signals(
        path: &Path,
        signals: &[String],
        options: &ReadingSettings,
    ) -> Result<(Self, Vec<Assumption>), LogError> {
        let signals: Vec<Signal> = signals.iter().map(|name| Signal { name: name.clone(), unit: None }).collect();
        let name = path.display().to_string();
        whole(&mut *open_columns(open_file(path)?, &name)?, &name, &signals, &[], options)
    }

    /// Puts the readings of a coordinate in the place of those of what follows from it, which no file has.
    pub(super) fn follow(&mut self, model: &dyn Model<f64>) {
        let own = moving(model);
        for c in own..model.dims().coordinates {
            let followed = model.presliding(c).map_or_else(Vec::new, |follows| self.channels[follows.of].clone());
            self.channels.insert(c, followed);
        }
    }

    /// Replaces single outliers of the coordinates by the values interpolated from their neighbours.
    /// Readings that repeat the reading before are replaced first, where this was not done in reading. Returns the
    /// outliers: channel, sample, and the change of the reading in the channel's unit. What follows from a coordinate then has its readings too.
    pub fn mend(&mut self, model: &dyn Model<f64>) -> Vec<(usize, usize, f64)> {
        let (own, dims) = (moving(model), model.dims());
        // A survey has the columns of the file alone.
        if self.channels.len() == dims.coordinates + dims.inputs {
            self.channels.drain(own..dims.coordinates);
        }
        let mended = self.mend_first(own);
        self.follow(model);
        mended
    }

    /// Replaces single outliers of so many channels.
    pub(super) fn mend_first(&mut self, channels: usize) -> Vec<(usize, usize, f64)> {
        let mut mended = Vec::new();
        for (c, channel) in self.channels.iter_mut().take(channels).enumerate() {
            let steps = self.steps.get(c).cloned().unwrap_or_else(|| Steps::of(channel));
            repeated_readings(channel, &steps).into_iter().for_each(|(k, value)| channel[k] = value);
            for (k, value) in lone_readings(channel, &steps) {
                mended.push((c, k, value - channel[k]));
                channel[k] = value;
            }
        }
        mended
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// Whether the log has no samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }
}

/// The signals that a log of the model must have.
pub(super) fn signals(model: &dyn Model<f64>) -> Vec<Signal> {
    let dims = model.dims();
    let signal = |label: Label<'_>| Signal { name: label.name.into(), unit: label.unit.map(String::from) };
    (0..moving(model))
        .map(|c| signal(model.coordinate(c)))
        .chain((0..dims.inputs).map(|i| signal(model.input(i))))
        .collect()
}

/// Refuses a model with a coordinate that no sensor measures, or with an input beside the motion or in a function: even samples do not tell
/// what such an input does between them. A static map has nothing between its samples.
pub(super) fn all_measured(model: &dyn Model<f64>, path: &str) -> Result<(), LogError> {
    let moves = (0..model.dims().coordinates).any(|c| model.coordinate_order(c) > 0);
    if model.needs_inputs() && moves {
        return Err(LogError::InputInside { path: path.into() });
    }
    match (0..model.dims().coordinates).find(|&c| !model.is_measured(c)) {
        Some(c) => Err(LogError::Unmeasured { path: path.into(), coordinate: model.coordinate(c).name.into() }),
        None => Ok(()),
    }
}

/// The rates of the model's coordinates, which a log may have.
pub(super) fn rate_signals(model: &dyn Model<f64>) -> Vec<Signal> {
    let rate = |c: usize| Signal {
        name: rate_column(model, c),
        unit: model.coordinate(c).unit.map(|unit| format!("{unit}/s")),
    };
    (0..moving(model)).map(rate).collect()
}

/// The coordinates of a model whose rates a log has and whose positions it has not.
///
/// # Errors
/// [`LogError`] when the file cannot be read, or a column is ambiguous.
pub fn rates_alone<'a>(
    source: impl Into<LogSource<'a>>,
    model: &dyn Model<f64>,
    options: &ReadingSettings,
) -> Result<Vec<usize>, LogError> {
    let source: LogSource<'_> = source.into();
    let path = source.name();
    let mut columns = source.columns()?;
    let columns = Computed::of(&mut *columns, &path, options)?;
    let names = Names::of(&columns, &path, options);
    let mut alone = Vec::new();
    for (coordinate, (position, rate)) in signals(model).iter().zip(&rate_signals(model)).enumerate() {
        if names.has_rate_alone(position, rate)? {
            alone.push(coordinate);
        }
    }
    Ok(alone)
}

/// The accelerations of the model's coordinates that are mapped to a column, with their coordinates.
pub(super) fn acceleration_signals(model: &dyn Model<f64>, options: &ReadingSettings) -> Vec<(usize, Signal)> {
    let acceleration = |c: usize| {
        let name = acceleration_column(model, c);
        let unit = model.coordinate(c).unit.map(|unit| format!("{unit}/s^2"));
        options.map.contains_key(&name).then_some((c, Signal { name, unit }))
    };
    (0..moving(model)).filter_map(acceleration).collect()
}

/// The record of columns in which nothing is missing and whose stamps are even.
fn whole(
    columns: &mut dyn Columns,
    name: &str,
    signals: &[Signal],
    rates: &[Signal],
    options: &ReadingSettings,
) -> Result<(Log, Vec<Assumption>), LogError> {
    let mut table = Table::read(columns, name, signals, rates, options)?;
    if let Some(missing) = table.missing().or_else(|| table.missing_rate()) {
        return Err(missing);
    }
    let last_line = table.lines.last().copied().unwrap_or(table.header_line);
    if table.time.len() < LEAST_SAMPLES {
        return Err(LogError::TooShort {
            path: name.into(),
            line: last_line,
            samples: table.time.len(),
            needed: LEAST_SAMPLES,
        });
    }
    let sample_time = table.stamps().even_step().map_err(|uneven| jitter(&table, uneven))? * table.factor;
    if let Some(constant) = table.constant(signals) {
        return Err(constant);
    }
    let assumptions = std::mem::take(&mut table.assumptions);
    let channels = table.channels.into_iter().map(|channel| channel.values).collect();
    let rates = table.rates.into_iter().map(|rate| rate.map(|rate| rate.values)).collect();
    Ok((Log { sample_time, ..Log::unchecked(name, channels, tidy(rates), table.lines) }, assumptions))
}

/// Rates by coordinate; an empty list where there is none.
pub(super) fn tidy(rates: Rates) -> Rates {
    if rates.iter().all(Option::is_none) { Rates::new() } else { rates }
}

/// The fault of stamps that are not even.
pub(super) fn jitter(table: &Table, uneven: Uneven) -> LogError {
    let path = table.path.clone();
    match uneven {
        Uneven::Step { sample, step, expected } => LogError::Jitter {
            path,
            line: table.lines[sample],
            step: step * table.factor,
            expected: expected * table.factor,
        },
        Uneven::Drift { sample, deviation, expected } => LogError::Drift {
            path,
            line: table.lines[sample],
            deviation: deviation * table.factor,
            expected: expected * table.factor,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::{Log, LogError, ReadingSettings};
    use tpm_report::Remedy;
    use tpm_test_support::models::MassSpringDrag;

    fn text(edit: impl Fn(usize) -> String) -> String {
        let mut all = String::from("t_s,x,u\n");
        for i in 0..40 {
            all += &edit(i);
        }
        all
    }

    fn good(i: usize) -> String {
        format!("{:.3},{},{}\n", i as f64 * 1e-3, (i as f64).sin(), i)
    }

    fn read(csv: &str, options: &ReadingSettings) -> Result<Log, LogError> {
        Log::read(csv.as_bytes(), "run.csv", &MassSpringDrag, options)
    }

    fn fault(csv: &str) -> String {
        format!("{}", read(csv, &ReadingSettings::default()).expect_err("the log is faulty"))
    }

    fn with(line: usize, replacement: &str) -> String {
        text(|i| if i == line { replacement.into() } else { good(i) })
    }

    #[test]
    fn reads_maps_and_scales() {
        let csv = text(good).replace("t_s,x,u", "time,pos,u");
        let mut options = ReadingSettings::default();
        options.map.insert("t_s".into(), "time".into());
        options.map.insert("x".into(), "pos".into());
        options.scale.insert("u".into(), 2.0);
        options.offset.insert("u".into(), -1.0);
        let log = read(&csv, &options).expect("sound");
        assert!((log.sample_time - 1e-3).abs() < 1e-15);
        assert_eq!(log.channels[1][..3], [-1.0, 1.0, 3.0]);
        assert_eq!(log.lines[0], 2);
        options.scale.insert("v".into(), 2.0);
        let message = format!("{}", read(&csv, &options).expect_err("unknown name"));
        assert!(message.contains("scale of `v`"), "{message}");
    }

    #[test]
    fn faults_name_their_line() {
        assert!(fault(&with(5, "0.005,nan,1\n")).starts_with("run.csv:7: column `x` holds `nan`"));
        assert!(fault(&with(5, "0.005,1e999,1\n")).starts_with("run.csv:7: column `x`"));
        assert!(fault(&with(5, "0.005,,1\n")).starts_with("run.csv:7: column `x` is empty"));
        assert!(fault(&with(5, "0.005,1,1,1\n")).starts_with("run.csv:7: 4 fields, the header has 3"));
        let message = fault(&with(5, "0.0052,1,1\n"));
        assert!(message.starts_with("run.csv:7: time advances by") && message.contains("20.0"), "{message}");
        // A dropped sample; then one that was written twice. A stamp that was not read again lies between its neighbours.
        assert!(fault(&with(5, "")).starts_with("run.csv:7: time advances by"));
        assert!(fault(&with(5, "0.004,1,1\n0.005,1,1\n")).starts_with("run.csv:7: time advances by"));
        let log = read(&with(5, "0.004,1,1\n"), &ReadingSettings::default()).expect("the next stamp makes up for it");
        assert!((log.sample_time - 1e-3).abs() < 1e-12 && log.len() == 40, "{}", log.sample_time);
        let error =
            read(&text(good).replace("t_s,x,u", "t_s,y,u"), &ReadingSettings::default()).expect_err("no such column");
        assert!(format!("{error}").contains("no column `x`"), "{error}");
        assert_eq!(error.remedy(), Some(Remedy::Columns { columns: vec![("x".into(), "y".into())], timeless: false }));
        assert!(fault("t_s,x,u\n0,1,2\n").starts_with("run.csv:2: the log ends after 1 samples"));
        assert!(fault("").contains("no column is recognised as the time"));
        let message = fault(&text(|i| format!("{:.3},0.5,{i}\n", i as f64 * 1e-3)));
        assert!(message.starts_with("run.csv:2-41: column `x` is 0.5 throughout"), "{message}");
        let message = fault(&text(|i| format!("{:.6},{i},{i}\n", i as f64 * 1e-3 * (1.0 + 1e-3 * i as f64))));
        assert!(message.contains("run.csv:"), "{message}");
        let raw = Log::read(&b"t_s,x,u\n0,\xff,1\n"[..], "run.csv", &MassSpringDrag, &ReadingSettings::default());
        assert!(format!("{}", raw.expect_err("not UTF-8")).contains("not UTF-8"));
    }

    #[test]
    fn few_printed_digits_are_not_jitter() {
        let csv = text(|i| format!("{:.4},{},{i}\n", i as f64 * 0.0016384, (i as f64).sin()));
        let log = read(&csv, &ReadingSettings::default()).expect("rounding only");
        assert!((log.sample_time - 0.0016384).abs() < 2e-6);
    }

    #[test]
    fn so_many_digits_in_all_are_not_jitter() {
        // With seven significant digits, stamps beyond a thousand seconds have steps of a millisecond.
        let stamp = |i: usize| {
            let t = 996.0 + i as f64 * 0.002_003;
            let decimals = if t < 1000.0 { 4 } else { 3 };
            format!("{t:.decimals$}").trim_end_matches('0').to_string()
        };
        let all = |stamp: &dyn Fn(usize) -> String| -> String {
            let rows = (0..4000).map(|i| format!("{},{},{i}\n", stamp(i), (i as f64).sin()));
            format!("t_s,x,u\n{}", rows.collect::<String>())
        };
        let log = read(&all(&stamp), &ReadingSettings::default()).expect("rounding only");
        assert!((log.sample_time - 0.002_003).abs() < 1e-6);
        // A row that is missing is no rounding.
        let missing = |i: usize| stamp(if i < 1000 { i } else { i + 1 });
        let error = read(&all(&missing), &ReadingSettings::default()).expect_err("a row is missing");
        assert!(error.to_string().contains("time advances by"), "{error}");
    }
}
