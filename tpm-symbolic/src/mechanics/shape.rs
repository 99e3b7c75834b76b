//! Shapes of motions from their end conditions, solved exactly (Feng, Eqns 2.1 to 2.9).
//!
//! A shape is a finite Fourier series in the phase theta = w t,
//!
//! ```text
//! x(theta) = a_0 + sum_k [a_k cos(k theta) + b_k sin(k theta)] ,
//! ```
//!
//! over chosen harmonics k. Its derivatives with respect to theta are prescribed at the phase 0 and at the phase theta_1,
//! where the motion ends. The conditions are linear in the coefficients. Their right-hand sides are polynomials in
//! amplitudes and constants, so that one solution serves all of their values.
//!
//! Invariant: every coefficient is rational. Therefore cos(k theta_1) and sin(k theta_1) must be rational for every
//! harmonic k of the shape. This holds where k theta_1 is a multiple of pi/2, and where tan(theta_1/2) is rational. No other
//! rational multiple of pi has a rational sine and cosine (Niven), and any angle has phases of the second kind next to it.
//!
//! Where the conditions leave coefficients free, the shape is the one with the least mean square of the acceleration over a
//! whole period, sum_k k^4 (a_k^2 + b_k^2).

use crate::algebra::fourier::{Fourier, Trig};
use crate::algebra::linear;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::Symbol;
use crate::number::rational::{self, Rational};
use num_bigint::BigInt;
use num_traits::{One, Signed, Zero};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use thiserror::Error;

/// Highest derivative that [`Shape::solve`] prescribes. No controller asks for more, and the exact elimination stays
/// fast.
pub const MAX_DERIVATIVE: u32 = 31;
/// The highest harmonic of a shape that [`Shape::solve`] finds.
pub const MAX_HARMONIC: u32 = 255;

/// The phase theta_1 at which a motion ends.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum EndPhase {
    /// This multiple of pi.
    Pi(Rational),
    /// The phase in (0, 2 pi) whose half has this tangent: 2 atan(t) for t > 0, 2 pi + 2 atan(t) for t < 0.
    HalfTangent(Rational),
}

impl EndPhase {
    /// The phase in radians.
    #[must_use]
    pub fn radians(&self) -> f64 {
        use std::f64::consts::PI;
        match self {
            Self::Pi(multiple) => rational::to_f64(multiple) * PI,
            Self::HalfTangent(tangent) => (2.0 * rational::to_f64(tangent).atan()).rem_euclid(2.0 * PI),
        }
    }

    /// The phase in (0, pi) or (pi, 2 pi) with a simple rational tangent of its half that lies next to an angle (rad).
    #[must_use]
    pub fn next_to(angle: f64) -> Option<Self> {
        /// Largest denominator of a proposed tangent.
        const DENOMINATOR: i64 = 12;
        /// Largest proposed tangent; beyond it the phase is pi to within 2e-6 rad.
        const STEEPEST: f64 = 1e6;
        let tangent = (angle / 2.0).tan();
        let within = angle > 0.0 && angle < std::f64::consts::TAU && tangent.abs() <= STEEPEST;
        if !within {
            return None;
        }
        let candidates = (1..=DENOMINATOR).map(|below| ((tangent * below as f64).round() as i64, below));
        let distance = |(above, below): &(i64, i64)| (tangent - *above as f64 / *below as f64).abs();
        let best = candidates.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        (best.0 != 0).then(|| Self::HalfTangent(rational::ratio(best.0, best.1)))
    }

