//! Makes a shipped model's module as a user's build script does; the tests include it.

use tpm_codegen::build::{self, BuildError};
use tpm_codegen::generate::Language;

fn main() -> Result<(), BuildError> {
    build::model("../models/mass_spring_drag.tpm", Language::Rust).map(drop)
}
