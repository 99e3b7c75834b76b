//! Structured text (IEC 61131-3) of the dynamics: function blocks for the feed-forward and for the friction in it.
//!
//! Invariants: the steps of every block are those of the code in Rust and C; identifiers differ in more than their case, which the language
//! does not tell apart, and are no words of it.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use num_traits::One;
use tpm_symbolic::expr::graph::Function as Called;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::{Merger, Plan};

use super::code::{Reader, Statement};
use super::estimator::EstimatorSource;
use super::infix::{Given, Words, expression};
use super::name::camel;
use super::names::derivative_name;
use super::number::digits;
use super::text::{self, filled};
use crate::identified::evaluated;

/// Width of a line of a comment, in characters.
const WIDTH: usize = 110;

/// Number of motions at which a force is tested for its sign under reversed velocities.
const MOTIONS: usize = 16;

/// Words of the language, and names of its types, functions and blocks, that no identifier may have, in capitals.
const RESERVED: &str = "ABS ABSTRACT ACOS ACTION ADD ADR AND ANY ARRAY ASIN AT ATAN ATAN2 BOOL BY BYTE CAL CASE CLASS CONCAT CONFIGURATION CONSTANT \
    CONTINUE COS CTD CTU CTUD DATE DELETE DINT DIV DO DT DWORD ELSE ELSIF END EN ENO EQ EXIT EXP EXPT EXTENDS FALSE FIND FOR FROM \
    FUNCTION F_EDGE F_TRIG GE GET GLOBAL GT IF IMPLEMENTS IN INPUT INSERT INT INTERFACE INTERNAL JMP LD LDN LDT LE LEFT LEN LIMIT \
    LINT LN LOG LREAL LT LTIME LTOD LWORD MAX METHOD MID MIN MOD MOVE MUL MUX NE NEG NON_RETAIN NOT NULL OF ON OR OUTPUT OVERLAP \
    OVERRIDE PERSISTENT POINTER PRIVATE PROGRAM PROPERTY PROTECTED PUBLIC R R1 READ_ONLY READ_WRITE REAL REF REFERENCE REPEAT \
    REPLACE RESOURCE RET RETAIN RETURN RIGHT ROL ROR RS R_EDGE R_TRIG S S1 SEL SHL SHR SIN SINT SIZEOF SQRT SR ST STEP STN STRING \
    STRUCT SUB SUPER T TAN TASK TEMP THEN THIS TIME TO TOD TOF TON TP TRANSITION TRUE TRUNC TYPE UDINT UINT ULINT UNION UNTIL \
    USING USINT VAR WHILE WITH WORD WSTRING XOR";

/// The text of the file.
pub(crate) fn file(estimator: &EstimatorSource, given: &Given<'_>) -> String {
    let model = camel(&ascii(&estimator.model.name));
    let row = |r: usize| (estimator.form.rows[r].name.to_string(), text::equation(estimator, r));
    let (name, about, plan, results) = match &estimator.plan.feed_forward {
        Some(plan) => {
            let inputs =
                estimator.plan.evaluation.inputs.iter().map(|input| {
                    (estimator.model.quantity(*input).name.to_string(), text::quantity(estimator, *input))
                });
            ("FeedForward", "The inputs that the motion needs.", plan, inputs.collect())
        }
        None => {
            let rows = (0..estimator.form.rows.len()).map(row);
            let about =
                "The generalised force of every equation that the motion needs; no input follows from one equation.";
            ("InverseDynamics", about, &estimator.plan.inverse_dynamics, rows.collect())
        }
    };
    let mut blocks = block(estimator, given, &model, &format!("{model}_{name}"), about, plan, results);
    let (plan, results) = friction(estimator);
    if !results.is_empty() {
        let about = "The part of it that depends on velocities alone and changes its sign with them: friction. For velocities of the \
                     reference; the noise of measured ones makes dry friction jump about standstill.";
        blocks += &block(estimator, given, &model, &format!("{model}_Friction"), about, &plan, results);
    }
    format!("{}{}{blocks}", comment(given.about), helpers(&model, &blocks))
}

/// A text that neither begins nor ends a comment.
fn harmless(text: &str) -> String {
    text.replace("(*", "( *").replace("*)", "* )")
}

/// A comment of several lines.
fn comment(text: &str) -> String {
    let lines = filled(&harmless(text), WIDTH);
    format!("(* {} *)\n", lines.join("\n   ").replace("\n   \n", "\n\n"))
}

/// Letters, digits and single underscores.
fn ascii(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for letter in name.chars() {
        match letter {
            '_' if text.ends_with('_') => {}
            letter if letter.is_ascii_alphanumeric() || letter == '_' => text.push(letter),
            letter => text.push_str(&format!("u{:04x}", u32::from(letter))),
        }
    }
    text.trim_end_matches('_').to_owned()
}

