//! A description with new inertias and frictions, and every other byte as it was.

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::described::JointLosses;
use crate::import::split::text;
use crate::import::xml::with_prefixes;
use crate::source::{Source, Span};
use roxmltree::{Document, Node};
use std::collections::BTreeMap;
use std::ops::Range;
use tpm_symbolic::mechanics::tree::AboutCentre;

/// The text of a URDF in which links have new inertias, by their names, and joints that have `dynamics` new frictions. A link without an
/// `inertial` gets one as its first element. Elements of other names are not touched.
///
/// # Errors
/// When the text is no XML or no URDF.
pub fn with_inertials(
    source: &Source,
    links: &BTreeMap<String, AboutCentre>,
    losses: &BTreeMap<String, JointLosses>,
) -> Result<String, Diagnostics> {
    let edits = |root: Node<'_, '_>| {
        if !root.has_tag_name("robot") {
            let fault = Diagnostic::error(Span::default(), format!("`{}` is no URDF", root.tag_name().name()));
            return Err(Diagnostics::from_iter([fault.help("a model for MuJoCo is written whole, by `mjcf`")]));
        }
        let mut edits: Vec<Edit> = Vec::new();
        for element in root.children().filter(Node::is_element) {
            let name = element.attribute("name").map_or("", str::trim);
            match element.tag_name().name() {
                "link" => edits.extend(links.get(name).map(|inertia| new_inertial(element, inertia))),
                "joint" => edits.extend(losses.get(name).into_iter().flat_map(|losses| new_dynamics(element, losses))),
                _ => {}
            }
        }
        Ok((edits, ()))
    };
    edited(source, edits).map(|(text, ())| text)
}

/// What stands at a place from now on.
pub(super) type Edit = (Range<usize>, String);

/// The text of a description with edits that follow from its root element, and every other byte as it was.
///
/// # Errors
/// When the text is no XML, and those of `edits`.
pub(super) fn edited<T>(
    source: &Source,
    edits: impl FnOnce(Node<'_, '_>) -> Result<(Vec<Edit>, T), Diagnostics>,
) -> Result<(String, T), Diagnostics> {
    let no_xml = |error: roxmltree::Error| {
        let fault = Diagnostic::error(Span::default(), format!("this is no XML: {error}"));
        Diagnostics::from_iter([fault.help("give the description that was imported")])
    };
    // The mended text is as long as the source, so that a place in one is the same place in the other.
    let (mended, _) = with_prefixes(source.text()).map_err(no_xml)?;
    let document = Document::parse(&mended).map_err(no_xml)?;
    let (mut edits, more) = edits(document.root_element())?;
    edits.sort_by_key(|(range, _)| range.start);
    let mut text = source.text().to_owned();
    for (range, new) in edits.into_iter().rev() {
        text.replace_range(range, &new);
    }
    Ok((text, more))
}

/// A number in an attribute of an element, which is added where the element does not state it.
pub(super) fn new_number(element: Node<'_, '_>, name: &str, value: f64) -> Edit {
    match element.attribute_node(name) {
        Some(attribute) => (attribute.range_value(), format!("{value}")),
        None => {
            let at = element.range().start + 1 + element.tag_name().name().len();
            (at..at, format!(" {name}=\"{value}\""))
        }
    }
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    // The last one counts where there are several, as when a description is read.
    node.children().rfind(|child| child.has_tag_name(name))
}

/// The white space before an element on its line, from the end of the line above; nothing where other text stands there.
fn indent(text: &str, start: usize) -> &str {
    let from = text[..start].rfind('\n').unwrap_or(0);
    let before = &text[from..start];
    if before.trim().is_empty() { before } else { "" }
}

