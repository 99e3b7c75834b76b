//! What a new user types first: `init`, `explain`, `schema`, completions, manual pages, the table of flags.

use crate::support::{fails, names, printed, printed_in, result_alone, root, tpm_in};

#[test]
fn what_init_writes_runs_as_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let said = printed_in(at, &["init", "my_cart"], 0);
    assert!(said.contains("tpm identify my_cart.tpm"), "{said}");
    assert_eq!(names(at), ["my_cart.toml", "my_cart.tpm"]);
    assert!(printed_in(at, &["check", "my_cart.tpm"], 0).contains("model MyCart"));
    let identified = printed_in(at, &["identify", "my_cart.tpm"], 0);
    assert!(identified.contains("\nconverged;") && identified.contains("rank 3 of 3"), "{identified}");
    printed_in(at, &["simulate", "my_cart.tpm", "-o", "run.csv"], 0);
    // The command that is printed for a log is one that runs.
    let said = printed_in(at, &["init", "logged", "--log", "run.csv"], 0);
    let command = said.lines().find_map(|line| line.strip_prefix("next: tpm ")).expect("a command").to_owned();
    let arguments: Vec<&str> = command.split(' ').chain(["--refine", "none"]).collect();
    assert!(printed_in(at, &arguments, 0).contains("rank 3 of 3"));
    for (arguments, said) in [
        (&["init", "my_cart"][..], "is there already; type another name"),
        (&["init", "2cart"], "no name of a model: type letters"),
        (&["init", "other", "--log", "none.csv"], "none.csv"),
    ] {
        let output = tpm_in(at, arguments);
        assert_eq!(output.status.code(), Some(2));
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(text.contains(said), "{text}");
    }
    assert!(!at.join("other.tpm").exists());
}

#[test]
fn the_sample_is_identified_from_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let said = printed_in(at, &["demo"], 0);
    assert!(said.contains("tpm_demo/report/report.html") && said.contains("rank 4 of 4"), "{said}");
    let page = std::fs::read_to_string(at.join("tpm_demo/report/report.html")).expect("a page");
    assert!(page.contains("Of 4 parameters: 4 identified."), "a conclusion");
    // The commands that are printed do the same again, and a second time nothing is lost.
    for command in said.lines().filter_map(|line| line.strip_prefix("$ tpm ")) {
        printed_in(at, &command.split(' ').collect::<Vec<_>>(), 0);
    }
    printed_in(at, &["demo"], 0);
    // The true values are found within their deviations; five of them once in two million times by chance.
    let log = ["identify", "tpm_demo/slide.tpm", "--log", "tpm_demo/run.csv", "--hold", "zoh", "--json"];
    let found: serde_json::Value = serde_json::from_str(&printed_in(at, &log, 0)).expect("JSON");
    for (own, truth) in found["parameters"].as_array().expect("a list").iter().zip([8.0, 25.0, 12.0, 3.0]) {
        let (value, std) = (own["value"].as_f64().expect("a value"), own["std"].as_f64().expect("a deviation"));
        assert!((value - truth).abs() < 5.0 * std, "{own}, and {truth} is true");
    }
    // What somebody changed is not overwritten.
    std::fs::write(at.join("tpm_demo/slide.toml"), "mine").expect("writable");
    let output = crate::support::tpm_in(at, &["demo"]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && text.contains("tpm demo tpm_demo_2"), "{text}");
    assert_eq!(std::fs::read_to_string(at.join("tpm_demo/slide.toml")).expect("there"), "mine");
}

