//! The paper that figures are drawn on: SVG, with the room that a text takes estimated here.
//!
//! Plotters asks a font for that room, and its fonts differ between targets: a page in a browser would ask the document, of which a worker
//! has none. So that figures are the same everywhere, the room follows from the size and the number of letters alone.

use plotters::prelude::{DrawingBackend, SVGBackend};
use plotters_backend::{BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind};

type Outcome = Result<(), DrawingErrorKind<std::io::Error>>;

/// Height of a capital letter, as a share of the size that Plotters is given.
const CAPITAL: f64 = 1.0 / (1.24 * 1.24);
/// Width of a letter, as a share of the height of a capital.
const LETTER: f64 = 0.7;
/// What hangs below the line, as a share of the height of a capital.
const BELOW: f64 = 0.24;

/// A figure's text in SVG while it is drawn.
pub(super) struct Paper<'a>(SVGBackend<'a>);

impl<'a> Paper<'a> {
    /// Paper of a width and a height in pixels, whose text is appended to `text`.
    pub(super) fn new(text: &'a mut String, size: (u32, u32)) -> Self {
        Paper(SVGBackend::with_string(text, size))
    }
}

impl DrawingBackend for Paper<'_> {
    type ErrorType = std::io::Error;

    fn get_size(&self) -> (u32, u32) {
        self.0.get_size()
    }

    fn ensure_prepared(&mut self) -> Outcome {
        self.0.ensure_prepared()
    }

    fn present(&mut self) -> Outcome {
        self.0.present()
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Outcome {
        self.0.draw_pixel(point, color)
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Outcome {
        self.0.draw_line(from, to, style)
    }

    fn draw_rect<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S, fill: bool) -> Outcome {
        self.0.draw_rect(from, to, style, fill)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, path: I, style: &S) -> Outcome {
        self.0.draw_path(path, style)
    }

    fn draw_circle<S: BackendStyle>(&mut self, at: BackendCoord, radius: u32, style: &S, fill: bool) -> Outcome {
        self.0.draw_circle(at, radius, style, fill)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, path: I, style: &S) -> Outcome {
        self.0.fill_polygon(path, style)
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Outcome {
        self.0.draw_text(text, style, at)
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<std::io::Error>> {
        let capital = style.size() * CAPITAL;
        let width = (capital * LETTER * text.chars().count() as f64).round();
        Ok((width as u32, ((capital * BELOW).round() + capital.round()) as u32))
    }
}
