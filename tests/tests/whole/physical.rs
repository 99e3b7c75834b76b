//! Lumped parameters of two carts back to masses and springs: exactly, under noise, and where no machine explains them.

use crate::support::model;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;
use tpm_runtime::estimate::{Estimate, ResidualOf, Status};
use tpm_runtime::numerics::Matrix;
use tpm_runtime::physical::{Physical, PhysicalError, PhysicalSettings, physical};
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::{Prepared, prepare};

/// m1, m2, k1, k2, k3.
const TRUTH: [f64; 5] = [2.0, 1.5, 30.0, 400.0, 2000.0];

fn two_carts() -> Prepared {
    prepare(model("two_carts")).expect("can be eliminated")
}

fn lumped(prepared: &Prepared, truth: &[f64]) -> Vec<f64> {
    let map = ParameterMap::new(prepared);
    map.evaluate(|symbol| truth[map.parameters().iter().position(|own| *own == symbol).expect("a parameter")])
}

/// Standard deviations of one part in a thousand, with correlation.
fn covariance(values: &[f64]) -> DMatrix<f64> {
    let n = values.len();
    let factor = DMatrix::from_fn(n, n, |r, c| {
        let scale = 1e-3 * values[r].abs();
        if r == c {
            scale
        } else if c < r {
            scale * 0.5 * ((r * 3 + c) as f64).sin()
        } else {
            0.0
        }
    });
    &factor * factor.transpose()
}

fn estimate(values: Vec<f64>, covariance: DMatrix<f64>) -> Estimate {
    let n = values.len();
    let rows: Vec<Vec<f64>> = covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
    Estimate {
        std: (0..n).map(|j| covariance[(j, j)].sqrt()).collect(),
        values,
        covariance: Matrix::from_rows(&rows).expect("rows of one length"),
        status: vec![Status::Identified; n],
        rank: n,
        unobservable: Vec::new(),
        scales: Vec::new(),
        condition: 1.0,
        residual: 0.0,
        residual_of: ResidualOf::Force,
        chi_squared: 1.0,
        model_error: Vec::new(),
    }
}

fn solve(values: Vec<f64>) -> Physical {
    let prepared = two_carts();
    let covariance = covariance(&values);
    physical(&prepared, &estimate(values, covariance), &PhysicalSettings::default()).expect("sound settings")
}

#[test]
fn exact_lumped_parameters_give_the_machine_back() {
    let prepared = two_carts();
    let found = solve(lumped(&prepared, &TRUTH));
    for (parameter, truth) in found.parameters.iter().zip(TRUTH) {
        let value = parameter.value.expect("identified");
        assert!((value / truth - 1.0).abs() < 1e-9, "{parameter:?}");
        assert_eq!(parameter.status, Status::Identified);
    }
    assert_eq!((found.rank, found.freedom), (5, 2));
    assert!(found.misfit < 1e-12 && found.remarks.is_empty(), "{found:?}");
}

/// The stated standard deviations are the spread of many estimates, and the misfit that of chance.
#[test]
fn standard_deviations_are_the_spread() {
    let prepared = two_carts();
    let exact = lumped(&prepared, &TRUTH);
    let covariance = covariance(&exact);
    let factor = covariance.clone().cholesky().expect("positive").l();
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let draws = 400;
    let (mut inside, mut misfits) = (0, 0.0);
    for _ in 0..draws {
        let noise = DVector::from_fn(exact.len(), |_, _| StandardNormal.sample(&mut random));
        let values: Vec<f64> = exact.iter().zip((&factor * noise).iter()).map(|(c, e)| c + e).collect();
        let found = physical(&prepared, &estimate(values, covariance.clone()), &PhysicalSettings::default());
        let found = found.expect("sound settings");
        misfits += found.misfit;
        for (parameter, truth) in found.parameters.iter().zip(TRUTH) {
            let (value, std) = (parameter.value.expect("identified"), parameter.std.expect("identified"));
            inside += usize::from((value - truth).abs() < 1.96 * std);
        }
    }
    let coverage = inside as f64 / (5 * draws) as f64;
    assert!((0.93..0.97).contains(&coverage), "{coverage}");
    // Two relations: a sum of squares of two normal variables.
    let mean = misfits / draws as f64;
    assert!((1.7..2.3).contains(&mean), "{mean}");
}

/// Where lumped parameters are hardly known, physical ones are quotients of what may vanish, and masses reach their bounds.
#[test]
fn deviations_hold_where_lumped_parameters_are_hardly_known() {
    let prepared = two_carts();
    let exact = lumped(&prepared, &TRUTH);
    let covariance = covariance(&exact) * (300.0_f64).powi(2);
    let factor = covariance.clone().cholesky().expect("positive").l();
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let draws = 200;
    let (mut far, mut stated) = (0, 0);
    for _ in 0..draws {
        let noise = DVector::from_fn(exact.len(), |_, _| StandardNormal.sample(&mut random));
        let values: Vec<f64> = exact.iter().zip((&factor * noise).iter()).map(|(c, e)| c + e).collect();
        let found = physical(&prepared, &estimate(values, covariance.clone()), &PhysicalSettings::default());
        for (parameter, truth) in found.expect("sound settings").parameters.iter().zip(TRUTH) {
            if let (Some(value), Some(std)) = (parameter.value, parameter.std) {
                stated += 1;
                far += usize::from((value - truth).abs() > 4.0 * std);
            }
        }
    }
    assert!(stated > 3 * draws && far <= stated / 100, "{far} of {stated}");
}

