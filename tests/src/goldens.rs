//! The generated sources that tests compile and run, and what is kept of them in `tests/generated`: a hash of every text, in
//! `hashes.txt`, and the text of a few, for people who review a change of a printer.
//!
//! Invariant: every source of the list has its hash, and nothing else is in the folder but these few texts.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tpm_codegen::emit::estimator::{EstimatorSource, Part};
use tpm_codegen::generate::{Filters, Language, LowPass, Options, generate};
use tpm_codegen::{Source, parse_model};
use tpm_symbolic::number::rational::{integer, ratio};

/// What is kept as text, by the beginnings of names: Feng, Eqn 3.24 and two carts in both languages, and an arm's estimator in Rust.
const TEXTS: [&str; 3] = [WHOLE, "two_carts.", "parts/three_joints.rs"];

/// What is kept to its last line: a program without an operating system includes it, and the documentation compares it.
const WHOLE: &str = "mass_spring_drag.";

/// Where a source in Rust begins to repeat the sources of `tpm-controller`, which are read where they are written.
const REPEATED: &str = "\n/// What the functions above need beside `core`";

/// Where the texts and the hashes are kept, in the workspace.
const FOLDER: &str = "tests/generated";

/// The file of lines `name hash`.
const HASHES: &str = "hashes.txt";

/// Lines of a difference that a failing test prints.
const MOST_LINES: usize = 300;

/// A source that the generator writes.
#[derive(Clone)]
pub struct Golden {
    /// Its path below `tests/generated`, with `/` between folders.
    pub name: String,
    /// Its text.
    pub text: String,
}

impl Golden {
    /// What is kept of it as text, if anything is.
    fn read_by_people(&self) -> Option<Self> {
        TEXTS.iter().find(|text| self.name.starts_with(**text)).map(|&kind| {
            let own = if kind == WHOLE { None } else { self.text.split_once(REPEATED) };
            Self { name: self.name.clone(), text: own.map_or(self.text.as_str(), |(own, _)| own).to_owned() }
        })
    }
}

/// Options beyond those of every model: the folder of the sources, the model below the workspace, the flags in the command of the header.
struct Variant {
    folder: &'static str,
    model: &'static str,
    flags: &'static str,
}

const VARIANTS: [Variant; 5] = [
    Variant {
        folder: "filtered",
        model: "models/cart_pendulum.tpm",
        flags: " --filter 100:1 --independent-filter 2000:0.8 --sample-time 1e-3",
    },
    Variant { folder: "forgetting", model: "models/mass_spring_drag.tpm", flags: " --forgetting" },
    Variant { folder: "functions", model: "tests/fixtures/emit/functions.tpm", flags: "" },
    Variant {
        folder: "parts",
        model: "tests/fixtures/arms/three_joints.tpm",
        flags: " --forgetting --with gravity,mass_matrix,forward_dynamics,estimator",
    },
    Variant { folder: "strokes", model: "models/mass_spring_drag.tpm", flags: " --strokes" },
];

/// All sources, in the order of their names: every shipped model and every variant in both languages.
///
/// # Panics
/// When a model is not there or has faults.
pub fn all(root: &Path) -> Vec<Golden> {
    let mut goldens = Vec::new();
    for model in shipped(root) {
        sources(&model, &Variant { folder: "", model: "", flags: "" }, &mut goldens);
    }
    for variant in &VARIANTS {
        sources(&root.join(variant.model), variant, &mut goldens);
    }
    goldens.sort_by(|a, b| a.name.cmp(&b.name));
    goldens
}

/// Files and folders below the workspace from which the sources are made.
pub fn inputs() -> BTreeSet<&'static str> {
    VARIANTS.iter().map(|variant| variant.model).chain(["models"]).collect()
}

fn shipped(root: &Path) -> BTreeSet<PathBuf> {
    let entries = fs::read_dir(root.join("models")).expect("the folder of the models");
    let paths = entries.map(|entry| entry.expect("readable").path());
    paths.filter(|path| path.extension().is_some_and(|kind| kind == "tpm")).collect()
}

