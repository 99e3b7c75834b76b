//! Signs and absolute values of a motion as exact Fourier series.
//!
//! Under a pattern the argument of sign(u) or |u| is a Fourier polynomial u = m F(theta), m a product of amplitudes. When
//! F changes sign at multiples of a quarter turn of its own fundamental only, its sign is constant on the four quadrants,
//!
//! ```text
//! sign F(theta) = mean + 1/pi sum_n [ alpha_n cos(n phi) + beta_n sin(n phi) ] ,    phi = (common multiple) * theta ,
//! ```
//!
//! with rational mean, alpha_n and beta_n; |u| = u sign(u), and the product with any other Fourier polynomial is a finite
//! convolution. So every harmonic of sign(x') x^p x'^q and the like lies exactly in Q + (1/pi) Q, although there are
//! infinitely many. On a rest-to-rest pattern x' = -lambda w K sin^(2l+1), so sign(x') = -sign(lambda) sign(sin theta).
//!
//! That F changes sign nowhere else is proven, not sampled: with t = tan(phi/2) it is N(t)/(1 + t^2)^n, the roots 0, 1, -1
//! (and the one at infinity) are divided out, and Sturm's theorem counts the real roots that are left.
//!
//! How many harmonics are kept is the caller's choice; what is left out is bounded by a [`Tail`]. Entries hold for
//! positive amplitudes and w and are marked with the amplitudes whose sign flips them.

use crate::algebra::fourier::{Fourier, Trig};
use crate::algebra::polynomial::Monomial;
use crate::expr::graph::{ExprId, Function, Node};
use crate::harmonic::expand::{ExpandError, ExpandOptions};
use crate::harmonic::motion::{MotionError, motion_of, power_of};
use crate::harmonic::table::{Entry, Tail};
use crate::mechanics::model::Model;
use crate::mechanics::pattern::{Motion, Pattern};
use crate::number::rational::{self, Rational};
use crate::regressor::form::{RegressorForm, Row, Term};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, Signed, ToPrimitive, Zero};
use std::collections::BTreeMap;
use thiserror::Error;

/// How many harmonics of an infinite series are kept when nothing else is said.
pub const DEFAULT_HARMONICS: usize = 31;

/// Why a sign or an absolute value has no exact series.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SignError {
    /// The argument consists of parts with different amplitudes.
    #[error(
        "the sign of `{argument}` depends on the ratio of the pattern's amplitudes; give it a motion with one amplitude and no offset"
    )]
    Ratio {
        /// The argument of sign or abs.
        argument: String,
    },
    /// The sign changes elsewhere.
    #[error(
        "`{argument}` changes sign under the pattern at a phase that is no multiple of a quarter period, so its harmonics are no rational multiples of 1/pi; use a rest-to-rest or a symmetric pattern"
    )]
    Phase {
        /// The argument of sign or abs.
        argument: String,
    },
    /// Two signs in one term have different fundamentals.
    #[error(
        "the signs in `{argument}` and another factor of its term change at phases of different multiples of the fundamental, so the harmonics of their product are no rational multiples of 1/pi"
    )]
    Multiples {
        /// The argument of sign or abs.
        argument: String,
    },
    /// The argument, or another factor, is no polynomial of the motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
}

/// The sign of a Fourier polynomial.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QuadrantSign {
    /// The sign on the four quadrants of `multiple * theta`; all equal when there is no change of sign.
    quadrants: [i8; 4],
    /// The common divisor of the harmonics; 1 when the sign is constant.
    multiple: usize,
}

