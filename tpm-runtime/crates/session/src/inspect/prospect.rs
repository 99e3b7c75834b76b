//! What identification would make of a record.

use crate::excerpt::blocks;
use crate::log_fault::LogFault;
use crate::log_report::LogReport;
use crate::options::LogOptions;
use crate::record::{MOST_SAMPLES, record, stretches};
use crate::rows::Rows;
use crate::warning::Warning;
use tpm_estimate::{InputShift, Settings, input_shift};
use tpm_log::{Log, Recording};

/// Blocks of a long record in which the shift of the inputs is looked for, and the samples of all of them.
const BLOCKS: (usize, usize) = (8, MOST_SAMPLES / 8);

/// What identification would make of a record.
pub(super) struct Prospect {
    /// How it would use the record and what it would warn of, or why it would refuse it.
    pub(super) outcome: Result<(LogReport, Vec<Warning>), LogFault>,
    /// The time between inputs and motion; nothing where it is not told.
    pub(super) shift: Option<InputShift>,
}

/// Identifies a model from a record, whose single wrong readings are replaced first as identification does.
pub(super) fn prospect(rows: Rows<'_>, recording: &mut Recording, options: &LogOptions) -> Prospect {
    let model = rows.model();
    for log in &mut recording.segments {
        log.mend(model);
    }
    let segments: Vec<&Log> = recording.segments.iter().collect();
    let found = rows.identify(&segments, options);
    // Rows that are linear about what was found tell the shift best.
    let values = found.as_ref().ok().and_then(|found| found.estimate.as_ref()).map(|estimate| estimate.values.clone());
    let rows = match values {
        Some(values) => rows.about(&values).ok(),
        None => Some(rows),
    };
    let shift = rows.and_then(|rows| shift(&rows, &segments, options));
    let outcome = found.and_then(|found| found.log.map(|log| (log, found.warnings)).ok_or_else(nothing));
    Prospect { outcome, shift }
}

fn nothing() -> LogFault {
    LogFault::Estimate { path: Default::default(), source: tpm_estimate::EstimateError::NoSignal }
}

fn shift(rows: &Rows<'_>, segments: &[&Log], options: &LogOptions) -> Option<InputShift> {
    let model = rows.model();
    let stretches = stretches(segments, model.dims().coordinates, &options.reading).ok()?;
    let samples: usize = segments.iter().map(|log| log.len()).sum();
    let stretches = if samples > BLOCKS.1 { blocks(&stretches, BLOCKS.0, BLOCKS.1 / BLOCKS.0) } else { stretches };
    let record = record(segments.first()?.sample_time, options, stretches);
    let derivatives = rows.machine().map(|machine| machine.derivatives);
    let settings = Settings { prior: Vec::new(), ..options.estimation.clone() };
    input_shift(model, derivatives, &options.constants, &record, &settings).ok().flatten()
}
