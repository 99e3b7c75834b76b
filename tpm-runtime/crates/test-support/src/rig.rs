//! A mass with damper and spring that follows a rest-to-rest motion under a loop, spoilt as a test asks.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;

/// Time between samples, s.
pub const SAMPLE_TIME: f64 = 4e-3;
/// Samples of a period.
pub const PERIOD: usize = 250;
/// Mass, damping, stiffness.
pub const TRUTH: [f64; 3] = [2.0, 3.0, 40.0];
/// The model that is right where nothing is spoilt.
pub const MODEL: &str = "model S {
    coordinate x [m];
    input u [N];
    parameter m [kg], d [N*s/m], k [N/m];

    m*ddot(x) + d*dot(x) + k*x = u;
}";
/// Samples before the record begins.
const SETTLING: usize = 750;
/// Amplitude of the motion, m.
const AMPLITUDE: f64 = 0.3;

/// What the machine has beside the model, and how it is recorded.
#[derive(Clone, Copy)]
pub struct Rig {
    /// Periods that are recorded.
    pub periods: usize,
    /// Length of the record's periods, in samples; [`PERIOD`] samples are recorded for each.
    pub period: f64,
    /// Force beside the model's, by position and velocity, N.
    pub force: fn(f64, f64) -> f64,
    /// Steps of integration from one sample to the next.
    pub steps: usize,
    /// Standard deviation of the sensor's white noise, m.
    pub white: f64,
    /// Standard deviation of the sensor's noise of a colour, whose successive values correlate by [`COLOUR`], m.
    pub coloured: f64,
    /// Step of the sensor; zero for none, m.
    pub step: f64,
    /// Standard deviation of the noise on the record of the force, N.
    pub force_noise: f64,
    /// What is added to the record of the force, N.
    pub offset: f64,
    /// Share by which the damping has grown at the end of the record.
    pub drift: f64,
    /// Samples by which the force acts later than it was recorded.
    pub delay: usize,
    /// Gains of the loop on position and velocity, N/m and N s/m.
    pub gains: [f64; 2],
    /// Share of the way to the newest difference of positions that the loop's velocity goes in one sample.
    pub smoothing: f64,
    /// Largest force; the command is recorded before it is cut off, N.
    pub limit: f64,
}

/// Correlation of successive values of coloured noise.
pub const COLOUR: f64 = 0.88;

/// Position and force, sample by sample, and the velocity as it is.
pub struct Recorded {
    /// Measured position, m.
    pub position: Vec<f64>,
    /// True velocity, m/s.
    pub velocity: Vec<f64>,
    /// Recorded force, N.
    pub force: Vec<f64>,
}

impl Default for Rig {
    fn default() -> Self {
        Self {
            periods: 4,
            period: PERIOD as f64,
            force: |_, _| 0.0,
            steps: 1,
            white: 1e-4,
            coloured: 0.0,
            step: 0.0,
            force_noise: 0.0,
            offset: 0.0,
            drift: 0.0,
            delay: 0,
            gains: [400.0, 20.0],
            smoothing: 0.8,
            limit: f64::INFINITY,
        }
    }
}

impl Rig {
    /// Plays the motion and records it.
    pub fn play(&self, seed: u64) -> Recorded {
        let [m, damping, k] = TRUTH;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let w = 2.0 * PI / (self.period * SAMPLE_TIME);
        let reference = |t: f64| {
            let [(s, c), (s3, c3)] = [(w * t).sin_cos(), (3.0 * w * t).sin_cos()];
            [c - c3 / 9.0, w * (s3 / 3.0 - s), w * w * (c3 - c)].map(|value| AMPLITUDE * value)
        };
        let samples = self.periods * PERIOD;
        let mut recorded = Recorded {
            position: Vec::with_capacity(samples),
            velocity: Vec::with_capacity(samples),
            force: Vec::with_capacity(samples),
        };
        let [mut x, mut v, _] = reference(0.0);
        let (mut colour, mut slope) = (0.0, 0.0);
        let mut before: Option<f64> = None;
        let mut waiting = vec![0.0; self.delay];
        let h = SAMPLE_TIME / self.steps as f64;
        for i in 0..SETTLING + samples {
            let [r, dr, ddr] = reference(i as f64 * SAMPLE_TIME);
            colour = COLOUR * colour + (1.0 - COLOUR * COLOUR).sqrt() * self.coloured * normal();
            let mut y = x + self.white * normal() + colour;
            if self.step > 0.0 {
                y = (y / self.step).round() * self.step;
            }
            let error = r - y;
            let difference = (error - before.replace(error).unwrap_or(error)) / SAMPLE_TIME;
            slope += self.smoothing * (difference - slope);
            let u = m * ddr + damping * dr + k * r + self.gains[0] * error + self.gains[1] * slope;
            let noise = self.force_noise * normal();
            if i >= SETTLING {
                recorded.position.push(y);
                recorded.velocity.push(v);
                recorded.force.push(u + noise + self.offset);
            }
            waiting.push(u);
            let applied = waiting.remove(0).clamp(-self.limit, self.limit);
            let passed = (i.saturating_sub(SETTLING)) as f64 / samples as f64;
            let d = damping * (1.0 + self.drift * passed);
            let rate = |x: f64, v: f64| (applied - d * v - k * x - (self.force)(x, v)) / m;
            for _ in 0..self.steps {
                let a = rate(x, v);
                let (v2, b) = (v + 0.5 * h * a, rate(x + 0.5 * h * v, v + 0.5 * h * a));
                let (v3, c) = (v + 0.5 * h * b, rate(x + 0.5 * h * v2, v + 0.5 * h * b));
                let (v4, e) = (v + h * c, rate(x + h * v3, v + h * c));
                x += h / 6.0 * (v + 2.0 * (v2 + v3) + v4);
                v += h / 6.0 * (a + 2.0 * (b + c) + e);
            }
        }
        recorded
    }
}
