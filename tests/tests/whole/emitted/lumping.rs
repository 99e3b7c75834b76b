//! Emitted code from physical parameters to lumped ones and back, against the exact maps.

use super::{dyadic, estimator, exact, runner};
use proptest::prelude::*;
use tpm_models as models;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::Plan;

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
                // Terms of second order stay below the 1 %, unless the bound of first order is as large as the value.
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
