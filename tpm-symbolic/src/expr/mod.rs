//! Expressions: a graph of shared nodes in canonical form, its calculus and its trigonometric identities.

mod calculus;
mod display;
pub mod graph;
mod node;
mod nonzero;
pub mod normal_form;
pub mod point;
mod polynomial;
pub mod singularity;
pub mod size;
pub mod trigonometric;
mod value;
