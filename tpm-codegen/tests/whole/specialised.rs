//! Code for one machine: compiled and run, it gives the numbers of the code for all machines with these values.

use std::collections::BTreeMap;
use std::process::Command;

use tpm_codegen::emit::estimator::{EstimatorSource, Identified, Part};
use tpm_codegen::generate::{Language, Options, Scalar, generate};

use crate::c::{FLAGS, compiler};
use crate::support::{estimator, parse, root};

const PARTS: [Part; 3] = [Part::Gravity, Part::MassMatrix, Part::ForwardDynamics];

/// Values of all columns, every third one zero and every fifth one.
fn values(source: &EstimatorSource) -> Identified {
    let value = |index: usize| match index {
        index if index % 3 == 2 => 0.0,
        index if index % 5 == 3 => 1.0,
        index => 1.5 + (index as f64).sin(),
    };
    let columns = source.form.columns.iter().enumerate();
    let values: BTreeMap<String, f64> =
        columns.map(|(index, column)| (column.name.to_string(), value(index))).collect();
    Identified::of_values(&source.model.name, &values)
}

/// Prints the results of all functions at motions of all kinds, which two files give the same names.
fn program(real: &str) -> String {
    format!(
        r#"
#include <stdio.h>
#include "t.h"

#define FILL(x) fill(({real} *)&(x), sizeof(x) / sizeof({real}))
#define SHOW(x) show((const {real} *)&(x), sizeof(x) / sizeof({real}))

static unsigned seed = 1;

static void fill({real} *to, size_t count)
{{
    for (size_t i = 0; i < count; ++i) {{
        seed = seed * 1103515245u + 12345u;
        to[i] = ({real})((seed >> 8) % 20001u) / ({real})10000 - ({real})1;
    }}
}}

static void show(const {real} *from, size_t count)
{{
    for (size_t i = 0; i < count; ++i) {{
        printf("%.17g\n", (double)from[i]);
    }}
}}

int main(void)
{{
    for (int round = 0; round < 20; ++round) {{
        t_motion motion;
        t_inputs inputs;
        t_forces forces;
        t_accelerations accelerations = {{0}};
        {real} matrix[T_EQUATIONS][T_COORDINATES];

        FILL(motion);
        FILL(inputs);
        t_inverse_dynamics(&motion, &t_identified, &forces);
        SHOW(forces);
        t_gravity(&motion, &t_identified, &forces);
        SHOW(forces);
        t_mass_matrix(&motion, &t_identified, matrix);
        SHOW(matrix);
        printf("%d\n", (int)t_forward_dynamics(&motion, &inputs, &t_identified, &accelerations));
        SHOW(accelerations);
        t_feed_forward(&motion, &t_identified, &inputs);
        SHOW(inputs);
    }}
    return 0;
}}
"#
    )
}

/// The numbers that a program prints, and the length of its functions of the dynamics in C.
fn run(source: &EstimatorSource, specialise: bool, scalar: Scalar, compiler: &str) -> (Vec<f64>, usize) {
    let real = if scalar == Scalar::Float { "float" } else { "double" };
    let folder = tempfile::tempdir().expect("a folder");
    let identified = values(source);
    let options = Options {
        identified: Some(&identified),
        specialise,
        scalar,
        prefix: Some("t"),
        ..Options::new(Language::C, "tpm generate")
    };
    let mut length = 0;
    for file in generate(source, &options).expect("C has all of it") {
        let body = file.text.split("void t_inverse_dynamics(").nth(1);
        length += body.filter(|_| file.name == "t.c").and_then(|body| body.split("\n}\n").next()).map_or(0, str::len);
        std::fs::write(folder.path().join(&file.name), file.text).expect("writable");
    }
    std::fs::write(folder.path().join("main.c"), program(real)).expect("writable");
    let output = Command::new(compiler)
        .args(FLAGS)
        .args(["-O1", "main.c", "t.c", "-o", "t", "-lm"])
        .current_dir(folder.path())
        .output()
        .expect("the compiler runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = Command::new(folder.path().join("t")).output().expect("it runs");
    let printed = String::from_utf8(output.stdout).expect("text");
    (printed.split_whitespace().map(|word| word.parse().expect("a number")).collect(), length)
}

#[test]
fn code_for_one_machine_gives_its_numbers() {
    let Some(compiler) = compiler() else { return };
    for path in ["tests/fixtures/arms/three_joints.tpm", "models/cart_pendulum.tpm", "models/mass_spring_drag.tpm"] {
        let source = estimator(&root().join(path)).with(&PARTS).expect("the dynamics");
        for scalar in [Scalar::Double, Scalar::Float] {
            let ((whole, long), (special, short)) =
                (run(&source, false, scalar, compiler), run(&source, true, scalar, compiler));
            assert_eq!(whole.len(), special.len());
            let epsilon = if scalar == Scalar::Float { f64::from(f32::EPSILON) } else { f64::EPSILON };
            for (own, other) in whole.iter().zip(&special) {
                // What both round: sums of terms of size ten, and accelerations by masses that are not small.
                assert!((own - other).abs() <= 4e3 * epsilon * own.abs().max(1.0), "{path} {scalar:?}: {own} {other}");
            }
            assert!(short < long, "{path}: {short} characters for {long}");
        }
    }
}

#[test]
fn what_cannot_be_for_one_machine_is_refused_with_the_reason() {
    let source = estimator(&root().join("models/mass_spring_drag.tpm"));
    let options = Options { specialise: true, ..Options::new(Language::C, "tpm generate") };
    let message = generate(&source, &options).expect_err("no values").to_string();
    assert!(message.contains("values of its parameters"), "{message}");
    let campaign = source.with(&[Part::Campaign]).expect("a campaign");
    let identified = values(&campaign);
    let message =
        generate(&campaign, &Options { identified: Some(&identified), ..options }).expect_err("it changes them");
    assert!(message.to_string().contains("a campaign changes the parameters"), "{message}");
    // A product of numbers that doubles do not hold.
    let text = "model M { coordinate x; input u; parameter a; constant c = 1e-200; c*a*ddot(x) = u; }";
    let small = EstimatorSource::of(&parse(text)).unwrap_or_else(|fault| panic!("{}", fault.message));
    let tiny = Identified::of_values("M", &BTreeMap::from([("a".to_owned(), 1e-200)]));
    let options = Options { identified: Some(&tiny), ..options };
    let message = generate(&small, &options).expect_err("beyond double precision").to_string();
    assert!(message.contains("beyond double precision"), "{message}");
}
