//! The harmonic coefficient table (Feng, Eqns 3.26, 4.44, B.1, B.2).
//!
//! Invariant: entries are sorted by equation, harmonic, cosine before sine, column and powers; no coefficient is zero,
//! and no two entries agree in all of these.

use crate::algebra::fourier::Trig;
use crate::algebra::polynomial::Monomial;
use crate::budget;
use crate::mechanics::derived::Derived;
use crate::number::numerator::Numerator;
use crate::number::rational::{self, Rational};
use crate::number::words::{big_from_words, unsigned_from_words, write_unsigned};
use ecow::EcoString;
use num_traits::Zero;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Operations for making an entry or adding it to a matrix, for the budget.
const ENTRY: u64 = 300;
/// Operations for writing an entry as text, for the budget.
const TEXT: u64 = 4000;

/// One coefficient: `coefficient * pi^pi * prod symbol^power` multiplies cos or sin of `harmonic * w t` in the factor of
/// one parameter in one equation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Index of the equation.
    pub equation: usize,
    /// The harmonic of the fundamental w.
    pub harmonic: usize,
    /// Cosine or sine.
    pub function: Trig,
    /// Index of the parameter; `None` for a term without unknown parameters.
    pub column: Option<usize>,
    /// The exact rational factor.
    pub coefficient: Rational,
    /// Power of pi: -1 for non-smooth terms, otherwise 0.
    pub pi: i32,
    /// Powers of amplitudes, frequency and run-time constants, by index into [`HarmonicTable::symbols`].
    pub powers: Monomial<usize>,
    /// Odd powers of the signs of amplitudes that flip the entry when the amplitude is negative.
    pub sign: Monomial<usize>,
}

impl Entry {
    /// The key that orders entries.
    #[must_use]
    pub fn key(&self) -> (usize, usize, Trig, Option<usize>, i32, &Monomial<usize>, &Monomial<usize>) {
        (self.equation, self.harmonic, self.function, self.column, self.pi, &self.powers, &self.sign)
    }
}

/// The truncation error of an infinite series in a table: the harmonics above the last one kept. The bounds are
/// multiplied by the magnitude of prod symbol^power.
#[derive(Clone, Debug, PartialEq)]
pub struct Tail {
    /// Index of the equation.
    pub equation: usize,
    /// Index of the parameter; `None` for a term without unknown parameters.
    pub column: Option<usize>,
    /// Powers of amplitudes, frequency and run-time constants, by index into [`HarmonicTable::symbols`].
    pub powers: Monomial<usize>,
    /// The signs of amplitudes that the term carries.
    pub sign: Monomial<usize>,
    /// The highest harmonic kept.
    pub harmonics: usize,
    /// An upper bound of the root mean square of the truncation error over a period.
    pub rms: f64,
    /// An upper bound of the magnitude of the truncation error; `None` when the term jumps, since no number of
    /// harmonics makes the error small there.
    pub maximum: Option<f64>,
}

/// The coefficients of one equation, column and product of powers: a lattice of harmonics, cosines before sines.
#[derive(Clone, Debug)]
pub(crate) struct CoefficientSeries {
    pub(crate) equation: usize,
    pub(crate) column: Option<usize>,
    pub(crate) pi: i32,
    pub(crate) powers: Monomial<usize>,
    /// The signs of amplitudes. They are boxed, since nearly every table has none.
    pub(crate) sign: Option<Box<Monomial<usize>>>,
    /// First of the harmonics first, first + stride, ..., of which there are `len`.
    pub(crate) first: usize,
    pub(crate) stride: usize,
    pub(crate) len: usize,
    pub(crate) cos: bool,
    pub(crate) sin: bool,
    /// Number of words of every coefficient's numerator, in two's complement. Those of its denominator follow.
    pub(crate) numerator_words: usize,
    pub(crate) denominator_words: usize,
    /// Index of the first coefficient in the table's words.
    pub(crate) start: usize,
}

/// Equation, column, power of pi, powers, signs, first harmonic.
type SeriesKey<'a> = (usize, Option<usize>, i32, &'a Monomial<usize>, Option<&'a Monomial<usize>>, usize);

