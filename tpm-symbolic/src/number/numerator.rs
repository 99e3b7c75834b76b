//! Integers of fixed width for numerators, and the unlimited one that takes over beyond them.
//!
//! Invariant: an operation is only called where a bound, established beforehand by its caller, says that the result
//! needs at most [`Numerator::BITS`] bits; the fixed widths therefore never wrap. The one-word and two-word types are
//! the machine's own, checked in builds with debug assertions.

use num_bigint::{BigInt, BigUint, Sign};
use num_traits::{Signed, Zero};
use smallvec::SmallVec;
use std::any::Any;
use std::ops::{Add, Sub};

/// An odd prime with what is needed to divide by it without a division.
#[derive(Clone, Debug)]
pub(crate) struct OddPrime {
    /// The prime.
    pub(crate) value: u64,
    /// 1/value modulo 2^64.
    inverse: u64,
    /// 1/value modulo 2^128.
    inverse_wide: u128,
    /// The largest quotients there are in one and in two words.
    largest: u64,
    largest_wide: u128,
    /// The binary logarithm in units of 2^-20, rounded up.
    pub(crate) log2: u64,
    /// value^0, value^1, ... as far as one word holds them, `count` of them.
    powers: [u64; 41],
    count: usize,
}

impl OddPrime {
    /// The primes of nearly all denominators, made by the compiler.
    pub(crate) const SMALL: [Self; 9] = [
        Self::with_logarithm(3, 1.584962500721156),
        Self::with_logarithm(5, 2.321928094887362),
        Self::with_logarithm(7, 2.807354922057604),
        Self::with_logarithm(11, 3.4594316186372973),
        Self::with_logarithm(13, 3.700439718141092),
        Self::with_logarithm(17, 4.087462841250339),
        Self::with_logarithm(19, 4.247927513443585),
        Self::with_logarithm(23, 4.523561956057013),
        Self::with_logarithm(29, 4.857980995127572),
    ];

    pub(crate) fn new(value: u64) -> Self {
        Self::with_logarithm(value, (value as f64).log2())
    }

    const fn with_logarithm(value: u64, log2: f64) -> Self {
        debug_assert!(value % 2 == 1 && value > 1, "invariant: an odd prime");
        // Newton's iteration doubles the number of correct low bits; an odd number is its own inverse modulo 8.
        let wide = value as u128;
        let mut inverse_wide = wide;
        let mut i = 0;
        while i < 6 {
            inverse_wide = inverse_wide.wrapping_mul(2u128.wrapping_sub(wide.wrapping_mul(inverse_wide)));
            i += 1;
        }
        let mut powers = [1u64; 41];
        let mut count = 1;
        while count < 41
            && let Some(power) = powers[count - 1].checked_mul(value)
        {
            powers[count] = power;
            count += 1;
        }
        let (largest, largest_wide) = (u64::MAX / value, u128::MAX / wide);
        // One unit more than the rounding of the logarithm could take away.
        let log2 = (log2 * (1 << 20) as f64) as u64 + 1;
        Self { value, inverse: inverse_wide as u64, inverse_wide, largest, largest_wide, log2, powers, count }
    }

    /// A multiple of the prime, divided by it.
    #[inline]
    pub(crate) fn divide_multiple(&self, multiple: u128) -> u128 {
        multiple.wrapping_mul(self.inverse_wide)
    }

    /// The quotient when a word is divisible.
    #[inline]
    pub(crate) fn divide_exactly(&self, word: u64) -> Option<u64> {
        // n is divisible exactly when n/p modulo 2^64 is not above the largest quotient there is.
        let quotient = word.wrapping_mul(self.inverse);
        (quotient <= self.largest).then_some(quotient)
    }

    /// The same for one word that is known to be a multiple.
    #[inline]
    pub(crate) fn divide_word(&self, multiple: u64) -> u64 {
        multiple.wrapping_mul(self.inverse)
    }

    /// value^exponent as a product of one-word factors.
    pub(crate) fn power_factors(&self, exponent: u32) -> impl Iterator<Item = u64> + '_ {
        let most = self.count - 1;
        let mut rest = exponent as usize;
        std::iter::from_fn(move || {
            if rest == 0 {
                return None;
            }
            let part = rest.min(most);
            rest -= part;
            Some(self.powers[part])
        })
    }
}

