//! A mass with damper and spring that follows a rest-to-rest motion under feed-forward and PD feedback, as it is recorded.
//!
//! The machine obeys `m x'' + d x' + k x + force(x, x') = u` with the held input u, and is integrated by the classical Runge-Kutta
//! method. Whatever can go wrong in the machine, its sensor or its drive is a field of [`Rig`]; what goes wrong with the file
//! afterwards is done to the [`Recording`].

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Mass, kg.
pub const MASS: f64 = 2.0;
/// Damping, N s/m.
pub const DAMPING: f64 = 3.0;
/// Stiffness, N/m.
pub const STIFFNESS: f64 = 40.0;
/// Time between samples, s.
pub const SAMPLE_TIME: f64 = 1e-3;
/// Samples of a period of the motion.
pub const PERIOD: usize = 1000;
/// Amplitude of the motion, m.
pub const AMPLITUDE: f64 = 0.3;
/// Samples that are played before the record begins.
const SETTLING: usize = 3000;
/// Proportional gain of the feedback, N/m.
const PROPORTIONAL: f64 = 400.0;
/// Derivative gain of the feedback, N s/m.
const DERIVATIVE: f64 = 20.0;
/// Time constant of the filtered difference, s.
const FILTER: f64 = 2e-3;
/// Correlation of successive values of coloured noise.
const COLOUR: f64 = 0.88;

/// A force beside those of mass, damper and spring.
#[derive(Clone, Copy, Debug)]
pub enum Force {
    /// None.
    Nothing,
    /// Dry friction of constant size, N.
    Coulomb(f64),
    /// Dry friction that falls from its size at rest to its size in motion, N, over a velocity, m/s.
    Stribeck {
        /// Size in motion, N.
        moving: f64,
        /// Size at rest, N.
        rest: f64,
        /// Velocity over which it falls, m/s.
        velocity: f64,
    },
    /// A spring that hardens with the cube of the position, N/m^3.
    Cubic(f64),
    /// Drag that grows with the square of the velocity, N s^2/m^2.
    Drag(f64),
}

impl Force {
    fn at(self, x: f64, v: f64) -> f64 {
        match self {
            Force::Nothing => 0.0,
            Force::Coulomb(size) => size * (v / 1e-4).tanh(),
            Force::Stribeck { moving, rest, velocity } => {
                (moving + (rest - moving) * (-(v / velocity).powi(2)).exp()) * (v / 1e-3).tanh()
            }
            Force::Cubic(stiffness) => stiffness * x.powi(3),
            Force::Drag(factor) => factor * v * v.abs(),
        }
    }

    /// Steps of integration from one sample to the next; friction that is rounded off over a small velocity is stiff.
    const fn steps(self) -> usize {
        match self {
            Force::Coulomb(_) => 16,
            Force::Stribeck { .. } => 8,
            _ => 2,
        }
    }
}

/// A part of the mass that is held by a spring and a damper only; the sensor sees the other part, on which the input acts.
#[derive(Clone, Copy, Debug)]
pub struct Flexible {
    /// The part of the mass, kg.
    pub mass: f64,
    /// Stiffness between the parts, N/m.
    pub stiffness: f64,
    /// Damping between the parts, N s/m.
    pub damping: f64,
}

/// The machine with its sensor and its drive.
#[derive(Clone, Copy, Debug)]
pub struct Rig {
    /// Samples of the record.
    pub samples: usize,
    /// A force that the model may lack.
    pub force: Force,
    /// Growth of the damping from the first played sample on, as a share in every second.
    pub drift: f64,
    /// A flexible part.
    pub flexible: Option<Flexible>,
    /// Standard deviation of the sensor's white noise, m.
    pub white: f64,
    /// Standard deviation of the sensor's coloured noise, m.
    pub coloured: f64,
    /// Step of the sensor, zero for none, m.
    pub step: f64,
    /// Play between the machine and the sensor, m.
    pub backlash: f64,
    /// Error of an eccentric encoder's disc: its size, m, and the angle of the disc per position, rad/m.
    pub eccentricity: (f64, f64),
    /// Samples by which the sensor's value is late.
    pub sensor_delay: usize,
    /// Standard deviation of the noise on the record of the input, N.
    pub input_noise: f64,
    /// Samples by which the input acts after it was recorded.
    pub input_delay: usize,
    /// Time constant with which the input builds up, zero for none, s.
    pub lag: f64,
    /// Largest input that acts, N; what is recorded is not limited.
    pub limit: f64,
    /// Share of the amplitude by which amplitude and centre of the motion differ at most from log to log.
    pub variation: f64,
}

