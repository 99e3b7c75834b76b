//! Reading of tables of text.

use crate::format::open_columns;
use crate::names::Signal;
use crate::{Assumption, Log, LogError, ReadingSettings, Recording, Separator};

/// Time, position and force of the samples that every dialect here writes: `t_s`, `x` in m, `u` in N.
fn sample(i: usize) -> [f64; 3] {
    let t = 0.002 * i as f64;
    [t, 0.125 * (7.0 * t).sin(), 3.0 * (2.0 * t).cos()]
}

/// A way to write the samples.
struct Style<'a> {
    /// The text above the numbers.
    head: &'a str,
    separator: &'a str,
    decimal: &'a str,
    end: &'a str,
    /// Factors from the samples to the numbers that are written.
    factors: [f64; 3],
}

const PLAIN: Style<'_> = Style { head: "t_s,x,u\n", separator: ",", decimal: ".", end: "\n", factors: [1.0, 1.0, 1.0] };

impl Style<'_> {
    fn row(&self, i: usize) -> String {
        let values = sample(i);
        let fields: Vec<String> =
            (0..3).map(|k| format!("{:.12}", values[k] * self.factors[k]).replace('.', self.decimal)).collect();
        format!("{}{}", fields.join(self.separator), self.end)
    }

    fn text(&self, rows: usize) -> String {
        self.head.to_owned() + &(0..rows).map(|i| self.row(i)).collect::<String>()
    }
}

fn read(text: &[u8], options: &ReadingSettings) -> Result<Recording, LogError> {
    let signal = |name: &str, unit: &str| Signal { name: name.into(), unit: Some(unit.into()) };
    let signals = [signal("x", "m"), signal("u", "N")];
    Recording::of_columns(
        &mut *open_columns(text, "run.csv")?,
        "run.csv",
        (&signals[..1], &signals),
        &[signal("dot(x)", "m/s")],
        options,
    )
}

fn mapped(map: &[(&str, &str)]) -> ReadingSettings {
    ReadingSettings { map: map.iter().map(|(a, b)| ((*a).into(), (*b).into())).collect(), ..ReadingSettings::default() }
}

/// The text holds the samples, in one segment.
fn holds_samples(text: &[u8], options: &ReadingSettings) -> Recording {
    let shown = String::from_utf8_lossy(&text[..text.len().min(120)]).into_owned();
    let recording = read(text, options).unwrap_or_else(|error| panic!("{shown}: {error}"));
    let [log] = &recording.segments[..] else { panic!("{shown}: {:?}", recording.report) };
    assert!((log.sample_time - 0.002).abs() < 1e-9, "{shown}: {}", log.sample_time);
    for k in 0..log.len() {
        let [_, x, u] = sample(k);
        let [own, force] = [log.channels[0][k], log.channels[1][k]];
        assert!((own - x).abs() < 1e-8 && (force - u).abs() < 1e-8, "{shown}, sample {k}: {own} {x}, {force} {u}");
    }
    recording
}

/// The remarks that a text with these options gives.
fn remarks(text: &[u8], options: &ReadingSettings) -> Vec<String> {
    holds_samples(text, options).report.remarks()
}

#[test]
fn plain_logs_have_nothing_to_remark() {
    let recording = holds_samples(PLAIN.text(40).as_bytes(), &ReadingSettings::default());
    assert!(recording.report.is_plain(), "{:?}", recording.report);
    assert_eq!((recording.report.rows, recording.segments[0].lines[39]), (40, 41));
    let quoted = Style { head: "\"t_s\",\"x\",\"u\"\r\n", end: "\r\n", ..PLAIN }.text(40);
    assert!(holds_samples(quoted.as_bytes(), &ReadingSettings::default()).report.is_plain());
    let marked = ["\u{feff}", &PLAIN.text(40)].concat();
    assert!(holds_samples(marked.as_bytes(), &ReadingSettings::default()).report.is_plain());
    let returns = PLAIN.text(40).replace('\n', "\r");
    assert!(holds_samples(returns.as_bytes(), &ReadingSettings::default()).report.is_plain());
}

