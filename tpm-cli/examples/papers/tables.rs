//! Patterns and exact tables of D. Feng, chapters 2 to 4 and appendix B, beside what is printed.

use super::Chapter;
use super::failure::Failure;
use super::input::Input;
use super::markdown::table;
use super::page::formula;
use std::collections::BTreeMap;
use tpm_codegen::diagnostic;
use tpm_runtime::plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_runtime::study::Report;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::algebra::linear;
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::identifiability::{Experiment, identifiability};
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::pattern::rest_to_rest;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::table::entry_formula;
use tpm_symbolic::regressor::prepare::{Prepared, prepare};

/// The printed coefficients: table, equation, function, harmonic, parameter, coefficient. One that is nothing is a place that is printed
/// blank although others in its row and column are not.
const PRINTED: &str = include_str!("printed.csv");

/// Slips of the printed tables: table, harmonic, parameter, and the reason.
const SLIPS: &[(&str, usize, &str, &str)] = &[
    (
        "4.44",
        3,
        "c3",
        "the denominator of the entries beside it: a column with a derivative adds up to 0 at t = 0, and this one does not",
    ),
    ("4.44", 5, "c4", "a lost sign: the column does not add up to 0"),
    ("4.44", 1, "c5", "the entry that belongs to (1, c7), clipped: 39761/60000"),
    ("4.44", 1, "c7", "printed in the place of (1, c5), clipped"),
    ("4.44", 3, "c7", "a lost digit: the column does not add up to (64/75)^3"),
];

/// A model that is shipped, in regressor form.
pub(super) fn prepared(name: &str, text: &str) -> Result<Prepared, Failure> {
    let (source, parsed) = Input::shipped(name, text).model()?;
    prepare(parsed.model.clone()).map_err(|error| Failure::Model(diagnostic::render(&source, &parsed.locate(&error))))
}

/// The table of a model under its first pattern.
pub(super) fn table_of(prepared: &Prepared) -> Result<HarmonicTable, Failure> {
    let name = &prepared.model.name;
    let pattern = prepared.model.pattern(None).ok_or_else(|| Failure::Input(format!("{name} has no pattern")))?;
    expand(&prepared.model, &prepared.form, pattern).map_err(|error| Failure::Input(format!("{name}: {error}")))
}

/// What is printed of one table, by equation, harmonic, function and parameter.
type Printed<'a> = BTreeMap<(&'a str, usize, &'a str, &'a str), &'a str>;

fn printed(wanted: &str) -> Printed<'static> {
    let cells = PRINTED.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(',').collect::<Vec<_>>());
    let rows = cells.filter(|cells| cells[0] == wanted);
    rows.map(|c| ((c[1], c[3].parse().expect("a harmonic"), c[2], c[4]), c[5])).collect()
}

/// The whole table, every place with what is printed there.
fn beside(wanted: &str, table_: &HarmonicTable, unexplained: &mut Vec<String>) -> (String, usize, usize) {
    let printed = printed(wanted);
    let (mut rows, mut agree) = (Vec::new(), 0);
    for entry in table_.entries() {
        let parameter = entry.column.map_or("", |column| table_.parameters[column].as_str());
        let equation = table_.equations[entry.equation].as_str();
        let function = if entry.function == Trig::Cos { "cos" } else { "sin" };
        let found = printed.get(&(equation, entry.harmonic, function, parameter)).copied();
        let same = found.and_then(rational::parse).is_some_and(|value| value == entry.coefficient);
        let slip = SLIPS
            .iter()
            .find(|(table, harmonic, name, _)| (*table, *harmonic, *name) == (wanted, entry.harmonic, parameter));
        let reason = match (same, slip, wanted.starts_with('B') && entry.harmonic > 6) {
            (true, ..) => "",
            (_, Some((.., reason)), _) => reason,
            (_, _, true) => "the printed sum stops at harmonic 6 without saying so",
            _ => {
                unexplained.push(format!("Eqn {wanted}: harmonic {}, {parameter}", entry.harmonic));
                "no reason known"
            }
        };
        agree += usize::from(same);
        let harmonic = if entry.harmonic == 0 { "1".to_owned() } else { format!("{function} {}", entry.harmonic) };
        let found = found.map_or("nothing", |text| if text.is_empty() { "blank" } else { text });
        rows.push(vec![
            equation.to_owned(),
            harmonic,
            parameter.to_owned(),
            formula(&entry_formula(table_, &entry)),
            found.to_owned(),
            reason.to_owned(),
        ]);
    }
    // What is printed and does not exist.
    for ((equation, harmonic, function, parameter), value) in &printed {
        let trig = if *function == "cos" { Trig::Cos } else { Trig::Sin };
        let exists = table_.entries().any(|entry| {
            let name = entry.column.map_or("", |column| table_.parameters[column].as_str());
            (table_.equations[entry.equation].as_str(), entry.harmonic, entry.function, name)
                == (*equation, *harmonic, trig, *parameter)
        });
        if !exists {
            unexplained.push(format!("Eqn {wanted}: {value} is printed at harmonic {harmonic} of {parameter}"));
        }
    }
    let text = table(&["equation", "harmonic", "of", "computed", "printed factor", "why they differ"], &rows);
    (text, agree, rows.len())
}

