//! The printed tables of Feng, chapters 4 and 5, entry by entry.

use crate::support::{root, table_of};
use std::collections::BTreeMap;
use tpm_symbolic::rational::{self, Rational};
use tpm_symbolic::table::HarmonicTable;

/// harmonic, function, parameter, powers -> coefficient.
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
            let parameter = table.parameters[entry.column.expect("no known term")].clone();
            ((entry.harmonic, entry.function.name().to_owned(), parameter, powers), entry.coefficient.clone())
        })
        .collect()
}

#[test]
fn feng_b_1_and_b_2() {
    let table = table_of("closed_loop_arm");
    let (first, second) = (computed(&table, "tau1"), computed(&table, "tau2"));
    assert_eq!(first, facts("feng_b_1"));
    assert_eq!(second, facts("feng_b_2"));
    // The ten terms at harmonics 7 and 9 that the printed equations leave out.
    let high = |facts: &Facts| facts.keys().filter(|(harmonic, ..)| *harmonic > 6).count();
    assert_eq!((high(&first), high(&second)), (4, 6));
}

/// At t = 0 everything is at rest: columns with a derivative sum to 0, a pure power of x to x(0)^p.
#[test]
fn column_sums() {
    for (name, start) in [("mass_spring_drag", "8/9")] {
        let table = table_of(name);
        let start = rational::parse(start).expect("a rational number");
        for (column, parameter) in table.parameters.iter().enumerate() {
            let entries: Vec<_> = table.entries().filter(|entry| entry.column == Some(column)).collect();
            let power = |entry: &tpm_symbolic::table::Entry, name: &str| {
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
