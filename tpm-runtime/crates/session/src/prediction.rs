//! What a model and one with the terms that it lacks leave of the forces of a log.

use crate::refinement_report::MissingTerm;
use crate::term_words::lacking;
use serde::Serialize;
use std::collections::BTreeMap;
use tpm_codegen::language::complete::AddedForce;
use tpm_controller::model::Model;
use tpm_estimate::{AddedTerm, LARGE_RESIDUAL, Lacking, Nearest, OfAnyMotion, TermKind};
use tpm_report::{Align, TextTable};

/// Share of a row's force on parts held out above which nothing of it is predicted.
const NOTHING: f64 = 0.7;

/// What a model leaves of the forces of a log, row by row, behind the low passes of the rows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOfForces {
    /// Values of the parameters with which it is nearest to the forces.
    pub values: Vec<f64>,
    /// What is left of every row, as a share of its force.
    pub left: Vec<f64>,
    /// The same on parts of the log from which the values were not taken.
    pub held_out: Vec<f64>,
}

impl LeftOfForces {
    fn of(own: &Nearest) -> Self {
        Self { values: own.values.clone(), left: own.left.clone(), held_out: own.held_out.clone() }
    }
}

/// A model with terms that it lacked.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Completed {
    /// What it leaves of the forces.
    #[serde(flatten)]
    pub forces: LeftOfForces,
    /// The terms; deviations are those of the completed model's own identification.
    pub terms: Vec<MissingTerm>,
    /// The same as they are written into the text of the model.
    #[serde(skip)]
    pub added: Vec<AddedForce>,
    /// Coordinates whose dry friction grows with the load.
    #[serde(skip)]
    pub loaded: Vec<String>,
}

/// How well a model that lacks something predicts the forces of a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// Names of the rows.
    pub rows: Vec<String>,
    /// What is left of every row with the values of the result, which are right beside what the model lacks, as a share of its force.
    pub left: Vec<f64>,
    /// The model as it stands, with other values.
    pub stated: LeftOfForces,
    /// The model with terms that it lacks; nothing where they make it no better on parts of the log that it was not taken from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub completed: Option<Completed>,
    /// By how much later than it is recorded an input acts in both, s, where it does.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub delays: BTreeMap<String, f64>,
}

impl Prediction {
    /// Of what the lines of a log told; nothing where the model lacks nothing, or a row has no input, which shows ratios alone.
    pub(super) fn of(model: &dyn Model<f64>, found: &OfAnyMotion) -> Option<Self> {
        if model.dims().inputs < model.dims().rows {
            return None;
        }
        let nearby = found.nearby.as_ref()?;
        let stated = LeftOfForces::of(&nearby.stated);
        let completed = nearby.completed.as_ref().map(|own| {
            let words = |term: &AddedTerm| lacking(model, &Lacking::known(term.term, term.value));
            let is_load = |term: &&AddedTerm| term.term.kind == TermKind::LoadFriction;
            let loads: Vec<&AddedTerm> = own.terms.iter().filter(is_load).collect();
            let forces = || own.terms.iter().filter(|term| !is_load(term));
            Completed {
                forces: LeftOfForces::of(own),
                terms: own.terms.iter().map(words).collect(),
                added: forces().map(|term| added(model, term, words(term))).collect(),
                loaded: loads.iter().map(|term| model.coordinate(term.term.of).name.to_string()).collect(),
            }
        });
        let rows = (0..model.dims().rows).map(|row| model.row(row).name.to_string()).collect();
        let late = nearby.delays.iter().enumerate().filter(|(_, delay)| **delay > 0.0);
        let delays = late.map(|(input, delay)| (model.input(input).name.to_string(), *delay)).collect();
        Some(Self { rows, left: nearby.left.clone(), stated, completed, delays })
    }

