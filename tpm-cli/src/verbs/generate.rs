//! `tpm generate`: the source code of a model's estimator.

use crate::failure::{Failure, Outcome};
use crate::input::choice::one_of;
use crate::input::load::Loaded;
use crate::input::values::identification;
use crate::output::file;
use crate::verbs::validate::NEAREST;
use clap::builder::TypedValueParser;
use std::path::{Path, PathBuf};
use tpm_codegen::emit::estimator::{EmitError, Identified, IdentifiedError, Part};
use tpm_codegen::generate::{File, Filters, Language, LowPass, Options, Ranges, Scalar, generate, unbounded};
use tpm_runtime::report::{MOST_TEXT, read_input};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational::{self, Rational};

/// A target language.
fn language() -> impl TypedValueParser<Value = Language> {
    one_of([
        (Language::Rust, "rust", "A `no_std` module over `core` and the crate libm alone"),
        (Language::C, "c", "A header and a source in C99, over math.h alone"),
    ])
}

/// The scalar of C.
pub(super) fn scalar() -> impl TypedValueParser<Value = Scalar> {
    one_of([(Scalar::Float, "float", "Single precision"), (Scalar::Double, "double", "Double precision")])
}

/// A part of the code that is made on request.
fn part() -> impl TypedValueParser<Value = Part> {
    let help = |part: Part| match part {
        Part::Split => {
            "The feed-forward in its motion-independent and its motion-dependent part, also of equations too long to be multiplied out \
             (low passes ask for it)"
        }
        Part::Gravity => "The forces at rest: what holds a machine against gravity and springs",
        Part::MassMatrix => "The mass matrix",
        Part::ForwardDynamics => "The accelerations that inputs give; a singular mass matrix is an error",
        Part::BaseRegressor => "The regressor in base parameters, the combinations that any motion can show",
        Part::Estimator => {
            "An estimator of the base parameters that takes in any motion sample by sample (square-root updates)"
        }
        Part::Run => {
            "An estimator of the declared parameters from the samples of one run, where all coordinates are measured"
        }
        Part::Linearised => "The estimators `error` and `hill` of a run, linearised about its reference",
        Part::Numerical => {
            "The estimator `numerical` of a run and of those with one parameter of the feed-forward changed"
        }
        Part::Campaign => {
            "A whole campaign on the controller, run by run, over the estimator of a run: the machine identifies itself"
        }
        Part::Monitor => {
            "A test whether the machine is still the one that was identified, with a stated rate of false alarms (and `estimator`)"
        }
        _ => "",
    };
    one_of(Part::ALL.map(|part| (part, part.name(), help(part))))
}

