//! The periodic motion of the coordinates that a pattern leaves open.
//!
//! A chain is driven at one end and its pattern prescribes the other (Feng, chapter 4). The rows without an input, such
//! as `m2 x2'' + k3 (x2 - x1) = 0`, then determine the motion of the coordinates between them, which is the reference
//! of a collocated controller. Invariant: the open coordinates are finite Fourier series that make every harmonic of
//! these rows vanish to rounding (harmonic balance, by Newton's method; one step where the rows are linear in the open
//! coordinates), with as many harmonics as it takes until the highest ones are negligible. Where the estimates leave
//! these rows empty (all zero before the first run) nothing determines the open coordinates, and they rest at zero.
//!
//! Dry friction on an open coordinate makes its rows jump, and the harmonics of a jump decay slowly. The motion is
//! therefore found first without the jump, then with smoothed jumps, `tanh(v/width)` in place of `sign(v)`, whose
//! widths shrink from the largest velocity to a small share of it. A coordinate that should stick creeps instead. This
//! is exact enough for a reference, since the parameters are identified from the measured motion.

use crate::driven::Driven;
use crate::dry::FrictionJump;
use crate::trajectory::{HarmonicSeries, Line, Trajectory};
use num_complex::Complex;
use tpm_controller::Real;
use tpm_controller::model::{EvalError, Model};
use tpm_numerics::differences::FIVE_POINT;
use tpm_numerics::fourier::forward;
use tpm_numerics::{DMatrix, DVector, Doubling, Iteration};

/// Harmonics that an open coordinate is given: doubled until the lines of the upper quarter are a small share of the largest line.
const HARMONICS: Doubling = Doubling { least: 8, most: 128, settled: 1e-12 };
/// The same where a jump of dry friction is smoothed.
const HARMONICS_BESIDE_JUMP: Doubling = Doubling { settled: 1e-4, ..HARMONICS };
/// Newton's iteration: it has converged when the largest change of a Fourier coefficient is a small share of the largest one.
const NEWTON: Iteration = Iteration { most: 40, settled: 1e-13 };
/// The same where a jump of dry friction is smoothed.
const NEWTON_BESIDE_JUMP: Iteration = Iteration { settled: 1e-8, ..NEWTON };
/// Successive widths over which a jump is smoothed, as shares of the coordinate's largest velocity without friction.
const SMOOTHING_WIDTHS: [f64; 6] = [1.0, 0.5, 0.25, 0.12, 0.06, 0.03];
/// Step of the difference quotients, as a share of the largest magnitude in a slot of the motion. The five-point rule
/// is exact up to the fourth degree.
const DIFFERENCE_STEP: f64 = 1e-3;

/// Fills the series of the open coordinates with their periodic motion under given parameters.
///
/// # Errors
/// [`CompletionError::Open`] when the rows without an input do not determine the motion, [`CompletionError::Evaluation`] when
/// the model cannot be evaluated along it.
pub fn complete(
    model: &dyn Model<f64>,
    trajectory: &mut Trajectory,
    open: &[usize],
    parameters: &[f64],
    constants: &[f64],
) -> Result<(), CompletionError> {
    if open.is_empty() {
        return Ok(());
    }
    let mut harmonics = HARMONICS.least.max(2 * trajectory.highest_harmonic() as usize).min(HARMONICS.most);
    // The motion with fewer harmonics is a good start for that with more; the largest balances take most of the time.
    let mut start = Vec::new();
    loop {
        let balance = Balance::new(model, trajectory, open, parameters, constants, harmonics)?;
        if balance.rows.len() != open.len() {
            return Err(OpenReason::Rows { free: balance.rows.len(), open: open.len() }.into());
        }
        let solution = balance.solve(trajectory, &start)?;
        let enough = if balance.dry.is_empty() { HARMONICS } else { HARMONICS_BESIDE_JUMP };
        if solution.iter().all(|lines| is_short(lines, enough.settled)) {
            for (&c, lines) in open.iter().zip(solution) {
                trajectory.coordinates[c] = series(&lines);
            }
            return Ok(());
        }
        if harmonics == HARMONICS.most {
            return Err(OpenReason::Harmonics { most: HARMONICS.most }.into());
        }
        harmonics = (2 * harmonics).min(HARMONICS.most);
        start = solution;
    }
}

