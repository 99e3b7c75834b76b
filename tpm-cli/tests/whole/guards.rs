//! What is read on cannot hang, swell, leak or speak to the terminal: each test stands for a kind of attack.

use crate::support::{names, root, tpm_in};
use std::fmt::Write as _;
use std::io::Write as _;
#[cfg(unix)]
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A folder with one file.
fn with(name: &str, text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join(name), text).expect("writable");
    folder
}

/// A shipped model.
fn shipped(name: &str) -> String {
    std::fs::read_to_string(root().join("models").join(name)).expect("a shipped model")
}

/// The command ends with this exit code and says all of this on standard error.
fn says(output: &Output, code: i32, parts: &[&str]) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    let shown: String = text.chars().take(2000).collect();
    assert_eq!(output.status.code(), Some(code), "{shown}");
    for part in parts {
        assert!(text.contains(part), "`{part}` is missing in\n{shown}");
    }
    text
}

/// Masses in a ring, each driven by its neighbour.
fn ring(n: usize) -> String {
    let list = |letter: &str| (0..n).map(|i| format!("{letter}{i}")).collect::<Vec<_>>().join(", ");
    let mut text = format!("model Ring {{\n  coordinate {}; input {}; parameter m;\n", list("x"), list("u"));
    for i in 0..n {
        let _ = writeln!(text, "  m*ddot(x{i}) + m*x{} = u{i};", (i + 1) % n);
    }
    let moves: String = (0..n).map(|i| format!(" x{i} = A*cos(w*t);")).collect();
    let _ = writeln!(text, "  pattern {{ amplitude A; frequency w;{moves} }}");
    text + "}\n"
}

