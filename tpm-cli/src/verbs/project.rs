//! `tpm project`: parameters of one model in those of another with the same coordinates and inputs, either way.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::{number_assignment, once};
use crate::input::experiment::model;
use crate::input::values::table;
use crate::output::file;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tpm_runtime::report::{Align, TextTable, cells, combination, number, or_dash, probability};
use tpm_runtime::session::StoredResult;
use tpm_runtime::study::{
    ComparedMotion, Projection, ProjectionError, ProjectionRequest, Way, fitting_experiment, projection,
};
use tpm_symbolic::number::rational;

/// What stands below the options in the help.
const ENDING: &str = "\
Back: tpm project arm_links.tpm --onto arm.tpm --back --params arm_result.json --params arm_links.toml --value A=0.2 --value w=2

Exit codes: 0 when every parameter has a value; 1 when some stand in combinations only, or too little of the forces is explained; 2 on bad \
input";

/// Options of `tpm project`.
#[derive(clap::Args)]
#[command(after_help = ENDING)]
pub(crate) struct Args {
    /// The first model, whose forces are projected.
    file: PathBuf,
    /// The second model: its parameters come nearest to these forces.
    #[arg(long, value_name = "MODEL")]
    onto: PathBuf,
    /// Go back: from parameters of the second model to those of the first that have them as their nearest.
    #[arg(long)]
    back: bool,
    /// Values of parameters and constants of both models, NAME = VALUE lines (.toml), or a result of `tpm identify --json` (.json) for the
    /// parameters that are known. Values of wanted parameters stand beside what is found.
    #[arg(long, value_name = "FILE")]
    params: Vec<PathBuf>,
    /// Value of a parameter, a constant, or an amplitude or the frequency of the motion; goes before that of a file.
    #[arg(long = "value", value_name = "NAME=VALUE", value_parser = number_assignment)]
    values: Vec<(String, f64)>,
    /// The pattern of the motion; the first of the first model that has one when not given.
    #[arg(long, value_name = "NAME")]
    pattern: Option<String>,
    /// Move as all stages of this experiment do, and take its constants; it may be one of either model.
    #[arg(long, value_name = "FILE", conflicts_with = "pattern")]
    experiment: Option<PathBuf>,
    /// Print JSON (tpm.projection/1), which is read wherever a result of `tpm identify --json` is.
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output; one ending in .toml gets NAME = VALUE lines, as --params reads them.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// What files and flags state.
#[derive(Default)]
struct Stated {
    values: BTreeMap<String, f64>,
    result: Option<(PathBuf, StoredResult)>,
}

impl Stated {
    fn load(args: &Args) -> Result<Self, Failure> {
        let mut stated = Self::default();
        for path in &args.params {
            let text = tpm_runtime::report::read_text(path).map_err(|error| Failure::read(path, error))?;
            let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
            if is(path, "json") {
                let result = StoredResult::parse(&text).map_err(|fault| at(fault.to_string()))?;
                if let Some((other, _)) = stated.result.replace((path.clone(), result)) {
                    return Err(at(format!("{} is a result too; give one of them", other.display())));
                }
                continue;
            }
            for (name, value) in table(path, &text)? {
                if stated.values.insert(name.clone(), rational::to_f64(&value)).is_some() {
                    return Err(at(format!("`{name}` has a value in another file too; give one of them")));
                }
            }
        }
        stated.values.extend(once("--value", &args.values)?);
        Ok(stated)
    }
}

fn is(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension))
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let (from, onto) = (model(&args.file)?, model(&args.onto)?);
    let stated = Stated::load(args)?;
    let session = match &args.experiment {
        None => None,
        Some(path) => Some(fitting_experiment(path, &[(&onto, &args.onto), (&from, &args.file)])?),
    };
    let motion = match &session {
        Some(session) => ComparedMotion::Stages(session),
        None => ComparedMotion::Pattern(args.pattern.as_deref()),
    };
    let request = ProjectionRequest {
        from: &from,
        onto: &onto,
        way: if args.back { Way::Back } else { Way::Onto },
        values: stated.values,
        result: stated.result.as_ref().map(|(_, result)| result),
        motion,
    };
    let found = projection(&request).map_err(|error| failure(error, stated.result.as_ref()))?;
    let values = args.output.as_deref().filter(|path| !args.json && is(path, "toml"));
    let text = match values {
        _ if args.json => file::json(&found)?,
        Some(path) if found.lumped => {
            return Err(Failure::Input(format!(
                "{}: parameters of {} are lumped ones, which NAME = VALUE lines cannot state; write them with --json -o FILE.json",
                path.display(),
                found.model
            )));
        }
        Some(_) => lines(&found),
        None => describe(&found),
    };
    file::emit(args.output.as_deref(), &text)?;
    if values.is_some() {
        file::remark(&describe(&found));
    }
    let remedy = match found.other_weights {
        Some(_) => " (identify with `--weights equal`, or `--set weights=equal` in a campaign)",
        None => "",
    };
    found.shortfall().map_or(Ok(()), |missing| Err(Failure::Incomplete(missing + remedy)))
}

/// A failure, with the flags that help.
fn failure(error: ProjectionError, result: Option<&(PathBuf, StoredResult)>) -> Failure {
    let place = result.map_or(String::new(), |(path, _)| format!("{}: ", path.display()));
    Failure::Input(match error {
        ProjectionError::Model(fault) => return fault.into(),
        ProjectionError::NoValue { names } => {
            let flags: Vec<String> = names.iter().map(|name| format!("--value {name}=VALUE")).collect();
            format!("there is no value of {}; give {}, or a file with --params", names.join(", "), flags.join(" "))
        }
        fault @ ProjectionError::OtherModel { .. } => format!(
            "{place}{fault}; without --back these are parameters of the first model, with it those of the one behind --onto"
        ),
        fault @ (ProjectionError::OtherParameters { .. } | ProjectionError::Twice { .. }) => format!("{place}{fault}"),
        ProjectionError::NoPattern => {
            "neither model has a pattern to move along; declare one, or give --experiment FILE".to_owned()
        }
        fault => fault.to_string(),
    })
}

