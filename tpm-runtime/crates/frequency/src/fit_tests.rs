//! Fits to machines of known truth.

use crate::excitation::Excitation;
use crate::orders::compare_orders;
use crate::rational::{Delay, FitError, FitWarning, RationalSettings, fit_rational};
use crate::response::{FrequencyResponse, ResponseLine, Welch};
use crate::structured::{StructuredSettings, fit_structured};
use crate::transfer::TransferFunction;
use num_complex::Complex;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use tpm_controller::harmonics::Hold;

fn white(n: usize, seed: u64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..n).map(|_| StandardNormal.sample(&mut random)).collect()
}

/// A synthetic response: the function's values with relative noise, as if averaged nine times.
fn made(function: &TransferFunction, noise: f64, seed: u64) -> FrequencyResponse {
    let random = white(2000, seed);
    let averages = 9.0;
    let lines = (0..500)
        .map(|k| {
            let frequency = 2.0 * PI * 0.05 * f64::from(k);
            let truth = function.response(frequency);
            let at = 2 * k as usize;
            let error = Complex::new(random[at], random[at + 1]) * (noise / 2.0_f64.sqrt());
            let h1 = truth * (Complex::from(1.0) + error);
            let std = noise.max(1e-12) * truth.norm();
            ResponseLine { frequency, h1, h2: h1, coherence: 0.99, input: 1.0, output: 1.0, std, usable: k > 0 }
        })
        .collect();
    FrequencyResponse { sample_time: 0.02, welch: Welch::periodic(1000, Hold::None), segments: 9, averages, lines }
}

fn sixth_order() -> TransferFunction {
    // Three resonances at 0.8, 4 and 15 Hz with zeros between.
    let pair = |hertz: f64, damping: f64| {
        let w = 2.0 * PI * hertz;
        [w * w, 2.0 * damping * w, 1.0]
    };
    let product = |a: &[f64], b: &[f64]| {
        let mut out = vec![0.0; a.len() + b.len() - 1];
        for (i, x) in a.iter().enumerate() {
            for (j, y) in b.iter().enumerate() {
                out[i + j] += x * y;
            }
        }
        out
    };
    let numerator = product(&pair(2.0, 0.02), &pair(9.0, 0.03));
    let denominator = product(&product(&pair(0.8, 0.05), &pair(4.0, 0.02)), &pair(15.0, 0.04));
    TransferFunction::new(&numerator, &denominator).expect("valid")
}

#[test]
fn an_exact_response_gives_back_its_function() {
    let truth = sixth_order();
    let fit = fit_rational(&made(&truth, 0.0, 1), &RationalSettings::new(4, 6, 0.1, 24.0)).expect("determined");
    for (found, true_one) in fit
        .function
        .numerator
        .iter()
        .chain(&fit.function.denominator)
        .zip(truth.numerator.iter().chain(&truth.denominator))
    {
        assert!((found / true_one - 1.0).abs() < 1e-9, "{found} {true_one}");
    }
    assert!(fit.largest_error < 1e-10 && fit.warnings.is_empty(), "{:?}", fit.warnings);
    assert!((fit.static_gain.value / truth.static_gain() - 1.0).abs() < 1e-10);
}

#[test]
fn a_delay_is_found() {
    let mut truth = TransferFunction::new(&[40.0, 3.0], &[900.0, 4.0, 1.0]).expect("valid");
    truth.delay = 0.013;
    let settings = RationalSettings { delay: Delay::Free(0.0), ..RationalSettings::new(1, 2, 0.1, 24.0) };
    let fit = fit_rational(&made(&truth, 1e-3, 2), &settings).expect("determined");
    assert!((fit.function.delay - 0.013).abs() < 4.0 * fit.delay_std && fit.delay_std < 1e-4, "{}", fit.function.delay);
    let known = RationalSettings { delay: Delay::Fixed(0.013), ..settings };
    let fit = fit_rational(&made(&truth, 0.0, 2), &known).expect("determined");
    assert!((fit.function.numerator[1] - 3.0).abs() < 1e-9 && fit.delay_std == 0.0);
    let without = fit_rational(&made(&truth, 1e-3, 2), &RationalSettings::new(1, 2, 0.1, 24.0)).expect("determined");
    assert!(without.warnings.iter().any(|w| matches!(w, FitWarning::Misfit { .. })), "{:?}", without.warnings);
}