/// An integer of some width.
pub(crate) trait Numerator: Clone {
    /// Values of magnitude below 2^BITS are represented.
    const BITS: u64;
    fn zero() -> Self;
    fn is_zero(&self) -> bool;
    fn is_negative(&self) -> bool;
    /// From little-endian words in two's complement, as many as there are.
    fn from_words(words: &[u64]) -> Self;
    /// Fills `out` with the low words of the two's complement.
    fn write_words(&self, out: &mut [u64]);
    fn plus(&self, other: &Self) -> Self;
    fn minus(&self, other: &Self) -> Self;
    fn times(&self, factor: i64) -> Self;
    fn negated(&self) -> Self;
    /// The bit length of the largest magnitude.
    fn bit_length(values: &[Self]) -> u64;
    /// Number of trailing zero bits; the value is not zero.
    fn trailing_zeros(&self) -> u32;
    /// Divided by 2^count, which divides it.
    fn shifted_right(&self, count: u32) -> Self;
    /// The quotient when the non-negative `self` is divisible.
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self>;
    /// As a machine word, for the width that is one.
    fn as_word(&self) -> Option<i64>;
    /// As an unlimited integer.
    fn to_big(&self) -> BigInt;
    /// The buffers of this width.
    fn room(rooms: &mut Rooms) -> &mut Room<Self>;
}

/// Buffers of one width, kept between products.
#[derive(Debug)]
pub(crate) struct Room<T> {
    spare: SmallVec<[Vec<T>; 2]>,
    /// For a list continued to both sides.
    pub(crate) padded: Vec<T>,
}

impl<T> Default for Room<T> {
    fn default() -> Self {
        Self { spare: SmallVec::new(), padded: Vec::new() }
    }
}

impl<T> Room<T> {
    /// An empty list with room for `len`.
    pub(crate) fn take(&mut self, len: usize) -> Vec<T> {
        // Products grow: a little more than now needed saves asking again.
        let Some(mut list) = self.spare.pop() else { return Vec::with_capacity(len.max(16)) };
        list.clear();
        list
    }
}

/// Buffers of every width: small products cost less than asking for their memory.
#[derive(Debug, Default)]
pub(crate) struct Rooms {
    one: Room<i64>,
    two: Room<i128>,
    /// Most tables never need them.
    wide: Option<Box<WideRooms>>,
}

#[derive(Debug, Default)]
struct WideRooms {
    three: Room<Wide<3>>,
    four: Room<Wide<4>>,
    six: Room<Wide<6>>,
    eight: Room<Wide<8>>,
    big: Room<BigInt>,
}

impl Rooms {
    /// Takes back what is not needed any more.
    pub(crate) fn recycle(&mut self, values: Values) {
        fn give<T: Numerator>(rooms: &mut Rooms, list: Vec<T>) {
            if list.capacity() > 0 {
                T::room(rooms).spare.push(list);
            }
        }
        for_width!(values, list => give(self, list));
    }
}

impl Numerator for i64 {
    const BITS: u64 = 63;

    fn zero() -> Self {
        0
    }

    #[inline]
    fn is_zero(&self) -> bool {
        *self == 0
    }

    #[inline]
    fn is_negative(&self) -> bool {
        *self < 0
    }

    fn from_words(words: &[u64]) -> Self {
        words.first().map_or(0, |&word| word as i64)
    }

    #[inline]
    fn write_words(&self, out: &mut [u64]) {
        for (i, slot) in out.iter_mut().enumerate() {
            *slot = if i == 0 { *self as u64 } else { (*self >> 63) as u64 };
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        self + other
    }

    #[inline]
    fn minus(&self, other: &Self) -> Self {
        self - other
    }

    #[inline]
    fn times(&self, factor: i64) -> Self {
        self * factor
    }

    #[inline]
    fn negated(&self) -> Self {
        -self
    }

    fn bit_length(values: &[Self]) -> u64 {
        let mask = values.iter().fold(0u64, |mask, value| mask | value.unsigned_abs());
        u64::from(64 - mask.leading_zeros())
    }

    #[inline]
    fn trailing_zeros(&self) -> u32 {
        Self::trailing_zeros(*self)
    }

    #[inline]
    fn shifted_right(&self, count: u32) -> Self {
        self >> count
    }

    #[inline]
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self> {
        prime.divide_exactly(*self as u64).map(|quotient| quotient as i64)
    }

    #[inline]
    fn as_word(&self) -> Option<i64> {
        Some(*self)
    }

    fn to_big(&self) -> BigInt {
        BigInt::from(*self)
    }

    fn room(rooms: &mut Rooms) -> &mut Room<Self> {
        &mut rooms.one
    }
}

impl Numerator for i128 {
    const BITS: u64 = 127;

