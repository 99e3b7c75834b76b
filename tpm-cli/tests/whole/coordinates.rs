//! Logs of machines with several coordinates whose truth is known: their forces are those of the equations along a given motion.

use crate::support::tpm_in;
use serde_json::Value;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;

/// A reading's noise: uniform, of standard deviation one.
fn noise(k: usize) -> f64 {
    let x = (k as f64 * 12.9898).sin() * 43_758.545_3;
    12.0_f64.sqrt() * (x - x.floor() - 0.5)
}

/// Position, velocity and acceleration at a time of a sum of sines that does not close: amplitudes, frequencies (Hz) and phases.
fn motion(sines: &[[f64; 3]], t: f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for [amplitude, frequency, phase] in sines {
        let w = 2.0 * PI * frequency;
        let (sin, cos) = (w * t + phase).sin_cos();
        sum = [sum[0] + amplitude * sin, sum[1] + amplitude * w * cos, sum[2] - amplitude * w * w * sin];
    }
    sum
}

/// Identifies a model from columns of a log, the time first.
fn identified(folder: &Path, model: &str, header: &str, rows: &[Vec<f64>]) -> (Option<i32>, Value) {
    let mut log = format!("{header}\n");
    for row in rows {
        let line: Vec<String> = row.iter().map(f64::to_string).collect();
        writeln!(log, "{}", line.join(",")).expect("a string takes it");
    }
    std::fs::write(folder.join("model.tpm"), model).expect("is written");
    std::fs::write(folder.join("log.csv"), log).expect("is written");
    let out = tpm_in(folder, &["identify", "model.tpm", "--log", "log.csv", "--hold", "none", "--json"]);
    (out.status.code(), serde_json::from_slice(&out.stdout).expect("JSON"))
}

/// How far the parameters are from the truth, in their deviations.
fn farthest(result: &Value, truth: &[(&str, f64)]) -> f64 {
    let parameters = result["parameters"].as_array().expect("a list");
    let score = |(name, value): &(&str, f64)| {
        let own = parameters.iter().find(|own| own["name"] == *name).expect("the parameter");
        let number = |key: &str| own[key].as_f64().expect("a number");
        ((number("value") - value) / number("std")).abs()
    };
    truth.iter().map(score).fold(0.0, f64::max)
}

/// The terms that are named as missing.
fn missing(result: &Value) -> Vec<(String, f64)> {
    let findings = result["findings"].as_array().expect("a list").iter();
    let own = findings.filter(|finding| finding["kind"] == "missing_term");
    own.map(|finding| {
        (finding["term"].as_str().expect("a term").to_string(), finding["value"].as_f64().expect("a number"))
    })
    .collect()
}