/// Chapters 1, 2, 3 and 5 of the page.
pub(super) fn chapters(unexplained: &mut Vec<String>) -> Result<Vec<Chapter>, Failure> {
    Ok(vec![patterns()?, spring(unexplained)?, carts(unexplained)?, arm(unexplained)?])
}

fn patterns() -> Result<Chapter, Failure> {
    let mut rows = Vec::new();
    let mut traces = Vec::new();
    let forms =
        [(3, "Eqn 2.21", "1, -1/9"), (5, "Eqn 4.42", "1, -1/6, 1/50"), (7, "Eqn 4.13, l = 3 (not printed)", "-")];
    for (colour, (order, name, printed)) in forms.into_iter().enumerate() {
        let fourier = rest_to_rest(order).map_err(|error| Failure::Input(error.to_string()))?;
        let found: Vec<String> = fourier.terms().map(|(.., value)| value.to_string()).collect();
        rows.push(vec![name.to_owned(), found.join(", "), printed.to_owned()]);
        let points = |n: u32| {
            let at = |i: u32| std::f64::consts::TAU * f64::from(i) / 400.0;
            (0..=400).map(|i| (f64::from(i) / 400.0, fourier.derivative(n).evaluate(at(i)))).collect::<Vec<_>>()
        };
        traces.push([0, 2].map(|n| Trace::new(&format!("harmonics to {order}"), colour, Curve::Line(points(n)))));
    }
    let panel = |which: usize, label: &str| Panel {
        x: Axis::linear("time, in periods").from_to(0.0, 1.0),
        y: Axis::linear(label),
        traces: traces.iter().map(|pair| pair[which].clone()).collect(),
    };
    let figure = Figure::new(
        "Patterns from rest to rest, amplitude 1",
        vec![panel(0, "position x / lambda"), panel(1, "acceleration x'' / (lambda w^2)")],
    );
    let spring = prepared("mass_spring_drag.tpm", include_str!("../../../models/mass_spring_drag.tpm"))?;
    let highest = table_of(&spring)?.highest_harmonic(0);
    let text = format!(
        "## 1. Patterns (Feng, chapter 2)\n\nCoefficients of cos w t, cos 3 w t, ... of the motion of lowest harmonics that rests at \
         both ends:\n\n{}\nEqn 2.19 calls the coefficient of cos 3 w t a_2; it is a_3. Eqn 2.28 gives 3 (p + q) w as the highest harmonic \
         of the force, with p and q the highest powers of x' and x, each by itself: 9 w for Eqn 3.24. It is 3 w times the highest sum of \
         powers of any one term: {highest} w (table below).\n\n![The patterns over one period: position and acceleration](patterns.svg)\n",
        table(&["pattern", "computed", "printed"], &rows)
    );
    let finding = format!(
        "Patterns (Eqns 2.21, 4.42) agree. Eqn 2.28 overstates the highest harmonic of Eqn 3.24: 9 printed, {highest} computed."
    );
    Ok(Chapter { text, figures: vec![("patterns", figure)], findings: vec![finding] })
}

fn spring(unexplained: &mut Vec<String>) -> Result<Chapter, Failure> {
    let spring = prepared("mass_spring_drag.tpm", include_str!("../../../models/mass_spring_drag.tpm"))?;
    let exact = table_of(&spring)?;
    let (rows, agree, all) = beside("3.26", &exact, unexplained);
    let found = identifiability(&[Experiment::of("3.24", &spring.model, &exact)])
        .map_err(|error| Failure::Input(error.to_string()))?;
    let found = Report::of(&found);
    // The square matrix of Eqn 3.29: harmonics 0, 1 and 3, powers of amplitude and frequency in its last factor.
    let coefficient = |harmonic: usize, column: usize| -> Rational {
        exact.at(0, harmonic, Trig::Cos, Some(column)).map(|entry| entry.coefficient).sum()
    };
    let square: Vec<Vec<Rational>> = [0, 1, 3].map(|k| (0..3).map(|c| coefficient(k, c)).collect()).to_vec();
    let determinant = determinant(&square);
    let mut reduced = square.clone();
    let rank = linear::reduce(&mut reduced).len();
    let square_rows: Vec<Vec<String>> = square
        .iter()
        .zip(["E0", "E1c", "E3c"])
        .map(|(row, name)| std::iter::once(name.to_owned()).chain(row.iter().map(ToString::to_string)).collect())
        .collect();
    let text = format!(
        "## 2. Mass, spring and drag (Feng, Eqns 3.24 to 3.29)\n\nEqn 3.26, and the middle matrix of Eqn 3.27:\n\n{rows}\nRank of the matrix: \
         {} of {}. The middle matrix of Eqn 3.29, which is square:\n\n{}\nRank {rank}, determinant {determinant}. The left matrix of Eqn 3.27 is \
         printed with T0 to T6 in six rows; it is diag(T0, T1, T2, T3, T4, T6), since harmonic 5 is zero.\n",
        found.rank,
        exact.parameters.len(),
        table(&["", "m", "k1", "k2"], &square_rows)
    );
    let finding = format!("Eqns 3.26, 3.27 and 3.29 agree: {agree} of {all} coefficients.");
    Ok(Chapter { text, figures: Vec::new(), findings: vec![finding] })
}

