//! Studies over many campaigns: bias, spread and coverage of repeated ones, convergence of the estimators, experiment design,
//! what patterns show of models without an exact table, patterns beside the usual laws of a stroke, patterns fitted to paths,
//! and parameters of one model in those of another; linear models, regulators, motors and frequency responses as answers.
//!
//! An answer is one type: its display is the text, its serialisation the JSON.

#[cfg(test)]
mod bound_tests;
mod by_name;
mod campaigns;
mod content;
mod design;
mod excitation;
mod fitted_pattern;
mod identifiability;
mod kept;
mod linear;
mod motors;
mod observed;
mod path;
mod projection;
mod report;
mod response;
mod series;
mod shown;
mod split;
mod tally;
mod trajectories;
mod trajectories_figure;
mod updates;

pub use campaigns::{Identify, Study, study, study_campaigns, study_session};
pub use design::{Candidate, Design, Passed, Predicted, design};
pub use excitation::{
    Criterion, Excitation, ExcitationError, ExcitationSettings, Files as ExcitationFiles,
    FilesError as ExcitationFilesError, HARMONICS, Proposed, STARTS, Used, excitation,
};
pub use fitted_pattern::{FittedPattern, SampledPath};
pub use identifiability::{NumericalError, PlayedPattern, numerical_identifiability};
pub use kept::study_kept;
pub use linear::{AtRest, Band, Linearised, LinearisedError, Regulated, mode_in_words};
pub use motors::{Actuators, FeedForwardError, FeedForwards, MovedMachine};
pub use observed::{Observed, observed};
pub use path::{FittedCoordinate, FittedPath, PathError, PathSettings, fit_path};
pub use projection::{
    ComparedMotion, Consistency, InputMisfit, MisfitHarmonic, MotionReport, Projection, ProjectionError,
    ProjectionRequest, Way, fitting_experiment, projection,
};
pub use report::{Means, Report, ReportedBase, ReportedParameter, ReportedRow, ShowingHarmonic};
pub use response::{
    FitRequest, MeasuredResponse, ModelResponse, ResponseFault, ResponseFit, ResponseFitError, ResponseTable,
    SegmentSettings, StartedParameter,
};
pub use series::{NoSeries, Wave};
pub use shown::{AnyMotion, AskedPattern, Base, Shown, ShownError, any_motion, shown};
pub use split::{InputParts, NumericPart, numeric_parts};
pub use tally::ParameterStudy;
pub use trajectories::{CoordinateUse, InputUse, Moved, StrokeError, Trajectories, trajectories};
pub use updates::{Convergence, LIMITS, Updates, convergence, updates};
