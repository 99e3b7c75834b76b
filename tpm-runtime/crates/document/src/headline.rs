//! What stands above everything else on the page of an identification.
//!
//! How much is unexplained is one number, the residual of the result. It is made into text here alone, so that the headline, the conclusion
//! and the table of section "Measured against model" cannot differ.

use crate::block::{Cell, SHARE_DIGITS};
use crate::validation::failed;
use tpm_estimate::{ParameterReport, Status};
use tpm_report::{digits, or_dash};
use tpm_session::{Identification, MissingTerm, Severity, Source, Validation};

pub(super) fn subtitle(result: &Identification) -> String {
    match (result.source, &result.log, &result.pool) {
        (Source::Log, Some(log), _) => format!("identified from {}", log.path),
        (Source::Log, None, Some(pool)) => format!("identified from {} logs together", pool.logs.len()),
        (Source::Log, None, None) => "identified from a log".to_owned(),
        (Source::SimulatedPlant, ..) => "identified on a simulated machine".to_owned(),
        (Source::Machine, ..) => "identified on a machine".to_owned(),
        (Source::Folder, ..) => "identified from the runs in a campaign's folder".to_owned(),
    }
}

/// How much is unexplained, in words.
fn share(result: &Identification) -> String {
    format!("{} % of {}", digits(100.0 * result.residual, SHARE_DIGITS), result.residual_of)
}

/// How much is unexplained.
pub(super) fn unexplained(result: &Identification) -> (String, Cell) {
    ("unexplained".to_owned(), Cell::shown(share(result), Some(result.residual)))
}

/// The sentence for a complete result, with the parameters that are poorly determined. `evidence` are the validations on the page, whose
/// tests it does not contradict.
pub(super) fn success(result: &Identification, evidence: &[Validation]) -> String {
    // A term that the page names as missing is not explained, even where it moves no parameter and no warning speaks of it.
    let misfit = result.warnings.iter().any(|warning| warning.meaning().severity >= Severity::Misfit) || lacks(result);
    let hidden = asked(result).iter().filter(|own| own.status == Status::Unobservable).count();
    // A motion of an arm shows some parameters in combinations only, which is known beforehand and no fault of the data.
    let shown = match hidden {
        0 if misfit => "Everything that was asked for has a value".to_owned(),
        0 => "The data show everything that was asked for".to_owned(),
        1 => {
            format!("The data show all {} combinations that can be shown, one parameter only within them", result.rank)
        }
        _ => format!(
            "The data show all {} combinations that can be shown, {hidden} parameters only within them",
            result.rank
        ),
    };
    let mut text = if misfit {
        format!("{shown}, but the model leaves {} unexplained", share(result))
    } else if evidence.iter().any(failed) {
        // What rounding and integration leave fails such a test too, however little it is.
        format!("{shown}, and the model explains what was measured but for {}, which is not all noise", share(result))
    } else {
        format!("{shown}, and the model explains what was measured")
    };
    let poor = named(result, Status::PoorlyDetermined);
    if !poor.is_empty() {
        text.push_str(&format!("; poorly determined: {}", poor.join(", ")));
    }
    text.push('.');
    text
}

/// Whether the page names terms that the model lacks.
pub(super) fn lacks(result: &Identification) -> bool {
    lacking(result).iter().any(|(_, terms)| !terms.is_empty())
}

/// Terms that the model lacks, with the log that showed them where there are several.
pub(super) fn lacking(result: &Identification) -> Vec<(String, Vec<&MissingTerm>)> {
    let runs = (result.source != Source::Log).then(|| (String::new(), result.missing_of_runs()));
    let alone = result.log.iter().map(|log| (String::new(), log.missing().iter().collect()));
    let pooled = result.pool.iter().flat_map(|pool| &pool.logs);
    let pooled = pooled.map(|part| (format!(" of {}", part.log.path), part.log.missing().iter().collect()));
    runs.into_iter().chain(alone).chain(pooled).collect()
}

/// The parameters that were asked for: where there are physical ones, the lumped ones are intermediate results.
fn asked(result: &Identification) -> &[ParameterReport] {
    if result.physical.is_empty() { &result.parameters } else { &result.physical }
}

/// The parameters with a status, those in which the model is linear first. One that stands in both lists has the status of a physical one.
fn named(result: &Identification, status: Status) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    let physical = |own: &&ParameterReport| result.physical.iter().any(|other| other.name == own.name);
    let lumped = result.parameters.iter().filter(|own| !physical(own));
    for own in lumped.chain(&result.physical).filter(|own| own.status == status) {
        if !names.contains(&own.name.as_str()) {
            names.push(&own.name);
        }
    }
    names
}

/// What a reader who knows nothing of estimators takes away: how many parameters are known and how well, which are not, and how much the
/// model explains.
pub(super) fn conclusion(result: &Identification) -> Vec<String> {
    let asked = asked(result);
    let with = |status: Status| asked.iter().filter(|own| own.status == status).count();
    let mut counts: Vec<String> = Vec::new();
    for (count, what) in [
        (with(Status::Identified), "identified"),
        (with(Status::PoorlyDetermined), "known poorly"),
        (with(Status::Unobservable), "not shown alone"),
        (with(Status::Untrusted), "not to be trusted"),
        (with(Status::Frozen), "held at a value that was given"),
    ] {
        if count > 0 {
            counts.push(format!("{count} {what}"));
        }
    }
    let all: usize = asked.len();
    let mut said = vec![format!("Of {all} parameter{}: {}.", if all == 1 { "" } else { "s" }, counts.join(", "))];
    let relative = |own: &ParameterReport| {
        let (value, std) = (own.value?, own.std?);
        (value != 0.0 && std.is_finite()).then(|| (own.name.clone(), (std / value).abs()))
    };
    let mut known: Vec<(String, f64)> =
        asked.iter().filter(|own| own.status == Status::Identified).filter_map(relative).collect();
    known.sort_by(|a, b| a.1.total_cmp(&b.1));
    let percent = |share: f64| format!("{} %", digits(100.0 * share, 2));
    match known.as_slice() {
        [] => {}
        [(name, share)] => {
            said.push(format!("The standard deviation of {name} is {} of its value.", percent(*share)));
        }
        [(best, least), .., (worst, most)] => said.push(format!(
            "Standard deviations are between {} of the value ({best}) and {} ({worst}).",
            percent(*least),
            percent(*most)
        )),
    }
    said.push(format!("The model leaves {} unexplained.", share(result)));
    said
}

pub(super) fn facts(result: &Identification) -> Vec<(String, Cell)> {
    let mut facts = vec![
        unexplained(result),
        ("rank".to_owned(), Cell::text(format!("{} of {}", result.rank, result.wanted()))),
        (
            "condition number".to_owned(),
            Cell::shown(or_dash(result.condition, |condition| digits(condition, SHARE_DIGITS)), result.condition),
        ),
        ("estimator".to_owned(), Cell::text(result.estimator.name())),
        ("hold of the inputs".to_owned(), Cell::text(result.hold.to_string())),
    ];
    facts.extend(result.outcome.map(|outcome| ("campaign".to_owned(), Cell::text(outcome.describe()))));
    facts
}
