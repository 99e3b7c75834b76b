//! Frequency response and structured fit of the rotary pendulum: how long they take, and the same data for other tools.
//!
//! ```text
//! frequency FOLDER    writes samples.csv and lines.csv, prints times and fitted values as JSON
//! ```
//!
//! 180 s at 1 kHz of the simulated pendulum hanging down (Fong, section 3.2), 2000 counts; H1 over segments of 32768 samples;
//! J1, J2, C1 and C2 from the lines between 0.2 and 23 Hz, started at 1.5 times their values in Table 1.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program whose result is its output")]

use std::error::Error;
use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;
use tpm_codegen::source::Source;
use tpm_runtime::frequency::{Excitation, FrequencyResponse, StructuredSettings, Welch, fit_structured};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::model::Model as _;
use tpm_runtime::physical::LinearizedResponse;
use tpm_runtime::plant::simulated::{Actuator, Rig, Sensor, drive};
use tpm_symbolic::expr::graph::{Coordinate, Symbol};
use tpm_symbolic::linear::linearize::{OperatingPoint, linearize};
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::prepare;

const SAMPLES: usize = 180_000;
const SAMPLE_TIME: f64 = 1e-3;
const SEGMENT: usize = 32_768;
const BAND: (f64, f64) = (0.2, 23.0);
const FITTED: [&str; 4] = ["J1", "J2", "C1", "C2"];
/// Fong, Table 1, with C2 = 3.168e-4.
const TABLE_1: [(&str, f64); 11] = [
    ("m2", 0.022),
    ("l1", 0.16),
    ("c2", 0.08),
    ("J1", 0.002_150_58),
    ("J2", 0.000_187_73),
    ("C1", 0.02),
    ("C2", 3.168e-4),
    ("Kb", 0.01826),
    ("Kt", 0.01826),
    ("Ku", 10.0),
    ("Rm", 2.5604),
];

fn main() -> ExitCode {
    let Some(folder) = std::env::args().nth(1) else {
        eprintln!("usage: frequency FOLDER");
        return ExitCode::from(2);
    };
    match run(Path::new(&folder)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(folder: &Path) -> Result<(), Box<dyn Error>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/rotary_pendulum_down.tpm");
    let source = Source::new("rotary_pendulum_down.tpm", &std::fs::read_to_string(path)?);
    let mut model = tpm_codegen::parse_model(&source).map_err(|faults| faults.render(&source))?.model;
    let prepared = prepare(model.clone())?;
    let interpreted = Interpreted::new(&prepared.model, &prepared.form);
    let value = |name: &str| TABLE_1.iter().find(|(known, _)| *known == name).map_or(f64::NAN, |(_, value)| *value);
    let of = |symbol: Symbol| value(&prepared.model.quantity(symbol).name);
    let bench = Rig {
        parameters: ParameterMap::new(&prepared).evaluate(of),
        constants: (0..interpreted.dims().constants).map(|i| value(interpreted.constant(i).name)).collect(),
        sensors: vec![Sensor { step: std::f64::consts::TAU / 2000.0, ..Sensor::default() }; 2],
        actuators: vec![Actuator::default()],
        sub_steps: 1,
        seed: 1,
    };
    let input = Excitation::Noise { std: 0.3, hold: 0.01, seed: 1 }.samples(SAMPLES, SAMPLE_TIME)?;
    let record = drive(&interpreted, &bench, SAMPLE_TIME, &[input])?;
    let (input, output) = (&record.inputs[0], &record.coordinates[1]);
    let welch = Welch::new(SEGMENT, Hold::Zoh);
    let response = FrequencyResponse::estimate(input, output, SAMPLE_TIME, &welch)?;
    let measuring = median_milliseconds(|| {
        let found = FrequencyResponse::estimate(black_box(input), black_box(output), SAMPLE_TIME, &welch);
        drop(black_box(found));
    });

    let linear = linearize(&mut model, &OperatingPoint::default())?;
    let parameters: Vec<Symbol> = model.parameters().collect();
    let inputs: Vec<Symbol> = model.inputs().collect();
    let constants: Vec<(Symbol, f64)> = model.run_time_constants().map(|symbol| (symbol, of(symbol))).collect();
    let linearized = LinearizedResponse::new(&model, &linear, Coordinate(1), inputs[0], &parameters, &constants)?;
    let names: Vec<&str> = parameters.iter().map(|&symbol| model.quantity(symbol).name.as_str()).collect();
    let start: Vec<f64> =
        names.iter().map(|name| value(name) * if FITTED.contains(name) { 1.5 } else { 1.0 }).collect();
    let settings = StructuredSettings {
        frozen: names.iter().map(|name| !FITTED.contains(name)).collect(),
        ..StructuredSettings::new(&start, BAND.0, BAND.1)
    };
    let fit = fit_structured(&response, &linearized, &settings)?;
    let fitting = median_milliseconds(|| {
        let found = fit_structured(black_box(&response), &linearized, &settings);
        drop(black_box(found));
    });

    let samples: String = input.iter().zip(output).map(|(u, y)| format!("{u},{y}\n")).collect();
    std::fs::write(folder.join("samples.csv"), samples)?;
    let usable = response.band(BAND.0, BAND.1).filter(|line| line.usable);
    let lines: String =
        usable.map(|line| format!("{},{},{},{}\n", line.frequency, line.h1.re, line.h1.im, line.std)).collect();
    std::fs::write(folder.join("lines.csv"), lines)?;
    let mut found = String::new();
    for name in FITTED {
        let at = names.iter().position(|own| *own == name).ok_or("a parameter is missing")?;
        write!(found, ", \"{name}\": {:e}", fit.parameters[at].value)?;
    }
    println!("{{\"h1_ms\": {measuring:.3}, \"fit_ms\": {fitting:.3}, \"lines\": {}{found}}}", fit.lines);
    Ok(())
}

/// The median of repetitions over a second, five at least.
fn median_milliseconds(mut work: impl FnMut()) -> f64 {
    let start = Instant::now();
    let mut times = Vec::new();
    while start.elapsed().as_secs_f64() < 1.0 || times.len() < 5 {
        let one = Instant::now();
        work();
        times.push(one.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
