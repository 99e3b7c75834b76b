//! Reading of logs as they were recorded: without a column of time, with dates, with lines of a console between rows.

use crate::format::open_columns;
use crate::names::Signal;
use crate::{Assumption, LogError, ReadingSettings, Recording};

const ROWS: usize = 400;

fn sample(i: usize) -> (f64, f64) {
    let t = 0.002 * i as f64;
    (0.125 * (7.0 * t).sin(), 3.0 * (2.0 * t).cos())
}

fn read(text: &str, options: &ReadingSettings) -> Result<Recording, LogError> {
    let signal = |name: &str, unit: &str| Signal { name: name.into(), unit: Some(unit.into()) };
    let signals = [signal("x", "m"), signal("u", "N")];
    Recording::of_columns(
        &mut *open_columns(text.as_bytes(), "run.csv")?,
        "run.csv",
        (&signals[..1], &signals),
        &[signal("dot(x)", "m/s")],
        options,
    )
}

fn table(head: &str, row: impl Fn(usize, f64, f64) -> String) -> String {
    let rows = (0..ROWS).map(|i| row(i, sample(i).0, sample(i).1) + "\n");
    format!("{head}\n{}", rows.collect::<String>())
}

fn plain(i: usize, x: f64, u: f64) -> String {
    format!("{:.3},{x:.9},{u:.9}", 0.002 * i as f64)
}

/// The segments hold the samples of these rows, 2 ms apart.
fn holds(recording: &Recording, rows: &[(usize, usize)]) {
    assert_eq!(recording.segments.len(), rows.len(), "{:?}", recording.report);
    for (log, &(from, to)) in recording.segments.iter().zip(rows) {
        assert!((log.sample_time - 0.002).abs() < 1e-9, "{}", log.sample_time);
        assert_eq!(log.len(), to - from);
        for (k, i) in (from..to).enumerate() {
            let far = (log.channels[0][k] - sample(i).0).abs().max((log.channels[1][k] - sample(i).1).abs());
            assert!(far < 1e-5, "row {i}: {far}");
        }
    }
}

#[test]
fn a_table_without_time_is_read_with_its_sample_time() {
    let text = table("x,u", |_, x, u| format!("{x:.9},{u:.9}"));
    let stated = ReadingSettings { sample_time: Some(0.002), ..ReadingSettings::default() };
    let recording = read(&text, &stated).expect("a sound table");
    holds(&recording, &[(0, ROWS)]);
    assert!(recording.report.assumptions.contains(&Assumption::SampleTime { seconds: 0.002 }));
    // A row without a reading takes its time too.
    let text = table("x,u", |i, x, u| if i == 150 { format!(",{u:.9}") } else { format!("{x:.9},{u:.9}") });
    let recording = read(&text, &stated).expect("a sound table");
    holds(&recording, &[(0, ROWS)]);
    assert_eq!(recording.report.bridged.map(|bridged| bridged.samples), Some(1));
    // Without it the error names the setting.
    let error = read(&text, &ReadingSettings::default()).expect_err("no time");
    let remedy = tpm_report::Remedy::Columns { columns: Vec::new(), timeless: true };
    assert_eq!(error.remedy(), Some(remedy), "{error}");
    for seconds in [0.0, -0.1, f64::NAN, f64::INFINITY] {
        let options = ReadingSettings { sample_time: Some(seconds), ..ReadingSettings::default() };
        assert!(matches!(read(&text, &options), Err(LogError::SampleTime { .. })), "{seconds}");
    }
    let mut twice = stated;
    twice.map.insert("t_s".into(), "u".into());
    assert!(matches!(read(&text, &twice), Err(LogError::TwoTimes)));
}

#[test]
fn dates_are_time() {
    let options = ReadingSettings::default();
    let stamp = |i: usize| (2 * i / 1_000 + 58, 2 * i % 1_000);
    // Stamps pass a minute and midnight, and a zone with its own midnight stands behind them.
    let date = |i: usize| {
        let (second, ms) = stamp(i + 900);
        let (day, hour, minute, second) = if second < 60 { (28, 23, 59, second) } else { (29, 0, 0, second - 60) };
        format!("2024-02-{day}T{hour:02}:{minute:02}:{second:02}.{ms:03}+02:00")
    };
    let text = table("DateTime,x,u", |i, x, u| format!("{},{x:.9},{u:.9}", date(i)));
    let recording = read(&text, &options).expect("dates");
    holds(&recording, &[(0, ROWS)]);
    assert!(recording.report.assumptions.contains(&Assumption::Dates { column: "DateTime".into() }));
    // The name of the column does not make dates milliseconds.
    let named = text.replace("DateTime", "time_ms").replace('T', " ");
    holds(&read(&named, &options).expect("dates"), &[(0, ROWS)]);
    // Numbers among dates, dates among numbers, and a factor for dates.
    let mixed = table("time,x,u", |i, x, u| if i == 9 { plain(i, x, u) } else { format!("{},{x},{u}", date(i)) });
    assert!(matches!(read(&mixed, &options), Err(LogError::NotANumber { line: 11, .. })));
    let mixed = table("time,x,u", |i, x, u| if i != 9 { plain(i, x, u) } else { format!("{},{x},{u}", date(i)) });
    assert!(matches!(read(&mixed, &options), Err(LogError::NotANumber { line: 11, .. })));
    let mut scaled = ReadingSettings::default();
    scaled.scale.insert("t_s".into(), 1e-3);
    assert!(matches!(read(&text, &scaled), Err(LogError::Dates { .. })));
}

