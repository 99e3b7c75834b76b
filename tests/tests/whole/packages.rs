//! What is published: every package is complete, small, and described.

use crate::support::{folder_of, packages, root};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Categories of crates.io that packages here may name; any other word is refused there.
const CATEGORIES: [&str; 11] = [
    "algorithms",
    "command-line-utilities",
    "compilers",
    "development-tools::build-utils",
    "development-tools::procedural-macro-helpers",
    "embedded",
    "mathematics",
    "no-std::no-alloc",
    "science",
    "science::robotics",
    "simulation",
];

/// What is published.
const PUBLISHED: [&str; 24] = [
    "tpm-campaign",
    "tpm-cli",
    "tpm-codegen",
    "tpm-controller",
    "tpm-document",
    "tpm-elementary",
    "tpm-estimate",
    "tpm-experiment",
    "tpm-frequency",
    "tpm-inertia",
    "tpm-interpret",
    "tpm-log",
    "tpm-macros",
    "tpm-motion",
    "tpm-numerics",
    "tpm-physical",
    "tpm-plant",
    "tpm-plot",
    "tpm-report",
    "tpm-runtime",
    "tpm-session",
    "tpm-study",
    "tpm-symbolic",
    "tpm-units",
];

/// What a program prints in the workspace's folder.
fn printed(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).current_dir(root()).output().expect("the program runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// The workspace's packages that may be published.
fn publishable() -> Vec<Value> {
    // An empty list of registries is how cargo writes `publish = false`.
    let packages: Vec<Value> = packages().into_iter().filter(|package| package["publish"].is_null()).collect();
    let mut names: Vec<&str> = packages.iter().filter_map(|package| package["name"].as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, PUBLISHED);
    packages
}

#[test]
fn a_package_holds_its_sources_readme_and_licences() {
    for package in publishable() {
        let (name, folder) = (package["name"].as_str().expect("a name"), folder_of(&package));
        let list = printed(env!("CARGO"), &["package", "--list", "--allow-dirty", "--offline", "--locked", "-p", name]);
        let files: Vec<String> = list.lines().map(|line| line.replace('\\', "/")).collect();
        let start = if name == "tpm-cli" { "src/main.rs" } else { "src/lib.rs" };
        for needed in ["README.md", "LICENSE-MIT", "LICENSE-APACHE", "Cargo.toml", start] {
            assert!(files.iter().any(|file| file == needed), "{name} lacks {needed}: {files:?}");
        }
        for file in &files {
            let own = ["README.md", "LICENSE-MIT", "LICENSE-APACHE"].contains(&file.as_str());
            let cargos =
                ["Cargo.toml", "Cargo.toml.orig", "Cargo.lock", ".cargo_vcs_info.json"].contains(&file.as_str());
            let source = ["src/", "examples/"].iter().any(|folder| file.starts_with(folder))
                && (file.ends_with(".rs") || is_included(&folder, file));
            assert!(own || cargos || source || file == "build.rs", "{name} packages {file}");
            if file.starts_with("examples/") {
                let text = std::fs::read_to_string(folder.join(file)).expect("an example");
                assert!(!text.contains("!(\"../"), "{name}: {file} includes a file that is not in the package");
            }
        }
        for licence in ["LICENSE-MIT", "LICENSE-APACHE"] {
            let read = |path: &Path| std::fs::read(path).expect("a licence");
            assert!(read(&folder.join(licence)) == read(&root().join(licence)), "{name}/{licence} differs");
        }
        let mut sources = Vec::new();
        rust_files(&folder.join("src"), &mut sources);
        for source in sources {
            let path = source.strip_prefix(&folder).expect("in the folder").to_string_lossy().replace('\\', "/");
            assert!(files.contains(&path), "{name} leaves out {path}");
        }
    }
}

/// Whether a source in the folder of a package, or in one below it, includes a file, such as the template of a page, as text.
fn is_included(package: &Path, file: &str) -> bool {
    let path = package.join(file);
    let mut sources = Vec::new();
    rust_files(&package.join("src"), &mut sources);
    sources.iter().any(|source| {
        let folder = source.parent().expect("in a folder");
        let text = std::fs::read_to_string(source).expect("a source");
        let within = path.strip_prefix(folder).ok().and_then(|path| path.to_str());
        within.is_some_and(|within| text.contains(&format!("include_str!(\"{within}\")")))
    })
}

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            rust_files(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

#[test]
fn a_package_is_described() {
    for package in publishable() {
        let name = &package["name"];
        let text = |key: &str| package[key].as_str().unwrap_or_default().to_owned();
        let list = |key: &str| -> Vec<String> {
            let items = package[key].as_array().into_iter().flatten();
            items.filter_map(|item| item.as_str().map(str::to_owned)).collect()
        };
        assert_eq!((text("license").as_str(), text("readme").as_str()), ("MIT OR Apache-2.0", "README.md"), "{name}");
        assert!(!text("description").is_empty() && !text("rust_version").is_empty(), "{name}");
        let (keywords, categories) = (list("keywords"), list("categories"));
        assert!(
            (1..=5).contains(&keywords.len()) && keywords.iter().all(|word| word.len() <= 20),
            "{name}: {keywords:?}"
        );
        assert!((1..=5).contains(&categories.len()), "{name}: {categories:?}");
        assert!(categories.iter().all(|category| CATEGORIES.contains(&category.as_str())), "{name}: {categories:?}");
        let features = package["features"].as_object().expect("features");
        for feature in package["metadata"]["docs"]["rs"]["features"].as_array().into_iter().flatten() {
            let feature = feature.as_str().expect("a name");
            assert!(features.contains_key(feature), "{name} is documented with `{feature}`, which it has not");
        }
    }
}

#[test]
fn the_repository_has_no_symlinks() {
    if !root().join(".git").exists() {
        println!("skipped: this is no clone of the repository");
        return;
    }
    let list = printed("git", &["ls-files", "--stage"]);
    let links: Vec<&str> = list.lines().filter(|line| line.starts_with("120000")).collect();
    assert!(links.is_empty(), "symbolic links: {links:?}");
}