    fn zero() -> Self {
        0
    }

    #[inline]
    fn is_zero(&self) -> bool {
        *self == 0
    }

    #[inline]
    fn is_negative(&self) -> bool {
        *self < 0
    }

    fn from_words(words: &[u64]) -> Self {
        match words {
            [] => 0,
            [low] => Self::from(*low as i64),
            [low, high, ..] => (u128::from(*low) | u128::from(*high) << 64) as Self,
        }
    }

    #[inline]
    fn write_words(&self, out: &mut [u64]) {
        for (i, slot) in out.iter_mut().enumerate() {
            *slot = match i {
                0 => *self as u64,
                1 => (*self >> 64) as u64,
                _ => (*self >> 127) as u64,
            };
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        self + other
    }

    #[inline]
    fn minus(&self, other: &Self) -> Self {
        self - other
    }

    #[inline]
    fn times(&self, factor: i64) -> Self {
        // The debug build checks; the product modulo 2^128 takes three word multiplications.
        debug_assert!(self.checked_mul(Self::from(factor)).is_some(), "invariant: the bound keeps products in range");
        self.wrapping_mul(Self::from(factor))
    }

    #[inline]
    fn negated(&self) -> Self {
        -self
    }

    fn bit_length(values: &[Self]) -> u64 {
        let mask = values.iter().fold(0u128, |mask, value| mask | value.unsigned_abs());
        u64::from(128 - mask.leading_zeros())
    }

    #[inline]
    fn trailing_zeros(&self) -> u32 {
        Self::trailing_zeros(*self)
    }

    #[inline]
    fn shifted_right(&self, count: u32) -> Self {
        self >> count
    }

    #[inline]
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self> {
        let quotient = (*self as u128).wrapping_mul(prime.inverse_wide);
        (quotient <= prime.largest_wide).then_some(quotient as Self)
    }

    #[inline]
    fn as_word(&self) -> Option<i64> {
        None
    }

    fn to_big(&self) -> BigInt {
        BigInt::from(*self)
    }

    fn room(rooms: &mut Rooms) -> &mut Room<Self> {
        &mut rooms.two
    }
}

/// N little-endian words in two's complement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wide<const N: usize>([u64; N]);

impl<const N: usize> Wide<N> {
    fn fill(negative: bool) -> u64 {
        if negative { u64::MAX } else { 0 }
    }

    fn magnitude(&self) -> Self {
        if self.is_negative() { self.negated() } else { *self }
    }
}

impl<const N: usize> Numerator for Wide<N> {
    const BITS: u64 = 64 * N as u64 - 1;

    fn zero() -> Self {
        Self([0; N])
    }

    #[inline]
    fn is_zero(&self) -> bool {
        self.0.iter().all(|&word| word == 0)
    }

    #[inline]
    fn is_negative(&self) -> bool {
        self.0[N - 1] >> 63 == 1
    }

    fn from_words(words: &[u64]) -> Self {
        let fill = Self::fill(words.last().is_some_and(|word| word >> 63 == 1));
        Self(std::array::from_fn(|i| words.get(i).copied().unwrap_or(fill)))
    }

