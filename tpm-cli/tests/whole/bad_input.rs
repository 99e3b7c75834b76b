//! Bad input through the command line: every fault is named with its place and a remedy, the exit code is 2, no file is
//! written, and nothing panics or hangs.

use crate::support::{fails, names, root, tpm_in};

/// The refusal of `arguments` with `input` as the file `name` has all of `parts` in its message.
fn check_refused(name: &str, input: &[u8], arguments: &[&str], parts: &[&str]) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join(name), input).expect("writable");
    let output = tpm_in(folder.path(), arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    let shown: String = message.chars().take(2000).collect();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {shown}");
    for part in parts {
        assert!(message.contains(part), "{arguments:?}: `{part}` is missing in\n{shown}");
    }
    assert!(!message.contains("panicked"), "{shown}");
    assert!(output.stdout.is_empty(), "{arguments:?} printed a result");
    assert_eq!(names(folder.path()), [name], "{arguments:?} left something behind");
}

/// Declarations that most of the faults share.
const HEAD: &str = "model A {\n  coordinate x [m]; input u [N]; parameter m [kg], k [N/m];\n";

/// Bytes without a pattern, the same at every run (xorshift).
fn garbage(length: usize, alphabet: Option<&[u8]>) -> Vec<u8> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as usize
    };
    (0..length).map(|_| alphabet.map_or(next() as u8, |alphabet| alphabet[next() % alphabet.len()])).collect()
}

#[test]
fn faulty_models_of_all_kinds_are_refused() {
    let with = |body: &str| format!("{HEAD}{body}\n}}\n").into_bytes();
    let bare = |body: &str| format!("model A {{\n  coordinate x; input u; parameter m, k;\n{body}\n}}\n").into_bytes();
    let deep = |open: &str, close: &str| {
        with(&format!("  m*ddot(x) + k*{}x{} = u;", open.repeat(100_000), close.repeat(100_000)))
    };
    let letters = b"abcxyz0123456789+-*/^()[]{};= \n.,";
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("unknown name", with("  m*ddot(x) + k*y = u;"), &["in.tpm:3:17", "unknown name `y`", "declare it"]),
        ("unit mismatch", with("  m*dot(x) + k*x = u;"), &["in.tpm:3:3", "kg*m/s", "1/s is missing"]),
        ("never used", with("  m*ddot(x) = u;"), &["in.tpm:2:52", "`k` is never used", "remove it"]),
        ("no input", with("  m*ddot(x) + k*x = 0;"), &["in.tpm:2:27", "no equation has an input", "... = u"]),
        ("power", with("  m*ddot(x) + k*x^1.5 = u;"), &["in.tpm:3:19", "non-negative integer", "1.5"]),
        ("two definitions", with("  let k = 2;\n  m*ddot(x) + k*x = u;"), &["in.tpm:3:7", "defined twice", "rename"]),
        ("deep nesting", deep("(", ")"), &["in.tpm:3:", "nested more than", "let name"]),
        ("deep signs", deep("-", ""), &["in.tpm:3:", "nested more than", "let name"]),
        ("huge power", bare("  m*ddot(x) + k*x^2000000000 = u;"), &["in.tpm:3:17", "too large", "lower the exponents"]),
        ("huge sum", bare("  m*ddot(x) + k*(x + dot(x) + 1)^900 = u;"), &["in.tpm:3:17", "too large", "lower"]),
        ("huge product", bare("  m*ddot(x) + k*x^900*x^900 = u;"), &["in.tpm:3:15", "too large", "lower"]),
        ("garbage", garbage(10_000_000, None), &["in.tpm:1:", "not UTF-8", "save the file as UTF-8"]),
        ("letters", garbage(10_000_000, Some(letters)), &["in.tpm:1:", "Help"]),
        ("zeros", vec![0; 10_000_000], &["in.tpm:1:1", "NUL", "no text file"]),
        (
            "open",
            [b"model A { ".as_slice(), &b"(".repeat(10_000_000)].concat(),
            &["in.tpm:1:9", "not closed", "add a `}`"],
        ),
        ("not UTF-8", b"model A { // L\xe4nge\n}".to_vec(), &["in.tpm:1:15", "0xe4", "save the file as UTF-8"]),
        ("empty", Vec::new(), &["in.tpm:1:1", "model NAME {"]),
    ];
    for (what, input, parts) in &cases {
        println!("{what}");
        check_refused("in.tpm", input, &["check", "in.tpm"], parts);
        check_refused("in.tpm", input, &["expand", "in.tpm", "-o", "out.json", "--format", "json"], parts);
    }
    // One verb tells for all: they read models by one function.
    let (what, input, parts) = &cases[0];
    println!("{what}");
    check_refused("in.tpm", input, &["identify", "in.tpm", "--log", "log.csv", "-o", "out.json"], parts);
    check_refused("in.tpm", input, &["generate", "in.tpm", "--lang", "rust", "-o", "out"], parts);
}

