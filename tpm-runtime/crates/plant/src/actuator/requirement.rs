//! The requirements of a motion on a motor: current, voltage and power, per sample and per harmonic, for the two parts
//! of the force.
//!
//! ```text
//! i = (f / ratio + J ratio q'') / k_t ,      u = R i + L i' + k_v ratio q' ,      P = u i
//! ```
//!
//! Invariant: a period is a whole number of even samples; i' is the derivative of its Fourier series, so that it is exact for
//! currents whose harmonics end below half the number of samples. Where they do not (dry friction jumps with the sign
//! of a velocity) [`smooth`] is false, and the inductive voltage at the jumps is not bounded.
//!
//! [`smooth`]: Requirement::smooth

use crate::actuator::demand::{Demand, Parts};
use crate::actuator::motor::{Limit, Motor};
use num_complex::Complex;
use serde::Serialize;
use tpm_motion::TrialError;
use tpm_motion::trajectory::Trajectory;
use tpm_numerics::fourier::{forward, inverse};

/// Approximate number of configurations along a path at which the inertia is evaluated.
const CONFIGURATIONS: usize = 64;

/// Requirements of a motion on a motor at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Sample {
    /// Time since the start of the period, s.
    pub time: f64,
    /// Speed of the rotor, rad/s.
    pub speed: f64,
    /// Current for the motion-independent part, A.
    pub independent: f64,
    /// Current for the motion-dependent part, A.
    pub dependent: f64,
    /// The whole current, A.
    pub current: f64,
    /// Voltage for the motion-independent part, V.
    pub independent_voltage: f64,
    /// The whole voltage, V.
    pub voltage: f64,
    /// Power into the motor, W.
    pub power: f64,
}

/// Requirements of a motion on a motor at one harmonic; phasors X stand for Re X e^{j k w t}.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Harmonic {
    /// Multiple k of the fundamental.
    pub harmonic: usize,
    /// Current for the motion-independent part, A.
    pub independent: Complex<f64>,
    /// Current for the motion-dependent part, A.
    pub dependent: Complex<f64>,
    /// Voltage for the motion-independent part, V.
    pub independent_voltage: Complex<f64>,
    /// Voltage for the motion-dependent part, V.
    pub dependent_voltage: Complex<f64>,
}

/// The largest requirement over a period, with its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Peak {
    /// Kind of the limit.
    pub limit: Limit,
    /// Largest value over the period: of the magnitude for current and voltage, of the signed value for the power.
    pub value: f64,
    /// Time of the largest value since the start of the period, s.
    pub time: f64,
    /// Value of the limit; infinite where there is none.
    pub available: f64,
}

impl Peak {
    /// The requirement as a share of the limit.
    #[must_use]
    pub fn share(&self) -> f64 {
        (self.value / self.available).max(0.0)
    }
}

/// Frequencies at which a motor reaches its limits in a harmonic motion with the coordinate's amplitude and without
/// other forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CutOff {
    /// Inertia J' at the rotor, kg m^2: the largest along the path, which gives the lowest cut-off.
    pub inertia: f64,
    /// The least inertia at the rotor along the path, kg m^2.
    pub least_inertia: f64,
    /// Amplitude of the rotor, rad: half of the coordinate's travel, times the ratio.
    pub amplitude: f64,
    /// Natural frequency of C.9, rad/s.
    pub natural: f64,
    /// Cut-off of C.12, rad/s.
    pub current: f64,
    /// Voltage amplitude at the cut-off, C.13 with the sign corrected, V.
    pub voltage: f64,
}

/// Requirements of one motion on one motor.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Requirement {
    /// Index of the input.
    pub input: usize,
    /// One period of samples.
    pub samples: Vec<Sample>,
    /// Harmonics whose current is above rounding.
    pub harmonics: Vec<Harmonic>,
    /// Mean power into the motor (C.8 for a rotor that stands), W.
    pub average_power: f64,
    /// Mean power that the resistance dissipates, W.
    pub resistive_power: f64,
    /// Largest current, voltage and power.
    pub peaks: [Peak; 3],
    /// Largest force on the coordinate, and the largest steady one at rest.
    pub force: (f64, f64),
    /// Cut-off frequencies; none when the input's coordinate has no inertia of its own, or does not move.
    pub cut_off: Option<CutOff>,
    /// Whether the harmonics end below half the number of samples.
    pub smooth: bool,
}

