//! Classes of default values of MJCF.

use roxmltree::Node;
use std::collections::BTreeMap;

/// The class of what names none.
const MAIN: &str = "main";

/// Classes with their enclosing ones, and the elements that hold their values.
#[derive(Default)]
pub(super) struct Defaults<'a, 'i> {
    above: BTreeMap<&'a str, &'a str>,
    elements: BTreeMap<(&'a str, &'a str), Vec<Node<'a, 'i>>>,
}

impl<'a, 'i> Defaults<'a, 'i> {
    /// The classes of a model.
    pub(super) fn of(model: Node<'a, 'i>) -> Self {
        let mut found = Self::default();
        for section in model.children().filter(|child| child.has_tag_name("default")) {
            found.class(section, section.attribute("class").unwrap_or(MAIN));
        }
        found
    }

    fn class(&mut self, section: Node<'a, 'i>, name: &'a str) {
        for element in section.children().filter(Node::is_element) {
            match (element.tag_name().name(), element.attribute("class")) {
                ("default", Some(inner)) => {
                    self.above.insert(inner, name);
                    self.class(element, inner);
                }
                (kind, _) => self.elements.entry((name, kind)).or_default().push(element),
            }
        }
    }

    /// Whether a class is declared.
    pub(super) fn has(&self, class: &str) -> bool {
        class == MAIN || self.above.contains_key(class) || self.elements.keys().any(|(name, _)| *name == class)
    }

    /// An attribute of an element: its own, or that of the innermost class that has it. `class` is the class of the bodies around it.
    pub(super) fn attribute(&self, element: Node<'a, 'i>, class: Option<&'a str>, name: &str) -> Option<&'a str> {
        let kind = element.tag_name().name();
        let mut class = element.attribute("class").or(class).unwrap_or(MAIN);
        if let Some(own) = element.attribute(name) {
            return Some(own);
        }
        // No class is above itself, since inner ones stand within outer ones; names that are given twice could be.
        for _ in 0..=self.above.len() {
            let values = self.elements.get(&(class, kind)).into_iter().flatten().rev();
            if let Some(value) = values.filter_map(|element| element.attribute(name)).next() {
                return Some(value);
            }
            class = self.above.get(class)?;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::Defaults;
    use roxmltree::Document;

    #[test]
    fn inner_classes_go_before_outer_ones_and_elements_before_classes() {
        let text = "<mujoco><default><joint damping='1' armature='2'/><default class='a'><joint damping='3'/>\
                    <default class='b'><joint axis='1 0 0'/></default></default></default>\
                    <joint/><joint class='a'/><joint class='b' armature='5'/></mujoco>";
        let document = Document::parse(text).expect("XML");
        let model = document.root_element();
        let defaults = Defaults::of(model);
        let joints: Vec<_> = model.children().filter(|child| child.has_tag_name("joint")).collect();
        let of = |which: usize, class, name| defaults.attribute(joints[which], class, name);
        assert_eq!((of(0, None, "damping"), of(0, Some("b"), "damping")), (Some("1"), Some("3")));
        assert_eq!((of(1, None, "damping"), of(1, Some("b"), "axis")), (Some("3"), None));
        assert_eq!(
            (of(2, None, "damping"), of(2, None, "armature"), of(2, None, "axis")),
            (Some("3"), Some("5"), Some("1 0 0"))
        );
        assert!(defaults.has("b") && defaults.has("main") && !defaults.has("c"));
    }
}