impl CoefficientSeries {
    fn key(&self) -> SeriesKey<'_> {
        (self.equation, self.column, self.pi, &self.powers, self.sign.as_deref(), self.first)
    }

    /// Index of a coefficient in the table's words, whether it is zero or not.
    fn position(&self, harmonic: usize, function: Trig) -> Option<usize> {
        let index = harmonic.checked_sub(self.first)?;
        if !index.is_multiple_of(self.stride) || index / self.stride >= self.len {
            return None;
        }
        let part = match function {
            Trig::Cos if self.cos => 0,
            Trig::Sin if self.sin => usize::from(self.cos),
            _ => return None,
        };
        let index = index / self.stride + part * self.len;
        Some(self.start + index * (self.numerator_words + self.denominator_words))
    }

    /// The smallest harmonic of the lattice above `harmonic`.
    fn next_above(&self, harmonic: usize) -> Option<usize> {
        if harmonic < self.first {
            return (self.len > 0).then_some(self.first);
        }
        let index = (harmonic - self.first) / self.stride + 1;
        (index < self.len).then(|| self.first + self.stride * index)
    }
}

/// The exact table of a model under a pattern.
///
/// Coefficients are stored as words of numerators and denominators in lowest terms, series by series; [`Entry`] values
/// are made on request.
#[derive(Clone, Debug, Default)]
pub struct HarmonicTable {
    /// The model's name.
    pub model: EcoString,
    /// Names of the rows' equations.
    pub equations: Vec<EcoString>,
    /// Names of the columns.
    pub parameters: Vec<EcoString>,
    /// Names of amplitudes, frequency and run-time constants that occur as powers.
    pub symbols: Vec<EcoString>,
    /// The truncation errors, one for every infinite series in the table; empty when the table is complete.
    pub tails: Vec<Tail>,
    /// Constants among the symbols that follow from the model's own, each defined by those before it.
    pub constants: Vec<Derived>,
    /// Sorted by [`CoefficientSeries::key`].
    series: Vec<CoefficientSeries>,
    words: Vec<u64>,
    len: usize,
}

impl PartialEq for HarmonicTable {
    fn eq(&self, other: &Self) -> bool {
        // Equal entries may be stored with different widths.
        (&self.model, &self.equations, &self.parameters, &self.symbols)
            == (&other.model, &other.equations, &other.parameters, &other.symbols)
            && self.len == other.len
            && (&self.tails, &self.constants) == (&other.tails, &other.constants)
            && self.entries().eq(other.entries())
    }
}

impl HarmonicTable {
    /// A table of entries in any order; zero coefficients are left out and equal keys added.
    #[must_use]
    pub fn new(
        model: EcoString,
        equations: Vec<EcoString>,
        parameters: Vec<EcoString>,
        symbols: Vec<EcoString>,
        entries: Vec<Entry>,
    ) -> Self {
        let mut entries = entries;
        fn key(e: &Entry) -> (usize, Option<usize>, i32, &Monomial<usize>, &Monomial<usize>, usize, Trig) {
            (e.equation, e.column, e.pi, &e.powers, &e.sign, e.harmonic, e.function)
        }
        entries.sort_by(|a, b| key(a).cmp(&key(b)));
        let mut merged: Vec<Entry> = Vec::with_capacity(entries.len());
        for entry in entries {
            match merged.last_mut() {
                Some(last) if last.key() == entry.key() => last.coefficient += entry.coefficient,
                _ => merged.push(entry),
            }
        }
        merged.retain(|entry| !entry.coefficient.is_zero());
        // A gap in the harmonics begins a new series, so that storage is bounded by the number of entries.
        let belongs = |a: &Entry, b: &Entry| {
            (a.equation, a.column, a.pi, &a.powers, &a.sign) == (b.equation, b.column, b.pi, &b.powers, &b.sign)
                && b.harmonic - a.harmonic <= 8
        };
        let (mut series, mut words) = (Vec::new(), Vec::new());
        for chunk in merged.chunk_by(belongs) {
            let (Some(head), Some(last)) = (chunk.first(), chunk.last()) else { continue };
            let numerator_words =
                chunk.iter().map(|e| e.coefficient.numer().bits() / 64 + 1).max().unwrap_or(1) as usize;
            let denominator_words = chunk.iter().map(|e| e.coefficient.denom().bits().div_ceil(64)).max().unwrap_or(1);
            let denominator_words = denominator_words as usize;
            let item = CoefficientSeries {
                equation: head.equation,
                column: head.column,
                pi: head.pi,
                powers: head.powers.clone(),
                sign: (!head.sign.is_one()).then(|| Box::new(head.sign.clone())),
                first: head.harmonic,
                stride: 1,
                len: last.harmonic - head.harmonic + 1,
                cos: chunk.iter().any(|e| e.function == Trig::Cos),
                sin: chunk.iter().any(|e| e.function == Trig::Sin),
                numerator_words,
                denominator_words,
                start: words.len(),
            };
            let parts = usize::from(item.cos) + usize::from(item.sin);
            words.resize(words.len() + item.len * parts * (numerator_words + denominator_words), 0);
            for entry in chunk {
                let at = item.position(entry.harmonic, entry.function).expect("invariant: inside the series");
                let slot = &mut words[at..at + numerator_words + denominator_words];
                let (numerator, denominator) = slot.split_at_mut(numerator_words);
                entry.coefficient.numer().write_words(numerator);
                write_unsigned(entry.coefficient.denom().magnitude(), denominator);
            }
            series.push(item);
        }
        Self::from_series(model, [equations, parameters, symbols], series, words, merged.len())
    }

