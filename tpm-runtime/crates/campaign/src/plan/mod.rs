//! The choice of the next stage from limits: what a campaign plays whose schedule nobody wrote.
//!
//! Let `M` be the information about the parameters that the runs so far have given, and `D(s)` what a run of the stage `s` would add
//! ([`run_information`]), for the noise that was read between the harmonics. Played is the stage whose gain
//!
//! ```text
//! (log det(M + D(s)) - log det M) / duration(s)
//! ```
//!
//! is largest among those that keep the limits; where deviations of some parameters are asked for, the sum of the logarithms by which
//! these are missed takes the place of the determinant.
//!
//! Among stages that are hardly worse the one is played that differs most from those before it, so that what the model lacks can show itself.
//!
//! A stage keeps the limits when its reference does, with room for the tracking error that was seen; when its feed-forward, three
//! deviations of it (from the covariance of the estimates) and what the feedback added in the run before stay below the permitted share of
//! every input's limit; and when it reaches at most [`GROWTH`] times as far and as fast as what was played before without a fault. So the
//! first runs are slow and small, whatever the estimates are worth, and a stage that contains one that failed is not tried.

mod advice;
mod known;
mod room;

pub use advice::Advice;
pub(crate) use room::{Extent, Seen, extent, larger};
pub use room::{Room, first_stage};

use crate::information::{run_information, strayed};
use crate::modes::near_mode;
use crate::setup::{LEAST_PERIODS, Plan, Setup, Stage};
use known::{Known, covariance};
use num_integer::gcd;
use room::{FURTHER, GROWTH, USED, fastest, largest, narrowed, prescribed};
use tpm_controller::control::Differentiator;
use tpm_controller::model::Model;
use tpm_estimate::Estimate;
use tpm_motion::trajectory::ReferencePattern;
use tpm_motion::{Trial, Velocity, demand};
use tpm_numerics::DMatrix;
use tpm_plant::simulated::{Actuator, Rig, Sensor};
use tpm_plant::stability::{StabilityDomain, check};

/// Standard deviations of the predicted input that must still lie below the permitted share of its limit: once in 740 runs it does not.
const INPUT_DEVIATIONS: f64 = 3.0;
/// Shares of the largest amplitudes from which candidates are formed.
const SHARES: [f64; 6] = [1.0, 0.7, 0.5, 0.35, 0.2, 0.1];
/// Ratio of neighbouring frequencies of candidates, and their number.
const SPEEDS: (f64, usize) = (0.7, 10);
/// Multiples of the frequency that are tried for every coordinate where two or three move.
const MULTIPLES: [u32; 3] = [1, 2, 3];
/// With other multiples only every so many shares and frequencies are tried.
const COARSE: usize = 2;
/// Share of the largest gain from which a stage counts as as good, so that the one that was played least is taken.
const AS_GOOD: f64 = 0.8;
/// Longest run, beside the time that a run is measured.
const LONGEST: f64 = 2.0;
/// Samples of a period at which the deviation of the predicted input is computed.
const LOOKED_AT: usize = 64;
/// Smallest part by which the time that is left must shrink a wanted deviation.
const WORTH: f64 = 0.1;
/// Factor between neighbouring gains that are tried, and their number, until the loop is stable with the estimates and quiet.
const GAINS: (f64, i32) = (0.7, 20);
/// Share of an input's limit that the feedback of the sensors' noise may use.
const QUIET: f64 = 0.15;
/// Standard deviations of that noise that count as its largest: once in 16,000 samples it is larger.
const NOISE_PEAK: f64 = 4.0;

/// What is chosen.
pub(crate) enum Choice {
    /// The stage to play.
    Play(Box<Stage>),
    /// Every parameter is known as well as is wanted.
    Reached,
    /// No run within the limits fits into the time that is left.
    NoTime,
    /// The time that is left would show nothing that is wanted.
    NothingMore,
}

/// A stage that keeps the limits.
struct Candidate {
    stage: Stage,
    extent: Vec<Extent>,
    /// Time that its run takes, s.
    duration: f64,
    /// Whether a harmonic lies near a natural mode (Feng, 3.2.1), whose vibration would be measured.
    near_mode: bool,
    /// Square root of the information that it would give, by free parameters.
    root: DMatrix<f64>,
}

/// What all candidates of one choice share.
struct Shared<'a> {
    room: &'a Room,
    /// Positions that references may use.
    positions: Vec<(f64, f64)>,
    /// Whether runs only grow from what was played.
    gated: bool,
    /// How far the machine goes from its reference ([`strayed`]).
    stray: Vec<f64>,
    /// Parameters one deviation away from the estimates, direction by direction of their covariance.
    aside: Vec<Vec<f64>>,
    /// What the feedback adds to every input, at most.
    added: Vec<f64>,
}

