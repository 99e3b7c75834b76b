//! Motors and actuator dynamics of an experiment, resolved against a model.
//!
//! Invariant: the known dynamics are those in `actuators`, else those that a motor's amplifier states, and only they
//! are corrected. The simulated machine has the known dynamics too, unless `plant.actuators` states others.

use crate::experiment::error::ExperimentError;
use crate::experiment::file::{ActuatorSection, Experiment, MotorsSection};
use crate::experiment::names::{coordinates, inputs, positive, require};
use crate::machine::actuator::{FileFault, Limited, MotorFile, Mounted};
use crate::run::Dynamics;
use crate::run::LowPass;
use std::collections::BTreeMap;
use std::format;
use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;
use tpm_core::model::Model;

/// Limits of the inputs, each lowered to the force of the motor's largest current where that is less.
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

    /// The coordinates that the rotor of each input's motor could turn with: the stated one, else all that are fed back
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

#[cfg(test)]
mod tests {
    use crate::campaign::{Campaign, Outcome};
    use crate::experiment::Experiment;
    use crate::experiment::ExperimentError;
    use crate::log::{Log, LogOptions};
    use crate::machine::simulated::simulate;
    use crate::run::Dynamics;
    use crate::run::LowPass;
    use crate::run::trajectory::tests::rest_to_rest_3;
    use crate::session::identify_log;
    use crate::session::{Identification, identify_simulated};
    use crate::test_models::MassSpringDrag;
    use std::string::ToString;
    use tpm_core::harmonics::Hold;

    const FILE: &str = include_str!("../../../models/mass_spring_drag.toml");
    const MOTOR: &str =
        "[motors.u]\ntorque_constant = 0.115\nresistance = 4\ninductance = 7.7e-3\npinion_radius = 0.02\n";
    const TRUTH: [f64; 3] = [2.0, 40.0, 1.5];

    /// The shipped experiment without noise.
    fn experiment(sets: &[(&str, &str)]) -> Experiment {
        let mut experiment = Experiment::parse(FILE).expect("the shipped file is right");
        for (key, value) in [("plant.sensors.x.noise", "0"), ("counts", "0")].iter().chain(sets) {
            experiment.apply_override(key, value).expect("known");
        }
        experiment
    }

    fn identified(experiment: &Experiment) -> Identification {
        identify_simulated(&MassSpringDrag, &rest_to_rest_3(), experiment, &mut |_| true).expect("runs")
    }

    fn worst(values: impl Iterator<Item = f64>) -> f64 {
        values.zip(TRUTH).map(|(value, truth)| (value / truth - 1.0).abs()).fold(0.0, f64::max)
    }

    const AMPLIFIER: &str = "{ delay = 0.0035, natural_frequency = 250.0, quality = 0.8 }";

    #[test]
    fn known_dynamics_are_corrected_and_unknown_ones_are_seen() {
        for (method, sharp) in [("measured-motion", 1e-6), ("error", 1e-4), ("hill", 1e-4), ("effort", 1e-4)] {
            let run = |sets: &[(&str, &str)]| {
                let all = [&[("estimator", method), ("updates_per_stage", "8"), ("max_runs", "40")], sets].concat();
                let found = identified(&experiment(&all));
                worst(found.current.iter().copied())
            };
            let ideal = run(&[]);
            let known = run(&[("actuators.u", AMPLIFIER)]);
            let unknown = run(&[("plant.actuators.u", AMPLIFIER)]);
            std::eprintln!("{method}: ideal {ideal:.2e}, corrected {known:.2e}, not corrected {unknown:.2e}");
            assert!(ideal < sharp && known < sharp, "{method}: {ideal:e} {known:e}");
            assert!(unknown > 1e-3, "{method}: {unknown:e}");
        }
    }

    #[test]
    fn a_log_takes_the_same_correction() {
        let experiment = experiment(&[("actuators.u", AMPLIFIER)]);
        let model = &MassSpringDrag;
        let setup = experiment.setup(model, &rest_to_rest_3(), Hold::Zoh).expect("fits");
        let bench = experiment.bench(model).expect("fits");
        let campaign = Campaign::new(model, setup).expect("playable");
        let trial = campaign.next().expect("first");
        let record = simulate(model, &bench, trial).expect("regular");
        let channels = [record.coordinates, record.inputs].concat();
        let log = Log::from_samples("memory", record.sample_time, channels).expect("long enough");
        let error = |actuators: &[Dynamics], hold: Hold| {
            let options = LogOptions { hold, actuators: actuators.to_vec(), ..LogOptions::default() };
            let found = identify_log(model, &log, &options).expect("periodic");
            (worst(found.current.iter().copied()), found.residual, found.log.map_or(0, |log| log.actuators.len()))
        };
        let filter = Some(LowPass { natural_frequency: 250.0, quality: 0.8 });
        let known = Dynamics { delay: 0.0035, filter, bandwidth: None };
        let (corrected, left, reported) = error(&[known], Hold::Zoh);
        assert!(corrected < 1e-5 && left < 1e-5 && reported == 1, "{corrected:e} {left:e}");
        let (plain, residual, reported) = error(&[], Hold::Zoh);
        assert!(plain > 1e-3 && residual > 1e-2 && reported == 0, "{plain:e} {residual:e}");
        // A hold acts nearly like half a sample more of delay.
        let (instead, ..) = error(&[Dynamics { delay: 0.004, ..known }], Hold::None);
        assert!(instead > corrected && instead < 1e-3, "{instead:e}");
        std::eprintln!("log: corrected {corrected:.2e}, not corrected {plain:.2e}, hold as a delay {instead:.2e}");
    }