/// An identifier that is not taken, whatever the case of its letters.
fn identifier(name: &str, taken: &mut BTreeSet<String>) -> String {
    let plain = ascii(name);
    let plain = if plain.starts_with(|first: char| first.is_ascii_alphabetic()) { plain } else { format!("x{plain}") };
    let free = |name: &String| {
        let capitals = name.to_uppercase();
        !RESERVED.split(' ').any(|word| word == capitals) && !taken.contains(&capitals)
    };
    let mut tries = std::iter::once(plain.clone()).chain((1..).map(|number| format!("{plain}_{number}")));
    let name = tries.find(free).expect("invariant: numbers do not end");
    taken.insert(name.to_uppercase());
    name
}

/// A number as the language writes it: with a point, and a capital before the exponent.
fn number(value: f64) -> String {
    match digits(value).split_once('e') {
        Some((mantissa, exponent)) if mantissa.contains('.') => format!("{mantissa}E{exponent}"),
        Some((mantissa, exponent)) => format!("{mantissa}.0E{exponent}"),
        None => digits(value),
    }
}

/// One function block.
fn block(
    estimator: &EstimatorSource,
    given: &Given<'_>,
    model: &str,
    name: &str,
    about: &str,
    plan: &Plan,
    results: Vec<(String, String)>,
) -> String {
    let evaluation = &estimator.plan.evaluation;
    let (statements, values) = Reader::new(plan).outputs();
    // Names of intermediate results come first, so that none of the model's takes one.
    let lets = statements.iter().filter_map(|statement| match statement {
        Statement::Let(index, value) => Some((index, value)),
        _ => None,
    });
    let mut taken: BTreeSet<String> = lets.clone().map(|(index, _)| format!("T{index}")).collect();
    // Everything that is read, in the order of the model: motion, constants, parameters.
    let motion = evaluation
        .coordinates
        .iter()
        .flat_map(|&(coordinate, order)| (0..=order).map(move |order| (Leaf::Motion(coordinate, order), None)));
    let constants = evaluation.constants.iter().zip(given.constants).map(|(own, value)| (Leaf::Symbol(*own), *value));
    let columns = given.values.iter().enumerate().map(|(column, value)| (Leaf::Column(column), Some(*value)));
    let mut read = Vec::new();
    for (leaf, value) in motion.chain(constants).chain(columns).filter(|(leaf, _)| plan.inputs.contains(leaf)) {
        let (wanted, told) = match leaf {
            Leaf::Motion(coordinate, order) => {
                let own = &estimator.model.coordinates[coordinate.0 as usize].name;
                let wanted = if order == 0 { own.clone() } else { format!("{own}_{}", derivative_name(order)) };
                (wanted, text::derivative(estimator, coordinate, order))
            }
            Leaf::Column(column) => (estimator.form.columns[column].name.to_string(), text::column(estimator, column)),
            Leaf::Symbol(symbol) => {
                (estimator.model.quantity(symbol).name.to_string(), text::quantity(estimator, symbol))
            }
            _ => unreachable!("invariant: the dynamics read no phase and no harmonics"),
        };
        read.push((leaf, identifier(&wanted, &mut taken), value, told));
    }
    let results: Vec<(String, String)> =
        results.into_iter().map(|(wanted, told)| (identifier(&wanted, &mut taken), told)).collect();
    let leaf = |leaf: &Leaf| {
        let found = read.iter().find(|(own, ..)| own == leaf);
        found.expect("invariant: everything that is read is declared").1.clone()
    };
    let named = |function: Option<Called>| match function {
        None => format!("{model}_atan2"),
        Some(own @ (Called::Sign | Called::Tanh)) => format!("{model}_{}", own.name()),
        Some(Called::Log) => "LN".to_owned(),
        Some(own) => own.name().to_uppercase(),
    };
    let words = Words { leaf: &leaf, digits: number, name: &named };
    let mut out = format!("\n{}FUNCTION_BLOCK {name}\nVAR_INPUT\n", comment(about));
    let told = |text: &str| format!("(* {} *)", harmless(text));
    for (_, name, value, about) in &read {
        let value = value.map_or_else(String::new, |value| format!(" := {}", number(value)));
        let _ = writeln!(out, "    {name} : LREAL{value}; {}", told(about));
    }
    out.push_str("END_VAR\nVAR_OUTPUT\n");
    for (name, about) in &results {
        let _ = writeln!(out, "    {name} : LREAL; {}", told(about));
    }
    out.push_str("END_VAR\n");
    if lets.clone().next().is_some() {
        out.push_str("VAR_TEMP\n");
        lets.clone().for_each(|(index, _)| {
            let _ = writeln!(out, "    t{index} : LREAL;");
        });
        out.push_str("END_VAR\n");
    }
    out.push('\n');
    for (index, value) in lets {
        let _ = writeln!(out, "t{index} := {};", expression(&words, value));
    }
    for ((name, _), value) in results.iter().zip(&values) {
        let _ = writeln!(out, "{name} := {};", expression(&words, value));
    }
    out + "END_FUNCTION_BLOCK\n"
}