/// Why the series of the open coordinates cannot be filled.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CompletionError {
    /// The model could not be evaluated along the motion.
    #[error(transparent)]
    Evaluation(#[from] EvalError),
    /// The rows without an input do not determine the motion.
    #[error(transparent)]
    Open(#[from] OpenReason),
}

/// Why the motion of open coordinates is not determined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OpenReason {
    /// There are more or fewer rows without an input than open coordinates.
    #[error("there are {free} rows without an input for {open} coordinates; give the others a motion in the pattern")]
    Rows {
        /// Rows without an input.
        free: usize,
        /// Open coordinates.
        open: usize,
    },
    /// The rows leave the motion open with these estimates.
    #[error("with these estimates the rows without an input do not determine it; is a stiffness or a mass zero?")]
    Singular,
    /// Newton's method does not converge.
    #[error("no periodic motion was found; start smaller or slower")]
    NoConvergence,
    /// The harmonics of the motion do not fade out.
    #[error("its harmonics do not fade out up to the {most}th; start smaller or slower")]
    Harmonics {
        /// Harmonics that were tried.
        most: usize,
    },
}

/// Whether the upper quarter of the harmonics is negligible.
fn is_short(lines: &[f64], negligible: f64) -> bool {
    let peak = lines.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
    let harmonics = lines.len() / 2;
    lines[1 + 2 * (harmonics - harmonics / 4)..].iter().all(|x| x.abs() <= negligible * peak)
}

/// The series of given coefficients (mean, then cosine and sine of every harmonic), without those that are mere
/// rounding.
fn series(lines: &[f64]) -> HarmonicSeries {
    let peak = lines.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
    let kept = |x: f64| if x.abs() > f64::EPSILON * peak { x } else { 0.0 };
    let of = |(k, pair): (usize, &[f64])| Line { harmonic: k as u32 + 1, cos: kept(pair[0]), sin: kept(pair[1]) };
    let lines_of = lines[1..].chunks_exact(2).enumerate().map(of);
    HarmonicSeries { mean: kept(lines[0]), lines: lines_of.filter(|line| line.cos != 0.0 || line.sin != 0.0).collect() }
}

/// The rows without an input at the points of one period.
struct Balance<'a> {
    model: &'a dyn Model<f64>,
    open: &'a [usize],
    parameters: &'a [f64],
    constants: &'a [f64],
    harmonics: usize,
    points: usize,
    /// Rows without an input.
    rows: Vec<usize>,
    /// Open coordinates whose velocity makes a row jump where it passes through zero.
    dry: Vec<usize>,
}

impl<'a> Balance<'a> {
    fn new(
        model: &'a dyn Model<f64>,
        trajectory: &Trajectory,
        open: &'a [usize],
        parameters: &'a [f64],
        constants: &'a [f64],
        harmonics: usize,
    ) -> Result<Self, EvalError> {
        let dims = model.dims();
        // Enough points to resolve the product of four series of this length without aliasing.
        let points = 8 * (harmonics + 1);
        let mut driven = Driven::new(model);
        let mut motion = vec![0.0; dims.motion_len()];
        let mut friction_jump = FrictionJump::new(model);
        let mut jumps = vec![false; open.len()];
        for n in 0..points {
            trajectory.motion_at(n, points, 0.0, &mut motion);
            for (jumps, &c) in jumps.iter_mut().zip(open) {
                *jumps = *jumps || friction_jump.is_dry(model, &mut motion, c, parameters, constants)?;
            }
            driven.see(model, &motion, constants)?;
        }
        let rows = driven.without_input();
        let dry = open.iter().zip(jumps).filter(|(_, jumps)| *jumps).map(|(c, _)| *c).collect();
        Ok(Balance { model, open, parameters, constants, harmonics, points, rows, dry })
    }