/// What `expand` refuses and `check` only remarks on: such a model is whole for logs.
#[test]
fn models_without_a_finite_table_are_refused_for_tables_only() {
    let pattern = "  pattern { amplitude l [m]; frequency w [rad/s]; x = l*cos(w*t); }\n}\n";
    let free = "model A {\n  coordinate x [m], y [m]; input u [N]; parameter m [kg], k [N/m];\n  \
                m*ddot(x) + k*y = u;\n  m*ddot(y) + k*x = 0;\n";
    let cases = [
        (format!("{HEAD}  m*ddot(x) + k*x = u;\n}}\n"), ["in.tpm:1:7", "has no pattern", "add `pattern"]),
        (format!("{free}{pattern}"), ["in.tpm:3:15", "`y` has no motion", "eliminate it"]),
        (
            format!("{HEAD}  m*ddot(x) + k*sin(x/1) = u;\n{pattern}").replace("[m]", "").replace(" [N/m]", ""),
            ["in.tpm:3:15", "`sin(x)` does not expand", "declare a Taylor series"],
        ),
    ];
    for (model, parts) in &cases {
        check_refused("in.tpm", model.as_bytes(), &["expand", "in.tpm", "-o", "out.json"], parts);
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join("in.tpm"), model).expect("writable");
        let output = tpm_in(folder.path(), &["check", "in.tpm"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(String::from_utf8_lossy(&output.stdout).contains("remark: "), "{model}");
    }
}

/// A log of the slider of Feng, Eqn 3.24 over twenty periods of two seconds, as lines.
fn log() -> Vec<String> {
    let w = std::f64::consts::PI;
    let line = |i: usize| {
        let t = 0.01 * i as f64;
        let x = 0.3 * ((w * t).cos() - (3.0 * w * t).cos() / 9.0);
        let v = 0.3 * w * ((3.0 * w * t).sin() / 3.0 - (w * t).sin());
        let a = 0.3 * w * w * ((3.0 * w * t).cos() - (w * t).cos());
        format!("{t},{x},{}", 2.0 * a + 40.0 * x + 1.5 * v * v)
    };
    std::iter::once("t_s,x,u".to_owned()).chain((0..4000).map(line)).collect()
}

#[test]
fn faulty_logs_are_refused() {
    let model = root().join("models").join("mass_spring_drag.tpm");
    let model = model.to_str().expect("a readable path");
    let identify = ["identify", model, "--log", "log.csv", "--json"];
    let text = |lines: &[String]| lines.join("\n").into_bytes();
    let changed = |line: usize, new: &str| {
        let mut lines = log();
        lines[line - 1] = new.to_owned();
        text(&lines)
    };
    let column = |index: usize, value: &dyn Fn(usize) -> String| {
        let mut lines = log();
        for (i, line) in lines.iter_mut().enumerate().skip(1) {
            let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
            fields[index] = value(i);
            *line = fields.join(",");
        }
        text(&lines)
    };
    let noise = garbage(4001, None);
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("missing column", changed(1, "t_s,y,u"), &["log.csv:1:", "no column `x`", "is a table of text", "--map x=y"]),
        ("column twice", changed(1, "t_s,x,x"), &["log.csv:1:", "`x` may be `x` or `x.2`", "--map x=x"]),
        ("a word", changed(1235, "12.33,0,off"), &["log.csv:1235:", "`off`", "repair"]),
        ("too short", text(&log()[..9]), &["log.csv:9:", "8 samples", "two whole periods"]),
        ("no sample", text(&log()[..1]), &["log.csv:1:", "0 samples"]),
        ("empty", Vec::new(), &["log.csv:1:", "no column is recognised as the time"]),
        ("a few samples", text(&log()[..40]), &["not periodic", "no stretch of it occurs twice", "--period"]),
        (
            "only noise",
            column(1, &|i| noise[i].to_string()),
            &["is noise of single samples", "move further", "--period"],
        ),
        ("constant position", column(1, &|_| "1".to_owned()), &["log.csv:2-4001:", "`x` is 1 throughout", "--map"]),
        ("constant force", column(2, &|_| "3".to_owned()), &["log.csv:2-4001:", "`u` is 3 throughout", "--map"]),
        ("longer line", changed(1502, "15,0,0,0"), &["log.csv:1502:", "4 fields, the header has 3"]),
        ("not UTF-8", b"t_s,x,u\n0,\xe4,0\n".to_vec(), &["log.csv:", "not UTF-8", "save the log"]),
    ];
    for (what, input, parts) in &cases {
        println!("{what}");
        check_refused("log.csv", input, &identify, parts);
    }
    let by_harmonics = [&identify[..], &["--domain", "harmonics"]].concat();
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("one period", text(&log()[..260]), &["log.csv:2-260:", "not periodic", "two whole periods"]),
        (
            "one period to the sample",
            text(&log()[..201]),
            &["not periodic", "no stretch of it occurs twice", "--period"],
        ),
        ("not periodic", column(1, &|i| noise[i].to_string()), &["not periodic", "--period"]),
    ];
    for (what, input, parts) in &cases {
        println!("{what}");
        check_refused("log.csv", input, &by_harmonics, parts);
    }
    // These split a record, or make it uneven. A frequency response needs a whole one.
    let response = ["frf", "log.csv", "--input", "u", "--measured", "x"];
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("NaN", changed(1235, "12.33,NaN,1"), &["log.csv:1235:", "column `x`", "cut the log"]),
        ("infinite", changed(1235, "12.33,0,inf"), &["log.csv:1235:", "column `u`", "cut the log"]),
        ("a blank", changed(1235, "12.33,,1"), &["log.csv:1235:", "column `x` is empty", "cut the log"]),
        ("jitter", changed(1235, "12.331,0,0"), &["log.csv:1235:", "time advances", "resample"]),
        ("back in time", changed(1235, "12.3,0,0"), &["log.csv:1235:", "time advances", "resample"]),
        ("a gap", text(&[&log()[..1200], &log()[1300..]].concat()), &["log.csv:1201:", "time advances", "resample"]),
    ];
    for (what, input, parts) in &cases {
        println!("{what}");
        check_refused("log.csv", input, &response, parts);
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join("log.csv"), input).expect("writable");
        let output = tpm_in(folder.path(), &identify);
        let result: serde_json::Value = serde_json::from_slice(&output.stdout).expect("a result");
        let said = result["log"]["reading"]["remarks"].to_string();
        let place = if *what == "jitter" { "uneven" } else { "1235" };
        let place = if *what == "a gap" { "lines 1201 to 3901" } else { place };
        assert!(said.contains(place), "{what}: {said}");
    }
}

