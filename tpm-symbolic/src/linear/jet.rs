//! Truncated power series in several variables: the Taylor coefficients of a whole expression in one pass.
//!
//! A jet is f(p + d) = sum c_a d^a over multi-indices a of total degree up to N. Sums and products of jets are those of
//! polynomials; a function of a jet u = u0 + h is sum_k f^(k)(u0)/k! h^k, where h has no constant part, so that the sum
//! is finite. The Taylor coefficients f^(k)(u0)/k! follow from short recurrences. No derivative is ever written out.
//!
//! The coefficients are from any [`Analytic`] domain, such as the expressions of a graph.
//!
//! Invariant of [`Jet`]: no multi-index exceeds the degree of its [`Jets`], and indices have one entry per variable.

use crate::algebra::characteristic::Ring;
use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::number::rational::{self, Rational};
use num_traits::One;
use smallvec::SmallVec;
use std::collections::{BTreeMap, HashMap};

/// Exponents of the variables.
pub type Index = SmallVec<[u32; 4]>;

/// A truncated power series.
#[derive(Clone, Debug, PartialEq)]
pub struct Jet<E> {
    /// The coefficients by multi-index; a multi-index that is missing has the coefficient 0.
    pub coefficients: BTreeMap<Index, E>,
}

/// A ring with analytic functions, each defined on a part of it.
pub trait Analytic: Ring {
    /// The value of pi, or of a leaf that is not a variable.
    fn leaf(&mut self, node: &Node, id: ExprId) -> Option<Self::Element>;
    /// An integer power; `None` where it is singular.
    fn power(&mut self, base: &Self::Element, exponent: i32) -> Option<Self::Element>;
    /// The value of a function; `None` where the function has no value or, when `smooth` is set, is not analytic.
    fn function(&mut self, function: Function, argument: &Self::Element, smooth: bool) -> Option<Self::Element>;
    /// The angle of a point; `None` where it is not analytic.
    fn atan2(&mut self, y: &Self::Element, x: &Self::Element) -> Option<Self::Element>;
    /// Whether the element is exactly 0, so that it can be left out.
    fn is_zero(&mut self, a: &Self::Element) -> bool;
}

/// The node that is singular or has no value, because of which a series does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Singular(pub ExprId);

/// Computes jets of the nodes of a graph.
pub struct Jets<'a, A: Analytic> {
    /// The coefficients' arithmetic.
    pub domain: &'a mut A,
    /// The highest total degree kept.
    pub degree: u32,
    /// The leaves that vary and their values at the point; `None` for a variable that occurs in no expression.
    pub variables: Vec<(Option<ExprId>, A::Element)>,
}

