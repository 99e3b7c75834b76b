//! Pieces of Markdown.

use tpm_runtime::frequency::Complex;
use tpm_runtime::report::number;

/// A table.
pub(super) fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let mut text = format!("| {} |\n|{}\n", head.join(" | "), "---|".repeat(head.len()));
    for row in rows {
        text.push_str(&format!("| {} |\n", row.join(" | ")));
    }
    text
}

/// Roots, one of each pair of conjugates.
pub(super) fn roots(list: &[Complex]) -> String {
    let upper = list.iter().filter(|root| root.im >= 0.0).map(|root| {
        if root.im == 0.0 { format!("{:.3}", root.re) } else { format!("{:.3} +- {:.3}j", root.re, root.im) }
    });
    let upper: Vec<String> = upper.collect();
    if upper.is_empty() { "none".to_owned() } else { upper.join(", ") }
}

/// A polynomial in s from its coefficients, s^0 first.
pub(super) fn polynomial(coefficients: &[f64]) -> String {
    let mut text = String::new();
    for (power, value) in coefficients.iter().enumerate().rev().filter(|(_, value)| **value != 0.0) {
        let sign = match (text.is_empty(), *value < 0.0) {
            (true, true) => "-",
            (true, false) => "",
            (false, true) => " - ",
            (false, false) => " + ",
        };
        let size = value.abs();
        let factor = if size == 1.0 && power > 0 { String::new() } else { number((size * 1e5).round() / 1e5) };
        let power = match power {
            0 => String::new(),
            1 => " s".to_owned(),
            _ => format!(" s^{power}"),
        };
        text.push_str(&format!("{sign}{}", format!("{factor}{power}").trim()));
    }
    if text.is_empty() { "0".to_owned() } else { text }
}

/// A share in percent.
pub(super) fn percent(share: f64) -> String {
    let value = 100.0 * share;
    if value.abs() >= 0.01 || value == 0.0 { format!("{value:.2} %") } else { format!("{value:.1e} %") }
}

#[cfg(test)]
mod tests {
    use super::{percent, polynomial, roots};
    use tpm_runtime::frequency::Complex;

    #[test]
    fn formulas_read_as_they_are_written() {
        assert_eq!(polynomial(&[427.5, 65.48, 9.2, 1.0]), "s^3 + 9.2 s^2 + 65.48 s + 427.5");
        assert_eq!(polynomial(&[0.0, -24.725]), "-24.725 s");
        assert_eq!(polynomial(&[]), "0");
        assert_eq!(
            roots(&[Complex::new(-1.0, -2.0), Complex::new(-1.0, 2.0), Complex::new(3.0, 0.0)]),
            "-1.000 +- 2.000j, 3.000"
        );
        assert_eq!((percent(0.0123), percent(1e-6)), ("1.23 %".to_owned(), "1.0e-4 %".to_owned()));
    }
}