/// A campaign between two runs.
pub(crate) struct Scene<'a> {
    pub(crate) model: &'a dyn Model<f64>,
    pub(crate) setup: &'a Setup,
    pub(crate) plan: &'a Plan,
    pub(crate) estimate: &'a Estimate,
    /// The estimates as they are played.
    pub(crate) theta: &'a [f64],
    pub(crate) seen: &'a Seen,
    /// The stage that was played last.
    pub(crate) last: &'a Stage,
    /// The trial of a stage.
    pub(crate) trial: &'a dyn Fn(&Stage) -> Option<Trial>,
    /// The largest share of any limit of motors, actuators and inputs that a trial is planned to use.
    pub(crate) share: &'a dyn Fn(&Trial) -> f64,
}

impl Scene<'_> {
    /// The stage to play next.
    pub(crate) fn choose(&self) -> Choice {
        let free = self.free();
        if self.unmet().is_some_and(|unmet| unmet.is_empty()) {
            return Choice::Reached;
        }
        let left = self.plan.time - self.seen.time;
        let coordinates = self.model.dims().coordinates;
        let mut candidates = self.candidates(&Room::of(self.setup, coordinates), true);
        if candidates.is_empty() {
            return Choice::NothingMore;
        }
        candidates.retain(|candidate| candidate.duration <= left);
        if candidates.iter().any(|candidate| !candidate.near_mode) {
            candidates.retain(|candidate| !candidate.near_mode);
        }
        let known = Known::by_estimate(self.estimate, &free, candidates.iter().map(|one| &one.root));
        let gains: Vec<f64> = candidates.iter().map(|one| self.worth(&known, one) / one.duration).collect();
        let most = gains.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let good = (0..gains.len()).filter(|&i| gains[i] >= AS_GOOD * most);
        let other = |i: usize| self.newness(&candidates[i].stage);
        let Some(best) = good.max_by(|&a, &b| other(a).total_cmp(&other(b))) else { return Choice::NoTime };
        let chosen = candidates.swap_remove(best);
        let may_grow = !self.seen.is_near(&chosen.extent, FURTHER);
        if !may_grow && self.has_nothing_left(&known, &chosen, left) {
            return Choice::NothingMore;
        }
        Choice::Play(Box::new(chosen.stage))
    }

    /// How far a stage is from those that were played: what the model lacks shows itself where motions differ.
    fn newness(&self, stage: &Stage) -> f64 {
        let apart = |a: f64, b: f64| if a * b > 0.0 { (a / b).ln().abs() } else { f64::from(u8::from(a != b)) };
        let from = |old: &Stage| {
            let sizes = old.amplitudes.iter().zip(&stage.amplitudes).map(|(&a, &b)| apart(a, b)).fold(0.0, f64::max);
            sizes + apart(old.frequency, stage.frequency) + f64::from(u8::from(old.multiples != stage.multiples))
        };
        self.setup.procedure.stages.iter().map(from).fold(f64::INFINITY, f64::min)
    }

    /// Parameters that are estimated.
    fn free(&self) -> Vec<usize> {
        let held: Vec<usize> = self.setup.estimation.frozen.iter().map(|frozen| frozen.parameter).collect();
        (0..self.theta.len()).filter(|j| !held.contains(j)).collect()
    }

    /// Standard deviation of a parameter as a share of its value.
    fn relative(&self, j: usize) -> f64 {
        let (value, std) = (self.estimate.values[j].abs(), self.estimate.std[j]);
        if std == 0.0 { 0.0 } else { std / value }
    }

    /// The factor by which the deviation of a parameter misses what is wanted of it.
    fn missed(&self, j: usize) -> f64 {
        self.plan.goals.get(j).copied().flatten().map_or(0.0, |goal| self.relative(j) / goal)
    }

    /// Parameters that are known less well than is wanted; nothing where nothing is wanted.
    fn unmet(&self) -> Option<Vec<usize>> {
        let wanted: Vec<usize> =
            (0..self.theta.len()).filter(|&j| self.plan.goals.get(j).is_some_and(Option::is_some)).collect();
        if wanted.is_empty() {
            return None;
        }
        // A number that is not finite is no knowledge.
        Some(wanted.into_iter().filter(|&j| self.missed(j) > 1.0 || !self.missed(j).is_finite()).collect())
    }

    /// The stages that keep the limits, and were not found to fail; `gated` where they grow from what was played.
    fn candidates(&self, room: &Room, gated: bool) -> Vec<Candidate> {
        let pattern = &self.setup.pattern;
        let plain = Stage { strokes: Vec::new(), gain: self.gain(), ..self.last.clone() };
        let noise = |i: usize| plain.gain * noise_fed_back(self.setup, &self.seen.noise, i);
        let shared = Shared {
            room,
            positions: narrowed(&room.positions, &self.seen.tracking),
            gated,
            stray: self.stray(),
            aside: self.aside(),
            added: self.seen.added.iter().enumerate().map(|(i, added)| added + noise(i)).collect(),
        };
        let mut found = self.of_multiples(&plain, &shared, 1);
        for multiples in varied(pattern, &plain) {
            if multiples != plain.multiples {
                let stage = Stage { multiples, ..plain.clone() };
                found.extend(self.of_multiples(&stage, &shared, COARSE));
            }
        }
        found
    }

    /// Amplitudes and frequencies of candidates with the multiples of a stage, every `step`-th of both.
    fn of_multiples(&self, stage: &Stage, shared: &Shared<'_>, step: usize) -> Vec<Candidate> {
        let room = shared.room;
        let pattern = &self.setup.pattern;
        let sample_time = self.setup.control.sample_time;
        let mut found = Vec::new();
        let whole = Stage { frequency: 1.0, ..stage.clone() };
        let Some(most) = largest(pattern, &whole, &shared.positions) else { return found };
        for share in SHARES.into_iter().step_by(step) {
            let amplitudes: Vec<f64> = most.iter().map(|size| share * size).collect();
            let sized = Stage { amplitudes, ..whole.clone() };
            let mut top = fastest(pattern, &sized, sample_time);
            for (c, extent) in prescribed(pattern, &sized).iter().enumerate() {
                let Some(extent) = extent.filter(|extent| extent.velocity > 0.0) else { continue };
                let mut speed = USED * room.velocities[c];
                let mut bend = USED * room.accelerations[c];
                if let Some(reached) = self.seen.reached.get(c).filter(|_| shared.gated) {
                    speed = speed.min(GROWTH * reached.velocity);
                    bend = bend.min(GROWTH * GROWTH * reached.acceleration);
                }
                top = top.min(speed / extent.velocity).min((bend / extent.acceleration).sqrt());
            }
            for n in (0..SPEEDS.1).step_by(step) {
                let stage = Stage { frequency: top * SPEEDS.0.powi(n as i32), ..sized.clone() };
                found.extend(self.candidate(stage, shared));
            }
        }
        found
    }

    /// A stage with what it would show, where it keeps the limits.
    fn candidate(&self, stage: Stage, shared: &Shared<'_>) -> Option<Candidate> {
        let room = shared.room;
        let period = 2.0 * std::f64::consts::PI / stage.frequency;
        let least = (self.setup.procedure.settle_periods + LEAST_PERIODS) as f64 * period;
        if least > LONGEST * self.setup.procedure.measure_time {
            return None;
        }
        let trial = (self.trial)(&stage)?;
        let dims = self.model.dims();
        let extent = extent(&trial, dims.coordinates);
        let keeps = extent.iter().enumerate().all(|(c, own)| {
            let (low, high) = room.positions[c];
            low < own.low
                && own.high < high
                && own.velocity < room.velocities[c]
                && own.acceleration < room.accelerations[c]
        });
        if !keeps || shared.gated && (!self.seen.is_near(&extent, 1.0) || self.seen.has_failed(&extent)) {
            return None;
        }
        if (self.share)(&trial) + self.spread(&trial, shared) >= self.setup.procedure.effort_share * room.effort {
            return None;
        }
        let root = self.root(&trial, &shared.stray)?;
        let duration = trial.samples() as f64 * trial.control.sample_time;
        let near_mode = near_mode(self.model, &trial).is_some();
        Some(Candidate { stage, extent, duration, near_mode, root })
    }

    /// Square root of the information that a trial gives, by free parameters.
    fn root(&self, trial: &Trial, stray: &[f64]) -> Option<DMatrix<f64>> {
        let settled = self.setup.procedure.settle_periods;
        let measured = trial.periods.saturating_sub(settled).max(LEAST_PERIODS);
        let reach = 4 * trial.trajectory.highest_harmonic() as usize;
        let size = (trial.samples_per_period, measured);
        let root = run_information(self.model, &self.rig(), &trial.trajectory, size, stray, reach).ok()??;
        let root = root.dense().select_columns(&self.free());
        root.iter().all(|value| value.is_finite()).then_some(root)
    }

    /// Whether the samples of runs of these stages could show what is wanted, though the estimates of their harmonics do not.
    pub(crate) fn may_be_enough(&self, stages: &[&Stage]) -> bool {
        let Some(unmet) = self.unmet().filter(|unmet| !unmet.is_empty()) else { return false };
        let free = self.free();
        let stray = self.stray();
        let roots = stages.iter().filter_map(|stage| self.root(&(self.trial)(stage)?, &stray));
        let known = Known::by_runs(free.len(), roots);
        unmet.into_iter().all(|j| {
            let Some(at) = free.iter().position(|&own| own == j) else { return true };
            let wanted = self.plan.goals[j].unwrap_or(f64::INFINITY) * self.estimate.values[j].abs();
            known.deviation(at) <= wanted
        })
    }

    /// The machine as the estimates have it, with the noise that was seen.
    fn rig(&self) -> Rig {
        Rig {
            parameters: self.theta.to_vec(),
            constants: self.setup.constants.clone(),
            sensors: self.seen.noise.iter().map(|&noise| Sensor { noise, ..Sensor::default() }).collect(),
            actuators: vec![Actuator::default(); self.model.dims().inputs],
            sub_steps: 1,
            seed: 0,
        }
    }

    /// How far the feedback of noise takes the machine from its reference: that of the last stage stands for all.
    fn stray(&self) -> Vec<f64> {
        let settled = self.setup.procedure.settle_periods;
        let of = |trial: Trial| {
            let short = Trial { periods: settled + 1, ..trial };
            strayed(self.model, &self.rig(), &short, &short.trajectory, settled).ok()
        };
        (self.trial)(self.last).and_then(of).unwrap_or_else(|| vec![0.0; self.model.dims().motion_len()])
    }

    /// Parameters one standard deviation away from the estimates, direction by direction of their covariance.
    fn aside(&self) -> Vec<Vec<f64>> {
        let free = self.free();
        let eigen = covariance(self.estimate, &free).symmetric_eigen();
        let directions = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
        let moved = directions.filter(|(value, _)| **value > 0.0).map(|(value, direction)| {
            let mut theta = self.theta.to_vec();
            for (&j, part) in free.iter().zip(direction.iter()) {
                theta[j] += value.sqrt() * part;
            }
            theta
        });
        moved.collect()
    }

    /// Share of its limit by which an input may be larger than its feed-forward: by the deviations of the estimates, and by what the
    /// feedback adds.
    fn spread(&self, trial: &Trial, shared: &Shared<'_>) -> f64 {
        let dims = self.model.dims();
        let step = (trial.samples_per_period / LOOKED_AT).max(1);
        let motions: Vec<f64> =
            trial.reference.chunks_exact(dims.motion_len()).step_by(step).flatten().copied().collect();
        let of = |theta: &[f64]| demand(self.model, &motions, theta, &trial.constants).ok();
        let Some(own) = of(self.theta) else { return f64::INFINITY };
        let mut variance = vec![0.0; own.len()];
        for moved in shared.aside.iter().filter_map(|theta| of(theta)) {
            for (sum, (now, before)) in variance.iter_mut().zip(moved.iter().zip(&own)) {
                *sum += (now - before).powi(2);
            }
        }
        let shares = variance.iter().enumerate().map(|(at, variance)| {
            let i = at % dims.inputs.max(1);
            let limit = trial.input_limits.get(i).copied().unwrap_or(f64::INFINITY);
            (INPUT_DEVIATIONS * variance.sqrt() + shared.added.get(i).copied().unwrap_or(0.0)) / limit
        });
        shares.fold(0.0, f64::max)
    }

    /// What a run of a candidate is worth: how much nearer wanted deviations come, or else how much the determinant grows.
    fn worth(&self, known: &Known, candidate: &Candidate) -> f64 {
        let Some(unmet) = self.unmet() else { return known.gain(&candidate.root) };
        let free = self.free();
        let nearer = |j: &usize| {
            let Some(at) = free.iter().position(|own| own == j) else { return 0.0 };
            let goal = self.plan.goals[*j].unwrap_or(1.0) * self.estimate.values[*j].abs();
            let missed = |std: f64| (std / goal.max(f64::MIN_POSITIVE)).ln().max(0.0);
            missed(known.deviation(at)) - missed(known.deviation_with(at, &candidate.root, 1.0))
        };
        unmet.iter().map(nearer).sum()
    }

    /// Whether all the time that is left, spent on a stage, would not make a wanted deviation noticeably smaller.
    fn has_nothing_left(&self, known: &Known, stage: &Candidate, left: f64) -> bool {
        let free = self.free();
        let Some(unmet) = self.unmet() else { return false };
        unmet.iter().filter_map(|j| free.iter().position(|own| own == j)).all(|at| {
            known.deviation_with(at, &stage.root, left / stage.duration) > (1.0 - WORTH) * known.deviation(at)
        })
    }

    /// The largest factor on the gains with which the loop is stable at the estimates, as far as these say, and quiet.
    fn gain(&self) -> f64 {
        let limits = &self.setup.procedure.input_limits;
        let loud = |(i, limit): (usize, &f64)| noise_fed_back(self.setup, &self.seen.noise, i) / limit;
        let loudest = limits.iter().enumerate().map(loud).fold(0.0, f64::max);
        let middle = self.last.trajectory(&self.setup.pattern, 1.0);
        let domain = StabilityDomain {
            nominal: self.theta.to_vec(),
            constants: self.setup.constants.clone(),
            positions: vec![middle.coordinates.iter().map(|series| series.mean).collect()],
            ..StabilityDomain::default()
        };
        let may = |gain: &f64| {
            gain * loudest <= QUIET && check(self.model, &self.setup.control.scaled(*gain), &domain).is_ok()
        };
        (0..GAINS.1).map(|n| GAINS.0.powi(n)).find(may).unwrap_or(self.last.gain)
    }
}

