//! What a wrong gain of the only input does, where nothing that is known fixes the scale of the forces.

use crate::likelihood::fit::{CalibrationFault, GAIN_FAULT, HARMFUL, UnseenFault};
use crate::likelihood::library::{Term, TermKind};
use crate::result::Estimate;
use crate::rows::Rows;
use crate::settings::Settings;
use tpm_controller::model::Model;

/// Motions at which it is asked whether anything in the rows is known.
const PROBES: usize = 8;

/// The fault of the gain of the only input of a model. With all parameters times a factor the rows hold for this multiple of the input, so that
/// no record shows it; nothing where there are several inputs, or where a force that is known or a parameter that is held fixes the scale.
#[must_use]
pub fn gain_of_the_only_input(
    model: &dyn Model<f64>,
    constants: &[f64],
    estimate: &Estimate,
    settings: &Settings,
) -> Option<CalibrationFault> {
    let held = settings.frozen.iter().any(|own| own.value != 0.0);
    let alone = model.dims().inputs == 1 && !model.needs_inputs();
    if held || !alone || !nothing_is_known(Rows { model, constants }) {
        return None;
    }
    let shares = estimate.values.iter().zip(&estimate.std).map(|(value, std)| value.abs() / std);
    let moves = GAIN_FAULT * shares.filter(|share| share.is_finite()).fold(0.0, f64::max);
    Some(CalibrationFault {
        term: Term { kind: TermKind::InputGain, row: None, of: 0, other: None },
        std: None,
        change: estimate.values.clone(),
        unseen: (moves > HARMFUL).then_some(UnseenFault { size: GAIN_FAULT, moves }),
    })
}

/// Whether the rows are parameters and the input alone.
fn nothing_is_known(rows: Rows<'_>) -> bool {
    let slots = rows.model.dims().motion_len();
    let mut scratch = rows.scratch();
    (0..PROBES).all(|probe| {
        // Arbitrary motions, so that a known term vanishes at none of them by chance.
        let instant: Vec<f64> = (0..slots).map(|slot| (2.4 * (probe * slots + slot + 1) as f64).sin()).collect();
        rows.evaluate(&instant, &mut scratch).is_ok() && scratch.known.iter().all(|known| *known == 0.0)
    })
}
