//! A campaign by files: driven by the simulated plant through `next`, `simulate` and `submit` alone, it is the one that
//! `identify` runs; stopped anywhere, it goes on where it was.

use crate::support::{names, printed_in, result_alone, root, tpm, tpm_in};
use std::path::PathBuf;
use std::process::Output;
use tempfile::TempDir;

const SHORT: [&str; 6] =
    ["--set", "schedule.max_runs=3", "--set", "schedule.measure_time=6", "--set", "schedule.updates_per_stage=1"];

/// A folder in which the shipped mass with spring and drag is played.
struct Place {
    folder: TempDir,
    model: String,
}

impl Place {
    fn new() -> Self {
        Place { folder: tempfile::tempdir().expect("a folder"), model: shipped("mass_spring_drag.tpm") }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.at(name)).expect("a file")
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.at(name), text).expect("written");
    }

    fn tpm(&self, arguments: &[&str]) -> Output {
        tpm_in(self.folder.path(), arguments)
    }

    /// What the tool prints when all is well.
    fn run(&self, arguments: &[&str]) -> String {
        printed_in(self.folder.path(), arguments, 0)
    }

    /// Begins the campaign in the folder `c`.
    fn start(&self, sets: &[&str]) {
        self.run(&[&["campaign", "start", &self.model, "c"], sets].concat());
    }

    /// Writes what to play next.
    fn next(&self, run: &str) {
        self.run(&["campaign", "next", "c", "-o", run]);
    }

    /// Plays `run.csv` on the simulated machine.
    fn simulate(&self, log: &str, sets: &[&str]) {
        self.run(&[&["simulate", &self.model, "--play", "run.csv", "-o", log], sets].concat());
    }

    /// Begins the campaign, and plays its first run: `run.csv`, `log.csv`.
    fn first_run(&self) {
        self.start(&SHORT);
        self.next("run.csv");
        self.simulate("log.csv", &SHORT);
    }

    fn submit(&self, log: &str) -> String {
        self.run(&["campaign", "submit", "c", log])
    }

    /// Runs the tool where no file can grow beyond 64 kB, which the samples of a run do.
    #[cfg(target_os = "linux")]
    fn without_room(&self, arguments: &[&str]) -> Output {
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", "trap '' XFSZ; ulimit -f 128; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_tpm")]);
        shell.args(arguments).current_dir(self.folder.path()).output().expect("a shell")
    }

    /// The arguments of `identify` with its runs in a folder.
    fn identify<'a>(&'a self, runs: &'a str) -> Vec<&'a str> {
        [&["identify", &self.model, "--json", "--runs", runs], &SHORT[..]].concat()
    }

    /// The runs in the folder `c` give what `identify` gives.
    fn gives_the_result_of_identify(&self, sets: &[&str]) {
        let files = result_alone(&self.tpm(&["campaign", "result", "c", "--json"]));
        let whole = result_alone(&tpm(&[&["identify", &self.model, "--json"], sets].concat()));
        assert_eq!(files, whole);
    }
}

/// Path of a shipped model or experiment.
fn shipped(name: &str) -> String {
    root().join("models").join(name).display().to_string()
}

/// The command failed and says this on standard error.
fn says(output: &Output, code: i32, said: &str) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(code) && error.contains(said), "{said}: {output:?}");
}

