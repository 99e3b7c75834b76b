//! The estimator of a run on a controller: generated, compiled and run on the tool's own simulated logs, in C and Rust, double and single
//! precision.

use crate::support::{printed, root, skipped};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

pub(crate) const CHAIN: &str = "models/two_carts.tpm";
/// m1, m2, k1, k2, k3 of the simulated machine.
pub(crate) const TRUTH: [f64; 5] = [2.0, 1.0, 40.0, 300.0, 200.0];
/// Estimates before the run, up to a half off.
const PRIOR: [f64; 5] = [3.0, 0.5, 60.0, 150.0, 300.0];
/// The shipped experiment: samples of a period, periods that settle, and an even number of those that are measured.
const SHAPE: [u32; 3] = [1571, 3, 24];
pub(crate) const SAMPLE_TIME: f64 = 1e-3;

/// The functions of the crate `libm` that the code calls, over those of the standard library.
const LIBM: &str = "macro_rules! of { ($($name:ident $single:ident $method:ident),*) => {$(
    pub fn $name(x: f64) -> f64 { x.$method() } pub fn $single(x: f32) -> f32 { x.$method() })*} }
macro_rules! of_two { ($($name:ident $single:ident $method:ident),*) => {$(
    pub fn $name(x: f64, y: f64) -> f64 { x.$method(y) } pub fn $single(x: f32, y: f32) -> f32 { x.$method(y) })*} }
of!(sin sinf sin, cos cosf cos, tan tanf tan, asin asinf asin, acos acosf acos, atan atanf atan, sqrt sqrtf sqrt, exp expf exp,
    log logf ln, floor floorf floor, fabs fabsf abs);
of_two!(atan2 atan2f atan2, fmax fmaxf max, fmin fminf min);
";

/// What a program found: parameters, their deviations, and chi-squared with the noise of the first coordinate.
#[derive(Debug)]
pub(crate) struct Found {
    pub(crate) values: [f64; 5],
    pub(crate) deviations: [f64; 5],
    others: [f64; 2],
}

/// A program that reads a run, with its arguments.
pub(crate) struct Program {
    pub(crate) name: &'static str,
    path: PathBuf,
    pub(crate) arguments: &'static [&'static str],
    pub(crate) single: bool,
}

impl Program {
    /// What the program prints about a run.
    pub(crate) fn printed(&self, input: &str, folder: &Path) -> String {
        let place = folder.join("input");
        std::fs::write(&place, input).expect("writable");
        let input = std::fs::File::open(place).expect("there");
        let output = Command::new(&self.path).args(self.arguments).stdin(Stdio::from(input)).output().expect("it runs");
        assert!(output.status.success(), "{}: {output:?}", self.name);
        String::from_utf8(output.stdout).expect("text")
    }

    /// What a campaign prints with noise of this seed, where this goes wrong.
    fn campaign(&self, seed: usize, wrong: &str) -> String {
        let seed = seed.to_string();
        let output = Command::new(&self.path).arg(seed).args(self.arguments).arg(wrong).output().expect("it runs");
        assert!(output.status.success(), "{}: {output:?}", self.name);
        String::from_utf8(output.stdout).expect("text")
    }

    pub(crate) fn found(&self, input: &str, folder: &Path) -> Found {
        let text = self.printed(input, folder);
        let numbers: Vec<f64> = text.lines().map(|line| line.parse().expect("a number")).collect();
        assert!(numbers.len() == 13 && numbers[0] == 0.0, "{}: {text}", self.name);
        let every = |from: usize| std::array::from_fn(|index| numbers[from + 2 * index]);
        Found { values: every(1), deviations: every(2), others: [numbers[11], numbers[12]] }
    }
}

fn done(command: &mut Command) {
    let output = command.output().expect("the compiler runs");
    assert!(output.status.success(), "{command:?}\n{}", String::from_utf8_lossy(&output.stderr));
}

