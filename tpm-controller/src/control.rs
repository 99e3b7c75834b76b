//! Feedback in sampled time: `C(e) = -Kp e - Kd e'` on the tracking error `e = q - q_r`, added to a feed-forward.
//!
//! Invariant: positive gains push against the error (Feng's G2 = -Kp, G1 = -Kd). The rate of the error is either measured
//! or formed from the error itself by a filtered difference with the pole `a = e^{-T/tau}`,
//!
//! ```text
//! v[n] = a v[n-1] + (1 - a) (e[n] - e[n-1]) / T ,    D(z) = (1 - a) (1 - z^-1) / (T (1 - a z^-1)),
//! ```
//!
//! whose exact frequency response the estimators use. Nothing here allocates.

use crate::model::{Buffer, EvalError, require_len};
use crate::support::Real;

/// One path of the feedback: from the error of a coordinate to an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain<T> {
    /// Index of the input that is driven.
    pub input: usize,
    /// Index of the coordinate whose error is fed back.
    pub coordinate: usize,
    /// Kp, unit of the input per unit of the coordinate.
    pub proportional: T,
    /// Kd, unit of the input per unit of the coordinate, times seconds.
    pub derivative: T,
}

/// A filtered difference of one signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Differentiator<T> {
    pole: T,
    sample_time: T,
    last: Option<T>,
    rate: T,
}

impl<T: Real> Differentiator<T> {
    /// A filter for samples every `sample_time` seconds with the given time constant (s); zero gives the plain difference.
    ///
    /// ```
    /// # use tpm_controller::control::*;
    /// assert_eq!(Differentiator::new(1e-3, 0.0).pole(), 0.0);
    /// ```
    #[must_use]
    pub fn new(sample_time: T, time_constant: T) -> Self {
        let pole = if time_constant > T::ZERO { (-sample_time / time_constant).exp() } else { T::ZERO };
        Differentiator { pole, sample_time, last: None, rate: T::ZERO }
    }

    /// Processes one sample and returns the rate; the rate of the first sample is zero.
    ///
    /// ```
    /// # use tpm_controller::control::*;
    /// let mut rate = Differentiator::new(0.5, 0.0);
    /// assert_eq!((rate.push(1.0), rate.push(2.0)), (0.0, 2.0));
    /// ```
    pub fn push(&mut self, value: T) -> T {
        let difference = self.last.map_or(T::ZERO, |last| value - last);
        self.last = Some(value);
        self.rate = self.pole * self.rate + (T::ONE - self.pole) * difference / self.sample_time;
        self.rate
    }

    /// The pole `a` of the filter.
    #[must_use]
    pub const fn pole(&self) -> T {
        self.pole
    }

    /// Resets the filter to the state before its first sample.
    ///
    /// ```
    /// # use tpm_controller::control::*;
    /// let mut rate = Differentiator::new(0.5, 0.0);
    /// rate.push(1.0);
    /// rate.reset();
    /// assert_eq!(rate.push(2.0), 0.0);
    /// ```
    pub fn reset(&mut self) {
        self.last = None;
        self.rate = T::ZERO;
    }

    /// D(e^{j angle}) as (real, imaginary) part, with `angle` = W T.
    ///
    /// ```
    /// # use tpm_controller::control::*;
    /// // A difference over T seconds is near the derivative j W at low frequencies W.
    /// let (_, imaginary) = Differentiator::new(1.0, 0.0).response(1e-3);
    /// assert!((imaginary / 1e-3 - 1.0_f64).abs() < 1e-6);
    /// ```
    #[must_use]
    pub fn response(&self, angle: T) -> (T, T) {
        // 1 - cos cancels at small angles, 2 sin^2(angle/2) does not.
        let half = (angle / T::from_f64(2.0)).sin();
        let (sin, drop) = (angle.sin(), T::from_f64(2.0) * half * half);
        let scale = (T::ONE - self.pole) / self.sample_time;
        let (above_re, above_im) = (scale * drop, scale * sin);
        let (below_re, below_im) = (T::ONE - self.pole + self.pole * drop, self.pole * sin);
        let size = below_re * below_re + below_im * below_im;
        ((above_re * below_re + above_im * below_im) / size, (above_im * below_re - above_re * below_im) / size)
    }
}

/// The feedback of all coordinates, in memory of the caller.
#[derive(Debug)]
pub struct Feedback<'m, T> {
    gains: &'m [Gain<T>],
    filters: &'m mut [Differentiator<T>],
}

