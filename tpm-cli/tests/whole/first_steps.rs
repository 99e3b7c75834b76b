//! What a new user types first: `init`, `explain`, `schema`, completions, manual pages, the table of flags.

use crate::support::{fails, names, printed, printed_in, root};

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
        let output = crate::support::tpm_in(at, arguments);
        assert_eq!(output.status.code(), Some(2));
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(text.contains(said), "{text}");
    }
    assert!(!at.join("other.tpm").exists());
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
    fails(&["explain", "nosie"], 2, &["no file has a field `nosie`", "explain"]);
    let schema: serde_json::Value = serde_json::from_str(&printed(&["schema", "experiment", "-o", "-"])).expect("JSON");
    assert_eq!(schema["additionalProperties"], false);
}

#[test]
fn the_command_line_tells_of_itself() {
    let page = std::fs::read_to_string(root().join("docs/flags.md")).expect("the table of flags");
    assert_eq!(page, printed(&["flags"]), "docs/flags.md is what `tpm flags` prints");
    // A flag has one meaning: rows of the same flag that ask for different values are listed here with the reason why they are one.
    let same = [("`--output`", "where results go: a file, or a folder for several files")];
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
