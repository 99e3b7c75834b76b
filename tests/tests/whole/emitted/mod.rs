//! Emitted code, compiled by the macro and run, against exact rational evaluation and against the interpreter.
//!
//! The exact side never sees a plan: it multiplies the terms of the regressor form, and the entries of the table, as rationals.
//! Inputs are dyadic, so that they are exact in both precisions; every bound is a number of roundings times the sum of the
//! magnitudes of the terms, since cancellation is the model's, not the code's.

mod dynamics;
mod feed_forward;
mod lumping;
mod parts;
mod pattern;
mod precision;
mod same_code;
mod solution;
mod truncation;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::{Source, parse_model};
use tpm_runtime::Real;
use tpm_symbolic::number::rational::{self, Rational};

/// Roundings that any entry of the shipped models may gather.
const ROUNDINGS: f64 = 64.0;

fn estimator(file: &str) -> EstimatorSource {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = folder.join(if file.contains('/') { "." } else { "../models" }).join(file);
    let source = Source::from_bytes(file, std::fs::read(&path).expect("a model file"));
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message))
}

/// A runner that draws equal cases in every run.
fn runner(cases: u32) -> TestRunner {
    let rng = proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha);
    TestRunner::new_with_rng(ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }, rng)
}

/// Numbers k/64 with |k| <= 192, so that powers stay well inside both precisions.
fn dyadic(count: usize) -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec((-192i32..=192).prop_map(|k| f64::from(k) / 64.0), count)
}

fn exact(value: f64) -> Rational {
    rational::from_f64(value).expect("finite")
}

/// An exact sum and the sum of the magnitudes of its terms; `None` where a function has no rational value.
struct Sum {
    value: Rational,
    magnitude: Rational,
}

impl Sum {
    fn of(terms: impl IntoIterator<Item = Option<Rational>>) -> Option<Self> {
        let mut sum = Self { value: rational::integer(0), magnitude: rational::integer(0) };
        for term in terms {
            let term = term?;
            sum.magnitude += rational::abs(&term);
            sum.value += term;
        }
        Some(sum)
    }

    fn holds<T: Real>(&self, found: T) -> bool {
        let epsilon = T::EPSILON.to_f64();
        let error = rational::to_f64(&rational::abs(&(exact(found.to_f64()) - &self.value)));
        error <= ROUNDINGS * epsilon * rational::to_f64(&self.magnitude)
    }
}

/// Models that reach corners of the emitter which no shipped model reaches.
mod corners {
    tpm_runtime::model_file!("fixtures/emit/dense.tpm");
    tpm_runtime::model_file!("fixtures/emit/names.tpm", crate = ::tpm_runtime);
}
