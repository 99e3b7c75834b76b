//! What was made to hang, swell or leak, in other kinds than the one that was found first: each is answered or refused in time.

use crate::support::{names, root, tpm_in};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Longest time of a command. It is 2 s for what users have; builds of tests take four times as long, and tests run beside each other.
const LONGEST: Duration = Duration::from_secs(20);

/// A folder with these files.
fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).expect("writable");
    }
    folder
}

fn shipped(name: &str) -> String {
    std::fs::read_to_string(root().join("models").join(name)).expect("a shipped model")
}

/// Runs a command, which ends in time with one of these codes, and for another reason than the memory that it takes.
fn bounded(folder: &Path, arguments: &[&str], codes: &[i32]) -> Output {
    let began = Instant::now();
    let output = tpm_in(folder, arguments);
    let (taken, said) = (began.elapsed(), String::from_utf8_lossy(&output.stderr).into_owned());
    let shown: String = said.chars().take(1000).collect();
    assert!(taken < LONGEST, "{arguments:?} took {taken:?}");
    assert!(
        output.status.code().is_some_and(|code| codes.contains(&code)),
        "{arguments:?}: {}\n{shown}",
        output.status
    );
    assert!(!said.contains("of memory"), "{arguments:?}: {shown}");
    output
}

#[test]
fn harmonics_without_end_are_refused_by_every_verb() {
    let sign = "model S { coordinate x; input u; parameter m, c; m*ddot(x) + c*sign(dot(x)) = u;
        pattern { amplitude A; frequency w; harmonics 1000000; x = A*cos(w*t); } }";
    let root = "model S { coordinate x; input u; parameter m, c; m*ddot(x) + c*sqrt(2 + x) = u;
        pattern { amplitude A; frequency w; harmonics 4000000000; x = A*cos(w*t); } }";
    let folder = folder(&[("sign.tpm", sign), ("root.tpm", root)]);
    for file in ["sign.tpm", "root.tpm"] {
        for verb in [&["expand", file][..], &["identifiability", file], &["generate", file, "--lang", "c"]] {
            bounded(folder.path(), verb, &[0, 1, 2]);
        }
    }
}

/// Masses with inertia between each other, or pendulums on each other.
fn coupled(n: usize, pendulums: bool) -> String {
    let list = |letter: &str| (0..n).map(|i| format!("{letter}{i}")).collect::<Vec<_>>().join(", ");
    let mut text = format!("model C {{\n  coordinate {}; input {}; parameter m, k;\n", list("x"), list("u"));
    for i in 0..n {
        let _ = write!(text, "  m*ddot(x{i})");
        for j in (0..n).filter(|&j| j != i) {
            let factor = if pendulums { format!("cos(x{i} - x{j})") } else { format!("1/{}", 2 + i + j) };
            let _ = write!(text, " + m*{factor}*ddot(x{j})");
        }
        let _ = writeln!(text, " + k*x{i} = u{i};");
    }
    let moves: String = (0..n).map(|i| format!(" x{i} = A*cos(w*t);")).collect();
    text + &format!("  pattern {{ amplitude A; frequency w;{moves} }}\n}}\n")
}

#[test]
fn machines_of_many_coupled_coordinates_are_answered_or_refused() {
    let files = [("masses.tpm", coupled(30, false)), ("pendulums.tpm", coupled(14, true))];
    let folder = folder(&files.each_ref().map(|(name, text)| (*name, text.as_str())));
    for (file, _) in &files {
        let values = ["--value", "m=1", "--value", "k=2"];
        bounded(folder.path(), &[&["linearize", file][..], &values].concat(), &[0, 2]);
        bounded(
            folder.path(),
            &[&["trajectories", file, "--value", "A=1", "--value", "w=1"][..], &values].concat(),
            &[0, 2],
        );
        bounded(folder.path(), &["split", file], &[0, 2]);
    }
}

/// Pendulums of which the pattern moves the last, with a friction whose derivative has a kink.
fn open_chain(n: usize, friction: &str) -> String {
    let list = |letter: &str, from: usize| (from..n).map(|i| format!("{letter}{i}")).collect::<Vec<_>>().join(", ");
    let mut text = format!("model O {{\n  coordinate {}; input {}; parameter m, k, d;\n", list("q", 0), list("u", 1));
    for i in 0..n {
        let beside = (i + 1) % n;
        let input = if i == 0 { "0".to_owned() } else { format!("u{i}") };
        let friction = friction.replace('q', &format!("q{i}"));
        let _ = writeln!(text, "  m*ddot(q{i}) + k*sin(q{i} - q{beside}) + k*q{i} + d*{friction} = {input};");
    }
    let moves: String = (1..n).map(|i| format!(" q{i} = A*cos({i}*w*t);")).collect();
    text + &format!("  pattern {{ amplitude A; frequency w;{moves} }}\n}}\n")
}