impl QuadrantSign {
    /// The sign of `fourier`, when it changes at quarter turns of its fundamental at most; `None` otherwise. The zero
    /// function has sign 0.
    #[must_use]
    pub fn of(fourier: &Fourier) -> Option<Self> {
        if fourier.is_zero() {
            return Some(Self { quadrants: [0; 4], multiple: 1 });
        }
        let multiple = fourier.terms().fold(0, |divisor, (k, ..)| divisor.gcd(&k)).max(1);
        let top = fourier.highest_harmonic() / multiple;
        let numerator = half_angle_numerator(fourier, multiple, top);
        // A zero of the sine at pi lies at infinity and lowers the degree; it needs no division.
        let mut rest = numerator.clone();
        for root in [0, 1, -1] {
            let root = rational::integer(root);
            while rest.len() > 1 && evaluate(&rest, &root).is_zero() {
                rest = divide_by_root(&rest, &root);
            }
        }
        if real_roots(&rest) > 0 {
            return None;
        }
        let samples = [rational::ratio(1, 2), rational::integer(2), rational::integer(-2), rational::ratio(-1, 2)];
        let quadrants = samples.map(|t| if evaluate(&numerator, &t).is_positive() { 1 } else { -1 });
        let constant = quadrants.iter().all(|&sign| sign == quadrants[0]);
        Some(Self { quadrants, multiple: if constant { 1 } else { multiple } })
    }

    /// The sign on the quadrants 0..pi/2, pi/2..pi, ... of `multiple * theta`.
    #[must_use]
    pub fn quadrants(&self) -> [i8; 4] {
        self.quadrants
    }

    fn is_constant(&self) -> bool {
        self.quadrants.iter().all(|&sign| sign == self.quadrants[0])
    }

    /// The product of two signs, when it is of this form.
    fn times(&self, other: &Self) -> Option<Self> {
        // Both are constant on the quadrants of the least common multiple; the product may be on coarser ones.
        let fine = self.multiple.lcm(&other.multiple);
        if fine > 1 << 16 {
            return None;
        }
        let on = |sign: &Self, piece: usize| sign.quadrants[piece * sign.multiple / fine % 4];
        let pieces: Vec<i8> = (0..4 * fine).map(|piece| on(self, piece) * on(other, piece)).collect();
        (1..=fine).filter(|multiple| fine.is_multiple_of(*multiple)).find_map(|multiple| {
            let quadrants = std::array::from_fn(|quadrant| pieces[quadrant * fine / multiple]);
            let product = Self { quadrants, multiple };
            let same = (0..4 * fine).all(|piece| on(&product, piece) == pieces[piece]);
            same.then_some(product)
        })
    }

    /// The mean, a quarter of a whole number.
    #[must_use]
    pub fn mean(&self) -> Rational {
        rational::ratio(self.quadrants.iter().map(|&sign| i64::from(sign)).sum(), 4)
    }

    /// pi times the series without its mean, up to a harmonic of theta.
    #[must_use]
    pub fn series_times_pi(&self, harmonics: usize) -> Fourier {
        // The integrals of cos(n phi) and sin(n phi) over a quadrant have ends sin(n j pi/2)/n and cos(n j pi/2)/n.
        const SINES: [i64; 4] = [0, 1, 0, -1];
        let sine = |turns: usize| SINES[turns % 4];
        let cosine = |turns: usize| SINES[(turns + 1) % 4];
        let (mut cos, mut sin) = (vec![Rational::zero(); harmonics + 1], vec![Rational::zero(); harmonics]);
        for n in 1..=harmonics / self.multiple {
            let (mut alpha, mut beta) = (0i64, 0i64);
            for (j, &sign) in self.quadrants.iter().enumerate() {
                alpha += i64::from(sign) * (sine(n * (j + 1)) - sine(n * j));
                beta -= i64::from(sign) * (cosine(n * (j + 1)) - cosine(n * j));
            }
            let below = i64::try_from(n).expect("invariant: harmonics fit in i64");
            cos[n * self.multiple] = rational::ratio(alpha, below);
            sin[n * self.multiple - 1] = rational::ratio(beta, below);
        }
        Fourier::from_parts(cos, sin)
    }

    /// The phases in [0, 4) quarter turns of `multiple * theta` at which the sign changes.
    fn flips(&self) -> impl Iterator<Item = usize> + '_ {
        (0..4).filter(|&j| self.quadrants[j] != self.quadrants[(j + 3) % 4])
    }
}

