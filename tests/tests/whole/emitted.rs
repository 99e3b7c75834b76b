//! Emitted code, compiled by the macro and run, against exact rational evaluation and against the interpreter.
//!
//! The exact side never sees a plan: it multiplies the terms of the regressor form, and the entries of the table, as rationals.
//! Inputs are dyadic, so that they are exact in both precisions; every bound is a number of roundings times the sum of the
//! magnitudes of the terms, since cancellation is the model's, not the code's.

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use tpm_codegen::emit::estimator::Estimator;
use tpm_codegen::{Source, parse_model};
use tpm_models as models;
use tpm_runtime::interpret::{Interpreted, InterpretedInverse};
use tpm_runtime::{Model, Real, SolveError};
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{ExprId, Node};
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::regressor::form::Term;

/// Roundings that any entry of the shipped models may gather.
const ROUNDINGS: f64 = 64.0;

fn estimator(file: &str) -> Estimator {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = folder.join(if file.contains('/') { "." } else { "../models" }).join(file);
    let source = Source::from_bytes(file, std::fs::read(&path).expect("a model file"));
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    Estimator::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message))
}

/// The same cases at every run.
fn runner(cases: u32) -> TestRunner {
    let rng = proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha);
    TestRunner::new_with_rng(ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }, rng)
}

/// Numbers k/64 with |k| <= 192, so that powers stay well inside both precisions.
fn dyadic(count: usize) -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec((-192i32..=192).prop_map(|k| f64::from(k) / 64.0), count)
}

fn exact(value: f64) -> Rational {
    rational::from_f64(value).expect("finite")
}

/// An exact sum and the sum of the magnitudes of its terms; `None` where a function has no rational value.
struct Sum {
    value: Rational,
    magnitude: Rational,
}

impl Sum {
    fn of(terms: impl IntoIterator<Item = Option<Rational>>) -> Option<Self> {
        let mut sum = Self { value: rational::integer(0), magnitude: rational::integer(0) };
        for term in terms {
            let term = term?;
            sum.magnitude += rational::abs(&term);
            sum.value += term;
        }
        Some(sum)
    }

    fn holds<T: Real>(&self, found: T) -> bool {
        let epsilon = T::EPSILON.to_f64();
        let error = rational::to_f64(&rational::abs(&(exact(found.to_f64()) - &self.value)));
        error <= ROUNDINGS * epsilon * rational::to_f64(&self.magnitude)
    }
}

/// The exact value of constants and motion atoms.
fn monomial(estimator: &Estimator, atoms: &Monomial<ExprId>, motion: &[f64], constants: &[f64]) -> Option<Rational> {
    let evaluation = &estimator.plan.evaluation;
    let leaf = |node: &Node| match node {
        Node::Derivative(coordinate, order) => {
            let position = evaluation.coordinates.iter().position(|(present, _)| present == coordinate)?;
            Some(exact(motion[*order as usize * evaluation.coordinates.len() + position]))
        }
        Node::Symbol(symbol) => match evaluation.constants.iter().position(|present| present == symbol) {
            Some(position) => Some(exact(constants[position])),
            None => match &estimator.model.quantity(*symbol).kind {
                tpm_symbolic::mechanics::model::Kind::Constant { value } => value.clone(),
                _ => None,
            },
        },
        _ => None,
    };
    let mut product = rational::integer(1);
    for (&atom, exponent) in atoms.factors() {
        let value = estimator.model.graph.evaluate_exact(atom, leaf)?;
        if value == rational::integer(0) && exponent < 0 {
            return None;
        }
        product *= rational::power(&value, exponent);
    }
    Some(product)
}

fn entry(
    estimator: &Estimator,
    terms: &[Term],
    column: Option<usize>,
    motion: &[f64],
    constants: &[f64],
) -> Option<Sum> {
    let terms = terms.iter().filter(|term| term.column == column);
    Sum::of(terms.map(|term| Some(monomial(estimator, &term.atoms, motion, constants)? * &term.coefficient)))
}

/// Phi, known terms and B, one after the other, as a model computes them.
fn evaluate<T: Real>(model: &dyn Model<T>, motion: &[f64], constants: &[f64]) -> Vec<T> {
    let dims = model.dims();
    let of = |values: &[f64]| values.iter().map(|&value| T::from_f64(value)).collect::<Vec<T>>();
    let (motion, constants) = (of(motion), of(constants));
    let mut workspace = vec![T::ZERO; model.workspace_len()];
    let mut out = vec![T::ZERO; dims.regressor_len() + dims.rows + dims.input_map_len()];
    let (phi, rest) = out.split_at_mut(dims.regressor_len());
    let (known, map) = rest.split_at_mut(dims.rows);
    model.regressor(&motion, &constants, &mut workspace, phi).expect("lengths fit");
    model.known(&motion, &constants, &mut workspace, known).expect("lengths fit");
    model.input_map(&motion, &constants, &mut workspace, map).expect("lengths fit");
    out
}

