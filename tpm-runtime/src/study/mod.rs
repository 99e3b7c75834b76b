//! Studies over many campaigns: bias, spread and coverage of repeated ones, convergence of the estimators, and experiment design.

#[cfg(test)]
mod bound_tests;
mod campaigns;
mod design;
mod updates;

pub use campaigns::{Identify, ParameterStudy, Study, study, study_campaigns, study_session};
pub use design::{Candidate, Design, Passed, Predicted, design};
pub use updates::{Convergence, LIMITS, Updates, convergence, updates};
