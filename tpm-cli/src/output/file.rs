//! Results to standard output, or to a file that is written whole or not at all.

use crate::failure::Failure;
use std::io::Write as _;
use std::path::Path;
use tpm_runtime::report::{is_special, write_output};

/// The file that was asked for; none for `-`, which names standard output.
pub(crate) fn named(path: Option<&Path>) -> Option<&Path> {
    path.filter(|path| *path != Path::new("-"))
}

/// Writes a result to `path`, or to standard output, which `-` names too.
pub(crate) fn emit(path: Option<&Path>, text: &str) -> Result<(), Failure> {
    match named(path) {
        Some(path) => write_file(path, text.as_bytes()),
        None => print(text),
    }
}

/// Writes to standard output; a reader that has closed the pipe (`| head`) is no failure.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::write(Path::new("standard output"), error))
        }
        _ => Ok(()),
    }
}

/// Writes a remark to standard error.
pub(crate) fn remark(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Writes several files that belong together: all of them or none. Earlier contents are restored when one cannot be
/// written.
pub(crate) fn write_files(files: &[(&Path, &[u8])]) -> Result<(), Failure> {
    let mut written: Vec<(&Path, Option<Vec<u8>>)> = Vec::new();
    for &(path, bytes) in files {
        // What a device or a pipe gives is no earlier content.
        if is_special(path) {
            write_file(path, bytes)?;
            continue;
        }
        let before = match std::fs::read(path) {
            Ok(before) => Ok(Some(before)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(Failure::write(path, error)),
        };
        let result = before.and_then(|before| write_file(path, bytes).map(|()| before));
        match result {
            Ok(before) => written.push((path, before)),
            Err(failure) => {
                for (path, before) in written {
                    // The first fault is the one to report; a fault of restoring the earlier contents is not.
                    let _ = match before {
                        Some(before) => write_file(path, &before).is_ok(),
                        None => std::fs::remove_file(path).is_ok(),
                    };
                }
                return Err(failure);
            }
        }
    }
    Ok(())
}

/// Writes a file whole or not at all.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_output(path, bytes).map_err(|error| Failure::write(path, error))
}

/// A result as JSON, with a newline at its end.
pub(crate) fn json(result: &impl serde::Serialize) -> Result<String, Failure> {
    let mut text = serde_json::to_string_pretty(result)
        .map_err(|error| Failure::Input(format!("the result cannot be written as JSON: {error}")))?;
    text.push('\n');
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::write_files;

    #[test]
    fn files_that_belong_together_are_written_together() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = |name: &str| folder.path().join(name);
        let (header, fresh, source) = (path("a.h"), path("b.h"), path("a.c"));
        std::fs::write(&header, "before").expect("writable");
        std::fs::create_dir(&source).expect("a folder stands in the way");
        let files: [(&std::path::Path, &[u8]); 3] = [(&header, b"after"), (&fresh, b"after"), (&source, b"after")];
        assert!(write_files(&files).is_err());
        assert_eq!(std::fs::read(&header).expect("it is there"), b"before");
        assert!(!fresh.exists());
        std::fs::remove_dir(&source).expect("empty");
        assert!(write_files(&files).is_ok());
        assert_eq!(std::fs::read(&source).expect("it is there"), b"after");
    }
}
