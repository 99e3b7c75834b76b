//! Cart and pendulum with motors (D. Feng, chapter 6 and appendix C): the two parts of the forces, both feed-forwards, cut-off
//! frequencies.

use super::Chapter;
use super::failure::Failure;
use super::input::Input;
use super::markdown::table;
use super::page::formula;
use std::f64::consts::TAU;
use tpm_runtime::model::Model as _;
use tpm_runtime::physical::MotorizedMachine;
use tpm_runtime::plant::actuator::{Amplifier, Drive, Limits, LoopFile, Motor, Tracking, tracking_errors};
use tpm_runtime::report::number;
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::plan::split::split;

/// Number of configurations along the reference at which the loop is linearised.
const CONFIGURATIONS: usize = 16;
/// Harmonics of Eqn 6.2 that are compared.
const HARMONICS: [usize; 3] = [1, 3, 5];
/// Samples of a period for these harmonics.
const SAMPLES: usize = 64;
/// Amplitude of the pendulum for Eqns 6.2 and 6.3, rad, at w = 1 rad/s.
const SWING: f64 = 0.6;
/// Mass at the end of the pendulum, kg, and its length, m (Feng, section 6.3).
const MASS: f64 = 1.0;
const LENGTH: f64 = 0.4;

fn fault(error: &dyn std::fmt::Display) -> Failure {
    Failure::Input(format!("cart and pendulum: {error}"))
}

/// The motor of section 6.3 on an axis that turns `ratio` times as fast as the coordinate.
fn motor(ratio: f64) -> Motor {
    Motor {
        torque_constant: 0.115,
        back_emf: 0.115,
        resistance: 4.0,
        inductance: 7.7e-3,
        rotor_inertia: 0.35e-4,
        ratio,
        limits: Limits { current: 12.3, voltage: 50.0, power: 600.0 },
        amplifier: Amplifier { bandwidth: f64::INFINITY, filter: None },
    }
}

/// The amplitude of cos(k w t) in samples of one period.
fn cosine(samples: &[f64], harmonic: usize) -> f64 {
    let count = samples.len();
    let wave = |n: usize| (TAU * (n * harmonic % count) as f64 / count as f64).cos();
    samples.iter().enumerate().map(|(n, value)| 2.0 / count as f64 * value * wave(n)).sum()
}

