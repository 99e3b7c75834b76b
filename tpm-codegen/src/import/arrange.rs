//! Conversion of links and joints to the bodies of a mechanism.
//!
//! Invariant: every body comes after its parent. Links that are fixed to each other move as one. Their inertias are
//! added to the inertia of the link on the moving joint that carries them.

use std::collections::{BTreeMap, BTreeSet};

use num_traits::{Signed, Zero};
use tpm_symbolic::expr::graph::{ExprId, Graph};
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::mechanics::tree::rotation::{Angle, Rotation};
use tpm_symbolic::mechanics::tree::{NAMES, about_origin, fault};
use tpm_symbolic::number::rational::{self, Rational};

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::description::{Description, Follows, Inertial, Joint, Kind, Limits, Link, Origin, Spring};
use crate::import::frame;
use crate::import::options::{Options, STRIBECK};
use crate::import::reading::{Exact, ExactAngle, Readings, is_angle};
use crate::language::function::Function;
use crate::source::Span;

/// Most joints of which each follows the next.
const LONGEST_CHAIN: usize = 100;

/// A robot in the terms of the language.
pub(super) struct Robot {
    pub(super) name: String,
    pub(super) bodies: Vec<Body>,
    /// Acceleration of gravity in the frame of the base, m/s^2.
    pub(super) gravity: [Exact; 3],
    /// The name of the pattern's frequency in the model.
    pub(super) frequency: String,
}

/// A body of the mechanism.
pub(super) struct Body {
    pub(super) name: String,
    /// The parent body; `None` for the base.
    pub(super) parent: Option<usize>,
    pub(super) origin: Origin,
    /// Joint and inertia of a body on a moving joint; `None` for a body on a fixed joint.
    pub(super) moving: Option<Moving>,
}

/// Joint and inertia of a body on a moving joint.
pub(super) struct Moving {
    /// The names of joint and link in the description.
    pub(super) joint: String,
    pub(super) link: String,
    /// The name of the joint in the model: its coordinate, unless it follows another joint.
    pub(super) coordinate: String,
    /// The body on whose joint's coordinate this joint moves, and its factor; a joint that follows has no input and no losses of its own.
    pub(super) follows: Option<(usize, Rational)>,
    pub(super) input: String,
    /// The name of the joint's amplitude in the pattern.
    pub(super) amplitude: String,
    /// The name of the middle of a sliding joint's motion: numbers of the language are angles or without unit.
    pub(super) centre: String,
    pub(super) turns: bool,
    /// The axis in the spelling of the language.
    pub(super) axis: String,
    /// The axis as a unit vector in the frame of the joint.
    pub(super) direction: [Rational; 3],
    pub(super) limits: Limits,
    pub(super) damping: Rational,
    pub(super) friction: Rational,
    pub(super) armature: Rational,
    pub(super) spring: Option<Spring>,
    /// Damping and friction of this joint alone, as the description has them: those above count at the joint that leads.
    pub(super) alone: [Rational; 2],
    /// The ten parameters about the frame of the body, of all links that move with it.
    pub(super) inertia: [Rational; 10],
    /// The links that are fixed to this one and have an inertia, each with its ten parameters about the frame of the body.
    pub(super) attached: Vec<(String, [Rational; 10])>,
}

/// The frame of a link relative to a body on a moving joint, or to the base.
#[derive(Clone)]
struct Place {
    carrier: Option<usize>,
    origin: [Rational; 3],
    rotation: Rotation,
    /// The last written body to which the link is fixed.
    body: Option<usize>,
}

