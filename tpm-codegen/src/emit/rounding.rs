//! How far rounding can move the results of emitted functions, for stated ranges of what they read.
//!
//! Invariant: a bound is of |computed - exact|, where exact is the model's formula in real numbers for the numbers that the function is given.

mod interval;
pub mod ranges;
mod tape;

use num_traits::Zero;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use tpm_symbolic::expr::graph::{Function as Elementary, Symbol};
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::leaf::Leaf;

use super::c::Scalar;
use super::code::{Expression, Operator, Place, Statement};
use super::estimator::{EmitError, EstimatorSource, Identified};
use super::function::{self, Body, Function};
use super::name::Language;
use super::names::{Names, Style, derivative_name, derivative_text};
use super::number::Rounded;
use super::requested;
use interval::Interval;
use ranges::{RangeError, Ranges, plain};
use tape::{ATAN2_ULPS, Fault, Precision, Step, Tape, ulps};

/// The version of the JSON document.
const SCHEMA: &str = "tpm.bounds/1";

/// What names of files with bounds end with.
pub(crate) const EXTENSION: &str = ".bounds.json";

/// Most shares of a bound in the JSON document.
const MOST_SHARES: usize = 5;

/// Most steps of a function's bounds in all boxes that are tried.
const MOST_STEPS: usize = 200_000;

/// Least sum of logarithms by which a cut must make the bounds of a function smaller.
const LEAST_GAIN: f64 = 0.05;

/// Deepest nesting of an expression in a message.
const DEEPEST: usize = 4;

/// A result of a function, its range, the bound of its error and the largest shares in it.
struct Bounded {
    name: String,
    range: Interval,
    bound: f64,
    shares: Vec<Value>,
}

impl Bounded {
    /// The larger bound, and the range of both.
    fn with(self, other: Self) -> Self {
        let range = Interval::new(self.range.low.min(other.range.low), self.range.high.max(other.range.high));
        Self { range, ..if self.bound >= other.bound { self } else { other } }
    }
}

/// The bounds of a function's results, and into how many parts the ranges of what it reads were cut for them.
struct Cut {
    results: Vec<Bounded>,
    parts: BTreeMap<String, usize>,
}

/// A function with the names of its results where they are not the entries of a matrix, and how many results come before those.
struct Subject {
    name: &'static str,
    function: Function,
    results: Vec<String>,
    skipped: usize,
}

/// Names and ranges of what functions read.
struct Source<'a> {
    estimator: &'a EstimatorSource,
    names: Names<String>,
    ranges: &'a Ranges,
    values: Vec<Option<f64>>,
}