    #[test]
    fn limits_of_a_motor_end_a_campaign_by_name() {
        for (limit, name, unit) in
            [("current = 8", "current", "A"), ("voltage = 40", "voltage", "V"), ("power = 200", "power", "W")]
        {
            let mut experiment = experiment(&[]);
            experiment.set_motors(&std::format!("{MOTOR}[motors.u.limits]\n{limit}\n")).expect("a motor file");
            let found = identified(&experiment);
            assert_eq!(found.outcome, Some(Outcome::EffortShare), "{:?}", found.warnings);
            let stop = found.stop.clone().expect("named");
            assert_eq!((stop.limit, stop.unit.as_deref(), stop.input.as_str()), (name, Some(unit), "u"));
            assert!(stop.share >= 0.7 && (limit.starts_with("power") || stop.harmonic.is_some()), "{stop}");
            assert!(found.is_complete() && found.runs.len() < 8);
            let text = stop.to_string();
            assert!(text.contains("sample") && text.contains(unit), "{text}");
            // Only the last stage is played, so that the run itself passes the limit.
            experiment.schedule.stages.drain(..3);
            let passed = identified(&experiment);
            let stop = passed.stop.clone().expect("named");
            assert!(stop.limit == name && stop.share >= 0.7, "{stop}");
            std::eprintln!("{limit}: {text}; at once: {:?} {stop}", passed.outcome);
        }
    }

    #[test]
    fn limits_of_any_actuator_end_a_campaign_by_name() {
        for (limit, name) in
            [("{ force = 60.0 }", "force"), ("{ speed = 1.5 }", "speed"), ("{ power = 60.0 }", "power")]
        {
            let mut experiment = experiment(&[("actuators.u", limit)]);
            let found = identified(&experiment);
            assert_eq!(found.outcome, Some(Outcome::EffortShare), "{limit} {:?}", found.warnings);
            let stop = found.stop.clone().expect("named");
            assert_eq!((stop.limit, stop.input.as_str()), (name, "u"));
            assert!(stop.share >= 0.7 && stop.to_string().contains("lower the"), "{stop}");
            assert!(found.is_complete() && found.runs.len() < 8);
            // Only the last stage is played: the reference that is too fast is refused, and the run itself passes the other limits.
            experiment.schedule.stages.drain(..3);
            let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh).expect("fits");
            match Campaign::new(&MassSpringDrag, setup) {
                Err(refused) => {
                    let text = refused.to_string();
                    assert!(text.contains(&std::format!("the {name} of u")) && text.contains("lower the"), "{text}");
                }
                Ok(_) => {
                    let stop = identified(&experiment).stop.expect("named");
                    assert!(stop.limit == name && stop.share >= 0.7, "{stop}");
                }
            }
        }
    }

    #[test]
    fn the_simulated_actuator_keeps_its_power() {
        let weak = experiment(&[("plant.actuators.u", "{ power = 60.0 }")]);
        let found = identified(&weak);
        assert_eq!(found.outcome, Some(Outcome::InputLimit), "{:?}", found.warnings);
        let strong = experiment(&[("plant.actuators.u", "{ power = 4e4, force = 1e4, speed = 1e3 }")]);
        assert!(identified(&strong).is_complete());
    }

    #[test]
    fn faults_name_their_place() {
        let fault = |sets: &[(&str, &str)]| {
            let experiment = experiment(sets);
            let found = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh);
            found
                .map(|_| ())
                .and_then(|()| experiment.bench(&MassSpringDrag).map(|_| ()))
                .expect_err("a fault")
                .to_string()
        };
        assert!(fault(&[("actuators.v", "{ delay = 1e-3 }")]).contains("actuators: the model has no input `v`"));
        assert!(fault(&[("actuators.u", "{ delay = -1e-3 }")]).starts_with("actuators.u.delay = -0.001"));
        assert!(fault(&[("plant.actuators.u", "{ quality = 2.0 }")]).contains("natural_frequency"));
        assert!(fault(&[("plant.actuators.u", "{ bandwidth = 0.0 }")]).starts_with("plant.actuators.u.bandwidth"));
        assert!(fault(&[("actuators.u", "{ power = -3.0 }")]).starts_with("actuators.u.power = -3"));
        assert!(fault(&[("motors", "none.toml")]).contains("none.toml was not read"));
        assert!(fault(&[("motors", "{ u = { resistance = 4.0 } }")]).contains("[motors.u] lacks `torque_constant`"));
        assert!(fault(&[("motion", "{ u = \"y\" }"), ("motors", "{ u = {} }")]).contains("no coordinate `y`"));
        let mut ambiguous = experiment(&[]);
        ambiguous.set_motors(MOTOR).expect("a motor file");
        ambiguous.control.feedback.clear();
        let found = ambiguous.mounted(&MassSpringDrag).expect_err("nothing is fed back");
        assert!(
            matches!(found, ExperimentError::Motors { .. }) && found.to_string().contains("motion = { u"),
            "{found}"
        );
        ambiguous.motion.insert("u".into(), "x".into());
        assert_eq!(ambiguous.mounted(&MassSpringDrag).expect("stated").len(), 1);
        let missing = Experiment::parse("seed = 1\n").expect_err("no control").to_string();
        assert!(missing.contains("add [control] with sample_time"), "{missing}");
    }
}
