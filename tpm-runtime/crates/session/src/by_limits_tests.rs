//! Campaigns that choose their motions within limits, on simulated machines that begin with no value of any parameter.

use crate::{DeclaredModel, Identification, Session, SessionError};
use tpm_campaign::{Outcome, Store};
use tpm_experiment::{ByLimits, Experiment, ExperimentError, SensorSection};

const CART: &str = "model Cart { coordinate x [m]; input u [N]; parameter m [kg], d [N*s/m], fc [N];
    m*ddot(x) + d*dot(x) + fc*sign(dot(x)) = u;
    pattern { amplitude lambda [m]; frequency w [rad/s]; x = rest_to_rest(lambda, w, 3); } }";
/// The input stands on the left, so that it moves the cart the other way.
const BACKWARDS: &str = "model Cart { coordinate x [m]; input u [N]; parameter m [kg], k [N/m];
    u + m*ddot(x) + k*x = 0;
    pattern { amplitude lambda [m]; frequency w [rad/s]; x = rest_to_rest(lambda, w, 3); } }";

const ROOM: f64 = 0.3;
const SPEED: f64 = 1.2;
const FORCE: f64 = 60.0;

fn limits(time: f64) -> ByLimits {
    let all = [("x", ROOM), ("dx", SPEED), ("u", FORCE)];
    let limits = all.map(|(name, size)| (name.to_string(), (-size, size))).into();
    ByLimits { limits, time, ..ByLimits::default() }
}

fn machine(truths: &[(&str, f64)]) -> Experiment {
    let mut experiment = Experiment::bare(1e-3);
    experiment.plant.parameters = truths.iter().map(|(name, value)| (name.to_string(), *value)).collect();
    experiment.plant.sensors.insert("x".into(), SensorSection { noise: 1e-5, ..SensorSection::default() });
    experiment
}

fn session(text: &str, experiment: Experiment, limits: &ByLimits) -> Result<Session, SessionError> {
    Session::by_limits(DeclaredModel::parse("cart.tpm", text).expect("a model"), experiment, limits)
}

/// Plays a campaign, and sees to it that the machine keeps all limits: of its position, its speed and its drive.
fn played(session: &Session) -> Identification {
    let watch = &mut |_: &_, record: &tpm_motion::Record, _: &_| {
        let x = &record.coordinates[0];
        let farthest = x.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        // Over ten samples, so that the noise of the sensor is no speed.
        let fastest = x.windows(11).map(|w| (w[10] - w[0]).abs() / 1e-2).fold(0.0, f64::max);
        assert!(farthest < ROOM && fastest < SPEED, "{farthest} {fastest}");
        assert!(record.inputs[0].iter().all(|u| u.abs() <= FORCE));
        true
    };
    session.identify(None, watch).expect("plays")
}

fn within(result: &Identification, truths: &[f64], deviations: f64, share: f64) {
    for (parameter, truth) in result.parameters.iter().zip(truths) {
        let (value, std) = (parameter.value.expect("shown"), parameter.std.expect("shown"));
        assert!((value - truth).abs() < deviations * std, "{parameter:?}");
        assert!(std < share * truth.abs(), "{parameter:?}");
    }
}

#[test]
fn limits_alone_identify_a_machine_with_friction() {
    let experiment = machine(&[("m", 4.0), ("d", 6.0), ("fc", 5.0)]);
    let session = session(CART, experiment, &limits(90.0)).expect("a campaign");
    let result = played(&session);
    assert_eq!(result.outcome, Some(Outcome::TimeUsed));
    within(&result, &[4.0, 6.0, 5.0], 4.0, 1e-3);
    let sizes: Vec<f64> = result.runs.iter().map(|run| run.amplitudes[0].1).collect();
    let most = sizes.iter().copied().fold(0.0, f64::max);
    assert!(sizes[0] < 0.2 * most, "the first run is small: {sizes:?}");
    let advice = result.advice.expect("something is known least");
    assert!(advice.wanted.is_none() && advice.deviation.is_some());
}

#[test]
fn a_campaign_ends_when_it_knows_enough_or_says_what_is_missing() {
    let experiment = machine(&[("m", 4.0), ("d", 6.0), ("fc", 5.0)]);
    let enough = ByLimits { every: Some(0.01), ..limits(600.0) };
    let result = played(&session(CART, experiment.clone(), &enough).expect("a campaign"));
    assert_eq!(result.outcome, Some(Outcome::GoalReached));
    assert!(result.is_complete() && result.advice.is_none() && result.runs.len() < 10, "{}", result.runs.len());
    within(&result, &[4.0, 6.0, 5.0], 4.0, 0.01);
    let too_much = ByLimits { until: [("d".to_string(), 1e-7)].into(), ..limits(40.0) };
    let result = played(&session(CART, experiment, &too_much).expect("a campaign"));
    assert_eq!(result.outcome, Some(Outcome::TimeShort));
    assert!(!result.is_complete());
    assert_eq!(result.advice.expect("d is not known so well").parameter, "d");
}