/// The programs in C of a model's part, with a main program of this name, where there is a compiler.
pub(crate) fn in_c(folder: &Path, (model, main, part): (&str, &str, &str)) -> Vec<Program> {
    let compiler = ["cc", "gcc", "clang"].into_iter().find(|name| Command::new(name).arg("--version").output().is_ok());
    let Some(compiler) = compiler else {
        skipped("no C compiler (cc, gcc, clang) was found, so that the estimator of a run in C was not run");
        return Vec::new();
    };
    let flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O1"];
    let of = |(real, name): (&'static str, &'static str)| {
        let place = folder.join(real);
        let out = place.to_str().expect("a readable path");
        printed(&["generate", model, "--lang", "c", "--prefix", "t", "--real", real, "--with", part, "-o", out]);
        for (file, copy) in [(format!("{main}.c"), "run.c"), ("shared.h".to_owned(), "shared.h")] {
            std::fs::copy(root().join("tpm-cli/tests/whole/controller").join(file), place.join(copy)).expect("copied");
        }
        done(Command::new(compiler).current_dir(&place).args(flags).args(["-c", "t.c"]));
        let main = ["-std=c99", &format!("-DREAL={real}"), "run.c", "t.o", "-o", "run", "-lm"];
        done(Command::new(compiler).current_dir(&place).args(main));
        Program { name, path: place.join("run"), arguments: &[], single: real == "float" }
    };
    [("double", "C, double"), ("float", "C, float")].map(of).into()
}

/// The program in Rust of a model's part, in both precisions.
pub(crate) fn in_rust(folder: &Path, (model, main, part): (&str, &str, &str)) -> Vec<Program> {
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let place = folder.join("rust");
    printed(&["generate", model, "--lang", "rust", "--with", part, "-o", place.to_str().expect("a readable path")]);
    for (file, copy) in [(format!("{main}.rs"), "run.rs"), ("shared.rs".to_owned(), "shared.rs")] {
        std::fs::copy(root().join("tpm-cli/tests/whole/controller").join(file), place.join(copy)).expect("copied");
    }
    std::fs::write(place.join("libm.rs"), LIBM).expect("writable");
    let library = ["--edition=2021", "--crate-type=rlib", "--crate-name=libm", "libm.rs"];
    done(Command::new(&rustc).current_dir(&place).args(library));
    let main = ["--edition=2021", "-O", "--extern", "libm=liblibm.rlib", "run.rs", "-o", "run"];
    done(Command::new(&rustc).current_dir(&place).args(main));
    let of = |(name, arguments, single): (_, &'static [&'static str], bool)| Program {
        name,
        path: place.join("run"),
        arguments,
        single,
    };
    [("Rust, f64", &["double"][..], false), ("Rust, f32", &["single"][..], true)].map(of).into()
}

/// The programs of a part in every language and precision.
pub(crate) fn programs(folder: &Path, part: &str) -> Vec<Program> {
    let of = (CHAIN, part, part);
    in_c(folder, of).into_iter().chain(in_rust(folder, of)).collect()
}

/// A simulated log of the shipped experiment with the true parameters in its feed-forward.
fn log(folder: &Path, seed: usize) -> String {
    let path = folder.join("log.csv");
    let mut arguments: Vec<String> =
        ["simulate", CHAIN, "-o", path.to_str().expect("readable")].map(str::to_owned).into();
    let names = ["m1", "m2", "k1", "k2", "k3"];
    let sets = names.iter().zip(TRUTH).map(|(name, value)| format!("prior.{name}={value}"));
    for set in sets.chain([format!("seed={seed}")]) {
        arguments.extend(["--set".to_owned(), set]);
    }
    printed(&arguments.iter().map(String::as_str).collect::<Vec<&str>>());
    let text = std::fs::read_to_string(path).expect("written");
    text.lines().skip(1).fold(String::new(), |rows, row| rows + row + "\n")
}

