//! Resolution of an experiment against a model: names become indices.

use crate::actuators::limited;
use crate::error::ExperimentError;
use crate::file::{ArmSection, DropoutSection, Experiment, OtherMachine, StageSection, StrokeSection};
use crate::names::{Names, coordinates, inputs, near, parameters, positive, require};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use tpm_campaign::{Procedure, Room, Setup, Stage, StageStroke};
use tpm_controller::control::Gain;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_estimate::{Frozen, Method, Settings, Weights};
use tpm_log::unit_of;
use tpm_motion::smoothing::Smoothing;
use tpm_motion::stroke::{Stroke, first_break, substantial_harmonic};
use tpm_motion::trajectory::ReferencePattern;
use tpm_motion::{Loop, Velocity, limits};
use tpm_plant::simulated::{Actuator, ArmGeometry, ClosedLoopArm, Rig, Sensor};
use tpm_plant::stability::{self, LoopStability, Range, StabilityDomain};

/// Number of equally spaced phases of a period at which a reference is compared with the limits of its motion.
const LOOKED_AT: usize = 1024;

/// Names of a model's constants.
fn constant_names(model: &dyn Model<f64>) -> Vec<String> {
    (0..model.dims().constants).map(|i| model.constant(i).name.to_string()).collect()
}

/// One turn in the unit of a coordinate, where that is an angle; a coordinate without a unit may be one, in rad.
fn turn(unit: Option<&str>) -> Option<f64> {
    let (Some(unit), Some(radian)) = (unit, unit_of("rad")) else { return Some(2.0 * PI) };
    Some(2.0 * PI * radian.ratio(&unit_of(unit)?)?)
}

/// Requires that a stage's reference keeps within the limits of position, velocity and acceleration, at [`LOOKED_AT`] phases of its
/// period.
fn within(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    stage: &Stage,
    index: usize,
    positions: &[(f64, f64)],
    rates: [&[f64]; 2],
) -> Result<(), ExperimentError> {
    let reference = stage.trajectory(pattern, 1.0);
    let open = stage.pattern(pattern).open();
    for (c, series) in reference.coordinates.iter().enumerate().filter(|(c, _)| !open.contains(c)) {
        let beyond = (0..LOOKED_AT).find_map(|n| {
            let phase = 2.0 * std::f64::consts::PI * n as f64 / LOOKED_AT as f64;
            let at = |order: usize| series.derivative(phase, reference.frequency, order);
            let (low, high) = positions[c];
            if at(0) < low || at(0) > high {
                return Some(("positions", at(0)));
            }
            let [velocities, accelerations] = rates;
            if at(1).abs() > velocities[c] {
                return Some(("velocities", at(1)));
            }
            (at(2).abs() > accelerations[c]).then(|| ("accelerations", at(2)))
        });
        if let Some((limit, value)) = beyond {
            let name = model.coordinate(c).name.to_string();
            return Err(ExperimentError::BeyondLimit { stage: index, name, value, limit });
        }
    }
    Ok(())
}

/// The pattern that a stage names.
fn pattern_of<'p>(
    pattern: &'p ReferencePattern,
    place: &str,
    name: &str,
) -> Result<&'p ReferencePattern, ExperimentError> {
    pattern.named(name).ok_or_else(|| {
        let all = std::iter::once(pattern).chain(&pattern.others);
        let available: Vec<String> = all.filter_map(|pattern| pattern.name.clone()).collect();
        ExperimentError::UnknownName {
            place: place.to_string(),
            kind: "pattern",
            name: name.to_string(),
            near: near(name, available.iter().map(String::as_str)),
            available,
        }
    })
}

