//! Detection of zero and proportional entries without multiplying out.
//!
//! The *trace* of an entry consists of its values at a few points drawn at random modulo a prime of 61 bits. An entry
//! with a nonzero trace is not zero. A nonzero entry of degree d has a zero trace with a probability of at most (d /
//! 2^60)^3 (Schwartz and Zippel), which for d = 10^6 is below 10^-36. Proportional entries have proportional traces,
//! and the converse fails with no higher probability. The ratio of proportional entries is computed exactly at a
//! rational point.

use crate::algebra::field::{Field, Rationals, Residues};
use crate::expr::graph::{ExprId, Graph};
use crate::expr::point::{Drawn, Draws, Points};
use crate::number::rational::Rational;
use crate::regressor::collect::{CollectedRow, CollectedTerm, ParameterMonomial};
use num_traits::Zero;
use rustc_hash::FxHashMap;
use std::collections::BTreeMap;

/// The number of points of a trace.
const POINTS: usize = 3;

/// Most draws that may fail because a denominator vanishes.
const FAILURES: u64 = 20;

/// The values of one entry.
type Trace = [u64; POINTS];

/// The traces of a parameter monomial's entries, by row, divided by the first nonzero value: equal for proportional
/// columns.
pub(crate) type Direction = Vec<(usize, Trace)>;

/// The traces of all entries.
pub(crate) struct Traces<'g> {
    graph: &'g Graph,
    /// For each row, the traces of its parameter monomials in the order of the row; empty where the equations have a
    /// division by zero.
    rows: Vec<Vec<Trace>>,
}

/// The terms of a row, one entry after the other.
fn entries(row: &CollectedRow) -> impl Iterator<Item = &[CollectedTerm]> {
    row.terms.chunk_by(|a, b| a.parameters == b.parameters)
}

fn value<F: Field>(field: &F, atoms: &FxHashMap<ExprId, F::Element>, entry: &[CollectedTerm]) -> Option<F::Element> {
    entry.iter().try_fold(field.zero(), |sum, term| {
        let mut product = field.number(&term.coefficient)?;
        for (atom, exponent) in term.motion.factors() {
            product = field.mul(&product, &field.power(&atoms[atom], exponent)?);
        }
        Some(field.add(&sum, &product))
    })
}

/// Draws of a point. Each is stored and returned again on later requests. Signs are drawn among all elements of the
/// field, since two drawn among a few points could agree by chance.
fn drawn<F: Field>(field: &F, number: u64) -> impl FnMut(Drawn) -> Option<F::Element> {
    let mut draws = Draws::new(number);
    let mut known: FxHashMap<Drawn, F::Element> = FxHashMap::default();
    move |drawn| Some(known.entry(drawn).or_insert_with(|| field.element(draws.word())).clone())
}

impl<'g> Traces<'g> {
    pub(crate) fn new(graph: &'g Graph, rows: &[CollectedRow]) -> Self {
        let motions = rows.iter().flat_map(|row| &row.terms).flat_map(|term| term.motion.factors());
        let mut atoms: Vec<ExprId> = motions.map(|(&atom, _)| atom).collect();
        atoms.sort_unstable();
        atoms.dedup();
        let points = Points::new(graph, &atoms);
        let field = Residues::new(Residues::PRIMES[0]);
        let mut traces: Vec<Vec<Trace>> = rows.iter().map(|row| vec![[0; POINTS]; entries(row).count()]).collect();
        let mut found = 0;
        for number in 0..POINTS as u64 + FAILURES {
            let Some(values) = points.evaluate(&field, drawn(&field, number)) else { continue };
            let values: FxHashMap<ExprId, u64> = atoms.iter().copied().zip(values).collect();
            let of_row = |row: &CollectedRow| entries(row).map(|entry| value(&field, &values, entry)).collect();
            let Some(rows) = rows.iter().map(of_row).collect::<Option<Vec<Vec<u64>>>>() else { continue };
            for (trace, value) in traces.iter_mut().flatten().zip(rows.into_iter().flatten()) {
                trace[found] = value;
            }
            found += 1;
            if found == POINTS {
                return Self { graph, rows: traces };
            }
        }
        Self { graph, rows: Vec::new() }
    }

    /// Drops the entries that vanish.
    pub(crate) fn drop_zeros(&mut self, rows: &mut [CollectedRow]) {
        for (row, traces) in rows.iter_mut().zip(&mut self.rows) {
            let mut kept = traces.iter().map(|trace| *trace != [0; POINTS]);
            let mut keep: Vec<bool> = Vec::with_capacity(row.terms.len());
            for entry in row.terms.chunk_by(|a, b| a.parameters == b.parameters) {
                let kept = kept.next().unwrap_or(true);
                keep.extend(entry.iter().map(|_| kept));
            }
            let mut keep = keep.into_iter();
            row.terms.retain(|_| keep.next().unwrap_or(true));
            traces.retain(|trace| *trace != [0; POINTS]);
        }
    }

    /// The direction of every parameter monomial's column; empty where there are no traces.
    pub(crate) fn directions<'r>(&self, rows: &'r [CollectedRow]) -> BTreeMap<&'r ParameterMonomial, Direction> {
        let mut columns: BTreeMap<&ParameterMonomial, Direction> = BTreeMap::new();
        for (r, (row, traces)) in rows.iter().zip(&self.rows).enumerate() {
            for (entry, trace) in entries(row).zip(traces) {
                columns.entry(&entry[0].parameters).or_default().push((r, *trace));
            }
        }
        let field = Residues::new(Residues::PRIMES[0]);
        for column in columns.values_mut() {
            let first = column.iter().flat_map(|(_, trace)| trace).find(|value| **value != 0);
            let Some(inverse) = first.and_then(|first| field.inverse(first)) else { continue };
            column.iter_mut().flat_map(|(_, trace)| trace).for_each(|value| *value = field.mul(value, &inverse));
        }
        columns
    }

    /// The exact ratio of the entries of two proportional columns in a row.
    pub(crate) fn ratio(&self, row: &CollectedRow, of: &ParameterMonomial, to: &ParameterMonomial) -> Option<Rational> {
        let entry = |parameters: &ParameterMonomial| entries(row).find(|entry| entry[0].parameters == *parameters);
        let (of, to) = (entry(of)?, entry(to)?);
        let mut own: Vec<ExprId> =
            of.iter().chain(to).flat_map(|term| term.motion.factors().map(|(&atom, _)| atom)).collect();
        own.sort_unstable();
        own.dedup();
        let points = Points::new(self.graph, &own);
        (0..FAILURES).find_map(|number| {
            let values = points.evaluate(&Rationals, drawn(&Rationals, number))?;
            let values: FxHashMap<ExprId, Rational> = own.iter().copied().zip(values).collect();
            let (of, to) = (value(&Rationals, &values, of)?, value(&Rationals, &values, to)?);
            (!of.is_zero() && !to.is_zero()).then(|| of / to)
        })
    }
}
