//! Any motion in the time domain: what stands beside its lines.
//!
//! The noise and the frequencies of a record are found here; the shift of an input is looked for, the forces of given parameters are
//! predicted, and models that differ in a nonlinear parameter are compared in one band.
//!
//! The rows `Phi(q, q', ...) theta + known = B u` hold at every instant, and still hold after the same low pass F on both sides,
//! `F[Phi] theta + F[known] = F[B u]`, whatever the motion is: a chirp, a ramp, a hand that guides the machine. F has no phase and passes
//! the motion; above it there is noise alone. The filtered rows are band-limited: one sample per 1/(2 f_stop) is one independent equation.
//! `DESIGN.md` ("Why harmonics and not a filtered regression?") says why records that repeat are used otherwise.
//!
//! Invariants:
//! - Derivatives are those of the low-passed signals, so that a linear term is treated exactly as the input is.
//! - No equation needs what lies beyond the ends of a stretch: the low pass reaches so far, and not farther.
//! - Noise of the sensors in Phi would make parameters too small. The information that noise alone would give is measured, by the same low
//!   pass on noise of the same size, and subtracted. A direction with no more information than that is hidden.
//! - Deviations contain the correlation of the residuals in time.
//!
//! ```text
//! low_pass, transform -> motion (positions and rates, noise, highest frequency) -> equations (of one band) -> fit -> one_band; predict; shift
//! ```

pub(crate) mod band;
mod bands;
mod course;
mod equations;
mod fit;
pub(crate) mod low_pass;
pub(crate) mod motion;
mod one_band;
mod predict;
pub(crate) mod presliding;
mod shift;
#[cfg(test)]
mod tests;
pub(crate) mod transform;

pub use bands::Swiftness;
pub(crate) use bands::typical_period;
pub(crate) use equations::LEAST_ARGUMENT;
pub(crate) use fit::{MOST_NOISE_INFORMATION, WEIGHING_PASSES};
pub use motion::{Stretch, TimeRecord};
pub use one_band::OneBand;
pub use predict::{ForceCourse, Missed, Pace, Prediction, predict_in_band};
pub use shift::{InputShift, input_shift};
