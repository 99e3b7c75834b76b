//! Machines that obey another model than the one that is identified, and logs of coordinates that a model eliminates.

use crate::campaign::Session;
use crate::error::SessionError;
use crate::identification::Identification;
use crate::model::DeclaredModel;
use crate::warning::Warning;
use crate::{LogRequest, from_log};
use std::collections::BTreeMap;
use tpm_controller::harmonics::Hold;
use tpm_experiment::{Experiment, PlantModelSection};
use tpm_log::Samples;

const MODEL: &str = include_str!("../../../../models/mass_spring_drag.tpm");
const EXPERIMENT: &str = include_str!("../../../../models/mass_spring_drag.toml");
const TWO_CARTS: [&str; 2] =
    [include_str!("../../../../models/two_carts.tpm"), include_str!("../../../../models/two_carts.toml")];
/// A spring that hardens, and a constant force that only this model has.
const RICHER: &str = "model Richer {
    coordinate x [m];
    input u [N];
    parameter k3 [N/m^3], m [kg], k1 [N/m], k2 [N*s^2/m^2];
    constant load [N];
    m*ddot(x) + k1*x + k2*dot(x)^2 + k3*x^3 + load = u;
}";

fn declared(text: &str) -> DeclaredModel {
    DeclaredModel::parse("model", text).expect("a model")
}

/// The shipped experiment on the richer machine.
fn on(text: &str, hardening: f64) -> Experiment {
    let mut experiment = Experiment::parse(EXPERIMENT).expect("the shipped file is right");
    experiment.plant.model = Some(PlantModelSection::Text { text: text.into() });
    experiment.plant.parameters.insert("k3".into(), hardening);
    experiment.plant.constants.insert("load".into(), 0.0);
    experiment
}

fn session(experiment: Experiment) -> Result<Session, SessionError> {
    Session::new(declared(MODEL), experiment, None, BTreeMap::new())
}

fn identified(experiment: Experiment) -> Identification {
    session(experiment).expect("a session").identify(None, &mut |_, _, _| true).expect("runs")
}

fn values(result: &Identification) -> Vec<f64> {
    result.parameters.iter().map(|parameter| parameter.value.unwrap_or(f64::NAN)).collect()
}

#[test]
fn a_machine_of_another_model_is_the_same_machine_where_its_equations_are() {
    let own = identified(Experiment::parse(EXPERIMENT).expect("the shipped file is right"));
    let other = identified(on(RICHER, 0.0));
    for (own, other) in values(&own).iter().zip(values(&other)) {
        assert!((own / other - 1.0).abs() < 1e-9, "{own} {other}");
    }
}

#[test]
fn what_a_simple_model_leaves_out_of_a_richer_machine_is_not_trusted() {
    let plain = identified(on(RICHER, 0.0));
    assert!(plain.shortfall.is_none(), "{:?}", plain.shortfall);
    let mut hardened = on(RICHER, 30.0);
    let found = identified(hardened.clone());
    assert!(found.shortfall.is_some(), "{found:?}");
    // The text travels with the experiment, so that a written one is whole.
    let written = hardened.text().expect("written");
    let read = Experiment::parse(&written).expect("read");
    assert_eq!(values(&identified(read)), values(&found));
    // A constant of the machine acts.
    hardened.plant.constants.insert("load".into(), 20.0);
    assert_ne!(values(&identified(hardened)), values(&found));
}

#[test]
fn a_machine_that_does_not_fit_says_what_does_not() {
    let refused = |experiment: Experiment| match session(experiment) {
        Ok(session) => session.identify(None, &mut |_, _, _| true).expect_err("refused").to_string(),
        Err(fault) => fault.to_string(),
    };
    let other = refused(on(&RICHER.replace("(x)", "(y)").replace("x [m]", "y [m]").replace("*x", "*y"), 0.0));
    assert!(other.contains("Richer has coordinates y") && other.contains("coordinates x"), "{other}");
    let mut unread = on(RICHER, 0.0);
    unread.plant.model = Some(PlantModelSection::File("richer.tpm".into()));
    assert!(refused(unread).contains("the file richer.tpm was not read"));
    let mut unknown = on(RICHER, 0.0);
    unknown.plant.parameters.insert("k4".into(), 1.0);
    assert!(refused(unknown).contains("no parameter `k4`"));
    let mut missing = on(RICHER, 0.0);
    missing.plant.constants.clear();
    assert!(refused(missing).contains("load"));
    assert!(refused(on("model Richer {", 0.0)).contains("plant.model"));
    let mut own = Experiment::parse(EXPERIMENT).expect("the shipped file is right");
    own.plant.constants.insert("load".into(), 1.0);
    assert!(refused(own).contains("plant.constants"));
}

#[test]
fn a_log_of_an_eliminated_coordinate_is_used() {
    let mut experiment = Experiment::parse(TWO_CARTS[1]).expect("the shipped file is right");
    experiment.prior = experiment.plant.parameters.clone();
    let carts = Session::new(declared(TWO_CARTS[0]), experiment, None, BTreeMap::new()).expect("a session");
    let (campaign, _) = carts.campaign().expect("begins");
    let trial = campaign.next().expect("a first run").clone();
    let record = carts.simulate(&trial).expect("played");
    let time: Vec<f64> = (0..record.len()).map(|n| n as f64 * record.sample_time).collect();
    let columns = |names: &[&str]| {
        let signals = [("x1", &record.coordinates[0]), ("x2", &record.coordinates[1]), ("F", &record.inputs[0])];
        let mut columns: Vec<(String, Vec<f64>)> = vec![("t".into(), time.clone())];
        columns.extend(
            signals
                .iter()
                .filter(|(name, _)| names.contains(name))
                .map(|(name, values)| (name.to_string(), values.to_vec())),
        );
        LogRequest::of_samples("carts", Samples::new(columns)).hold(Hold::Zoh)
    };
    let own =
        declared(&TWO_CARTS[0].lines().filter(|line| !line.contains("eliminate ")).collect::<Vec<_>>().join("\n"));
    let eliminated = declared(TWO_CARTS[0]);
    let all = from_log(&eliminated, columns(&["x1", "x2", "F"])).expect("identified");
    let wanted = from_log(&own, columns(&["x1", "x2", "F"])).expect("identified");
    assert_eq!(values(&all), values(&wanted));
    let said = |result: &Identification| {
        result
            .warnings
            .iter()
            .any(|warning| matches!(warning, Warning::AllCoordinates { coordinates } if coordinates == &["x1"]))
    };
    assert!(said(&all) && !said(&wanted));
    // Without the column the form after the elimination is identified, as before.
    let far = from_log(&eliminated, columns(&["x2", "F"])).expect("identified");
    assert!(!said(&far) && far.parameters[0].name.starts_with('c'), "{far:?}");
}
