//! `tpm design` of a mechanism: Fourier series of the joints within the limits that show the base parameters well.

use crate::failure::{Failure, Outcome};
use crate::input::choice::one_of;
use crate::interrupt;
use crate::output::{file, picture, progress};
use clap::builder::RangedU64ValueParser;
use clap::builder::TypedValueParser;
use std::path::{Path, PathBuf};
use tpm_runtime::model::Model as _;
use tpm_runtime::report::{Align, TextTable, number, or_dash};
use tpm_runtime::session::Session;
use tpm_runtime::study::{
    Criterion, Excitation, ExcitationError, ExcitationSettings, HARMONICS, Proposed, STARTS, excitation,
};

/// Quantities of the table of limits, and their headings.
const KINDS: [&str; 4] = ["position", "velocity", "acceleration", "input"];

/// What a motion is chosen for.
fn criterion() -> impl TypedValueParser<Value = Criterion> {
    one_of([
        (Criterion::Condition, "condition", "The condition number of the regressor in base parameters"),
        (
            Criterion::Determinant,
            "determinant",
            "The determinant of the information, every row divided by the limit of its input",
        ),
    ])
}

/// Options for mechanisms.
#[derive(clap::Args)]
pub(crate) struct MechanismArgs {
    /// Of a mechanism: what the motion is chosen for.
    #[arg(long, value_parser = criterion(), default_value = "condition")]
    criterion: Criterion,
    /// Of a mechanism: highest harmonic of every joint.
    #[arg(long, value_name = "N", default_value_t = HARMONICS, value_parser = clap::value_parser!(u32).range(2..=50))]
    harmonics: u32,
    /// Of a mechanism: the period of the motion; that of the experiment's last stage when not given.
    #[arg(long, value_name = "SECONDS")]
    period: Option<f64>,
    /// Of a mechanism: number of random motions from which the search starts.
    #[arg(long, value_name = "N", default_value_t = STARTS, value_parser = RangedU64ValueParser::<usize>::new().range(1..))]
    starts: usize,
    /// Of a mechanism: seed of the random motions.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Of a mechanism: end the search after this time; it ends with its last start when not given.
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<f64>,
    /// Of a mechanism: write the best motion into this folder: model, experiment, samples for the controller, figure.
    #[arg(long, value_name = "FOLDER")]
    write: Option<PathBuf>,
}

impl MechanismArgs {
    fn settings(&self) -> Result<ExcitationSettings, Failure> {
        if let Some(seconds) = self.seconds.filter(|seconds| !(seconds.is_finite() && *seconds > 0.0)) {
            return Err(Failure::Input(format!("--seconds {seconds}: type a positive number of seconds")));
        }
        let Self { criterion, harmonics, period, starts, seed, seconds, .. } = *self;
        Ok(ExcitationSettings { criterion, harmonics, period, starts, seed, seconds })
    }

    /// The first option that asks for something other than its default does.
    pub(super) fn asked(&self) -> Option<&'static str> {
        let asked = [
            ("--criterion", self.criterion != Criterion::default()),
            ("--harmonics", self.harmonics != HARMONICS),
            ("--period", self.period.is_some()),
            ("--starts", self.starts != STARTS),
            ("--seed", self.seed != 0),
            ("--seconds", self.seconds.is_some()),
            ("--write", self.write.is_some()),
        ];
        asked.into_iter().find_map(|(name, is_asked)| is_asked.then_some(name))
    }
}

#[derive(serde::Serialize)]
struct Report<'a> {
    schema: &'static str,
    model: &'a str,
    coordinates: Vec<&'a str>,
    #[serde(flatten)]
    excitation: &'a Excitation,
}

/// Where the result goes.
pub(super) struct Asked<'a> {
    /// The model file.
    pub(super) file: &'a Path,
    /// Motions that are printed.
    pub(super) best: usize,
    pub(super) json: bool,
    pub(super) output: Option<&'a Path>,
}

/// Whether the model is a mechanism all of whose joints move on their own.
pub(super) fn is_meant(session: &Session) -> bool {
    let declared = session.model();
    declared.parsed().mechanism.is_some()
        && declared.prepared().model.eliminations.is_empty()
        && session.machine().pattern().open().is_empty()
}

