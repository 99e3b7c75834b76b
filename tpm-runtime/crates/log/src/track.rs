//! Logs that are written: as text in columns, as Parquet, as MCAP.
//!
//! What is written here is read here as the same numbers, but for the stamps of MCAP, which are whole nanoseconds. Times are in seconds;
//! the unit of a signal stands behind its name in brackets, where names are all that a format keeps.

use crate::error::LogError;
use crate::names::{Signal, split_unit};
use crate::options::{ReadingSettings, TIME};
use crate::source::LogSource;
use crate::table::Table;
use std::fmt;
#[cfg(feature = "mcap")]
mod mcap;
#[cfg(feature = "parquet")]
mod parquet;
mod signals;

pub use signals::Track;

/// A format in which tracks are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TrackFormat {
    /// Text in columns with commas between them.
    Csv,
    /// Messages `sensor_msgs/msg/JointState` of ROS 2, one for every stamp of a track: the signals are the joints, their readings the
    /// positions.
    Mcap,
    /// A table of numbers with missing ones.
    Parquet,
}

impl fmt::Display for TrackFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            TrackFormat::Csv => "CSV",
            TrackFormat::Mcap => "MCAP",
            TrackFormat::Parquet => "Parquet",
        })
    }
}

impl Track {
    /// All columns of numbers of a log, row by row as they stand in it, and what is to be said about it: what was assumed, and what is left
    /// out.
    ///
    /// Numbers keep their units, unless a factor is stated, and rows their order. The time is read as for identification, and counted in
    /// seconds from where the file counts it.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be read, its time is not known, or a second column is called `t_s`.
    pub fn of_log<'a>(
        source: impl Into<LogSource<'a>>,
        options: &ReadingSettings,
    ) -> Result<(Self, Vec<String>), LogError> {
        let source: LogSource<'_> = source.into();
        let path = source.name();
        let mut columns = source.columns()?;
        let (table, signals, unread) = Table::read_every(&mut *columns, &path, options)?;
        drop(columns);
        let mut said: Vec<String> = table.assumptions.iter().map(ToString::to_string).collect();
        said.extend(unread.iter().map(|of| format!("`{}` is left out: {}", of.column, of.why)));
        let lost: usize = table.holes.iter().map(|hole| hole.rows).sum();
        if let Some(first) = table.holes.first() {
            said.push(format!("{lost} rows without a time are left out, the first is line {}", first.from_line));
        }
        let names = signals.iter().map(|signal| label(signal, options.scale.contains_key(&signal.name)));
        let signals: Vec<(String, Vec<f64>)> =
            names.zip(table.channels.into_iter().map(|channel| channel.values)).collect();
        if signals.iter().any(|(name, _)| name == TIME) {
            return Err(LogError::Format {
                path,
                what: format!("a column beside the time is called `{TIME}`, as the time is in what would be written"),
                remedy: "call that column otherwise".into(),
            });
        }
        let time = table.time.iter().map(|stamp| seconds(*stamp, table.factor)).collect();
        Ok((Track { name: "log".into(), time, signals }, said))
    }

    /// The bytes of a file with this track alone.
    ///
    /// # Errors
    /// [`LogError`] when this build does not write the format, or a stamp does not fit it.
    pub fn written(&self, format: TrackFormat) -> Result<Vec<u8>, LogError> {
        match format {
            TrackFormat::Csv => Ok(self.csv()),
            TrackFormat::Mcap => Self::recorded(std::slice::from_ref(self)),
            #[cfg(feature = "parquet")]
            TrackFormat::Parquet => parquet::written(self),
            #[cfg(not(feature = "parquet"))]
            TrackFormat::Parquet => Err(without(TrackFormat::Parquet, "parquet")),
        }
    }

    /// The bytes of an MCAP file with tracks as its topics.
    ///
    /// # Errors
    /// [`LogError`] when this build does not write MCAP, or a stamp does not fit it.
    #[cfg(feature = "mcap")]
    pub fn recorded(tracks: &[Track]) -> Result<Vec<u8>, LogError> {
        mcap::written(tracks)
    }

    /// The bytes of an MCAP file with tracks as its topics.
    ///
    /// # Errors
    /// [`LogError`]: this build does not write MCAP.
    #[cfg(not(feature = "mcap"))]
    pub fn recorded(_tracks: &[Track]) -> Result<Vec<u8>, LogError> {
        Err(without(TrackFormat::Mcap, "mcap"))
    }

    /// The track as text; numbers have all digits that tell them from others.
    fn csv(&self) -> Vec<u8> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let head = [TIME].into_iter().chain(self.signals.iter().map(|(name, _)| name.as_str()));
        let whole = "invariant: memory takes what is written, and all rows are as long as the first";
        writer.write_record(head).expect(whole);
        let field = |value: f64| if value.is_nan() { String::new() } else { value.to_string() };
        for (row, stamp) in self.time.iter().enumerate() {
            let readings = self.signals.iter().map(|(_, readings)| field(readings[row]));
            writer.write_record([field(*stamp)].into_iter().chain(readings)).expect(whole);
        }
        writer.into_inner().expect(whole)
    }
}

/// The name of a signal with its unit, such that it is read as this name and this unit again.
fn label(signal: &Signal, is_scaled: bool) -> String {
    let (base, in_name, bracketed) = split_unit(&signal.name);
    // A number in a header is taken for a row of numbers.
    let named = |name: &str| if name.parse::<f64>().is_ok() { format!("column {name}") } else { name.to_owned() };
    match signal.unit.as_deref() {
        Some(unit) if in_name == Some(unit) => named(&signal.name),
        Some(unit) => format!("{} [{unit}]", named(&signal.name)),
        // The name states the unit that the numbers had before they were scaled.
        None if is_scaled && bracketed => named(base),
        None => named(&signal.name),
    }
}

