//! Where results go: standard output, files that are written whole or not at all, figures, progress.

pub(crate) mod file;
pub(crate) mod picture;
pub(crate) mod progress;
pub(crate) mod report;