#[test]
fn what_is_no_table_is_refused() {
    let model = root().join("models").join("mass_spring_drag.tpm");
    let model = model.to_str().expect("a readable path");
    let identify = ["identify", model, "--log", "log.csv", "--json"];
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("binary", garbage(100_000, None), &["log.csv: the file is no text", "CSV"]),
        ("zeros", vec![0; 1000], &["log.csv: the file is no text"]),
        ("UTF-16", b"\xff\xfet\0_\0s\0".to_vec(), &["UTF-16", "UTF-8"]),
        ("gzip", b"\x1f\x8b\x08\0".to_vec(), &["compressed", "unpack"]),
        ("one long line", vec![b'1'; 40_000_000], &["log.csv:1:", "longer than"]),
        ("other unit", b"t_s,x [deg],u\n0,1,2\n".to_vec(), &["log.csv:1:", "`x [deg]`", "`deg`", "--scale x=FACTOR"]),
        ("unknown unit", b"t_s,x [counts],u\n0,1,2\n".to_vec(), &["`counts`", "not known", "--scale x=FACTOR"]),
        ("two columns", b"t_s,x [mm],x [cm],u\n0,1,2,3\n".to_vec(), &["`x [mm]` or `x [cm]`", "--map \"x=x [mm]\""]),
        ("unit of time", b"time,x,u\n0,1,2\n99,2,4\n".to_vec(), &["`time`", "--scale t_s=FACTOR"]),
        ("MAT-file of 7.3", b"\x89HDF\r\n\x1a\n".to_vec(), &["HDF5", "save -v7"]),
    ];
    for (what, input, parts) in &cases {
        println!("{what}");
        check_refused("log.csv", input, &identify, parts);
    }
    fails(&["identify", model, "--log", "models"], 2, &["models: ", "directory"]);
    for (factor, said) in [("x=2*frog", "2*frog"), ("x=1/0", "1/0"), ("x=", "NAME=VALUE"), ("x=1e999", "1e999")] {
        fails(&["identify", model, "--log", "models", "--scale", factor], 2, &[said]);
    }
}