    /// cos(k theta_1) and sin(k theta_1), where they are rational.
    fn cos_sin(&self, harmonic: u32) -> Option<(Rational, Rational)> {
        match self {
            Self::Pi(multiple) => {
                let quarters = multiple * rational::integer(2 * i64::from(harmonic));
                if !quarters.is_integer() {
                    return None;
                }
                let quarter = quarters.to_integer() % 4;
                let quarter = i64::try_from((quarter + 4) % 4).expect("invariant: the remainder of 4 is small");
                let cos = [1, 0, -1, 0][quarter as usize];
                let sin = [0, 1, 0, -1][quarter as usize];
                Some((rational::integer(cos), rational::integer(sin)))
            }
            Self::HalfTangent(tangent) => {
                let square = tangent * tangent;
                let below = Rational::one() + &square;
                let (c, s) = ((Rational::one() - &square) / &below, rational::integer(2) * tangent / &below);
                let turn = |(x, y): (Rational, Rational)| (&x * &c - &y * &s, &x * &s + &y * &c);
                Some((0..harmonic).fold((Rational::one(), Rational::zero()), |at, _| turn(at)))
            }
        }
    }
}

impl fmt::Display for EndPhase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pi(multiple) if multiple.is_one() => f.write_str("pi"),
            Self::Pi(multiple) if multiple.denom().is_one() => write!(f, "{multiple}*pi"),
            Self::Pi(multiple) if multiple.numer().is_one() => write!(f, "pi/{}", multiple.denom()),
            Self::Pi(multiple) => write!(f, "{}*pi/{}", multiple.numer(), multiple.denom()),
            Self::HalfTangent(tangent) => {
                let sign = if tangent.is_negative() { "-" } else { "" };
                write!(f, "2*atan2({}, {sign}{})", tangent.numer().magnitude(), tangent.denom())
            }
        }
    }
}

/// One of the two ends of a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum End {
    /// The phase 0.
    Start,
    /// The phase theta_1.
    Finish,
}

/// A value that a derivative of the shape has at an end.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// The end.
    pub end: End,
    /// Order of the derivative with respect to the phase; 0 is the position.
    pub order: u32,
    /// The value, of the position or of the derivative with respect to the phase.
    pub value: Polynomial<Symbol>,
}

impl Condition {
    /// The prescribed quantity in words, with the value where it is a number.
    #[must_use]
    pub fn describe(&self) -> String {
        let what = match self.order {
            0 => "the position".to_owned(),
            1 => "the velocity".to_owned(),
            2 => "the acceleration".to_owned(),
            n => format!("derivative {n}"),
        };
        let end = match self.end {
            End::Start => "start",
            End::Finish => "end",
        };
        match self.value.as_constant() {
            Some(value) => format!("{what} at the {end} equal to {value}"),
            None => format!("{what} at the {end} as it is given"),
        }
    }
}

/// The request for a shape: its harmonics, its end phase, and the conditions at both ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Harmonics with a cosine, from 1 on. The mean is added where a position is prescribed.
    pub cosines: BTreeSet<u32>,
    /// Harmonics with a sine.
    pub sines: BTreeSet<u32>,
    /// The phase at which the motion ends.
    pub end: EndPhase,
    /// The conditions at both ends.
    pub conditions: Vec<Condition>,
    /// The coefficient of the cosine of the lowest harmonic, for a shape whose size is given by an amplitude instead of
    /// its travel.
    pub amplitude: Option<Polynomial<Symbol>>,
}

/// Why no shape meets its end conditions.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ConditionError {
    /// A harmonic or a derivative is beyond what is supported.
    #[error(
        "harmonics from 1 to {MAX_HARMONIC} and derivatives up to {MAX_DERIVATIVE} make a shape, not {what} {value}"
    )]
    OutOfRange {
        /// Harmonic or derivative.
        what: &'static str,
        /// Its number.
        value: u32,
    },
    /// A harmonic has no rational cosine and sine at the end phase.
    #[error(
        "the cosine and the sine of {harmonic} times {phase} are not both rational, so that no shape is exact there"
    )]
    Irrational {
        /// The harmonic.
        harmonic: u32,
        /// The end phase.
        phase: String,
    },
    /// No series of the chosen harmonics meets a condition together with those before it.
    #[error(
        "no series of these harmonics has {condition} and meets the conditions before it as well; {}",
        least.as_ref().map_or_else(
            || "no finite series does".to_owned(),
            |least| format!("harmonics up to {} are the least that can, with {}", least.highest, least.terms)
        )
    )]
    Impossible {
        /// The condition in words.
        condition: String,
        /// The least harmonics that can meet all conditions; `None` where none can.
        least: Option<Least>,
    },
    /// There is no cosine whose coefficient the amplitude could be.
    #[error("the amplitude of a shape is the coefficient of its lowest cosine, and these harmonics have none")]
    NoCosine,
    /// Nothing moves.
    #[error("every coefficient of this shape is zero, so that nothing moves")]
    NoMotion,
}

