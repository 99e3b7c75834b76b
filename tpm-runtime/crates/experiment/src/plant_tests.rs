//! Tests of simulated machines that play the runs of an experiment.

use crate::Experiment;
use tpm_campaign::Campaign;
use tpm_controller::harmonics::Hold;
use tpm_motion::Ending;
use tpm_plant::simulated::{SimulatedRun, simulate_continuous};
use tpm_test_support::models::MassSpringDrag;
use tpm_test_support::rest_to_rest_3;

#[test]
fn the_control_loop_allocates_nothing() {
    let file = include_str!("../../../../models/mass_spring_drag.toml");
    let experiment = Experiment::parse(file).expect("the shipped file is right");
    let rig = experiment.bench(&MassSpringDrag).expect("fits");
    let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh).expect("fits");
    let campaign = Campaign::new(&MassSpringDrag, setup).expect("playable");
    let trial = campaign.next().expect("first");
    let mut run = SimulatedRun::new(&MassSpringDrag, &rig, trial).expect("fits");
    let mut ending = Ok(Ending::Diverged { sample: 0 });
    let counted = allocation_counter::measure(|| ending = run.play());
    assert_eq!(ending, Ok(Ending::Complete));
    assert_eq!(counted.count_total, 0);
    let record = run.record(Ending::Complete);
    assert_eq!(record.len(), trial.samples());
}

#[test]
fn with_the_right_parameters_the_error_is_that_of_the_integration() {
    let file = include_str!("../../../../models/mass_spring_drag.toml");
    let error = |steps: f64| {
        let mut experiment = Experiment::parse(file).expect("the shipped file is right");
        experiment.prior = experiment.plant.parameters.clone();
        let stage = &experiment.schedule.stages[0].values;
        experiment.control.sample_time = 2.0 * std::f64::consts::PI / stage["w"] / steps;
        experiment.control.derivative_filter = None;
        let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::None).expect("fits");
        let campaign = Campaign::new(&MassSpringDrag, setup).expect("playable");
        let trial = campaign.next().expect("first");
        let record = simulate_continuous(&MassSpringDrag, &trial.parameters, trial).expect("regular");
        assert_eq!((record.ending, record.len()), (Ending::Complete, trial.samples()));
        let period = trial.samples_per_period;
        let off = |n: usize| (record.coordinates[0][n] - trial.reference[n % period * 3]).abs();
        (0..record.len()).map(off).fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(256.0), error(512.0));
    assert!(coarse > 10.0 * fine && coarse < 40.0 * fine && fine < 1e-6, "{coarse:e} {fine:e}");
}
