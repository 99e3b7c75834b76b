//! Masses and springs from a log of the far cart alone: two carts, whose driven cart is eliminated (Feng, Eqns 4.30-4.41).

use crate::support::tpm;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Output;

/// m1, m2, k1, k2, k3.
const TRUTH: [f64; 5] = [2.0, 1.5, 30.0, 400.0, 200.0];

fn identify(arguments: &[&str]) -> Output {
    tpm(&[&["identify", "models/two_carts.tpm"], arguments].concat())
}

/// The rest-to-rest motion of order 5 and the force that it needs, by the equations of the two carts themselves, with errors of some size.
fn log(folder: &Path, mass: f64, errors: f64) -> PathBuf {
    let [_, m2, k1, k2, k3] = TRUTH;
    let (lambda, w, samples, periods) = (0.4, 3.0, 256, 6);
    let mut text = String::from("t_s,x2,F\n");
    for n in 0..samples * periods {
        let phase = std::f64::consts::TAU * n as f64 / samples as f64;
        let derivative = |order: i32| -> f64 {
            let lines = [(1.0, 1.0), (3.0, -1.0 / 6.0), (5.0, 1.0 / 50.0)];
            let quarter = f64::from(order) * std::f64::consts::FRAC_PI_2;
            lines.iter().map(|(h, a): &(f64, f64)| lambda * a * (h * w).powi(order) * (h * phase + quarter).cos()).sum()
        };
        let rho = m2 / k3;
        let (x1, x1_dd) = (derivative(0) + rho * derivative(2), derivative(2) + rho * derivative(4));
        let error = errors * (0.7 * (n * n) as f64).sin();
        let force = mass * x1_dd + k1 * x1 + k2 * x1.powi(3) + m2 * derivative(2) + error;
        writeln!(text, "{},{},{force}", n as f64 * std::f64::consts::TAU / (w * f64::from(samples)), derivative(0))
            .expect("a string");
    }
    let path = folder.join("log.csv");
    std::fs::write(&path, text).expect("a file");
    path
}

#[test]
fn masses_and_springs_follow_from_the_far_cart_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = log(folder.path(), TRUTH[0], 0.0);
    let run = identify(&["--log", path.to_str().expect("plain"), "--json"]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let result: serde_json::Value = serde_json::from_slice(&run.stdout).expect("JSON");
    let physical = result["physical"].as_array().expect("a list");
    assert_eq!(physical.len(), 5);
    for ((parameter, name), truth) in physical.iter().zip(["m1", "m2", "k1", "k2", "k3"]).zip(TRUTH) {
        assert_eq!(parameter["name"], name);
        let value = parameter["value"].as_f64().expect("identified");
        assert!((value / truth - 1.0).abs() < 1e-6, "{parameter}");
    }
    // The table for reading shows both.
    let run = identify(&["--log", path.to_str().expect("plain")]);
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(text.contains("physical parameters") && text.contains("c7"), "{text}");
}

#[test]
fn a_negative_mass_is_no_success() {
    let folder = tempfile::tempdir().expect("a folder");
    // Without errors every relation of the lumped parameters is infinitely sharp, and where the fit ends is chance.
    let path = log(folder.path(), -TRUTH[0], 0.07);
    let path = path.to_str().expect("plain");
    let run = identify(&["--log", path]);
    let (text, error) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(text.contains("m2 is held at its bound 0") && text.contains("not those of any machine"), "{text}{error}");
    let run = identify(&["--log", path, "--bound", "m1=:", "--bound", "m2=:"]);
    assert!(!String::from_utf8_lossy(&run.stdout).contains("bound"));
    let run = identify(&["--log", path, "--bound", "mass=0:"]);
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&run.stderr).contains("no physical parameter `mass`"));
    let run = identify(&["--log", path, "--bound", "m1=3:2"]);
    assert_eq!(run.status.code(), Some(2));
}

/// A log of the slider of Feng, Eqn 3.24, under a force that is given by position, rate and acceleration.
fn slider(folder: &Path, force: impl Fn(f64, f64, f64) -> f64) -> String {
    let (lambda, w, samples, periods) = (0.4, 3.0, 256, 6);
    let mut text = String::from("t_s,x,u\n");
    for n in 0..samples * periods {
        let phase = std::f64::consts::TAU * f64::from(n) / f64::from(samples);
        let x = lambda * (phase.cos() - (3.0 * phase).cos() / 9.0);
        let rate = -lambda * w * 4.0 / 3.0 * phase.sin().powi(3);
        let acceleration = -lambda * w * w * 4.0 * phase.sin().powi(2) * phase.cos();
        let t = f64::from(n) * std::f64::consts::TAU / (w * f64::from(samples));
        writeln!(text, "{t},{x},{}", force(x, rate, acceleration)).expect("a string");
    }
    let path = folder.join("slider.csv");
    std::fs::write(&path, text).expect("a file");
    path.to_str().expect("plain").to_owned()
}

#[test]
fn a_fit_that_no_machine_has_and_one_that_explains_nothing_are_no_success() {
    let folder = tempfile::tempdir().expect("a folder");
    let identify = |path: &str| {
        let run = tpm(&["identify", "models/mass_spring_drag.tpm", "--log", path]);
        let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (run.status.code(), said(&run.stdout), said(&run.stderr))
    };
    // A sign that is wrong fits exactly, with a negative mass.
    let path = slider(folder.path(), |x, rate, acceleration| -2.0 * acceleration + 40.0 * x + 1.5 * rate * rate);
    let (code, text, error) = identify(&path);
    assert_eq!(code, Some(1), "{text}{error}");
    assert!(text.contains("warning: m = -2") && error.contains("is negative"), "{text}{error}");
    assert!(text.lines().any(|line| line.starts_with("m ") && line.ends_with("untrusted")), "{text}");
    // Friction that the model lacks, stronger than every force that the model has.
    let path = slider(folder.path(), |x, rate, acceleration| 2.0 * acceleration + 40.0 * x + 60.0 * rate);
    let (code, text, error) = identify(&path);
    assert_eq!(code, Some(1), "{text}{error}");
    assert!(text.contains("is not explained by the model; terms"), "{text}{error}");
    assert!(text.contains("a term 60.0 * dot(x) in row u can take 100 %: viscous damping"), "{text}{error}");
}
