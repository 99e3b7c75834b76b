//! Logs of two coordinates whose truth is known: what no row shows, and what the model lacks.

use crate::log::{LogRequest, from_log, from_logs};
use crate::model::DeclaredModel;
use crate::warning::Warning;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use std::fmt::Write;
use tpm_controller::harmonics::Hold;
use tpm_estimate::Status;

const SAMPLE_TIME: f64 = 1e-3;
/// Steps of the integration in a sample.
const STEPS: u32 = 4;

/// A log of a machine of two coordinates and one held input: `rates` are those of its states, of which `read` makes the two readings.
fn log<const N: usize>(
    header: &str,
    samples: usize,
    rates: impl Fn([f64; N], f64) -> [f64; N],
    input: impl Fn(f64) -> f64,
    read: impl Fn([f64; N], &mut dyn FnMut() -> f64) -> [f64; 2],
) -> String {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let mut draw = move || -> f64 { StandardNormal.sample(&mut rng) };
    let mut text = format!("{header}\n");
    let mut state = [0.0; N];
    for i in 0..samples {
        let t = i as f64 * SAMPLE_TIME;
        let u = input(t);
        let [a, b] = read(state, &mut draw);
        writeln!(text, "{t:.3},{a:.9e},{b:.9e},{u:.9e}").expect("a string takes everything");
        for _ in 0..STEPS {
            let h = SAMPLE_TIME / f64::from(STEPS);
            let along = |by: f64, slope: [f64; N]| std::array::from_fn(|j| state[j] + by * h * slope[j]);
            let first = rates(state, u);
            let second = rates(along(0.5, first), u);
            let third = rates(along(0.5, second), u);
            let last = rates(along(1.0, third), u);
            let mean = std::array::from_fn(|j| (first[j] + 2.0 * second[j] + 2.0 * third[j] + last[j]) / 6.0);
            state = along(1.0, mean);
        }
    }
    text
}

/// A motor under a voltage of sines of these frequencies, of which speed and current are measured.
fn motor(frequencies: &[f64]) -> (String, [f64; 6]) {
    let [j, b, kt, r, l, ke] = [2e-5, 1e-5, 0.03, 1.5, 2e-3, 0.03];
    let text = log(
        "t_s,w,i,u",
        4000,
        |[w, i], u| [(kt * i - b * w) / j, (u - r * i - ke * w) / l],
        |t| frequencies.iter().map(|f| 1.5 * (2.0 * PI * f * t + f * f).sin()).sum(),
        |[w, i], draw| [w + 0.05 * draw(), i + 0.002 * draw()],
    );
    (text, [j, b, kt, r, l, ke])
}

/// What the hold of an input does looks like a delay by half a sample; which of the two it is, the other hold shows.
#[test]
fn an_input_that_is_held_is_not_said_to_be_late_alone() {
    let (text, _) = motor(&[0.7, 2.3, 7.1, 19.0, 41.0, 90.0]);
    let model = DeclaredModel::parse(
        "Motor",
        "model Motor { coordinate w [rad/s], i [A]; input u [V];
        parameter j [s^2*A/rad], b [A*s/rad], R [ohm], L [H], Ke [V*s/rad];
        j*dot(w) + b*w - i = 0; L*dot(i) + R*i + Ke*w = u; }",
    )
    .expect("a model");
    for hold in [Hold::None, Hold::Zoh] {
        let request = LogRequest::of_bytes("log.csv", std::sync::Arc::new(text.clone().into_bytes())).hold(hold);
        let result = from_log(&model, request).expect("identifies");
        let told = |warning: &Warning| {
            matches!(
                warning,
                Warning::LateByHold { better: Hold::Zoh, .. } | Warning::OtherHold { better: Hold::Zoh, .. }
            )
        };
        assert_eq!(result.warnings.iter().any(told), hold == Hold::None, "{result}");
    }
}

