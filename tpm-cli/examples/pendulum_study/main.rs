//! The rotary pendulum of Fong, from its energies to its balance, as one report:
//! `cargo run --release --example pendulum_study -- -o DIR`.
//!
//! The library offers every step to every machine; here stand the order of the steps, the comparison with the paper, and the
//! report. Exit codes: 0 done, 1 an identification or a balance failed, 2 bad input.

mod balance;
mod failure;
mod input;
mod linear;
mod machine;
mod markdown;
mod patterns;
mod response;
mod simulation;

use clap::Parser;
use failure::Failure;
use indicatif::{ProgressBar, ProgressStyle};
use input::Input;
use machine::Machine;
use simulation::Simulation;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tpm_runtime::plot::{DRAWS_PNG, Figure};

/// Pixels of a PNG per pixel of the figure.
const ZOOM: f32 = 1.5;

/// Study the rotary pendulum of Fong: derive, linearise, measure, fit, identify, balance, and report.
#[derive(Parser)]
struct Args {
    /// The pendulum upright (Fong, Eqn 3); the shipped rotary_pendulum.tpm when not given.
    #[arg(long, value_name = "FILE")]
    upright: Option<PathBuf>,
    /// The pendulum hanging down (Fong, Eqn 26), its experiment beside it in a .toml file; the shipped
    /// rotary_pendulum_down.tpm when not given.
    #[arg(long, value_name = "FILE")]
    down: Option<PathBuf>,
    /// Values of the parameters and constants, NAME = VALUE lines; Table 1 of Fong when not given.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Identifications, each with its noise, and balances with what they gave.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..))]
    seeds: u32,
    /// Length of the record for the frequency response, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 180.0)]
    duration: f64,
    /// Folder for report.md and its figures; made when it is not there.
    #[arg(short, long, value_name = "DIR", default_value = "pendulum-study")]
    output: PathBuf,
}

/// A chapter of the report.
struct Chapter {
    text: String,
    figures: Vec<(&'static str, Figure)>,
    /// What agrees with the paper, and what does not.
    findings: Vec<String>,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // A closed standard error is no reason to fail differently.
            let _ = writeln!(std::io::stderr(), "{}", failure.to_string().trim_end());
            ExitCode::from(failure.exit_code())
        }
    }
}

fn run(args: &Args) -> Result<(), Failure> {
    if !(args.duration.is_finite() && (70.0..=3600.0).contains(&args.duration)) {
        return Err(Failure::Input(format!(
            "--duration {}: two halves of at least one segment of 32.8 s each are needed, so give 70 to 3600 s",
            args.duration
        )));
    }
    let given =
        |path: &Option<PathBuf>, shipped: fn() -> Input| path.as_deref().map_or_else(|| Ok(shipped()), Input::read);
    let values = given(&args.params, Input::table_1)?;
    let upright = Machine::load(&given(&args.upright, Input::upright)?, &values)?;
    let down_file = given(&args.down, Input::down)?;
    let down = Machine::load(&down_file, &values)?;
    let experiment = given(&args.down.as_ref().map(|path| path.with_extension("toml")), Input::experiment)?;
    let simulation = Simulation::new(&experiment, &down, &down_file)?;

    // In steps of an identification with a balance; the frequency responses take about as long as four.
    let bar = progress(u64::from(args.seeds) + 4);
    let linear = linear::chapter(&upright, &down)?;
    let response = response::chapter(&down, args.duration)?;
    bar.inc(4);
    let identified = patterns::Identified::run(&down, &simulation, args.seeds, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let patterns = identified.chapter(&down);
    let (balance, failed) = balance::chapter(&upright, &simulation, &identified)?;
    report(&args.output, [linear, response, patterns, balance])?;
    match (identified.incomplete(), failed) {
        (0, 0) => Ok(()),
        (identification, balance) => Err(Failure::Incomplete(format!(
            "{identification} of {0} identifications are incomplete, {balance} of {0} balances failed",
            args.seeds
        ))),
    }
}

/// A bar on standard error; nothing is drawn where that is no terminal.
fn progress(steps: u64) -> ProgressBar {
    let bar = ProgressBar::new(steps).with_message("studying");
    match ProgressStyle::with_template("{msg} {bar:40} {percent} %, {eta} left") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Writes the chapters with their figures into a folder, and prints what was found.
fn report(folder: &Path, chapters: [Chapter; 4]) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(|error| Failure::write(&path, error))
    };
    let mut text = String::from(
        "# The rotary inverted pendulum\n\nDerived, linearised, measured, fitted, identified and balanced, after T. Teng Fong, \
         Z. Jamaludin, L. Abdullah, *System Identification and Modelling of Rotary Inverted Pendulum*. The machine is simulated from \
         the equations of motion (Eqn 3 and Eqn 26, derived from the energies) with Table 1. Repeat it with \
         `cargo run --release --example pendulum_study`.\n",
    );
    let mut findings = Vec::new();
    for chapter in chapters {
        text.push('\n');
        text.push_str(&chapter.text);
        findings.extend(chapter.findings);
        for (name, figure) in chapter.figures {
            let drawn = |error: tpm_runtime::plot::PlotError| Failure::Input(format!("{name}: {error}"));
            write(&format!("{name}.svg"), figure.svg().map_err(drawn)?.as_bytes())?;
            if DRAWS_PNG {
                write(&format!("{name}.png"), &figure.png(ZOOM).map_err(drawn)?)?;
            }
        }
    }
    text.push_str("\n## What agrees with the paper, and what does not\n\n");
    for finding in &findings {
        text.push_str(&format!("- {finding}\n"));
    }
    write("report.md", text.as_bytes())?;
    let path = folder.join("report.md");
    let said = writeln!(std::io::stdout(), "{}\n\nreport: {}", findings.join("\n"), path.display());
    match said {
        // A reader that went away (`| head`) is no failure.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::write(Path::new("standard output"), error))
        }
        _ => Ok(()),
    }
}
