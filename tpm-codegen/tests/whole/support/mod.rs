//! Models and estimators that the tests of emitted code share.

pub(crate) mod exact;
#[path = "../../../../tests/support/skipped.rs"]
mod skipped;

pub(crate) use skipped::skipped;

use num_traits::Float;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::{Parsed, Source, parse_model};
use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::number::rational::Rational;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::Plan;

/// The workspace's folder.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").to_owned()
}

/// The models of a folder, in the order of their names.
pub(crate) fn models_in(folder: &str) -> BTreeSet<PathBuf> {
    let entries = std::fs::read_dir(root().join(folder)).expect("a folder of the project");
    let paths = entries.map(|entry| entry.expect("readable").path());
    paths.filter(|path| path.extension().is_some_and(|kind| kind == "tpm")).collect()
}

/// The estimator of a model file, from which source code is written.
pub(crate) fn estimator(path: &Path) -> EstimatorSource {
    let name = path.file_name().expect("a file").to_string_lossy().into_owned();
    let source = Source::from_bytes(name.as_str(), std::fs::read(path).expect("a model file"));
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message))
}

/// The outputs of a plan in a precision: `number` rounds its constants, `function` calls one of a single argument.
pub(crate) fn outputs<T: Float>(
    plan: &Plan,
    number: impl Fn(&Rational) -> T,
    function: impl Fn(Function, T) -> T,
    leaf: impl Fn(&Leaf) -> T,
) -> Vec<T> {
    let mut values: Vec<T> = Vec::with_capacity(plan.ops.len());
    for op in &plan.ops {
        let at = |slot: &Slot| values[slot.index()];
        let value = match op {
            Op::Constant(value) => number(value),
            Op::Pi => T::from(std::f64::consts::PI).expect("a float"),
            Op::Load(index) => leaf(&plan.inputs[*index as usize]),
            Op::Add(a, b) => at(a) + at(b),
            Op::Sub(a, b) => at(a) - at(b),
            Op::Mul(a, b) => at(a) * at(b),
            Op::Div(a, b) => at(a) / at(b),
            Op::Neg(a) => -at(a),
            Op::Function(called, a) => function(*called, at(a)),
            Op::Atan2(y, x) => at(y).atan2(at(x)),
        };
        values.push(value);
    }
    plan.outputs.iter().map(|slot| values[slot.index()]).collect()
}

/// Parses the text of a faultless model.
pub(crate) fn parse(text: &str) -> Parsed {
    let source = Source::new("test", text);
    parse_model(&source).unwrap_or_else(|errors| panic!("{}", errors.render(&source)))
}

/// The text of a shipped model.
pub(crate) fn text_of(name: &str) -> String {
    std::fs::read_to_string(root().join("models").join(name).with_extension("tpm")).expect("a shipped model")
}
