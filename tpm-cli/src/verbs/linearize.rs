//! `tpm linearize`: state space, transfer functions, poles and zeros of a model about a point at rest.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::assignment;
use crate::input::linear::{operating_point, state_space, tell_friction};
use crate::input::load::Loaded;
use crate::input::values::{ValueArgs, Values};
use crate::output::{file, picture};
use crate::render::roots::{root_text, roots_text};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::PathBuf;
use tpm_runtime::frequency::{BodeSettings, NamedModel, TransferError, TransferFunction, bode_of_models};
use tpm_runtime::plot::Figure;
use tpm_runtime::report::{Align, TextTable, number};
use tpm_symbolic::budget;
use tpm_symbolic::expr::graph::{Coordinate, ExprId};
use tpm_symbolic::linear::linearize::{self, Linearization, Resolvent, StateSpace};
use tpm_symbolic::linear::transfer::{SymbolicTransfer, transfer_functions};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::unit::Unit;
use tpm_symbolic::number::rational::{self, Rational};

/// Largest distance of a pole from a zero, as a share of their size, at which they are said nearly to cancel.
const CLOSE: f64 = 1e-2;
/// Largest median relative difference of two responses that are said to agree.
const AGREE: f64 = 5e-2;
/// Number of frequencies at which two responses are compared.
const COMPARED: usize = 400;

/// Operations for the roots of a polynomial by the cube of its length, for the budget.
const ROOTS: u64 = 100;

/// Options of `tpm linearize`.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("banded").args(["against", "plot"]).multiple(true)))]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// Value of a coordinate or input at the point, such as th2=pi or F=m*g; what is not given is 0.
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    at: Vec<(String, String)>,
    #[command(flatten)]
    values: ValueArgs,
    /// Transfer functions of this coordinate only.
    #[arg(long, value_name = "NAME")]
    measured: Option<String>,
    /// Transfer functions from this input only.
    #[arg(long, value_name = "NAME")]
    input: Option<String>,
    /// Another transfer function to put beside that of --measured over --input: coefficients of numerator and
    /// denominator, highest power first, such as 2,1/1,3,2.
    #[arg(long, value_name = "B,../A,..", value_parser = coefficients, allow_hyphen_values = true)]
    against: Option<TransferFunction>,
    /// Draw a Bode plot of the transfer function, with that of --against, into this file, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Lowest frequency in Hz of comparison and plot; a tenth of the slowest pole's when not given.
    #[arg(long, value_name = "HZ", requires = "banded")]
    low: Option<f64>,
    /// Highest frequency in Hz of comparison and plot; ten times the fastest pole's when not given.
    #[arg(long, value_name = "HZ", requires = "banded")]
    high: Option<f64>,
    /// Print JSON (tpm.linearization/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

fn coefficients(text: &str) -> Result<TransferFunction, String> {
    let list = |part: &str| -> Result<Vec<f64>, String> {
        let mut list = Vec::new();
        for coefficient in part.split(',') {
            let value = coefficient.trim().parse::<f64>().map_err(|_| format!("`{coefficient}` is not a number"))?;
            list.push(value);
        }
        list.reverse();
        Ok(list)
    };
    let (numerator, denominator) =
        text.split_once('/').ok_or("write coefficients of numerator and denominator, such as 2,1/1,3,2")?;
    TransferFunction::new(&list(numerator)?, &list(denominator)?).map_err(|error| error.to_string())
}

/// The transfer function from one input to one coordinate.
struct Channel {
    coordinate: usize,
    input: usize,
    exact: SymbolicTransfer,
    numbers: Option<Numbers>,
}

/// A numeric transfer function with common factors removed.
struct Numbers {
    function: TransferFunction,
    poles: Vec<Complex>,
    zeros: Vec<Complex>,
    /// Roots at which a pole and a zero cancel exactly.
    cancelled: Vec<Complex>,
    /// Pairs of a pole and a zero that lie close to each other.
    close: Vec<(Complex, Complex)>,
}

type Complex = tpm_runtime::frequency::Complex;

