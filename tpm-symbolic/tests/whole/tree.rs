//! Recursive Newton-Euler against the Euler-Lagrange equations of the same bodies, exactly.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::{BTreeMap, HashMap};
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Function, Graph, Node, Symbol};
use tpm_symbolic::expr::trigonometric;
use tpm_symbolic::mechanics::lagrange::{Lagrangian, euler_lagrange};
use tpm_symbolic::mechanics::model::{ExactModel, Kind, SourceTerm, TermId};
use tpm_symbolic::mechanics::tree::mechanism::{Drive, Label, Loss, Mechanism, parameter_name};
use tpm_symbolic::mechanics::tree::rotation::{Angle, Rotation, unit_vector};
use tpm_symbolic::mechanics::tree::{Body, Inertia, Joint, NAMES, Tree, TreeError, about_origin};
use tpm_symbolic::number::rational::{Rational, integer, ratio};
use tpm_symbolic::plan::straight_line::Plan;

type Vector = [ExprId; 3];

/// How a body of a test stands on its parent: kind of joint, axis, origin in thousandths, quarter turns and half tangents.
struct Spec {
    parent: Option<usize>,
    joint: char,
    /// The body whose joint's coordinate moves this joint too, and the factor of it.
    follows: Option<(usize, Rational)>,
    axis: [i64; 3],
    origin: [i64; 3],
    turned: [Angle; 3],
    known: bool,
}

fn quarters(turns: [i64; 3]) -> [Angle; 3] {
    turns.map(Angle::quarter_turns)
}

fn unknown(parent: Option<usize>, joint: char, axis: [i64; 3], origin: [i64; 3], turned: [Angle; 3]) -> Spec {
    Spec { parent, joint, follows: None, axis, origin, turned, known: false }
}

/// The model of a mechanism, with its equations, and the mechanism.
fn mechanism(specs: &[Spec], drives: bool) -> (ExactModel, Mechanism) {
    let mut model = ExactModel { name: "Tree".to_owned(), ..ExactModel::default() };
    let mut bodies = Vec::new();
    for (index, spec) in specs.iter().enumerate() {
        let axis = unit_vector(&spec.axis.map(integer)).unwrap_or_else(|| [0, 0, 1].map(integer));
        let (leader, factor) = spec.follows.clone().unwrap_or((index, integer(1)));
        let name = format!("q{leader}");
        let known = |model: &ExactModel| model.coordinates.iter().position(|quantity| quantity.name.as_str() == name);
        let joint = match (spec.joint, known(&model)) {
            ('r', Some(known)) => Joint::Revolute { coordinate: Coordinate(known as u32), factor, axis },
            ('p', Some(known)) => Joint::Prismatic { coordinate: Coordinate(known as u32), factor, axis },
            ('r', None) => Joint::Revolute { coordinate: model.declare_coordinate(&name, None), factor, axis },
            ('p', None) => Joint::Prismatic { coordinate: model.declare_coordinate(&name, None), factor, axis },
            _ => Joint::Fixed,
        };
        let graph = &mut model.graph;
        let origin = spec.origin.map(|component| graph.number(ratio(component, 1000)));
        let inertia = if spec.known {
            let mass = graph.number(ratio(7, 10));
            let centre = [3, -2, 5].map(|component| graph.number(ratio(component, 100)));
            let moments = [30, 1, -2, 40, 3, 50].map(|moment| graph.number(ratio(moment, 1000)));
            let turned = Rotation::roll_pitch_yaw(&[
                Angle::half_tangent(&ratio(1, 5)),
                Angle::quarter_turns(1),
                Angle::half_tangent(&ratio(-1, 2)),
            ]);
            Inertia::Known(about_origin(graph, mass, &centre, &moments, &turned))
        } else {
            Inertia::Unknown
        };
        let rotation = Rotation::roll_pitch_yaw(&spec.turned);
        bodies.push(Body { parent: spec.parent, origin, rotation, joint, inertia });
    }
    let gravity = [1, -2, -9].map(|component| model.graph.integer(component));
    let tree = Tree::new(gravity, bodies).expect("a tree");
    let labels = (0..specs.len()).map(|index| Label { name: format!("b{index}"), term: TermId(index as u32) });
    let mut mechanism = Mechanism { tree, labels: labels.collect(), near: Vec::new(), drives: Vec::new() };
    let moving: Vec<Coordinate> = (0..model.coordinates.len() as u32).map(Coordinate).collect();
    for &coordinate in &moving {
        let input = model.declare(&format!("u{}", coordinate.0), None, Kind::Input);
        let all = [Loss::Viscous, Loss::Coulomb, Loss::Offset, Loss::Rotor];
        let losses = if drives { all.to_vec() } else { Vec::new() };
        let name = format!("d{}", coordinate.0);
        let moves = vec![(coordinate, integer(1))];
        mechanism.drives.push(Drive { name, moves, input: Some(input), losses, term: TermId(1000) });
    }
    model.equations = mechanism.equations(&mut model);
    (model, mechanism)
}

