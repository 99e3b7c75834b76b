//! `tpm export`: what goes to files, to standard output and to standard error, and how it ends.

use crate::support::{names, printed_in, root, tpm_in};
use std::fs;
use std::path::Path;

const RESULT: &str = r#"{"schema": "tpm.identification/2", "model": "MassSpringDrag", "hold": "none", "harmonics": 6, "parameters": [
 {"name": "m", "unit": "kg", "value": 2.0, "std": 0.1, "status": "identified"}, {"name": "k1", "unit": "N/m", "value": 40.25, "std": 0.125, "status": "identified"},
 {"name": "k2", "unit": null, "value": 1.5, "std": 0.1, "status": "identified"}], "unobservable": [], "combinations": [], SHORTFALL
 "log": {"actuators": {"u": {"delay": 0.004, "low_pass": null, "bandwidth": null}}}}"#;

const ROBOT: &str = "<mujoco><worldbody><body><joint name='x' type='slide' damping='1'/></body></worldbody></mujoco>\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("writable");
    write("model.tpm", &fs::read_to_string(root().join("models/mass_spring_drag.tpm")).expect("a shipped model"));
    write("good.json", &RESULT.replace("SHORTFALL", ""));
    write("bad.json", &RESULT.replace("SHORTFALL", "\"shortfall\": \"the halves disagree\","));
    write("robot.xml", ROBOT);
    folder
}

/// The exit code and what is said of it.
fn ends(folder: &Path, arguments: &str) -> (Option<i32>, String) {
    let arguments: Vec<&str> = arguments.split(' ').collect();
    let output = tpm_in(folder, &arguments);
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_result_that_is_not_trusted_is_written_says_so_and_ends_with_one() {
    let folder = folder();
    let at = folder.path();
    for (to, file) in [("casadi", "m.py"), ("st", "m.st"), ("mjcf --into robot.xml", "new.xml")] {
        let line = format!("export model.tpm --params bad.json --to {to} -o {file}");
        let (code, said) = ends(at, &line);
        assert!(
            code == Some(1) && said.contains("not trusted: the halves disagree") && said.contains("--anyway"),
            "{said}"
        );
        let text = fs::read_to_string(at.join(file)).expect("it is written");
        assert!(text.contains("not trusted: the halves disagree"), "{text}");
        let (code, said) = ends(at, &format!("{line} --anyway"));
        assert!(code == Some(0) && !said.contains("not trusted"), "{said}");
        assert_eq!(fs::read_to_string(at.join(file)).expect("it is written"), text);
        let (code, said) = ends(at, &line.replace("bad.json", "good.json"));
        assert_eq!(code, Some(0), "{said}");
        assert_eq!(said.matches("warning: ").count(), 1, "{said}");
        assert!(said.contains("a delay of 0.004 s between the input `u` and its force"), "{said}");
        assert!(!fs::read_to_string(at.join(file)).expect("it is written").contains("not trusted"));
    }
    // Nothing in this file is a parameter of the model: not a byte changes.
    assert_eq!(fs::read_to_string(at.join("new.xml")).expect("it is written"), ROBOT);
    assert_eq!(
        printed_in(at, &["export", "model.tpm", "--params", "good.json", "--to", "mjcf", "--into", "robot.xml"], 0),
        ROBOT
    );
}

#[test]
fn a_library_is_a_folder_that_is_written_whole_or_not_at_all() {
    let folder = folder();
    let at = folder.path();
    let line = "export model.tpm --params good.json --to arduino -o Spring";
    assert_eq!(ends(at, line).0, Some(0));
    assert_eq!(names(&at.join("Spring")), ["README.md", "examples", "library.properties", "src"]);
    assert_eq!(names(&at.join("Spring/src")), ["mass_spring_drag.c", "mass_spring_drag.h"]);
    assert_eq!(names(&at.join("Spring/examples/MassSpringDrag")), ["MassSpringDrag.ino"]);
    fs::create_dir_all(at.join("Other/library.properties")).expect("a folder in the way");
    let (code, said) = ends(at, &line.replace("Spring", "Other"));
    assert_eq!(code, Some(2), "{said}");
    assert_eq!(names(&at.join("Other")), ["library.properties"]);
}
