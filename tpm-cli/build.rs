//! What `tpm --version` says: the version, and the commit where it is known.
//!
//! A package of the registry knows its commit from the file that cargo packs, a clone from git. Development builds do not ask, so that a
//! commit compiles nothing again.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Digits of a commit that are shown.
const DIGITS: usize = 12;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let folder = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let optimised = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let commit = packed(&folder).or_else(|| optimised.then(|| of_clone(&folder))?);
    let version = std::env::var("CARGO_PKG_VERSION").unwrap_or_default();
    let commit = commit.map(|commit| format!(" ({commit})")).unwrap_or_default();
    println!("cargo::rustc-env=TPM_VERSION={version}{commit}");
}

/// The commit that cargo packed, in the file `.cargo_vcs_info.json`.
fn packed(folder: &Path) -> Option<String> {
    let text = std::fs::read_to_string(folder.join(".cargo_vcs_info.json")).ok()?;
    let (_, behind) = text.split_once("\"sha1\"")?;
    let commit = behind.split('"').nth(1)?;
    let dirty = if text.contains("\"dirty\": true") { ", changed" } else { "" };
    Some(format!("{}{dirty}", commit.get(..DIGITS)?))
}

/// The commit of the clone that this folder belongs to; nothing for a copy without git, or within another repository.
fn of_clone(folder: &Path) -> Option<String> {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).current_dir(folder).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    if git(&["ls-files", "--error-unmatch", "--full-name", "build.rs"])? != "tpm-cli/build.rs" {
        return None;
    }
    // Where the checked-out commit is written: a branch, itself or among the packed ones, or the commit alone.
    let branch = git(&["symbolic-ref", "-q", "HEAD"]);
    for name in ["HEAD", "packed-refs"].into_iter().chain(branch.as_deref()) {
        if let Some(path) = git(&["rev-parse", "--git-path", name]).map(|path| folder.join(path)).filter(|p| p.exists())
        {
            println!("cargo::rerun-if-changed={}", path.display());
        }
    }
    git(&["rev-parse", &format!("--short={DIGITS}"), "HEAD"])
}
