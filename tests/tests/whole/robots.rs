//! Robot descriptions through `import`, the language and the recursion, against Pinocchio (fixtures by `tests/scripts/robots.py`) and
//! against a twin in spatial algebra.
//!
//! `TPM_ROBOTS` may name a folder of larger fixtures of the same form.

use crate::support::{root, skipped};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use tpm_codegen::import::{Angles, Imported, Options, import_description};
use tpm_codegen::source::Source;
use tpm_codegen::{Parsed, parse_model};
use tpm_symbolic::expr::graph::{ExprId, Graph, Node};
use tpm_symbolic::mechanics::tree::mechanism::parameter_name;
use tpm_symbolic::mechanics::tree::{Joint, NAMES};
use tpm_symbolic::number::rational::to_f64;

/// The fixtures, with the description and the joints that are held.
pub(crate) const ROBOTS: [(&str, &str, &[&str]); 8] = [
    ("ur5", "ur5_robot", &[]),
    ("ur10", "ur10_robot", &[]),
    ("so101", "so101", &[]),
    ("so101_written", "so101", &[]),
    ("xarm7", "xarm7", &[]),
    ("panda", "panda", &["panda_finger_joint1", "panda_finger_joint2"]),
    ("z1", "z1", &[]),
    ("gripper", "gripper", &[]),
];

fn folder() -> Option<PathBuf> {
    let folder = PathBuf::from(std::env::var_os("TPM_DATA")?).join("robots");
    folder.is_dir().then_some(folder)
}

pub(crate) fn imported(fixture: &str, file: &str, locked: &[&str]) -> Option<Imported> {
    let own = root().join(format!("tests/fixtures/robots/{file}.urdf"));
    let path = if own.is_file() { own } else { folder()?.join(format!("{file}.urdf")) };
    let source = Source::from_bytes(format!("{file}.urdf"), std::fs::read(path).expect("a description"));
    let options = Options {
        locked: locked.iter().map(|joint| ((*joint).to_owned(), "0".to_owned())).collect(),
        angles: if fixture.ends_with("written") { Angles::Written } else { Angles::Recognised },
        losses: Some(Vec::new()),
        ..Options::default()
    };
    Some(import_description(&source, &options).unwrap_or_else(|faults| panic!("{}", faults.render(&source))))
}

pub(crate) fn parsed(imported: &Imported) -> Parsed {
    let source = Source::new("imported", imported.model.clone());
    parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)))
}

/// `NAME = VALUE` lines.
pub(crate) fn values(text: &str) -> BTreeMap<String, f64> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let pairs = lines.filter_map(|line| line.split_once(" = "));
    pairs.map(|(name, value)| (name.to_owned(), value.parse().expect("a number"))).collect()
}

/// A state of a robot with what Pinocchio says of it, by our coordinates.
pub(crate) struct State {
    pub(crate) q: Vec<f64>,
    pub(crate) v: Vec<f64>,
    pub(crate) a: Vec<f64>,
    pub(crate) torque: Vec<f64>,
    /// The mass matrix, row by row.
    pub(crate) mass: Vec<f64>,
}

/// The states of a fixture.
pub(crate) fn fixture(name: &str, parsed: &Parsed) -> Vec<State> {
    let fixtures = std::env::var_os("TPM_ROBOTS").map_or_else(|| root().join("tests/fixtures/robots"), PathBuf::from);
    let text = std::fs::read_to_string(fixtures.join(format!("{name}.json"))).expect("a fixture");
    let known: Value = serde_json::from_str(&text).expect("JSON");
    let theirs: Vec<&str> =
        known["joints"].as_array().expect("joints").iter().map(|name| name.as_str().unwrap_or("")).collect();
    let place = |wanted: &str| theirs.iter().position(|name| *name == wanted).expect("the same joints");
    let order: Vec<usize> = parsed.model.coordinates.iter().map(|coordinate| place(&coordinate.name)).collect();
    let states = known["states"].as_array().expect("states").iter().map(|state| {
        let ours = |list: &Value| -> Vec<f64> {
            let list = numbers(list);
            order.iter().map(|&index| list[index]).collect()
        };
        let mass = state["mass"].as_array().expect("rows");
        State {
            q: ours(&state["q"]),
            v: ours(&state["v"]),
            a: ours(&state["a"]),
            torque: ours(&state["torque"]),
            mass: order.iter().flat_map(|&row| ours(&mass[row])).collect(),
        }
    });
    states.collect()
}

/// The torques at rest by the twin in spatial algebra.
pub(crate) fn at_rest(imported: &Imported, q: &[f64]) -> Vec<f64> {
    let still = vec![0.0; q.len()];
    twin(&Arm::new(imported), [q, &still, &still])
}

