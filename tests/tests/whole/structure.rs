//! The order of crates and folders, and circles of files, as `ARCHITECTURE.md` states them. The document is what manifests and sources
//! are compared with, so that the two cannot disagree.

mod imports;

use crate::support::{folder_of, packages, root};
use imports::{Crate, Module, Sources};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What a folder may import from.
type Allowed = BTreeMap<String, BTreeSet<String>>;

/// The items of the list below a heading, each with its lines joined.
fn list_below(document: &str, heading: &str) -> Vec<String> {
    let below = document.split_once(&format!("\n## {heading}\n"));
    let (_, below) = below.unwrap_or_else(|| panic!("ARCHITECTURE.md has a section `{heading}`"));
    let section = below.split("\n## ").next().unwrap_or_default();
    let items = section.split("\n- ").skip(1).map(|item| item.split("\n\n").next().unwrap_or_default());
    items.map(|item| item.replace('\n', " ")).collect()
}

/// What stands between backticks.
fn quoted(text: &str) -> Vec<String> {
    text.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The order of a crate's folders: `CRATE`: `LOWEST`, `NEXT`, `ANOTHER` (`LOWEST` only).
fn order(document: &str, of: &str) -> Allowed {
    let items = list_below(document, "Order of folders");
    let item = items.iter().find_map(|item| item.strip_prefix(&format!("`{of}`: ")));
    let mut text = item.unwrap_or_else(|| panic!("ARCHITECTURE.md has an order of the folders of {of}"));
    let mut allowed = Allowed::new();
    let mut below = BTreeSet::new();
    while let Some((_, from_name)) = text.split_once('`') {
        let (folder, rest) = from_name.split_once('`').expect("backticks come in pairs");
        let bracket = rest.strip_prefix(" (").and_then(|rest| rest.split_once(')'));
        let (only, rest) = bracket.map_or((None, rest), |(only, rest)| (Some(quoted(only)), rest));
        let from = only.map_or_else(|| below.clone(), |only| only.into_iter().collect());
        allowed.insert(folder.to_owned(), from);
        below.insert(folder.to_owned());
        text = rest;
    }
    allowed
}

/// Circles that are harmless: the files of each.
fn harmless(document: &str) -> BTreeSet<BTreeSet<String>> {
    let items = list_below(document, "Circles of files");
    let circle = |item: &String| {
        let (files, reason) = item.split_once(": ").unwrap_or_else(|| panic!("no reason is given: {item}"));
        assert!(!reason.trim().is_empty(), "no reason is given: {item}");
        quoted(files).into_iter().collect()
    };
    items.iter().map(circle).collect()
}

/// Imports from folders that the importing folder may not know, one a line.
fn violations(of: &Crate, allowed: &Allowed) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    // The root declares the folders and hands names on; whatever it imports stands above them all.
    for import in of.imports().iter().filter(|import| !import.from.is_empty()) {
        let folder = |module: &Module| module.first().cloned().unwrap_or_else(|| "the crate's root".to_owned());
        let (from, to) = (folder(&import.from), folder(&import.to));
        if from != to && !allowed.get(&from).is_some_and(|allowed| allowed.contains(&to)) {
            let (file, other) = (of.file_of(&import.from), of.file_of(&import.to));
            found.insert(format!("{file} imports from {other}: `{from}` must not know `{to}`"));
        }
    }
    found
}

/// Circles of files, largest sets, each with the imports that close it.
fn circles(of: &Crate) -> BTreeMap<BTreeSet<String>, String> {
    let mut edges: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for import in of.imports().iter().filter(|import| import.needed) {
        let (from, to) = (of.file_of(&import.from).to_owned(), of.file_of(&import.to).to_owned());
        if from != to {
            edges.entry(from).or_default().insert(to);
        }
    }
    let reach: BTreeMap<&String, BTreeSet<&String>> = edges.keys().map(|file| (file, reached(&edges, file))).collect();
    let mut circles = BTreeMap::new();
    for (file, far) in &reach {
        let back = |other: &&&String| reach.get(**other).is_some_and(|far| far.contains(file));
        let circle: BTreeSet<String> = far.iter().filter(back).map(|other| (*other).clone()).collect();
        if circle.is_empty() {
            continue;
        }
        let mut shown = String::new();
        for from in &circle {
            let to: Vec<&str> = edges[from].intersection(&circle).map(String::as_str).collect();
            let _ = writeln!(shown, "  {from} imports from {}", to.join(", "));
        }
        circles.insert(circle, shown);
    }
    circles
}

