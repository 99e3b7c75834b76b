//! Files that are written whole or not at all.

use crate::temporary;
use std::io::{ErrorKind, Read as _, Write as _};
use std::path::Path;

/// Most symbolic links that are followed one after the other.
const MOST_LINKS: usize = 40;

/// The most bytes of a model, an experiment, a result or a manifest: far beyond what people write.
pub const MOST_TEXT: u64 = 16 << 20;

/// Writes a result where the user wants it. A regular file, or the target of a symbolic link, is written whole or not
/// at all. A device or a pipe, such as `/dev/stdout`, is written into and not replaced.
///
/// # Errors
/// The system's reason; no part of a regular file is left behind then.
pub fn write_output(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    if is_special(path) {
        let mut special = std::fs::OpenOptions::new().write(true).open(path)?;
        special.write_all(bytes)?;
        return special.flush();
    }
    let mut target = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        let Ok(next) = std::fs::read_link(&target) else { return write_whole(&target, bytes) };
        target = target.parent().unwrap_or(Path::new("")).join(next);
    }
    Err(invalid("symbolic links lead round in a circle".into()))
}

/// Whether a path leads to a device, a pipe or a socket.
#[must_use]
pub fn is_special(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|present| !present.is_file() && !present.is_dir())
}

/// Reads a file of the user, of at most `most` bytes. The limit holds for devices and pipes too, which may have no end.
///
/// # Errors
/// The system's reason, or that the file is longer.
pub fn read_input(path: &Path, most: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    std::fs::File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(invalid(format!("the file is longer than {} MiB, the limit for files like it", most >> 20)));
    }
    Ok(bytes)
}

/// Reads a text of the user, of at most [`MOST_TEXT`] bytes.
///
/// # Errors
/// Those of [`read_input`], and that the file is no UTF-8.
pub fn read_text(path: &Path) -> std::io::Result<String> {
    let bytes = read_input(path, MOST_TEXT)?;
    String::from_utf8(bytes).map_err(|error| std::io::Error::new(ErrorKind::InvalidData, error))
}

fn invalid(reason: String) -> std::io::Error {
    std::io::Error::new(ErrorKind::InvalidInput, reason)
}

/// Replaces a file, by way of a temporary one beside it, which is renamed when it is complete: whoever reads the file finds the old
/// content or the new one. A symbolic link is replaced, and nothing is written through it. A file that was there keeps its permissions; a
/// new one gets those that the user's mask leaves. Temporary files that killed processes left in the folder are removed.
///
/// # Errors
/// The system's reason; nothing is left behind then.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    operation()?;
    #[cfg_attr(not(feature = "faults"), expect(unused_mut, reason = "tests alone let temporary files stay"))]
    let mut file = temporary::create(folder)?;
    #[cfg(feature = "faults")]
    file.disable_cleanup(faults::kills());
    if let Err(error) = operation() {
        // The injected fault is that of a full disk: a part of the content is written before the error.
        file.as_file().write_all(&bytes[..bytes.len() / 2])?;
        return Err(error);
    }
    file.as_file().write_all(bytes)?;
    operation()?;
    file.as_file().sync_all()?;
    operation()?;
    #[cfg(unix)]
    if let Ok(present) = std::fs::metadata(path) {
        file.as_file().set_permissions(present.permissions())?;
    }
    file.persist(path).map_err(|error| error.error)?;
    sync_folder(folder);
    Ok(())
}

/// Asks the system to keep the names of a folder, so that a renamed file is still there after a power failure. The file is written by
/// then, and some file systems cannot do this for folders: a failure changes nothing that could be said.
fn sync_folder(folder: &Path) {
    #[cfg(unix)]
    if let Ok(folder) = std::fs::File::open(folder) {
        let _ = folder.sync_all();
    }
    #[cfg(not(unix))]
    let _ = folder;
}

