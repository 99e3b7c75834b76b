//! Documentation texts of emitted code.

use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::expr::graph::{Coordinate, Symbol};
use tpm_symbolic::mechanics::model::{CoordinateInfo, Presliding};
use tpm_symbolic::mechanics::unit::Unit;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::operation::OperationCounts;
use tpm_symbolic::plan::pattern::PatternPlan;
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::regressor::form::canonical;

use super::estimator::{EstimatorSource, gaps};
use super::names::{derivative_text, harmonic_function};
use super::table::left_out;

/// Maximal width of a line of an equation, in characters; a longer line is broken.
const WIDTH: usize = 100;

/// Markdown in lines of at most `width` characters. Prose is wrapped; fenced text, lists and tables keep their lines.
pub(super) fn filled(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    let (mut fenced, mut open) = (false, false);
    for line in text.trim_end().lines() {
        let fence = line.starts_with("```");
        fenced ^= fence;
        if fence || fenced || line.is_empty() || ["|", "#", "- "].iter().any(|mark| line.starts_with(mark)) {
            lines.push(line.to_owned());
            open = false;
            continue;
        }
        // A name or a command in backticks is not broken.
        let mut quoted = false;
        let words = line.split_inclusive(|c: char| {
            quoted ^= c == '`';
            c == ' ' && !quoted
        });
        for word in words.map(str::trim_end) {
            match lines.last_mut() {
                Some(last) if open && last.chars().count() + 1 + word.chars().count() <= width => {
                    last.push(' ');
                    last.push_str(word);
                }
                _ => lines.push(word.to_owned()),
            }
            open = true;
        }
    }
    lines
}

/// `2 additions, 5 multiplications`.
fn counts(counts: OperationCounts) -> String {
    let parts = [
        (counts.additions, "addition"),
        (counts.multiplications, "multiplication"),
        (counts.divisions, "division"),
        (counts.functions, "function call"),
    ];
    let parts: Vec<String> = parts
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, name)| format!("{count} {name}{}", if count == 1 { "" } else { "s" }))
        .collect();
    parts.join(", ")
}

/// The paragraph `Operations: ...`.
pub(super) fn operations(plan: &Plan) -> String {
    match plan.counts() {
        none if none == OperationCounts::default() => "\n\nNo operations.".to_owned(),
        some => format!("\n\nOperations: {}.", counts(some)),
    }
}

/// The paragraph `Operations: ...` of a function, and the bounds of its rounding where there are any.
pub(super) fn told(estimator: &EstimatorSource, function: &str, plan: &Plan) -> String {
    operations(plan) + estimator.rounding.get(function).map_or("", String::as_str)
}

/// The suffix ` in kg`; empty for a quantity without a unit.
pub(super) fn in_unit(unit: Option<&Unit>) -> String {
    match unit {
        Some(unit) if *unit != Unit::one() => format!(" in `{unit}`"),
        _ => String::new(),
    }
}

/// The unit of a time derivative.
fn rate(unit: Option<&Unit>, order: u32) -> Option<Unit> {
    let per_second = Unit::named("s").pow(-i32::try_from(order).ok()?);
    unit.map(|unit| unit.mul(&per_second))
}

/// The entry of the regressor in a row and column, or the known terms.
pub(super) fn entry(estimator: &EstimatorSource, row: usize, column: Option<usize>) -> &str {
    estimator.formulas.entry(row, column)
}

/// The factor of an input in a row.
pub(super) fn input_factor(estimator: &EstimatorSource, row: usize, input: usize) -> &str {
    estimator.formulas.input_factor(row, input)
}

