//! Templates on machines whose parameters are known, recorded with the headers and units of logs as they come.

use std::f64::consts::PI;
use std::fmt::Write as _;
use tpm_runtime::estimate::Refine;
use tpm_runtime::session::{DeclaredModel, LogRequest, Proposal, Quantity, from_log, inspect, proposals};

/// Time between samples, s, and steps of the simulation in it.
const SAMPLE_TIME: f64 = 2e-3;
const STEPS: usize = 8;
const SAMPLES: usize = 10_000;

/// A machine: accelerations of its coordinates from positions, rates and input.
type Machine = dyn Fn([f64; 2], [f64; 2], f64) -> [f64; 2];

/// The log of a machine under several sines of a size, in a file with these headers, its columns divided by these units; rates in place of
/// positions where a header says speed.
fn recorded(header: &str, units: [f64; 3], size: f64, machine: &Machine) -> tempfile::NamedTempFile {
    let mut text = format!("{header}\n");
    let rates = header.contains("speed");
    let (mut q, mut v) = ([0.0; 2], [0.0; 2]);
    for n in 0..SAMPLES {
        let t = n as f64 * SAMPLE_TIME;
        let sine = |f: f64, phase: f64| (2.0 * PI * f * t + phase).sin();
        let u = size * (sine(0.4, 0.0) + 0.6 * sine(1.0, 1.0) + 0.5 * sine(2.2, 2.0) + 0.4 * sine(3.8, 3.0));
        let read = if rates { v } else { q };
        let readings = [read[0] / units[0], read[1] / units[1], u / units[2]];
        writeln!(text, "{},{:.9},{:.9},{:.9}", t * 1e3, readings[0], readings[1], readings[2]).expect("a text");
        let h = SAMPLE_TIME / STEPS as f64;
        for _ in 0..STEPS {
            // The midpoint rule: of second order, and friction that jumps needs no more.
            let a = machine(q, v, u);
            let half = |x: [f64; 2], by: [f64; 2], h: f64| [x[0] + h * by[0], x[1] + h * by[1]];
            let (qm, vm) = (half(q, v, 0.5 * h), half(v, a, 0.5 * h));
            (q, v) = (half(q, vm, h), half(v, machine(qm, vm, u), h));
        }
    }
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    file
}

/// What the model of a template finds in a log, with the columns that were proposed for it.
fn found(proposal: &Proposal, log: &std::path::Path) -> Vec<(String, f64)> {
    let text = proposal.model("Begun");
    let model = DeclaredModel::parse("begun.tpm", &text).unwrap_or_else(|fault| panic!("{fault}\n{text}"));
    let mut request = LogRequest::new(log);
    request.reading.columns.map =
        proposal.signals.iter().map(|placed| (placed.signal.clone(), placed.column.clone())).collect();
    request.estimation.refine = Refine::None;
    let result = from_log(&model, request).unwrap_or_else(|error| panic!("{}: {error}", proposal.template.name));
    result.parameters.iter().map(|own| (own.name.clone(), own.value.unwrap_or(f64::NAN))).collect()
}

/// The template of this name finds the parameters of a machine within a twentieth of the largest of the same unit.
fn check(template: &str, header: &str, units: [f64; 3], size: f64, machine: &Machine, truth: &[f64]) {
    let log = recorded(header, units, size, machine);
    let fitting = proposals(&inspect(log.path()).expect("a log"));
    let proposal = fitting.iter().find(|proposal| proposal.template.name == template);
    let proposal = proposal.unwrap_or_else(|| panic!("{template} does not fit `{header}`: {fitting:?}"));
    let values = found(proposal, log.path());
    assert_eq!(values.len(), truth.len(), "{template}: {values:?}");
    for ((name, value), truth) in values.iter().zip(truth) {
        assert!((value - truth).abs() <= 0.05 * truth.abs().max(0.2), "{template}: {name} is {truth}, not {values:?}");
    }
}

#[test]
fn templates_find_the_parameters_of_their_machines_in_the_units_of_a_header() {
    let milli = 1e-3;
    let degree = PI / 180.0;
    check(
        "spring",
        "Time [ms],Way [mm],spare,Force [N]",
        [milli, 1.0, 1.0],
        20.0,
        &|q, v, u| [(u - 3.0 * v[0] - 40.0 * q[0]) / 2.0, 0.0],
        &[2.0, 3.0, 40.0],
    );
    check(
        "slider",
        "time_ms,Carriage position [m],spare,force [kN]",
        [1.0, 1.0, 1e3],
        20.0,
        &|_, v, u| [(u - 8.0 * v[0] - 4.0 * v[0].signum() - 1.0) / 2.0, 0.0],
        &[2.0, 8.0, 4.0, 1.0],
    );
    check(
        "motor",
        "Time [ms],Output angle [deg],spare,Motor current [A]",
        [degree, 1.0, 1.0],
        4.0,
        &|_, v, u| [(u - 1.5 * v[0] - 0.6 * v[0].signum() - 0.3) / 0.5, 0.0],
        &[0.5, 1.5, 0.6, 0.3],
    );
    check(
        "pendulum",
        "Time [ms],phi [deg],spare,torque [Nm]",
        [degree, 1.0, 1.0],
        6.0,
        &|q, v, u| [(u - 0.8 * v[0] - 0.5 * v[0].signum() - 5.0 * q[0].sin() - 2.0 * q[0].cos()) / 0.5, 0.0],
        &[0.5, 0.8, 0.5, 5.0, 2.0],
    );
}

