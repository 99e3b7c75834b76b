//! Expressions in the model language.

use crate::expr::graph::{ExprId, Graph, Names, Node};
use crate::number::rational;
use num_traits::{One, Signed};

/// Most leaf names listed in place of a long expression.
const MOST_NAMES: usize = 8;

/// Most leaves and operations of an expression that an error shows completely.
const MOST_LEAVES: f64 = 200.0;

/// Most characters of an expression in an error.
const MOST_LETTERS: usize = 400;

impl Graph {
    /// The expression in the model language; `names` has the names of symbols and coordinates.
    pub fn display(&self, expr: ExprId, names: &impl Names) -> String {
        let mut text = String::new();
        self.write(expr, 0, names, &mut text);
        text
    }

    /// The expression in the model language where its written form has at most `longest` leaves and operations;
    /// otherwise the leaves on which it depends, as `f(q, dot(q), ...)`.
    pub fn display_short(&self, expr: ExprId, longest: f64, names: &impl Names) -> String {
        if self.written_size(expr) <= longest {
            return self.display(expr, names);
        }
        let leaves = self.leaves(expr);
        let mut list: Vec<String> = leaves.iter().take(MOST_NAMES).map(|&leaf| self.display(leaf, names)).collect();
        if leaves.len() > MOST_NAMES {
            list.push("...".to_owned());
        }
        format!("f({})", list.join(", "))
    }

    /// The expression in an error message, which has a few lines at most: the text of [`Self::display_short`],
    /// truncated where it is still too long.
    pub fn display_brief(&self, expr: ExprId, names: &impl Names) -> String {
        let text = self.display_short(expr, MOST_LEAVES, names);
        match text.char_indices().nth(MOST_LETTERS) {
            Some((end, _)) => format!("{}...", &text[..end]),
            None => text,
        }
    }

    // Precedence: 0 sum, 1 product, 2 unary minus, 3 power.
    fn write(&self, expr: ExprId, strength: u8, names: &impl Names, out: &mut String) {
        let open = |out: &mut String, needed: bool| {
            if needed {
                out.push('(');
            }
        };
        let close = |out: &mut String, needed: bool| {
            if needed {
                out.push(')');
            }
        };
        match self.node(expr) {
            Node::Number(value) => {
                let paren = strength > 0 && (value.is_negative() || !rational::is_integer(value));
                open(out, paren);
                out.push_str(&value.to_string());
                close(out, paren);
            }
            Node::Pi => out.push_str("pi"),
            Node::Symbol(symbol) => out.push_str(&names.symbol_name(*symbol)),
            Node::Placeholder(index) => out.push_str(&format!("#{index}")),
            Node::Derivative(coordinate, order) => {
                let name = names.coordinate_name(*coordinate);
                match order {
                    0 => out.push_str(&name),
                    1 => out.push_str(&format!("dot({name})")),
                    2 => out.push_str(&format!("ddot({name})")),
                    n => out.push_str(&format!("der({name}, {n})")),
                }
            }
            Node::Sum(terms) => {
                open(out, strength > 0);
                for (i, term) in terms.iter().enumerate() {
                    let mut text = String::new();
                    self.write(*term, 0, names, &mut text);
                    if let Some(rest) = text.strip_prefix('-') {
                        out.push_str(if i == 0 { "-" } else { " - " });
                        out.push_str(rest);
                    } else {
                        if i > 0 {
                            out.push_str(" + ");
                        }
                        out.push_str(&text);
                    }
                }
                close(out, strength > 0);
            }
            Node::Product(factors) => {
                let leading_minus = self.as_number(factors[0]).is_some_and(Signed::is_negative);
                let paren = strength > 1 || (strength == 1 && leading_minus);
                open(out, paren);
                self.write_product(factors, names, out);
                close(out, paren);
            }
            Node::Power(base, exponent) if *exponent < 0 => {
                open(out, strength > 1);
                out.push_str("1/");
                self.write_power(*base, -exponent, names, out);
                close(out, strength > 1);
            }
            Node::Power(base, exponent) => self.write_power(*base, *exponent, names, out),
            Node::Function(function, argument) => {
                out.push_str(function.name());
                out.push('(');
                self.write(*argument, 0, names, out);
                out.push(')');
            }
            Node::Atan2(y, x) => {
                out.push_str("atan2(");
                self.write(*y, 0, names, out);
                out.push_str(", ");
                self.write(*x, 0, names, out);
                out.push(')');
            }
        }
    }

    fn write_product(&self, factors: &[ExprId], names: &impl Names, out: &mut String) {
        let mut above: Vec<String> = Vec::new();
        let mut below: Vec<String> = Vec::new();
        for (i, factor) in factors.iter().enumerate() {
            match self.node(*factor) {
                Node::Number(value) if i == 0 => {
                    if value.is_negative() {
                        out.push('-');
                    }
                    let (numerator, denominator) = (value.numer().into_parts().1, value.denom());
                    if !numerator.is_one() {
                        above.push(numerator.to_string());
                    }
                    if !denominator.is_one() {
                        below.push(denominator.to_string());
                    }
                }
                Node::Power(base, exponent) if *exponent < 0 => {
                    let mut text = String::new();
                    self.write_power(*base, -exponent, names, &mut text);
                    below.push(text);
                }
                _ => {
                    let mut text = String::new();
                    self.write(*factor, 1, names, &mut text);
                    above.push(text);
                }
            }
        }
        out.push_str(&if above.is_empty() { "1".to_owned() } else { above.join("*") });
        for text in below {
            out.push('/');
            out.push_str(&text);
        }
    }

    fn write_power(&self, base: ExprId, exponent: i32, names: &impl Names, out: &mut String) {
        let exponent_suffix = if exponent == 1 { String::new() } else { format!("^{exponent}") };
        let strength = if exponent == 1 { 2 } else { 3 };
        self.write(base, strength, names, out);
        out.push_str(&exponent_suffix);
    }
}
