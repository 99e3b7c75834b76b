//! Temporary files beside those that are written, and those that killed processes left.
//!
//! Invariant: a process holds the operating system's lock on each of its temporary files until it has its last name or is gone. A file
//! whose lock can be taken belongs to nobody, and is removed by the next process that writes into its folder.

use std::collections::BTreeSet;
use std::fs::{self, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::NamedTempFile;

/// The beginning of the names of temporary files.
pub const TEMPORARY: &str = ".tpm-";

/// How these names end.
const ENDING: &str = ".part";

/// Most attempts to create a file that no other process takes for one that was left.
const MOST_ATTEMPTS: usize = 100;

/// Folders that this process has cleaned, once each: what it leaves itself it removes itself.
static CLEANED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// A new temporary file in a folder, removed when it is dropped. Once for every folder, those that were left there are removed before.
pub(crate) fn create(folder: &Path) -> std::io::Result<NamedTempFile> {
    let unseen = || CLEANED.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    if unseen() {
        clean(folder);
    }
    for _ in 0..MOST_ATTEMPTS {
        let file = named(folder)?;
        let locked = match file.as_file().try_lock() {
            Ok(()) => file.path().symlink_metadata().is_ok(),
            // Another process is about to remove it.
            Err(TryLockError::WouldBlock) => false,
            // A file system without locks, on which nobody can take it for one that was left.
            Err(TryLockError::Error(_)) => true,
        };
        if locked {
            return Ok(file);
        }
    }
    Err(std::io::Error::other("other processes remove every temporary file in this folder"))
}

fn named(folder: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY).suffix(ENDING);
    // What the user's mask leaves of the permissions of an ordinary file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

/// Removes the temporary files of a folder that no process holds. What cannot be removed stays: the file that is to be written matters
/// more.
fn clean(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let ours = name.to_str().is_some_and(|name| name.starts_with(TEMPORARY) && name.ends_with(ENDING));
        if ours && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            remove_if_left(&entry.path());
        }
    }
}

/// Removes a temporary file whose lock can be had. The lock is held until the name is gone, so that a process that has just created the
/// file, and locks it now, sees that it was taken.
fn remove_if_left(path: &Path) {
    let Ok(file) = OpenOptions::new().read(true).write(true).open(path) else { return };
    if file.try_lock().is_ok() {
        let _ = fs::remove_file(path);
    }
}

#[cfg(test)]
mod tests {
    use super::{clean, create};
    use std::fs;

    #[test]
    fn files_that_nobody_holds_are_removed_and_no_others() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let held = create(folder.path()).expect("writable");
        for name in [".tpm-left.part", ".tpm-notes", "table.part"] {
            fs::write(folder.path().join(name), "half a table").expect("writable");
        }
        fs::create_dir(folder.path().join(".tpm-folder.part")).expect("writable");
        clean(folder.path());
        let left = |name: &str| folder.path().join(name).exists();
        assert!(!left(".tpm-left.part"));
        assert!(held.path().exists() && left(".tpm-notes") && left("table.part") && left(".tpm-folder.part"));
        drop(held);
        assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), 3);
    }

    #[test]
    fn writers_of_one_folder_do_not_take_each_others_files() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::thread::scope(|scope| {
            scope.spawn(|| (0..300).for_each(|_| clean(folder.path())));
            for _ in 0..300 {
                let file = create(folder.path()).expect("writable");
                assert!(file.path().exists(), "a held file was removed");
                file.persist(folder.path().join("written")).expect("still there");
            }
        });
    }
}
