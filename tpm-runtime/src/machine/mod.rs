//! Machines: simulated ones, their motors, the stability of their loops, and regulators that keep them at rest.

pub mod actuator;
pub mod regulator;
pub mod simulated;
pub mod stability;
