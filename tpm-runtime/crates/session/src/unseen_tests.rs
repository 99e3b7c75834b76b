//! Faults that a log tells from a machine, and such as it cannot tell from one: logs by inverse dynamics along a motion that is known.

use crate::arm_log;
use crate::identification::Identification;
use crate::log::{LogRequest, from_log};
use crate::log_report::Calibration;
use crate::model::DeclaredModel;
use crate::warning::Warning;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use std::fmt::Write;
use tpm_controller::harmonics::Hold;
use tpm_estimate::{Lacking, Refine, TermKind};

const SAMPLE_TIME: f64 = 1e-3;
const MOTOR: &str = "model Motor { coordinate q [rad]; input u [N*m]; parameter J [kg*m^2], b [N*m*s/rad], fc [N*m];
    J*ddot(q) + b*dot(q) + fc*sign(dot(q)) = u; }";

/// What the lines of a log name.
fn named(found: &Identification) -> Vec<Lacking> {
    let missing = found.log.iter().flat_map(|log| log.missing());
    missing.map(|own| Lacking { term: own.of, value: own.value, std: own.std, gain: own.gain }).collect()
}

/// Asserts that parameters lie within so many deviations of the truth.
fn assert_covered(found: &Identification, truth: &[(&str, f64)]) {
    for (name, truth) in truth {
        let own = found.parameters.iter().find(|own| own.name == *name).expect("a parameter");
        let (value, std) = (own.value.expect("identified"), own.std.expect("identified"));
        assert!((value - truth).abs() < 4.0 * std, "{name}: {value} +- {std} of {truth}\n{found}");
    }
}

/// Position, rate and acceleration of a sum of sines: frequencies, Hz, sizes and phases.
fn sines(waves: &[(f64, f64, f64)], t: f64) -> [f64; 3] {
    waves.iter().fold([0.0; 3], |[q, v, a], (frequency, size, phase)| {
        let w = 2.0 * PI * frequency;
        let (s, c) = (w * t + phase).sin_cos();
        [q + size * s, v + size * w * c, a - size * w * w * s]
    })
}

/// A log of one coordinate along a motion, with the reading and the input that belong to an instant.
fn log(
    samples: usize,
    motion: impl Fn(f64) -> [f64; 3],
    read: impl Fn(f64, f64) -> f64,
    input: impl Fn([f64; 3]) -> f64,
    noise: [f64; 2],
) -> LogRequest {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut draw = move || -> f64 { StandardNormal.sample(&mut rng) };
    let mut text = String::from("t_s,q,u\n");
    for k in 0..samples {
        let now = motion(k as f64 * SAMPLE_TIME);
        let (q, u) = (read(now[0], draw()) + noise[0] * draw(), input(now) + noise[1] * draw());
        writeln!(text, "{:.3},{q:.9},{u:.9}", k as f64 * SAMPLE_TIME).expect("a string takes everything");
    }
    LogRequest::of_bytes("log.csv", std::sync::Arc::new(text.into_bytes())).hold(Hold::None)
}