fn plain_json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn files_alone_give_the_result_of_identify() {
    let place = Place::new();
    place.start(&SHORT);
    for n in 1..=3 {
        place.next("run.csv");
        place.simulate("log.csv", &SHORT);
        let said = if n == 2 {
            // A controller that counts, and calls the force otherwise.
            let (text, mut counts) = (place.read("log.csv"), String::new());
            for (i, line) in text.lines().enumerate() {
                let fields: Vec<&str> = line.split(',').collect();
                let doubled =
                    |x: &str| x.parse::<f64>().map_or_else(|_| "counts".to_owned(), |x| (2.0 * x).to_string());
                let force = if i == 0 { "command" } else { fields[2] };
                counts.push_str(&format!("{},{},{force}\n", fields[0], doubled(fields[1])));
            }
            place.write("log.csv", &counts);
            let columns = ["--map", "x=counts", "--scale", "x=0.5", "--map", "u=command"];
            place.run(&[&["campaign", "submit", "c", "log.csv"], &columns[..]].concat())
        } else {
            place.submit("log.csv")
        };
        assert!(said.contains(&format!("run {n}: complete")), "{said}");
        assert_eq!(said.contains("ended"), n == 3, "{said}");
    }
    let over = place.tpm(&["campaign", "next", "c", "-o", "none.csv"]);
    assert_eq!(over.status.code(), Some(1));
    assert!(!place.at("none.csv").exists());
    place.gives_the_result_of_identify(&SHORT);
    // Nobody knows on what the logs were recorded.
    let text = String::from_utf8(place.tpm(&["campaign", "result", "c"]).stdout).expect("text");
    assert!(text.starts_with("model MassSpringDrag from the runs in its folder; estimator"), "{text}");
}

#[test]
fn measured_rates_go_by_file_too() {
    let place = Place::new();
    let tachometer = ["--set", "estimator=error", "--set", "plant.sensors.x.rate_noise=1e-3"];
    let sets = [&SHORT[..], &tachometer[..], &["--set", "schedule.max_runs=2"]].concat();
    place.start(&sets);
    for _ in 0..2 {
        place.next("run.csv");
        place.simulate("log.csv", &sets);
        let log = place.read("log.csv");
        assert!(log.starts_with("t_s,x,u,dot(x)\n"), "{}", &log[..40]);
        place.submit("log.csv");
    }
    place.gives_the_result_of_identify(&sets);
}