    /// Which forces the model predicts and of which it predicts nothing, on parts of the log that were held out; nothing where every
    /// force is predicted at least in part, or none is.
    pub(super) fn by_rows(&self) -> Option<String> {
        let held_out = &self.completed.as_ref().map_or(&self.stated, |own| &own.forces).held_out;
        let of = |least: f64, most: f64| -> Vec<(&String, f64)> {
            let rows = self.rows.iter().zip(held_out).map(|(row, left)| (row, *left));
            rows.filter(|(_, left)| (least..most).contains(left)).collect()
        };
        let (told, in_part) = (of(0.0, LARGE_RESIDUAL), of(LARGE_RESIDUAL, NOTHING));
        let nothing = of(NOTHING, f64::INFINITY);
        if nothing.is_empty() || nothing.len() == self.rows.len() {
            return None;
        }
        let listed = |rows: &[(&String, f64)]| {
            let row = |(row, left): &(&String, f64)| format!("{row} ({:.0} % left)", 100.0 * left);
            rows.iter().map(row).collect::<Vec<_>>().join(", ")
        };
        let mut said = Vec::new();
        if !told.is_empty() {
            said.push(format!("it predicts {}", listed(&told)));
        }
        if !in_part.is_empty() {
            said.push(format!("in part {}", listed(&in_part)));
        }
        said.push(format!(
            "nothing of {}, which are in another unit, no forces of these joints, or lost in their noise",
            listed(&nothing)
        ));
        Some(said.join("; "))
    }

    /// What is left of every row as a table.
    pub(super) fn text(&self) -> String {
        let mut head = vec![("left of the force, %", Align::Left)];
        head.extend(self.rows.iter().map(|row| (row.as_str(), Align::Right)));
        let mut table = TextTable::new(&head);
        let mut add = |name: &str, shares: &[f64]| {
            let shares = shares.iter().map(|share| format!("{:.1}", 100.0 * share));
            table.row(&std::iter::once(name.to_owned()).chain(shares).collect::<Vec<String>>());
        };
        if self.left != self.stated.left {
            add("the values above, which hold beside what is missing", &self.left);
        }
        add("the values nearest to the forces", &self.stated.left);
        add("  the same, on parts held out", &self.stated.held_out);
        if let Some(completed) = &self.completed {
            add("the completed model", &completed.forces.left);
            add("  the same, on parts held out", &completed.forces.held_out);
        }
        table.finish()
    }
}