impl<A: Analytic> Jets<'_, A> {
    /// The jet of an expression. `nodes` are the nodes that it uses, operands first. They are copies, since the domain
    /// may change the graph meanwhile.
    ///
    /// # Errors
    /// When a node has no Taylor series at the point; the error holds that node.
    pub fn of(&mut self, nodes: &[(ExprId, Node)]) -> Result<Jet<A::Element>, Singular> {
        self.of_beside(nodes, HashMap::new())
    }

    /// [`Self::of`] for an expression of which some parts are known: `memo` holds their jets, and neither they nor what
    /// only they use is among the nodes.
    ///
    /// # Errors
    /// See [`Self::of`].
    pub fn of_beside(
        &mut self,
        nodes: &[(ExprId, Node)],
        mut memo: HashMap<ExprId, Jet<A::Element>>,
    ) -> Result<Jet<A::Element>, Singular> {
        let mut last = None;
        for (id, node) in nodes {
            let jet = self.node(*id, node, &memo).ok_or(Singular(*id))?;
            memo.insert(*id, jet);
            last = Some(*id);
        }
        Ok(last.and_then(|id| memo.remove(&id)).unwrap_or(Jet { coefficients: BTreeMap::new() }))
    }

    fn node(&mut self, id: ExprId, node: &Node, memo: &HashMap<ExprId, Jet<A::Element>>) -> Option<Jet<A::Element>> {
        if let Some(i) = self.variables.iter().position(|(leaf, _)| *leaf == Some(id)) {
            let value = self.variables[i].1.clone();
            let mut jet = self.constant(value);
            if self.degree > 0 {
                let mut index = self.zero_index();
                index[i] = 1;
                jet.coefficients.insert(index, self.domain.number(&Rational::one()));
            }
            return Some(jet);
        }
        Some(match node {
            Node::Number(value) => {
                let value = self.domain.number(value);
                self.constant(value)
            }
            Node::Pi | Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_) => {
                let value = self.domain.leaf(node, id)?;
                self.constant(value)
            }
            Node::Sum(terms) => {
                let mut sum = Jet { coefficients: BTreeMap::new() };
                for term in terms {
                    sum = self.add(sum, &memo[term]);
                }
                sum
            }
            Node::Product(factors) => {
                let mut product = memo[&factors[0]].clone();
                for factor in &factors[1..] {
                    product = self.multiply(&product, &memo[factor]);
                }
                product
            }
            Node::Power(base, exponent) => {
                let (value, rest) = self.split(&memo[base]);
                let count = self.terms_needed(&rest);
                let coefficients = power_coefficients(self.domain, &value, *exponent, count)?;
                self.compose(&coefficients, &rest)
            }
            Node::Function(function, argument) => {
                let (value, rest) = self.split(&memo[argument]);
                let count = self.terms_needed(&rest);
                let coefficients = taylor_coefficients(self.domain, *function, &value, count)?;
                self.compose(&coefficients, &rest)
            }
            Node::Atan2(y, x) => self.angle(&memo[y], &memo[x])?,
        })
    }

    fn zero_index(&self) -> Index {
        SmallVec::from_elem(0, self.variables.len())
    }

    fn constant(&mut self, value: A::Element) -> Jet<A::Element> {
        let mut coefficients = BTreeMap::new();
        if !self.domain.is_zero(&value) {
            coefficients.insert(self.zero_index(), value);
        }
        Jet { coefficients }
    }

    /// The constant part and the rest.
    fn split(&mut self, jet: &Jet<A::Element>) -> (A::Element, Jet<A::Element>) {
        let mut rest = jet.clone();
        let value = rest.coefficients.remove(&self.zero_index());
        (value.unwrap_or_else(|| self.domain.number(&rational::integer(0))), rest)
    }

    /// Number of Taylor coefficients of an outer function that affect the result for an inner part without constant.
    fn terms_needed(&self, rest: &Jet<A::Element>) -> u32 {
        if rest.coefficients.is_empty() { 0 } else { self.degree }
    }

    fn add(&mut self, mut a: Jet<A::Element>, b: &Jet<A::Element>) -> Jet<A::Element> {
        for (index, value) in &b.coefficients {
            self.accumulate(&mut a, index.clone(), value.clone());
        }
        a
    }

    fn accumulate(&mut self, jet: &mut Jet<A::Element>, index: Index, value: A::Element) {
        let sum = match jet.coefficients.get(&index) {
            Some(present) => self.domain.add(present, &value),
            None => value,
        };
        if self.domain.is_zero(&sum) {
            jet.coefficients.remove(&index);
        } else {
            jet.coefficients.insert(index, sum);
        }
    }

    fn multiply(&mut self, a: &Jet<A::Element>, b: &Jet<A::Element>) -> Jet<A::Element> {
        let mut product = Jet { coefficients: BTreeMap::new() };
        for (left, x) in &a.coefficients {
            let room = self.degree - left.iter().sum::<u32>();
            for (right, y) in &b.coefficients {
                if right.iter().sum::<u32>() <= room {
                    let index = left.iter().zip(right).map(|(i, j)| i + j).collect();
                    let value = self.domain.mul(x, y);
                    self.accumulate(&mut product, index, value);
                }
            }
        }
        product
    }

    /// sum_k coefficients_k rest^k.
    fn compose(&mut self, coefficients: &[A::Element], rest: &Jet<A::Element>) -> Jet<A::Element> {
        let one = self.domain.number(&Rational::one());
        let mut power = self.constant(one);
        let mut sum = Jet { coefficients: BTreeMap::new() };
        for (k, coefficient) in coefficients.iter().enumerate() {
            if k > 0 {
                power = self.multiply(&power, rest);
            }
            if power.coefficients.is_empty() {
                break;
            }
            let scale = self.constant(coefficient.clone());
            let term = self.multiply(&power, &scale);
            sum = self.add(sum, &term);
        }
        sum
    }

    /// The angle of (x0 + dx, y0 + dy) is the angle of (x0, y0) plus the angle between the two points, whose tangent is
    /// small.
    fn angle(&mut self, y: &Jet<A::Element>, x: &Jet<A::Element>) -> Option<Jet<A::Element>> {
        let ((y0, dy), (x0, dx)) = (self.split(y), self.split(x));
        let start = self.domain.atan2(&y0, &x0)?;
        let mut result = self.constant(start);
        if dy.coefficients.is_empty() && dx.coefficients.is_empty() {
            return Some(result);
        }
        let (jy0, jx0) = (self.constant(y0.clone()), self.constant(x0.clone()));
        let minus_one = self.domain.number(&rational::integer(-1));
        let minus_one = self.constant(minus_one);
        let (a, b) = (self.multiply(&jx0, &dy), self.multiply(&jy0, &dx));
        let b = self.multiply(&b, &minus_one);
        let cross = self.add(a, &b);
        let (a, b) = (self.multiply(&jx0, &dx), self.multiply(&jy0, &dy));
        let inner = self.add(a, &b);
        // y0^2 + x0^2 as squares, which an interval keeps positive.
        let (y2, x2) = (self.domain.power(&y0, 2)?, self.domain.power(&x0, 2)?);
        let length = self.domain.add(&y2, &x2);
        let inverse = power_coefficients(self.domain, &length, -1, self.degree)?;
        let inverse = self.compose(&inverse, &inner);
        let tangent = self.multiply(&cross, &inverse);
        // atan r = r - r^3/3 + ...
        let series: Vec<A::Element> = (0..=self.degree)
            .map(|k| {
                let value = match k % 4 {
                    1 => rational::ratio(1, i64::from(k)),
                    3 => rational::ratio(-1, i64::from(k)),
                    _ => rational::integer(0),
                };
                self.domain.number(&value)
            })
            .collect();
        let between = self.compose(&series, &tangent);
        result = self.add(result, &between);
        Some(result)
    }
}