#[test]
fn an_arm_with_quiet_sensors_is_right_when_its_motion_does_not_close() {
    let joints = [
        [[0.35, 0.37, 0.3], [0.2, 0.81, 1.1], [0.12, 1.63, 2.5]],
        [[0.4, 0.43, 1.3], [-0.2, 1.07, 0.1], [0.15, 1.9, 1.5]],
        [[0.3, 0.51, 2.1], [0.25, 1.23, 0.9], [-0.1, 2.3, 3.0]],
    ];
    // Inertias, couplings of links and weights, about absolute angles.
    let (own, weights) = ([2.1, 0.62, 0.05], [31.0, 8.0, 1.1]);
    let coupling = [[0.0, 0.75, 0.09], [0.75, 0.0, 0.08], [0.09, 0.08, 0.0]];
    let rows: Vec<Vec<f64>> = (0..6000)
        .map(|k| {
            let t = k as f64 * 1e-3;
            let moving = joints.map(|sines| motion(&sines, t));
            let mut angles = [[0.0; 3]; 3];
            for i in 0..3 {
                for d in 0..3 {
                    angles[i][d] = moving[..=i].iter().map(|joint| joint[d]).sum();
                }
            }
            let force = |i: usize| {
                let mut sum = own[i] * angles[i][2] + weights[i] * angles[i][0].cos();
                for j in (0..3).filter(|j| *j != i) {
                    let between = angles[i][0] - angles[j][0];
                    sum += coupling[i][j] * (between.cos() * angles[j][2] + between.sin() * angles[j][1].powi(2));
                }
                sum
            };
            let forces = [force(0) + force(1) + force(2), force(1) + force(2), force(2)];
            let mut row = vec![t];
            row.extend((0..3).map(|i| moving[i][0] + 2e-6 * noise(3 * k + i)));
            row.extend(forces);
            row
        })
        .collect();
    let model = "model Arm {
  coordinate q1 [rad], q2 [rad], q3 [rad];
  input t1 [N*m], t2 [N*m], t3 [N*m];
  parameter I1 [kg*m^2], I2 [kg*m^2], I3 [kg*m^2], B12 [kg*m^2], B13 [kg*m^2], B23 [kg*m^2], G1 [N*m], G2 [N*m], G3 [N*m];
  FIRST + SECOND + THIRD = t1;
  SECOND + THIRD = t2;
  THIRD = t3;
}"
    .replace(
        "FIRST",
        "I1*ddot(q1) + G1*cos(q1) + B12*(cos(q2)*(ddot(q1) + ddot(q2)) - sin(q2)*(dot(q1) + dot(q2))^2)
    + B13*(cos(q2 + q3)*(ddot(q1) + ddot(q2) + ddot(q3)) - sin(q2 + q3)*(dot(q1) + dot(q2) + dot(q3))^2)",
    )
    .replace(
        "SECOND",
        "I2*(ddot(q1) + ddot(q2)) + G2*cos(q1 + q2) + B12*(cos(q2)*ddot(q1) + sin(q2)*dot(q1)^2)
    + B23*(cos(q3)*(ddot(q1) + ddot(q2) + ddot(q3)) - sin(q3)*(dot(q1) + dot(q2) + dot(q3))^2)",
    )
    .replace(
        "THIRD",
        "I3*(ddot(q1) + ddot(q2) + ddot(q3)) + G3*cos(q1 + q2 + q3)
    + B13*(cos(q2 + q3)*ddot(q1) + sin(q2 + q3)*dot(q1)^2) + B23*(cos(q3)*(ddot(q1) + ddot(q2)) + sin(q3)*(dot(q1) + dot(q2))^2)",
    );
    let folder = tempfile::tempdir().expect("a folder");
    let (code, result) = identified(folder.path(), &model, "t_s,q1,q2,q3,t1,t2,t3", &rows);
    assert_eq!((code, missing(&result)), (Some(0), vec![]), "{result}");
    // The impulses that wrapping makes of the ends left a thousandth of the force.
    assert!(result["residual"].as_f64().expect("a number") < 1e-4, "{result}");
    let truth = [
        ("I1", 2.1),
        ("I2", 0.62),
        ("I3", 0.05),
        ("B12", 0.75),
        ("B13", 0.09),
        ("B23", 0.08),
        ("G1", 31.0),
        ("G2", 8.0),
        ("G3", 1.1),
    ];
    assert!(farthest(&result, &truth) < 3.5, "{result}");
}