/// The equations, one after the other, as the model language writes them, over the parameters that are estimated.
pub(super) fn equations(estimator: &EstimatorSource) -> String {
    let mut text = String::new();
    for (r, row) in estimator.form.rows.iter().enumerate() {
        let mut parts: Vec<String> = Vec::new();
        for (c, column) in estimator.form.columns.iter().enumerate() {
            if !row.terms.iter().any(|term| term.column == Some(c)) {
                continue;
            }
            parts.push(match entry(estimator, r, Some(c)) {
                "1" => column.name.to_string(),
                "-1" => format!("-{}", column.name),
                sum if sum.contains(" + ") || sum.contains(" - ") => format!("{}*({sum})", column.name),
                factor => match factor.strip_prefix('-') {
                    Some(positive) => format!("-{}*{positive}", column.name),
                    None => format!("{}*{factor}", column.name),
                },
            });
        }
        if row.terms.iter().any(|term| term.column.is_none()) {
            parts.push(entry(estimator, r, None).to_owned());
        }
        let inputs = row.inputs.iter().map(|(symbol, _)| {
            let name = &estimator.model.quantity(*symbol).name;
            if is_solved(estimator, *symbol) {
                return format!("f({name})");
            }
            let input = estimator.plan.evaluation.inputs.iter().position(|input| input == symbol);
            match input_factor(estimator, r, input.expect("invariant: the plans know every input")) {
                "1" => name.to_string(),
                "-1" => format!("-{name}"),
                factor => format!("({factor})*{name}"),
            }
        });
        let right: Vec<String> = inputs.collect();
        parts.push(format!("= {}", if right.is_empty() { "0".to_owned() } else { right.join(" + ") }));
        let mut width = 0;
        for (i, part) in parts.iter().enumerate() {
            let joined = match part.strip_prefix('-') {
                _ if i == 0 || part.starts_with('=') => part.clone(),
                Some(positive) => format!("- {positive}"),
                None => format!("+ {part}"),
            };
            if i > 0 && width + joined.len() > WIDTH {
                text.push_str("\n    ");
                width = 4;
            } else if i > 0 {
                text.push(' ');
            }
            width += joined.len() + 1;
            text.push_str(&joined);
        }
        text.push('\n');
    }
    text
}

/// The pattern's motions, one line per coordinate that has one.
pub(super) fn motions(estimator: &EstimatorSource, index: usize) -> String {
    let mut text = String::new();
    let Some(pattern) = estimator.model.patterns.get(index) else { return text };
    let w = &estimator.model.quantity(pattern.frequency).name;
    for (coordinate, motion) in estimator.model.coordinates.iter().zip(&pattern.motions) {
        let Some(motion) = motion else { continue };
        let mut sum = String::new();
        for (monomial, fourier) in motion.terms() {
            let mut factors: Vec<String> = Vec::new();
            for (&symbol, exponent) in monomial.factors() {
                let name = &estimator.model.quantity(symbol).name;
                factors.push(if exponent == 1 { name.to_string() } else { format!("{name}^{exponent}") });
            }
            let series = fourier.terms().fold(String::new(), |mut series, (harmonic, function, coefficient)| {
                let base = match harmonic {
                    0 => String::new(),
                    1 => format!("{}({w}*t)", harmonic_function(function)),
                    _ => format!("{}({harmonic}*{w}*t)", harmonic_function(function)),
                };
                push_term(&mut series, coefficient, &base);
                series
            });
            let plain = fourier.highest_harmonic() == 0 && series == "1";
            if !plain {
                factors.push(if fourier.terms().count() > 1 && !factors.is_empty() {
                    format!("({series})")
                } else {
                    series
                });
            }
            if !sum.is_empty() {
                sum.push_str(" + ");
            }
            sum.push_str(&factors.join("*"));
        }
        let sum = if sum.is_empty() { "0" } else { &sum };
        text.push_str(&format!("{} = {sum}\n", coordinate.name));
    }
    text
}

fn push_term(text: &mut String, coefficient: &tpm_symbolic::number::rational::Rational, base: &str) {
    use num_traits::{One, Signed};
    let magnitude = tpm_symbolic::number::rational::abs(coefficient);
    text.push_str(match (text.is_empty(), coefficient.is_negative()) {
        (true, true) => "-",
        (true, false) => "",
        (false, true) => " - ",
        (false, false) => " + ",
    });
    let number = tpm_symbolic::number::rational::display(&magnitude);
    match (base, magnitude.is_one()) {
        ("", _) => text.push_str(&number),
        (_, true) => text.push_str(base),
        (_, false) => {
            text.push_str(&number);
            text.push('*');
            text.push_str(base);
        }
    }
}

/// The differences between the estimator matrix of a pattern and the exact equations.
fn approximations(estimator: &EstimatorSource, pattern: &PatternPlan) -> Vec<String> {
    let Ok(plan) = &pattern.table else { return Vec::new() };
    let replaced =
        estimator.replaced.iter().map(|replaced| format!("{replaced} in the estimator matrix, and only there"));
    let left_out = plan.table.tails.iter().map(|tail| left_out(&plan.table, tail));
    replaced.chain(left_out).map(|sentence| format!("{sentence}.")).collect()
}

/// The description of a parameter.
pub(super) fn column(estimator: &EstimatorSource, index: usize) -> String {
    let column = &estimator.form.columns[index];
    let definition = match column.parameter {
        Some(_) => String::new(),
        None => format!(" = `{}`", canonical(&estimator.model, &column.definition)),
    };
    format!("`{}`{definition}{}.", column.name, in_unit(column.unit.as_ref()))
}

