//! Sensors and drives of a simulated machine: noise, quantisation, delay and limits.
//!
//! Invariant: a position, read at an instant that jitters, becomes `round((q + noise) / step) step`, stops at the end of the
//! sensor's range, then waits `delay` samples. Noise and jitter are white and Gaussian and come from one seeded stream per run,
//! drawn coordinate by coordinate, so that a run depends on its seed and number alone.

use crate::actuator::Limited;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tpm_motion::Dynamics;

/// The measurement of one coordinate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensor {
    /// Standard deviation of the white noise on each sample, unit of the coordinate.
    pub noise: f64,
    /// Step of the encoder, unit of the coordinate (2 pi / counts for an angle); zero for none.
    pub step: f64,
    /// Samples by which the measured value lags.
    pub delay: usize,
    /// Standard deviation of the instant of sampling, s.
    pub jitter: f64,
    /// Largest magnitude that is read; zero for no end.
    pub range: f64,
    /// Run (from 0) and sample from which on the sensor gives no readings any more.
    pub dropout: Option<(usize, usize)>,
    /// Standard deviation of the white noise on the rate, unit of the coordinate per second, where a sensor of its own (a
    /// tachometer) measures it.
    pub rate_noise: Option<f64>,
}

/// The drive of one input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuator {
    /// Largest magnitude of the input; infinite for none.
    pub limit: f64,
    /// Step of the commanded value, unit of the input; zero for none.
    pub step: f64,
    /// Dynamics from this value to the force.
    pub dynamics: Dynamics,
    /// Limits that depend on the motion; nothing for a drive without such limits.
    pub limited: Option<Limited>,
}

impl Default for Actuator {
    fn default() -> Self {
        Actuator { limit: f64::INFINITY, step: 0.0, dynamics: Dynamics::default(), limited: None }
    }
}

impl Actuator {
    /// The value that is applied in a motion (positions, then velocities), and whether a limit cut it.
    #[must_use]
    pub fn apply(&self, wanted: f64, motion: &[f64], coordinates: usize) -> (f64, bool) {
        let stepped = quantise(wanted, self.step);
        let mut applied = stepped.clamp(-self.limit, self.limit);
        if let Some(limited) = &self.limited {
            let speed = motion.get(coordinates + limited.coordinate).copied().unwrap_or(0.0);
            applied = limited.applied(applied, speed);
        }
        (applied, applied.abs() < stepped.abs())
    }
}

/// Replaces the wanted value of every drive by the one that it applies at a motion of so many coordinates, and records
/// this value. Returns whether a limit cut any of them.
pub(super) fn apply(
    actuators: &[Actuator],
    (motion, coordinates): (&[f64], usize),
    wanted: &mut [f64],
    recorded: &mut [Vec<f64>],
) -> bool {
    let mut cut = false;
    for ((value, actuator), column) in wanted.iter_mut().zip(actuators).zip(recorded) {
        let (applied, limited) = actuator.apply(*value, motion, coordinates);
        *value = applied;
        cut |= limited;
        column.push(applied);
    }
    cut
}