/// The result of the command, as it is printed.
struct Linear {
    model: ExactModel,
    linear: Linearization,
    /// The operating point: every coordinate and input with its value.
    point: Vec<(String, ExprId)>,
    /// Names of the states: coordinates and their rates.
    state: Vec<String>,
    inputs: Vec<String>,
    /// Numeric A and B, and whether they are exact before they are rounded once.
    numbers: Option<(StateSpace<f64>, bool)>,
    poles: Vec<Complex>,
    channels: Vec<Channel>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(path) = &args.plot {
        picture::Picture::of(path)?;
    }
    let loaded = Loaded::from_file(&args.file)?;
    let found = Linear::new(args, loaded.model().clone())?;
    let comparison = args.against.as_ref().map(|beside| found.beside(args, beside)).transpose()?;
    if let Some(path) = &args.plot {
        picture::draw(path, &found.bode(args)?)?;
    }
    let text = if args.json {
        file::json(&found.json(comparison.as_ref()))?
    } else {
        format!("{}\n", found.text(comparison.as_ref()).trim_end())
    };
    file::emit(args.output.as_deref(), &text)
}

impl Linear {
    fn new(args: &Args, mut model: ExactModel) -> Result<Self, Failure> {
        let fault = |text: String| Failure::Input(format!("{}: {text}", args.file.display()));
        let coordinates: Vec<String> = model.coordinates.iter().map(|c| c.name.clone()).collect();
        let symbols: Vec<_> = model.inputs().collect();
        let inputs: Vec<String> = symbols.iter().map(|symbol| model.quantity(*symbol).name.to_string()).collect();
        let values = Values::load(&args.values, &model)?;
        let operating = operating_point(&args.at, &mut model, &coordinates, &inputs)?;
        let linear = linearize::linearize(&mut model, &operating).map_err(|error| fault(error.to_string()))?;
        tell_friction(&model, &linear);
        let zero = model.graph.integer(0);
        let of = |found: Option<ExprId>| found.unwrap_or(zero);
        let mut point = Vec::new();
        for (c, name) in (0u32..).zip(&coordinates) {
            let given = operating.coordinates.iter().find(|(other, _)| *other == Coordinate(c));
            point.push((name.clone(), of(given.map(|(_, value)| *value))));
        }
        for (symbol, name) in symbols.iter().zip(&inputs) {
            let given = operating.inputs.iter().find(|(other, _)| other == symbol);
            point.push((name.clone(), of(given.map(|(_, value)| *value))));
        }
        let outputs = chosen("--measured", args.measured.as_deref(), &coordinates)?;
        let drives = chosen("--input", args.input.as_deref(), &inputs)?;
        let state_space = state_space(&model, &linear, &values)?;
        let resolvent = state_space.as_ref().map(|(space, _)| space.resolvent());
        let mut transfers = transfer_functions(&mut model, &linear);
        let mut known = Roots::default();
        let mut channels = Vec::new();
        for &coordinate in &outputs {
            for &input in &drives {
                let exact = std::mem::replace(
                    &mut transfers[coordinate][input],
                    SymbolicTransfer { numerator: Vec::new(), denominator: Vec::new(), cancelled: 0 },
                );
                let numbers =
                    resolvent.as_ref().map(|own| in_numbers(own, coordinate, input, &mut known)).transpose()?;
                channels.push(Channel { coordinate, input, exact, numbers });
            }
        }
        let poles = match &resolvent {
            Some(resolvent) => {
                let all: Vec<f64> = resolvent.characteristic_polynomial().iter().map(rational::to_f64).collect();
                known.of(&all).map_err(|error| fault(error.to_string()))?
            }
            None => Vec::new(),
        };
        let rates = coordinates.iter().map(|name| format!("dot({name})"));
        let state = coordinates.iter().cloned().chain(rates).collect();
        let numbers = state_space.map(|(space, exact)| {
            let rounded = |matrix: &[Vec<Rational>]| -> Vec<Vec<f64>> {
                matrix.iter().map(|row| row.iter().map(rational::to_f64).collect()).collect()
            };
            (StateSpace { a: rounded(&space.a), b: rounded(&space.b) }, exact)
        });
        Ok(Linear { model, linear, point, state, inputs, numbers, poles, channels })
    }

