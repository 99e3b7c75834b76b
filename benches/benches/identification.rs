//! Identification of system A (Feng, Eqn 3.24): a whole campaign with its simulated machine, a record reduced to harmonics, and an
//! update from there to new parameters.
//!
//! Reduction needs the record. It takes the record's spectra (transform, phasors, covariance of their noise), then runs
//! `Estimator::reduce`: rows and their derivatives along the reference or the measured motion, harmonics of the
//! feed-forward, and the noise of the equations, read bin by bin at a first estimate, which is an update without that
//! noise. The update, `Estimator::update`, needs only harmonics, their noise, the parameters behind the feed-forward and
//! the pool of earlier runs. It consists of right-hand sides, weights, least squares, pooling, rank and covariance.
//! With measured motion, the update is repeated with weights at the new parameters until the parameters stand still.
//!
//! A log of two million rows is identified from its file on.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::io::Write as _;
use tpm_estimate::{Method, Run};
use tpm_models::mass_spring_drag;
use tpm_motion::Spectra;
use tpm_runtime::campaign::Campaign;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::plant::simulated::simulate;
use tpm_runtime::session::{DeclaredModel, Machine, from_log};
use tpm_symbolic::regressor::prepare::prepare;

const MODEL: &str = include_str!("../../models/mass_spring_drag.tpm");
const METHODS: [Method; 4] = [Method::Error, Method::Effort, Method::Hill, Method::MeasuredMotion];
const EXPERIMENT: &str = include_str!("../../models/mass_spring_drag.toml");

fn system_a() -> (Machine, Experiment) {
    let source = tpm_codegen::source::Source::new("mass_spring_drag.tpm", MODEL);
    let parsed = tpm_codegen::parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let prepared = prepare(parsed.model).expect("linear in its parameters");
    let pattern = prepared.model.pattern(None).expect("has a pattern").clone();
    let experiment = Experiment::parse(EXPERIMENT).expect("the shipped file is right");
    let machine =
        Machine::new(&prepared, &pattern, &experiment, &std::collections::BTreeMap::new()).expect("a machine");
    (machine, experiment)
}

/// Eight runs of twenty seconds of plant time at 1 kHz, two in every stage.
fn campaign(criterion: &mut Criterion) {
    let (machine, mut experiment) = system_a();
    let schedule = &mut experiment.schedule;
    schedule.stages = schedule.stages.iter().flat_map(|stage| [stage.clone(), stage.clone()]).collect();
    schedule.updates_per_stage = 1;
    let identify = || machine.identify(black_box(&experiment), &mut |_| true).expect("runs").runs.len();
    assert_eq!(identify(), 8);
    let mut group = criterion.benchmark_group("campaign of system A");
    group.sample_size(10);
    group.bench_function("8 runs of 20 s at 1 kHz", |b| b.iter(identify));
    group.finish();
}

fn update(criterion: &mut Criterion) {
    let (machine, experiment) = system_a();
    let plant = machine.plant();
    let setup = experiment.setup(plant, machine.pattern(), Hold::Zoh).expect("fits");
    let settings = setup.estimation.clone();
    let campaign = Campaign::new(plant, setup).expect("playable");
    let trial = campaign.next().expect("the first run").clone();
    let record = simulate(plant, &experiment.bench(plant).expect("fits"), &trial).expect("plays");
    let from = experiment.schedule.settle_periods;
    let samples = trial.samples_per_period;
    let channels: Vec<&[f64]> = record.coordinates.iter().chain(&record.inputs).map(|c| &c[from * samples..]).collect();
    let spectra = Spectra::analyse(&channels, record.sample_time, samples as f64, trial.periods - from).expect("whole");
    let run = Run { trial: &trial, spectra: &spectra, rates: None, hold: Hold::Zoh, alone: None };
    let mut group = criterion.benchmark_group("reduction of a record of 20 s at 1 kHz");
    group.bench_function("spectra", |b| {
        let periods = trial.periods - from;
        b.iter(|| Spectra::analyse(black_box(&channels), record.sample_time, samples as f64, periods).expect("whole"));
    });
    for method in METHODS {
        group.bench_function(method.name(), |b| {
            let first = || method.estimator(&settings);
            b.iter_batched(
                first,
                |mut estimator| estimator.reduce(plant, black_box(&run)).map(|()| estimator),
                BatchSize::SmallInput,
            );
        });
    }
    group.finish();
    let mut group = criterion.benchmark_group("one update from harmonics to parameters");
    for method in METHODS {
        let mut estimator = method.estimator(&settings);
        estimator.take(plant, &run).expect("an update");
        if method != Method::MeasuredMotion {
            // A second run is pooled with the first one.
            estimator.reduce(plant, &run).expect("reduced");
        }
        group.bench_function(method.name(), |b| b.iter(|| estimator.update().expect("an update")));
    }
    let sampled = || (0..samples).map(|n| (n as f64 / samples as f64 * std::f64::consts::TAU, record.inputs[0][n]));
    let mut sums = mass_spring_drag::Accumulator::new();
    sampled().for_each(|(phase, u)| sums.push(phase, &mass_spring_drag::Forces { u }));
    let harmonics = sums.harmonics().expect("samples were taken in");
    let pattern = mass_spring_drag::Pattern { lambda: 0.2, w: std::f64::consts::PI };
    group.bench_function("generated, from the force through the table", |b| {
        b.iter(|| black_box(&pattern).parameters(black_box(&harmonics)));
    });
    group.finish();
}

/// A pendulum driven by a motor, to and fro for 4,000 s, as a file: read, identified by its harmonics, refined.
fn long_log(criterion: &mut Criterion) {
    // Tests of benchmarks run a short one.
    let rows = if std::env::args().any(|argument| argument == "--bench") { 2_000_000 } else { 20_000 };
    const PENDULUM: &str = "model Pendulum {
        coordinate q [rad];
        input u [N*m];
        parameter J [kg*m^2], d [N*m*s/rad], fc [N*m], mgl [N*m];

        J*ddot(q) + d*dot(q) + fc*sign(dot(q)) + mgl*sin(q) = u;
    }";
    let file = tempfile::NamedTempFile::new().expect("a file");
    let mut out = std::io::BufWriter::new(file.reopen().expect("a file"));
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        12.0_f64.sqrt() * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
    };
    writeln!(out, "t_s,q,u").expect("a disk with room");
    for k in 0..rows {
        let t = 0.002 * k as f64 + 7e-4;
        let ((s, c), (s3, c3)) = ((4.0 * t).sin_cos(), (12.0 * t).sin_cos());
        let [q, v, a] = [0.8 * (c - c3 / 9.0), 3.2 * (s3 / 3.0 - s), 12.8 * (c3 - c)];
        let u = 0.01 * a + 0.005 * v + 0.03 * v.signum() + 0.5 * q.sin();
        writeln!(out, "{t:.4},{:.7},{:.6}", q + 1e-4 * noise(), u + 1e-3 * noise()).expect("a disk with room");
    }
    drop(out);
    let model = DeclaredModel::parse("Pendulum", PENDULUM).expect("a model");
    let mut group = criterion.benchmark_group("a log of two million rows");
    group.sample_size(10);
    group.bench_function("from the file to parameters", |b| {
        b.iter(|| from_log(black_box(&model), file.path()).expect("identifies").rank);
    });
    group.finish();
}

criterion_group!(benches, campaign, update, long_log);
criterion_main!(benches);
