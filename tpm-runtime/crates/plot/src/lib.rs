//! Figures: panels above each other with lines, points and bands, as SVG and PNG.
//!
//! Invariant: a figure is data until it is drawn; points that are not finite, or not positive on a logarithmic axis, break a
//! line and are otherwise left out. The SVG is drawn first and the PNG is that SVG in pixels, with a font that is part of
//! the program (DejaVu Sans), so that both look alike on every machine (`DESIGN.md`, "Why is PNG behind a feature?").

#[cfg(feature = "svg")]
mod draw;
#[cfg(feature = "svg")]
mod error;
mod figure;
#[cfg(feature = "svg")]
mod paper;
#[cfg(feature = "png")]
mod png;
#[cfg(feature = "svg")]
mod scale;

#[cfg(feature = "svg")]
pub use error::PlotError;
/// Whether figures are drawn as PNG too: with the feature `png`.
pub const DRAWS_PNG: bool = cfg!(feature = "png");

pub use figure::{Axis, Curve, Figure, Panel, Spacing, Trace};
