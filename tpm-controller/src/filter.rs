//! Low pass of second order in sampled time, for the feed-forward of a controller (Feng, Figures 6.3 and 6.4).
//!
//! Invariant: the filter is the bilinear image of `1 / (s^2/w_n^2 + s/(Q w_n) + 1)` with the frequency axis warped so that both
//! agree at the natural frequency w_n,
//!
//! ```text
//! s = c (1 - z^-1)/(1 + z^-1) ,    c = w_n / tan(w_n T/2) ,
//! ```
//!
//! so that its gain at rest is 1 and it is stable for every Q > 0. A constant passes unchanged from a start in it. Nothing here
//! allocates.

use crate::support::Real;

/// A second-order low pass with its last two inputs and outputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondOrder<T> {
    /// Factor of the input and its two predecessors, which are also multiplied by 1, 2, 1.
    gain: T,
    /// Factors of the last two outputs.
    feedback: [T; 2],
    inputs: [T; 2],
    outputs: [T; 2],
}

impl<T: Real> SecondOrder<T> {
    /// A filter of natural frequency `w_n` (rad/s) and quality factor `quality` for samples every `sample_time` seconds, at rest
    /// in 0; `None` unless all three are positive and w_n is below half the sampling frequency, pi / sample_time.
    ///
    /// ```
    /// # use tpm_controller::filter::SecondOrder;
    /// assert!(SecondOrder::new(100.0, 0.7, 1e-3).is_some());
    /// assert!(SecondOrder::new(4000.0, 0.7, 1e-3).is_none());
    /// ```
    #[must_use]
    pub fn new(natural_frequency: T, quality: T, sample_time: T) -> Option<Self> {
        let half = natural_frequency * sample_time / T::from_f64(2.0);
        let usable = natural_frequency > T::ZERO && quality > T::ZERO && sample_time > T::ZERO;
        if !usable || half >= T::from_f64(core::f64::consts::FRAC_PI_2) {
            return None;
        }
        // All coefficients are divided by w_n^2, so that 1/tan(w_n T/2) replaces s / w_n.
        let warped = T::ONE / half.tan();
        let two = T::from_f64(2.0);
        let (square, damping) = (warped * warped, warped / quality);
        let below = square + damping + T::ONE;
        Some(SecondOrder {
            gain: T::ONE / below,
            feedback: [two * (T::ONE - square) / below, (square - damping + T::ONE) / below],
            inputs: [T::ZERO; 2],
            outputs: [T::ZERO; 2],
        })
    }

    /// Processes one sample and returns the filtered one.
    pub fn push(&mut self, input: T) -> T {
        let two = T::from_f64(2.0);
        let output = self.gain * (input + two * self.inputs[0] + self.inputs[1])
            - self.feedback[0] * self.outputs[0]
            - self.feedback[1] * self.outputs[1];
        self.inputs = [input, self.inputs[0]];
        self.outputs = [output, self.outputs[0]];
        output
    }

    /// Sets the filter to its steady state under the constant input `value`.
    ///
    /// ```
    /// # use tpm_controller::filter::SecondOrder;
    /// let mut filter = SecondOrder::new(100.0, 0.7, 1e-3).ok_or("beyond half the sampling frequency")?;
    /// filter.settle(2.0);
    /// assert!((filter.push(2.0) - 2.0_f64).abs() < 1e-12);
    /// # Ok::<(), &str>(())
    /// ```
    pub fn settle(&mut self, value: T) {
        self.inputs = [value; 2];
        self.outputs = [value; 2];
    }

    /// The response at `angle` = W T (rad per sample), real and imaginary part.
    ///
    /// ```
    /// # use tpm_controller::filter::SecondOrder;
    /// let filter = SecondOrder::new(100.0, 0.7, 1e-3).ok_or("beyond half the sampling frequency")?;
    /// let (gain, _) = filter.response(0.0);
    /// assert!((gain - 1.0_f64).abs() < 1e-12);
    /// # Ok::<(), &str>(())
    /// ```
    #[must_use]
    pub fn response(&self, angle: T) -> (T, T) {
        let two = T::from_f64(2.0);
        let (c1, s1) = (angle.cos(), angle.sin());
        let (c2, s2) = ((two * angle).cos(), (two * angle).sin());
        let above = (self.gain * (T::ONE + two * c1 + c2), -self.gain * (two * s1 + s2));
        let below =
            (T::ONE + self.feedback[0] * c1 + self.feedback[1] * c2, -(self.feedback[0] * s1 + self.feedback[1] * s2));
        let size = below.0 * below.0 + below.1 * below.1;
        ((above.0 * below.0 + above.1 * below.1) / size, (above.1 * below.0 - above.0 * below.1) / size)
    }
}

#[cfg(test)]
mod tests {
    use super::SecondOrder;

    #[test]
    fn it_is_the_continuous_filter_up_to_the_warping() {
        let (natural, quality, sample_time) = (100.0_f64, 1.0, 1e-3);
        let filter = SecondOrder::new(natural, quality, sample_time).expect("slow enough");
        for w in [1.0_f64, 30.0, 100.0, 250.0] {
            let (re, im) = filter.response(w * sample_time);
            let x = w / natural;
            let (a, b) = (1.0 - x * x, x / quality);
            let (expected_re, expected_im) = (a / (a * a + b * b), -b / (a * a + b * b));
            // Both agree at 100 rad/s; elsewhere the warping is w (w^2 - w_n^2) T^2/12.
            let bound = 1e-12 + 2.0 * (w * w - natural * natural).abs() * sample_time * sample_time / 12.0;
            assert!((re - expected_re).abs() < bound && (im - expected_im).abs() < bound, "{w}: {re} {im}");
        }
    }

    #[test]
    fn samples_have_the_response_and_a_constant_passes() {
        let mut filter = SecondOrder::new(100.0, 0.7, 1e-3).expect("slow enough");
        filter.settle(3.5);
        assert!((0..100).all(|_| (filter.push(3.5_f64) - 3.5).abs() < 1e-12));
        let angle = 0.2_f64;
        let (re, im) = filter.response(angle);
        filter.settle(0.0);
        for n in 0..2000 {
            let phase = angle * f64::from(n);
            let output = filter.push(phase.cos());
            assert!(n < 1000 || (output - (re * phase.cos() - im * phase.sin())).abs() < 1e-12);
        }
    }

    #[test]
    fn what_is_no_filter_is_refused() {
        for (natural, quality, sample_time) in
            [(0.0, 1.0, 1e-3), (100.0, -1.0, 1e-3), (4000.0, 1.0, 1e-3), (1.0, 1.0, f64::NAN)]
        {
            assert!(SecondOrder::new(natural, quality, sample_time).is_none(), "{natural} {quality} {sample_time}");
        }
        assert!(SecondOrder::<f32>::new(100.0, 1.0, 1e-3).is_some());
    }
}
