//! Import of robot descriptions as models.
//!
//! [`import_description`] reads a URDF, or a model for MuJoCo (MJCF), and writes a model with a mechanism, a prior and an experiment beside it. Decimals are taken as the
//! rational numbers that they are. An angle within 1e-4 of a multiple of pi/2 is that multiple, and every other angle a becomes the
//! angle with the rational tangent of a/2 within 1e-15, so that the geometry is rational throughout; every such reading is reported.

mod arrange;
mod described;
mod description;
mod elements;
mod experiment;
mod felt;
mod frame;
mod include;
mod markup;
mod mjcf;
mod mujoco;
mod options;
mod pattern;
mod read;
mod reading;
mod replace;
mod split;
mod stribeck;
mod urdf;
mod write;
mod xml;

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::read::{Read, read};
use crate::source::Source;

pub use described::{Described, DescribedBody, JointLosses};
pub use include::with_included;
pub use mjcf::mjcf;
pub use mujoco::losses::{WithLosses, with_losses};
pub use options::{Angles, Options, STRIBECK};
pub use replace::with_inertials;
pub use split::{Parted, SplitError, decimal};

/// An imported description.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The text of the model.
    pub model: String,
    /// Values of its parameters by name, from the masses, inertias and frictions of the description (TOML).
    pub prior: String,
    /// An experiment with the limits of the joints on a simulated machine with the inertias of the description (TOML).
    pub experiment: String,
    /// One sentence for every number that was read as a value other than the written one, and one for all elements that a model has no use
    /// for.
    pub readings: Vec<String>,
    /// Parts that were left out or are doubtful, each at its place.
    pub warnings: Vec<Diagnostic>,
}

/// Reads a URDF or a model for MuJoCo (MJCF), which its root element tells apart.
///
/// # Errors
/// Every fault at its place: the text is no XML or no robot, a number cannot be read, links and joints are no tree, an axis is zero,
/// an angle is beyond 1e6 rad, an element has more than a hundred attributes, a joint is of a kind that has no model, a loop or a force of
/// MuJoCo has none, or an option names what is not there.
pub fn import_description(source: &Source, options: &Options) -> Result<Imported, Diagnostics> {
    let Read { robot, warnings, readings } = read(source, options)?;
    // The name of the file without its folders, which have no meaning on another computer.
    let from = source.name().rsplit(['/', '\\']).next().unwrap_or_default();
    let (model, prior, experiment) = write::write(&robot, options, from)?;
    Ok(Imported { model, prior, experiment, readings, warnings })
}
