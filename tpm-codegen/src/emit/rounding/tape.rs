//! A function as a list of steps, and how far rounding can move its results.
//!
//! Rounding of step k adds e_k to its value, |e_k| <= E_k: half a unit in the last place of the largest value, more for the functions of the
//! C library. Let e_k grow from zero to what it is: by the mean value theorem the result y moves by
//!
//! ```text
//! sum over k of (dy/dv_k) e_k,    |dy/dv_k| taken over all values that the steps can have on the way,
//! ```
//!
//! exactly, so that no term of second order is left out. The derivatives are steps as well (reverse mode), and intervals hold the values
//! of all steps. Intervals alone lose the angle between a vector and an axis: where a sum is c x + s y + r with the cosine and the sine of one
//! angle, it is at most |(x, y)| + |r| (Cauchy-Schwarz), and a vector that was turned before keeps its length.
//!
//! Invariant: the interval of a step holds its exact value for all inputs in their ranges, for all e with |e_k| <= E_k.

use std::collections::HashMap;
use tpm_symbolic::expr::graph::Function;

use super::interval::Interval;

/// Most products of a sum that is looked at as c x + s y + r, and most factors of each. `SLACK` roundings are fewer than these make.
const MOST_TERMS: usize = 16;
const MOST_FACTORS: usize = 4;
const SLACK: f64 = 128.0;

/// The bits of a double that hold its sign and exponent: alone, they are the power of two below it.
const EXPONENT: u64 = 0xfff << 52;

/// A step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Step {
    /// A number by its bits, and whether it stands for one that it is not exactly.
    Number(u64, bool),
    Leaf(usize),
    Add(usize, usize),
    Sub(usize, usize),
    Mul(usize, usize),
    Div(usize, usize),
    Neg(usize),
    Call(Function, usize),
    Atan2(usize, usize),
}

/// The precision of a scalar.
#[derive(Clone, Copy, Debug)]
pub(super) struct Precision {
    /// Half a unit in the last place of 1.
    pub(super) unit: f64,
    /// Half the least positive number.
    pub(super) tiny: f64,
    pub(super) max: f64,
}

/// Why there is no bound, with the step at fault.
#[derive(Clone, Copy, Debug)]
pub(super) enum Fault {
    Divisor(usize),
    Undefined(usize),
    TooLarge(usize),
}

/// A share of a result's bound.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    pub(super) step: usize,
    /// The bound of the step's own rounding, E.
    pub(super) rounding: f64,
    /// The largest derivative of the result by the step.
    pub(super) slope: f64,
}

/// A sum as c x + s y + r.
#[derive(Clone, Copy)]
struct Turned {
    angle: usize,
    x: Signed,
    y: Signed,
    rest: Option<Signed>,
}

/// A step, and whether it is negated.
type Signed = (bool, usize);

/// A factor by which an operand moves a step: whether it is negative, and the step that it is where it is not 1.
type Factor = (bool, Option<usize>);

/// Steps with their values.
pub(super) struct Tape {
    precision: Precision,
    pub(super) steps: Vec<Step>,
    pub(super) values: Vec<Interval>,
    known: HashMap<Step, usize>,
    turned: HashMap<usize, Vec<Turned>>,
    lengths: HashMap<(usize, usize), f64>,
}

impl Tape {
    pub(super) fn new(precision: Precision) -> Self {
        Self {
            precision,
            steps: Vec::new(),
            values: Vec::new(),
            known: HashMap::new(),
            turned: HashMap::new(),
            lengths: HashMap::new(),
        }
    }

    /// Adds a leaf with its range.
    pub(super) fn leaf(&mut self, leaf: usize, range: Interval) -> usize {
        let step = Step::Leaf(leaf);
        self.known.get(&step).copied().unwrap_or_else(|| self.insert(step, range))
    }

    fn insert(&mut self, step: Step, value: Interval) -> usize {
        let index = self.steps.len();
        self.steps.push(step);
        self.values.push(value);
        self.known.insert(step, index);
        index
    }