/// Files that a file's imports lead to, directly or through others.
fn reached<'a>(edges: &'a BTreeMap<String, BTreeSet<String>>, file: &str) -> BTreeSet<&'a String> {
    let mut reached = BTreeSet::new();
    let mut open: Vec<&String> = edges.get(file).into_iter().flatten().collect();
    while let Some(file) = open.pop() {
        if reached.insert(file) {
            open.extend(edges.get(file).into_iter().flatten());
        }
    }
    reached
}

/// The sources below a folder, by their path from there.
fn sources(folder: &Path) -> Sources {
    fn gather(folder: &Path, prefix: &str, sources: &mut Sources) {
        for entry in std::fs::read_dir(folder).expect("a folder of the project") {
            let path = entry.expect("readable").path();
            let name = format!("{prefix}{}", path.file_name().expect("an entry has a name").to_string_lossy());
            if path.is_dir() {
                gather(&path, &format!("{name}/"), sources);
            } else if name.ends_with(".rs") {
                sources.insert(name, std::fs::read_to_string(&path).expect("source code is text"));
            }
        }
    }
    let mut sources = Sources::new();
    gather(folder, "", &mut sources);
    sources
}

/// A member of the workspace: its folder below the workspace's, and the crates of the workspace that it is built on, without their
/// common prefix.
struct Member {
    name: String,
    folder: PathBuf,
    needs: BTreeSet<String>,
}

fn members() -> Vec<Member> {
    let short = |name: &Value| name.as_str().and_then(|name| name.strip_prefix("tpm-")).map(str::to_owned);
    let packages = packages();
    let own: BTreeSet<String> = packages.iter().filter_map(|package| short(&package["name"])).collect();
    let member = |package: &Value| {
        let dependencies = package["dependencies"].as_array().expect("a list").iter();
        let needs = dependencies.filter(|needed| needed["kind"].is_null()).filter_map(|needed| short(&needed["name"]));
        Member {
            name: short(&package["name"]).expect("named like the others"),
            folder: folder_of(package).strip_prefix(root()).expect("in the workspace").to_owned(),
            needs: needs.filter(|name| own.contains(name)).collect(),
        }
    };
    packages.iter().map(member).collect()
}

/// Crates whose only purpose is to test or to show the others.
const BESIDE: [&str; 4] = ["benches", "models", "test-support", "tests"];

/// Pairs of a crate and one that it is built on, without those that follow from others.
fn needed_directly(members: &[Member]) -> BTreeSet<(String, String)> {
    let needs: BTreeMap<&str, &BTreeSet<String>> = members.iter().map(|m| (m.name.as_str(), &m.needs)).collect();
    fn reaches(needs: &BTreeMap<&str, &BTreeSet<String>>, from: &str, to: &str) -> bool {
        needs[from].iter().any(|next| next == to || reaches(needs, next, to))
    }
    let mut found = BTreeSet::new();
    for member in members.iter().filter(|member| !BESIDE.contains(&member.name.as_str())) {
        for to in &member.needs {
            if !member.needs.iter().any(|other| reaches(&needs, other, to)) {
                found.insert((member.name.clone(), to.clone()));
            }
        }
    }
    found
}

