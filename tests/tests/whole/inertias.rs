//! Possible inertias and loads from base parameters whose truth and covariance are known: those of a small arm, and of the UR10 where
//! `TPM_DATA` has its description.

mod arm;

use arm::{arms, noisy};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::time::Instant;
use tpm_codegen::import::{Described, Options, import_description, mjcf, with_inertials};
use tpm_codegen::source::Source;
use tpm_runtime::inertia::{InertiaError, Inertias, InertiasRequest, LoadRequest, Origin, inertias, payload};
use tpm_runtime::session::DeclaredModel;
use tpm_symbolic::mechanics::tree::{AboutCentre, NAMES};
use tpm_symbolic::number::rational::{from_f64, to_f64};

fn possible(found: &Inertias) {
    for (body, parameters) in &found.parted.bodies {
        let own = AboutCentre::of_parameters(parameters).expect("a mass");
        assert!(own.is_possible(), "{body}");
    }
    assert!(found.parted.links.values().all(|link| link.is_possible() || *link == AboutCentre::nothing()));
    for own in &found.parameters {
        let bounded = ["fv_", "fc_", "Ia_"].iter().any(|prefix| own.name.starts_with(prefix));
        assert!(!bounded || own.value >= 0.0, "{} {}", own.name, own.value);
    }
}

#[test]
fn estimates_that_no_body_has_become_possible() {
    let none = BTreeMap::new();
    for arm in arms() {
        let (values, covariance) = (arm.values(&arm.truth), arm.covariance() * 100.0);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut slowest, mut distances) = (0.0_f64, Vec::new());
        for _ in 0..50 {
            let estimate = noisy(&values, &covariance, &mut rng);
            let started = Instant::now();
            let found = arm.found(&arm.result(&estimate, &covariance), &none).expect("possible inertias");
            slowest = slowest.max(started.elapsed().as_secs_f64());
            possible(&found);
            distances.push(found.distance);
            assert!(found.chance > 1e-6, "{}", found.distance);
        }
        eprintln!("{}: slowest {slowest:.3} s, distances {:?}", arm.source.name(), &distances[..5]);
        assert!(slowest < 0.5, "{slowest} s");
    }
}

/// Derivative of a pseudo-inertia by one of the ten parameters.
fn by_parameter(k: usize) -> nalgebra::Matrix4<f64> {
    let mut p = nalgebra::Matrix4::zeros();
    match k {
        0 => p[(3, 3)] = 1.0,
        1..4 => {
            p[(k - 1, 3)] = 1.0;
            p[(3, k - 1)] = 1.0;
        }
        _ => {
            let (i, j) = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)][k - 4];
            if i == j {
                (0..3).for_each(|axis| p[(axis, axis)] = if axis == i { -0.5 } else { 0.5 });
            } else {
                p[(i, j)] = -1.0;
                p[(j, i)] = -1.0;
            }
        }
    }
    p
}

fn pseudo(values: &BTreeMap<String, f64>, body: &str) -> nalgebra::Matrix4<f64> {
    (0..10).map(|k| by_parameter(k) * values[&format!("{}_{body}", NAMES[k])]).sum()
}

#[test]
fn the_rest_is_as_near_to_a_wrong_description_as_exact_data_allow() {
    for arm in arms() {
        let (values, covariance) = (arm.values(&arm.truth), arm.covariance() * 1e-12);
        // Rotors that are seen together with links only are known here.
        let mut stated = arm.wrong(0.2, 11);
        stated.extend(
            arm.truth
                .iter()
                .filter(|(name, _)| name.starts_with("Ia_"))
                .map(|(name, value)| (name.clone(), 1.2 * value)),
        );
        let found = arm.found(&arm.result(&values, &covariance), &arm.known(&stated)).expect("possible inertias");
        possible(&found);
        for (own, value) in found.combinations.iter().zip(&values) {
            let size: f64 = own.terms.keys().map(|name| arm.column(name).abs() * own.terms[name].abs()).sum();
            // A base parameter of zero has the size of the small ones of an arm, a gram times a metre.
            assert!((own.possible - value).abs() < 1e-6 * size.max(1e-3), "{own:?}");
        }
        // Karush, Kuhn and Tucker: along whatever changes no base parameter, the divergence does not change.
        let names: Vec<&String> = found.parameters.iter().map(|own| &own.name).collect();
        let now: BTreeMap<String, f64> = found.parameters.iter().map(|own| (own.name.clone(), own.value)).collect();
        let described: BTreeMap<String, f64> =
            found.parameters.iter().filter_map(|own| Some((own.name.clone(), own.description?))).collect();
        let mut gradient = nalgebra::DVector::zeros(names.len());
        for body in arm.described.bodies() {
            let difference = pseudo(&described, body.name).try_inverse().expect("possible")
                - pseudo(&now, body.name).try_inverse().expect("possible");
            for (k, quantity) in NAMES.iter().enumerate() {
                let at =
                    names.iter().position(|name| **name == format!("{quantity}_{}", body.name)).expect("a parameter");
                gradient[at] = (difference * by_parameter(k)).trace();
            }
        }
        for (at, name) in names.iter().enumerate().filter(|(_, name)| name.starts_with("Ia_")) {
            gradient[at] = 1.0 / described[*name] - 1.0 / now[*name];
        }
        let rows = arm.physical_rows(&names);
        let scale = nalgebra::DVector::from_iterator(names.len(), names.iter().map(|name| now[*name].abs().max(1e-3)));
        let scaled = &rows * nalgebra::DMatrix::from_diagonal(&scale);
        let steep = gradient.component_mul(&scale);
        // What is left of the gradient beside the rows.
        let left = scaled.transpose().svd(true, false);
        let columns = left.u.expect("asked for");
        let kept = left.singular_values.iter().filter(|value| **value > 1e-9 * left.singular_values[0]).count();
        assert_eq!(kept, arm.base.len(), "{}", arm.source.name());
        let columns = columns.columns(0, kept);
        let along = &steep - columns * (columns.transpose() * &steep);
        assert!(along.norm() < 1e-5 * steep.norm(), "{}: {} of {}", arm.source.name(), along.norm(), steep.norm());
        // The description is left where the data say otherwise.
        assert!(steep.norm() > 0.1, "{}", steep.norm());
        assert!(found.parameters.iter().any(|own| own.origin == Origin::Data), "{}", arm.source.name());
        assert!(found.parameters.iter().any(|own| own.origin != Origin::Data), "{}", arm.source.name());
    }
}

