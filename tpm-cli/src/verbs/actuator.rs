//! `tpm actuator`: whether motors can follow a pattern, which limit they exceed and when, and the largest frequency and
//! amplitudes that they can follow.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::assignment;
use crate::input::load::Loaded;
use crate::input::values::{Output, ValueArgs, Values};
use crate::output::{file, picture};
use crate::render::flags;
use crate::verbs::split::motions;
use std::path::{Path, PathBuf};
use tpm_runtime::model::Model as _;
use tpm_runtime::physical::{MotorizedMachine, MotorizedMachineError};
use tpm_runtime::plant::actuator::{Motor, MotorFile, scaled};
use tpm_runtime::study::{Actuators, MovedMachine};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::split::split;

/// Factors on amplitudes and on the frequency at which it is tested what a motion needs of the parameters, and samples of each.
const TESTED: [f64; 3] = [0.5, 1.0, 1.7];
const TEST_SAMPLES: usize = 64;
/// Number of motions, drawn at will, at which it is tested what any motion needs.
const ANY_MOTIONS: usize = 40;

/// What a command computes from the values of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Use {
    /// The inputs along the pattern, with other amplitudes and frequencies too.
    Pattern,
    /// The inputs of any motion.
    AnyMotion,
}

/// Options of `tpm actuator`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
    /// The motor file: one table `motors.INPUT` per motor.
    #[arg(long, value_name = "FILE")]
    motor: PathBuf,
    /// Draw torque over speed and voltage over time into this file, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON (tpm.actuator/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// A model with values and a motion.
#[derive(clap::Args)]
pub(crate) struct MachineArgs {
    /// The model file.
    pub(crate) file: PathBuf,
    /// The pattern; the model's first when not given.
    #[arg(long, value_name = "NAME")]
    pattern: Option<String>,
    /// The coordinates that an input drives, such as u=phi; found from the equations when not given.
    #[arg(long, value_name = "INPUT=COORDINATE,..", value_parser = assignment)]
    motion: Vec<(String, String)>,
    /// Values of parameters, run-time constants, amplitudes and frequency.
    #[command(flatten)]
    values: ValueArgs,
}

/// A machine with its motion.
pub(crate) struct Moved {
    pub(crate) machine: MovedMachine,
    model: ExactModel,
    values: Values,
    symbolic: tpm_symbolic::plan::split::Split,
    pattern: tpm_symbolic::mechanics::pattern::Pattern,
}

impl MachineArgs {
    /// Reads the model and everything that its motion needs; parameters that a result leaves open may stay so where nothing that is
    /// `needed` depends on them.
    pub(crate) fn moved(&self, needed: Use) -> Result<Moved, Failure> {
        let loaded = Loaded::from_file(&self.file)?;
        let model = loaded.model().clone();
        let pattern = loaded.pattern(self.pattern.as_deref())?.clone();
        let values = Values::load_with(&self.values, &model, Some(&pattern))?;
        let symbolic = split(&model, &motions(&model, &self.motion)?).map_err(|error| loaded.at_split(&error))?;
        let missing = values.missing(&model, Some(&pattern));
        if !missing.is_empty() {
            return Err(Failure::Input(format!(
                "a value is missing for {}; give it with --value NAME=VALUE or in --params FILE",
                missing.join(", ")
            )));
        }
        let machine = |values: &Values| {
            let of = |symbol: Symbol| values.get(symbol).map(rational::to_f64);
            MotorizedMachine::new(&symbolic, &pattern, of).map_err(|error| match error {
                MotorizedMachineError::Prepare(error) => loaded.at(&error),
                other => Failure::Input(other.to_string()),
            })
        };
        let values = values.settled(|values| {
            let of = |symbol: &Symbol| values.get(*symbol).map_or(f64::NAN, rational::to_f64);
            let amplitudes: Vec<f64> = pattern.amplitudes.iter().map(of).collect();
            inputs(&machine(values)?, &amplitudes, of(&pattern.frequency), needed)
        })?;
        let machine = machine(&values)?;
        let of = |symbol: Symbol| values.get(symbol).map(rational::to_f64);
        let frequency = of(pattern.frequency).unwrap_or(f64::NAN);
        if frequency.is_nan() || frequency <= 0.0 {
            let name = &model.quantity(pattern.frequency).name;
            return Err(Failure::Input(format!("--value {name}={frequency}: the frequency must be positive")));
        }
        let named = |symbol: Symbol| model.quantity(symbol).name.to_string();
        let amplitudes = pattern.amplitudes.iter();
        let machine = MovedMachine {
            model: model.name.to_string(),
            machine,
            amplitudes: amplitudes.map(|symbol| (named(*symbol), of(*symbol).unwrap_or(f64::NAN))).collect(),
            frequency: (named(pattern.frequency), frequency),
        };
        Ok(Moved { machine, model, values, symbolic, pattern })
    }
}

