//! A generated estimator on bare metal: reference, feed-forward, harmonics, solution, in both precisions.
//!
//! The panic handler refers to a symbol that nothing defines. In an optimised build it is dropped when no path leads to a panic;
//! if one does, the program does not link.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;
use tpm_runtime::{Dims, EvalError, Model, Real, SolveError, model_file};

model_file!("../../models/closed_loop_arm.tpm");
model_file!("../../models/mass_spring_drag.tpm");

#[cfg(not(debug_assertions))]
unsafe extern "C" {
    /// Defined nowhere.
    safe fn a_path_to_a_panic_remains() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    #[cfg(not(debug_assertions))]
    a_path_to_a_panic_remains();
    #[cfg(debug_assertions)]
    loop {}
}

/// One period of a campaign: play the reference, take in what was applied, solve for the parameters.
fn slider<T: Real>() -> Result<T, SolveError> {
    use mass_spring_drag::{Accumulator, Forces, Parameters, Pattern, feed_forward_with_regressor, harmonics};
    let pattern = black_box(Pattern { lambda: T::from_f64(0.3), w: T::from_f64(3.0) });
    let parameters = black_box(Parameters { m: T::from_f64(2.0), k1: T::from_f64(40.0), k2: T::from_f64(1.5) });
    let mut samples = [Forces { u: T::ZERO }; 100];
    let mut accumulator = Accumulator::new();
    let mut sum = T::ZERO;
    for (i, sample) in samples.iter_mut().enumerate() {
        let time = pattern.period() * T::from_f64(i as f64 / 100.0);
        let motion = pattern.reference(time);
        let (inputs, [[a, b, c]]) = feed_forward_with_regressor(&motion, &parameters);
        sample.u = inputs.u;
        accumulator.push_hann(pattern.w * time, T::from_f64(4.0), sample);
        accumulator.push(pattern.w * time, sample);
        sum += a + b + c;
    }
    if let Some(found) = accumulator.harmonics() {
        sum += pattern.parameters(&found)?.m + pattern.parameters_direct(&found).k1;
        let estimate = pattern.estimate(&found, Some(&found))?;
        sum += estimate.condition + estimate.residual + estimate.covariance.as_flattened().iter().fold(T::ZERO, |a, &b| a + b);
    }
    if let Ok(found) = harmonics(black_box(&samples)) {
        sum += pattern.parameters(&found)?.k2;
    }
    Ok(sum)
}

fn arm<T: Real>() -> Result<T, SolveError> {
    use closed_loop_arm::{Constants, Forces, Parameters, Pattern, feed_forward, harmonics};
    let constants = black_box(Constants::from_array([T::ZERO, T::ONE]));
    let pattern = black_box(Pattern::from_array([T::from_f64(-0.245), T::from_f64(0.2), T::from_f64(2.0)]));
    let parameters = black_box(Parameters::from_array([T::ONE; 9]));
    let inputs = feed_forward(&pattern.reference(&constants, T::ONE), &parameters, &constants);
    let samples = black_box([Forces { tau1: inputs.tau1, tau2: inputs.tau2 }; 40]);
    match harmonics(&samples) {
        Ok(found) => Ok(pattern.parameters(&constants, &found)?.a10),
        Err(_) => Ok(inputs.tau2),
    }
}

/// The shared trait with slices whose lengths the compiler does not know.
fn through_the_trait<T: Real>(model: &dyn Model<T>, motion: &[T], out: &mut [T]) -> Result<Dims, EvalError> {
    model.regressor(motion, &[], &mut [], out)?;
    model.known(motion, &[], &mut [], out)?;
    model.input_map(motion, &[], &mut [], out)?;
    model.inverse_dynamics(motion, &[T::ONE; 3], &[], &mut [], out)?;
    black_box(model.parameter(black_box(7)).name);
    Ok(model.dims())
}

/// The program's entry.
#[unsafe(no_mangle)]
pub extern "C" fn _start() -> ! {
    loop {
        black_box(slider::<f32>().is_ok());
        black_box(slider::<f64>().is_ok());
        black_box(arm::<f32>().is_ok());
        black_box(arm::<f64>().is_ok());
        let mut out = [0.0; 3];
        black_box(through_the_trait::<f64>(&MassSpringDrag, black_box(&[1.0; 3]), black_box(&mut out)).is_ok());
        let mut out = [0.0; 3];
        black_box(through_the_trait::<f32>(&MassSpringDrag, black_box(&[1.0; 3]), black_box(&mut out)).is_ok());
    }
}
