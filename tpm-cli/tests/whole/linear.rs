//! `tpm linearize`, `tpm frf` and `tpm fit` as a user runs them: numbers of Fong's equations, and faults with their remedies.

use crate::support::{drawn, fails, printed, tpm};
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

const UP: &str = "models/rotary_pendulum.tpm";
const DOWN: &str = "models/rotary_pendulum_down.tpm";
const TABLE_1: &str = "models/rotary_pendulum_table1.toml";
/// Fong, Eqn 29, highest power first.
const EQN_29: &str = "0.0277,-24.92,-323.4,164.6/1,15.28,200.6,1589,6548";

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&printed(arguments)).expect("JSON")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number")).collect()
}

fn roots(value: &Value) -> Vec<(f64, f64)> {
    let part = |root: &Value, name: &str| root[name].as_f64().expect("a number");
    value.as_array().expect("a list").iter().map(|root| (part(root, "re"), part(root, "im"))).collect()
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
}

#[test]
fn fong_24_and_28_from_the_shipped_models() {
    // Eqn 24 as printed; Eqn 28 follows from Eqn 27, its numbers are not legible.
    let eqn_24 = [[5.9796, -8.1419, -0.1098, 28.8442], [57.6254, -6.9788, -1.0584, 24.7236]];
    let eqn_28 = [[5.9797, -8.1420, 0.1098, 28.845], [-57.626, 6.9789, -1.0584, -24.725]];
    for (model, expected) in [(UP, eqn_24), (DOWN, eqn_28)] {
        let found = json(&["linearize", model, "--params", TABLE_1, "--json"]);
        assert_eq!(found["numbers"]["exact"], true);
        for (i, row) in expected.iter().enumerate() {
            let a = numbers(&found["numbers"]["a"][2 + i]);
            let b = numbers(&found["numbers"]["b"][2 + i]);
            assert_eq!(a[0], 0.0);
            for (found, printed) in a[1..].iter().chain(&b).zip(row) {
                close(*found, *printed, if printed.abs() < 1.0 { 5e-5 } else { 1e-4 * printed.abs() });
            }
        }
    }
    // The upright model about th2 = pi hangs down: the same numbers as the model of Eqn 26.
    let turned = json(&["linearize", UP, "--at", "th2=pi", "--params", TABLE_1, "--json"]);
    let down = json(&["linearize", DOWN, "--params", TABLE_1, "--json"]);
    assert_eq!(turned["numbers"], down["numbers"]);
    assert_eq!(turned["point"]["th2"], "pi");
}

#[test]
fn transfer_functions_of_the_pendulum_and_what_cancels() {
    let found = json(&["linearize", DOWN, "--measured", "alpha2", "--params", TABLE_1, "--json"]);
    let [function] = found["transfer_functions"].as_array().expect("a list").as_slice() else { panic!("one") };
    // G = -24.72 s/(s^3 + 9.200 s^2 + 65.48 s + 427.5)
    assert_eq!(function["exact"]["cancelled_powers_of_s"], 1);
    assert_eq!(function["exact"]["numerator"].as_array().map(Vec::len), Some(2));
    let g = &function["numbers"];
    let (above, below) = (numbers(&g["numerator"]), numbers(&g["denominator"]));
    assert_eq!((above.len(), below.len(), above[0]), (2, 4, 0.0));
    close(above[1], -24.725, 1e-3);
    for (found, (printed, digit)) in below.iter().zip([(427.5, 0.1), (65.48, 0.01), (9.2, 1e-3), (1.0, 0.0)]) {
        close(*found, printed, 0.5 * digit);
    }
    assert_eq!(roots(&g["cancelled"]), [(0.0, 0.0)]);
    assert_eq!(roots(&g["zeros"]), [(0.0, 0.0)]);
    assert_eq!(g["static_gain"], 0.0);
    let poles = roots(&g["poles"]);
    for (re, im) in &poles {
        let (mut value, mut power) = ((0.0, 0.0), (1.0, 0.0));
        for c in &below {
            value = (value.0 + c * power.0, value.1 + c * power.1);
            power = (power.0 * re - power.1 * im, power.0 * im + power.1 * re);
        }
        assert!(value.0.hypot(value.1) < 1e-9, "{re} {im}");
    }
    assert_eq!(poles.len(), 3);
    // Upright: one pole in the right half plane.
    let up = json(&["linearize", UP, "--params", TABLE_1, "--json"]);
    assert_eq!(roots(&up["numbers"]["poles"]).iter().filter(|(re, _)| *re > 0.0).count(), 1);
    let text = printed(&["linearize", DOWN, "--params", TABLE_1]);
    for line in ["a factor s above and below has cancelled: alpha2 does not show a pole at 0", "static gain: 0"] {
        assert!(text.lines().any(|other| other == line), "{text}");
    }
}