impl Requirement {
    /// Whether no limit is exceeded.
    #[must_use]
    pub fn feasible(&self) -> bool {
        self.worst().share() <= 1.0
    }

    /// The peak that takes the largest share of its limit.
    #[must_use]
    pub fn worst(&self) -> Peak {
        self.peaks.into_iter().max_by(|a, b| a.share().total_cmp(&b.share())).unwrap_or(self.peaks[0])
    }

    /// Share of the period during which a limit would be exceeded.
    #[must_use]
    pub fn share_of_time(&self, limit: Limit) -> f64 {
        let available = self.peaks.iter().find(|peak| peak.limit == limit).map_or(f64::INFINITY, |peak| peak.available);
        let beyond = |sample: &&Sample| match limit {
            Limit::Current => sample.current.abs() > available,
            Limit::Voltage => sample.voltage.abs() > available,
            Limit::Power => sample.power > available,
        };
        self.samples.iter().filter(beyond).count() as f64 / self.samples.len().max(1) as f64
    }
}

/// Requirements of a motion on every motor.
///
/// # Errors
/// [`TrialError`] when the model cannot be evaluated along the motion.
pub fn requirements(
    demand: &Demand<'_>,
    motors: &[Option<Motor>],
    trajectory: &Trajectory,
    samples: usize,
) -> Result<Vec<Requirement>, TrialError> {
    let parts = demand.along(trajectory, samples)?;
    let mut found = Vec::new();
    for (input, motor) in motors.iter().enumerate() {
        if let (Some(motor), [coordinate]) = (motor, demand.driven(input)) {
            found.push(requirement(demand, &parts, motor, trajectory, (input, *coordinate))?);
        }
    }
    Ok(found)
}

