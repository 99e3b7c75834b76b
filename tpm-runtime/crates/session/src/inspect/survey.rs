//! From a log to what it holds.

use crate::error::SessionError;
use crate::inspect::channel::{ChannelReport, measured};
use crate::inspect::finding::Finding;
use crate::inspect::period;
use crate::inspect::prospect::{Prospect, prospect};
use crate::inspect::relation::{MOST_COMPARED, relations};
use crate::inspect::report::{Inspection, Sampling};
use crate::inspect::signal::{Signal, signals};
use crate::log::{LogRequest, with_rates_alone};
use crate::log_fault::LogFault;
use crate::meaning::About;
use crate::model::Identifiable;
use crate::options::LogOptions;
use crate::reading::RecordSettings;
use crate::rows::Rows;
use rayon::prelude::*;
use tpm_controller::model::moving;
use tpm_estimate::Domain;
use tpm_log::{Cut, Role, Survey};

/// Share of noise in a channel's deviation from which on it is a finding.
const NOISE: f64 = 0.01;
/// Share of a record at rest from which on it is a finding.
const REST: f64 = 0.05;
/// Largest distance between two counts of a channel, as a share of its range, that is a finding: finer ones are digits of the file.
const COUNTS: f64 = 1e-5;
/// A shift of the inputs is a finding when it leaves less than this share of the squares that no shift leaves.
const CLEARLY: f64 = 0.7;
/// Least such shift, samples, and in its deviations.
const SHIFTED: (f64, f64) = (0.1, 4.0);
/// Deviation of the shift, samples, above which it is not told.
const UNTOLD: f64 = 1.0;

/// Looks at all columns of numbers of a log. Of the request, `t_s` may be mapped, columns may have factors, and the period and the first
/// sample may be stated.
///
/// # Errors
/// [`SessionError::Log`] when the log cannot be read, or a setting does not fit it.
pub fn inspect(log: impl Into<LogRequest>) -> Result<Inspection, SessionError> {
    let request = log.into();
    let (reading, domain) = (request.reading.clone(), request.estimation.domain);
    let options = LogOptions { reading, domain, ..LogOptions::default() };
    let survey = Survey::of_all(request.source(), &options.reading.columns)?;
    let mut inspection = measure(&survey, &options, 0)?;
    if !inspection.channels.is_empty() {
        inspection.findings.push(Finding::DelayUnknown { model: false });
    }
    Ok(sorted(inspection))
}

/// Looks at a log as identification of a model would use it: the model's coordinates, inputs and measured rates, with names, units and
/// factors settled as for identification.
///
/// # Errors
/// [`SessionError`] when the log cannot be read, the model carries a text that is no model, or a setting does not fit.
pub fn inspect_for(model: &impl Identifiable, log: impl Into<LogRequest>) -> Result<Inspection, SessionError> {
    let request = log.into();
    with_rates_alone(model, std::slice::from_ref(&request), &|model| of_request(model, &request))
}

/// [`inspect_for`] of a log that has all signals of the model.
fn of_request(model: &dyn Identifiable, request: &LogRequest) -> Result<Inspection, SessionError> {
    let declared = model.declaration()?;
    let rows = Rows::new(model, declared.as_deref());
    let evaluated = rows.model();
    // Constants without a value keep nobody from looking at the log.
    let (options, missing) = match request.options(evaluated, &[]) {
        Ok(options) => (options, None),
        Err(error @ SessionError::Constants { .. }) => {
            let columns = request.reading.columns.clone();
            let reading = RecordSettings { columns, ..RecordSettings::default() };
            (LogOptions { reading, ..LogOptions::default() }, Some(error))
        }
        Err(error) => return Err(error),
    };
    let mut survey = Survey::of_model(request.source(), evaluated, &options.reading.columns)?;
    let mut inspection = measure(&survey, &options, moving(evaluated))?;
    inspection.model = Some(evaluated.name().into());
    let constant = inspection.channels.iter().any(|channel| channel.constant && channel.role != Role::Rate);
    match missing {
        Some(error) => {
            let remedies = error.remedy().into_iter().collect();
            inspection.findings.push(Finding::Refused { message: error.to_string(), remedies });
        }
        None if constant => {}
        None => {
            let inputs = (0..evaluated.dims().inputs).map(|i| evaluated.input(i).name.to_string()).collect();
            let prospect = prospect(rows, &mut survey.recording, &options);
            take_in(&mut inspection, prospect, inputs, &options);
        }
    }
    Ok(sorted(inspection))
}