    #[inline]
    fn write_words(&self, out: &mut [u64]) {
        let fill = Self::fill(self.is_negative());
        for (i, slot) in out.iter_mut().enumerate() {
            *slot = self.0.get(i).copied().unwrap_or(fill);
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        let mut carry = false;
        Self(std::array::from_fn(|i| {
            let (sum, first) = self.0[i].overflowing_add(other.0[i]);
            let (sum, second) = sum.overflowing_add(u64::from(carry));
            carry = first | second;
            sum
        }))
    }

    #[inline]
    fn minus(&self, other: &Self) -> Self {
        let mut borrow = false;
        Self(std::array::from_fn(|i| {
            let (difference, first) = self.0[i].overflowing_sub(other.0[i]);
            let (difference, second) = difference.overflowing_sub(u64::from(borrow));
            borrow = first | second;
            difference
        }))
    }

    #[inline]
    fn times(&self, factor: i64) -> Self {
        let by = u128::from(factor.unsigned_abs());
        let mut carry = 0u128;
        // Modulo 2^(64 N) a two's complement times a non-negative word is the plain product.
        let product = Self(std::array::from_fn(|i| {
            let sum = u128::from(self.0[i]) * by + carry;
            carry = sum >> 64;
            sum as u64
        }));
        if factor < 0 { product.negated() } else { product }
    }

    #[inline]
    fn negated(&self) -> Self {
        Self::zero().minus(self)
    }

    fn bit_length(values: &[Self]) -> u64 {
        let mut mask = [0u64; N];
        for value in values {
            for (mask, word) in mask.iter_mut().zip(value.magnitude().0) {
                *mask |= word;
            }
        }
        let top = mask.iter().rposition(|&word| word != 0);
        top.map_or(0, |i| 64 * (i as u64 + 1) - u64::from(mask[i].leading_zeros()))
    }

    #[inline]
    fn trailing_zeros(&self) -> u32 {
        let mut count = 0;
        for word in self.0 {
            if word != 0 {
                return count + word.trailing_zeros();
            }
            count += 64;
        }
        count
    }

    #[inline]
    fn shifted_right(&self, count: u32) -> Self {
        let (words, bits) = ((count / 64) as usize, count % 64);
        let fill = Self::fill(self.is_negative());
        let word = |i: usize| self.0.get(i).copied().unwrap_or(fill);
        Self(std::array::from_fn(|i| match bits {
            0 => word(i + words),
            _ => word(i + words) >> bits | word(i + words + 1) << (64 - bits),
        }))
    }

    #[inline]
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self> {
        // Hensel division from the low end: what remains to be borrowed at the top is zero exactly when p divides.
        let mut borrow = 0u64;
        let quotient = Self(std::array::from_fn(|i| {
            let (word, under) = self.0[i].overflowing_sub(borrow);
            let digit = word.wrapping_mul(prime.inverse);
            borrow = ((u128::from(digit) * u128::from(prime.value)) >> 64) as u64 + u64::from(under);
            digit
        }));
        (borrow == 0).then_some(quotient)
    }

    #[inline]
    fn as_word(&self) -> Option<i64> {
        None
    }

    fn to_big(&self) -> BigInt {
        big_from_words(&self.0)
    }

    fn room(rooms: &mut Rooms) -> &mut Room<Self> {
        let rooms = rooms.wide.get_or_insert_default();
        let room: &mut dyn Any = match N {
            3 => &mut rooms.three,
            4 => &mut rooms.four,
            6 => &mut rooms.six,
            _ => &mut rooms.eight,
        };
        room.downcast_mut().expect("invariant: the widths of `Values` are those of `Rooms`")
    }
}

impl Numerator for BigInt {
    const BITS: u64 = u64::MAX;

    fn zero() -> Self {
        Zero::zero()
    }

    #[inline]
    fn is_zero(&self) -> bool {
        Zero::is_zero(self)
    }

    #[inline]
    fn is_negative(&self) -> bool {
        Signed::is_negative(self)
    }

    fn from_words(words: &[u64]) -> Self {
        big_from_words(words)
    }

