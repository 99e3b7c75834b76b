//! Stability of a control loop, checked before the machine moves.
//!
//! The rows are linearised at rest at given positions, `x' = A x + B u`, and closed by `u = -Kp e - Kd e'`. Invariant: a loop
//! is called stable only where the poles of the continuous loop lie in the open left half plane and those of the sampled one
//! (zero-order hold, measured, filtered or fitted rates) inside the unit circle. Known lags of the actuators are states of both
//! loops, their delays are states of the sampled loop. A box of parameters is sampled, at vertices, on edges and at random
//! points inside, and reported as sampled.

use crate::regulator::held;
use num_complex::Complex;
use rand::{Rng as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use tpm_controller::control::Differentiator;
use tpm_controller::model::{EvalError, Model};
use tpm_motion::{Loop, TrialError, Velocity, demand};
use tpm_numerics::differences::FIVE_POINT;
use tpm_numerics::eigenvalues::eigenvalues;
use tpm_numerics::{DMatrix, RowDVector, tolerance};

/// Least magnitude of a negative real part that counts as damping, as a share of the largest magnitude of a pole.
const LEAST_DAMPING: f64 = 1e-9;
/// Number of points on every edge of a box, without its vertices.
const EDGE_POINTS: usize = 3;
/// Most sides of a box whose vertices and edges are tried; a box of more sides is sampled inside only.
const MOST_SIDES: usize = 10;
/// Damping ratio below which a mode is hardly damped, so that no harmonic may lie near it.
const LEAST_DAMPING_RATIO: f64 = 0.1;
/// Step of the difference quotients; five points, so exact up to the fourth degree.
const DIFFERENCE_STEP: f64 = 1e-3;

/// A stated range of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Range {
    /// Index of the parameter.
    pub parameter: usize,
    /// Least and largest value of the parameter.
    pub ends: (f64, f64),
}

/// The domain in which a loop must be stable: parameters, their ranges, and positions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StabilityDomain {
    /// The nominal parameters.
    pub nominal: Vec<f64>,
    /// Constants of the model.
    pub constants: Vec<f64>,
    /// Positions at which the rows are linearised, one value per coordinate.
    pub positions: Vec<Vec<f64>>,
    /// The box; parameters without a range keep their nominal value.
    pub ranges: Vec<Range>,
    /// Random points inside the box.
    pub interior: usize,
    /// Seed of the random points.
    pub seed: u64,
}

/// Result of the check over a box of parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct BoxCheck {
    /// Vertices that were tried.
    pub vertices: usize,
    /// Points on edges.
    pub edges: usize,
    /// Points inside.
    pub interior: usize,
    /// Largest real part of a pole at any of these points, 1/s.
    pub slowest: f64,
}

/// A loop that is stable wherever it was tried.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct LoopStability {
    /// Poles (real and imaginary part, 1/s) of the continuous loop with the nominal parameters at the first position; empty
    /// when these leave a highest derivative open (a mass of zero).
    pub poles: Vec<(f64, f64)>,
    /// The sampled box; nothing when none was stated.
    pub sampled: Option<BoxCheck>,
}

/// Why a loop must not be closed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StabilityError {
    /// A pole is not damped.
    #[error("the closed loop is not stable with {parameters}: a pole at {} 1/s{}", complex(*.pole), remedy(.absent))]
    Unstable {
        /// The parameters.
        parameters: String,
        /// The pole.
        pole: (f64, f64),
        /// A term that the characteristic polynomial lacks whatever the gains: its power and the degree.
        absent: Option<(usize, usize)>,
    },
    /// The loop is stable in continuous time, but not in sampled time.
    #[error(
        "the closed loop would be stable in continuous time, but not with samples every {sample_time} s (with {parameters}; a pole of size {size} outside the unit circle): sample faster, lower the gains, or shorten the derivative filter"
    )]
    Sampled {
        /// The parameters.
        parameters: String,
        /// Time between samples, s.
        sample_time: f64,
        /// Size of the largest pole.
        size: f64,
    },
    /// The rows cannot be linearised somewhere in the box.
    #[error("the closed loop cannot be linearised with {parameters}: {source}; keep zero masses out of the box")]
    Undetermined {
        /// The parameters.
        parameters: String,
        /// Why.
        source: EvalError,
    },
}

