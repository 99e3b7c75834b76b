//! The rows of one run linearised about its reference (estimators `error` and `hill`), in memory of fixed size.
//!
//! The rows are evaluated along the reference q_r, which has no noise, and what the tracking error `e = q - q_r` makes of them follows from
//! their derivatives J at the parameters theta' of the feed-forward:
//!
//! ```text
//! (B u)_k - known_k - (J(theta') e)_k = sum_p (Phi_p)_k theta_p - (J n)_k ,      k = 1, ..., H
//! ```
//!
//! `hill` takes J as the periodic function that it is, which couples harmonics; `error` takes its mean alone. Where estimates are the truth,
//! the error vanishes, and what J leaves out with it. What the linearisation leaves out at the present parameters is known, since the rows
//! can be evaluated along the measured motion as well: it counts as an error that all harmonics of a row have alike.
//!
//! Invariants: those of [`RunWorkspace`].
#![allow(
    clippy::needless_range_loop,
    reason = "an index of rows or columns reads as in the mathematics, and is below the array's length"
)]

use super::{Phasor, Real, RunFault, RunModel, RunWorkspace};

/// How much of the rows' derivatives is taken into account.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunLinearisation {
    /// Their means along the reference (estimator `error`).
    Error,
    /// The whole of them, which couples harmonics (estimator `hill`).
    Hill,
}

/// The reference of a run: the harmonics of one period of its samples. Its L lines are laid out as those of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunReference<T, const Q: usize, const L: usize> {
    samples_per_period: u32,
    count: u32,
    fault: Option<RunFault>,
    lines: [[Phasor<T>; L]; Q],
}

impl<T: Real, const Q: usize, const L: usize> RunReference<T, Q, L> {
    /// Before the first sample of a period.
    ///
    /// # Errors
    /// [`RunFault::Samples`] when they do not resolve the harmonics.
    pub fn new(samples_per_period: u32) -> Result<Self, RunFault> {
        if samples_per_period as usize <= L {
            return Err(RunFault::Samples);
        }
        Ok(Self { samples_per_period, count: 0, fault: None, lines: [[Phasor::ZERO; L]; Q] })
    }

    /// Takes in sample `number` of the reference, counted from 0 as the samples of the run are; samples behind the first period are not
    /// used. Says whether the period is whole.
    ///
    /// # Errors
    /// [`RunFault::Missed`], [`RunFault::NotFinite`]; every later sample gives the same fault.
    pub fn push(&mut self, number: u32, reference: &[T; Q]) -> Result<bool, RunFault> {
        if self.fault.is_none() && self.count < self.samples_per_period {
            if number != self.count {
                self.fault = Some(RunFault::Missed { sample: self.count });
            } else if !reference.iter().all(|value| value.is_finite()) {
                self.fault = Some(RunFault::NotFinite { sample: number });
            }
        }
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        if self.count >= self.samples_per_period {
            return Ok(true);
        }
        let turns = f64::from(number) / f64::from(self.samples_per_period);
        let step = Phasor::turn(T::from_f64(2.0 * core::f64::consts::PI * turns)).conj();
        let share = T::ONE / T::from_f64(f64::from(self.samples_per_period));
        for (&value, lines) in reference.iter().zip(&mut self.lines) {
            let mut turned = Phasor::new(value * share, T::ZERO);
            for (harmonic, line) in lines.iter_mut().step_by(2).enumerate() {
                *line += if harmonic == 0 { turned } else { turned + turned };
                turned = turned * step;
            }
        }
        self.count += 1;
        Ok(self.count == self.samples_per_period)
    }

    /// Its harmonics, in the places of even lines.
    ///
    /// # Errors
    /// The fault of the reference, [`RunFault::Unfinished`] before the end of its period, and [`RunFault::Samples`] when a run has
    /// another period.
    pub fn lines(&self, samples_per_period: u32) -> Result<&[[Phasor<T>; L]; Q], RunFault> {
        match self.fault {
            Some(fault) => Err(fault),
            None if samples_per_period != self.samples_per_period => Err(RunFault::Samples),
            None if self.count < self.samples_per_period => Err(RunFault::Unfinished { samples: self.count }),
            None => Ok(&self.lines),
        }
    }
}

impl<
    T: Real,
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> RunWorkspace<T, Q, R, P, S, L, E, K>
{
    /// Harmonics of what the tracking error makes of the rows, from their derivatives as they are now.
    pub(super) fn respond(&mut self, slots: &[(usize, u32); S], which: RunLinearisation, w: T) {
        let harmonics = L.div_ceil(2) as i32;
        self.response = [[Phasor::ZERO; L]; R];
        for row in 0..R {
            for harmonic in 0..harmonics {
                let mut sum = Phasor::ZERO;
                for coordinate in 0..Q {
                    for source in 1 - harmonics..harmonics {
                        if which == RunLinearisation::Error && source != harmonic {
                            continue;
                        }
                        let shift = harmonic - source;
                        let through = self.through(slots, row, coordinate, 2 * harmonic, shift, w);
                        let line = 2 * source.unsigned_abs() as usize;
                        let error = self.motion[coordinate][line] - self.path[coordinate][line];
                        // A mean stands for itself, any other phasor for itself and its conjugate.
                        let error = if source == 0 { error + error } else { error };
                        sum += through * if source < 0 { error.conj() } else { error };
                    }
                }
                let share = if harmonic == 0 { 0.5 } else { 1.0 };
                self.response[row][2 * harmonic as usize] = sum.times(T::from_f64(share));
            }
        }
    }

    /// Takes the response to the tracking error off what the rows leave along the reference; `weighed` says that the noise of the forces
    /// gets what this leaves out of the rows along the measured motion.
    pub(super) fn linearise<M: RunModel<T, U, R, P, S>, const U: usize>(
        &mut self,
        model: &M,
        inputs: &[[Phasor<T>; L]; U],
        theta: &[T; P],
        w: T,
        weighed: bool,
    ) {
        for (rest, response) in self.rest.iter_mut().flatten().zip(self.response.iter().flatten()) {
            *rest -= *response;
        }
        if !weighed {
            return;
        }
        let measured = Self::left(model, &self.motion, inputs, theta, w);
        for row in 0..R {
            let apart = self.rest[row].iter().zip(&measured[row]).step_by(2);
            let missed = apart.fold(T::ZERO, |most, (own, whole)| most.max((*own - *whole).square()));
            self.forces[row] += missed;
        }
    }
}
