//! `tpm`: the command line of the Trajectory Pattern Method tools.
//!
//! Files in, results out; every step of the work itself is a function of the libraries. Results go to standard output,
//! errors and progress to standard error. Exit codes: 0 done, 1 not everything asked for was identified (or, asked by
//! `generate --check`, is current), 2 bad input, 130 interrupted.

mod examples;
mod failure;
mod input;
mod interrupt;
mod memory;
mod output;
mod render;
mod verbs;

use crate::failure::{Failure, Outcome};
use crate::output::terminal;
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use std::process::ExitCode;
// The same numbers on every platform.
use tpm_elementary as _;
use tpm_symbolic::budget::{self, Budget};

/// Identify the parameters of a non-linear machine by the Trajectory Pattern Method.
#[derive(Parser)]
#[command(name = "tpm", version = env!("TPM_VERSION"), propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Take on models, tables and files however large they are; Ctrl-C ends what takes too long.
    #[arg(long, global = true)]
    allow_large: bool,
}

/// What the exit codes mean, at the end of every help.
const EXIT_CODES: &str =
    "Exit codes: 0 done, 1 printed but not everything asked for is there, 2 bad input, 130 interrupted";

/// The command line as it is told to users.
fn command() -> clap::Command {
    examples::with_examples(Cli::command(), "", EXIT_CODES)
}

#[derive(Subcommand)]
enum Command {
    /// Say whether motors can follow a pattern: current, voltage, power, and how fast and far they could.
    Actuator(Box<verbs::actuator::Args>),
    /// A campaign on a real machine: behind a program, or by files (what to play next, take in its log, result).
    Campaign(Box<verbs::campaign::Args>),
    /// Parse a model, check units, linearity and finiteness, and say what was found.
    Check(verbs::check::Args),
    /// Write the model with the forces that a result says it lacks.
    Complete(verbs::complete::Args),
    /// Print the completions of the command line for a shell.
    Completions(verbs::shell::CompletionArgs),
    /// Show it all in a minute: write a sample machine, record a log of it, identify from the log and write the report.
    Demo(verbs::demo::Args),
    /// Propose experiments that show the most within the limits.
    Design(Box<verbs::design::Args>),
    /// Write a log in another format: CSV, MCAP or Parquet.
    Convert(verbs::convert::Args),
    /// Compare two results of identifications: what changed, in their joint covariance.
    Compare(verbs::compare::Args),
    /// Make an input that excites a band of frequencies: noise, multisine or chirp, as a run to be played.
    Excite(verbs::excite::Args),
    /// Print the exact harmonic coefficient table of a model under its pattern.
    Expand(verbs::expand::Args),
    /// Say what a word of the model language, or a field of an experiment, motor or run file means.
    Explain(verbs::explain::Args),
    /// Write a model with identified values for another program: MuJoCo, CasADi, a PLC, Arduino.
    Export(verbs::export::Args),
    /// Compare common and split feed-forward on the simulated machine, with filters and motors.
    Feedforward(Box<verbs::feedforward::Args>),
    /// Fit a transfer function, or a model's parameters, to the frequency response of a log.
    Fit(Box<verbs::fit::Args>),
    /// Lay out model files: one statement to a line, comments below each other.
    Fmt(verbs::fmt::Args),
    /// Measure a frequency response from a log: H1, H2, coherence, confidence.
    Frf(verbs::frf::Args),
    /// Print the table of all flags, verb by verb.
    #[command(hide = true)]
    Flags,
    /// Print the reference of the model language.
    #[command(hide = true)]
    Language,
    /// Write the source code of a model's estimator.
    Generate(verbs::generate::Args),
    /// Say what a pattern can show: exact rank, unobservable directions, base parameters.
    Identifiability(verbs::identifiability::Args),
    /// Identify parameters: on a simulated plant, or from a log.
    Identify(Box<verbs::identify::Args>),
    /// Turn a robot description (URDF) into a model, with a prior and an experiment beside it.
    Import(verbs::import::Args),
    /// Give the links of an arm inertias that bodies can have, from its identified base parameters, and write them into its description.
    Inertias(verbs::inertias::Args),
    /// Begin: write a commented model and an experiment that run as they are.
    Init(verbs::init::Args),
    /// Look at a log before identifying: rates, gaps, noise, counts, periods, rests, clipping, delays, and what they mean.
    Inspect(Box<verbs::inspect::Args>),
    /// Linearise a model at rest: state space, transfer functions, poles and zeros.
    Linearize(Box<verbs::linearize::Args>),
    /// Serve an editor: faults while typing, what names mean, completion, layout, by the language server protocol.
    Lsp(verbs::lsp::Args),
    /// Write manual pages into a folder.
    Man(verbs::shell::ManArgs),
    /// Find the mass, the centre and the inertia of a load from two results, without and with it.
    Payload(verbs::payload::Args),
    /// Give parameters of one model in those of another, either way: the nearest by their forces along a motion.
    Project(verbs::project::Args),
    /// Design a regulator about an equilibrium: gains, poles, margins, and its code in C or Rust.
    Regulate(Box<verbs::regulate::Args>),
    /// Print the JSON schema of a kind of file, for editors.
    Schema(verbs::explain::SchemaArgs),
    /// Split every input into what holds its own coordinate still and what moves it.
    Split(verbs::split::Args),
    /// Play one run on the simulated plant and write its log.
    Simulate(Box<verbs::simulate::Args>),
    /// Repeat an experiment on the simulated plant for many seeds: bias, spread, coverage of the intervals.
    Study(verbs::study::Args),
    /// The pattern beside a 3-4-5 polynomial, a cycloid and a trapezoid: harmonics and peaks of every input.
    Trajectories(Box<verbs::trajectories::Args>),
    /// Predict another log with identified parameters.
    Validate(Box<verbs::validate::Args>),
}