pub(super) fn chapter() -> Result<Chapter, Failure> {
    let file = Input::shipped("cart_pendulum.tpm", include_str!("../../../models/cart_pendulum.tpm"));
    let (_, parsed) = file.model()?;
    let model = &parsed.model;
    let values: toml::Table = include_str!("../../../models/cart_pendulum_example.toml")
        .parse()
        .map_err(|error: toml::de::Error| fault(&error))?;
    let of = |symbol: Symbol| {
        let value = values.get(model.quantity(symbol).name.as_str())?;
        value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
    };
    let mut parts = split(model, &[]).map_err(|error| fault(&error))?;
    let pattern = model.pattern(None).ok_or_else(|| fault(&"no pattern"))?;
    let machine = MotorizedMachine::new(&parts, pattern, of).map_err(|error| fault(&error))?;

    // Eqns 6.4 to 6.7.
    let mut rows = Vec::new();
    let printed =
        [["m L (theta'' cos theta - theta'^2 sin theta)", "(M + m) x''"], ["m L x'' cos theta", "m L^2 theta''"]];
    for (input, printed) in parts.inputs.clone().iter().zip(printed) {
        let name = parts.model.quantity(input.input).name.to_string();
        for ((label, part), printed) in
            [("independent", &input.independent), ("dependent", &input.dependent)].into_iter().zip(printed)
        {
            let expr = parts.expression(part);
            rows.push(vec![
                name.clone(),
                format!("motion-{label}"),
                formula(&parts.model.display(expr)),
                formula(printed),
            ]);
        }
    }
    let both = table(&["input", "part", "computed", "printed"], &rows);

    // Eqns 6.2 and 6.3: the cart stands, the pendulum swings.
    let dims = machine.model().dims();
    let theta = (0..dims.coordinates).find(|&c| machine.model().coordinate(c).name == "theta");
    let theta = theta.ok_or_else(|| fault(&"no coordinate theta"))?;
    let mut motions = vec![0.0; SAMPLES * dims.motion_len()];
    for (n, motion) in motions.chunks_exact_mut(dims.motion_len()).enumerate() {
        let angle = TAU * n as f64 / SAMPLES as f64;
        for order in 0..=dims.order {
            motion[order * dims.coordinates + theta] = SWING * (angle + order as f64 * TAU / 4.0).cos();
        }
    }
    let forces = machine.demand().whole(&motions).map_err(|error| fault(&error))?;
    let of_input = |input: usize| forces.iter().skip(input).step_by(dims.inputs).copied().collect::<Vec<f64>>();
    let bracket: Vec<f64> = (0..SAMPLES)
        .map(|n| {
            let (sin, cos) = (TAU * n as f64 / SAMPLES as f64).sin_cos();
            let theta = SWING * cos;
            cos * theta.cos() + SWING * sin * sin * theta.sin()
        })
        .collect();
    let mut swing = Vec::new();
    for harmonic in HARMONICS {
        let bracket = SWING * MASS * LENGTH * cosine(&bracket, harmonic);
        swing.push(vec![
            format!("F, cos {harmonic} w t [N]"),
            number(cosine(&of_input(0), harmonic)),
            number(4.0 * bracket),
            number(-bracket),
        ]);
    }
    swing.push(vec![
        "tau, cos w t [N m]".to_owned(),
        number(cosine(&of_input(1), 1)),
        number(-SWING * MASS * LENGTH),
        number(-SWING * MASS * LENGTH * LENGTH),
    ]);
    let swing = table(&["", "computed", "as printed", "with -a m L, and L^2"], &swing);

    // Figure 6.5.
    let loops =
        LoopFile::parse(include_str!("../../../models/cart_pendulum_loop.toml")).map_err(|error| fault(&error))?;
    let settle = loops.settle_periods().map_err(|error| fault(&error))?;
    let amplitudes: Vec<f64> = pattern.amplitudes.iter().map(|&symbol| of(symbol).unwrap_or(f64::NAN)).collect();
    let trajectory = machine.trajectory(&amplitudes, of(pattern.frequency).unwrap_or(f64::NAN));
    let demand = machine.demand();
    let tracked = |split: bool| -> Result<Tracking, Failure> {
        let scheme = loops.scheme(machine.model(), split).map_err(|error| fault(&error))?;
        let drive = Drive::new(&demand, machine.parameters(), &[], &scheme);
        let poles = drive.stability(&trajectory, CONFIGURATIONS).map_err(|error| fault(&error))?;
        drive.track(&trajectory, settle, &poles).map_err(|error| fault(&error))
    };
    let (common, divided) = (tracked(false)?, tracked(true)?);
    let names: Vec<String> = (0..dims.coordinates).map(|c| machine.model().coordinate(c).to_string()).collect();
    let figure = tracking_errors("Errors with both feed-forwards (Feng, Figure 6.5)", &common, &divided, &names);
    let errors: Vec<Vec<String>> = names
        .iter()
        .enumerate()
        .map(|(c, name)| {
            let of = |found: &Tracking| [number(found.rms[c]), number(found.peak[c])];
            [vec![name.clone()], of(&common).to_vec(), of(&divided).to_vec()].concat()
        })
        .collect();
    let errors = table(&["error of", "common, rms", "common, peak", "split, rms", "split, peak"], &errors);

    // Eqns C.12 and C.13.
    let bare = motor(1.0);
    let cut_off = |name: &str, lambda: f64, inertia: f64| {
        let w = bare.cut_off(lambda, inertia);
        let wrong = (bare.inductance * bare.limits.current + bare.back_emf * lambda) * w;
        vec![
            name.to_owned(),
            number(w),
            number(bare.cut_off_voltage(lambda, inertia)),
            number((bare.limits.current * bare.resistance).hypot(wrong)),
        ]
    };
    let (radius, gear) = (0.02_f64, 20.0_f64);
    let motors = table(
        &["motor of", "cut-off C.12 [rad/s]", "its voltage [V]", "C.13 as printed [V]"],
        &[
            cut_off("the cart, lambda = 5 rad", 0.1 / radius, bare.rotor_inertia + (10.0 + MASS) * radius * radius),
            cut_off(
                "the pendulum behind a gear of 20, lambda = 12 rad",
                SWING * gear,
                bare.rotor_inertia + MASS * LENGTH * LENGTH / (gear * gear),
            ),
            cut_off("the rotor alone, lambda = 1 rad", 1.0, bare.rotor_inertia),
        ],
    );
    let ratio = common.rms.first().copied().unwrap_or(f64::NAN) / divided.rms.first().copied().unwrap_or(f64::NAN);
    let text = format!(
        "## 6. Actuators (Feng, chapter 6 and appendix C)\n\nThe two parts of force and torque, Eqns 6.4 to 6.7:\n\n{both}\n\
         Eqns 6.2 and 6.3, the cart at rest and the pendulum at {SWING} cos(w t) rad, w = 1 rad/s, by the model along that motion:\n\n{swing}\n\
         Eqn 6.2 has the factor +4 a m L where -a m L is right, Eqn 6.3 lacks a square on L.\n\n\
         ![Figure 6.5: error of cart and pendulum over one period, settled](figure_6_5.svg)\n\n{errors}\n\
         Eqn 6.8 lacks its second cosine. With the feedback inside the low pass, as Figures 6.3 and 6.4 draw it, the pendulum's loop is \
         unstable; the figure is of a feedback outside. The error of the cart is smaller with the split feed-forward, as the thesis says; \
         that of the pendulum is not.\n\nAppendix C, motors of section 6.3:\n\n{motors}\nC.13 and C.16 add the back-EMF to the inductive \
         voltage where it opposes it; C.11 lost a sign, C.12, of amplitudes, stands.\n",
    );
    let finding = format!(
        "Figure 6.5 is reproduced: the split feed-forward makes the error of the cart {} times smaller (rms). Eqns 6.4 to 6.7 and C.12 agree; \
         6.2, 6.3, 6.8, C.11, C.13 and C.16 have slips.",
        number((ratio * 100.0).round() / 100.0)
    );
    Ok(Chapter { text, figures: vec![("figure_6_5", figure)], findings: vec![finding] })
}

#[cfg(test)]
mod tests {
    use super::chapter;

    #[test]
    fn the_split_feed_forward_makes_the_error_of_the_cart_three_times_smaller() {
        let found = chapter().expect("the shipped machine");
        assert!(found.findings[0].contains("3.26 times smaller"), "{:?}", found.findings);
    }
}
