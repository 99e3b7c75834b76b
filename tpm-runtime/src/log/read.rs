//! Reading a logged run.
//!
//! Invariant: a [`Log`] holds evenly sampled, finite signals of equal lengths, in the model's units and order; each sample
//! knows its line in the file.

use crate::estimate::{Frozen, Weights};
use crate::log::error::{Adjustment, LogError};
use crate::log::lone::lone_readings;
use crate::run::Dynamics;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::{Label, Model};

/// The column of time stamps.
const TIME: &str = "t_s";
/// Largest deviation of a time step from the sample time, as a share of the sample time.
const JITTER: f64 = 0.01;
/// Largest deviation of a time stamp from the even grid, as a share of the sample time.
const DRIFT: f64 = 0.5;
/// Fewest samples of a log.
const LEAST: usize = 16;

/// Settings that a user may give for a log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogOptions {
    /// Column of a coordinate or input (or of `t_s`) whose column has another name.
    pub map: BTreeMap<String, String>,
    /// Factor on a column.
    pub scale: BTreeMap<String, f64>,
    /// Offset that is added after the factor, in the model's unit: `signal = scale * column + offset`.
    pub offset: BTreeMap<String, f64>,
    /// First sample to use (from 0); found when not given.
    pub from_sample: Option<usize>,
    /// Period in seconds; found when not given.
    pub period: Option<f64>,
    /// What happens to the inputs between samples.
    pub hold: Hold,
    /// Known dynamics between the recorded inputs and the forces, by input; inputs past the end of the list have none.
    pub actuators: Vec<Dynamics>,
    /// Whether harmonics or the time domain; harmonics of a log that repeats, when not given.
    pub domain: Option<Domain>,
    /// Highest harmonic; chosen from the spectrum when not given.
    pub harmonics: Option<usize>,
    /// Weights of the equations.
    pub weights: Weights,
    /// Whether the estimates are refined by simulating the model.
    pub refine: Refine,
    /// Values of the model's run-time constants, in its order.
    pub constants: Vec<f64>,
    /// Prior values of the parameters, in the model's order, nothing where none is stated; may be empty.
    pub prior: Vec<Option<f64>>,
    /// Parameters that are held at a value.
    pub frozen: Vec<Frozen>,
}

/// In which form the samples of a log become equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Domain {
    /// By the harmonics of the part that repeats.
    Harmonics,
    /// Sample by sample behind a low pass.
    Time,
}

/// Whether estimates are refined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Refine {
    /// By output error, where the model can be simulated.
    #[default]
    OutputError,
    /// Not at all.
    None,
}

/// Measured rates by coordinate; nothing for a coordinate whose rate is not measured.
pub type Rates = Vec<Option<Vec<f64>>>;

