//! The five-step procedure (Feng, chapter 3): what to play, how it settled, what it taught, what comes next.
//!
//! ```text
//! Setup -> Campaign --next--> Trial -> (plant or machine) -> Record --submit--> Estimate, next Trial
//! ```

mod campaign;
mod completion;
mod record;
mod settle;
#[cfg(test)]
mod system_a;
mod trial;

pub use campaign::{
    Campaign, CampaignError, LEAST_PERIODS, NearMode, Outcome, Procedure, RunParameter, RunReport, Setup, Stage,
};
pub use completion::OpenReason;
pub use record::{Ending, Record, RunEnding};
pub use settle::settled_from;
pub use trial::{HoldCompensation, Loop, Trial, TrialError, TrialSettings, Velocity};
pub(crate) use trial::{correct_actuators, demand};