/// With noise of its inputs a simulation follows any record, and a dead zone passes for such noise.
#[test]
fn a_dead_zone_is_named_with_its_size_where_noise_of_the_input_would_pass_for_it() {
    let sines = [
        [[0.1, 0.41, 0.3], [0.05, 0.97, 1.1], [0.02, 1.63, 2.5], [0.01, 2.2, 0.7]],
        [[0.08, 0.41, 1.3], [-0.04, 0.97, 0.1], [0.03, 1.63, 1.5], [0.01, 2.2, 2.7]],
    ];
    let (dead, model) = (
        3.0,
        "model Masses {
  coordinate x1 [m], x2 [m];
  input u1 [N], u2 [N];
  parameter m1 [kg], m2 [kg], k [N/m], d1 [N*s/m], d2 [N*s/m];
  m1*ddot(x1) + k*(x1 - x2) + d1*dot(x1) = u1;
  m2*ddot(x2) + k*(x2 - x1) + d2*dot(x2) = u2;
}",
    );
    let rows: Vec<Vec<f64>> = (0..800)
        .map(|k| {
            let t = k as f64 * 5e-3;
            let [x1, v1, a1] = motion(&sines[0], t);
            let [x2, v2, a2] = motion(&sines[1], t);
            let u1 = 2.0 * a1 + 60.0 * (x1 - x2) + 4.0 * v1;
            let u2 = 1.5 * a2 + 60.0 * (x2 - x1) + 3.0 * v2;
            vec![t, x1 + 2e-5 * noise(2 * k), x2 + 2e-5 * noise(2 * k + 1), u1 + dead * u1.signum(), u2]
        })
        .collect();
    let folder = tempfile::tempdir().expect("a folder");
    let (_, result) = identified(folder.path(), model, "t_s,x1,x2,u1,u2", &rows);
    let named = missing(&result);
    assert!(named.len() == 1 && named[0].0 == "sign(force)" && (named[0].1 / dead - 1.0).abs() < 0.02, "{named:?}");
    let truth = [("m1", 2.0), ("m2", 1.5), ("k", 60.0), ("d1", 4.0), ("d2", 3.0)];
    assert!(farthest(&result, &truth) < 3.5, "{result}");
}

/// Terms that are bent in the velocity are exchanged for damping and friction: with values beside them the model alone would explain little.
#[test]
fn the_best_values_of_the_model_itself_are_the_result_where_friction_bends() {
    let sines = [
        [[0.35, 0.37, 0.3], [0.25, 0.81, 1.1], [0.12, 1.63, 2.5]],
        [[0.4, 0.43, 1.3], [-0.25, 1.07, 0.1], [0.1, 1.9, 1.5]],
        [[0.4, 0.51, 2.1], [0.25, 1.23, 0.9], [-0.1, 2.3, 3.0]],
    ];
    let masses = [0.6, 0.5, 0.4];
    let rows: Vec<Vec<f64>> = (0..6000)
        .map(|k| {
            let t = k as f64 * 1e-3;
            let moving = sines.map(|own| motion(&own, t));
            let force = |i: usize| {
                let [_, v, a] = moving[i];
                let bent = 16.0 * v - 2.7 * v * v.abs() + 0.28 * v.powi(3) + v.signum();
                masses[i] * a + bent + 0.05 * noise(7 * k + i)
            };
            let positions = (0..3).map(|i| moving[i][0] + 2e-6 * noise(7 * k + 3 + i));
            [t].into_iter().chain(positions).chain((0..3).map(force)).collect()
        })
        .collect();
    let model = "model Drives {
  coordinate x1 [rad], x2 [rad], x3 [rad];
  input u1 [N*m], u2 [N*m], u3 [N*m];
  parameter m1 [kg*m^2], m2 [kg*m^2], m3 [kg*m^2], d1 [N*m*s/rad], d2 [N*m*s/rad], d3 [N*m*s/rad], f1 [N*m], f2 [N*m], f3 [N*m];
  m1*ddot(x1) + d1*dot(x1) + f1*sign(dot(x1)) = u1;
  m2*ddot(x2) + d2*dot(x2) + f2*sign(dot(x2)) = u2;
  m3*ddot(x3) + d3*dot(x3) + f3*sign(dot(x3)) = u3;
}";
    let folder = tempfile::tempdir().expect("a folder");
    let (code, result) = identified(folder.path(), model, "t_s,x1,x2,x3,u1,u2,u3", &rows);
    assert_eq!(code, Some(0), "{result}");
    let drags = missing(&result).into_iter().filter(|(term, _)| term.contains("abs(dot("));
    let sizes: Vec<f64> = drags.map(|(_, value)| value).collect();
    assert!(sizes.len() == 3 && sizes.iter().all(|value| (value / -2.7 - 1.0).abs() < 0.03), "{sizes:?}");
    // The model's own best values leave 9 % of the force, those beside the terms 38 %.
    assert!(result["residual"].as_f64().expect("a number") < 0.1, "{result}");
    let truth = [("m1", 0.6), ("m2", 0.5), ("m3", 0.4), ("d1", 16.0), ("d2", 16.0), ("d3", 16.0)];
    assert!(farthest(&result, &truth) < 1.5, "{result}");
}

