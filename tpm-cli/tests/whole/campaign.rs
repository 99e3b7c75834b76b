//! A campaign by files: driven by the simulated plant through `next`, `simulate` and `submit` alone, it is the one that
//! `identify` runs; stopped anywhere, it goes on where it was.

use crate::support::{names, printed_in, root, tpm, tpm_in};
use std::path::Path;

const SHORT: [&str; 6] =
    ["--set", "schedule.max_runs=3", "--set", "schedule.measure_time=6", "--set", "schedule.updates_per_stage=1"];

fn run(folder: &Path, arguments: &[&str]) -> String {
    printed_in(folder, arguments, 0)
}

fn plain_json(output: &std::process::Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// A result as JSON, without what says where its runs were played and kept. True values belong to that: only a result of runs that
/// are known to be simulated has them.
fn json(output: &std::process::Output) -> serde_json::Value {
    let mut result = plain_json(output);
    let fields = result.as_object_mut().expect("an object");
    assert!(fields.remove("source").is_some() && fields.remove("provenance").is_some(), "{fields:?}");
    for list in ["parameters", "physical", "combinations"] {
        for entry in fields[list].as_array_mut().expect("a list") {
            entry.as_object_mut().expect("an object").remove("truth");
        }
    }
    result
}

#[test]
fn files_alone_give_the_result_of_identify() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    run(at, &[&["campaign", "start", model, "c"], &SHORT[..]].concat());
    for n in 1..=3 {
        run(at, &["campaign", "next", "c", "-o", "run.csv"]);
        run(at, &[&["simulate", model, "--play", "run.csv", "-o", "log.csv"], &SHORT[..]].concat());
        let said = if n == 2 {
            // A controller that counts, and calls the force otherwise.
            let (text, mut counts) = (std::fs::read_to_string(at.join("log.csv")).expect("a log"), String::new());
            for (i, line) in text.lines().enumerate() {
                let fields: Vec<&str> = line.split(',').collect();
                let doubled =
                    |x: &str| x.parse::<f64>().map_or_else(|_| "counts".to_owned(), |x| (2.0 * x).to_string());
                let force = if i == 0 { "command" } else { fields[2] };
                counts.push_str(&format!("{},{},{force}\n", fields[0], doubled(fields[1])));
            }
            std::fs::write(at.join("log.csv"), counts).expect("written");
            let columns = ["--map", "x=counts", "--scale", "x=0.5", "--map", "u=command"];
            run(at, &[&["campaign", "submit", "c", "log.csv"], &columns[..]].concat())
        } else {
            run(at, &["campaign", "submit", "c", "log.csv"])
        };
        assert!(said.contains(&format!("run {n}: complete")), "{said}");
        assert_eq!(said.contains("ended"), n == 3, "{said}");
    }
    let over = tpm_in(at, &["campaign", "next", "c", "-o", "none.csv"]);
    assert_eq!(over.status.code(), Some(1));
    assert!(!at.join("none.csv").exists());
    let files = json(&tpm_in(at, &["campaign", "result", "c", "--json"]));
    let whole = json(&tpm(&[&["identify", model, "--json"], &SHORT[..]].concat()));
    assert_eq!(files, whole);
    // Nobody knows on what the logs were recorded.
    let text = String::from_utf8(tpm_in(at, &["campaign", "result", "c"]).stdout).expect("text");
    assert!(text.starts_with("model MassSpringDrag from the runs in its folder; estimator"), "{text}");
}

#[test]
fn measured_rates_go_by_file_too() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    let tachometer = ["--set", "estimator=error", "--set", "plant.sensors.x.rate_noise=1e-3"];
    let sets = [&SHORT[..], &tachometer[..], &["--set", "schedule.max_runs=2"]].concat();
    run(at, &[&["campaign", "start", model, "c"], &sets[..]].concat());
    for _ in 0..2 {
        run(at, &["campaign", "next", "c", "-o", "run.csv"]);
        run(at, &[&["simulate", model, "--play", "run.csv", "-o", "log.csv"], &sets[..]].concat());
        let log = std::fs::read_to_string(at.join("log.csv")).expect("a log");
        assert!(log.starts_with("t_s,x,u,dot(x)\n"), "{}", &log[..40]);
        run(at, &["campaign", "submit", "c", "log.csv"]);
    }
    let files = json(&tpm_in(at, &["campaign", "result", "c", "--json"]));
    let whole = json(&tpm(&[&["identify", model, "--json"], &sets[..]].concat()));
    assert_eq!(files, whole);
}

