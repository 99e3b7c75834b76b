//! Fourier polynomials over a common denominator, in the form in which products are computed.
//!
//! With z = e^{j theta} a Fourier polynomial is a Laurent polynomial whose coefficients of z^-k follow from those of z^k,
//!
//! ```text
//! F = [ sum_k C_k z^k + (1/j) sum_k S_k z^k ] / d ,     C_-k = C_k ,  S_-k = -S_k ,
//! c_0 = C_0 / d ,   c_k = 2 C_k / d ,   s_k = 2 S_k / d    (k >= 1),
//! ```
//!
//! so products of the integers C and S are plain convolutions and only k >= 0 is kept.
//!
//! Invariants of [`Spectrum`]: harmonics lie on the lattice first + stride i, with stride 2 as long as all factors have
//! harmonics of one parity. The cosine numerators come before the sine numerators, each list `len` long when present.
//! Every magnitude is below 2^bits, and the width holds it. The caller keeps the denominator in factored form, since it
//! is the product of the factors' denominators.

use crate::algebra::fourier::Fourier;
use crate::budget;
use crate::number::buffers::{Buffered, Rooms};
use crate::number::denominator::{Denominator, Factors};
use crate::number::numerator::Numerator;
use crate::number::rational::Rational;
use crate::number::scalar::Scalar;
use crate::number::values::{Values, for_width};
use num_bigint::{BigInt, BigUint};
use num_integer::Integer;
use num_traits::{CheckedMul, CheckedSub, Signed, Zero};
use smallvec::SmallVec;
use std::slice;

/// A factor of a product, given by its nonzero harmonics.
#[derive(Clone, Debug)]
pub(crate) struct Base {
    /// (harmonic, C, S), increasing harmonics.
    terms: BaseTerms,
    cos: bool,
    sin: bool,
    /// The parity of the harmonics when it is the same for all.
    parity: Option<usize>,
    highest: usize,
    /// An upper bound of the bits of the denominator.
    denominator_bits: u64,
    /// The sum over k = -highest..highest of |C_k| + |S_k| is at most 2^norm_bits.
    norm_bits: u64,
    denominator: Denominator,
}

#[derive(Clone, Debug)]
enum BaseTerms {
    Small(Terms<i64>),
    Big(Vec<(usize, BigInt, BigInt)>),
}

impl Base {
    /// Operations per harmonic of a product with this factor, on numbers of one word, for the budget.
    fn work(&self) -> u64 {
        match &self.terms {
            BaseTerms::Small(terms) => 4 * terms.len() as u64,
            // Products and sums of big integers allocate memory.
            BaseTerms::Big(terms) => (2 * terms.len() as u64).saturating_mul(self.norm_bits / 64 + 40),
        }
    }
}

/// Harmonic, C and S.
type Terms<T> = SmallVec<[(usize, T, T); 4]>;

/// (harmonic, C, S) and their common denominator.
type Parts<T> = (Terms<T>, Denominator);

/// The product a * b, when the product and its negative fit.
fn checked<T: Zero + CheckedMul + CheckedSub>(a: &T, b: &T) -> Option<T> {
    a.checked_mul(b).filter(|product| T::zero().checked_sub(product).is_some())
}

/// (harmonic, c, s) and their common denominator; `None` when they do not fit into T.
fn over_one_denominator<T>(fourier: &Fourier, exact: impl Fn(&BigInt) -> Option<T>) -> Option<(Terms<T>, T)>
where
    T: Numerator + Integer + CheckedMul + CheckedSub + Signed,
{
    // Every coefficient divides the common denominator, whose length grows with their number: the Fourier series of a
    // sign has all primes in it.
    let divide = |denominator: &T| budget::charge(4 + T::bit_length(slice::from_ref(denominator)) / 8);
    let mut denominator = T::one();
    for value in fourier.coefficients() {
        let below = exact(&value.denom())?;
        if denominator.is_one() {
            denominator = below;
        } else if denominator != below {
            divide(&denominator);
            // One division comes first, since the greatest common divisor of a long and a short number takes the square
            // of the longer length.
            let rest = denominator.mod_floor(&below);
            if !Zero::is_zero(&rest) {
                let common = below.gcd(&rest);
                denominator = checked(&denominator, &(below / common))?;
            }
        }
    }
    let over = |value: Option<&Rational>| {
        let Some(value) = value else { return Some(<T as Zero>::zero()) };
        divide(&denominator);
        let (above, below) = (exact(&value.numer())?, exact(&value.denom())?);
        if below == denominator { Some(above) } else { checked(&above, &(denominator.clone() / below)) }
    };
    let mut list = Terms::new();
    for k in 0..=fourier.highest_harmonic() {
        let [c, s] = fourier.pair(k);
        if c.is_some() || s.is_some() {
            list.push((k, over(c)?, over(s)?));
        }
    }
    Some((list, denominator))
}

