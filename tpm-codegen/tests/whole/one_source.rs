//! The controller's own code is written once, in Rust, and printed as C: compiled and run, both give the same bits.

use std::fmt::Write as _;
use std::process::Command;

use tpm_codegen::emit::estimator::{EstimatorSource, Part};
use tpm_codegen::generate::{Language, Options, Scalar, generate};
use tpm_controller::support::{Real, SquareRoot};

use crate::c::{FLAGS, compiler};
use crate::random::Random;
use crate::support::{estimator, parse, root};

/// A model whose regressor is the motion itself, so that its samples are rows.
const MODEL: &str = "model Rows { coordinate x [m]; input u [N]; parameter m [kg], d [N*s/m], k [N/m], k2 [N/m];
    m*ddot(x) + d*dot(x) + (k + k2)*x = u; }";

/// Takes in rows from standard input, and prints all that they show.
const MAIN: &str = r#"
#include <stdio.h>
#include "t.h"

static t_base_estimator rows;
static t_base_workspace workspace;
static t_base_estimate found;

int main(void)
{
    t_motion motion;
    t_forces forces;
    double given[4];
    int i, j;

    t_base_estimator_clear(&rows);
    while (scanf("%lf %lf %lf %lf", &given[0], &given[1], &given[2], &given[3]) == 4) {
        motion.x.value = (REAL)given[0];
        motion.x.dot = (REAL)given[1];
        motion.x.ddot = (REAL)given[2];
        forces.u = (REAL)given[3];
        (void)t_base_accumulate(&rows, &motion, &forces, NULL);
    }
    t_base_estimator_fade(&rows, (REAL)0.9);
    (void)t_base_solve(&rows, &workspace, &found);
    for (i = 0; i < 3; ++i) {
        printf("%d %.17g\n", found.shown[i], found.shown[i] ? (double)workspace.values[i] : 0.0);
        for (j = 0; j < 3; ++j) {
            printf("%.17g\n", (double)workspace.covariance[i][j]);
        }
    }
    printf("%d %.17g %.17g\n", found.rank, (double)found.residual, (double)found.condition);
    return 0;
}
"#;

/// What the same rows show in Rust, in the words of the program in C. Its fields are in the order of the base parameters.
fn shown<T: Real>(samples: &[[f64; 4]]) -> Vec<f64> {
    let mut rows = SquareRoot::<T, 3>::default();
    for &[x, rate, acceleration, force] in samples {
        let row = [acceleration, rate, x].map(T::from_f64);
        rows.push(row, T::from_f64(force)).expect("finite");
    }
    rows.fade(T::from_f64(0.9));
    let found = rows.solution();
    let mut words = Vec::new();
    for (value, covariance) in found.solution.iter().zip(found.covariance) {
        words.push(f64::from(u8::from(value.is_some())));
        words.push(value.map_or(0.0, Real::to_f64));
        words.extend(covariance.map(Real::to_f64));
    }
    words.extend([found.rank as f64, found.residual.to_f64(), found.condition.to_f64()]);
    words
}

#[test]
fn least_squares_in_c_have_the_bits_of_those_in_rust() {
    let Some(compiler) = compiler() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let parsed = parse(MODEL);
    let source = EstimatorSource::of(&parsed).expect("a regressor").with(&[Part::Estimator]).expect("base parameters");
    for (scalar, name) in [(Scalar::Double, "double"), (Scalar::Float, "float")] {
        let options =
            Options { scalar, prefix: Some("t"), forgetting: true, ..Options::new(Language::C, "tpm generate") };
        for file in generate(&source, &options).expect("C has all of it") {
            std::fs::write(folder.path().join(&file.name), file.text).expect("writable");
        }
        std::fs::write(folder.path().join("main.c"), MAIN).expect("writable");
        let real = format!("-DREAL={name}");
        let output = Command::new(compiler)
            .args(FLAGS)
            .args([&real, "-O2", "main.c", "t.c", "-o", name, "-lm"])
            .current_dir(folder.path())
            .output()
            .expect("the compiler runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let mut random = Random(7);
        for round in 0..20 {
            // In some rounds two columns are one, and one has nothing but rounding.
            let list = random.list(400);
            let sample = |four: &[f64]| match round % 3 {
                0 => [four[0], four[1], four[2], four[3]],
                1 => [four[0], four[0] * 3.0, four[2], four[3]],
                _ => [four[0], 0.0, four[0] + 1e-9 * four[2], four[3]],
            };
            let single = |value: f64| if scalar == Scalar::Float { f64::from(value as f32) } else { value };
            let samples: Vec<[f64; 4]> = list.chunks_exact(4).map(|four| sample(four).map(single)).collect();
            let mut text = String::new();
            for [a, b, c, d] in &samples {
                let _ = writeln!(text, "{a:e} {b:e} {c:e} {d:e}");
            }
            std::fs::write(folder.path().join("rows"), &text).expect("writable");
            let input = std::fs::File::open(folder.path().join("rows")).expect("written");
            let output = Command::new(folder.path().join(name)).stdin(input).output().expect("it runs");
            let printed = String::from_utf8(output.stdout).expect("text");
            let printed: Vec<f64> = printed.split_whitespace().map(|word| word.parse().expect("a number")).collect();
            let expected = match scalar {
                Scalar::Float => shown::<f32>(&samples),
                Scalar::Double => shown::<f64>(&samples),
            };
            assert_eq!(printed.len(), expected.len(), "{printed:?}");
            for (place, (own, other)) in printed.iter().zip(&expected).enumerate() {
                assert_eq!(own.to_bits(), other.to_bits(), "{name}, round {round}, number {place}: {own} {other}");
            }
        }
    }
}

/// All that any model asks of the controller's code is of the subset, and no compiler says a word about it, alone and as C++.
#[test]
fn all_of_the_controllers_code_is_of_the_subset() {
    let folder = tempfile::tempdir().expect("a folder");
    let compiler = compiler();
    let mut tried = 0;
    // An elimination, constants, signs, sums of parameters, a matrix of masses: what a model may make of the code is there.
    let names = ["two_carts", "rotary_pendulum_dry", "stribeck_pendulum", "cart_pendulum"];
    for path in names.map(|name| root().join("models").join(name).with_extension("tpm")) {
        for parts in [&[Part::Run][..], &[Part::Linearised, Part::Numerical], &[Part::Campaign, Part::Monitor]] {
            // Not every model has a run or a campaign, or base parameters.
            let Ok(source) = estimator(&path).with(parts) else { continue };
            for scalar in [Scalar::Double, Scalar::Float] {
                let options = Options { scalar, prefix: Some("t"), ..Options::new(Language::C, "tpm generate") };
                for file in generate(&source, &options).expect("C has all of it") {
                    std::fs::write(folder.path().join(&file.name), file.text).expect("writable");
                }
                tried += 1;
                let Some(compiler) = compiler else { continue };
                let as_cpp = ["-x", "c++", "-Wall", "-Wextra", "-Werror"];
                let as_cpp = if scalar == Scalar::Double { &as_cpp[..] } else { &FLAGS };
                for flags in [&FLAGS[..], as_cpp] {
                    let output = Command::new(compiler)
                        .args(flags)
                        .args(["-fsyntax-only", "t.c"])
                        .current_dir(folder.path())
                        .output()
                        .expect("the compiler runs");
                    let said = String::from_utf8_lossy(&output.stderr);
                    assert!(output.status.success(), "{} {parts:?} {flags:?}\n{said}", path.display());
                }
            }
        }
    }
    assert!(tried >= 12, "{tried}");
}