    /// Solves the balance; per open coordinate the mean, then cosine and sine of every harmonic. `start` is a solution with fewer
    /// harmonics, or nothing.
    fn solve(&self, trajectory: &Trajectory, start: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, CompletionError> {
        let width = 2 * self.harmonics + 1;
        let mut unknown = DVector::<f64>::zeros(self.open.len() * width);
        // Where a jump is smoothed, the solution without it comes first, which no start is near.
        if self.dry.is_empty() && !start.is_empty() {
            for (unknown, start) in unknown.as_mut_slice().chunks_exact_mut(width).zip(start) {
                unknown[..start.len()].copy_from_slice(start);
            }
            if self.newton(trajectory, &[], &mut unknown).is_ok() {
                return Ok(unknown.as_slice().chunks_exact(width).map(<[f64]>::to_vec).collect());
            }
            unknown.fill(0.0);
        }
        // An infinite width removes the jump.
        let mut widths = vec![f64::INFINITY; self.dry.len()];
        let mut now = self.newton(trajectory, &widths, &mut unknown)?;
        let largest: Vec<f64> = self.dry.iter().map(|&c| self.largest_velocity(&now, c)).collect();
        for spread in SMOOTHING_WIDTHS.into_iter().filter(|_| largest.iter().any(|largest| *largest > 0.0)) {
            for (width, largest) in widths.iter_mut().zip(&largest).filter(|(_, largest)| **largest > 0.0) {
                *width = spread * largest;
            }
            let before = unknown.clone();
            match self.newton(&now, &widths, &mut unknown) {
                Ok(next) => now = next,
                Err(fault) if spread == SMOOTHING_WIDTHS[0] => return Err(fault),
                // The motion with the wider smoothing serves as the reference.
                Err(_) => {
                    unknown = before;
                    break;
                }
            }
        }
        Ok(unknown.as_slice().chunks_exact(width).map(<[f64]>::to_vec).collect())
    }

    /// Largest magnitude of a coordinate's velocity over the period.
    fn largest_velocity(&self, now: &Trajectory, coordinate: usize) -> f64 {
        let velocity = |n: usize| {
            let phase = 2.0 * std::f64::consts::PI * n as f64 / self.points as f64;
            now.coordinates[coordinate].derivative(phase, now.frequency, 1).abs()
        };
        (0..self.points).map(velocity).fold(0.0, f64::max)
    }

    /// Newton's method from the coefficients `unknown` of the open coordinates, with jumps smoothed over `widths`.
    /// Returns the motion that it finds.
    fn newton(
        &self,
        trajectory: &Trajectory,
        widths: &[f64],
        unknown: &mut DVector<f64>,
    ) -> Result<Trajectory, CompletionError> {
        let width = 2 * self.harmonics + 1;
        let size = self.open.len() * width;
        let mut now = trajectory.clone();
        let place = |unknown: &DVector<f64>, now: &mut Trajectory| {
            for (&c, lines) in self.open.iter().zip(unknown.as_slice().chunks_exact(width)) {
                now.coordinates[c] = series(lines);
            }
        };
        let bounds = if self.dry.is_empty() { NEWTON } else { NEWTON_BESIDE_JUMP };
        for _ in 0..bounds.most {
            place(unknown, &mut now);
            let (residual, jacobian) = self.linearise(&now, widths)?;
            if jacobian.iter().chain(&residual).all(|x| *x == 0.0) {
                unknown.fill(0.0);
                place(unknown, &mut now);
                return Ok(now);
            }
            // Equations of high harmonics are larger by the square of their frequency, so that every equation is
            // scaled.
            let scale: Vec<f64> = jacobian.row_iter().map(|row| row.amax()).collect();
            if scale.iter().any(|s| !s.is_finite() || *s <= 0.0) || residual.iter().any(|x| !x.is_finite()) {
                return Err(OpenReason::Singular.into());
            }
            let scaled = DMatrix::from_fn(size, size, |r, c| jacobian[(r, c)] / scale[r]);
            let right = DVector::from_fn(size, |r, _| -residual[r] / scale[r]);
            let Some(step) = scaled.lu().solve(&right).filter(|step| step.iter().all(|x| x.is_finite())) else {
                return Err(OpenReason::Singular.into());
            };
            *unknown += &step;
            if step.amax() <= bounds.settled * unknown.amax() {
                place(unknown, &mut now);
                return Ok(now);
            }
        }
        Err(OpenReason::NoConvergence.into())
    }

    /// Harmonics of the rows, and their derivatives with respect to the unknown lines.
    ///
    /// A row's derivative with respect to a coordinate's n-th derivative is a periodic function g; the derivative of the row's
    /// harmonic a with respect to a line b is a harmonic of g times a line, so it takes the harmonics a + b and a - b of g.
    fn linearise(&self, now: &Trajectory, widths: &[f64]) -> Result<(DVector<f64>, DMatrix<f64>), EvalError> {
        let width = 2 * self.harmonics + 1;
        let size = self.open.len() * width;
        let mut residual = DVector::zeros(size);
        let mut jacobian = DMatrix::zeros(size, size);
        let Samples { forces, gains } = self.sample(now, widths)?;
        let transform = forward(self.points);
        let mut lines = transform.make_output_vec();
        let mut analyse = |signal: &mut Vec<f64>| {
            let moving = signal.iter().any(|x| *x != 0.0);
            if moving {
                transform.process(signal, &mut lines).expect("invariant: buffers were made for this transform");
            }
            moving.then(|| Lines(lines.iter().map(|z| z / self.points as f64).collect()))
        };
        for (f, mut force) in forces.into_iter().enumerate() {
            let Some(lines) = analyse(&mut force) else { continue };
            for i in 0..width {
                let (harmonic, sine) = (i.div_ceil(2), i > 0 && i % 2 == 0);
                let part = if sine { lines.sin(harmonic as isize) } else { lines.cos(harmonic as isize) };
                residual[f * width + i] = weight(i) * part;
            }
        }
        for Gains { row, open, order, mut samples } in gains {
            let Some(lines) = analyse(&mut samples) else { continue };
            for i in 0..width {
                let (a, test_sine) = (i.div_ceil(2) as isize, i > 0 && i % 2 == 0);
                for j in 0..width {
                    let Some((b, sine, factor)) = differentiated(j, order, now.frequency) else { continue };
                    let product = match (test_sine, sine) {
                        (false, false) => lines.cos(a - b) + lines.cos(a + b),
                        (false, true) => lines.sin(b - a) + lines.sin(a + b),
                        (true, false) => lines.sin(a - b) + lines.sin(a + b),
                        (true, true) => lines.cos(a - b) - lines.cos(a + b),
                    };
                    jacobian[(row * width + i, open * width + j)] += 0.5 * weight(i) * factor * product;
                }
            }
        }
        Ok((residual, jacobian))
    }

    /// The rows, with jumps smoothed over `widths`, and their partial derivatives at the points of a period.
    fn sample(&self, now: &Trajectory, widths: &[f64]) -> Result<Samples, EvalError> {
        let dims = self.model.dims();
        // 1. The motion at all points, and the size of each of its slots.
        let mut motions = now.period(self.points, dims.motion_len());
        let mut sizes = vec![0.0_f64; dims.motion_len()];
        for motion in motions.chunks_exact(dims.motion_len()) {
            for (size, value) in sizes.iter_mut().zip(motion.iter()) {
                *size = size.max(value.abs());
            }
        }
        let mut scratch = vec![0.0; self.model.inverse_workspace_len()];
        let mut force = vec![0.0; dims.rows];
        let mut friction_jump = FrictionJump::new(self.model);
        let mut evaluate = |motion: &mut [f64], force: &mut [f64]| {
            self.model.inverse_dynamics(motion, self.parameters, self.constants, &mut scratch, force)?;
            for (&c, width) in self.dry.iter().zip(widths) {
                let velocity = motion[dims.coordinates + c];
                let spread = (velocity / width).tanh() - Real::sign(velocity);
                let jump = friction_jump.half_jump(self.model, motion, c, self.parameters, self.constants)?;
                for (force, half) in force.iter_mut().zip(jump) {
                    *force += spread * half;
                }
            }
            Ok(())
        };
        // 2. The rows along the motion.
        let mut forces = vec![vec![0.0; self.points]; self.rows.len()];
        for (n, motion) in motions.chunks_exact_mut(dims.motion_len()).enumerate() {
            evaluate(motion, &mut force)?;
            for (forces, &row) in forces.iter_mut().zip(&self.rows) {
                forces[n] = force[row];
            }
        }
        // 3. Their partial derivatives, by difference quotients in every derivative of every open coordinate.
        let mut gains = Vec::new();
        for (open, &c) in self.open.iter().enumerate() {
            for order in 0..=self.model.coordinate_order(c) {
                let slot = order * dims.coordinates + c;
                let step = DIFFERENCE_STEP * if sizes[slot] > 0.0 { sizes[slot] } else { 1.0 };
                let mut samples = vec![vec![0.0; self.points]; self.rows.len()];
                for (n, motion) in motions.chunks_exact_mut(dims.motion_len()).enumerate() {
                    let centre = motion[slot];
                    for (shift, weight) in FIVE_POINT {
                        motion[slot] = centre + shift * step;
                        evaluate(motion, &mut force)?;
                        for (samples, &row) in samples.iter_mut().zip(&self.rows) {
                            samples[n] += weight / (12.0 * step) * force[row];
                        }
                    }
                    motion[slot] = centre;
                }
                gains.extend(samples.into_iter().enumerate().map(|(row, samples)| Gains { row, open, order, samples }));
            }
        }
        Ok(Samples { forces, gains })
    }
}

/// The rows without an input over a period.
struct Samples {
    /// Per row, the values at the points of the period.
    forces: Vec<Vec<f64>>,
    gains: Vec<Gains>,
}

/// Derivative of a row with respect to a derivative of an open coordinate over a period.
struct Gains {
    row: usize,
    open: usize,
    order: usize,
    samples: Vec<f64>,
}

/// Fourier transform of one period of a real signal, divided by the number of points: the means of the signal times
/// cosines and sines.
struct Lines(Vec<Complex<f64>>);

impl Lines {
    /// Mean of the signal times cos(k theta).
    fn cos(&self, k: isize) -> f64 {
        self.0[k.unsigned_abs()].re
    }

