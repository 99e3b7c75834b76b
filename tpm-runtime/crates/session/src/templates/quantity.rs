//! What a column measures, by its unit or by its name.

use serde::Serialize;
use std::fmt;
use tpm_log::unit_of;
use tpm_units::Unit;

/// What a column most likely holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Quantity {
    /// A length.
    Length,
    /// An angle.
    Angle,
    /// A position, of which nothing says whether it is a length or an angle.
    Position,
    /// A force.
    Force,
    /// A torque.
    Torque,
    /// A voltage.
    Voltage,
    /// A current.
    Current,
    /// An input, of which nothing says what it is.
    Drive,
    /// The rate of a position.
    Rate,
    /// What was asked for instead of measured: a reference, a set point.
    Reference,
    /// Something that no coordinate and no input of a machine is: an acceleration, a temperature.
    Other,
    /// Neither unit nor name says what it is.
    Unknown,
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Length => "a length",
            Self::Angle => "an angle",
            Self::Position => "a position",
            Self::Force => "a force",
            Self::Torque => "a torque",
            Self::Voltage => "a voltage",
            Self::Current => "a current",
            Self::Drive => "an input",
            Self::Rate => "a rate",
            Self::Reference => "a reference",
            Self::Other => "something else",
            Self::Unknown => "not known",
        })
    }
}

/// Words of names that say what a column holds where it states no unit, in small letters.
const WORDS: [(Quantity, &[&str]); 10] = [
    (Quantity::Rate, &["v", "vel", "velocity", "speed", "rate", "omega", "dot", "qd", "dq", "rpm"]),
    (Quantity::Other, &["acc", "accel", "acceleration", "temp", "temperature", "status", "flag", "index", "sample"]),
    (Quantity::Torque, &["tau", "torque", "trq", "moment"]),
    (Quantity::Force, &["f", "force"]),
    (Quantity::Voltage, &["volt", "voltage"]),
    (Quantity::Current, &["i", "iq", "current", "amp"]),
    (Quantity::Drive, &["u", "input", "effort", "pwm", "duty", "drive"]),
    (Quantity::Angle, &["phi", "theta", "th", "alpha", "beta", "angle", "angular", "q", "encoder"]),
    (Quantity::Length, &["x", "y", "z", "s", "stroke", "displacement"]),
    (Quantity::Position, &["pos", "position"]),
];

/// Words that say that a column was asked for, and not measured.
const REFERENCES: [&str; 11] =
    ["ref", "reference", "des", "desired", "cmd", "commanded", "target", "setpoint", "ff", "soll", "error"];

impl Quantity {
    /// What a column holds, by its name and the unit that its header states.
    #[must_use]
    pub fn of(name: &str, unit: Option<&str>) -> Self {
        // Two ends of words: what is no letter, and a capital behind a small letter (`motorCurrent`).
        let mut words = vec![String::new()];
        let mut before_small = false;
        for letter in name.chars() {
            if !letter.is_alphabetic() || (letter.is_uppercase() && before_small) {
                words.push(String::new());
            }
            if letter.is_alphabetic()
                && let Some(word) = words.last_mut()
            {
                word.extend(letter.to_lowercase());
            }
            before_small = letter.is_lowercase();
        }
        let has = |of: &[&str]| words.iter().any(|word| of.contains(&word.as_str()));
        if has(&REFERENCES) {
            return Self::Reference;
        }
        match unit {
            Some(text) => Self::of_unit(text),
            None => WORDS.iter().find(|(_, of)| has(of)).map_or(Self::Unknown, |(quantity, _)| *quantity),
        }
    }

    /// What has a unit.
    fn of_unit(text: &str) -> Self {
        let Some(unit) = unit_of(text) else { return Self::Other };
        let like = |other: &str| Unit::parse(other).is_some_and(|other| other.same_dimension(&unit));
        if like("1") {
            // Radians are numbers: what the header calls an angle is one, and a percentage is none.
            return if unit.is_one() && !text.contains("rad") { Self::Other } else { Self::Angle };
        }
        let known = [
            ("m", Self::Length),
            ("N", Self::Force),
            ("N*m", Self::Torque),
            ("V", Self::Voltage),
            ("A", Self::Current),
        ];
        let known = known.iter().find(|(other, _)| like(other)).map(|(_, quantity)| *quantity);
        known.or_else(|| Self::of_rate(text).map(|_| Self::Rate)).unwrap_or(Self::Other)
    }

    /// Of which quantity a column in a unit is the rate; nothing where it is that of none.
    pub(super) fn of_rate(text: &str) -> Option<Self> {
        let unit = unit_of(text)?;
        let like = |other: &str| Unit::parse(other).is_some_and(|other| other.same_dimension(&unit));
        [("m/s", Self::Length), ("1/s", Self::Angle)].into_iter().find(|(other, _)| like(other)).map(|(_, of)| of)
    }

    /// The unit in which a model has it; that of `else_as` where nothing is known of its kind.
    pub(super) fn unit(self, else_as: Self) -> &'static str {
        match self {
            Self::Length => "m",
            Self::Angle => "rad",
            Self::Force => "N",
            Self::Torque => "N*m",
            Self::Voltage => "V",
            Self::Current => "A",
            _ if else_as == self => "1",
            _ => else_as.unit(else_as),
        }
    }

    /// Whether a column may be an input.
    pub(super) fn drives(self) -> bool {
        matches!(self, Self::Force | Self::Torque | Self::Voltage | Self::Current | Self::Drive)
    }

    /// Whether a column says that it is a position.
    pub(super) fn is_position(self) -> bool {
        matches!(self, Self::Length | Self::Angle | Self::Position)
    }

    /// Whether a column may be a coordinate of such a quantity. A voltage is none: it would become the position of a mass.
    pub(super) fn may_be(self, wanted: Self) -> bool {
        self == wanted || matches!(self, Self::Position | Self::Unknown)
    }
}