#[test]
fn rings_of_masses_are_linearised_or_refused() {
    let folder = with("ring.tpm", &ring(8));
    let answered =
        tpm_in(folder.path(), &["linearize", "ring.tpm", "--value", "m=1", "--measured", "x0", "--input", "u0"]);
    says(&answered, 0, &[]);
    // The eight roots of s^16 = 1 that belong to s^2 = -e^(2 pi i k/8): the poles of a ring lie on the circle.
    let text = String::from_utf8_lossy(&answered.stdout).into_owned();
    assert!(text.contains("det M = m^8") && text.contains("s^16"), "{text}");
    // Forty masses took minutes, or were refused.
    let folder = with("ring.tpm", &ring(40));
    let answered =
        tpm_in(folder.path(), &["linearize", "ring.tpm", "--value", "m=1", "--measured", "x0", "--input", "u0"]);
    says(&answered, 0, &[]);
    let text = String::from_utf8_lossy(&answered.stdout).into_owned();
    assert!(text.contains("det M = m^40") && text.contains("s^80"), "{text}");
    let regulate = ["--value", "m=1", "--sample-time", "1e-3", "--derivative-filter", "0.02"];
    let answered = tpm_in(folder.path(), &[&["regulate", "ring.tpm"], &regulate[..]].concat());
    says(&answered, 0, &[]);
    let folder = with("ring.tpm", &ring(160));
    let moving = ["--value", "m=1", "--value", "A=1", "--value", "w=1"];
    for (verb, options) in [("linearize", &["--value", "m=1"][..]), ("regulate", &regulate), ("trajectories", &moving)]
    {
        let refused = tpm_in(folder.path(), &[&[verb, "ring.tpm"], options].concat());
        says(&refused, 2, &["million operations", "--allow-large"]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_program_that_will_not_end_is_ended_with_all_that_it_started() {
    let deaf = "sh -c '(trap \"\" TERM; while :; do sleep 0.1; done) & echo $! > child; trap \"\" TERM; while :; do sleep 0.1; done'";
    let machines = [
        deaf,
        "sh -c 'echo $$ > child; yes flood'",
        "sh -c 'echo $$ > child; yes flood >&2'",
        "sh -c 'echo $$ > child; head -c 1000000000 /dev/zero; sleep 60'",
        "sh -c 'echo $$ > child; sleep 60'",
    ];
    for machine in machines {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for name in ["mass_spring_drag.tpm", "mass_spring_drag.toml"] {
            std::fs::write(folder.path().join(name), shipped(name)).expect("writable");
        }
        let began = std::time::Instant::now();
        let arguments = ["campaign", "run", "mass_spring_drag.tpm", "--timeout", "1", "--machine", machine];
        says(&tpm_in(folder.path(), &arguments), 2, &["the machine: "]);
        let taken = began.elapsed();
        assert!(taken.as_secs_f64() < 4.0, "{machine}: {taken:?}");
        // A process that was killed may stand in the table until it is waited for; it does nothing.
        let child = std::fs::read_to_string(folder.path().join("child")).expect("it has begun");
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.trim())).unwrap_or_default();
        assert!(stat.is_empty() || stat.contains(") Z "), "{machine}: {stat}");
    }
}

/// A chain of links that do not move, on one that does.
fn fixed_links(count: usize) -> String {
    let mut text = "<robot name=\"r\">".to_owned();
    for i in 0..=count {
        let _ = write!(
            text,
            "<link name=\"b{i}\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/>\
             </inertial></link>"
        );
    }
    for i in 0..count {
        let kind = if i == 0 { "revolute" } else { "fixed" };
        let _ = write!(
            text,
            "<joint name=\"j{i}\" type=\"{kind}\"><parent link=\"b{i}\"/><child link=\"b{}\"/><axis xyz=\"0 0 1\"/>\
             <limit effort=\"1\" velocity=\"1\" lower=\"-1\" upper=\"1\"/></joint>",
            i + 1
        );
    }
    text + "</robot>"
}

/// A log of a sine and its force, with further columns.
fn log(rows: usize, columns: usize) -> String {
    let more = |word: &dyn Fn(usize) -> String| (0..columns).map(word).collect::<String>();
    let rest = more(&|_| ",0".to_owned());
    let row = |i: usize| {
        let phase = i as f64 / 20.0;
        format!("{:.2},{:.6},{:.6}{rest}\n", i as f64 / 100.0, phase.sin(), phase.cos())
    };
    (0..rows).map(row).fold(format!("t_s,x,u{}\n", more(&|i| format!(",c{i}"))), |text, row| text + &row)
}

#[test]
fn time_grows_far_less_than_with_the_square_of_what_is_read() {
    // Eight times as much: eight times the time where it grows with what is read, 64 times where it grows with its square.
    type Text = fn(usize) -> String;
    let read: [(&str, Text, [usize; 2], &[&str]); 8] = [
        ("r.urdf", fixed_links, [2000, 16_000], &["import", "r.urdf", "-o", "-"]),
        ("l.csv", |rows| log(rows, 0), [20_000, 160_000], &["inspect", "l.csv"]),
        ("l.csv", |columns| log(200, columns), [250, 2000], &["inspect", "l.csv"]),
        ("m.tpm", ring, [60, 480], &["check", "m.tpm"]),
        ("m.tpm", ring, [60, 480], &["expand", "m.tpm"]),
        ("m.tpm", ring, [60, 480], &["identifiability", "m.tpm"]),
        ("m.tpm", ring, [30, 240], &["split", "m.tpm"]),
        ("m.tpm", ring, [20, 160], &["generate", "m.tpm", "--lang", "rust"]),
    ];
    for (name, text, sizes, arguments) in read {
        let folders = sizes.map(|size| with(name, &text(size)));
        let time = |folder: &tempfile::TempDir| {
            let began = std::time::Instant::now();
            says(&tpm_in(folder.path(), arguments), 0, &[]);
            began.elapsed()
        };
        let fastest = |folder| (0..3).map(|_| time(folder)).min().expect("three times");
        let is_less = |[small, large]: [std::time::Duration; 2]| large < 30 * small;
        let mut measured = folders.each_ref().map(fastest);
        // A machine that does other things as well may be slow for once.
        for _ in 0..2 {
            if !is_less(measured) {
                measured = folders.each_ref().map(fastest);
            }
        }
        assert!(is_less(measured), "{arguments:?}: {measured:?} for {sizes:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn without_memory_a_command_ends_as_with_bad_input() {
    let folder = with("ring.tpm", &ring(160));
    let script = "ulimit -v 400000; exec \"$TPM\" linearize ring.tpm --value m=1 --allow-large -o out.txt";
    let output = shell(folder.path(), script);
    says(&output, 2, &["memory allocation of"]);
    assert_eq!(names(folder.path()), ["ring.tpm"]);
}

/// A message of the language server protocol as it is sent.
fn framed(message: &str) -> String {
    format!("Content-Length: {}\r\n\r\n{message}", message.len())
}

#[cfg(target_os = "linux")]
#[test]
fn a_command_ends_that_holds_more_memory_than_it_may() {
    // What the system grants is twice as much, so that it is not what ends the command.
    let mut server = Command::new("sh")
        .args(["-c", "ulimit -v 4000000; exec \"$TPM\" lsp"])
        .env("TPM", env!("CARGO_BIN_EXE_tpm"))
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("there is a shell");
    let mut input = server.stdin.take().expect("piped");
    let initialize = framed(r#"{"jsonrpc":"2.0","id":1,"method":"initialize","params":{"capabilities":{}}}"#);
    input.write_all(initialize.as_bytes()).expect("it reads");
    // Documents that are opened and never closed; each is as long as one may be.
    let text = "x".repeat(100 << 20);
    for number in 0..40 {
        let document = format!(r#"{{"uri":"file:///{number}.tpm","languageId":"tpm","version":1,"text":"{text}"}}"#);
        let open = framed(&format!(
            r#"{{"jsonrpc":"2.0","method":"textDocument/didOpen","params":{{"textDocument":{document}}}}}"#
        ));
        if input.write_all(open.as_bytes()).is_err() {
            break;
        }
    }
    drop(input);
    says(&server.wait_with_output().expect("it ends"), 2, &["more than 1 GiB of memory", "--allow-large"]);
}

#[test]
fn init_finishes_what_it_began() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let init = || tpm_in(folder.path(), &["init", "cart"]);
    says(&init(), 0, &[]);
    let model = folder.path().join("cart.tpm");
    let written = std::fs::read(&model).expect("a model");
    // A command that was ended between its files.
    std::fs::remove_file(folder.path().join("cart.toml")).expect("it is there");
    says(&init(), 0, &[]);
    assert_eq!(names(folder.path()), ["cart.toml", "cart.tpm"]);
    assert_eq!(std::fs::read(&model).expect("a model"), written);
    says(&init(), 2, &["is there already"]);
    // What the user has changed is nobody's beginning.
    std::fs::remove_file(folder.path().join("cart.toml")).expect("it is there");
    std::fs::write(&model, "my own").expect("writable");
    says(&init(), 2, &["cart.tpm is there already"]);
    assert_eq!(names(folder.path()), ["cart.tpm"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_submitted_run_is_taken_whatever_becomes_of_the_output() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["mass_spring_drag.tpm", "mass_spring_drag.toml"] {
        std::fs::write(folder.path().join(name), shipped(name)).expect("writable");
    }
    let run = |arguments: &[&str]| says(&tpm_in(folder.path(), arguments), 0, &[]);
    run(&["campaign", "start", "mass_spring_drag.tpm", "c"]);
    run(&["campaign", "next", "c", "-o", "run.csv"]);
    run(&["simulate", "mass_spring_drag.tpm", "--play", "run.csv", "-o", "log.csv"]);
    let output = shell(folder.path(), "exec \"$TPM\" campaign submit c log.csv > /dev/full");
    says(&output, 0, &["standard output"]);
    assert!(folder.path().join("c/run-001.json").exists());
    // The same log once more is not taken, and the folder is as it was.
    says(&tpm_in(folder.path(), &["campaign", "submit", "c", "log.csv"]), 2, &[]);
    assert!(!folder.path().join("c/run-002.json").exists());
}

#[test]
fn harmonics_that_no_sample_shows_are_refused() {
    let text = shipped("rotary_pendulum.tpm");
    let folder = with("rp.tpm", &text);
    let refused = tpm_in(folder.path(), &["identifiability", "rp.tpm", "--harmonics", "1000000"]);
    says(&refused, 2, &["harmonics", "1000000", "2047"]);
}

/// What is left when nothing in it would be obeyed by a terminal.
fn is_harmless(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    !text.chars().any(|c| c.is_control() && c != '\n' && c != '\t' || ('\u{202a}'..='\u{202e}').contains(&c))
}

#[test]
fn nothing_that_is_read_speaks_to_the_terminal() {
    let evil = "ev\u{1b}]0;owned\u{7}\u{1b}[2J\u{202e}il";
    let folder = with("log.csv", &format!("t_s,x,u,{evil}\n0,0,0,0\n0.1,0,0,0\n0.2,0,0,0\n"));
    std::fs::write(folder.path().join("m.tpm"), shipped("mass_spring_drag.tpm")).expect("writable");
    std::fs::write(folder.path().join("e.tpm"), format!("model A {{ // {evil}\n coordinate x; {evil} }}\n"))
        .expect("writable");
    let commands: [&[&str]; 4] = [
        &["identify", "m.tpm", "--log", "log.csv", "--map", "x=nope"],
        &["inspect", "log.csv", "--json"],
        &["check", "e.tpm"],
        &["check", "--no\u{1b}[2Jflag"],
    ];
    for command in commands {
        let output = tpm_in(folder.path(), command);
        assert!(is_harmless(&output.stdout) && is_harmless(&output.stderr), "{command:?}");
        assert!(!output.stderr.is_empty() || !output.stdout.is_empty(), "{command:?}");
    }
    // The layout of a model is its content, which stays as it is.
    let text = format!("model A {{ // {evil}\n    coordinate x;\n}}\n");
    std::fs::write(folder.path().join("f.tpm"), &text).expect("writable");
    let mut child = Command::new(env!("CARGO_BIN_EXE_tpm"))
        .args(["fmt", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the tool starts");
    child.stdin.take().expect("piped").write_all(text.as_bytes()).expect("it reads");
    let laid_out = child.wait_with_output().expect("it ends");
    assert!(String::from_utf8_lossy(&laid_out.stdout).contains(evil));
}

/// Runs a command of the shell in a folder, in which `$TPM` is the tool.
#[cfg(unix)]
fn shell(folder: &Path, script: &str) -> Output {
    let mut command = Command::new("sh");
    command.args(["-c", script]).env("TPM", env!("CARGO_BIN_EXE_tpm")).current_dir(folder);
    command.output().expect("there is a shell")
}

#[cfg(unix)]
#[test]
fn files_follow_the_mask_and_its_limit_of_size() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = with("a.tpm", &shipped("mass_spring_drag.tpm"));
    says(&shell(folder.path(), "umask 077; $TPM expand a.tpm -o table"), 0, &[]);
    let mode = std::fs::metadata(folder.path().join("table")).expect("written").permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    // One block is less than the table, and the refusal leaves neither file nor temporary file.
    std::fs::remove_file(folder.path().join("table")).expect("there");
    std::fs::write(folder.path().join(".tpm-killed.part"), "half a table").expect("writable");
    let refused = shell(folder.path(), "ulimit -f 1; $TPM expand a.tpm --format json -o table");
    says(&refused, 2, &["cannot write table", "no partial file was left", "ulimit -f"]);
    assert_eq!(names(folder.path()), ["a.tpm"]);
}

#[test]
fn a_refused_command_leaves_no_folder() {
    let folder = with("a.tpm", &shipped("mass_spring_drag.tpm"));
    let long = "x".repeat(300);
    let refused = tpm_in(folder.path(), &["generate", "a.tpm", "--lang", "c", "--prefix", &long, "-o", "new/folder"]);
    says(&refused, 2, &[]);
    assert_eq!(names(folder.path()), ["a.tpm"]);
}

/// An arm of one joint with this name, axis and turn.
fn arm(joint: &str, axis: &str, turn: &str) -> String {
    let inertial = "<inertial><mass value=\"1\"/><inertia ixx=\"0.1\" iyy=\"0.1\" izz=\"0.1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>";
    format!(
        "<robot name=\"r\"><link name=\"base\"/><link name=\"l1\">{inertial}</link><joint name=\"{joint}\" type=\"revolute\">\
         <parent link=\"base\"/><child link=\"l1\"/><origin xyz=\"0.1 0 0\" rpy=\"{turn}\"/><axis xyz=\"{axis}\"/>\
         <limit effort=\"1\" velocity=\"1\" lower=\"-1\" upper=\"1\"/></joint></robot>"
    )
}

#[test]
fn geometry_is_read_or_refused_and_never_guessed() {
    let imported = |text: &str| tpm_in(with("r.urdf", text).path(), &["import", "r.urdf", "-o", "-"]);
    // Whatever its length, the axis has its direction.
    let plain = imported(&arm("j", "1 1 0", "0 0 0"));
    for scaled in ["1e200 1e200 1", "1e-200 1e-200 0"] {
        let output = imported(&arm("j", scaled, "0 0 0"));
        says(&output, 0, &[]);
        assert_eq!(output.stdout, plain.stdout, "{scaled}");
    }
    says(&imported(&arm("j", "0 0 1", "1e300 0 0")), 2, &["r.urdf:1:", "1e300 rad", "within a turn"]);
    // Names that parameters of a link have are not those of a joint.
    for joint in ["mx_l1", "Ixx_l1", "m_l1", "tau_j"] {
        let output = imported(&arm(joint, "0 0 1", "0 0 0"));
        says(&output, 0, &[]);
    }
    says(&imported(&arm("mx_l1", "0 0 1", "0 0 0")), 0, &["`l1` is called `l1_`"]);
    let attributes: String = (0..200_000).map(|i| format!(" a{i}=\"1\"")).collect();
    says(
        &imported(&format!("<robot name=\"d\"{attributes}><link name=\"b\"/></robot>")),
        2,
        &["more than 100 attributes"],
    );
}

#[test]
fn an_editor_that_announces_too_much_is_refused() {
    let mut server = Command::new(env!("CARGO_BIN_EXE_tpm"))
        .args(["lsp", "--stdio"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the tool starts");
    server.stdin.take().expect("piped").write_all(b"Content-Length: 99999999999999\r\n\r\n{}").expect("it reads");
    says(&server.wait_with_output().expect("it ends"), 2, &["99999999999999 bytes", "language server protocol"]);
}