    /// The table of finished series in any order, with `len` non-zero coefficients in all.
    pub(crate) fn from_series(
        model: EcoString,
        [equations, parameters, symbols]: [Vec<EcoString>; 3],
        mut series: Vec<CoefficientSeries>,
        words: Vec<u64>,
        len: usize,
    ) -> Self {
        if !series.is_sorted_by(|a, b| a.key() < b.key()) {
            series.sort_by(|a, b| a.key().cmp(&b.key()));
        }
        Self { model, equations, parameters, symbols, tails: Vec::new(), constants: Vec::new(), series, words, len }
    }

    /// The table with further entries, and with bounds of the truncation errors of these.
    #[must_use]
    pub(crate) fn with_infinite(self, entries: Vec<Entry>, tails: Vec<Tail>) -> Self {
        let all = self.entries().chain(entries).collect();
        let table = Self::new(self.model, self.equations, self.parameters, self.symbols, all);
        Self { tails, constants: self.constants, ..table }
    }

    /// The number of entries.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no entry.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Charges the budget for writing all entries as text, which takes longer than expanding them and more memory than
    /// the table.
    ///
    /// Ends the current run of the engine where the limit is exceeded ([`budget`]).
    pub fn announce_text(&self) {
        budget::charge(TEXT * self.len as u64);
    }

    /// The entries, sorted by equation, harmonic, cosine before sine, column and powers.
    #[must_use]
    pub fn entries(&self) -> Entries<'_> {
        Entries { table: self, left: self.len, positions: Positions::new(self) }
    }

    /// The entries of one equation, harmonic, function and column, which differ in their powers.
    pub fn at(
        &self,
        equation: usize,
        harmonic: usize,
        function: Trig,
        column: Option<usize>,
    ) -> impl Iterator<Item = Entry> {
        let start = self.series.partition_point(|s| (s.equation, s.column) < (equation, column));
        let series = self.series[start..].iter().take_while(move |s| (s.equation, s.column) == (equation, column));
        series.filter_map(move |series| {
            let at = series.position(harmonic, function)?;
            (!self.is_zero(series, at)).then(|| self.entry(series, harmonic, function, at))
        })
    }

    fn is_zero(&self, series: &CoefficientSeries, at: usize) -> bool {
        self.words[at..at + series.numerator_words].iter().all(|&word| word == 0)
    }

    fn entry(&self, series: &CoefficientSeries, harmonic: usize, function: Trig, at: usize) -> Entry {
        let (numerator, rest) = self.words[at..].split_at(series.numerator_words);
        let denominator = unsigned_from_words(&rest[..series.denominator_words]);
        Entry {
            equation: series.equation,
            harmonic,
            function,
            column: series.column,
            coefficient: Rational::from_lowest_terms(big_from_words(numerator), denominator.into()),
            pi: series.pi,
            powers: series.powers.clone(),
            sign: series.sign.as_deref().cloned().unwrap_or_default(),
        }
    }

    /// The rows (equation, harmonic, function) that have a non-zero entry, sorted.
    #[must_use]
    pub fn rows(&self) -> Vec<(usize, usize, Trig)> {
        let mut rows: Vec<_> = Positions::new(self)
            .filter(|(series, .., at)| !self.is_zero(series, *at))
            .map(|(series, harmonic, function, _)| (series.equation, harmonic, function))
            .collect();
        rows.dedup();
        rows
    }

    /// The highest harmonic of an equation, 0 when it has none.
    #[must_use]
    pub fn highest_harmonic(&self, equation: usize) -> usize {
        let of_equation = self.series.iter().filter(|series| series.equation == equation);
        let highest = of_equation.filter_map(|series| {
            let used = |harmonic: usize| {
                [Trig::Cos, Trig::Sin]
                    .into_iter()
                    .any(|function| series.position(harmonic, function).is_some_and(|at| !self.is_zero(series, at)))
            };
            (0..series.len).rev().map(|i| series.first + series.stride * i).find(|&harmonic| used(harmonic))
        });
        highest.max().unwrap_or(0)
    }

    /// The value of one entry in double precision, given the symbols.
    #[must_use]
    pub fn evaluate(&self, entry: &Entry, symbols: &[f64]) -> f64 {
        let mut value = rational::to_f64(&entry.coefficient) * std::f64::consts::PI.powi(entry.pi);
        for (&symbol, power) in entry.powers.factors() {
            value *= symbols[symbol].powi(power);
        }
        for (&symbol, power) in entry.sign.factors() {
            if power % 2 != 0 {
                value *= symbols[symbol].signum();
            }
        }
        value
    }
}

