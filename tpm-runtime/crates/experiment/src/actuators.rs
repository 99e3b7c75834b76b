//! Motors and actuator dynamics of an experiment, resolved against a model.
//!
//! Invariant: the known dynamics of an input are those stated in `actuators`, else those of its motor's amplifier. Only
//! known dynamics are corrected. The simulated machine has the known dynamics too, unless `plant.actuators` states
//! others.

use crate::error::ExperimentError;
use crate::file::{ActuatorSection, Experiment, MotorsSection};
use crate::names::{coordinates, inputs, positive, require};
use std::collections::BTreeMap;
use tpm_controller::model::Model;
use tpm_motion::{Dynamics, LowPass};
use tpm_plant::actuator::{FileFault, Limited, MotorFile, Mounted};

/// Limits of the inputs, each replaced by the force at the motor's largest current where that force is smaller.
pub(super) fn limited(mut limits: Vec<f64>, motors: &[Option<Mounted>]) -> Vec<f64> {
    for (limit, mounted) in limits.iter_mut().zip(motors) {
        if let Some(Mounted { motor, .. }) = mounted {
            *limit = limit.min(motor.force(motor.limits.current));
        }
    }
    limits
}

fn refused(fault: FileFault) -> ExperimentError {
    ExperimentError::Motors { message: fault.message }
}

impl Experiment {
    /// The path of the motor file, when the experiment names one.
    #[must_use]
    pub fn motor_file(&self) -> Option<&str> {
        match &self.motors {
            Some(MotorsSection::File(path)) => Some(path),
            Some(MotorsSection::Tables(_)) | None => None,
        }
    }

    /// Replaces the path of a motor file by the tables in its text, so that the experiment needs no other file.
    ///
    /// # Errors
    /// [`FileFault`] when the text is no motor file.
    pub fn set_motors(&mut self, text: &str) -> Result<(), FileFault> {
        MotorFile::parse(text)?;
        let mut whole: toml::Table = toml::from_str(text).map_err(|fault| {
            FileFault::at(text, fault.span().map_or(0, |span| span.start), fault.message().to_string())
        })?;
        let motors = match whole.remove("motors") {
            Some(toml::Value::Table(motors)) => motors,
            _ => return Err(FileFault::at(text, 0, "the file lacks `motors`: add a table [motors.INPUT]".to_string())),
        };
        self.motors = Some(MotorsSection::Tables(motors));
        Ok(())
    }

    /// Checks the motors that were read from a text, which is the motor file or the experiment itself, so that a fault
    /// points to its place in that text.
    ///
    /// # Errors
    /// [`FileFault`] when a motor does not fit the model or the experiment.
    pub fn check_motors(&self, model: &dyn Model<f64>, file: &MotorFile) -> Result<(), FileFault> {
        let turned = self.turned(model).unwrap_or_else(|_| vec![Vec::new(); model.dims().inputs]);
        file.motors(model, &turned).map(|_| ())
    }

    /// The coordinates with which the rotor of each input's motor may turn: the stated one, else all that are fed back
    /// to the input.
    fn turned(&self, model: &dyn Model<f64>) -> Result<Vec<Vec<usize>>, ExperimentError> {
        let (coordinates, inputs) = (coordinates(model), inputs(model));
        let mut turned = vec![Vec::new(); inputs.names.len()];
        for (input, coordinate) in &self.motion {
            turned[inputs.index("motion", input)?] = vec![coordinates.index("motion", coordinate)?];
        }
        for path in &self.control.feedback {
            let input = inputs.index("control.feedback", &path.input)?;
            let coordinate = coordinates.index("control.feedback", &path.coordinate)?;
            if !self.motion.contains_key(&path.input) && !turned[input].contains(&coordinate) {
                turned[input].push(coordinate);
            }
        }
        Ok(turned)
    }

    fn motor_tables(&self) -> Result<Option<MotorFile>, ExperimentError> {
        match &self.motors {
            None => Ok(None),
            Some(MotorsSection::File(path)) => Err(ExperimentError::Motors {
                message: format!("the file {path} was not read; put its tables in its place (Experiment::set_motors)"),
            }),
            Some(MotorsSection::Tables(tables)) => {
                let whole = toml::Table::from_iter([("motors".to_string(), toml::Value::Table(tables.clone()))]);
                MotorFile::parse(&whole.to_string()).map(Some).map_err(refused)
            }
        }
    }

    /// The motor of each input with the coordinate that its rotor turns with; empty when there is no motor.
    ///
    /// # Errors
    /// [`ExperimentError::Motors`] when a motor or its coordinate does not fit, [`ExperimentError::UnknownName`] for a
    /// name that the model does not have.
    pub fn mounted(&self, model: &dyn Model<f64>) -> Result<Vec<Option<Mounted>>, ExperimentError> {
        let Some(file) = self.motor_tables()? else { return Ok(Vec::new()) };
        let turned = self.turned(model)?;
        for (i, coordinates) in turned.iter().enumerate() {
            let name = model.input(i).name;
            let carries = matches!(&self.motors, Some(MotorsSection::Tables(tables)) if tables.contains_key(name));
            if carries && coordinates.len() != 1 {
                return Err(ExperimentError::Motors {
                    message: format!(
                        "{} coordinates are fed back to `{name}`; say which one its rotor turns with: motion = {{ {name} = \"COORDINATE\" }}",
                        coordinates.len()
                    ),
                });
            }
        }
        let motors = file.motors(model, &turned).map_err(refused)?;
        let mounted = motors.into_iter().zip(turned).map(|(motor, turned)| {
            let (motor, coordinate) = (motor?, *turned.first()?);
            Some(Mounted { motor, coordinate })
        });
        Ok(mounted.collect())
    }