/// The least harmonics that meet end conditions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Least {
    /// The highest harmonic. No series whose harmonics are all lower meets the conditions.
    pub highest: u32,
    /// The terms of a series that meets them, as in `cos 1, cos 3`.
    pub terms: String,
}

/// A shape that meets its conditions.
#[derive(Clone, Debug, PartialEq)]
pub struct Solved {
    /// The parts of the series, each with its factor.
    pub parts: Vec<(Monomial<Symbol>, Fourier)>,
    /// The number of coefficients that the conditions left free.
    pub freedom: usize,
}

/// An unknown coefficient; harmonic 0 of the cosine is the mean.
type Unknown = (Trig, u32);

impl Shape {
    /// The series that meets the conditions.
    ///
    /// # Errors
    /// [`ConditionError::OutOfRange`] for a harmonic or derivative beyond the limits, [`ConditionError::Irrational`] where a harmonic
    /// has no exact value at the end phase, [`ConditionError::Impossible`] where no series of these harmonics meets the
    /// conditions, [`ConditionError::NoCosine`] for an amplitude without a cosine, and [`ConditionError::NoMotion`] where only the
    /// series that is zero meets the conditions.
    pub fn solve(&self) -> Result<Solved, ConditionError> {
        self.check_range()?;
        if self.amplitude.is_some() && self.cosines.is_empty() {
            return Err(ConditionError::NoCosine);
        }
        let unknowns = self.unknowns();
        let Some(solved) = self.meet(&unknowns, &self.conditions)? else {
            // The conditions are added one by one to find the first that contradicts those before it.
            let contradicts = |count: &usize| matches!(self.meet(&unknowns, &self.conditions[..*count]), Ok(None));
            let first = (1..=self.conditions.len()).find(contradicts);
            let first = first.expect("invariant: the harmonics meet no condition at all, and not all conditions");
            let condition = self.conditions[first - 1].describe();
            return Err(ConditionError::Impossible { condition, least: self.least() });
        };
        if solved.parts.is_empty() { Err(ConditionError::NoMotion) } else { Ok(solved) }
    }

    fn check_range(&self) -> Result<(), ConditionError> {
        for &harmonic in self.cosines.iter().chain(&self.sines) {
            if harmonic == 0 || harmonic > MAX_HARMONIC {
                return Err(ConditionError::OutOfRange { what: "harmonic", value: harmonic });
            }
        }
        match self.conditions.iter().find(|condition| condition.order > MAX_DERIVATIVE) {
            Some(condition) => Err(ConditionError::OutOfRange { what: "derivative", value: condition.order }),
            None => Ok(()),
        }
    }

    fn unknowns(&self) -> Vec<Unknown> {
        let placed = self.conditions.iter().any(|condition| condition.order == 0);
        let mean = placed.then_some((Trig::Cos, 0));
        let cosines = self.cosines.iter().map(|&k| (Trig::Cos, k));
        let sines = self.sines.iter().map(|&k| (Trig::Sin, k));
        mean.into_iter().chain(cosines).chain(sines).collect()
    }

