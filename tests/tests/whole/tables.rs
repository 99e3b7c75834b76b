//! The printed tables of Feng, chapters 4 and 5, entry by entry.

use crate::support::{model, root, skipped, table_of};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::process::Command;
use tpm_codegen::emit::table::{csv, latex, markdown};
use tpm_runtime::Model as _;
use tpm_runtime::interpret::{Interpreted, pattern};
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::regressor::prepare::prepare;

/// Coefficients of a table by harmonic, function, parameter and powers.
type Facts = BTreeMap<(usize, String, String, String), Rational>;

fn facts(name: &str) -> Facts {
    let path = root().join("tests/fixtures/tables").join(format!("{name}.csv"));
    let text = std::fs::read_to_string(path).expect("a fixture");
    let lines = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    let facts: Facts = lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            let [harmonic, function, parameter, coefficient, powers] = cells[..] else { panic!("five cells: {line}") };
            let key = (harmonic.parse().expect("a harmonic"), function.into(), parameter.into(), powers.into());
            (key, rational::parse(coefficient).expect("a rational number"))
        })
        .collect();
    assert!(facts.len() > 20, "the fixture has the whole equation");
    facts
}

fn computed(table: &HarmonicTable, equation: &str) -> Facts {
    let entries = table.entries().filter(|entry| table.equations[entry.equation] == equation);
    entries
        .map(|entry| {
            let mut powers: Vec<(bool, String)> = entry
                .powers
                .factors()
                .map(|(&symbol, power)| {
                    let name = &table.symbols[symbol];
                    (name == "w", format!("{name}^{power}"))
                })
                .collect();
            powers.sort();
            let powers = powers.into_iter().map(|(_, text)| text).collect::<Vec<_>>().join(" ");
            assert_eq!(entry.pi, 0);
            let parameter = table.parameters[entry.column.expect("no known term")].to_string();
            ((entry.harmonic, entry.function.name().to_owned(), parameter, powers), entry.coefficient.clone())
        })
        .collect()
}

#[test]
fn the_table_is_that_of_feng_4_44() {
    let table = table_of("two_carts");
    assert_eq!(table.parameters, ["c1", "c2", "c3", "c4", "c5", "c6", "c7"]);
    assert_eq!(computed(&table, "F"), facts("feng_4_44"));
    // The five places where the printed equation differs (method: column sums, and recomputation).
    let exact = computed(&table, "F");
    let at = |harmonic: usize, parameter: &str| {
        let found = exact.iter().find(|((h, _, p, _), _)| *h == harmonic && p == parameter);
        found.map(|(_, value)| value.to_string()).expect("an entry")
    };
    assert_eq!(at(3, "c3"), "37393/60000", "printed 37393/180000");
    assert_eq!(at(5, "c4"), "1337/2400", "printed -1337/2400");
    assert_eq!(at(1, "c5"), "-99/32", "printed in the place of (1, c7), clipped");
    assert_eq!(at(1, "c7"), "39761/60000", "printed blank");
    assert_eq!(at(3, "c7"), "1157/180000", "printed 157/180000");
}

#[test]
fn the_tables_are_those_of_feng_b_1_and_b_2() {
    let table = table_of("closed_loop_arm");
    let (first, second) = (computed(&table, "tau1"), computed(&table, "tau2"));
    assert_eq!(first, facts("feng_b_1"));
    assert_eq!(second, facts("feng_b_2"));
    // The ten terms at harmonics 7 and 9 that the printed equations leave out.
    let high = |facts: &Facts| facts.keys().filter(|(harmonic, ..)| *harmonic > 6).count();
    assert_eq!((high(&first), high(&second)), (4, 6));
}

