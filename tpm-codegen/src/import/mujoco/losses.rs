//! A model for MuJoCo with identified numbers of its joints, and every other byte as it was.
//!
//! A joint is that of the coordinate whose name an import would give it. Joints that follow another one by an equality brake it: of all of
//! them the number changes by the same factor, so that their sum at the leading joint is what was identified.

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::identified::{Identified, IdentifiedParameter};
use crate::import::arrange::identifier;
use crate::import::description::Spring;
use crate::import::elements::span;
use crate::import::mujoco::defaults::Defaults;
use crate::import::options::STRIBECK;
use crate::import::replace::{Edit, edited, new_number};
use crate::source::Source;
use roxmltree::Node;
use std::collections::{BTreeMap, BTreeSet};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};

/// Most joints of which each follows the next.
const LONGEST_CHAIN: usize = 100;

/// Attributes of a joint with the parameters that they hold, and the power of the factor of a joint that follows with which it counts at the
/// leading one.
const OF_JOINTS: [(&str, &str, i32); 4] =
    [("armature", "Ia", 2), ("damping", "fv", 2), ("frictionloss", "fc", 1), ("stiffness", Spring::SYMBOL, 2)];

/// Elements of actuators with the attributes that are gains of a loop; the parameters have their names.
const OF_ACTUATORS: [(&str, &[&str]); 3] =
    [("position", &["kp", "kv"]), ("intvelocity", &["kp", "kv"]), ("velocity", &["kv"])];

/// The text of a model for MuJoCo with new numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct WithLosses {
    /// The text.
    pub text: String,
    /// One sentence for everything that the file does not hold, with what stands in its place.
    pub lost: Vec<String>,
}

/// Writes the values of a result's parameters `Ia_q` (armature, kg m^2 or kg), `fv_q` (damping, N m s/rad or N s/m), `fc_q` (frictionloss,
/// N m or N), `ks_q` (stiffness, N m/rad or N/m), `kp_q` and `kv_q` (gains of actuators on the joint) into the joint of the coordinate
/// `q`. A number that the joint takes from a class is written at the joint itself, since other joints share the class. A comment with
/// `note` goes behind the root element, where there is one.
///
/// # Errors
/// When the text is no XML or no model for MuJoCo, the values are of another model, no joint is that of a coordinate, or two joints are that
/// of one.
pub fn with_losses(
    source: &Source,
    model: &ExactModel,
    identified: &Identified,
    note: Option<&str>,
) -> Result<WithLosses, Diagnostics> {
    let (text, lost) = edited(source, |root| {
        let mut writing = Writing::of(root, model, identified)?;
        for coordinate in model.coordinates.iter().map(|own| own.name.as_str()) {
            writing.coordinate(coordinate, root);
        }
        writing.left_over();
        if let Some(note) = note {
            let end = root.range().end;
            // Two hyphens would end the comment.
            writing.edits.push((end..end, format!("\n<!-- {} -->", note.replace("--", "- -"))));
        }
        Ok((writing.edits, writing.lost))
    })?;
    Ok(WithLosses { text, lost })
}

struct Writing<'m, 'a, 'i> {
    model: &'m ExactModel,
    values: BTreeMap<&'m str, Option<f64>>,
    defaults: Defaults<'a, 'i>,
    joints: BTreeMap<&'m str, Node<'a, 'i>>,
    /// Of joints that follow, the leading joint and the factor.
    leaders: BTreeMap<&'a str, (&'a str, f64)>,
    named: BTreeMap<&'a str, Node<'a, 'i>>,
    used: BTreeSet<String>,
    edits: Vec<Edit>,
    lost: Vec<String>,
}