    /// Adds a step, with the range of its value.
    pub(super) fn push(&mut self, step: Step) -> Result<usize, Fault> {
        let step = match step {
            Step::Add(a, b) => Step::Add(a.min(b), a.max(b)),
            Step::Mul(a, b) => Step::Mul(a.min(b), a.max(b)),
            step => step,
        };
        if let Some(&index) = self.known.get(&step) {
            return Ok(index);
        }
        let at = |index: usize| self.values[index];
        let value = match step {
            Step::Number(bits, _) => Interval::new(f64::from_bits(bits), f64::from_bits(bits)),
            Step::Leaf(_) => unreachable!("invariant: leaves are added with their ranges"),
            Step::Add(a, b) => at(a).add(at(b)),
            Step::Sub(a, b) => at(a).add(at(b).neg()),
            Step::Mul(a, b) if a == b => at(a).squared(),
            Step::Mul(a, b) => at(a).mul(at(b)),
            Step::Div(a, b) => at(a).div(at(b)).ok_or(Fault::Divisor(b))?,
            Step::Neg(a) => at(a).neg(),
            Step::Call(function, a) => at(a).apply(function).ok_or(Fault::Undefined(a))?,
            Step::Atan2(y, x) => at(y).atan2(at(x)).ok_or(Fault::Undefined(x))?,
        };
        let rounding = self.rounding(step, value);
        let index = self.insert(step, if rounding > 0.0 { value.widened(rounding) } else { value });
        if let Step::Add(..) | Step::Sub(..) = step {
            self.tighten(index)?;
        }
        if self.values[index].size() <= self.precision.max { Ok(index) } else { Err(Fault::TooLarge(index)) }
    }

    pub(super) fn number(&mut self, value: f64) -> Result<usize, Fault> {
        self.push(Step::Number(value.to_bits(), false))
    }

    /// E: the bound of a step's own rounding, from the range of its value.
    fn rounding(&self, step: Step, value: Interval) -> f64 {
        let Precision { unit, tiny, .. } = self.precision;
        // A unit in the last place grows with powers of two; sines do not reach the one at 1.
        let half_ulp = |size: f64| unit * f64::from_bits(size.to_bits() & EXPONENT);
        match step {
            Step::Number(_, false) | Step::Leaf(_) | Step::Neg(_) | Step::Call(Function::Abs, _) => 0.0,
            // A sign jumps where rounding moves its argument past zero.
            Step::Call(Function::Sign, a) if self.sign_is_exact(a) || !self.values[a].holds_zero() => 0.0,
            Step::Call(Function::Sign, _) => 2.0,
            Step::Call(Function::Sin | Function::Cos, _) => {
                2.0 * half_ulp(value.size().min(1.0_f64.next_down())) + tiny
            }
            Step::Call(function, _) => 2.0 * ulps(function) * half_ulp(value.size()) + tiny,
            Step::Atan2(..) => 2.0 * ATAN2_ULPS * half_ulp(value.size()) + tiny,
            Step::Mul(a, b) if [a, b].into_iter().any(|factor| self.is_power_of_two(factor)) => tiny,
            _ => half_ulp(value.size()) + tiny,
        }
    }

    fn is_power_of_two(&self, index: usize) -> bool {
        // No bit of the fraction of a double is set.
        matches!(self.steps[index], Step::Number(bits, _) if bits << 12 == 0 && bits << 1 != 0)
    }

    /// Whether a value has the sign of the exact one: what is read, and sums of two such values.
    fn sign_is_exact(&self, index: usize) -> bool {
        let read = |index: usize| matches!(self.steps[index], Step::Leaf(_) | Step::Number(_, false));
        match self.steps[index] {
            Step::Add(a, b) | Step::Sub(a, b) => read(a) && read(b),
            Step::Neg(a) => read(a),
            _ => read(index),
        }
    }

    fn size(&self, signed: Option<Signed>) -> f64 {
        signed.map_or(0.0, |(_, index)| self.values[index].size())
    }

    /// Bounds a sum by the lengths of vectors.
    fn tighten(&mut self, index: usize) -> Result<(), Fault> {
        let turned = self.turn(index)?;
        if turned.is_empty() {
            return Ok(());
        }
        let slack = self.slack(index);
        for Turned { x, y, rest, .. } in turned {
            let length = (self.length(x.1, y.1)? + self.size(rest)) * (1.0 + SLACK * self.precision.unit) + slack;
            self.values[index] = self.values[index].within(length.next_up());
        }
        Ok(())
    }