/// Called before every operation on a file that is written, so that tests can inject a fault there.
///
/// # Errors
/// The fault that a test has asked for.
fn operation() -> std::io::Result<()> {
    #[cfg(feature = "faults")]
    faults::next()?;
    Ok(())
}

/// Injection of faults into the operations on files that this thread writes.
#[cfg(feature = "faults")]
pub mod faults {
    use std::cell::Cell;
    use std::thread_local;

    thread_local! {
        /// How many operations succeed before the first that fails.
        static LEFT: Cell<Option<usize>> = const { Cell::new(None) };
        static KILLS: Cell<bool> = const { Cell::new(false) };
    }

    /// Lets all operations fail after the first `count`. With `kills` their temporary files stay behind, as those of a
    /// killed process do.
    pub fn after(count: usize, kills: bool) {
        LEFT.set(Some(count));
        KILLS.set(kills);
    }

    /// Lets all operations succeed. Says whether one failed since [`after`].
    pub fn end() -> bool {
        KILLS.set(false);
        LEFT.take() == Some(0)
    }

    pub(super) fn kills() -> bool {
        KILLS.get()
    }

    pub(super) fn next() -> std::io::Result<()> {
        match LEFT.get() {
            Some(0) => Err(std::io::Error::other("a fault of this test")),
            Some(left) => {
                LEFT.set(Some(left - 1));
                Ok(())
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{read_input, write_output, write_whole};

    #[test]
    fn a_failed_write_leaves_nothing_behind() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let target = folder.path().join("table.json");
        std::fs::create_dir(&target).expect("a folder stands in the way");
        assert!(write_whole(&target, b"{}").is_err());
        let left: Vec<_> = std::fs::read_dir(folder.path()).expect("readable").collect();
        assert_eq!(left.len(), 1, "only the folder that was there: {left:?}");
    }

    #[test]
    fn a_file_is_replaced_whole() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let target = folder.path().join("table.json");
        for text in ["a long first text", "short"] {
            write_whole(&target, text.as_bytes()).expect("writable");
            assert_eq!(std::fs::read_to_string(&target).expect("readable"), text);
        }
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_the_mask_or_of_the_file_that_was_there() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mode = |path: &std::path::Path| std::fs::metadata(path).expect("there").permissions().mode() & 0o777;
        let [fresh, plain] = ["fresh", "plain"].map(|name| folder.path().join(name));
        std::fs::write(&plain, "made by the system, which follows the mask").expect("writable");
        write_whole(&fresh, b"text").expect("writable");
        assert_eq!(mode(&fresh), mode(&plain));
        for own in [0o600, 0o640, 0o755] {
            std::fs::set_permissions(&fresh, std::fs::Permissions::from_mode(own)).expect("ours");
            write_whole(&fresh, b"again").expect("writable");
            assert_eq!(mode(&fresh), own);
        }
    }

    #[cfg(unix)]
    #[test]
    fn special_files_are_written_into_and_links_followed() {
        use std::os::unix::fs::{FileTypeExt as _, symlink};
        write_output(std::path::Path::new("/dev/null"), b"text").expect("writable");
        assert!(std::fs::metadata("/dev/null").expect("there").file_type().is_char_device());
        assert!(read_input(std::path::Path::new("/dev/zero"), 1 << 20).is_err());
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [target, link] = ["target", "link"].map(|name| folder.path().join(name));
        symlink("target", &link).expect("a link");
        for text in ["made", "written again"] {
            write_output(&link, text.as_bytes()).expect("writable");
            assert_eq!(std::fs::read_to_string(&target).expect("readable"), text);
            assert!(std::fs::symlink_metadata(&link).expect("there").is_symlink());
        }
        let circle = folder.path().join("circle");
        symlink("circle", &circle).expect("a link");
        assert!(write_output(&circle, b"text").is_err());
        write_whole(&link, b"replaced").expect("writable");
        assert_eq!(std::fs::read_to_string(&target).expect("readable"), "written again");
        assert!(read_input(&target, 5).is_err());
    }
}
