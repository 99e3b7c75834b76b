//! The rest of the runtime's core on bare metal: accumulation of any harmonics, hold, feedback, forward dynamics.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;
use tpm_runtime::Model;
use tpm_runtime::control::{Differentiator, Feedback, Gain};
use tpm_runtime::harmonics::{Accumulator, hold_factor};

tpm_runtime::model_file!("../../models/mass_spring_drag.tpm");

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

/// The program's entry.
#[unsafe(no_mangle)]
pub extern "C" fn _start() -> ! {
    let mut memory = [0.0_f64; 128];
    if let Ok(mut bank) = Accumulator::new(black_box(100), 1, 9, &mut memory) {
        for i in 0..100 {
            black_box(bank.push(&[f64::from(black_box(i))]).is_ok());
        }
        black_box(bank.coefficients(0, 3).is_ok());
    }
    black_box(hold_factor(black_box(3e-3_f64)));
    let gains = [Gain { input: 0, coordinate: 0, proportional: 400.0_f32, derivative: 40.0 }];
    let mut filters = [Differentiator::new(1e-3, 2e-3)];
    let mut inputs = [0.0];
    black_box(Feedback::new(&gains, &mut filters).add(&[black_box(0.1)], None, &mut inputs).is_ok());
    let model: &dyn Model<f64> = black_box(&MassSpringDrag);
    let (mut motion, mut workspace) = ([0.1; 3], [0.0; 128]);
    black_box(model.forward_dynamics(&mut motion, &[1.0; 3], &[], &[1.0], &mut workspace).is_ok());
    loop {}
}