    #[inline]
    fn write_words(&self, out: &mut [u64]) {
        write_unsigned(self.magnitude(), out);
        if self.sign() == Sign::Minus {
            let mut carry = true;
            for word in out {
                (*word, carry) = (!*word).overflowing_add(u64::from(carry));
            }
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        self.add(other)
    }

    #[inline]
    fn minus(&self, other: &Self) -> Self {
        self.sub(other)
    }

    #[inline]
    fn times(&self, factor: i64) -> Self {
        self * factor
    }

    #[inline]
    fn negated(&self) -> Self {
        -self
    }

    fn bit_length(values: &[Self]) -> u64 {
        values.iter().map(Self::bits).max().unwrap_or(0)
    }

    #[inline]
    fn trailing_zeros(&self) -> u32 {
        u32::try_from(Self::trailing_zeros(self).unwrap_or(0)).unwrap_or(u32::MAX)
    }

    #[inline]
    fn shifted_right(&self, count: u32) -> Self {
        self >> count
    }

    #[inline]
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self> {
        Zero::is_zero(&(self % prime.value)).then(|| self / prime.value)
    }

    fn as_word(&self) -> Option<i64> {
        None
    }

    fn to_big(&self) -> BigInt {
        self.clone()
    }

    fn room(rooms: &mut Rooms) -> &mut Room<Self> {
        &mut rooms.wide.get_or_insert_default().big
    }
}

/// Fills `out` with the words of a non-negative integer that fits.
pub(crate) fn write_unsigned(value: &BigUint, out: &mut [u64]) {
    let mut digits = value.iter_u64_digits();
    out.iter_mut().for_each(|slot| *slot = digits.next().unwrap_or(0));
    debug_assert!(digits.next().is_none(), "invariant: the bound keeps the number of words");
}

/// The integer of little-endian words in two's complement.
pub(crate) fn big_from_words(words: &[u64]) -> BigInt {
    let negative = words.last().is_some_and(|word| word >> 63 == 1);
    if !negative {
        return BigInt::from(unsigned_from_words(words));
    }
    let mut carry = true;
    let magnitude: Vec<u64> = words
        .iter()
        .map(|&word| {
            let (word, over) = (!word).overflowing_add(u64::from(carry));
            carry = over;
            word
        })
        .collect();
    BigInt::from_biguint(Sign::Minus, unsigned_from_words(&magnitude))
}

/// The non-negative integer of little-endian words.
pub(crate) fn unsigned_from_words(words: &[u64]) -> BigUint {
    match words {
        [low] => BigUint::from(*low),
        [low, high] => BigUint::from(u128::from(*low) | u128::from(*high) << 64),
        _ => BigUint::new(words.iter().flat_map(|&word| [word as u32, (word >> 32) as u32]).collect()),
    }
}

/// Numerators of one width. Which one is chosen by [`Values::hold`].
#[derive(Clone, Debug)]
pub(crate) enum Values {
    One(Vec<i64>),
    Two(Vec<i128>),
    Three(Vec<Wide<3>>),
    Four(Vec<Wide<4>>),
    Six(Vec<Wide<6>>),
    Eight(Vec<Wide<8>>),
    Big(Vec<BigInt>),
}

/// Runs the same code for whichever width `$values` has; with `=> $wrap` the result, a vector of the same width, is
/// wrapped again.
macro_rules! for_width {
    ($values:expr, $list:ident => $body:expr) => {
        match $values {
            $crate::number::numerator::Values::One($list) => $body,
            $crate::number::numerator::Values::Two($list) => $body,
            $crate::number::numerator::Values::Three($list) => $body,
            $crate::number::numerator::Values::Four($list) => $body,
            $crate::number::numerator::Values::Six($list) => $body,
            $crate::number::numerator::Values::Eight($list) => $body,
            $crate::number::numerator::Values::Big($list) => $body,
        }
    };
    ($values:expr, $list:ident => wrap $body:expr) => {
        match $values {
            $crate::number::numerator::Values::One($list) => $crate::number::numerator::Values::One($body),
            $crate::number::numerator::Values::Two($list) => $crate::number::numerator::Values::Two($body),
            $crate::number::numerator::Values::Three($list) => $crate::number::numerator::Values::Three($body),
            $crate::number::numerator::Values::Four($list) => $crate::number::numerator::Values::Four($body),
            $crate::number::numerator::Values::Six($list) => $crate::number::numerator::Values::Six($body),
            $crate::number::numerator::Values::Eight($list) => $crate::number::numerator::Values::Eight($body),
            $crate::number::numerator::Values::Big($list) => $crate::number::numerator::Values::Big($body),
        }
    };
}
pub(crate) use for_width;

impl Values {
    /// Magnitudes below 2^this are represented.
    pub(crate) fn capacity(&self) -> u64 {
        fn bits<T: Numerator>(_: &[T]) -> u64 {
            T::BITS
        }
        for_width!(self, list => bits(list))
    }

