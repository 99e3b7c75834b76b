//! Test of whether an expression is smooth at a point.
//!
//! Every function of the graph is analytic except at a few arguments: a power with negative exponent and a square root
//! at 0, a logarithm at 0, asin and acos at -1 and 1, tan at a zero of the cosine, atan2 at the origin, abs and sign at 0. A derivative,
//! a Taylor series or a linearisation at a point is meaningful only where none of these is met.

use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::expr::trigonometric;
use std::collections::HashMap;

/// The first function or quotient in `expr` (by its id, so innermost first) that is not smooth where `point` replaces
/// leaves by expressions; `None` when none is shown to be singular there. Whether an argument vanishes is decided by
/// the normal form of [`trigonometric`]; an argument that depends on symbols counts as different from zero unless it vanishes
/// for all of their values.
pub fn first_singularity(graph: &mut Graph, expr: ExprId, point: &HashMap<ExprId, ExprId>) -> Option<ExprId> {
    let mut seen = vec![false; expr.index() + 1];
    let mut stack = vec![expr];
    let mut found = Vec::new();
    while let Some(id) = stack.pop() {
        if !std::mem::replace(&mut seen[id.index()], true) {
            stack.extend(graph.operands(id));
            if matches!(graph.node(id), Node::Power(_, i32::MIN..0) | Node::Function(..) | Node::Atan2(..)) {
                found.push(id);
            }
        }
    }
    found.sort_unstable();
    found.into_iter().find(|&id| is_singular(graph, id, point))
}

fn is_singular(graph: &mut Graph, id: ExprId, point: &HashMap<ExprId, ExprId>) -> bool {
    match *graph.node(id) {
        Node::Power(base, _) => vanishes(graph, base, point),
        Node::Function(function, argument) => match function {
            Function::Sin | Function::Cos | Function::Atan | Function::Tanh | Function::Exp => false,
            Function::Sqrt | Function::Log | Function::Abs | Function::Sign => vanishes(graph, argument, point),
            Function::Tan => {
                let cosine = graph.function(Function::Cos, argument);
                vanishes(graph, cosine, point)
            }
            Function::Asin | Function::Acos => {
                let square = graph.pow(argument, 2);
                let one = graph.integer(1);
                let difference = graph.sub(one, square);
                vanishes(graph, difference, point)
            }
        },
        Node::Atan2(y, x) => vanishes(graph, y, point) && vanishes(graph, x, point),
        _ => false,
    }
}

fn vanishes(graph: &mut Graph, expr: ExprId, point: &HashMap<ExprId, ExprId>) -> bool {
    let value = graph.substitute(expr, point);
    trigonometric::is_zero(graph, value)
}