/// The input of a program: the shape of the run, the prior, and rows.
fn input(shape: [u32; 3], rows: &str) -> String {
    let [samples, settle, periods] = shape;
    let prior = PRIOR.map(|value| value.to_string()).join(" ");
    format!("{} {samples} {periods} {SAMPLE_TIME}\n{prior}\n{rows}", samples * settle)
}

#[test]
fn the_chain_is_identified_by_one_run_in_every_language_and_precision() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let programs = programs(folder.path(), "run");
    let mut report = String::new();
    let (mut squares, mut within, mut runs) = ([0.0; 5], 0, 0);
    let mut apart = [0.0_f64; 2];
    for seed in 1..=20 {
        let rows = log(folder.path(), seed);
        let input = input(SHAPE, &rows);
        let all: Vec<Found> = programs.iter().map(|program| program.found(&input, folder.path())).collect();
        let first = all.last().filter(|_| programs.len() == 2).unwrap_or(&all[0]);
        let reference =
            all.iter().zip(&programs).find(|(_, program)| !program.single).map_or(first, |(found, _)| found);
        for (found, program) in all.iter().zip(&programs) {
            for i in 0..5 {
                let off = (found.values[i] - reference.values[i]).abs() / reference.deviations[i];
                let slot = &mut apart[usize::from(program.single)];
                *slot = slot.max(off);
                let of_deviation = (found.deviations[i] / reference.deviations[i] - 1.0).abs();
                assert!(of_deviation < if program.single { 0.1 } else { 1e-6 }, "{}: {of_deviation:e}", program.name);
            }
        }
        for i in 0..5 {
            let error = (reference.values[i] - TRUTH[i]) / reference.deviations[i];
            squares[i] += error * error;
            within += usize::from(error.abs() < 1.96);
            runs += 1;
            assert!(error.abs() < 4.0, "seed {seed}, parameter {i}: {error}");
        }
        let m2 = (reference.values[1] - TRUTH[1]) / reference.deviations[1];
        assert!(m2.abs() < 3.0, "seed {seed}: m2 is {m2} deviations off");
        let [chi_squared, noise] = reference.others;
        assert!((0.3..3.0).contains(&chi_squared) && (5e-5..2e-4).contains(&noise), "{reference:?}");
    }
    let _ = write!(report, "{within} of {runs} within 1.96 deviations; squares {squares:?}; apart {apart:?}");
    println!("{report}");
    assert!(apart[0] < 1e-9 && apart[1] < 0.1, "{report}");
    assert!(within * 100 >= runs * 88, "{report}");
}

/// The runtime refines its estimate by simulating every sample, the controller does not: both are right, the runtime's deviations are
/// smaller, and so is the difference between them.
#[test]
fn the_controller_finds_what_the_runtime_finds_in_the_same_log() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let program = in_rust(folder.path(), (CHAIN, "run", "run")).swap_remove(0);
    let text = std::fs::read_to_string(root().join(CHAIN)).expect("shipped");
    let declared: String =
        text.lines().filter(|line| !line.contains("eliminate")).map(|line| format!("{line}\n")).collect();
    let model = folder.path().join("declared.tpm");
    std::fs::write(&model, declared).expect("writable");
    for seed in [1, 2, 3] {
        let rows = log(folder.path(), seed);
        let whole: Vec<&str> = rows.lines().collect();
        let [samples, settle, periods] = SHAPE.map(|count| count as usize);
        let used = whole[samples * settle..samples * (settle + periods)].join("\n");
        let place = folder.path().join("used.csv");
        std::fs::write(&place, format!("t_s,x1,x2,F\n{used}\n")).expect("writable");
        let [model, place] = [&model, &place].map(|path| path.to_str().expect("readable"));
        let result = printed(&["identify", model, "--log", place, "--hold", "zoh", "--json"]);
        let result: serde_json::Value = serde_json::from_str(&result).expect("JSON");
        let found = program.found(&input(SHAPE, &rows), folder.path());
        for (i, parameter) in result["parameters"].as_array().expect("a list").iter().enumerate() {
            let value = parameter["value"].as_f64().expect("identified");
            let apart = (found.values[i] - value) / found.deviations[i];
            assert!(apart.abs() < 3.0, "seed {seed}, {}: {} beside {value}", parameter["name"], found.values[i]);
            let ratio = found.deviations[i] / parameter["std"].as_f64().expect("a deviation");
            println!("seed {seed} {}: {apart:.3} deviations apart, {ratio:.2} times the deviation", parameter["name"]);
            assert!((0.8..2.5).contains(&ratio), "{ratio}");
        }
    }
}