    /// The same numbers, in the narrowest width that holds magnitudes below 2^bits unless they already have room.
    pub(crate) fn widened(&self, bits: u64) -> Self {
        fn convert<S: Numerator, T: Numerator>(from: &[S]) -> Vec<T> {
            let words = if S::BITS == u64::MAX { 0 } else { S::BITS.div_ceil(64) as usize };
            let mut scratch: Vec<u64> = Vec::new();
            from.iter()
                .map(|value| {
                    let words = if words == 0 { (value.to_big().bits() / 64 + 1) as usize } else { words };
                    scratch.resize(words, 0);
                    value.write_words(&mut scratch);
                    T::from_words(&scratch)
                })
                .collect()
        }
        match bits {
            0..=63 => for_width!(self, list => Self::One(convert(list))),
            64..=127 => for_width!(self, list => Self::Two(convert(list))),
            128..=191 => for_width!(self, list => Self::Three(convert(list))),
            192..=255 => for_width!(self, list => Self::Four(convert(list))),
            256..=383 => for_width!(self, list => Self::Six(convert(list))),
            384..=511 => for_width!(self, list => Self::Eight(convert(list))),
            _ => for_width!(self, list => Self::Big(convert(list))),
        }
    }

    /// Makes room for magnitudes below 2^bits.
    pub(crate) fn hold(&mut self, bits: u64) {
        if self.capacity() < bits {
            *self = self.widened(bits);
        }
    }

    /// As unlimited integers.
    pub(crate) fn to_big(&self) -> Vec<BigInt> {
        for_width!(self, list => list.iter().map(Numerator::to_big).collect())
    }
}

/// An exact integer factor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    Small(i64),
    Big(Box<BigInt>),
}

impl Scalar {
    pub(crate) const ONE: Self = Self::Small(1);

    pub(crate) fn from_big(value: &BigInt) -> Self {
        i64::try_from(value).map_or_else(|_| Self::Big(Box::new(value.clone())), Self::Small)
    }

    pub(crate) fn to_big(&self) -> BigInt {
        match self {
            Self::Small(value) => BigInt::from(*value),
            Self::Big(value) => value.as_ref().clone(),
        }
    }

    pub(crate) fn is_zero(&self) -> bool {
        matches!(self, Self::Small(0))
    }

    pub(crate) fn is_one(&self) -> bool {
        matches!(self, Self::Small(1))
    }

    /// Bit length of the magnitude.
    pub(crate) fn bits(&self) -> u64 {
        match self {
            Self::Small(value) => u64::from(64 - value.unsigned_abs().leading_zeros()),
            Self::Big(value) => value.bits(),
        }
    }

    pub(crate) fn times(&self, other: &Self) -> Self {
        if let (Self::Small(a), Self::Small(b)) = (self, other)
            && let Some(product) = a.checked_mul(*b)
        {
            return Self::Small(product);
        }
        Self::from_big(&(self.to_big() * other.to_big()))
    }

    pub(crate) fn plus(&self, other: &Self) -> Self {
        if let (Self::Small(a), Self::Small(b)) = (self, other)
            && let Some(sum) = a.checked_add(*b)
        {
            return Self::Small(sum);
        }
        Self::from_big(&(self.to_big() + other.to_big()))
    }

    pub(crate) fn power(&self, exponent: u32) -> Self {
        match self {
            Self::Small(1) => Self::ONE,
            Self::Small(value) => match value.checked_pow(exponent) {
                Some(power) => Self::Small(power),
                None => Self::from_big(&BigInt::from(*value).pow(exponent)),
            },
            Self::Big(value) => Self::from_big(&value.pow(exponent)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::OddPrime;

    #[test]
    fn logarithms_of_small_primes_are_right() {
        for prime in OddPrime::SMALL {
            assert_eq!(prime.log2, ((prime.value as f64).log2() * f64::from(1 << 20)).ceil() as u64);
        }
    }
}
