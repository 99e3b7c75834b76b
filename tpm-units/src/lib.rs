//! Units of measurement, exactly.
//!
//! Invariant: a [`Unit`] is a product of powers of the seven SI base units times a scale, and the scale is kept as the powers of
//! the factors that make it up, of which none is a product of powers of others: 2, 3, 5, pi, and the whole numbers in the
//! definitions of the inch, the pound and the standard acceleration of gravity. Every unit of the table has such a scale, products
//! and roots of them do too, and so nothing is ever rounded: mm and m differ by exactly 2^-3 5^-3, deg and rad by pi/180. `rad` is 1.
//!
//! The table: m, g, s, A, K, mol, cd, N, J, W, V, C, F, ohm, S, H, Wb, T, Pa, Hz, rad, l, each with the prefixes G, M, k, h, d,
//! c, m, u, n, p; and without prefixes min, h, deg, rev, rpm (2 pi/60 rad/s), bar, in, ft, lb, lbf, ozf, psi, kgf, and 1.

use std::fmt::{self, Display, Formatter};

use num_rational::Ratio;
use num_traits::{CheckedAdd, CheckedMul, CheckedSub, Zero};

/// An exponent; halves come from square roots.
pub type Exponent = Ratio<i64>;

/// Parentheses within parentheses that are read.
const DEEPEST: usize = 16;
const BASE: [&str; 7] = ["kg", "m", "s", "A", "K", "mol", "cd"];
/// Factors of scales. An inch is 127/5000 m, a pound 45359237/10^8 kg, and the standard acceleration of gravity 196133/20000 m/s^2.
const FACTORS: [(&str, f64); 7] = [
    ("2", 2.0),
    ("3", 3.0),
    ("5", 5.0),
    ("pi", std::f64::consts::PI),
    ("127", 127.0),
    ("45359237", 45_359_237.0),
    ("196133", 196_133.0),
];

/// A unit: powers of kg, m, s, A, K, mol, cd, and of the scale's factors.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Unit {
    base: [Exponent; 7],
    scale: [Exponent; FACTORS.len()],
}

/// Name, powers of kg, m, s, A, K, powers of the scale's first factors, whether prefixes are allowed.
type Row = (&'static str, [i8; 5], &'static [i8], bool);

const TABLE: &[Row] = &[
    ("m", [0, 1, 0, 0, 0], &[], true),
    ("g", [1, 0, 0, 0, 0], &[-3, 0, -3], true),
    ("s", [0, 0, 1, 0, 0], &[], true),
    ("A", [0, 0, 0, 1, 0], &[], true),
    ("K", [0, 0, 0, 0, 1], &[], true),
    ("N", [1, 1, -2, 0, 0], &[], true),
    ("J", [1, 2, -2, 0, 0], &[], true),
    ("W", [1, 2, -3, 0, 0], &[], true),
    ("V", [1, 2, -3, -1, 0], &[], true),
    ("C", [0, 0, 1, 1, 0], &[], true),
    ("F", [-1, -2, 4, 2, 0], &[], true),
    ("ohm", [1, 2, -3, -2, 0], &[], true),
    ("S", [-1, -2, 3, 2, 0], &[], true),
    ("H", [1, 2, -2, -2, 0], &[], true),
    ("Wb", [1, 2, -2, -1, 0], &[], true),
    ("T", [1, 0, -2, -1, 0], &[], true),
    ("Pa", [1, -1, -2, 0, 0], &[], true),
    ("Hz", [0, 0, -1, 0, 0], &[], true),
    ("rad", [0, 0, 0, 0, 0], &[], true),
    ("min", [0, 0, 1, 0, 0], &[2, 1, 1], false),
    ("h", [0, 0, 1, 0, 0], &[4, 2, 2], false),
    ("deg", [0, 0, 0, 0, 0], &[-2, -2, -1, 1], false),
    ("rev", [0, 0, 0, 0, 0], &[1, 0, 0, 1], false),
    ("rpm", [0, 0, -1, 0, 0], &[-1, -1, -1, 1], false),
    ("bar", [1, -1, -2, 0, 0], &[5, 0, 5], false),
    ("l", [0, 3, 0, 0, 0], &[-3, 0, -3], true),
    ("in", [0, 1, 0, 0, 0], &[-3, 0, -4, 0, 1], false),
    ("ft", [0, 1, 0, 0, 0], &[-1, 1, -4, 0, 1], false),
    ("lb", [1, 0, 0, 0, 0], &[-8, 0, -8, 0, 0, 1], false),
    ("kgf", [1, 1, -2, 0, 0], &[-5, 0, -4, 0, 0, 0, 1], false),
    ("lbf", [1, 1, -2, 0, 0], &[-13, 0, -12, 0, 0, 1, 1], false),
    ("ozf", [1, 1, -2, 0, 0], &[-17, 0, -12, 0, 0, 1, 1], false),
    ("psi", [1, -1, -2, 0, 0], &[-7, 0, -4, 0, -2, 1, 1], false),
];

