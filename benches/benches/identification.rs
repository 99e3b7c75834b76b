//! Identification of system A (Feng, Eqn 3.24): a whole campaign with its simulated machine, and one update from the harmonics
//! of a run to new parameters.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tpm_models::mass_spring_drag;
use tpm_runtime::estimate::{Method, Run};
use tpm_runtime::experiment::{Experiment, Machine};
use tpm_runtime::harmonics::{Hold, Spectra};
use tpm_runtime::procedure::Campaign;
use tpm_runtime::simulate::simulate;
use tpm_symbolic::prepare::prepare;

const MODEL: &str = include_str!("../../models/mass_spring_drag.tpm");
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
    let run = Run { trial: &trial, spectra: &spectra, rates: None, hold: Hold::Zoh };
    let mut group = criterion.benchmark_group("one update from harmonics to parameters");
    for method in [Method::Error, Method::Effort, Method::Hill] {
        // Run after run of one stage is pooled, as in a campaign.
        let mut estimator = method.estimator(&settings);
        group.bench_function(method.name(), |b| {
            b.iter(|| estimator.take(plant, black_box(&run)).expect("an update"));
        });
    }
    // All records are weighed anew with every new one: the first run.
    group.bench_function(Method::MeasuredMotion.name(), |b| {
        b.iter_batched(
            || Method::MeasuredMotion.estimator(&settings),
            |mut estimator| estimator.take(plant, black_box(&run)).expect("an update"),
            BatchSize::SmallInput,
        );
    });
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

criterion_group!(benches, campaign, update);
criterion_main!(benches);
