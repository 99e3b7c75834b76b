//! `tpm regulate`: state feedback that keeps a machine at rest in a point, with its poles, its margins and its code.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::{assignment, by_name, number_assignment};
use crate::input::choice::one_of;
use crate::input::linear::{operating_point, state_space, tell_friction};
use crate::input::load::Loaded;
use crate::input::values::{ValueArgs, Values};
use crate::output::file;
use crate::verbs::generate::scalar;
use clap::builder::TypedValueParser;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_codegen::emit::regulator::{RegulatorSource, Signal};
use tpm_codegen::generate::{Language, Scalar, generate_regulator};
use tpm_runtime::control::Differentiator;
use tpm_runtime::numerics::Matrix;
use tpm_runtime::plant::regulator::{Design, DesignError, Rates, RegulatorWeights, Weighted, design};
use tpm_runtime::study::{AtRest, Regulated, mode_in_words};
use tpm_symbolic::budget;
use tpm_symbolic::expr::graph::{ExprId, Node};
use tpm_symbolic::linear::linearize::linearize;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::number::rational::{self, Rational};

/// A language of the regulator's code.
fn language() -> impl TypedValueParser<Value = Language> {
    one_of([(Language::Rust, "rust", "A module over `core` alone"), (Language::C, "c", "A header and a source in C99")])
}

/// Options of `tpm regulate`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// Value of a coordinate or input at the point, such as th2=pi or F=m*g; what is not given is 0.
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    at: Vec<(String, String)>,
    #[command(flatten)]
    values: ValueArgs,
    /// Time between the controller's samples, s.
    #[arg(long, value_name = "SECONDS")]
    sample_time: f64,
    /// The controller forms the rates as differences of the coordinates, filtered with this time constant (0 for plain ones);
    /// rates are measured when not given.
    #[arg(long, value_name = "SECONDS")]
    derivative_filter: Option<f64>,
    /// Weight of the square of a coordinate, of a rate, dot(NAME), or of an input in the cost; 1 for coordinates and inputs and 0
    /// for rates when not given.
    #[arg(long, value_name = "NAME=VALUE", value_parser = number_assignment)]
    weight: Vec<(String, f64)>,
    /// Write the regulator's code in this language, into the folder of --code.
    #[arg(long, value_parser = language(), requires = "code")]
    lang: Option<Language>,
    /// The folder of the code, which is made when there is none.
    #[arg(long, value_name = "DIR", requires = "lang")]
    code: Option<PathBuf>,
    /// With --lang c, what names and files begin with; the model's name in small letters and _regulator when not given.
    #[arg(long, value_name = "P", requires = "lang")]
    prefix: Option<String>,
    /// The scalar of the code; double when not given.
    #[arg(long, value_parser = scalar(), requires = "lang")]
    real: Option<Scalar>,
    /// Print JSON (tpm.regulator/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// A model at its point, with numbers.
struct Machine {
    model: String,
    coordinates: Vec<AtRest>,
    inputs: Vec<AtRest>,
    a: Matrix,
    b: Matrix,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let machine = Machine::load(args)?;
    let weights = machine.weights(args)?;
    let rates = args.derivative_filter.map_or(Rates::Measured, Rates::Differences);
    machine.charge(rates);
    let found = design(&machine.a, &machine.b, args.sample_time, rates, &weights)
        .map_err(|error| Failure::Input(machine.fault(&error)))?;
    if let Some(language) = args.lang {
        machine.write_code(args, language, &found)?;
    }
    let answer = Regulated::new(
        &machine.model,
        (&machine.coordinates, &machine.inputs),
        (args.sample_time, args.derivative_filter),
        &weights,
        &found,
    );
    let text = if args.json { file::json(&answer)? } else { answer.to_string() };
    file::emit(args.output.as_deref(), &text)
}

/// Operations for the eigenvalues of a matrix by the cube of its rows, for the budget.
const EIGENVALUES: u64 = 4;
/// Operations for a regulator by the cube of its states: two Riccati equations and the test of its inputs by every mode.
const REGULATOR: u64 = 100;
/// Operations for the responses of a loop by its states, at the frequencies at which margins are looked for.
const RESPONSES: u64 = 30_000;

