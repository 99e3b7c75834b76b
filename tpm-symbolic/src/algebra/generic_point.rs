//! Random points at which the generic rank of a matrix is determined.
//!
//! The rank of a matrix of polynomials at any one point is at most its generic rank, and it is smaller only where some
//! minor of that size, a polynomial of degree d that is not identically zero, vanishes: for values drawn at random
//! among n, with a probability of at most d/n (Schwartz and Zippel). The largest rank over a few points with n = 2^31
//! is therefore right but for a chance of the order of (d/n)^points. The points are the same in every run.

use crate::number::rational::{self, Rational};

/// Number of points at which a rank is determined.
pub const POINTS: u64 = 3;

/// A value for quantity `index` at point number `point`: positive, between 1 and 2^31, all distinct in practice.
#[must_use]
pub fn value(point: u64, index: usize) -> Rational {
    // One step of the SplitMix64 generator, whose output is equidistributed over its counter.
    let counter = point.wrapping_mul(0x1_0001).wrapping_add(index as u64).wrapping_add(1);
    let mut z = counter.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    rational::integer(i64::from(u32::try_from((z ^ (z >> 31)) >> 33).unwrap_or(u32::MAX)) + 1)
}