#[test]
fn a_stopped_campaign_goes_on_where_it_was() {
    let place = Place::new();
    let identify = |runs: &str| result_alone(&place.tpm(&place.identify(runs)));
    let unbroken = identify("a");
    assert_eq!(
        names(&place.at("a")),
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
    std::fs::create_dir(place.at("b")).expect("a folder");
    for name in ["campaign.json", "experiment.toml", "model.tpm", "run-001.csv", "run-001.json"] {
        std::fs::copy(place.at("a").join(name), place.at("b").join(name)).expect("copied");
    }
    let whole = place.read("a/run-002.csv");
    let half = &whole[..whole.len() / 2];
    place.write("b/run-002.csv", half);
    assert_eq!(identify("b"), unbroken);
    assert_eq!(place.read("b/run-002.csv"), whole);
    // Samples that are not those of the manifest, and a manifest from another model or experiment, are refused.
    place.write("b/run-002.csv", half);
    says(&place.tpm(&[&["identify", &place.model, "--runs", "b"], &SHORT[..]].concat()), 2, "run-002.csv");
    says(&place.tpm(&["identify", &place.model, "--runs", "a", "--set", "seed=9"]), 2, "another experiment");
    says(&place.tpm(&["identify", &shipped("two_carts.tpm"), "--runs", "a"]), 2, "another model");
}

#[test]
fn bad_logs_are_refused_and_nothing_is_lost() {
    let place = Place::new();
    says(&place.tpm(&["campaign", "next", "c"]), 2, "campaign start");
    place.first_run();
    let log = place.read("log.csv");
    let lines: Vec<&str> = log.lines().collect();
    let refuse = |text: &str, expected: &str| {
        place.write("bad.csv", text);
        says(&place.tpm(&["campaign", "submit", "c", "bad.csv"]), 2, expected);
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
    place.write("far.csv", &far.join("\n"));
    let said = place.submit("far.csv");
    assert!(said.contains("tracking bound"), "{said}");
    assert!(names(&place.at("c")).contains(&"run-001.json".to_owned()));
    assert_eq!(place.read("c/run-001.csv").lines().count(), 801);
}

#[test]
fn reading_a_campaign_writes_nothing_and_an_unstable_loop_begins_none() {
    let place = Place::new();
    place.first_run();
    place.submit("log.csv");
    let written = || {
        let name =
            |name: &String| place.at("c").join(name).metadata().and_then(|file| file.modified()).expect("a file");
        names(&place.at("c")).iter().map(name).collect::<Vec<_>>()
    };
    let before = written();
    place.next("run.csv");
    place.tpm(&["campaign", "result", "c"]);
    assert_eq!(written(), before);
    let feedback = "control.feedback=[{ input = 'u', coordinate = 'x', kp = 1.0, kd = -60.0 }]";
    let unstable = ["--set", "prior.m=2", "--set", "prior.k1=40", "--set", feedback];
    says(&place.tpm(&[&["identify", &place.model, "--runs", "none"], &unstable[..]].concat()), 2, "stable");
    assert!(!place.at("none").exists());
}

#[test]
fn a_design_is_judged_before_anything_moves() {
    let model = shipped("mass_spring_drag.tpm");
    let arguments = ["design", &model, "--json"];
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
    let arm = shipped("closed_loop_arm.tpm");
    let zero = ["prior.a10=0", "prior.a20=0", "prior.a30=0", "prior.a11=0", "prior.a21=0", "prior.a31=0"];
    let zero = zero.iter().flat_map(|value| ["--set", value]);
    let arguments: Vec<&str> = ["design", &arm].into_iter().chain(zero).collect();
    crate::support::fails(&arguments, 2, &["a10 = 0", "give prior values"]);
}

/// A mechanism is excited by series of its joints, whose files play again.
#[test]
fn an_arm_is_excited_and_its_files_play() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let urdf = r#"<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="4"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.06" iyz="0" izz="0.06"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
    <inertia ixx="0.004" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <joint name="q1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="60"/><dynamics damping="0.5" friction="1"/></joint>
  <joint name="q2" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="4" effort="25"/><dynamics damping="0.3" friction="0.5"/></joint>
</robot>"#;
    std::fs::write(at("arm.urdf"), urdf).expect("written");
    says(&tpm(&["import", &at("arm.urdf"), "-o", &at("arm.tpm")]), 0, "");
    let experiment = at("arm.experiment.toml");
    let arm = at("arm.tpm");
    let common = ["design", &arm, "--experiment", &experiment, "--starts", "4"];
    let written = at("excitation");
    let found = plain_json(&tpm(&[&common[..], &["--json", "--write", &written]].concat()));
    assert_eq!((found["schema"].as_str(), found["feasible"].as_u64()), (Some("tpm.excitation/1"), Some(4)));
    let condition = found["motions"][0]["condition"].as_f64().expect("a number");
    assert!(condition.ln() < found["before"].as_f64().expect("a number"), "{condition}");
    for used in found["motions"][0]["used"].as_array().expect("a list") {
        assert!(used["share"].as_f64().is_none_or(|share| share <= 1.0), "{used}");
    }
    assert_eq!(names(folder.path().join("excitation").as_path()), ["arm.csv", "arm.svg", "arm.toml", "arm.tpm"]);
    let played = at("excitation/arm.tpm");
    says(&tpm(&["simulate", &played, "-o", &at("run.csv")]), 0, "");
    // With drives that cannot hold the weight there is no motion, and nothing is written.
    let weak = ["--set", "limits.inputs.tau_q1=0.5", "--write", &at("none")];
    crate::support::fails(&[&common[..], &weak].concat(), 2, &["none of 4 motions", "--period"]);
    assert!(!folder.path().join("none").exists());
    crate::support::fails(&[&common[..], &["--seconds", "0"]].concat(), 2, &["--seconds 0"]);
}

/// A file system that takes no more when the second run is written: what is there stays, and the campaign goes on when there is room.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_keeps_the_finished_runs() {
    let place = Place::new();
    place.first_run();
    let full = place.without_room(&["campaign", "submit", "c", "log.csv"]);
    let error = String::from_utf8_lossy(&full.stderr).into_owned();
    assert!(
        error.contains("run-001") && error.contains("File too large") && error.contains("finished runs"),
        "{error}"
    );
    assert!(!names(&place.at("c")).iter().any(|name| name.contains("run-001") || name.starts_with(".tpm-")));
    assert!(place.submit("log.csv").contains("run 1: complete"));
    let full = place.without_room(&place.identify("c"));
    assert_eq!(full.status.code(), Some(2));
    let error = String::from_utf8_lossy(&full.stderr).into_owned();
    assert!(
        error.contains("run-002") && error.contains("File too large") && error.contains("finished runs"),
        "{error}"
    );
    let kept = names(&place.at("c"));
    assert!(kept.contains(&"run-001.json".to_owned()) && !kept.iter().any(|name| name.contains("run-002")), "{kept:?}");
    assert_eq!(result_alone(&place.tpm(&place.identify("c"))), result_alone(&place.tpm(&place.identify("whole"))));
}

