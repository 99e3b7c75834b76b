//! Models of machines, their commanded motions, and the derivation of equations of motion from energies.

pub mod constraint;
pub mod derived;
pub mod eliminate;
pub mod lagrange;
pub mod model;
pub mod pattern;
pub mod shape;
pub mod tree;
pub mod unit;