#[test]
fn dialects_hold_the_samples_and_say_what_was_assumed() {
    let all = ReadingSettings::default;
    let cases: Vec<(Style<'_>, ReadingSettings, Vec<&str>)> = vec![
        (Style { head: "t_s;x;u\n", separator: ";", ..PLAIN }, all(), vec!["separated by semicolons"]),
        (
            Style { head: "t_s;x;u\n", separator: ";", decimal: ",", ..PLAIN },
            all(),
            vec!["separated by semicolons", "decimal commas"],
        ),
        (Style { head: "t_s\tx\tu\n", separator: "\t", ..PLAIN }, all(), vec!["separated by tabulators"]),
        (Style { head: "t_s   x   u\n", separator: "   ", ..PLAIN }, all(), vec!["separated by blanks"]),
        (
            Style { head: "t_s x [mm] u\n", separator: " ", factors: [1.0, 1e3, 1.0], ..PLAIN },
            all(),
            vec!["separated by blanks", "`x` is column `x [mm]`, converted from mm to m: times 0.001"],
        ),
        (Style { head: "t_s, x, u\n", separator: ", ", ..PLAIN }, all(), vec![]),
        (Style { head: "t_s,x,u,\n", end: ",\n", ..PLAIN }, all(), vec![]),
        (Style { head: "t_s,x,u\n", end: ",\n", ..PLAIN }, all(), vec![]),
        (Style { head: "# rig 7\n% second\n//third\nt_s,x,u\n", ..PLAIN }, all(), vec!["3 lines are comments"]),
        (Style { head: "# t_s,x,u\n", ..PLAIN }, all(), vec!["the comment in line 1 names the columns"]),
        (Style { head: "Rig 7\n\nt_s,x,u\n", ..PLAIN }, all(), vec!["the header is line 3"]),
        (
            Style { head: "t_s,x,u\nms,mm,kN\n", factors: [1e3, 1e3, 1e-3], ..PLAIN },
            all(),
            vec!["line 2 has the units", "`t_s` in ms", "converted from mm to m", "converted from kN to N"],
        ),
        (
            Style { head: "time [ms],x (mm),u_mN\n", factors: [1e3, 1e3, 1e3], ..PLAIN },
            all(),
            vec!["time is column `time [ms]` in ms", "`x (mm)`, converted", "`u_mN`, converted from mN to N"],
        ),
        (
            Style { head: "t_us,x_cm,force\n", factors: [1e6, 1e2, 1.0], ..PLAIN },
            mapped(&[("u", "force")]),
            vec!["time is column `t_us` in us", "converted from cm to m"],
        ),
        // Columns that are called as their units, but for single letters.
        (
            Style { head: "t_s,mm,kN\n", factors: [1.0, 1e3, 1e-3], ..PLAIN },
            mapped(&[("x", "mm"), ("u", "kN")]),
            vec!["`x` is column `mm`, converted from mm to m", "`u` is column `kN`, converted from kN to N"],
        ),
        (Style { head: "timestamp,x,u\n", ..PLAIN }, all(), vec!["states no unit: read as s"]),
        (
            Style { head: "", ..PLAIN },
            mapped(&[("t_s", "1"), ("x", "2"), ("u", "3")]),
            vec!["there is no header", "column `1`, which states no unit: read as s"],
        ),
    ];
    for (style, options, said) in &cases {
        let found = remarks(style.text(60).as_bytes(), options);
        for part in said {
            assert!(found.iter().any(|remark| remark.contains(part)), "{:?}: {part}: {found:?}", style.head);
        }
        assert!(!said.is_empty() || found.is_empty(), "{:?}: {found:?}", style.head);
    }
    let latin = [
        b"t_s;x;u;T [\xb0C]\n".as_slice(),
        &Style { separator: ";", end: ";20\n", head: "", ..PLAIN }.text(40).into_bytes(),
    ];
    assert!(remarks(&latin.concat(), &all()).iter().any(|remark| remark.contains("Latin-1")));
}

#[test]
fn stamps_of_ros_stand_in_two_columns() {
    for (seconds, fractions) in [
        ("header.stamp.sec", "header.stamp.nanosec"),
        ("header.stamp.secs", "header.stamp.nsecs"),
        ("/joint_states/header/stamp/sec", "/joint_states/header/stamp/nanosec"),
        ("header_stamp_secs", "header_stamp_nsecs"),
        ("sec", "nanosec"),
        ("stamp_sec", "stamp_nanosec"),
        ("secs", "nsecs"),
    ] {
        let mut text = format!("{seconds},{fractions},x,u\n");
        for i in 0..1200 {
            let [_, x, u] = sample(i);
            let nanoseconds = 1_700_000_000_999_000_000_u64 + 2_000_000 * i as u64;
            text += &format!("{},{},{x:.9},{u:.9}\n", nanoseconds / 1_000_000_000, nanoseconds % 1_000_000_000);
        }
        let said = remarks(text.as_bytes(), &ReadingSettings::default());
        assert!(said[0].contains("in seconds and nanoseconds"), "{said:?}");
    }
    // One column of nanoseconds, whose unit is inferred from its magnitude.
    let mut text = "stamp,x,u\n".to_owned();
    for i in 0..1200 {
        let [_, x, u] = sample(i);
        text += &format!("{},{x:.9},{u:.9}\n", 1_700_000_000_999_000_000_u64 + 2_000_000 * i as u64);
    }
    assert!(remarks(text.as_bytes(), &ReadingSettings::default())[0].contains("read as ns"));
}

