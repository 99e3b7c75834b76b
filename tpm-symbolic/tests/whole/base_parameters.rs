//! Exact base parameters: against the ranks of coefficients, with dependences that were planted, and with certificates that are wrong.

use proptest::prelude::{Strategy, prop_assert, prop_assert_eq, proptest};
use std::collections::{BTreeMap, BTreeSet};
use tpm_symbolic::algebra::linear;
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{ExprId, Function};
use tpm_symbolic::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use tpm_symbolic::number::rational::{Rational, integer, ratio};
use tpm_symbolic::regressor::base_parameters::{
    BaseParameterError, BaseParameters, Motions, Rest, base_parameters, verify,
};
use tpm_symbolic::regressor::form::{RegressorForm, regressor_form};

/// A model with one equation: sum theta_j entry_j = u, over two coordinates.
fn model(entries: impl FnOnce(&mut ExactModel) -> Vec<ExprId>) -> ExactModel {
    let mut model = ExactModel { name: "Columns".to_owned(), ..ExactModel::default() };
    model.declare_coordinate("x", None);
    model.declare_coordinate("y", None);
    let u = model.declare("u", None, Kind::Input);
    let entries = entries(&mut model);
    let mut terms = Vec::new();
    for (index, entry) in entries.into_iter().enumerate() {
        let parameter = model.declare(&format!("p{index}"), None, Kind::Parameter);
        let parameter = model.graph.symbol(parameter);
        terms.push(model.graph.mul(parameter, entry));
    }
    let u = model.graph.symbol(u);
    terms.push(model.graph.neg(u));
    let terms = (0..).zip(terms).map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
    model.equations.push(Equation { name: "u".to_owned(), terms });
    model
}

/// The position, velocity and acceleration of x, then those of y.
fn leaves(model: &mut ExactModel) -> Vec<ExprId> {
    use tpm_symbolic::expr::graph::Coordinate;
    (0..2).flat_map(|c| (0..3).map(move |n| (c, n))).map(|(c, n)| model.graph.derivative_of(Coordinate(c), n)).collect()
}

fn found(model: &ExactModel, motions: &Motions) -> (RegressorForm, BaseParameters) {
    let form = regressor_form(model).expect("linear");
    let found = base_parameters(model, &form, motions).expect("no division by zero");
    verify(model, &form, motions, &found.certificate, 1).expect("the certificate holds");
    (form, found)
}

/// The rank of the coefficients of independent products, row by row.
fn coefficient_rank(form: &RegressorForm) -> usize {
    let mut rows: BTreeMap<(usize, &Monomial<ExprId>), Vec<Rational>> = BTreeMap::new();
    for (r, row) in form.rows.iter().enumerate() {
        for term in &row.terms {
            let Some(column) = term.column else { continue };
            let row = rows.entry((r, &term.atoms)).or_insert_with(|| vec![integer(0); form.columns.len()]);
            row[column] += &term.coefficient;
        }
    }
    linear::reduce(&mut rows.into_values().collect()).len()
}

fn polynomials() -> impl Strategy<Value = Vec<Vec<(i64, usize, usize)>>> {
    proptest::collection::vec(proptest::collection::vec((-3i64..4, 0usize..3, 0usize..3), 1..4), 1..7)
}

proptest! {
    #[test]
    fn ranks_are_those_of_the_coefficients(columns in polynomials()) {
        let model = model(|model| {
            let leaves = leaves(model);
            let mut entries = Vec::new();
            for column in &columns {
                let terms: Vec<ExprId> = column.iter().map(|&(value, a, b)| {
                    let value = model.graph.integer(value);
                    model.graph.product(&[value, leaves[a], leaves[3 + b]])
                }).collect();
                entries.push(model.graph.sum(&terms));
            }
            // One column that is never zero, so that the equation does not vanish.
            entries.push(leaves[2]);
            entries
        });
        let (form, found) = found(&model, &Motions::default());
        prop_assert_eq!(found.rank, coefficient_rank(&form));
        let base = found.base.expect("rational");
        prop_assert_eq!(base.len(), found.rank);
        let free: BTreeSet<usize> = base.iter().flat_map(|base| base.others.iter().map(|(other, _)| *other)).collect();
        prop_assert!(base.iter().all(|base| !free.contains(&base.column)));
    }
}

