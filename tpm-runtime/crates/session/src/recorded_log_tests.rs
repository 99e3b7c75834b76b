//! Logs that are simulated between their stamps: states that nobody measured, also where stamps are uneven or fields blank.

use crate::model::Identifiable as _;
use crate::{
    DeclaredModel, Identification, LogRequest, RecordedReport, Warning, Way, from_log, from_logs, inspect_for, validate,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use tpm_controller::harmonics::Hold;
use tpm_log::{InMemory, Samples};
use tpm_motion::Plant;

/// Two masses of which only the one with the motor is measured.
const TWO_MASSES: &str = "model TwoMasses {
    coordinate x1 [m];
    unmeasured x2 [m];
    input u [N];
    parameter m1 [kg], m2 [kg], d1 [N*s/m], d2 [N*s/m], k [N/m], c [N*s/m];
    m1*ddot(x1) + d1*dot(x1) + k*(x1 - x2) + c*(dot(x1) - dot(x2)) = u;
    m2*ddot(x2) + d2*dot(x2) + k*(x2 - x1) + c*(dot(x2) - dot(x1)) = 0;
}";

/// A pendulum with a propeller whose thrust lags.
const PROPELLER: &str = "model Propeller {
    coordinate phi [rad];
    unmeasured thrust [N];
    input u [N];
    parameter J [kg*m^2], d [N*m*s/rad], l [m], tau [s];
    constant mgl = 0.6 [N*m];
    J*ddot(phi) + d*dot(phi) + mgl*sin(phi) - l*thrust = 0;
    tau*dot(thrust) + thrust = u;
}";

/// Two tanks one above the other, of which the level of the lower one is measured, in units of a decimetre.
const TANKS: &str = "model Tanks {
    coordinate h2 [1];
    unmeasured h1 [1];
    input u [1/s];
    parameter a1 [1/s], a2 [1/s];
    dot(h1) + a1*sqrt(h1) = u;
    dot(h2) - a1*sqrt(h1) + a2*sqrt(h2) = 0;
}";

/// Readings of a machine with known parameters: stamps, what is applied from each of them on, and the motion at each.
struct Run {
    time: Vec<f64>,
    input: Vec<f64>,
    motion: Vec<Vec<f64>>,
}

/// Simulates a model from a motion under an input that is held between stamps.
fn run(model: &DeclaredModel, truth: &[f64], first: &[f64], time: Vec<f64>, input: impl Fn(f64) -> f64) -> Run {
    let rows = crate::model::Identifiable::evaluated(model);
    let mut plant = Plant::new(rows, truth, &[]).expect("fits");
    plant.reset(first).expect("fits");
    let inputs = rows.dims().inputs;
    let applied: Vec<f64> = time.iter().map(|t| input(*t)).collect();
    let mut motion = Vec::new();
    for (k, t) in time.iter().enumerate() {
        plant.observe(&vec![applied[k]; inputs]).expect("the rows determine it");
        motion.push(plant.motion().to_vec());
        if let Some(next) = time.get(k + 1) {
            plant.advance(&vec![applied[k]; inputs], next - t, 40).expect("stays within bounds");
        }
    }
    Run { time, input: applied, motion }
}

impl Run {
    /// A log of some columns of the motion, with noise.
    fn log(&self, columns: &[(&str, usize, f64)], input: Option<&str>, seed: u64) -> LogRequest {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut all = vec![("t_s".to_owned(), self.time.clone())];
        for &(name, at, noise) in columns {
            let reading = |motion: &Vec<f64>| motion[at] + noise * random.sample::<f64, _>(StandardNormal);
            all.push((name.to_owned(), self.motion.iter().map(reading).collect()));
        }
        all.extend(input.map(|name| (name.to_owned(), self.input.clone())));
        LogRequest::of_samples("log", Samples::new(all)).hold(Hold::Zoh)
    }
}

fn even(samples: usize, step: f64) -> Vec<f64> {
    (0..samples).map(|k| k as f64 * step).collect()
}

/// A command that jumps at times of its own.
fn steps(t: f64) -> f64 {
    let at = (t / 0.37).floor();
    (at * 1.7).sin() + 0.5 * (at * 0.61).cos()
}

/// Errors of all parameters in their deviations.
fn errors(result: &Identification, truth: &[f64]) -> Vec<f64> {
    let of = |(own, truth): (&tpm_estimate::ParameterReport, &f64)| {
        (own.value.expect("identified") - truth) / own.std.expect("identified")
    };
    result.parameters.iter().zip(truth).map(of).collect()
}