#[test]
fn open_coordinates_are_found_or_refused() {
    let files = [
        ("abs.tpm", open_chain(3, "abs(dot(q))^3")),
        ("sign.tpm", open_chain(3, "sign(dot(q))")),
        ("tanh.tpm", open_chain(4, "tanh(1000*dot(q))")),
    ];
    let folder = folder(&files.each_ref().map(|(name, text)| (*name, text.as_str())));
    for (file, _) in &files {
        bounded(folder.path(), &["identifiability", file], &[0, 1, 2]);
    }
}

/// No character that a terminal would obey.
fn is_harmless(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    !text.chars().any(|c| c.is_control() && c != '\n' && c != '\t' || ('\u{202a}'..='\u{202e}').contains(&c))
}

#[cfg(unix)]
#[test]
fn neither_machines_nor_descriptions_nor_results_speak_to_the_terminal() {
    let evil = "ev\u{1b}]0;owned\u{7}\u{1b}[2J\u{202e}il";
    let said = serde_json::json!({ "type": "error", "message": evil }).to_string();
    let folder = folder(&[
        ("m.tpm", &shipped("mass_spring_drag.tpm")),
        ("m.toml", &shipped("mass_spring_drag.toml")),
        ("said", &format!("{said}\n")),
        ("r.urdf", &format!("<robot name=\"{evil}\"><link name=\"{evil}\"/><joint name=\"{evil}\"/></robot>")),
        ("a.json", &format!("{{\"schema\": \"{evil}\"}}")),
        ("e.toml", &format!("seed = \"{evil}\"")),
    ]);
    let commands: [&[&str]; 5] = [
        &["campaign", "run", "m.tpm", "--machine", "cat said"],
        &["campaign", "run", "m.tpm", "--machine", "sh -c 'cat said >&2'"],
        &["import", "r.urdf", "-o", "-"],
        &["compare", "a.json", "a.json"],
        &["campaign", "run", "m.tpm", "--experiment", "e.toml"],
    ];
    for command in commands {
        let output = bounded(folder.path(), command, &[2]);
        assert!(is_harmless(&output.stdout) && is_harmless(&output.stderr), "{command:?}");
        assert!(!output.stderr.is_empty(), "{command:?}");
    }
}

#[test]
fn descriptions_of_much_of_anything_are_answered_or_refused() {
    let deep = format!("<robot name=\"d\">{}{}</robot>", "<link name=\"a\">".repeat(50_000), "</link>".repeat(50_000));
    let same = format!("<robot name=\"d\">{}</robot>", "<link name=\"a\"/>".repeat(200_000));
    let many: String = (0..200_000).map(|i| format!("<material name=\"m{i}\"/>")).collect();
    let spaces: String = (0..200_000).map(|i| format!(" xmlns:a{i}=\"u\"")).collect();
    let texts = [
        deep,
        same,
        format!("<robot name=\"d\"><link name=\"b\"/>{many}</robot>"),
        format!("<robot name=\"d\"{spaces}><link name=\"b\"/></robot>"),
        format!("<!DOCTYPE r [<!ENTITY a \"{}\">]><robot name=\"&a;\"/>", "&a;".repeat(1000)),
        format!("<robot name=\"d\"><link name=\"b{}\"/></robot>", "x".repeat(1_000_000)),
    ];
    for (number, text) in texts.iter().enumerate() {
        let folder = folder(&[("r.urdf", text)]);
        let refused = bounded(folder.path(), &["import", "r.urdf", "-o", "m.tpm"], &[2]);
        assert!(refused.stderr.len() < 20_000, "{number}: {} bytes", refused.stderr.len());
        assert_eq!(names(folder.path()), ["r.urdf"], "{number}");
    }
}

