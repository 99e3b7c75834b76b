//! A normal form for expressions with trigonometric functions.
//!
//! The normal form of an expression is a Laurent polynomial over atoms in which
//!
//! - every sine and cosine has a single angle: sums and whole multiples of angles are expanded by the addition
//!   theorems, quarter turns (multiples of pi/2) are removed, and tan a is sin a / cos a;
//! - no sine has a power above 1: sin^2 a becomes 1 - cos^2 a;
//! - sines and cosines of asin, acos, atan and atan2 are algebraic: cos(acos u) = u, sin(acos u) = sqrt(1 - u^2),
//!   sin(atan2(y, x)) = y / sqrt(x^2 + y^2);
//! - squares of square roots and of absolute values are removed.
//!
//! Two expressions that are polynomials in sines, cosines and inverse cosines of rational combinations of independent
//! angles are equal as functions exactly when their normal forms are equal as data; [`is_zero`] decides it for their
//! quotients too. It is not complete beyond that: relations between different square roots, or between the sines of
//! different fractions of pi, are not looked for, so "not zero" then means "not shown to be zero".
//!
//! Square roots are real: sqrt(u)^2 = u holds where the expression is defined.

use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::number::rational::{self, Rational};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, Signed, ToPrimitive, Zero};
use std::collections::{BTreeMap, HashMap};

/// Multiples of an angle above this stay as they are: the expansion of sin(n a) has about n/2 terms.
pub const MAX_MULTIPLE: u32 = 64;

/// The normal form of an expression, over atoms of `graph`.
pub fn normal(graph: &mut Graph, expr: ExprId) -> Polynomial<ExprId> {
    normal_all(graph, &[expr]).pop().unwrap_or_default()
}

/// The normal forms of several expressions, with common angles in their sines and cosines.
pub fn normal_all(graph: &mut Graph, exprs: &[ExprId]) -> Vec<Polynomial<ExprId>> {
    let needed = graph.used_by(exprs, |_| false);
    let denominators = angle_denominators(graph, &needed);
    let mut memo: HashMap<ExprId, Polynomial<ExprId>> = HashMap::new();
    for id in needed {
        let value = match graph.node(id).clone() {
            Node::Number(value) => Polynomial::constant(value),
            Node::Pi | Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_) => Polynomial::variable(id),
            Node::Sum(terms) => terms.iter().fold(Polynomial::zero(), |mut sum, term| {
                sum.add_assign(&memo[term]);
                sum
            }),
            Node::Product(factors) => {
                let mut product = Polynomial::one();
                for factor in &factors {
                    product = multiply(graph, &product, &memo[factor]);
                }
                product
            }
            Node::Power(base, exponent) => power(graph, &memo[&base], exponent),
            Node::Function(function, argument) => {
                let argument = memo[&argument].clone();
                apply(graph, &denominators, function, &argument)
            }
            Node::Atan2(y, x) => {
                let (y, x) = (graph.from_polynomial(&memo[&y]), graph.from_polynomial(&memo[&x]));
                Polynomial::variable(graph.atan2(y, x))
            }
        };
        memo.insert(id, value);
    }
    exprs.iter().map(|expr| memo[expr].clone()).collect()
}

/// The normal form as an expression.
///
/// ```
/// # use tpm_symbolic::expr::{graph::{Function, Graph, Symbol}, trigonometric::{is_zero, simplify}};
/// let mut g = Graph::new();
/// let x = g.symbol(Symbol(0));
/// let squares = [Function::Sin, Function::Cos].map(|function| {
///     let value = g.function(function, x);
///     g.pow(value, 2)
/// });
/// let sum = g.sum(&squares);
/// assert_eq!(simplify(&mut g, sum), g.integer(1));
/// ```
pub fn simplify(graph: &mut Graph, expr: ExprId) -> ExprId {
    let polynomial = normal(graph, expr);
    graph.from_polynomial(&polynomial)
}

/// Whether the expression is shown to be zero wherever it is defined: the numerator of its normal form is zero.
pub fn is_zero(graph: &mut Graph, expr: ExprId) -> bool {
    if graph.is_shown_nonzero(expr) {
        return false;
    }
    let polynomial = normal(graph, expr);
    numerator(graph, &polynomial).is_zero()
}