/// Measures the channels of a record; the first `coordinates` of them are those whose common period counts.
pub(super) fn measure(survey: &Survey, options: &LogOptions, coordinates: usize) -> Result<Inspection, LogFault> {
    let recording = &survey.recording;
    let sample_time = recording.segments.first().map_or(0.0, |log| log.sample_time);
    let signals = signals(survey);
    let mut channels: Vec<ChannelReport> = signals.par_iter().map(|signal| measured(signal, sample_time)).collect();
    let share = |channel: &ChannelReport| channel.noise.map_or(0.0, |noise| noise / channel.deviation);
    let noise: Vec<f64> = channels.iter().map(share).collect();
    let found = period::find(&signals, &noise, coordinates, sample_time, &options.reading)?;
    for ((channel, period), drift) in channels.iter_mut().zip(found.periods).zip(found.drifts) {
        channel.period = period;
        channel.drift = drift.filter(|_| !channel.constant);
    }
    let relations = relations(&signals, &channels, sample_time);
    let samples = recording.len();
    let sampling = Sampling {
        sample_time,
        rate: 1.0 / sample_time,
        samples,
        duration: samples as f64 * sample_time,
        segments: recording.segments.len(),
        jitter: recording.report.jitter,
    };
    let mut inspection = Inspection {
        schema: "tpm.inspection/1",
        log: recording.path.clone(),
        model: None,
        reading: recording.report.clone(),
        sampling,
        channels,
        repeats: found.repeats,
        relations,
        input_shift: None,
        identification: None,
        findings: Vec::new(),
    };
    let mut findings = of_record(&inspection, survey, &signals, options);
    findings.extend(inspection.channels.iter().flat_map(|channel| of_channel(channel, sample_time)));
    findings.extend(inspection.relations.iter().map(|relation| Finding::Follows {
        channel: relation.channel.clone(),
        of: relation.of.clone(),
        relation: relation.kind,
        gain: relation.gain,
        delay: relation.delay,
        deviation: relation.deviation,
        sample_time,
    }));
    inspection.findings = findings;
    Ok(inspection)
}

