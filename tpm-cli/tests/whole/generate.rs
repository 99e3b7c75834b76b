//! `tpm generate`: where it writes, what it refuses, and that nothing is left behind when it refuses.
//!
//! What the code computes is tested in the crate `tests`, which compiles the committed file that is compared here.

use crate::support::{fails, names, root, tpm};

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

const SLIDER: &str = "models/mass_spring_drag.tpm";

/// The same text to standard output, into a new folder, and to a named file; `--check` knows it again.
#[test]
fn one_text_wherever_it_goes() {
    let printed = tpm(&["generate", SLIDER, "--lang", "rust"]);
    assert!(printed.status.success(), "{}", text(&printed.stderr));
    let printed = text(&printed.stdout);
    assert!(printed.contains("tpm generate mass_spring_drag.tpm --lang rust"), "the command stands in the header");

    let folder = tempfile::tempdir().expect("a temporary folder");
    let inner = folder.path().join("a/b");
    let file = folder.path().join("slider.rs");
    for (out, written) in [(&inner, inner.join("mass_spring_drag.rs")), (&file, file.clone())] {
        let out = out.to_str().expect("a readable path");
        let check = || tpm(&["generate", SLIDER, "--lang", "rust", "-o", out, "--check"]);
        let absent = check();
        assert_eq!(absent.status.code(), Some(1));
        assert!(text(&absent.stderr).contains("is not there"), "{}", text(&absent.stderr));
        assert!(!written.exists(), "--check writes nothing");

        let output = tpm(&["generate", SLIDER, "--lang", "rust", "-o", out]);
        assert!(output.status.success() && output.stdout.is_empty(), "{}", text(&output.stderr));
        assert_eq!(std::fs::read_to_string(&written).expect("written"), printed);
        assert!(check().status.success());

        std::fs::write(&written, printed.replacen("MassSpringDrag", "Other", 1)).expect("writable");
        let stale = check();
        assert_eq!(stale.status.code(), Some(1));
        assert!(text(&stale.stderr).contains("differs from line 1; run `tpm generate"), "{}", text(&stale.stderr));
    }
    assert_eq!(names(&inner), ["mass_spring_drag.rs"], "no temporary file is left");
}