/// The description knows the links, and nobody the rotors: what the data show of both together says what the rotors are.
#[test]
fn rotors_that_are_seen_with_links_only_are_no_mass_of_links() {
    for arm in arms() {
        let (values, covariance) = (arm.values(&arm.truth), arm.covariance() * 1e-6);
        let found = arm.found(&arm.result(&values, &covariance), &BTreeMap::new()).expect("possible inertias");
        possible(&found);
        for own in found.parameters.iter().filter(|own| own.name.starts_with("Ia_") || own.name.starts_with("m_")) {
            let truth = arm.truth.get(&own.name).copied().unwrap_or(own.value);
            assert!((own.value - truth).abs() < 0.02 * truth, "{}: {own:?} {truth}", arm.source.name());
            // Nothing said it alone, and a deviation would be that of the data.
            assert!(own.origin == Origin::Data || own.std.is_none(), "{own:?}");
        }
        assert!(!found.remarks.iter().any(|remark| remark.contains("counts as zero")), "{:?}", found.remarks);
    }
}

#[test]
fn nothing_but_inertias_and_frictions_changes_in_a_description() {
    for arm in arms() {
        let (values, covariance) = (arm.values(&arm.truth), arm.covariance() * 4.0);
        let estimate = noisy(&values, &covariance, &mut ChaCha8Rng::seed_from_u64(5));
        let found = arm.found(&arm.result(&estimate, &covariance), &BTreeMap::new()).expect("possible inertias");
        let losses = arm.described.frictions_of_joints(&found.losses);
        let text = with_inertials(&arm.source, &found.parted.links, &losses).expect("XML");
        assert_eq!(stripped(arm.source.text()), stripped(&text));
        assert_ne!(arm.source.text(), text);
        // What is read back are the parameters that were found.
        let again =
            Described::read(&Source::new("again.urdf", text.clone()), &Options::default()).expect("a description");
        let value = |name: &str| found.parameters.iter().find(|own| own.name == name).map(|own| own.value);
        for body in again.bodies() {
            for (symbol, own) in NAMES.iter().zip(body.inertia) {
                let wanted = value(&format!("{symbol}_{}", body.name)).expect("a parameter");
                assert!((to_f64(own) - wanted).abs() <= 1e-15 * wanted.abs(), "{symbol}_{}: {own} {wanted}", body.name);
            }
            let dynamics = text.contains(&format!("friction=\"{}\"", to_f64(body.friction)));
            assert!(
                !dynamics
                    || to_f64(body.friction) == value(&format!("fc_{}", body.coordinate)).expect("a loss")
                    || to_f64(body.friction) == 0.0
            );
        }
        let mujoco = mjcf(&arm.described, &found.parted.bodies, &found.losses).expect("possible");
        assert_eq!(mujoco.matches("<inertial").count(), arm.described.bodies().count());
        assert_eq!(
            mujoco.matches("armature").count(),
            found.losses.values().filter(|own| own.rotor.is_some_and(|rotor| rotor > 0.0)).count()
        );
    }
}

/// A description without its inertias and values of friction.
fn stripped(text: &str) -> String {
    let mut left = text.to_owned();
    while let Some(start) = left.find("<inertial") {
        let end = start + left[start..].find("</inertial>").expect("an end") + "</inertial>".len();
        left.replace_range(start..end, "");
    }
    while let Some(start) = left.find("<dynamics") {
        let end = start + left[start..].find('>').expect("an end") + 1;
        left.replace_range(start..end, "");
    }
    left
}

