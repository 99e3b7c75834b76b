//! Fits of simulated records: what is stated against what comes out over many seeds, and against the Cramer-Rao bound.

use crate::output_error::fit::{OutputError, strongest};
use crate::output_error::problem::Differentiable;
use crate::output_error::signals::{Course, Rate, Signals};
use crate::rig_checks::{START, calibrated, cramer_rao};
use num_complex::Complex;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::sync::OnceLock;
use tpm_controller::harmonics::Hold;
use tpm_interpret::{Interpreted, InterpretedDerivatives};
use tpm_motion::Spectra;
use tpm_numerics::differences::white_noise;
use tpm_numerics::root_mean_square;
use tpm_test_support::models::differentiable;
use tpm_test_support::rig::{MODEL, PERIOD, Recorded, Rig, SAMPLE_TIME, TRUTH};

const SEEDS: u64 = 60;
/// Fits where noise of other kinds has to be found too, which takes longer.
const FEWER: u64 = 40;

fn fit(
    machine: (&Interpreted, &InterpretedDerivatives),
    recorded: &Recorded,
    periods: usize,
    start: [f64; 3],
) -> OutputError {
    fit_with_rate(machine, recorded, periods, start, None)
}

fn fit_with_rate(
    (model, derivatives): (&Interpreted, &InterpretedDerivatives),
    recorded: &Recorded,
    periods: usize,
    start: [f64; 3],
    rate: Option<&[f64]>,
) -> OutputError {
    let channels = [recorded.position.as_slice(), recorded.force.as_slice()];
    let spectra = Spectra::analyse(&channels, SAMPLE_TIME, PERIOD as f64, periods).expect("whole periods");
    let lines = |channel: usize| -> Vec<Complex<f64>> {
        let certain = |(k, line): (usize, &Complex<f64>)| {
            let stands_out = k == 0 || line.norm_sqr() > 9.0 * spectra.variance(channel, k);
            if stands_out { *line } else { Complex::new(0.0, 0.0) }
        };
        spectra.lines[channel].iter().take(20).enumerate().map(certain).collect()
    };
    let signals = Signals {
        sample_time: SAMPLE_TIME,
        hold: Hold::Zoh,
        coordinates: vec![channels[0]],
        rates: rate
            .into_iter()
            .map(|readings| Rate { coordinate: 0, readings, noise: white_noise(readings) })
            .collect(),
        inputs: vec![channels[1]],
        course: Course::Periodic {
            samples_per_period: PERIOD as f64,
            lines: vec![lines(0)],
            input_lines: vec![lines(1)],
        },
        joins: Vec::new(),
        white: vec![white_noise(channels[0])],
        steps: vec![0.0],
        denoised_inputs: OnceLock::new(),
    };
    let machine = Differentiable { model, derivatives };
    OutputError::fit(machine, &[], &signals, &start, &[0, 1, 2], &[]).expect("settles")
}

/// All fits of a rig, by seed.
fn fits(rig: Rig, seeds: u64) -> Vec<OutputError> {
    let (model, derivatives) = differentiable(MODEL);
    (0..seeds).into_par_iter().map(|seed| fit((&model, &derivatives), &rig.play(seed), rig.periods, START)).collect()
}

fn deviation(found: &OutputError, parameter: usize) -> f64 {
    found.covariance(parameter, parameter).expect("free").sqrt()
}

/// Errors in units of the stated deviation, by parameter and fit.
fn scores(fits: &[OutputError]) -> [Vec<f64>; 3] {
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
        assert!(efficiency < 1.2, "{j}: {efficiency}");
        // What is stated is the bound itself, but for the noise that each record is found to have.
        let stated = fits.iter().map(|found| deviation(found, j)).sum::<f64>() / fits.len() as f64;
        assert!((0.97..1.03).contains(&(stated / bound)), "{j}: {}", stated / bound);
    }
    for found in &fits {
        assert!((0.93..1.07).contains(&(found.sensor_noise[0] / rig.white)), "{:?}", found.sensor_noise);
        assert_eq!((found.input_noise.as_slice(), found.colour.as_slice()), ([0.0].as_slice(), [0.0].as_slice()));
        assert!(found.iterations.is_some_and(|steps| steps <= 8));
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
        fit_with_rate((&model, &derivatives), &recorded, rig.periods, START, Some(&rate))
    };
    let fits: Vec<OutputError> = (0..SEEDS).into_par_iter().map(found).collect();
    let covered = calibrated("rates", scores(&fits));
    assert!((0.9..0.99).contains(&covered), "{covered}");
}