fn sources(path: &Path, variant: &Variant, goldens: &mut Vec<Golden>) {
    let name = path.file_name().expect("a file").to_string_lossy().into_owned();
    let source = Source::from_bytes(name.as_str(), fs::read(path).expect("a model file"));
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let mut estimator = EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message));
    if variant.folder == "parts" {
        let parts = [Part::Gravity, Part::MassMatrix, Part::ForwardDynamics, Part::Estimator];
        estimator = estimator.with(&parts).expect("an arm");
    }
    let filters = (variant.folder == "filtered").then(|| Filters {
        sample_time: ratio(1, 1000),
        dependent: LowPass { natural_frequency: integer(100), quality: integer(1) },
        independent: Some(LowPass { natural_frequency: integer(2000), quality: ratio(4, 5) }),
    });
    for (language, lang) in [(Language::Rust, "rust"), (Language::C, "c")] {
        let command = format!("tpm generate {name} --lang {lang}{}", variant.flags);
        let options = Options {
            filters: filters.as_ref(),
            forgetting: variant.flags.contains("--forgetting"),
            strokes: variant.flags.contains("--strokes"),
            ..Options::new(language, &command)
        };
        for file in generate(&estimator, &options).expect("nothing stands in the way") {
            let name = [variant.folder, &file.name].join("/");
            goldens.push(Golden { name: name.trim_start_matches('/').to_owned(), text: file.text });
        }
    }
}

/// 64 bits of FNV-1a over the text.
pub fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// The sources that [`write()`] wrote into a folder.
///
/// # Errors
/// When a file cannot be read as text.
pub fn read(folder: &Path) -> io::Result<Vec<Golden>> {
    let name = |path: &Path| path.strip_prefix(folder).expect("below it").to_string_lossy().replace('\\', "/");
    let paths = files_below(folder)?.into_iter();
    paths.map(|path| Ok(Golden { name: name(&path), text: fs::read_to_string(path)? })).collect()
}

/// What is kept, by the names of sources.
pub struct Kept {
    hashes: BTreeMap<String, u64>,
    texts: BTreeMap<String, String>,
}

impl Kept {
    /// Reads the hashes and the texts.
    ///
    /// # Errors
    /// When a file cannot be read, or a line of the hashes is none.
    pub fn read(root: &Path) -> io::Result<Self> {
        let mut texts: BTreeMap<_, _> =
            read(&root.join(FOLDER))?.into_iter().map(|golden| (golden.name, golden.text)).collect();
        let parsed = |line: &str| {
            let parts = line.split_once(' ');
            let parsed = parts.and_then(|(name, hash)| Some((name.to_owned(), u64::from_str_radix(hash, 16).ok()?)));
            parsed.ok_or_else(|| io::Error::other(format!("`{line}` is no name with its hash")))
        };
        let hashes = texts.remove(HASHES).unwrap_or_default().lines().map(parsed).collect::<io::Result<_>>()?;
        Ok(Self { hashes, texts })
    }

    /// Names of sources that are not as they are kept, of sources that are not kept, and of what is kept of no source.
    pub fn stale(&self, goldens: &[Golden]) -> BTreeSet<String> {
        let hashes = goldens.iter().map(|golden| (golden.name.clone(), hash(&golden.text))).collect();
        let texts = goldens.iter().filter_map(Golden::read_by_people).map(|kept| (kept.name, kept.text)).collect();
        &different(&hashes, &self.hashes) | &different(&texts, &self.texts)
    }
}

/// The names for which two maps do not say the same.
fn different<V: PartialEq>(left: &BTreeMap<String, V>, right: &BTreeMap<String, V>) -> BTreeSet<String> {
    left.keys().chain(right.keys()).filter(|&name| left.get(name) != right.get(name)).cloned().collect()
}

fn files_below(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(files_below(&path)?);
        } else {
            found.push(path);
        }
    }
    Ok(found)
}

/// Writes every text into a folder.
///
/// # Errors
/// When a file cannot be written.
pub fn write<'a>(folder: &Path, goldens: impl IntoIterator<Item = &'a Golden>) -> io::Result<()> {
    for golden in goldens {
        let path = folder.join(&golden.name);
        fs::create_dir_all(path.parent().expect("in a folder"))?;
        fs::write(path, &golden.text)?;
    }
    Ok(())
}

/// Puts the sources as they are now in the place of what is kept.
///
/// # Errors
/// When a file cannot be written or removed.
pub fn accept(root: &Path, goldens: &[Golden]) -> io::Result<()> {
    let folder = root.join(FOLDER);
    for path in files_below(&folder)? {
        fs::remove_file(path)?;
    }
    write(&folder, &goldens.iter().filter_map(Golden::read_by_people).collect::<Vec<_>>())?;
    let lines: String = goldens.iter().map(|golden| format!("{} {:016x}\n", golden.name, hash(&golden.text))).collect();
    fs::write(folder.join(HASHES), lines)
}

