//! The estimators on a controller beside that of the measured motion: generated, compiled and run on the samples of the runtime's own
//! campaigns, in C and Rust, double and single precision.

use crate::controller::{CHAIN, Found, Program, SAMPLE_TIME, TRUTH, in_c, in_rust, programs};
use crate::support::{printed, root, tpm};
use std::fmt::Write as _;
use std::path::Path;

/// The parameters of a run's feed-forward, and its samples with their reference.
struct Played {
    parameters: [f64; 5],
    rows: String,
}

/// So many runs of the shipped experiment's last stage in a campaign's folder, the feed-forward of the first with these parameters: what the
/// runtime's estimator finds in them, with deviations, and the runs.
fn played(
    folder: &Path,
    estimator: &str,
    seed: u32,
    prior: &[f64; 5],
    noise: f64,
    runs: u32,
) -> ([[f64; 2]; 5], Vec<Played>) {
    let experiment = root().join("models/experiments/two_carts.toml");
    let name = |name: &str| folder.join(format!("{estimator}-{seed}-{name}")).to_str().expect("readable").to_owned();
    let (campaign, next, log) = (name("runs"), name("next.csv"), name("log.csv"));
    let shipped = experiment.to_str().expect("readable");
    let names = ["m1", "m2", "k1", "k2", "k3"];
    let sets = names.iter().zip(prior).map(|(name, value)| format!("prior.{name}={value}"));
    let others = [format!("estimator={estimator}"), "schedule.stages=[{lambda=0.4,w=4.0}]".to_owned()];
    let set = |sets: Vec<String>| sets.into_iter().flat_map(|set| ["--set".to_owned(), set]).collect::<Vec<String>>();
    let noise = set(["x1", "x2"].map(|sensor| format!("plant.sensors.{sensor}.noise={noise}")).into());
    let sets = set(sets.chain(others).collect());
    let words = ["campaign", "start", CHAIN, &campaign, "--experiment", shipped];
    printed(&words.into_iter().chain(sets.iter().chain(&noise).map(String::as_str)).collect::<Vec<&str>>());
    let text = |path: &str| std::fs::read_to_string(path).expect("written");
    let json = |text: &[u8]| serde_json::from_slice::<serde_json::Value>(text).expect("JSON");
    let one = |run: u32| {
        printed(&["campaign", "next", &campaign, "-o", &next]);
        let seed = format!("seed={}", 100 * seed + run);
        let words = ["simulate", CHAIN, "--experiment", shipped, "--play", &next, "--set", &seed, "-o", &log];
        printed(&words.into_iter().chain(noise.iter().map(String::as_str)).collect::<Vec<&str>>());
        printed(&["campaign", "submit", &campaign, &log]);
        let (samples, references) = (text(&log), text(&next));
        let reference = |line: &str| line.split(',').skip(1).take(2).collect::<Vec<&str>>().join(",");
        let pairs = samples.lines().zip(references.lines()).skip(1);
        let rows = pairs.map(|(row, line)| format!("{row},{}\n", reference(line))).collect();
        let manifest = json(text(&format!("{campaign}/run-{run:03}.json")).as_bytes());
        let parameters = manifest["parameters"].as_array().expect("a list").iter().map(|value| value.as_f64());
        let parameters: Option<Vec<f64>> = parameters.collect();
        Played { parameters: parameters.and_then(|list| list.try_into().ok()).expect("five numbers"), rows }
    };
    let all: Vec<Played> = (1..=runs).map(one).collect();
    // These runs finish no campaign, so that the verb ends with another code than zero; what it says is whole.
    let result = json(&tpm(&["campaign", "result", &campaign, "--json"]).stdout);
    let number = |entry: &serde_json::Value, key: &str| entry[key].as_f64().unwrap_or(f64::NAN);
    let list = result["parameters"].as_array().expect("a list").iter();
    let list: Vec<[f64; 2]> = list.map(|entry| [number(entry, "value"), number(entry, "std")]).collect();
    (list.try_into().expect("five parameters"), all)
}