fn new_inertial(link: Node<'_, '_>, inertia: &AboutCentre) -> Edit {
    let text = link.document().input_text();
    if let Some(old) = child(link, "inertial") {
        return (old.range(), inertial(inertia, indent(text, old.range().start)));
    }
    let (range, outer) = (link.range(), indent(text, link.range().start));
    let step = if outer.is_empty() { "" } else { "  " };
    let inner = format!("{outer}{step}");
    let new = format!("{inner}{}", inertial(inertia, &inner));
    match link.first_child() {
        Some(first) => (first.range().start..first.range().start, new),
        None => {
            let own = &text[range.clone()];
            // Without children the element is `<link .../>` or `<link ...></link>`.
            let open = own
                .strip_suffix("/>")
                .map_or_else(|| own[..own.rfind("</").unwrap_or(own.len())].trim_end_matches('>'), str::trim_end);
            (range.clone(), format!("{open}>{new}{outer}</link>"))
        }
    }
}

/// The element; `indent` begins each of its lines.
fn inertial(inertia: &AboutCentre, indent: &str) -> String {
    let inner = if indent.is_empty() { String::new() } else { format!("{indent}  ") };
    let [x, y, z] = inertia.centre.each_ref().map(text);
    let [xx, xy, xz, yy, yz, zz] = inertia.moments.each_ref().map(text);
    format!(
        "<inertial>{inner}<mass value=\"{}\"/>{inner}<origin rpy=\"0 0 0\" xyz=\"{x} {y} {z}\"/>{inner}\
         <inertia ixx=\"{xx}\" ixy=\"{xy}\" ixz=\"{xz}\" iyy=\"{yy}\" iyz=\"{yz}\" izz=\"{zz}\"/>{indent}</inertial>",
        text(&inertia.mass)
    )
}

/// The values in `dynamics` that are known; a value that the element does not state is added to it.
fn new_dynamics(joint: Node<'_, '_>, losses: &JointLosses) -> Vec<Edit> {
    let Some(dynamics) = child(joint, "dynamics") else { return Vec::new() };
    let known = [("damping", losses.damping), ("friction", losses.friction)];
    known.into_iter().filter_map(|(name, value)| Some(new_number(dynamics, name, value?))).collect()
}

#[cfg(test)]
mod tests {
    use super::with_inertials;
    use crate::import::{Described, JointLosses, Options, decimal};
    use crate::source::Source;
    use std::collections::BTreeMap;
    use tpm_symbolic::mechanics::tree::AboutCentre;
    use tpm_symbolic::number::rational::to_f64;

    /// Links without an inertial in every form, and one with a flange that is heavier than both may be.
    const ARM: &str = "<robot name='r'><link name='base'/>\n  <link name='a' />\n  <link name='b'></link>\n  <link name=\"c\">\n    <visual/>\n  \
        </link><link name='flange'><inertial><mass value='5'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>\
        <joint name='j1' type='revolute'><parent link='base'/><child link='a'/><axis xyz='0 0 1'/><dynamics friction='1'/></joint>\
        <joint name='j2' type='revolute'><parent link='a'/><child link='b'/><axis xyz='0 1 0'/></joint>\
        <joint name='j3' type='revolute'><parent link='b'/><child link='c'/><axis xyz='0 1 0'/></joint>\
        <joint name='end' type='fixed'><parent link='c'/><child link='flange'/></joint></robot>";
    const BODY: [f64; 10] = [2.0, 0.2, 0.0, 0.1, 0.1, 0.01, 0.0, 0.12, 0.0, 0.12];

    fn described(text: &str) -> Described {
        let source = Source::new("r.urdf", text);
        Described::read(&source, &Options::default()).unwrap_or_else(|faults| panic!("{}", faults.render(&source)))
    }

