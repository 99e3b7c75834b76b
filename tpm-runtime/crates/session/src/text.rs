//! A result as people read it.

use crate::identification::{Identification, Source};
use crate::log_report::{LogReport, PoolReport, SensorReport, Way};
use crate::refinement_report::{NotRefined, RateReport};
use crate::warning::Warning;
use std::fmt::{self, Write as _};
use tpm_estimate::{CombinationReport, ParameterReport, Status, WrittenCombination};
use tpm_log::Assumption;
use tpm_plant::stability::LoopStability;
use tpm_report::{Align, Remedy, TextTable, beside, cells, combination, listed, number, or_dash, plus_minus};

/// Terms that a model lacks, poorly determined parameters, and directions that are not shown, of which each has a line.
const MOST_TERMS: usize = 3;
const MOST_POOR: usize = 2;
const MOST_DIRECTIONS: usize = 4;

impl fmt::Display for Identification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text(&|_| None))
    }
}

impl Identification {
    /// The result as text: runs, parameters with standard deviations, what the data do not show, warnings. `spell` says what a front
    /// end calls a remedy, such as the name of a flag; warnings stand without it where it gives nothing.
    #[must_use]
    pub fn text(&self, spell: &dyn Fn(&Remedy) -> Option<String>) -> String {
        let mut text = self.head();
        text.push_str(&parameters(&self.parameters));
        text.push_str(&combinations(&self.combinations));
        if !self.physical.is_empty() {
            text.push_str("\nphysical parameters\n");
            text.push_str(&parameters(&self.physical));
        }
        if self.knows_truth() {
            text.push_str("\ntrue: value in the simulated plant, which only a simulation knows; error/std: identified less true, in deviations\n");
        }
        text.push('\n');
        if self.source != Source::Log {
            text.push_str(self.outcome.map_or("not finished", |outcome| outcome.describe()));
            if let Some(stop) = &self.stop {
                text.push_str(&format!(": {stop}"));
            }
            text.push_str("; ");
            if let Some(refined) = self.refinement.as_ref().filter(|refined| refined.used) {
                text.push_str(&format!("refined by a simulation along {}; ", runs(refined.runs)));
            }
        }
        text.push_str(&format!(
            "rank {} of {}, condition number {}, residual {} % of {}\n",
            self.rank,
            self.wanted(),
            or_dash(self.condition, number),
            number(100.0 * self.residual),
            self.residual_of,
        ));
        if let Some(advice) = &self.advice {
            text.push_str(&format!("{advice}\n"));
        }
        for direction in self.unobservable.iter().take(MOST_DIRECTIONS) {
            text.push_str(&format!("the data do not show the direction {}\n", combination(direction)));
        }
        if self.unobservable.len() > MOST_DIRECTIONS {
            let more = self.unobservable.len() - MOST_DIRECTIONS;
            text.push_str(&format!("the data do not show {more} more directions, which the JSON has\n"));
        }
        if let Some(prediction) = self.log.as_ref().and_then(LogReport::prediction) {
            text.push_str(&format!("\n{}\n", prediction.text()));
        }
        for remark in self.log.iter().flat_map(LogReport::limits) {
            text.push_str(&format!("remark: {remark}\n"));
        }
        text.push_str(&self.warnings_text(spell));
        text
    }

    /// The warnings alone as text, one a line, with remedies as [`text`](Self::text) has them.
    #[must_use]
    pub fn warnings_text(&self, spell: &dyn Fn(&Remedy) -> Option<String>) -> String {
        let mut text = String::new();
        let (mut terms, mut lone, mut poor) = (0, Vec::new(), Vec::new());
        for warning in &self.warnings {
            match warning {
                Warning::MissingTerm { .. } => terms += 1,
                Warning::LoneReadings { coordinate, count, .. } => lone.push(format!("{coordinate} ({count})")),
                Warning::PoorlyDetermined { parameter, .. } => poor.push(parameter.clone()),
                _ => {}
            }
            let is_more = match warning {
                Warning::MissingTerm { .. } => terms > MOST_TERMS,
                Warning::LoneReadings { .. } => lone.len() > 1,
                Warning::PoorlyDetermined { .. } => poor.len() > MOST_POOR,
                _ => false,
            };
            if is_more {
                continue;
            }
            text.push_str(&format!("warning: {warning}"));
            if let Some(words) = warning.remedy().and_then(|remedy| spell(&remedy)) {
                text.push_str(&format!(" ({words})"));
            }
            text.push('\n');
        }
        if terms > MOST_TERMS {
            text.push_str(&format!(
                "warning: and {} terms that are less clear, which the JSON has\n",
                terms - MOST_TERMS
            ));
        }
        if lone.len() > 1 {
            text.push_str(&format!("warning: and likewise single readings of {}\n", lone[1..].join(", ")));
        }
        if poor.len() > MOST_POOR {
            let more = listed(&poor[MOST_POOR..]);
            text.push_str(&format!("warning: and likewise poorly determined, as the table says: {more}\n"));
        }
        text
    }

