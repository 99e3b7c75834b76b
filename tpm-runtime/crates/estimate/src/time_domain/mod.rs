//! Estimates from any motion, in the time domain.
//!
//! The rows `Phi(q, q', ...) theta + known = B u` hold at every instant, and still hold after the same low pass F on both sides,
//! `F[Phi] theta + F[known] = F[B u]`, whatever the motion is: a chirp, a ramp, a hand that guides the machine. F has no phase, leaves
//! the motion as it is and takes what lies above it, where there is noise alone. What a low pass leaves is told by fewer samples, each
//! an equation of its own.
//!
//! Invariants:
//! - Derivatives are those of the low-passed signals, so that a linear term is treated exactly as the input is.
//! - No equation needs what lies beyond the ends of a stretch: the low pass reaches so far, and not farther.
//! - The noise of the sensors in Phi would make parameters too small; the information that noise alone would give is measured, by the
//!   same low pass on noise of the same size, and taken off. A direction that shows no more than that is hidden.
//! - Residuals are correlated in time; deviations count that.
//!
//! ```text
//! low_pass, transform -> motion (positions and rates, noise, highest frequency) -> equations (of one band) -> fit -> band (which one); predict; shift
//! ```

mod band;
mod bands;
mod equations;
mod fit;
mod low_pass;
mod motion;
mod one_band;
mod predict;
mod shift;
#[cfg(test)]
mod tests;
mod transform;

pub use band::{BandReport, TimeDomain, estimate_time_domain};
pub use bands::Swiftness;
pub(crate) use bands::typical_period;
pub use motion::{Stretch, TimeRecord};
pub use one_band::OneBand;
pub use predict::{ForceCourse, Missed, Pace, Prediction, predict_in_band};
pub use shift::{InputShift, input_shift};
