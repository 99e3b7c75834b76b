//! The force behind an actuator of known dynamics, sample by sample: what a simulation takes for the input.
//!
//! Under a hold the command is a staircase. Its steps, delayed by whole samples and a rest, are integrated through the lags by their matrix
//! exponential, so that the mean f of the force in a sample of length h and its moment are exact. A constant force f moves what it
//! accelerates as the true one does, but for a step of the position by `c h^2 / m`, where
//!
//! ```text
//! c = 1/h^2 int_0^h (h/2 - s) f(s) ds
//! ```
//!
//! and forces `c/2` in the sample before and `-c/2` in the sample behind make this step, but for what it lasts. An input that was measured
//! runs straight between its samples, and what is told is the force at the sample.

use crate::actuator::{Dynamics, Lags, LowPass};
use tpm_controller::harmonics::Hold;
use tpm_numerics::{DMatrix, DVector, exponential, through};

/// What is left of an older command is this many time constants old.
const FORGOTTEN: f64 = 16.0;

/// `z -> e^(Z t) z` for a system that includes its input.
struct Step(DMatrix<f64>);

impl Step {
    /// Lags with their held input, the rate of this input, and the first and second integral of the force, over a time in s.
    fn new(lags: &Lags, duration: f64) -> Self {
        let n = lags.a.nrows();
        let mut system = DMatrix::zeros(n + 4, n + 4);
        system.view_mut((0, 0), (n, n)).copy_from(&lags.a);
        system.view_mut((0, n), (n, 1)).copy_from(&lags.b);
        system[(n, n + 1)] = 1.0;
        system[(n + 2, lags.output)] = 1.0;
        system[(n + 3, n + 2)] = 1.0;
        Step(exponential(&(system * duration)))
    }

    /// The states after it, and the first and second integral of the force, under an input with a rate.
    fn take(&self, states: &DVector<f64>, input: f64, rate: f64) -> (DVector<f64>, [f64; 2]) {
        let n = states.len();
        let whole = DVector::from_fn(n + 4, |i, _| match i.checked_sub(n) {
            None => states[i],
            Some(0) => input,
            Some(1) => rate,
            Some(_) => 0.0,
        });
        let after = &self.0 * whole;
        (after.rows(0, n).into_owned(), [after[n + 2], after[n + 3]])
    }
}

impl Dynamics {
    /// Samples before a force that tell of it.
    #[must_use]
    pub fn memory(&self, sample_time: f64) -> usize {
        let slowest = |LowPass { natural_frequency, quality }: LowPass| {
            let damping = 0.5 / quality;
            let beyond = (damping * damping - 1.0).max(0.0).sqrt();
            (natural_frequency * (damping - beyond)).recip()
        };
        let lags = self.filter.map_or(0.0, slowest) + self.bandwidth.map_or(0.0, f64::recip);
        ((self.delay + FORGOTTEN * lags) / sample_time).ceil() as usize + 1
    }

    /// The force under a recorded command, a value for every sample: the mean until the next sample where the command is held, otherwise
    /// the force at the sample. Where it is held and what it acts on is `accelerated`, steps of the position that the mean does not make
    /// are in it. Before the record the command is taken to have been its first value for ever.
    #[must_use]
    pub fn acting(&self, command: &[f64], sample_time: f64, hold: Hold, accelerated: bool) -> Vec<f64> {
        let at = |k: isize| command.get(k.max(0) as usize).or(command.last()).copied().unwrap_or(0.0);
        let lags = self.lags();
        let (whole, rest) = self.samples(sample_time);
        let rest_of_states = |lags: &Lags| {
            let first = &lags.b * at(0);
            // A state at rest: A x + b u = 0; lags of unit gain have no pole at zero.
            lags.a.clone().lu().solve(&-first).unwrap_or_else(|| DVector::zeros(lags.b.len()))
        };
        let count = command.len() as isize;
        let late = whole as isize;
        let constant = |told: Vec<[f64; 2]>| -> Vec<f64> {
            let moment = |k: usize| told.get(k).map_or(0.0, |own| own[1]);
            let step = |k: usize| 0.5 * (moment(k + 1) - k.checked_sub(1).map_or(0.0, moment));
            told.iter().enumerate().map(|(k, own)| own[0] + if accelerated { step(k) } else { 0.0 }).collect()
        };
        match (hold, lags) {
            (Hold::Zoh, None) => {
                let before = rest / sample_time;
                let sample = |k: isize| {
                    let (old, new) = (at(k - late - 1), at(k - late));
                    [before * old + (1.0 - before) * new, 0.5 * before * (1.0 - before) * (old - new)]
                };
                constant((0..count).map(sample).collect())
            }
            (Hold::Zoh, Some(lags)) => {
                let (first, second) = (Step::new(&lags, rest), Step::new(&lags, sample_time - rest));
                let mut states = rest_of_states(&lags);
                let sample = |k: isize| {
                    let (middle, [before, twice_before]) = first.take(&states, at(k - late - 1), 0.0);
                    let (end, [behind, twice_behind]) = second.take(&middle, at(k - late), 0.0);
                    states = end;
                    let mean = (before + behind) / sample_time;
                    let twice = twice_before + before * (sample_time - rest) + twice_behind;
                    [mean, twice / (sample_time * sample_time) - 0.5 * mean]
                };
                constant((0..count).map(sample).collect())
            }
            (Hold::None, lags) => {
                let delayed: Vec<f64> = (0..count).map(|k| between(&at, k - late, rest / sample_time)).collect();
                let Some(lags) = lags else { return delayed };
                let step = Step::new(&lags, sample_time);
                let mut states = rest_of_states(&lags);
                let sample = |k: usize| {
                    let force = states[lags.output];
                    let next = delayed.get(k + 1).copied().unwrap_or(delayed[k]);
                    states = step.take(&states, delayed[k], (next - delayed[k]) / sample_time).0;
                    force
                };
                (0..delayed.len()).map(sample).collect()
            }
        }
    }
}

