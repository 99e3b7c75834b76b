//! Identification from synthetic logs of known motions and known parameters.

use crate::log_fault::LogFault;
use crate::log_report::Way;
use crate::options::LogOptions;
use crate::reading::RecordSettings;
use crate::{Exchange, Identification, LogReport, PeriodicReport, Warning, identify_log};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use std::{format, vec};
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_estimate::{Domain, Estimate, Settings, Status, Weights};
use tpm_log::Log;
use tpm_report::Remedy;
use tpm_test_support::models::{Emps, MassSpringDrag, Silverbox, TwoCarts};

fn estimate(result: &Identification) -> &Estimate {
    result.estimate.as_ref().expect("a log that identifies has an estimate")
}

fn report(result: &Identification) -> &PeriodicReport {
    result.log.as_ref().and_then(LogReport::periodic).expect("a log that repeats has a report")
}

/// Options of a log of which only is known how it is read.
fn read(reading: RecordSettings) -> LogOptions {
    LogOptions { reading, ..LogOptions::default() }
}

/// A Fourier series: (harmonic, cosine, sine).
type Series = [(f64, f64, f64)];

/// Position, velocity and acceleration of a series at time t; w is the fundamental angular frequency.
fn motion(series: &Series, w: f64, t: f64) -> [f64; 3] {
    series.iter().fold([0.0; 3], |[x, v, a], &(k, c, s)| {
        let (sin, cos) = (k * w * t).sin_cos();
        let n = k * w;
        [x + c * cos + s * sin, v + n * (s * cos - c * sin), a - n * n * (c * cos + s * sin)]
    })
}

/// One sample of white noise of unit standard deviation.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

const REST_TO_REST: &Series = &[(1.0, 0.3, 0.0), (3.0, -0.3 / 9.0, 0.0)];

/// A log of m x'' + k1 x + k2 x'^2 = u with the exact u at the samples.
fn slider(theta: [f64; 3], period: f64, samples: usize, noise: [f64; 2], seed: u64) -> Log {
    let dt = 1e-3;
    let w = 2.0 * PI / (period * dt);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut xs, mut us) = (Vec::new(), Vec::new());
    for i in 0..samples {
        let [x, v, a] = motion(REST_TO_REST, w, i as f64 * dt);
        xs.push(x + noise[0] * normal(&mut rng));
        us.push(theta[0] * a + theta[1] * x + theta[2] * v * v + noise[1] * normal(&mut rng));
    }
    Log::from_samples("synthetic", dt, vec![xs, us]).expect("sound")
}

fn values(result: &Identification) -> Vec<f64> {
    estimate(result).values.clone()
}

fn near(found: &[f64], truth: &[f64], bound: f64) {
    for (f, t) in found.iter().zip(truth) {
        assert!((f / t - 1.0).abs() < bound, "{found:?} against {truth:?}");
    }
}

#[test]
fn exact_logs_give_exact_parameters() {
    let truth = [2.0, 40.0, 1.5];
    for (period, samples, bound) in [(800.0, 4100, 1e-9), (800.0, 1700, 1e-9), (640.4, 3000, 1e-5)] {
        let log = slider(truth, period, samples, [0.0; 2], 1);
        let result = identify_log(&MassSpringDrag, &log, &LogOptions::default()).expect("identifies");
        near(&values(&result), &truth, bound);
        assert!((report(&result).samples_per_period - period).abs() < 1e-3, "{:?}", result.log);
        assert_eq!(result.rank, 3);
        assert!(result.warnings.is_empty(), "{:?}", result.warnings);
    }
}

#[test]
fn exchanged_columns_are_named_and_nothing_of_them_is_trusted() {
    let mut log = slider([20.0, 500.0, 30.0], 2000.0, 8000, [1e-4, 0.0], 1);
    let sound = identify_log(&MassSpringDrag, &log, &LogOptions::default()).expect("identifies");
    assert!(sound.warnings.is_empty(), "{:?}", sound.warnings);
    log.channels.swap(0, 1);
    let result = identify_log(&MassSpringDrag, &log, &LogOptions::default()).expect("identifies");
    let first = result.warnings.first().expect("warns");
    let named = match first {
        Warning::Exchanged { exchange: Exchange::Columns { signals }, left, left_by_exchange } => {
            (left_by_exchange - sound.residual).abs() < 1e-3 * sound.residual
                && (left - result.residual).abs() < 1e-12
                && signals[..] == ["x", "u"]
        }
        _ => false,
    };
    assert!(named, "{:?}", result.warnings);
    assert_eq!(first.remedy(), Some(Remedy::MapColumns { signals: vec!["x".into(), "u".into()] }));
    let trusted = result.parameters.iter().filter(|parameter| parameter.status == Status::Identified);
    assert_eq!(trusted.count(), 0, "{:?}", result.parameters);
}