/// Iterator over the entries of a table, in sorted order; each entry is made when it is reached.
#[derive(Clone, Debug)]
pub struct Entries<'a> {
    table: &'a HarmonicTable,
    left: usize,
    positions: Positions<'a>,
}

impl Iterator for Entries<'_> {
    type Item = Entry;

    fn next(&mut self) -> Option<Entry> {
        let table = self.table;
        let (series, harmonic, function, at) =
            self.positions.by_ref().find(|(series, .., at)| !table.is_zero(series, *at))?;
        self.left -= 1;
        budget::charge(ENTRY);
        Some(table.entry(series, harmonic, function, at))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.left, Some(self.left))
    }
}

impl ExactSizeIterator for Entries<'_> {}

/// Every stored coefficient, zero or not, in the order of the entries.
#[derive(Clone, Debug)]
struct Positions<'a> {
    /// The series of the current equation and of those after it.
    block: &'a [CoefficientSeries],
    rest: &'a [CoefficientSeries],
    harmonic: usize,
    function: Trig,
    /// Index of the next series in the block.
    index: usize,
}

impl<'a> Positions<'a> {
    fn new(table: &'a HarmonicTable) -> Self {
        let mut positions = Self { block: &[], rest: &table.series, harmonic: 0, function: Trig::Cos, index: 0 };
        positions.next_block();
        positions
    }

    fn next_block(&mut self) {
        let equation = self.rest.first().map(|series| series.equation);
        let end = self.rest.partition_point(|series| Some(series.equation) <= equation);
        (self.block, self.rest) = self.rest.split_at(end);
        (self.function, self.index) = (Trig::Cos, 0);
        self.harmonic = self.block.iter().filter(|series| series.len > 0).map(|series| series.first).min().unwrap_or(0);
    }
}

impl<'a> Iterator for Positions<'a> {
    type Item = (&'a CoefficientSeries, usize, Trig, usize);

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            while let Some(series) = self.block.get(self.index) {
                self.index += 1;
                if let Some(at) = series.position(self.harmonic, self.function) {
                    return Some((series, self.harmonic, self.function, at));
                }
            }
            self.index = 0;
            if self.function == Trig::Cos {
                self.function = Trig::Sin;
            } else if let Some(next) = self.block.iter().filter_map(|series| series.next_above(self.harmonic)).min() {
                (self.harmonic, self.function) = (next, Trig::Cos);
            } else if self.rest.is_empty() {
                self.block = &[];
                return None;
            } else {
                self.next_block();
            }
        }
    }
}

/// The name of the JSON schema, which is part of the contract.
pub const SCHEMA: &str = "tpm.table/1";

#[derive(Serialize, Deserialize)]
struct JsonTable {
    schema: String,
    model: EcoString,
    parameters: Vec<EcoString>,
    entries: Vec<JsonEntry>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    tails: Vec<JsonTail>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    constants: Vec<Derived>,
}

