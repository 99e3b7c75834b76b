//! Right models and sound logs: do the stated intervals hold the truth as often as they say?

use crate::honesty::cases::Noise;
use crate::honesty::chance::binomial_band;
use crate::honesty::examine::Examined;
use crate::honesty::identify::Outcome;
use crate::honesty::table::{Table, met, most_frequent, percent};
use std::fmt::Write as _;

/// Deviations of the 95 % interval of a normal variable.
const NORMAL_95: f64 = 1.959_963_984_540_054;
/// Share of counts that chance puts outside of the band.
const OUTSIDE: f64 = 1e-3;
/// Coverage that is asked for where an encoder's error repeats with the motion.
const UNDITHERED: f64 = 0.9;
/// Standard deviations of the ratio of empirical to stated deviation by which it may differ from one under white noise: .15 of two
/// hundred logs.
const RATIO: f64 = 3.0;

/// Errors of one parameter over many logs.
#[derive(Clone, Debug)]
pub struct Errors {
    /// True value.
    pub truth: f64,
    /// Value and stated deviation, log by log.
    pub found: Vec<(f64, f64)>,
}

impl Errors {
    /// The errors of a parameter where it has a value.
    #[must_use]
    pub fn of(outcomes: &[Outcome], name: &str, truth: f64) -> Self {
        Errors { truth, found: outcomes.iter().filter_map(|outcome| outcome.value(name)).collect() }
    }

    fn mean(&self, term: impl Fn(f64, f64) -> f64) -> f64 {
        self.found.iter().map(|&(value, std)| term(value, std)).sum::<f64>() / self.found.len() as f64
    }

    /// Mean less truth.
    #[must_use]
    pub fn bias(&self) -> f64 {
        self.mean(|value, _| value) - self.truth
    }

    /// Standard deviation of the values about their mean.
    #[must_use]
    pub fn spread(&self) -> f64 {
        let (mean, n) = (self.mean(|value, _| value), self.found.len() as f64);
        (self.mean(|value, _| (value - mean).powi(2)) * n / (n - 1.0)).sqrt()
    }

    /// Root mean square of value less truth.
    #[must_use]
    pub fn rms(&self) -> f64 {
        self.mean(|value, _| (value - self.truth).powi(2)).sqrt()
    }

    /// Mean of the stated deviations.
    #[must_use]
    pub fn stated(&self) -> f64 {
        self.mean(|_, std| std)
    }

    /// Values whose error is not above this many stated deviations.
    #[must_use]
    pub fn within(&self, deviations: f64) -> usize {
        self.found.iter().filter(|(value, std)| (value - self.truth).abs() <= deviations * std).count()
    }
}

/// The report of the cases with all their outcomes.
#[must_use]
pub fn report(results: &[Examined]) -> String {
    let mut parameters = Table::new(&[
        "case",
        "logs",
        "parameter",
        "bias",
        "bias / stated",
        "empirical / stated",
        "95 % interval holds",
        "asked for",
        "met",
    ]);
    let mut logs = Table::new(&["case", "logs", "warned", "exit code 1", "errors", "said most often"]);
    let (mut held, mut stated, mut warned, mut untrusted, mut all) = (0, 0, 0, 0, 0);
    for Examined { case, outcomes } in results {
        for (row, &(name, truth)) in case.model.truth().iter().enumerate() {
            let errors = Errors::of(outcomes, name, truth);
            let (count, within) = (errors.found.len(), errors.within(NORMAL_95));
            held += within;
            stated += count;
            let (asked, right) = asked(case.noise, within, count);
            let ratio = errors.spread() / errors.stated();
            let chance = (2.0 * count as f64).sqrt().recip();
            let sharp = case.noise != Noise::White || (ratio - 1.0).abs() <= RATIO * chance;
            parameters.push(vec![
                if row == 0 { case.name.into() } else { String::new() },
                if row == 0 { outcomes.len().to_string() } else { String::new() },
                name.into(),
                format!("{:+.3} %", 100.0 * errors.bias() / truth),
                format!("{:+.2}", errors.bias() / errors.stated()),
                format!("{ratio:.2}"),
                percent(within, count),
                asked,
                met(right && sharp && count == outcomes.len()),
            ]);
        }
        let count = |exit: u8| outcomes.iter().filter(|outcome| outcome.exit == exit).count();
        let own = outcomes.iter().filter(|outcome| outcome.is_warned()).count();
        logs.push(vec![
            case.name.into(),
            outcomes.len().to_string(),
            percent(own, outcomes.len()),
            percent(count(1), outcomes.len()),
            percent(count(2), outcomes.len()),
            most_frequent(outcomes.iter().flat_map(|outcome| &outcome.said).map(|said| said.label.as_str()), 4),
        ]);
        warned += own;
        untrusted += count(1) + count(2);
        all += outcomes.len();
    }
    let mut text = format!("{parameters}\n{logs}\n");
    let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
    let _ = writeln!(
        text,
        "All parameters together: the 95 % interval holds the truth in {} of {stated} (asked for 93 to 97 %: {}). \
         Logs that were warned about: {} of {all} (at most 5 %: {}). \
         Logs with exit code 1 or an error: {} (at most 0.5 %: {}).",
        percent(held, stated),
        met((0.93..=0.97).contains(&share(held, stated))),
        percent(warned, all),
        met(share(warned, all) <= 0.05),
        percent(untrusted, all),
        met(share(untrusted, all) <= 0.005),
    );
    text
}

/// What is asked of a coverage, and whether it is so.
fn asked(noise: Noise, within: usize, count: usize) -> (String, bool) {
    if noise == Noise::Undithered {
        let least = UNDITHERED * count as f64;
        return (format!("at least {:.0} %", 100.0 * UNDITHERED), within as f64 >= least);
    }
    let (least, greatest) = binomial_band(u32::try_from(count).unwrap_or(u32::MAX), 0.95, OUTSIDE);
    let share = |k: u32| 100.0 * f64::from(k) / count as f64;
    let inside = (least as usize..=greatest as usize).contains(&within);
    (format!("{:.1} to {:.1} %", share(least), share(greatest)), inside)
}
