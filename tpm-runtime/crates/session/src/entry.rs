//! One log on its way to a result: as even samples or, where a coordinate is not measured, as it was recorded.

use crate::error::SessionError;
use crate::identification::Identification;
use crate::identify::identify_recorded;
use crate::log_fault::LogFault;
use crate::model::DeclaredModel;
use crate::options::LogOptions;
use crate::periodic_log::repeats;
use crate::recorded_log::{self, signal_name};
use crate::rows::Rows;
use crate::summary::lone_readings;
use crate::warning::Warning;
use tpm_controller::harmonics::Hold;
use tpm_estimate::{Domain, EstimateError, LARGE_RESIDUAL, is_static};
use tpm_log::{AsRecorded, Assumption, Log, LogSource, Lone, ReadingReport, Recording};

/// Error of the interpolation between uneven stamps, as a share of a channel's deviation, above which the channel is lost.
const MOST_MISSED: f64 = 0.1;

/// How a log is identified.
pub(super) struct Entry<'a> {
    pub(super) rows: &'a Rows<'a>,
    pub(super) declared: Option<&'a DeclaredModel>,
    pub(super) options: &'a LogOptions,
}

impl Entry<'_> {
    /// The result of a log that is simulated between its stamps, with its fingerprint.
    pub(super) fn as_recorded(&self, source: LogSource<'_>) -> Result<(Identification, String), SessionError> {
        let model = self.rows.model();
        let mut recorded = AsRecorded::open(source, model, &self.options.reading.columns).map_err(LogFault::from)?;
        let name = |c: usize| model.coordinate(c).name.to_string();
        let derivatives: Vec<(usize, u32)> = [(1, &recorded.rates), (2, &recorded.accelerations)]
            .into_iter()
            .flat_map(|(order, own)| (0..own.len()).filter(|&c| own[c].is_some()).map(move |c| (c, order)))
            .collect();
        let held: Vec<usize> = self.options.estimation.frozen.iter().map(|frozen| frozen.parameter).collect();
        let shown = self.declared.and_then(|declared| {
            let derivatives: Vec<(String, u32)> = derivatives.iter().map(|&(c, order)| (name(c), order)).collect();
            declared.shown(&derivatives, &held).map(|shown| (declared, shown))
        });
        if let Some((declared, shown)) = &shown
            && let Some(coordinate) = shown.unfelt.first()
        {
            let positions = (0..model.dims().coordinates).filter(|&c| model.is_measured(c)).map(|c| (c, 0));
            let sensors = positions.chain(derivatives.iter().map(|&(c, order)| (c, order as usize)));
            return Err(SessionError::from(LogFault::Unfelt {
                path: recorded.path,
                coordinate: declared.prepared().model.coordinates[coordinate.0 as usize].name.clone(),
                sensors: sensors.map(|(c, order)| signal_name(model, c, order)).collect(),
            }));
        }
        // Columns are those of a model without nonlinear parameters; with them nothing is known of the parameters beforehand.
        let shown = shown.filter(|(declared, _)| declared.nonlinear().next().is_none());
        let unshown = shown.as_ref().map(|(_, shown)| shown.together.len());
        let mut part = identify_recorded(model, &recorded, unshown, self.options)?;
        let together = shown.iter().flat_map(|(_, shown)| &shown.together);
        let names = |columns: &Vec<usize>| columns.iter().map(|&j| model.parameter(j).name.to_string()).collect();
        let hidden = together.map(|columns| Warning::OnlyTogether { parameters: names(columns) });
        part.warnings = hidden.chain(std::mem::take(&mut part.warnings)).collect();
        if let Some(report) = &mut part.log {
            report.reading = std::mem::take(&mut recorded.report);
        }
        Ok((part, recorded.fingerprint))
    }

    /// The result of a log as even samples, with its fingerprint. Stamps that are not even had to be resampled, which moves the steps of a
    /// held input; where that leaves the log unexplained, or a channel is lost between the stamps, the log is simulated between them. So it
    /// is where a held input has stamps of its own, whose steps the rows of another channel do not show.
    pub(super) fn evenly(&self, source: LogSource<'_>) -> Result<(Identification, String), SessionError> {
        let mut moved = Moved::default();
        let even = self.on_even_samples(source, &mut moved);
        let left = match &even {
            Ok((part, _)) if !moved.lost => part.residual,
            _ => f64::INFINITY,
        };
        let held =
            (moved.resampled || moved.lost) && self.options.reading.hold == Hold::Zoh && self.options.domain.is_none();
        if left < LARGE_RESIDUAL || !held || !recorded_log::may_be(self.options) || is_static(self.rows.model()) {
            return even;
        }
        match self.as_recorded(source) {
            Ok((part, hash)) if part.residual < left.min(LARGE_RESIDUAL) => Ok((part, hash)),
            _ => even,
        }
    }

    fn on_even_samples(
        &self,
        source: LogSource<'_>,
        moved: &mut Moved,
    ) -> Result<(Identification, String), SessionError> {
        let model = self.rows.model();
        let mut recording = Recording::open(source, model, &self.options.reading.columns)?;
        *moved = Moved::of(&recording.report);
        let coordinates = model.dims().coordinates;
        let hash = std::mem::take(&mut recording.fingerprint);
        if self.options.domain == Some(Domain::Harmonics) {
            recording = alone(recording, coordinates, self.options);
        }
        let of_repeated = |repeated| Warning::RepeatedReadings { repeated };
        let mut replaced: Vec<Warning> = recording.report.repeated.iter().cloned().map(of_repeated).collect();
        // Where rows stand for themselves, those about one say nothing of it.
        let judged = if self.options.reading.columns.timeless { &mut [] } else { recording.segments.as_mut_slice() };
        for log in judged {
            let mended = log.mend(model).into_iter();
            let lone: Vec<Lone> =
                mended.map(|(coordinate, sample, by)| Lone { coordinate, line: log.lines[sample], by }).collect();
            replaced.extend(lone_readings(model, &lone));
        }
        let segments: Vec<&Log> = recording.segments.iter().collect();
        let mut part =
            (self.rows.identify(&segments, self.options)).map_err(|error| of_pieces(error, &recording.report))?;
        part.warnings.extend(replaced);
        if let Some(report) = &mut part.log {
            report.reading = recording.report;
        }
        Ok((part, hash))
    }
}