const PREFIXES: [(&str, i8); 10] =
    [("G", 9), ("M", 6), ("k", 3), ("h", 2), ("d", -1), ("c", -2), ("m", -3), ("u", -6), ("n", -9), ("p", -12)];

/// Names that a message may suggest.
pub fn names() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|row| row.0).chain(["kg", "mm", "cm", "km", "ms", "kN", "mH", "mA", "mol", "cd"])
}

impl Unit {
    /// The unit 1, which is also rad.
    #[must_use]
    pub fn one() -> Self {
        Self { base: [Exponent::zero(); 7], scale: [Exponent::zero(); FACTORS.len()] }
    }

    /// The second.
    #[must_use]
    pub fn second() -> Self {
        Self::of(&TABLE[2], 0)
    }

    /// The unit of a name of the table, with or without prefix.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        // Exact names first: `min` is the minute and `cd` the candela, not a thousandth of an inch or a hundredth of a day.
        if let Some(row) = TABLE.iter().find(|row| row.0 == name) {
            return Some(Self::of(row, 0));
        }
        let amount = |index: usize| {
            let mut unit = Self::one();
            unit.base[index] = Exponent::from_integer(1);
            unit
        };
        match name {
            "mol" => return Some(amount(5)),
            "cd" => return Some(amount(6)),
            _ => {}
        }
        PREFIXES.iter().find_map(|&(prefix, power)| {
            let rest = name.strip_prefix(prefix)?;
            TABLE.iter().find(|row| row.0 == rest && row.3).map(|row| Self::of(row, power))
        })
    }

    /// The unit of a product of powers of names, such as `kg*m^2/s`, `N/(m/s)^2` or `m^(5/2)/s`, as results write it; none where a
    /// name is not one of the table.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut rest = text;
        let unit = Self::product(&mut rest, 0)?;
        rest.is_empty().then_some(unit)
    }

    /// Takes a product from the beginning of a text.
    fn product(rest: &mut &str, depth: usize) -> Option<Self> {
        let mut product = Self::one();
        let mut sign = 1;
        loop {
            *rest = rest.trim_start();
            let base = if let Some(inner) = rest.strip_prefix('(').filter(|_| depth < DEEPEST) {
                *rest = inner;
                let unit = Self::product(rest, depth + 1)?;
                *rest = rest.strip_prefix(')')?;
                unit
            } else {
                let end = rest.find(['*', '/', '^', '(', ')']).unwrap_or(rest.len());
                let name = rest[..end].trim_end();
                *rest = &rest[end..];
                if name == "1" { Self::one() } else { Self::named(name)? }
            };
            let exponent = match rest.strip_prefix('^') {
                Some(power) => {
                    *rest = power;
                    exponent(rest)?
                }
                None => Exponent::from_integer(1),
            };
            product = product.times(&base.power(exponent.checked_mul(&Exponent::from_integer(sign))?)?)?;
            *rest = rest.trim_start();
            sign = match rest.chars().next() {
                Some('*') => 1,
                Some('/') => -1,
                _ => return Some(product),
            };
            *rest = &rest[1..];
        }
    }

    fn of(row: &Row, ten: i8) -> Self {
        let mut unit = Self::one();
        for (to, &from) in unit.base.iter_mut().zip(&row.1) {
            *to = Exponent::from_integer(from.into());
        }
        for (to, &from) in unit.scale.iter_mut().zip(row.2) {
            *to = Exponent::from_integer(from.into());
        }
        unit.scale[0] += i64::from(ten);
        unit.scale[2] += i64::from(ten);
        unit
    }

    fn zip(&self, other: &Self, join: impl Fn(&Exponent, &Exponent) -> Option<Exponent>) -> Option<Self> {
        let mut unit = Self::one();
        for index in 0..7 {
            unit.base[index] = join(&self.base[index], &other.base[index])?;
        }
        for index in 0..FACTORS.len() {
            unit.scale[index] = join(&self.scale[index], &other.scale[index])?;
        }
        Some(unit)
    }

    /// The product; none when an exponent leaves 64 bits.
    #[must_use]
    pub fn times(&self, other: &Self) -> Option<Self> {
        self.zip(other, CheckedAdd::checked_add)
    }

    /// The quotient; none when an exponent leaves 64 bits.
    #[must_use]
    pub fn over(&self, other: &Self) -> Option<Self> {
        self.zip(other, CheckedSub::checked_sub)
    }

    /// A power; none when an exponent leaves 64 bits.
    #[must_use]
    pub fn power(&self, exponent: Ratio<i64>) -> Option<Self> {
        self.zip(self, |power, _| power.checked_mul(&exponent))
    }

    /// Whether this is 1 with scale 1.
    #[must_use]
    pub fn is_one(&self) -> bool {
        *self == Self::one()
    }

    /// Whether this is the newton metre, which is the joule too.
    pub fn is_torque(&self) -> bool {
        TABLE.iter().any(|row| row.0 == "J" && Self::of(row, 0) == *self)
    }

    /// Whether both measure the same quantity, in whatever scale.
    #[must_use]
    pub fn same_dimension(&self, other: &Self) -> bool {
        self.base == other.base
    }

    /// Names and powers of the base units; none when the unit has a scale.
    pub fn base_powers(&self) -> Option<impl Iterator<Item = (&'static str, Exponent)> + '_> {
        let plain = self.scale.iter().all(Zero::is_zero);
        plain.then(|| BASE.into_iter().zip(self.base).filter(|(_, power)| !power.is_zero()))
    }

    /// How many of `other` one of this is, written as a quotient of products such as `1/1000` or `pi/180`; for units of the
    /// same dimension.
    #[must_use]
    pub fn factor(&self, other: &Self) -> String {
        self.over(other).map_or_else(|| "an enormous factor".to_owned(), |ratio| ratio.scale_text())
    }

    /// How many of `other` one of this is, as a number; none for units of different quantities.
    #[must_use]
    pub fn ratio(&self, other: &Self) -> Option<f64> {
        let ratio = self.over(other).filter(|ratio| ratio.base.iter().all(Zero::is_zero))?;
        // Numerator and denominator are whole numbers of few digits, and so only the division and the product with pi round.
        let (mut above, mut below) = (1.0, 1.0);
        for (factor, exponent) in FACTORS.iter().map(|factor| factor.1).zip(&ratio.scale) {
            let size = if *exponent < Exponent::zero() { -exponent } else { *exponent };
            let size = *size.numer() as f64 / *size.denom() as f64;
            *(if *exponent < Exponent::zero() { &mut below } else { &mut above }) *= f64::powf(factor, size);
        }
        Some(above / below)
    }

    fn scale_text(&self) -> String {
        let mut numbers = [1_u128, 1];
        let mut rest: [Vec<String>; 2] = [Vec::new(), Vec::new()];
        for ((name, _), exponent) in FACTORS.iter().zip(&self.scale) {
            if exponent.is_zero() {
                continue;
            }
            let side = usize::from(*exponent < Exponent::zero());
            let size = if side == 1 { -exponent } else { *exponent };
            let whole = name.parse::<u128>().ok().filter(|_| size.is_integer());
            let value = whole.and_then(|prime| {
                let size = u32::try_from(size.to_integer()).ok()?;
                prime.checked_pow(size)?.checked_mul(numbers[side])
            });
            match value {
                Some(value) => numbers[side] = value,
                None => rest[side].push(power_text(name, size)),
            }
        }
        let side = |side: usize| {
            let mut parts = std::mem::take(&mut rest[side].clone());
            if numbers[side] != 1 || parts.is_empty() {
                parts.insert(0, numbers[side].to_string());
            }
            parts
        };
        let (above, below) = (side(0), side(1));
        match below.as_slice() {
            [one] if one == "1" => above.join("*"),
            [one] => format!("{}/{one}", above.join("*")),
            several => format!("{}/({})", above.join("*"), several.join("*")),
        }
    }
}

