//! Makes a shipped model's module as a user's build script does, and all generated sources; the tests include them.

#[allow(dead_code, unreachable_pub, reason = "the build script only writes the sources")]
#[path = "src/goldens.rs"]
mod goldens;

use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use tpm_codegen::build;
use tpm_codegen::generate::Language;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::var_os("OUT_DIR").ok_or("cargo sets OUT_DIR")?;
    let folder = Path::new(&folder);
    build::model("../models/mass_spring_drag.tpm", Language::Rust)?;

    for input in goldens::inputs() {
        println!("cargo::rerun-if-changed=../{input}");
    }
    let sources = goldens::all(Path::new(".."));
    let texts = folder.join("generated");
    goldens::write(&texts, &sources)?;
    std::fs::write(folder.join("generated.rs"), modules(&texts, &sources)?)?;
    Ok(())
}

/// Declares every source in Rust as a module, within a module for its folder.
fn modules(texts: &Path, sources: &[goldens::Golden]) -> Result<String, std::fmt::Error> {
    let mut declared = String::new();
    for source in sources {
        let Some(name) = source.name.strip_suffix(".rs") else { continue };
        let path = texts.join(&source.name);
        match name.split_once('/') {
            None => writeln!(declared, "#[path = {path:?}]\npub mod {name};")?,
            Some((folder, name)) => writeln!(declared, "pub mod {folder} {{\n#[path = {path:?}]\npub mod {name};\n}}")?,
        }
    }
    Ok(declared)
}
