//! What the programs around generated estimators share.

use std::io::Read;

/// The numbers of a line, of which so many are expected.
pub fn numbers(line: Option<&str>, count: usize) -> Vec<f64> {
    let words = line.unwrap_or_default().split_whitespace();
    let numbers: Vec<f64> = words.map(|word| word.parse().expect("a number")).collect();
    assert_eq!(numbers.len(), count);
    numbers
}

/// Prints zero, every value with its deviation, not a number where there is none, and further numbers.
pub fn print_found<const N: usize>(values: [Option<f64>; N], deviations: [Option<f64>; N], others: &[f64]) {
    println!("0");
    for (value, deviation) in values.into_iter().zip(deviations) {
        println!("{:?}\n{:?}", value.unwrap_or(f64::NAN), deviation.unwrap_or(f64::NAN));
    }
    others.iter().for_each(|number| println!("{number:?}"));
}

/// Runs on standard input in the precision of the first argument, double or single.
pub fn run(single: impl Fn(&str), double: impl Fn(&str)) {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text).expect("readable");
    match std::env::args().nth(1).as_deref() {
        Some("single") => single(&text),
        _ => double(&text),
    }
}
