//! An inspection as people read it.

use crate::inspect::channel::ChannelReport;
use crate::inspect::finding::Finding;
use crate::inspect::report::Inspection;
use std::collections::HashMap;
use std::fmt;
use tpm_log::Role;
use tpm_numerics::tolerance;
use tpm_report::{Align, Remedy, TextTable, number, or_dash};

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text(&|_| None))
    }
}

impl Inspection {
    /// The inspection as text: a table of the channels, then every finding with what it means for identification and what to do.
    /// `spell` says what a front end calls a remedy, such as the name of a flag; findings stand without it where it gives nothing.
    #[must_use]
    pub fn text(&self, spell: &dyn Fn(&Remedy) -> Option<String>) -> String {
        let sampling = &self.sampling;
        let mut text = format!(
            "{}: {} samples every {} s ({} Hz), {} s",
            self.log,
            sampling.samples,
            short(sampling.sample_time),
            short(sampling.rate),
            short(sampling.duration)
        );
        if sampling.segments > 1 {
            text.push_str(&format!(" in {} stretches", sampling.segments));
        }
        if sampling.jitter.rms > tolerance::TIME_STAMP {
            let percent = |share: f64| short(100.0 * share);
            let (rms, largest) = (percent(sampling.jitter.rms), percent(sampling.jitter.largest));
            text.push_str(&format!("; steps off by {rms} % (rms), {largest} % at most"));
        }
        if let Some(model) = &self.model {
            text.push_str(&format!("; model {model}"));
        }
        text.push('\n');
        for remark in self.reading.remarks() {
            text.push_str(&format!("remark: {remark}\n"));
        }
        text.push('\n');
        text.push_str(&table(&self.channels));
        let (doubts, notes): (Vec<&Finding>, Vec<&Finding>) =
            self.findings.iter().partition(|finding| finding.is_doubt());
        for (head, findings) in [("what needs attention", doubts), ("what else it means for identification", notes)] {
            if !findings.is_empty() {
                text.push_str(&format!("\n{head}\n{}", explained(&findings, spell)));
            }
        }
        text
    }
}

/// Findings, those of one meaning together above it.
fn explained(findings: &[&Finding], spell: &dyn Fn(&Remedy) -> Option<String>) -> String {
    let words = |finding: &Finding| {
        let flags: Vec<String> = finding.remedies().iter().filter_map(spell).collect();
        let meaning = finding.meaning();
        if flags.is_empty() { meaning } else { format!("{meaning} ({})", flags.join(" ")) }
    };
    let mut groups: Vec<(String, Vec<&Finding>)> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    for finding in findings {
        let words = words(finding);
        match places.get(&words) {
            Some(&at) => groups[at].1.push(finding),
            None => {
                places.insert(words.clone(), groups.len());
                groups.push((words, vec![finding]));
            }
        }
    }
    let mut text = String::new();
    for (words, group) in groups {
        for finding in group {
            text.push_str(&format!("- {finding}\n"));
        }
        text.push_str(&format!("  -> {words}\n"));
    }
    text
}

/// A number to four digits.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return number(value);
    }
    let digit = 10.0_f64.powi(3 - value.abs().log10().floor() as i32);
    number((value * digit).round() / digit)
}

fn table(channels: &[ChannelReport]) -> String {
    let modelled = channels.iter().any(|channel| channel.role != Role::Column);
    let mut head = vec![("channel", Align::Left)];
    head.extend(modelled.then_some(("role", Align::Left)));
    head.extend([
        ("unit", Align::Left),
        ("least", Align::Right),
        ("largest", Align::Right),
        ("deviation", Align::Right),
        ("noise", Align::Right),
        ("step", Align::Right),
        ("up to [Hz]", Align::Right),
        ("period [s]", Align::Right),
        ("at rest", Align::Right),
    ]);
    let mut table = TextTable::new(&head);
    for channel in channels {
        let role = match channel.role {
            Role::Coordinate => "coordinate",
            Role::Input => "input",
            Role::Rate => "rate",
            Role::Column => "",
        };
        let mut row = vec![channel.name.clone()];
        row.extend(modelled.then(|| role.to_string()));
        let noise =
            channel.noise.map(|noise| format!("{}{}", if channel.noise_at_most { "< " } else { "" }, short(noise)));
        row.extend([
            channel.unit.clone().unwrap_or_else(|| "-".to_string()),
            short(channel.least),
            short(channel.largest),
            short(channel.deviation),
            or_dash(noise, |noise| noise),
            or_dash(channel.step, short),
            or_dash(channel.highest, short),
            or_dash(channel.period, short),
            or_dash(channel.rest, |rest| format!("{:.1} %", 100.0 * rest.share)),
        ]);
        table.row(&row);
    }
    table.finish()
}