#[test]
fn stamps_coarser_than_the_step_are_read_and_missing_rows_all_the_same_seen() {
    // Steps of 1.2 ms as whole milliseconds; then steps of a millisecond of which one is missing.
    let text = |stamp: &dyn Fn(usize) -> f64| {
        let row = |i: usize| format!("{:.0},{},{}\n", stamp(i), stamp(i), stamp(i).powi(2));
        format!("t_ms,x,u\n{}", (0..400).map(row).collect::<String>())
    };
    let coarse = read(text(&|i| 1.2 * i as f64).as_bytes(), &ReadingSettings::default()).expect("rounding only");
    assert!((coarse.segments[0].sample_time - 1.2e-3).abs() < 3e-6 && coarse.segments.len() == 1);
    for missing in [20, 200, 380] {
        let stamp = |i: usize| if i < missing { i as f64 } else { i as f64 + 1.0 };
        let recording = read(text(&stamp).as_bytes(), &ReadingSettings::default()).expect("bridged");
        assert_eq!(recording.segments[0].len(), 401, "{:?}", recording.report);
        assert!((recording.segments[0].channels[0][missing] - missing as f64).abs() < 1e-3);
        assert_eq!(recording.report.bridged.map(|bridged| (bridged.count, bridged.samples)), Some((1, 1)));
    }
}