#[test]
fn parameters_of_no_such_machine_are_flagged() {
    let prepared = two_carts();
    let mut values = lumped(&prepared, &TRUTH);
    values[3] *= 1.02;
    let found = solve(values);
    assert!(found.remarks.iter().any(|remark| remark.to_string().contains("not those of any machine")), "{found:?}");
}

#[test]
fn a_mass_stays_at_its_bound() {
    let prepared = two_carts();
    // m1 = c1/rho: a negative c1 asks for a negative mass.
    let mut values = lumped(&prepared, &TRUTH);
    let sharp = covariance(&values);
    values[0] = -values[0] * 0.01;
    let found = physical(&prepared, &estimate(values.clone(), sharp.clone()), &PhysicalSettings::default());
    let found = found.expect("sound settings");
    assert_eq!((found.parameters[0].name.as_str(), found.parameters[0].value), ("m1", Some(0.0)));
    assert_eq!(found.parameters[0].status, Status::PoorlyDetermined);
    assert!(
        found.remarks.iter().any(|remark| remark.to_string().contains("m1 is held at its bound 0")),
        "{:?}",
        found.remarks
    );
    // The minimum is one: no parameter can move and do better, as trials around it show.
    let map = ParameterMap::new(&prepared);
    let weight = sharp.cholesky().expect("positive");
    let misfit = |p: &[f64]| {
        let at = lumped(&prepared, p);
        let off = DVector::from_fn(at.len(), |j, _| at[j] - values[j]);
        off.dot(&weight.solve(&off))
    };
    let best: Vec<f64> = found.parameters.iter().map(|p| p.value.expect("has a value")).collect();
    assert!((misfit(&best) - found.misfit).abs() < 1e-6 * found.misfit);
    assert_eq!(map.parameters().len(), best.len());
    for i in 0..best.len() {
        for factor in [0.999, 1.001] {
            let mut trial = best.clone();
            trial[i] = if i == 0 { 1e-3 * factor } else { trial[i] * factor };
            assert!(misfit(&trial) > found.misfit, "parameter {i}");
        }
    }
    // Without the bound the mass goes below zero.
    let open = PhysicalSettings {
        bounds: BTreeMap::from([("m1".to_owned(), (f64::NEG_INFINITY, f64::INFINITY))]),
        ..PhysicalSettings::default()
    };
    let values_open = physical(&prepared, &estimate(values.clone(), covariance(&values)), &open).expect("sound");
    assert!(values_open.parameters[0].value.expect("has a value") < 0.0);
}

#[test]
fn what_the_lumped_parameters_do_not_show_is_not_invented() {
    // Only c1 + c2 is seen of the two: five physical parameters hang on six combinations, all still determined. Without c6
    // and c7 they are not.
    let prepared = two_carts();
    let exact = lumped(&prepared, &TRUTH);
    let n = exact.len();
    let hidden: Vec<Vec<f64>> =
        [1, 2, 3, 4, 5].iter().map(|&j| (0..n).map(|i| if i == j { 1.0 } else { 0.0 }).collect()).collect();
    let mut shown = covariance(&exact);
    for j in [1, 2, 3, 4, 5] {
        shown.row_mut(j).fill(0.0);
        shown.column_mut(j).fill(0.0);
    }
    let mut estimate = estimate(exact.clone(), shown);
    for (j, direction) in [1, 2, 3, 4, 5].iter().zip(&hidden) {
        assert_eq!(direction[*j], 1.0);
        estimate.std[*j] = f64::INFINITY;
        estimate.status[*j] = Status::Unobservable;
    }
    estimate.unobservable = hidden;
    estimate.rank = 2;
    let found = physical(&prepared, &estimate, &PhysicalSettings::default()).expect("sound settings");
    assert_eq!((found.rank, found.freedom), (2, 0));
    // c7 = k2 is known; the rest of the machine is not.
    let known: Vec<(&str, &str)> = found.parameters.iter().map(|p| (p.name.as_str(), p.status.name())).collect();
    assert_eq!(known[3], ("k2", "identified"));
    assert!(
        known.iter().filter(|(name, _)| *name != "k2" && *name != "k1").all(|(_, s)| *s == "unobservable"),
        "{known:?}"
    );
    assert!(
        found
            .parameters
            .iter()
            .filter(|p| p.status == Status::Unobservable)
            .all(|p| p.value.is_none() && p.std.is_none())
    );
}

#[test]
fn settings_are_checked() {
    let prepared = two_carts();
    let exact = lumped(&prepared, &TRUTH);
    let estimate = estimate(exact.clone(), covariance(&exact));
    let frozen = PhysicalSettings { frozen: BTreeMap::from([("m2".to_owned(), 1.5)]), ..PhysicalSettings::default() };
    let found = physical(&prepared, &estimate, &frozen).expect("sound settings");
    assert_eq!((found.parameters[1].status, found.parameters[1].value, found.freedom), (Status::Frozen, Some(1.5), 3));
    let unknown = PhysicalSettings { prior: BTreeMap::from([("mass".to_owned(), 1.0)]), ..PhysicalSettings::default() };
    assert!(matches!(physical(&prepared, &estimate, &unknown), Err(PhysicalError::Unknown { .. })));
    let empty =
        PhysicalSettings { bounds: BTreeMap::from([("m2".to_owned(), (2.0, 1.0))]), ..PhysicalSettings::default() };
    assert!(matches!(physical(&prepared, &estimate, &empty), Err(PhysicalError::EmptyBounds { .. })));
}