#[test]
fn refused_commands_leave_nothing_behind() {
    let folder = folder(&[
        ("a.tpm", &shipped("mass_spring_drag.tpm")),
        ("e.toml", "seed = -1"),
        ("r.urdf", "<robot name=\"r\"/>"),
    ]);
    let commands: [&[&str]; 5] = [
        &["campaign", "start", "a.tpm", "new", "--experiment", "e.toml"],
        &["campaign", "run", "a.tpm", "--experiment", "e.toml", "--runs", "new"],
        &["import", "r.urdf", "-o", "new/a.tpm"],
        &["design", "a.tpm", "--experiment", "e.toml", "--write", "new"],
        &["generate", "a.tpm", "--lang", "rust", "--prefix", "1 is no name", "-o", "new/folder"],
    ];
    for command in commands {
        bounded(folder.path(), command, &[2]);
        assert_eq!(names(folder.path()), ["a.tpm", "e.toml", "r.urdf"], "{command:?}");
    }
}

#[cfg(unix)]
#[test]
fn folders_and_their_files_follow_the_mask() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = folder(&[("a.tpm", &shipped("mass_spring_drag.tpm"))]);
    let script = "umask 027; $TPM generate a.tpm --lang c -o code && $TPM init own && $TPM expand a.tpm -o table";
    let run = Command::new("sh")
        .args(["-c", script])
        .env("TPM", env!("CARGO_BIN_EXE_tpm"))
        .current_dir(folder.path())
        .output()
        .expect("there is a shell");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let mode = |path: &Path| std::fs::metadata(path).expect("written").permissions().mode() & 0o777;
    let mut seen = 0;
    let mut look = vec![folder.path().join("code"), folder.path().join("own.tpm"), folder.path().join("table")];
    while let Some(path) = look.pop() {
        let expected = if path.is_dir() { 0o750 } else { 0o640 };
        assert_eq!(mode(&path), expected, "{}", path.display());
        if path.is_dir() {
            look.extend(std::fs::read_dir(&path).expect("readable").map(|entry| entry.expect("readable").path()));
        }
        seen += 1;
    }
    assert!(seen > 4, "{seen}");
}

#[test]
fn editors_that_talk_nonsense_are_refused() {
    let frame = |body: &str| format!("Content-Length: {}\r\n\r\n{body}", body.len());
    let texts = [
        "x".repeat(10_000_000),
        "Content-Length: -1\r\n\r\n{}".to_owned(),
        frame(&"[".repeat(1_000_000)),
        frame(&format!("{{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":{}", "{\"a\":".repeat(100_000))),
        "A: b\r\n".repeat(1_000_000),
    ];
    for (number, text) in texts.iter().enumerate() {
        let began = Instant::now();
        let mut server = Command::new(env!("CARGO_BIN_EXE_tpm"))
            .arg("lsp")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the tool starts");
        // The server stops reading at what it refuses.
        let _ = server.stdin.take().expect("piped").write_all(text.as_bytes());
        let output = server.wait_with_output().expect("it ends");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{number}: {} {said}", output.status);
        assert!(said.contains("language server protocol") || said.contains("shutdown"), "{number}: {said}");
        assert!(said.len() < 3000 && began.elapsed() < LONGEST, "{number}: {:?}", began.elapsed());
    }
}

#[cfg(unix)]
#[test]
fn machines_that_talk_nonsense_are_refused() {
    let folder = folder(&[
        ("m.tpm", &shipped("mass_spring_drag.tpm")),
        ("m.toml", &shipped("mass_spring_drag.toml")),
        ("hello", "{\"type\":\"hello\",\"protocol\":\"tpm.machine/1\",\"plays\":\"runs\"}\n"),
        ("deep", &"[".repeat(1_000_000)),
        (
            "many",
            &"{\"type\":\"samples\",\"from\":0,\"coordinates\":{\"x\":[]},\"inputs\":{\"u\":[]}}\n".repeat(10_000),
        ),
    ]);
    let machines = [
        "cat deep",
        "sh -c 'cat hello deep; echo'",
        "cat hello many",
        "sh -c 'cat hello; yes {}'",
        "sh -c 'cat hello; head -c 100000000 /dev/zero'",
        "sh -c 'cat hello; (sleep 60 >&- 2>&- &); exit 0'",
    ];
    for machine in machines {
        let arguments = ["campaign", "run", "m.tpm", "--timeout", "1", "--machine", machine];
        let refused = bounded(folder.path(), &arguments, &[2]);
        assert!(refused.stderr.len() < 3000, "{machine}: {} bytes", refused.stderr.len());
    }
}
