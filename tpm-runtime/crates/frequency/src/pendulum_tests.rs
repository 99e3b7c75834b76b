//! The rotary pendulum hanging down, measured and fitted as in Fong, section 3.2, with Table 1 (C2 = 3.168e-4).
//!
//! Its equations of motion (Fong, Eqn 26) are written out by hand here, and so is their linear form (Eqn 27), so that
//! the test is independent of the rest of the program.

use crate::excitation::Excitation;
use crate::orders::compare_orders;
use crate::rational::{RationalSettings, fit_rational};
use crate::record::fit_record;
use crate::response::{FrequencyResponse, Welch};
use crate::structured::{StructuredSettings, fit_structured};
use crate::transfer::TransferFunction;
use num_complex::Complex;
use std::f64::consts::PI;
use tpm_controller::harmonics::Hold;

const M2: f64 = 0.022;
const L1: f64 = 0.16;
const C2: f64 = 0.08;
const G: f64 = 9.8;
const MOTOR: f64 = 0.01826 / 2.5604;
const GAIN: f64 = 10.0 * MOTOR;
const SAMPLE_TIME: f64 = 1e-3;
const BAND: (f64, f64) = (0.2, 23.0);
/// J1 + m2 l1^2, m2 c2^2, m2 l1 c2, C1 + Kt Kb/Rm, J2 + m2 c2^2, viscous friction of the pendulum, m2 c2 g.
const LUMPED: [f64; 7] = [
    0.002_150_58 + M2 * L1 * L1,
    M2 * C2 * C2,
    M2 * L1 * C2,
    0.02 + MOTOR * 0.01826,
    0.000_187_73 + M2 * C2 * C2,
    3.168e-4,
    M2 * C2 * G,
];

fn rates([_, v, a, w]: [f64; 4], e: f64) -> [f64; 4] {
    let [j1, mcc, mlc, c1, j2, c2, mgc] = LUMPED;
    let (sin, cos) = a.sin_cos();
    let double = (2.0 * a).sin();
    let (m11, m12, m22) = (j1 + mcc * sin * sin, mlc * cos, j2);
    let r1 = GAIN * e - c1 * v - mcc * v * w * double + mlc * w * w * sin;
    let r2 = 0.5 * mcc * v * v * double - c2 * w - mgc * sin;
    let determinant = m11 * m22 - m12 * m12;
    [v, (m22 * r1 - m12 * r2) / determinant, w, (m11 * r2 - m12 * r1) / determinant]
}

fn step(x: [f64; 4], e: f64, h: f64) -> [f64; 4] {
    let add = |k: [f64; 4], f: f64| std::array::from_fn(|i| x[i] + f * k[i]);
    let k1 = rates(x, e);
    let k2 = rates(add(k1, 0.5 * h), e);
    let k3 = rates(add(k2, 0.5 * h), e);
    let k4 = rates(add(k3, h), e);
    std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
}

/// Voltage and encoder reading of the pendulum over 180 s.
fn record(counts: f64, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let input = Excitation::Noise { std: 0.3, hold: 0.01, seed }.samples(180_000, SAMPLE_TIME).expect("valid");
    let mut state = [0.0; 4];
    let resolution = 2.0 * PI / counts;
    let output = input
        .iter()
        .map(|&e| {
            let reading = (state[2] / resolution).round() * resolution;
            state = step(state, e, SAMPLE_TIME);
            reading
        })
        .collect();
    (input, output)
}

/// The angle of the pendulum over the voltage, from Fong, Eqn 27.
fn linear(lumped: &[f64]) -> TransferFunction {
    let [j1, _, mlc, c1, j2, c2, mgc] = *lumped else { panic!("seven lumped parameters") };
    let denominator = [c1 * mgc, c1 * c2 + j1 * mgc, c1 * j2 + j1 * c2, j1 * j2 - mlc * mlc];
    TransferFunction::new(&[0.0, -mlc * GAIN], &denominator).expect("an inertia")
}

fn errors(mut found: impl FnMut(f64) -> Complex<f64>, frequencies: impl Iterator<Item = f64>) -> (f64, f64) {
    let truth = linear(&LUMPED);
    let mut errors: Vec<f64> = frequencies.map(|w| (found(w) / truth.response(w) - 1.0).norm()).collect();
    errors.sort_by(f64::total_cmp);
    (errors[errors.len() / 2], errors[errors.len() - 1])
}

