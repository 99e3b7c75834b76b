//! A model linearised at rest, `M ddot(q) + D dot(q) + K q = F u`: its matrices, state space, transfer functions, poles and zeros.
//!
//! Invariant: transfer functions, poles and zeros are exact up to their one rounding, but for the roots of polynomials.

use crate::linear::roots::{root, root_text, roots, roots_text};
use serde::{Serialize, Serializer};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::fmt;
use thiserror::Error;
use tpm_frequency::{BodeSettings, Complex, NamedModel, TransferError, TransferFunction, bode_of_models};
use tpm_plot::Figure;
use tpm_report::{Align, TextTable, number};
use tpm_symbolic::budget;
use tpm_symbolic::expr::graph::{Coordinate, ExprId};
use tpm_symbolic::expr::trigonometric::simplify;
use tpm_symbolic::linear::linearize::{Linearization, OperatingPoint, Resolvent, StateSpace};
use tpm_symbolic::linear::transfer::{SymbolicTransfer, transfer_functions};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::unit::Unit;
use tpm_symbolic::number::rational::{self, Rational};

/// Largest distance of a pole from a zero, as a share of the pole's size, at which they are said nearly to cancel.
const NEARLY_CANCELLING: f64 = 1e-2;

/// Largest median relative difference of two responses that are called consistent: what a fit of a few per cent leaves.
const CONSISTENT: f64 = 5e-2;

/// Number of frequencies at which two responses are compared.
const COMPARED: usize = 400;

/// Operations for the roots of a polynomial by the cube of its length, for the budget.
const ROOTS: u64 = 100;

/// A model linearised at rest. It is displayed as a text, and serialised as `tpm.linearization/1`.
#[derive(Debug, Serialize)]
pub struct Linearised {
    schema: &'static str,
    model: String,
    /// Every coordinate and input with its value at the point.
    #[serde(serialize_with = "by_name")]
    point: Vec<(String, String)>,
    /// Names of the states: coordinates and their rates.
    state: Vec<String>,
    inputs: Vec<String>,
    equations: Vec<String>,
    mass: Vec<Vec<String>>,
    damping: Vec<Vec<String>>,
    stiffness: Vec<Vec<String>>,
    input: Vec<Vec<String>>,
    determinant: String,
    a: Vec<Vec<String>>,
    b: Vec<Vec<String>>,
    /// Entries of A and B, times the determinant of the mass matrix, in the rows of the rates.
    #[serde(skip)]
    rates: Vec<Vec<String>>,
    numbers: Option<StateNumbers>,
    transfer_functions: Vec<Channel>,
    beside: Option<Comparison>,
}

fn by_name<S: Serializer>(pairs: &[(String, String)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().map(|(name, value)| (name, value)))
}

/// A and B in numbers.
#[derive(Debug, Serialize)]
struct StateNumbers {
    a: Vec<Vec<f64>>,
    b: Vec<Vec<f64>>,
    /// Whether the entries are exact before they are rounded once.
    exact: bool,
    #[serde(serialize_with = "roots")]
    poles: Vec<Complex>,
}

/// The transfer function from one input to one coordinate.
#[derive(Debug, Serialize)]
struct Channel {
    output: String,
    input: String,
    exact: ExactChannel,
    numbers: Option<ChannelNumbers>,
    /// Unit of the coordinate over that of the input, for a figure; empty where neither has one.
    #[serde(skip)]
    unit: String,
}

#[derive(Debug, Serialize)]
struct ExactChannel {
    /// Coefficients from s^0 upwards; none for a coordinate that the input does not move.
    numerator: Vec<String>,
    denominator: Vec<String>,
    cancelled_powers_of_s: usize,
}

/// A numeric transfer function with common factors removed.
#[derive(Debug, Serialize)]
struct ChannelNumbers {
    numerator: Vec<f64>,
    denominator: Vec<f64>,
    #[serde(serialize_with = "roots")]
    poles: Vec<Complex>,
    #[serde(serialize_with = "roots")]
    zeros: Vec<Complex>,
    /// Roots at which a pole and a zero cancel exactly.
    #[serde(serialize_with = "roots")]
    cancelled: Vec<Complex>,
    nearly_cancelling: Vec<Close>,
    /// Null in JSON where it is infinite.
    static_gain: f64,
    #[serde(skip)]
    function: TransferFunction,
}

/// A pole and a zero that lie close to each other.
#[derive(Debug, Serialize)]
struct Close {
    #[serde(serialize_with = "root")]
    pole: Complex,
    #[serde(serialize_with = "root")]
    zero: Complex,
}

