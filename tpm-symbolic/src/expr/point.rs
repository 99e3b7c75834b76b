//! Values of expressions in a field, at points where sines and cosines have values in the field.
//!
//! An angle is no element of a field, but its point on the unit circle can be. With t the tangent of half the angle,
//!
//! ```text
//! cos = (1 - t^2) / (1 + t^2) ,      sin = 2 t / (1 + t^2) .
//! ```
//!
//! The arguments of sines, cosines and tangents are written as sums of multiples of *units*: a coordinate, a symbol, or
//! any other factor of a number. Every unit has one t. Points of sums and multiples of angles follow by rotation, so
//! that all identities between sines and cosines of such sums hold at every point. A unit and the point of its angle
//! are drawn independently, since x and cos x are algebraically independent. A field has no order, so the sign of an
//! expression is drawn too, and |u| = u sign(u). The value of every other function, such as a square root, is drawn
//! like that of a leaf. A result that holds for independent values then holds for the functions, but not every identity
//! between functions is recognised.

use crate::algebra::field::Field;
use crate::budget;
use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::number::rational::Rational;
use num_integer::Integer;
use num_traits::{One, ToPrimitive};
use rustc_hash::FxHashMap;

/// Operations for an expression whose value is found, for the budget.
const EVALUATED: u64 = 20;

/// A quantity whose value the caller chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Drawn {
    /// A leaf of the graph, pi, or a function that has no exact value.
    Value(ExprId),
    /// The sign of an expression that is not zero.
    Sign(ExprId),
    /// The tangent of half the angle of a unit, by its index.
    HalfTangent(usize),
}

/// A unit of angles. The drawn angle is the product of the factors divided by the divisor.
#[derive(Clone, Debug)]
pub struct Unit {
    /// The factors of the unit: one node, the factors of a product, or nothing for the number one.
    pub factors: Vec<ExprId>,
    /// The common denominator of the multiples of the factors' product that occur.
    pub divisor: i64,
}

/// The argument of a sine, cosine or tangent: quarter turns, and multiples of units.
struct Angle {
    quarters: i64,
    parts: Vec<(usize, Rational)>,
}

/// A set of expressions to be evaluated at many points.
pub struct Points<'g> {
    graph: &'g Graph,
    roots: Vec<ExprId>,
    /// The nodes that the roots need, operands first.
    order: Vec<ExprId>,
    units: Vec<Unit>,
    angles: FxHashMap<ExprId, Angle>,
}

impl<'g> Points<'g> {
    /// The expressions `roots` of a graph.
    #[must_use]
    pub fn new(graph: &'g Graph, roots: &[ExprId]) -> Self {
        let mut this =
            Self { graph, roots: roots.to_vec(), order: Vec::new(), units: Vec::new(), angles: FxHashMap::default() };
        let mut needed = vec![false; roots.iter().map(|root| root.index() + 1).max().unwrap_or(0)];
        let mut stack = roots.to_vec();
        while let Some(id) = stack.pop() {
            if std::mem::replace(&mut needed[id.index()], true) {
                continue;
            }
            this.order.push(id);
            match *graph.node(id) {
                Node::Function(Function::Sin | Function::Cos | Function::Tan, argument) => this.resolve(argument),
                // The value of the function is drawn, so its argument is not needed.
                Node::Function(function, _) if !matches!(function, Function::Sign | Function::Abs) => {}
                Node::Atan2(..) => {}
                _ => stack.extend(graph.operands(id)),
            }
        }
        this.order.sort_unstable();
        this
    }

    /// The units of the angles.
    #[must_use]
    pub fn units(&self) -> &[Unit] {
        &self.units
    }

    /// Writes the argument of a function as a sum of multiples of units.
    fn resolve(&mut self, argument: ExprId) {
        if self.angles.contains_key(&argument) {
            return;
        }
        let terms = match self.graph.node(argument) {
            Node::Sum(terms) => terms.as_slice(),
            _ => std::slice::from_ref(&argument),
        };
        let mut angle = Angle { quarters: 0, parts: Vec::new() };
        for &term in terms {
            let factors = match self.graph.node(term) {
                Node::Product(factors) => factors.as_slice(),
                _ => std::slice::from_ref(&term),
            };
            let (multiple, rest) = match self.graph.as_number(factors[0]) {
                Some(value) => (value.clone(), &factors[1..]),
                None => (Rational::one(), factors),
            };
            let turns = &multiple * &Rational::from_integer(2.into());
            if let ([single], true) = (rest, turns.is_integer())
                && matches!(self.graph.node(*single), Node::Pi)
                && let Some(quarters) = turns.to_integer().mod_floor(&4.into()).to_i64()
            {
                angle.quarters += quarters;
                continue;
            }
            let unit = self.units.iter().position(|unit| unit.factors == rest).unwrap_or_else(|| {
                self.units.push(Unit { factors: rest.to_vec(), divisor: 1 });
                self.units.len() - 1
            });
            let below = multiple.denom().to_i64().unwrap_or(1);
            let divisor = &mut self.units[unit].divisor;
            *divisor = divisor.checked_mul(below / divisor.gcd(&below)).unwrap_or(*divisor);
            angle.parts.push((unit, multiple));
        }
        self.angles.insert(argument, angle);
    }