/// Dry friction of the wrong sign drives the machine, whatever else the model is made of; an offset of the force may have either sign.
#[test]
fn friction_that_gives_energy_is_named() {
    let w = 2.0 * PI / 0.8;
    let log = |friction: f64| {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let sample = |i: usize| {
            let [x, v, a] = motion(&[(1.0, 0.3, 0.1), (2.0, 0.05, 0.0)], w, i as f64 * 1e-3);
            (x + 1e-6 * normal(&mut rng), 95.0 * a + 200.0 * v + friction * v.signum() - 3.0)
        };
        let (xs, us) = (0..4000).map(sample).unzip();
        Log::from_samples("synthetic", 1e-3, vec![xs, us]).expect("sound")
    };
    for (friction, named) in [(20.0, None), (-20.0, Some("Fc"))] {
        let result = identify_log(&Emps, &log(friction), &LogOptions::default()).expect("identifies");
        let gives = result.warnings.iter().find_map(|warning| match warning {
            Warning::GivesEnergy { parameter, .. } => Some(parameter.as_str()),
            _ => None,
        });
        assert_eq!(gives, named, "{:?}", result.warnings);
        assert_eq!(result.warnings.iter().any(Warning::is_distrust), named.is_some(), "{:?}", result.warnings);
    }
}

/// A log of m x'' + k1 x + k2 x'^2 = u on any motion of a period of one second, with noise on the position, and a force `lacking` at one
/// harmonic that the model lacks.
fn pushed(series: &Series, lacking: (usize, f64)) -> Log {
    let (w, (harmonic, amplitude)) = (2.0 * PI, lacking);
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut xs, mut us) = (Vec::new(), Vec::new());
    for i in 0..8000 {
        let t = f64::from(i) * 1e-3;
        let [x, v, a] = motion(series, w, t);
        xs.push(x + 1e-5 * normal(&mut rng));
        us.push(2.0 * a + 40.0 * x + 1.5 * v * v + amplitude * (harmonic as f64 * w * t).cos());
    }
    Log::from_samples("synthetic", 1e-3, vec![xs, us]).expect("sound")
}

#[test]
fn a_force_that_nothing_would_show_is_said_beforehand() {
    // Mass and spring take up the real parts of two harmonics, whatever they are.
    let sound = identify_log(&MassSpringDrag, &pushed(REST_TO_REST, (1, 0.0)), &LogOptions::default()).expect("known");
    let untested = &report(&sound).untested;
    let names: Vec<&str> = untested.iter().map(|own| own.parameter.as_str()).collect();
    assert_eq!(names, ["m", "k1"], "{untested:?}");
    assert!(sound.warnings.is_empty(), "{:?}", sound.warnings);
    // The force of the row as the equations have it, from its terms' amplitudes.
    let w2 = (2.0 * PI).powi(2);
    let part = |k: f64, x: f64, v: f64| (40.0 - 2.0 * k * k * w2) * x + v;
    let (v1, v3) = (0.3 * 2.0 * PI, 0.3 / 3.0 * 2.0 * PI);
    let drag = [v1 * v3 - 0.5 * v1 * v1, -v1 * v3, -0.5 * v3 * v3].map(|square| 1.5 * square);
    let lines = [part(1.0, 0.3, 0.0), part(3.0, -0.3 / 9.0, 0.0), drag[0], drag[1], drag[2]];
    let rms = (0.5 * lines.iter().map(|line| line * line).sum::<f64>()).sqrt();
    for own in untested {
        assert!(own.deviations > 10.0, "{own:?}");
        let force = (own.harmonic, own.share * 2f64.sqrt() * rms);
        let pushed =
            identify_log(&MassSpringDrag, &pushed(REST_TO_REST, force), &LogOptions::default()).expect("known");
        let at = if own.parameter == "m" { 0 } else { 1 };
        let moved = (values(&pushed)[at] - values(&sound)[at]).abs();
        assert!((moved / own.change - 1.0).abs() < 0.02, "{own:?} moved by {moved}");
        assert!(pushed.residual < 1.05 * sound.residual, "{} beside {}", pushed.residual, sound.residual);
        assert!(pushed.warnings.is_empty(), "{:?}", pushed.warnings);
    }
    let richer: &Series = &[(1.0, 0.3, 0.0), (2.0, 0.0, 0.05), (3.0, -0.3 / 9.0, 0.0)];
    let tested = identify_log(&MassSpringDrag, &pushed(richer, (1, 0.0)), &LogOptions::default()).expect("known");
    assert!(report(&tested).untested.is_empty(), "{:?}", report(&tested).untested);
}