impl Machine {
    /// Counts the operations of the design, which is done in floating point and cannot count them itself.
    fn charge(&self, rates: Rates) {
        let (states, inputs) = (2 * self.coordinates.len() as u64, self.inputs.len() as u64);
        let played = if matches!(rates, Rates::Differences(_)) { 2 * states } else { states };
        let loops =
            EIGENVALUES.saturating_mul(played.saturating_pow(3)).saturating_add(RESPONSES.saturating_mul(played));
        let regulator = REGULATOR.saturating_mul(states.saturating_pow(3));
        budget::charge(loops.saturating_mul(inputs + 1).saturating_add(regulator));
    }

    fn load(args: &Args) -> Result<Self, Failure> {
        let loaded = Loaded::from_file(&args.file)?;
        let mut model = loaded.model().clone();
        let names: Vec<String> = model.coordinates.iter().map(|coordinate| coordinate.name.clone()).collect();
        let symbols: Vec<_> = model.inputs().collect();
        let drives: Vec<String> = symbols.iter().map(|symbol| model.quantity(*symbol).name.to_string()).collect();
        let values = Values::load(&args.values, &model)?;
        let point = operating_point(&args.at, &mut model, &names, &drives)?;
        let linear = linearize(&mut model, &point)
            .map_err(|error| Failure::Input(format!("{}: {error}", args.file.display())))?;
        tell_friction(&model, &linear);
        let (space, _) = state_space(&model, &linear, &values)?.ok_or_else(|| {
            let flags: Vec<String> =
                values.missing(&model, None).iter().map(|name| format!("--value {name}=VALUE")).collect();
            Failure::Input(format!("a regulator needs numbers; give --params FILE or {}", flags.join(" ")))
        })?;
        // What the linear model does not depend on may still stand in the point.
        let standing =
            point.coordinates.iter().map(|(_, value)| *value).chain(point.inputs.iter().map(|(_, value)| *value));
        let standing: Vec<ExprId> = standing.collect();
        let settled = values.settled(|values| {
            let value = |expr: &ExprId| ("the point".to_owned(), in_numbers(&model, *expr, values));
            Ok(standing.iter().map(value).collect())
        })?;
        let at = |given: Option<ExprId>| given.map_or(0.0, |value| in_numbers(&model, value, &settled));
        let coordinates = model
            .coordinates
            .iter()
            .enumerate()
            .map(|(c, coordinate)| AtRest {
                name: coordinate.name.clone(),
                unit: coordinate.unit.as_ref().map(ToString::to_string),
                at: at(point.coordinates.iter().find(|(other, _)| other.0 as usize == c).map(|(_, value)| *value)),
            })
            .collect();
        let inputs = symbols
            .iter()
            .map(|symbol| AtRest {
                name: model.quantity(*symbol).name.to_string(),
                unit: model.quantity(*symbol).unit.as_ref().map(ToString::to_string),
                at: at(point.inputs.iter().find(|(other, _)| other == symbol).map(|(_, value)| *value)),
            })
            .collect();
        let matrix = |rows: &[Vec<Rational>]| {
            let rows: Vec<Vec<f64>> = rows.iter().map(|row| row.iter().map(rational::to_f64).collect()).collect();
            Matrix::from_rows(&rows).expect("invariant: the rows of a state space have one length")
        };
        Ok(Self { model: model.name.to_string(), coordinates, inputs, a: matrix(&space.a), b: matrix(&space.b) })
    }

    /// Names of the states: coordinates, then their rates.
    fn states(&self) -> Vec<String> {
        let rates = self.coordinates.iter().map(|signal| format!("dot({})", signal.name));
        self.coordinates.iter().map(|signal| signal.name.clone()).chain(rates).collect()
    }