/// The parametric model that the paper prints beside its derived one does not describe the same machine.
#[test]
fn fong_29_is_not_consistent_with_28() {
    let arguments = ["linearize", DOWN, "--params", TABLE_1, "--measured", "alpha2", "--against", EQN_29];
    let band = ["--low", "0.2", "--high", "23"];
    let found = json(&[&arguments[..], &band[..], &["--json"]].concat());
    let other = &found["beside"];
    let expected = [(-6.48, -4.05), (-6.48, 4.05), (-1.16, -10.53), (-1.16, 10.53)];
    for (found, expected) in roots(&other["poles"]).iter().zip(expected) {
        close(found.0, expected.0, 5e-3);
        close(found.1, expected.1, 5e-3);
    }
    // Static gain 164.6/6548 in place of 0: an angle off the vertical at rest, which gravity does not allow.
    close(other["static_gain"].as_f64().expect("finite"), 0.025, 5e-4);
    assert_eq!(other["consistent"], false);
    assert!(other["median_difference"].as_f64().expect("finite") > 0.1);
    let text = printed(&[&arguments[..], &band[..]].concat());
    assert!(text.contains("the two are not consistent: from 0.2 to 23 Hz"), "{text}");
    // Figure 6 without the measurement: both as curves.
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("bode.svg");
    printed(&[&arguments[..], &band[..], &["--plot", path.to_str().expect("UTF-8")]].concat());
    let picture = std::fs::read_to_string(&path).expect("drawn");
    for text in ["Magnitude [rad/V]", "Phase [deg]", "Frequency [Hz]", "model", "beside", "alpha2 over e"] {
        assert!(picture.contains(text), "{text}");
    }
    // A model compared with its own transfer function is consistent.
    let same = json(&[
        "linearize",
        DOWN,
        "--params",
        TABLE_1,
        "--measured",
        "alpha2",
        "--json",
        "--against",
        "-24.725,0/1,9.2003,65.481,427.52",
    ]);
    assert_eq!(same["beside"]["consistent"], true);
}

#[test]
fn faults_of_a_linearisation_name_their_remedy() {
    fails(&["linearize", UP, "--at", "th2=pi/2"], 2, &["no equilibrium", "equation eq2", "-49*m2*c2/5"]);
    fails(&["linearize", UP, "--at", "th3=1"], 2, &["no such coordinate or input", "th1, th2, e"]);
    fails(&["linearize", UP, "--at", "th2=2 pi"], 2, &["--at th2:1:3", "`pi` is not expected here"]);
    fails(&["linearize", UP, "--at", "th2=thh"], 2, &["`thh` is no parameter or constant", "it has"]);
    fails(&["linearize", UP, "--value", "m2=1"], 2, &["values are missing", "--value Rm=VALUE"]);
    fails(&["linearize", UP, "--value", "m9=1"], 2, &["no parameter or run-time constant `m9`", "Rm"]);
    fails(&["linearize", UP, "--value", "g=9.81"], 2, &["`g` is fixed to 49/5"]);
    fails(&["linearize", UP, "--value", "m2=heavy"], 2, &["write a number"]);
    fails(&["linearize", UP, "--params", "models/none.toml"], 2, &["cannot read"]);
    fails(&["linearize", UP, "--params", UP], 2, &[UP]);
    fails(&["linearize", UP, "--params", TABLE_1, "--against", "1/1,1"], 2, &["--measured"]);
    fails(&["linearize", UP, "--measured", "th1", "--against", "1/1,1"], 2, &["--params FILE"]);
    fails(&["linearize", UP, "--params", TABLE_1, "--plot", "bode.svg"], 2, &["--plot needs one", "--measured"]);
    fails(&["linearize", UP, "--params", TABLE_1, "--plot", "bode.pdf"], 2, &[".svg or .png"]);
    fails(&["linearize", UP, "--params", TABLE_1, "--low", "1"], 2, &["--plot"]);
    fails(&["linearize", "models/mass_spring_drag.tpm", "--input", "v"], 2, &["it has u"]);
    fails(&["linearize", "models/emps.tpm"], 2, &["no equilibrium", "OF"]);
}

