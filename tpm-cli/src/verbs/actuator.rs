//! `tpm actuator`: whether motors can follow a pattern, which limit they exceed and when, and the largest frequency and
//! amplitudes that they can follow.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::assignment;
use crate::input::load::Loaded;
use crate::input::values::{Output, ValueArgs, Values};
use crate::output::{file, picture};
use crate::render::flags;
use crate::verbs::split::motions;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tpm_runtime::model::Model as _;
use tpm_runtime::physical::{MotorizedMachine, MotorizedMachineError};
use tpm_runtime::plant::actuator::{
    Bound, Limit, Motor, MotorFile, Requirement, bound, requirements, scaled, torque_speed,
};
use tpm_runtime::report::{Align, TextTable, number};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::split::split;

/// Number of samples in a period.
const SAMPLES: usize = 2048;
/// Factors on the amplitudes for which the largest frequency is tabulated.
const FACTORS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];

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
    pub(crate) model: ExactModel,
    pub(crate) machine: MotorizedMachine,
    /// Names of the amplitudes.
    pub(crate) names: Vec<String>,
    pub(crate) amplitudes: Vec<f64>,
    /// Name of the frequency.
    pub(crate) frequency_name: String,
    pub(crate) frequency: f64,
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
        Ok(Moved {
            names: pattern.amplitudes.iter().map(|symbol| model.quantity(*symbol).name.to_string()).collect(),
            amplitudes: pattern.amplitudes.iter().map(|symbol| of(*symbol).unwrap_or(f64::NAN)).collect(),
            frequency_name: model.quantity(pattern.frequency).name.to_string(),
            frequency,
            machine,
            model,
            values,
            symbolic,
            pattern,
        })
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
    /// The amplitudes and the frequency in words, such as `lambda = 0.1, w = 3`.
    pub(crate) fn motion(&self) -> String {
        let mut all: Vec<String> = self
            .names
            .iter()
            .zip(&self.amplitudes)
            .map(|(name, value)| format!("{name} = {}", number(*value)))
            .collect();
        all.push(format!("{} = {}", self.frequency_name, number(self.frequency)));
        all.join(", ")
    }

    /// Reads the motors of a motor file.
    pub(crate) fn motors(&self, path: &Path) -> Result<Vec<Option<Motor>>, Failure> {
        let text = tpm_runtime::report::read_text(path).map_err(|error| Failure::read(path, error))?;
        MotorFile::parse(&text)
            .and_then(|file| file.motors(self.machine.model(), self.machine.driven()))
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

    /// Name of an input of the machine.
    pub(crate) fn input(&self, index: usize) -> &str {
        self.machine.model().input(index).name
    }
}

/// The largest frequency and amplitudes that the motors can follow.
struct Bounds {
    /// The largest frequency, by factor on the amplitudes.
    frequencies: Vec<(f64, Bound)>,
    /// The largest factor on the amplitudes at the given frequency.
    factor: Bound,
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
    let demand = moved.machine.demand();
    let trajectory = moved.machine.trajectory(&moved.amplitudes, moved.frequency);
    let samples = SAMPLES.max(64 * (trajectory.highest_harmonic() as usize).next_power_of_two());
    let failed = |error: tpm_runtime::motion::TrialError| Failure::Input(error.to_string());
    let found = requirements(&demand, &motors, &trajectory, samples).map_err(failed)?;
    let motion = |factor: f64, w: f64| Ok(moved.machine.trajectory(&scaled(&moved.amplitudes, factor), w));
    let mut frequencies = Vec::new();
    for factor in FACTORS {
        let end = bound(&demand, &motors, moved.frequency, |w| motion(factor, w)).map_err(failed)?;
        frequencies.push((factor, end));
    }
    let factor = bound(&demand, &motors, 1.0, |factor| motion(factor, moved.frequency)).map_err(failed)?;
    let bounds = Bounds { frequencies, factor };
    if let Some(path) = &args.plot {
        let names: Vec<String> = (0..motors.len()).map(|i| moved.input(i).to_owned()).collect();
        let title = format!("{}: {}", moved.model.name, moved.motion());
        picture::draw(path, &torque_speed(&title, &found, &motors, &names))?;
    }
    let text =
        if args.json { file::json(&as_json(&moved, &found, &bounds))? } else { as_text(&moved, &found, &bounds) };
    file::emit(args.output.as_deref(), &text)?;
    let over: Vec<String> =
        found.iter().filter(|requirement| !requirement.feasible()).map(|r| verdict(&moved, r)).collect();
    if over.is_empty() { Ok(()) } else { Err(Failure::Incomplete(over.join("\n"))) }
}

