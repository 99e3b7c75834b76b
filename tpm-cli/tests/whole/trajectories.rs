//! `tpm trajectories` as a user runs it: the claim of Feng, chapter 2, in numbers and pictures, and faults with their remedies.

use crate::support::{drawn, fails, names, printed, printed_in, root, tpm};
use serde_json::Value;

const MODEL: &str = "models/mass_spring_drag.tpm";
const VALUES: [&str; 10] = [
    "--value",
    "m=2",
    "--value",
    "k1=40",
    "--value",
    "k2=1.5",
    "--value",
    "lambda=0.3",
    "--value",
    "w=6.283185307179586",
];

fn arguments<'a>(more: &[&'a str]) -> Vec<&'a str> {
    ["trajectories", MODEL].into_iter().chain(VALUES).chain(more.iter().copied()).collect()
}

#[test]
fn the_pattern_needs_fewer_harmonics_than_any_law_beside_it() {
    let found: Value = serde_json::from_str(&printed(&arguments(&["--json"]))).expect("JSON");
    assert_eq!(found["schema"], "tpm.trajectories/1");
    let motions = found["motions"].as_array().expect("a list");
    let names: Vec<&str> = motions.iter().map(|motion| motion["name"].as_str().expect("a name")).collect();
    assert_eq!(names, ["pattern", "3-4-5 polynomial", "cycloid", "trapezoid"]);
    let highest: Vec<u64> =
        motions.iter().map(|motion| motion["inputs"][0]["highest"].as_u64().expect("a harmonic")).collect();
    assert_eq!(highest[0], 6);
    assert!(highest[1..].iter().all(|highest| *highest > 20), "{highest:?}");
    let line = |motion: usize, k: usize| motions[motion]["inputs"][0]["harmonics"][k].as_f64().expect("a number");
    // Feng, Eqn 3.26 in numbers: the third harmonic of the force is m lambda w^2 - k1 lambda/9.
    let w = 2.0 * std::f64::consts::PI;
    assert!((line(0, 3) - (2.0 * 0.3 * w * w - 40.0 * 0.3 / 9.0)).abs() < 1e-9);
    assert!(line(0, 7) < 1e-9 && line(3, 7) > 2.9);
    // The travel is the same for all.
    for motion in motions {
        assert!((motion["coordinates"][0]["travel"].as_f64().expect("a number") - 1.6 / 3.0).abs() < 1e-12);
    }
    let text = printed(&arguments(&[]));
    assert!(text.contains("u: the pattern needs harmonics up to 6") && text.contains("trapezoid"), "{text}");
    let csv = printed(&arguments(&["--format", "csv"]));
    assert!(csv.starts_with("input,harmonic,pattern,3-4-5 polynomial,cycloid,trapezoid\nu,0,2.96"), "{csv}");
    let markdown = printed(&arguments(&["--format", "markdown", "--harmonics", "3"]));
    assert!(markdown.contains("| u | 3 |") && !markdown.contains("| u | 4 |"), "{markdown}");
}

#[test]
fn figures_are_drawn_as_svg_and_png() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = root().join(MODEL).display().to_string();
    for name in drawn(&["figure.svg", "figure.png"]) {
        let values = VALUES.into_iter().chain(["--plot", name]);
        let arguments: Vec<&str> = ["trajectories", &model].into_iter().chain(values).collect();
        printed_in(folder.path(), &arguments, 0);
    }
    assert_eq!(names(folder.path()), drawn(&["figure.png", "figure.svg"]));
    let svg = std::fs::read_to_string(folder.path().join("figure.svg")).expect("text");
    for label in ["time [s]", "u [N]", "harmonics of u [N]", "trapezoid"] {
        assert!(svg.contains(label), "{label}");
    }
}

#[test]
fn a_law_that_no_finite_input_makes_is_named() {
    let values = ["m1=1", "m2=1", "k1=10", "k2=5", "k3=500", "lambda=0.1", "w=6"];
    let sets = values.iter().flat_map(|value| ["--value", value]);
    let output = tpm(&["trajectories", "models/two_carts.tpm"].into_iter().chain(sets).collect::<Vec<_>>());
    let text = String::from_utf8_lossy(&output.stdout);
    let said = "trapezoid: no finite input makes it, since the inputs depend on derivative 4 of the motion";
    assert!(text.contains(said), "{text}");
}

#[test]
fn strokes_that_end_with_a_velocity_or_nowhere_are_refused() {
    fails(&arguments(&["--end", "1.5"]), 2, &["x has the velocity -", "nothing follows", "--end"]);
    fails(&arguments(&["--end", "6.283185307179586"]), 2, &["x ends where it begins", "--end"]);
    fails(&arguments(&["--end", "-1"]), 2, &["--end -1"]);
    fails(&arguments(&["--plot", "figure.txt"]), 2, &[".svg or .png"]);
    fails(&["trajectories", MODEL, "--value", "m=2"], 2, &["k1, k2, lambda, w", "--value"]);
}

/// A folder with a path from 0.1 m to 0.5 m along a smooth law, in one second.
fn path(law: impl Fn(f64) -> f64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let row = |n: u32| format!("{},{}\n", f64::from(n) / 100.0, 0.1 + 0.4 * law(f64::from(n) / 100.0));
    let text = (0..=100).map(row).fold("t_s,x\n".to_owned(), |text, row| text + &row);
    std::fs::write(folder.path().join("path.csv"), text).expect("writable");
    folder
}

#[test]
fn a_pattern_fitted_to_a_path_is_a_part_of_a_model() {
    let folder = path(|tau| tau - (2.0 * std::f64::consts::PI * tau).sin() / (2.0 * std::f64::consts::PI));
    let model = root().join(MODEL);
    let shipped = model.display().to_string();
    let fit = |highest: &str| {
        printed_in(folder.path(), &["trajectories", &shipped, "--path", "path.csv", "--highest", highest, "--json"], 0)
    };
    let of = |text: &str| -> Value { serde_json::from_str(text).expect("JSON") };
    let (few, more) = (of(&fit("3")), of(&fit("7")));
    assert_eq!(few["schema"], "tpm.path/1");
    let rms = |found: &Value| found["coordinates"][0]["rms"].as_f64().expect("a number");
    assert!(rms(&few) < 0.02 && rms(&more) < 0.5 * rms(&few), "{} {}", rms(&few), rms(&more));
    assert!((few["frequency"].as_f64().expect("a number") - std::f64::consts::PI).abs() < 1e-9);
    // The text of the pattern is a pattern of the model.
    let text = std::fs::read_to_string(&model).expect("the model");
    let (before, _) = text.split_once("pattern {").expect("a pattern");
    let whole = format!("{before}{}}}\n", more["pattern"].as_str().expect("text"));
    std::fs::write(folder.path().join("fitted.tpm"), whole).expect("writable");
    printed_in(folder.path(), &["check", "fitted.tpm"], 0);
    let plain = printed_in(folder.path(), &["trajectories", &shipped, "--path", "path.csv", "--plot", "path.svg"], 0);
    assert!(plain.contains("pattern = \"fitted\", x_size = 0.2, w = 3.14159"), "{plain}");
    let path = folder.path().join("path.csv").display().to_string();
    fails(&["trajectories", MODEL, "--path", &path, "--highest", "2"], 2, &["least that can go up to 3", "--highest"]);
    fails(&["trajectories", "models/two_carts.tpm", "--path", &path], 2, &["x2"]);
}
