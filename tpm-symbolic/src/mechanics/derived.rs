//! Constants that follow from the constants of a model, such as the values of a Taylor polynomial's coefficients at a
//! point that is known at run time only.
//!
//! A table of harmonics holds powers of symbols. Where an equation has sin(q0) or 1/(l1 + l2), with constants q0, l1 and
//! l2, these become new constants s1, s2, ..., each defined by the constants before it:
//!
//! ```text
//! g sin(q0) q''  ->  g s1 q'' ,      s1 = sin(q0) .
//! ```
//!
//! Invariant: every definition holds constants of the model and derived constants that are listed before it, and
//! nothing else; a derived constant that is identically zero is no symbol but the number 0. The values of derived
//! constants are not independent of each other, so that a rank at values drawn at random is no rank of the model.

use crate::expr::graph::{ExprId, Node, Symbol};
use crate::expr::trigonometric;
use crate::mechanics::model::{ExactModel, Kind};
use ecow::EcoString;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeSet, HashMap};

/// Least number of leaves and operations of a subexpression that gets a name of its own where it occurs several times.
const WORTH_A_NAME: f64 = 5.0;

/// A derived constant.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Derived {
    /// Its name, which no other quantity of the model has.
    pub name: EcoString,
    /// Its definition, in the model language.
    pub definition: String,
}

/// Replaces what the equations hold of constants, and what is no product of their powers, by new constants. The result
/// is empty where there is nothing to replace, and the model then is as it was.
pub fn derive_constants(model: &mut ExactModel) -> Vec<Derived> {
    let mut derive =
        Derive { model, contents: Vec::new(), symbols: HashMap::new(), known: HashMap::new(), found: Vec::new() };
    let mut equations = derive.model.equations.clone();
    for source in equations.iter_mut().flat_map(|equation| &mut equation.terms) {
        source.expr = derive.rewritten(source.expr);
    }
    let found = derive.found;
    model.equations = equations;
    defined(model, found)
}

/// The kind of an expression, by the constants and operations in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    /// One product of powers of constants and numbers.
    Product,
    /// A sum of several such products, or a power of one.
    Polynomial,
    /// Any other expression of constants.
    Constant,
    /// Also parameters, inputs, or coordinates.
    Other,
}

struct Derive<'m> {
    model: &'m mut ExactModel,
    /// Contents by node, as far as they are known.
    contents: Vec<Content>,
    /// The symbol that stands for a constant expression.
    symbols: HashMap<ExprId, ExprId>,
    /// Nodes as they are rewritten.
    known: HashMap<ExprId, ExprId>,
    /// The symbols and the expressions for which they stand, in the order in which they were made.
    found: Vec<(Symbol, ExprId)>,
}

