//! Estimators: from harmonics to parameters with their uncertainty.
//!
//! Invariant: an estimator turns what was measured into `Equations`, complex rows linear in theta with the variance of their
//! noise. `Information` condenses them to a square-root form without squaring their condition; runs and logs are pooled
//! there, and solving gives rank first, then values. Nothing is estimated along a direction that the data do not show.
//!
//! What estimators share stands below them, and imports run one way, from right to left:
//!
//! ```text
//! settings, error <- verdict, result <- equations, information <- table, along <- bound, noise <- stack, damping, applies, consistency, projected <- estimators <- method
//! ```

mod agreement;
mod along;
mod applies;
mod bound;
mod combination;
mod consistency;
mod damping;
mod designs;
mod equations;
mod error;
mod estimator;
mod first_order;
mod free;
mod gauge;
mod information;
mod likelihood;
mod local;
mod measured_motion;
mod method;
pub mod named;
mod noise;
mod numerical;
mod output_error;
mod physical_remark;
mod pooled;
mod prior;
mod projected;
mod recorded;
mod response;
mod result;
#[cfg(test)]
mod rig_checks;
mod rows;
mod run;
mod sampled;
mod scale;
mod select;
mod sensor;
mod settings;
mod simulation;
mod stack;
mod table;
mod time_domain;
mod transition;
mod verdict;

pub use agreement::{CommonFactor, common_factor, pool_majority};
pub use along::Along;
pub use bound::{RecordNoise, has_jumps, information_root};
pub use combination::{Combination, Product};
pub use consistency::LeftOut;
pub use error::EstimateError;
pub use estimator::Estimator;
pub use first_order::feed_forward_lines;
pub use information::{Information, reduced};
pub use likelihood::{
    AddedTerm, Arranged, Arrangement, CalibrationFault, FittedDelay, Lacking, LineReport, Nearby, Nearest, OfAnyMotion,
    Term, TermKind, UnseenFault, best_arrangement, estimate_any_motion, gain_of_the_only_input,
};
pub use measured_motion::{
    ASKED_ABOUT, Fitted, MeasuredMotion, Structure, Untested, estimate_measured_motion, estimate_structured,
    refine_last,
};
pub use method::Method;
pub use named::{CombinationReport, ParameterReport, ProductReport, WrittenCombination};
pub use output_error::beside_counts;
pub use output_error::reach_in;
pub use output_error::{
    Candidate, CandidateKind, Course, Differentiable, Divergence, Half, Misfit, OutputError, OutputErrorFault, Rate,
    RateFault, RateUse, Signals, Simulated,
};
pub use physical_remark::PhysicalRemark;
pub use pooled::{Contribution, Pooled, pool};
pub use projected::{Known, Projector};
pub use recorded::{
    Channel, Followed, FollowedSensor, RecordedFault, RecordedFit, Sensed, SignalsAsRecorded, fit_recorded,
    follow_recorded,
};
pub use response::ErrorResponse;
pub use result::Estimate;
pub use run::error_lines;
pub use run::{Alone, OwnEstimate, Run};
pub use sampled::{Sampled, estimate_sampled, is_static};
pub use scale::Scale;
pub use sensor::Sensor;
pub use settings::{Domain, Frozen, NumericalSettings, Refine, Settings, Weights};
pub use simulation::{Asked, Evenly, Explained, Outcome, Question, Reading, Record, Simulation, Variant};
pub use table::{LineTable, RowLines};
pub use time_domain::Swiftness;
pub use time_domain::{
    ForceCourse, InputShift, Missed, OneBand, Pace, Prediction, Stretch, TimeRecord, input_shift, predict_in_band,
};
pub use verdict::no_result;
pub use verdict::{Evidence, LARGE_RESIDUAL, POOR_DEVIATION, POOR_PHYSICAL_DEVIATION, ResidualOf, Status};
