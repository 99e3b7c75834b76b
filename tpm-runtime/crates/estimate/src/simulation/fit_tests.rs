//! Fits of simulated records: what is stated against what comes out over many seeds, and against the Cramer-Rao bound.

use crate::output_error::{Differentiable, reach_in};
use crate::recorded::Channel;
use crate::rig_checks::{START, calibrated, cramer_rao};
use crate::simulation::{Asked, Evenly, Question, Reading, Record, Simulation, Variant};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use tpm_controller::harmonics::Hold;
use tpm_interpret::{Interpreted, InterpretedDerivatives};
use tpm_numerics::differences::white_noise;
use tpm_numerics::root_mean_square;
use tpm_test_support::models::differentiable;
use tpm_test_support::rig::{MODEL, PERIOD, Recorded, Rig, SAMPLE_TIME, TRUTH};

const SEEDS: u64 = 60;
/// Fits where noise of other kinds has to be found too, which takes longer.
const FEWER: u64 = 40;

fn fit(machine: (&Interpreted, &InterpretedDerivatives), recorded: &Recorded, start: [f64; 3]) -> Simulation {
    fit_with_rate(machine, recorded, start, None)
}

fn fit_with_rate(
    (model, derivatives): (&Interpreted, &InterpretedDerivatives),
    recorded: &Recorded,
    start: [f64; 3],
    rate: Option<&[f64]>,
) -> Simulation {
    let time: Vec<f64> = (0..recorded.position.len()).map(|k| k as f64 * SAMPLE_TIME).collect();
    let channel = |values: &[f64]| Channel { time: time.clone(), value: values.to_vec() };
    let sensed = |of: (usize, usize), values: &[f64]| {
        let known = Evenly { white: white_noise(values), step: 0.0, reach: reach_in(PERIOD as f64), copies: 1.0 };
        Reading::evenly(of, channel(values), &[], known)
    };
    let position = sensed((0, 0), &recorded.position);
    let record = Record {
        inputs: vec![channel(&recorded.force)],
        sensors: [position].into_iter().chain(rate.map(|rate| sensed((0, 1), rate))).collect(),
        hold: Hold::Zoh,
        breaks: Vec::new(),
    };
    let question = Question {
        machine: Differentiable { model, derivatives },
        constants: &[],
        start: &start,
        free: &[0, 1, 2],
        hidden: &[],
        typical_period: PERIOD as f64 * SAMPLE_TIME,
        asked: Asked::All,
    };
    Simulation::fit(&question, &record).expect("settles")
}

/// All fits of a rig, by seed.
fn fits(rig: Rig, seeds: u64) -> Vec<Simulation> {
    let (model, derivatives) = differentiable(MODEL);
    (0..seeds).into_par_iter().map(|seed| fit((&model, &derivatives), &rig.play(seed), START)).collect()
}

fn deviation(found: &Simulation, parameter: usize) -> f64 {
    found.covariance[(parameter, parameter)].sqrt()
}

/// Errors in units of the stated deviation, by parameter and fit.
fn scores(fits: &[Simulation]) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|j| fits.iter().map(|found| (found.values[j] - TRUTH[j]) / deviation(found, j)).collect())
}

#[test]
fn white_noise_is_met_at_the_cramer_rao_bound() {
    let rig = Rig::default();
    let fits = fits(rig, SEEDS);
    let covered = calibrated("white", scores(&fits));
    assert!((0.91..0.99).contains(&covered), "{covered}");
    let bound = cramer_rao(&rig.play(0).force, [rig.white, f64::INFINITY]);
    for (j, bound) in bound.iter().enumerate() {
        let errors: Vec<f64> = fits.iter().map(|found| found.values[j] - TRUTH[j]).collect();
        let efficiency = root_mean_square(errors) / bound;
        let stated = fits.iter().map(|found| deviation(found, j)).sum::<f64>() / fits.len() as f64;
        assert!(efficiency < 1.2, "{j}: {efficiency}");
        // What is stated is the bound itself, but for the noise that each record is found to have.
        assert!((0.97..1.06).contains(&(stated / bound)), "{j}: {}", stated / bound);
    }
    let named = fits.iter().filter(|found| !found.lacking.is_empty()).count();
    assert!(named <= 1, "{named} of {} name a term", fits.len());
    for found in &fits {
        assert!((0.93..1.07).contains(&(found.sensor_noise[0] / rig.white)), "{:?}", found.sensor_noise);
        assert!(found.force_left[0] < 1e-3, "{:?}", found.force_left);
        assert!(found.passes <= 8);
    }
}

#[test]
fn a_measured_rate_is_used_as_a_reading_with_its_own_noise() {
    let rig = Rig::default();
    let (model, derivatives) = differentiable(MODEL);
    let found = |seed: u64| {
        let recorded = rig.play(seed);
        let mut rng = ChaCha8Rng::seed_from_u64(1000 + seed);
        let mut noisy = |v: &f64| -> f64 {
            let random: f64 = StandardNormal.sample(&mut rng);
            v + 5e-4 * random
        };
        let rate: Vec<f64> = recorded.velocity.iter().map(&mut noisy).collect();
        fit_with_rate((&model, &derivatives), &recorded, START, Some(&rate))
    };
    let fits: Vec<Simulation> = (0..FEWER).into_par_iter().map(found).collect();
    let covered = calibrated("rates", scores(&fits));
    assert!((0.9..0.99).contains(&covered), "{covered}");
    let refused = fits.iter().filter(|found| found.rates.iter().any(|rate| rate.fault.is_some())).count();
    assert!(refused * 20 <= fits.len(), "{refused}");
}

#[test]
fn noise_of_the_recorded_force_is_found_and_leaves_no_bias() {
    let rig = Rig { force_noise: 0.5, ..Rig::default() };
    let fits = fits(rig, FEWER);
    let covered = calibrated("force noise", scores(&fits));
    assert!((0.9..0.995).contains(&covered), "{covered}");
    for (j, scores) in scores(&fits).iter().enumerate() {
        let mean = scores.iter().sum::<f64>() / (FEWER as f64).sqrt();
        assert!(mean.abs() < 3.3, "{j}: bias of {mean} deviations of the mean");
    }
}

#[test]
fn coloured_noise_of_the_sensor_is_found() {
    let rig = Rig { white: 0.0, coloured: 1e-4, ..Rig::default() };
    let fits = fits(rig, FEWER);
    let covered = calibrated("coloured", scores(&fits));
    assert!((0.9..0.995).contains(&covered), "{covered}");
}

#[test]
fn a_start_from_far_away_ends_at_the_same_values() {
    let (model, derivatives) = differentiable(MODEL);
    let recorded = Rig::default().play(1);
    let near = fit((&model, &derivatives), &recorded, START);
    let far = fit((&model, &derivatives), &recorded, [0.5 * TRUTH[0], 300.0 * TRUTH[1], 2.0 * TRUTH[2]]);
    assert_eq!(near.variant, Variant::Model);
    for j in 0..3 {
        let apart = (near.values[j] - far.values[j]) / deviation(&near, j);
        assert!(apart.abs() < 0.05, "{j}: {apart}");
    }
}
