//! What a run would show of the parameters, before it is played.
//!
//! Invariant: a prediction is the Cramer-Rao bound of the steady state ([`information_root`]) for the noise of the sensors
//! ([`sensor_deviations`]). The inputs are known exactly, since the applied ones are recorded.

use std::f64::consts::PI;
use tpm_controller::model::{EvalError, Model};
use tpm_estimate::{EstimateError, RecordNoise, has_jumps, information_root};
use tpm_motion::Trial;
use tpm_motion::trajectory::{Line, Trajectory};
use tpm_numerics::Matrix;
use tpm_plant::simulated::{Rig, SimulatedRun};

/// Number of harmonics of an encoder's error that are summed; those left out hold less than a hundredth of its
/// variance.
const REPEATED_HARMONICS: u32 = 100;
/// Standard deviation that is assumed of a sensor without noise, as a share of the amplitude.
pub const LEAST_NOISE: f64 = 1e-6;

/// Information that a run gives about the machine's parameters: a square root of the information matrix, in rows of
/// unit variance. `motion` is the motion without noise over `measured` periods of `samples` samples, computed up to the harmonic
/// `reach`; `stray` is how far the machine goes from it ([`strayed`]). `None` where the motion does not determine its own derivatives.
///
/// # Errors
/// [`EstimateError`] when the model refuses an evaluation, or a term is not finite.
pub fn run_information(
    model: &dyn Model<f64>,
    machine: &Rig,
    motion: &Trajectory,
    (samples, measured): (usize, usize),
    stray: &[f64],
    reach: usize,
) -> Result<Option<Matrix>, EstimateError> {
    let deviations = sensor_deviations(machine, motion, measured);
    let noise = RecordNoise { deviations: &deviations, samples: measured * samples, periods: measured, stray };
    Ok(information_root(model, &machine.constants, motion, &machine.parameters, noise, reach)?.map(Matrix::of))
}

/// Root mean square deviation of the simulated motion, which feedback of the sensors' noise disturbs, from a
/// trajectory: one value for every slot of a motion, over the periods after settling. Zero for a run that ends before
/// it has settled, and for rows without jumps, which do not ask for it.
///
/// # Errors
/// [`EvalError`] when the model refuses an evaluation.
pub fn strayed(
    model: &dyn Model<f64>,
    machine: &Rig,
    trial: &Trial,
    trajectory: &Trajectory,
    settled: usize,
) -> Result<Vec<f64>, EvalError> {
    if !has_jumps(model, &machine.constants, trajectory)? {
        return Ok(vec![0.0; model.dims().motion_len()]);
    }
    let mut run = SimulatedRun::new(model, machine, trial)?;
    let mut expected = vec![0.0; model.dims().motion_len()];
    let mut squares = expected.clone();
    let (mut sample, mut counted) = (0, 0);
    loop {
        if sample >= settled * trial.samples_per_period && sample < trial.samples() {
            trajectory.motion_at(sample, trial.samples_per_period, 0.0, &mut expected);
            for ((square, actual), expected) in squares.iter_mut().zip(run.motion()).zip(&expected) {
                *square += (actual - expected).powi(2);
            }
            counted += 1;
        }
        if run.step()?.is_some() {
            return Ok(squares.into_iter().map(|square| (square / f64::from(counted.max(1))).sqrt()).collect());
        }
        sample += 1;
    }
}

/// Standard deviation of the white noise on one sample of every coordinate that has, over these periods, the same
/// effect as the sensor's noise, jitter and quantisation.
#[must_use]
pub fn sensor_deviations(bench: &Rig, trajectory: &Trajectory, periods: usize) -> Vec<f64> {
    let sensors = bench.sensors.iter().zip(&trajectory.coordinates);
    let deviation = sensors.map(|(sensor, series)| {
        let size = series.lines.iter().map(|line| line.cos.hypot(line.sin)).fold(0.0, f64::max);
        let rate =
            |line: &Line| (f64::from(line.harmonic) * trajectory.frequency * line.cos.hypot(line.sin)).powi(2) / 2.0;
        let late = sensor.jitter * sensor.jitter * series.lines.iter().map(rate).sum::<f64>();
        let white = sensor.noise * sensor.noise + late;
        // An error that repeats in every period does not average out over the periods.
        let repeated = repeated_share(white.sqrt(), sensor.step) * (periods as f64 - 1.0);
        let variance = white + sensor.step * sensor.step / 12.0 * (1.0 + repeated);
        variance.sqrt().max(LEAST_NOISE * size).max(f64::MIN_POSITIVE.sqrt())
    });
    deviation.collect()
}

/// Share of the variance of an encoder's error, step^2/12, that repeats whenever the same position is read. White noise
/// before the encoder, of standard deviation `noise`, makes the rest random.
///
/// The mean error at a position is a Fourier series in the position, whose k-th harmonic the noise reduces by the
/// factor `exp(-2 (pi k noise/step)^2)`. The share is one without noise, and a two-hundred-thousandth where the noise
/// is half a step.
fn repeated_share(noise: f64, step: f64) -> f64 {
    if step <= 0.0 {
        return 0.0;
    }
    if noise <= 0.0 {
        return 1.0;
    }
    let term = |k: u32| (-(2.0 * PI * f64::from(k) * noise / step).powi(2)).exp() / f64::from(k * k);
    6.0 / (PI * PI) * (1..=REPEATED_HARMONICS).map(term).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::repeated_share;

    #[test]
    fn what_an_encoder_repeats_is_what_noise_before_it_leaves() {
        assert_eq!(repeated_share(1.0, 0.0), 0.0);
        assert!((repeated_share(0.0, 0.1) - 1.0).abs() < 1e-12 && (repeated_share(1e-9, 0.1) - 1.0).abs() < 1e-2);
        // The mean error at a position by a sum over the noise, and its variance over the positions within one step.
        for noise in [0.1, 0.2, 0.32, 0.5_f64] {
            let (mut variance, positions) = (0.0, 100);
            for n in 0..positions {
                let position = (f64::from(n) + 0.5) / f64::from(positions);
                let (mut sum, mut weights) = (0.0, 0.0);
                for z in -5000..=5000 {
                    let z = 1e-3 * f64::from(z);
                    let weight = (-0.5 * z * z).exp();
                    sum += weight * ((position + noise * z).round() - position);
                    weights += weight;
                }
                variance += (sum / weights).powi(2) / f64::from(positions);
            }
            let found = repeated_share(noise, 1.0);
            assert!((12.0 * variance - found).abs() < 1e-3 + 0.02 * found, "{noise}: {variance} {found}");
        }
    }
}
