//! Campaigns that choose their stages by themselves: what such an experiment must state, and an experiment from limits alone.

use crate::error::ExperimentError;
use crate::file::{ControlSection, Experiment, FeedbackSection, Named, PlanSection, ScheduleSection};
use crate::names::{Names, coordinates, inputs, parameters, positive, require};
use std::collections::BTreeMap;
use tpm_campaign::{Plan, Room, Stage, first_stage};
use tpm_controller::model::Model;
use tpm_estimate::Method;
use tpm_motion::HoldCompensation;
use tpm_motion::trajectory::ReferencePattern;

/// Time that one run is measured, as a share of the time of the campaign, and at most, s.
const MEASURED: (f64, f64) = (0.1, 20.0);
/// Most runs of a campaign that its time ends.
const MOST_RUNS: usize = 400;
/// Failed runs in succession after which such a campaign ends: each softens the loop or shortens the way.
const MOST_ABORTS: usize = 8;
/// Samples in the time constant of the filter that forms rates.
const RATE_SAMPLES: f64 = 2.0;
/// Tracking error at which a run is broken off, as a share of half the room of its coordinate.
const TRACKING: f64 = 0.5;
/// Periods before a run is measured, at least.
const SETTLE_PERIODS: usize = 2;

/// A campaign as its limits state it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ByLimits {
    /// Least and largest value by name: a coordinate `x`, its rate `dot(x)`, its acceleration `ddot(x)`, or an input.
    pub limits: BTreeMap<String, (f64, f64)>,
    /// Time between samples, s; needed where no experiment states it.
    pub sample_time: Option<f64>,
    /// Time for which the machine may move, s.
    pub time: f64,
    /// Standard deviation that is wanted of parameters, as a share of their values.
    pub until: Named,
    /// The same for every parameter that is not named.
    pub every: Option<f64>,
}

impl Experiment {
    /// An experiment that states nothing but its sample time: exact sensors, no feedback, no stage.
    #[must_use]
    pub fn bare(sample_time: f64) -> Self {
        Experiment {
            pattern: None,
            estimator: Method::default(),
            weights: Default::default(),
            refine: Default::default(),
            numerical: Default::default(),
            harmonics: None,
            seed: 0,
            motors: None,
            constants: Named::new(),
            prior: Named::new(),
            frozen: Named::new(),
            actuators: BTreeMap::new(),
            motion: BTreeMap::new(),
            plant: Default::default(),
            control: ControlSection {
                sample_time,
                derivative_filter: Some(RATE_SAMPLES * sample_time),
                position_filter: None,
                compensation: HoldCompensation::default(),
                smoothing: None,
                feedback: Vec::new(),
            },
            equations: Default::default(),
            stability: Default::default(),
            limits: Default::default(),
            schedule: ScheduleSection::for_plan(),
            plan: None,
        }
    }