/// Asserts that a result is right within its deviations, and that these are small.
fn assert_right(result: &Identification, truth: &[f64], largest: f64) {
    let errors = errors(result, truth);
    assert!(errors.iter().all(|z| z.abs() < 3.0), "{errors:?}\n{result}");
    for (own, truth) in result.parameters.iter().zip(truth) {
        assert!(own.std.expect("identified") < largest * truth.abs(), "{result}");
    }
    assert!(result.is_complete(), "{result}");
}

#[test]
fn two_masses_are_told_from_the_motor_alone() {
    let model = DeclaredModel::parse("two.tpm", TWO_MASSES).expect("a model");
    let truth = [0.8, 0.5, 1.2, 0.4, 300.0, 0.6];
    let made = run(&model, &truth, &[0.0; 6], even(2000, 0.005), steps);
    let result = from_log(&model, made.log(&[("x1", 0, 1e-4)], Some("u"), 1)).expect("identified");
    assert_right(&result, &truth, 0.1);
}

#[test]
fn a_mode_that_is_much_faster_than_the_motion_is_told() {
    let model = DeclaredModel::parse("two.tpm", TWO_MASSES).expect("a model");
    // Ten cycles of the spring pass while the motor's position, which drifts, crosses its mean once.
    let truth = [3e-3, 5e-3, 4e-3, 6e-3, 12.0, 0.02];
    let steps = |t: f64| (83.0 * (t / 0.02).floor()).sin().signum() + 0.5 * (2.5 * t).sin();
    let made = run(&model, &truth, &[0.0; 6], even(6000, 0.001), steps);
    let result = from_log(&model, made.log(&[("x1", 0, 1e-4)], Some("u"), 1)).expect("identified");
    assert_right(&result, &truth, 0.01);
}

#[test]
fn the_size_of_a_state_that_nobody_measured_is_told_by_no_number_of_logs() {
    let model = PROPELLER
        .replace("l [m], tau [s];", "l [m], a [s], b [1];")
        .replace("tau*dot(thrust) + thrust = u;", "a*dot(thrust) + b*thrust = u;");
    let model = DeclaredModel::parse("propeller.tpm", &model).expect("a model");
    let truth = [0.03, 0.02, 0.2, 0.15, 1.0];
    let logs = [(0.0, 2), (50.0, 3)].map(|(shift, seed)| {
        let made = run(&model, &truth, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], even(1200, 0.01), |t| steps(t + shift));
        made.log(&[("phi", 0, 2e-3)], Some("u"), seed)
    });
    let result = from_logs(&model, logs).expect("identified");
    assert_eq!(result.rank, 4, "{result}");
    let products: Vec<(f64, f64)> = (result.combinations.iter())
        .filter_map(|own| own.product.as_ref().map(|product| (product.value, own.std)))
        .collect();
    // l/b and a/b.
    assert_eq!(products.len(), 2, "{result}");
    for ((found, std), truth) in products.into_iter().zip([0.2, 0.15]) {
        assert!((found - truth).abs() < 3.5 * std && std < 0.01 * truth, "{result}");
    }
}

/// A motor, of which only derivatives of the angle stand in the equation.
const MOTOR: &str = "model Motor {
    coordinate theta [rad];
    input i [A];
    parameter J [kg*m^2], b [N*m*s];
    constant kt = 0.05 [N*m/A];
    J*ddot(theta) + b*dot(theta) = kt*i;
}";

fn recorded(result: &Identification) -> Option<&RecordedReport> {
    match &result.log.as_ref()?.way {
        Way::Recorded(own) => Some(own),
        _ => None,
    }
}

