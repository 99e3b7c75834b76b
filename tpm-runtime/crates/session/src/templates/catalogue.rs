//! The models to begin with.

use crate::templates::quantity::Quantity;
use crate::templates::simulated::Start;
use serde::Serialize;
use tpm_units::Unit;

/// A model to begin with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Template {
    /// Its name, a word.
    pub name: &'static str,
    /// The machine that it is of.
    pub machine: &'static str,
    /// Its coordinates: name and quantity.
    #[serde(skip)]
    pub(super) coordinates: &'static [(&'static str, Quantity)],
    /// Whether all of its coordinates may be angles instead.
    #[serde(skip)]
    pub(super) also_angles: bool,
    /// Its text, in which X, Y and U within brackets stand for the units of the coordinates and the input.
    #[serde(skip)]
    text: &'static str,
    /// Its text where sensors read the rates of all coordinates, and no position; nothing where these show too little of it.
    #[serde(skip)]
    pub(super) text_by_rates: Option<&'static str>,
    /// Numbers to begin with where there is no log.
    #[serde(skip)]
    pub(super) start: Start,
}

/// All of them, those of one coordinate first.
pub const TEMPLATES: [Template; 6] = [
    Template {
        name: "spring",
        machine: "a mass on a spring, with damping",
        coordinates: &[("x", Quantity::Length)],
        also_angles: true,
        text: include_str!("models/spring.tpm"),
        text_by_rates: None,
        start: Start {
            values: &[("m", 2.0), ("d", 3.0), ("k", 40.0)],
            kp: 2000.0,
            kd: 120.0,
            most: 800.0,
            off: 0.2,
            amplitude: 0.2,
        },
    },
    Template {
        name: "slider",
        machine: "a slider on a guide, with viscous and dry friction",
        coordinates: &[("x", Quantity::Length)],
        also_angles: false,
        text: include_str!("models/slider.tpm"),
        text_by_rates: Some(include_str!("models/slider.tpm")),
        start: Start {
            values: &[("m", 2.0), ("d", 10.0), ("c", 5.0), ("o", 1.0)],
            kp: 2000.0,
            kd: 120.0,
            most: 800.0,
            off: 0.2,
            amplitude: 0.2,
        },
    },
    Template {
        name: "motor",
        machine: "a motor with a gear and a load, with viscous and dry friction",
        coordinates: &[("phi", Quantity::Angle)],
        also_angles: false,
        text: include_str!("models/motor.tpm"),
        text_by_rates: Some(include_str!("models/motor.tpm")),
        start: Start {
            values: &[("J", 0.01), ("d", 0.02), ("c", 0.05), ("o", 0.01)],
            kp: 10.0,
            kd: 0.6,
            most: 10.0,
            off: 0.3,
            amplitude: 1.0,
        },
    },
    Template {
        name: "pendulum",
        machine: "a driven pendulum: an arm that carries its weight",
        coordinates: &[("phi", Quantity::Angle)],
        also_angles: false,
        text: include_str!("models/pendulum.tpm"),
        text_by_rates: None,
        start: Start {
            values: &[("J", 0.05), ("d", 0.02), ("c", 0.05), ("a", 1.5), ("b", 0.0)],
            kp: 50.0,
            kd: 3.0,
            most: 50.0,
            off: 0.3,
            amplitude: 0.5,
        },
    },
    Template {
        name: "two_masses",
        machine: "two masses with a spring between them: a belt, a spindle, a shaft",
        coordinates: &[("x", Quantity::Length), ("y", Quantity::Length)],
        also_angles: true,
        text: include_str!("models/two_masses.tpm"),
        text_by_rates: Some(include_str!("models/two_masses_by_rates.tpm")),
        start: Start {
            values: &[("m1", 2.0), ("m2", 1.0), ("d1", 3.0), ("d2", 1.0), ("d", 2.0), ("k", 300.0), ("o", 0.0)],
            kp: 4000.0,
            kd: 240.0,
            most: 800.0,
            off: 0.2,
            amplitude: 0.1,
        },
    },
    Template {
        name: "cart_pole",
        machine: "a driven cart with a pendulum that swings freely on it",
        coordinates: &[("x", Quantity::Length), ("phi", Quantity::Angle)],
        also_angles: false,
        text: include_str!("models/cart_pole.tpm"),
        text_by_rates: None,
        start: Start {
            values: &[("m", 2.0), ("d", 3.0), ("c", 1.0), ("b", 0.1), ("J", 0.04), ("e", 0.005), ("w", 0.981)],
            kp: 2000.0,
            kd: 120.0,
            most: 800.0,
            off: 0.4,
            amplitude: 0.1,
        },
    },
];

impl Template {
    /// The template of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        TEMPLATES.iter().find(|template| template.name == name)
    }

    /// The text of the model for coordinates and an input in these units, for sensors of positions or of rates alone.
    pub(super) fn filled(&self, model: &str, coordinates: &[&str], input: &str, by_rates: bool) -> String {
        let text = self.text_by_rates.filter(|_| by_rates).unwrap_or(self.text);
        let mut filled = String::with_capacity(text.len());
        for line in text.lines() {
            let (code, comment) = line.split_once("//").map_or((line, None), |(code, comment)| (code, Some(comment)));
            let mut rest = code;
            let mut written = String::new();
            while let Some((before, (unit, after))) =
                rest.split_once('[').and_then(|(before, rest)| Some((before, rest.split_once(']')?)))
            {
                written.push_str(&format!("{before}[{}]", unit_text(unit, coordinates, input)));
                rest = after;
            }
            written.push_str(rest);
            if let Some(comment) = comment {
                // Comments stand below each other, as `tpm fmt` has them, where the units leave room.
                let indent = if code.is_empty() { 0 } else { code.chars().count() };
                let least = written.trim_end().chars().count() + usize::from(!code.trim().is_empty());
                let width = indent.max(least);
                written = format!("{:width$}//{comment}", written.trim_end());
            }
            filled.push_str(&written);
            filled.push('\n');
        }
        filled.replace("ModelName", model)
    }
}

/// A unit of a template's text with the units of coordinates and input: `[U*s^2/X]` is kg for newtons and metres.
fn unit_text(unit: &str, coordinates: &[&str], input: &str) -> String {
    let mut text = String::new();
    for symbol in unit.chars() {
        match symbol {
            'U' => text.push_str(input),
            'X' => text.push_str(coordinates.first().copied().unwrap_or("1")),
            'Y' => text.push_str(coordinates.get(1).copied().unwrap_or("1")),
            symbol => text.push(symbol),
        }
    }
    // What masses and inertias are called; other products are as plain as they stand.
    let plain = ["kg", "kg*m", "kg*m^2"];
    let masslike = unit.contains("s^2");
    let parsed = Unit::parse(&text).filter(|_| masslike);
    let called = parsed.and_then(|unit| plain.into_iter().find(|plain| Unit::parse(plain).as_ref() == Some(&unit)));
    called.map_or(text, str::to_owned)
}
