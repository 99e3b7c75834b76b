//! Many starts, the best of which are followed to their ends.
//!
//! A start is a random motion. It is first brought within the limits, then improved inside a barrier that is lowered in steps. The motion is
//! rounded to the decimals with which it is written, and these are judged: between samples the inputs are enclosed, and a motion that is not
//! shown to keep within is sought again with less room.

use super::descent::descend;
use super::held::{self, Torques};
use super::problem::{Aim, Memory, Problem};
use super::series::Series;
use super::settings::ExcitationSettings;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tpm_controller::model::EvalError;
use tpm_motion::trajectory::Trajectory;
use tpm_numerics::DVector;

/// Samples in the period of the highest harmonic while starts are compared, and while the best are followed.
const COARSE: usize = 12;
const FINE: usize = 24;
/// Share of the limits within which a start is brought.
const INSIDE: f64 = 0.97;
/// Steps to bring a start within the limits.
const ENTERING: usize = 300;
/// Factor on the barrier and number of steps while starts are compared.
const COMPARING: (f64, usize) = (0.1, 60);
/// Factors on the barrier and numbers of steps for the best.
const FOLLOWING: [(f64, usize); 2] = [(1e-2, 150), (1e-3, 250)];
/// One of so many starts is followed to its end.
const FOLLOWED: usize = 8;
/// Fewest that are.
const LEAST_FOLLOWED: usize = 4;
/// Share of the time in which starts are compared, where the time is limited.
const COMPARED_FOR: f64 = 0.5;
/// Decimals of the coefficients.
const DIGITS: i32 = 6;
/// Room that is taken away each time a motion is not shown to keep within the limits, and how often.
const LESS: f64 = 0.005;
const AGAIN: usize = 6;

/// A motion that was found.
pub(super) struct Found {
    pub(super) motion: Trajectory,
    /// Value of the criterion, the smaller the better.
    pub(super) value: f64,
}

/// The results of a search.
pub(super) struct Searched {
    /// Starts that were tried.
    pub(super) tried: usize,
    /// Those that were brought within the limits.
    pub(super) feasible: usize,
    /// The smallest value of the criterion among the starts within the limits, before anything was improved.
    pub(super) at_first: f64,
    /// Motions that keep within the limits at every instant, best first.
    pub(super) found: Vec<Found>,
}

/// Families of motions with coarse and fine samples.
pub(super) struct Families {
    coarse: Series,
    fine: Series,
}

impl Families {
    pub(super) fn new(centres: &[(f64, f64)], harmonics: u32, frequency: f64, orders: usize) -> Self {
        let of =
            |samples: usize| Series::new(centres.to_vec(), harmonics, frequency, samples * harmonics as usize, orders);
        Self { coarse: of(COARSE), fine: of(FINE) }
    }
}

/// One start after the comparison.
struct Start {
    point: DVector<f64>,
    /// Value of the criterion and the barrier.
    value: f64,
    at_first: f64,
}

/// Searches; `progress` sees how much of the work is done, of how much, and says whether to go on.
pub(super) fn search(
    problem: &Problem<'_>,
    families: &Families,
    parameters: &[f64],
    settings: &ExcitationSettings,
    progress: &(dyn Fn(usize, usize) -> bool + Sync),
) -> Result<Searched, EvalError> {
    let began = Instant::now();
    let within =
        |share: f64| settings.seconds.is_none_or(|most| began.elapsed() < Duration::from_secs_f64(share * most));
    let followed = (settings.starts / FOLLOWED).max(LEAST_FOLLOWED).min(settings.starts);
    let (done, work) = (AtomicUsize::new(0), settings.starts + followed * FOLLOWED);
    let ended = |amount: usize| progress(done.fetch_add(amount, Ordering::Relaxed) + amount, work);
    // The seed and the number of a start give its motion, whatever the threads do.
    let tried = AtomicUsize::new(0);
    let start = |number: usize| {
        if !(within(COMPARED_FOR) && progress(done.load(Ordering::Relaxed), work)) {
            return None;
        }
        tried.fetch_add(1, Ordering::Relaxed);
        let mut random = ChaCha8Rng::seed_from_u64(settings.seed);
        random.set_stream(number as u64);
        let go_on = || within(COMPARED_FOR) && progress(done.load(Ordering::Relaxed), work);
        let found = begin(problem, &families.coarse, &mut random, &go_on);
        ended(1);
        Some(found)
    };
    let started: Vec<Option<Start>> = (0..settings.starts).into_par_iter().filter_map(start).collect();
    let mut starts: Vec<Start> = started.into_iter().flatten().collect();
    starts.sort_by(|a, b| a.value.total_cmp(&b.value));
    let feasible = starts.len();
    let at_first = starts.iter().map(|start| start.at_first).fold(f64::INFINITY, f64::min);
    starts.truncate(followed);
    let go_on = || within(1.0) && progress(done.load(Ordering::Relaxed), work);
    let follow = |start: Start| {
        let found = follow(problem, &families.fine, start.point, parameters, &go_on);
        ended(FOLLOWED);
        found
    };
    let found: Result<Vec<Option<Found>>, EvalError> = starts.into_par_iter().map(follow).collect();
    let mut found: Vec<Found> = found?.into_iter().flatten().collect();
    found.sort_by(|a, b| a.value.total_cmp(&b.value));
    Ok(Searched { tried: tried.into_inner(), feasible, at_first, found })
}