#[test]
fn a_rate_stands_for_a_position_that_no_column_has() {
    let motor = DeclaredModel::parse("motor.tpm", MOTOR).expect("a model");
    let truth = [2e-4, 3e-4];
    let made = run(&motor, &truth, &[0.0; 3], even(2000, 0.005), steps);
    let log = made.log(&[("dot(theta)", 1, 0.2)], Some("i"), 1);
    let result = from_log(&motor, log.clone()).expect("identified");
    assert_right(&result, &truth, 0.01);
    // The angle stands nowhere: the log is one of a model of the rate, and is not simulated.
    assert!(recorded(&result).is_none(), "{result}");
    let checked = validate(&motor, log.clone(), &result).expect("validated");
    assert!(checked.simulation.is_some(), "{:?}", checked.not_simulated);
    inspect_for(&motor, log).expect("inspected");

    let pendulum = MOTOR
        .replace("b*dot(theta)", "b*dot(theta) + mgl*sin(theta)")
        .replace("    J*ddot", "    constant mgl = 0.02 [N*m];\n    J*ddot");
    let pendulum = DeclaredModel::parse("pendulum.tpm", &pendulum).expect("a model");
    let made = run(&pendulum, &truth, &[0.0; 3], even(2000, 0.005), |t| 0.15 * steps(t));
    let log = made.log(&[("gyro", 1, 0.05)], Some("i"), 1);
    let unnamed = from_log(&pendulum, log.clone()).expect_err("no column is called so").to_string();
    assert!(unnamed.contains("there is no column `theta`;"), "{unnamed}");
    let log = log.map("dot(theta)", "gyro");
    let result = from_log(&pendulum, log.clone()).expect("identified");
    assert_right(&result, &truth, 0.01);
    assert_eq!(recorded(&result).expect("the angle is simulated").unmeasured, ["theta"]);
    let checked = validate(&pendulum, log, &result).expect("validated");
    assert!(checked.between_stamps.is_some_and(|run| run.sensors[0].free_run.fit.is_some_and(|fit| fit > 95.0)));
}

#[test]
fn two_masses_are_told_from_both_rates() {
    let model = TWO_MASSES.replace("coordinate x1 [m];\n    unmeasured x2 [m];", "coordinate x1 [m], x2 [m];");
    let model = DeclaredModel::parse("two.tpm", &model).expect("a model");
    let truth = [0.8, 0.5, 1.2, 0.4, 300.0, 0.6];
    let made = run(&model, &truth, &[0.0; 6], even(2000, 0.005), steps);
    let rates = [("dot(x1)", 2, 1e-3), ("dot(x2)", 3, 1e-3)];
    let result = from_log(&model, made.log(&rates, Some("u"), 1)).expect("identified");
    assert_right(&result, &truth, 0.1);
}

#[test]
fn a_thrust_that_lags_is_told_from_the_angle() {
    let model = DeclaredModel::parse("propeller.tpm", PROPELLER).expect("a model");
    let truth = [0.03, 0.02, 0.2, 0.15];
    let made = run(&model, &truth, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], even(1500, 0.01), steps);
    let result = from_log(&model, made.log(&[("phi", 0, 2e-3)], Some("u"), 2)).expect("identified");
    assert_right(&result, &truth, 0.1);
}

#[test]
fn what_is_left_beyond_the_noise_of_a_sensor_is_not_trusted() {
    let model = DeclaredModel::parse("propeller.tpm", PROPELLER).expect("a model");
    let cogging = PROPELLER.replace("- l*thrust", "+ cogging*sin(7*phi) - l*thrust");
    let cogging = cogging.replace("constant mgl = 0.6 [N*m];", "constant mgl = 0.6 [N*m], cogging = 0.05 [N*m];");
    let machine = DeclaredModel::parse("cogging.tpm", &cogging).expect("a model");
    let truth = [0.03, 0.02, 0.2, 0.15];
    let made = run(&machine, &truth, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], even(1500, 0.01), steps);
    let result = from_log(&model, made.log(&[("phi", 0, 2e-3)], Some("u"), 2)).expect("identified");
    let said = |warning: &Warning| matches!(warning, Warning::BeyondNoise { signal, left, noise } if signal == "phi" && left > noise);
    assert!(result.warnings.iter().any(said) && !result.is_complete(), "{result}");
}

#[test]
fn the_upper_tank_is_told_from_the_lower_one() {
    let model = DeclaredModel::parse("tanks.tpm", TANKS).expect("a model");
    let truth = [0.05, 0.04];
    let made = run(&model, &truth, &[2.0, 3.0, 0.0, 0.0], even(600, 1.0), |t| 0.072 + 0.024 * steps(t / 40.0));
    let result = from_log(&model, made.log(&[("h2", 0, 5e-3)], Some("u"), 3)).expect("identified");
    assert_right(&result, &truth, 0.1);
}