/// Name of the column of a coordinate's measured rate, written as in models: `dot(x)`.
pub(crate) fn rate_column(model: &dyn Model<f64>, coordinate: usize) -> String {
    std::format!("dot({})", model.coordinate(coordinate).name)
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
    /// Line in the file of every sample (from 1).
    pub lines: Vec<u64>,
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
        if samples < LEAST {
            return Err(LogError::TooShort { path: name.into(), line: samples as u64, samples, needed: LEAST });
        }
        Ok(Log { path: name.into(), sample_time, channels, lines: (1..=samples as u64).collect() })
    }

    /// Reads a CSV file with one header line.
    ///
    /// # Errors
    /// [`LogError`] with the line when the file cannot be read, a column is missing, a value is not finite or time is
    /// not even.
    pub fn open(path: &Path, model: &dyn Model<f64>, options: &LogOptions) -> Result<Self, LogError> {
        Self::open_signals(path, &signals(model), options)
    }

    /// Reads CSV text with one header line; messages call it `name`.
    ///
    /// # Errors
    /// [`LogError`] with the line when the text cannot be read, a column is missing, a value is not finite or time is
    /// not even.
    pub fn read(input: impl Read, name: &str, model: &dyn Model<f64>, options: &LogOptions) -> Result<Self, LogError> {
        Ok(Self::read_some(input, name, &signals(model), &[], options)?.0)
    }

    /// Reads a CSV file with one header line, together with the measured rates of coordinates: columns called `dot(x)`,
    /// or mapped to that name. A coordinate without such a column has no rate; the list is empty when no coordinate has
    /// one.
    ///
    /// # Errors
    /// [`LogError`] with the line when the file cannot be read, a column is missing, a value is not finite or time is
    /// not even.
    pub fn open_rated(path: &Path, model: &dyn Model<f64>, options: &LogOptions) -> Result<(Self, Rates), LogError> {
        let own = signals(model);
        let rates: Vec<String> = (0..model.dims().coordinates).map(|c| rate_column(model, c)).collect();
        let (mut log, found) = Self::open_some(path, &own, &rates, options)?;
        let mut measured = log.channels.split_off(own.len()).into_iter();
        if measured.len() == 0 {
            return Ok((log, Vec::new()));
        }
        Ok((log, found.into_iter().map(|found| if found { measured.next() } else { None }).collect()))
    }

    /// Reads the named signals of a CSV file with one header line, in this order, without a model.
    ///
    /// # Errors
    /// [`LogError`] with the line when the file cannot be read, a column is missing, a value is not finite or time is
    /// not even.
    pub fn open_signals(path: &Path, signals: &[String], options: &LogOptions) -> Result<Self, LogError> {
        Ok(Self::open_some(path, signals, &[], options)?.0)
    }

    fn open_some(
        path: &Path,
        signals: &[String],
        optional: &[String],
        options: &LogOptions,
    ) -> Result<(Self, Vec<bool>), LogError> {
        let name = path.display().to_string();
        let file = std::fs::File::open(path).map_err(|source| LogError::Io { path: name.clone(), source })?;
        Self::read_some(std::io::BufReader::new(file), &name, signals, optional, options)
    }

    /// Reads the signals and, behind them, those optional signals that have a column or are mapped to one. Also returns
    /// which optional signals were found.
    fn read_some(
        input: impl Read,
        name: &str,
        signals: &[String],
        optional: &[String],
        options: &LogOptions,
    ) -> Result<(Self, Vec<bool>), LogError> {
        check_names(&[signals, optional].concat(), options)?;
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::Headers).from_reader(input);
        let header = reader.headers().map_err(|error| of_csv(error, name))?.clone();
        let find = |signal: &str| -> Result<(usize, String), LogError> {
            let column = options.map.get(signal).map_or(signal, String::as_str);
            let mut places = header.iter().enumerate().filter(|(_, h)| *h == column);
            match (places.next(), places.next()) {
                (Some((at, _)), None) => Ok((at, column.into())),
                (Some(_), Some(_)) => Err(LogError::DuplicateColumn { path: name.into(), column: column.into() }),
                (None, _) => Err(LogError::MissingColumn {
                    path: name.into(),
                    name: signal.into(),
                    column: column.into(),
                    available: header.iter().map(String::from).collect(),
                }),
            }
        };
        let time_at = find(TIME)?;
        let has = |signal: &String| options.map.contains_key(signal) || header.iter().any(|h| h == signal);
        let found: Vec<bool> = optional.iter().map(has).collect();
        let present = optional.iter().zip(&found).filter_map(|(signal, found)| found.then_some(signal));
        let signals: Vec<&String> = signals.iter().chain(present).collect();
        let places: Vec<(usize, String)> = signals.iter().map(|s| find(s)).collect::<Result<_, _>>()?;
        let mut time = Vec::new();
        // Stamps may be printed without trailing zeros, or with so many digits in all, so that the finest digit among those of the
        // same size is the one to which they are rounded.
        let mut resolution: BTreeMap<i32, f64> = BTreeMap::new();
        let mut channels: Vec<Vec<f64>> = vec![Vec::new(); signals.len()];
        let mut lines = Vec::new();
        let conversions: Vec<(f64, f64)> = signals
            .iter()
            .map(|&signal| {
                (options.scale.get(signal).copied().unwrap_or(1.0), options.offset.get(signal).copied().unwrap_or(0.0))
            })
            .collect();
        let mut record = csv::StringRecord::new();
        while reader.read_record(&mut record).map_err(|error| of_csv(error, name))? {
            let line = record.position().map_or(0, csv::Position::line);
            let field = |at: usize| record.get(at).unwrap_or("").trim();
            let number = |(at, column): &(usize, String)| -> Result<f64, LogError> {
                let text = field(*at);
                if text.is_empty() {
                    return Err(LogError::Empty { path: name.into(), line, column: column.clone() });
                }
                match text.parse::<f64>() {
                    Ok(value) if value.is_finite() => Ok(value),
                    _ => {
                        Err(LogError::NotANumber { path: name.into(), line, column: column.clone(), text: text.into() })
                    }
                }
            };
            let stamp = number(&time_at)?;
            time.push(stamp);
            let finest = resolution.entry(decade(stamp)).or_insert(f64::INFINITY);
            *finest = finest.min(last_digit(field(time_at.0)));
            for ((channel, place), (scale, offset)) in channels.iter_mut().zip(&places).zip(&conversions) {
                channel.push(scale * number(place)? + offset);
            }
            lines.push(line);
        }
        let last_line = lines.last().copied().unwrap_or(1);
        if time.len() < LEAST {
            return Err(LogError::TooShort { path: name.into(), line: last_line, samples: time.len(), needed: LEAST });
        }
        let sample_time = even_time(&time, &resolution, &lines, name)?;
        for ((channel, (_, column)), signal) in channels.iter().zip(&places).zip(&signals) {
            let first = channel[0];
            if channel.iter().all(|x| *x == first) {
                return Err(LogError::Constant {
                    path: name.into(),
                    from: lines[0],
                    to: last_line,
                    signal: (*signal).clone(),
                    column: column.clone(),
                    value: first,
                });
            }
        }
        Ok((Log { path: name.into(), sample_time, channels, lines }, found))
    }

    /// Replaces readings of the first `coordinates` channels that stand alone, far from what their neighbours say, by what these say.
    /// Returns them: channel, sample, and by how much each was changed.
    pub(crate) fn mend(&mut self, coordinates: usize) -> Vec<(usize, usize, f64)> {
        let mut mended = Vec::new();
        for (c, channel) in self.channels.iter_mut().take(coordinates).enumerate() {
            for (k, value) in lone_readings(channel) {
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

/// Names of the signals that a log of the model must have.
fn signals(model: &dyn Model<f64>) -> Vec<String> {
    let dims = model.dims();
    let name = |label: Label<'_>| label.name.to_string();
    (0..dims.coordinates)
        .map(|c| name(model.coordinate(c)))
        .chain((0..dims.inputs).map(|i| name(model.input(i))))
        .collect()
}

fn check_names(signals: &[String], options: &LogOptions) -> Result<(), LogError> {
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
            if !signals.contains(name) {
                return Err(unknown(adjustment, name));
            }
            if !value.is_finite() || (adjustment == Adjustment::Scale && value == 0.0) {
                return Err(LogError::Unusable { adjustment, name: name.clone(), value });
            }
        }
    }
    Ok(())
}

fn of_csv(error: csv::Error, name: &str) -> LogError {
    let line = error.position().map_or(1, csv::Position::line);
    let message = error.to_string();
    match error.into_kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            LogError::FieldCount { path: name.into(), line, found: len, expected: expected_len }
        }
        csv::ErrorKind::Io(source) => LogError::Io { path: name.into(), source },
        csv::ErrorKind::Utf8 { .. } => LogError::Csv {
            path: name.into(),
            line,
            message: "the text is not UTF-8; save the log as UTF-8 text".into(),
        },
        _ => LogError::Csv { path: name.into(), line, message },
    }
}