/// A transfer function beside that of the model.
#[derive(Debug, Serialize)]
struct Comparison {
    #[serde(skip)]
    name: String,
    #[serde(skip)]
    own: TransferFunction,
    #[serde(skip)]
    other: TransferFunction,
    numerator: Vec<f64>,
    denominator: Vec<f64>,
    #[serde(serialize_with = "roots")]
    poles: Vec<Complex>,
    #[serde(serialize_with = "roots")]
    zeros: Vec<Complex>,
    static_gain: f64,
    low_hz: f64,
    high_hz: f64,
    /// Median over the band of |other/own - 1|.
    median_difference: f64,
    largest_difference: f64,
    consistent: bool,
}

/// A band of frequencies in Hz; an end that is not given lies a factor of ten outside of all poles.
#[derive(Clone, Copy, Debug, Default)]
pub struct Band {
    /// The lowest frequency, Hz.
    pub low: Option<f64>,
    /// The highest frequency, Hz.
    pub high: Option<f64>,
}

/// Why a transfer function cannot be compared or drawn.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum LinearisedError {
    /// There is more than one transfer function, or none.
    #[error("one transfer function is needed, and there are {0}")]
    NotOne(usize),
    /// The model has no values.
    #[error("the model in numbers is needed")]
    NoNumbers,
    /// No pole is there to choose a band by.
    #[error("there is no pole to choose a band by")]
    NoPole,
    /// The band does not rise from above zero.
    #[error("the band {low} to {high} Hz must rise from above 0")]
    Band {
        /// The lowest frequency, Hz.
        low: f64,
        /// The highest frequency, Hz.
        high: f64,
    },
}

impl Band {
    /// Both ends for these functions.
    fn around(self, functions: &[&TransferFunction]) -> Result<(f64, f64), LinearisedError> {
        let poles = functions.iter().flat_map(|function| function.poles());
        let sizes: Vec<f64> = poles.map(|pole| pole.norm() / TAU).filter(|size| *size > 0.0).collect();
        let low = self.low.or_else(|| Some(0.1 * sizes.iter().copied().reduce(f64::min)?));
        let high = self.high.or_else(|| Some(10.0 * sizes.iter().copied().reduce(f64::max)?));
        let (Some(low), Some(high)) = (low, high) else { return Err(LinearisedError::NoPole) };
        if low > 0.0 && low < high && high.is_finite() {
            Ok((low, high))
        } else {
            Err(LinearisedError::Band { low, high })
        }
    }
}

impl Linearised {
    /// The answer for a linearisation of `model` at `point`, with the transfer functions of the coordinates `outputs` over the inputs
    /// `drives`, by index; in numbers too where A and B are given, with whether they are exact.
    ///
    /// # Errors
    /// [`TransferError`] when a coefficient is beyond the largest float.
    ///
    /// # Panics
    /// When an index is none of the model.
    pub fn new(
        model: &mut ExactModel,
        point: &OperatingPoint,
        linear: &Linearization,
        space: Option<(StateSpace<Rational>, bool)>,
        outputs: &[usize],
        drives: &[usize],
    ) -> Result<Self, TransferError> {
        let coordinates: Vec<String> = model.coordinates.iter().map(|c| c.name.clone()).collect();
        let symbols: Vec<_> = model.inputs().collect();
        let inputs: Vec<String> = symbols.iter().map(|symbol| model.quantity(*symbol).name.to_string()).collect();
        let zero = model.graph.integer(0);
        let transfers = transfer_functions(model, linear);
        let values = (0u32..).zip(&coordinates).map(|(c, name)| {
            let given = point.coordinates.iter().find(|(other, _)| *other == Coordinate(c));
            (name, given.map(|(_, value)| *value))
        });
        let values = values.chain(symbols.iter().zip(&inputs).map(|(symbol, name)| {
            let given = point.inputs.iter().find(|(other, _)| other == symbol);
            (name, given.map(|(_, value)| *value))
        }));
        let values = values.map(|(name, value)| (name.clone(), model.display(value.unwrap_or(zero)))).collect();
        let resolvent = space.as_ref().map(|(space, _)| space.resolvent());
        let mut known = Roots::default();
        let mut channels = Vec::new();
        for &output in outputs {
            for &input in drives {
                let numbers = resolvent.as_ref().map(|own| ChannelNumbers::new(own, output, input, &mut known));
                channels.push(Channel {
                    output: coordinates[output].clone(),
                    input: inputs[input].clone(),
                    exact: ExactChannel::new(model, &transfers[output][input]),
                    numbers: numbers.transpose()?,
                    unit: ratio_of_units(
                        model.coordinates[output].unit.as_ref(),
                        model.quantity(symbols[input]).unit.as_ref(),
                    ),
                });
            }
        }
        let numbers = match (&space, &resolvent) {
            (Some((space, exact)), Some(resolvent)) => {
                let poles = known.of(&rounded(resolvent.characteristic_polynomial()))?;
                let rows = |matrix: &[Vec<Rational>]| matrix.iter().map(|row| rounded(row)).collect();
                Some(StateNumbers { a: rows(&space.a), b: rows(&space.b), exact: *exact, poles })
            }
            _ => None,
        };
        let matrix = |matrix: &[Vec<ExprId>]| -> Vec<Vec<String>> {
            matrix.iter().map(|row| row.iter().map(|entry| model.display(*entry)).collect()).collect()
        };
        let rates = coordinates.iter().map(|name| format!("dot({name})"));
        Ok(Self {
            schema: "tpm.linearization/1",
            model: model.name.to_string(),
            point: values,
            state: coordinates.iter().cloned().chain(rates).collect(),
            inputs,
            equations: model.equations.iter().map(|equation| equation.name.clone()).collect(),
            mass: matrix(&linear.mass),
            damping: matrix(&linear.damping),
            stiffness: matrix(&linear.stiffness),
            input: matrix(&linear.input),
            determinant: model.display(linear.determinant),
            a: matrix(&linear.a),
            b: matrix(&linear.b),
            rates: entries_of_rates(model, linear),
            numbers,
            transfer_functions: channels,
            beside: None,
        })
    }