    /// Whether a true value stands beside any identified one.
    fn knows_truth(&self) -> bool {
        let parameters = self.parameters.iter().chain(&self.physical).any(|parameter| parameter.truth.is_some());
        parameters || self.combinations.iter().any(|shown| shown.truth.is_some())
    }

    fn head(&self) -> String {
        let (model, estimator, hold) = (&self.model, self.estimator.name(), self.hold);
        let mut text = match (self.source, &self.log) {
            (Source::Log, Some(log)) => return log_head(self, log),
            (Source::Log, None) if self.pool.is_some() => {
                return self.pool.as_ref().map(|pool| pool_head(self, pool)).unwrap_or_default();
            }
            (Source::Log, None) => return format!("model {model} from a log; hold {hold}\n\n"),
            (Source::SimulatedPlant, _) => {
                let seed = self.seed.unwrap_or(0);
                format!("model {model} on a simulated plant; estimator {estimator}; hold {hold}; seed {seed}\n\n")
            }
            (Source::Machine, _) => format!("model {model} on a machine; estimator {estimator}; hold {hold}\n\n"),
            (Source::Folder, _) => {
                format!("model {model} from the runs in its folder; estimator {estimator}; hold {hold}\n\n")
            }
        };
        text.push_str(&self.run_table());
        if let Some(stability) = &self.stability {
            text.push_str(&closed_loop(stability));
        }
        text.push('\n');
        text
    }

    fn run_table(&self) -> String {
        // Stages may have patterns of their own, with other amplitudes.
        let mut amplitudes: Vec<&str> = Vec::new();
        for (name, _) in self.runs.iter().flat_map(|run| &run.amplitudes) {
            if !amplitudes.contains(&name.as_str()) {
                amplitudes.push(name);
            }
        }
        let several = self.runs.iter().any(|run| run.pattern.is_some());
        let mut head = vec![("run", Align::Right)];
        head.extend(several.then_some(("pattern", Align::Left)));
        head.extend(amplitudes.iter().map(|name| (*name, Align::Right)));
        head.extend([(self.frequency_name.as_str(), Align::Right), ("periods", Align::Right)]);
        head.extend([("rms error", Align::Right), ("effort", Align::Right), ("condition", Align::Right)]);
        head.push(("ending", Align::Left));
        let mut table = TextTable::new(&head);
        for run in &self.runs {
            let mut row = vec![run.run.to_string()];
            row.extend(several.then(|| run.pattern.as_deref().unwrap_or("-").to_owned()));
            row.extend(amplitudes.iter().map(|name| {
                let own = run.amplitudes.iter().find(|(own, _)| own == name);
                or_dash(own, |(_, value)| number(*value))
            }));
            row.push(number(run.frequency));
            row.push(run.periods.to_string());
            row.push(run.tracking_rms.iter().map(|rms| number(*rms)).collect::<Vec<_>>().join(" "));
            row.push(or_dash(run.effort_share, |share| format!("{:.1} %", 100.0 * share)));
            row.push(or_dash(run.condition, number));
            let pooled = if run.contradicts.is_some() { ", not pooled" } else { "" };
            row.push(format!("{}{pooled}", run.ending));
            table.row(&row);
        }
        table.finish()
    }
}

fn runs(count: usize) -> String {
    if count == 1 { "one run".to_owned() } else { format!("{count} runs") }
}

/// The logs that were used together, each with what it gave and where it differs most from the others.
fn pool_head(result: &Identification, pool: &PoolReport) -> String {
    let mut text = format!("model {} from {} logs; hold {}\n\n", result.model, pool.logs.len(), result.hold);
    let mut table = TextTable::new(&[
        ("log", Align::Left),
        ("samples", Align::Right),
        ("used by", Align::Left),
        ("information", Align::Right),
        ("residual", Align::Right),
        ("farthest from the others", Align::Left),
    ]);
    for part in &pool.logs {
        let told = part.deviations.iter().filter_map(|(name, deviations)| Some((name, (*deviations)?)));
        let farthest = told.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        table.row(&[
            part.log.path.clone(),
            part.log.samples.to_string(),
            match &part.log.way {
                Way::Harmonics(found) => format!("{} periods of {} s", found.periods, number(found.period)),
                Way::Samples(_) => "samples one by one".into(),
                Way::Recorded(_) => "simulation between its stamps".into(),
                Way::Spectral(found) => {
                    format!("lines up to {} Hz", number(found.lines.used.iter().copied().fold(0.0, f64::max)))
                }
            },
            format!("{:.1} %", 100.0 * part.share),
            format!("{} %", number(100.0 * part.residual)),
            or_dash(farthest, |(name, deviations)| {
                let left_out = if part.left_out { "; left out" } else { "" };
                format!("{name}, {deviations:+.1} deviations{left_out}")
            }),
        ]);
    }
    text.push_str(&table.finish());
    for part in &pool.logs {
        for remark in part.log.reading.remarks() {
            text.push_str(&format!("remark: {}: {remark}\n", part.log.path));
        }
    }
    text.push_str(&if pool.inflation > 1.0 {
        format!(
            "the logs differ by more than chance, and deviations are {:.2} times as large for it\n\n",
            pool.inflation.sqrt()
        )
    } else {
        let which = if pool.logs.iter().any(|part| part.left_out) { "the others" } else { "the logs" };
        format!("{which} agree as far as their deviations tell\n\n")
    });
    text
}

