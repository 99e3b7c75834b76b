//! Regressor, known terms, input map and inverse dynamics of emitted code are those of the interpreter, and the exact ones.

use super::{Sum, corners, dyadic, estimator, exact, runner};
use proptest::prelude::*;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_models as models;
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::{Model, Real};
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{ExprId, Node};
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::regressor::form::Term;

/// The exact value of constants and motion atoms.
fn monomial(
    estimator: &EstimatorSource,
    atoms: &Monomial<ExprId>,
    motion: &[f64],
    constants: &[f64],
) -> Option<Rational> {
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
    estimator: &EstimatorSource,
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
        // An index one beyond the end gives an empty label, not a panic.
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
    rotary_pendulum_dry: "rotary_pendulum_dry.tpm", models::RotaryPendulumDry;
    silverbox: "silverbox.tpm", models::Silverbox;
    stribeck_pendulum: "stribeck_pendulum.tpm", models::StribeckPendulum;
    three_carts: "three_carts.tpm", models::ThreeCarts;
    two_carts: "two_carts.tpm", models::TwoCarts;
}

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
