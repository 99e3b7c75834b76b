//! `tpm trajectories --path`: a pattern of few harmonics fitted to a path, written in the model language.

use crate::failure::Failure;
use crate::input::load::Loaded;
use std::path::{Path, PathBuf};
use tpm_runtime::log::{Log, ReadingSettings};
use tpm_runtime::study::{FittedPattern, PathSettings, SampledPath};

/// Options of a path.
#[derive(clap::Args)]
pub(crate) struct PathArgs {
    /// Fit a pattern to this path in place of the comparison: a CSV file with the time in `t_s` and a column for every coordinate
    /// that moves, from the start of a stroke to its end.
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// Highest harmonic of the pattern that is fitted.
    #[arg(long, value_name = "N", default_value_t = 5, requires = "path")]
    highest: u32,
    /// Number of derivatives that vanish at both ends of the path.
    #[arg(long, value_name = "N", default_value_t = 3, requires = "path")]
    rest_order: u32,
    /// The path ends where it begins, and is repeated instead of played back.
    #[arg(long, requires = "path")]
    closed: bool,
}

impl PathArgs {
    /// The pattern fitted to the path; nothing where there is no path.
    pub(crate) fn fitted(&self, model: &Path) -> Result<Option<FittedPattern>, Failure> {
        let Some(path) = &self.path else { return Ok(None) };
        let loaded = Loaded::from_file(model)?;
        let model = loaded.model();
        // The coordinates that the first pattern moves; all where there is no pattern.
        let moves = |c: usize| model.patterns.first().is_none_or(|pattern| pattern.motions[c].is_some());
        let moved: Vec<usize> = (0..model.coordinates.len()).filter(|&c| moves(c)).collect();
        let names: Vec<String> = moved.iter().map(|&c| model.coordinates[c].name.to_string()).collect();
        let (log, _) = Log::open_signals(path, &names, &ReadingSettings::default())
            .map_err(|error| Failure::Input(error.to_string()))?;
        let settings = PathSettings { harmonics: self.highest, rest: self.rest_order, closed: self.closed };
        let unit = |&c: &usize| model.coordinates[c].unit.as_ref().map(ToString::to_string);
        let sampled = SampledPath {
            model: model.name.clone(),
            units: moved.iter().map(unit).collect(),
            signals: names.into_iter().zip(log.channels).collect(),
            sample_time: log.sample_time,
        };
        FittedPattern::new(&sampled, settings)
            .map(Some)
            .map_err(|error| Failure::Input(format!("{}: {error} (--highest, --rest-order, --closed)", path.display())))
    }
}
