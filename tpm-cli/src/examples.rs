//! What one would type: an example of every verb, in its help and behind every command line that is refused.

use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue};
use clap::{Command, Error};

/// Verbs, and for each a command line that is understood. Their files are those of a user.
const EXAMPLES: [(&str, &str); 44] = [
    ("actuator", "tpm actuator cart.tpm --motor motors.toml --params values.toml"),
    ("campaign next", "tpm campaign next my_campaign"),
    ("campaign result", "tpm campaign result my_campaign"),
    ("campaign run", "tpm campaign run cart.tpm --machine \"python3 adapter.py\""),
    ("campaign start", "tpm campaign start cart.tpm my_campaign"),
    ("campaign submit", "tpm campaign submit my_campaign run1.csv"),
    ("check", "tpm check cart.tpm"),
    ("compare", "tpm compare before.json after.json"),
    ("complete", "tpm complete result.json -o completed.tpm"),
    ("completions", "tpm completions bash"),
    ("convert", "tpm convert log.mat --to csv"),
    ("demo", "tpm demo"),
    ("design", "tpm design cart.tpm --experiment cart.toml"),
    (
        "excite chirp",
        "tpm excite cart.tpm --sample-time 0.001 --duration 20 -o run.csv chirp --amplitude 2 --low 0.1 --high 10",
    ),
    (
        "excite multisine",
        "tpm excite cart.tpm --sample-time 0.001 --duration 20 -o run.csv multisine --rms 2 --low 0.1 --high 10 --period-samples 10000",
    ),
    ("excite noise", "tpm excite cart.tpm --sample-time 0.001 --duration 20 -o run.csv noise --std 2 --hold-time 0.01"),
    ("expand", "tpm expand cart.tpm --format markdown"),
    ("explain", "tpm explain schedule.stages"),
    ("export", "tpm export cart.tpm --params result.json --to casadi -o cart.py"),
    ("feedforward", "tpm feedforward cart.tpm --loop loop.toml --params values.toml"),
    ("fit", "tpm fit log.csv --input u --measured x --order 1/3"),
    ("flags", "tpm flags"),
    ("fmt", "tpm fmt cart.tpm"),
    ("frf", "tpm frf log.csv --input u --measured x"),
    ("generate", "tpm generate cart.tpm --lang c --params result.json -o generated"),
    ("identifiability", "tpm identifiability cart.tpm --value lambda=1/2"),
    ("identify", "tpm identify cart.tpm --log log.csv --map x=position"),
    ("import", "tpm import arm.urdf -o arm.tpm"),
    ("inertias", "tpm inertias arm.tpm result.json --description arm.urdf --urdf identified.urdf"),
    ("init", "tpm init cart"),
    ("inspect", "tpm inspect log.csv cart.tpm"),
    ("language", "tpm language"),
    ("linearize", "tpm linearize cart.tpm --at x=0"),
    ("lsp", "tpm lsp"),
    ("man", "tpm man manual_pages"),
    ("payload", "tpm payload arm.tpm empty.json loaded.json"),
    ("project", "tpm project arm_links.tpm --onto arm.tpm --params arm_links.toml --value A=0.2 --value w=2"),
    ("regulate", "tpm regulate cart.tpm --sample-time 0.001 --params result.json"),
    ("schema", "tpm schema experiment"),
    ("simulate", "tpm simulate cart.tpm --experiment cart.toml -o run.csv"),
    ("split", "tpm split cart.tpm"),
    ("study", "tpm study cart.tpm --experiment cart.toml --seeds 100"),
    ("trajectories", "tpm trajectories cart.tpm --params values.toml --plot trajectories.svg"),
    ("validate", "tpm validate cart.tpm --params result.json --log other.csv"),
];

/// A command whose help ends with an example of every verb, what it ended with, and `ending` where a verb has no exit codes of its own.
pub(crate) fn with_examples(command: Command, path: &str, ending: &'static str) -> Command {
    let example = EXAMPLES.iter().find(|(verb, _)| *verb == path).map(|(_, line)| format!("Example: {line}"));
    let own = command.get_after_help().map(ToString::to_string);
    let common = own.as_ref().is_none_or(|own| !own.contains("Exit codes")).then(|| ending.to_owned());
    let parts: Vec<String> = example.into_iter().chain(own).chain(common).collect();
    // `-1` behind a flag is its value, so that what is said of it names the flag.
    let command = command.mut_args(|arg| {
        if arg.is_positional() || !arg.get_action().takes_values() { arg } else { arg.allow_negative_numbers(true) }
    });
    command.after_help(parts.join("\n\n")).mut_subcommands(|verb| {
        let path = [path, verb.get_name()].join(" ");
        with_examples(verb, path.trim(), ending)
    })
}

