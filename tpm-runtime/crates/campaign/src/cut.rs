//! Inputs that were cut at a limit which the periodic motion keeps.

use tpm_motion::Record;
use tpm_plant::actuator::{Cut, LimitUse, Limited};

/// A sample counts as cut from this share of the largest force on: a record in text has been rounded.
const AT_LIMIT: f64 = 1.0 - 1e-9;

/// The limit at which most samples of a run were cut, with their number; `most`, the limit of which the periodic motion uses the largest
/// share, where no input was at its largest force. `used` is the use of an input's limits by the periodic motion.
pub(crate) fn cut_by_noise<'l>(
    limited: impl Iterator<Item = (usize, &'l Limited)>,
    record: &Record,
    most: Option<LimitUse>,
    used: impl Fn(usize, &Limited) -> LimitUse,
) -> Option<LimitUse> {
    let of = record.len();
    let cut = limited.filter_map(|(i, limited)| {
        let samples = record.inputs[i].iter().filter(|value| value.abs() >= AT_LIMIT * limited.force).count();
        // Of its limits the force alone counts here.
        let by_force = Limited { speed: f64::INFINITY, power: f64::INFINITY, bandwidth: f64::INFINITY, ..*limited };
        (samples > 0).then(|| LimitUse { cut: Some(Cut { samples, of }), ..used(i, &by_force) })
    });
    let count = |one: &LimitUse| one.cut.map_or(0, |cut| cut.samples);
    cut.max_by_key(count).or(most)
}
