//! A campaign on a machine behind a program: it is the one that `identify` runs, wherever machine or campaign are killed.

use crate::support::{names, result_alone, root, skipped, tpm_in};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Two runs of seven periods and nine lines: a greeting, and three parts and an end for each run.
const SHORT: [&str; 6] =
    ["--set", "schedule.max_runs=2", "--set", "schedule.measure_time=2", "--set", "schedule.updates_per_stage=1"];
const PARTS: &str = "--chunk 5000";
const LINES: usize = 9;

/// A folder in which a shipped model is played.
struct Place {
    folder: TempDir,
    model: String,
}

impl Place {
    fn new(model: &str) -> Self {
        let model = root().join("models").join(model).display().to_string();
        Place { folder: tempfile::tempdir().expect("a folder"), model }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The command of the simulated machine: the example, which `cargo test` builds beside its test programs.
    fn machine(&self, sets: &[&str], more: &str) -> String {
        let test = std::env::current_exe().expect("this program has a path");
        let built = test.parent().and_then(Path::parent).expect("cargo's folder `deps` stands in that of the profile");
        let example = built.join("examples").join(format!("simulated_machine{}", std::env::consts::EXE_SUFFIX));
        assert!(example.exists(), "`cargo build -p tpm-cli --example simulated_machine` makes {}", example.display());
        let sets: Vec<String> = sets.iter().map(|word| format!("\"{word}\"")).collect();
        format!("'{}' '{}' {} {more}", example.display(), self.model, sets.join(" "))
    }

    /// The arguments that play the campaign of the folder `c` on a machine, waiting for a line for so many seconds.
    fn arguments<'a>(&'a self, machine: &'a str, patience: &'a str, sets: &[&'a str]) -> Vec<&'a str> {
        let own =
            ["campaign", "run", &self.model, "--runs", "c", "--json", "--timeout", patience, "--machine", machine];
        [&own, sets].concat()
    }

    fn play(&self, machine: &str, sets: &[&str]) -> Output {
        tpm_in(self.folder.path(), &self.arguments(machine, "20", sets))
    }

    fn begin(&self, machine: &str, patience: &str) -> Child {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpm"));
        command.args(self.arguments(machine, patience, &SHORT)).current_dir(self.folder.path());
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the tool starts")
    }

    /// Waits until a file is there.
    fn wait_for(&self, name: &str) {
        let began = Instant::now();
        while !self.at(name).exists() {
            assert!(began.elapsed() < Duration::from_secs(60), "{name} did not come");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// What `identify` says of the simulated machine.
    fn identified(&self, sets: &[&str]) -> Value {
        result_alone(&tpm_in(self.folder.path(), &[&["identify", &self.model, "--json"], sets].concat()))
    }
}

/// The command broke off with this exit code, and says all of this.
fn says(output: &Output, code: i32, parts: &[&str]) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert!(output.stdout.is_empty(), "{said}");
    parts.iter().for_each(|part| assert!(said.contains(part), "`{part}` is not in: {said}"));
}

#[test]
fn a_whole_campaign_equals_identify() {
    let place = Place::new("mass_spring_drag.tpm");
    let machine = place.machine(&[], "--chunk 4096");
    let played = place.play(&machine, &[]);
    let said = String::from_utf8_lossy(&played.stderr);
    assert!(said.contains("run 1: complete; m = "), "{said}");
    let whole = result_alone(&played);
    assert_eq!(whole, place.identified(&[]));
    // A campaign that has ended plays nothing more, and says the same.
    let again = place.play("no_such_program", &[]);
    assert_eq!(result_alone(&again), whole);
    assert!(String::from_utf8_lossy(&again.stderr).contains("remark: going on from "));
    let result = tpm_in(place.folder.path(), &["campaign", "result", "c", "--json"]);
    assert_eq!(result_alone(&result), whole);
}

/// Several coordinates and inputs, free coordinates, measured rates, bounds that are passed; the loop closed on either side, to the
/// last bit. That a refinement is the same too is seen on the others: along the arm it takes a quarter of a minute.
#[test]
fn runs_and_samples_equal_identify_on_every_kind_of_machine() {
    let rates = ["--set", "estimator=error", "--set", "plant.sensors.x.rate_noise=1e-3"];
    let bound = ["--set", "limits.tracking.x=0.02", "--set", "limits.max_aborts=1"];
    for (model, sets) in [
        ("mass_spring_drag.tpm", &rates[..]),
        ("mass_spring_drag.tpm", &bound),
        ("two_carts.tpm", &[]),
        ("closed_loop_arm.tpm", &["--set", "refine=none"]),
        ("rotary_pendulum_down.tpm", &[]),
    ] {
        let sets = [&["--set", "schedule.max_runs=2", "--set", "schedule.measure_time=4"], sets].concat();
        let identified = Place::new(model).identified(&sets);
        for more in ["--chunk 7000", "--samples"] {
            let place = Place::new(model);
            let played = place.play(&place.machine(&sets, more), &sets);
            let own = result_alone(&played);
            assert_eq!(own, identified, "{model} {more}");
            assert_eq!(own["runs"].as_array().map(Vec::len), Some(2), "{model} {more}");
        }
    }
}

#[test]
fn a_machine_killed_at_any_line_leaves_a_campaign_that_goes_on() {
    let place = Place::new("mass_spring_drag.tpm");
    let unbroken = place.identified(&SHORT);
    let good = place.machine(&SHORT, PARTS);
    for after in 0..LINES {
        let broken = place.machine(&SHORT, &format!("{PARTS} --fault die --after {after}"));
        let run = if after < 5 { "run 1: it ended with" } else { "run 2: it ended with" };
        let lines = format!("was awaited, after {after} lines");
        says(
            &place.play(&broken, &SHORT),
            2,
            &[
                "error: the machine: ",
                run,
                "status: 3",
                "ends with: the belt is broken",
                &lines,
                "the same command goes on",
            ],
        );
        let kept = names(&place.at("c")).iter().filter(|name| name.starts_with("run-")).count();
        assert_eq!(kept, if after < 5 { 0 } else { 2 }, "after {after} lines");
        assert_eq!(result_alone(&place.play(&good, &SHORT)), unbroken, "after {after} lines");
        std::fs::remove_dir_all(place.at("c")).expect("removed");
    }
    // One line more than the campaign has: nothing breaks.
    let long = place.machine(&SHORT, &format!("{PARTS} --fault die --after {LINES}"));
    assert_eq!(result_alone(&place.play(&long, &SHORT)), unbroken);
}

#[test]
fn a_campaign_killed_at_any_line_goes_on() {
    let place = Place::new("mass_spring_drag.tpm");
    let unbroken = place.identified(&SHORT);
    let good = place.machine(&SHORT, PARTS);
    for after in 0..LINES {
        let marker = format!("line-{after}");
        let hangs = place.machine(&SHORT, &format!("{PARTS} --fault hang --after {after} --marker {marker}"));
        let mut tool = place.begin(&hangs, "20");
        place.wait_for(&marker);
        tool.kill().expect("it runs");
        tool.wait().expect("it ended");
        assert_eq!(result_alone(&place.play(&good, &SHORT)), unbroken, "after {after} lines");
        std::fs::remove_dir_all(place.at("c")).expect("removed");
    }
}

#[test]
fn every_fault_of_a_machine_is_named_and_loses_one_run_at_most() {
    let place = Place::new("mass_spring_drag.tpm");
    let unbroken = place.identified(&SHORT);
    let good = place.machine(&SHORT, PARTS);
    for (fault, parts) in [
        (
            "--fault torn --after 6",
            &["run 2: it ended with exit status: 4", "the line does not end: {\"type\":\"samples\""][..],
        ),
        (
            "--fault garbage --after 6",
            &["run 2: line 7 of its output", "`Traceback (most", "xxx ... (235 characters)`"],
        ),
        ("--fault nan --after 6", &["run 2: line 7", "JSON has no NaN: a reading that failed is null"]),
        ("--fault lost --after 6", &["run 2: line 7", "samples from 10000 came where 5000 is next"]),
        ("--fault lost --after 7", &["run 2: line 8", "11200 samples were recorded, and 10000 came"]),
        ("--fault error --after 6", &["run 2: it says: drive fault 17"]),
        ("--fault stop --after 5", &["run 2: it says: stopped before the first sample: limit switch"]),
        ("--samples --fault error --after 14020", &["run 2: it says: drive fault 17"]),
        ("--samples --fault lost --after 14020", &["run 2: it said nothing for 3 s; a measured sample was awaited"]),
        ("--samples --fault nan --after 14020", &["run 2: line 14021", "JSON has no NaN"]),
        ("--fault hang --after 0", &["run 1: it said nothing for 3 s; its greeting was awaited, after 0 lines"]),
    ] {
        let more = if fault.starts_with("--samples") { fault.to_owned() } else { format!("{PARTS} {fault}") };
        let machine = place.machine(&SHORT, &more);
        // A loaded computer may start a program slowly: the wait is short only where it is what is tested.
        let patience = if parts.iter().any(|part| part.contains("said nothing")) { "3" } else { "20" };
        says(&tpm_in(place.folder.path(), &place.arguments(&machine, patience, &SHORT)), 2, parts);
        assert_eq!(result_alone(&place.play(&good, &SHORT)), unbroken, "{fault}");
        std::fs::remove_dir_all(place.at("c")).expect("removed");
    }
}

#[test]
fn a_machine_that_stops_makes_the_next_run_smaller() {
    let place = Place::new("mass_spring_drag.tpm");
    // The first part of a run, and then the end in place of the second part.
    let stops = "import json, sys
for line in sys.stdin:
    told = json.loads(line)
    if told['type'] == 'hello':
        print(json.dumps({'type': 'hello', 'protocol': 'tpm.machine/1', 'plays': 'runs'}), flush=True)
    if told['type'] == 'run':
        x, u = told['reference']['x'][0][:900], told['feed_forward']['u'][:900]
        print(json.dumps({'type': 'samples', 'from': 0, 'coordinates': {'x': x}, 'inputs': {'u': u}}), flush=True)
        print(json.dumps({'type': 'end', 'samples': 900, 'stopped': 'limit switch'}), flush=True)
";
    if !python() {
        return skipped("no python3");
    }
    std::fs::write(place.at("stops.py"), stops).expect("written");
    let played = place.play("python3 stops.py", &[&SHORT[..], &["--set", "limits.max_aborts=1"]].concat());
    let said = String::from_utf8_lossy(&played.stderr);
    assert!(
        said.contains("run 1: stopped") && said.contains("remark: run 1: the machine stopped: limit switch"),
        "{said}"
    );
    assert_eq!(played.status.code(), Some(1));
    let result = result_alone(&played);
    let amplitude = |run: usize| result["runs"][run]["amplitudes"][0][1].as_f64().expect("an amplitude");
    assert!((amplitude(1) / amplitude(0) - 0.5).abs() < 1e-12, "{result}");
}

#[cfg(unix)]
#[test]
fn ctrl_c_stops_the_machine_and_keeps_the_finished_runs() {
    let place = Place::new("mass_spring_drag.tpm");
    let interrupt = |machine: &str, marker: &str| {
        let tool = place.begin(machine, "3");
        place.wait_for(marker);
        let told = Command::new("kill").args(["-INT", &tool.id().to_string()]).status().expect("kill runs");
        assert!(told.success());
        let began = Instant::now();
        let output = tool.wait_with_output().expect("it ends");
        says(&output, 130, &["the machine was told to stop; finished runs are kept in c", "interrupted"]);
        began.elapsed()
    };
    // In the second run, with a machine that listens.
    let hangs = place.machine(&SHORT, &format!("{PARTS} --fault hang --after 6 --marker second"));
    assert!(interrupt(&hangs, "second") < Duration::from_secs(2));
    let kept = names(&place.at("c"));
    assert!(kept.contains(&"run-001.json".to_owned()) && !kept.contains(&"run-002.json".to_owned()), "{kept:?}");
    // With a machine that listens to nobody, which is killed.
    let deaf = "sh -c 'trap \"\" INT TERM; echo > deaf; exec sleep 50'";
    let waited = interrupt(deaf, "deaf");
    assert!(waited > Duration::from_secs(2) && waited < Duration::from_secs(20), "{waited:?}");
    assert_eq!(result_alone(&place.play(&place.machine(&SHORT, PARTS), &SHORT)), place.identified(&SHORT));
}

#[test]
fn what_is_no_machine_is_refused() {
    let place = Place::new("mass_spring_drag.tpm");
    for (machine, parts) in [
        ("no_such_program --fast", &["run 1: `no_such_program` cannot be started: "][..]),
        ("sh -c 'exit", &["the command `sh -c 'exit`: the quote ' is not closed"]),
        ("", &["it names no program"]),
        ("sh -c 'exit 0'", &["run 1: it ended with exit status: 0; its greeting was awaited, after 0 lines"]),
        (
            "echo '{\"type\":\"hello\",\"protocol\":\"tpm.machine/7\",\"plays\":\"runs\"}'",
            &["line 1 of its output: it speaks `tpm.machine/7`, this program tpm.machine/1"],
        ),
        (
            "echo '{\"type\":\"end\",\"samples\":0}'",
            &["line 1 of its output is a message `end`; its greeting was awaited"],
        ),
    ] {
        says(&place.play(machine, &SHORT), 2, parts);
    }
    let folder = place.folder.path();
    let timeout = tpm_in(folder, &["campaign", "run", &place.model, "--machine", "true", "--timeout", "-1"]);
    assert_eq!(timeout.status.code(), Some(2));
    // The folder of another experiment.
    let other = place.play("true", &["--set", "seed=9"]);
    says(&other, 2, &["another experiment"]);
}

fn python() -> bool {
    Command::new("python3").arg("--version").output().is_ok_and(|output| output.status.success())
}

/// The program in `examples`, on either side of the loop, gives the parameters that it was started with.
#[test]
fn the_example_in_python_is_identified() {
    if !python() {
        return skipped("no python3");
    }
    let example = root().join("examples/mass_spring_drag.py");
    for plays in ["runs", "samples"] {
        let place = Place::new("mass_spring_drag.tpm");
        let machine = format!("python3 '{}' --plays {plays} --mass 2.4 --seed 3", example.display());
        let sets = ["--set", "schedule.max_runs=4", "--set", "schedule.measure_time=4"];
        let played = place.play(&machine, &sets);
        let result = result_alone(&played);
        let parameters = result["parameters"].as_array().expect("a list");
        for (parameter, truth) in parameters.iter().zip([2.4, 40.0, 1.5]) {
            let [value, std] = ["value", "std"].map(|field| parameter[field].as_f64().expect("identified"));
            assert!((value - truth).abs() < 4.0 * std && std < 0.02 * truth, "{plays}: {parameter}");
        }
        assert_eq!(parameters.len(), 3);
    }
}