/// The strokes of a stage. Where the stage states a rest but lists no strokes, they are the two halves of the pattern.
fn strokes(
    campaign: &ReferencePattern,
    own: &ReferencePattern,
    stage: &StageSection,
    place: &str,
) -> Result<Vec<StageStroke>, ExperimentError> {
    let rest = |dwell: f64, place: &str| {
        let must = "the rest after a stroke must be zero or longer";
        require(dwell.is_finite() && dwell >= 0.0, format!("{place}.dwell"), dwell, must).map(|()| dwell)
    };
    let all = rest(stage.dwell.unwrap_or(0.0), place)?;
    let mut strokes = Vec::with_capacity(stage.strokes.len());
    for (i, stroke) in stage.strokes.iter().enumerate() {
        let place = format!("{place}.strokes.{i}");
        let StrokeSection { start, end, .. } = *stroke;
        require(start.is_finite(), format!("{place}.start"), start, "the value must be finite")?;
        let must = "a stroke must end behind its start";
        require(end.is_finite() && end > start, format!("{place}.end"), end, must)?;
        let dwell = stroke.dwell.map_or(Ok(all), |dwell| rest(dwell, &place))?;
        let pattern = match &stroke.pattern {
            None => None,
            Some(name) => Some(pattern_of(campaign, &place, name)?),
        };
        let open = |pattern: &ReferencePattern| {
            let coordinates = pattern.open().into_iter().map(|c| format!("the motion of coordinate {}", c + 1));
            let names = pattern.amplitudes.iter().cloned().chain([pattern.frequency.clone()]);
            names.chain(coordinates).collect::<Vec<String>>().join(", ")
        };
        if let Some(other) = pattern.filter(|other| open(other) != open(own)) {
            let pattern = other.name.clone().unwrap_or_default();
            return Err(ExperimentError::StrokePattern { place, pattern, own: open(other), wanted: open(own) });
        }
        let pattern = pattern.map(|pattern| ReferencePattern { others: Vec::new(), ..pattern.clone() });
        strokes.push(StageStroke { pattern, phases: (start * PI, end * PI), dwell });
    }
    if strokes.is_empty() && all > 0.0 {
        let halves = [(0.0, PI), (PI, 2.0 * PI)];
        strokes.extend(halves.map(|phases| StageStroke { pattern: None, phases, dwell: all }));
    }
    Ok(strokes)
}

/// Highest harmonic for estimators that use all harmonics up to a limit: four times the highest harmonic of the motion.
/// For strokes, which have harmonics without end, the highest substantial harmonic takes its place.
fn reach(stages: &[Stage], pattern: &ReferencePattern) -> usize {
    let highest = stages.iter().map(|stage| {
        let reference = stage.trajectory(pattern, 1.0);
        if stage.strokes.is_empty() { reference.highest_harmonic() } else { substantial_harmonic(&reference) }
    });
    4 * highest.max().unwrap_or(0) as usize
}

/// Requires that position, velocity and acceleration are continuous from every stroke to the rest or the stroke that
/// follows.
fn goes_on(model: &dyn Model<f64>, strokes: &[Stroke], place: &str) -> Result<(), ExperimentError> {
    let Some(found) = first_break(strokes) else { return Ok(()) };
    Err(ExperimentError::Broken {
        place: format!("{place}.strokes.{}", found.stroke),
        name: model.coordinate(found.coordinate).name.to_string(),
        what: ["position", "velocity", "acceleration"][found.order],
        order: found.order,
        value: found.values.0,
        next: found.values.1,
        rests: found.rests,
    })
}

fn set_multiples(
    multiples: &mut [u32],
    coordinates: &Names,
    place: &str,
    given: &BTreeMap<String, u32>,
) -> Result<(), ExperimentError> {
    for (name, &multiple) in given {
        let key = || format!("{place}.{name}");
        require(multiple > 0, key(), f64::from(multiple), "the value must be a positive whole number")?;
        multiples[coordinates.index(place, name)?] = multiple;
    }
    Ok(())
}