impl Default for Rig {
    /// Eight periods of the machine that obeys its model, with white noise of 0.1 mm.
    fn default() -> Self {
        Rig {
            samples: 8 * PERIOD,
            force: Force::Nothing,
            drift: 0.0,
            flexible: None,
            white: 1e-4,
            coloured: 0.0,
            step: 0.0,
            backlash: 0.0,
            eccentricity: (0.0, 0.0),
            sensor_delay: 0,
            input_noise: 0.0,
            input_delay: 0,
            lag: 0.0,
            limit: f64::INFINITY,
            variation: 0.0,
        }
    }
}

/// What was recorded, sample by sample.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Time stamps, s.
    pub time: Vec<f64>,
    /// Measured position, m.
    pub position: Vec<f64>,
    /// Commanded input, N.
    pub input: Vec<f64>,
}

impl Recording {
    /// Deletes samples, all columns of them.
    pub fn delete(&mut self, samples: &[usize]) {
        for column in [&mut self.time, &mut self.position, &mut self.input] {
            let mut at = 0;
            column.retain(|_| {
                at += 1;
                !samples.contains(&(at - 1))
            });
        }
    }
}

/// Position and velocity of the sensed part, of the flexible part, and the input that acts.
type State = [f64; 5];

/// A value that arrives some samples late.
struct Late(VecDeque<f64>);

impl Late {
    fn new(samples: usize, before: f64) -> Self {
        Late(vec![before; samples].into())
    }

    fn pass(&mut self, value: f64) -> f64 {
        self.0.push_back(value);
        self.0.pop_front().unwrap_or(value)
    }
}

impl Rig {
    /// Plays the motion and records it; the seed is that of all noise.
    #[must_use]
    pub fn play(&self, seed: u64) -> Recording {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (scale, centre) = (1.0 + self.vary(&mut rng), AMPLITUDE * self.vary(&mut rng));
        let reference = |i: usize| {
            let w = TAU / (PERIOD as f64 * SAMPLE_TIME);
            let phase = w * i as f64 * SAMPLE_TIME;
            let ((sin, cos), (sin3, cos3)) = (phase.sin_cos(), (3.0 * phase).sin_cos());
            let amplitude = scale * AMPLITUDE;
            [
                centre + amplitude * (cos - cos3 / 9.0),
                amplitude * w * (sin3 / 3.0 - sin),
                amplitude * w * w * (cos3 - cos),
            ]
        };
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let start = reference(0)[0];
        let mut state: State = [start, 0.0, start, 0.0, 0.0];
        let (mut seen, mut colour) = (start, 0.0);
        let (mut slope, mut before) = (0.0, None);
        let keep = (-SAMPLE_TIME / FILTER).exp();
        let (mut sensor, mut drive) = (Late::new(self.sensor_delay, start), Late::new(self.input_delay, 0.0));
        let mut recording = Recording { time: Vec::new(), position: Vec::new(), input: Vec::new() };
        for i in 0..SETTLING + self.samples {
            let [r, dr, ddr] = reference(i);
            // A sensor with play is dragged along at either end of its slack.
            seen = seen.clamp(state[0] - 0.5 * self.backlash, state[0] + 0.5 * self.backlash);
            colour = COLOUR * colour + (1.0 - COLOUR * COLOUR).sqrt() * self.coloured * normal();
            let (size, turn) = self.eccentricity;
            let mut y = seen + size * (turn * seen).sin() + self.white * normal() + colour;
            if self.step > 0.0 {
                y = (y / self.step).round() * self.step;
            }
            let y = sensor.pass(y);
            let error = r - y;
            let difference = (error - before.replace(error).unwrap_or(error)) / SAMPLE_TIME;
            slope = keep * slope + (1.0 - keep) * difference;
            let command = MASS * ddr + DAMPING * dr + STIFFNESS * r + PROPORTIONAL * error + DERIVATIVE * slope;
            if i >= SETTLING {
                recording.time.push((i - SETTLING) as f64 * SAMPLE_TIME);
                recording.position.push(y);
                recording.input.push(command + self.input_noise * normal());
            }
            let applied = drive.pass(command).clamp(-self.limit, self.limit);
            state = self.advance(state, applied, i as f64 * SAMPLE_TIME);
        }
        recording
    }

