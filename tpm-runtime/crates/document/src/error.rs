//! Why a page cannot be made.

use tpm_plot::PlotError;

/// Why a page cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DocumentError {
    /// A figure cannot be drawn.
    #[error("figure `{name}` of the report: {source}")]
    Figure {
        /// Name of the figure.
        name: String,
        /// The reason.
        source: PlotError,
    },
    /// The template was refused.
    #[error("the report cannot be written: {reason}")]
    Template {
        /// Reason of the template engine.
        reason: String,
    },
}
