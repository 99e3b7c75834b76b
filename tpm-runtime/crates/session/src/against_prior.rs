//! Inertias of a mechanism beside those of its description.
//!
//! A log tells forces by what its inputs are recorded in. Where all inputs are the same multiple of the forces, inertias, friction and their
//! residuals are that multiple of themselves: no log shows it, and only what is known from elsewhere does. Descriptions give masses and their
//! moments from the drawing of every part, each with an error of its own, so that estimates which are all the same multiple of them are
//! estimates in another unit.

use crate::identification::Identification;
use crate::warning::Warning;
use tpm_numerics::Iteration;
use tpm_units::Unit;

/// Error of a description's masses and moments, as a share, each for itself.
const SPREAD: f64 = 0.2;
/// A description is that of another machine, or the inputs have another unit, where all values are more than so many times its values, or
/// less than so many parts of them.
const ANOTHER: f64 = 2.0;
/// Standard deviations of a factor within which it is no other unit, and beside which a value tells nothing of it.
const DEVIATIONS: f64 = 3.0;
/// Steps in which the factor enters its own weights, and the last change of it as a share.
const WEIGHING: Iteration = Iteration { most: 20, settled: 1e-9 };

/// Warns of masses and moments that are all the same multiple of what the description of a mechanism with these inputs says.
pub(super) fn warn_of_common_factor(result: &mut Identification, inputs: Vec<String>) {
    let one_by_one = result.parameters.iter().filter_map(|own| Some((&own.unit, own.prior?, own.value?, own.std?)));
    let together = result.combinations.iter().filter_map(|own| Some((&own.unit, own.prior?, own.value, own.std)));
    let of_bodies = one_by_one.chain(together).filter(|(unit, ..)| unit.as_deref().is_some_and(is_inertial));
    let values: Vec<[f64; 3]> = of_bodies.map(|(_, prior, value, std)| [prior, value, std]).collect();
    if let Some((factor, std, count)) = common_factor(&values) {
        result.warnings.push(Warning::CommonFactor { inputs, factor, std, count });
    }
}

/// Whether a unit is that of a mass or of a moment of one.
fn is_inertial(unit: &str) -> bool {
    let same = |own: &Unit, other: &str| Unit::parse(other).is_some_and(|other| own.same_dimension(&other));
    Unit::parse(unit).is_some_and(|own| ["kg", "kg*m", "kg*m^2"].iter().any(|other| same(&own, other)))
}

/// The factor by which all values differ from their priors, its deviation, and how many tell it; nothing where it is none that another unit
/// would make, or where they do not agree in it. Every value has its prior, itself and its deviation.
fn common_factor(values: &[[f64; 3]]) -> Option<(f64, f64, usize)> {
    let variance = |factor: f64, [prior, _, std]: [f64; 3]| std * std + (SPREAD * factor * prior).powi(2);
    let (mut factor, mut std) = (1.0_f64, f64::INFINITY);
    for _ in 0..WEIGHING.most {
        let (mut own, mut square) = (0.0, 0.0);
        for value in values {
            let variance = variance(factor, *value).max(f64::MIN_POSITIVE);
            own += value[0] * value[1] / variance;
            square += value[0] * value[0] / variance;
        }
        let before = std::mem::replace(&mut factor, own / square);
        std = 1.0 / square.sqrt();
        if (factor - before).abs() <= WEIGHING.settled * before.abs() {
            break;
        }
    }
    let tells = |value: &&[f64; 3]| (factor * value[0]).abs() > DEVIATIONS * value[2];
    let count = values.iter().filter(tells).count();
    let apart: f64 = values.iter().map(|own| (own[1] - factor * own[0]).powi(2) / variance(factor, *own)).sum();
    // The expected value of a sum of squares and two of its deviations.
    let freedom = values.len() as f64 - 1.0;
    let agree = apart <= freedom + 2.0 * (2.0 * freedom).sqrt();
    let another = factor > ANOTHER + DEVIATIONS * std || factor > 0.0 && factor + DEVIATIONS * std < 1.0 / ANOTHER;
    (count >= 2 && agree && another && factor > DEVIATIONS * std).then_some((factor, std, count))
}

#[cfg(test)]
mod tests {
    use super::{common_factor, is_inertial};
    use crate::arm_log;
    use crate::identification::Identification;
    use crate::log::{LogRequest, from_log};
    use crate::model::{DeclaredModel, Identifiable as _};
    use crate::warning::Warning;
    use tpm_controller::harmonics::Hold;