/// One sentence on whether a motor suffices.
fn verdict(moved: &Moved, found: &Requirement) -> String {
    let name = moved.input(found.input);
    if found.feasible() {
        let worst = found.worst();
        let share = number(100.0 * worst.share());
        return format!(
            "the motor of {name} can follow: at most {share} % of its {} is used",
            worst.limit.name_and_unit().0
        );
    }
    let over: Vec<String> = found
        .peaks
        .iter()
        .filter(|peak| peak.share() > 1.0)
        .map(|peak| {
            let (limit, unit) = peak.limit.name_and_unit();
            let (value, available) = (number(peak.value), number(peak.available));
            format!("{limit} {value} {unit} of {available} {unit} at {} s", number(peak.time))
        })
        .collect();
    format!("the motor of {name} cannot follow: {}", over.join(", "))
}

fn as_text(moved: &Moved, found: &[Requirement], bounds: &Bounds) -> String {
    let mut text = format!("{}: {}\n", moved.model.name, moved.motion());
    for requirement in found {
        let _ = write!(text, "\n{}", one_motor(moved, requirement));
    }
    let _ = writeln!(text, "\nlargest {} by factor on the amplitudes\n", moved.frequency_name);
    let mut table = TextTable::new(&[
        ("factor", Align::Right),
        ("amplitudes", Align::Left),
        ("largest [rad/s]", Align::Right),
        ("limit", Align::Left),
    ]);
    for (factor, end) in &bounds.frequencies {
        let (value, limit) = end_text(moved, *end);
        table.row(&[number(*factor), amplitudes(moved, *factor), value, limit]);
    }
    text.push_str(&table.finish());
    let (value, limit) = end_text(moved, bounds.factor);
    let size = match bounds.factor {
        Bound::At { value, .. } => format!(" ({})", amplitudes(moved, value)),
        _ => String::new(),
    };
    let _ = writeln!(
        text,
        "\nlargest factor on the amplitudes at {} = {}: {value}{size}, limit: {limit}",
        moved.frequency_name,
        number(moved.frequency)
    );
    text
}

fn amplitudes(moved: &Moved, factor: f64) -> String {
    let all = moved.names.iter().zip(&moved.amplitudes);
    all.map(|(name, value)| format!("{name} = {}", number(factor * value))).collect::<Vec<_>>().join(", ")
}

fn end_text(moved: &Moved, end: Bound) -> (String, String) {
    match end {
        Bound::At { value, input, limit } => {
            (number(value), format!("{} of {}", limit.name_and_unit().0, moved.input(input)))
        }
        Bound::Never { input, limit } => {
            ("none".to_owned(), format!("{} of {}, however slow or small", limit.name_and_unit().0, moved.input(input)))
        }
        Bound::Beyond(value) => (format!("beyond {}", number(value)), "none met".to_owned()),
    }
}

fn one_motor(moved: &Moved, found: &Requirement) -> String {
    let mut text = format!("{}\n\n", verdict(moved, found));
    let mut table = TextTable::new(&[
        ("limit", Align::Left),
        ("largest", Align::Right),
        ("available", Align::Right),
        ("unit", Align::Left),
        ("share [%]", Align::Right),
        ("at [s]", Align::Right),
        ("beyond, of time [%]", Align::Right),
    ]);
    for peak in found.peaks {
        let (name, unit) = peak.limit.name_and_unit();
        let limited = peak.available.is_finite();
        let given = |value: String| if limited { value } else { "-".to_owned() };
        table.row(&[
            name.to_owned(),
            number(peak.value),
            given(number(peak.available)),
            unit.to_owned(),
            given(number(100.0 * peak.share())),
            number(peak.time),
            given(number(100.0 * found.share_of_time(peak.limit))),
        ]);
    }
    text.push_str(&table.finish());
    let unit = moved.machine.model().input(found.input).unit.map_or(String::new(), |unit| format!(" {unit}"));
    let _ = writeln!(
        text,
        "{} wanted {}{unit}, available at stall {}{unit}",
        moved.input(found.input),
        number(found.force.0),
        number(found.force.1)
    );
    let _ = writeln!(
        text,
        "average power {} W, of which the resistance takes {} W",
        number(found.average_power),
        number(found.resistive_power)
    );
    if let Some(cut) = found.cut_off {
        // An inertia that differs by rounding alone does not vary.
        let varies = cut.inertia - cut.least_inertia > 1e-6 * cut.inertia;
        let varying = if varies { format!("{} to ", number(cut.least_inertia)) } else { String::new() };
        let _ = writeln!(
            text,
            "inertia at the rotor {}{} kg m^2, amplitude {} rad: natural frequency {} rad/s (C.9), cut-off by current {} rad/s (C.12) at {} V (C.13)",
            varying,
            number(cut.inertia),
            number(cut.amplitude),
            number(cut.natural),
            number(cut.current),
            number(cut.voltage)
        );
    }
    if !found.smooth {
        text.push_str("the force jumps, so that the voltage of the inductance at the jumps is more than shown\n");
    }
    text.push('\n');
    let mut table = TextTable::new(&[
        ("harmonic", Align::Right),
        ("[rad/s]", Align::Right),
        ("motion-independent [A]", Align::Right),
        ("motion-dependent [A]", Align::Right),
        ("current [A]", Align::Right),
        ("voltage [V]", Align::Right),
    ]);
    let largest = found.harmonics.iter().map(|h| (h.independent + h.dependent).norm()).fold(0.0, f64::max);
    let shown = |size: f64| if size > 1e-9 * largest { number(size) } else { "0".to_owned() };
    for harmonic in found.harmonics.iter().filter(|h| h.independent.norm().max(h.dependent.norm()) > 1e-4 * largest) {
        table.row(&[
            harmonic.harmonic.to_string(),
            number(harmonic.harmonic as f64 * moved.frequency),
            shown(harmonic.independent.norm()),
            shown(harmonic.dependent.norm()),
            shown((harmonic.independent + harmonic.dependent).norm()),
            shown((harmonic.independent_voltage + harmonic.dependent_voltage).norm()),
        ]);
    }
    text.push_str(&table.finish());
    text
}

