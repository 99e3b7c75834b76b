//! Possible inertias and loads from base parameters whose truth and covariance are known: those of a small arm, and of the UR10 where
//! `TPM_DATA` has its description.

use crate::support::skipped;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::collections::BTreeMap;
use std::time::Instant;
use tpm_codegen::import::{Described, Options, mjcf, urdf, with_inertials};
use tpm_codegen::source::Source;
use tpm_runtime::inertia::{InertiaError, Inertias, InertiasRequest, LoadRequest, Origin, inertias, payload};
use tpm_runtime::session::{DeclaredModel, Identifiable as _, StoredResult};
use tpm_symbolic::mechanics::tree::mechanism::Loss;
use tpm_symbolic::mechanics::tree::{AboutCentre, NAMES};
use tpm_symbolic::number::rational::{from_f64, to_f64};
use tpm_symbolic::regressor::base_parameters::{Motions, base_parameters};
use tpm_symbolic::regressor::parameter_map::ParameterMap;

/// Three links, of which the last carries a flange on a fixed joint that is turned.
const SMALL: &str = r#"<?xml version="1.0"?>
<robot name="small">
  <link name="base"/>
  <link name="first">
    <inertial><origin xyz="0 0.02 0.1" rpy="0 0 0"/><mass value="6"/>
      <inertia ixx="0.06" ixy="0.002" ixz="0" iyy="0.05" iyz="0.003" izz="0.03"/></inertial>
    <visual><geometry><box size="1 1 1"/></geometry></visual>
  </link>
  <link name="second">
    <inertial>
      <mass value="4"/>
      <origin xyz="0.2 0 0.01" rpy="0 0 0.3"/>
      <inertia ixx="0.01" ixy="0" ixz="0.001" iyy="0.06" iyz="0" izz="0.06"/>
    </inertial>
  </link>
  <link name="third">
    <inertial><origin xyz="0.1 0.01 0"/><mass value="2"/>
      <inertia ixx="0.004" ixy="0" ixz="0" iyy="0.02" iyz="0.0005" izz="0.02"/></inertial>
  </link>
  <link name="flange">
    <inertial><mass value="0.1"/><inertia ixx="0.0001" ixy="0" ixz="0" iyy="0.0001" iyz="0" izz="0.0001"/></inertial>
  </link>
  <joint name="q1" type="revolute"><parent link="base"/><child link="first"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="3" effort="60"/><dynamics damping="0.5" friction="1"/></joint>
  <joint name="q2" type="revolute"><parent link="first"/><child link="second"/><origin xyz="0 0.1 0.2" rpy="1.5708 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="3" effort="60"/><dynamics friction="0.8"/></joint>
  <joint name="q3" type="revolute"><parent link="second"/><child link="third"/><origin xyz="0.4 0 0" rpy="0 1.5708 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="60"/></joint>
  <joint name="end" type="fixed"><parent link="third"/><child link="flange"/><origin xyz="0.3 0 0" rpy="0.4 0.5 0.6"/></joint>
</robot>
"#;

/// An arm with its true parameters and the columns of its model.
struct Arm {
    source: Source,
    model: DeclaredModel,
    described: Described,
    map: ParameterMap,
    truth: BTreeMap<String, f64>,
    /// Weights by column of every base parameter.
    base: Vec<Vec<(usize, f64)>>,
    /// The information matrix of the columns along a motion, with noise of one percent of the largest torque.
    information: Vec<Vec<f64>>,
}

fn arms() -> Vec<Arm> {
    let robot = std::env::var_os("TPM_DATA").map(|folder| std::path::Path::new(&folder).join("robots/ur10_robot.urdf"));
    let mut arms = vec![Arm::new("small.urdf", SMALL.as_bytes())];
    match robot.filter(|path| path.exists()) {
        Some(path) => arms.push(Arm::new("ur10.urdf", &std::fs::read(path).expect("a description"))),
        None => skipped("TPM_DATA has no robots/ur10_robot.urdf"),
    }
    arms
}