/// The description of a symbol of the model.
pub(super) fn quantity(estimator: &EstimatorSource, symbol: Symbol) -> String {
    let quantity = estimator.model.quantity(symbol);
    format!("`{}`{}.", quantity.name, in_unit(quantity.unit.as_ref()))
}

/// The description of an amplitude, or of the frequency, of a pattern.
pub(super) fn pattern_symbol(estimator: &EstimatorSource, pattern: &PatternPlan, symbol: Symbol) -> String {
    let what = if symbol == pattern.frequency { "Fundamental angular frequency" } else { "Amplitude" };
    format!("{what} {}", quantity(estimator, symbol))
}

/// What the type of a coordinate at one instant is.
pub(super) fn coordinate(estimator: &EstimatorSource, info: &CoordinateInfo) -> String {
    let Some(Presliding { of, travel }) = &info.presliding else {
        return format!("The coordinate `{}` and its time derivatives at one instant.", info.name);
    };
    let of = &estimator.model.coordinates[of.0 as usize].name;
    let travel = rational::to_f64(travel);
    format!(
        "How far the friction of `{of}` has built up since it reversed, from -1 to 1: zero at first; with every step of `{of}` it goes on by \
         D = s - (s - D)*exp(-|step|/{travel}), s the sign of the step. What a sensor reads as noise while the machine rests is no step."
    )
}

/// The description of a derivative of a coordinate.
pub(super) fn derivative(estimator: &EstimatorSource, coordinate: Coordinate, order: u32) -> String {
    let info = &estimator.model.coordinates[coordinate.0 as usize];
    let unit = rate(info.unit.as_ref(), order);
    format!("`{}`{}.", derivative_text(&info.name, order), in_unit(unit.as_ref()))
}

/// The description of the number of an equation.
pub(super) fn equation(estimator: &EstimatorSource, row: usize) -> String {
    format!("Equation `{}`{}.", estimator.form.rows[row].name, in_unit(row_unit(estimator, row)))
}

/// The description of a harmonic.
pub(super) fn harmonic(harmonic: usize, function: Trig) -> String {
    match harmonic {
        0 => "Mean.".to_owned(),
        1 => format!("Factor of {}(w t).", harmonic_function(function)),
        _ => format!("Factor of {}({harmonic} w t).", harmonic_function(function)),
    }
}

/// The unit of an equation whose right-hand side is one input.
pub(super) fn row_unit(estimator: &EstimatorSource, row: usize) -> Option<&Unit> {
    match estimator.form.rows[row].inputs.as_slice() {
        [(symbol, factor)] if factor.as_constant().is_some() && !is_solved(estimator, *symbol) => {
            estimator.model.quantity(*symbol).unit.as_ref()
        }
        _ => None,
    }
}

/// Whether an input stands in a function that the feed-forward inverts.
fn is_solved(estimator: &EstimatorSource, input: Symbol) -> bool {
    estimator.plan.solved.iter().any(|own| own.input == input)
}

/// The parts left out for a pattern, and the differences between its matrix and the exact equations.
pub(super) fn remarks(estimator: &EstimatorSource, pattern: &PatternPlan) -> Vec<String> {
    gaps(pattern).into_iter().chain(approximations(estimator, pattern)).collect()
}

/// A number that changes with the model: 64 bits of FNV-1a over its equations, quantities and patterns. Logs and
/// results that contain it can be assigned to this code.
pub(super) fn fingerprint(estimator: &EstimatorSource) -> u64 {
    let model = &estimator.model;
    let mut text = format!("{}\n{}", model.name, equations(estimator));
    if !estimator.form.is_expanded(&model.graph) {
        // Formulas omit long entries, so the plans are hashed as well.
        let plans = [&estimator.plan.evaluation.regressor, &estimator.plan.evaluation.known];
        text.push_str(&format!("{:?}\n", plans.map(|plan| (&plan.inputs, &plan.ops, &plan.outputs))));
    }
    for coordinate in &model.coordinates {
        text.push_str(&format!("{} {:?}\n", coordinate.name, coordinate.unit.as_ref().map(ToString::to_string)));
    }
    for quantity in &model.symbols {
        let unit = quantity.unit.as_ref().map(ToString::to_string);
        text.push_str(&format!("{} {unit:?} {:?}\n", quantity.name, quantity.kind));
    }
    for index in 0..estimator.form.columns.len() {
        text.push_str(&column(estimator, index));
    }
    for (index, pattern) in estimator.plan.patterns.iter().enumerate() {
        text.push_str(&motions(estimator, index));
        if let Ok(table) = &pattern.table {
            text.push_str(&format!("{:?}\n", table.rows));
        }
    }
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