/// Adds the bounds of all functions of the dynamics to their documentation, in both precisions or in one; gives them as JSON.
pub(crate) fn add(
    estimator: &mut EstimatorSource,
    (ranges, identified): (&Ranges, Option<&Identified>),
    (language, scalars): (Language, &[Scalar]),
    command: &str,
) -> Result<String, EmitError> {
    let mut style = Style { language, type_name: &mut |name, _| name.to_owned(), reserved: &[] };
    let names = Names::new(&mut style, &estimator.model, &estimator.form, &estimator.plan);
    let settled = identified.map(|given| given.in_order(&estimator.model, &estimator.form)).transpose()?;
    let values = match settled {
        Some(settled) => settled.iter().map(|settled| Some(settled.value)).collect(),
        None => vec![None; estimator.form.columns.len()],
    };
    let source = Source { estimator, names, ranges, values };
    source.check_names()?;
    let mut told = BTreeMap::new();
    let (mut functions, mut read) = (Map::new(), BTreeMap::new());
    let mut bounded = 0;
    for subject in source.subjects() {
        let (mut text, mut results, mut parts, mut reason) = (String::new(), Map::new(), Map::new(), None);
        for &scalar in scalars {
            let precision = format!("{} precision", adjective(scalar));
            match source.bounds(&subject, scalar, &mut read) {
                Ok(Cut { results: list, parts: cut }) => {
                    if !cut.is_empty() {
                        parts.insert(adjective(scalar).to_owned(), json!(cut));
                    }
                    let bounds = list.iter().map(|own| format!("`{}` {}", own.name, rounded_up(own.bound)));
                    let bounds: Vec<String> = bounds.collect();
                    text.push_str(&format!("\n\nRounding in {precision}, at most: {}.", bounds.join(", ")));
                    for own in list {
                        let entry = results.entry(own.name).or_insert_with(|| json!({}));
                        entry[adjective(scalar)] = json!({
                            "bound": number(&rounded_up(own.bound)),
                            "range": [own.range.low, own.range.high],
                            "largest": own.shares,
                        });
                    }
                }
                Err(fault) => {
                    text.push_str(&format!("\n\nNo bound of rounding in {precision}: {fault}."));
                    reason = Some(fault);
                }
            }
        }
        told.insert(subject.name, text);
        bounded += usize::from(!results.is_empty());
        let mut entry = json!({ "parts": parts, "results": results });
        if let Some(reason) = reason {
            entry["refused"] = Value::from(reason);
        }
        functions.insert(subject.name.to_owned(), entry);
    }
    let mut precisions = Map::new();
    for &scalar in scalars {
        let Precision { unit, tiny, max } = precision(scalar);
        precisions.insert(adjective(scalar).to_owned(), json!({ "unit": unit, "tiny": tiny, "max": max }));
    }
    let ulp = |function: Elementary| (function.name().to_owned(), Value::from(ulps(function)));
    let mut assumed: Map<String, Value> = ELEMENTARY.into_iter().map(ulp).collect();
    assumed.insert("atan2".to_owned(), ATAN2_ULPS.into());
    let ranges: Map<String, Value> = read.iter().map(|(name, ends)| (name.clone(), json!(ends))).collect();
    let document = json!({
        "schema": SCHEMA,
        "model": estimator.model.name,
        "command": command,
        "rule": "sum over the steps of largest |derivative of the result by the step| times largest rounding of the step; every constant that is not a short binary fraction counts as rounded",
        "precisions": precisions,
        "assumed_ulps": assumed,
        "ranges": ranges,
        "functions": functions,
    });
    told.insert("", stated(&read));
    if bounded == 0 {
        return Err(RangeError::Nothing(refused(&document.to_string()).join("; ")).into());
    }
    estimator.rounding = told;
    Ok(serde_json::to_string_pretty(&document).expect("invariant: names and numbers are JSON") + "\n")
}

/// The functions of a document that have no bound, each with the reason.
pub(crate) fn refused(document: &str) -> Vec<String> {
    let document: Value = serde_json::from_str(document).unwrap_or_default();
    let functions = document["functions"].as_object().into_iter().flatten();
    let sentence = |(name, own): (&String, &Value)| {
        Some(format!("no bound of rounding for `{name}`: {}", own["refused"].as_str()?))
    };
    functions.filter_map(sentence).collect()
}

/// The functions whose errors are assumed.
const ELEMENTARY: [Elementary; 10] = [
    Elementary::Sin,
    Elementary::Cos,
    Elementary::Tan,
    Elementary::Asin,
    Elementary::Acos,
    Elementary::Atan,
    Elementary::Sqrt,
    Elementary::Tanh,
    Elementary::Exp,
    Elementary::Log,
];

/// The paragraph of the header.
fn stated(read: &BTreeMap<String, [f64; 2]>) -> String {
    let ranges: Vec<String> = read.iter().map(|(name, [low, high])| format!("`{name}` {low} to {high}")).collect();
    format!(
        "Beside the functions of the dynamics stands how far rounding moves their results at most from the model's formulas, for {}. Sines, cosines and \
         other functions of the C library are taken to be within 1 unit in the last place (`tan`, `tanh` and `atan2` 2, `sqrt` 0.5). \
         Functions that add up samples, loop or decide have no bound.",
        ranges.join(", ")
    )
}

