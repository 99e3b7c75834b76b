//! From identified base parameters of an arm to inertias that bodies can have.
//!
//! A log shows base parameters: combinations of masses, first moments and moments of inertia of several links. [`inertias`] gives every
//! link a possible inertia such that the base parameters are as near to their estimates as their covariance tells them apart, and the rest
//! as near to a description as the data allow. [`payload`] gives the inertia of a load from two results, without and with it.

mod error;
mod evidence;
mod inertias;
mod load;
mod nearest;
#[cfg(test)]
mod nearest_tests;
mod pseudo_inertia;
mod reference;
mod request;
mod stage;
mod text;

pub use error::InertiaError;
pub use inertias::{Combination, Inertias, Origin, Parameter, inertias};
pub use load::{Load, LoadDirection, LoadParameter, LoadRequest, payload};
pub use request::InertiasRequest;
