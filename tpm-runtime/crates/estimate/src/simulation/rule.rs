//! Which explanation of a record is handed out: the one with the lowest cost, where a richer one must gain more than chance would.

use crate::likelihood::{Lacking, Term, TermKind};
use crate::output_error::{Differentiable, Half, OutputErrorFault, RateFault, RateUse, compared};
use crate::simulation::begin::{Begun, begin};
use crate::simulation::fit::{Fit, Fixed, How, Reached, State};
use crate::simulation::noise::FirstOrder;
use crate::simulation::problem::{Point, Problem};
use crate::simulation::record::{Reading, Record};
use crate::simulation::terms::{Library, behind_play};
use crate::simulation::triangle::Triangle;
use crate::verdict::LARGE_RESIDUAL;
use tpm_numerics::{DMatrix, alarm, root_mean_square};

/// What terms, play or a limit must gain, twice the logarithm of the likelihood: a factor of twenty in evidence.
const GAIN: f64 = 6.0;
/// Shares of a candidate's length that others must leave of it: a column that others nearly span is not told from them while much else is
/// unknown, and is where that has been found.
pub(super) const GUARD: f64 = 0.1;
const CLOSE_GUARD: f64 = 0.01;
/// Share of the force of a row, and samples, that forces of the first order are taken for at first.
const FIRST_DRIFT: (f64, f64) = (0.1, 20.0);
/// Limits of an input that are tried at first, as shares of its largest size.
const LIMITS: [f64; 22] = [
    0.97, 0.93, 0.88, 0.83, 0.78, 0.72, 0.66, 0.6, 0.54, 0.48, 0.42, 0.36, 0.3, 0.24, 0.18, 0.13, 0.09, 0.06, 0.04,
    0.025, 0.016, 0.01,
];
/// Least half width of play, in deviations of a reading.
const LEAST_PLAY: f64 = 3.0;
/// Share of a coordinate's spread that play is taken for at first.
const FIRST_PLAY: f64 = 4e-3;
/// Share of the force of a row that the noise of its force is taken for at first, where play is.
const FIRST_PLAY_FORCE: f64 = 1e-3;
/// Share of the force of a row that noise of the forces makes, above which a reading may be behind play.
const UNEXPLAINED: f64 = 0.01;
/// Most readings times terms of which the forces that a model lacks are asked: some ten seconds.
const MOST_COLUMNS: usize = 800_000;
/// Instants at which rows are taken for a regression.
const REGRESSED: usize = 4000;

/// A way to explain a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Variant {
    /// The model with white noise of its forces.
    Model,
    /// The model with forces that go on.
    Drift,
    /// Terms that the model lacks.
    Terms,
    /// The same, with terms that others nearly span.
    CloseTerms,
    /// A reading behind play.
    Play {
        /// The coordinate.
        coordinate: usize,
    },
    /// An input that is limited.
    Limit {
        /// The input.
        input: usize,
    },
}

/// What a likelihood comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Outcome {
    /// The model explains every reading, with what a channel does beside what is recorded of it.
    Explained,
    /// Forces that the model lacks explain a part: terms, a little that goes on, or noise.
    Forces,
    /// Forces that go on remain, or much of the motion, which nothing explains.
    Lacks,
}

/// A way to explain a record, and how much less likely it is than the one that is handed out.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Explained {
    /// The way.
    pub variant: Variant,
    /// Twice the logarithm of the ratio of the likelihoods.
    pub above: f64,
}

