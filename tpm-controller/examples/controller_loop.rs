//! A controller's loop in fixed memory. A cart, `m q'' + d q' = u`, follows a reference that is at rest at both ends; the
//! fundamental harmonic of what was measured and applied gives the mass m and the friction d.
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use tpm_controller::control::{Differentiator, Feedback, Gain};
use tpm_controller::harmonics::{Accumulator, hold_factor};
use tpm_controller::{Label, least_squares};

fn main() -> Result<(), Box<dyn core::error::Error>> {
    let (period, step, lambda, guess) = (1000, 1e-3, 0.1, 1.0); // samples, s, m, kg
    let w = core::f64::consts::TAU / (period as f64 * step);
    let gains = [Gain { input: 0, coordinate: 0, proportional: 2000.0, derivative: 100.0 }];
    let mut differentiators = [Differentiator::new(step, 2.0 * step)];
    let mut feedback = Feedback::new(&gains, &mut differentiators);
    let mut memory = [0.0; Accumulator::<f64>::memory_len(2, 1)];
    let mut sums = Accumulator::new(period, 2, 1, &mut memory)?;
    let (mut q, mut rate) = (8.0 / 9.0 * lambda, 0.0);
    for n in 0..4 * period {
        let phase = w * step * n as f64;
        let reference = lambda * (phase.cos() - (3.0 * phase).cos() / 9.0);
        let acceleration = lambda * w * w * ((3.0 * phase).cos() - phase.cos());
        let mut input = [guess * acceleration]; // feed-forward, as far as the mass is known
        feedback.add(&[q - reference], None, &mut input)?;
        if n >= 3 * period {
            sums.push(&[q, input[0]])?; // by now the motion is periodic
        }
        for _ in 0..100 {
            rate += step / 100.0 * (input[0] - 5.0 * rate) / 2.0; // the machine: 2 kg, 5 N*s/m
            q += step / 100.0 * rate;
        }
    }
    let ((qc, qs), (uc, us)) = (sums.coefficients(0, 1)?, sums.coefficients(1, 1)?);
    let (re, im) = hold_factor(w * step); // the input was held between two samples
    let rows = [[-w * w * qc, w * qs], [-w * w * qs, -w * qc]];
    let found = least_squares(&rows, &[uc * re + us * im, us * re - uc * im], &["m", "d"].map(Label::bare))?;
    println!("m = {:.3} kg, d = {:.3} N*s/m", found[0], found[1]);
    Ok(())
}