    fn vary(&self, rng: &mut ChaCha8Rng) -> f64 {
        self.variation * rng.random_range(-1.0..=1.0)
    }

    /// The state one sample later.
    fn advance(&self, mut state: State, applied: f64, time: f64) -> State {
        let steps = if self.flexible.is_some() { 8 } else { self.force.steps() };
        let h = SAMPLE_TIME / steps as f64;
        let damping = DAMPING * (1.0 + self.drift * time);
        if self.lag == 0.0 {
            state[4] = applied;
        }
        let rate = |s: &State| self.rate(s, damping, applied);
        for _ in 0..steps {
            let along = |rate: &State, h: f64| -> State { std::array::from_fn(|i| state[i] + h * rate[i]) };
            let a = rate(&state);
            let b = rate(&along(&a, 0.5 * h));
            let c = rate(&along(&b, 0.5 * h));
            let d = rate(&along(&c, h));
            state = std::array::from_fn(|i| state[i] + h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]));
        }
        state
    }

    fn rate(&self, &[x, v, x2, v2, acting]: &State, damping: f64, applied: f64) -> State {
        let building = if self.lag > 0.0 { (applied - acting) / self.lag } else { 0.0 };
        let free = acting - damping * v - STIFFNESS * x - self.force.at(x, v);
        match self.flexible {
            Some(Flexible { mass, stiffness, damping }) => {
                let between = stiffness * (x - x2) + damping * (v - v2);
                [v, (free - between) / (MASS - mass), v2, between / mass, building]
            }
            None => [v, free / MASS, v2, 0.0, building],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{DAMPING, MASS, PERIOD, Rig, SAMPLE_TIME, STIFFNESS};
    use std::f64::consts::TAU;

    /// Cosine and sine part of a harmonic over whole periods.
    fn harmonic(signal: &[f64], k: usize) -> [f64; 2] {
        let turn = |i: usize| (TAU * (k * i % PERIOD) as f64 / PERIOD as f64).sin_cos();
        let part = |of: fn((f64, f64)) -> f64| -> f64 {
            signal.iter().enumerate().map(|(i, value)| value * of(turn(i))).sum::<f64>() * 2.0 / signal.len() as f64
        };
        [part(|turn| turn.1), part(|turn| turn.0)]
    }

    #[test]
    fn the_recorded_motion_obeys_the_model_under_a_held_input() {
        let recording = Rig { white: 0.0, ..Rig::default() }.play(1);
        assert_eq!(recording.position.len(), 8 * PERIOD);
        for k in [1, 3] {
            let w = k as f64 * TAU / (PERIOD as f64 * SAMPLE_TIME);
            let [x, y] = harmonic(&recording.position, k);
            let [u, v] = harmonic(&recording.input, k);
            // The hold delays the input by half a sample, and takes w^2 T^2/24 of it.
            let (half, gain) = (0.5 * w * SAMPLE_TIME, 1.0 - (w * SAMPLE_TIME).powi(2) / 24.0);
            let held = [gain * (u * half.cos() - v * half.sin()), gain * (u * half.sin() + v * half.cos())];
            let spring = STIFFNESS - MASS * w * w;
            let expected = [spring * x + DAMPING * w * y, spring * y - DAMPING * w * x];
            for (held, expected) in held.iter().zip(expected) {
                assert!((held - expected).abs() < 1e-5 * u.hypot(v), "{k}: {held} {expected}");
            }
        }
    }
}
