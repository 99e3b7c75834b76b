//! Rows in base parameters: against the rows themselves, difference quotients, and motions within a range.

use crate::{BaseRows, Interpreted, Interval};
use tpm_codegen::parse_model;
use tpm_codegen::source::Source;
use tpm_controller::model::Model;
use tpm_symbolic::regressor::prepare::prepare;

/// A planar arm whose tool is known, and one with a slide and a joint about another axis.
const ARMS: [&str; 2] = [
    include_str!("../../../../models/robots/planar_arm.tpm"),
    "model Bent {
        coordinate q1 [rad], s [m], q2 [rad];
        input tau1 [N*m], f [N], tau2 [N*m];

        mechanism {
            gravity (0, 0, -9.81);
            body a { revolute q1 about y at (0, 0, 0.3); inertia parameters; }
            body b on a { prismatic s along x at (0.4, 0.1, 0); inertia parameters; }
            body c on b { revolute q2 about z at (0.2, 0, 0.1); inertia parameters; }
            drive q1 by tau1 with viscous, offset;
            drive s by f with viscous;
            drive q2 by tau2 with rotor;
        }
    }",
];

fn read(text: &str) -> (BaseRows, Interpreted) {
    let parsed = parse_model(&Source::new("arm", text)).expect("a model");
    let prepared = prepare(parsed.model.clone()).expect("linear");
    let rows = BaseRows::new(&prepared.model, &prepared.form, parsed.mechanism.as_ref()).expect("base parameters");
    (rows, Interpreted::new(&prepared.model, &prepared.form))
}

/// Numbers in (-1, 1), the same at every call.
fn numbers(count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

fn forces(model: &Interpreted, motion: &[f64], theta: &[f64]) -> Vec<f64> {
    let (mut workspace, mut out) = (vec![0.0; model.inverse_workspace_len()], vec![0.0; model.dims().rows]);
    model.inverse_dynamics(motion, theta, &[], &mut workspace, &mut out).expect("fits");
    out
}

/// Rows of many motions are those of every motion by itself, bit for bit, whether or not the motions fill the last group.
#[test]
fn many_motions_have_the_rows_of_each() {
    for text in ARMS {
        let (_, model) = read(text);
        let dims = model.dims();
        let mut workspace = vec![0.0; model.workspace_len()];
        for count in [1, 8, 11] {
            let motions = numbers(count * dims.motion_len(), 5);
            let (mut phi, mut known) = (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]);
            let mut all = Vec::new();
            let take = &mut |at: usize, phi: &[f64], known: &[f64]| all.push((at, phi.to_vec(), known.to_vec()));
            model.rows_along(&motions, &[], &mut workspace, (&mut phi, &mut known), take).expect("fits");
            assert_eq!(all.len(), count);
            for (at, (instant, motion)) in all.iter().zip(motions.chunks_exact(dims.motion_len())).enumerate() {
                model.regressor(motion, &[], &mut workspace, &mut phi).expect("fits");
                model.known(motion, &[], &mut workspace, &mut known).expect("fits");
                assert_eq!((instant.0, &instant.1, &instant.2), (at, &phi, &known));
            }
        }
    }
}

#[test]
fn base_parameters_give_the_forces() {
    for text in ARMS {
        let (rows, model) = read(text);
        let dims = model.dims();
        let theta = numbers(dims.parameters, 3);
        let base = rows.lumped(&theta);
        assert!(base.len() < dims.parameters || text.contains("Bent"), "the planar arm's columns depend on each other");
        let mut at = rows.memory();
        for seed in 0..8 {
            let motion = numbers(dims.motion_len(), 50 + seed);
            rows.evaluate(&motion, &[], &mut at).expect("fits");
            for (row, expected) in forces(&model, &motion, &theta).into_iter().enumerate() {
                let entries = &at.regressor[row * base.len()..(row + 1) * base.len()];
                let found = at.known[row] + entries.iter().zip(&base).map(|(entry, value)| entry * value).sum::<f64>();
                assert!((found - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{row}: {found} {expected}");
            }
        }
    }
}

#[test]
fn gradients_are_those_of_difference_quotients() {
    for text in ARMS {
        let (rows, model) = read(text);
        let dims = model.dims();
        let mut at = rows.memory();
        let weights = numbers(at.regressor.len(), 5);
        let of_known = numbers(at.known.len(), 6);
        let motion = numbers(dims.motion_len(), 7);
        let mut sum = |motion: &[f64]| -> f64 {
            rows.evaluate(motion, &[], &mut at).expect("fits");
            let of = |values: &[f64], weights: &[f64]| values.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>();
            of(&at.regressor, &weights) + of(&at.known, &of_known)
        };
        let h = 1e-3;
        let expected: Vec<f64> = (0..motion.len())
            .map(|slot| {
                let mut moved = |steps: f64| {
                    let mut moved = motion.clone();
                    moved[slot] += steps * h;
                    sum(&moved)
                };
                let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(&mut moved);
                (a - d + 8.0 * (c - b)) / (12.0 * h)
            })
            .collect();
        sum(&motion);
        let mut found = vec![f64::NAN; motion.len()];
        rows.gradient(&weights, &of_known, &mut at, &mut found).expect("fits");
        for (slot, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{slot}: {found} {expected}");
        }
    }
}

#[test]
fn bounds_hold_for_motions_within_and_close_in_on_the_forces() {
    for text in ARMS {
        let (rows, model) = read(text);
        let dims = model.dims();
        let theta = numbers(dims.parameters, 9);
        let middle = numbers(dims.motion_len(), 10);
        let mut workspace = Vec::new();
        for width in [0.3, 1e-2, 1e-6] {
            let range: Vec<Interval> = middle.iter().map(|m| Interval { low: m - width, high: m + width }).collect();
            let found = rows.forces_within(&range, &[], &theta, &mut workspace).expect("fits");
            for seed in 0..20 {
                let shift = numbers(middle.len(), 100 + seed);
                let motion: Vec<f64> = middle.iter().zip(&shift).map(|(m, s)| m + width * s).collect();
                for (interval, force) in found.iter().zip(forces(&model, &motion, &theta)) {
                    let slack = 1e-12 * (1.0 + force.abs());
                    assert!(interval.low - slack <= force && force <= interval.high + slack, "{interval:?} {force}");
                }
            }
            let widest = found.iter().map(|interval| interval.high - interval.low).fold(0.0, f64::max);
            assert!(widest < 300.0 * width && widest > 0.1 * width, "{widest} for {width}");
        }
    }
}
