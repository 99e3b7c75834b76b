//! Input that was made to break the tool: an answer or a named refusal, in bounded time, and never a panic.

use crate::support::{fails, names, root, skipped, tpm_in};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// The longest time of the processor, in seconds, that an answer may take. The limit of a release is 2 s; a build with checks and
/// without its optimisation takes several times as long.
const LONGEST: u32 = 10;

/// The most memory that an answer may take, in kilobytes.
const MOST_MEMORY: u32 = 1 << 20;

/// What a model is asked for.
const QUESTIONS: [&[&str]; 4] = [&["check"], &["expand"], &["split"], &["generate", "--lang", "c", "-o", "out"]];

/// The tool's answer about a file in a folder, within the limits, which the system holds the process to: who passes them is killed.
fn asked(folder: &Path, question: &[&str], file: &Path) -> Output {
    let limited = format!("ulimit -v {MOST_MEMORY}; ulimit -t {LONGEST}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &limited, env!("CARGO_BIN_EXE_tpm"), question[0]]).arg(file).args(&question[1..]);
    command.current_dir(folder).stdin(Stdio::null()).output().expect("the tool runs")
}

/// An answer or a refusal within the limits, in short lines.
fn check_bounded(questions: &[&[&str]], file: &Path) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for question in questions {
        let output = asked(folder.path(), question, file);
        let said = String::from_utf8_lossy(&output.stderr);
        let shown: String = said.chars().take(1000).collect();
        assert!(
            matches!(output.status.code(), Some(0..=2)),
            "{question:?} {}: {}, {shown}",
            file.display(),
            output.status
        );
        let longest = said.lines().map(|line| line.chars().count()).max();
        assert!(longest.unwrap_or(0) < 1000, "{question:?} {}: {shown}", file.display());
    }
}

/// The model of one coordinate `q` with this equation, under a pattern.
fn with_equation(equation: &str) -> String {
    format!(
        "model A {{ coordinate q; input u; parameter m, k; constant c = 0; m*ddot(q) + {equation} = u; pattern {{ amplitude l; frequency w; q = rest_to_rest(l, 2*w, 5); }} }}"
    )
}

#[test]
fn models_that_broke_the_tool_are_answered_or_refused() {
    let Some(data) = std::env::var_os("TPM_DATA") else {
        skipped("TPM_DATA does not name the folder with the models that fuzzing found");
        return;
    };
    let folder = PathBuf::from(data).join("fuzz");
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("readable").path()).collect();
    files.retain(|path| path.file_name().is_some_and(|name| name != "README.md"));
    files.sort();
    assert!(files.len() > 30, "{files:?}");
    // Tests run on as many threads as there are cores; these wait for processes.
    std::thread::scope(|scope| {
        for part in 0..2 {
            let files = &files;
            scope.spawn(move || files.iter().skip(part).step_by(2).for_each(|file| check_bounded(&QUESTIONS, file)));
        }
    });
}

#[test]
fn short_texts_that_ask_for_too_much_are_answered_or_refused() {
    let digits = "7".repeat(20_000);
    let equations = [
        "k*(dot(q) - pi)^48".to_owned(),
        "k*(q + 1)^1000".to_owned(),
        "k*((q)^15)^17".to_owned(),
        "k*sin(sin(44))*q".to_owned(),
        format!("k*{digits}*q"),
        format!("k*({digits}*q + 1)^9"),
        "1/k*q".to_owned(),
        "k*q/c".to_owned(),
    ];
    let folder = tempfile::tempdir().expect("a temporary folder");
    for equation in equations {
        let file = folder.path().join("in.tpm");
        std::fs::write(&file, with_equation(&equation)).expect("writable");
        check_bounded(&QUESTIONS, &file);
        check_bounded(&[&["linearize"]], &file);
    }
}

#[test]
fn what_is_too_large_is_named_with_its_limit_and_the_way_out() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("in.tpm");
    std::fs::write(&file, with_equation("k*(q + 1)^1000")).expect("writable");
    let file = file.to_str().expect("plain");
    fails(&["expand", file], 2, &["the table would have up to", "more than the limit of 256 MB", "--allow-large"]);
    std::fs::write(file, with_equation("k*abs(ddot(q)^400)")).expect("writable");
    fails(
        &["expand", file],
        2,
        &["`k*abs(ddot(q)^400)` takes more than the 1000 million operations", "lower its exponents", "--allow-large"],
    );
    std::fs::write(file, with_equation("k*q/c")).expect("writable");
    fails(&["check", file], 2, &["a division by zero", "this divisor is 0 at the values of the model's constants"]);
}

