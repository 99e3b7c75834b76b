//! Units as headers of logs write them.
//!
//! A header states a unit as `deg/s`, `°/s`, `m/s2` or `Nm`. The text is translated here to a product of units of the
//! model language, which holds the only table of units with their exact factors.

use tpm_units::Unit;

/// Spellings in headers besides the names of the language, and the products that they mean.
const SPELLINGS: [(&str, &str); 55] = [
    ("-", "1"),
    ("°", "deg"),
    ("degree", "deg"),
    ("degrees", "deg"),
    ("radian", "rad"),
    ("radians", "rad"),
    ("rads", "rad"),
    ("revs", "rev"),
    ("rps", "rev/s"),
    ("sec", "s"),
    ("secs", "s"),
    ("second", "s"),
    ("seconds", "s"),
    ("msec", "ms"),
    ("msecs", "ms"),
    ("millisecond", "ms"),
    ("milliseconds", "ms"),
    ("usec", "us"),
    ("usecs", "us"),
    ("microsecond", "us"),
    ("microseconds", "us"),
    ("nsec", "ns"),
    ("nsecs", "ns"),
    ("nanosecond", "ns"),
    ("nanoseconds", "ns"),
    ("minute", "min"),
    ("minutes", "min"),
    ("hour", "h"),
    ("hours", "h"),
    ("meter", "m"),
    ("meters", "m"),
    ("metre", "m"),
    ("metres", "m"),
    ("Nm", "N*m"),
    ("mNm", "mN*m"),
    ("kNm", "kN*m"),
    ("Ncm", "N*cm"),
    ("Nmm", "N*mm"),
    ("newton", "N"),
    ("volt", "V"),
    ("volts", "V"),
    ("amp", "A"),
    ("amps", "A"),
    ("ampere", "A"),
    ("Ω", "ohm"),
    ("L", "l"),
    ("mL", "ml"),
    ("litre", "l"),
    ("liter", "l"),
    ("lpm", "l/min"),
    ("inch", "in"),
    ("inches", "in"),
    ("feet", "ft"),
    ("lbs", "lb"),
    ("kp", "kgf"),
];

/// Why a column cannot be converted to the unit of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum UnitFault {
    /// The text is no unit that is known.
    Unknown,
    /// The units measure different quantities.
    Different,
    /// Hertz may count turns or radians.
    Cycles,
}

/// The unit that a text of a header means; none where it is no unit.
pub fn unit_of(text: &str) -> Option<Unit> {
    let mut product = String::new();
    // A unit in brackets of its own, as in a row of units.
    let text = text.trim();
    let inner = [('[', ']'), ('(', ')'), ('<', '>')]
        .iter()
        .find_map(|(open, close)| text.strip_prefix(*open)?.strip_suffix(*close))
        .unwrap_or(text);
    let spelt = inner.replace("**", "^").replace("_per_", "/").replace(" per ", "/").replace("U/min", "rev/min");
    let mut name = String::new();
    let mut last_operator = true;
    for c in spelt.trim().chars() {
        match c {
            '*' | '·' | '⋅' | '×' | '/' | ' ' | '.' => {
                if c == ' ' && last_operator {
                    continue;
                }
                product.push_str(&factor(&name)?);
                name.clear();
                product.push(if c == '/' { '/' } else { '*' });
                last_operator = true;
            }
            _ => {
                name.push(c);
                last_operator = false;
            }
        }
    }
    product.push_str(&factor(&name)?);
    Unit::parse(&product)
}

/// One factor of a unit with its power, as the language writes it.
fn factor(text: &str) -> Option<String> {
    let text = text.replace(['µ', 'μ'], "u").replace('²', "^2").replace('³', "^3");
    let digits = text.trim_end_matches(|c: char| c.is_ascii_digit());
    let (name, power) = match text.split_once('^') {
        Some((name, power)) => (name, power),
        None if !digits.is_empty() && digits.len() < text.len() => {
            let sign = if digits.len() > 1 && digits.ends_with('-') { 1 } else { 0 };
            text.split_at(digits.len() - sign)
        }
        None => (text.as_str(), "1"),
    };
    let known = SPELLINGS
        .iter()
        .find(|(spelling, _)| *spelling == name || spelling.len() > 2 && spelling.eq_ignore_ascii_case(name));
    let name = known.map_or(name, |(_, unit)| *unit);
    if name.is_empty() {
        return None;
    }
    if power == "1" {
        return Some(name.to_string());
    }
    // A spelling that means a product takes no power, which would apply to its last factor alone.
    (!name.contains(['*', '/'])).then(|| format!("{name}^{power}"))
}