/// The mass matrix by the twin in spatial algebra, row by row.
pub(crate) fn mass_matrix(imported: &Imported, q: &[f64]) -> Vec<Vec<f64>> {
    let (arm, still, weight) = (Arm::new(imported), vec![0.0; q.len()], at_rest(imported, q));
    let row = |joint: usize| {
        let mut accelerations = still.clone();
        accelerations[joint] = 1.0;
        let torques = twin(&arm, [q, &still, &accelerations]);
        torques.iter().zip(&weight).map(|(torque, weight)| torque - weight).collect()
    };
    (0..q.len()).map(row).collect()
}

/// Values of all nodes of a graph; `leaf` gives those of the leaves.
fn evaluate(graph: &Graph, upto: &[ExprId], leaf: impl Fn(&Node) -> f64) -> Vec<f64> {
    let mut plan: BTreeMap<ExprId, f64> = BTreeMap::new();
    let mut stack = upto.to_vec();
    while let Some(&id) = stack.last() {
        if plan.contains_key(&id) {
            stack.pop();
            continue;
        }
        let missing: Vec<ExprId> = graph.operands(id).filter(|operand| !plan.contains_key(operand)).collect();
        if !missing.is_empty() {
            stack.extend(missing);
            continue;
        }
        let value = match graph.node(id) {
            Node::Number(value) => to_f64(value),
            Node::Sum(terms) => terms.iter().map(|term| plan[term]).sum(),
            Node::Product(factors) => factors.iter().map(|factor| plan[factor]).product(),
            Node::Power(base, exponent) => plan[base].powi(*exponent),
            Node::Function(function, argument) => function.apply(plan[argument]),
            node => leaf(node),
        };
        plan.insert(id, value);
    }
    upto.iter().map(|id| plan[id]).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number")).collect()
}

fn close(found: &[f64], wanted: &[f64], what: &str) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let scale = wanted.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    for (index, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        assert!((found - wanted).abs() <= 1e-9 * scale, "{what}, {index}: {found} and {wanted}");
    }
}

/// A robot and what of it is evaluated.
struct Arm {
    model: Parsed,
    graph: Graph,
    /// The ten parameters of every body.
    inertias: Vec<[f64; 10]>,
    /// By joint, in the order of the coordinates: the torque of the equations, and the entry of every body and parameter.
    torques: Vec<ExprId>,
    entries: Vec<Vec<(usize, usize, ExprId)>>,
    /// The torques of the recursion over wrenches.
    recursion: Vec<ExprId>,
}

impl Arm {
    fn new(imported: &Imported) -> Self {
        let mut model = parsed(imported);
        let prior = values(&imported.prior);
        let mechanism = model.mechanism.clone().expect("a mechanism");
        let inertias: Vec<[f64; 10]> = mechanism
            .labels
            .iter()
            .map(|label| NAMES.map(|name| prior.get(&parameter_name(name, &label.name)).copied().unwrap_or(0.0)))
            .collect();
        let graph = &mut model.model.graph;
        let mut rows = mechanism.tree.regressor(graph);
        rows.sort_by_key(|row| row.coordinate);
        let entries = rows
            .iter()
            .map(|row| row.entries.iter().map(|entry| (entry.body, entry.parameter, entry.expr)).collect())
            .collect();
        let symbols: Vec<[ExprId; 10]> = (0..inertias.len())
            .map(|body| std::array::from_fn(|k| graph.placeholder((10 * body + k) as u32)))
            .collect();
        let mut recursion = mechanism.tree.torques(graph, |body| symbols[body]);
        recursion.sort_by_key(|(coordinate, _)| *coordinate);
        let recursion = recursion.into_iter().map(|(_, torque)| torque).collect();
        let torques = model
            .model
            .equations
            .clone()
            .into_iter()
            .map(|equation| {
                let terms: Vec<ExprId> = equation.terms.iter().map(|term| term.expr).collect();
                model.model.graph.sum_of_wholes(&terms)
            })
            .collect();
        let graph = model.model.graph.clone();
        Self { model, graph, inertias, torques, entries, recursion }
    }

    fn leaf(&self, prior: &BTreeMap<String, f64>, state: [&[f64]; 3], node: &Node) -> f64 {
        match node {
            Node::Derivative(coordinate, order) => state[*order as usize][coordinate.0 as usize],
            Node::Symbol(symbol) => {
                prior.get(self.model.model.quantity(*symbol).name.as_str()).copied().unwrap_or_default()
            }
            Node::Placeholder(index) => self.inertias[*index as usize / 10][*index as usize % 10],
            other => panic!("{other:?} is no leaf"),
        }
    }
}