impl<'m, 'a, 'i> Writing<'m, 'a, 'i> {
    fn of(root: Node<'a, 'i>, model: &'m ExactModel, identified: &'m Identified) -> Result<Self, Diagnostics> {
        let fault = |node, message: String, help: &str| {
            Err(Diagnostics::from_iter([Diagnostic::error(span(node), message).help(help)]))
        };
        let kind = root.tag_name().name();
        if !["mujoco", "mujocoinclude"].contains(&kind) {
            return fault(root, format!("`{kind}` is no model for MuJoCo"), "give the file that MuJoCo loads");
        }
        // Joints of classes, equalities and actuators are none of a body.
        let in_body = |node: &Node<'_, '_>| node.parent().is_some_and(|own| own.has_tag_name("body"));
        let named: BTreeMap<&str, Node<'_, '_>> = (root.descendants())
            .filter(|node| node.has_tag_name("joint") && in_body(node))
            .filter_map(|node| Some((node.attribute("name")?.trim(), node)))
            .collect();
        let mut joints = BTreeMap::new();
        for (name, node) in &named {
            let own = identifier(name, &[], &mut BTreeSet::new());
            let Some(coordinate) = model.coordinates.iter().find(|coordinate| coordinate.name == own) else { continue };
            if joints.insert(coordinate.name.as_str(), *node).is_some() {
                return fault(*node, format!("a second joint is read as `{own}`"), "give one of them another name");
            }
        }
        if identified.model != model.name {
            let message = format!("the values are of the model `{}`, not of `{}`", identified.model, model.name);
            return fault(root, message, "give a result of this model");
        }
        if joints.is_empty() {
            let names: Vec<String> = model.coordinates.iter().map(|own| format!("`{}`", own.name)).collect();
            let message = format!("no joint of this file has the name of a coordinate: {}", names.join(", "));
            return fault(root, message, "name the joints as the coordinates; joints may stand in an included file");
        }
        let parameters = identified.parameters.iter().chain(&identified.physical);
        let values = parameters.map(|own: &IdentifiedParameter| (own.name.as_str(), own.value)).collect();
        let (defaults, leaders) = (Defaults::of(root), leaders(root));
        let (used, edits, lost) = (BTreeSet::new(), Vec::new(), Vec::new());
        Ok(Self { model, values, defaults, joints, leaders, named, used, edits, lost })
    }

    /// The value of a parameter of a coordinate; what the file cannot hold of it is noted.
    fn value(&mut self, symbol: &str, coordinate: &str, attribute: &str) -> Option<f64> {
        let name = parameter_name(symbol, coordinate);
        let known = self.values.get(name.as_str());
        if known.is_none() && self.model.find_symbol(&name).is_none() {
            return None;
        }
        self.used.insert(name.clone());
        let (value, why) = match known.copied().flatten() {
            None => {
                (None, format!("`{name}` has no value of its own: `{attribute}` of `{coordinate}` stays as it was"))
            }
            Some(value) if value < 0.0 => {
                let instead = format!("MuJoCo has no negative `{attribute}`: `{coordinate}` has 0 in its place");
                (Some(0.0), format!("`{name}` is {value}, and {instead}"))
            }
            value => return value,
        };
        // Two actuators on a joint ask for the same gain.
        if !self.lost.contains(&why) {
            self.lost.push(why);
        }
        value
    }

    fn coordinate(&mut self, coordinate: &str, root: Node<'a, 'i>) {
        let Some(joint) = self.joints.get(coordinate).copied() else {
            self.lost.push(format!("`{coordinate}` has no joint in this file: nothing of it is written"));
            return;
        };
        for (attribute, symbol, power) in OF_JOINTS {
            if let Some(value) = self.value(symbol, coordinate, attribute) {
                self.joint(joint, attribute, value, power);
            }
        }
        let [more, rate] = STRIBECK.map(|symbol| parameter_name(symbol, coordinate));
        if self.values.contains_key(more.as_str()) {
            self.lost.push(format!(
                "`{more}`, the dry friction that falls with the rate: `frictionloss` of `{coordinate}` is the friction at high rates alone"
            ));
            self.used.extend([more, rate]);
        }
        let constant = parameter_name(Loss::Offset.symbol(), coordinate);
        if self.values.contains_key(constant.as_str()) {
            self.lost.push(format!("`{constant}`, the constant torque on `{coordinate}`: nothing stands in its place"));
            self.used.insert(constant);
        }
        let name = joint.attribute("name");
        let drives = root.descendants().filter(|node| node.parent().is_some_and(|own| own.has_tag_name("actuator")));
        for drive in drives.filter(|node| node.attribute("joint").is_some() && node.attribute("joint") == name) {
            let Some((_, gains)) = OF_ACTUATORS.iter().find(|(kind, _)| drive.has_tag_name(*kind)) else { continue };
            for gain in *gains {
                let geared = self.defaults.attribute(drive, None, "gear").is_some_and(|gear| factor(gear) != Some(1.0));
                match self.value(gain, coordinate, gain) {
                    Some(_) if geared => self.lost.push(format!(
                        "`{}` counts at the joint, and the actuator of `{coordinate}` has a gear: `{gain}` stays as it was",
                        parameter_name(gain, coordinate)
                    )),
                    Some(value) => self.edits.push(new_number(drive, gain, value)),
                    None => {}
                }
            }
        }
    }