/// The largest input that the feedback makes of the noise of the sensors, with the gains of the setup.
///
/// A rate is the difference quotient of readings behind the low pass `(1 - a)/(1 - a z^-1)`, `a = e^(-T/tau)`. Of white noise with the
/// deviation s it has the deviation `s (1 - a)/T sqrt(2/(1 + a))`. Where a polynomial is fitted, it is the length of the slope's weights.
pub(crate) fn noise_fed_back(setup: &Setup, noise: &[f64], input: usize) -> f64 {
    let control = &setup.control;
    let per_sample = 1.0 / control.sample_time;
    let of_rate = match control.velocity {
        Velocity::Filtered(tau) => {
            let a = Differentiator::new(control.sample_time, tau).pole();
            per_sample * (1.0 - a) * (2.0 / (1.0 + a)).sqrt()
        }
        Velocity::Fitted(smoothing) => {
            let (_, slope) = smoothing.weights(control.sample_time);
            slope.iter().map(|weight| weight * weight).sum::<f64>().sqrt()
        }
        // A sensor of its own, whose noise is not that of the position.
        Velocity::Measured => 0.0,
    };
    let paths = control.gains.iter().filter(|path| path.input == input);
    let variance: f64 = paths
        .map(|path| {
            let own = path.proportional.abs() + path.derivative.abs() * of_rate;
            (own * noise.get(path.coordinate).copied().unwrap_or(0.0)).powi(2)
        })
        .sum();
    NOISE_PEAK * variance.sqrt()
}

