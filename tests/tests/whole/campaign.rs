//! From a model file and its experiment to parameters: parser, interpreter, simulated machine, campaign.

use crate::support::{model as shipped, table_of};
use tpm_runtime::estimate::Along;
use tpm_runtime::experiment::{Experiment, identify_simulated};
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::trajectory::Pattern;
use tpm_symbolic::fourier::Trig;
use tpm_symbolic::regressor::regressor_form;

const EXPERIMENT: &str = include_str!("../../../models/mass_spring_drag.toml");

fn loaded(name: &str) -> (Interpreted, Pattern) {
    let model = shipped(name);
    let form = regressor_form(&model).expect("linear in its parameters");
    let pattern = model.pattern(None).expect("has a pattern");
    let pattern = Pattern::of_symbolic(pattern, &model, |_| None).expect("no open constants");
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
