//! B Lambda stands in two places, exact tables and sampled rows: they agree on every shipped model.

use crate::support::model;
use tpm_runtime::estimate::{Along, LineTable};
use tpm_runtime::interpret::{Interpreted, pattern};
use tpm_runtime::model::Model;
use tpm_runtime::motion::trajectory::{HarmonicSeries, Line, ReferencePattern};
use tpm_runtime::physical::PatternTables;
use tpm_symbolic::regressor::prepare::prepare;

/// Amplitudes, frequency and constants of no special proportion.
const AMPLITUDES: [f64; 4] = [0.3, 0.7, 0.45, 0.2];
const FREQUENCY: f64 = 3.7;
const CONSTANT: f64 = 1.3;
/// Beyond the highest harmonic of every table here.
const HARMONICS: usize = 40;
/// Largest difference as a share of the column's strongest line.
const AGREE: f64 = 1e-12;

/// A model before elimination, its patterns, and its tables.
struct Tabulated {
    model: Interpreted,
    patterns: Vec<ReferencePattern>,
    tables: PatternTables,
}

fn tabulated(name: &str) -> Tabulated {
    let mut declared = model(name);
    declared.eliminations.clear();
    let prepared = prepare(declared).expect("linear in the parameters");
    let model = Interpreted::new(&prepared.model, &prepared.form);
    let played =
        |symbolic| pattern::of_rows(symbolic, &prepared.model, &prepared.form, |_| Some(CONSTANT)).expect("has values");
    let mut patterns: Vec<ReferencePattern> = prepared.model.patterns.iter().map(played).collect();
    patterns[0].others = patterns[1..].to_vec();
    let tables = PatternTables::new(&prepared, &model, &patterns[0]);
    Tabulated { model, patterns, tables }
}

/// How many of a model's patterns have a table; each is compared with the rows sampled along its motion.
fn compared(name: &str) -> usize {
    let Tabulated { model, patterns, tables } = tabulated(name);
    let dims = model.dims();
    let constants = vec![CONSTANT; dims.constants];
    let mut compared = 0;
    for pattern in &patterns {
        let amplitudes = &AMPLITUDES[..pattern.amplitudes.len()];
        let reference = pattern.trajectory(amplitudes, FREQUENCY);
        let Some(exact) = tables.lines(&reference, amplitudes, &constants, HARMONICS) else { continue };
        let sampled = Along::new(&model, &constants, &reference, HARMONICS).expect("finite");
        let regressors = (0..dims.rows).flat_map(|row| (0..dims.parameters).map(move |j| (row, j)));
        let regressors = regressors.map(|(row, j)| sampled.regressor(row, j)).zip(&exact.regressors);
        let known = (0..dims.rows).map(|row| sampled.known(row)).zip(&exact.known);
        for (at, (sampled, exact)) in regressors.chain(known).enumerate() {
            let strongest = exact.iter().map(|line| line.norm()).fold(0.0, f64::max);
            // Where the exact column is zero, what sampling leaves is rounding of numbers of the motion's size.
            let scale = if strongest > 0.0 { strongest } else { 1.0 };
            for (k, (a, b)) in sampled.iter().zip(exact).enumerate() {
                let difference = (a - b).norm();
                assert!(difference <= AGREE * scale, "{name}, column {at}, harmonic {k}: {a} {b} {difference:e}");
            }
        }
        compared += 1;
    }
    compared
}

#[test]
fn exact_tables_and_sampled_rows_agree() {
    for (name, wanted) in [
        ("mass_spring_drag", 1),
        ("two_carts", 0),
        ("three_carts", 0),
        ("closed_loop_arm", 1),
        ("brushless_motor", 1),
        ("silverbox", 1),
        // Functions that do not expand finitely, or jump, have no table.
        ("cart_pendulum", 0),
        ("emps", 0),
        ("rotary_pendulum", 0),
        ("rotary_pendulum_down", 0),
    ] {
        assert_eq!(compared(name), wanted, "{name}");
    }
}

#[test]
fn a_motion_that_is_not_the_pattern_has_no_table() {
    let Tabulated { patterns, tables, .. } = tabulated("mass_spring_drag");
    let amplitudes = &AMPLITUDES[..patterns[0].amplitudes.len()];
    let reference = patterns[0].trajectory(amplitudes, FREQUENCY);
    assert!(tables.lines(&reference, amplitudes, &[], HARMONICS).is_some());
    assert!(tables.lines(&reference, &[0.31], &[], HARMONICS).is_none());
    let mut twice = reference.clone();
    twice.coordinates[0].lines.iter_mut().for_each(|line| line.harmonic *= 2);
    assert!(tables.lines(&twice, amplitudes, &[], HARMONICS).is_none());
    let mut other = reference;
    other.coordinates[0] = HarmonicSeries { mean: 0.0, lines: vec![Line { harmonic: 1, cos: 1.0, sin: 0.0 }] };
    assert!(tables.lines(&other, amplitudes, &[], HARMONICS).is_none());
}