/// The torque constant of a motor stands beside its inertia and its friction in a row without an input: it shows their ratios alone.
#[test]
fn a_row_without_an_input_shows_no_scale() {
    let (text, [j, b, kt, ..]) = motor(&[0.7, 2.3, 7.1, 19.0]);
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), &text).expect("written");
    let model = DeclaredModel::parse(
        "Motor",
        "model Motor { coordinate w [rad/s], i [A]; input u [V];
        parameter J [kg*m^2], b [N*m*s/rad], Kt [N*m/A], R [ohm], L [H], Ke [V*s/rad];
        J*dot(w) + b*w - Kt*i = 0; L*dot(i) + R*i + Ke*w = u; }",
    )
    .expect("a model");
    for hold in [Hold::None, Hold::Zoh] {
        let result = from_log(&model, LogRequest::new(file.path()).hold(hold)).expect("identifies");
        assert_eq!(result.rank, 5, "{hold}");
        for own in &result.parameters {
            let free = ["J", "b", "Kt"].contains(&own.name.as_str());
            assert_eq!(own.status == Status::Unobservable, free, "{hold}: {own:?}");
        }
        assert!(result.shortfall.is_some(), "{hold}");
        let ratios: Vec<(&str, f64, f64)> = (result.combinations.iter())
            .filter_map(|own| own.product.as_ref().map(|ratio| (ratio.name.as_str(), ratio.value, own.std)))
            .collect();
        let [(inertia, found, std), (friction, other, other_std)] = ratios[..] else { panic!("{hold}: {result}") };
        assert_eq!((inertia, friction), ("J/Kt", "b/Kt"), "{hold}");
        assert!((found - j / kt).abs() < 3.5 * std && std < 0.05 * found, "{hold}: {result}");
        assert!((other - b / kt).abs() < 3.5 * other_std, "{hold}: {result}");
    }
    // The ratios of two records differ by their noise, which is no knowledge of the scale.
    let parts = [0..2001, 2001..4001].map(|lines| {
        let lines = text.lines().enumerate().filter(|(at, _)| *at == 0 || lines.contains(at));
        let part: String = lines.map(|(_, line)| format!("{line}\n")).collect();
        LogRequest::of_bytes("part.csv", std::sync::Arc::new(part.into_bytes())).hold(Hold::Zoh)
    });
    let together = from_logs(&model, parts).expect("identifies");
    assert_eq!(together.rank, 5, "{together}");
    let found = together.combinations.iter().find(|own| own.product.as_ref().is_some_and(|ratio| ratio.name == "J/Kt"));
    let found = found.unwrap_or_else(|| panic!("{together}"));
    let value = found.product.as_ref().map_or(0.0, |ratio| ratio.value);
    assert!((value - j / kt).abs() < 3.5 * found.std, "{together}");
}

/// Dry friction of a load that no input drives is named, and the other parameters come out as they are.
#[test]
fn friction_that_a_belt_lacks_is_named() {
    let [m1, m2, k, c, d1, d2, f2] = [0.9, 1.5, 6000.0, 6.0, 2.0, 3.0, 1.2];
    let reference =
        |t: f64| [1.0, 2.0, 3.0].map(|n: f64| 0.03 / n * (2.0 * PI * 0.5 * n * t + n).sin()).iter().sum::<f64>();
    let text = log(
        "t_s,x,y,u",
        8000,
        |[x, y, v, w], u| {
            let pull = k * (x - y) + c * (v - w);
            [v, w, (u - pull - d1 * v) / m1, (pull - d2 * w - f2 * (w / 1e-3).tanh()) / m2]
        },
        |t| 400.0 * reference(t),
        |[x, y, ..], draw| [x + 1e-7 * draw(), y + 1e-7 * draw()],
    );
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    let model = DeclaredModel::parse(
        "Belt",
        "model Belt { coordinate x [m], y [m]; input u [N];
        parameter m1 [kg], m2 [kg], k [N/m], c [N*s/m], d1 [N*s/m], d2 [N*s/m];
        m1*ddot(x) + k*(x - y) + c*(dot(x) - dot(y)) + d1*dot(x) = u;
        m2*ddot(y) + k*(y - x) + c*(dot(y) - dot(x)) + d2*dot(y) = 0; }",
    )
    .expect("a model");
    let result = from_log(&model, LogRequest::new(file.path()).hold(Hold::Zoh)).expect("identifies");
    let named = result.warnings.iter().find_map(|warning| match warning {
        Warning::MissingTerm { term } if term.term == "sign(dot(y))" => Some(term),
        _ => None,
    });
    let named = named.unwrap_or_else(|| panic!("{:?}", result.warnings));
    assert!((named.value - f2).abs() < 0.05 * f2 && named.gain > 0.9, "{named:?}");
}

