//! Faults and kills at the system calls of every verb that writes: what is there is as it was or as it is to be, and the next command
//! that is let alone leaves nothing else.

use crate::support::{root, skipped};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

/// The files of a folder and of the folders in it, by their paths.
type State = BTreeMap<String, Vec<u8>>;

fn state(folder: &Path) -> State {
    fn add(folder: &Path, prefix: &str, into: &mut State) {
        for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.path().is_dir() {
                add(&entry.path(), &format!("{name}/"), into);
            } else {
                into.insert(name, std::fs::read(entry.path()).expect("a file"));
            }
        }
    }
    let mut found = State::new();
    add(folder, "", &mut found);
    found
}

/// A verb that writes, and the shipped files that it reads.
struct Writing {
    arguments: &'static [&'static str],
    reads: &'static [&'static str],
    /// Whether an earlier version of its files is there, which it replaces.
    replaces: bool,
}

const CARTS: &[&str] = &["mass_spring_drag.tpm", "mass_spring_drag.toml"];
const WRITING: [Writing; 7] = [
    Writing { arguments: &["init", "my_cart"], reads: &[], replaces: false },
    Writing {
        arguments: &["linearize", "mass_spring_drag.tpm", "--json", "-o", "seen.json"],
        reads: CARTS,
        replaces: true,
    },
    Writing { arguments: &["expand", "mass_spring_drag.tpm", "-o", "table.md"], reads: CARTS, replaces: true },
    Writing {
        arguments: &["generate", "mass_spring_drag.tpm", "--lang", "c", "-o", "made"],
        reads: CARTS,
        replaces: false,
    },
    Writing { arguments: &["fmt", "bent.tpm"], reads: CARTS, replaces: true },
    Writing { arguments: &["simulate", "mass_spring_drag.tpm", "-o", "log.csv"], reads: CARTS, replaces: true },
    Writing { arguments: &["campaign", "start", "mass_spring_drag.tpm", "c"], reads: CARTS, replaces: false },
];

/// System calls by which files come to be, in groups whose members stand for each other on different machines.
const CALLS: [&str; 5] =
    ["write", "rename,renameat,renameat2", "fsync,fdatasync", "mkdir,mkdirat", "link,linkat,fchmod"];

impl Writing {
    /// The folder before the command.
    fn begin(&self, folder: &Path) {
        for name in self.reads {
            std::fs::copy(root().join("models").join(name), folder.join(name)).expect("a shipped file");
        }
        let model = root().join("models/mass_spring_drag.tpm");
        let bent = std::fs::read_to_string(model).expect("a shipped model").replace("    ", " ");
        std::fs::write(folder.join("bent.tpm"), bent).expect("writable");
        if self.replaces {
            for name in ["seen.json", "table.md", "log.csv"] {
                std::fs::write(folder.join(name), "earlier").expect("writable");
            }
        }
    }

    fn run(&self, folder: &Path, injected: Option<(&str, &str)>) -> Output {
        let mut command = match injected {
            None => Command::new(env!("CARGO_BIN_EXE_tpm")),
            Some((calls, what)) => {
                let mut command = Command::new("strace");
                command.args(["-f", "-qq", "-o", "/dev/null", "-e", &format!("trace={calls}")]);
                command.args(["-e", &format!("inject={calls}:{what}"), env!("CARGO_BIN_EXE_tpm")]);
                command
            }
        };
        command.args(self.arguments).current_dir(folder).output().expect("a program")
    }
}

/// As many faults as a run of the tests has time for; `TPM_FAULTS` sets how many of every kind a verb gets.
#[cfg(target_os = "linux")]
#[test]
fn faults_and_kills_at_system_calls_leave_the_old_or_the_new() {
    if !Command::new("strace").args(["-qq", "-o", "/dev/null", "true"]).status().is_ok_and(|status| status.success()) {
        return skipped("no strace that may trace");
    }
    let most: usize = std::env::var("TPM_FAULTS").ok().and_then(|count| count.parse().ok()).unwrap_or(2);
    let mut injected = 0;
    for writing in &WRITING {
        let clean = tempfile::tempdir().expect("a temporary folder");
        writing.begin(clean.path());
        let old = state(clean.path());
        let output = writing.run(clean.path(), None);
        assert!(output.status.code().is_some_and(|code| code < 2), "{:?}: {output:?}", writing.arguments);
        let new = state(clean.path());
        assert_ne!(old, new, "{:?} writes nothing", writing.arguments);
        for calls in CALLS {
            for what in ["error=ENOSPC", "error=EIO", "signal=KILL"] {
                for at in 1..=most {
                    let place = tempfile::tempdir().expect("a temporary folder");
                    writing.begin(place.path());
                    let output = writing.run(place.path(), Some((calls, &format!("{what}:when={at}"))));
                    let said = format!("{:?}, {calls} {what} {at}: {output:?}", writing.arguments);
                    let found = state(place.path());
                    if output.status.success() && found == new {
                        // There was no such call, or nothing depends on it.
                        break;
                    }
                    injected += 1;
                    for (name, text) in found.iter().filter(|_| !what.contains("KILL")) {
                        assert!(old.get(name) == Some(text) || new.get(name) == Some(text), "{name}: {said}");
                    }
                    for (name, text) in &found {
                        let whole = old.get(name) == Some(text) || new.get(name) == Some(text);
                        let is_known = old.contains_key(name) || new.contains_key(name);
                        assert!(whole || !is_known, "{name} is neither as it was nor as it is to be: {said}");
                    }
                    // The files of a campaign stand for themselves: what is there is whole, and the campaign goes on from it.
                    if !what.contains("KILL") && writing.arguments[0] != "campaign" {
                        assert!(found == old || found == new, "{:?}: {said}", found.keys());
                    }
                    if found != new {
                        // The same command, let alone, comes to the end and leaves nothing of the one before.
                        let again = writing.run(place.path(), None);
                        let names = |state: &State| state.keys().cloned().collect::<Vec<_>>();
                        let found = state(place.path());
                        assert_eq!(names(&found), names(&new), "{said}, then {again:?}");
                        assert!(found == new, "{said}, then {again:?}");
                    }
                }
            }
        }
    }
    assert!(injected >= 20, "{injected} faults were injected");
    println!("{injected} faults and kills");
}
