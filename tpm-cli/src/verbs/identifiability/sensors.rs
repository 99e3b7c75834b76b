//! What sensors show of a model that only a simulation compares with them.

use crate::failure::{Failure, Outcome};
use crate::input::load::Loaded;
use crate::output::file;
use crate::render::combination::not_counted;
use std::fmt::Write as _;
use std::path::Path;
use tpm_runtime::study::{Observed, observed};

/// Prints what the sensors of a model show.
pub(super) fn run(loaded: &Loaded, json: bool, output: Option<&Path>) -> Outcome {
    let found = observed(loaded.parsed()).map_err(|error| loaded.at_shown(error))?;
    let text = if json { file::json(&found)? } else { describe(&found) + &not_counted(&found.nonlinear) };
    file::emit(output, &text)?;
    if found.rank < found.parameters.len() || !found.unfelt.is_empty() {
        return Err(Failure::Incomplete(format!(
            "sensors show {} combinations of {} parameters",
            found.rank,
            found.parameters.len()
        )));
    }
    Ok(())
}

fn describe(found: &Observed) -> String {
    let mut text = format!(
        "rank {} of {} parameters by sensors of {} (exact modulo a prime, at random motions; initial states unknown)\n",
        found.rank,
        found.parameters.len(),
        found.sensors.join(", ")
    );
    if !found.unmeasured.is_empty() {
        let _ = writeln!(text, "not measured: {}", found.unmeasured.join(", "));
    }
    for coordinate in &found.unfelt {
        let _ = writeln!(text, "no sensor feels {coordinate}: measure {coordinate} or dot({coordinate})");
    }
    for parameters in &found.together {
        let _ = match parameters.as_slice() {
            [alone] => writeln!(text, "not shown: {alone}"),
            _ => writeln!(text, "only together: {}; hold one of them, or measure more", parameters.join(", ")),
        };
    }
    text
}