/// Both parts of every input, at the motions that are needed.
fn inputs(machine: &MotorizedMachine, amplitudes: &[f64], frequency: f64, needed: Use) -> Result<Vec<Output>, Failure> {
    let (demand, model) = (machine.demand(), machine.model());
    let failed = |error: tpm_runtime::motion::TrialError| Failure::Input(error.to_string());
    let mut found = Vec::new();
    match needed {
        Use::Pattern => {
            for (factor, faster) in TESTED.into_iter().flat_map(|factor| TESTED.map(|faster| (factor, faster))) {
                let trajectory = machine.trajectory(&scaled(amplitudes, factor), faster * frequency);
                found.push(demand.along(&trajectory, TEST_SAMPLES).map_err(failed)?);
            }
        }
        Use::AnyMotion => {
            // Multiples of an irrational number, modulo one, are spread evenly and repeat never.
            let length = model.dims().motion_len();
            let drawn = |n: usize| 4.0 * ((n as f64 + 1.0) * std::f64::consts::SQRT_2).fract() - 2.0;
            found.push(demand.at((0..ANY_MOTIONS * length).map(drawn).collect()).map_err(failed)?);
        }
    }
    let count = model.dims().inputs;
    let parts = found.iter().flat_map(|parts| [("independent", &parts.independent), ("dependent", &parts.dependent)]);
    let named = parts.flat_map(|(label, part)| {
        let name = move |n: usize| format!("the motion-{label} part of {}", model.input(n % count).name);
        part.iter().enumerate().map(move |(n, value)| (name(n), *value))
    });
    Ok(named.collect())
}

impl Moved {
    /// Reads the motors of a motor file.
    pub(crate) fn motors(&self, path: &Path) -> Result<Vec<Option<Motor>>, Failure> {
        let text = tpm_runtime::report::read_text(path).map_err(|error| Failure::read(path, error))?;
        MotorFile::parse(&text)
            .and_then(|file| file.motors(self.machine.machine.model(), self.machine.machine.driven()))
            .map_err(|fault| Failure::Input(format!("{}: {}", path.display(), flags::file_fault(&fault))))
    }

    /// Parameters of the machine with other values of some of them; for an unknown name, an error with the name and a
    /// message.
    pub(crate) fn with_parameters<'n>(
        &self,
        given: impl Iterator<Item = (&'n str, f64)>,
    ) -> Result<Vec<f64>, (String, String)> {
        let mut changed = std::collections::BTreeMap::new();
        for (name, value) in given {
            let symbol = self.model.parameters().find(|symbol| self.model.quantity(*symbol).name == name);
            let Some(symbol) = symbol else {
                let names: Vec<&str> =
                    self.model.parameters().map(|symbol| self.model.quantity(symbol).name.as_str()).collect();
                return Err((
                    name.to_owned(),
                    format!("model {} has no parameter `{name}`; it has {}", self.model.name, names.join(", ")),
                ));
            };
            changed.insert(symbol, value);
        }
        let of =
            |symbol: Symbol| changed.get(&symbol).copied().or_else(|| self.values.get(symbol).map(rational::to_f64));
        let machine = MotorizedMachine::new(&self.symbolic, &self.pattern, of)
            .map_err(|error| (String::new(), error.to_string()))?;
        Ok(machine.parameters().to_vec())
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(path) = &args.plot {
        picture::Picture::of(path)?;
    }
    let moved = args.machine.moved(Use::Pattern)?;
    let motors = moved.motors(&args.motor)?;
    if motors.iter().all(Option::is_none) {
        return Err(Failure::Input(format!("{}: there is no motor in it; add [motors.INPUT]", args.motor.display())));
    }
    let found = Actuators::new(&moved.machine, &motors).map_err(|error| Failure::Input(error.to_string()))?;
    if let Some(path) = &args.plot {
        picture::draw(path, found.figure())?;
    }
    let text = if args.json { file::json(&found)? } else { found.to_string() };
    file::emit(args.output.as_deref(), &text)?;
    let over = found.overloaded();
    if over.is_empty() { Ok(()) } else { Err(Failure::Incomplete(over.join("\n"))) }
}