/// Options of `tpm generate`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// The language of the code.
    #[arg(long, value_parser = language())]
    lang: Language,
    /// With --lang c, what names and files begin with; the model's name in small letters when not given.
    #[arg(long, value_name = "P")]
    prefix: Option<String>,
    /// With --lang c, the scalar; double when not given. Rust is generic over both.
    #[arg(long, value_parser = scalar())]
    real: Option<Scalar>,
    /// Write into this folder, which is made when there is none; or to this file, when there is one and the name ends as
    /// the language's files do (.rs). Standard output when not given.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Bake in the values of this result of `tpm identify --json`, or of NAME = VALUE lines (.toml), as the constant IDENTIFIED. Priors that were stated are marked;
    /// what the data do not show and an equation needs is refused.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Make the functions of the dynamics for the machine with these values: they stand in the code as numbers, what they make zero is not
    /// computed, and the functions do not read the parameters that they are given.
    #[arg(long, requires = "params")]
    specialise: bool,
    /// Add the feed-forward behind a second-order low pass of this natural frequency (rad/s) and quality (1/sqrt(2) when
    /// not given): of everything (common), and of the motion-dependent part alone (split).
    #[arg(long, value_name = "W[:Q]", requires = "sample_time")]
    filter: Option<String>,
    /// A low pass of the motion-independent part in the split scheme; none when not given.
    #[arg(long, value_name = "W[:Q]", requires = "filter")]
    independent_filter: Option<String>,
    /// Time between the samples of the filters, s.
    #[arg(long, value_name = "SECONDS", requires = "filter")]
    sample_time: Option<String>,
    /// Accumulators of harmonics, and the estimator of base parameters, can let the past fade away, for a machine whose parameters change
    /// while it runs.
    #[arg(long)]
    forgetting: bool,
    /// Add a function for single strokes of every pattern, with rest before and after them.
    #[arg(long)]
    strokes: bool,
    /// Add parts that are not made without being asked for; several are separated by commas.
    #[arg(long, value_parser = part(), value_name = "PART", value_delimiter = ',')]
    with: Vec<Part>,
    /// Bound how far rounding moves the results of the functions of the dynamics, where what they read is in these ranges: `q=-3.1..3.1`,
    /// `dot(q)=-2..2`, `dot(*)=-2..2` of every coordinate; parameters have the values of --params or ranges. The bounds stand beside the
    /// functions and, with what they follow from, in NAME.bounds.json. Several are separated by commas.
    #[arg(long, value_name = "NAME=LOW..HIGH,..")]
    range: Vec<String>,
    /// Write nothing, and say whether what is there is what this command would write (exit code 1 when it is not).
    #[arg(long, requires = "output")]
    check: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let loaded = Loaded::from_file(&args.file)?;
    let mut estimator = loaded.estimator()?;
    let asked = |part: Part| args.with.contains(&part) || (part == Part::Split && args.filter.is_some());
    let parts: Vec<Part> = Part::ALL.into_iter().filter(|part| asked(*part)).collect();
    if !parts.is_empty() {
        estimator = estimator.with(&parts).map_err(|error| loaded.at_whole(&error.to_string()))?;
    }
    let columns: Vec<&str> = estimator.form.columns.iter().map(|column| column.name.as_str()).collect();
    let identified = args.params.as_deref().map(|path| identified(path, &loaded, &columns)).transpose()?;
    let identified = identified.map(|(identified, _)| identified);
    if args.lang != Language::C && (args.prefix.is_some() || args.real.is_some()) {
        let what =
            "--prefix and --real are for --lang c; Rust names its module by the model and is generic over f32 and f64";
        return Err(Failure::Input(what.to_owned()));
    }
    let filters = filters(args)?;
    let ranges = Ranges::parse(&args.range).map_err(|error| Failure::Input(format!("--range: {error}")))?;
    let command = command(args);
    let options = Options {
        identified: identified.as_ref(),
        specialise: args.specialise,
        filters: filters.as_ref(),
        forgetting: args.forgetting,
        strokes: args.strokes,
        prefix: args.prefix.as_deref(),
        scalar: args.real.unwrap_or_default(),
        ranges: (!args.range.is_empty()).then_some(&ranges),
        ..Options::new(args.lang, &command)
    };
    let files = generate(&estimator, &options)
        .map_err(|error| fault(&error, args.params.as_deref(), identified.as_ref(), &loaded))?;
    for gap in estimator.gaps().into_iter().chain(files.iter().flat_map(unbounded)) {
        file::remark(&format!("remark: {gap}"));
    }
    match file::named(args.output.as_deref()) {
        None if args.check => {
            Err(Failure::Input("--check compares files: give the one or the folder that -o wrote".to_owned()))
        }
        out => match target_of(out, &files)? {
            Some(out) if args.check => check(out, &files, &command),
            out => deliver(out, &files),
        },
    }
}

/// Why no code is made, with the flag that would help.
pub(super) fn fault(
    error: &EmitError,
    params: Option<&Path>,
    identified: Option<&Identified>,
    loaded: &Loaded,
) -> Failure {
    match (error, params) {
        (EmitError::Identified(IdentifiedError::NotShown { .. }), Some(path)) => Failure::Input(format!(
            "{}: {error} (tpm identify --prior NAME=VALUE or --freeze NAME=VALUE; in an experiment [prior] or [frozen])",
            path.display()
        )),
        (EmitError::Identified(IdentifiedError::Missing(name)), Some(path)) if is_values(path) => {
            let missing = identified.map_or_else(Vec::new, |given| not_given(loaded.model(), given));
            Failure::Input(format!(
                "{}: there is no value from which `{name}` follows; add lines for {}",
                path.display(),
                missing.join(", ")
            ))
        }
        (EmitError::Identified(_), Some(path)) => Failure::Input(format!("{}: {error}", path.display())),
        (EmitError::Range(error), _) => Failure::Input(format!("--range: {error}")),
        (EmitError::Prefix(_) | EmitError::Filter(_) | EmitError::Specialise(_), _) => {
            Failure::Input(error.to_string())
        }
        _ => loaded.at_whole(&error.to_string()),
    }
}

