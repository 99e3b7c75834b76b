//! Output error: parameters and motion that explain every sample of a record together.
//!
//! The recorded inputs, with the noise that they may have, drive the model `Phi(q, q', ...) theta + known = B u`; its motion, with the
//! noise of the sensors, is what was recorded. Parameters theta and the states at every sample are estimated together by maximum
//! likelihood: multiple shooting with one sample per shot, whose Gauss-Newton steps are solved by orthogonal reflections
//! (Bierman 1977; Albersmeyer and Diehl 2010). Invariant: noise of the measured motion does not bias the parameters, because the
//! model is evaluated on the estimated motion; an input that is exact is one whose noise is found to be zero. `DESIGN.md` ("Why is output
//! error a refinement and not the estimator?") says what this gains.
//!
//! ```text
//! signals, problem (record, model), rates (which are readings) -> chain (linearised) -> smoother, solution (one step) -> tuning (noise) -> state (iteration)
//!   -> explanation (which terms are missing), residuals -> misfit (what is left) -> fit
//! state (given parameters) -> predictor (one step ahead) -> simulated (free run)
//! ```

mod candidates;
mod chain;
mod clipping;
mod error;
mod explanation;
mod fit;
#[cfg(test)]
mod fit_tests;
mod misfit;
mod noise;
mod predictor;
mod problem;
#[cfg(test)]
mod problem_tests;
mod rates;
mod reflect;
mod residuals;
mod signals;
mod simulated;
#[cfg(test)]
mod simulated_tests;
mod smoother;
#[cfg(test)]
mod smoother_tests;
mod solution;
mod state;
mod tuning;

pub use candidates::{Candidate, CandidateKind};
pub use error::OutputErrorFault;
pub use fit::OutputError;
pub use misfit::{Half, Misfit};
pub use problem::Differentiable;
pub(crate) use rates::compared;
pub use rates::{RateFault, RateUse};
pub(crate) use reflect::triangularise;
pub use signals::beside_counts;
pub use signals::reach_in;
pub use signals::{Course, Rate, Signals};
pub use simulated::{Divergence, Simulated};