    const ARM: &str = "model Arm {
        coordinate q1 [rad], q2 [rad]; input u1 [N*m], u2 [N*m];
        mechanism {
            gravity (0, 0, -9.81);
            body upper { revolute q1 about y; inertia parameters; }
            body lower on upper { revolute q2 about y at (0.4, 0, 0); inertia parameters; }
            drive q1 by u1 with viscous; drive q2 by u2 with viscous;
        }
    }";
    const BODIES: [(&str, f64); 7] = [
        ("mx_upper", 0.67),
        ("mz_upper", 0.05),
        ("Iyy_upper", 0.2),
        ("m_lower", 1.9),
        ("mx_lower", 0.3),
        ("mz_lower", -0.02),
        ("Iyy_lower", 0.076),
    ];

    /// What a log says whose torques are recorded as so many times what they are, where the description gives so many times the truth.
    fn identified(recorded: f64, described: f64) -> Identification {
        let arm = DeclaredModel::parse("Arm", ARM).expect("a model");
        let model = arm.evaluated();
        let value = |name: &str| BODIES.iter().find(|(own, _)| *own == name).map_or(0.5, |(_, value)| *value);
        let truth: Vec<f64> = (0..model.dims().parameters).map(|j| value(model.parameter(j).name)).collect();
        let file = arm_log::log(&arm, &truth, 0.0, [recorded; 2]);
        let mut request = LogRequest::new(file.path()).hold(Hold::None);
        request.estimation.prior = BODIES.iter().map(|(name, own)| ((*name).to_owned(), described * own)).collect();
        from_log(&arm, request).expect("identifies")
    }

    #[test]
    fn torques_in_another_unit_are_told_by_the_description() {
        let said = |recorded: f64, described: f64| {
            let found = identified(recorded, described);
            let factor = found.warnings.iter().find_map(|warning| match warning {
                Warning::CommonFactor { factor, std, .. } => Some((*factor, *std)),
                _ => None,
            });
            (factor, found.is_complete())
        };
        let (factor, trusted) = said(0.08, 1.0);
        let (factor, std) = factor.expect("a common factor");
        assert!((factor - 0.08).abs() < 3.0 * std && std < 0.02 && !trusted, "{factor} +- {std}");
        assert_eq!(said(1.0, 1.0), (None, true));
        assert_eq!(said(1.0, 1.3), (None, true));
    }

    #[test]
    fn values_in_another_unit_are_told_from_a_description_that_is_wrong() {
        let description = [4.0, -0.7, 0.05, 1.9, 0.3];
        let with = |factor: f64, errors: [f64; 5]| -> Vec<[f64; 3]> {
            description.iter().zip(errors).map(|(own, e)| [*own, factor * own * (1.0 + e), 0.01 * factor]).collect()
        };
        let errors = [0.2, -0.15, 0.1, -0.2, 0.05];
        let (factor, std, count) = common_factor(&with(0.08, errors)).expect("amperes");
        assert!((factor - 0.08).abs() < 3.0 * std && std < 0.01 && count == 5, "{factor} {std} {count}");
        assert!(common_factor(&with(12.0, errors)).is_some());
        // Right, or wrong by what descriptions are, or every value by another factor.
        assert_eq!(common_factor(&with(1.0, errors)), None);
        assert_eq!(common_factor(&with(1.4, errors)), None);
        assert_eq!(common_factor(&with(0.3, [1.0, -0.5, 2.0, 0.0, -0.8])), None);
        // One value says nothing of a common factor, nor do values that are lost in their deviations.
        assert_eq!(common_factor(&[[4.0, 0.3, 0.001]]), None);
        assert_eq!(common_factor(&[[4.0, 0.3, 0.5], [2.0, 0.15, 0.5]]), None);
        assert_eq!(common_factor(&[]), None);
        assert_eq!(common_factor(&[[0.0, 0.3, 0.1], [0.0, 0.2, 0.1]]), None);
    }

    #[test]
    fn masses_and_their_moments_are_inertial() {
        for unit in ["kg", "kg*m", "kg*m^2", "g*mm^2", "N*s^2/m"] {
            assert!(is_inertial(unit), "{unit}");
        }
        for unit in ["N*m", "N*m*s", "m", "1", "nonsense"] {
            assert!(!is_inertial(unit), "{unit}");
        }
    }
}
