//! How the samples of a log are used.

use crate::input::choice::one_of;
use clap::builder::TypedValueParser;
use tpm_runtime::estimate::Domain;

/// How the samples of a log become equations.
pub(crate) fn domain() -> impl TypedValueParser<Value = Domain> {
    one_of([
        (Domain::Harmonics, "harmonics", "By the harmonics of the part that repeats"),
        (Domain::Time, "time", "Sample by sample, whatever the motion is"),
    ])
}
