//! Readings predicted one sample ahead, by a Kalman filter.
//!
//! ```text
//! x_{k+1|k} = f(x_{k|k}, u_k) ,      P_{k+1|k} = A_k P_{k|k} A_k' + B_k Q_k B_k' ,
//! y_{k|k-1} = H x_{k|k-1} ,          S_k = H P_{k|k-1} H' + R_k .
//! ```
//!
//! f simulates the model from one sample to the next under the recorded inputs. A_k and B_k linearise it about the smoothed motion; Q_k
//! and R_k are the noise of inputs and sensors that makes the record most likely. Sensor noise of a colour is a state of its own, as in
//! the smoother. Invariant: a predicted reading depends on readings before it, and on no later one but through the gains.

use crate::output_error::chain::Chain;
use crate::output_error::error::OutputErrorFault;
use crate::output_error::problem::Problem;
use crate::output_error::state::State;
use tpm_motion::{Plant, PlantError};
use tpm_numerics::root_mean_square;

/// Deviation of the first state of a stretch, in units of what the state varies over the record: nothing is known of it beforehand.
const FIRST_STATE_DEVIATION: f64 = 10.0;
/// Deviation of what a reading adds to sensor noise of a colour, as a share of that noise.
const COLOURED_READING_DEVIATION: f64 = 1e-4;

/// Readings predicted one sample ahead.
pub(super) struct Predictions {
    /// Predicted readings, sample by sample and coordinate by coordinate.
    pub(super) readings: Vec<f64>,
    /// Standard deviations of readings less predicted readings.
    pub(super) deviations: Vec<f64>,
    /// Least standard deviation of every state after a reading.
    pub(super) states: Vec<f64>,
}

/// A state with its covariance, row-major.
struct Filter {
    order: usize,
    state: Vec<f64>,
    covariance: Vec<f64>,
}

impl Filter {
    /// Variance and covariances with all states of what a reading of these states says.
    fn of_reading(&self, read: &[usize]) -> (f64, Vec<f64>) {
        let m = self.order;
        let with: Vec<f64> = (0..m).map(|i| read.iter().map(|&j| self.covariance[i * m + j]).sum::<f64>()).collect();
        (read.iter().map(|&j| with[j]).sum(), with)
    }

    /// Takes in a reading of the sum of some states, with Joseph's form of the covariance, which stays positive.
    fn update(&mut self, read: &[usize], error: f64, variance: f64) {
        let m = self.order;
        let (own, with) = self.of_reading(read);
        let innovation = own + variance;
        if innovation <= 0.0 {
            return;
        }
        let gain: Vec<f64> = with.iter().map(|value| value / innovation).collect();
        for (state, gain) in self.state.iter_mut().zip(&gain) {
            *state += gain * error;
        }
        // (1 - K H) P, then that times (1 - K H)', plus K R K'.
        let mut half = self.covariance.clone();
        for i in 0..m {
            for j in 0..m {
                half[i * m + j] -= gain[i] * with[j];
            }
        }
        for i in 0..m {
            let left: f64 = read.iter().map(|&j| half[i * m + j]).sum();
            for j in 0..m {
                self.covariance[i * m + j] = half[i * m + j] - left * gain[j] + gain[i] * variance * gain[j];
            }
        }
        self.symmetrise();
    }

    fn symmetrise(&mut self) {
        let m = self.order;
        for i in 0..m {
            for j in 0..i {
                let mean = 0.5 * (self.covariance[i * m + j] + self.covariance[j * m + i]);
                self.covariance[i * m + j] = mean;
                self.covariance[j * m + i] = mean;
            }
        }
    }

    /// `P = A P A'` for the row-major `transition`.
    fn transform(&mut self, transition: &[f64]) {
        let m = self.order;
        let mut half = vec![0.0; m * m];
        for i in 0..m {
            for (k, factor) in transition[i * m..(i + 1) * m].iter().enumerate().filter(|(_, a)| a.abs() > 0.0) {
                for j in 0..m {
                    half[i * m + j] += factor * self.covariance[k * m + j];
                }
            }
        }
        for i in 0..m {
            for j in 0..m {
                let row = half[i * m..(i + 1) * m].iter().zip(&transition[j * m..(j + 1) * m]);
                self.covariance[i * m + j] = row.map(|(a, b)| a * b).sum();
            }
        }
        self.symmetrise();
    }
}