impl Experiment {
    /// Values of the model's run-time constants.
    ///
    /// # Errors
    /// [`ExperimentError::UnknownName`] for a name that the model does not have, [`ExperimentError::Missing`] for a
    /// constant without a value.
    pub fn constant_values(&self, model: &dyn Model<f64>) -> Result<Vec<f64>, ExperimentError> {
        Names { kind: "constant", names: constant_names(model) }.all("constants", &self.constants)
    }

    /// The simulated machine.
    ///
    /// # Errors
    /// [`ExperimentError`] when a name is unknown, a value is missing or makes no sense, or the machine cannot be
    /// evaluated.
    pub fn bench(&self, model: &dyn Model<f64>) -> Result<Rig, ExperimentError> {
        let coordinates = coordinates(model);
        // Sensors, exact where the experiment states none.
        let mut sensors = vec![Sensor::default(); coordinates.names.len()];
        for (name, section) in &self.plant.sensors {
            let at = coordinates.index("plant.sensors", name)?;
            let key = |field: &str| format!("plant.sensors.{name}.{field}");
            for (field, value) in [
                ("noise", section.noise),
                ("counts", section.counts),
                ("step", section.step),
                ("jitter", section.jitter),
                ("range", section.range),
                ("rate_noise", section.rate_noise.unwrap_or(0.0)),
            ] {
                require(value.is_finite() && value >= 0.0, key(field), value, "the value must not be negative")?;
            }
            let both = section.counts > 0.0 && section.step > 0.0;
            require(!both, key("step"), section.step, "give either counts or step, not both")?;
            let step = if section.counts > 0.0 {
                let turn = turn(model.coordinate(at).unit);
                let must = "counts are those of a turn, and the coordinate is no angle; give the step of a count in its unit (step)";
                require(turn.is_some(), key("counts"), section.counts, must)?;
                turn.unwrap_or(0.0) / section.counts
            } else {
                section.step
            };
            let mut dropout = None;
            if let Some(DropoutSection { run, time }) = section.dropout {
                require(run > 0, key("dropout.run"), run as f64, "runs are counted from 1")?;
                require(time.is_finite() && time >= 0.0, key("dropout.time"), time, "the value must not be negative")?;
                dropout = Some((run - 1, (time / self.control.sample_time) as usize));
            }
            sensors[at] = Sensor {
                noise: section.noise,
                step,
                delay: section.delay,
                jitter: section.jitter,
                range: section.range,
                dropout,
                rate_noise: section.rate_noise,
            };
        }
        // Actuators: limits, quantisation and dynamics.
        let inputs = inputs(model);
        let limits = inputs.fill("limits.inputs", &self.limits.inputs, f64::INFINITY)?;
        let steps = inputs.fill("plant.input_steps", &self.plant.input_steps, 0.0)?;
        let dynamics = self.plant_actuators(model)?;
        let limits = limited(limits, &self.mounted(model)?);
        let of_motion = self.plant_limits(model)?;
        require(
            self.plant.sub_steps > 0,
            "plant.sub_steps".into(),
            self.plant.sub_steps as f64,
            "there must be one at least",
        )?;
        let must = "there must be at most 10,000 steps between two samples";
        let few = self.plant.sub_steps <= limits::MOST_SUB_STEPS;
        require(few, "plant.sub_steps".into(), self.plant.sub_steps as f64, must)?;
        // True parameters and constants. Another machine has its own (`bench_in_run`).
        if self.plant.closed_loop_arm.is_some() {
            for (place, given) in [("parameters", &self.plant.parameters), ("drift", &self.plant.drift)] {
                if let Some(name) = given.keys().next() {
                    return Err(ExperimentError::NotOfMachine { key: format!("plant.{place}.{name}") });
                }
            }
        }
        if let Some(name) = self.plant.constants.keys().next().filter(|_| self.plant.model.is_none()) {
            let message = format!("the constant {name} in plant.constants is of no model: state it in [constants]");
            return Err(ExperimentError::PlantModel { message });
        }
        let (parameters, constants) = if self.plant.closed_loop_arm.is_some() || self.plant.model.is_some() {
            (Vec::new(), Vec::new())
        } else {
            (parameters(model).all("plant.parameters", &self.plant.parameters)?, self.constant_values(model)?)
        };
        Ok(Rig {
            parameters,
            constants,
            sensors,
            actuators: (limits.into_iter().zip(steps).zip(dynamics).zip(of_motion))
                .map(|(((limit, step), dynamics), limited)| Actuator { limit, step, dynamics, limited })
                .collect(),
            sub_steps: self.plant.sub_steps,
            seed: self.seed,
        })
    }