/// The polynomial times every denominator in it, so that no negative power of a sum, a sine or a root is left; zero
/// exactly when the polynomial is, wherever its denominators are not.
pub fn numerator(graph: &mut Graph, polynomial: &Polynomial<ExprId>) -> Polynomial<ExprId> {
    let mut current = polynomial.clone();
    loop {
        let mut lowest: BTreeMap<ExprId, i32> = BTreeMap::new();
        for (monomial, _) in current.terms() {
            for (&atom, exponent) in monomial.factors() {
                if exponent < 0 {
                    let slot = lowest.entry(atom).or_insert(0);
                    *slot = (*slot).min(exponent);
                }
            }
        }
        if lowest.is_empty() {
            return current;
        }
        let mut cleared = Polynomial::zero();
        for (monomial, coefficient) in current.terms() {
            let mut plain = monomial.clone();
            let mut expanded = Polynomial::one();
            for (&atom, &exponent) in &lowest {
                plain = plain.mul(&Monomial::power_of(atom, -exponent));
                // A sum with a positive power is not an atom of a polynomial: multiply it out.
                let raised = plain.exponent(&atom);
                if raised > 0 && matches!(graph.node(atom), Node::Sum(_)) {
                    plain = plain.mul(&Monomial::power_of(atom, -raised));
                    let base = graph.polynomial(atom);
                    let base = power(graph, &base, raised);
                    expanded = multiply(graph, &expanded, &base);
                }
            }
            let term = Polynomial::term(plain, coefficient.clone());
            cleared.add_assign(&multiply(graph, &term, &expanded));
        }
        current = cleared;
    }
}

/// The product of two normal forms, in normal form.
pub fn multiply(graph: &mut Graph, a: &Polynomial<ExprId>, b: &Polynomial<ExprId>) -> Polynomial<ExprId> {
    let product = a.mul(b);
    reduce(graph, product)
}

/// For every angle (a monomial of an argument of sin, cos or tan) the common denominator of its rational multiples.
fn angle_denominators(graph: &Graph, needed: &[ExprId]) -> BTreeMap<Monomial<ExprId>, BigInt> {
    let mut denominators = BTreeMap::new();
    for &id in needed {
        if let Node::Function(Function::Sin | Function::Cos | Function::Tan, argument) = graph.node(id) {
            for (monomial, coefficient) in graph.polynomial(*argument).terms() {
                let slot = denominators.entry(monomial.clone()).or_insert_with(BigInt::one);
                *slot = slot.lcm(&coefficient.denom());
            }
        }
    }
    denominators
}

fn apply(
    graph: &mut Graph,
    denominators: &BTreeMap<Monomial<ExprId>, BigInt>,
    function: Function,
    argument: &Polynomial<ExprId>,
) -> Polynomial<ExprId> {
    match function {
        Function::Sin => sine_cosine(graph, denominators, argument).0,
        Function::Cos => sine_cosine(graph, denominators, argument).1,
        Function::Tan => {
            let (sine, cosine) = sine_cosine(graph, denominators, argument);
            let inverse = power(graph, &cosine, -1);
            multiply(graph, &sine, &inverse)
        }
        _ => {
            let argument = graph.from_polynomial(argument);
            let value = graph.function(function, argument);
            // Exact values and odd symmetry may have replaced the function.
            graph.polynomial(value)
        }
    }
}

type Pair = (Polynomial<ExprId>, Polynomial<ExprId>);

/// Sine and cosine of a sum of angles.
fn sine_cosine(
    graph: &mut Graph,
    denominators: &BTreeMap<Monomial<ExprId>, BigInt>,
    argument: &Polynomial<ExprId>,
) -> Pair {
    let mut total = (Polynomial::zero(), Polynomial::one());
    for (monomial, coefficient) in argument.terms() {
        let own = coefficient.denom();
        let denominator = denominators.get(monomial).map_or_else(|| own.clone(), |common| common.lcm(&own));
        let multiple = coefficient.numer() * (&denominator / own);
        let part = multiple_angle(graph, monomial, &denominator, &multiple);
        total = add_angles(graph, &total, &part);
    }
    total
}

fn add_angles(graph: &mut Graph, a: &Pair, b: &Pair) -> Pair {
    let sine = multiply(graph, &a.0, &b.1).add(&multiply(graph, &a.1, &b.0));
    let cosine = multiply(graph, &a.1, &b.1).sub(&multiply(graph, &a.0, &b.0));
    (sine, cosine)
}