/// A stamp in seconds, rounded once where the unit is a whole part of a second.
fn seconds(stamp: f64, factor: f64) -> f64 {
    let parts = (1.0 / factor).round();
    if 1.0 / parts == factor { stamp / parts } else { stamp * factor }
}

/// The fault of a format that this build does not write.
#[cfg(not(all(feature = "mcap", feature = "parquet")))]
fn without(format: TrackFormat, feature: &str) -> LogError {
    LogError::Format {
        path: format!("the {format} file"),
        what: format!("{format} is written with the feature `{feature}` only"),
        remedy: format!("build with it (`cargo build --release -p tpm-cli --features {feature}`), or write CSV"),
    }
}

#[cfg(test)]
mod tests {
    use super::{Track, TrackFormat};
    use crate::{InMemory, LogSource, ReadingSettings, Samples};
    use std::path::Path;
    use std::sync::Arc;

    /// A log with what a file may hold: units beside the names, a text, blanks, a quote, milliseconds.
    const TEXT: &str =
        "time,q,\"u, left\",mode,f_N\nms,deg,V,,\n1,0.1,-3,idle,1e-3\n2,,0.30000000000000004,idle,2\n4,-7.25,5,run,\n";

    fn written(format: TrackFormat) -> (Track, Vec<String>, Vec<u8>) {
        let held = InMemory::Bytes(Arc::new(TEXT.as_bytes().to_vec()));
        let source = LogSource::Memory(Path::new("run.csv"), &held);
        let (track, said) = Track::of_log(source, &ReadingSettings::default()).expect("sound");
        let bytes = track.written(format).expect("this build writes it");
        (track, said, bytes)
    }

    /// The track of a file.
    fn read(bytes: Vec<u8>) -> Track {
        let held = InMemory::Bytes(Arc::new(bytes));
        let source = LogSource::Memory(Path::new("out"), &held);
        Track::of_log(source, &ReadingSettings::default()).expect("readable").0
    }

    /// Missing readings alike.
    fn bits(values: &[f64]) -> Vec<Option<u64>> {
        values.iter().map(|value| (!value.is_nan()).then(|| value.to_bits())).collect()
    }

    #[test]
    fn a_log_is_kept_to_the_last_digit() {
        let (track, said, bytes) = written(TrackFormat::Csv);
        assert_eq!(
            String::from_utf8(bytes.clone()).expect("text"),
            "t_s,q [deg],\"u, left [V]\",f_N\n0.001,0.1,-3,0.001\n0.002,,0.30000000000000004,2\n0.004,-7.25,5,\n"
        );
        assert!(said.iter().any(|of| of == "`mode` is left out: `idle` in line 3 is no number"), "{said:?}");
        let again = read(bytes);
        assert_eq!(bits(&again.time), bits(&track.time));
        for ((name, values), (other, own)) in again.signals.iter().zip(&track.signals) {
            assert_eq!((name, bits(values)), (other, bits(own)));
        }
    }

    #[cfg(feature = "parquet")]
    #[test]
    fn parquet_keeps_it_too() {
        let (track, _, bytes) = written(TrackFormat::Parquet);
        let again = read(bytes);
        assert_eq!(bits(&again.time), bits(&track.time));
        assert_eq!(again.signals.len(), 3);
        for ((name, values), (other, own)) in again.signals.iter().zip(&track.signals) {
            assert_eq!((name, bits(values)), (other, bits(own)));
        }
    }

    #[cfg(feature = "mcap")]
    #[test]
    fn mcap_keeps_it_too() {
        let (track, _, bytes) = written(TrackFormat::Mcap);
        let again = read(bytes);
        assert!(again.time.iter().zip(&track.time).all(|(own, other)| (own - other).abs() < 1e-12), "{:?}", again.time);
        for (name, values) in &track.signals {
            let own = again.signals.iter().find(|(own, _)| *own == format!("position.{name}"));
            assert_eq!(bits(&own.unwrap_or_else(|| panic!("{name}: {:?}", again.signals)).1), bits(values));
        }
        // Stamps that a message cannot hold.
        let late = Track { name: "late".into(), time: vec![1e12], signals: Vec::new() };
        let message = late.written(TrackFormat::Mcap).expect_err("too late").to_string();
        assert!(message.contains("1000000000000 s"), "{message}");
    }

    #[test]
    fn names_are_read_again() {
        let samples = |names: [&str; 3]| {
            let columns = names.map(|name| (name.to_owned(), (0..20).map(|k| f64::from(k) * 0.5).collect()));
            InMemory::Samples(Samples::new(columns.into()))
        };
        let of = |names: [&str; 3], options: &ReadingSettings| {
            Track::of_log(LogSource::Memory(Path::new("arrays"), &samples(names)), options)
        };
        let mut options = ReadingSettings::default();
        let (track, _) = of(["t_s", "2", "x [mm]"], &options).expect("sound");
        assert_eq!(track.signals.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["column 2", "x [mm]"]);
        // A factor leads away from the unit of the name.
        options.scale.insert("x [mm]".into(), 0.5);
        let (track, _) = of(["t_s", "2", "x [mm]"], &options).expect("sound");
        assert_eq!((track.signals[1].0.as_str(), track.signals[1].1[2]), ("x", 0.5));
        // Two times.
        let mut options = ReadingSettings::default();
        options.map.insert("t_s".into(), "clock_s".into());
        let message = of(["t_s", "clock_s", "x"], &options).expect_err("two times").to_string();
        assert!(message.contains("is called `t_s`"), "{message}");
    }
}
