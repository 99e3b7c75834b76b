//! One run of a machine: its reference motion, the control loop, the record, and the harmonics of the record.
//!
//! ```text
//! Trajectory, Loop -> Trial -> Bench -> Record -> Spectra
//! ```

mod acting;
mod actuator;
mod bench;
mod completion;
mod controller;
mod counts;
mod driven;
mod dry;
mod error;
mod feed_forward;
mod feedback;
pub mod forward;
mod friction;
mod hold;
pub mod limits;
pub mod profile;
mod record;
pub mod smoothing;
mod spectra;
pub mod stroke;
mod terms;
pub mod trajectory;
mod trial;

pub use actuator::correct_actuators;
pub use actuator::{Dynamics, LowPass};
pub use bench::{Bench, BenchError};
pub use completion::OpenReason;
pub use completion::{CompletionError, complete};
pub use controller::Controller;
pub use counts::{equal_rounding_runs, mean_error, noise_variance, repeating_variance};
pub use driven::Driven;
pub use dry::{CREEP, FrictionJump};
pub use error::TrialError;
pub use feed_forward::HoldCompensation;
pub use feed_forward::demand;
pub use feedback::{Loop, Velocity};
pub use forward::{Plant, PlantError};
pub use hold::held;
pub use record::{Ending, Record, RecordError, RunEnding};
pub use spectra::{Spectra, SpectrumError, Window};
pub use terms::{GainManifest, Law, RUN_FILE, Rate, RunFile, Timing};
pub use trial::{Trial, TrialSettings};