#[test]
fn the_linear_form_has_the_numbers_of_the_paper() {
    // G = -24.72 s/(s^3 + 9.200 s^2 + 65.48 s + 427.5), from the corrected Eqn 28.
    let g = linear(&LUMPED);
    assert!((g.numerator[1] + 24.725).abs() < 1e-3 && g.numerator[0] == 0.0);
    for (found, (stated, digit)) in g.denominator.iter().zip([(427.5, 0.1), (65.48, 0.01), (9.2, 0.001), (1.0, 0.0)]) {
        assert!((found - stated).abs() <= 0.5 * digit, "{found} {stated}");
    }
    // A small motion of the written-out equations agrees with it: 1e-4 V at 1.3 Hz after the transient.
    let w = 2.0 * PI * 1.3;
    let (mut state, mut sum) = ([0.0; 4], Complex::from(0.0));
    let period = 5000;
    for i in 0..200_000 {
        let t = f64::from(i) * 2.0 * PI / w / f64::from(period);
        if i >= 200_000 - period {
            sum += Complex::from_polar(state[2] / 1e-4 * 2.0 / f64::from(period), -w * t);
        }
        // The voltage at the middle of the step, in phase with cos.
        let h = 2.0 * PI / w / f64::from(period);
        state = step(state, 1e-4 * (w * (t + 0.5 * h)).cos(), h);
    }
    assert!((sum / g.response(w) - 1.0).norm() < 1e-5, "{}", sum / g.response(w));
}

#[test]
fn an_order_1_3_fit_describes_the_pendulum() {
    for (counts, median_limit, largest_limit) in [(2000.0, 3e-3, 3e-2), (500.0, 1e-2, 5e-2)] {
        let (u, y) = record(counts, 1);
        let settings = RationalSettings::new(1, 3, BAND.0, BAND.1);
        let measure =
            |hold| FrequencyResponse::estimate(&u, &y, SAMPLE_TIME, &Welch::new(32_768, hold)).expect("long enough");
        let response = measure(Hold::Zoh);
        assert_eq!(response.segments, 9);
        // At 500 counts the quantisation exceeds the response in the upper half of the band, which is reported and not
        // fitted.
        let gaps = response.gaps(BAND.0, BAND.1);
        assert!(if counts > 1000.0 { gaps.is_empty() } else { gaps.iter().all(|gap| gap.low > 9.0) }, "{gaps:?}");
        let lines = |r: &FrequencyResponse| r.band(BAND.0, BAND.1).map(|l| l.frequency).collect::<Vec<_>>();
        let fit = fit_rational(&response, &settings).expect("determined");
        let (median, largest) = errors(|w| fit.function.response(w), lines(&response).into_iter());
        assert!(median <= median_limit && largest <= largest_limit, "{counts}: {median:e} {largest:e}");
        assert!(fit.warnings.iter().all(|w| !w.order_too_high()), "{:?}", fit.warnings);

        // Without the correction the lag of half a sample stays in the response, and part of it in the fit.
        let effect = response.hold_effect(BAND.0, BAND.1);
        let recorded = measure(Hold::None);
        let uncorrected = fit_rational(&recorded, &settings).expect("determined");
        let (raw, raw_largest) = errors(|w| uncorrected.function.response(w), lines(&response).into_iter());
        let of_lines = |r: &FrequencyResponse| {
            let mut found = r.band(BAND.0, BAND.1).map(|line| line.h1);
            errors(|_| found.next().expect("a line for each frequency"), lines(r).into_iter())
        };
        let (frf, frf_recorded) = (of_lines(&response), of_lines(&recorded));
        println!(
            "{counts} counts, {} lines: fit 1/3 median {median:.2e} largest {largest:.2e}, misfit {:.2}; H1 median {:.2e}; without the \
             hold's correction fit {raw:.2e} {raw_largest:.2e}, H1 {:.2e}; the correction changes H by {:.2e}, at most {:.2e}\n \
             poles {} | {}",
            fit.lines, fit.misfit, frf.0, frf_recorded.0, effect.median, effect.largest, fit.poles[0], fit.poles[2]
        );
        assert!((effect.median - 0.036).abs() < 2e-3 && (effect.largest - 0.072).abs() < 2e-3, "{effect:?}");
        // At 500 counts noise outweighs the lag in the fit.
        assert!(counts < 1000.0 || raw > 2.0 * median, "{raw:e}");
        let truth = linear(&LUMPED).poles();
        for (pole, truth) in fit.poles.iter().zip(&truth) {
            assert!((pole.value - truth).norm() < 0.03 * truth.norm(), "{} {truth}", pole);
        }
    }
}

/// Quantisation at 500 counts is noise, eleven times stronger below 20 Hz than white noise of the same variance. The
/// averaged response loses half of the information in the record, a fit to the whole record does not. The limits hold
/// for every seed.
#[test]
fn the_whole_record_halves_the_error_at_500_counts() {
    let settings = RationalSettings::new(1, 3, BAND.0, BAND.1);
    let welch = Welch::new(32_768, Hold::Zoh);
    for (counts, median_limit, largest_limit) in [(2000.0, 3e-3, 3e-2), (500.0, 1e-2, 5e-2)] {
        let (mut averaged, mut whole) = (0.0, 0.0);
        for seed in 1..=5 {
            let (u, y) = record(counts, seed);
            let response = FrequencyResponse::estimate(&u, &y, SAMPLE_TIME, &welch).expect("long enough");
            let first = fit_rational(&response, &settings).expect("determined");
            let fit = fit_record(&u, &y, SAMPLE_TIME, &welch, &settings).expect("determined");
            let of = |function: &TransferFunction| {
                errors(|w| function.response(w), response.band(BAND.0, BAND.1).map(|line| line.frequency))
            };
            let (before, (median, largest)) = (of(&first.function), of(&fit.function));
            println!(
                "{counts} counts, seed {seed}: averaged {:.2e} {:.2e}, whole record {median:.2e} {largest:.2e}, {} lines",
                before.0, before.1, fit.lines
            );
            assert!(median <= median_limit && largest <= largest_limit, "{counts} {seed}: {median:e} {largest:e}");
            averaged += before.0 * before.0;
            whole += median * median;
        }
        assert!(counts > 1000.0 || whole < 0.5 * averaged, "{whole:e} {averaged:e}");
    }
}

