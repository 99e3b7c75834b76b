//! One run of a machine: the motion it follows, the loop that holds it there, what is recorded, and the harmonics of that.
//!
//! ```text
//! Trajectory, Loop -> Trial -> Bench -> Record -> Spectra
//! ```

mod actuator;
mod bench;
mod completion;
mod hold;
mod record;
pub mod smoothing;
mod spectra;
pub mod trajectory;
mod trial;

pub use actuator::{Dynamics, Lags, LowPass};
pub use bench::{Bench, BenchError};
pub use completion::OpenReason;
pub(crate) use hold::held;
pub use record::{Ending, Record, RecordError, RunEnding};
pub use spectra::{Spectra, SpectrumError, Window};
pub use trial::{HoldCompensation, Loop, Trial, TrialError, TrialSettings, Velocity};
pub(crate) use trial::{correct_actuators, demand};