/// What a program in double precision found; `apart` takes how far any program is from it at most, first of those in double precision, then
/// of those in single precision, in the deviations that are asked for of a program's and the reference's.
fn in_double<'a>(
    all: &'a [Found],
    programs: &[Program],
    apart: &mut [f64; 2],
    deviations: impl Fn(&Found, &Found) -> [f64; 5],
) -> &'a Found {
    let reference = all.iter().zip(programs).find(|(_, program)| !program.single).expect("double precision").0;
    for (found, program) in all.iter().zip(programs) {
        let slot = &mut apart[usize::from(program.single)];
        for (i, deviation) in deviations(found, reference).into_iter().enumerate() {
            *slot = slot.max((found.values[i] - reference.values[i]).abs() / deviation);
        }
    }
    reference
}

/// The same run by the runtime's estimator and by the generated one: the runtime takes what was applied from its own loop, the controller
/// from the samples, and their noise weighs it.
#[test]
fn linearised_estimators_are_those_of_the_runtime_in_every_language_and_precision() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut programs = programs(folder.path(), "linearised");
    let prior = [2.1, 0.97, 41.0, 290.0, 195.0];
    let [samples, settle, periods] = [1571_u32, 4, 12];
    let mut report = String::new();
    let mut apart = [0.0_f64; 2];
    for estimator in ["error", "hill"] {
        for program in &mut programs {
            program.arguments = match (program.single, estimator) {
                (true, "error") => &["single", "error"],
                (true, _) => &["single", "hill"],
                (false, "error") => &["double", "error"],
                (false, _) => &["double", "hill"],
            };
        }
        let (mut worst, mut beside, mut runtime) = (0.0_f64, 0.0_f64, 0.0_f64);
        for seed in 1..=5 {
            let (of_runtime, runs) = played(folder.path(), estimator, seed, &prior, 1e-4, 1);
            let begin = prior.map(|value| value.to_string()).join(" ");
            let input = format!("{} {samples} {periods} {SAMPLE_TIME}\n{begin}\n{}", samples * settle, runs[0].rows);
            let all: Vec<Found> = programs.iter().map(|program| program.found(&input, folder.path())).collect();
            let reference = in_double(&all, &programs, &mut apart, |_, reference| reference.deviations);
            for i in 0..5 {
                worst = worst.max(((reference.values[i] - TRUTH[i]) / reference.deviations[i]).abs());
                let [value, deviation] = of_runtime[i];
                beside = beside.max((reference.values[i] - value).abs() / deviation.max(reference.deviations[i]));
                runtime = runtime.max(((value - TRUTH[i]) / deviation).abs());
            }
            let _ = writeln!(
                report,
                "{estimator} {seed}: {:?} {:?}; runtime {of_runtime:?}",
                reference.values, reference.deviations
            );
        }
        let _ =
            writeln!(report, "{estimator}: {worst} deviations off, {beside} beside the runtime, itself {runtime} off");
        assert!(worst < 4.0 && beside < 4.0, "{report}");
    }
    println!("{report}apart {apart:?}");
    assert!(apart[0] < 1e-9 && apart[1] < 0.1, "{apart:?}\n{report}");
}

