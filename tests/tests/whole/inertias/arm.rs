//! Arms whose true parameters are known, with results as an identification of them would give.

use crate::support::skipped;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::collections::BTreeMap;
use tpm_codegen::import::{Described, Options, STRIBECK, import_description};
use tpm_codegen::source::Source;
use tpm_runtime::inertia::{InertiaError, Inertias, InertiasRequest, inertias};
use tpm_runtime::session::{DeclaredModel, Identifiable as _, StoredResult};
use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::Loss;
use tpm_symbolic::number::rational::to_f64;
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

/// The rate at which friction falls, rad/s.
const RATE: f64 = 0.3;

/// An arm with its true parameters and the columns of its model.
pub(super) struct Arm {
    pub(super) source: Source,
    pub(super) model: DeclaredModel,
    pub(super) described: Described,
    pub(super) map: ParameterMap,
    pub(super) truth: BTreeMap<String, f64>,
    /// Rates at which friction falls, which results have beside the columns.
    rates: Vec<String>,
    /// Weights by column of every base parameter.
    pub(super) base: Vec<Vec<(usize, f64)>>,
    /// The information matrix of the columns along a motion, with noise of one percent of the largest torque.
    information: Vec<Vec<f64>>,
}

pub(super) fn arms() -> Vec<Arm> {
    let robot = std::env::var_os("TPM_DATA").map(|folder| std::path::Path::new(&folder).join("robots/ur10_robot.urdf"));
    let mut arms =
        vec![Arm::new("small.urdf", SMALL.as_bytes(), false), Arm::new("rubbing.urdf", SMALL.as_bytes(), true)];
    match robot.filter(|path| path.exists()) {
        Some(path) => arms.push(Arm::new("ur10.urdf", &std::fs::read(path).expect("a description"), false)),
        None => skipped("TPM_DATA has no robots/ur10_robot.urdf"),
    }
    arms
}