#[test]
fn a_run_that_cannot_be_used_gives_a_status_and_no_number() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let programs = programs(folder.path(), "run");
    let rows = log(folder.path(), 1);
    let whole: Vec<&str> = rows.lines().collect();
    let lines = |lines: &[&str]| lines.iter().fold(String::new(), |text, line| text + line + "\n");
    let mut broken = whole.clone();
    broken[9000] = "9.0,nan,0.1,1.0";
    let still: Vec<String> = (0..whole.len()).map(|n| format!("{},0,0,0", n as f64 * SAMPLE_TIME)).collect();
    let still: Vec<&str> = still.iter().map(String::as_str).collect();
    let (mut cut, mut missed, mut twice) = (whole.clone(), whole.clone(), whole.clone());
    cut[9000] = "9.0,0.1,0.1,-400.0";
    missed.remove(9000);
    twice.insert(9000, whole[8999]);
    let [samples, settle, periods] = SHAPE;
    let cases = [
        ("a reading that is not a number", input(SHAPE, &lines(&broken))),
        ("an input at its limit", input(SHAPE, &lines(&cut))),
        ("a missed sample", input(SHAPE, &lines(&missed))),
        ("a sample that came twice", input(SHAPE, &lines(&twice))),
        ("an unfinished run", input(SHAPE, &lines(&whole[..20000]))),
        ("no sample", input(SHAPE, "")),
        ("a machine that stands still", input(SHAPE, &lines(&still))),
        ("a prior that is not a number", input(SHAPE, &rows).replacen("3 0.5", "nan 0.5", 1)),
    ];
    for (what, input) in &cases {
        for program in &programs {
            let text = program.printed(input, folder.path());
            let first = text.lines().next().unwrap_or_default();
            assert!(first != "0" && text.lines().count() == 1, "{what}, {}: {text}", program.name);
        }
    }
    // The shape is refused when the run begins: Rust has no estimator then, C a run whose status stays.
    for shape in [[samples, settle, 5], [samples, settle, 2], [20, settle, periods]] {
        for program in programs.iter().filter(|program| program.name.starts_with('C')) {
            let text = program.printed(&input(shape, &rows), folder.path());
            assert!(text.trim() != "0" && text.lines().count() == 1, "{shape:?}, {}: {text}", program.name);
        }
    }
}

/// The parameters of a campaign with their deviations, behind the line that says how it ended and the one that says where it rests.
fn pairs(printed: &str) -> Vec<[f64; 2]> {
    let pair = |line: &str| {
        let mut numbers = line.split_whitespace().map(|word| word.parse().expect("a number"));
        [numbers.next().expect("a value"), numbers.next().expect("a deviation")]
    };
    printed.lines().skip(2).map(pair).collect()
}

