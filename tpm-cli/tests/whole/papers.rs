//! The example `papers`: every table and figure of both papers on one page.

// Cargo builds examples, but runs no unit tests in them: these run here.
#[allow(dead_code, reason = "the example runs as a program of its own")]
#[path = "../../examples/papers/main.rs"]
mod example;

use std::path::Path;
use std::process::Command;

#[test]
fn the_page_holds_every_table_and_figure_and_the_reasons() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    // `cargo test` builds the examples of a package beside its test programs.
    let test = std::env::current_exe().expect("this program has a path");
    let built = test.parent().and_then(Path::parent).expect("cargo's folder `deps` stands in that of the profile");
    let program = built.join("examples").join(format!("papers{}", std::env::consts::EXE_SUFFIX));
    let run = Command::new(&program).args(["--duration", "100", "-o", "page"]).current_dir(folder.path()).output();
    let run = run.unwrap_or_else(|error| panic!("{}: {error}", program.display()));
    // Nothing differs from what is printed but for a reason that is known.
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    let read = |name: &str| std::fs::read_to_string(folder.path().join("page").join(name)).expect("written");
    let (page, text) = (read("papers.html"), read("papers.md"));
    for said in ["37393/60000", "determinant -40/81", "a lost digit", "Table 5.1", "not here", "Eqns 28 and 29"] {
        assert!(page.contains(said) && text.contains(said), "{said}");
    }
    // Products stand in code: elsewhere a star may be emphasis.
    for row in page.lines().filter(|line| line.starts_with("<tr>")) {
        let prose: String =
            row.split("<code>").map(|part| part.split_once("</code>").map_or(part, |(_, after)| after)).collect();
        assert!(!prose.contains('*') && !prose.contains("<em>"), "{row}");
    }
    let figures = ["patterns", "linkage", "tracking", "torque", "figure_6_5", "input", "bode", "bode500", "eqn29"];
    for figure in figures {
        assert!(read(&format!("{figure}.svg")).starts_with("<svg"), "{figure}");
        assert!(text.contains(&format!("]({figure}.svg)")), "{figure} is not shown");
    }
    assert_eq!(page.matches("<figure><svg").count(), figures.len());

    let refused = Command::new(&program).args(["--duration", "nan"]).output().expect("it runs");
    assert_eq!(refused.status.code(), Some(2));
}
