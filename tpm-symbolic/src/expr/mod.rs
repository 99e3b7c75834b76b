//! Expressions: a graph of shared nodes in canonical form, its calculus and its trigonometric identities.

mod calculus;
mod display;
pub mod graph;
mod node;
pub mod normal_form;
mod polynomial;
pub mod singularity;
pub mod trigonometric;
mod value;