fn dot(graph: &mut Graph, a: &Vector, b: &Vector) -> ExprId {
    let products = [0, 1, 2].map(|i| graph.mul(a[i], b[i]));
    graph.sum(&products)
}

fn cross(graph: &mut Graph, a: &Vector, b: &Vector) -> Vector {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let (plus, minus) = (graph.mul(a[i], b[j]), graph.mul(a[j], b[i]));
        graph.sub(plus, minus)
    })
}

fn add(graph: &mut Graph, a: &Vector, b: &Vector) -> Vector {
    [0, 1, 2].map(|i| graph.add(a[i], b[i]))
}

fn times(graph: &mut Graph, matrix: &[Vector; 3], vector: &Vector) -> Vector {
    [0, 1, 2].map(|i| dot(graph, &matrix[i], vector))
}

fn product(graph: &mut Graph, a: &[Vector; 3], b: &[Vector; 3]) -> [Vector; 3] {
    let column = |j: usize| [b[0][j], b[1][j], b[2][j]];
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| dot(graph, &a[i], &column(j))))
}

/// The energies of the bodies from their poses in the base: T = 1/2 m v.v + v.(w x h) + 1/2 w.I w, V = -g.(m p + h).
fn lagrangian(model: &mut ExactModel, mechanism: &Mechanism) -> Lagrangian {
    let gravity = [1, -2, -9].map(|component| model.graph.integer(component));
    let mut poses: Vec<([Vector; 3], Vector, Vector)> = Vec::new();
    let mut lagrangian = Lagrangian::default();
    for (index, body) in mechanism.tree.bodies().iter().enumerate() {
        let graph = &mut model.graph;
        let (zero, one) = (graph.integer(0), graph.integer(1));
        let identity = [[one, zero, zero], [zero, one, zero], [zero, zero, one]];
        let (frame, place, spin) = body.parent.map_or((identity, [zero; 3], [zero; 3]), |parent| poses[parent]);
        let offset = times(graph, &frame, &body.origin);
        let mut place = add(graph, &place, &offset);
        let turned: [Vector; 3] = [0, 1, 2].map(|i| [0, 1, 2].map(|j| graph.number(body.rotation.entry(i, j).clone())));
        let mut frame = product(graph, &frame, &turned);
        let mut spin = spin;
        match &body.joint {
            Joint::Fixed => {}
            Joint::Revolute { coordinate, factor, axis } => {
                let axis = [0, 1, 2].map(|i| graph.number(axis[i].clone()));
                let [angle, rate] = [0, 1].map(|order| {
                    let derivative = graph.derivative_of(*coordinate, order);
                    graph.scale(derivative, factor.clone())
                });
                let (c, s) = (graph.function(Function::Cos, angle), graph.function(Function::Sin, angle));
                let versine = graph.sub(one, c);
                // Rodrigues: column j is e_j cos q + (a x e_j) sin q + a a_j (1 - cos q).
                let columns = [0, 1, 2].map(|j| {
                    let across = cross(graph, &axis, &identity[j]);
                    [0, 1, 2].map(|i| {
                        let parts = [
                            graph.mul(identity[j][i], c),
                            graph.mul(across[i], s),
                            graph.product(&[axis[i], axis[j], versine]),
                        ];
                        graph.sum(&parts)
                    })
                });
                let turn = [0, 1, 2].map(|i| [0, 1, 2].map(|j| columns[j][i]));
                let own = times(graph, &frame, &axis).map(|component| graph.mul(component, rate));
                spin = add(graph, &spin, &own);
                frame = product(graph, &frame, &turn);
            }
            Joint::Prismatic { coordinate, factor, axis } => {
                let axis = [0, 1, 2].map(|i| graph.number(axis[i].clone()));
                let position = graph.derivative_of(*coordinate, 0);
                let position = graph.scale(position, factor.clone());
                let own = times(graph, &frame, &axis).map(|component| graph.mul(component, position));
                place = add(graph, &place, &own);
            }
        }
        poses.push((frame, place, spin));
        let velocity = place.map(|component| graph.time_derivative(component));
        let inertia: [ExprId; 10] = match &body.inertia {
            Inertia::Known(values) => *values,
            _ => std::array::from_fn(|k| {
                let name = parameter_name(NAMES[k], &mechanism.labels[index].name);
                match model.find_symbol(&name) {
                    Some(symbol) => model.graph.symbol(symbol),
                    // It enters no equation, whatever its value is.
                    None => model.graph.number(ratio(13, 7)),
                }
            }),
        };
        let graph = &mut model.graph;
        let first = times(graph, &frame, &[inertia[1], inertia[2], inertia[3]]);
        let [xx, xy, xz, yy, yz, zz] = [4, 5, 6, 7, 8, 9].map(|k| inertia[k]);
        let tensor = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let turned = product(graph, &frame, &tensor);
        let back = [0, 1, 2].map(|i| [0, 1, 2].map(|j| frame[j][i]));
        let tensor = product(graph, &turned, &back);
        let half = ratio(1, 2);
        let square = dot(graph, &velocity, &velocity);
        let square = graph.mul(inertia[0], square);
        let swung = cross(graph, &spin, &first);
        let momentum = times(graph, &tensor, &spin);
        let turning = dot(graph, &spin, &momentum);
        let kinetic = [graph.scale(square, half.clone()), dot(graph, &velocity, &swung), graph.scale(turning, half)];
        let heavy = place.map(|component| graph.mul(component, inertia[0]));
        let heavy = add(graph, &heavy, &first);
        let height = dot(graph, &gravity, &heavy);
        let term = |expr| SourceTerm { id: TermId(index as u32), expr };
        lagrangian.kinetic.extend(kinetic.map(term));
        lagrangian.potential.push(term(graph.neg(height)));
    }
    for coordinate in (0..model.coordinates.len() as u32).map(Coordinate) {
        let input = model.find_symbol(&format!("u{}", coordinate.0)).expect("an input");
        let expr = model.graph.symbol(input);
        lagrangian.forces.push((coordinate, SourceTerm { id: TermId(0), expr }));
    }
    lagrangian
}

