//! The feedback of a run in sampled time.
//!
//! Invariant: with the measured error `e = q - q_r` of a coordinate and its rate, an input receives
//! `-(Kp e + Kd e')` from every path, formed at the sample times and held between them. A first-order low pass may
//! filter the error first (Feng, section 5.3),
//!
//! ```text
//! e[n] = a e[n-1] + (1 - a) (q[n] - q_r[n]) ,   a = e^{-T/tau} ,   F(z) = (1 - a) / (1 - a z^-1) ,
//! ```
//!
//! and the rate is then formed from the filtered error, unless a sensor measures it.

use crate::actuator::Dynamics;
use crate::feed_forward::HoldCompensation;
use crate::hold::held;
use crate::smoothing::Smoothing;
use num_complex::Complex;
use tpm_controller::control::{Differentiator, Gain};
use tpm_controller::harmonics::Hold;

/// Where the rate of the tracking error comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Velocity {
    /// A sensor measures the rate, without noise where the simulated rig states none.
    Measured,
    /// A filtered difference of the measured error, with this time constant of the filter, s.
    Filtered(f64),
    /// The slope of a polynomial fitted to the last measured errors, whose value is fed back in place of the newest error.
    Fitted(Smoothing),
}

impl Velocity {
    /// Time constant of the filter, s; nothing where there is none.
    #[must_use]
    pub const fn time_constant(self) -> Option<f64> {
        match self {
            Velocity::Measured | Velocity::Fitted(_) => None,
            Velocity::Filtered(time_constant) => Some(time_constant),
        }
    }

    /// The least-squares smoothing; nothing where there is none.
    #[must_use]
    pub const fn smoothing(self) -> Option<Smoothing> {
        match self {
            Velocity::Measured | Velocity::Filtered(_) => None,
            Velocity::Fitted(smoothing) => Some(smoothing),
        }
    }
}

/// Feedback in sampled time.
#[derive(Clone, Debug, PartialEq)]
pub struct Loop {
    /// Time between samples, s.
    pub sample_time: f64,
    /// The paths.
    pub gains: Vec<Gain<f64>>,
    /// Source of the rates.
    pub velocity: Velocity,
    /// Time constant of the low pass that the errors of positions pass first, s; zero for none.
    pub position_filter: f64,
    /// Compensation of the hold in the feed-forward.
    pub compensation: HoldCompensation,
    /// Known dynamics between command and force, by input; inputs beyond the last one have none.
    pub actuators: Vec<Dynamics>,
}

impl Loop {
    /// Time constant of the low pass of positions, s; nothing where there is none.
    #[must_use]
    pub fn low_pass_time(&self) -> Option<f64> {
        Some(self.position_filter).filter(|time_constant| *time_constant > 0.0)
    }

    /// The pole `a` of the low pass of positions; zero where there is none.
    #[must_use]
    pub fn position_pole(&self) -> f64 {
        if self.position_filter > 0.0 { (-self.sample_time / self.position_filter).exp() } else { 0.0 }
    }

    /// Frequency response of the feedback at `frequency` W (rad/s), from the phasor of a coordinate's measured error to
    /// an input's phasor with the sign reversed: `F(W) (Kp + Kd D(W))`. It includes the low pass of positions and the
    /// differentiator or the least-squares smoothing, but not the hold.
    #[must_use]
    pub fn response(&self, input: usize, coordinate: usize, frequency: f64) -> Complex<f64> {
        let pole = self.position_pole();
        let passed = (1.0 - pole) / (1.0 - Complex::from_polar(pole, -frequency * self.sample_time));
        let (value, rate) = match self.velocity {
            Velocity::Measured => (passed, Complex::new(0.0, frequency)),
            Velocity::Filtered(time_constant) => {
                let (re, im) =
                    Differentiator::new(self.sample_time, time_constant).response(frequency * self.sample_time);
                (passed, passed * Complex::new(re, im))
            }
            Velocity::Fitted(smoothing) => {
                let (value, rate) = smoothing.responses(frequency, self.sample_time);
                (passed * value, passed * rate)
            }
        };
        self.gains
            .iter()
            .filter(|gain| gain.input == input && gain.coordinate == coordinate)
            .map(|gain| rate * gain.derivative + value * gain.proportional)
            .sum()
    }

    /// The loop with all gains times a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        for gain in &mut scaled.gains {
            gain.proportional *= factor;
            gain.derivative *= factor;
        }
        scaled
    }

    /// Known dynamics of an input's actuator.
    #[must_use]
    pub fn actuator(&self, input: usize) -> Dynamics {
        self.actuators.get(input).copied().unwrap_or_default()
    }

    /// Response of hold and actuator at the frequency W (rad/s): the factor from an input's commanded phasor to that of
    /// its force.
    #[must_use]
    pub fn drive(&self, input: usize, frequency: f64, hold: Hold) -> Complex<f64> {
        held(hold, frequency * self.sample_time) * self.actuator(input).response(frequency)
    }
}