/// Sine and cosine of `multiple * monomial / denominator`.
fn multiple_angle(graph: &mut Graph, monomial: &Monomial<ExprId>, denominator: &BigInt, multiple: &BigInt) -> Pair {
    let mut multiple = multiple.clone();
    let mut quarter_turns = 0u8;
    if is_pi(graph, monomial) {
        // In units of pi/2 the angle is 2 multiple / denominator.
        let halves: BigInt = &multiple * 2;
        let (turns, rest) = halves.div_mod_floor(denominator);
        quarter_turns = turns.mod_floor(&BigInt::from(4)).to_u8().unwrap_or(0);
        if rest.is_even() {
            multiple = rest / 2;
        } else {
            let part = base_angle(graph, monomial, &Rational::new(rest, denominator * 2));
            return turn(part, quarter_turns);
        }
        if multiple.is_zero() {
            return turn((Polynomial::zero(), Polynomial::one()), quarter_turns);
        }
    }
    let count = multiple.magnitude().to_u32().filter(|&count| count <= MAX_MULTIPLE);
    let Some(count) = count else {
        let part = base_angle(graph, monomial, &Rational::new(multiple, denominator.clone()));
        return turn(part, quarter_turns);
    };
    let single = base_angle(graph, monomial, &Rational::new(BigInt::one(), denominator.clone()));
    let mut pair = (Polynomial::zero(), Polynomial::one());
    for _ in 0..count {
        pair = add_angles(graph, &pair, &single);
    }
    if multiple.is_negative() {
        pair.0 = pair.0.scale(&rational::integer(-1));
    }
    turn(pair, quarter_turns)
}

fn is_pi(graph: &Graph, monomial: &Monomial<ExprId>) -> bool {
    let mut factors = monomial.factors();
    matches!((factors.next(), factors.next()), (Some((&atom, 1)), None) if matches!(graph.node(atom), Node::Pi))
}

/// The sine and cosine of an angle increased by `count` quarter turns.
fn turn(pair: Pair, count: u8) -> Pair {
    (0..count).fold(pair, |(sine, cosine), _| (cosine, sine.scale(&rational::integer(-1))))
}

/// Sine and cosine of `coefficient * monomial`, not expanded further.
fn base_angle(graph: &mut Graph, monomial: &Monomial<ExprId>, coefficient: &Rational) -> Pair {
    if coefficient.is_one()
        && let Some(pair) = inverse_function(graph, monomial)
    {
        return pair;
    }
    let angle = graph.from_polynomial(&Polynomial::term(monomial.clone(), coefficient.clone()));
    let (sine, cosine) = (graph.function(Function::Sin, angle), graph.function(Function::Cos, angle));
    (graph.polynomial(sine), graph.polynomial(cosine))
}

/// Sine and cosine of an inverse trigonometric function, algebraically.
fn inverse_function(graph: &mut Graph, monomial: &Monomial<ExprId>) -> Option<Pair> {
    let mut factors = monomial.factors();
    let (Some((&atom, 1)), None) = (factors.next(), factors.next()) else { return None };
    match *graph.node(atom) {
        Node::Function(function @ (Function::Asin | Function::Acos), u) => {
            let u = graph.polynomial(u);
            let square = multiply(graph, &u, &u);
            let other = root(graph, &Polynomial::one().sub(&square));
            Some(if function == Function::Asin { (u, other) } else { (other, u) })
        }
        Node::Function(Function::Atan, u) => {
            let u = graph.polynomial(u);
            let length = root(graph, &Polynomial::one().add(&u.mul(&u)));
            let inverse = power(graph, &length, -1);
            Some((multiply(graph, &u, &inverse), inverse))
        }
        Node::Atan2(y, x) => {
            let (y, x) = (graph.polynomial(y), graph.polynomial(x));
            let square = multiply(graph, &y, &y).add(&multiply(graph, &x, &x));
            let length = root(graph, &square);
            let inverse = power(graph, &length, -1);
            Some((multiply(graph, &y, &inverse), multiply(graph, &x, &inverse)))
        }
        _ => None,
    }
}

fn root(graph: &mut Graph, radicand: &Polynomial<ExprId>) -> Polynomial<ExprId> {
    let radicand = graph.from_polynomial(radicand);
    let value = graph.function(Function::Sqrt, radicand);
    graph.polynomial(value)
}