#[test]
fn torques_regressors_and_mass_matrices_are_pinocchios() {
    if folder().is_none() {
        skipped("TPM_DATA has no robots");
        return;
    }
    let fixtures = std::env::var_os("TPM_ROBOTS").map_or_else(|| root().join("tests/fixtures/robots"), PathBuf::from);
    for (fixture, file, locked) in ROBOTS {
        let imported = imported(fixture, file, locked).expect("a description");
        let arm = Arm::new(&imported);
        let prior = values(&imported.prior);
        let text = std::fs::read_to_string(fixtures.join(format!("{fixture}.json"))).expect("a fixture");
        let known: Value = serde_json::from_str(&text).expect("JSON");
        // Pinocchio's joints by our coordinates.
        let theirs: Vec<String> = known["joints"]
            .as_array()
            .expect("joints")
            .iter()
            .map(|name| name.as_str().unwrap_or("").to_owned())
            .collect();
        let order: Vec<usize> = arm
            .model
            .model
            .coordinates
            .iter()
            .map(|coordinate| theirs.iter().position(|name| *name == coordinate.name).expect("the same joints"))
            .collect();
        let ours = |list: &Value| -> Vec<f64> {
            let list = numbers(list);
            order.iter().map(|&index| list[index]).collect()
        };
        for (index, state) in known["states"].as_array().expect("states").iter().enumerate() {
            let what = format!("{fixture}, state {index}");
            let [q, v, a] = ["q", "v", "a"].map(|key| ours(&state[key]));
            let torque = ours(&state["torque"]);
            let at = |exprs: &[ExprId], v: &[f64], a: &[f64]| {
                evaluate(&arm.graph, exprs, |node| arm.leaf(&prior, [&q, v, a], node))
            };
            close(&at(&arm.torques, &v, &a), &torque, &what);
            close(&at(&arm.recursion, &v, &a), &torque, &what);
            // Columns of the mass matrix are the torques of single accelerations without gravity.
            let still = vec![0.0; q.len()];
            let held = at(&arm.torques, &still, &still);
            let mass = state["mass"].as_array().expect("rows");
            for column in 0..q.len() {
                let mut single = still.clone();
                single[column] = 1.0;
                let found: Vec<f64> =
                    at(&arm.torques, &still, &single).iter().zip(&held).map(|(with, without)| with - without).collect();
                let wanted: Vec<f64> = order.iter().map(|&row| numbers(&mass[row])[order[column]]).collect();
                close(&found, &wanted, &format!("{what}, column {column} of the mass matrix"));
            }
            let Some(regressor) = state.get("regressor").and_then(Value::as_array) else { continue };
            // The bodies are the links of the joints, in the order of the coordinates where all stand on moving joints.
            let tree = &arm.model.mechanism.as_ref().expect("a mechanism").tree;
            for (row, entries) in arm.entries.iter().enumerate() {
                let wanted = numbers(&regressor[order[row]]);
                let exprs: Vec<ExprId> = entries.iter().map(|(_, _, expr)| *expr).collect();
                let mut found = vec![0.0; wanted.len()];
                for ((body, parameter, _), value) in entries.iter().zip(at(&exprs, &v, &a)) {
                    let coordinate = tree.bodies()[*body].joint.coordinate().expect("a moving body");
                    found[10 * order[coordinate.0 as usize] + parameter] = value;
                }
                close(&found, &wanted, &format!("{what}, row {row} of the regressor"));
            }
        }
    }
}

type Spatial = [[f64; 6]; 6];

fn times(matrix: &Spatial, vector: &[f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| (0..6).map(|j| matrix[i][j] * vector[j]).sum())
}

fn transposed(matrix: &Spatial) -> Spatial {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[j][i]))
}

fn product(a: &Spatial, b: &Spatial) -> Spatial {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..6).map(|k| a[i][k] * b[k][j]).sum()))
}

fn skew(v: [f64; 3]) -> [[f64; 3]; 3] {
    [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]]
}

/// A matrix by its four blocks.
fn blocks(of: impl Fn(usize, usize) -> [[f64; 3]; 3]) -> Spatial {
    std::array::from_fn(|i| std::array::from_fn(|j| of(i / 3, j / 3)[i % 3][j % 3]))
}

/// Motion vectors of a frame (angular first) in a frame that is placed in it by a rotation and an origin (Featherstone, 2.8).
fn to_child(rotation: &[[f64; 3]; 3], origin: [f64; 3]) -> Spatial {
    let lever = skew(origin);
    let turned: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| rotation[j][i]));
    let swept: [[f64; 3]; 3] =
        std::array::from_fn(|i| std::array::from_fn(|j| -(0..3).map(|k| turned[i][k] * lever[k][j]).sum::<f64>()));
    blocks(|row, column| match (row, column) {
        (0, 1) => [[0.0; 3]; 3],
        (1, 0) => swept,
        _ => turned,
    })
}

/// The cross product of motion vectors as a matrix.
fn motion_cross(v: &[f64; 6]) -> Spatial {
    let (angular, linear) = (skew([v[0], v[1], v[2]]), skew([v[3], v[4], v[5]]));
    blocks(|row, column| match (row, column) {
        (0, 1) => [[0.0; 3]; 3],
        (1, 0) => linear,
        _ => angular,
    })
}

