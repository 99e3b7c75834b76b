//! Fits of simulated records: what is stated against what comes out over many seeds, and against the Cramer-Rao bound.

use crate::output_error::{Differentiable, reach_in};
use crate::recorded::Channel;
use crate::simulation::{Evenly, Question, Reading, Record, Simulation, Variant};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use tpm_controller::harmonics::Hold;
use tpm_interpret::{Interpreted, InterpretedDerivatives};
use tpm_numerics::differences::white_noise;
use tpm_numerics::{DMatrix, root_mean_square};
use tpm_test_support::models::differentiable;
use tpm_test_support::rig::{MODEL, PERIOD, Recorded, Rig, SAMPLE_TIME, TRUTH};

const SEEDS: u64 = 60;
/// Fits where noise of other kinds has to be found too, which takes longer.
const FEWER: u64 = 40;

/// The band that the ratio of a spread to the true deviation keeps to with 99.8 %, for a number of fits: roots of chi-squared over its
/// degrees of freedom (Wilson and Hilferty).
fn band(fits: usize) -> std::ops::Range<f64> {
    let spread = 2.0 / (9.0 * fits as f64);
    let edge = |z: f64| (1.0 - spread + z * spread.sqrt()).powf(1.5);
    edge(-3.09)..edge(3.09)
}

/// Parameters near the truth.
const START: [f64; 3] = [1.04 * TRUTH[0], 0.9 * TRUTH[1], 1.02 * TRUTH[2]];

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
        terms: true,
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

/// Checks deviations parameter by parameter, and returns the share of all values within 1.96 of them.
fn calibrated(what: &str, fits: &[Simulation]) -> f64 {
    let scores = scores(fits);
    let ratios = scores.each_ref().map(|scores| root_mean_square(scores.iter().copied()));
    let all: Vec<f64> = scores.concat();
    let covered = all.iter().filter(|z| z.abs() < 1.96).count() as f64 / all.len() as f64;
    assert!(ratios.iter().all(|ratio| band(fits.len()).contains(ratio)), "{what}: {ratios:?}");
    covered
}

/// A and b of `[x, v]_{k+1} = A [x, v]_k + b u_k` for the linear machine under a held force, by the series of the matrix exponential.
fn transition([m, d, k]: [f64; 3]) -> ([[f64; 2]; 2], [f64; 2]) {
    let rate = [[0.0, 1.0, 0.0], [-k / m, -d / m, 1.0 / m], [0.0; 3]];
    let mut term = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut sum = term;
    for order in 1..20 {
        let mut next = [[0.0; 3]; 3];
        for (r, row) in next.iter_mut().enumerate() {
            for (c, entry) in row.iter_mut().enumerate() {
                *entry = (0..3).map(|i| term[r][i] * rate[i][c]).sum::<f64>() * SAMPLE_TIME / f64::from(order);
            }
        }
        term = next;
        for (row, add) in sum.iter_mut().zip(&term) {
            row.iter_mut().zip(add).for_each(|(entry, add)| *entry += add);
        }
    }
    ([[sum[0][0], sum[0][1]], [sum[1][0], sum[1][1]]], [sum[0][2], sum[1][2]])
}

/// Positions, then velocities of the linear machine under a held force, in units of their noise, from parameters and starting state.
fn readings(unknown: &[f64; 5], force: &[f64], [of_position, of_velocity]: [f64; 2]) -> Vec<f64> {
    let (a, b) = transition([unknown[0], unknown[1], unknown[2]]);
    let [mut x, mut v] = [unknown[3], unknown[4]];
    let step = |u: &f64| {
        let before = (x / of_position, v / of_velocity);
        (x, v) = (a[0][0] * x + a[0][1] * v + b[0] * u, a[1][0] * x + a[1][1] * v + b[1] * u);
        before
    };
    let (mut positions, velocities): (Vec<f64>, Vec<f64>) = force.iter().map(step).unzip();
    positions.extend(velocities);
    positions
}

/// Least deviations of the parameters for white noise of the sensors and a force that is known, the starting state unknown.
fn cramer_rao(force: &[f64], noise: [f64; 2]) -> [f64; 3] {
    let at = [TRUTH[0], TRUTH[1], TRUTH[2], 0.266, 0.0];
    let sensitivity = DMatrix::from_columns(
        &[1e-4, 1e-4, 1e-3, 1e-4, 1e-4]
            .iter()
            .enumerate()
            .map(|(j, step)| {
                let moved = |by: f64| {
                    let mut unknown = at;
                    unknown[j] += by;
                    readings(&unknown, force, noise)
                };
                let (after, before) = (moved(*step), moved(-step));
                tpm_numerics::DVector::from_iterator(
                    after.len(),
                    after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * step)),
                )
            })
            .collect::<Vec<_>>(),
    );
    let covariance = sensitivity.tr_mul(&sensitivity).cholesky().expect("all show").inverse();
    [0, 1, 2].map(|j| covariance[(j, j)].sqrt())
}

#[test]
fn white_noise_is_met_at_the_cramer_rao_bound() {
    let rig = Rig::default();
    let fits = fits(rig, SEEDS);
    let covered = calibrated("white", &fits);
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
    let covered = calibrated("rates", &fits);
    assert!((0.9..0.99).contains(&covered), "{covered}");
    let refused = fits.iter().filter(|found| found.rates.iter().any(|rate| rate.fault.is_some())).count();
    assert!(refused * 20 <= fits.len(), "{refused}");
}

#[test]
fn noise_of_the_recorded_force_is_found_and_leaves_no_bias() {
    let rig = Rig { force_noise: 0.5, ..Rig::default() };
    let fits = fits(rig, FEWER);
    let covered = calibrated("force noise", &fits);
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
    let covered = calibrated("coloured", &fits);
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