    /// Mean of the signal times sin(k theta).
    fn sin(&self, k: isize) -> f64 {
        if k < 0 { self.0[k.unsigned_abs()].im } else { -self.0[k.unsigned_abs()].im }
    }
}

/// Factor from the mean of a signal times a basis function 1, cos, sin, cos 2, sin 2, ... to the Fourier coefficient of
/// that function.
const fn weight(unknown: usize) -> f64 {
    if unknown == 0 { 1.0 } else { 2.0 }
}

/// The derivative of order `order` of an unknown's basis function 1, cos, sin, cos 2, sin 2, ...: its harmonic, whether
/// it is a sine, and its factor. Nothing when the derivative is zero.
fn differentiated(unknown: usize, order: usize, frequency: f64) -> Option<(isize, bool, f64)> {
    let harmonic = unknown.div_ceil(2);
    if harmonic == 0 {
        return (order == 0).then_some((0, false, 1.0));
    }
    // Every derivative is a quarter turn: cos, -sin, -cos, sin.
    let quarter = (order + if unknown % 2 == 1 { 0 } else { 3 }) % 4;
    let sign = if quarter == 1 || quarter == 2 { -1.0 } else { 1.0 };
    Some((harmonic as isize, quarter % 2 == 1, sign * (harmonic as f64 * frequency).powi(order as i32)))
}

#[cfg(test)]
mod tests {
    use super::{CompletionError, OpenReason, complete};
    use crate::trajectory::{HarmonicSeries, Line, Trajectory};
    use tpm_controller::Real;
    use tpm_controller::model::{Dims, EvalError, Label, Model};
    use tpm_test_support::models::TwoCarts;

