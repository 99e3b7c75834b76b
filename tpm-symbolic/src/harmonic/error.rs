//! Why a model does not expand into a table.

use crate::harmonic::motion::MotionError;
use crate::mechanics::model::TermId;
use thiserror::Error;

/// Why a model does not expand.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ExpandError {
    /// A coordinate of the equations is not in the pattern.
    #[error("the coordinate `{coordinate}` has no motion in the pattern; give it one, or eliminate it")]
    NoMotion {
        /// Where it occurs.
        term: TermId,
        /// The coordinate.
        coordinate: String,
    },
    /// A term is not a finite Fourier series.
    #[error(
        "`{atom}` does not expand into finitely many harmonics under the pattern; declare a Taylor series for it, or use the model with logs, which need no expansion"
    )]
    NotFinite {
        /// Where it occurs.
        term: TermId,
        /// The function or quotient.
        atom: String,
    },
    /// The table, or what must be held to compute it, would be larger than the limit.
    #[error(
        "the table would have up to {entries} entries and take about {} MB, more than the limit of {} MB; lower the order, or allow large tables",
        (*bytes).div_ceil(1_000_000),
        limit / 1_000_000
    )]
    TooLarge {
        /// The term that contributes most.
        term: TermId,
        /// An upper bound of the number of entries, or of the symbolic products on the way to them.
        entries: u128,
        /// An upper bound of the memory in bytes.
        bytes: u128,
        /// The limit in bytes.
        limit: u128,
    },
    /// A sign or an absolute value has no exact series under the pattern.
    #[error("{source}")]
    Sign {
        /// Where it occurs.
        term: TermId,
        /// Why.
        source: SignError,
    },
    /// The progress callback requested a stop.
    #[error("the expansion was stopped")]
    Stopped {
        /// The term that was being expanded.
        term: TermId,
    },
}

impl ExpandError {
    /// The source term at fault.
    #[must_use]
    pub fn term(&self) -> TermId {
        match self {
            Self::NoMotion { term, .. }
            | Self::NotFinite { term, .. }
            | Self::TooLarge { term, .. }
            | Self::Sign { term, .. }
            | Self::Stopped { term } => *term,
        }
    }
}

/// Why a sign or an absolute value has no exact series.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SignError {
    /// The argument consists of parts with different amplitudes.
    #[error(
        "the sign of `{argument}` depends on the ratio of the pattern's amplitudes; give it a motion with one amplitude and no offset"
    )]
    Ratio {
        /// The argument of sign or abs.
        argument: String,
    },
    /// The sign changes at another phase than a multiple of a quarter period.
    #[error(
        "`{argument}` changes sign under the pattern at a phase that is no multiple of a quarter period, so its harmonics are no rational multiples of 1/pi; use a rest-to-rest or a symmetric pattern"
    )]
    Phase {
        /// The argument of sign or abs.
        argument: String,
    },
    /// Two signs in one term have different fundamentals.
    #[error(
        "the signs in `{argument}` and another factor of its term change at phases of different multiples of the fundamental, so the harmonics of their product are no rational multiples of 1/pi"
    )]
    Multiples {
        /// The argument of sign or abs.
        argument: String,
    },
    /// The argument, or another factor, is no polynomial of the motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
}