impl Source<'_> {
    fn subjects(&self) -> Vec<Subject> {
        let (estimator, names) = (self.estimator, &self.names);
        let fields = |owner: &str, fields: &mut dyn Iterator<Item = &String>| -> Vec<String> {
            fields.map(|field| format!("{owner}.{field}")).collect()
        };
        let forces = || fields("forces", &mut names.rows.iter().map(|row| &row.field));
        let inputs = || fields("inputs", &mut names.inputs.iter().map(|(_, name)| name));
        let [independent, dependent] =
            function::feed_forward_parts(estimator).map_or([None, None], |parts| parts.map(Some));
        let accelerations = fields("accelerations", &mut names.coordinates.iter().map(|names| &names.field));
        let count = accelerations.len();
        let factored = estimator.parts.forward_dynamics.as_ref().is_some_and(|dynamics| dynamics.factored);
        let leading = requested::leading(estimator);
        let mut base: Vec<(usize, &String)> =
            leading.iter().zip(&names.columns).filter_map(|(place, name)| Some(((*place)?, name))).collect();
        base.sort_unstable();
        let lists = [
            ("lump", function::lump(estimator), fields("parameters", &mut names.columns.iter()), 0),
            (
                "unlump",
                function::unlump(estimator),
                fields("physical", &mut names.physical.iter().map(|(_, name)| name)),
                0,
            ),
            ("regressor", Some(function::regressor(estimator)), Vec::new(), 0),
            ("input_map", Some(function::input_map(estimator)), Vec::new(), 0),
            ("known", Some(function::known(estimator)), forces(), 0),
            ("inverse_dynamics", Some(function::inverse_dynamics(estimator)), forces(), 0),
            ("feed_forward", function::feed_forward(estimator), inputs(), 0),
            ("feed_forward_with_regressor", function::feed_forward_with_regressor(estimator), inputs(), 0),
            ("feed_forward_independent", independent, inputs(), 0),
            ("feed_forward_dependent", dependent, inputs(), 0),
            ("gravity", requested::gravity(estimator), forces(), 0),
            ("mass_matrix", requested::mass_matrix(estimator), Vec::new(), 0),
            // Behind the mass matrix, the right-hand side and the pivots stand the accelerations.
            (
                "forward_dynamics",
                requested::forward_dynamics(estimator).filter(|_| factored),
                accelerations,
                count * count + 2 * count,
            ),
            ("base_regressor", requested::base_regressor(estimator), Vec::new(), 0),
            ("base", requested::base(estimator), fields("base", &mut base.into_iter().map(|(_, name)| name)), 0),
        ];
        let some = |(name, function, results, skipped)| Some(Subject { name, function: function?, results, skipped });
        lists.into_iter().filter_map(some).collect()
    }

    /// The name of a leaf in the model language, and where emitted code reads it.
    fn spelled(&self, leaf: Leaf) -> (String, String) {
        let model = &self.estimator.model;
        match leaf {
            Leaf::Motion(coordinate, order) => {
                let name = &model.coordinates[coordinate.0 as usize].name;
                let own = self.names.coordinates.iter().find(|names| names.coordinate == coordinate);
                let field = own.map_or(name.as_str(), |names| names.field.as_str());
                (derivative_text(name, order), format!("motion.{field}.{}", derivative_name(order)))
            }
            Leaf::Column(column) => {
                let name = self.estimator.form.columns[column].name.to_string();
                (name, format!("parameters.{}", self.names.columns[column]))
            }
            Leaf::Symbol(symbol) => {
                let named = |list: &[(Symbol, String)]| {
                    list.iter().find(|(own, _)| *own == symbol).map(|(_, field)| field.clone())
                };
                let lists = [
                    ("constants", &self.names.constants),
                    ("inputs", &self.names.inputs),
                    ("physical", &self.names.physical),
                ];
                let found = lists.into_iter().find_map(|(owner, list)| Some(format!("{owner}.{}", named(list)?)));
                let name = model.quantity(symbol).name.to_string();
                (name.clone(), found.unwrap_or(name))
            }
            other => (format!("{other:?}"), format!("{other:?}")),
        }
    }

    /// What has a range: motions, parameters, inputs and constants.
    fn leaves(&self) -> Vec<Leaf> {
        let evaluation = &self.estimator.plan.evaluation;
        let motions = evaluation.coordinates.iter();
        let motions = motions.flat_map(|&(coordinate, order)| (0..=order).map(move |n| Leaf::Motion(coordinate, n)));
        let columns = (0..self.estimator.form.columns.len()).map(Leaf::Column);
        let lists = [&self.names.constants, &self.names.inputs, &self.names.physical];
        let symbols = lists.into_iter().flatten().map(|(symbol, _)| Leaf::Symbol(*symbol));
        motions.chain(columns).chain(symbols).collect()
    }

    /// The name that gives the range of every coordinate.
    fn every(&self, leaf: Leaf) -> Option<String> {
        match leaf {
            Leaf::Motion(_, order) => Some(derivative_text("*", order)),
            _ => None,
        }
    }

    fn check_names(&self) -> Result<(), RangeError> {
        let leaves = self.leaves();
        let mut known: Vec<String> = leaves.iter().map(|&leaf| self.spelled(leaf).0).collect();
        let every: Vec<String> = leaves.iter().filter_map(|&leaf| self.every(leaf)).collect();
        let fits = |name: &String| known.iter().chain(&every).any(|own| plain(own) == *name);
        let Some(name) = self.ranges.names().find(|name| !fits(name)) else { return Ok(()) };
        let name = name.clone();
        known.dedup();
        Err(RangeError::Unknown { name, known: known.join(", ") })
    }

    fn range(&self, leaf: Leaf, scalar: Scalar) -> Result<[f64; 2], String> {
        let (name, _) = self.spelled(leaf);
        let of = |name: &str| self.ranges.of(name);
        let stated = of(&name).or_else(|| of(&self.every(leaf)?));
        let value = match leaf {
            Leaf::Motion(..) => None,
            _ => self
                .estimator
                .form
                .columns
                .iter()
                .position(|column| *column.name == name)
                .and_then(|at| self.values[at]),
        };
        match (stated, value) {
            (Some(ends), _) => Ok(ends),
            (None, Some(value)) => {
                let given = round(value, scalar);
                Ok([given.min(value), given.max(value)])
            }
            (None, None) => Err(format!("`{name}` has no range; state one")),
        }
    }

    /// The bounds of a function's results, over boxes into which the ranges are cut as long as that makes them smaller and [`MOST_STEPS`] are
    /// not exceeded. The ranges of what the function reads are added to `read`.
    fn bounds(&self, subject: &Subject, scalar: Scalar, read: &mut BTreeMap<String, [f64; 2]>) -> Result<Cut, String> {
        let mut whole = Vec::new();
        let (mut best, steps) = self.evaluated(subject, scalar, &mut whole)?;
        let ranges: Vec<[f64; 2]> =
            whole.iter().map(|&(leaf, _)| self.range(leaf, scalar)).collect::<Result<_, String>>()?;
        read.extend(whole.iter().zip(&ranges).map(|(&(leaf, _), ends)| (self.spelled(leaf).1, *ends)));
        let (mut parts, mut taken) = (vec![1_usize; whole.len()], 0);
        let wide: Vec<usize> = (0..whole.len()).filter(|&place| ranges[place][0] < ranges[place][1]).collect();
        loop {
            let mut found: Option<(f64, Vec<Bounded>, Vec<usize>)> = None;
            taken += 3 * wide.len() * steps * parts.iter().product::<usize>();
            for &place in wide.iter().filter(|_| taken <= MOST_STEPS) {
                // Thirds, since halves of a range about zero are as wide as the whole to functions that are even or odd.
                let mut finer = parts.clone();
                finer[place] *= 3;
                let mut merged: Option<Vec<Bounded>> = None;
                for number in 0..finer.iter().product() {
                    let mut rest = number;
                    let cut = whole.iter().zip(&ranges).zip(&finer).map(|((&(leaf, _), &[low, high]), &parts)| {
                        let (own, edge) =
                            (rest % parts, |place: usize| low + (high - low) * (place as f64 / parts as f64));
                        rest /= parts;
                        (leaf, Interval::new(edge(own), if own + 1 == parts { high } else { edge(own + 1) }))
                    });
                    let (more, _) = self.evaluated(subject, scalar, &mut cut.collect())?;
                    merged = Some(match merged {
                        None => more,
                        Some(merged) => merged.into_iter().zip(more).map(|(a, b)| a.with(b)).collect(),
                    });
                }
                let gain = |of: &[Bounded]| -> f64 {
                    of.iter()
                        .zip(&best)
                        .filter(|(own, _)| own.bound > 0.0)
                        .map(|(own, best)| (best.bound / own.bound).ln())
                        .sum()
                };
                if let Some(merged) =
                    merged.filter(|merged| gain(merged) > found.as_ref().map_or(LEAST_GAIN, |(gain, ..)| *gain))
                {
                    found = Some((gain(&merged), merged, finer));
                }
            }
            let Some((_, merged, finer)) = found else { break };
            (best, parts) = (merged, finer);
        }
        let parts = whole.iter().zip(parts).filter(|(_, parts)| *parts > 1);
        Ok(Cut { results: best, parts: parts.map(|(&(leaf, _), parts)| (self.spelled(leaf).1, parts)).collect() })
    }

    /// The bounds of a function's results in a box, and the number of steps that they take; what the function reads beyond the box has its
    /// whole range, and is added to the box.
    fn evaluated(
        &self,
        subject: &Subject,
        scalar: Scalar,
        cut: &mut Vec<(Leaf, Interval)>,
    ) -> Result<(Vec<Bounded>, usize), String> {
        let Subject { function: Function { body, .. }, results, skipped, .. } = subject;
        let tape = Tape::new(precision(scalar));
        let mut tracing = Tracing { source: self, scalar, tape, leaves: cut, named: BTreeMap::new() };
        let mut found: Vec<(String, usize)> = Vec::new();
        let (statements, values): (&[Statement], &[Expression]) = match body {
            Body::Values(statements, values) => (statements, values),
            Body::Stores(statements) => (statements, &[]),
            Body::Table(_) => return Err("it loops over a table".to_owned()),
        };
        for statement in statements {
            match statement {
                Statement::Comment(_) => {}
                Statement::Let(name, value) => {
                    let step = tracing.step(value)?;
                    tracing.named.insert(*name, step);
                }
                Statement::Store(place, value) => {
                    let name = match *place {
                        Place::Value(index) => results[index].clone(),
                        Place::Entry(row, column) => format!("matrix[{row}][{column}]"),
                    };
                    found.push((name, tracing.step(value)?));
                }
            }
        }
        for (name, value) in results.iter().zip(values.iter().skip(*skipped)) {
            found.push((name.clone(), tracing.step(value)?));
        }
        let mut bounded = Vec::with_capacity(found.len());
        for (name, step) in found {
            let outcome = tracing.tape.bound(step);
            let (bound, shares) = outcome.map_err(|fault| tracing.explained(fault))?;
            let shares = shares.into_iter().take(MOST_SHARES).map(|share| {
                json!({ "step": tracing.text(share.step, 0), "rounding": share.rounding, "slope": share.slope })
            });
            bounded.push(Bounded { name, range: tracing.tape.values[step], bound, shares: shares.collect() });
        }
        Ok((bounded, tracing.tape.steps.len()))
    }
}

