//! Robot descriptions, and the options that choose a part of one.

use crate::failure::Failure;
use crate::input::assignments::assignment;
use crate::input::choice::one_of;
use clap::builder::TypedValueParser;
use std::path::Path;
use tpm_codegen::import::{Angles, Options, with_included};
use tpm_codegen::source::Source;
use tpm_runtime::report::{MOST_TEXT, read_input};

/// Options that choose the part of a description that is read, and how.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct PartArgs {
    /// The link that stands still; the root when not given. What is not outward of it is left out.
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
    /// The last link of the chain that is taken; everything when not given.
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,
    /// Hold a joint at a position, rad or m.
    #[arg(long, value_name = "JOINT=VALUE", value_parser = assignment)]
    lock: Vec<(String, String)>,
    /// How angles and lengths are read: right angles and zeros recognised where rounding hides them, or as written.
    #[arg(long, value_parser = angles(), default_value = "recognised")]
    angles: Angles,
}

/// How angles are read.
fn angles() -> impl TypedValueParser<Value = Angles> {
    one_of([
        (
            Angles::Recognised,
            "recognised",
            "Angles within 1e-4 of a multiple of pi/2 are that multiple, lengths below 1e-12 m are zero",
        ),
        (Angles::Written, "written", "Every number is what is written"),
    ])
}

impl PartArgs {
    /// What is taken when no option is given.
    pub(crate) const fn whole() -> Self {
        Self { base: None, tip: None, lock: Vec::new(), angles: Angles::Recognised }
    }

    /// As the library reads them.
    pub(crate) fn options(&self) -> Options {
        Options {
            base: self.base.clone(),
            tip: self.tip.clone(),
            locked: self.lock.clone(),
            angles: self.angles,
            losses: None,
            stribeck: false,
        }
    }
}

/// The text of a description, with the files that it includes: their names are relative to the folder of the first file, as MuJoCo reads
/// them, or to that of the file that includes them.
pub(crate) fn description(path: &Path) -> Result<Source, Failure> {
    let read = |path: &Path| -> std::io::Result<Source> {
        Ok(Source::from_bytes(path.display().to_string(), read_input(path, MOST_TEXT)?))
    };
    let first = read(path).map_err(|error| Failure::read(path, error))?;
    let folder = |path: &Path| path.parent().unwrap_or(Path::new("")).to_owned();
    with_included(first, |from, name| {
        let places = [folder(path).join(name), folder(Path::new(from)).join(name)];
        let place = places.iter().find(|place| place.exists()).unwrap_or(&places[0]);
        read(place).map_err(|error| format!("cannot read {}: {error}", place.display()))
    })
    .map_err(Failure::Model)
}