/// A pipe holds a log as well as a file does.
#[cfg(unix)]
#[test]
fn a_log_may_come_through_a_pipe() {
    let model = root().join("models").join("mass_spring_drag.tpm");
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("log.csv"), log().join("\n")).expect("writable");
    let line = format!(
        "mkfifo pipe && (cat log.csv >pipe &) && '{}' identify '{}' --log pipe --json",
        env!("CARGO_BIN_EXE_tpm"),
        model.display()
    );
    let output =
        std::process::Command::new("sh").args(["-c", &line]).current_dir(folder.path()).output().expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn faulty_experiments_are_refused() {
    let model = root().join("models").join("mass_spring_drag.tpm");
    let model = model.to_str().expect("a readable path");
    let good = std::fs::read_to_string(root().join("models").join("mass_spring_drag.toml")).expect("the experiment");
    let cases: Vec<(&str, String, &[&str])> = vec![
        ("unknown field", format!("colour = 3\n{good}"), &["in.toml", "colour"]),
        ("not TOML", "= = =".to_owned(), &["in.toml", "line 1"]),
        ("empty", String::new(), &["in.toml", "missing"]),
        ("unknown weights", format!("weights = \"even\"\n{good}"), &["in.toml", "noise", "equal"]),
        (
            "weights of another estimator",
            format!("weights = \"equal\"\n{}", good.replacen("measured-motion", "hill", 1)),
            &["weights = \"equal\"", "measured-motion"],
        ),
    ];
    for (what, input, parts) in &cases {
        println!("{what}");
        check_refused("in.toml", input.as_bytes(), &["identify", model, "--experiment", "in.toml", "--json"], parts);
    }
    // Coordinates are eliminated there, and the physical parameters found as the noise weighs the lumped ones.
    fails(&["identify", "models/two_carts.tpm", "--set", "weights=equal"], 2, &["weights = \"equal\"", "equations"]);
}

