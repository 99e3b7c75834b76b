//! The five-step procedure (Feng, chapter 3).

mod record;
mod trial;

pub use record::{Ending, Record};
pub use trial::{HoldCompensation, Loop, Trial, TrialError, TrialSettings, Velocity};
