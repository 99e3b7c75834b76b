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

use crate::information::{run_information, strayed};
use crate::modes::near_mode;
use crate::procedure::{LEAST_PERIODS, Setup, Stage};
use serde::Serialize;
use tpm_controller::model::Model;
use tpm_estimate::{Estimate, Status};
use tpm_motion::trajectory::ReferencePattern;
use tpm_motion::{Trial, demand};
use tpm_numerics::{DMatrix, DVector};
use tpm_plant::simulated::{Actuator, Rig, Sensor};
use tpm_plant::stability::{StabilityDomain, check};
use tpm_report::number;

/// Most that a run reaches and moves faster than the runs before it.
const GROWTH: f64 = 2.5;
/// Share of the room that the first run uses, and of the permitted velocity that it reaches.
const FIRST: (f64, f64) = (0.15, 0.15);
/// Share of a limit of the motion that a reference uses at most.
const USED: f64 = 0.9;
/// Standard deviations of the predicted input that must still lie below the permitted share of its limit: once in 740 runs it does not.
const INPUT_DEVIATIONS: f64 = 3.0;
/// Share of a failed run's size and speed above which a stage counts as containing it.
const CONTAINS: f64 = 0.9;
/// Factor on the extent of a stage by which it is asked whether runs may still grow.
const FURTHER: f64 = 1.2;
/// Share by which the rounding of a period to whole samples may change how fast a run is.
const ROUNDED: f64 = 0.05;
/// Shares of the largest amplitudes from which candidates are formed.
const SHARES: [f64; 6] = [1.0, 0.7, 0.5, 0.35, 0.2, 0.1];
/// Ratio of neighbouring frequencies of candidates, and their number.
const SPEEDS: (f64, usize) = (0.7, 10);
/// Samples in a period of the highest harmonic of a candidate, at least.
const SAMPLES: f64 = 20.0;
/// Multiples of the frequency that are tried for every coordinate where two or three move.
const MULTIPLES: [u32; 3] = [1, 2, 3];
/// Share of the largest gain from which a stage counts as as good, so that the one that was played least is taken.
const AS_GOOD: f64 = 0.8;
/// Longest run, beside the time that a run is measured.
const LONGEST: f64 = 2.0;
/// Phases of a period at which a reference is measured.
const PHASES: usize = 256;
/// Samples of a period at which the deviation of the predicted input is computed.
const LOOKED_AT: usize = 64;
/// Information that counts for nothing, as a share of the most that one run gives about a parameter.
const NOTHING: f64 = 1e-9;
/// Smallest part by which the time that is left must shrink a wanted deviation.
const WORTH: f64 = 0.1;
/// Factor on a limit by which advice asks what more of it would show.
const RAISED: f64 = 1.5;
/// Factor between neighbouring gains that are tried, and their number, until the loop is stable with the estimates and quiet.
const GAINS: (f64, i32) = (0.7, 20);
/// Largest factor on the gains for a machine that does not follow.
const STIFFEST: f64 = 10.0;
/// Share of an input's limit that the feedback of the sensors' noise may use.
const QUIET: f64 = 0.15;
/// Standard deviations of that noise that count as its largest: once in 16,000 samples it is larger.
const NOISE_PEAK: f64 = 4.0;

/// How a campaign chooses its stages by itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Time for which the machine may move, s.
    pub time: f64,
    /// Standard deviation that is wanted of each parameter, as a share of its value; nothing where none is, and past the end of the list.
    pub goals: Vec<Option<f64>>,
}

/// Limits of a motion by coordinate, and of the inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Room {
    /// Least and largest position.
    pub positions: Vec<(f64, f64)>,
    /// Largest magnitude of the velocity.
    pub velocities: Vec<f64>,
    /// Largest magnitude of the acceleration.
    pub accelerations: Vec<f64>,
    /// Factor on the limits of all inputs.
    pub effort: f64,
}