/// N(t) with F = N(t) / (1 + t^2)^top at t = tan(multiple theta / 2), coefficients from t^0 upwards.
fn half_angle_numerator(fourier: &Fourier, multiple: usize, top: usize) -> Vec<Rational> {
    // (1 + j t)^2 / (1 + t^2) = cos phi + j sin phi.
    let product = |a: &[BigInt], b: &[BigInt]| {
        let mut result = vec![BigInt::zero(); a.len() + b.len() - 1];
        for (i, x) in a.iter().enumerate() {
            for (j, y) in b.iter().enumerate() {
                result[i + j] += x * y;
            }
        }
        result
    };
    let length = [1, 0, 1].map(BigInt::from);
    let mut lengths = vec![vec![BigInt::one()]];
    for i in 0..top {
        lengths.push(product(&lengths[i], &length));
    }
    let mut numerator = vec![Rational::zero(); 2 * top + 1];
    for k in 0..=top {
        let cosine = fourier.cos_coefficient(k * multiple);
        let sine = if k == 0 { Rational::zero() } else { fourier.sin_coefficient(k * multiple) };
        if cosine.is_zero() && sine.is_zero() {
            continue;
        }
        // (1 + j t)^(2k): even powers of t are real, odd ones imaginary.
        let (mut real, mut imaginary) = (vec![BigInt::zero(); 2 * k + 1], vec![BigInt::zero(); 2 * k + 1]);
        for i in 0..=2 * k {
            let value = rational::binomial(2 * k as u64, i as u64);
            let value = if i % 4 >= 2 { -value } else { value };
            if i % 2 == 0 { real[i] = value } else { imaginary[i] = value }
        }
        for (part, factor) in [(real, cosine), (imaginary, sine)] {
            for (i, value) in product(&part, &lengths[top - k]).into_iter().enumerate() {
                numerator[i] += Rational::from_integer(value) * &factor;
            }
        }
    }
    trimmed(numerator)
}

fn trimmed(mut polynomial: Vec<Rational>) -> Vec<Rational> {
    while polynomial.last().is_some_and(Zero::is_zero) {
        polynomial.pop();
    }
    polynomial
}

fn evaluate(polynomial: &[Rational], t: &Rational) -> Rational {
    polynomial.iter().rev().fold(Rational::zero(), |value, c| value * t + c)
}

fn divide_by_root(polynomial: &[Rational], root: &Rational) -> Vec<Rational> {
    let mut quotient = vec![Rational::zero(); polynomial.len() - 1];
    let mut carry = Rational::zero();
    for i in (1..polynomial.len()).rev() {
        carry = &polynomial[i] + carry * root;
        quotient[i - 1] = carry.clone();
    }
    quotient
}

/// The number of distinct real roots, by Sturm's theorem on the whole line.
fn real_roots(polynomial: &[Rational]) -> usize {
    let mut chain = vec![polynomial.to_vec()];
    let derivative = polynomial.iter().enumerate().skip(1);
    let mut next: Vec<Rational> = derivative
        .map(|(i, c)| c * rational::integer(i64::try_from(i).expect("invariant: degrees fit in i64")))
        .collect();
    while !next.is_empty() {
        let mut rest = chain[chain.len() - 1].clone();
        let lead = next[next.len() - 1].clone();
        while rest.len() >= next.len() {
            let shift = rest.len() - next.len();
            let factor = &rest[rest.len() - 1] / &lead;
            for (i, c) in next.iter().enumerate() {
                rest[shift + i] -= c * &factor;
            }
            rest.pop();
            rest = trimmed(rest);
        }
        // Only signs matter: a positive factor keeps the numbers small.
        let size = rest.last().map(Signed::abs);
        chain.push(std::mem::take(&mut next));
        if let Some(size) = size {
            next = rest.iter().map(|c| -(c / &size)).collect();
        }
    }
    let changes = |at_minus_infinity: bool| {
        let signs: Vec<bool> = chain
            .iter()
            .filter_map(|p| p.last().map(|lead| lead.is_negative() != (at_minus_infinity && p.len() % 2 == 0)))
            .collect();
        signs.windows(2).filter(|pair| pair[0] != pair[1]).count()
    };
    changes(true) - changes(false)
}

