//! The tests of a comparison.

use crate::compare::comparison::{Comparison, Difference, Direction, Family, Joint, Side, Verdict};
use crate::compare::stored::{StoredParameter, StoredResult};
use crate::compare::vantage::{Vantage, Weights};
use crate::meaning::Severity;
use std::collections::BTreeMap;
use tpm_estimate::LARGE_RESIDUAL;
use tpm_numerics::independent::independent;
use tpm_numerics::tail::{chi_squared_upper, normal_two_sided};
use tpm_numerics::{Cholesky, DMatrix, DVector, tolerance};
use tpm_report::{combination, digits};
use tpm_units::Unit;

/// A correlation of two differences above which the direction of the change is said.
const LEAST_CORRELATION: f64 = 0.9;
/// Parameters whose share of the direction is below this part of the largest are left out of it.
const LEAST_SHARE: f64 = 0.05;
/// Digits of the weights in the direction of a change.
const WEIGHT_DIGITS: usize = 3;

/// Why two results cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// Parameters of one name have units that do not agree.
    #[error(
        "the units of {} do not agree; values are never converted silently: identify both with models that declare one unit",
        .parameters.join(", ")
    )]
    Units {
        /// The parameters, each with both units.
        parameters: Vec<String>,
    },
    /// There is nothing that both results show.
    #[error("there is nothing to compare: {why}")]
    Nothing {
        /// What each result has.
        why: String,
    },
}

/// Compares two results of identifications, which are taken for independent.
///
/// # Errors
/// [`CompareError`] when units do not agree, or no parameter or combination is shown by both results.
pub fn compare(a: &StoredResult, b: &StoredResult) -> Result<Comparison, CompareError> {
    let mut linear = Tested::new(&Vantage::linear(a), &Vantage::linear(b))?;
    let both_physical = !a.physical.is_empty() && !b.physical.is_empty();
    let mut physical = match both_physical {
        true => Some(Tested::new(&Vantage::physical(a), &Vantage::physical(b))?),
        false => None,
    };
    let families = || [Some(&linear), physical.as_ref()].into_iter().flatten();
    if families().all(|family| family.family.joint.is_none()) {
        return Err(CompareError::Nothing { why: nothing_common(a, b, families().map(|family| &family.family)) });
    }
    let tests = correct([Some(&mut linear.family), physical.as_mut().map(|tested| &mut tested.family)]);
    linear.point();
    if let Some(physical) = &mut physical {
        physical.point();
    }
    let (linear, physical) = (linear.family, physical.map(|tested| tested.family));
    let families = || std::iter::once(&linear).chain(&physical);
    let mut changed: Vec<String> = Vec::new();
    for entry in families().flat_map(|family| &family.differences).filter(|entry| entry.changed) {
        if !changed.contains(&entry.name) {
            changed.push(entry.name.clone());
        }
    }
    let together = families().filter_map(|family| family.joint.as_ref()?.p_adjusted).any(|p| p < Comparison::LEVEL);
    let verdict = match (changed.is_empty(), together) {
        (false, _) => Verdict::Changed,
        (true, true) => Verdict::ChangedTogether,
        (true, false) => Verdict::NoDifference,
    };
    let warnings = warnings(a, b, families());
    Ok(Comparison {
        schema: "tpm.comparison/1",
        model_a: a.model.clone(),
        model_b: b.model.clone(),
        level: Comparison::LEVEL,
        tests,
        verdict,
        changed,
        warnings,
        linear,
        physical,
    })
}

/// What each of two results has, where nothing is shown by both.
fn nothing_common<'f>(a: &StoredResult, b: &StoredResult, families: impl Iterator<Item = &'f Family>) -> String {
    let common: Vec<String> = families
        .flat_map(|family| &family.differences)
        .filter_map(|entry| Some(format!("{} ({})", entry.name, entry.untested.as_ref()?)))
        .collect();
    if !common.is_empty() {
        return format!("no parameter is tested: {}", common.join(", "));
    }
    let names = |result: &StoredResult| {
        let names: Vec<&str> = result.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
        if names.is_empty() { "no parameters".to_string() } else { names.join(", ") }
    };
    format!("A has {}, B has {}", names(a), names(b))
}

/// A family with the covariance of what is tested in it.
struct Tested {
    family: Family,
    /// Index of the tested differences.
    tested: Vec<usize>,
    weights: Vec<Weights>,
    covariance: DMatrix<f64>,
}