fn as_json(moved: &Moved, found: &[Requirement], bounds: &Bounds) -> Value {
    let finite = |value: f64| if value.is_finite() { json!(value) } else { Value::Null };
    let motors: Vec<Value> = found
        .iter()
        .map(|requirement| {
            let peaks: Vec<Value> = requirement
                .peaks
                .iter()
                .map(|peak| {
                    let (name, unit) = peak.limit.name_and_unit();
                    json!({
                        "limit": name, "unit": unit, "largest": peak.value, "time": peak.time,
                        "available": finite(peak.available), "share": peak.share(),
                        "time_beyond": requirement.share_of_time(peak.limit),
                    })
                })
                .collect();
            let pair = |value: tpm_runtime::frequency::Complex| json!([value.re, value.im]);
            let harmonics: Vec<Value> = requirement
                .harmonics
                .iter()
                .map(|h| {
                    json!({
                        "harmonic": h.harmonic,
                        "current": {"independent": pair(h.independent), "dependent": pair(h.dependent)},
                        "voltage": {"independent": pair(h.independent_voltage), "dependent": pair(h.dependent_voltage)},
                    })
                })
                .collect();
            json!({
                "input": moved.input(requirement.input),
                "feasible": requirement.feasible(),
                "limits": peaks,
                "force": {"wanted": requirement.force.0, "stall": finite(requirement.force.1)},
                "average_power": requirement.average_power,
                "resistive_power": requirement.resistive_power,
                "smooth": requirement.smooth,
                "cut_off": requirement.cut_off.map(|cut| json!({
                    "inertia": cut.inertia, "least_inertia": cut.least_inertia, "amplitude": cut.amplitude, "natural": cut.natural,
                    "current": finite(cut.current), "voltage": finite(cut.voltage),
                })),
                "harmonics": harmonics,
            })
        })
        .collect();
    let end = |end: Bound| match end {
        Bound::At { value, input, limit } => json!({"value": value, "input": moved.input(input), "limit": name(limit)}),
        Bound::Never { input, limit } => json!({"value": null, "input": moved.input(input), "limit": name(limit)}),
        Bound::Beyond(value) => json!({"beyond": value}),
    };
    let frequencies: Vec<Value> =
        bounds.frequencies.iter().map(|(factor, e)| json!({"factor": factor, "largest": end(*e)})).collect();
    let amplitudes: serde_json::Map<String, Value> =
        moved.names.iter().cloned().zip(moved.amplitudes.iter().map(|value| json!(value))).collect();
    json!({
        "schema": "tpm.actuator/1",
        "model": moved.model.name,
        "amplitudes": amplitudes,
        "frequency": moved.frequency,
        "feasible": found.iter().all(Requirement::feasible),
        "motors": motors,
        "largest_frequency": frequencies,
        "largest_factor": end(bounds.factor),
    })
}

fn name(limit: Limit) -> &'static str {
    limit.name_and_unit().0
}