impl Room {
    /// The limits of a setup, completed by infinite ones.
    pub(crate) fn of(setup: &Setup, coordinates: usize) -> Self {
        let procedure = &setup.procedure;
        let bound = |list: &[f64]| (0..coordinates).map(|c| list.get(c).copied().unwrap_or(f64::INFINITY)).collect();
        let open = (f64::NEG_INFINITY, f64::INFINITY);
        Room {
            positions: (0..coordinates).map(|c| procedure.position_bounds.get(c).copied().unwrap_or(open)).collect(),
            velocities: bound(&procedure.velocity_bounds),
            accelerations: bound(&procedure.acceleration_bounds),
            effort: 1.0,
        }
    }
}

/// How far a coordinate goes: least and largest position, largest magnitudes of velocity and acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extent {
    low: f64,
    high: f64,
    velocity: f64,
    acceleration: f64,
}

impl Extent {
    fn reach(&self) -> f64 {
        self.high - self.low
    }
}

/// What a planned campaign has seen of its machine.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seen {
    /// Time for which the machine has moved, s.
    pub(crate) time: f64,
    /// Standard deviation of one sample of every coordinate.
    pub(crate) noise: Vec<f64>,
    /// What the feedback adds to the feed-forward of every input beside the noise of the sensors, at most.
    pub(crate) added: Vec<f64>,
    /// Tracking error that is to be expected of every coordinate, at most.
    pub(crate) tracking: Vec<f64>,
    /// The largest extent of complete runs by coordinate.
    reached: Vec<Extent>,
    /// Extents of runs that failed.
    failed: Vec<Vec<Extent>>,
}

impl Seen {
    /// Takes in the extent of a run that was played to its end, or of one that failed.
    pub(crate) fn played(&mut self, extent: Vec<Extent>, complete: bool) {
        if !complete {
            self.failed.push(extent);
        } else if self.reached.is_empty() {
            self.reached = extent;
        } else {
            for (most, now) in self.reached.iter_mut().zip(extent) {
                *most = Extent {
                    low: most.low.min(now.low),
                    high: most.high.max(now.high),
                    velocity: most.velocity.max(now.velocity),
                    acceleration: most.acceleration.max(now.acceleration),
                };
            }
        }
    }

    /// Whether a stage goes at most [`GROWTH`] times as far as what was played.
    fn is_near(&self, extent: &[Extent]) -> bool {
        let grows = |now: f64, before: f64, most: f64| before > 0.0 && now > (1.0 + ROUNDED) * most * before;
        self.reached.iter().zip(extent).all(|(before, now)| {
            !grows(now.reach(), before.reach(), GROWTH)
                && !grows(now.velocity, before.velocity, GROWTH)
                && !grows(now.acceleration, before.acceleration, GROWTH * GROWTH)
        })
    }

    /// Whether a stage contains one that failed: as far and as fast in every coordinate.
    fn has_failed(&self, extent: &[Extent]) -> bool {
        self.failed.iter().any(|failed| {
            failed.iter().zip(extent).all(|(failed, now)| {
                now.reach() >= CONTAINS * failed.reach() && now.velocity >= CONTAINS * failed.velocity
            })
        })
    }
}

/// How far every coordinate goes in one period of a trial, the open ones too.
pub(crate) fn extent(trial: &Trial, coordinates: usize) -> Vec<Extent> {
    let width = trial.reference.len() / trial.samples_per_period.max(1);
    let of = |c: usize| {
        let column = |order: usize| trial.reference.iter().skip(order * coordinates + c).step_by(width.max(1));
        let largest = |order: usize| {
            if (order + 1) * coordinates > width {
                0.0
            } else {
                column(order).fold(0.0, |most: f64, x| most.max(x.abs()))
            }
        };
        Extent {
            low: column(0).copied().fold(f64::INFINITY, f64::min),
            high: column(0).copied().fold(f64::NEG_INFINITY, f64::max),
            velocity: largest(1),
            acceleration: largest(2),
        }
    };
    (0..coordinates).map(of).collect()
}