/// Predicts every reading of a record from those before it; `chain` is the record linearised about the smoothed motion of `state`.
///
/// # Errors
/// [`OutputErrorFault::Evaluation`] and [`OutputErrorFault::Unbounded`] when the model cannot be simulated from sample to sample.
pub(super) fn predict(
    problem: &Problem<'_>,
    state: &State,
    chain: &Chain,
    plant: &mut Plant<'_>,
) -> Result<Predictions, OutputErrorFault> {
    let noise = &state.noise;
    let (n, outputs, samples) = (chain.order, chain.outputs.len(), chain.samples);
    let coloured = noise.colour.iter().any(|colour| colour.abs() > 0.0);
    let order = if coloured { n + outputs } else { n };
    let typical: Vec<f64> = (0..outputs).map(|c| noise.typical(c, outputs)).collect();
    let smoothed = |k: usize| &state.trajectory.states[k * n..(k + 1) * n];
    let spread = |s: usize| FIRST_STATE_DEVIATION * root_mean_square((0..samples).map(|k| smoothed(k)[s]));
    let unknown: Vec<f64> = (0..n).map(spread).chain(typical.iter().copied()).take(order).collect();
    let mut filter = Filter { order, state: vec![0.0; order], covariance: vec![0.0; order * order] };
    let mut predicted = Predictions {
        readings: vec![0.0; samples * outputs],
        deviations: vec![0.0; samples * outputs],
        states: vec![f64::INFINITY; n],
    };
    let read: Vec<Vec<usize>> =
        (0..outputs).map(|c| [chain.outputs[c], n + c].into_iter().take(1 + usize::from(coloured)).collect()).collect();
    let mut motion = vec![0.0; problem.machine.model.dims().motion_len()];
    let mut transition = vec![0.0; order * order];
    for k in 0..samples {
        if k == 0 || chain.breaks[k - 1] {
            filter.state.fill(0.0);
            filter.state[..n].copy_from_slice(smoothed(k));
            filter.covariance.fill(0.0);
            for (i, deviation) in unknown.iter().enumerate() {
                filter.covariance[i * order + i] = deviation * deviation;
            }
        }
        let variance = |c: usize| {
            let sigma = noise.readings[k * outputs + c] * if coloured { COLOURED_READING_DEVIATION } else { 1.0 };
            sigma * sigma
        };
        for (c, read) in read.iter().enumerate() {
            predicted.readings[k * outputs + c] = read.iter().map(|&i| filter.state[i]).sum();
            predicted.deviations[k * outputs + c] = (filter.of_reading(read).0 + variance(c)).max(0.0).sqrt();
        }
        for (c, read) in read.iter().enumerate().filter(|(c, _)| variance(*c).is_finite()) {
            let error = problem.coordinates[c][k] - read.iter().map(|&i| filter.state[i]).sum::<f64>();
            filter.update(read, error, variance(c));
        }
        for (s, least) in predicted.states.iter_mut().enumerate() {
            *least = least.min(filter.covariance[s * (order + 1)].max(0.0).sqrt());
        }
        if k + 1 == samples || chain.breaks[k] {
            continue;
        }
        for (&of, value) in problem.states.iter().zip(&filter.state) {
            motion[problem.place(of)] = *value;
        }
        plant.reset(&motion)?;
        advance(problem, k, plant).map_err(|fault| match fault {
            PlantError::Evaluation(fault) => fault.into(),
            PlantError::Diverged { .. } => OutputErrorFault::Unbounded,
        })?;
        for (&of, value) in problem.states.iter().zip(&mut filter.state) {
            *value = plant.motion()[problem.place(of)];
        }
        transition.fill(0.0);
        for i in 0..n {
            transition[i * order..i * order + n].copy_from_slice(chain.transition(k, i));
        }
        for (c, colour) in noise.colour.iter().enumerate().take(order - n) {
            filter.state[n + c] *= colour;
            transition[(n + c) * order + n + c] = *colour;
        }
        filter.transform(&transition);
        for (column, size) in chain.disturbances(k, noise) {
            let force = |i: usize| size * chain.forcing(k, i)[column];
            for i in 0..n {
                for j in 0..n {
                    filter.covariance[i * order + j] += force(i) * force(j);
                }
            }
        }
        for (c, colour) in noise.colour.iter().enumerate().take(order - n) {
            let at = (n + c) * (order + 1);
            filter.covariance[at] += typical[c].powi(2) * (1.0 - colour * colour);
        }
    }
    Ok(predicted)
}

/// Simulates the machine from sample k to the next one under the recorded inputs.
///
/// # Errors
/// [`PlantError`].
pub(super) fn advance(problem: &Problem<'_>, k: usize, plant: &mut Plant<'_>) -> Result<(), PlantError> {
    plant.advance_under(problem.sample_time, problem.steps, &mut |share, inputs| {
        for (value, input) in inputs.iter_mut().zip(&problem.inputs) {
            *value = problem.between_samples(input, k, share);
        }
    })
}
