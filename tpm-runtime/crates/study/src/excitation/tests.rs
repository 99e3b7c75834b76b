//! Excitation of arms: gradients, limits at every instant, files that are played, and what cannot be done.

use super::held::{self, Torques};
use super::problem::{Aim, MotionLimits, Problem};
use super::search::drawn;
use super::series::Series;
use super::{Criterion, ExcitationError, ExcitationSettings, excitation};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use tpm_controller::model::Model as _;
use tpm_experiment::Experiment;
use tpm_interpret::BaseRows;
use tpm_motion::trajectory::Trajectory;
use tpm_session::{DeclaredModel, Session};

/// Three joints, two of them not parallel, and one that slides.
const ARM: &str = "model Bent {
    coordinate q1 [rad], q2 [rad], s [m];
    input tau1 [N*m], tau2 [N*m], f [N];

    mechanism {
        gravity (0, 0, -9.81);
        body a { revolute q1 about z at (0, 0, 0.3); inertia parameters; }
        body b on a { revolute q2 about y at (0.1, 0, 0); inertia parameters; }
        body c on b { prismatic s along x at (0.3, 0, 0); inertia parameters; }
        drive q1 by tau1 with viscous, coulomb;
        drive q2 by tau2 with viscous;
        drive s by f with viscous;
    }
    pattern {
        amplitude A [rad], L [m];
        frequency w [rad/s];
        q1 = A*(cos(w*t) - 1/9*cos(3*w*t));
        q2 = A*(sin(w*t) - 1/2*sin(2*w*t));
        s = L*(cos(w*t) - 1/9*cos(3*w*t));
    }
}";

/// Values of the parameters: bodies of a few kilograms.
fn truth(name: &str) -> f64 {
    match name {
        name if name.starts_with("mx_") => 0.3,
        name if name.starts_with("m_") => 2.5,
        name if name.starts_with("Ixx") || name.starts_with("Iyy") || name.starts_with("Izz") => 0.2,
        name if name.starts_with("Fv") || name.starts_with("Fc") => 0.5,
        _ => 0.01,
    }
}

fn session(limits: &str) -> Session {
    let model = DeclaredModel::parse("arm", ARM).expect("a model");
    let columns = &model.prepared().form.columns;
    let values: String = columns.iter().map(|column| format!("{} = {}\n", column.name, truth(&column.name))).collect();
    let text = format!(
        "[prior]\n{values}[plant.parameters]\n{values}[control]\nsample_time = 2e-3\nfeedback = []\n[limits]\n{limits}\n\
         [schedule]\nmeasure_time = 10.0\nstages = [{{ A = 0.1, L = 0.01, w = 1.2 }}]\n"
    );
    let experiment = Experiment::parse(&text).expect("an experiment");
    Session::new(model, experiment, None, BTreeMap::new()).expect("a session")
}

const LIMITS: &str = "positions = { q1 = [-2.0, 2.0], q2 = [-1.0, 0.5], s = [-0.1, 0.3] }
velocities = { q1 = 2.0, q2 = 1.5, s = 0.4 }
accelerations = { q1 = 6.0, q2 = 6.0, s = 2.0 }
inputs = { tau1 = 12.0, tau2 = 40.0, f = 60.0 }
effort_share = 0.8";

fn settings() -> ExcitationSettings {
    ExcitationSettings { harmonics: 3, starts: 6, ..ExcitationSettings::default() }
}

const GO_ON: &(dyn Fn(usize, usize) -> bool + Sync) = &|_, _| true;