/// Takes an exponent from the beginning of a text: an integer, or a fraction in parentheses.
fn exponent(rest: &mut &str) -> Option<Exponent> {
    let (inside, text) = match rest.strip_prefix('(') {
        Some(inner) => (true, &inner[..inner.find(')')?]),
        None => {
            let digit = |(at, c): &(usize, char)| c.is_ascii_digit() || *at == 0 && *c == '-';
            let end = rest.char_indices().find(|place| !digit(place)).map_or(rest.len(), |(at, _)| at);
            (false, &rest[..end])
        }
    };
    *rest = &rest[text.len() + if inside { 2 } else { 0 }..];
    // A fraction of zero denominator is no number, which `Ratio` panics at.
    let (above, below) = text.split_once('/').unwrap_or((text, "1"));
    let (above, below) = (above.trim().parse().ok()?, below.trim().parse().ok().filter(|below| *below > 0)?);
    Some(Exponent::new(above, below))
}

/// A power of a name, as units are written: `m`, `m^2`, `m^(5/2)`.
#[must_use]
pub fn power_text(name: &str, exponent: Exponent) -> String {
    if exponent == Exponent::from_integer(1) {
        name.to_owned()
    } else if exponent.is_integer() {
        format!("{name}^{exponent}")
    } else {
        format!("{name}^({exponent})")
    }
}