#[derive(Serialize, Deserialize)]
struct JsonTail {
    equation: EcoString,
    parameter: Option<EcoString>,
    #[serde(default)]
    powers: BTreeMap<EcoString, i32>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    sign: BTreeMap<EcoString, i32>,
    harmonics: usize,
    rms: f64,
    maximum: Option<f64>,
}

#[derive(Serialize, Deserialize)]
struct JsonEntry {
    equation: EcoString,
    harmonic: usize,
    function: Trig,
    parameter: Option<EcoString>,
    coefficient: String,
    #[serde(default)]
    pi: i32,
    #[serde(default)]
    powers: BTreeMap<EcoString, i32>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    sign: BTreeMap<EcoString, i32>,
}

impl Serialize for HarmonicTable {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.announce_text();
        let named = |monomial: &Monomial<usize>| -> BTreeMap<EcoString, i32> {
            monomial.factors().map(|(&symbol, power)| (self.symbols[symbol].clone(), power)).collect()
        };
        let entries = self.entries().map(|entry| JsonEntry {
            equation: self.equations[entry.equation].clone(),
            harmonic: entry.harmonic,
            function: entry.function,
            parameter: entry.column.map(|column| self.parameters[column].clone()),
            coefficient: rational::display(&entry.coefficient),
            pi: entry.pi,
            powers: named(&entry.powers),
            sign: named(&entry.sign),
        });
        let tails = self.tails.iter().map(|tail| JsonTail {
            equation: self.equations[tail.equation].clone(),
            parameter: tail.column.map(|column| self.parameters[column].clone()),
            powers: named(&tail.powers),
            sign: named(&tail.sign),
            harmonics: tail.harmonics,
            rms: tail.rms,
            maximum: tail.maximum,
        });
        JsonTable {
            schema: SCHEMA.to_owned(),
            model: self.model.clone(),
            parameters: self.parameters.clone(),
            entries: entries.collect(),
            tails: tails.collect(),
            constants: self.constants.clone(),
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for HarmonicTable {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        fn index(names: &mut Vec<EcoString>, name: &str) -> usize {
            names.iter().position(|present| present == name).unwrap_or_else(|| {
                names.push(name.into());
                names.len() - 1
            })
        }
        let json = JsonTable::deserialize(deserializer)?;
        if json.schema != SCHEMA {
            return Err(D::Error::custom(format!("schema {:?} is not {SCHEMA:?}", json.schema)));
        }
        let (mut equations, mut symbols) = (Vec::new(), Vec::new());
        let mut entries = Vec::with_capacity(json.entries.len());
        let column_of = |parameter: &Option<EcoString>| -> Result<Option<usize>, D::Error> {
            let column = parameter.as_ref().map(|name| {
                let found = json.parameters.iter().position(|parameter| parameter == name);
                found.ok_or_else(|| D::Error::custom(format!("parameter {name:?} is not listed")))
            });
            column.transpose()
        };
        for entry in json.entries {
            let coefficient = rational::parse(&entry.coefficient).ok_or_else(|| {
                D::Error::custom(format!("coefficient {:?} is not a rational number", entry.coefficient))
            })?;
            entries.push(Entry {
                equation: index(&mut equations, &entry.equation),
                harmonic: entry.harmonic,
                function: entry.function,
                column: column_of(&entry.parameter)?,
                coefficient,
                pi: entry.pi,
                powers: entry.powers.iter().map(|(name, &power)| (index(&mut symbols, name), power)).collect(),
                sign: entry.sign.iter().map(|(name, &power)| (index(&mut symbols, name), power)).collect(),
            });
        }
        let mut tails = Vec::with_capacity(json.tails.len());
        for tail in json.tails {
            tails.push(Tail {
                equation: index(&mut equations, &tail.equation),
                column: column_of(&tail.parameter)?,
                powers: tail.powers.iter().map(|(name, &power)| (index(&mut symbols, name), power)).collect(),
                sign: tail.sign.iter().map(|(name, &power)| (index(&mut symbols, name), power)).collect(),
                harmonics: tail.harmonics,
                rms: tail.rms,
                maximum: tail.maximum,
            });
        }
        let mut table = Self::new(json.model, equations, json.parameters, symbols, entries);
        table.tails = tails;
        table.constants = json.constants;
        Ok(table)
    }
}