    /// Puts another transfer function beside the only one of the answer.
    ///
    /// # Errors
    /// [`LinearisedError`] when there is not one transfer function in numbers, or no band.
    pub fn put_beside(&mut self, other: TransferFunction, band: Band) -> Result<(), LinearisedError> {
        let (channel, numbers) = self.single()?;
        let (low, high) = band.around(&[&numbers.function, &other])?;
        self.beside = Some(Comparison::new(channel.name(), numbers.function.clone(), other, low, high));
        Ok(())
    }

    /// The Bode plot of the only transfer function, and of the one that was put beside it.
    ///
    /// # Errors
    /// [`LinearisedError`] when there is not one transfer function in numbers, or no band.
    pub fn bode(&self, band: Band) -> Result<Figure, LinearisedError> {
        let (channel, numbers) = self.single()?;
        let other = self.beside.as_ref().map(|beside| &beside.other);
        let both: Vec<&TransferFunction> = std::iter::once(&numbers.function).chain(other).collect();
        let (low, high) = band.around(&both)?;
        let title = format!("{}: {}", self.model, channel.name());
        let settings = BodeSettings { title, unit: channel.unit.clone(), low, high };
        let responses: Vec<_> = both.iter().map(|function| |w: f64| function.response(w)).collect();
        let named: Vec<NamedModel<'_>> = ["model", "beside"]
            .into_iter()
            .zip(&responses)
            .map(|(name, response)| (name, response as &dyn Fn(f64) -> Complex))
            .collect();
        Ok(bode_of_models(&named, &settings))
    }

    fn single(&self) -> Result<(&Channel, &ChannelNumbers), LinearisedError> {
        let [channel] = self.transfer_functions.as_slice() else {
            return Err(LinearisedError::NotOne(self.transfer_functions.len()));
        };
        Ok((channel, channel.numbers.as_ref().ok_or(LinearisedError::NoNumbers)?))
    }
}

fn rounded(exact: &[Rational]) -> Vec<f64> {
    exact.iter().map(rational::to_f64).collect()
}

/// Entries of A and B, times the determinant of the mass matrix, in the rows of the rates.
fn entries_of_rates(model: &ExactModel, linear: &Linearization) -> Vec<Vec<String>> {
    let n = linear.mass.len();
    let mut graph = model.graph.clone();
    let mut entry = |entry: &ExprId| {
        let product = graph.mul(*entry, linear.determinant);
        let product = simplify(&mut graph, product);
        graph.display(product, model)
    };
    let rows = linear.a[n..].iter().zip(&linear.b[n..]);
    rows.map(|(a, b)| a.iter().chain(b).map(&mut entry).collect()).collect()
}