/// A wheel in an integrating speed loop that a hand holds back: the loop answers the hand, so that no values explain both, and the model says
/// less of the next reading than the last one does.
#[test]
fn a_load_that_the_model_lacks_leaves_no_result() {
    let [a, b, c] = [0.02, 0.2, 20.0];
    for (count, load) in [(0.1, 60.0), (16.7, 60.0), (16.7, 40.0)] {
        let [mut speed, mut command] = [0.0_f64; 2];
        let mut text = String::from("t_s,w,u\n");
        for i in 0..480 {
            let t = 0.011 * f64::from(i);
            let read = (speed / count).round() * count;
            command = (command + 0.02 * (300.0 - read)).clamp(0.0, 255.0);
            writeln!(text, "{t:.3},{read:.2},{command:.0}").expect("a string takes everything");
            let hand = if (1.3..1.8).contains(&t) || (2.7..3.2).contains(&t) { load } else { 0.0 };
            for _ in 0..110 {
                let left = command - b * speed;
                speed = (speed + 1e-4 * (left - c - hand) / a).max(0.0);
            }
        }
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        let model = DeclaredModel::parse(
            "Wheel",
            "model Wheel { coordinate w [rad/s]; input u [V]; parameter a [V*s^2/rad], b [V*s/rad], c [V];
            a*dot(w) + b*w + c*sign(w) = u; }",
        )
        .expect("a model");
        let result = from_log(&model, LogRequest::new(file.path()).hold(Hold::Zoh)).expect("identifies");
        assert!(result.shortfall.is_some(), "{count} {load}: {:?}", result.warnings);
        assert!(result.parameters.iter().all(|own| own.status != Status::Identified), "{count} {load}");
    }
}

/// The size of a speed, as a sensor of pulses without a direction tells it. Noise of the current explains any motion of a motor without
/// inertia, and explained this one.
#[test]
fn a_speed_without_its_sign_is_no_result() {
    let [j, b, c] = [2e-4, 3e-4, 0.012];
    let text = log(
        "t_s,w,spare,i",
        6000,
        |[w], i| [(0.05 * i - b * w - c * (w / 0.1).tanh()) / j],
        |t| [(1.2, 0.7, 0.0), (0.8, 1.9, 1.0)].iter().map(|(a, f, p)| a * (2.0 * PI * f * t + p).sin()).sum(),
        |[w], draw| [w.abs() + 0.05 * draw(), 0.0],
    );
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    let model = DeclaredModel::parse(
        "motor",
        "model Motor { coordinate w [rad/s]; input i [A];
        parameter J [kg*m^2], b [N*m*s/rad], c [N*m]; constant kt = 0.05 [N*m/A];
        J*dot(w) + b*w + c*sign(w) = kt*i; }",
    )
    .expect("a model");
    let result = from_log(&model, LogRequest::new(file.path())).expect("identifies");
    assert!(result.parameters.iter().all(|own| own.status != Status::Identified), "{result}");
    assert!(result.shortfall().is_some(), "{result}");
}
