//! A machine behind a process: a program that drives the hardware, or simulates it, and speaks [`PROTOCOL`] over its standard input
//! and output.
//!
//! ```text
//! Trial -> ProcessMachine -> lines of JSON -> program -> lines of JSON -> Record
//! ```

mod child;
mod command;
mod error;
mod group;
mod lines;
mod machine;
mod play;
mod protocol;
mod talk;
mod transcript;

pub use error::{MachineFault, MachineRunError};
pub use machine::{MachineStop, ProcessMachine, ProcessSettings, read_transcript};
pub use protocol::{FromMachine, PROTOCOL, Plays, Signal, ToMachine};
