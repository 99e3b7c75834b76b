//! `tpm identifiability` of models with and without a table.

use crate::support::{printed_in, root};
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
        printed_in(&root(), &["identifiability", file.to_str().expect("plain"), "--set", "A=1", "--set", "w=2"], 1);
    assert!(text.starts_with("rank 2 of 4 parameters (numerical, along the pattern)"), "{text}");
}

#[test]
fn the_harmonics_of_a_polynomial_model_are_limited_too() {
    let text = printed_in(&root(), &["identifiability", "models/mass_spring_drag.tpm", "--harmonics", "1"], 1);
    assert!(text.starts_with("rank 2 of 3 parameters (exact, proven)"), "{text}");
}