#[test]
fn crates_are_built_on_each_other_as_drawn() {
    let document = document();
    let drawing = document.split_once("```mermaid\n").and_then(|(_, rest)| rest.split_once("```"));
    let (drawing, _) = drawing.expect("ARCHITECTURE.md has a drawing of the crates");
    let arrows = drawing.lines().filter_map(|line| line.trim().split_once(" --> "));
    let drawn: BTreeSet<(String, String)> = arrows.map(|(from, to)| (from.to_owned(), to.to_owned())).collect();
    let present = needed_directly(&members());
    let missing: Vec<_> = present.difference(&drawn).collect();
    let gone: Vec<_> = drawn.difference(&present).collect();
    assert!(missing.is_empty() && gone.is_empty(), "not drawn: {missing:?}; drawn, but not there: {gone:?}");
}

fn document() -> String {
    std::fs::read_to_string(root().join("ARCHITECTURE.md")).expect("the document")
}

#[test]
fn folders_import_from_those_below_them() {
    let mut found = String::new();
    for name in ["tpm-symbolic"] {
        let sources = sources(&root().join(name).join("src"));
        let (of, order) = (Crate::read("lib.rs", &sources), order(&document(), name));
        let named: BTreeSet<&str> = order.keys().map(String::as_str).collect();
        assert_eq!(of.folders(), named, "the folders of {name} (left) are those in ARCHITECTURE.md (right)");
        for violation in violations(&of, &order) {
            let _ = writeln!(found, "{name}/src/{violation}");
        }
    }
    assert!(found.is_empty(), "against the order of folders in ARCHITECTURE.md:\n{found}");
}

#[test]
fn files_import_each_other_in_no_circle() {
    let harmless = harmless(&document());
    let mut present = BTreeSet::new();
    let mut found = String::new();
    for member in members() {
        let name = member.folder.display().to_string();
        let sources = sources(&root().join(&member.folder).join("src"));
        let is_root = |file: &&String| ["lib.rs", "main.rs"].contains(&file.as_str()) || file.starts_with("bin/");
        for file in sources.keys().filter(is_root) {
            for (circle, shown) in circles(&Crate::read(file, &sources)) {
                let circle: BTreeSet<String> = circle.iter().map(|file| format!("{name}/src/{file}")).collect();
                if !harmless.contains(&circle) {
                    let _ = writeln!(found, "{name}/src:\n{shown}");
                }
                present.insert(circle);
            }
        }
    }
    assert!(found.is_empty(), "circles that ARCHITECTURE.md does not name:\n{found}");
    let gone: Vec<_> = harmless.difference(&present).collect();
    assert!(gone.is_empty(), "ARCHITECTURE.md names circles that are there no longer: {gone:?}");
}

/// A crate in memory.
fn small(files: &[(&str, &str)]) -> Crate {
    Crate::read("lib.rs", &files.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect())
}

const DOCUMENT: &str = "# Made up\n\n## Order of folders\n\nSome words.\n\n- `small`: `number`, `algebra`,\n  `linear` (`number`)\n- `other`: `a`\n\n## Circles of files\n\nNone.\n";

#[test]
fn an_order_is_read_from_its_list() {
    let set = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<BTreeSet<_>>();
    let expected = [("number", set(&[])), ("algebra", set(&["number"])), ("linear", set(&["number"]))];
    assert_eq!(order(DOCUMENT, "small"), expected.map(|(name, set)| (name.to_owned(), set)).into());
    assert_eq!(order(DOCUMENT, "other"), [("a".to_owned(), set(&[]))].into());
    assert_eq!(harmless(DOCUMENT), BTreeSet::new());
    let named = DOCUMENT.replace("None.", "Few.\n\n- `a.rs`,\n  `b.rs`: they are one\n  thought.");
    assert_eq!(harmless(&named), [set(&["a.rs", "b.rs"])].into());
}

