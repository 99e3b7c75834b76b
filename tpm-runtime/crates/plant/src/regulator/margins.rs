//! Stability margins of a sampled loop at each of its inputs.
//!
//! A loop `x[n+1] = A x[n] + B u[n]`, `u = -C x` is opened at one input i while the others stay closed. Its open-loop
//! transfer function is `L(z) = C_i (z - A_i)^-1 B_i` with `A_i = A - sum_j B_j C_j`, j other than i. The loop is at
//! the border of stability when a factor times L passes -1 on the unit circle: a real factor is a gain margin, a factor
//! of magnitude 1 a phase margin. By the determinant of a product `1 + L(z) = det(z - A_cl) / det(z - A_i)`, with
//! `A_cl = A - B C`: a response takes the poles of the closed and of the opened loop, and no matrix. Invariant: crossings are found on a grid of frequencies that is dense about every
//! lightly damped mode, and refined by bisection.

use num_complex::Complex;
use std::f64::consts::{PI, TAU};
use tpm_numerics::eigenvalues::eigenvalues;

/// Frequencies of the grid up to half the sampling frequency.
const GRID_POINTS: usize = 6000;
/// Decades that the grid reaches down from half the sampling frequency.
const GRID_DECADES: f64 = 7.0;
/// Intervals of the grid of frequencies about every mode.
const MODE_POINTS: usize = 60;
/// How far they reach to either side, in multiples of the mode's damping (the logarithm of its pole's magnitude).
const MODE_REACH: f64 = 20.0;
/// Bisections of an interval that holds a crossing.
const CROSSING_BISECTIONS: usize = 60;

/// Margins of a stable loop at one input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Range of factors on the input in which the loop stays stable: from 0 or more up to 1 or more, infinite where no
    /// factor above 1 makes it unstable.
    pub gain: (f64, f64),
    /// Largest change of phase to either side, rad; pi where the loop never has gain 1.
    pub phase: f64,
    /// Largest delay, s; infinite where the loop never has gain 1.
    pub delay: f64,
}

/// A sampled loop, opened at one of its inputs.
struct Opened<'c> {
    /// Poles of the loop while it is closed.
    closed: &'c [Complex<f64>],
    /// Poles of the opened loop, as many.
    open: Vec<Complex<f64>>,
}

impl Opened<'_> {
    /// L at `e^{j angle}`; infinite at a pole.
    fn response(&self, angle: f64) -> Complex<f64> {
        let z = Complex::from_polar(1.0, angle);
        let quotient = self.closed.iter().zip(&self.open).fold(Complex::from(1.0), |product, (closed, open)| {
            let below = z - open;
            if below == Complex::from(0.0) { Complex::new(f64::INFINITY, 0.0) } else { product * (z - closed) / below }
        });
        if quotient.is_finite() { quotient - 1.0 } else { Complex::new(f64::INFINITY, 0.0) }
    }
}

/// Margins at every input of the loop `x[n+1] = A x[n] + B u[n]`, `u = -C x`, sampled every `sample_time` seconds, which must be
/// stable. A is states times states, B states times inputs, C inputs times states.
#[must_use]
pub fn margins(
    a: &tpm_numerics::Matrix,
    b: &tpm_numerics::Matrix,
    c: &tpm_numerics::Matrix,
    sample_time: f64,
) -> Vec<Margins> {
    let (a, b, c) = (a.dense(), b.dense(), c.dense());
    let loops = a - b * c;
    let closed = paired(eigenvalues(&loops));
    (0..b.ncols())
        .map(|input| {
            let open = paired(eigenvalues(&(&loops + b.column(input) * c.row(input))));
            // Where the poles of a loop are not found, no factor and no lag is known to be allowed.
            if closed.iter().chain(&open).any(|pole| !pole.is_finite()) {
                return Margins { gain: (1.0, 1.0), phase: 0.0, delay: 0.0 };
            }
            let grid = angles(&open);
            of_loop(&Opened { closed: &closed, open }, &grid, sample_time)
        })
        .collect()
}