/// The torques by spatial algebra in doubles, written down once more from the placements of the bodies.
fn twin(arm: &Arm, state: [&[f64]; 3]) -> Vec<f64> {
    let tree = &arm.model.mechanism.as_ref().expect("a mechanism").tree;
    let bodies = tree.bodies();
    let number = |expr: ExprId| to_f64(arm.graph.as_number(expr).expect("a number"));
    // How each body is placed, and its velocity, acceleration, wrench and screw.
    let mut kept: Vec<(Spatial, [[f64; 6]; 4])> = Vec::new();
    for (index, body) in bodies.iter().enumerate() {
        let rotation: [[f64; 3]; 3] =
            std::array::from_fn(|i| std::array::from_fn(|j| to_f64(body.rotation.entry(i, j))));
        let placed = to_child(&rotation, body.origin.map(number));
        let mut screw = [0.0; 6];
        let (mut moved, mut rates) = (placed, [0.0; 2]);
        if let Some(coordinate) = body.joint.coordinate() {
            let place = coordinate.0 as usize;
            rates = [state[1][place], state[2][place]];
            let direction = body.joint.direction().each_ref().map(to_f64);
            match &body.joint {
                Joint::Revolute { axis, factor, .. } => {
                    let axis: [f64; 3] = std::array::from_fn(|i| to_f64(&axis[i]));
                    let (sine, cosine) = (to_f64(factor) * state[0][place]).sin_cos();
                    let across = skew(axis);
                    let turn: [[f64; 3]; 3] = std::array::from_fn(|i| {
                        std::array::from_fn(|j| {
                            f64::from(u8::from(i == j)) * cosine
                                + across[i][j] * sine
                                + axis[i] * axis[j] * (1.0 - cosine)
                        })
                    });
                    screw[..3].copy_from_slice(&direction);
                    moved = product(&to_child(&turn, [0.0; 3]), &placed);
                }
                Joint::Prismatic { .. } => {
                    screw[3..].copy_from_slice(&direction);
                    let identity = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
                    moved =
                        product(&to_child(&identity, direction.map(|component| component * state[0][place])), &placed);
                }
                Joint::Fixed => {}
            }
        }
        let (parent_velocity, parent_acceleration) = match body.parent {
            Some(parent) => (kept[parent].1[0], kept[parent].1[1]),
            None => ([0.0; 6], [0.0, 0.0, 0.0, 0.0, 0.0, 9.81]),
        };
        let carried = times(&moved, &parent_velocity);
        let velocity: [f64; 6] = std::array::from_fn(|i| carried[i] + screw[i] * rates[0]);
        let gyration = times(&motion_cross(&velocity), &screw.map(|component| component * rates[0]));
        let carried = times(&moved, &parent_acceleration);
        let acceleration: [f64; 6] = std::array::from_fn(|i| carried[i] + screw[i] * rates[1] + gyration[i]);
        let [m, x, y, z, xx, xy, xz, yy, yz, zz] = arm.inertias[index];
        let (first, tensor) = (skew([x, y, z]), [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
        let back = skew([-x, -y, -z]);
        let heavy = [[m, 0.0, 0.0], [0.0, m, 0.0], [0.0, 0.0, m]];
        let inertia = blocks(|row, column| [[tensor, first], [back, heavy]][row][column]);
        let momentum = times(&inertia, &velocity);
        let gyration = times(&transposed(&motion_cross(&velocity)), &momentum);
        let pushed = times(&inertia, &acceleration);
        let wrench = std::array::from_fn(|i| pushed[i] - gyration[i]);
        kept.push((moved, [velocity, acceleration, wrench, screw]));
    }
    let mut torques = vec![0.0; arm.torques.len()];
    for index in (0..bodies.len()).rev() {
        let (moved, [_, _, wrench, screw]) = kept[index];
        if let Some(coordinate) = bodies[index].joint.coordinate() {
            torques[coordinate.0 as usize] += (0..6).map(|i| screw[i] * wrench[i]).sum::<f64>();
        }
        if let Some(parent) = bodies[index].parent {
            let carried = times(&transposed(&moved), &wrench);
            (0..6).for_each(|i| kept[parent].1[2][i] += carried[i]);
        }
    }
    torques
}

#[test]
fn torques_are_those_of_spatial_algebra() {
    if folder().is_none() {
        skipped("TPM_DATA has no robots");
        return;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for (fixture, file, locked) in ROBOTS {
        let imported = imported(fixture, file, locked).expect("a description");
        let arm = Arm::new(&imported);
        let prior = values(&imported.prior);
        for _ in 0..20 {
            let count = arm.torques.len();
            let state: [Vec<f64>; 3] =
                std::array::from_fn(|_| (0..count).map(|_| rng.random_range(-3.0..3.0)).collect());
            let state = state.each_ref().map(Vec::as_slice);
            let found = evaluate(&arm.graph, &arm.torques, |node| arm.leaf(&prior, state, node));
            close(&found, &twin(&arm, state), fixture);
        }
    }
}

/// What is said of a description that is at fault, rendered.
fn faults(text: &str, options: &Options) -> String {
    let source = Source::new("robot.urdf", text);
    match import_description(&source, options) {
        Ok(imported) => panic!("no fault: {}", imported.model),
        Err(faults) => faults.render(&source),
    }
}

/// Two links and a joint between them, with some lines in the joint.
fn two_links(joint: &str) -> String {
    format!(
        "<robot name=\"r\">\n<link name=\"a\"/>\n<link name=\"b\"/>\n<joint name=\"j\" type=\"revolute\">\n\
         <parent link=\"a\"/><child link=\"b\"/>\n{joint}\n</joint>\n</robot>\n"
    )
}

const SOUND: &str = "<axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" effort=\"5\" velocity=\"2\"/>";

#[test]
fn faults_of_a_description_are_named_at_their_lines() {
    let options = Options::default();
    let check = |text: &str, line: usize, words: &[&str]| {
        let said = faults(text, &options);
        assert!(said.contains(&format!("robot.urdf:{line}:")), "line {line}:\n{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "`{word}`:\n{said}"));
    };
    check("<robot name=\"r\"><link", 1, &["no XML", "Help"]);
    check("<sdf/>", 1, &["`sdf` is no robot description", "root element `robot`", "for MuJoCo `mujoco`"]);
    check(&two_links("<axis xyz=\"0 0 0\"/><limit/>"), 6, &["axis of the joint `j` is zero", "write a direction"]);
    check(&two_links("<axis xyz=\"0 0 up\"/><limit/>"), 6, &["not three numbers"]);
    check(&two_links("<origin xyz=\"0 0\"/><limit/>"), 6, &["not three numbers"]);
    let moved = two_links(SOUND).replace("revolute", "planar");
    check(&moved, 4, &["of the type `planar`", "prismatic"]);
    assert!(!faults(&moved, &options).contains("roots"));
    check("<robot name=\"r\">\n</robot>", 1, &["has no link", "export the description again"]);
    let missing = two_links(SOUND).replace("<child link=\"b\"/>", "<child link=\"c\"/>");
    check(&missing, 4, &["joins `c`, which is no link"]);
    assert!(!faults(&missing, &options).contains("roots"));
    let roots = two_links(SOUND).replace("<link name=\"b\"/>", "<link name=\"b\"/>\n<link name=\"c\"/>");
    let imported = import_description(&Source::new("robot.urdf", &*roots), &options).expect("one root moves");
    let said: Vec<String> = imported.warnings.iter().map(|warning| format!("{warning:?}")).collect();
    assert!(said.iter().any(|said| said.contains("`c` hangs on nothing")), "{said:?}");
    let twice = "<joint name=\"k\" type=\"fixed\"><parent link=\"a\"/><child link=\"b\"/></joint>\n</robot>";
    check(&two_links(SOUND).replace("</robot>", twice), 8, &["form a loop", "remove a joint"]);
    let back = "<joint name=\"k\" type=\"fixed\"><parent link=\"b\"/><child link=\"a\"/></joint>\n</robot>";
    check(&two_links(SOUND).replace("</robot>", back), 1, &["in a loop"]);
    let fixed = two_links(SOUND).replace("revolute", "fixed");
    check(&fixed, 1, &["no joint of this part of the description moves"]);
    let mut options = Options { base: Some("z".to_owned()), ..Options::default() };
    assert!(faults(&two_links(SOUND), &options).contains("the base `z` is no link"));
    options = Options { locked: vec![("k".to_owned(), "0".to_owned())], ..Options::default() };
    assert!(faults(&two_links(SOUND), &options).contains("the joints that move are j"));
}

#[test]
fn joints_that_follow_are_held_with_those_that_lead() {
    let text = std::fs::read_to_string(root().join("tests/fixtures/robots/gripper.urdf")).expect("a description");
    let import = |text: &str, locked: &[(&str, &str)]| {
        let locked = locked.iter().map(|(joint, at)| ((*joint).to_owned(), (*at).to_owned())).collect();
        let source = Source::new("gripper.urdf", text);
        import_description(&source, &Options { locked, ..Options::default() }).map_err(|faults| faults.render(&source))
    };
    let model = import(&text, &[("elbow", "0.5"), ("left_finger", "0.01")]).expect("an arm").model;
    assert!(model.contains("coordinate turn [rad], wrist [rad];"), "{model}");
    // The belt stands at -0.5 times 0.5.
    let fixed =
        import(&text, &[("elbow", "0.5"), ("belt", "-0.25"), ("left_finger", "0.01"), ("right_finger", "-0.01")]);
    assert_eq!(
        values(&fixed.as_ref().expect("an arm").prior),
        values(&import(&text, &[("elbow", "0.5"), ("left_finger", "0.01")]).expect("an arm").prior)
    );
    // A joint that is held follows nothing.
    let model = import(&text, &[("belt", "0.1")]).expect("an arm").model;
    assert!(!model.contains("-1/2*elbow") && model.contains("revolute elbow"), "{model}");
    for (from, to, words) in [
        ("offset=\"0\"", "offset=\"1e9\"", "the offset of the joint `belt` is beyond all angles"),
        ("mimic joint=\"elbow\"", "mimic joint=\"knee\"", "`belt` follows `knee`, which does not move here"),
        ("mimic joint=\"elbow\"", "mimic joint=\"belt\"", "the joint `belt` follows itself over other joints"),
        ("multiplier=\"-0.5\"", "multiplier=\"0\"", "`belt` follows 0 times `elbow`"),
        ("multiplier=\"-0.5\"", "multiplier=\"half\"", "`multiplier` is `half`, which is no number"),
    ] {
        let said = import(&text.replace(from, to), &[]).err().unwrap_or_else(|| panic!("no fault: {words}"));
        assert!(said.contains(words), "`{words}`:\n{said}");
    }
}

/// A leader and two followers with offsets, one over the other, against the same tree whose origins stand where the offsets put them:
/// turned about the axis, moved along it.
#[test]
fn an_offset_of_a_joint_that_follows_is_a_constant_turn_or_shift_of_its_origin() {
    let tree = |second: [&str; 2], third: [&str; 2]| {
        let link = |name: &str, mass: &str| {
            format!(
                "<link name=\"{name}\"><inertial><origin xyz=\"0.1 0.02 0.03\" rpy=\"0.1 0.2 0.3\"/><mass value=\"{mass}\"/>\
                 <inertia ixx=\"0.02\" ixy=\"0.001\" ixz=\"0\" iyy=\"0.03\" iyz=\"0.002\" izz=\"0.04\"/></inertial></link>\n"
            )
        };
        let joint = |name: &str, kind: &str, parent: &str, child: &str, axis: &str, [origin, mimic]: [&str; 2]| {
            format!(
                "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin {origin}/>\
                 <axis xyz=\"{axis}\"/>{mimic}<limit lower=\"-0.2\" upper=\"1.6\" effort=\"5\" velocity=\"2\"/></joint>\n"
            )
        };
        let lead = ["xyz=\"0 0 0.1\" rpy=\"0.4 0 0\"", ""];
        format!(
            "<robot name=\"hand\">\n<link name=\"base\"/>\n{}{}{}{}{}{}</robot>",
            link("a", "1.5"),
            link("b", "0.7"),
            link("c", "0.4"),
            joint("j", "revolute", "base", "a", "0 0 1", lead),
            joint("k", "revolute", "a", "b", "0 1 0", second),
            joint("l", "prismatic", "b", "c", "0 0.6 0.8", third),
        )
    };
    let import = |text: &str, locked: &[(&str, &str)]| {
        let locked = locked.iter().map(|(joint, at)| ((*joint).to_owned(), (*at).to_owned())).collect();
        let source = Source::new("hand.urdf", text);
        import_description(&source, &Options { locked, ..Options::default() })
            .unwrap_or_else(|faults| panic!("{}", faults.render(&source)))
    };
    // The second joint stands at 1.5 q + 0.3, and the third one follows it: at 0.2 (1.5 q + 0.3) - 0.01 = 0.3 q + 0.05.
    let offsets = |turned: &str| {
        let second = format!("xyz=\"0.2 0 0\" rpy=\"{turned}\"");
        tree(
            [&second, "<mimic joint=\"j\" multiplier=\"1.5\" offset=\"0.3\"/>"],
            ["xyz=\"0 0.1 0\"", "<mimic joint=\"k\" multiplier=\"0.2\" offset=\"-0.01\"/>"],
        )
    };
    let third = ["xyz=\"0 0.13 0.04\"", "<mimic joint=\"j\" multiplier=\"0.3\"/>"];
    let stands = tree(["xyz=\"0.2 0 0\" rpy=\"0 0.3 0\"", "<mimic joint=\"j\" multiplier=\"1.5\"/>"], third);
    let states: Vec<[Vec<f64>; 3]> =
        [[0.3, 1.2, -2.0], [-0.9, 0.4, 3.0]].map(|state| state.map(|value| vec![value])).into();
    let torques = |text: &str| crate::mujoco::torques(&import(text, &[]), &states);
    let near = |a: &[Vec<f64>], b: &[Vec<f64>]| {
        a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12 * (1.0 + a.abs()))
    };
    assert!(near(&torques(&offsets("0 0 0")), &torques(&stands)));
    // A turned origin: the turns follow each other, Rz(0.5) Ry(0.3) after the roll of a quarter turn, which no three angles show by eye.
    let quarter = "1.5707963267948966";
    let turned = tree(
        [&format!("xyz=\"0.2 0 0\" rpy=\"{quarter} 0 0\""), "<mimic joint=\"j\" multiplier=\"1.5\" offset=\"0.3\"/>"],
        third,
    );
    // Rx(pi/2) Ry(0.3) is Rz(0.3) Rx(pi/2).
    let by_hand =
        tree([&format!("xyz=\"0.2 0 0\" rpy=\"{quarter} 0 0.3\""), "<mimic joint=\"j\" multiplier=\"1.5\"/>"], third);
    assert!(near(&torques(&turned), &torques(&by_hand)));
    // The leader keeps the limits of all three: those of the second one end at (1.6 - 0.3)/1.5, and begin at (-0.2 - 0.3)/1.5.
    let imported = import(&offsets("0 0 0"), &[]);
    assert!(imported.experiment.contains("j = [-0.2, 0.8666666666666667]"), "{}", imported.experiment);
    // Where the leader is locked, all that follow it are locked where their offsets put them.
    let rest = |text: String| {
        let moved = text.replace("</robot>", "<link name=\"d\"><inertial><origin xyz=\"0.3 0.1 0\"/><mass value=\"1\"/></inertial></link>\
            <joint name=\"m\" type=\"revolute\"><parent link=\"c\"/><child link=\"d\"/><origin xyz=\"0.1 0 0\"/><axis xyz=\"0 0 1\"/><limit effort=\"1\"/></joint></robot>");
        let imported = import(&moved, &[("j", "0.4")]);
        crate::mujoco::torques(&imported, &[[vec![0.3], vec![1.0], vec![2.0]]])
    };
    assert!(near(&rest(offsets("0 0 0")), &rest(stands)));
}

#[test]
fn a_coordinate_moves_other_joints_by_factors() {
    let model = |second: &str| {
        let constant = if second.contains("r*q") { "constant r = 1/10 [m/rad];\n" } else { "" };
        let text = format!(
            "model M {{\ncoordinate q [rad];\ninput u [N*m];\n{constant}mechanism {{\ngravity (0, 0, -9.81);\n\
             body a {{\nrevolute q about y;\n}}\nbody b on a {{\n{second}\ninertia parameters;\n}}\ndrive q by u;\n}}\n}}\n"
        );
        let source = Source::new("m.tpm", text);
        parse_model(&source).map_err(|faults| faults.render(&source))
    };
    for right in [
        "revolute 1/2*q about z at (1, 0, 0);",
        "revolute -q about z;",
        "prismatic (1/10)*q along x;",
        "prismatic r*q along x;",
    ] {
        model(right).unwrap_or_else(|said| panic!("{right}\n{said}"));
    }
    for (wrong, words) in [
        ("revolute q about z;", "`q` moves two joints"),
        ("revolute 0*q about z;", "the joint does not move"),
        ("revolute q/2 about z;", "a number times a coordinate"),
        ("revolute 2*(q + 1) about z;", "a number times a coordinate"),
        ("revolute r*q about z;", "unit mismatch"),
    ] {
        let said = model(wrong).err().unwrap_or_else(|| panic!("no fault: {wrong}"));
        assert!(said.contains(words), "`{words}`:\n{said}");
    }
}

#[test]
fn a_joint_without_an_axis_is_told_how_one_is_written() {
    let text =
        "model M {\ncoordinate q [rad];\ninput u [N*m];\nmechanism {\nbody a {\nrevolute q;\n}\ndrive q by u;\n}\n}\n";
    let source = Source::new("m.tpm", text);
    let Err(faults) = parse_model(&source) else { panic!("no fault") };
    let said = faults.render(&source);
    for words in ["m.tpm:6:11", "expected `about` and the axis of the joint", "such as `revolute q about z`"] {
        assert!(said.contains(words), "`{words}`:\n{said}");
    }
}

#[test]
fn what_is_left_out_or_read_otherwise_is_said() {
    let inertial = "<link name=\"b\"><inertial><mass value=\"2\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"9\"/></inertial><visual/></link>";
    let joint = "<origin xyz=\"1e-17 0 .5\" rpy=\"1.5708 0 0.3\"/><limit effort=\"5\"/><dynamics damping=\"0.5\"/>";
    let text = two_links(joint)
        .replace("<link name=\"b\"/>", inertial)
        .replace("name=\"j\"", "name=\"2 j\"")
        .replace("</robot>", "<gazebo/><gazebo/><frob/><transmission><joint name=\"2 j\"/><actuator name=\"m\"><mechanicalReduction>80</mechanicalReduction></actuator></transmission></robot>");
    let source = Source::new("robot.urdf", text);
    let imported =
        import_description(&source, &Options::default()).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let warnings: Vec<&str> = imported.warnings.iter().map(|warning| warning.message.as_str()).collect();
    for words in [
        "motors turn 80 times as far as their joints `2 j`; the model has positions and torques of the joints",
        "`frob` is no element of a `robot` that is known here",
        "the joint `2 j` has no axis; by the rules of URDF it is the x axis",
        "the joint `2 j` is called `j_2_j` in the model",
        "no body has the inertia of the link `b`: a principal moment of inertia exceeds the sum of the two others",
    ] {
        assert!(warnings.iter().any(|warning| warning.contains(words)), "{words}: {warnings:#?}");
    }
    for words in [
        "1.5708 is read as pi/2 (line 6)",
        "1e-17 is read as 0 (line 6)",
        "0.3 is read as an angle with a rational cosine and sine, which differs from it by rounding (line 6)",
        "left out, as a model of the dynamics has no use for them: 2 `gazebo`, 1 `transmission`, 1 `visual`",
    ] {
        assert!(imported.readings.iter().any(|reading| reading == words), "{words}: {:?}", imported.readings);
    }
    assert!(
        imported.model.contains("revolute j_2_j about x at (0, 0, 1/2) turned (pi/2, 0, 2*atan2("),
        "{}",
        imported.model
    );
    assert!(imported.model.contains("drive j_2_j by tau_j_2_j with viscous;"), "{}", imported.model);
    assert!(imported.prior.contains("fv_j_2_j = 0.5\n"), "{}", imported.prior);
    let experiment = tpm_runtime::experiment::Experiment::parse(&imported.experiment).expect("an experiment");
    assert_eq!(experiment.limits.inputs["tau_j_2_j"], 5.0);
    parsed(&imported);
    // A link of which there is a mesh alone, on a joint without limits.
    let mesh = "<link name=\"b\"><visual><geometry><mesh filename=\"b.stl\"/></geometry></visual></link>";
    let text = two_links("<axis xyz=\"0 0 1\"/>").replace("<link name=\"b\"/>", mesh);
    let source = Source::new("robot.urdf", text);
    let imported =
        import_description(&source, &Options::default()).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    for (words, help) in [
        ("the joint `j` has no limits", "add its limits to the experiment"),
        ("the link `b` moves and has no mass in the description", "add an `inertial`"),
    ] {
        let found = imported.warnings.iter().find(|warning| warning.message.contains(words));
        let warning = found.unwrap_or_else(|| panic!("{words}: {:#?}", imported.warnings));
        assert!(warning.help.as_ref().is_some_and(|text| text.contains(help)), "{warning:?}");
    }
}

/// A chain of bodies on three branches: two arms on a torso.
fn two_arms(joints: usize) -> String {
    let mut text = String::from("model TwoArms {\n");
    let names: Vec<String> = (0..joints).map(|index| format!("q{index}")).collect();
    text += &format!("    coordinate {};\n    input {};\n", names.join(", "), names.join(", ").replace('q', "u"));
    text += "    mechanism {\n        gravity (0, 0, -9.81);\n";
    let torso = joints / 5;
    for index in 0..joints {
        // After the torso, even bodies are of the left arm and odd ones of the right arm.
        let parent = if index == 0 {
            None
        } else if index <= torso {
            Some(index - 1)
        } else {
            Some(if index <= torso + 2 { torso } else { index - 2 })
        };
        let on = parent.map_or_else(String::new, |parent| format!("on b{parent} "));
        let axis = ["z", "y", "-x"][index % 3];
        let turned = ["", " turned (pi/2, 0, 0)", " turned (0, -pi/2, pi)"][index % 3];
        text += &format!(
            "        body b{index} {on}{{ revolute q{index} about {axis} at (0.{:03}, 0, -0.1{index}){turned}; inertia parameters; }}\n",
            37 * index % 1000
        );
    }
    for index in 0..joints {
        text += &format!("        drive q{index} by u{index} with viscous, coulomb;\n");
    }
    text + "    }\n}\n"
}

#[test]
fn thirty_joints_are_read_and_sorted_in_seconds() {
    let mut times = Vec::new();
    for joints in [2, 5, 10, 20, 30] {
        let source = Source::new("two arms", two_arms(joints));
        let start = std::time::Instant::now();
        let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
        let read = start.elapsed();
        let prepared = tpm_symbolic::regressor::prepare::prepare(parsed.model).expect("linear in the parameters");
        times.push((joints, read, start.elapsed(), prepared.model.graph.len()));
    }
    // Nodes grow at most with the square of the joints: bodies times depth.
    let [.., (ten, _, _, small), (_, _, _, _), (thirty, _, whole, large)] = times.as_slice() else {
        panic!("five sizes")
    };
    let growth = *large as f64 / *small as f64;
    assert!(growth <= (*thirty as f64 / *ten as f64).powi(2), "{times:?}");
    assert!(whole.as_secs_f64() < 5.0, "{times:?}");
}
