//! Steps and expressions in Rust.
//!
//! Invariant: the written operators bind as the expression is nested.

use proc_macro2::{Literal, TokenStream};
use quote::{format_ident, quote};
use std::str::FromStr;
use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::number::rational::Rational;
use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::{Expression, Level, Operator, Place, Statement};
use super::super::number::{Rounded, digits, digits_single};
use super::context::Context;

/// A literal of double precision.
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

/// Writes expressions. `leaf` spells the leaves, each as tokens that bind as tightly as a name.
pub(super) struct Writer<L> {
    leaf: L,
}

impl<L: Fn(&Leaf) -> TokenStream> Writer<L> {
    pub(super) fn new(leaf: L) -> Self {
        Self { leaf }
    }

    /// The tokens of an expression.
    pub(super) fn expression(&self, expression: &Expression) -> TokenStream {
        match expression {
            // `T::from_f64(-2.0)` is a call and binds as one.
            Expression::Number(value) => number(value),
            Expression::Pi => quote!(T::PI),
            Expression::Leaf(leaf) => (self.leaf)(leaf),
            Expression::Temporary(index) => {
                let name = format_ident!("t{index}");
                quote!(#name)
            }
            Expression::Binary(operator, left, right) => {
                let (left, right) = (self.at(left, operator.level()), self.at(right, operator.right()));
                match operator {
                    Operator::Add => quote!(#left + #right),
                    Operator::Sub => quote!(#left - #right),
                    Operator::Mul => quote!(#left * #right),
                    Operator::Div => quote!(#left / #right),
                }
            }
            Expression::Negated(value) => {
                let value = self.at(value, Level::Unary);
                quote!(-#value)
            }
            Expression::Call(function, value) => {
                let method = match function {
                    Function::Log => format_ident!("ln"),
                    function => format_ident!("{}", function.name()),
                };
                let value = self.at(value, Level::Atom);
                quote!(#value.#method())
            }
            Expression::Atan2(y, x) => {
                let (y, x) = (self.at(y, Level::Atom), self.expression(x));
                quote!(#y.atan2(#x))
            }
        }
    }

    /// The tokens of an expression, in parentheses unless it binds at least as tightly as `level`.
    pub(super) fn at(&self, expression: &Expression, level: Level) -> TokenStream {
        let tokens = self.expression(expression);
        if expression.level() >= level { quote!(#tokens) } else { quote!((#tokens)) }
    }

    /// The tokens of some steps; `store` gives those that store a result.
    pub(super) fn statements(
        &self,
        context: &Context<'_>,
        statements: &[Statement],
        store: impl Fn(Place, TokenStream) -> TokenStream,
    ) -> TokenStream {
        let write = |statement: &Statement| match statement {
            Statement::Comment(text) => context.comment(text.clone()),
            Statement::Let(index, value) => {
                let (name, value) = (format_ident!("t{index}"), self.expression(value));
                quote!(let #name = #value;)
            }
            Statement::Store(place, value) => store(*place, self.expression(value)),
        };
        statements.iter().map(write).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::code::{Reader, Statement};
    use super::{Writer, number};
    use proc_macro2::TokenStream;
    use quote::{ToTokens, format_ident, quote};
    use tpm_symbolic::expr::graph::{Graph, Symbol};
    use tpm_symbolic::number::rational::{integer, ratio};
    use tpm_symbolic::plan::leaf::Leaf;
    use tpm_symbolic::plan::operation::Op;
    use tpm_symbolic::plan::straight_line::{Merger, Plan};

    fn write(plan: &Plan) -> String {
        let writer = Writer::new(|leaf: &Leaf| match leaf {
            Leaf::Symbol(Symbol(0)) => quote!(a),
            _ => quote!(b),
        });
        let (statements, values) = Reader::new(plan).outputs();
        let statements = statements.iter().map(|statement| match statement {
            Statement::Let(index, value) => {
                let (name, value) = (format_ident!("t{index}"), writer.expression(value));
                quote!(let #name = #value;)
            }
            _ => TokenStream::new(),
        });
        let statements: TokenStream = statements.collect();
        let values = values.iter().map(|value| writer.expression(value));
        quote!(#statements [#(#values),*]).to_token_stream().to_string()
    }

    #[test]
    fn parentheses_keep_the_order_of_operations() {
        let mut merger = Merger::default();
        let a = merger.load(Leaf::Symbol(Symbol(0)));
        let b = merger.load(Leaf::Symbol(Symbol(1)));
        let difference = merger.emit(Op::Sub(a, b));
        let outer = merger.emit(Op::Sub(a, difference));
        let product = merger.emit(Op::Mul(a, b));
        let quotient = merger.emit(Op::Div(outer, product));
        let negative = merger.emit(Op::Neg(quotient));
        let sine = merger.emit(Op::Function(tpm_symbolic::expr::graph::Function::Sin, negative));
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