/// Whether an atom of a term is a sign or an absolute value.
fn is_nonsmooth(model: &Model, atom: ExprId) -> bool {
    matches!(model.graph.node(atom), Node::Function(Function::Sign | Function::Abs, _))
}

/// The form's terms without and with signs and absolute values, as two forms of the same columns; `None` when there are
/// none with.
#[must_use]
pub fn split(model: &Model, form: &RegressorForm) -> Option<(RegressorForm, RegressorForm)> {
    let nonsmooth = |term: &Term| term.atoms.factors().any(|(&atom, _)| is_nonsmooth(model, atom));
    if !form.rows.iter().flat_map(|row| &row.terms).any(nonsmooth) {
        return None;
    }
    let part = |keep: bool| RegressorForm {
        columns: form.columns.clone(),
        rows: form
            .rows
            .iter()
            .map(|row| Row {
                name: row.name.clone(),
                terms: row.terms.iter().filter(|term| nonsmooth(term) == keep).cloned().collect(),
                inputs: row.inputs.clone(),
            })
            .collect(),
    };
    Some((part(false), part(true)))
}

/// What the harmonics of one group of terms are called by in the table.
type Group = (usize, Option<usize>, Monomial<usize>, Monomial<usize>);

/// Expands terms with signs and absolute values up to the harmonic of the options, with a bound of what is left out.
///
/// # Errors
/// The term whose sign changes have no exact series under the pattern, and why; or that so many harmonics would take more
/// memory than the options allow.
pub fn expand(
    model: &Model,
    form: &RegressorForm,
    pattern: &Pattern,
    options: &ExpandOptions<'_>,
) -> Result<(Vec<Entry>, Vec<Tail>), ExpandError> {
    let harmonics = options.harmonics.unwrap_or(DEFAULT_HARMONICS);
    refuse_too_large(form, harmonics, options)?;
    let mut entries = Vec::new();
    let mut tails: BTreeMap<Group, Tail> = BTreeMap::new();
    for (equation, row) in form.rows.iter().enumerate() {
        for term in &row.terms {
            let parts =
                term_parts(model, pattern, term).map_err(|source| ExpandError::Sign { term: term.source, source })?;
            for (powers, fourier) in parts.smooth.terms() {
                let powers: Monomial<usize> = powers.factors().map(|(s, e)| (s.0 as usize, e)).collect();
                let mean = fourier.scale(&parts.sign.mean());
                let reach = harmonics + fourier.highest_harmonic();
                let series = truncated(&parts.sign.series_times_pi(reach).mul(fourier), harmonics);
                for (pi, fourier) in [(0, &mean), (-1, &series)] {
                    entries.extend(fourier.terms().map(|(harmonic, function, coefficient)| Entry {
                        equation,
                        harmonic,
                        function,
                        column: term.column,
                        coefficient: coefficient.clone(),
                        pi: pi + parts.pi,
                        powers: powers.clone(),
                        sign: parts.flips.clone(),
                    }));
                }
                if parts.sign.is_constant() {
                    continue;
                }
                let scale = std::f64::consts::PI.powi(parts.pi);
                let rms = root_mean_square(fourier, &mean, &series) * scale;
                let maximum = maximum(fourier, &parts.sign, harmonics).map(|value| value * scale);
                let group = (equation, term.column, powers.clone(), parts.flips.clone());
                match tails.entry(group) {
                    std::collections::btree_map::Entry::Occupied(mut slot) => {
                        let tail = slot.get_mut();
                        tail.rms = (tail.rms + rms).next_up();
                        tail.maximum = tail.maximum.zip(maximum).map(|(a, b)| (a + b).next_up());
                    }
                    std::collections::btree_map::Entry::Vacant(slot) => {
                        let (column, sign) = (term.column, parts.flips.clone());
                        slot.insert(Tail { equation, column, powers, sign, harmonics, rms, maximum });
                    }
                }
            }
        }
    }
    Ok((entries, tails.into_values().collect()))
}