    /// The series with these unknowns that meets these conditions; `None` where there is none.
    fn meet(&self, unknowns: &[Unknown], conditions: &[Condition]) -> Result<Option<Solved>, ConditionError> {
        let mut at_end = BTreeMap::new();
        for &(_, k) in unknowns {
            let value = self.end.cos_sin(k);
            let missing = || ConditionError::Irrational { harmonic: k, phase: self.end.to_string() };
            at_end.insert(k, value.ok_or_else(missing)?);
        }
        let one = Polynomial::one();
        let given = conditions.iter().map(|condition| &condition.value).chain(&self.amplitude);
        let generators: BTreeSet<Monomial<Symbol>> =
            given.chain([&one]).flat_map(|value| value.terms().map(|(monomial, _)| monomial.clone())).collect();
        let mut rows = Vec::new();
        let mut add = |coefficients: Vec<Rational>, value: &Polynomial<Symbol>| {
            let right = generators.iter().map(|generator| value.coefficient(generator));
            let row: Vec<Rational> = coefficients.into_iter().chain(right).collect();
            if row.iter().any(|entry| !entry.is_zero()) {
                rows.push(row);
            }
        };
        for condition in conditions {
            let start = (Rational::one(), Rational::zero());
            let entry = |&(trig, k): &Unknown| {
                let (cos, sin) = if condition.end == End::Start { &start } else { &at_end[&k] };
                derivative(trig, k, condition.order, cos, sin)
            };
            add(unknowns.iter().map(entry).collect(), &condition.value);
        }
        if let Some(amplitude) = &self.amplitude {
            let lowest = unknowns.iter().position(|&(trig, k)| trig == Trig::Cos && k > 0);
            let entry = |i: usize| if Some(i) == lowest { Rational::one() } else { Rational::zero() };
            add((0..unknowns.len()).map(entry).collect(), amplitude);
        }
        Ok(least_acceleration(rows, unknowns, generators.len()).map(|(solution, freedom)| {
            let part = |(at, generator): (usize, &Monomial<Symbol>)| {
                let series = unknowns.iter().zip(&solution).fold(Fourier::zero(), |sum, (&(trig, k), values)| {
                    let make = if trig == Trig::Cos { Fourier::cos } else { Fourier::sin };
                    sum.add(&make(k as usize, values[at].clone()))
                });
                (generator.clone(), series)
            };
            let parts = generators.iter().enumerate().map(part).filter(|(_, series)| !series.is_zero()).collect();
            Solved { parts, freedom }
        }))
    }

    /// The series that meets the conditions with the lowest harmonics, sines and cosines alike, whatever harmonics are chosen
    /// (Feng, 2.2).
    ///
    /// # Errors
    /// The errors of [`solve`](Self::solve).
    pub fn solve_lowest(&self) -> Result<Solved, ConditionError> {
        self.check_range()?;
        match self.lowest()? {
            Some((_, solved)) if solved.parts.is_empty() => Err(ConditionError::NoMotion),
            Some((_, solved)) => Ok(solved),
            None => self.solve(),
        }
    }

    /// The highest of the lowest harmonics with which the conditions can be met, and the series; `None` where no series meets
    /// them. Every further harmonic adds two coefficients, so that as many harmonics as there are conditions meet those that
    /// are independent.
    fn lowest(&self) -> Result<Option<(u32, Solved)>, ConditionError> {
        let most = u32::try_from(self.conditions.len() + 1).unwrap_or(MAX_HARMONIC).min(MAX_HARMONIC);
        for highest in 1..=most {
            let all: BTreeSet<u32> = (1..=highest).collect();
            let wider = Self { cosines: all.clone(), sines: all, ..self.clone() };
            if let Some(solved) = wider.meet(&wider.unknowns(), &self.conditions)? {
                return Ok(Some((highest, solved)));
            }
        }
        Ok(None)
    }

    /// The lowest harmonics that can meet the conditions, in words.
    fn least(&self) -> Option<Least> {
        // Where a harmonic has no exact values at the end phase, no harmonics are proposed.
        let (highest, solved) = self.lowest().ok().flatten()?;
        let used = |&(trig, k): &Unknown| {
            let which = usize::from(trig == Trig::Sin);
            solved.parts.iter().any(|(_, series)| series.pair(k as usize)[which].is_some())
        };
        let terms = (1..=highest).flat_map(|k| [(Trig::Cos, k), (Trig::Sin, k)]).filter(used);
        let terms: Vec<String> = terms.map(|(trig, k)| format!("{} {k}", trig.name())).collect();
        Some(Least { highest, terms: terms.join(", ") })
    }
}