/// How these sources differ from those of the last commit that changed the hashes, as a text to read.
///
/// That commit is checked out below `scratch`, beside the repository's own files, and its generator is built there; both are used again.
pub fn difference(root: &Path, scratch: &Path, goldens: &[Golden], names: &BTreeSet<String>) -> String {
    let new = scratch.join("new");
    let compared = fs::create_dir_all(scratch).and_then(|()| write(&new, goldens)).and_then(|()| {
        let old = texts_of_last_commit(root, scratch)?;
        let mut text = format!("Texts of the last commit in {}, texts of now in {}.\n", old.display(), new.display());
        let mut lines = Vec::new();
        for name in names {
            let sides = [&old, &new].map(|side| Some(side.join(name)).filter(|path| path.is_file()));
            // Shown below the folder of both, as far as they lie there.
            let below = |path: PathBuf| path.strip_prefix(scratch).map_or(path.clone(), Path::to_owned);
            let [old, new] = sides.map(|side| side.map_or_else(|| "/dev/null".into(), below));
            let arguments = ["--no-pager", "diff", "--no-index", "--no-color", "--no-ext-diff", "--"];
            let output = Command::new("git").current_dir(scratch).args(arguments).args([old, new]).output()?;
            lines.extend(String::from_utf8_lossy(&output.stdout).lines().map(str::to_owned));
        }
        match lines.len() {
            0 => text.push_str("They do not differ: the hashes were not accepted when the generator was changed.\n"),
            count if count > MOST_LINES => {
                lines.truncate(MOST_LINES);
                text.push_str(&format!("The first {MOST_LINES} of {count} lines, all of them by: "));
                text.push_str(&format!(
                    "git diff --no-index {} {}\n{}\n",
                    old.display(),
                    new.display(),
                    lines.join("\n")
                ));
            }
            _ => text.push_str(&(lines.join("\n") + "\n")),
        }
        Ok(text)
    });
    compared.unwrap_or_else(|error| {
        format!(
            "The texts of the last commit could not be made: {error}\nThe texts of now are in {}. To compare them, run in a checkout of \
             a commit that can be built `cargo run -p tpm-tests --bin generated -- write OLD`, then `git diff --no-index OLD {}`.\n",
            new.display(),
            new.display()
        )
    })
}

/// The folder with all sources as the last commit that changed the hashes generates them.
fn texts_of_last_commit(root: &Path, scratch: &Path) -> io::Result<PathBuf> {
    let git = |arguments: &[&str]| succeeded(Command::new("git").current_dir(root).args(arguments));
    let hashes = [FOLDER, HASHES].join("/");
    let commit = String::from_utf8_lossy(&git(&["log", "-1", "--format=%H", "--", &hashes])?.stdout).trim().to_owned();
    if commit.is_empty() {
        return Err(io::Error::other(format!("no commit has {hashes}")));
    }
    let texts = scratch.join(&commit);
    if texts.is_dir() {
        return Ok(texts);
    }
    let checkout = scratch.join("checkout");
    fs::create_dir_all(&checkout)?;
    // With an index of its own, git replaces what differs from the commit that was checked out before, and compilers keep the rest.
    let index = [("GIT_INDEX_FILE", scratch.join("index")), ("GIT_WORK_TREE", checkout.clone())];
    succeeded(Command::new("git").current_dir(root).envs(index).args(["read-tree", "--reset", "-u", &commit]))?;
    let half = scratch.join("half");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let arguments = ["run", "--quiet", "--locked", "-p", "tpm-tests", "--bin", "generated", "--", "write"];
    let mut generator = Command::new(cargo);
    generator.current_dir(&checkout).env("CARGO_TARGET_DIR", scratch.join("target")).args(arguments).arg(&half);
    succeeded(&mut generator)?;
    fs::rename(&half, &texts)?;
    Ok(texts)
}

fn succeeded(command: &mut Command) -> io::Result<Output> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| io::Error::new(error.kind(), format!("{program}: {error}")))?;
    if output.status.success() {
        return Ok(output);
    }
    Err(io::Error::other(format!("{command:?}: {}\n{}", output.status, String::from_utf8_lossy(&output.stderr))))
}
