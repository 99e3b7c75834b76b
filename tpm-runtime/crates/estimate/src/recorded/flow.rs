//! One block simulated, and how its readings change with parameters and initial state.

use crate::recorded::signals::{Block, Clock, Reading, SignalsAsRecorded};
use rayon::prelude::*;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_motion::{Plant, PlantError};
use tpm_numerics::DMatrix;

/// Share of its size by which an unknown is moved to see what it does: rounding of the simulation is then as small as what the
/// quotient leaves out. Where dry friction comes to rest at instants that are found by a search, it is larger.
const DIFFERENCE: f64 = 1e-6;
const DIFFERENCE_WITH_RESTS: f64 = 1e-5;

/// A model with the record by which it is judged.
pub(super) struct Flow<'a> {
    pub(super) model: &'a dyn Model<f64>,
    pub(super) constants: &'a [f64],
    pub(super) signals: &'a SignalsAsRecorded,
    /// Coordinate and derivative of every state, in the order of the model's coordinates.
    pub(super) states: Vec<(usize, usize)>,
    /// Size of every state.
    pub(super) sizes: Vec<f64>,
    /// Longest step of the integration, s.
    pub(super) longest_step: f64,
    /// Whether a force jumps with a velocity.
    pub(super) jumps: bool,
    /// Sensors that read a highest derivative, which is no state: the rows tell it.
    pub(super) told: Vec<bool>,
    /// Sensors with clocks of their own. By how much each is late stands behind the parameters of the model; where it does not, by nothing.
    pub(super) clocks: Vec<Clock>,
}

/// A block linearised: readings less simulated ones, and the derivatives of the latter by its initial state and by the free parameters,
/// all in units of the sensors' noise.
pub(super) struct Linear {
    pub(super) left: Vec<f64>,
    pub(super) by_state: DMatrix<f64>,
    pub(super) by_parameter: DMatrix<f64>,
}