/// Gravity of the second link acts in both rows, and neither a sine of one angle nor a constant is it.
#[test]
fn gravity_of_a_link_that_the_model_lacks_is_named() {
    let text = |gravity: [&str; 3]| {
        format!(
            "model Arm {{ coordinate q1 [rad], q2 [rad]; input u1 [N*m], u2 [N*m];
            parameter J1 [kg*m^2], J2 [kg*m^2], c [kg*m^2], g1 [N*m], d1 [N*m*s/rad], d2 [N*m*s/rad]{};
            J1*ddot(q1) + J2*(ddot(q1) + ddot(q2)) + g1*cos(q1) + d1*dot(q1)
                + c*(cos(q2)*(2*ddot(q1) + ddot(q2)) - sin(q2)*(dot(q2)^2 + 2*dot(q1)*dot(q2))){} = u1;
            J2*(ddot(q1) + ddot(q2)) + d2*dot(q2) + c*(cos(q2)*ddot(q1) + sin(q2)*dot(q1)^2){} = u2; }}",
            gravity[0], gravity[1], gravity[2]
        )
    };
    let parse = |gravity| DeclaredModel::parse("Arm", &text(gravity)).expect("a model");
    let whole = parse([", g2 [N*m]", " + g2*cos(q1 + q2)", " + g2*cos(q1 + q2)"]);
    let file = arm_log::log(&whole, &[0.9, 0.15, 0.3, 20.0, 0.8, 0.5, 6.0], 0.0, [1.0; 2]);
    let found = from_log(&parse(["", "", ""]), LogRequest::new(file.path()).hold(Hold::None)).expect("identifies");
    let names = named(&found);
    let [own] = names.as_slice() else { panic!("{found}") };
    assert_eq!(own.term.kind, TermKind::Chain { even: true, against: false }, "{found}");
    assert!((own.value - 6.0).abs() < 4.0 * own.std && own.std < 0.06, "{own:?}");
    assert_covered(&found, &[("J1", 0.9), ("J2", 0.15), ("c", 0.3), ("g1", 20.0), ("d1", 0.8), ("d2", 0.5)]);
    // The completed model is the whole one.
    assert!(found.completed_model.as_ref().is_some_and(|text| text.contains("cos(q1 + q2)")), "{found}");
}

/// A beam between two carriages turns when they do not move alike.
#[test]
fn an_inertia_between_coordinates_that_the_model_lacks_is_named() {
    let text = |extra: [&str; 3]| {
        format!(
            "model Beam {{ coordinate q1 [m], q2 [m]; input u1 [N], u2 [N];
            parameter m1 [kg], m2 [kg], mh [kg], k [N/m], d1 [N*s/m], d2 [N*s/m]{};
            m1*ddot(q1) + mh*(ddot(q1) + ddot(q2))/4 + d1*dot(q1) + k*(q1 - q2){} = u1;
            m2*ddot(q2) + mh*(ddot(q1) + ddot(q2))/4 + d2*dot(q2) - k*(q1 - q2){} = u2; }}",
            extra[0], extra[1], extra[2]
        )
    };
    let parse = |extra| DeclaredModel::parse("Beam", &text(extra)).expect("a model");
    let whole = parse([", Jb [kg]", " + Jb*(ddot(q1) - ddot(q2))", " - Jb*(ddot(q1) - ddot(q2))"]);
    let file = arm_log::log(&whole, &[3.0, 2.8, 4.0, 90.0, 17.0, 15.0, 0.5], 0.0, [1.0; 2]);
    // The coupling of the head and the two masses span what such an inertia makes.
    let found = from_log(&parse(["", "", ""]), LogRequest::new(file.path()).hold(Hold::None)).expect("identifies");
    assert!(named(&found).is_empty() && found.residual < 0.01, "{found}");
    // Without the head's mass nothing does.
    let lighter = text(["", "", ""]).replace("mh [kg], ", "").replace(" + mh*(ddot(q1) + ddot(q2))/4", "");
    let lighter = DeclaredModel::parse("Beam", &lighter).expect("a model");
    let found = from_log(&lighter, LogRequest::new(file.path()).hold(Hold::None)).expect("identifies");
    let kinds: Vec<TermKind> = named(&found).iter().map(|own| own.term.kind).collect();
    assert!(kinds.contains(&TermKind::PairInertia), "{found}");
}