impl Arm {
    fn new(name: &str, text: &[u8]) -> Self {
        let source = Source::from_bytes(name.to_owned(), text.to_vec());
        let losses = Some(vec![Loss::Viscous, Loss::Coulomb, Loss::Rotor]);
        let options = Options { losses, ..Options::default() };
        let imported = urdf(&source, &options).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
        let model = DeclaredModel::parse(name, &imported.model).expect("a model");
        let described = Described::read(&source, &options).expect("read before");
        let prepared = model.prepared();
        let exact = base_parameters(&prepared.model, &prepared.form, &Motions::default()).expect("a rank");
        let base = exact.base.expect("exact factors").into_iter().map(|own| {
            let others = own.others.iter().map(|(column, factor)| (*column, to_f64(factor)));
            std::iter::once((own.column, 1.0)).chain(others).collect()
        });
        let mut truth: BTreeMap<String, f64> = BTreeMap::new();
        for body in described.bodies() {
            truth.extend(
                NAMES.iter().zip(body.inertia).map(|(own, value)| (format!("{own}_{}", body.name), to_f64(value))),
            );
            let losses = [("fv", 2.0), ("fc", 3.0), ("Ia", 0.1)];
            truth.extend(losses.map(|(symbol, value)| (format!("{symbol}_{}", body.coordinate), value)));
        }
        let mut arm = Self {
            map: ParameterMap::new(prepared),
            base: base.collect(),
            information: Vec::new(),
            source,
            model,
            described,
            truth,
        };
        arm.information = arm.informed(1500);
        arm
    }

    fn columns(&self, parameters: &BTreeMap<String, f64>) -> Vec<f64> {
        self.map.evaluate(|symbol| parameters[self.map.name(symbol)])
    }

    /// Sum of the products of columns over random motions, divided by the variance of the torques' noise.
    fn informed(&self, motions: usize) -> Vec<Vec<f64>> {
        let model = self.model.evaluated();
        let dims = model.dims();
        let (n, joints) = (dims.parameters, dims.coordinates);
        let columns = self.columns(&self.truth);
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (mut work, mut most) = (vec![0.0; model.workspace_len()], vec![0.0_f64; joints]);
        let regressors: Vec<Vec<f64>> = (0..motions)
            .map(|_| {
                let motion: Vec<f64> = [2.0, 1.5, 4.0]
                    .iter()
                    .flat_map(|size| (0..joints).map(|_| rng.random_range(-size..*size)).collect::<Vec<_>>())
                    .collect();
                let mut out = vec![0.0; dims.regressor_len()];
                model.regressor(&motion, &[], &mut work, &mut out).expect("a regressor");
                for (row, most) in out.chunks(n).zip(&mut most) {
                    let torque: f64 = row.iter().zip(&columns).map(|(entry, own)| entry * own).sum();
                    *most = most.max(torque.abs());
                }
                out
            })
            .collect();
        let mut information = vec![vec![0.0; n]; n];
        for (row, most) in regressors.iter().flat_map(|own| own.chunks(n).zip(&most)) {
            let weight = (0.01 * most).powi(-2);
            for i in 0..n {
                (0..n).for_each(|j| information[i][j] += weight * row[i] * row[j]);
            }
        }
        information
    }

    /// Base values of parameters.
    fn values(&self, parameters: &BTreeMap<String, f64>) -> nalgebra::DVector<f64> {
        let columns = self.columns(parameters);
        let of = |own: &Vec<(usize, f64)>| own.iter().map(|(column, factor)| factor * columns[*column]).sum::<f64>();
        nalgebra::DVector::from_iterator(self.base.len(), self.base.iter().map(of))
    }

    /// The covariance of base parameters: with all other columns at zero, the information of the leading columns is theirs.
    fn covariance(&self) -> nalgebra::DMatrix<f64> {
        let lead: Vec<usize> = self.base.iter().map(|own| own[0].0).collect();
        let k = lead.len();
        let information = nalgebra::DMatrix::from_fn(k, k, |r, c| self.information[lead[r]][lead[c]]);
        let scale = information.diagonal().map(|entry| 1.0 / entry.sqrt());
        let scaled = nalgebra::DMatrix::from_fn(k, k, |r, c| information[(r, c)] * scale[r] * scale[c]);
        let inverse = scaled.cholesky().expect("the motions show all base parameters").inverse();
        nalgebra::DMatrix::from_fn(k, k, |r, c| inverse[(r, c)] * scale[r] * scale[c])
    }