impl Tested {
    fn new(a: &Vantage<'_>, b: &Vantage<'_>) -> Result<Self, CompareError> {
        let common: Vec<(&StoredParameter, &StoredParameter)> =
            a.parameters().iter().filter_map(|own| Some((own, b.parameter(&own.name)?))).collect();
        let disagreeing: Vec<String> = common
            .iter()
            .filter(|(own, other)| !units_agree(own.unit.as_deref(), other.unit.as_deref()))
            .map(|(own, other)| format!("{} ({} and {})", own.name, unit_text(own), unit_text(other)))
            .collect();
        if !disagreeing.is_empty() {
            return Err(CompareError::Units { parameters: disagreeing });
        }
        let mut weights: Vec<Weights> =
            common.iter().map(|(own, _)| Weights::from([(own.name.clone(), 1.0)])).collect();
        for shown in a.combinations().chain(b.combinations()) {
            if !weights.iter().any(|known| same(known, shown)) {
                weights.push(shown.clone());
            }
        }
        let ways: Vec<_> = weights.iter().map(|wanted| (a.coefficients(wanted), b.coefficients(wanted))).collect();
        let mut differences = Vec::with_capacity(weights.len());
        for (i, (wanted, (from_a, from_b))) in weights.iter().zip(&ways).enumerate() {
            let pair = common.get(i).copied();
            let side = |vantage: &Vantage<'_>, way: &Option<DVector<f64>>, own: Option<&StoredParameter>| Side {
                value: way.as_ref().map(|way| vantage.value(way)).or_else(|| own?.value),
                std: way.as_ref().map(|way| vantage.covariance(way, way).max(0.0).sqrt()),
                status: own.map(|own| own.status.clone()),
            };
            let lead = wanted.iter().find(|(_, weight)| **weight == 1.0).map(|(name, _)| name);
            let unit = lead.and_then(|name| a.parameter(name).or_else(|| b.parameter(name))?.unit.clone());
            differences.push(difference(
                sum(wanted),
                unit,
                side(a, from_a, pair.map(|(own, _)| own)),
                side(b, from_b, pair.map(|(_, other)| other)),
            ));
        }
        let tested: Vec<usize> = (0..differences.len()).filter(|&i| differences[i].z.is_some()).collect();
        let covariance = DMatrix::from_fn(tested.len(), tested.len(), |r, c| {
            let (r, c) = (&ways[tested[r]], &ways[tested[c]]);
            let of = |vantage: &Vantage<'_>, one: &Option<DVector<f64>>, other: &Option<DVector<f64>>| {
                one.as_ref().zip(other.as_ref()).map_or(0.0, |(one, other)| vantage.covariance(one, other))
            };
            of(a, &r.0, &c.0) + of(b, &r.1, &c.1)
        });
        let missing = |these: &Vantage<'_>, others: &Vantage<'_>| -> Vec<String> {
            let own = these.parameters().iter().filter(|own| others.parameter(&own.name).is_none());
            own.map(|own| own.name.clone()).collect()
        };
        let family =
            Family { differences, joint: None, direction: None, only_in_a: missing(a, b), only_in_b: missing(b, a) };
        let mut found = Tested { family, tested, weights, covariance };
        found.family.joint = found.together().map(|(kept, solved)| {
            let chi_squared = kept.iter().zip(solved.iter()).map(|(&k, x)| found.normalised(k) * x).sum();
            let p = chi_squared_upper(chi_squared, kept.len());
            Joint { chi_squared, degrees_of_freedom: kept.len(), p, p_adjusted: None }
        });
        Ok(found)
    }

    /// A tested difference in its deviations.
    fn normalised(&self, k: usize) -> f64 {
        self.family.differences[self.tested[k]].z.unwrap_or(0.0)
    }

    fn std(&self, k: usize) -> f64 {
        self.covariance[(k, k)].sqrt()
    }

    fn correlation(&self, r: usize, c: usize) -> f64 {
        self.covariance[(r, c)] / (self.std(r) * self.std(c))
    }

    /// Which of the tested differences do not follow from others, and their correlation matrix's inverse times these differences,
    /// in deviations; nothing where none is tested.
    fn together(&self) -> Option<(Vec<usize>, DVector<f64>)> {
        let count = self.tested.len();
        let kept = independent(&DMatrix::from_fn(count, count, |r, c| self.correlation(r, c)), tolerance::GRAM);
        let own = DMatrix::from_fn(kept.len(), kept.len(), |r, c| self.correlation(kept[r], kept[c]));
        let normalised = DVector::from_iterator(kept.len(), kept.iter().map(|&k| self.normalised(k)));
        let factor = Cholesky::new(own).filter(|_| !kept.is_empty())?;
        Some((kept, factor.solve(&normalised)))
    }

    /// Says where the change lies, where there is one and differences are strongly correlated: along `V^-1 d`, which is of all
    /// combinations the one that changed by the most deviations.
    fn point(&mut self) {
        let differ = |p: Option<f64>| p.is_some_and(|p| p < Comparison::LEVEL);
        let joint = self.family.joint.as_ref().is_some_and(|joint| differ(joint.p_adjusted));
        if !(joint || self.family.differences.iter().any(|entry| entry.changed)) {
            return;
        }
        let Some((kept, shares)) = self.together() else { return };
        let pairs = kept.iter().flat_map(|&r| kept.iter().filter(move |&&c| c < r).map(move |&c| (r, c)));
        let correlation = pairs.map(|(r, c)| self.correlation(r, c).abs()).fold(0.0, f64::max);
        let largest = shares.amax();
        if correlation < LEAST_CORRELATION || largest == 0.0 {
            return;
        }
        let counted: Vec<(usize, f64)> = kept
            .iter()
            .zip(shares.iter())
            .filter(|(_, share)| share.abs() >= LEAST_SHARE * largest)
            .map(|(&k, share)| (k, *share))
            .collect();
        // The first of those that are equal but for rounding.
        let leads = |share: f64| share.abs() >= (1.0 - tolerance::COMPONENT) * largest;
        let Some(&(lead, of_lead)) = counted.iter().find(|(_, share)| leads(*share)) else { return };
        // A share is a weight times the deviation of its difference.
        let weight = |k: usize, share: f64| share / self.std(k) / (of_lead / self.std(lead));
        let mut terms = Weights::new();
        let (mut change, mut variance) = (0.0, 0.0);
        for &(k, share) in &counted {
            for (name, part) in &self.weights[self.tested[k]] {
                *terms.entry(name.clone()).or_default() += weight(k, share) * part;
            }
            change += weight(k, share) * self.normalised(k) * self.std(k);
            for &(other, of_other) in &counted {
                variance += weight(k, share) * weight(other, of_other) * self.covariance[(k, other)];
            }
        }
        let std = variance.max(0.0).sqrt();
        self.family.direction = Some(Direction {
            combination: led_by(&terms),
            unit: self.family.differences[self.tested[lead]].unit.clone(),
            difference: change,
            std,
            z: change / std,
            correlation,
        });
    }
}

