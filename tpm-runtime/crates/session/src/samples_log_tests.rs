//! Logs that are used sample by sample, whose truth is known: static maps, and records too short for anything else.

use crate::error::SessionError;
use crate::identification::Identification;
use crate::log::{LogRequest, from_log};
use crate::log_report::Way;
use crate::model::DeclaredModel;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use std::fmt::Write;
use tpm_controller::harmonics::Hold;
use tpm_log::Assumption;

/// The result of a model on the rows of a table.
fn identified(model: &str, table: &str) -> Identification {
    attempted(model, table).expect("identifies")
}

fn attempted(model: &str, table: &str) -> Result<Identification, SessionError> {
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), table).expect("written");
    let model = DeclaredModel::parse("M", model).expect("a model");
    from_log(&model, LogRequest::new(file.path()).hold(Hold::Zoh))
}

fn scores(result: &Identification, truth: &[f64]) -> Vec<f64> {
    let of = |(own, truth): (&tpm_estimate::ParameterReport, &f64)| {
        (own.value.expect("a value") - truth) / own.std.expect("a deviation")
    };
    result.parameters.iter().zip(truth).map(of).collect()
}

/// The noise of the force grows with the force, and the rows stand in no order.
#[test]
fn a_static_map_is_a_regression_whose_deviations_hold_the_truth() {
    let truth = [0.4, 30.0, 2e-4];
    let model = "model Map { coordinate w [rad/s]; input u [V]; parameter b [V*s/rad], c [V], a [V*s^2/rad^2];
        b*w + c*sign(w) + a*w*abs(w) = u; }";
    let seeds = 40;
    let mut inside = 0;
    for seed in 0..seeds {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut table = String::from("t_s,w,u\n");
        for i in 0..120 {
            let w = f64::from((i * 37) % 120 - 60) * 4.0 + 1.0;
            let u: f64 = truth[0] * w + truth[1] * w.signum() + truth[2] * w * w.abs();
            writeln!(table, "{i},{w},{}", u + (0.1 + 0.02 * u.abs()) * draw()).expect("a string takes everything");
        }
        let result = identified(model, &table);
        assert!(result.log.as_ref().is_some_and(|log| matches!(log.way, Way::Samples(_))), "{:?}", result.log);
        inside += scores(&result, &truth).iter().filter(|z| z.abs() < 1.96).count();
    }
    // 95 % of 120, give or take three deviations of so many draws.
    assert!((107..=120).contains(&inside), "{inside} of {}", 3 * seeds);
}

/// A bench steps through its speeds and holds each for a while: readings repeat and jump, none is one of a motion, and there is no time.
#[test]
fn a_static_map_needs_no_time_and_its_rows_are_not_judged_by_their_neighbours() {
    let truth = [0.4, 30.0];
    let model = "model Map { coordinate w [rad/s]; input u [V]; parameter b [V*s/rad], c [V]; b*w + c*sign(w) = u; }";
    let seeds = 40;
    let mut inside = 0;
    for seed in 0..seeds {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut table = String::from("w,u\n");
        for i in 0..240 {
            let w = f64::from((i / 10 * 7) % 24) * 10.0 - 115.0;
            writeln!(table, "{w},{}", truth[0] * w + truth[1] * w.signum() + draw())
                .expect("a string takes everything");
        }
        let result = identified(model, &table);
        let reading = &result.log.as_ref().expect("a log").reading;
        assert!(reading.assumptions.contains(&Assumption::Timeless), "{reading:?}");
        assert!(
            reading.repeated.is_empty() && reading.left_out.is_empty() && reading.segments.len() < 2,
            "{reading:?}"
        );
        assert_eq!((reading.rows, result.warnings.len()), (240, 0), "{:?}", result.warnings);
        inside += scores(&result, &truth).iter().filter(|z| z.abs() < 1.96).count();
    }
    // 95 % of 80, give or take three deviations of so many draws.
    assert!((70..=80).contains(&inside), "{inside} of {}", 2 * seeds);
    // Where something depends on the time, it is asked for.
    let moving = "model M { coordinate w [rad/s]; input u [V]; parameter b [V*s/rad], J; J*dot(w) + b*w = u; }";
    let error = attempted(moving, "w,u\n1,1\n2,2\n3,1\n").expect_err("an error").to_string();
    assert!(error.contains("no column is recognised as the time"), "{error}");
}

/// A hundred and fifty readings of a chirp, in the steps of a servo's encoder.
#[test]
fn a_short_chirp_of_a_servo_is_simulated() {
    let truth = [4e-3, 0.09, 0.02];
    let (dt, step) = (0.02, 2.0 * PI / 4096.0);
    let (mut q, mut v, mut table) = (0.0_f64, 0.0_f64, String::from("t_s,q,u\n"));
    for i in 0..150 {
        let t = f64::from(i) * dt;
        let u = 0.6 * (2.0 * PI * (0.3 * t + 0.3 * t * t)).sin();
        writeln!(table, "{t:.2},{:.9},{u:.9}", (q / step).round() * step).expect("a string takes everything");
        for _ in 0..200 {
            let h = dt / 200.0;
            let a = (u - q - truth[1] * v - truth[2] * (v / 1e-3).tanh()) / truth[0];
            v += h * a;
            q += h * v;
        }
    }
    let model = "model Servo { coordinate q [rad]; input u [rad]; parameter a [s^2], b [s], c [rad];
        a*ddot(q) + b*dot(q) + c*sign(dot(q)) + q = u; }";
    let result = identified(model, &table);
    for (own, truth) in result.parameters.iter().zip(truth) {
        let (value, std) = (own.value.expect("a value"), own.std.expect("a deviation"));
        assert!((value - truth).abs() < (0.02 * truth).max(3.0 * std), "{own:?}");
    }
}