#[test]
fn a_log_without_a_model_gets_models_whose_commands_paste() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    printed_in(at, &["init", "cart"], 0);
    printed_in(at, &["simulate", "cart.tpm", "-o", "plain.csv"], 0);
    // The same run with a header as drives write it, in other units, under a name with a blank.
    let plain = std::fs::read_to_string(at.join("plain.csv")).expect("a log");
    let names: Vec<&str> = plain.lines().next().expect("a header").split(',').collect();
    let place = |name: &str| names.iter().position(|own| *own == name).expect("a column");
    let (t, x, u) = (place("t_s"), place("x"), place("u"));
    let mut text = String::from("Time [s];Way of the cart [mm];Motor \"force\" [N]\n");
    for line in plain.lines().skip(1) {
        let fields: Vec<f64> = line.split(',').map(|field| field.parse().unwrap_or(f64::NAN)).collect();
        text.push_str(&format!("{:.4};{:.6};{:.6}\n", fields[t], 1e3 * fields[x], fields[u]));
    }
    std::fs::write(at.join("my run.csv"), text.replace("\"force\"", "$force")).expect("writable");
    let said = printed_in(at, &["identify", "my run.csv"], 1);
    assert!(said.contains("Way of the cart [mm]") && said.contains("a length") && said.contains("a force"), "{said}");
    let commands: Vec<&str> = said.lines().skip_while(|line| !line.starts_with("spring:")).skip(1).take(2).collect();
    assert!(said.contains("slider:") && !said.contains("pendulum:") && commands.len() == 2, "{said}");
    // A shell takes them as they are printed.
    let tool = env!("CARGO_BIN_EXE_tpm");
    for (i, command) in commands.into_iter().enumerate() {
        let line = command.trim().replacen("tpm", tool, 1);
        let line = if i == 1 { format!("{line} --refine none --json") } else { line };
        let output = std::process::Command::new("sh").args(["-c", &line]).current_dir(at).output().expect("a shell");
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        if i == 1 {
            let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
            for (own, truth) in found["parameters"].as_array().expect("a list").iter().zip([2.0, 3.0, 40.0]) {
                let value = own["value"].as_f64().expect("a value");
                assert!((value / truth - 1.0).abs() < 0.02, "{own}, and {truth} is true");
            }
        }
    }
    // What cannot be a machine's log is said, and a model under any name stays a model.
    let rows: String = (0..40).map(|k| format!("{k},{},{}\n", 1 + k % 2, 20 + k % 3)).collect();
    std::fs::write(at.join("rates.csv"), format!("t_s,speed,temperature\n{rows}")).expect("writable");
    let output = crate::support::tpm_in(at, &["identify", "rates.csv"]);
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no template fits these columns"), "{output:?}");
    for (arguments, said) in [
        (&["identify", "my run.csv", "--json"][..], "is a log, and a model stands before it"),
        (&["init", "arm", "--log", "my run.csv", "--template", "pendulum"], "no columns for `pendulum`"),
        (&["init", "arm", "--template", "pendulum", "--from", "arm.urdf"], "--from"),
    ] {
        let output = crate::support::tpm_in(at, arguments);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && text.contains(said), "{arguments:?}: {text}");
    }
    std::fs::copy(at.join("cart.tpm"), at.join("cart.txt")).expect("copied");
    assert!(printed_in(at, &["identify", "cart.txt", "--experiment", "cart.toml"], 0).contains("rank 3 of 3"));
}

#[test]
fn fields_are_explained() {
    let gains = printed(&["explain", "kp"]);
    assert!(gains.contains("control.feedback.kp (experiment file): number; must be given"), "{gains}");
    assert!(gains.contains("feedback.kp (run file)"), "{gains}");
    let word = printed(&["explain", "estimator"]);
    assert!(word.contains("measured-motion: Inverse dynamics"), "{word}");
    let motor = printed(&["explain", "motors.F.torque_constant"]);
    assert!(motor.contains("N m/A"), "{motor}");
    assert!(printed(&["explain"]).contains("plant.sensors.NAME.noise"));
    // Words of the language come with a whole model, which `tpm check` passes.
    for word in ["nonlinear", "mechanism", "rest_to_rest"] {
        let said = printed(&["explain", word]);
        let model: String =
            said.lines().filter_map(|line| line.strip_prefix("    ")).map(|line| format!("{line}\n")).collect();
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("model.tpm"), &model).expect("writable");
        assert!(printed_in(folder.path(), &["check", "model.tpm"], 0).contains("linear in"), "{said}");
        assert!(said.starts_with(&format!("{word} (model language): ")), "{said}");
    }
    assert!(printed(&["explain", "mechanism"]).contains("body upper on slide"));
    let both = printed(&["explain", "harmonics"]);
    assert!(both.contains("(model language)") && both.contains("(experiment file)"), "{both}");
    fails(&["explain", "nosie"], 2, &["no file has a field `nosie`", "explain"]);
    let schema: serde_json::Value = serde_json::from_str(&printed(&["schema", "experiment", "-o", "-"])).expect("JSON");
    assert_eq!(schema["additionalProperties"], false);
}

