//! Many campaigns: what repeated ones say of bias, spread and coverage, how fast estimators converge, which experiment shows most.

mod campaigns;
mod design;
mod updates;

pub use campaigns::{Identify, ParameterStudy, Study, study, study_campaigns, study_session};
pub use design::{Candidate, Design, Passed, Predicted, design};
pub use updates::{Convergence, LIMITS, Updates, convergence, updates};
