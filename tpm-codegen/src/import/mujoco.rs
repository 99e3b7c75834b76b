//! Links and joints of a model for MuJoCo (MJCF).
//!
//! A body is a link; of several joints in one body all but the last carry links without mass. A joint that does not stand at the origin of
//! its body moves the origin of the link to the joint. Free bodies hang on nothing, so that one of them can be named as the base. What
//! MuJoCo would add to the torques and has no place in a mechanism (loops, tendons that pull, fluids) is a fault.

mod defaults;
pub(super) mod losses;
mod shape;

use std::collections::{BTreeMap, BTreeSet};

use num_traits::{Signed, Zero};
use roxmltree::Node;
use tpm_symbolic::number::rational::{self, Rational};

use crate::diagnostic::Diagnostic;
use crate::import::description::{
    Description, FREE, Follows, Inertial, Joint, Kind, Limits, Link, Origin, Spring, usual_gravity,
};
use crate::import::elements::{Reader, number, span};
use crate::import::frame;
use crate::import::mujoco::defaults::Defaults;
use crate::import::options::Options;
use crate::import::reading::Exact;

/// Help for what only a compiled model says.
const EXPANDED: &str = "write the model out with all that it includes: load it in MuJoCo and call `mj_saveLastXML`";

/// Most elements around an element: bodies and classes are read one within the other.
const DEEPEST: usize = 300;

/// Sections in which there is nothing for the dynamics of a mechanism.
const READ: [&str; 7] = ["compiler", "option", "default", "worldbody", "actuator", "equality", "tendon"];

/// Reads the description whose root element is `mujoco`; faults go to the reader.
pub(super) fn read(model: Node<'_, '_>, options: &Options, reader: &mut Reader<'_, '_, '_>) -> Description {
    let mut description = Description {
        name: model.attribute("model").unwrap_or("MuJoCo model").to_owned(),
        span: span(model),
        gravity: usual_gravity(),
        links: vec![Link::light("world".to_owned(), span(model))],
        joints: Vec::new(),
    };
    for element in model.children().filter(Node::is_element) {
        let name = element.tag_name().name();
        match name {
            "include" | "deformable" => {
                reader.error(span(element), format!("`{name}` is not read here"), EXPANDED);
            }
            _ if READ.contains(&name) => {}
            _ => reader.ignore(element, "mujoco"),
        }
    }
    if let Some(deep) = model.descendants().find(|node| node.ancestors().take(DEEPEST + 2).count() > DEEPEST + 1) {
        reader.error(
            span(deep),
            format!("elements are more than {DEEPEST} deep here"),
            "a robot's bodies are far fewer",
        );
        return description;
    }
    let compiler = Compiler::of(model, reader);
    let mut walk = Walk {
        reader,
        compiler,
        defaults: Defaults::of(model),
        efforts: BTreeMap::new(),
        locked: options.locked.iter().map(|(name, _)| name.as_str()).collect(),
        description: &mut description,
        unnamed: 0,
    };
    walk.options(model);
    walk.actuators(model);
    let couplings = walk.equalities(model);
    walk.tendons(model);
    for world in model.children().filter(|child| child.has_tag_name("worldbody")) {
        let class = world.attribute("childclass");
        walk.bodies(world, "world", &std::array::from_fn(|_| Rational::zero()), class);
    }
    walk.couple(couplings);
    walk.weigh();
    description
}

/// Settings of the compiler.
struct Compiler {
    /// Radians in the unit of angles.
    unit: f64,
    /// Whether angles are in radians already.
    radian: bool,
    eulerseq: String,
    autolimits: bool,
    from_geoms: FromGeoms,
    /// The groups of shapes that have mass.
    groups: std::ops::RangeInclusive<i64>,
    /// What all masses are scaled to.
    total: Option<Rational>,
}

/// Whether inertias are those of shapes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum FromGeoms {
    Never,
    WhereMissing,
    Always,
}

