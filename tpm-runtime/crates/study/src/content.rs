//! Harmonics of the regressor's columns along a trajectory. They show which harmonics depend on which parameter.

use crate::report::ShowingHarmonic;
use crate::series::{Nodes, PeriodicMotion, Wave};
use tpm_controller::model::Model;
use tpm_motion::trajectory::{HarmonicSeries, Trajectory};
use tpm_symbolic::regressor::prepare::Prepared;

/// The harmonics of one entry of the regressor.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct EntryContent {
    /// Index of the row.
    pub(super) row: usize,
    /// Index of the column.
    pub(super) column: usize,
    /// Cosine and sine coefficients, unit of the entry.
    pub(super) wave: Wave,
    /// A bound of the error of every coefficient, and of every harmonic's amplitude.
    pub(super) error: f64,
}

impl EntryContent {
    /// The amplitude of a harmonic, unit of the entry.
    fn amplitude(&self, harmonic: usize) -> f64 {
        let at = |list: &[f64]| list.get(harmonic).copied().unwrap_or(0.0);
        at(&self.wave.cos).hypot(at(&self.wave.sin))
    }

    /// Harmonics at which the entry is certainly not zero, in ascending order.
    fn certain(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.wave.cos.len()).filter(|&harmonic| self.amplitude(harmonic) > self.error)
    }
}

/// The harmonics of the regressor's entries along a trajectory of the rows' coordinates, by row and column, without zero entries. `value`
/// gives the value of a run-time constant by its name. Entries without a series are left out.
pub(super) fn entries_along(
    prepared: &Prepared,
    rows: &dyn Model<f64>,
    trajectory: &Trajectory,
    value: impl Fn(&str) -> Option<f64>,
) -> Vec<EntryContent> {
    let model = &prepared.model;
    let wave = |name: &str| {
        let mut coordinates = (0..rows.dims().coordinates).zip(&trajectory.coordinates);
        coordinates.find(|(c, _)| rows.coordinate(*c).name == name).map(|(_, series)| wave_of(series))
    };
    let coordinates = model.coordinates.iter().map(|coordinate| wave(coordinate.name.as_str())).collect();
    let motion = PeriodicMotion { frequency: trajectory.frequency, coordinates };
    let constant = |symbol| value(model.quantity(symbol).name.as_str()).unwrap_or(f64::NAN);
    let mut nodes = Nodes::new(model, &motion, constant);
    let mut found = Vec::new();
    for (row, own) in prepared.form.rows.iter().enumerate() {
        for terms in own.terms.chunk_by(|a, b| a.column == b.column) {
            let Some(column) = terms.first().and_then(|term| term.column) else { continue };
            if let Ok(series) = nodes.sum(terms) {
                found.push(EntryContent { row, column, wave: series.wave(), error: series.error });
            }
        }
    }
    found
}

fn wave_of(series: &HarmonicSeries) -> Wave {
    let width = series.highest_harmonic() as usize + 1;
    let mut wave = Wave { cos: vec![0.0; width], sin: vec![0.0; width] };
    wave.cos[0] = series.mean;
    for line in &series.lines {
        wave.cos[line.harmonic as usize] += line.cos;
        wave.sin[line.harmonic as usize] += line.sin;
    }
    wave
}

/// The harmonics of a column that are certainly not zero, up to a highest harmonic, in the order of equations and
/// harmonics.
pub(super) fn showing(
    rows: &dyn Model<f64>,
    entries: &[EntryContent],
    column: usize,
    harmonics: usize,
    experiment: &str,
) -> Vec<ShowingHarmonic> {
    let of_entry = |entry: &EntryContent| {
        let harmonic = |harmonic| ShowingHarmonic {
            experiment: experiment.to_string(),
            equation: rows.row(entry.row).name.to_string(),
            harmonic,
            amplitude: entry.amplitude(harmonic),
            error: entry.error,
        };
        entry.certain().take_while(|&own| own <= harmonics).map(harmonic).collect::<Vec<_>>()
    };
    entries.iter().filter(|entry| entry.column == column).flat_map(of_entry).collect()
}