/// Poles by their distance from 1, so that poles of two loops that stand side by side nearly cancel, and products keep their size.
fn paired(mut poles: Vec<Complex<f64>>) -> Vec<Complex<f64>> {
    poles.sort_by(|a, b| (a - 1.0).norm().total_cmp(&(b - 1.0).norm()));
    poles
}

/// Angles of the grid from nearly 0 to pi, ascending.
fn angles(open: &[Complex<f64>]) -> Vec<f64> {
    let even = (0..=GRID_POINTS).map(|i| PI * 10.0_f64.powf(GRID_DECADES * (i as f64 / GRID_POINTS as f64 - 1.0)));
    let mut grid: Vec<f64> = even.collect();
    for mode in open.iter().filter(|z| z.im > 0.0) {
        let reach = MODE_REACH * mode.norm().ln().abs();
        let about = (0..=MODE_POINTS).map(|i| mode.arg() + reach * (2.0 * i as f64 / MODE_POINTS as f64 - 1.0));
        grid.extend(about.filter(|angle| (0.0..PI).contains(angle)));
    }
    grid.sort_by(f64::total_cmp);
    grid
}

fn of_loop(opened: &Opened<'_>, grid: &[f64], sample_time: f64) -> Margins {
    let mut found = Margins { gain: (0.0, f64::INFINITY), phase: PI, delay: f64::INFINITY };
    let mut gain = |response: Complex<f64>| {
        if response.re < 0.0 && response.re.is_finite() {
            let factor = -1.0 / response.re;
            if factor < 1.0 {
                found.gain.0 = found.gain.0.max(factor);
            } else {
                found.gain.1 = found.gain.1.min(factor);
            }
        }
    };
    // At rest and at half the sampling frequency the response is real.
    gain(opened.response(0.0));
    gain(opened.response(PI));
    let responses: Vec<Complex<f64>> = grid.iter().map(|angle| opened.response(*angle)).collect();
    let refined = |at: usize, of: &dyn Fn(Complex<f64>) -> f64| {
        let (mut low, mut high) = (grid[at], grid[at + 1]);
        let sign = of(responses[at]) > 0.0;
        for _ in 0..CROSSING_BISECTIONS {
            let middle = 0.5 * (low + high);
            if (of(opened.response(middle)) > 0.0) == sign {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    };
    let beyond_one = |response: Complex<f64>| response.norm() - 1.0;
    for (at, pair) in responses.windows(2).enumerate() {
        if (pair[0].im > 0.0) != (pair[1].im > 0.0) && pair[0].re < 0.0 && pair[1].re < 0.0 {
            gain(opened.response(refined(at, &|response| response.im)));
        }
        if (beyond_one(pair[0]) > 0.0) != (beyond_one(pair[1]) > 0.0) {
            let angle = refined(at, &beyond_one);
            // At this angle L = -e^{j phase}, so that a lag by this phase shifts it to -1.
            let phase = (-opened.response(angle)).arg();
            found.phase = found.phase.min(phase.abs());
            let lag = if phase >= 0.0 { phase } else { phase + TAU };
            found.delay = found.delay.min(lag / angle * sample_time);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::{Opened, margins, paired};
    use crate::regulator::optimal::{Regulator, RegulatorWeights, held};
    use num_complex::Complex;
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;
    use std::f64::consts::PI;
    use tpm_numerics::eigenvalues::eigenvalues;
    use tpm_numerics::{DMatrix, Matrix};

    /// Largest magnitude of a pole with a complex factor on the feedback.
    fn radius(a: &DMatrix<f64>, b: &DMatrix<f64>, c: &DMatrix<f64>, factor: Complex<f64>) -> f64 {
        // A - f B C with complex f in real numbers; its eigenvalues are those of the complex matrix and their conjugates.
        let n = a.nrows();
        let back = b * c;
        let doubled = DMatrix::from_fn(2 * n, 2 * n, |r, k| {
            let (row, column) = (r % n, k % n);
            match (r < n, k < n) {
                (true, true) | (false, false) => a[(row, column)] - factor.re * back[(row, column)],
                (true, false) => factor.im * back[(row, column)],
                (false, true) => -factor.im * back[(row, column)],
            }
        });
        eigenvalues(&doubled).iter().map(|z| z.norm()).fold(0.0, f64::max)
    }

    #[test]
    fn margins_are_where_the_poles_cross_the_circle() {
        // The pendulum upright (Fong, Eqn 24) under its regulator.
        let a = DMatrix::from_row_slice(
            4,
            4,
            &[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.9797, -8.1420, -0.1098, 0.0, 57.626, -6.9789, -1.0584],
        );
        let b = DMatrix::from_row_slice(4, 1, &[0.0, 0.0, 28.845, 24.725]);
        let weights = RegulatorWeights { state: vec![1.0, 10.0, 0.1, 0.1], input: vec![1.0] };
        let regulator =
            Regulator::optimal(&Matrix::of(a.clone()), &Matrix::of(b.clone()), 1e-3, &weights).expect("reached");
        let (a, b) = held(&a, &b, 1e-3).expect("finite");
        let found = margins(&Matrix::of(a.clone()), &Matrix::of(b.clone()), regulator.gain(), 1e-3)[0];
        let k = regulator.gain().dense();
        let gain = |factor: f64| radius(&a, &b, k, Complex::new(factor, 0.0));
        assert!(found.gain.0 > 0.0 && found.gain.1.is_finite(), "{found:?}");
        assert!(gain(found.gain.0 * 1.0001) < 1.0 && gain(found.gain.0 * 0.9999) > 1.0, "{found:?}");
        assert!(gain(found.gain.1 * 0.9999) < 1.0 && gain(found.gain.1 * 1.0001) > 1.0, "{found:?}");
        let turned = |phase: f64| radius(&a, &b, k, Complex::from_polar(1.0, -phase));
        assert!(turned(found.phase * 0.9999) < 1.0 && turned(found.phase * 1.0001) > 1.0, "{found:?}");
        // The regulator in continuous time has a phase margin of 60 degrees and a gain margin of one half; sampling at
        // 1 kHz reduces them little.
        assert!(found.phase > 1.0 && found.gain.0 < 0.55, "{found:?}");
    }

    #[test]
    fn the_response_of_an_opened_loop_is_that_of_its_matrices() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for (n, m) in [(1, 1), (4, 1), (6, 3), (12, 4)] {
            let mut matrix = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| random.random_range(-0.5..0.5));
            let (a, b, c) = (matrix(n, n), matrix(n, m), matrix(m, n));
            let loops = &a - &b * &c;
            for input in 0..m {
                let open = &loops + b.column(input) * c.row(input);
                let opened = Opened { closed: &paired(eigenvalues(&loops)), open: paired(eigenvalues(&open)) };
                for angle in [0.0, 1e-3, 0.4, 1.0, 2.5, PI] {
                    let z = Complex::from_polar(1.0, angle);
                    let matrix =
                        DMatrix::from_fn(
                            n,
                            n,
                            |r, k| {
                                if r == k { z - open[(r, k)] } else { Complex::from(-open[(r, k)]) }
                            },
                        );
                    let solved = matrix.lu().solve(&b.column(input).map(Complex::from)).expect("no pole there");
                    let expected: Complex<f64> = c.row(input).iter().zip(solved.iter()).map(|(c, x)| x * *c).sum();
                    let found = opened.response(angle);
                    assert!((found - expected).norm() < 1e-10 * (1.0 + expected.norm()), "{n} {m}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_loop_that_is_far_below_one_has_no_end() {
        let one = |x: f64| Matrix::from_rows(&[vec![x]]).expect("a row");
        let found = margins(&one(0.5), &one(0.1), &one(1.0), 0.01)[0];
        // x[n+1] = (.5 - .1 k) x[n]: stable from k = -5 to 15; L(z) has its largest magnitude, .2, at z = 1.
        assert!((found.gain.1 - 15.0).abs() < 1e-9 && found.gain.0 == 0.0, "{found:?}");
        assert!(found.phase > 3.1 && found.delay.is_infinite());
    }
}
