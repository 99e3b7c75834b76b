//! What rounding leaves of zero: one bound per question, imported by whoever asks it.
//!
//! Doubles have rounding errors of 1.1e-16; a decomposition of n columns leaves some n times as much of an exact zero, and numbers that
//! went through a file, a transform or a difference quotient leave more. Every bound here is a share of the largest thing of its kind,
//! after scaling, unless it says otherwise, so that none depends on units.
//!
//! Invariant: a bound lies far above the rounding that it bounds, and far below what a user would read as a result. Bounds that decide
//! what a small number is worth, and not whether it is one, stand beside their algorithms.

// Rank.

/// Singular values of equations with columns of unit length, as a share of the largest, that count as zero: rounding leaves them of an
/// exact dependence once the columns come out of sums over a record. Entries of directions of the null space, where they are eliminated,
/// too.
pub const RANK: f64 = 1e-10;
/// Singular values of a column-scaled Jacobian, or of the scaled root of an information matrix, as a share of the largest, that count as
/// zero. The entries are results of a computation, not sums over a record.
pub const JACOBIAN_RANK: f64 = 1e-9;
/// Singular values of a Jacobian by difference quotients, as a share of the largest, that count as zero; the error of central differences
/// with a step at the cube root of rounding is smaller.
pub const DIFFERENCED_RANK: f64 = 1e-8;
/// Singular values of `[A - s, B]` at an eigenvalue s of A, as a share of the largest, that count as zero: the mode is not reached.
pub const PENCIL_RANK: f64 = 1e-9;
/// Eigenvalues of a matrix of inner products (Gram, covariance, correlation), as a share of the largest, and squared lengths that other
/// columns leave of one, as a share of its own, that count as zero: linear dependence in terms of power.
pub const GRAM: f64 = 1e-9;
/// Diagonal entries of the triangular factor of columns of unit length that count as zero: the length that the columns before leave of
/// one.
pub const COLUMN: f64 = 1e-9;
/// Pivots, singular values and diagonal entries of a triangular factor, as a share of the largest, that rounding leaves of dependent rows
/// or columns along a computed motion.
pub const PIVOT: f64 = 1e-12;

// Directions and their components.

/// Components of a direction whose largest component is one that are rounding of zero; likewise singular values of a matrix of such
/// components, and differences of values as a share of their size, where they come from such directions.
pub const COMPONENT: f64 = 1e-9;
/// Components of a direction, in scaled parameters and as a share of the largest one, up to which a parameter has no part in it.
pub const HIDDEN_COMPONENT: f64 = 1e-6;
/// Differences of numbers as a share of their size, components of unit directions, and singular values as a share of the largest that are
/// what the nine digits of a stored result leave of nothing.
pub const STORED: f64 = 1e-6;

// Variances.

/// Least variance of a combination of scaled parameters, as a share of the largest: smaller eigenvalues of a covariance are rounding.
pub const VARIANCE: f64 = 1e-14;
/// Standard deviation, as a share of the value (or of the root mean square), that is given to an exact or held number in an equation, so
/// that its weight does not make the others vanish in rounding.
pub const EXACT_DEVIATION: f64 = 1e-6;
/// Largest asymmetry and most negative eigenvalue of a weight of a regulator, as a share of the largest entry of the weight.
pub const WEIGHT: f64 = 1e-12;

// Signals, lines and forces.

/// Noise of a signal, as a share of its root mean square or of its largest harmonic, that is no more than the rounding of the numbers
/// that a file holds.
pub const READING: f64 = 1e-9;
/// Distance of a single reading from its neighbours, as a share of the signal's standard deviation, that the digits of a file explain.
pub const FILE_DIGITS: f64 = 1e-6;
/// Difference of two sample times, as a share of them, that the digits of a column of time explain.
pub const TIME_STAMP: f64 = 1e-6;
/// Lines of a transformed record, as a share of the strongest line of the signal: the rounding of the transform.
pub const LINE: f64 = 1e-13;
/// Power of a line of an averaged spectrum, as a share of the strongest line's, up to which it is rounding.
pub const POWER: f64 = 1e-24;
/// Harmonics of a computed motion, as a share of the root of the sum of squares of all, that are rounding.
pub const SERIES: f64 = 1e-12;
/// Jumps of a derivative of a computed motion where two strokes meet, as a share of the bound on that derivative along all strokes.
pub const JUNCTION: f64 = 1e-6;
/// Lines of a regressor along an exact motion, as a share of the largest of all regressors of the parameter, that are rounding of zero.
pub const REGRESSOR_LINE: f64 = 1e-9;
/// Harmonics of a force or a regressor along a computed motion, and forces that nothing explains there, as a share of the root mean
/// square.
pub const FORCE: f64 = 1e-10;
/// Forces that an estimate from a record leaves unexplained, as a share of the force, where nothing but rounding is left.
pub const EXPLAINED_FORCE: f64 = 1e-7;

// Poles and polynomials.

/// Distance of two eigenvalues, and a real part, as a share of the largest magnitude of a mode, that are rounding of zero.
pub const EIGENVALUE: f64 = 1e-7;
/// Real part of a pole, as a share of the largest magnitude of a pole, that the error of a linearisation by differences explains.
pub const DIFFERENCED_POLE: f64 = 1e-6;
/// Coefficients of a characteristic polynomial, scaled to poles of magnitude one at most, that are rounding of zero.
pub const COEFFICIENT: f64 = 1e-9;