#[test]
fn an_import_from_above_is_found_however_it_is_written() {
    let order = order(DOCUMENT, "small");
    let found = |number: &str| {
        let of = small(&[
            ("lib.rs", "pub mod algebra;\npub mod linear;\npub mod number;\npub use algebra::Sum;"),
            ("algebra/mod.rs", "mod sum;\npub use sum::Sum;\npub use crate::number::Digit as Figure;"),
            ("algebra/sum.rs", "use crate::number::Digit;\npub struct Sum(Digit);"),
            ("linear.rs", "use super::number::{self, Digit};\npub struct Line(Digit);"),
            ("number/mod.rs", &format!("mod text;\npub struct Digit;\n{number}")),
            ("number/text.rs", "use super::Digit;"),
        ]);
        violations(&of, &order).len()
    };
    for fine in [
        "",
        "// use crate::algebra::Sum;\n/// `crate::algebra::Sum`\nfn f() { g(\"crate::algebra::Sum\") }",
        "#[cfg(test)]\nmod tests {\n use crate::algebra::Sum;\n}",
        "#[cfg(all(test, feature = \"std\"))]\nuse crate::algebra::Sum;\nfn f() {}",
        "#[cfg(test)]\nmod missing;",
        "fn f() { self::text::g(); super::number::text::g(); ::algebra::g(); x.algebra::<T>() }",
        "use crate::algebra::Figure;",
        "use std::algebra::Sum;\nuse algebra::Sum;",
    ] {
        assert_eq!(found(fine), 0, "{fine}");
    }
    for above in [
        "use crate::algebra::Sum;",
        "use crate::algebra;",
        "use crate::Sum;",
        "use crate::{algebra::{Sum as S}, number::Digit};",
        "use super::algebra::*;",
        "pub(crate) use super::algebra::Sum;",
        "fn f() -> crate::algebra::Sum { g() }",
        "macro_rules! sum { () => { $crate::algebra::Sum }; }",
        "mod inner { pub fn f() { super::super::linear::g(0..crate::linear::N) } }",
        "fn f() { use crate::linear; linear::g(); }",
        "#[cfg(not(test))]\nuse crate::algebra::Sum;",
    ] {
        assert_eq!(found(above), 1, "{above}");
    }
    let of = small(&[
        ("lib.rs", "mod algebra; mod linear;"),
        ("algebra.rs", "pub struct Sum;"),
        ("linear.rs", "use crate::algebra::Sum;"),
    ]);
    let said = violations(&of, &order).into_iter().collect::<String>();
    assert_eq!(said, "linear.rs imports from algebra.rs: `linear` must not know `algebra`");
}

#[test]
fn circles_are_seen_through_facades() {
    let sum = "use super::Product;\npub struct Sum(Product);";
    let files = |product| {
        [
            ("lib.rs", "mod algebra;"),
            ("algebra/mod.rs", "mod sum;\nmod product;\npub use sum::Sum;\npub use self::product::Product;"),
            ("algebra/sum.rs", sum),
            ("algebra/product.rs", product),
        ]
    };
    assert_eq!(circles(&small(&files("pub struct Product;"))), BTreeMap::new());
    let found = circles(&small(&files("use crate::algebra;\npub struct Product(Box<algebra::Sum>);")));
    let both = BTreeSet::from(["algebra/product.rs".to_owned(), "algebra/sum.rs".to_owned()]);
    assert_eq!(found.keys().collect::<Vec<_>>(), [&both]);
    // A variant of the name of what is handed on is no use of it.
    let mut facade = files("pub struct Product;");
    facade[1].1 = "mod sum;\nmod product;\npub use sum::Sum;\npub struct Product;\nenum Of { Sum, Other }";
    assert_eq!(circles(&small(&facade)), BTreeMap::new());
    // A facade that works with what it hands on belongs to the circle.
    facade[1].1 = "mod sum;\nmod product;\npub use sum::Sum;\npub struct Product;\nfn f(of: Sum) {}";
    let both = BTreeSet::from(["algebra/mod.rs".to_owned(), "algebra/sum.rs".to_owned()]);
    assert_eq!(circles(&small(&facade)).keys().collect::<Vec<_>>(), [&both]);
}
