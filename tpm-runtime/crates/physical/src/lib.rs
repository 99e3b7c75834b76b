//! What an exact model is to an estimator.
//!
//! A model file declares physical parameters p, a regressor form has columns whose factors c(p) may be products of them, and a machine
//! plays patterns whose coefficients are rational numbers. This crate is where the two meet: tables of the exact algebra along a
//! reference ([`PatternTables`]), physical parameters behind lumped ones ([`physical`]), models with eliminated
//! coordinates ([`Eliminated`]), experiments written in physical parameters ([`lumped`]), machines with motors on their inputs
//! ([`MotorizedMachine`]), and linearised responses with exact matrices ([`LinearizedResponse`]).

mod eliminated;
mod linearized;
mod lumped;
mod motorized;
mod physical;
mod regulator;
mod tabulated;

pub use eliminated::{Eliminated, EliminatedError};
pub use linearized::{LinearizedError, LinearizedResponse};
pub use lumped::lumped;
pub use motorized::{MotorizedMachine, MotorizedMachineError};
pub use physical::{
    Physical, PhysicalError, PhysicalFit, PhysicalSettings, has_inertia, is_lumped, negative_inertias, physical,
};
pub use regulator::linear_regulator;
pub use tabulated::PatternTables;