#[test]
fn values_have_the_gradients_of_difference_quotients() {
    let session = session(LIMITS);
    let declared = session.model();
    let prepared = declared.prepared();
    let rows = BaseRows::new(&prepared.model, &prepared.form, declared.parsed().mechanism.as_ref()).expect("rows");
    let parameters: Vec<f64> = prepared.form.columns.iter().map(|column| truth(&column.name)).collect();
    let limits = MotionLimits { position: (-2.0, 2.5), velocity: 9.0, acceleration: 20.0 };
    // An input that drives two rows, as coupled motors do.
    let factors = vec![1.0, 0.0, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0, -1.0];
    for (criterion, aim) in [
        (Criterion::Condition, Aim::Best(0.1)),
        (Criterion::Determinant, Aim::Best(0.02)),
        (Criterion::Condition, Aim::Feasible(0.05)),
    ] {
        let problem = Problem {
            rows: &rows,
            constants: &[],
            base: rows.lumped(&parameters),
            factors: factors.clone(),
            efforts: vec![600.0, 500.0, 700.0],
            limits: vec![limits; 3],
            weights: vec![1.0, 0.5, 2.0],
            criterion,
            room: 0.99,
        };
        let series = Series::new(vec![(0.2, 1.0), (-0.1, 0.8), (0.0, 0.3)], 3, 1.3, 36, 3);
        let mut memory = problem.memory(&series);
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let point = drawn(&problem, &series, &mut random);
        let mut value = |point: &[f64], gradient: &mut [f64]| problem.value(&series, point, aim, &mut memory, gradient);
        let mut gradient = vec![0.0; series.len()];
        assert!(value(&point, &mut gradient).is_finite());
        let mut unused = gradient.clone();
        for at in 0..point.len() {
            let h = 1e-4;
            let mut moved = |steps: f64| {
                let mut moved = point.clone();
                moved[at] += steps * h;
                value(&moved, &mut unused)
            };
            let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(&mut moved);
            let expected = (a - d + 8.0 * (c - b)) / (12.0 * h);
            let found = gradient[at];
            assert!((found - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{aim:?} {at}: {found} {expected}");
        }
    }
}

/// The largest share of a limit at phases that no search has looked at.
fn largest_share(session: &Session, motion: &Trajectory, [positions, rates, efforts]: [&[f64]; 3]) -> f64 {
    let model = session.machine().plant();
    let parameters: Vec<f64> = (0..model.dims().parameters).map(|at| truth(model.parameter(at).name)).collect();
    let (mut workspace, mut forces) = (vec![0.0; model.inverse_workspace_len()], [0.0; 3]);
    let mut most: f64 = 0.0;
    for n in 0..20_000 {
        let mut point = [0.0; 9];
        motion.motion(2.0 * PI * (f64::from(n) + 0.37) / 20_000.0, &mut point);
        model.inverse_dynamics(&point, &parameters, &[], &mut workspace, &mut forces).expect("fits");
        for c in 0..3 {
            let [low, high] = [positions[2 * c], positions[2 * c + 1]];
            let middle = f64::midpoint(low, high);
            most = most.max((point[c] - middle).abs() / (high - middle));
            most = most.max(point[3 + c].abs() / rates[c]).max(point[6 + c].abs() / rates[3 + c]);
            most = most.max(forces[c].abs() / (0.8 * efforts[c]));
        }
    }
    most
}

#[test]
fn motions_keep_within_the_limits_at_every_instant_and_show_more() {
    let session = session(LIMITS);
    for criterion in [Criterion::Condition, Criterion::Determinant] {
        let found = excitation(&session, &ExcitationSettings { criterion, ..settings() }, GO_ON).expect("motions");
        assert_eq!((found.starts, found.feasible), (6, 6));
        assert!(!found.motions.is_empty());
        for proposed in &found.motions {
            let motion = &proposed.trajectory;
            let limits: [&[f64]; 3] =
                [&[-2.0, 2.0, -1.0, 0.5, -0.1, 0.3], &[2.0, 1.5, 0.4, 6.0, 6.0, 2.0], &[12.0, 40.0, 60.0]];
            let most = largest_share(&session, motion, limits);
            assert!(most <= 1.0 && most > 0.9, "{most}");
            let mut start = [0.0; 9];
            motion.motion(0.0, &mut start);
            assert!(start[3..].iter().all(|rate| rate.abs() < 1e-9), "{start:?}");
            assert!(proposed.value < found.before - 0.2, "{} {}", proposed.value, found.before);
            assert!(proposed.used.iter().all(|used| used.share.is_some_and(|share| share <= 1.0)));
        }
        if criterion == Criterion::Condition {
            // The value bounds the logarithm of the condition number from above.
            let excess = (found.base.len() as f64).ln() / 8.0;
            for proposed in &found.motions {
                let condition = proposed.condition.ln();
                assert!(condition < proposed.value + 0.01 && condition > proposed.value - excess - 0.01);
            }
        }
        let again = excitation(&session, &ExcitationSettings { criterion, ..settings() }, GO_ON).expect("motions");
        assert_eq!(again.motions[0].trajectory, found.motions[0].trajectory);
    }
}

#[test]
fn torques_are_judged_between_the_samples() {
    let session = session(LIMITS);
    let found = excitation(&session, &settings(), GO_ON).expect("motions");
    let motion = &found.motions[0].trajectory;
    let prepared = session.model().prepared();
    let rows =
        BaseRows::new(&prepared.model, &prepared.form, session.model().parsed().mechanism.as_ref()).expect("rows");
    let parameters: Vec<f64> = prepared.form.columns.iter().map(|column| truth(&column.name)).collect();
    let free = [1e9; 6];
    let share = |efforts: [f64; 3]| {
        largest_share(&session, motion, [&[-1e9, 1e9, -1e9, 1e9, -1e9, 1e9], &free, &efforts.map(|limit| limit / 0.8)])
    };
    let factors = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let judged = |efforts: [f64; 3]| held::torques(&rows, motion, &[], &parameters, &factors, &efforts).expect("fits");
    // The second input alone is limited, at its peak and a thousandth to both sides of it.
    let peak = share([1e12, 1.0, 1e12]);
    assert_eq!(judged([1e12, 1.001 * peak, 1e12]), Torques::Within);
    let Torques::Beyond(by) = judged([1e12, 0.999 * peak, 1e12]) else { panic!("it is beyond") };
    assert!(by > 1.0 && by < 1.01, "{by}");
}

#[test]
fn files_give_the_motion_again() {
    let session = session(LIMITS);
    let found = excitation(&session, &settings(), GO_ON).expect("motions");
    let motion = &found.motions[0].trajectory;
    let files = found.files(&session, motion).expect("files");
    let model = DeclaredModel::parse("written", &files.model).expect("a model");
    let experiment = Experiment::parse(&files.experiment).expect("an experiment");
    let read = Session::new(model, experiment.clone(), None, BTreeMap::new()).expect("a session");
    let stage = &experiment.schedule.stages[0];
    let pattern = read.machine().pattern();
    let amplitudes: Vec<f64> = pattern.amplitudes.iter().map(|name| stage.values[name]).collect();
    let played = pattern.trajectory(&amplitudes, stage.values[&pattern.frequency]);
    let (mut own, mut written) = ([0.0; 9], [0.0; 9]);
    for n in 0..50 {
        motion.motion(0.1256 * f64::from(n), &mut own);
        played.motion(0.1256 * f64::from(n), &mut written);
        assert!(own.iter().zip(&written).all(|(a, b)| (a - b).abs() < 1e-12), "{own:?} {written:?}");
    }
    // The experiment's own check of references passes, and a second excitation takes other names.
    read.campaign()
        .map(|_| ())
        .or_else(|fault| if fault.to_string().contains("stable") { Ok(()) } else { Err(fault) })
        .expect("plays");
    assert!(found.files(&read, motion).expect("files").model.contains("pattern excitation2"));
    let mut lines = files.samples.lines();
    let head = lines.next().expect("a header");
    assert_eq!(head, "t,q1,q2,s,dot(q1),dot(q2),dot(s),ddot(q1),ddot(q2),ddot(s),tau1,tau2,f");
    let samples = (2.0 * PI / motion.frequency / 2e-3).round() as usize;
    assert_eq!(lines.clone().count(), samples);
    let fifth: Vec<f64> =
        lines.nth(4).expect("a sample").split(',').map(|cell| cell.parse().expect("a number")).collect();
    motion.motion_at(4, samples, 0.0, &mut own);
    assert!((fifth[0] - 8e-3).abs() < 1e-12 && fifth[1..10].iter().zip(&own).all(|(a, b)| (a - b).abs() < 1e-8));
}

#[test]
fn what_cannot_be_designed_is_said() {
    let fault = |limits: &str, settings: &ExcitationSettings| {
        excitation(&session(limits), settings, GO_ON).err().map(|fault| fault.to_string()).unwrap_or_default()
    };
    assert!(fault("velocities = { q1 = 2.0, q2 = 1.5 }", &settings()).contains("limits.velocities.s"));
    let one_sided = LIMITS.replace("[-1.0, 0.5]", "[-1.0, inf]");
    assert!(fault(&one_sided, &settings()).contains("limits.positions.q2"));
    // The second joint cannot hold the weight anywhere within its range.
    let weak = LIMITS.replace("tau2 = 40.0", "tau2 = 2.0");
    assert!(fault(&weak, &settings()).contains("none of 6 motions"));
    let short = ExcitationSettings { period: Some(0.05), ..settings() };
    assert!(fault(LIMITS, &short).contains("twenty samples"));
    let stopped = excitation(&session(LIMITS), &settings(), &|_, _| false);
    assert!(matches!(stopped, Err(ExcitationError::TooShort)));
}
