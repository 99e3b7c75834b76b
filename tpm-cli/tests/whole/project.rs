//! Parameters of one model in those of another: the arm of Feng, chapter 5, between its links (Appendix A) and the quadratics.

use crate::support::{fails, printed, printed_in, root};
use serde_json::Value;
use std::f64::consts::PI;
use tpm_runtime::plant::simulated::{ArmGeometry, ClosedLoopArm};

const LINKS: &str = "models/linkages/closed_loop_arm_links.tpm";
const QUADRATICS: &str = "models/closed_loop_arm.tpm";
const VALUES: &str = "models/linkages/closed_loop_arm_links_values.toml";
/// The motion of the thesis: both joints on one pattern.
const THESIS: [&str; 6] = ["--value", "lambda1=-0.245393293", "--value", "lambda2=0.199491133", "--value", "w=2"];
/// Joint 1 on three times the frequency, joint 2 on twice.
const MULTIPLES: [&str; 2] = ["--experiment", "models/linkages/closed_loop_arm_links.toml"];
const TH20: f64 = 5.421_616_82;

/// The arm of closed_loop_arm.toml, with its torques in N m.
fn arm() -> ClosedLoopArm {
    ClosedLoopArm::new(ArmGeometry {
        lengths: [0.100445980, 0.437018273, 0.431160162, 0.100730344, 0.698343839],
        masses: [13.8171105, 14.5860601, 0.347198293, 14.5243601],
        centroids: [0.0232551886, 0.472033879, -0.00871691643, 0.354996550],
        inertias: [0.382864809, 0.553814730, 0.000659058087, 0.197504354],
        torque_scale: 1.0,
    })
}

fn parsed(text: &str) -> Value {
    serde_json::from_str(text).expect("JSON")
}

/// Values of the parameters by name.
fn values(found: &Value) -> Vec<(String, Option<f64>)> {
    let parameters = found["parameters"].as_array().expect("a list").iter();
    parameters.map(|entry| (entry["name"].as_str().expect("a name").to_owned(), entry["value"].as_f64())).collect()
}

/// What the links are made of.
fn links(name: &str) -> f64 {
    let text = std::fs::read_to_string(root().join(VALUES)).expect("readable");
    let table: toml::Table = text.parse().expect("TOML");
    table[name].as_float().expect("a number")
}

/// Every combination of a result with what it is of given parameters.
fn combinations(found: &Value, of: impl Fn(&str) -> f64) -> Vec<(f64, f64)> {
    let list = found["combinations"].as_array().expect("a list").iter();
    let sum = |shown: &Value| {
        let terms = shown["terms"].as_object().expect("terms").iter();
        terms.map(|(name, weight)| weight.as_str().expect("text").parse::<f64>().expect("a number") * of(name)).sum()
    };
    list.map(|shown| (shown["value"].as_f64().expect("a number"), sum(shown))).collect()
}

/// Solves a square system by elimination with pivots.
fn solve(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&a, &b| matrix[a][k].abs().total_cmp(&matrix[b][k].abs())).expect("rows");
        matrix.swap(k, pivot);
        right.swap(k, pivot);
        let own = matrix[k].clone();
        for row in k + 1..n {
            let factor = matrix[row][k] / own[k];
            matrix[row].iter_mut().zip(&own).for_each(|(entry, pivot)| *entry -= factor * pivot);
            right[row] -= factor * right[k];
        }
    }
    let mut solution = vec![0.0; n];
    for k in (0..n).rev() {
        let rest: f64 = (k + 1..n).map(|c| matrix[k][c] * solution[c]).sum();
        solution[k] = (right[k] - rest) / matrix[k][k];
    }
    solution
}