/// Compiled code against the interpreter, bit by bit, and both precisions against the exact values.
fn check_dynamics<M: Model<f64> + Model<f32>>(file: &str, compiled: &M) {
    let estimator = estimator(file);
    let interpreted = Interpreted::new(&estimator.model, &estimator.form);
    let dims = Model::<f64>::dims(compiled);
    assert_eq!(dims, interpreted.dims(), "{file}");
    let names = |model: &dyn Model<f64>| {
        let lists: [(usize, &dyn Fn(usize) -> String); 5] = [
            (dims.coordinates, &|i| model.coordinate(i).to_string()),
            (dims.inputs, &|i| model.input(i).to_string()),
            (dims.parameters, &|i| model.parameter(i).to_string()),
            (dims.constants, &|i| model.constant(i).to_string()),
            (dims.rows, &|i| model.row(i).to_string()),
        ];
        // One beyond the end too: an empty label, not a panic.
        lists.iter().flat_map(|(count, name)| (0..=*count).map(name)).collect::<Vec<String>>()
    };
    assert_eq!(names(compiled), names(&interpreted), "{file}");
    for c in 0..dims.coordinates {
        assert_eq!(Model::<f64>::coordinate_order(compiled, c), interpreted.coordinate_order(c), "{file}");
    }
    let compared = std::cell::Cell::new(0u32);
    let inputs = (dyadic(dims.motion_len()), dyadic(dims.constants), dyadic(dims.parameters));
    let result = runner(128).run(&inputs, |(motion, constants, theta)| {
        let double = evaluate::<f64>(compiled, &motion, &constants);
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<u64>>();
        prop_assert_eq!(bits(&double), bits(&evaluate(&interpreted, &motion, &constants)));
        let single = evaluate::<f32>(compiled, &motion, &constants);
        let mut at = 0;
        let columns: Vec<Option<usize>> = (0..dims.parameters).map(Some).collect();
        for (kind, columns) in [("regressor", columns.as_slice()), ("known", &[None])] {
            for (r, row) in estimator.form.rows.iter().enumerate() {
                for &column in columns {
                    if let Some(sum) = entry(&estimator, &row.terms, column, &motion, &constants) {
                        compared.set(compared.get() + 1);
                        prop_assert!(sum.holds(double[at]), "{} row {} column {:?}: {}", kind, r, column, double[at]);
                        prop_assert!(sum.holds(single[at]), "{} row {} column {:?}: {}", kind, r, column, single[at]);
                    }
                    at += 1;
                }
            }
        }
        for row in &estimator.form.rows {
            for input in &estimator.plan.evaluation.inputs {
                let factor = row.inputs.iter().find(|(symbol, _)| symbol == input);
                let terms = factor.iter().flat_map(|(_, factor)| factor.terms());
                let terms = terms.map(|(atoms, c)| Some(monomial(&estimator, atoms, &motion, &constants)? * c));
                if let Some(sum) = Sum::of(terms) {
                    prop_assert!(sum.holds(double[at]) && sum.holds(single[at]), "input map: {}", double[at]);
                }
                at += 1;
            }
        }
        let mut forces = vec![0.0; dims.rows];
        compiled.inverse_dynamics(&motion, &theta, &constants, &mut [], &mut forces).expect("lengths fit");
        for (row, &force) in estimator.form.rows.iter().zip(&forces) {
            let terms = row.terms.iter().map(|term| {
                let theta = term.column.map_or_else(|| rational::integer(1), |c| exact(theta[c]));
                Some(monomial(&estimator, &term.atoms, &motion, &constants)? * &term.coefficient * theta)
            });
            if let Some(sum) = Sum::of(terms) {
                prop_assert!(sum.holds(force), "inverse dynamics: {}", force);
            }
        }
        Ok(())
    });
    result.unwrap_or_else(|fault| panic!("{file}: {fault}"));
    assert!(compared.get() > 0, "{file}: nothing was compared with exact values");
}

macro_rules! dynamics {
    ($($test:ident: $file:literal, $model:path;)*) => {
        $(#[test]
        fn $test() {
            check_dynamics($file, &$model);
        })*
    };
}

dynamics! {
    brushless_motor: "brushless_motor.tpm", models::BrushlessMotor;
    cart_pendulum: "cart_pendulum.tpm", models::CartPendulum;
    closed_loop_arm: "closed_loop_arm.tpm", models::ClosedLoopArm;
    emps: "emps.tpm", models::Emps;
    mass_spring_drag: "mass_spring_drag.tpm", models::MassSpringDrag;
    mass_spring_drag_in_place: "mass_spring_drag.tpm", models::inline::MassSpringDrag;
    rotary_pendulum: "rotary_pendulum.tpm", models::RotaryPendulum;
    rotary_pendulum_down: "rotary_pendulum_down.tpm", models::RotaryPendulumDown;
    silverbox: "silverbox.tpm", models::Silverbox;
    three_carts: "three_carts.tpm", models::ThreeCarts;
    two_carts: "two_carts.tpm", models::TwoCarts;
}

/// What a compiled pattern does, over plain slices.
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

