//! The page of a study over many seeds.

use crate::block::{Block, Cell, Notice};
use crate::marks::Interval;
use crate::page::{Caution, Document};
use tpm_report::{beside, cells, digits, or_dash};
use tpm_study::{ParameterStudy, Study};

/// Significant digits of spread, stated deviation and bound, which are compared with each other.
const SPREAD_DIGITS: usize = 3;

impl From<&Study> for Document {
    /// Bias, spread and coverage of the intervals over many campaigns.
    fn from(study: &Study) -> Self {
        let incomplete = &study.incomplete_seeds;
        let mut document = Document {
            title: study.model.clone(),
            subtitle: format!("{} campaigns on a simulated machine, seeds from {}", study.campaigns, study.first_seed),
            issue: None,
            conclusion: Vec::new(),
            short: "Not complete",
            shortfall: (!incomplete.is_empty())
                .then(|| format!("{} of {} campaigns did not identify everything", incomplete.len(), study.campaigns)),
            success: "Every campaign identified everything.".to_owned(),
            caution: Caution::of_warnings(!study.warnings.is_empty()),
            facts: vec![
                ("campaigns".to_owned(), Cell::text(study.campaigns.to_string())),
                ("estimator".to_owned(), Cell::text(study.estimator)),
            ],
            sections: Vec::new(),
            figures: Vec::new(),
        };
        let warning = |text: &String| Notice { text: text.clone(), remedy: None, grave: false };
        let list: Vec<Notice> = study.warnings.iter().map(warning).collect();
        if !list.is_empty() {
            document.section("warnings", "Warnings", vec![Block::Notices { list }]);
        }
        let columns = [
            "parameter",
            "unit",
            "#true",
            "#mean",
            "#bias",
            "#± of the bias",
            "#spread",
            "#stated",
            "#bound",
            "#95 % held",
            "#of",
            "mean and true value",
        ];
        let rows = study.parameters.iter().map(row).collect();
        document.section("parameters", "Parameters", vec![
            Block::table(&columns, rows, "bias and spread of the identified values over all campaigns"),
            Block::text(
                "Spread: standard deviation of the results. Stated: what the campaigns said it is. Bound: Cramer-Rao bound after the runs of the \
                 first campaign. 95 % held: share of the stated 95 % intervals that hold the true value. The strip shows the mean with its own 95 % \
                 interval, and the true value as a diamond.",
            ),
        ]);
        document
    }
}

fn row(parameter: &ParameterStudy) -> Vec<Cell> {
    let [mean, _] = cells(parameter.mean, parameter.bias_std);
    let [bias, bias_std] = cells(parameter.bias, parameter.bias_std);
    let spread = |value: Option<f64>| Cell::shown(or_dash(value, |value| digits(value, SPREAD_DIGITS)), value);
    vec![
        Cell::text(parameter.name.clone()),
        Cell::text(parameter.unit.clone().unwrap_or_else(|| "-".to_owned())),
        Cell::shown(beside(parameter.truth, parameter.mean, parameter.bias_std), Some(parameter.truth)),
        Cell::shown(mean, parameter.mean),
        Cell::shown(bias, parameter.bias),
        Cell::shown(bias_std, parameter.bias_std),
        spread(parameter.spread),
        spread(parameter.stated),
        spread(parameter.bound),
        Cell::shown(or_dash(parameter.coverage, |share| format!("{:.1} %", 100.0 * share)), parameter.coverage),
        Cell::text(parameter.values.to_string()),
        Cell::interval(Interval::of(parameter.mean, parameter.bias_std, Some(parameter.truth), None)),
    ]
}