#[test]
fn the_committed_file_is_current() {
    let output = tpm(&["generate", SLIDER, "--lang", "rust", "-o", "tests/generated", "--check"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

#[test]
fn identified_values_are_baked_in() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let result = folder.path().join("result.json");
    let result = result.to_str().expect("a readable path");
    let identified = tpm(&["identify", SLIDER, "--json", "-o", result]);
    assert!(identified.status.success(), "{}", text(&identified.stderr));
    let generated = tpm(&["generate", SLIDER, "--lang", "rust", "--params", result]);
    assert!(generated.status.success(), "{}", text(&generated.stderr));
    let generated = text(&generated.stdout);
    assert!(generated.contains("--lang rust --params result.json"));
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(result).expect("written")).expect("JSON");
    for parameter in json["parameters"].as_array().expect("a list") {
        let line = format!("    {}: {},", parameter["name"].as_str().expect("a name"), parameter["value"]);
        assert!(generated.contains(&line), "{line} is missing");
    }
}

/// What a pattern cannot give is said, and the rest is generated.
#[test]
fn gaps_are_said() {
    let output = tpm(&["generate", "models/rotary_pendulum.tpm", "--lang", "rust"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let (code, said) = (text(&output.stdout), text(&output.stderr));
    assert!(code.contains("pub fn regressor") && !code.contains("fn estimator_matrix"));
    assert!(said.contains("remark: There is no estimator matrix and no harmonic"), "{said}");
}

/// A header and a source, both or neither, with the prefix and the scalar that were asked for.
#[test]
fn c_is_a_header_and_a_source() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().to_str().expect("a readable path");
    let float = ["generate", SLIDER, "--lang", "c", "--prefix", "slider", "--real", "float", "-o", out];
    let output = tpm(&float);
    assert!(output.status.success() && output.stdout.is_empty(), "{}", text(&output.stderr));
    assert_eq!(names(folder.path()), ["slider.c", "slider.h"]);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("written");
    let header = read("slider.h");
    assert!(header.contains("`tpm generate mass_spring_drag.tpm --lang c --prefix slider --real float`"), "{header}");
    assert!(header.contains("void slider_regressor(const slider_motion *motion") && !header.contains("double"));
    assert!(read("slider.c").contains("#include \"slider.h\"") && read("slider.c").contains("cosf(phase)"));

    let check = [&float[..], &["--check"]].concat();
    assert!(tpm(&check).status.success());
    let changed = read("slider.c").replacen("0.5555556f", "0.5555555f", 1);
    let line = changed.lines().position(|line| line.contains("0.5555555f")).expect("it is there") + 1;
    std::fs::write(folder.path().join("slider.c"), changed).expect("writable");
    let stale = tpm(&check);
    let message = text(&stale.stderr);
    assert_eq!(stale.status.code(), Some(1));
    assert!(message.contains(&format!("slider.c differs from line {line};")), "{message}");

    // The source cannot be written: the header stays as it was.
    let before = "/* before */\n";
    std::fs::write(folder.path().join("slider.h"), before).expect("writable");
    std::fs::remove_file(folder.path().join("slider.c")).expect("removable");
    std::fs::create_dir(folder.path().join("slider.c")).expect("a folder stands in the way");
    let refused = tpm(&float);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
    assert_eq!(read("slider.h"), before);

    let large = folder.path().join("large.tpm");
    std::fs::write(&large, "model A {\n coordinate x; input u; parameter m;\n 1e40*m*ddot(x) = u;\n}\n")
        .expect("writable");
    let large = large.to_str().expect("a readable path");
    let file = folder.path().join("one.c");
    let cases: [(&[&str], &str); 7] = [
        (&[SLIDER, "--lang", "c"], "(mass_spring_drag.h, mass_spring_drag.c): give a folder with -o"),
        (&[SLIDER, "--lang", "c", "-o", file.to_str().expect("a readable path")], "-o must be a folder"),
        (&[SLIDER, "--lang", "c", "-o", large], "is no folder: give one, which is made when there is none\n"),
        (&[SLIDER, "--lang", "c", "--prefix", "2nd", "-o", out], "`2nd` cannot begin names of C"),
        (&[SLIDER, "--lang", "c", "--prefix", "größe", "-o", out], "all ASCII"),
        (&[large, "--lang", "c", "--real", "float", "-o", out], "beyond single precision"),
        (&[SLIDER, "--lang", "rust", "--real", "float"], "--prefix and --real are for --lang c"),
    ];
    let before = names(folder.path());
    for (given, expected) in cases {
        let output = tpm(&[&["generate"], given].concat());
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{given:?}: {message}");
        assert!(message.contains(expected), "{given:?}: `{expected}` is missing in\n{message}");
        assert_eq!(names(folder.path()), before, "{given:?} left something behind");
    }
}

/// Arguments, what the message must contain. Exit code 2, nothing printed, nothing written.
#[test]
fn refusals_leave_nothing_behind() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("a readable path").to_owned();
    let write = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.path().join(name), bytes).expect("writable");
        path(name)
    };
    let wrong_model = write("wrong.tpm", b"model A {\n  coordinate x; input u; parameter m;\n  m*ddot(y) = u;\n}\n");
    let not_linear =
        write("bent.tpm", b"model A {\n coordinate x; input u; parameter m, k;\n ddot(x)*sin(k*x) + m*x = u;\n}\n");
    let too_large = write("large.tpm", b"model A {\n coordinate x; input u; parameter m;\n 1e400*m*ddot(x) = u;\n}\n");
    let other = write("other.json", br#"{"schema": "tpm.identification/1", "model": "Emps", "parameters": []}"#);
    let garbage = write("garbage.json", b"\xff{");
    let no_schema = write("no_schema.json", b"{\n \"model\": 3\n}");
    write("file", b"");
    let before = names(folder.path());
    let out = path("out");
    let below_a_file = path("file/below");
    let cases: [(&[&str], &[&str]); 9] = [
        (&[&wrong_model], &["wrong.tpm:3:10", "`y`"]),
        (&[&not_linear], &["bent.tpm:3:", "linear"]),
        (&[&too_large], &["large.tpm:1:7", "beyond double precision", "choose other units"]),
        (&[&path("absent.tpm")], &["cannot read", "absent.tpm"]),
        (&[SLIDER, "--params", &other], &["other.json", "`Emps`", "`MassSpringDrag`"]),
        (&[SLIDER, "--params", &garbage], &["garbage.json", "byte 0 is not UTF-8", "tpm identify --json"]),
        (&[SLIDER, "--params", &no_schema], &["no_schema.json", "tpm.identification/1", "line 2"]),
        (&[SLIDER, "--params", &path("absent.json")], &["cannot read", "absent.json"]),
        (&[SLIDER, "-o", &below_a_file], &["cannot write", "no partial file was left"]),
    ];
    for (given, expected) in cases {
        let mut arguments = vec!["generate", "--lang", "rust"];
        arguments.extend(given);
        if !given.contains(&"-o") {
            arguments.extend(["-o", &out]);
        }
        let output = tpm(&arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{given:?}: {message}");
        for part in expected {
            assert!(message.contains(part), "{given:?}: `{part}` is missing in\n{message}");
        }
        assert!(output.stdout.is_empty() && !message.contains("panicked"), "{given:?}: {message}");
        assert_eq!(names(folder.path()), before, "{given:?} left something behind");
    }
}

/// Parts come when they are asked for, and the header says with which command.
#[test]
fn parts_are_made_on_request() {
    let arm = "models/robots/planar_arm.tpm";
    let words = ["fn gravity", "fn mass_matrix", "fn forward_dynamics", "fn base_regressor", "struct BaseEstimator"];
    let plain = tpm(&["generate", arm, "--lang", "rust"]);
    assert!(plain.status.success(), "{}", text(&plain.stderr));
    words.iter().for_each(|word| assert!(!text(&plain.stdout).contains(word), "{word}"));
    let asked = tpm(&["generate", arm, "--lang", "rust", "--with", "estimator,gravity", "--with", "forward_dynamics"]);
    let code = text(&asked.stdout);
    assert!(asked.status.success(), "{}", text(&asked.stderr));
    assert!(code.contains("planar_arm.tpm --lang rust --with gravity,forward_dynamics,estimator`"), "{code}");
    let present: Vec<bool> = words.iter().map(|word| code.contains(word)).collect();
    assert_eq!(present, [true, false, true, true, true]);
    let unknown = tpm(&["generate", arm, "--lang", "rust", "--with", "mass"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(text(&unknown.stderr).contains("mass_matrix"), "{}", text(&unknown.stderr));
}

/// The models and the words are those of the macros' own test, where the same options are asked for inside of `with`.
#[test]
fn what_a_model_does_not_allow_is_refused_in_the_words_of_the_macros() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let asked: [(&str, &[&str]); 9] = [
        ("free_coordinate", &["--with", "campaign"]),
        ("impossible_part", &["--with", "run,campaign"]),
        ("many_harmonics", &["--with", "run"]),
        ("no_chain", &["--with", "campaign"]),
        ("no_dynamics", &["--with", "forward_dynamics"]),
        ("no_feed_forward", &["--with", "campaign"]),
        ("no_run", &["--with", "linearised"]),
        ("no_strokes", &["--strokes"]),
        ("nothing_forgets", &["--forgetting"]),
    ];
    for (name, options) in asked {
        let shown = |ending: &str| {
            std::fs::read_to_string(root().join(format!("tpm-macros/tests/ui/{name}.{ending}"))).expect("readable")
        };
        let (source, said) = (shown("rs"), shown("stderr"));
        let model: Vec<&str> = source.lines().skip(2).take_while(|line| *line != "}").collect();
        let path = folder.path().join(format!("{name}.tpm"));
        std::fs::write(&path, model.join("\n")).expect("writable");
        let said = said.lines().next().and_then(|line| line.strip_prefix("error: ")).expect("a message");
        for language in ["rust", "c"] {
            let out = folder.path().join(language);
            let [path, out] = [&path, &out].map(|path| path.to_str().expect("readable"));
            let command = ["generate", path, "--lang", language, "-o", out];
            fails(&command.iter().chain(options).copied().collect::<Vec<&str>>(), 2, &[said, &format!("{name}.tpm")]);
            assert!(!std::path::Path::new(out).exists(), "{name}: nothing was written");
        }
    }
}

/// A machine in which inputs stand in these terms, written to a folder.
fn driven(folder: &std::path::Path, terms: &str) -> String {
    let file = folder.join("t.tpm");
    let declared = |name: &str, text: &'static str| if terms.contains(name) { text } else { "" };
    let model = format!(
        "model T {{ coordinate x [1]; input u [1]{}; parameter m [N*s^2], d [N*s], k [N]{}; constant w = 0.3 [N];
        m*ddot(x) + d*dot(x) + w = {terms}; }}",
        declared("v", ", v [1]"),
        declared("e*", ", e [N]"),
    );
    std::fs::write(&file, model).expect("writable");
    file.to_str().expect("a readable path").to_owned()
}

