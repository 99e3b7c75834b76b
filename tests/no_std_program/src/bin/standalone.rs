//! A generated file that stands alone on `core` and `libm`, on bare metal: no crate of this project is in the program.
//!
//! As in `estimator`, a path to a panic would keep the program from linking.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

#[allow(dead_code, reason = "a program uses what it needs of it")]
#[path = "../../../generated/mass_spring_drag.rs"]
mod mass_spring_drag;

use mass_spring_drag::support::{Real, SolveError};
use mass_spring_drag::{Accumulator, Forces, Parameters, Pattern, feed_forward};

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
    let pattern = black_box(Pattern { lambda: T::from_f64(0.3), w: T::from_f64(3.0) });
    let parameters = black_box(Parameters { m: T::from_f64(2.0), k1: T::from_f64(40.0), k2: T::from_f64(1.5) });
    let mut accumulator = Accumulator::new();
    for i in 0..100 {
        let time = pattern.period() * T::from_f64(f64::from(i) / 100.0);
        let u = feed_forward(&pattern.reference(time), &parameters).u;
        accumulator.push(pattern.w * time, &Forces { u });
    }
    match accumulator.harmonics() {
        Some(found) => Ok(pattern.parameters(&found)?.m + pattern.estimate(&found, Some(&found))?.condition),
        None => Ok(T::ZERO),
    }
}

/// The program's entry.
#[unsafe(no_mangle)]
pub extern "C" fn _start() -> ! {
    loop {
        black_box(slider::<f32>().is_ok());
        black_box(slider::<f64>().is_ok());
    }
}