/// The bodies of the selected part of the description; faults go to `diagnostics`.
pub(super) fn arrange(
    description: Description,
    options: &Options,
    readings: &mut Readings<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Robot> {
    let mut arranger = Arranger {
        description: &description,
        readings,
        diagnostics,
        links: BTreeMap::new(),
        joints: BTreeMap::new(),
        children: BTreeMap::new(),
        above: BTreeMap::new(),
        taken: BTreeSet::new(),
        bodies: Vec::new(),
    };
    arranger.index();
    let base = arranger.base(options)?;
    let kept = arranger.kept(base, options)?;
    let locked = arranger.locked(options);
    if arranger.diagnostics.has_errors() {
        return None;
    }
    arranger.walk(base, &kept, &locked);
    arranger.follow();
    arranger.massless();
    if arranger.bodies.iter().all(|body| body.moving.is_none()) {
        let fault = Diagnostic::error(description.span, "no joint of this part of the description moves");
        arranger.diagnostics.push(fault.help("name another base or tip, or lock fewer joints"));
    }
    let name = type_name(&description.name);
    // The names of the description go before those of the pattern.
    for moving in arranger.bodies.iter_mut().filter_map(|body| body.moving.as_mut()) {
        moving.amplitude = identifier(&format!("A_{}", moving.coordinate), &[], &mut arranger.taken);
        moving.centre = identifier(&format!("c_{}", moving.coordinate), &[], &mut arranger.taken);
    }
    let frequency = identifier("w", &[], &mut arranger.taken);
    let gravity = description.gravity.clone();
    Some(Robot { name, bodies: arranger.bodies, gravity, frequency })
}

/// The joint that moves another one, whose position is the factor times its position, and the offset.
struct Led<'a> {
    leader: &'a str,
    factor: Rational,
    offset: Rational,
}

struct Arranger<'a, 'r, 's> {
    description: &'a Description,
    readings: &'r mut Readings<'s>,
    diagnostics: &'r mut Diagnostics,
    links: BTreeMap<&'a str, &'a Link>,
    joints: BTreeMap<&'a str, &'a Joint>,
    /// The joints by their parents, in the order of the text.
    children: BTreeMap<&'a str, Vec<&'a Joint>>,
    /// The joint above each link.
    above: BTreeMap<&'a str, &'a Joint>,
    /// Names already used in the model.
    taken: BTreeSet<String>,
    bodies: Vec<Body>,
}

impl<'a> Arranger<'a, '_, '_> {
    fn error(&mut self, span: Span, message: String, help: &str) {
        self.diagnostics.push(Diagnostic::error(span, message).help(help));
    }

    fn warning(&mut self, span: Span, message: String, help: &str) {
        self.diagnostics.push(Diagnostic::warning(span, message).help(help));
    }

    /// Finds links and joints by their names.
    fn index(&mut self) {
        for link in &self.description.links {
            if let Some(first) = self.links.insert(&link.name, link) {
                let fault = Diagnostic::error(link.span, format!("the link `{}` is given twice", link.name));
                self.diagnostics.push(fault.label(first.span, "the first one").help("rename or remove one of them"));
            }
        }
        for joint in &self.description.joints {
            if let Some(first) = self.joints.insert(&joint.name, joint) {
                let fault = Diagnostic::error(joint.span, format!("the joint `{}` is given twice", joint.name));
                self.diagnostics.push(fault.label(first.span, "the first one").help("rename or remove one of them"));
            }
            for link in [&joint.parent, &joint.child] {
                if !self.links.contains_key(link.as_str()) {
                    let message = format!("the joint `{}` joins `{link}`, which is no link", joint.name);
                    self.error(joint.span, message, "add the link, or correct its name");
                }
            }
            if let Some(first) = self.above.insert(&joint.child, joint) {
                let message = format!("the link `{}` hangs on two joints, so that the links form a loop", joint.child);
                let fault = Diagnostic::error(joint.span, message);
                self.diagnostics
                    .push(fault.label(first.span, "the first one").help("a mechanism is a tree: remove a joint"));
            }
            if joint.kind != Kind::Fixed && joint.axis.0.iter().all(|component| component.value.is_zero()) {
                let message = format!("the axis of the joint `{}` is zero", joint.name);
                self.error(joint.axis.2, message, "write a direction, such as `<axis xyz=\"0 0 1\"/>`");
            }
            self.children.entry(&joint.parent).or_default().push(joint);
        }
    }