/// Where files go: standard output where nothing is named, which takes one file alone.
pub(super) fn target_of<'p>(output: Option<&'p Path>, files: &[File]) -> Result<Option<&'p Path>, Failure> {
    match output {
        None if files.len() > 1 => {
            let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
            Err(Failure::Input(format!(
                "the code is in {} files ({}): give a folder with -o",
                names.len(),
                names.join(", ")
            )))
        }
        Some(out) if files.len() > 1 && is_file(out, files) => Err(Failure::Input(format!(
            "the code is in {} files, so that -o must be a folder, not the file {}",
            files.len(),
            out.display()
        ))),
        Some(out) if out.exists() && !out.is_dir() && !is_file(out, files) => Err(Failure::Input(format!(
            "-o {} is no folder: give one, which is made when there is none{}",
            out.display(),
            if files.len() == 1 { ", or a file whose name ends as the language's do" } else { "" }
        ))),
        out => Ok(out),
    }
}

/// Prints a file, or writes all files.
pub(super) fn deliver(out: Option<&Path>, files: &[File]) -> Outcome {
    match out {
        None => files.iter().try_for_each(|file| file::print_content(&file.text)),
        Some(out) => write(out, files),
    }
}

/// The command for the header of the code: without folders, so that the code does not depend on the folder in which it
/// was made.
fn command(args: &Args) -> String {
    let name = |path: &Path| {
        path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
    };
    let mut command = format!("tpm generate {} --lang {}", name(&args.file), args.lang.name());
    if let Some(prefix) = &args.prefix {
        command.push_str(&format!(" --prefix {prefix}"));
    }
    if args.real == Some(Scalar::Float) {
        command.push_str(" --real float");
    }
    let filters = [
        ("filter", &args.filter),
        ("independent-filter", &args.independent_filter),
        ("sample-time", &args.sample_time),
    ];
    for (name, value) in filters {
        if let Some(value) = value {
            command.push_str(&format!(" --{name} {value}"));
        }
    }
    if args.forgetting {
        command.push_str(" --forgetting");
    }
    if args.strokes {
        command.push_str(" --strokes");
    }
    if !args.range.is_empty() {
        command.push_str(&format!(" --range '{}'", args.range.join(",")));
    }
    let with: Vec<&str> = Part::ALL.into_iter().filter(|part| args.with.contains(part)).map(Part::name).collect();
    if !with.is_empty() {
        command.push_str(&format!(" --with {}", with.join(",")));
    }
    if let Some(params) = &args.params {
        command.push_str(&format!(" --params {}", name(params)));
    }
    if args.specialise {
        command.push_str(" --specialise");
    }
    command
}

/// The filters of the options; their numbers are taken exactly as written.
fn filters(args: &Args) -> Result<Option<Filters>, Failure> {
    let number = |option: &str, text: &str| -> Result<Rational, Failure> {
        rational::parse(text.trim())
            .ok_or_else(|| Failure::Input(format!("--{option} {text}: `{text}` is not a number such as 100 or 0.001")))
    };
    let low_pass = |option: &str, text: &str| {
        LowPass::parse(text).map_err(|error| Failure::Input(format!("--{option} {text}: {error}")))
    };
    let (Some(dependent), Some(sample_time)) = (&args.filter, &args.sample_time) else { return Ok(None) };
    Ok(Some(Filters {
        sample_time: number("sample-time", sample_time)?,
        dependent: low_pass("filter", dependent)?,
        independent: (args.independent_filter.as_deref())
            .map(|text| low_pass("independent-filter", text))
            .transpose()?,
    }))
}