    /// A number at a joint and at those that follow it.
    fn joint(&mut self, joint: Node<'a, 'i>, attribute: &str, value: f64, power: i32) {
        let name = joint.attribute("name").map_or("", str::trim);
        let mut shares = vec![(joint, self.effective(joint, attribute), 1.0)];
        for (follower, node) in &self.named {
            if let Some((leader, factor)) = self.led(follower)
                && leader == name
            {
                shares.push((*node, self.effective(*node, attribute), factor.abs().powi(power)));
            }
        }
        let sum: f64 = shares.iter().map(|(_, own, weight)| own * weight).sum();
        if shares.len() == 1 || sum <= 0.0 {
            self.edits.push(new_number(joint, attribute, value));
            return;
        }
        let parts = shares.into_iter().filter(|(_, own, _)| *own != 0.0);
        self.edits.extend(parts.map(|(node, own, _)| new_number(node, attribute, value * own / sum)));
    }

    /// The number that a joint has, its own or that of its class.
    fn effective(&self, joint: Node<'a, 'i>, attribute: &str) -> f64 {
        let class = joint.ancestors().find_map(|node| node.attribute("childclass"));
        self.defaults.attribute(joint, class, attribute).and_then(factor).unwrap_or(0.0)
    }

    /// The joint at the end of a chain of joints that follow each other, and the factor.
    fn led(&self, follower: &str) -> Option<(&'a str, f64)> {
        let (mut leader, mut factor) = *self.leaders.get(follower)?;
        for _ in 0..LONGEST_CHAIN {
            let Some((next, own)) = self.leaders.get(leader) else { break };
            (leader, factor) = (next, factor * own);
        }
        Some((leader, factor))
    }

    /// What of the result was not written, in one sentence.
    fn left_over(&mut self) {
        let left = self.values.keys().filter(|name| !self.used.contains(**name));
        let left: Vec<String> = left.map(|name| format!("`{name}`")).collect();
        if !left.is_empty() {
            self.lost.push(format!("{}: what the file says of it stays as it was", left.join(", ")));
        }
    }
}

/// The leading joints of joints that follow others, with the factors.
fn leaders<'a>(root: Node<'a, '_>) -> BTreeMap<&'a str, (&'a str, f64)> {
    let couplings = root.descendants().filter(|node| {
        let in_section = node.parent().is_some_and(|own| own.has_tag_name("equality"));
        node.has_tag_name("joint") && in_section && node.attribute("active") != Some("false")
    });
    let led = couplings.filter_map(|node| {
        let written = node.attribute("polycoef").unwrap_or("0 1 0 0 0");
        let factor = written.split_whitespace().nth(1).and_then(factor)?;
        Some((node.attribute("joint1")?.trim(), (node.attribute("joint2")?.trim(), factor)))
    });
    led.collect()
}

