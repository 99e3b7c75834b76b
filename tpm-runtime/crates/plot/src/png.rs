//! Figures as PNG: the SVG in pixels, with a bundled font.

use crate::error::{PlotError, refused};
use crate::figure::Figure;
use resvg::{tiny_skia, usvg};
use std::sync::Arc;

/// The figure as a PNG file, `zoom` pixels per pixel of the SVG.
///
/// # Errors
/// [`PlotError`] as for [`Figure::svg`].
pub(crate) fn pixels(figure: &Figure, zoom: f32) -> Result<Vec<u8>, PlotError> {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    let options =
        usvg::Options { fontdb: Arc::new(fonts), font_family: "DejaVu Sans".into(), ..usvg::Options::default() };
    let tree = usvg::Tree::from_str(&figure.svg()?, &options).map_err(refused)?;
    let size = tree.size().to_int_size().scale_by(zoom);
    let mut pixels = size
        .and_then(|size| tiny_skia::Pixmap::new(size.width(), size.height()))
        .ok_or(PlotError::Size { width: figure.width, height: figure.height, panels: figure.panels.len() })?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(zoom, zoom), &mut pixels.as_mut());
    pixels.encode_png().map_err(refused)
}