/// (harmonic, C, S) from (harmonic, c, s), over twice the denominator; `None` when they do not fit into T.
fn halved<T: Clone>(
    mut terms: Terms<T>,
    mut denominator: Denominator,
    twice: impl Fn(&T) -> Option<T>,
) -> Option<Parts<T>> {
    if let Some((0, constant, _)) = terms.first_mut() {
        *constant = twice(constant)?;
    }
    denominator.double();
    Some((terms, denominator))
}

/// (harmonic, C, S) of the n-th phase derivative, from the products of C and S with k^n that `raised` makes; `None` when
/// these do not fit into T.
fn derivative<T: Numerator>(
    list: &[(usize, T, T)],
    order: u32,
    raised: impl Fn(&T, &T, usize) -> Option<(T, T)>,
) -> Option<Terms<T>> {
    let mut terms = Terms::new();
    for (k, c, s) in list {
        if order > 0 && *k == 0 {
            continue;
        }
        let (c, s) = raised(c, s, *k)?;
        // d/dtheta maps (c, s) of harmonic k to (k s, -k c).
        terms.push(match order % 4 {
            0 => (*k, c, s),
            1 => (*k, s, c.negated()),
            2 => (*k, c.negated(), s.negated()),
            _ => (*k, s.negated(), c),
        });
    }
    Some(terms)
}

/// Divides numerators and denominator by their common divisors among the known primes of the denominator.
fn reduce<T: Numerator>(terms: &mut [(usize, T, T)], denominator: &mut Denominator, factors: &Factors) {
    let mut twos = u32::MAX;
    for value in terms.iter().flat_map(|(_, c, s)| [c, s]).filter(|value| !value.is_zero()) {
        twos = twos.min(value.trailing_zeros());
    }
    let shift = denominator.halve(twos);
    for value in terms.iter_mut().flat_map(|(_, c, s)| [c, s]).filter(|_| shift > 0) {
        *value = value.shifted_right(shift);
    }
    factors.reduce(denominator, |prime| {
        let quotient = |value: &T| match value.is_negative() {
            true => value.negated().divided_exactly(prime).map(|quotient| quotient.negated()),
            false => value.divided_exactly(prime),
        };
        let divisible = terms.iter().all(|(_, c, s)| quotient(c).is_some() && quotient(s).is_some());
        if divisible {
            for value in terms.iter_mut().flat_map(|(_, c, s)| [c, s]) {
                *value = quotient(value).expect("invariant: just tried");
            }
        }
        divisible
    });
}

/// The sum over k = -highest..highest of |C_k| + |S_k|, then the bitwise or of all C_k and that of all S_k, each of
/// which is 0 only when all its operands are; `None` when the sum exceeds a word.
fn norm(terms: &[(usize, i64, i64)]) -> Option<(u64, i64, i64)> {
    terms.iter().try_fold((0u64, 0, 0), |(sum, cos, sin), (k, c, s)| {
        let once = c.unsigned_abs().checked_add(s.unsigned_abs())?;
        let norm = sum.checked_add(if *k == 0 { once } else { once.checked_mul(2)? })?;
        Some((norm, cos | c, sin | s))
    })
}

/// A Fourier polynomial whose phase derivatives are factors of products.
pub(crate) struct Whole<'a> {
    fourier: &'a Fourier,
    /// The terms over one denominator, when machine integers hold them.
    small: Option<Parts<i64>>,
}