#[test]
fn the_command_line_tells_of_itself() {
    let page = std::fs::read_to_string(root().join("docs/flags.md")).expect("the table of flags");
    assert_eq!(page, printed(&["flags"]), "docs/flags.md is what `tpm flags` prints");
    let language = std::fs::read_to_string(root().join("docs/language.md")).expect("the reference of the language");
    assert_eq!(language, printed(&["language"]), "docs/language.md is what `tpm language` prints");
    // A flag has one meaning: rows of the same flag that ask for different values are listed here with the reason why they are one.
    let same = [
        ("`--against`", "what is found is held against it: another transfer function, or an earlier result"),
        (
            "`--limit`",
            "what may not be passed: by the only input of an excitation, or by coordinates, rates and inputs by name",
        ),
        ("`--to`", "the form in which something is written: a log, or a model"),
        ("`--output`", "where results go: a file, or a folder for several files"),
    ];
    let mut flags: Vec<&str> = page.lines().filter(|line| line.starts_with("| `--")).collect();
    flags.iter_mut().for_each(|line| *line = line.split('|').nth(1).unwrap_or_default().trim());
    assert!(flags.len() > 50, "the table has rows");
    let twice: Vec<&str> = flags.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| pair[0]).collect();
    let unlisted: Vec<&&str> = twice.iter().filter(|flag| !same.iter().any(|(listed, _)| listed == *flag)).collect();
    assert!(unlisted.is_empty(), "one flag with two kinds of values: {unlisted:?}");
    assert!(same.iter().all(|(flag, why)| twice.contains(flag) && !why.is_empty()), "listed, but not so: {same:?}");
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        assert!(printed(&["completions", shell]).contains("identifiability"), "{shell}");
    }
    let folder = tempfile::tempdir().expect("a folder");
    printed_in(folder.path(), &["man", "pages"], 0);
    let pages = names(&folder.path().join("pages"));
    assert!(
        pages.contains(&"tpm-identify.1".to_owned()) && pages.contains(&"tpm-campaign-next.1".to_owned()),
        "{pages:?}"
    );
    assert!(printed(&["identify", "--help"]).contains("Exit codes: 0 done, 1"));
}

#[test]
fn flags_mean_one_thing_on_logs_and_on_simulated_machines() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    printed_in(at, &["init", "cart"], 0);
    let held: serde_json::Value =
        serde_json::from_str(&printed_in(at, &["identify", "cart.tpm", "--freeze", "m=2", "--json"], 0)).expect("JSON");
    let mass = &held["parameters"][0];
    assert_eq!((&mass["status"], &mass["value"]), (&"frozen".into(), &2.0.into()));
    // Values in TOML do where a result in JSON does.
    std::fs::write(at.join("values.toml"), "m = 2\nd = 3\nk = 40\n").expect("writable");
    printed_in(at, &["simulate", "cart.tpm", "-o", "run.csv"], 0);
    let validated = ["validate", "cart.tpm", "--params", "values.toml", "--log", "run.csv", "--hold", "zoh"];
    assert!(printed_in(at, &validated, 0).contains("nothing is fitted"));
    let code = printed_in(at, &["generate", "cart.tpm", "--lang", "rust", "--params", "values.toml"], 0);
    assert!(code.contains("IDENTIFIED"), "{code}");
}

/// Who has no log yet begins with a machine: its model is laid out, and the experiment beside it finds the parameters of the simulated machine.
#[test]
fn every_template_begins_without_a_log() {
    for template in ["spring", "slider", "motor", "pendulum", "two_masses", "cart_pole"] {
        let folder = tempfile::tempdir().expect("a folder");
        printed_in(folder.path(), &["init", "axis", "--template", template], 0);
        assert_eq!(names(folder.path()), ["axis.toml", "axis.tpm"]);
        printed_in(folder.path(), &["check", "axis.tpm"], 0);
        printed_in(folder.path(), &["fmt", "--check", "axis.tpm"], 0);
        let result = result_alone(&tpm_in(folder.path(), &["identify", "axis.tpm", "--json"]));
        let truth: toml::Table =
            std::fs::read_to_string(folder.path().join("axis.toml")).expect("a file").parse().expect("TOML");
        let truth = &truth["plant"]["parameters"];
        for own in result["parameters"].as_array().expect("a list") {
            let name = own["name"].as_str().expect("a name");
            let [value, std] = ["value", "std"].map(|field| own[field].as_f64().expect("a number"));
            let wanted = truth[name].as_float().expect("a number");
            assert!((value - wanted).abs() < 4.0 * std + 1e-9, "{template}: {name} {value} +- {std}, {wanted}");
            assert!(std < 0.01 * wanted.abs().max(0.1), "{template}: {name} {value} +- {std}");
        }
    }
}
