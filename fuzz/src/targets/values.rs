//! Forces of models, evaluated in double precision beside exact evaluation of their terms, with parameters in which they are nonlinear.

use super::Verdict;
use super::exact::{Point, exact};
use super::models::within_budget;
use super::mutated::mutated;
use super::random::Random;
use super::random_model::{Kind, Writer};
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_runtime::Model;
use tpm_runtime::interpret::{Interpreted, Separable};
use tpm_symbolic::number::rational;

/// Roundings that a value may gather, in units of the precision times the magnitudes of its terms.
const ROUNDINGS: f64 = 64.0;

/// Points at which a model is evaluated.
const POINTS: usize = 3;

/// A model of the grammar, one in five of them changed.
pub(super) fn text(random: &mut Random) -> String {
    let text = Writer::new(random.next(), Kind::Regular).model();
    if random.below(5) == 0 { mutated(&text, random.next()) } else { text }
}

/// A model with terms in which one or two parameters are not linear, one in five of them changed.
pub(super) fn nonlinear_text(random: &mut Random) -> String {
    let text = Writer::new(random.next(), Kind::Regular).model();
    let count = 1 + random.below(2);
    let mut terms = String::new();
    for z in 0..count {
        let term = match random.below(7) {
            0 => format!("p0*tanh(dot(q0)/z{z})"),
            1 => format!("p0*sin(q0 + z{z})"),
            2 => format!("exp(-z{z}*q0^2)*p0*dot(q0)"),
            3 => format!("p0*dot(q0)/(z{z} + q0^2)"),
            4 => format!("3/2*z{z}^2*q0"),
            5 => format!("p0*cos(z{z}*q0)*q0"),
            _ => format!("p0*exp(-(dot(q0)/z{z})^2)*sign(dot(q0))"),
        };
        terms.push_str(&format!(" + {term}"));
    }
    let declared: String = (0..count).map(|z| format!("nonlinear parameter z{z} from 0.5 to 2;\n")).collect();
    let text =
        text.replacen(" = u0;", &format!("{terms} = u0;"), 1).replacen("input ", &format!("{declared}input "), 1);
    if random.below(5) == 0 { mutated(&text, random.next()) } else { text }
}

/// A number k/64 with |k| <= 192.
pub(super) fn dyadic(random: &mut Random) -> f64 {
    f64::from(u32::try_from(random.below(385)).expect("small")) / 64.0 - 3.0
}

/// Forces at some points, which must be those of the exact terms.
pub(super) fn forces(text: &str) -> Verdict {
    within_budget(text, |parsed| {
        let estimator = EstimatorSource::of(parsed).map_err(|fault| fault.headline())?;
        let separable = Separable::new(&estimator.model, &estimator.form);
        let interpreted = Interpreted::new(&estimator.model, &estimator.form);
        let model: &dyn Model<f64> = match &separable {
            Some(separable) => separable,
            None => &interpreted,
        };
        let (dims, evaluation) = (model.dims(), &estimator.plan.evaluation);
        let nonlinear: Vec<_> = estimator.model.nonlinear.iter().map(|own| own.symbol).collect();
        let linear = estimator.form.columns.len();
        assert_eq!(dims.parameters, linear + nonlinear.len(), "linear parameters, then the others");
        let known: Vec<_> = estimator.model.known_constants().collect();
        let mut random = Random(text.len() as u64);
        let mut workspace = vec![0.0; model.inverse_workspace_len()];
        let mut found = vec![0.0; dims.rows];
        for _ in 0..POINTS {
            let motion: Vec<f64> = (0..dims.motion_len()).map(|_| dyadic(&mut random)).collect();
            let constants: Vec<f64> = (0..dims.constants).map(|_| dyadic(&mut random).abs() + 0.25).collect();
            let mut parameters: Vec<f64> = (0..linear).map(|_| dyadic(&mut random)).collect();
            parameters.extend(nonlinear.iter().map(|_| 0.5 + (dyadic(&mut random).abs() / 2.0)));
            let at = |symbol| match nonlinear.iter().position(|own| *own == symbol) {
                Some(place) => parameters[linear + place],
                None => constants[known.iter().position(|own| *own == symbol).expect("a known constant")],
            };
            let all: Vec<f64> = evaluation.constants.iter().map(|&symbol| at(symbol)).collect();
            // One coordinate after the other, as exact evaluation takes the motion.
            let places = evaluation.coordinates.iter().enumerate();
            let ordered: Vec<f64> = places
                .flat_map(|(c, (_, order))| (0..=*order as usize).map(move |n| n * dims.coordinates + c))
                .map(|place| motion[place])
                .collect();
            let point = Point { estimator: &estimator, motion: &ordered, constants: &all, physical: &[] };
            if model.inverse_dynamics(&motion, &parameters, &constants, &mut workspace, &mut found).is_err() {
                return Err("the forces have no value there".to_owned());
            }
            if !found.iter().all(|force| force.is_finite()) {
                return Err("a force beyond the range of numbers".to_owned());
            }
            for (row, &force) in estimator.form.rows.iter().zip(&found) {
                let expected = point.force(row, &parameters[..linear]);
                let (value, magnitude) = (rational::to_f64(&expected.value), rational::to_f64(&expected.magnitude));
                if !magnitude.is_finite() {
                    return Err("a force beyond the range of numbers".to_owned());
                }
                let error = rational::to_f64(&rational::abs(&(exact(force) - &expected.value)));
                let most = ROUNDINGS * f64::EPSILON * magnitude;
                assert!(error <= most, "{force} is not {value}: off by {error:e}, and {most:e} is allowed\n{text}");
            }
        }
        Ok(())
    })
}