/// Parameters that explain every reading of a record.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Simulation {
    /// Value of every parameter, in the model's units.
    pub values: Vec<f64>,
    /// Covariance of all parameters; zero for those that are held.
    pub covariance: DMatrix<f64>,
    /// The way that is handed out.
    pub variant: Variant,
    /// All ways that were tried.
    pub tried: Vec<Explained>,
    /// Gauss-Newton passes of the way that is handed out.
    pub passes: usize,
    /// Terms that the model lacks, the clearest first.
    pub lacking: Vec<Lacking>,
    /// Whether it needs forces that the model lacks: terms, or noise of the forces.
    pub needs_forces: bool,
    /// How much later every input acts than it is recorded, s.
    pub delays: Vec<f64>,
    /// What every measured rate is to the fit.
    pub rates: Vec<RateUse>,
    /// How far every free parameter moves from the first half of the readings to the second; empty where a half does not show them.
    pub halves: Vec<Half>,
    /// Twice the negative logarithm of the likelihood, but for a constant that all fits of the same readings share.
    pub cost: f64,
    /// Standard deviation of every sensor's noise as it was found, unit of what it reads.
    pub sensor_noise: Vec<f64>,
    /// Root mean square of what is measured less the simulated motion, by sensor.
    pub residual: Vec<f64>,
    /// The force that noise is taken to make in every row, root mean square as a share of the row's force.
    pub force_left: Vec<f64>,
    /// Whether every coordinate is of first order, as a temperature or a level: what goes on there beside the model is a disturbance, such as
    /// drafts, which a loop answers; a machine that has terms of its own has them in its forces.
    pub of_first_order: bool,
    /// What is not explained, as a share: the largest of those residuals beside the motion, and of these forces.
    pub share: f64,
}

/// What is asked where the model alone does not explain a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Nothing.
    Nothing,
    /// What a channel does beside what is recorded of it: an input that acts later or is limited, a reading behind play.
    Channels,
    /// What a channel does, and forces that the model lacks. Hundreds of forces along a long record take minutes: there only channels are asked.
    All,
}

/// What a fit is asked.
#[derive(Clone, Debug)]
pub struct Question<'a> {
    /// The model.
    pub machine: Differentiable<'a>,
    /// Its constants.
    pub constants: &'a [f64],
    /// Values of all parameters from which it begins.
    pub start: &'a [f64],
    /// Parameters that are estimated.
    pub free: &'a [usize],
    /// Directions of these that the data do not show.
    pub hidden: &'a [Vec<f64>],
    /// Time in which the motion goes to and fro once, on the average, s.
    pub typical_period: f64,
    /// What is asked beside the model.
    pub asked: Asked,
}

impl Simulation {
    /// What the likelihood comes to.
    #[must_use]
    pub fn outcome(&self) -> Outcome {
        let large = self.force_left.iter().any(|left| *left > UNEXPLAINED);
        match self.variant {
            _ if self.share > LARGE_RESIDUAL => Outcome::Lacks,
            Variant::Drift if large && !self.of_first_order => Outcome::Lacks,
            _ if self.needs_forces => Outcome::Forces,
            _ => Outcome::Explained,
        }
    }

    /// Fits the free parameters of a model to a record.
    ///
    /// # Errors
    /// [`OutputErrorFault`].
    pub fn fit(question: &Question<'_>, record: &Record) -> Result<Self, OutputErrorFault> {
        let is_rate = |sensor: &&Reading| sensor.derivative > 0;
        let offered: Vec<Reading> = record.sensors.iter().filter(is_rate).cloned().collect();
        let positions = record.sensors.iter().filter(|sensor| !is_rate(sensor)).cloned().collect::<Vec<_>>();
        if offered.is_empty() || positions.is_empty() {
            return Self::of_readings(question, record, Vec::new());
        }
        let without = Record { sensors: positions, ..record.clone() };
        let trial = Trial::new(question, &without)?;
        let fit = trial.fit(question.hidden);
        let found = fit.settle(trial.begun(&fit), How::plain(GUARD))?;
        let rates = judged(&trial.problem, &found.state.point.states, &offered);
        let mut with = without.clone();
        for (mut sensor, found) in offered.into_iter().zip(&rates) {
            if let (Some(noise), None) = (found.noise, found.fault) {
                sensor.variance.fill(noise * noise);
                with.sensors.push(sensor);
            }
        }
        Self::of_readings(&Question { start: &found.state.point.theta, ..question.clone() }, &with, rates)
    }

