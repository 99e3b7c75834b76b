//! `tpm identifiability` of models with and without a table.

use crate::support::{fails, printed_in, root};
use std::path::Path;

const PENDULUM: &str = "model MotorPendulum {
    coordinate q [rad];
    input u [N*m];
    parameter J [kg*m^2], d [N*m*s/rad], fc [N*m], mgl [N*m];
    J*ddot(q) + d*dot(q) + fc*sign(dot(q)) + mgl*sin(q) = u;
    TAYLOR
    pattern { amplitude A [rad]; frequency w [rad/s]; HARMONICS q = rest_to_rest(A, w, 3); }
}";

fn found(folder: &Path, taylor: &str, harmonics: &str, options: &[&str], code: i32) -> serde_json::Value {
    let file = folder.join("pendulum.tpm");
    let text = PENDULUM.replace("TAYLOR", taylor).replace("HARMONICS", harmonics);
    std::fs::write(&file, text).expect("written");
    let file = file.to_str().expect("plain");
    let text = printed_in(&root(), &[&["identifiability", file, "--json"], options].concat(), code);
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn a_sine_is_answered_exactly_by_its_series_and_numerically_without() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    for (taylor, method) in [("taylor q about 0 order 5;", "exact"), ("", "numerical")] {
        let all = found(at, taylor, "", &[], 0);
        assert_eq!((all["method"].as_str(), all["rank"].as_u64()), (Some(method), Some(4)), "{all}");
        // At one harmonic there is one cosine and one sine.
        let one = found(at, taylor, "", &["--harmonics", "1"], 1);
        assert_eq!((one["method"].as_str(), one["rank"].as_u64()), (Some(method), Some(2)), "{one}");
        let declared = found(at, taylor, "harmonics 1;", &[], 1);
        assert_eq!(declared, one);
        let more = found(at, taylor, "harmonics 1;", &["--harmonics", "3"], 0);
        assert_eq!(more["rank"], 4);
    }
    let file = at.join("pendulum.tpm");
    let text =
        printed_in(&root(), &["identifiability", file.to_str().expect("plain"), "--value", "A=1", "--value", "w=2"], 1);
    assert!(text.starts_with("rank 2 of 4 parameters (numerical, along the pattern)"), "{text}");
}

#[test]
fn the_harmonics_of_a_polynomial_model_are_limited_too() {
    let text = printed_in(&root(), &["identifiability", "models/mass_spring_drag.tpm", "--harmonics", "1"], 1);
    assert!(text.starts_with("rank 2 of 3 parameters (exact, proven)"), "{text}");
}

#[test]
fn any_motion_shows_the_base_parameters_of_an_arm() {
    let arm = "models/robots/planar_arm.tpm";
    let all = |options: &[&str]| -> serde_json::Value {
        let text = printed_in(&root(), &[&["identifiability", arm, "--json"], options].concat(), 1);
        serde_json::from_str(&text).expect("JSON")
    };
    // Of an arm in a vertical plane the mass of the outer link is told only by its effect on the inner one.
    let free = all(&[]);
    assert_eq!((free["schema"].as_str(), free["rank"].as_u64()), (Some("tpm.base/1"), Some(11)), "{free}");
    let base = free["base"].as_array().expect("a list");
    let lumped: Vec<&serde_json::Value> =
        base.iter().filter(|one| one["plus"].as_object().is_some_and(|plus| !plus.is_empty())).collect();
    assert_eq!((base.len(), lumped.len()), (11, 2), "{free}");
    let locked = all(&["--rest", "q2=0"]);
    let hidden = locked["unobservable"].as_array().expect("a list");
    assert!(hidden.iter().any(|name| name == "fv_q2") && locked["rank"].as_u64() == Some(8), "{locked}");
    // Along a pattern the answer is numerical, and says for every base parameter which harmonics determine it.
    let text = std::fs::read_to_string(root().join(arm)).expect("the shipped model");
    let end = text.rfind('}').expect("the end of the model");
    let pattern =
        "pattern { amplitude A [rad], B [rad]; frequency w [rad/s]; q1 = rest_to_rest(A, w, 3); q2 = B*sin(2*w*t); }";
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("moved.tpm");
    std::fs::write(&file, format!("{}{pattern}\n}}\n", &text[..end])).expect("written");
    let moved = printed_in(&root(), &["identifiability", file.to_str().expect("plain"), "--json"], 1);
    let moved: serde_json::Value = serde_json::from_str(&moved).expect("JSON");
    assert_eq!((moved["method"].as_str(), moved["rank"].as_u64()), (Some("numerical"), Some(11)), "{moved}");
    let bands: Vec<Option<u64>> =
        moved["base"].as_array().expect("a list").iter().map(|one| one["harmonics_up_to"].as_u64()).collect();
    assert!(bands.len() == 11 && bands.iter().all(|band| band.is_some_and(|band| band < 31)), "{moved}");
    fails(&["identifiability", arm, "--rest", "q3=0"], 2, &["no coordinate `q3`"]);
    fails(&["identifiability", "models/emps.tpm", "--rest", "q=0"], 2, &["--any-motion"]);
}