    /// A step written as a sum of products is that sum up to the roundings in it, which are at most these.
    fn slack(&self, index: usize) -> f64 {
        let mut terms = Vec::new();
        self.terms(index, false, &mut terms);
        let of = |(_, factors): &(bool, Vec<usize>)| {
            let sizes = factors.iter().map(|&factor| self.values[factor].size());
            let (product, large) = sizes.fold((1.0, 1.0), |(p, l): (f64, f64), size| (p * size, l * size.max(1.0)));
            self.precision.unit * product + self.precision.tiny * large
        };
        SLACK * terms.iter().map(of).sum::<f64>()
    }

    /// The terms of a sum as signed products.
    fn terms(&self, index: usize, negated: bool, terms: &mut Vec<(bool, Vec<usize>)>) {
        match self.steps[index] {
            Step::Add(a, b) if terms.len() + 1 < MOST_TERMS => {
                self.terms(a, negated, terms);
                self.terms(b, negated, terms);
            }
            Step::Sub(a, b) if terms.len() + 1 < MOST_TERMS => {
                self.terms(a, negated, terms);
                self.terms(b, !negated, terms);
            }
            Step::Neg(a) => self.terms(a, !negated, terms),
            _ => {
                let (minus, factors) = self.factors(index);
                terms.push((negated != minus, factors));
            }
        }
    }

    fn factors(&self, index: usize) -> (bool, Vec<usize>) {
        match self.steps[index] {
            Step::Neg(a) => {
                let (minus, factors) = self.factors(a);
                (!minus, factors)
            }
            Step::Mul(a, b) => {
                let ((minus, mut factors), (other, more)) = (self.factors(a), self.factors(b));
                factors.extend(more);
                if factors.len() <= MOST_FACTORS { (minus != other, factors) } else { (false, vec![index]) }
            }
            _ => (false, vec![index]),
        }
    }

    /// The cosine or sine among factors, by its angle, and the others.
    fn turning(&self, factors: &[usize]) -> Vec<(usize, bool, Vec<usize>)> {
        let all = factors.iter().enumerate().filter_map(|(place, &factor)| match self.steps[factor] {
            Step::Call(function @ (Function::Sin | Function::Cos), angle) => {
                let mut others = factors.to_vec();
                others.remove(place);
                Some((angle, function == Function::Cos, others))
            }
            _ => None,
        });
        all.collect()
    }

    /// The ways in which a sum is c x + s y + r.
    fn turn(&mut self, index: usize) -> Result<Vec<Turned>, Fault> {
        if let Some(known) = self.turned.get(&index) {
            return Ok(known.clone());
        }
        let mut terms = Vec::new();
        self.terms(index, false, &mut terms);
        let mut angles: Vec<usize> = Vec::new();
        for (_, factors) in &terms {
            angles.extend(self.turning(factors).into_iter().map(|(angle, ..)| angle));
        }
        angles.sort_unstable();
        angles.dedup();
        let mut ways = Vec::new();
        for angle in angles {
            let (mut x, mut y, mut rest) = (Vec::new(), Vec::new(), Vec::new());
            for (minus, factors) in &terms {
                match self.turning(factors).into_iter().find(|(own, ..)| *own == angle) {
                    Some((_, true, others)) => x.push((*minus, others)),
                    Some((_, false, others)) => y.push((*minus, others)),
                    None => rest.push((*minus, factors.clone())),
                }
            }
            if let (Some(x), Some(y)) = (self.sum(&x)?, self.sum(&y)?) {
                let rest = self.sum(&rest)?;
                ways.push(Turned { angle, x, y, rest });
            }
        }
        self.turned.insert(index, ways.clone());
        Ok(ways)
    }

    fn product(&mut self, factors: &[usize]) -> Result<usize, Fault> {
        let Some((&first, more)) = factors.split_first() else { return self.number(1.0) };
        more.iter().try_fold(first, |product, &factor| self.times(product, factor))
    }

    fn times(&mut self, a: usize, b: usize) -> Result<usize, Fault> {
        self.push(Step::Mul(a, b))
    }