/// The upper tank's level may have any scale; a valve that is known tells it, exactly along the products that the log shows.
#[test]
fn a_valve_that_is_known_tells_the_scale_of_a_level_that_nobody_reads() {
    let text = "model Tanks {
        unmeasured x1 [V]; coordinate x2 [V];
        input u [V];
        parameter k1 [V^(1/2)/s], k2 [V^(1/2)/s], k3 [V^(1/2)/s], k4 [1/s];
        dot(x1) + k1*sqrt(x1) = k4*u;
        dot(x2) + k3*sqrt(x2) = k2*sqrt(x1);
    }";
    let model = DeclaredModel::parse("tanks.tpm", text).expect("a model");
    let truth = [0.05, 0.05, 0.05, 0.04];
    let lumped: Vec<f64> = (0..model.evaluated().dims().parameters)
        .map(|j| match model.evaluated().parameter(j).name {
            "k1_per_k4" => truth[0] / truth[3],
            "lumped_1_per_k4" => 1.0 / truth[3],
            _ => 0.05,
        })
        .collect();
    let made = run(&model, &lumped, &[4.0, 4.0, 0.0, 0.0], even(600, 4.0), |t| 2.75 + 1.25 * steps(t / 60.0));
    let mut request = made.log(&[("x2", 1, 0.01)], Some("u"), 3);
    request.estimation.frozen.insert("k1".into(), truth[0]);
    let result = from_log(&model, request).expect("identified");
    assert!(result.is_complete() && result.rank == 4, "{result}");
    for (own, truth) in result.physical.iter().zip(truth) {
        let (value, std) = (own.value.expect("known"), own.std.expect("known"));
        assert!((value - truth).abs() <= 4.0 * std && std < 0.1 * truth, "{own:?}\n{result}");
    }
}

#[test]
fn a_state_that_no_sensor_feels_is_named_with_the_sensor_that_would_show_it() {
    let text = "model Apart {
        coordinate x [m];
        unmeasured y [m];
        input u [N];
        parameter m [kg], d [N*s/m], e [N*s/m];
        m*ddot(x) + d*dot(x) = u;
        m*ddot(y) + e*dot(y) = u;
    }";
    let model = DeclaredModel::parse("apart.tpm", text).expect("a model");
    let made = run(&model, &[1.0, 2.0, 3.0], &[0.0; 6], even(400, 0.01), steps);
    let fault = from_log(&model, made.log(&[("x", 0, 1e-4)], Some("u"), 4)).expect_err("y is not felt").to_string();
    assert!(fault.contains("`y` is unmeasured") && fault.contains("measure `y` or `dot(y)`"), "{fault}");
    let shown = model.shown(&[], &[]).expect("exact");
    assert_eq!((shown.rank, shown.unfelt.len()), (2, 1), "{shown:?}");
    // A sensor of the rate alone is one that feels it.
    let shown = model.shown(&[("y".into(), 1)], &[]).expect("exact");
    assert_eq!((shown.rank, shown.together.len(), shown.unfelt.len()), (3, 0, 0), "{shown:?}");
}

#[test]
fn what_sensors_show_is_known_exactly() {
    let shown = |text: &str, held: &[usize]| {
        let model = DeclaredModel::parse("model.tpm", text).expect("a model");
        model.shown(&[], held).expect("exact")
    };
    for text in [TWO_MASSES, PROPELLER, TANKS] {
        let found = shown(text, &[]);
        assert!(found.together.is_empty() && found.unfelt.is_empty(), "{found:?}");
    }
    // A thrust of unknown scale: lever, lag and slope have one factor that no angle shows.
    let scaled = "model Scaled {
        coordinate phi [rad];
        unmeasured thrust [N];
        input u [V];
        parameter J [kg*m^2], d [N*m*s/rad], l [m], lag [V*s/N], slope [V/N];
        constant mgl = 0.6 [N*m];
        J*ddot(phi) + d*dot(phi) + mgl*sin(phi) - l*thrust = 0;
        lag*dot(thrust) + slope*thrust = u;
    }";
    let found = shown(scaled, &[]);
    assert_eq!((found.rank, found.together), (4, vec![vec![2, 3, 4]]));
    assert_eq!(shown(scaled, &[4]).together, Vec::<Vec<usize>>::new());
    // Friction and an offset are told apart by a motion that turns both ways.
    let rubbing = "model Rubbing {
        coordinate x [m];
        input u [N];
        parameter m [kg], fc [N], o [N];
        m*ddot(x) + fc*sign(dot(x)) + o = u;
    }";
    assert_eq!(shown(rubbing, &[]).rank, 3);
}