fn requirement(
    demand: &Demand<'_>,
    parts: &Parts,
    motor: &Motor,
    trajectory: &Trajectory,
    (input, coordinate): (usize, usize),
) -> Result<Requirement, TrialError> {
    // 1. Speed and acceleration of the coordinate.
    let dims = demand.model().dims();
    let count = parts.samples;
    let derivative = |order: usize| -> Vec<f64> {
        // The trajectory has this derivative even of a coordinate whose rows end at a lower order.
        let series = trajectory.coordinates.get(coordinate);
        (0..count)
            .map(|i| {
                let phase = 2.0 * std::f64::consts::PI * i as f64 / count as f64;
                series.map_or(0.0, |series| series.derivative(phase, trajectory.frequency, order))
            })
            .collect()
    };
    let (speed, acceleration) = (derivative(1), derivative(2));
    // 2. The currents of the two parts, their harmonics and time derivatives.
    let column = |table: &[f64]| -> Vec<f64> { table.iter().skip(input).step_by(dims.inputs).copied().collect() };
    let (resting, moving) = (column(&parts.independent), column(&parts.dependent));
    let independent: Vec<f64> = resting.iter().map(|&force| motor.current(force, 0.0)).collect();
    let dependent: Vec<f64> =
        moving.iter().zip(&acceleration).map(|(&force, &acceleration)| motor.current(force, acceleration)).collect();
    let w = trajectory.frequency;
    let spectrum = Spectrum { count };
    let (lines_i, rate_i, smooth_i) = spectrum.analyse(&independent, w);
    let (lines_d, rate_d, smooth_d) = spectrum.analyse(&dependent, w);
    let (lines_v, ..) = spectrum.analyse(&speed, w);
    // 3. Current, voltage and power at every sample.
    let period = 2.0 * std::f64::consts::PI / w;
    let samples: Vec<Sample> = (0..count)
        .map(|k| {
            let current = independent[k] + dependent[k];
            let voltage = motor.voltage(current, rate_i[k] + rate_d[k], speed[k]);
            Sample {
                time: period * k as f64 / count as f64,
                speed: motor.ratio * speed[k],
                independent: independent[k],
                dependent: dependent[k],
                current,
                independent_voltage: motor.voltage(independent[k], rate_i[k], 0.0),
                voltage,
                power: current * voltage,
            }
        })
        .collect();
    // 4. Current and voltage of every harmonic.
    let impedance = |k: usize| Complex::new(motor.resistance, motor.inductance * k as f64 * w);
    let emf = motor.back_emf * motor.ratio;
    let all: Vec<Harmonic> = (0..lines_i.len())
        .map(|k| Harmonic {
            harmonic: k,
            independent: lines_i[k],
            dependent: lines_d[k],
            independent_voltage: lines_i[k] * impedance(k),
            dependent_voltage: lines_d[k] * impedance(k) + lines_v[k] * emf,
        })
        .collect();
    let size = |h: &Harmonic| h.independent.norm().max(h.dependent.norm());
    let largest = all.iter().map(size).fold(0.0, f64::max);
    let harmonics = all.into_iter().filter(|h| size(h) > 1e-9 * largest).collect();
    // 5. The largest values over the period, and the cut-off frequencies.
    let peak = |limit: Limit, value: fn(&Sample) -> f64| {
        let values: Vec<f64> = samples.iter().map(value).collect();
        let (value, at) = summit(&values);
        Peak { limit, value, time: period * at / count as f64, available: motor.limits.of(limit) }
    };
    let mean = |value: fn(&Sample) -> f64| samples.iter().map(value).sum::<f64>() / count as f64;
    let travel = trajectory.coordinates.get(coordinate).map_or(0.0, |series| {
        let positions = (0..count)
            .map(|i| series.derivative(2.0 * std::f64::consts::PI * i as f64 / count as f64, trajectory.frequency, 0));
        let (low, high) = positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        (high - low) / 2.0
    });
    let along_path = inertias(demand, input, &parts.motions)?
        .map(|ends| ends.map(|own| motor.rotor_inertia + own / motor.ratio.powi(2)));
    let cut_off = along_path.and_then(|[least_inertia, inertia]| {
        let amplitude = travel * motor.ratio;
        (inertia > 0.0 && amplitude > 0.0).then(|| CutOff {
            inertia,
            least_inertia,
            amplitude,
            natural: motor.natural_frequency(inertia),
            current: motor.cut_off(amplitude, inertia),
            voltage: motor.cut_off_voltage(amplitude, inertia),
        })
    });
    let force = resting.iter().zip(&moving).map(|(a, b)| (a + b).abs()).fold(0.0, f64::max);
    Ok(Requirement {
        input,
        harmonics,
        average_power: mean(|sample| sample.power),
        resistive_power: motor.resistance * mean(|sample| sample.current * sample.current),
        peaks: [
            peak(Limit::Current, |sample| sample.current.abs()),
            peak(Limit::Voltage, |sample| sample.voltage.abs()),
            peak(Limit::Power, |sample| sample.power),
        ],
        force: (force, motor.stall_force()),
        cut_off,
        smooth: smooth_i && smooth_d,
        samples,
    })
}

/// The largest value of a periodic table and its position in samples, interpolated by the parabola through the highest
/// sample and its neighbours.
fn summit(values: &[f64]) -> (f64, f64) {
    let n = values.len();
    let Some(at) = (0..n).max_by(|&a, &b| values[a].total_cmp(&values[b])) else { return (0.0, 0.0) };
    let (left, top, right) = (values[(at + n - 1) % n], values[at], values[(at + 1) % n]);
    let bend = left - 2.0 * top + right;
    // A plateau, or a value that is not finite, is not interpolated.
    if n < 3 || bend >= 0.0 || !bend.is_finite() {
        return (top, at as f64);
    }
    let shift = (0.5 * (left - right) / bend).clamp(-0.5, 0.5);
    (top - 0.25 * (left - right) * shift, (at as f64 + shift).rem_euclid(n as f64))
}

/// Fourier analysis of periods with `count` samples.
struct Spectrum {
    count: usize,
}