fn complex((re, im): (f64, f64)) -> String {
    if im.abs() > 0.0 { format!("{re:.3} +- {:.3} j", im.abs()) } else { format!("{re:.3}") }
}

fn remedy(absent: &Option<(usize, usize)>) -> String {
    match absent {
        Some((power, degree)) => format!(
            "; the characteristic polynomial, of degree {degree}, has no s^{power} term{}: no gains of this feedback damp all poles; feed back the driven coordinate (collocated), or more of the state",
            if power + 1 == *degree { ", so that the real parts of the poles sum to zero" } else { "" }
        ),
        None => String::from("; change the gains, and give the feedback a derivative part"),
    }
}

/// Checks a loop at the nominal parameters and over the box.
///
/// # Errors
/// [`StabilityError`] at the first place where it is not stable.
pub fn check(
    model: &dyn Model<f64>,
    control: &Loop,
    demand: &StabilityDomain,
) -> Result<LoopStability, StabilityError> {
    // 1. The nominal parameters at all positions.
    let mut poles = Vec::new();
    for (i, position) in demand.positions.iter().enumerate() {
        match at(model, control, &demand.nominal, demand, position) {
            Ok(found) if i == 0 => poles = found,
            Ok(_) => {}
            // Before the first estimates a mass may be zero, and the loop cannot be linearised; the run itself is then
            // the only check.
            Err(StabilityError::Undetermined { .. }) => break,
            Err(unstable) => return Err(unstable),
        }
    }
    // 2. The points of the box: vertices, points on edges and random points inside, as shares of its sides.
    let mut checked = BoxCheck { vertices: 0, edges: 0, interior: demand.interior, slowest: f64::NEG_INFINITY };
    if demand.ranges.is_empty() {
        return Ok(LoopStability { poles, sampled: None });
    }
    let sides = demand.ranges.len();
    let mut points: Vec<Vec<f64>> = Vec::new();
    if sides <= MOST_SIDES {
        for corner in 0..1_usize << sides {
            let share = |side: usize| if corner >> side & 1 == 1 { 1.0 } else { 0.0 };
            points.push((0..sides).map(share).collect());
        }
        checked.vertices = points.len();
        for along in 0..sides {
            for corner in (0..1_usize << sides).filter(|corner| corner >> along & 1 == 0) {
                for step in 1..=EDGE_POINTS {
                    let mut shares = points[corner].clone();
                    shares[along] = step as f64 / (EDGE_POINTS + 1) as f64;
                    points.push(shares);
                }
            }
        }
        checked.edges = points.len() - checked.vertices;
    }
    let mut random = ChaCha8Rng::seed_from_u64(demand.seed);
    points.extend((0..demand.interior).map(|_| (0..sides).map(|_| random.random::<f64>()).collect()));
    // 3. The loop at every point and position.
    for shares in points {
        let mut parameters = demand.nominal.clone();
        for (range, share) in demand.ranges.iter().zip(shares) {
            parameters[range.parameter] = range.ends.0 + share * (range.ends.1 - range.ends.0);
        }
        for position in &demand.positions {
            for (re, _) in at(model, control, &parameters, demand, position)? {
                checked.slowest = checked.slowest.max(re);
            }
        }
    }
    Ok(LoopStability { poles, sampled: Some(checked) })
}

