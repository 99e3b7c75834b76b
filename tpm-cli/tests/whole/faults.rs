//! Faults and kills at the system calls of every verb that writes: what is there is as it was or as it is to be, and the next command
//! that is let alone leaves nothing else.
//!
//! A run of the tests tries some of the faults of some verbs; `.ci/faults` tries all of all of them.

#![cfg(target_os = "linux")]

use crate::support::{root, skipped};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Mutex;

/// The files of a folder and of the folders in it, by their paths.
type State = BTreeMap<String, Vec<u8>>;

fn state(folder: &Path) -> State {
    fn add(folder: &Path, prefix: &str, into: &mut State) {
        for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.path().is_dir() {
                into.insert(format!("{name}/"), Vec::new());
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

/// Puts files where there are none.
fn lay_out(state: &State, folder: &Path) {
    for (name, text) in state {
        let path = folder.join(name);
        let made = if name.ends_with('/') { std::fs::create_dir_all(path) } else { std::fs::write(path, text) };
        made.expect("writable");
    }
}

/// A verb that writes.
struct Writing {
    arguments: &'static str,
    /// Files of which an earlier version is there.
    replaces: &'static [&'static str],
    /// Whether every file stands for itself, so that some of them may be there: the runs of a campaign, from which it goes on, and the
    /// steps of the sample.
    stepwise: bool,
}

/// A verb whose files are all there or none.
const fn writes(arguments: &'static str, replaces: &'static [&'static str]) -> Writing {
    Writing { arguments, replaces, stepwise: false }
}

/// A verb that goes on from what is there.
const fn goes_on(arguments: &'static str) -> Writing {
    Writing { arguments, replaces: &[], stepwise: true }
}

/// Verbs that stand for the ways in which files are written, and need shipped files alone.
const SOME: [Writing; 7] = [
    writes("init my_cart", &[]),
    writes("linearize mass_spring_drag.tpm --json -o seen.json", &["seen.json"]),
    writes("expand mass_spring_drag.tpm -o table.md", &["table.md"]),
    writes("generate mass_spring_drag.tpm --lang c -o made", &[]),
    writes("fmt bent.tpm", &[]),
    writes("simulate mass_spring_drag.tpm -o log.csv", &["log.csv"]),
    goes_on("campaign start mass_spring_drag.tpm c"),
];

/// All others, which read what earlier ones wrote.
const OTHERS: [Writing; 42] = [
    goes_on("demo shown"),
    writes("init slider --log run.csv", &[]),
    writes("check mass_spring_drag.tpm run.csv --against result.json --junit out.xml", &["out.xml"]),
    writes("inspect run.csv -o seen.txt", &["seen.txt"]),
    writes("inspect run.csv --report report", &[]),
    writes(
        "identify mass_spring_drag.tpm --log run.csv --hold zoh --refine none --json -o found.json",
        &["found.json"],
    ),
    writes("identify mass_spring_drag.tpm --log run.csv --hold zoh --refine none --report report", &[]),
    goes_on("identify mass_spring_drag.tpm --set schedule.max_runs=2 --set schedule.measure_time=3 --runs runs"),
    writes("validate mass_spring_drag.tpm --params result.json --log run.csv --hold zoh -o seen.txt", &["seen.txt"]),
    writes("validate mass_spring_drag.tpm --params result.json --log run.csv --hold zoh --report report", &[]),
    writes("compare result.json result.json -o seen.txt", &["seen.txt"]),
    writes("compare result.json result.json --report report", &[]),
    writes("identifiability mass_spring_drag.tpm -o seen.txt", &["seen.txt"]),
    writes(
        "design mass_spring_drag.tpm --set schedule.measure_time=3 --set control.sample_time=0.01 -o seen.txt",
        &["seen.txt"],
    ),
    writes("design arm.tpm --experiment arm.experiment.toml --starts 1 --write proposed", &[]),
    goes_on("campaign next begun -o next.csv"),
    goes_on("campaign submit begun played.csv"),
    goes_on("campaign run mass_spring_drag.tpm --machine cat --runs runs"),
    writes(
        "study mass_spring_drag.tpm --seeds 2 --set schedule.max_runs=1 --set schedule.measure_time=3 -o seen.txt",
        &["seen.txt"],
    ),
    writes(
        "study mass_spring_drag.tpm --seeds 2 --set schedule.max_runs=1 --set schedule.measure_time=3 --report report",
        &[],
    ),
    writes("import arm.urdf -o other.tpm", &[]),
    writes("inertias arm.tpm arm.json --description arm.urdf --urdf new.urdf", &["new.urdf"]),
    writes("inertias arm.tpm arm.json --description arm.urdf --mjcf new.xml", &[]),
    writes("inertias arm.tpm arm.json --description arm.urdf -o seen.txt", &["seen.txt"]),
    writes("export mass_spring_drag.tpm --params result.json --to casadi -o seen.py", &["seen.py"]),
    writes("export mass_spring_drag.tpm --params result.json --to arduino -o library", &[]),
    writes("payload arm.tpm arm.json arm.json -o seen.txt", &["seen.txt"]),
    writes(
        "project mass_spring_drag.tpm --onto mass_spring_drag.tpm --params result.json --value lambda=0.3 --value w=2 -o seen.txt",
        &["seen.txt"],
    ),
    writes("trajectories mass_spring_drag.tpm --params values.toml -o seen.txt", &["seen.txt"]),
    writes("trajectories mass_spring_drag.tpm --params values.toml --plot seen.svg", &["seen.svg"]),
    writes(
        "excite mass_spring_drag.tpm --sample-time 0.01 --duration 2 --limit 100 -o noise.csv noise --std 20 --hold-time 0.02",
        &[],
    ),
    writes("frf run.csv --input u --measured x --hold zoh --high 8 -o seen.txt", &["seen.txt"]),
    writes("frf run.csv --input u --measured x --hold zoh --high 8 --plot seen.svg", &["seen.svg"]),
    writes("fit run.csv --input u --measured x --hold zoh --high 8 --order 0/2 -o seen.txt", &["seen.txt"]),
    writes("fit run.csv --input u --measured x --hold zoh --high 8 --order 0/2 --plot seen.svg", &["seen.svg"]),
    writes(
        "regulate mass_spring_drag.tpm --params parameters.toml --sample-time 0.001 --derivative-filter 0.02 -o seen.txt",
        &["seen.txt"],
    ),
    writes("split mass_spring_drag.tpm -o seen.txt", &["seen.txt"]),
    writes(
        "actuator cart_pendulum.tpm --motor cart_pendulum_motors.toml --params cart_pendulum_example.toml -o seen.txt",
        &["seen.txt"],
    ),
    writes(
        "feedforward cart_pendulum.tpm --loop cart_pendulum_loop.toml --params cart_pendulum_example.toml --plot seen.svg",
        &["seen.svg"],
    ),
    writes("generate mass_spring_drag.tpm --lang rust --strokes -o made", &[]),
    writes("schema experiment -o seen.json", &["seen.json"]),
    writes("man pages", &[]),
];

/// What the verbs read: shipped files, and what these commands make of them.
const MADE: [&str; 9] = [
    "simulate mass_spring_drag.tpm --set schedule.measure_time=3 --set control.sample_time=0.01 -o run.csv",
    "identify mass_spring_drag.tpm --log run.csv --hold zoh --refine none --json -o result.json",
    "import arm.urdf -o arm.tpm",
    "simulate arm.tpm --experiment arm.experiment.toml --set control.sample_time=0.01 --set schedule.measure_time=4 -o arm.csv",
    "identify arm.tpm --log arm.csv --prior arm.prior.toml --hold zoh --refine none --json -o arm.json",
    "campaign start mass_spring_drag.tpm begun --set schedule.measure_time=3",
    "campaign next begun -o play.csv",
    "simulate mass_spring_drag.tpm --play play.csv -o played.csv",
    "fmt mass_spring_drag.tpm",
];

/// A joint with a link.
const ARM: &str = "<robot name=\"arm\"><link name=\"base\"/>
<link name=\"upper\"><inertial><origin xyz=\"0.1 0 0\"/><mass value=\"2\"/>
<inertia ixx=\"0.01\" iyy=\"0.02\" izz=\"0.02\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>
<joint name=\"shoulder\" type=\"revolute\"><parent link=\"base\"/><child link=\"upper\"/><axis xyz=\"0 1 0\"/>
<limit effort=\"20\" velocity=\"3\" lower=\"-2\" upper=\"2\"/></joint>
</robot>\n";

/// System calls by which files come to be, in groups whose members stand for each other on different machines.
const CALLS: [&str; 7] = [
    "write",
    "rename,renameat,renameat2",
    "fsync,fdatasync",
    "mkdir,mkdirat",
    "link,linkat,fchmod",
    "ftruncate",
    REMOVALS,
];

/// Where the system refuses to remove a file, it stays until it does.
const REMOVALS: &str = "unlink,unlinkat,rmdir";

/// What becomes of a call: no room, a device that fails, a signal that arrives meanwhile, the end of the program.
const FAULTS: [&str; 4] = ["error=ENOSPC", "error=EIO", "error=EINTR", "signal=KILL"];

/// Limits of the size of a file, in blocks of 512 bytes: a write that passes one is short, and the next one is refused.
const BLOCKS: [usize; 6] = [0, 1, 2, 4, 8, 16];

/// A fault of a run.
#[derive(Clone, Debug)]
enum Fault {
    /// At the n-th call of a group.
    Call { calls: &'static str, what: &'static str, at: usize },
    /// Files end after so many blocks.
    Blocks(usize),
}

impl Fault {
    fn is_kill(&self) -> bool {
        matches!(self, Fault::Call { what: "signal=KILL", .. })
    }

    /// Whether a file that is neither may be left, under a name of its own.
    fn may_leave(&self) -> bool {
        self.is_kill() || matches!(self, Fault::Call { calls: REMOVALS, .. })
    }
}

/// The program that is tried: that of the tests, or a faster one.
fn tpm() -> PathBuf {
    std::env::var_os("TPM").map_or_else(|| PathBuf::from(env!("CARGO_BIN_EXE_tpm")), PathBuf::from)
}

/// Runs a command of the tool in a folder, under the tracer whose words these are, or under none.
fn run(folder: &Path, arguments: &str, tracer: &[String]) -> Output {
    let words: Vec<&str> = arguments.split(' ').collect();
    let mut command = match tracer {
        [] => Command::new(tpm()),
        [program, rest @ ..] => {
            let mut command = Command::new(program);
            command.args(rest).arg(tpm());
            command
        }
    };
    command.args(words).current_dir(folder).output().expect("a program")
}

/// The words before a command that is traced into a file.
fn strace(trace: &Path, calls: &str, inject: Option<&str>) -> Vec<String> {
    let mut words = ["strace", "-f", "-qq", "-o"].map(str::to_owned).to_vec();
    words.push(trace.display().to_string());
    words.extend(["-e".to_owned(), format!("trace={calls}"), "-e".to_owned(), "signal=none".to_owned()]);
    if let Some(what) = inject {
        words.extend(["-e".to_owned(), format!("inject={calls}:{what}")]);
    }
    words
}

/// The files before any command.
fn begin(all: bool) -> State {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shipped = root().join("models");
    let names = [
        "mass_spring_drag.tpm",
        "mass_spring_drag.toml",
        "cart_pendulum.tpm",
        "cart_pendulum_motors.toml",
        "cart_pendulum_loop.toml",
        "cart_pendulum_example.toml",
    ];
    for name in names {
        std::fs::copy(shipped.join(name), folder.path().join(name)).expect("a shipped file");
    }
    let model = std::fs::read_to_string(shipped.join(names[0])).expect("a shipped model");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("writable");
    write("bent.tpm", &model.replace("    ", " "));
    if all {
        write("arm.urdf", ARM);
        write("parameters.toml", "m = 2.0\nk1 = 40.0\nk2 = 1.0\n");
        write("values.toml", "m = 2.0\nk1 = 40.0\nk2 = 1.0\nlambda = 0.3\nw = 2.0\n");
        for arguments in MADE {
            let output = run(folder.path(), arguments, &[]);
            assert!(output.status.success(), "{arguments}: {output:?}");
        }
    }
    state(folder.path())
}

/// What is tried of a verb, and with how many faults.
struct Trial<'a> {
    writing: &'a Writing,
    before: State,
    after: State,
    /// Calls of every group in a run that is let alone.
    calls: Vec<(&'static str, usize)>,
}

impl<'a> Trial<'a> {
    /// Plays the verb alone.
    ///
    /// # Errors
    /// When it fails, writes nothing, or writes something else the next time.
    fn new(writing: &'a Writing, begin: &State) -> Result<Self, String> {
        let mut before = begin.clone();
        before.extend(writing.replaces.iter().map(|name| ((*name).to_owned(), b"earlier".to_vec())));
        let trial = Trial { writing, before, after: State::new(), calls: Vec::new() };
        let [(after, output), (again, _)] = [trial.played(&[]), trial.played(&[])];
        let arguments = writing.arguments;
        // A program that says nothing is no machine; what stands there before it is asked is written all the same.
        let may_fail = arguments.contains("--machine");
        if !may_fail && output.status.code().is_none_or(|code| code > 1) {
            return Err(format!("{arguments}: {output:?}"));
        }
        let other: Vec<&String> =
            after.iter().filter(|(name, text)| again.get(*name) != Some(text)).map(|(name, _)| name).collect();
        if !other.is_empty() || after.len() != again.len() {
            return Err(format!("{arguments}: two runs differ in {other:?}"));
        }
        if !may_fail && trial.before == after {
            return Err(format!("{arguments} writes nothing"));
        }
        let trace = tempfile::NamedTempFile::new().expect("a temporary file");
        trial.played(&strace(trace.path(), &CALLS.join(","), None));
        let trace = std::fs::read_to_string(trace.path()).expect("a trace");
        // A line begins with the number of the process.
        let names: Vec<&str> = trace
            .lines()
            .filter_map(|line| line.split([' ', '(']).find(|word| word.starts_with(char::is_alphabetic)))
            .collect();
        let calls =
            CALLS.map(|calls| (calls, names.iter().filter(|name| calls.split(',').any(|call| call == **name)).count()));
        Ok(Trial { after, calls: calls.to_vec(), ..trial })
    }

    /// A run in a folder of its own, with what is there afterwards.
    fn played(&self, tracer: &[String]) -> (State, Output) {
        let place = tempfile::tempdir().expect("a temporary folder");
        lay_out(&self.before, place.path());
        let output = run(place.path(), self.writing.arguments, tracer);
        (state(place.path()), output)
    }

    /// All faults; of a group with many calls the first and the last.
    fn faults(&self) -> Vec<Fault> {
        const ENDS: usize = 5;
        let of_group = |&(calls, count): &(&'static str, usize)| {
            let places = (1..=count).filter(move |at| *at <= ENDS || at + ENDS > count);
            let each = places.flat_map(move |at| FAULTS.map(|what| Fault::Call { calls, what, at }));
            each.collect::<Vec<_>>()
        };
        self.calls.iter().flat_map(of_group).chain(BLOCKS.map(Fault::Blocks)).collect()
    }

    /// One fault, after which the state is the old one or the new one; whether there was such a call.
    ///
    /// # Errors
    /// When it is neither, or another run does not mend it.
    fn suffers(&self, fault: &Fault) -> Result<bool, String> {
        let arguments = self.writing.arguments;
        let place = tempfile::tempdir().expect("a temporary folder");
        let traced = tempfile::NamedTempFile::new().expect("a temporary file");
        lay_out(&self.before, place.path());
        let tracer = match fault {
            Fault::Call { calls, what, at } => strace(traced.path(), calls, Some(&format!("{what}:when={at}"))),
            Fault::Blocks(blocks) => {
                ["sh", "-c", &format!("ulimit -f {blocks}; exec \"$@\""), "sh"].map(str::to_owned).to_vec()
            }
        };
        let output = run(place.path(), arguments, &tracer);
        let trace = std::fs::read_to_string(traced.path()).expect("a trace");
        let happened = match fault {
            Fault::Call { .. } if fault.is_kill() => {
                std::os::unix::process::ExitStatusExt::signal(&output.status) == Some(9)
            }
            Fault::Call { .. } => trace.contains("(INJECTED)"),
            Fault::Blocks(_) => !output.status.success(),
        };
        let said = |what: &str| Err(format!("{what}: {arguments}, {fault:?}: {output:?}"));
        let found = state(place.path());
        let (old, new) = (&self.before, &self.after);
        for (name, text) in &found {
            let is_whole = old.get(name) == Some(text) || new.get(name) == Some(text);
            let is_known = old.contains_key(name) || new.contains_key(name);
            if !is_whole && (is_known || !fault.may_leave()) {
                return said(&format!("{name} is neither old nor new"));
            }
        }
        let is_either = found == *old || found == *new;
        if !is_either && !fault.may_leave() && !self.writing.stepwise {
            return said(&format!("some are old and some new: {:?}", found.keys()));
        }
        if output.status.success() && found != *new && !fault.may_leave() {
            return said("it says that it is done");
        }
        if found != *new {
            // The same command, let alone, comes to the end and leaves nothing of the one before.
            let again = run(place.path(), arguments, &[]);
            let found = state(place.path());
            if found != *new {
                return said(&format!("then {again:?} leaves {:?}", found.keys()));
            }
        }
        Ok(happened)
    }
}

/// As many faults as a run of the tests has time for; `TPM_FAULTS` tries all of all verbs, `TPM` with another program.
#[test]
fn faults_and_kills_at_system_calls_leave_the_old_or_the_new() {
    if !Command::new("strace").args(["-qq", "-o", "/dev/null", "true"]).status().is_ok_and(|status| status.success()) {
        return skipped("no strace that may trace");
    }
    let all = std::env::var_os("TPM_FAULTS").is_some();
    let begin = begin(all);
    let others = OTHERS.iter().filter(|_| all);
    let verbs: Vec<(usize, &Writing)> = SOME.iter().chain(others).enumerate().collect();
    let verbs = Mutex::new(verbs.into_iter());
    let found = Mutex::new(Found::default());
    // Commands wait for the disk more than they compute.
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                while let Some((number, writing)) = { verbs.lock().expect("no panic").next() } {
                    // Others of every verb, so that together they have every fault.
                    let step = if all { 1 } else { 7 };
                    let own = tried(writing, &begin, number % step, step);
                    println!("{}: {:?}, {} failed", writing.arguments, own.injected, own.failures.len());
                    found.lock().expect("no panic").add(own);
                }
            });
        }
    });
    let Found { injected, failures } = found.into_inner().expect("no panic");
    let total: usize = injected.values().sum();
    println!("{total} faults and kills: {injected:?}");
    assert!(failures.is_empty(), "{} of {total}:\n{}", failures.len(), failures.join("\n"));
    assert!(total >= if all { 1000 } else { 30 }, "{total} faults were injected");
}

/// What came of faults.
#[derive(Default)]
struct Found {
    /// How many of which kind there were.
    injected: BTreeMap<String, usize>,
    failures: Vec<String>,
}

impl Found {
    fn add(&mut self, other: Found) {
        for (kind, count) in other.injected {
            *self.injected.entry(kind).or_default() += count;
        }
        self.failures.extend(other.failures);
    }
}

/// Tries some of the faults of a verb: one in `step`.
fn tried(writing: &Writing, begin: &State, first: usize, step: usize) -> Found {
    let mut found = Found::default();
    match Trial::new(writing, begin) {
        Ok(trial) => {
            for fault in trial.faults().iter().skip(first).step_by(step) {
                let kind = match fault {
                    Fault::Call { what, .. } => (*what).to_owned(),
                    Fault::Blocks(_) => "short writes".to_owned(),
                };
                match trial.suffers(fault) {
                    Ok(happened) => *found.injected.entry(kind).or_default() += usize::from(happened),
                    Err(failure) => found.failures.push(failure),
                }
            }
        }
        Err(failure) => found.failures.push(failure),
    }
    found
}