/// A function on its way to a tape.
struct Tracing<'a> {
    source: &'a Source<'a>,
    scalar: Scalar,
    tape: Tape,
    leaves: &'a mut Vec<(Leaf, Interval)>,
    /// The steps of named intermediate results.
    named: BTreeMap<usize, usize>,
}

impl Tracing<'_> {
    fn step(&mut self, expression: &Expression) -> Result<usize, String> {
        let step = match expression {
            Expression::Number(value) => {
                let rounded = Rounded::new(value);
                let value_here = match self.scalar {
                    Scalar::Double => rounded.double,
                    Scalar::Float => f64::from(rounded.single),
                };
                let exact = is_short(value_here) && rational::from_f64(value_here).as_ref() == Some(value);
                Step::Number(value_here.to_bits(), !exact)
            }
            Expression::Pi => Step::Number(round(std::f64::consts::PI, self.scalar).to_bits(), true),
            Expression::Leaf(leaf) => {
                let place = self.leaves.iter().position(|(own, _)| own == leaf).unwrap_or(self.leaves.len());
                if place == self.leaves.len() {
                    let [low, high] = self.source.range(*leaf, self.scalar)?;
                    self.leaves.push((*leaf, Interval::new(low, high)));
                }
                return Ok(self.tape.leaf(place, self.leaves[place].1));
            }
            Expression::Temporary(name) => return Ok(self.named[name]),
            Expression::Binary(operator, a, b) => {
                let (a, b) = (self.step(a)?, self.step(b)?);
                match operator {
                    Operator::Add => Step::Add(a, b),
                    Operator::Sub => Step::Sub(a, b),
                    Operator::Mul => Step::Mul(a, b),
                    Operator::Div => Step::Div(a, b),
                }
            }
            Expression::Negated(a) => Step::Neg(self.step(a)?),
            Expression::Call(function, a) => Step::Call(*function, self.step(a)?),
            Expression::Atan2(y, x) => Step::Atan2(self.step(y)?, self.step(x)?),
        };
        self.tape.push(step).map_err(|fault| self.explained(fault))
    }

    fn explained(&self, fault: Fault) -> String {
        let (Fault::Divisor(step) | Fault::Undefined(step) | Fault::TooLarge(step)) = fault;
        let Interval { low, high } = self.tape.values[step];
        let what = format!("`{}` ranges from {low:.3e} to {high:.3e}", self.text(step, 0));
        match fault {
            Fault::Divisor(_) => {
                format!("the divisor {what}, which holds zero; narrow the ranges of what stands in it")
            }
            Fault::Undefined(_) => {
                format!("{what}, where the function of it is not defined; narrow the ranges of what stands in it")
            }
            Fault::TooLarge(_) => format!("{what}, beyond the largest number; narrow the ranges of what stands in it"),
        }
    }

    /// A step in the model language, cut where it nests deeply.
    fn text(&self, step: usize, depth: usize) -> String {
        let of = |step: usize| self.text(step, depth + 1);
        match self.tape.steps[step] {
            Step::Number(bits, _) => f64::from_bits(bits).to_string(),
            Step::Leaf(leaf) => self.source.spelled(self.leaves[leaf].0).0,
            _ if depth == DEEPEST => "...".to_owned(),
            Step::Add(a, b) => format!("({} + {})", of(a), of(b)),
            Step::Sub(a, b) => format!("({} - {})", of(a), of(b)),
            Step::Mul(a, b) => format!("{}*{}", of(a), of(b)),
            Step::Div(a, b) => format!("{}/{}", of(a), of(b)),
            Step::Neg(a) => format!("-{}", of(a)),
            Step::Call(function, a) => format!("{}({})", function.name(), of(a)),
            Step::Atan2(y, x) => format!("atan2({}, {})", of(y), of(x)),
        }
    }
}

