//! Generated accumulators that let earlier periods fade away, in Rust and C.

use crate::generated::forgetting::mass_spring_drag::{Accumulator, Forces};
use crate::support::{root, skipped};
use std::f64::consts::TAU;
use std::process::Command;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{File, Language, Options, generate};
use tpm_codegen::{Source, parse_model};

const COMMAND: &str = "tpm generate mass_spring_drag.tpm --lang rust --forgetting";
const SAMPLES: u32 = 40;
const SHARE: f64 = 0.75;
/// Amplitude of the first cosine in each of three periods.
const AMPLITUDES: [f64; 3] = [1.0, 5.0, 2.0];

fn files(language: Language) -> Vec<File> {
    let path = root().join("models/mass_spring_drag.tpm");
    let source = Source::from_bytes("mass_spring_drag.tpm", std::fs::read(path).expect("shipped"));
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let estimator = EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message));
    let options = Options {
        forgetting: true,
        prefix: (language == Language::C).then_some("t"),
        ..Options::new(language, COMMAND)
    };
    generate(&estimator, &options).expect("nothing stands in the way")
}

/// The mean of the amplitudes, each of which counts by the share to the power of the periods behind it.
fn expected() -> f64 {
    let (sum, weight) = AMPLITUDES.iter().fold((0.0, 0.0), |(sum, weight), a| (SHARE * sum + a, SHARE * weight + 1.0));
    sum / weight
}

#[test]
fn earlier_periods_fade_away() {
    let mut accumulator = Accumulator::<f64>::new();
    for (period, amplitude) in AMPLITUDES.into_iter().enumerate() {
        if period > 0 {
            accumulator.fade(SHARE);
            assert_eq!(accumulator.samples(), 0);
        }
        for n in 0..SAMPLES {
            let phase = TAU * f64::from(n) / f64::from(SAMPLES);
            accumulator.push(phase, &Forces { u: 0.5 + amplitude * phase.cos() });
        }
    }
    let harmonics = accumulator.harmonics().expect("samples");
    assert!((harmonics.u.cos1 - expected()).abs() < 1e-14, "{harmonics:?}");
    assert!((harmonics.u.cos0 - 0.5).abs() < 1e-14, "{harmonics:?}");
    // What was forgotten altogether leaves nothing.
    accumulator.fade(0.0);
    assert!(accumulator.harmonics().is_none());
}

#[test]
fn earlier_periods_fade_away_in_c() {
    let runs = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success());
    let Some(compiler) = ["cc", "gcc", "clang"].into_iter().find(runs) else {
        skipped("there is no C compiler");
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    for file in files(Language::C) {
        std::fs::write(folder.path().join(&file.name), &file.text).expect("writable");
    }
    let main = format!(
        "#include <math.h>\n#include <stdio.h>\n#include \"t.h\"\nint main(void)\n{{\n    const double amplitudes[3] = {{{}, {}, {}}};\n    \
         t_accumulator sums;\n    t_harmonics found;\n    int period, n;\n    t_accumulator_clear(&sums);\n    \
         for (period = 0; period < 3; ++period) {{\n        if (period > 0) {{\n            t_accumulator_fade(&sums, {SHARE});\n        }}\n        \
         for (n = 0; n < {SAMPLES}; ++n) {{\n            const double phase = {TAU} * n / {SAMPLES};\n            t_forces force;\n            \
         force.u = 0.5 + amplitudes[period] * cos(phase);\n            t_accumulate(&sums, phase, &force);\n        }}\n    }}\n    \
         if (t_accumulated(&sums, &found) != T_OK) {{\n        return 1;\n    }}\n    printf(\"%.17g %.17g\\n\", found.u.cos1, found.u.cos0);\n    \
         t_accumulator_fade(&sums, 0);\n    return t_accumulated(&sums, &found) == T_TOO_FEW ? 0 : 2;\n}}\n",
        AMPLITUDES[0], AMPLITUDES[1], AMPLITUDES[2]
    );
    std::fs::write(folder.path().join("main.c"), main).expect("writable");
    let built = Command::new(compiler)
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "main.c", "t.c", "-lm", "-o", "run"])
        .current_dir(folder.path())
        .output()
        .expect("the compiler runs");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let output = Command::new(folder.path().join("run")).output().expect("the program runs");
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).expect("text");
    let found: Vec<f64> = text.split_whitespace().map(|number| number.parse().expect("a number")).collect();
    assert!((found[0] - expected()).abs() < 1e-14 && (found[1] - 0.5).abs() < 1e-14, "{text}");
}