impl Flow<'_> {
    /// The simulated readings of a block, in the order of its readings.
    ///
    /// # Errors
    /// [`PlantError`] where the model cannot be evaluated, or leaves all bounds.
    pub(super) fn readings(&self, block: &Block, theta: &[f64], state: &[f64]) -> Result<Vec<f64>, PlantError> {
        let (theta, late) = theta.split_at(self.model.dims().parameters);
        if late.iter().all(|late| *late == 0.0) {
            return self.simulated(block, theta, state);
        }
        let mut readings: Vec<(usize, Reading)> = block.readings.iter().copied().enumerate().collect();
        for (_, reading) in &mut readings {
            let clock = self.clocks.iter().position(|clock| clock.sensors.contains(&reading.sensor));
            reading.time -= clock.and_then(|clock| late.get(clock)).copied().unwrap_or(0.0);
        }
        readings.sort_by(|(_, a), (_, b)| a.time.total_cmp(&b.time));
        let (places, readings): (Vec<usize>, Vec<Reading>) = readings.into_iter().unzip();
        let values = self.simulated(&self.signals.block(&readings), theta, state)?;
        let mut out = vec![0.0; values.len()];
        places.into_iter().zip(values).for_each(|(place, value)| out[place] = value);
        Ok(out)
    }

    /// The simulated readings of a block at their stamps.
    fn simulated(&self, block: &Block, theta: &[f64], state: &[f64]) -> Result<Vec<f64>, PlantError> {
        let coordinates = self.model.dims().coordinates;
        let mut plant = Plant::new(self.model, theta, self.constants)?;
        let mut motion = vec![0.0; self.model.dims().motion_len()];
        for (&(c, d), &value) in self.states.iter().zip(state) {
            motion[d * coordinates + c] = value;
        }
        plant.reset(&motion)?;
        let hold = self.signals.hold;
        let mut held = vec![0.0; self.signals.inputs.len()];
        let mut out = Vec::with_capacity(block.readings.len());
        let (mut now, mut next) = (block.start, 0);
        for &instant in &block.instants {
            let duration = instant - now;
            if duration > 0.0 {
                let steps = (duration / self.longest_step).ceil().max(1.0) as usize;
                match hold {
                    Hold::Zoh => {
                        let middle = 0.5 * (now + instant);
                        held.iter_mut().zip(&self.signals.inputs).for_each(|(u, input)| *u = input.at(middle, hold));
                        plant.advance(&held, duration, steps)?;
                    }
                    Hold::None => plant.advance_under(duration, steps, &mut |share, inputs| {
                        let time = now + share * duration;
                        inputs.iter_mut().zip(&self.signals.inputs).for_each(|(u, input)| *u = input.at(time, hold));
                    })?,
                }
                now = instant;
            }
            let mut due = block.readings[next..].iter().take_while(|reading| reading.time <= instant);
            if due.any(|reading| self.told[reading.sensor]) {
                held.iter_mut().zip(&self.signals.inputs).for_each(|(u, input)| *u = input.at(instant, hold));
                plant.observe(&held)?;
            }
            while let Some(reading) = block.readings.get(next).filter(|reading| reading.time <= instant) {
                let sensor = &self.signals.sensors[reading.sensor];
                out.push(plant.motion()[sensor.derivative * coordinates + sensor.coordinate]);
                next += 1;
            }
        }
        Ok(out)
    }

    /// Readings less simulated ones, in units of the sensors' noise.
    pub(super) fn left(
        &self,
        block: &Block,
        theta: &[f64],
        state: &[f64],
        noise: &[f64],
    ) -> Result<Vec<f64>, PlantError> {
        let simulated = self.readings(block, theta, state)?;
        Ok(block.readings.iter().zip(simulated).map(|(r, value)| (r.value - value) / noise[r.sensor]).collect())
    }

    /// A block linearised about parameters and a state; `typical` is the size of every parameter.
    pub(super) fn linearised(
        &self,
        block: &Block,
        (theta, free, typical): (&[f64], &[usize], &[f64]),
        (state, quick): (&[f64], bool),
        noise: &[f64],
    ) -> Result<Linear, PlantError> {
        let n = self.states.len();
        let left = self.left(block, theta, state, noise)?;
        let share = if self.jumps { DIFFERENCE_WITH_RESTS } else { DIFFERENCE };
        let column = |at: usize| -> Result<Vec<f64>, PlantError> {
            let (mut theta, mut state) = (theta.to_vec(), state.to_vec());
            let size = if at < n {
                state[at].abs().max(self.sizes[at])
            } else if free[at - n] < self.model.dims().parameters {
                theta[free[at - n]].abs().max(1e-3 * typical[free[at - n]])
            } else {
                typical[free[at - n]]
            };
            let by = share * size;
            let mut moved = |by: f64| {
                if at < n {
                    state[at] += by
                } else {
                    theta[free[at - n]] += by
                }
                self.left(block, &theta, &state, noise)
            };
            // Both sides are asked, since a quotient of one side has the curvature in it; where a side leaves all bounds, the other will do.
            let above = moved(by);
            if let (true, Ok(above)) = (quick, &above) {
                return Ok(left.iter().zip(above).map(|(left, above)| (left - above) / by).collect());
            }
            let below = moved(-2.0 * by);
            let quotient =
                |a: &[f64], b: &[f64], by: f64| a.iter().zip(b).map(|(a, b)| (b - a) / by).collect::<Vec<f64>>();
            match (above, below) {
                (Ok(above), Ok(below)) => Ok(quotient(&above, &below, 2.0 * by)),
                (Ok(above), Err(_)) => Ok(quotient(&above, &left, by)),
                (Err(_), Ok(below)) => Ok(quotient(&left, &below, by)),
                (Err(fault), Err(_)) => Err(fault),
            }
        };
        let columns: Vec<Vec<f64>> = (0..n + free.len()).into_par_iter().map(column).collect::<Result<_, _>>()?;
        let rows = left.len();
        let part = |range: std::ops::Range<usize>| {
            DMatrix::from_fn(rows, range.len(), |row, column| columns[range.start + column][row])
        };
        Ok(Linear { by_state: part(0..n), by_parameter: part(n..n + free.len()), left })
    }
}