/// The friction in every equation that has any, as the input that holds it where one does: entries of the regressor, and known terms, that
/// depend on velocities alone and change their sign with them. Coriolis and centrifugal forces do not change theirs.
fn friction(estimator: &EstimatorSource) -> (Plan, Vec<(String, String)>) {
    let evaluation = &estimator.plan.evaluation;
    let mut merger = Merger::default();
    let (entries, known) = (merger.append(&evaluation.regressor), merger.append(&evaluation.known));
    let columns = estimator.form.columns.len();
    let (mut outputs, mut results) = (Vec::new(), Vec::new());
    for (r, row) in estimator.form.rows.iter().enumerate() {
        let mut sum: Option<Slot> = None;
        for column in 0..=columns {
            let entry = if column == columns { known[r] } else { entries[r * columns + column] };
            if !is_friction(&merger.clone().finish(vec![entry])) {
                continue;
            }
            let force = if column == columns {
                entry
            } else {
                let theta = merger.load(Leaf::Column(column));
                merger.emit(Op::Mul(theta, entry))
            };
            sum = Some(sum.map_or(force, |sum| merger.emit(Op::Add(sum, force))));
        }
        let Some(force) = sum else { continue };
        let solved = |input| estimator.plan.solved.iter().any(|own| own.input == input);
        let alone = match row.inputs.as_slice() {
            [(input, factor)] if !solved(*input) => factor.as_constant().map(|factor| (*input, factor)),
            _ => None,
        };
        let (slot, result) = match alone {
            Some((input, factor)) => {
                let name = estimator.model.quantity(input).name.to_string();
                let factor = merger.emit(Op::Constant(factor));
                let slot =
                    if merger.is_number(factor, One::is_one) { force } else { merger.emit(Op::Div(force, factor)) };
                (slot, (name, text::quantity(estimator, input)))
            }
            None => (force, (row.name.to_string(), text::equation(estimator, r))),
        };
        outputs.push(slot);
        results.push(result);
    }
    (merger.finish(outputs).scheduled(), results)
}

/// Whether a force depends on velocities alone, and changes its sign with them.
fn is_friction(plan: &Plan) -> bool {
    let rates = plan.inputs.iter().filter(|leaf| matches!(leaf, Leaf::Motion(_, 1))).count();
    if rates == 0 || plan.inputs.iter().any(|leaf| matches!(leaf, Leaf::Motion(_, order) if *order != 1)) {
        return false;
    }
    let at = |motion: usize, sign: f64| {
        let value = |leaf: &Leaf| {
            let place = plan.inputs.iter().position(|own| own == leaf)?;
            // Multiples of an irrational number modulo one, about zero for rates and above it for constants.
            let part = ((motion * plan.inputs.len() + place + 1) as f64 * std::f64::consts::SQRT_2).fract();
            Some(if matches!(leaf, Leaf::Motion(..)) { sign * (4.0 * part - 2.0) } else { part + 0.5 })
        };
        evaluated(plan, value)[0].unwrap_or(f64::NAN)
    };
    let pairs: Vec<(f64, f64)> = (0..MOTIONS).map(|motion| (at(motion, 1.0), at(motion, -1.0))).collect();
    let odd = pairs.iter().all(|(there, back)| (there + back).abs() <= f64::EPSILON * there.abs().max(back.abs()));
    odd && pairs.iter().any(|(there, _)| *there != 0.0)
}

/// Functions that the language does not have.
fn helpers(model: &str, blocks: &str) -> String {
    let all = [
        (
            "sign",
            "-1, 0 or 1.",
            "x : LREAL;",
            "IF x > 0.0 THEN\n    NAME := 1.0;\nELSIF x < 0.0 THEN\n    NAME := -1.0;\nELSE\n    NAME := 0.0;\nEND_IF;",
        ),
        (
            "tanh",
            "Hyperbolic tangent; beyond 20 it is 1 or -1 to all digits.",
            "x : LREAL;",
            "IF x > 20.0 THEN\n    NAME := 1.0;\nELSIF x < -20.0 THEN\n    NAME := -1.0;\nELSE\n    \
             NAME := (EXP(2.0 * x) - 1.0) / (EXP(2.0 * x) + 1.0);\nEND_IF;",
        ),
        (
            "atan2",
            "Angle of the vector (x, y), rad.",
            "y : LREAL;\n    x : LREAL;",
            "IF x > 0.0 THEN\n    NAME := ATAN(y / x);\nELSIF x < 0.0 AND y >= 0.0 THEN\n    NAME := ATAN(y / x) + PI;\n\
             ELSIF x < 0.0 THEN\n    NAME := ATAN(y / x) - PI;\nELSIF y > 0.0 THEN\n    NAME := PI / 2.0;\n\
             ELSIF y < 0.0 THEN\n    NAME := -PI / 2.0;\nELSE\n    NAME := 0.0;\nEND_IF;",
        ),
    ];
    let used = all.into_iter().filter(|(name, ..)| blocks.contains(&format!("{model}_{name}(")));
    let texts = used.map(|(name, about, arguments, body)| {
        let own = format!("{model}_{name}");
        let body = body.replace("NAME", &own).replace("PI", &number(std::f64::consts::PI));
        format!(
            "\n{}FUNCTION {own} : LREAL\nVAR_INPUT\n    {arguments}\nEND_VAR\n\n{body}\nEND_FUNCTION\n",
            comment(about)
        )
    });
    texts.collect()
}