    fn name(&self, channel: &Channel) -> String {
        format!("{} over {}", self.state[channel.coordinate], self.inputs[channel.input])
    }

    fn text(&self, comparison: Option<&Comparison>) -> String {
        let model = &self.model;
        let point: Vec<String> =
            self.point.iter().map(|(name, value)| format!("{name} = {}", model.display(*value))).collect();
        let mut text =
            format!("{} linearised at rest in {}; the equations hold there exactly\n", model.name, point.join(", "));
        let n = self.linear.mass.len();
        let _ = writeln!(
            text,
            "\nM ddot(q) + D dot(q) + K q = F u, q = ({}), u = ({}); entries that are not listed are 0\n",
            self.state[..n].join(", "),
            self.inputs.join(", ")
        );
        let mut table = TextTable::new(&[
            ("matrix", Align::Left),
            ("equation", Align::Left),
            ("column", Align::Left),
            ("entry", Align::Left),
        ]);
        let matrices = [
            ("M", &self.linear.mass, &self.state[..n]),
            ("D", &self.linear.damping, &self.state[..n]),
            ("K", &self.linear.stiffness, &self.state[..n]),
            ("F", &self.linear.input, &self.inputs[..]),
        ];
        for (name, matrix, columns) in matrices {
            for (row, equation) in matrix.iter().zip(&model.equations) {
                for (entry, column) in row.iter().zip(columns).filter(|(entry, _)| !self.is_zero(**entry)) {
                    table.row(&[name.to_owned(), equation.name.clone(), column.clone(), model.display(*entry)]);
                }
            }
        }
        text.push_str(&table.finish());
        let _ = writeln!(
            text,
            "\nd/dt of a rate is the sum of its entries times the states and inputs, over det M; all other entries of A and B\n\
             are 0, but d/dt of a coordinate is its rate\n\ndet M = {}\n",
            model.display(self.linear.determinant)
        );
        let mut table =
            TextTable::new(&[("d/dt", Align::Left), ("of", Align::Left), ("entry times det M", Align::Left)]);
        for (i, row) in self.rates().iter().enumerate() {
            let columns = self.state.iter().chain(&self.inputs);
            for (entry, column) in row.iter().zip(columns).filter(|(entry, _)| entry.as_str() != "0") {
                table.row(&[self.state[n + i].clone(), column.clone(), entry.clone()]);
            }
        }
        text.push_str(&table.finish());
        if let Some((space, exact)) = &self.numbers {
            let _ = writeln!(
                text,
                "\nin numbers{}, state ({})\n",
                if *exact {
                    ""
                } else {
                    " (an entry is not rational, so these are rounded before anything is cancelled)"
                },
                self.state.join(", ")
            );
            for (name, matrix) in [("A", &space.a), ("B", &space.b)] {
                text.push_str(&matrix_text(name, matrix));
            }
            let _ = writeln!(text, "poles [rad/s]: {}", roots_text(&self.poles));
        }
        for channel in &self.channels {
            let _ = write!(text, "\n{}\n", self.channel_text(channel));
        }
        if let Some(comparison) = comparison {
            let _ = write!(text, "\n{}", comparison.text());
        }
        text
    }

    fn is_zero(&self, entry: ExprId) -> bool {
        self.model.graph.as_number(entry).is_some_and(|value| *value == rational::integer(0))
    }

    /// Entries of A and B, times det M, in the rows of the rates.
    fn rates(&self) -> Vec<Vec<String>> {
        let n = self.linear.mass.len();
        let mut graph = self.model.graph.clone();
        let rows = self.linear.a[n..].iter().zip(&self.linear.b[n..]);
        rows.map(|(a, b)| {
            a.iter()
                .chain(b)
                .map(|&entry| {
                    let product = graph.mul(entry, self.linear.determinant);
                    let product = tpm_symbolic::expr::trigonometric::simplify(&mut graph, product);
                    graph.display(product, &self.model)
                })
                .collect()
        })
        .collect()
    }

