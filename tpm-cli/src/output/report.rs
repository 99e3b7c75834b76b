//! Reports: a page for a browser and its figures, in a folder.

use crate::failure::Failure;
use crate::output::{file, picture};
use std::path::{Path, PathBuf};
use tpm_runtime::document::Document;

/// Name of the page in its folder.
const PAGE: &str = "report.html";

/// Writes a page, each of its figures as SVG (and PNG where the program draws it), and other files of the report into a folder: all of them or none.
pub(crate) fn write(folder: &Path, document: &Document, others: &[(&str, String)]) -> Result<(), Failure> {
    let html = document.html().map_err(|error| Failure::Input(error.to_string()))?;
    let mut files: Vec<(PathBuf, Vec<u8>)> = vec![(folder.join(PAGE), html.into_bytes())];
    for (name, figure) in document.figures() {
        for kind in picture::KINDS {
            let path = folder.join(format!("{name}.{kind}"));
            let bytes = picture::bytes(&path, figure)?;
            files.push((path, bytes));
        }
    }
    files.extend(others.iter().map(|(name, text)| (folder.join(name), text.clone().into_bytes())));
    let files: Vec<(&Path, &[u8])> = files.iter().map(|(path, bytes)| (path.as_path(), bytes.as_slice())).collect();
    file::write_into(folder, &files)
}
