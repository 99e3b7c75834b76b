//! Logs in formats of other programs, signals computed of columns, and the first model of a log.

use crate::support::{fails, printed_in, root, tpm_in};
use serde_json::Value;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Output;

/// m, k1, k2 of `models/mass_spring_drag.tpm`.
const TRUTH: [f64; 3] = [2.0, 40.0, 1.5];
/// Time from row to row, s.
const STEP: f64 = 0.005;

/// Time, position, velocity and acceleration of a sweep, with noise of 0.1 mm on the position.
fn sweep() -> Vec<[f64; 4]> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut noise = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        12.0_f64.sqrt() * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
    };
    let row = |k: u32| {
        let t = STEP * f64::from(k);
        let (w, dw) = (2.0 * PI * (0.3 + 0.06 * t), 2.0 * PI * 0.06);
        let (s, c) = (2.0 * PI * (0.3 * t + 0.03 * t * t)).sin_cos();
        [t, 0.3 * s + 1e-4 * noise(), 0.3 * w * c, 0.3 * (dw * c - w * w * s)]
    };
    (0..3_000).map(row).collect()
}

/// The force on the machine of the shipped model.
fn force([_, x, v, a]: [f64; 4]) -> f64 {
    TRUTH[0] * a + TRUTH[1] * x + TRUTH[2] * v * v
}

/// Values and deviations of the parameters that `tpm identify` finds in a log.
fn identified(folder: &Path, arguments: &[&str]) -> Vec<(f64, f64)> {
    let model = root().join("models/mass_spring_drag.tpm").display().to_string();
    let output = tpm_in(folder, &[&["identify", &model, "--json"], arguments].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    let json: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{arguments:?}: {said}"));
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("a number: {value}"));
    let parameters = json["parameters"].as_array().expect("parameters").iter();
    parameters.map(|parameter| (number(&parameter["value"]), number(&parameter["std"]))).collect()
}

#[test]
fn every_format_and_every_spelling_of_a_signal_has_the_same_result() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).expect("writable");
    let rows = sweep();
    let table = |header: &str, fields: &dyn Fn([f64; 4]) -> String| {
        let lines: String = rows.iter().map(|row| fields(*row) + "\n").collect();
        format!("{header}{lines}")
    };
    write("run.csv", table("t_s,x,u\n", &|row| format!("{},{},{}", row[0], row[1], force(row))));
    write("run.jsonl", table("", &|row| format!("{{\"t_s\": {}, \"x\": {}, \"u\": {}}}", row[0], row[1], force(row))));
    let both = |row: [f64; 4]| format!("{},{},{},{}", row[0], row[1], 4.0 * force(row), 2.0 * force(row));
    write("pwm.csv", table("t_s,x,pwm1,PWM [two]\n", &both));
    let expected = identified(folder.path(), &["--log", "run.csv"]);
    for ((value, std), truth) in expected.iter().zip(TRUTH) {
        assert!((value - truth).abs() < 4.0 * std, "{value} +- {std}: {truth}");
    }
    assert_eq!(identified(folder.path(), &["--log", "run.jsonl"]), expected);
    let computed = ["--log", "pwm.csv", "--map", "u=0.5*(pwm1 - \"PWM [two]\")"];
    assert_eq!(identified(folder.path(), &computed), expected);
}

#[test]
fn topics_with_times_of_their_own_are_one_record() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut text = String::from("time,/cart/x,/drive/u\n");
    for row in sweep() {
        // The force is logged 1.7 ms behind the position, with its value then.
        let later = 0.0017;
        let [t, x, v, a] = row;
        let then = force([t + later, x + later * v, v + later * a, a]);
        let _ = writeln!(text, "{t},{x},\n{:.6},,{then}", t + later);
    }
    std::fs::write(folder.path().join("topics.csv"), text).expect("writable");
    let found = identified(folder.path(), &["--log", "topics.csv"]);
    for ((value, _), truth) in found.iter().zip(TRUTH) {
        assert!((value / truth - 1.0).abs() < 0.01, "{found:?}");
    }
    let model = root().join("models/mass_spring_drag.tpm").display().to_string();
    let said = printed_in(folder.path(), &["inspect", "topics.csv", &model], 0);
    assert!(said.contains("times of their own: rows are those of `/cart/x`"), "{said}");
}

#[test]
fn what_is_no_log_is_named_for_what_it_is() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = root().join("models/mass_spring_drag.tpm").display().to_string();
    for (name, bytes, said) in [
        ("gain.json", &b"{\"gain\": 3}"[..], "the JSON has no lists of numbers, only `gain`"),
        ("run.wpilog", b"WPILOG\x00\x01\x00\x00\x00\x00\x20\x00\x1a\x20", "the WPILOG file is cut short or damaged"),
        ("run.ulg", b"ULog\x01\x12\x35\x01", "the file is a ULog of PX4"),
        ("run.npz", b"PK\x03\x04", "the ZIP archive is cut short or damaged"),
        ("run.db3", b"SQLite format 3\x00", "the SQLite database is cut short or damaged"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("writable");
        fails(&["identify", &model, "--log", &path.display().to_string()], 2, &[said]);
    }
}

