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

use super::run_lines::angle;
use super::run_workspace::{motion_at, turn_at};
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
    /// What ended the reference, or nothing so far.
    status: Result<(), RunFault>,
    samples_per_period: u32,
    count: u32,
    pub(super) lines: [[Phasor<T>; L]; Q],
}

impl<T: Real, const Q: usize, const L: usize> RunReference<T, Q, L> {
    /// Before the first sample of a period.
    ///
    /// # Errors
    /// [`RunFault::Samples`] when they do not resolve the harmonics.
    pub fn new(samples_per_period: u32) -> Result<Self, RunFault> {
        let lines = [[Phasor::zero(); L]; Q];
        let mut this = Self { status: Ok(()), samples_per_period, count: 0, lines };
        this.begin(samples_per_period)?;
        Ok(this)
    }

    /// Begins a period.
    ///
    /// # Errors
    /// [`RunFault::Samples`] when its samples do not resolve the harmonics.
    pub fn begin(&mut self, samples_per_period: u32) -> Result<(), RunFault> {
        self.status = Ok(());
        if samples_per_period as usize <= L {
            self.status = Err(RunFault::Samples);
        }
        self.samples_per_period = samples_per_period;
        self.count = 0;
        self.lines = [[Phasor::zero(); L]; Q];
        self.status
    }

    /// Takes in sample `number` of the reference, counted from 0 as the samples of the run are; samples behind the first period are not
    /// used.
    ///
    /// # Errors
    /// [`RunFault::Missed`], [`RunFault::NotFinite`]; every later sample gives the same fault.
    pub fn push(&mut self, number: u32, reference: &[T; Q]) -> Result<(), RunFault> {
        self.status?;
        if self.is_whole() {
            return Ok(());
        }
        if number != self.count {
            self.status = Err(RunFault::Missed { sample: self.count });
        }
        for coordinate in 0..Q {
            if self.status.is_ok() && !reference[coordinate].is_finite() {
                self.status = Err(RunFault::NotFinite { sample: number });
            }
        }
        self.status?;
        let step = Phasor::turn(angle(number, self.samples_per_period)).conj();
        let share = T::ONE / T::from_f64(f64::from(self.samples_per_period));
        for coordinate in 0..Q {
            let mut turned = Phasor::new(reference[coordinate] * share, T::ZERO);
            for harmonic in 0..L / 2 {
                self.lines[coordinate][2 * harmonic] += if harmonic == 0 { turned } else { turned + turned };
                turned = turned * step;
            }
        }
        self.count += 1;
        Ok(())
    }

    /// Whether the period is whole.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.count >= self.samples_per_period
    }

    /// Whether a run of so many samples in a period can be compared with it.
    ///
    /// # Errors
    /// The fault of the reference, [`RunFault::Unfinished`] before the end of its period, and [`RunFault::Samples`] when a run has
    /// another period.
    pub fn fits(&self, samples_per_period: u32) -> Result<(), RunFault> {
        self.status?;
        if samples_per_period != self.samples_per_period {
            return Err(RunFault::Samples);
        }
        if !self.is_whole() {
            return Err(RunFault::Unfinished { samples: self.count });
        }
        Ok(())
    }
}

impl<
    T: Real,
    const U: usize,
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> RunWorkspace<T, U, Q, R, P, S, L, E, K>
{
    /// Harmonics of what the tracking error makes of the rows, from their derivatives as they are now. A mean stands for itself, any other
    /// phasor for itself and its conjugate.
    pub(super) fn respond<M: RunModel<T, U, R, P, S>>(&mut self, model: &M, which: RunLinearisation) {
        let harmonics = L as i32 / 2;
        for row in 0..R {
            for harmonic in 0..harmonics {
                let mut sum = Phasor::zero();
                for coordinate in 0..Q {
                    for source in 1 - harmonics..harmonics {
                        if which == RunLinearisation::Error && source != harmonic {
                            continue;
                        }
                        let through = self.through(model, row, coordinate, 2 * harmonic, harmonic - source);
                        let distance = source.unsigned_abs();
                        let line = 2 * distance as usize;
                        let apart = self.motion[coordinate][line] - self.path[coordinate][line];
                        let error = if source == 0 { apart + apart } else { apart };
                        sum += through * if source < 0 { error.conj() } else { error };
                    }
                }
                let share = if harmonic == 0 { T::from_f64(0.5) } else { T::ONE };
                self.response[row][2 * harmonic as usize] = sum.times(share);
            }
        }
    }

    /// Takes the response to the tracking error off what the rows leave along the reference; `weighed` says that the noise of the forces
    /// gets what this leaves out of the rows along the measured motion.
    pub(super) fn linearise<M: RunModel<T, U, R, P, S>>(&mut self, model: &M, weighed: bool) {
        self.whole = [[Phasor::zero(); L]; R];
        for row in 0..R {
            for line in (0..L).step_by(2) {
                let response = self.response[row][line];
                self.rest[row][line] -= response;
            }
        }
        if !weighed {
            return;
        }
        for point in 0..M::POINTS {
            let turn = turn_at(model, point);
            let mut motion = [T::ZERO; S];
            motion_at(model, &self.motion, turn, self.w, &mut motion);
            self.add_rest(model, &motion, turn, true);
        }
        for row in 0..R {
            let mut missed = T::ZERO;
            for line in (0..L).step_by(2) {
                missed = missed.max((self.rest[row][line] - self.whole[row][line]).square());
            }
            self.forces[row] += missed;
        }
    }
}