impl Derive<'_> {
    fn content(&mut self, id: ExprId) -> Content {
        let graph = &self.model.graph;
        for known in graph.ids_from(self.contents.len()).take_while(|&other| other <= id) {
            let of = |part: ExprId| self.contents[part.index()];
            let parts: Vec<Content> = graph.operands(known).map(of).collect();
            let worst = parts.iter().copied().fold(Content::Product, |worst, part| match (worst, part) {
                (Content::Other, _) | (_, Content::Other) => Content::Other,
                (Content::Constant, _) | (_, Content::Constant) => Content::Constant,
                (Content::Polynomial, _) | (_, Content::Polynomial) => Content::Polynomial,
                _ => Content::Product,
            });
            let content = match (graph.node(known), worst) {
                (_, Content::Other) => Content::Other,
                (Node::Number(_) | Node::Pi, _) => Content::Product,
                (Node::Symbol(symbol), _) => match self.model.quantity(*symbol).kind {
                    Kind::Constant { .. } => Content::Product,
                    _ => Content::Other,
                },
                (Node::Derivative(..) | Node::Placeholder(_), _) => Content::Other,
                (Node::Function(..) | Node::Atan2(..), _) => Content::Constant,
                (Node::Sum(_), Content::Product) => Content::Polynomial,
                (Node::Power(_, exponent), Content::Polynomial) if *exponent < 0 => Content::Constant,
                (_, content) => content,
            };
            self.contents.push(content);
        }
        self.contents[id.index()]
    }

    /// The expression with constants in place of what is made of constants alone.
    fn rewritten(&mut self, expr: ExprId) -> ExprId {
        let mut reached: BTreeSet<ExprId> = BTreeSet::new();
        let mut stack = vec![expr];
        while let Some(id) = stack.pop() {
            // Constants are taken as a whole, and what moves within a function has no finite series anyway.
            let node = self.model.graph.node(id);
            let opens = matches!(node, Node::Sum(_) | Node::Product(_)) || matches!(node, Node::Power(_, 1..));
            if reached.insert(id) && opens && self.content(id) == Content::Other {
                stack.extend(self.model.graph.operands(id));
            }
        }
        for id in reached {
            if !self.known.contains_key(&id) {
                let result = self.rewritten_node(id);
                self.known.insert(id, result);
            }
        }
        self.known[&expr]
    }

    /// A node whose operands are known, where they are needed.
    fn rewritten_node(&mut self, id: ExprId) -> ExprId {
        if self.content(id) != Content::Other {
            return self.constant(id);
        }
        match self.model.graph.node(id).clone() {
            Node::Sum(terms) => {
                let (constant, mut terms) = self.separated(&terms);
                if !constant.is_empty() {
                    let whole = self.model.graph.sum(&constant);
                    terms.push(self.constant(whole));
                }
                self.model.graph.sum(&terms)
            }
            Node::Product(factors) => {
                let (constant, mut factors) = self.separated(&factors);
                if !constant.is_empty() {
                    let whole = self.model.graph.product(&constant);
                    factors.push(self.constant(whole));
                }
                self.model.graph.product(&factors)
            }
            Node::Power(base, exponent) if exponent > 0 => {
                let base = self.known[&base];
                self.model.graph.pow(base, exponent)
            }
            _ => id,
        }
    }

    /// The operands that a new constant is to stand for, and the others as they are rewritten.
    fn separated(&mut self, operands: &[ExprId]) -> (Vec<ExprId>, Vec<ExprId>) {
        let (mut constant, mut others) = (Vec::new(), Vec::new());
        for &operand in operands {
            match self.content(operand) {
                Content::Constant => constant.push(operand),
                _ => others.push(self.known[&operand]),
            }
        }
        (constant, others)
    }

    /// An expression of constants, or the constant that stands for it.
    fn constant(&mut self, id: ExprId) -> ExprId {
        if self.content(id) != Content::Constant {
            return id;
        }
        if let Some(&symbol) = self.symbols.get(&id) {
            return symbol;
        }
        let result = if trigonometric::is_zero(&mut self.model.graph, id) {
            self.model.graph.integer(0)
        } else {
            let symbol = self.model.declare("", None, Kind::Constant { value: None });
            self.found.push((symbol, id));
            self.model.graph.symbol(symbol)
        };
        self.symbols.insert(id, result);
        result
    }
}

/// Names the symbols, and writes the definitions with names for what they have in common.
fn defined(model: &mut ExactModel, found: Vec<(Symbol, ExprId)>) -> Vec<Derived> {
    let mut uses: HashMap<ExprId, usize> = HashMap::new();
    let mut seen: BTreeSet<ExprId> = BTreeSet::new();
    let mut stack: Vec<ExprId> = found.iter().map(|(_, expr)| *expr).collect();
    for &expr in &stack {
        *uses.entry(expr).or_default() += 2;
    }
    while let Some(id) = stack.pop() {
        if seen.insert(id) {
            for part in model.graph.operands(id) {
                *uses.entry(part).or_default() += 1;
                stack.push(part);
            }
        }
    }
    let own: HashMap<ExprId, Symbol> = found.iter().map(|(symbol, expr)| (*expr, *symbol)).collect();
    let mut replaced: HashMap<ExprId, ExprId> = HashMap::new();
    let mut list = Vec::new();
    // Operands have smaller ids, so that a definition comes after those that it needs.
    for id in seen {
        let shared = uses[&id] > 1 && model.graph.written_size(id) >= WORTH_A_NAME;
        let is_number = matches!(model.graph.node(id), Node::Number(_));
        if is_number || !(shared || own.contains_key(&id)) {
            continue;
        }
        let short = model.graph.substitute(id, &replaced);
        let symbol = own.get(&id).copied().unwrap_or_else(|| model.declare("", None, Kind::Constant { value: None }));
        let name = free_name(model, list.len() + 1);
        model.symbols[symbol.0 as usize].name.clone_from(&name);
        list.push(Derived { name, definition: model.display(short) });
        let stands = model.graph.symbol(symbol);
        replaced.insert(id, stands);
    }
    list
}

/// `s1`, `s2`, ... by the number; underscores follow where a quantity or a coordinate has the name already.
fn free_name(model: &ExactModel, number: usize) -> EcoString {
    let mut name = format!("s{number}");
    while model.find_symbol(&name).is_some() || model.coordinates.iter().any(|coordinate| coordinate.name == name) {
        name.push('_');
    }
    name.into()
}