    /// Fits them to readings that are all used.
    fn of_readings(question: &Question<'_>, record: &Record, rates: Vec<RateUse>) -> Result<Self, OutputErrorFault> {
        let mut trial = Trial::new(question, record)?;
        let columns = record.readings() * trial.library.terms.len();
        if question.asked != Asked::All || columns > MOST_COLUMNS {
            trial.library.terms.retain(|term| !term.kind.is_force());
        }
        let trial = trial;
        let fit = trial.fit(question.hidden);
        let mut reached: Vec<(Variant, Reached)> = Vec::new();
        let settled = |theta: Vec<f64>| {
            let mut begun = trial.begun(&fit);
            begun.point.theta = theta;
            fit.settle(begun, How::plain(GUARD))
        };
        let needs = |own: &Reached| trial.needs_forces(&fit, Variant::Model, own);
        let mut model = settled(question.start.to_vec());
        let mut needed = model.as_ref().map_or(true, |own| !own.settled || needs(own));
        // Where forces are needed the given start may have been far from the truth, as the regression of the rows along the readings may be: the
        // lower optimum counts.
        if needed && let Some(theta) = trial.regressed() {
            let other = settled(theta);
            if is_lower(&other, &model) {
                model = other;
                needed = model.as_ref().map_or(true, needs);
            }
        }
        let drift = model.as_ref().ok().and_then(|own| fit.settle(trial.drifting(own), How::plain(GUARD)).ok());
        // A model that needs no forces beside its own explains the record: there is nothing more to ask.
        let likelier = |own: &Reached| drift.as_ref().is_some_and(|drift| drift.cost < own.cost - GAIN);
        let alone = model.as_ref().is_ok_and(|own| own.settled && !likelier(own) && !needed);
        reached.extend(drift.map(|own| (Variant::Drift, own)));
        if question.asked != Asked::Nothing && !alone {
            trial.richer(question, &fit, model.as_ref().ok(), &mut reached);
        }
        let fault = match model {
            Ok(own) => {
                reached.push((Variant::Model, own));
                None
            }
            Err(fault) => Some(fault),
        };
        reached.retain(|(_, own)| own.settled && own.cost.is_finite());
        let Some(best) = chosen(&reached) else {
            return Err(
                fault.unwrap_or(OutputErrorFault::NotConverged { steps: crate::simulation::fit::PARAMS.passes })
            );
        };
        let needs_forces = match &reached[best] {
            (Variant::Model, _) => needed,
            (variant, own) => trial.needs_forces(&fit, *variant, own),
        };
        trial.handed_out(&fit, &reached, best).map(|found| Simulation { rates, needs_forces, ..found })
    }
}

/// What every measured rate of a record is, beside the motion that was found without them, whose states are given.
fn judged(problem: &Problem<'_>, states: &[f64], offered: &[Reading]) -> Vec<RateUse> {
    let switches = problem.machine.derivatives.switches();
    // While a friction's force is free the velocity is that of noisy positions.
    let free = |k: usize| problem.loose[k * switches..(k + 1) * switches].iter().any(|size| *size > 0.0);
    let instants = problem.instants.len();
    let apart: Vec<bool> = (0..instants.saturating_sub(1)).map(|k| !problem.instants.goes_on(k) || free(k)).collect();
    let of = |rate: &Reading| {
        let place = problem.states.iter().position(|&of| of == (rate.coordinate, 1));
        // A rate with stamps of its own is not compared sample by sample.
        let alike = rate.channel.time == problem.instants.time;
        let found = place.filter(|_| alike).and_then(|s| {
            let velocity: Vec<f64> = states.iter().skip(s).step_by(problem.states.len()).copied().collect();
            compared(&rate.channel.value, &velocity, &apart, problem.instants.usual_step)
        });
        match found {
            Some((noise, fault)) => RateUse { coordinate: rate.coordinate, noise: Some(noise), fault },
            None => RateUse { coordinate: rate.coordinate, noise: None, fault: Some(RateFault::NotCompared) },
        }
    };
    offered.iter().map(of).collect()
}

