//! Results to standard output, or to a file that is written whole or not at all.

use crate::failure::Failure;
use crate::output::terminal;
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

/// Writes a text for people to standard output.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    printed(terminal::print(text))
}

/// Writes the content of a file, such as a model, code or samples, to standard output.
pub(crate) fn print_content(text: &str) -> Result<(), Failure> {
    printed(terminal::print_content(text))
}

/// A reader that has closed the pipe (`| head`) is no failure.
fn printed(outcome: std::io::Result<()>) -> Result<(), Failure> {
    match outcome {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::write(Path::new("standard output"), error))
        }
        _ => Ok(()),
    }
}

/// Writes a remark to standard error.
pub(crate) fn remark(text: &str) {
    terminal::tell(text);
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

/// Writes files that belong together into a folder and those below it, which are made with those above where there are none: all files or
/// none, and folders that were made for them go again where one cannot be written.
pub(crate) fn write_into(folder: &Path, files: &[(&Path, &[u8])]) -> Result<(), Failure> {
    let folders = || std::iter::once(folder).chain(files.iter().filter_map(|(path, _)| path.parent()));
    let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
    let mut missing: Vec<&Path> = folders().flat_map(Path::ancestors).filter(is_missing).collect();
    missing.sort_by_key(|folder| std::cmp::Reverse(folder.components().count()));
    let make = |folder| std::fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error));
    folders().try_for_each(make).and_then(|()| write_files(files)).inspect_err(|_| {
        // From the innermost outwards. A folder that is not empty holds files of somebody else, and stays.
        for folder in missing {
            let _ = std::fs::remove_dir(folder);
        }
    })
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
    Ok(terminal::shown_json(text))
}

#[cfg(test)]
mod tests {
    use super::{write_files, write_into};

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

    #[test]
    fn folders_are_made_for_files_and_go_where_one_cannot_be_written() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let inner = folder.path().join("outer").join("inner");
        let (good, bad) = (inner.join("a.h"), inner.join("x".repeat(300)));
        assert!(write_into(&inner, &[(&good, b"text"), (&bad, b"text")]).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 0);
        assert!(write_into(&inner, &[(&good, b"text")]).is_ok());
        // What was there stays.
        assert!(write_into(&inner.join("deeper"), &[(&bad, b"text")]).is_err());
        assert_eq!(std::fs::read_dir(&inner).expect("readable").count(), 1);
    }
}