impl Arm {
    fn new(name: &str, text: &[u8], stribeck: bool) -> Self {
        let source = Source::from_bytes(name.to_owned(), text.to_vec());
        let losses = Some(vec![Loss::Viscous, Loss::Coulomb, Loss::Rotor]);
        let options = Options { losses, stribeck, ..Options::default() };
        let imported =
            import_description(&source, &options).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
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
            let more = stribeck.then_some((STRIBECK[0], 1.5));
            let losses = [("fv", 2.0), ("fc", 3.0), ("Ia", 0.1)].into_iter().chain(more);
            truth.extend(losses.map(|(symbol, value)| (format!("{symbol}_{}", body.coordinate), value)));
        }
        let mut arm = Self {
            map: ParameterMap::new(prepared),
            base: base.collect(),
            rates: prepared
                .model
                .nonlinear
                .iter()
                .map(|own| prepared.model.quantity(own.symbol).name.to_string())
                .collect(),
            information: Vec::new(),
            source,
            model,
            described,
            truth,
        };
        // More friction takes more motion to leave the inertias as well known.
        arm.information = arm.informed(if stribeck { 2000 } else { 1500 });
        arm
    }

    pub(super) fn columns(&self, parameters: &BTreeMap<String, f64>) -> Vec<f64> {
        self.map.evaluate(|symbol| parameters[self.map.name(symbol)])
    }

    /// Sum of the products of columns over random motions, divided by the variance of the torques' noise.
    fn informed(&self, motions: usize) -> Vec<Vec<f64>> {
        let model = self.model.evaluated();
        let dims = model.dims();
        let (n, joints) = (dims.parameters, dims.coordinates);
        let columns = self.columns(&self.truth);
        let rates = vec![RATE; self.rates.len()];
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (mut work, mut most) = (vec![0.0; model.workspace_len()], vec![0.0_f64; joints]);
        let regressors: Vec<Vec<f64>> = (0..motions)
            .map(|_| {
                let motion: Vec<f64> = [2.0, 1.5, 4.0]
                    .iter()
                    .flat_map(|size| (0..joints).map(|_| rng.random_range(-size..*size)).collect::<Vec<_>>())
                    .collect();
                let mut out = vec![0.0; dims.regressor_len()];
                model.regressor(&motion, &rates, &mut work, &mut out).expect("a regressor");
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
    pub(super) fn values(&self, parameters: &BTreeMap<String, f64>) -> nalgebra::DVector<f64> {
        let columns = self.columns(parameters);
        let of = |own: &Vec<(usize, f64)>| own.iter().map(|(column, factor)| factor * columns[*column]).sum::<f64>();
        nalgebra::DVector::from_iterator(self.base.len(), self.base.iter().map(of))
    }

    /// The covariance of base parameters: with all other columns at zero, the information of the leading columns is theirs.
    pub(super) fn covariance(&self) -> nalgebra::DMatrix<f64> {
        let lead: Vec<usize> = self.base.iter().map(|own| own[0].0).collect();
        let k = lead.len();
        let information = nalgebra::DMatrix::from_fn(k, k, |r, c| self.information[lead[r]][lead[c]]);
        let scale = information.diagonal().map(|entry| 1.0 / entry.sqrt());
        let scaled = nalgebra::DMatrix::from_fn(k, k, |r, c| information[(r, c)] * scale[r] * scale[c]);
        let inverse = scaled.cholesky().expect("the motions show all base parameters").inverse();
        nalgebra::DMatrix::from_fn(k, k, |r, c| inverse[(r, c)] * scale[r] * scale[c])
    }

    /// A result of an identification with these values of base parameters.
    pub(super) fn result(&self, values: &nalgebra::DVector<f64>, covariance: &nalgebra::DMatrix<f64>) -> StoredResult {
        let columns = self.map.columns();
        let parameters = columns.iter().map(|name| {
            serde_json::json!({"name": name, "unit": null, "value": null, "std": null, "prior": null, "status": "unobservable"})
        });
        let parameters = parameters.chain(self.rates.iter().map(|name| {
            serde_json::json!({"name": name, "unit": null, "value": RATE, "std": 0.1 * RATE, "prior": null, "status": "identified"})
        }));
        let combinations = self.base.iter().enumerate().map(|(row, own)| {
            let terms: BTreeMap<&String, String> =
                own.iter().map(|(column, factor)| (&columns[*column], factor.to_string())).collect();
            serde_json::json!({"terms": terms, "value": values[row], "std": covariance[(row, row)].sqrt()})
        });
        let all = columns.len() + self.rates.len();
        let nothing = vec![serde_json::Value::Null; all];
        let of_parameters = (0..all).map(|row| {
            let mut own = nothing.clone();
            if row >= columns.len() {
                own[row] = serde_json::json!((0.1 * RATE).powi(2));
            }
            own
        });
        let rows = covariance.row_iter().map(|row| {
            nothing.iter().cloned().chain(row.iter().map(|entry| serde_json::json!(entry))).collect::<Vec<_>>()
        });
        let text = serde_json::json!({
            "schema": "tpm.identification/2", "model": self.model.prepared().model.name.to_string(),
            "parameters": parameters.collect::<Vec<_>>(), "combinations": combinations.collect::<Vec<_>>(),
            "covariance": of_parameters.collect::<Vec<_>>(), "combination_covariance": rows.collect::<Vec<_>>(),
        });
        StoredResult::parse(&text.to_string()).expect("a result")
    }

    /// The value of a column.
    pub(super) fn column(&self, name: &str) -> f64 {
        let at = self.map.columns().iter().position(|own| own == name).expect("a column");
        self.columns(&self.truth)[at]
    }

    /// Values of parameters that the model has, or that its links have.
    pub(super) fn known(&self, values: &BTreeMap<String, f64>) -> BTreeMap<String, f64> {
        let own = |name: &&String| self.truth.contains_key(*name);
        values.iter().filter(|(name, _)| own(name)).map(|(name, value)| (name.clone(), *value)).collect()
    }

    /// The base parameters by physical parameters.
    pub(super) fn physical_rows(&self, names: &[&String]) -> nalgebra::DMatrix<f64> {
        let mut unit: BTreeMap<String, f64> = names.iter().map(|name| ((*name).clone(), 0.0)).collect();
        let columns = names.iter().map(|name| {
            unit.insert((*name).clone(), 1.0);
            let column = self.values(&unit);
            unit.insert((*name).clone(), 0.0);
            column
        });
        nalgebra::DMatrix::from_columns(&columns.collect::<Vec<_>>())
    }

    pub(super) fn found(
        &self,
        result: &StoredResult,
        values: &BTreeMap<String, f64>,
    ) -> Result<Inertias, InertiaError> {
        let (model, described) = (&self.model, &self.described);
        inertias(&InertiasRequest { model, result, described, values, weight: 1.0 })
    }

    /// Description whose every inertia differs by up to a share, and stays possible: all densities change, and all places.
    pub(super) fn wrong(&self, share: f64, seed: u64) -> BTreeMap<String, f64> {
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
pub(super) fn noisy(
    values: &nalgebra::DVector<f64>,
    covariance: &nalgebra::DMatrix<f64>,
    rng: &mut ChaCha8Rng,
) -> nalgebra::DVector<f64> {
    let root = covariance.clone().cholesky().expect("a covariance").l();
    values + root * nalgebra::DVector::from_fn(values.len(), |_, _| rng.sample::<f64, _>(StandardNormal))
}