/// The largest multiple of half a coordinate by which a joint turns here.
const MOST_HALVES: i64 = 4;

/// A random rational state: cosines and sines of half the coordinates on the circle, everything else drawn.
struct Point {
    circle: HashMap<Coordinate, (Rational, Rational)>,
    leaves: BTreeMap<(u32, u32), Rational>,
    rng: ChaCha8Rng,
}

impl Point {
    fn new(seed: u64) -> Self {
        Self { circle: HashMap::new(), leaves: BTreeMap::new(), rng: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// The exact value of an expression of coordinates, their derivatives and symbols.
    fn value(&mut self, graph: &mut Graph, expr: ExprId) -> Rational {
        let mut replaced = HashMap::new();
        for leaf in graph.leaves(expr) {
            let Node::Derivative(coordinate, 0) = *graph.node(leaf) else { continue };
            let (cosine, sine) = self.circle.entry(coordinate).or_insert_with(|| {
                let t = ratio(self.rng.random_range(-9..10), self.rng.random_range(1..10));
                let divisor = integer(1) + &t * &t;
                ((integer(1) - &t * &t) / &divisor, integer(2) * t / divisor)
            });
            // Joints that follow others turn by multiples of half a coordinate.
            let (mut c, mut s) = (integer(1), integer(0));
            for halves in 1..=MOST_HALVES {
                (c, s) = (&c * &*cosine - &s * &*sine, &s * &*cosine + &c * &*sine);
                let angle = graph.scale(leaf, ratio(halves, 2));
                let (cosine, sine) = (graph.number(c.clone()), graph.number(s.clone()));
                replaced.insert(graph.function(Function::Cos, angle), cosine);
                replaced.insert(graph.function(Function::Sin, angle), sine);
            }
        }
        let expr = graph.substitute(expr, &replaced);
        let value = graph.evaluate_exact(expr, |node| {
            let key = match node {
                Node::Derivative(coordinate, order) => (coordinate.0, *order),
                Node::Symbol(Symbol(index)) => (*index, 1000),
                other => panic!("{other:?} has no value"),
            };
            let drawn = self
                .leaves
                .entry(key)
                .or_insert_with(|| ratio(self.rng.random_range(-20..21), self.rng.random_range(1..9)));
            Some(drawn.clone())
        });
        value.expect("a rational value")
    }
}

/// Composite rigid bodies give the slopes of the torques in the accelerations, both ways round, and leave out what is zero.
fn check_masses(
    model: &mut ExactModel,
    mechanism: &Mechanism,
    inertias: &[[ExprId; 10]],
    torques: &[(Coordinate, ExprId)],
) {
    let graph = &mut model.graph;
    let entries = mechanism.tree.mass_matrix(graph, |body| inertias[body]);
    let zero = graph.integer(0);
    for &(row, torque) in torques {
        for &(column, _) in torques {
            let acceleration = graph.derivative_of(column, 2);
            let slope = graph.differentiate(torque, acceleration);
            let own =
                entries.iter().find(|entry| (entry.0, entry.1) == (row, column) || (entry.1, entry.0) == (row, column));
            let entry = own.map_or(zero, |entry| entry.2);
            for seed in 0..2 {
                let mut point = Point::new(seed);
                let expected = point.value(graph, slope);
                assert_eq!(point.value(graph, entry), expected, "mass of q{}, q{}", row.0, column.0);
            }
        }
    }
}

/// The recursion gives the equations of Lagrange, and the torques of the recursion over wrenches are those of the regressor.
fn check(specs: &[Spec], identity: bool) {
    let (mut model, mechanism) = mechanism(specs, false);
    let energies = lagrangian(&mut model, &mechanism);
    let derived = euler_lagrange(&mut model, &energies).expect("energies of a mechanical system");
    let inertias: Vec<[ExprId; 10]> = mechanism
        .labels
        .iter()
        .map(|label| {
            NAMES.map(|name| match model.find_symbol(&parameter_name(name, &label.name)) {
                Some(symbol) => model.graph.symbol(symbol),
                None => model.graph.integer(0),
            })
        })
        .collect();
    let torques = mechanism.tree.torques(&mut model.graph, |body| inertias[body]);
    let sum = |model: &mut ExactModel, terms: &[SourceTerm]| {
        let terms: Vec<ExprId> = terms.iter().map(|term| term.expr).collect();
        model.graph.sum(&terms)
    };
    check_masses(&mut model, &mechanism, &inertias, &torques);
    assert_eq!(model.equations.len(), derived.equations.len());
    let equations = model.equations.clone();
    for ((ours, theirs), (coordinate, torque)) in equations.iter().zip(&derived.equations).zip(torques) {
        assert_eq!(ours.name, theirs.name);
        let (ours, theirs) = (sum(&mut model, &ours.terms), sum(&mut model, &theirs.terms));
        let input = model.find_symbol(&format!("u{}", coordinate.0)).expect("an input");
        let input = model.graph.symbol(input);
        let torque = model.graph.sub(torque, input);
        for seed in 0..4 {
            let mut point = Point::new(seed);
            let value = point.value(&mut model.graph, ours);
            assert_eq!(value, point.value(&mut model.graph, theirs), "row of q{}", coordinate.0);
            assert_eq!(value, point.value(&mut model.graph, torque), "torque of q{}", coordinate.0);
        }
        if identity {
            let difference = model.graph.sub(ours, theirs);
            assert!(trigonometric::is_zero(&mut model.graph, difference));
        }
    }
}

#[test]
fn two_revolute_joints_are_lagranges_equations_as_polynomials() {
    check(
        &[
            unknown(None, 'r', [0, 0, 1], [10, 0, 300], quarters([0, 0, 0])),
            unknown(Some(0), 'r', [0, 0, 1], [0, -120, 40], quarters([-1, 0, 0])),
        ],
        true,
    );
}

#[test]
fn three_joints_about_any_axes_are_lagranges_equations() {
    check(
        &[
            unknown(None, 'r', [0, 0, 1], [0, 0, 300], quarters([0, 0, 0])),
            unknown(Some(0), 'r', [0, -1, 0], [200, 30, 0], quarters([1, 1, 0])),
            unknown(
                Some(1),
                'r',
                [2, -1, 2],
                [-100, 0, 70],
                [Angle::half_tangent(&ratio(1, 3)), Angle::quarter_turns(2), Angle::half_tangent(&ratio(-2, 5))],
            ),
        ],
        false,
    );
}

#[test]
fn sliding_joints_are_lagranges_equations() {
    check(
        &[
            unknown(None, 'r', [1, 0, 0], [0, 50, 0], quarters([0, 1, 0])),
            unknown(Some(0), 'p', [0, 0, 1], [200, 30, 0], quarters([1, 0, 1])),
            unknown(Some(1), 'r', [0, 1, 0], [0, 10, 70], quarters([0, 0, 1])),
        ],
        false,
    );
    check(
        &[
            unknown(None, 'p', [-1, 0, 0], [0, 0, 0], quarters([0, 0, 0])),
            unknown(Some(0), 'r', [0, 0, 1], [0, 0, 90], quarters([3, 0, 0])),
            unknown(Some(1), 'p', [3, 0, 4], [20, 0, 0], quarters([0, 2, 0])),
        ],
        false,
    );
}

#[test]
fn branches_and_fixed_bodies_are_lagranges_equations() {
    let mut specs = vec![
        unknown(None, 'f', [0, 0, 1], [5, 6, 7], quarters([0, 1, 0])),
        unknown(Some(0), 'r', [0, 0, 1], [0, 0, 300], quarters([0, 0, 0])),
        unknown(Some(1), 'f', [0, 0, 1], [10, -20, 30], quarters([0, 0, 1])),
        unknown(Some(2), 'r', [0, 1, 0], [200, 30, 0], quarters([1, 0, 0])),
        unknown(Some(1), 'r', [1, 0, 0], [0, -90, 0], quarters([0, 0, 2])),
    ];
    check(&specs, false);
    for index in [0, 2, 4] {
        specs[index].known = true;
    }
    specs.push(Spec { known: true, ..unknown(Some(2), 'f', [0, 0, 1], [1, 2, 3], quarters([0, 3, 0])) });
    check(&specs, false);
}

/// Two fingers on a turning wrist that share a coordinate, a link that turns half as far back as its carrier, a slide on it that moves
/// with the angle, and a link at twice the angle of the first on an axis of both frames.
#[test]
fn joints_that_share_a_coordinate_have_the_equations_of_lagrange() {
    let follows = |spec: Spec, leader, factor| Spec { follows: Some((leader, factor)), ..spec };
    let none = quarters([0, 0, 0]);
    let skew = [Angle::half_tangent(&ratio(1, 3)), Angle::quarter_turns(1), Angle::quarter_turns(0)];
    let finger = |axis| unknown(Some(0), 'p', axis, [20, 10, 100], quarters([0, 1, 0]));
    let specs = [
        unknown(None, 'r', [0, 0, 1], [0, 0, 100], none.clone()),
        finger([0, 1, 0]),
        follows(finger([0, 1, 0]), 1, integer(-1)),
    ];
    check(&specs, false);
    let specs = [
        unknown(None, 'r', [0, 3, 4], [0, 0, 100], skew.clone()),
        follows(unknown(Some(0), 'r', [0, 0, 1], [30, 20, 0], skew), 0, ratio(-1, 2)),
        follows(unknown(Some(1), 'p', [1, 0, 0], [0, 10, 0], none.clone()), 0, ratio(3, 2)),
    ];
    check(&specs, false);
    let specs = [
        unknown(None, 'r', [0, 0, 1], [0, 0, 100], none.clone()),
        unknown(Some(0), 'r', [0, 1, 0], [10, 0, 200], none.clone()),
        follows(unknown(Some(1), 'r', [0, -1, 0], [0, 0, 300], none), 1, integer(2)),
    ];
    check(&specs, false);
}

#[test]
fn a_parameter_that_enters_no_equation_is_not_declared() {
    let (model, _) = mechanism(&[unknown(None, 'r', [0, 0, 1], [0, 0, 300], quarters([0, 0, 0]))], true);
    let names: Vec<&str> = model.parameters().map(|symbol| model.quantity(symbol).name.as_str()).collect();
    // Gravity is not along the axis, so that the first moments show.
    assert_eq!(names, ["mx_b0", "my_b0", "Izz_b0", "fv_d0", "fc_d0", "f0_d0", "Ia_d0"]);
    let [equation] = model.equations.as_slice() else { panic!("one joint, one equation") };
    let terms: Vec<String> = equation.terms.iter().map(|term| model.display(term.expr)).collect();
    assert_eq!(terms.last().map(String::as_str), Some("-u0"));
    assert!(terms.contains(&"sign(dot(q0))*fc_d0".to_owned()), "{terms:?}");
}

#[test]
fn a_coupled_drive_puts_its_torques_on_all_its_joints() {
    let specs = [
        unknown(None, 'r', [0, 0, 1], [0, 0, 300], quarters([0, 0, 0])),
        unknown(Some(0), 'r', [0, 0, 1], [0, -120, 40], quarters([-1, 0, 0])),
    ];
    let (model, mut mechanism) = mechanism(&specs, false);
    let moves = vec![(Coordinate(0), integer(1)), (Coordinate(1), integer(-2))];
    let input = model.find_symbol("u1").expect("an input");
    mechanism.drives[1] =
        Drive { name: "wrist".to_owned(), moves, input: Some(input), losses: vec![Loss::Viscous], term: TermId(9) };
    let mut model = ExactModel { equations: Vec::new(), ..model };
    let equations = mechanism.equations(&mut model);
    let texts = |row: usize| -> Vec<String> {
        let terms = equations[row].terms.iter().filter(|term| term.id == TermId(9));
        terms.map(|term| model.display(term.expr)).collect()
    };
    assert_eq!(texts(0), ["(dot(q0) - 2*dot(q1))*fv_wrist", "-u1"]);
    assert_eq!(texts(1), ["-2*(dot(q0) - 2*dot(q1))*fv_wrist", "2*u1"]);
}

#[test]
fn what_is_no_tree_is_refused() {
    let mut graph = Graph::new();
    let zero = [graph.integer(0); 3];
    let body =
        |parent, joint| Body { parent, origin: zero, rotation: Rotation::identity(), joint, inertia: Inertia::None };
    let turning =
        |axis: &[Rational; 3]| Joint::Revolute { coordinate: Coordinate(0), factor: integer(1), axis: axis.clone() };
    let error = |bodies| Tree::new(zero, bodies).expect_err("no tree");
    assert_eq!(error(vec![body(Some(0), Joint::Fixed)]), TreeError::Order { body: 0, parent: 0 });
    assert_eq!(error(vec![body(None, turning(&[0, 0, 0].map(integer)))]), TreeError::Axis { body: 0 });
}

/// Operations on the UR10's geometry. The recursion that is written by hand in CasADi has 405 multiplications and 317 additions for
/// the torques with all parameters, and 573 and 384 for the columns of the base parameters of the regressor.
#[test]
fn the_recursion_of_six_joints_is_as_short_as_one_written_by_hand() {
    let specs = [
        unknown(None, 'r', [0, 0, 1], [0, 0, 127], quarters([0, 0, 0])),
        unknown(Some(0), 'r', [0, 1, 0], [0, 220, 0], quarters([0, 1, 0])),
        unknown(Some(1), 'r', [0, 1, 0], [0, -171, 612], quarters([0, 0, 0])),
        unknown(Some(2), 'r', [0, 1, 0], [0, 0, 572], quarters([0, 1, 0])),
        unknown(Some(3), 'r', [0, 0, 1], [0, 114, 0], quarters([0, 0, 0])),
        unknown(Some(4), 'r', [0, 1, 0], [0, 0, 115], quarters([0, 0, 0])),
    ];
    let (mut model, mechanism) = mechanism(&specs, false);
    let gravity = [0, 0, -9].map(|component| model.graph.integer(component));
    let tree = Tree::new(gravity, mechanism.tree.bodies().to_vec()).expect("a tree");
    let graph = &mut model.graph;
    let inertias: Vec<[ExprId; 10]> =
        (0..6).map(|body| std::array::from_fn(|k| graph.symbol(Symbol(1000 + 10 * body + k as u32)))).collect();
    let torques: Vec<ExprId> =
        tree.torques(graph, |body| inertias[body]).into_iter().map(|(_, torque)| torque).collect();
    let counts = Plan::new(graph, &torques).counts();
    assert!(counts.multiplications + counts.additions <= 405 + 317, "{counts:?}");
    let rows = tree.regressor(graph);
    let entries: Vec<ExprId> = rows.iter().flat_map(|row| &row.entries).map(|entry| entry.expr).collect();
    let counts = Plan::new(graph, &entries).counts();
    assert!(counts.multiplications + counts.additions <= 573 + 384, "{counts:?}");
}
