//! How the samples of a log are used.

use clap::ValueEnum;
use tpm_runtime::estimate::Domain;

/// How the samples of a log become equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DomainChoice {
    /// By the harmonics of the part that repeats.
    Harmonics,
    /// Sample by sample, whatever the motion is.
    Time,
}

impl From<DomainChoice> for Domain {
    fn from(choice: DomainChoice) -> Self {
        match choice {
            DomainChoice::Harmonics => Domain::Harmonics,
            DomainChoice::Time => Domain::Time,
        }
    }
}
