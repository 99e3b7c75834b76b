//! What a page says of the machine: its equations, the frames of a mechanism, friction over the rate, and what to do next.

use crate::block::{Block, Cell, Notice};
use crate::forces::low;
use crate::headline;
use crate::page::Document;
use std::f64::consts::PI;
use tpm_plot::{Axis, Curve, Panel, Trace};
use tpm_report::number;
use tpm_session::{
    Calibration, DeclaredModel, DriveTerms, Frame, FrictionCourse, Identification, Movement, Severity, Validation,
    Warning,
};

/// Most points of friction in a panel, which are taken evenly over the rates that occur.
const MOST: usize = 400;
/// Room beside the smallest and the largest rate, a share of their distance, so that their points are not cut.
const MARGIN: f64 = 0.02;
/// An axis of a frame is named where the others have less than this.
const ALONG: f64 = 1e-9;

/// What a user does with a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Step {
    /// Looks for a motion that shows more.
    Motion,
    /// Predicts another log.
    Prediction,
    /// Asks for possible inertias of the links.
    Inertias,
    /// Generates code.
    Code,
}

/// Gives the command of a step in a front end; nothing where the front end has none.
pub type Direct<'a> = dyn Fn(Step) -> Option<String> + 'a;

impl Document {
    /// The page with the equations of motion at its beginning, those of a mechanism with its frames and drives, and what to do next at its
    /// end. `command` gives the commands of the steps.
    #[must_use]
    pub fn of_machine(mut self, model: &DeclaredModel, result: &Identification, command: &Direct<'_>) -> Self {
        let frames = model.frames();
        let lines = model.equations();
        let written = (!lines.is_empty()).then_some(Block::Equations { lines });
        let (title, blocks) = if frames.is_empty() {
            ("Equations of motion", written.into_iter().collect())
        } else {
            ("Machine and frames", mechanism(model, &frames).into_iter().chain(written).collect())
        };
        self.section("machine", title, blocks);
        if let Some(at) = self.sections.iter().position(|own| own.id == "machine") {
            self.sections[..=at].rotate_right(1);
        }
        let list = next(result, !frames.is_empty(), command);
        self.section("next", "What to do next", vec![Block::Notices { list }]);
        self
    }

    /// Friction of every row that has some, over the rate of its coordinate.
    pub(super) fn friction(&mut self, all: &[Validation]) {
        let mut blocks = Vec::new();
        for found in all {
            let panels: Vec<Panel> = found.rows.iter().filter_map(|row| panel(row.friction.as_ref()?)).collect();
            if panels.is_empty() {
                continue;
            }
            let what = "Friction against the rate: what the other terms of the model leave of the applied force, and the friction that was \
                        identified. The points hold the band of the record that is used, in which a jump is smeared and rings";
            let caption = if all.len() > 1 { format!("{}: {what}", found.log) } else { what.to_owned() };
            blocks.push(self.figure("friction", low(format!("{}: friction", found.model), panels), &caption));
        }
        self.section("friction", "Friction", blocks);
    }
}

/// The equation of rigid bodies in their recursion, their frames and drives.
fn mechanism(model: &DeclaredModel, frames: &[Frame]) -> Vec<Block> {
    vec![
        Block::text(
            "M(q) q\u{2032}\u{2032} + c(q, q\u{2032}) + g(q) + losses of the drives = inputs: the equations of motion of rigid bodies, by the \
                 recursion of Newton and Euler. They are linear in the ten parameters of every body, its mass m, first moments mx, my, mz and \
                 moments of inertia Ixx to Izz about the origin of its frame, and in those of the drives.",
        ),
        Block::table(
            &["body", "stands on", "its joint", "origin [m]", "turned by roll, pitch, yaw [deg]"],
            frames.iter().map(frame).collect(),
            "frames, where all coordinates are zero",
        ),
        Block::table(
            &["input", "moves", "losses"],
            model.drives().iter().map(drive).collect(),
            "drives: v is the rate of what a drive moves",
        ),
    ]
}

fn frame(own: &Frame) -> Vec<Cell> {
    let joint = match own.movement {
        Movement::Fixed => "fixed".to_owned(),
        Movement::Turns => format!("{} turns about {}", own.coordinate, axis(own.axis)),
        Movement::Slides => format!("{} slides along {}", own.coordinate, axis(own.axis)),
    };
    let part = |value: &Option<f64>| value.map_or_else(|| "given at run time".to_owned(), number);
    let list = |values: Vec<String>| values.join(", ");
    vec![
        Cell::text(own.body.clone()),
        Cell::text(own.on.clone().unwrap_or_else(|| "the base".to_owned())),
        Cell::text(joint),
        Cell::text(list(own.origin.iter().map(part).collect())),
        Cell::text(list(own.turned.iter().map(|angle| number(angle * 180.0 / PI)).collect())),
    ]
}

