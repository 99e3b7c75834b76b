//! Records whose truth is known, by their lines alone.

use crate::likelihood::{OfAnyMotion, TermKind, estimate_any_motion};
use crate::settings::Settings;
use crate::time_domain::{Stretch, TimeRecord};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use tpm_controller::harmonics::Hold;
use tpm_test_support::models::MassSpringDrag;

const SAMPLE_TIME: f64 = 2e-3;
const SAMPLES: usize = 10_000;
/// A record of one stretch whose inputs go on between samples.
fn record(stretch: Stretch<'_>) -> TimeRecord<'_> {
    TimeRecord { sample_time: SAMPLE_TIME, hold: Hold::None, actuators: &[], following: &[], stretches: vec![stretch] }
}

/// m, k1, k2 of `m x'' + k1 x + k2 x'^2 = u`.
const TRUTH: [f64; 3] = [2.0, 40.0, 1.5];
/// Noise of position (m) and force (N).
const NOISE: [f64; 2] = [2e-6, 0.05];

/// Position, velocity and acceleration of a sweep of the frequency from .4 to 2 Hz.
fn sweep(t: f64) -> [f64; 3] {
    let (w, slope) = (2.0 * PI * (0.4 + 0.08 * t), 2.0 * PI * 0.08);
    let (s, c) = (2.0 * PI * (0.4 * t + 0.04 * t * t)).sin_cos();
    [0.2 * s, 0.2 * w * c, 0.2 * (slope * c - w * w * s)]
}

/// The estimate from a record of the machine with a force that the model lacks, and an input that is recorded `early` seconds early.
fn estimate(seed: u64, lacks: impl Fn([f64; 3]) -> f64, early: f64) -> OfAnyMotion {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
    let (mut xs, mut us) = (Vec::with_capacity(SAMPLES), Vec::with_capacity(SAMPLES));
    for k in 0..SAMPLES {
        let t = k as f64 * SAMPLE_TIME;
        xs.push(sweep(t)[0] + NOISE[0] * draw());
        let [x, v, a] = sweep(t + early);
        us.push(TRUTH[0] * a + TRUTH[1] * x + TRUTH[2] * v * v + lacks([x, v, a]) + NOISE[1] * draw());
    }
    let stretch = Stretch { coordinates: vec![&xs], rates: vec![None], inputs: vec![&us] };
    let record = record(stretch);
    estimate_any_motion(&MassSpringDrag, &[], &record, false, &Settings::default()).expect("a record")
}

/// Errors in stated deviations.
fn scores(found: &OfAnyMotion) -> Vec<f64> {
    let estimate = &found.estimate;
    (0..3).map(|j| (estimate.values[j] - TRUTH[j]) / estimate.std[j]).collect()
}

/// The right model is as uncertain as it says, and lacks nothing.
#[test]
fn a_right_model_lacks_nothing() {
    let seeds = 20;
    let found: Vec<OfAnyMotion> = (0..seeds).map(|seed| estimate(seed, |_| 0.0, 0.0)).collect();
    let squares: f64 = found.iter().flat_map(scores).map(|z| z * z).sum();
    let spread = (squares / (3 * seeds) as f64).sqrt();
    assert!((0.6..1.4).contains(&spread), "{spread}");
    let named = found.iter().filter(|found| !found.lacking.is_empty()).count();
    assert!(named <= 2, "{named} of {seeds}");
    let largest = found.iter().map(|found| found.estimate.std[0] / TRUTH[0]).fold(0.0, f64::max);
    assert!(largest < 1e-3, "{largest}");
}

/// What the model lacks is named with its size, and the deviations contain what it does to the parameters.
#[test]
fn friction_damping_and_a_cubic_spring_are_named() {
    for (kind, size) in [(TermKind::Friction, 1.2), (TermKind::Power(3), 150.0), (TermKind::RatePower(1), 0.9)] {
        let lacks = |[x, v, _]: [f64; 3]| match kind {
            TermKind::Friction => size * v.signum(),
            TermKind::Power(_) => size * x * x * x,
            _ => size * v,
        };
        for seed in 0..4 {
            let found = estimate(seed, lacks, 0.0);
            let first = found.lacking.first().unwrap_or_else(|| panic!("{kind:?} is not named"));
            assert_eq!(first.term.kind, kind);
            assert!((first.value - size).abs() < 0.05 * size, "{first:?}");
            assert!(scores(&found).iter().all(|z| z.abs() < 4.0), "{kind:?}: {:?}", found.estimate);
        }
    }
}

/// A late input is a parameter once it is seen.
#[test]
fn a_delay_is_found() {
    let found = estimate(1, |_| 0.0, 3e-3);
    let delay = found.lacking.iter().find(|own| own.term.kind == TermKind::Delay).expect("a delay");
    assert!((delay.value - 3e-3).abs() < 1e-4, "{delay:?}");
    assert!(scores(&found).iter().all(|z| z.abs() < 4.0), "{:?}", found.estimate);
}

/// Three masses in a row, of which inputs are recorded by factors too small.
fn masses(seed: u64, gains: [f64; 3]) -> OfAnyMotion {
    let text = "
        model masses {
            coordinate x [m], y [m], z [m];
            input u [N], v [N], w [N];
            parameter m1 [kg], m2 [kg], m3 [kg], d1 [N*s/m], d2 [N*s/m], d3 [N*s/m], k [N/m];
            m1*ddot(x) + d1*dot(x) + k*(x - y) = u;
            m2*ddot(y) + d2*dot(y) + k*(2*y - x - z) = v;
            m3*ddot(z) + d3*dot(z) + k*(z - y) = w;
        }
    ";
    let (model, _) = tpm_test_support::models::differentiable(text);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
    let mut columns = vec![Vec::new(); 6];
    for sample in 0..SAMPLES {
        let t = sample as f64 * SAMPLE_TIME;
        let at = |slow: f64| {
            let [x, v, a] = sweep(slow * t + 3.0 - 3.0 * slow);
            [x, slow * v, slow * slow * a]
        };
        let q = [at(1.0), at(0.7), at(0.8)];
        let [x, y, z] = q.map(|own| own[0]);
        let springs = [x - y, 2.0 * y - x - z, z - y];
        let force = |row: usize| MASSES[row] * q[row][2] + MASSES[3 + row] * q[row][1] + MASSES[6] * springs[row];
        for (row, own) in q.iter().enumerate() {
            columns[row].push(own[0] + NOISE[0] * draw());
            columns[3 + row].push((force(row) + FORCE_NOISE * draw()) / gains[row]);
        }
    }
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let (coordinates, inputs) = columns.split_at(3);
    let stretch = Stretch { coordinates: coordinates.to_vec(), rates: vec![None; 3], inputs: inputs.to_vec() };
    let record = record(stretch);
    estimate_any_motion(&model, &[], &record, false, &Settings::default()).expect("a record")
}

/// Noise of their forces, N.
const FORCE_NOISE: f64 = 0.3;
/// Masses, kg, dampings, N s/m, and the springs, N/m.
const MASSES: [f64; 7] = [2.0, 0.8, 1.2, 1.5, 4.0, 2.5, 60.0];

/// An input that is recorded in another unit, or by a gain that is a little off, is corrected by what the other rows say, and named.
#[test]
fn the_gain_of_one_of_three_inputs_is_found() {
    for gain in [1.0, 1.05, 12.0, 0.04] {
        let found = masses(5, [1.0, gain, 1.0]);
        let gains: Vec<_> = found.lacking.iter().filter(|own| own.term.kind == TermKind::InputGain).collect();
        assert!(!found.scale_unknown && gains.len() == usize::from(gain != 1.0), "{gain}: {:?}", found.lacking);
        for own in gains {
            assert!(own.term.of == 1 && (own.value - gain).abs() < 4.0 * own.std, "{gain}: {own:?}");
            assert!(own.std < 0.01 * gain, "{gain}: {own:?}");
        }
        for (j, truth) in MASSES.into_iter().enumerate() {
            let (value, std) = (found.estimate.values[j], found.estimate.std[j]);
            assert!((value - truth).abs() < 4.0 * std && std < 0.02 * truth, "{gain}: {value} +- {std} for {truth}");
        }
    }
}

/// Where as many inputs are off as are not, the scale of the parameters is not known.
#[test]
fn without_a_majority_of_inputs_the_scale_is_not_known() {
    let found = masses(5, [1.0, 4.0, 0.3]);
    assert!(found.scale_unknown, "{:?}", found.lacking);
}

/// An input that records next to nothing of its force, as one of a cable that is off: the corrected record asks for ever more of its gain,
/// so that none is stated, and the other inputs' gains are right.
#[test]
fn a_gain_that_never_settles_is_refused() {
    for gain in [1e8, -1e8] {
        let found = masses(5, [1.0, gain, 1.0]);
        let gains = found.lacking.iter().filter(|own| own.term.kind == TermKind::InputGain);
        assert_eq!(gains.filter(|own| own.value.abs() > 1e-2 && own.term.of == 1).count(), 0, "{:?}", found.lacking);
        assert!(found.estimate.values.iter().all(|value| value.is_finite()), "{:?}", found.estimate);
    }
}