    /// The closed-loop arm that the experiment describes.
    ///
    /// # Errors
    /// [`ExperimentError::Invalid`] for a value that makes no sense.
    pub(super) fn arm(&self) -> Result<Option<ClosedLoopArm>, ExperimentError> {
        let Some(ArmSection { lengths, masses, centroids, inertias, torque_scale }) =
            self.plant.closed_loop_arm.clone()
        else {
            return Ok(None);
        };
        for (field, values) in [("lengths", &lengths[..]), ("masses", &masses), ("inertias", &inertias)] {
            for &value in values {
                positive(&format!("plant.closed_loop_arm.{field}"), value)?;
            }
        }
        positive("plant.closed_loop_arm.torque_scale", torque_scale)?;
        let geometry = ArmGeometry { lengths, masses, centroids, inertias, torque_scale };
        Ok(Some(ClosedLoopArm::new(geometry)))
    }

    /// The simulated machine in run `run` (counted from 0), whose parameters have drifted over the runs before.
    ///
    /// # Errors
    /// [`ExperimentError`] when a name is unknown, a value is missing or makes no sense, or the machine cannot be
    /// evaluated.
    pub fn bench_in_run(&self, model: &dyn Model<f64>, run: usize) -> Result<Rig, ExperimentError> {
        let mut bench = self.bench(model)?;
        let machine = self.plant.machine.as_ref().filter(|_| self.plant.model.is_some());
        if let Some(OtherMachine { model: other, parameters: values }) = machine {
            let names = Names { kind: "constant", names: constant_names(other.as_ref()) };
            let mut constants = self.constants.clone();
            constants.retain(|name, _| names.names.contains(name));
            constants.extend(self.plant.constants.clone());
            bench.constants = names.all("plant.constants", &constants)?;
            bench.parameters = parameters(other.as_ref()).all("plant.parameters", values)?;
        }
        let obeyed = machine.map_or(model, |machine| machine.model.as_ref());
        let drift = parameters(obeyed).fill("plant.drift", &self.plant.drift, 0.0)?;
        for (value, drift) in bench.parameters.iter_mut().zip(&drift) {
            *value *= (1.0 + drift).powi(run as i32);
        }
        Ok(bench)
    }