fn log_head(result: &Identification, log: &LogReport) -> String {
    let (model, path, samples, hold) = (&result.model, &log.path, log.samples, result.hold);
    let mut text = format!("model {model} from {path}\n");
    text.push_str(&if log.reading.assumptions.contains(&Assumption::Timeless) {
        format!("{samples} rows; ")
    } else {
        format!("{samples} samples every {} s; ", number(log.sample_time))
    });
    text.push_str(&match &log.way {
        Way::Harmonics(found) => format!(
            "{} periods of {} s from sample {} (line {}); hold {hold}; {} window; harmonics up to {}\n\n",
            found.periods,
            number(found.period),
            found.from_sample,
            found.from_line,
            found.window,
            result.harmonics,
        ),
        Way::Samples(found) => format!("{} samples used one by one; hold {hold}\n\n", found.samples),
        Way::Recorded(found) => {
            let part = if found.readings < found.of { format!("{} of ", found.readings) } else { String::new() };
            let blocks = match found.blocks {
                1 => "in one piece".to_owned(),
                blocks => {
                    format!("in {blocks} blocks of up to {} s, each from a state of its own", number(found.duration))
                }
            };
            let left = |own: &SensorReport| {
                let late = match (own.late, own.late_std) {
                    (Some(late), Some(std)) => {
                        format!(", whose stamps are {} +- {} ms late", number(1e3 * late), number(1e3 * std))
                    }
                    _ => String::new(),
                };
                format!("{:.3} % of `{}`{late}", 100.0 * own.share, own.signal)
            };
            let left = found.sensors.iter().map(left).collect::<Vec<_>>().join(", ");
            let unmeasured = match found.unmeasured.as_slice() {
                [] => String::new(),
                names => format!("not measured, simulated: {}\n", names.join(", ")),
            };
            format!(
                "simulated between the stamps of {part}{} readings {blocks}; hold {hold}\n{unmeasured}left: {left}\n\n",
                found.of
            )
        }
        Way::Spectral(found) => {
            let part = match found.period {
                Some(period) => format!("{} samples of whole periods of {} s", found.lines.samples, number(period)),
                None if found.lines.samples < samples => format!("{} of them in blocks", found.lines.samples),
                None => "all of them used".into(),
            };
            let used = found.lines.used.iter().copied().fold(0.0, f64::max);
            let lines: usize = found.lines.lines.iter().sum();
            format!("{part}; {lines} lines of the rows, up to {} Hz; hold {hold}\n\n", number(used))
        }
    });
    let remarks = log.reading.remarks();
    for remark in &remarks {
        text.push_str(&format!("remark: {remark}\n"));
    }
    if !remarks.is_empty() {
        text.push('\n');
    }
    if let Some(refined) = log.refinement.as_ref().filter(|refined| refined.used && refined.samples < refined.of) {
        let part = match refined.averaged {
            1 if refined.blocks > 0 => format!("{} samples in {} blocks", refined.samples, refined.blocks),
            1 => format!("the last {} samples", refined.samples),
            stretches => format!("{} samples, means of {stretches} stretches each", refined.samples),
        };
        text.push_str(&format!("refined by a simulation of {part}, because the log is long\n\n"));
    }
    if let Some(note @ NotRefined::NotAsked) = log.refinement.as_ref().and_then(|own| own.note.as_ref()) {
        text.push_str(&format!("{note}\n\n"));
    }
    for rate in log.refinement.iter().flat_map(|refined| &refined.rates) {
        let RateReport { coordinate, noise, why, .. } = rate;
        text.push_str(&match (why, noise) {
            (Some(why), _) => format!("the simulation does not use the measured dot({coordinate}): {why}\n\n"),
            (None, noise) => {
                let noise = noise.map_or(String::new(), |noise| format!(", with noise of {}", number(noise)));
                format!("the simulation uses the measured dot({coordinate}) as a reading of the motion{noise}\n\n")
            }
        });
    }
    for (input, known) in &log.actuators {
        let mut parts = Vec::new();
        match known.delay_std {
            Some(std) => {
                parts.push(format!("a delay of {} s, found with the parameters", plus_minus(known.delay, std)))
            }
            None if known.fitted => text.push_str(&format!("the record shows no delay of {input}\n")),
            None if known.delay > 0.0 => parts.push(format!("a delay of {} s", number(known.delay))),
            None => {}
        }
        if let Some((frequency, quality)) = known.low_pass {
            parts.push(format!("a low pass of {} rad/s and quality {}", number(frequency), number(quality)));
        }
        if let Some(bandwidth) = known.bandwidth {
            parts.push(format!("a current loop of {} rad/s", number(bandwidth)));
        }
        if !parts.is_empty() {
            text.push_str(&format!("corrected behind {input}: {}\n", parts.join(", ")));
        }
    }
    if !log.actuators.is_empty() {
        text.push('\n');
    }
    text
}

