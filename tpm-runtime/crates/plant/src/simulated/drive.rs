//! Open-loop excitation of a simulated machine by given inputs, to measure a frequency response.

use crate::simulated::rig::Rig;
use crate::simulated::sensor::{Measurement, apply};
use crate::simulated::transmission::Transmission;
use tpm_controller::model::{Buffer, EvalError, Model, require_len};
use tpm_motion::{Ending, Plant, Record};

/// Plays the inputs (one column per input, a value per sample, held until the next) on the machine, which starts at
/// rest at zero. The record holds the inputs as the drives applied them.
///
/// # Errors
/// [`EvalError`] when model, rig and inputs do not fit together, or the plant's rows do not determine its motion.
pub fn drive(model: &dyn Model<f64>, rig: &Rig, sample_time: f64, inputs: &[Vec<f64>]) -> Result<Record, EvalError> {
    let dims = model.dims();
    let n = dims.coordinates;
    require_len(Buffer::Motion, rig.sensors.len(), n)?;
    require_len(Buffer::Inputs, rig.actuators.len(), dims.inputs)?;
    require_len(Buffer::Inputs, inputs.len(), dims.inputs)?;
    let samples = inputs.iter().map(Vec::len).min().unwrap_or(0);
    let mut plant = Plant::new(model, &rig.parameters, &rig.constants)?;
    let mut measurement = Measurement::new(&rig.sensors, rig.seed, 0);
    let mut transmission = Transmission::new(&rig.actuators, sample_time, rig.sub_steps);
    let (mut measured, mut applied) = (vec![0.0; n], vec![0.0; dims.inputs]);
    let mut record = Record {
        sample_time,
        coordinates: vec![Vec::with_capacity(samples); n],
        inputs: vec![Vec::with_capacity(samples); dims.inputs],
        rates: Vec::new(),
        ending: Ending::Complete,
        saturated: 0,
    };
    for sample in 0..samples {
        measurement.sample(plant.motion(), &mut measured);
        for (column, value) in record.coordinates.iter_mut().zip(&measured) {
            column.push(*value);
        }
        for (value, column) in applied.iter_mut().zip(inputs) {
            *value = column[sample];
        }
        record.saturated += usize::from(apply(&rig.actuators, (plant.motion(), n), &mut applied, &mut record.inputs));
        if transmission.advance(&mut plant, &applied)? {
            record.ending = Ending::Diverged { sample };
            break;
        }
    }
    Ok(record)
}

#[cfg(test)]
mod tests {
    use super::drive;
    use crate::simulated::rig::Rig;
    use crate::simulated::sensor::{Actuator, Sensor};
    use tpm_motion::Ending;
    use tpm_test_support::models::MassSpringDrag;

    #[test]
    fn a_step_moves_a_mass_as_it_must() {
        let rig = Rig {
            parameters: vec![2.0, 8.0, 0.0],
            constants: vec![],
            sensors: vec![Sensor::default()],
            actuators: vec![Actuator { limit: 3.0, ..Actuator::default() }],
            sub_steps: 4,
            seed: 1,
        };
        // 4 N, cut to 3: x = 3/8 (1 - cos 2 t).
        let record = drive(&MassSpringDrag, &rig, 0.01, &[vec![4.0; 500]]).expect("fits");
        assert_eq!((record.ending, record.saturated, record.inputs[0][7]), (Ending::Complete, 500, 3.0));
        for (n, x) in record.coordinates[0].iter().enumerate() {
            let expected = 0.375 * (1.0 - (0.02 * n as f64).cos());
            assert!((x - expected).abs() < 1e-9, "{n}: {x} {expected}");
        }
        assert!(drive(&MassSpringDrag, &rig, 0.01, &[]).is_err());
    }
}