/// Natural frequencies, rad/s, of the hardly damped modes of the machine without feedback, linearised at rest.
///
/// # Errors
/// [`EvalError`] where the rows cannot be linearised.
pub fn natural_modes(
    model: &dyn Model<f64>,
    parameters: &[f64],
    constants: &[f64],
    position: &[f64],
) -> Result<Vec<f64>, EvalError> {
    let poles = eigenvalues(&Linear::new(model, parameters, constants, position)?.a);
    let mut modes: Vec<f64> = poles
        .into_iter()
        .filter(|pole| pole.im > 0.0 && pole.re.abs() < LEAST_DAMPING_RATIO * pole.norm())
        .map(|pole| pole.norm())
        .collect();
    modes.sort_by(f64::total_cmp);
    Ok(modes)
}

/// Poles of the continuous loop at one point, when continuous and sampled loop are stable there.
fn at(
    model: &dyn Model<f64>,
    control: &Loop,
    parameters: &[f64],
    wanted: &StabilityDomain,
    position: &[f64],
) -> Result<Vec<(f64, f64)>, StabilityError> {
    let named = || {
        let values =
            parameters.iter().enumerate().map(|(j, value)| format!("{} = {value:.6}", model.parameter(j).name));
        values.collect::<Vec<_>>().join(", ")
    };
    let undetermined = |source| StabilityError::Undetermined { parameters: named(), source };
    let plant = Linear::new(model, parameters, &wanted.constants, position).map_err(undetermined)?.behind(control);
    let closed = plant.close(control, (1.0, 1.0)).ok_or_else(|| undetermined(EvalError::Singular { coordinate: 0 }))?;
    let poles = eigenvalues(&closed);
    let largest = poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    let worst =
        poles.iter().copied().fold(Complex::new(f64::NEG_INFINITY, 0.0), |a, b| if b.re > a.re { b } else { a });
    let finite = poles.iter().all(|pole| pole.re.is_finite());
    if !finite || worst.re >= -LEAST_DAMPING * largest {
        let absent = absent_term(&closed, largest).filter(|(power, degree)| {
            // The term is reported only if it is absent with other gains too, and hence whatever the gains.
            [(0.3, 2.0), (4.0, 0.5)].into_iter().all(|gains| {
                plant.close(control, gains).is_some_and(|other| {
                    let size = eigenvalues(&other).iter().map(|pole| pole.norm()).fold(0.0, f64::max);
                    characteristic(&other, size)[*power].abs() < tolerance::COEFFICIENT && other.nrows() == *degree
                })
            })
        });
        return Err(StabilityError::Unstable { parameters: named(), pole: (worst.re, worst.im), absent });
    }
    // Where the machine cannot be discretised the sampled loop has no poles to be judged.
    let inside =
        plant.sampled(control).map_or_else(|| vec![Complex::new(f64::NAN, 0.0)], |sampled| eigenvalues(&sampled));
    let size = inside.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    if inside.iter().any(|pole| !pole.re.is_finite()) || size >= 1.0 {
        return Err(StabilityError::Sampled { parameters: named(), sample_time: control.sample_time, size });
    }
    Ok(poles.iter().map(|pole| (pole.re, pole.im)).collect())
}

/// Coefficients of `det(s - A / scale)`, from s^0 on (Faddeev and LeVerrier).
fn characteristic(matrix: &DMatrix<f64>, scale: f64) -> Vec<f64> {
    let n = matrix.nrows();
    let a = matrix / scale;
    let mut coefficients = vec![0.0; n + 1];
    coefficients[n] = 1.0;
    let mut power: DMatrix<f64> = DMatrix::zeros(n, n);
    for k in 1..=n {
        power = &a * power + DMatrix::identity(n, n) * coefficients[n - k + 1];
        coefficients[n - k] = -(&a * &power).trace() / k as f64;
    }
    coefficients
}

/// The highest power below the degree that is missing in the characteristic polynomial, and the degree; nothing where
/// none is.
fn absent_term(matrix: &DMatrix<f64>, scale: f64) -> Option<(usize, usize)> {
    let coefficients = characteristic(matrix, scale);
    let degree = coefficients.len() - 1;
    (1..degree).rev().find(|&power| coefficients[power].abs() < tolerance::COEFFICIENT).map(|power| (power, degree))
}