impl<'m, T: Real> Feedback<'m, T> {
    /// Feedback with one differentiator per coordinate, or with none when the rates are measured.
    #[must_use]
    pub fn new(gains: &'m [Gain<T>], filters: &'m mut [Differentiator<T>]) -> Self {
        Feedback { gains, filters }
    }

    /// Adds C(e) to `inputs`. `rates` are the measured rates of the errors; without them the differentiators form them.
    ///
    /// ```
    /// # use tpm_controller::control::*;
    /// let gains = [Gain { input: 0, coordinate: 0, proportional: 4.0, derivative: 1.0 }];
    /// let mut input = [10.0];
    /// Feedback::new(&gains, &mut []).add(&[0.5], Some(&[1.0]), &mut input)?;
    /// assert_eq!(input, [7.0]);
    /// # Ok::<(), tpm_controller::EvalError>(())
    /// ```
    ///
    /// # Errors
    /// [`EvalError::Length`] when `rates`, or the differentiators, are not as many as the errors, or a gain names a coordinate or
    /// an input that is not there.
    pub fn add(&mut self, errors: &[T], rates: Option<&[T]>, inputs: &mut [T]) -> Result<(), EvalError> {
        match rates {
            Some(rates) => require_len(Buffer::Motion, rates.len(), errors.len())?,
            None => {
                require_len(Buffer::Workspace, self.filters.len(), errors.len())?;
                for (filter, &error) in self.filters.iter_mut().zip(errors) {
                    filter.push(error);
                }
            }
        }
        for gain in self.gains {
            let lacking = |buffer, index: usize, given| EvalError::Length { buffer, needed: index + 1, given };
            let given = inputs.len();
            let error = *errors.get(gain.coordinate).ok_or(lacking(Buffer::Motion, gain.coordinate, errors.len()))?;
            let input = inputs.get_mut(gain.input).ok_or(lacking(Buffer::Inputs, gain.input, given))?;
            let rate = match rates {
                Some(rates) => rates[gain.coordinate],
                None => self.filters[gain.coordinate].rate,
            };
            *input -= gain.proportional * error + gain.derivative * rate;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{Buffer, Differentiator, EvalError, Feedback, Gain};

    #[test]
    fn the_response_is_that_of_the_filter() {
        let (sample_time, w) = (1e-3_f64, 40.0_f64);
        for time_constant in [0.0, 2e-3, 1.0] {
            let mut filter = Differentiator::new(sample_time, time_constant);
            let (re, im) = filter.response(w * sample_time);
            for n in 0..20_000 {
                let phase = w * sample_time * f64::from(n);
                let rate = filter.push(phase.cos());
                let expected = re * phase.cos() - im * phase.sin();
                if n > 15_000 {
                    // The slowest filter still carries e^{-15} of its start.
                    assert!((rate - expected).abs() < 1e-4 * w, "{time_constant}: {rate} {expected}");
                }
            }
            if time_constant < 0.1 {
                let phase = w * sample_time * 20_000.0;
                let expected = re * phase.cos() - im * phase.sin();
                assert!((filter.push(phase.cos()) - expected).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn feedback_pushes_back() {
        let gains = [Gain { input: 0, coordinate: 0, proportional: 2000.0, derivative: 120.0 }];
        let mut input = [1.0];
        Feedback::new(&gains, &mut []).add(&[1e-3], Some(&[0.1]), &mut input).expect("one of each");
        assert!((input[0] - (1.0 - 2.0 - 12.0_f64)).abs() < 1e-12);
        assert!(Feedback::new(&gains, &mut []).add(&[1e-3], None, &mut input).is_err());
        let mut filters = [Differentiator::new(0.5, 0.0)];
        let mut feedback = Feedback::new(&gains, &mut filters);
        feedback.add(&[0.0], None, &mut input).expect("one of each");
        input[0] = 0.0;
        feedback.add(&[0.1], None, &mut input).expect("one of each");
        assert!((input[0] + 200.0 + 24.0).abs() < 1e-12);
    }

    #[test]
    fn a_gain_of_what_is_not_there_is_named() {
        let gain = Gain { input: 0, coordinate: 0, proportional: 1.0, derivative: 0.0 };
        let add = |gain, inputs: &mut [f64]| Feedback::new(&[gain], &mut []).add(&[1e-3], Some(&[0.1]), inputs);
        let lacking = |buffer, needed, given| Err(EvalError::Length { buffer, needed, given });
        assert_eq!(add(Gain { coordinate: 2, ..gain }, &mut [0.0]), lacking(Buffer::Motion, 3, 1));
        assert_eq!(add(Gain { input: 1, ..gain }, &mut [0.0]), lacking(Buffer::Inputs, 2, 1));
    }
}