/// A log of a resonance at 2 Hz under held noise: y'' = 158 (u - y) - 2 y'.
fn log(folder: &Path, samples: usize) -> PathBuf {
    let mut state = 12_345_u64;
    let (mut x, mut v, mut u) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut text = "t_s,u,y,idle\n".to_owned();
    for i in 0..samples {
        if i % 5 == 0 {
            // A linear congruential generator is random enough to excite.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            u = (state >> 40) as f64 / f64::from(1_u32 << 24) - 0.5;
        }
        text.push_str(&format!("{},{u},{x},0\n", i as f64 / 100.0));
        for _ in 0..20 {
            let h = 0.01 / 20.0;
            let (xm, vm) = (x + 0.5 * h * v, v + 0.5 * h * (158.0 * (u - x) - 2.0 * v));
            x += h * vm;
            v += h * (158.0 * (u - xm) - 2.0 * vm);
        }
    }
    let path = folder.join(format!("log{samples}.csv"));
    std::fs::write(&path, text).expect("writable");
    path
}

#[test]
fn a_log_becomes_a_response_a_fit_and_a_figure() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = log(folder.path(), 30_000);
    let path = path.to_str().expect("a plain name");
    let signals =
        ["--input", "u", "--measured", "y", "--hold", "zoh", "--segment", "4096", "--low", "0.2", "--high", "8"];
    let figure = |name: &str| folder.path().join(name).to_str().expect("a plain name").to_owned();

    let svg = figure("bode.svg");
    let text = printed(&[&["frf", path, "--plot", &svg], &signals[..]].concat());
    assert!(text.contains("its lag of half a sample is corrected"), "{text}");
    let bode = std::fs::read_to_string(svg).expect("written");
    for label in ["Frequency [Hz]", "Magnitude", "Phase [deg]", "Coherence"] {
        assert!(bode.contains(label), "{label}");
    }
    let response = json(&[&["frf", path, "--format", "json"], &signals[..]].concat());
    assert_eq!((&response["schema"], &response["hold"]), (&"tpm.frf/1".into(), &"zoh".into()));
    assert!(response["hold_effect"]["median"].as_f64().expect("a number") > 0.05);
    let csv = printed(&[&["frf", path, "--format", "csv"], &signals[..]].concat());
    assert_eq!(csv.lines().count() - 1, response["lines"].as_array().expect("lines").len());

    let png = drawn(&["fit.png"]).pop();
    let plot = figure(png.unwrap_or("fit.svg"));
    let fit = json(&[&["fit", path, "--order", "0/1,0/2,1/2", "--json", "--plot", &plot], &signals[..]].concat());
    assert!(std::fs::read(&plot).expect("written").starts_with(if png.is_some() { b"\x89PNG" } else { b"<svg" }));
    assert_eq!(fit["recommended"], serde_json::json!({"numerator": 0, "denominator": 2}));
    let poles = roots(&fit["rational"]["poles"]);
    close(poles[1].0.hypot(poles[1].1), 158.0_f64.sqrt(), 0.05);
    close(fit["rational"]["static_gain"]["value"].as_f64().expect("finite"), 1.0, 0.02);

    // The parameters of this machine: the response shows their ratios only, so that one is held.
    let model = folder.path().join("resonance.tpm");
    let source = "model Resonance {\n coordinate y [m];\n input u [N];\n parameter m [kg], d [N*s/m], k [N/m], b [1];\n \
                  m*ddot(y) + d*dot(y) + k*y = b*u;\n}\n";
    std::fs::write(&model, source).expect("writable");
    let model = model.to_str().expect("a plain name");
    let start = ["--start", "d=1", "--start", "k=100", "--start", "b=100"];
    let held = [&["fit", path, "--model", model, "--freeze", "m=1", "--json"], &start[..], &signals[..]].concat();
    let found = json(&held);
    for (parameter, (truth, tolerance)) in found["model"]["parameters"].as_array().expect("a list")[1..].iter().zip([
        (2.0, 0.15),
        (158.0, 1.0),
        (158.0, 3.0),
    ]) {
        close(parameter["value"].as_f64().expect("identified"), truth, tolerance);
        assert!(parameter["std"].as_f64().expect("known") > 0.0);
    }
    // Start values from a file lead to this result too; a value on the command line goes before that of the file.
    let table = folder.path().join("start.toml");
    std::fs::write(&table, "m = 3\nd = 1\nk = 7\nb = 100\n").expect("writable");
    let table = table.to_str().expect("a plain name");
    let filed = ["fit", path, "--model", model, "--params", table, "--freeze", "m=1", "--start", "k=100", "--json"];
    assert_eq!(json(&[&filed, &signals[..]].concat())["model"], found["model"]);
    // The fit to the transform of the whole record uses the lines between the averaged ones too.
    let whole = json(&[&["fit", path, "--order", "0/2", "--whole", "--json"], &signals[..]].concat());
    let poles = roots(&whole["rational"]["poles"]);
    close(poles[1].0.hypot(poles[1].1), 158.0_f64.sqrt(), 0.05);
    assert_eq!(whole["rational"]["lines"], 2341, "from 0.2 to 8 Hz, 1/300 Hz apart");
    let free = [&["fit", path, "--model", model, "--start", "m=1"], &start[..], &signals[..]].concat();
    fails(&free, 1, &["3 independent combinations of 4 free parameters"]);
}