/// A signal so much of a sample before the sample k, by the polynomial through the two samples on either side.
fn between(at: &dyn Fn(isize) -> f64, k: isize, before: f64) -> f64 {
    if before == 0.0 {
        return at(k);
    }
    through([-2.0, -1.0, 0.0, 1.0], [-2, -1, 0, 1].map(|node| at(k + node)), -before)
}

#[cfg(test)]
mod tests {
    use super::Dynamics;
    use crate::LowPass;
    use tpm_controller::harmonics::Hold;

    const STEP: f64 = 2e-3;

    fn cases() -> Vec<Dynamics> {
        let filter = Some(LowPass { natural_frequency: 400.0, quality: 0.4 });
        let of = |delay, filter, bandwidth| Dynamics { delay, filter, bandwidth };
        vec![
            of(3.4 * STEP, None, None),
            of(2.0 * STEP, None, None),
            of(0.0, None, Some(300.0)),
            of(1.7 * STEP, filter, Some(250.0)),
        ]
    }

    /// The force under a held command by Euler's rule with so many steps a sample; `step` takes the sample, the force, and the length of the
    /// step.
    fn finely(dynamics: Dynamics, command: &[f64], fine: usize, mut step: impl FnMut(usize, f64, f64)) {
        let h = STEP / fine as f64;
        let (mut value, mut rate, mut force) = (command[0], 0.0, command[0]);
        for k in 0..command.len() {
            for n in 0..fine {
                let t = (k as f64 + (n as f64 + 0.5) / fine as f64) * STEP - dynamics.delay;
                let u = command[(t / STEP).floor().max(0.0) as usize];
                if let Some(filter) = dynamics.filter {
                    let (dv, dr) = filter.rates(u, value, rate);
                    (value, rate) = (value + h * dv, rate + h * dr);
                } else {
                    value = u;
                }
                force = dynamics.bandwidth.map_or(value, |w| force + h * w * (value - force));
                step(k, force, h);
            }
        }
    }

    #[test]
    fn means_of_a_held_command_are_those_of_a_fine_integration() {
        let command: Vec<f64> = (0..60).map(|k| (0.37 * f64::from(k)).sin() + 0.2 * f64::from(k % 5)).collect();
        for dynamics in cases() {
            let mut means = vec![0.0; command.len()];
            finely(dynamics, &command, 4000, |k, force, h| means[k] += force * h / STEP);
            for (k, (found, expected)) in
                dynamics.acting(&command, STEP, Hold::Zoh, false).iter().zip(&means).enumerate()
            {
                assert!((found - expected).abs() < 2e-3, "{dynamics:?}, sample {k}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_mass_moves_as_under_the_force_itself() {
        let command: Vec<f64> = (0..400).map(|k| (0.05 * f64::from(k)).sin()).collect();
        for dynamics in cases() {
            let (mut x, mut v) = (0.0, 0.0);
            let mut exact = vec![None; command.len()];
            finely(dynamics, &command, 10_000, |k, force, h| {
                exact[k].get_or_insert(x);
                (x, v) = (x + h * v + 0.5 * h * h * force, v + h * force);
            });
            let errors = [true, false].map(|accelerated| {
                let (mut x, mut v, mut worst) = (0.0, 0.0, 0.0_f64);
                let held = dynamics.acting(&command, STEP, Hold::Zoh, accelerated);
                for (held, exact) in held.iter().zip(exact.iter().flatten()) {
                    worst = worst.max((x - exact).abs());
                    (x, v) = (x + STEP * v + 0.5 * STEP * STEP * held, v + STEP * held);
                }
                worst
            });
            let whole = dynamics.samples(STEP).1 == 0.0 && dynamics.lags().is_none();
            assert!(if whole { errors[1] < 1e-12 } else { errors[0] < 0.2 * errors[1] }, "{dynamics:?}: {errors:?}");
        }
    }

    #[test]
    fn a_measured_input_passes_as_its_frequency_response() {
        for dynamics in cases() {
            let w = 20.0;
            let command: Vec<f64> = (0..800).map(|k| (w * STEP * f64::from(k)).cos()).collect();
            let found = dynamics.acting(&command, STEP, Hold::None, true);
            let response = dynamics.response(w);
            assert!(dynamics.memory(STEP) < 200, "{dynamics:?}");
            for (k, found) in found.iter().enumerate().take(command.len() - 2).skip(dynamics.memory(STEP)) {
                let angle = w * STEP * k as f64;
                let expected = response.re * angle.cos() - response.im * angle.sin();
                assert!((found - expected).abs() < 2e-4, "{dynamics:?}, sample {k}: {found} {expected}");
            }
        }
    }
}