/// A random motion, brought within the limits and improved; nothing where it cannot be brought within, or hides a base parameter.
fn begin(problem: &Problem<'_>, series: &Series, random: &mut ChaCha8Rng, go_on: &dyn Fn() -> bool) -> Option<Start> {
    let mut memory = problem.memory(series);
    let mut point = DVector::from_vec(drawn(problem, series, random));
    let remaining = enter(problem, series, &mut point, &mut memory, go_on);
    if remaining > 0.0 {
        return None;
    }
    let mut gradient = vec![0.0; series.len()];
    let at_first = problem.value(series, point.as_slice(), Aim::Best(0.0), &mut memory, &mut gradient);
    let (factor, steps) = COMPARING;
    let value = improve(problem, series, &mut point, factor, steps, &mut memory, go_on);
    value.is_finite().then_some(Start { point, value, at_first })
}

/// Brings a motion within the limits; what remains beyond them, zero where it succeeds.
fn enter(
    problem: &Problem<'_>,
    series: &Series,
    point: &mut DVector<f64>,
    memory: &mut Memory,
    go_on: &dyn Fn() -> bool,
) -> f64 {
    let value = |x: &[f64], gradient: &mut [f64]| problem.value(series, x, Aim::Feasible(INSIDE), memory, gradient);
    descend(point, ENTERING, value, |value| value > 0.0 && go_on())
}

fn improve(
    problem: &Problem<'_>,
    series: &Series,
    point: &mut DVector<f64>,
    factor: f64,
    steps: usize,
    memory: &mut Memory,
    go_on: &dyn Fn() -> bool,
) -> f64 {
    let value = |x: &[f64], gradient: &mut [f64]| problem.value(series, x, Aim::Best(factor), memory, gradient);
    descend(point, steps, value, |_| go_on())
}

/// Follows a motion to its end, and rounds it; nothing where it cannot be shown to keep within the limits.
fn follow(
    problem: &Problem<'_>,
    series: &Series,
    mut point: DVector<f64>,
    parameters: &[f64],
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Found>, EvalError> {
    let mut memory = problem.memory(series);
    let mut own = problem.with_room(1.0);
    for attempt in 0..AGAIN {
        // Finer samples, or less room, leave the motion outside at first. Once the time is over it must still come inside.
        if enter(&own, series, &mut point, &mut memory, &|| true) > 0.0 {
            return Ok(None);
        }
        let stages = if attempt == 0 { &FOLLOWING[..] } else { &FOLLOWING[1..] };
        for &(factor, steps) in stages {
            improve(&own, series, &mut point, factor, steps, &mut memory, go_on);
        }
        let motion = series.rounded(point.as_slice(), DIGITS);
        let beyond = beyond(problem, &motion, parameters)?;
        if beyond <= 1.0 {
            let mut gradient = vec![0.0; series.len()];
            let value = problem.value(series, point.as_slice(), Aim::Best(0.0), &mut memory, &mut gradient);
            return Ok(Some(Found { motion, value }));
        }
        let room = own.room / beyond - LESS;
        own = problem.with_room(room.max(0.5 * own.room));
    }
    Ok(None)
}

/// The largest share of a limit that a motion takes at any instant, where that is above one; at most one otherwise.
fn beyond(problem: &Problem<'_>, motion: &Trajectory, parameters: &[f64]) -> Result<f64, EvalError> {
    let mut most: f64 = 0.0;
    for (series, limits) in motion.coordinates.iter().zip(&problem.limits) {
        for (order, (centre, reach)) in limits.of_orders().into_iter().enumerate() {
            if reach.is_finite() {
                most = most.max(held::bound(series, motion.frequency, order, centre) / reach);
            }
        }
    }
    let torques =
        held::torques(problem.rows, motion, problem.constants, parameters, &problem.factors, &problem.efforts)?;
    Ok(match torques {
        Torques::Within => most,
        // What is so near that it cannot be told counts as beyond.
        Torques::Beyond(share) => most.max(share),
    })
}

/// A random motion within the limits of positions and their derivatives. The torques' limits are not looked at.
pub(super) fn drawn(problem: &Problem<'_>, series: &Series, random: &mut ChaCha8Rng) -> Vec<f64> {
    let width = series.width();
    let mut point = vec![0.0; series.len()];
    for (c, numbers) in point.chunks_exact_mut(width).enumerate() {
        let limits = problem.limits[c].of_orders();
        let (centre, reach) = series.centres()[c];
        // Where the position has no limit the middle does not matter.
        let [(_, room), ..] = limits;
        let away = if room.is_finite() { room / reach } else { 1.0 };
        numbers[0] = random.random_range(-0.7..0.7) * away;
        for number in &mut numbers[1..] {
            *number = StandardNormal.sample(random);
        }
        let shape = series.of_coordinate(c, numbers);
        let mean = centre + reach * numbers[0];
        let share = random.random_range(0.3..0.95);
        let mut scale = f64::INFINITY;
        for (order, (middle, most)) in limits.into_iter().enumerate() {
            let left = if order == 0 { most - (mean - middle).abs() } else { most };
            let largest = held::bound(&shape, series.frequency, order, mean);
            scale = scale.min(share * left / largest);
        }
        if scale.is_finite() {
            numbers[1..].iter_mut().for_each(|number| *number *= scale);
        }
    }
    point
}
