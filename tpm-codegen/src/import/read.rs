//! The reading of a description, from its text to the bodies of a mechanism.

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::arrange::{Robot, arrange};
use crate::import::description;
use crate::import::options::Options;
use crate::import::reading::Readings;
use crate::source::{Source, Span};

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
    let Some(description) = description::read(source, &mut readings, &mut diagnostics) else { return Err(diagnostics) };
    let arranged = arrange(description, options, &mut readings, &mut diagnostics);
    let Some(robot) = arranged.filter(|_| !diagnostics.has_errors()) else {
        diagnostics.sort();
        return Err(diagnostics);
    };
    let mut warnings = diagnostics.take_warnings();
    warnings.sort_by_key(|warning| warning.span);
    Ok(Read { robot, warnings, readings: readings.sentences() })
}
