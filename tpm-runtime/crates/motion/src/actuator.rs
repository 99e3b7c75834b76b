//! The known dynamics between a commanded input and the force on the machine: a delay, the amplifier's low pass, the
//! current loop.
//!
//! ```text
//! G(s) = e^{-s d}  1/(s^2/w_n^2 + s/(Q w_n) + 1)  1/(s/w_b + 1)
//! ```
//!
//! Invariant: these dynamics are linear and pass a constant unchanged, so that a harmonic of the command becomes a harmonic of
//! the force by one complex factor, as it does behind a hold. A part that is not stated is left out (G = 1).

use crate::spectra::Spectra;
use num_complex::Complex;
use tpm_numerics::{DMatrix, DVector};

/// A second-order low pass of unit gain, 1 / (s^2/w_n^2 + s/(Q w_n) + 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LowPass {
    /// Undamped natural frequency w_n, rad/s.
    pub natural_frequency: f64,
    /// Quality factor Q.
    pub quality: f64,
}

impl LowPass {
    /// Time derivatives of the states (value, rate) under an input.
    #[must_use]
    pub fn rates(&self, input: f64, value: f64, rate: f64) -> (f64, f64) {
        let w = self.natural_frequency;
        (rate, w * w * (input - value) - w / self.quality * rate)
    }

    /// The frequency response at w (rad/s), real and imaginary part.
    #[must_use]
    pub fn response(&self, w: f64) -> (f64, f64) {
        let x = w / self.natural_frequency;
        let (re, im) = (1.0 - x * x, x / self.quality);
        let size = re * re + im * im;
        (re / size, -im / size)
    }
}

/// Delay and lags of one input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dynamics {
    /// Time by which the command lags, s.
    pub delay: f64,
    /// Low pass of second order.
    pub filter: Option<LowPass>,
    /// Bandwidth of the current loop, a lag of first order, rad/s.
    pub bandwidth: Option<f64>,
}

/// The lags without the delay in state space, `x' = A x + b u`. One of the states is the force.
#[derive(Clone, Debug, PartialEq)]
pub struct Lags {
    /// A, states times states.
    pub a: DMatrix<f64>,
    /// b, one entry per state.
    pub b: DVector<f64>,
    /// Index of the state that is the force.
    pub output: usize,
}

impl Dynamics {
    /// Whether the force is the command.
    #[must_use]
    pub fn is_ideal(&self) -> bool {
        *self == Self::default()
    }

    /// G(j w) at the frequency w (rad/s).
    #[must_use]
    pub fn response(&self, w: f64) -> Complex<f64> {
        let mut response = Complex::from_polar(1.0, -w * self.delay);
        if let Some(filter) = self.filter {
            let (re, im) = filter.response(w);
            response *= Complex::new(re, im);
        }
        if let Some(bandwidth) = self.bandwidth {
            response /= Complex::new(1.0, w / bandwidth);
        }
        response
    }

    /// Low pass and current loop in state space; nothing when neither is stated.
    #[must_use]
    pub fn lags(&self) -> Option<Lags> {
        let filtered = if self.filter.is_some() { 2 } else { 0 };
        let states = filtered + usize::from(self.bandwidth.is_some());
        if states == 0 {
            return None;
        }
        let (mut a, mut b) = (DMatrix::zeros(states, states), DVector::zeros(states));
        if let Some(LowPass { natural_frequency, quality }) = self.filter {
            a[(0, 1)] = 1.0;
            a[(1, 0)] = -natural_frequency * natural_frequency;
            a[(1, 1)] = -natural_frequency / quality;
            b[1] = natural_frequency * natural_frequency;
        }
        if let Some(bandwidth) = self.bandwidth {
            a[(filtered, filtered)] = -bandwidth;
            if filtered > 0 {
                a[(filtered, 0)] = bandwidth;
            } else {
                b[filtered] = bandwidth;
            }
        }
        Some(Lags { a, b, output: if self.bandwidth.is_some() { filtered } else { 0 } })
    }

    /// The delay as a number of whole samples and a remainder below one sample, s.
    #[must_use]
    pub fn samples(&self, sample_time: f64) -> (usize, f64) {
        let whole = (self.delay / sample_time).floor();
        let rest = self.delay - whole * sample_time;
        // Rounding of a delay that was stated in decimals: within a billionth of a sample it is a whole number of
        // samples.
        if sample_time - rest < 1e-9 * sample_time {
            (whole as usize + 1, 0.0)
        } else if rest < 1e-9 * sample_time {
            (whole as usize, 0.0)
        } else {
            (whole as usize, rest)
        }
    }
}

/// Multiplies the spectra of the recorded inputs (the channels behind the coordinates) by the known dynamics of their
/// actuators, so that they become spectra of forces, but for the hold.
pub fn correct_actuators(spectra: &mut Spectra, coordinates: usize, actuators: &[Dynamics]) {
    for (i, dynamics) in actuators.iter().enumerate().filter(|(_, dynamics)| !dynamics.is_ideal()) {
        spectra.pass(coordinates + i, |frequency| dynamics.response(frequency));
    }
}

#[cfg(test)]
mod tests {
    use super::Dynamics;
    use crate::LowPass;
    use num_complex::Complex;
    use tpm_numerics::DMatrix;

    #[test]
    fn states_and_response_agree() {
        let filter = Some(LowPass { natural_frequency: 120.0, quality: 0.8 });
        for (filter, bandwidth) in [(filter, Some(300.0)), (filter, None), (None, Some(300.0))] {
            let dynamics = Dynamics { delay: 0.004, filter, bandwidth };
            let lags = dynamics.lags().expect("lags");
            for w in [0.0, 7.0, 90.0, 800.0] {
                let states = lags.a.nrows();
                let resolvent = DMatrix::from_fn(states, states, |r, c| {
                    Complex::new(-lags.a[(r, c)], if r == c { w } else { 0.0 })
                });
                let x = resolvent.lu().solve(&lags.b.map(|b| Complex::new(b, 0.0))).expect("no pole on the axis");
                let expected = x[lags.output] * Complex::from_polar(1.0, -0.004 * w);
                assert!((dynamics.response(w) - expected).norm() < 1e-12, "{w}");
            }
        }
        assert!(Dynamics::default().is_ideal() && Dynamics::default().lags().is_none());
        assert_eq!(Dynamics::default().response(3.0), Complex::new(1.0, 0.0));
    }

    #[test]
    fn delays_are_whole_samples_and_a_rest() {
        let of = |delay: f64| Dynamics { delay, ..Dynamics::default() }.samples(1e-3);
        assert_eq!((of(0.0), of(3e-3), of(0.1 + 0.2)), ((0, 0.0), (3, 0.0), (300, 0.0)));
        let (whole, rest) = of(2.25e-3);
        assert!(whole == 2 && (rest - 0.25e-3).abs() < 1e-15);
    }
}
