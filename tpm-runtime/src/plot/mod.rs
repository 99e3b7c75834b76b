//! Figures: panels above each other with lines, points and bands, as SVG and PNG.
//!
//! Invariant: a figure is data until it is drawn; points that are not finite, or not positive on a logarithmic axis, break a
//! line and are otherwise left out. The SVG is drawn first and the PNG is that SVG in pixels, with a font that is part of
//! the program (DejaVu Sans), so that both look alike on every machine.

mod draw;
mod figure;
mod scale;

pub use draw::PlotError;
pub use figure::{Axis, Curve, Figure, Panel, Spacing, Trace};