#[test]
fn friction_and_offset_are_found_and_noise_is_stated() {
    let truth = [95.0, 200.0, 20.0, -3.0];
    let dt = 1e-3;
    let w = 2.0 * PI / 2.0;
    let series: &Series = &[(1.0, 0.1, 0.0), (3.0, -0.1 / 9.0, 0.0), (2.0, 0.02, 0.01)];
    for sigma in [0.0, 0.5] {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (mut qs, mut us) = (Vec::new(), Vec::new());
        for i in 0..8000 {
            let [q, v, a] = motion(series, w, (f64::from(i) + 0.3) * dt);
            qs.push(q);
            let friction = if v == 0.0 { 0.0 } else { v.signum() };
            us.push(truth[0] * a + truth[1] * v + truth[2] * friction + truth[3] + sigma * normal(&mut rng));
        }
        let log = Log::from_samples("synthetic", dt, vec![qs, us]).expect("sound");
        let result = identify_log(&Emps, &log, &LogOptions::default()).expect("identifies");
        // The instant of a jump sampled at 1 kHz is known only to one sample: the harmonics alias at about 1/2000.
        near(&values(&result), &truth, if sigma > 0.0 { 0.02 } else { 2e-3 });
        for (p, t) in result.parameters.iter().zip(truth) {
            let deviation = (p.value.expect("seen") - t) / p.std.expect("seen");
            assert!(deviation.abs() < 4.0, "{}: {deviation}", p.name);
        }
    }
}

#[test]
fn free_rows_need_no_input() {
    // x2 is prescribed; the free cart's equation gives x1 = x2 + (m2/k3) x2'', and the driven cart's equation gives F.
    let truth = [2.0, 1.0, 40.0, 300.0, 200.0];
    let (dt, w) = (1e-3, 4.0);
    let period = 2.0 * PI / w / dt;
    let rho = truth[1] / truth[4];
    let (mut x1s, mut x2s, mut us) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..(period * 4.5) as usize {
        let t = i as f64 * dt;
        let harmonics = [(1.0, 0.4), (3.0, -0.4 / 6.0), (5.0, 0.4 / 50.0)];
        let (mut x1, mut a1, mut x2) = (0.0, 0.0, 0.0);
        for (k, c) in harmonics {
            let n: f64 = k * w;
            let cos = (n * t).cos();
            x2 += c * cos;
            x1 += c * (1.0 - rho * n * n) * cos;
            a1 -= c * n * n * (1.0 - rho * n * n) * cos;
        }
        x1s.push(x1);
        x2s.push(x2);
        us.push(truth[0] * a1 + truth[2] * x1 + truth[3] * x1.powi(3) + truth[4] * (x1 - x2));
    }
    let log = Log::from_samples("synthetic", dt, vec![x1s, x2s, us]).expect("sound");
    let result = identify_log(&TwoCarts, &log, &LogOptions::default()).expect("identifies");
    near(&values(&result), &truth, 1e-6);
    assert_eq!(report(&result).lines.len(), 2);
}

