//! Published logs of real machines, and of a plant simulated elsewhere. They are read from the folder that the environment
//! variable `TPM_DATA` names; without it these tests say that they were skipped.
#![allow(clippy::print_stderr, reason = "what was found is printed for whoever looks at a failure")]

use crate::support::skipped;
use std::path::{Path, PathBuf};
use tpm_models::{Emps, MassSpringDrag, Silverbox};
use tpm_runtime::estimate::Estimate;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::log::{Log, ReadingSettings};
use tpm_runtime::model::Model;
use tpm_runtime::session::{Identification, LogReport, PeriodicReport, identify_log};
use tpm_runtime::session::{LogOptions, RecordSettings};

fn estimate(result: &Identification) -> &Estimate {
    result.estimate.as_ref().expect("a log that identifies has an estimate")
}

fn report(result: &Identification) -> &LogReport {
    result.log.as_ref().expect("a result of a log has a report")
}

fn periodic(result: &Identification) -> &PeriodicReport {
    report(result).periodic().expect("the published logs repeat")
}

fn data(name: &str) -> Option<PathBuf> {
    match std::env::var_os("TPM_DATA") {
        Some(folder) => Some(PathBuf::from(folder).join(name)),
        None => {
            skipped("TPM_DATA does not name the folder of the published logs");
            None
        }
    }
}

fn options(map: &[(&str, &str)], hold: Hold) -> LogOptions {
    LogOptions {
        reading: RecordSettings {
            columns: ReadingSettings {
                map: map.iter().map(|(name, column)| (String::from(*name), String::from(*column))).collect(),
                ..ReadingSettings::default()
            },
            hold,
            ..RecordSettings::default()
        },
        ..LogOptions::default()
    }
}

fn identify(model: &dyn Model<f64>, file: &Path, options: &LogOptions) -> Identification {
    let (log, _) = Log::open_rated(file, model, &options.reading.columns).expect("the published log is sound");
    let result = identify_log(model, &log, options).expect("the published log identifies");
    for p in &result.parameters {
        eprintln!("{} = {:?} +- {:?} ({})", p.name, p.value, p.std, p.status.name());
    }
    eprintln!(
        "steady {} from {} period {} x {} (mismatch {:e}), window {}, harmonics {} of {}, residual {:.5} {:?}, condition {:.2}, chi2 {:.2}, model error {:?}, warnings {:#?}",
        periodic(&result).steady_from_sample,
        periodic(&result).from_sample,
        periodic(&result).samples_per_period,
        periodic(&result).periods,
        periodic(&result).mismatch,
        periodic(&result).window,
        result.harmonics,
        periodic(&result).motion_harmonics,
        result.residual,
        report(&result).hold_residuals,
        result.condition.unwrap_or(f64::INFINITY),
        estimate(&result).chi_squared,
        estimate(&result).model_error,
        result.warnings
    );
    let lines = &periodic(&result).lines[0];
    eprintln!(
        "{} lines: {:?} ... {:?}",
        lines.len(),
        &lines[..lines.len().min(40)],
        &lines[lines.len().saturating_sub(40)..]
    );
    result
}

/// Relative errors within the given bounds.
fn close(result: &Identification, truth: &[f64], bounds: &[f64]) {
    for ((p, truth), bound) in result.parameters.iter().zip(truth).zip(bounds) {
        let value = p.value.expect("observable");
        let error = (value / truth - 1.0).abs();
        assert!(error <= *bound, "{}: {value} against {truth}: {error:e}", p.name);
    }
}

#[test]
fn emps_gives_the_published_values() {
    let Some(file) = data("emps/emps_estimation.csv") else {
        return;
    };
    let options = options(&[("q", "q_m"), ("force", "force_N")], Hold::None);
    let result = identify(&Emps, &file, &options);
    close(&result, &[95.109, 203.503, 20.394, -3.165], &[0.007, 0.015, 0.015, 0.02]);
    assert_eq!(periodic(&result).samples_per_period, 6240.0);
    assert_eq!(periodic(&result).periods, 3);
    assert!(periodic(&result).from_sample + 3 * 6240 <= report(&result).samples);
}

/// What a log of the slider that MuJoCo simulated gives.
fn slider(log: &str) -> Option<Identification> {
    let file = data(&std::format!("mujoco_slider_quad/slider_quad_{log}.csv"))?;
    Some(identify(&MassSpringDrag, &file, &options(&[("x", "q1"), ("u", "tau1")], Hold::Zoh)))
}

const SLIDER: [f64; 3] = [2.0, 40.0, 1.5];

#[test]
fn clean_slider_is_exact() {
    let Some(result) = slider("c0_guess_clean") else {
        return;
    };
    close(&result, &SLIDER, &[1e-6; 3]);
    assert!(result.warnings.is_empty());
}

#[test]
fn noisy_sliders_are_within_their_deviations() {
    for log in ["c0_guess_noisy", "c1_guess_noisy"] {
        let Some(result) = slider(log) else {
            return;
        };
        close(&result, &SLIDER, &[3e-3, 3e-3, 6e-3]);
        for (p, truth) in result.parameters.iter().zip(SLIDER) {
            let deviation = (p.value.expect("observable") - truth) / p.std.expect("observable");
            assert!(deviation.abs() < 2.5, "{}: {deviation} deviations", p.name);
        }
    }
}

#[test]
fn silverbox_agrees_with_the_reference() {
    let Some(file) = data("silverbox/silverbox_schroeder_periods.csv") else {
        return;
    };
    let mut options = options(&[("y", "y_V"), ("u", "u_V")], Hold::None);
    let reference = [5.3715e-6, 2.2874e-4, 0.98927, 3.946];
    for harmonics in [None, Some(200)] {
        options.estimation.harmonics = harmonics;
        let result = identify(&Silverbox, &file, &options);
        close(&result, &reference, &[0.01, 0.01, 0.005, 0.02]);
        assert!(result.residual <= 0.005);
        // Odd lines are excited; of the even ones at most a stray line of the mains stands out of the noise.
        let lines = &periodic(&result).lines[0];
        let odd = lines.iter().filter(|k| *k % 2 == 1).count();
        assert!(lines.len() - odd <= 2 && odd >= 100, "{lines:?}");
    }
    options.reading.hold = Hold::Zoh;
    let wrong = identify(&Silverbox, &file, &options);
    assert!(
        wrong.warnings.iter().any(|w| w.to_string().starts_with("hold none explains the log clearly better")),
        "{:?}",
        wrong.warnings
    );
}