/// Whether one of two optima is lower than the other by more than two searches of the same one differ; a settled one is, beside one that is not.
fn is_lower(one: &Result<Reached, OutputErrorFault>, other: &Result<Reached, OutputErrorFault>) -> bool {
    match (one, other) {
        (Ok(one), Ok(other)) if one.settled == other.settled => one.cost < other.cost - GAIN,
        (Ok(one), Ok(_)) => one.settled,
        (one, _) => one.is_ok(),
    }
}

/// The lowest of all, where the model alone, and then the model with forces that go on, come first unless another gains more than chance
/// would.
fn chosen(reached: &[(Variant, Reached)]) -> Option<usize> {
    let best = (0..reached.len()).min_by(|&a, &b| reached[a].1.cost.total_cmp(&reached[b].1.cost))?;
    let near = |variant: Variant| {
        reached.iter().position(|(own, it)| *own == variant && it.cost < reached[best].1.cost + GAIN)
    };
    Some(near(Variant::Model).or_else(|| near(Variant::Drift)).unwrap_or(best))
}

/// A record with a model along it, ready to be fitted.
pub(super) struct Trial<'a> {
    pub(super) problem: Problem<'a>,
    library: Library,
    point: Point,
    /// The highest derivative of every coordinate along the first motion.
    highest: Vec<Vec<f64>>,
}

impl<'a> Trial<'a> {
    pub(super) fn new(question: &Question<'a>, record: &'a Record) -> Result<Self, OutputErrorFault> {
        let Question { machine, constants, free, typical_period, .. } = question;
        let mut problem = Problem::new(*machine, constants, record, free.to_vec(), *typical_period)?;
        if problem.instants.len() < 2 {
            return Err(OutputErrorFault::Singular);
        }
        let Begun { states, rate_deviation, highest } = begin(&problem);
        let inputs = record.inputs.len();
        let point = Point {
            states,
            theta: question.start.to_vec(),
            delays: vec![0.0; inputs],
            limits: vec![f64::INFINITY; inputs],
        };
        problem.loose = problem.found_loose(&point)?;
        problem.longest_step = problem.needed_step(&point)?;
        let library = Library::of(&problem, &point, rate_deviation)?;
        Ok(Trial { problem, library, point, highest })
    }

    pub(super) fn fit<'t>(&'t self, hidden: &'t [Vec<f64>]) -> Fit<'t> {
        Fit { problem: &self.problem, library: &self.library, hidden }
    }

    pub(super) fn begun(&self, fit: &Fit<'_>) -> State {
        State { point: self.point.clone(), noise: fit.first_noise(), fixed: Vec::new(), active: Vec::new() }
    }

    /// The optima with terms, play and limits.
    fn richer(
        &self,
        question: &Question<'_>,
        fit: &Fit<'_>,
        model: Option<&Reached>,
        reached: &mut Vec<(Variant, Reached)>,
    ) {
        // With noise of the forces the motion follows the readings whatever the model lacks, so that terms are looked for from there.
        let begun = model.map_or_else(|| self.begun(fit), |model| model.state.clone());
        let mut asked: Vec<Term> = Vec::new();
        if let Ok(terms) = fit.settle(begun, How::with_terms(GUARD)) {
            asked.extend(terms.state.active.iter().map(|own| own.term));
            if !terms.state.active.is_empty() {
                let close = fit.settle(terms.state.clone(), How::with_terms(CLOSE_GUARD));
                reached.extend(close.ok().map(|close| (Variant::CloseTerms, close)));
            }
            reached.push((Variant::Terms, terms));
        }
        // Play on a reading is no force, so that terms hide it: where forces are left that nothing explains, it is asked for.
        let left = reached.iter().map(|(_, own)| own).chain(model).min_by(|a, b| a.cost.total_cmp(&b.cost));
        let unexplained = left
            .and_then(|own| own.force_left(fit).ok())
            .is_some_and(|left| left.iter().any(|left| *left > UNEXPLAINED));
        let library = &self.library.terms;
        let play =
            library.iter().filter(|term| term.kind == TermKind::Backlash && (unexplained || asked.contains(term)));
        for term in play {
            let found = self.behind_play(question, term.of);
            reached.extend(found.ok().map(|found| (Variant::Play { coordinate: term.of }, found)));
        }
        let limits =
            library.iter().filter(|term| term.kind == TermKind::Limit && (unexplained || asked.contains(term)));
        for term in limits {
            let found = model.and_then(|model| self.limited(fit, model, *term).ok());
            reached.extend(found.map(|found| (Variant::Limit { input: term.of }, found)));
        }
    }