/// Value of one unit in the last printed digit of a decimal number.
fn last_digit(text: &str) -> f64 {
    let (mantissa, exponent) = match text.find(['e', 'E']) {
        Some(at) => (&text[..at], text[at + 1..].parse::<i32>().unwrap_or(0)),
        None => (text, 0),
    };
    let decimals = mantissa.find('.').map_or(0, |at| (mantissa.len() - at - 1) as i32);
    10.0_f64.powi(exponent - decimals)
}

/// The power of ten below a number; the least one for zero.
fn decade(value: f64) -> i32 {
    if value.abs() > 0.0 { value.abs().log10().floor() as i32 } else { i32::MIN }
}

/// The sample time of an even grid. A stamp printed with few digits may be off by one in its last digit; `resolution` has the value of
/// that digit by decade.
fn even_time(time: &[f64], resolution: &BTreeMap<i32, f64>, lines: &[u64], name: &str) -> Result<f64, LogError> {
    let last_digit = |stamp: f64| resolution.get(&decade(stamp)).copied().unwrap_or(0.0);
    let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let typical = steps[steps.len() / 2];
    for (i, pair) in time.windows(2).enumerate() {
        let step = pair[1] - pair[0];
        let off = (step - typical).abs();
        let rounding = || last_digit(pair[0]).max(last_digit(pair[1])).min(0.5 * typical.abs());
        if step <= 0.0 || off > JITTER * typical.abs() && off > 1.01 * rounding() {
            return Err(LogError::Jitter { path: name.into(), line: lines[i + 1], step, expected: typical });
        }
    }
    let sample_time = (time[time.len() - 1] - time[0]) / (time.len() - 1) as f64;
    for (i, t) in time.iter().enumerate() {
        let deviation = t - time[0] - i as f64 * sample_time;
        if deviation.abs() > DRIFT * sample_time && deviation.abs() > last_digit(*t) {
            return Err(LogError::Drift { path: name.into(), line: lines[i], deviation, expected: sample_time });
        }
    }
    Ok(sample_time)
}

