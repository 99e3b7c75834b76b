//! A model linearised at rest, `M ddot(q) + D dot(q) + K q = F u`: its matrices, state space, transfer functions, poles and zeros.
//!
//! Invariant: transfer functions, poles and zeros are exact up to their one rounding, but for the roots of polynomials.

use crate::by_name::by_name;
use crate::linear::channel::{Channel, ChannelNumbers, Roots, rounded};
use crate::linear::comparison::{Band, Comparison, LinearisedError};
use crate::linear::words::{roots, roots_text, table_of};
use serde::Serialize;
use std::fmt;
use tpm_frequency::{BodeSettings, Complex, NamedModel, TransferError, TransferFunction, bode_of_models};
use tpm_plot::Figure;
use tpm_report::{Align, TextTable, number};
use tpm_symbolic::expr::graph::{Coordinate, ExprId};
use tpm_symbolic::expr::trigonometric::simplify;
use tpm_symbolic::linear::linearize::{Linearization, OperatingPoint, StateSpace};
use tpm_symbolic::linear::transfer::transfer_functions;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational::Rational;

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
                let exact = &transfers[output][input];
                channels.push(Channel::new(model, (output, symbols[input]), exact, numbers.transpose()?));
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
        let settings = BodeSettings { title, unit: channel.unit().to_owned(), low, high };
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
        Ok((channel, channel.numbers().ok_or(LinearisedError::NoNumbers)?))
    }
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