impl<'a> Whole<'a> {
    pub(crate) fn new(fourier: &'a Fourier, factors: &mut Factors) -> Self {
        let exact = |value: &BigInt| i64::try_from(value).ok().filter(|value| *value > i64::MIN);
        let small = over_one_denominator(fourier, exact).and_then(|(terms, denominator)| {
            halved(terms, factors.factor_word(denominator.unsigned_abs()), |value| checked(value, &2))
        });
        Self { fourier, small }
    }

    pub(crate) fn fourier(&self) -> &'a Fourier {
        self.fourier
    }

    /// The n-th phase derivative as a factor of products of at most `degree` such factors.
    pub(crate) fn base(&self, order: u32, degree: u64, factors: &mut Factors) -> Base {
        let small = |c: &i64, s: &i64, k: usize| {
            let factor = if order == 0 { 1 } else { i64::try_from(k).ok()?.checked_pow(order)? };
            Some((checked(c, &factor)?, checked(s, &factor)?))
        };
        let norm_bits = |norm: u64| u64::from(64 - norm.saturating_sub(1).leading_zeros());
        if let Some((list, denominator)) = &self.small
            && let Some(mut terms) = derivative(list, order, small)
            && let Some((mut norm_of_all, cos, sin)) = norm(&terms)
        {
            let mut denominator = denominator.clone();
            let mut denominator_bits = factors.bits(&denominator);
            // As long as every product fits into a word, common factors need not be removed.
            if degree.saturating_mul(norm_bits(norm_of_all) + denominator_bits) > 62 {
                reduce(&mut terms, &mut denominator, factors);
                denominator_bits = factors.bits(&denominator);
                norm_of_all = norm(&terms).map_or(norm_of_all, |(norm, ..)| norm);
            }
            return Base {
                cos: cos != 0,
                sin: sin != 0,
                parity: common_parity(&terms),
                highest: terms.last().map_or(0, |term| term.0),
                denominator_bits,
                norm_bits: norm_bits(norm_of_all),
                denominator,
                terms: BaseTerms::Small(terms),
            };
        }
        let big = |c: &BigInt, s: &BigInt, k: usize| {
            let factor = BigInt::from(k).pow(order);
            Some((c * &factor, s * factor))
        };
        let parts = over_one_denominator(self.fourier, |value| Some(value.clone())).and_then(|(terms, denominator)| {
            let (terms, denominator) = halved(terms, factors.factor(denominator.magnitude()), |value| Some(value * 2))?;
            Some((derivative(&terms, order, big)?, denominator))
        });
        let (mut terms, mut denominator) = parts.expect("invariant: unlimited integers do not overflow");
        reduce(&mut terms, &mut denominator, factors);
        let norm: BigUint =
            terms.iter().map(|(k, c, s)| (c.magnitude() + s.magnitude()) * if *k == 0 { 1u32 } else { 2u32 }).sum();
        Base {
            cos: terms.iter().any(|term| !Zero::is_zero(&term.1)),
            sin: terms.iter().any(|term| !Zero::is_zero(&term.2)),
            parity: common_parity(&terms),
            highest: terms.last().map_or(0, |term| term.0),
            denominator_bits: factors.bits(&denominator),
            norm_bits: norm.bits(),
            denominator,
            terms: BaseTerms::Big(terms.into_vec()),
        }
    }
}

impl Base {
    pub(crate) fn highest_harmonic(&self) -> usize {
        self.highest
    }

    pub(crate) fn norm_bits(&self) -> u64 {
        self.norm_bits
    }

    pub(crate) fn denominator_bits(&self) -> u64 {
        self.denominator_bits
    }

    pub(crate) fn denominator(&self) -> &Denominator {
        &self.denominator
    }

    pub(crate) fn parity(&self) -> Option<usize> {
        self.parity
    }

    /// Whether there are cosines, and whether there are sines.
    pub(crate) fn functions(&self) -> (bool, bool) {
        (self.cos, self.sin)
    }
}

