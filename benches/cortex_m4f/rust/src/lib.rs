//! A model's estimator on the controller: it finds the parameters of a machine whose forces stand in a table.
//!
//! The program does not link when a path to a panic remains in it.
#![no_std]

// `../run` puts these beside a copy of this file: as `tpm generate --lang rust` and as `samples.py --rust` write them.
#[allow(dead_code, reason = "a program uses what it needs of it")]
mod estimator;
#[allow(dead_code, reason = "a program uses what it needs of it")]
mod samples;

use core::cell::UnsafeCell;
use core::ffi::{CStr, c_char, c_long};
use core::hint::black_box;
use estimator::{Accumulator, Forces, HARMONICS, Harmonics, Motion, PARAMETERS, Pattern};
use samples::{FORCES, GUESS, PATTERNS, PHYSICAL, RUNS, SAMPLES, TOLERANCE, TRUTH, of_model};

const COLUMNS: usize = PARAMETERS.len();

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

/// What the measured functions work on.
struct State {
    sums: Accumulator<f32>,
    motion: Motion<f32>,
    harmonics: [Harmonics<f32>; RUNS],
    found: Option<[f32; COLUMNS]>,
}

struct Shared(UnsafeCell<Option<State>>);

// There is one thread, and no interrupt.
unsafe impl Sync for Shared {}

static STATE: Shared = Shared(UnsafeCell::new(None));

fn with(work: impl FnOnce(&mut State)) {
    // SAFETY: one thread, and nothing that is called inside calls this again.
    if let Some(state) = unsafe { (*STATE.0.get()).as_mut() } {
        work(state);
    }
}

fn phase(sample: usize) -> f32 {
    6.283_185_3 * sample as f32 / SAMPLES as f32
}

fn pattern(run: usize) -> Option<Pattern<f32>> {
    PATTERNS.get(run).map(|values| Pattern::from_array(*values))
}

extern "C" fn references() {
    with(|state| {
        let Some(pattern) = pattern(0) else { return };
        for i in 0..SAMPLES {
            state.motion = black_box(of_model::reference_at(&pattern, phase(i)));
        }
    });
}

extern "C" fn feed_forwards() {
    with(|state| {
        let guess = estimator::Parameters::from_array(GUESS);
        for _ in 0..SAMPLES {
            black_box(of_model::feed_forward(black_box(&state.motion), black_box(&guess)));
        }
    });
}

extern "C" fn take_in_at() {
    with(|state| {
        for forces in FORCES.iter().take(1).flatten() {
            state.sums.push_at(black_box(0.6), black_box(0.8), &Forces::from_array(*forces));
        }
    });
}

fn accumulated(run: usize) -> Accumulator<f32> {
    let mut sums = Accumulator::new();
    for (i, forces) in FORCES.iter().skip(run).take(1).flatten().enumerate() {
        sums.push(phase(i), &Forces::from_array(*forces));
    }
    sums
}

extern "C" fn take_in() {
    with(|state| state.sums = accumulated(0));
}

extern "C" fn identify_directly() {
    with(|state| {
        let (Some(pattern), Some(effort)) = (pattern(0), state.harmonics.first()) else { return };
        for _ in 0..SAMPLES {
            state.found = of_model::direct(black_box(&pattern), black_box(effort));
        }
    });
}

/// One run by itself; several by their normal equations, whose solution is that of least squares over all of them.
extern "C" fn identify() {
    with(|state| {
        if RUNS == 1 {
            let (Some(pattern), Some(effort)) = (pattern(0), state.harmonics.first()) else { return };
            state.found = estimator::solve(&of_model::estimator_matrix(&pattern), effort).ok().map(|p| p.into_array());
            return;
        }
        let (mut normal, mut right) = ([[0.0_f32; COLUMNS]; HARMONICS], [0.0_f32; HARMONICS]);
        for (values, effort) in PATTERNS.iter().zip(&state.harmonics) {
            let matrix = of_model::estimator_matrix(&Pattern::from_array(*values));
            for (row, effort) in matrix.iter().zip(effort.into_array()) {
                for ((a, normal), right) in row.iter().zip(&mut normal).zip(&mut right) {
                    *right += a * effort;
                    for (b, normal) in row.iter().zip(normal) {
                        *normal += a * b;
                    }
                }
            }
        }
        state.found = estimator::solve(&normal, &Harmonics::from_array(right)).ok().map(|p| p.into_array());
    });
}

fn say(text: &CStr) {
    // SAFETY: `text` ends in a zero.
    unsafe { print(text.as_ptr()) };
}

/// A name of the model, through a buffer that ends it in a zero.
fn say_name(name: &str) {
    let mut text = [0_u8; 32];
    for (to, from) in text.iter_mut().take(31).zip(name.bytes()) {
        *to = from;
    }
    // SAFETY: the last byte is zero.
    unsafe { print(text.as_ptr().cast()) };
}

fn check(name: &str, found: f32, expected: f32) -> bool {
    let off = (found - expected).abs() / expected.abs();
    say_name(name);
    say(c" = ");
    // SAFETY: a number.
    unsafe { print_float(found) };
    say(c", off by ");
    // SAFETY: a number.
    unsafe { print_float(off) };
    say(c"\n");
    off <= TOLERANCE
}

fn check_all() -> bool {
    let mut right = false;
    with(|state| {
        let Some(found) = state.found else { return };
        right = true;
        for ((label, found), expected) in PARAMETERS.iter().zip(found).zip(TRUTH) {
            right &= check(label.name, found, expected);
        }
        state.found = None;
    });
    right
}

fn timed(name: &CStr, what: extern "C" fn(), calls: usize) {
    // SAFETY: `name` ends in a zero, and `what` takes nothing.
    unsafe { measure(name.as_ptr(), what, calls as c_long) };
}

/// The program, after `start.c`: 0 when every parameter was found.
#[unsafe(no_mangle)]
pub extern "C" fn main() -> i32 {
    let mut harmonics = [Harmonics::default(); RUNS];
    for (run, harmonics) in harmonics.iter_mut().enumerate() {
        match accumulated(run).harmonics() {
            Some(found) => *harmonics = found,
            None => return 1,
        }
    }
    let state = State { sums: Accumulator::new(), motion: Motion::default(), harmonics, found: None };
    // SAFETY: nothing else has been called yet.
    unsafe { *STATE.0.get() = Some(state) };
    timed(c"reference_at", references, SAMPLES);
    timed(c"feed_forward", feed_forwards, SAMPLES);
    timed(c"push_at", take_in_at, SAMPLES);
    timed(c"push", take_in, SAMPLES);
    let mut right = true;
    if of_model::DIRECT {
        timed(c"parameters_direct", identify_directly, SAMPLES);
        right &= check_all();
    }
    timed(c"parameters", identify, 1);
    let mut physical = [0.0; PHYSICAL.len()];
    with(|state| {
        if let Some(found) = state.found {
            physical = of_model::unlump(found);
        }
    });
    right &= check_all();
    for ((name, found), expected) in of_model::PHYSICAL_NAMES.iter().zip(physical).zip(PHYSICAL) {
        right &= check(name, found, expected);
    }
    i32::from(!right)
}
