//! A permanent-magnet motor with its gear or rack and its amplifier.
//!
//! ```text
//! k_t i = tau_m + J' phi''              (Feng, Eqn C.1)       torque of the current against load and inertia
//! u     = R i + L i' + k_v phi'         (Feng, Eqn C.2)       voltage across the armature
//! |i| <= I_max ,   |u| <= U_max ,   u i <= P_max               (Feng, Eqns C.3, C.4, and the amplifier's peak power)
//! ```
//!
//! Invariant: all quantities are SI; a rotor turns `ratio` radians while the driven coordinate moves by one of its units (rad
//! or m), so that a force f of the coordinate is f / ratio at the rotor. `rotor_inertia` is the inertia that the model of the
//! machine does not contain already. Motoring power counts against the power limit, regenerated power does not.
//!
//! Corrections to the printed formulas: C.11 lacks a sign (k_t I_max cos = -J' lambda w^2 cos), which changes no
//! amplitude. C.13 and C.16 have a plus where inductance and back-EMF oppose each other, because the current of an
//! inertia is opposite in phase to its position (see [`Motor::cut_off_voltage`] and [`Motor::moving_voltage`]).

use tpm_motion::LowPass;

/// Limits of a motor and its amplifier; infinite where there is no limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest magnitude of the current I_max, A.
    pub current: f64,
    /// Largest magnitude of the voltage U_max, V.
    pub voltage: f64,
    /// Largest power into the motor P_max, W.
    pub power: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { current: f64::INFINITY, voltage: f64::INFINITY, power: f64::INFINITY }
    }
}

/// Bandwidth of the current loop and of the filter before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amplifier {
    /// Bandwidth of the current loop, rad/s: without limits L i' = L w (i_wanted - i), so that i follows as a first-order lag.
    pub bandwidth: f64,
    /// Low pass of the command, when there is one.
    pub filter: Option<LowPass>,
}

/// A motor on one input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// Torque constant k_t, N m/A.
    pub torque_constant: f64,
    /// Back-EMF constant k_v, V s/rad.
    pub back_emf: f64,
    /// Armature resistance R, ohm.
    pub resistance: f64,
    /// Armature inductance L, H.
    pub inductance: f64,
    /// Inertia of the rotor that the machine's model does not contain, kg m^2.
    pub rotor_inertia: f64,
    /// Radians of the rotor per unit of the driven coordinate: the gear's ratio, or 1 over the pinion's radius.
    pub ratio: f64,
    /// Limits of motor and amplifier.
    pub limits: Limits,
    /// Dynamics of the amplifier.
    pub amplifier: Amplifier,
}

/// A kind of limit of motor and amplifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Limit {
    /// |i| <= I_max.
    Current,
    /// |u| <= U_max.
    Voltage,
    /// u i <= P_max.
    Power,
}

impl Limit {
    /// Name and unit of the limit.
    #[must_use]
    pub const fn name_and_unit(self) -> (&'static str, &'static str) {
        match self {
            Limit::Current => ("current", "A"),
            Limit::Voltage => ("voltage", "V"),
            Limit::Power => ("power", "W"),
        }
    }
}

impl Limits {
    /// The value of one limit.
    #[must_use]
    pub const fn of(&self, limit: Limit) -> f64 {
        match limit {
            Limit::Current => self.current,
            Limit::Voltage => self.voltage,
            Limit::Power => self.power,
        }
    }
}

/// Current and voltage amplitudes of one harmonic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amplitudes {
    /// Amplitude of the current, A.
    pub current: f64,
    /// Amplitude of the voltage, V.
    pub voltage: f64,
}

impl Motor {
    /// Force on the coordinate that a current gives, before the rotor's own inertia.
    #[must_use]
    pub fn force(&self, current: f64) -> f64 {
        self.torque_constant * self.ratio * current
    }

