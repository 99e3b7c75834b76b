//! A limited actuator of any kind, hydraulic, pneumatic or electric: a largest force, speed and power, and a bandwidth.
//!
//! Invariant: force and speed are those at the coordinate. The actuator brakes with its whole force. It drives with at
//! most the force that its power allows at the speed, and not at all beyond its largest speed. The use of the limits is
//! computed from one period of force and motion, given by their phasors from the mean on, by the same rule for planned
//! and for measured runs.

use crate::actuator::mounted::{LimitUse, strongest};
use num_complex::Complex;
use tpm_controller::model::Model;
use tpm_numerics::fourier::synthesise;

/// Least amplitude of a harmonic of the force that must lie within the bandwidth, as a share of the strongest one.
const LEAST_HARMONIC: f64 = 0.01;

/// Limits of an actuator, infinite where there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limited {
    /// Index of the coordinate that the actuator moves.
    pub coordinate: usize,
    /// Largest magnitude of the force, unit of the input.
    pub force: f64,
    /// Largest magnitude of the speed, unit of the coordinate per second.
    pub speed: f64,
    /// Largest power into the machine, force times speed.
    pub power: f64,
    /// Highest angular frequency that the force follows, rad/s.
    pub bandwidth: f64,
}

impl Limited {
    /// The force that is applied for a wanted one while the coordinate moves at a speed.
    #[must_use]
    pub fn applied(&self, wanted: f64, speed: f64) -> f64 {
        let most = if wanted * speed <= 0.0 {
            self.force
        } else if speed.abs() >= self.speed {
            0.0
        } else {
            self.force.min(self.power / speed.abs())
        };
        wanted.clamp(-most, most)
    }

    /// The limit of which a motion uses the largest share: `force` and `motion` are the phasors of an input and of the
    /// coordinate, `fundamental` is in rad/s, and a period has `samples` samples.
    #[must_use]
    pub fn used(
        &self,
        model: &dyn Model<f64>,
        input: usize,
        (force, motion): (&[Complex<f64>], &[Complex<f64>]),
        fundamental: f64,
        samples: usize,
    ) -> LimitUse {
        // 1. The units of force, speed and power.
        let (label, moved) = (model.input(input), model.coordinate(self.coordinate));
        let rate = |unit: &str| format!("{unit}/s");
        let units: [Option<String>; 3] = [
            label.unit.map(ToString::to_string),
            moved.unit.map(rate),
            label.unit.zip(moved.unit).map(|(force, way)| rate(&format!("{force}*{way}"))),
        ];
        // 2. Force and speed over a period, and the largest share of a limit.
        let turn = |k: usize| Complex::new(0.0, k as f64 * fundamental);
        let speed: Vec<Complex<f64>> = motion.iter().enumerate().map(|(k, line)| turn(k) * line).collect();
        let course = |lines: &[Complex<f64>]| synthesise(lines, 0, fundamental, lines.len(), samples);
        let (mut most, mut found) = (0.0, (0, 0.0, 0));
        for (n, (force, speed)) in course(force).into_iter().zip(course(&speed)).enumerate() {
            let values = [force.abs(), speed.abs(), force * speed];
            for (kind, (value, limit)) in values.into_iter().zip([self.force, self.speed, self.power]).enumerate() {
                if value / limit > most {
                    (most, found) = (value / limit, (kind, value, n));
                }
            }
        }
        let (kind, value, sample) = found;
        let sizes = |lines: &[Complex<f64>]| strongest(lines.iter().map(|line| line.norm()).enumerate());
        let period = 2.0 * std::f64::consts::PI / fundamental;
        let peak = LimitUse {
            input: label.name.to_string(),
            limit: ["force", "speed", "power"][kind],
            unit: units[kind].clone(),
            value,
            available: [self.force, self.speed, self.power][kind],
            share: most,
            sample,
            time: period * sample as f64 / samples.max(1) as f64,
            harmonic: match kind {
                0 => sizes(force),
                1 => sizes(&speed),
                _ => None,
            },
            remedy: Some(match kind {
                0 => "lower the frequency or the amplitude, or take a stronger actuator",
                1 => "lower the amplitude or the frequency, or take a faster actuator",
                _ => "lower the frequency, or take an actuator of more power",
            }),
            cut: None,
        };
        // 3. The bandwidth is reported where its share is larger.
        match self.bandwidth_use(model, input, force, fundamental) {
            Some(wide) if wide.share > peak.share => wide,
            _ => peak,
        }
    }

