//! Poles and zeros in words.

use tpm_runtime::frequency::Complex;
use tpm_runtime::report::number;

/// A root in words, with its conjugate.
pub(crate) fn root_text(root: Complex) -> String {
    // Adding zero turns a pole at -0 into 0, since "-0" would puzzle the reader.
    let re = number(root.re + 0.0);
    if root.im == 0.0 { re } else { format!("{re}+-{}j", number(root.im.abs())) }
}

/// The roots in words, each conjugate pair once.
pub(crate) fn roots_text(roots: &[Complex]) -> String {
    let list: Vec<String> = roots.iter().filter(|root| root.im >= 0.0).map(|root| root_text(*root)).collect();
    if list.is_empty() { "none".to_owned() } else { list.join(", ") }
}