/// The derivative of an order of cos(k theta) or sin(k theta), where these are `cos` and `sin`.
fn derivative(trig: Trig, k: u32, order: u32, cos: &Rational, sin: &Rational) -> Rational {
    // Successive derivatives of the cosine are k times -sin, -cos, sin, cos; those of the sine are one step behind.
    let step = if trig == Trig::Cos { order } else { order + 3 };
    let value = match step % 4 {
        0 => cos.clone(),
        1 => -sin,
        2 => -cos,
        _ => sin.clone(),
    };
    value * Rational::from_integer(BigInt::from(k).pow(order))
}

/// The solution of `rows`, one list of values per unknown with a value for each of the `columns` behind the unknowns, and the number
/// of directions that the rows leave free. Along these the weighted sum of squares is least. `None` where the rows contradict
/// each other.
fn least_acceleration(
    mut rows: Vec<Vec<Rational>>,
    unknowns: &[Unknown],
    columns: usize,
) -> Option<(Vec<Vec<Rational>>, usize)> {
    let count = unknowns.len();
    let pivots = linear::reduce(&mut rows);
    if pivots.last().is_some_and(|&last| last >= count) {
        return None;
    }
    let mut solution = vec![vec![Rational::zero(); columns]; count];
    for (row, &pivot) in rows.iter().zip(&pivots) {
        solution[pivot] = row[count..].to_vec();
    }
    let left: Vec<Vec<Rational>> = rows.iter().map(|row| row[..count].to_vec()).collect();
    let free = linear::null_space(left, count);
    if free.is_empty() {
        return Some((solution, 0));
    }
    // N^T W N z = -N^T W x for the free directions N and the solution x found so far.
    let weighted = |direction: &[Rational]| -> Vec<Rational> {
        let weight = |k: u32| Rational::from_integer(BigInt::from(k).pow(4));
        direction.iter().zip(unknowns).map(|(value, &(_, k))| value * weight(k)).collect()
    };
    let dot = |a: &[Rational], b: &[Rational]| a.iter().zip(b).map(|(x, y)| x * y).sum::<Rational>();
    let mut normal: Vec<Vec<Rational>> = free
        .iter()
        .map(|direction| {
            let weighted = weighted(direction);
            let matrix = free.iter().map(|other| dot(&weighted, other));
            let column = |at: usize| solution.iter().map(|values| values[at].clone()).collect::<Vec<_>>();
            let right = (0..columns).map(|at| -dot(&weighted, &column(at)));
            matrix.chain(right).collect()
        })
        .collect();
    let pivots = linear::reduce(&mut normal);
    for (row, &pivot) in normal.iter().zip(&pivots) {
        for (values, entry) in solution.iter_mut().zip(&free[pivot]) {
            for (value, step) in values.iter_mut().zip(&row[free.len()..]) {
                *value += entry * step;
            }
        }
    }
    Some((solution, free.len()))
}

#[cfg(test)]
mod tests {
    use super::{Condition, ConditionError, End, EndPhase, Fourier, Least, Shape};
    use crate::algebra::polynomial::Polynomial;
    use crate::expr::graph::Symbol;
    use crate::number::rational::{Rational, integer, ratio};
    use num_traits::Zero;

    const X0: Symbol = Symbol(0);
    const X1: Symbol = Symbol(1);

    fn symbol(symbol: Symbol) -> Polynomial<Symbol> {
        Polynomial::variable(symbol)
    }

    fn number(value: Rational) -> Polynomial<Symbol> {
        Polynomial::constant(value)
    }

    fn condition(end: End, order: u32, value: Polynomial<Symbol>) -> Condition {
        Condition { end, order, value }
    }

    /// The eight conditions of Feng, Eqns 2.2 to 2.9: from x0 to x1 with zero velocity, acceleration and jerk.
    fn point_to_point(harmonics: &[u32], end: EndPhase) -> Shape {
        let rest = |order| [End::Start, End::Finish].map(|end| condition(end, order, Polynomial::zero()));
        let mut conditions = vec![condition(End::Start, 0, symbol(X0)), condition(End::Finish, 0, symbol(X1))];
        conditions.extend((1..=3).flat_map(rest));
        let all = harmonics.iter().copied().collect::<std::collections::BTreeSet<u32>>();
        Shape { cosines: all.clone(), sines: all, end, conditions, amplitude: None }
    }

