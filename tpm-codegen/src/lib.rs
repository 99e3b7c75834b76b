//! The model language and the writers of the Trajectory Pattern Method tools.

pub mod emit;
