//! What of a description becomes a model, and how its numbers are read.

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