/// The quadratics nearest to the arm's torques along the motion with joint 1 on 3 w and joint 2 on 2 w, computed from the equations
/// 5.1 and 5.2 as they are printed.
fn nearest_quadratics() -> Vec<f64> {
    let arm = arm();
    let series = |amplitude: f64, multiple: f64, phase: f64| {
        let wave = |k: f64| (k * multiple * phase, k * multiple);
        let ((a, wa), (b, wb)) = (wave(1.0), wave(3.0));
        [
            amplitude * (a.cos() - b.cos() / 9.0 - 8.0 / 9.0),
            amplitude * (-wa * a.sin() + wb * b.sin() / 9.0),
            amplitude * (-wa * wa * a.cos() + wb * wb * b.cos() / 9.0),
        ]
    };
    let mut rows: Vec<([f64; 9], f64)> = Vec::new();
    let samples = 3000;
    for n in 0..samples {
        let phase = 2.0 * PI * f64::from(n) / f64::from(samples);
        let ([_, v1, a1], [x, v2, a2]) = (series(-0.245393293, 3.0, phase), series(0.199491133, 2.0, phase));
        let [(f1, d1), (f2, d2), (f3, d3)] = arm.functions(TH20 + x);
        let mut of = [[0.0; 9]; 2];
        for power in 0..3 {
            let value = x.powi(power);
            let slope = if power == 0 { 0.0 } else { f64::from(power) * x.powi(power - 1) };
            let at = power as usize;
            of[0][at] = 2.0 * value * a1 + 2.0 * slope * v1 * v2;
            of[1][at] = -slope * v1 * v1;
            of[1][3 + at] = 2.0 * value * a2 + slope * v2 * v2;
            of[0][6 + at] = value * a2 + slope * v2 * v2;
            of[1][6 + at] = value * a1;
        }
        rows.push((of[0], 2.0 * f1 * a1 + f3 * a2 + 2.0 * d1 * v1 * v2 + d3 * v2 * v2));
        rows.push((of[1], f3 * a1 + 2.0 * f2 * a2 - d1 * v1 * v1 + d2 * v2 * v2));
    }
    let square = |input: usize| rows.iter().skip(input).step_by(2).map(|(_, torque)| torque * torque).sum::<f64>();
    let weights = [1.0 / square(0), 1.0 / square(1)];
    let (mut normal, mut right) = (vec![vec![0.0; 9]; 9], vec![0.0; 9]);
    for (row, (of, torque)) in rows.iter().enumerate() {
        for r in 0..9 {
            right[r] += weights[row % 2] * of[r] * torque;
            for c in 0..9 {
                normal[r][c] += weights[row % 2] * of[r] * of[c];
            }
        }
    }
    solve(normal, right)
}

fn forward<'a>(motion: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    [&["project", LINKS, "--onto", QUADRATICS, "--params", VALUES], motion, more].concat()
}

/// What the tool writes of parameters as JSON, ending with a code.
fn found(arguments: &[&str], code: i32) -> Value {
    parsed(&printed_in(&root(), arguments, code))
}

#[test]
fn the_nearest_quadratics_are_those_of_an_independent_computation_and_not_the_taylor_polynomials() {
    let result = found(&forward(&MULTIPLES, &["--json"]), 0);
    assert_eq!((result["rank"].as_u64(), result["unobservable"].as_array().map(Vec::len)), (Some(9), Some(0)));
    let expected = nearest_quadratics();
    let largest = expected.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
    let found = values(&result);
    for ((name, value), expected) in found.iter().zip(&expected) {
        let value = value.expect("all nine are shown");
        assert!((value - expected).abs() < 1e-7 * largest, "{name}: {value} {expected}");
    }
    // The curvatures of the functions themselves are others: good tracking does not prove good Taylor coefficients.
    let (arm, h) = (arm(), 1e-4);
    let taylor = |f: usize| (arm.functions(TH20 + h)[f].1 - arm.functions(TH20 - h)[f].1) / (4.0 * h);
    let apart = (0..3).map(|f| (found[3 * f + 2].1.expect("shown") - taylor(f)).abs() / taylor(f).abs());
    let apart: Vec<f64> = apart.collect();
    assert!(apart.iter().any(|apart| *apart > 0.02), "{apart:?}");
    for input in result["inputs"].as_array().expect("inputs") {
        let share = input["share"].as_f64().expect("a share");
        assert!(share > 1e-6 && share < 0.05, "{input}");
        assert!(input["harmonic"]["amplitude"].as_f64().is_some_and(|amplitude| amplitude > 0.0), "{input}");
    }
    assert!(result["sampling"].as_f64().is_some_and(|change| change < 1e-10), "{}", result["sampling"]);
}

