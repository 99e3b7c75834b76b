//! Recorded paths to which patterns are fitted.

use super::mutated::mutated;
use super::random::Random;
use super::{Verdict, refused};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::PathBuf;
use tpm_runtime::log::{Log, ReadingSettings};
use tpm_runtime::study::{PathSettings, fit_path};

/// A path of one or two coordinates with what is asked of it in its first line, one in eight still, one in four changed.
pub(super) fn text(random: &mut Random) -> String {
    let closed = random.below(2) == 0;
    let harmonics = 1 + random.below(9);
    let rest = random.below(6);
    let samples = 40 + random.below(300);
    let is_still = random.below(8) == 0;
    let mut text = format!("{harmonics} {rest} {closed}\nt_s,x,y\n");
    let phases: Vec<f64> = (0..2).map(|_| random.below(628) as f64 / 100.0).collect();
    let noise = *random.of(&[0.0, 1e-6, 1e-3]);
    for n in 0..samples {
        let share = n as f64 / samples as f64;
        let _ = write!(text, "{:.4}", n as f64 * 0.01);
        for (c, phase) in (0..2).zip(&phases) {
            let stroke = share - (TAU * share).sin() / TAU;
            let circle = (TAU * share + phase).cos() + 0.2 * (3.0 * TAU * share).sin();
            let value = if closed { circle } else { stroke };
            let value =
                if is_still && c == 1 { 0.1 } else { value + noise * (random.below(2000) as f64 / 1000.0 - 1.0) };
            let _ = write!(text, ",{value:.6}");
        }
        text.push('\n');
    }
    if random.below(4) == 0 { mutated(&text, random.next()) } else { text }
}

thread_local! {
    /// A file of this thread, which goes when the thread ends.
    static FILE: (tempfile::TempDir, PathBuf) = {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("path.csv");
        (folder, path)
    };
}

/// The harmonics of a path. No sample lies further from the fit than is said.
pub(super) fn fitted(text: &str) -> Verdict {
    let (asked, log) = text.split_once('\n').unwrap_or((text, ""));
    let mut asked = asked.split(' ');
    let mut number = || asked.next().and_then(|word| word.parse().ok()).unwrap_or(3);
    let (harmonics, rest) = (number(), number());
    let settings = PathSettings { harmonics, rest, closed: asked.next() == Some("true") };
    let names: Vec<String> =
        if text.len().is_multiple_of(3) { vec!["x"] } else { vec!["x", "y"] }.into_iter().map(str::to_owned).collect();
    let read = FILE.with(|(_, path)| {
        std::fs::write(path, log).expect("writable");
        Log::open_signals(path, &names, &ReadingSettings::default())
    });
    let log = match read {
        Ok((log, _)) => log,
        Err(fault) => return refused(&fault),
    };
    let signals: Vec<(String, Vec<f64>)> = names.into_iter().zip(log.channels).collect();
    match fit_path(&signals, log.sample_time, settings) {
        Ok(found) => {
            for (fitted, (_, values)) in found.coordinates.iter().zip(&signals) {
                let series = fitted.series();
                let off = |(n, value): (usize, &f64)| {
                    (series.derivative(found.frequency * n as f64 * log.sample_time, 1.0, 0) - value).abs()
                };
                let largest = values.iter().enumerate().map(off).fold(0.0, f64::max);
                let close = 1e-9 * (fitted.size + fitted.mean.abs() + largest);
                assert!((largest - fitted.largest).abs() <= close, "{largest} and {}", fitted.largest);
                assert!(fitted.rms <= fitted.largest * 1.000_001, "{} and {}", fitted.rms, fitted.largest);
            }
            Verdict::Answered
        }
        Err(fault) => refused(&fault),
    }
}
