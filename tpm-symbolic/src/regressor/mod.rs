//! The regressor form `Phi(q, q', q'', ...) theta + known = B u` of a model, with the map between lumped and physical parameters.

pub mod form;
pub mod parameter_map;
pub mod prepare;
