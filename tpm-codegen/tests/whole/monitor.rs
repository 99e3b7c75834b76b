//! The generated monitor, compiled and run in C and Rust, beside a twin that multiplies samples into normal equations and projects the one
//! drifting column by a formula: where it agrees, every step of both languages has done its work.

use crate::c::{FLAGS, compiler, runs};
use crate::random_code::LIBM;
use crate::support::{estimator, root, skipped};
use std::fmt::Write as _;
use std::process::Command;
use tpm_codegen::emit::estimator::{EstimatorSource, Part};
use tpm_codegen::generate::{Language, Options, Scalar, generate};

const BLOCK: usize = 50;
const RUN_IN: usize = 20;
const BLOCKS: usize = 60;
/// The block in which something changes.
const CHANGED: usize = 40;
const VALUES: [f64; 3] = [2.0, 30.0, 8.0];
const SPREAD: f64 = 0.003;
const DRIFT: f64 = 2.5;
/// Seven tests of one block in a second, one false alarm in a thousand hours.
const RATE: f64 = 1e-3;

/// Position, velocity, acceleration and force of one instant, and whether it is whole.
type Sample = ([f64; 4], bool);

/// Pseudo-random numbers of mean zero and variance one.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 / 2_f64.powi(53) - 0.5) * 12_f64.sqrt()
    }
}

/// What the plant does: parameters after the change, and a force that no parameter explains.
fn samples(after: [f64; 3], odd: f64) -> Vec<Sample> {
    let mut noise = Noise(7);
    let mut list = Vec::new();
    for i in 0..BLOCK * BLOCKS {
        let t = 0.02 * i as f64;
        let block = i / BLOCK;
        // It stands still for a while, and its drag drifts all the time.
        let size = if (30..34).contains(&block) { 0.0 } else { 0.2 };
        let mut q = [0.0; 3];
        for v in [1.3, 2.9, 4.7] {
            q[0] += size * (v * t).sin();
            q[1] += size * v * (v * t).cos();
            q[2] -= size * v * v * (v * t).sin();
        }
        let [m, k1, k2] = if block < CHANGED { VALUES } else { after };
        let drag = k2 + 0.3 * VALUES[2] * (0.05 * t).sin();
        let unknown = if block < CHANGED { 0.0 } else { odd * (17.0 * t).sin() };
        let force = m * q[2] + k1 * q[0] + drag * q[1] * q[1] + unknown + 0.2 * noise.next();
        let mut given = [q[0], q[1], q[2], force];
        let mut whole = true;
        if i % 97 == 5 {
            (given[3], whole) = (1e6, false);
        }
        if i % 131 == 7 {
            given[1] = f64::NAN;
        }
        list.push((given, whole));
    }
    list
}

/// Position, velocity and acceleration while it stands still.
fn rest() -> Vec<[f64; 3]> {
    let part = |i: usize, factor: usize, modulus: usize| (i * factor % modulus) as f64 - (modulus / 2) as f64;
    (0..64).map(|i| [0.1 + 1e-4 * part(i, 37, 11), 1e-3 * part(i, 17, 7), 2e-2 * part(i, 29, 13)]).collect()
}

/// What a monitor says after its last sample: its state, the parameter, the change and its deviation.
#[derive(Debug, PartialEq)]
struct Said {
    at: usize,
    state: usize,
    numbers: [f64; 3],
}

/// The upper limit of 99 % of a variance, by Wilson and Hilferty.
fn upper(freedom: f64) -> f64 {
    let part = 2.0 / (9.0 * freedom);
    (1.0 - part - 2.326_348 * part.sqrt()).powi(3).recip()
}

