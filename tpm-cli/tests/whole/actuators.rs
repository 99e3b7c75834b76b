//! `tpm split`, `tpm actuator` and `tpm feedforward` as a user runs them: the example of Feng, section 6.3, and faults with
//! their remedies.

use crate::support::{drawn, fails, tpm};
use serde_json::Value;

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
    let text = std::fs::read_to_string(crate::support::root().join(name)).expect("shipped");
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
    fails(&["split", MODEL, "--value", "w=3"], 2, &["lambda1", "--value"]);
    fails(&["split", MODEL, "--motion", "G=x"], 2, &["no input `G`", "F, tau"]);
    fails(&["split", MODEL, "--motion", "F=y"], 2, &["no coordinate `y`", "x, theta"]);
    // The electrical side of a motor belongs to its shaft's motion.
    let motor = json(&["split", "models/brushless_motor.tpm", "--json"], 0);
    assert_eq!(motor["inputs"][1]["drives"][0], "phi");
    assert_eq!(motor["inputs"][1]["dependent"], "kv*dot(phi)");
}

#[test]
fn the_motors_of_the_example_fall_just_short() {
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
    let at = ["actuator", MODEL, "--motor", MOTORS, "--params", EXAMPLE, "--json", "--value", below.as_str()];
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
    fails(&["actuator", MODEL, "--motor", MOTORS, "--params", &path], 2, &["a value is missing for w", "--value"]);
    fails(&["actuator", MODEL, "--motor", MOTORS, "--params", EXAMPLE, "--plot", "a.pdf"], 2, &[".svg or .png"]);
}

#[test]
fn figure_6_5_is_reproduced_and_an_unstable_loop_is_not_run() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in drawn(&["figure.svg", "figure.png"]) {
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

const SLIDER: &str = "models/mass_spring_drag.tpm";
const AMPLIFIER: &str = "{ delay = 0.0035, natural_frequency = 250.0, quality = 0.8 }";
const QUIET: [&str; 4] = ["--set", "plant.sensors.x.noise=0", "--set", "plant.sensors.x.step=0"];

#[test]
fn experiments_take_motors_and_say_which_limit_ended_them() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let shipped =
        std::fs::read_to_string(crate::support::root().join("models/mass_spring_drag.toml")).expect("shipped");
    std::fs::write(path("experiment.toml"), format!("motors = \"motor.toml\"\n{shipped}")).expect("writable");
    let motor = "[motors.u]\ntorque_constant = 0.115\nresistance = 4\ninductance = 7.7e-3\npinion_radius = 0.02\n\
                 [motors.u.limits]\nvoltage = 40\n";
    std::fs::write(path("motor.toml"), motor).expect("writable");
    let experiment = path("experiment.toml");
    let run = |more: &[&str]| tpm(&[&["identify", SLIDER, "--experiment", &experiment], &QUIET[..], more].concat());
    let output = run(&[]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert!(
        text.contains("stated share of its limit: the voltage of u takes") && text.contains("by harmonic"),
        "{text}"
    );
    let found: Value = serde_json::from_slice(&run(&["--json"]).stdout).expect("JSON");
    assert_eq!((&found["stop"]["limit"], &found["stop"]["unit"]), (&Value::from("voltage"), &Value::from("V")));
    assert!(found["runs"][0]["limit"]["sample"].as_u64().is_some());
    // A campaign's folder holds the motor itself, so that it stands alone.
    let campaign = path("campaign");
    let started = tpm(&["campaign", "start", SLIDER, &campaign, "--experiment", &experiment]);
    assert_eq!(started.status.code(), Some(0), "{}", String::from_utf8_lossy(&started.stderr));
    let kept = std::fs::read_to_string(folder.path().join("campaign/experiment.toml")).expect("kept");
    assert!(kept.contains("[motors.u.limits]") && kept.contains("voltage = 40"), "{kept}");
    std::fs::remove_file(path("motor.toml")).expect("there");
    let next = tpm(&["campaign", "next", &campaign, "-o", &path("run.csv")]);
    assert_eq!(next.status.code(), Some(0), "{}", String::from_utf8_lossy(&next.stderr));
    // Faults have their place in the motor file, or in the experiment.
    let identify = ["identify", SLIDER, "--experiment", &experiment];
    fails(&identify, 2, &["motor.toml"]);
    std::fs::write(path("motor.toml"), motor.replace("resistance = 4", "resistance = -4")).expect("writable");
    fails(&identify, 2, &["motor.toml: line 3, column 14", "must be positive"]);
    std::fs::write(path("motor.toml"), motor.replace("pinion_radius = 0.02", "gear = 20")).expect("writable");
    fails(&identify, 2, &["motor.toml: line 5, column 8", "pinion_radius"]);
    std::fs::write(path("motor.toml"), motor.replace("motors.u", "motors.v")).expect("writable");
    fails(&identify, 2, &["motor.toml: line 1, column 9", "on no input"]);
    std::fs::write(path("experiment.toml"), format!("{shipped}\n{}", motor.replace("inductance = 7.7e-3\n", "")))
        .expect("writable");
    fails(&identify, 2, &["experiment.toml: line", "[motors.u] lacks `inductance` (H): add"]);
    std::fs::write(path("experiment.toml"), shipped.replace("sample_time = 1e-3", "")).expect("writable");
    fails(&identify, 2, &["missing field `sample_time`", "add `sample_time = ...`"]);
}

#[test]
fn known_dynamics_are_corrected_in_logs_too() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let log = folder.path().join("log.csv").display().to_string();
    let plant = format!("plant.actuators.u={AMPLIFIER}");
    let simulated = tpm(&[&["simulate", SLIDER, "-o", &log, "--set", &plant], &QUIET[..]].concat());
    assert_eq!(simulated.status.code(), Some(0), "{}", String::from_utf8_lossy(&simulated.stderr));
    let identified = |more: &[&str]| {
        let found = json(&[&["identify", SLIDER, "--log", &log, "--hold", "zoh", "--json"], more].concat(), 0);
        let worst = [2.0, 40.0, 1.5]
            .iter()
            .enumerate()
            .map(|(i, truth)| (found["parameters"][i]["value"].as_f64().expect("identified") / truth - 1.0).abs());
        (worst.fold(0.0, f64::max), found["residual"].as_f64().expect("a number"), found["log"]["actuators"].clone())
    };
    let (error, residual, known) = identified(&["--delay", "u=0.0035", "--low-pass", "u=250:0.8"]);
    assert!(error < 1e-6 && residual < 1e-6, "{error:e} {residual:e}");
    assert_eq!((known["u"]["delay"].as_f64(), known["u"]["low_pass"][1].as_f64()), (Some(0.0035), Some(0.8)));
    let (error, residual, _) = identified(&[]);
    assert!(error > 1e-4 && residual > 1e-2, "{error:e} {residual:e}");
    let motor = folder.path().join("motor.toml").display().to_string();
    let text = "[motors.u]\ntorque_constant = 0.1\nresistance = 1\ninductance = 1e-3\n[motors.u.amplifier]\n\
                natural_frequency = 250\nquality = 0.8\n";
    std::fs::write(&motor, text).expect("writable");
    let (error, ..) = identified(&["--delay", "u=0.0035", "--motor", &motor]);
    assert!(error < 1e-6, "{error:e}");
    let text = tpm(&["identify", SLIDER, "--log", &log, "--hold", "zoh", "--delay", "u=0.0035", "--motor", &motor]);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    assert!(text.contains("corrected behind u: a delay of 0.0035 s, a low pass of 250 rad/s"), "{text}");
    let refused =
        |more: &[&str], parts: &[&str]| fails(&[&["identify", SLIDER, "--log", &log], more].concat(), 2, parts);
    refused(&["--delay", "v=1"], &["--delay v", "there are u"]);
    refused(&["--delay", "u=-1"], &["must not be negative"]);
    refused(&["--low-pass", "u=fast"], &["`fast` is not a positive number"]);
}

