//! `tpm excite`: runs that the simulated machine plays and whose logs show its frequency response.

use crate::support::{fails, printed, tpm};

const DOWN: &str = "models/rotary_pendulum_down.tpm";

/// From the excitation to the fitted poles: made, played, measured, fitted beside the model's own transfer function.
#[test]
fn every_signal_shows_the_response_of_the_pendulum() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("a readable path").to_owned();
    let (run, log, plot) = (path("run.csv"), path("log.csv"), path("bode.svg"));
    // Each with the way of reading its log that `tpm excite` names.
    let signals: [(&[&str], &[&str]); 3] = [
        (&["noise", "--std", "0.3", "--hold", "0.01"], &[]),
        (
            &["multisine", "--rms", "0.1", "--low", "0.1", "--high", "20", "--period", "16384"],
            &["--periodic", "--segment", "16384"],
        ),
        (&["chirp", "--amplitude", "0.1", "--low", "0.05", "--high", "20"], &["--whole"]),
    ];
    for (signal, reading) in signals {
        let common = ["excite", DOWN, "--sample-time", "1e-3", "--duration", "98.304", "--limit", "2.4", "-o", &run];
        let said = printed(&[&common[..], signal].concat());
        assert!(said.contains("tpm frf LOG --input e"), "{said}");
        assert!(reading.iter().all(|flag| said.contains(flag)), "{said}");
        assert!(std::path::Path::new(&path("run.json")).exists());
        printed(&["simulate", DOWN, "--play", &run, "-o", &log]);
        let mut fit =
            vec!["fit", &log, "--input", "e", "--measured", "alpha2", "--hold", "zoh", "--low", "0.4", "--high", "8"];
        fit.extend(["--order", "1/3", "--beside", DOWN, "--params", "models/rotary_pendulum_table1.toml"]);
        fit.extend(["--plot", &plot, "--json"]);
        let fitted = printed(&[&fit[..], reading].concat());
        let fit: serde_json::Value = serde_json::from_str(&fitted).expect("JSON");
        let poles = fit["rational"]["poles"].as_array().expect("a list");
        // Eqn 28 has its pair at -.691 +- 7.362 j.
        let swings = poles.iter().any(|pole| {
            let (re, im) = (pole["re"].as_f64().expect("a number"), pole["im"].as_f64().expect("a number"));
            (re + 0.691).abs() < 0.04 && (im - 7.362).abs() < 0.04
        });
        assert!(swings, "{signal:?}: {poles:?}");
        let median = fit["beside"]["median_difference"].as_f64().expect("a number");
        assert!(median < 0.02, "{signal:?}: {median}");
        let figure = std::fs::read_to_string(&plot).expect("an SVG");
        for label in
            ["measured (H1)", "1/3", "RotaryPendulumDown, given values", "Frequency [Hz]", "[rad/V]", "Phase [deg]"]
        {
            assert!(figure.contains(label), "{signal:?}: {label} is missing");
        }
    }
}

#[test]
fn what_is_no_excitation_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let run = folder.path().join("run.csv").to_str().expect("a readable path").to_owned();
    let excite = |more: &[&str], said: &str| {
        let common = ["excite", DOWN, "--sample-time", "1e-3", "--duration", "10", "-o", &run];
        fails(&[&common[..], more].concat(), 2, &[said]);
    };
    excite(&["noise", "--std", "0.3", "--hold", "0.0015"], "not a whole number of samples");
    excite(&["chirp", "--amplitude", "1", "--low", "1", "--high", "600"], "half the sampling frequency");
    excite(&["--limit", "0.5", "chirp", "--amplitude", "1", "--low", "1", "--high", "20"], "beyond the limit 0.5");
    excite(&["--input", "u", "noise", "--std", "1", "--hold", "0.01"], "the model has e");
    let long = ["multisine", "--rms", "1", "--low", "1", "--high", "2", "--period", "10"];
    excite(&long, "has no line");
    assert!(!std::path::Path::new(&run).exists(), "nothing is written");
    assert!(!tpm(&["excite", DOWN]).status.success());
}