impl Compiler {
    fn of(model: Node<'_, '_>, reader: &mut Reader<'_, '_, '_>) -> Self {
        let mut found = Self {
            unit: std::f64::consts::PI / 180.0,
            radian: false,
            eulerseq: "xyz".to_owned(),
            autolimits: true,
            from_geoms: FromGeoms::WhereMissing,
            groups: 0..=5,
            total: None,
        };
        for element in model.children().filter(|child| child.has_tag_name("compiler")) {
            found.radian = match element.attribute("angle") {
                Some("radian") => true,
                Some("degree") => false,
                Some(other) => {
                    let message = format!("`angle` is `{other}`");
                    reader.error(span(element), message, "angles are in `degree` or `radian`");
                    found.radian
                }
                None => found.radian,
            };
            if let Some(sequence) = element.attribute("eulerseq") {
                if frame::of_euler([0.0; 3], sequence).is_none() {
                    let message = format!("`eulerseq` is `{sequence}`");
                    reader.error(span(element), message, "write three letters of x, y, z, X, Y, Z");
                } else {
                    sequence.clone_into(&mut found.eulerseq);
                }
            }
            found.autolimits = element.attribute("autolimits").map_or(found.autolimits, |value| value == "true");
            found.from_geoms = match element.attribute("inertiafromgeom") {
                Some("true") => FromGeoms::Always,
                Some("false") => FromGeoms::Never,
                Some("auto") => FromGeoms::WhereMissing,
                _ => found.from_geoms,
            };
            let changes = [("coordinate", "global"), ("balanceinertia", "true")];
            for (name, value) in changes {
                if element.attribute(name) == Some(value) {
                    reader.error(span(element), format!("`{name}` is `{value}`, which is not read here"), EXPANDED);
                }
            }
            let total = element.attribute("settotalmass").and_then(rational::parse);
            found.total = total.filter(|total| *total > Rational::zero()).or(found.total);
            if let Some(range) = element.attribute("inertiagrouprange") {
                let ends: Option<Vec<i64>> = range.split_whitespace().map(|word| word.parse().ok()).collect();
                match ends.as_deref() {
                    Some([low, high]) => found.groups = *low..=*high,
                    _ => {
                        let message = format!("`inertiagrouprange` is `{range}`");
                        reader.error(span(element), message, "write two integers, such as \"0 5\"");
                    }
                }
            }
            for name in ["boundmass", "boundinertia"] {
                if element.attribute(name).and_then(rational::parse).is_some_and(|value| value > Rational::zero()) {
                    reader.error(span(element), format!("`{name}` changes masses, and is not read here"), EXPANDED);
                }
            }
        }
        if found.radian {
            found.unit = 1.0;
        }
        found
    }
}

/// A joint whose position is a constant and a multiple of another joint's position.
struct Coupling<'a, 'i> {
    node: Node<'a, 'i>,
    follower: &'a str,
    leader: &'a str,
    constant: Rational,
    factor: Rational,
}

struct Walk<'w, 'r, 's, 'd, 'a, 'i> {
    reader: &'w mut Reader<'r, 's, 'd>,
    compiler: Compiler,
    defaults: Defaults<'a, 'i>,
    /// The largest force that actuators have, by joint.
    efforts: BTreeMap<&'a str, Rational>,
    locked: BTreeSet<&'w str>,
    description: &'w mut Description,
    unnamed: usize,
}

impl<'a, 'i> Walk<'_, '_, '_, '_, 'a, 'i> {
    fn error(&mut self, node: Node<'a, 'i>, message: String, help: &str) {
        self.reader.error(span(node), message, help);
    }

