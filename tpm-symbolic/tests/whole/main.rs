//! The algebra on the equations of papers, on random models, and against naive twins.

mod appendix_a;
mod base_parameters;
mod chain;
mod common;
mod derivatives;
mod elimination;
mod exactness;
mod expansion;
mod identifiability;
mod mechanics;
mod naive;
mod nonsmooth;
mod series;
mod tree;
