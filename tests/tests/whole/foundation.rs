//! From the text of a model to the printed equations of Feng, chapters 2 and 3.

use crate::support::{parse, table_of};
use std::fmt::Write as _;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::algebra::linear::reduce;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::pattern::rest_to_rest;
use tpm_symbolic::number::rational::{Rational, integer, ratio};

/// The rational factors of one equation's cosine rows, by harmonic and column: the middle factor of Feng, Eqn 3.27.
fn middle_factor(table: &HarmonicTable, harmonics: &[usize]) -> Vec<Vec<Rational>> {
    let cell = |harmonic: usize, column: usize| -> Rational {
        table.at(0, harmonic, Trig::Cos, Some(column)).map(|entry| entry.coefficient.clone()).sum()
    };
    harmonics.iter().map(|&h| (0..table.parameters.len()).map(|column| cell(h, column)).collect()).collect()
}

fn printed(matrix: &[Vec<Rational>]) -> String {
    let mut text = String::new();
    for row in matrix {
        let cells: Vec<String> = row.iter().map(|value| format!("{:>6}", value.to_string())).collect();
        let _ = writeln!(text, "{}", cells.join(" "));
    }
    text
}

#[test]
fn feng_3_26_as_json() {
    let table = table_of("mass_spring_drag");
    let json = serde_json::to_value(&table).expect("plain data");
    // Feng, Eqn 3.26, without the error differences: D is linear, so the table is that of the model itself.
    let expected = [
        (0, "k2", "5/9", 2, 2),
        (1, "m", "-1", 1, 2),
        (1, "k1", "1", 1, 0),
        (2, "k2", "-5/6", 2, 2),
        (3, "m", "1", 1, 2),
        (3, "k1", "-1/9", 1, 0),
        (4, "k2", "1/3", 2, 2),
        (6, "k2", "-1/18", 2, 2),
    ];
    let entries = json["entries"].as_array().expect("a list");
    assert_eq!(entries.len(), expected.len());
    for (entry, (harmonic, parameter, coefficient, lambda, w)) in entries.iter().zip(expected) {
        assert_eq!(entry["equation"], "u");
        assert_eq!(entry["function"], "cos");
        assert_eq!(entry["pi"], 0);
        assert_eq!(
            (&entry["harmonic"], &entry["parameter"], &entry["coefficient"]),
            (&harmonic.into(), &parameter.into(), &coefficient.into())
        );
        assert_eq!(entry["powers"]["lambda"].as_i64().unwrap_or(0), lambda);
        assert_eq!(entry["powers"]["w"].as_i64().unwrap_or(0), w);
    }
    assert_eq!(json["schema"], "tpm.table/1");
    assert_eq!(json["model"], "MassSpringDrag");
    insta::assert_json_snapshot!("feng_3_26", json);
}

#[test]
fn feng_3_27_and_3_29() {
    let table = table_of("mass_spring_drag");
    // There is no harmonic 5: the left matrix of 3.27 is diag(T0, T1, T2, T3, T4, T6).
    let full = middle_factor(&table, &[0, 1, 2, 3, 4, 6]);
    let zero = || integer(0);
    let expected = vec![
        vec![zero(), zero(), ratio(5, 9)],
        vec![integer(-1), integer(1), zero()],
        vec![zero(), zero(), ratio(-5, 6)],
        vec![integer(1), ratio(-1, 9), zero()],
        vec![zero(), zero(), ratio(1, 3)],
        vec![zero(), zero(), ratio(-1, 18)],
    ];
    assert_eq!(full, expected);
    assert_eq!(table.rows().len(), 6, "and no other row");
    assert_eq!(reduce(&mut full.clone()).len(), 3, "rank");
    let reduced = middle_factor(&table, &[0, 1, 3]);
    assert_eq!(determinant(&reduced), ratio(-40, 81));
    insta::assert_snapshot!("feng_3_27_middle_factor", printed(&full));
    insta::assert_snapshot!("feng_3_29_middle_factor", printed(&reduced));
}

fn determinant(m: &[Vec<Rational>]) -> Rational {
    let minor = |a: usize, b: usize| &m[1][a] * &m[2][b] - &m[1][b] * &m[2][a];
    &m[0][0] * minor(1, 2) - &m[0][1] * minor(0, 2) + &m[0][2] * minor(0, 1)
}

#[test]
fn patterns_of_orders_3_to_13() {
    let mut text = String::new();
    for order in [3u32, 5, 7, 9, 11, 13] {
        let shape = rest_to_rest(order).expect("odd order");
        for n in 1..=order {
            assert_eq!(shape.derivative(n).at_zero(), integer(0), "order {order}, derivative {n}");
            assert_eq!(shape.derivative(n).at_pi(), integer(0), "order {order}, derivative {n}");
        }
        let terms: Vec<String> = shape.terms().map(|(k, _, a)| format!("{a} cos {k}")).collect();
        let _ = writeln!(text, "{order}: {}; start {}", terms.join(", "), shape.at_zero());
    }
    insta::assert_snapshot!("rest_to_rest_patterns", text);
}

#[test]
fn feng_2_17_to_2_21() {
    // a0 = (x0 + x1)/2, a1 = 9 (x0 - x1)/16, a3 = (x1 - x0)/16 (printed as a2 in Eqn 2.19).
    let model = parse(
        "point to point",
        "model P { coordinate x; input u; parameter k; k*x = u;
           pattern { amplitude x0, x1; frequency w; x = point_to_point(x0, x1, w, 3); } }",
    );
    let table = crate::support::expanded(&model);
    let mut found: Vec<(usize, String, Rational)> = Vec::new();
    for entry in table.entries() {
        let name = entry.powers.factors().map(|(&s, _)| table.symbols[s].clone()).collect::<Vec<_>>().join(" ");
        found.push((entry.harmonic, name, entry.coefficient.clone()));
    }
    found.sort();
    let expected = vec![
        (0, "x0".to_owned(), ratio(1, 2)),
        (0, "x1".to_owned(), ratio(1, 2)),
        (1, "x0".to_owned(), ratio(9, 16)),
        (1, "x1".to_owned(), ratio(-9, 16)),
        (3, "x0".to_owned(), ratio(-1, 16)),
        (3, "x1".to_owned(), ratio(1, 16)),
    ];
    assert_eq!(found, expected);
    // Eqn 2.21 is the same shape with lambda = 9 (x0 - x1)/16 about the centre.
    assert_eq!(rest_to_rest(3).expect("odd order").cos_coefficient(3), ratio(-1, 9));
    insta::assert_snapshot!("feng_2_20", format!("{found:#?}"));
}