/// Reference, matrix and one sample of the harmonics in single precision, beside the double precision that was compared with
/// exact values: at most 16 roundings of the largest entry, or of the largest value that a derivative has.
macro_rules! pattern_single {
    ($test:ident, $module:path $(, constants: $constants:ident)?) => {
        #[test]
        fn $test() {
            use $module as code;
            fn fixed<T: Real, const N: usize>(values: &[f64]) -> [T; N] {
                std::array::from_fn(|i| T::from_f64(values[i]))
            }
            fn all<T: Real>(values: &[f64], _constants: &[f64], phase: f64) -> [Vec<f64>; 3] {
                $(let $constants = &code::Constants::from_array(fixed::<T, _>(_constants));)?
                let pattern = code::Pattern::from_array(fixed::<T, _>(values));
                let motion = pattern.reference_at($($constants,)? T::from_f64(phase));
                let matrix = pattern.estimator_matrix($($constants)?);
                let mut sums = code::Accumulator::new();
                sums.push_at(T::from_f64(phase.cos()), T::from_f64(phase.sin()), &code::known(&motion $(, $constants)?));
                let mut forces = code::known(&motion $(, $constants)?).into_array();
                forces.fill(T::ONE);
                sums.push_at(T::from_f64(0.8), T::from_f64(0.6), &code::Forces::from_array(forces));
                let sums = sums.harmonics().expect("samples were taken in").into_array();
                [motion.into_array().to_vec(), matrix.as_flattened().to_vec(), sums.to_vec()]
                    .map(|list| list.into_iter().map(T::to_f64).collect())
            }
            let result = runner(32).run(&(dyadic(8), dyadic(8), dyadic(1)), |(values, constants, phase)| {
                let [single, double] =
                    [all::<f32>(&values, &constants, phase[0]), all::<f64>(&values, &constants, phase[0])];
                // A motion near its rest points is the difference of larger numbers, which it has elsewhere.
                let elsewhere: Vec<Vec<f64>> =
                    (0..16).map(|k| all::<f64>(&values, &constants, f64::from(k) * 0.4)[0].clone()).collect();
                for (list, (single, double)) in single.iter().zip(&double).enumerate() {
                    let largest = double.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
                    for (i, (a, b)) in single.iter().zip(double).enumerate() {
                        let size = match list {
                            0 => elsewhere.iter().fold(b.abs(), |size, motion| size.max(motion[i].abs())),
                            _ => largest,
                        };
                        prop_assert!((a - b).abs() <= 16.0 * f64::from(f32::EPSILON) * size, "{} {} {}", list, a, b);
                    }
                }
                Ok(())
            });
            result.expect("single precision agrees");
        }
    };
}

pattern_single!(brushless_motor_single, models::brushless_motor);
pattern_single!(cart_pendulum_single, models::cart_pendulum);
pattern_single!(closed_loop_arm_single, models::closed_loop_arm, constants: constants);
pattern_single!(emps_single, models::emps);
pattern_single!(mass_spring_drag_single, models::mass_spring_drag);
pattern_single!(silverbox_single, models::silverbox);
pattern_single!(three_carts_single, models::three_carts);
pattern_single!(two_carts_single, models::two_carts);

/// Harmonics with deviations: parameters, covariance and residual beside the normal equations by hand; and inputs with the
/// regressor in one call.
#[test]
fn estimates_come_with_their_covariance() {
    use models::mass_spring_drag::{Harmonics, Motion, Parameters, Pattern};
    use models::mass_spring_drag::{feed_forward, feed_forward_with_regressor, regressor};
    let pattern = Pattern { lambda: 0.5, w: 2.0 };
    let (effort, deviations) = ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.5, 1.0, 2.0, 1.0, 0.25, 4.0]);
    let found = pattern.estimate(&Harmonics::from_array(effort), Some(&Harmonics::from_array(deviations)));
    let found = found.expect("observable");
    let matrix = pattern.estimator_matrix();
    let (mut information, mut left) = ([[0.0_f64; 3]; 3], [0.0_f64; 3]);
    for ((row, effort), deviation) in matrix.iter().zip(effort).zip(deviations) {
        for i in 0..3 {
            left[i] += row[i] * effort / (deviation * deviation);
            for j in 0..3 {
                information[i][j] += row[i] * row[j] / (deviation * deviation);
            }
        }
    }
    let theta = found.parameters.into_array();
    for i in 0..3 {
        let (mut right, size) = (0.0, information[i][i] * theta[i].abs());
        for j in 0..3 {
            right += information[i][j] * theta[j];
            let product: f64 = (0..3).map(|k| information[i][k] * found.covariance[k][j]).sum();
            let identity = if i == j { 1.0 } else { 0.0 };
            assert!((product - identity).abs() < 1e-12 * information[i][i] / information[j][j] + 1e-12, "{product}");
        }
        assert!((right - left[i]).abs() <= 1e-12 * (1.0 + size), "{right} {}", left[i]);
    }
    let motion = Motion::from_array(&[0.25, -0.5, 3.0]);
    let parameters = Parameters::from_array(theta);
    let (inputs, phi) = feed_forward_with_regressor(&motion, &parameters);
    assert_eq!((inputs, phi), (feed_forward(&motion, &parameters), regressor(&motion)));
}