/// A refused command line, with the example of its verb instead of advice to pass a flag as a value.
pub(crate) fn with_remedy(mut error: Error, command: &Command, words: impl IntoIterator<Item = String>) -> Error {
    let (mut path, mut verb) = (Vec::new(), command);
    let mut file = None;
    for word in words {
        file.get_or_insert_with(|| word.clone());
        if let Some(next) = verb.find_subcommand(word) {
            path.push(next.get_name());
            verb = next;
        }
    }
    let path = path.join(" ");
    if let (true, Some(tip)) = (path.is_empty(), file.as_deref().and_then(verb_of)) {
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![StyledStr::from(tip)]));
        return error;
    }
    let Some((_, example)) = EXAMPLES.iter().find(|(verb, _)| *verb == path || verb.starts_with(&format!("{path} ")))
    else {
        return error;
    };
    let mut tips = match error.remove(ContextKind::Suggested) {
        Some(ContextValue::StyledStrs(tips)) => tips,
        _ => Vec::new(),
    };
    tips.retain(|tip| !tip.to_string().contains("as a value"));
    tips.extend(number_wanted(&error).map(StyledStr::from));
    tips.push(StyledStr::from(format!("type, for example, `{example}`")));
    error.insert(ContextKind::Suggested, ContextValue::StyledStrs(tips));
    error
}

/// What to type where a file stands in place of a verb.
fn verb_of(file: &str) -> Option<String> {
    let (_, kind) = file.rsplit_once('.')?;
    let line = match kind.to_ascii_lowercase().as_str() {
        "tpm" => format!("tpm identify {file}"),
        "urdf" => format!("tpm init NAME --from {file}"),
        "csv" | "mat" | "mcap" | "parquet" | "npz" | "npy" | "json" | "jsonl" | "wpilog" | "db3" => {
            format!("tpm inspect {file}")
        }
        _ => return None,
    };
    Some(format!("a verb comes first: type `{line}`"))
}

/// What is wanted where a value is no number; the words of the standard library are for programmers.
fn number_wanted(error: &Error) -> Option<&'static str> {
    let told = error.to_string();
    if told.contains("invalid float literal") {
        Some("a number is wanted, such as 0.001, without a unit")
    } else if told.contains("invalid digit found in string") {
        Some("a whole number is wanted, such as 8")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::{EXAMPLES, with_remedy};
    use crate::command;

    fn verbs(command: &clap::Command, path: &str, found: &mut Vec<String>) {
        for verb in command.get_subcommands().filter(|verb| verb.get_name() != "help") {
            let path = [path, verb.get_name()].join(" ").trim().to_owned();
            if verb.has_subcommands() {
                verbs(verb, &path, found);
            } else {
                found.push(path);
            }
        }
    }

    #[test]
    fn every_verb_has_an_example_and_every_example_is_understood() {
        let mut found = Vec::new();
        verbs(&command(), "", &mut found);
        found.sort();
        assert_eq!(found, EXAMPLES.map(|(verb, _)| verb));
        for (verb, line) in EXAMPLES {
            let words = line.split(' ').map(|word| word.trim_matches('"'));
            if let Err(error) = command().try_get_matches_from(words) {
                // Quotes are a shell's.
                assert!(line.contains('"'), "{verb}: {error}");
            }
        }
    }

    /// Every command that has no commands below it, as its own help is printed.
    fn helps(command: &clap::Command, found: &mut Vec<(String, String)>) {
        for verb in command.get_subcommands().filter(|verb| verb.get_name() != "help") {
            helps(verb, found);
            found.push((verb.get_name().to_owned(), verb.clone().render_long_help().to_string()));
        }
    }

    #[test]
    fn every_help_says_its_exit_codes() {
        let mut found = Vec::new();
        helps(&command(), &mut found);
        for (verb, help) in found {
            assert_eq!(help.matches("Exit codes: 0").count(), 1, "{verb}: {help}");
        }
    }

    #[test]
    fn a_refused_line_ends_with_what_to_type() {
        for (line, example) in [
            ("tpm check", "`tpm check cart.tpm`"),
            ("tpm expand cart.tpm --harmonics -3", "`tpm expand cart.tpm --format markdown`"),
            ("tpm campaign submit folder", "`tpm campaign submit my_campaign run1.csv`"),
            ("tpm excite cart.tpm", "`tpm excite cart.tpm --sample-time 0.001"),
            ("tpm frf --log log.csv", "`tpm frf log.csv --input u --measured x`"),
        ] {
            let words = || line.split(' ').map(str::to_owned);
            let error = command().try_get_matches_from(words()).expect_err(line);
            let told = with_remedy(error, &command(), words()).to_string();
            assert!(told.contains(&format!("type, for example, {example}")), "{told}");
            assert!(!told.contains("as a value"), "{told}");
        }
        for (line, said) in [
            ("tpm cart.tpm", "a verb comes first: type `tpm identify cart.tpm`"),
            ("tpm expand cart.tpm --harmonics -3", "'-3' for '--harmonics <N>'"),
            ("tpm identify cart.tpm --log run.csv --period 2s", "a number is wanted, such as 0.001, without a unit"),
            ("tpm design cart.tpm --best many", "a whole number is wanted, such as 8"),
        ] {
            let words = || line.split(' ').map(str::to_owned);
            let error = command().try_get_matches_from(words()).expect_err(line);
            let told = with_remedy(error, &command(), words().skip(1)).to_string();
            assert!(told.contains(said), "{told}");
        }
    }
}