    /// The link that does not move.
    fn base(&mut self, options: &Options) -> Option<&'a str> {
        if let Some(base) = &options.base {
            return self.known(base, "base");
        }
        let links = &self.description.links;
        let mut roots: Vec<&Link> = links.iter().filter(|link| !self.above.contains_key(link.name.as_str())).collect();
        // A free body stands still where nothing else moves: beside it is a world, perhaps with fixed things on it.
        let moves = |root: &Link| {
            let joints = self.reached(&root.name).into_iter().filter_map(|link| self.children.get(link)).flatten();
            joints.into_iter().any(|joint| joint.kind != Kind::Fixed)
        };
        let reached: BTreeSet<&str> = roots.iter().flat_map(|root| self.reached(&root.name)).collect();
        if let (2.., Some(only)) = (roots.len(), one(roots.iter().copied().filter(|root| moves(root)))) {
            for aside in roots.iter().filter(|root| root.name != only.name) {
                let message = format!("the link `{}` hangs on nothing and moves nothing: it is left out", aside.name);
                self.warning(aside.span, message, "name the base (`--base LINK`) where it is another one");
            }
            roots = vec![only];
        }
        match roots.as_slice() {
            [root] => {
                if let Some(link) = links.iter().find(|link| !reached.contains(link.name.as_str())) {
                    let message = format!("the link `{}` hangs on itself in a loop of joints", link.name);
                    self.error(link.span, message, "a mechanism is a tree: remove a joint of the loop");
                }
                Some(&root.name)
            }
            [] if links.is_empty() => {
                let message = "the description has no link".to_owned();
                self.error(self.description.span, message, "export the description again, links and joints with it");
                None
            }
            [] => {
                let message = "every link hangs on another one, in a loop".to_owned();
                self.error(self.description.span, message, "a mechanism is a tree: remove a joint of the loop");
                None
            }
            // A joint that could not be read leaves its link without a parent.
            [_, _, ..] if self.diagnostics.has_errors() => None,
            [first, second, ..] => {
                let message = format!("the description has {} roots: `{}`, `{}`", roots.len(), first.name, second.name);
                let fault = Diagnostic::error(second.span, message).label(first.span, "the first one");
                self.diagnostics.push(fault.help("join them, or name the base whose links are wanted"));
                None
            }
        }
    }

    fn known(&mut self, name: &str, what: &str) -> Option<&'a str> {
        let found = self.links.get(name).map(|link| link.name.as_str());
        if found.is_none() {
            let names = self.links.keys().copied().collect::<Vec<_>>().join(", ");
            let message = format!("the {what} `{name}` is no link of this description");
            self.error(self.description.span, message, &format!("the links are {names}"));
        }
        found
    }

    /// The links outward of a link, including itself.
    fn reached(&self, from: &'a str) -> BTreeSet<&'a str> {
        let mut reached = BTreeSet::new();
        let mut open = vec![from];
        while let Some(link) = open.pop() {
            if reached.insert(link) {
                let joints = self.children.get(link).into_iter().flatten();
                open.extend(joints.map(|joint| joint.child.as_str()));
            }
        }
        reached
    }

    /// The links from the base to the tip; `Some(None)` when every link is kept, `None` after a fault.
    fn kept(&mut self, base: &'a str, options: &Options) -> Option<Option<BTreeSet<&'a str>>> {
        let Some(tip) = &options.tip else { return Some(None) };
        let tip = self.known(tip, "tip")?;
        let mut path = BTreeSet::from([tip]);
        let mut current = tip;
        while current != base {
            match self.above.get(current) {
                Some(joint) if path.insert(&joint.parent) => current = &joint.parent,
                _ => {
                    let message = format!("the tip `{tip}` is not outward of the base `{base}`");
                    self.error(self.description.span, message, "name a link that the base carries");
                    return None;
                }
            }
        }
        Some(Some(path))
    }

    /// Positions of the joints that are held fixed.
    fn locked(&mut self, options: &Options) -> BTreeMap<String, Rational> {
        let mut locked = BTreeMap::new();
        for (name, text) in &options.locked {
            let joint = self.description.joints.iter().find(|joint| joint.name == *name && joint.kind != Kind::Fixed);
            if joint.is_none() {
                let moving = self.description.joints.iter().filter(|joint| joint.kind != Kind::Fixed);
                let names = moving.map(|joint| joint.name.as_str()).collect::<Vec<_>>().join(", ");
                let message = format!("`{name}` is to be locked and is no joint that moves");
                self.error(self.description.span, message, &format!("the joints that move are {names}"));
            }
            let turns = joint.is_some_and(|joint| joint.kind == Kind::Revolute);
            match rational::parse(text) {
                Some(value) if turns && !is_angle(&value) => {
                    let message =
                        format!("`{name}` is to be locked at {text} rad, of which no place is left after whole turns");
                    self.error(self.description.span, message, "write an angle within a turn, in rad");
                }
                Some(value) => {
                    locked.insert(name.clone(), value);
                }
                None => {
                    let message = format!("`{name}` is to be locked at `{text}`, which is no number");
                    self.error(self.description.span, message, "write a decimal number, in rad or m");
                }
            }
        }
        // A joint that follows a locked one is locked where its factor and offset put it.
        let followers =
            self.description.joints.iter().filter(|joint| {
                joint.kind != Kind::Fixed && joint.follows.is_some() && !locked.contains_key(&joint.name)
            });
        let places = followers.filter_map(|joint| {
            let led = self.led(joint, |leader| locked.contains_key(leader))?;
            Some((joint.name.clone(), &led.factor * locked.get(led.leader)? + led.offset))
        });
        let places: Vec<(String, Rational)> = places.collect();
        locked.extend(places);
        locked
    }

    /// The bodies outward of the base.
    fn walk(&mut self, base: &'a str, kept: &Option<BTreeSet<&'a str>>, locked: &BTreeMap<String, Rational>) {
        let rest = Place {
            carrier: None,
            origin: std::array::from_fn(|_| Rational::zero()),
            rotation: Rotation::identity(),
            body: None,
        };
        let carrying = self.carrying(kept, locked);
        let mut open: Vec<(&Joint, Place)> = Vec::new();
        let push = |open: &mut Vec<(&'a Joint, Place)>, joints: Option<&Vec<&'a Joint>>, place: &Place| {
            let joints = joints.into_iter().flatten().rev();
            open.extend(joints.map(|joint| (*joint, place.clone())));
        };
        push(&mut open, self.children.get(base), &rest);
        while let Some((joint, parent)) = open.pop() {
            let held = joint.kind == Kind::Fixed || locked.contains_key(&joint.name);
            if !held && kept.as_ref().is_some_and(|path| !path.contains(joint.child.as_str())) {
                let message = format!(
                    "the joint `{}` is not between base and tip; it is left out with all that it carries",
                    joint.name
                );
                self.warning(joint.span, message, "lock it to keep what it carries");
                continue;
            }
            let place = if held {
                let position = locked.get(&joint.name);
                let moves = carrying.contains(joint.child.as_str());
                self.held(joint, position, &parent, moves)
            } else {
                self.moving(joint, &parent)
            };
            if let Some(link) = self.links.get(joint.child.as_str()) {
                if let Some(unknown) = link.unknown.as_ref().filter(|_| place.carrier.is_some()) {
                    self.diagnostics.push(unknown.clone());
                }
                link.inertials.iter().for_each(|inertial| self.load(&joint.child, inertial, &place));
            }
            push(&mut open, self.children.get(joint.child.as_str()), &place);
        }
    }

    /// The links that carry a moving joint, at themselves or outward of them.
    fn carrying(&self, kept: &Option<BTreeSet<&'a str>>, locked: &BTreeMap<String, Rational>) -> BTreeSet<&'a str> {
        let moving = self.description.joints.iter().filter(|joint| {
            joint.kind != Kind::Fixed
                && !locked.contains_key(&joint.name)
                && kept.as_ref().is_none_or(|path| path.contains(joint.child.as_str()))
        });
        let mut carrying = BTreeSet::new();
        for joint in moving {
            let mut link = Some(joint.parent.as_str());
            // The walk ends at a link that is in the set, since all links between this one and the base are there too.
            while let Some(found) = link.filter(|link| carrying.insert(*link)) {
                link = self.above.get(found).map(|joint| joint.parent.as_str());
            }
        }
        carrying
    }

    /// A link on a joint that does not move. It becomes a body of the text only where it carries a moving link.
    fn held(&mut self, joint: &Joint, position: Option<&Rational>, parent: &Place, carries: bool) -> Place {
        let origin = match position {
            Some(value) => self.advanced(joint, value),
            None => joint.origin.clone(),
        };
        let mut place = placed(parent, &origin);
        if carries {
            let name = identifier(&joint.child, &[], &mut self.taken);
            self.bodies.push(Body { name, parent: parent.body, origin, moving: None });
            place.body = Some(self.bodies.len() - 1);
        }
        place
    }

    /// The frame of a joint at a position.
    fn advanced(&mut self, joint: &Joint, position: &Rational) -> Origin {
        let (mut origin, by) = (joint.origin.clone(), position + &joint.start);
        if by.is_zero() {
            return origin;
        }
        let (axis, _) = self.readings.axis(&joint.axis.0, &joint.axis.1, joint.axis.2);
        let rotation = rotation_of(&origin);
        if joint.kind == Kind::Prismatic {
            for (i, component) in origin.at.iter_mut().enumerate() {
                let along: Rational = (0..3).map(|j| rotation.entry(i, j) * &axis[j]).sum();
                let moved = &component.value + along * &by;
                let text = moved.to_string();
                *component = Exact::new(moved, &text);
            }
            return origin;
        }
        let own = axis.iter().position(|component| rational::abs(component) == rational::integer(1));
        let plain = origin.turned.iter().all(ExactAngle::is_zero);
        let by = rational::to_f64(&by);
        match own.filter(|_| plain) {
            Some(index) => {
                let signed = if axis[index].is_negative() { -by } else { by };
                origin.turned[index] = self.readings.computed(signed, joint.span);
            }
            // Three angles for two turns, one after the other: rounded here, once.
            None => {
                let turn = std::array::from_fn(|i| std::array::from_fn(|j| rational::to_f64(rotation.entry(i, j))));
                let own = frame::about(axis.each_ref().map(rational::to_f64), by).unwrap_or(frame::NONE);
                let angles = frame::roll_pitch_yaw(&frame::product(&turn, &own));
                origin.turned = angles.map(|angle| self.readings.computed(angle, joint.span));
            }
        }
        origin
    }

    /// A link on a joint that moves.
    fn moving(&mut self, joint: &'a Joint, parent: &Place) -> Place {
        let (direction, axis) = self.readings.axis(&joint.axis.0, &joint.axis.1, joint.axis.2);
        let turns = joint.kind == Kind::Revolute;
        let coordinate = match joint.follows {
            Some(_) => identifier(&joint.name, &[], &mut self.taken),
            None => {
                let mut symbols = Loss::ALL.map(Loss::symbol).to_vec();
                symbols.extend(STRIBECK);
                symbols.push(Spring::SYMBOL);
                self.renamed(&joint.name, "joint", &symbols, joint.span)
            }
        };
        let offset = match self.led(joint, |_| false) {
            Some(led) if turns && !is_angle(&led.offset) => {
                let message = format!("the offset of the joint `{}` is beyond all angles", joint.name);
                self.error(joint.span, message, "write an angle within a turn, in rad");
                Rational::zero()
            }
            Some(led) => led.offset,
            None => Rational::zero(),
        };
        let origin = self.advanced(joint, &offset);
        // Of a joint that follows another one with an offset, the model has the position without it.
        let end = |limit: &Option<Rational>| limit.as_ref().map(|limit| limit - &offset);
        let input = identifier(&format!("{}_{coordinate}", if turns { "tau" } else { "force" }), &[], &mut self.taken);
        let name = self.renamed(&joint.child, "link", &NAMES, joint.span);
        let index = self.bodies.len();
        self.bodies.push(Body {
            name,
            parent: parent.body,
            origin,
            moving: Some(Moving {
                joint: joint.name.clone(),
                link: joint.child.clone(),
                coordinate,
                follows: None,
                input,
                amplitude: String::new(),
                centre: String::new(),
                turns,
                axis,
                direction,
                limits: Limits {
                    lower: end(&joint.limits.lower),
                    upper: end(&joint.limits.upper),
                    velocity: joint.limits.velocity.clone(),
                    effort: joint.limits.effort.clone(),
                },
                damping: joint.damping.clone(),
                friction: joint.friction.clone(),
                armature: joint.armature.clone(),
                spring: joint.spring.clone().map(|own| Spring { rest: own.rest - &offset, ..own }),
                alone: [joint.damping.clone(), joint.friction.clone()],
                inertia: std::array::from_fn(|_| Rational::zero()),
                attached: Vec::new(),
            }),
        });
        Place {
            carrier: Some(index),
            origin: std::array::from_fn(|_| Rational::zero()),
            rotation: Rotation::identity(),
            body: Some(index),
        }
    }

    /// Lets joints that follow others move by the coordinates of these, which also get their losses and keep their limits.
    fn follow(&mut self) {
        let described = &self.description.joints;
        let joint_of = |body: &Body| {
            let joint = &body.moving.as_ref()?.joint;
            described.iter().find(|own| own.name == *joint)
        };
        let joints: Vec<Option<&Joint>> = self.bodies.iter().map(joint_of).collect();
        for (index, joint) in joints.iter().enumerate() {
            let Some((joint, follows)) = joint.and_then(|joint| Some((joint, joint.follows.as_ref()?))) else {
                continue;
            };
            let Some(led) = self.led(joint, |_| false) else {
                let message = format!("the joint `{}` follows itself over other joints", joint.name);
                self.diagnostics.push(Diagnostic::error(follows.span, message).help("let one of them lead"));
                continue;
            };
            let name = led.leader;
            let leader = joints.iter().position(|own| own.is_some_and(|own| own.name == *name));
            let (fault, help) = match leader {
                _ if led.factor.is_zero() => (format!("0 times `{name}`"), "lock it".to_owned()),
                None => (
                    format!("`{name}`, which does not move here"),
                    format!("lock it, or let `{name}` move, and keep it"),
                ),
                Some(leader) => {
                    self.lead(leader, index, &led.factor);
                    continue;
                }
            };
            self.error(follows.span, format!("the joint `{}` follows {fault}", joint.name), &help);
        }
    }

    /// The joint at the end of a chain of joints that follow each other, or the first in it at which `ends` is true; `None` for a joint that
    /// follows none, and where the chain has no end.
    fn led(&self, joint: &'a Joint, ends: impl Fn(&str) -> bool) -> Option<Led<'a>> {
        let Follows { leader, factor, offset, .. } = joint.follows.as_ref()?;
        let mut led = Led { leader, factor: factor.clone(), offset: offset.clone() };
        for _ in 0..LONGEST_CHAIN {
            let further = self.joints.get(led.leader).and_then(|joint| joint.follows.as_ref());
            let Some(next) = further.filter(|_| !ends(led.leader)) else { return Some(led) };
            led.offset += &led.factor * &next.offset;
            led.factor *= &next.factor;
            led.leader = &next.leader;
        }
        None
    }

    /// Gives the joint of a body to that of another one, which it follows: powers are equal, so that losses move with the factor or its
    /// square, and the leader keeps the limits of both.
    fn lead(&mut self, leader: usize, follower: usize, factor: &Rational) {
        let Some(own) = self.bodies[follower].moving.as_mut() else { return };
        own.follows = Some((leader, factor.clone()));
        let size = rational::abs(factor);
        let square = &size * &size;
        let taken = [&mut own.damping, &mut own.friction, &mut own.armature];
        let [damping, friction, armature] = taken.map(|loss| std::mem::replace(loss, Rational::zero()));
        let over = |limit: &Option<Rational>, by: &Rational| limit.as_ref().map(|limit| limit / by);
        let mut ends = [over(&own.limits.lower, factor), over(&own.limits.upper, factor)];
        if factor.is_negative() {
            ends.reverse();
        }
        let velocity = over(&own.limits.velocity, &size);
        let spring = own.spring.take();
        let Some(leading) = self.bodies[leader].moving.as_mut() else { return };
        leading.damping += damping * &square;
        leading.friction += friction * size;
        leading.armature += armature * &square;
        if let Some(Spring { stiffness, rest }) = spring {
            let own = Spring { stiffness: stiffness * square, rest: rest / factor };
            leading.spring = Some(own.beside(leading.spring.take()));
        }
        let [lower, upper] = ends;
        let limits = &mut leading.limits;
        limits.lower = limits.lower.take().max(lower);
        limits.upper = limits.upper.take().into_iter().chain(upper).min();
        // Descriptions write a velocity of zero where nobody knew it.
        let known = |velocity: &Rational| !velocity.is_zero();
        limits.velocity = limits.velocity.take().into_iter().chain(velocity).filter(known).min();
    }

    /// An identifier for a name and for its parameters with these symbols, with a report where it differs from the name.
    fn renamed(&mut self, name: &str, what: &str, symbols: &[&str], span: Span) -> String {
        let identifier = identifier(name, symbols, &mut self.taken);
        if identifier != name {
            let message = format!("the {what} `{name}` is called `{identifier}` in the model");
            self.warning(span, message, "a name of the language has letters, digits and `_`, and stands for one thing");
        }
        identifier
    }

    /// Adds the inertia of a link to the body that carries it.
    fn load(&mut self, link: &str, inertial: &Inertial, place: &Place) {
        if let Some(fault) = fault(&inertial.mass, &inertial.moments) {
            let message = format!("no body has the inertia of the link `{link}`: {fault}");
            let help = "the prior has it all the same; correct the description, or weigh and measure the link";
            self.warning(inertial.span, message, help);
        }
        let Some(moving) = place.carrier.and_then(|carrier| self.bodies[carrier].moving.as_mut()) else {
            return;
        };
        let turned = place.rotation.times(&rotation_of(&inertial.origin));
        let centre: [Rational; 3] = std::array::from_fn(|i| {
            let offset: Rational = (0..3).map(|j| place.rotation.entry(i, j) * &inertial.origin.at[j].value).sum();
            &place.origin[i] + offset
        });
        let graph = &mut Graph::new();
        let mass = graph.number(inertial.mass.clone());
        let centre: [ExprId; 3] = centre.map(|component| graph.number(component));
        let moments: [ExprId; 6] = inertial.moments.clone().map(|moment| graph.number(moment));
        let values = about_origin(graph, mass, &centre, &moments, &turned);
        let own = values.map(|value| graph.as_number(value).cloned().unwrap_or_else(Rational::zero));
        for (sum, value) in moving.inertia.iter_mut().zip(&own) {
            *sum += value;
        }
        if moving.link != link {
            match moving.attached.last_mut().filter(|(name, _)| name == link) {
                Some((_, sum)) => sum.iter_mut().zip(own).for_each(|(sum, value)| *sum += value),
                None => moving.attached.push((link.to_owned(), own)),
            }
        }
    }

    /// Warns of bodies without mass in the description.
    fn massless(&mut self) {
        let names: Vec<String> = self
            .bodies
            .iter()
            .filter(|body| body.moving.as_ref().is_some_and(|moving| moving.inertia[0].is_zero()))
            .map(|body| body.name.clone())
            .collect();
        for name in names {
            let link = self.description.links.iter().find(|link| link.name == name);
            if link.is_some_and(|link| link.between) {
                continue;
            }
            let span = link.map_or(self.description.span, |link| link.span);
            let message = format!("the link `{name}` moves and has no mass in the description");
            self.warning(span, message, "its prior is zero; add an `inertial` to it");
        }
    }
}

/// The only element.
fn one<T>(mut elements: impl Iterator<Item = T>) -> Option<T> {
    elements.next().filter(|_| elements.next().is_none())
}

pub(super) fn rotation_of(origin: &Origin) -> Rotation {
    let angles: [Angle; 3] = origin.turned.each_ref().map(|turned| turned.angle.clone());
    Rotation::roll_pitch_yaw(&angles)
}

/// The place of a frame that is fixed to another one.
fn placed(parent: &Place, origin: &Origin) -> Place {
    Place {
        carrier: parent.carrier,
        origin: std::array::from_fn(|i| {
            let offset: Rational = (0..3).map(|j| parent.rotation.entry(i, j) * &origin.at[j].value).sum();
            &parent.origin[i] + offset
        }),
        rotation: parent.rotation.times(&rotation_of(origin)),
        body: parent.body,
    }
}

/// An unused name in the syntax of the language: letters, digits and `_`. The parameters of what it names, one for each of `symbols`, have
/// unused names too.
pub(super) fn identifier(name: &str, symbols: &[&str], taken: &mut BTreeSet<String>) -> String {
    let mut text: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if text.starts_with(|c: char| c.is_ascii_digit()) || text.trim_matches('_').is_empty() {
        text.insert_str(0, "j_");
    }
    let names = |text: &str| -> Vec<String> {
        let parameters = symbols.iter().map(|symbol| parameter_name(symbol, text));
        std::iter::once(text.to_owned()).chain(parameters).collect()
    };
    let means_something = |text: &str| ["t", "pi"].contains(&text) || Function::from_name(text).is_some();
    while means_something(&text) || names(&text).iter().any(|name| taken.contains(name)) {
        text.push('_');
    }
    taken.extend(names(&text));
    text
}

/// A name in the form of a type's name.
fn type_name(name: &str) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let text: String = words
        .map(|word| {
            let (first, rest) = word.split_at(1);
            first.to_ascii_uppercase() + rest
        })
        .collect();
    if text.starts_with(|c: char| c.is_ascii_alphabetic()) { text } else { format!("Robot{text}") }
}