    fn trajectory() -> Trajectory {
        let lines = [(1, 1.0), (3, -1.0 / 6.0), (5, 1.0 / 50.0)];
        let lines = lines.iter().map(|&(harmonic, a)| Line { harmonic, cos: 0.4 * a, sin: 0.0 }).collect();
        Trajectory { frequency: 4.0, coordinates: vec![HarmonicSeries::default(), HarmonicSeries { mean: 0.1, lines }] }
    }

    #[test]
    fn the_driven_cart_follows_from_the_free_one() {
        // x1 = x2 + m2/k3 x2'' (Feng, Eqn 4.32).
        let mut found = trajectory();
        complete(&TwoCarts, &mut found, &[0], &[2.0, 1.0, 40.0, 300.0, 200.0], &[]).expect("determined");
        assert_eq!(found.highest_harmonic(), 5);
        for i in 0..20 {
            let phase = 0.3 * f64::from(i);
            let [x1, x2, x2_dd] = [(0, 0), (1, 0), (1, 2)].map(|(c, n)| found.coordinates[c].derivative(phase, 4.0, n));
            assert!((x1 - x2 - x2_dd / 200.0).abs() < 1e-14, "{x1} {x2}");
        }
    }

    /// The second cart has dry friction, `m2 x2'' + k3 (x2 - x1) + fc sign(x2') = 0`, and x1 is prescribed.
    #[derive(Clone, Copy, Debug)]
    struct RubbingCart;

