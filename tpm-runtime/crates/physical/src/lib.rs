//! Exact models for numerical estimators.
//!
//! A model file declares physical parameters p. A regressor form has columns whose parameters c(p) may be products of
//! them. A machine plays patterns whose coefficients are rational numbers. This crate evaluates the exact forms
//! numerically: tables of the exact algebra along a reference ([`PatternTables`]), physical parameters from lumped ones
//! ([`physical`]), models with eliminated coordinates ([`Eliminated`]), experiments written in physical parameters
//! ([`lumped`]), machines with motors on their inputs ([`MotorizedMachine`]), and linearised responses with exact
//! matrices ([`LinearizedResponse`]).

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
    Physical, PhysicalError, PhysicalFit, PhysicalSettings, gives_energy, has_inertia, is_lumped, negative_inertias,
    physical, takes_energy,
};
pub use regulator::linear_regulator;
pub use tabulated::PatternTables;