fn ratio_of_units(output: Option<&Unit>, input: Option<&Unit>) -> String {
    let unit = |unit: Option<&Unit>| unit.map_or_else(|| "1".to_owned(), ToString::to_string);
    match (output, input) {
        (None, None) => String::new(),
        _ => match unit(input) {
            single if single.chars().all(char::is_alphanumeric) => format!("{}/{single}", unit(output)),
            product => format!("{}/({product})", unit(output)),
        },
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

impl ExactChannel {
    fn new(model: &ExactModel, exact: &SymbolicTransfer) -> Self {
        let list = |list: &[ExprId]| list.iter().map(|coefficient| model.display(*coefficient)).collect();
        Self {
            numerator: list(&exact.numerator),
            denominator: list(&exact.denominator),
            cancelled_powers_of_s: exact.cancelled,
        }
    }
}

impl ChannelNumbers {
    fn new(
        resolvent: &Resolvent<'_>,
        coordinate: usize,
        input: usize,
        known: &mut Roots,
    ) -> Result<Self, TransferError> {
        let states = resolvent.characteristic_polynomial().len() - 1;
        let output: Vec<Rational> =
            (0..states).map(|state| rational::integer(i64::from(state == coordinate))).collect();
        let exact = resolvent
            .transfer_function(&output, input)
            .expect("invariant: coordinate and input are those of the state space");
        let numerator = if exact.numerator.is_empty() { vec![0.0] } else { rounded(&exact.numerator) };
        let function = TransferFunction::new(&numerator, &rounded(&exact.denominator))?;
        let cancelled = known.of(&rounded(&exact.cancelled))?;
        let (poles, zeros) = (known.of(function.denominator())?, known.of(function.numerator())?);
        let mut close = Vec::new();
        for pole in &poles {
            let nearest = zeros.iter().min_by(|a, b| (*a - pole).norm().total_cmp(&(*b - pole).norm()));
            if let Some(zero) = nearest.filter(|zero| (*zero - pole).norm() <= NEARLY_CANCELLING * pole.norm()) {
                close.push(Close { pole: *pole, zero: *zero });
            }
        }
        Ok(Self {
            numerator: function.numerator().to_vec(),
            denominator: function.denominator().to_vec(),
            poles,
            zeros,
            cancelled,
            nearly_cancelling: close,
            static_gain: function.static_gain(),
            function,
        })
    }
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
        Comparison {
            name,
            own,
            numerator: other.numerator().to_vec(),
            denominator: other.denominator().to_vec(),
            poles: other.poles(),
            zeros: other.zeros(),
            static_gain: other.static_gain(),
            other,
            low_hz: low,
            high_hz: high,
            median_difference: median,
            largest_difference: largest,
            consistent: median <= CONSISTENT,
        }
    }
}

impl fmt::Display for Linearised {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let point: Vec<String> = self.point.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let n = self.mass.len();
        writeln!(f, "{} linearised at rest in {}; the equations hold there exactly", self.model, point.join(", "))?;
        writeln!(
            f,
            "\nM ddot(q) + D dot(q) + K q = F u, q = ({}), u = ({}); entries that are not listed are 0\n",
            self.state[..n].join(", "),
            self.inputs.join(", ")
        )?;
        let mut table = table_of(&["matrix", "equation", "column", "entry"]);
        for (name, matrix, columns) in [
            ("M", &self.mass, &self.state[..n]),
            ("D", &self.damping, &self.state[..n]),
            ("K", &self.stiffness, &self.state[..n]),
            ("F", &self.input, &self.inputs[..]),
        ] {
            for (row, equation) in matrix.iter().zip(&self.equations) {
                for (entry, column) in row.iter().zip(columns).filter(|(entry, _)| *entry != "0") {
                    table.row(&[name.to_owned(), equation.clone(), column.clone(), entry.clone()]);
                }
            }
        }
        f.write_str(&table.finish())?;
        writeln!(
            f,
            "\nd/dt of a rate is the sum of its entries times the states and inputs, over det M; all other entries of A and B\n\
             are 0, but d/dt of a coordinate is its rate\n\ndet M = {}\n",
            self.determinant
        )?;
        let mut table = table_of(&["d/dt", "of", "entry times det M"]);
        for (row, rate) in self.rates.iter().zip(&self.state[n..]) {
            let columns = self.state.iter().chain(&self.inputs);
            for (entry, column) in row.iter().zip(columns).filter(|(entry, _)| *entry != "0") {
                table.row(&[rate.clone(), column.clone(), entry.clone()]);
            }
        }
        f.write_str(&table.finish())?;
        if let Some(numbers) = &self.numbers {
            let rounding = " (an entry is not rational, so these are rounded before anything is cancelled)";
            let rounding = if numbers.exact { "" } else { rounding };
            writeln!(f, "\nin numbers{rounding}, state ({})\n", self.state.join(", "))?;
            write!(f, "{}{}", matrix_text("A", &numbers.a), matrix_text("B", &numbers.b))?;
            writeln!(f, "poles [rad/s]: {}", roots_text(&numbers.poles))?;
        }
        let channels = self.transfer_functions.iter().map(ToString::to_string);
        let comparison = self.beside.iter().map(ToString::to_string);
        for (n, part) in channels.chain(comparison).enumerate() {
            write!(f, "{}{part}", if n == 0 { "\n" } else { "\n\n" })?;
        }
        Ok(())
    }
}