    /// Checks that the loop is stable with the prior and over the stated box of parameters, linearised at rest at the
    /// mean and at the start of the first stage's reference.
    ///
    /// # Errors
    /// [`ExperimentError::Stability`] where the loop is not stable, [`ExperimentError::UnknownName`] for a name that
    /// the model does not have, [`ExperimentError::Invalid`] for a value that makes no sense.
    pub fn check_stability(&self, model: &dyn Model<f64>, setup: &Setup) -> Result<LoopStability, ExperimentError> {
        let parameters = parameters(model);
        let mut ranges = Vec::with_capacity(self.stability.range.len());
        for (name, &[low, high]) in &self.stability.range {
            let key = || format!("stability.range.{name}");
            require(low.is_finite() && high.is_finite(), key(), low, "both ends must be finite")?;
            require(low <= high, key(), low, "the first value must not be above the second")?;
            ranges.push(Range { parameter: parameters.index("stability.range", name)?, ends: (low, high) });
        }
        let mut nominal = setup.prior.clone();
        for frozen in &setup.estimation.frozen {
            nominal[frozen.parameter] = frozen.value;
        }
        let mut positions = Vec::new();
        if let Some(stage) = setup.procedure.stages.first() {
            let reference = stage.trajectory(&setup.pattern, 1.0);
            positions.push(reference.coordinates.iter().map(|series| series.mean).collect());
            positions.push(reference.coordinates.iter().map(|series| series.derivative(0.0, 1.0, 0)).collect());
        }
        let demand = StabilityDomain {
            nominal,
            constants: setup.constants.clone(),
            positions,
            ranges,
            interior: self.stability.points,
            seed: self.seed,
        };
        // Every factor on the gains is checked; the reported loop is that of the first stage.
        let check = |gain: f64| stability::check(model, &setup.control.scaled(gain), &demand);
        let mut checked = vec![setup.procedure.stages.first().map_or(1.0, |stage| stage.gain)];
        let found = check(checked[0])?;
        for stage in &setup.procedure.stages {
            if !checked.contains(&stage.gain) {
                check(stage.gain)?;
                checked.push(stage.gain);
            }
        }
        Ok(found)
    }

    /// The campaign on a machine whose inputs are held between samples, with the stability of its loop.
    ///
    /// # Errors
    /// The errors of [`setup`](Self::setup) and of [`check_stability`](Self::check_stability).
    pub fn stable_setup(
        &self,
        model: &dyn Model<f64>,
        pattern: &ReferencePattern,
    ) -> Result<(Setup, LoopStability), ExperimentError> {
        let setup = self.setup(model, pattern, Hold::Zoh)?;
        let stability = self.check_stability(model, &setup)?;
        Ok((setup, stability))
    }