/// Where every column of the matrix has one scale, the exact pseudo-inverse gives the parameters back from their harmonics, and
/// from any harmonics those of least squares.
#[test]
fn the_exact_pseudo_inverse_is_folded_into_constants() {
    use models::{emps, mass_spring_drag as slider};
    let result = runner(128).run(&(dyadic(2), dyadic(4)), |(pattern, theta)| {
        let excited = |value: f64| if value.abs() < 0.25 { 0.5 } else { value };
        let pattern: [f64; 2] = [excited(pattern[0]), excited(pattern[1])];
        let own = emps::Pattern::from_array(pattern);
        let harmonics =
            own.estimator_matrix().map(|row| row.iter().zip(&theta).map(|(entry, theta)| entry * theta).sum());
        let found = own.parameters_direct(&emps::Harmonics::from_array(harmonics)).into_array();
        for (found, theta) in found.iter().zip(&theta) {
            prop_assert!((found - theta).abs() <= 1e-10, "{} is not {}", found, theta);
        }
        let own = slider::Pattern::from_array(pattern);
        let harmonics = slider::Harmonics::from_array([theta[0], theta[1], theta[2], theta[3], 1.0, -0.5]);
        let (direct, solved) = (own.parameters_direct(&harmonics), own.parameters(&harmonics).expect("observable"));
        for (a, b) in direct.into_array().iter().zip(solved.into_array()) {
            prop_assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()), "{} {}", a, b);
        }
        Ok(())
    });
    result.expect("the same parameters");
    // Two joints on one pattern leave directions open: there is none for them.
    let text = tpm_codegen::generate::generate(
        &estimator("closed_loop_arm.tpm"),
        &tpm_codegen::generate::Options::new(tpm_codegen::generate::Language::Rust, "test"),
    );
    assert!(!text.expect("whole")[0].text.contains("parameters_direct"));
}

/// The interpreted pseudo-inverse does what the compiled one does, operation by operation, and rounds the exact value.
#[test]
fn interpreted_and_compiled_pseudo_inverses_agree() {
    use models::{emps, mass_spring_drag as slider};
    let estimators = ["emps.tpm", "mass_spring_drag.tpm"].map(estimator);
    let result = runner(128).run(&(dyadic(2), dyadic(6)), |(pattern, harmonics)| {
        let excited = |value: f64| if value.abs() < 0.25 { 0.5 } else { value };
        let pattern: [f64; 2] = [excited(pattern[0]), excited(pattern[1])];
        for estimator in &estimators {
            let (plan, constants) = (&estimator.plan.patterns[0], &estimator.plan.evaluation.constants);
            let inverse = InterpretedInverse::new(plan, constants).expect("every column has one scale");
            let rows = plan.table.as_ref().expect("a finite table").rows.len();
            let given: Vec<f64> = harmonics.iter().copied().cycle().take(rows).collect();
            let mut workspace = vec![0.0; inverse.workspace_len()];
            let mut found = vec![0.0; estimator.form.columns.len()];
            inverse.parameters(&pattern, &[], &given, &mut workspace, &mut found).expect("lengths fit");
            let compiled = if estimator.model.name == "MassSpringDrag" {
                let harmonics = slider::Harmonics::from_array(given.as_slice().try_into().expect("its rows"));
                slider::Pattern::from_array(pattern).parameters_direct(&harmonics).into_array().to_vec()
            } else {
                let harmonics = emps::Harmonics::from_array(given.as_slice().try_into().expect("its rows"));
                emps::Pattern::from_array(pattern).parameters_direct(&harmonics).into_array().to_vec()
            };
            let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<u64>>();
            prop_assert_eq!(bits(&found), bits(&compiled));
            let plan = &plan.pseudo_inverse.as_ref().expect("it was interpreted").plan;
            let amplitude = estimator.plan.patterns[0].amplitudes[0];
            let exactly = plan.evaluate_exact(|leaf| match *leaf {
                Leaf::Harmonic(row) => Some(exact(given[row])),
                Leaf::Symbol(symbol) => Some(exact(pattern[usize::from(symbol != amplitude)])),
                _ => None,
            });
            // Coulomb friction brings in pi, which has no exact value.
            let Some(exactly) = exactly else {
                prop_assert!(estimator.model.name != "MassSpringDrag", "its table is rational");
                continue;
            };
            for (found, exactly) in found.iter().zip(&exactly) {
                let expected = rational::to_f64(exactly);
                prop_assert!((found - expected).abs() <= 1e-12 * (1.0 + expected.abs()), "{} {}", found, expected);
            }
            prop_assert!(inverse.parameters(&pattern, &[], &given[1..], &mut workspace, &mut [0.0; 3]).is_err());
        }
        Ok(())
    });
    result.expect("the same parameters");
}