    /// Lets the campaign choose its stages within these limits: they go before those that the experiment states, and the listed stages are
    /// left out. Where the experiment has no feedback, it is made of the limits, too.
    ///
    /// Let a coordinate have the room `Q` to both sides, the speed `V`, and the input that drives it `U`. The gains are `kp = U/Q` and
    /// `kd = U/V`. An inertia m that the drive brings to full speed within that room, `m V^2 <= U Q`, is then damped by half of the
    /// critical damping or more; one that it brings there in a few samples, `m V >= 3 U T`, is still stable in sampled time. Between both
    /// lies a factor of `Q / (3 V T)`, a hundred for .3 m, 1 m/s and 1 kHz: the loop is stable for every inertia that fits its drive.
    ///
    /// # Errors
    /// [`ExperimentError::UnknownName`] and [`ExperimentError::Invalid`] for a limit of nothing, or one that makes no sense.
    pub fn by_limits(
        &mut self,
        model: &dyn Model<f64>,
        pattern: &ReferencePattern,
        asked: &ByLimits,
    ) -> Result<(), ExperimentError> {
        let (coordinates, inputs) = (coordinates(model), inputs(model));
        let signals = |order: &str| {
            let named = |name: &String| if order.is_empty() { name.clone() } else { format!("{order}({name})") };
            coordinates.names.iter().map(named).collect::<Vec<String>>()
        };
        let mut available = signals("");
        available.extend(signals("dot"));
        available.extend(signals("ddot"));
        available.extend(inputs.names.clone());
        let all = Names { kind: "coordinate, rate or input", names: available };
        let count = coordinates.names.len();
        for (name, &(low, high)) in &asked.limits {
            // `dx` and `ddx` are said for `dot(x)` and `ddot(x)` where no signal has such a name.
            let rate = |d: &str, order: &str| {
                let of = name.strip_prefix(d).filter(|of| coordinates.names.iter().any(|known| known == of))?;
                Some(format!("{order}({of})"))
            };
            let known = all.names.contains(name);
            let meant = if known { None } else { rate("dd", "ddot").or_else(|| rate("d", "dot")) };
            let name = &meant.unwrap_or_else(|| name.clone());
            let at = all.index("limits", name)?;
            let key = || format!("limits: {name}");
            require(
                low.is_finite() && high.is_finite() && low < high,
                key(),
                low,
                "the least value must be below the largest",
            )?;
            if at < count {
                self.limits.positions.insert(name.clone(), [low, high]);
                continue;
            }
            let must = "a limit of a rate or an input is one magnitude, for both directions";
            require(low == -high, key(), low, must)?;
            let (place, name) = match at / count {
                1 => (&mut self.limits.velocities, &coordinates.names[at - count]),
                2 => (&mut self.limits.accelerations, &coordinates.names[at - 2 * count]),
                _ => (&mut self.limits.inputs, name),
            };
            place.insert(name.clone(), high);
        }
        if let Some(sample_time) = asked.sample_time {
            self.control.sample_time = sample_time;
        }
        positive("control.sample_time", self.control.sample_time)?;
        positive("plan.time", asked.time)?;
        let mut until = asked.until.clone();
        if let Some(every) = asked.every {
            for name in parameters(model).names.iter().filter(|name| !self.frozen.contains_key(*name)) {
                until.entry(name.clone()).or_insert(every);
            }
        }
        self.schedule = ScheduleSection { multiples: self.schedule.multiples.clone(), ..ScheduleSection::for_plan() };
        self.schedule.measure_time = (MEASURED.0 * asked.time).min(MEASURED.1);
        self.plan = Some(PlanSection { time: asked.time, until });
        self.limits.max_aborts = self.limits.max_aborts.max(MOST_ABORTS);
        self.need_limits(model, pattern)?;
        if self.control.feedback.is_empty() {
            self.feed_back(model, pattern)?;
        }
        for (name, &[low, high]) in &self.limits.positions {
            self.limits.tracking.entry(name.clone()).or_insert(TRACKING * (high - low) / 2.0);
        }
        Ok(())
    }

    /// Feedback of every input, from the limits.
    fn feed_back(&mut self, model: &dyn Model<f64>, pattern: &ReferencePattern) -> Result<(), ExperimentError> {
        let dims = model.dims();
        let constants = self.constant_values(model)?;
        // The middle of the motion, where every coordinate is at rest.
        let middle = pattern.trajectory(&vec![0.0; pattern.amplitudes.len()], 1.0);
        let mut motion = vec![0.0; dims.motion_len()];
        for (slot, series) in motion.iter_mut().zip(&middle.coordinates) {
            *slot = series.mean;
        }
        let mut map = vec![0.0; dims.input_map_len()];
        let mut scratch = vec![0.0; model.inverse_workspace_len().max(model.workspace_len())];
        model.input_map(&motion, &constants, &mut scratch, &mut map)?;
        // What the rows hold against an acceleration of a coordinate, as if every parameter were its prior, or one: the side of the equation
        // on which the inertia stands decides the sign of the gains, with that of the input.
        let theta: Vec<f64> = (0..dims.parameters)
            .map(|j| self.prior.get(model.parameter(j).name).copied().filter(|prior| *prior != 0.0).unwrap_or(1.0))
            .collect();
        let mut inertia = vec![0.0; dims.coordinates];
        let mut force = [vec![0.0; dims.rows], vec![0.0; dims.rows]];
        for (c, inertia) in inertia.iter_mut().enumerate().take(dims.rows) {
            let mut moved = motion.clone();
            moved[model.coordinate_order(c) * dims.coordinates + c] += 1.0;
            for (motion, force) in [&motion, &moved].into_iter().zip(&mut force) {
                model.inverse_dynamics(motion, &theta, &constants, &mut scratch, force)?;
            }
            *inertia = force[1][c] - force[0][c];
        }
        let open = pattern.open();
        let mut used: Vec<usize> = Vec::new();
        for i in 0..dims.inputs {
            // Row r is the equation of coordinate r; an input is fed back from a coordinate that moves as prescribed.
            let acts = |r: usize| map[r * dims.inputs + i];
            let mut rows: Vec<usize> =
                (0..dims.rows.min(dims.coordinates)).filter(|r| !open.contains(r) && !used.contains(r)).collect();
            rows.sort_by(|&a, &b| acts(b).abs().total_cmp(&acts(a).abs()).then(a.cmp(&b)));
            let Some(&c) = rows.first() else { continue };
            used.push(c);
            let (input, coordinate) = (model.input(i).name.to_string(), model.coordinate(c).name.to_string());
            let [low, high] = self.limits.positions[&coordinate];
            let (most, speed) = (self.limits.inputs[&input], self.limits.velocities[&coordinate]);
            let sign = if acts(c) * inertia[c] < 0.0 { -1.0 } else { 1.0 };
            let (kp, kd) = (sign * most / ((high - low) / 2.0), sign * most / speed);
            self.control.feedback.push(FeedbackSection { input, coordinate, kp, kd });
        }
        Ok(())
    }

