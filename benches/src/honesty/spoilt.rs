//! Wrong models and spoilt logs: is every number right or refused, and is the fault named?

use crate::honesty::cases::{Case, Mark};
use crate::honesty::examine::Examined;
use crate::honesty::identify::Outcome;
use crate::honesty::table::{Table, met, most_frequent, percent};

/// Stated deviations within which a number is right.
const RIGHT: f64 = 3.0;
/// Share of a parameter by which a fault must move it to be worth a name.
const MOVED: f64 = 0.01;
/// Share of the logs whose numbers must be right or refused.
const HONEST: f64 = 0.97;
/// Share of the logs with a moved parameter in which the fault must be named.
const NAMED: f64 = 0.9;

/// The report of the cases with all their outcomes.
#[must_use]
pub fn report(results: &[Examined]) -> String {
    let mut table = Table::new(&[
        "case",
        "logs",
        "right or refused",
        "exit code 1 or 2",
        "moved or refused",
        "of these named",
        "typical largest error",
        "in stated deviations",
        "met",
        "said most often",
    ]);
    for Examined { case, outcomes } in results {
        let honest = outcomes.iter().filter(|outcome| is_right(case, outcome) || outcome.exit != 0).count();
        let moved: Vec<&Outcome> = outcomes.iter().filter(|outcome| is_moved(case, outcome)).collect();
        let named = moved.iter().filter(|outcome| is_named(case.marks, outcome)).count();
        let refused = outcomes.iter().filter(|outcome| outcome.exit != 0).count();
        let enough = honest as f64 >= HONEST * outcomes.len() as f64 && named as f64 >= NAMED * moved.len() as f64;
        let relative = typical(outcomes, |outcome| largest(case, outcome, |error, truth, _| error / truth));
        let stated = typical(outcomes, |outcome| largest(case, outcome, |error, _, std| error / std));
        table.push(vec![
            case.name.into(),
            outcomes.len().to_string(),
            percent(honest, outcomes.len()),
            percent(refused, outcomes.len()),
            moved.len().to_string(),
            percent(named, moved.len()),
            relative.map_or_else(String::new, |(name, size)| format!("{name} {:+.2} %", 100.0 * size)),
            stated.map_or_else(String::new, |(name, size)| format!("{name} {size:+.1}")),
            if case.hidden { "scale only".into() } else { met(enough) },
            most_frequent(outcomes.iter().flat_map(|outcome| &outcome.said).map(|said| said.label.as_str()), 3),
        ]);
    }
    table.to_string()
}

/// Names of the parameters, errors, true values and stated deviations; nothing for a parameter without a value.
fn errors<'a>(
    case: &'a Case,
    outcome: &'a Outcome,
) -> impl Iterator<Item = Option<(&'static str, f64, f64, f64)>> + 'a {
    let error = |&(name, truth): &(&'static str, f64)| {
        outcome.value(name).map(|(value, std)| (name, value - truth, truth, std))
    };
    case.model.truth().iter().map(error)
}

/// The parameter whose error, in the given measure of error, true value and stated deviation, is the largest.
fn largest(case: &Case, outcome: &Outcome, measure: impl Fn(f64, f64, f64) -> f64) -> Option<(&'static str, f64)> {
    let measured = errors(case, outcome).flatten().map(|(name, error, truth, std)| (name, measure(error, truth, std)));
    measured.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
}

/// The median by size over all logs.
fn typical<'a>(
    outcomes: &'a [Outcome],
    largest: impl Fn(&'a Outcome) -> Option<(&'static str, f64)>,
) -> Option<(&'static str, f64)> {
    let mut all: Vec<(&str, f64)> = outcomes.iter().filter_map(largest).collect();
    all.sort_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    all.get(all.len() / 2).copied()
}

fn is_right(case: &Case, outcome: &Outcome) -> bool {
    errors(case, outcome).all(|own| own.is_some_and(|(_, error, _, std)| error.abs() <= RIGHT * std))
}

/// Whether a parameter is off by enough to ask for the fault's name, or no number was given.
fn is_moved(case: &Case, outcome: &Outcome) -> bool {
    errors(case, outcome).any(|own| own.is_none_or(|(_, error, truth, _)| error.abs() > MOVED * truth.abs()))
}

fn is_named(marks: &[Mark], outcome: &Outcome) -> bool {
    let names = |(kind, words): &Mark| {
        outcome.said.iter().any(|said| (kind.is_empty() || said.kind == *kind) && said.text.contains(words))
    };
    marks.iter().any(names)
}
