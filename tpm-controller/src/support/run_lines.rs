//! The lines of one run, sample by sample: harmonics of measured coordinates and inputs, and halfway between them noise.
//!
//! A run has an even number N of whole periods, at least four, under a window that rises over two periods and falls over two: a constant
//! over N - 2 periods, an even number, smoothed by half a wave of two. A periodic signal then vanishes halfway between its harmonics, so
//! that what is found there is the noise of the same run, and a motion that does not repeat leaves little at the ends of the run. Of four
//! periods it is the Hann window; of more it costs less, `(N - 2.5) N / (N - 2)^2` times the variance without a window instead of 1.5.
//! Line i of a channel has the angular frequency `i w / 2`: lines of even i are harmonics, those of odd i noise.
//!
//! Invariants: nothing allocates and no input makes it panic. A sample that cannot be used ends the run: its fault stays until the next
//! run begins, and no line is given.

use super::{Phasor, Real};
use core::fmt;

/// Why a run gives no lines, or no parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RunFault {
    /// The samples of a period do not resolve the lines, or do not fit 32 bits with all periods.
    Samples,
    /// The number of periods is odd, or less than four.
    Periods,
    /// A sample was left out or came twice: this one was expected.
    Missed {
        /// Its number, counted from 0 at the beginning of the run.
        sample: u32,
    },
    /// A reading or an input is not finite.
    NotFinite {
        /// The sample's number.
        sample: u32,
    },
    /// An input was at its limit, so that the machine did not get what was asked for.
    Saturated {
        /// The sample's number.
        sample: u32,
    },
    /// The run has not been played to its end.
    Unfinished {
        /// Samples so far.
        samples: u32,
    },
    /// The equations along the motion hold a number that is not finite.
    Equations,
    /// The measured coordinates stand still, or no equation stands out of the noise.
    Still,
    /// No physical parameters near the given ones agree with what the run shows.
    Apart,
    /// A changed parameter does not exist, its step is zero or not finite, or there is no run to compare it with.
    Perturbation,
}

impl fmt::Display for RunFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Samples => f.write_str(
                "a period has too few samples for the harmonics, or the run too many; change the sample time",
            ),
            Self::Periods => f.write_str("a run needs an even number of periods, at least four"),
            Self::Missed { sample } => {
                write!(f, "sample {sample} was expected and another one came; play the run again")
            }
            Self::NotFinite { sample } => write!(f, "sample {sample} is not finite; check sensors and inputs"),
            Self::Saturated { sample } => {
                write!(f, "an input was at its limit at sample {sample}; play a smaller or slower run")
            }
            Self::Unfinished { samples } => write!(f, "the run ended after {samples} samples; play it to its end"),
            Self::Equations => f.write_str("the equations are not finite along the measured motion"),
            Self::Perturbation => f.write_str(
                "a step of a parameter is zero or not finite, there is no such parameter, or no run to compare with; begin with a run",
            ),
            Self::Apart => f.write_str(
                "no physical parameters near the given ones agree with what the run shows; begin from others",
            ),
            Self::Still => f.write_str("nothing stands out of the noise; play a larger or faster run"),
        }
    }
}

impl core::error::Error for RunFault {}

/// How the samples were taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunSampling<T> {
    /// Time between samples, s.
    pub sample_time: T,
    /// Whether every input is held until the next sample.
    pub held: bool,
    /// Time from a recorded input to its force, s, beyond the hold.
    pub delay: T,
}

/// The lines of C channels, L each, while a run is played. L is even: harmonics 0 to `L/2 - 1` and the lines halfway behind each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunLines<T, const C: usize, const L: usize> {
    /// What ended the run, or nothing so far.
    pub(super) status: Result<(), RunFault>,
    pub(super) samples_per_period: u32,
    /// Samples of the whole run, and so far.
    pub(super) samples: u32,
    pub(super) count: u32,
    /// Samples of a part of the run: the root of all, with which rounding grows then.
    part_samples: u32,
    /// Sums over the present part, which join the total when it ends.
    part: [[Phasor<T>; L]; C],
    total: [[Phasor<T>; L]; C],
    /// What rounding has added to the total so far.
    excess: [[Phasor<T>; L]; C],
}

/// The angle of a part of a turn.
pub(super) fn angle<T: Real>(number: u32, of: u32) -> T {
    T::from_f64(2.0 * core::f64::consts::PI * f64::from(number) / f64::from(of))
}

impl<T: Real, const C: usize, const L: usize> RunLines<T, C, L> {
    /// Whether there can be a run of so many periods.
    ///
    /// # Errors
    /// [`RunFault::Samples`], [`RunFault::Periods`].
    pub fn check(samples_per_period: u32, periods: u32) -> Result<(), RunFault> {
        if periods < 4 || !periods.is_multiple_of(2) {
            return Err(RunFault::Periods);
        }
        // The highest line is below (L/2) w, which two samples of a period must resolve.
        if samples_per_period as usize <= L
            || samples_per_period.saturating_mul(periods) / periods != samples_per_period
        {
            return Err(RunFault::Samples);
        }
        Ok(())
    }