#[test]
fn lines_of_a_console_are_left_out() {
    let options = ReadingSettings::default();
    for between in ["Acceleration: 5.90", "d", "[WARN] overrun, 12 us, axis 3, retried", "a,b,c", "t_s,x,u"] {
        let mut lines: Vec<String> = table("t_s,x,u", plain).lines().map(str::to_owned).collect();
        lines.insert(201, between.to_owned());
        let recording = read(&(lines.join("\n") + "\n"), &options).unwrap_or_else(|error| panic!("{between}: {error}"));
        holds(&recording, &[(0, ROWS)]);
        let said = Assumption::TextBetweenRows { count: 1, first: 202 };
        assert!(recording.report.assumptions.contains(&said), "{between}: {:?}", recording.report);
    }
    // A row with a field too many, one with a letter in a number and the header of another table are no text.
    for (row, fault) in [("0.4,1,2,3", "4 fields"), ("0.4,1o,2", "`1o`"), ("t_s,u,x", "`t_s`")] {
        let mut lines: Vec<String> = table("t_s,x,u", plain).lines().map(str::to_owned).collect();
        lines.insert(201, row.to_owned());
        let error = read(&(lines.join("\n") + "\n"), &options).expect_err(row);
        assert!(error.to_string().contains(fault) && error.to_string().contains(":202:"), "{error}");
    }
}

#[test]
fn whole_numbers_without_a_unit_are_counts() {
    let counts = |i: usize| (1e4 * (0.01 * i as f64).sin()).round();
    let text = table("t_s,x,u", |i, _, u| format!("{},{},{u}", 0.002 * i as f64, counts(i)));
    let error = read(&text, &ReadingSettings::default()).expect_err("counts are no metres");
    assert_eq!(error.remedy(), Some(tpm_report::Remedy::Scale { signal: "x".into() }));
    assert!(error.to_string().contains("column `x` states no unit and has whole numbers alone, from -"), "{error}");
    let mut options = ReadingSettings::default();
    options.scale.insert("x".into(), 1.0);
    assert_eq!(read(&text, &options).expect("stated").segments[0].channels[0][5], counts(5));
    // A rate in a unit says what a count is.
    let rated = table("t_s,x,u,dot(x) [mm/s]", |i, _, u| {
        format!("{},{},{u},{}", 0.002 * i as f64, counts(i), 5e4 * (0.01 * i as f64).cos())
    });
    let recording = read(&rated, &ReadingSettings::default()).expect("counts");
    let said = recording.report.remarks().join("; ");
    assert!(said.contains("taken as counts of 0.001"), "{said}");
    assert!((recording.segments[0].channels[0][90] - 1e-3 * counts(90)).abs() < 1e-2);
}

#[test]
fn a_first_column_of_stamps_is_the_time_of_a_file_without_a_header() {
    let text = table("x,u", |i, x, u| format!("{},{x},{u}", 7.5 + 0.002 * i as f64))
        .split_once('\n')
        .expect("rows")
        .1
        .to_owned();
    let map = [("x", "2"), ("u", "3")].map(|(signal, column)| (signal.into(), column.into()));
    let options = ReadingSettings { map: map.into(), ..ReadingSettings::default() };
    holds(&read(&text, &options).expect("stamps"), &[(0, ROWS)]);
    // One number in the first row is the time from row to row.
    let text = table("x,u,Ts", |i, x, u| format!("{x},{u},{}", if i == 0 { "0.002" } else { "" }));
    holds(&read(&text, &ReadingSettings::default()).expect("a step"), &[(0, ROWS)]);
}

#[test]
fn a_column_of_dates_is_the_time() {
    for (name, day) in [("Date", "2026-04-02 "), ("Messung", "02.04.2026 "), ("Uhr", "")] {
        let text = table(&format!("{name};x;u"), |i, x, u| format!("{day}14:05:{:06.3};{x};{u}", 0.002 * i as f64));
        holds(&read(&text, &ReadingSettings::default()).expect(name), &[(0, ROWS)]);
    }
    let text = table("Datum;Zeit;x;u", |i, x, u| format!("02.04.2026;14:05:{:06.3};{x};{u}", 0.002 * i as f64));
    holds(&read(&text, &ReadingSettings::default()).expect("a date and a time of day"), &[(0, ROWS)]);
    let text = table("time_ms_since_boot,x,u", |i, x, u| format!("{},{x},{u}", 2 * i));
    holds(&read(&text, &ReadingSettings::default()).expect("a unit within the name"), &[(0, ROWS)]);
}