/// An integer power of a normal form, in normal form. A sum under a negative power becomes an atom whose first
/// coefficient is 1.
fn power(graph: &mut Graph, base: &Polynomial<ExprId>, exponent: i32) -> Polynomial<ExprId> {
    if exponent >= 0 {
        let mut result = Polynomial::one();
        for _ in 0..exponent {
            result = multiply(graph, &result, base);
        }
        return result;
    }
    if let Some((monomial, coefficient)) = base.as_term() {
        let inverse = Polynomial::term(monomial.pow(exponent), rational::power(coefficient, exponent));
        return reduce(graph, inverse);
    }
    let Some((_, lead)) = base.terms().next() else {
        // 1/0 remains recognisable as a power of the number 0.
        let zero = graph.integer(0);
        return Polynomial::term(Monomial::power_of(zero, exponent), Rational::one());
    };
    let lead = lead.clone();
    let monic = base.scale(&lead.recip());
    let atom = graph.from_polynomial(&monic);
    Polynomial::term(Monomial::power_of(atom, exponent), rational::power(&lead, exponent))
}

/// Removes squares of sines, roots and absolute values.
fn reduce(graph: &mut Graph, polynomial: Polynomial<ExprId>) -> Polynomial<ExprId> {
    let reducible = |graph: &Graph, atom: ExprId, exponent: i32| match graph.node(atom) {
        Node::Function(Function::Sin, _) => exponent >= 2,
        Node::Function(Function::Sqrt, _) => exponent.abs() >= 2,
        Node::Function(Function::Abs, _) => exponent.abs() >= 2,
        _ => false,
    };
    let clean = |graph: &Graph, monomial: &Monomial<ExprId>| {
        monomial.factors().all(|(&atom, exponent)| !reducible(graph, atom, exponent))
    };
    if polynomial.terms().all(|(monomial, _)| clean(graph, monomial)) {
        return polynomial;
    }
    let mut result = Polynomial::zero();
    for (monomial, coefficient) in polynomial.terms() {
        if clean(graph, monomial) {
            result.add_term(monomial.clone(), coefficient.clone());
            continue;
        }
        let mut kept = Monomial::one();
        let mut expanded = Polynomial::one();
        for (&atom, exponent) in monomial.factors() {
            if !reducible(graph, atom, exponent) {
                kept = kept.mul(&Monomial::power_of(atom, exponent));
                continue;
            }
            kept = kept.mul(&Monomial::power_of(atom, exponent % 2));
            let factor = match *graph.node(atom) {
                Node::Function(Function::Sin, angle) => {
                    let cosine = graph.function(Function::Cos, angle);
                    let square = Polynomial::term(Monomial::power_of(cosine, 2), rational::integer(-1));
                    Polynomial::one().add(&square).pow(exponent.unsigned_abs() / 2)
                }
                Node::Function(Function::Abs, argument) => {
                    let argument = graph.polynomial(argument);
                    power(graph, &argument, exponent - exponent % 2)
                }
                Node::Function(_, argument) => {
                    let argument = graph.polynomial(argument);
                    power(graph, &argument, exponent / 2)
                }
                _ => Polynomial::one(),
            };
            expanded = expanded.mul(&factor);
        }
        let term = Polynomial::term(kept, coefficient.clone()).mul(&expanded);
        result.add_assign(&term);
    }
    // The expansion of one atom may have created another reducible one, such as a root of a sine.
    reduce(graph, result)
}

#[cfg(test)]
mod tests {
    use super::{is_zero, normal, simplify};
    use crate::expr::graph::{ExprId, Function, Graph, Node, Symbol};
    use crate::number::rational::ratio;
    use proptest::prelude::{Just, Strategy, prop_assert, prop_oneof, proptest};

    fn call(graph: &mut Graph, function: Function, argument: ExprId) -> ExprId {
        graph.function(function, argument)
    }

    #[test]
    fn multiple_angles_and_squares() {
        let mut g = Graph::new();
        let x = g.symbol(Symbol(0));
        let (s, c) = (call(&mut g, Function::Sin, x), call(&mut g, Function::Cos, x));
        let double = g.scale(x, ratio(2, 1));
        let half = g.scale(x, ratio(1, 2));
        let left = call(&mut g, Function::Sin, double);
        let right = g.product(&[s, c]);
        let right = g.scale(right, ratio(2, 1));
        let difference = g.sub(left, right);
        assert!(is_zero(&mut g, difference));
        // 2 sin^2(x/2) = 1 - cos x, with halves and wholes in one expression.
        let s_half = call(&mut g, Function::Sin, half);
        let square = g.pow(s_half, 2);
        let twice = g.scale(square, ratio(2, 1));
        let one = g.integer(1);
        let difference = g.sum(&[twice, c]);
        let difference = g.sub(difference, one);
        assert!(is_zero(&mut g, difference));
        assert!(!is_zero(&mut g, left));
    }