/// A machine linearised at rest: states are the derivatives of every coordinate below its highest one.
struct Linear {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    /// First state of every coordinate.
    first: Vec<usize>,
    orders: Vec<usize>,
}

impl Linear {
    fn new(model: &dyn Model<f64>, parameters: &[f64], constants: &[f64], position: &[f64]) -> Result<Self, EvalError> {
        let dims = model.dims();
        let n = dims.coordinates;
        let orders: Vec<usize> = (0..n).map(|c| model.coordinate_order(c)).collect();
        let first: Vec<usize> =
            orders.iter().scan(0, |sum, order| Some(core::mem::replace(sum, *sum + order))).collect();
        let states: usize = orders.iter().sum();
        let mut rest = vec![0.0; dims.motion_len()];
        rest[..n].copy_from_slice(&position[..n]);
        // The inputs that hold the machine at rest at this position.
        let held = match demand(model, &rest, parameters, constants) {
            Ok(held) => held,
            Err(TrialError::Evaluation(fault)) => return Err(fault),
            Err(_) => vec![0.0; dims.inputs],
        };
        // 1. The highest derivatives as a function of motion and inputs, and their partial derivatives.
        let mut workspace = vec![0.0; model.forward_workspace_len()];
        let mut top = |motion: &[f64], inputs: &[f64]| -> Result<Vec<f64>, EvalError> {
            let mut motion = motion.to_vec();
            model.forward_dynamics(&mut motion, parameters, constants, inputs, &mut workspace)?;
            Ok((0..n).map(|c| motion[orders[c] * n + c]).collect())
        };
        let mut slope = |slot: Option<usize>, input: Option<usize>| -> Result<Vec<f64>, EvalError> {
            let mut sum = vec![0.0; n];
            let base = slot.map_or_else(|| input.map_or(0.0, |i| held[i]), |s| rest[s]);
            let step = DIFFERENCE_STEP * base.abs().max(1.0);
            for (shift, weight) in FIVE_POINT {
                let (mut motion, mut inputs) = (rest.clone(), held.clone());
                if let Some(slot) = slot {
                    motion[slot] += shift * step;
                }
                if let Some(input) = input {
                    inputs[input] += shift * step;
                }
                for (sum, value) in sum.iter_mut().zip(top(&motion, &inputs)?) {
                    *sum += weight / (12.0 * step) * value;
                }
            }
            Ok(sum)
        };
        // 2. The matrices of the linear model.
        let (mut a, mut b) = (DMatrix::zeros(states, states), DMatrix::zeros(states, dims.inputs));
        for c in 0..n {
            for order in 0..orders[c] {
                let state = first[c] + order;
                if order + 1 < orders[c] {
                    a[(state, state + 1)] = 1.0;
                }
                for (other, value) in slope(Some(order * n + c), None)?.into_iter().enumerate() {
                    if orders[other] > 0 {
                        a[(first[other] + orders[other] - 1, state)] = value;
                    }
                }
            }
        }
        for input in 0..dims.inputs {
            for (other, value) in slope(None, Some(input))?.into_iter().enumerate() {
                if orders[other] > 0 {
                    b[(first[other] + orders[other] - 1, input)] = value;
                }
            }
        }
        Ok(Linear { a, b, first, orders })
    }

    /// The machine with the lags of its actuators, whose states follow those of the machine.
    fn behind(self, control: &Loop) -> Self {
        let Linear { mut a, mut b, first, orders } = self;
        for input in 0..b.ncols() {
            let Some(lags) = control.actuator(input).lags() else { continue };
            let (states, more, inputs) = (a.nrows(), lags.a.nrows(), b.ncols());
            let force = b.column(input).into_owned();
            a = a.resize(states + more, states + more, 0.0);
            b = b.resize(states + more, inputs, 0.0);
            a.view_mut((states, states), (more, more)).copy_from(&lags.a);
            a.view_mut((0, states + lags.output), (states, 1)).copy_from(&force);
            b.column_mut(input).fill(0.0);
            b.view_mut((states, input), (more, 1)).copy_from(&lags.b);
        }
        Linear { a, b, first, orders }
    }

