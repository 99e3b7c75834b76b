//! Texts of random logs of a machine with one coordinate `x` and one input `u`, as loggers write them: in many dialects, with the faults
//! that logs have. Equal seeds give equal texts.

use super::random::Random;
use std::f64::consts::TAU;

/// What happens to the samples before they are written.
struct Faults {
    /// Largest random part of a time stamp, as a share of the sample time.
    jitter: f64,
    noise: f64,
    /// Step of the sensor; 0 for none.
    step: f64,
    /// The input is cut there.
    limit: f64,
    /// One sample in so many is left out, empty, no number, or written twice.
    rare: u64,
}

/// A number between 0 and 1.
fn share(random: &mut Random) -> f64 {
    random.below(1 << 20) as f64 / f64::from(1 << 20)
}

/// The text of one log.
pub(crate) fn text(random: &mut Random) -> String {
    let none = random.below(3) == 0;
    let mut some = |values: &[f64]| if none || random.below(4) > 0 { values[0] } else { *random.of(&values[1..]) };
    let faults = Faults {
        jitter: some(&[0.0, 1e-3, 0.3]),
        noise: some(&[0.0, 1e-6, 1e-3, 1.0]),
        step: some(&[0.0, 1e-3, 0.05]),
        limit: some(&[f64::INFINITY, 20.0, 2.0]),
        rare: some(&[0.0, 40.0, 5.0]) as u64,
    };
    // Most logs are plain: what is refused at its head shows little of the reader behind.
    let plain = random.below(4) > 0;
    let rows = if plain { *random.of(&[40, 60, 100]) } else { *random.of(&[0, 1, 2, 5, 20, 100, 300]) };
    let sample_time = *random.of(&[2e-3, 0.01, 0.05]);
    let periodic = random.below(2) == 0;
    let frequency =
        if periodic { TAU / (sample_time * *random.of(&[20.0, 40.0, 50.0])) } else { 3.0 + 20.0 * share(random) };
    let (amplitude, third) = (*random.of(&[0.0, 0.1, 1.0, 1e6]), share(random));

    let mut choice = |options: &[&'static str]| if plain { options[0] } else { *random.of(options) };
    let separator = choice(&[",", ",", ";", "\t", " "]);
    let end = choice(&["\n", "\n", "\r\n"]);
    let extra = choice(&["", "", "", "dot(x)", "spare"]);
    let decimal = if plain || separator == "," || random.below(4) > 0 { "." } else { "," };
    let (time, time_scale) = *random.of(&[
        ("t_s", 1.0),
        ("time", 1.0),
        ("t_ms", 1e3),
        ("t [ms]", 1e3),
        ("stamp_ns", 1e9),
        ("n", 1.0 / sample_time),
    ][..if plain { 3 } else { 6 }]);
    let (x, x_scale) = *random
        .of(&[("x", 1.0), ("x", 1.0), ("x [mm]", 1e3), ("\"x\"", 1.0), ("position", 1.0)][..if plain { 4 } else { 5 }]);
    let (u, u_scale) = *random
        .of(&[("u", 1.0), ("u", 1.0), ("u [N]", 1.0), ("u [kN]", 1e-3), ("force", 1.0)][..if plain { 4 } else { 5 }]);
    let digits = usize::try_from(2 + random.below(10)).expect("small");

    let mut text = String::new();
    if random.below(8) == 0 {
        text.push('\u{feff}');
    }
    if random.below(6) == 0 {
        text.push_str("# written by a logger");
        text.push_str(end);
    }
    let mut line = |fields: &[String]| {
        text.push_str(&fields.join(separator));
        text.push_str(end);
    };
    let head = [time, x, u, extra];
    let shown = if extra.is_empty() { 3 } else { 4 };
    line(&head[..shown].iter().map(ToString::to_string).collect::<Vec<_>>());
    for n in 0..rows {
        let t = f64::from(n) * sample_time;
        let (sine, cosine) = (frequency * t).sin_cos();
        let (sine3, cosine3) = (3.0 * frequency * t).sin_cos();
        let w = frequency;
        let position = amplitude * (cosine + third * cosine3);
        let velocity = -amplitude * w * (sine + 3.0 * third * sine3);
        let acceleration = -amplitude * w * w * (cosine + 9.0 * third * cosine3);
        let input = 2.0 * acceleration + 40.0 * position + 1.5 * velocity * velocity;
        let centred = share(random) - 0.5;
        let mut position = position + faults.noise * centred;
        if faults.step > 0.0 {
            position = (position / faults.step).round() * faults.step;
        }
        let input = input.clamp(-faults.limit, faults.limit);
        let stamp = t + faults.jitter * sample_time * (share(random) - 0.5);
        let values = [stamp * time_scale, position * x_scale, input * u_scale, velocity];
        let mut fields: Vec<String> =
            values[..shown].iter().map(|value| format!("{value:.digits$}").replace('.', decimal)).collect();
        if faults.rare > 0 && random.below(faults.rare) == 0 {
            let place = usize::try_from(random.below(shown as u64)).expect("small");
            match random.below(6) {
                0 => continue,
                1 => fields[place].clear(),
                2 => fields[place] = (*random.of(&["nan", "NaN", "inf", "-", "null", "1e400"])).to_owned(),
                3 => line(&fields),
                4 => drop(fields.pop()),
                _ => fields[place] = fields[0].clone(),
            }
        }
        line(&fields);
    }
    text
}