    impl Model<f64> for RubbingCart {
        fn name(&self) -> &str {
            "RubbingCart"
        }
        fn dims(&self) -> Dims {
            Dims { parameters: 6, ..Model::<f64>::dims(&TwoCarts) }
        }
        fn coordinate(&self, index: usize) -> Label<'_> {
            Model::<f64>::coordinate(&TwoCarts, index)
        }
        fn input(&self, index: usize) -> Label<'_> {
            Model::<f64>::input(&TwoCarts, index)
        }
        fn parameter(&self, index: usize) -> Label<'_> {
            Label::bare(["m1", "m2", "k1", "k2", "k3", "fc"][index])
        }
        fn constant(&self, _: usize) -> Label<'_> {
            Label::bare("")
        }
        fn row(&self, index: usize) -> Label<'_> {
            Model::<f64>::row(&TwoCarts, index)
        }
        fn workspace_len(&self) -> usize {
            0
        }
        fn regressor(&self, motion: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
            let mut phi = [0.0; 10];
            TwoCarts.regressor(motion, &[], &mut [], &mut phi)?;
            out.fill(0.0);
            out[..5].copy_from_slice(&phi[..5]);
            out[6..11].copy_from_slice(&phi[5..]);
            out[11] = Real::sign(motion[3]);
            Ok(())
        }
        fn known(&self, motion: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
            TwoCarts.known(motion, &[], &mut [], out)
        }
        fn input_map(&self, motion: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
            TwoCarts.input_map(motion, &[], &mut [], out)
        }
    }

    /// The motion of a cart with dry friction agrees with an integration of its equation.
    #[test]
    fn dry_friction_on_the_open_coordinate_is_found() {
        let parameters = [2.0, 1.0, 40.0, 300.0, 200.0, 8.0];
        let lines = vec![Line { harmonic: 1, cos: 0.0, sin: 0.4 }];
        let driven = HarmonicSeries { mean: 0.0, lines };
        let mut found = Trajectory { frequency: 8.0, coordinates: vec![driven.clone(), HarmonicSeries::default()] };
        complete(&RubbingCart, &mut found, &[1], &parameters, &[]).expect("determined");
        // From rest until friction alone has made the motion periodic.
        let steps = 20_000;
        let h = 2.0 * std::f64::consts::PI / 8.0 / f64::from(steps);
        let force = |t: f64, x: f64| 200.0 * (0.4 * (8.0 * t).sin() - x);
        let (mut x, mut v, mut last) = (0.0_f64, 0.0_f64, vec![]);
        for period in 0..60 {
            for n in 0..steps {
                if period == 59 {
                    last.push(x);
                }
                let push = force(f64::from(n) * h, x);
                if v == 0.0 && push.abs() <= 8.0 {
                    continue;
                }
                let side = if v == 0.0 { push.signum() } else { v.signum() };
                let next = v + h * (push - 8.0 * side);
                v = if next * side < 0.0 { 0.0 } else { next };
                x += h * v;
            }
        }
        let peak = last.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
        let off = (0..steps as usize).map(|n| {
            let phase = 2.0 * std::f64::consts::PI * n as f64 / f64::from(steps);
            (found.coordinates[1].derivative(phase, 8.0, 0) - last[n]).abs()
        });
        let off = off.fold(0.0, f64::max);
        // Without friction the cart passes through 0 together with the prescribed cart; friction delays it by a seventh
        // of its amplitude.
        assert!(last[0] < -0.14 * peak && off < 2e-3 * peak, "{off} of {peak}");
    }

    #[test]
    fn what_is_not_determined_is_refused() {
        let reason = |open: &[usize], k3: f64| match complete(
            &TwoCarts,
            &mut trajectory(),
            open,
            &[2.0, 1.0, 40.0, 300.0, k3],
            &[],
        ) {
            Err(CompletionError::Open(reason)) => Some(reason),
            _ => None,
        };
        assert_eq!(reason(&[0], 0.0), Some(OpenReason::Singular));
        assert_eq!(reason(&[0, 1], 200.0), Some(OpenReason::Rows { free: 1, open: 2 }));
        assert_eq!(reason(&[], 200.0), None);
    }
}
