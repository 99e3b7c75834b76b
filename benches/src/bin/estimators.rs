//! Every estimator on the machines of the papers, as tables in Markdown.
//!
//! ```text
//! estimators [--machine WORDS] [--seeds N]
//! ```

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program whose result is its output")]

use clap::Parser;
use std::process::ExitCode;
use tpm_benches::estimators::{SEEDS, report};

/// Every estimator on the machines of the papers.
#[derive(Parser)]
struct Arguments {
    /// Only machines whose name contains these words.
    #[arg(long, value_name = "WORDS", default_value = "")]
    machine: String,
    /// Number of campaigns with noise.
    #[arg(long, value_name = "N", default_value_t = SEEDS)]
    seeds: usize,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match report(&arguments.machine, arguments.seeds, &|name| eprintln!("{name}")) {
        Ok(report) => {
            println!("{}", report.trim_end());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