/// An axis by its name, or by its components.
fn axis(own: [f64; 3]) -> String {
    for (k, name) in ["x", "y", "z"].into_iter().enumerate() {
        if (own[k].abs() - 1.0).abs() < ALONG {
            return if own[k] > 0.0 { name.to_owned() } else { format!("-{name}") };
        }
    }
    format!("({})", own.map(number).join(", "))
}

fn drive(own: &DriveTerms) -> Vec<Cell> {
    vec![
        Cell::text(own.input.clone().unwrap_or_else(|| "none".to_owned())),
        Cell::text(own.moves.clone()),
        Cell::text(if own.losses.is_empty() { "none".to_owned() } else { own.losses.clone() }),
    ]
}

fn panel(own: &FrictionCourse) -> Option<Panel> {
    let mut points = own.points.clone();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (first, last) = (points.first()?.0, points.last()?.0);
    if first >= last {
        return None;
    }
    // In the order of the rates, so that no rhythm of the motion meets the pace at which they are taken.
    let points: Vec<(f64, f64)> = points.iter().step_by(points.len().div_ceil(MOST)).copied().collect();
    let room = MARGIN * (last - first);
    let of = own.unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}/s]"));
    let force = own.force_unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"));
    Some(Panel {
        x: Axis::linear(&format!("rate of {}{of}", own.coordinate)).from_to(first - room, last + room),
        y: Axis::linear(&format!("friction of {}{force}", own.coordinate)),
        traces: vec![
            Trace::new("what the other terms leave", 0, Curve::Points(points)),
            Trace::new("identified friction", 1, Curve::Line(own.law.clone())),
        ],
    })
}

/// What helps next, the most pressing first.
fn next(result: &Identification, mechanism: bool, command: &Direct<'_>) -> Vec<Notice> {
    let mut said = Vec::new();
    let mut say = |text: String, step: Option<Step>| {
        said.push(Notice { text, remedy: step.and_then(command), grave: false });
    };
    let worst = result.warnings.iter().map(|warning| warning.meaning().severity).max();
    let distrust = worst == Some(Severity::Distrust);
    if distrust {
        let text = "Mend what the warnings with a red bar name, and identify again: until then the values that they concern are not to be \
                    relied on.";
        say(text.to_owned(), None);
    }
    if headline::lacks(result) {
        let terms: Vec<&str> = headline::lacking(result)
            .iter()
            .flat_map(|(_, terms)| terms.iter().map(|term| term.term.as_str()))
            .collect();
        let text = format!(
            "Write down what the model lacks ({}), as far as it has a meaning for this machine, and identify again: the deviations hold what \
             the gap does to the values, and become smaller without it.",
            terms.join(", ")
        );
        say(text, None);
    }
    if result.rank < result.wanted() {
        let text = "Record another motion: this one does not show every combination that some motion shows. The search for an excitation finds \
                    one within the limits of the machine.";
        say(text.to_owned(), Some(Step::Motion));
    }
    for warning in &result.warnings {
        let Warning::UnseenFaults { faults } = warning else { continue };
        for (what, of) in [
            ("Check the zeros of", Calibration::Zero),
            ("Check the gains of", Calibration::Gain),
            ("Make sure that there is no dead zone of", Calibration::DeadZone),
            ("Make sure that the model has every inertia between", Calibration::Inertia),
        ] {
            let own = faults.iter().filter(|fault| fault.quantity == of).map(|fault| fault.signal.as_str());
            let list = own.collect::<Vec<&str>>().join(", ");
            if !list.is_empty() {
                say(format!("{what} {list}: this log may not show a fault there."), None);
            }
        }
    }
    if !distrust {
        let text = "Predict another log, of a motion that was not used here, before the parameters are relied on.";
        say(text.to_owned(), Some(Step::Prediction));
    }
    if result.is_complete() {
        if mechanism && !result.combinations.is_empty() {
            let text = "Ask for possible inertias of the links: what bodies can have, nearest to these values in their deviations, and to the \
                        description where the log says nothing.";
            say(text.to_owned(), Some(Step::Inertias));
        }
        let text = "Generate code for the controller with these parameters: feed-forward, gravity, a monitor of later changes.";
        say(text.to_owned(), Some(Step::Code));
    }
    said
}