    /// Current for a force on the coordinate while it accelerates (C.1).
    #[must_use]
    pub fn current(&self, force: f64, acceleration: f64) -> f64 {
        (force / self.ratio + self.rotor_inertia * self.ratio * acceleration) / self.torque_constant
    }

    /// Voltage for a current, its rate, and the speed of the coordinate (C.2).
    #[must_use]
    pub fn voltage(&self, current: f64, rate: f64, speed: f64) -> f64 {
        self.resistance * current + self.inductance * rate + self.back_emf * self.ratio * speed
    }

    /// Largest steady force at rest.
    #[must_use]
    pub fn stall_force(&self) -> f64 {
        self.force_at(0.0)
    }

    /// Largest force at a speed of the coordinate, by current, steady voltage and power, in the direction of `speed`.
    #[must_use]
    pub fn force_at(&self, speed: f64) -> f64 {
        let emf = self.back_emf * self.ratio * speed.abs();
        let by_voltage = (self.limits.voltage - emf) / self.resistance;
        let by_power = if self.limits.power.is_finite() {
            // R i^2 + emf i = P
            2.0 * self.limits.power / (emf + (emf * emf + 4.0 * self.resistance * self.limits.power).sqrt())
        } else {
            f64::INFINITY
        };
        self.force(self.limits.current.min(by_voltage).min(by_power).max(0.0))
    }

    /// Amplitudes for a torque of amplitude `torque` and frequency w (rad/s) at a rotor that stands (C.5, C.6).
    #[must_use]
    pub fn standing(&self, torque: f64, w: f64) -> Amplitudes {
        let current = torque.abs() / self.torque_constant;
        Amplitudes { current, voltage: current * self.resistance.hypot(self.inductance * w) }
    }

    /// Mean power of torques of these amplitudes at a rotor that stands: sum of I^2 R / 2 (C.8).
    #[must_use]
    pub fn standing_power(&self, torques: &[f64]) -> f64 {
        torques.iter().map(|torque| (torque / self.torque_constant).powi(2) * self.resistance / 2.0).sum()
    }

    /// Natural frequency of speed over voltage without resistance, K / sqrt(L J') with K^2 = k_t k_v (C.9); rad/s.
    #[must_use]
    pub fn natural_frequency(&self, inertia: f64) -> f64 {
        (self.torque_constant * self.back_emf / (self.inductance * inertia)).sqrt()
    }

    /// Highest frequency at which the current limit allows the rotor an amplitude `lambda` (rad) against the inertia J' alone,
    /// sqrt(k_t I_max / (lambda J')) (C.12); rad/s.
    #[must_use]
    pub fn cut_off(&self, lambda: f64, inertia: f64) -> f64 {
        (self.torque_constant * self.limits.current / (lambda.abs() * inertia)).sqrt()
    }

    /// Amplitude of the voltage at the [cut-off frequency](Self::cut_off) (C.13, corrected):
    ///
    /// ```text
    /// |u|^2 = I_max^2 R^2 + (L I_max - k_v lambda)^2 w_c^2
    /// ```
    ///
    /// Printed is L I_max + k_v lambda; but phi = lambda cos(w t) takes the current -I_max cos(w t), whose inductive voltage
    /// L I_max w sin(w t) opposes the back-EMF -k_v lambda w sin(w t).
    #[must_use]
    pub fn cut_off_voltage(&self, lambda: f64, inertia: f64) -> f64 {
        let current = self.limits.current;
        let reactive = (self.inductance * current - self.back_emf * lambda.abs()) * self.cut_off(lambda, inertia);
        (current * self.resistance).hypot(reactive)
    }

    /// Amplitudes for a motion of the rotor of amplitude `lambda` (rad) at w against the inertia J' (first terms of C.15 and of
    /// C.16, corrected):
    ///
    /// ```text
    /// i: J' lambda w^2 / k_t          u: lambda w / k_t sqrt(J'^2 w^2 R^2 + (J' w^2 L - k_t k_v)^2)
    /// ```
    ///
    /// Printed is J' w^2 L + k_t k_v, as in C.13.
    #[must_use]
    pub fn moving(&self, lambda: f64, w: f64, inertia: f64) -> Amplitudes {
        Amplitudes {
            current: inertia * lambda.abs() * w * w / self.torque_constant,
            voltage: self.moving_voltage(lambda, w, inertia),
        }
    }

