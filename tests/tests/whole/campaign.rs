//! From a model file and its experiment to parameters: parser, interpreter, simulated machine, campaign.

use crate::support::{model as shipped, parse, table_of};
use std::collections::BTreeMap;
use tpm_runtime::campaign::{Manifest, Store};
use tpm_runtime::estimate::Along;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::interpret::{Interpreted, pattern};
use tpm_runtime::motion::trajectory::ReferencePattern;
use tpm_runtime::session::{Identification, Machine, identify_simulated};
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::regressor::form::regressor_form;
use tpm_symbolic::regressor::prepare::prepare;

const EXPERIMENT: &str = include_str!("../../../models/mass_spring_drag.toml");

fn loaded(name: &str) -> (Interpreted, ReferencePattern) {
    let model = shipped(name);
    let form = regressor_form(&model).expect("linear in its parameters");
    let pattern = model.pattern(None).expect("has a pattern");
    let pattern = pattern::of_model(pattern, &model, |_| None).expect("no open constants");
    (Interpreted::new(&model, &form), pattern)
}

#[test]
fn a_model_file_and_its_experiment_give_the_parameters() {
    let (model, pattern) = loaded("mass_spring_drag");
    let experiment = Experiment::parse(EXPERIMENT).expect("the shipped file is right");
    let result = identify_simulated(&model, &pattern, &experiment, &mut |_| true).expect("runs");
    assert!(result.is_complete(), "{:?} {:?}", result.outcome, result.warnings);
    for (parameter, (name, truth)) in result.parameters.iter().zip([("m", 2.0), ("k1", 40.0), ("k2", 1.5)]) {
        let value = parameter.value.expect("identified");
        assert_eq!(parameter.name, name);
        assert!((value / truth - 1.0).abs() < 5e-3, "{parameter:?}");
    }
}

/// In this campaign one line of the feedback's own noise, at harmonic 244, stands out of its neighbours by chance.
#[test]
fn a_line_of_noise_is_not_taken_for_excitation() {
    let (model, pattern) = loaded("mass_spring_drag");
    let mut experiment = Experiment::parse(EXPERIMENT).expect("the shipped file is right");
    experiment.seed = 97;
    let result = identify_simulated(&model, &pattern, &experiment, &mut |_| true).expect("runs");
    assert!(result.is_complete() && result.runs.iter().all(|run| run.harmonics < Some(10)), "{:?}", result.runs);
}

#[test]
fn harmonics_along_the_reference_are_those_of_the_exact_table() {
    let (model, pattern) = loaded("mass_spring_drag");
    let table = table_of("mass_spring_drag");
    let (lambda, w) = (0.3, 3.7);
    let along = Along::new(&model, &[], &pattern.trajectory(&[lambda], w), 12).expect("finite");
    let symbols: Vec<f64> = table
        .symbols
        .iter()
        .map(|name| match name.as_str() {
            "lambda" => lambda,
            "w" => w,
            _ => f64::NAN,
        })
        .collect();
    for column in 0..table.parameters.len() {
        for harmonic in 0..=12 {
            let part = |function| -> f64 {
                table.at(0, harmonic, function, Some(column)).map(|entry| table.evaluate(&entry, &symbols)).sum()
            };
            let line = along.regressor(0, column)[harmonic];
            let scale = lambda * w * w;
            let difference = (line.re - part(Trig::Cos)).hypot(line.im + part(Trig::Sin));
            assert!(difference < 1e-14 * scale, "column {column}, harmonic {harmonic}: {difference:e}");
        }
    }
}

/// The same machine with two patterns.
const TWO_PATTERNS: &str = "
    model MassSpringDrag {
        coordinate x [m];
        input u [N];
        parameter m [kg], k1 [N/m], k2 [N*s^2/m^2];
        m*ddot(x) + k1*x + k2*dot(x)^2 = u;
        pattern near { amplitude lambda [m]; frequency w [rad/s]; x = rest_to_rest(lambda, w, 3); }
        pattern far { amplitude mu [m]; frequency v [rad/s]; x = rest_to_rest(mu, v, 5); }
    }";

fn two_patterns(stages: &str) -> (Machine, Experiment) {
    let prepared = prepare(parse("two_patterns", TWO_PATTERNS)).expect("linear");
    let mut experiment = Experiment::parse(EXPERIMENT).expect("the shipped file is right");
    experiment.apply_override("schedule.stages", stages).expect("stages");
    experiment.schedule.measure_time = 6.0;
    experiment.schedule.updates_per_stage = 1;
    let near = prepared.model.pattern(Some("near")).expect("declared");
    let machine = Machine::new(&prepared, near, &experiment, &BTreeMap::new()).expect("a machine");
    (machine, experiment)
}

const STAGES: &str = "[
    { lambda = 0.2, w = 3.2 },
    { pattern = 'far', mu = 0.3, v = 2.5, multiples = { x = 2 } },
    { pattern = 'near', lambda = 0.3, w = 4.0 },
]";

#[test]
fn stages_play_patterns_and_multiples_of_their_own_and_a_stopped_campaign_goes_on() {
    let (machine, experiment) = two_patterns(&STAGES.replace('\n', " "));
    let whole = machine.identify(&experiment, &mut |_| true).expect("runs");
    let patterns: Vec<Option<&str>> = whole.runs.iter().map(|run| run.pattern.as_deref()).collect();
    assert_eq!(patterns[..2], [None, Some("far")], "{:?}", whole.warnings);
    assert_eq!(patterns.last(), Some(&Some("near")));
    assert_eq!(whole.runs[1].amplitudes, [("mu".to_owned(), 0.3)]);
    for (parameter, truth) in whole.parameters.iter().zip([2.0, 40.0, 1.5]) {
        assert!((parameter.value.expect("identified") / truth - 1.0).abs() < 1e-2, "{parameter:?}");
    }
    // Stopped after the run with the other pattern, the campaign goes on from its folder to the same result.
    let folder = tempfile::tempdir().expect("a folder");
    let manifest = Manifest::new("MassSpringDrag", TWO_PATTERNS.as_bytes(), b"two patterns");
    let play = |most: usize| -> Identification {
        let store = Store::open(folder.path(), &manifest).expect("a folder");
        let result = machine.identify_watched(&experiment, Some(&store), &mut |_, _, run| run.run < most);
        result.expect("runs")
    };
    assert_eq!(play(2).runs.len(), 2);
    let kept = std::fs::read_to_string(folder.path().join("run-002.json")).expect("a manifest");
    assert!(kept.contains("\"pattern\": \"far\""), "{kept}");
    assert_eq!(play(usize::MAX), whole);
}

#[test]
fn a_pattern_that_the_model_does_not_have_is_named() {
    let (machine, experiment) = two_patterns("[{ pattern = 'fra', mu = 0.3, v = 2.5 }]");
    let error = machine.identify(&experiment, &mut |_| true).expect_err("no such pattern").to_string();
    assert!(error.contains("`fra`") && error.contains("near, far") && error.contains("schedule.stages.0"), "{error}");
    let (machine, experiment) = two_patterns("[{ pattern = 'far', lambda = 0.3, v = 2.5 }]");
    let error = machine.identify(&experiment, &mut |_| true).expect_err("the other one's amplitude").to_string();
    assert!(error.contains("`lambda`") && error.contains("mu, v"), "{error}");
}