    /// Whether an optimum needs forces that the model lacks: without any it is clearly less likely. A little noise of the forces is enough to
    /// hide a term that the parameters nearly make up for.
    fn needs_forces(&self, fit: &Fit<'_>, variant: Variant, own: &Reached) -> bool {
        let mut state = own.state.clone();
        match variant {
            Variant::Drift => return true,
            // What is left of the readings tells no forces.
            Variant::Play { .. } => return false,
            _ if !state.active.is_empty() => return true,
            _ => state.noise.force.fill(0.0),
        }
        let exact = fit.settle(state, How { forces: false, ..How::plain(GUARD) });
        !exact.is_ok_and(|exact| exact.settled && exact.cost < own.cost + alarm::LIKELIHOOD_GAIN)
    }

    /// Values of the free parameters by least squares of the rows along the first motion; nothing where that does not show them.
    fn regressed(&self) -> Option<Vec<f64>> {
        let problem = &self.problem;
        let model = problem.machine.model;
        let dims = model.dims();
        let free = &problem.free;
        let instants = problem.instants.len();
        let along = problem.along(&self.point).ok()?;
        let stride = instants.div_ceil(REGRESSED).max(1);
        let mut triangle = Triangle::new(free.len() + 1);
        let (mut phi, mut scratch) = (vec![0.0; dims.regressor_len()], vec![0.0; model.workspace_len()]);
        for row in 0..dims.rows {
            let right = along.right(row);
            let size = root_mean_square(right.iter().copied());
            let scale = 1.0 / if size > 0.0 { size } else { self.library.forces[row].max(f64::MIN_POSITIVE) };
            for k in (0..instants).step_by(stride) {
                let mut motion = vec![0.0; dims.motion_len()];
                for (s, &(c, d)) in problem.states.iter().enumerate() {
                    motion[d * dims.coordinates + c] = self.point.states[k * problem.states.len() + s];
                }
                for c in 0..dims.coordinates {
                    motion[model.coordinate_order(c) * dims.coordinates + c] = self.highest[c][k];
                }
                model.sensitivity(&motion, &self.point.theta, problem.constants, &mut scratch, &mut phi).ok()?;
                let own = |j: usize| phi[row * dims.parameters + j];
                let held = (0..dims.parameters).filter(|j| !free.contains(j)).map(|j| own(j) * self.point.theta[j]);
                let target = right[k] - held.sum::<f64>();
                let entries: Vec<f64> = free.iter().map(|&j| scale * own(j)).chain([scale * target]).collect();
                triangle.take(&entries);
            }
        }
        let square = triangle.square();
        let p = free.len();
        let mut values = square.view((0, p), (p, 1)).column(0).into_owned();
        let solved = square.view((0, 0), (p, p)).into_owned().solve_upper_triangular_mut(&mut values);
        if !solved || values.iter().any(|value| !value.is_finite()) {
            return None;
        }
        let mut theta = self.point.theta.clone();
        free.iter().zip(values.iter()).for_each(|(&j, value)| theta[j] = *value);
        Some(theta)
    }

