//! Linearised transitions against differences of the simulation.

use crate::output_error::chain::Chain;
use crate::output_error::problem::{Column, Differentiable, Place, Problem, Trajectory};
use crate::transition::states;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model as _;
use tpm_interpret::{Interpreted, InterpretedDerivatives};
use tpm_test_support::models::differentiable;

/// A pendulum on a driven cart that springs and damps.
const CART: &str = "model Cart {
    coordinate x, a;
    input u;
    parameter M, ml, J, k, c, g, d;

    M*ddot(x) + ml*cos(a)*ddot(a) - ml*sin(a)*dot(a)^2 + k*x + c*dot(x)*abs(dot(x)) = u;
    ml*cos(a)*ddot(x) + J*ddot(a) + g*sin(a) + d*dot(a) = 0;
}";
const THETA: [f64; 7] = [3.0, 0.4, 0.3, 50.0, 2.0, 4.0, 0.1];
const FREE: [usize; 7] = [0, 1, 2, 3, 4, 5, 6];
const SAMPLES: usize = 8;
/// The transition that is looked at.
const AT: usize = 3;
const ORDER: usize = 4;

struct Bench {
    model: Interpreted,
    derivatives: InterpretedDerivatives,
    sample_time: f64,
    force: Vec<f64>,
    trajectory: Trajectory,
    zeros: Vec<f64>,
}

impl Bench {
    fn new(sample_time: f64) -> Self {
        let (model, derivatives) = differentiable(CART);
        let force = (0..SAMPLES).map(|k| 20.0 * (7.0 * k as f64 * sample_time).cos()).collect();
        // Far from equilibrium, each state at a sample of its own.
        let states = (0..SAMPLES).flat_map(|k| {
            let t = k as f64 * sample_time;
            [0.1 + t, 1.0 - 3.0 * t, 0.8 - 2.0 * t, -2.0 + 5.0 * t]
        });
        let trajectory = Trajectory { states: states.collect(), disturbed: vec![0.0; SAMPLES], applied: None };
        Self { model, derivatives, sample_time, force, trajectory, zeros: vec![0.0; SAMPLES] }
    }

    fn problem(&self, hold: Hold) -> Problem<'_> {
        let states = states(&self.model).expect("as many rows as coordinates");
        assert_eq!(states, [(0, 0), (0, 1), (1, 0), (1, 1)]);
        Problem {
            machine: Differentiable { model: &self.model, derivatives: &self.derivatives },
            constants: &[],
            hold,
            sample_time: self.sample_time,
            coordinates: vec![&self.zeros, &self.zeros],
            readings: vec![&self.zeros, &self.zeros],
            sensors: vec![0, 2],
            inputs: vec![&self.force],
            free: FREE.to_vec(),
            states,
            breaks: vec![false; SAMPLES - 1],
            steps: 1,
            shortest_passage: 1,
            scale: vec![1.0, 1.0],
            hidden: Vec::new(),
        }
    }

    fn linearise(&self, problem: &Problem<'_>, trajectory: &Trajectory, theta: &[f64]) -> Chain {
        problem.linearise_at(trajectory, theta, &[], &[]).expect("evaluates")
    }
}

/// Central difference of the defects of a transition, over a small step of some number.
fn difference(step: f64, defect: impl Fn(f64) -> Vec<f64>) -> Vec<f64> {
    let [before, after] = [-step, step].map(defect);
    after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * step)).collect()
}

/// Largest errors of transition, parameters and input, each as a share of the largest entry that differs from rest.
fn errors(sample_time: f64, hold: Hold) -> [f64; 3] {
    let bench = Bench::new(sample_time);
    let problem = bench.problem(hold);
    let chain = bench.linearise(&problem, &bench.trajectory, &THETA);
    assert_eq!((chain.order, chain.columns, chain.inputs, chain.switches), (ORDER, FREE.len(), 1, 0));
    let (mut wrong, mut size) = ([0.0_f64; 3], [0.0_f64; 3]);
    let mut compare = |what: usize, found: f64, expected: f64, rest: f64| {
        wrong[what] = wrong[what].max((found - expected).abs());
        size[what] = size[what].max((expected - rest).abs());
    };
    for of in 0..ORDER {
        let expected = difference(1e-5, |by| {
            let mut moved = bench.trajectory.clone();
            moved.states[AT * ORDER + of] += by;
            bench.linearise(&problem, &moved, &THETA).defect(AT).to_vec()
        });
        for (s, expected) in expected.iter().enumerate() {
            compare(0, chain.transition(AT, s)[of], *expected, if s == of { 1.0 } else { 0.0 });
        }
    }
    for j in FREE {
        let expected = difference(1e-5 * THETA[j], |by| {
            let mut theta = THETA;
            theta[j] += by;
            bench.linearise(&problem, &bench.trajectory, &theta).defect(AT).to_vec()
        });
        for (s, expected) in expected.iter().enumerate() {
            compare(1, chain.forcing(AT, s)[j], *expected, 0.0);
        }
    }
    let expected = difference(1e-3, |by| {
        let mut moved = bench.trajectory.clone();
        moved.disturbed[AT] = by;
        bench.linearise(&problem, &moved, &THETA).defect(AT).to_vec()
    });
    for (s, expected) in expected.iter().enumerate() {
        compare(2, chain.forcing(AT, s)[FREE.len()], *expected, 0.0);
    }
    [0, 1, 2].map(|what| wrong[what] / size[what])
}

