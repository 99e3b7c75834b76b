//! Expressions: a graph of shared nodes in canonical form, its calculus and its trigonometric identities.

pub mod graph;
pub mod normal_form;
pub mod singularity;
pub mod trigonometric;