/// What is found about a record as a whole.
fn of_record(inspection: &Inspection, survey: &Survey, signals: &[Signal<'_>], options: &LogOptions) -> Vec<Finding> {
    let reading = &inspection.reading;
    let mut findings: Vec<Finding> = survey
        .unread
        .iter()
        .map(|unread| Finding::Unread { column: unread.column.clone(), why: unread.why.clone() })
        .collect();
    if signals.is_empty() {
        findings.push(Finding::NoChannel);
        return findings;
    }
    let left_out: usize = reading.left_out.iter().map(|part| part.rows).sum();
    let gaps = reading.segments.len() > 1;
    if gaps || left_out > 0 {
        findings.push(Finding::Gaps {
            segments: reading.segments.len(),
            longest: reading.segments.iter().map(|segment| segment.samples).max().unwrap_or(0),
            left_out,
            domain: options.domain,
        });
    }
    for segment in &reading.segments {
        if let Some(Cut::Joined { signal, by }) = &segment.cut {
            findings.push(Finding::Joined { channel: signal.clone(), by: *by, line: segment.from_line });
        }
    }
    if let Some(uneven) = &reading.uneven {
        findings.push(Finding::Uneven {
            rms: uneven.rms,
            largest: uneven.largest,
            resampled: uneven.resampled,
            error: uneven.interpolation.iter().map(|of| of.share).fold(0.0, f64::max),
        });
    }
    findings.push(match &inspection.repeats {
        Some(repeats) => Finding::Repeats {
            period: repeats.period,
            periods: repeats.periods,
            from_line: repeats.from_line,
            mismatch: repeats.mismatch,
            channels: repeats.channels.clone(),
            domain: options.domain.unwrap_or(if gaps { Domain::Time } else { Domain::Harmonics }),
            gaps,
        },
        None => Finding::NotPeriodic,
    });
    let columns = signals.iter().filter(|signal| signal.role == Role::Column).count();
    if columns > MOST_COMPARED {
        findings.push(Finding::ComparedInPart { compared: MOST_COMPARED, channels: columns });
    }
    findings
}

/// What is found about one channel.
fn of_channel(channel: &ChannelReport, sample_time: f64) -> Vec<Finding> {
    let name = || channel.name.clone();
    let (role, unit) = (channel.role, channel.unit.clone());
    if channel.constant {
        return vec![Finding::Constant { channel: name(), role, value: channel.mean }];
    }
    let mut findings = Vec::new();
    let range = channel.largest - channel.least;
    let measured = role != Role::Input;
    if let Some(step) = channel.step.filter(|step| *step > COUNTS * range && measured) {
        // Each reading errs by a twelfth of the square of a count.
        let rounding = step / 12.0_f64.sqrt();
        findings.push(Finding::Counts {
            channel: name(),
            step,
            unit: unit.clone(),
            counts: range / step,
            rate_error: rounding * 2.0_f64.sqrt() / sample_time,
            acceleration_error: rounding * 6.0_f64.sqrt() / sample_time.powi(2),
        });
    }
    let of_rounding = |noise: f64| channel.step.is_some_and(|step| noise < 1.01 * step / 12.0_f64.sqrt());
    if let Some(noise) = channel.noise.filter(|noise| *noise > NOISE * channel.deviation && !of_rounding(*noise)) {
        let share = noise / channel.deviation;
        findings.push(Finding::Noise { channel: name(), deviation: noise, unit: unit.clone(), share, role });
    }
    if let Some(period) = channel.typical_period.filter(|_| channel.noise_at_most && measured) {
        findings.push(Finding::SampledSlowly { channel: name(), period, samples: period / sample_time });
    }
    findings.extend(channel.plateaus.iter().map(|plateau| Finding::Clipped {
        channel: name(),
        role,
        end: plateau.end,
        level: plateau.level,
        unit: unit.clone(),
        share: plateau.share,
        longest: plateau.longest,
        from_line: plateau.from_line,
    }));
    if let Some(rest) = channel.rest.filter(|rest| rest.share > REST) {
        findings.push(Finding::Rest {
            channel: name(),
            role,
            share: rest.share,
            longest: rest.longest,
            from_line: rest.from_line,
            to_line: rest.to_line,
        });
    }
    findings.extend(channel.repeated.map(|share| Finding::Repeated { channel: name(), share, role }));
    findings.extend(channel.lone.map(|lone| Finding::Lone {
        channel: name(),
        count: lone.count,
        line: lone.line,
        farthest: lone.farthest,
    }));
    findings.extend(channel.drift.map(|share| Finding::Drift { channel: name(), share }));
    findings
}

/// Takes in what identification would make of the record.
fn take_in(inspection: &mut Inspection, prospect: Prospect, inputs: Vec<String>, options: &LogOptions) {
    let h = inspection.sampling.sample_time;
    let findings = &mut inspection.findings;
    inspection.input_shift = prospect.shift.filter(|shift| shift.deviation <= UNTOLD * h);
    match inspection.input_shift {
        Some(shift) => {
            let squares = |left: f64| left * left;
            let clearly = squares(shift.left_shifted) < CLEARLY * squares(shift.left);
            let shifted = clearly && shift.delay.abs() > (SHIFTED.0 * h).max(SHIFTED.1 * shift.deviation);
            findings.push(Finding::Inputs { inputs, shifted, shift, sample_time: h, hold: options.reading.hold });
        }
        None => findings.push(Finding::DelayUnknown { model: true }),
    }
    match prospect.outcome {
        Ok((log, warnings)) => {
            let used = if log.periodic().is_some() { Domain::Harmonics } else { Domain::Time };
            for finding in findings.iter_mut() {
                if let Finding::Repeats { domain, .. } = finding {
                    *domain = used;
                }
            }
            inspection.identification = Some(log);
            let of_log = warnings.into_iter().filter(|warning| warning.meaning().about == About::Record);
            findings.extend(of_log.map(|warning| Finding::Identification { warning: Box::new(warning) }));
        }
        Err(error) => {
            let remedies = error.remedy().into_iter().collect();
            findings.push(Finding::Refused { message: error.to_string(), remedies });
        }
    }
}

/// What needs attention comes first.
fn sorted(mut inspection: Inspection) -> Inspection {
    inspection.findings.sort_by_key(|finding| !finding.is_doubt());
    inspection
}