    /// All quantities that may be drawn, in a fixed order.
    pub fn drawn(&self) -> impl Iterator<Item = Drawn> {
        let of_node = |&id: &ExprId| match *self.graph.node(id) {
            Node::Function(Function::Sign | Function::Abs, argument) => Some(Drawn::Sign(argument)),
            Node::Function(Function::Sin | Function::Cos | Function::Tan, _) => None,
            Node::Number(_) | Node::Sum(_) | Node::Product(_) | Node::Power(..) => None,
            _ => Some(Drawn::Value(id)),
        };
        (0..self.units.len()).map(Drawn::HalfTangent).chain(self.order.iter().filter_map(of_node))
    }

    /// The leaves on which a drawn quantity depends, in increasing order.
    #[must_use]
    pub fn leaves(&self, drawn: Drawn) -> Vec<ExprId> {
        match drawn {
            Drawn::Value(id) | Drawn::Sign(id) => self.graph.leaves(id),
            Drawn::HalfTangent(unit) => self.graph.leaves_of(self.units[unit].factors.iter().copied()),
        }
    }

    /// The values of the roots. `draw` chooses the drawn quantities, and must give equal values for equal quantities.
    /// `None` where a denominator is zero.
    pub fn evaluate<F: Field>(
        &self,
        field: &F,
        mut draw: impl FnMut(Drawn) -> Option<F::Element>,
    ) -> Option<Vec<F::Element>> {
        budget::charge(EVALUATED * self.order.len() as u64);
        let (zero, one) = (field.zero(), field.one());
        let mut circle = Vec::with_capacity(self.units.len());
        for index in 0..self.units.len() {
            let t = draw(Drawn::HalfTangent(index))?;
            let square = field.mul(&t, &t);
            let below = field.inverse(&field.add(&one, &square))?;
            let cos = field.mul(&field.sub(&one, &square), &below);
            circle.push((cos, field.mul(&field.add(&t, &t), &below)));
        }
        let mut angles: FxHashMap<ExprId, (F::Element, F::Element)> = FxHashMap::default();
        for (&argument, angle) in &self.angles {
            let mut point = match angle.quarters.rem_euclid(4) {
                0 => (one.clone(), zero.clone()),
                1 => (zero.clone(), one.clone()),
                2 => (field.sub(&zero, &one), zero.clone()),
                _ => (zero.clone(), field.sub(&zero, &one)),
            };
            for (unit, multiple) in &angle.parts {
                let count = multiple * &Rational::from_integer(self.units[*unit].divisor.into());
                let count = count.is_integer().then(|| count.to_integer().to_i64()).flatten()?;
                point = turned(field, &point, &multiplied(field, &circle[*unit], count));
            }
            angles.insert(argument, point);
        }
        let mut values: FxHashMap<ExprId, F::Element> = FxHashMap::default();
        values.reserve(self.order.len());
        for &id in &self.order {
            let at = |operand: &ExprId| &values[operand];
            let value = match self.graph.node(id) {
                Node::Number(value) => field.number(value)?,
                Node::Sum(terms) => {
                    let (first, rest) = terms.split_first().expect("invariant: a sum has terms");
                    rest.iter().fold(at(first).clone(), |sum, term| field.add(&sum, at(term)))
                }
                Node::Product(factors) => {
                    let (first, rest) = factors.split_first().expect("invariant: a product has factors");
                    rest.iter().fold(at(first).clone(), |product, factor| field.mul(&product, at(factor)))
                }
                Node::Power(base, exponent) => field.power(at(base), *exponent)?,
                Node::Function(Function::Cos, argument) => angles[argument].0.clone(),
                Node::Function(Function::Sin, argument) => angles[argument].1.clone(),
                Node::Function(Function::Tan, argument) => {
                    let (cos, sin) = &angles[argument];
                    field.mul(sin, &field.inverse(cos)?)
                }
                Node::Function(Function::Sign, argument) if field.is_zero(at(argument)) => zero.clone(),
                Node::Function(Function::Sign, argument) => draw(Drawn::Sign(*argument))?,
                Node::Function(Function::Abs, argument) if field.is_zero(at(argument)) => zero.clone(),
                Node::Function(Function::Abs, argument) => field.mul(at(argument), &draw(Drawn::Sign(*argument))?),
                _ => draw(Drawn::Value(id))?,
            };
            values.insert(id, value);
        }
        Some(self.roots.iter().map(|root| values[root].clone()).collect())
    }
}