#[test]
fn what_is_not_visible_is_named_and_not_given_a_number() {
    // With one harmonic and no damping, m and k1 cannot be told apart.
    let (dt, w) = (1e-3, 2.0 * PI);
    let (mut xs, mut us) = (Vec::new(), Vec::new());
    for i in 0..4500 {
        let [x, v, a] = motion(&[(1.0, 0.1, 0.0)], w, f64::from(i) * dt);
        xs.push(x);
        us.push(2.0 * a + 40.0 * x + 1.5 * v * v);
    }
    let log = Log::from_samples("synthetic", dt, vec![xs, us]).expect("sound");
    let result = identify_log(&MassSpringDrag, &log, &LogOptions::default()).expect("identifies");
    assert_eq!(result.rank, 2);
    assert_eq!(result.parameters[0].status, Status::Unobservable);
    assert_eq!(result.parameters[1].value, None);
    assert!((result.parameters[2].value.expect("seen") - 1.5).abs() < 1e-8);
    let direction = &result.unobservable[0];
    let part = |name: &str| direction[name].parse::<f64>().expect("a number");
    assert!((part("k1") - 1.0).abs() < 1e-9 && (part("m") - 1.0 / (w * w)).abs() < 1e-9);
    // One combination of them is observable.
    assert_eq!(result.combinations.len(), 1);
    let together = &result.combinations[0];
    assert!((together.value - (2.0 - 40.0 / (w * w))).abs() < 1e-8 && together.std < 1e-6, "{together:?}");
    assert_eq!(together.terms["m"], "1");
    assert!(
        result
            .warnings
            .iter()
            .any(|warning| warning.to_string().ends_with("only in combinations with each other: m, k1"))
    );
    let json = serde_json::to_value(&result).expect("serialises");
    assert_eq!(json["schema"], "tpm.identification/2");
    assert!(json["parameters"][0]["value"].is_null() && json["covariance"][0][0].is_null());
    assert_eq!(json["hold"], "none");
}

#[test]
fn the_end_of_a_sweep_is_not_taken_for_a_periodic_motion() {
    let (dt, truth) = (1e-3, [2.0, 40.0, 1.5]);
    let (mut xs, mut us) = (Vec::new(), Vec::new());
    for i in 0..20_000 {
        // The frequency sweeps from 0.5 to 0.55 Hz in 20 s.
        let t = f64::from(i) * dt;
        let (phase, w, slope) = (PI * t * (1.0 + 0.0025 * t), PI * (1.0 + 0.005 * t), 0.005 * PI);
        let (sin, cos) = phase.sin_cos();
        let [x, v, a] = [0.3 * sin, 0.3 * w * cos, 0.3 * (slope * cos - w * w * sin)];
        xs.push(x);
        us.push(truth[0] * a + truth[1] * x + truth[2] * v * v);
    }
    let log = Log::from_samples("sweep", dt, vec![xs, us]).expect("sound");
    let result = identify_log(&MassSpringDrag, &log, &LogOptions::default()).expect("any motion will do");
    assert!(result.log.as_ref().is_some_and(|log| matches!(log.way, Way::Spectral(_))), "{:?}", result.log);
    near(&values(&result), &truth, 1e-4);
    let by_harmonics = LogOptions { domain: Some(Domain::Harmonics), ..LogOptions::default() };
    match identify_log(&MassSpringDrag, &log, &by_harmonics) {
        Err(error) => assert!(matches!(error, LogFault::NotPeriodic { .. }), "{error}"),
        Ok(result) => {
            assert!(
                result.warnings.iter().any(|w| w.to_string().contains("more than half of the log")),
                "{:?}",
                result.warnings
            );
        }
    }
}

#[test]
fn the_wrong_hold_is_warned_about() {
    // The input is held: the plant responds to the harmonics of the held input.
    let (dt, w, d) = (1e-3, 2.0 * PI * 4.0, 3e-3);
    let truth = [1e-2, d, 30.0, 0.5];
    let held = |t: f64| {
        // u(t) is chosen such that its harmonics, filtered by the hold, are those of the motion: the hold is divided
        // out of every harmonic.
        let mut sum = 0.0;
        for (k, c) in [(1.0, 0.3), (3.0, 0.2), (9.0, 0.1)] {
            let n: f64 = k * w;
            let (re, im) = (truth[2] - truth[0] * n * n, d * n);
            let half = n * dt / 2.0;
            let gain = half / half.sin();
            let (sin, cos) = (n * t + half).sin_cos();
            sum += gain * c * (re * cos - im * sin);
        }
        sum
    };
    let cubic = [0.0, 0.0];
    let (mut ys, mut us) = (Vec::new(), Vec::new());
    for i in 0..2600 {
        let t = f64::from(i) * dt;
        let [y, ..] = motion(&[(1.0, 0.3, 0.0), (3.0, 0.2, 0.0), (9.0, 0.1, 0.0)], w, t);
        ys.push(y);
        us.push(held(t) + cubic[0] * y);
    }
    let log = Log::from_samples("synthetic", dt, vec![ys, us]).expect("sound");
    let mut options = read(RecordSettings { hold: Hold::Zoh, ..RecordSettings::default() });
    let right = identify_log(&Silverbox, &log, &options).expect("identifies");
    near(&values(&right)[..3], &truth[..3], 1e-7);
    assert!(right.warnings.is_empty(), "{:?}", right.warnings);
    options.reading.hold = Hold::None;
    let wrong = identify_log(&Silverbox, &log, &options).expect("identifies");
    assert!(
        wrong.warnings[0].to_string().starts_with("hold zoh explains the log clearly better"),
        "{:?}",
        wrong.warnings
    );
}

