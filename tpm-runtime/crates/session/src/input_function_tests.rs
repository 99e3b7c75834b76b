//! Inputs that do not stand alone, and machines that nothing drives: identified and followed by simulation, refused elsewhere.

use crate::model::Identifiable as _;
use crate::{DeclaredModel, Identification, LogRequest, Warning, from_log, validate};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use tpm_codegen::identified::Identified;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::EvalError;
use tpm_log::Samples;
use tpm_motion::Plant;

/// A machine with what is known of it, and how its log is made.
struct Case {
    text: &'static str,
    truth: &'static [f64],
    first: &'static [f64],
    inputs: fn(f64) -> Vec<f64>,
    samples: usize,
    step: f64,
    noise: f64,
}

/// A command that jumps at times of its own.
fn steps(t: f64) -> f64 {
    let at = (t / 0.37).floor();
    (at * 1.7).sin() + 0.5 * (at * 0.61).cos()
}

impl Case {
    fn model(&self) -> DeclaredModel {
        DeclaredModel::parse("model.tpm", self.text).expect("a model")
    }

    /// A log of the first coordinate and the inputs, held between stamps.
    fn log(&self, seed: u64) -> LogRequest {
        let model = self.model();
        let rows = model.evaluated();
        let mut plant = Plant::new(rows, self.truth, &[]).expect("fits");
        plant.reset(self.first).expect("fits");
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let inputs = rows.dims().inputs;
        let mut columns = vec![Vec::new(); 2 + inputs];
        for k in 0..self.samples {
            let time = k as f64 * self.step;
            let applied = (self.inputs)(time);
            columns[0].push(time);
            columns[1].push(plant.motion()[0] + self.noise * random.sample::<f64, _>(StandardNormal));
            applied.iter().zip(&mut columns[2..]).for_each(|(u, column)| column.push(*u));
            plant.advance(&applied, self.step, 20).expect("stays within bounds");
        }
        let names = [rows.coordinate(0).name.to_owned()].into_iter();
        let names = names.chain((0..inputs).map(|i| rows.input(i).name.to_owned()));
        let all = ["t_s".to_owned()].into_iter().chain(names).zip(columns).collect();
        LogRequest::of_samples("log", Samples::new(all)).hold(Hold::Zoh)
    }

    /// The result of a log, right within its deviations, which are small.
    fn identified(&self) -> Identification {
        let result = from_log(&self.model(), self.log(1)).expect("identified");
        for (own, truth) in result.parameters.iter().zip(self.truth) {
            let (value, std) = (own.value.expect("identified"), own.std.expect("identified"));
            assert!((value - truth).abs() < 3.5 * std && std < 0.1 * truth.abs(), "{}: {truth}\n{result}", own.name);
        }
        assert!(result.is_complete(), "{result}");
        result
    }
}

/// A pendulum with a propeller whose thrust grows with the square of the voltage, either way.
const PROPELLER: Case = Case {
    text: "model Propeller {
        coordinate phi [rad];
        input u [V];
        parameter J [kg*m^2], d [N*m*s/rad], kT [N*m/V^2];
        constant mgl = 0.6 [N*m];
        J*ddot(phi) + d*dot(phi) + mgl*sin(phi) = kT*u*abs(u);
    }",
    truth: &[0.03, 0.02, 0.2],
    first: &[0.1, 0.0, 0.0],
    inputs: |t| vec![steps(t)],
    samples: 1200,
    step: 0.01,
    noise: 2e-3,
};

/// A magnet whose force grows with the square of the current, and falls with the position; friction grows with the current.
const MAGNET: Case = Case {
    text: "model Magnet {
        coordinate x [m];
        input i [A];
        parameter d [N*s/m], k [N/m], a [N/A^2], b [N/(A*m)], mu [N/A];
        constant m = 0.4 [kg];
        m*ddot(x) + d*dot(x) + k*x + mu*abs(i)*sign(dot(x)) = a*i^2 - b*i*x;
    }",
    truth: &[0.8, 30.0, 2.0, 5.0, 0.15],
    first: &[0.05, 0.0, 0.0],
    inputs: |t| vec![1.5 * steps(t)],
    samples: 1500,
    step: 0.01,
    noise: 1e-4,
};

/// A motor on a battery whose voltage sags: the voltage times the duty drives it. Its scale is that of the known inertia.
const BATTERY: Case = Case {
    text: "model Battery {
        coordinate w [rad/s];
        input duty [1], supply [V];
        parameter d [N*m*s/rad], c [N*m], K [N*m/V];
        constant J = 2e-3 [kg*m^2];
        J*dot(w) + d*w + c*sign(w) = K*duty*supply;
    }",
    truth: &[4e-3, 0.01, 0.05],
    first: &[0.5, 0.0],
    inputs: |t| vec![steps(t), 12.0 - 0.3 * t],
    samples: 1000,
    step: 0.01,
    noise: 0.02,
};