/// A combination as a sum for reading.
fn sum(weights: &Weights) -> String {
    let terms: BTreeMap<String, String> =
        weights.iter().map(|(name, weight)| (name.clone(), weight.to_string())).collect();
    combination(&terms)
}

/// A combination as a sum for reading, the parameter of weight one first, the other weights to [`WEIGHT_DIGITS`].
fn led_by(weights: &Weights) -> String {
    let (lead, others): (Weights, Weights) =
        weights.iter().map(|(name, weight)| (name.clone(), *weight)).partition(|(_, weight)| *weight == 1.0);
    let mut text = sum(&lead);
    for (name, weight) in others {
        let (sign, size) = (if weight < 0.0 { '-' } else { '+' }, digits(weight.abs(), WEIGHT_DIGITS));
        text.push_str(&format!(" {sign} {size} {name}"));
    }
    text
}

/// Whether two combinations have the same weights.
fn same(one: &Weights, other: &Weights) -> bool {
    let agree = |(a, b): (&f64, &f64)| (a - b).abs() <= tolerance::STORED * a.abs().max(b.abs());
    one.keys().eq(other.keys()) && one.values().zip(other.values()).all(agree)
}

fn difference(name: String, unit: Option<String>, a: Side, b: Side) -> Difference {
    let mut entry = Difference {
        name,
        unit,
        a,
        b,
        difference: None,
        std: None,
        z: None,
        p: None,
        p_adjusted: None,
        changed: false,
        untested: None,
    };
    entry.difference = entry.b.value.zip(entry.a.value).map(|(b, a)| b - a);
    let missing = |side: &Side| {
        side.std.is_none().then(|| if side.value.is_some() { "held at a bound in" } else { "not shown by" })
    };
    entry.untested = match (missing(&entry.a), missing(&entry.b)) {
        (Some(_), Some(_)) => Some("shown by neither".to_string()),
        (Some(how), None) => Some(format!("{how} A")),
        (None, Some(how)) => Some(format!("{how} B")),
        (None, None) => None,
    };
    let (Some(change), Some(of_a), Some(of_b)) = (entry.difference, entry.a.std, entry.b.std) else { return entry };
    let std = of_a.hypot(of_b);
    entry.std = Some(std);
    if std > 0.0 {
        let z = change / std;
        entry.z = Some(z);
        entry.p = Some(normal_two_sided(z));
    } else {
        let how = if change == 0.0 { "held at one value" } else { "held at different values" };
        entry.untested = Some(how.to_string());
    }
    entry
}