/// The first number of an attribute.
fn factor(text: &str) -> Option<f64> {
    text.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::with_losses;
    use crate::identified::Identified;
    use crate::language::parse_model;
    use crate::source::Source;
    use std::collections::BTreeMap;
    use tpm_symbolic::mechanics::model::ExactModel;

    /// Two links with every loss of their drives, a spring, and loops whose gains are parameters.
    const ARM: &str = "model Arm { coordinate q1 [rad], j_2 [rad]; input u1 [N*m], u2 [N*m];
        parameter ks_q1 [N*m/rad], fs_q1 [N*m], kp_q1 [N*m/rad], kv_q1 [N*m*s/rad], kp_j_2 [N*m];
        mechanism { gravity (0, 0, -9.81); body a { revolute q1 about y; inertia parameters; } body b on a { revolute j_2 about y at (1, 0, 0); inertia parameters; }
            drive q1 by u1 with viscous, coulomb, offset, rotor; drive j_2 by u2 with viscous, coulomb, rotor; }
        force q1 = -ks_q1*q1 - fs_q1*sign(dot(q1)) - kp_q1*q1 - kv_q1*dot(q1); force j_2 = -kp_j_2*sin(j_2); }";

    /// Comments, tabs, both kinds of quotes, numbers in many forms, a prefix that is not declared, a class and two joints that lead others.
    const ROBOT: &str = "<?xml version=\"1.0\"?>\r\n<!-- <joint name='q1' damping='9'/> -->\n<mujoco>\n\t<default><joint damping='0.1'/>\
        <position gear='1'/><default class=\"dry\"><joint frictionloss=\"0.5\" armature='.01'/></default></default>\n<worldbody>\n<body name='a'>\
        <joint name=\"q1\" damping = '2.50e-1' \t stiffness=\"7\"  frictionloss=\"1\" armature='0'/>  <geom size=\".1\" damping='5'/>\n\
        <body childclass='dry'><joint axis='0 1 0' name='2'/><body><joint name='finger' damping='0.2' frictionloss='0'/>\
        <other:joint name='q1' damping='3'/></body></body></body></worldbody>\n<actuator><position joint='q1' kp=\"1\"/>\
        <velocity joint='q1' kv='3'/><position joint='2' gear='50' kp='8'/><motor joint='q1' gear='3'/></actuator>\n<equality><joint joint1='finger' joint2='2' polycoef='0 -2 0 0 0'/></equality>\
        <sensor><jointpos joint='q1'/></sensor>\n</mujoco>\n\n";

    const VALUES: [(&str, f64); 14] = [
        ("Ia_q1", 0.02),
        ("fv_q1", 0.75),
        ("fc_q1", 1.5),
        ("f0_q1", 0.3),
        ("ks_q1", 9.0),
        ("fs_q1", 0.4),
        ("kp_q1", 12.0),
        ("kv_q1", -2.0),
        ("kp_j_2", 70.0),
        ("Ia_j_2", 0.1),
        ("fv_j_2", 1.8),
        ("fc_j_2", 0.25),
        ("mx_a", 4.0),
        ("m_b", 3.0),
    ];

    fn model() -> ExactModel {
        let source = Source::new("arm.tpm", ARM);
        parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source))).model
    }

    fn values(list: &[(&str, f64)]) -> Identified {
        let values: BTreeMap<String, f64> = list.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        Identified::of_values("Arm", &values)
    }

    #[test]
    fn nothing_but_the_numbers_of_joints_and_loops_changes() {
        let written = with_losses(&Source::new("robot.xml", ROBOT), &model(), &values(&VALUES), None).expect("joints");
        // The second joint has 0.1 and twice 0.2 over two: 0.1 + 4 0.2 become 1.8, its frictions and armatures 0.5 and 0.01 + 4 0.01.
        let expected = [
            ("damping = '2.50e-1'", "damping = '0.75'"),
            ("stiffness=\"7\"", "stiffness=\"9\""),
            ("frictionloss=\"1\"", "frictionloss=\"1.5\""),
            ("armature='0'/>  <geom", "armature='0.02'/>  <geom"),
            ("<joint axis='0 1 0'", "<joint armature=\"0.02\" damping=\"0.2\" frictionloss=\"0.25\" axis='0 1 0'"),
            ("<joint name='finger' damping='0.2'", "<joint armature=\"0.02\" name='finger' damping='0.4'"),
            ("kp=\"1\"/>", "kv=\"0\" kp=\"12\"/>"),
            ("kv='3'", "kv='0'"),
        ];
        let mut text = ROBOT.to_owned();
        for (old, new) in expected {
            assert_eq!(text.matches(old).count(), 1, "{old}");
            text = text.replace(old, new);
        }
        let text = text.replace("<position joint='q1' kv=\"0\" kp", "<position kv=\"0\" joint='q1' kp");
        assert_eq!(written.text, text);
        for part in ["`fs_q1`", "`f0_q1`", "`kv_q1` is -2", "`kp_j_2` counts at the joint", "`m_b`, `mx_a`"] {
            let count = written.lost.iter().filter(|own| own.contains(part)).count();
            assert_eq!(count, 1, "{part}: {:?}", written.lost);
        }
    }

    #[test]
    fn a_note_is_a_comment_behind_the_root_and_nothing_known_changes_nothing() {
        let source = Source::new("robot.xml", ROBOT);
        let none = with_losses(&source, &model(), &values(&[]), Some("not -- trusted")).expect("joints");
        assert_eq!(none.text, ROBOT.replace("</mujoco>", "</mujoco>\n<!-- not - - trusted -->"));
        assert!(none.lost.iter().any(|own| own.contains("`fv_q1` has no value of its own")), "{:?}", none.lost);
        roxmltree::Document::parse(&none.text.replace("other:", "other_")).expect("still XML");
    }

    #[test]
    fn what_is_no_file_of_this_machine_is_refused() {
        let twice = ROBOT.replace("name='finger'", "name='j-2'");
        let other = Identified { model: "Other".to_owned(), ..Identified::default() };
        for (text, known, said) in [
            ("<robot name='r'/>", values(&[]), "no model for MuJoCo"),
            (
                "<mujoco><worldbody><body><joint name='q3'/></body></worldbody></mujoco>",
                values(&[]),
                "no joint of this file",
            ),
            (twice.as_str(), values(&[]), "a second joint"),
            (ROBOT, other, "of the model `Other`"),
            ("<mujoco>", values(&[]), "no XML"),
        ] {
            let fault = with_losses(&Source::new("robot.xml", text), &model(), &known, None).expect_err(said);
            assert!(fault.to_string().contains(said), "{fault}");
        }
    }
}