impl Channel {
    fn name(&self) -> String {
        format!("{} over {}", self.output, self.input)
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, exact) = (self.name(), &self.exact);
        if exact.numerator.is_empty() {
            return writeln!(f, "{name}: 0, exactly; the input does not move this coordinate");
        }
        writeln!(f, "transfer function of {name}\n")?;
        let mut head = vec![("", Align::Left), ("power", Align::Left), ("exact coefficient", Align::Left)];
        if self.numbers.is_some() {
            head.push(("over the highest below", Align::Right));
        }
        let mut table = TextTable::new(&head);
        let numbers = self.numbers.as_ref();
        let reduced = numbers.map_or(0, |n| exact.denominator.len().saturating_sub(n.denominator.len()));
        for (part, coefficients, values) in [
            ("above", &exact.numerator, numbers.map(|n| &n.numerator)),
            ("below", &exact.denominator, numbers.map(|n| &n.denominator)),
        ] {
            for (power, coefficient) in coefficients.iter().enumerate().rev() {
                let mut row = vec![part.to_owned(), format!("s^{power}"), coefficient.clone()];
                if let Some(value) = values.filter(|_| reduced == 0).and_then(|values| values.get(power)) {
                    row.push(number(*value));
                }
                table.row(&row);
            }
        }
        f.write_str(&table.finish())?;
        if exact.cancelled_powers_of_s > 0 {
            let (what, poles) = match exact.cancelled_powers_of_s {
                1 => ("a factor s".to_owned(), "a pole"),
                power => (format!("s^{power}"), "poles"),
            };
            writeln!(f, "{what} above and below has cancelled: {} does not show {poles} at 0", self.output)?;
        }
        let Some(numbers) = numbers else { return Ok(()) };
        if reduced > 0 {
            let (above, below) = (polynomial_text(&numbers.numerator), polynomial_text(&numbers.denominator));
            writeln!(f, "in numbers, more cancels: ({above}) / ({below})")?;
        }
        writeln!(f, "poles [rad/s]: {}\nzeros [rad/s]: {}", roots_text(&numbers.poles), roots_text(&numbers.zeros))?;
        if !numbers.cancelled.is_empty() {
            writeln!(f, "cancelled, exactly: {}", roots_text(&numbers.cancelled))?;
        }
        for close in &numbers.nearly_cancelling {
            writeln!(f, "nearly cancel: pole {} and zero {}", root_text(close.pole), root_text(close.zero))?;
        }
        writeln!(f, "static gain: {}", gain_text(numbers.static_gain))
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = table_of(&[&self.name, "model", "beside"]);
        let mut row = |name: &str, of: &dyn Fn(&TransferFunction) -> String| {
            table.row(&[name.to_owned(), of(&self.own), of(&self.other)]);
        };
        row("order", &|f| format!("{}/{}", f.numerator().len() - 1, f.denominator().len() - 1));
        row("poles [rad/s]", &|f| roots_text(&f.poles()));
        row("zeros [rad/s]", &|f| roots_text(&f.zeros()));
        row("static gain", &|f| gain_text(f.static_gain()));
        writeln!(
            f,
            "{}the two are {}: from {} to {} Hz their responses differ by {} % of the model's (median), {} % at most",
            table.finish(),
            if self.consistent { "consistent" } else { "not consistent" },
            number(self.low_hz),
            number(self.high_hz),
            number(100.0 * self.median_difference),
            number(100.0 * self.largest_difference)
        )
    }
}

/// A table of texts.
fn table_of(head: &[&str]) -> TextTable {
    TextTable::new(&head.iter().map(|name| (*name, Align::Left)).collect::<Vec<_>>())
}

fn gain_text(gain: f64) -> String {
    if gain.is_finite() { number(gain) } else { "infinite".to_owned() }
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
