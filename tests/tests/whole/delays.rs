//! Inputs that act later than they are recorded, by a time that is known or found.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::log::Samples;
use tpm_runtime::motion::{Dynamics, LowPass};
use tpm_runtime::session::{DeclaredModel, Identification, LogRequest, Warning, from_log};

const MODEL: &str = "model Cart { coordinate x [m]; input u [N]; parameter m [kg], c [N*s/m], k [N/m];
    m*ddot(x) + c*dot(x) + k*x = u; }";
const TRUTH: [(&str, f64); 3] = [("m", 2.0), ("c", 3.0), ("k", 40.0)];
const STEP: f64 = 2e-3;
const NOISE: f64 = 1e-5;
/// Steps of the integration in a sample, on whose ends a delay of tenths of a sample falls.
const STEPS: usize = 20;

/// Twenty seconds of the cart under a held command that acts behind known dynamics; commands repeat after four seconds, or never.
fn samples(dynamics: Dynamics, repeats: bool) -> Samples {
    as_samples(series(dynamics, repeats))
}

/// Times, readings and commands as a log.
fn as_samples([time, x, u]: [Vec<f64>; 3]) -> Samples {
    Samples::new(vec![("t_s".into(), time), ("x".into(), x), ("u".into(), u)])
}

/// Times, readings and commands of [`samples`].
fn series(dynamics: Dynamics, repeats: bool) -> [Vec<f64>; 3] {
    let mut normal = ChaCha8Rng::seed_from_u64(11);
    let count = 10_000;
    let base = if repeats { 0.25 } else { 0.2371 };
    let waves: Vec<(f64, f64)> = [1.0, 3.0, 5.0, 9.0, 14.0]
        .iter()
        .enumerate()
        .map(|(i, own)| {
            (2.0 * std::f64::consts::PI * base * (own + if repeats { 0.0 } else { 0.31 * i as f64 }), i as f64)
        })
        .collect();
    let command = |n: isize| -> f64 {
        let t = n as f64 * STEP;
        waves.iter().map(|(w, phase)| 6.0 * (w * t + phase).sin()).sum()
    };
    let [m, c, k] = TRUTH.map(|(_, value)| value);
    let (mut q, mut v) = (0.0, 0.0);
    let (mut value, mut rate) = (0.0, 0.0);
    let (mut time, mut x, mut u) = (Vec::new(), Vec::new(), Vec::new());
    let h = STEP / STEPS as f64;
    let settling = 6000;
    for n in -settling..count {
        if n >= 0 {
            time.push(n as f64 * STEP);
            let noise: f64 = StandardNormal.sample(&mut normal);
            x.push(q + NOISE * noise);
            u.push(command(n));
        }
        for s in 0..STEPS {
            let t = n as f64 + (s as f64 + 0.5) / STEPS as f64 - dynamics.delay / STEP;
            let held = command(t.floor() as isize);
            let force = |value: f64| if dynamics.filter.is_some() { value } else { held };
            let slopes = |[q, v, value, rate]: [f64; 4]| {
                let (dv, dr) = dynamics.filter.map_or((0.0, 0.0), |filter| filter.rates(held, value, rate));
                [v, (force(value) - c * v - k * q) / m, dv, dr]
            };
            let at = [q, v, value, rate];
            let beyond = |slope: [f64; 4], by: f64| std::array::from_fn(|i| at[i] + by * slope[i]);
            let a = slopes(at);
            let b = slopes(beyond(a, 0.5 * h));
            let c = slopes(beyond(b, 0.5 * h));
            let d = slopes(beyond(c, h));
            let next: [f64; 4] = std::array::from_fn(|i| at[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
            [q, v, value, rate] = next;
        }
    }
    [time, x, u]
}

fn identified(samples: Samples, change: impl FnOnce(&mut LogRequest)) -> Identification {
    let model = DeclaredModel::parse("cart", MODEL).expect("a model");
    let mut request = LogRequest::of_samples("cart.csv", samples).hold(Hold::Zoh);
    change(&mut request);
    from_log(&model, request).expect("identifies")
}

/// Values that are within four deviations of the truth, with their deviations.
fn deviations(result: &Identification) -> Vec<f64> {
    let of = |(name, truth): (&str, f64)| {
        let own = result.parameters.iter().find(|own| own.name == name).expect("a parameter");
        let (value, std) = own.value.zip(own.std).expect("a value");
        assert!((value - truth).abs() < 4.0 * std, "{name}: {value} +- {std}, {result}");
        std
    };
    TRUTH.map(of).to_vec()
}

#[test]
fn a_known_delay_or_low_pass_is_simulated_as_well_as_none() {
    let filter = Some(LowPass { natural_frequency: 150.0, quality: 0.8 });
    for repeats in [true, false] {
        let plain = identified(samples(Dynamics::default(), repeats), |_| ());
        let ideal = deviations(&plain);
        for dynamics in [
            Dynamics { delay: 2.3 * STEP, ..Dynamics::default() },
            Dynamics { delay: 0.4 * STEP, filter, bandwidth: None },
        ] {
            let known = |request: &mut LogRequest| {
                request.estimation.actuators.insert("u".into(), dynamics);
            };
            let result = identified(samples(dynamics, repeats), known);
            let refined = result.log.as_ref().and_then(|log| log.refinement.as_ref()).is_some_and(|own| own.used);
            assert!(refined && result.is_complete(), "{dynamics:?} {result}");
            let named = result.warnings.iter().find(|own| matches!(own, Warning::MissingTerm { .. }));
            assert!(named.is_none(), "{named:?}");
            for (own, ideal) in deviations(&result).iter().zip(&ideal) {
                assert!((0.7..1.4).contains(&(own / ideal)), "{dynamics:?}: {own} {ideal}");
            }
        }
    }
}

#[test]
fn a_delay_is_found_with_the_parameters() {
    for repeats in [true, false] {
        let delay = 2.3 * STEP;
        let dynamics = Dynamics { delay, ..Dynamics::default() };
        let fit = |request: &mut LogRequest| {
            request.estimation.fitted_delays.insert("u".into());
        };
        let late = identified(samples(dynamics, repeats), fit);
        let own = late.log.as_ref().and_then(|log| log.actuators.get("u")).expect("a delay");
        let std = own.delay_std.expect("found");
        assert!((own.delay - delay).abs() < 4.0 * std && std < 2e-5, "{own:?}");
        deviations(&late);
        assert!(late.is_complete(), "{late}");
        assert!(late.to_string().contains("found with the parameters"), "{late}");
        let none = identified(samples(Dynamics::default(), repeats), fit);
        let own = none.log.as_ref().and_then(|log| log.actuators.get("u")).expect("said");
        let std = own.delay_std.expect("a delay is a parameter of the fit, be it nothing");
        assert!(own.fitted && own.delay.abs() < 4.0 * std && std < 2e-5, "{own:?}");
        deviations(&none);
    }
}

#[test]
fn a_delay_that_noise_hides_lies_within_its_deviation() {
    let delay = 2.5 * STEP;
    let exact = series(Dynamics { delay, ..Dynamics::default() }, true);
    for seed in 0..6 {
        let mut normal = ChaCha8Rng::seed_from_u64(seed);
        let mut log = exact.clone();
        for (values, noise) in log.iter_mut().skip(1).zip([2e-4, 0.05]) {
            for value in values {
                let own: f64 = StandardNormal.sample(&mut normal);
                *value += noise * own;
            }
        }
        let result = identified(as_samples(log), |request| {
            request.estimation.fitted_delays.insert("u".into());
        });
        let own = result.log.as_ref().and_then(|log| log.actuators.get("u")).expect("a delay");
        let std = own.delay_std.expect("found");
        assert!((own.delay - delay).abs() < 4.0 * std && std < 2e-4, "{seed}: {own:?}");
        deviations(&result);
        assert!(result.is_complete() && result.warnings.is_empty(), "{result}");
    }
}
