//! Generated low passes with the generated split feed-forward, in Rust and C, beside the runtime's filter.

use crate::generated::filtered::cart_pendulum::filtered::{Common, Split};
use crate::generated::filtered::cart_pendulum::support::Real;
use crate::generated::filtered::cart_pendulum::{
    Inputs, Motion, Parameters, Pattern, feed_forward_dependent, feed_forward_independent,
};
use crate::support::root;
use std::process::Command;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{Filters, Language, LowPass, Options, Scalar, generate};
use tpm_codegen::{Source, parse_model};
use tpm_runtime::filter::SecondOrder;
use tpm_symbolic::number::rational::{integer, ratio};

const SAMPLE_TIME: f64 = 1e-3;
const SAMPLES: usize = 400;
const COMMAND: &str =
    "tpm generate cart_pendulum.tpm --lang rust --filter 100:1 --independent-filter 2000:0.8 --sample-time 1e-3";

fn filters() -> Filters {
    Filters {
        sample_time: ratio(1, 1000),
        dependent: LowPass { natural_frequency: integer(100), quality: integer(1) },
        independent: Some(LowPass { natural_frequency: integer(2000), quality: ratio(4, 5) }),
    }
}

fn estimator() -> EstimatorSource {
    let source = Source::from_bytes(
        "cart_pendulum.tpm",
        std::fs::read(root().join("models/cart_pendulum.tpm")).expect("shipped"),
    );
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message))
}

/// Common and split feed-forward of Feng, section 6.3, with the runtime's filters around the generated parts.
fn expected<T: Real + tpm_runtime::Real>() -> Vec<[T; 4]> {
    let of = |value: f64| <T as Real>::from_f64(value);
    let filter = |w: f64, quality: f64| SecondOrder::new(of(w), of(quality), of(SAMPLE_TIME)).expect("slow enough");
    let mut common = [filter(100.0, 1.0); 2];
    let mut slow = [filter(100.0, 1.0); 2];
    let mut fast = [filter(2000.0, 0.8); 2];
    let mut seen = Vec::new();
    for n in 0..SAMPLES {
        let (motion, parameters) = played::<T>(n);
        let independent = feed_forward_independent(&motion, &parameters).into_array();
        let dependent = feed_forward_dependent(&motion, &parameters).into_array();
        if n == 0 {
            for i in 0..2 {
                common[i].settle(independent[i] + dependent[i]);
                slow[i].settle(dependent[i]);
                fast[i].settle(independent[i]);
            }
        }
        let [a, b] = std::array::from_fn(|i| common[i].push(independent[i] + dependent[i]));
        let [c, d] = std::array::from_fn(|i| slow[i].push(dependent[i]) + fast[i].push(independent[i]));
        seen.push([a, b, c, d]);
    }
    seen
}

fn played<T: Real>(n: usize) -> (Motion<T>, Parameters<T>) {
    let of = |value: f64| T::from_f64(value);
    let pattern = Pattern { lambda1: of(0.1), lambda2: of(0.6), w: of(3.0) };
    let parameters = Parameters { M_plus_m: of(11.0), m_L: of(0.4), m_L_2: of(0.16) };
    (pattern.reference(of(n as f64 * SAMPLE_TIME)), parameters)
}

fn run<T: Real>() -> Vec<[T; 4]> {
    let (motion, parameters) = played::<T>(0);
    let (mut common, mut split) = (Common::settled(&motion, &parameters), Split::settled(&motion, &parameters));
    let step = |n: usize| {
        let (motion, parameters) = played::<T>(n);
        let Inputs { F: a, tau: b } = common.next(&motion, &parameters);
        let Inputs { F: c, tau: d } = split.next(&motion, &parameters);
        [a, b, c, d]
    };
    (0..SAMPLES).map(step).collect()
}

/// The largest difference, as a share of the largest value of its column.
fn difference(found: &[[f64; 4]], expected: &[[f64; 4]]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let size: [f64; 4] = std::array::from_fn(|i| expected.iter().fold(0.0, |size: f64, row| size.max(row[i].abs())));
    let rows = found.iter().zip(expected);
    rows.flat_map(|(a, b)| (0..4).map(|i| (a[i] - b[i]).abs() / size[i]).collect::<Vec<f64>>()).fold(0.0, f64::max)
}

