//! Measured motion: inverse dynamics in the frequency domain.
//!
//! Invariant: the regressors are evaluated on the measured motion itself, with spectral derivatives over whole periods, and
//! their harmonics are equated with those of the applied input. Nothing is linearised about a reference, so that one run
//! without noise gives the parameters exactly, for any term (sin, sgn, products).
//!
//! Noise of the measured motion enters the regressors. It is followed to first order through the time-varying Jacobian of
//! the rows along the motion, which gives each harmonic equation its variance, and the bias it would leave in the normal
//! equations (errors in variables) is subtracted. `DESIGN.md` compares this estimator with the others ("Why five estimators, and why is
//! `measured-motion` the default?").

mod coupled;
mod fit;
mod model_error;
mod path;
mod pooled;
mod record;
mod records;
mod refine;
mod reliability;
mod repeats;
mod sampling;
mod variance;

pub use fit::estimate_measured_motion;
pub use fit::{Fitted, Structure, estimate_structured};
pub(super) use pooled::PooledMotion;
pub use record::MeasuredMotion;
pub use refine::refine_last;
pub use reliability::{ASKED_ABOUT, Untested};
