//! The page of a comparison of two results.

use crate::block::{Block, Cell, Notice};
use crate::marks::Interval;
use crate::page::{Caution, Document};
use tpm_report::{cells, digits, or_dash, probability};
use tpm_session::{Comparison, Difference, Family, Verdict};

/// Significant digits of probabilities and of joint statistics.
const CHANCE_DIGITS: usize = 3;

impl Document {
    /// The page of what changed between two results, which are called by these names.
    #[must_use]
    pub fn of_comparison(found: &Comparison, names: [&str; 2]) -> Self {
        let [a, b] = names;
        let mut words = found.in_words();
        if let Some(first) = words.get_mut(..1) {
            first.make_ascii_uppercase();
        }
        words.push('.');
        let models = if found.model_a == found.model_b {
            found.model_a.clone()
        } else {
            format!("{} and {}", found.model_a, found.model_b)
        };
        let mut document = Document {
            title: models,
            subtitle: format!("{b} (B) compared with {a} (A)"),
            issue: None,
            // A change is no shortfall: it is what was asked for.
            short: "Not complete",
            shortfall: None,
            success: words,
            conclusion: Vec::new(),
            caution: match found.verdict {
                Verdict::NoDifference => Caution::of_warnings(!found.warnings.is_empty()),
                _ => Some(Caution { section: "differences", text: "What changed stands below." }),
            },
            facts: facts(found),
            sections: Vec::new(),
            figures: Vec::new(),
        };
        let list: Vec<Notice> =
            found.warnings.iter().map(|text| Notice { text: text.clone(), remedy: None, grave: false }).collect();
        let warnings = if list.is_empty() { vec![Block::text("None.")] } else { vec![Block::Notices { list }] };
        document.section("warnings", "Warnings", warnings);
        let mut blocks = vec![table(&found.linear, "parameters in which the models are linear")];
        blocks.extend(found.physical.as_ref().map(|family| table(family, "physical parameters behind them")));
        for family in found.families() {
            blocks.extend(notes(family));
        }
        blocks.push(Block::text(format!(
            "The bar is the 95 % interval of the difference; no difference is the line in the middle. z: the difference in its deviations; p: how \
             often chance alone makes one as large; Holm: p corrected for all {} tests made here. Below {} it counts as a change.",
            found.tests, found.level
        )));
        document.section("differences", "Differences", blocks);
        document
    }
}

fn facts(found: &Comparison) -> Vec<(String, Cell)> {
    let verdict = match found.verdict {
        Verdict::NoDifference => "no difference",
        Verdict::Changed => "changed",
        Verdict::ChangedTogether => "changed together",
        // Verdicts to come stand in the sentence above.
        _ => "see above",
    };
    vec![
        ("verdict".to_owned(), Cell::text(verdict)),
        (
            "changed".to_owned(),
            Cell::text(if found.changed.is_empty() { "-".to_owned() } else { found.changed.join(", ") }),
        ),
        ("tests".to_owned(), Cell::text(found.tests.to_string())),
        ("level of all tests".to_owned(), Cell::shown(digits(found.level, CHANCE_DIGITS), Some(found.level))),
    ]
}

fn table(family: &Family, caption: &str) -> Block {
    let columns = [
        "parameter",
        "unit",
        "#A",
        "#std. dev. of A",
        "#B",
        "#std. dev. of B",
        "#B - A",
        "#std. dev. of B - A",
        "outcome",
        "difference",
        "#z",
        "#p",
        "#Holm",
    ];
    Block::table(&columns, family.differences.iter().map(row).collect(), caption)
}

fn row(own: &Difference) -> Vec<Cell> {
    let pair = |value: Option<f64>, std: Option<f64>| {
        let [shown, deviation] = cells(value, std);
        [Cell::shown(shown, value), Cell::shown(deviation, std)]
    };
    let chance = |p: Option<f64>| Cell::shown(or_dash(p, chance_text), p);
    let outcome = match &own.untested {
        Some(why) => why.clone(),
        None if own.changed => "changed".to_owned(),
        None => "no change shown".to_owned(),
    };
    let mut line = vec![Cell::text(own.name.clone()), Cell::text(own.unit.clone().unwrap_or_else(|| "-".to_owned()))];
    line.extend(pair(own.a.value, own.a.std));
    line.extend(pair(own.b.value, own.b.std));
    line.extend(pair(own.difference, own.std));
    line.push(Cell::text(outcome));
    line.push(Cell::interval(Interval::of_difference(own.difference, own.std)));
    line.push(Cell::shown(or_dash(own.z, signed), own.z));
    line.extend([chance(own.p), chance(own.p_adjusted)]);
    line
}

/// A chance.
fn chance_text(p: f64) -> String {
    probability(p, |p| digits(p, CHANCE_DIGITS))
}

/// A number of deviations with its sign.
fn signed(z: f64) -> String {
    let shown = digits(z, CHANCE_DIGITS);
    if z > 0.0 { format!("+{shown}") } else { shown }
}

/// The test of all differences together, where a change lies, and what only one result has.
fn notes(family: &Family) -> Vec<Block> {
    let mut notes = Vec::new();
    if let Some(joint) = &family.joint {
        notes.push(Block::text(format!(
            "All together: chi squared {} with {} degrees of freedom, p {}.",
            digits(joint.chi_squared, CHANCE_DIGITS),
            joint.degrees_of_freedom,
            chance_text(joint.p)
        )));
    }
    if let Some(direction) = &family.direction {
        let [difference, std] = cells(Some(direction.difference), Some(direction.std));
        let unit =
            direction.unit.as_deref().filter(|unit| *unit != "1").map_or(String::new(), |unit| format!(" {unit}"));
        notes.push(Block::text(format!(
            "What changed most: {} by {difference} +- {std}{unit} ({} deviations).",
            direction.combination,
            signed(direction.z)
        )));
    }
    for (which, names) in [("A", &family.only_in_a), ("B", &family.only_in_b)] {
        if !names.is_empty() {
            notes.push(Block::text(format!("Only {which} has {}.", names.join(", "))));
        }
    }
    notes
}