fn quantise(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

/// The measurement of all coordinates during one run.
#[derive(Clone, Debug)]
pub(crate) struct Measurement {
    sensors: Vec<Sensor>,
    random: ChaCha8Rng,
    /// Per coordinate, the last `delay + 1` values, as a ring.
    past: Vec<Vec<f64>>,
    count: usize,
    run: usize,
}

impl Measurement {
    /// `run` selects an independent stream of the seed.
    pub(crate) fn new(sensors: &[Sensor], seed: u64, run: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(run as u64);
        Measurement {
            sensors: sensors.to_vec(),
            random,
            past: sensors.iter().map(|sensor| vec![0.0; sensor.delay + 1]).collect(),
            count: 0,
            run,
        }
    }

    /// Measures the coordinates at one sample of a motion, which holds positions, then their rates (missing rates count
    /// as zero).
    pub(crate) fn sample(&mut self, motion: &[f64], out: &mut [f64]) {
        let coordinates = self.sensors.len();
        for (c, ((sensor, past), slot)) in self.sensors.iter().zip(&mut self.past).zip(out.iter_mut()).enumerate() {
            let random = &mut self.random;
            let mut draw = |deviation: f64| {
                if deviation > 0.0 {
                    let normal: f64 = StandardNormal.sample(random);
                    deviation * normal
                } else {
                    0.0
                }
            };
            let late = draw(sensor.jitter) * motion.get(coordinates + c).copied().unwrap_or(0.0);
            let mut value = quantise(motion[c] + late + draw(sensor.noise), sensor.step);
            if sensor.range > 0.0 {
                value = value.clamp(-sensor.range, sensor.range);
            }
            if sensor.dropout.is_some_and(|(run, sample)| run == self.run && sample <= self.count) {
                value = f64::NAN;
            }
            if self.count == 0 {
                // Before the start the machine rested at its first reading.
                past.fill(value);
            }
            let length = past.len();
            past[self.count % length] = value;
            *slot = past[(self.count + 1) % length];
        }
        self.count += 1;
    }

    /// Measures the rates that have a sensor, at the same sample; others are left as they are.
    pub(crate) fn rates(&mut self, motion: &[f64], out: &mut [f64]) {
        let coordinates = self.sensors.len();
        for (c, (sensor, slot)) in self.sensors.iter().zip(out.iter_mut()).enumerate() {
            if let Some(deviation) = sensor.rate_noise {
                let normal: f64 = StandardNormal.sample(&mut self.random);
                *slot = motion.get(coordinates + c).copied().unwrap_or(0.0) + deviation * normal;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Actuator, Measurement, Sensor};

    #[test]
    fn positions_are_rounded_and_delayed() {
        let sensors = [Sensor { step: 0.5, delay: 2, ..Sensor::default() }, Sensor::default()];
        let mut measurement = Measurement::new(&sensors, 1, 0);
        let mut seen = [0.0; 2];
        let mut delayed = Vec::new();
        for n in 0..6 {
            measurement.sample(&[0.3 + 0.5 * f64::from(n), f64::from(n)], &mut seen);
            assert_eq!(seen[1], f64::from(n));
            delayed.push(seen[0]);
        }
        assert_eq!(delayed, [0.5, 0.5, 0.5, 1.0, 1.5, 2.0]);
    }

    #[test]
    fn noise_depends_on_seed_and_run_alone() {
        let draw = |seed, run| {
            let mut measurement = Measurement::new(&[Sensor { noise: 1.0, ..Sensor::default() }], seed, run);
            let mut power = 0.0;
            let mut seen = [0.0];
            for _ in 0..10_000 {
                measurement.sample(&[0.0], &mut seen);
                power += seen[0] * seen[0];
            }
            (seen[0], power / 10_000.0)
        };
        assert_eq!(draw(3, 1), draw(3, 1));
        assert_ne!(draw(3, 1).0, draw(3, 2).0);
        assert_ne!(draw(3, 1).0, draw(4, 1).0);
        assert!((draw(3, 1).1 - 1.0).abs() < 0.05);
    }

    #[test]
    fn sensors_end_jitter_and_drop_out() {
        let range = Sensor { range: 0.7, dropout: Some((2, 3)), ..Sensor::default() };
        let mut measurement = Measurement::new(&[range], 1, 2);
        let mut seen = [0.0];
        let read: Vec<f64> = [0.5, 0.9, -3.0, 0.1]
            .iter()
            .map(|q| {
                measurement.sample(&[*q, 0.0], &mut seen);
                seen[0]
            })
            .collect();
        assert_eq!(read[..3], [0.5, 0.7, -0.7]);
        assert!(read[3].is_nan());
        // A jitter of a thousandth of a second at three units per second.
        let mut measurement = Measurement::new(&[Sensor { jitter: 1e-3, ..Sensor::default() }], 1, 0);
        let power: f64 = (0..20_000)
            .map(|_| {
                measurement.sample(&[0.2, 3.0], &mut seen);
                (seen[0] - 0.2).powi(2)
            })
            .sum();
        assert!(((power / 20_000.0).sqrt() / 3e-3 - 1.0).abs() < 0.02);
    }

    #[test]
    fn the_drive_cuts_at_its_limit() {
        let drive = Actuator { limit: 2.0, step: 0.25, ..Actuator::default() };
        assert_eq!(drive.apply(1.1, &[], 0), (1.0, false));
        assert_eq!(drive.apply(-7.0, &[], 0), (-2.0, true));
        assert_eq!(Actuator::default().apply(1e9, &[], 0), (1e9, false));
    }
}