    /// The voltage amplitude of [`moving`](Self::moving).
    #[must_use]
    pub fn moving_voltage(&self, lambda: f64, w: f64, inertia: f64) -> f64 {
        let reactive = inertia * w * w * self.inductance - self.torque_constant * self.back_emf;
        lambda.abs() * w / self.torque_constant * (inertia * w * self.resistance).hypot(reactive)
    }

    /// The voltage that the amplifier applies for a wanted current, and which of the limits of current, voltage and
    /// power cut it. The wanted current is cut at its limit. The voltage compensates resistance and back-EMF and drives
    /// the current towards the wanted one, within the limits of voltage and power.
    #[must_use]
    pub fn drive(&self, wanted: f64, current: f64, speed: f64) -> (f64, [bool; 3]) {
        let limits = self.limits;
        let cut = wanted.clamp(-limits.current, limits.current);
        let rate = self.amplifier.bandwidth * (cut - current);
        let asked = self.voltage(cut, rate, speed);
        let mut voltage = asked.clamp(-limits.voltage, limits.voltage);
        let in_voltage = voltage != asked;
        let in_power = voltage * current > limits.power;
        if in_power {
            voltage = limits.power / current;
        }
        (voltage, [cut != wanted, in_voltage, in_power])
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::{Amplifier, Limits, Motor};
    use std::f64::consts::TAU;
    use tpm_motion::LowPass;

    /// The motor of Feng, section 6.3 and `cart_pendulum` rig: 12.3 A, 50 V, 600 W; ratio 1.
    pub(crate) fn feng() -> Motor {
        Motor {
            torque_constant: 0.115,
            back_emf: 0.115,
            resistance: 4.0,
            inductance: 7.7e-3,
            rotor_inertia: 0.0,
            ratio: 1.0,
            limits: Limits { current: 12.3, voltage: 50.0, power: 600.0 },
            amplifier: Amplifier { bandwidth: 2000.0, filter: None },
        }
    }

    /// Runge-Kutta steps of y' = f(t, y).
    fn integrate<const N: usize>(
        mut y: [f64; N],
        duration: f64,
        steps: usize,
        f: impl Fn(f64, &[f64; N]) -> [f64; N],
        mut at: impl FnMut(f64, &[f64; N]),
    ) {
        let h = duration / steps as f64;
        let shifted = |y: &[f64; N], k: &[f64; N], s: f64| std::array::from_fn(|i| y[i] + s * k[i]);
        for n in 0..steps {
            let t = n as f64 * h;
            let k1 = f(t, &y);
            let k2 = f(t + h / 2.0, &shifted(&y, &k1, h / 2.0));
            let k3 = f(t + h / 2.0, &shifted(&y, &k2, h / 2.0));
            let k4 = f(t + h, &shifted(&y, &k3, h));
            y = std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
            at(t + h, &y);
        }
    }

    /// Amplitude of the harmonic at w of a signal sampled over whole periods.
    fn amplitude(samples: &[(f64, f64)], w: f64) -> f64 {
        let n = samples.len() as f64;
        let (c, s) = samples.iter().fold((0.0, 0.0), |(c, s), (t, v)| (c + v * (w * t).cos(), s + v * (w * t).sin()));
        2.0 / n * f64::hypot(c, s)
    }

    fn close(found: f64, expected: f64, relative: f64) {
        assert!((found - expected).abs() <= relative * expected.abs(), "{found} is not {expected}");
    }

    #[test]
    fn a_standing_motor_needs_what_c5_to_c8_say() {
        // Brute force: the current of a locked rotor under u of C.6's amplitude, from C.2 with phi' = 0.
        let motor = feng();
        let mut total = 0.0;
        for (torque, w) in [(0.8, 30.0), (0.5, 90.0), (0.2, 400.0)] {
            let needed = motor.standing(torque, w);
            let mut seen = Vec::new();
            let mut energy = 0.0;
            let (periods, steps) = (12.0, 24_000);
            let duration = periods * TAU / w;
            let voltage = |t: f64| needed.voltage * (w * t).cos();
            let half = duration / 2.0;
            integrate(
                [0.0],
                duration,
                steps,
                |t, y: &[f64; 1]| [(voltage(t) - motor.resistance * y[0]) / motor.inductance],
                |t, y| {
                    if t > half + 1e-12 {
                        seen.push((t, motor.torque_constant * y[0]));
                        energy += voltage(t) * y[0] * duration / steps as f64;
                    }
                },
            );
            close(amplitude(&seen, w), torque, 1e-6);
            let power = motor.standing_power(&[torque]);
            // Over whole periods the integral of C.7 is the energy dissipated in the resistance.
            close(energy / half, power, 1e-5);
            total += power;
        }
        close(motor.standing_power(&[0.8, 0.5, 0.2]), total, 1e-15);
    }

    #[test]
    fn c9_is_the_resonance_of_speed_over_voltage_without_resistance() {
        let motor = Motor { resistance: 0.0, ..feng() };
        let inertia = 4.4e-3;
        let natural = motor.natural_frequency(inertia);
        close(natural, 0.115 / (7.7e-3_f64 * 4.4e-3).sqrt(), 1e-14);
        for share in [0.3, 0.8, 1.5] {
            let w = share * natural;
            // Started on the periodic solution, phi' = A cos(w t), k_t i = J' phi''.
            let gain = 1.0 / (1.0 - share * share) / motor.back_emf;
            let mut seen = Vec::new();
            integrate(
                [gain, 0.0],
                3.0 * TAU / w,
                6000,
                |t, y: &[f64; 2]| {
                    let voltage = (w * t).cos();
                    [motor.torque_constant * y[1] / inertia, (voltage - motor.back_emf * y[0]) / motor.inductance]
                },
                |t, y| seen.push((t, y[0])),
            );
            close(amplitude(&seen, w), gain.abs(), 1e-8);
        }
    }

    /// Voltage amplitude that moves the rotor by lambda cos(w t) against J', by simulation: a unit voltage's amplitude, inverted.
    fn simulated(motor: &Motor, lambda: f64, w: f64, inertia: f64) -> (f64, f64) {
        let (mut angle, mut current) = (Vec::new(), Vec::new());
        let periods = (30.0 * (motor.resistance * inertia / (motor.torque_constant * motor.back_emf)) * w / TAU).ceil();
        let last = (periods + 2.0) * TAU / w;
        // Whole steps in a period, so that a window of whole periods has no leakage.
        let per_period = (TAU / w * f64::max(w * 300.0, 10.0 * motor.resistance / motor.inductance)).ceil();
        let steps = ((periods + 2.0) * per_period) as usize;
        integrate(
            [0.0, 0.0, 0.0],
            last,
            steps,
            |t, y: &[f64; 3]| {
                let voltage = (w * t).cos();
                let rate = (voltage - motor.resistance * y[2] - motor.back_emf * y[1]) / motor.inductance;
                [y[1], motor.torque_constant * y[2] / inertia, rate]
            },
            |t, y| {
                if t > last - 2.0 * TAU / w + 0.5 * last / steps as f64 {
                    angle.push((t, y[0]));
                    current.push((t, y[2]));
                }
            },
        );
        let scale = lambda / amplitude(&angle, w);
        (scale, scale * amplitude(&current, w))
    }

    #[test]
    fn c12_c13_and_c16_with_the_right_signs() {
        let motor = feng();
        // Cart: J' = J + (M + m) r^2, lambda = .1/r; pendulum: J' = J + m L^2/N^2 with N = 20, lambda = .6 N; the rotor alone.
        let j = 0.35e-4;
        let cart = (5.0, j + 11.0 * 0.02 * 0.02);
        let pendulum = (12.0, j + 0.16 / 400.0);
        let rotor = (1.0, j);
        close(motor.cut_off(cart.0, cart.1), 7.99, 1e-3);
        close(motor.cut_off(pendulum.0, pendulum.1), 16.46, 1e-3);
        close(motor.cut_off(rotor.0, rotor.1), 201.0, 1e-3);
        for ((lambda, inertia), volts, printed) in [(cart, 49.35, 49.49), (rotor, 49.37, 64.79)] {
            let w = motor.cut_off(lambda, inertia);
            let found = motor.cut_off_voltage(lambda, inertia);
            assert!((found - volts).abs() < 5e-3, "{found}");
            let plus = (motor.inductance * 12.3 + motor.back_emf * lambda) * w;
            assert!(((12.3 * motor.resistance).hypot(plus) - printed).abs() < 5e-3, "the printed sign");
            // C.11 and C.13 by simulation, and C.16 at the same point.
            let (voltage, current) = simulated(&motor, lambda, w, inertia);
            close(voltage, found, 1e-5);
            close(current, 12.3, 1e-5);
            close(motor.moving_voltage(lambda, w, inertia), found, 1e-12);
        }
        for (lambda, w, inertia) in [(0.5, 40.0, 1e-4), (3.0, 9.0, 2e-3), (0.05, 300.0, 5e-5)] {
            let (voltage, current) = simulated(&motor, lambda, w, inertia);
            let needed = motor.moving(lambda, w, inertia);
            close(voltage, needed.voltage, 1e-5);
            close(current, needed.current, 1e-5);
        }
    }

    #[test]
    fn force_limits_over_speed() {
        let motor = Motor { ratio: 50.0, ..feng() };
        // 12.3 A through 4 ohm would take 605 W.
        close(motor.stall_force(), 0.115 * 50.0 * 150.0_f64.sqrt(), 1e-12);
        let unpowered = Motor { limits: Limits { power: f64::INFINITY, ..motor.limits }, ..motor };
        close(unpowered.stall_force(), 0.115 * 50.0 * 12.3, 1e-12);
        // 50 V hold k_v phi' = 50 - R i.
        let speed = (50.0 - 4.0 * 6.0) / (0.115 * 50.0);
        close(motor.force_at(speed), 0.115 * 50.0 * 6.0, 1e-12);
        assert_eq!(motor.force_at(10.0), 0.0);
        let weak = Motor { limits: Limits { power: 100.0, ..motor.limits }, ..motor };
        let current = weak.force_at(1.0) / (0.115 * 50.0);
        close(current * (4.0 * current + 0.115 * 50.0), 100.0, 1e-12);
        let (voltage, cut) = weak.drive(30.0, 5.0, 0.0);
        assert_eq!((voltage, cut), (20.0, [true, true, true]));
    }

    #[test]
    fn the_low_pass_has_its_response() {
        let filter = LowPass { natural_frequency: 100.0, quality: 1.0 };
        let (re, im) = filter.response(100.0);
        assert!((re.abs() < 1e-15) && (im + 1.0).abs() < 1e-15);
        let w = 70.0;
        let mut seen = Vec::new();
        let last = 40.0 * TAU / w;
        integrate(
            [0.0, 0.0],
            last,
            40_000,
            |t, y: &[f64; 2]| {
                let (value, rate) = filter.rates((w * t).cos(), y[0], y[1]);
                [value, rate]
            },
            |t, y| {
                if t > 0.5 * last + 1e-9 {
                    seen.push((t, y[0]));
                }
            },
        );
        let (re, im) = filter.response(w);
        close(amplitude(&seen, w), re.hypot(im), 1e-7);
    }
}
