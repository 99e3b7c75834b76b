//! What may be said of a result: the one rule from estimates and findings to statuses and to whether a result is complete.
//!
//! An estimate states values with their covariance, and of every parameter whether the data show it ([`Status`] by its evidence). A
//! finding ([`Warning`]) is what else was noticed. [`Warning::meaning`] has one row for every kind of finding: how grave it is, what it is
//! about, and which parameters it concerns. [`judge`] puts both together, once, when the result is made. Text, JSON, pages, exit codes and
//! the Python module read what it says; none of them decides anything.

use crate::identification::{Identification, Source};
use crate::meaning::{Concern, Severity};
use crate::warning::Warning;
use tpm_estimate::{ParameterReport, Status, no_result};

/// What may be said of a result.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Verdict {
    /// Of every parameter in which the model is linear.
    pub(super) parameters: Vec<Status>,
    /// Of every physical parameter.
    pub(super) physical: Vec<Status>,
    /// Why the result is not all that was asked for; nothing when it is.
    pub(super) shortfall: Option<String>,
}

/// What may be said of a result, given what its data show of the parameters and everything that was noticed.
pub(super) fn judge(result: &Identification) -> Verdict {
    let distrusted: Vec<Concern<'_>> = (result.warnings.iter())
        .map(Warning::meaning)
        .filter(|meaning| meaning.severity == Severity::Distrust)
        .map(|meaning| meaning.concern)
        .collect();
    let touches = |name: &str| !result.is_explained() || distrusted.iter().any(|concern| concern.includes(name));
    let statuses = |reports: &[ParameterReport], touched: &dyn Fn(&str) -> bool| -> Vec<Status> {
        reports.iter().map(|report| report.status.in_result(!touched(&report.name))).collect()
    };
    // Physical parameters follow from all lumped ones together.
    let lumped = result.parameters.iter().any(|report| {
        let is_physical = result.physical.iter().any(|own| own.name == report.name);
        !is_physical && touches(&report.name)
    });
    let parameters = statuses(&result.parameters, &touches);
    let physical = statuses(&result.physical, &|name| lumped || touches(name));
    let shortfall = shortfall(result, if result.physical.is_empty() { &parameters } else { &physical });
    Verdict { parameters, physical, shortfall }
}

/// Why a result is not all that was asked for; nothing when it is. `statuses` are those of the parameters that were asked for.
fn shortfall(result: &Identification, statuses: &[Status]) -> Option<String> {
    // A residual that is too large is said last: other findings name its cause.
    let mut named = result.warnings.iter().filter(|warning| !matches!(warning, Warning::Unexplained { .. }));
    if let Some(untrusted) = named.find(|warning| warning.is_distrust()) {
        return Some(untrusted.to_string());
    }
    if result.source != Source::Log && result.outcome.is_none() {
        return Some("not everything was identified: the campaign is not finished".to_string());
    }
    if !result.is_explained() {
        let by_rows = result.log.as_ref().and_then(|log| log.prediction()?.by_rows());
        let whole = no_result(result.residual, result.residual_of);
        return Some(match by_rows {
            Some(by_rows) => format!("{whole}: {by_rows}"),
            None => whole,
        });
    }
    if let Some(unexplained) = result.warnings.iter().find(|warning| warning.is_distrust()) {
        return Some(unexplained.to_string());
    }
    let Some(outcome) = result.outcome.filter(|_| result.source != Source::Log) else {
        let rank = result.rank;
        return (rank < result.wanted())
            .then(|| format!("the data determine {rank} independent combinations of the parameters, not all of them"));
    };
    // A campaign is asked for a model that explains its runs: what it leaves is no remark, even where deviations contain what it does.
    if let Some(misfit) = result.warnings.iter().find(|warning| warning.meaning().severity == Severity::Misfit) {
        return Some(misfit.to_string());
    }
    // Where there are physical parameters the lumped ones are means to an end.
    let wanted = if result.physical.is_empty() { &result.parameters } else { &result.physical };
    let known = |status: &Status| matches!(status, Status::Identified | Status::Frozen);
    let open = wanted.iter().zip(statuses).filter(|(_, status)| !known(status));
    let open: Vec<&str> = open.map(|(parameter, _)| parameter.name.as_str()).collect();
    let whole = open.is_empty() && result.estimate.is_some() && outcome.is_normal();
    (!whole).then(|| match (outcome.is_normal(), open.is_empty()) {
        // A campaign that went as planned is no reason: its runs are what shows too little.
        (true, false) => format!("not everything was identified: the runs do not show {}", open.join(", ")),
        _ => format!("not everything was identified: {}", outcome.describe()),
    })
}

impl Identification {
    /// The result with something more that was noticed, judged again: for programs that know more of the machine than its data say.
    #[must_use]
    pub fn with_finding(mut self, finding: Warning) -> Self {
        self.warnings.push(finding);
        self.judged()
    }

    /// The result as it may be handed out: judged, once, when all that was noticed is in it.
    pub(super) fn judged(mut self) -> Self {
        let Verdict { parameters, physical, shortfall } = judge(&self);
        for (report, status) in self.parameters.iter_mut().zip(parameters) {
            report.status = status;
        }
        for (report, status) in self.physical.iter_mut().zip(physical) {
            report.status = status;
        }
        self.shortfall = shortfall;
        self
    }
}