    /// An attribute of an element or its class.
    fn attribute(&self, node: Node<'a, 'i>, class: Option<&'a str>, name: &str) -> Option<&'a str> {
        self.defaults.attribute(node, class, name).map(str::trim)
    }

    /// Numbers of an attribute, each with its text; `None` where there is no such attribute or it was reported.
    fn numbers<const N: usize>(
        &mut self,
        node: Node<'a, 'i>,
        class: Option<&'a str>,
        name: &str,
    ) -> Option<[(Rational, &'a str); N]> {
        let text = self.attribute(node, class, name)?;
        let numbers: Option<Vec<(Rational, &str)>> =
            text.split_whitespace().map(|word| Some((number(word)?, word))).collect();
        let found = numbers.and_then(|numbers| numbers.try_into().ok());
        if found.is_none() {
            let message = format!("`{name}` is `{text}`, which is not {N} number{}", if N == 1 { "" } else { "s" });
            self.error(node, message, "write decimal numbers of at most 1e100, separated by spaces");
        }
        found
    }

    fn floats<const N: usize>(&mut self, node: Node<'a, 'i>, class: Option<&'a str>, name: &str) -> Option<[f64; N]> {
        self.numbers::<N>(node, class, name).map(|numbers| numbers.map(|(value, _)| rational::to_f64(&value)))
    }

    /// One number; zero where there is no such attribute.
    fn number(&mut self, node: Node<'a, 'i>, class: Option<&'a str>, name: &str) -> Rational {
        self.numbers::<1>(node, class, name).map_or_else(Rational::zero, |[(value, _)]| value)
    }

    fn options(&mut self, model: Node<'a, 'i>) {
        for element in model.children().filter(|child| child.has_tag_name("option")) {
            if let Some(numbers) = self.numbers::<3>(element, None, "gravity") {
                self.description.gravity = numbers.map(|(value, text)| Exact::new(value, text));
            }
            for name in ["density", "viscosity"] {
                if !self.number(element, None, name).is_zero() {
                    let message = format!("`{name}` lets a fluid act on the bodies, which has no model here");
                    self.error(element, message, "remove it, or add its forces to the imported model by hand");
                }
            }
            let flags = element.children().filter(|child| child.has_tag_name("flag"));
            if flags.clone().any(|flag| flag.attribute("gravity") == Some("disable")) {
                self.description.gravity = std::array::from_fn(|_| Exact::zero());
            }
        }
    }

    /// Limits of joints from the actuators on them.
    fn actuators(&mut self, model: Node<'a, 'i>) {
        for section in model.children().filter(|child| child.has_tag_name("actuator")) {
            for element in section.children().filter(Node::is_element) {
                let Some(joint) = element.attribute("joint").or(element.attribute("jointinparent")) else { continue };
                let gear = element.attribute("gear").or_else(|| self.attribute(element, None, "gear"));
                let gear = gear.and_then(|text| rational::parse(text.split_whitespace().next()?));
                let gear = gear.unwrap_or_else(|| rational::integer(1));
                self.reader.geared(element, joint, gear.clone());
                let gear = rational::abs(&gear);
                let range = self.range(element, None, "forcerange", "forcelimited");
                let range = match range {
                    None if element.has_tag_name("motor") => self.range(element, None, "ctrlrange", "ctrllimited"),
                    range => range,
                };
                if let Some((low, high)) = range {
                    self.efforts.insert(joint, gear * rational::abs(&low).max(rational::abs(&high)));
                }
            }
        }
    }

    /// The two numbers of a range that counts.
    fn range(
        &mut self,
        node: Node<'a, 'i>,
        class: Option<&'a str>,
        name: &str,
        switch: &str,
    ) -> Option<(Rational, Rational)> {
        let [(low, _), (high, _)] = self.numbers::<2>(node, class, name)?;
        let counts = match self.attribute(node, class, switch) {
            Some("true") => true,
            Some("false") => false,
            _ => self.compiler.autolimits,
        };
        (counts && low < high).then_some((low, high))
    }

    /// The joints that follow others; every other equality is a fault, unless the joint that it holds is locked.
    fn equalities(&mut self, model: Node<'a, 'i>) -> Vec<Coupling<'a, 'i>> {
        let mut found = Vec::new();
        for section in model.children().filter(|child| child.has_tag_name("equality")) {
            for node in section.children().filter(Node::is_element) {
                let (kind, joint) = (node.tag_name().name(), node.attribute("joint1"));
                let held = kind == "joint" && joint.is_some_and(|joint| self.locked.contains(joint));
                if node.attribute("active") == Some("false") || held {
                    continue;
                }
                let Some(follower) = joint.filter(|_| kind == "joint") else {
                    let help = "remove the loop, or write its equations by hand";
                    self.error(node, format!("`{kind}` closes a loop, and a mechanism is a tree"), help);
                    continue;
                };
                let written = self.attribute(node, None, "polycoef").unwrap_or("0 1 0 0 0");
                let numbers: Option<Vec<Rational>> = written.split_whitespace().map(number).collect();
                match (node.attribute("joint2"), numbers.as_deref()) {
                    (Some(leader), Some([constant, factor, more @ ..])) if more.iter().all(Zero::is_zero) => {
                        let (constant, factor) = (constant.clone(), factor.clone());
                        found.push(Coupling { node, follower, leader, constant, factor });
                    }
                    _ => {
                        let message =
                            format!("`{follower}` is coupled by more than a multiple of another joint's position");
                        self.error(node, message, "lock the joint, or couple it in the model by hand");
                    }
                }
            }
        }
        found
    }

    /// Lets joints follow others.
    fn couple(&mut self, couplings: Vec<Coupling<'a, 'i>>) {
        for Coupling { node, follower, leader, constant, factor } in couplings {
            let start = |name: &str| {
                let joint = self.description.joints.iter().find(|joint| joint.name == name);
                joint.map_or_else(Rational::zero, |joint| joint.start.clone())
            };
            // Equalities hold between the distances from `ref`, which are positions where the joint has moved by `start`.
            let offset = constant - start(follower) + &factor * start(leader);
            match self.description.joints.iter_mut().find(|joint| joint.name == follower) {
                Some(joint) => {
                    joint.follows = Some(Follows { leader: leader.to_owned(), factor, offset, span: span(node) });
                }
                None => {
                    let message = format!("`{follower}` follows `{leader}` and is no joint");
                    self.error(node, message, "correct its name, or remove the equality");
                }
            }
        }
    }

    fn tendons(&mut self, model: Node<'a, 'i>) {
        for section in model.children().filter(|child| child.has_tag_name("tendon")) {
            for element in section.children().filter(Node::is_element) {
                let pulls = ["stiffness", "damping", "frictionloss", "armature"]
                    .into_iter()
                    .find(|name| !self.number(element, None, name).is_zero());
                match pulls {
                    Some(name) => {
                        let message = format!("the tendon has `{name}`, and tendons have no model here");
                        self.error(element, message, "remove it, or add its forces to the imported model by hand");
                    }
                    None => self.reader.ignore(element, "tendon"),
                }
            }
        }
    }

    /// The bodies in a body. `shift` is the origin of the parent's link in the frame of the parent's body.
    fn bodies(&mut self, parent: Node<'a, 'i>, link: &str, shift: &[Rational; 3], class: Option<&'a str>) {
        for element in parent.children().filter(Node::is_element) {
            match element.tag_name().name() {
                "body" => self.body(element, link, shift, class),
                name @ ("frame" | "replicate" | "composite" | "flexcomp" | "attach" | "include") => {
                    self.error(element, format!("`{name}` is not read here"), EXPANDED);
                }
                "inertial" | "joint" | "freejoint" => {}
                "geom" if parent.has_tag_name("body") => {}
                _ => self.reader.ignore(element, "body"),
            }
        }
    }

    fn body(&mut self, node: Node<'a, 'i>, parent: &str, shift: &[Rational; 3], outer: Option<&'a str>) {
        let class = node.attribute("childclass").or(outer);
        if let Some(unknown) = class.filter(|class| !self.defaults.has(class)) {
            self.error(node, format!("there is no class `{unknown}`"), "add it to `default`, or correct its name");
        }
        let name = self.name(node, "body");
        if !self.number(node, None, "gravcomp").is_zero() {
            let message = format!("the weight of `{name}` is compensated (`gravcomp`), which has no model here");
            self.error(node, message, "remove the attribute");
        }
        let mut origin = self.origin(node, None);
        for (component, moved) in origin.at.iter_mut().zip(shift) {
            *component = sum(component, &-moved);
        }
        let mut joints: Vec<Node<'a, 'i>> = Vec::new();
        let mut free = None;
        for element in node.children().filter(Node::is_element) {
            match (element.tag_name().name(), self.attribute(element, class, "type")) {
                ("freejoint", _) | ("joint", Some("free")) => free = Some(element),
                ("joint", _) => joints.push(element),
                _ => {}
            }
        }
        let none = || std::array::from_fn(|_| Rational::zero());
        if let Some(free) = free {
            let message = format!("`{name}` is free to move, and hangs on nothing here");
            self.reader.diagnostics.push(Diagnostic::warning(span(free), message).help(FREE));
            self.link(node, &name, &none(), class);
            return self.bodies(node, &name, &none(), class);
        }
        let (mut above, mut at) = (parent.to_owned(), none());
        let count = joints.len();
        for (index, joint) in joints.into_iter().enumerate() {
            let own = self.name(joint, "joint");
            let position = self.numbers::<3>(joint, class, "pos").map_or_else(none, |numbers| numbers.map(|(v, _)| v));
            // A joint beside the origin of a turned body: the body's frame stands first, so that all numbers stay as they are written.
            let is_turned = origin.turned.iter().any(|angle| !angle.is_zero());
            if index == 0 && is_turned && position.iter().any(|component| !component.is_zero()) {
                let frame = format!("{name}_frame");
                self.fixed(node, &above, &frame, std::mem::replace(&mut origin, Origin::none()));
                above = frame;
            }
            for ((component, to), from) in origin.at.iter_mut().zip(&position).zip(&at) {
                *component = sum(component, &(to - from));
            }
            let last = index + 1 == count;
            let child = if last { name.clone() } else { format!("{name}_{own}") };
            if !last {
                self.description.links.push(Link { between: true, ..Link::light(child.clone(), span(joint)) });
            }
            self.joint(joint, class, own, above, child.clone(), std::mem::replace(&mut origin, Origin::none()));
            (above, at) = (child, position);
        }
        if count == 0 {
            self.joined(node, parent, &name, origin);
        }
        self.link(node, &name, &at, class);
        self.bodies(node, &name, &at, class);
    }

    /// A name, or one for what has none.
    fn name(&mut self, node: Node<'a, 'i>, what: &str) -> String {
        let given = node.attribute("name").map(str::trim).filter(|name| !name.is_empty());
        given.map_or_else(
            || {
                self.unnamed += 1;
                format!("{what}_{}", self.unnamed)
            },
            str::to_owned,
        )
    }

    /// A link without inertia on a fixed joint.
    fn fixed(&mut self, node: Node<'a, 'i>, parent: &str, name: &str, origin: Origin) {
        self.description.links.push(Link::light(name.to_owned(), span(node)));
        self.joined(node, parent, name, origin);
    }

    /// A fixed joint.
    fn joined(&mut self, node: Node<'a, 'i>, parent: &str, child: &str, origin: Origin) {
        let zero = [Exact::zero(), Exact::zero(), Exact::zero()];
        self.description.joints.push(Joint {
            name: format!("{child} on {parent}"),
            span: span(node),
            kind: Kind::Fixed,
            parent: parent.to_owned(),
            child: child.to_owned(),
            origin,
            axis: (zero, String::new(), span(node)),
            limits: Limits::default(),
            damping: Rational::zero(),
            friction: Rational::zero(),
            armature: Rational::zero(),
            spring: None,
            start: Rational::zero(),
            follows: None,
        });
    }

    fn joint(
        &mut self,
        node: Node<'a, 'i>,
        class: Option<&'a str>,
        name: String,
        parent: String,
        child: String,
        origin: Origin,
    ) {
        let kind = match self.attribute(node, class, "type").unwrap_or("hinge") {
            "hinge" => Kind::Revolute,
            "slide" => Kind::Prismatic,
            other => {
                let message = format!("the joint `{name}` is of the type `{other}`, which has no model here");
                self.error(node, message, "joints are `hinge` or `slide`; the body of a free one is named as the base");
                return;
            }
        };
        let turns = kind == Kind::Revolute;
        let z = || [(Rational::zero(), "0"), (Rational::zero(), "0"), (rational::integer(1), "1")];
        let axis = self.numbers::<3>(node, class, "axis").unwrap_or_else(z);
        let written = axis.each_ref().map(|(_, text)| *text).join(" ");
        // Angles of the file, in rad.
        let degree = Some(self.compiler.unit).filter(|_| turns && !self.compiler.radian);
        let radians =
            |value: Rational| degree.map_or_else(|| value.clone(), |unit| decimal(rational::to_f64(&value) * unit));
        // `ref` is the joint's coordinate in the pose in which the file places the bodies.
        let start = -radians(self.number(node, class, "ref"));
        let rest = radians(self.number(node, class, "springref"));
        let stiffness = self.number(node, class, "stiffness");
        if stiffness.is_negative() {
            self.error(
                node,
                format!("the spring of `{name}` pushes away (`stiffness` below 0)"),
                "write a stiffness that is not negative",
            );
        }
        let spring = stiffness.is_positive().then_some(Spring { stiffness, rest });
        let mut limits = Limits::default();
        if let Some((low, high)) = self.range(node, class, "range", "limited") {
            limits.lower = Some(radians(low));
            limits.upper = Some(radians(high));
        }
        let force = self.range(node, class, "actuatorfrcrange", "actuatorfrclimited");
        let force = force.map(|(low, high)| rational::abs(&low).max(rational::abs(&high)));
        limits.effort = force.or_else(|| self.efforts.get(name.as_str()).cloned());
        let joint = Joint {
            span: span(node),
            kind,
            parent,
            child,
            origin,
            axis: (axis.map(|(value, text)| Exact::new(value, text)), written, span(node)),
            limits,
            damping: self.number(node, class, "damping"),
            friction: self.number(node, class, "frictionloss"),
            armature: self.number(node, class, "armature"),
            spring,
            start,
            follows: None,
            name,
        };
        self.description.joints.push(joint);
    }

    /// The link of a body, whose origin is `at` in the frame of the body.
    fn link(&mut self, node: Node<'a, 'i>, name: &str, at: &[Rational; 3], class: Option<&'a str>) {
        let mut link = Link::light(name.to_owned(), span(node));
        let element = node.children().find(|child| child.has_tag_name("inertial"));
        let weighed = match self.compiler.from_geoms {
            FromGeoms::Never => false,
            FromGeoms::WhereMissing => element.is_none(),
            FromGeoms::Always => true,
        };
        for geom in node.children().filter(|child| child.has_tag_name("geom")) {
            if !weighed {
                self.reader.ignore(geom, "body");
                continue;
            }
            match self.shape(geom, class, at) {
                Ok(shape) => link.inertials.extend(shape),
                Err(fault) => link.unknown = Some(*fault),
            }
        }
        if link.inertials.is_empty() && link.unknown.is_none() {
            link.inertials = element.and_then(|element| self.inertial(element, at)).into_iter().collect();
        }
        self.description.links.push(link);
    }

    /// Scales all masses to the sum that the compiler asks for.
    fn weigh(&mut self) {
        let Some(total) = self.compiler.total.clone() else { return };
        let inertials = || self.description.links.iter().flat_map(|link| &link.inertials);
        let sum: Rational = inertials().map(|inertial| &inertial.mass).sum();
        if sum <= Rational::zero() {
            return;
        }
        let factor = total / sum;
        for inertial in self.description.links.iter_mut().flat_map(|link| &mut link.inertials) {
            inertial.mass *= &factor;
            inertial.moments.iter_mut().for_each(|moment| *moment *= &factor);
        }
    }

    fn inertial(&mut self, node: Node<'a, 'i>, at: &[Rational; 3]) -> Option<Inertial> {
        let mut origin = self.origin(node, None);
        for (component, moved) in origin.at.iter_mut().zip(at) {
            *component = sum(component, &-moved);
        }
        let Some([(mass, _)]) = self.numbers::<1>(node, None, "mass") else {
            if node.attribute("mass").is_none() {
                self.error(node, "this `inertial` has no `mass`".to_owned(), "add the attribute");
            }
            return None;
        };
        let values = |numbers: [(Rational, &str); 6]| numbers.map(|(value, _)| value);
        let moments = if node.has_attribute("fullinertia") {
            let [xx, yy, zz, xy, xz, yz] = values(self.numbers::<6>(node, None, "fullinertia")?);
            [xx, xy, xz, yy, yz, zz]
        } else if node.has_attribute("diaginertia") {
            let [xx, yy, zz] = self.numbers::<3>(node, None, "diaginertia")?.map(|(value, _)| value);
            let zero = Rational::zero;
            [xx, zero(), zero(), yy, zero(), zz]
        } else {
            let message = "this `inertial` has no moments".to_owned();
            self.error(node, message, "add `diaginertia` or `fullinertia`");
            return None;
        };
        Some(Inertial { span: span(node), origin, mass, moments })
    }

    /// Position and orientation of an element, in whatever way it is written.
    fn origin(&mut self, node: Node<'a, 'i>, class: Option<&'a str>) -> Origin {
        let mut origin = Origin::none();
        let place = span(node);
        if let Some(numbers) = self.numbers::<3>(node, class, "pos") {
            origin.at = numbers.map(|(value, text)| self.reader.readings.length(value, text, place));
        }
        let unit = self.compiler.unit;
        let written = ["quat", "axisangle", "euler", "xyaxes", "zaxis"]
            .into_iter()
            .find(|name| self.attribute(node, class, name).is_some());
        let Some(written) = written else { return origin };
        let turn = match written {
            "quat" => self.floats::<4>(node, class, written).map(frame::of_quaternion),
            "axisangle" => self.floats::<4>(node, class, written).map(|[x, y, z, a]| frame::about([x, y, z], a * unit)),
            "euler" => {
                let sequence = self.compiler.eulerseq.clone();
                let angles = self.floats::<3>(node, class, written);
                angles.map(|angles| frame::of_euler(angles.map(|angle| angle * unit), &sequence))
            }
            "xyaxes" => {
                let axes = self.floats::<6>(node, class, written);
                axes.map(|[a, b, c, d, e, f]| frame::of_axes([a, b, c], [d, e, f]))
            }
            _ => self.floats::<3>(node, class, written).map(frame::of_z_axis),
        };
        match turn {
            Some(Some(turn)) => {
                let angles = frame::roll_pitch_yaw(&turn);
                origin.turned = angles.map(|angle| self.reader.readings.computed(angle, place));
            }
            Some(None) => self.error(node, format!("`{written}` is no orientation"), "its axes must not be zero"),
            None => {}
        }
        origin
    }
}

/// A number and another one beside it.
fn sum(number: &Exact, other: &Rational) -> Exact {
    if other.is_zero() {
        return number.clone();
    }
    let value = &number.value + other;
    let text = value.to_string();
    Exact::new(value, &text)
}

/// The decimal that a number prints as.
fn decimal(value: f64) -> Rational {
    rational::parse(&value.to_string()).unwrap_or_else(Rational::zero)
}
