//! Sweeps whose truth is known, and the delay of an input.

use crate::likelihood::{OfAnyMotion, estimate_any_motion};
use crate::settings::{Frozen, Settings};
use crate::time_domain::{InputShift, Stretch, TimeRecord, input_shift};
use crate::verdict::Status;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use tpm_controller::harmonics::Hold;
use tpm_numerics::root_mean_square;
use tpm_test_support::models::MassSpringDrag;

const SAMPLE_TIME: f64 = 2e-3;
/// m, k1, k2 of `m x'' + k1 x + k2 x'^2 = u`.
const TRUTH: [f64; 3] = [2.0, 40.0, 1.5];

/// Position, velocity and force of a motion, given position, velocity and acceleration over time.
fn played(seconds: f64, motion: impl Fn(f64) -> [f64; 3]) -> [Vec<f64>; 3] {
    let samples = (seconds / SAMPLE_TIME) as usize;
    let mut out = [const { Vec::new() }; 3];
    for k in 0..samples {
        let [x, v, a] = motion(k as f64 * SAMPLE_TIME);
        let u = TRUTH[0] * a + TRUTH[1] * x + TRUTH[2] * v * v;
        out.iter_mut().zip([x, v, u]).for_each(|(signal, value)| signal.push(value));
    }
    out
}

/// A sweep of the frequency from .3 to 1.5 Hz.
fn sweep(t: f64) -> [f64; 3] {
    let (w, slope) = (2.0 * PI * (0.3 + 0.06 * t), 2.0 * PI * 0.06);
    let (s, c) = (2.0 * PI * (0.3 * t + 0.03 * t * t)).sin_cos();
    [0.3 * s, 0.3 * w * c, 0.3 * (slope * c - w * w * s)]
}

/// The signals with white noise of these deviations.
fn noisy(signals: &[Vec<f64>; 3], deviations: [f64; 3], seed: u64) -> [Vec<f64>; 3] {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut of = |i: usize| -> Vec<f64> {
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        signals[i].iter().map(|value| value + deviations[i] * draw()).collect()
    };
    [of(0), of(1), of(2)]
}

fn stretch([x, v, u]: &[Vec<f64>; 3], rated: bool) -> Stretch<'_> {
    Stretch { coordinates: vec![x], rates: vec![rated.then_some(v.as_slice())], inputs: vec![u] }
}

/// The estimate from stretches of samples; with or without the measured rate.
fn estimate(stretches: &[&[Vec<f64>; 3]], rated: bool, settings: &Settings) -> OfAnyMotion {
    let record = TimeRecord {
        sample_time: SAMPLE_TIME,
        hold: Hold::None,
        actuators: &[],
        following: &[],
        stretches: stretches.iter().map(|signals| stretch(signals, rated)).collect(),
    };
    estimate_any_motion(&MassSpringDrag, &[], &record, false, settings).expect("a record")
}

fn errors(found: &OfAnyMotion) -> [f64; 3] {
    [0, 1, 2].map(|j| found.estimate.values[j] / TRUTH[j] - 1.0)
}

#[test]
fn an_exact_sweep_gives_exact_parameters() {
    let found = estimate(&[&played(20.0, sweep)], false, &Settings::default());
    assert!(errors(&found).iter().all(|error| error.abs() < 1e-5), "{:?}", errors(&found));
    assert_eq!(found.estimate.rank, 3);
}

#[test]
fn deviations_hold_the_truth() {
    let exact = played(20.0, sweep);
    let records = 60;
    let scores: Vec<[f64; 3]> = (0..records)
        .map(|seed| {
            let found = estimate(&[&noisy(&exact, [1e-3, 0.0, 0.05], seed)], false, &Settings::default());
            [0, 1, 2].map(|j| (found.estimate.values[j] - TRUTH[j]) / found.estimate.std[j])
        })
        .collect();
    for j in 0..3 {
        let ratio = root_mean_square(scores.iter().map(|score| score[j]));
        // What bands move is in the deviations too, so that they are rather too large.
        assert!((0.45..1.3).contains(&ratio), "parameter {j}: {ratio}");
    }
}

#[test]
fn noise_of_the_sensor_does_not_make_parameters_smaller() {
    let exact = played(20.0, sweep);
    let records = 30;
    // A tenth of the motion.
    let found =
        (0..records).map(|seed| estimate(&[&noisy(&exact, [0.03, 0.0, 0.05], seed)], false, &Settings::default()));
    let all: Vec<[f64; 3]> = found.map(|found| errors(&found)).collect();
    for j in 0..2 {
        let mean = all.iter().map(|errors| errors[j]).sum::<f64>() / all.len() as f64;
        let spread = root_mean_square(all.iter().map(|errors| errors[j] - mean)) / (all.len() as f64).sqrt();
        assert!(mean.abs() < 4.0 * spread + 2e-3, "parameter {j}: {mean} +- {spread}");
    }
}

