//! One expansion workload: its table as lines, how long it takes, or as many runs as asked for under an instruction
//! counter.
//!
//! ```text
//! expansion WORKLOAD list            the table, one entry a line
//! expansion WORKLOAD time SECONDS    the median, in microseconds, of repetitions over so many seconds
//! expansion WORKLOAD run COUNT       so many expansions and nothing else
//! ```

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program whose result is its output")]

use std::hint::black_box;
use std::process::ExitCode;
use std::time::{Duration, Instant};
use tpm_benches::workloads::{by_name, listing};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let usage = || {
        eprintln!("usage: expansion w1|w2|w3|w4:DEGREE|w6:ORDER list|time SECONDS|run COUNT");
        ExitCode::from(2)
    };
    let Some(workload) = arguments.first().and_then(|name| by_name(name)) else { return usage() };
    match arguments[1..] {
        ["list"] => listing(&workload.expand()).iter().for_each(|line| println!("{line}")),
        ["run", count] => {
            let Ok(count) = count.parse::<u32>() else { return usage() };
            for _ in 0..count {
                black_box(black_box(&workload).expand());
            }
        }
        ["time", seconds] => {
            let Ok(seconds) = seconds.parse::<f64>() else { return usage() };
            println!(
                "{:.3}",
                median_microseconds(Duration::from_secs_f64(seconds), || {
                    black_box(black_box(&workload).expand());
                })
            );
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