#[test]
fn a_thrust_that_is_a_square_is_identified_and_followed() {
    let result = PROPELLER.identified();
    let model = PROPELLER.model();
    let known = Identified::of_values(
        "Propeller",
        &result.parameters.iter().map(|own| (own.name.clone(), own.value.expect("identified"))).collect(),
    );
    let run = validate(&model, PROPELLER.log(2), known).expect("followed").between_stamps.expect("simulated");
    let fit = run.sensors[0].free_run.fit.expect("it moves");
    assert!(fit > 98.0 && run.left == 0, "{run:?}");
    // Without the square it is another machine, and the free run says so.
    let wrong = Identified::of_values(
        "Propeller",
        &[("J", 0.03), ("d", 0.02), ("kT", -0.2)].map(|(name, value)| (name.to_owned(), value)).into(),
    );
    let found = validate(&model, PROPELLER.log(2), wrong).expect("followed");
    assert!(found.shortfall().is_some(), "{found:?}");
}

#[test]
fn inputs_beside_the_motion_have_columns() {
    MAGNET.identified();
}

#[test]
fn a_product_of_two_inputs_drives_a_motor() {
    BATTERY.identified();
}

#[test]
fn gains_of_several_inputs_are_told_against_the_first() {
    let text = "model Two {
        coordinate x [m];
        input u [V], v [V];
        parameter m [kg], d [N*s/m], a [N/V], b [N/V];
        m*ddot(x) + d*dot(x) = a*u + b*v;
    }";
    let model = DeclaredModel::parse("two.tpm", text).expect("a model");
    let names: Vec<&str> = model.prepared().form.columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names.len(), 3, "{names:?}");
    assert_eq!(model.shown(&[], &[]).expect("exact").rank, 3);
}

#[test]
fn free_swings_need_a_known_force_alone() {
    let case = Case {
        text: "model Free {
            coordinate phi [rad];
            parameter J [kg*m^2], d [N*m*s/rad], fc [N*m];
            constant mgl = 6e-3 [N*m];
            J*ddot(phi) + d*dot(phi) + fc*sign(dot(phi)) + mgl*sin(phi) = 0;
        }",
        truth: &[4.55e-5, 2.94e-5, 1.3e-4],
        first: &[1.2, 0.0, 0.0],
        inputs: |_| Vec::new(),
        samples: 800,
        step: 0.005,
        noise: 5e-4,
    };
    case.identified();
    let scaleless = case.text.replace("constant mgl = 6e-3", "parameter mgl");
    let fault = DeclaredModel::parse("free.tpm", &scaleless).expect_err("no scale").to_string();
    assert!(fault.contains("nothing fixes the scale") && fault.contains("free.tpm:5"), "{fault}");
}

#[test]
fn a_static_map_may_have_a_square_of_its_input() {
    let text = "model Fan {
        coordinate F [N];
        input w [rad/s];
        parameter a [N*s^2/rad^2], b [N*s/rad];
        F = a*w^2 + b*w;
    }";
    let model = DeclaredModel::parse("fan.tpm", text).expect("a model");
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let speed: Vec<f64> = (0..200).map(|k| f64::from(k) * 0.5).collect();
    let force = speed.iter().map(|w| 0.02 * w * w + 0.3 * w + 0.1 * random.sample::<f64, _>(StandardNormal)).collect();
    let time = (0..200).map(|k| f64::from(k) * 0.1).collect();
    let all = vec![("t_s".to_owned(), time), ("F".to_owned(), force), ("w".to_owned(), speed)];
    let result = from_log(&model, LogRequest::of_samples("fan", Samples::new(all))).expect("a regression");
    for (own, truth) in result.parameters.iter().zip([0.02, 0.3]) {
        let (value, std) = (own.value.expect("identified"), own.std.expect("identified"));
        assert!((value - truth).abs() < 3.5 * std && std < 0.05 * truth, "{result}");
    }
}

#[test]
fn what_needs_inputs_that_stand_alone_refuses_the_others() {
    let model = PROPELLER.model();
    let rows = model.evaluated();
    let mut scratch = vec![0.0; rows.workspace_len()];
    let mut phi = vec![0.0; rows.dims().regressor_len()];
    assert_eq!(rows.regressor(&[0.1, 0.2, 0.3], &[], &mut scratch, &mut phi), Err(EvalError::InputsNeeded));
    let fault =
        tpm_symbolic::regressor::prepare::prepare(model.parsed().model.clone()).expect_err("u*abs(u)").to_string();
    assert!(fault.contains("must stand alone") && fault.contains("kT*abs(u)"), "{fault}");
    // The rows under inputs are those of the equation: J phi'' + d phi' - kT u |u| + mgl sin phi = 0.
    let mut known = vec![0.0];
    rows.rows_under(&[0.1, 0.2, 0.3], &[-2.0], &[], &mut scratch, (&mut phi, &mut known)).expect("fits");
    assert_eq!(phi, [0.3, 0.2, 4.0]);
    assert!((known[0] - 0.6 * 0.1_f64.sin()).abs() < 1e-15);
}

/// A motor that turns against its command is wired or recorded the wrong way round, unless somebody has said that it does.
#[test]
fn a_gain_that_goes_against_its_input_is_named() {
    let case = Case { truth: &[0.03, 0.02, -0.2], ..PROPELLER };
    let against = |request: LogRequest| {
        let result = from_log(&case.model(), request).expect("identified");
        let said = |warning: &Warning| matches!(warning, Warning::GoesAgainst { parameter, .. } if parameter == "kT");
        assert!(result.is_complete() != result.warnings.iter().any(said), "{result}");
        result.warnings.iter().any(said)
    };
    assert!(against(case.log(1)));
    let mut told = case.log(1);
    told.estimation.prior.insert("kT".into(), -0.1);
    assert!(!against(told));
}
