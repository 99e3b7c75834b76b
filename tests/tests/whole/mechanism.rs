//! A mechanism declared in `model!` by a crate outside the workspace, without the standard library: its campaign finds what it can show.

use crate::support::root;
use std::process::Command;

#[test]
fn a_mechanism_in_the_macro_identifies_itself() {
    let crate_folder = root().join("tests/mechanism_program");
    let target = root().join("target/mechanism");
    // The workspace's versions; cargo drops what this program does not need.
    std::fs::copy(root().join("Cargo.lock"), crate_folder.join("Cargo.lock")).expect("writable");
    let build = Command::new(env!("CARGO"))
        .current_dir(&crate_folder)
        .args(["build", "--offline", "--quiet"])
        .env("CARGO_TARGET_DIR", &target)
        .output()
        .expect("cargo runs");
    assert!(build.status.success(), "{}", String::from_utf8_lossy(&build.stderr));
    for precision in ["double", "single"] {
        let output = Command::new(target.join("debug/identify")).arg(precision).output().expect("it runs");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{precision}: {text}{}", String::from_utf8_lossy(&output.stderr));
        assert!(text.starts_with("Ended(Stages) after 4 runs\n"), "{precision}: {text}");
        let mut shown = 0;
        for line in text.lines().skip(1) {
            // The slide moves along a line with the arm's mass on it: their sum shows, neither by itself.
            if line.starts_with("m_") {
                assert!(line.ends_with("not shown"), "{precision}: {text}");
                continue;
            }
            let numbers: Vec<f64> = line.split(' ').skip(1).map(|word| word.parse().expect("a number")).collect();
            let [value, deviation, truth] = numbers[..] else { panic!("{precision}: {text}") };
            assert!((value - truth).abs() < 3.0 * deviation && deviation < 1e-2 * truth.abs(), "{precision}: {text}");
            shown += 1;
        }
        assert_eq!(shown, 5, "{precision}: {text}");
    }
}
