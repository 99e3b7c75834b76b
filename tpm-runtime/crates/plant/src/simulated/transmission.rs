//! From commands that are held between samples to forces on the plant: delay, low pass and current loop of every input.
//!
//! Invariant: between the instants at which a delayed command changes, the input of the lags is constant and they are
//! advanced exactly, by their matrix exponential; the plant's Runge-Kutta rule uses the forces at the start, the middle
//! and the end of its steps. Before the first sample the lags are in their steady state under the first command.
//! Without delays and lags the plant is advanced under the commands themselves. Stepping allocates nothing.

use crate::regulator::held;
use crate::simulated::sensor::Actuator;
use tpm_controller::model::EvalError;
use tpm_motion::{Plant, PlantError};
use tpm_numerics::DMatrix;

/// Most states of the low pass and the current loop of one input.
const MOST_STATES: usize = 3;
/// Largest product of a step of the plant and the fastest rate of a lag, since the forces are sampled only three times
/// a step.
const MOST_STEP_OF_RATE: f64 = 0.1;

/// One input.
#[derive(Clone, Debug, PartialEq)]
struct Channel {
    /// The last commands, newest first.
    past: Vec<f64>,
    /// Whole samples of the delay.
    whole: usize,
    /// Rest of the delay below one sample, s.
    rest: f64,
    /// Number of states of the lags.
    states: usize,
    /// Index of the state that is the force.
    output: usize,
    /// Values of the states.
    state: [f64; MOST_STATES],
}

/// A part of the time between samples in which no delayed command changes.
#[derive(Clone, Debug, PartialEq)]
struct Segment {
    duration: f64,
    steps: usize,
    /// Per input: whether the older of the two commands still acts.
    older: Vec<bool>,
    /// Per input: the discrete-time lags over half a step, transition matrix and input vector.
    half: Vec<([[f64; MOST_STATES]; MOST_STATES], [f64; MOST_STATES])>,
}

/// Delays and lags of all inputs.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Transmission {
    ideal: bool,
    started: bool,
    sample_time: f64,
    sub_steps: usize,
    channels: Vec<Channel>,
    segments: Vec<Segment>,
    forces: [Vec<f64>; 3],
}

impl Transmission {
    pub(super) fn new(actuators: &[Actuator], sample_time: f64, sub_steps: usize) -> Self {
        let channels: Vec<Channel> = actuators
            .iter()
            .map(|actuator| {
                let (whole, rest) = actuator.dynamics.samples(sample_time);
                let lags = actuator.dynamics.lags();
                Channel {
                    past: vec![0.0; whole + 2],
                    whole,
                    rest,
                    states: lags.as_ref().map_or(0, |lags| lags.a.nrows()),
                    output: lags.as_ref().map_or(0, |lags| lags.output),
                    state: [0.0; MOST_STATES],
                }
            })
            .collect();
        let mut ends: Vec<f64> = channels.iter().map(|channel| channel.rest).filter(|rest| *rest > 0.0).collect();
        ends.push(sample_time);
        ends.sort_by(f64::total_cmp);
        ends.dedup();
        let fastest = actuators
            .iter()
            .flat_map(|actuator| {
                let filter =
                    actuator.dynamics.filter.map(|filter| filter.natural_frequency * (1.0 / filter.quality).max(1.0));
                [filter, actuator.dynamics.bandwidth]
            })
            .flatten()
            .fold(0.0, f64::max);
        let mut from = 0.0;
        let segments = ends
            .into_iter()
            .map(|end| {
                let duration = end - from;
                let middle = from + 0.5 * duration;
                from = end;
                let resolved = (duration * fastest / MOST_STEP_OF_RATE).ceil() as usize;
                let steps = resolved.max((sub_steps as f64 * duration / sample_time).ceil() as usize).max(1);
                let half =
                    actuators.iter().map(|actuator| half_step(actuator, 0.5 * duration / steps as f64)).collect();
                Segment { duration, steps, older: channels.iter().map(|c| middle < c.rest).collect(), half }
            })
            .collect();
        Transmission {
            ideal: actuators.iter().all(|actuator| actuator.dynamics.is_ideal()),
            started: false,
            sample_time,
            sub_steps,
            forces: [0; 3].map(|_| vec![0.0; channels.len()]),
            channels,
            segments,
        }
    }

    /// Advances the plant by one sample under the commands that are applied now; whether its motion diverged.
    ///
    /// # Errors
    /// [`EvalError`] when the rows cannot be evaluated although the motion is finite.
    pub(super) fn advance(&mut self, plant: &mut Plant<'_>, commands: &[f64]) -> Result<bool, EvalError> {
        let advanced = if self.ideal {
            plant.advance(commands, self.sample_time, self.sub_steps)
        } else {
            self.advance_behind(plant, commands)
        };
        match advanced {
            Ok(()) => Ok(false),
            Err(PlantError::Diverged { .. }) => Ok(true),
            Err(PlantError::Evaluation(fault)) => Err(fault),
        }
    }

    fn advance_behind(&mut self, plant: &mut Plant<'_>, commands: &[f64]) -> Result<(), PlantError> {
        for (channel, &command) in self.channels.iter_mut().zip(commands) {
            if !self.started {
                channel.past.fill(command);
                // Steady state under a constant command: every lag equals the command, and the rate of the low pass
                // (its second state) is zero.
                channel.state = [command, 0.0, command];
            }
            channel.past.rotate_right(1);
            if let Some(newest) = channel.past.first_mut() {
                *newest = command;
            }
        }
        self.started = true;
        let Transmission { channels, segments, forces: [first, middle, last], .. } = self;
        for segment in segments {
            for ((channel, older), force) in channels.iter().zip(&segment.older).zip(first.iter_mut()) {
                *force = channel.force(*older);
            }
            plant.advance_by(segment.duration, segment.steps, &mut |plant, step| {
                for forces in [&mut *middle, &mut *last] {
                    for (((channel, older), half), force) in
                        channels.iter_mut().zip(&segment.older).zip(&segment.half).zip(forces.iter_mut())
                    {
                        channel.advance(half, *older);
                        *force = channel.force(*older);
                    }
                }
                plant.step([&first[..], &middle[..], &last[..]], step)?;
                first.copy_from_slice(last);
                Ok(())
            })?;
        }
        Ok(())
    }
}