    fn channel_text(&self, channel: &Channel) -> String {
        let name = self.name(channel);
        let exact = &channel.exact;
        if exact.numerator.is_empty() {
            return format!("{name}: 0, exactly; the input does not move this coordinate\n");
        }
        let mut text = format!("transfer function of {name}\n\n");
        let mut head = vec![("", Align::Left), ("power", Align::Left), ("exact coefficient", Align::Left)];
        if channel.numbers.is_some() {
            head.push(("over the highest below", Align::Right));
        }
        let mut table = TextTable::new(&head);
        let numbers = channel.numbers.as_ref();
        let reduced = numbers.map_or(0, |n| exact.denominator.len().saturating_sub(n.function.denominator().len()));
        for (part, coefficients, values) in [
            ("above", &exact.numerator, numbers.map(|n| n.function.numerator())),
            ("below", &exact.denominator, numbers.map(|n| n.function.denominator())),
        ] {
            for (power, coefficient) in coefficients.iter().enumerate().rev() {
                let mut row = vec![part.to_owned(), format!("s^{power}"), self.model.display(*coefficient)];
                // Where more than a power of s cancels numerically, the numeric coefficients do not correspond to the
                // symbolic ones.
                if let Some(value) = values.filter(|_| reduced == 0).and_then(|values| values.get(power)) {
                    row.push(number(*value));
                }
                table.row(&row);
            }
        }
        text.push_str(&table.finish());
        if exact.cancelled > 0 {
            let what = if exact.cancelled == 1 { "a factor s".to_owned() } else { format!("s^{}", exact.cancelled) };
            let _ = writeln!(
                text,
                "{what} above and below has cancelled: {} does not show {} at 0",
                self.state[channel.coordinate],
                if exact.cancelled == 1 { "a pole" } else { "poles" }
            );
        }
        let Some(numbers) = numbers else { return text };
        if reduced > 0 {
            let _ = writeln!(
                text,
                "in numbers, more cancels: ({}) / ({})",
                polynomial_text(numbers.function.numerator()),
                polynomial_text(numbers.function.denominator())
            );
        }
        let _ = writeln!(text, "poles [rad/s]: {}", roots_text(&numbers.poles));
        let _ = writeln!(text, "zeros [rad/s]: {}", roots_text(&numbers.zeros));
        if !numbers.cancelled.is_empty() {
            let _ = writeln!(text, "cancelled, exactly: {}", roots_text(&numbers.cancelled));
        }
        for (pole, zero) in &numbers.close {
            let _ = writeln!(text, "nearly cancel: pole {} and zero {}", root_text(*pole), root_text(*zero));
        }
        let _ = writeln!(text, "static gain: {}", gain_text(numbers.function.static_gain()));
        text
    }