#[test]
fn filters_are_generated_or_refused_with_a_reason() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().display().to_string();
    fn generate<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
        [&["generate", MODEL, "--lang", "c", "-o", out], more].concat()
    }
    let output = tpm(&generate(&out, &["--filter", "100:1", "--sample-time", "1e-3"]));
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let header = std::fs::read_to_string(folder.path().join("cart_pendulum.h")).expect("written");
    assert!(
        header.contains("--filter 100:1 --sample-time 1e-3") && header.contains("cart_pendulum_split_feed_forward(")
    );
    let check = tpm(&generate(&out, &["--filter", "100:1", "--sample-time", "1e-3", "--check"]));
    assert_eq!(check.status.code(), Some(0));
    fails(&generate(&out, &["--filter", "100"]), 2, &["--sample-time"]);
    fails(&generate(&out, &["--filter", "4000", "--sample-time", "1e-3"]), 2, &["4000 rad/s", "two samples"]);
    fails(&generate(&out, &["--filter=-100", "--sample-time", "1e-3"]), 2, &["natural frequency", "positive"]);
    fails(&generate(&out, &["--filter", "100:fast", "--sample-time", "1e-3"]), 2, &["`fast` is not a number"]);
}

/// The motion takes an eighth of the force: it is noise in the feedback that meets the limit, in a counted number of samples.
#[test]
fn inputs_cut_by_noise_are_told_from_motions_that_are_too_large() {
    let slider = "models/mass_spring_drag.tpm";
    let found = |others: &[&str]| {
        let command = ["identify", slider, "--json", "--set", "refine=none", "--set", "actuators.u.force=60"];
        json(&command.iter().chain(others).copied().collect::<Vec<&str>>(), 1)
    };
    // A speed of which the motion takes more is not to blame either.
    for others in [&[][..], &["--set", "actuators.u.speed=1"]] {
        let stop = &found(others)["stop"];
        assert_eq!((stop["limit"].as_str(), stop["available"].as_f64()), (Some("force"), Some(60.0)), "{stop}");
        assert!(stop["share"].as_f64().is_some_and(|share| (0.1..0.2).contains(&share)), "{stop}");
        let count = |name: &str| stop["cut"][name].as_u64().expect("a number of samples");
        let (cut, of) = (count("samples"), count("of"));
        assert!(cut > 0 && cut < of && of > 20_000, "{stop}");
    }
    let output = tpm(&["identify", slider, "--set", "refine=none", "--set", "actuators.u.force=60"]);
    let text = String::from_utf8_lossy(&output.stdout);
    for said in ["samples of the run, at 60 N for the force of u", "sensors' noise and rounding", "lower its gains"] {
        assert!(text.contains(said), "{text}");
    }
    // A motion that takes more than the force is cut by itself.
    let weak = json(&["identify", slider, "--json", "--set", "refine=none", "--set", "actuators.u.force=5"], 1);
    assert!(weak["stop"]["cut"].is_null(), "{}", weak["stop"]);
}
