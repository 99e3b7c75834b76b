//! One expansion workload: its table (or, for w5a, its polynomial) as lines, how long it takes, or as many runs as asked for under an instruction
//! counter.
//!
//! ```text
//! expansion WORKLOAD list            the table, one entry a line
//! expansion WORKLOAD start           what the expansion of a table starts from, for other tools
//! expansion WORKLOAD time SECONDS    the median, in microseconds, of repetitions over so many seconds
//! expansion WORKLOAD run COUNT       so many expansions and nothing else
//! ```

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program whose result is its output")]

use std::hint::black_box;
use std::process::ExitCode;
use std::time::{Duration, Instant};
use tpm_benches::chain::Cube;
use tpm_benches::workloads::{Workload, by_name, listing, start};

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

    fn start(&self) -> Vec<String> {
        match self {
            Self::Table(workload) => start(workload),
            Self::Cube(_) => Vec::new(),
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
        eprintln!("usage: expansion w1|w2|w3|w4:DEGREE|w5a:CARTS|w5b:CARTS|w6:ORDER list|start|time SECONDS|run COUNT");
        ExitCode::from(2)
    };
    let Some(work) = arguments.first().and_then(|name| Work::by_name(name)) else { return usage() };
    match arguments[1..] {
        ["list"] => work.list().iter().for_each(|line| println!("{line}")),
        ["start"] => work.start().iter().for_each(|line| println!("{line}")),
        ["run", count] => {
            let Ok(count) = count.parse::<u32>() else { return usage() };
            for _ in 0..count {
                work.run();
            }
        }
        ["time", seconds] => {
            let Ok(seconds) = seconds.parse::<f64>() else { return usage() };
            println!("{:.3}", median_microseconds(Duration::from_secs_f64(seconds), || work.run()));
        }
        _ => return usage(),
    }
    ExitCode::SUCCESS
}

/// The median over batches of at least 20 microseconds each.
fn median_microseconds(budget: Duration, mut work: impl FnMut()) -> f64 {
    let mut batch = 1u32;
    loop {
        let start = Instant::now();
        (0..batch).for_each(|_| work());
        if start.elapsed() > Duration::from_micros(20) {
            break;
        }
        batch *= 2;
    }
    let start = Instant::now();
    let mut times = Vec::new();
    while start.elapsed() < budget || times.len() < 5 {
        let one = Instant::now();
        (0..batch).for_each(|_| work());
        times.push(one.elapsed().as_secs_f64() * 1e6 / f64::from(batch));
    }
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