/// Every harmonic of a term takes an entry of its own.
fn refuse_too_large(form: &RegressorForm, harmonics: usize, options: &ExpandOptions<'_>) -> Result<(), ExpandError> {
    let mut terms = form.rows.iter().flat_map(|row| &row.terms);
    let Some(first) = terms.next() else { return Ok(()) };
    let entries = (1 + terms.count() as u128) * harmonics as u128;
    let bytes = entries * std::mem::size_of::<Entry>() as u128;
    let limit = if options.allow_large { ExpandOptions::ADDRESSABLE } else { ExpandOptions::DEFAULT_LIMIT };
    if bytes > limit { Err(ExpandError::TooLarge { term: first.source, entries, bytes, limit }) } else { Ok(()) }
}

/// A term as pi^n * flips * sign(theta) * smooth.
struct Parts {
    smooth: Motion,
    sign: QuadrantSign,
    /// The amplitudes whose sign flips the term.
    flips: Monomial<usize>,
    pi: i32,
}

fn term_parts(model: &Model, pattern: &Pattern, term: &Term) -> Result<Parts, SignError> {
    let mut parts = Parts {
        smooth: Motion::term(Monomial::one(), Fourier::constant(term.coefficient.clone())),
        sign: QuadrantSign { quadrants: [1; 4], multiple: 1 },
        flips: Monomial::one(),
        pi: 0,
    };
    for (&atom, exponent) in term.atoms.factors() {
        match *model.graph.node(atom) {
            Node::Pi => parts.pi += exponent,
            Node::Function(function @ (Function::Sign | Function::Abs), argument) if exponent > 0 => {
                let motion = motion_of(model, pattern, argument)?;
                if function == Function::Abs {
                    parts.smooth = (0..exponent).fold(parts.smooth, |product, _| product.mul(&motion));
                }
                if motion.terms().len() == 0 {
                    // sign(0) = 0
                    parts.smooth = Motion::zero();
                } else if exponent % 2 == 1 {
                    apply_sign(model, pattern, argument, &motion, &mut parts)?;
                }
            }
            _ => {
                let factor = power_of(model, pattern, atom, exponent)?;
                parts.smooth = parts.smooth.mul(&factor);
            }
        }
    }
    Ok(parts)
}

fn apply_sign(
    model: &Model,
    pattern: &Pattern,
    argument: ExprId,
    motion: &Motion,
    parts: &mut Parts,
) -> Result<(), SignError> {
    let argument = || model.display(argument);
    let mut terms = motion.terms();
    let (Some((monomial, fourier)), None) = (terms.next(), terms.next()) else {
        return Err(SignError::Ratio { argument: argument() });
    };
    let sign = QuadrantSign::of(fourier).ok_or_else(|| SignError::Phase { argument: argument() })?;
    parts.sign = parts.sign.times(&sign).ok_or_else(|| SignError::Multiples { argument: argument() })?;
    for (&symbol, exponent) in monomial.factors() {
        // w is positive; two flips cancel.
        if exponent % 2 != 0 && symbol != pattern.frequency {
            let present = parts.flips.exponent(&(symbol.0 as usize));
            let change = if present == 0 { 1 } else { -1 };
            parts.flips = parts.flips.mul(&Monomial::power_of(symbol.0 as usize, change));
        }
    }
    Ok(())
}