#[test]
fn templates_find_the_parameters_from_speeds() {
    check(
        "motor",
        "Time [ms],motor speed [rpm],spare,Motor current [A]",
        [PI / 30.0, 1.0, 1.0],
        4.0,
        &|_, v, u| [(u - 1.5 * v[0] - 0.6 * v[0].signum() - 0.3) / 0.5, 0.0],
        &[0.5, 1.5, 0.6, 0.3],
    );
    check(
        "slider",
        "time_ms,speed [mm/s],spare,force [N]",
        [1e-3, 1.0, 1.0],
        20.0,
        &|_, v, u| [(u - 8.0 * v[0] - 4.0 * v[0].signum() - 1.0) / 2.0, 0.0],
        &[2.0, 8.0, 4.0, 1.0],
    );
}

#[test]
fn templates_of_two_coordinates_find_the_parameters_of_their_machines() {
    let degree = PI / 180.0;
    check(
        "two_masses",
        "Time [ms],motor angle [deg],load angle [deg],torque [Nm]",
        [degree, degree, 1.0],
        10.0,
        &|q, v, u| {
            let between = 200.0 * (q[0] - q[1]) + 0.5 * (v[0] - v[1]);
            [(u - 1.0 * v[0] - between) / 0.6, (between - 0.8 * v[1]) / 0.4]
        },
        &[0.6, 0.4, 1.0, 0.8, 0.5, 200.0, 0.0],
    );
    check(
        "cart_pole",
        "Time [ms],cart [m],pole [rad],motor [N]",
        [1.0, 1.0, 1.0],
        20.0,
        &|q, v, u| {
            let (b, inertia, m) = (0.6, 0.5, 3.0);
            let (s, c) = q[1].sin_cos();
            let force = u + b * s * v[1] * v[1] - 6.0 * v[0] - 2.0 * v[0].signum();
            let torque = -0.3 * v[1] - 9.81 * b * s;
            let determinant = m * inertia - b * b * c * c;
            [(inertia * force - b * c * torque) / determinant, (m * torque - b * c * force) / determinant]
        },
        &[3.0, 6.0, 2.0, 0.6, 0.5, 0.3, 5.886],
    );
}

#[test]
fn columns_are_told_by_unit_before_name() {
    use Quantity as Q;
    for (name, unit, quantity) in [
        ("q_m", Some("m"), Q::Length),
        ("Output angle [deg]", Some("deg"), Q::Angle),
        ("phi", Some("rad"), Q::Angle),
        ("u [%]", Some("%"), Q::Other),
        ("torque", Some("Nm"), Q::Torque),
        ("speed", Some("rev/min"), Q::Rate),
        ("motorCurrent", None, Q::Current),
        ("tau_1", None, Q::Torque),
        ("joint1.vel", None, Q::Rate),
        ("x_ref", Some("m"), Q::Reference),
        ("refined", None, Q::Unknown),
        ("u", None, Q::Drive),
        ("count", Some("inc"), Q::Other),
    ] {
        assert_eq!(Quantity::of(name, unit), quantity, "{name} {unit:?}");
    }
}

/// Templates that fit columns, with the columns that they take; the first line is the best fit.
fn taken(header: &str) -> Vec<String> {
    let mut text = format!("t_s,{header}\n");
    for n in 0..400 {
        write!(text, "{}", f64::from(n) * 0.01).expect("a text");
        for column in 0..header.split(',').count() {
            write!(text, ",{:.6}", (0.07 * f64::from(n) * (1.0 + column as f64)).sin()).expect("a text");
        }
        text.push('\n');
    }
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    let fitting = proposals(&inspect(file.path()).expect("a log"));
    let line = |proposal: &Proposal| {
        let columns: Vec<&str> = proposal.signals.iter().map(|placed| placed.column.as_str()).collect();
        let (name, text) = (proposal.template.name, proposal.model("Any"));
        assert!(DeclaredModel::parse("any.tpm", &text).is_ok(), "{text}");
        format!("{name}: {}", columns.join(" "))
    };
    fitting.iter().map(line).collect()
}

#[test]
fn positions_and_inputs_are_taken_by_quantity_before_place() {
    assert_eq!(taken("q_m,u_V,force_N,spare")[0], "spring: q_m force_N");
    assert_eq!(taken("x,v,u")[0], "spring: x u");
    assert!(taken("u_V,y_V").is_empty(), "a voltage is no position");
    assert_eq!(taken("phi,i")[0], "motor: phi i");
    assert_eq!(taken("x_ref,x,u_ff,u")[0], "spring: x u");
    assert_eq!(taken("a,b")[0], "spring: a b");
    assert_eq!(taken("cart [m],pole [deg],u [N]")[0], "cart_pole: cart [m] pole [deg] u [N]");
    assert_eq!(taken("motor [deg],load [deg],i [A]")[0], "two_masses: motor [deg] load [deg] i [A]");
    assert_eq!(taken("n [rpm],I [A]"), ["motor: n [rpm] I [A]"]);
    assert_eq!(taken("v [m/s],F [N]"), ["slider: v [m/s] F [N]"]);
    assert_eq!(
        taken("motor_speed [rad/s],load_speed [rad/s],torque [Nm]")[0],
        "two_masses: motor_speed [rad/s] load_speed [rad/s] torque [Nm]"
    );
    assert!(taken("x [m],v [m/s]").is_empty(), "nothing moves it");
    assert!(taken("u [V],temp [K]").is_empty(), "nothing is moved");
}