    /// A state of the model alone, with forces that go on.
    fn drifting(&self, model: &Reached) -> State {
        let mut state = model.state.clone();
        let variance = self.library.forces.iter().map(|force| (FIRST_DRIFT.0 * force).powi(2)).collect();
        state.noise.drift = Some(FirstOrder { variance, time: FIRST_DRIFT.1 * self.problem.instants.usual_step });
        state
    }

    /// The optimum with an input that is limited.
    fn limited(&self, fit: &Fit<'_>, model: &Reached, term: Term) -> Result<Reached, OutputErrorFault> {
        let largest = self.problem.record.inputs[term.of].value.iter().fold(0.0, |most: f64, u| most.max(u.abs()));
        let with = |size: f64| {
            let mut state = model.state.clone();
            state.point.limits[term.of] = size;
            state.fixed.push(Fixed { term, value: size, directions: Vec::new() });
            state
        };
        let mut tried: Vec<(f64, State)> = Vec::new();
        for share in LIMITS {
            let state = with(share * largest);
            tried.push((fit.cost_at(&state)?, state));
        }
        let best = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let (_, state) = best.ok_or(OutputErrorFault::Singular)?;
        fit.settle(state, How::plain(GUARD))
    }

    /// The optimum with a reading behind play: readings that stand after a reversal only say that the truth is within its width, and are left
    /// out at the price of that.
    fn behind_play(&self, question: &Question<'_>, coordinate: usize) -> Result<Reached, OutputErrorFault> {
        let sensor = self.problem.sensor(coordinate).ok_or(OutputErrorFault::NotSimulable)?;
        let own = &self.problem.record.sensors[sensor];
        let count = own.variance.len().max(1) as f64;
        let stated = (own.variance.iter().sum::<f64>() / count).sqrt();
        let (directions, stands) = behind_play(&own.channel.value, stated);
        let mut record = self.problem.record.clone();
        let kept: Vec<usize> = (0..stands.len()).filter(|&k| !stands[k]).collect();
        // A coordinate that mostly stands still says little of what happens while it moves.
        if kept.is_empty() || 2 * kept.len() < stands.len() {
            return Err(OutputErrorFault::Singular);
        }
        let sensor_record = &mut record.sensors[sensor];
        let pick = |values: &[f64]| kept.iter().map(|&k| values[k]).collect::<Vec<f64>>();
        sensor_record.channel.time = pick(&own.channel.time);
        sensor_record.channel.value = pick(&own.channel.value);
        sensor_record.variance = pick(&own.variance);
        let dropped = stands.len() - kept.len();
        let mut trial = Trial::new(question, &record)?;
        // What the others came to is far off where play is, so that this begins with the regression of the rows.
        trial.point.theta = trial.regressed().unwrap_or(trial.point.theta);
        let fit = trial.fit(question.hidden);
        let at = |time: &f64| own.channel.time.partition_point(|stamp| stamp < time).min(directions.len() - 1);
        let of_instants: Vec<f64> = trial.problem.instants.time.iter().map(|time| directions[at(time)]).collect();
        let mut state = trial.begun(&fit);
        for (s, sensor) in record.sensors.iter().enumerate() {
            let count = sensor.variance.len().max(1) as f64;
            let stated = sensor.variance.iter().sum::<f64>() / count;
            let mean = sensor.channel.value.iter().sum::<f64>() / count;
            let spread = root_mean_square(sensor.channel.value.iter().map(|x| x - mean));
            state.noise.white[s] = ((FIRST_PLAY * spread).powi(2) / stated.max(f64::MIN_POSITIVE)).max(1.0);
        }
        for (density, force) in state.noise.force.iter_mut().zip(&trial.library.forces) {
            *density = (FIRST_PLAY_FORCE * force).powi(2) * trial.problem.instants.usual_step;
        }
        let term = Term { kind: TermKind::Backlash, row: None, of: coordinate, other: None };
        state.fixed.push(Fixed { term, value: 0.0, directions: of_instants });
        // Noise of the forces would pass for play that is not yet right.
        let near = fit.settle(state, How { forces: false, ..How::plain(GUARD) })?;
        let mut reached = fit.settle(near.state, How::plain(GUARD))?;
        let value = reached.state.fixed.first().map_or(0.0, |own| own.value.abs()).max(LEAST_PLAY * stated);
        reached.cost += dropped as f64 * (2.0 * (2.0 * value).ln() - (2.0 * std::f64::consts::PI).ln());
        Ok(reached)
    }