impl Spectrum {
    /// Phasors of the harmonics, the time derivative, and whether the harmonics end below half the number of samples.
    fn analyse(&self, values: &[f64], w: f64) -> (Vec<Complex<f64>>, Vec<f64>, bool) {
        let (forward, inverse) = (forward(self.count), inverse(self.count));
        let mut wave = values.to_vec();
        let mut spectrum = forward.make_output_vec();
        forward.process(&mut wave, &mut spectrum).expect("invariant: buffers were made for this transform");
        let n = self.count as f64;
        let lines: Vec<Complex<f64>> =
            spectrum.iter().enumerate().map(|(k, line)| line * if k == 0 { 1.0 / n } else { 2.0 / n }).collect();
        let largest = lines.iter().map(|line| line.norm()).fold(0.0, f64::max);
        let high = lines.iter().skip(lines.len() * 3 / 4).map(|line| line.norm()).fold(0.0, f64::max);
        for (k, line) in spectrum.iter_mut().enumerate() {
            // The line at half the sampling frequency has no phase, so no derivative.
            let factor = if 2 * k == self.count { 0.0 } else { k as f64 * w / n };
            *line *= Complex::new(0.0, factor);
        }
        let mut rate = inverse.make_output_vec();
        inverse.process(&mut spectrum, &mut rate).expect("invariant: the mean's derivative and the last line are 0");
        (lines, rate, high <= 1e-6 * largest)
    }
}

/// The least and the largest inertia at the coordinate that an input drives, at rest in configurations along the
/// motions; nothing where the input does not drive exactly one coordinate.
fn inertias(demand: &Demand<'_>, input: usize, motions: &[f64]) -> Result<Option<[f64; 2]>, TrialError> {
    let dims = demand.model().dims();
    let points = motions.len() / dims.motion_len().max(1);
    let mut ends: Option<[f64; 2]> = None;
    for motion in motions.chunks_exact(dims.motion_len().max(1)).step_by((points / CONFIGURATIONS).max(1)) {
        let at_rest = |(i, &q): (usize, &f64)| if i < dims.coordinates { q } else { 0.0 };
        let rest: Vec<f64> = motion.iter().enumerate().map(at_rest).collect();
        let Some(own) = demand.inertia(input, &rest)? else { return Ok(None) };
        let [least, largest] = ends.unwrap_or([own, own]);
        ends = Some([least.min(own), largest.max(own)]);
    }
    Ok(ends)
}

#[cfg(test)]
mod tests {
    use super::{Demand, Limit, requirements};
    use crate::actuator::demand::tests::feng_6_8;
    use crate::actuator::motor::Motor;
    use crate::actuator::motor::tests::feng;
    use crate::actuator::tests::{CartPendulum, FENG};
    use tpm_motion::trajectory::{HarmonicSeries, Line, Trajectory};
    use tpm_test_support::models::MassSpringDrag;

    fn driven() -> Vec<Vec<usize>> {
        vec![vec![0], vec![1]]
    }

    #[test]
    fn direct_drive_of_the_pendulum_is_infeasible_and_the_best_gear_is_about_28() {
        let demand = Demand::new(&CartPendulum, &FENG, &[], &driven());
        let at = |gear: f64| {
            let motor = Motor { ratio: gear, rotor_inertia: 0.35e-4, ..feng() };
            requirements(&demand, &[None, Some(motor)], &feng_6_8(), 2048).expect("square").remove(0)
        };
        let direct = at(1.0);
        assert!(!direct.feasible());
        assert!((direct.force.0 - 22.0).abs() < 0.5, "wanted {} N m", direct.force.0);
        assert!((direct.force.1 - 1.41).abs() < 5e-3, "available {} N m", direct.force.1);
        let voltage = |gear: f64| at(gear).peaks[1].value;
        let best = (20..=36).min_by(|a, b| voltage(f64::from(*a)).total_cmp(&voltage(f64::from(*b))));
        let best = best.expect("some gear");
        assert!((26..=29).contains(&best), "{best}");
        assert!((voltage(28.0) - voltage(f64::from(best))).abs() < 0.03, "flat about the best");
        assert!((voltage(28.0) - 50.9).abs() < 0.05, "{} V", voltage(28.0));
        // The voltage limit of 50 V is just exceeded, and no other limit.
        let geared = at(28.0);
        assert_eq!((geared.worst().limit, geared.feasible()), (Limit::Voltage, false));
        assert!(geared.peaks[0].share() < 1.0 && geared.peaks[2].share() < 1.0);
        assert!(geared.share_of_time(Limit::Voltage) > 0.0 && geared.share_of_time(Limit::Voltage) < 0.1);
        assert!(geared.smooth);
    }