#[test]
fn a_transition_is_linearised_as_the_simulation_changes() {
    for hold in [Hold::Zoh, Hold::None] {
        let [coarse, fine] = [4e-3, 2e-3].map(|sample_time| errors(sample_time, hold));
        for (coarse, fine) in coarse.iter().zip(&fine) {
            assert!(*fine < 1e-4, "{hold}: {coarse:e} {fine:e}");
            // The middle of a transition leaves an error of the second order.
            assert!(fine / coarse < 0.35, "{hold}: {coarse:e} {fine:e}");
        }
    }
}

#[test]
fn defects_and_errors_are_those_of_the_states() {
    let bench = Bench::new(2e-3);
    let problem = bench.problem(Hold::Zoh);
    let chain = bench.linearise(&problem, &bench.trajectory, &THETA);
    // From the simulated next state on there is no defect left.
    let mut simulated = bench.trajectory.clone();
    for s in 0..ORDER {
        simulated.states[(AT + 1) * ORDER + s] += chain.defect(AT)[s];
    }
    let again = bench.linearise(&problem, &simulated, &THETA);
    assert!(again.defect(AT).iter().all(|defect| defect.abs() < 1e-15), "{:?}", again.defect(AT));
    assert!(chain.defect(AT).iter().any(|defect| defect.abs() > 1e-4));
    for k in 0..SAMPLES {
        assert_eq!([0, 1].map(|c| chain.error(k, c)), [0, 2].map(|s| -bench.trajectory.states[k * ORDER + s]));
    }
}

#[test]
fn columns_act_as_forces_and_on_readings() {
    let bench = Bench::new(2e-3);
    let problem = bench.problem(Hold::Zoh);
    let column = |place: Place, held: bool| Column { place, values: vec![2.0; SAMPLES], held };
    let columns = [column(Place::Row(0), true), column(Place::Reading(1), false), column(Place::Row(1), false)];
    let bare = bench.linearise(&problem, &bench.trajectory, &THETA);
    let values = [0.3, 0.05, 0.0];
    let chain = problem.linearise_at(&bench.trajectory, &THETA, &columns, &values).expect("evaluates");
    let p = FREE.len();
    for s in 0..ORDER {
        let forcing = chain.forcing(AT, s);
        // A force on the left-hand side of the input's row is an input of the other sign.
        assert!((forcing[p] + 2.0 * forcing[p + 3]).abs() < 1e-15);
        assert!(forcing[p + 1].abs() < f64::MIN_POSITIVE);
        assert!((chain.defect(AT)[s] - bare.defect(AT)[s] - values[0] * forcing[p]).abs() < 1e-15);
    }
    assert!(chain.forcing(AT, 3)[p + 2].abs() > 0.0);
    assert_eq!(chain.readings(AT, 1)[p..], [0.0, 2.0, 0.0]);
    assert!(chain.readings(AT, 0).iter().all(|value| value.abs() < f64::MIN_POSITIVE));
    assert!((chain.error(AT, 1) - (bare.error(AT, 1) - 0.1)).abs() < 1e-15);
    assert!((chain.error(AT, 0) - bare.error(AT, 0)).abs() < 1e-15);
}

#[test]
fn models_without_a_motion_of_their_own_have_no_states() {
    let (static_row, _) = differentiable("model P { coordinate x; input u; parameter k; k*x = u; }");
    assert_eq!(states(&static_row), None);
    let (two_rows, _) =
        differentiable("model P { coordinate x; input u, v; parameter m, k; m*ddot(x) = u; k*dot(x) = v; }");
    assert!(two_rows.dims().rows == 2 && states(&two_rows).is_none());
}

#[test]
fn an_input_that_acts_otherwise_than_recorded_replaces_the_record() {
    let bench = Bench::new(2e-3);
    for hold in [Hold::Zoh, Hold::None] {
        let problem = bench.problem(hold);
        let mut other = bench.trajectory.clone();
        other.applied = Some((0, bench.force.iter().map(|u| 0.5 * u).collect()));
        let replaced = bench.linearise(&problem, &other, &THETA);
        let halved = Bench { force: bench.force.iter().map(|u| 0.5 * u).collect(), ..Bench::new(2e-3) };
        let recorded = halved.linearise(&halved.problem(hold), &halved.trajectory, &THETA);
        assert_eq!(replaced.defect(AT), recorded.defect(AT), "{hold}");
        assert_ne!(replaced.defect(AT), bench.linearise(&problem, &bench.trajectory, &THETA).defect(AT), "{hold}");
    }
}