    /// The use of the bandwidth by the highest harmonic of the force that is not negligible; nothing where there is no
    /// such harmonic or no bandwidth.
    fn bandwidth_use(
        &self,
        model: &dyn Model<f64>,
        input: usize,
        force: &[Complex<f64>],
        fundamental: f64,
    ) -> Option<LimitUse> {
        let largest = force.iter().skip(1).map(|line| line.norm()).fold(0.0, f64::max);
        let needed =
            |(k, line): &(usize, &Complex<f64>)| *k > 0 && largest > 0.0 && line.norm() > LEAST_HARMONIC * largest;
        let (highest, line) = force.iter().enumerate().rfind(needed)?;
        let value = highest as f64 * fundamental;
        self.bandwidth.is_finite().then(|| LimitUse {
            input: model.input(input).name.to_string(),
            limit: "bandwidth",
            unit: Some("rad/s".to_string()),
            value,
            available: self.bandwidth,
            share: value / self.bandwidth,
            sample: 0,
            time: 0.0,
            harmonic: Some((highest, line.norm())),
            remedy: Some("lower the frequency, take a pattern of fewer harmonics, or a faster actuator"),
            cut: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Limited;
    use num_complex::Complex;
    use tpm_test_support::models::MassSpringDrag;

    const NONE: Limited = Limited {
        coordinate: 0,
        force: f64::INFINITY,
        speed: f64::INFINITY,
        power: f64::INFINITY,
        bandwidth: f64::INFINITY,
    };

    #[test]
    fn an_actuator_brakes_with_its_force_and_drives_with_its_power() {
        let actuator = Limited { force: 10.0, speed: 2.0, power: 5.0, ..NONE };
        assert_eq!(actuator.applied(-20.0, 1.5), -10.0);
        assert_eq!(actuator.applied(20.0, 0.1), 10.0);
        assert_eq!(actuator.applied(20.0, 1.0), 5.0);
        assert_eq!(actuator.applied(20.0, 2.5), 0.0);
        assert_eq!(actuator.applied(-20.0, 2.5), -10.0);
        assert_eq!(NONE.applied(1e9, 1e9), 1e9);
    }

    #[test]
    fn each_limit_is_named_with_its_instant_or_harmonic() {
        // x = cos 3t and a force of 8 sin 3t + sin 9t in its way: speed 3, force near 7, and power 24 sin^2 3t and more.
        let zero = Complex::new(0.0, 0.0);
        let motion = [zero, Complex::new(1.0, 0.0)];
        let force = [zero, Complex::new(0.0, 8.0), zero, Complex::new(0.0, 0.2)];
        let used = |actuator: Limited| actuator.used(&MassSpringDrag, 0, (&force, &motion), 3.0, 400);
        let speed = used(Limited { speed: 2.0, ..NONE });
        assert_eq!((speed.limit, speed.sample % 200), ("speed", 100));
        assert!((speed.share - 1.5).abs() < 1e-9 && speed.harmonic.is_some_and(|(k, _)| k == 1), "{speed:?}");
        let push = used(Limited { force: 4.0, ..NONE });
        assert!(push.limit == "force" && push.share > 1.9, "{push:?}");
        let power = used(Limited { power: 30.0, ..NONE });
        assert!(power.limit == "power" && power.share < 1.0 && power.harmonic.is_none(), "{power:?}");
        let wide = used(Limited { bandwidth: 6.0, ..NONE });
        assert_eq!((wide.limit, wide.harmonic.map(|(k, _)| k)), ("bandwidth", Some(3)));
        assert!((wide.share - 1.5).abs() < 1e-12);
        for (named, word) in [(speed, "speed"), (push, "force"), (power, "power"), (wide, "bandwidth")] {
            let text = named.to_string();
            assert!(text.contains(word) && text.contains("lower the"), "{text}");
        }
    }
}
