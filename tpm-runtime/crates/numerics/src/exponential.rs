//! The exponential of a matrix.
//!
//! Scaling and squaring with the diagonal Padé approximant of degree 13 (N. J. Higham, SIAM Journal on Matrix Analysis and Applications 26,
//! 2005): `e^A = (r(A / 2^s))^(2^s)`, where s makes the powers of the argument at most those of [`MOST_NORM`], so that the approximant is exact
//! to rounding. nalgebra has it with `std` alone, which takes products that differ from processor to processor (`DESIGN.md`, "Why are results the
//! same to the last bit?").

use nalgebra::DMatrix;

/// Largest 1-norm of an argument of which the approximant is exact to rounding.
const MOST_NORM: f64 = 5.371_920_351_148_152;

/// Coefficients of the numerator, from the constant on.
const NUMERATOR: [f64; 14] = [
    64_764_752_532_480_000.0,
    32_382_376_266_240_000.0,
    7_771_770_303_897_600.0,
    1_187_353_796_428_800.0,
    129_060_195_264_000.0,
    10_559_470_521_600.0,
    670_442_572_800.0,
    33_522_128_640.0,
    1_323_241_920.0,
    40_840_800.0,
    960_960.0,
    16_380.0,
    182.0,
    1.0,
];

/// `e^A` of a square matrix; not a number everywhere where an entry of A is not finite.
#[must_use]
pub fn exponential(of: &DMatrix<f64>) -> DMatrix<f64> {
    let n = of.nrows();
    let nothing = || DMatrix::from_element(n, n, f64::NAN);
    if !of.iter().sum::<f64>().is_finite() || !norm(of).is_finite() {
        return nothing();
    }
    let halvings = (size_of_powers(of) - MOST_NORM.log2()).ceil().max(0.0) as i32;
    let a = of * 0.5_f64.powi(halvings);
    let square = &a * &a;
    let fourth = &square * &square;
    let sixth = &square * &fourth;
    let b = &NUMERATOR;
    let high = |i: usize| &sixth * (&sixth * b[i + 12] + &fourth * b[i + 10] + &square * b[i + 8]);
    let low = |i: usize| &sixth * b[i + 6] + &fourth * b[i + 4] + &square * b[i + 2] + DMatrix::identity(n, n) * b[i];
    let (odd, even) = (&a * (high(1) + low(1)), high(0) + low(0));
    let Some(mut found) = (&even - &odd).lu().solve(&(even + odd)) else { return nothing() };
    for _ in 0..halvings {
        found = &found * &found;
    }
    found
}

/// The 1-norm.
fn norm(of: &DMatrix<f64>) -> f64 {
    of.column_iter().map(|column| column.iter().map(|entry| entry.abs()).sum::<f64>()).fold(0.0, f64::max)
}

/// Logarithm to the base 2 of `max(|A^4|^(1/4), |A^6|^(1/6))`, which takes the place of the norm (A. H. Al-Mohy and N. J. Higham, SIAM Journal
/// on Matrix Analysis and Applications 31, 2009): where large entries of A meet zeros in its powers, halvings by the norm would round away
/// what the powers say. Every factor is divided by its norm, so that nothing overflows; minus infinity where the powers are zero.
fn size_of_powers(a: &DMatrix<f64>) -> f64 {
    let scaled = |of: DMatrix<f64>| {
        let size = norm(&of);
        if size > 0.0 { (of / size, size.log2()) } else { (of, f64::NEG_INFINITY) }
    };
    let (a, own) = scaled(a.clone());
    let (square, of_square) = scaled(&a * &a);
    let (fourth, of_fourth) = scaled(&square * &square);
    let (_, of_sixth) = scaled(&fourth * &square);
    let fourth = own + (2.0 * of_square + of_fourth) / 4.0;
    let sixth = own + (3.0 * of_square + of_fourth + of_sixth) / 6.0;
    fourth.max(sixth)
}

#[cfg(test)]
mod tests {
    use super::exponential;
    use nalgebra::DMatrix;

    fn square(n: usize, rows: &[f64]) -> DMatrix<f64> {
        DMatrix::from_row_slice(n, n, rows)
    }

    /// Largest difference of two matrices, as a share of the largest entry.
    fn off(found: &DMatrix<f64>, known: &DMatrix<f64>) -> f64 {
        (found - known).amax() / known.amax()
    }

    #[test]
    fn exponentials_that_are_known() {
        // Half a turn, of which one entry is large and the other small.
        for ratio in [1.0, 1e6, 1e12] {
            let turn = std::f64::consts::PI;
            let found = exponential(&square(2, &[0.0, -turn / ratio, turn * ratio, 0.0]));
            assert!((found[(0, 0)] + 1.0).abs() < 1e-14 && (found[(1, 1)] + 1.0).abs() < 1e-14, "{ratio}: {found}");
        }
        for turn in [1e-9_f64, 0.3, 2.0, 9.0] {
            let rotation = exponential(&square(2, &[0.0, -turn, turn, 0.0]));
            let known = square(2, &[turn.cos(), -turn.sin(), turn.sin(), turn.cos()]);
            assert!(off(&rotation, &known) < 1e-14, "{turn}: {rotation}");
        }
        // A chain of integrators over 3 s, whose series ends.
        let chain = exponential(&(square(3, &[0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) * 3.0));
        assert!(off(&chain, &square(3, &[1.0, 3.0, 4.5, 0.0, 1.0, 3.0, 0.0, 0.0, 1.0])) < 1e-15, "{chain}");
        assert_eq!(exponential(&DMatrix::zeros(0, 0)).len(), 0);
        assert!(exponential(&square(1, &[f64::INFINITY])).iter().all(|entry| entry.is_nan()));
    }

    #[test]
    fn half_the_time_twice_is_the_whole_time() {
        for size in [0.01, 1.0, 30.0] {
            let a = DMatrix::from_fn(5, 5, |i, j| size * (((3 * i + 7 * j) % 11) as f64 / 11.0 - 0.6));
            let half = exponential(&(&a * 0.5));
            assert!(off(&(&half * &half), &exponential(&a)) < 1e-13 * size.max(1.0));
        }
    }
}