/// Every shipped experiment, cut to two runs: a folder says of its runs what the campaign that played them said. Along the arm a refinement
/// takes a quarter of a minute; on one pattern it is refused sooner, and the carts are refined.
#[test]
fn identify_and_campaign_result_say_the_same_of_every_shipped_experiment() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    for (model, experiment, refine) in [
        ("mass_spring_drag", "mass_spring_drag", "refine=auto"),
        ("two_carts", "two_carts", "refine=auto"),
        ("closed_loop_arm", "closed_loop_arm", "refine=none"),
        ("closed_loop_arm", "closed_loop_arm_thesis", "refine=auto"),
        ("rotary_pendulum_down", "rotary_pendulum_down", "refine=auto"),
    ] {
        let [model, file] = [format!("{model}.tpm"), format!("{experiment}.toml")].map(|name| shipped(&name));
        let short = ["--set", "schedule.max_runs=2", "--set", "schedule.measure_time=4", "--set", refine];
        let played =
            [&["identify", &model, "--experiment", &file, "--runs", experiment, "--json"], &short[..]].concat();
        let (played, kept) = (tpm_in(at, &played), tpm_in(at, &["campaign", "result", experiment, "--json"]));
        assert_eq!(played.status.code(), kept.status.code(), "{experiment}");
        assert_eq!(String::from_utf8_lossy(&played.stderr), String::from_utf8_lossy(&kept.stderr), "{experiment}");
        let [played, kept] = [result_alone(&played), result_alone(&kept)];
        assert_eq!(played["runs"].as_array().map(Vec::len), Some(2), "{experiment}");
        for part in ["parameters", "physical", "combinations", "unobservable", "covariance", "warnings", "findings"] {
            assert_eq!(played[part], kept[part], "{experiment}: {part}");
        }
        assert_eq!(played, kept, "{experiment}");
    }
}

#[test]
fn a_run_says_all_that_its_controller_needs_and_one_of_the_earlier_form_can_be_played() {
    let place = Place::new();
    place.start(&SHORT);
    place.next("run.csv");
    let mut terms: serde_json::Value = serde_json::from_str(&place.read("run.json")).expect("JSON");
    assert_eq!(terms["schema"], "tpm.play/2");
    let rows = place.read("run.csv").lines().count() - 1;
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
    place.simulate("now.csv", &SHORT);
    let fields = terms.as_object_mut().expect("an object");
    for new in ["timing", "law"] {
        assert!(fields.remove(new).is_some(), "{new}");
    }
    fields.insert("schema".to_owned(), "tpm.play/1".into());
    place.write("run.json", &terms.to_string());
    place.simulate("earlier.csv", &SHORT);
    assert_eq!(place.read("now.csv"), place.read("earlier.csv"));
}

#[test]
fn a_run_that_the_machine_stopped_can_be_submitted_and_leads_to_backing_off() {
    let place = Place::new();
    place.first_run();
    let whole = place.read("log.csv");
    let half: Vec<&str> = whole.lines().take(3000).collect();
    place.write("half.csv", &half.join("\n"));
    says(&place.tpm(&["campaign", "submit", "c", "half.csv"]), 2, "--stopped");
    let said = place.run(&["campaign", "submit", "c", "half.csv", "--stopped"]);
    assert!(said.starts_with("run 1: stopped") && said.contains("amplitudes reduced"), "{said}");
    let peak = |name: &str| {
        let text = place.read(name);
        let of = |line: &str| line.split(',').nth(1).and_then(|x| x.parse::<f64>().ok()).map(f64::abs);
        text.lines().filter_map(of).fold(0.0, f64::max)
    };
    place.next("again.csv");
    assert!((peak("again.csv") / peak("run.csv") - 0.5).abs() < 1e-9);
}

