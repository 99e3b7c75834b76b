//! Logs that show two parameters only in a combination.

use crate::support::{printed_in, root};
use std::f64::consts::TAU;

#[test]
fn what_one_harmonic_shows_of_two_parameters_is_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut log = "t_s,x,u\n".to_owned();
    for i in 0..4500 {
        let t = f64::from(i) * 1e-3;
        let (sin, cos) = (TAU * t).sin_cos();
        let [x, v, a] = [0.1 * cos, -0.1 * TAU * sin, -0.1 * TAU * TAU * cos];
        log.push_str(&format!("{t},{x},{}\n", 2.0 * a + 40.0 * x + 1.5 * v * v));
    }
    std::fs::write(folder.path().join("log.csv"), log).expect("writable");
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    for weights in ["noise", "equal"] {
        let arguments = ["identify", model, "--log", "log.csv", "--weights", weights];
        let text = printed_in(folder.path(), &arguments, 1);
        assert!(text.contains("rank 2 of 3"), "{text}");
        let row = text.lines().find(|line| line.starts_with("-0.0253303 k1 + m")).expect("the combination");
        let value: f64 = row.split_whitespace().nth(6).and_then(|number| number.parse().ok()).expect("its value");
        assert!((value - (2.0 - 40.0 / TAU / TAU)).abs() < 1e-5, "{row}");
        let found: serde_json::Value =
            serde_json::from_str(&printed_in(folder.path(), &[&arguments[..], &["--json"]].concat(), 1)).expect("JSON");
        let combination = &found["combinations"][0];
        assert!((combination["value"].as_f64().expect("a number") - (2.0 - 40.0 / TAU / TAU)).abs() < 1e-8, "{found}");
        assert_eq!((&combination["terms"]["m"], &combination["unit"]), (&"1".into(), &"kg".into()), "{found}");
    }
}

/// A log of the slider of Feng, Eqn 3.24 over twenty periods of two seconds; `read` makes readings of positions.
fn slider(read: impl Fn(usize, f64) -> f64) -> String {
    let mut log = "t_s,x,u\n".to_owned();
    for i in 0..4000 {
        let (t, w) = (0.01 * i as f64, 0.5 * TAU);
        let x = 0.3 * ((w * t).cos() - (3.0 * w * t).cos() / 9.0);
        let v = 0.3 * w * ((3.0 * w * t).sin() / 3.0 - (w * t).sin());
        let a = 0.3 * w * w * ((3.0 * w * t).cos() - (w * t).cos());
        log.push_str(&format!("{t},{},{}\n", read(i, x), 2.0 * a + 40.0 * x + 1.5 * v * v));
    }
    log
}

/// What the command finds in a log, as JSON, at this exit code.
fn found(log: &str, options: &[&str], code: i32) -> serde_json::Value {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("log.csv"), log).expect("writable");
    let model = root().join("models/mass_spring_drag.tpm");
    let arguments = ["identify", model.to_str().expect("plain"), "--log", "log.csv", "--json", "--hold", "none"];
    serde_json::from_str(&printed_in(folder.path(), &[&arguments[..], options].concat(), code)).expect("JSON")
}

#[test]
fn nothing_is_identified_where_the_exit_code_says_that_there_is_no_result() {
    // An encoder whose steps are as large as the motion's amplitude reads two counts.
    for step in [0.2, 0.3, 0.45] {
        let found = found(&slider(|_, x| (x / step).round() * step), &[], 1);
        assert!(found["residual"].as_f64().is_some_and(|residual| residual > 0.2), "{found}");
        let statuses: Vec<&str> = (found["parameters"].as_array().expect("a list").iter())
            .map(|parameter| parameter["status"].as_str().expect("a text"))
            .collect();
        assert!(statuses.iter().all(|status| ["untrusted", "poorly_determined"].contains(status)), "{found}");
        assert!(step == 0.45 || statuses.contains(&"untrusted"), "{statuses:?}");
    }
}

#[test]
fn a_stated_period_is_believed_where_noise_hides_it() {
    // Sums of uniform numbers (xorshift), nearly normal, of deviation one.
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut uniform = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let noise: Vec<f64> = (0..4000).map(|_| (0..12).map(|_| uniform()).sum()).collect();
    // A sixth of the motion: too much for two periods to look alike, and little for the mean of twenty.
    let visible = found(&slider(|i, x| x + 0.035 * noise[i]), &["--period", "2"], 0);
    for (parameter, truth) in visible["parameters"].as_array().expect("a list").iter().zip([2.0, 40.0, 1.5]) {
        let [value, std] = ["value", "std"].map(|field| parameter[field].as_f64().expect("a number"));
        assert!((value - truth).abs() < 3.0 * std && std < 0.1 * truth, "{parameter}");
    }
    // Ten times the motion.
    let drowned = found(&slider(|i, x| x + 2.4 * noise[i]), &["--period", "2"], 1);
    let parameters = drowned["parameters"].as_array().expect("a list");
    assert!(parameters.iter().all(|parameter| parameter["status"] != "identified"), "{drowned}");
}

#[test]
fn the_shape_of_a_file_does_not_change_what_is_identified() {
    let plain = slider(|_, x| x);
    let value = |found: &serde_json::Value, j: usize| found["parameters"][j]["value"].as_f64().expect("a number");
    let expected = found(&plain, &[], 0);
    assert!(expected["log"].get("reading").is_none(), "{expected}");
    let rows: Vec<Vec<f64>> = (plain.lines().skip(1))
        .map(|line| line.split(',').map(|field| field.parse().expect("a number")).collect())
        .collect();
    let written = |head: &str, row: &dyn Fn(&[f64]) -> String| -> String {
        head.to_owned() + &rows.iter().map(|fields| row(fields)).collect::<String>()
    };
    let german = written("# rig 7\nZeit;x;u\nms;mm;N\n", &|row| {
        format!("{:.0};{};{}\r\n", 1e3 * row[0], 1e3 * row[1], row[2]).replace('.', ",")
    });
    let counts = written("time\tcounts\tcurrent [A]\n", &|row| {
        format!("{:.3}\t{}\t{}\n", row[0], row[1] * 4096.0 / std::f64::consts::TAU, row[2] / 7.0)
    });
    let gap = plain.lines().enumerate().filter(|(i, _)| !(700..705).contains(i)).map(|(_, line)| format!("{line}\n"));
    let gap: String = gap.collect();
    let cases: [(String, &[&str], &[&str]); 4] = [
        (german, &["--map", "t_s=Zeit"], &["semicolons", "decimal commas", "line 3 has the units", "from mm to m"]),
        (
            counts,
            &["--map", "x=counts", "--map", "u=current", "--scale", "x=2*pi/4096", "--scale", "u=7"],
            &["tabulators", "states no unit: read as s", "the stated factor 7"],
        ),
        (gap.clone(), &[], &["5 readings are missing in 1 gap", "bridged"]),
        (gap, &["--domain", "harmonics"], &["5 readings are missing in 1 gap", "bridged"]),
    ];
    for (log, options, said) in cases {
        let result = found(&log, options, 0);
        for j in 0..3 {
            assert!((value(&result, j) / value(&expected, j) - 1.0).abs() < 1e-3, "{said:?}: {result}");
        }
        let remarks = result["log"]["reading"]["remarks"].to_string();
        assert!(said.iter().all(|part| remarks.contains(part)), "{said:?}: {remarks}");
    }
}