#[test]
fn one_frequency_hides_mass_and_stiffness_from_each_other_however_noisy_the_sensor() {
    let w = 2.0 * PI;
    let sine = |t: f64| [0.3 * (w * t).sin(), 0.3 * w * (w * t).cos(), -0.3 * w * w * (w * t).sin()];
    let exact = played(20.0, sine);
    for (seed, noise) in [(1, 1e-6), (2, 1e-3), (3, 1e-2)] {
        let found = estimate(&[&noisy(&exact, [noise, 0.0, 1e-3], seed)], false, &Settings::default());
        let estimate = &found.estimate;
        assert_eq!((estimate.rank, estimate.unobservable.len()), (2, 1), "noise {noise}: {estimate:?}");
        let direction = &estimate.unobservable[0];
        assert!((direction[1] / direction[0] / (w * w) - 1.0).abs() < 0.01, "noise {noise}: {direction:?}");
        assert_eq!(estimate.status[0], Status::Unobservable);
        // What is shown is k1 - w^2 m, and the drag.
        let shown = estimate.values[1] - w * w * estimate.values[0];
        assert!((shown / (TRUTH[1] - w * w * TRUTH[0]) - 1.0).abs() < 0.01, "noise {noise}: {shown}");
        assert!((estimate.values[2] / TRUTH[2] - 1.0).abs() < 0.02, "noise {noise}: {estimate:?}");
    }
}

#[test]
fn a_measured_rate_makes_deviations_smaller() {
    let exact = played(20.0, sweep);
    let signals = noisy(&exact, [1e-2, 1e-3, 0.01], 4);
    let alone = estimate(&[&signals], false, &Settings::default());
    let rated = estimate(&[&signals], true, &Settings::default());
    assert!(rated.estimate.std[0] < 0.5 * alone.estimate.std[0], "{:?} {:?}", rated.estimate.std, alone.estimate.std);
    assert!(errors(&rated).iter().all(|error| error.abs() < 5e-3), "{:?}", errors(&rated));
    let gain = rated.report.rate_gains[0].expect("measured");
    assert!((gain - 1.0).abs() < 1e-2, "{gain}");
    let [x, v, u] = signals;
    let scaled = [x, v.iter().map(|v| 57.3 * v).collect(), u];
    let gain = estimate(&[&scaled], true, &Settings::default()).report.rate_gains[0].expect("measured");
    assert!((gain / 57.3 - 1.0).abs() < 1e-2, "{gain}");
}

#[test]
fn stretches_count_together_and_nothing_is_taken_across_a_gap() {
    let signals = noisy(&played(40.0, |t| sweep(t % 20.0)), [1e-4, 0.0, 0.01], 6);
    let part = |from: usize, to: usize| signals.each_ref().map(|signal| signal[from..to].to_vec());
    let found = estimate(&[&part(0, 9_000), &part(10_500, 19_000)], false, &Settings::default());
    assert!(errors(&found).iter().all(|error| error.abs() < 2e-3), "{:?}", errors(&found));
}

#[test]
fn stretches_of_any_length_are_used_or_left_out() {
    let signals = noisy(&played(20.0, sweep), [1e-4, 0.0, 0.01], 7);
    for length in (16..600).step_by(7) {
        let part = |from: usize, to: usize| signals.each_ref().map(|signal| signal[from..to].to_vec());
        let found = estimate(&[&part(0, length), &part(1_000, 10_000)], false, &Settings::default());
        assert!(errors(&found).iter().all(|error| error.abs() < 1e-2), "{length}: {:?}", errors(&found));
    }
}

#[test]
fn a_held_parameter_stays() {
    let settings = Settings { frozen: vec![Frozen { parameter: 0, value: 2.2 }], ..Settings::default() };
    let found = estimate(&[&played(20.0, sweep)], false, &settings);
    assert_eq!((found.estimate.values[0], found.estimate.status[0]), (2.2, Status::Frozen));
    assert!(found.estimate.residual > 1e-3);
}

/// The shift that is found of an input that is recorded so much before it acts.
fn shift(delay: f64, motion: impl Fn(f64) -> [f64; 3]) -> Option<InputShift> {
    let [x, v, _] = noisy(&played(20.0, &motion), [1e-3, 0.0, 0.0], 11);
    let [_, _, early] = noisy(&played(20.0, |t| motion(t + delay)), [0.0, 0.0, 0.05], 12);
    let signals = [x, v, early];
    let record = TimeRecord {
        sample_time: SAMPLE_TIME,
        hold: Hold::None,
        actuators: &[],
        following: &[],
        stretches: vec![stretch(&signals, false)],
    };
    input_shift(&MassSpringDrag, None, &[], &record, &Settings::default()).expect("a record")
}

#[test]
fn the_delay_of_an_input_is_told_to_a_part_of_a_sample() {
    for delay in [0.0, 0.5 * SAMPLE_TIME, 3.3 * SAMPLE_TIME, -2.0 * SAMPLE_TIME, 0.05] {
        let found = shift(delay, sweep).expect("told");
        assert!((found.delay - delay).abs() < 0.2 * SAMPLE_TIME, "{delay}: {found:?}");
        assert!((found.delay - delay).abs() < 4.0 * found.deviation + 1e-5, "{delay}: {found:?}");
        assert!(found.deviation < 0.2 * SAMPLE_TIME && found.left_shifted <= found.left, "{found:?}");
    }
}