/// Compares standard deviations with the spread of many fits to simulated samples, which tests the lines' correlation
/// and the weights. Segments are twenty time constants long and the noise outweighs leakage; leakage, which the
/// coherence counts as noise but which nearly cancels between segments, makes the stated deviations too large, never
/// too small.
#[test]
fn stated_deviations_are_the_spread() {
    // y'' + 4 y' + 400 y = 400 u under a hold, exactly in sampled time (poles -2 +- 19.9j).
    let (dt, decay) = (0.01_f64, 2.0_f64);
    let w = (400.0 - decay * decay).sqrt();
    let (r, c) = ((-decay * dt).exp(), (w * dt).cos());
    let step = |t: f64| 1.0 - (-decay * t).exp() * ((w * t).cos() + decay / w * (w * t).sin());
    let (a1, a2) = (-2.0 * r * c, r * r);
    let b1 = step(dt);
    let b2 = step(2.0 * dt) + (a1 - 1.0) * b1;
    let settings = RationalSettings::new(0, 2, 0.5, 10.0);
    let runs = 80_u32;
    let (mut spread, mut stated, mut bias) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    let mut misfit = 0.0;
    for seed in 0..runs {
        let u = white(12_000, 10 + u64::from(seed));
        let noise = white(12_000, 5000 + u64::from(seed));
        let mut y = vec![0.0; 12_000];
        for i in 2..12_000 {
            y[i] = b1 * u[i - 1] + b2 * u[i - 2] - a1 * y[i - 1] - a2 * y[i - 2];
        }
        for (value, n) in y.iter_mut().zip(&noise) {
            *value += n;
        }
        let response = FrequencyResponse::estimate(&u, &y, dt, &Welch::new(1024, Hold::Zoh)).expect("long enough");
        let fit = fit_rational(&response, &settings).expect("determined");
        let pole = fit.poles.iter().find(|p| p.value.im > 0.0).expect("a pair");
        for (at, (error, std)) in [
            (pole.value.im - w, pole.std.im),
            (pole.value.re + decay, pole.std.re),
            (fit.static_gain.value - 1.0, fit.static_gain.std),
        ]
        .into_iter()
        .enumerate()
        {
            spread[at] += error * error;
            bias[at] += error;
            stated[at] += std * std;
        }
        misfit += fit.misfit / f64::from(runs);
    }
    let count = f64::from(runs);
    for (at, true_value) in [w, decay, 1.0].into_iter().enumerate() {
        let mean = bias[at] / count;
        let ratio = (stated[at] / (spread[at] - count * mean * mean)).sqrt();
        assert!((0.8..1.35).contains(&ratio), "stated over spread {ratio}");
        // The window widens the resonance by some per cent of its width: the bias is in the damping alone.
        let limit = if at == 1 { 0.05 } else { 0.01 };
        assert!(mean.abs() < limit * true_value, "{at}: {mean}");
    }
    assert!((0.8..1.2).contains(&misfit), "{misfit}");
}

#[test]
fn an_order_that_is_too_high_is_said() {
    let truth = TransferFunction::new(&[400.0], &[400.0, 4.0, 1.0]).expect("valid");
    let response = made(&truth, 2e-3, 4);
    let right = fit_rational(&response, &RationalSettings::new(0, 2, 0.1, 24.0)).expect("determined");
    assert!(right.warnings.is_empty(), "{:?}", right.warnings);
    assert!((right.poles[0].damping() - 0.1).abs() < 1e-3 && (right.poles[0].natural_frequency() - 20.0).abs() < 0.01);
    for (m, n) in [(1, 3), (2, 4), (4, 6)] {
        let high = fit_rational(&response, &RationalSettings::new(m, n, 0.1, 24.0)).expect("fitted all the same");
        let said = high.warnings.iter().find(|w| w.order_too_high()).expect("said");
        assert!(said.to_string().contains("order is higher than the data support"), "{said}");
    }
    // A numerator of too high a degree has a distant zero with a large standard deviation, which cancels no pole.
    let far = fit_rational(&response, &RationalSettings::new(1, 2, 0.1, 24.0)).expect("determined");
    assert!(far.zeros[0].value.norm() > 10.0 * 20.0, "{}", far.zeros[0]);
    assert!(far.warnings.iter().all(|w| !matches!(w, FitWarning::Cancelling { .. })), "{:?}", far.warnings);
    let none = RationalSettings::new(3, 5, 3.0, 3.2);
    assert!(matches!(fit_rational(&response, &none), Err(FitError::TooFewLines { unknowns: 9, lines: 5, .. })));
    assert!(matches!(
        fit_rational(&response, &RationalSettings::new(0, 2, 30.0, 40.0)),
        Err(FitError::EmptyBand { .. })
    ));
}

#[test]
fn an_unstable_fit_is_said() {
    let truth = TransferFunction::new(&[1.0], &[400.0, -4.0, 1.0]).expect("valid");
    let fit = fit_rational(&made(&truth, 1e-3, 5), &RationalSettings::new(0, 2, 0.1, 24.0)).expect("determined");
    assert!(
        fit.warnings.iter().any(|w| matches!(w, FitWarning::Unstable { pole } if (pole.value.re - 2.0).abs() < 0.1))
    );
}

