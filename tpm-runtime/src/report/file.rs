//! Files that are written whole or not at all.

use std::io::Write as _;
use std::path::Path;

/// Writes a file by way of a temporary one beside it, which is renamed when it is complete: whoever reads the file finds the old
/// content or the new one.
///
/// # Errors
/// The system's reason; nothing is left behind then.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut file = tempfile::Builder::new().prefix(".tpm-").tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    // A temporary file is private to its owner; a result gets what any new file here would get.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let mode = std::fs::metadata(path).map_or(0o644, |present| present.permissions().mode());
        file.as_file().set_permissions(std::fs::Permissions::from_mode(mode))?;
    }
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::write_whole;
    use std::vec::Vec;

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
}