/// A pendulum with a coarse encoder, and an accelerometer at the end of a lever that feels gravity and has an offset.
const ACCELEROMETER: &str = "model Accelerometer {
    coordinate phi [rad], acc [m/s^2];
    input u [N*m];
    parameter J [kg*m^2], d [N*m*s/rad], mgl [N*m], zero [m/s^2];
    constant r = 0.3 [m], g = 9.81 [m/s^2];
    J*ddot(phi) + d*dot(phi) + mgl*sin(phi) = u;
    acc - r*ddot(phi) - g*sin(phi) - zero = 0;
}";

#[test]
fn an_accelerometer_is_read_beside_the_encoder_with_gravity_in_it() {
    let model = DeclaredModel::parse("accelerometer.tpm", ACCELEROMETER).expect("a model");
    let truth = [0.03, 0.02, 0.6, 0.25];
    // The sensor's slots: phi, acc, dot(phi), -, ddot(phi), -.
    let made = run(&model, &truth, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], even(1500, 0.01), |t| 0.3 * steps(t));
    let shown = model.shown(&[], &[]).expect("exact");
    assert_eq!((shown.rank, shown.together.len(), shown.unfelt.len()), (4, 0, 0), "{shown:?}");
    let both = from_log(&model, made.log(&[("phi", 0, 2e-2), ("acc", 1, 5e-2)], Some("u"), 7)).expect("identified");
    assert_right(&both, &truth, 0.05);
    let report = both.to_string();
    assert!(report.contains("acc"), "{report}");
    // With the encoder alone the inertia is less certain, whose variance is 2.5 times as large.
    let alone = "model Alone {
        coordinate phi [rad];
        input u [N*m];
        parameter J [kg*m^2], d [N*m*s/rad], mgl [N*m];
        J*ddot(phi) + d*dot(phi) + mgl*sin(phi) = u;
    }";
    let alone = DeclaredModel::parse("alone.tpm", alone).expect("a model");
    let without = from_log(&alone, made.log(&[("phi", 0, 2e-2)], Some("u"), 7)).expect("identified");
    let deviation = |result: &Identification| result.parameters[0].std.expect("identified");
    assert!(deviation(&both) < 0.7 * deviation(&without), "{} {}", deviation(&both), deviation(&without));
}

#[test]
fn a_measured_acceleration_is_mapped_by_its_name() {
    let text = "model Slide {
        coordinate x [m];
        input u [N];
        parameter m [kg], d [N*s/m], k [N/m];
        m*ddot(x) + d*dot(x) + k*x = u;
    }";
    let model = DeclaredModel::parse("slide.tpm", text).expect("a model");
    let truth = [0.8, 1.2, 30.0];
    let made = run(&model, &truth, &[0.0; 3], even(1200, 0.01), steps);
    let log = |columns: &[(&str, usize, f64)], seed| made.log(columns, Some("u"), seed);
    let result =
        from_log(&model, log(&[("x", 0, 1e-3), ("acc", 2, 2e-2)], 8).map("ddot(x)", "acc")).expect("identified");
    assert_right(&result, &truth, 0.01);
    assert!(result.to_string().contains("ddot(x)"), "{result}");
    // A column of this name that nobody mapped is mostly one that was computed from the position.
    let computed = from_log(&model, log(&[("x", 0, 1e-3), ("ddot(x)", 2, 2e-2)], 8)).expect("identified");
    assert!(!computed.to_string().contains("ddot(x)"), "{computed}");
    // An accelerometer and no position.
    let moved = text.replace("coordinate", "unmeasured");
    let moved = DeclaredModel::parse("slide.tpm", &moved).expect("a model");
    let result = from_log(&moved, log(&[("acc", 2, 2e-2)], 9).map("ddot(x)", "acc")).expect("identified");
    assert_right(&result, &truth, 0.05);
}

#[test]
fn stamps_that_are_uneven_are_simulated_between() {
    let model = DeclaredModel::parse("propeller.tpm", PROPELLER).expect("a model");
    let truth = [0.03, 0.02, 0.2, 0.15];
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut time = vec![0.0];
    for k in 0..1500 {
        time.push(time[k] + 0.001 * f64::from(random.random_range(4..18)));
    }
    let made = run(&model, &truth, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], time, steps);
    let result = from_log(&model, made.log(&[("phi", 0, 2e-3)], Some("u"), 5)).expect("identified");
    assert_right(&result, &truth, 0.1);
}