/// How far the coordinates that a stage prescribes go.
fn prescribed(pattern: &ReferencePattern, stage: &Stage) -> Vec<Option<Extent>> {
    let trajectory = stage.trajectory(pattern, 1.0);
    let open = stage.pattern(pattern).open();
    let of = |c: usize| {
        let series = &trajectory.coordinates[c];
        let mut found = Extent { low: f64::INFINITY, high: f64::NEG_INFINITY, velocity: 0.0, acceleration: 0.0 };
        for n in 0..PHASES {
            let phase = 2.0 * std::f64::consts::PI * n as f64 / PHASES as f64;
            let at = |order: usize| series.derivative(phase, trajectory.frequency, order);
            found.low = found.low.min(at(0));
            found.high = found.high.max(at(0));
            found.velocity = found.velocity.max(at(1).abs());
            found.acceleration = found.acceleration.max(at(2).abs());
        }
        found
    };
    (0..trajectory.coordinates.len()).map(|c| (!open.contains(&c)).then(|| of(c))).collect()
}

/// The largest amplitudes with which every prescribed coordinate stays within these positions, every amplitude alone using the same
/// share of them; nothing where the motion without amplitudes does not.
fn largest(pattern: &ReferencePattern, stage: &Stage, positions: &[(f64, f64)]) -> Option<Vec<f64>> {
    let count = stage.pattern(pattern).amplitudes.len();
    let at = |amplitudes: Vec<f64>| prescribed(pattern, &Stage { amplitudes, ..stage.clone() });
    let rest = at(vec![0.0; count]);
    let inside = |(c, extent): (usize, &Option<Extent>)| {
        extent.is_none_or(|rest| positions[c].0 < rest.low && rest.high < positions[c].1)
    };
    if !rest.iter().enumerate().all(inside) {
        return None;
    }
    // The factor that brings a motion to the ends of the positions.
    let factor = |moved: &[Option<Extent>]| {
        let of = |(c, (moved, rest)): (usize, (&Option<Extent>, &Option<Extent>))| {
            let (Some(moved), Some(rest)) = (moved, rest) else { return f64::INFINITY };
            let side = |room: f64, way: f64| if way > 0.0 { room / way } else { f64::INFINITY };
            let (low, high) = positions[c];
            side(high - rest.high, moved.high - rest.high).min(side(rest.low - low, rest.low - moved.low))
        };
        moved.iter().zip(&rest).enumerate().map(of).fold(f64::INFINITY, f64::min)
    };
    let alone = |k: usize| factor(&at((0..count).map(|other| f64::from(u8::from(other == k))).collect()));
    let mut amplitudes: Vec<f64> = (0..count).map(alone).collect();
    if amplitudes.is_empty() || amplitudes.iter().any(|size| !size.is_finite()) {
        return None;
    }
    // Amplitudes may enter with powers, so that one factor is not enough.
    for _ in 0..4 {
        let scale = factor(&at(amplitudes.clone()));
        amplitudes.iter_mut().for_each(|size| *size *= scale);
    }
    Some(amplitudes)
}

/// The first stage: so small and slow that its speed and its size are a small share of the limits.
///
/// Nothing where a prescribed coordinate rests outside its limits, or has none.
#[must_use]
pub fn first_stage(pattern: &ReferencePattern, stage: &Stage, room: &Room, sample_time: f64) -> Option<Stage> {
    let positions = narrowed(&room.positions, &[]);
    let mut first = Stage { frequency: 1.0, ..stage.clone() };
    first.amplitudes = largest(pattern, &first, &positions)?.into_iter().map(|size| FIRST.0 * size).collect();
    let of_speed =
        |speed: f64, extent: &Extent| if extent.velocity > 0.0 { speed / extent.velocity } else { f64::INFINITY };
    let slowest =
        prescribed(pattern, &first).iter().zip(&room.velocities).fold(f64::INFINITY, |least, (own, speed)| {
            own.as_ref().map_or(least, |extent| least.min(of_speed(FIRST.1 * speed, extent)))
        });
    let finest = fastest(pattern, &first, sample_time);
    first.frequency = slowest.min(finest);
    first.frequency.is_finite().then_some(first)
}