#[test]
fn faults_of_the_whole_log_say_what_to_do() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut x, mut v) = (0.0, 0.0);
    let walk: Vec<f64> = (0..4000)
        .map(|_| {
            v = 0.99 * v + 0.01 * normal(&mut rng);
            x = 0.999 * x + v;
            x
        })
        .collect();
    let log = Log::from_samples("walk", 1e-3, vec![walk.clone(), walk]).expect("sound");
    let by_harmonics = LogOptions { domain: Some(Domain::Harmonics), ..LogOptions::default() };
    let error = identify_log(&MassSpringDrag, &log, &by_harmonics).expect_err("not periodic");
    let message = format!("{error}");
    assert!(message.starts_with("walk:1-4000: the motion"), "{message}");
    assert!(message.contains("record at least two whole periods"), "{message}");

    let log = slider([2.0, 40.0, 1.5], 800.0, 2500, [0.0; 2], 1);
    let options = read(RecordSettings { period: Some(800.0), ..RecordSettings::default() });
    let error = identify_log(&MassSpringDrag, &log, &options).expect_err("800 seconds");
    assert!(format!("{error}").contains("it is given in seconds"), "{error}");
    let options = read(RecordSettings { from_sample: Some(9000), ..RecordSettings::default() });
    let error = identify_log(&MassSpringDrag, &log, &options).expect_err("behind the end");
    assert!(matches!(error, LogFault::BadRange { .. }));
    // Stated values are taken as they are.
    let options = read(RecordSettings { period: Some(0.8), from_sample: Some(100), ..RecordSettings::default() });
    let result = identify_log(&MassSpringDrag, &log, &options).expect("identifies");
    assert_eq!((report(&result).from_sample, report(&result).periods), (100, 3));
    let options = LogOptions { constants: vec![1.0], ..LogOptions::default() };
    let error = identify_log(&MassSpringDrag, &log, &options).expect_err("no such constant");
    assert!(matches!(error, LogFault::Constants { needed: 0, given: 1, .. }));
}

/// Root mean square of the estimation errors divided by the stated standard deviations, per parameter, over many seeds.
fn spread(make: impl Fn(u64) -> Log, options: &LogOptions, truth: &[f64], seeds: u64) -> Vec<f64> {
    let model: &dyn Model<f64> = &MassSpringDrag;
    let mut sums = vec![0.0; truth.len()];
    for seed in 0..seeds {
        let result = identify_log(model, &make(seed), options).expect("identifies");
        for ((sum, p), t) in sums.iter_mut().zip(&result.parameters).zip(truth) {
            let deviation = (p.value.expect("seen") - t) / p.std.expect("seen");
            *sum += deviation * deviation / seeds as f64;
        }
    }
    sums.iter().map(|s: &f64| s.sqrt()).collect()
}

#[test]
fn stated_deviations_agree_with_the_spread() {
    let truth = [2.0, 40.0, 1.5];
    // Noise on the motion, on the force, on both; three periods (rectangular window) and eight (Hann).
    for (noise, periods) in [([1e-4, 0.0], 8), ([0.0, 0.2], 8), ([1e-4, 0.05], 8), ([1e-4, 0.05], 3)] {
        let ratio =
            spread(|seed| slider(truth, 400.0, 400 * periods + 50, noise, seed), &LogOptions::default(), &truth, 200);
        for r in &ratio {
            assert!((0.75..1.33).contains(r), "noise {noise:?}, {periods} periods: {ratio:?}");
        }
    }
}