fn common_parity<T>(terms: &[(usize, T, T)]) -> Option<usize> {
    let first = terms.first()?.0 % 2;
    terms.iter().all(|term| term.0 % 2 == first).then_some(first)
}

/// A product of bases.
#[derive(Clone, Debug)]
pub(crate) struct Spectrum {
    first: usize,
    stride: usize,
    len: usize,
    cos: bool,
    sin: bool,
    bits: u64,
    values: Values,
    /// Whether this is the empty product.
    empty: bool,
}

impl Spectrum {
    /// The constant 1.
    pub(crate) fn one() -> Self {
        Self { values: Values::One(vec![1]), ..Self::factor_one() }
    }

    /// The constant 1 without a stored value. [`Self::multiply`] does not read the value.
    pub(crate) fn factor_one() -> Self {
        let values = Values::One(Vec::new());
        Self { first: 0, stride: 2, len: 1, cos: true, sin: false, bits: 1, values, empty: true }
    }

    /// A base as a product.
    fn of(base: &Base, rooms: &mut Rooms) -> Self {
        fn fill<T: Numerator, F>(
            out: &mut Vec<T>,
            shape: Shape,
            shift: usize,
            terms: &[(usize, F, F)],
            make: impl Fn(&F) -> T,
        ) {
            out.resize(shape.size(), T::zero());
            for (k, c, s) in terms {
                let index = (k - shape.first) >> shift;
                if shape.cos {
                    out[index] = make(c);
                }
                if shape.sin {
                    out[index + if shape.cos { shape.len } else { 0 }] = make(s);
                }
            }
        }
        let (first, stride) = base.parity.map_or((0, 1), |parity| (parity, 2));
        let len = ((base.highest - first) >> (stride - 1)) + 1;
        let shape = Shape { first, len, cos: base.cos, sin: base.sin };
        let values = match &base.terms {
            BaseTerms::Small(terms) => {
                let mut list = i64::room(rooms).take(shape.size());
                fill(&mut list, shape, stride - 1, terms, |value| *value);
                Values::One(list)
            }
            BaseTerms::Big(terms) => {
                let mut list = BigInt::room(rooms).take(shape.size());
                fill(&mut list, shape, stride - 1, terms, Clone::clone);
                Values::Big(list)
            }
        };
        let bits = for_width!(&values, list => Numerator::bit_length(list));
        Self { first, stride, len, cos: base.cos, sin: base.sin, bits, values, empty: false }
    }

    /// The buffer, for reuse.
    pub(crate) fn into_values(self) -> Values {
        self.values
    }

    /// The constant 0.
    pub(crate) fn zero() -> Self {
        let values = Values::One(Vec::new());
        Self { first: 0, stride: 2, len: 0, cos: false, sin: false, bits: 0, values, empty: false }
    }

    /// The constant 0 on the lattice of `like`.
    fn zero_like(like: &Self) -> Self {
        Self { len: 0, cos: false, sin: false, bits: 0, values: Values::One(Vec::new()), empty: false, ..*like }
    }

    pub(crate) fn first(&self) -> usize {
        self.first
    }

