//! How honest identified numbers are: tables in Markdown, from many logs of simulated machines.
//!
//! ```text
//! honesty [correct|spoilt|bound|campaigns|encoders|pendulum ...] [--logs N] [--case WORDS] [--keep DIR]
//! ```
//!
//! Every group has its own number of logs where none is asked for. Logs are identified one to a core (`RAYON_NUM_THREADS`); the
//! outcome does not depend on how many there are.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program whose result is its output")]

use clap::{Parser, ValueEnum};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;
use tpm_benches::honesty::examine::examine;
use tpm_benches::honesty::{cases, correct, efficiency, encoders, pendulum, spoilt};

/// How honest identified numbers are.
#[derive(Parser)]
struct Arguments {
    /// What to run; all of it when nothing is named.
    groups: Vec<Group>,
    /// Number of logs in every case, or of campaigns.
    #[arg(long, value_name = "N")]
    logs: Option<u32>,
    /// Only cases whose name contains these words.
    #[arg(long, value_name = "WORDS", default_value = "")]
    case: String,
    /// Writes the logs of the groups `correct` and `spoilt` into this folder.
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Group {
    /// Right models and sound logs.
    Correct,
    /// Wrong models and spoilt logs.
    Spoilt,
    /// Logs under white noise, beside the Cramer-Rao bound.
    Bound,
    /// Campaigns without encoders, beside the Cramer-Rao bound.
    Campaigns,
    /// Campaigns by files on machines with coarse encoders.
    Encoders,
    /// A pendulum with dry friction.
    Pendulum,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let groups = if arguments.groups.is_empty() { Group::value_variants() } else { &arguments.groups };
    let (words, logs) = (arguments.case.as_str(), arguments.logs);
    let progress = |name: &str| eprintln!("{name}");
    let examined = |cases| examine(cases, words, logs, arguments.keep.as_deref(), &progress);
    for group in groups {
        let began = Instant::now();
        let report = match group {
            Group::Correct => examined(cases::correct()).map(|examined| correct::report(&examined)),
            Group::Spoilt => examined(cases::spoilt()).map(|examined| spoilt::report(&examined)),
            Group::Bound => efficiency::logs(words, logs, &progress),
            Group::Campaigns => efficiency::campaigns(words, logs, &progress),
            Group::Encoders => encoders::report(words, logs, &progress),
            Group::Pendulum => pendulum::report(logs),
        };
        match report {
            Ok(report) => println!("{}", report.trim_end()),
            Err(error) => {
                eprintln!("error: {error}");
                return ExitCode::from(2);
            }
        }
        eprintln!("{:.0} s", began.elapsed().as_secs_f64());
    }
    ExitCode::SUCCESS
}
