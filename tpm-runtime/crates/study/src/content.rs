//! Harmonics of the regressor's columns along a trajectory, by Jacobi-Anger series
//! ([`tpm_symbolic::harmonic::content`]).

use tpm_controller::model::Model;
use tpm_motion::trajectory::{HarmonicSeries, Trajectory};
use tpm_symbolic::harmonic::bessel::Wave;
use tpm_symbolic::harmonic::content::{EntryContent, PeriodicMotion, content};
use tpm_symbolic::harmonic::report::ShowingHarmonic;
use tpm_symbolic::regressor::prepare::Prepared;

/// The harmonics of the regressor's entries along a trajectory of the rows' coordinates. `value` gives the value of a
/// run-time constant by its name.
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
    content(model, &prepared.form, &motion, constant)
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