/// Corrects the p-values of all tests by Holm's method, and gives their number: the j-th smallest of m, from 0, times m - j, and none
/// below a smaller one.
fn correct(families: [Option<&mut Family>; 2]) -> usize {
    let mut tests: Vec<(f64, &mut Option<f64>, Option<&mut bool>)> = Vec::new();
    for family in families.into_iter().flatten() {
        let before = tests.len();
        for entry in &mut family.differences {
            if let Some(p) = entry.p {
                tests.push((p, &mut entry.p_adjusted, Some(&mut entry.changed)));
            }
        }
        // The joint test of a single difference would only repeat that of the difference.
        if let Some(joint) = family.joint.as_mut().filter(|_| tests.len() > before + 1) {
            tests.push((joint.p, &mut joint.p_adjusted, None));
        }
    }
    let count = tests.len();
    tests.sort_by(|x, y| x.0.total_cmp(&y.0));
    let mut least = 0.0_f64;
    for (rank, (p, adjusted, changed)) in tests.into_iter().enumerate() {
        least = least.max((p * (count - rank) as f64).min(1.0));
        *adjusted = Some(least);
        if let Some(changed) = changed {
            *changed = least < Comparison::LEVEL;
        }
    }
    count
}

fn unit_text(parameter: &StoredParameter) -> &str {
    parameter.unit.as_deref().unwrap_or("without a unit")
}

/// Whether two units are one, however they are written. A parameter without a unit is not compared with one that has a unit.
fn units_agree(one: Option<&str>, other: Option<&str>) -> bool {
    match (one, other) {
        (Some(one), Some(other)) => {
            one == other || Unit::parse(one).is_some_and(|unit| Some(unit) == Unit::parse(other))
        }
        (one, other) => one.is_none() && other.is_none(),
    }
}

fn warnings<'f>(a: &StoredResult, b: &StoredResult, families: impl Iterator<Item = &'f Family>) -> Vec<String> {
    let mut said = Vec::new();
    let models = [a, b].map(StoredResult::described_model);
    if models[0] != models[1] {
        said.push(format!(
            "the models differ: {} and {}; parameters of one name need not mean one thing",
            models[0], models[1]
        ));
    }
    for log in &a.provenance.logs {
        if let Some(other) = b.provenance.logs.iter().find(|other| other.hash == log.hash) {
            said.push(format!(
                "both results use the same data ({} and {}): they are not independent, and the p-values do not hold",
                log.path, other.path
            ));
        }
    }
    let simulated = |result: &StoredResult| result.source.as_deref() == Some("simulated_plant");
    if let (Some(seed), true) = (a.provenance.seed, simulated(a) && simulated(b))
        && Some(seed) == b.provenance.seed
    {
        said.push(format!(
            "both results are of simulations with seed {seed}: their noise is the same, so that they are not independent, and the p-values do not hold"
        ));
    }
    for (which, result) in [("A", a), ("B", b)] {
        if let Some(residual) = result.residual.filter(|residual| *residual > LARGE_RESIDUAL) {
            said.push(format!(
                "{which}: {:.1} % is not explained by the model; its deviations are not to be trusted",
                100.0 * residual
            ));
        }
        for (i, text) in result.warnings.iter().enumerate() {
            // Files of the first schema, and old ones of the second, do not say how grave their warnings are.
            let finding = result.findings.get(i);
            let repeated = finding.is_some_and(|finding| finding.kind == "unexplained");
            let severity = finding.and_then(|finding| finding.severity);
            if !repeated && severity != Some(Severity::Remark) {
                said.push(format!("{which} warns, and its deviations may not hold: {text}"));
            }
        }
    }
    let held = families.flat_map(|family| &family.differences).filter(|entry| {
        let frozen = |side: &Side| side.status.as_deref() == Some("frozen");
        frozen(&entry.a) && frozen(&entry.b) && entry.difference.is_some_and(|change| change != 0.0)
    });
    for entry in held {
        said.push(format!(
            "{} is held at different values: differences of other parameters may come from that",
            entry.name
        ));
    }
    said
}