    /// A result of an identification with these values of base parameters.
    fn result(&self, values: &nalgebra::DVector<f64>, covariance: &nalgebra::DMatrix<f64>) -> StoredResult {
        let columns = self.map.columns();
        let parameters = columns.iter().map(|name| {
            serde_json::json!({"name": name, "unit": null, "value": null, "std": null, "prior": null, "status": "unobservable"})
        });
        let combinations = self.base.iter().enumerate().map(|(row, own)| {
            let terms: BTreeMap<&String, String> =
                own.iter().map(|(column, factor)| (&columns[*column], factor.to_string())).collect();
            serde_json::json!({"terms": terms, "value": values[row], "std": covariance[(row, row)].sqrt()})
        });
        let nothing = vec![serde_json::Value::Null; columns.len()];
        let rows = covariance.row_iter().map(|row| {
            nothing.iter().cloned().chain(row.iter().map(|entry| serde_json::json!(entry))).collect::<Vec<_>>()
        });
        let text = serde_json::json!({
            "schema": "tpm.identification/2", "model": self.model.prepared().model.name.to_string(),
            "parameters": parameters.collect::<Vec<_>>(), "combinations": combinations.collect::<Vec<_>>(),
            "covariance": vec![nothing.clone(); columns.len()], "combination_covariance": rows.collect::<Vec<_>>(),
        });
        StoredResult::parse(&text.to_string()).expect("a result")
    }

    /// The value of a column.
    fn column(&self, name: &str) -> f64 {
        let at = self.map.columns().iter().position(|own| own == name).expect("a column");
        self.columns(&self.truth)[at]
    }

    /// Values of parameters that the model has, or that its links have.
    fn known(&self, values: &BTreeMap<String, f64>) -> BTreeMap<String, f64> {
        let own = |name: &&String| self.truth.contains_key(*name);
        values.iter().filter(|(name, _)| own(name)).map(|(name, value)| (name.clone(), *value)).collect()
    }

    /// The base parameters by physical parameters.
    fn physical_rows(&self, names: &[&String]) -> nalgebra::DMatrix<f64> {
        let mut unit: BTreeMap<String, f64> = names.iter().map(|name| ((*name).clone(), 0.0)).collect();
        let columns = names.iter().map(|name| {
            unit.insert((*name).clone(), 1.0);
            let column = self.values(&unit);
            unit.insert((*name).clone(), 0.0);
            column
        });
        nalgebra::DMatrix::from_columns(&columns.collect::<Vec<_>>())
    }

    fn found(&self, result: &StoredResult, values: &BTreeMap<String, f64>) -> Result<Inertias, InertiaError> {
        let (model, described) = (&self.model, &self.described);
        inertias(&InertiasRequest { model, result, described, values, weight: 1.0 })
    }

    /// Description whose every inertia differs by up to a share, and stays possible: all densities change, and all places.
    fn wrong(&self, share: f64, seed: u64) -> BTreeMap<String, f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut wrong = BTreeMap::new();
        for body in self.described.bodies() {
            let own: [f64; 10] = std::array::from_fn(|k| to_f64(&body.inertia[k]));
            let [mass, length] = [0, 1].map(|_| 1.0 + rng.random_range(-share..share));
            let scaled = own.iter().enumerate().map(|(k, value)| match k {
                0 => value * mass,
                1..4 => value * mass * length,
                _ => value * mass * length * length,
            });
            wrong.extend(NAMES.iter().zip(scaled).map(|(name, value)| (format!("{name}_{}", body.name), value)));
        }
        wrong
    }
}

/// Values of base parameters with errors of a covariance.
fn noisy(
    values: &nalgebra::DVector<f64>,
    covariance: &nalgebra::DMatrix<f64>,
    rng: &mut ChaCha8Rng,
) -> nalgebra::DVector<f64> {
    let root = covariance.clone().cholesky().expect("a covariance").l();
    values + root * nalgebra::DVector::from_fn(values.len(), |_, _| rng.sample::<f64, _>(StandardNormal))
}

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
            for k in 0..10 {
                let at =
                    names.iter().position(|name| **name == format!("{}_{}", NAMES[k], body.name)).expect("a parameter");
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

#[test]
fn nothing_but_inertias_and_frictions_changes_in_a_description() {
    for arm in arms() {
        let (values, covariance) = (arm.values(&arm.truth), arm.covariance() * 4.0);
        let estimate = noisy(&values, &covariance, &mut ChaCha8Rng::seed_from_u64(5));
        let found = arm.found(&arm.result(&estimate, &covariance), &BTreeMap::new()).expect("possible inertias");
        let losses =
            arm.described.bodies().map(|body| (body.joint.to_owned(), found.losses[body.coordinate])).collect();
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
    let other = DeclaredModel::parse("other", &urdf(&arm.source, &shorter).expect("a part").model).expect("a model");
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
