//! The table of estimates: values with their deviations, intervals, priors and true values.

use crate::block::{Block, Cell};
use crate::marks::Interval;
use tpm_estimate::{CombinationReport, ParameterReport, WrittenCombination};
use tpm_numerics::tail::NORMAL_95;
use tpm_report::{beside, cells, combination, number, or_dash};

/// One row of a table of estimates.
pub(super) struct Estimated<'a> {
    name: String,
    unit: Option<&'a str>,
    prior: Option<f64>,
    value: Option<f64>,
    std: Option<f64>,
    truth: Option<f64>,
    remark: String,
}

impl<'a> From<&'a ParameterReport> for Estimated<'a> {
    fn from(own: &'a ParameterReport) -> Self {
        let status = own.status.name().replace('_', " ");
        let remark = own
            .with_prior
            .map_or_else(|| status.clone(), |value| format!("{status}; {} with the prior", number(value)));
        Estimated {
            name: own.name.clone(),
            unit: own.unit.as_deref(),
            prior: own.prior,
            value: own.value,
            std: own.std,
            truth: own.truth,
            remark,
        }
    }
}

impl<'a> From<&'a CombinationReport> for Estimated<'a> {
    fn from(own: &'a CombinationReport) -> Self {
        let WrittenCombination { name, unit, prior, value, truth } = own.written(combination);
        Estimated { name, unit, prior, value: Some(value), std: Some(own.std), truth, remark: String::new() }
    }
}

pub(super) fn estimates(of: &str, rows: &[Estimated<'_>], caption: &str) -> Block {
    let simulated = rows.iter().any(|row| row.truth.is_some());
    let priors = rows.iter().any(|row| row.prior.is_some());
    let remarks = rows.iter().any(|row| !row.remark.is_empty());
    // An interval is drawn only where there is a true value or a prior to compare it with.
    let drawn = simulated || priors;
    let mut columns = vec![of, "unit", "#identified", "#std. dev."];
    columns.extend(if drawn { &["95 % interval", "#from", "#to"][..] } else { &["#95 % from", "#to"] });
    columns.extend(priors.then_some(["#prior", "#difference/std"]).into_iter().flatten());
    columns.extend(simulated.then_some(["#true", "#error/std"]).into_iter().flatten());
    columns.extend(remarks.then_some("status"));
    let line = |row: &Estimated<'_>| {
        let [value, std] = cells(row.value, row.std);
        let known = row.value.zip(row.std.filter(|std| std.is_finite() && *std > 0.0));
        let end = |side: f64| {
            let end = known.map(|(value, std)| value + side * NORMAL_95 * std);
            Cell::shown(or_dash(end, |end| beside(end, row.value, row.std)), end)
        };
        let mut line = vec![
            Cell::text(row.name.clone()),
            Cell::text(row.unit.unwrap_or("-")),
            Cell::shown(value, row.value),
            Cell::shown(std, row.std),
        ];
        line.extend(drawn.then(|| Cell::interval(Interval::of(row.value, row.std, row.truth, row.prior))));
        line.extend([end(-1.0), end(1.0)]);
        let apart = |from: Option<f64>| {
            let apart = known.zip(from).map(|((value, std), from)| (value - from) / std);
            Cell::shown(or_dash(apart, |apart| format!("{apart:+.2}")), apart)
        };
        if priors {
            line.extend([Cell::number(row.prior), apart(row.prior)]);
        }
        if simulated {
            line.push(Cell::shown(or_dash(row.truth, |truth| beside(truth, row.value, row.std)), row.truth));
            line.push(apart(row.truth));
        }
        line.extend(remarks.then(|| Cell::text(row.remark.clone())));
        line
    };
    Block::table(&columns, rows.iter().map(line).collect(), caption)
}