    fn sum(&mut self, terms: &[(bool, Vec<usize>)]) -> Result<Option<Signed>, Fault> {
        let mut sum = None;
        for (minus, factors) in terms {
            let term = (*minus, self.product(factors)?);
            sum = Some(self.plus(sum, term)?);
        }
        Ok(sum)
    }

    fn plus(&mut self, sum: Option<Signed>, (minus, term): Signed) -> Result<Signed, Fault> {
        Ok(match sum {
            None => (minus, term),
            Some((sign, sum)) if sign == minus => (sign, self.push(Step::Add(sum, term))?),
            Some((false, sum)) => (false, self.push(Step::Sub(sum, term))?),
            Some((true, sum)) => (false, self.push(Step::Sub(term, sum))?),
        })
    }

    /// A bound of sqrt(x^2 + y^2).
    fn length(&mut self, x: usize, y: usize) -> Result<f64, Fault> {
        let key = (x.min(y), x.max(y));
        if let Some(&length) = self.lengths.get(&key) {
            return Ok(length);
        }
        let hypot = |a: f64, b: f64| (a * a + b * b).sqrt() * (1.0 + 1e-15);
        let size = |tape: &Self, index: usize| tape.values[index].size();
        let mut length = hypot(size(self, x), size(self, y));
        self.lengths.insert(key, length);
        let (near, slack) = (1.0 + SLACK * self.precision.unit, self.slack(x) + self.slack(y));
        // A vector and the same vector turned: (c x + s y, c y - s x).
        for a in self.turn(x)? {
            for b in self.turn(y)? {
                let turned = a.angle == b.angle && a.x.1 == b.y.1 && a.y.1 == b.x.1;
                if turned && (a.x.0 != b.y.0) != (a.y.0 != b.x.0) {
                    let rest = hypot(self.size(a.rest), self.size(b.rest));
                    length = length.min((self.length(a.x.1, a.y.1)? + rest) * near + slack);
                }
            }
        }
        // k (x, y), and (c x, s y).
        let ((_, first), (_, second)) = (self.factors(x), self.factors(y));
        for (place, factor) in first.iter().enumerate().filter(|_| first.len() > 1 && second.len() > 1) {
            let Some(other) = second.iter().position(|other| other == factor) else { continue };
            let (mut rest, mut others) = (first.clone(), second.clone());
            rest.remove(place);
            others.remove(other);
            let (rest, others) = (self.product(&rest)?, self.product(&others)?);
            length = length.min(size(self, *factor) * hypot(size(self, rest), size(self, others)) * near + slack);
        }
        for (angle, cosine, rest) in self.turning(&first) {
            for (other, own, others) in self.turning(&second) {
                if angle == other && cosine != own {
                    let (rest, others) = (self.product(&rest)?, self.product(&others)?);
                    let larger = size(self, rest).max(size(self, others));
                    length = length.min(larger * near + slack);
                }
            }
        }
        self.lengths.insert(key, length);
        Ok(length)
    }

    /// The bound of a result's error, and the shares of the steps in it, the largest first.
    pub(super) fn bound(&mut self, result: usize) -> Result<(f64, Vec<Share>), Fault> {
        let mut slopes: Vec<Vec<Signed>> = vec![Vec::new(); result + 1];
        slopes[result].push((false, self.number(1.0)?));
        let mut shares = Vec::new();
        // Steps of cosines and sines by their angle, with their slopes.
        let mut angles: HashMap<usize, Vec<(usize, usize, f64)>> = HashMap::new();
        let mut total = 0.0_f64;
        for step in (0..=result).rev() {
            let mut slope = None;
            for term in std::mem::take(&mut slopes[step]) {
                slope = Some(self.plus(slope, term)?);
            }
            let Some((minus, slope)) = slope else { continue };
            let size = self.values[slope].size();
            let rounding = self.rounding(self.steps[step], self.values[step]);
            if rounding > 0.0 && size > 0.0 {
                shares.push(Share { step, rounding, slope: size });
                match self.steps[step] {
                    Step::Call(Function::Sin | Function::Cos, angle) => {
                        angles.entry(angle).or_default().push((step, slope, rounding));
                    }
                    _ => total = (total + (rounding * size).next_up()).next_up(),
                }
            }
            for (operand, factor) in self.derivatives(step)? {
                let (sign, slope) = match factor {
                    (sign, None) => (sign, slope),
                    (sign, Some(factor)) if slope == self.number(1.0)? => (sign, factor),
                    (sign, Some(factor)) => (sign, self.times(slope, factor)?),
                };
                slopes[operand].push((minus != sign, slope));
            }
        }
        let mut angles: Vec<_> = angles.into_iter().collect();
        angles.sort_unstable_by_key(|(angle, _)| *angle);
        for (_, own) in angles {
            let mut share: f64 = own.iter().map(|&(_, slope, rounding)| rounding * self.values[slope].size()).sum();
            // |a e| + |b f| <= sqrt(2) max(|e|, |f|) |(a, b)|
            if let [(_, a, e), (_, b, f)] = own[..] {
                share = share.min(std::f64::consts::SQRT_2 * e.max(f) * self.length(a, b)?);
            }
            total = (total + share * (1.0 + 1e-15)).next_up();
        }
        shares.sort_by(|a, b| (b.rounding * b.slope).total_cmp(&(a.rounding * a.slope)));
        Ok((total, shares))
    }

