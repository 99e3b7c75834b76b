//! Frequency responses of logs, and fits to them, as answers that are displayed and serialised.

mod fit;
mod fitted_model;
mod fitted_rational;
mod measured;
mod table;

pub use fit::{FitRequest, ResponseFit, ResponseFitError};
pub use fitted_model::{ModelResponse, StartedParameter};
pub use measured::{MeasuredResponse, ResponseFault, SegmentSettings};
pub use table::ResponseTable;