#[test]
fn a_log_counts_once_whatever_its_name_and_form() {
    let place = Place::new();
    place.first_run();
    place.submit("log.csv");
    place.next("run.csv");
    let kept = names(&place.at("c"));
    let refused = |log: &str, columns: &[&str]| {
        let output = place.tpm(&[&["campaign", "submit", "c", log], columns].concat());
        says(&output, 2, "holds the samples of run 1, which the campaign has already");
        says(&output, 2, "play run 2");
        assert_eq!(names(&place.at("c")), kept);
    };
    refused("log.csv", &[]);
    // Other columns do not make another run of it.
    refused("log.csv", &["--scale", "x=2"]);
    // Other bytes, equal numbers: another name, another order of columns, another way to write a number, other line ends.
    let mut other = String::from("u,x,t_s\r\n");
    for line in place.read("log.csv").lines().skip(1) {
        let fields: Vec<f64> = line.split(',').map(|field| field.parse().expect("a number")).collect();
        other.push_str(&format!("{:e},{:e},{}\r\n", fields[2], fields[1], fields[0]));
    }
    place.write("other.csv", &other);
    refused("other.csv", &[]);
    refused("c/run-001.csv", &[]);
    place.simulate("log.csv", &SHORT);
    assert!(place.submit("log.csv").starts_with("run 2: complete;"));
}

#[test]
fn a_run_that_contradicts_the_others_is_named_at_once() {
    let place = Place::new();
    place.first_run();
    place.submit("log.csv");
    place.next("run.csv");
    place.simulate("log.csv", &[&SHORT[..], &["--set", "plant.parameters.m=2.2"]].concat());
    let said = place.submit("log.csv");
    assert!(said.starts_with("run 2: complete, not pooled; m = "), "{said}");
    assert!(said.contains("warning: run 2 contradicts run 1: m differs most, by ") && said.contains("again"), "{said}");
    assert!(said.ends_with("next: tpm campaign next c -o run.csv\n"), "{said}");
    assert!(names(&place.at("c")).contains(&"run-002.json".to_owned()));
    // Played again, the run tells which of the two was wrong.
    place.next("run.csv");
    place.simulate("log.csv", &SHORT);
    let said = place.submit("log.csv");
    assert!(said.starts_with("run 3: complete; m = ") && said.contains("run 2 contradicts runs 1, 3: m"), "{said}");
    let text = String::from_utf8(place.tpm(&["campaign", "result", "c"]).stdout).expect("text");
    assert!(text.contains("complete, not pooled") && text.contains("run 2 contradicts runs 1, 3: m"), "{text}");
    let result = plain_json(&place.tpm(&["campaign", "result", "c", "--json"]));
    assert_eq!(result["runs"][1]["contradicts"]["parameter"], "m");
}