#[test]
fn a_feed_forward_solves_for_inputs_in_functions() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let compiler = ["cc", "gcc", "clang"]
        .into_iter()
        .find(|name| std::process::Command::new(name).arg("--version").output().is_ok());
    // The force is 1.5*2 + 0.8*0.5 + 0.3 where x is 0.4.
    let force = 3.7_f64;
    let main = "#include \"t.h\"\n#include <stdio.h>\nint main(void) {\n    t_motion motion = { { 0.4, 0.5, 2.0 } };\n    \
                t_parameters parameters = { .m = 1.5, .d = 0.8, .k = K };\n    t_inputs inputs;\n    \
                t_feed_forward(&motion, &parameters, &inputs);\n    printf(\"%.17g\\n\", inputs.u);\n    return 0;\n}\n";
    for (term, k, expected) in [
        ("k*u^2", 0.2, (force / 0.2).sqrt()),
        ("k*u*abs(u)", -0.2, -(force / 0.2).sqrt()),
        ("k*abs(u)", 0.2, force / 0.2),
        ("k/u", 0.2, 0.2 / force),
        ("k*sqrt(u)", 0.2, (force / 0.2).powi(2)),
        ("2*k*exp(u)", 0.2, (force / 0.4).ln()),
        ("k*sin(u)", 7.4, 0.5_f64.asin()),
        // A thrust that cannot pull.
        ("k*u^2", -0.2, f64::NAN),
    ] {
        let model = driven(folder.path(), term);
        let out = folder.path().join("out");
        let arguments = ["generate", &model, "--lang", "c", "--prefix", "t", "-o", out.to_str().expect("readable")];
        let output = tpm(&arguments);
        assert!(output.status.success(), "{term}: {}", text(&output.stderr));
        let header = std::fs::read_to_string(out.join("t.h")).expect("written");
        assert!(header.contains("`u` stands in"), "{term}: {header}");
        let Some(compiler) = compiler else { continue };
        std::fs::write(out.join("main.c"), main.replace('K', &k.to_string())).expect("writable");
        let flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "t.c", "main.c", "-o", "run", "-lm"];
        let built = std::process::Command::new(compiler).current_dir(&out).args(flags).output().expect("it runs");
        assert!(built.status.success(), "{term}: {}", text(&built.stderr));
        let run = std::process::Command::new(out.join("run")).output().expect("it runs");
        let found: f64 = text(&run.stdout).trim().parse().expect("a number");
        let right = (found - expected).abs() <= 1e-14 * expected.abs() || (found.is_nan() && expected.is_nan());
        assert!(right, "{term}: {found}, not {expected}");
    }
    let model = driven(folder.path(), "k*u^2");
    fails(
        &["generate", &model, "--lang", "c", "--with", "mass_matrix"],
        2,
        &["`mass_matrix` takes inputs that stand alone"],
    );
}