/// Read backwards in time a damped machine is an unstable one.
#[test]
fn an_unstable_fit_is_no_success() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let forwards = std::fs::read_to_string(log(folder.path(), 12_000)).expect("written");
    let rows: Vec<&str> = forwards.lines().skip(1).collect();
    let backwards = rows.iter().zip(rows.iter().rev()).map(|(time, row)| {
        let signals = row.split_once(',').expect("a row").1;
        format!("{},{signals}\n", time.split(',').next().expect("a time"))
    });
    let path = folder.path().join("backwards.csv");
    std::fs::write(&path, format!("t_s,u,y,idle\n{}", backwards.collect::<String>())).expect("writable");
    let path = path.to_str().expect("a plain name");
    let signals = ["--input", "u", "--measured", "y", "--segment", "2048", "--low", "0.3", "--high", "6"];
    let one = [&["fit", path, "--order", "0/2"], &signals[..]].concat();
    fails(&one, 1, &["the fit is unstable: pole at"]);
    assert!(String::from_utf8_lossy(&tpm(&one).stdout).contains("transfer function of order 0/2"));
    // Several orders, none of which can be recommended, still give JSON.
    let output = tpm(&[&["fit", path, "--order", "0/2,1/2", "--json"], &signals[..]].concat());
    assert_eq!(output.status.code(), Some(1));
    let found: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(found["recommended"].is_null() && found["orders"].as_array().expect("a list").len() == 2, "{found}");
    assert!(found["orders"][0]["doubtful"] == true && found["rational"].is_null(), "{found}");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("none of the orders can be recommended"), "{said}");
    // Every order has its reason, without a deviation that is infinite.
    for order in ["0/2: ", "1/2: "] {
        let reason = said.lines().find_map(|line| line.split_once(order));
        assert!(reason.is_some_and(|(_, reason)| !reason.is_empty() && !reason.contains("inf")), "{order}{said}");
    }
}

