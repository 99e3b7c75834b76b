//! A pendulum on a motor, with dry and viscous friction: the log that a user brings, whose motion is given and whose voltage is what
//! that motion takes.

use crate::honesty::correct::Errors;
use crate::honesty::identify::{Outcome, identify_file, parse, write_csv};
use crate::honesty::table::{Table, met, most_frequent, percent};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use std::error::Error;
use std::f64::consts::TAU;
use tpm_runtime::harmonics::Hold;

const MODEL: &str = "model Pendulum {
    coordinate q [rad];
    input u [V];
    parameter J [kg*m^2], d [N*m*s/rad], fc [N*m], mgl [N*m];
    constant Kt = 0.05 [N*m/A];
    constant R = 1.2 [ohm];

    J*ddot(q) + (d + Kt^2/R)*dot(q) + fc*sign(dot(q)) + mgl*sin(q) = Kt/R*u;
}";
/// Torque constant, N m/A.
const TORQUE: f64 = 0.05;
/// Resistance, ohm.
const RESISTANCE: f64 = 1.2;
/// Name, true value, largest bias and largest spread, both as shares of the value.
const ASKED: [(&str, f64, f64, f64); 4] =
    [("J", 0.01, 2e-3, 3.5e-4), ("d", 0.005, 3e-3, 1.1e-3), ("fc", 0.03, 3e-3, 6.5e-4), ("mgl", 0.5, 2e-3, 2.5e-4)];
/// Time between samples, s.
const SAMPLE_TIME: f64 = 2e-3;
/// Fundamental frequency, rad/s, but for rounding the period to samples.
const FREQUENCY: f64 = 4.0;
/// Amplitude, rad.
const AMPLITUDE: f64 = 0.8;
const PERIODS: usize = 20;
/// Standard deviation of the encoder's noise, rad.
const ANGLE_NOISE: f64 = 1e-4;
/// Standard deviation of the noise on the recorded voltage, V.
const VOLTAGE_NOISE: f64 = 0.02;
/// Samples by which the record begins after the start of a period; the reversal never falls on a sample.
const PHASE: f64 = 0.37;
/// Logs where no number is asked for.
const LOGS: u32 = 50;

/// Time, angle and voltage of one log.
fn record(seed: u64) -> [Vec<f64>; 3] {
    let [j, d, fc, mgl] = ASKED.map(|(_, value, ..)| value);
    let samples = (TAU / FREQUENCY / SAMPLE_TIME).round();
    let w = TAU / (samples * SAMPLE_TIME);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |deviation: f64| -> f64 {
        let normal: f64 = StandardNormal.sample(&mut rng);
        deviation * normal
    };
    let mut log = [Vec::new(), Vec::new(), Vec::new()];
    for i in 0..PERIODS * samples as usize {
        let t = (i as f64 + PHASE) * SAMPLE_TIME;
        let ((sin, cos), (sin3, cos3)) = ((w * t).sin_cos(), (3.0 * w * t).sin_cos());
        let q = AMPLITUDE * (cos - cos3 / 9.0);
        let rate = AMPLITUDE * w * (sin3 / 3.0 - sin);
        let acceleration = AMPLITUDE * w * w * (cos3 - cos);
        let torque = j * acceleration + (d + TORQUE * TORQUE / RESISTANCE) * rate + fc * rate.signum() + mgl * q.sin();
        log[0].push(t);
        log[1].push(q + noise(ANGLE_NOISE));
        log[2].push(torque * RESISTANCE / TORQUE + noise(VOLTAGE_NOISE));
    }
    log
}

/// Bias and spread of the parameters over many logs.
///
/// # Errors
/// Any error of the file system.
pub fn report(logs: Option<u32>) -> Result<String, Box<dyn Error>> {
    let model = parse(MODEL)?;
    let one = |seed: u64| -> std::io::Result<Outcome> {
        let [time, angle, voltage] = record(seed);
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("log.csv");
        write_csv(&path, &["t_s", "q", "u"], &[&time, &angle, &voltage])?;
        Ok(identify_file(&model, &path, Hold::None))
    };
    let seeds = 1..=u64::from(logs.unwrap_or(LOGS));
    let outcomes = seeds.into_par_iter().map(one).collect::<Result<Vec<Outcome>, _>>()?;
    let mut table = Table::new(&[
        "parameter",
        "logs",
        "bias",
        "at most",
        "spread",
        "at most",
        "stated / spread",
        "within 3 deviations",
        "met",
    ]);
    for (name, truth, bias, spread) in ASKED {
        let errors = Errors::of(&outcomes, name, truth);
        let (own_bias, own_spread) = (errors.bias() / truth, errors.spread() / truth);
        let is_met = own_bias.abs() <= bias && own_spread <= spread && errors.found.len() == outcomes.len();
        table.push(vec![
            name.into(),
            outcomes.len().to_string(),
            format!("{:+.4} %", 100.0 * own_bias),
            format!("{:.2} %", 100.0 * bias),
            format!("{:.4} %", 100.0 * own_spread),
            format!("{:.3} %", 100.0 * spread),
            format!("{:.2}", errors.stated() / errors.spread()),
            percent(errors.within(3.0), errors.found.len()),
            met(is_met),
        ]);
    }
    let warned = outcomes.iter().filter(|outcome| outcome.is_warned()).count();
    let refused = outcomes.iter().filter(|outcome| outcome.exit != 0).count();
    let said = most_frequent(outcomes.iter().flat_map(|outcome| &outcome.said).map(|said| said.label.as_str()), 4);
    Ok(format!(
        "{table}\nLogs that were warned about: {}; exit code 1 or 2: {}. {said}\n",
        percent(warned, outcomes.len()),
        percent(refused, outcomes.len())
    ))
}
