//! Single precision beside double precision, and sums of many samples in both.

use super::{dyadic, runner};
use proptest::prelude::*;
use tpm_models as models;
use tpm_runtime::Real;

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
