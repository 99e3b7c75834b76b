//! What a log holds, before anything is identified.

use crate::support::{drawn, fails, printed_in, root, tpm_in};
use serde_json::Value;
use std::f64::consts::PI;
use std::path::Path;

/// The mass with spring and drag of the shipped model along six periods of 1 s; forces are recorded 3 ms before they act, positions are
/// rounded to 1 mm; five rows are missing in one place, and more in another than the motion tells.
fn run(folder: &Path) {
    let motion = |t: f64| {
        let w = 2.0 * PI;
        let wave = |order: f64, size: f64| {
            let (s, c) = (order * w * t + order).sin_cos();
            [size * c, -size * order * w * s, -size * (order * w).powi(2) * c]
        };
        let waves = [wave(1.0, 0.3), wave(2.0, 0.06), wave(5.0, 0.01)];
        [0, 1, 2].map(|d| waves.iter().map(|wave| wave[d]).sum::<f64>())
    };
    let mut text = String::from("time [ms],x,state,u\n");
    for k in (0..3_000).filter(|k| ![1_200..1_205, 2_000..2_100].iter().any(|gap| gap.contains(k))) {
        let t = 2e-3 * f64::from(k);
        let ([x, ..], [ahead, v, a]) = (motion(t), motion(t + 3e-3));
        let u = 2.0 * a + 40.0 * ahead + 1.5 * v * v;
        text.push_str(&format!("{},{:.4},run,{u:.6}\n", 2 * k, (x / 1e-3).round() * 1e-3));
    }
    std::fs::write(folder.join("run.csv"), text).expect("writable");
}

fn finding<'a>(json: &'a Value, kind: &str) -> &'a Value {
    let all = json["findings"].as_array().expect("findings");
    all.iter().find(|finding| finding["measured"]["kind"] == kind).unwrap_or_else(|| panic!("no {kind}: {json}"))
}

#[test]
fn a_log_is_looked_at_with_and_without_a_model() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    run(folder.path());
    let text = printed_in(folder.path(), &["inspect", "run.csv"], 0);
    for part in [
        "2900 samples every 0.002 s (500 Hz), 5.8 s in 2 stretches",
        "5 readings are missing in 1 gap of at most 0.012 s, which are bridged by the motion around them",
        "column `state` is not read",
        "x is rounded to counts of 0.001",
        "with a period of 1 s",
        "gaps split the record into 2 stretches",
        "give one",
    ] {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("a readable path");
    let text = printed_in(folder.path(), &["inspect", "run.csv", model], 0);
    assert!(text.contains("--delay u=0.00") && text.contains("coordinate") && text.contains("input"), "{text}");
    let text = printed_in(folder.path(), &["inspect", "run.csv", model, "--json", "--report", "seen"], 0);
    let json: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["schema"], "tpm.inspection/1");
    let delay = finding(&json, "inputs")["measured"]["delay"].as_f64().expect("a delay");
    assert!((delay - 3e-3).abs() < 2e-4, "{delay}");
    assert_eq!(finding(&json, "gaps")["measured"]["left_out"], 0);
    for file in drawn(&["inspection.svg", "inspection.png", "inspection.json"]) {
        assert!(folder.path().join("seen").join(file).is_file(), "{file}");
    }
    // What is done about the delay leaves none.
    let output = tpm_in(folder.path(), &["inspect", "run.csv", model, "--json", "--delay", "u=0.003"]);
    let json: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let all = json["findings"].as_array().expect("findings");
    assert!(all.iter().all(|finding| finding["measured"]["shifted"] != true), "{json}");
    let log = folder.path().join("run.csv");
    let log = log.to_str().expect("a readable path");
    fails(&["inspect", log, "--delay", "u=1"], 2, &["--delay needs a model"]);
    fails(&["inspect", log, "--map", "q=x"], 2, &["without a model columns keep their names", "--map"]);
    fails(&["inspect", "nowhere.csv"], 2, &["nowhere.csv"]);
}
