//! Studies over many campaigns: bias, spread and coverage of repeated ones, convergence of the estimators, experiment design, and
//! what patterns show of models without an exact table.

#[cfg(test)]
mod bound_tests;
mod campaigns;
mod design;
mod identifiability;
mod updates;

pub use campaigns::{Identify, ParameterStudy, Study, study, study_campaigns, study_session};
pub use design::{Candidate, Design, Passed, Predicted, design};
pub use identifiability::{NumericalError, PlayedPattern, numerical_identifiability};
pub use updates::{Convergence, LIMITS, Updates, convergence, updates};