/// Whether a number is a fraction over 1024 of few digits, which is taken to be meant as it is written.
fn is_short(value: f64) -> bool {
    (value * 1024.0).fract().is_zero() && value.abs() < 1_048_576.0
}

/// A number in a precision.
fn round(value: f64, scalar: Scalar) -> f64 {
    // The cast rounds to nearest.
    #[allow(clippy::cast_possible_truncation)]
    match scalar {
        Scalar::Double => value,
        Scalar::Float => f64::from(value as f32),
    }
}

fn precision(scalar: Scalar) -> Precision {
    match scalar {
        Scalar::Double => Precision { unit: f64::EPSILON / 2.0, tiny: f64::from_bits(1), max: f64::MAX },
        Scalar::Float => Precision {
            unit: f64::from(f32::EPSILON) / 2.0,
            tiny: f64::from(f32::from_bits(1)) / 2.0,
            max: f64::from(f32::MAX),
        },
    }
}

fn adjective(scalar: Scalar) -> &'static str {
    match scalar {
        Scalar::Double => "double",
        Scalar::Float => "single",
    }
}

/// A number that is not smaller, of three digits.
fn rounded_up(value: f64) -> String {
    // A checker that adds up in another order derives the same but for the last digits of doubles, which numbers below the normal ones lack.
    let value = if value > 0.0 { value * (1.0 + 1e-9) + f64::MIN_POSITIVE } else { value };
    let text = format!("{value:.2e}");
    let (digits, exponent) = text.split_once('e').expect("invariant: an exponent is written");
    if number(&text) >= value {
        return text;
    }
    let digits = number(digits) + 0.01;
    format!("{digits:.2}e{exponent}")
}

fn number(text: &str) -> f64 {
    text.parse().expect("invariant: a formatted number is one")
}

#[cfg(test)]
mod tests {
    use super::rounded_up;

    #[test]
    fn bounds_are_rounded_up() {
        for value in [0.0, 1.0, 1.23e-16, 9.999e-15, 9.99999e3, 5e-324] {
            let text = rounded_up(value);
            let up: f64 = text.parse().expect("a number");
            assert!(up >= value && up <= value * 1.011 + 1e-307, "{value:e} {text}");
        }
    }
}
