//! What a build script does: it reads a model and writes the Rust module that the crate includes, with
//! `include!(concat!(env!("OUT_DIR"), "/slider.rs"));`. In a `build.rs` the one call is `build::model("slider.tpm", Language::Rust)`.
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::error::Error;
use std::{env, fs, process};
use tpm_codegen::build;
use tpm_codegen::generate::{Language, Options};

const MODEL: &str = "\
model Slider {
    coordinate x [m];
    input u [N];
    parameter m [kg], d [N*s/m];
    m*ddot(x) + d*dot(x) = u;
    pattern { amplitude lambda [m]; frequency w [rad/s]; x = rest_to_rest(lambda, w, 3); }
}
";

fn main() -> Result<(), Box<dyn Error>> {
    // Cargo gives a build script its folder as OUT_DIR; an example makes one.
    let folder = env::temp_dir().join(format!("build_script-{}", process::id()));
    fs::create_dir_all(&folder)?;
    let model = folder.join("slider.tpm");
    fs::write(&model, MODEL)?;
    for path in build::write(&model, &Options::new(Language::Rust, "build.rs"), &folder)? {
        let text = fs::read_to_string(&path)?;
        let functions = text.lines().filter(|line| line.trim_start().starts_with("pub fn ")).count();
        println!("{}: {} lines, {functions} functions", path.display(), text.lines().count());
    }
    fs::remove_dir_all(&folder)?;
    Ok(())
}
