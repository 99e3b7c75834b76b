//! A plan of the exact algebra, executed in double precision, forward, backward for gradients, or on intervals.

use crate::interval::Interval;
use core::ops::{Add, Div, Mul, Neg, Sub};
use tpm_controller::{Hyperbolic, Real};
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

    /// Whether the results depend on no leaf.
    pub(super) const fn is_fixed(&self) -> bool {
        self.fixed.is_some()
    }

    /// Adds to `leaves` the derivative, with respect to every leaf, of the results' sum weighted by `weights`. The workspace is
    /// as [`run`](Self::run) left it; `adjoints` is as long. Jumps of signs have no derivative here.
    pub(super) fn pull_back(&self, workspace: &[f64], weights: &[f64], adjoints: &mut [f64], leaves: &mut [f64]) {
        if self.is_fixed() {
            return;
        }
        let adjoints = &mut adjoints[..self.workspace_len];
        adjoints.fill(0.0);
        for (&slot, weight) in self.outputs.iter().zip(weights) {
            adjoints[slot] += weight;
        }
        let first = self.workspace_len - self.steps.len();
        for (i, step) in self.steps.iter().enumerate().rev() {
            let adjoint = adjoints[first + i];
            if adjoint == 0.0 {
                continue;
            }
            match *step {
                Step::Add(a, b) => {
                    adjoints[a] += adjoint;
                    adjoints[b] += adjoint;
                }
                Step::Sub(a, b) => {
                    adjoints[a] += adjoint;
                    adjoints[b] -= adjoint;
                }
                Step::Mul(a, b) => {
                    adjoints[a] += adjoint * workspace[b];
                    adjoints[b] += adjoint * workspace[a];
                }
                Step::Div(a, b) => {
                    adjoints[a] += adjoint / workspace[b];
                    adjoints[b] -= adjoint * workspace[first + i] / workspace[b];
                }
                Step::Neg(a) => adjoints[a] -= adjoint,
                Step::Function(function, a) => {
                    adjoints[a] += adjoint * slope(function, workspace[a], workspace[first + i]);
                }
                Step::Atan2(y, x) => {
                    let (sine, cosine) = (workspace[y], workspace[x]);
                    let square = sine * sine + cosine * cosine;
                    adjoints[y] += adjoint * cosine / square;
                    adjoints[x] -= adjoint * sine / square;
                }
            }
        }
        for (leaf, adjoint) in leaves.iter_mut().zip(&adjoints[self.constants.len()..first]) {
            *leaf += adjoint;
        }
    }

    /// Intervals that contain the results for all leaves within these intervals.
    pub(super) fn enclose(
        &self,
        leaves: impl Iterator<Item = Interval>,
        workspace: &mut Vec<Interval>,
    ) -> Vec<Interval> {
        workspace.clear();
        workspace.extend(self.constants.iter().map(|&value| Interval::around(value)));
        workspace.extend(leaves);
        for step in &self.steps {
            let result = match *step {
                Step::Add(a, b) => workspace[a] + workspace[b],
                Step::Sub(a, b) => workspace[a] - workspace[b],
                Step::Mul(a, b) if a == b => workspace[a].square(),
                Step::Mul(a, b) => workspace[a] * workspace[b],
                Step::Div(a, b) => workspace[a] / workspace[b],
                Step::Neg(a) => -workspace[a],
                Step::Function(function, a) => workspace[a].of(function),
                Step::Atan2(y, x) => Interval::atan2(workspace[y], workspace[x]),
            };
            workspace.push(result);
        }
        self.outputs.iter().map(|&slot| workspace[slot]).collect()
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
        self.execute(at, workspace);
        for (result, &slot) in out.iter_mut().zip(&self.outputs) {
            *result = workspace[slot];
        }
    }

    /// Executes the steps at up to [`LANES`] instants at once, which spreads the cost of reading a step over them. The leaves are the motions,
    /// of so many slots each, and the constants; of fewer instants the last one fills the other lanes.
    pub(super) fn run_lanes(&self, motions: &[f64], slots: usize, constants: &[f64], workspace: &mut Vec<Lanes>) {
        if self.is_fixed() {
            return;
        }
        let last = (motions.len() / slots.max(1)).saturating_sub(1);
        let motion = (0..slots).map(|slot| Lanes(core::array::from_fn(|lane| motions[lane.min(last) * slots + slot])));
        let leaves = motion.chain(constants.iter().map(|&value| Lanes([value; LANES])));
        workspace.clear();
        workspace.extend(self.constants.iter().map(|&value| Lanes([value; LANES])).chain(leaves));
        let first = workspace.len();
        workspace.resize(self.workspace_len, Lanes([0.0; LANES]));
        self.execute(first, workspace);
    }

    /// The results of a lane.
    pub(super) fn results(&self, workspace: &[Lanes], lane: usize, out: &mut [f64]) {
        match &self.fixed {
            Some(fixed) => out.copy_from_slice(fixed),
            None => out.iter_mut().zip(&self.outputs).for_each(|(out, &slot)| *out = workspace[slot].0[lane]),
        }
    }

    /// Executes the steps, whose results stand from `first` on.
    fn execute<V: Value>(&self, first: usize, workspace: &mut [V]) {
        for (i, step) in self.steps.iter().enumerate() {
            workspace[first + i] = match *step {
                Step::Add(a, b) => workspace[a] + workspace[b],
                Step::Sub(a, b) => workspace[a] - workspace[b],
                Step::Mul(a, b) => workspace[a] * workspace[b],
                Step::Div(a, b) => workspace[a] / workspace[b],
                Step::Neg(a) => -workspace[a],
                Step::Function(function, a) => workspace[a].of(function),
                Step::Atan2(y, x) => workspace[y].atan2(workspace[x]),
            };
        }
    }
}

/// How many instants are evaluated at once.
pub(super) const LANES: usize = 8;

/// The values of as many instants.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lanes([f64; LANES]);

/// What steps compute with.
trait Value:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    fn of(self, function: Function) -> Self;
    fn atan2(self, x: Self) -> Self;
}

impl Value for f64 {
    fn of(self, function: Function) -> Self {
        apply(function, self)
    }

    fn atan2(self, x: Self) -> Self {
        Real::atan2(self, x)
    }
}

impl Lanes {
    #[inline(always)]
    fn with(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        Lanes(core::array::from_fn(|lane| of(self.0[lane], other.0[lane])))
    }
}

impl Value for Lanes {
    fn of(self, function: Function) -> Self {
        Lanes(self.0.map(|x| apply(function, x)))
    }

    fn atan2(self, x: Self) -> Self {
        self.with(x, Real::atan2)
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl Div for Lanes {
    type Output = Self;
    #[inline]
    fn div(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
    }
}

impl Neg for Lanes {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Lanes(self.0.map(|x| -x))
    }
}

/// Applies a function of `tpm-controller` instead of the standard library, so that every platform gets the same bits.
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

/// The derivative of a function at x, where it has the value y.
fn slope(function: Function, x: f64, y: f64) -> f64 {
    match function {
        Function::Sin => Real::cos(x),
        Function::Cos => -Real::sin(x),
        Function::Tan => 1.0 + y * y,
        Function::Asin => 1.0 / Real::sqrt(1.0 - x * x),
        Function::Acos => -1.0 / Real::sqrt(1.0 - x * x),
        Function::Atan => 1.0 / (1.0 + x * x),
        Function::Sqrt => 0.5 / y,
        Function::Tanh => 1.0 - y * y,
        Function::Exp => y,
        Function::Log => 1.0 / x,
        Function::Abs => Real::sign(x),
        Function::Sign => 0.0,
    }
}