#[test]
fn generated_names_never_begin_with_a_digit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("in.tpm"), with_equation("1/k*q")).expect("writable");
    for language in ["rust", "c"] {
        let output = tpm_in(folder.path(), &["generate", "in.tpm", "--lang", language, "-o", "out"]);
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let header = std::fs::read_to_string(folder.path().join("out/a.h")).expect("readable");
    assert!(header.contains("lumped_1_per_k"), "{header}");
}

#[test]
fn experiments_that_ask_for_too_much_are_refused_by_field() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (set, said) in [
        ("schedule.measure_time=1e300", "schedule.measure_time"),
        ("schedule.measure_time=inf", "must be finite"),
        ("schedule.settle_periods=1000000000000", "schedule.settle_periods"),
        ("stability.points=1000000000000", "stability.points"),
        ("plant.sub_steps=1000000000000", "plant.sub_steps"),
    ] {
        let model = root().join("models/mass_spring_drag.tpm");
        let output = tpm_in(folder.path(), &["identify", model.to_str().expect("plain"), "--set", set]);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{set}: {text}");
        assert!(text.contains(said) && text.chars().count() < 400, "{set}: {text}");
    }
}

#[cfg(unix)]
#[test]
fn special_files_stay_what_they_are() {
    use std::os::unix::fs::FileTypeExt as _;
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = tpm_in(folder.path(), &["expand", model, "-o", "/dev/null"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(std::fs::metadata("/dev/null").expect("there").file_type().is_char_device());
    let output = tpm_in(folder.path(), &["expand", model, "-o", "/dev/stdout"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("Harmonic coefficient table"));
    std::os::unix::fs::symlink("target.md", folder.path().join("link.md")).expect("a link");
    let output = tpm_in(folder.path(), &["expand", model, "-o", "link.md"]);
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(names(folder.path()), ["link.md", "target.md"]);
    fails(&["check", "/dev/zero"], 2, &["/dev/zero", "longer than 16 MiB"]);
}

#[test]
fn of_two_processes_on_one_folder_one_works_and_the_other_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = root().join("models/mass_spring_drag.tpm");
    for pair in 0..3 {
        let store = folder.path().join(format!("pair-{pair}"));
        let begin = || {
            Command::new(env!("CARGO_BIN_EXE_tpm"))
                .args(["identify", model.to_str().expect("plain"), "--set", "schedule.max_runs=4", "--runs"])
                .arg(&store)
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .expect("the tool runs")
        };
        let outputs = [begin(), begin()].map(|child| child.wait_with_output().expect("it ends"));
        let told =
            outputs.iter().filter(|output| String::from_utf8_lossy(&output.stderr).contains("is in use by process"));
        let told = told.count();
        let worked = outputs.iter().filter(|output| matches!(output.status.code(), Some(0 | 1))).count();
        // When the first has ended before the second begins, both work.
        assert!(told + worked == 2 && worked >= 1, "{outputs:?}");
        let left: Vec<String> =
            names(&store).into_iter().filter(|name| name.starts_with('.') || name.ends_with("lock")).collect();
        assert!(left.is_empty(), "{left:?}");
    }
}

/// A study that is stopped and killed at moments that no test chooses, and gone on with, prints what the unbroken one prints.
#[cfg(unix)]
#[test]
fn a_study_that_was_stopped_or_killed_ends_as_the_unbroken_one() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    let study = ["study", model, "--json", "--seeds", "12", "--set", "schedule.max_runs=3"];
    let kept = [&study[..], &["--resume", "kept"]].concat();
    let unbroken = tpm_in(folder.path(), &study);
    let begin = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpm"));
        command.args(&kept).current_dir(folder.path()).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().expect("the tool runs")
    };
    let path = folder.path().join("kept/study.json");
    for signal in ["-INT", "-KILL", "-TERM"] {
        let mut tool = begin();
        // Whatever it has done by then, there is a file.
        while !path.exists() && tool.try_wait().expect("it can be asked").is_none() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        // It may have ended before, which is a moment like others.
        let _ = Command::new("kill").args([signal, &tool.id().to_string()]).stderr(Stdio::null()).status();
        tool.wait().expect("it ends");
    }
    let resumed = tpm_in(folder.path(), &kept);
    assert_eq!(resumed.status.code(), unbroken.status.code(), "{}", String::from_utf8_lossy(&resumed.stderr));
    assert_eq!(String::from_utf8_lossy(&resumed.stdout), String::from_utf8_lossy(&unbroken.stdout));
    assert_eq!(names(&folder.path().join("kept")), ["study.json"]);
    let other = [&kept[..], &["--set", "seed=5"]].concat();
    let refused = tpm_in(folder.path(), &other);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(2) && said.contains("belongs to another experiment"), "{said}");
}
