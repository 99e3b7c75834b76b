//! The equations of a record whose inputs are known exactly: their noise read bin by bin, and their means, which noise shifts.

use crate::error::EstimateError;
use crate::measured_motion::record::MeasuredMotion;
use crate::measured_motion::repeats::Repeats;
use crate::noise::{Bins, row_variance, shifts, true_motion};
use num_complex::Complex;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_motion::Spectra;

/// The estimates from all records before the last one is refined.
pub(crate) type First<'a> = dyn FnMut(&mut [MeasuredMotion]) -> Result<Vec<f64>, EstimateError> + 'a;

/// Refines the last record at the estimates from all of them, which `first` gives.
///
/// # Errors
/// That of `first`, and [`EstimateError::Model`] when the model refuses an evaluation.
pub fn refine_last(
    records: &mut [MeasuredMotion],
    model: &dyn Model<f64>,
    constants: &[f64],
    spectra: &Spectra,
    hold: Hold,
    first: &mut First<'_>,
) -> Result<(), EstimateError> {
    let dims = model.dims();
    let Some(bins) = Bins::of(spectra, hold, dims) else { return Ok(()) };
    let theta = first(records)?;
    let Some(record) = records.last_mut() else { return Ok(()) };
    let slots = record.slots().to_vec();
    let gains: Vec<Vec<Vec<Complex<f64>>>> = (0..dims.rows).map(|row| record.gains(row, &theta)).collect();
    if !bins.hold_noise(dims.coordinates) {
        return Ok(());
    }
    let sensors = bins.sensors(dims.coordinates);
    let maps: Vec<Vec<f64>> = (0..dims.rows).map(|row| record.input_map(row)).collect();
    let of_row = |row: usize| {
        let highest = record.used(row).last().copied().unwrap_or(0);
        row_variance(&bins, (&maps[row], highest), &slots, &gains[row], &sensors)
    };
    let (variance, apart) = (0..dims.rows).map(of_row).unzip();
    let used: Vec<usize> = (0..dims.rows).map(|row| record.used(row).last().copied().unwrap_or(0)).collect();
    record.repeats = Repeats::of(spectra, &bins, &sensors.repeated, &used, &slots, &gains);
    record.set_variance(variance, apart, (!sensors.counted).then_some(sensors.white));
    let motion = true_motion(&bins, &maps, &slots, &gains, dims.coordinates);
    if let Some((motion, uncertainty)) = motion {
        let shift = shifts(model, constants, spectra, record.motion_harmonics(), &slots, &motion)?;
        record.admit_means(&shift, &theta, uncertainty);
    }
    record.couple();
    Ok(())
}
