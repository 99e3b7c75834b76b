//! Holds of inputs, as factors on phasors.

use num_complex::Complex;
use tpm_controller::harmonics::Hold;

/// The factor by which a hold multiplies the phasor of a harmonic at the angle `W T` (rad).
pub fn held(hold: Hold, angle: f64) -> Complex<f64> {
    let (re, im) = hold.factor(angle);
    Complex::new(re, im)
}
