//! The two parts of every input of a model: what holds its own coordinate still, and what moves it, with the harmonics of both.

use crate::series::{NoSeries, Nodes, PeriodicMotion, Series, Wave};
use serde::Serialize;
use std::fmt;
use tpm_codegen::emit::table;
use tpm_report::{Align, TextTable, number};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::plan::split::Split;
use tpm_symbolic::regressor::form::Row;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::Prepared;

/// Harmonics of a part below this share of its largest one are what rounding leaves of zero.
const ROUNDING: f64 = 1e-12;

/// The parts of all inputs. They are displayed as a text, and serialised as `tpm.split/1`.
#[derive(Debug, Serialize)]
pub struct InputParts {
    schema: &'static str,
    model: String,
    inputs: Vec<Parts>,
    table: Option<HarmonicTable>,
    waves: Option<Vec<Lines>>,
    /// The highest harmonic of the waves.
    #[serde(skip)]
    harmonics: usize,
}

/// The parts of one input.
#[derive(Debug, Serialize)]
struct Parts {
    input: String,
    /// The coordinates that it drives.
    drives: Vec<String>,
    independent: String,
    dependent: String,
}

/// Harmonics of a part in numbers.
#[derive(Debug, Serialize)]
struct Lines {
    part: String,
    harmonics: Vec<Line>,
    /// Largest sum of what higher harmonics add.
    left_out: f64,
}

#[derive(Debug, Serialize)]
struct Line {
    harmonic: usize,
    cos: f64,
    sin: f64,
}

impl InputParts {
    /// The parts as expressions, with the exact table of their harmonics where there is one.
    #[must_use]
    pub fn new(split: &mut Split, table: Option<HarmonicTable>) -> Self {
        let mut inputs = Vec::new();
        for input in split.inputs.clone() {
            let [independent, dependent] = [&input.independent, &input.dependent].map(|part| {
                let expr = split.expression(part);
                split.model.display(expr)
            });
            let coordinates = &split.model.coordinates;
            inputs.push(Parts {
                input: split.model.quantity(input.input).name.to_string(),
                drives: input.motions.iter().map(|c| coordinates[c.0 as usize].name.clone()).collect(),
                independent,
                dependent,
            });
        }
        let model = split.model.name.to_string();
        Self { schema: "tpm.split/1", model, inputs, table, waves: None, harmonics: 0 }
    }

    /// Adds harmonics in numbers, up to the highest one given; `parts` has the names of their equations.
    #[must_use]
    pub fn with_waves(mut self, parts: &Prepared, waves: &[NumericPart], harmonics: usize) -> Self {
        let wave = |part: &NumericPart| Lines {
            part: parts.form.rows[part.equation].name.to_string(),
            harmonics: lines(part),
            left_out: part.tail,
        };
        (self.waves, self.harmonics) = (Some(waves.iter().map(wave).collect()), harmonics);
        self
    }
}

/// One part of one input along a motion, in numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct NumericPart {
    /// Index of the part's equation in the model of [`Split::parts`].
    pub equation: usize,
    /// The harmonics of the part.
    pub wave: Wave,
    /// An upper bound of the magnitude of the harmonics beyond.
    pub tail: f64,
}

/// The harmonics of every part up to a stated one, sines and cosines of the motion by their Jacobi-Anger series. `parts` is
/// the model of [`Split::parts`], prepared; `value` gives parameters, run-time constants, amplitudes and the frequency.
///
/// # Errors
/// [`NoSeries`], with the source term, when a term has other functions of the motion.
pub fn numeric_parts(
    parts: &Prepared,
    pattern: &Pattern,
    harmonics: usize,
    value: impl Fn(Symbol) -> f64,
) -> Result<Vec<NumericPart>, NoSeries> {
    let coordinates = pattern.motions.iter().map(|motion| motion.as_ref().map(|motion| Wave::of(motion, &value)));
    let motion = PeriodicMotion { frequency: value(pattern.frequency), coordinates: coordinates.collect() };
    let factors = ParameterMap::new(parts).evaluate(&value);
    let mut nodes = Nodes::new(&parts.model, &motion, &value);
    let part = |(equation, row): (usize, &Row)| {
        let mut sum = Series::number(0.0);
        for terms in row.terms.chunk_by(|a, b| a.column == b.column) {
            let column = terms.first().and_then(|term| term.column);
            sum = sum.plus(&nodes.sum(terms)?.scaled(column.map_or(1.0, |column| factors[column])));
        }
        let (wave, tail) = sum.up_to(harmonics);
        Ok(NumericPart { equation, wave, tail })
    };
    parts.form.rows.iter().enumerate().map(part).collect()
}

