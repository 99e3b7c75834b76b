//! Faults of drawing.

/// Why a figure cannot be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// An axis has no two different values.
    #[error("panel {panel} of the figure has no {axis} values that can be drawn on its axis")]
    Empty {
        /// Panel, from 1.
        panel: usize,
        /// x or y.
        axis: &'static str,
    },
    /// The figure has no panel or no area.
    #[error("a figure of {width} x {height} pixels with {panels} panels cannot be drawn")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Number of panels.
        panels: usize,
    },
    /// The program was built without PNG.
    #[error("this program was built without PNG: write an .svg, or build it with the feature `png`")]
    NoPng,
    /// The drawing library refused.
    #[error("the figure cannot be drawn: {reason}")]
    Drawing {
        /// Reason of the drawing library.
        reason: String,
    },
}

pub(crate) fn refused(error: impl ToString) -> PlotError {
    PlotError::Drawing { reason: error.to_string() }
}