/// The twin: normal equations of every block.
fn twin(samples: &[Sample]) -> Said {
    let threshold = (7.0 * 3600.0 / (0.02 * BLOCK as f64) / RATE).ln();
    let changes = VALUES.map(|value| 0.1 * value);
    let drifts = [0.0, 0.0, DRIFT];
    let mut learned: [Vec<(f64, f64)>; 3] = Default::default();
    let mut powers: Vec<f64> = Vec::new();
    let mut sums = [[[0.0; 3]; 2]; 3];
    let mut power_sum = 0.0;
    let still: Vec<[f64; 3]> = rest().into_iter().map(|[x, v, a]| [a, x, v * v]).collect();
    let mean = |i: usize| still.iter().map(|row| row[i]).sum::<f64>() / still.len() as f64;
    let product = |i: usize, j: usize| {
        still.iter().map(|row| (row[i] - mean(i)) * (row[j] - mean(j))).sum::<f64>() / still.len() as f64
    };
    for (number, block) in samples.chunks(BLOCK).enumerate() {
        let rows: Vec<[f64; 4]> = (block.iter())
            .filter(|(sample, whole)| *whole && sample.iter().all(|value| value.is_finite()))
            .map(|([x, v, a, f], _)| [*a, *x, v * v, f - (VALUES[0] * a + VALUES[1] * x + VALUES[2] * v * v)])
            .collect();
        let gram = |i: usize, j: usize| rows.iter().map(|row| row[i] * row[j]).sum::<f64>();
        let moving = gram(0, 0) > 0.0;
        let mut best: Option<(f64, Said)> = None;
        for j in (0..3).filter(|_| moving) {
            // The part of `a` that is orthogonal to the column that drifts, times `b`.
            let beside = |a: usize, b: usize| {
                if j == 2 { gram(a, b) } else { gram(a, b) - gram(a, 2) * gram(b, 2) / gram(2, 2) }
            };
            let (score, information) = (beside(j, 3), beside(j, j));
            let weight = |i: usize| match i == j {
                true => 1.0,
                false if i == 2 => gram(j, 2) / gram(2, 2),
                false => 0.0,
            };
            let lost = |i: usize| (0..3).map(|k| (product(i, k) * VALUES[k]).abs()).sum::<f64>() * rows.len() as f64;
            let noise = (0..3).map(|i| weight(i).abs() * lost(i)).sum::<f64>() / information;
            if noise >= 0.5 * changes[j] {
                continue;
            }
            if learned[j].len() < RUN_IN {
                learned[j].push((score, information));
                continue;
            }
            let squares: f64 = learned[j].iter().map(|(s, i)| s * s / i).sum();
            let (all, whole): (f64, f64) = learned[j].iter().fold((0.0, 0.0), |(a, b), (s, i)| (a + s, b + i));
            let freedom = RUN_IN as f64 - 1.0;
            let variance = (squares - all * all / whole) / freedom * upper(freedom);
            let spread: f64 =
                (0..3).map(|i| (beside(j, i) / information * SPREAD * VALUES[i]).powi(2)).sum::<f64>().sqrt();
            let blind = (2.0 * (6.0_f64 / 1e-3).ln()).sqrt() * spread + noise;
            if blind >= changes[j] {
                continue;
            }
            let middle = drifts[j] + 0.5 * (blind + changes[j]);
            for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
                let sum = &mut sums[j][side];
                let step = (changes[j] - blind) / variance * (sign * score - information * middle);
                sum[0] += step.min(0.3 * threshold);
                if sum[0] <= 0.0 {
                    *sum = [0.0; 3];
                    continue;
                }
                sum[1] += score / variance;
                sum[2] += information / variance;
                let found = sum[1] * sum[1] / sum[2];
                if sum[0] > threshold && best.as_ref().is_none_or(|(most, _)| found > *most) {
                    let numbers = [j as f64, sum[1] / sum[2], sum[2].sqrt().recip()];
                    best = Some((found, Said { at: number, state: 3, numbers }));
                }
            }
        }
        // What no parameters explain: the determinant of the Gram matrix with the forces over that without.
        let minor = |size: usize| determinant(size, &gram);
        let left = if moving { minor(4) / minor(3) } else { gram(3, 3) };
        let free = rows.len() as f64 - 3.0;
        let power = left / free;
        let mut unexplained = None;
        if powers.len() < RUN_IN {
            powers.push(power);
        } else {
            let count = RUN_IN as f64;
            let mean = powers.iter().sum::<f64>() / count;
            let variance = powers.iter().map(|power| (power - mean).powi(2)).sum::<f64>() / count * upper(count - 1.0);
            let shape = (mean * mean / variance).min(free / 2.0);
            let usual = mean * (1.0 + 3.0 / (shape * count).sqrt());
            let step = shape * (power / usual / 2.0 - 2_f64.ln());
            power_sum = f64::max(power_sum + step.min(0.3 * threshold), 0.0);
            if power_sum > threshold {
                unexplained = Some(Said { at: number, state: 4, numbers: [power / usual, 0.0, 0.0] });
            }
        }
        if let Some(said) = best.map(|(_, said)| said).or(unexplained) {
            return said;
        }
    }
    Said { at: BLOCKS, state: 1, numbers: [0.0; 3] }
}