    /// Before the first sample of a run of whole periods.
    ///
    /// # Errors
    /// [`RunFault::Samples`], [`RunFault::Periods`].
    pub fn new(samples_per_period: u32, periods: u32) -> Result<Self, RunFault> {
        let zero = [[Phasor::zero(); L]; C];
        let mut this = Self {
            status: Ok(()),
            samples_per_period,
            samples: 0,
            count: 0,
            part_samples: 1,
            part: zero,
            total: zero,
            excess: zero,
        };
        this.begin(samples_per_period, periods)?;
        Ok(this)
    }

    /// Begins a run of whole periods.
    ///
    /// # Errors
    /// [`RunFault::Samples`], [`RunFault::Periods`].
    pub fn begin(&mut self, samples_per_period: u32, periods: u32) -> Result<(), RunFault> {
        self.samples_per_period = samples_per_period;
        self.samples = 0;
        self.count = 0;
        self.part_samples = 1;
        self.part = [[Phasor::zero(); L]; C];
        self.total = [[Phasor::zero(); L]; C];
        self.excess = [[Phasor::zero(); L]; C];
        self.status = Self::check(samples_per_period, periods);
        if self.status.is_ok() {
            self.samples = samples_per_period * periods;
            self.part_samples = self.samples.isqrt();
        }
        self.status
    }

    /// Takes in sample `number`, counted from 0, of every channel. Samples beyond the end of the run are not used.
    ///
    /// # Errors
    /// [`RunFault::Missed`], [`RunFault::NotFinite`]; every later sample gives the same fault.
    pub fn push(&mut self, number: u32, sample: &[T; C]) -> Result<(), RunFault> {
        if number != self.count {
            self.fail(RunFault::Missed { sample: self.count });
        }
        for channel in 0..C {
            if !sample[channel].is_finite() {
                self.fail(RunFault::NotFinite { sample: number });
            }
        }
        self.status?;
        if self.is_whole() {
            return Ok(());
        }
        let two_periods = self.samples_per_period.saturating_mul(2);
        let edge = number.min(self.samples - number);
        let mut weight = T::ONE;
        if edge < two_periods {
            let phase: T = angle(edge, two_periods.saturating_mul(2));
            weight = (T::ONE - phase.cos()) / T::from_f64(2.0);
        }
        let step = Phasor::turn(angle(number % two_periods, two_periods)).conj();
        for channel in 0..C {
            let mut turned = Phasor::new(sample[channel] * weight, T::ZERO);
            for line in 0..L {
                self.part[channel][line] += turned;
                turned = turned * step;
            }
        }
        self.count += 1;
        if self.count.is_multiple_of(self.part_samples) || self.is_whole() {
            self.join();
        }
        Ok(())
    }

    /// Adds the present part to the total by Kahan's summation: single precision keeps the noise of a line, which is far below the line
    /// itself.
    fn join(&mut self) {
        for channel in 0..C {
            for line in 0..L {
                let before = self.total[channel][line];
                let added = self.part[channel][line] - self.excess[channel][line];
                let after = before + added;
                self.total[channel][line] = after;
                self.excess[channel][line] = (after - before) - added;
                self.part[channel][line] = Phasor::zero();
            }
        }
    }

    /// Ends the run with a fault, unless it has one already.
    pub fn fail(&mut self, fault: RunFault) {
        if self.status.is_ok() {
            self.status = Err(fault);
        }
    }

    /// Samples so far.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Whether all samples of the run were taken in.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.count >= self.samples
    }

    /// Whether the run has ended as it should.
    ///
    /// # Errors
    /// The fault of the run, and [`RunFault::Unfinished`] before its last sample.
    pub fn finished(&self) -> Result<(), RunFault> {
        self.status?;
        if self.samples == 0 || self.count < self.samples {
            return Err(RunFault::Unfinished { samples: self.count });
        }
        Ok(())
    }

    /// Samples of the whole run.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Periods of the whole run without the two at its ends, where the window is not flat.
    fn flat_periods(&self) -> T {
        let flat = self.samples / self.samples_per_period - 2;
        T::from_f64(f64::from(flat))
    }

    /// The variance of white noise in the samples of a channel over that of its lines.
    #[must_use]
    pub fn samples_behind_line(&self) -> T {
        let flat = self.flat_periods();
        let period = T::from_f64(f64::from(self.samples_per_period));
        period * flat * flat / (T::from_f64(4.0) * (flat - T::from_f64(0.5)))
    }

    /// A line of a whole run as one-sided phasor `a_c - j a_s`, the mean at 0.
    #[must_use]
    pub fn line(&self, channel: usize, line: usize) -> Phasor<T> {
        let mean = T::ONE / (self.flat_periods() * T::from_f64(f64::from(self.samples_per_period)));
        let scale = if line == 0 { mean } else { mean + mean };
        self.total[channel][line].times(scale)
    }
}
