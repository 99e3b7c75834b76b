//! Inputs that stand in functions, solved for: `k*u^2`, `abs(u)`.
//!
//! Where all that an equation has of an input is one term `c * h * U(u)`, with c a number and at most one unknown parameter, h of
//! constants, and U a function of the input alone, the equation gives the value of U, and its inverse the input. [`solved`] puts that value in the
//! input's place, so that it stands alone, and says how to come back.

use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{ExprId, Function, Names as _, Node, Symbol};
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::regressor::entries::{RegressorForm, Term};
use thiserror::Error;

/// A step from the value of a function to its argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// 1/u of the value u so far.
    Reciprocal,
    /// This function of the value so far.
    Function(Function),
    /// sign(u) sqrt|u| of the value u so far, the inverse of `u*abs(u)`.
    SignedRoot,
    /// Its square.
    Square,
    /// Itself, where it is not negative, and no number where it is.
    NotNegative,
}

/// How an input follows from what stands in its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Solved {
    /// The input.
    pub input: Symbol,
    /// The column whose parameter multiplies its function.
    pub column: Option<usize>,
    /// Steps to the input, in this order.
    pub steps: Vec<Step>,
    /// The source term in which it stands.
    pub term: TermId,
}

impl Solved {
    /// Whether other values of the input have the same effect: the one that is not negative, or the principal one, is taken.
    #[must_use]
    pub fn is_a_branch(&self) -> bool {
        let several = |step: &Step| {
            matches!(step, Step::NotNegative | Step::Function(Function::Sqrt | Function::Asin | Function::Atan))
        };
        self.steps.iter().any(several)
    }
}

/// Why an input cannot be solved for.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("the input `{input}` cannot be solved for: {why}")]
pub struct Unsolved {
    /// The input.
    pub input: String,
    /// A term in which it stands.
    pub term: TermId,
    /// The reason.
    pub why: String,
}

/// The form with every input alone, and how those that stand in functions follow from what takes their place.
///
/// # Errors
/// [`Unsolved`].
pub fn solved(model: &ExactModel, form: &RegressorForm) -> Result<(RegressorForm, Vec<Solved>), Unsolved> {
    let mut form = form.clone();
    let mut found = Vec::new();
    while let Some((term, input)) = form.driven(model) {
        let term = term.clone();
        let fault = |why: String| Unsolved { input: model.symbol_name(input), term: term.source, why };
        let shown = || model.display_source(term.source);
        let has = |atom: ExprId| {
            let is_input = |leaf: &ExprId| *model.graph.node(*leaf) == Node::Symbol(input);
            model.graph.leaves(atom).iter().any(is_input)
        };
        let stands = |term: &Term| term.atoms.factors().any(|(&atom, _)| has(atom));
        let places: Vec<(usize, usize)> = (form.rows.iter().enumerate())
            .flat_map(|(r, row)| {
                (0..row.terms.len()).filter(|&t| stands(&row.terms[t])).map(move |t| (r, t)).collect::<Vec<_>>()
            })
            .collect();
        let alone = form.rows.iter().any(|row| row.inputs.iter().any(|(own, _)| *own == input));
        let &[(row, place)] = places.as_slice() else {
            return Err(fault(format!("it stands in several terms, of which one is `{}`", shown())));
        };
        if alone {
            return Err(fault(format!("it stands alone and in `{}`", shown())));
        }
        if !form.rows[row].inputs.is_empty() {
            return Err(fault(format!("another input acts in the equation of `{}`", shown())));
        }
        let (of_input, beside) = term.atoms.partition(|&atom| has(atom));
        let other = |atom: ExprId| {
            let leaves = model.graph.leaves(atom);
            leaves.into_iter().find(|&leaf| *model.graph.node(leaf) != Node::Symbol(input) && !is_constant(model, leaf))
        };
        let factors: Vec<(ExprId, i32)> = of_input.factors().map(|(&atom, exponent)| (atom, exponent)).collect();
        if let Some(leaf) = factors.iter().find_map(|(atom, _)| other(*atom)) {
            return Err(fault(format!(
                "in `{}` it stands in a function beside `{}`",
                shown(),
                model.display_brief(leaf)
            )));
        }
        let steps = inverse(model, input, &factors)
            .ok_or_else(|| fault(format!("`{}` has no inverse that is known here", shown())))?;
        let is_driven = |atom: &ExprId| {
            let of = |leaf: &ExprId| matches!(model.graph.node(*leaf), Node::Symbol(own) if model.quantity(*own).kind == Kind::Input);
            model.graph.leaves(*atom).iter().any(of)
        };
        if beside.factors().any(|(atom, _)| is_driven(atom)) {
            return Err(fault(format!("another input stands beside it in `{}`", shown())));
        }
        let moves = |atom: &ExprId| {
            model.graph.leaves(*atom).iter().any(|leaf| matches!(model.graph.node(*leaf), Node::Derivative(..)))
        };
        // The map of the inputs is one of constants.
        if beside.factors().any(|(atom, _)| moves(atom)) {
            return Err(fault(format!("it stands beside the motion in `{}`", shown())));
        }
        let own = &mut form.rows[row];
        own.terms.remove(place);
        own.inputs.push((input, Polynomial::term(beside, -term.coefficient.clone())));
        found.push(Solved { input, column: term.column, steps, term: term.source });
    }
    Ok((form, found))
}

/// Whether a leaf is a number or a constant.
fn is_constant(model: &ExactModel, leaf: ExprId) -> bool {
    match model.graph.node(leaf) {
        Node::Symbol(symbol) => matches!(model.quantity(*symbol).kind, Kind::Constant { .. }),
        Node::Derivative(..) => false,
        _ => true,
    }
}

/// The steps from a product of powers of functions of an input to the input.
fn inverse(model: &ExactModel, input: Symbol, factors: &[(ExprId, i32)]) -> Option<Vec<Step>> {
    let graph = &model.graph;
    let is_input = |atom: ExprId| *graph.node(atom) == Node::Symbol(input);
    let function = |atom: ExprId| match *graph.node(atom) {
        Node::Function(function, argument) if is_input(argument) => Some(function),
        _ => None,
    };
    match *factors {
        [(atom, exponent)] => {
            let mut steps = if exponent < 0 { vec![Step::Reciprocal] } else { Vec::new() };
            match exponent.abs() {
                1 => {}
                2 => steps.push(Step::Function(Function::Sqrt)),
                _ => return None,
            }
            match function(atom) {
                None if is_input(atom) => {}
                Some(Function::Abs) if exponent.abs() == 1 => steps.push(Step::NotNegative),
                // The root of a square is the size of the function, which has its sign lost.
                Some(_) if exponent.abs() != 1 => return None,
                Some(Function::Sqrt) => steps.extend([Step::NotNegative, Step::Square]),
                Some(Function::Exp) => steps.push(Step::Function(Function::Log)),
                Some(Function::Log) => steps.push(Step::Function(Function::Exp)),
                Some(Function::Sin) => steps.push(Step::Function(Function::Asin)),
                Some(Function::Tan) => steps.push(Step::Function(Function::Atan)),
                Some(Function::Asin) => steps.push(Step::Function(Function::Sin)),
                Some(Function::Atan) => steps.push(Step::Function(Function::Tan)),
                _ => return None,
            }
            Some(steps)
        }
        [(a, 1), (b, 1)] => {
            let sized =
                is_input(a) && function(b) == Some(Function::Abs) || is_input(b) && function(a) == Some(Function::Abs);
            sized.then(|| vec![Step::SignedRoot])
        }
        _ => None,
    }
}