/// The point of the circle at the sum of two angles.
fn turned<F: Field>(field: &F, a: &(F::Element, F::Element), b: &(F::Element, F::Element)) -> (F::Element, F::Element) {
    let cos = field.sub(&field.mul(&a.0, &b.0), &field.mul(&a.1, &b.1));
    (cos, field.add(&field.mul(&a.1, &b.0), &field.mul(&a.0, &b.1)))
}

/// The point of the circle at a multiple of an angle.
fn multiplied<F: Field>(field: &F, angle: &(F::Element, F::Element), count: i64) -> (F::Element, F::Element) {
    let (cos, sin) = angle.clone();
    let mut square = if count < 0 { (cos, field.sub(&field.zero(), &sin)) } else { (cos, sin) };
    let mut rest = count.unsigned_abs();
    let mut point = (field.one(), field.zero());
    while rest > 0 {
        if rest & 1 == 1 {
            point = turned(field, &point, &square);
        }
        rest >>= 1;
        if rest > 0 {
            square = turned(field, &square, &square);
        }
    }
    point
}

/// Values drawn at random, the same in every run.
#[derive(Clone, Debug)]
pub struct Draws(u64);

impl Draws {
    /// The sequence of random words with this number; different numbers give independent sequences.
    #[must_use]
    pub fn new(number: u64) -> Self {
        Self(number.wrapping_mul(0xd134_2543_de82_ef95))
    }

    /// A random number below 2^64, uniformly distributed (one step of the SplitMix64 generator).
    pub fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

#[cfg(test)]
mod tests {
    use super::{Draws, Points};
    use crate::algebra::field::{Field, Rationals, Residues};
    use crate::expr::graph::{Coordinate, ExprId, Function, Graph};
    use crate::number::rational::{integer, ratio};
    use num_traits::Zero;

    /// Whether an expression vanishes at three points modulo a prime, and at one rational point.
    fn vanishes(graph: &Graph, expr: ExprId) -> (bool, bool) {
        let points = Points::new(graph, &[expr]);
        let field = Residues::new(Residues::PRIMES[0]);
        let at = |number: u64| {
            let mut draws = Draws::new(number);
            points.evaluate(&field, |_| Some(field.element(draws.word()))).expect("no division by zero")[0]
        };
        let mut draws = Draws::new(9);
        let exact =
            points.evaluate(&Rationals, |_| Some(Rationals.element(draws.word()))).expect("no division by zero");
        ((0..3).all(|number| field.is_zero(&at(number))), exact[0].is_zero())
    }

    #[test]
    fn identities_of_sums_and_multiples_of_angles_hold() {
        let mut g = Graph::new();
        let [x, y] = [0, 1].map(|c| g.derivative_of(Coordinate(c), 0));
        let pi = g.pi();
        let half = g.scale(x, ratio(1, 2));
        let double = g.scale(y, integer(-2));
        let quarter = g.scale(pi, ratio(3, 2));
        let angle = g.sum(&[half, double, quarter]);
        let [cos, sin, tan] = [Function::Cos, Function::Sin, Function::Tan].map(|f| g.function(f, angle));
        let (c2, s2, one) = (g.pow(cos, 2), g.pow(sin, 2), g.integer(-1));
        let pythagoras = g.sum(&[c2, s2, one]);
        assert_eq!(vanishes(&g, pythagoras), (true, true));
        let product = g.mul(tan, cos);
        let tangent = g.sub(product, sin);
        assert_eq!(vanishes(&g, tangent), (true, true));
        // cos(a + 3 pi / 2) = sin a, with a = x/2 - 2 y
        let plain = g.sum(&[half, double]);
        let plain = g.function(Function::Sin, plain);
        let shifted = g.sub(cos, plain);
        assert_eq!(vanishes(&g, shifted), (true, true));
        // sin x = 2 sin(x/2) cos(x/2)
        let (sx, sh, ch) =
            (g.function(Function::Sin, x), g.function(Function::Sin, half), g.function(Function::Cos, half));
        let two = g.integer(2);
        let twice = g.product(&[two, sh, ch]);
        let doubled = g.sub(sx, twice);
        assert_eq!(vanishes(&g, doubled), (true, true));
        let other = g.sub(sx, x);
        assert_eq!(vanishes(&g, other), (false, false));
    }
}