/// Values of parameters: a result, or lines that name what the model has; and the text of the file.
pub(super) fn identified(path: &Path, loaded: &Loaded, columns: &[&str]) -> Result<(Identified, String), Failure> {
    let model = loaded.model();
    let bytes = read_input(path, MOST_TEXT).map_err(|error| Failure::read(path, error))?;
    let at = |reason: String| Failure::Input(format!("{}: {reason}", path.display()));
    let text = String::from_utf8(bytes).map_err(|error| {
        at(format!("byte {} is not UTF-8; give the output of `tpm identify --json`", error.utf8_error().valid_up_to()))
    })?;
    let found = identification(path, &text, &model.name)?;
    if !is_values(path) {
        let nearest = found.nearest_to_forces();
        if nearest.is_some() {
            file::remark(&format!("remark: {}: {NEAREST}", path.display()));
        }
        return Ok((nearest.unwrap_or(found), text));
    }
    let is_parameter = |symbol: Symbol| model.parameters().any(|own| own == symbol);
    for name in found.parameters.iter().map(|own| own.name.as_str()) {
        match model.find_symbol(name) {
            _ if columns.contains(&name) => {}
            Some(symbol) if is_parameter(symbol) => {}
            Some(_) => file::remark(&format!(
                "remark: {}: `{name}` is no parameter; the code gets it when it runs",
                path.display()
            )),
            None => {
                let known: Vec<String> = model.parameters().map(|own| model.quantity(own).name.to_string()).collect();
                return Err(at(format!(
                    "the model {} has no parameter `{name}`; it has {}",
                    model.name,
                    known.join(", ")
                )));
            }
        }
    }
    Ok((found, text))
}

/// Whether a file has lines of values, and is no result.
fn is_values(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

/// Parameters without a value in a file of values.
fn not_given(model: &ExactModel, given: &Identified) -> Vec<String> {
    let names = model.parameters().map(|own| model.quantity(own).name.to_string());
    names.filter(|name| given.parameters.iter().all(|own| own.name != *name)).collect()
}

/// Whether a path has the file extension of the language and is not a folder.
fn is_file(out: &Path, files: &[File]) -> bool {
    let same_kind = |file: &File| out.extension().is_some() && out.extension() == Path::new(&file.name).extension();
    files.iter().any(same_kind) && !out.is_dir()
}

/// The path of a file: in the folder `out`, or `out` itself when it names a file of the language and only one file is
/// written.
fn target(out: &Path, file: &File, alone: bool) -> PathBuf {
    if alone && is_file(out, std::slice::from_ref(file)) { out.to_owned() } else { out.join(&file.name) }
}

fn write(out: &Path, files: &[File]) -> Outcome {
    let paths: Vec<PathBuf> = files.iter().map(|file| target(out, file, files.len() == 1)).collect();
    let contents: Vec<(&Path, &[u8])> =
        paths.iter().zip(files).map(|(path, file)| (path.as_path(), file.text.as_bytes())).collect();
    let alone = files.len() == 1 && is_file(out, files);
    file::write_into(if alone { out.parent().unwrap_or(Path::new("")) } else { out }, &contents)?;
    for path in &paths {
        file::remark(&format!("wrote {}", path.display()));
    }
    Ok(())
}

fn check(out: &Path, files: &[File], command: &str) -> Outcome {
    let mut stale = Vec::new();
    for file in files {
        let path = target(out, file, files.len() == 1);
        match std::fs::read(&path) {
            Ok(present) if present == file.text.as_bytes() => {}
            Ok(present) => stale.push(format!("{} differs {}", path.display(), first_difference(&present, &file.text))),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                stale.push(format!("{} is not there", path.display()));
            }
            Err(error) => return Err(Failure::read(&path, error)),
        }
    }
    if stale.is_empty() {
        return Ok(());
    }
    Err(Failure::Incomplete(format!("not current: {}; run `{command} -o {}`", stale.join(", "), out.display())))
}

/// The first line in which a file differs from its expected text.
fn first_difference(present: &[u8], expected: &str) -> String {
    let mut lines = present.split(|&byte| byte == b'\n').zip(expected.split('\n'));
    let same = lines.by_ref().take_while(|(present, expected)| *present == expected.as_bytes()).count();
    format!("from line {}", same + 1)
}
