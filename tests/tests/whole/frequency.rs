//! Frequency responses beside those of an independent implementation, `scipy.signal`.

use std::path::Path;
use std::process::Command;
use tpm_runtime::frequency::{Excitation, FrequencyResponse, Welch};
use tpm_runtime::harmonics::Hold;

/// Exit code of the script where scipy is not installed.
const NO_SCIPY: i32 = 77;

/// H1 and coherence of 180,000 samples agree with `scipy.signal` to rounding. `PYTHON` names the interpreter.
#[test]
fn h1_is_that_of_scipy() {
    let (samples, segment, sample_time) = (180_000, 32_768, 1e-3);
    let input = Excitation::Noise { std: 0.3, hold: 0.01, seed: 1 }.samples(samples, sample_time).expect("valid");
    // A damped resonance with a constant offset, through an encoder. Any other system would do.
    let (mut x, mut v) = (0.0_f64, 0.0_f64);
    let output: Vec<f64> = input
        .iter()
        .map(|u| {
            v += sample_time * (60.0 * (u - x) - 1.1 * v);
            x += sample_time * v;
            0.5 + (x * 300.0).round() / 300.0
        })
        .collect();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("samples.csv");
    let text: String = input.iter().zip(&output).map(|(u, y)| format!("{u},{y}\n")).collect();
    std::fs::write(&file, text).expect("writable");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/csd.py");
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let run =
        Command::new(&python).arg(script).arg(&file).args([segment.to_string(), sample_time.to_string()]).output();
    let output_of = match run {
        Ok(output) if output.status.code() != Some(NO_SCIPY) => output,
        _ => {
            crate::support::skipped(&format!("{python} with scipy is not installed"));
            return;
        }
    };
    let said = String::from_utf8_lossy(&output_of.stderr);
    assert!(output_of.status.success(), "{said}");

    let began = std::time::Instant::now();
    let found = FrequencyResponse::estimate(&input, &output, sample_time, &Welch::new(segment, Hold::None));
    let (time, found) = (began.elapsed(), found.expect("long enough"));
    println!("H1 of {samples} samples: {time:?}; {}", said.trim());
    let mut largest = 0.0_f64;
    let mut lines = 0;
    for (line, row) in found.lines.iter().zip(String::from_utf8_lossy(&output_of.stdout).lines()) {
        let row: Vec<f64> = row.split(' ').map(|number| number.parse().expect("a number")).collect();
        let [frequency, re, im, coherence] = row[..] else { panic!("four numbers a line: {row:?}") };
        assert!((line.hertz() - frequency).abs() <= 1e-12 * frequency.max(1.0), "{frequency}");
        let difference = (line.h1.re - re).hypot(line.h1.im - im) / re.hypot(im);
        largest = largest.max(difference).max((line.coherence - coherence).abs());
        lines += 1;
        assert!(difference <= 1e-9, "{frequency} Hz: {} and {re} {im}", line.h1);
        assert!((line.coherence - coherence).abs() <= 1e-9, "{frequency} Hz: {} and {coherence}", line.coherence);
    }
    assert_eq!(lines, segment / 2 + 1);
    println!("{lines} lines, largest difference {largest:.1e}");
}