fn main() -> ExitCode {
    let parsed = command().try_get_matches().and_then(|matches| Cli::from_arg_matches(&matches));
    let cli = parsed.unwrap_or_else(|error| {
        let words = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
        if !error.use_stderr() {
            error.exit();
        }
        let error = examples::with_remedy(error, &command(), words);
        terminal::tell(error.render().to_string().trim_end());
        std::process::exit(error.exit_code())
    });
    interrupt::install();
    let budget = if cli.allow_large {
        Budget::large()
    } else {
        memory::limit();
        Budget::default()
    };
    let outcome = budget::run(budget, || dispatch(&cli.command));
    match outcome.map_err(Failure::from).and_then(|outcome| outcome) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.report();
            ExitCode::from(failure.exit_code())
        }
    }
}

/// Runs a command line as if it had been typed.
fn line(words: &[String]) -> Outcome {
    let parsed = command().try_get_matches_from(words).and_then(|matches| Cli::from_arg_matches(&matches));
    dispatch(&parsed.map_err(|error| Failure::Input(error.to_string()))?.command)
}

/// Runs a command.
fn dispatch(verb: &Command) -> Outcome {
    match verb {
        Command::Actuator(args) => verbs::actuator::run(args),
        Command::Campaign(args) => verbs::campaign::run(args),
        Command::Check(args) => verbs::check::run(args),
        Command::Completions(args) => verbs::shell::completions(args, command()),
        Command::Demo(args) => verbs::demo::run(args, line),
        Command::Design(args) => verbs::design::run(args),
        Command::Convert(args) => verbs::convert::run(args),
        Command::Compare(args) => verbs::compare::run(args),
        Command::Complete(args) => verbs::complete::run(args),
        Command::Excite(args) => verbs::excite::run(args),
        Command::Expand(args) => verbs::expand::run(args),
        Command::Explain(args) => verbs::explain::run(args),
        Command::Export(args) => verbs::export::run(args),
        Command::Feedforward(args) => verbs::feedforward::run(args),
        Command::Fit(args) => verbs::fit::run(args),
        Command::Fmt(args) => verbs::fmt::run(args),
        Command::Frf(args) => verbs::frf::run(args),
        Command::Flags => verbs::shell::flags(&command()),
        Command::Generate(args) => verbs::generate::run(args),
        Command::Identifiability(args) => verbs::identifiability::run(args),
        Command::Identify(args) => verbs::identify::run(args),
        Command::Import(args) => verbs::import::run(args),
        Command::Inertias(args) => verbs::inertias::run(args),
        Command::Init(args) => verbs::init::run(args),
        Command::Inspect(args) => verbs::inspect::run(args),
        Command::Language => verbs::explain::language(),
        Command::Linearize(args) => verbs::linearize::run(args),
        Command::Lsp(args) => verbs::lsp::run(args),
        Command::Man(args) => verbs::shell::man(args, command()),
        Command::Payload(args) => verbs::payload::run(args),
        Command::Project(args) => verbs::project::run(args),
        Command::Regulate(args) => verbs::regulate::run(args),
        Command::Schema(args) => verbs::explain::schema(args),
        Command::Split(args) => verbs::split::run(args),
        Command::Simulate(args) => verbs::simulate::run(args),
        Command::Study(args) => verbs::study::run(args),
        Command::Trajectories(args) => verbs::trajectories::run(args),
        Command::Validate(args) => verbs::validate::run(args),
    }
}
