//! How far and how fast stages go, and how far they may.

use crate::setup::{LEAST_PERIODS, Setup, Stage};
use tpm_motion::Trial;
use tpm_motion::trajectory::ReferencePattern;

/// Most that a run reaches and moves faster than the runs before it.
pub(super) const GROWTH: f64 = 2.5;
/// Share of the room that the first run uses, and of the permitted velocity that it reaches.
const FIRST: (f64, f64) = (0.15, 0.15);
/// Share of the time of a campaign that its first run may take, and the factor by which it is faster at most where it would take more.
const FIRST_RUN: f64 = 0.2;
const FASTER: f64 = 3.0;
/// Share of a limit of the motion that a reference uses at most.
pub(super) const USED: f64 = 0.9;
/// Share of a failed run's size and speed above which a stage counts as containing it.
const CONTAINS: f64 = 0.9;
/// Factor on the extent of a stage by which it is asked whether runs may still grow.
pub(super) const FURTHER: f64 = 1.2;
/// Share by which the rounding of a period to whole samples may change how fast a run is.
const ROUNDED: f64 = 0.05;
/// Samples in a period of the highest harmonic of a candidate, at least.
const SAMPLES: f64 = 20.0;
/// Phases of a period at which a reference is measured.
const PHASES: usize = 256;
/// Largest factor on the gains for a machine that does not follow.
const STIFFEST: f64 = 10.0;

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
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) velocity: f64,
    pub(super) acceleration: f64,
}

impl Extent {
    pub(super) fn reach(&self) -> f64 {
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
    pub(super) reached: Vec<Extent>,
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

    /// Whether a stage goes, `times` as far and fast as it does, at most [`GROWTH`] times as far as what was played.
    pub(super) fn is_near(&self, extent: &[Extent], times: f64) -> bool {
        let grows = |now: f64, before: f64, most: f64| before > 0.0 && times * now > (1.0 + ROUNDED) * most * before;
        self.reached.iter().zip(extent).all(|(before, now)| {
            !grows(now.reach(), before.reach(), GROWTH)
                && !grows(now.velocity, before.velocity, GROWTH)
                && !grows(now.acceleration, before.acceleration, GROWTH * GROWTH)
        })
    }

    /// Whether a stage contains one that failed: as far and as fast in every coordinate.
    pub(super) fn has_failed(&self, extent: &[Extent]) -> bool {
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
pub(super) fn prescribed(pattern: &ReferencePattern, stage: &Stage) -> Vec<Option<Extent>> {
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
pub(super) fn largest(pattern: &ReferencePattern, stage: &Stage, positions: &[(f64, f64)]) -> Option<Vec<f64>> {
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

/// The first stage: so small and slow that its speed and its size are a small share of the limits. Where it would take more than a share of
/// the campaign's time (s) with its settling periods it is faster, but not by much.
///
/// Nothing where a prescribed coordinate rests outside its limits, or has none.
#[must_use]
pub fn first_stage(
    pattern: &ReferencePattern,
    stage: &Stage,
    room: &Room,
    sample_time: f64,
    (settle_periods, time): (usize, f64),
) -> Option<Stage> {
    let mut first = Stage { frequency: 1.0, ..stage.clone() };
    first.amplitudes =
        largest(pattern, &first, &narrowed(&room.positions, &[]))?.into_iter().map(|size| FIRST.0 * size).collect();
    let own = within_speed(pattern, &first, &room.velocities, FIRST.1).min(fastest(pattern, &first, sample_time));
    let quick = 2.0 * std::f64::consts::PI * (settle_periods + LEAST_PERIODS) as f64 / (FIRST_RUN * time);
    first.frequency = own.max(quick.min(FASTER * own));
    first.frequency.is_finite().then_some(first)
}

/// The frequency at which a stage reaches a share of the permitted velocities.
fn within_speed(pattern: &ReferencePattern, stage: &Stage, velocities: &[f64], share: f64) -> f64 {
    let moved = prescribed(pattern, &Stage { frequency: 1.0, ..stage.clone() });
    let moving = moved.iter().zip(velocities).filter_map(|(own, most)| Some((own.as_ref()?.velocity, most)));
    moving.filter(|(own, _)| *own > 0.0).map(|(own, most)| share * most / own).fold(f64::INFINITY, f64::min)
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
    next.frequency = next.frequency.min(within_speed(&setup.pattern, &next, &room.velocities, USED));
    Some(next)
}

/// The frequency at which the highest harmonic of a stage has as few samples as a candidate may.
pub(super) fn fastest(pattern: &ReferencePattern, stage: &Stage, sample_time: f64) -> f64 {
    let highest = f64::from(stage.trajectory(pattern, 1.0).highest_harmonic().max(1));
    2.0 * std::f64::consts::PI / (SAMPLES * highest * sample_time)
}

/// The positions that a reference may use: a share of the room, and free of the tracking error.
pub(super) fn narrowed(positions: &[(f64, f64)], tracking: &[f64]) -> Vec<(f64, f64)> {
    let narrow = |(c, &(low, high)): (usize, &(f64, f64))| {
        let free = (1.0 - USED) / 2.0 * (high - low) + tracking.get(c).copied().unwrap_or(0.0);
        if free.is_finite() { (low + free, high - free) } else { (low, high) }
    };
    positions.iter().enumerate().map(narrow).collect()
}
