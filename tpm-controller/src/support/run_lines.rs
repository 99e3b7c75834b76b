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
    /// A changed parameter does not exist, its step is zero or not finite, or there is no run to compare it with.
    Perturbation,
    /// No physical parameters near the given ones agree with what the run shows.
    Apart,
    /// The measured coordinates stand still, or no equation stands out of the noise.
    Still,
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

/// The lines of C channels, L each, while a run is played. L is even: harmonics 0 to `L/2 - 1` and the lines halfway behind each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunLines<T, const C: usize, const L: usize> {
    samples_per_period: u32,
    samples: u32,
    count: u32,
    fault: Option<RunFault>,
    /// Samples of a part of the run: the root of all, with which rounding grows then.
    part_samples: u32,
    /// Sums over the present part, which join the total when it ends.
    part: [[Phasor<T>; L]; C],
    total: [[Phasor<T>; L]; C],
    /// What rounding has added to the total so far.
    excess: [[Phasor<T>; L]; C],
}

impl<T: Real, const C: usize, const L: usize> RunLines<T, C, L> {
    /// Samples of a run of so many periods, where there can be one.
    ///
    /// # Errors
    /// [`RunFault::Samples`], [`RunFault::Periods`].
    pub fn check(samples_per_period: u32, periods: u32) -> Result<u32, RunFault> {
        if periods < 4 || !periods.is_multiple_of(2) {
            return Err(RunFault::Periods);
        }
        // The highest line is below (L/2) w, which two samples of a period must resolve.
        let enough = samples_per_period as usize > L;
        samples_per_period.checked_mul(periods).filter(|_| enough).ok_or(RunFault::Samples)
    }

    /// Before the first sample of a run of whole periods.
    ///
    /// # Errors
    /// [`RunFault::Samples`], [`RunFault::Periods`].
    pub fn new(samples_per_period: u32, periods: u32) -> Result<Self, RunFault> {
        let samples = Self::check(samples_per_period, periods)?;
        let (part_samples, zero) = (samples.isqrt(), [[Phasor::ZERO; L]; C]);
        Ok(Self {
            samples_per_period,
            samples,
            count: 0,
            fault: None,
            part_samples,
            part: zero,
            total: zero,
            excess: zero,
        })
    }

    /// Takes in sample `number`, counted from 0, of every channel. Samples beyond the end of the run are not used.
    ///
    /// # Errors
    /// [`RunFault::Missed`], [`RunFault::NotFinite`]; every later sample gives the same fault.
    pub fn push(&mut self, number: u32, sample: &[T; C]) -> Result<(), RunFault> {
        if self.fault.is_none() && number != self.count {
            self.fail(RunFault::Missed { sample: self.count });
        }
        if self.fault.is_none() && !sample.iter().all(|value| value.is_finite()) {
            self.fail(RunFault::NotFinite { sample: number });
        }
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        if self.is_whole() {
            return Ok(());
        }
        let two_periods = self.samples_per_period.saturating_mul(2);
        let share = |number: u32, of: u32| T::from_f64(2.0 * core::f64::consts::PI * f64::from(number) / f64::from(of));
        let edge = number.min(self.samples - number);
        let weight = match edge < two_periods {
            true => (T::ONE - share(edge, two_periods.saturating_mul(2)).cos()) / T::from_f64(2.0),
            false => T::ONE,
        };
        let step = Phasor::turn(share(number % two_periods, two_periods)).conj();
        for (&value, sums) in sample.iter().zip(&mut self.part) {
            let mut turned = Phasor::new(value * weight, T::ZERO);
            for sum in sums {
                *sum += turned;
                turned = turned * step;
            }
        }
        self.count += 1;
        if self.count.is_multiple_of(self.part_samples) || self.is_whole() {
            let sums = self.total.iter_mut().flatten().zip(self.excess.iter_mut().flatten());
            for ((total, excess), part) in sums.zip(self.part.iter_mut().flatten()) {
                // Kahan: single precision keeps the noise of a line, which is far below the line itself.
                let (before, added) = (*total, *part - *excess);
                *total += added;
                *excess = (*total - before) - added;
                *part = Phasor::ZERO;
            }
        }
        Ok(())
    }

    /// Ends the run with a fault that was noticed elsewhere, unless it has one already.
    pub fn fail(&mut self, fault: RunFault) {
        self.fault.get_or_insert(fault);
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

    /// Samples of the whole run.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Samples of a period.
    #[must_use]
    pub fn samples_per_period(&self) -> u32 {
        self.samples_per_period
    }

    /// Periods of the whole run.
    fn periods(&self) -> f64 {
        f64::from(self.samples) / f64::from(self.samples_per_period)
    }

    /// The variance of white noise in the samples of a channel over that of its lines.
    #[must_use]
    pub fn samples_behind_line(&self) -> T {
        let flat = self.periods() - 2.0;
        T::from_f64(f64::from(self.samples_per_period) * flat * flat / (4.0 * (flat - 0.5)))
    }

    /// The lines as one-sided phasors `a_c - j a_s`, the mean at 0.
    ///
    /// # Errors
    /// The fault of the run, and [`RunFault::Unfinished`] before its last sample.
    pub fn lines(&self) -> Result<[[Phasor<T>; L]; C], RunFault> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        if !self.is_whole() {
            return Err(RunFault::Unfinished { samples: self.count });
        }
        let mean = T::ONE / T::from_f64((self.periods() - 2.0) * f64::from(self.samples_per_period));
        let mut lines = self.total;
        for channel in &mut lines {
            for (index, line) in channel.iter_mut().enumerate() {
                *line = line.times(if index == 0 { mean } else { mean + mean });
            }
        }
        Ok(lines)
    }
}
