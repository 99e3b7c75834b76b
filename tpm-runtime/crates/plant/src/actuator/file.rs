//! Motor files: the motors of a machine, by the input that each drives.
//!
//! ```toml
//! [motors.F]                      # the input of the model that it drives
//! torque_constant = 0.115         # k_t, N m/A
//! back_emf = 0.115                # k_v, V s/rad; the torque constant when not given, as in SI units it is
//! resistance = 4.0                # R, ohm
//! inductance = 7.7e-3             # L, H
//! rotor_inertia = 0.0             # J, kg m^2, of the rotor where the model does not contain it
//! pinion_radius = 0.02            # m, with a rack; or gear = 25, rotor turns per turn of the joint; a direct drive else
//!
//! [motors.F.limits]               # each of them may be left out
//! current = 12.3                  # A
//! voltage = 50.0                  # V
//! power = 600.0                   # W, into the motor
//!
//! [motors.F.amplifier]
//! bandwidth = 2000.0              # rad/s, of the current loop; 2000 when not given
//! natural_frequency = 5000.0      # rad/s, of a second-order low pass before it; none when not given
//! quality = 0.7                   # its quality factor; 1/sqrt(2) when not given
//! ```
//!
//! Invariant: every field is documented here and in SI units, unknown fields are refused, and a fault is reported with line and
//! column. Nothing is converted: the driven coordinate must be in rad or 1 (gear or direct) or in m (pinion), and the input in
//! N m or N, where the model says.

use crate::actuator::motor::{Amplifier, Limits, Motor};
use crate::actuator::placed::{self, FileFault, Placed, Table};
use tpm_controller::model::Model;
use tpm_motion::{Dynamics, LowPass};
use tpm_report::Remedy;

/// Bandwidth of a current loop where the file gives none, rad/s.
const DEFAULT_BANDWIDTH_RAD_PER_S: f64 = 2000.0;

/// A field of a motor file: its name, and its meaning with the unit.
type Field = (&'static str, &'static str);

/// Fields of a motor.
const MOTOR: [Field; 9] = [
    ("torque_constant", "Torque per current, N m/A."),
    ("back_emf", "Voltage per speed, V s/rad; the torque constant when not given, as in SI units it is."),
    ("resistance", "Resistance, ohm."),
    ("inductance", "Inductance, H."),
    ("rotor_inertia", "Inertia of the rotor where the model does not contain it, kg m^2; zero when not given."),
    ("gear", "Turns of the rotor per turn of the joint; a direct drive when neither this nor pinion_radius is given."),
    ("pinion_radius", "Radius of a pinion that moves a rack, m."),
    ("limits", "What the motor must not pass; no limit where not given."),
    ("amplifier", "The amplifier before the motor."),
];
/// Fields of a motor's limits.
const LIMITS: [Field; 3] = [
    ("current", "Largest current, A."),
    ("voltage", "Largest voltage, V."),
    ("power", "Largest power into the motor, W."),
];
/// Fields of a motor's amplifier.
const AMPLIFIER: [Field; 3] = [
    ("bandwidth", "Bandwidth of the current loop, rad/s; 2000 when not given."),
    (
        "natural_frequency",
        "Natural frequency of a low pass of second order before the loop, rad/s; none when not given.",
    ),
    ("quality", "Quality factor of that low pass; 1/sqrt(2) when not given."),
];
/// Fields of a motor without which it is refused.
#[cfg(feature = "schema")]
const REQUIRED_OF_MOTOR: [&str; 3] = ["torque_constant", "resistance", "inductance"];

/// The JSON schema of a motor file.
#[cfg(feature = "schema")]
#[must_use]
pub fn schema() -> serde_json::Value {
    let numbers = |fields: &[Field]| -> serde_json::Map<String, serde_json::Value> {
        let number = |(name, meaning): &Field| {
            (name.to_string(), serde_json::json!({ "type": "number", "description": meaning }))
        };
        fields.iter().map(number).collect()
    };
    let table = |fields: &[Field], meaning: &str| {
        serde_json::json!({
            "type": "object", "description": meaning, "properties": numbers(fields), "additionalProperties": false
        })
    };
    let mut motor = table(&MOTOR, "The motor on an input, by the input's name.");
    for (name, fields) in [("limits", &LIMITS), ("amplifier", &AMPLIFIER)] {
        let meaning = MOTOR.iter().find(|field| field.0 == name).map_or("", |field| field.1);
        motor["properties"][name] = table(fields, meaning);
    }
    motor["required"] = serde_json::json!(REQUIRED_OF_MOTOR);
    serde_json::json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Motors",
        "type": "object",
        "properties": { "motors": {
            "type": "object", "description": "The motors by the input that each drives.", "additionalProperties": motor
        } },
        "required": ["motors"],
        "additionalProperties": false
    })
}