/// Sums of equally spaced samples integrate a finite Fourier series exactly, so that what is compared is rounding alone.
fn agrees_with_quadrature(name: &str, values: &[f64]) {
    let declared = model(name);
    let prepared = prepare(declared).expect("linear in the parameters");
    let table = table_of(name);
    let mut values = values.iter().copied().cycle();
    let symbols: Vec<f64> = table.symbols.iter().map(|_| values.next().expect("endless")).collect();
    let symbol = |wanted: &str| {
        table.symbols.iter().position(|name| name == wanted).map(|index| symbols[index]).expect("a symbol of the table")
    };
    let parameters: Vec<f64> = table.parameters.iter().map(|_| values.next().expect("endless")).collect();

    let interpreted = Interpreted::new(&prepared.model, &prepared.form);
    // What the table does not hold, it does not depend on.
    let constants: Vec<f64> = vec![0.4; interpreted.dims().constants];
    let pattern = prepared.model.pattern(None).expect("has a pattern");
    // An eliminated coordinate is no coordinate of the rows.
    let pattern = pattern::of_rows(pattern, &prepared.model, &prepared.form, |_| Some(0.4)).expect("values are given");
    assert!(pattern.open().is_empty());
    let amplitudes: Vec<f64> = pattern.amplitudes.iter().map(|name| symbol(name)).collect();
    let trajectory = pattern.trajectory(&amplitudes, symbol("w"));

    let dims = interpreted.dims();
    let highest = (0..dims.rows).map(|row| table.highest_harmonic(row)).max().expect("a row");
    let samples = 4 * (highest + 8);
    let mut motion = vec![0.0; dims.motion_len()];
    let mut workspace = vec![0.0; interpreted.inverse_workspace_len()];
    let mut forces = vec![Vec::with_capacity(samples); dims.rows];
    let mut sample = vec![0.0; dims.rows];
    for n in 0..samples {
        trajectory.motion_at(n, samples, 0.0, &mut motion);
        interpreted
            .inverse_dynamics(&motion, &parameters, &constants, &mut workspace, &mut sample)
            .expect("defined everywhere");
        forces.iter_mut().zip(&sample).for_each(|(force, value)| force.push(*value));
    }
    for (row, force) in forces.iter().enumerate() {
        let peak = force.iter().fold(0.0_f64, |peak, value| peak.max(value.abs()));
        for harmonic in 0..=highest + 3 {
            for function in [Trig::Cos, Trig::Sin] {
                let weight = if harmonic == 0 { 1.0 } else { 2.0 } / samples as f64;
                let wave = |n: usize| {
                    let angle = TAU * ((n * harmonic) % samples) as f64 / samples as f64;
                    if function == Trig::Cos { angle.cos() } else { angle.sin() }
                };
                let integral: f64 = force.iter().enumerate().map(|(n, value)| weight * value * wave(n)).sum();
                let exact: f64 = (0..dims.parameters)
                    .flat_map(|column| {
                        table.at(row, harmonic, function, Some(column)).map(move |entry| (column, entry))
                    })
                    .map(|(column, entry)| parameters[column] * table.evaluate(&entry, &symbols))
                    .sum();
                let difference = (integral - exact).abs();
                assert!(
                    difference <= 1e-12 * peak,
                    "{name}, row {row}, {function:?} {harmonic}: {difference:e} of {peak:e}"
                );
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn tables_agree_with_quadrature_at_random_values(values in prop::collection::vec(0.3_f64..2.0, 24)) {
        for name in ["mass_spring_drag", "two_carts", "three_carts", "closed_loop_arm", "silverbox"] {
            agrees_with_quadrature(name, &values);
        }
    }
}

#[test]
fn printed_forms_do_not_change() {
    for name in ["mass_spring_drag", "two_carts", "three_carts", "closed_loop_arm"] {
        let table = table_of(name);
        insta::assert_snapshot!(format!("{name}_markdown"), markdown(&table));
        insta::assert_snapshot!(format!("{name}_latex"), latex(&table));
        // A line for each entry, below the header.
        assert_eq!(csv(&table).lines().count(), table.len() + 1);
    }
}

#[test]
fn latex_is_set_as_it_is() {
    if Command::new("pdflatex").arg("--version").output().is_err() {
        skipped("pdflatex is not installed");
        return;
    }
    for name in ["mass_spring_drag", "two_carts", "three_carts", "closed_loop_arm", "emps"] {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("table.tex"), latex(&table_of(name))).expect("a file");
        let run = Command::new("pdflatex")
            .args(["-interaction=nonstopmode", "-halt-on-error", "table.tex"])
            .current_dir(folder.path())
            .output()
            .expect("runs");
        let printed = String::from_utf8_lossy(&run.stdout);
        assert!(run.status.success(), "{name}: {printed}");
        assert!(!printed.contains("Overfull"), "{name} runs over the margin: {printed}");
    }
}

/// At t = 0 everything is at rest: columns with a derivative sum to 0, a pure power of x to x(0)^p.
#[test]
fn columns_add_up_to_the_regressor_at_rest() {
    for (name, start) in [("mass_spring_drag", "8/9"), ("two_carts", "64/75")] {
        let table = table_of(name);
        let start = rational::parse(start).expect("a rational number");
        for (column, parameter) in table.parameters.iter().enumerate() {
            let entries: Vec<_> = table.entries().filter(|entry| entry.column == Some(column)).collect();
            let power = |entry: &tpm_symbolic::harmonic::table::Entry, name: &str| {
                let index = table.symbols.iter().position(|symbol| symbol == name).expect("declared");
                entry.powers.exponent(&index)
            };
            let sum: Rational = entries.iter().map(|entry| entry.coefficient.clone()).sum();
            let first = entries.first().expect("no empty column");
            let expected = if power(first, "w") > 0 {
                rational::integer(0)
            } else {
                rational::power(&start, power(first, "lambda"))
            };
            assert_eq!(sum, expected, "{name}, {parameter}");
        }
    }
}
