//! Links and joints of a URDF.

use roxmltree::Node;
use tpm_symbolic::number::rational;

use crate::diagnostic::Diagnostic;
use crate::import::description::{
    Description, FREE, Follows, Inertial, Joint, Kind, Limits, Link, Origin, usual_gravity,
};
use crate::import::elements::{Reader, span};
use crate::import::reading::{Exact, is_angle};
use crate::source::Span;

/// Reads the description whose root element is `robot`; faults go to the reader.
pub(super) fn read(robot: Node<'_, '_>, reader: &mut Reader<'_, '_, '_>) -> Description {
    let mut description = Description {
        name: robot.attribute("name").unwrap_or("robot").to_owned(),
        span: span(robot),
        gravity: usual_gravity(),
        links: Vec::new(),
        joints: Vec::new(),
    };
    for element in robot.children().filter(Node::is_element) {
        match element.tag_name().name() {
            "link" => description.links.extend(reader.link(element)),
            "joint" => description.joints.extend(reader.joint(element)),
            "transmission" => reader.transmission(element),
            _ => reader.ignore(element, "robot"),
        }
    }
    description
}

impl Reader<'_, '_, '_> {
    fn link(&mut self, node: Node<'_, '_>) -> Option<Link> {
        let name = self.named(node, "name")?;
        let mut link = Link::light(name, span(node));
        for element in node.children().filter(Node::is_element) {
            match element.tag_name().name() {
                "inertial" => link.inertials = self.inertial(element).into_iter().collect(),
                _ => self.ignore(element, "link"),
            }
        }
        Some(link)
    }

    fn inertial(&mut self, node: Node<'_, '_>) -> Option<Inertial> {
        let mut origin = Origin::none();
        let (mut mass, mut moments) = (None, None);
        if !node.children().any(|child| child.has_tag_name("mass")) {
            self.error(span(node), "this `inertial` has no `mass`".to_owned(), "add `<mass value=\"...\"/>`");
        }
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
        let moments = moments.unwrap_or_else(|| std::array::from_fn(|_| rational::integer(0)));
        Some(Inertial { span: span(node), origin, mass: mass?, moments })
    }

    fn joint(&mut self, node: Node<'_, '_>) -> Option<Joint> {
        let name = self.named(node, "name")?;
        let kind = match self.named(node, "type")?.as_str() {
            "fixed" => Kind::Fixed,
            "revolute" | "continuous" => Kind::Revolute,
            "prismatic" => Kind::Prismatic,
            // Its child hangs on nothing, so that it can be the base.
            "floating" => {
                let message = format!("the joint `{name}` is free, and what it carries hangs on nothing here");
                self.diagnostics.push(Diagnostic::warning(span(node), message).help(FREE));
                return None;
            }
            other => {
                let message = format!("the joint `{name}` is of the type `{other}`, which has no model here");
                self.error(span(node), message, "joints are fixed, revolute, continuous or prismatic");
                return None;
            }
        };
        let (mut parent, mut child, mut axis, mut limits, mut follows) = (None, None, None, None, None);
        let mut origin = Origin::none();
        let (mut damping, mut friction) = (rational::integer(0), rational::integer(0));
        for element in node.children().filter(Node::is_element) {
            match element.tag_name().name() {
                "parent" => parent = self.named(element, "link"),
                "child" => child = self.named(element, "link"),
                "origin" => origin = self.origin(element),
                "axis" => axis = self.axis(element),
                "limit" => limits = Some(self.limits(element)),
                "mimic" => follows = self.mimic(element),
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
            armature: rational::integer(0),
            spring: None,
            start: rational::integer(0),
            follows,
        })
    }

    /// The reduction between a motor and its joint, in either place where it is written.
    fn transmission(&mut self, node: Node<'_, '_>) {
        self.ignore(node, "robot");
        let joint = node.children().find(|child| child.has_tag_name("joint")).and_then(|joint| joint.attribute("name"));
        let reduction = node.descendants().find(|child| child.has_tag_name("mechanicalReduction"));
        let ratio = reduction.and_then(|reduction| rational::parse(reduction.text()?.trim()));
        if let (Some(joint), Some(ratio)) = (joint, ratio) {
            self.geared(node, joint, ratio);
        }
    }

    fn mimic(&mut self, node: Node<'_, '_>) -> Option<Follows> {
        let leader = self.named(node, "joint")?;
        let factor = self.optional(node, "multiplier").unwrap_or_else(|| rational::integer(1));
        let offset = self.optional(node, "offset").unwrap_or_else(|| rational::integer(0));
        Some(Follows { leader, factor, offset, span: span(node) })
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
}