#[test]
fn noise_of_the_recorded_force_is_found_and_leaves_no_bias() {
    let rig = Rig { force_noise: 0.5, ..Rig::default() };
    let fits = fits(rig, FEWER);
    let covered = calibrated("force noise", scores(&fits));
    assert!((0.9..0.995).contains(&covered), "{covered}");
    // Among 1000 readings few tell the size of this noise, so that single logs scatter.
    let sizes: Vec<f64> = fits.iter().map(|found| found.input_noise[0] / 0.5).collect();
    assert!(sizes.iter().all(|size| (0.4..2.5).contains(size)), "{sizes:?}");
    let mean = sizes.iter().map(|size| size.ln()).sum::<f64>() / sizes.len() as f64;
    assert!(mean.abs() < 0.15, "{sizes:?}");
    for (j, scores) in scores(&fits).iter().enumerate() {
        let mean = scores.iter().sum::<f64>() / (FEWER as f64).sqrt();
        assert!(mean.abs() < 3.3, "{j}: bias of {mean} deviations of the mean");
    }
}

#[test]
fn noise_of_the_force_that_a_stretch_does_not_tell_is_found_in_the_whole_record() {
    let rig = Rig { periods: 64, white: 1e-3, force_noise: 0.03, ..Rig::default() };
    let fits = fits(rig, 12);
    let sizes: Vec<f64> = fits.iter().map(|found| found.input_noise[0] / 0.03).collect();
    let found: Vec<f64> = sizes.iter().copied().filter(|size| *size > 0.0).collect();
    assert!(found.len() >= 10, "{sizes:?}");
    assert!(found.iter().all(|size| (0.4..2.0).contains(size)), "{sizes:?}");
    let mean = found.iter().map(|size| size.ln()).sum::<f64>() / found.len() as f64;
    assert!(mean.abs() < 0.25, "{sizes:?}");
}

#[test]
fn coloured_noise_of_the_sensor_is_found() {
    let rig = Rig { white: 0.0, coloured: 1e-4, ..Rig::default() };
    let fits = fits(rig, FEWER);
    let covered = calibrated("coloured", scores(&fits));
    assert!((0.9..0.995).contains(&covered), "{covered}");
    let off = fits.iter().filter(|found| (found.colour[0] - tpm_test_support::rig::COLOUR).abs() > 0.06).count();
    assert!(off * 20 <= fits.len(), "{:?}", fits.iter().map(|found| found.colour[0]).collect::<Vec<_>>());
}

#[test]
fn a_start_from_far_away_ends_at_the_same_values() {
    let (model, derivatives) = differentiable(MODEL);
    let rig = Rig::default();
    let recorded = rig.play(1);
    let near = fit((&model, &derivatives), &recorded, rig.periods, START);
    let far = fit((&model, &derivatives), &recorded, rig.periods, [0.5 * TRUTH[0], 4.0 * TRUTH[1], 2.0 * TRUTH[2]]);
    for j in 0..3 {
        let apart = (near.values[j] - far.values[j]) / deviation(&near, j);
        assert!(apart.abs() < 0.05, "{j}: {apart}");
    }
}

#[test]
fn limits_are_weighed_where_the_inputs_are_largest_beside_their_own_size() {
    let mut one = vec![1.0; 100];
    let mut other = vec![1e-3; 100];
    assert_eq!(strongest(&[&one, &other], 200), 0..100);
    other[71..75].fill(2e-3);
    assert_eq!(strongest(&[&one, &other], 4), 71..75);
    one[20..24].fill(-4.0);
    assert_eq!(strongest(&[&one, &other], 4), 20..24);
    one[96..].fill(5.0);
    assert_eq!(strongest(&[&one, &other], 4), 96..100);
    assert_eq!(strongest(&[], 4), 0..0);
}
