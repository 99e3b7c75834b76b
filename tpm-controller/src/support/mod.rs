//! What every generated estimator needs beside `core` and the crate `libm`.
//!
//! Invariant: each file here takes what it needs from this module (`super`) and from nowhere else in the crate, and holds no
//! tests, so that its text may stand, unchanged, inside a generated file. What is computed is of the subset of Rust that is printed as C
//! (structures, arrays of fixed size, loops over ranges; no iterators, closures or options): `tpm-codegen` refuses anything else.
#![allow(
    clippy::needless_range_loop,
    reason = "an index of rows or columns reads as in the mathematics, and is below the array's length"
)]

mod accelerations;
mod campaign;
mod error;
mod hyperbolic;
mod label;
mod least_squares;
mod monitor;
mod phasor;
mod real;
mod run_estimate;
mod run_linearised;
mod run_lines;
mod run_means;
mod run_noise;
mod run_numerical;
mod run_physical;
#[cfg(test)]
mod run_tests;
mod run_weigh;
mod run_workspace;
mod square_root;
#[cfg(test)]
mod tests;

pub use accelerations::{SingularMass, accelerations, factors_hold};
pub use campaign::{
    CampaignEnd, CampaignOrder, CampaignPhase, CampaignReason, CampaignRules, CampaignState, Play, RunPool, passing,
};
pub use error::AccumulatorError;
pub use hyperbolic::Hyperbolic;
pub use label::Label;
pub use least_squares::{LeastSquares, SolveError, least_squares, weighted_least_squares};
pub use monitor::{MonitorFault, MonitorPhase, MonitorRules, MonitorState, Monitoring, Moved};
pub use phasor::Phasor;
pub use real::Real;
pub use run_estimate::RunEstimate;
pub use run_linearised::{RunLinearisation, RunReference};
pub use run_lines::{RunFault, RunLines, RunSampling};
pub use run_means::RunPassed;
pub use run_numerical::RunNumerical;
pub use run_physical::{RunIteration, RunLumping, RunPhysical};
pub use run_weigh::RunMeans;
pub use run_workspace::{RunModel, RunWorkspace};
pub use square_root::{SampleFault, Shown, Solution, SquareRoot};