#[test]
fn blanks_between_topics_are_no_gaps() {
    let model = DeclaredModel::parse("propeller.tpm", PROPELLER).expect("a model");
    let truth = [0.03, 0.02, 0.2, 0.15];
    let made = run(&model, &truth, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], even(3000, 0.005), steps);
    let mut log = made.log(&[("phi", 0, 2e-3)], Some("u"), 6);
    // The command is written when it changes, the angle in every third row.
    let columns = [("t_s", &made.time), ("u", &made.input)];
    let written = |k: usize| k == 0 || made.input[k] != made.input[k - 1];
    let mut all: Vec<(String, Vec<f64>)> = columns.map(|(name, own)| (name.to_owned(), own.clone())).to_vec();
    (0..made.time.len()).filter(|&k| !written(k)).for_each(|k| all[1].1[k] = f64::NAN);
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let angle = |(k, motion): (usize, &Vec<f64>)| {
        let noise: f64 = random.sample(StandardNormal);
        if k % 3 == 1 { motion[0] + 2e-3 * noise } else { f64::NAN }
    };
    all.push(("phi".to_owned(), made.motion.iter().enumerate().map(angle).collect()));
    log.memory = Some(InMemory::Samples(Samples::new(all)));
    let result = from_log(&model, log).expect("identified");
    assert_right(&result, &truth, 0.1);
}

/// Command and angle are written by turns: the angle has a clock of its own, also beside a coarser record, whose instants they share.
#[test]
fn a_command_that_is_written_between_the_readings_has_another_clock() {
    let model = DeclaredModel::parse("propeller.tpm", PROPELLER).expect("a model");
    let truth = [0.03, 0.02, 0.2, 0.15];
    let time: Vec<f64> = even(3000, 0.005);
    let held = |t: f64| steps((t / 0.015 + 1e-6).floor() * 0.015);
    let made = run(&model, &truth, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], time, held);
    let mut log = made.log(&[("phi", 0, 2e-3)], Some("u"), 6);
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let only = |at: usize, k: usize, value: f64| if k % 3 == at { value } else { f64::NAN };
    let angle =
        |(k, motion): (usize, &Vec<f64>)| only(1, k, motion[0] + 2e-3 * random.sample::<f64, _>(StandardNormal));
    let phi = made.motion.iter().enumerate().map(angle).collect();
    let u = made.input.iter().enumerate().map(|(k, u)| only(0, k, *u)).collect();
    let all = vec![("t_s".to_owned(), made.time.clone()), ("u".to_owned(), u), ("phi".to_owned(), phi)];
    log.memory = Some(InMemory::Samples(Samples::new(all)));
    let result = from_log(&model, log).expect("identified");
    assert_right(&result, &truth, 0.1);
}

/// How often the stated 95 % intervals hold the truth, over twenty logs of each machine.
#[test]
#[ignore = "minutes: measures rates over twenty logs of each of three models"]
fn intervals_hold_the_truth_as_often_as_they_say() {
    let masses = DeclaredModel::parse("two.tpm", TWO_MASSES).expect("a model");
    let propeller = DeclaredModel::parse("propeller.tpm", PROPELLER).expect("a model");
    let tanks = DeclaredModel::parse("tanks.tpm", TANKS).expect("a model");
    let of_masses = [0.8, 0.5, 1.2, 0.4, 300.0, 0.6];
    let of_propeller = [0.03, 0.02, 0.2, 0.15];
    let of_tanks = [0.05, 0.04];
    let runs = [
        (&masses, &of_masses[..], run(&masses, &of_masses, &[0.0; 6], even(2000, 0.005), steps), ("x1", 1e-4)),
        (
            &propeller,
            &of_propeller[..],
            run(&propeller, &of_propeller, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], even(1500, 0.01), steps),
            ("phi", 2e-3),
        ),
        (
            &tanks,
            &of_tanks[..],
            run(&tanks, &of_tanks, &[2.0, 3.0, 0.0, 0.0], even(600, 1.0), |t| 0.072 + 0.024 * steps(t / 40.0)),
            ("h2", 5e-3),
        ),
    ];
    for (model, truth, made, (name, noise)) in &runs {
        let (mut all, mut inside, mut largest) = (0, 0, 0.0_f64);
        for seed in 0..20 {
            let log = made.log(&[(name, 0, *noise)], Some("u"), 100 + seed);
            let result = from_log(*model, log).expect("identified");
            for z in errors(&result, truth) {
                all += 1;
                inside += i32::from(z.abs() < 1.96);
                largest = largest.max(z.abs());
            }
        }
        eprintln!("{name}: {inside} of {all} inside, largest {largest:.2}");
        assert!(f64::from(inside) >= 0.88 * f64::from(all) && largest < 5.0, "{name}: {inside} of {all}, {largest}");
    }
}