    #[test]
    fn links_of_every_form_get_their_inertia() {
        let values = ["a", "b", "c"].map(|name| (name.to_owned(), BODY)).into_iter().collect();
        let parted = described(ARM).split(&values).expect("possible");
        // No body has two kilograms without a flange of five.
        assert_eq!(parted.emptied, ["flange"]);
        assert_eq!(parted.links["flange"], AboutCentre::nothing());
        let losses = JointLosses { damping: Some(0.5), friction: Some(0.25), rotor: None };
        let losses = ["j1", "j2"].map(|joint| (joint.to_owned(), losses)).into_iter().collect();
        let text = with_inertials(&Source::new("r.urdf", ARM), &parted.links, &losses).expect("XML");
        assert!(text.contains("<dynamics damping=\"0.5\" friction='0.25'/>"), "{text}");
        assert_eq!(text.matches("<dynamics").count(), 1, "{text}");
        let again = described(&text);
        for body in again.bodies() {
            assert_eq!(body.inertia, &parted.bodies[body.name], "{}", body.name);
        }
        assert_eq!(again.bodies().count(), 3);
    }

    /// A gripper of which one finger follows the other, each with friction of its own: both elements stay, and what is read back of them is
    /// the friction of the coordinate.
    #[test]
    fn a_joint_that_follows_keeps_its_dynamics() {
        const GRIPPER: &str = "<robot name='g'><link name='base'/><link name='a'/><link name='b'/>\
            <joint name='lead' type='prismatic'><parent link='base'/><child link='a'/><axis xyz='0 1 0'/><dynamics damping='4'/></joint>\
            <joint name='follow' type='prismatic'><parent link='base'/><child link='b'/><axis xyz='0 1 0'/>\
            <mimic joint='lead' multiplier='-2'/><dynamics damping='0.5' friction='0.75'/></joint></robot>";
        let own = described(GRIPPER);
        let of = |name: &str, read: &Described| {
            let body = read.bodies().find(|body| body.joint == name).expect("a joint");
            [body.damping, body.friction].map(to_f64)
        };
        // 4 + 2^2 0.5, and 2 0.75.
        assert_eq!([of("lead", &own), of("follow", &own)], [[6.0, 1.5], [0.0, 0.0]]);
        for (damping, friction) in [(Some(3.0), Some(0.5)), (Some(0.0), None), (None, Some(2.0)), (None, None)] {
            let losses = BTreeMap::from([("lead".to_owned(), JointLosses { damping, friction, rotor: Some(1.0) })]);
            let joints = own.frictions_of_joints(&losses);
            let text =
                with_inertials(&Source::new("g.urdf", GRIPPER), &BTreeMap::new(), &joints).expect("a description");
            assert_eq!(text.matches("<dynamics").count(), 2, "{text}");
            let wanted = [damping.unwrap_or(6.0), friction.unwrap_or(1.5)];
            assert_eq!(of("lead", &described(&text)), wanted, "{text}");
            assert_eq!(text.contains("<dynamics damping='0.5' friction='0.75'/>"), (damping, friction) == (None, None));
        }
        // Friction that nobody described is that of the joint that leads.
        let silent = GRIPPER.replace(" friction='0.75'", "");
        let losses =
            BTreeMap::from([("lead".to_owned(), JointLosses { friction: Some(2.0), ..JointLosses::default() })]);
        let joints = described(&silent).frictions_of_joints(&losses);
        let text = with_inertials(&Source::new("g.urdf", silent), &BTreeMap::new(), &joints).expect("a description");
        assert!(text.contains("friction=\"2\"") && text.contains("<dynamics damping='0.5'/>"), "{text}");
    }

    #[test]
    fn what_no_body_has_is_not_written() {
        let impossible = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 3.0];
        assert_eq!(decimal(&impossible), None);
        for values in [impossible, [f64::NAN; 10]] {
            let values = BTreeMap::from([("b".to_owned(), values)]);
            assert!(described(ARM).split(&values).is_err());
        }
        let other = with_inertials(&Source::new("r.xml", "<mujoco/>"), &BTreeMap::new(), &BTreeMap::new());
        assert!(other.is_err_and(|faults| faults.to_string().contains("no URDF")));
        assert!(with_inertials(&Source::new("r.urdf", "<robot>"), &BTreeMap::new(), &BTreeMap::new()).is_err());
    }
}