/// The determinant of three rows.
fn determinant(m: &[Vec<Rational>]) -> Rational {
    let minor = |a: usize, b: usize| &m[1][a] * &m[2][b] - &m[1][b] * &m[2][a];
    &m[0][0] * minor(1, 2) - &m[0][1] * minor(0, 2) + &m[0][2] * minor(0, 1)
}

fn carts(unexplained: &mut Vec<String>) -> Result<Chapter, Failure> {
    let carts = prepared("two_carts.tpm", include_str!("../../../models/two_carts.tpm"))?;
    let exact = table_of(&carts)?;
    let (rows, agree, all) = beside("4.44", &exact, unexplained);
    let printed = ["m1 m2/k3", "m1 + m2 + k1 m2/k3", "3 k2 m2/k3", "3 k2 m2^2/k3^2", "k2 m2^3/k3^3", "k1", "k2"];
    let mut graph = carts.model.graph.clone();
    let lumped: Vec<Vec<String>> = carts
        .form
        .columns
        .iter()
        .zip(printed)
        .zip(35..)
        .map(|((column, printed), equation)| {
            let definition = graph.from_polynomial(&column.definition);
            let text = graph.display(definition, &carts.model);
            vec![format!("4.{equation}"), column.name.to_string(), formula(&text), formula(printed)]
        })
        .collect();
    let text = format!(
        "## 3. Two carts (Feng, Eqns 4.30 to 4.44)\n\nWith the driven cart eliminated:\n\n{}\nEqn 4.44, without its factor -1/G2:\n\n{rows}",
        table(&["equation", "", "computed", "printed"], &lumped)
    );
    let finding = format!(
        "Eqns 4.35 to 4.41 agree. Eqn 4.44 agrees in {agree} of its {all} coefficients that are not zero; the others are slips of \
         printing, each of which a sum over the column shows."
    );
    Ok(Chapter { text, figures: Vec::new(), findings: vec![finding] })
}

fn arm(unexplained: &mut Vec<String>) -> Result<Chapter, Failure> {
    let arm = prepared("closed_loop_arm.tpm", include_str!("../../../models/closed_loop_arm.tpm"))?;
    let exact = table_of(&arm)?;
    let split = |equation: usize| {
        let entries = exact.entries().filter(|entry| entry.equation == equation).collect();
        let names = [exact.equations.clone(), exact.parameters.clone(), exact.symbols.clone()];
        let [equations, parameters, symbols] = names;
        HarmonicTable::new(exact.model.clone(), equations, parameters, symbols, entries)
    };
    let (first, agree_1, all_1) = beside("B.1", &split(0), unexplained);
    let (second, agree_2, all_2) = beside("B.2", &split(1), unexplained);
    let text = format!(
        "## 5. Harmonics of the arm (Feng, appendix B)\n\nEqn B.1, the first joint:\n\n{first}\nEqn B.2, the second joint:\n\n{second}"
    );
    let finding = format!(
        "Eqns B.1 and B.2 agree in all {agree_1} and {agree_2} printed coefficients, and leave out {} and {} at harmonics 7 and 9.",
        all_1 - agree_1,
        all_2 - agree_2
    );
    Ok(Chapter { text, figures: Vec::new(), findings: vec![finding] })
}

#[cfg(test)]
mod tests {
    use super::chapters;

    #[test]
    fn every_difference_from_the_printed_tables_has_its_reason() {
        let mut unexplained = Vec::new();
        let found = chapters(&mut unexplained).expect("shipped models");
        assert!(unexplained.is_empty(), "{unexplained:?}");
        let whole: String = found.iter().map(|chapter| chapter.text.as_str()).collect();
        assert!(whole.contains("determinant -40/81"));
        let counts = ["8 of 8 coefficients", "36 of its 41", "all 26 and 41 printed", "leave out 4 and 6"];
        for count in counts {
            let findings: Vec<&String> = found.iter().flat_map(|chapter| &chapter.findings).collect();
            assert!(findings.iter().any(|finding| finding.contains(count)), "{count}: {findings:?}");
        }
    }
}