/// A stage after one that the machine did not follow: [`GROWTH`] times as large, as far as the limits allow, or else with stiffer gains;
/// nothing where these are as stiff as may be. Its frequency is lowered where the speed would pass its limit.
pub(crate) fn larger(setup: &Setup, stage: &Stage, coordinates: usize) -> Option<Stage> {
    let room = Room::of(setup, coordinates);
    let most = largest(&setup.pattern, stage, &narrowed(&room.positions, &[]))?;
    let bounded =
        stage.amplitudes.iter().zip(&most).map(|(own, most)| (GROWTH * own.abs()).min(most.abs()).copysign(*own));
    let mut next = Stage { amplitudes: bounded.collect(), ..stage.clone() };
    let grew = next.amplitudes.iter().zip(&stage.amplitudes).any(|(now, before)| now.abs() > FURTHER * before.abs());
    if !grew {
        next.gain *= GROWTH;
        return (next.gain <= STIFFEST).then_some(next);
    }
    for (c, extent) in prescribed(&setup.pattern, &next).iter().enumerate() {
        let Some(extent) = extent.filter(|extent| extent.velocity > USED * room.velocities[c]) else { continue };
        next.frequency *= USED * room.velocities[c] / extent.velocity;
    }
    Some(next)
}

/// The frequency at which the highest harmonic of a stage has as few samples as a candidate may.
fn fastest(pattern: &ReferencePattern, stage: &Stage, sample_time: f64) -> f64 {
    let highest = f64::from(stage.trajectory(pattern, 1.0).highest_harmonic().max(1));
    2.0 * std::f64::consts::PI / (SAMPLES * highest * sample_time)
}

/// The positions that a reference may use: a share of the room, and free of the tracking error.
fn narrowed(positions: &[(f64, f64)], tracking: &[f64]) -> Vec<(f64, f64)> {
    let narrow = |(c, &(low, high)): (usize, &(f64, f64))| {
        let free = (1.0 - USED) / 2.0 * (high - low) + tracking.get(c).copied().unwrap_or(0.0);
        if free.is_finite() { (low + free, high - free) } else { (low, high) }
    };
    positions.iter().enumerate().map(narrow).collect()
}

/// Which limit, if it were larger, would show a parameter better.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advice {
    /// The parameter that is known least, beside what is wanted of it.
    pub parameter: String,
    /// Its standard deviation as a share of its value; nothing where it is not shown at all.
    pub deviation: Option<f64>,
    /// What is wanted of it.
    pub wanted: Option<f64>,
    /// The limit, as one writes it: `x`, `dot(x)` or an input; nothing where no larger limit would help.
    pub limit: Option<String>,
    /// Factor on the limit that was tried.
    pub raised: f64,
    /// The deviation that one more run would then leave, as a share of what one more run leaves now.
    pub left: Option<f64>,
}

impl std::fmt::Display for Advice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = |share: f64| number(100.0 * share);
        write!(f, "known least: {}, ", self.parameter)?;
        match self.deviation {
            Some(deviation) => write!(f, "to {} %", percent(deviation))?,
            None => f.write_str("which nothing shows by itself")?,
        }
        if let Some(wanted) = self.wanted {
            write!(f, " ({} % wanted)", percent(wanted))?;
        }
        match (&self.limit, self.left) {
            (Some(limit), Some(left)) => write!(
                f,
                "; with {} times the limit of {limit} one more run would leave {} % of the deviation that it leaves now",
                number(self.raised),
                percent(left)
            ),
            _ => write!(f, "; no limit alone, raised by {} %, would help much", percent(self.raised - 1.0)),
        }
    }
}