impl Display for Unit {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        // What is derived in a model of a machine is more often the torque on a rotary coordinate than an energy.
        if self.is_torque() {
            return f.write_str("N*m");
        }
        if let Some(row) = TABLE
            .iter()
            .find(|row| row.0 != "rad" && Self::of(row, 0) == *self && row.1.iter().filter(|&&e| e != 0).count() > 1)
        {
            return f.write_str(row.0);
        }
        let mut text = String::new();
        let scale = self.scale_text();
        if scale != "1" {
            text.push_str(&scale);
        }
        for above in [true, false] {
            for (name, exponent) in BASE.iter().zip(&self.base) {
                if exponent.is_zero() || (*exponent > Exponent::zero()) != above {
                    continue;
                }
                match (above, text.is_empty()) {
                    (true, true) => {}
                    (true, false) => text.push('*'),
                    (false, true) => text.push_str("1/"),
                    (false, false) => text.push('/'),
                }
                text.push_str(&power_text(name, if above { *exponent } else { -exponent }));
            }
        }
        f.write_str(if text.is_empty() { "1" } else { &text })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(name: &str) -> Unit {
        Unit::named(name).expect("a unit")
    }

    #[test]
    fn derived_units_are_products_of_base_units() {
        let newton = unit("kg").times(&unit("m")).and_then(|u| u.over(&unit("s"))).and_then(|u| u.over(&unit("s")));
        assert_eq!(newton, Some(unit("N")));
        assert_eq!(unit("V").times(&unit("A")), Some(unit("W")));
        assert_eq!(unit("V").over(&unit("A")), Some(unit("ohm")));
        assert_eq!(unit("ohm").times(&unit("s")), Some(unit("H")));
        assert_eq!(unit("V").times(&unit("s")), Some(unit("Wb")));
        assert_eq!(unit("C").over(&unit("V")), Some(unit("F")));
        assert_eq!(unit("rad"), Unit::one());
    }

