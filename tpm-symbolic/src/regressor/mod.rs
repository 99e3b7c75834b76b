//! The regressor form `Phi(q, q', q'', ...) theta + known = B u` of a model, with the map between lumped and physical parameters.

pub mod base_parameters;
mod collect;
mod entries;
pub mod form;
mod gather;
pub mod homogeneous;
pub mod inverse;
mod inversion;
mod lattice;
mod lump;
pub mod parameter_map;
pub mod prepare;
pub mod solved;
mod traces;