#[test]
fn what_ends_a_campaign_is_said_when_it_does() {
    // Whether and how the campaign ends when logs, changed in this way, are submitted.
    let ends = |sets: &[&str], arguments: &[&str], change: &dyn Fn(&mut Vec<Vec<f64>>)| {
        let place = Place::new();
        let sets = [&["--set", "schedule.measure_time=6"], sets].concat();
        place.start(&sets);
        let mut all = Vec::new();
        while !all.last().is_some_and(|said: &String| said.contains("\nended: ")) {
            assert!(all.len() < 6, "{all:?}");
            place.next("run.csv");
            place.simulate("log.csv", &sets);
            let log = place.read("log.csv");
            let numbers = |line: &str| line.split(',').map(|field| field.parse().expect("a number")).collect();
            let mut rows: Vec<Vec<f64>> = log.lines().skip(1).map(numbers).collect();
            change(&mut rows);
            let line = |row: &Vec<f64>| row.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            let text: Vec<String> = rows.iter().map(line).collect();
            place.write("log.csv", &format!("t_s,x,u\n{}\n", text.join("\n")));
            all.push(place.run(&[&["campaign", "submit", "c", "log.csv"], arguments].concat()));
        }
        all
    };
    let said = |all: &[String], runs: usize, parts: &[&str]| {
        assert_eq!(all.len(), runs, "{all:?}");
        let last = all.last().expect("submitted");
        parts.iter().for_each(|part| assert!(last.contains(part), "{part}: {last}"));
    };
    let nothing = |_: &mut Vec<Vec<f64>>| ();

    // Something slips at the beginning of the third period from the end.
    let slips = |rows: &mut Vec<Vec<f64>>| {
        let last = rows.len().saturating_sub(5800);
        rows[..last].iter_mut().for_each(|row| row[1] += 0.02);
    };
    let all = ends(&[], &[], &slips);
    assert!(all[0].starts_with("run 1: unsettled") && all[0].contains("it was played again for longer"), "{all:?}");
    let early = "warning: the campaign ended early: the motion did not settle";
    said(&all, 4, &["run 4: the motion had not settled\n", early, "ended: the motion did not settle;"]);

    let all = ends(&["--set", "limits.max_aborts=1"], &["--stopped"], &|rows| rows.truncate(3000));
    assert!(all[0].contains("run 1: aborted (stopped), amplitudes reduced\n"), "{all:?}");
    said(&all, 2, &["run 2: aborted (stopped)\n", "ended early: run after run", "ended: run after run"]);

    let far = |rows: &mut Vec<Vec<f64>>| rows[700][1] = 9.0;
    let all = ends(&["--set", "limits.max_aborts=0"], &[], &far);
    said(&all, 1, &["run 1: tracking bound", "run 1: aborted (tracking bound)\n", "ended: run after run"]);

    // A drive that was cut at its limit once.
    let all = ends(&[], &[], &|rows| rows[9000][2] = 800.0);
    said(
        &all,
        1,
        &["ended early: an input was cut at its limit: the command of u", "ended: an input was cut at its limit: the"],
    );

    let all = ends(&["--set", "limits.effort_share=0.01"], &[], &nothing);
    said(&all, 1, &["ended: an input reached the stated share of its limit: the command of u"]);

    let all = ends(&["--set", "schedule.max_runs=1"], &[], &nothing);
    said(&all, 1, &["ended early: all runs were used", "ended: all runs were used before the estimates converged;"]);
}

#[test]
fn how_the_method_came_to_its_parameters_is_shown_on_request() {
    let identify = |more: &[&str]| {
        let known =
            ["--set", "prior.m=2.1", "--set", "prior.k1=38", "--set", "prior.k2=1.4", "--set", "estimator=error"];
        let output = tpm(&[&["identify", "models/mass_spring_drag.tpm"], &SHORT[..], &known, more].concat());
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let text = identify(&["--method"]);
    for words in ["Run 1: lambda = 0.2, 3.14159 rad/s", "Error of x [m]", "Input u [N]", "T B Lambda", "\nUpdates\n"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert!(identify(&["--method=markdown"]).contains("### Updates\n\n| run | w [rad/s] | rms error | m | k1 | k2 |"));
    let result: serde_json::Value = serde_json::from_str(&identify(&["--method", "--json"])).expect("JSON");
    let method = &result["method"];
    assert_eq!(method["runs"].as_array().map(Vec::len), result["runs"].as_array().map(Vec::len));
    assert_eq!((&method["updates"][0]["run"], &method["updates"][0]["values"][0]), (&0.into(), &2.1.into()));
    let fundamental = &method["runs"][0]["signals"][0]["lines"][1];
    let size = |of: &str| fundamental[of]["size"].as_f64().expect("a number");
    let noise = fundamental["noise"].as_f64().expect("a number");
    assert!((size("measured") - size("predicted")).abs() < 5.0 * noise, "{fundamental}");
    assert!(!identify(&[]).contains("T B Lambda"));
}