/// What was known of the loop before the first run; nothing when nothing could be known.
/// The slowest pole of the closed loop, over the stated ranges too, as a line of text behind an empty one; empty where nothing is known.
pub fn closed_loop(stability: &LoopStability) -> String {
    let mut text = String::new();
    if let Some(slowest) = stability.poles.iter().map(|pole| pole.0).reduce(f64::max) {
        // Writing to a string cannot fail.
        let _ = write!(text, "\nclosed loop: slowest pole {} 1/s with the prior", number(slowest));
    }
    if let Some(sampled) = &stability.sampled {
        let _ = write!(
            text,
            "{} {} 1/s over the stated ranges (sampled: {} vertices, {} points on edges, {} inside)",
            if text.is_empty() { "\nclosed loop: slowest pole" } else { "," },
            number(sampled.slowest),
            sampled.vertices,
            sampled.edges,
            sampled.interior
        );
    }
    if !text.is_empty() {
        text.push('\n');
    }
    text
}

/// Parameter, unit, prior, identified, standard deviation, change; on a simulated machine also the true value and the error in
/// deviations. An unobservable parameter gets no number.
fn parameters(list: &[ParameterReport]) -> String {
    let rows = list.iter().map(|parameter| Row {
        name: parameter.name.clone(),
        unit: parameter.unit.as_deref(),
        prior: parameter.prior,
        value: parameter.value,
        std: parameter.std,
        truth: parameter.truth,
        remark: match parameter.status {
            Status::Identified => String::new(),
            status => match parameter.with_prior {
                Some(value) => format!("{}; {} with the prior", status.name(), number(value)),
                None => status.name().replace('_', " "),
            },
        },
    });
    estimates("parameter", &rows.collect::<Vec<_>>())
}

/// Combinations of parameters that do not show one by one, in the columns of [`parameters`].
fn combinations(list: &[CombinationReport]) -> String {
    if list.is_empty() {
        return String::new();
    }
    let rows = list.iter().map(|shown| {
        let WrittenCombination { name, unit, prior, value, truth } = shown.written(combination);
        Row { name, unit, prior, value: Some(value), std: Some(shown.std), truth, remark: String::new() }
    });
    format!("\n{}", estimates("combination", &rows.collect::<Vec<_>>()))
}

/// One line of a table of estimates.
struct Row<'a> {
    name: String,
    unit: Option<&'a str>,
    prior: Option<f64>,
    value: Option<f64>,
    std: Option<f64>,
    truth: Option<f64>,
    remark: String,
}

fn estimates(of: &str, rows: &[Row<'_>]) -> String {
    let simulated = rows.iter().any(|row| row.truth.is_some());
    let mut head = vec![
        (of, Align::Left),
        ("unit", Align::Left),
        ("prior", Align::Right),
        ("identified", Align::Decimal),
        ("std. dev.", Align::Decimal),
        ("change", Align::Right),
    ];
    if simulated {
        head.extend([("true", Align::Decimal), ("error/std", Align::Right)]);
    }
    head.push(("", Align::Left));
    let mut table = TextTable::new(&head);
    for row in rows {
        let change = match (row.prior, row.value) {
            (Some(prior), Some(value)) if prior != 0.0 => format!("{:+.3} %", 100.0 * (value - prior) / prior),
            _ => "-".to_owned(),
        };
        let mut line = vec![row.name.clone(), row.unit.unwrap_or("-").to_owned(), or_dash(row.prior, number)];
        line.extend(cells(row.value, row.std));
        line.push(change);
        if simulated {
            let std = row.std.filter(|std| *std > 0.0);
            let error = row.value.zip(row.truth).zip(std).map(|((value, truth), std)| (value - truth) / std);
            line.push(or_dash(row.truth, |truth| beside(truth, row.value, row.std)));
            line.push(or_dash(error, |error| format!("{error:+.2}")));
        }
        line.push(row.remark.clone());
        table.row(&line);
    }
    table.finish()
}
