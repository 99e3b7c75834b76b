//! One regression for any record: the motion is smoothed once, and what is left of the rows is noise whose spectrum is found.
//!
//! Model of a record: sensors read y = q + v, rows hold up to forces of unknown colour,
//!
//! ```text
//! Y_j(q, q', q'') theta + F_j(q, q') c + known_j = (B u)_j + e_j,
//! ```
//!
//! where F are terms that the model may lack, with random coefficients c. With E[q | y] in place of q the regressors' error is of Berkson's
//! kind and attenuates nothing; what it adds to the equations is known from the sensors' noise. All columns become lines of a spectrum
//! (`lines`), of which the noise of every row and band is found by restricted likelihood (`noise`), the variances of what is missing by
//! marginal likelihood (`components`). Of a right model these variances are zero. Of a wrong one the deviations contain what the missing
//! terms would move, and terms that stand out are named.
//!
//! A row without an input shows ratios alone: its leading acceleration is predicted, so that the scale of its parameters is exactly what
//! it does not show, and comes from the rows that share parameters with it.
//!
//! Where the noise of the sensors makes up most of what is left, E[q | y] is not the last word (a loop feeds the noise back): the share is
//! reported, and a simulation refines the values.
//!
//! ```text
//! spectrum -> path (motion, rows along it) -> library, lines -> pass, start -> noise, widening -> components, split -> fit, nearest
//! ```

mod arrangement;
mod components;
mod fit;
mod library;
mod lines;
mod nearest;
mod noise;
mod only_input;
mod pass;
mod path;
mod split;
mod start;
#[cfg(test)]
mod tests;
mod widening;

pub use arrangement::{Arranged, Arrangement, best_arrangement};
pub(crate) use components::{Components, Products};
pub use fit::{CalibrationFault, FittedDelay, Lacking, LineReport, OfAnyMotion, UnseenFault, estimate_any_motion};
pub(crate) use library::{Scales, Seen, Structure};
pub use library::{Term, TermKind};
pub use nearest::{AddedTerm, Nearby, Nearest};
pub use only_input::gain_of_the_only_input;
pub(crate) use path::Columns;
pub(crate) use split::{Solved, Split};
