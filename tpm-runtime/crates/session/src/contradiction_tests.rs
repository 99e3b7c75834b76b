//! Runs in which a simulated machine is another one than in the rest of its campaign.

use crate::campaign::Session;
use crate::identification::Identification;
use crate::model::DeclaredModel;
use crate::warning::Warning;
use rayon::prelude::*;
use std::collections::BTreeMap;
use tpm_campaign::Outcome;
use tpm_experiment::Experiment;
use tpm_motion::{Bench, BenchError, Record, Trial};

const MASS_SPRING_DRAG: [&str; 2] =
    [include_str!("../../../../models/mass_spring_drag.tpm"), include_str!("../../../../models/mass_spring_drag.toml")];
const TWO_CARTS: [&str; 2] =
    [include_str!("../../../../models/two_carts.tpm"), include_str!("../../../../models/two_carts.toml")];

/// A machine that carries a load in some of its runs, which are counted from 1.
struct Loaded<'a> {
    bare: &'a Session,
    loaded: &'a Session,
    carries: &'a dyn Fn(usize) -> bool,
}

impl Bench for Loaded<'_> {
    fn play(&mut self, trial: &Trial) -> Result<Record, BenchError> {
        let machine = if (self.carries)(trial.run + 1) { self.loaded } else { self.bare };
        machine.simulate(trial).map_err(|error| Box::new(error) as BenchError)
    }
}

/// Identifies a shipped model, whose machine has a mass that is larger by a tenth in some runs.
fn identified(
    [model, experiment]: [&str; 2],
    mass: &str,
    seed: u64,
    sets: &[(&str, &str)],
    carries: &dyn Fn(usize) -> bool,
) -> Identification {
    let model = DeclaredModel::parse("model", model).expect("the shipped model is right");
    let mut experiment = Experiment::parse(experiment).expect("the shipped file is right");
    experiment.seed = seed;
    for (key, value) in sets {
        experiment.apply_override(key, value).expect("a key of the file");
    }
    let mut heavy = experiment.clone();
    heavy.plant.parameters.entry(mass.into()).and_modify(|mass| *mass *= 1.1);
    let session =
        |experiment: Experiment| Session::new(model.clone(), experiment, None, BTreeMap::new()).expect("a session");
    let (bare, loaded) = (session(experiment), session(heavy));
    let mut bench = Loaded { bare: &bare, loaded: &loaded, carries };
    bare.identify_on(&mut bench, None, &mut |_, _, _| true).expect("runs")
}

/// A mass with spring and drag that carries a load in some runs.
fn slider(sets: &[(&str, &str)], carries: &dyn Fn(usize) -> bool) -> Identification {
    let sets = [&[("schedule.measure_time", "6")], sets].concat();
    identified(MASS_SPRING_DRAG, "m", 1, &sets, carries)
}

/// Numbers of the runs that are left out, each with the parameter that differs most.
fn left_out(result: &Identification) -> Vec<(usize, String)> {
    let said = result.runs.iter().filter_map(|run| Some((run.run, run.contradicts.clone()?.parameter)));
    let said: Vec<(usize, String)> = said.collect();
    let warned = result.warnings.iter().filter_map(|warning| match warning {
        Warning::Contradicts { run, parameter, .. } => Some((*run, parameter.clone())),
        _ => None,
    });
    assert_eq!(warned.collect::<Vec<_>>(), said);
    said
}

/// The mass and its standard deviation.
fn mass(result: &Identification) -> (f64, f64) {
    let mass = result.parameters.iter().find(|parameter| parameter.name == "m").expect("a mass");
    (mass.value.expect("identified"), mass.std.expect("identified"))
}