/// The commonest mistakes with every verb end with what to type instead.
#[test]
fn mistakes_are_answered_by_what_to_type() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("log.csv"), log().join("\n")).expect("writable");
    std::fs::write(at("other.json"), "{\"m\": 1}").expect("writable");
    let (run, other, folder_of_none) = (at("log.csv"), at("other.json"), at("campaign"));
    let model = "models/mass_spring_drag.tpm";
    let there = "type the path of a file that is there";
    let cases: Vec<(Vec<&str>, Vec<&str>)> = vec![
        (vec!["identfy", model], vec!["similar subcommands exist", "'identify'"]),
        (vec!["check", "none.tpm"], vec![there, "tpm init NAME"]),
        (vec!["check", "models"], vec!["type the path of a file in it"]),
        (vec!["identify", "none.tpm"], vec![there]),
        (vec!["identify", model, "--log", "none.csv"], vec!["none.csv", there]),
        (vec!["check", "models/mass_spring_drag.toml"], vec!["give one ending in .tpm"]),
        (
            vec!["validate", model, "--log", &run, "--params", &run],
            vec!["type a file that `tpm identify --json -o FILE` wrote"],
        ),
        (vec!["identify", model, "--set", "seed"], vec!["not of the form NAME=VALUE"]),
        (vec!["identify", model, "--set", "plant.paramters.m=3"], vec!["did you mean plant.parameters.m"]),
        (vec!["identify", model, "--log", &run, "--freeze", "mass=2"], vec!["there are m, k1, k2"]),
        (vec!["identify", model, "--log", &run, "--domain", "frequency"], vec!["harmonics, time"]),
        (vec!["identify", "models/emps.tpm"], vec!["name another (--experiment FILE)"]),
        (vec!["inspect", model, &run], vec!["type `tpm inspect"]),
        (vec!["validate", model, "--log", &run], vec!["--params <FILE>"]),
        (vec!["validate", model, "--log", &run, "--params", &other], vec!["tpm identify --json"]),
        (vec!["generate", model], vec!["--lang <LANG>"]),
        (vec!["generate", model, "--lang", "cpp"], vec!["a similar value exists: 'c'"]),
        (vec!["campaign", "next", &folder_of_none], vec!["tpm campaign start MODEL"]),
        (vec!["simulate", model, "--play", &run], vec!["tpm campaign next DIR -o FILE"]),
        (vec!["study", model, "--seeds", "1"], vec!["2..="]),
        (vec!["frf", &run, "--input", "force", "--measured", "x"], vec!["--map force="]),
        (vec!["fit", &run, "--input", "u", "--measured", "x", "--order", "3"], vec!["such as 1/3"]),
        (vec!["linearize", model, "--value", "m=2"], vec!["--value k1=VALUE --value k2=VALUE"]),
        (vec!["trajectories", model], vec!["--value NAME=VALUE"]),
        (vec!["compare", &other, &other], vec!["no result of an identification"]),
        (vec!["explain", "nosie"], vec!["tpm explain"]),
        (vec!["init", "2cart"], vec!["tpm init my_cart"]),
        (vec!["fmt"], vec!["type `tpm fmt MODEL.tpm` for files"]),
        (vec!["fmt", "none.tpm"], vec![there, "tpm init NAME"]),
        (vec!["fmt", "models"], vec!["type the path of a file in it"]),
        (vec!["fmt", "models/mass_spring_drag.toml"], vec!["give one ending in .tpm"]),
        (vec!["fmt", "-", model], vec!["type `tpm fmt models/mass_spring_drag.tpm` for files"]),
        (vec!["lsp", model], vec!["nothing such as `models/mass_spring_drag.tpm`", "type `tpm check FILE`"]),
        (vec!["lsp", "--port", "9000"], vec!["nothing such as `--port`", "type `tpm check FILE`"]),
    ];
    for (arguments, said) in &cases {
        fails(arguments, 2, said);
    }
}

#[test]
fn an_experiment_of_another_model_is_named() {
    let of = |name: &str| root().join("models").join(name).display().to_string();
    let (model, other) = (of("two_carts.tpm"), of("mass_spring_drag.toml"));
    let plain = format!("{other}: there is no physical parameter `m`");
    let changed = format!("{other} with the changes that were asked for: there is no physical parameter `m`");
    fails(&["identify", &model, "--experiment", &other], 2, &[&plain]);
    fails(&["simulate", &model, "--experiment", &other, "--set", "seed=2", "-o", "-"], 2, &[&changed]);
}