    #[test]
    fn c15_and_c16_along_a_harmonic_motion_with_a_reaction() {
        // A rotor with its load swings while a second motion's force acts on it: tau and phi at different frequencies.
        let motor = Motor { rotor_inertia: 0.35e-4, ..feng() };
        let (mass, lambda, multiple) = (2e-3, 0.7, 3u32);
        let w = 4.0;
        let line =
            |harmonic: u32, cos: f64| HarmonicSeries { mean: 0.0, lines: vec![Line { harmonic, cos, sin: 0.0 }] };
        let trajectory = Trajectory { frequency: w, coordinates: vec![line(multiple, lambda)] };
        // m x'' + k x: the spring's force is there at rest too, the inertia's is not.
        let stiffness = 0.3;
        let demand = Demand::new(&MassSpringDrag, &[mass, stiffness, 0.0], &[], &[vec![0]]);
        let found = requirements(&demand, &[Some(motor)], &trajectory, 256).expect("square").remove(0);
        let fast = f64::from(multiple) * w;
        let moving = motor.moving(lambda, fast, mass + 0.35e-4);
        let standing = motor.standing(stiffness * lambda, fast);
        let [only] = found.harmonics.as_slice() else { panic!("one harmonic") };
        assert_eq!(only.harmonic, 3);
        assert!((only.dependent.norm() - moving.current).abs() < 1e-12);
        assert!((only.dependent_voltage.norm() - moving.voltage).abs() < 1e-10);
        assert!((only.independent.norm() - standing.current).abs() < 1e-12);
        assert!((only.independent_voltage.norm() - standing.voltage).abs() < 1e-10);
        assert!((found.average_power - found.resistive_power).abs() < 1e-12, "no work over a period");
        let share = motor.standing_power(&[stiffness * lambda]);
        let both = (only.independent + only.dependent).norm();
        assert!((found.resistive_power - both * both * motor.resistance / 2.0).abs() < 1e-12 && share > 0.0);
        let cut = found.cut_off.expect("an inertia");
        assert!((cut.inertia - mass - 0.35e-4).abs() < 1e-12 && (cut.amplitude - lambda).abs() < 1e-3 * lambda);
    }

    #[test]
    fn the_cart_s_motor_is_close_to_its_limits() {
        let demand = Demand::new(&CartPendulum, &FENG, &[], &driven());
        let motor = Motor { ratio: 50.0, ..feng() };
        let cart = requirements(&demand, &[Some(motor), None], &feng_6_8(), 2048).expect("square").remove(0);
        // By hand: forces of 6.6 over k_t / r, voltage with finite differences.
        let (n, h) = (cart.samples.len(), cart.samples[1].time);
        for (i, sample) in cart.samples.iter().enumerate() {
            let (before, after) = (cart.samples[(i + n - 1) % n].current, cart.samples[(i + 1) % n].current);
            let voltage = 4.0 * sample.current + 7.7e-3 * (after - before) / (2.0 * h) + 0.115 * sample.speed;
            assert!((voltage - sample.voltage).abs() < 1e-2, "{voltage} {}", sample.voltage);
            assert!((sample.power - sample.current * sample.voltage).abs() < 1e-12);
        }
        let sums = cart.samples.iter().map(|sample| sample.power).sum::<f64>() / n as f64;
        assert!((sums - cart.average_power).abs() < 1e-9);
        assert!((cart.average_power - cart.resistive_power).abs() < 0.5, "the cart and pendulum only exchange energy");
    }
}
