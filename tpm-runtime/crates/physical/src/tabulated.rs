//! The exact harmonic tables of a model's source, evaluated along references.
//!
//! Invariant: a table is used only along the motion for which it was made. The trajectory of a reference is compared
//! with that of the pattern at the same amplitudes and frequency. Any other reference (coordinates that the pattern
//! leaves open, multiples of the frequency) has no table.

use num_complex::Complex;
use tpm_controller::model::{Dims, Model};
use tpm_estimate::{LineTable, RowLines};
use tpm_motion::trajectory::{ReferencePattern, Trajectory};
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::regressor::prepare::Prepared;

/// The exact harmonic tables of a model under those of its patterns for which they exist.
#[derive(Clone, Debug)]
pub struct PatternTables {
    dims: Dims,
    tables: Vec<Tabulated>,
}

/// The table of one pattern.
#[derive(Clone, Debug)]
struct Tabulated {
    pattern: ReferencePattern,
    table: HarmonicTable,
    /// Source of the value of each symbol of the table; nothing for symbols without a value in a run, such as the
    /// unknown parameters.
    symbols: Vec<Option<Source>>,
}

/// Source of a symbol's value.
#[derive(Clone, Copy, Debug)]
enum Source {
    Amplitude(usize),
    Frequency,
    Constant(usize),
}

impl PatternTables {
    /// Expands a model under the patterns that are played: `played` and its alternatives. `model` is made of
    /// `prepared`. A pattern under which the model is no finite Fourier series, or whose table is too large, has no
    /// table.
    #[must_use]
    pub fn new(prepared: &Prepared, model: &dyn Model<f64>, played: &ReferencePattern) -> Self {
        let tables = prepared.model.patterns.iter().filter_map(|symbolic| {
            let mut patterns = core::iter::once(played).chain(&played.others);
            let pattern = patterns.find(|pattern| pattern.name.as_deref() == symbolic.name.as_deref())?;
            if !pattern.open().is_empty() {
                return None;
            }
            let table = expand(&prepared.model, &prepared.form, symbolic).ok()?;
            Tabulated::new(pattern, table, model)
        });
        PatternTables { dims: model.dims(), tables: tables.collect() }
    }
}

impl LineTable for PatternTables {
    fn lines(
        &self,
        reference: &Trajectory,
        amplitudes: &[f64],
        constants: &[f64],
        harmonics: usize,
    ) -> Option<RowLines> {
        let table = self.tables.iter().find(|table| table.is_along(reference, amplitudes))?;
        table.lines(self.dims, reference.frequency, amplitudes, constants, harmonics)
    }
}

impl Tabulated {
    /// The table of one pattern; nothing for a table that leaves harmonics out.
    fn new(pattern: &ReferencePattern, table: HarmonicTable, model: &dyn Model<f64>) -> Option<Self> {
        if !table.tails.is_empty() {
            return None;
        }
        let source = |name: &str| {
            if *name == *pattern.frequency {
                return Some(Source::Frequency);
            }
            let amplitude = pattern.amplitudes.iter().position(|amplitude| *amplitude == *name);
            let constant = || (0..model.dims().constants).position(|i| model.constant(i).name == name);
            amplitude.map(Source::Amplitude).or_else(|| constant().map(Source::Constant))
        };
        let symbols = table.symbols.iter().map(|name| source(name)).collect();
        Some(Tabulated { pattern: ReferencePattern { others: Vec::new(), ..pattern.clone() }, table, symbols })
    }

    fn is_along(&self, reference: &Trajectory, amplitudes: &[f64]) -> bool {
        amplitudes.len() == self.pattern.amplitudes.len()
            && self.pattern.trajectory(amplitudes, reference.frequency) == *reference
    }

    /// The phasors of the regressor along a reference; nothing when a coefficient is not finite, or needs a symbol
    /// without a value.
    fn lines(
        &self,
        dims: Dims,
        frequency: f64,
        amplitudes: &[f64],
        constants: &[f64],
        harmonics: usize,
    ) -> Option<RowLines> {
        let value = |source: Source| match source {
            Source::Amplitude(i) => amplitudes.get(i).copied(),
            Source::Frequency => Some(frequency),
            Source::Constant(i) => constants.get(i).copied(),
        };
        // A product with a missing value is not a number, which is refused below.
        let symbols: Vec<f64> = self.symbols.iter().map(|source| source.and_then(value).unwrap_or(f64::NAN)).collect();
        let none = vec![Complex::new(0.0, 0.0); harmonics + 1];
        let mut regressors = vec![none.clone(); dims.regressor_len()];
        let mut known = vec![none; dims.rows];
        for entry in self.table.entries().filter(|entry| entry.harmonic <= harmonics) {
            let value = self.table.evaluate(&entry, &symbols);
            if !value.is_finite() {
                return None;
            }
            let lines = match entry.column {
                Some(column) => &mut regressors[entry.equation * dims.parameters + column],
                None => &mut known[entry.equation],
            };
            match entry.function {
                Trig::Cos => lines[entry.harmonic].re += value,
                Trig::Sin => lines[entry.harmonic].im -= value,
            }
        }
        Some(RowLines { regressors, known })
    }
}