#[test]
fn a_band_without_excitation_is_left_out_and_said() {
    let truth = TransferFunction::new(&[400.0], &[400.0, 4.0, 1.0]).expect("valid");
    let mut response = made(&truth, 1e-3, 6);
    for line in response.lines.iter_mut().filter(|line| (10.0..=12.0).contains(&line.hertz())) {
        // Values that would ruin the fit.
        line.h1 *= 100.0;
        line.usable = false;
        line.coherence = 0.1;
    }
    let fit = fit_rational(&response, &RationalSettings::new(0, 2, 0.1, 24.0)).expect("determined");
    assert!((fit.poles[0].natural_frequency() - 20.0).abs() < 0.01);
    let FitWarning::Gap(gap) = &fit.warnings[0] else { panic!("{:?}", fit.warnings) };
    assert_eq!(gap.lines, 41);
}

#[test]
fn validation_prefers_the_true_order() {
    let u = Excitation::Noise { std: 1.0, hold: 0.02, seed: 3 }.samples(40_000, 0.01).expect("valid");
    // The exact poles by the trapezoidal rule suffice here: the test needs a second-order machine that orders 0/2 can
    // describe.
    let (mut x, mut v) = (0.0_f64, 0.0_f64);
    let noise = white(40_000, 8);
    let mut y = Vec::new();
    for (u, n) in u.iter().zip(&noise) {
        y.push(x + 0.01 * n);
        for _ in 0..20 {
            let h = 0.01 / 20.0;
            let (xm, vm) = (x + 0.5 * h * v, v + 0.5 * h * (400.0 * (u - x) - 4.0 * v));
            x += h * vm;
            v += h * (400.0 * (u - xm) - 4.0 * vm);
        }
    }
    let settings = RationalSettings::new(0, 0, 0.3, 12.0);
    let orders = [(0, 1), (0, 2), (1, 2), (1, 3), (2, 4)];
    let found = compare_orders(&u, &y, 0.01, &Welch::new(2048, Hold::Zoh), &settings, &orders).expect("long enough");
    assert_eq!(
        found.recommended,
        Some(1),
        "{:#?}",
        found.trials.iter().map(|t| (t.validation, t.worse_by)).collect::<Vec<_>>()
    );
    let validation: Vec<f64> = found.trials.iter().map(|t| t.validation.expect("fitted")).collect();
    assert!(validation[0] > 5.0 && (0.6..1.6).contains(&validation[1]), "{validation:?}");
    assert!(found.trials[3].doubtful() && found.trials[4].doubtful());
    let short = compare_orders(&u[..4000], &y[..4000], 0.01, &Welch::new(2048, Hold::Zoh), &settings, &orders);
    assert!(short.expect_err("too short").to_string().starts_with("half of the record is too short"));
}

#[test]
fn physical_parameters_from_a_response() {
    // m s^2 + d s + k under a force, with the gain of an acceleration sensor: the response determines ratios to the
    // gain only.
    let truth = [0.5_f64, 3.0, 800.0, 2.0];
    let model = |p: &[f64], s: Complex<f64>| p[3] / (s * s * p[0] + s * p[1] + p[2]);
    let function = TransferFunction::new(&[truth[3]], &[truth[2], truth[1], truth[0]]).expect("valid");
    let response = made(&function, 1e-3, 7);
    let start = [1.0, 1.0, 500.0, 2.0];
    let mut settings = StructuredSettings::new(&start, 0.1, 24.0);
    settings.frozen = vec![false, false, false, true];
    let fit = fit_structured(&response, &model, &settings).expect("determined");
    assert!(fit.converged && fit.rank == 3 && fit.unobservable.is_empty());
    for (found, value) in fit.parameters.iter().zip(truth).take(3) {
        let off = (found.value - value).abs() / found.std;
        assert!(off < 4.0 && found.std < 2e-3 * value, "{found:?} {value}");
    }
    assert_eq!(fit.parameters[3].std, 0.0);
    assert!((0.7..1.3).contains(&fit.misfit), "{}", fit.misfit);

    settings.frozen.clear();
    let fit = fit_structured(&response, &model, &settings).expect("fitted all the same");
    assert_eq!((fit.rank, fit.unobservable.len()), (3, 1));
    assert!(fit.parameters.iter().all(|p| p.std.is_infinite()));
    // The unobservable direction is that of the parameters themselves, in multiples of the start values.
    let direction = &fit.unobservable[0];
    let ratio = direction[3] / (fit.parameters[3].value / start[3]);
    for (i, share) in direction.iter().enumerate() {
        assert!((share / (fit.parameters[i].value / start[i]) / ratio - 1.0).abs() < 1e-6, "{direction:?}");
    }
    let nowhere = StructuredSettings::new(&[f64::NAN, 1.0, 1.0, 1.0], 0.1, 24.0);
    assert!(matches!(fit_structured(&response, &model, &nowhere), Err(FitError::Start { parameter: 0, .. })));
}
