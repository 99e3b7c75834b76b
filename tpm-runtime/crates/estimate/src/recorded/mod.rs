//! Output error as an entry: parameters and initial states from readings at their own times, without a regression before it.
//!
//! The model `Phi(q, q', ...) theta + known = B u` is integrated between the actual stamps under inputs that are held, or interpolated,
//! between stamps of their own, and is compared with the readings of those sensors that there are, each at its own times. Coordinates that
//! no sensor reads are simulated with the others; their initial values are unknowns. Invariant: nothing is resampled, and no derivative
//! of a reading is taken.
//!
//! A start is not needed: many starts of the size that the record and the rows suggest are raced over whole stretches, coarsely simulated. Where
//! none is followed so far, or nothing else tells that the best of them is right, starts are tried over short blocks, each with a state of
//! its own at its beginning (multiple shooting), where the sum of squares has few other minima; the best are settled by Levenberg and
//! Marquardt's steps, and blocks then grow until they are whole stretches. Deviations are those of least squares whose errors have
//! the colour that is left (the covariance between two readings of a sensor is that of an autoregression through its residuals).
//!
//! ```text
//! signals (channels, blocks) -> flow (one block simulated) -> steps (Levenberg, Marquardt) -> starts, work (colour: deviations) -> whole, fit
//!                                                                                                     -> follow (given parameters)
//! ```

mod colour;
mod fit;
mod flow;
mod follow;
mod signals;
mod starts;
mod steps;
mod whole;
mod work;

pub use fit::fit_recorded;
pub use follow::{Followed, FollowedSensor, follow_recorded};
pub use signals::{Channel, Sensed, SignalsAsRecorded};
pub use work::{RecordedFault, RecordedFit};