    fn json(&self, comparison: Option<&Comparison>) -> Value {
        let model = &self.model;
        let matrix = |matrix: &[Vec<ExprId>]| -> Value {
            matrix.iter().map(|row| row.iter().map(|e| json!(model.display(*e))).collect::<Value>()).collect()
        };
        let list = |list: &[ExprId]| -> Value { list.iter().map(|e| json!(model.display(*e))).collect() };
        let channels: Vec<Value> = self
            .channels
            .iter()
            .map(|channel| {
                json!({
                    "output": self.state[channel.coordinate], "input": self.inputs[channel.input],
                    "exact": {
                        "numerator": list(&channel.exact.numerator), "denominator": list(&channel.exact.denominator),
                        "cancelled_powers_of_s": channel.exact.cancelled,
                    },
                    "numbers": channel.numbers.as_ref().map(|numbers| json!({
                        "numerator": numbers.function.numerator(), "denominator": numbers.function.denominator(),
                        "poles": roots_json(&numbers.poles), "zeros": roots_json(&numbers.zeros),
                        "cancelled": roots_json(&numbers.cancelled),
                        "nearly_cancelling": numbers.close.iter()
                            .map(|(pole, zero)| json!({"pole": root_json(pole), "zero": root_json(zero)}))
                            .collect::<Vec<_>>(),
                        "static_gain": finite(numbers.function.static_gain()),
                    })),
                })
            })
            .collect();
        let point: serde_json::Map<String, Value> =
            self.point.iter().map(|(name, value)| (name.clone(), json!(model.display(*value)))).collect();
        json!({
            "schema": "tpm.linearization/1", "model": model.name, "point": point,
            "state": self.state, "inputs": self.inputs,
            "equations": model.equations.iter().map(|equation| equation.name.clone()).collect::<Vec<_>>(),
            "mass": matrix(&self.linear.mass), "damping": matrix(&self.linear.damping),
            "stiffness": matrix(&self.linear.stiffness), "input": matrix(&self.linear.input),
            "determinant": model.display(self.linear.determinant),
            "a": matrix(&self.linear.a), "b": matrix(&self.linear.b),
            "numbers": self.numbers.as_ref().map(|(space, exact)| json!({
                "a": space.a, "b": space.b, "exact": exact, "poles": roots_json(&self.poles),
            })),
            "transfer_functions": channels,
            "beside": comparison.map(Comparison::json),
        })
    }

    /// The one transfer function that was chosen, in numbers; `flag` is what needs it.
    fn single(&self, flag: &str) -> Result<(&Channel, &Numbers), Failure> {
        let [channel] = self.channels.as_slice() else {
            return Err(Failure::Input(format!(
                "{flag} needs one transfer function, and there are {}; choose with --measured and --input",
                self.channels.len()
            )));
        };
        let numbers = channel.numbers.as_ref().ok_or_else(|| {
            Failure::Input(format!("{flag} needs the model in numbers; give --params FILE or --value NAME=VALUE"))
        })?;
        Ok((channel, numbers))
    }

    /// The Bode plot of the chosen transfer function, and of the one beside it.
    fn bode(&self, args: &Args) -> Result<Figure, Failure> {
        let (channel, numbers) = self.single("--plot")?;
        let own = &numbers.function;
        let both: Vec<&TransferFunction> = std::iter::once(own).chain(&args.against).collect();
        let (low, high) = band(args, &both)?;
        let unit = |unit: Option<&Unit>| unit.map_or_else(|| "1".to_owned(), ToString::to_string);
        let model = &self.model;
        let output = model.coordinates.get(channel.coordinate).and_then(|coordinate| coordinate.unit.as_ref());
        let input = model.inputs().nth(channel.input).and_then(|symbol| model.quantity(symbol).unit.as_ref());
        let unit = match (output, input) {
            (None, None) => String::new(),
            _ => match unit(input) {
                single if single.chars().all(char::is_alphanumeric) => format!("{}/{single}", unit(output)),
                product => format!("{}/({product})", unit(output)),
            },
        };
        let settings = BodeSettings { title: format!("{}: {}", model.name, self.name(channel)), unit, low, high };
        let responses: Vec<_> = both.iter().map(|function| |w: f64| function.response(w)).collect();
        let named: Vec<NamedModel<'_>> = ["model", "beside"]
            .into_iter()
            .zip(&responses)
            .map(|(name, response)| (name, response as &dyn Fn(f64) -> Complex))
            .collect();
        Ok(bode_of_models(&named, &settings))
    }

    fn beside(&self, args: &Args, other: &TransferFunction) -> Result<Comparison, Failure> {
        let (channel, numbers) = self.single("--against")?;
        let own = numbers.function.clone();
        let (low, high) = band(args, &[&own, other])?;
        Ok(Comparison::new(self.name(channel), own, other.clone(), low, high))
    }
}

