//! Plans as Rust statements and expressions.
//!
//! Invariant: every operation of the plan is written exactly once, with its operands in their order, so that the code rounds
//! as the interpreter does; only the division into statements is chosen here. Operations used once are written inside the
//! expression that uses them while that stays readable.

use proc_macro2::{Literal, TokenStream};
use quote::{format_ident, quote};
use std::str::FromStr;
use tpm_symbolic::expr::{Function, Node};
use tpm_symbolic::plan::{Op, Plan};
use tpm_symbolic::rational::Rational;

use super::super::number::{Rounded, digits, digits_single};

/// Leaves and operators in one expression before it gets a name.
const WIDEST: usize = 14;

/// How tightly an expression's outermost operator binds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    Sum,
    Product,
    Unary,
    Atom,
}

#[derive(Clone, Debug)]
struct Written {
    tokens: TokenStream,
    level: Level,
    size: usize,
}

impl Written {
    fn atom(tokens: TokenStream) -> Self {
        Self { tokens, level: Level::Atom, size: 1 }
    }

    /// In parentheses unless it binds at least as tightly as asked for.
    fn at(&self, level: Level) -> TokenStream {
        let tokens = &self.tokens;
        if self.level >= level { quote!(#tokens) } else { quote!((#tokens)) }
    }
}

/// A non-negative literal of double precision.
pub(super) fn literal(value: f64) -> TokenStream {
    let text = digits(value.abs());
    let literal = Literal::from_str(&text).expect("invariant: a finite number's digits are a literal");
    if value.is_sign_negative() && value < 0.0 { quote!(-#literal) } else { quote!(#literal) }
}

/// A literal of single precision.
pub(super) fn literal_single(value: f32) -> TokenStream {
    let text = digits_single(value.abs());
    let literal = Literal::from_str(&text).expect("invariant: a finite number's digits are a literal");
    if value < 0.0 { quote!(-#literal) } else { quote!(#literal) }
}

/// An exact number as an expression of the scalar type `T`.
pub(super) fn number(value: &Rational) -> TokenStream {
    use num_traits::{One, Zero};
    if value.is_zero() {
        return quote!(T::ZERO);
    }
    if value.is_one() {
        return quote!(T::ONE);
    }
    let rounded = Rounded::new(value);
    let double = literal(rounded.double);
    if rounded.agrees() || !rounded.single.is_finite() {
        quote!(T::from_f64(#double))
    } else {
        let single = literal_single(rounded.single);
        quote!(T::rounded(#double, #single))
    }
}

/// Writes a plan output by output.
pub(super) struct PlanWriter<'a, L> {
    plan: &'a Plan,
    leaf: L,
    uses: Vec<u32>,
    written: Vec<Option<Written>>,
    next: usize,
    names: usize,
}

impl<'a, L: Fn(&Node) -> TokenStream> PlanWriter<'a, L> {
    /// A writer that spells leaves by `leaf`, each as something that binds like a name.
    pub(super) fn new(plan: &'a Plan, leaf: L) -> Self {
        let mut uses = vec![0; plan.ops.len()];
        for slot in plan.ops.iter().flat_map(Op::operands).chain(plan.outputs.iter().copied()) {
            uses[slot.index()] += 1;
        }
        Self { plan, leaf, uses, written: vec![None; plan.ops.len()], next: 0, names: 0 }
    }

    /// The statements that output `index` still needs, and its expression.
    pub(super) fn output(&mut self, index: usize) -> (TokenStream, TokenStream) {
        let slot = self.plan.outputs[index];
        let mut statements = TokenStream::new();
        while self.next <= slot.index() {
            let position = self.next;
            self.next += 1;
            let op = &self.plan.ops[position];
            let value = self.write(op);
            let simple = matches!(op, Op::Constant(_) | Op::Pi | Op::Load(_));
            let value = if !simple && (self.uses[position] > 1 || value.size > WIDEST) {
                let name = format_ident!("t{}", self.names);
                self.names += 1;
                let tokens = value.tokens;
                statements.extend(quote!(let #name = #tokens;));
                Written::atom(quote!(#name))
            } else {
                value
            };
            self.written[position] = Some(value);
        }
        let value = self.written[slot.index()].as_ref().expect("invariant: operations come before outputs");
        (statements, value.tokens.clone())
    }

    /// All outputs, each fit to be multiplied.
    pub(super) fn factors(&mut self) -> (TokenStream, Vec<TokenStream>) {
        let (statements, _) = self.outputs();
        let written = self.plan.outputs.iter().filter_map(|slot| self.written[slot.index()].as_ref());
        (statements, written.map(|value| value.at(Level::Unary)).collect())
    }

    /// All outputs at once.
    pub(super) fn outputs(&mut self) -> (TokenStream, Vec<TokenStream>) {
        let mut statements = TokenStream::new();
        let mut values = Vec::with_capacity(self.plan.outputs.len());
        for index in 0..self.plan.outputs.len() {
            let (more, value) = self.output(index);
            statements.extend(more);
            values.push(value);
        }
        (statements, values)
    }

    fn write(&mut self, op: &Op) -> Written {
        let written = &self.written;
        let at = |slot: &tpm_symbolic::plan::Slot| {
            written[slot.index()].as_ref().expect("invariant: operands come before operations")
        };
        match op {
            Op::Constant(value) => {
                let negative = num_traits::Signed::is_negative(value);
                let tokens = number(value);
                // `T::from_f64(-2.0)` is a call and binds as one.
                Written { tokens, level: Level::Atom, size: if negative { 2 } else { 1 } }
            }
            Op::Pi => Written::atom(quote!(T::PI)),
            Op::Load(index) => Written::atom((self.leaf)(&self.plan.inputs[*index as usize])),
            Op::Add(a, b) => {
                let (left, right) = (at(a).at(Level::Sum), at(b).at(Level::Product));
                Written { tokens: quote!(#left + #right), level: Level::Sum, size: at(a).size + at(b).size }
            }
            Op::Sub(a, b) => {
                let (left, right) = (at(a).at(Level::Sum), at(b).at(Level::Product));
                Written { tokens: quote!(#left - #right), level: Level::Sum, size: at(a).size + at(b).size }
            }
            Op::Mul(a, b) => {
                let (left, right) = (at(a).at(Level::Product), at(b).at(Level::Unary));
                Written { tokens: quote!(#left * #right), level: Level::Product, size: at(a).size + at(b).size }
            }
            Op::Div(a, b) => {
                let (left, right) = (at(a).at(Level::Product), at(b).at(Level::Unary));
                Written { tokens: quote!(#left / #right), level: Level::Product, size: at(a).size + at(b).size }
            }
            Op::Neg(a) => {
                let value = at(a).at(Level::Unary);
                Written { tokens: quote!(-#value), level: Level::Unary, size: at(a).size }
            }
            Op::Function(function, a) => {
                let value = at(a).at(Level::Atom);
                let method = method(*function);
                Written { tokens: quote!(#value.#method()), level: Level::Atom, size: at(a).size + 1 }
            }
            Op::Atan2(y, x) => {
                let (y, x_value) = (at(y).at(Level::Atom), at(x));
                let x_tokens = &x_value.tokens;
                Written { tokens: quote!(#y.atan2(#x_tokens)), level: Level::Atom, size: x_value.size + 2 }
            }
        }
    }
}

fn method(function: Function) -> proc_macro2::Ident {
    format_ident!("{}", function.name())
}

#[cfg(test)]
mod tests {
    use super::{PlanWriter, number};
    use quote::{ToTokens, quote};
    use tpm_symbolic::expr::{Graph, Node, Symbol};
    use tpm_symbolic::plan::{Merger, Op, Plan};
    use tpm_symbolic::rational::{integer, ratio};

    fn write(plan: &Plan) -> String {
        let leaf = |node: &Node| match node {
            Node::Symbol(Symbol(0)) => quote!(a),
            _ => quote!(b),
        };
        let (statements, values) = PlanWriter::new(plan, leaf).outputs();
        quote!(#statements [#(#values),*]).to_token_stream().to_string()
    }

    #[test]
    fn parentheses_keep_the_order_of_operations() {
        let mut merger = Merger::default();
        let a = merger.load(&Node::Symbol(Symbol(0)));
        let b = merger.load(&Node::Symbol(Symbol(1)));
        let difference = merger.emit(Op::Sub(a, b));
        let outer = merger.emit(Op::Sub(a, difference));
        let product = merger.emit(Op::Mul(a, b));
        let quotient = merger.emit(Op::Div(outer, product));
        let negative = merger.emit(Op::Neg(quotient));
        let sine = merger.emit(Op::Function(tpm_symbolic::expr::Function::Sin, negative));
        let plan = merger.finish(vec![sine]);
        assert_eq!(write(&plan), "[(- ((a - (a - b)) / (a * b))) . sin ()]");
    }

    #[test]
    fn what_is_used_twice_gets_a_name() {
        let mut graph = Graph::new();
        let (a, b) = (graph.symbol(Symbol(0)), graph.symbol(Symbol(1)));
        let square = graph.pow(a, 2);
        let roots = [graph.mul(square, b), graph.scale(square, ratio(-1, 9))];
        assert_eq!(
            write(&Plan::new(&graph, &roots)),
            "let t0 = a * a ; [b * t0 , - (T :: from_f64 (0.1111111111111111) * t0)]"
        );
        assert_eq!(number(&integer(-3)).to_string(), "T :: from_f64 (- 3.0)");
    }
}
