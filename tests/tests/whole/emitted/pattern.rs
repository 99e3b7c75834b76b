//! Reference, estimator matrix, harmonics and solution of emitted patterns against their exact tables.

use super::{Sum, corners, dyadic, estimator, exact, runner};
use proptest::prelude::*;
use tpm_models as models;
use tpm_runtime::Model as _;
use tpm_runtime::SolveError;
use tpm_runtime::interpret::Interpreted;
use tpm_symbolic::number::rational::{self, Rational};

/// The functions of a compiled pattern, over plain slices.
#[allow(clippy::type_complexity)] // each type is written once
struct PatternCode<'a> {
    reference: &'a dyn Fn(&[f64], &[f64], f64) -> Vec<f64>,
    matrix: &'a dyn Fn(&[f64], &[f64]) -> Vec<f64>,
    /// Harmonics of the forces that the reference needs, from so many samples of a period.
    sampled: &'a dyn Fn(&[f64], &[f64], &[f64], usize) -> Vec<f64>,
    /// The parameters that belong to harmonics.
    solved: &'a dyn Fn(&[f64], &[f64], &[f64]) -> Result<Vec<f64>, SolveError>,
}

fn check_pattern(file: &str, code: &PatternCode<'_>, observable: Option<bool>) {
    let estimator = estimator(file);
    let dims = Interpreted::new(&estimator.model, &estimator.form).dims();
    let pattern = &estimator.plan.patterns[0];
    let table = pattern.table.as_ref().expect("a finite table");
    let (rows, columns) = (table.rows.len(), estimator.form.columns.len());
    let symbols: Vec<_> = pattern.amplitudes.iter().chain([&pattern.frequency]).copied().collect();
    let inputs = (dyadic(symbols.len()), dyadic(dims.constants), dyadic(columns), -3.0..3.0f64);
    // Every case sums the whole table exactly.
    let cases = if rows * columns > 500 { 4 } else { 64 };
    let result = runner(cases).run(&inputs, |(pattern_values, constants, theta, phase)| {
        let value = |symbol: usize| {
            let symbol = tpm_symbolic::expr::graph::Symbol(u32::try_from(symbol).expect("small"));
            let own = symbols.iter().position(|present| *present == symbol);
            let constant = estimator.plan.evaluation.constants.iter().position(|present| *present == symbol);
            own.map(|i| pattern_values[i]).or(constant.map(|i| constants[i])).expect("a known symbol")
        };
        // Estimator matrix against the table, exactly.
        let matrix = (code.matrix)(&pattern_values, &constants);
        prop_assert_eq!(matrix.len(), rows * columns);
        let at = |row: usize, column: Option<usize>| {
            let (equation, harmonic, function) = table.rows[row];
            Sum::of(table.table.at(equation, harmonic, function, column).map(|entry| {
                let factors = entry.powers.factors();
                let powers = factors.map(|(&symbol, power)| rational::power(&exact(value(symbol)), power));
                Some(powers.product::<Rational>() * &entry.coefficient)
            }))
            .expect("a table is rational")
        };
        for row in 0..rows {
            for column in 0..columns {
                let (sum, found) = (at(row, Some(column)), matrix[row * columns + column]);
                prop_assert!(sum.holds(found), "row {} column {}: {} is not {}", row, column, found, sum.value);
            }
        }
        // Reference against the pattern's Fourier series.
        let reference = (code.reference)(&pattern_values, &constants, phase);
        let w = value(pattern.frequency.0 as usize);
        for (c, &(coordinate, order)) in estimator.plan.evaluation.coordinates.iter().enumerate() {
            let motion = estimator.model.patterns[0].motions[coordinate.0 as usize].as_ref().expect("it moves");
            for n in 0..=order {
                let scale = w.powi(i32::try_from(n).expect("small"));
                let (mut expected, mut magnitude) = (0.0, 0.0);
                for (monomial, fourier) in motion.derivative(n).terms() {
                    let factors = monomial.factors();
                    let factor: f64 = factors.map(|(symbol, power)| value(symbol.0 as usize).powi(power)).product();
                    expected += scale * factor * fourier.evaluate(phase);
                    let size: f64 = fourier.terms().map(|(_, _, c)| rational::to_f64(c).abs()).sum();
                    magnitude += (scale * factor).abs() * size;
                }
                let found = reference[n as usize * dims.coordinates + c];
                prop_assert!((found - expected).abs() <= 2e-14 * magnitude, "{} is not {}", found, expected);
            }
        }
        // The forces of the reference have the harmonics that the matrix says: Feng, Eqn 3.16, by quadrature.
        let highest = table.rows.iter().map(|(_, harmonic, _)| *harmonic).max().unwrap_or(0);
        let sampled = (code.sampled)(&pattern_values, &constants, &theta, 2 * highest + 3);
        let mut magnitude = 0.0_f64;
        let mut expected = Vec::new();
        for row in 0..rows {
            let mut sum = at(row, None).value;
            for (column, &parameter) in theta.iter().enumerate().take(columns) {
                let term = at(row, Some(column)).value * exact(parameter);
                magnitude = magnitude.max(rational::to_f64(&rational::abs(&term)));
                sum += term;
            }
            magnitude = magnitude.max(rational::to_f64(&rational::abs(&sum)));
            expected.push(rational::to_f64(&sum));
        }
        for (row, (found, expected)) in sampled.iter().zip(&expected).enumerate() {
            prop_assert!((found - expected).abs() <= 1e-10 * magnitude, "row {}: {} is not {}", row, found, expected);
        }
        // And they lead back to the parameters, unless an amplitude or the frequency is too small to excite them.
        let excited = pattern_values.iter().all(|value| value.abs() >= 0.5);
        if let (true, Some(observable)) = (excited, observable) {
            match (code.solved)(&pattern_values, &constants, &expected) {
                Ok(found) => {
                    prop_assert!(observable, "parameters were determined that are not: {:?}", found);
                    for (found, truth) in found.iter().zip(&theta) {
                        prop_assert!((found - truth).abs() <= 1e-7, "{:?} is not {:?}", found, theta);
                    }
                }
                Err(SolveError::Unobservable { name, .. }) => prop_assert!(!observable, "{} is determined", name),
                Err(fault) => prop_assert!(false, "{}", fault),
            }
        }
        Ok(())
    });
    result.unwrap_or_else(|fault| panic!("{file}: {fault}"));
}

