//! Links and joints of a URDF as written, each element with its place.

use std::collections::BTreeMap;

use roxmltree::{Document, Node};
use tpm_symbolic::number::rational::{self, Rational};

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::markup;
use crate::import::reading::{Exact, ExactAngle, Readings, is_angle};
use crate::import::xml::with_prefixes;
use crate::source::{Source, Span};

/// A robot as it is described.
#[derive(Debug)]
pub(super) struct Description {
    pub(super) name: String,
    pub(super) span: Span,
    pub(super) links: Vec<Link>,
    pub(super) joints: Vec<Joint>,
}

/// A link.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) name: String,
    pub(super) span: Span,
    pub(super) inertial: Option<Inertial>,
}

/// Mass and moments about the centre of mass.
#[derive(Debug)]
pub(super) struct Inertial {
    pub(super) span: Span,
    pub(super) origin: Origin,
    pub(super) mass: Rational,
    /// Ixx, Ixy, Ixz, Iyy, Iyz, Izz.
    pub(super) moments: [Rational; 6],
}

/// A position, and a rotation by roll, pitch and yaw.
#[derive(Clone, Debug)]
pub(super) struct Origin {
    pub(super) at: [Exact; 3],
    pub(super) turned: [ExactAngle; 3],
}

impl Origin {
    pub(super) fn none() -> Self {
        Self { at: std::array::from_fn(|_| Exact::zero()), turned: std::array::from_fn(|_| ExactAngle::zero()) }
    }
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Fixed,
    Revolute,
    Prismatic,
}

/// A joint.
#[derive(Debug)]
pub(super) struct Joint {
    pub(super) name: String,
    pub(super) span: Span,
    pub(super) kind: Kind,
    pub(super) parent: String,
    pub(super) child: String,
    pub(super) origin: Origin,
    /// The axis as written, with its place; the x axis where the description has none.
    pub(super) axis: ([Exact; 3], String, Span),
    pub(super) limits: Limits,
    pub(super) damping: Rational,
    pub(super) friction: Rational,
}

/// Limits of a joint.
#[derive(Debug, Default)]
pub(super) struct Limits {
    pub(super) lower: Option<Rational>,
    pub(super) upper: Option<Rational>,
    pub(super) velocity: Option<Rational>,
    pub(super) effort: Option<Rational>,
}

/// Reads the description; faults go to `diagnostics`, and `None` is returned where there is no robot.
pub(super) fn read(source: &Source, readings: &mut Readings<'_>, diagnostics: &mut Diagnostics) -> Option<Description> {
    if let Some((place, most)) = markup::excess(source.text()) {
        let fault = Diagnostic::error(place, format!("there are more than {most} attributes or namespaces here"));
        diagnostics.push(fault.help("a URDF needs six attributes at most: export the description again"));
        return None;
    }
    let document = with_prefixes(source.text());
    let (text, prefixes) = match document {
        Ok(mended) => mended,
        Err(error) => {
            let line = error.pos();
            let start =
                source.text().lines().take((line.row.max(1) - 1) as usize).map(|line| line.len() + 1).sum::<usize>();
            let start = (start + line.col.max(1) as usize - 1).min(source.text().len()) as u32;
            let fault = Diagnostic::error(Span::new(start, start), format!("this is no XML: {error}"));
            diagnostics.push(
                fault.help("export the description again; a xacro file is expanded first, `xacro robot.urdf.xacro`"),
            );
            return None;
        }
    };
    // The text was parsed once, so that it can be.
    let document = Document::parse(&text).ok()?;
    let robot = document.root_element();
    if !prefixes.is_empty() {
        let message =
            format!("the prefixes {} are not declared; what begins with one is left out", prefixes.join(", "));
        diagnostics.push(Diagnostic::warning(span(robot), message).help("a model of the dynamics has no use for it"));
    }
    if robot.tag_name().name() != "robot" {
        let fault = Diagnostic::error(span(robot), format!("`{}` is no robot description", robot.tag_name().name()));
        diagnostics.push(fault.help("a URDF has the root element `robot`"));
        return None;
    }
    let mut reader = Reader { readings, diagnostics, ignored: BTreeMap::new() };
    let mut description = Description {
        name: robot.attribute("name").unwrap_or("robot").to_owned(),
        span: span(robot),
        links: Vec::new(),
        joints: Vec::new(),
    };
    for element in robot.children().filter(Node::is_element) {
        match element.tag_name().name() {
            "link" => description.links.extend(reader.link(element)),
            "joint" => description.joints.extend(reader.joint(element)),
            _ => reader.ignore(element, "robot"),
        }
    }
    reader.report_ignored();
    Some(description)
}