#[test]
fn loads_are_found_with_honest_deviations() {
    for arm in arms() {
        let last = arm.described.bodies().last().expect("a body").name.to_owned();
        let (values, covariance) = (arm.values(&arm.truth), arm.covariance());
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let (mut inside, mut all, mut worst) = (0_u32, 0_u32, 0.0_f64);
        for _ in 0..100 {
            let mass = rng.random_range(0.2..3.0);
            let centre: [f64; 3] = std::array::from_fn(|_| rng.random_range(-0.1..0.1));
            let radii: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.02..0.1_f64));
            let square = |i: usize, j: usize| mass * (radii[i] * radii[i] + radii[j] * radii[j]) / 5.0;
            let exact = |value: f64| from_f64(value).expect("finite");
            let about = AboutCentre {
                mass: exact(mass),
                centre: centre.map(exact),
                moments: [square(1, 2), 0.0, 0.0, square(0, 2), 0.0, square(0, 1)].map(exact),
            };
            let mut loaded = arm.truth.clone();
            for (symbol, value) in NAMES.iter().zip(about.parameters()) {
                *loaded.get_mut(&format!("{symbol}_{last}")).expect("a parameter") += to_f64(&value);
            }
            let without = arm.result(&noisy(&values, &covariance, &mut rng), &covariance);
            let with = arm.result(&noisy(&arm.values(&loaded), &covariance, &mut rng), &covariance);
            let request =
                LoadRequest { model: &arm.model, without: &without, with: &with, body: None, density: 2700.0 };
            let load = payload(&request).expect("a load");
            assert!(load.unobservable.is_empty() && load.body == last, "{load:?}");
            let truth = std::iter::once(&about.mass).chain(&about.centre).chain(&about.moments).map(to_f64);
            for (own, wanted) in load.parameters.iter().zip(truth) {
                let (value, std) = (own.value.expect("shown"), own.std.expect("shown"));
                all += 1;
                inside += u32::from((value - wanted).abs() < 1.96 * std);
            }
            let own: Vec<f64> = load.parameters.iter().map(|own| own.possible).collect();
            let body = AboutCentre {
                mass: exact(own[0]),
                centre: std::array::from_fn(|k| exact(own[1 + k])),
                moments: std::array::from_fn(|k| exact(own[4 + k])),
            };
            assert!(body.is_possible(), "{own:?}");
            worst = worst.max((own[0] - mass).abs() / mass);
        }
        let coverage = 100.0 * f64::from(inside) / f64::from(all);
        eprintln!("{}: coverage {coverage:.1} %, worst mass {:.2} %", arm.source.name(), 100.0 * worst);
        assert!((93.0..=97.0).contains(&coverage), "{coverage}");
        assert!(worst < 0.03, "{worst}");
    }
}

#[test]
fn what_does_not_go_together_is_named() {
    let arm = &arms()[0];
    let (values, covariance) = (arm.values(&arm.truth), arm.covariance());
    let result = arm.result(&values, &covariance);
    let stated = |name: &str| BTreeMap::from([(name.to_owned(), 1.0)]);
    assert_eq!(arm.found(&result, &stated("m_nothing")).unwrap_err(), InertiaError::Unknown("m_nothing".to_owned()));
    let shorter = Options { tip: Some("second".to_owned()), ..Options::default() };
    let described = Described::read(&arm.source, &shorter).expect("a part");
    let other = DeclaredModel::parse("other", &import_description(&arm.source, &shorter).expect("a part").model)
        .expect("a model");
    let none = BTreeMap::new();
    let request =
        InertiasRequest { model: &other, result: &result, described: &arm.described, values: &none, weight: 1.0 };
    assert!(matches!(inertias(&request).unwrap_err(), InertiaError::Body { link, .. } if link == "third"));
    let request = InertiasRequest { model: &other, described: &described, ..request };
    assert!(matches!(inertias(&request).unwrap_err(), InertiaError::Parameter(_)));
    for weight in [0.0, -1.0, f64::NAN] {
        let request = InertiasRequest { model: &arm.model, described: &arm.described, weight, ..request };
        assert!(matches!(inertias(&request).unwrap_err(), InertiaError::NotPositive { .. }));
    }
    let singular = arm.result(&values, &nalgebra::DMatrix::from_element(values.len(), values.len(), 1.0));
    assert_eq!(arm.found(&singular, &none).unwrap_err(), InertiaError::Covariance);
    let load =
        |body| LoadRequest { model: &arm.model, without: &result, with: &result, body: Some(body), density: 1000.0 };
    assert!(matches!(payload(&load("tool")).unwrap_err(), InertiaError::NoBody { known, .. } if known.len() == 3));
}