    #[test]
    fn quarter_turns_are_removed() {
        // sin(a - pi) = -sin a; cos(3 pi / 2) = 0; cos(pi/6 + pi/2) = -sin(pi/6)
        let mut g = Graph::new();
        let (a, pi) = (g.symbol(Symbol(0)), g.pi());
        let shifted = g.sub(a, pi);
        let (left, s) = (call(&mut g, Function::Sin, shifted), call(&mut g, Function::Sin, a));
        let sum = g.add(left, s);
        assert!(is_zero(&mut g, sum));
        let angle = g.scale(pi, ratio(3, 2));
        let value = call(&mut g, Function::Cos, angle);
        assert!(is_zero(&mut g, value));
        let value = call(&mut g, Function::Sin, angle);
        assert_eq!(normal(&mut g, value).as_constant(), Some(ratio(-1, 1)));
        let (sixth, two_thirds) = (g.scale(pi, ratio(1, 6)), g.scale(pi, ratio(2, 3)));
        let (s, c) = (call(&mut g, Function::Sin, sixth), call(&mut g, Function::Cos, two_thirds));
        let sum = g.add(s, c);
        assert!(is_zero(&mut g, sum));
    }

    #[test]
    fn inverse_functions_are_algebraic_and_quotients_are_compared() {
        let mut g = Graph::new();
        let (u, v) = (g.symbol(Symbol(0)), g.symbol(Symbol(1)));
        let angle = g.atan2(u, v);
        let tangent = call(&mut g, Function::Tan, angle);
        let quotient = g.div(u, v);
        let difference = g.sub(tangent, quotient);
        assert!(is_zero(&mut g, difference));
        // 1/(u+v) - 1/(2u+2v) * 2 = 0; 1/(u+v) + 1/(u-v) = 2u/(u^2-v^2)
        let (sum, difference) = (g.add(u, v), g.sub(u, v));
        let (one, two) = (g.integer(1), g.integer(2));
        let (a, b) = (g.div(one, sum), g.div(one, difference));
        let product = g.mul(sum, difference);
        let right = g.mul(two, u);
        let right = g.div(right, product);
        let left = g.add(a, b);
        let zero = g.sub(left, right);
        assert!(is_zero(&mut g, zero));
        let (acos, asin) = (call(&mut g, Function::Acos, u), call(&mut g, Function::Asin, u));
        let total = g.add(acos, asin);
        let cosine = call(&mut g, Function::Cos, total);
        assert!(is_zero(&mut g, cosine), "acos u + asin u is a quarter turn");
    }

    fn expression() -> impl Strategy<Value = Vec<(u8, i64, i64, i32)>> {
        proptest::collection::vec((prop_oneof![Just(0u8), Just(1), Just(2)], -3i64..4, -3i64..4, 1i32..4), 1..5)
    }

    proptest! {
        #[test]
        fn the_normal_form_is_the_same_function(terms in expression(), x in -2.0f64..2.0, y in -2.0f64..2.0) {
            let mut g = Graph::new();
            let (a, b, pi) = (g.symbol(Symbol(0)), g.symbol(Symbol(1)), g.pi());
            let quarter = g.scale(pi, ratio(1, 2));
            let parts: Vec<ExprId> = terms.iter().map(|&(kind, m, n, power)| {
                let (left, right) = (g.scale(a, ratio(m, 2)), g.scale(b, ratio(n, 1)));
                let angle = g.sum(&[left, right, quarter]);
                let function = [Function::Sin, Function::Cos, Function::Abs][usize::from(kind)];
                let value = g.function(function, angle);
                let raised = g.pow(value, power);
                g.mul(raised, a)
            }).collect();
            let sum = g.sum(&parts);
            let form = simplify(&mut g, sum);
            let at = |id: ExprId| g.evaluate(id, |leaf| match leaf {
                Node::Symbol(Symbol(0)) => x,
                _ => y,
            });
            prop_assert!((at(sum) - at(form)).abs() < 1e-10, "{} {}", at(sum), at(form));
        }
    }
}
