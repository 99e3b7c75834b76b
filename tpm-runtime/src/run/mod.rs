//! One run of a machine: the motion it follows, the loop that holds it there, what is recorded, and the harmonics of that.
//!
//! ```text
//! Trajectory, Loop -> Trial -> Bench -> Record -> Spectra
//! ```

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
mod hold;
pub(crate) mod limits;
pub mod profile;
mod record;
pub mod smoothing;
mod spectra;
pub mod stroke;
mod terms;
pub mod trajectory;
mod trial;

pub(crate) use actuator::correct_actuators;
pub use actuator::{Dynamics, LowPass};
pub use bench::{Bench, BenchError};
pub use completion::OpenReason;
pub(crate) use completion::{CompletionError, complete};
pub(crate) use controller::Controller;
pub(crate) use counts::{alike, mean_error, noise_within, repeating};
pub(crate) use driven::Driven;
pub(crate) use dry::{CREEP, Sides};
pub use error::TrialError;
pub use feed_forward::HoldCompensation;
pub(crate) use feed_forward::demand;
pub use feedback::{Loop, Velocity};
pub(crate) use hold::held;
pub use record::{Ending, Record, RecordError, RunEnding};
pub(crate) use spectra::step;
pub use spectra::{Spectra, SpectrumError, Window};
pub use terms::{GainManifest, Law, RUN_FILE, Rate, RunFile, Timing};
pub use trial::{Trial, TrialSettings};
