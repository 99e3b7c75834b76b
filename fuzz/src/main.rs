//! Tries random and mutated texts on everything that reads files, on a stable toolchain.
//!
//! ```sh
//! cargo run --release -- all 100000              # so many seeds of every target
//! cargo run --release -- language 1000000 5000   # a million seeds of one target, from seed 5000
//! cargo run --release -- language corpus         # the kept texts alone
//! cargo run --release -- language 1 77 show      # the text of seed 77
//! ```
//!
//! An execution fails that panics, takes longer than its target may (2 s, 10 s for fits by simulation) or more than 1 GB. Time is that of
//! the processor, of all threads together, so that a machine that does other things as well does not make an execution fail. Its text is
//! written to the folder `found`, its seed is printed, and the program goes on; it ends with exit code 1 where one failed. Overflows
//! are checked.

mod targets;

use rustix::time::{ClockId, clock_gettime};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use targets::{TARGETS, Target, Verdict};

/// How long an execution may take of the processor before the program gives it up, and itself with it.
const ENDLESS: Duration = Duration::from_secs(60);

/// How long it may go on by the clock, since one that waits takes nothing of the processor.
const STUCK: Duration = Duration::from_secs(600);

/// The most bytes of an execution.
const MOST_BYTES: u64 = 1 << 30;

/// How often a target says how far it has come.
const BETWEEN_REMARKS: Duration = Duration::from_secs(60);

/// What became of the executions of a target.
#[derive(Default)]
struct Counts {
    executions: u64,
    answered: u64,
    refused: u64,
    too_large: u64,
    failed: u64,
    /// The longest, with what it read.
    slowest: (Duration, String),
    /// The most bytes, with what it read.
    largest: (u64, String),
}

/// When the present execution began, in milliseconds of the program; 0 between two.
static BEGAN: AtomicU64 = AtomicU64::new(0);

/// What the program had taken of the processor then, in milliseconds.
static TAKEN: AtomicU64 = AtomicU64::new(0);

/// The seed of the present execution.
static SEED: AtomicU64 = AtomicU64::new(0);

/// What the threads of this program have taken of the processors so far.
fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), u32::try_from(time.tv_nsec).unwrap_or(0))
}

fn milliseconds(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

impl Counts {
    /// One execution, within its limits.
    fn try_one(&mut self, target: &Target, what: &str, text: &str) {
        let before = processor_time();
        let mut outcome = Ok(Verdict::Refused);
        let taken = allocation_counter::measure(|| {
            outcome = catch_unwind(AssertUnwindSafe(|| (target.read)(text)));
        });
        let time = processor_time().saturating_sub(before);
        self.executions += 1;
        let mut faults = Vec::new();
        match outcome {
            Ok(Verdict::Answered) => self.answered += 1,
            Ok(Verdict::Refused) => self.refused += 1,
            Ok(Verdict::TooLarge) => self.too_large += 1,
            Err(_) => faults.push("panics".to_owned()),
        }
        if time > target.longest {
            faults.push(format!("takes {:.1} s", time.as_secs_f64()));
        }
        if taken.bytes_max > MOST_BYTES {
            faults.push(format!("takes {} bytes", taken.bytes_max));
        }
        if time > self.slowest.0 {
            self.slowest = (time, what.to_owned());
        }
        if taken.bytes_max > self.largest.0 {
            self.largest = (taken.bytes_max, what.to_owned());
        }
        if !faults.is_empty() {
            self.failed += 1;
            eprintln!("{} {what}: {}", target.name, faults.join(", "));
            keep(target, what, text);
        }
    }

    /// A row of the table in which targets stand.
    fn row(&self, target: &Target, seeds: &str, time: Duration) -> String {
        format!(
            "| {} | {seeds} | {} | {} | {} | {} | {} | {:.0} | {:.2} ({}) | {:.1} ({}) |",
            target.name,
            self.executions,
            self.answered,
            self.refused,
            self.too_large,
            self.failed,
            time.as_secs_f64(),
            self.slowest.0.as_secs_f64(),
            self.slowest.1,
            self.largest.0 as f64 / 1e6,
            self.largest.1
        )
    }
}

/// Keeps a text that failed.
fn keep(target: &Target, what: &str, text: &str) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("found");
    let path = folder.join(format!("{}-{what}.txt", target.name));
    if fs::create_dir_all(&folder).and_then(|()| fs::write(&path, text)).is_err() {
        eprintln!("{} could not be written", path.display());
    }
}

/// Gives up an execution that does not end: nothing inside could.
fn watch(target: &'static Target, start: Instant) {
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_secs(1));
            let began = BEGAN.load(Ordering::Relaxed);
            let since = |now: Duration, began: u64| milliseconds(now).saturating_sub(began);
            let taken = since(processor_time(), TAKEN.load(Ordering::Relaxed));
            let waited = since(start.elapsed(), began);
            if began > 0 && (taken > milliseconds(ENDLESS) || waited > milliseconds(STUCK)) {
                let seed = SEED.load(Ordering::Relaxed);
                eprintln!("{} seed {seed}: does not end", target.name);
                keep(target, &seed.to_string(), &target.text(seed));
                std::process::exit(1);
            }
        }
    });
}

/// Tries the kept texts of a target, then so many seeds.
fn try_target(target: &'static Target, first: u64, count: u64) -> bool {
    let start = Instant::now();
    let began = processor_time();
    watch(target, start);
    let mut counts = Counts::default();
    for (path, text) in target.kept() {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        counts.try_one(target, &name, &text);
    }
    let mut said = Instant::now();
    for seed in first..first.saturating_add(count) {
        let text = target.text(seed);
        SEED.store(seed, Ordering::Relaxed);
        TAKEN.store(milliseconds(processor_time()), Ordering::Relaxed);
        BEGAN.store(milliseconds(start.elapsed()).max(1), Ordering::Relaxed);
        counts.try_one(target, &seed.to_string(), &text);
        BEGAN.store(0, Ordering::Relaxed);
        if said.elapsed() > BETWEEN_REMARKS {
            said = Instant::now();
            eprintln!("so far: {}", counts.row(target, &format!("{first}..={seed}"), processor_time() - began));
        }
    }
    let seeds = if count == 0 { "kept".to_owned() } else { format!("{first}..={}", first + count - 1) };
    println!("{}", counts.row(target, &seeds, processor_time() - began));
    counts.failed == 0
}

/// The largest size that this process ever had in memory, where the system says so.
fn peak() -> String {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.map_or_else(|| "not known here".to_owned(), |size| size.trim().to_owned())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let given: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let (name, count, first) = match given[..] {
        [name, "corpus"] => (name, 0, 1),
        [name, count] => (name, count.parse().unwrap_or(0), 1),
        [name, count, first] | [name, count, first, "show"] => {
            (name, count.parse().unwrap_or(0), first.parse().unwrap_or(1))
        }
        _ => {
            let names: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
            eprintln!("usage: tpm-fuzz all|{} EXECUTIONS|corpus [FIRST_SEED [show]]", names.join("|"));
            return ExitCode::from(2);
        }
    };
    let chosen: Vec<&'static Target> = TARGETS.iter().filter(|target| name == "all" || target.name == name).collect();
    if chosen.is_empty() {
        eprintln!("there is no target `{name}`");
        return ExitCode::from(2);
    }
    if given.last() == Some(&"show") {
        chosen.iter().for_each(|target| print!("{}", target.text(first)));
        return ExitCode::SUCCESS;
    }
    let sound = chosen.into_iter().fold(true, |sound, target| try_target(target, first, count) && sound);
    println!("largest size of the process: {}", peak());
    if sound { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
