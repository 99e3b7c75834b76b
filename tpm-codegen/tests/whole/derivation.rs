//! The shipped models through elimination, expansion and the analysis of identifiability.

use crate::support::{parse, text_of};
use std::collections::BTreeMap;
use tpm_symbolic::algebra::fraction::display_polynomial;
use tpm_symbolic::algebra::polynomial::Polynomial;
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::identifiability::{Experiment, identifiability};
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::number::rational::integer;
use tpm_symbolic::regressor::form::canonical;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::{Prepared, prepare};

fn table_of(text: &str) -> (Prepared, HarmonicTable) {
    let prepared = prepare(parse(text).model).unwrap_or_else(|error| panic!("{error}"));
    let table = expand(&prepared.model, &prepared.form, &prepared.model.patterns[0]);
    let table = table.unwrap_or_else(|error| panic!("{error}"));
    (prepared, table)
}

#[test]
fn two_carts_are_lumped_as_printed() {
    // Feng, Eqns 4.35-4.41.
    let (prepared, table) = table_of(&text_of("two_carts"));
    let definitions: Vec<String> = prepared
        .form
        .columns
        .iter()
        .map(|c| format!("{} = {}", c.name, canonical(&prepared.model, &c.definition)))
        .collect();
    let count = |name: &str| definitions.iter().filter(|d| d.starts_with(name)).count();
    assert_eq!((definitions.len(), count("c")), (7, 7));
    assert_eq!(definitions[5..], ["c6 = k1", "c7 = k2"]);
    let units: Vec<String> =
        prepared.form.columns.iter().map(|c| c.unit.as_ref().expect("declared").to_string()).collect();
    assert_eq!(units[5..], ["N/m", "N/m^3"]);
    assert_eq!((table.entries().len(), table.highest_harmonic(0)), (41, 15));
    let x1 = prepared.reconstructions[0].expr;
    assert!(prepared.model.display(x1).contains("ddot(x2)"));
    let found = identifiability(&[Experiment::of("run", &prepared.model, &table)]).expect("one table");
    let physical = found.physical(&ParameterMap::new(&prepared)).expect("rational");
    assert_eq!((found.rank, found.proven, physical.rank), (7, true, 5));
}

#[test]
fn three_carts_have_fourteen_columns_for_seven_parameters() {
    let (prepared, table) = table_of(&text_of("three_carts"));
    assert_eq!((table.parameters.len(), table.highest_harmonic(0)), (14, 21));
    let found = identifiability(&[Experiment::of("run", &prepared.model, &table)]).expect("one table");
    let physical = found.physical(&ParameterMap::new(&prepared)).expect("rational");
    assert_eq!(physical.rank, 7);
    // Harmonics 1, 3, ..., 21 are eleven rows: fewer than the fourteen columns.
    assert_eq!((found.rows.len(), found.rank), (11, 11));
    assert!(found.proven);
}

#[test]
fn the_arm_needs_two_amplitude_ratios_or_two_multiples() {
    let text = text_of("closed_loop_arm");
    let (_, table) = table_of(&text);
    let found = identifiability(&[Experiment::new("one pattern", &table)]).expect("one table");
    assert_eq!((found.rank, found.proven, table.parameters.len()), (6, true, 9));
    let name = |variable: &usize| found.variables[*variable].clone();
    let named = |direction: &Vec<Polynomial<usize>>| {
        let values = found.parameters.iter().zip(direction).filter(|(_, value)| !value.is_zero());
        values.map(|(parameter, value)| (parameter.clone(), display_polynomial(value, name))).collect()
    };
    let directions: Vec<BTreeMap<String, String>> =
        found.unobservable.as_ref().expect("short").iter().map(named).collect();
    for k in 0..3 {
        let expected = [("a1", "lambda2^2"), ("a2", "lambda1^2"), ("a3", "-2*lambda1*lambda2")];
        let expected = expected.map(|(name, value)| (format!("{name}{k}"), value.to_owned())).into_iter().collect();
        assert!(directions.contains(&expected), "{directions:?}");
    }
    let run = |ratio: i64| {
        Experiment::new("run", &table).with("lambda1", integer(1)).with("lambda2", integer(ratio)).with("w", integer(2))
    };
    assert_eq!(identifiability(&[run(1), run(-1)]).expect("two runs").rank, 9);
    assert_eq!(identifiability(&[run(1), run(2)]).expect("two runs").rank, 9);
    let start = text.find("th1 = th10").expect("the pattern");
    let multiples = text[..start].to_owned()
        + "th1 = th10 + lambda1*(cos(3*w*t) - 1/9*cos(9*w*t) - 8/9);
           th2 = th20 + lambda2*(cos(2*w*t) - 1/9*cos(6*w*t) - 8/9); } }";
    let (_, table) = table_of(&multiples);
    let found = identifiability(&[Experiment::new("3w and 2w", &table)]).expect("one table");
    assert_eq!((found.rank, found.proven), (9, true));
}

#[test]
fn an_impossible_elimination_is_reported_at_its_term() {
    let text = text_of("two_carts").replace("eliminate x1 as c", "eliminate x2 as c").replace("x2 = rest", "x1 = rest");
    let parsed = parse(&text);
    let error = prepare(parsed.model.clone()).expect_err("x2 has its inertia in its row");
    let message = error.to_string();
    assert!(message.contains("`x2`") && message.contains("m2*ddot(x2)"), "{message}");
    assert!(error.term().is_some());
}