fn double<T: Real>(rows: &[[T; 4]]) -> Vec<[f64; 4]> {
    rows.iter().map(|row| row.map(|value| value.to_f64())).collect()
}

/// Both precisions: the coefficients of the generated code are rounded once, those of the runtime are computed in floats.
#[test]
fn generated_filters_are_the_runtimes() {
    let doubles = difference(&run::<f64>(), &expected::<f64>());
    assert!(doubles < 1e-12, "{doubles:e}");
    let singles = difference(&double(&run::<f32>()), &double(&expected::<f32>()));
    assert!(singles < 2e-4, "{singles:e}");
    let both = difference(&double(&run::<f32>()), &expected::<f64>());
    assert!(both < 2e-4, "{both:e}");
    // The filters do something: without the common one the reaction would not lag.
    let rows = expected::<f64>();
    let apart = rows.iter().map(|row| (row[0] - row[2]).abs()).fold(0.0, f64::max);
    assert!(apart > 1.0, "{apart} N");
}

#[test]
fn generated_c_filters_are_the_runtimes() {
    let Some(compiler) =
        ["cc", "gcc", "clang"].into_iter().find(|name| Command::new(name).arg("--version").output().is_ok())
    else {
        crate::support::skipped("no C compiler (cc, gcc, clang) was found");
        return;
    };
    let (estimator, filters, reference) = (estimator(), filters(), expected::<f64>());
    for (scalar, bound) in [(Scalar::Double, 1e-12), (Scalar::Float, 2e-4)] {
        let options =
            Options { filters: Some(&filters), scalar, prefix: Some("t"), ..Options::new(Language::C, COMMAND) };
        let folder = tempfile::tempdir().expect("a temporary folder");
        for file in generate(&estimator, &options).expect("a model with parts") {
            std::fs::write(folder.path().join(&file.name), &file.text).expect("writable");
        }
        std::fs::write(folder.path().join("main.c"), DRIVER).expect("writable");
        let flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O2", "-o", "run"];
        let built = Command::new(compiler)
            .current_dir(folder.path())
            .args(flags)
            .arg(format!("-DSCALAR={}", scalar.name()))
            .args(["main.c", "t.c", "-lm"])
            .output()
            .expect("the compiler runs");
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        let output = Command::new(folder.path().join("run")).output().expect("the program runs");
        let text = String::from_utf8_lossy(&output.stdout);
        let mut found = Vec::new();
        for line in text.lines() {
            let values: Vec<f64> = line.split(' ').map(|value| value.parse().expect("a number")).collect();
            found.push(<[f64; 4]>::try_from(values).expect("four values"));
        }
        let error = difference(&found, &reference);
        assert!(error < bound, "{scalar:?}: {error:e}");
    }
}

const DRIVER: &str = r#"#include <stdio.h>
#include "t.h"
#define REAL(x) ((SCALAR)(x))
int main(void)
{
    t_pattern pattern;
    t_parameters parameters;
    t_common_filters common;
    t_split_filters split;
    t_motion motion;
    t_inputs first, second;
    int n;
    pattern.lambda1 = REAL(0.1);
    pattern.lambda2 = REAL(0.6);
    pattern.w = REAL(3);
    parameters.M_plus_m = REAL(11);
    parameters.m_L = REAL(0.4);
    parameters.m_L_2 = REAL(0.16);
    t_reference(&pattern, REAL(0), &motion);
    t_common_feed_forward_settle(&common, &motion, &parameters);
    t_split_feed_forward_settle(&split, &motion, &parameters);
    for (n = 0; n < 400; ++n) {
        t_reference(&pattern, REAL(n * 1e-3), &motion);
        t_common_feed_forward(&common, &motion, &parameters, &first);
        t_split_feed_forward(&split, &motion, &parameters, &second);
        printf("%.17g %.17g %.17g %.17g\n", (double)first.F, (double)first.tau, (double)second.F, (double)second.tau);
    }
    return 0;
}
"#;