/// The nodes that an expression uses, operands first, the expression last.
#[must_use]
pub fn nodes_of(graph: &Graph, expr: ExprId) -> Vec<(ExprId, Node)> {
    graph.used_by(&[expr], |_| false).into_iter().map(|id| (id, graph.node(id).clone())).collect()
}

/// C(p, k) for rational p.
fn binomials(p: &Rational, count: u32) -> Vec<Rational> {
    let mut list = vec![Rational::one()];
    for k in 0..count {
        let last = list[list.len() - 1].clone();
        list.push(last * (p - rational::integer(k.into())) / rational::integer(i64::from(k) + 1));
    }
    list
}

/// (a + h)^p = sum C(p, k) a^(p-k) h^k.
fn power_coefficients<A: Analytic>(
    domain: &mut A,
    a: &A::Element,
    exponent: i32,
    count: u32,
) -> Option<Vec<A::Element>> {
    let binomials = binomials(&rational::integer(exponent.into()), count);
    let mut list = Vec::with_capacity(binomials.len());
    for (k, binomial) in (0i32..).zip(&binomials) {
        if exponent >= 0 && k > exponent {
            break;
        }
        let power = domain.power(a, exponent - k)?;
        list.push(domain.scale(&power, binomial));
    }
    Some(list)
}

