//! Faults of accumulating harmonics.

use core::fmt;

/// Why harmonics could not be accumulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccumulatorError {
    /// The memory handed over is too short.
    Memory {
        /// Entries needed.
        needed: usize,
        /// Entries given.
        given: usize,
    },
    /// A period of so few samples does not resolve the highest harmonic.
    TooFewSamples {
        /// Samples in a period.
        samples: usize,
        /// Highest harmonic asked for.
        harmonics: usize,
    },
    /// A sample has another number of channels than the accumulator.
    Channels {
        /// Channels of the accumulator.
        needed: usize,
        /// Channels of the sample, or the channel that was asked for.
        given: usize,
    },
    /// Coefficients were asked for before a whole period was there.
    NotWhole {
        /// Samples beyond the last whole period.
        samples: usize,
    },
}

impl fmt::Display for AccumulatorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Memory { needed, given } => {
                write!(f, "{needed} entries of memory are needed, {given} were given")
            }
            Self::TooFewSamples { samples, harmonics } => write!(
                f,
                "a period of {samples} samples does not resolve harmonic {harmonics}; at least {} samples are needed",
                2 * harmonics + 1
            ),
            Self::Channels { needed, given } => {
                write!(f, "the accumulator has {needed} channels, {given} were named")
            }
            Self::NotWhole { samples } => write!(
                f,
                "{samples} samples stand beyond the last whole period (or none is complete); harmonics need whole periods"
            ),
        }
    }
}

impl core::error::Error for AccumulatorError {}