/// What even samples did to the steps of held inputs.
#[derive(Clone, Copy, Default)]
struct Moved {
    /// The stamps were uneven, and readings are interpolated.
    resampled: bool,
    /// A channel is lost: interpolation misses much of it, or it is an input with stamps of its own, between the rows that are used.
    lost: bool,
}

impl Moved {
    fn of(report: &ReadingReport) -> Self {
        let apart = |of: &Assumption| matches!(of, Assumption::OwnTimes { held, .. } if !held.is_empty());
        let resampled = report.uneven.as_ref().filter(|uneven| uneven.resampled);
        let missed = resampled.is_some_and(|uneven| uneven.interpolation.iter().any(|of| of.share > MOST_MISSED));
        Moved { resampled: resampled.is_some(), lost: missed || report.assumptions.iter().any(apart) }
    }
}

/// The fault of a record in which nothing is seen: where it is cut into pieces, that they are too short.
fn of_pieces(error: LogFault, report: &ReadingReport) -> LogFault {
    match (error, report.segments.as_slice()) {
        (LogFault::Estimate { path, source: EstimateError::NoSignal }, [first, .., last]) => LogFault::ShortSegments {
            path,
            from: first.from_line,
            to: last.to_line,
            segments: report.segments.len(),
            longest: report.segments.iter().map(|segment| segment.samples).max().unwrap_or(0),
            cut: report
                .segments
                .iter()
                .find_map(|segment| segment.cut.as_ref())
                .map(|cut| cut.to_string())
                .unwrap_or_default(),
        },
        (error, _) => error,
    }
}

/// A recording of one segment alone: the longest one that repeats or, where none does, the longest one.
pub(super) fn alone(mut recording: Recording, coordinates: usize, options: &LogOptions) -> Recording {
    let segments = &recording.segments;
    let mut longest_first: Vec<usize> = (0..segments.len()).collect();
    longest_first.sort_by_key(|&i| std::cmp::Reverse(segments[i].len()));
    let used = match longest_first[..] {
        [] | [_] => return recording,
        _ => longest_first.iter().copied().find(|&i| repeats(&segments[i], coordinates, &options.reading)),
    };
    let used = used.unwrap_or(longest_first[0]);
    recording.report.used = Some(used);
    recording.segments = vec![recording.segments.swap_remove(used)];
    recording
}
