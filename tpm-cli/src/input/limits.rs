//! Limits within which a campaign chooses its motions.

use crate::failure::Failure;
use crate::input::assignments::{assignment, once};
use std::collections::BTreeMap;
use tpm_runtime::experiment::ByLimits;
use tpm_runtime::log::unit_of;

/// Options of a campaign that chooses its motions.
#[derive(clap::Args)]
pub(crate) struct LimitArgs {
    /// Let the campaign choose its motions within limits: a coordinate by name, its rate as dot(NAME) or dNAME, its acceleration as ddot(NAME), an
    /// input. Several with commas between them. An experiment beside the model still states what it states; none is needed.
    #[arg(long, value_name = "NAME=VALUE|LOW:HIGH", value_delimiter = ',', value_parser = limit, requires = "time")]
    limit: Vec<(String, (f64, f64))>,
    /// Time for which the machine may move, such as 10min, 90s or 1h; seconds without a unit.
    #[arg(long = "for", id = "time", value_name = "TIME", value_parser = duration, requires = "limit")]
    time: Option<f64>,
    /// End when parameters are known so well: NAME=PERCENT, or PERCENT for every parameter, such as m=1% or 2%.
    #[arg(long, value_name = "PERCENT|NAME=PERCENT", value_delimiter = ',', value_parser = goal, requires = "limit")]
    until: Vec<(Option<String>, f64)>,
    /// Time between samples, s; that of the experiment beside the model when not given.
    #[arg(long, value_name = "SECONDS", value_parser = duration, requires = "limit")]
    sample_time: Option<f64>,
}

impl LimitArgs {
    /// What is asked for; nothing where no limit is stated.
    pub(crate) fn request(&self) -> Result<Option<ByLimits>, Failure> {
        let Some(time) = self.time.filter(|_| !self.limit.is_empty()) else { return Ok(None) };
        let named: Vec<(String, f64)> =
            self.until.iter().filter_map(|(name, share)| name.clone().map(|name| (name, *share))).collect();
        Ok(Some(ByLimits {
            limits: once("--limit", &self.limit)?,
            sample_time: self.sample_time,
            time,
            until: once("--until", &named)?.into_iter().collect::<BTreeMap<String, f64>>(),
            every: self.until.iter().rev().find(|(name, _)| name.is_none()).map(|(_, share)| *share),
        }))
    }
}

/// Parses NAME=VALUE, for both directions, or NAME=LOW:HIGH.
fn limit(text: &str) -> Result<(String, (f64, f64)), String> {
    let (name, value) = assignment(text)?;
    let finite = |text: &str| {
        let number = text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
        number.ok_or_else(|| format!("`{text}` is no finite number, in the unit of the model"))
    };
    let ends = match value.split_once(':') {
        Some((low, high)) => (finite(low)?, finite(high)?),
        None => (-finite(&value)?, finite(&value)?),
    };
    if ends.0 < ends.1 { Ok((name, ends)) } else { Err(format!("`{value}` leaves no room")) }
}

/// Parses a time with a unit, seconds without one.
fn duration(text: &str) -> Result<f64, String> {
    let split = text.find(|c: char| c.is_ascii_alphabetic() && c != 'e' && c != 'E').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let unit = if unit.trim().is_empty() { "s" } else { unit.trim() };
    let second = unit_of("s").and_then(|second| unit_of(unit)?.ratio(&second));
    let found = number.trim().parse::<f64>().ok().zip(second).map(|(value, factor)| value * factor);
    found
        .filter(|value| value.is_finite() && *value > 0.0)
        .ok_or_else(|| format!("`{text}` is no time such as 90s or 10min"))
}

/// Parses NAME=PERCENT or PERCENT.
fn goal(text: &str) -> Result<(Option<String>, f64), String> {
    let (name, value) = match text.split_once('=') {
        Some(_) => assignment(text).map(|(name, value)| (Some(name), value))?,
        None => (None, text.trim().to_owned()),
    };
    let share = match value.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().ok().map(|percent| percent / 100.0),
        None => value.parse::<f64>().ok(),
    };
    match share.filter(|share| share.is_finite() && *share > 0.0) {
        Some(share) => Ok((name, share)),
        None => Err(format!("`{value}` is no share such as 1% or 0.01")),
    }
}

#[cfg(test)]
mod tests {
    use super::{duration, goal, limit};

    #[test]
    fn limits_times_and_shares_are_read_or_refused() {
        assert_eq!(limit("x=0.3"), Ok(("x".to_owned(), (-0.3, 0.3))));
        assert_eq!(limit("dot(x)=-1:2"), Ok(("dot(x)".to_owned(), (-1.0, 2.0))));
        assert!(limit("x=-0.3").is_err() && limit("x=inf").is_err() && limit("x").is_err());
        assert_eq!(duration("10min"), Ok(600.0));
        assert_eq!(duration("2e-3"), Ok(2e-3));
        assert_eq!(duration("1 ms"), Ok(1e-3));
        assert!(duration("0").is_err() && duration("3kg").is_err() && duration("soon").is_err());
        assert_eq!(goal("m=1%"), Ok((Some("m".to_owned()), 0.01)));
        assert_eq!(goal("0.02"), Ok((None, 0.02)));
        assert!(goal("m=0").is_err() && goal("m=x").is_err());
    }
}