    fn handed_out(
        &self,
        fit: &Fit<'_>,
        reached: &[(Variant, Reached)],
        best: usize,
    ) -> Result<Simulation, OutputErrorFault> {
        let (variant, own) = &reached[best];
        let model = self.problem.machine.model;
        let free = &self.problem.free;
        let parameters = own.state.point.theta.len();
        let mut covariance = DMatrix::zeros(parameters, parameters);
        for (a, &i) in free.iter().enumerate() {
            for (b, &j) in free.iter().enumerate() {
                covariance[(i, j)] = own.covariance[(a, b)];
            }
        }
        // Other optima that explain the record about as well say how uncertain the structure leaves the values.
        let weight = |other: &Reached| (0.5 * (own.cost - other.cost)).min(0.0).exp();
        let total: f64 = reached.iter().map(|(_, other)| weight(other)).sum();
        for (_, other) in reached {
            let share = weight(other) / total;
            let moved = |j: usize| other.state.point.theta[j] - own.state.point.theta[j];
            for &i in free {
                for &j in free {
                    covariance[(i, j)] += share * moved(i) * moved(j);
                }
            }
        }
        let readings = self.problem.record.readings() as f64;
        let lacking = own.named(fit).into_iter().map(|(term, value, std, shown)| Lacking {
            term,
            value,
            std,
            gain: shown.min(f64::MAX) / (shown.min(f64::MAX) + readings),
        });
        let states = self.problem.states.len();
        let left = |sensor: usize| {
            let own = self.problem.instants.readings.iter().enumerate().flat_map(|(k, all)| {
                let at = k * states + self.problem.sensors[sensor];
                let state = own.state.point.states.get(at).copied();
                all.iter().filter(move |at| at.sensor == sensor).filter_map(move |at| Some(at.value - state?))
            });
            root_mean_square(own)
        };
        let sensors = &self.problem.record.sensors;
        let in_play = matches!(variant, Variant::Play { .. });
        let residual: Vec<f64> = (0..sensors.len()).map(|s| if in_play { 0.0 } else { left(s) }).collect();
        let force_left = if in_play { vec![0.0; self.library.forces.len()] } else { own.force_left(fit)? };
        let spread = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            root_mean_square(values.iter().map(|x| x - mean))
        };
        let by_motion = residual.iter().zip(sensors).map(|(left, sensor)| left / spread(&sensor.channel.value));
        let share = by_motion.chain(force_left.iter().copied()).filter(|share| share.is_finite()).fold(0.0, f64::max);
        let stated = |s: usize| sensors[s].variance.iter().sum::<f64>() / sensors[s].variance.len().max(1) as f64;
        Ok(Simulation {
            values: own.state.point.theta.clone(),
            covariance,
            variant: *variant,
            of_first_order: (0..model.dims().coordinates).all(|c| model.coordinate_order(c) == 1),
            tried: reached
                .iter()
                .map(|(variant, other)| Explained { variant: *variant, above: other.cost - own.cost })
                .collect(),
            passes: own.passes,
            lacking: lacking.collect(),
            needs_forces: true,
            delays: own.state.point.delays.clone(),
            rates: Vec::new(),
            halves: if in_play { Vec::new() } else { fit.halves(own)? },
            cost: own.cost,
            sensor_noise: (0..sensors.len()).map(|s| (own.state.noise.white[s] * stated(s)).sqrt()).collect(),
            residual,
            force_left,
            share,
        })
    }
}
