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