#[test]
fn a_machine_identifies_itself_from_the_first_sample_to_rest() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let programs = programs(folder.path(), "campaign");
    let mut apart = [0.0_f64; 2];
    let (mut squares, mut worst) = ([0.0; 5], 0.0_f64);
    for seed in 1..=20 {
        let mut reference: Option<Vec<[f64; 2]>> = None;
        // The last two are Rust, double and then single.
        for program in programs.iter().rev().skip(1).chain(programs.last()) {
            let text = program.campaign(seed, "");
            let ended = if program.name.starts_with('C') { "3 1 0 4" } else { "Ended(Stages) after 4 runs" };
            assert_eq!(text.lines().next(), Some(ended), "{}: {text}", program.name);
            let found = pairs(&text);
            let reference = reference.get_or_insert_with(|| found.clone());
            assert_eq!(found.len(), 5, "{}: {text}", program.name);
            for (found, reference) in found.iter().zip(reference) {
                let slot = &mut apart[usize::from(program.single)];
                *slot = slot.max((found[0] - reference[0]).abs() / reference[1]);
            }
        }
        for (i, [value, deviation]) in reference.expect("a program").into_iter().enumerate() {
            let error = (value - TRUTH[i]) / deviation;
            squares[i] += error * error / 20.0;
            worst = worst.max(error.abs());
            assert!(deviation < 1e-4 * TRUTH[i], "seed {seed}, parameter {i}: {deviation}");
        }
    }
    println!("mean squares of errors over deviations {squares:?}, worst {worst}; apart {apart:?}");
    assert!(worst < 3.0 && squares.iter().all(|square| *square < 2.0), "{squares:?} {worst}");
    assert!(apart[0] < 1e-9 && apart[1] < 0.1, "{apart:?}");
}

#[test]
fn a_campaign_that_cannot_go_on_ends_with_a_reason_at_rest() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let programs = programs(folder.path(), "campaign");
    // A reading that is not a number in the third run; an input too weak for the second stage.
    let cases = [
        ("nan", "3 5 4 3", "Ended(Fault(NotFinite { sample: 20939 })) after 3 runs"),
        ("weak", "3 4 0 3", "Ended(Limit) after 3 runs"),
    ];
    for (wrong, in_c, in_rust) in cases {
        for program in &programs {
            let text = program.campaign(1, wrong);
            let ended = if program.name.starts_with('C') { in_c } else { in_rust };
            assert_eq!(text.lines().next(), Some(ended), "{wrong}, {}: {text}", program.name);
            let rest = text.lines().nth(1).and_then(|line| line.split_whitespace().next());
            let rest: f64 = rest.and_then(|word| word.parse().ok()).expect("where the machine rests");
            assert!(rest < 1e-3, "{wrong}, {}: {text}", program.name);
            // What the runs before had shown is still there.
            assert_eq!(pairs(&text).len(), 5, "{wrong}, {}: {text}", program.name);
        }
    }
    for program in programs.iter().filter(|program| program.name.starts_with('C')) {
        let text = program.campaign(1, "odd");
        assert_eq!(text.lines().next(), Some("3 5 2 0"), "an odd number of periods, {}: {text}", program.name);
    }
}

/// One of the three machines of `benches/cortex_m4f/campaign` in the emulated controller: its script fails unless all stages are played,
/// every parameter is within three deviations, and this computer finds the same from the same program. `.ci/long` runs all of them.
#[test]
fn a_machine_identifies_itself_on_an_emulated_cortex_m4f() {
    for tool in ["arm-none-eabi-gcc", "qemu-system-arm", "python3", "cc"] {
        if Command::new(tool).arg("--version").output().is_err() {
            return skipped(&format!("{tool} was not found, so that no campaign was run on an emulated controller"));
        }
    }
    let script = root().join("benches/cortex_m4f/campaign/run");
    let output = Command::new("python3")
        .arg(script)
        .args(["--compare", "1", "two_carts"])
        .env("TPM", env!("CARGO_BIN_EXE_tpm"))
        .output();
    let output = output.expect("python3 runs");
    let text = String::from_utf8_lossy(&output.stdout);
    println!("{text}");
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("two_carts, -Os: "), "{text}");
    assert_eq!(text.matches("all stages played").count(), 1, "{text}");
}
