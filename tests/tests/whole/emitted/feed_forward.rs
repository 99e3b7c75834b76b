//! The feed-forward of emitted code, whole and in its two parts.

use super::{dyadic, estimator, runner};
use proptest::prelude::*;
use tpm_models as models;
use tpm_runtime::Model;

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
            // The parts once more from the rows alone, with the driven coordinate standing still.
            let demand = tpm_runtime::plant::actuator::Demand::new(model, &theta, &constants, &driven);
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