#[test]
fn rows_that_go_on_with_fewer_fields_have_blanks_at_the_end() {
    let text = table("t_s,x,u,slow", |i, x, u| match i {
        0..100 => format!("{},{i}", plain(i, x, u)),
        // A row that lost a field among the others may have lost any.
        300 => format!("{},{x}", 0.002 * i as f64),
        _ => plain(i, x, u),
    });
    let recording = read(&text, &ReadingSettings::default()).expect("sound");
    holds(&recording, &[(0, ROWS)]);
    let said = Assumption::ShortRows { count: ROWS as u64 - 100, first: 102 };
    assert!(recording.report.assumptions.contains(&said), "{:?}", recording.report);
}

#[test]
fn a_last_row_that_lacks_fields_was_cut_off() {
    for end in ["0.4,1.2", "0.4,1.2\n", "0.4,1.2\n\n", "0.4\n# stopped\n"] {
        let recording = read(&(table("t_s,x,u", plain) + end), &ReadingSettings::default()).expect(end);
        holds(&recording, &[(0, ROWS)]);
        let line = ROWS as u64 + 2;
        assert!(
            recording.report.assumptions.contains(&Assumption::CutLine { line }),
            "{end:?}: {:?}",
            recording.report
        );
    }
}

#[test]
fn a_column_without_a_unit_is_said_to_be_in_the_units_of_the_model() {
    let mut options = ReadingSettings::default();
    options.map.insert("x".into(), "weg".into());
    let recording = read(&table("t_s,weg,u", plain), &options).expect("sound");
    let remarks = recording.report.remarks().join("; ");
    assert!(remarks.contains("`x` is column `weg`, which states no unit: taken as m"), "{remarks}");
    options.scale.insert("x".into(), 1.0);
    let remarks = read(&table("t_s,weg,u", plain), &options).expect("sound").report.remarks().join("; ");
    assert!(!remarks.contains("taken as"), "{remarks}");
}

#[test]
fn stamps_that_were_not_read_again_are_spread() {
    // A stamp in whole milliseconds, every ninth of which is that of the row before.
    let late = |i: usize| if i.is_multiple_of(9) && i > 0 { i - 1 } else { i };
    let text = table("time_ms,x,u", |i, x, u| format!("{},{x:.9},{u:.9}", 2 * late(i)));
    let recording = read(&text, &ReadingSettings::default()).expect("sound");
    holds(&recording, &[(0, ROWS)]);
    let remarks = recording.report.remarks().join("; ");
    assert!(remarks.contains("44 time stamps, the first in line 11, repeat the one before"), "{remarks}");
    // A row that was written twice is left out: the next stamp leaves it no time.
    let text = table("time_ms,x,u", |i, x, u| {
        let row = format!("{},{x:.9},{u:.9}", 2 * i);
        if i == 200 { format!("{row}\n{row}") } else { row }
    });
    let recording = read(&text, &ReadingSettings::default()).expect("sound");
    holds(&recording, &[(0, ROWS)]);
    assert_eq!(recording.report.left_out[0].from_line, 203, "{:?}", recording.report);
}

#[test]
fn columns_that_share_no_time_are_named() {
    let text = |shift: f64, first: bool| {
        let rows = |of: bool| {
            let row = move |i: usize| {
                let (x, u) = sample(i);
                let t = 0.002 * i as f64 + if of { 0.0 } else { shift };
                if of == first { format!("{t:.3},{x:.9},\n") } else { format!("{t:.3},,{u:.9}\n") }
            };
            (0..ROWS).map(row).collect::<String>()
        };
        format!("t_s,x,u\n{}{}", rows(true), rows(false))
    };
    for (first, fault) in [(true, "`x` and `u` share no time"), (false, "`u` and `x` share no time")] {
        let error = read(&text(100.0, first), &ReadingSettings::default()).expect_err("apart").to_string();
        assert!(error.contains(fault) && error.contains("ends 0.798 s") && error.contains("after 100 s"), "{error}");
    }
}

#[test]
fn a_wrap_that_is_not_told_from_motion_is_named() {
    use std::f64::consts::{PI, TAU};
    let read = |rate: f64| -> Result<Recording, LogError> {
        let signal = |name: &str, unit: &str| Signal { name: name.into(), unit: Some(unit.into()) };
        let signals = [signal("x", "rad"), signal("u", "N")];
        let angle = |i: usize| (rate * i as f64 + 3.0 * (0.01 * i as f64).sin() + PI).rem_euclid(TAU) - PI;
        let text = table("t_s,x,u", |i, _, u| format!("{:.3},{:.9},{u:.9}", 0.002 * i as f64, angle(i)));
        Recording::of_columns(
            &mut *open_columns(text.as_bytes(), "run.csv")?,
            "run.csv",
            (&signals[..1], &signals),
            &[],
            &ReadingSettings::default(),
        )
    };
    assert_eq!(read(0.5).expect("a wrap").report.wrapped.len(), 1);
    let error = read(2.1).expect_err("too fast").to_string();
    assert!(error.contains("`x` stays within 6.28319") && error.contains("read it more often"), "{error}");
}
