//! The harmonic coefficient table (Feng, Eqns 3.26, 4.44, B.1, B.2).
//!
//! Invariant: entries are sorted by equation, harmonic, cosine before sine, column and powers; no coefficient is zero,
//! and no two entries agree in all of these.

use crate::fourier::Trig;
use crate::polynomial::Monomial;
use crate::rational::{self, Rational};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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

/// The exact table of a model under a pattern.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HarmonicTable {
    /// The model's name.
    pub model: String,
    /// Names of the rows' equations.
    pub equations: Vec<String>,
    /// Names of the columns.
    pub parameters: Vec<String>,
    /// Names of amplitudes, frequency and run-time constants that occur as powers.
    pub symbols: Vec<String>,
    entries: Vec<Entry>,
}

impl HarmonicTable {
    /// A table of entries in any order; zero coefficients are left out and equal keys added.
    #[must_use]
    pub fn new(
        model: String,
        equations: Vec<String>,
        parameters: Vec<String>,
        symbols: Vec<String>,
        entries: Vec<Entry>,
    ) -> Self {
        let mut entries = entries;
        entries.sort_by(|a, b| a.key().cmp(&b.key()));
        let mut merged: Vec<Entry> = Vec::with_capacity(entries.len());
        for entry in entries {
            match merged.last_mut() {
                Some(last) if last.key() == entry.key() => last.coefficient += entry.coefficient,
                _ => merged.push(entry),
            }
        }
        merged.retain(|entry| !num_traits::Zero::is_zero(&entry.coefficient));
        Self { model, equations, parameters, symbols, entries: merged }
    }

    /// The entries, sorted.
    pub fn entries(&self) -> impl ExactSizeIterator<Item = &Entry> {
        self.entries.iter()
    }

    /// The entry values of one equation, harmonic, function and column: powers and coefficient.
    pub fn at(
        &self,
        equation: usize,
        harmonic: usize,
        function: Trig,
        column: Option<usize>,
    ) -> impl Iterator<Item = &Entry> {
        self.entries.iter().filter(move |entry| {
            (entry.equation, entry.harmonic, entry.function, entry.column) == (equation, harmonic, function, column)
        })
    }

    /// The rows (equation, harmonic, function) that have a non-zero entry, sorted.
    #[must_use]
    pub fn rows(&self) -> Vec<(usize, usize, Trig)> {
        let mut rows: Vec<_> =
            self.entries.iter().map(|entry| (entry.equation, entry.harmonic, entry.function)).collect();
        rows.dedup();
        rows
    }

    /// The highest harmonic of an equation, 0 when it has none.
    #[must_use]
    pub fn highest_harmonic(&self, equation: usize) -> usize {
        self.entries.iter().filter(|entry| entry.equation == equation).map(|entry| entry.harmonic).max().unwrap_or(0)
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

/// The name of the JSON schema, which is part of the contract.
pub const SCHEMA: &str = "tpm.table/1";

#[derive(Serialize, Deserialize)]
struct JsonTable {
    schema: String,
    model: String,
    parameters: Vec<String>,
    entries: Vec<JsonEntry>,
}

#[derive(Serialize, Deserialize)]
struct JsonEntry {
    equation: String,
    harmonic: usize,
    function: Trig,
    parameter: Option<String>,
    coefficient: String,
    #[serde(default)]
    pi: i32,
    #[serde(default)]
    powers: BTreeMap<String, i32>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    sign: BTreeMap<String, i32>,
}

impl Serialize for HarmonicTable {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let named = |monomial: &Monomial<usize>| -> BTreeMap<String, i32> {
            monomial.factors().map(|(&symbol, power)| (self.symbols[symbol].clone(), power)).collect()
        };
        let entries = self.entries.iter().map(|entry| JsonEntry {
            equation: self.equations[entry.equation].clone(),
            harmonic: entry.harmonic,
            function: entry.function,
            parameter: entry.column.map(|column| self.parameters[column].clone()),
            coefficient: rational::display(&entry.coefficient),
            pi: entry.pi,
            powers: named(&entry.powers),
            sign: named(&entry.sign),
        });
        JsonTable {
            schema: SCHEMA.to_owned(),
            model: self.model.clone(),
            parameters: self.parameters.clone(),
            entries: entries.collect(),
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for HarmonicTable {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        fn index(names: &mut Vec<String>, name: &str) -> usize {
            names.iter().position(|present| present == name).unwrap_or_else(|| {
                names.push(name.to_owned());
                names.len() - 1
            })
        }
        let json = JsonTable::deserialize(deserializer)?;
        if json.schema != SCHEMA {
            return Err(D::Error::custom(format!("schema {:?} is not {SCHEMA:?}", json.schema)));
        }
        let (mut equations, mut symbols) = (Vec::new(), Vec::new());
        let mut entries = Vec::with_capacity(json.entries.len());
        for entry in json.entries {
            let column = entry.parameter.as_ref().map(|name| {
                let found = json.parameters.iter().position(|parameter| parameter == name);
                found.ok_or_else(|| D::Error::custom(format!("parameter {name:?} is not listed")))
            });
            let coefficient = rational::parse(&entry.coefficient).ok_or_else(|| {
                D::Error::custom(format!("coefficient {:?} is not a rational number", entry.coefficient))
            })?;
            entries.push(Entry {
                equation: index(&mut equations, &entry.equation),
                harmonic: entry.harmonic,
                function: entry.function,
                column: column.transpose()?,
                coefficient,
                pi: entry.pi,
                powers: entry.powers.iter().map(|(name, &power)| (index(&mut symbols, name), power)).collect(),
                sign: entry.sign.iter().map(|(name, &power)| (index(&mut symbols, name), power)).collect(),
            });
        }
        Ok(Self::new(json.model, equations, json.parameters, symbols, entries))
    }
}
