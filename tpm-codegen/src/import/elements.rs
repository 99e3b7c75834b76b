//! Elements of an XML description: their names, numbers and places, and those that are left out.

use std::collections::BTreeMap;

use num_traits::{One, Zero};
use roxmltree::Node;
use tpm_symbolic::number::rational::{self, Rational};

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::reading::Readings;
use crate::source::Span;

/// Largest size of a number.
const LARGEST: f64 = 1e100;

/// The place of the opening tag of an element.
pub(super) fn span(node: Node<'_, '_>) -> Span {
    let range = node.range();
    let text = &node.document().input_text()[range.clone()];
    let end = range.start + text.find('>').map_or(text.len(), |at| at + 1);
    Span::new(range.start as u32, end as u32)
}

/// A number of a description. Nothing on a machine is larger than 1e100 in any unit, and products of such sizes would overflow.
pub(super) fn number(text: &str) -> Option<Rational> {
    rational::parse(text).filter(|value| rational::to_f64(value).abs() <= LARGEST)
}

/// Elements without a meaning for the dynamics, each with its parent element.
const WITHOUT_DYNAMICS: [(&str, &str); 27] = [
    ("robot", "material"),
    ("robot", "transmission"),
    ("robot", "gazebo"),
    ("robot", "ros2_control"),
    ("robot", "sensor"),
    ("link", "visual"),
    ("link", "collision"),
    ("joint", "safety_controller"),
    ("joint", "calibration"),
    ("mujoco", "asset"),
    ("mujoco", "contact"),
    ("mujoco", "custom"),
    ("mujoco", "extension"),
    ("mujoco", "keyframe"),
    ("mujoco", "sensor"),
    ("mujoco", "size"),
    ("mujoco", "statistic"),
    ("mujoco", "visual"),
    ("compiler", "lengthrange"),
    ("option", "flag"),
    ("body", "geom"),
    ("body", "site"),
    ("body", "camera"),
    ("body", "light"),
    ("body", "plugin"),
    ("tendon", "spatial"),
    ("tendon", "fixed"),
];

pub(super) struct Reader<'r, 's, 'd> {
    pub(super) readings: &'r mut Readings<'s>,
    pub(super) diagnostics: &'d mut Diagnostics,
    /// Joints by the gear ratios of their motors that are not one, with the place of the first one.
    gears: BTreeMap<Rational, (Span, Vec<String>)>,
    /// Ignored elements: by name and parent, the place of the first one and their number.
    ignored: BTreeMap<(String, &'static str), (Span, usize)>,
}

impl<'r, 's, 'd> Reader<'r, 's, 'd> {
    pub(super) fn new(readings: &'r mut Readings<'s>, diagnostics: &'d mut Diagnostics) -> Self {
        Self { readings, diagnostics, gears: BTreeMap::new(), ignored: BTreeMap::new() }
    }

    pub(super) fn ignore(&mut self, node: Node<'_, '_>, inside: &'static str) {
        let slot = self.ignored.entry((node.tag_name().name().to_owned(), inside)).or_insert((span(node), 0));
        slot.1 += 1;
    }

    /// Notes that the motor of a joint turns so many times as far.
    pub(super) fn geared(&mut self, node: Node<'_, '_>, joint: &str, ratio: Rational) {
        if !ratio.is_zero() && !ratio.is_one() {
            self.gears.entry(ratio).or_insert_with(|| (span(node), Vec::new())).1.push(format!("`{joint}`"));
        }
    }

    pub(super) fn report_left_out(&mut self) {
        for (ratio, (place, joints)) in std::mem::take(&mut self.gears) {
            let (ratio, joints) = (rational::to_f64(&ratio), joints.join(", "));
            let message = format!(
                "motors turn {ratio} times as far as their joints {joints}; the model has positions and torques of the joints"
            );
            let help =
                format!("in a log of such a motor, divide its position by {ratio} and multiply its torque by {ratio}");
            self.diagnostics.push(Diagnostic::warning(place, message).help(help));
        }
        let mut known: BTreeMap<String, usize> = BTreeMap::new();
        for ((name, inside), (place, count)) in std::mem::take(&mut self.ignored) {
            if WITHOUT_DYNAMICS.contains(&(inside, name.as_str())) {
                *known.entry(name).or_default() += count;
                continue;
            }
            let times = if count == 1 { String::new() } else { format!(", {count} times in all") };
            let message = format!("`{name}` is no element of a `{inside}` that is known here; it is left out{times}");
            let help = "check its spelling, and that it stands in the right place";
            self.diagnostics.push(Diagnostic::warning(place, message).help(help));
        }
        // One line for all that every description has of them.
        if !known.is_empty() {
            let parts: Vec<String> = known.into_iter().map(|(name, count)| format!("{count} `{name}`")).collect();
            self.readings
                .remark(format!("left out, as a model of the dynamics has no use for them: {}", parts.join(", ")));
        }
    }

    pub(super) fn error(&mut self, place: Span, message: String, help: &str) {
        self.diagnostics.push(Diagnostic::error(place, message).help(help));
    }

    pub(super) fn named(&mut self, node: Node<'_, '_>, attribute: &str) -> Option<String> {
        let value = node.attribute(attribute).map(str::trim).filter(|value| !value.is_empty());
        if value.is_none() {
            let element = node.tag_name().name();
            self.error(span(node), format!("this `{element}` has no `{attribute}`"), "add the attribute");
        }
        value.map(str::to_owned)
    }

    /// Three numbers of an attribute, with their texts.
    pub(super) fn triple(&mut self, node: Node<'_, '_>, attribute: &str) -> Option<[(Rational, String); 3]> {
        let text = self.named(node, attribute)?;
        // Of an axis the direction alone counts, and angles have a bound of their own.
        let read = if node.has_tag_name("axis") || attribute == "rpy" { rational::parse } else { number };
        let numbers: Vec<Option<(Rational, String)>> =
            text.split_whitespace().map(|word| Some((read(word)?, word.to_owned()))).collect();
        let numbers: Option<Vec<(Rational, String)>> = numbers.into_iter().collect();
        match numbers.map(<[(Rational, String); 3]>::try_from) {
            Some(Ok(numbers)) => Some(numbers),
            _ => {
                let message = format!("`{attribute}` is `{text}`, which is not three numbers");
                self.error(
                    span(node),
                    message,
                    "write three decimal numbers, such as \"0 0 0.1\", each of at most 1e100",
                );
                None
            }
        }
    }

    pub(super) fn number(&mut self, node: Node<'_, '_>, attribute: &str) -> Option<Rational> {
        self.named(node, attribute)?;
        self.optional(node, attribute)
    }

    /// The number in an attribute; a number that cannot be read is reported.
    pub(super) fn optional(&mut self, node: Node<'_, '_>, attribute: &str) -> Option<Rational> {
        let text = node.attribute(attribute)?.trim();
        let value = number(text);
        if value.is_none() {
            let what = if rational::parse(text).is_some() { "which is beyond any size" } else { "which is no number" };
            let message = format!("`{attribute}` is `{text}`, {what}");
            self.error(span(node), message, "write a decimal number, of at most 1e100");
        }
        value
    }
}