#[test]
fn the_direction_of_an_input_is_that_of_its_row() {
    let session = session(BACKWARDS, machine(&[("m", 2.0), ("k", 10.0)]), &limits(60.0)).expect("a campaign");
    assert!(session.experiment().control.feedback[0].kp < 0.0);
    within(&played(&session), &[2.0, 10.0], 4.0, 1e-3);
}

#[test]
fn a_model_without_a_pattern_is_moved_from_rest_to_rest_about_the_middle_of_its_room() {
    let text = "model Cart { coordinate x [m]; input u [N]; parameter m [kg], d [N*s/m];
        m*ddot(x) + d*dot(x) = u; }
        // {a remark behind the model}";
    let mut aside = limits(60.0);
    aside.limits.insert("x".into(), (0.1, 0.5));
    let session = session(text, machine(&[("m", 4.0), ("d", 6.0)]), &aside).expect("a campaign");
    let (campaign, _) = session.campaign().expect("begins");
    assert!((campaign.next().expect("a run").trajectory.coordinates[0].mean - 0.3).abs() < 1e-12);
    let mut farthest = (f64::INFINITY, f64::NEG_INFINITY);
    let watch = &mut |_: &_, record: &tpm_motion::Record, _: &_| {
        farthest = record.coordinates[0].iter().fold(farthest, |(low, high), x| (low.min(*x), high.max(*x)));
        true
    };
    within(&session.identify(None, watch).expect("plays"), &[4.0, 6.0], 4.0, 1e-3);
    assert!(farthest.0 > 0.1 && farthest.1 < 0.5 && farthest.1 - farthest.0 > 0.2, "{farthest:?}");
}

#[test]
fn kept_runs_give_the_campaign_that_was_played() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = session(CART, machine(&[("m", 4.0), ("d", 6.0), ("fc", 5.0)]), &limits(40.0)).expect("a campaign");
    let text = session.written().text().expect("text");
    let read = Experiment::parse(&text).expect("what is written is read");
    assert_eq!(&read, session.written());
    let manifest = tpm_campaign::Manifest::new("Cart", CART.as_bytes(), text.as_bytes());
    let store = Store::open(folder.path(), &manifest).expect("a store");
    // Two runs, and then the rest.
    let mut runs = 0;
    let begun = session.identify(Some(&store), &mut |_, _, _| {
        runs += 1;
        runs < 2
    });
    assert!(begun.is_ok() && runs == 2, "{runs}");
    let whole = session.identify(Some(&store), &mut |_, _, _| true).expect("goes on");
    let unbroken = session.identify(None, &mut |_, _, _| true).expect("plays");
    assert_eq!((whole.runs, whole.parameters), (unbroken.runs, unbroken.parameters));
}

#[test]
fn what_is_missing_of_the_limits_is_named() {
    let refused = |limits: ByLimits| match session(CART, machine(&[]), &limits) {
        Err(SessionError::Experiment(fault)) => fault,
        other => panic!("{other:?}"),
    };
    let mut missing = limits(60.0);
    missing.limits.remove("dx");
    let fault = refused(missing);
    assert!(matches!(&fault, ExperimentError::NeedsLimit { name, limit: "velocities" } if name == "x"), "{fault}");
    assert!(fault.to_string().contains("dot(x)"), "{fault}");
    let mut unknown = limits(60.0);
    unknown.limits.insert("y".into(), (-1.0, 1.0));
    assert!(matches!(refused(unknown), ExperimentError::UnknownName { .. }));
    let mut outside = limits(60.0);
    outside.limits.insert("x".into(), (0.1, 0.3));
    assert!(matches!(refused_later(outside), SessionError::Experiment(ExperimentError::NoRoom)));
    let mut lopsided = limits(60.0);
    lopsided.limits.insert("u".into(), (-1.0, 60.0));
    assert!(matches!(refused(lopsided), ExperimentError::Invalid { .. }));
    let mut other = machine(&[("m", 4.0), ("d", 6.0), ("fc", 5.0)]);
    other.estimator = tpm_estimate::Method::Error;
    let fault = session(CART, other, &limits(60.0)).and_then(|session| session.campaign().map(|_| ()));
    assert!(matches!(fault, Err(SessionError::Experiment(ExperimentError::PlanMethod))), "{fault:?}");
}

fn refused_later(limits: ByLimits) -> SessionError {
    let session = session(CART, machine(&[("m", 4.0), ("d", 6.0), ("fc", 5.0)]), &limits).expect("reads");
    let refused = session.campaign().map(|_| ());
    refused.expect_err("the pattern rests outside")
}