/// The lags of an actuator over a time in s, as transition matrix of their state and input vector of a constant
/// command.
fn half_step(actuator: &Actuator, time: f64) -> ([[f64; MOST_STATES]; MOST_STATES], [f64; MOST_STATES]) {
    let (mut matrix, mut vector) = ([[0.0; MOST_STATES]; MOST_STATES], [0.0; MOST_STATES]);
    if let Some(lags) = actuator.dynamics.lags() {
        let states = lags.a.nrows();
        let column = DMatrix::from_column_slice(states, 1, lags.b.as_slice());
        let not_a_number = || (DMatrix::from_element(states, states, f64::NAN), DMatrix::zeros(states, 1));
        let (a, b) = held(&lags.a, &column, time).unwrap_or_else(|_| not_a_number());
        for r in 0..states {
            vector[r] = b[(r, 0)];
            for c in 0..states {
                matrix[r][c] = a[(r, c)];
            }
        }
    }
    (matrix, vector)
}

impl Channel {
    /// The command that reaches the lags.
    fn command(&self, older: bool) -> f64 {
        self.past[self.whole + usize::from(older)]
    }

    fn force(&self, older: bool) -> f64 {
        if self.states == 0 { self.command(older) } else { self.state[self.output] }
    }

    fn advance(&mut self, (matrix, vector): &([[f64; MOST_STATES]; MOST_STATES], [f64; MOST_STATES]), older: bool) {
        let command = self.command(older);
        let before = self.state;
        for r in 0..self.states {
            self.state[r] = vector[r] * command + (0..self.states).map(|c| matrix[r][c] * before[c]).sum::<f64>();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Transmission;
    use crate::simulated::sensor::Actuator;
    use tpm_motion::Dynamics;
    use tpm_motion::LowPass;
    use tpm_motion::Plant;
    use tpm_test_support::models::MassSpringDrag;

    const SAMPLE_TIME: f64 = 0.01;
    const SAMPLES: usize = 12;
    const MASS: f64 = 2.0;

    fn command(n: usize) -> f64 {
        (1.0 + n as f64 * n as f64).sin()
    }

    /// Position and speed of a free mass behind the dynamics, by Heun's rule in steps of a microsecond.
    fn brute_force(dynamics: Dynamics) -> [f64; 2] {
        let h = 1e-6;
        let per_sample = (SAMPLE_TIME / h).round() as usize;
        let late = (dynamics.delay / h).round() as usize;
        let filter = dynamics.filter.expect("a filter");
        let (w, bandwidth) = (filter.natural_frequency, dynamics.bandwidth.expect("a bandwidth"));
        let first = command(0);
        let mut y = [first, 0.0, first, 0.0, 0.0];
        for step in 0..SAMPLES * per_sample {
            let u = command(step.saturating_sub(late) / per_sample);
            let rates = |y: [f64; 5]| {
                let bend = w * w * (u - y[0]) - w / filter.quality * y[1];
                [y[1], bend, bandwidth * (y[0] - y[2]), y[2] / MASS, y[3]]
            };
            let slope = rates(y);
            let end = rates(std::array::from_fn(|i| y[i] + h * slope[i]));
            y = std::array::from_fn(|i| y[i] + 0.5 * h * (slope[i] + end[i]));
        }
        [y[4], y[3]]
    }

    #[test]
    fn delays_and_lags_are_those_of_a_brute_force_integration() {
        let filter = Some(LowPass { natural_frequency: 90.0, quality: 0.8 });
        for delay in [0.0, 0.01, 0.0037, 0.0243] {
            let dynamics = Dynamics { delay, filter, bandwidth: Some(250.0) };
            let mut plant = Plant::new(&MassSpringDrag, &[MASS, 0.0, 0.0], &[]).expect("square");
            let actuator = Actuator { dynamics, ..Actuator::default() };
            let mut transmission = Transmission::new(&[actuator], SAMPLE_TIME, 1);
            for n in 0..SAMPLES {
                assert_eq!(transmission.advance(&mut plant, &[command(n)]), Ok(false));
            }
            let expected = brute_force(dynamics);
            for (found, expected) in plant.motion()[..2].iter().zip(expected) {
                assert!((found - expected).abs() < 1e-7 * expected.abs(), "{delay}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_delay_alone_is_a_shift() {
        let mut plant = Plant::new(&MassSpringDrag, &[MASS, 0.0, 0.0], &[]).expect("square");
        let dynamics = Dynamics { delay: 0.025, ..Dynamics::default() };
        let mut transmission = Transmission::new(&[Actuator { dynamics, ..Actuator::default() }], SAMPLE_TIME, 1);
        let mut speed = 0.0;
        for n in 0..SAMPLES {
            transmission.advance(&mut plant, &[command(n)]).expect("regular");
            let old = |back: usize| command(n.saturating_sub(back));
            speed += 0.5 * SAMPLE_TIME * (old(3) + old(2)) / MASS;
            assert!((plant.motion()[1] - speed).abs() < 1e-15, "{n}");
        }
    }
}