    /// The series for numbers in place of the symbols.
    fn with(solved: &super::Solved, x0: &Rational, x1: &Rational) -> Fourier {
        solved.parts.iter().fold(Fourier::zero(), |sum, (monomial, series)| {
            let factor = monomial.factors().fold(integer(1), |product, (&symbol, power)| {
                assert_eq!(power, 1);
                product * if symbol == X0 { x0 } else { x1 }
            });
            sum.add(&series.scale(&factor))
        })
    }

    /// The exact value of a series where cosine and sine of the phase are given.
    fn at(series: &Fourier, end: &EndPhase) -> Rational {
        (0..=series.highest_harmonic()).fold(Rational::zero(), |sum, k| {
            let (cos, sin) = end.cos_sin(u32::try_from(k).expect("small")).expect("rational");
            sum + series.cos_coefficient(k) * cos + series.sin_coefficient(k) * sin
        })
    }

    #[test]
    fn eight_end_conditions_at_half_a_period_have_feng_2_20_as_their_only_series() {
        // Feng, Eqns 2.1 to 2.9 with n = 3 and t1 = pi/w: seven coefficients, all sines and cosines, and one solution.
        let solved = point_to_point(&[1, 2, 3], EndPhase::Pi(integer(1))).solve().expect("solvable");
        assert_eq!(solved.freedom, 0);
        let (x0, x1) = (ratio(2, 7), ratio(-5, 3));
        let series = with(&solved, &x0, &x1);
        // Feng, Eqns 2.17 to 2.19.
        let expected = Fourier::constant((&x0 + &x1) / integer(2))
            .add(&Fourier::cos(1, ratio(9, 16) * (&x0 - &x1)))
            .add(&Fourier::cos(3, ratio(1, 16) * (&x1 - &x0)));
        assert_eq!(series, expected);
    }

    #[test]
    fn two_harmonics_cannot_and_the_least_that_can_are_named() {
        let error = point_to_point(&[1, 2], EndPhase::Pi(integer(1))).solve().expect_err("too few");
        let least = Some(Least { highest: 3, terms: "cos 1, cos 3".to_owned() });
        assert!(matches!(&error, ConditionError::Impossible { least: found, .. } if *found == least), "{error}");
        assert_eq!(
            error.to_string(),
            "no series of these harmonics has the acceleration at the end equal to 0 and meets the conditions before it as \
             well; harmonics up to 3 are the least that can, with cos 1, cos 3"
        );
    }

    #[test]
    fn other_end_times_need_four_harmonics() {
        // Feng, below Eqn 2.9: in general four harmonics are needed. Three leave seven coefficients for eight conditions.
        for end in [EndPhase::Pi(ratio(1, 2)), EndPhase::HalfTangent(ratio(1, 3)), EndPhase::HalfTangent(integer(-2))] {
            let three = point_to_point(&[1, 2, 3], end.clone()).solve();
            assert!(
                matches!(&three, Err(ConditionError::Impossible { least: Some(least), .. }) if least.highest == 4),
                "{three:?}"
            );
            let four = point_to_point(&[1, 2, 3, 4], end.clone()).solve().expect("solvable");
            assert_eq!(four.freedom, 1);
            let (x0, x1) = (ratio(1, 2), ratio(-3, 4));
            let series = with(&four, &x0, &x1);
            assert_eq!((series.at_zero(), at(&series, &end)), (x0, x1));
            for order in 1..=3 {
                let derivative = series.derivative(order);
                assert_eq!((derivative.at_zero(), at(&derivative, &end)), (integer(0), integer(0)), "order {order}");
            }
        }
    }