#[test]
fn equal_weights_give_the_nearest_model_whatever_the_noise_and_say_how_well() {
    let truth = [2.0, 40.0, 1.5];
    let (dt, period, samples, seeds) = (1e-3, 800_usize, 8200, 60_u64);
    let w = 2.0 * PI / (period as f64 * dt);
    // A hardening spring that the model leaves out, then none.
    for cubic in [300.0, 0.0] {
        let force = |[x, v, a]: [f64; 3]| truth[0] * a + truth[1] * x + truth[2] * v * v + cubic * x * x * x;
        // Least squares over the samples of one period of the true motion.
        let rows: Vec<([f64; 3], f64)> = (0..period)
            .map(|i| motion(REST_TO_REST, w, i as f64 * dt))
            .map(|[x, v, a]| ([a, x, v * v], force([x, v, a])))
            .collect();
        let matrix = tpm_numerics::DMatrix::from_fn(period, 3, |r, c| rows[r].0[c]);
        let right = tpm_numerics::DVector::from_fn(period, |r, _| rows[r].1);
        let nearest = matrix.tr_mul(&matrix).cholesky().expect("independent").solve(&matrix.tr_mul(&right));
        let off = |seed: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let (mut xs, mut us) = (Vec::new(), Vec::new());
            for i in 0..samples {
                let [x, v, a] = motion(REST_TO_REST, w, i as f64 * dt);
                xs.push(x + 1e-3 * normal(&mut rng));
                us.push(force([x, v, a]));
            }
            let log = Log::from_samples("synthetic", dt, vec![xs, us]).expect("sound");
            let options = LogOptions {
                reading: RecordSettings {
                    period: Some(period as f64 * dt),
                    from_sample: Some(0),
                    ..RecordSettings::default()
                },
                estimation: Settings { weights: Weights::Equal, harmonics: Some(9), ..Settings::default() },
                ..LogOptions::default()
            };
            let estimate =
                identify_log(&MassSpringDrag, &log, &options).expect("identifies").estimate.expect("estimated");
            [0, 1, 2].map(|j| (estimate.values[j] - nearest[j], estimate.std[j]))
        };
        let all: Vec<[(f64, f64); 3]> = (0..seeds).map(off).collect();
        for j in 0..3 {
            let mean = all.iter().map(|e| e[j].0).sum::<f64>() / seeds as f64;
            let spread = (all.iter().map(|e| (e[j].0 - mean).powi(2)).sum::<f64>() / (seeds - 1) as f64).sqrt();
            let stated = all.iter().map(|e| e[j].1).sum::<f64>() / seeds as f64;
            assert!(mean.abs() < 4.0 * spread / (seeds as f64).sqrt(), "{j}: {mean:e} {spread:e}");
            if cubic == 0.0 {
                // With so many seeds a standard deviation is known to about a tenth.
                assert!((0.7..1.4).contains(&(stated / spread)), "{j}: {stated:e} {spread:e}");
            }
        }
    }
}

#[test]
fn a_few_periods_count_where_the_inputs_repeat_too() {
    let period = 900.0;
    for (pulses, periods, repeats) in [(0.0, 3, true), (20.0, 3, false), (20.0, 6, true)] {
        let log = slider([2.0, 50.0, 8.0], period, 900 * periods, [1e-5, 0.01], 3);
        let pulse = |i: usize| if (i / 260).is_multiple_of(2) { pulses } else { -pulses };
        let forces = log.channels[1].iter().enumerate().map(|(i, u)| u + pulse(i)).collect();
        let log = Log::from_samples("synthetic", 1e-3, vec![log.channels[0].clone(), forces]).expect("sound");
        let result = identify_log(&MassSpringDrag, &log, &LogOptions::default()).expect("identifies");
        let found = result.log.as_ref().and_then(LogReport::periodic);
        assert_eq!(found.is_some(), repeats, "{pulses} {periods}: {result}");
    }
    // A period that is stated is that of the motion, or a fault.
    let log = slider([2.0, 50.0, 8.0], period, 3600, [1e-5, 0.01], 3);
    let error =
        identify_log(&MassSpringDrag, &log, &read(RecordSettings { period: Some(1.3), ..RecordSettings::default() }))
            .expect_err("nothing repeats so");
    assert!(matches!(error, LogFault::BadRange { .. }), "{error}");
    assert!(error.to_string().contains("does not repeat with a period of 1.3 s"), "{error}");
}