    /// Requires the limits without which no stage can be chosen.
    fn need_limits(&self, model: &dyn Model<f64>, pattern: &ReferencePattern) -> Result<(), ExperimentError> {
        let open = pattern.open();
        let missing = |name: String, limit: &'static str| ExperimentError::NeedsLimit { name, limit };
        let names = coordinates(model).names.into_iter().enumerate();
        for (_, name) in names.filter(|(c, _)| !open.contains(c)) {
            if !self.limits.positions.contains_key(&name) {
                return Err(missing(name, "positions"));
            }
            if !self.limits.velocities.contains_key(&name) {
                return Err(missing(name, "velocities"));
            }
        }
        match inputs(model).names.into_iter().find(|name| !self.limits.inputs.contains_key(name)) {
            Some(name) => Err(missing(name, "inputs")),
            None => Ok(()),
        }
    }

    /// What a campaign that chooses its stages is to reach.
    pub(super) fn planned(&self, model: &dyn Model<f64>, plan: &PlanSection) -> Result<Plan, ExperimentError> {
        let PlanSection { time, until } = plan;
        positive("plan.time", *time)?;
        if self.estimator != Method::MeasuredMotion {
            return Err(ExperimentError::PlanMethod);
        }
        let names = parameters(model);
        let mut goals = vec![None; names.names.len()];
        for (name, &share) in until {
            positive(&format!("plan.until.{name}"), share)?;
            goals[names.index("plan.until", name)?] = Some(share);
        }
        Ok(Plan { time: *time, goals })
    }

    /// The first stage where none is listed.
    pub(super) fn first(
        &self,
        model: &dyn Model<f64>,
        pattern: &ReferencePattern,
        (blank, room): (&Stage, &Room),
        plan: &PlanSection,
    ) -> Result<Stage, ExperimentError> {
        self.need_limits(model, pattern)?;
        let pace = (self.schedule.settle_periods, plan.time);
        first_stage(pattern, blank, room, self.control.sample_time, pace).ok_or(ExperimentError::NoRoom)
    }
}

impl ScheduleSection {
    /// The schedule of a campaign that chooses its stages.
    fn for_plan() -> Self {
        ScheduleSection {
            multiples: BTreeMap::new(),
            stages: Vec::new(),
            gains: Vec::new(),
            forgetting: 1.0,
            settle_periods: SETTLE_PERIODS,
            measure_time: MEASURED.1,
            updates_per_stage: 1,
            max_runs: MOST_RUNS,
            tolerance: 1e-3,
            avoid_modes: false,
            error: Named::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::ByLimits;
    use crate::Experiment;
    use tpm_controller::harmonics::Hold;
    use tpm_test_support::models::MassSpringDrag;
    use tpm_test_support::rest_to_rest_3;

    #[test]
    fn gains_from_limits_are_stable_for_every_inertia_that_suits_the_drive() {
        let (room, speed, force, sample_time) = (0.3, 1.2, 60.0, 1e-3);
        let limits = [("x", room), ("dot(x)", speed), ("u", force)];
        let limits = limits.map(|(name, size)| (name.to_string(), (-size, size))).into();
        let asked = ByLimits { limits, time: 60.0, ..ByLimits::default() };
        // From three samples to full speed to the whole room; beyond it, a mass that hardly moves is damped less.
        let (least, most) = (3.0 * force * sample_time / speed, force * room / speed.powi(2));
        for n in 0..=20 {
            let mass = least * (most / least).powf(f64::from(n) / 20.0);
            let mut experiment = Experiment::bare(sample_time);
            experiment.by_limits(&MassSpringDrag, &rest_to_rest_3(), &asked).expect("limits");
            experiment.prior.insert("m".into(), mass);
            let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh).expect("a setup");
            let found = experiment.check_stability(&MassSpringDrag, &setup).expect("stable");
            let damped = found.poles.iter().all(|(re, im)| *re < 0.0 && re.abs() >= 0.3 * re.hypot(*im));
            assert!(damped, "{mass} kg: {:?}", found.poles);
        }
    }
}