#[test]
fn the_command_that_init_prints_for_a_log_pastes_into_a_shell() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut text = String::from("Time [ms];Output angle [deg];Motor's current [mA]\n");
    for [t, x, v, a] in sweep() {
        // J/kt and d/kt in A per rad.
        let current = 0.02 * a + 0.3 * v;
        let row = format!("{:.0};{};{}\n", 1e3 * t, x.to_degrees(), 1e3 * current);
        text.push_str(&row.replace('.', ","));
    }
    std::fs::write(folder.path().join("motor test.csv"), text).expect("writable");
    let said = printed_in(folder.path(), &["init", "motor", "--log", "motor test.csv"], 0);
    let command = said.lines().find_map(|line| line.strip_prefix("next: tpm ")).expect("a command");
    let model = std::fs::read_to_string(folder.path().join("motor.tpm")).expect("written");
    assert!(model.contains("coordinate phi [rad]") && model.contains("input u [A]"), "{model}");
    let line = format!("'{}' {command} --json", env!("CARGO_BIN_EXE_tpm"));
    let output = std::process::Command::new("sh").arg("-c").arg(line).current_dir(folder.path()).output();
    let output = output.expect("a shell");
    let said = String::from_utf8_lossy(&output.stderr);
    let json: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{command}: {said}"));
    let value = |k: usize| json["parameters"][k]["value"].as_f64().expect("a number");
    for (k, truth) in [0.02, 0.3].into_iter().enumerate() {
        assert!((value(k) / truth - 1.0).abs() < 0.02, "{k}: {} {truth}", value(k));
    }
}

#[test]
fn a_log_is_converted_whole_or_not_at_all() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let there = |name: &str| folder.path().join(name).exists();
    let lines: String = sweep()
        .iter()
        .map(|row| format!("{},{},{},idle\n", (1000.0 * row[0]).round(), 1e3 * row[1], force(*row)))
        .collect();
    std::fs::write(folder.path().join("run.txt"), format!("time [ms],x [mm],u,mode\n{lines}")).expect("writable");
    let output = tpm_in(folder.path(), &["convert", "run.txt", "--to", "csv"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && output.stdout.is_empty(), "{said}");
    assert!(said.contains("`mode` is left out: `idle` in line 2 is no number"), "{said}");
    assert!(said.contains("run.csv: 3000 rows, time and 2 columns"), "{said}");
    let expected = identified(folder.path(), &["--log", "run.txt"]);
    assert_eq!(identified(folder.path(), &["--log", "run.csv"]), expected);
    // Not over a file of the user.
    let before = std::fs::read(folder.path().join("run.csv")).expect("written");
    let refused = |arguments: &[&str]| {
        let output = tpm_in(folder.path(), arguments);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let message = refused(&["convert", "run.txt", "--to", "csv"]);
    assert!(message.contains("run.csv is there already; type another name (-o)"), "{message}");
    assert_eq!(std::fs::read(folder.path().join("run.csv")).expect("untouched"), before);
    let message = refused(&["convert", "none.txt", "--to", "csv"]);
    assert!(message.contains("none.txt") && !there("none.csv"), "{message}");
    // Formats that are features, of this build or not.
    for format in ["mcap", "parquet"] {
        let other = format!("run.{format}");
        let output = tpm_in(folder.path(), &["convert", "run.txt", "--to", format]);
        if output.status.success() {
            for ((value, std), (own, _)) in identified(folder.path(), &["--log", &other]).iter().zip(&expected) {
                assert!((value - own).abs() < 1e-6 * std, "{format}: {value} {own}");
            }
        } else {
            assert_without(&output, format);
            assert!(!there(&other));
        }
    }
}

/// Asserts that a format was refused because it is a feature that this build is without.
fn assert_without(output: &Output, feature: &str) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{said}");
    assert!(said.contains(&format!("with the feature `{feature}` only")), "{said}");
}

#[test]
fn what_a_result_makes_of_a_log_is_recorded() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let lines: String = sweep().iter().map(|row| format!("{},{},{}\n", row[0], row[1], force(*row))).collect();
    std::fs::write(folder.path().join("run.csv"), format!("t_s,x,u\n{lines}")).expect("writable");
    let model = root().join("models/mass_spring_drag.tpm").display().to_string();
    let identify = ["identify", &model, "--log", "run.csv", "--record", "seen.mcap"];
    let output = tpm_in(folder.path(), &identify);
    if !output.status.success() {
        assert_without(&output, "mcap");
        assert!(!folder.path().join("seen.mcap").exists());
        return;
    }
    let seen = printed_in(
        folder.path(),
        &["convert", "seen.mcap", "--to", "csv", "-o", "-", "--map", "t_s=/measured:stamp"],
        0,
    );
    let (header, rows) = seen.split_once('\n').expect("a header");
    let at = |name: &str| header.split(',').position(|of| of == name).unwrap_or_else(|| panic!("{name}: {header}"));
    let places = ["measured", "predicted", "residual", "free_run"].map(|name| at(&format!("/{name}:position.x [m]")));
    let log = sweep();
    let mut compared = 0;
    for row in rows.lines() {
        let fields: Vec<f64> = row.split(',').map(|field| field.parse().unwrap_or(f64::NAN)).collect();
        let [seen, predicted, residual, free] = places.map(|at| fields[at]);
        assert_eq!(residual, seen - predicted);
        assert!((free - seen).abs() < 5e-3, "{row}");
        compared += usize::from(log.iter().any(|own| own[1] == seen));
    }
    assert!(compared > 1000, "{compared}");
}
