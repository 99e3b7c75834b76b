//! Options of the import: the part of a description that becomes a model, and how its numbers are read.

use tpm_symbolic::mechanics::tree::mechanism::Loss;

/// The parameters of friction that falls with the rate (Stribeck), without the name of the joint that ends theirs: what dry friction has more
/// at rest, and the rate at which that has fallen to 1/e.
pub const STRIBECK: [&str; 2] = ["fs", "vs"];

/// How the angles and lengths of a description are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Angles {
    /// Right angles and zeros are recognised where the written number is a rounded one.
    #[default]
    Recognised,
    /// Every number has exactly its written value.
    Written,
}

/// Options of the import.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The link that does not move; the root where not given. Links that are not outward of it are left out.
    pub base: Option<String>,
    /// The last link of the imported chain; where not given, every link is imported.
    pub tip: Option<String>,
    /// Joints that are held fixed, with their positions (rad or m) as written.
    pub locked: Vec<(String, String)>,
    /// How angles and lengths are read.
    pub angles: Angles,
    /// The unknown torques of every drive; where not given, viscous friction, Coulomb friction and rotors of the joints for which
    /// the description has a value that is not zero.
    pub losses: Option<Vec<Loss>>,
    /// Whether friction of every drive falls with the rate (Stribeck): parameters beside those of the losses, the rate of the fall with an
    /// interval in which it is looked for.
    pub stribeck: bool,
}