fn names<const N: usize>(fields: &[Field; N]) -> [&'static str; N] {
    fields.map(|field| field.0)
}

/// A motor file as it was read.
#[derive(Clone, Debug)]
pub struct MotorFile {
    text: String,
    whole: Table,
    /// Whether the file holds motors only, so that other tables are refused.
    alone: bool,
}

/// Motors by input of a model.
pub type Motors = Vec<Option<Motor>>;

impl MotorFile {
    /// Reads a motor file's text.
    ///
    /// # Errors
    /// [`FileFault`] when the text is not TOML.
    pub fn parse(text: &str) -> Result<Self, FileFault> {
        Ok(MotorFile { text: text.to_string(), whole: placed::parse(text)?, alone: true })
    }

    /// Reads the motors from the text of a file that has other tables too.
    ///
    /// # Errors
    /// [`FileFault`] when the text is not TOML.
    pub fn within(text: &str) -> Result<Self, FileFault> {
        Ok(MotorFile { alone: false, ..Self::parse(text)? })
    }

    /// The dynamics of every input's amplifier, as far as the file states them. An amplifier that it does not describe
    /// is ideal here, without the default bandwidth.
    ///
    /// # Errors
    /// [`FileFault`] at the first unknown field, motor on no input, or value of an amplifier that is not positive.
    pub fn dynamics(&self, model: &dyn Model<f64>) -> Result<Vec<Dynamics>, FileFault> {
        let text = &self.text;
        let mut found = vec![Dynamics::default(); model.dims().inputs];
        for (input, _, section) in self.sections(model)? {
            if let Some(amplifier) = section.table(text, "amplifier")? {
                found[input].filter = self.amplifier(Some(amplifier))?.filter;
                found[input].bandwidth = amplifier.positive(text, "bandwidth")?.map(|found| found.value);
            }
        }
        Ok(found)
    }

    /// The tables of the motors, each with the index of its input and its offset in the text.
    fn sections(&self, model: &dyn Model<f64>) -> Result<Vec<(usize, usize, &Table)>, FileFault> {
        let text = &self.text;
        if self.alone {
            self.whole.only(text, &["motors"])?;
        }
        let found = self.whole.table(text, "motors")?;
        let all = self.whole.required(text, "motors", ": add a table [motors.INPUT]", found)?;
        let inputs: Vec<&str> = (0..model.dims().inputs).map(|i| model.input(i).name).collect();
        let mut sections = Vec::new();
        for Placed { value: name, offset } in all.keys() {
            let Some(input) = inputs.iter().position(|known| *known == name) else {
                let message = format!(
                    "the motor `{name}` is on no input of model {}; its inputs are {}",
                    model.name(),
                    inputs.join(", ")
                );
                return Err(FileFault::at(text, offset, message));
            };
            if let Some(section) = all.table(text, name)? {
                sections.push((input, offset, section));
            }
        }
        Ok(sections)
    }

    /// The motors of a model's inputs. `driven` lists the coordinates that every input drives, as `tpm_symbolic::plan::split`
    /// finds them.
    ///
    /// # Errors
    /// [`FileFault`] at the first fault: an unknown or missing field, a motor on no input or on one that drives several
    /// coordinates, a constant that is not positive, a transmission that does not fit the units.
    pub fn motors(&self, model: &dyn Model<f64>, driven: &[Vec<usize>]) -> Result<Motors, FileFault> {
        let mut motors: Motors = vec![None; model.dims().inputs];
        for (input, offset, section) in self.sections(model)? {
            let [coordinate] = driven.get(input).map_or(&[][..], Vec::as_slice) else {
                let (name, count) = (model.input(input).name, driven.get(input).map_or(0, Vec::len));
                let message = format!(
                    "input `{name}` drives {count} coordinates; a motor needs the one that its rotor turns with (in an experiment, motion = {{ {name} = \"COORDINATE\" }} says so)"
                );
                let remedy = Some(Remedy::DrivenCoordinate { input: name.into() });
                return Err(FileFault { remedy, ..FileFault::at(&self.text, offset, message) });
            };
            motors[input] = Some(self.motor(section, offset, model, (input, *coordinate))?);
        }
        Ok(motors)
    }