#[test]
fn planted_dependences_are_found_and_wrong_ones_refused() {
    // Columns cos^2 x, sin^2 x, 1, x'' and 3/7 x'' - 5 cos^2 x: one is sin^2 + cos^2, another a combination.
    let model = model(|model| {
        let leaves = leaves(model);
        let graph = &mut model.graph;
        let [cos, sin] = [Function::Cos, Function::Sin].map(|function| graph.function(function, leaves[0]));
        let (cos, sin) = (graph.pow(cos, 2), graph.pow(sin, 2));
        let (part, square) = (graph.scale(leaves[2], ratio(3, 7)), graph.scale(cos, integer(-5)));
        vec![cos, sin, graph.integer(1), leaves[2], graph.add(part, square)]
    });
    let (form, found) = found(&model, &Motions::default());
    assert_eq!((found.rank, form.columns.len()), (3, 5));
    let mut lumped: BTreeMap<usize, Vec<(usize, Rational)>> = BTreeMap::new();
    for base in found.base.clone().expect("rational") {
        lumped.insert(base.column, base.others);
    }
    let expected = BTreeMap::from([
        (0, vec![(2, integer(1)), (4, integer(-5))]),
        (1, vec![(2, integer(1))]),
        (3, vec![(4, ratio(3, 7))]),
    ]);
    assert_eq!(lumped, expected);
    let check = |certificate: &_| verify(&model, &form, &Motions::default(), certificate, 3);
    let mut wrong = found.certificate.clone();
    if let Some(list) = &mut wrong.directions {
        list[0][1].1 += ratio(1, 1_000_000_007);
    }
    assert_eq!(check(&wrong), Err(BaseParameterError::NoNullVector { direction: 0 }));
    let mut wrong = found.certificate.clone();
    wrong.directions.as_mut().map(Vec::pop);
    assert_eq!(check(&wrong), Err(BaseParameterError::Count { found: 1, wanted: 2 }));
    let mut wrong = found.certificate.clone();
    wrong.rank = 4;
    assert_eq!(check(&wrong), Err(BaseParameterError::Rank { found: 3, claimed: 4 }));
    let mut wrong = found.certificate.clone();
    if let Some(list) = &mut wrong.directions {
        list[1] = list[0].clone();
    }
    assert_eq!(check(&wrong), Err(BaseParameterError::Count { found: 1, wanted: 2 }));
}

#[test]
fn what_rests_shows_less() {
    // Columns x'', y'', sign x', |y'|, cos y, 1.
    let model = model(|model| {
        let leaves = leaves(model);
        let graph = &mut model.graph;
        let (sign, abs) = (graph.function(Function::Sign, leaves[1]), graph.function(Function::Abs, leaves[4]));
        vec![leaves[2], leaves[5], sign, abs, graph.function(Function::Cos, leaves[3]), graph.integer(1)]
    });
    assert_eq!(found(&model, &Motions::default()).1.rank, 6);
    let y = tpm_symbolic::expr::graph::Coordinate(1);
    let resting = Motions { resting: BTreeMap::from([(y, Rest::HalfTangent(ratio(1, 2)))]), ..Motions::default() };
    let (_, found) = found(&model, &resting);
    // cos y = 3/5 beside 1; y'' and |y'| are zero.
    assert_eq!(found.rank, 3);
    let base = found.base.expect("rational");
    let with_others: Vec<_> = base.iter().filter(|base| !base.others.is_empty()).collect();
    assert_eq!(with_others.len(), 1);
    assert_eq!((with_others[0].column, with_others[0].others.as_slice()), (4, [(5, ratio(5, 3))].as_slice()));
}

#[test]
fn a_sign_turns_both_ways_and_repeats_its_square() {
    // Columns sign(x')^2, 1, sign x': the first two are alike.
    let model = model(|model| {
        let leaves = leaves(model);
        let graph = &mut model.graph;
        let sign = graph.function(Function::Sign, leaves[1]);
        vec![graph.pow(sign, 2), graph.integer(1), sign]
    });
    assert_eq!(found(&model, &Motions::default()).1.rank, 2);
}