#[test]
fn a_stopped_campaign_goes_on_where_it_was() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    let identify =
        |runs: &str| json(&tpm_in(at, &[&["identify", model, "--json", "--runs", runs], &SHORT[..]].concat()));
    let unbroken = identify("a");
    assert_eq!(
        names(&at.join("a")),
        [
            "campaign.json",
            "experiment.toml",
            "model.tpm",
            "run-001.csv",
            "run-001.json",
            "run-002.csv",
            "run-002.json",
            "run-003.csv",
            "run-003.json"
        ]
    );
    // Killed while the second run was written: its samples are there in part, its manifest is not.
    std::fs::create_dir(at.join("b")).expect("a folder");
    for name in ["campaign.json", "experiment.toml", "model.tpm", "run-001.csv", "run-001.json"] {
        std::fs::copy(at.join("a").join(name), at.join("b").join(name)).expect("copied");
    }
    let half = std::fs::read(at.join("a/run-002.csv")).expect("a run");
    std::fs::write(at.join("b/run-002.csv"), &half[..half.len() / 2]).expect("written");
    assert_eq!(identify("b"), unbroken);
    assert_eq!(std::fs::read(at.join("b/run-002.csv")).expect("a run"), half);
    // Samples that are not those of the manifest, and a manifest from another model or experiment, are refused.
    std::fs::write(at.join("b/run-002.csv"), &half[..half.len() / 2]).expect("written");
    let refused = tpm_in(at, &[&["identify", model, "--runs", "b"], &SHORT[..]].concat());
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("run-002.csv"), "{refused:?}");
    let other = tpm_in(at, &["identify", model, "--runs", "a", "--set", "seed=9"]);
    assert_eq!(other.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&other.stderr).contains("another experiment"), "{other:?}");
    let other = root().join("models/two_carts.tpm");
    let other = tpm_in(at, &["identify", other.to_str().expect("plain"), "--runs", "a"]);
    assert!(String::from_utf8_lossy(&other.stderr).contains("another model"), "{other:?}");
}

#[test]
fn bad_logs_are_refused_and_nothing_is_lost() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    let none = tpm_in(at, &["campaign", "next", "c"]);
    assert!(String::from_utf8_lossy(&none.stderr).contains("campaign start"), "{none:?}");
    run(at, &[&["campaign", "start", model, "c"], &SHORT[..]].concat());
    run(at, &["campaign", "next", "c", "-o", "run.csv"]);
    run(at, &[&["simulate", model, "--play", "run.csv", "-o", "log.csv"], &SHORT[..]].concat());
    let log = std::fs::read_to_string(at.join("log.csv")).expect("a log");
    let lines: Vec<&str> = log.lines().collect();
    let refuse = |text: &str, expected: &str| {
        std::fs::write(at.join("bad.csv"), text).expect("written");
        let refused = tpm_in(at, &["campaign", "submit", "c", "bad.csv"]);
        let error = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(refused.status.code() == Some(2) && error.contains(expected), "{error}");
    };
    // A sensor that drops out in the middle, a log that ends early, one of another rate.
    let mut dropped: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
    let fields: Vec<&str> = lines[500].split(',').collect();
    dropped[500] = format!("{},,{}", fields[0], fields[2]);
    refuse(&dropped.join("\n"), "501");
    refuse(&lines[..lines.len() / 2].join("\n"), "samples");
    let slow: Vec<&str> =
        lines.iter().enumerate().filter(|(n, _)| *n == 0 || n % 2 == 1).map(|(_, line)| *line).collect();
    refuse(&slow.join("\n"), "every");
    // A tracking error beyond its bound ends the run there, and the next one is smaller.
    let mut far: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
    let fields: Vec<&str> = lines[800].split(',').collect();
    far[800] = format!("{},9.0,{}", fields[0], fields[2]);
    std::fs::write(at.join("far.csv"), far.join("\n")).expect("written");
    let said = run(at, &["campaign", "submit", "c", "far.csv"]);
    assert!(said.contains("tracking bound"), "{said}");
    assert!(names(&at.join("c")).contains(&"run-001.json".to_owned()));
    let cut = std::fs::read_to_string(at.join("c/run-001.csv")).expect("a run");
    assert_eq!(cut.lines().count(), 801);
}

