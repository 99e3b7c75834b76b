//! The equations of a model as MathML, which browsers typeset without anything else.
//!
//! Invariant: an equation is a list of pieces, each an element `math` with a term and the sign before it, so that a browser breaks lines
//! between terms. Names are escaped.

use crate::language::ast::{
    Definition, Energy, EnergyKind, Equation, Expr, ExprKind, Force, Item, ModelDeclaration, Operation, Sign,
};

/// Greek letters that begin names, in small letters, with the letter.
const GREEK: [(&str, &str); 20] = [
    ("alpha", "α"),
    ("beta", "β"),
    ("gamma", "γ"),
    ("delta", "δ"),
    ("epsilon", "ε"),
    ("zeta", "ζ"),
    ("eta", "η"),
    ("theta", "θ"),
    ("kappa", "κ"),
    ("lambda", "λ"),
    ("mu", "μ"),
    ("nu", "ν"),
    ("xi", "ξ"),
    ("pi", "π"),
    ("rho", "ρ"),
    ("sigma", "σ"),
    ("tau", "τ"),
    ("phi", "φ"),
    ("psi", "ψ"),
    ("omega", "ω"),
];

/// The statements that say how the machine moves, in the order of the text: equations, energies, forces, and definitions that they use. Each
/// is a list of pieces of MathML. Nothing of mechanisms, whose equations follow from their bodies.
#[must_use]
pub fn typeset(model: &ModelDeclaration) -> Vec<Vec<String>> {
    let of = |item: &Item| match item {
        Item::Equation(Equation { left, right }) => Some(statement(terms(left, ""), right)),
        Item::Energy(Energy { kind, value, .. }) => {
            let symbol = match kind {
                EnergyKind::Kinetic => "T",
                EnergyKind::Potential => "V",
                EnergyKind::Dissipation => "D",
            };
            Some(statement(vec![math(&format!("<mi>{symbol}</mi>"))], value))
        }
        Item::Force(Force { coordinate, value }) => {
            let left = format!("<msub><mi>Q</mi>{}</msub>", name(&coordinate.name));
            Some(statement(vec![math(&left)], value))
        }
        Item::Let(Definition { name: own, value }) | Item::Lump(Definition { name: own, value }) => {
            Some(statement(vec![math(&name(&own.name))], value))
        }
        _ => None,
    };
    model.items.iter().filter_map(of).collect()
}

fn statement(mut left: Vec<String>, right: &Expr) -> Vec<String> {
    left.extend(terms(right, "<mo>=</mo>"));
    left
}

fn math(inner: &str) -> String {
    format!("<math displaystyle=\"true\">{inner}</math>")
}

/// The terms of an expression, each with its sign; `before` stands before the first one.
fn terms(expr: &Expr, before: &str) -> Vec<String> {
    let of = |(index, (sign, term)): (usize, (Sign, &Expr))| {
        let before = match (index, sign) {
            (0, _) => before,
            (_, Sign::Plus) => "<mo form=\"infix\">+</mo>",
            (_, Sign::Minus) => "<mo form=\"infix\">−</mo>",
        };
        math(&format!("{before}{}", if index > 0 { factor(term, false) } else { written(term) }))
    };
    expr.terms().into_iter().enumerate().map(of).collect()
}

/// An expression that stands beside others: in brackets where it is a sum, or begins with a sign that may not stand there.
fn factor(expr: &Expr, first: bool) -> String {
    match &expr.kind {
        ExprKind::Sum(_) => bracketed(expr),
        ExprKind::Negative(_) if !first => bracketed(expr),
        _ => written(expr),
    }
}

fn bracketed(expr: &Expr) -> String {
    format!("<mrow><mo>(</mo>{}<mo>)</mo></mrow>", written(expr))
}

fn written(expr: &Expr) -> String {
    match &expr.kind {
        ExprKind::Number(_) => format!("<mn>{expr}</mn>"),
        ExprKind::Name(own) => name(own),
        ExprKind::Call(function, arguments) => call(&function.name, arguments),
        ExprKind::Negative(inner) => format!("<mrow><mo form=\"prefix\">−</mo>{}</mrow>", factor(inner, false)),
        ExprKind::Sum(list) => {
            let mut text = String::from("<mrow>");
            for (index, (sign, term)) in list.iter().enumerate() {
                text.push_str(match (index, sign) {
                    (0, _) => "",
                    (_, Sign::Plus) => "<mo>+</mo>",
                    (_, Sign::Minus) => "<mo>−</mo>",
                });
                text.push_str(&factor(term, index == 0));
            }
            text + "</mrow>"
        }
        ExprKind::Product(list) => product(list),
        ExprKind::Power(base, exponent) => {
            let base = match &base.kind {
                ExprKind::Number(_) | ExprKind::Name(_) => written(base),
                ExprKind::Call(function, _) if accent(&function.name).is_some() => written(base),
                _ => bracketed(base),
            };
            format!("<msup>{base}<mn>{exponent}</mn></msup>")
        }
    }
}