    /// The setup of the campaign, for a simulated machine (whose inputs are held between samples) or a real one.
    ///
    /// # Errors
    /// [`ExperimentError`] when a name is unknown, a value is missing or makes no sense, or a reference passes a limit.
    pub fn setup(
        &self,
        model: &dyn Model<f64>,
        pattern: &ReferencePattern,
        hold: Hold,
    ) -> Result<Setup, ExperimentError> {
        let (parameters, coordinates, inputs) = (parameters(model), coordinates(model), inputs(model));
        positive("control.sample_time", self.control.sample_time)?;
        // The feedback: how rates are formed, filters and gains.
        let velocity = match (self.control.derivative_filter, self.control.smoothing) {
            (None, None) => Velocity::Measured,
            (None, Some(smoothing)) => {
                let place = |name: &str| format!("control.smoothing.{name}");
                let Smoothing { samples, degree } = smoothing;
                let must = "the degree must lie between 1 and 5";
                require(smoothing.has_degree(), place("degree"), degree as f64, must)?;
                let must = "there must be more samples than the degree, and at most 100";
                require(smoothing.has_samples(), place("samples"), samples as f64, must)?;
                Velocity::Fitted(smoothing)
            }
            (Some(time_constant), both) => {
                let must = "a derivative filter and smoothing exclude each other; leave one out";
                require(both.is_none(), "control.derivative_filter".into(), time_constant, must)?;
                let usable = time_constant.is_finite() && time_constant >= 0.0;
                require(usable, "control.derivative_filter".into(), time_constant, "the value must not be negative")?;
                Velocity::Filtered(time_constant)
            }
        };
        let position_filter = self.control.position_filter.unwrap_or(0.0);
        let usable = position_filter.is_finite() && position_filter >= 0.0;
        require(usable, "control.position_filter".into(), position_filter, "the value must not be negative")?;
        let mut gains = Vec::with_capacity(self.control.feedback.len());
        for (i, path) in self.control.feedback.iter().enumerate() {
            let place = format!("control.feedback.{i}");
            for (field, value) in [("kp", path.kp), ("kd", path.kd)] {
                require(value.is_finite(), format!("{place}.{field}"), value, "the value must be finite")?;
            }
            gains.push(Gain {
                input: inputs.index(&place, &path.input)?,
                coordinate: coordinates.index(&place, &path.coordinate)?,
                proportional: path.kp,
                derivative: path.kd,
            });
        }
        // Scalar settings of limits and schedule.
        let share = self.limits.effort_share;
        require(share > 0.0 && share <= 1.0, "limits.effort_share".into(), share, "the value must lie in (0, 1]")?;
        let back_off = self.limits.back_off;
        require(back_off > 0.0 && back_off < 1.0, "limits.back_off".into(), back_off, "the value must lie in (0, 1)")?;
        let schedule = &self.schedule;
        let measured = schedule.measure_time;
        let key = || "schedule.measure_time".to_string();
        require(measured.is_finite(), key(), measured, "the value must be finite")?;
        require(measured >= 0.0, key(), measured, "the value must not be negative")?;
        let (points, most) = (self.stability.points, limits::MOST_POINTS);
        require(points <= most, "stability.points".into(), points as f64, "there must be at most 100,000 points")?;
        // The stages, with their amplitudes, frequencies and strokes.
        let mut multiples = vec![1; coordinates.names.len()];
        set_multiples(&mut multiples, &coordinates, "schedule.multiples", &schedule.multiples)?;
        let mut stages = Vec::with_capacity(schedule.stages.len());
        for (i, stage) in schedule.stages.iter().enumerate() {
            let place = format!("schedule.stages.{i}");
            let own = match &stage.pattern {
                None => None,
                Some(name) => Some(pattern_of(pattern, &place, name)?),
            };
            let played = own.unwrap_or(pattern);
            let mut names = played.amplitudes.clone();
            names.push(played.frequency.clone());
            let mut amplitudes = Names { kind: "amplitude or frequency", names }.all(&place, &stage.values)?;
            let frequency = amplitudes.pop().unwrap_or(f64::NAN);
            positive(&format!("{place}.{}", played.frequency), frequency)?;
            let (settling, sample_time) = (schedule.settle_periods, self.control.sample_time);
            if !limits::has_few_samples(settling, 0.0, frequency, sample_time) {
                let must = "with this frequency and sample time a run must have at most ten million samples; settle for fewer periods";
                require(false, "schedule.settle_periods".into(), settling as f64, must)?;
            }
            let few = limits::has_few_samples(settling, measured, frequency, sample_time);
            let must = "with this frequency and sample time a run must have at most ten million samples; measure for a shorter time in more runs";
            require(few, key(), measured, must)?;
            let mut multiples = multiples.clone();
            set_multiples(&mut multiples, &coordinates, &format!("{place}.multiples"), &stage.multiples)?;
            let own = own.map(|own| ReferencePattern { others: Vec::new(), ..own.clone() });
            let gain = schedule.gains.get(i).copied().unwrap_or(1.0);
            positive(&format!("schedule.gains.{i}"), gain)?;
            let strokes = strokes(pattern, played, stage, &place)?;
            let stage = Stage { pattern: own, amplitudes, frequency, multiples, gain, strokes };
            // An aborted run is repeated with smaller amplitudes, at which the strokes must be continuous as well.
            for scale in [1.0, back_off] {
                goes_on(model, &stage.played_strokes(pattern, scale), &place)?;
            }
            stages.push(stage);
        }
        let (given, needed) = (schedule.gains.len(), stages.len());
        require(given <= needed, "schedule.gains".into(), given as f64, "there must be no more factors than stages")?;
        let forgetting = schedule.forgetting;
        let usable = forgetting > 0.0 && forgetting <= 1.0;
        require(usable, "schedule.forgetting".into(), forgetting, "the value must lie in (0, 1]")?;
        if self.weights == Weights::Equal && self.estimator != Method::MeasuredMotion {
            return Err(ExperimentError::Weights);
        }
        // The estimator's settings.
        let mut frozen = Vec::with_capacity(self.frozen.len());
        for (name, &value) in &self.frozen {
            frozen.push(Frozen { parameter: parameters.index("frozen", name)?, value });
        }
        let prior = parameters.fill("prior", &self.prior, 0.0)?;
        // Every reference must keep within the bounds of the motion.
        let mut position_bounds = vec![(f64::NEG_INFINITY, f64::INFINITY); coordinates.names.len()];
        for (name, &[low, high]) in &self.limits.positions {
            let key = || format!("limits.positions.{name}");
            require(low < high, key(), low, "the first value must be below the second")?;
            position_bounds[coordinates.index("limits.positions", name)?] = (low, high);
        }
        let velocity_bounds = coordinates.fill("limits.velocities", &self.limits.velocities, f64::INFINITY)?;
        let acceleration_bounds =
            coordinates.fill("limits.accelerations", &self.limits.accelerations, f64::INFINITY)?;
        for (i, stage) in stages.iter().enumerate() {
            within(model, pattern, stage, i, &position_bounds, [&velocity_bounds, &acceleration_bounds])?;
        }
        let plan = match &self.plan {
            None => None,
            Some(plan) => {
                let room = Room {
                    positions: position_bounds.clone(),
                    velocities: velocity_bounds.clone(),
                    accelerations: acceleration_bounds.clone(),
                    effort: 1.0,
                };
                if stages.is_empty() {
                    let blank = Stage {
                        pattern: None,
                        amplitudes: vec![],
                        frequency: 1.0,
                        multiples,
                        gain: 1.0,
                        strokes: vec![],
                    };
                    stages.push(self.first(model, pattern, (&blank, &room), plan)?);
                }
                Some(self.planned(model, plan)?)
            }
        };
        let of_strokes =
            stages.iter().any(|stage| !stage.strokes.is_empty()) && self.estimator != Method::MeasuredMotion;
        let harmonics = of_strokes.then(|| reach(&stages, pattern));
        let motors = self.mounted(model)?;
        let input_limits = inputs.fill("limits.inputs", &self.limits.inputs, f64::INFINITY)?;
        Ok(Setup {
            pattern: pattern.clone(),
            constants: self.constant_values(model)?,
            control: Loop {
                sample_time: self.control.sample_time,
                gains,
                velocity,
                position_filter,
                compensation: self.control.compensation,
                actuators: self.known_actuators(model)?,
            },
            procedure: Procedure {
                stages,
                settle_periods: schedule.settle_periods,
                measure_time: measured,
                updates_per_stage: schedule.updates_per_stage.max(1),
                max_runs: schedule.max_runs.max(1),
                tolerance: schedule.tolerance,
                error_limits: coordinates.fill("schedule.error", &schedule.error, 0.0)?,
                tracking_bounds: coordinates.fill("limits.tracking", &self.limits.tracking, f64::INFINITY)?,
                position_bounds,
                velocity_bounds,
                acceleration_bounds,
                input_limits: limited(input_limits, &motors),
                motors,
                limited: self.known_limits(model)?,
                effort_share: share,
                back_off,
                max_aborts: self.limits.max_aborts,
                hold,
                avoid_modes: schedule.avoid_modes,
                plan,
            },
            method: self.estimator,
            estimation: Settings {
                harmonics: self.harmonics.or(harmonics),
                weights: self.weights,
                prior: prior.clone(),
                frozen,
                numerical: self.numerical,
                forgetting,
                ..Settings::default()
            },
            prior,
            stated: parameters.names.iter().map(|name| self.prior.contains_key(name)).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::turn;
    use std::f64::consts::PI;

    #[test]
    fn a_turn_is_in_the_unit_of_its_angle() {
        assert_eq!((turn(None), turn(Some("rad")), turn(Some("m"))), (Some(2.0 * PI), Some(2.0 * PI), None));
        assert!((turn(Some("deg")).expect("an angle") - 360.0).abs() < 1e-12);
    }
}