#[test]
fn a_run_that_contradicts_the_pool_is_named_and_played_again() {
    let result = slider(&[], &|run| run == 3);
    assert_eq!(left_out(&result), [(3, "m".to_string())]);
    let (value, std) = mass(&result);
    assert!((value - 2.0).abs() < 4.0 * std && std < 0.01, "{value} {std}");
    // The stage of the run is played again, and the campaign ends as it would have.
    assert_eq!(result.runs[2].stage, result.runs[3].stage);
    assert!(!result.runs[2].updated && result.runs[3].updated, "{:?}", result.runs);
    assert!(result.is_complete(), "{:?}", result.shortfall());
    let text = result.to_string();
    assert!(
        text.contains("complete, not pooled") && text.contains("warning: run 3 contradicts runs 1, 2, 4"),
        "{text}"
    );
    let json = serde_json::to_value(&result).expect("JSON");
    assert_eq!(json["runs"][2]["contradicts"]["parameter"], "m");
    let finding = json["findings"].as_array().and_then(|list| list.iter().find(|one| one["kind"] == "contradicts"));
    let finding = finding.expect("a finding");
    assert_eq!((&finding["run"], &finding["majority"]), (&3.into(), &true.into()));
    assert!(finding["deviations"].as_f64().is_some_and(|deviations| deviations > 10.0), "{finding}");
}

#[test]
fn a_first_run_that_was_wrong_gives_way_to_those_that_agree() {
    let result = slider(&[], &|run| run == 1);
    assert_eq!(left_out(&result).len(), 1);
    assert_eq!(left_out(&result)[0].0, 1);
    let (value, std) = mass(&result);
    assert!((value - 2.0).abs() < 4.0 * std, "{value} {std}");
    // A load that stays is what the machine has become.
    let result = slider(&[], &|run| run > 2);
    assert_eq!(left_out(&result).iter().map(|(run, _)| *run).collect::<Vec<_>>(), [1, 2]);
    let (value, std) = mass(&result);
    assert!((value - 2.2).abs() < 4.0 * std, "{value} {std}");
}

#[test]
fn two_runs_that_contradict_each_other_are_no_result() {
    let result = slider(&[("schedule.max_runs", "2")], &|run| run == 2);
    assert_eq!((left_out(&result), result.outcome), (vec![(2, "m".to_string())], Some(Outcome::RunsUsed)));
    let why = result.shortfall().expect("no result");
    assert!(why.starts_with("run 2 contradicts run 1: m differs most") && why.contains("play the run again"), "{why}");
}

#[test]
fn parameters_that_drift_are_followed_and_first_order_estimates_not_judged() {
    for set in [("schedule.forgetting", "0.5"), ("estimator", "error")] {
        let result = slider(&[set, ("schedule.max_runs", "4")], &|run| run == 3);
        assert_eq!(left_out(&result), [], "{set:?}");
    }
}

/// Rates over many campaigns; minutes. Measured on mass_spring_drag: 0 of 1023 right runs left out in 200 campaigns, and the third run
/// of 200 of 200 campaigns where it carries the load. `cargo test -p tpm-runtime --all-features -- --ignored --nocapture rates_of_contradictions`
#[test]
#[ignore = "minutes: measures rates over 400 campaigns of each of two models"]
fn rates_of_contradictions() {
    // Runs of the eliminated form are not judged: one run alone does not show its parameters.
    let own = [("equations", "own")];
    let cases: [(_, _, _, &[(&str, &str)]); 2] =
        [("mass_spring_drag", MASS_SPRING_DRAG, "m", &[]), ("two_carts", TWO_CARTS, "m2", &own)];
    for (name, model, mass, sets) in cases {
        let campaigns = 200;
        let of = |carries: &(dyn Fn(usize) -> bool + Sync)| -> Vec<Identification> {
            (1..=campaigns).into_par_iter().map(|seed| identified(model, mass, seed, sets, carries)).collect()
        };
        let right = of(&|_| false);
        let runs: usize = right.iter().map(|result| result.runs.len()).sum();
        let alarms: Vec<String> = right
            .iter()
            .enumerate()
            .flat_map(|(at, result)| left_out(result).into_iter().map(move |found| format!("{}: {found:?}", at + 1)))
            .collect();
        println!("{name}: {} of {runs} right runs left out: {alarms:?}", alarms.len());
        assert!(alarms.len() as f64 <= 3e-3 * runs as f64, "{alarms:?}");
        let loaded = of(&|run| run == 3);
        let found = loaded.iter().filter(|result| left_out(result).iter().any(|(run, _)| *run == 3)).count();
        let named = loaded.iter().filter(|result| left_out(result) == [(3, mass.to_string())]).count();
        println!("{name}: the third run of {found} of {campaigns} campaigns is left out, {named} by the mass alone");
        assert!(found as f64 >= 0.95 * campaigns as f64);
    }
}