/// Play in one spring of a chain looks like a softer spring; machines of more than three coordinates are asked for forces between those that
/// are joined.
#[test]
fn play_in_a_spring_of_a_chain_is_named_with_its_size() {
    let sines = [
        [[0.21, 0.41, 0.3], [0.1, 0.97, 1.1], [0.04, 1.63, 2.5]],
        [[0.16, 0.47, 1.3], [-0.08, 1.03, 0.1], [0.05, 1.71, 1.5]],
        [[0.18, 0.53, 2.1], [0.1, 1.13, 0.9], [-0.04, 1.9, 3.0]],
        [[0.2, 0.37, 0.7], [0.06, 1.23, 2.9], [0.05, 2.03, 1.0]],
    ];
    let (inertias, stiffness, damping, gap) = ([0.043, 0.051, 0.055, 0.042], [37.5, 129.0, 120.0], 0.12, 0.007);
    let rows: Vec<Vec<f64>> = (0..2400)
        .map(|k| {
            let t = k as f64 * 2e-3;
            let moving = sines.map(|own| motion(&own, t));
            let mut forces: Vec<f64> = (0..4).map(|i| inertias[i] * moving[i][2] + damping * moving[i][1]).collect();
            for (i, own) in stiffness.iter().enumerate() {
                let apart = moving[i][0] - moving[i + 1][0];
                let play = if i == 1 { apart.clamp(-gap, gap) } else { 0.0 };
                forces[i] += own * (apart - play);
                forces[i + 1] -= own * (apart - play);
            }
            let positions = (0..4).map(|i| moving[i][0] + 1e-4 * noise(4 * k + i));
            [t].into_iter().chain(positions).chain(forces).collect()
        })
        .collect();
    let model = "model Rotors {
  coordinate q1 [rad], q2 [rad], q3 [rad], q4 [rad];
  input u1 [N*m], u2 [N*m], u3 [N*m], u4 [N*m];
  parameter m1 [kg*m^2], m2 [kg*m^2], m3 [kg*m^2], m4 [kg*m^2], k12 [N*m/rad], k23 [N*m/rad], k34 [N*m/rad],
    d1 [N*m*s/rad], d2 [N*m*s/rad], d3 [N*m*s/rad], d4 [N*m*s/rad];
  m1*ddot(q1) + d1*dot(q1) + k12*(q1 - q2) = u1;
  m2*ddot(q2) + d2*dot(q2) + k12*(q2 - q1) + k23*(q2 - q3) = u2;
  m3*ddot(q3) + d3*dot(q3) + k23*(q3 - q2) + k34*(q3 - q4) = u3;
  m4*ddot(q4) + d4*dot(q4) + k34*(q4 - q3) = u4;
}";
    let folder = tempfile::tempdir().expect("a folder");
    let (_, result) = identified(folder.path(), model, "t_s,q1,q2,q3,q4,u1,u2,u3,u4", &rows);
    let named = missing(&result);
    let size = -stiffness[1] * gap;
    assert!(named.len() == 1 && named[0].0 == "sign(q2 - q3)" && (named[0].1 / size - 1.0).abs() < 0.03, "{named:?}");
    let truth =
        [("m1", 0.043), ("m2", 0.051), ("m3", 0.055), ("m4", 0.042), ("k12", 37.5), ("k23", 129.0), ("k34", 120.0)];
    assert!(farthest(&result, &truth) < 3.5, "{result}");
}
