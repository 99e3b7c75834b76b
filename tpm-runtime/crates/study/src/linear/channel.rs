//! The transfer function from one input to one coordinate, exactly and in numbers.

use crate::linear::words::{gain_text, root, root_text, roots, roots_text};
use serde::Serialize;
use std::collections::HashMap;
use std::fmt;
use tpm_frequency::{Complex, TransferError, TransferFunction};
use tpm_report::{Align, TextTable, number};
use tpm_symbolic::budget;
use tpm_symbolic::expr::graph::{ExprId, Symbol};
use tpm_symbolic::linear::linearize::Resolvent;
use tpm_symbolic::linear::transfer::SymbolicTransfer;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::unit::Unit;
use tpm_symbolic::number::rational::{self, Rational};

/// Largest distance of a pole from a zero, as a share of the pole's size, at which they are said nearly to cancel.
const NEARLY_CANCELLING: f64 = 1e-2;

/// Operations for the roots of a polynomial by the cube of its length, for the budget.
const ROOTS: u64 = 100;

/// The transfer function from one input to one coordinate.
#[derive(Debug, Serialize)]
pub(super) struct Channel {
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
pub(super) struct ChannelNumbers {
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
    pub(super) function: TransferFunction,
}

/// A pole and a zero that lie close to each other.
#[derive(Debug, Serialize)]
struct Close {
    #[serde(serialize_with = "root")]
    pole: Complex,
    #[serde(serialize_with = "root")]
    zero: Complex,
}

pub(super) fn rounded(exact: &[Rational]) -> Vec<f64> {
    exact.iter().map(rational::to_f64).collect()
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
pub(super) struct Roots(HashMap<Vec<u64>, Vec<Complex>>);

impl Roots {
    /// The roots of the polynomial with these coefficients from s^0 upwards; none for zero.
    pub(super) fn of(&mut self, polynomial: &[f64]) -> Result<Vec<Complex>, TransferError> {
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
    pub(super) fn new(
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

impl Channel {
    /// The transfer function from an input to the coordinate of an index.
    pub(super) fn new(
        model: &ExactModel,
        (output, input): (usize, Symbol),
        exact: &SymbolicTransfer,
        numbers: Option<ChannelNumbers>,
    ) -> Self {
        let (coordinate, quantity) = (&model.coordinates[output], model.quantity(input));
        Self {
            output: coordinate.name.clone(),
            input: quantity.name.to_string(),
            exact: ExactChannel::new(model, exact),
            numbers,
            unit: ratio_of_units(coordinate.unit.as_ref(), quantity.unit.as_ref()),
        }
    }

    pub(super) fn name(&self) -> String {
        format!("{} over {}", self.output, self.input)
    }

    /// Unit of the coordinate over that of the input; empty where neither has one.
    pub(super) fn unit(&self) -> &str {
        &self.unit
    }

    pub(super) fn numbers(&self) -> Option<&ChannelNumbers> {
        self.numbers.as_ref()
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