    fn motor(
        &self,
        section: &Table,
        offset: usize,
        model: &dyn Model<f64>,
        (input, coordinate): (usize, usize),
    ) -> Result<Motor, FileFault> {
        let text = &self.text;
        let fault = |offset: usize, message: String| Err(FileFault::at(text, offset, message));
        section.only(text, &names(&MOTOR))?;
        // 1. The constants of the motor.
        let needed = |key: &str, unit: &str| -> Result<f64, FileFault> {
            Ok(section.required(text, key, unit, section.positive(text, key)?)?.value)
        };
        let torque_constant = needed("torque_constant", " (N m/A)")?;
        let rotor_inertia = match section.number(text, "rotor_inertia")? {
            Some(Placed { value, offset }) if value < 0.0 => {
                return fault(offset, format!("rotor_inertia = {value}: the value must not be negative"));
            }
            found => found.map_or(0.0, |found| found.value),
        };
        // 2. The transmission: a gear, a pinion, or a direct drive.
        let (gear, pinion) = (section.positive(text, "gear")?, section.positive(text, "pinion_radius")?);
        let (ratio, angle, place) = match (gear, pinion) {
            (Some(_), Some(radius)) => {
                return fault(radius.offset, "give either gear or pinion_radius, not both".into());
            }
            (Some(gear), None) => (gear.value, true, gear.offset),
            (None, Some(radius)) => (1.0 / radius.value, false, radius.offset),
            (None, None) => (1.0, true, offset),
        };
        // 3. The units of coordinate and input must fit the transmission.
        let (moved, acts) = (model.coordinate(coordinate), model.input(input));
        let (units, force): (&[&str], &[&str]) =
            if angle { (&["rad", "1"], &["N*m", "m*N", "J"]) } else { (&["m"], &["N"]) };
        if let Some(unit) = moved.unit.filter(|unit| !units.contains(unit)) {
            let remedy = match unit {
                "m" => "a linear coordinate needs pinion_radius (m)",
                "rad" | "1" => "an angle takes gear (rotor turns per turn of the joint), or nothing",
                _ => "declare the coordinate in m or rad: units are not converted",
            };
            let name = moved.name;
            let message =
                format!("this transmission is for a coordinate in {}, but `{name}` is in {unit}; {remedy}", units[0]);
            return fault(place, message);
        }
        if let Some(unit) = acts.unit.filter(|unit| !force.contains(unit)) {
            let message = format!(
                "this motor gives {}, but `{}` is in {unit}; a motor drives inputs in N*m, or in N by a pinion",
                force[0], acts.name
            );
            return fault(place, message);
        }
        Ok(Motor {
            torque_constant,
            back_emf: section.positive(text, "back_emf")?.map_or(torque_constant, |found| found.value),
            resistance: needed("resistance", " (ohm)")?,
            inductance: needed("inductance", " (H)")?,
            rotor_inertia,
            ratio,
            limits: self.limits(section.table(text, "limits")?)?,
            amplifier: self.amplifier(section.table(text, "amplifier")?)?,
        })
    }

    fn limits(&self, section: Option<&Table>) -> Result<Limits, FileFault> {
        let Some(section) = section else { return Ok(Limits::default()) };
        let text = &self.text;
        section.only(text, &names(&LIMITS))?;
        let limit = |key: &str| -> Result<f64, FileFault> {
            Ok(section.positive(text, key)?.map_or(f64::INFINITY, |found| found.value))
        };
        Ok(Limits { current: limit("current")?, voltage: limit("voltage")?, power: limit("power")? })
    }

