//! `tpm pendulum-study`: the rotary pendulum of Fong, from its energies to its balance, as one report.
//!
//! Nothing is computed here that the library does not offer to every machine; what is here is the order of the steps, what is
//! compared with the paper, and the report.

mod balance;
mod linear;
mod machine;
mod markdown;
mod patterns;
mod response;

use crate::failure::Failure;
use crate::input::experiment::SimulatedArgs;
use crate::input::values::ValueArgs;
use crate::output::{file, progress};
use crate::{Outcome, interrupt};
use machine::Machine;
use std::path::PathBuf;
use tpm_runtime::plot::Figure;

/// Pixels of a PNG per pixel of the figure.
const ZOOM: f32 = 1.5;

/// Options of `tpm pendulum-study`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The pendulum upright (Fong, Eqn 3).
    #[arg(long, value_name = "FILE", default_value = "models/rotary_pendulum.tpm")]
    upright: PathBuf,
    /// The pendulum hanging down (Fong, Eqn 26); its experiment stands beside it.
    #[arg(long, value_name = "FILE", default_value = "models/rotary_pendulum_down.tpm")]
    down: PathBuf,
    /// Values of the parameters and constants (Fong, Table 1).
    #[arg(long, value_name = "FILE", default_value = "models/rotary_pendulum_table1.toml")]
    params: PathBuf,
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

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if !(args.duration.is_finite() && (70.0..=3600.0).contains(&args.duration)) {
        return Err(Failure::Input(format!(
            "--duration {}: two halves of at least one segment of 32.8 s each are needed, so give 70 to 3600 s",
            args.duration
        )));
    }
    let values = ValueArgs::file(&args.params);
    let upright = Machine::load(&args.upright, &values)?;
    let down = Machine::load(&args.down, &values)?;
    let simulated = SimulatedArgs { experiment: None, set: Vec::new(), pattern: None };
    let simulation = simulated.prepare_with(&args.down, |experiment| {
        experiment.plant.parameters = down.values(&down.prepared.model.parameters().collect::<Vec<_>>());
        experiment.constants = down.values(&down.prepared.model.run_time_constants().collect::<Vec<_>>());
    })?;

    let bar = progress::Bar::new("studying");
    // In steps of an identification with a balance; the frequency responses take about as long as four.
    let steps = u64::from(args.seeds) + 4;
    let linear = linear::chapter(&upright, &down)?;
    let response = response::chapter(&down, args.duration)?;
    bar.set(4, steps);
    let (identified, interrupted) = interrupt::watched(|go_on| {
        let step = |ended: u32| {
            bar.set(u64::from(ended) + 4, steps);
            go_on()
        };
        (patterns::Identified::run(&down, &simulation, args.seeds, &step), !go_on())
    });
    drop(bar);
    if interrupted {
        return Err(Failure::Interrupted);
    }
    let identified = identified?;
    let patterns = identified.chapter(&down);
    let (balance, failed) = balance::chapter(&upright, &simulation, &identified)?;

    std::fs::create_dir_all(&args.output).map_err(|error| Failure::write(&args.output, error))?;
    let mut text = String::from(
        "# The rotary inverted pendulum\n\nDerived, linearised, measured, fitted, identified and balanced, after T. Teng Fong, \
         Z. Jamaludin, L. Abdullah, *System Identification and Modelling of Rotary Inverted Pendulum*. The machine is simulated from \
         the equations of motion (Eqn 3 and Eqn 26, derived from the energies) with Table 1. Repeat it with `tpm pendulum-study`.\n",
    );
    let mut findings = Vec::new();
    for chapter in [linear, response, patterns, balance] {
        text.push('\n');
        text.push_str(&chapter.text);
        findings.extend(chapter.findings);
        for (name, figure) in chapter.figures {
            let drawn = |error: tpm_runtime::plot::PlotError| Failure::Input(format!("{name}: {error}"));
            let svg = figure.svg().map_err(drawn)?;
            file::write_file(&args.output.join(format!("{name}.svg")), svg.as_bytes())?;
            file::write_file(&args.output.join(format!("{name}.png")), &figure.png(ZOOM).map_err(drawn)?)?;
        }
    }
    text.push_str("\n## What agrees with the paper, and what does not\n\n");
    for finding in &findings {
        text.push_str(&format!("- {finding}\n"));
    }
    let report = args.output.join("report.md");
    file::write_file(&report, text.as_bytes())?;
    file::print(&format!("{}\n\nreport: {}\n", findings.join("\n"), report.display()))?;
    match (identified.incomplete(), failed) {
        (0, 0) => Ok(()),
        (identification, balance) => Err(Failure::Incomplete(format!(
            "{identification} of {0} identifications are incomplete, {balance} of {0} balances failed",
            args.seeds
        ))),
    }
}