/// Every verb with mistakes that people make: the folder holds the cart of `tpm init`, a log of it and a result, and things that stand in
/// the wrong place. Each is refused with the place and what to type instead.
#[test]
fn common_mistakes_of_every_verb_say_what_to_type() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = folder.path();
    let done = |arguments: &[&str]| {
        let output = tpm_in(at, arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    done(&["init", "cart"]);
    done(&["simulate", "cart.tpm", "-o", "run.csv"]);
    done(&["identify", "cart.tpm", "--log", "run.csv", "--refine", "none", "--json", "-o", "r.json"]);
    done(&["campaign", "start", "cart.tpm", "runs"]);
    std::fs::create_dir(at.join("folder")).expect("a folder");
    std::fs::write(at.join("text.txt"), "text\n").expect("writable");
    std::fs::write(at.join("other.json"), "{\"a\": 1}\n").expect("writable");
    std::fs::write(at.join("other.toml"), "x = 1\n").expect("writable");
    std::fs::write(at.join("values.toml"), "m = 2\nd = 3\nk = 40\nlambda = 0.3\nw = 3\n").expect("writable");
    let before = names(at);
    let [no_file, no_folder] = ["type the path of a file that is there", "there is no folder nowhere"];
    let file_of = "type the name of a file, not that of a folder";
    let cases: &[(&str, &[&str])] = &[
        ("cart.tpm", &["a verb comes first: type `tpm identify cart.tpm`"]),
        ("run.csv", &["a verb comes first: type `tpm inspect run.csv`"]),
        ("chek cart.tpm", &["unrecognized subcommand 'chek'", "'check'"]),
        ("actuator cart.tpm", &["--motor <FILE>", "`tpm actuator cart.tpm --motor motors.toml"]),
        ("actuator cart.tpm --motor none.toml --params other.toml", &["other.toml", "`x`", "it has m, d, k"]),
        ("campaign start cart.tpm text.txt", &["text.txt: this is no folder", "a path where nothing is yet"]),
        ("campaign next folder", &["folder holds no campaign", "`tpm campaign start MODEL folder`"]),
        ("campaign next runs -o folder", &["folder", file_of]),
        ("campaign submit runs none.csv", &["none.csv", no_file]),
        ("campaign result runs --report text.txt", &["--report text.txt", "type the name of a folder"]),
        ("campaign run cart.tpm --machine cat --report text.txt", &["--report text.txt", "type the name of a folder"]),
        ("check none.tpm", &["none.tpm", no_file, "`tpm init NAME`"]),
        ("check run.csv", &["run.csv:1:1", "give one ending in .tpm"]),
        ("check folder", &["folder", "type the path of a file in it"]),
        ("compare r.json other.json", &["other.json", "type a file that `tpm identify --json -o FILE` wrote"]),
        ("compare r.json cart.tpm", &["cart.tpm", "type a file that `tpm identify --json -o FILE` wrote"]),
        ("completions tcsh", &["'tcsh'", "bash, elvish, fish"]),
        ("design cart.tpm --best 0", &["'0' for '--best <N>'", "`tpm design cart.tpm"]),
        ("design cart.tpm --best many", &["'many'", "a whole number is wanted"]),
        ("design cart.tpm -o folder", &["folder", file_of]),
        ("design cart.tpm --write new", &["--write is for a mechanism", "cart.tpm", "leave it out"]),
        (
            "excite cart.tpm --sample-time 1ms --duration 1 -o e.csv noise --std 1 --hold-time 1",
            &["'1ms'", "a number is wanted"],
        ),
        (
            "excite cart.tpm --sample-time 0.01 --duration -1 -o e.csv noise --std 1 --hold-time 0.1",
            &["a run of -1 s", "lengthen it"],
        ),
        ("expand cart.tpm --harmonics -1", &["'-1' for '--harmonics <N>'", "a whole number is wanted"]),
        ("expand cart.tpm -o nowhere/table.md", &[no_folder, "type a path in a folder that is there"]),
        ("explain nosie", &["`nosie`", "`tpm explain` lists all fields"]),
        ("export cart.tpm --params r.json --to mjcf", &["--into robot.xml"]),
        ("export cart.tpm --params r.json --to casadi --into run.csv", &["--into is for --to mjcf"]),
        ("export cart.tpm --params r.json --to mjcf --into run.csv", &["run.csv", "no XML"]),
        ("export cart.tpm --params r.json --to arduino", &["give a folder with -o"]),
        ("export cart.tpm --params none.json --to st", &["none.json", no_file]),
        ("feedforward cart.tpm --loop run.csv --params values.toml", &["run.csv: line 1", "the file is TOML"]),
        ("feedforward cart.tpm --loop none.toml --params run.csv", &["run.csv", "type a file ending in .toml"]),
        ("fit none.csv --input u --measured x --order 1/2", &["none.csv", no_file]),
        ("fit run.csv --input u --measured x --order 2", &["`2` is not of the form M/N, such as 1/3"]),
        ("fmt none.tpm", &["none.tpm", no_file]),
        ("frf folder --input u --measured x", &["folder", "type the path of a file in it"]),
        ("frf run.csv --input v --measured x", &["run.csv:1", "no column `v`", "--map v="]),
        ("generate cart.tpm --lang c", &["give a folder with -o"]),
        ("generate cart.tpm --lang c -o -", &["give a folder with -o"]),
        ("generate cart.tpm --lang rust -o - --check", &["--check", "-o"]),
        ("generate cart.tpm --lang c -o text.txt", &["-o text.txt is no folder"]),
        ("identifiability cart.tpm --pattern fast", &["no pattern named `fast`", "leave out --pattern"]),
        ("identify cart.tpm --log run.csv --report text.txt", &["--report text.txt", "type the name of a folder"]),
        ("identify cart.tpm --log run.csv --json -o folder", &["folder", file_of]),
        ("identify cart.tpm --log run.csv -o nowhere/result.json", &[no_folder]),
        ("identify cart.tpm --log run.csv --map y=x", &["--map", "`y`", "it has x, u"]),
        ("identify cart.tpm --log run.csv --freeze z=1", &["--freeze z", "there are m, d, k"]),
        ("identify cart.tpm --log run.csv --set seed=3", &["--set", "cannot be used with --log"]),
        ("identify cart.tpm --experiment run.csv", &["run.csv", "an experiment is TOML"]),
        ("identify cart.tpm --set sede=3", &["--set sede", "did you mean seed"]),
        ("import run.csv -o arm.tpm", &["run.csv:1:1", "no XML", "export the description again"]),
        (
            "inertias cart.tpm r.json",
            &["--description <FILE>", "`tpm inertias arm.tpm result.json --description arm.urdf"],
        ),
        ("inertias cart.tpm r.json --description run.csv", &["run.csv:1:1", "no XML", "export the description again"]),
        ("inertias cart.tpm other.json --description run.csv", &["other.json", "`tpm identify --json -o FILE` wrote"]),
        ("init cart", &["cart.tpm is there already", "type another name"]),
        ("init nowhere/cart", &[no_folder, "type a path in a folder that is there"]),
        ("inspect cart.tpm run.csv", &["type `tpm inspect run.csv cart.tpm`"]),
        ("inspect run.csv --report text.txt", &["--report text.txt", "type the name of a folder"]),
        ("linearize cart.tpm --at y=0", &["--at y", "it has x, u"]),
        ("lsp cart.tpm", &["type `tpm check FILE`"]),
        ("man text.txt", &["text.txt", "type another path"]),
        ("payload cart.tpm r.json other.json", &["other.json", "`tpm identify --json -o FILE` wrote"]),
        ("payload cart.tpm r.json r.json", &["r.json", "no body with unknown inertia"]),
        ("payload cart.tpm r.json r.json --density light", &["'light'", "a number is wanted"]),
        ("regulate cart.tpm --sample-time 0.001", &["give --params FILE or --value m=VALUE"]),
        ("schema cart.toml", &["experiment, motors, run", "`tpm schema experiment`"]),
        ("simulate cart.tpm --play run.csv", &["run.csv", "type the file that `tpm campaign next DIR -o FILE` wrote"]),
        ("split cart.tpm --value m=heavy", &["--value m=heavy", "write a number, such as 2"]),
        ("study cart.tpm --seeds 2 --report text.txt", &["--report text.txt", "type the name of a folder"]),
        ("trajectories cart.tpm", &["give it with --value NAME=VALUE or in --params FILE"]),
        ("validate cart.tpm --log run.csv --params other.toml", &["other.toml", "`m`", "give a result of this model"]),
        (
            "validate cart.tpm --log run.csv --params run.csv",
            &["run.csv", "type a file that `tpm identify --json -o FILE` wrote"],
        ),
    ];
    for (line, parts) in cases {
        let arguments: Vec<&str> = line.split(' ').collect();
        let output = tpm_in(at, &arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{line}: {message}");
        assert!(output.stdout.is_empty(), "{line} printed a result");
        for part in *parts {
            assert!(message.contains(part), "{line}: `{part}` is missing in\n{message}");
        }
    }
    assert_eq!(names(at), before, "something was left behind");
}

/// `-` is standard output for every verb that writes a file.
#[test]
fn a_dash_is_standard_output() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = folder.path();
    let printed = |line: &str| {
        let arguments: Vec<&str> = line.split(' ').collect();
        let output = tpm_in(at, &arguments);
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("text")
    };
    printed("init cart");
    printed("campaign start cart.tpm runs");
    let arm = r#"<robot name="arm"><link name="base"/><link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link><joint name="q1" type="revolute">
      <parent link="base"/><child link="upper"/><axis xyz="0 1 0"/><limit effort="10" velocity="1" lower="-1" upper="1"/></joint></robot>"#;
    std::fs::write(at.join("arm.urdf"), arm).expect("writable");
    let before = names(at);
    assert!(printed("campaign next runs -o -").starts_with("t_s,x_ref"));
    assert!(printed("generate cart.tpm --lang rust -o -").contains("pub "));
    let noise = "excite cart.tpm --sample-time 0.01 --duration 5 -o - noise --std 1 --hold-time 0.1";
    assert!(printed(noise).starts_with("t_s,"));
    assert!(printed("simulate cart.tpm -o -").starts_with("t_s,x,u"));
    assert!(printed("import arm.urdf -o -").contains("model "));
    assert_eq!(names(at), before, "something was written");
}

#[test]
fn counts_of_a_turn_are_refused_on_a_length() {
    let sets = ["--set", "plant.sensors.x.step=0", "--set", "plant.sensors.x.counts=4000"];
    let arguments = [&["identify", "models/mass_spring_drag.tpm"], &sets[..]].concat();
    fails(&arguments, 2, &["plant.sensors.x.counts", "the coordinate is no angle", "(step)"]);
}

#[test]
fn given_values_name_what_is_missing_or_unknown() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = folder.path();
    let model = "model Two {\n    coordinate x [m];\n    input u [N];\n    parameter m1 [kg], m2 [kg], d [N*s/m], k [N/m];\n\n    \
                 (m1 + m2)*ddot(x) + d*dot(x) + k*x = u;\n}\n";
    std::fs::write(at.join("two.tpm"), model).expect("writable");
    let generate = |values: &str| {
        std::fs::write(at.join("values.toml"), values).expect("writable");
        let output = tpm_in(at, &["generate", "two.tpm", "--lang", "c", "--params", "values.toml", "-o", "out"]);
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(generate("m1 = 1\nm2 = 2\nd = 0.5\nk = 3\n").0, Some(0));
    // Sums may be given themselves.
    assert_eq!(generate("m1_plus_m2 = 3\nd = 0.5\nk = 3\n").0, Some(0));
    for (values, words) in [
        ("m1 = 1\nd = 0.5\nk = 3\n", &["values.toml", "`m1_plus_m2`", "add lines for m2"][..]),
        ("m1 = 1\nm2 = 2\nm3 = 1\nd = 0.5\nk = 3\n", &["no parameter `m3`", "m1, m2, d, k"]),
        ("[parameters]\nm1 = 1\n", &["`parameters` is a table", "NAME = VALUE", "`m = 1.5`"]),
        ("m1 = [1]\n", &["`m1` must be a number", "`m = 1.5`"]),
    ] {
        let (code, said) = generate(values);
        assert_eq!(code, Some(2), "{values}");
        assert!(words.iter().all(|word| said.contains(word)), "{values}: {said}");
    }
}

#[test]
fn results_with_numbers_beyond_any_size_are_refused_at_their_place() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = folder.path();
    let own = |value: &str, std: &str| {
        format!(
            "{{\"schema\": \"tpm.identification/2\", \"model\": \"M\", \"parameters\": [{{\"name\": \"m\", \"unit\": \"kg\", \"value\": {value}, \
             \"std\": {std}, \"prior\": null, \"status\": \"identified\"}}], \"covariance\": [[1e-4]]}}"
        )
    };
    for (value, std, place) in
        [("1e308", "0.01", "`parameters.0.value` is 1e308"), ("2", "1e-200", "`parameters.0.std` is 1e-200")]
    {
        std::fs::write(at.join("a.json"), own("2", "0.01")).expect("writable");
        std::fs::write(at.join("b.json"), own(value, std)).expect("writable");
        let output = tpm_in(at, &["compare", "a.json", "b.json"]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && said.contains("b.json") && said.contains(place), "{said}");
    }
}
