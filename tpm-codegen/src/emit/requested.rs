//! Steps, arguments and documentation of the functions that are emitted on request.

use num_traits::{One, Signed, Zero};
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::operation::Op;

use super::estimator::{EstimatorSource, Identified};
use super::function::{Body, Function, Reads, entries};
use super::jumps::Jumps;
use super::names::derivative_text;
use super::part::ForwardDynamics;
use super::text;
use crate::identified::Weights;

/// The documentation of the estimator that takes in samples.
pub(super) const ESTIMATOR: &str = "Least squares for the base parameters, sample by sample: every equation of a sample is rotated into a triangular factor\n\
     (Givens), so that no normal equations square the condition number and single precision keeps its digits. The memory does\n\
     not grow with the samples. What moves little shows little: before the solution names a value, its rank and deviations say\n\
     what the samples have shown.";

/// Documentation of the function that reduces the weight of the estimator's earlier samples.
pub(super) const FADE: &str = "Lets all samples so far count `share` times, from 0 to 1. Called at regular times, it makes the past fade away, so that the\n\
     base parameters follow a machine that changes.";

/// The documentation of the monitor.
pub(super) const MONITOR: &str = "Whether the machine is still the one whose base parameters are known, from any motion. Blocks of samples are compared with what\n\
     these parameters explain: sums of log-likelihood ratios, one for every base parameter and direction and one for the power that no\n\
     parameters explain, begin again at zero, and their threshold follows from the false alarms per hour that are allowed. Parameters\n\
     that may drift are left out of the tests of all others. A run-in measures the noise, whatever its colour; a block without motion says\n\
     nothing, and nothing is wound up.";

/// Documentation of the square root of the covariance of the identified base parameters.
pub(super) const SPREAD: &str =
    "A lower triangular S with S S^T the covariance of the identified base parameters, for a monitor's rules.";

/// A square root of the covariance of the identified base parameters, for a monitor; nothing where the result does not tell it.
pub(super) fn spread(estimator: &EstimatorSource, identified: Option<&Identified>) -> Option<Vec<Vec<f64>>> {
    let base = estimator.parts.base.as_ref().filter(|_| estimator.parts.monitor)?;
    let name = |column: usize| estimator.form.columns[column].name.to_string();
    let sums: Vec<Weights> = (base.parameters.iter())
        .map(|base| {
            let others = base.others.iter().map(|(column, factor)| (name(*column), rational::to_f64(factor)));
            others.chain([(name(base.column), 1.0)]).collect()
        })
        .collect();
    identified?.spread(&sums)
}

/// The forces at rest.
pub(super) fn gravity(estimator: &EstimatorSource) -> Option<Function> {
    let plan = estimator.parts.gravity.as_ref()?;
    let about = format!(
        "Phi theta + known at rest, where all time derivatives are zero: the generalised force of every equation that holds the machine\n\
         against gravity, springs and offsets. Only positions are read.{}",
        text::told(estimator, "gravity", plan)
    );
    Some(Function::values(estimator, plan, about))
}

/// The name of the highest derivative of a coordinate of the equations.
pub(super) fn acceleration(estimator: &EstimatorSource, index: usize) -> String {
    let (coordinate, order) = estimator.plan.evaluation.coordinates[index];
    derivative_text(&estimator.model.coordinates[coordinate.0 as usize].name, order)
}

/// The mass matrix M, rows times coordinates.
pub(super) fn mass_matrix(estimator: &EstimatorSource) -> Option<Function> {
    let plan = estimator.parts.mass_matrix.as_ref()?;
    let by = match estimator.mechanism {
        Some(_) => {
            "\n\nM = sum over the links of S^T I S, by composite rigid bodies: column j holds what a unit acceleration of joint j, \
                    which moves all links outward of it as one body, asks of every joint; rotors are added."
        }
        None => "",
    };
    let about = format!(
        "The mass matrix M, one row per equation and one column per coordinate: what the highest derivatives are multiplied by in\n\
         [`inverse_dynamics`].{by}{}",
        text::told(estimator, "mass_matrix", plan)
    );
    let statements = entries(plan, estimator.plan.evaluation.coordinates.len(), |row, column| {
        format!("{}, {}", estimator.form.rows[row].name, acceleration(estimator, column))
    });
    Some(Function { about, reads: Reads::of(estimator, plan), body: Body::Stores(statements) })
}

/// The mass matrix M and the right-hand side of the accelerations, all rows of M first. The inputs are its additional
/// arguments.
pub(super) fn forward_dynamics(estimator: &EstimatorSource) -> Option<Function> {
    let ForwardDynamics { plan, factored } = estimator.parts.forward_dynamics.as_ref()?;
    let way = match factored {
        true => {
            "M = L D L^T joint after joint,\n\
             without the zeros between branches (Featherstone, Rigid Body Dynamics Algorithms, 8.5); where a pivot is not positive, which\n\
             no machine's inertias make, by elimination with row pivoting."
        }
        false => "M is solved by elimination\nwith row pivoting.",
    };
    let about = format!(
        "Forward dynamics: the highest derivatives that the inputs give, from M a = B u - h with the forces h at zero accelerations.\n\
         The highest derivatives of the motion are not read. {way}{}",
        text::told(estimator, "forward_dynamics", plan)
    );
    Some(Function::values(estimator, plan, about))
}

