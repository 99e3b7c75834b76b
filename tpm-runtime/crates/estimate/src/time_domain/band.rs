//! The band of frequencies in which a record is compared with a model: a low one leaves out what the machine does at high frequencies,
//! a high one takes noise in.

use crate::time_domain::equations::Equations;
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::motion::{Motion, Moving};
use std::f64::consts::PI;
use tpm_numerics::spectrum::Spectrum;
use tpm_numerics::whole;

/// Cut-off in units of the highest frequency at which a motion is followed.
const CUT_OFF: f64 = 2.2;
/// Largest cut-off, as a share of the sampling frequency.
const LARGEST_CUT_OFF: f64 = 0.125;
/// Largest share of a stretch that a low pass may take from its ends.
const MOST_LOST: f64 = 0.5;
/// Samples in one oscillation at the cut-off, times this, are those over which polynomials follow the motion on either side.
const POLYNOMIAL_REACH: f64 = 0.45;

/// Samples on either side of a sample over which a polynomial follows a motion below a cut-off, Hz.
pub(crate) fn reach(cut_off: f64, sample_time: f64) -> usize {
    whole::below(POLYNOMIAL_REACH / (cut_off * sample_time))
}

/// The cut-off for a motion, rad/s; nothing where all stretches are too short.
pub(super) fn cut_off(motion: &Motion, sample_time: f64) -> Option<f64> {
    let longest = motion.stretches.iter().map(|stretch| stretch.samples).max().unwrap_or(0) as f64 * sample_time;
    // A low pass reaches the farther the lower it is, so that a short stretch needs a high one.
    let lowest = 2.0 * Equations::lost(LowPass { cut_off: 1.0 }) / (MOST_LOST * longest);
    let largest = LARGEST_CUT_OFF * 2.0 * PI / sample_time;
    (lowest <= largest).then(|| (2.0 * PI * CUT_OFF * followed(motion, sample_time)).clamp(lowest, largest))
}

/// Highest frequency at which any of the coordinates is followed, Hz. The noise is read from the spectrum itself above the motion, so that
/// readings that repeat and digits that are cut off, whatever their spectrum, are not taken for motion.
fn followed(motion: &Motion, sample_time: f64) -> f64 {
    let of = |c: usize| {
        let signal = |stretch: &Moving| {
            let mut all = stretch.coordinates[c].derivative(stretch.points, 0, |_| 1.0);
            all.truncate(stretch.samples);
            all
        };
        let signals: Vec<Vec<f64>> = motion.stretches.iter().map(signal).collect();
        let signals: Vec<&[f64]> = signals.iter().map(Vec::as_slice).collect();
        Spectrum::of(&signals, sample_time).followed
    };
    motion.moving.iter().map(|&c| of(c)).fold(0.0, f64::max)
}
