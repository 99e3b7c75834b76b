//! A plan of the exact algebra, executed in double precision.

use tpm_core::{Hyperbolic, Real};
use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::Plan;

/// One operation on the workspace.
#[derive(Clone, Copy, Debug)]
enum Step {
    Add(usize, usize),
    Sub(usize, usize),
    Mul(usize, usize),
    Div(usize, usize),
    Neg(usize),
    Function(Function, usize),
    Atan2(usize, usize),
}

/// A plan with its constants rounded to double precision.
///
/// Invariant: a workspace holds the plan's own constants, then all leaves, then the result of every step. A step reads
/// only entries before its own.
#[derive(Clone, Debug)]
pub(super) struct Program {
    constants: Vec<f64>,
    steps: Vec<Step>,
    outputs: Vec<usize>,
    pub(super) workspace_len: usize,
    /// The results of a plan that depends on no leaf.
    fixed: Option<Vec<f64>>,
}

impl Program {
    /// Compiles a plan; `leaves` are the leaves of the workspace in this order, of which the plan reads some.
    pub(super) fn new(plan: &Plan, leaves: &[Leaf]) -> Self {
        let value = |op: &Op| match op {
            Op::Constant(value) => Some(rational::to_f64(value)),
            Op::Pi => Some(core::f64::consts::PI),
            _ => None,
        };
        let constants: Vec<f64> = plan.ops.iter().filter_map(value).collect();
        let leaf = |index: u32| {
            let place = leaves.iter().position(|present| *present == plan.inputs[index as usize]);
            constants.len() + place.expect("invariant: the plan reads leaves that it is given")
        };
        let first = constants.len() + leaves.len();
        let mut places: Vec<usize> = Vec::with_capacity(plan.ops.len());
        let (mut steps, mut constant) = (Vec::new(), 0);
        for op in &plan.ops {
            let at = |slot: &Slot| places[slot.index()];
            let step = match op {
                Op::Constant(_) | Op::Pi => {
                    places.push(constant);
                    constant += 1;
                    continue;
                }
                Op::Load(index) => {
                    places.push(leaf(*index));
                    continue;
                }
                Op::Add(a, b) => Step::Add(at(a), at(b)),
                Op::Sub(a, b) => Step::Sub(at(a), at(b)),
                Op::Mul(a, b) => Step::Mul(at(a), at(b)),
                Op::Div(a, b) => Step::Div(at(a), at(b)),
                Op::Neg(a) => Step::Neg(at(a)),
                Op::Function(function, a) => Step::Function(*function, at(a)),
                Op::Atan2(a, b) => Step::Atan2(at(a), at(b)),
            };
            places.push(first + steps.len());
            steps.push(step);
        }
        let outputs = plan.outputs.iter().map(|slot| places[slot.index()]).collect();
        let workspace_len = first + steps.len();
        let mut program = Self { constants, steps, outputs, workspace_len, fixed: None };
        if plan.inputs.is_empty() {
            let mut results = vec![0.0; program.outputs.len()];
            program.run(&[&vec![0.0; leaves.len()]], &mut vec![0.0; workspace_len], &mut results);
            program.fixed = Some(results);
        }
        program
    }

    /// Number of results.
    pub(super) fn output_len(&self) -> usize {
        self.outputs.len()
    }

    /// Executes the steps. `leaves` holds the values of all leaves in order, divided into any number of slices.
    pub(super) fn run(&self, leaves: &[&[f64]], workspace: &mut [f64], out: &mut [f64]) {
        if let Some(fixed) = &self.fixed {
            for (result, &value) in out.iter_mut().zip(fixed) {
                *result = value;
            }
            return;
        }
        let mut at = 0;
        for part in core::iter::once(self.constants.as_slice()).chain(leaves.iter().copied()) {
            workspace[at..at + part.len()].copy_from_slice(part);
            at += part.len();
        }
        for (i, step) in self.steps.iter().enumerate() {
            workspace[at + i] = match *step {
                Step::Add(a, b) => workspace[a] + workspace[b],
                Step::Sub(a, b) => workspace[a] - workspace[b],
                Step::Mul(a, b) => workspace[a] * workspace[b],
                Step::Div(a, b) => workspace[a] / workspace[b],
                Step::Neg(a) => -workspace[a],
                Step::Function(function, a) => apply(function, workspace[a]),
                Step::Atan2(y, x) => Real::atan2(workspace[y], workspace[x]),
            };
        }
        for (result, &slot) in out.iter_mut().zip(&self.outputs) {
            *result = workspace[slot];
        }
    }
}

/// Applies a function of `tpm-core` instead of the standard library, so that every platform gets the same bits.
fn apply(function: Function, x: f64) -> f64 {
    match function {
        Function::Sin => Real::sin(x),
        Function::Cos => Real::cos(x),
        Function::Tan => Real::tan(x),
        Function::Asin => Real::asin(x),
        Function::Acos => Real::acos(x),
        Function::Atan => Real::atan(x),
        Function::Sqrt => Real::sqrt(x),
        Function::Tanh => Hyperbolic::tanh(x),
        Function::Exp => Real::exp(x),
        Function::Log => Real::ln(x),
        Function::Abs => Real::abs(x),
        Function::Sign => Real::sign(x),
    }
}
