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
fn feng_4_44() {
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
    for (name, start) in [("mass_spring_drag", "8/9"), ("two_carts", "64/75")] {
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