/// The band of comparison and plot in Hz: what was given, or what is around all poles.
fn band(args: &Args, functions: &[&TransferFunction]) -> Result<(f64, f64), Failure> {
    let poles = functions.iter().flat_map(|function| function.poles());
    let sizes: Vec<f64> = poles.map(|pole| pole.norm() / TAU).filter(|size| *size > 0.0).collect();
    let low = args.low.or_else(|| Some(0.1 * sizes.iter().copied().reduce(f64::min)?));
    let high = args.high.or_else(|| Some(10.0 * sizes.iter().copied().reduce(f64::max)?));
    let (Some(low), Some(high)) = (low, high) else {
        return Err(Failure::Input("there is no pole to choose a band by; give --low and --high".to_owned()));
    };
    if !(low > 0.0 && low < high && high.is_finite()) {
        return Err(Failure::Input(format!("the band {low} to {high} Hz must rise from above 0")));
    }
    Ok((low, high))
}

/// The index of the name that was given, or all indices when none was given.
fn chosen(flag: &str, name: Option<&str>, known: &[String]) -> Result<Vec<usize>, Failure> {
    let Some(name) = name else { return Ok((0..known.len()).collect()) };
    match known.iter().position(|other| other == name) {
        Some(index) => Ok(vec![index]),
        None => Err(Failure::Input(format!("{flag} {name}: the model has no such name; it has {}", known.join(", ")))),
    }
}

/// Roots of polynomials in numbers. The channels of a model have most polynomials in common, and roots are what takes time.
#[derive(Default)]
struct Roots(HashMap<Vec<u64>, Vec<Complex>>);

impl Roots {
    /// The roots of the polynomial with these coefficients from s^0 upwards; none for zero.
    fn of(&mut self, polynomial: &[f64]) -> Result<Vec<Complex>, TransferError> {
        if polynomial.iter().all(|coefficient| *coefficient == 0.0) {
            return Ok(Vec::new());
        }
        let key: Vec<u64> = polynomial.iter().map(|coefficient| coefficient.to_bits()).collect();
        if let Some(known) = self.0.get(&key) {
            return Ok(known.clone());
        }
        // Roots are eigenvalues, found by some thirty steps of the squares of the degree.
        budget::charge(ROOTS.saturating_mul((polynomial.len() as u64).pow(3)));
        let found = TransferFunction::new(&[1.0], polynomial)?.poles();
        self.0.insert(key, found.clone());
        Ok(found)
    }
}

fn in_numbers(
    resolvent: &Resolvent<'_>,
    coordinate: usize,
    input: usize,
    known: &mut Roots,
) -> Result<Numbers, Failure> {
    let fault = |error: TransferError| Failure::Input(error.to_string());
    let states = resolvent.characteristic_polynomial().len() - 1;
    let output: Vec<Rational> = (0..states).map(|state| rational::integer(i64::from(state == coordinate))).collect();
    let exact = resolvent
        .transfer_function(&output, input)
        .expect("invariant: coordinate and input are those of the state space");
    let float = |polynomial: &[Rational]| -> Vec<f64> { polynomial.iter().map(rational::to_f64).collect() };
    let numerator = if exact.numerator.is_empty() { vec![0.0] } else { float(&exact.numerator) };
    let function = TransferFunction::new(&numerator, &float(&exact.denominator)).map_err(fault)?;
    let cancelled = known.of(&float(&exact.cancelled)).map_err(fault)?;
    let (poles, zeros) =
        (known.of(function.denominator()).map_err(fault)?, known.of(function.numerator()).map_err(fault)?);
    let mut close = Vec::new();
    for pole in &poles {
        let nearest = zeros.iter().min_by(|a, b| (*a - pole).norm().total_cmp(&(*b - pole).norm()));
        if let Some(zero) = nearest.filter(|zero| (*zero - pole).norm() <= CLOSE * pole.norm()) {
            close.push((*pole, *zero));
        }
    }
    Ok(Numbers { function, poles, zeros, cancelled, close })
}

/// Two transfer functions that are compared.
struct Comparison {
    name: String,
    own: TransferFunction,
    other: TransferFunction,
    low: f64,
    high: f64,
    median: f64,
    largest: f64,
}

