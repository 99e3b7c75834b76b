//! The reading of a description, from its text to the bodies of a mechanism.

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::arrange::{Robot, arrange};
use crate::import::description::Description;
use crate::import::elements::{Reader, span};
use crate::import::markup;
use crate::import::mujoco;
use crate::import::options::Options;
use crate::import::reading::Readings;
use crate::import::urdf;
use crate::import::xml::with_prefixes;
use crate::source::{Source, Span};
use roxmltree::Document;

/// A description as it was read.
pub(super) struct Read {
    pub(super) robot: Robot,
    pub(super) warnings: Vec<Diagnostic>,
    /// One sentence for every number that was read as another.
    pub(super) readings: Vec<String>,
}

pub(super) fn read(source: &Source, options: &Options) -> Result<Read, Diagnostics> {
    let mut diagnostics = Diagnostics::new();
    if source.fault().is_some() {
        let fault = Diagnostic::error(Span::default(), "this is no text, or it is longer than 4 GiB");
        diagnostics.push(fault.help("a description is a text in UTF-8"));
        return Err(diagnostics);
    }
    let mut readings = Readings::new(source, options.angles);
    let Some(description) = described(source, options, &mut readings, &mut diagnostics) else {
        return Err(diagnostics);
    };
    let arranged = arrange(description, options, &mut readings, &mut diagnostics);
    let Some(robot) = arranged.filter(|_| !diagnostics.has_errors()) else {
        diagnostics.sort();
        return Err(diagnostics);
    };
    let mut warnings = diagnostics.take_warnings();
    warnings.sort_by_key(|warning| warning.span);
    Ok(Read { robot, warnings, readings: readings.sentences() })
}

/// Links and joints of the text; faults go to `diagnostics`, and `None` is returned where there is no robot.
fn described(
    source: &Source,
    options: &Options,
    readings: &mut Readings<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Description> {
    let (text, prefixes) = match well_formed(source) {
        Ok(mended) => mended,
        Err(fault) => {
            diagnostics.push(fault);
            return None;
        }
    };
    // `well_formed` has parsed this text: it is well formed.
    let document = Document::parse(&text).ok()?;
    let root = document.root_element();
    if !prefixes.is_empty() {
        let message =
            format!("the prefixes {} are not declared; what begins with one is left out", prefixes.join(", "));
        diagnostics.push(Diagnostic::warning(span(root), message).help("a model of the dynamics has no use for it"));
    }
    let mut reader = Reader::new(readings, diagnostics);
    let description = match root.tag_name().name() {
        "robot" => urdf::read(root, &mut reader),
        "mujoco" => mujoco::read(root, options, &mut reader),
        other => {
            let message = format!("`{other}` is no robot description");
            reader.error(span(root), message, "a URDF has the root element `robot`, a model for MuJoCo `mujoco`");
            return None;
        }
    };
    reader.report_left_out();
    Some(description)
}

/// A text as XML that can be parsed, with the prefixes that it does not declare; a fault where it is none.
pub(super) fn well_formed(source: &Source) -> Result<(String, Vec<String>), Diagnostic> {
    let text = source.text();
    if let Some((place, most)) = markup::excess(text) {
        let fault = Diagnostic::error(place, format!("there are more than {most} attributes or namespaces here"));
        return Err(fault.help("a description needs far fewer: export it again"));
    }
    with_prefixes(text).map_err(|error| {
        let line = error.pos();
        let start = text.lines().take((line.row.max(1) - 1) as usize).map(|line| line.len() + 1).sum::<usize>();
        let start = (start + line.col.max(1) as usize - 1).min(text.len()) as u32;
        let fault = Diagnostic::error(Span::new(start, start), format!("this is no XML: {error}"));
        fault.help("export the description again; a xacro file is expanded first, `xacro robot.urdf.xacro`")
    })
}