/// The runs that the runtime's `numerical` asks for, a first one and one for every parameter: the same by the generated estimator. The
/// feed-forward is so near that the tracking error is in proportion to what is wrong with it.
#[test]
fn differences_of_runs_identify_the_chain_in_every_language_and_precision() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let programs = programs(folder.path(), "numerical");
    let prior = [2.002, 0.999, 40.05, 299.5, 199.8];
    let [samples, settle, periods] = [1571_u32, 4, 12];
    let mut report = String::new();
    let mut apart = [0.0_f64; 2];
    let (mut worst, mut beside) = (0.0_f64, 0.0_f64);
    for seed in 1..=3 {
        let (of_runtime, runs) = played(folder.path(), "numerical", seed, &prior, 1e-5, 6);
        let begin = runs[0].parameters.map(|value| value.to_string()).join(" ");
        let step = |run: &Played| -> [f64; 5] { std::array::from_fn(|i| run.parameters[i] - runs[0].parameters[i]) };
        let rows = runs[0].rows.lines().count();
        let mut input = format!("{} {samples} {periods} {SAMPLE_TIME} {rows}\n{begin}\n", samples * settle);
        for run in &runs {
            let steps = step(run).map(|value| value.to_string()).join(" ");
            assert_eq!(run.rows.lines().count(), rows, "runs of one length");
            let _ = write!(input, "{steps}\n{}", run.rows);
        }
        let all: Vec<Found> = programs.iter().map(|program| program.found(&input, folder.path())).collect();
        // In single precision the rounding of lines is larger than this noise, and in the deviations.
        let reference = in_double(&all, &programs, &mut apart, |found, _| found.deviations);
        for i in 0..5 {
            worst = worst.max(((reference.values[i] - TRUTH[i]) / reference.deviations[i]).abs());
            let [value, _] = of_runtime[i];
            beside = beside.max((reference.values[i] - value).abs() / reference.deviations[i]);
        }
        let _ = writeln!(report, "{seed}: {:?} {:?}; runtime {of_runtime:?}", reference.values, reference.deviations);
    }
    println!("{report}{worst} deviations off, {beside} beside the runtime; apart {apart:?}");
    assert!(worst < 4.0, "{report}");
    assert!(apart[0] < 1e-9 && apart[1] < 0.5, "{apart:?}\n{report}");
}

/// What stands in the equations of the cart-pendulum are M + m, m L and m L^2: the physical parameters follow by Gauss-Newton, with the
/// deviations that the covariance of the three gives them.
#[test]
fn physical_parameters_come_out_with_deviations() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let of = ("models/cart_pendulum.tpm", "physical", "run");
    let programs: Vec<Program> = in_c(folder.path(), of).into_iter().chain(in_rust(folder.path(), of)).collect();
    let (truth, prior) = ([10.0, 1.0, 0.4], "5 1.5 0.6");
    let mut apart = [0.0_f64; 2];
    let (mut squares, mut worst) = ([0.0; 3], 0.0_f64);
    let seeds = 1..=10;
    for seed in seeds.clone() {
        let path = folder.path().join("log.csv");
        let log = path.to_str().expect("readable");
        let mut command = vec!["simulate", of.0, "--experiment", "models/experiments/cart_pendulum.toml", "-o", log];
        let seed = format!("seed={seed}");
        for set in ["prior.M=10", "prior.m=1", "prior.L=0.4", &seed] {
            command.extend(["--set", set]);
        }
        printed(&command);
        // The first stage: three periods settle, four are measured.
        let rows = std::fs::read_to_string(&path).expect("written");
        let rows: Vec<&str> = rows.lines().skip(1).collect();
        assert!(rows.len() >= 7 * 6283, "{}", rows.len());
        let input = format!("{} 6283 4 0.001\n{prior}\n{}\n", 3 * 6283, rows.join("\n"));
        let found = |program: &Program| -> Vec<f64> {
            let text = program.printed(&input, folder.path());
            let numbers: Vec<f64> = text.lines().map(|line| line.parse().expect("a number")).collect();
            assert!(numbers.len() == 8 && numbers[0] == 0.0, "{}: {text}", program.name);
            numbers
        };
        let all: Vec<Vec<f64>> = programs.iter().map(found).collect();
        let reference = all.iter().zip(&programs).find(|(_, program)| !program.single).expect("double precision").0;
        for (found, program) in all.iter().zip(&programs) {
            for i in 0..3 {
                let slot = &mut apart[usize::from(program.single)];
                *slot = slot.max((found[1 + 2 * i] - reference[1 + 2 * i]).abs() / reference[2 + 2 * i]);
            }
        }
        for i in 0..3 {
            let error = (reference[1 + 2 * i] - truth[i]) / reference[2 + 2 * i];
            squares[i] += error * error / seeds.clone().count() as f64;
            worst = worst.max(error.abs());
        }
        println!("{reference:?}");
    }
    println!("mean squares of errors over deviations {squares:?}, worst {worst}; apart {apart:?}");
    assert!(worst < 4.0 && squares.iter().all(|square| (0.1..3.0).contains(square)), "{squares:?} {worst}");
    assert!(apart[0] < 1e-9 && apart[1] < 0.1, "{apart:?}");
}
