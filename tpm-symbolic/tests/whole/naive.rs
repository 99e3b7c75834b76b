//! The expansion once more, as plainly as possible: one `BigRational` a coefficient, product-to-sum formulas, every term
//! on its own. It shares nothing with the product but the model's data types.

use num_rational::BigRational;
use num_traits::{One, Zero};
use std::collections::BTreeMap;
use tpm_symbolic::algebra::fourier::{Fourier, Trig};
use tpm_symbolic::expr::graph::{Node, Symbol};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::pattern::{Motion, Pattern};
use tpm_symbolic::regressor::form::RegressorForm;

/// Coefficients of cos (false) and sin (true) by harmonic.
pub(crate) type Series = BTreeMap<(usize, bool), BigRational>;
/// Powers of symbols, by model symbol; the key `u32::MAX` is pi.
pub(crate) type Powers = BTreeMap<u32, i32>;
/// A series for every product of symbols.
pub(crate) type Sum = BTreeMap<Vec<(u32, i32)>, Series>;

fn put(series: &mut Series, harmonic: i64, sine: bool, value: BigRational) {
    let value = if sine && harmonic < 0 { -value } else { value };
    if !(sine && harmonic == 0) {
        *series.entry((harmonic.unsigned_abs() as usize, sine)).or_insert_with(BigRational::zero) += value;
    }
}

/// The product of two series by cos a cos b = (cos(a-b) + cos(a+b))/2 and the formulas for sines.
pub(crate) fn series_product(a: &Series, b: &Series) -> Series {
    let mut result = Series::new();
    for (&(i, left), x) in a {
        for (&(k, right), y) in b {
            let (i, k) = (i as i64, k as i64);
            let half = x * y * BigRational::new(1.into(), 2.into());
            match (left, right) {
                (false, false) => {
                    put(&mut result, i - k, false, half.clone());
                    put(&mut result, i + k, false, half);
                }
                (true, true) => {
                    put(&mut result, i - k, false, half.clone());
                    put(&mut result, i + k, false, -half);
                }
                (true, false) => {
                    put(&mut result, i + k, true, half.clone());
                    put(&mut result, i - k, true, half);
                }
                (false, true) => {
                    put(&mut result, i + k, true, half.clone());
                    put(&mut result, k - i, true, half);
                }
            }
        }
    }
    result.retain(|_, value| !value.is_zero());
    result
}

pub(crate) fn series_of(fourier: &Fourier) -> Series {
    fourier.terms().map(|(k, function, value)| ((k, function == Trig::Sin), value.clone().into())).collect()
}

fn series_derivative(series: &Series) -> Series {
    let turn = |(&(k, sine), value): (&(usize, bool), &BigRational)| {
        let factor = BigRational::from_integer(if sine { k.into() } else { -num_bigint::BigInt::from(k) });
        ((k, !sine), value * factor)
    };
    series.iter().filter(|((k, _), _)| *k > 0).map(turn).collect()
}

fn multiply_powers(a: &[(u32, i32)], b: &[(u32, i32)]) -> Vec<(u32, i32)> {
    let mut powers: Powers = a.iter().copied().collect();
    for &(symbol, exponent) in b {
        *powers.entry(symbol).or_insert(0) += exponent;
    }
    powers.into_iter().filter(|(_, exponent)| *exponent != 0).collect()
}

fn add(into: &mut Sum, powers: Vec<(u32, i32)>, series: &Series) {
    let slot = into.entry(powers).or_default();
    for (key, value) in series {
        *slot.entry(*key).or_insert_with(BigRational::zero) += value;
    }
    slot.retain(|_, value| !value.is_zero());
}

fn product(a: &Sum, b: &Sum) -> Sum {
    let mut result = Sum::new();
    for (left, x) in a {
        for (right, y) in b {
            add(&mut result, multiply_powers(left, right), &series_product(x, y));
        }
    }
    result
}

fn motion_sum(motion: &Motion, order: u32, frequency: Symbol) -> Sum {
    let mut result = Sum::new();
    for (monomial, fourier) in motion.terms() {
        let series = (0..order).fold(series_of(fourier), |series, _| series_derivative(&series));
        let powers: Vec<(u32, i32)> = monomial.factors().map(|(symbol, e)| (symbol.0, e)).collect();
        let time = if order == 0 { Vec::new() } else { vec![(frequency.0, order as i32)] };
        add(&mut result, multiply_powers(&powers, &time), &series);
    }
    result
}

/// One entry: equation, harmonic, sine, column, powers, coefficient.
pub(crate) type Row = (usize, usize, bool, Option<usize>, Vec<(u32, i32)>, BigRational);

/// Every non-zero coefficient, sorted.
pub(crate) fn expand(model: &ExactModel, form: &RegressorForm, pattern: &Pattern) -> Vec<Row> {
    let mut rows = Vec::new();
    for (equation, row) in form.rows.iter().enumerate() {
        let mut columns: BTreeMap<Option<usize>, Sum> = BTreeMap::new();
        for term in &row.terms {
            let one: Series = [((0, false), term.coefficient.clone().into())].into();
            let mut value: Sum = [(Vec::new(), one)].into();
            for (&atom, exponent) in term.atoms.factors() {
                let unit: Series = [((0, false), BigRational::one())].into();
                match *model.graph.node(atom) {
                    Node::Derivative(coordinate, order) => {
                        let motion = pattern.motions[coordinate.0 as usize].as_ref().expect("has a motion");
                        let base = motion_sum(motion, order, pattern.frequency);
                        for _ in 0..exponent {
                            value = product(&value, &base);
                        }
                    }
                    Node::Symbol(symbol) => value = product(&value, &[(vec![(symbol.0, exponent)], unit)].into()),
                    Node::Pi => value = product(&value, &[(vec![(u32::MAX, exponent)], unit)].into()),
                    ref other => panic!("not part of the twin: {other:?}"),
                }
            }
            let sum = columns.entry(term.column).or_default();
            for (powers, series) in value {
                add(sum, powers, &series);
            }
        }
        for (column, sum) in columns {
            for (powers, series) in sum {
                rows.extend(
                    series.into_iter().map(|((k, sine), value)| (equation, k, sine, column, powers.clone(), value)),
                );
            }
        }
    }
    rows.sort();
    rows
}