/// What is chosen.
pub(crate) enum Choice {
    /// The stage to play.
    Play(Stage),
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
        let known = self.known(&free, &candidates);
        let gains: Vec<f64> = candidates.iter().map(|one| known.gain(self, one, 1.0) / one.duration).collect();
        let most = gains.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let good = (0..gains.len()).filter(|&i| gains[i] >= AS_GOOD * most);
        let other = |i: usize| self.newness(&candidates[i].stage);
        let Some(best) = good.max_by(|&a, &b| other(a).total_cmp(&other(b))) else { return Choice::NoTime };
        let chosen = candidates.swap_remove(best);
        let may_grow = !self.seen.is_near(&scaled(&chosen.extent, FURTHER));
        if !may_grow && self.has_nothing_left(&known, &chosen, left) {
            return Choice::NothingMore;
        }
        Choice::Play(chosen.stage)
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

    /// What to raise for the parameter that is known least; nothing where all is known as well as is wanted.
    pub(crate) fn advice(&self) -> Option<Advice> {
        let free = self.free();
        let worst = match self.unmet() {
            Some(unmet) => unmet.into_iter().max_by(|&a, &b| self.missed(a).total_cmp(&self.missed(b)))?,
            None => free.iter().copied().max_by(|&a, &b| self.relative(a).total_cmp(&self.relative(b)))?,
        };
        let at = free.iter().position(|&j| j == worst)?;
        let coordinates = self.model.dims().coordinates;
        let own = Room::of(self.setup, coordinates);
        let mut tried: Vec<(Option<String>, Room)> = vec![(None, own.clone())];
        let name = |c: usize| self.model.coordinate(c).name;
        for c in (0..coordinates).filter(|_| coordinates <= MULTIPLES.len()) {
            let mut wider = own.clone();
            let (low, high) = wider.positions[c];
            let more = (RAISED - 1.0) / 2.0 * (high - low);
            wider.positions[c] = (low - more, high + more);
            let mut faster = own.clone();
            faster.velocities[c] *= RAISED;
            tried.extend([(Some(name(c).to_string()), wider), (Some(format!("dot({})", name(c))), faster)]);
        }
        let inputs = (0..self.model.dims().inputs).map(|i| self.model.input(i).name).collect::<Vec<_>>().join(", ");
        tried.push((Some(inputs), Room { effort: RAISED, ..own }));
        let all: Vec<(Option<String>, Vec<Candidate>)> =
            tried.into_iter().map(|(limit, room)| (limit, self.candidates(&room, false))).collect();
        let every: Vec<&Candidate> = all.iter().flat_map(|(_, list)| list).collect();
        let known = self.known_of(&free, &every);
        let least = |list: &[Candidate]| {
            list.iter().map(|one| known.deviation(at, Some(one), 1.0)).fold(f64::INFINITY, f64::min)
        };
        let now = least(&all.first()?.1);
        let best = all[1..].iter().map(|(limit, list)| (limit, least(list))).min_by(|a, b| a.1.total_cmp(&b.1));
        let helps = best.filter(|(_, left)| *left < (1.0 - WORTH) * now);
        let shown = self.estimate.status.get(worst) != Some(&Status::Unobservable);
        Some(Advice {
            parameter: self.model.parameter(worst).name.to_string(),
            deviation: shown.then(|| self.relative(worst)),
            wanted: self.plan.goals.get(worst).copied().flatten(),
            limit: helps.as_ref().and_then(|(limit, _)| (*limit).clone()),
            raised: RAISED,
            left: helps.map(|(_, left)| left / now),
        })
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
        let positions = narrowed(&room.positions, &self.seen.tracking);
        let plain = Stage { strokes: Vec::new(), gain: self.gain(), ..self.last.clone() };
        let stray = self.stray();
        let mut found = self.of_multiples(&plain, (room, &positions), &stray, gated);
        let moved = prescribed(pattern, &plain).iter().flatten().filter(|extent| extent.reach() > 0.0).count();
        if (2..=MULTIPLES.len()).contains(&moved) {
            for multiples in combined(pattern, self.model.dims().coordinates) {
                if multiples != plain.multiples {
                    let stage = Stage { multiples, ..plain.clone() };
                    found.extend(self.of_multiples(&stage, (room, &positions), &stray, gated));
                }
            }
        }
        found
    }