fn truncated(fourier: &Fourier, harmonics: usize) -> Fourier {
    let mut result = (vec![Rational::zero(); harmonics + 1], vec![Rational::zero(); harmonics]);
    for (k, function, value) in fourier.terms().filter(|(k, ..)| *k <= harmonics) {
        match function {
            Trig::Cos => result.0[k] = value.clone(),
            Trig::Sin => result.1[k - 1] = value.clone(),
        }
    }
    Fourier::from_parts(result.0, result.1)
}

/// The root mean square of what is left out, by Parseval's identity: the whole has that of the smooth factor, since the
/// square of a sign is 1. Rounded up.
fn root_mean_square(whole: &Fourier, mean: &Fourier, series: &Fourier) -> f64 {
    let inner = |a: &Fourier, b: &Fourier| -> Rational { a.mul(b).cos_coefficient(0) };
    // |mean + series / pi|^2 = A + B / pi + C / pi^2
    let kept = [inner(mean, mean), rational::integer(2) * inner(mean, series), inner(series, series)];
    let inverse = inverse_of_pi();
    let kept = &kept[0] + &kept[1] * &inverse + &kept[2] * &inverse * &inverse;
    let rest = inner(whole, whole) - kept;
    if rest.is_positive() { rational::to_f64(&rest).sqrt().next_up().next_up() } else { 0.0 }
}

/// 1/pi to 80 digits (Abramowitz and Stegun, table 1.1, extended): far below the rounding of the result, also after the
/// cancellation of all digits that a tail of 1e-20 of the whole leaves.
fn inverse_of_pi() -> Rational {
    let digits = "31830988618379067153776752674502872406891929148091289749533468811779359526845307";
    let numerator: BigInt = digits.parse().expect("invariant: digits");
    Rational::new(numerator, BigInt::from(10).pow(80))
}

/// A bound of the largest value of what is left out. When the product is r times continuously differentiable but for
/// jumps of its r-th derivative, its n-th amplitude is at most V / (pi n^(r+1)), V the variation of the r-th derivative
/// over a period; the sum over n > N is at most V / (pi r N^r). `None` for r = 0: a jump never dies away.
fn maximum(fourier: &Fourier, sign: &QuadrantSign, harmonics: usize) -> Option<f64> {
    let multiple = sign.multiple;
    // In phi = multiple theta the values at quarter turns are rational; otherwise smoothness is not claimed.
    if fourier.terms().any(|(k, ..)| k % multiple != 0) || harmonics < multiple {
        return None;
    }
    let top = fourier.highest_harmonic() / multiple;
    let part =
        |f: fn(&Fourier, usize) -> Rational, from: usize| (from..=top).map(|k| f(fourier, k * multiple)).collect();
    let shape = Fourier::from_parts(part(Fourier::cos_coefficient, 0), part(Fourier::sin_coefficient, 1));
    let mut derivative = shape;
    let mut smoothness = 0;
    let jumps = |f: &Fourier| -> Rational { sign.flips().map(|turns| at_quarter_turn(f, turns).abs()).sum() };
    while jumps(&derivative).is_zero() {
        derivative = derivative.derivative(1);
        smoothness += 1;
        if derivative.is_zero() {
            return Some(0.0);
        }
    }
    if smoothness == 0 {
        return None;
    }
    let slope: Rational = derivative.derivative(1).terms().map(|(_, _, value)| value.abs()).sum();
    let variation = 2.0 * rational::to_f64(&jumps(&derivative)) + std::f64::consts::TAU * rational::to_f64(&slope);
    let kept = (harmonics / multiple).to_f64()?;
    let bound = variation / (std::f64::consts::PI * f64::from(smoothness) * kept.powi(smoothness));
    Some(bound * (1.0 + 1e-12))
}

fn at_quarter_turn(fourier: &Fourier, turns: usize) -> Rational {
    fourier
        .terms()
        .map(|(k, function, value)| {
            let quarter = match function {
                Trig::Cos => (k * turns + 1) % 4,
                Trig::Sin => (k * turns) % 4,
            };
            match quarter {
                1 => value.clone(),
                3 => -value,
                _ => Rational::zero(),
            }
        })
        .sum()
}
