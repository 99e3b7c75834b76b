//! Figures to files, as SVG or PNG by the name of the file.

use crate::failure::Failure;
use crate::output::file;
use std::path::Path;
use tpm_runtime::plot::{DRAWS_PNG, Figure};

/// Pixels of a PNG per pixel of the figure.
const ZOOM: f32 = 2.0;

/// Endings of the pictures of a report: PNG stands beside SVG where the program draws it.
pub(crate) const KINDS: &[&str] = if DRAWS_PNG { &["svg", "png"] } else { &["svg"] };

/// The kind of picture that a file's name asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Picture {
    Svg,
    Png,
}

impl Picture {
    /// Refuses a name that ends in neither .svg nor .png.
    pub(crate) fn of(path: &Path) -> Result<Self, Failure> {
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(Failure::Input(format!("--plot {}: the name must end in .svg or .png", path.display()))),
        }
    }
}

/// Draws a figure into a file.
pub(crate) fn draw(path: &Path, figure: &Figure) -> Result<(), Failure> {
    file::write_file(path, &bytes(path, figure)?)
}

/// What a file with this name holds of a figure.
pub(crate) fn bytes(path: &Path, figure: &Figure) -> Result<Vec<u8>, Failure> {
    let drawn = match Picture::of(path)? {
        Picture::Png => figure.png(ZOOM),
        Picture::Svg => figure.svg().map(String::into_bytes),
    };
    drawn.map_err(|error| Failure::Input(format!("{}: {error}", path.display())))
}