    pub(crate) fn stride(&self) -> usize {
        self.stride
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    pub(crate) fn has_cos(&self) -> bool {
        self.cos
    }

    pub(crate) fn has_sin(&self) -> bool {
        self.sin
    }

    pub(crate) fn bits(&self) -> u64 {
        self.bits
    }

    pub(crate) fn values(&self) -> &Values {
        &self.values
    }

    /// This function on the lattice of all harmonics, with zeros in between.
    fn spread(&self, rooms: &mut Rooms) -> Self {
        fn place<T: Buffered>(from: &[T], first: usize, len: usize, rooms: &mut Rooms) -> Vec<T> {
            let spread = first + 2 * len - 1;
            let size = from.len() / len * spread;
            let mut list = T::room(rooms).take(size);
            list.resize(size, T::zero());
            for (part, slots) in from.chunks(len).zip(list.chunks_mut(spread)) {
                for (i, value) in part.iter().enumerate() {
                    slots[first + 2 * i] = value.clone();
                }
            }
            list
        }
        if self.stride == 1 || self.len == 0 {
            return Self { first: 0, stride: 1, empty: false, ..self.clone() };
        }
        let values = for_width!(&self.values, list => wrap place(list, self.first, self.len, rooms));
        Self { first: 0, stride: 1, len: self.first + 2 * self.len - 1, values, empty: false, ..*self }
    }

    /// The product with a base; the caller multiplies the denominators.
    pub(crate) fn multiply(&self, base: &Base, rooms: &mut Rooms) -> Self {
        if self.empty {
            return Self::of(base, rooms);
        }
        if (self.stride == 2 && base.parity.is_none()) || self.len == 0 {
            let spread = self.spread(rooms);
            return if self.len == 0 { spread } else { spread.multiply(base, rooms) };
        }
        // |product| <= max |self| * (sum of |base|), and so is every partial sum.
        let bound = self.bits + base.norm_bits;
        let first = if self.stride == 2 { (self.first + base.parity.unwrap_or(0)) % 2 } else { 0 };
        let highest = self.first + self.stride * (self.len - 1) + base.highest;
        let len = ((highest - first) >> (self.stride - 1)) + 1;
        let (cos, sin) = (self.cos && base.cos || self.sin && base.sin, self.cos && base.sin || self.sin && base.cos);
        let needed = if matches!(base.terms, BaseTerms::Big(_)) { u64::MAX } else { bound };
        let wide;
        let values = if self.values.capacity() < needed {
            wide = self.values.widened(needed);
            &wide
        } else {
            &self.values
        };
        let shape = Shape { first, len, cos, sin };
        budget::charge(base.work().saturating_mul(shape.size() as u64).saturating_mul(bound / 64 + 1));
        let values = match &base.terms {
            BaseTerms::Small(terms) => {
                let reach = base.highest;
                for_width!(values, list => wrap self.convolve(list, terms, reach, shape, rooms, |v, f: &i64| v.times(*f)))
            }
            BaseTerms::Big(terms) => {
                let list = values.to_big();
                Values::Big(self.convolve(&list, terms, base.highest, shape, rooms, |v, f: &BigInt| v * f))
            }
        };
        let bits = for_width!(&values, list => Numerator::bit_length(list));
        Self { first, stride: self.stride, len, cos, sin, bits, values, empty: false }
    }

    fn convolve<T: Buffered, F: Signed + Clone>(
        &self,
        values: &[T],
        terms: &[(usize, F, F)],
        reach: usize,
        shape: Shape,
        rooms: &mut Rooms,
        times: impl Fn(&T, &F) -> T,
    ) -> Vec<T> {
        // The stride is 1 or 2, so shifts replace divisions, which would cost as much as the products.
        let (stride, shift) = (self.stride, self.stride - 1);
        let below = (reach + self.first) >> shift; // lattice points from -reach up to first - stride
        let padded_len = below + shape.len + ((shape.first + reach) >> shift) + 1;
        let room = T::room(rooms);
        let mut out = room.take(shape.size());
        out.resize(shape.size(), T::zero());
        let padded = &mut room.padded;
        if padded.capacity() == 0 {
            *padded = Vec::with_capacity(padded_len.max(below + self.len));
        }
        let mut part = values;
        for odd in [false, true] {
            if !(if odd { self.sin } else { self.cos }) {
                continue;
            }
            let (list, rest) = part.split_at(self.len);
            part = rest;
            // The list extended to both sides: mirrored below harmonic 0, zero above the highest harmonic.
            padded.clear();
            for i in (1..=below).rev() {
                // harmonic first - stride i, mirrored: stride i - first
                let mirrored = (stride * i - self.first - self.first) >> shift;
                let value = list.get(mirrored).cloned().unwrap_or_else(T::zero);
                padded.push(if odd { value.negated() } else { value });
            }
            padded.extend_from_slice(list);
            padded.resize(padded_len.max(padded.len()), T::zero());
            // Index of harmonic h (on the list's lattice, h >= first - stride below).
            let index = |h: isize| -> usize {
                usize::try_from(((h - self.first as isize) >> shift) + below as isize)
                    .expect("invariant: the list was continued far enough")
            };
            for (k, c, s) in terms {
                for (factor, base_odd) in [(c, false), (s, true)] {
                    if factor.is_zero() {
                        continue;
                    }
                    let into_sin = odd != base_odd;
                    let offset = if into_sin && shape.cos { shape.len } else { 0 };
                    let target = &mut out[offset..offset + shape.len];
                    let start = shape.first as isize;
                    let lower = &padded[index(start - *k as isize)..][..shape.len];
                    // (1/j)^2 = -1
                    let negative = odd && base_odd;
                    let negated = -factor.clone();
                    let factor = if negative { &negated } else { factor };
                    if *k == 0 {
                        accumulate(target, lower.iter().cloned(), factor, &times);
                        continue;
                    }
                    let upper = &padded[index(start + *k as isize)..][..shape.len];
                    let pairs = lower.iter().zip(upper);
                    if base_odd {
                        accumulate(target, pairs.map(|(a, b)| a.minus(b)), factor, &times);
                    } else {
                        accumulate(target, pairs.map(|(a, b)| a.plus(b)), factor, &times);
                    }
                }
            }
        }
        out
    }

    /// self += factor * other, over the same denominator.
    pub(crate) fn add_scaled(&mut self, other: &Self, factor: &Scalar, rooms: &mut Rooms) {
        if other.len == 0 || factor.is_zero() {
            return;
        }
        // An empty sum takes the scaled list.
        if self.len == 0 {
            let bits = other.bits + factor.bits();
            if let Scalar::Small(factor) = factor
                && bits <= other.values.capacity()
            {
                let values = for_width!(&other.values, list => wrap scaled(list, *factor, rooms));
                *self = Self { values, bits, empty: false, ..*other };
                return;
            }
            *self = Self::zero_like(other);
        }
        // Different lattices of harmonics are both extended to that of all harmonics.
        if self.len > 0 && (self.stride, self.first) != (other.stride, other.first) {
            let both = (self.spread(rooms), other.spread(rooms));
            rooms.recycle(std::mem::replace(self, both.0).into_values());
            self.add_scaled(&both.1, factor, rooms);
            return rooms.recycle(both.1.into_values());
        }
        // Extend this list to the cosines, sines and harmonics of both.
        let scaled_bits = other.bits + factor.bits();
        let bound = self.bits.max(scaled_bits) + 1;
        let (cos, sin, len) = (self.cos || other.cos, self.sin || other.sin, self.len.max(other.len));
        if (cos, sin, len) != (self.cos, self.sin, self.len) {
            let values = for_width!(&self.values, list => wrap self.arranged(list, cos, sin, len, rooms));
            let arranged = Self { cos, sin, len, values, ..*self };
            rooms.recycle(std::mem::replace(self, arranged).into_values());
        }
        // A factor beyond one word requires big integers.
        if let Scalar::Big(factor) = factor {
            self.values.hold(u64::MAX);
            if let Values::Big(into) = &mut self.values {
                let from = other.values.to_big();
                add_list(into, &from, len, cos, other, factor.as_ref(), |value, factor| value * factor);
            }
            self.bits = bound;
            return;
        }
        let Scalar::Small(factor) = factor else { return };
        // Bring both lists to the width of the sum, and add.
        self.values.hold(bound);
        let wide;
        let same = std::mem::discriminant(&self.values) == std::mem::discriminant(&other.values);
        let values = if same {
            &other.values
        } else {
            wide = other.values.widened(self.values.capacity());
            &wide
        };
        match (&mut self.values, values) {
            (Values::One(into), Values::One(from)) => {
                add_list(into, from, len, cos, other, factor, |value, factor| value.times(*factor))
            }
            (Values::Two(into), Values::Two(from)) => {
                add_list(into, from, len, cos, other, factor, |value, factor| value.times(*factor))
            }
            (Values::Three(into), Values::Three(from)) => {
                add_list(into, from, len, cos, other, factor, |value, factor| value.times(*factor))
            }
            (Values::Four(into), Values::Four(from)) => {
                add_list(into, from, len, cos, other, factor, |value, factor| value.times(*factor))
            }
            (Values::Six(into), Values::Six(from)) => {
                add_list(into, from, len, cos, other, factor, |value, factor| value.times(*factor))
            }
            (Values::Eight(into), Values::Eight(from)) => {
                add_list(into, from, len, cos, other, factor, |value, factor| value.times(*factor))
            }
            (Values::Big(into), Values::Big(from)) => {
                add_list(into, from, len, cos, other, factor, |value, factor| value.times(*factor))
            }
            _ => unreachable!("invariant: both lists were brought to one width"),
        }
        self.bits = bound;
    }

    fn arranged<T: Buffered>(&self, list: &[T], cos: bool, sin: bool, len: usize, rooms: &mut Rooms) -> Vec<T> {
        let size = len * (usize::from(cos) + usize::from(sin));
        let mut out = T::room(rooms).take(size);
        out.resize(size, T::zero());
        let (old_cos, old_sin) = list.split_at(if self.cos { self.len } else { 0 });
        for (value, slot) in old_cos.iter().zip(&mut out) {
            *slot = value.clone();
        }
        let start = if cos { len } else { 0 };
        for (value, slot) in old_sin.iter().zip(out.iter_mut().skip(start)) {
            *slot = value.clone();
        }
        out
    }

    /// The Fourier polynomial with these numerators over the given denominator.
    pub(crate) fn to_fourier(&self, denominator: &BigInt) -> Fourier {
        let values = self.values.to_big();
        let mut lists = [Vec::new(), Vec::new()];
        let mut rest = values.as_slice();
        for (list, present) in lists.iter_mut().zip([self.cos, self.sin]) {
            if present {
                let (part, behind) = rest.split_at(self.len);
                rest = behind;
                *list = vec![Rational::zero(); self.first + self.stride * self.len];
                for (i, value) in part.iter().enumerate() {
                    let k = self.first + self.stride * i;
                    let value = if k == 0 { value.clone() } else { value * 2 };
                    list[k] = Rational::new(value, denominator.clone());
                }
            }
        }
        let [cos, mut sin] = lists;
        if !sin.is_empty() {
            sin.remove(0);
        }
        Fourier::from_parts(cos, sin)
    }
}

/// A list times a factor.
fn scaled<T: Buffered>(list: &[T], factor: i64, rooms: &mut Rooms) -> Vec<T> {
    let mut out = T::room(rooms).take(list.len());
    out.extend(list.iter().map(|value| value.times(factor)));
    out
}

/// Lattice and parts of a product.
#[derive(Clone, Copy)]
struct Shape {
    first: usize,
    len: usize,
    cos: bool,
    sin: bool,
}

impl Shape {
    /// The number of numerators in both parts together.
    fn size(self) -> usize {
        self.len * (usize::from(self.cos) + usize::from(self.sin))
    }
}

/// target += factor * source. Factors of +-1 are frequent in patterns and need no multiplication.
fn accumulate<T: Numerator, F: Signed + Clone>(
    target: &mut [T],
    source: impl Iterator<Item = T>,
    factor: &F,
    times: impl Fn(&T, &F) -> T,
) {
    if factor.is_one() {
        target.iter_mut().zip(source).for_each(|(slot, value)| *slot = slot.plus(&value));
    } else if (-factor.clone()).is_one() {
        target.iter_mut().zip(source).for_each(|(slot, value)| *slot = slot.minus(&value));
    } else {
        target.iter_mut().zip(source).for_each(|(slot, value)| *slot = slot.plus(&times(&value, factor)));
    }
}

/// Adds factor * from, in the layout of `other`, to lists of length `len`, cosines first when `cos` is set.
fn add_list<T: Numerator, F: Signed + Clone>(
    into: &mut [T],
    from: &[T],
    len: usize,
    cos: bool,
    other: &Spectrum,
    factor: &F,
    times: impl Fn(&T, &F) -> T,
) {
    let (from_cos, from_sin) = from.split_at(if other.cos { other.len } else { 0 });
    for (from, start) in [(from_cos, 0), (from_sin, if cos { len } else { 0 })] {
        if !from.is_empty() {
            accumulate(&mut into[start..start + from.len()], from.iter().cloned(), factor, &times);
        }
    }
}
