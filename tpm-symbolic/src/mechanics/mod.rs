//! Models of machines, the motions they are commanded to make, and the mechanics that leads from energies to equations.

pub mod constraint;
pub mod eliminate;
pub mod lagrange;
pub mod model;
pub mod pattern;
pub mod shape;
pub mod tree;
pub mod unit;