#[test]
fn nonlinear_parameters_are_named_as_not_counted() {
    let file = "models/stribeck_pendulum.tpm";
    let text = printed_in(&root(), &["identifiability", file, "--any-motion"], 0);
    assert!(text.contains("rank 5 of 5") && text.contains("not counted: vs"), "{text}");
    for any in [&["--any-motion"][..], &[]] {
        let text = printed_in(&root(), &[&["identifiability", file, "--json"], any].concat(), 0);
        let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(json["nonlinear"][0], "vs", "{json}");
    }
}

#[test]
fn what_sensors_show_of_unmeasured_coordinates_is_said_without_a_log() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("masses.tpm");
    let text = "model Masses {
        coordinate x1 [m];
        unmeasured x2 [m];
        input u [N];
        parameter m1 [kg], m2 [kg], d1 [N*s/m], d2 [N*s/m], k [N/m];
        m1*ddot(x1) + d1*dot(x1) + k*(x1 - x2) = u;
        m2*ddot(x2) + d2*dot(x2) + k*(x2 - x1) = 0;
    }";
    std::fs::write(&file, text).expect("written");
    let shown = file.to_str().expect("plain");
    let said = printed_in(&root(), &["identifiability", shown], 0);
    assert!(said.starts_with("rank 5 of 5 parameters by sensors of x1") && said.contains("not measured: x2"), "{said}");
    // Code of a controller takes the motion of every coordinate.
    fails(&["generate", shown, "--lang", "c", "-o", "-"], 2, &["`x2` is unmeasured", "from a log"]);
    // Nothing of the second mass acts on the first.
    std::fs::write(&file, text.replace("+ k*(x1 - x2)", "+ k*x1")).expect("written");
    let said = printed_in(&root(), &["identifiability", shown, "--json"], 1);
    let found: serde_json::Value = serde_json::from_str(&said).expect("JSON");
    assert_eq!(
        (found["schema"].as_str(), found["unfelt"][0].as_str()),
        (Some("tpm.observed/1"), Some("x2")),
        "{found}"
    );
    fails(&["identifiability", shown], 1, &["sensors show 3 combinations of 5 parameters"]);
}

#[test]
fn a_row_without_an_input_shows_its_parameters_up_to_a_common_factor() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("motor.tpm");
    let motor = |row: &str, pattern: &str| {
        let text = format!(
            "model Motor {{
                coordinate w [rad/s], i [A];
                input u [V];
                parameter J [kg*m^2], b [N*m*s/rad], Kt [N*m/A], R [ohm], L [H], Ke [V*s/rad];
                {row}
                L*dot(i) + R*i + Ke*w = u;
                {pattern}
            }}"
        );
        std::fs::write(&file, text).expect("written");
        file.to_str().expect("plain").to_owned()
    };
    let patterned = "pattern {
        amplitude A [rad/s], B [A]; frequency f [rad/s];
        w = rest_to_rest(A, f, 3); i = B*sin(f*t) + B*cos(3*f*t);
    }";
    let apart = "J*dot(w) + b*w - Kt*i = 0;";
    for (pattern, options) in [("", &[][..]), (patterned, &[]), (patterned, &["--any-motion"])] {
        let model = motor(apart, pattern);
        let text = printed_in(&root(), &[&["identifiability", &model], options].concat(), 1);
        assert!(text.starts_with("rank 5 of 6 parameters"), "{text}");
        assert!(text.contains("known up to a common factor: J, b, Kt;"), "{text}");
        let text = printed_in(&root(), &[&["identifiability", &model, "--json"], options].concat(), 1);
        let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(json["common_factors"], serde_json::json!([["J", "b", "Kt"]]), "{json}");
    }
    // A parameter that the driven row shows too fixes the factor, and so does a term that is known.
    for row in ["J*dot(w) + b*w - Ke*i = 0;", "constant load = 0.03 [N*m]; J*dot(w) + b*w - Kt*i + load = 0;"] {
        let model = motor(row, "");
        let text = std::fs::read_to_string(&model).expect("readable");
        if !row.contains("Kt") {
            std::fs::write(&model, text.replace("Kt [N*m/A], ", "")).expect("written");
        }
        let text = printed_in(&root(), &["identifiability", &model], 0);
        assert!(!text.contains("common factor"), "{text}");
    }
}
