//! Robot descriptions as models.
//!
//! [`urdf`] reads a URDF and writes a model with a mechanism, a prior and an experiment beside it. Decimals are taken as the
//! rational numbers that they are. An angle within 1e-4 of a multiple of pi/2 is that multiple, and every other angle a becomes the
//! angle with the rational tangent of a/2 within 1e-15, so that the geometry is rational throughout; every such reading is reported.

mod arrange;
mod description;
mod reading;
mod write;

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::source::{Source, Span};
use tpm_symbolic::mechanics::tree::mechanism::Loss;

/// How the angles and lengths of a description are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Angles {
    /// Right angles and zeros are recognised where rounding hides them.
    #[default]
    Recognised,
    /// Every number is what it is written as.
    Written,
}

/// What of a description becomes a model.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The link that stands still; the root where not given. What is not outward of it is left out.
    pub base: Option<String>,
    /// The last link of the chain that is taken; where not given, everything is.
    pub tip: Option<String>,
    /// Joints that are held, with their positions (rad or m) as they are written.
    pub locked: Vec<(String, String)>,
    /// How angles and lengths are read.
    pub angles: Angles,
    /// The unknown torques of every drive; where not given, viscous and Coulomb friction of the joints for which the description
    /// has a value that is not zero.
    pub losses: Option<Vec<Loss>>,
}

/// A description as a model.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The text of the model.
    pub model: String,
    /// Values of its parameters by name, from the masses, inertias and frictions of the description (TOML).
    pub prior: String,
    /// An experiment with the limits of the joints (TOML), to be completed.
    pub experiment: String,
    /// What was read as something else than what is written, one sentence each.
    pub readings: Vec<String>,
    /// What is left out or doubtful, each at its place.
    pub warnings: Vec<Diagnostic>,
}

/// Reads a URDF.
///
/// # Errors
/// Every fault at its place: the text is no XML or no robot, a number cannot be read, links and joints are no tree, an axis is zero,
/// a joint is of a kind that has no model, or an option names what is not there.
pub fn urdf(source: &Source, options: &Options) -> Result<Imported, Diagnostics> {
    let mut diagnostics = Diagnostics::new();
    if source.fault().is_some() {
        let fault = Diagnostic::error(Span::default(), "this is no text, or it is longer than 4 GiB");
        diagnostics.push(fault.help("a description is a text in UTF-8"));
        return Err(diagnostics);
    }
    let mut readings = reading::Readings::new(source, options.angles);
    let Some(description) = description::read(source, &mut readings, &mut diagnostics) else { return Err(diagnostics) };
    let arranged = arrange::arrange(description, options, &mut readings, &mut diagnostics);
    let Some(robot) = arranged.filter(|_| !diagnostics.has_errors()) else {
        diagnostics.sort();
        return Err(diagnostics);
    };
    let mut warnings = diagnostics.take_warnings();
    warnings.sort_by_key(|warning| warning.span);
    let (model, prior, experiment) = write::write(&robot, options, source.name())?;
    Ok(Imported { model, prior, experiment, readings: readings.sentences(), warnings })
}