/// The columns of Phi that lead a base parameter.
pub(super) fn base_regressor(estimator: &EstimatorSource) -> Option<Function> {
    let base = estimator.parts.base.as_ref()?;
    let plan = &base.regressor;
    let about = format!(
        "The regressor in base parameters, one row per equation: its columns are those of [`regressor`] that lead a base parameter, so\n\
         that Phi theta is this matrix times the base parameters.{}",
        text::told(estimator, "base_regressor", plan)
    );
    let statements = entries(plan, base.parameters.len(), |row, column| {
        let column = base.parameters[column].column;
        let name = &estimator.form.columns[column].name;
        format!("{}, {name}: {}", estimator.form.rows[row].name, text::entry(estimator, row, Some(column)))
    });
    Some(Function { about, reads: Reads::of(estimator, plan), body: Body::Stores(statements) })
}

/// Where the equations jump, for a monitor; nothing where none does.
pub(super) fn jumps(estimator: &EstimatorSource) -> Option<Jumps> {
    let base = estimator.parts.base.as_ref().filter(|_| estimator.parts.monitor)?;
    Jumps::of(&base.regressor, base.parameters.len(), &estimator.plan.evaluation.known)
}

/// The arguments of the signs in every equation.
pub(super) fn jumping(estimator: &EstimatorSource, jumps: &Jumps) -> Function {
    let about = format!(
        "What the signs, and functions that saturate, are taken of in every equation, one row per equation; 1 where an equation has fewer.\n         With the noise of a velocity its dry friction jumps.{}",
        text::operations(&jumps.arguments)
    );
    let statements = entries(&jumps.arguments, jumps.count, |row, _| estimator.form.rows[row].name.to_string());
    Function { about, reads: Reads::of(estimator, &jumps.arguments), body: Body::Stores(statements) }
}

/// The base parameters from the parameters of the columns.
pub(super) fn base(estimator: &EstimatorSource) -> Option<Function> {
    let base = estimator.parts.base.as_ref()?;
    let about = format!(
        "The base parameters that belong to these parameters: the combinations on which the forces of all motions depend.{}",
        text::told(estimator, "base", &base.lumping)
    );
    Some(Function::values(estimator, &base.lumping, about))
}

/// Documentation of the function from base parameters to parameters that need equal forces.
pub(super) const REPRESENTATIVE: &str = "Parameters that need the forces of these base parameters at every motion, for functions that take parameters. What is lumped\n\
     into a base parameter is left out of them (it counts as zero there): they say nothing of the machine one by one.";

/// Index of the base parameter that every column leads, where it leads one.
pub(super) fn leading(estimator: &EstimatorSource) -> Vec<Option<usize>> {
    let base = estimator.parts.base.iter().flat_map(|base| &base.parameters);
    let mut places = vec![None; estimator.form.columns.len()];
    base.enumerate().for_each(|(place, base)| places[base.column] = Some(place));
    places
}

/// A base parameter as a combination: `Izz_a + 2*m_b`.
pub(super) fn combination(estimator: &EstimatorSource, index: usize) -> String {
    terms(estimator, index, "")
}

/// The description of a base parameter.
pub(super) fn base_parameter(estimator: &EstimatorSource, index: usize) -> String {
    let base = estimator.parts.base.as_ref().and_then(|base| base.parameters.get(index));
    let unit = base.and_then(|base| estimator.form.columns[base.column].unit.as_ref());
    format!("{}{}.", terms(estimator, index, "`"), text::in_unit(unit))
}

/// Most characters of a factor in a name. Factors of arms with several skew angles have hundreds of digits, more than a string of C may
/// have; code computes with the exact ones, rounded once.
const LONGEST_FACTOR: usize = 40;

/// A factor of a base parameter for reading: exact, or a few digits of a long one.
fn factor_text(factor: &Rational) -> String {
    let exact = rational::display(factor);
    if exact.len() <= LONGEST_FACTOR {
        return exact;
    }
    format!("(about {})", rational::to_f64(&rational::readable(factor)))
}

/// The terms of a base parameter, each between quotes, so that lines are broken between terms.
fn terms(estimator: &EstimatorSource, index: usize, quote: &str) -> String {
    let Some(base) = estimator.parts.base.as_ref().and_then(|base| base.parameters.get(index)) else {
        return String::new();
    };
    let name = |column: usize| &estimator.form.columns[column].name;
    let mut sum = format!("{quote}{}{quote}", name(base.column));
    for (column, factor) in &base.others {
        let size = rational::abs(factor);
        let sign = if factor.is_negative() { '-' } else { '+' };
        let factor = if size.is_one() { String::new() } else { format!("{}*", factor_text(&size)) };
        sum.push_str(&format!(" {sign} {quote}{factor}{}{quote}", name(*column)));
    }
    sum
}

/// Whether any equation has a term without an unknown parameter.
pub(super) fn has_known(estimator: &EstimatorSource) -> bool {
    let plan = &estimator.plan.evaluation.known;
    plan.outputs.iter().any(|slot| !matches!(&plan.ops[slot.index()], Op::Constant(value) if value.is_zero()))
}