#[test]
fn the_motion_of_the_thesis_shows_six_combinations_and_no_number_along_the_others() {
    let result = found(&forward(&THESIS, &["--json"]), 1);
    assert_eq!((result["rank"].as_u64(), result["combinations"].as_array().map(Vec::len)), (Some(6), Some(6)));
    assert!(values(&result).iter().all(|(_, value)| value.is_none()), "{result}");
    // (lambda2^2, lambda1^2, -2 lambda1 lambda2) in (a1k, a2k, a3k).
    let (l1, l2) = (-0.245393293_f64, 0.199491133_f64);
    let direction = |name: &str| match name.as_bytes()[1] {
        b'1' => l2 * l2,
        b'2' => l1 * l1,
        _ => -2.0 * l1 * l2,
    };
    for order in ["0", "1", "2"] {
        let along = combinations(&result, |name| if name.ends_with(order) { direction(name) } else { 0.0 });
        assert!(along.iter().all(|(_, sum)| sum.abs() < 1e-8), "{along:?}");
    }
    let text = printed_in(&root(), &forward(&THESIS, &[]), 1);
    assert!(text.contains("a10 - 0.406472 a30") && text.contains("rank 6 of 9"), "{text}");
}

#[test]
fn forwards_and_back_gives_the_combinations_of_the_links() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("quadratics.json");
    let name = file.to_str().expect("a path");
    for (motion, code) in [(&THESIS[..], 1), (&MULTIPLES[..], 0)] {
        printed_in(&root(), &forward(motion, &["--json", "-o", name]), code);
        let back = forward(motion, &["--back", "--params", name, "--json"]);
        let result = found(&back, 1);
        assert_eq!((result["model"].as_str(), result["rank"].as_u64()), (Some("ClosedLoopArmLinks"), Some(6)));
        let both = combinations(&result, links);
        assert_eq!(both.len() + values(&result).iter().filter(|(_, value)| value.is_some()).count(), 6);
        for (value, truth) in both {
            assert!((value - truth).abs() < 1e-6 * truth.abs().max(1.0), "{value} {truth}: {motion:?}");
        }
    }
}

#[test]
fn onto_itself_every_combination_stays() {
    let arguments = [&["project", LINKS, "--onto", LINKS, "--params", VALUES][..], &THESIS, &["--json"]].concat();
    let result = found(&arguments, 1);
    assert_eq!(result["rank"].as_u64(), Some(6));
    for (value, truth) in combinations(&result, links) {
        assert!((value - truth).abs() < 1e-8, "{value} {truth}");
    }
    assert!(result["residual"].as_f64().is_some_and(|share| share < 1e-10), "{}", result["residual"]);
}

