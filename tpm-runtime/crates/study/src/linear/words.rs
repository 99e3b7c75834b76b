//! Poles, zeros and gains in words, and poles and zeros as pairs of numbers.

use serde::{Serialize, Serializer};
use tpm_frequency::Complex;
use tpm_report::{Align, TextTable, number};

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

/// A static gain in words.
pub(crate) fn gain_text(gain: f64) -> String {
    if gain.is_finite() { number(gain) } else { "infinite".to_owned() }
}

/// A table of texts.
pub(crate) fn table_of(head: &[&str]) -> TextTable {
    TextTable::new(&head.iter().map(|name| (*name, Align::Left)).collect::<Vec<_>>())
}

#[derive(Serialize)]
struct Parts {
    re: f64,
    im: f64,
}

/// Serialises a root as an object of its real and imaginary parts.
pub(crate) fn root<S: Serializer>(root: &Complex, serializer: S) -> Result<S::Ok, S::Error> {
    Parts { re: root.re, im: root.im }.serialize(serializer)
}

/// Serialises roots as a list of objects.
pub(crate) fn roots<S: Serializer>(roots: &[Complex], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(roots.iter().map(|root| Parts { re: root.re, im: root.im }))
}

#[cfg(test)]
mod tests {
    use super::roots_text;
    use tpm_frequency::Complex;

    #[test]
    fn conjugates_are_told_once_and_zero_has_no_sign() {
        let root = Complex::new(-0.0, 3.0_f64.sqrt());
        assert_eq!(roots_text(&[root, root.conj()]), "0+-1.73205j");
        assert_eq!(roots_text(&[]), "none");
    }
}