    /// Amplitudes and frequencies of candidates with the multiples of a stage.
    fn of_multiples(
        &self,
        stage: &Stage,
        (room, positions): (&Room, &[(f64, f64)]),
        stray: &[f64],
        gated: bool,
    ) -> Vec<Candidate> {
        let pattern = &self.setup.pattern;
        let sample_time = self.setup.control.sample_time;
        let mut found = Vec::new();
        let whole = Stage { frequency: 1.0, ..stage.clone() };
        let Some(most) = largest(pattern, &whole, positions) else { return found };
        for share in SHARES {
            let amplitudes: Vec<f64> = most.iter().map(|size| share * size).collect();
            let sized = Stage { amplitudes, ..whole.clone() };
            let mut top = fastest(pattern, &sized, sample_time);
            for (c, extent) in prescribed(pattern, &sized).iter().enumerate() {
                let Some(extent) = extent.filter(|extent| extent.velocity > 0.0) else { continue };
                let mut speed = USED * room.velocities[c];
                let mut bend = USED * room.accelerations[c];
                if let Some(reached) = self.seen.reached.get(c).filter(|_| gated) {
                    speed = speed.min(GROWTH * reached.velocity);
                    bend = bend.min(GROWTH * GROWTH * reached.acceleration);
                }
                top = top.min(speed / extent.velocity).min((bend / extent.acceleration).sqrt());
            }
            for n in 0..SPEEDS.1 {
                let stage = Stage { frequency: top * SPEEDS.0.powi(n as i32), ..sized.clone() };
                found.extend(self.candidate(stage, room, stray, gated));
            }
        }
        found
    }

    /// A stage with what it would show, where it keeps the limits.
    fn candidate(&self, stage: Stage, room: &Room, stray: &[f64], gated: bool) -> Option<Candidate> {
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
        if !keeps || gated && (!self.seen.is_near(&extent) || self.seen.has_failed(&extent)) {
            return None;
        }
        if (self.share)(&trial) + self.spread(&trial, stage.gain) >= self.setup.procedure.effort_share * room.effort {
            return None;
        }
        let root = self.root(&trial, stray)?;
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
        let root = root.select_columns(&self.free());
        root.iter().all(|value| value.is_finite()).then_some(root)
    }

