//! One expansion workload: its table (or, for w5a, its polynomial) as lines, how long it takes, or as many runs as asked for
//! under an instruction counter.
//!
//! ```text
//! expansion WORKLOAD list            the table, one entry a line
//! expansion WORKLOAD source          the model and the pattern, for other tools
//! expansion WORKLOAD time SECONDS    the least time, in microseconds, of repetitions over so many seconds
//! expansion WORKLOAD derive SECONDS  the least time from the declared model, which is sorted into its parameters first
//! expansion WORKLOAD run COUNT       so many expansions and nothing else; run-derive starts from the declared model
//! ```

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program whose result is its output")]

use std::hint::black_box;
use std::process::ExitCode;
use std::time::{Duration, Instant};
use tpm_benches::catalogue::by_name;
use tpm_benches::chain::Cube;
use tpm_benches::workloads::{Workload, listing, source};

enum Work {
    Table(Box<Workload>),
    Cube(Cube),
}

impl Work {
    fn by_name(name: &str) -> Option<Self> {
        match name.strip_prefix("w5a:") {
            Some(carts) => carts.parse().ok().filter(|&carts| carts > 1).map(|carts| Self::Cube(Cube::new(carts))),
            None => by_name(name).map(Box::new).map(Self::Table),
        }
    }

    fn list(&self) -> Vec<String> {
        match self {
            Self::Table(workload) => listing(&workload.expand()),
            Self::Cube(cube) => cube.listing(),
        }
    }

    fn source(&self) -> Vec<String> {
        match self {
            Self::Table(workload) => source(workload),
            Self::Cube(_) => Vec::new(),
        }
    }

    fn derive(&self) {
        match self {
            Self::Table(workload) => drop(black_box(black_box(workload).derive())),
            Self::Cube(_) => self.run(),
        }
    }

    fn run(&self) {
        match self {
            Self::Table(workload) => drop(black_box(black_box(workload).expand())),
            Self::Cube(cube) => drop(black_box(black_box(cube).expand())),
        }
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let usage = || {
        eprintln!(
            "usage: expansion w1|w2|w3|w4:DEGREE|w5a:CARTS|w5b:CARTS|w6:ORDER list|source|time|derive SECONDS|run COUNT"
        );
        ExitCode::from(2)
    };
    let Some(work) = arguments.first().and_then(|name| Work::by_name(name)) else { return usage() };
    match arguments[1..] {
        ["list"] => work.list().iter().for_each(|line| println!("{line}")),
        ["source"] => work.source().iter().for_each(|line| println!("{line}")),
        [how @ ("run" | "run-derive"), count] => {
            let Ok(count) = count.parse::<u32>() else { return usage() };
            for _ in 0..count {
                if how == "run" { work.run() } else { work.derive() }
            }
        }
        [how @ ("time" | "derive"), seconds] => {
            let Ok(seconds) = seconds.parse::<f64>() else { return usage() };
            let once = || if how == "time" { work.run() } else { work.derive() };
            println!("{:.3}", least_microseconds(Duration::from_secs_f64(seconds), once));
        }
        _ => return usage(),
    }
    ExitCode::SUCCESS
}

/// The least time of a run, over batches of a millisecond, since a virtual machine halves its speed now and then.
fn least_microseconds(budget: Duration, mut work: impl FnMut()) -> f64 {
    let mut batch_of = |count: u32| {
        let start = Instant::now();
        (0..count).for_each(|_| work());
        start.elapsed()
    };
    let mut batch = 1u32;
    while batch_of(batch) < Duration::from_millis(1) {
        batch *= 2;
    }
    let start = Instant::now();
    let mut least = batch_of(batch);
    let mut runs = 1;
    while start.elapsed() < budget || runs < 5 {
        least = least.min(batch_of(batch));
        runs += 1;
    }
    least.as_secs_f64() * 1e6 / f64::from(batch)
}