/// Deviations and covariances of a result go through, and its other fields do not matter.
#[test]
fn deviations_of_a_result_go_through() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("a path").to_owned();
    let (exact, noisy) = (path("exact.json"), path("noisy.json"));
    printed(&forward(&MULTIPLES, &["--json", "-o", &exact]));
    let mut result = parsed(&std::fs::read_to_string(&exact).expect("written"));
    for (j, entry) in result["parameters"].as_array_mut().expect("a list").iter_mut().enumerate() {
        let std = 1e-3 * (j + 1) as f64;
        entry["std"] = std.into();
        // Each value is off by its deviation.
        entry["value"] = (entry["value"].as_f64().expect("a value") + if j % 2 == 0 { std } else { -std }).into();
    }
    for (j, row) in result["covariance"].as_array_mut().expect("a matrix").iter_mut().enumerate() {
        row[j] = (1e-6 * ((j + 1) * (j + 1)) as f64).into();
    }
    std::fs::write(&noisy, result.to_string()).expect("writable");
    let back = found(&forward(&MULTIPLES, &["--back", "--params", &noisy, "--json"]), 1);
    let left = &back["consistency"];
    assert_eq!(left["degrees"].as_u64(), Some(3));
    assert!(left["chi_squared"].as_f64().is_some_and(|sum| sum > 0.0 && sum < 9.0), "{left}");
    for (shown, (value, truth)) in
        back["combinations"].as_array().expect("a list").iter().zip(combinations(&back, links))
    {
        let std = shown["std"].as_f64().expect("a deviation");
        assert!(std > 0.0 && (value - truth).abs() < 4.0 * std, "{shown} {truth}");
    }
    let twice = ["project", QUADRATICS, "--onto", LINKS, "--params", &noisy, "--params", VALUES, "--value", "a10=1"];
    fails(&[&twice[..], &MULTIPLES].concat(), 2, &["noisy.json", "leave out the values of a10"]);
    // A result with other weights has another mean.
    let strange = path("strange.json");
    result["schema"] = "tpm.identification/2".into();
    result.as_object_mut().expect("an object").remove("way");
    std::fs::write(&strange, result.to_string()).expect("writable");
    let back = forward(&MULTIPLES, &["--back", "--params", &strange]);
    fails(&back, 1, &["not weighed as forces are here", "--weights equal"]);
    result["provenance"] = serde_json::json!({"options": {"weights": "equal"}});
    std::fs::write(&strange, result.to_string()).expect("writable");
    fails(&back, 1, &["6 of 8 parameters' combinations follow"]);
    // Swapped, the models give what the quadratics themselves are nearest to.
    let swapped = ["project", QUADRATICS, "--onto", LINKS, "--params", &noisy, "--params", VALUES];
    let swapped = found(&[&swapped[..], &MULTIPLES, &["--json"]].concat(), 1);
    assert_eq!((swapped["rank"].as_u64(), swapped["model"].as_str()), (Some(6), Some("ClosedLoopArmLinks")));
}

#[test]
fn values_are_written_as_other_verbs_read_them() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("quadratics.toml");
    let name = path.to_str().expect("a path");
    assert_eq!(printed(&forward(&MULTIPLES, &["-o", name])), "");
    let text = std::fs::read_to_string(&path).expect("written");
    let table: toml::Table = text.parse().expect("TOML");
    assert_eq!(table.len(), 9);
    let motion = ["--value", "lambda1=-0.2", "--value", "lambda2=0.2", "--value", "w=2", "--value", "th10=0"];
    let split = [&["split", QUADRATICS, "--params", name, "--value", "th20=5.42"][..], &motion].concat();
    assert!(printed(&split).contains("harmonic"));
}

#[test]
fn what_cannot_be_projected_is_named_with_what_helps() {
    let plain = ["project", LINKS, "--onto", QUADRATICS];
    fails(&[&plain[..], &THESIS].concat(), 2, &["no value of A1, A2", "--value l2=VALUE", "--params"]);
    fails(&forward(&[], &[]), 2, &["no value of lambda1, lambda2, w", "--value w=VALUE"]);
    fails(&forward(&THESIS, &["--value", "m=1"]), 2, &["`m` is no parameter", "A1"]);
    fails(&forward(&MULTIPLES, &["--value", "w=1"]), 2, &["`w` is no parameter", "the experiment states the motion"]);
    fails(&["project", LINKS, "--onto", "models/two_carts.tpm"], 2, &["do not have the same inputs", "tau1, tau2"]);
    let free = "models/rotary_pendulum_down.tpm";
    fails(&["project", free, "--onto", free], 2, &["RotaryPendulumDown", "2 rows, 1 inputs", "eliminate coordinates"]);
    let far = ["--value", "lambda1=1", "--value", "lambda2=30", "--value", "w=1", "--value", "l4=2"];
    fails(&forward(&far, &[]), 2, &["not finite along the motion"]);
    fails(&forward(&THESIS, &["--params", VALUES]), 2, &["has a value in another file too"]);
}