#[test]
fn factors_stand_in_place_of_units() {
    let style = Style { head: "t_s,x,u [A]\n", factors: [1.0, 1.0, 0.1], ..PLAIN };
    let error = read(style.text(40).as_bytes(), &ReadingSettings::default()).expect_err("amperes are no newtons");
    let message = error.to_string();
    for part in ["run.csv:1:", "`u [A]` is in `A`", "`u` in N", "state the factor"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let mut options = ReadingSettings::default();
    options.scale.insert("u".into(), 10.0);
    let recording = holds_samples(style.text(40).as_bytes(), &options);
    assert!(matches!(&recording.report.assumptions[..], [Assumption::FactorForUnit { .. }]), "{:?}", recording.report);
    // Milliseconds by a stated factor.
    let mut options = ReadingSettings::default();
    options.scale.insert("t_s".into(), 1e-3);
    holds_samples(Style { head: "t_s,x,u\n", factors: [1e3, 1.0, 1.0], ..PLAIN }.text(40).as_bytes(), &options);
    // Steps of 2 are milliseconds where something moves; steps of 100 may be microseconds too.
    let whole = Style { head: "t,x,u\n", factors: [1e3, 1.0, 1.0], ..PLAIN };
    let said = remarks(whole.text(40).as_bytes(), &ReadingSettings::default());
    assert!(said[0].contains("`t`, which states no unit: read as ms by its steps"), "{said:?}");
    // Of a temperature they are seconds, unless whole numbers differ by a few counts.
    let unit_of = |row: &dyn Fn(usize) -> String| {
        let text = String::from("t,x,u\n") + &(0..400).map(row).collect::<String>();
        let signal = |name: &str, unit: &str| Signal { name: name.into(), unit: Some(unit.into()) };
        let signals = [signal("x", "K"), signal("u", "V")];
        let mut columns = open_columns(text.as_bytes(), "run.csv").expect("text");
        let read = Recording::of_columns(
            &mut *columns,
            "run.csv",
            (&signals[..1], &signals),
            &[],
            &ReadingSettings::default(),
        );
        read.expect("sound").report.remarks().remove(0)
    };
    let even = unit_of(&|i| format!("{:.1},{},{}\n", 2.0 * i as f64, (0.1 * i as f64).sin(), i % 7));
    assert!(even.contains("`t`, which states no unit: read as s by its steps"), "{even}");
    let counted = unit_of(&|i| format!("{},{},{}\n", 10 * i + i % 3 % 2, (0.1 * i as f64).sin(), i % 7));
    assert!(counted.contains("`t`, which states no unit: read as ms by its steps"), "{counted}");
    let doubtful = Style { factors: [5e4, 1.0, 1.0], ..whole };
    let error =
        read(doubtful.text(40).as_bytes(), &ReadingSettings::default()).expect_err("microseconds or milliseconds");
    assert!(matches!(error, LogError::TimeUnit { step, .. } if (step - 100.0).abs() < 1e-9), "{error}");
    options.scale.insert("t_s".into(), 1.0 / 5e4);
    holds_samples(doubtful.text(40).as_bytes(), &options);
}

#[test]
fn joints_are_found_at_the_ends_of_paths() {
    let head = "t_s,/js/position.elbow [deg],/js/velocity.elbow,/js/effort.elbow,/js/position.left_elbow";
    let row = |i: u32| format!("{},{},{},{},{}\n", 0.001 * f64::from(i), 90 * i, 2 * i, 3 * i, 4 * i);
    let rows: String = (0..40).map(row).collect();
    let signal = |name: &str, unit: &str| Signal { name: name.into(), unit: Some(unit.into()) };
    let signals = [signal("elbow", "rad"), signal("tau_elbow", "N*m")];
    let read = |head: &str| -> Result<Recording, LogError> {
        let text = format!("{head}\n{rows}");
        let rates = [signal("dot(elbow)", "rad/s")];
        let options = ReadingSettings::default();
        Recording::of_columns(
            &mut *open_columns(text.as_bytes(), "run.csv")?,
            "run.csv",
            (&signals[..1], &signals),
            &rates,
            &options,
        )
    };
    let recording = read(head).expect("found");
    let log = &recording.segments[0];
    assert!((log.channels[0][1] - std::f64::consts::FRAC_PI_2).abs() < 1e-12 && log.channels[1][1] == 3.0);
    assert_eq!(log.rates[0].as_ref().map(|rate| rate[1]), Some(2.0));
    // Two arms with one elbow each: neither is taken.
    let fault = read(&head.replace("position.left_elbow", "left/position.elbow")).expect_err("two fit").to_string();
    assert!(fault.contains("/js/position.elbow [deg]") && fault.contains("/js/left/position.elbow"), "{fault}");
}

#[test]
fn nothing_is_guessed_where_several_columns_may_be_meant() {
    for (head, parts) in [
        ("t_s,x [mm],x_cm,u", vec!["`x` may be `x [mm]` or `x_cm`"]),
        ("time,timestamp,x,u", vec!["the time may be `time` or `timestamp`"]),
        ("t_s,x,x,u", vec!["`x` may be `x` or `x.2`"]),
        ("t_s,y,z,u", vec!["no column `x`", "t_s, y, z, u; name the right one"]),
        ("t_s,v [mm/s],w_rad,u", vec!["or that of its rate, `dot(x)`, which `v [mm/s]` may be"]),
    ] {
        let rows: String = (0..40).map(|i| format!("{},{i},{},{}\n", 0.001 * f64::from(i), 2 * i, 3 * i)).collect();
        let message =
            read(format!("{head}\n{rows}").as_bytes(), &ReadingSettings::default()).expect_err(head).to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
    // An ending that only looks like a unit is a part of the name: `x_s` is no length.
    let rows: String = (0..40).map(|i| format!("{},{i},{},{}\n", 0.001 * f64::from(i), 2 * i, 3 * i)).collect();
    let recording = read(format!("t_s,x_s,x_m,u\n{rows}").as_bytes(), &ReadingSettings::default()).expect("one length");
    assert_eq!(recording.segments[0].channels[0][1], 2.0);
}

#[test]
fn rates_are_read_where_they_are_measured() {
    let rows: String = (0..40).map(|i| format!("{},{i},{},{}\n", 0.001 * f64::from(i), 2 * i, 3 * i)).collect();
    let recording =
        read(format!("t_s,x,dot(x) [mm/s],u\n{rows}").as_bytes(), &ReadingSettings::default()).expect("sound");
    assert_eq!(recording.segments[0].rates[0].as_ref().map(|rate| rate[1]), Some(2e-3));
    // A rate with an empty field is not used; the record is whole all the same.
    let rows = rows.replace("0.005,5,10,", "0.005,5,,");
    let recording = read(format!("t_s,x,dot(x),u\n{rows}").as_bytes(), &ReadingSettings::default()).expect("sound");
    assert_eq!((recording.segments.len(), recording.segments[0].rates.len()), (1, 0));
    assert!(recording.report.remarks()[0].contains("`dot(x)` has empty fields"), "{:?}", recording.report.remarks());
}

/// The text with some rows replaced.
fn edited(edit: impl Fn(usize) -> Option<String>) -> String {
    let rows = (0..400).map(|i| edit(i).unwrap_or_else(|| PLAIN.row(i)));
    PLAIN.head.to_owned() + &rows.collect::<String>()
}

#[test]
fn gaps_and_missing_readings_are_bridged_or_split_a_record() {
    let cut = |edit: &dyn Fn(usize) -> Option<String>| {
        read(edited(edit).as_bytes(), &ReadingSettings::default()).unwrap_or_else(|error| panic!("{error}"))
    };
    let lengths = |recording: &Recording| recording.segments.iter().map(Log::len).collect::<Vec<_>>();
    let gap = cut(&|i| (100..200).contains(&i).then(String::new));
    assert_eq!(lengths(&gap), [100, 200]);
    assert!((gap.report.segments[1].start - 0.4).abs() < 1e-9, "{:?}", gap.report.segments);
    for field in ["NaN", "", "inf", "-inf", "nan", "n/a", "null", "1e999", "-1e101"] {
        let missing = cut(&|i| (i == 100).then(|| format!("0.2,{field},1\n")));
        assert_eq!(lengths(&missing), [400], "{field}");
        let said = missing.report.remarks();
        assert!(said[1].contains("column `x`: in line 102"), "{said:?}");
        assert!((missing.segments[0].channels[0][100] - sample(100)[1]).abs() < 1e-6);
        assert_eq!(missing.segments[0].lines[99..102], [101, 101, 103]);
    }
    let back = cut(&|i| (i >= 200).then(|| PLAIN.row(i - 150)));
    assert_eq!(lengths(&back), [200, 200]);
    // A stamp that is wrong alone costs its reading.
    let wrong = cut(&|i| (i == 50 || i == 59).then(|| format!("{},1,1\n", if i == 50 { 0.001 } else { 7.0 })));
    assert_eq!(lengths(&wrong), [400]);
    let stray: Vec<u64> = wrong.report.left_out.iter().map(|part| part.from_line).collect();
    assert_eq!(stray, [52, 61]);
    // Columns that are not needed may lack anything.
    let text = PLAIN.text(60).replace(",u\n", ",u,spare\n").replace('\n', ",\n").replace("spare,", "spare");
    holds_samples(text.as_bytes(), &ReadingSettings::default());
    // A last line that was cut while it was written.
    let cut_line = PLAIN.text(60) + "0.12,0.1";
    let recording = holds_samples(cut_line.as_bytes(), &ReadingSettings::default());
    assert_eq!(recording.report.assumptions, [Assumption::CutLine { line: 62 }]);
    // Samples at different times in different columns, of which one has too few to be a record: no row is complete.
    let alternating = edited(|i| {
        Some(if i % 40 == 0 { format!("{},1,\n", 0.002 * i as f64) } else { format!("{},,2\n", 0.002 * i as f64) })
    });
    let message = read(alternating.as_bytes(), &ReadingSettings::default()).expect_err("no row is whole").to_string();
    assert!(message.contains("400 rows") && message.contains("column `u`"), "{message}");
}

#[test]
fn uneven_stamps_are_told_from_uneven_readings() {
    // Stamps that are late by up to a tenth, of readings that are even; then readings that are late.
    let late = |i: usize| 2e-4 * ((i * i * 7919) % 97) as f64 / 97.0;
    let stamped = edited(|i| {
        let [t, x, u] = sample(i);
        Some(format!("{:.6},{x:.9},{u:.9}\n", 1.7e9 + t + late(i)))
    });
    let recording = read(stamped.as_bytes(), &ReadingSettings::default()).expect("even");
    let uneven = recording.report.uneven.as_ref().expect("said");
    assert!(!uneven.resampled && uneven.largest > 0.05, "{uneven:?}");
    assert!(recording.segments[0].channels[0].iter().enumerate().all(|(i, x)| (x - sample(i)[1]).abs() < 1e-8));
    let read_late = edited(|i| {
        let t = sample(i)[0] + 4.0 * late(i);
        Some(format!("{t:.9},{:.9},{:.9}\n", 0.125 * (7.0 * t).sin(), 3.0 * (2.0 * t).cos()))
    });
    let recording = read(read_late.as_bytes(), &ReadingSettings::default()).expect("resampled");
    let uneven = recording.report.uneven.as_ref().expect("said");
    assert!(uneven.resampled && uneven.interpolation[0].share < 1e-3, "{uneven:?}");
    let log = &recording.segments[0];
    for (k, x) in log.channels[0].iter().enumerate() {
        let t = 4.0 * late(0) + k as f64 * log.sample_time;
        assert!((x - 0.125 * (7.0 * t).sin()).abs() < 1e-6, "{k}");
    }
}

#[test]
fn faults_name_place_and_remedy() {
    for (text, parts) in [
        ("", vec!["run.csv:1: no column is recognised as the time; the file is a table of text", "has no columns"]),
        ("\n\n\n", vec!["no column is recognised as the time"]),
        ("t_s,x,u\n", vec!["run.csv:1: the log ends after 0 samples"]),
        ("t_s\n0\n1\n2\n", vec!["no column `x`"]),
        ("t_s,x,u\n0,1,off\n", vec!["run.csv:2: column `u` holds `off`"]),
        ("t_s,x,u\n0,1,2\n0.1,\"2,3\n", vec!["run.csv:3: 2 fields, the header has 3", "a quote is opened"]),
        ("t_s,x,u\ns,kg,N\n0,1,2\n", vec!["run.csv:2: column `x` is in `kg`", "different quantities", "factor"]),
        ("t_s;x;u\n0;1,5;2\n1;2,5;3\n2;2.5;3\n", vec!["run.csv:4: column `x` holds `2.5`", "comma before"]),
        ("t_s,x,u\n0,1,2\n1,\u{0}2,3\n", vec!["run.csv:3: the text holds a byte of value zero"]),
        ("just a text\nof two lines\n", vec!["no column is recognised as the time"]),
        ("t_s;x;u\n0;1.234,5;2\n1;2,5;3\n2;2,5;3\n", vec!["run.csv:2: column `x` holds `1.234,5`"]),
        ("\u{1}\u{2}\u{3}\u{4}", vec!["run.csv: the file is no text"]),
    ] {
        let message = read(text.as_bytes(), &ReadingSettings::default()).expect_err(text).to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{text:?}: {message}");
    }
    for (step, part) in
        [(-0.002, "run.csv:3: time goes back from row to row; sort"), (0.0, "run.csv:3: time stands still")]
    {
        let row = |k: usize| format!("{},{},{}\n", 1.0 + step * k as f64, k % 7, k % 5);
        let text: String = "t_s,x,u\n".to_owned() + &(0..40).map(row).collect::<String>();
        let message = read(text.as_bytes(), &ReadingSettings::default()).expect_err("no time").to_string();
        assert!(message.starts_with(part), "{message}");
    }
    for magic in [
        &b"\x89MCAP0\r\n...."[..],
        b"PAR1....",
        b"MATLAB 5.0 MAT-file",
        b"\x89HDF\r\n\x1a\n",
        b"\x1f\x8b",
        b"PK\x03\x04",
    ] {
        let error = read(magic, &ReadingSettings::default());
        assert!(
            matches!(error, Err(LogError::Format { .. } | LogError::Csv { .. } | LogError::Io { .. })),
            "{error:?}"
        );
    }
}

#[test]
fn garbage_never_panics() {
    use rand::{Rng, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
    let alphabet = b"0123456789.,;\t \n\r-+eE\"#%/[]()tsxu_nNaA\xb0\xff\0";
    let plain = PLAIN.text(50).into_bytes();
    for round in 0..3000 {
        let bytes: Vec<u8> = if round % 2 == 0 {
            let length = rng.random_range(0..400);
            (0..length).map(|_| alphabet[rng.random_range(0..alphabet.len())]).collect()
        } else {
            // A sound log with a few bytes changed.
            let mut bytes = plain.clone();
            for _ in 0..rng.random_range(1..6) {
                let at = rng.random_range(0..bytes.len());
                bytes[at] = alphabet[rng.random_range(0..alphabet.len())];
            }
            bytes
        };
        let _ = read(&bytes, &ReadingSettings::default());
    }
}

#[test]
fn every_dialect_gives_identical_numbers() {
    use rand::{Rng, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(9);
    for round in 0..200 {
        let rows = rng.random_range(16..60);
        let signal: Vec<[f64; 2]> =
            (0..rows).map(|_| [rng.random_range(-1e3..1e3), rng.random_range(-1e-3..1e-3)]).collect();
        let plain = |separator: &str, decimal: &str, quote: &str, end: &str, head: &str| {
            let mut text =
                format!("{head}{}{end}", ["t_s", "x", "u"].map(|name| format!("{quote}{name}{quote}")).join(separator));
            for (i, [x, u]) in signal.iter().enumerate() {
                let fields = [format!("{:.3}", 1e-3 * i as f64), x.to_string(), format!("{u:e}")];
                text += &(fields.map(|field| format!("{quote}{}{quote}", field.replace('.', decimal))).join(separator)
                    + end);
            }
            text
        };
        let expected = read(plain(",", ".", "", "\n", "").as_bytes(), &ReadingSettings::default()).expect("sound");
        for separator in [",", ";", "\t", "  ", " \t"] {
            for decimal in [".", ","] {
                for (quote, end, head) in [
                    ("", "\n", ""),
                    ("\"", "\r\n", "\u{feff}"),
                    ("", "\r", "# a comment\r"),
                    ("\"", "\n", "// rig, 3\n"),
                ] {
                    if separator == "," && decimal == "," && quote.is_empty() {
                        continue;
                    }
                    let text = plain(separator, decimal, quote, end, head);
                    let found = read(text.as_bytes(), &ReadingSettings::default()).unwrap_or_else(|error| {
                        panic!("{round}: {separator:?} {decimal:?} {quote:?} {end:?}: {error}")
                    });
                    assert_eq!(
                        found.segments[0].channels, expected.segments[0].channels,
                        "{separator:?} {decimal:?} {quote:?}"
                    );
                    assert_eq!(found.segments[0].sample_time, expected.segments[0].sample_time);
                    let semicolons = Assumption::Separator { separator: Separator::Semicolon };
                    assert_eq!(found.report.assumptions.contains(&semicolons), separator == ";");
                }
            }
        }
    }
}

/// A file of `tests/fixtures/logs`.
fn fixture(name: &str) -> Vec<u8> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/fixtures/logs/");
    std::fs::read(folder.to_owned() + name).expect("a fixture")
}

/// A file written by other tools holds the numbers of the text, as far as its units allow.
fn holds_the_numbers_of_the_text(name: &str, options: &ReadingSettings) {
    let text = read(&fixture("slider.csv"), &ReadingSettings::default()).expect("sound");
    let other = read(&fixture(name), options).unwrap_or_else(|error| panic!("{name}: {error}"));
    let ([text], [other]) = (&text.segments[..], &other.segments[..]) else { panic!("{name}: {:?}", other.report) };
    assert!((text.sample_time - other.sample_time).abs() < 1e-12, "{name}: {}", other.sample_time);
    for (a, b) in text.channels.iter().zip(&other.channels) {
        assert_eq!(a.len(), b.len(), "{name}");
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-15 * a.abs()), "{name}");
    }
}

#[test]
fn files_of_other_programs_hold_the_numbers_of_the_text() {
    let text = read(&fixture("slider.csv"), &ReadingSettings::default()).expect("sound");
    let joint = [("x", "position.slider"), ("u", "effort.slider")];
    for (name, columns) in [
        ("arrays.npz", &[][..]),
        ("arrays.npz", &[("t_s", "date"), ("x", "both[1]"), ("u", "big")]),
        ("arrays.npz", &[("x", "wide[1]"), ("u", "fortran[2]")]),
        ("stored.npz", &[]),
        ("records.npy", &[]),
        ("matrix.npy", &[("t_s", "1"), ("x", "2"), ("u", "3")]),
        ("columns.json", &[]),
        ("records.jsonl", &[]),
        ("sysid.json", &[("x", "position"), ("u", "voltage")]),
        ("slider.wpilog", &[("x", "/slider/x"), ("u", "/slider/u")]),
        ("slider.wpilog", &[("x", "/both[1]"), ("u", "/both[2]")]),
        ("joint_states.db3", &joint),
    ] {
        holds_the_numbers_of_the_text(name, &mapped(columns));
        // To the last digit: nothing is converted.
        let other = read(&fixture(name), &mapped(columns)).expect("sound");
        assert_eq!(other.segments[0].channels, text.segments[0].channels, "{name}");
    }
}

#[test]
fn mat_files_hold_the_numbers_of_the_text() {
    holds_the_numbers_of_the_text("matlab5.mat", &ReadingSettings::default());
    holds_the_numbers_of_the_text("matlab5.mat", &mapped(&[("x", "both[1]"), ("u", "wide[2]")]));
    let error = read(&fixture("matlab5.mat"), &mapped(&[("x", "note")])).expect_err("a text");
    assert!(error.to_string().contains("no column `note`"), "{error}");
}

#[cfg(feature = "mat73")]
#[test]
fn hdf5_files_hold_the_numbers_of_the_text() {
    holds_the_numbers_of_the_text("matlab73.mat", &ReadingSettings::default());
    holds_the_numbers_of_the_text("matlab73.mat", &mapped(&[("x", "both[1]"), ("u", "both[2]")]));
    holds_the_numbers_of_the_text("slider.h5", &ReadingSettings::default());
    holds_the_numbers_of_the_text("slider.h5", &mapped(&[("x", "both[1]"), ("u", "both[2]")]));
}

#[cfg(feature = "mcap")]
#[test]
fn mcap_files_hold_the_numbers_of_the_text() {
    for name in ["joint_states.mcap", "joint_states_lz4.mcap", "joint_states_zstd.mcap"] {
        holds_the_numbers_of_the_text(name, &mapped(&[("x", "position.slider"), ("u", "effort.slider")]));
    }
    let error = read(&fixture("joint_states.mcap"), &ReadingSettings::default()).expect_err("not mapped");
    assert!(error.to_string().contains("position.slider, "), "{error}");
}

#[cfg(feature = "parquet")]
#[test]
fn parquet_files_hold_the_numbers_of_the_text() {
    holds_the_numbers_of_the_text("slider.parquet", &ReadingSettings::default());
}

#[test]
fn formats_that_are_not_built_in_name_their_feature() {
    for (name, feature, built_in) in [
        ("matlab73.mat", "mat73", cfg!(feature = "mat73")),
        ("slider.h5", "mat73", cfg!(feature = "mat73")),
        ("joint_states.mcap", "mcap", cfg!(feature = "mcap")),
        ("slider.parquet", "parquet", cfg!(feature = "parquet")),
    ] {
        if !built_in {
            let message = read(&fixture(name), &ReadingSettings::default()).expect_err(name).to_string();
            assert!(message.contains(&format!("--features {feature}")), "{message}");
        }
    }
}

/// A motion to and fro with turns and slow passages, and noise below a step.
fn uneven_motion(i: usize) -> f64 {
    let t = 0.002 * i as f64;
    // The finaliser of SplitMix64: neighbours have nothing to do with each other.
    let mut bits = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    let noise = ((bits ^ (bits >> 31)) % 1000) as f64 / 1000.0 - 0.5;
    0.9 * (0.9 * t).sin() + 0.02 * (11.0 * t).sin() + 3e-4 * noise
}

#[test]
fn readings_repeat_by_the_steps_of_the_numbers_in_the_file() {
    let (count, rows) = (1e-4, 40_000);
    let counts = |x: f64| format!("{:.4}", (x / count).round() * count);
    // Two encoders of which the mean is taken, one of them read from the other side; an encoder in numbers of five digits, in degrees; an
    // angle of which the sine is the position.
    let two = |i: usize, late: usize| {
        let x = uneven_motion(i - late);
        format!("{},{}", counts(100.0 + x), counts(50.0 - x + 0.3 * count))
    };
    let digits = |i: usize, late: usize| format!("{:.4e},0", 40.0 * uneven_motion(i - late));
    let angle = |i: usize, late: usize| format!("{},0", counts(1.5 * uneven_motion(i - late)));
    type Row<'a> = &'a dyn Fn(usize, usize) -> String;
    let ways: [(&str, f64, Row<'_>); 3] =
        [("0.5*(a-b)", 1.0, &two), ("a", std::f64::consts::PI / 180.0, &digits), ("sin(a)", 1.0, &angle)];
    for (column, factor, row) in ways {
        for stale in [false, true] {
            let late = |i: usize| usize::from(stale && i % 20 == 7);
            let line = |i: usize| format!("{:.3},{},{}\n", 0.002 * i as f64, row(i + 1, late(i)), sample(i)[2]);
            let text = "t_s,a,b,u\n".to_owned() + &(0..rows).map(line).collect::<String>();
            let mut options = mapped(&[("x", column)]);
            options.scale.insert("x".into(), factor);
            let recording = read(text.as_bytes(), &options).unwrap_or_else(|error| panic!("{column}: {error}"));
            let found: usize = recording.report.repeated.iter().map(|of| of.count).sum();
            if stale {
                // Where the motion turns or is slow, a repeated reading is like a fresh one, and a fresh one may be like one that repeats.
                assert!(found > rows / 40 && found <= rows / 20 + rows / 1000, "{column}: {found}");
            } else {
                assert_eq!(found, 0, "{column}");
            }
            for mut log in recording.segments {
                assert_eq!(log.mend_first(1), [], "{column} {stale}");
            }
        }
    }
}

#[test]
fn rounding_errors_of_what_is_computed_make_no_reading_stale() {
    // The mean of two coarse encoders: one goes up by a step where the other goes down, and the sum is as before but for its last digit.
    let count = 5e-4;
    let counts = |x: f64| format!("{:.4}", (x / count).round() * count);
    let line = |i: usize| {
        let t = 0.002 * i as f64;
        let x = 0.9 * (0.9 * t).sin() + 0.02 * (11.0 * t).sin();
        let noise = |pace: usize| 7e-4 * (((i * pace) % 1000) as f64 / 1000.0 - 0.5);
        format!("{t:.3},{},{},{}\n", counts(100.1 + x + noise(7919)), counts(7.3 + x + noise(6007)), sample(i)[2])
    };
    let text = "t_s,a,b,u\n".to_owned() + &(0..12_000).map(line).collect::<String>();
    let recording = read(text.as_bytes(), &mapped(&[("x", "0.5*(a+b)")])).unwrap_or_else(|error| panic!("{error}"));
    assert!(recording.report.repeated.is_empty(), "{:?}", recording.report.repeated);
}
