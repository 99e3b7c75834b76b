//! The sign of a Fourier polynomial whose sign changes lie only at quarter turns of its fundamental.
//!
//! The sign of F(theta) is then constant on the four quadrants of phi = (common multiple) * theta,
//!
//! ```text
//! sign F(theta) = mean + 1/pi sum_n [ alpha_n cos(n phi) + beta_n sin(n phi) ] ,
//! ```
//!
//! with rational mean, alpha_n and beta_n.
//!
//! That F has no other sign change is proven, not sampled: with t = tan(phi/2) it is N(t)/(1 + t^2)^n, the roots 0, 1,
//! -1 (and the one at infinity) are divided out, and Sturm's theorem counts the remaining real roots.

use crate::algebra::fourier::Fourier;
use crate::number::rational::{self, Rational};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, Signed, Zero};

/// The sign of a Fourier polynomial.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QuadrantSign {
    /// The sign on the four quadrants of `multiple * theta`; all equal when the sign never changes.
    quadrants: [i8; 4],
    /// The common divisor of the harmonics; 1 when the sign is constant.
    multiple: usize,
}

impl QuadrantSign {
    /// The sign of a function that is positive everywhere.
    pub(crate) const POSITIVE: Self = Self { quadrants: [1; 4], multiple: 1 };

    /// The sign of `fourier`, when it changes at quarter turns of its fundamental at most; `None` otherwise. The zero
    /// function has sign 0.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::Fourier, harmonic::nonsmooth::QuadrantSign, number::rational::integer};
    /// assert!(QuadrantSign::of(&Fourier::sin(1, integer(2))).is_some());
    /// let shifted = Fourier::sin(1, integer(2)).add(&Fourier::constant(integer(1)));
    /// assert!(QuadrantSign::of(&shifted).is_none());
    /// ```
    #[must_use]
    pub fn of(fourier: &Fourier) -> Option<Self> {
        if fourier.is_zero() {
            return Some(Self { quadrants: [0; 4], multiple: 1 });
        }
        let multiple = fourier.terms().fold(0, |divisor, (k, ..)| divisor.gcd(&k)).max(1);
        let top = fourier.highest_harmonic() / multiple;
        let numerator = half_angle_numerator(fourier, multiple, top);
        // A zero of the sine at pi is at infinity in t and lowers the degree, so it need not be divided out.
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
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::Fourier, harmonic::nonsmooth::QuadrantSign, number::rational::integer};
    /// let sign = QuadrantSign::of(&Fourier::cos(1, integer(2)));
    /// assert_eq!(sign.map(|sign| sign.quadrants()), Some([1, -1, -1, 1]));
    /// ```
    #[must_use]
    pub fn quadrants(&self) -> [i8; 4] {
        self.quadrants
    }

    /// Whether the sign never changes.
    pub(crate) fn is_constant(&self) -> bool {
        self.quadrants.iter().all(|&sign| sign == self.quadrants[0])
    }

    /// The product of two signs, when it is of this form.
    pub(crate) fn times(&self, other: &Self) -> Option<Self> {
        // Both are constant on the quadrants of the least common multiple; the product may be constant on larger ones.
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

    /// The common divisor of the harmonics of the sign; 1 when the sign is constant.
    pub(crate) fn multiple(&self) -> usize {
        self.multiple
    }

    /// The mean, a quarter of a whole number.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::Fourier, harmonic::nonsmooth::QuadrantSign, number::rational::integer};
    /// let sign = QuadrantSign::of(&Fourier::cos(1, integer(2)));
    /// assert_eq!(sign.map(|sign| sign.mean()), Some(integer(0)));
    /// ```
    #[must_use]
    pub fn mean(&self) -> Rational {
        rational::ratio(self.quadrants.iter().map(|&sign| i64::from(sign)).sum(), 4)
    }

    /// pi times the series without its mean, up to a harmonic of theta.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::Fourier, harmonic::nonsmooth::QuadrantSign, number::rational::integer};
    /// // sign(sin) = 4/pi (sin + 1/3 sin 3 + ...)
    /// let sign = QuadrantSign::of(&Fourier::sin(1, integer(2)));
    /// assert_eq!(sign.map(|sign| sign.series_times_pi(2)), Some(Fourier::sin(1, integer(4))));
    /// ```
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
    pub(crate) fn flips(&self) -> impl Iterator<Item = usize> + '_ {
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