/// The place of the opening tag of an element.
fn span(node: Node<'_, '_>) -> Span {
    let range = node.range();
    let text = &node.document().input_text()[range.clone()];
    let end = range.start + text.find('>').map_or(text.len(), |at| at + 1);
    Span::new(range.start as u32, end as u32)
}

/// Elements without a meaning for the dynamics, each with its parent element.
const WITHOUT_DYNAMICS: [(&str, &str); 10] = [
    ("robot", "material"),
    ("robot", "transmission"),
    ("robot", "gazebo"),
    ("robot", "ros2_control"),
    ("robot", "sensor"),
    ("link", "visual"),
    ("link", "collision"),
    ("joint", "mimic"),
    ("joint", "safety_controller"),
    ("joint", "calibration"),
];

struct Reader<'r, 's, 'd> {
    readings: &'r mut Readings<'s>,
    diagnostics: &'d mut Diagnostics,
    /// Ignored elements: by name and parent, the place of the first one and their number.
    ignored: BTreeMap<(String, &'static str), (Span, usize)>,
}

impl Reader<'_, '_, '_> {
    fn ignore(&mut self, node: Node<'_, '_>, inside: &'static str) {
        let slot = self.ignored.entry((node.tag_name().name().to_owned(), inside)).or_insert((span(node), 0));
        slot.1 += 1;
    }

    fn report_ignored(&mut self) {
        for ((name, inside), (place, count)) in std::mem::take(&mut self.ignored) {
            let known = WITHOUT_DYNAMICS.contains(&(inside, name.as_str()));
            let times = if count == 1 { String::new() } else { format!(", {count} times in all") };
            let message = if known {
                format!("`{name}` is left out{times}")
            } else {
                format!("`{name}` is no element of a `{inside}` that is known here; it is left out{times}")
            };
            let help = match name.as_str() {
                "mimic" => "the joint has a coordinate of its own here; lock it, or couple it in the model by hand",
                _ if known => "a model of the dynamics has no use for it",
                _ => "check its spelling, and that it stands in the right place",
            };
            self.diagnostics.push(Diagnostic::warning(place, message).help(help));
        }
    }

    fn error(&mut self, place: Span, message: String, help: &str) {
        self.diagnostics.push(Diagnostic::error(place, message).help(help));
    }

    fn named(&mut self, node: Node<'_, '_>, attribute: &str) -> Option<String> {
        let value = node.attribute(attribute).map(str::trim).filter(|value| !value.is_empty());
        if value.is_none() {
            let element = node.tag_name().name();
            self.error(span(node), format!("this `{element}` has no `{attribute}`"), "add the attribute");
        }
        value.map(str::to_owned)
    }

    fn link(&mut self, node: Node<'_, '_>) -> Option<Link> {
        let name = self.named(node, "name")?;
        let mut link = Link { name, span: span(node), inertial: None };
        for element in node.children().filter(Node::is_element) {
            match element.tag_name().name() {
                "inertial" => link.inertial = self.inertial(element),
                _ => self.ignore(element, "link"),
            }
        }
        Some(link)
    }

    fn inertial(&mut self, node: Node<'_, '_>) -> Option<Inertial> {
        let mut origin = Origin::none();
        let (mut mass, mut moments) = (None, None);
        for element in node.children().filter(Node::is_element) {
            match element.tag_name().name() {
                "origin" => origin = self.origin(element),
                "mass" => mass = self.number(element, "value"),
                "inertia" => {
                    let values = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].map(|name| self.number(element, name));
                    let [Some(xx), Some(xy), Some(xz), Some(yy), Some(yz), Some(zz)] = values else { return None };
                    moments = Some([xx, xy, xz, yy, yz, zz]);
                }
                _ => self.ignore(element, "inertial"),
            }
        }
        let Some(mass) = mass else {
            self.error(span(node), "this `inertial` has no `mass`".to_owned(), "add `<mass value=\"...\"/>`");
            return None;
        };
        let moments = moments.unwrap_or_else(|| std::array::from_fn(|_| rational::integer(0)));
        Some(Inertial { span: span(node), origin, mass, moments })
    }

    fn joint(&mut self, node: Node<'_, '_>) -> Option<Joint> {
        let name = self.named(node, "name")?;
        let kind = match self.named(node, "type")?.as_str() {
            "fixed" => Kind::Fixed,
            "revolute" | "continuous" => Kind::Revolute,
            "prismatic" => Kind::Prismatic,
            other => {
                let message = format!("the joint `{name}` is of the type `{other}`, which has no model here");
                self.error(span(node), message, "joints are fixed, revolute, continuous or prismatic");
                return None;
            }
        };
        let (mut parent, mut child, mut axis, mut limits) = (None, None, None, None);
        let mut origin = Origin::none();
        let (mut damping, mut friction) = (rational::integer(0), rational::integer(0));
        for element in node.children().filter(Node::is_element) {
            match element.tag_name().name() {
                "parent" => parent = self.named(element, "link"),
                "child" => child = self.named(element, "link"),
                "origin" => origin = self.origin(element),
                "axis" => axis = self.axis(element),
                "limit" => limits = Some(self.limits(element)),
                "dynamics" => {
                    damping = self.optional(element, "damping").unwrap_or(damping);
                    friction = self.optional(element, "friction").unwrap_or(friction);
                }
                _ => self.ignore(element, "joint"),
            }
        }
        let (Some(parent), Some(child)) = (parent, child) else {
            let message = format!("the joint `{name}` does not say which links it joins");
            self.error(span(node), message, "add `<parent link=\"...\"/>` and `<child link=\"...\"/>`");
            return None;
        };
        if kind != Kind::Fixed {
            if axis.is_none() {
                let message = format!("the joint `{name}` has no axis; by the rules of URDF it is the x axis");
                self.diagnostics.push(Diagnostic::warning(span(node), message).help("write `<axis xyz=\"1 0 0\"/>`"));
            }
            if limits.is_none() {
                let message = format!("the joint `{name}` has no limits");
                let help = "add its limits to the experiment before anything moves";
                self.diagnostics.push(Diagnostic::warning(span(node), message).help(help));
            }
        }
        let x =
            || ([Exact::new(rational::integer(1), "1"), Exact::zero(), Exact::zero()], "1 0 0".to_owned(), span(node));
        Some(Joint {
            name,
            span: span(node),
            kind,
            parent,
            child,
            origin,
            axis: axis.unwrap_or_else(x),
            limits: limits.unwrap_or_default(),
            damping,
            friction,
        })
    }

    fn limits(&mut self, node: Node<'_, '_>) -> Limits {
        Limits {
            lower: self.optional(node, "lower"),
            upper: self.optional(node, "upper"),
            velocity: self.optional(node, "velocity"),
            effort: self.optional(node, "effort"),
        }
    }

    fn axis(&mut self, node: Node<'_, '_>) -> Option<([Exact; 3], String, Span)> {
        let numbers = self.triple(node, "xyz")?;
        let written = node.attribute("xyz").unwrap_or_default().to_owned();
        Some((numbers.map(|(value, text)| Exact::new(value, &text)), written, span(node)))
    }

    fn origin(&mut self, node: Node<'_, '_>) -> Origin {
        let mut origin = Origin::none();
        let place = span(node);
        if node.has_attribute("xyz")
            && let Some(numbers) = self.triple(node, "xyz")
        {
            origin.at = numbers.map(|(value, text)| self.readings.length(value, &text, place));
        }
        if node.has_attribute("rpy")
            && let Some(numbers) = self.triple(node, "rpy")
        {
            if let Some((_, text)) = numbers.iter().find(|(value, _)| !is_angle(value)) {
                let message = format!("`rpy` has the angle {text} rad, of which no place is left after whole turns");
                self.error(place, message, "write an angle within a turn, in rad");
                return origin;
            }
            origin.turned = numbers.map(|(value, text)| self.readings.angle(&value, &text, place));
        }
        origin
    }

    /// Three numbers of an attribute, with their texts.
    fn triple(&mut self, node: Node<'_, '_>, attribute: &str) -> Option<[(Rational, String); 3]> {
        let text = self.named(node, attribute)?;
        let numbers: Vec<Option<(Rational, String)>> =
            text.split_whitespace().map(|word| Some((rational::parse(word)?, word.to_owned()))).collect();
        let numbers: Option<Vec<(Rational, String)>> = numbers.into_iter().collect();
        match numbers.map(<[(Rational, String); 3]>::try_from) {
            Some(Ok(numbers)) => Some(numbers),
            _ => {
                let message = format!("`{attribute}` is `{text}`, which is not three numbers");
                self.error(span(node), message, "write three decimal numbers, such as \"0 0 0.1\"");
                None
            }
        }
    }

    fn number(&mut self, node: Node<'_, '_>, attribute: &str) -> Option<Rational> {
        self.named(node, attribute)?;
        self.optional(node, attribute)
    }

    /// The number in an attribute; a number that cannot be read is reported.
    fn optional(&mut self, node: Node<'_, '_>, attribute: &str) -> Option<Rational> {
        let text = node.attribute(attribute)?.trim();
        let value = rational::parse(text);
        if value.is_none() {
            let message = format!("`{attribute}` is `{text}`, which is no number");
            self.error(span(node), message, "write a decimal number");
        }
        value
    }
}