    fn weights(&self, args: &Args) -> Result<RegulatorWeights, Failure> {
        let states = self.states();
        let inputs: Vec<String> = self.inputs.iter().map(|signal| signal.name.clone()).collect();
        let given: BTreeMap<String, f64> =
            by_name("--weight", &args.weight, &[states.clone(), inputs.clone()].concat())?;
        let of = |name: &String, usual: f64| given.get(name).copied().unwrap_or(usual);
        let n = self.coordinates.len();
        Ok(RegulatorWeights {
            state: states.iter().enumerate().map(|(at, name)| of(name, if at < n { 1.0 } else { 0.0 })).collect(),
            input: inputs.iter().map(|name| of(name, 1.0)).collect(),
        })
    }

    /// Why there is no regulator, with the names of the model.
    fn fault(&self, error: &DesignError) -> String {
        match error {
            DesignError::Weight { of: Weighted::State(state), value } => format!(
                "--weight {}={value}: the weight of a coordinate or a rate must be a number that is not negative",
                self.states()[*state]
            ),
            DesignError::Weight { of: Weighted::Input(input), value } => format!(
                "--weight {}={value}: the weight of an input must be a positive number, every input must cost something",
                self.inputs[*input].name
            ),
            DesignError::Unreached { modes } => {
                let modes: Vec<String> = modes.iter().map(|mode| mode_in_words(mode, &self.coordinates)).collect();
                format!(
                    "{} cannot be held there: no input reaches {}; give the model an input that does, or regulate a model without this motion",
                    self.model,
                    modes.join(", nor ")
                )
            }
            other => other.to_string(),
        }
    }

    fn write_code(&self, args: &Args, language: Language, found: &Design) -> Result<(), Failure> {
        let Some(folder) = &args.code else { return Ok(()) };
        if language == Language::Rust && args.prefix.is_some() {
            return Err(Failure::Input("--prefix is for --lang c; Rust names its module by the model".to_owned()));
        }
        let signals = |signals: &[AtRest]| {
            let signals = signals.iter().cloned();
            signals.map(|AtRest { name, unit, at }| Signal { name, unit, at }).collect()
        };
        let source = RegulatorSource {
            model: self.model.clone(),
            coordinates: signals(&self.coordinates),
            inputs: signals(&self.inputs),
            gain: found.sampled.gain().to_rows(),
            sample_time: args.sample_time,
            differences: args.derivative_filter.map(|time| Differentiator::new(args.sample_time, time).pole()),
        };
        let files = generate_regulator(
            &source,
            language,
            &command(args),
            args.prefix.as_deref(),
            args.real.unwrap_or_default(),
        )
        .map_err(|error| Failure::Input(error.to_string()))?;
        let paths: Vec<PathBuf> = files.iter().map(|file| folder.join(&file.name)).collect();
        let contents: Vec<(&Path, &[u8])> =
            paths.iter().zip(&files).map(|(path, file)| (path.as_path(), file.text.as_bytes())).collect();
        file::write_into(folder, &contents)?;
        for path in &paths {
            file::remark(&format!("wrote {}", path.display()));
        }
        Ok(())
    }
}

/// The command for the header of the code, with the model's file without its folder.
fn command(args: &Args) -> String {
    let name = args.file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let mut command = format!("tpm regulate {name}{} --sample-time {}", args.values.flags(), args.sample_time);
    if let Some(time) = args.derivative_filter {
        command.push_str(&format!(" --derivative-filter {time}"));
    }
    for (name, value) in &args.at {
        command.push_str(&format!(" --at {name}={value}"));
    }
    for (name, value) in &args.weight {
        command.push_str(&format!(" --weight {name}={value}"));
    }
    command
}

/// A value of the point, an expression of constants and parameters, in numbers.
fn in_numbers(model: &ExactModel, value: ExprId, values: &Values) -> f64 {
    model.graph.evaluate(value, |node| match node {
        Node::Symbol(symbol) => match &model.quantity(*symbol).kind {
            Kind::Constant { value: Some(value) } => rational::to_f64(value),
            _ => values.get(*symbol).map_or(f64::NAN, rational::to_f64),
        },
        _ => 0.0,
    })
}
