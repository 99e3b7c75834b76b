//! The lock of a campaign's folder, which one process holds at a time.
//!
//! Invariant: a process holds the folder as long as it holds the operating system's lock on the file `campaign.lock` in
//! it. The operating system releases the lock when the process ends, however it ends. The file names the holder, so
//! that other processes can report it.

use crate::store::StoreError;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tpm_report::TEMPORARY;

/// Most attempts to take a lock whose holder has not yet written its name into the file, or whose file was removed
/// meanwhile.
const MOST_ATTEMPTS: usize = 100;

/// Time between two attempts to take the lock.
const BETWEEN_ATTEMPTS: Duration = Duration::from_millis(10);

/// The lock of this process on a folder. Dropping the value releases it.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    // The file is closed after its name has been removed, so that no other process can lock a file of that name before.
    file: File,
}

impl Lock {
    /// Takes the lock of a folder, creates the folder when it does not exist, and removes temporary files that killed
    /// processes left in it.
    ///
    /// # Errors
    /// [`StoreError::Held`] when another process holds the lock, [`StoreError::Io`] when the lock cannot be taken.
    pub fn hold(folder: &Path) -> Result<Self, StoreError> {
        let path = folder.join("campaign.lock");
        let io = |error: &dyn ToString| StoreError::Io { path: path.display().to_string(), reason: error.to_string() };
        if folder.exists() && !folder.is_dir() {
            let reason = "this is no folder; name one, or a path where nothing is yet".to_string();
            return Err(StoreError::Broken { path: folder.display().to_string(), reason });
        }
        fs::create_dir_all(folder).map_err(|error| io(&error))?;
        for _ in 0..MOST_ATTEMPTS {
            if fs::symlink_metadata(&path).is_ok_and(|present| !present.is_file()) {
                return Err(io(&"this is no regular file, and nothing is written through it; remove it"));
            }
            let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
            let file = opened.map_err(|error| io(&error))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let by = fs::read_to_string(&path).unwrap_or_default();
                    if !by.trim().is_empty() {
                        let (path, by) = (folder.display().to_string(), by.trim().to_string());
                        return Err(StoreError::Held { path, by });
                    }
                    // The holder is about to write its name into the file, or has just ended.
                    std::thread::sleep(BETWEEN_ATTEMPTS);
                    continue;
                }
                Err(TryLockError::Error(error)) => return Err(io(&error)),
            }
            // The previous holder may have removed the file between opening and locking.
            if !is_same(&file, &path) {
                continue;
            }
            // From here on the file goes with the lock, on a fault too.
            let mut held = Self { path: path.clone(), file };
            held.file.set_len(0).map_err(|error| io(&error))?;
            writeln!(held.file, "process {}", std::process::id()).map_err(|error| io(&error))?;
            clean(folder);
            return Ok(held);
        }
        Err(io(&"the lock goes from process to process; try again"))
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // If the file cannot be removed, the next process locks it as it is.
        let _ = fs::remove_file(&self.path);
    }
}

/// Whether the path still refers to the opened file.
#[cfg(unix)]
fn is_same(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let place = |found: fs::Metadata| (found.dev(), found.ino());
    file.metadata().ok().map(place) == fs::symlink_metadata(path).ok().map(place)
}

/// Systems other than Unix do not remove a file that is open, so the path refers to the opened file.
#[cfg(not(unix))]
fn is_same(_: &File, _: &Path) -> bool {
    true
}

/// Removes temporary files. Only the holder of the lock writes into the folder, so every temporary file in it was left
/// by an earlier process.
fn clean(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name: String = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(TEMPORARY) && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Lock;
    use crate::store::StoreError;

    #[test]
    fn one_works_and_the_other_is_told() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join(".tpm-left"), "half a run").expect("writable");
        let held = Lock::hold(folder.path()).expect("free");
        assert!(!folder.path().join(".tpm-left").exists());
        let Err(StoreError::Held { by, .. }) = Lock::hold(folder.path()) else { panic!("held twice") };
        assert_eq!(by, format!("process {}", std::process::id()));
        drop(held);
        drop(Lock::hold(folder.path()).expect("free again"));
        assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 0);
    }

    #[test]
    fn a_file_is_no_folder() {
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        let refused = Lock::hold(file.path()).map(|_| ()).expect_err("a file").to_string();
        assert!(refused.ends_with("this is no folder; name one, or a path where nothing is yet"), "{refused}");
    }

    #[cfg(unix)]
    #[test]
    fn nothing_is_written_through_a_link() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let other = folder.path().join("other");
        std::fs::write(&other, "kept").expect("writable");
        std::os::unix::fs::symlink(&other, folder.path().join("campaign.lock")).expect("a link");
        assert!(Lock::hold(folder.path()).is_err());
        assert_eq!(std::fs::read_to_string(&other).expect("readable"), "kept");
    }
}