    /// The loop with ideal rates and all gains times the given factors; nothing when it has no solution.
    fn close(&self, control: &Loop, gains: (f64, f64)) -> Option<DMatrix<f64>> {
        let states = self.a.nrows();
        let mut of_state = self.a.clone();
        let mut of_rate = DMatrix::identity(states, states);
        for gain in &control.gains {
            let position = self.first[gain.coordinate];
            if self.orders[gain.coordinate] == 0 {
                continue;
            }
            for row in 0..states {
                let acts = self.b[(row, gain.input)];
                of_state[(row, position)] -= acts * gains.0 * gain.proportional;
                if self.orders[gain.coordinate] > 1 {
                    of_state[(row, position + 1)] -= acts * gains.1 * gain.derivative;
                } else {
                    // The rate is no state; it is the left-hand side of the row, so that its gain joins the other rates
                    // there.
                    of_rate[(row, position)] += acts * gains.1 * gain.derivative;
                }
            }
        }
        of_rate.lu().solve(&of_state)
    }

    /// State transition of the sampled loop over one sample, with the hold, delays, and measured, filtered or fitted
    /// rates; nothing when a matrix is not finite.
    fn sampled(&self, control: &Loop) -> Option<DMatrix<f64>> {
        let (states, inputs) = (self.a.nrows(), self.b.ncols());
        let (ad, bd) = held(&self.a, &self.b, control.sample_time).ok()?;
        let coordinates = self.first.len();
        // 1. The extended state. The states of the machine are followed, per coordinate, by the last error and the
        // filtered rate, or by the earlier errors to which a polynomial is fitted; then, per input, by its delayed
        // commands, the newest first.
        let fitted = control.velocity.smoothing().map(|smoothing| smoothing.weights(control.sample_time));
        let past = fitted.as_ref().map_or(2, |(value, _)| value.len() - 1);
        // The newest error is the output of the low pass of positions, which depends on the position and on the error
        // before.
        let low_pass = control.position_pole();
        let before = |c: usize| states + if fitted.is_some() { past * c } else { c };
        let newest = |c: usize| [(self.first[c], 1.0 - low_pass), (before(c), low_pass)];
        let delays: Vec<(usize, f64)> =
            (0..inputs).map(|input| control.actuator(input).samples(control.sample_time)).collect();
        let kept = |&(whole, rest): &(usize, f64)| whole + usize::from(rest > 0.0);
        let size = states + past * coordinates + delays.iter().map(kept).sum::<usize>();
        // 2. Error and rate of every coordinate, and the feedback, as rows over the extended state.
        let mut rate = DMatrix::zeros(coordinates, size);
        let mut error: DMatrix<f64> = DMatrix::zeros(coordinates, size);
        for c in (0..coordinates).filter(|&c| self.orders[c] > 0) {
            if fitted.is_none() {
                newest(c).into_iter().for_each(|(at, share)| error[(c, at)] += share);
            }
            match control.velocity {
                Velocity::Measured if self.orders[c] > 1 => rate[(c, self.first[c] + 1)] = 1.0,
                Velocity::Measured => {}
                Velocity::Filtered(time_constant) => {
                    let pole = Differentiator::new(control.sample_time, time_constant).pole();
                    let scale = (1.0 - pole) / control.sample_time;
                    newest(c).into_iter().for_each(|(at, share)| rate[(c, at)] += scale * share);
                    rate[(c, before(c))] -= scale;
                    rate[(c, states + coordinates + c)] = pole;
                }
                Velocity::Fitted(_) => {
                    let Some((value, slope)) = &fitted else { continue };
                    for (i, (value, slope)) in value.iter().zip(slope).enumerate() {
                        let kept = |i: usize| [(states + past * c + i, 1.0), (self.first[c], 0.0)];
                        for (at, share) in i.checked_sub(1).map_or_else(|| newest(c), kept) {
                            error[(c, at)] += value * share;
                            rate[(c, at)] += slope * share;
                        }
                    }
                }
            }
        }
        let mut feedback = DMatrix::zeros(inputs, size);
        for gain in control.gains.iter().filter(|gain| self.orders[gain.coordinate] > 0) {
            for column in 0..size {
                feedback[(gain.input, column)] -= gain.proportional * error[(gain.coordinate, column)];
                feedback[(gain.input, column)] -= gain.derivative * rate[(gain.coordinate, column)];
            }
        }
        // 3. The machine under the delayed commands.
        let mut next = DMatrix::zeros(size, size);
        next.view_mut((0, 0), (states, states)).copy_from(&ad);
        let mut place = states + past * coordinates;
        for (input, delay) in delays.iter().enumerate() {
            let &(whole, rest) = delay;
            // The command that is `age` samples old, as a row over the extended state: the feedback itself, or a
            // delayed command.
            let command = |age: usize| match age.checked_sub(1) {
                None => feedback.row(input).into_owned(),
                Some(back) => RowDVector::from_fn(size, |_, c| if c == place + back { 1.0 } else { 0.0 }),
            };
            // With a delay that is not a whole number of samples the older command acts for the fraction of a sample.
            let newer =
                if rest > 0.0 { held(&self.a, &self.b, control.sample_time - rest).ok()?.1 } else { bd.clone() };
            let acted = newer.column(input) * command(whole);
            let mut rows = next.rows_mut(0, states);
            rows += acted;
            if rest > 0.0 {
                let acted = (bd.column(input) - newer.column(input)) * command(whole + 1);
                rows += acted;
            }
            for age in 0..kept(delay) {
                next.row_mut(place + age).copy_from(&command(age));
            }
            place += kept(delay);
        }
        for c in (0..coordinates).filter(|&c| self.orders[c] > 0) {
            // 4. The newest error is stored, and the earlier errors to which a polynomial is fitted are shifted.
            newest(c).into_iter().for_each(|(from, share)| next[(before(c), from)] = share);
            if fitted.is_some() {
                (1..past).for_each(|i| next[(before(c) + i, before(c) + i - 1)] = 1.0);
            }
            if matches!(control.velocity, Velocity::Filtered(_)) {
                for column in 0..size {
                    next[(states + coordinates + c, column)] = rate[(c, column)];
                }
            }
        }
        Some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::{Range, StabilityDomain, StabilityError, characteristic, check, natural_modes};
    use tpm_controller::control::Gain;
    use tpm_motion::{HoldCompensation, Loop, Velocity};
    use tpm_numerics::DMatrix;
    use tpm_test_support::models::TwoCarts;

    const CHAIN: [f64; 5] = [2.0, 1.0, 40.0, 300.0, 200.0];

    fn control(gains: &[(usize, f64, f64)], velocity: Velocity, sample_time: f64) -> Loop {
        let gain = |&(coordinate, proportional, derivative)| Gain { input: 0, coordinate, proportional, derivative };
        Loop {
            sample_time,
            gains: gains.iter().map(gain).collect(),
            velocity,
            position_filter: 0.0,
            compensation: HoldCompensation::Exact,
            actuators: vec![],
        }
    }

    fn demand() -> StabilityDomain {
        StabilityDomain {
            nominal: CHAIN.to_vec(),
            positions: vec![vec![0.0; 2]],
            interior: 1000,
            seed: 1,
            ..StabilityDomain::default()
        }
    }

    #[test]
    fn delays_and_lags_count_where_the_phase_says() {
        use tpm_motion::Dynamics;
        use tpm_motion::LowPass;
        use tpm_test_support::models::MassSpringDrag;
        // A mass with PD: |L| = 1 where m w^2 = |kp + j kd w|, and the phase left there is atan(kd w / kp).
        let (mass, kp, kd, sample_time) = (2.0_f64, 2000.0_f64, 120.0_f64, 1e-4);
        let crossing = |w: f64| mass * w * w - kp.hypot(kd * w);
        let (mut low, mut high) = (1.0, 1e3);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if crossing(middle) < 0.0 { low = middle } else { high = middle }
        }
        let phase = (kd * low / kp).atan();
        let demand =
            StabilityDomain { nominal: vec![mass, 0.0, 0.0], positions: vec![vec![0.0]], ..StabilityDomain::default() };
        let stable = |dynamics: Dynamics| {
            let control =
                Loop { actuators: vec![dynamics], ..control(&[(0, kp, kd)], Velocity::Measured, sample_time) };
            check(&MassSpringDrag, &control, &demand).map(|_| ())
        };
        // The hold is half a sample of delay.
        let most = phase / low - 0.5 * sample_time;
        for share in [0.0, 0.5, 0.99] {
            assert_eq!(stable(Dynamics { delay: share * most, ..Dynamics::default() }), Ok(()), "{share}");
        }
        let late = stable(Dynamics { delay: 1.01 * most, ..Dynamics::default() });
        assert!(matches!(late, Err(StabilityError::Sampled { .. })), "{late:?}");
        // A lag alone is judged in continuous time too: of a slow filter the loop is not stable.
        let filter = |natural_frequency| Dynamics {
            filter: Some(LowPass { natural_frequency, quality: 1.0 }),
            bandwidth: Some(500.0),
            ..Dynamics::default()
        };
        assert_eq!(stable(filter(400.0)), Ok(()));
        assert!(matches!(stable(filter(40.0)), Err(StabilityError::Unstable { .. })));
    }