/// A single seed may be favourable: the limit on the median error holds for the median over four seeds, that on the
/// largest error for each of them.
#[test]
fn the_fit_is_as_good_for_other_seeds() {
    let settings = RationalSettings::new(1, 3, BAND.0, BAND.1);
    for (counts, median_limit, largest_limit) in [(2000.0, 3e-3, 3e-2), (500.0, 1e-2, 5e-2)] {
        let mut medians: Vec<f64> = (2..=5)
            .map(|seed| {
                let (u, y) = record(counts, seed);
                let began = std::time::Instant::now();
                let response = FrequencyResponse::estimate(&u, &y, SAMPLE_TIME, &Welch::new(32_768, Hold::Zoh));
                let (measured, response) = (began.elapsed(), response.expect("long enough"));
                let began = std::time::Instant::now();
                let fit = fit_rational(&response, &settings).expect("determined");
                let fitted = began.elapsed();
                let frequencies: Vec<f64> = response.band(BAND.0, BAND.1).map(|line| line.frequency).collect();
                let (median, largest) = errors(|w| fit.function.response(w), frequencies.into_iter());
                println!(
                    "{counts} counts, seed {seed}: median {median:.2e} largest {largest:.2e}; H1 {measured:?}, fit {fitted:?}"
                );
                assert!(largest <= largest_limit, "{counts} {seed}: {largest:e}");
                median
            })
            .collect();
        medians.sort_by(f64::total_cmp);
        assert!(0.5 * (medians[1] + medians[2]) <= median_limit, "{medians:?}");
    }
}

#[test]
fn more_poles_are_not_supported_by_the_data() {
    let (u, y) = record(2000.0, 2);
    let settings = RationalSettings::new(0, 0, BAND.0, BAND.1);
    let welch = Welch::new(32_768, Hold::Zoh);
    let orders = [(0, 2), (1, 2), (1, 3), (2, 4), (3, 4)];
    let found = compare_orders(&u, &y, SAMPLE_TIME, &welch, &settings, &orders).expect("long enough");
    for trial in &found.trials {
        let said: Vec<_> = trial.fit.iter().flat_map(|fit| fit.warnings.iter().map(|w| format!("{w}"))).collect();
        println!("{}/{}: {:?} {:?} {said:?}", trial.numerator, trial.denominator, trial.validation, trial.worse_by);
    }
    assert_eq!(found.recommended, Some(2));
}

#[test]
fn physical_parameters_of_the_pendulum() {
    let (u, y) = record(2000.0, 3);
    let welch = Welch::new(32_768, Hold::Zoh);
    let response = FrequencyResponse::estimate(&u, &y, SAMPLE_TIME, &welch).expect("long enough");
    // The response has four coefficients: of the seven parameters, m2 c2^2 does not enter and two more must be known.
    let mut start = LUMPED.map(|value| 1.4 * value);
    start[0] = LUMPED[0];
    start[2] = LUMPED[2];
    let mut settings = StructuredSettings::new(&start, BAND.0, BAND.1);
    settings.frozen = vec![true, true, true, false, false, false, false];
    let model = |p: &[f64], s: Complex<f64>| linear(p).evaluate(s);
    let began = std::time::Instant::now();
    let fit = fit_structured(&response, &model, &settings).expect("determined");
    let time = began.elapsed();
    println!("structured fit of four parameters: {time:?}, misfit {:.2}", fit.misfit);
    assert!(fit.converged && fit.rank == 4, "{} {}", fit.converged, fit.rank);
    for (i, found) in fit.parameters.iter().enumerate().skip(3) {
        let relative = found.value / LUMPED[i] - 1.0;
        println!("  {i}: {:+.2e} +- {:.1e}", relative, found.std / LUMPED[i]);
        // Segments of 33 s widen the resonance a little: the friction of the pendulum (5) comes out too high.
        let limit = if i == 5 { 0.05 } else { 0.01 };
        assert!(relative.abs() < limit && found.std < 0.015 * LUMPED[i], "{i}: {found:?}");
    }
    // With all seven parameters free, rank and unobservable directions are reported.
    settings.frozen.clear();
    let fit = fit_structured(&response, &model, &settings).expect("fitted all the same");
    assert_eq!((fit.rank, fit.unobservable.len()), (4, 3));
    assert!(fit.parameters[1].std.is_infinite());
}