#[cfg(test)]
mod tests {
    use super::{Log, LogError, LogOptions};
    use crate::report::Remedy;
    use crate::test_models::MassSpringDrag;
    use std::format;
    use std::string::{String, ToString as _};

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

    fn read(csv: &str, options: &LogOptions) -> Result<Log, LogError> {
        Log::read(csv.as_bytes(), "run.csv", &MassSpringDrag, options)
    }

    fn fault(csv: &str) -> String {
        format!("{}", read(csv, &LogOptions::default()).expect_err("the log is faulty"))
    }

    fn with(line: usize, replacement: &str) -> String {
        text(|i| if i == line { replacement.into() } else { good(i) })
    }

    #[test]
    fn reads_maps_and_scales() {
        let csv = text(good).replace("t_s,x,u", "time,pos,u");
        let mut options = LogOptions::default();
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
        assert!(fault(&with(5, "0.005,1\n")).starts_with("run.csv:7: 2 fields, the header has 3"));
        let message = fault(&with(5, "0.0052,1,1\n"));
        assert!(message.starts_with("run.csv:7: time advances by") && message.contains("20.0"), "{message}");
        // A dropped sample; then time that stands still.
        assert!(fault(&with(5, "")).starts_with("run.csv:7: time advances by"));
        assert!(fault(&with(5, "0.004,1,1\n")).starts_with("run.csv:7: time advances by"));
        let error =
            read(&text(good).replace("t_s,x,u", "t_s,y,u"), &LogOptions::default()).expect_err("no such column");
        assert!(format!("{error}").contains("no column `x`"), "{error}");
        assert_eq!(error.remedy(), Some(Remedy::MapColumn { signal: "x".into() }));
        assert!(fault("t_s,x,u\n0,1,2\n").starts_with("run.csv:2: the log ends after 1 samples"));
        assert!(fault("").contains("no column `t_s`"));
        let message = fault(&text(|i| format!("{:.3},0.5,{i}\n", i as f64 * 1e-3)));
        assert!(message.starts_with("run.csv:2-41: column `x` is 0.5 throughout"), "{message}");
        let message = fault(&text(|i| format!("{:.6},{i},{i}\n", i as f64 * 1e-3 * (1.0 + 1e-3 * i as f64))));
        assert!(message.contains("run.csv:"), "{message}");
        let raw = Log::read(&b"t_s,x,u\n0,\xff,1\n"[..], "run.csv", &MassSpringDrag, &LogOptions::default());
        assert!(format!("{}", raw.expect_err("not UTF-8")).contains("not UTF-8"));
    }

    #[test]
    fn few_printed_digits_are_not_jitter() {
        let csv = text(|i| format!("{:.4},{},{i}\n", i as f64 * 0.0016384, (i as f64).sin()));
        let log = read(&csv, &LogOptions::default()).expect("rounding only");
        assert!((log.sample_time - 0.0016384).abs() < 2e-6);
    }

    #[test]
    fn so_many_digits_in_all_are_not_jitter() {
        // Seven digits in all leave steps of a millisecond beyond a thousand seconds.
        let stamp = |i: usize| {
            let t = 996.0 + i as f64 * 0.002_003;
            let decimals = if t < 1000.0 { 4 } else { 3 };
            format!("{t:.decimals$}").trim_end_matches('0').to_string()
        };
        let all = |stamp: &dyn Fn(usize) -> String| -> String {
            let rows = (0..4000).map(|i| format!("{},{},{i}\n", stamp(i), (i as f64).sin()));
            format!("t_s,x,u\n{}", rows.collect::<String>())
        };
        let log = read(&all(&stamp), &LogOptions::default()).expect("rounding only");
        assert!((log.sample_time - 0.002_003).abs() < 1e-6);
        // A row that is missing is no rounding.
        let missing = |i: usize| stamp(if i < 1000 { i } else { i + 1 });
        let error = read(&all(&missing), &LogOptions::default()).expect_err("a row is missing");
        assert!(error.to_string().contains("time advances by"), "{error}");
    }
}