    #[test]
    fn a_low_pass_of_positions_counts_as_routh_says() {
        use tpm_motion::smoothing::Smoothing;
        use tpm_test_support::models::MassSpringDrag;
        // m s^2 (1 + tau s) + kd s + kp has its roots in the left half plane where tau < kd / kp; at this sample time
        // the sampling has little effect.
        let (mass, kp, kd, sample_time) = (2.0, 2000.0, 120.0, 1e-4);
        let demand =
            StabilityDomain { nominal: vec![mass, 0.0, 0.0], positions: vec![vec![0.0]], ..StabilityDomain::default() };
        let stable = |velocity: Velocity, position_filter: f64| {
            let control = Loop { position_filter, ..control(&[(0, kp, kd)], velocity, sample_time) };
            check(&MassSpringDrag, &control, &demand).map(|_| ())
        };
        let fitted = Velocity::Fitted(Smoothing { samples: 4, degree: 2 });
        for velocity in [Velocity::Filtered(0.0), fitted] {
            assert_eq!(stable(velocity, 0.97 * kd / kp), Ok(()), "{velocity:?}");
            let late = stable(velocity, 1.01 * kd / kp);
            assert!(matches!(late, Err(StabilityError::Sampled { .. })), "{velocity:?}: {late:?}");
        }
        // A measured rate bypasses the filter, and damps the loop however slow the filter is.
        assert_eq!(stable(Velocity::Measured, 10.0 * kd / kp), Ok(()));
    }