/// The determinant of the first columns and of the last, by Laplace's expansion.
fn determinant(size: usize, gram: &dyn Fn(usize, usize) -> f64) -> f64 {
    fn expand(rows: &[usize], columns: &[usize], gram: &dyn Fn(usize, usize) -> f64) -> f64 {
        let Some((&first, rest)) = rows.split_first() else { return 1.0 };
        let mut sum = 0.0;
        for (place, &column) in columns.iter().enumerate() {
            let others: Vec<usize> = columns.iter().copied().filter(|other| *other != column).collect();
            let sign = if place % 2 == 0 { 1.0 } else { -1.0 };
            sum += sign * gram(first, column) * expand(rest, &others, gram);
        }
        sum
    }
    let all: Vec<usize> = (0..size).collect();
    expand(&all, &all, gram)
}

fn lines(samples: &[Sample]) -> String {
    let mut text = rest().iter().fold(String::new(), |mut text, [x, v, a]| {
        let _ = writeln!(text, "{x:e} {v:e} {a:e} 0 2");
        text
    });
    samples.iter().for_each(|([x, v, a, f], whole)| {
        let _ = writeln!(text, "{x:e} {v:e} {a:e} {f:e} {}", u8::from(*whole));
    });
    text
}

/// Reads what a program prints: the block, the state, then numbers.
fn said(program: &std::path::Path, file: &std::path::Path) -> Said {
    let input = std::fs::File::open(file).expect("written");
    let output = Command::new(program).stdin(input).output().expect("it was compiled");
    let text = String::from_utf8(output.stdout).expect("text");
    let values: Vec<f64> = text.split_whitespace().map(|word| word.parse().expect("a number")).collect();
    let [at, state, numbers @ ..] = values.as_slice() else { panic!("{text}") };
    Said { at: *at as usize, state: *state as usize, numbers: numbers.try_into().expect("three numbers") }
}

fn source() -> EstimatorSource {
    estimator(&root().join("models/mass_spring_drag.tpm")).with(&[Part::Monitor]).expect("there are base parameters")
}

const C: &str = include_str!("monitor/main.c");
const RUST: &str = include_str!("monitor/main.rs");

