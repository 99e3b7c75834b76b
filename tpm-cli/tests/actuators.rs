//! `tpm split`, `tpm actuator` and `tpm feedforward` as a user runs them: the example of Feng, section 6.3, and faults with
//! their remedies.

mod support;

use serde_json::Value;
use support::{fails, tpm};

const MODEL: &str = "models/cart_pendulum.tpm";
const EXAMPLE: &str = "models/cart_pendulum_example.toml";
const MOTORS: &str = "models/cart_pendulum_motors.toml";
const LOOP: &str = "models/cart_pendulum_loop.toml";

fn json(arguments: &[&str], code: i32) -> Value {
    let output = tpm(arguments);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// A file of the folder `models`, changed, in a folder of its own.
fn changed(name: &str, from: &str, to: &str) -> (tempfile::TempDir, String) {
    let text = std::fs::read_to_string(support::root().join(name)).expect("shipped");
    assert!(text.contains(from), "{name} has no `{from}`");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("changed.toml");
    std::fs::write(&path, text.replacen(from, to, 1)).expect("writable");
    let path = path.display().to_string();
    (folder, path)
}

#[test]
fn split_prints_expressions_and_harmonics() {
    let found = json(&["split", MODEL, "--json"], 0);
    assert_eq!(found["inputs"][0]["drives"][0], "x");
    assert_eq!(found["inputs"][1]["input"], "tau");
    let entries = found["table"]["entries"].as_array().expect("the exact table");
    let part = |name: &str| entries.iter().filter(|entry| entry["equation"] == name).count();
    // F_MD = (M + m) x'' has the pattern's two harmonics; F_MI those of the Taylor polynomial.
    assert!(part("F_dependent") >= 2 && part("F_independent") > 10 && part("tau_dependent") == 2);
    let numbers = json(&["split", MODEL, "--params", EXAMPLE, "--harmonics", "60", "--json"], 0);
    let waves = numbers["waves"].as_array().expect("waves");
    let force = waves.iter().find(|wave| wave["part"] == "F_dependent").expect("there");
    // (M + m) lambda1 w^2 = 9.9 N at the fundamental.
    let first = force["harmonics"][0]["cos"].as_f64().expect("a number");
    assert!((first + 9.9).abs() < 1e-12, "{first}");
    let reaction = waves.iter().find(|wave| wave["part"] == "F_independent").expect("there");
    assert!(reaction["left_out"].as_f64().expect("a bound") < 5.0);
    fails(&["split", MODEL, "--set", "w=3"], 2, &["lambda1", "--set"]);
    fails(&["split", MODEL, "--motion", "G=x"], 2, &["no input `G`", "F, tau"]);
    fails(&["split", MODEL, "--motion", "F=y"], 2, &["no coordinate `y`", "x, theta"]);
    // The electrical side of a motor belongs to its shaft's motion.
    let motor = json(&["split", "models/brushless_motor.tpm", "--json"], 0);
    assert_eq!(motor["inputs"][1]["drives"][0], "phi");
    assert_eq!(motor["inputs"][1]["dependent"], "kv*dot(phi)");
}

#[test]
fn the_motors_of_the_example() {
    // 50 V are just not enough for the pendulum, even with the best gear; the cart's motor could follow.
    let found = json(&["actuator", MODEL, "--motor", MOTORS, "--params", EXAMPLE, "--json"], 1);
    let limits = |motor: usize, limit: usize| found["motors"][motor]["limits"][limit]["largest"].as_f64().expect("one");
    assert_eq!((&found["feasible"], &found["motors"][0]["feasible"]), (&Value::Bool(false), &Value::Bool(true)));
    assert!((limits(1, 1) - 50.9).abs() < 0.05, "{} V", limits(1, 1));
    let factor = &found["largest_factor"];
    assert_eq!((factor["limit"].as_str(), factor["input"].as_str()), (Some("voltage"), Some("tau")));
    let factor = factor["value"].as_f64().expect("feasible when smaller");
    assert!(factor > 0.9 && factor < 1.0, "{factor}");
    // Exactly at the largest frequency the limit is met, and just below it is kept.
    let end = found["largest_frequency"][2]["largest"]["value"].as_f64().expect("feasible when slower");
    let below = format!("w={}", end * (1.0 - 1e-9));
    let at = ["actuator", MODEL, "--motor", MOTORS, "--params", EXAMPLE, "--json", "--set", below.as_str()];
    let found = json(&at, 0);
    let share = found["motors"][1]["limits"][1]["share"].as_f64().expect("a share");
    assert!((share - 1.0).abs() < 1e-6, "{share}");
}

#[test]
fn direct_drive_is_infeasible_with_the_numbers() {
    let (_folder, path) = changed(MOTORS, "gear = 28", "gear = 1");
    fails(
        &["actuator", MODEL, "--motor", &path, "--params", EXAMPLE],
        1,
        &["the motor of tau cannot follow", "of 12.3 A", " at "],
    );
    let found = json(&["actuator", MODEL, "--motor", &path, "--params", EXAMPLE, "--json"], 1);
    let force = &found["motors"][1]["force"];
    let (wanted, stall) = (force["wanted"].as_f64().expect("one"), force["stall"].as_f64().expect("one"));
    assert!((wanted - 22.0).abs() < 0.5 && (stall - 1.41).abs() < 5e-3, "{wanted} {stall}");
}

#[test]
fn faults_of_motor_files_are_at_their_place() {
    let run = |from: &str, to: &str, said: &[&str]| {
        let (_folder, path) = changed(MOTORS, from, to);
        fails(&["actuator", MODEL, "--motor", &path, "--params", EXAMPLE], 2, said);
    };
    run("resistance = 4 ", "resistance = -4 ", &["line 8, column 14", "must be positive"]);
    run("inductance = 7.7e-3", "inductanse = 7.7e-3", &["line 9, column 1", "did you mean inductance?"]);
    run(
        "torque_constant = 0.115     # N m/A\n",
        "",
        &["line 5, column 9", "[motors.F] lacks `torque_constant` (N m/A)"],
    );
    run("[motors.F]", "[motors.G]", &["line 5, column 9", "on no input", "F, tau"]);
    run("pinion_radius = 0.02", "gear = 50", &["line 10, column 8", "`x` is in m", "pinion_radius"]);
    run("current = 12.3", "current = \"12.3 A\"", &["line 13, column 11", "finite number"]);
    let (_folder, path) = changed(EXAMPLE, "w = 3 ", "# w = 3 ");
    fails(&["actuator", MODEL, "--motor", MOTORS, "--params", &path], 2, &["a value is missing for w", "--set"]);
    fails(&["actuator", MODEL, "--motor", MOTORS, "--params", EXAMPLE, "--plot", "a.pdf"], 2, &[".svg or .png"]);
}

#[test]
fn figure_6_5_and_the_loop_that_is_not_run() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["figure.svg", "figure.png"] {
        let plot = folder.path().join(name).display().to_string();
        let found = json(&["feedforward", MODEL, "--loop", LOOP, "--params", EXAMPLE, "--plot", &plot, "--json"], 0);
        let error =
            |scheme: &str, what: &str| 1e3 * found["schemes"][scheme]["errors"]["x"][what].as_f64().expect("a number");
        let (common, split) = (error("common", "rms"), error("split", "rms"));
        assert!((common - 2.40).abs() < 0.05 * 2.40 && (split - 0.735).abs() < 0.05 * 0.735, "{common} {split}");
        assert!(common / split >= 3.0 && error("common", "peak") / error("split", "peak") >= 2.5);
        let bytes = std::fs::read(&plot).expect("drawn");
        assert!(bytes.starts_with(if name.ends_with("svg") { b"<svg" } else { b"\x89PNG" }));
    }
    let (_folder, path) = changed(LOOP, "feedback_filtered = false", "feedback_filtered = true");
    fails(
        &["feedforward", MODEL, "--loop", &path, "--params", EXAMPLE],
        2,
        &["unstable, so nothing was run", "poles at", "leave the feedback unfiltered"],
    );
    let (_folder, path) = changed(LOOP, "[filter]", "[plant]\nmass = 2\n\n[filter]");
    fails(&["feedforward", MODEL, "--loop", &path, "--params", EXAMPLE], 2, &["no parameter `mass`", "line "]);
}

#[test]
fn with_motors_the_common_feed_forward_meets_the_current_limit() {
    let found = json(&["feedforward", MODEL, "--loop", LOOP, "--params", EXAMPLE, "--motor", MOTORS, "--json"], 0);
    let current = |scheme: &str| {
        let limited = &found["schemes"][scheme]["limited"];
        ["F", "tau"].map(|input| limited[input]["current"].as_f64().expect("a share")).into_iter().fold(0.0, f64::max)
    };
    assert!((current("common") - 0.06).abs() < 0.01, "{}", current("common"));
    assert!(current("split") < 0.005, "{}", current("split"));
}
