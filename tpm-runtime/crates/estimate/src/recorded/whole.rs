//! Starts over whole stretches: the first way from a record to parameters.
//!
//! Simulated from one state, a record says all that it has of slow motions and of states that nobody measured, and a stable machine stays
//! near its inputs whatever its parameters are. Starts are raced on a coarser record, whose held inputs are means; the best goes on along
//! every reading.

use crate::recorded::signals::SignalsAsRecorded;
use crate::recorded::starts::{Pace, Scales, Unmeasured, first_state};
use crate::recorded::steps::{Course, Point, Settled};
use crate::recorded::work::{READINGS_GROWN, READINGS_SETTLED, RecordedFit, STEPS_TRIED, Work, first_noise};
use crate::settings::Settings;
use tpm_controller::model::Model;

/// Instants of the record over which starts are tried on whole stretches: so many, or this share of a cycle of its fastest motion apart.
const INSTANTS_TRIED: usize = 500;
const CYCLE_TRIED: f64 = 1.0 / 16.0;
/// How many starts go on there, and by how many steps: fewer and fewer, farther and farther.
const RACE: [(usize, usize); 3] = [(64, 3), (16, 4), (4, 25)];
/// Two starts lead to one minimum where their sums of squares differ by less than this share.
const SAME_MINIMUM: f64 = 0.01;

/// The record fitted from starts on whole stretches, and whether two of them led to one minimum. Nothing where no simulated
/// motion follows the record so far, as that of a machine that is unstable without its loop.
pub(super) fn fit_whole(
    (model, constants): (&dyn Model<f64>, &[f64]),
    signals: &SignalsAsRecorded,
    unshown: Option<usize>,
    settings: &Settings,
) -> Option<(RecordedFit, bool)> {
    let free = settings.free(model.dims().parameters).ok()?;
    let scales = |pace: Pace| Scales::of(model, signals, (pace, Unmeasured::Alike));
    let (slow, fast) = (scales(Pace::Crossings), scales(Pace::Turns));
    let span: f64 = signals.stretches().iter().map(|own| own[own.len() - 1].time - own[0].time).sum();
    let cycle = std::f64::consts::TAU / fast.frequency.max(slow.frequency);
    let coarse = signals.coarser((span / INSTANTS_TRIED as f64).min(CYCLE_TRIED * cycle));
    let paces = [Pace::Crossings, Pace::Turns].into_iter().take(if fast.frequency > slow.frequency { 2 } else { 1 });
    let unmeasured = [Unmeasured::Alike, Unmeasured::Deflection].into_iter().take(1 + usize::from(slow.has_alike()));
    let ways: Vec<(Pace, Unmeasured)> =
        paces.flat_map(|pace| unmeasured.clone().map(move |unmeasured| (pace, unmeasured))).collect();
    let works: Vec<Work<'_, '_>> = ways
        .iter()
        .map(|way| Work::new((model, constants), &coarse, *way, free.indices.clone(), settings).ok())
        .collect::<Option<_>>()?;
    let first = &works[0];
    if first.readings() <= first.least_unknowns() {
        return None;
    }
    let noise = first_noise(signals);
    let most = INSTANTS_TRIED * noise.len();
    let blocks = first.blocks(first.longest().min(most), most);
    // 1. Starts, of which the best go on.
    let mut begun: Vec<(usize, Vec<f64>, Settled)> = Vec::new();
    for number in 0..RACE[0].0 as u64 {
        let way = number as usize % works.len();
        let work = &works[way];
        let (typical, theta) = work.start(number).ok()?;
        let states = blocks.iter().map(|block| first_state(&work.flow, &work.scales, block)).collect();
        let course = work.course(&blocks, &typical);
        begun.extend(course.settle(Point { theta, states }, &noise, 0).map(|found| (way, typical, found)));
    }
    let go_on = |begun: &mut Vec<(usize, Vec<f64>, Settled)>, most: usize, steps: usize| {
        begun.sort_by(|a, b| a.2.cost.total_cmp(&b.2.cost));
        begun.truncate(most);
        for (way, typical, found) in begun.iter_mut() {
            let next = Course { quick: true, ..works[*way].course(&blocks, typical) }.settle(
                found.point.clone(),
                &noise,
                steps,
            );
            *found = next.unwrap_or_else(|| found.clone());
        }
        begun.sort_by(|a, b| a.2.cost.total_cmp(&b.2.cost));
    };
    RACE.iter().for_each(|(most, steps)| go_on(&mut begun, *most, *steps));
    let (_, typical, best) = begun.first()?;
    let again = begun.get(1).is_some_and(|other| other.2.cost <= (1.0 + SAME_MINIMUM) * best.cost);
    // 2. The whole record from the best of them.
    let mut work = Work::new((model, constants), signals, ways[begun[0].0], free.indices.clone(), settings).ok()?;
    let longest = work.longest().min(READINGS_SETTLED);
    // Clocks of the record itself, which a coarser one may not tell apart, begin without being late.
    let p = model.dims().parameters;
    let clocks = || work.flow.clocks.iter();
    let theta: Vec<f64> = best.point.theta[..p].iter().copied().chain(clocks().map(|_| 0.0)).collect();
    let typical: &[f64] = &typical[..p].iter().copied().chain(clocks().map(|clock| clock.step)).collect::<Vec<f64>>();
    let found = work.over(longest, typical, &theta, &noise).ok()?;
    let shorter = work.first_length();
    if work.explained(&found.noise) || shorter >= longest {
        return Some((work.fit(found, typical, unshown).ok()?, again));
    }
    // 3. What acts on the machine beside its inputs parts simulation and record: shorter blocks then explain what whole stretches do not.
    let blocks = work.blocks(shorter, READINGS_GROWN);
    let states = blocks.iter().map(|block| first_state(&work.flow, &work.scales, block)).collect();
    let from = Point { theta: found.settled.point.theta.clone(), states };
    let short = work.held(&blocks, typical).settle(from, &found.noise, STEPS_TRIED);
    let short = short.map(|short| (work.noise(&blocks, &short.point, &found.noise), short));
    let found = match short.filter(|(noise, _)| work.explained(noise)) {
        Some((noise, short)) => work.grown(typical, short, noise).unwrap_or(found),
        None => found,
    };
    Some((work.fit(found, typical, unshown).ok()?, again))
}