/// Factors beside each other, over those by which they are divided.
fn product(list: &[(Operation, Expr)]) -> String {
    let side = |operation: Operation| -> Vec<&Expr> {
        list.iter().filter(|(own, _)| *own == operation).map(|(_, factor)| factor).collect()
    };
    let beside = |factors: &[&Expr]| match factors {
        [] => "<mn>1</mn>".to_owned(),
        // Alone above or below a line, a sum needs no brackets.
        [one] => written(one),
        many => {
            let mut text = String::from("<mrow>");
            for (index, own) in many.iter().enumerate() {
                // Two numbers beside each other would read as one.
                let number = |at: usize| matches!(many[at].kind, ExprKind::Number(_));
                text.push_str(match index {
                    0 => "",
                    _ if number(index) => "<mo>·</mo>",
                    _ => "<mspace width=\"0.12em\"/>",
                });
                text.push_str(&factor(own, index == 0));
            }
            text + "</mrow>"
        }
    };
    let (above, below) = (side(Operation::Times), side(Operation::Over));
    if below.is_empty() {
        return beside(&above);
    }
    format!("<mfrac>{}{}</mfrac>", beside(&above), beside(&below))
}

/// The dots over a derivative by time, as a sign that is written behind its letter: every font has it, while accents need one for mathematics.
fn accent(function: &str) -> Option<char> {
    match function {
        "dot" => Some('\u{307}'),
        "ddot" => Some('\u{308}'),
        _ => None,
    }
}

fn call(function: &str, arguments: &[Expr]) -> String {
    match (function, arguments) {
        ("dot" | "ddot", [Expr { kind: ExprKind::Name(own), .. }]) => {
            // Dots stand over the letter, beside which its index stays.
            let (letter, index) = letter_and_index(own);
            let dots: String = accent(function).into_iter().collect();
            with_index(&format!("<mi style=\"font-style: italic\">{letter}{dots}</mi>"), &index)
        }
        ("sqrt", [inner]) => format!("<msqrt>{}</msqrt>", written(inner)),
        ("abs", [inner]) => format!("<mrow><mo>|</mo>{}<mo>|</mo></mrow>", written(inner)),
        _ => {
            let mut text = format!("<mrow><mi>{}</mi><mo>(</mo>", escaped(function));
            for (index, argument) in arguments.iter().enumerate() {
                text.push_str(if index > 0 { "<mo>,</mo>" } else { "" });
                text.push_str(&written(argument));
            }
            text + "<mo>)</mo></mrow>"
        }
    }
}

/// A name: a letter with what follows as its index, as far as it is written so: `theta1`, `c_2`, `fv_q1`.
fn name(own: &str) -> String {
    let (letter, index) = letter_and_index(own);
    with_index(&format!("<mi>{letter}</mi>"), &index)
}

fn with_index(letter: &str, index: &str) -> String {
    if index.is_empty() {
        letter.to_owned()
    } else {
        format!("<msub>{letter}<mi mathvariant=\"normal\">{index}</mi></msub>")
    }
}

fn letter_and_index(own: &str) -> (String, String) {
    let (stem, index) = match own.split_once('_') {
        Some((stem, index)) if !stem.is_empty() && !index.is_empty() => (stem, index),
        _ => {
            let end = own.trim_end_matches(|c: char| c.is_ascii_digit()).len();
            if end == 0 { (own, "") } else { own.split_at(end) }
        }
    };
    let letter =
        GREEK.iter().find(|(word, _)| *word == stem).map_or_else(|| escaped(stem), |(_, letter)| (*letter).to_owned());
    (letter, escaped(index))
}

fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::typeset;
    use crate::language::parse;
    use crate::source::Source;

    fn lines(text: &str) -> Vec<Vec<String>> {
        typeset(&parse(&Source::new("model.tpm", text)).expect("a model"))
    }

    #[test]
    fn an_equation_is_a_list_of_terms() {
        let text = "model M { coordinate x; input u; parameter m, k_1; m*ddot(x) - k_1*x^2/(2*m) = -u; }";
        let [equation] = &lines(text)[..] else { panic!("one equation") };
        assert_eq!(
            equation[..],
            [
                "<math displaystyle=\"true\"><mrow><mi>m</mi><mspace width=\"0.12em\"/><mi style=\"font-style: italic\">x\u{308}</mi></mrow></math>",
                "<math displaystyle=\"true\"><mo form=\"infix\">−</mo><mfrac><mrow><msub><mi>k</mi><mi mathvariant=\"normal\">1</mi></msub><mspace width=\"0.12em\"/>\
                 <msup><mi>x</mi><mn>2</mn></msup></mrow><mrow><mn>2</mn><mspace width=\"0.12em\"/><mi>m</mi></mrow></mfrac></math>",
                "<math displaystyle=\"true\"><mo>=</mo><mrow><mo form=\"prefix\">−</mo><mi>u</mi></mrow></math>",
            ]
        );
    }

    #[test]
    fn a_sum_under_a_power_stands_in_brackets() {
        let all = lines("model M { coordinate x; input u; parameter a, b; a*(x + b)^2 = u; }");
        assert!(all[0][0].contains("<msup><mrow><mo>(</mo><mrow><mi>x</mi>"), "{all:?}");
    }

    #[test]
    fn energies_and_forces_have_their_letters() {
        let text = "model M { coordinate theta1; input u; parameter J, g; kinetic = J*dot(theta1)^2/2; potential = g*cos(theta1); force theta1 = u; }";
        let all = lines(text);
        assert_eq!(all.len(), 3);
        assert!(all[0][0].contains("<mi>T</mi>") && all[1][0].contains("<mi>V</mi>"), "{all:?}");
        assert!(all[0].concat().contains("<msub><mi style=\"font-style: italic\">θ\u{307}</mi>"), "{all:?}");
        assert!(all[2][0].starts_with("<math displaystyle=\"true\"><msub><mi>Q</mi>"), "{all:?}");
    }
}