/// Runs the command.
pub(super) fn run(args: &MechanismArgs, asked: &Asked<'_>, session: &Session) -> Outcome {
    let settings = args.settings()?;
    let bar = progress::Bar::new("designing");
    let (found, interrupted) = interrupt::watched(|go_on| {
        let step = |done: usize, work: usize| {
            bar.set(done as u64, work as u64);
            go_on()
        };
        (excitation(session, &settings, &step), !go_on())
    });
    drop(bar);
    let found = match found {
        Err(ExcitationError::TooShort) if interrupted => return Err(Failure::Interrupted),
        found => found.map_err(remedied)?,
    };
    let plant = session.machine().plant();
    let text = if asked.json {
        let coordinates = (0..plant.dims().coordinates).map(|c| plant.coordinate(c).name).collect();
        let model = plant.name();
        file::json(&Report { schema: "tpm.excitation/1", model, coordinates, excitation: &found })?
    } else {
        describe(&found, asked.best)
    };
    if let (Some(folder), Some(best)) = (&args.write, found.motions.first()) {
        write(folder, asked.file, session, &found, best)?;
    }
    file::emit(asked.output, &text)?;
    if interrupted { Err(Failure::Interrupted) } else { Ok(()) }
}

/// A failure of the search, with the flag that helps.
fn remedied(error: ExcitationError) -> Failure {
    let remedy = match &error {
        ExcitationError::Setting { setting: "period", .. } => " (--period SECONDS)",
        ExcitationError::Setting { .. } => " (--harmonics N)",
        ExcitationError::TooShort => " (--seconds SECONDS)",
        ExcitationError::NoMotion { .. } => " (--period SECONDS makes it longer)",
        _ => "",
    };
    Failure::Input(format!("{error}{remedy}"))
}

/// Writes what plays the best motion: all files or none.
fn write(folder: &Path, model: &Path, session: &Session, found: &Excitation, best: &Proposed) -> Outcome {
    let at = |error: &dyn std::fmt::Display| Failure::Input(format!("--write {}: {error}", folder.display()));
    let files = found.files(session, &best.trajectory).map_err(|error| at(&error))?;
    let figure = found.figure(session, best).map_err(|error| at(&error))?;
    let name = model.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy().into_owned());
    let path = |ending: &str| folder.join(format!("{name}{ending}"));
    let drawn = path(".svg");
    let picture = picture::bytes(&drawn, &figure)?;
    let (model, experiment, samples) = (path(".tpm"), path(".toml"), path(".csv"));
    file::write_into(
        folder,
        &[
            (&model, files.model.as_bytes()),
            (&experiment, files.experiment.as_bytes()),
            (&samples, files.samples.as_bytes()),
            (&drawn, &picture),
        ],
    )
}

fn describe(found: &Excitation, best: usize) -> String {
    let mut table =
        TextTable::new(&[("motion", Align::Right), ("condition", Align::Right), ("criterion", Align::Right)]);
    for (rank, motion) in found.motions.iter().take(best).enumerate() {
        table.row(&[(rank + 1).to_string(), number(motion.condition), number(motion.value)]);
    }
    let mut text = table.finish();
    let what = match found.criterion {
        Criterion::Condition => "logarithm of a bound of the condition number",
        Criterion::Determinant => "negative logarithm of the determinant for each base parameter",
    };
    text.push_str(&format!(
        "\ncriterion: {what}; {} before anything was improved\n{} of {} starts within the limits, {} base parameters, {} harmonics of {} rad/s\n",
        number(found.before),
        found.feasible,
        found.starts,
        found.base.len(),
        found.harmonics,
        number(found.frequency)
    ));
    let Some(first) = found.motions.first() else { return text };
    let mut table = TextTable::new(&[
        ("of the first motion", Align::Left),
        ("", Align::Left),
        ("least", Align::Right),
        ("largest", Align::Right),
        ("of the limit", Align::Right),
    ]);
    for kind in KINDS {
        for used in first.used.iter().filter(|used| used.kind == kind) {
            let share = or_dash(used.share, |share| format!("{:.1} %", 100.0 * share));
            table.row(&[kind.into(), used.name.clone(), number(used.range[0]), number(used.range[1]), share]);
        }
    }
    text.push('\n');
    text.push_str(&table.finish());
    text.push_str("the limits hold at every instant of the period, for the inputs of the prior's values\n");
    text
}