/// The harmonics of a part that are larger than rounding errors.
fn lines(part: &NumericPart) -> Vec<Line> {
    let at = |list: &[f64], k: usize| list.get(k).copied().unwrap_or(0.0);
    let count = part.wave.cos.len().max(part.wave.sin.len());
    let all = (0..count).map(|k| (k, at(&part.wave.cos, k), at(&part.wave.sin, k)));
    let largest = all.clone().map(|(_, c, s)| c.hypot(s)).fold(0.0, f64::max);
    let rounded = |value: f64| if value.abs() > ROUNDING * largest { value } else { 0.0 };
    all.map(|(harmonic, c, s)| Line { harmonic, cos: rounded(c), sin: rounded(s) })
        .filter(|line| line.cos.hypot(line.sin) > 0.0)
        .collect()
}

impl fmt::Display for InputParts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: the two parts of every input", self.model)?;
        for parts in &self.inputs {
            writeln!(f, "\n{} drives {}", parts.input, parts.drives.join(", "))?;
            for (label, part) in [("independent", &parts.independent), ("dependent", &parts.dependent)] {
                writeln!(f, "  {:<18}  {part}", format!("motion-{label}"))?;
            }
        }
        if let Some(table) = &self.table {
            write!(f, "\n{}", table::markdown(table))?;
        }
        let Some(waves) = &self.waves else { return Ok(()) };
        writeln!(f, "\nharmonics up to {}\n", self.harmonics)?;
        let mut table = TextTable::new(&[
            ("part", Align::Left),
            ("harmonic", Align::Right),
            ("cos", Align::Right),
            ("sin", Align::Right),
            ("amplitude", Align::Right),
        ]);
        for wave in waves {
            for Line { harmonic, cos, sin } in &wave.harmonics {
                table.row(&[
                    wave.part.clone(),
                    harmonic.to_string(),
                    number(*cos),
                    number(*sin),
                    number(cos.hypot(*sin)),
                ]);
            }
        }
        f.write_str(&table.finish())?;
        for wave in waves.iter().filter(|wave| wave.left_out > 0.0) {
            writeln!(f, "higher harmonics of {} add at most {}", wave.part, number(wave.left_out))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{InputParts, numeric_parts};
    use tpm_session::DeclaredModel;
    use tpm_symbolic::plan::split::split;
    use tpm_symbolic::regressor::prepare::prepare;

    #[test]
    fn what_higher_harmonics_add_is_said_of_infinite_series_alone() {
        let text = include_str!("../../../../models/cart_pendulum.tpm");
        let model = DeclaredModel::parse("cart_pendulum.tpm", text).expect("a model");
        let mut found = split(&model.parsed().model, &[]).expect("parts");
        let parts = prepare(found.parts().expect("no coordinate is eliminated")).expect("linear");
        let pattern = model.pattern(None).expect("a pattern");
        let waves = numeric_parts(&parts, pattern, 15, |_| 0.5).expect("sines and cosines");
        let said = InputParts::new(&mut found, None).with_waves(&parts, &waves, 15).to_string();
        let names = |line: &str| line.strip_prefix("higher harmonics of ")?.split(' ').next().map(str::to_owned);
        assert_eq!(said.lines().filter_map(names).collect::<Vec<_>>(), ["F_independent", "tau_independent"], "{said}");
    }
}