/// The factor from a unit of a header to the unit of a signal.
///
/// # Errors
/// [`UnitFault`] when the text is no unit, or one of another quantity.
pub(super) fn conversion(header: &str, signal: &str) -> Result<f64, UnitFault> {
    let own = unit_of(header).ok_or(UnitFault::Unknown)?;
    let wanted = unit_of(signal).ok_or(UnitFault::Different)?;
    let cycles = |text: &str| text.contains("Hz") || text.contains("1/min");
    if cycles(header) != cycles(signal) && own.same_dimension(&wanted) {
        return Err(UnitFault::Cycles);
    }
    own.ratio(&wanted).ok_or(UnitFault::Different)
}

#[cfg(test)]
mod tests {
    use super::{UnitFault, conversion};
    use std::f64::consts::PI;

    #[test]
    fn units_of_headers_are_converted() {
        for (header, signal, factor) in [
            ("deg", "rad", PI / 180.0),
            ("°", "rad", PI / 180.0),
            ("°/s", "rad/s", PI / 180.0),
            ("deg/sec", "rad/s", PI / 180.0),
            ("mrad", "rad", 1e-3),
            ("rpm", "rad/s", PI / 30.0),
            ("U/min", "rad/s", PI / 30.0),
            ("rev", "rad", 2.0 * PI),
            ("ms", "s", 1e-3),
            ("µs", "s", 1e-6),
            ("us", "s", 1e-6),
            ("nanoseconds", "s", 1e-9),
            ("Seconds", "s", 1.0),
            ("mm", "m", 1e-3),
            ("cm/s2", "m/s^2", 1e-2),
            ("m/s²", "m/s^2", 1.0),
            ("m s^-2", "m/s^2", 1.0),
            ("m s-2", "m/s^2", 1.0),
            ("mA", "A", 1e-3),
            ("kN", "N", 1e3),
            ("Nm", "N*m", 1.0),
            ("N.m", "N*m", 1.0),
            ("N·m", "J", 1.0),
            ("mNm", "N*m", 1e-3),
            ("Ncm", "N*m", 1e-2),
            ("[V]", "V", 1.0),
            ("-", "rad", 1.0),
            ("rad", "1", 1.0),
            ("rad_per_s", "rad/s", 1.0),
            ("L/min", "m^3/s", 1.0 / 60_000.0),
            ("LPM", "m^3/s", 1.0 / 60_000.0),
            ("ml/s", "m^3/s", 1e-6),
            ("in", "m", 0.0254),
            ("ft/s", "m/s", 0.3048),
            ("ozf in", "N*m", 0.028_349_523_125 * 9.806_65 * 0.0254),
            ("lbf*ft", "N*m", 0.453_592_37 * 9.806_65 * 0.3048),
            ("psi", "Pa", 0.453_592_37 * 9.806_65 / (0.0254 * 0.0254)),
        ] {
            let found = conversion(header, signal).unwrap_or_else(|fault| panic!("{header}: {fault:?}"));
            assert!((found / factor - 1.0).abs() < 1e-15, "{header} to {signal}: {found} {factor}");
        }
    }

    #[test]
    fn other_quantities_and_other_words_are_refused() {
        for (header, signal, fault) in [
            ("A", "V", UnitFault::Different),
            ("deg", "m", UnitFault::Different),
            ("counts", "rad", UnitFault::Unknown),
            ("", "rad", UnitFault::Unknown),
            ("/", "rad", UnitFault::Unknown),
            ("m^x", "m", UnitFault::Unknown),
            ("2", "m", UnitFault::Unknown),
            ("Hz", "rad/s", UnitFault::Cycles),
        ] {
            assert_eq!(conversion(header, signal), Err(fault), "{header}");
        }
    }
}