#[test]
fn a_design_is_judged_before_anything_moves() {
    let model = root().join("models/mass_spring_drag.tpm");
    let arguments = ["design", model.to_str().expect("plain"), "--json"];
    let found = plain_json(&tpm(&arguments));
    assert_eq!(found["schema"], "tpm.design/1");
    assert_eq!(found["estimates"]["k1"], 40.0);
    let candidates = found["candidates"].as_array().expect("a list");
    assert!(candidates.iter().all(|candidate| candidate["rank"] == 3 && candidate["passed"].is_null()));

    let limited = tpm(&[&arguments[..], &["--set", "limits.inputs.u=20"]].concat());
    let limited = plain_json(&limited);
    let candidates = limited["candidates"].as_array().expect("a list");
    let within = candidates.iter().filter(|candidate| candidate["passed"].is_null()).count();
    assert!(within > 0 && within < candidates.len());
    assert!(candidates[..within].iter().all(|candidate| candidate["effort_share"].as_f64().expect("limited") < 0.7));
    assert_eq!(candidates[within]["passed"]["input"], "u");

    crate::support::fails(&[&arguments[..], &["--set", "limits.inputs.u=0.5"]].concat(), 1, &["no candidate"]);
    let arm = root().join("models/closed_loop_arm.tpm");
    let zero = ["prior.a10=0", "prior.a20=0", "prior.a30=0", "prior.a11=0", "prior.a21=0", "prior.a31=0"];
    let zero = zero.iter().flat_map(|value| ["--set", value]);
    let arguments: Vec<&str> = ["design", arm.to_str().expect("plain")].into_iter().chain(zero).collect();
    crate::support::fails(&arguments, 2, &["a10 = 0", "give prior values"]);
}

/// A file system that takes no more when the second run is written: what is there stays, and the campaign goes on when there is room.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_keeps_the_finished_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    let identify = |runs: &'static str| [&["identify", model, "--json", "--runs", runs], &SHORT[..]].concat();
    run(at, &[&["campaign", "start", model, "c"], &SHORT[..]].concat());
    run(at, &["campaign", "next", "c", "-o", "run.csv"]);
    run(at, &[&["simulate", model, "--play", "run.csv", "-o", "log.csv"], &SHORT[..]].concat());
    let full = without_room(at, &["campaign", "submit", "c", "log.csv"]);
    let error = String::from_utf8_lossy(&full.stderr).into_owned();
    assert!(
        error.contains("run-001") && error.contains("File too large") && error.contains("finished runs"),
        "{error}"
    );
    assert!(!names(&at.join("c")).iter().any(|name| name.contains("run-001") || name.starts_with(".tpm-")));
    assert!(run(at, &["campaign", "submit", "c", "log.csv"]).contains("run 1: complete"));
    let full = without_room(at, &identify("c"));
    assert_eq!(full.status.code(), Some(2));
    let error = String::from_utf8_lossy(&full.stderr).into_owned();
    assert!(
        error.contains("run-002") && error.contains("File too large") && error.contains("finished runs"),
        "{error}"
    );
    let kept = names(&at.join("c"));
    assert!(kept.contains(&"run-001.json".to_owned()) && !kept.iter().any(|name| name.contains("run-002")), "{kept:?}");
    assert_eq!(json(&tpm_in(at, &identify("c"))), json(&tpm_in(at, &identify("whole"))));
}

/// The tool where no file can grow beyond 64 kB, which the samples of a run do.
#[cfg(target_os = "linux")]
fn without_room(folder: &Path, arguments: &[&str]) -> std::process::Output {
    let mut shell = std::process::Command::new("sh");
    shell.args(["-c", "trap '' XFSZ; ulimit -f 128; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_tpm")]);
    shell.args(arguments).current_dir(folder).output().expect("a shell")
}