    /// The operands of a step, with the factors by which they move its value.
    fn derivatives(&mut self, step: usize) -> Result<Vec<(usize, Factor)>, Fault> {
        let quotient = |tape: &mut Self, a: usize, b: usize| tape.push(Step::Div(a, b));
        Ok(match self.steps[step] {
            Step::Number(..) | Step::Leaf(_) | Step::Call(Function::Sign, _) => Vec::new(),
            Step::Add(a, b) => vec![(a, (false, None)), (b, (false, None))],
            Step::Sub(a, b) => vec![(a, (false, None)), (b, (true, None))],
            Step::Neg(a) => vec![(a, (true, None))],
            Step::Mul(a, b) => vec![(a, (false, Some(b))), (b, (false, Some(a)))],
            Step::Div(a, b) => {
                let one = self.number(1.0)?;
                let inverse = quotient(self, one, b)?;
                vec![(a, (false, Some(inverse))), (b, (true, Some(self.times(inverse, step)?)))]
            }
            Step::Atan2(y, x) => {
                let (yy, xx) = (self.times(y, y)?, self.times(x, x)?);
                let square = self.push(Step::Add(yy, xx))?;
                vec![(y, (false, Some(quotient(self, x, square)?))), (x, (true, Some(quotient(self, y, square)?)))]
            }
            Step::Call(function, a) => {
                let one = self.number(1.0)?;
                let square = |tape: &mut Self, x: usize| tape.times(x, x);
                let (minus, factor) = match function {
                    Function::Sin => (false, self.push(Step::Call(Function::Cos, a))?),
                    Function::Cos => (true, self.push(Step::Call(Function::Sin, a))?),
                    Function::Tan | Function::Tanh => {
                        let own = square(self, step)?;
                        let sum = if function == Function::Tan { Step::Add(one, own) } else { Step::Sub(one, own) };
                        (false, self.push(sum)?)
                    }
                    Function::Asin | Function::Acos => {
                        let own = square(self, a)?;
                        let rest = self.push(Step::Sub(one, own))?;
                        let root = self.push(Step::Call(Function::Sqrt, rest))?;
                        (function == Function::Acos, quotient(self, one, root)?)
                    }
                    Function::Atan => {
                        let own = square(self, a)?;
                        let sum = self.push(Step::Add(one, own))?;
                        (false, quotient(self, one, sum)?)
                    }
                    Function::Sqrt => {
                        let twice = self.push(Step::Add(step, step))?;
                        (false, quotient(self, one, twice)?)
                    }
                    Function::Exp => (false, step),
                    Function::Log => (false, quotient(self, one, a)?),
                    Function::Abs | Function::Sign => (false, self.push(Step::Call(Function::Sign, a))?),
                };
                vec![(a, (minus, Some(factor)))]
            }
        })
    }
}

/// Units in the last place by which atan2 may be wrong.
pub(super) const ATAN2_ULPS: f64 = 2.0;

/// Units in the last place by which a function of the C library may be wrong.
pub(super) fn ulps(function: Function) -> f64 {
    match function {
        // IEEE 754 asks for the nearest number.
        Function::Sqrt => 0.5,
        Function::Tan | Function::Tanh => 2.0,
        _ => 1.0,
    }
}