#[test]
fn inputs_that_cannot_be_solved_for_are_named_with_the_reason() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (term, why) in [
        ("k*u^2 + e*u^2*x", "stands in several terms"),
        ("k*u^2 + u*w", "`u` cannot be solved for: it stands alone and in"),
        ("k*u*x", "it stands beside the motion in"),
        ("k*sin(u + x)", "stands in a function beside `x`"),
        ("k*u^3", "has no inverse that is known here"),
        ("k*u*v", "cannot be solved for"),
        ("k*u^2 + w*v", "another input acts in the equation"),
    ] {
        let model = driven(folder.path(), term);
        fails(&["generate", &model, "--lang", "c", "-o", "never"], 2, &[why]);
    }
}

/// Bounds stand in a file of their own, whose command makes the same files again; ranges that are none are refused, and nothing is written.
#[test]
fn stated_ranges_give_bounds_of_rounding() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("bounds");
    let out = out.to_str().expect("a readable path");
    let base = ["generate", SLIDER, "--lang", "c", "-o", out, "--range"];
    let with = |ranges: &'static str| [&base[..], &[ranges]].concat();
    fails(&with("x=1..0"), 2, &["--range: the range x=1..0: both ends must be finite numbers, the lower one first"]);
    fails(&with("x"), 2, &["--range: `x` is no range: write NAME=LOW..HIGH"]);
    fails(&with("y=0..1"), 2, &["--range: there is no `y` for a range; functions read x, dot(x), ddot(x)"]);
    assert!(!std::path::Path::new(out).exists(), "nothing is written");
    let ranges = "*=-1..1,dot(x)=-2..2,ddot(x)=-9..9,m=1..2,k1=1..2,k2=1..2,u=-5..5";
    let made = tpm(&with(ranges));
    assert!(made.status.success() && !text(&made.stderr).contains("no bound"), "{}", text(&made.stderr));
    let files = ["mass_spring_drag.bounds.json", "mass_spring_drag.c", "mass_spring_drag.h"];
    assert_eq!(names(std::path::Path::new(out)), files);
    let document = std::fs::read_to_string(format!("{out}/{}", files[0])).expect("written");
    let document: serde_json::Value = serde_json::from_str(&document).expect("JSON");
    let command = format!("tpm generate mass_spring_drag.tpm --lang c --range '{ranges}'");
    assert_eq!(document["command"].as_str(), Some(command.as_str()));
    assert!(tpm(&[&with(ranges)[..], &["--check"]].concat()).status.success());
}
