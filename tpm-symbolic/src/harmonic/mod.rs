//! Regressors under a pattern: their exact harmonic coefficients, and the parameters that these identify.

pub mod bessel;
pub mod content;
mod error;
pub mod expand;
mod gathered;
pub mod identifiability;
pub mod motion;
pub mod nonsmooth;
mod options;
pub mod report;
mod sign;
mod stacked;
pub mod table;
mod tail;