/// A term as it is written into the text of a model.
fn added(model: &dyn Model<f64>, own: &AddedTerm, words: MissingTerm) -> AddedForce {
    let term = own.term;
    let (kind, q) = (term.kind, model.coordinate(term.of));
    let row = term.row.unwrap_or(term.of);
    let name = |c: usize| model.coordinate(c).name.to_string();
    let place = term.other.map_or_else(|| name(term.of), |other| format!("{}_{}", name(term.of), name(other)));
    // Powers of the coordinate and of the second in the expression, and what the parameter is called.
    let numbered = |stem: &str, n: u32| if n == 1 { stem.to_owned() } else { format!("{stem}{n}") };
    let (of_coordinate, of_time, stem) = match kind {
        TermKind::Friction | TermKind::PairFriction => (0, 0, "fc".to_owned()),
        TermKind::Stribeck => (0, 0, "fs".to_owned()),
        TermKind::Presliding(_) => (0, 0, "fp".to_owned()),
        TermKind::RatePower(n) => (n, n, numbered("fv", n)),
        TermKind::PairDamping => (1, 1, "fv".to_owned()),
        TermKind::PairAsymmetry => (1, 1, "fa".to_owned()),
        TermKind::Drag | TermKind::PairDrag => (2, 2, "drag".to_owned()),
        TermKind::Power(n) | TermKind::PairPower(n) => (n, 0, numbered("k", n)),
        TermKind::PositionFriction(n) => (n, 0, format!("fc_by{n}")),
        TermKind::PositionDamping(n) => (n + 1, 1, format!("fv_by{n}")),
        TermKind::PairPositionDamping => (2, 1, "fv_by1".to_owned()),
        TermKind::Inertia(n) => (n + 1, 2, if n == 0 { "Ia".to_owned() } else { format!("Ia_by{n}") }),
        TermKind::PairInertia | TermKind::RelativeInertia => (1, 2, "M".to_owned()),
        TermKind::Sine(n) => (0, 0, numbered("sine", n)),
        TermKind::Cosine(n) => (0, 0, numbered("cosine", n)),
        TermKind::Chain { even, .. } => (0, 0, if even { "cosine" } else { "sine" }.to_owned()),
        TermKind::Ripple { even: false, half_waves } => (0, 0, format!("ripple{half_waves}s")),
        TermKind::Ripple { even: true, half_waves } => (0, 0, format!("ripple{half_waves}c")),
        TermKind::Play | TermKind::PairPlay => (0, 0, "play".to_owned()),
        _ => (0, 0, "f0".to_owned()),
    };
    let unit = |of_coordinate: u32| {
        let own = q.unit.filter(|unit| unit.chars().all(char::is_alphabetic) || of_coordinate == 0);
        let raised = |unit: &str, n: u32, sign: char| match n {
            0 => String::new(),
            1 => format!("{sign}{unit}"),
            n => format!("{sign}{unit}^{n}"),
        };
        let per = if of_coordinate == 0 { String::new() } else { raised(own?, of_coordinate, '/') };
        Some(format!("{}{}{per}", model.row(row).unit?, raised("s", of_time, '*')))
    };
    let of_q = |text: &str| q.unit.map(|unit| text.replace('q', unit));
    let distance = term.other.map_or_else(|| name(term.of), |other| format!("({} - {})", name(term.of), name(other)));
    let mut constants = Vec::new();
    let mut constant = |name: &str, value: Option<f64>, unit: Option<String>| {
        let name = format!("{name}_{place}");
        constants.push((name.clone(), value.unwrap_or(0.0), unit));
        format!("{{{name}}}")
    };
    let mut numbers = own.constants.iter().copied();
    let mut presliding = None;
    let expression = match kind {
        TermKind::Presliding(_) => {
            let state = format!("built_up_{place}");
            presliding = Some((state.clone(), name(term.of), numbers.next().unwrap_or(0.0)));
            format!("{{{state}}}")
        }
        TermKind::Stribeck => {
            let rate = constant("vs", numbers.next(), of_q("q/s"));
            format!("sign(dot({distance}))*exp(-(dot({distance})/{rate})^2)")
        }
        TermKind::Play | TermKind::PairPlay => {
            format!("tanh({distance}/{})", constant("width", numbers.next(), of_q("q")))
        }
        TermKind::Ripple { even, half_waves } => {
            let wave = constant(&format!("wave{half_waves}"), numbers.next(), of_q("1/q"));
            let middle = constant("middle", numbers.next(), of_q("q"));
            format!("{}({wave}*({distance} - {middle}))", if even { "cos" } else { "sin" })
        }
        TermKind::Sine(n) | TermKind::Cosine(n) if q.unit.is_some_and(|unit| unit != "rad") => {
            let per = constant("per", Some(f64::from(n)), of_q("1/q"));
            let function = if matches!(kind, TermKind::Sine(_)) { "sin" } else { "cos" };
            format!("{function}({per}*{distance})")
        }
        _ => words.term,
    };
    let rows = match (kind, term.other) {
        (TermKind::PairInertia, Some(other)) => {
            vec![
                (term.of, name(term.of), format!("ddot({})", name(other))),
                (other, name(other), format!("ddot({})", name(term.of))),
            ]
        }
        (TermKind::Chain { against, .. }, Some(other)) => (term.of..=other)
            .map(|c| (c, name(c), if against && c == other { format!("-{expression}") } else { expression.clone() }))
            .collect(),
        (_, Some(other)) => {
            vec![(term.of, name(term.of), expression.clone()), (other, name(other), format!("-{expression}"))]
        }
        (_, None) => vec![(row, name(row.min(model.dims().coordinates - 1)), expression)],
    };
    AddedForce {
        parameter: format!("{stem}_{place}"),
        unit: unit(of_coordinate),
        meaning: words.meaning,
        constants,
        presliding,
        rows,
    }
}

#[cfg(test)]
mod tests {
    use super::{LeftOfForces, Prediction};
    use std::collections::BTreeMap;

    fn of(held_out: &[f64]) -> Prediction {
        let stated = LeftOfForces { values: Vec::new(), left: Vec::new(), held_out: held_out.to_vec() };
        let rows = (1..=held_out.len()).map(|row| format!("tau{row}")).collect();
        Prediction { rows, left: Vec::new(), stated, completed: None, delays: BTreeMap::new() }
    }

    #[test]
    fn rows_of_which_nothing_is_predicted_are_named_beside_the_others() {
        let text = of(&[0.1, 0.4, 1.1]).by_rows().expect("one row is not predicted");
        assert_eq!(
            text,
            "it predicts tau1 (10 % left); in part tau2 (40 % left); nothing of tau3 (110 % left), which are in another unit, no forces of \
             these joints, or lost in their noise"
        );
        assert_eq!(of(&[0.1, 0.4]).by_rows(), None);
        assert_eq!(of(&[0.9, 1.4]).by_rows(), None, "the whole result says so");
    }
}
