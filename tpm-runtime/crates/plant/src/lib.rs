//! Machines: simulated ones, those behind a process, their motors, the stability of their loops, and regulators that keep them at rest.

pub mod actuator;
pub mod process;
pub mod regulator;
pub mod simulated;
pub mod stability;