    #[test]
    fn polynomials_come_from_their_matrices() {
        let companion = DMatrix::from_row_slice(3, 3, &[0.0, 1.0, 0.0, 0.0, 0.0, 1.0, -6.0, -11.0, -5.0]);
        for (found, expected) in characteristic(&companion, 1.0).iter().zip([6.0, 11.0, 5.0, 1.0]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn natural_modes_are_those_of_the_machine_alone() {
        // Plants, B: 3.61 and 17.5 rad/s, the roots of det(K - w^2 M).
        let modes = natural_modes(&TwoCarts, &CHAIN, &[], &[0.0, 0.0]).expect("regular");
        assert_eq!(modes.len(), 2);
        for mode in modes {
            let square = mode * mode;
            assert!(((240.0 - 2.0 * square) * (200.0 - square) - 40_000.0).abs() < 1e-4, "{mode}");
        }
        assert!(natural_modes(&TwoCarts, &[0.0; 5], &[], &[0.0, 0.0]).is_err());
    }

    #[test]
    fn collocated_feedback_is_stable_all_over_the_box() {
        let control = control(&[(0, 400.0, 40.0)], Velocity::Filtered(2e-3), 1e-3);
        let mut demand = demand();
        demand.ranges =
            CHAIN.iter().enumerate().map(|(parameter, v)| Range { parameter, ends: (0.5 * v, 2.0 * v) }).collect();
        let found = check(&TwoCarts, &control, &demand).expect("stable");
        let sampled = found.sampled.expect("a box was stated");
        assert_eq!((sampled.vertices, sampled.edges, sampled.interior), (32, 240, 1000));
        assert!(sampled.slowest < 0.0);
        // The slowest pole at the nominal parameters decays with -3.4 1/s.
        let slowest = found.poles.iter().map(|pole| pole.0).fold(f64::NEG_INFINITY, f64::max);
        assert!((slowest + 3.4).abs() < 0.1, "{:?}", found.poles);
        // Each pole is a root of (m1 s^2 + Kd s + k1 + k3 + Kp)(m2 s^2 + k3) - k3^2.
        for &(re, im) in &found.poles {
            let s = num_complex::Complex::new(re, im);
            let value = (s * s * 2.0 + s * 40.0 + 640.0) * (s * s + 200.0) - 200.0 * 200.0;
            assert!(value.norm() < 1e-6 * s.norm().powi(4).max(1e4), "{s}: {value}");
        }
    }

    #[test]
    fn feedback_of_the_far_cart_is_refused_with_its_reason() {
        // c1 s^4 + c2 s^2 + Kd s + (c6 + Kp) has no s^3.
        for (kp, kd) in [(20.0, 1.0), (400.0, 40.0), (5.0, 0.01)] {
            let refused = check(&TwoCarts, &control(&[(1, kp, kd)], Velocity::Measured, 1e-3), &demand());
            match refused {
                Err(StabilityError::Unstable { absent, pole, .. }) => {
                    assert_eq!(absent, Some((3, 4)));
                    assert!(pole.0 > 0.0);
                }
                other => panic!("{other:?}"),
            }
        }
        let refused = check(&TwoCarts, &control(&[(1, 20.0, 5.0)], Velocity::Measured, 1e-3), &demand());
        let text = refused.expect_err("unstable").to_string();
        assert!(text.contains("no s^3 term") && text.contains("m1 = 2"), "{text}");
    }

    #[test]
    fn all_states_fed_back_can_be_stable_and_samples_can_spoil_it() {
        let both = [(0, 350.0, 35.0), (1, 40.0, 6.0)];
        check(&TwoCarts, &control(&both, Velocity::Measured, 1e-3), &demand()).expect("stable");
        let coarse = check(&TwoCarts, &control(&[(0, 400.0, 400.0)], Velocity::Measured, 0.02), &demand());
        assert!(matches!(coarse, Err(StabilityError::Sampled { .. })), "{coarse:?}");
        // Without damping nothing decays.
        let undamped = check(&TwoCarts, &control(&[(0, 400.0, 0.0)], Velocity::Measured, 1e-3), &demand());
        assert!(matches!(undamped, Err(StabilityError::Unstable { .. })), "{undamped:?}");
        // Without a mass the nominal loop is not checked, and in a box it is a fault.
        let mut massless = demand();
        massless.nominal = vec![0.0; 5];
        let found = check(&TwoCarts, &control(&both, Velocity::Measured, 1e-3), &massless).expect("nothing to check");
        assert!(found.poles.is_empty());
        massless.ranges = vec![Range { parameter: 0, ends: (0.0, 1.0) }];
        let refused = check(&TwoCarts, &control(&both, Velocity::Measured, 1e-3), &massless);
        assert!(matches!(refused, Err(StabilityError::Undetermined { .. })));
    }
}