    /// Known actuator dynamics of each input.
    ///
    /// # Errors
    /// [`ExperimentError::UnknownName`] for a name that the model does not have, [`ExperimentError::Invalid`] for a
    /// value that makes no sense, [`ExperimentError::Motors`] when the motors do not fit.
    pub fn known_actuators(&self, model: &dyn Model<f64>) -> Result<Vec<Dynamics>, ExperimentError> {
        let stated = match self.motor_tables()? {
            Some(file) => file.dynamics(model).map_err(refused)?,
            None => vec![Dynamics::default(); model.dims().inputs],
        };
        overlaid(stated, "actuators", &self.actuators, model)
    }

    /// Known limits of each input's actuator; nothing for an input without any.
    ///
    /// # Errors
    /// [`ExperimentError::UnknownName`] for a name that the model does not have, [`ExperimentError::Motors`] where it is not known
    /// which coordinate the actuator moves.
    pub fn known_limits(&self, model: &dyn Model<f64>) -> Result<Vec<Option<Limited>>, ExperimentError> {
        self.limits_of("actuators", &self.actuators, vec![None; model.dims().inputs], model)
    }

    /// Limits of each actuator of the simulated machine: the known ones where `plant.actuators` does not state the input.
    ///
    /// # Errors
    /// The conditions of [`known_limits`](Self::known_limits).
    pub fn plant_limits(&self, model: &dyn Model<f64>) -> Result<Vec<Option<Limited>>, ExperimentError> {
        self.limits_of("plant.actuators", &self.plant.actuators, self.known_limits(model)?, model)
    }

    fn limits_of(
        &self,
        place: &str,
        sections: &BTreeMap<String, ActuatorSection>,
        mut limits: Vec<Option<Limited>>,
        model: &dyn Model<f64>,
    ) -> Result<Vec<Option<Limited>>, ExperimentError> {
        if sections.is_empty() {
            return Ok(limits);
        }
        let (inputs, turned) = (inputs(model), self.turned(model)?);
        for (name, section) in sections {
            let at = inputs.index(place, name)?;
            let stated = [section.force, section.speed, section.power, section.bandwidth];
            if stated.iter().all(Option::is_none) {
                limits[at] = None;
                continue;
            }
            let moved = turned[at].as_slice();
            let coordinate = match (moved, section.speed.or(section.power)) {
                ([coordinate], _) => *coordinate,
                (_, None) => 0,
                _ => {
                    return Err(ExperimentError::Motors {
                        message: format!(
                            "{} coordinates are fed back to `{name}`; say which one the actuator of {place}.{name} moves, whose speed is limited: motion = {{ {name} = \"COORDINATE\" }}",
                            moved.len()
                        ),
                    });
                }
            };
            let [force, speed, power, bandwidth] = stated.map(|limit| limit.unwrap_or(f64::INFINITY));
            limits[at] = Some(Limited { coordinate, force, speed, power, bandwidth });
        }
        Ok(limits)
    }

    /// Actuator dynamics of each input of the simulated machine.
    ///
    /// # Errors
    /// [`ExperimentError::UnknownName`] for a name that the model does not have, [`ExperimentError::Invalid`] for a
    /// value that makes no sense, [`ExperimentError::Motors`] when the motors do not fit.
    pub fn plant_actuators(&self, model: &dyn Model<f64>) -> Result<Vec<Dynamics>, ExperimentError> {
        overlaid(self.known_actuators(model)?, "plant.actuators", &self.plant.actuators, model)
    }
}

/// The stated dynamics of each input, replaced where the experiment gives others.
fn overlaid(
    mut dynamics: Vec<Dynamics>,
    place: &str,
    sections: &BTreeMap<String, ActuatorSection>,
    model: &dyn Model<f64>,
) -> Result<Vec<Dynamics>, ExperimentError> {
    let inputs = inputs(model);
    for (name, section) in sections {
        let at = inputs.index(place, name)?;
        let key = |field: &str| format!("{place}.{name}.{field}");
        let delay = section.delay;
        require(delay.is_finite() && delay >= 0.0, key("delay"), delay, "the value must not be negative")?;
        let given = [
            ("natural_frequency", section.natural_frequency),
            ("quality", section.quality),
            ("bandwidth", section.bandwidth),
            ("force", section.force),
            ("speed", section.speed),
            ("power", section.power),
        ];
        for (field, value) in given {
            if let Some(value) = value {
                positive(&key(field), value)?;
            }
        }
        if let (None, Some(quality)) = (section.natural_frequency, section.quality) {
            require(false, key("quality"), quality, "it belongs to a low pass; give its natural_frequency too")?;
        }
        dynamics[at] = Dynamics {
            delay,
            filter: section.natural_frequency.map(|natural_frequency| LowPass {
                natural_frequency,
                quality: section.quality.unwrap_or(std::f64::consts::FRAC_1_SQRT_2),
            }),
            bandwidth: section.bandwidth,
        };
    }
    Ok(dynamics)
}