impl Comparison {
    fn new(name: String, own: TransferFunction, other: TransferFunction, low: f64, high: f64) -> Self {
        let mut differences: Vec<f64> = (0..COMPARED)
            .map(|i| {
                let w = TAU * low * (high / low).powf(i as f64 / (COMPARED - 1) as f64);
                (other.response(w) / own.response(w) - 1.0).norm()
            })
            .collect();
        differences.sort_by(f64::total_cmp);
        let (median, largest) = (differences[COMPARED / 2], differences[COMPARED - 1]);
        Comparison { name, own, other, low, high, median, largest }
    }

    fn consistent(&self) -> bool {
        self.median <= AGREE
    }

    fn text(&self) -> String {
        let mut table =
            TextTable::new(&[(self.name.as_str(), Align::Left), ("model", Align::Left), ("beside", Align::Left)]);
        let mut row = |name: &str, of: &dyn Fn(&TransferFunction) -> String| {
            table.row(&[name.to_owned(), of(&self.own), of(&self.other)]);
        };
        row("order", &|f| format!("{}/{}", f.numerator().len() - 1, f.denominator().len() - 1));
        row("poles [rad/s]", &|f| roots_text(&f.poles()));
        row("zeros [rad/s]", &|f| roots_text(&f.zeros()));
        row("static gain", &|f| gain_text(f.static_gain()));
        format!(
            "{}the two are {}: from {} to {} Hz their responses differ by {} % of the model's (median), {} % at most\n",
            table.finish(),
            if self.consistent() { "consistent" } else { "not consistent" },
            number(self.low),
            number(self.high),
            number(100.0 * self.median),
            number(100.0 * self.largest)
        )
    }

    fn json(&self) -> Value {
        json!({
            "numerator": self.other.numerator(), "denominator": self.other.denominator(),
            "poles": roots_json(&self.other.poles()), "zeros": roots_json(&self.other.zeros()),
            "static_gain": finite(self.other.static_gain()), "low_hz": self.low, "high_hz": self.high,
            "median_difference": finite(self.median), "largest_difference": finite(self.largest),
            "consistent": self.consistent(),
        })
    }
}

fn gain_text(gain: f64) -> String {
    if gain.is_finite() { number(gain) } else { "infinite".to_owned() }
}

/// A number for JSON, which has no infinity: a value that is not finite becomes null.
fn finite(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { Value::Null }
}

fn root_json(root: &Complex) -> Value {
    json!({"re": root.re, "im": root.im})
}

fn roots_json(roots: &[Complex]) -> Vec<Value> {
    roots.iter().map(root_json).collect()
}

fn polynomial_text(coefficients: &[f64]) -> String {
    let terms: Vec<String> = coefficients
        .iter()
        .enumerate()
        .rev()
        .filter(|(_, c)| **c != 0.0)
        .map(|(power, c)| match power {
            0 => number(*c),
            1 => format!("{} s", number(*c)),
            _ => format!("{} s^{power}", number(*c)),
        })
        .collect();
    if terms.is_empty() { "0".to_owned() } else { terms.join(" + ") }
}

fn matrix_text(name: &str, matrix: &[Vec<f64>]) -> String {
    let columns = matrix.first().map_or(0, Vec::len);
    let mut table = TextTable::new(&vec![("", Align::Right); columns + 1]);
    for (i, row) in matrix.iter().enumerate() {
        let mut cells = vec![if i == 0 { format!("{name} =") } else { String::new() }];
        cells.extend(row.iter().map(|value| number(*value + 0.0)));
        table.row(&cells);
    }
    // The head is empty.
    let text = table.finish();
    let body = text.trim_start_matches('\n');
    format!("{body}\n")
}

#[cfg(test)]
mod tests {
    use super::coefficients;
    use crate::render::roots::roots_text;

    #[test]
    fn coefficients_stand_highest_first() {
        let function = coefficients("4,2/2,0,6").expect("valid");
        assert_eq!((function.numerator(), function.denominator()), (&[1.0, 2.0][..], &[3.0, 0.0, 1.0][..]));
        assert_eq!(roots_text(&function.poles()), "0+-1.73205j");
        assert!(coefficients("1").is_err() && coefficients("1/0").is_err() && coefficients("x/1").is_err());
    }
}
