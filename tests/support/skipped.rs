//! How a test says that it was skipped; a part of every test program that may skip one.

use std::io::Write as _;

/// Says that the test which calls this was skipped, in whole or in part, and why. The line goes to standard error past the test
/// runner, which holds back what passing tests print, and to the file that the environment variable `TPM_SKIPPED` names, of which
/// `.ci/run` makes its last line.
pub(crate) fn skipped(why: &str) {
    // The test runner gives every test a thread of its name.
    let thread = std::thread::current();
    let line = std::format!("{} ({why})\n", thread.name().unwrap_or("a test"));
    let _ = std::io::stderr().write_all(std::format!("SKIPPED: {line}").as_bytes());
    if let Some(path) = std::env::var_os("TPM_SKIPPED") {
        let file = std::fs::OpenOptions::new().append(true).create(true).open(path);
        let written = file.and_then(|mut file| file.write_all(line.as_bytes()));
        written.expect("the file that TPM_SKIPPED names can be written");
    }
}