    /// Whether the samples of runs of these stages could show what is wanted, though the estimates of their harmonics do not.
    pub(crate) fn may_be_enough(&self, stages: &[&Stage]) -> bool {
        let Some(unmet) = self.unmet().filter(|unmet| !unmet.is_empty()) else { return false };
        let free = self.free();
        let stray = self.stray();
        let mut information = DMatrix::zeros(free.len(), free.len());
        for root in stages.iter().filter_map(|stage| self.root(&(self.trial)(stage)?, &stray)) {
            information += root.transpose() * root;
        }
        let scale = information.diagonal().map(|own| if own > 0.0 { own.sqrt() } else { 1.0 });
        let scaled = DMatrix::from_fn(free.len(), free.len(), |r, c| information[(r, c)] / (scale[r] * scale[c]));
        let known = Known { information: scaled + DMatrix::identity(free.len(), free.len()) * NOTHING, scale };
        unmet.into_iter().all(|j| {
            let Some(at) = free.iter().position(|&own| own == j) else { return true };
            let wanted = self.plan.goals[j].unwrap_or(f64::INFINITY) * self.estimate.values[j].abs();
            known.deviation(at, None, 0.0) <= wanted
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

    /// Share of its limit by which an input may be larger than its feed-forward: by the deviations of the estimates, and by what the
    /// feedback adds.
    fn spread(&self, trial: &Trial, gain: f64) -> f64 {
        let dims = self.model.dims();
        let width = dims.motion_len();
        let step = (trial.samples_per_period / LOOKED_AT).max(1);
        let motions: Vec<f64> = trial.reference.chunks_exact(width).step_by(step).flatten().copied().collect();
        let of = |theta: &[f64]| demand(self.model, &motions, theta, &trial.constants).ok();
        let Some(own) = of(self.theta) else { return f64::INFINITY };
        let free = self.free();
        let covariance = covariance(self.estimate, &free);
        let mut variance = vec![0.0; own.len()];
        let eigen = covariance.symmetric_eigen();
        for (value, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value <= 0.0 {
                continue;
            }
            let mut theta = self.theta.to_vec();
            for (&j, part) in free.iter().zip(direction.iter()) {
                theta[j] += value.sqrt() * part;
            }
            let Some(moved) = of(&theta) else { continue };
            for (sum, (now, before)) in variance.iter_mut().zip(moved.iter().zip(&own)) {
                *sum += (now - before).powi(2);
            }
        }
        let mut largest = 0.0_f64;
        for (at, variance) in variance.iter().enumerate() {
            let i = at % dims.inputs.max(1);
            let limit = trial.input_limits.get(i).copied().unwrap_or(f64::INFINITY);
            let added =
                self.seen.added.get(i).copied().unwrap_or(0.0) + gain * noise_fed_back(self.setup, &self.seen.noise, i);
            largest = largest.max((INPUT_DEVIATIONS * variance.sqrt() + added) / limit);
        }
        largest
    }

    /// What is known, in units in which the most that a candidate shows of every parameter is one.
    fn known(&self, free: &[usize], candidates: &[Candidate]) -> Known {
        self.known_of(free, &candidates.iter().collect::<Vec<_>>())
    }

    fn known_of(&self, free: &[usize], candidates: &[&Candidate]) -> Known {
        let covariance = covariance(self.estimate, free);
        let mut scale = DVector::from_element(free.len(), 0.0);
        for candidate in candidates {
            for (most, column) in scale.iter_mut().zip(candidate.root.column_iter()) {
                *most = f64::max(*most, column.norm());
            }
        }
        scale.iter_mut().filter(|own| **own == 0.0).for_each(|own| *own = 1.0);
        // Information is the inverse of the covariance over the directions that are shown; the others have none.
        let scaled = DMatrix::from_fn(free.len(), free.len(), |r, c| covariance[(r, c)] * scale[r] * scale[c]);
        let eigen = scaled.symmetric_eigen();
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let mut information = DMatrix::from_diagonal_element(free.len(), free.len(), NOTHING);
        for (value, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > f64::EPSILON * free.len() as f64 * largest {
                information += direction * direction.transpose() / *value;
            }
        }
        Known { information, scale }
    }

    /// Whether all the time that is left, spent on a stage, would not make a wanted deviation noticeably smaller.
    fn has_nothing_left(&self, known: &Known, stage: &Candidate, left: f64) -> bool {
        let free = self.free();
        let Some(unmet) = self.unmet() else { return false };
        unmet.iter().filter_map(|j| free.iter().position(|own| own == j)).all(|at| {
            known.deviation(at, Some(stage), left / stage.duration) > (1.0 - WORTH) * known.deviation(at, None, 0.0)
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
/// deviation s it has the deviation `s (1 - a)/T sqrt(2/(1 + a))`.
pub(crate) fn noise_fed_back(setup: &Setup, noise: &[f64], input: usize) -> f64 {
    let control = &setup.control;
    let a = control
        .velocity
        .time_constant()
        .map_or(0.0, |tau| if tau > 0.0 { (-control.sample_time / tau).exp() } else { 0.0 });
    let of_rate = (1.0 - a) / control.sample_time * (2.0 / (1.0 + a)).sqrt();
    let paths = control.gains.iter().filter(|path| path.input == input);
    let variance: f64 = paths
        .map(|path| {
            let own = path.proportional.abs() + path.derivative.abs() * of_rate;
            (own * noise.get(path.coordinate).copied().unwrap_or(0.0)).powi(2)
        })
        .sum();
    NOISE_PEAK * variance.sqrt()
}

/// Extents times a factor, about their middle.
fn scaled(extents: &[Extent], factor: f64) -> Vec<Extent> {
    let of = |own: &Extent| {
        let (middle, half) = ((own.low + own.high) / 2.0, factor * own.reach() / 2.0);
        Extent {
            low: middle - half,
            high: middle + half,
            velocity: factor * own.velocity,
            acceleration: factor * own.acceleration,
        }
    };
    extents.iter().map(of).collect()
}

/// Covariance of the free parameters.
fn covariance(estimate: &Estimate, free: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(free.len(), free.len(), |r, c| estimate.covariance.get(free[r], free[c]).unwrap_or(0.0))
}

/// Multiples of the frequency of every coordinate, without those that have a common divisor.
fn combined(pattern: &ReferencePattern, coordinates: usize) -> Vec<Vec<u32>> {
    let mut found: Vec<Vec<u32>> = vec![vec![]];
    for c in 0..coordinates {
        let of: &[u32] = if pattern.coordinates[c].is_empty() { &[1] } else { &MULTIPLES };
        found = found.iter().flat_map(|list| of.iter().map(|m| [list.clone(), vec![*m]].concat())).collect();
    }
    let gcd = |mut a: u32, mut b: u32| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    found.retain(|list| list.iter().copied().reduce(gcd) == Some(1));
    found
}

/// Information in scaled parameters.
struct Known {
    information: DMatrix<f64>,
    scale: DVector<f64>,
}

impl Known {
    /// The information with `runs` runs of a candidate.
    fn with(&self, candidate: &Candidate, runs: f64) -> DMatrix<f64> {
        let mut root = candidate.root.clone();
        for (mut column, scale) in root.column_iter_mut().zip(self.scale.iter()) {
            column /= *scale;
        }
        &self.information + root.transpose() * root * runs
    }

    /// Standard deviation of the free parameter `at`, with `runs` runs of a candidate where there is one.
    fn deviation(&self, at: usize, candidate: Option<&Candidate>, runs: f64) -> f64 {
        let information = candidate.map_or_else(|| self.information.clone(), |one| self.with(one, runs));
        let unit = DVector::from_fn(self.scale.len(), |j, _| f64::from(u8::from(j == at)));
        let solved = information.cholesky().map(|factor| factor.solve(&unit)[at]);
        solved.map_or(f64::INFINITY, |variance| variance.max(0.0).sqrt() / self.scale[at])
    }

    /// What runs of a candidate are worth.
    fn gain(&self, scene: &Scene<'_>, candidate: &Candidate, runs: f64) -> f64 {
        let free = scene.free();
        if let Some(unmet) = scene.unmet() {
            let lost = |j: &usize| {
                let Some(at) = free.iter().position(|own| own == j) else { return 0.0 };
                let goal = scene.plan.goals[*j].unwrap_or(1.0) * scene.estimate.values[*j].abs();
                let missed = |std: f64| (std / goal.max(f64::MIN_POSITIVE)).ln().max(0.0);
                missed(self.deviation(at, None, 0.0)) - missed(self.deviation(at, Some(candidate), runs))
            };
            return unmet.iter().map(lost).sum();
        }
        let logarithm = |matrix: DMatrix<f64>| {
            matrix
                .cholesky()
                .map_or(f64::NEG_INFINITY, |factor| 2.0 * factor.l().diagonal().iter().map(|x| x.ln()).sum::<f64>())
        };
        logarithm(self.with(candidate, runs)) - logarithm(self.information.clone())
    }
}