    #[test]
    fn what_is_free_goes_to_the_least_acceleration() {
        // Without the fourth sine the series is unique; with it the mean square of the acceleration is smaller.
        let end = EndPhase::HalfTangent(ratio(1, 3));
        let square = |shape: &Shape| {
            let series = with(&shape.solve().expect("solvable"), &integer(1), &integer(0)).derivative(2);
            (1..=4).fold(integer(0), |sum, k| {
                let (a, b) = (series.cos_coefficient(k), series.sin_coefficient(k));
                sum + &a * &a + &b * &b
            })
        };
        let all = point_to_point(&[1, 2, 3, 4], end);
        let mut fewer = all.clone();
        fewer.sines.remove(&4);
        assert_eq!(fewer.solve().expect("solvable").freedom, 0);
        assert!(square(&all) < square(&fewer));
    }

    #[test]
    fn end_velocities_and_sines() {
        // From 0 with the velocity 1 to 1 with the velocity 1/2 at a quarter of a period.
        let conditions = vec![
            condition(End::Start, 0, Polynomial::zero()),
            condition(End::Start, 1, number(integer(1))),
            condition(End::Finish, 0, number(integer(1))),
            condition(End::Finish, 1, number(ratio(1, 2))),
        ];
        let shape = Shape {
            cosines: [1, 2].into(),
            sines: [1].into(),
            end: EndPhase::Pi(ratio(1, 2)),
            conditions,
            amplitude: None,
        };
        let solved = shape.solve().expect("solvable");
        let expected = Fourier::from_parts(vec![ratio(1, 4), ratio(-1, 2), ratio(1, 4)], vec![integer(1)]);
        assert_eq!((with(&solved, &integer(0), &integer(0)), solved.freedom), (expected, 0));
        // The second sine in place of the second cosine makes the four conditions dependent.
        let dependent = Shape { cosines: [1].into(), sines: [1, 2].into(), ..shape };
        let error = dependent.solve().expect_err("dependent").to_string();
        assert!(error.contains("the velocity at the end equal to 1/2"), "{error}");
    }

    #[test]
    fn without_chosen_harmonics_the_lowest_are_taken() {
        let chosen = |harmonics: &[u32]| point_to_point(harmonics, EndPhase::Pi(integer(1)));
        assert_eq!(chosen(&[]).solve_lowest(), chosen(&[1, 2, 3]).solve());
    }

    #[test]
    fn an_end_phase_without_rational_cosine_and_sine_is_refused() {
        let third = point_to_point(&[1, 2, 3, 4], EndPhase::Pi(ratio(1, 3))).solve();
        assert_eq!(third, Err(ConditionError::Irrational { harmonic: 1, phase: "pi/3".to_owned() }));
        // Harmonics that are multiples of three have multiples of pi as their phases.
        let tripled = point_to_point(&[3, 6, 9], EndPhase::Pi(ratio(1, 3))).solve().expect("solvable");
        let plain = point_to_point(&[1, 2, 3], EndPhase::Pi(integer(1))).solve().expect("solvable");
        let (x0, x1) = (integer(1), integer(-1));
        assert_eq!(with(&tripled, &x0, &x1), with(&plain, &x0, &x1).with_multiple(3));
        let next = EndPhase::next_to(std::f64::consts::FRAC_PI_3).expect("an angle below a turn");
        assert!((next.radians() - std::f64::consts::FRAC_PI_3).abs() < 0.01, "{next}");
        assert_eq!(next.to_string(), "2*atan2(4, 7)");
    }

    #[test]
    fn a_whole_period_ends_where_it_began() {
        let shape = point_to_point(&[1, 2, 3, 4], EndPhase::Pi(integer(2)));
        assert!(matches!(shape.solve(), Err(ConditionError::Impossible { least: None, .. })));
        let still = Shape { conditions: vec![condition(End::Start, 1, Polynomial::zero())], ..shape };
        assert_eq!(still.solve(), Err(ConditionError::NoMotion));
        // Cosines have zero velocity at the start, so no condition prescribes any motion.
        assert_eq!(Shape { sines: [].into(), ..still.clone() }.solve(), Err(ConditionError::NoMotion));
        assert_eq!(Shape { conditions: vec![], ..still }.solve_lowest(), Err(ConditionError::NoMotion));
    }
}