#[test]
fn faults_of_a_log_name_their_remedy() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = log(folder.path(), 3000);
    let path = path.to_str().expect("a plain name");
    let of = |verb: &'static str, more: &[&'static str]| -> Vec<String> {
        [&[verb, path, "--input", "u", "--measured", "y"], more]
            .concat()
            .iter()
            .map(|text| (*text).to_owned())
            .collect()
    };
    let fault = |arguments: Vec<String>, said: &[&str]| {
        fails(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), 2, said);
    };
    fault(of("frf", &["--segment", "4000"]), &["the record has 3000 samples", "at most 2000 samples"]);
    fault(of("frf", &["--low", "9", "--high", "3"]), &["must rise"]);
    fault(of("frf", &["--plot", "bode.pdf"]), &[".svg or .png"]);
    fault(of("fit", &["--order", "3"]), &["M/N"]);
    fault(of("fit", &["--order", "6/8", "--low", "1", "--high", "1.5"]), &["lower the order"]);
    fault(of("fit", &[]), &["--order"]);
    fails(&["frf", path, "--input", "u", "--measured", "u"], 2, &["name two signals"]);
    fails(&["frf", path, "--input", "idle", "--measured", "y"], 2, &["column `idle` is 0 throughout"]);
    fails(&["frf", path, "--input", "w", "--measured", "y"], 2, &["w"]);
    // Times that are not uniform, and an output that has nothing to do with the input.
    let uneven = folder.path().join("uneven.csv");
    let rows: String =
        (0..500).map(|i| format!("{},{},{}\n", f64::from(i) + f64::from(i % 7) * 0.3, i % 3, i % 5)).collect();
    std::fs::write(&uneven, format!("t_s,u,y\n{rows}")).expect("writable");
    fails(
        &["frf", uneven.to_str().expect("plain"), "--input", "u", "--measured", "y"],
        2,
        &["uneven.csv:9: time advances by", "resample the log evenly"],
    );
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / TAU
    };
    let apart: String = (0..4000).map(|i| format!("{i},{},{}\n", random(), random())).collect();
    let unrelated = folder.path().join("unrelated.csv");
    std::fs::write(&unrelated, format!("t_s,u,y\n{apart}")).expect("writable");
    let unrelated = unrelated.to_str().expect("plain");
    let band = ["--low", "0.05", "--high", "0.4", "--order", "0/1"];
    let arguments = [&["fit", unrelated, "--input", "u", "--measured", "y"], &band[..]].concat();
    let output = tpm(&arguments);
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(
        said.contains("no usable response") || said.contains("usable response: the band was not excited"),
        "{said}"
    );
}

/// Six joints whose links weigh nothing in an orbit are at rest anywhere, and their mass matrix has no short inverse.
#[test]
fn arms_that_are_too_long_for_symbols_are_refused_at_once() {
    let arm = |joints: usize, inertia: &str| {
        let list = |of: &dyn Fn(usize) -> String| (1..=joints).map(of).collect::<Vec<_>>().join(", ");
        let mut text = format!(
            "model Arm {{ coordinate {}; input {}; mechanism {{ gravity (0, 0, 0);\n",
            list(&|i| format!("q{i} [rad]")),
            list(&|i| format!("tau{i} [N*m]"))
        );
        for i in 1..=joints {
            let on = if i > 1 { format!(" on l{}", i - 1) } else { String::new() };
            let axis = ["z", "y", "x"][i % 3];
            text += &format!("body l{i}{on} {{ revolute q{i} about {axis} at (0.3, 0, 0.1); inertia {inertia}; }}\n");
            text += &format!("drive q{i} by tau{i};\n");
        }
        text + "} }\n"
    };
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: String| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a model");
        path.display().to_string()
    };
    let began = std::time::Instant::now();
    let (six, fourteen) = (write("six.tpm", arm(6, "parameters")), write("fourteen.tpm", arm(14, "parameters")));
    let said = ["beyond 1e5", "hold joints that need not move", "known inertias"];
    fails(&["linearize", &six], 2, &said);
    fails(&["regulate", &six, "--sample-time", "0.001"], 2, &said);
    fails(&["split", &fourteen], 2, &["up to 1e6", "hold joints that need not move"]);
    // Known inertias are numbers.
    let known = "mass 1.5 at (0.1, 0.02, 0) moments (0.02, 0, 0, 0.03, 0, 0.025)";
    let found = json(&["linearize", &write("known.tpm", arm(6, known)), "--json"]);
    assert_eq!(found["state"].as_array().map(Vec::len), Some(12), "{found}");
    assert!(began.elapsed().as_secs() < 60, "{:?}", began.elapsed());
}
