//! From scaled starts over short blocks to whole stretches, and what the record then says of the parameters.

use crate::recorded::signals::SignalsAsRecorded;
use crate::recorded::starts::{Pace, Scales, Unmeasured};
use crate::recorded::whole::fit_whole;
use crate::recorded::work::{RecordedFault, RecordedFit, Work, first_noise};
use crate::settings::Settings;
use crate::verdict::LARGE_RESIDUAL;
use tpm_controller::model::Model;
use tpm_numerics::patience;

/// How much shorter the first blocks are where no start follows the record over longer ones.
const SHORTER: usize = 8;
/// A motion that is not explained is tried once more at the pace with which it turns back where that is so many times faster than the
/// pace of its crossings.
const LEAST_FASTER: f64 = 2.0;

/// Identifies a model by simulating it between the stamps of a record; `unshown` is the number of directions of the free parameters that
/// no record of these sensors shows, where that is known.
///
/// # Errors
/// [`RecordedFault`].
pub fn fit_recorded(
    model: &dyn Model<f64>,
    constants: &[f64],
    signals: &SignalsAsRecorded,
    unshown: Option<usize>,
    settings: &Settings,
) -> Result<RecordedFit, RecordedFault> {
    let whole = fit_whole((model, constants), signals, unshown, settings);
    let is_near = whole.as_ref().is_some_and(|(found, again)| *again || found.estimate.residual <= LARGE_RESIDUAL);
    let whole = match whole {
        Some((found, true)) if found.explains_all() => return Ok(found),
        other => other.map(|(found, _)| found),
    };
    let at = |begins: Begins| fit_beginning((model, constants), signals, begins, unshown, settings);
    let plain = Begins { pace: Pace::Crossings, unmeasured: Unmeasured::Alike, shorter: 1 };
    // Where whole stretches are followed, or two starts led to one minimum, short blocks are asked once whether there is another one.
    let mut best = at(plain);
    let left =
        |fit: &Result<RecordedFit, RecordedFault>| fit.as_ref().map_or(f64::INFINITY, |own| own.estimate.residual);
    let scales = |pace: Pace| Scales::of(model, signals, (pace, Unmeasured::Alike));
    // Steps that settled on another minimum leave much more than the sensors' noise, however small a share of the motion that is.
    let is_faster = scales(Pace::Turns).frequency >= LEAST_FASTER * scales(Pace::Crossings).frequency;
    let has_alike = scales(Pace::Crossings).has_alike();
    let faster = Begins { pace: Pace::Turns, ..plain };
    let deflected = Begins { unmeasured: Unmeasured::Deflection, ..plain };
    // A machine that only its loop holds leaves every start before a cycle of its motion is over; and the sum of squares over many cycles
    // of a mode that is faster than the motion has a minimum for every cycle that is skipped.
    let short = Begins { pace: Pace::Turns, shorter: SHORTER, ..plain };
    let parted = best.as_ref().is_ok_and(|own| own.parted);
    let mut tried = if parted {
        [(true, short), (is_faster, faster), (has_alike, deflected)]
    } else {
        [(is_faster, faster), (has_alike, deflected), (true, short)]
    }
    .into_iter();
    loop {
        let settled = match &best {
            Ok(found) => found.explains_all(),
            Err(fault) => !matches!(fault, RecordedFault::NotFollowed { .. } | RecordedFault::NotSettled { .. }),
        };
        let may_help = |(helps, begins): &(bool, Begins)| {
            *helps && (begins.shorter == 1 || parted || left(&best) > LARGE_RESIDUAL)
        };
        match tried.find(may_help) {
            Some((_, begins)) if !settled && !is_near && !patience::is_over() => {
                let other = at(begins);
                let replaces = match (&other, &best) {
                    (Ok(other), Ok(best)) => other.explains_more_than(best),
                    (other, _) => other.is_ok(),
                };
                if replaces {
                    best = other;
                }
            }
            _ => break,
        }
    }
    Ok(match (best, whole) {
        (Ok(best), Some(whole)) if whole.is_preferred_to(&best) => whole,
        (Err(_), Some(whole)) => whole,
        (best, _) => best?,
    })
}

/// How starts are made: at which pace, what is not measured, and how much shorter the first blocks are.
#[derive(Clone, Copy)]
struct Begins {
    pace: Pace,
    unmeasured: Unmeasured,
    shorter: usize,
}

/// [`fit_recorded`] with starts that are made in one way.
fn fit_beginning(
    (model, constants): (&dyn Model<f64>, &[f64]),
    signals: &SignalsAsRecorded,
    begins: Begins,
    unshown: Option<usize>,
    settings: &Settings,
) -> Result<RecordedFit, RecordedFault> {
    let dims = model.dims();
    let free = settings.free(dims.parameters)?;
    let begun = (begins.pace, begins.unmeasured);
    let mut work = Work::new((model, constants), signals, begun, free.indices.clone(), settings)?;
    work.shorter = begins.shorter;
    let (of, unknowns) = (work.readings(), work.least_unknowns());
    if of <= unknowns {
        return Err(RecordedFault::TooFew { readings: of, unknowns });
    }
    let begun = work.begun(&first_noise(signals));
    if patience::is_over() {
        return Err(RecordedFault::Ended);
    }
    let (typical, settled, noise) = begun?;
    let grown = work.grown(&typical, settled, noise)?;
    work.fit(grown, &typical, unshown)
}