/// f^(k)(a) / k! for k = 0..=count.
fn taylor_coefficients<A: Analytic>(
    domain: &mut A,
    function: Function,
    a: &A::Element,
    count: u32,
) -> Option<Vec<A::Element>> {
    let value = domain.function(function, a, count > 0)?;
    let mut list = vec![value.clone()];
    if count == 0 {
        return Some(list);
    }
    let inverse = |k: u32| rational::ratio(1, i64::from(k));
    match function {
        Function::Sin | Function::Cos => {
            let sine = domain.function(Function::Sin, a, true)?;
            let cosine = domain.function(Function::Cos, a, true)?;
            let offset = u32::from(function == Function::Cos);
            let mut factorial = Rational::one();
            for k in 1..=count {
                factorial *= inverse(k);
                let sign = if (k + offset) % 4 >= 2 { -1 } else { 1 };
                let wave = if (k + offset).is_multiple_of(2) { &sine } else { &cosine };
                list.push(domain.scale(wave, &(&factorial * rational::integer(sign))));
            }
        }
        Function::Tan | Function::Tanh => {
            // tan' = 1 + tan^2, tanh' = 1 - tanh^2
            let sign = rational::integer(if function == Function::Tan { 1 } else { -1 });
            for k in 0..count as usize {
                let mut sum = domain.number(&rational::integer(i64::from(k == 0)));
                for i in 0..=k {
                    let product = domain.mul(&list[i], &list[k - i]);
                    let product = domain.scale(&product, &sign);
                    sum = domain.add(&sum, &product);
                }
                list.push(domain.scale(&sum, &inverse(k as u32 + 1)));
            }
        }
        Function::Exp => {
            let mut factorial = Rational::one();
            for k in 1..=count {
                factorial *= inverse(k);
                list.push(domain.scale(&value, &factorial));
            }
        }
        Function::Log => {
            // log(a + h) = log(a) + sum (-1)^(k+1) a^-k h^k / k
            for (k, exponent) in (1..=count).zip(1i32..) {
                let power = domain.power(a, -exponent)?;
                let sign = rational::integer(if k % 2 == 1 { 1 } else { -1 });
                list.push(domain.scale(&power, &(inverse(k) * sign)));
            }
        }
        Function::Atan => {
            // g = 1 / (1 + a^2 + 2 a h + h^2): (1 + a^2) g_k = [k = 0] - 2 a g_(k-1) - g_(k-2)
            let square = domain.power(a, 2)?;
            let one = domain.number(&Rational::one());
            let length = domain.add(&one, &square);
            let length = domain.power(&length, -1)?;
            let slope = domain.mul(a, &length);
            let mut g = vec![length.clone()];
            for k in 1..count as usize {
                let first = domain.mul(&slope, &g[k - 1]);
                let mut next = domain.scale(&first, &rational::integer(-2));
                if k >= 2 {
                    let second = domain.mul(&length, &g[k - 2]);
                    let second = domain.scale(&second, &rational::integer(-1));
                    next = domain.add(&next, &second);
                }
                g.push(next);
            }
            list.extend((1u32..).zip(&g).map(|(k, g)| domain.scale(g, &inverse(k))));
        }
        Function::Asin | Function::Acos => {
            // g = (1 - (a + h)^2)^(-1/2): (1 - a^2) (k+1) g_(k+1) = (2k+1) a g_k + k g_(k-1)
            let square = domain.power(a, 2)?;
            let negative = domain.scale(&square, &rational::integer(-1));
            let one = domain.number(&Rational::one());
            let radicand = domain.add(&one, &negative);
            let root = domain.function(Function::Sqrt, &radicand, true)?;
            let length = domain.power(&radicand, -1)?;
            let slope = domain.mul(a, &length);
            let mut g = vec![domain.power(&root, -1)?];
            for k in 0..count.saturating_sub(1) {
                let at = k as usize;
                let first = domain.mul(&slope, &g[at]);
                let mut next = domain.scale(&first, &rational::ratio(2 * i64::from(k) + 1, i64::from(k) + 1));
                if k >= 1 {
                    let second = domain.mul(&length, &g[at - 1]);
                    let second = domain.scale(&second, &rational::ratio(k.into(), i64::from(k) + 1));
                    next = domain.add(&next, &second);
                }
                g.push(next);
            }
            let sign = rational::integer(if function == Function::Acos { -1 } else { 1 });
            list.extend((1u32..).zip(&g).map(|(k, g)| domain.scale(g, &(inverse(k) * &sign))));
        }
        Function::Sqrt => {
            // sqrt(a + h) = sum C(1/2, k) sqrt(a) a^-k h^k
            let binomials = binomials(&rational::ratio(1, 2), count);
            for (k, binomial) in (0i32..).zip(&binomials).skip(1) {
                let power = domain.power(a, -k)?;
                let product = domain.mul(&value, &power);
                list.push(domain.scale(&product, binomial));
            }
        }
        Function::Abs => list.push(domain.function(Function::Sign, a, true)?),
        Function::Sign => {}
    }
    Some(list)
}