macro_rules! pattern {
    ($test:ident, $file:literal, $module:path, observable: $observable:expr $(, constants: $constants:ident)?) => {
        #[test]
        fn $test() {
            use $module as code;
            fn fixed<const N: usize>(values: &[f64]) -> [f64; N] {
                values.try_into().expect("the length of the declaration")
            }
            let pattern = |values: &[f64]| code::Pattern::from_array(fixed(values));
            let check = PatternCode {
                reference: &|values, _constants, phase| {
                    $(let $constants = &code::Constants::from_array(fixed(_constants));)?
                    pattern(values).reference_at($($constants,)? phase).into_array().to_vec()
                },
                matrix: &|values, _constants| {
                    $(let $constants = &code::Constants::from_array(fixed(_constants));)?
                    pattern(values).estimator_matrix($($constants)?).as_flattened().to_vec()
                },
                sampled: &|values, _constants, theta, count| {
                    $(let $constants = &code::Constants::from_array(fixed(_constants));)?
                    let theta = code::Parameters::from_array(fixed(theta));
                    let samples: Vec<_> = (0..count)
                        .map(|i| {
                            let phase = 2.0 * std::f64::consts::PI * i as f64 / count as f64;
                            let motion = pattern(values).reference_at($($constants,)? phase);
                            code::inverse_dynamics(&motion, &theta $(, $constants)?)
                        })
                        .collect();
                    let at_once = code::harmonics(&samples).expect("enough samples").into_array();
                    let mut accumulator = code::Accumulator::new();
                    for (i, sample) in samples.iter().enumerate() {
                        accumulator.push(2.0 * std::f64::consts::PI * i as f64 / count as f64, sample);
                    }
                    let stepwise = accumulator.harmonics().expect("samples were taken in").into_array();
                    // Three periods under a Hann window have the same harmonics.
                    let mut windowed = code::Accumulator::new();
                    for i in 0..3 * count {
                        let phase = 2.0 * std::f64::consts::PI * i as f64 / count as f64;
                        windowed.push_hann(phase, 3.0, &samples[i % count]);
                    }
                    let windowed = windowed.harmonics().expect("samples were taken in").into_array();
                    let size = at_once.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
                    for ((a, b), c) in at_once.iter().zip(stepwise).zip(windowed) {
                        assert!((a - b).abs() <= 1e-12 * size && (a - c).abs() <= 1e-11 * size, "{a} {b} {c}");
                    }
                    assert!(code::harmonics(&samples[..2 * code::HIGHEST_HARMONIC]).is_err());
                    at_once.to_vec()
                },
                solved: &|values, _constants, harmonics| {
                    $(let $constants = &code::Constants::from_array(fixed(_constants));)?
                    let harmonics = code::Harmonics::from_array(fixed(harmonics));
                    pattern(values).parameters($($constants,)? &harmonics).map(|found| found.into_array().to_vec())
                },
            };
            check_pattern($file, &check, $observable);
        }
    };
}

pattern!(mass_spring_drag_pattern, "mass_spring_drag.tpm", models::mass_spring_drag, observable: Some(true));
pattern!(silverbox_pattern, "silverbox.tpm", models::silverbox, observable: Some(true));
// The seven columns of two carts have condition 2.2e4 after scaling: parameters lose four digits. Three carts lose nearly all.
pattern!(two_carts_pattern, "two_carts.tpm", models::two_carts, observable: Some(true));
pattern!(three_carts_pattern, "three_carts.tpm", models::three_carts, observable: None);
pattern!(closed_loop_arm_pattern, "closed_loop_arm.tpm", models::closed_loop_arm, observable: Some(false), constants: constants);

// 425 entries: a table and a loop. One run of one pattern cannot tell so many parameters apart, so nothing is solved.
pattern!(dense_pattern, "fixtures/emit/dense.tpm", corners::dense, observable: None, constants: constants);