/// Programs of C in both precisions and of Rust, as far as there are compilers.
fn programs(folder: &std::path::Path) -> Vec<(&'static str, std::path::PathBuf)> {
    let source = source();
    let written = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("writable");
    let mut programs = Vec::new();
    let compiled = |command: &mut Command| {
        let output = command.current_dir(folder).output().expect("it runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    if let Some(compiler) = compiler() {
        written("main.c", C);
        for (scalar, name) in [(Scalar::Double, "double"), (Scalar::Float, "float")] {
            let options = Options { scalar, prefix: Some("slider"), ..Options::new(Language::C, "tpm generate") };
            for file in generate(&source, &options).expect("C has all of it") {
                written(&file.name, &file.text);
            }
            let real = format!("-DREAL={name}");
            compiled(Command::new(compiler).args(FLAGS).args([&real, "-O1", "main.c", "slider.c", "-o", name, "-lm"]));
            programs.push((name, folder.join(name)));
        }
    }
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    if runs(&rustc) {
        let files = generate(&source, &Options::new(Language::Rust, "tpm generate")).expect("Rust has all of it");
        written("slider.rs", &files[0].text);
        written("libm.rs", LIBM);
        written("main.rs", RUST);
        compiled(Command::new(&rustc).args(["--edition=2021", "--crate-type=rlib", "libm.rs"]));
        compiled(Command::new(&rustc).args([
            "--edition=2024",
            "-Copt-level=1",
            "--extern",
            "libm=liblibm.rlib",
            "main.rs",
            "-o",
            "rust",
        ]));
        programs.push(("rust", folder.join("rust")));
    } else {
        skipped("no rustc was found, so that the generated monitor in Rust was not run");
    }
    programs
}

#[test]
fn what_a_monitor_says_is_what_normal_equations_say() {
    let folder = tempfile::tempdir().expect("a folder");
    let programs = programs(folder.path());
    // Nothing but drift; a heavier mass; a softer spring; more drag than may drift; a force that no parameter explains.
    let cases: [([f64; 3], f64, usize, f64); 5] = [
        (VALUES, 0.0, 1, 0.0),
        ([2.2, 30.0, 8.0], 0.0, 3, 0.0),
        ([2.0, 27.0, 8.0], 0.0, 3, 1.0),
        ([2.0, 30.0, 16.0], 0.0, 3, 2.0),
        (VALUES, 1.0, 4, 0.0),
    ];
    for (after, odd, state, parameter) in cases {
        let samples = samples(after, odd);
        let wanted = twin(&samples);
        assert_eq!(wanted.state, state, "{after:?} {odd}: {wanted:?}");
        if state == 3 {
            assert_eq!(wanted.numbers[0], parameter, "{after:?}: {wanted:?}");
            let moved = after[parameter as usize] - VALUES[parameter as usize];
            assert!((wanted.numbers[1] - moved).abs() < 0.35 * moved.abs(), "{after:?}: {wanted:?}");
        }
        assert!(wanted.at >= CHANGED, "{wanted:?}");
        let file = folder.path().join("samples.txt");
        std::fs::write(&file, lines(&samples)).expect("writable");
        for (name, program) in &programs {
            let found = said(program, &file);
            let close = if *name == "float" { 1e-3 } else { 1e-8 };
            assert_eq!((found.at, found.state), (wanted.at, wanted.state), "{name}: {found:?} {wanted:?}");
            for (found, wanted) in found.numbers.iter().zip(wanted.numbers) {
                assert!((found - wanted).abs() <= close * wanted.abs(), "{name}, {after:?}: {found} {wanted}");
            }
        }
    }
}

/// An arm with dry friction, whose joints rest one by one and all together, over some hours: the long measurement of `benches/monitor`, cut
/// short.
#[test]
fn an_arm_with_dry_friction_is_watched() {
    let Some(compiler) = compiler() else {
        return skipped("no C compiler was found, so that the monitor of an arm was not run");
    };
    let folder = tempfile::tempdir().expect("a folder");
    let source = estimator(&root().join("tests/fixtures/arms/three_joints.tpm")).with(&[Part::Monitor]);
    let options =
        Options { scalar: Scalar::Float, prefix: Some("estimator"), ..Options::new(Language::C, "tpm generate") };
    for file in generate(&source.expect("there are base parameters"), &options).expect("C has all of it") {
        std::fs::write(folder.path().join(&file.name), &file.text).expect("writable");
    }
    let bench = root().join("benches/monitor");
    let machine = format!("-DMACHINE=\"{}\"", bench.join("three_joints.h").display());
    let command = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-DREAL=float", machine.as_str(), "-I."];
    let output = Command::new(compiler)
        .current_dir(folder.path())
        .args(command)
        .arg(bench.join("simulate.c"))
        .args(["estimator.c", "-o", "simulate", "-lm"])
        .output()
        .expect("it runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = Command::new(folder.path().join("simulate")).args(["10", "10"]).output().expect("it was compiled");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("\n0 false alarms in 10 h"), "{said}");
    // Over a hundred times 97 % are found; of ten, one may be missed.
    let found = ["9 of 10", "10 of 10"].iter().any(|found| said.contains(&format!("found within 60 s in {found},")));
    assert!(found && said.contains(" 0 early"), "{said}");
}