/// Multiples of the frequency by coordinate that are tried: where two or three coordinates move, all without a common divisor; where more
/// do, a few by which no two neighbours move alike.
fn varied(pattern: &ReferencePattern, stage: &Stage) -> Vec<Vec<u32>> {
    let moves: Vec<bool> =
        prescribed(pattern, stage).iter().map(|own| own.is_some_and(|own| own.reach() > 0.0)).collect();
    let moved = moves.iter().filter(|moves| **moves).count();
    if moved > MULTIPLES.len() {
        let by = |of: &dyn Fn(u32) -> u32| {
            let mut number = 0;
            let mut next = |moves: &bool| {
                number += u32::from(*moves);
                if *moves { of(number - 1) } else { 1 }
            };
            moves.iter().map(&mut next).collect::<Vec<u32>>()
        };
        let count = moved as u32;
        return vec![by(&|n| n + 1), by(&|n| count - n), by(&|n| 1 + n % 3), by(&|n| 1 + (2 * n) % 5)];
    }
    let of_moved = |list: &Vec<u32>| list.iter().zip(&moves).filter(|(_, moves)| **moves).map(|(m, _)| *m).reduce(gcd);
    let mut found = combined_multiples(&moves);
    found.retain(|list| of_moved(list) == Some(1));
    found
}

/// All combinations of the first multiples of the frequency where two or three coordinates move; none otherwise. A coordinate that does not
/// move has one.
#[must_use]
pub fn combined_multiples(moves: &[bool]) -> Vec<Vec<u32>> {
    if !(2..=MULTIPLES.len()).contains(&moves.iter().filter(|moves| **moves).count()) {
        return Vec::new();
    }
    moves.iter().fold(vec![vec![]], |lists, moves| {
        let of: &[u32] = if *moves { &MULTIPLES } else { &[1] };
        lists.iter().flat_map(|list: &Vec<u32>| of.iter().map(|m| [list.clone(), vec![*m]].concat())).collect()
    })
}
