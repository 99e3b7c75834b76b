//! Regressors under a pattern: their exact harmonic coefficients, and the parameters that these identify.

mod error;
pub mod expand;
mod gathered;
pub mod identifiability;
pub mod motion;
pub mod nonsmooth;
mod options;
mod sign;
mod stacked;
pub mod table;
mod tail;