/// Every shipped experiment, cut to two runs: a folder says of its runs what the campaign that played them said.
#[test]
fn identify_and_campaign_result_say_the_same_of_every_shipped_experiment() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    for (model, experiment) in [
        ("mass_spring_drag", "mass_spring_drag"),
        ("two_carts", "two_carts"),
        ("closed_loop_arm", "closed_loop_arm"),
        ("closed_loop_arm", "closed_loop_arm_thesis"),
        ("rotary_pendulum_down", "rotary_pendulum_down"),
    ] {
        let [model, file] = [format!("models/{model}.tpm"), format!("models/{experiment}.toml")]
            .map(|path| root().join(path).display().to_string());
        let short = ["--set", "schedule.max_runs=2", "--set", "schedule.measure_time=4"];
        let played =
            [&["identify", &model, "--experiment", &file, "--runs", experiment, "--json"], &short[..]].concat();
        let (played, kept) = (tpm_in(at, &played), tpm_in(at, &["campaign", "result", experiment, "--json"]));
        assert_eq!(played.status.code(), kept.status.code(), "{experiment}");
        assert_eq!(String::from_utf8_lossy(&played.stderr), String::from_utf8_lossy(&kept.stderr), "{experiment}");
        let [played, kept] = [json(&played), json(&kept)];
        assert_eq!(played["runs"].as_array().map(Vec::len), Some(2), "{experiment}");
        for part in ["parameters", "physical", "combinations", "unobservable", "covariance", "warnings", "findings"] {
            assert_eq!(played[part], kept[part], "{experiment}: {part}");
        }
        assert_eq!(played, kept, "{experiment}");
    }
}

#[test]
fn a_run_says_all_that_its_controller_needs_and_one_of_the_earlier_form_can_be_played() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    run(at, &[&["campaign", "start", model, "c"], &SHORT[..]].concat());
    run(at, &["campaign", "next", "c", "-o", "run.csv"]);
    let read = |name: &str| std::fs::read_to_string(at.join(name)).expect("written");
    let mut terms: serde_json::Value = serde_json::from_str(&read("run.json")).expect("JSON");
    assert_eq!(terms["schema"], "tpm.play/2");
    let rows = read("run.csv").lines().count() - 1;
    assert_eq!(terms["timing"]["samples"], rows);
    assert_eq!((&terms["timing"]["settle_periods"], &terms["timing"]["hold"]), (&3.into(), &"zero-order".into()));
    let (sample_time, filter) =
        (terms["sample_time"].as_f64().expect("s"), terms["derivative_filter"].as_f64().expect("s"));
    let rate = &terms["law"]["rate"];
    assert_eq!(
        (&rate["from"], &rate["equation"]),
        (&"difference".into(), &"v[n] = a v[n-1] + b (e[n] - e[n-1]); v[0] = 0".into())
    );
    let a = (-sample_time / filter).exp();
    assert!((rate["a"].as_f64().expect("a") - a).abs() < 1e-15);
    assert!((rate["b"].as_f64().expect("b") - (1.0 - a) / sample_time).abs() < 1e-9);
    let play = |log: &str| run(at, &[&["simulate", model, "--play", "run.csv", "-o", log], &SHORT[..]].concat());
    play("now.csv");
    let fields = terms.as_object_mut().expect("an object");
    for new in ["timing", "law"] {
        assert!(fields.remove(new).is_some(), "{new}");
    }
    fields.insert("schema".to_owned(), "tpm.play/1".into());
    std::fs::write(at.join("run.json"), terms.to_string()).expect("written");
    play("earlier.csv");
    assert_eq!(read("now.csv"), read("earlier.csv"));
}

#[test]
fn a_run_that_the_machine_stopped_can_be_submitted_and_leads_to_backing_off() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    run(at, &[&["campaign", "start", model, "c"], &SHORT[..]].concat());
    run(at, &["campaign", "next", "c", "-o", "run.csv"]);
    run(at, &[&["simulate", model, "--play", "run.csv", "-o", "log.csv"], &SHORT[..]].concat());
    let whole = std::fs::read_to_string(at.join("log.csv")).expect("a log");
    let half: Vec<&str> = whole.lines().take(3000).collect();
    std::fs::write(at.join("half.csv"), half.join("\n")).expect("written");
    let refused = tpm_in(at, &["campaign", "submit", "c", "half.csv"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--stopped"), "{refused:?}");
    let said = run(at, &["campaign", "submit", "c", "half.csv", "--stopped"]);
    assert!(said.starts_with("run 1: stopped") && said.contains("amplitudes reduced"), "{said}");
    let peak = |name: &str| {
        let text = std::fs::read_to_string(at.join(name)).expect("a run");
        let of = |line: &str| line.split(',').nth(1).and_then(|x| x.parse::<f64>().ok()).map(f64::abs);
        text.lines().filter_map(of).fold(0.0, f64::max)
    };
    run(at, &["campaign", "next", "c", "-o", "again.csv"]);
    assert!((peak("again.csv") / peak("run.csv") - 0.5).abs() < 1e-9);
}
