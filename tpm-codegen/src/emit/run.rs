//! The estimator of the samples of one run: its rows, its sizes, and what its code says of itself, for every language.
//!
//! The rows are the equations as they were declared, before any coordinate is eliminated: they are linear in the declared parameters,
//! which then come out by themselves, with their deviations.

use num_traits::Zero;
use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::Op;
use tpm_symbolic::plan::straight_line::Plan;

use super::code::{Expression, Place, Statement};
use super::estimator::EstimatorSource;
use super::function::{self, Body, Function as Steps, Reads};
use super::part::RUN_HARMONICS;

/// The documentation of the estimator.
pub(super) const ESTIMATOR: &str = "The parameters from the samples of one run (estimator `measured-motion`), in memory of fixed size. A run is an even number of\n\
     whole periods, at least four, of a motion that has settled. The equations, as they were declared, are evaluated along the\n\
     measured motion; their harmonics are equated with those of the inputs as they were applied, and weighed by the noise that\n\
     is found halfway between the harmonics.";

/// The documentation of a run's reference.
pub(super) const REFERENCE: &str =
    "The reference of a run, which estimators are linearised about: the harmonics of one period of its samples.";

/// The documentation of the estimate about a reference.
pub(super) const ABOUT: &str = "What the run says of the parameters, its equations linearised about the reference (estimators `error` and `hill`): they are\n\
     evaluated along the reference, and the response of their derivatives to the tracking error is added. `prior` has the\n\
     parameters of the feed-forward. Of the derivatives along the reference `error` takes the means, `hill` the whole. What the\n\
     linearisation leaves out along the measured motion counts as an error that all harmonics of an equation have alike.";

/// The documentation of the estimator by differences of runs.
pub(super) const NUMERICAL: &str = "The parameters from runs with one parameter of the feed-forward changed (estimator `numerical`): the harmonics of the tracking\n\
     error are M times what is wrong with the parameters, and differences of runs give M column by column. Neither the equations\n\
     nor the loop are needed; all runs must be alike but for that parameter.";

/// The documentation of the physical parameters' estimate.
pub(super) const PHYSICAL: &str = "The physical parameters that the equations of the run show, by Gauss-Newton from those of `prior`, which must be near enough: in\n\
     products and sums of them, several may agree with the run.";

/// The documentation of a sample.
pub(super) const SAMPLE: &str = "One sample: the measured coordinates, and the inputs that are applied from then on.";

/// The documentation of the parameters.
pub(super) const PARAMETERS: &str = "The parameters as they stand in the declared equations.";

/// The rows of a run.
#[derive(Clone, Debug)]
pub(super) struct RunPlan<'a> {
    /// The declared equations, without patterns.
    pub(super) source: &'a EstimatorSource,
    /// Coordinate, by its place among those of the equations, and derivative of every entry of a motion.
    pub(super) motion: Vec<(usize, u32)>,
    /// The highest harmonic.
    pub(super) harmonics: usize,
    /// Points of a period at which the rows are evaluated.
    pub(super) points: usize,
}

impl<'a> RunPlan<'a> {
    /// The rows of a model whose estimator of a run was requested.
    pub(super) fn of(estimator: &'a EstimatorSource) -> Option<Self> {
        let source = estimator.run.as_deref()?;
        let evaluation = &source.plan.evaluation;
        let plans = [&evaluation.regressor, &evaluation.known, &evaluation.input_map];
        let of_coordinate = |place: usize| {
            let (coordinate, order) = evaluation.coordinates[place];
            let read = move |derivative: &u32| {
                plans.iter().any(|plan| plan.inputs.contains(&Leaf::Motion(coordinate, *derivative)))
            };
            (0..=order).filter(read).map(move |derivative| (place, derivative))
        };
        let motion = (0..evaluation.coordinates.len()).flat_map(of_coordinate).collect();
        let [least, most] = RUN_HARMONICS;
        let tables = estimator.plan.patterns.iter().filter_map(|pattern| pattern.table.as_ref().ok());
        let highest = tables.flat_map(|table| table.rows.iter().map(|(_, harmonic, _)| *harmonic)).max().unwrap_or(0);
        let harmonics = highest.clamp(least, most);
        // A term of degree seven has no alias among the harmonics on this grid; a jump needs more points.
        let points = (harmonics + 1) * if plans.iter().any(|plan| jumps(plan)) { 64 } else { 8 };
        Some(Self { source, motion, harmonics, points })
    }

    /// Whether an estimator was requested that compares the run with its reference.
    pub(super) fn takes_reference(&self, estimator: &EstimatorSource) -> bool {
        estimator.parts.linearised || estimator.parts.numerical
    }

    /// Lines of every channel: the harmonics, and the lines halfway behind each.
    pub(super) fn lines(&self) -> usize {
        2 * (self.harmonics + 1)
    }

    /// Equations of all harmonics: real and imaginary parts of every row, and the means.
    pub(super) fn equations(&self) -> usize {
        self.source.form.rows.len() * (self.lines() - 1)
    }

    /// Covariances of them: a triangle.
    pub(super) fn covariances(&self) -> usize {
        self.equations() * (self.equations() + 1) / 2
    }

    /// The place of a leaf of a motion among the entries.
    pub(super) fn place(&self, leaf: &Leaf) -> Option<usize> {
        let Leaf::Motion(coordinate, derivative) = leaf else { return None };
        let coordinates = &self.source.plan.evaluation.coordinates;
        let is = |&(place, order): &(usize, u32)| coordinates[place].0 == *coordinate && order == *derivative;
        self.motion.iter().position(is)
    }

    /// The steps of the rows: regressor, known terms and input map, with the name of each and what all of them read.
    pub(super) fn rows(&self) -> ([(&'static str, Vec<Statement>); 3], Reads) {
        let (regressor, map) = (function::regressor(self.source), function::input_map(self.source));
        let known = function::known(self.source);
        let reads = Reads {
            motion: regressor.reads.motion || known.reads.motion || map.reads.motion,
            constants: regressor.reads.constants || known.reads.constants || map.reads.constants,
            ..Reads::default()
        };
        ([("regressor", stores(regressor)), ("known", stores(known)), ("map", stores(map))], reads)
    }
}

/// The steps of a function as stores; values of zero are left out.
fn stores(function: Steps) -> Vec<Statement> {
    match function.body {
        Body::Stores(statements) => statements,
        Body::Values(mut statements, values) => {
            let stored = values.into_iter().enumerate().filter(|(_, value)| !is_zero(value));
            statements.extend(stored.map(|(row, value)| Statement::Store(Place::Value(row), value)));
            statements
        }
        Body::Table(_) => Vec::new(),
    }
}

/// Whether an expression is the number zero.
pub(super) fn is_zero(expression: &Expression) -> bool {
    matches!(expression, Expression::Number(value) if value.is_zero())
}

/// Whether a plan has a function that jumps or has a corner.
fn jumps(plan: &Plan) -> bool {
    plan.ops.iter().any(|op| matches!(op, Op::Function(Function::Sign | Function::Abs, _)))
}