/// A voltage that has the sign of the speed throughout tells no dead zone from dry friction.
#[test]
fn a_dead_zone_that_dry_friction_hides_is_said() {
    let motor = DeclaredModel::parse("Motor", MOTOR).expect("a model");
    let motion = |t: f64| sines(&[(0.4, 3.0, 0.0), (0.68, 2.0, 0.0)], t);
    let said = |inertia: f64| {
        let input = move |[_, v, a]: [f64; 3]| inertia * a + 0.05 * v + 0.2 * v.signum();
        let found = from_log(&motor, log(8000, motion, |q, _| q, input, [1e-5, 1e-3])).expect("identifies");
        let faults = found.warnings.iter().filter_map(|warning| match warning {
            Warning::UnseenFaults { faults } => Some(faults.clone()),
            _ => None,
        });
        faults.flatten().any(|own| own.quantity == Calibration::DeadZone)
    };
    // A heavy rotor takes the input to the other sign before its speed turns.
    assert!(said(1e-4) && !said(0.5));
}

/// A wheel that is not centred adds an acceleration which no torque makes.
#[test]
fn an_encoder_that_errs_once_a_turn_is_told_from_a_light_rotor() {
    let motor = DeclaredModel::parse("Motor", MOTOR).expect("a model");
    let [inertia, b, fc] = [1e-3, 2e-3, 0.03];
    let motion = |t: f64| {
        let w = 2.0 * PI * 0.3;
        let (s, c) = (w * t).sin_cos();
        [30.0 * t + 8.0 * s, 30.0 + 8.0 * w * c, -8.0 * w * w * s]
    };
    let input = move |[_, v, a]: [f64; 3]| inertia * a + b * v + fc * v.signum();
    for error in [0.0, 2e-3] {
        let read = |q: f64, _: f64| q + error * (q + 0.7).sin();
        let mut request = log(10_000, motion, read, input, [1e-5, 2e-3]);
        request.estimation.refine = Refine::None;
        let found = from_log(&motor, request).expect("identifies");
        let names = named(&found);
        let amplitude = names.iter().find(|own| own.term.kind == TermKind::Reading { multiple: 1, even: false });
        assert_eq!(amplitude.is_some(), error > 0.0, "{found}");
        if let Some(own) = amplitude {
            assert!((own.value - error).abs() < 0.05 * error, "{own:?}");
        }
        assert_covered(&found, &[("J", inertia), ("b", b), ("fc", fc)]);
    }
}

/// Stamps in seconds since 1970 are those of the same log.
#[test]
fn a_shift_of_time_changes_nothing() {
    let spring = DeclaredModel::parse(
        "S",
        "model S { coordinate q [m]; input u [N]; parameter m [kg], d [N*s/m], k [N/m]; m*ddot(q) + d*dot(q) + k*q = u; }",
    )
    .expect("a model");
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
    let mut draw = move || -> f64 { StandardNormal.sample(&mut rng) };
    let readings: Vec<[f64; 2]> = (0..500)
        .map(|k| {
            let t = 0.01 * f64::from(k);
            let [q, v, a] = sines(&[(0.6, 1.0, 0.0), (1.7, 0.4, 1.0), (3.1, 0.1, 2.0)], t);
            [q + 1e-4 * draw(), 2.0 * a + 3.0 * v + 40.0 * q + 0.02 * draw()]
        })
        .collect();
    let found = [0.0, 1e9].map(|from| {
        let mut text = String::from("t_s,q,u\n");
        for (k, [q, u]) in readings.iter().enumerate() {
            writeln!(text, "{:.2},{q:.9},{u:.9}", from + 0.01 * k as f64).expect("a string takes everything");
        }
        let mut request = LogRequest::of_bytes("log.csv", std::sync::Arc::new(text.into_bytes())).hold(Hold::None);
        request.estimation.refine = Refine::None;
        from_log(&spring, request).expect("identifies")
    });
    for (own, other) in found[0].parameters.iter().zip(&found[1].parameters) {
        let share = |a: Option<f64>, b: Option<f64>| (a.expect("known") / b.expect("known") - 1.0).abs();
        assert!(share(own.value, other.value) < 1e-6 && share(own.std, other.std) < 1e-4, "{own:?} {other:?}");
    }
}