/// Dry friction has infinitely many harmonics; the matrix has those that the pattern declares: Fc sign(x') is 4/(pi n).
#[test]
fn a_declared_number_of_harmonics_holds_for_the_code() {
    use models::emps::{HIGHEST_HARMONIC, Pattern};
    let estimator = estimator("emps.tpm");
    let table = estimator.plan.patterns[0].table.as_ref().expect("a table");
    assert_eq!(table.table.tails[0].harmonics, HIGHEST_HARMONIC);
    let dims = Model::<f64>::dims(&models::Emps);
    let friction = (0..dims.parameters).position(|i| Model::<f64>::parameter(&models::Emps, i).name == "Fc");
    for sign in [1.0, -1.0] {
        let matrix = Pattern { lambda: sign * 0.2, w: 1.5 }.estimator_matrix();
        let last = matrix.last().expect("rows")[friction.expect("a column")];
        let expected = -sign * 4.0 / (HIGHEST_HARMONIC as f64 * std::f64::consts::PI);
        assert!((last - expected).abs() < 1e-15, "{last} {expected}");
    }
}

/// Sine and cosine become Taylor polynomials in the matrix only: at small amplitudes both agree to the remainder, here
/// theta^9/9! < 6e-13 of forces of a few newtons.
#[test]
fn declared_taylor_polynomials_hold_for_the_matrix() {
    use models::cart_pendulum::{HARMONICS, HIGHEST_HARMONIC, Parameters, Pattern, harmonics, inverse_dynamics};
    let pattern = Pattern { lambda1: 0.1, lambda2: 0.2, w: 3.0 };
    let theta = [11.0, 0.4, 0.16];
    let count = 2 * HIGHEST_HARMONIC + 3;
    let samples: Vec<_> = (0..count)
        .map(|i| {
            let motion = pattern.reference_at(2.0 * std::f64::consts::PI * i as f64 / count as f64);
            inverse_dynamics(&motion, &Parameters::from_array(theta))
        })
        .collect();
    let sampled = harmonics(&samples).expect("enough samples").into_array();
    let matrix = pattern.estimator_matrix();
    for row in 0..HARMONICS {
        let expected: f64 = matrix[row].iter().zip(theta).map(|(entry, theta)| entry * theta).sum();
        assert!((sampled[row] - expected).abs() < 1e-11, "row {row}: {} {expected}", sampled[row]);
    }
}

/// Models that only the emitter's own corners need.
mod corners {
    tpm_runtime::model_file!("fixtures/emit/dense.tpm");
    tpm_runtime::model_file!("fixtures/emit/names.tpm", crate = ::tpm_runtime);
}

// 425 entries: a table and a loop. One run of one pattern cannot tell so many parameters apart, so nothing is solved.
pattern!(dense_pattern, "fixtures/emit/dense.tpm", corners::dense, observable: None, constants: constants);