    #[test]
    fn scales_are_exact() {
        assert_eq!(unit("mm").factor(&unit("m")), "1/1000");
        assert_eq!(unit("km").factor(&unit("mm")), "1000000");
        assert_eq!(unit("deg").factor(&unit("rad")), "pi/180");
        assert_eq!(unit("rpm").factor(&unit("Hz")), "pi/30");
        assert_eq!(unit("min").factor(&unit("s")), "60");
        assert_eq!(unit("rad").factor(&unit("deg")), "180/pi");
        assert_eq!(unit("deg").ratio(&unit("rad")), Some(std::f64::consts::PI / 180.0));
        assert_eq!(unit("us").ratio(&unit("s")), Some(1e-6));
        assert_eq!(unit("m").ratio(&unit("s")), None);
        // Inches, pounds and the standard acceleration of gravity are defined so; roots of them cancel as those of others do.
        assert_eq!(unit("in").factor(&unit("mm")), "127/5");
        assert_eq!(unit("ft").factor(&unit("in")), "12");
        assert_eq!(unit("lbf").over(&unit("lb")), unit("kgf").over(&unit("kg")));
        assert_eq!(unit("lbf").factor(&unit("ozf")), "16");
        assert_eq!(unit("lbf").over(&unit("in")).and_then(|force| force.over(&unit("in"))), Some(unit("psi")));
        assert_eq!(unit("kgf").ratio(&unit("N")), Some(9.80665));
        assert_eq!(unit("l").factor(&unit("m").power(Ratio::from_integer(3)).expect("small")), "1/1000");
        let root = |name: &str| unit(name).power(Ratio::new(1, 2)).expect("small");
        assert_eq!(root("psi").times(&root("psi")), Some(unit("psi")));
    }

    #[test]
    fn names_are_written_back() {
        assert_eq!(unit("N").to_string(), "N");
        assert_eq!(unit("J").to_string(), "N*m");
        assert_eq!(unit("kg").to_string(), "kg");
        assert_eq!(unit("N").over(&unit("m")).map(|u| u.to_string()), Some("kg/s^2".to_owned()));
        assert_eq!(unit("mm").to_string(), "1/1000*m");
        assert_eq!(unit("m").power(Ratio::new(1, 2)).map(|u| u.to_string()), Some("m^(1/2)".to_owned()));
        assert_eq!(Unit::named("Nm"), None);
    }

    #[test]
    fn products_are_read_from_text() {
        assert_eq!(Unit::parse("N*m*s/rad"), Unit::parse("kg*m^2/s"));
        assert_eq!(Unit::parse("1/s"), unit("s").power(Ratio::from_integer(-1)));
        assert_eq!(Unit::parse("1"), Some(Unit::one()));
        assert_ne!(Unit::parse("mm"), Unit::parse("m"));
        assert_eq!(Unit::parse("N/(m/s)^2"), Unit::parse("kg/m"));
        assert_eq!(
            Unit::parse("m^(5/2) / s"),
            unit("m").power(Ratio::new(5, 2)).and_then(|root| root.over(&unit("s")))
        );
        assert_eq!(Unit::parse("m^-2"), Unit::parse("1/m^(2/1)"));
        let no_units =
            ["", "N*", "frog", "m^x", "m^", "m^(1/0)", "m^(1/2", "(m", "m)", "m^2^2", "m^9223372036854775808"];
        assert!(no_units.into_iter().all(|text| Unit::parse(text).is_none()));
        for written in ["m^(5/2)/s", "kg*m^(1/2)", "1/s", "1/1000*m"] {
            assert_eq!(
                Unit::parse(written).map(|unit| unit.to_string()),
                (written != "1/1000*m").then(|| written.into())
            );
        }
    }

    #[test]
    fn every_prefix_is_read() {
        for (prefix, power) in PREFIXES {
            let name = format!("{prefix}V");
            let ratio = unit(&name).over(&unit("V")).expect("small");
            assert_eq!(ratio.scale[0], Exponent::from_integer(power.into()));
            assert_eq!(ratio.scale[2], Exponent::from_integer(power.into()));
        }
    }
}