/// The values as NAME = VALUE lines, and what has none as remarks.
fn lines(found: &Projection) -> String {
    let mut text = format!("# Parameters of {}: {}\n", found.model, origin(found));
    for parameter in &found.parameters {
        let unit = parameter.unit.as_ref().map_or(String::new(), |unit| format!("  # {unit}"));
        let _ = match parameter.value {
            Some(value) => writeln!(text, "{} = {value:?}{unit}", parameter.name),
            None => writeln!(text, "# {} has no value of its own", parameter.name),
        };
    }
    for shown in &found.combinations {
        let _ = writeln!(text, "# {} = {}", combination(&shown.terms), shown.value);
    }
    text
}

fn origin(found: &Projection) -> String {
    match found.way {
        Way::Onto => format!("those nearest to the forces of {}", found.of),
        Way::Back => format!("those to which the parameters of {} are the nearest", found.of),
    }
}

fn describe(found: &Projection) -> String {
    let mut text = format!("parameters of {}: {}\n", found.model, origin(found));
    for (at, motion) in found.motions.iter().enumerate() {
        let frequency = number(motion.frequency);
        let _ = writeln!(text, "motion {}: {}; {frequency} rad/s, {} samples", at + 1, motion.name, found.samples);
    }
    let mut table = TextTable::new(&[
        ("input", Align::Left),
        ("unit", Align::Left),
        ("force, rms", Align::Right),
        ("unexplained, rms", Align::Right),
        ("share", Align::Right),
        ("its largest harmonic", Align::Left),
    ]);
    for input in &found.inputs {
        table.row(&[
            input.input.clone(),
            input.unit.clone().unwrap_or_else(|| "-".to_owned()),
            number(input.force),
            number(input.unexplained),
            or_dash(input.share, |share| format!("{} %", number(100.0 * share))),
            or_dash(input.harmonic, |line| {
                let of = if found.motions.len() > 1 { format!(" of motion {}", line.motion) } else { String::new() };
                format!("{}{of}, {}", line.harmonic, number(line.amplitude))
            }),
        ]);
    }
    let _ = write!(text, "\n{}", table.finish());
    let rows = found.parameters.iter().map(|parameter| Row {
        name: parameter.name.clone(),
        unit: parameter.unit.as_deref(),
        stated: parameter.prior,
        value: parameter.value,
        std: parameter.std,
        remark: match (parameter.value, parameter.with_prior) {
            (Some(_), _) => parameter.status.name().replace('_', " ").replace("identified", ""),
            (None, None) => "no value of its own".to_owned(),
            (None, Some(value)) => format!("no value of its own; {} with the stated ones", number(value)),
        },
    });
    let _ = write!(text, "\n{}", values("parameter", found, &rows.collect::<Vec<_>>()));
    if !found.combinations.is_empty() {
        let rows = found.combinations.iter().map(|shown| Row {
            name: combination(&shown.terms),
            unit: shown.unit.as_deref(),
            stated: shown.prior,
            value: Some(shown.value),
            std: Some(shown.std),
            remark: String::new(),
        });
        let _ = write!(text, "\n{}", values("combination", found, &rows.collect::<Vec<_>>()));
    }
    let _ = writeln!(
        text,
        "\nrank {} of {}, condition number {}, {} % of the force unexplained",
        found.rank,
        found.parameters.len(),
        or_dash(found.condition, number),
        number(100.0 * found.residual)
    );
    if let Some(tested) = found.consistency {
        let _ = writeln!(
            text,
            "{} explains the known parameters with chi squared {} for {} degrees of freedom, chance {}",
            found.model,
            number(tested.chi_squared),
            tested.degrees,
            probability(tested.chance, number)
        );
    }
    for direction in &found.unobservable {
        let _ = writeln!(text, "nothing is said along the direction {}", combination(direction));
    }
    text
}

/// A line of a table of values.
struct Row<'a> {
    name: String,
    unit: Option<&'a str>,
    stated: Option<f64>,
    value: Option<f64>,
    std: Option<f64>,
    remark: String,
}

/// A table of values, without the columns in which nothing stands.
fn values(of: &str, found: &Projection, rows: &[Row<'_>]) -> String {
    let (stated, remarks) =
        (rows.iter().any(|row| row.stated.is_some()), rows.iter().any(|row| !row.remark.is_empty()));
    let mut head = vec![(of, Align::Left), ("unit", Align::Left)];
    head.extend(stated.then_some(("stated", Align::Right)));
    head.push(("value", Align::Decimal));
    head.extend((!found.exact).then_some(("std. dev.", Align::Decimal)));
    head.extend(remarks.then_some(("", Align::Left)));
    let mut table = TextTable::new(&head);
    for row in rows {
        let mut line = vec![row.name.clone(), row.unit.unwrap_or("-").to_owned()];
        line.extend(stated.then(|| or_dash(row.stated, number)));
        if found.exact {
            line.push(or_dash(row.value, number));
        } else {
            line.extend(cells(row.value, row.std));
        }
        line.extend(remarks.then(|| row.remark.clone()));
        table.row(&line);
    }
    table.finish()
}
