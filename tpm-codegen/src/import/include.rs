//! Models for MuJoCo that are written in several files: elements `include` are replaced by what is in the files that they name.

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::elements::span;
use crate::import::read::well_formed;
use crate::source::Source;
use roxmltree::Document;
use std::ops::Range;

/// Most files of one description.
const MOST_FILES: usize = 200;

/// A description with all that it includes, in place of the elements that name the files. Whatever is said about it later names the file
/// that it is in. A description that includes nothing is returned as it is.
///
/// `open` reads a file: it gets the name of the file that includes it, and how it is called there.
///
/// # Errors
/// A text that names the place: a file cannot be read or is no XML, is included twice, or there are more than two hundred.
pub fn with_included(source: Source, open: impl FnMut(&str, &str) -> Result<Source, String>) -> Result<Source, String> {
    let mut expansion = Expansion { files: vec![source], parts: Vec::new(), open };
    expansion.file(0)?;
    Ok(match expansion.files.len() {
        1 => expansion.files.remove(0),
        _ => Source::of_parts(expansion.files, &expansion.parts),
    })
}

struct Expansion<F> {
    files: Vec<Source>,
    parts: Vec<(usize, Range<usize>)>,
    open: F,
}

impl<F: FnMut(&str, &str) -> Result<Source, String>> Expansion<F> {
    /// Adds the parts of a file: all of the first one, of others what is in the root element.
    fn file(&mut self, index: usize) -> Result<(), String> {
        let source = self.files[index].clone();
        let fault = |fault: Diagnostic| Diagnostics::from_iter([fault]).render(&source);
        let text = match well_formed(&source) {
            Ok((text, _)) => text,
            // The reader of descriptions says what is wrong with the first file.
            Err(_) if index == 0 => return Ok(()),
            Err(wrong) => return Err(fault(wrong)),
        };
        let document = Document::parse(&text).map_err(|error| error.to_string())?;
        let root = document.root_element();
        if index == 0 && !root.has_tag_name("mujoco") {
            return Ok(());
        }
        let inner = match (root.first_child(), root.last_child()) {
            _ if index == 0 => 0..text.len(),
            (Some(first), Some(last)) => first.range().start..last.range().end,
            _ => return Ok(()),
        };
        let mut from = inner.start;
        for node in root.descendants().filter(|node| node.has_tag_name("include")) {
            let at = node.range();
            if at.start < from {
                continue;
            }
            let wrong = |message: String, help: &str| fault(Diagnostic::error(span(node), message).help(help));
            let Some(name) = node.attribute("file") else {
                return Err(wrong("this `include` names no file".to_owned(), "add the attribute `file`"));
            };
            if self.files.len() == MOST_FILES {
                let message = format!("the description has more than {MOST_FILES} files");
                return Err(wrong(message, "put what belongs together into one file"));
            }
            let help = "correct the name: it is relative to the folder of the first file, or to that of this one";
            let opened = (self.open)(source.name(), name).map_err(|reason| wrong(reason, help))?;
            if self.files.iter().any(|file| file.name() == opened.name()) {
                let message = format!("`{}` is included a second time", opened.name());
                return Err(wrong(message, "include every file once"));
            }
            self.parts.push((index, from..at.start));
            self.files.push(opened);
            self.file(self.files.len() - 1)?;
            from = at.end;
        }
        self.parts.push((index, from..inner.end));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::with_included;
    use crate::import::{Options, import_description};
    use crate::source::Source;

    const ARM: &str = "<?xml version='1.0'?>\n<mujoco model='arm'>\n<include file='defaults.xml'/>\n<worldbody>\n\
                       <include file='links/upper.xml'/></worldbody></mujoco>";

    fn open(from: &str, name: &str) -> Result<Source, String> {
        let text = match name {
            "defaults.xml" => "<?xml version='1.0'?><mujoco><default><joint damping='0.25'/></default></mujoco>",
            "links/upper.xml" => {
                "<mujocoinclude>\n<body name='upper'><joint name='q1'/><inertial pos='0 0 1' mass='2' diaginertia='1 1 1'/>\
                 <include file='lower.xml'/></body></mujocoinclude>"
            }
            "lower.xml" if from == "links/upper.xml" => {
                "<mujoco>\n\n<body name='lower' pos='0 0 1'><joint name='q2' axis='0 1 0'/>\
                 <inertial pos='0 0 1' mass='3' diaginertia='1 1 1'/></body></mujoco>"
            }
            "wrong.xml" => "<mujoco>\n\n<body name='lower'><joint name='q2' axis='0 1'/></body></mujoco>",
            "broken.xml" => "<mujoco>\n<body></mujoco>",
            "loop.xml" => "<mujoco><include file='loop.xml'/></mujoco>",
            _ => return Err(format!("no file `{name}`")),
        };
        Ok(Source::new(name, text))
    }

    fn whole(text: &str) -> Result<Source, String> {
        with_included(Source::new("arm.xml", text), open)
    }

    #[test]
    fn files_within_files_are_as_one_file() {
        let flat = "<mujoco model='arm'><default><joint damping='0.25'/></default><worldbody><body name='upper'><joint name='q1'/>\
                    <inertial pos='0 0 1' mass='2' diaginertia='1 1 1'/><body name='lower' pos='0 0 1'><joint name='q2' axis='0 1 0'/>\
                    <inertial pos='0 0 1' mass='3' diaginertia='1 1 1'/></body></body></worldbody></mujoco>";
        let read = |source: &Source| {
            let imported = import_description(source, &Options::default());
            let imported = imported.unwrap_or_else(|faults| panic!("{}", faults.render(source)));
            (imported.model, imported.prior)
        };
        assert_eq!(read(&whole(ARM).expect("files")), read(&Source::new("arm.xml", flat)));
    }

    #[test]
    fn faults_name_the_file_that_they_are_in() {
        let arm = |name: &str| ARM.replace("defaults.xml", name);
        for (name, words) in [
            ("none.xml", ["arm.xml:3:1", "no file `none.xml`"]),
            ("broken.xml", ["broken.xml:2:", "this is no XML"]),
            ("loop.xml", ["loop.xml:1:", "`loop.xml` is included a second time"]),
            ("links/upper.xml", ["arm.xml:5:1", "`links/upper.xml` is included a second time"]),
        ] {
            let fault = whole(&arm(name)).expect_err(name);
            assert!(words.iter().all(|word| fault.contains(word)), "{name}: {fault}");
        }
        let source = whole(&ARM.replace("links/upper.xml", "wrong.xml")).expect("files");
        let faults = import_description(&source, &Options::default()).expect_err("an axis of two numbers");
        let text = faults.render(&source);
        assert!(text.contains("wrong.xml:3:20") && text.contains("`axis` is `0 1`"), "{text}");
        // What is no model for MuJoCo is left as it is.
        assert_eq!(whole("<robot><include file='none.xml'/></robot>").expect("as it is").name(), "arm.xml");
    }
}
