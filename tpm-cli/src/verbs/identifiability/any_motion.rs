//! What any motion can show of a model's parameters, exactly, with a certificate that is checked before it is printed.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::assignment;
use crate::input::load::Loaded;
use crate::output::file;
use crate::render::combination::{common_factors, not_counted, sum};
use std::fmt::Write as _;
use std::path::Path;
use tpm_runtime::study::{AnyMotion, ShownError, any_motion};
use tpm_symbolic::number::rational;

/// Prints the base parameters of a model under all motions, but for the coordinates that rest.
pub(super) fn run(loaded: &Loaded, rests: &[String], json: bool, output: Option<&Path>) -> Outcome {
    let mut resting = Vec::with_capacity(rests.len());
    for text in rests {
        let wrong = |reason: &str| Failure::Input(format!("--rest {text}: {reason}"));
        let (name, value) = assignment(text).map_err(|reason| wrong(&reason))?;
        let value =
            rational::parse(value.trim()).ok_or_else(|| wrong("the value is not a number such as 0, 1/3 or 0.25"))?;
        resting.push((name, value));
    }
    let found = any_motion(loaded.parsed(), &resting).map_err(|error| match error {
        ShownError::Asked(reason) => Failure::Input(format!("--rest: {reason}")),
        other => loaded.at_shown(other),
    })?;
    let text = if json { file::json(&found)? } else { describe(&found) + &not_counted(&found.nonlinear) };
    file::emit(output, &text)?;
    if found.rank < found.parameters.len() {
        return Err(Failure::Incomplete(format!(
            "motions show {} combinations of {} parameters",
            found.rank,
            found.parameters.len()
        )));
    }
    Ok(())
}

fn describe(found: &AnyMotion) -> String {
    let points = found.certificate.points.len();
    let mut text = format!(
        "rank {} of {} parameters under any motion (exact: a lower bound by {points} points modulo a prime, null vectors checked at fresh rational points)\n",
        found.rank,
        found.parameters.len()
    );
    if !found.unobservable.is_empty() {
        let _ = writeln!(text, "no motion shows {}", found.unobservable.join(", "));
    }
    text.push_str(&common_factors(&found.common_factors));
    match &found.base {
        Some(base) => {
            text.push_str("\nbase parameters\n");
            for one in base {
                let rest = if one.plus.is_empty() { String::new() } else { format!(" + {}", sum(&one.plus)) };
                let _ = writeln!(text, "  {}{rest}", one.parameter);
            }
        }
        None => text.push_str("their factors depend on constants without a value\n"),
    }
    text
}