    fn amplifier(&self, section: Option<&Table>) -> Result<Amplifier, FileFault> {
        let Some(section) = section else {
            return Ok(Amplifier { bandwidth: DEFAULT_BANDWIDTH_RAD_PER_S, filter: None });
        };
        let text = &self.text;
        section.only(text, &names(&AMPLIFIER))?;
        let bandwidth = section.positive(text, "bandwidth")?.map_or(DEFAULT_BANDWIDTH_RAD_PER_S, |found| found.value);
        let filter = match (section.positive(text, "natural_frequency")?, section.positive(text, "quality")?) {
            (None, None) => None,
            (None, Some(quality)) => {
                let message = "quality belongs to a filter; give its natural_frequency too".to_string();
                return Err(FileFault::at(text, quality.offset, message));
            }
            (Some(frequency), quality) => Some(LowPass {
                natural_frequency: frequency.value,
                quality: quality.map_or(std::f64::consts::FRAC_1_SQRT_2, |quality| quality.value),
            }),
        };
        Ok(Amplifier { bandwidth, filter })
    }
}

#[cfg(test)]
mod tests {
    use super::MotorFile;
    use tpm_report::Remedy;
    use tpm_test_support::models::TwoCarts;

    const GOOD: &str = "[motors.F]\ntorque_constant = 0.115\nresistance = 4\ninductance = 7.7e-3\npinion_radius = 0.02\n[motors.F.limits]\ncurrent = 12.3\n";

    fn fault(text: &str) -> String {
        let found = MotorFile::parse(text).and_then(|file| file.motors(&TwoCarts, &[vec![0]]));
        found.expect_err("a fault").to_string()
    }

    #[test]
    fn a_motor_is_read_and_its_defaults_are_those_that_are_documented() {
        let file = MotorFile::parse(GOOD).expect("a motor file");
        let motors = file.motors(&TwoCarts, &[vec![0]]).expect("fits");
        let motor = motors[0].expect("given");
        assert_eq!((motor.back_emf, motor.ratio, motor.rotor_inertia), (0.115, 50.0, 0.0));
        assert_eq!((motor.limits.current, motor.limits.power), (12.3, f64::INFINITY));
        assert_eq!((motor.amplifier.bandwidth, motor.amplifier.filter), (2000.0, None));
        // An amplifier that the file does not describe is ideal.
        assert!(file.dynamics(&TwoCarts).expect("fits")[0].is_ideal());
        let stated = format!("[other]\n{GOOD}[motors.F.amplifier]\nbandwidth = 900\nnatural_frequency = 300\n");
        let stated = MotorFile::within(&stated).expect("motors").dynamics(&TwoCarts).expect("fits")[0];
        assert_eq!(
            (stated.bandwidth, stated.filter.map(|f| f.natural_frequency), stated.delay),
            (Some(900.0), Some(300.0), 0.0)
        );
    }

    #[test]
    fn faults_are_reported_at_their_place() {
        let changed = |from: &str, to: &str| fault(&GOOD.replacen(from, to, 1));
        let found = changed("resistance = 4", "resistance = -4");
        assert_eq!(found, "line 3, column 14: resistance = -4: the value must be positive");
        let found = changed("inductance", "inductance_");
        assert!(found.starts_with("line 4, column 1: unknown field") && found.ends_with("inductance?"), "{found}");
        assert_eq!(
            changed("inductance = 7.7e-3\n", ""),
            "line 1, column 9: [motors.F] lacks `inductance` (H): add `inductance = ...` to it"
        );
        let found = changed("motors.F]", "motors.G]");
        assert!(found.starts_with("line 1, column 9: the motor `G` is on no input") && found.contains("F"), "{found}");
        assert!(changed("pinion_radius = 0.02", "pinion_radius = 0.02\ngear = 3").starts_with("line 5"));
        let found = changed("pinion_radius = 0.02", "gear = 20");
        assert!(found.starts_with("line 5, column 8") && found.contains("pinion_radius"), "{found}");
        let found = changed("current = 12.3", "current = 0");
        assert!(found.starts_with("line 7, column 11"), "{found}");
        assert!(changed("[motors.F.limits]\n", "[motors.F.amplifier]\nquality = 1\n").contains("`current`"));
        assert!(changed("current = 12.3", "current = \"12.3 A\"").contains("must be a finite number"));
        assert!(fault("").contains("lacks `motors`"));
        let file = MotorFile::parse(GOOD).expect("a motor file");
        let found = file.motors(&TwoCarts, &[vec![0, 1]]).expect_err("two coordinates");
        let remedy =
            Some(Remedy::DrivenCoordinate { input: tpm_controller::Model::<f64>::input(&TwoCarts, 0).name.into() });
        assert!(found.line == 1 && found.remedy == remedy, "{found}");
    }
}
