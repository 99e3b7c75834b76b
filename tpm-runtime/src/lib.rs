//! Finds the parameters of a machine from its motion: from a log, on a simulated machine, or in a campaign on a real one.
//!
//! # Where to begin
//!
//! | you have | you call |
//! |---|---|
//! | a model file and a log | `session::from_log` (feature `interpret`) |
//! | a log of which little is known | `session::inspect`, `session::inspect_for` |
//! | an experiment with a simulated machine | `session::on_simulated_plant` |
//! | a machine that plays samples | `session::on_machine`, with your `motion::Bench` |
//! | a campaign that goes on by files | `session::CampaignFolder` |
//! | a controller without an operating system | `model!` (feature `macros`), and [`control`], [`filter`], [`harmonics`] |
//!
//! All but the second and the last give one `session::Identification`: parameters with standard deviations, physical parameters behind
//! lumped ones, what the data do not show, and warnings.
//!
//! # The problem
//!
//! A machine obeys `Phi(q, q', q'', ...) theta + known = B u` with unknown theta ([`mod@model`]). Along a periodic motion both
//! sides are Fourier series, and equating harmonics gives linear equations for theta, however non-linear the motion is
//! (D. Feng, chapters 2 to 4). Estimates come with their covariance, rank first: nothing is estimated along a direction that the data
//! do not show.
//!
//! Without the feature `std` the crate is `tpm-controller` and the macros: neither an operating system nor memory allocation.
#![no_std]

#[cfg(feature = "document")]
pub use tpm_document as document;
#[cfg(feature = "std")]
pub use {
    tpm_campaign as campaign, tpm_experiment as experiment, tpm_frequency as frequency, tpm_log as log,
    tpm_plant as plant, tpm_plot as plot, tpm_report as report,
};
#[cfg(feature = "interpret")]
pub use {
    tpm_inertia as inertia, tpm_interpret as interpret, tpm_physical as physical, tpm_session as session,
    tpm_study as study,
};

pub use tpm_controller::{
    Buffer, Dims, EvalError, Hyperbolic, Label, LeastSquares, Model, Presliding, Real, SolveError, control,
    derivatives, filter, harmonics, least_squares, linear, model, support, weighted_least_squares,
};
#[cfg(feature = "macros")]
pub use tpm_macros::{model, model_file};

// Of the parts below only what programs need is named: the rest has types of another crate in its signatures, whose versions would
// become this crate's own.

/// Estimates with their uncertainty, and the settings of estimators.
#[cfg(feature = "std")]
pub mod estimate {
    pub use tpm_estimate::{
        Along, CombinationReport, Domain, Estimate, EstimateError, ForceCourse, Frozen, InputShift, LARGE_RESIDUAL,
        LineTable, Method, NumericalSettings, OutputErrorFault, POOR_DEVIATION, POOR_PHYSICAL_DEVIATION,
        ParameterReport, PhysicalRemark, Refine, ResidualOf, RowLines, Settings, Status, Swiftness, Term, TermKind,
        Weights, named,
    };
}

/// One run of a machine: its reference motion, the control loop, and the record.
#[cfg(feature = "std")]
pub mod motion {
    pub use tpm_motion::{
        Bench, BenchError, Controller, Dynamics, Ending, GainManifest, HoldCompensation, Law, Loop, LowPass, Plant,
        PlantError, RUN_FILE, Rate, Record, RecordError, RunEnding, RunFile, Timing, Trial, TrialError, TrialSettings,
        Velocity, Window, forward, limits, profile, smoothing, stroke, trajectory,
    };
}

/// Matrices of results.
#[cfg(feature = "std")]
pub mod numerics {
    pub use tpm_numerics::{Matrix, patience};
}
