//! An arm's estimator on the controller: base parameters sample by sample, beside what double precision finds from these samples.
//!
//! The program does not link when a path to a panic remains in it.
#![no_std]

// `../run` puts these beside a copy of this file: as `tpm generate --lang rust` and as `simulate.c` write them.
#[allow(dead_code, reason = "a program uses what it needs of it")]
mod estimator;
mod samples;

use core::cell::UnsafeCell;
use core::ffi::{CStr, c_char, c_long};
use core::hint::black_box;
use estimator::{BaseEstimate, BaseEstimator, Forces, Motion};
use samples::{EXPECTED, FORCES, MOTIONS, SAMPLES, TRUTH};

unsafe extern "C" {
    fn print(text: *const c_char);
    fn print_float(value: f32);
    fn measure(name: *const c_char, what: extern "C" fn(), calls: c_long);
    /// Defined nowhere.
    safe fn a_path_to_a_panic_remains() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    a_path_to_a_panic_remains()
}

struct Shared(UnsafeCell<Option<(BaseEstimator<f32>, Option<BaseEstimate<f32>>)>>);

// There is one thread, and no interrupt.
unsafe impl Sync for Shared {}

static STATE: Shared = Shared(UnsafeCell::new(None));

fn with(work: impl FnOnce(&mut BaseEstimator<f32>, &mut Option<BaseEstimate<f32>>)) {
    // SAFETY: one thread, and nothing that is called inside calls this again.
    if let Some((estimator, estimate)) = unsafe { (*STATE.0.get()).as_mut() } {
        work(estimator, estimate);
    }
}

extern "C" fn take_in() {
    with(|estimator, _| {
        for (values, forces) in MOTIONS.iter().zip(&FORCES) {
            // Samples hold a joint's derivatives side by side; a motion's list holds all positions first.
            let &[q1, v1, a1, q2, v2, a2, q3, v3, a3] = values;
            let motion = Motion::from_array(&[q1, q2, q3, v1, v2, v3, a1, a2, a3]);
            let _ = estimator.push(black_box(&motion), &Forces::from_array(*forces), None);
        }
    });
}

extern "C" fn solve() {
    with(|estimator, estimate| *estimate = Some(black_box(&*estimator).estimate()));
}

fn say(text: &CStr) {
    // SAFETY: `text` ends in a zero.
    unsafe { print(text.as_ptr()) };
}

fn say_number(value: f32) {
    // SAFETY: a number.
    unsafe { print_float(value) };
}

/// The program, after `start.c`: 0 when every base parameter is what double precision finds.
#[unsafe(no_mangle)]
pub extern "C" fn main() -> i32 {
    // SAFETY: nothing else has been called yet.
    unsafe { *STATE.0.get() = Some((BaseEstimator::new(), None)) };
    // SAFETY: the names end in a zero, and the functions take nothing.
    unsafe {
        measure(c"push".as_ptr(), take_in, SAMPLES as c_long);
        measure(c"estimate".as_ptr(), solve, 1);
    }
    let mut right = false;
    with(|_, estimate| {
        let Some(found) = estimate.as_ref().and_then(BaseEstimate::whole) else { return };
        right = true;
        let mut worst: f32 = 0.0;
        for ((found, expected), truth) in found.into_array().into_iter().zip(EXPECTED).zip(TRUTH) {
            let off = (found - expected).abs() / expected.abs();
            say_number(found);
            say(c", true ");
            say_number(truth);
            say(c", off double precision by ");
            say_number(off);
            say(c"\n");
            right &= off <= 1e-2;
            worst = if off > worst { off } else { worst };
        }
        say(c"largest difference from double precision ");
        say_number(worst);
        say(c"\n");
    });
    i32::from(!right)
}