#[test]
fn names_of_the_language_are_carried_over() {
    use corners::type_model::{Constants, Motion, Parameters, TypeModel, fast, feed_forward, slow};
    check_dynamics("fixtures/emit/names.tpm", &TypeModel);
    let parameters = Parameters { m: 1.0, M: 2.0, crate_: 3.0, r#loop: 4.0 };
    let constants = Constants { r#match: 0.5 };
    let slow = slow::Pattern { r#fn: 0.2, w: 1.0 };
    let motion: Motion<f64> = slow.reference(&constants, 0.0);
    assert!((motion.r#type.value - 0.2 * 8.0 / 9.0).abs() < 1e-15);
    let inputs = feed_forward(&motion, &parameters, &constants);
    assert!((inputs.self_ - (2.0 * motion.r#type.ddot + motion.r#type.value + 0.5)).abs() < 1e-15);
    assert!((inputs.Self_ - (3.0 * motion.motion.ddot + 4.0 * motion.motion.value.sin())).abs() < 1e-15);
    let fast = fast::Pattern { fn2: 0.2, w2: 1.0 };
    assert!((fast.reference(&constants, 0.3).motion.dot - 0.4 * 0.6_f64.cos()).abs() < 1e-15);
}

/// The file that `tpm generate` writes computes what the macro's code computes, bit by bit.
#[test]
fn a_generated_file_is_the_macros_code() {
    use crate::generated::mass_spring_drag as file;
    use models::mass_spring_drag as code;
    assert_eq!(
        (file::MODEL_HASH, file::PARAMETERS.map(|p| (p.name, p.unit))),
        (code::MODEL_HASH, code::PARAMETERS.map(|p| (p.name, p.unit)))
    );
    let result = runner(128).run(&(dyadic(2), dyadic(3), -3.0..3.0f64), |(pattern, theta, phase)| {
        let pattern: [f64; 2] = pattern.try_into().expect("two symbols");
        let theta: [f64; 3] = theta.try_into().expect("three parameters");
        let (ours, theirs) = (file::Pattern::from_array(pattern), code::Pattern::from_array(pattern));
        prop_assert_eq!(ours.estimator_matrix(), theirs.estimator_matrix());
        let (motion, other) = (ours.reference_at(phase), theirs.reference_at(phase));
        prop_assert_eq!(motion.into_array(), other.into_array());
        prop_assert_eq!(file::regressor(&motion), code::regressor(&other));
        prop_assert_eq!(file::known(&motion).into_array(), code::known(&other).into_array());
        let force = file::feed_forward(&motion, &file::Parameters::from_array(theta)).u;
        prop_assert_eq!(force, code::feed_forward(&other, &code::Parameters::from_array(theta)).u);
        let (mut sums, mut others) = (file::Accumulator::new(), code::Accumulator::new());
        sums.push(phase, &file::Forces { u: force });
        others.push(phase, &code::Forces { u: force });
        let bits = |harmonics: [f64; 6]| harmonics.map(f64::to_bits);
        prop_assert_eq!(
            sums.harmonics().map(|harmonics| bits(harmonics.into_array())),
            others.harmonics().map(|harmonics| bits(harmonics.into_array()))
        );
        Ok(())
    });
    result.expect("the same numbers");
}

#[test]
fn a_build_script_makes_the_same_module() {
    use crate::built::mass_spring_drag as built;
    use models::mass_spring_drag as code;
    let (ours, theirs) = (built::Pattern { lambda: 0.3, w: 2.0 }, code::Pattern { lambda: 0.3, w: 2.0 });
    assert_eq!(ours.estimator_matrix(), theirs.estimator_matrix());
    assert_eq!(ours.reference(0.4).into_array(), theirs.reference(0.4).into_array());
    assert_eq!(built::MODEL_HASH, code::MODEL_HASH);
}

#[test]
fn feed_forward_is_the_input_of_the_equation() {
    use models::mass_spring_drag::{Parameters, Pattern, feed_forward, inverse_dynamics};
    let pattern = Pattern { lambda: 0.5_f64, w: 2.0 };
    let parameters = Parameters { m: 2.0, k1: 40.0, k2: 1.5 };
    let motion = pattern.reference(0.3);
    let force = feed_forward(&motion, &parameters).u;
    assert_eq!(force, inverse_dynamics(&motion, &parameters).u);
    let x = motion.x;
    assert!((force - (2.0 * x.ddot + 40.0 * x.value + 1.5 * x.dot * x.dot)).abs() < 1e-13);
    assert!((pattern.period() - std::f64::consts::PI).abs() < 1e-15);
}

/// The two parts of the feed-forward that a module computes, and the whole, at one motion.
macro_rules! feed_forward_parts {
    ($model:ident, $motion:expr, $parameters:expr, $($constants:expr)?) => {{
        use models::$model::{Motion, Parameters, feed_forward, feed_forward_dependent, feed_forward_independent};
        let motion = Motion::from_array($motion.as_slice().try_into().expect("the model's motion"));
        let parameters = Parameters::from_array($parameters.as_slice().try_into().expect("the model's parameters"));
        [
            feed_forward(&motion, &parameters, $($constants)?).into_array().to_vec(),
            feed_forward_independent(&motion, &parameters, $($constants)?).into_array().to_vec(),
            feed_forward_dependent(&motion, &parameters, $($constants)?).into_array().to_vec(),
        ]
    }};
}

#[test]
fn the_parts_of_the_feed_forward_add_up_and_are_those_of_the_rows() {
    let models_of: [(&str, &dyn Model<f64>); 4] = [
        ("cart_pendulum", &models::cart_pendulum::CartPendulum),
        ("closed_loop_arm", &models::closed_loop_arm::ClosedLoopArm),
        ("emps", &models::emps::Emps),
        ("mass_spring_drag", &models::mass_spring_drag::MassSpringDrag),
    ];
    for (name, model) in models_of {
        let dims = model.dims();
        let driven: Vec<Vec<usize>> = (0..dims.inputs).map(|i| vec![i]).collect();
        let inputs = (dyadic(dims.motion_len()), dyadic(dims.parameters), dyadic(dims.constants));
        let result = runner(128).run(&inputs, |(motion, theta, constants)| {
            let [whole, independent, dependent] = match name {
                "cart_pendulum" => feed_forward_parts!(cart_pendulum, motion, theta,),
                "emps" => feed_forward_parts!(emps, motion, theta,),
                "mass_spring_drag" => feed_forward_parts!(mass_spring_drag, motion, theta,),
                _ => {
                    let fixed: [f64; 2] = constants.as_slice().try_into().expect("two constants");
                    let fixed = models::closed_loop_arm::Constants::from_array(fixed);
                    feed_forward_parts!(closed_loop_arm, motion, theta, &fixed)
                }
            };
            // The same from the rows alone, with the driven coordinate standing still.
            let demand = tpm_runtime::machine::actuator::Demand::new(model, &theta, &constants, &driven);
            let parts = demand.at(motion.clone()).expect("every input has its row");
            let size = 1.0 + theta.iter().chain(&motion).map(|v| v.abs()).fold(0.0, f64::max).powi(5);
            for i in 0..dims.inputs {
                prop_assert!((independent[i] + dependent[i] - whole[i]).abs() <= 1e-13 * size, "{} {}", name, i);
                prop_assert!((independent[i] - parts.independent[i]).abs() <= 1e-13 * size, "{} {}", name, i);
                prop_assert!((dependent[i] - parts.dependent[i]).abs() <= 1e-13 * size, "{} {}", name, i);
            }
            Ok(())
        });
        result.expect("the same parts");
    }
}

/// Feng, Eqns 6.6 and 6.7 as a careful engineer writes them: independent m L (th'' cos - th'^2 sin) and m L x'' cos, dependent
/// (M + m) x'' and m L^2 th''. The generated parts take no operation more.
#[test]
fn split_feed_forward_takes_no_more_operations_than_by_hand() {
    let estimator = estimator("cart_pendulum.tpm");
    let [independent, dependent] = estimator.plan.feed_forward_parts.as_ref().expect("every input has its row");
    let (first, second) = (independent.counts(), dependent.counts());
    assert_eq!(first.functions, 2, "one sine and one cosine");
    assert!(first.additions <= 1 && first.multiplications <= 6 && first.divisions == 0, "{first:?}");
    assert_eq!((second.additions, second.multiplications, second.divisions + second.functions), (0, 2, 0));
    // A chain that is written in its far cart has no such parts: the coordinate that its input drives is gone.
    assert!(self::estimator("two_carts.tpm").plan.feed_forward_parts.is_none());
}

/// Values of a plan, exactly, each with a bound of what rounding every operation once makes of it, to first order and in units
/// of half the precision; `None` where something is divided by zero.
fn with_rounding(plan: &Plan, mut leaf: impl FnMut(&Leaf) -> Rational) -> Option<Vec<(Rational, Rational)>> {
    let mut known: Vec<(Rational, Rational)> = Vec::with_capacity(plan.ops.len());
    let zero = || rational::integer(0);
    for op in &plan.ops {
        let at = |slot: &Slot| &known[slot.index()];
        let (value, handed_on) = match op {
            Op::Constant(value) => (value.clone(), zero()),
            Op::Load(index) => {
                known.push((leaf(&plan.inputs[*index as usize]), zero()));
                continue;
            }
            Op::Add(a, b) => (&at(a).0 + &at(b).0, &at(a).1 + &at(b).1),
            Op::Sub(a, b) => (&at(a).0 - &at(b).0, &at(a).1 + &at(b).1),
            Op::Mul(a, b) => {
                let ((a, of_a), (b, of_b)) = (at(a), at(b));
                (a * b, rational::abs(a) * of_b + rational::abs(b) * of_a)
            }
            Op::Div(a, b) => {
                let ((a, of_a), (b, of_b)) = (at(a), at(b));
                if *b == zero() {
                    return None;
                }
                let value = a / b;
                let handed_on = (of_a + rational::abs(&value) * of_b) / rational::abs(b);
                (value, handed_on)
            }
            Op::Neg(a) => {
                known.push((-&at(a).0, at(a).1.clone()));
                continue;
            }
            _ => unreachable!("a rational function"),
        };
        let rounding = handed_on + rational::abs(&value);
        known.push((value, rounding));
    }
    Some(plan.outputs.iter().map(|slot| known[slot.index()].clone()).collect())
}

/// Code that takes columns back to physical parameters, in both precisions, against the exact inverse, at columns of random
/// machines that are rounded to the precision.
fn check_unlump(file: &str, double: &dyn Fn(&[f64]) -> Vec<f64>, single: &dyn Fn(&[f32]) -> Vec<f32>) {
    let estimator = estimator(file);
    let plan = &estimator.plan;
    let lumping = plan.lumping.as_ref().expect("products of parameters");
    let back = plan.unlumping.as_ref().expect("products of parameters").as_ref().expect("a way back");
    assert_eq!(back.inverse.holds(&back.map), Some(true), "{file}");
    let parameters: Vec<_> = estimator.model.parameters().collect();
    let checked = std::cell::Cell::new(0);
    let result = runner(64).run(&dyadic(parameters.len()), |physical| {
        let columns = lumping.evaluate_exact(|leaf| match *leaf {
            Leaf::Symbol(symbol) => parameters.iter().position(|own| *own == symbol).map(|i| exact(physical[i])),
            _ => None,
        });
        let Some(columns) = columns else { return Ok(()) };
        let of_double: Vec<f64> = columns.iter().map(rational::to_f64).collect();
        let of_single: Vec<f32> = columns.iter().map(rational::to_f32).collect();
        let found = [double(&of_double), single(&of_single).iter().map(|value| f64::from(*value)).collect()];
        let given = [of_double, of_single.iter().map(|value| f64::from(*value)).collect()];
        for ((found, given), epsilon) in found.iter().zip(&given).zip([f64::EPSILON, f64::from(f32::EPSILON)]) {
            let bounds = with_rounding(&back.plan, |leaf| match *leaf {
                Leaf::Column(column) => exact(given[column]),
                _ => unreachable!("no constant in these models"),
            });
            let Some(bounds) = bounds else { return Ok(()) };
            let mut values: Vec<Rational> = given.iter().map(|value| exact(*value)).collect();
            for intermediate in &back.inverse.intermediates {
                let Some(value) = intermediate.value.evaluate(|&j| values[j].clone()) else { return Ok(()) };
                values.push(value);
            }
            let bounds = &bounds[back.intermediates.len()..];
            for (((found, (_, bound)), parameter), (solved, value)) in
                found.iter().zip(bounds).zip(&parameters).zip(&back.inverse.solved)
            {
                prop_assert_eq!(parameter, solved);
                let expected = value.evaluate(|&j| values[j].clone()).expect("the plan divides by the same");
                let error = rational::to_f64(&rational::abs(&(exact(*found) - &expected)));
                // What is of second order makes no difference beside 1 %, unless the first order is as large as the value.
                let bound = 1.01 * epsilon / 2.0 * rational::to_f64(bound);
                if bound < 0.01 * rational::to_f64(&rational::abs(&expected)) {
                    prop_assert!(error <= bound, "{}: {} is not {}, bound {}", file, found, expected, bound);
                    checked.set(checked.get() + 1);
                }
            }
        }
        Ok(())
    });
    result.unwrap_or_else(|fault| panic!("{file}: {fault}"));
    assert!(checked.get() > 64 * parameters.len(), "{file}: only {} values", checked.get());
}

#[test]
fn physical_parameters_follow_from_the_lumped_ones() {
    macro_rules! check {
        ($($model:ident $($constants:expr)?;)*) => {$({
            use models::$model::Parameters;
            let file = concat!(stringify!($model), ".tpm");
            check_unlump(
                file,
                &|columns| {
                    let columns = Parameters::from_array(columns.try_into().expect("its columns"));
                    columns.unlump($(&models::$model::Constants::from_array($constants))?).into_array().to_vec()
                },
                &|columns| {
                    let columns = Parameters::from_array(columns.try_into().expect("its columns"));
                    columns.unlump($(&models::$model::Constants::from_array($constants))?).into_array().to_vec()
                },
            );
        })*};
    }
    check! {
        cart_pendulum;
        rotary_pendulum [1.0, 1.0, 1.0];
        rotary_pendulum_down [1.0, 1.0, 1.0];
        three_carts;
        two_carts;
    }
}

#[test]
fn lumped_parameters_follow_from_the_physical_ones() {
    use models::rotary_pendulum::{Constants, PARAMETERS, Physical};
    let estimator = estimator("rotary_pendulum.tpm");
    let plan = &estimator.plan;
    let lumping = plan.lumping.as_ref().expect("products of parameters");
    let mut runner = runner(128);
    let count = estimator.model.parameters().count();
    let result = runner.run(&(dyadic(count), dyadic(plan.evaluation.constants.len())), |(physical, constants)| {
        let values = lumping.evaluate_exact(|leaf| match *leaf {
            Leaf::Symbol(symbol) => {
                let own = estimator.model.parameters().position(|present| present == symbol);
                let constant = plan.evaluation.constants.iter().position(|present| *present == symbol);
                own.map(|i| physical[i]).or(constant.map(|i| constants[i])).map(exact)
            }
            _ => None,
        });
        let Some(values) = values else { return Ok(()) };
        let fixed = Constants::from_array(constants.as_slice().try_into().expect("three constants"));
        let found = Physical::from_array(physical.as_slice().try_into().expect("eight parameters")).lump(&fixed);
        for ((found, exact), label) in found.into_array().iter().zip(&values).zip(PARAMETERS) {
            let expected = rational::to_f64(exact);
            prop_assert!((found - expected).abs() <= 1e-12 * expected.abs().max(1.0), "{}", label.name);
        }
        Ok(())
    });
    result.expect("lumped parameters agree");
}

/// After ten million samples the phasor is as good as after one: the harmonics of a signal that is zero but for one sample say
/// what cosine and sine that sample met. Errors at most 1e-12 in double precision, 4 units in the last place of 1 in single.
#[test]
fn ten_million_samples_without_drift() {
    fn worst<T: Real>(value: fn(T) -> f64) -> f64 {
        use tpm_models::emps::{Forces, harmonics};
        const COUNT: usize = 10_000_000;
        let mut samples = vec![Forces { force: T::ZERO }; COUNT];
        let mut worst: f64 = 0.0;
        for place in [2_500_000, 4_999_999, 9_999_999] {
            let phase = std::f64::consts::TAU * place as f64 / COUNT as f64;
            samples[place].force = T::from_f64(COUNT as f64 / 2.0);
            let found = harmonics(&samples).expect("enough samples").force;
            samples[place].force = T::ZERO;
            worst = worst.max((value(found.cos1) - phase.cos()).abs()).max((value(found.sin1) - phase.sin()).abs());
        }
        worst
    }
    assert!(worst::<f64>(|value| value) <= 1e-12);
    assert!(worst::<f32>(f64::from) <= 4.0 * f64::from(f32::EPSILON));
}
